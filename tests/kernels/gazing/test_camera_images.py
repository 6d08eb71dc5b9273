"""Pinhole cameras: rays, edges and levels; their images put back on the mirror; the profile of a sun's disc."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heliosweep.kernels.gazing.geometry import (
    AT_LIMB,
    EXACT,
    Pinholes,
    align,
    camera_set,
    heliostat,
    homography,
    image_set,
    mirror_grid,
    module_spheres,
    moved,
    outline,
    pinholes,
    places_of,
    rectify,
    themis_8,
    transfers,
    waviness,
)
from heliosweep.kernels.gazing.slopes import fit_slopes
from heliosweep.kernels.profiles import EPS_MAX, disc_profile, jose, render
from tests.kernels.gazing import twin

SHAPE, FOCAL = (120, 124), 1600.0
FLAT = np.zeros((8, 2))
#: Bright wherever a mirror reflects the sky.
BRIGHT = jose(limb=0.9999999, radius=1.0)


def test_aligned_images_are_centred_to_the_pixel_and_ring_at_edges():
    """A heliostat that is lit evenly: 1 inside of the modules, for rolled cameras and an image off its centre."""
    layout, modules = twin.paper_scene(), themis_8()
    grid = mirror_grid(modules, 0.1)
    cameras = pinholes(layout, (160, 160), FOCAL, roll=0.3)
    seen = camera_set(layout, cameras, (160, 160), BRIGHT, heliostat(modules, 120.0, FLAT), 3)
    inner = np.abs(grid.pixels - modules.centre[grid.pixel_module].T) < 0.5 * modules.size[0][:, np.newaxis] - 0.5
    whole = align(seen, cameras, 120.0, modules, grid)
    np.testing.assert_allclose(whole[:, inner.all(axis=0)], 1.0, atol=0.06)
    assert np.abs(whole - 1.0).max() > 0.3  # at edges
    moved_by = align(np.roll(seen, (5, -7), axis=(1, 2)), cameras, 120.0, modules, grid)
    np.testing.assert_allclose(moved_by[:, inner.all(axis=0)], 1.0, atol=0.06)


def at_one_pixel(layout, cameras, places, centres):
    """What each camera sees at single points of its image, as pixel (0, 0) of an image of one pixel."""
    moved_cameras = Pinholes(cameras.eyes, cameras.axes, cameras.focal, cameras.centre - places)
    return camera_set(layout, moved_cameras, (1, 1), jose(), centres, 1)[:, 0, 0]


def projected(cameras, camera, points):
    """(u, v) of points in the mirror frame, by NumPy."""
    right, down, forward = (points - cameras.eyes[camera]) @ cameras.axes[camera].T
    return cameras.centre[camera] + cameras.focal[camera] * np.array([right, down]) / forward


@settings(max_examples=40)
@given(
    *[st.floats(-3e-3, 3e-3)] * 4,
    st.floats(60.0, 300.0),
    st.integers(0, 7),
    st.floats(-0.49, 0.49),
    st.floats(-0.49, 0.49),
)
def test_rays_meet_the_turned_spheres(c_y, c_z, p_y, p_z, focal_length, row, s, t):
    layout, modules = twin.paper_scene(), themis_8()
    canting = np.tile([c_y, c_z], (8, 1)) * np.linspace(-1.0, 1.0, 8)[:, np.newaxis]
    mirror = heliostat(modules, focal_length, canting, (p_y, p_z))
    cameras = pinholes(layout, SHAPE, FOCAL, roll=0.3)
    y, z = modules.centre[row] + modules.size[row] * (s, t)
    points, normals = twin.surface(
        np.array([y]), np.array([z]), modules.centre[row], focal_length, canting[row], (p_y, p_z)
    )
    expected = twin.images(layout, points, normals)[:, 0]
    places = np.array([projected(cameras, i, points[0]) for i in range(4)])
    np.testing.assert_allclose(at_one_pixel(layout, cameras, places, mirror), expected, atol=2e-5)


@pytest.fixture(scope="module")
def shot():
    """Scene, modules, grid, cameras, images and what the mirror's grid would show."""
    layout, modules = twin.paper_scene(), themis_8()
    grid, canting, pointing = mirror_grid(modules, 0.05), twin.paper_canting(), (0.2e-3, -0.1e-3)
    cameras = pinholes(layout, SHAPE, FOCAL)
    seen = camera_set(layout, cameras, SHAPE, jose(), heliostat(modules, 120.0, canting, pointing), 3)
    images, slopes = image_set(layout, grid, jose(), module_spheres(modules, 120.0, canting, pointing))
    return layout, modules, grid, cameras, seen, images, slopes


def found_slopes(layout, grid, images):
    start, _ = twin.by_kernels(images, layout, jose(), grid.pixels, transfers(layout)[EXACT:])
    return fit_slopes("LM", layout, jose(), images, start[0], grid.pixels).slopes


def test_rectified_images_are_those_of_the_grid(shot):
    layout, modules, grid, cameras, seen, images, slopes = shot
    values, flags, noise = rectify(seen, cameras, 120.0, modules, grid)
    good = flags == 0
    assert good.mean() > 0.7
    assert np.abs(values - images)[good].max() < 4e-5
    assert np.sqrt(np.mean((values - images)[good] ** 2)) < 5e-6
    assert np.all(np.isnan(values[~good]))
    assert np.all((noise[good] > 0.4) & (noise[good] <= 1.0 + 1e-12))
    error = found_slopes(layout, grid, values) - slopes
    assert np.nanmax(np.abs(error)) < 5e-6  # 0.005 mrad
    assert np.sqrt(np.nanmean(error**2)) < 1.2e-6


def test_marked_corners_take_up_how_cameras_were_pointed():
    """Cameras turned, shifted and zoomed: the corners alone tell, and the geometry knows the mirror's sag."""
    layout, modules = twin.paper_scene(), themis_8()
    grid, canting = mirror_grid(modules, 0.05), twin.paper_canting()
    true = pinholes(layout, SHAPE, 1500.0, centre=[64.3, 57.1], roll=[0.03, -0.02, 0.01, 0.05])
    seen = camera_set(layout, true, SHAPE, jose(), heliostat(modules, 120.0, canting), 3)
    images, slopes = image_set(layout, grid, jose(), module_spheres(modules, 120.0, canting))
    ends = outline(modules)
    marked = np.moveaxis(places_of(true, 120.0, ends.T), 1, -1)
    guess = pinholes(layout, SHAPE, 1000.0)
    values, flags, _ = rectify(seen, guess, 120.0, modules, grid, corners=marked)
    good = flags == 0
    assert good.mean() > 0.7
    assert np.abs(values - images)[good].max() < 1e-4
    error = found_slopes(layout, grid, values) - slopes
    assert np.nanmax(np.abs(error)) < 1e-5
    # A plane's homography from the mirror alone would be off by the sag of 6 cm seen at an angle.
    flat = homography(ends * [1.0, -1.0], marked[0])
    middle = (moved(flat, np.zeros((2, 1))) - places_of(true, 120.0, np.zeros((2, 1)))[0])[:, 0]
    assert np.hypot(*middle) > 0.1


def wavy_images(rms, pixel=0.01):
    """Scene, modules, grid, cameras, images with waviness, and what the mirror's grid would show."""
    layout, modules = twin.paper_scene(), themis_8()
    fine, grid = mirror_grid(modules, pixel), mirror_grid(modules, 0.05)
    field = np.full((2, fine.module.size), np.nan)
    field[:, fine.place] = wavy = waviness(fine, rms, 1.0, 2)
    coarse = field.reshape(2, *fine.module.shape)[:, 2::5, 2::5].reshape(2, -1)[:, grid.place]  # their centres
    cameras = pinholes(layout, (240, 248), 3200.0)
    seen = camera_set(layout, cameras, (240, 248), jose(), heliostat(modules, 120.0, FLAT, wavy=(fine, wavy)), 2)
    spheres = module_spheres(modules, 120.0, FLAT)
    return modules, grid, cameras, seen, image_set(layout, grid, jose(), spheres, np.ascontiguousarray(coarse))[0]


def test_pixels_at_the_limb_are_left_out():
    modules, grid, cameras, seen, images = wavy_images(0.3e-3)
    blind, sharp = (rectify(seen, cameras, 120.0, modules, grid, threshold=t) for t in (-math.inf, 0.3))
    assert np.abs(blind[0] - images)[blind[1] == 0].max() > 0.2
    good = sharp[1] == 0
    assert np.abs(sharp[0] - images)[good].max() < 0.04
    np.testing.assert_array_equal(blind[1], sharp[1] & ~AT_LIMB)
    assert 0.0 < np.mean((sharp[1] & AT_LIMB) > 0) < 0.2


def sun_image(radius, side, centre, noise, seed=0):
    fine = 5
    place = (np.arange(side * fine) + 0.5) / fine - 0.5
    far = np.hypot(place - centre[0], place[:, np.newaxis] - centre[1])
    disc = render(jose(), far * (EPS_MAX / radius)).reshape(side, fine, side, fine).mean(axis=(1, 3))
    return 3000.0 * (disc + noise * np.random.default_rng(seed).standard_normal(disc.shape))


@pytest.mark.parametrize(("radius", "tolerance"), [(20.0, 7e-3), (60.0, 4e-3), (140.0, 6e-3)])
def test_profile_of_a_disc(radius, tolerance):
    side = int(2 * radius) + 25
    centre = (0.5 * side + 0.3, 0.5 * side - 1.2)
    image = sun_image(radius, side, centre, 0.004)
    image[3, 4], image[side // 2, side // 2] = np.nan, 9e9  # a dead pixel and a hot one
    found = disc_profile(image)
    assert found.radius == pytest.approx(radius, rel=1.5e-3)
    assert found.centre == pytest.approx(centre, abs=0.08)
    assert found.level == pytest.approx(3000.0, rel=2e-3)
    expected = render(jose(), np.linspace(0.0, EPS_MAX, len(found.brightness)))
    np.testing.assert_allclose(found.brightness, expected, atol=tolerance)
    assert len(found.brightness) == min(round(radius) + 1, 120)


def test_images_that_show_no_disc():
    whole = sun_image(30.0, 90, (45.0, 45.0), 0.0)
    for image, words in (
        (np.zeros((50, 50)), "no disc"),
        (np.full((50, 50), np.nan), "no disc"),
        (sun_image(8.0, 40, (20.0, 20.0), 0.0), "12 are needed"),
        (whole[:, 20:], "frame cuts"),
        (np.where(np.arange(90) > 45, whole, 0.0), "no single round disc"),
        (np.hstack((whole, whole)), "no single round disc"),
    ):
        with pytest.raises(ValueError, match=words):
            disc_profile(image)

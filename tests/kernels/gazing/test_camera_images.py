"""Pinhole cameras: rays, edges and levels; their images put back on the mirror; the profile of a sun's disc."""

import numpy as np
import pytest

from heliosweep.kernels.gazing.geometry import (
    EXACT,
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
)
from heliosweep.kernels.gazing.slopes import fit_slopes
from heliosweep.kernels.profiles import EPS_MAX, disc_profile, jose, render
from tests.kernels.gazing import twin

SHAPE, FOCAL = (120, 124), 1600.0


def found_slopes(layout, grid, images):
    start, _ = twin.by_kernels(images, layout, jose(), grid.pixels, transfers(layout)[EXACT:])
    return fit_slopes("LM", layout, jose(), images, start[0], grid.pixels).slopes


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
        (whole[:, 20:], "cut off by the frame"),
        (np.where(np.arange(90) > 45, whole, 0.0), "no single round disc"),
        (np.hstack((whole, whole)), "no single round disc"),
    ):
        with pytest.raises(ValueError, match=words):
            disc_profile(image)

"""Where images show the heliostat: known turns, shifts, scales and noise come back."""

import numpy as np
import pytest

from heliosweep.families.backward_gazing.images import register
from heliosweep.kernels.gazing.geometry import camera_set, expose, heliostat, outline, pinholes, places_of, themis_8
from heliosweep.kernels.profiles import jose
from tests.families.backward_gazing import make_images as made


def upright(points):
    camera = pinholes(made.layout(), (100, 100), 1000.0)
    return places_of(camera, 120.0, points)[0]


def taken(shape, focal, roll, shift, noise, canting):
    """Image of the first camera, and where it shows the corners of the heliostat."""
    here, ends = made.layout(), outline(themis_8())
    centre = 0.5 * (np.array(shape[::-1]) - 1.0) + shift
    cameras = pinholes(here, shape, focal, centre, np.radians(roll))
    one = here._replace(eyes=here.eyes[:1], cameras=here.cameras[:1], gaze=here.gaze[:1])
    first = cameras._replace(eyes=cameras.eyes[:1], axes=cameras.axes[:1], focal=cameras.focal[:1])
    seen = camera_set(one, first, shape, jose(), heliostat(themis_8(), 120.0, canting), 4)
    image = expose(seen, noise=noise, bits=12, seed=3, pinhole=True)[0]
    return image, places_of(cameras, 120.0, ends.T)[0].T, centre


@pytest.mark.parametrize(
    ("shape", "focal", "roll", "shift", "noise", "most"),
    [
        ((176, 176), 2350.0, 0.0, (0.0, 0.0), 0.0, 0.01),
        ((220, 260), 2350.0, -25.0, (-30.1, 5.5), 0.004, 0.03),
        ((220, 260), 2500.0, 7.0, (11.0, 12.0), 0.02, 0.08),
        ((300, 400), 3300.0, 38.0, (20.3, -10.7), 0.01, 0.05),
    ],
)
def test_corners_come_back(shape, focal, roll, shift, noise, most):
    image, corners, centre = taken(shape, focal, roll, shift, noise, made.CANTING)
    found, turn, scale, middle, _ = register(image, upright, themis_8())
    assert np.abs(found - corners).max() < most
    assert np.degrees(turn) == pytest.approx(-roll, abs=0.02)
    assert scale == pytest.approx(focal / 1000.0, rel=5e-4)
    assert middle == pytest.approx(centre, abs=0.5 * most)


def test_dark_modules_and_dirt_do_no_harm():
    canting = made.CANTING.copy()
    canting[[0, 6]] = 0.006  # these send the sun elsewhere
    image, corners, _ = taken((220, 260), 2350.0, 10.0, (5.0, -8.0), 0.004, canting)
    image[100:104, :] *= 0.7
    image[30, 200], image[31:33, 40] = 1.2, np.nan
    found = register(image, upright, themis_8())[0]
    away = np.abs(found - corners)
    assert away.max() < 0.2  # at the corner of a dark module
    assert away[1:].max() < 0.05


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((60, 80)), "it has no lit pixel"),
        (np.full((60, 80), np.nan), "it has no lit pixel"),
        (np.random.default_rng(0).uniform(0.0, 1.0, (120, 120)), "up to the edge of the image"),
        (np.ones((120, 120)), "up to the edge of the image"),
        (np.ones((1, 1)), "up to the edge of the image"),
        (np.full((50, 50), np.inf), "it has no lit pixel"),
        (np.pad(np.ones((60, 60)), 40), "stretched by 3 %"),
    ],
)
def test_images_of_something_else(image, words):
    with pytest.raises(ValueError, match=words):
        register(image, upright, themis_8())


@pytest.mark.parametrize(
    ("roll", "shift", "words"),
    [(90.0, (0.0, 0.0), "stretched by 6 %"), (0.0, (90.0, 0.0), "up to the edge of the image")],
)
def test_a_heliostat_on_its_side_or_cut_by_the_frame_is_refused(roll, shift, words):
    image, _, _ = taken((220, 260), 2350.0, roll, shift, 0.004, made.CANTING)
    with pytest.raises(ValueError, match=words):
        register(image, upright, themis_8())

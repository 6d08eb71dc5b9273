"""Conic sections of deviation curves."""

import numpy as np
import pytest

from heliosweep.kernels.mounts import REACHES
from heliosweep.kernels.spots import (
    AZIMUTH,
    CANTING,
    ELEVATION,
    deviation_curves,
)
from tests.kernels.spots.deviations import deviation_spots, setting
from tests.kernels.spots.test_deviation import KINDS, field, sun_at

ROWS = slice(0, 6)
ECCENTRICITY, FOCUS = 6, slice(7, 9)


def conics(*arguments):
    return deviation_curves(*arguments).conic


def powers(y, z):
    """What the coefficients A to F multiply."""
    return np.stack([y * y, y * z, z * z, y, z, np.ones_like(y)])


def traced(settings, axis, sun, pivots):
    """Spots of one curve for errors all round."""
    sizes = np.linspace(-1.5, 1.5, 301)
    many = type(settings)(*(np.repeat(values, len(sizes)) for values in settings))
    which = np.zeros(len(sizes), int), np.full(len(sizes), axis)
    y, z, status = deviation_spots(many, *which, sizes, sun, pivots)[:, :, 0, 0]
    return y[status == REACHES], z[status == REACHES]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("axis", [ELEVATION, AZIMUTH])
def test_spots_lie_on_the_conic(axis, kind):
    pivots, sun = field(np.random.default_rng(axis), 8)
    settings = setting(kind=kind, mirror_offset=0.5, face_tilt=-0.2, face_azimuth=0.1)
    found = conics(settings, [CANTING], [axis], sun, pivots)[:, 0]
    shapes = set()
    for h, t in np.ndindex(8, 8):
        y, z = traced(settings, axis, sun[:, t : t + 1], pivots[:, h : h + 1])
        terms = found[ROWS, h, t, np.newaxis] * powers(y, z)
        distance = np.linalg.norm(pivots[0, h] - [0.0, 0.0, 143.0])
        size = np.abs(found[:3, h, t]).sum() * (distance**2 + y * y + z * z)
        assert np.max(np.abs(terms.sum(axis=0)) / size) < 1e-12
        shapes.add(found[ECCENTRICITY, h, t] > 1.0)
        if np.isinf(found[ECCENTRICITY, h, t]):
            continue
        discriminant = found[1, h, t] ** 2 - 4.0 * found[0, h, t] * found[2, h, t]
        assert (discriminant > 0.0) == (found[ECCENTRICITY, h, t] > 1.0)
    assert True in shapes


@pytest.mark.parametrize("axis", [ELEVATION, AZIMUTH])
def test_focus_is_that_of_the_branch_that_rays_trace(axis):
    """Distances to focus and directrix have the ratio of the eccentricity; those of a branch to its focus are least."""
    pivots, sun = field(np.random.default_rng(7), 6)
    # a low sun in the north-west and a mirror that looks west: ellipses
    pivots[0, 3:] = [[150.0, 150.0, 0.0], [200.0, 160.0, 3.0], [120.0, 180.0, 5.0]]
    sun[0, 3:] = [sun_at(azimuth, 0.15)[0, 0] for azimuth in (-0.9, -0.7, -0.5)]
    settings = setting(target_height=20.0)
    found = conics(settings, [CANTING], [axis], sun, pivots)[:, 0]
    ellipses = 0
    for h, t in np.ndindex(6, 6):
        y, z = traced(settings, axis, sun[:, t : t + 1], pivots[:, h : h + 1])
        near = np.hypot(y, z) < 3e3
        distance = np.hypot(y - found[7, h, t], z - found[8, h, t])[near]
        # the distance to a focus is a linear function of the place, only on one branch
        plane = np.stack([y[near], z[near], np.ones(near.sum())], axis=1)
        coefficients, *_ = np.linalg.lstsq(plane, distance, rcond=None)
        assert np.max(np.abs(plane @ coefficients - distance)) < 1e-7
        assert np.hypot(*coefficients[:2]) == pytest.approx(found[ECCENTRICITY, h, t], rel=1e-6)
        # and grows away from the directrix; of the other focus it is nearer to none of the points
        ellipses += found[ECCENTRICITY, h, t] < 1.0
        a = found[ROWS, h, t]
        centre = np.linalg.solve([[2 * a[0], a[1]], [a[1], 2 * a[2]]], -a[3:5])
        other = np.hypot(*(np.stack([y, z]) - (2.0 * centre - found[FOCUS, h, t])[:, np.newaxis]))[near]
        if found[ECCENTRICITY, h, t] > 1.0:
            assert np.all(distance < other)
    assert ellipses > 3 or axis == AZIMUTH

"""Conic sections of deviation curves."""

import numpy as np
import pytest

from heliosweep.kernels.mounts import REACHES
from heliosweep.kernels.spots import AZIMUTH, CANTING, ELEVATION, deviation_curves
from tests.kernels.spots.deviations import deviation_spots, setting
from tests.kernels.spots.test_deviation import KINDS, field

ROWS = slice(0, 6)
ECCENTRICITY = 6


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

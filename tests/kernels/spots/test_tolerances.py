"""Tolerances: where the spot leaves the aperture."""

import numpy as np

from heliosweep.kernels.mounts import REACHES
from heliosweep.kernels.spots import ELEVATION, ENCODER, deviation_curves
from tests.kernels.spots.deviations import deviation_spots, setting
from tests.kernels.spots.test_deviation import sun_at


def tolerances(*arguments):
    return deviation_curves(*arguments).tolerance


def spots_at(settings, source, axis, sizes, sun, pivots):
    """Spots of one mirror and instant for many errors, shape (3, errors)."""
    many = type(settings)(*(np.repeat(values, len(sizes)) for values in settings))
    which = np.full(len(sizes), source), np.full(len(sizes), axis)
    return deviation_spots(many, *which, sizes, sun, pivots)[:, :, 0, 0]


def test_curve_inside_the_aperture_is_never_left():
    """An ellipse: a low sun in the north-west, and a mirror that looks west on a receiver that looks north."""
    sun, pivot = sun_at(-0.7, 0.15), np.array([[[200.0, 160.0, 3.0]]])
    for offset in (0.0, 0.5):
        settings = setting(target_height=20.0, mirror_offset=offset, half_width=1e3, half_height=1e3)
        spots = spots_at(settings, ENCODER, ELEVATION, np.linspace(-np.pi, np.pi, 2001), sun, pivot)
        real = spots[2] == REACHES
        assert 900 < real.sum() < 1100  # lit through half a turn, and always in front of the plane
        reach = np.abs(spots[:2, real]).max(axis=1)
        assert np.all(reach < 800.0)
        assert np.isinf(tolerances(settings, [ENCODER], [ELEVATION], sun, pivot)).all()
        for width, height in ((0.99 * reach[0], 1e3), (1e3, 0.99 * reach[1])):
            smaller = settings._replace(half_width=np.array([width]), half_height=np.array([height]))
            assert np.isfinite(tolerances(smaller, [ENCODER], [ELEVATION], sun, pivot)).all()

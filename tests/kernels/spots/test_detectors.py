"""Detector lines: crossings of deviation curves, and the mirror from them."""

import numpy as np
import pytest

from heliosweep.kernels.mounts import REACHES
from heliosweep.kernels.spots import deviation_curves
from tests.kernels.spots.deviations import setting
from tests.kernels.spots.test_deviation import ALL, field
from tests.kernels.spots.test_tolerances import spots_at

LINES = np.array([[1.0, 0.0, 6.0], [0.0, 1.0, -6.0], [0.6, -0.8, 3.0], [-2.0, 1.0, 15.0], [0.0, 1.0, 150.0], [1, 1, 0]])


def crossings(settings, source, axis, lines, sun, pivots):
    return deviation_curves(settings, source, axis, sun, pivots, lines).crossing


@pytest.mark.parametrize(("source", "axis", "kind"), ALL)
def test_crossings_lie_on_line_and_curve_and_are_the_first(source, axis, kind):
    pivots, sun = field(np.random.default_rng(kind + 1), 2)
    for offset, pedestal in ((0.0, 0.0), (0.5, 6.0)):
        settings = setting(kind=kind, mirror_offset=offset, pedestal_height=pedestal, face_tilt=-0.2)
        y, z, error = crossings(settings, [source], [axis], LINES, sun, pivots)[:, 0]
        assert np.isfinite(error).any()
        for h, t, i in np.ndindex(error.shape):
            place = sun[:, t : t + 1], pivots[:, h : h + 1]
            first = np.pi if np.isnan(error[h, t, i]) else abs(error[h, t, i])
            if first < np.pi:
                spot = spots_at(settings, source, axis, error[h, t, i : i + 1], *place)[:, 0]
                np.testing.assert_array_equal(spot[:2], [y[h, t, i], z[h, t, i]])
                far = 1.0 + (np.hypot(*spot[:2]) / 100.0) ** 2
                assert abs(LINES[i] @ [spot[0], spot[1], -1.0]) < 1e-10 * far
            for side in (1.0, -1.0):
                scanned = spots_at(settings, source, axis, side * np.linspace(0.0, 0.9999 * first, 2001), *place)
                real = scanned[2] == REACHES
                beyond = LINES[i] @ np.stack([scanned[0], scanned[1], -np.ones(2001)])
                steps = real[1:] & real[:-1] & (np.abs(beyond[1:]) < 1e3) & (np.abs(beyond[:-1]) < 1e3)
                assert not np.any(steps & (beyond[1:] * beyond[:-1] < 0.0))
            if LINES[i, 2] == 0.0:
                assert error[h, t, i] == 0.0

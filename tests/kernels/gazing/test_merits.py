"""Merits of the searches for slopes, compared with NumPy."""

import numpy as np
import pytest

from heliosweep.kernels.gazing.slopes import look_back, residual_squares
from heliosweep.kernels.profiles import jose, noisy, smooth_fit
from tests.kernels.gazing import twin
from tests.kernels.sun.curves import plain

PROFILES = {"jose": jose(), "table": noisy(jose(), 0.012), "fit": smooth_fit(noisy(jose(), 0.012))}


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("fit_gain", [False, True])
def test_merits(name, fit_gain):
    layout, rng, count = twin.paper_scene(), np.random.default_rng(1), 500
    place = rng.uniform(-4.0, 4.0, (2, count))
    slopes = rng.normal(0.0, 1e-3, (2, count))  # a few rays end outside the disc, on the tangent
    images = rng.uniform(0.2, 1.0, (4, count))
    images[2, 7] = np.nan
    points = twin.series(place[0], place[1], layout.focal_length, slopes)
    offsets = np.array([twin.offsets(layout, i, *points).T for i in range(4)])
    values = plain(PROFILES[name], np.hypot(offsets[:, 0], offsets[:, 1]))
    lit = images >= 0.3
    seen = np.where(lit, images, 0.0)
    gain = np.sum(values * seen, axis=0) / np.sum(values**2 * lit, axis=0) if fit_gain else 1.0
    expected = np.sum((gain * values - seen) ** 2 * lit, axis=0)
    found = residual_squares(look_back(layout, PROFILES[name], place, slopes)[1], images, 0.3, fit_gain)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)

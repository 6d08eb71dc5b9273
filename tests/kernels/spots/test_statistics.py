"""Statistics of spots: against NumPy over stored spots, and cut in every way."""

import numpy as np

from heliosweep.kernels.spots import MOMENTS, angle_percentiles, mount_spots, spot_statistics
from tests.kernels.spots.test_mount_spots import errors, pivots, setting, suns


def sampled(one, actual, known, sun, places):
    """Spots (3, P, H, T, K) of K samples of the errors, one after the other."""
    return np.stack([mount_spots(one, each, known, sun, places) for each in np.moveaxis(actual, 2, 0)], axis=-1)


def test_spots_that_miss_do_not_count():
    """Some samples send the ray away: no part of the means, no hit, no tolerance left."""
    actual = errors(1, 1, 50, spread=1e-3)
    actual[..., 10:20, 0] = np.pi
    one, known, sun, places = setting(axis_offset=0.0), np.zeros((1, 1, 6)), suns(4), pivots(2)
    made = spot_statistics(one, actual, known, sun, places, [0.0, 10.0, 50.0])
    rest = spot_statistics(one, np.delete(actual, np.arange(10, 20), axis=2), known, sun, places, [0.0])
    for name in MOMENTS[:5]:
        np.testing.assert_allclose(made[name], rest[name], rtol=1e-12)
    np.testing.assert_array_equal(made["real_fraction"], 0.8)
    np.testing.assert_allclose(made["hit_fraction"], 0.8 * rest["hit_fraction"], rtol=1e-14)
    np.testing.assert_array_equal(made["tolerance"][..., :2, :], 0.0)
    actual[..., 0] = np.pi
    made = spot_statistics(one, actual, known, sun, places)
    for name in MOMENTS[:5]:
        assert np.isnan(made[name]).all()
    for name in ("real_fraction", "hit_fraction", "tolerance", "status"):
        np.testing.assert_array_equal(made[name], 0.0)


def test_percentiles_of_infinite_angles():
    quarter = 0.25 * np.pi
    angles = np.array([np.inf, quarter, np.inf, 0.0, quarter])
    made = angle_percentiles(angles, np.array([0, 12.5, 25, 50, 60, 75, 100]))
    np.testing.assert_array_equal(made, [0.0, 0.5 * quarter, quarter, quarter, np.inf, np.inf, np.inf])

"""Statistics of spots: against NumPy over stored spots, and cut in every way."""

import numpy as np

from heliosweep.kernels.mounts import BLIND_CONE, NO_SUN, REACHES, TARGET_ALIGNED, TOO_NEAR
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


def test_mounts_that_cannot_aim():
    sun = np.stack(([0.0, -np.sqrt(0.5), np.sqrt(0.5)], [0.0, -0.6, -0.8]))[None]
    places = np.array([[[0.0, 100.0, 43.0], [0.0, 0.2, 143.0], [60.0, 200.0, 5.0]]])
    known = np.array([[[0.0, 0.0, 0.0, 0.0, 1e-3, 3e-3]]])
    made = spot_statistics(setting([TARGET_ALIGNED], axis_offset=0.0), errors(1, 1, 70), known, sun, places)
    np.testing.assert_array_equal(made["status"][0], [[BLIND_CONE, NO_SUN], [TOO_NEAR, NO_SUN], [REACHES, NO_SUN]])
    assert np.isnan(made["tolerance"][0, :, 1]).all()
    np.testing.assert_array_equal(made["tolerance"][0, :2, 0], 0.0)
    for name in ("hit_fraction", "real_fraction"):
        np.testing.assert_array_equal(made[name][0, :2, 0], 0.0)
        assert np.isnan(made[name][0, :, 1]).all()
    for name in MOMENTS[:5]:
        np.testing.assert_array_equal(np.isfinite(made[name][0]), [[False, False], [False, False], [True, False]])


def test_a_large_mean_costs_no_variance():
    """A spot a hundred metres off with a spread of a micrometre."""
    actual = errors(1, 1, 500, spread=1e-9)
    actual[..., 0] += 0.3
    one, known, sun, places = setting(axis_offset=0.0), np.zeros((1, 1, 6)), suns(3), pivots(1)
    made = spot_statistics(one, actual, known, sun, places)
    y = sampled(one, actual, known, sun, places)[0]
    seen = np.isfinite(y).all(axis=-1)
    assert seen.any()
    deviation = y - y[..., :1]  # exact differences
    np.testing.assert_allclose(made["variance_y"][seen], deviation.var(axis=-1, ddof=1)[seen], rtol=1e-9)


def test_percentiles_of_infinite_angles():
    quarter = 0.25 * np.pi
    angles = np.array([np.inf, quarter, np.inf, 0.0, quarter])
    made = angle_percentiles(angles, np.array([0, 12.5, 25, 50, 60, 75, 100]))
    np.testing.assert_array_equal(made, [0.0, 0.5 * quarter, quarter, quarter, np.inf, np.inf, np.inf])


def test_no_percentiles_and_no_suns():
    one, known, sun, places = setting(), np.zeros((1, 1, 6)), suns(2), pivots(1)
    assert spot_statistics(one, errors(1, 1, 3), known, sun, places, [])["tolerance"].shape == (1, 1, 2, 0, 2)
    assert spot_statistics(one, errors(1, 1, 3), known, suns(0), places)["mean_y"].shape == (1, 1, 0)

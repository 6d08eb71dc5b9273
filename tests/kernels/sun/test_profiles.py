"""Sun profiles: values of the oracle, slopes, inverses, tables."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import curve_fit

from heliosweep.families.backward_gazing.compute import formula_fit
from heliosweep.kernels.profiles import EPS_MAX, jose, noisy, normal_draws, render, smoothed, tabulated
from tests.kernels.gazing import twin
from tests.kernels.sun.curves import evaluate, invert

ANGLES = np.concatenate([np.linspace(1e-6, 1.2, 500), [0.9994, 0.9996, 0.99999, 1.00001]]) * EPS_MAX


def test_oracle():
    """First rows of backward_gazing_oracle.csv of the reference data."""
    value, slope = evaluate(jose(), [2e-3, EPS_MAX / 2])
    np.testing.assert_allclose(value, [0.9702108066, 0.963525533], rtol=1e-9)
    assert slope[0] * 1e-3 == pytest.approx(-0.0347885488, abs=1e-10)  # ten decimals are given
    assert float(invert(jose(), 0.95)) * 1e3 == pytest.approx(2.487074818, rel=1e-9)


def test_jose_is_the_formula():
    np.testing.assert_allclose(render(jose(), ANGLES), twin.jose(ANGLES), rtol=1e-14)
    np.testing.assert_allclose(render(jose(0.5, 4.6e-3, 2.0), ANGLES), twin.jose(ANGLES, 0.5, 4.6e-3, 2.0), rtol=1e-13)


def test_noise_is_keyed_by_seed_and_node():
    clean = twin.jose(np.linspace(0.0, EPS_MAX, 50))
    one, more = noisy(jose(), 0.01, 50, seed=5), noisy(jose(), 0.01, 51, seed=5)
    np.testing.assert_array_equal(one.table, noisy(jose(), 0.01, 50, seed=5).table)
    later = more.table - twin.jose(np.linspace(0.0, EPS_MAX, 51))
    np.testing.assert_allclose(later[:50], one.table - clean, atol=1e-15)
    assert np.all(noisy(jose(), 0.01, 50, seed=6).table != one.table)
    draws = normal_draws(7, 1, 100_000)
    assert abs(draws.mean()) < 0.01
    assert abs(draws.std() - 1.0) < 0.01
    assert abs(np.mean(draws**4) - 3.0) < 0.1
    assert np.all(normal_draws(7, 2, 9) != draws[:9])
    np.testing.assert_array_equal(normal_draws(7, 1, 9), draws[:9])


def test_smoothing_is_a_gaussian_over_the_continued_profile():
    table = noisy(jose(), 0.012, seed=2)
    rise = table.edge_slope * table.step
    whole = np.concatenate([table.table[:0:-1], table.table, table.table[-1] + rise * np.arange(1, 60)])
    for nodes in (6.0, 3.0, 1.5, 0.7):
        expected = gaussian_filter1d(whole, nodes, truncate=9.0)[119:239]
        np.testing.assert_allclose(smoothed(table, nodes).table, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("values", "angle", "message"),
    [
        ([1.0, 0.5], None, "3 finite"),
        ([1.0, np.nan, 0.5], None, "3 finite"),
        ([1.0, -0.1, 0.0], None, "negative"),
        ([0.5, 0.6, 0.7], None, "darker"),
        ([1.0, 0.9, 0.5], [0.0, 2e-3, 1e-3], "increase from 0"),
        ([1.0, 0.9, 0.5], [1e-3, 2e-3, 3e-3], "increase from 0"),
        ([1.0, 0.9, 0.5], [0.0, 2e-3], "equal numbers"),
    ],
)
def test_tables_that_are_none(values, angle, message):
    with pytest.raises(ValueError, match=message):
        tabulated(values, angle=angle)


@pytest.mark.parametrize(("limb", "power"), [(0.679, 2.222), (0.3, 1.5), (0.0, 2.0), (0.8, 4.0)])
def test_formula_fit_finds_what_was_planted(limb, power):
    """Also with noise, where it is as good as a search for all three parameters at once by scipy."""
    u = np.linspace(0.0, 1.0, 120)
    clean = 0.9 * (limb + (1.0 - limb) * np.sqrt(1.0 - u**power))
    assert formula_fit(clean)[:3] == pytest.approx((limb, power, 0.9), abs=1e-5)
    table = clean + 0.01 * np.random.default_rng(0).standard_normal(u.size)
    fit = formula_fit(table)
    other = curve_fit(lambda x, a, b, p: a + b * np.sqrt(1.0 - x**p), u, table, (0.6, 0.3, 2.0))[0]
    assert fit[:3] == pytest.approx(
        (other[0] / (other[0] + other[1]), other[2], other[0] + other[1]), rel=2e-3, abs=1e-3
    )
    assert fit[3] == pytest.approx(0.01, rel=0.2)

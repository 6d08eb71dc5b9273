"""Statistics and sensitivities against closed forms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from SALib.analyze import morris
from scipy import stats

from heliosweep.config.sample import Design, levels, problem
from heliosweep.grid import statistics

from .functions import G_FUNCTION, ISHIGAMI, g_function, ishigami

Function = Callable[[NDArray[np.float64]], NDArray[np.float64]]
KNOWN: list[tuple[Function, NDArray[np.float64], NDArray[np.float64]]] = [
    (lambda u: ishigami(np.pi * (2 * u - 1)), *ISHIGAMI),
    (g_function, *G_FUNCTION),
]


def _indices(function: Function, count: int, kind: str, size: int, seed: int) -> tuple[NDArray[np.float64], ...]:
    design = Design(kind, size, seed, tuple(range(count)), "sobol")
    return statistics.sobol_indices(function(design.points()), design)


@pytest.mark.parametrize("kind", ["sobol", "random"])
@pytest.mark.parametrize(("function", "first", "whole"), KNOWN, ids=["ishigami", "g_function"])
def test_indices_are_those_of_the_closed_form(
    function: Function, first: NDArray[np.float64], whole: NDArray[np.float64], kind: str
) -> None:
    found = _indices(function, len(first), kind, 2048, 3)
    assert np.all(np.abs(found[0] - first) <= 1.5 * found[1])
    assert np.all(np.abs(found[2] - whole) <= 1.5 * found[3])
    assert np.all(found[3] < 0.1)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["sobol", "random"])
@pytest.mark.parametrize(("function", "first", "whole"), KNOWN, ids=["ishigami", "g_function"])
def test_intervals_hold_the_indices_in_95_of_100_studies(
    function: Function, first: NDArray[np.float64], whole: NDArray[np.float64], kind: str
) -> None:
    held = []
    for seed in range(200):
        found = _indices(function, len(first), kind, 1024, seed)
        held += [np.abs(found[0] - first) <= found[1], np.abs(found[2] - whole) <= found[3]]
    assert 0.92 <= np.mean(held) <= 0.98


@pytest.mark.parametrize("kind", ["sobol", "random"])
def test_groups_and_keys_without_effect(kind: str) -> None:
    design = Design(kind, 256, 1, (0, 1, 0, 2), "sobol")
    u = design.points()
    first, first_half, whole, whole_half = statistics.sobol_indices(u[:, 0] * u[:, 2], design)
    np.testing.assert_allclose(first, [1, 0, 0], atol=0.2)
    np.testing.assert_array_equal(whole[1:], 0.0)
    np.testing.assert_array_equal(whole_half[1:], 0.0)
    assert first_half.shape == (3,)
    for found in statistics.sobol_indices(np.full((2, len(design)), 7.0), design):
        np.testing.assert_array_equal(found, np.zeros((2, 3)))
    missing = np.where(np.arange(len(design)) == 5, np.nan, u[:, 0])
    assert all(np.isnan(found).all() for found in statistics.sobol_indices(missing, design))


def test_elementary_effects_are_those_of_salib() -> None:
    design = Design("sobol", 50, 2, (0, 1, 2), "morris")
    u = design.points()
    values = (u[:, 0] - 0.4) ** 2 + 3 * u[:, 1] * u[:, 2]  # effects of both signs
    found = statistics.elementary_effects(np.stack([values, 2 * values]), design)
    expected = morris.analyze(problem(design), levels(design), values, num_levels=4)
    for mine, name in zip(found, ("mu", "mu_star", "sigma"), strict=True):
        np.testing.assert_allclose(mine, np.outer([1, 2], np.asarray(expected[name], float)), rtol=1e-9)


def test_elementary_effects_of_a_sum_are_its_weights() -> None:
    design = Design("sobol", 4, 2, (1, 0, 1), "morris")
    u = design.points()
    mean, magnitude, deviation = statistics.elementary_effects(5 * u[:, 1] + 0 * u[:, 0], design)
    np.testing.assert_allclose(mean, [0.75 * 5, 0])  # from the 12.5 to the 87.5 % quantile
    np.testing.assert_allclose(magnitude, [0.75 * 5, 0])
    np.testing.assert_allclose(deviation, 0, atol=1e-12)


def test_single_steps() -> None:
    design = Design("sobol", 0, 0, (0, 1), "local")
    z = stats.norm.ppf(design.points())
    down, up = statistics.single_steps(3 * z[:, 0] - z[:, 1] ** 2)
    np.testing.assert_allclose(down, [-3, -1], atol=1e-12)
    np.testing.assert_allclose(up, [3, -1], atol=1e-12)


@pytest.mark.parametrize("kind", ["sobol", "latin_hypercube", "random"])
def test_errors_of_means_tell_how_far_they_are_off(kind: str) -> None:
    off = []
    for seed in range(60):
        design = Design(kind, 128, seed, (0, 1, 2))
        u = design.points()
        mean, deviation, error = statistics.mean_of_draws(np.prod(u, axis=1) ** 2, design)
        off.append((mean - 1 / 27) / error)
        assert deviation == pytest.approx((1 / 125 - 1 / 729) ** 0.5, rel=0.5)
    # Student's t with 7 degrees of freedom for sequences has a deviation of 1.18.
    assert 0.75 < np.std(off) / {"sobol": 1.18, "random": 1.0, "latin_hypercube": 0.75}[kind] < 1.35


def test_the_deviation_of_draws_is_that_of_a_sample() -> None:
    mean, deviation, error = statistics.mean_of_draws(np.array([2.0, 4.0, 4.0, 6.0]), Design("random", 4, 0, (0,)))
    np.testing.assert_allclose([mean, deviation, error], [4, (8 / 3) ** 0.5, (8 / 3) ** 0.5 / 2], rtol=1e-14)


def test_percentiles_of_a_normal_distribution() -> None:
    design = Design("sobol", 4096, 0, (0,))
    values = stats.norm(10, 2).ppf(design.points()[:, 0])
    found = statistics.percentiles_of_draws(values, [5, 50, 95], design)
    np.testing.assert_allclose(found, stats.norm(10, 2).ppf([0.05, 0.5, 0.95]), atol=0.01)

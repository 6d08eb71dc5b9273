"""Random draws: distributed as they should be, and the same however they are cut."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from heliosweep.config.values import Distribution
from heliosweep.families.mount_errors import standard_deviates, standard_normals, standard_uniforms, widths_of

FIRST_UNIFORMS = [[0.8720734548204873, 0.29536538151378366, 0.4200976785072422]]
FIRST_NORMALS = [0.10897874404606084, -0.10851255368496111]


def test_the_first_draws_of_a_seed_never_change() -> None:
    """Numbers of this version, written down: a change of the generator is a change of every stored result."""
    assert standard_uniforms(7, 0, [0], 3).tolist() == FIRST_UNIFORMS
    assert standard_normals(7, 5, [316], 2) == pytest.approx(np.array([FIRST_NORMALS]), rel=1e-14)


def test_uniform_draws_lie_inside_and_are_symmetric() -> None:
    draws = standard_uniforms(1, 2, range(100), 2000)
    assert 0.0 < draws.min() < 1e-4
    assert 1.0 - 1e-4 < draws.max() < 1.0
    assert np.array_equal(1.0 - (1.0 - draws), draws)
    assert stats.kstest(draws.ravel(), "uniform").pvalue > 0.01


@pytest.mark.parametrize("stream", [0, 5])
def test_normal_draws_are_normal(stream: int) -> None:
    draws = standard_normals(7, stream, range(200), 1000)
    assert stats.kstest(draws.ravel(), "norm").pvalue > 0.01
    # Within heliostats, too, and not only in the mixture: uniform p-values.
    each = [stats.kstest(row, "norm").pvalue for row in draws]
    assert stats.kstest(each, "uniform").pvalue > 0.01
    moments = draws.mean(), draws.var(), stats.skew(draws, axis=None), stats.kurtosis(draws, axis=None)
    errors = np.sqrt(np.array([1.0, 2.0, 6.0, 24.0]) / draws.size)
    assert np.all(np.abs(np.array(moments) - [0.0, 1.0, 0.0, 0.0]) < 4 * errors)


def test_draws_are_independent_between_heliostats_errors_samples_and_seeds() -> None:
    samples = 20_000
    series = [standard_normals(seed, stream, range(4), samples) for seed in (0, 1) for stream in range(6)]
    stacked = np.concatenate(series)
    correlation = np.corrcoef(stacked) - np.eye(len(stacked))
    pairs = len(stacked) * (len(stacked) - 1) / 2
    limit = stats.norm.isf(0.005 / pairs) / np.sqrt(samples)
    assert np.abs(correlation).max() < limit
    lagged = np.array([np.corrcoef(row[1:], row[:-1])[0, 1] for row in stacked])
    assert np.abs(lagged).max() < stats.norm.isf(0.005 / len(stacked)) / np.sqrt(samples)
    squares = np.corrcoef(stacked**2) - np.eye(len(stacked))
    assert np.abs(squares).max() < 1.5 * limit


def test_fewer_samples_are_the_first_of_more() -> None:
    many = standard_normals(3, 1, range(5), 1000)
    assert np.array_equal(standard_normals(3, 1, range(5), 10), many[:, :10])
    for first in (1, 2, 3, 4, 517):
        assert np.array_equal(standard_normals(3, 1, range(5), 20, first), many[:, first : first + 20])


def test_draws_do_not_depend_on_the_other_heliostats() -> None:
    many = standard_normals(3, 1, range(50), 7)
    assert np.array_equal(standard_normals(3, 1, [17, 4, 49], 7), many[[17, 4, 49]])


def test_errors_of_all_kinds() -> None:
    errors = [
        Distribution("normal", (1.0, 2.0)),
        0.25,
        Distribution("uniform", (-1.0, 3.0), seed=11),
        Distribution("normal", (5.0, 0.0)),
    ]
    deviates = standard_deviates(errors, range(30), 500, seed=7)
    assert deviates.shape == (30, 500, 4)
    assert widths_of(errors).tolist() == [2.0, 0.0, 2.0, 0.0]
    assert np.array_equal(deviates[..., 0], standard_normals(7, 0, range(30), 500))
    assert np.all(deviates[..., 1] == 0.0)
    assert stats.kstest(deviates[..., 2].ravel(), "uniform", args=(-1.0, 2.0)).pvalue > 0.01
    assert np.array_equal(deviates[..., 2], 2.0 * standard_uniforms(11, 2, range(30), 500) - 1.0)

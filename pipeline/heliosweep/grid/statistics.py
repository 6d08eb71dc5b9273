"""Statistics over the draws of a study, and sensitivities of the results to its keys."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import LOCAL, MORRIS, REPLICATES, SOBOL, Design, levels
from heliosweep.lazy import scipy


def has_statistics(design: Design) -> bool:
    """Return True if the draws follow the distributions, so that their mean is meaningful."""
    return design.sensitivity not in (MORRIS, LOCAL)


def mean_of_draws(values: NDArray[np.float64], design: Design) -> tuple[NDArray[np.float64], ...]:
    """Return mean, sample standard deviation (n - 1) and standard error of the mean.

    Parameters
    ----------
    values : ndarray, shape (..., draws)
        Results of the draws. If a draw is missing (NaN), all three statistics are NaN.
    design : Design
        Design of the draws. For Sobol indices, only the first and last draw of each base point are used, because only
        these draws follow the distributions. The standard error is computed from the means of eight Sobol sequences.
        For independent draws, the standard error is the standard deviation divided by the square root of the number of
        draws. This formula overestimates the error of a Latin hypercube.
    """
    own = _independent(values, design)
    mean, deviation = own.mean(axis=-1), own.std(axis=-1, ddof=1)
    if design.kind != SOBOL:
        return mean, deviation, deviation / np.sqrt(own.shape[-1])
    means = np.stack(
        [np.ascontiguousarray(own[..., number::REPLICATES]).mean(axis=-1) for number in range(REPLICATES)], axis=-1
    )
    return mean, deviation, means.std(axis=-1, ddof=1) / np.sqrt(REPLICATES)


def percentiles_of_draws(
    values: NDArray[np.float64], percentiles: Sequence[float], design: Design
) -> NDArray[np.float64]:
    """Return linearly interpolated percentiles of the draws, shape (..., percentiles)."""
    return np.moveaxis(np.percentile(_independent(values, design), percentiles, axis=-1), 0, -1)


def _independent(values: NDArray[np.float64], design: Design) -> NDArray[np.float64]:
    """Return the draws that follow the distributions. In each half, draw k belongs to Sobol sequence k modulo 8."""
    if design.sensitivity == SOBOL:
        points = _by_point(values, design)
        values = np.concatenate([points[..., 0], points[..., -1]], axis=-1)
    return np.ascontiguousarray(values)


def _by_point(values: NDArray[np.float64], design: Design) -> NDArray[np.float64]:
    return values.reshape(*values.shape[:-1], design.size, design.rows)


def sobol_indices(values: NDArray[np.float64], design: Design) -> tuple[NDArray[np.float64], ...]:
    """Return the first-order and total Sobol indices, each followed by the half-width of its 95 % confidence interval.

    The estimators are those of SALib [1]_ [2]_. For independent draws, the confidence intervals are computed with
    SALib's bootstrap. For eight Sobol sequences, they are computed with a jackknife over the sequences and Student's t
    distribution, because a bootstrap assumes independent draws.

    Parameters
    ----------
    values : ndarray, shape (..., draws)
        Results of the draws in Saltelli's design.
    design : Design
        Design of the draws.

    Returns
    -------
    tuple of four ndarray, shape (..., parameters)
        Indices and half-widths. The values are zero if the result does not vary, and NaN if a draw is missing.

    References
    ----------
    .. [1] A. Saltelli et al., "Variance based sensitivity analysis of model output", Comput. Phys. Commun. 181 (2010),
       doi 10.1016/j.cpc.2009.09.018
    .. [2] J. Herman and W. Usher, "SALib: an open-source Python library for sensitivity analysis", J. Open Source
       Software 2 (2017), doi 10.21105/joss.00097
    """
    points = np.ascontiguousarray(np.swapaxes(_by_point(values, design), -1, -2))  # (..., rows, base points)
    every = points.reshape(*points.shape[:-2], -1)
    missing = ~np.isfinite(every).all(axis=-1)
    varies = np.ptp(_ends(points), axis=-1) > 0
    deviation = every.std(axis=-1)
    scale = np.where(varies & (deviation > 0), deviation, 1.0)
    points = (points - every.mean(axis=-1)[..., np.newaxis, np.newaxis]) / scale[..., np.newaxis, np.newaxis]
    whole = _sobol(points)
    if design.kind == SOBOL:
        replicate = np.arange(design.size) % REPLICATES
        without = np.stack([_sobol(np.compress(replicate != r, points, axis=-1)) for r in range(REPLICATES)])
        spread = np.sqrt((REPLICATES - 1) / REPLICATES * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
        half = 2.3646242510102993 * spread  # 97.5 % quantile of Student's t with 7 degrees of freedom
    else:
        again = np.random.default_rng([design.seed, 500]).integers(design.size, size=(500, design.size))
        resampled = [_sobol(np.take(points, rows, axis=-1)) for rows in again]
        half = scipy.special.ndtri(0.975) * np.std(resampled, axis=0, ddof=1)
    found = np.where(np.expand_dims(varies, -1), np.stack([whole[0], half[0], whole[1], half[1]]), 0.0)
    return tuple(np.where(np.expand_dims(missing, -1), np.nan, found))


def _ends(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the draws that follow the distributions: the first and last row of each base point."""
    return np.concatenate([points[..., 0, :], points[..., -1, :]], axis=-1)


def _sobol(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute first-order and total indices, shape (2, ..., parameters); 0 if the draws do not vary."""
    first, swapped, last = points[..., :1, :], points[..., 1:-1, :], points[..., -1:, :]
    ends = _ends(points)
    varies = np.ptp(ends, axis=-1) > np.finfo(float).eps
    variance = np.where(varies, ends.var(axis=-1), np.inf)[..., np.newaxis]
    return (
        np.stack([np.mean(last * (swapped - first), axis=-1), 0.5 * np.mean((first - swapped) ** 2, axis=-1)])
        / variance
    )


def elementary_effects(values: NDArray[np.float64], design: Design) -> tuple[NDArray[np.float64], ...]:
    """Return the mean, mean magnitude and standard deviation of each parameter's elementary effects.

    An effect is the change in the result when the keys of a parameter change from their 12.5 % to their 87.5 %
    quantile. The effect is extrapolated linearly from a step of 2/3 of this quantile range. The sign of a group is the
    sign of one of its keys.

    Parameters
    ----------
    values : ndarray, shape (..., draws)
        Results along the trajectories of Morris [1]_.
    design : Design
        Design of the draws.

    Returns
    -------
    tuple of three ndarray, shape (..., parameters)
        Statistics of the effects; NaN if a draw is missing.

    References
    ----------
    .. [1] M. D. Morris, "Factorial sampling plans for preliminary computational experiments", Technometrics 33 (1991),
       doi 10.1080/00401706.1991.10484804
    """
    places = levels(design).reshape(design.size, design.rows, -1)
    steps = np.diff(places, axis=1)  # (trajectories, steps, keys), each step changes only the keys of one parameter
    moved = np.argmax(np.abs(steps), axis=-1)  # index of one key of the parameter
    change = np.diff(_by_point(values, design), axis=-1) / np.take_along_axis(steps, moved[..., np.newaxis], -1)[..., 0]
    parameter = np.array(design.groups)[moved]
    order = np.broadcast_to(np.argsort(parameter, axis=1), change.shape)
    effects = np.ascontiguousarray(np.take_along_axis(change, order, -1).swapaxes(-1, -2))
    return effects.mean(axis=-1), np.abs(effects).mean(axis=-1), effects.std(axis=-1, ddof=1)


def single_steps(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return changes from the median result for each parameter, one standard normal deviate lower and higher."""
    changes = values[..., 1:] - values[..., :1]
    return changes[..., 0::2], changes[..., 1::2]

"""Statistics over the dates and over the directions of a tilt; NumPy functions of whole axes, dates last.

Missing days (NaN) are left out; a statistic of none is missing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Factors that differ by less are equal but for rounding: a rigid mount leans alike in phi and phi + 180 deg. [1]
TIE = 1e-12


def mean_and_deviation(values: Floats) -> Floats:
    """Mean and sample standard deviation (n - 1) along the last axis, stacked in front; NaN of fewer than 1 and 2."""
    known = np.isfinite(values)
    count = np.count_nonzero(known, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.sum(np.where(known, values, 0.0), axis=-1) / count
        squares = np.sum(np.where(known, values - mean[..., np.newaxis], 0.0) ** 2, axis=-1)
        deviation = np.sqrt(squares / np.maximum(count - 1, 0))
    return np.stack([mean, np.where(count > 1, deviation, np.nan)])


def over_dates(values: Floats) -> Floats:
    """Mean, sample standard deviation, minimum and maximum over the dates, stacked in front."""
    known = np.isfinite(values)
    some = known.any(axis=-1)
    least = np.where(some, np.where(known, values, np.inf).min(axis=-1), np.nan)
    most = np.where(some, np.where(known, values, -np.inf).max(axis=-1), np.nan)
    return np.concatenate([mean_and_deviation(values), np.stack([least, most])])


def first_least(values: Floats) -> NDArray[np.intp]:
    """Position of the least value along the last axis, the first of those that differ from it by rounding alone."""
    known = np.where(np.isfinite(values), values, np.inf)
    return np.argmax(known <= known.min(axis=-1, keepdims=True) + TIE, axis=-1)


def dates_of_extremes(values: Floats, dates: NDArray[np.datetime64]) -> NDArray[np.datetime64]:
    """Dates of the minimum and of the maximum, stacked in front; the first of several, NaT without a value.

    Parameters
    ----------
    values : ndarray, shape (..., W)
        Daily values.
    dates : ndarray of datetime64, shape (..., W)
        The dates, with as many dimensions of length 1 in front.
    """
    flat = dates.reshape(-1)
    positions = np.stack([first_least(values), first_least(-values)])
    return np.where(np.isfinite(values).any(axis=-1), flat[positions], np.datetime64("NaT", "ns"))


def over_months(values: Floats, month: NDArray[np.int64]) -> Floats:
    """Mean and sample standard deviation per month, shape (2, ..., months).

    Parameters
    ----------
    values : ndarray, shape (..., W)
        Daily values.
    month : ndarray of int, shape (..., W)
        Position of each date's month, with as many dimensions of length 1 in front.
    """
    of_date = month.reshape(-1)
    return np.stack(
        [mean_and_deviation(values[..., of_date == position]) for position in range(of_date.max() + 1)], axis=-1
    )


def worst_direction(annual_mean: Floats, direction: Floats) -> Floats:
    """Direction (last axis) of the least annual mean; the first of several, NaN without a value."""
    position = first_least(annual_mean)
    taken = np.take_along_axis(np.broadcast_to(direction, annual_mean.shape), position[..., np.newaxis], axis=-1)
    return np.where(np.isfinite(annual_mean).any(axis=-1), taken[..., 0], np.nan)[np.newaxis]

"""Statistics over the dates and over the directions of a tilt; NumPy functions of whole axes, dates last.

Missing days (NaN) are left out; a statistic of none is missing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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


def dates_of_extremes(values: Floats, dates: NDArray[np.datetime64]) -> NDArray[np.datetime64]:
    """Dates of the minimum and of the maximum, stacked in front; the first of several, NaT without a value.

    Parameters
    ----------
    values : ndarray, shape (..., W)
        Daily values.
    dates : ndarray of datetime64, shape (..., W)
        The dates, with as many dimensions of length 1 in front.
    """
    known = np.isfinite(values)
    flat = dates.reshape(-1)
    positions = np.stack([np.where(known, values, np.inf).argmin(-1), np.where(known, values, -np.inf).argmax(-1)])
    return np.where(known.any(axis=-1), flat[positions], np.datetime64("NaT", "ns"))


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
    known = np.isfinite(annual_mean)
    position = np.where(known, annual_mean, np.inf).argmin(axis=-1)
    taken = np.take_along_axis(np.broadcast_to(direction, annual_mean.shape), position[..., np.newaxis], axis=-1)
    return np.where(known.any(axis=-1), taken[..., 0], np.nan)[np.newaxis]

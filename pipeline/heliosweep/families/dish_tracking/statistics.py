"""Statistics along the last axis: over the dates, or over the directions of a tilt.

Missing values (NaN) are left out; a statistic of none is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Factors that differ by less are equal but for rounding: a rigid mount leans alike in phi and phi + 180 deg. [1]
TIE = 1e-12


def pairwise(values: Floats) -> Floats:
    """Sum along the last axis in NumPy's order for contiguous values."""
    return np.sum(np.ascontiguousarray(values), axis=-1)


def one_by_one(values: Floats) -> Floats:
    """Sum along the last axis from its first value to its last."""
    return np.cumsum(values, axis=-1)[..., -1]


def mean_and_deviation(values: Floats, total: Callable[[Floats], Floats] = pairwise) -> tuple[Floats, Floats]:
    """Mean and sample standard deviation (n - 1), summed by `total`; NaN of fewer than 1 and 2 values."""
    known = np.isfinite(values)
    count = np.count_nonzero(known, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total(np.where(known, values, 0.0)) / count
        squares = total(np.where(known, values - mean[..., np.newaxis], 0.0) ** 2)
        deviation = np.sqrt(squares / np.maximum(count - 1, 0))
    return mean, np.where(count > 1, deviation, np.nan)


def over_dates(values: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean, sample standard deviation, minimum and maximum."""
    return *mean_and_deviation(values), np.fmin.reduce(values, axis=-1), np.fmax.reduce(values, axis=-1)


def over_months(values: Floats, month: NDArray[np.int64], total: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
    """Mean and sample standard deviation of each month, along a new last axis, from the month of each value."""
    parts = [mean_and_deviation(values[..., month == number], total) for number in range(month.max() + 1)]
    mean, deviation = (np.stack(column, axis=-1) for column in zip(*parts, strict=True))
    return mean, deviation


def label_of_least(values: Floats, labels: NDArray[Any]) -> NDArray[Any]:
    """Label, a date or a direction, of the least value; the first of several, missing without a value."""
    known, missing = np.isfinite(values), labels.dtype.type("NaT" if labels.dtype.kind == "M" else "nan")
    heights = np.where(known, values, np.inf)
    first = np.argmax(heights <= heights.min(axis=-1, keepdims=True) + TIE, axis=-1)
    return np.where(known.any(axis=-1), labels[first], missing)

"""Percentiles of angles by selection, from numbers that rise with them."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel

__all__ = ["percentiles_of", "ranks_of"]

Floats = NDArray[np.float64]


def ranks_of(percentiles: ArrayLike, count: int) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Where percentiles lie among values in rising order.

    Parameters
    ----------
    percentiles : array_like, shape (Q,)
        Percentiles, 0 to 100. [%]
    count : int
        Number of values.

    Returns
    -------
    lower : ndarray of int64, shape (Q,)
        Rank of the value below each.
    part : ndarray, shape (Q,)
        How far each lies from it towards the next. [1]
    ranks : ndarray of int64
        All ranks that are needed, rising.

    Raises
    ------
    ValueError
        If a percentile is none.
    """
    wanted = np.array(percentiles, np.float64).ravel()
    if not np.all((wanted >= 0.0) & (wanted <= 100.0)):
        raise ValueError("percentiles lie between 0 and 100")
    place = wanted / 100.0 * (count - 1)
    lower = np.floor(place).astype(np.int64)
    return lower, place - lower, np.unique(np.concatenate((lower, np.minimum(lower + 1, count - 1))))


@kernel
def percentiles_of(
    keys: Floats,
    lower: NDArray[np.int64],
    part: Floats,
    ranks: NDArray[np.int64],
    bounds: NDArray[np.int64],
    angles: Floats,
) -> None:
    """Write percentiles of angles, interpolated as `numpy.percentile` does; infinite ones are values like all others.

    Parameters
    ----------
    keys : ndarray, shape (K,)
        -cot of each angle; infinity for an infinite one, -infinity for zero. They are put into another order.
    lower, part, ranks : ndarray
        From `ranks_of`.
    bounds : ndarray of int64, shape (64, 4)
        Room to work in.
    angles : ndarray, shape (Q,)
        Receives the percentiles. [rad]
    """
    last = len(keys) - 1
    # Put the middle rank into its place, then those below it and those above it, each between what stands already.
    depth = 1
    bounds[0, 0], bounds[0, 1], bounds[0, 2], bounds[0, 3] = 0, len(ranks), 0, len(keys)
    while depth > 0:
        depth -= 1
        low, high, first, stop = bounds[depth, 0], bounds[depth, 1], bounds[depth, 2], bounds[depth, 3]
        if low >= high:
            continue
        middle = (low + high) // 2
        _select(keys, first, stop, ranks[middle])
        bounds[depth, 0], bounds[depth, 1], bounds[depth, 2], bounds[depth, 3] = low, middle, first, ranks[middle]
        depth += 1
        bounds[depth, 0], bounds[depth, 1], bounds[depth, 2], bounds[depth, 3] = (
            middle + 1,
            high,
            ranks[middle] + 1,
            stop,
        )
        depth += 1
    for q in range(len(lower)):
        one, two = _angle(keys[lower[q]]), _angle(keys[min(lower[q] + 1, last)])
        # As numpy.percentile does, but for infinities.
        step = two - one
        if part[q] == 0.0 or one == two:
            angles[q] = one
        elif part[q] < 0.5:
            angles[q] = one + step * part[q]
        else:
            angles[q] = two - step * (1.0 - part[q])


@inline
def _angle(key):
    """Angle whose cotangent is -key."""
    return math.atan2(1.0, -key) if key < math.inf else math.inf


@kernel
def _select(values: Floats, first: int, stop: int, rank: int) -> None:
    """Put the value of a rank into its place, nothing greater before it and nothing less behind it."""
    while stop - first > 1:
        one, two, three = values[first], values[(first + stop) // 2], values[stop - 1]
        pivot = max(min(one, two), min(max(one, two), three))
        # No branch hangs on a value: what is less moves to the front, then what is equal.
        front = first
        for k in range(first, stop):
            value = values[k]
            values[k], values[front] = values[front], value
            front += 1 if value < pivot else 0
        if rank < front:
            stop = front
            continue
        first = front
        for k in range(first, stop):
            value = values[k]
            values[k], values[front] = values[front], value
            front += 1 if value <= pivot else 0
        if rank < front:
            return
        first = front

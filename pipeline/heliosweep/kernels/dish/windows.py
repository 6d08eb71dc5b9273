"""Windows of time packed side by side, so that many are summed at once and each in the order of time.

A window is a lane: lanes never meet, so the bits of a window's sums depend on no other window. Vectors are kept x west,
y south, z up, the frame in which the axes of a dish are described.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import kernel

LANES = 64
"""Windows side by side at most; no number depends on it."""
STRIDE = 4
"""Instants in a step: they are added to each other before a running sum is touched."""
ROWS = 6
"""Numbers kept of an instant: the unit vector to the sun, the cosine and the sine of psi, and the weight.

psi is the turn of a mount that follows the sun, from due east through south; 0 for a sun in the zenith.
"""
WEST, SOUTH, UP, COSINE, SINE, WEIGHT = range(ROWS)

Floats = NDArray[np.float64]


class Windows(NamedTuple):
    """Sun vectors of all windows, packed once for any number of parameters by `pack_windows`.

    Window w is lane w % lanes of group w // lanes. Windows with fewer instants than others of their group repeat their
    last one with weight zero.
    """

    rows: Floats
    """Rows of `pack_windows`, shape (steps, ROWS, STRIDE, lanes)."""
    first: NDArray[np.int64]
    """First step of each group and the end of the last one, shape (groups + 1,)."""
    total: Floats
    """Sum of the weights of each window, NaN where nothing counts, shape (groups, lanes)."""
    number: int
    """Number of windows; the lanes of the last group beyond it hold nothing."""


def pack_windows(sun: ArrayLike, starts: ArrayLike, weights: ArrayLike | None = None) -> Windows:
    """Pack the instants of all windows for `window_errors`.

    Parameters
    ----------
    sun : array_like, shape (T, 3)
        Unit vectors to the sun: east, north, up. [1]
    starts : array_like of int, shape (W + 1,)
        Window w holds the instants starts[w] .. starts[w + 1] - 1.
    weights : array_like, shape (T,), optional
        Weight of each instant, 1 by default; instants of weight zero do not count, whatever their vectors. [1]

    Returns
    -------
    Windows
        The vectors of the instants that count.

    Raises
    ------
    ValueError
        If the windows are no part of the instants or a weight is negative or not finite.
    """
    vectors = np.ascontiguousarray(sun, np.float64)
    bounds = np.ascontiguousarray(starts, np.int64)
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise ValueError(f"sun vectors of shape {vectors.shape}, expected (T, 3)")
    instants = len(vectors)
    factors = np.ones(instants) if weights is None else np.ascontiguousarray(weights, np.float64)
    if factors.shape != (instants,) or not np.all((factors >= 0.0) & (factors < np.inf)):
        raise ValueError("weights must be finite, not negative, and one for each instant")
    if bounds.ndim != 1 or len(bounds) == 0 or bounds[0] < 0 or bounds[-1] > instants or np.any(np.diff(bounds) < 0):
        raise ValueError(f"windows must be rising positions among {instants} instants")
    number = len(bounds) - 1
    # whole vectors of eight, but for two or three windows, where most of the vector would be empty
    lanes = max(1, number) if number < 4 else min(LANES, -(-number // 8) * 8)
    groups = -(-number // lanes)
    counted = np.concatenate(([0], np.cumsum(factors > 0.0)))[bounds]
    lengths = np.zeros(groups * lanes, np.int64)
    lengths[:number] = np.diff(counted)
    steps = -(-lengths.reshape(groups, lanes).max(axis=1, initial=0) // STRIDE)
    first = np.concatenate(([0], np.cumsum(steps)))
    rows = np.empty((first[-1], ROWS, STRIDE, lanes))
    total = np.zeros((groups, lanes))
    pack(vectors, bounds, factors, first, rows, total)
    total[total == 0.0] = np.nan
    return Windows(rows, first, total, number)


@kernel
def pack(
    sun: Floats, starts: NDArray[np.int64], weights: Floats, first: NDArray[np.int64], rows: Floats, total: Floats
) -> None:
    """Write the instants that count, window by window, and sum their weights."""
    lanes = total.shape[1]
    for w in range(total.size):
        group, lane = w // lanes, w % lanes
        step, part = first[group], 0
        t, end = (starts[w], starts[w + 1]) if w + 1 < len(starts) else (0, 0)
        x, y, z, cosine, sine = 0.0, 0.0, 1.0, 1.0, 0.0
        while step < first[group + 1]:
            weight = 0.0
            while weight == 0.0 and t < end:
                weight = weights[t]
                if weight > 0.0:
                    x, y, z = -sun[t, 0], -sun[t, 1], sun[t, 2]
                    level = math.sqrt(x * x + y * y)
                    # psi turns from east through south; a sun in the zenith leaves the mount at home, in the east
                    cosine, sine = (-x / level, y / level) if level > 0.0 else (1.0, 0.0)
                t += 1
            total[group, lane] += weight
            row = rows[step]
            row[WEST, part, lane], row[SOUTH, part, lane], row[UP, part, lane] = x, y, z
            row[COSINE, part, lane], row[SINE, part, lane], row[WEIGHT, part, lane] = cosine, sine, weight
            part += 1
            if part == STRIDE:
                step, part = step + 1, 0

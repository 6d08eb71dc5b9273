"""Heliostats that stand too close to each other: found in linear time, named by their rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.errors import Problem
from heliosweep.layouts.layout import Layout

MAX_LISTED = 20
"""Problems of one kind that are listed; the rest is counted."""

FARTHEST = 100e3
"""Distance from the tower beyond which coordinates must be map coordinates or in another unit. [m]"""

CROWD = 16
"""Heliostats of a cell with which another is compared: half of them before it in its own cell, half behind.

At most 8 that keep their distance fit in a cell, one in each octant, so that nine in a row hold a close pair.
"""


def too_close(x: ArrayLike, y: ArrayLike, z: ArrayLike, limit: ArrayLike) -> list[tuple[int, int, float]]:
    """Find the heliostats that stand closer to another one than a limit.

    Each heliostat is paired with the neighbour that comes nearest in terms of the limit, so that answer and
    time grow with the number of heliostats even if all of them coincide. With one limit for all, the list is
    empty exactly if no pair is below it. In a cube of the largest limit that holds more than 16 heliostats, a
    partner may be a near one, not the nearest; with several limits, pairs may then be missed.

    Parameters
    ----------
    x, y, z : array_like, shape (heliostat,)
        Positions, finite. [m]
    limit : float or array_like, shape (heliostat,)
        Distance between centres from which on a pair is clear; for unequal heliostats the mean of both. [m]

    Returns
    -------
    list of (int, int, float)
        Rows of each pair, the lower first, and their distance [m]; the closest pair first.
    """
    points = np.column_stack([np.asarray(axis, float) for axis in (x, y, z)])
    radius = np.broadcast_to(np.asarray(limit, float) / 2, len(points))
    cell = 2.002 * radius.max(initial=0.0)
    if len(points) < 2 or not cell > 0:
        return []
    # A cell is a little larger than the limit: rounding never parts a close pair by more than one cell.
    east_cell, north_cell, up_cell = (_compressed(np.floor(axis / cell)) for axis in points.T)
    depth, height = north_cell.max() + 2, up_cell.max() + 2
    key = (east_cell * depth + north_cell) * height + up_cell
    order = np.lexsort((*points.T[::-1], key))  # within a cell by position: near ones are near in the list
    points, key, radius = points[order], key[order], radius[order]

    count = len(key)
    position = np.arange(count)
    partner, distance, closeness = np.zeros(count, np.int64), np.zeros(count), np.ones(count)
    for east, north, up in product((-1, 0, 1), repeat=3):
        neighbour = key + (east * depth + north) * height + up
        first, end = np.searchsorted(key, neighbour), np.searchsorted(key, neighbour, side="right")
        start = np.clip(position - CROWD // 2, first, np.maximum(first, end - CROWD))
        for step in range(min(CROWD, int((end - first).max()))):
            other = start + step
            here = np.flatnonzero((other < end) & (other != position))
            other = other[here]
            apart = np.sqrt(np.sum((points[here] - points[other]) ** 2, axis=1))
            ratio = apart / (radius[here] + radius[other])
            closer = ratio < closeness[here]
            here = here[closer]
            partner[here], distance[here], closeness[here] = other[closer], apart[closer], ratio[closer]

    found = np.flatnonzero(closeness < 1)
    rows = np.sort(np.column_stack([order[found], order[partner[found]]]), axis=1)
    rows, index = np.unique(rows, axis=0, return_index=True)
    distance = distance[found][index]
    by_distance = np.argsort(distance, kind="stable")
    return [
        (low, high, apart)
        for (low, high), apart in zip(rows[by_distance].tolist(), distance[by_distance].tolist(), strict=True)
    ]


def _compressed(cell: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return cell numbers from 1 in which neighbours stay neighbours and wider gaps shrink to one cell."""
    values, inverse = np.unique(cell, return_inverse=True)
    return np.cumsum(np.minimum(np.diff(values, prepend=values[0] - 1), 2)).astype(np.int64)[inverse]


def check_layout(layout: Layout, width: ArrayLike, height: ArrayLike) -> tuple[list[Problem], list[Problem]]:
    """Check that the heliostats of a layout can stand and turn where they are.

    Parameters
    ----------
    layout : Layout
        Where the heliostats stand.
    width, height : float or array_like, shape (heliostat,)
        Sides of the mirrors; of a sweep, the largest. [m]

    Returns
    -------
    problems : list of Problem
        What makes the layout useless: no heliostats, coordinates that are not numbers or off any field, two
        heliostats on one place, centres closer than the shorter side of the mirrors.
    warnings : list of Problem
        One warning if centres are closer than the diagonal, at which mirrors may touch in some postures.
    """
    if not len(layout):
        return [Problem("the layout has no heliostats", file=layout.name)], []
    points = np.column_stack([layout.x, layout.y, layout.z])
    stray = np.flatnonzero(~(np.abs(points) <= FARTHEST).all(axis=1))
    if stray.size:
        rule = f"x, y and z must be metres from the base of the tower, at most {FARTHEST:,.0f}"
        places = (", ".join(f"{value:.6g}" for value in points[row]) for row in stray)
        return _listed(layout, stray, (f"is out of any field: {rule} (got {place})" for place in places)), []

    repeated, original = _repeated(points)
    problems = _listed(layout, repeated, (f"stands on the place of {layout.where(row)}" for row in original))

    distinct = np.delete(np.arange(len(layout)), repeated)

    def pairs_below(limit: NDArray[np.float64]) -> list[tuple[int, int, float]]:
        close = too_close(layout.x[distinct], layout.y[distinct], layout.z[distinct], limit[distinct])
        return [(int(distinct[low]), int(distinct[high]), apart) for low, high, apart in close]

    shorter = np.broadcast_to(np.minimum(width, height), len(layout))
    diagonal = np.broadcast_to(np.hypot(width, height), len(layout))
    tight = pairs_below(diagonal)
    colliding = pairs_below(shorter) if tight else []
    problems += _listed(
        layout,
        [high for _, high, _ in colliding],
        (
            f"stands {apart:.6g} m from {layout.where(low)}, less than the shorter side of the mirrors, "
            f"{(shorter[low] + shorter[high]) / 2:.6g} m: they collide"
            for low, high, apart in colliding
        ),
    )
    known = set(colliding)
    tight = [pair for pair in tight if pair not in known]
    if not tight:
        return problems, []
    low, high, apart = tight[0]
    number = "1 pair of neighbours stands" if len(tight) == 1 else f"{len(tight):,} pairs of neighbours stand"
    message = (
        f"{number} closer than the diagonal of the mirrors and may touch in some postures; the closest are "
        f"{layout.where(low)} and {layout.where(high)}, {apart:.6g} m apart, with a diagonal of "
        f"{(diagonal[low] + diagonal[high]) / 2:.6g} m"
    )
    return problems, [Problem(message, file=layout.name)]


def _repeated(points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows that equal an earlier one, in order, and the first row with the same place for each."""
    order = np.lexsort(points.T)  # stable: equal rows stay in order
    same = np.append(False, (points[order[1:]] == points[order[:-1]]).all(axis=1))
    first = np.maximum.accumulate(np.where(same, 0, np.arange(len(points))))
    repeated, original = order[same], order[first[same]]
    by_row = np.argsort(repeated)
    return repeated[by_row], original[by_row]


def _listed(layout: Layout, rows: Sequence[int] | NDArray[np.int64], messages: Iterable[str]) -> list[Problem]:
    """Return a problem for each of the first rows, and one that counts the rest."""
    problems = []
    for row, message in zip(rows[:MAX_LISTED], messages, strict=False):
        line = None if layout.lines is None else int(layout.lines[row])
        problems.append(Problem(f"heliostat {row} {message}", file=layout.name, line=line))
    if len(rows) > MAX_LISTED:
        problems.append(Problem(f"and {len(rows) - MAX_LISTED:,} more of this kind", file=layout.name))
    return problems

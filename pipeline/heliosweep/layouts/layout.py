"""The positions of the heliostats of a field, in a fixed order: read from a table, and checked before a run."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.config.tables import HEADER, Table, numbers
from heliosweep.errors import Problem, listed, printable

MAX_HELIOSTATS = 1_000_000
"""Largest layout that is read or generated: ten times the largest field imaginable, still small in memory."""

MAX_TEXT = 100
"""Longest text of a cell; an array of text takes the width of its longest for every row."""

MAX_LISTED = 20
"""Problems of one kind that are listed; the rest is counted."""

FARTHEST = 100e3
"""Distance from the tower beyond which coordinates must be map coordinates or in another unit. [m]"""

CROWD = 16
"""Heliostats of a cell with which another is compared: half of them before it in its own cell, half behind.

At most 8 that keep their distance fit in a cell, one in each octant, so that nine in a row hold a close pair.
"""

_POSITION = ("x", "y", "z")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_DIGITS = re.compile(r"[0-9+\-\s]*")
_CODE = re.compile(r"(^|,)\s*[+-]?0[0-9]")  # 007 is a name, not the number 7
_GAPS = ("", "na", "n/a", "nan", "null", "none", "inf", "infinity")  # of a column of numbers


@dataclass(frozen=True, eq=False)
class Layout:
    """Positions of the heliostats of a field.

    The order is the order of the dimension ``heliostat`` in the result. All arrays are read-only copies.

    Parameters
    ----------
    x, y, z : array_like, shape (heliostat,)
        Base of each heliostat, towards east, north and up, from the base of the tower. [m]
    columns : mapping of str to array, optional
        What else is known of each heliostat (its ring, its name): float64, int64 or str arrays that become
        coordinates of the result.
    name : str, optional
        Name of the file, as the user gave it, or of the generator.
    lines : array_like of int, shape (heliostat,), optional
        Line of each heliostat in the file, counted from 1; None for a generated layout.
    notes : tuple of str, optional
        What is known of all heliostats, lines that stand before the table where it is written as CSV.
    numbers : array_like of int, shape (heliostat,), optional
        Row of each heliostat in the layout that this is a part of; 0, 1, ... where left out.

    Raises
    ------
    ValueError
        If the arrays differ in length or are not one-dimensional.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]
    columns: Mapping[str, NDArray] = field(default_factory=dict)
    name: str = ""
    lines: NDArray[np.int64] | None = None
    notes: tuple[str, ...] = ()
    numbers: NDArray[np.int64] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Take read-only copies."""

        def frozen(key: str, values: object, dtype: type | None = None) -> NDArray:
            array = np.array(values, dtype)
            if array.shape != shape:
                raise ValueError(f"{key} has shape {array.shape}, not {shape} as x")
            array.flags.writeable = False
            return array

        shape = (np.size(self.x),)
        for axis in _POSITION:
            object.__setattr__(self, axis, frozen(axis, getattr(self, axis), np.float64))
        columns = {key: frozen(key, values) for key, values in self.columns.items()}
        object.__setattr__(self, "columns", columns)
        if self.lines is not None:
            object.__setattr__(self, "lines", frozen("lines", self.lines, np.int64))
        numbers = np.arange(shape[0]) if self.numbers is None else self.numbers
        object.__setattr__(self, "numbers", frozen("numbers", numbers, np.int64))

    def __len__(self) -> int:
        """Return the number of heliostats."""
        return self.x.size

    def where(self, row: int) -> str:
        """Return the name of a heliostat in messages: its index, counted from 0, and its line if known."""
        return f"heliostat {self.numbers[row]}" + ("" if self.lines is None else f" (line {self.lines[row]})")

    def part(self, rows: NDArray[np.int64]) -> Layout:
        """Return some heliostats as a layout of their own."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        lines = None if self.lines is None else self.lines[rows]
        return Layout(
            self.x[rows], self.y[rows], self.z[rows], columns, self.name, lines, self.notes, self.numbers[rows]
        )


def layout_of(table: Table, reserved: Collection[str] = (), unknown: str | None = None) -> Layout:
    """Return the layout that a table holds, ``x`` and ``y``, ``z`` and any others; its rows are still to be checked.

    Other columns must not have `reserved` names. Cells with the text `unknown` become NaN. Raises StudyError with
    everything that is wrong.
    """
    _check_names(table, reserved)
    table.check_rows()
    columns = {key: _column(table, key, unknown) for key in table.header}
    table.finish()
    x, y, z = columns.pop("x"), columns.pop("y"), columns.pop("z", np.zeros(len(table)))
    return Layout(x, y, z, columns, table.name, table.lines)


def _check_names(table: Table, reserved: Collection[str]) -> None:
    table.read_titles(dict.fromkeys(_POSITION, "m"))
    header = table.header
    for key, direction in (("x", "east"), ("y", "north")):
        if key not in header:
            similar = [name for name in header if name.lower().startswith((key, direction))]
            hint = f"rename {similar[0]!r}?" if similar else f"the columns are {printable(', '.join(header)[:200])}"
            table.add(f"needs a column {key}, the metres {direction} of the tower's base ({hint})", HEADER)
    table.check_header({}, others=True)
    for position, key in enumerate(header):
        if not _NAME.fullmatch(key):
            rule = "a letter, then letters, digits and underscores, as it names a variable of the result"
            table.add(f"column name {key[:40]!r} must be {rule}", HEADER, position)
        elif key in reserved and key not in _POSITION:
            table.add(f"column name {key!r} is taken by the result; choose another", HEADER, position)


def _column(table: Table, key: str, unknown: str | None) -> NDArray:
    """Return one column as int64, float64 or text, and note the rows in which it is wrong."""
    texts = table.texts(key)
    if unknown in texts and key not in _POSITION:
        known = np.array([text != unknown for text in texts])
        values = numbers([text if text != unknown else "0" for text in texts])
        table.note_bad_numbers(key, texts, values)
        return np.where(known, values, np.nan)
    values = numbers(texts)
    if key not in _POSITION:
        bad = np.flatnonzero(~np.isfinite(values))
        holds_numbers = bad.size < len(texts) and all(texts[row].lower().lstrip("+-") in _GAPS for row in bad)
        if not holds_numbers or _CODE.search(",".join(texts)):
            return _texts(table, key, texts)
        if not bad.size and _DIGITS.fullmatch("".join(texts)):
            integers = list(map(int, texts))
            # Beyond 64 bits a float would lose digits.
            return np.array(integers, np.int64) if max(map(abs, integers)) < 2**63 else _texts(table, key, texts)
    table.note_bad_numbers(key, texts, values)
    return values


def _texts(table: Table, key: str, texts: list[str]) -> NDArray:
    long = [row for row, text in enumerate(texts) if len(text) > MAX_TEXT]
    for row in long:
        table.add(f"{key} is longer than {MAX_TEXT} characters", row, key)
    return np.array([] if long else texts, str)


def too_close(x: ArrayLike, y: ArrayLike, z: ArrayLike, limit: ArrayLike) -> list[tuple[int, int, float]]:
    """Find the heliostats that stand closer to another one than a limit.

    Each heliostat is paired with the neighbour that comes nearest in terms of the limit, so that answer and time grow
    with the number of heliostats even if all of them coincide. With one limit for all, the list is empty exactly if no
    pair is below it. In a cube of the largest limit that holds more than 16 heliostats, a partner may be a near one,
    not the nearest; with several limits, pairs may then be missed.

    `x`, `y` and `z` are finite positions, shape (heliostat,) [m], and `limit` the distance between centres from which
    on a pair is clear; for unequal heliostats the mean of both [m]. Returned are the rows of each pair, the lower
    first, and their distance [m]; the closest pair first.
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
    level = up_cell.max() == 1  # nothing is above or below
    for east, north, up in product((-1, 0, 1), (-1, 0, 1), (0,) if level else (-1, 0, 1)):
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
    """Check that the heliostats of a layout can stand and turn where they are; returns problems, and warnings.

    `width` and `height` are the sides of the mirrors, shape (heliostat,) or one for all; of a sweep, the largest. [m]
    Problems make the layout useless: no heliostats, coordinates that are not numbers or off any field, two heliostats
    on one place, centres closer than the shorter side of the mirrors. There is one warning if centres are closer than
    the diagonal: below it, and only there, two mirrors that turn freely can touch, corner to corner. Postures of a
    study are not followed.
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
    longer = np.broadcast_to(np.maximum(width, height), len(layout))
    side = (longer[low] + longer[high]) / 2
    message = (
        f"{number} closer than the diagonal of the mirrors, which touch in some postures; whether this study's "
        "tracking brings them there is not checked, and numbers are computed as if mirrors could pass through each "
        f"other; the closest are {layout.where(low)} and {layout.where(high)}, {apart:.6g} m apart, with a diagonal of "
        f"{(diagonal[low] + diagonal[high]) / 2:.6g} m"
    )
    if apart < side:
        message += f" and a longer side of {side:.6g} m: with these sides in line, they overlap whatever they look at"
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
    lines = (None if layout.lines is None else int(layout.lines[row]) for row in rows)
    problems = (
        Problem(f"heliostat {row} {message}", file=layout.name, line=line)
        for row, line, message in zip(rows, lines, messages, strict=True)
    )
    return listed(problems, MAX_LISTED, len(rows), "more of this kind")

"""The positions of the heliostats of a field, in a fixed order, and how they are read from a table."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.tables import HEADER, Table, numbers

MAX_HELIOSTATS = 1_000_000
"""Largest layout that is read or generated: ten times the largest field imaginable, still small in memory."""

MAX_TEXT = 100
"""Longest text of a cell; an array of text takes the width of its longest for every row."""

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

    def __len__(self) -> int:
        """Return the number of heliostats."""
        return self.x.size

    def where(self, row: int) -> str:
        """Return the name of a heliostat in messages: its index, counted from 0, and its line if known."""
        return f"heliostat {row}" if self.lines is None else f"heliostat {row} (line {self.lines[row]})"


def layout_of(table: Table, reserved: Collection[str] = (), unknown: str | None = None) -> Layout:
    """Return the layout that a table holds: ``x`` and ``y``, ``z`` and any others.

    Parameters
    ----------
    table : Table
        Its header and its rows are still to be checked.
    reserved : collection of str
        Names that other columns must not have.
    unknown : str, optional
        What stands in a cell of which nothing is known; it becomes NaN.

    Raises
    ------
    StudyError
        With everything that is wrong.
    """
    _check_names(table, reserved)
    table.check_rows()
    columns = {key: _column(table, key, unknown) for key in table.header}
    table.finish()
    x, y, z = columns.pop("x"), columns.pop("y"), columns.pop("z", np.zeros(len(table)))
    return Layout(x, y, z, columns, table.name, table.lines)


def _check_names(table: Table, reserved: Collection[str]) -> None:
    header = table.header
    for key, direction in (("x", "east"), ("y", "north")):
        if key not in header:
            similar = [name for name in header if name.lower().startswith((key, direction))]
            hint = f"rename {similar[0]!r}?" if similar else f"the columns are {', '.join(header)[:200]}"
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

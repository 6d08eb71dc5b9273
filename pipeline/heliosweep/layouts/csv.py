"""Layouts as CSV: one heliostat a row, columns ``x``, ``y``, optional ``z``, and any others."""

from __future__ import annotations

import csv
import itertools
import os
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.tables import table_lines, table_text
from heliosweep.errors import Problem, StudyError
from heliosweep.layouts.layout import MAX_HELIOSTATS, Layout

MAX_LISTED = 20
"""Problems of one file that are listed; the rest is counted."""

MAX_TEXT = 100
"""Longest text of a field; an array of text takes the width of its longest for every row."""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_DIGITS = re.compile(r"[0-9+\-\s]*")
_PLAIN = re.compile(r"[0-9+\-.eE\s]*")  # float() also takes 1_0, nan and digits of other scripts
_CODE = re.compile(r"(^|,)\s*[+-]?0[0-9]")  # 007 is a name, not the number 7


def read_csv(path: str | Path, reserved: Collection[str] = (), name: str | None = None) -> Layout:
    """Read a layout from a CSV file.

    The first row names the columns: ``x`` and ``y``, metres east and north of the tower's base, ``z``, metres
    above it (0 if left out), and any others, which are kept as integers, numbers or text. Rows stay in order.
    Empty lines and lines that start with ``#`` are skipped. Text is UTF-8, with or without byte-order mark.
    Tables of SolarPILOT are known by their header, or by having none, and read as `solarpilot.SolarPilotReader` says.

    Parameters
    ----------
    path : str or Path
        File to read.
    reserved : collection of str, optional
        Names that other columns must not have, since the result uses them.
    name : str, optional
        Name of the file in messages and in the layout; `path` by default.

    Returns
    -------
    Layout
        The heliostats, with the line of each.

    Raises
    ------
    StudyError
        If the file cannot be read or is no such table; all bad rows at once, with file, line and column.
    """
    from heliosweep.layouts.solarpilot import SolarPilotReader, recognised

    name = str(path) if name is None else name
    text = table_text(Path(path), name)
    form = recognised(text)
    reader = Reader(name) if form is None else SolarPilotReader(name, form)
    return reader.read(text, reserved)


def write_csv(layout: Layout, path: str | Path) -> None:
    """Write a layout so that `read_csv` gives back the same numbers, to the last bit.

    The file appears under its name only when it is complete. Text that reads as a number comes back as one; numbers
    that are not known (NaN), as SolarPILOT's tables may have them, cannot be read back.

    Parameters
    ----------
    layout : Layout
        The heliostats.
    path : str or Path
        File to write; an existing one is replaced.

    Raises
    ------
    OSError
        If the file cannot be written; nothing is left behind.
    """
    columns = {"x": layout.x, "y": layout.y, "z": layout.z, **layout.columns}
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    write_rows(itertools.chain([columns], rows), path)


def write_rows(rows: Iterable[Iterable[object]], path: str | Path) -> None:
    """Write rows as CSV; the file appears under its name only when it is complete. Raises OSError."""
    path = Path(path)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with unfinished.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


class Reader:
    """Reads one file and gathers what is wrong with it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.problems: list[Problem] = []
        self.unlisted = 0

    def read(self, text: str, reserved: Collection[str]) -> Layout:
        """Return the layout that a text holds, or raise with all that is wrong."""
        self.numbers, self.lines = self._lines(text)
        header, *rows = self._rows()
        self._check_header(header, reserved)
        if not rows:
            self._add("has a header but no heliostats")
        self._finish()

        # A row with too few or too many fields must not hide what is wrong with the others.
        width = len(header)
        complete = [row for row, fields in enumerate(rows) if len(fields) == width]
        if len(complete) < len(rows):
            odd = [row for row, fields in enumerate(rows) if len(fields) != width]
            self._add_rows(odd, None, lambda row: f"has {len(rows[row])} fields, but the header has {width}")
            rows = [rows[row] for row in complete]
        columns: dict[str, NDArray] = {}
        for index, (key, values) in enumerate(zip(header, zip(*rows, strict=True), strict=bool(rows))):
            columns[key] = self._column(key, index, values, complete)
        self._finish()

        lines = np.array(self.numbers[1:])
        x, y, z = columns.pop("x"), columns.pop("y"), columns.pop("z", np.zeros(len(rows)))
        return Layout(x, y, z, columns, self.name, lines)

    def _lines(self, text: str) -> tuple[list[int], list[str]]:
        """Return the lines that hold something, after their numbers in the file."""
        numbers, lines = table_lines(text)
        if not numbers:
            self._fail("is empty: it needs a header with the columns x and y, and one row for each heliostat")
        if len(numbers) - 1 > MAX_HELIOSTATS:
            self._fail(f"has {len(numbers) - 1:,} rows, more than {MAX_HELIOSTATS:,} heliostats")
        return numbers, lines

    def _rows(self) -> list[list[str]]:
        """Split the lines into fields."""
        header = self.lines[0]
        for separator, called in ((";", "semicolons"), ("\t", "tabs")):
            if separator in header and "," not in header:
                advice = "use commas, and a point in decimal numbers"
                self._fail(f"is separated by {called}; {advice}", self.numbers[0])
        table = csv.reader(self.lines, skipinitialspace=True, strict=True)
        try:
            rows = list(table)
        except csv.Error as error:
            self._fail(f"is not CSV: {error}", self.numbers[min(table.line_num, len(self.lines)) - 1])
        if len(rows) < len(self.lines):
            quoted = next(row for row, line in enumerate(self.lines) if line.count('"') % 2)
            self._fail("opens a quoted text that does not end on this line", self.numbers[quoted])
        rows[0] = [field.strip() for field in rows[0]]
        return rows

    def _check_header(self, header: list[str], reserved: Collection[str]) -> None:
        """Check the names of the columns."""
        for key, direction in (("x", "east"), ("y", "north")):
            if key not in header:
                similar = [field for field in header if field.lower().startswith((key, direction))]
                hint = f"rename {similar[0]!r}?" if similar else f"the columns are {', '.join(header)[:200]}"
                self._add(f"needs a column {key}, the metres {direction} of the tower's base ({hint})", 0)
        for index, key in enumerate(header):
            if key in header[:index]:
                self._add(f"has two columns {key!r}", 0, index)
            elif not _NAME.fullmatch(key):
                rule = "a letter, then letters, digits and underscores, as it names a variable of the result"
                self._add(f"column name {key[:40]!r} must be {rule}", 0, index)
            elif key in reserved and key not in ("x", "y", "z"):
                self._add(f"column name {key!r} is taken by the result; choose another", 0, index)

    def _column(self, key: str, index: int, values: Sequence[str], rows: list[int]) -> NDArray:
        """Return one column as int64, float64 or text, and note the rows in which it is wrong."""
        numbers = _numbers(values)
        bad = np.flatnonzero(~np.isfinite(numbers)).tolist()
        if key not in ("x", "y", "z"):
            holds_numbers = len(bad) < len(values) and all(_is_gap(values[row]) for row in bad)
            if not holds_numbers or _CODE.search(",".join(values)):
                return self._text_column(key, index, values, rows)
            if not bad and _DIGITS.fullmatch("".join(values)):
                integers = list(map(int, values))
                if max(map(abs, integers)) >= 2**63:
                    return self._text_column(key, index, values, rows)  # a float would lose digits
                return np.array(integers, np.int64)
        positions = {rows[row]: row for row in bad}

        def wrong(row: int) -> str:
            value = values[positions[row]].strip()
            return f"{key} must be a finite number (got {value[:40]!r})" if value else f"{key} is empty"

        self._add_rows(list(positions), index, wrong)
        return numbers

    def _text_column(self, key: str, index: int, values: Sequence[str], rows: list[int]) -> NDArray:
        """Return one column as text."""
        texts = [value.strip() for value in values]
        long = [row for row, text in zip(rows, texts, strict=True) if len(text) > MAX_TEXT]
        self._add_rows(long, index, lambda row: f"{key} is longer than {MAX_TEXT} characters")
        return np.array([] if long else texts, str)

    def _add_rows(self, rows: list[int], index: int | None, message: Callable[[int], str]) -> None:
        """Note problems of rows (counted without the header) in the field `index`; the first ones in full."""
        for row in rows[:MAX_LISTED]:
            self._add(message(row), row + 1, index)
        self.unlisted += len(rows[MAX_LISTED:])

    def _add(self, message: str, line: int | None = None, index: int | None = None) -> None:
        """Note a problem, at a field of a line that holds something."""
        column = None
        if line is not None and index is not None and '"' not in self.lines[line]:
            column = 1 + sum(len(field) + 1 for field in self.lines[line].split(",")[:index])
        number = None if line is None else self.numbers[line]
        self.problems.append(Problem(message, file=self.name, line=number, column=column))

    def _finish(self) -> None:
        """Raise if there are problems."""
        if not self.problems:
            return
        in_order = sorted(self.problems, key=lambda problem: (problem.line or 0, problem.column or 0))
        unlisted = self.unlisted + len(in_order[MAX_LISTED:])
        more = [Problem(f"and {unlisted:,} more problems", file=self.name)] if unlisted else []
        raise StudyError(in_order[:MAX_LISTED] + more)

    def _fail(self, message: str, line: int | None = None) -> NoReturn:
        """Raise at once, for what leaves nothing else to check."""
        raise StudyError(Problem(message, file=self.name, line=line))


def _numbers(values: Sequence[str]) -> NDArray[np.float64]:
    """Return the numbers that the texts hold, and NaN or infinity where there is none."""
    if _PLAIN.fullmatch("".join(values)):
        try:
            return np.array(list(map(float, values)))
        except ValueError:
            pass
    return np.array([_number(value) for value in values])


def _number(text: str) -> float:
    """Return the number that a text holds, or NaN."""
    try:
        return float(text) if _PLAIN.fullmatch(text) else np.nan
    except ValueError:
        return np.nan


def _is_gap(text: str) -> bool:
    """Tell whether a text in a column of numbers stands for a missing or endless one."""
    return text.strip().lower().lstrip("+-") in ("", "na", "n/a", "nan", "null", "none", "inf", "infinity")

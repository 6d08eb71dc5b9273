"""Measured spots as CSV: one spot a row, with its heliostat, its place on the receiver and its sun or its time."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.faults import did_you_mean
from heliosweep.config.tables import table_lines, table_text
from heliosweep.errors import Problem, StudyError
from heliosweep.families.misalignment import spots_fields as fields

__all__ = ["COLUMNS", "MeasuredSpots", "read_spots"]

#: Largest file, and spots in it; problems of one file that are listed, the rest is counted. [bytes, 1, 1]
MAX_BYTES, MAX_SPOTS, MAX_LISTED = 256 * 2**20, 2_000_000, 20
#: How far the length of a sun vector may be from 1.
SUN_LENGTH = 1e-3

#: Columns of the file and what each holds.
COLUMNS = {
    "heliostat": "number of the heliostat, from 0, or its name in the layout",
    "y": "spot on the receiver plane, to the right of the aim point for someone in the field, in m",
    "z": "spot on the receiver plane, above the aim point, in m",
    "time": "ISO 8601 with offset, such as 2024-06-21T09:30:00+02:00",
    "sun_x": "unit vector to the sun, east",
    "sun_y": "unit vector to the sun, north",
    "sun_z": "unit vector to the sun, up",
    "weight": "inverse variance, in any unit; 1 where left out",
    "azimuth": "commanded angle of the primary axis, in deg; ideal where left out",
    "elevation": "commanded angle of the secondary axis, in deg; ideal where left out",
    "comment": "text that is not read",
}
_SUN = ("sun_x", "sun_y", "sun_z")

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MeasuredSpots:
    """Spots in the order of their file.

    Parameters
    ----------
    heliostat : ndarray of int64, shape (S,)
        Number of the heliostat, from 0.
    position : ndarray, shape (S, 2)
        Spots y, z on the plane of the receiver. [m]
    sun : ndarray, shape (S, 3)
        Unit vectors to the sun: east, north, up; NaN where there is a time instead. [1]
    utc : ndarray of datetime64[ns], shape (S,)
        Universal time; NaT where there is a sun instead.
    weight : ndarray, shape (S,)
        Inverse variances in any unit. [1]
    angles : ndarray, shape (S, 2)
        Commanded encoder angles; NaN where the mount is taken to aim ideally. [rad]
    lines : ndarray of int64, shape (S,)
        Line of each spot in the file, counted from 1.
    name : str
        Name of the file, as the user gave it.
    """

    heliostat: NDArray[np.int64]
    position: Floats
    sun: Floats
    utc: NDArray[np.datetime64]
    weight: Floats
    angles: Floats
    lines: NDArray[np.int64]
    name: str = ""

    def __len__(self) -> int:
        """Return the number of spots."""
        return self.heliostat.size

    @property
    def timed(self) -> bool:
        """Whether the spots have times, from which the sun is still to be found."""
        return len(self) > 0 and bool(np.isnan(self.sun[0, 0]))

    def under(self, sun: Floats) -> MeasuredSpots:
        """The spots with the sun of their times.

        Parameters
        ----------
        sun : ndarray, shape (S, 3)
            Unit vectors to the sun. [1]

        Raises
        ------
        StudyError
            Where a spot was taken with the sun at or below the horizon.
        """
        low = np.flatnonzero(~(sun[:, 2] > 0))
        if low.size:
            problems = [
                Problem(_below(sun[row]) + "; are the time, its offset and the site right?", "", self.name, line)
                for row, line in zip(low[:MAX_LISTED], self.lines[low].tolist(), strict=False)
            ]
            more = [Problem(f"and {low.size - MAX_LISTED:,} more problems", file=self.name)]
            raise StudyError(problems + (more if low.size > MAX_LISTED else []))
        return replace(self, sun=np.array(sun, np.float64))


def read_spots(path: str | Path, heliostats: int, names: Sequence[str] = (), name: str | None = None) -> MeasuredSpots:
    """Read measured spots from a CSV file.

    The first row names the columns, those of `COLUMNS`: ``heliostat``, ``y`` and ``z``; ``time`` or all of ``sun_x``,
    ``sun_y`` and ``sun_z``; ``weight``, ``azimuth`` with ``elevation``, and ``comment`` may be left out. Empty lines
    and lines that start with ``#`` are skipped. Text is UTF-8, with or without byte-order mark.

    Parameters
    ----------
    path : str or Path
        File to read.
    heliostats : int
        Heliostats that there are.
    names : sequence of str, optional
        Their names, where they have some.
    name : str, optional
        Name of the file in messages; `path` by default.

    Returns
    -------
    MeasuredSpots

    Raises
    ------
    StudyError
        If the file cannot be read or is no such table; all bad rows at once, with file, line and column.
    """
    return _Reader(str(path) if name is None else name, heliostats, names).read(Path(path))


def _below(sun: Floats) -> str:
    elevation = np.degrees(np.arcsin(np.clip(sun[2], -1.0, 1.0)))
    return f"the sun is not above the horizon (elevation {elevation:.2f} deg)"


class _Reader:
    """Reads one file and gathers what is wrong with it."""

    def __init__(self, name: str, heliostats: int, names: Sequence[str]) -> None:
        self.name, self.heliostats = name, heliostats
        self.numbers = {text: number for number, text in reversed(list(enumerate(names)))}
        self.shared = {text for number, text in enumerate(names) if self.numbers[text] != number}
        self.problems: list[Problem] = []
        self.unlisted, self.added = 0, Counter[int | None]()

    def read(self, path: Path) -> MeasuredSpots:
        """Return the spots, or raise with all that is wrong."""
        self.lines, self.texts = self._lines(table_text(path, self.name, MAX_BYTES))
        header, *rows = self._rows()
        self._check_header(header)
        if not rows:
            self._add("has a header but no spots: give one row for each")
        self._finish()
        width = len(header)
        self.kept = [row for row, entries in enumerate(rows) if len(entries) == width]
        for row, entries in enumerate(rows):
            if len(entries) != width:
                self._add(f"has {len(entries)} fields, but the header has {width}", row + 1)
        columns = dict(zip(header, zip(*(rows[row] for row in self.kept), strict=True), strict=False))
        self.header, count = header, len(self.kept)
        heliostat = self._read(columns, "heliostat", self._heliostat, np.int64)
        place = np.stack([self._read(columns, key, fields.place) for key in ("y", "z")], axis=1)
        sun, utc = np.full((count, 3), np.nan), np.full(count, np.datetime64("NaT", "ns"))
        if "time" in header:
            utc = self._read(columns, "time", fields.time, np.dtype("datetime64[ns]"))
        else:
            sun = self._sun(np.stack([self._read(columns, key, fields.finite) for key in _SUN], axis=1))
        weight, angles = np.ones(count), np.full((count, 2), np.nan)
        if "weight" in header:
            weight = self._read(columns, "weight", fields.weight)
        if "azimuth" in header:
            angles = np.stack([self._read(columns, key, fields.angle) for key in ("azimuth", "elevation")], axis=1)
        self._finish()
        lines = np.array([self.lines[row + 1] for row in self.kept], np.int64)
        return MeasuredSpots(heliostat, place, sun, utc, weight, np.radians(angles), lines, self.name)

    def _lines(self, text: str) -> tuple[list[int], list[str]]:
        """Return the numbers in the file of the lines that hold something, and these lines."""
        numbers, lines = table_lines(text)
        if not numbers:
            self._fail("is empty: it needs a header, such as heliostat,y,z,time, and one row for each spot")
        if len(numbers) - 1 > MAX_SPOTS:
            self._fail(f"has {len(numbers) - 1:,} rows, more than {MAX_SPOTS:,} spots")
        return numbers, lines

    def _rows(self) -> list[list[str]]:
        """Split the lines into fields."""
        for separator, called in ((";", "semicolons"), ("\t", "tabs")):
            if separator in self.texts[0] and "," not in self.texts[0]:
                advice = "use commas, and a point in decimal numbers"
                self._fail(f"is separated by {called}; {advice}", self.lines[0])
        table = csv.reader(self.texts, skipinitialspace=True, strict=True)
        try:
            rows = list(table)
        except csv.Error as error:
            # A quoted text that does not end swallows all lines to the last: the line that opens it is the wrong one.
            odd = [line for line, text in zip(self.lines, self.texts, strict=True) if text.count('"') % 2]
            if odd and table.line_num >= len(self.texts):
                self._fail("opens a quoted text that does not end on this line", odd[0])
            self._fail(f"is not CSV: {error}", self.lines[min(table.line_num, len(self.texts)) - 1])
        if len(rows) < len(self.texts):
            quoted = next(row for row, line in enumerate(self.texts) if line.count('"') % 2)
            self._fail("opens a quoted text that does not end on this line", self.lines[quoted])
        rows[0] = [field.strip() for field in rows[0]]
        return rows

    def _check_header(self, header: list[str]) -> None:
        """Check the names of the columns, and that they belong together."""
        for index, key in enumerate(header):
            if key in header[:index]:
                self._add(f"has two columns {key!r}; remove one", 0, index)
            elif key not in COLUMNS:
                hint = did_you_mean(key, COLUMNS) or f"; remove it: the columns are {', '.join(COLUMNS)}"
                self._add(f"unknown column {key[:40]!r}{hint}", 0, index)
        for key in ("heliostat", "y", "z"):
            if key not in header:
                self._add(f"needs a column {key}: {COLUMNS[key]}", 0)
        sun = [key for key in _SUN if key in header]
        if "time" in header and sun:
            self._add(f"has both time and {sun[0]}; remove one: they could contradict each other", 0)
        elif "time" not in header and len(sun) < 3:
            missing = ", ".join(key for key in _SUN if key not in header)
            which = f"the columns {missing} beside {', '.join(sun)}" if sun else "a column time, or sun_x, sun_y, sun_z"
            self._add(f"needs {which}: the sun that made the spot", 0)
        pair = [key for key in ("azimuth", "elevation") if key in header]
        if len(pair) == 1:
            other = "elevation" if pair == ["azimuth"] else "azimuth"
            self._add(f"needs a column {other} beside {pair[0]}, or neither: the angles commanded", 0)

    def _read(
        self, columns: dict[str, tuple[str, ...]], key: str, one: Callable[[str], object], dtype: object = np.float64
    ) -> NDArray:
        """Return one column, and note the rows in which it is wrong."""
        index, values = self.header.index(key), []
        for row, text in zip(self.kept, columns.get(key, ()), strict=True):
            try:
                if not text.strip():
                    raise ValueError("is empty")
                values.append(one(text))
            except ValueError as error:
                self._add(f"{key} {error}", row + 1, index)
                values.append(_GAPS[dtype is np.int64, key == "time"])
        return np.array(values, dtype)  # type: ignore[call-overload]

    def _heliostat(self, text: str) -> int:
        """Number of a heliostat; a name counts before a number."""
        given = text.strip()
        if given in self.shared:
            raise ValueError(f"{given!r} is the name of several heliostats; give its number, from 0")
        if given in self.numbers:
            return self.numbers[given]
        if fields.WHOLE.fullmatch(text) and int(text) < self.heliostats:
            return int(text)
        known = did_you_mean(given, self.numbers) or (
            f"; they are numbered from 0 to {self.heliostats - 1}"
            + (", or named as in the layout" * bool(self.numbers))
        )
        raise ValueError(f"is unknown{known} (got {given[:40]!r})")

    def _sun(self, sun: Floats) -> Floats:
        """Sun vectors at length 1; notes those that are not, or point below the horizon."""
        length = np.sqrt(np.sum(sun**2, axis=1))
        index = self.header.index("sun_x")
        for position, row in enumerate(self.kept):
            if abs(length[position] - 1.0) > SUN_LENGTH:
                what = f"the sun vector has the length {length[position]:.6g}"
                self._add(f"{what}, which must be 1 to within {SUN_LENGTH:g}: divide it by its length", row + 1, index)
            elif not np.isnan(length[position]) and sun[position, 2] <= 0:
                self._add(_below(sun[position]) + "; sun_z is positive up", row + 1, self.header.index("sun_z"))
        with np.errstate(invalid="ignore", divide="ignore"):
            return sun / length[:, np.newaxis]

    def _add(self, message: str, line: int | None = None, index: int | None = None) -> None:
        """Note a problem, at a field of a line that holds something."""
        # Of every column the first ones: the first ones of the file are among them.
        self.added[index] += 1
        if self.added[index] > MAX_LISTED:
            self.unlisted += 1
            return
        column = None
        if line is not None and index is not None and '"' not in self.texts[line]:
            column = 1 + sum(len(field) + 1 for field in self.texts[line].split(",")[:index])
        number = None if line is None else self.lines[line]
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


#: What stands for a field that is wrong, by whether it is whole and whether it is a time.
_GAPS = {(False, False): np.nan, (True, False): -1, (False, True): np.datetime64("NaT", "ns")}

"""Read the columns of CSV tables as arrays, and report problems with line and column numbers.

A table is a text file in UTF-8 or, with a byte-order mark, in UTF-16. The first row is a header. Cells are separated by
commas, semicolons or tabs. If the separator is not a comma, numbers may have decimal commas. Empty lines and comments
are skipped. Ambiguous numbers and dates are rejected. Columns are declared as in this example::

    COLUMNS = {"angle": Column("angle from the disc centre, in mrad", required=True), ...}
    table = read_table(path, name, COLUMNS, rows="angles")
    angle = table.column("angle")
    table.finish()
"""

from __future__ import annotations

import csv
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.faults import did_you_mean, nearest
from heliosweep.config.source import text_of
from heliosweep.config.values import UNITS
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.files import read_once

_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+([eE][-+]?[0-9]+)?")
_CELL = re.compile(
    r"(\d+)([-/.])(\d+)\2(\d+)(?:[ T]+(\d{1,2}):(\d\d)(?::(\d\d)(?:\.\d*)?)?(?: *([AP])\.?M\.?)?)?"
    r" *(Z|UTC|[+-]\d\d:?\d\d)?",
    re.I,
)


def separator_of(header: str) -> str:
    """Return the first separator of comma, semicolon and tab that occurs in a header (default: comma)."""
    outside = re.sub(r'"[^"]*"|\([^)]*\)|\[[^\]]*\]', "", header)
    return next((mark for mark in (",", ";", "\t") if mark in outside), ",")


def with_points(rows: Sequence[list[str]], separator: str) -> tuple[Sequence[list[str]], tuple[int, str] | None]:
    """Replace decimal commas with decimal points, and return a problem if numbers are ambiguous.

    Parameters
    ----------
    rows : sequence of list of str
        Cells of each row, without the header.
    separator : str
        Cell separator. If it is a comma, numbers cannot have decimal commas.

    Returns
    -------
    rows : sequence of list of str
        Rows in which numbers have decimal points.
    problem : tuple of int and str, or None
        Index of the row with an ambiguous number, and a message; None if no number is ambiguous.
    """
    cells = [(at, cell.strip()) for at, row in enumerate(rows) for cell in row] if separator != "," else []
    commas = [place for place in cells if "," in place[1] and _COMMA.fullmatch(place[1])]
    if not commas:
        return rows, None
    at, cell = commas[0]
    pointed = (place for place in cells if re.fullmatch(r"[-+]?[0-9]*\.[0-9]+([eE][-+]?[0-9]+)?", place[1]))
    if point := next(pointed, None):
        return rows, (point[0], f"has decimal points ({point[1]}) and decimal commas ({cell}): use one of them")
    if separator == "\t" and all(re.fullmatch(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}", text) for _, text in commas):
        both = f"{cell.replace(',', '.')} or {cell.replace(',', '')}"
        return rows, (at, f"{cell} may be {both}; use decimal points")
    return [[text.replace(",", ".") if _COMMA.fullmatch(text.strip()) else text for text in row] for row in rows], None


def split_title(title: str) -> tuple[str, str]:
    """Split a title such as ``X Position (m)`` or ``x [m]`` into a name and the text in brackets."""
    found = re.fullmatch(r"(.*\S)\s*[(\[]([^()\[\]]+)[)\]]+\s*", title)
    return (found.group(1), found.group(2).strip()) if found else (title, "")


def variable_name(title: str) -> str:
    """Convert a title to a variable name that consists of lower-case letters, digits and underscores."""
    plain = unicodedata.normalize("NFKD", title.lower()).encode("ascii", "ignore").decode() or title
    return re.sub(r"[^a-z0-9]+", "_", plain).strip("_")


def iso_dates(texts: Sequence[str], form: str = "") -> list[str]:
    """Convert the times of a column to ISO 8601. Other strings are not changed.

    Parameters
    ----------
    texts : sequence of str
        Cells such as ``21/06/2024 9:30``, ``6/21/2024 9:30 PM`` or ``20240621:0930``.
    form : str, optional
        Format specified in the title of the column, such as ``DD/MM/YYYY hh:mm, +01:00``.

    Returns
    -------
    list of str
        Times in the form ``2024-06-21T09:30``. The order of day and month is determined from the title, from dots as in
        ``21.06.2024``, or from a day greater than 12. If the order is unknown, the dates are not changed.
    """
    matches, offset = [_CELL.fullmatch(text.strip()) for text in texts], ""
    order = _order([match for match in matches if match])
    stated = re.fullmatch(
        r"([DMY])\1*([-/.])([DMY])\3*\2([DMY])\4*(?:[ T]+HH:MM(?::SS)?)?(?:,? *(Z|UTC|[+-]\d\d:\d\d))?", form, re.I
    )
    if stated and len({letter.lower() for letter in stated.group(1, 3, 4)}) == 3:
        order, offset = "".join(stated.group(1, 3, 4)).lower(), stated[5] or ""
    compact = re.compile(r"(\d{4})(\d\d)(\d\d)[:T ]?(\d\d)(\d\d)?(\d\d)?")

    def expanded(found: re.Match[str]) -> str:
        year, month, day, hour, minute, second = found.groups()
        return f"{year}-{month}-{day}T{hour}:{minute or '00'}{':' * bool(second)}{second or ''}"

    return [
        _iso(text, cell, order, offset) if cell else compact.sub(expanded, text.strip())
        for text, cell in zip(texts, matches, strict=True)
    ]


def _order(cells: Sequence[re.Match[str]]) -> str:
    """Return the order of year, month and day, such as ``dmy``; empty if unknown."""
    if cells and len(cells[0][1]) == 4:
        return "ymd"
    late = [any(int(cell[part]) > 12 for cell in cells) for part in (1, 3)]
    return "dmy" if late == [True, False] or all(cell[2] == "." for cell in cells) else "mdy" * late[1]


def _iso(text: str, cell: re.Match[str], order: str, offset: str) -> str:
    parts = dict(zip(order or "ymd" * (len(cell[1]) == 4), cell.group(1, 3, 4), strict=False))
    if len(parts.get("y", "")) != 4:
        return text
    hour, minute, second, half, own = cell.group(5, 6, 7, 8, 9)
    hours = int(hour or 0) % 12 + 12 * (half.upper() == "P") if half else int(hour or 0)
    zone = (own or offset).upper().replace("UTC", "Z")
    return f"{parts['y']}-{parts['m']:0>2}-{parts['d']:0>2}T{hours:02}:{minute or '00'}:{second or '00'}{zone}"


def hint(text: str) -> str:
    """Return the remedy for an ambiguous date, or an empty string for any other text."""
    found, year = _CELL.fullmatch(text.strip()), "; write the year with four digits"
    order = "; specify the order in the column title, such as time (DD/MM/YYYY hh:mm)"
    return "" if not found or len(found[1]) == 4 else order if len(found[4]) == 4 else year


#: Maximum number of problems listed for a table. Further problems are only counted.
MAX_LISTED = 20
#: Row index of the header in problems.
HEADER = -1


@dataclass(frozen=True)
class Column:
    """Declaration of a table column, which contains numbers or cells that `read` converts.

    Parameters
    ----------
    meaning : str
        Meaning of the column, with the unit.
    required : bool
        True if every table must contain the column.
    least, most : float
        Bounds of numbers.
    bounds : str
        Bounds in words, used at the end of a message: ``between -1e6 and 1e6 m``.
    read : callable, optional
        Function that converts each cell of a column that does not contain numbers. For an invalid cell, the function
        raises a ValueError whose text is the end of a message.
    dtype, missing : object
        Type of the array, and value that replaces invalid cells.
    names : tuple of str
        Alternative titles of the column, in the form that `variable_name` returns.
    units : tuple of str
        Other units that are allowed in a title. `Table.units` contains the unit that the file uses.
    scale, offset : float
        Scale factor for the numbers in the file, and offset added to the scaled numbers.
    """

    meaning: str
    required: bool = False
    least: float = -np.inf
    most: float = np.inf
    bounds: str = ""
    read: Callable[[str], Any] | None = None
    dtype: Any = float
    missing: Any = np.nan
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    scale: float = 1.0
    offset: float = 0.0


class Table:
    """Rows of a table, and the problems found in them.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    lines : tuple of list
        Line numbers (counted from 1) and texts of all lines that are neither empty nor comments. The first of these
        lines is the header.
    rows, needs : str
        Words for messages: a noun for the rows, and the required contents of the file.
    most_rows : int, optional
        Maximum number of rows.
    separator : str, optional
        Cell separator (default: the separator in the header).
    most_listed : int
        Maximum number of problems listed for each column or, if the maximum is 1, for each cause.

    Raises
    ------
    StudyError
        If the text cannot be split into rows and cells.
    """

    def __init__(
        self,
        name: str,
        lines: tuple[list[int], list[str]],
        *,
        rows: str = "rows",
        most_rows: int | None = None,
        needs: str = "a header and rows",
        separator: str = "",
        most_listed: int = MAX_LISTED,
    ) -> None:
        self.name, self._what, self._most = name, rows, most_listed
        self._numbers, self._texts = lines
        # the first line may specify the separator for Excel
        told = re.fullmatch(r' *"?sep=([;,\t])"?[;,\t]* *', next(iter(self._texts), ""))
        if told:
            self._numbers, self._texts = self._numbers[1:], self._texts[1:]
        self._separator = separator or (told[1] if told else separator_of(next(iter(self._texts), "")))
        self._problems: list[tuple[str, Problem]] = []
        self._found = Counter[str]()
        self.forms: dict[str, str] = {}
        self.units: dict[str, str] = {}
        self._columns: Mapping[str, Column] = {}
        self.require(self._numbers, f"is empty: it needs {needs}")
        count, most = len(self._numbers) - 1, math.inf if most_rows is None else most_rows
        self.require(count <= most, f"has {count:,} rows, more than {most:,} {rows}")
        header, *given = self._split()
        self._rows, problem = with_points(given, self._separator)
        row, message = problem or (HEADER, "")
        self.require(not problem, message, self._numbers[row + 1])
        self.header = [cell.strip() for cell in header]
        width = max((at for at, title in enumerate(self.header, 1) if title), default=0)
        if not any(cell.strip() for row in self._rows for cell in row[width:]):  # remove empty columns at the end
            self.header, self._rows = self.header[:width], [row[:width] for row in self._rows]
        self._kept = list(range(len(self._rows)))

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def lines(self) -> NDArray[np.int64]:
        """Line number of each row in the file, counted from 1."""
        return np.array([self._numbers[row + 1] for row in self._kept], np.int64)

    def check_header(self, columns: Mapping[str, Column], *, others: bool = False) -> None:
        """Compare the titles with the declared `columns`, and record problems. `others` allows undeclared columns."""
        self._columns = columns
        self._rename_titles(columns)
        meant: set[str | None] = set()  # columns with misspelt titles are not recorded as missing
        for position, key in enumerate(self.header):
            if key in self.header[:position] and (key in columns or not (others and columns)):
                self.add(f"has two columns {key!r}; remove one", HEADER, position)
            elif key not in columns and not others:
                meant.add(nearest(key, columns))
                hint = did_you_mean(key, columns) or f": remove it, because the columns are {', '.join(columns)}"
                self.add(f"unknown column {key[:40]!r}{hint}", HEADER, position)
        for key, column in columns.items():
            if column.required and key not in self.header and key not in meant:
                self.add(f"needs a column {key}: {column.meaning}", HEADER)

    def unused(self) -> list[str]:
        """Return the titles of the undeclared columns."""
        return [title or f"column {at}" for at, title in enumerate(self.header, 1) if title not in self._columns]

    def _rename_titles(self, columns: Mapping[str, Column]) -> None:
        """Convert titles with capitals, spaces, synonyms or units (``X (m)``) to column names; record wrong units."""
        named = {name: key for key, column in columns.items() for name in column.names}
        known = {key: key for key in columns} | named
        for position, title in enumerate(self.header):
            (name, said), whole = split_title(title), variable_name(title)
            key = known.get(whole) or known.get(variable_name(name), "")
            if title in columns or not key or key in self.header:
                continue
            stated = re.findall(r"\bin ([^\s,;]+)|\[([^\[\]]+)\]$", columns[key].meaning)
            wanted = next((unit for found in reversed(stated) for unit in found if unit in UNITS), "")
            # convert W/m^2, W m-2 and W/m² to W/m2
            unit = re.sub(r"[\s^*.]", "", said if wanted and whole not in named else "").replace("\u00b2", "2")
            unit = unit.replace("m-2", "/m2").replace("//", "/")
            if unit in ("", wanted, *columns[key].units):
                self.header[position], self.forms[key], self.units[key] = key, said, unit
            elif columns[key].required:
                self.header[position] = key
                self.add(f"is in {said!r}; {key} must be in {wanted}", HEADER, position)

    def check_rows(self) -> None:
        """Raise the problems found so far, then record and drop each row with more or fewer cells than the header."""
        if not self._rows:
            self.add(f"has a header but no {self._what}: add one row for each")
        self.finish()
        width = len(self.header)
        for row, cells in enumerate(self._rows):
            if len(cells) != width:
                remedy = ": write decimal points, and quotes around texts with separators" * (len(cells) > width)
                self.add(f"has {len(cells)} fields, but the header has {width}{remedy}", row)
        self._kept = [row for row, cells in enumerate(self._rows) if len(cells) == width]

    def texts(self, key: str) -> list[str]:
        """Return the cells of a column as text without surrounding whitespace."""
        position = self.header.index(key)
        return [self._rows[row][position].strip() for row in self._kept]

    def column(self, key: str) -> NDArray[Any]:
        """Return the values of a column as declared, and record invalid cells."""
        column, texts = self._columns[key], self.texts(key)
        if column.read is None:
            values = numbers(texts) * column.scale + column.offset
            self.note_bad_numbers(key, texts, values)
            for row in np.flatnonzero((values < column.least) | (values > column.most)).tolist():
                if np.isfinite(values[row]):
                    self.add(f"{key} must be {column.bounds} (got {texts[row][:40]!r})", row, key)
            return values
        found = []
        for row, (text, time) in enumerate(zip(texts, iso_dates(texts, self.forms.get(key, "")), strict=True)):
            try:
                if not text:
                    raise ValueError("is empty")
                found.append(column.read(time))
            except ValueError as error:
                self.add(f"{key} {error}{hint(text) if time == text else ''}", row, key)
                found.append(column.missing)
        return np.array(found, column.dtype)

    def note_bad_numbers(self, key: str, texts: Sequence[str], values: NDArray[np.float64]) -> None:
        """Record the cells of a column that are not finite numbers."""
        for row in np.flatnonzero(~np.isfinite(values)).tolist():
            text = texts[row]
            self.add(f"{key} must be a finite number (got {text[:40]!r})" if text else f"{key} is empty", row, key)

    def add(self, message: str, row: int | None = None, column: str | int | None = None, key: str = "") -> None:
        """Record a problem with the table, a row or a cell.

        `message` follows the position of the problem and, if given, `key`. `row` is an index counted from 0, or
        `HEADER` for the header. `column` is the name or the index of a column.
        """
        cause = self.header[column] if isinstance(column, int) else column or key
        if self._most == 1:
            cause = re.sub(r" \(got .*?\)|[\d,.]+", "", message)  # remove numbers, because they differ between rows
        self._found[cause] += 1
        if self._found[cause] > self._most:
            return
        line = place = None
        if row is not None:
            at = 0 if row == HEADER else self._kept[row] + 1
            line, text = self._numbers[at], self._texts[at]
            if column is not None and '"' not in text:
                before = column if isinstance(column, int) else self.header.index(column)
                place = 1 + sum(len(cell) + 1 for cell in text.split(self._separator)[:before])
        self._problems.append((cause, Problem(message, key, self.name, line, place)))

    def finish(self) -> None:
        """Raise a StudyError if there are problems. The error lists the first problems and counts the others."""
        if self._problems and self._most == 1:
            counts = [self._found[cause] - 1 for cause, _ in self._problems]
            more = (f", and also in {count:,} more rows" * (count > 0) for count in counts)
            found = (problem for _, problem in self._problems)
            raise StudyError(replace(one, message=one.message + rest) for one, rest in zip(found, more, strict=True))
        if self._problems:
            in_order = sorted((one for _, one in self._problems), key=lambda one: (one.line or 0, one.column or 0))
            raise StudyError(listed(in_order, MAX_LISTED, self._found.total()))

    def _split(self) -> list[list[str]]:
        reader = csv.reader(self._texts, delimiter=self._separator, skipinitialspace=True, strict=True)
        rows, message = list[list[str]](), ""
        try:
            rows.extend(reader)
        except csv.Error as error:
            message = f"is not CSV: {error}".replace("\t", "\\t")
        if len(rows) < len(self._texts) and (not message or reader.line_num >= len(self._texts)):
            # An unterminated quoted cell includes the following lines. The problem is reported at its first line.
            odd = (line for line, text in zip(self._numbers, self._texts, strict=True) if text.count('"') % 2)
            first = next(odd, None)
            self.require(first is None, "contains a quoted cell that does not end on this line", first)
        self.require(not message, message, self._numbers[reader.line_num - 1])
        return rows

    def require(self, holds: object, message: str, line: int | None = None) -> None:
        """Raise a StudyError for the file, or for one of its lines, unless `holds` is true."""
        if not holds:
            raise StudyError(Problem(message, file=self.name, line=line))


def read_table(
    path: Path,
    name: str,
    columns: Mapping[str, Column],
    *,
    others: bool = False,
    most_bytes: int = 64 * 2**20,
    rows: str = "rows",
    most_rows: int | None = None,
    needs: str = "a header and rows",
    also: Callable[[Table], None] | None = None,
    titles: Mapping[str, str] | None = None,
) -> Table:
    """Read a table and check its header and rows. Cells are read later, column by column.

    Parameters
    ----------
    path, name : Path, str
        Path of the file, and its name in messages.
    columns : mapping of str to Column
        Declared columns. `others` allows undeclared columns.
    most_bytes : int, optional
        Maximum size of the file. [bytes]
    rows, most_rows, needs
        Words for messages and maximum number of rows, as in `Table`.
    also : callable, optional
        Function that records further problems with the header.
    titles : mapping of str to str, optional
        Titles in the file, by name of the declared column. The titles of other columns may equal declared names.

    Raises
    ------
    StudyError
        If the file cannot be read, or if its header or rows are invalid.
    """
    lines = table_lines(text_of(path, name, most_bytes))
    table = Table(name, lines, rows=rows, most_rows=most_rows, needs=needs)
    if titles:
        given = {variable_name(title): key for key, title in titles.items()}
        named = [given.get(variable_name(split_title(title)[0])) for title in table.header]
        table.header = [
            key or (f"{title} of the file" if title in titles else title)
            for key, title in zip(named, table.header, strict=True)
        ]
    table.check_header(columns, others=others)
    if also is not None:
        also(table)
    table.check_rows()
    return table


def table_lines(text: str) -> tuple[list[int], list[str]]:
    """Return the numbers and the texts of the lines that are neither empty nor comments (``#``)."""
    every = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    numbers = [number for number, line in enumerate(every, 1) if (said := line.lstrip()) and said[0] != "#"]
    return numbers, [every[number - 1] for number in numbers]


def numbers(texts: Sequence[str]) -> NDArray[np.float64]:
    """Convert strings to numbers. Non-numeric strings become NaN, and numbers that overflow become infinite."""
    form = re.compile(r"\s*[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?\s*")
    return np.array([float(text) if form.fullmatch(text) else np.nan for text in texts], float)


_COLUMNS = {
    "angle": Column("angle from the sun's centre, starting at 0, in mrad", required=True, least=0, most=100,
                    bounds="between 0 and 100 mrad"),
    "brightness": Column("brightness at the angle, in any unit", required=True, least=0, bounds="at least 0"),
}  # fmt: skip


class SunProfile(NamedTuple):
    """Radial brightness profile of the sun, read from a file."""

    #: Angles from the disc centre, increasing from 0. [rad]
    angle: tuple[float, ...]
    #: Brightness at these angles, in any unit.
    brightness: tuple[float, ...]

    def note(self, name: str) -> str:
        """Return a warning if the brightness increases with the angle, otherwise an empty string."""
        rises = np.count_nonzero(np.diff(self.brightness) > 0.0)
        steps = f"{rises} of {len(self.angle) - 1} steps from the centre to the edge"
        return f"{name}: the brightness rises in {steps}, which may be noise" if rises else ""


@read_once(4)
def read_profile(path: Path, name: str) -> SunProfile:
    """Read a sun profile.

    Parameters
    ----------
    path : pathlib.Path
        CSV table with the columns ``angle`` [mrad], increasing from 0, and ``brightness``, in any unit.
    name : str
        Name of the file in messages.

    Returns
    -------
    SunProfile

    Raises
    ------
    StudyError
        If the file cannot be read or is not a table of angles and brightness. The message lists each problem with its
        line.
    """
    table = read_table(path, name, _COLUMNS, rows="angles", most_rows=10_000)
    angle, brightness = (table.column(key) for key in _COLUMNS)
    if len(table) and angle[0] != 0.0:
        table.add(f"the angles must begin with 0 (got {angle[0]:g})", 0)
    for row in np.flatnonzero(np.diff(angle) <= 0.0) + 1:
        table.add(f"the angles must increase (got {angle[row]:g})", int(row))
    if len(table) < 2:
        table.add("a sun profile needs at least 2 rows")
    elif brightness[0] == 0.0:
        table.add("the brightness at the centre must be greater than 0", 0)
    table.finish()
    return SunProfile(tuple((1e-3 * angle).tolist()), tuple(brightness.tolist()))

"""Read CSV tables that a study names: columns as arrays, and every problem at its line and column.

A table is text in UTF-8 or, with a byte-order mark, UTF-16. Cells are separated by commas, or by semicolons or tabs and
then with decimal commas if there are any; the first row is a header. Empty lines and lines with ``#`` are skipped.
The columns are declared as data::

    COLUMNS = {"angle": Column("angle from the disc centre, in mrad", required=True), ...}
    table = read_table(path, name, COLUMNS, rows="angles")
    angle = table.column("angle")
    table.finish()
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from heliosweep.config.faults import did_you_mean, nearest
from heliosweep.config.spreadsheets import (
    hint,
    iso_dates,
    plain_unit,
    separator_of,
    split_title,
    told_separator,
    unit_in,
    variable_name,
    with_points,
)
from heliosweep.errors import Problem, StudyError, listed

if TYPE_CHECKING:  # it takes longer to import than reading a study
    from numpy.typing import NDArray

#: Largest table that is read: 600 bytes for each of 100,000 heliostats.
MAX_BYTES = 64 * 2**20

#: Problems of one table that are listed; the rest is counted.
MAX_LISTED = 20

#: Row number of the header in problems.
HEADER = -1

#: Parts of a message that differ between rows with one cause.
_VALUES = re.compile(r" \(got .*?\)|[\d,.]+")
_PLAIN = re.compile(r"[0-9+\-.eE\s]*")  # float() also takes 1_0, nan and digits of other scripts


@dataclass(frozen=True)
class Column:
    """Contents of a column of a table: numbers, or the values that `read` returns.

    Parameters
    ----------
    meaning : str
        Meaning, with the unit.
    required : bool
        If every table has the column.
    least, most : float
        Bounds of numbers.
    bounds : str
        The bounds in words, as the end of a sentence: ``between -1e6 and 1e6 m``.
    read : callable, optional
        Returns the value of a cell that is no number, or raises ValueError with the end of a sentence.
    dtype, missing : object
        Type of the array, and its value for a wrong cell.
    names : tuple of str
        Other names of the column in titles, as `spreadsheets.variable_name` returns them.
    units : tuple of str
        Other units that a title may have; `Table.units` contains the unit found.
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


class Table:
    """The rows of a table, and the problems found in them.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    lines : tuple of list
        Numbers in the file, counted from 1, and text of the lines with contents, the header first.
    cells : list of list of str, optional
        Their cells, if the file is no CSV.
    rows, needs : str
        Noun for the rows, and contents that an empty file lacks.
    most_rows : int, optional
        More rows are refused.
    separator : str, optional
        Separator of the cells (default: the separator of the header).
    most_listed : int
        Problems that are listed per column, or with 1 per cause.

    Raises
    ------
    StudyError
        If it cannot be split into rows and cells.
    """

    def __init__(
        self,
        name: str,
        lines: tuple[list[int], list[str]],
        cells: list[list[str]] | None = None,
        *,
        rows: str = "rows",
        most_rows: int | None = None,
        needs: str = "a header and rows",
        separator: str = "",
        most_listed: int = MAX_LISTED,
    ) -> None:
        self.name, self._what, self._most = name, rows, most_listed
        self._numbers, self._texts = lines
        if told := told_separator(self._texts[0]) if self._texts else "":
            self._numbers, self._texts = self._numbers[1:], self._texts[1:]
        self._separator = separator or told or separator_of(self._texts[0] if self._texts else "")
        self._problems: list[tuple[str, Problem]] = []
        self._found = Counter[str]()
        self.forms: dict[str, str] = {}
        self.units: dict[str, str] = {}
        self._columns: Mapping[str, Column] = {}
        if not self._numbers:
            self._fail(f"is empty: it needs {needs}")
        if most_rows is not None and len(self._numbers) - 1 > most_rows:
            self._fail(f"has {len(self._numbers) - 1:,} rows, more than {most_rows:,} {rows}")
        header, *given = self._split() if cells is None else cells
        self._rows, problem = with_points(given, self._separator)
        if problem:
            self._fail(problem[1], self._numbers[problem[0] + 1])
        self.header = [cell.strip() for cell in header]
        width = max((at for at, title in enumerate(self.header, 1) if title), default=0)
        if not any(cell.strip() for row in self._rows for cell in row[width:]):  # padding, as services write it
            self.header, self._rows = self.header[:width], [row[:width] for row in self._rows]
        self._kept = list(range(len(self._rows)))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._kept)

    @property
    def lines(self) -> NDArray[np.int64]:
        """Line of each row in the file, counted from 1."""
        return np.array([self._numbers[row + 1] for row in self._kept], np.int64)

    def check_header(self, columns: Mapping[str, Column], *, others: bool = False) -> None:
        """Note problems with the names of the columns: `columns` are declared, with `others` there can be more."""
        self._columns = columns
        self.read_titles({key: unit_in(column.meaning) for key, column in columns.items()})
        meant: set[str | None] = set()  # columns with a typo: not noted as missing too
        for position, key in enumerate(self.header):
            if key in self.header[:position] and (key in columns or not (others and columns)):
                self.add(f"has two columns {key!r}; remove one", HEADER, position)
            elif key not in columns and not others:
                meant.add(nearest(key, columns))
                hint = did_you_mean(key, columns) or f"; remove it: the columns are {', '.join(columns)}"
                self.add(f"unknown column {key[:40]!r}{hint}", HEADER, position)
        for key, column in columns.items():
            if column.required and key not in self.header and key not in meant:
                self.add(f"needs a column {key}: {column.meaning}", HEADER)

    def unused(self) -> list[str]:
        """Return the titles of the columns that are not declared."""
        return [title or f"column {at}" for at, title in enumerate(self.header, 1) if title not in self._columns]

    def read_titles(self, units: Mapping[str, str]) -> None:
        """Rename titles with capitals, blanks, other names or a unit, such as ``X (m)``; note wrong units.

        `units` are the units of the columns by name; empty if any text in brackets is allowed.
        """
        named = {name: key for key, column in self._columns.items() for name in column.names}
        known = {key: key for key in units} | named
        for position, title in enumerate(self.header):
            (name, said), whole = split_title(title), variable_name(title)
            key = known.get(whole) or known.get(variable_name(name), "")
            if title in units or not key or key in self.header:
                continue
            column, unit = self._columns.get(key), plain_unit(said if units[key] and whole not in named else "")
            if unit in ("", units[key], *(column.units if column else ())):
                self.header[position], self.forms[key], self.units[key] = key, said, unit
            elif column is None or column.required:
                self.header[position] = key
                self.add(f"is in {said!r}; {key} must be in {units[key]}", HEADER, position)

    def check_rows(self) -> None:
        """Drop the rows that have not as many cells as the header, and note them; raise the problems found."""
        if not self._rows:
            self.add(f"has a header but no {self._what}: give one row for each")
        self.finish()
        width = len(self.header)
        for row, cells in enumerate(self._rows):
            if len(cells) != width:
                self.add(f"has {len(cells)} fields, but the header has {width}", row)
        self._kept = [row for row, cells in enumerate(self._rows) if len(cells) == width]

    def texts(self, key: str) -> list[str]:
        """Return the cells of a column as text, blanks around it left out."""
        position = self.header.index(key)
        return [self._rows[row][position].strip() for row in self._kept]

    def column(self, key: str) -> NDArray[Any]:
        """Return a column as it is declared, and note the cells that are wrong."""
        column, texts = self._columns[key], self.texts(key)
        if column.read is None:
            values = numbers(texts)
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
        """Note the cells of a column that hold no finite number."""
        bad = np.flatnonzero(~np.isfinite(values)).tolist()
        for row in bad:
            text = texts[row]
            self.add(f"{key} must be a finite number (got {text[:40]!r})" if text else f"{key} is empty", row, key)

    def add(self, message: str, row: int | None = None, column: str | int | None = None, key: str = "") -> None:
        """Note a problem with the table, with a row or with one of its cells.

        `message` is the end of a sentence that begins with the place, and with `key` if that is given. `row` counts
        from 0, or is `HEADER`; `column` is a name or a position.
        """
        cause = self.header[column] if isinstance(column, int) else column or key
        if self._most == 1:
            cause = _VALUES.sub("", message)
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
        """Raise StudyError if there are problems: the first of each column or cause, then the number of the rest."""
        if self._problems and self._most == 1:
            counts = [self._found[cause] - 1 for cause, _ in self._problems]
            more = [f", and so in {count:,} more rows" * (count > 0) for count in counts]
            found = zip(self._problems, more, strict=True)
            raise StudyError(replace(problem, message=problem.message + rest) for (_, problem), rest in found)
        if self._problems:
            in_order = sorted((one for _, one in self._problems), key=lambda one: (one.line or 0, one.column or 0))
            raise StudyError(listed(in_order, MAX_LISTED, self._found.total()))

    def _split(self) -> list[list[str]]:
        """Split the lines into cells, as CSV."""
        reader = csv.reader(self._texts, delimiter=self._separator, skipinitialspace=True, strict=True)
        rows, message = list[list[str]](), ""
        try:
            rows.extend(reader)
        except csv.Error as error:
            message = f"is not CSV: {error}".replace("\t", "\\t")
        if len(rows) < len(self._texts) and (not message or reader.line_num >= len(self._texts)):
            # A quoted text that does not end swallows the lines behind it: the line that opens it is the wrong one.
            odd = (line for line, text in zip(self._numbers, self._texts, strict=True) if text.count('"') % 2)
            for line in odd:
                self._fail("opens a quoted text that does not end on this line", line)
        if message:
            self._fail(message, self._numbers[reader.line_num - 1])
        return rows

    def _fail(self, message: str, line: int | None = None) -> NoReturn:
        """Raise at once, for what leaves nothing else to check."""
        raise StudyError(Problem(message, file=self.name, line=line))


def read_table(
    path: Path,
    name: str,
    columns: Mapping[str, Column],
    *,
    others: bool = False,
    most_bytes: int | None = None,
    rows: str = "rows",
    most_rows: int | None = None,
    needs: str = "a header and rows",
    also: Callable[[Table], None] | None = None,
) -> Table:
    """Read a table whose header and rows are right; its cells are read column by column.

    Parameters
    ----------
    path, name : Path, str
        The file, and what messages call it.
    columns : mapping of str to Column
        Declared columns; `others` allows further columns.
    most_bytes : int, optional
        As for `table_text`.
    rows, most_rows, needs
        As for `Table`.
    also : callable, optional
        Notes what else is wrong with the header.

    Raises
    ------
    StudyError
        The file cannot be read, or its header is wrong.
    """
    lines = table_lines(table_text(path, name, most_bytes))
    table = Table(name, lines, rows=rows, most_rows=most_rows, needs=needs)
    table.check_header(columns, others=others)
    if also is not None:
        also(table)
    table.check_rows()
    return table


def table_text(path: Path, name: str, most_bytes: int | None = None, *, old: bool = False) -> str:
    """Return the text of a table, which messages call `name`.

    Text that is no UTF-8 is read as Latin-1 if `old` files of this kind can be. Raises StudyError if the file cannot be
    read, is larger than `most_bytes` (by default `MAX_BYTES`) or is no UTF-8.
    """
    most, line, data, text, problem = most_bytes or MAX_BYTES, None, b"", "", ""
    try:
        if path.exists() and not path.is_file():
            problem = "is a folder, not a CSV file" if path.is_dir() else "is not a regular file"
        elif path.stat().st_size > most:
            problem = f"is larger than {most // 2**20} MiB"
        else:
            data = path.read_bytes()
            wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))  # "Unicode text" of Excel
            text = data.decode("utf-16" if wide else "utf-8-sig")
    except FileNotFoundError:
        problem = "there is no such file"
    except UnicodeDecodeError as error:
        text = data.decode("latin-1") if old else ""
        line = data[: error.start].count(b"\n") + 1
        problem = "" if old else "is not UTF-8 text; save it as CSV (UTF-8)"
    except (OSError, ValueError) as error:
        problem = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    if data.startswith(b"PK\x03\x04"):
        line, problem = None, "is a spreadsheet or an archive, not text; save the sheet as CSV (UTF-8)"
    elif "\0" in text:
        line, problem = text[: text.index("\0")].count("\n") + 1, "is a binary file, not CSV"
    if problem:
        raise StudyError(Problem(problem, file=name, line=line))
    return text


def table_lines(text: str) -> tuple[list[int], list[str]]:
    """Return the numbers and the texts of the lines that are neither empty nor comments (``#``)."""
    every = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    numbers = [number for number, line in enumerate(every, 1) if (said := line.lstrip()) and said[0] != "#"]
    return numbers, [every[number - 1] for number in numbers]


def numbers(texts: Sequence[str]) -> NDArray[np.float64]:
    """Return the numbers in texts; NaN or infinity if a text is no number."""
    found = {text: _number(text) for text in set(texts)}
    return np.array([found[text] for text in texts], float)


def _number(text: str) -> float:
    try:
        return float(text) if _PLAIN.fullmatch(text) else np.nan
    except ValueError:
        return np.nan

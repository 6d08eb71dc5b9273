"""Published numbers as a tidy table: one row a number, with its coordinates, unit and tolerance."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from heliosweep.config.tables import table_text
from heliosweep.errors import Problem, StudyError

#: Columns that every table has; all others are coordinates of the result.
COLUMNS = ("quantity", "published", "unit", "tolerance")

#: Units a number may have, and what one of the result's fractions is in them.
UNITS = {"1": 1.0, "percent": 100.0}


@dataclass(frozen=True)
class PublishedValue:
    """One number as it was printed.

    Parameters
    ----------
    quantity : str
        Variable of the result.
    where : dict of str to str
        Coordinates of the result, as written; a coordinate without an entry is left out.
    published, tolerance : float
        The number and by how much a computed one may differ. [`unit`]
    unit : {"1", "percent"}
        Unit of the number.
    decimals : int
        Decimals it was printed with.
    line : int
        Line of the table, counted from 1.
    """

    quantity: str
    where: dict[str, str]
    published: float
    tolerance: float
    unit: str
    decimals: int
    line: int


@dataclass(frozen=True)
class PublishedTable:
    """Published numbers and where they come from.

    Parameters
    ----------
    values : tuple of PublishedValue
        In the order of the file.
    file : str
        Name of the file, for messages.
    source : str
        Publication, in words.
    """

    values: tuple[PublishedValue, ...]
    file: str
    source: str = ""


def read_published(path: Path, source: str = "", name: str = "") -> PublishedTable:
    """Read published numbers from a CSV table; empty lines and lines that start with ``#`` are skipped.

    Parameters
    ----------
    path : pathlib.Path
        The table: columns ``quantity``, ``published``, ``unit`` (``1`` or ``percent``) and ``tolerance`` (in the same
        unit); every other column is a coordinate of the result.
    source : str
        Where the numbers were published.
    name : str
        Name of the file in messages; `path` by default.

    Returns
    -------
    PublishedTable

    Raises
    ------
    StudyError
        The file cannot be read or is no such table; every problem found, each at its line.
    """
    file = name or str(path)
    text = table_text(path, file)
    rows = list(_rows(text))
    if not rows:
        raise StudyError(Problem("holds no table of published numbers", file=file))
    (line, header), *rows = rows
    problems = [
        Problem(f"column {column!r} is missing", file=file, line=line) for column in COLUMNS if column not in header
    ]
    problems += [Problem("has an unnamed column", file=file, line=line)] if "" in header else []
    problems += [
        Problem(f"column {column!r} occurs twice", file=file, line=line)
        for column in dict.fromkeys(header)
        if header.count(column) > 1
    ]
    if not rows:
        problems.append(Problem("has a header but no numbers", file=file, line=line))
    if problems:
        raise StudyError(problems)
    values = []
    for line, cells in rows:
        if len(cells) != len(header):
            problems.append(Problem(f"has {len(cells)} cells where the header has {len(header)}", file=file, line=line))
            continue
        try:
            values.append(_value(dict(zip(header, cells, strict=True)), line))
        except ValueError as error:
            problems.append(Problem(str(error), file=file, line=line))
    if problems:
        raise StudyError(problems)
    return PublishedTable(tuple(values), file, source)


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of each row that is neither empty nor a comment."""
    for line, content in enumerate(text.splitlines(), start=1):
        if content.strip() and not content.lstrip().startswith("#"):
            yield line, [cell.strip() for cell in next(csv.reader([content]))]


def _value(cells: dict[str, str], line: int) -> PublishedValue:
    unit = cells["unit"]
    if unit not in UNITS:
        raise ValueError(f"unit must be {' or '.join(map(repr, UNITS))} (got {unit!r})")
    tolerance = _number("tolerance", cells["tolerance"])
    if tolerance < 0:
        raise ValueError(f"tolerance must not be negative (got {cells['tolerance']})")
    return PublishedValue(
        quantity=cells["quantity"],
        where={name: cell for name, cell in cells.items() if name not in COLUMNS and cell},
        published=_number("published", cells["published"]),
        tolerance=tolerance,
        unit=unit,
        decimals=len(cells["published"].lower().partition("e")[0].partition(".")[2]),
        line=line,
    )


def _number(name: str, cell: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name} must be a number (got {cell!r})")
    return number

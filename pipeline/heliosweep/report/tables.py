"""Tables and headline numbers of a result."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from heliosweep.grid.regions import BEST_VALUE, LARGEST, SMALLEST
from heliosweep.report.figures import (
    DEGREE,
    MINUS,
    NO_BREAK_SPACE,
    NOTHING,
    Context,
    is_flag,
    is_quantity,
    number_text,
    printed,
    quantities,
    title_of,
    unit_of,
    value_texts,
)

#: Maximum number of table rows on a page, and minimum number of points for sorting a table.
MOST_ROWS, SORTED = 100, 6
#: Maximum number of variables in a table of ranges, and maximum number of headline numbers.
MOST_RANGES, MOST_HEADLINES = 12, 6
#: Maximum size of a variable whose range is shown.
MOST_NUMBERS = 2_000_000
#: Attribute that contains the original variable name of a renamed array.
SOURCE = "variable"
#: Dimensions that are not swept, because their points are parts of one result.
INNER = (
    *("heliostat", "time", "date", "day", "declination", "hour", "month", "sample", "module", "parameter", "spot"),
    *("y", "z", "camera", "round", "stage", "cause"),
)


@dataclass(frozen=True)
class Column:
    """Column of a table.

    Parameters
    ----------
    title : str
        Heading.
    values : sequence of float or str
        Unformatted numbers, or text, of the cells.
    unit : str
        Unit, printed below the heading.
    digits : int
        Number of significant digits of the largest number.
    errors : sequence of float
        Standard errors, printed after the numbers.
    best : {"", "largest", "smallest"}
        Kind of the best number in the column; empty if no number is best.
    """

    title: str
    values: Sequence[Any]
    unit: str = ""
    digits: int = 3
    errors: Sequence[float] = ()
    best: str = ""

    @property
    def is_words(self) -> bool:
        """True if any cell contains text."""
        return any(isinstance(value, str) for value in self.values)

    def texts(self) -> list[str]:
        """Return the formatted cells."""
        if self.is_words:
            return [str(value) for value in self.values]
        if len(self.errors):
            return [_with_error(*pair) for pair in zip(self.values, self.errors, strict=True)]
        return number_texts(np.asarray(self.values, dtype=float), self.digits)


@dataclass(frozen=True)
class Table:
    """Table on a page.

    Parameters
    ----------
    label : str
        Short description of the content.
    columns : sequence of Column
        Columns of equal length.
    notes : sequence of str
        Sentences that are printed below the table.
    keys : int
        Number of leading columns that identify the point of a sweep; 0 if the rows are not points.
    classes : sequence of str
        CSS class of each row.
    """

    label: str
    columns: Sequence[Column]
    notes: Sequence[str] = ()
    keys: int = 0
    classes: Sequence[str] = ()

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.columns[0].values)

    def frame(self) -> pd.DataFrame:
        """Return the table with unrounded numbers, units in the headings, and standard errors in separate columns."""
        cells: dict[str, Any] = {}
        for column in self.columns:
            unit = f" ({column.unit})" if column.unit else ""
            cells[f"{column.title}{unit}"] = list(column.values)
            if len(column.errors):
                cells[f"standard error of {column.title}{unit}"] = list(column.errors)
        return pd.DataFrame(cells)

    def sorted(self) -> Table:
        """Sort the rows with the best points or the worst heliostats first."""
        leading = next((one for one in self.columns[self.keys :] if one.best and not one.is_words), None)
        if not self.keys or self.size < SORTED or leading is None:
            return self
        worst = any(column.title == "heliostat" for column in self.columns[: self.keys])
        sign = -1 if (leading.best == LARGEST) != worst else 1
        order = np.argsort(sign * np.asarray(leading.values, dtype=float), kind="stable").tolist()
        columns = [
            replace(
                one, values=[one.values[i] for i in order], errors=[one.errors[i] for i in order if len(one.errors)]
            )
            for one in self.columns
        ]
        note = f"Sorted by {leading.title}, {'worst' if worst else 'best'} first."
        return replace(self, columns=columns, notes=[note, *self.notes])

    def printed(self) -> dict[str, Any]:
        """Return header, units, rows and notes for the templates.

        In a table with few points, each point is a column. In a table with many points, the rows are sorted.
        """
        table = self.sorted()
        texts, keys, notes = [column.texts() for column in table.columns], table.keys, list(table.notes)
        about = {"label": table.label, "notes": notes, "classes": table.classes}
        if keys and table.size < SORTED and len(texts) - keys > 2:
            points = [", ".join(filter(None, parts)) for parts in zip(*texts[:keys], strict=True)]
            heads = table.columns[keys:]
            rows = [[one.title, *cells, one.unit] for one, cells in zip(heads, texts[keys:], strict=True)]
            return {**about, "header": ["", *points, ""], "units": [], "rows": rows, "words": [0, len(points) + 1]}
        if table.size > MOST_ROWS:
            notes.append(
                f"Only the first {MOST_ROWS} of {table.size:,} rows are shown; the data set contains all rows."
            )
        return {
            **about,
            "header": [column.title for column in table.columns],
            "units": [column.unit for column in table.columns],
            "rows": list(zip(*texts, strict=True))[:MOST_ROWS],
            "words": [place for place, column in enumerate(table.columns) if column.is_words or place < keys],
        }


def columns_of(heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> list[Column]:
    """Convert table rows to columns and omit empty columns."""
    columns = [Column(head, [row[i] for row in rows]) for i, head in enumerate(heads)]
    return [one for one in columns if any(one.values) or not rows]


def headlines(result: xr.Dataset, names: Collection[str]) -> list[dict[str, str]]:
    """Return the headline numbers of a result.

    Parameters
    ----------
    result : Dataset
        Result.
    names : collection of str
        Variables to return (default: a variable with the fewest dimensions).

    Returns
    -------
    list of dict
        For each number: title, value, unit, a note on its range and point, and the full text.
    """
    known = [result[name] for name in names if name in result.data_vars]
    numbers = sorted(filter(is_quantity, result.data_vars.values()), key=lambda array: array.ndim)
    found = list[dict[str, str]]()
    for array in known or numbers[:1]:
        if array.size <= MOST_NUMBERS and is_quantity(array):
            title, (value, unit, note) = title_of(array), _headline(result, array)
            text = f"{value} {unit}".replace(f" {DEGREE}", DEGREE).rstrip()
            text = f"{title}: {text}; {note}".removesuffix("; ")
            found.append({"title": title, "value": value, "unit": unit, "note": note, "text": text})
    return found[:MOST_HEADLINES]


def _headline(result: xr.Dataset, array: xr.DataArray) -> tuple[str, str, str]:
    values, unit = np.asarray(printed(array.copy(deep=False)), dtype=float), unit_of(array)
    if not np.isfinite(values).any():
        return "no value", "", ""
    low, high = number_texts(np.array([np.nanmin(values), np.nanmax(values)]), 4)
    if low == high:
        return low, unit, ""
    ends = [("minimum", low, np.nanargmin), ("maximum", high, np.nanargmax)]
    (worst, other, at_worst), (best, text, at_best) = ends[:: -1 if array.attrs.get(BEST_VALUE) == SMALLEST else 1]
    inner = bool(set(array.dims) & set(INNER)) or not array.attrs.get(BEST_VALUE)
    indices = np.unravel_index(int((at_worst if inner else at_best)(values)), array.shape)
    point = {str(dim): int(index) for dim, index in zip(array.dims, indices, strict=True)}
    where = Context(result).fulls({dim: i for dim, i in point.items() if array.sizes[dim] > 1 and dim in result.coords})
    if inner:  # the note locates the worst part of the result
        return f"{low} to {high}", unit, f"{worst} at {where}" if where else ""
    count = int(np.isfinite(values).sum())
    note = f"{best} of {count:,} points, at {where}; {worst} {other}{NO_BREAK_SPACE}{unit}".rstrip()
    return text, unit, note if where else ""


def without(made: Sequence[Table], headlines: Sequence[Mapping[str, str]]) -> list[Table]:
    """Remove columns that repeat headline numbers from tables with a single row."""
    shown, kept = {(one["value"], one["unit"]) for one in headlines}, list[Table]()
    for table in made:
        singles = [one.texts() if one.is_words else number_texts(np.array(one.values), 4) for one in table.columns]
        pairs = zip(table.columns, singles, strict=True)
        columns = [one for one, texts in pairs if table.size != 1 or (texts[0], one.unit) not in shown]
        kept += [replace(table, columns=columns)] * (len(columns) > table.keys)
    return kept


def summary(result: xr.Dataset, names: Collection[str]) -> Iterator[str]:
    """Yield lines with the title, the dimensions and the headline numbers of a result."""
    yield str(result.attrs.get("title", ""))
    sizes = ", ".join(f"{name} {size:,}" for name, size in result.sizes.items())
    count = f"{len(result.data_vars):,} variable{'s' * (len(result.data_vars) != 1)}"
    yield f"{count} over {sizes}" if sizes else count
    yield from (one["text"] for one in headlines(result, names))


def numbers(
    result: xr.Dataset,
    dims: Sequence[str],
    arrays: Sequence[xr.DataArray],
    label: str,
    notes: Sequence[str] = (),
    digits: int = 3,
) -> Table:
    """Return a table of arrays over swept dimensions with one row for each point.

    Parameters
    ----------
    result : Dataset
        Result that contains the coordinates and the standard errors ``NAME_error`` of the arrays.
    dims : sequence of str
        Dimensions of all arrays.
    arrays : sequence of DataArray
        Arrays to show. Each array becomes a column with the array name as heading. The attribute ``variable`` contains
        the original name of a renamed variable.
    label, notes
        As in `Table`.
    digits : int
        Number of significant digits.
    """
    context, indices = Context(result), list(np.ndindex(*(result.sizes[dim] for dim in dims)))
    keys = [
        Column(context.title(dim), [context.value(dim, index[i]) for index in indices]) for i, dim in enumerate(dims)
    ]
    return Table(label, [*keys, *(_column(result, array, dims, digits) for array in arrays)], notes, keys=len(dims))


def _column(result: xr.Dataset, array: xr.DataArray, dims: Sequence[str], digits: int) -> Column:
    values = np.atleast_1d(printed(array.transpose(*dims))).ravel()
    title = str(array.name).replace("_", " ")
    if array.dtype.kind in "OU":
        return Column(title, value_texts(array))
    if is_flag(array):
        words = str(array.attrs["flag_meanings"]).split()
        meanings = dict(zip(map(float, np.atleast_1d(array.attrs["flag_values"])), words, strict=False))
        return Column(title, [meanings.get(float(value), NOTHING).replace("_", " ") for value in values])
    best = str(array.attrs.get(BEST_VALUE, ""))
    error = f"{array.attrs.get(SOURCE, array.name)}_error"
    errors = np.atleast_1d(printed(result[error].transpose(*dims), array)).ravel().tolist() if error in result else ()
    return Column(title, [float(value) for value in values], unit_of(array), digits, errors, best)


def default_tables(result: xr.Dataset, names: Collection[str] = ()) -> list[Table]:
    """Return tables for any result: values at each common point, and ranges of other variables."""
    every = list(result.data_vars.values())
    common = set.intersection(*(set(array.dims) for array in every)) if every else set()
    arrays = [array for array in every if set(array.dims) == common and array.dtype.kind in "fiu"]
    arrays = [] if all(map(is_flag, arrays)) else arrays
    rest = ranges(result.drop_vars([one.name for one in arrays]), names)
    dims = [str(dim) for dim in every[0].dims if dim in common] if every else []
    whole = [numbers(result, dims, arrays, "Values at each point")] if arrays else []
    return [*whole, *([rest] if rest.size else [])]


def ranges(result: xr.Dataset, names: Collection[str] = ()) -> Table:
    """Return a table of the minimum, median and maximum of each variable, `names` first."""
    known = quantities(result)
    order = dict.fromkeys([*(name for name in names if name in known), *known])
    arrays = [result[name] for name in order if result[name].size <= MOST_NUMBERS]
    rows = []
    for array in arrays[:MOST_RANGES]:
        values = np.asarray(printed(array.copy(deep=False)), dtype=float)  # a copy, so the result caches no values
        values = values[np.isfinite(values)]
        if values.size:
            ends = number_texts(np.array([values.min(), np.median(values), values.max()]))
            rows.append([title_of(array), *ends, unit_of(array)])
    more = len(arrays) - MOST_RANGES
    notes = [f"The data set has {more} further {'variable' if more == 1 else 'variables'}."] if more > 0 else []
    return Table("Ranges", columns_of(("", "minimum", "median", "maximum", "unit"), rows), notes)


def number_texts(values: np.ndarray, digits: int = 3) -> list[str]:
    """Format the values of a column with a common number of decimals.

    Decimals are omitted if all values are whole or large. If all values are below 0.001, each value is formatted with
    its own number of decimals.
    """
    finite = values[np.isfinite(values)]
    largest = float(np.abs(finite).max()) if finite.size else 0.0
    if 0.0 < largest < 1e-3:
        return [f"{one:.{digits}g}".replace("-", MINUS) if math.isfinite(one) else number_text(one) for one in values]
    least = 0 if largest >= 10_000 else 1 if largest >= 1_000 else 2
    decimals = least if largest == 0.0 else min(8, max(least, digits - 1 - math.floor(math.log10(largest))))
    whole = finite.size > 0 and largest >= 1.0 and bool(np.all(finite == np.round(finite)))
    return [number_text(value, 0 if whole else decimals) for value in values]


def _with_error(value: float, error: float) -> str:
    if not (np.isfinite([value, error]).all() and error > 0):
        return number_text(value, 3)
    decimals = int(np.clip(1 - np.floor(np.log10(error)), 0, 6))
    return f"{number_text(value, decimals)} \N{PLUS-MINUS SIGN} {number_text(error, decimals)}"


#: Regular expression for a digital object identifier with its prefix, in plain or escaped text.
DOI = re.compile(r"\b(?:https?://(?:dx\.)?doi\.org/|doi:?\s*)(10\.\d{4,9}/[^\s,;&<>\"]*[^\s,;&<>\".)])", re.IGNORECASE)


def references(result: xr.Dataset) -> list[str]:
    """Return the references of a result. If several entries have the same DOI, only the longest is returned."""
    entries: dict[str, str] = {}
    for text in filter(None, (entry.strip() for entry in str(result.attrs.get("references", "")).split(";"))):
        found = DOI.search(text)
        key = found.group(1).lower() if found else text
        entries[key] = max(entries.get(key, ""), text, key=len)
    return list(entries.values())

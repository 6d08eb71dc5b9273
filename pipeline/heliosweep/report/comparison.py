"""Comparison of computed values with published numbers."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from heliosweep.config import HEADER, Column, did_you_mean, factor, one_of, read_table
from heliosweep.errors import Problem, StudyError
from heliosweep.report import tables
from heliosweep.report.context import axis_label, number_text

#: Name of the comparison file in a result folder.
FILE = "comparison.csv"
#: Maximum size of a table of published numbers in bytes, and maximum number of its rows.
MAX_BYTES, MAX_ROWS = 2 * 2**20, 10_000
#: Tolerance for matching numeric labels, and relative rounding error allowed in a comparison with a tolerance.
SAME, EDGE = 1e-9, 1e-12
#: Possible verdicts in a table of published numbers.
AGREES, DIFFERS = VERDICTS = ("agrees", "does not agree")
#: Unit names in results and tables, with the corresponding names in `config.values`.
_HOUSE = {
    "percent": "%",
    **dict.fromkeys(("degree", "degrees", "degrees_north", "degrees_east"), "deg"),
    **dict.fromkeys(("day", "days"), "d"),
    **dict.fromkeys(("hour", "hours"), "h"),
}
#: Columns of a stored comparison that are not coordinates.
_WORDS: Any = ("claim", "reason", "stated_computed", "stated_verdict")
_STORED = ("quantity", "published", "unit", "tolerance", "computed", "difference", "verdict", *_WORDS)
#: Columns of a table that are not coordinates of the result.
_COLUMNS = {
    "quantity": Column("variable of the result", required=True),
    "published": Column("the number as it was printed", required=True),
    "unit": Column("its unit, such as 1, percent, deg or m", required=True),
    "tolerance": Column(
        "maximum difference at which a computed value agrees", required=True, least=0, bounds="at least 0"
    ),
    "claim": Column("figure, table or sentence of the publication"),
    "reason": Column("reason for the tolerance"),
    "computed": Column("computed value stated in the table"),
    "verdict": Column("verdict stated in the table"),
}


@dataclass(frozen=True)
class Comparison:
    """Published number, and the computed value of the same quantity.

    Parameters
    ----------
    quantity : str
        Variable of the result.
    where : dict of str to str
        Coordinates as written in the table of published numbers.
    computed : float
        Computed value; NaN before `compare` is called. [`unit`]
    published, tolerance : float
        Published number and maximum difference. [`unit`]
    unit : str
        Unit, such as ``1``, ``percent``, ``deg``.
    decimals : int
        Number of decimals in the published number.
    claim, reason : str
        Figure, table or sentence of the publication, and reason for the tolerance.
    stated_computed, stated_verdict : str
        Computed value and verdict that the table states; empty strings if the table states none.
    line : int
        Number of the line in the table, counted from 1.
    """

    quantity: str
    where: dict[str, str]
    computed: float
    published: float
    tolerance: float
    unit: str
    decimals: int
    claim: str = ""
    reason: str = ""
    stated_computed: str = ""
    stated_verdict: str = ""
    line: int = field(default=0, compare=False)

    @property
    def text(self) -> str:
        """Published number with its published decimals."""
        return f"{self.published:.{self.decimals}f}"

    @property
    def difference(self) -> float:
        """Computed value minus published number. [`unit`]"""
        return self.computed - self.published

    @property
    def agrees(self) -> bool:
        """True if the difference is within the tolerance; False if the computed value is missing."""
        return abs(self.difference) <= self.tolerance + EDGE * max(abs(self.published), self.tolerance)

    @property
    def verdict(self) -> str:
        """``agrees`` or ``does not agree``."""
        return AGREES if self.agrees else DIFFERS

    @property
    def found(self) -> str:
        """Computed value, formatted for readers."""
        counts = math.ceil(-math.log10(self.tolerance)) if self.tolerance else 0
        return number_text(self.computed, max(self.decimals, counts) + 1)

    @property
    def surprise(self) -> str:
        """Message about a stated value or verdict that differs from this comparison, or an empty string."""
        computed, verdict = self.stated_computed, self.stated_verdict
        if verdict and verdict != self.verdict:
            return f"the table states {verdict!r}, but it {self.verdict}"
        if not computed:
            return ""
        mantissa, _, exponent = computed.lower().partition("e")
        digits = len(mantissa.partition(".")[2])
        same = abs(float(computed) - self.computed) <= 1.01 * 10.0 ** (int(exponent or 0) - digits)
        return "" if same else f"the table states {computed} as computed, but the result has {self.found}"


@dataclass(frozen=True)
class Compared:
    """Published numbers in the order of their table, their source, and the file name for messages."""

    values: list[Comparison]
    source: str
    file: str = field(default="", compare=False)

    @property
    def agrees(self) -> bool:
        """True if all computed values agree with the published numbers."""
        return all(one.agrees for one in self.values)

    @property
    def explained(self) -> bool:
        """True if the table states a reason and the verdict for every value that does not agree."""
        return all(one.reason and one.stated_verdict in ("", DIFFERS) for one in self.values if not one.agrees)

    @property
    def summary(self) -> str:
        """Line with the number of values that agree, and the maximum difference in each unit."""
        largest = []
        for unit in dict.fromkeys(one.unit for one in self.values):
            differences = [abs(one.difference) for one in self.values if one.unit == unit]
            most = max(filter(math.isfinite, differences), default=math.nan)
            largest.append(
                f"{most:.3f} percentage points" if unit == "percent" else f"{most:.3g} {unit}".removesuffix(" 1")
            )
        text = f"{sum(one.agrees for one in self.values)} of {len(self.values)} published values agree"
        text += ", the others are explained" * (not self.agrees and self.explained)
        return f"{text}; largest difference {' and '.join(largest)}" if largest else text

    @property
    def surprises(self) -> list[str]:
        """Messages about values and verdicts that differ from the values and verdicts in the table."""
        return [
            f"{one.claim or ' '.join([one.quantity, *one.where.values()])}: {one.surprise}"
            for one in self.values
            if one.surprise
        ]

    def table(self, result: xr.Dataset) -> tables.Table:
        """Return a table for readers with one row for each published number."""
        names = [*dict.fromkeys(name for one in self.values for name in one.where)]
        labels = [axis_label(result[name]) if name in result.coords else name for name in names]
        last = ("computed", "published", "difference", "tolerance", "unit", "reason", "verdict")
        rows = [
            (
                *(one.claim, one.quantity.replace("_", " "), *(one.where.get(name, "") for name in names)),
                *(one.found, one.text, number_text(one.difference, one.decimals + 1, True), f"{one.tolerance:g}"),
                *("%" if one.unit == "percent" else one.unit, one.reason, one.verdict),
            )
            for one in self.values
        ]
        columns = tables.columns_of(("claim", "quantity", *labels, *last), rows)
        note = "Difference: computed minus published, in percentage points if the unit is %."
        classes = [AGREES if one.agrees else "differs" for one in self.values]
        return tables.Table("Computed and published", columns, [note], classes=classes)


def read_published(path: Path, source: str = "", name: str = "") -> Compared:
    """Read published numbers from a CSV table.

    Parameters
    ----------
    path : pathlib.Path
        Table with columns ``quantity``, ``published``, ``unit`` and ``tolerance`` (in the same unit), and optionally
        ``claim``, ``reason``, ``computed`` and ``verdict``. Every other column is a coordinate of the result.
    source : str
        Source of the published numbers.
    name : str
        Name of the file in messages (default: `path`).

    Raises
    ------
    StudyError
        If the file cannot be read or is not a table of published numbers. The message lists every problem with its line
        number.
    """
    file = name or str(path)
    table = read_table(
        path, file, _COLUMNS, others=True, most_bytes=MAX_BYTES, rows="published numbers", most_rows=MAX_ROWS,
        needs="a header and numbers",
    )  # fmt: skip
    for position, key in enumerate(table.header):
        if key not in _COLUMNS and key in table.header[:position]:
            table.add(f"has two columns {key!r}; remove one", HEADER, position)
    texts = {key: table.texts(key) for key in table.header}
    numbers = {key: table.column(key) for key in ("published", "tolerance")}
    values = []
    for row, line in enumerate(table.lines.tolist()):
        cells = {key: column[row] for key, column in texts.items()}
        for key in ("quantity", "unit"):
            if not cells[key]:
                table.add(f"{key} is empty", row, key)
        if (verdict := cells.get("verdict", "")) not in ("", *VERDICTS):
            table.add(f"verdict must be {one_of(VERDICTS)} (got {verdict[:40]!r})", row, "verdict")
        published, tolerance = (float(numbers[key][row]) for key in ("published", "tolerance"))
        values.append(_comparison(cells, math.nan, published, tolerance, ("computed", "verdict"), line))
    table.finish()
    return Compared(values, source, file)


def _comparison(
    cells: Mapping[str, str],
    computed: float,
    published: float,
    tolerance: float,
    stated: tuple[str, str] = _WORDS[2:],
    line: int = 0,
) -> Comparison:
    """Return the entry for one row of the table. `stated` names the columns with the stated values."""
    where = {key: cell for key, cell in cells.items() if key not in {*_COLUMNS, *_STORED} and cell}
    decimals = len(cells["published"].lower().partition("e")[0].partition(".")[2])
    words: Any = {key: cells.get(name, "") for key, name in zip(_WORDS, (*_WORDS[:2], *stated), strict=True)}
    return Comparison(
        cells["quantity"], where, computed, published, tolerance, cells["unit"], decimals, **words, line=line
    )


def compare(result: xr.Dataset, table: Compared) -> Compared:
    """Compare published numbers with a result. Raises StudyError as `locate` does."""
    values = []
    for one, (point, scale) in zip(table.values, locate(result, table), strict=True):
        values.append(replace(one, computed=float(result[one.quantity].isel(point)) * scale))
    return replace(table, values=values)


def locate(result: xr.Dataset, table: Compared) -> list[tuple[dict[str, int], float]]:
    """Return the position of each published number in a result, and the conversion factor to its unit.

    Raises
    ------
    StudyError
        If a quantity or coordinate does not exist or is missing. The message lists every problem with its line number.
    """
    found, problems = [], []
    for one in table.values:
        try:
            found.append(_locate(result, one))
        except ValueError as error:
            problems.append(Problem(str(error), file=table.file, line=one.line))
    if problems:
        raise StudyError(problems)
    return found


def _locate(result: xr.Dataset, one: Comparison) -> tuple[dict[str, int], float]:
    if one.quantity not in result.data_vars:
        raise ValueError(f"unknown quantity {one.quantity!r}{_hint(one.quantity, result.data_vars)}")
    array = result[one.quantity]
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{one.quantity} is not numeric; compare dates and text in Python")
    masks = {str(dim): np.ones(size, dtype=bool) for dim, size in array.sizes.items()}
    for name, text in one.where.items():
        same = _labelled(result, array, name, text)
        if same.ndim:
            masks[str(result[name].dims[0])] &= same
    for dim, mask in masks.items():
        if mask.sum() > 1:
            raise ValueError(f"{dim!r} is missing: {one.quantity} has {mask.sum()} values along it")
        if not mask.any():
            raise ValueError(f"no point of {one.quantity} has all of {one.where}")
    unit = str(array.attrs.get("units", "1"))
    try:
        scale = 1.0 if unit == one.unit else factor(_HOUSE.get(unit, unit), _HOUSE.get(one.unit, one.unit))
    except ValueError:
        raise ValueError(f"{one.quantity} is in {unit}, which cannot be converted to {one.unit!r}") from None
    return {dim: int(np.argmax(mask)) for dim, mask in masks.items()}, scale


def _labelled(result: xr.Dataset, array: xr.DataArray, name: str, text: str) -> np.ndarray:
    """Return a mask of the coordinate values that equal a label. Raises ValueError if no value equals the label."""
    if name not in result.coords:
        raise ValueError(f"unknown coordinate {name!r}{_hint(name, result.coords)}")
    coordinate = result[name]
    if coordinate.ndim > 1 or not set(coordinate.dims) <= set(array.dims):
        dims = ", ".join(map(str, array.dims)) or "no dimension"
        raise ValueError(f"{array.name} cannot be selected by {name!r}; it has {dims}")
    values = coordinate.to_numpy()
    same = np.array([value_label(value, len(text)) == text for value in values.ravel()]).reshape(values.shape)
    if values.dtype.kind in "fiu":
        with suppress(ValueError):
            same = np.asarray(np.abs(values - float(text)) <= SAME * max(1.0, abs(float(text))))
    if not same.any():
        known = ", ".join(value_label(value) for value in values.ravel()[:8])
        raise ValueError(f"{name} {text!r} is not in the result, which has {known}")
    return same


def value_label(value: Any, letters: int = 10) -> str:
    """Return a label in the form of tables of published numbers, with dates limited to `letters` characters."""
    if isinstance(value, np.datetime64):
        return str(value.astype("datetime64[s]"))[:letters]
    return f"{value:g}" if isinstance(value, np.number) else str(value)


def _hint(name: str, known: Iterable[Any]) -> str:
    return did_you_mean(name, known) or f"; the result has {', '.join(map(str, known)) or 'none'}"


def comparison_csv(compared: Compared) -> str:
    """Return a comparison as the text of the file ``comparison.csv``, with all digits."""
    empty = dict.fromkeys([*(name for one in compared.values for name in one.where), *_STORED], "")
    rows = [
        {**empty, **one.where, **{key: getattr(one, key) for key in _STORED}, "published": one.text}
        for one in compared.values
    ]
    notes = "".join(f"# {line}\n" for line in compared.source.splitlines())
    return notes + pd.DataFrame(rows, columns=[*empty]).to_csv(index=False, lineterminator="\n", na_rep="nan")


def read_comparison(path: Path) -> Compared:
    """Read a comparison from a file in the format of `comparison_csv`. Raises StudyError for other formats."""
    lines = path.read_text(encoding="utf-8").splitlines()
    source = [line[1:].strip() for line in lines if line.startswith("#")]
    try:
        values = [
            _comparison(row, float(row["computed"]), float(row["published"]), float(row["tolerance"]))
            for row in csv.DictReader(lines[len(source) :])
        ]
    except (AttributeError, KeyError, TypeError, ValueError):
        message = "is not a comparison written by heliosweep; remove it, or run the study again"
        raise StudyError(Problem(message, file=str(path))) from None
    return Compared(values, "\n".join(source))

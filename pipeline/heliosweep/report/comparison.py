"""Computed against published: the tables of both, the verdicts, and what a page, a file and figures say of them."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import xarray as xr

from heliosweep.config.faults import did_you_mean
from heliosweep.config.tables import Column, read_table
from heliosweep.errors import Problem, StudyError
from heliosweep.report.contents import Table
from heliosweep.report.labels import axis_label, number_text, unit_of

#: File of a result folder with the comparison, from which the page can be made again.
FILE = "comparison.csv"

#: How far a coordinate may be from the one asked for, relative and absolute.
SAME = 1e-9

#: Units a number may have, and what one of the result's fractions is in them.
UNITS = {"1": 1.0, "percent": 100.0}

#: Letters of the head of a column.
LONGEST_HEAD = 18

#: Rounding that a difference on the edge of its tolerance is forgiven. [unit of the number]
_EDGE = 1e-9

#: Attribute with which a result tells its figures what was published.
_ATTRIBUTE = "comparison"

#: Columns of `FILE` after those of the published table; columns of the page after the quantity and its coordinates.
_COMPUTED = ("computed", "difference", "verdict")
_SHOWN = ("computed", "published", "difference", "tolerance", "unit", "verdict")


def _unit(cell: str) -> str:
    if cell not in UNITS:
        raise ValueError(f"must be {' or '.join(map(repr, UNITS))} (got {cell!r})")
    return cell


#: Columns that every table has; all others are coordinates of the result.
_COLUMNS = {
    "quantity": Column("variable of the result", required=True, read=str, dtype=object),
    "published": Column("the number as it was printed", required=True),
    "unit": Column("its unit, 1 or percent", required=True, read=_unit, dtype=object),
    "tolerance": Column("by how much a computed one may differ", required=True, least=0.0, bounds="at least 0"),
}


@dataclass(frozen=True)
class Comparison:
    """One published number and what was computed.

    Parameters
    ----------
    quantity : str
        Variable of the result.
    where : dict of str to str
        Coordinates, as the table of published numbers writes them; one without an entry is left out.
    computed, published, tolerance : float
        Values; nothing is computed before `compare`. [`unit`]
    unit : {"1", "percent"}
        Their unit.
    decimals : int
        Decimals that were published.
    line : int
        Line of the table, counted from 1.
    """

    quantity: str
    where: dict[str, str]
    computed: float
    published: float
    tolerance: float
    unit: str
    decimals: int
    line: int = field(default=0, compare=False)

    @property
    def difference(self) -> float:
        """Computed minus published, in `unit`."""
        return self.computed - self.published

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the tolerance; a missing value never agrees."""
        return abs(self.difference) <= self.tolerance + _EDGE

    @property
    def verdict(self) -> str:
        """``agrees`` or ``differs``."""
        return "agrees" if self.agrees else "differs"


@dataclass(frozen=True)
class Compared:
    """Published numbers in the order of their table, where they come from, and the name of the file, for messages."""

    values: list[Comparison]
    source: str
    file: str = field(default="", compare=False)

    @property
    def agrees(self) -> bool:
        """Whether all numbers agree."""
        return all(one.agrees for one in self.values)

    @property
    def summary(self) -> str:
        """One line: how many numbers agree, and the largest difference of each unit."""
        largest = []
        for unit in dict.fromkeys(one.unit for one in self.values):
            differences = [abs(one.difference) for one in self.values if one.unit == unit]
            most = max(filter(math.isfinite, differences), default=math.nan)
            largest.append(f"{most:.3f} percentage points" if unit == "percent" else f"{most:.3g}")
        text = f"{sum(one.agrees for one in self.values)} of {len(self.values)} published values agree"
        return f"{text}, largest difference {' and '.join(largest)}" if largest else text

    @property
    def coordinates(self) -> list[str]:
        """Names of all coordinates that the numbers are chosen by."""
        return list(dict.fromkeys(name for one in self.values for name in one.where))

    def table(self, result: xr.Dataset) -> Table:
        """The table a person reads: quantity and coordinates, computed, published and verdict."""
        names = self.coordinates
        rows = [
            [
                one.quantity.replace("_", " "),
                *(one.where.get(name, "").replace("_", "-") for name in names),
                number_text(one.computed, one.decimals + 1),
                number_text(one.published, one.decimals),
                number_text(one.difference, one.decimals + 1, signed=True),
                f"{one.tolerance:g}",
                "%" if one.unit == "percent" else one.unit,
                one.verdict,
            ]
            for one in self.values
        ]
        texts = [
            i for i, name in enumerate(names, 1) if not all(map(_is_number, (v.where.get(name) for v in self.values)))
        ]
        width = 1 + len(names) + len(_SHOWN)
        begins = [bool(i) and one.quantity != self.values[i - 1].quantity for i, one in enumerate(self.values)]
        return Table(
            "Computed and published",
            ["quantity", *(_title(result, name) for name in names), *_SHOWN],
            rows,
            [0, *texts, width - 2, width - 1],
            [
                "The difference is computed minus published, in percentage points where the unit is %. "
                "A number agrees where the difference is within the tolerance."
            ],
            classes=[f"{one.verdict}{' new' * new}" for one, new in zip(self.values, begins, strict=True)],
        )


def read_published(path: Path, source: str = "", name: str = "") -> Compared:
    """Read published numbers from a CSV table.

    Parameters
    ----------
    path : pathlib.Path
        The table: columns ``quantity``, ``published``, ``unit`` (``1`` or ``percent``) and ``tolerance`` (in the same
        unit); every other column is a coordinate of the result.
    source : str
        Where the numbers were published.
    name : str
        Name of the file in messages; `path` by default.

    Raises
    ------
    StudyError
        The file cannot be read or is no such table; every problem found, each at its line.
    """
    file = name or str(path)
    table = read_table(path, file, _COLUMNS, others=True, rows="published numbers", needs="a header and numbers")
    columns = [table.column(key).tolist() for key in _COLUMNS]
    table.finish()
    others = {key: table.texts(key) for key in table.header if key not in _COLUMNS}
    wheres = [{key: cells[row] for key, cells in others.items() if cells[row]} for row in range(len(table))]
    decimals = [len(text.lower().partition("e")[0].partition(".")[2]) for text in table.texts("published")]
    rows = zip(*columns, wheres, decimals, table.lines.tolist(), strict=True)
    return Compared(
        [
            Comparison(quantity, where, math.nan, published, tolerance, unit, digits, line)
            for quantity, published, unit, tolerance, where, digits, line in rows
        ],
        source,
        file,
    )


def compare(result: xr.Dataset, table: Compared) -> Compared:
    """Set published numbers against those of a result. Raises StudyError as `locate` does."""
    found = zip(table.values, locate(result, table), strict=True)
    values = [
        replace(one, computed=float(result[one.quantity].isel(point).item()) * _factor(result[one.quantity], one))
        for one, point in found
    ]
    return replace(table, values=values)


def locate(result: xr.Dataset, table: Compared) -> list[dict[str, int]]:
    """Index of every published number along each dimension of its quantity, of which only coordinates are read.

    Raises
    ------
    StudyError
        Numbers that the result, or the lazy one of a study that has not run, does not have: unknown quantity or
        coordinate, or one that is missing; each at its line of the table.
    """
    points, problems = [], []
    for one in table.values:
        try:
            points.append(_point(result, one))
        except ValueError as error:
            problems.append(Problem(str(error), file=table.file, line=one.line))
    if problems:
        raise StudyError(problems)
    return points


def _point(result: xr.Dataset, one: Comparison) -> dict[str, int]:
    if one.quantity not in result.data_vars:
        raise ValueError(f"unknown quantity {one.quantity!r}{_meant(one.quantity, result.data_vars)}")
    quantity = result[one.quantity]
    _factor(quantity, one)
    chosen = {str(dim): np.ones(size, dtype=bool) for dim, size in quantity.sizes.items()}
    for name, cell in one.where.items():
        if name not in result.coords:
            raise ValueError(f"unknown coordinate {name!r}{_meant(name, result.coords)}")
        coordinate = result[name]
        if coordinate.ndim > 1 or not set(coordinate.dims) <= set(quantity.dims):
            dims = ", ".join(map(str, quantity.dims)) or "none"
            raise ValueError(f"{one.quantity} cannot be chosen by {name!r}; its dimensions are {dims}")
        same = _same(coordinate, cell)
        if not same.any():
            raise ValueError(f"{name} {cell!r} is not in the result, which has {_values(coordinate)}")
        if coordinate.ndim:
            chosen[str(coordinate.dims[0])] &= same
    for dim, mask in chosen.items():
        if mask.sum() > 1:
            raise ValueError(f"{dim!r} is missing: {one.quantity} has {mask.sum()} values along it")
        if not mask.any():
            raise ValueError(f"no point of {one.quantity} has all of {one.where}")
    return {dim: int(np.argmax(mask)) for dim, mask in chosen.items()}


def _factor(quantity: xr.DataArray, one: Comparison) -> float:
    """What the computed values are multiplied with to be in the unit of the published one."""
    unit = str(quantity.attrs.get("units", "1"))
    if unit == one.unit:
        return 1.0
    if unit != "1":
        raise ValueError(f"{one.quantity} is in {unit}, which cannot be compared with unit {one.unit!r}")
    return UNITS[one.unit]


def _same(coordinate: xr.DataArray, cell: str) -> np.ndarray:
    values = np.atleast_1d(coordinate.to_numpy())
    if values.dtype.kind == "M":
        return np.asarray(values.astype("datetime64[D]").astype(str) == cell)
    if values.dtype.kind not in "fiu":
        return np.asarray(values.astype(str) == cell)
    if not _is_number(cell):
        raise ValueError(f"{coordinate.name} must be a number (got {cell!r})")
    return np.isclose(values.astype(float), float(cell), rtol=SAME, atol=SAME)


def _meant(name: str, known: Iterable[object]) -> str:
    names = list(map(str, known))
    return did_you_mean(name, names) or f"; the result has {', '.join(names) or 'none'}"


def _values(coordinate: xr.DataArray, most: int = 8) -> str:
    numbers = coordinate.dtype.kind in "fiu"
    values = [f"{value:g}" if numbers else str(value) for value in coordinate.to_numpy().ravel()[:most]]
    more = coordinate.size - len(values)
    return ", ".join(values) + (f" and {more} more" if more > 0 else "")


def _title(result: xr.Dataset, name: str) -> str:
    """Head of a column: what a coordinate is called, or its name where that is long and without a unit."""
    if name not in result.coords:
        return name
    words = axis_label(result[name])
    return words if len(words) <= LONGEST_HEAD or unit_of(result[name]) else name.replace("_", " ")


def _is_number(cell: str | None) -> bool:
    try:
        float(cell or 0)
    except ValueError:
        return False
    return True


def told(result: xr.Dataset, comparisons: Iterable[Comparison]) -> xr.Dataset:
    """The same result, which also tells the published numbers; figures read them with `published_in`."""
    return result.assign_attrs({_ATTRIBUTE: json.dumps([asdict(one) for one in comparisons])})


def published_in(result: xr.Dataset, quantity: str) -> list[Comparison]:
    """Published numbers of one quantity that a result was compared with; none where it was not."""
    known = [Comparison(**one) for one in json.loads(result.attrs.get(_ATTRIBUTE, "[]"))]
    return [one for one in known if one.quantity == quantity]


def comparison_csv(compared: Compared) -> str:
    """The comparison as the text of `FILE`: columns of the published table, and what was computed, in full digits."""
    names = compared.coordinates
    buffer = io.StringIO()
    buffer.writelines(f"# {line}\n" for line in compared.source.splitlines())
    table = csv.writer(buffer, lineterminator="\n")
    table.writerow([*names, *_COLUMNS, *_COMPUTED])
    for one in compared.values:
        published = f"{one.published:.{one.decimals}f}"
        numbers = [repr(one.computed), repr(one.difference), one.verdict]
        coordinates = [one.where.get(name, "") for name in names]
        table.writerow([*coordinates, one.quantity, published, one.unit, repr(one.tolerance), *numbers])
    return buffer.getvalue()


def read_comparison(path: Path) -> Compared:
    """Read back what `comparison_csv` wrote. Raises StudyError where the file is not such a table."""
    table = read_published(path)
    try:
        values = [replace(one, computed=float(one.where["computed"])) for one in table.values]
    except (KeyError, ValueError):
        message = "is no comparison that heliosweep wrote; remove it, or run the study again"
        raise StudyError(Problem(message, file=str(path))) from None
    for one in values:
        for name in _COMPUTED:
            one.where.pop(name, None)
    comments = [line[1:].strip() for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    return Compared(values, "\n".join(comments))

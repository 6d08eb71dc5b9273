"""Computed against published: the table, its verdicts, and its forms as text and as a file beside the result."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np
import xarray as xr

from heliosweep.errors import Problem, StudyError
from heliosweep.report.contents import Table
from heliosweep.report.labels import axis_label, number_text, unit_of
from heliosweep.report.published import COLUMNS, UNITS, PublishedTable, PublishedValue, read_published

#: File of a result folder with the comparison, from which the page can be made again.
FILE = "comparison.csv"

#: How far a coordinate may be from the one asked for, relative and absolute.
SAME = 1e-9

#: Rounding that a difference on the edge of its tolerance is forgiven. [unit of the number]
_EDGE = 1e-9

#: Letters of the head of a column.
LONGEST_HEAD = 18

#: Attribute with which a result tells its figures what was published.
_ATTRIBUTE = "comparison"

_COMPUTED = ("computed", "difference", "verdict")
#: Columns of the table after the quantity and its coordinates.
NUMBER_COLUMNS = ("computed", "published", "difference", "tolerance", "unit", "verdict")


@dataclass(frozen=True)
class Comparison:
    """One published number and what was computed.

    Parameters
    ----------
    quantity : str
        Variable of the result.
    where : dict of str to str
        Coordinates, as the table of published numbers writes them.
    computed, published, tolerance : float
        Values. [`unit`]
    unit : {"1", "percent"}
        Their unit.
    decimals : int
        Decimals that were published.
    """

    quantity: str
    where: dict[str, str]
    computed: float
    published: float
    tolerance: float
    unit: str
    decimals: int

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


def compare(result: xr.Dataset, table: PublishedTable) -> list[Comparison]:
    """Set published numbers against those of a result.

    Parameters
    ----------
    result : xarray.Dataset
        The result.
    table : PublishedTable
        From `read_published`.

    Returns
    -------
    list of Comparison
        In the order of the table.

    Raises
    ------
    StudyError
        Numbers that the result does not have: unknown quantity or coordinate, or one that is missing; each at its
        line of the table.
    """
    return [
        Comparison(
            value.quantity,
            value.where,
            float(result[value.quantity].isel(point).item()) * _factor(result[value.quantity], value),
            value.published,
            value.tolerance,
            value.unit,
            value.decimals,
        )
        for value, point in zip(table.values, locate(result, table), strict=True)
    ]


def locate(result: xr.Dataset, table: PublishedTable) -> list[dict[str, int]]:
    """Position of every published number in a result, of which only the coordinates are read.

    Parameters
    ----------
    result : xarray.Dataset
        The result, or the lazy one of a study that has not run.
    table : PublishedTable
        From `read_published`.

    Returns
    -------
    list of dict
        For each number, the index along each dimension of its quantity.

    Raises
    ------
    StudyError
        As `compare`.
    """
    points, problems = [], []
    for value in table.values:
        try:
            points.append(_point(result, value))
        except ValueError as error:
            problems.append(Problem(str(error), file=table.file, line=value.line))
    if problems:
        raise StudyError(problems)
    return points


def _point(result: xr.Dataset, value: PublishedValue) -> dict[str, int]:
    if value.quantity not in result.data_vars:
        raise ValueError(f"unknown quantity {value.quantity!r}{_nearest(value.quantity, result.data_vars)}")
    quantity = result[value.quantity]
    _factor(quantity, value)
    chosen = {str(dim): np.ones(size, dtype=bool) for dim, size in quantity.sizes.items()}
    for name, cell in value.where.items():
        if name not in result.coords:
            raise ValueError(f"unknown coordinate {name!r}{_nearest(name, result.coords)}")
        coordinate = result[name]
        if coordinate.ndim > 1 or not set(coordinate.dims) <= set(quantity.dims):
            raise ValueError(
                f"{value.quantity} cannot be chosen by {name!r}; its dimensions are {_listed(quantity.dims)}"
            )
        same = _same(coordinate, cell)
        if not same.any():
            raise ValueError(f"{name} {cell!r} is not in the result, which has {_values(coordinate)}")
        if coordinate.ndim:
            chosen[str(coordinate.dims[0])] &= same
    for dim, mask in chosen.items():
        if mask.sum() > 1:
            raise ValueError(f"{dim!r} is missing: {value.quantity} has {mask.sum()} values along it")
        if not mask.any():
            raise ValueError(f"no point of {value.quantity} has all of {value.where}")
    return {dim: int(np.argmax(mask)) for dim, mask in chosen.items()}


def _factor(quantity: xr.DataArray, value: PublishedValue) -> float:
    """What the computed values are multiplied with to be in the unit of the published one."""
    unit = str(quantity.attrs.get("units", "1"))
    if unit == value.unit:
        return 1.0
    if unit != "1":
        raise ValueError(f"{value.quantity} is in {unit}, which cannot be compared with unit {value.unit!r}")
    return UNITS[value.unit]


def _same(coordinate: xr.DataArray, cell: str) -> np.ndarray:
    values = np.atleast_1d(coordinate.to_numpy())
    if values.dtype.kind == "M":
        return np.asarray(values.astype("datetime64[D]").astype(str) == cell)
    if values.dtype.kind not in "fiu":
        return np.asarray(values.astype(str) == cell)
    try:
        number = float(cell)
    except ValueError:
        raise ValueError(f"{coordinate.name} must be a number (got {cell!r})") from None
    return np.isclose(values.astype(float), number, rtol=SAME, atol=SAME)


def _nearest(name: str, known: object) -> str:
    names = [str(one) for one in known]  # type: ignore[attr-defined]
    close = get_close_matches(name, names, 1)
    return f"; did you mean {close[0]!r}?" if close else f"; the result has {_listed(names)}"


def _listed(names: object) -> str:
    return ", ".join(map(str, names)) or "none"  # type: ignore[call-overload]


def _values(coordinate: xr.DataArray, most: int = 8) -> str:
    numbers = coordinate.dtype.kind in "fiu"
    values = [f"{value:g}" if numbers else str(value) for value in coordinate.to_numpy().ravel()[:most]]
    more = coordinate.size - len(values)
    return ", ".join(values) + (f" and {more} more" if more > 0 else "")


def told(result: xr.Dataset, comparisons: Sequence[Comparison]) -> xr.Dataset:
    """The same result, which also tells the published numbers; figures read them with `published_in`."""
    keep = [asdict(one) for one in comparisons]
    return result.assign_attrs({_ATTRIBUTE: json.dumps(keep)})


def published_in(result: xr.Dataset, quantity: str) -> list[Comparison]:
    """Published numbers of one quantity that a result was compared with; none where it was not."""
    known = [Comparison(**one) for one in json.loads(result.attrs.get(_ATTRIBUTE, "[]"))]
    return [one for one in known if one.quantity == quantity]


@dataclass(frozen=True)
class Compared:
    """Comparisons with published numbers and where these come from."""

    values: list[Comparison]
    source: str

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
            most = max((value for value in differences if math.isfinite(value)), default=math.nan)
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
        words = [
            i for i, name in enumerate(names, 1) if not all(_is_number(one.where.get(name, "")) for one in self.values)
        ]
        pairs = zip(self.values, [None, *self.values], strict=False)
        return Table(
            "Computed and published",
            ["quantity", *(_title(result, name) for name in names), *NUMBER_COLUMNS],
            rows,
            [0, *words, len(names) + len(NUMBER_COLUMNS) - 1, len(names) + len(NUMBER_COLUMNS)],
            [
                "The difference is computed minus published, in percentage points where the unit is %. "
                "A number agrees where the difference is within the tolerance."
            ],
            classes=[
                f"{one.verdict} new" if before and one.quantity != before.quantity else one.verdict
                for one, before in pairs
            ],
        )


def _title(result: xr.Dataset, name: str) -> str:
    """Head of a column: what a coordinate is called, or its name where that is long and without a unit."""
    if name not in result.coords:
        return name
    words = axis_label(result[name])
    return words if len(words) <= LONGEST_HEAD or unit_of(result[name]) else name.replace("_", " ")


def _is_number(cell: str) -> bool:
    try:
        float(cell or 0)
    except ValueError:
        return False
    return True


def comparison_csv(compared: Compared) -> str:
    """The comparison as the text of `FILE`: columns of the published table, and what was computed, in full digits."""
    names = compared.coordinates
    buffer = io.StringIO()
    buffer.writelines(f"# {line}\n" for line in compared.source.splitlines())
    table = csv.writer(buffer, lineterminator="\n")
    table.writerow([*names, *COLUMNS, *_COMPUTED])
    for one in compared.values:
        published = f"{one.published:.{one.decimals}f}"
        numbers = [repr(one.computed), repr(one.difference), one.verdict]
        coordinates = [one.where.get(name, "") for name in names]
        table.writerow([*coordinates, one.quantity, published, one.unit, repr(one.tolerance), *numbers])
    return buffer.getvalue()


def read_comparison(path: Path) -> Compared:
    """Read back what `comparison_csv` wrote.

    Raises
    ------
    StudyError
        The file is not such a table.
    """
    table = read_published(path)
    try:
        comparisons = [
            Comparison(
                value.quantity,
                {name: cell for name, cell in value.where.items() if name not in _COMPUTED},
                float(value.where["computed"]),
                value.published,
                value.tolerance,
                value.unit,
                value.decimals,
            )
            for value in table.values
        ]
    except (KeyError, ValueError):
        message = "is no comparison that heliosweep wrote; remove it, or run the study again"
        raise StudyError(Problem(message, file=str(path))) from None
    comments = [line[1:].strip() for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    return Compared(comparisons, "\n".join(comments))

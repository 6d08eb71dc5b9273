"""Comparison of computed values with published numbers."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import xarray as xr

from heliosweep.config.faults import did_you_mean, one_of
from heliosweep.config.tables import HEADER, Column, read_table
from heliosweep.config.units import factor
from heliosweep.errors import Problem, StudyError
from heliosweep.report import tables
from heliosweep.report.labels import axis_label, number_text

#: File of a result folder with the comparison.
FILE = "comparison.csv"
#: Maximum size of a table of published numbers.
MAX_BYTES, MAX_ROWS = 2 * 2**20, 10_000
#: Tolerance of numeric labels, and relative tolerance of a value exactly on the bound of a tolerance.
SAME, EDGE = 1e-9, 1e-12
#: The verdicts, as a table states them.
AGREES, DIFFERS = VERDICTS = ("agrees", "does not agree")
#: Names of units in results and in tables, by the names of `config.units`.
_SPELLINGS = {
    "%": ("percent",),
    "deg": ("degree", "degrees", "degrees_north", "degrees_east"),
    "d": ("day", "days"),
    "h": ("hour", "hours"),
}
_HOUSE = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}
_NEEDED = ("quantity", "published", "unit", "tolerance")
_COMPUTED = ("computed", "difference", "verdict")
_STATED = ("stated_computed", "stated_verdict")
#: Columns of a table that are no coordinates of the result.
_COLUMNS = {
    "quantity": Column("variable of the result", required=True),
    "published": Column("the number as it was printed", required=True),
    "unit": Column("its unit, such as 1, percent, deg or m", required=True),
    "tolerance": Column("maximum difference of a computed value that agrees", required=True),
    "claim": Column("figure, table or sentence of the publication"),
    "reason": Column("reason of the tolerance"),
    "computed": Column("computed value, as the table states it"),
    "verdict": Column("verdict, as the table states it"),
}


@dataclass(frozen=True)
class Comparison:
    """One published number and the computed value.

    Parameters
    ----------
    quantity : str
        Variable of the result.
    where : dict of str to str
        Coordinates, as the table of published numbers writes them.
    computed : float
        Computed value; NaN before `compare`. [`unit`]
    published, tolerance : float
        Published number and maximum difference. [`unit`]
    unit : str
        Unit, such as ``1``, ``percent``, ``deg``.
    decimals : int
        Number of published decimals.
    claim, reason : str
        Place in the publication; reason of the tolerance.
    stated_computed, stated_verdict : str
        Computed value and verdict, as the table states them; empty if it does not.
    line : int
        Line of the table, from 1.
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
        """Published number, as it was printed."""
        return f"{self.published:.{self.decimals}f}"

    @property
    def difference(self) -> float:
        """Computed minus published. [`unit`]"""
        return self.computed - self.published

    @property
    def agrees(self) -> bool:
        """True if the difference is within the tolerance; False for a missing value."""
        return abs(self.difference) <= self.tolerance + EDGE * max(abs(self.published), self.tolerance)

    @property
    def verdict(self) -> str:
        """``agrees`` or ``does not agree``."""
        return AGREES if self.agrees else DIFFERS

    @property
    def found(self) -> str:
        """Computed value, for readers."""
        counts = math.ceil(-math.log10(self.tolerance)) if self.tolerance else 0
        return number_text(self.computed, max(self.decimals, counts) + 1)

    @property
    def surprise(self) -> str:
        """Difference between the statement of the table and the comparison; empty if there is none."""
        computed, verdict = self.stated_computed, self.stated_verdict
        if verdict and verdict != self.verdict:
            return f"the table states {verdict!r}, but it {self.verdict}"
        if not computed:
            return ""
        mantissa, _, exponent = computed.lower().partition("e")
        digits = len(mantissa.partition(".")[2])
        known = float(computed) if _is_number(computed) else math.nan
        same = abs(known - self.computed) <= 1.01 * 10.0 ** (int(exponent or 0) - digits)
        return "" if same else f"the table states {computed} as computed, but the result has {self.found}"


@dataclass(frozen=True)
class Compared:
    """Published numbers in the order of their table, their source, and the name of the file for messages."""

    values: list[Comparison]
    source: str
    file: str = field(default="", compare=False)

    @property
    def known(self) -> int:
        """Number of published values."""
        return len(self.values)

    @property
    def agrees(self) -> bool:
        """True if all values agree."""
        return all(one.agrees for one in self.values)

    @property
    def explained(self) -> bool:
        """True if every value that does not agree has a reason, and the table states its verdict."""
        return all(one.reason and one.stated_verdict in ("", DIFFERS) for one in self.values if not one.agrees)

    @property
    def summary(self) -> str:
        """One line: number of values that agree, and the largest difference of each unit."""
        largest = []
        for unit in dict.fromkeys(one.unit for one in self.values):
            differences = [abs(one.difference) for one in self.values if one.unit == unit]
            most = max(filter(math.isfinite, differences), default=math.nan)
            suffix = "" if unit == "1" else f" {unit}"
            largest.append(f"{most:.3f} percentage points" if unit == "percent" else f"{most:.3g}{suffix}")
        count = sum(one.agrees for one in self.values)
        text = f"{count} of {len(self.values)} published values agree"
        if not self.agrees and self.explained:
            text += ", the others are explained"
        return f"{text}; largest difference {' and '.join(largest)}" if largest else text

    @property
    def surprises(self) -> list[str]:
        """Differences from the statements of the table."""
        known = [(one, one.surprise) for one in self.values]
        return [f"{one.claim or ' '.join([one.quantity, *one.where.values()])}: {text}" for one, text in known if text]

    @property
    def coordinates(self) -> list[str]:
        """Names of all coordinates of the numbers."""
        return list(dict.fromkeys(name for one in self.values for name in one.where))

    def table(self, result: xr.Dataset) -> tables.Table:
        """Return the table for readers, a row for each number."""
        names = self.coordinates
        head = {name: axis_label(result[name]) if name in result.coords else name for name in names}
        words = {"claim": [one.claim for one in self.values], "reason": [one.reason for one in self.values]}
        columns = [tables.Column("quantity", [one.quantity.replace("_", " ") for one in self.values])]
        columns += [tables.Column(head[name], [one.where.get(name, "") for one in self.values]) for name in names]
        columns += [
            tables.Column("computed", [one.found for one in self.values]),
            tables.Column("published", [one.text for one in self.values]),
            tables.Column("difference", [number_text(one.difference, one.decimals + 1, True) for one in self.values]),
            tables.Column("tolerance", [f"{one.tolerance:g}" for one in self.values]),
            tables.Column("unit", ["%" if one.unit == "percent" else one.unit for one in self.values]),
            tables.Column("verdict", [one.verdict for one in self.values]),
        ]
        first, last = ([tables.Column(key, words[key])] if any(words[key]) else [] for key in words)
        note = "Difference: computed minus published, in percentage points if the unit is %."
        classes = [AGREES if one.agrees else "differs" for one in self.values]
        every = [*first, *columns[:-1], *last, columns[-1]]
        return tables.Table("Computed and published", every, [note], classes=classes)


def read_published(path: Path, source: str = "", name: str = "") -> Compared:
    """Read published numbers from a CSV table.

    Parameters
    ----------
    path : pathlib.Path
        Table with columns ``quantity``, ``published``, ``unit`` and ``tolerance`` (in the same unit), and optionally
        ``claim``, ``reason``, ``computed`` and ``verdict``; every other column is a coordinate of the result.
    source : str
        Source of the numbers.
    name : str
        Name of the file in messages; `path` by default.

    Raises
    ------
    StudyError
        If the file cannot be read or is no such table; lists every problem with its line.
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
    values = []
    for row, line in enumerate(table.lines.tolist()):
        cells = {key: column[row] for key, column in texts.items()}

        def wrong(key: str, message: str, row: int = row) -> None:
            table.add(f"{key} {message}", row, key if key in texts else None)

        values.append(_row(cells, line, wrong))
    table.finish()
    return Compared(values, source, file)


def _row(cells: dict[str, str], line: int, wrong: Callable[[str, str], None]) -> Comparison:
    """Return one row of a table; calls `wrong` for each problem."""
    numbers = {"published": math.nan, "tolerance": 0.0}
    for key in _NEEDED:
        if not cells[key]:
            wrong(key, "is empty")
        elif key in numbers and not (_is_number(cells[key]) and math.isfinite(float(cells[key]))):
            wrong(key, f"must be a finite number (got {cells[key][:40]!r})")
        elif key in numbers:
            numbers[key] = float(cells[key])
    if numbers["tolerance"] < 0:
        wrong("tolerance", f"must be at least 0 (got {cells['tolerance'][:40]!r})")
    claim, reason, verdict = (cells.get(key, "") for key in ("claim", "reason", "verdict"))
    if verdict and verdict not in VERDICTS:
        wrong("verdict", f"must be {one_of(VERDICTS)} (got {verdict[:40]!r})")
    decimals = len(cells["published"].lower().partition("e")[0].partition(".")[2])
    where = {key: cell for key, cell in cells.items() if key not in _COLUMNS and cell}
    return Comparison(
        cells["quantity"],
        where,
        math.nan,
        numbers["published"],
        numbers["tolerance"],
        cells["unit"],
        decimals,
        claim,
        reason,
        cells.get("computed", ""),
        verdict,
        line,
    )


def compare(result: xr.Dataset, table: Compared) -> Compared:
    """Compare published numbers with a result. Raises StudyError as `locate` does."""
    values = []
    for one, (point, scale) in zip(table.values, locate(result, table), strict=True):
        array = result[one.quantity].isel(point)
        values.append(replace(one, computed=float(array) * scale))
    return replace(table, values=values)


def locate(result: xr.Dataset, table: Compared) -> list[tuple[dict[str, int], float]]:
    """Return the position of each published number in a result, and the factor to its unit; reads coordinates only.

    Raises
    ------
    StudyError
        If a quantity or coordinate does not exist or is missing; lists every problem with its line.
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
        raise ValueError(f"unknown quantity {one.quantity!r}{_meant(one.quantity, result.data_vars)}")
    array = result[one.quantity]
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{one.quantity} is no number; compare dates and words in Python")
    masks = {str(dim): np.ones(size, dtype=bool) for dim, size in array.sizes.items()}
    for name, text in one.where.items():
        if name not in result.coords:
            raise ValueError(f"unknown coordinate {name!r}{_meant(name, result.coords)}")
        coordinate = result[name]
        if coordinate.ndim > 1 or not set(coordinate.dims) <= set(masks):
            raise ValueError(
                f"{one.quantity} cannot be selected by {name!r}; it has {', '.join(masks) or 'no dimension'}"
            )
        same = _labelled(coordinate, text)
        if not same.any():
            values = coordinate.to_numpy().ravel()[:8]
            numbers = coordinate.dtype.kind in "fiu"
            length = 10 if coordinate.dtype.kind == "M" else None
            known = ", ".join(f"{value:g}" if numbers else str(value)[:length] for value in values)
            raise ValueError(f"{name} {text!r} is not in the result, which has {known}")
        if coordinate.ndim:
            masks[str(coordinate.dims[0])] &= same
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


def _labelled(coordinate: xr.DataArray, text: str) -> np.ndarray:
    """Return a mask of the label; dates are compared by the digits of the text."""
    values = np.atleast_1d(coordinate.to_numpy())
    if values.dtype.kind in "fiu":
        number = float(text) if _is_number(text) else math.nan
        return np.asarray(np.abs(values.astype(float) - number) <= SAME * max(1.0, abs(number)))
    words = values.astype("datetime64[s]").astype(str) if values.dtype.kind == "M" else values.astype(str)
    return np.array([word.startswith(text) if values.dtype.kind == "M" else word == text for word in words], dtype=bool)


def _meant(name: str, known: object) -> str:
    names = list(map(str, known))  # type: ignore[call-overload]
    return did_you_mean(name, names) or f"; the result has {', '.join(names) or 'none'}"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def comparison_csv(compared: Compared) -> str:
    """Return the comparison as the text of `FILE`, with all digits."""
    names = compared.coordinates
    used = [name for name in ("claim", "reason") if any(getattr(one, name) for one in compared.values)]
    stated = [name for name in _STATED if any(getattr(one, name) for one in compared.values)]
    buffer = io.StringIO()
    buffer.writelines(f"# {line}\n" for line in compared.source.splitlines())
    table = csv.writer(buffer, lineterminator="\n")
    table.writerow([*used, *names, *_NEEDED, *_COMPUTED, *stated])
    for one in compared.values:
        first = [*(getattr(one, name) for name in used), *(one.where.get(name, "") for name in names)]
        numbers = [one.quantity, one.text, one.unit, repr(one.tolerance), repr(one.computed), repr(one.difference)]
        table.writerow([*first, *numbers, one.verdict, *(getattr(one, name) for name in stated)])
    return buffer.getvalue()


def read_comparison(path: Path) -> Compared:
    """Read the text of `comparison_csv`. Raises StudyError if the file is no such table."""
    table = read_published(path)
    values = []
    for one in table.values:
        where = {name: cell for name, cell in one.where.items() if name not in (*_COMPUTED, *_STATED)}
        number, verdict = (one.where.get(name, "") for name in _STATED)
        if not _is_number(one.stated_computed) or not one.stated_verdict:
            message = "is not a comparison written by heliosweep; remove it, or run the study again"
            raise StudyError(Problem(message, file=str(path)))
        computed = float(one.stated_computed)
        values.append(replace(one, computed=computed, where=where, stated_computed=number, stated_verdict=verdict))
    comments = [line[1:].strip() for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    return Compared(values, "\n".join(comments))

"""Comparison of computed values with published numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from heliosweep.config import HEADER, Column, did_you_mean, factor, one_of, read_table
from heliosweep.errors import Problem, StudyError
from heliosweep.report import tables
from heliosweep.report.figures import axis_label, number_text

#: Name of the comparison file in a result folder.
FILE = "comparison.csv"
#: Maximum size [bytes] and maximum number of rows of a table of published numbers.
MAX_BYTES, MAX_ROWS = 2 * 2**20, 10_000
#: Tolerance for matching numeric labels, and relative rounding error that is accepted in tolerance checks.
SAME, EDGE = 1e-9, 1e-12
#: Possible verdicts in a table of published numbers.
AGREES, DIFFERS = VERDICTS = ("agrees", "does not agree")
#: Unit names in results and tables, mapped to the unit names in `config.values`.
_HOUSE = {
    "percent": "%",
    **dict.fromkeys(("degree", "degrees", "degrees_north", "degrees_east"), "deg"),
    **dict.fromkeys(("day", "days"), "d"),
    **dict.fromkeys(("hour", "hours"), "h"),
}
#: Columns of a comparison that are not coordinates of the result. The last two columns are not written to the file.
STORED = (
    *("quantity", "published", "unit", "tolerance", "computed", "difference", "verdict", "claim", "reason"),
    *("stated_computed", "stated_verdict", "found", "agrees"),
)
#: Columns of a table that are not coordinates of the result.
_COLUMNS = {
    "quantity": Column("variable of the result", required=True),
    "published": Column("published number, exactly as printed", required=True),
    "unit": Column("unit of the published number, such as 1, percent, deg or m", required=True),
    "tolerance": Column(
        "maximum difference for agreement",
        required=True,
        least=0,
        bounds="at least 0",
    ),
    "claim": Column("figure, table or sentence of the publication"),
    "reason": Column("reason for the tolerance"),
    "computed": Column("computed value stated in the table"),
    "verdict": Column("verdict stated in the table"),
}


@dataclass(frozen=True, eq=False)
class Compared:
    """Published numbers and the corresponding computed values, in table order.

    Parameters
    ----------
    values : pandas.DataFrame
        Table with one row for each published number and the line numbers as index. All columns contain text, except
        `tolerance` and the columns added by `judged`. The columns ``stated_computed`` and ``stated_verdict`` contain
        the computed value and the verdict stated in the table. Columns that are not in `STORED` are coordinates of the
        result.
    source : str
        Source of the published numbers.
    file : str
        Name of the file in messages.
    """

    values: pd.DataFrame
    source: str
    file: str = ""

    @property
    def coordinates(self) -> list[str]:
        """Names of the coordinates in the table."""
        return [str(name) for name in self.values if name not in STORED]

    @property
    def agrees(self) -> bool:
        """True if all computed values agree with the published numbers."""
        return bool(self.values["agrees"].all())

    @property
    def explained(self) -> bool:
        """True if the table gives a reason for each disagreement and does not state agreement instead."""
        differ = self.values[~self.values["agrees"]]
        return bool((differ["reason"].ne("") & differ["stated_verdict"].isin(("", DIFFERS))).all())

    @property
    def summary(self) -> str:
        """Summary line: number of values that agree, and largest difference in each unit."""
        differences = self.values["difference"].abs().replace(math.inf, math.nan)
        largest = [
            f"{most:.3f} percentage points" if unit == "percent" else f"{most:.3g} {unit}".removesuffix(" 1")
            for unit, most in differences.groupby(self.values["unit"], sort=False).max().items()
        ]
        text = f"{self.values['agrees'].sum()} of {len(self.values)} published values agree"
        text += ", the others are explained" * (not self.agrees and self.explained)
        return f"{text}; largest difference {' and '.join(largest)}" if largest else text

    @property
    def surprises(self) -> list[str]:
        """Messages about computed values and verdicts that differ from the table."""
        lines = []
        for row in self.values.to_dict("records"):
            stated, verdict = row["stated_computed"], row["stated_verdict"]
            name = row["claim"] or " ".join([row["quantity"], *(row[key] for key in self.coordinates if row[key])])
            if verdict not in ("", row["verdict"]):
                lines.append(f"{name}: the table states {verdict!r}, but it {row['verdict']}")
            elif stated and not abs(float(stated) - row["computed"]) <= 1.01 * 10.0 ** -_decimals(stated):
                lines.append(f"{name}: the table states {stated} as computed, but the result has {row['found']}")
        return lines

    def table(self, result: xr.Dataset) -> tables.Table:
        """Return a formatted table with one row for each published number."""
        labels = {name: axis_label(result[name]) if name in result.coords else name for name in self.coordinates}
        heads = {"claim": "claim", "quantity": "quantity", **labels, "found": "computed"}
        heads |= {name: name for name in ("published", "difference", "tolerance", "unit", "reason", "verdict")}
        texts = self.values.assign(
            quantity=self.values["quantity"].str.replace("_", " "),
            difference=[
                number_text(difference, max(_decimals(text), 0) + 1, True)
                for difference, text in zip(self.values["difference"], self.values["published"], strict=True)
            ],
            tolerance=self.values["tolerance"].map("{:g}".format),
            unit=self.values["unit"].replace("percent", "%"),
        )
        columns = tables.columns_of([*heads.values()], texts[[*heads]].to_numpy().tolist())
        note = "The difference is the computed minus the published value, in percentage points if the unit is %."
        classes = [AGREES if agrees else "differs" for agrees in self.values["agrees"]]
        return tables.Table("Computed and published", columns, [note], classes=classes)


def _decimals(text: str) -> int:
    """Return the number of decimals of a printed number, for example -2 for ``1.5e3``."""
    mantissa, _, exponent = text.lower().partition("e")
    return len(mantissa.partition(".")[2]) - int(exponent or 0)


def judged(values: pd.DataFrame, computed: Iterable[float]) -> pd.DataFrame:
    """Add computed values, formatted values (`found`), differences and verdicts to published numbers."""
    values = values.assign(computed=np.array([*computed], dtype=float))
    published, tolerance = values["published"].astype(float), values["tolerance"]
    difference = values["computed"] - published
    agrees = difference.abs() <= tolerance + EDGE * np.maximum(published.abs(), tolerance)
    decimals = [
        max(0, _decimals(text), math.ceil(-math.log10(limit)) if limit else 0)
        for text, limit in zip(values["published"], tolerance, strict=True)
    ]
    found = [number_text(value, 1 + count) for value, count in zip(values["computed"], decimals, strict=True)]
    return values.assign(found=found, difference=difference, agrees=agrees, verdict=np.where(agrees, AGREES, DIFFERS))


def read_published(path: Path, source: str = "", name: str = "") -> Compared:
    """Read published numbers from a CSV table.

    Parameters
    ----------
    path : pathlib.Path
        Table with the columns ``quantity``, ``published``, ``unit`` and ``tolerance`` (in the same unit). The columns
        ``claim``, ``reason``, ``computed`` and ``verdict`` are optional. Every other column is a coordinate of the
        result.
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
    values = pd.DataFrame({key: table.texts(key) for key in table.header}, index=table.lines)
    values = values.reindex(columns=[*dict.fromkeys([*values, *_COLUMNS])], fill_value="")
    for key in ("quantity", "unit"):
        for row in np.flatnonzero(values[key] == "").tolist():
            table.add(f"{key} is empty", row, key)
    for row in np.flatnonzero(~values["verdict"].isin(("", *VERDICTS))).tolist():
        table.add(f"verdict must be {one_of(VERDICTS)} (got {values['verdict'].iloc[row][:40]!r})", row, "verdict")
    table.column("published")
    values["tolerance"] = table.column("tolerance")
    table.finish()
    return Compared(values.rename(columns={key: f"stated_{key}" for key in ("computed", "verdict")}), source, file)


def compare(result: xr.Dataset, table: Compared) -> Compared:
    """Compare published numbers with a result. Raises the same errors as `locate`."""
    places = zip(table.values["quantity"], locate(result, table), strict=True)
    computed = (float(result[name].isel(point)) * scale for name, (point, scale) in places)
    return replace(table, values=judged(table.values, computed))


def locate(result: xr.Dataset, table: Compared) -> list[tuple[dict[str, int], float]]:
    """Return the position and the unit conversion factor of each published number.

    Raises
    ------
    StudyError
        If a published number does not match exactly one value of the result, or if its unit is not compatible with the
        unit of the result. The message lists every problem with its line number.
    """
    found, problems = [], []
    for line, row in zip(table.values.index.tolist(), table.values.to_dict("records"), strict=True):
        labels = {name: row[name] for name in table.coordinates if row[name]}
        try:
            found.append(_locate(result, row["quantity"], row["unit"], labels))
        except ValueError as error:
            problems.append(Problem(str(error), file=table.file, line=line))
    if problems:
        raise StudyError(problems)
    return found


def _locate(result: xr.Dataset, quantity: str, unit: str, labels: Mapping[str, str]) -> tuple[dict[str, int], float]:
    if quantity not in result.data_vars:
        raise ValueError(f"unknown quantity {quantity!r}{_hint(quantity, result.data_vars)}")
    array = result[quantity]
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{quantity} is not numeric; compare dates and text in Python")
    masks = {str(dim): np.ones(size, dtype=bool) for dim, size in array.sizes.items()}
    for name, text in labels.items():
        same = _labelled(result, array, name, text)
        if same.ndim:
            masks[str(result[name].dims[0])] &= same
    for dim, mask in masks.items():
        if mask.sum() > 1:
            raise ValueError(f"{dim!r} is missing: {quantity} has {mask.sum()} values along it")
        if not mask.any():
            raise ValueError(f"no point of {quantity} has all of {labels}")
    own = str(array.attrs.get("units", "1"))
    try:
        scale = 1.0 if own == unit else factor(_HOUSE.get(own, own), _HOUSE.get(unit, unit))
    except ValueError:
        raise ValueError(f"{quantity} is in {own}, which cannot be converted to {unit!r}") from None
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
    """Format a coordinate value as a label. Dates are cut to `letters` characters."""
    if isinstance(value, np.datetime64):
        return str(value.astype("datetime64[s]"))[:letters]
    return f"{value:g}" if isinstance(value, np.number) else str(value)


def _hint(name: str, known: Iterable[Any]) -> str:
    return did_you_mean(name, known) or f"; the result has {', '.join(map(str, known)) or 'none'}"


def comparison_csv(compared: Compared) -> str:
    """Return the content of ``comparison.csv``, with all digits of the computed values."""
    notes = "".join(f"# {line}\n" for line in compared.source.splitlines())
    values = compared.values[[*compared.coordinates, *STORED[:-2]]]
    return notes + values.to_csv(index=False, lineterminator="\n", na_rep="nan")


def read_comparison(path: Path) -> Compared:
    """Read a comparison written by `comparison_csv`. Raises StudyError if the format is different."""
    lines = path.read_text(encoding="utf-8").splitlines()
    source = [line[1:].strip() for line in lines if line.startswith("#")]
    try:
        values = pd.read_csv(path, skiprows=len(source), dtype=str, keep_default_na=False)
        values = judged(values.astype({"tolerance": float}), values["computed"].astype(float))
        return Compared(values[[*values.columns.difference([*STORED], sort=False), *STORED]], "\n".join(source))
    except (KeyError, ValueError):
        message = "is not a comparison written by heliosweep; remove it, or run the study again"
        raise StudyError(Problem(message, file=str(path))) from None

"""Tables of headline numbers: the errors that a calibration found, and how often mounts with drawn errors hit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.families.misalignment import report_views as views
from heliosweep.families.misalignment import report_words as wording
from heliosweep.families.misalignment.report_calibration import PARAMETER, best, parameter_name
from heliosweep.families.misalignment.report_views import HELIOSTAT, Point, at
from heliosweep.families.registry import Table
from heliosweep.report.labels import NOTHING, flag_text, is_flag, number_text
from heliosweep.report.selection import evenly

#: Rows of one table.
MOST_ROWS = 40

#: Variables beside the errors, what their columns are called, and decimals.
_BESIDE = (
    ("spots_used", "spots", 0),
    ("condition_number", "condition number", 1),
    ("residual_rms", "residual rms (m)", 3),
    ("leave_one_out_rms", "leave-one-out rms (m)", 3),
    ("least_known_direction", "least known", 0),
    ("calibration_status", "status", 0),
)


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Tables of a result; none where its variables have numbers of the whole.

    Parameters
    ----------
    result : xarray.Dataset
        From `heliosweep.open_result`.

    Yields
    ------
    Table
    """
    for make in (_calibration, _drawn):
        yield from make(result)


def _calibration(result: xr.Dataset) -> Iterator[Table]:
    """Errors found with their standard errors, a row for each heliostat and point of the sweep."""
    if not {"estimated_error", "standard_error"} <= set(result.data_vars):
        return
    array = result["estimated_error"]
    if PARAMETER not in array.dims or HELIOSTAT not in array.dims:
        return
    shown = [dim for dim in views.swept(result, "estimated_error") if dim != "sample"]
    if np.prod([result.sizes[dim] for dim in (*shown, HELIOSTAT)]) > MOST_ROWS:
        shown = []
    stands = {
        **views.fixed(result, "estimated_error", PARAMETER, HELIOSTAT, *shown),
        **best(result, "estimated_error", *shown),
    }
    points, note = _rows(result, [*shown, HELIOSTAT])
    known = [i for i in range(result.sizes[PARAMETER]) if at(array, stands, {PARAMETER: i}).notnull().any()]
    beside = [(result[name], title, decimals) for name, title, decimals in _BESIDE if name in result]
    errors, others = [], []
    for point in points:
        found, error = (at(result[name], stands, point).to_numpy() for name in ("estimated_error", "standard_error"))
        names = _names(result, point)
        errors.append(names + [_with_error(found[i], error[i]) for i in known])
        values = [float(at(other, stands, point)) for other, *_ in beside]
        cells = [
            flag_text(other, value) if is_flag(other) else number_text(value, decimals)
            for value, (other, _, decimals) in zip(values, beside, strict=True)
        ]
        others.append(names + cells)
    head = [_title(result, dim) for dim in (*shown, HELIOSTAT)]
    first = range(len(head))
    notes = [f"Errors found \N{PLUS-MINUS SIGN} their standard errors.{note}{wording.note(result, stands)}"]
    if known:
        titles = [f"{parameter_name(result, i)} (mrad)" for i in known]
        yield Table("Mount errors found", [*head, *titles], errors, frozenset(first), notes)
    if beside:
        words = {*first, *(len(head) + i for i, (other, *_) in enumerate(beside) if is_flag(other))}
        titles = [title for _, title, _ in beside]
        yield Table("How well they are known", [*head, *titles], others, frozenset(words), [] if known else notes[1:])


def _drawn(result: xr.Dataset) -> Iterator[Table]:
    """Hits of drawn mounts over each day, of all heliostats and of the worst; spread of their spots."""
    if not {"day_hit_fraction", "spot_y_variance", "spot_z_variance"} <= set(result.data_vars):
        return
    hits = result["day_hit_fraction"]
    if HELIOSTAT not in hits.dims:
        return
    dims = [str(dim) for dim in hits.dims if dim != HELIOSTAT]
    several = result.sizes[HELIOSTAT] > 1
    points, note = _rows(result, dims)
    rows = []
    for point in points:
        values = 100 * at(hits, point).to_numpy()
        known = np.isfinite(values)
        row = [*_names(result, point), number_text(float(values[known].mean()), 1) if known.any() else NOTHING]
        if several:
            worst = int(np.nanargmin(values)) if known.any() else 0
            row.append(number_text(float(values[worst]), 1))
            differ = known.any() and values[worst] < values[known].max()
            row.append(wording.heliostat_text(result, {**point, HELIOSTAT: worst}) if differ else NOTHING)
        for name in ("spot_y_variance", "spot_z_variance"):
            spread = at(result[name], point).to_numpy()
            spread = spread[np.isfinite(spread)]
            row.append(number_text(float(np.sqrt(np.median(spread))), 2) if spread.size else NOTHING)
        rows.append(row)
    head = [*(_title(result, dim) for dim in dims), "spots inside (%)"]
    head += ["of the worst heliostat (%)", "worst heliostat"] if several else []
    head += ["spread to the right (m)", "spread upwards (m)"]
    words = {*range(len(dims)), *([len(dims) + 2] if several else [])}
    among = f", mean of {result.sizes[HELIOSTAT]:,} heliostats" if several else ""
    said = (
        f"Spots inside: part of all draws and hours with sun in which the centre of the beam is inside the "
        f"aperture{among}. Spread: standard deviation over the draws, median over "
        f"{'heliostats and ' if several else ''}hours.{note}"
    )
    yield Table("Hits of mounts with drawn errors", head, rows, frozenset(words), [said])


def _rows(result: xr.Dataset, dims: Sequence[str]) -> tuple[list[Point], str]:
    """At most so many points along dimensions, and the sentence that says of how many."""
    sizes = [result.sizes[dim] for dim in dims]
    total = int(np.prod(sizes, dtype=np.int64))
    kept = evenly(total, MOST_ROWS) if total > MOST_ROWS else range(total)
    points = [
        {dim: int(i) for dim, i in zip(dims, np.unravel_index(index, sizes), strict=True)} if dims else {}
        for index in map(int, kept)
    ]
    return points, f" Shown are {len(points)} of {total:,} rows; all are in the data set." if total > len(
        points
    ) else ""


def _names(result: xr.Dataset, point: Point) -> list[str]:
    return [
        wording.heliostat_text(result, point) if dim == HELIOSTAT else wording.short(result, dim, index)
        for dim, index in point.items()
    ]


def _title(result: xr.Dataset, dim: str) -> str:
    return "heliostat" if dim == HELIOSTAT else wording.title(result, dim)


def _with_error(value: float, error: float) -> str:
    """A number with its standard error, to two digits of that."""
    if not np.isfinite(value):
        return NOTHING
    known = np.isfinite(error) and error > 0
    decimals = int(np.clip(1 - np.floor(np.log10(error)), 0, 4)) if known else 3
    return f"{number_text(value, decimals)} \N{PLUS-MINUS SIGN} {number_text(error, decimals)}"

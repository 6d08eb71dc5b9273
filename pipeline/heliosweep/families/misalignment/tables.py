"""Tables of calibrations, and of mounts with drawn errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.figures import HELIOSTAT
from heliosweep.report.context import Context, at
from heliosweep.report.labels import flag_text, is_flag, printed, unit_of
from heliosweep.report.tables import Column, Table

_ERRORS, _SPREAD, _PARAMETER = "estimated_error", "standard_error", "parameter"
#: Maximum number of rows with a row for each point of the sweep; else the last point of each dimension has rows.
_MOST_ROWS = 60
_TYPICAL = {"parameters": 99, "days_used": 99}
#: Variables behind the errors, and the headings of their columns.
_QUALITY = {
    "spots_used": "spots",
    "crossings_used": "crossings",
    "condition_number": "condition number",
    "residual_rms": "residual rms",
    "leave_one_out_rms": "leave-one-out rms",
    "uncalibrated_beam_residual_rms": "beam residual without calibration",
    "beam_residual_rms": "beam residual with calibration",
    "least_known_direction": "least known error",
    "calibration_status": "status",
}


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Yield the errors that a calibration finds, or the hits of drawn mounts; nothing for other results."""
    if {_ERRORS, _SPREAD} <= set(result.data_vars) and HELIOSTAT in result[_ERRORS].dims:
        yield _calibration(result)
    if {"day_hit_fraction", "spot_y_variance", "spot_z_variance"} <= set(result.data_vars):
        yield _mount_errors(result)


def _points(result: xr.Dataset, dims: Sequence[str]) -> list[dict[str, int]]:
    sizes = [result.sizes[dim] for dim in dims]
    return [dict(zip(dims, map(int, index), strict=True)) for index in np.ndindex(*sizes)]


def _keys(context: Context, dims: Sequence[str], points: Sequence[dict[str, int]]) -> list[Column]:
    return [Column(context.title(dim), [context.value(dim, point[dim]) for point in points]) for dim in dims]


def _calibration(result: xr.Dataset) -> Table:
    """Tabulate errors with standard errors and the quality of the fit, a row for each heliostat and point."""
    context, found = Context(result, _TYPICAL), result[_ERRORS]
    swept = [str(dim) for dim in found.dims if dim not in (_PARAMETER, HELIOSTAT, "sample") and found.sizes[dim] > 1]
    dims = [*swept, HELIOSTAT]
    if len(_points(result, dims)) > _MOST_ROWS:
        dims = [HELIOSTAT]
    fixed = context.fixed(found, _PARAMETER, *dims)
    points = _points(result, dims)
    columns = _keys(context, dims, points)
    for index, name in enumerate(result[_PARAMETER].to_numpy()):
        values, errors = ([float(at(result[one], fixed, point, {_PARAMETER: index})) for point in points]
                          for one in (_ERRORS, _SPREAD))  # fmt: skip
        if np.isfinite(values).any():
            columns.append(Column(str(name).replace("_", " "), values, unit_of(found), errors=errors))
    for name, title in _QUALITY.items():
        if name in result and set(result[name].dims) <= {*fixed, *dims}:
            numbers = [float(printed(at(result[name], fixed, point))) for point in points]
            words = [flag_text(result[name], value) for value in numbers] if is_flag(result[name]) else numbers
            columns.append(Column(title, words, unit_of(result[name])))
    return Table("Mount errors found, with standard errors", columns, [note] if (note := context.note(fixed)) else [])


def _mount_errors(result: xr.Dataset) -> Table:
    """Tabulate the hits of drawn mounts over each day, the worst heliostat, and the spread of the spots."""
    context, hits = Context(result), result["day_hit_fraction"]
    dims = [str(dim) for dim in hits.dims if dim != HELIOSTAT]
    points = _points(result, dims)[:_MOST_ROWS]
    many = [dim for dim in (HELIOSTAT,) if dim in hits.dims]
    mean, least = (100.0 * getattr(hits.where(np.isfinite(hits)), kind)(many) for kind in ("mean", "min"))
    columns = _keys(context, dims, points)
    columns.append(Column("spots inside, mean", [float(at(mean, point)) for point in points], "%"))
    if result.sizes.get(HELIOSTAT, 1) > 1:
        worst = hits.fillna(2.0).argmin(HELIOSTAT)
        columns.append(Column("spots inside, worst heliostat", [float(at(least, point)) for point in points], "%"))
        names = [context.value(HELIOSTAT, int(at(worst, point))) for point in points]
        columns.append(Column("worst heliostat", names))
    for side, word in (("y", "to the right"), ("z", "upwards")):
        spots = result[f"spot_{side}_variance"]
        spread = [float(np.sqrt(at(spots, point).median(skipna=True))) for point in points]
        columns.append(Column(f"spread {word}", spread, "m"))
    notes = (
        "Spots inside: part of all draws and hours with sun with the centre of the beam inside the aperture. Spread: "
        "standard deviation over the draws, median over heliostats and hours."
    )
    return Table("Hits of mounts with drawn errors", columns, [notes])

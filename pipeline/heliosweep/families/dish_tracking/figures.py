"""Figures for dishes, based on the figures and tables of Liu, Peng and Yan (2022)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.figures import Context, Curves, Figure, Grids, is_ordered

DIRECTION = "axis_tilt_direction"
_FACTOR = "effective_tracking_factor"
_OFFSETS = ("home_azimuth_offset", "home_elevation_offset")
#: Dimensions that do not belong to swept keys.
_OWN = ("date", "month", "time", "required_factor")
_TYPICAL = {DIRECTION: 0.0, **dict.fromkeys(_OFFSETS, 0.0), "axis_tilt": 0.1, "latitude": 30.0}
_DIRECTION = "Direction in which the foot of the azimuth axis leans: 0 south, 90 west."


def figures(result: xr.Dataset) -> Iterator[Figure]:
    """Yield the figures for a result, with the main figure first."""
    swept = [str(dim) for dim in result.sizes if dim not in _OWN and result.sizes[dim] > 1]
    over_dates = f"{_FACTOR}_mean_over_dates" in result
    factor = f"{_FACTOR}_mean_over_dates" if over_dates else _FACTOR
    days = result["date"].to_numpy().astype("datetime64[D]")
    when = f"on {days[0]}" if days.size == 1 else f"mean over {days.size} dates from {days.min()} to {days.max()}"
    places = tuple(dim for dim in swept if dim in ("site", "latitude", "longitude", "model"))
    errors = ("mean_tracking_error", "max_tracking_error")
    others = (f"{_FACTOR}_std_over_dates", f"{_FACTOR}_min", f"{_FACTOR}_max") if over_dates else errors
    for dim in sorted(swept, key=lambda dim: (dim != DIRECTION, dim in _OFFSETS)):
        directions = f"{_FACTOR}_mean_over_directions"
        if is_ordered(result, dim):
            title = f"Effective tracking factor against {Context(result).title(dim)}, {when}"
            lines = ("site", "latitude", "axis_tilt", *_OFFSETS) if dim == DIRECTION else (DIRECTION, *places)
            yield Curves(
                f"factor_over_{dim}", title, (factor, "energy_loss", *others), over=(dim,), lines=lines, at=_TYPICAL,
                notes=_DIRECTION * (DIRECTION in swept),
            )  # fmt: skip
        elif not over_dates and directions in result:
            title = f"Effective tracking factor by {dim}, mean over the tilt directions"
            bands = {directions: (f"{_FACTOR}_std_over_directions",)}
            notes = f"On {days[0]}. Bars: standard deviation over the directions."
            yield Curves(f"directions_over_{dim}", title, (directions,), over=(dim,), bands=bands, notes=notes)
    lines, monthly = (DIRECTION, *places), f"monthly_{_FACTOR}"
    first = next((dim for dim in (DIRECTION, *swept) if dim in swept and is_ordered(result, dim)), "none")
    by_mount: dict[str, Any] = {"lines": lines, "at": _TYPICAL}
    yield from (
        Grids("latitude_map", f"Effective tracking factor against latitude and tilt direction, {when}",
              (factor, f"{_FACTOR}_min"), over=("latitude", DIRECTION), at=_TYPICAL, notes=_DIRECTION),
        Grids("tracking_errors", f"Tracking error against the home position offsets, {when}",
              errors, over=_OFFSETS, at=_TYPICAL),
        Curves("factor_over_year", "Effective tracking factor on each date", (_FACTOR,), over=("date",),
               panels=places, **by_mount),
        Curves("factor_by_month", "Monthly mean of the effective tracking factor",
               (f"{monthly}_mean", f"{monthly}_mean_over_directions", f"{monthly}_std_over_directions"),
               over=("month",), bands={f"{monthly}_mean": (f"{monthly}_std",)},
               notes="Bands: standard deviation over the dates of the month.", **by_mount),
        Curves("extremes", "Dates of the lowest and the highest factor", ("date_of_min", "date_of_max"),
               over=(first,), lines=places, at=_TYPICAL),
        Curves("tolerable_axis_tilt",
               "Maximum tilt of the azimuth axis at which every date reaches the required factor",
               ("tolerable_axis_tilt",), over=("latitude", DIRECTION, *swept), lines=("required_factor",),
               panels=lines, at=_TYPICAL, notes=_DIRECTION),
        Curves("path_of_the_sun", "Sun path", ("azimuth_from_south", "solar_elevation"), over=("time",),
               lines=places, derive=_from_south,
               notes="Azimuth from south, positive to the west; universal time."),
        Curves("error_over_day", "Tracking error at each instant, in universal time", ("tracking_error",),
               over=("time",), panels=places, **by_mount),
    )  # fmt: skip


def _from_south(result: xr.Dataset) -> xr.Dataset:
    """Return the sun's azimuth measured from south, without jumps of 360 deg."""
    if "solar_azimuth" not in result:
        return result
    azimuth = result["solar_azimuth"]
    axis = azimuth.get_axis_num("time")
    turned = np.unwrap(azimuth.to_numpy() - 180.0, period=360.0, axis=axis)
    middle = np.median(turned, axis=axis, keepdims=True)
    attrs = {"units": "degree", "long_name": "azimuth of the sun from south"}
    return result.assign(
        azimuth_from_south=azimuth.copy(data=turned - 360.0 * np.round(middle / 360.0)).assign_attrs(attrs)
    )

"""What a reader may turn and switch in a result of the family."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from heliosweep.report.views import View, is_ordered, shown

_DIRECTION = "axis_tilt_direction"

#: Dimensions of dates, of requirements and of instants, which belong to views of their own.
_OWN = ("date", "month", "required_factor", "time")


def views(result: xr.Dataset) -> Iterator[View]:
    """Factors of months, of the year and of days, errors at instants, and tilts that can be tolerated."""
    names = shown(result)
    swept = [str(dim) for dim in result.sizes if dim not in _OWN and is_ordered(result, str(dim))]
    swept.sort(key=lambda dim: dim != _DIRECTION)
    lines = ("latitude", "site", "axis_tilt", "home_azimuth_offset")
    with_dim = {dim: [name for name in names if dim in result[name].dims] for dim in _OWN}
    yield View(
        "curves", "Tracking factor by month", with_dim["month"], ("month", *swept), (_DIRECTION, *lines), start=_TYPICAL
    )
    whole = [name for name in names if not set(_OWN) & set(result[name].dims)]
    order = sorted(whole, key=lambda name: not name.endswith("over_dates"))
    yield View("curves", "Tracking factor over all dates", order, swept, lines, start=_TYPICAL)
    if "time" in result.coords:
        yield View("curves", "Instants", with_dim["time"], ("time", *swept), (_DIRECTION, *lines), start=_TYPICAL)
    yield View("curves", "Days", with_dim["date"], ("date", *swept), (_DIRECTION, *lines), start=_TYPICAL)
    yield View(
        "curves",
        "Tilt that can be tolerated",
        with_dim["required_factor"],
        (*swept, "required_factor"),
        ("required_factor", *lines),
        start=_TYPICAL,
    )


_TYPICAL: dict[str, float | str] = {"latitude": 30.0, "axis_tilt": 0.3}

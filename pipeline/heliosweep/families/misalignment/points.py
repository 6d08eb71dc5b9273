"""Days and hours, heliostats and mounts of the points of a study, as the functions of all modes take them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from heliosweep.config.times import CivilTime, SolarTime, parse_timezone, to_utc
from heliosweep.families.family import Computation
from heliosweep.families.misalignment.blocks import MOUNTS
from heliosweep.grid.layout_axis import LayoutAxis
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.regions import Variable, flags
from heliosweep.grid.sun import DATE, PLACE, Instants, Label, sun_at, window_count, window_positions
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.spots.calibration import Mounts
from heliosweep.kernels.spots.receiver import Setting
from heliosweep.layouts.layout import Layout
from heliosweep.mounts import mounts_of

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.families.points import Point

#: Status of padding entries: layouts shorter than the longest.
NO_HELIOSTAT = -1
#: Axes of the receiver's plane.
SIDES = {"y": "to the right of the aim point", "z": "above the aim point"}
#: Keys of which a computed group has one value.
APART = ("sun.azimuth", "sun.elevation", "heliostats.pivot_height")
#: Keys that label a result even if they are not swept.
_LABELS = (
    *("site.latitude", "site.longitude", "sun.azimuth", "sun.elevation"),
    *(f"receiver.{key}" for key in ("azimuth", "tilt", "width", "height_extent", "height")),
    *(f"mount.{key}" for key in ("kind", "axis_azimuth", "mirror_offset", "axis_offset", "pedestal_height")),
    "heliostats.pivot_height",
)
_POSITIONS = {
    "x": "distance of the pivot east of the tower",
    "y": "distance of the pivot north of the tower",
    "z": "height of the pivot above the tower's base",
}
_DAY = {"long_name": "day of the year", "units": "1"}
_DECLINATION = {"long_name": "declination of the sun", "units": "degree"}
_HOUR = {"solar": "solar time of day", "civil": "wall-clock time of day"}


def computation(study: MisalignmentStudy) -> Computation:
    """Return the declaration of the mode of a study, with the labels and dimensions that all modes have."""
    made: Computation = import_module(f"{__package__}.{study.mode}").computation(study)
    attrs = {"sun_position": "as given"} if study.time is None else {}
    assert not callable(made.attrs)
    return replace(
        made,
        mode=study.mode,
        labels=(*_LABELS, *made.labels),
        dims={**days_and_hours(study), **made.dims},
        coordinates=lambda: {**_universal_times(study), **(made.coordinates() if made.coordinates else {})},
        attrs={**attrs, **made.attrs},
        layouts=None if study.layout is not None else Positions,
        split="heliostat",
    )


def instant_sizes(study: MisalignmentStudy) -> dict[str, int]:
    """Lengths of the dimensions of the days and the hours."""
    time = study.time
    if time is None:
        return {"day": 1, "hour": 1}
    if isinstance(time, SolarTime):
        name, days = ("day", time.days) if time.declination is None else ("declination", time.declination)
        assert days is not None
        return {name: len(days), "hour": time.count() // len(days)}
    start, stop, step = time.window_seconds()
    return {"date": len(time.date_list()), "hour": window_count((stop - start) / step, time.sampling)}


def days_and_hours(study: MisalignmentStudy) -> dict[str, Any]:
    """Labels of the days and the hours; lengths alone with a fixed sun."""
    sizes, time = instant_sizes(study), study.time
    if time is None:
        return sizes
    day = next(iter(sizes))
    if isinstance(time, CivilTime):
        dates, hours = np.array(time.date_list(), dtype="datetime64[ns]"), _wall_seconds(time) / 3600
        days: Any = dates, DATE
    else:
        declinations, hours = time.declinations(), time.solar_hours()
        days = (time.day_numbers(), _DAY) if declinations is None else (declinations, _DECLINATION)
    return {day: days, "hour": (hours, {"long_name": _HOUR[time.clock], "units": "h"})}


def _universal_times(study: MisalignmentStudy) -> dict[str, Any]:
    """Coordinate ``utc`` of the civil clock, along ``site`` if the clocks of sites differ."""
    if not isinstance(study.time, CivilTime):
        return {}
    tables = [wall_clock(study.time, zone) for zone in Parameters(study).timezones()]
    attrs, dims = {"long_name": "universal time"}, tuple(instant_sizes(study))
    if all(np.array_equal(table, tables[0], equal_nan=True) for table in tables):
        return {"utc": (dims, tables[0], attrs)}
    return {"utc": (("site", *dims), np.stack(tables), attrs)}


@lru_cache(maxsize=16)
def wall_clock(time: CivilTime, timezone: str) -> NDArray[np.datetime64]:
    """Universal time of each hour of each date on a wall clock, shape (dates, hours).

    NaT for hours that a change of the clock skips; of an hour that occurs twice, the first. Time zones are offsets
    such as ``+08:00`` or IANA names.
    """
    zone = parse_timezone(timezone)
    table = np.empty((len(time.date_list()), _wall_seconds(time).size), "datetime64[ns]")
    for row, date in zip(table, time.date_list(), strict=True):
        each = (to_utc(date, float(second), zone) for second in _wall_seconds(time))
        row[:] = [np.datetime64(utc.replace(tzinfo=None) if is_shown else "NaT", "ns") for utc, is_shown in each]
    return table


def _wall_seconds(time: CivilTime) -> Floats:
    """Hours of a date on the wall clock, in seconds from midnight."""
    start, stop, step = time.window_seconds()
    return start + step * window_positions((stop - start) / step, time.sampling)


def sun_of(point: Point) -> Floats:
    """Unit vectors to the sun at a point, day by day, shape (T, 3): east, north, up. [1]"""
    time = point.study.time
    if time is None:
        around, up = np.radians(point["sun.azimuth"]), np.radians(point["sun.elevation"])
        return np.array([[np.cos(up) * np.sin(around), np.cos(up) * np.cos(around), np.sin(up)]])
    return _civil_sun(time, point.timezone, *map(point.__getitem__, PLACE)) if time.clock == "civil" else point.sun


@lru_cache(maxsize=64)
def _civil_sun(time: CivilTime, timezone: str, *place: float | None) -> Floats:
    utc = Label(("time",), wall_clock(time, timezone).ravel(), {})
    return sun_at(Instants({"utc": utc}, "civil"), place)


class Positions(LayoutAxis):
    """Pivots at the positions of a study, east, north and up of the tower's base [m], as one layout."""

    def __init__(self, study: MisalignmentStudy) -> None:
        positions = study.heliostats.positions or ()
        self.dims, self._shape, self.size = (), (), len(positions)
        self._layouts = [Layout(*np.array(positions, np.float64).T)]

    def coordinates(self) -> dict[str, xr.DataArray]:
        """``heliostat``, ``x``, ``y`` and ``z``."""
        number = "number of the heliostat: its place among the positions, from 0"
        labels = {"heliostat": self.numbers.assign_attrs(long_name=number)}
        for name, meaning in _POSITIONS.items():
            labels[name] = self.column(name).assign_attrs(long_name=meaning, units="m")
        return labels


def values_of(point: Point, key: str, shape: tuple[int, ...] | None = None) -> NDArray[Any]:
    """Values of a key at the points of a group, 0 without any; of a shape, at the first points along each dimension."""
    value = point[key]
    whole = np.broadcast_to(0.0 if value is None else value, point.group)
    return (whole if shape is None else whole[tuple(map(slice, shape))]).ravel()


class Scene(NamedTuple):
    """Receiver, mounts, heliostats and sun of a group of P points."""

    setting: Setting
    """Receiver and mounts, shape (P,)."""
    sun: Floats
    """Unit vectors to the sun, shape (T, 3)."""
    pivots: Floats
    """Pivots relative to the tower's base, shape (H, 3). [m]"""
    numbers: NDArray[np.int64]
    """Numbers of the heliostats in the whole result, shape (H,)."""

    @classmethod
    def of(cls, point: Point, shape: tuple[int, ...] | None = None) -> Scene:
        """Return the scene of a point, or of a group of points of this shape."""

        def each(key: str) -> NDArray[Any]:
            return values_of(point, key, shape)

        layout = point.layout
        numbers = np.arange(len(layout))[point.part("heliostat")]
        pivots = np.stack([np.asarray(column, float)[numbers] for column in (layout.x, layout.y, layout.z)], axis=1)
        pivots[:, 2] += point["heliostats.pivot_height"] or 0.0
        setting = Setting(
            np.radians(each("receiver.azimuth")),
            np.radians(each("receiver.tilt")),
            0.5 * each("receiver.width"),
            0.5 * each("receiver.height_extent"),
            each("receiver.height"),
            codes_of(each("mount.kind"), MOUNTS),
            np.radians(each("site.latitude")),
            np.radians(each("mount.axis_azimuth")),
            *(each(f"mount.{key}") for key in ("mirror_offset", "axis_offset", "pedestal_height")),
        )
        return cls(setting, sun_of(point), pivots, numbers)

    def mounts(self, point: int = 0) -> Mounts:
        """Return the mounts of one of the points."""
        return mounts_of(self.setting, self.pivots, point)


def codes_of(names: Sequence[Any] | NDArray[Any], known: Mapping[str, str]) -> NDArray[np.int64]:
    """Numbers by which the kernels know names: their positions in a table of `blocks`."""
    order = list(known)
    return np.array([order.index(str(name)) for name in names], np.int64)


def coded(dims: tuple[str, ...], long_name: str, meanings: Mapping[int, str], comment: str = "") -> Variable:
    """Variable of codes, with -1 for padding entries of shorter layouts."""
    return replace(flags(dims, long_name, {NO_HELIOSTAT: "no_heliostat", **meanings}, comment), missing=NO_HELIOSTAT)

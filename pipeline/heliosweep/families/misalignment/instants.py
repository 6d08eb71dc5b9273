"""Days and hours as two axes, on the solar or the civil clock, and the sun at each of them."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from heliosweep.config.times import CivilTime, SolarTime, parse_timezone
from heliosweep.families.sun import site_of, sun_attributes, sun_vectors
from heliosweep.grid.axes import Grid
from heliosweep.grid.instants import DATE, Instants, solar_instants

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.config import MisalignmentStudy

_DAY = {"long_name": "day of the year", "units": "1"}
_DECLINATION = {"long_name": "declination of the sun", "units": "degree"}
_SOLAR_HOUR = {"long_name": "solar time of day", "units": "h"}
_WALL_HOUR = {"long_name": "wall-clock time of day", "units": "h"}


@dataclass(frozen=True)
class DayHours:
    """The instants of a study: every hour of every day.

    Parameters
    ----------
    sizes : dict of str to int
        Lengths of the two dimensions: ``day``, ``declination`` or ``date``, then ``hour``; with a sun that stands still
        ``day`` and ``hour`` of length 1.
    labels : dict of str to xarray.DataArray
        Their coordinates, and on the civil clock ``utc`` over both and, where sites' clocks differ, ``site``; none with
        a sun that stands still.
    flat : Instants, optional
        The same instants day by day along ``time``; None with a sun that stands still.
    """

    sizes: dict[str, int]
    labels: dict[str, xr.DataArray]
    flat: Instants | None

    @property
    def day(self) -> str:
        """Name of the dimension of the days."""
        return next(iter(self.sizes))

    @property
    def count(self) -> int:
        """Number of instants."""
        days, hours = self.sizes.values()
        return days * hours


def instant_sizes(study: MisalignmentStudy) -> dict[str, int]:
    """Lengths of the dimensions of the days and the hours, without making them."""
    time = study.time
    if time is None:
        return {"day": 1, "hour": 1}
    if isinstance(time, SolarTime):
        days = time.days if time.declination is None else time.declination
        assert days is not None
        name = "day" if time.declination is None else "declination"
        return {name: len(days), "hour": time.count() // len(days)}
    return {"date": len(time.date_list()), "hour": _wall_count(time)}


def day_hours(grid: Grid) -> DayHours:
    """The instants of a study over a slab of its grid."""
    study: MisalignmentStudy = grid.study  # type: ignore[assignment]
    sizes, time = instant_sizes(study), study.time
    if time is None:
        return DayHours(sizes, {}, None)
    if isinstance(time, SolarTime):
        declinations = time.declinations()
        outer = time.day_numbers() if declinations is None else declinations
        name = next(iter(sizes))
        labels = {
            name: xr.DataArray(outer, dims=name, attrs=_DAY if name == "day" else _DECLINATION),
            "hour": xr.DataArray(time.solar_hours(), dims="hour", attrs=_SOLAR_HOUR),
        }
        return DayHours(sizes, labels, solar_instants(time))
    # Made for all sites: whether sites share them must not depend on the slab.
    tables = [wall_clock(time, zone) for zone in Grid(study).timezones()]
    attrs = {"long_name": "universal time"}
    if all(np.array_equal(table, tables[0], equal_nan=True) for table in tables):
        utc = xr.DataArray(tables[0], dims=tuple(sizes), attrs=attrs)
    else:
        utc = xr.DataArray(np.stack(tables)[grid.part("site")], dims=("site", *sizes), attrs=attrs)
    dates = np.array(time.date_list(), dtype="datetime64[ns]")
    labels = {
        "date": xr.DataArray(dates, dims="date", attrs=DATE),
        "hour": xr.DataArray(_wall_seconds(time) / 3600, dims="hour", attrs=_WALL_HOUR),
        "utc": utc,
    }
    flat = xr.DataArray(utc.to_numpy().reshape(*utc.shape[:-2], -1), dims=(*utc.dims[:-2], "time"))
    return DayHours(sizes, labels, Instants({"utc": flat}, "civil"))


def sun_of(grid: Grid, instants: DayHours, chunks: Mapping[str, int]) -> xr.DataArray:
    """Unit vectors towards the sun over what it depends on, ``time`` (day by day) and ``xyz`` (east, north, up)."""
    if instants.flat is not None:
        return sun_vectors(site_of(grid), instants.flat, chunks)
    azimuth, elevation = xr.broadcast(grid.parameter("sun.azimuth"), grid.parameter("sun.elevation"))
    around, up = np.radians(azimuth.to_numpy()), np.radians(elevation.to_numpy())
    vectors = np.stack((np.cos(up) * np.sin(around), np.cos(up) * np.cos(around), np.sin(up)), axis=-1)
    return xr.DataArray(vectors[..., np.newaxis, :], dims=(*azimuth.dims, "time", "xyz"))


def instant_attributes(study: MisalignmentStudy) -> dict[str, str]:
    """What a result says of its sun and its sampling, as global attributes."""
    return {"sun_position": "as given"} if study.time is None else sun_attributes(study.time)


@lru_cache(maxsize=16)
def wall_clock(time: CivilTime, timezone: str) -> NDArray[np.datetime64]:
    """Universal time of each hour of each date on a wall clock.

    Parameters
    ----------
    time : CivilTime
        Dates, window and sampling.
    timezone : str
        An offset such as ``+08:00`` or an IANA name.

    Returns
    -------
    ndarray of datetime64[ns], shape (dates, hours)
        NaT where a change of the clock leaves out the hour; of an hour that occurs twice, the first.
    """
    zone = parse_timezone(timezone)
    seconds = _wall_seconds(time)
    table = np.empty((len(time.date_list()), seconds.size), "datetime64[ns]")
    for row, date in zip(table, time.date_list(), strict=True):
        midnight = dt.datetime.combine(date, dt.time())
        first, last = (midnight + dt.timedelta(seconds=float(end)) for end in (seconds[0], seconds[-1]))
        if _offset(first, zone) == _offset(last, zone):
            since = np.round((seconds - _offset(first, zone)) * 1e9).astype("timedelta64[ns]")
            row[:] = np.datetime64(midnight, "ns") + since
        else:
            row[:] = [_universal(midnight + dt.timedelta(seconds=float(second)), zone) for second in seconds]
    return table


def _universal(wall: dt.datetime, zone: dt.tzinfo) -> np.datetime64:
    utc = wall.replace(tzinfo=zone).astimezone(dt.UTC)
    there = utc.astimezone(zone).replace(tzinfo=None) == wall
    return np.datetime64(utc.replace(tzinfo=None), "ns") if there else np.datetime64("NaT", "ns")


def _offset(wall: dt.datetime, zone: dt.tzinfo) -> float:
    offset = wall.replace(tzinfo=zone).utcoffset()
    assert offset is not None
    return offset.total_seconds()


def _wall_count(time: CivilTime) -> int:
    start, stop, step = time.window_seconds()
    steps = (stop - start) / step
    if time.sampling == "left":
        return int(np.ceil(steps - 1e-9))
    return int(np.floor(steps + 1e-9)) + (time.sampling == "inclusive")


def _wall_seconds(time: CivilTime) -> NDArray[np.float64]:
    """Hours of a date on the wall clock, in seconds from midnight."""
    start, _, step = time.window_seconds()
    positions = np.arange(_wall_count(time), dtype=np.float64)
    return start + step * (positions + 0.5 if time.sampling == "midpoint" else positions)

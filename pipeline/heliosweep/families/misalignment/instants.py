"""Days and hours as two axes, on the solar or the civil clock, and the sun at each of them."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from heliosweep.config.times import CivilTime, SolarTime
from heliosweep.config.zones import parse_timezone, to_utc
from heliosweep.grid.clock import DATE, Instants, solar_instants, window_count, window_positions
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import PLACE, sun_at, sun_attributes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy

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
    start, stop, step = time.window_seconds()
    return {"date": len(time.date_list()), "hour": window_count((stop - start) / step, time.sampling)}


def day_hours(parameters: Parameters) -> DayHours:
    """The instants of a study over a region of its result."""
    study: MisalignmentStudy = parameters.study  # type: ignore[assignment]
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
    # Made for all sites: whether sites share them must not depend on the region.
    tables = [wall_clock(time, zone) for zone in Parameters(study).timezones()]
    attrs = {"long_name": "universal time"}
    if all(np.array_equal(table, tables[0], equal_nan=True) for table in tables):
        utc = xr.DataArray(tables[0], dims=tuple(sizes), attrs=attrs)
    else:
        utc = xr.DataArray(np.stack(tables)[parameters.part("site")], dims=("site", *sizes), attrs=attrs)
    dates = np.array(time.date_list(), dtype="datetime64[ns]")
    labels = {
        "date": xr.DataArray(dates, dims="date", attrs=DATE),
        "hour": xr.DataArray(_wall_seconds(time) / 3600, dims="hour", attrs=_WALL_HOUR),
        "utc": utc,
    }
    flat = xr.DataArray(utc.to_numpy().reshape(*utc.shape[:-2], -1), dims=(*utc.dims[:-2], "time"))
    return DayHours(sizes, labels, Instants({"utc": flat}, "civil"))


def sun_of(parameters: Parameters, instants: DayHours) -> NDArray[np.float64]:
    """Unit vectors towards the sun at every point of a region, shape (P or 1, T, 3): east, north, up; day by day."""
    if instants.flat is None:
        azimuth, elevation = parameters.values("sun.azimuth"), parameters.values("sun.elevation")
        assert azimuth is not None
        assert elevation is not None
        around, up = np.radians(azimuth.ravel()), np.radians(elevation.ravel())
        vectors = np.stack((np.cos(up) * np.sin(around), np.cos(up) * np.cos(around), np.sin(up)), axis=-1)
        return vectors[:, np.newaxis]
    dims = parameters.site_dims
    shape = tuple(length if dim in dims else 1 for dim, length in parameters.sizes.items())
    columns = [parameters.values(key) for key in PLACE]
    found = np.empty((*shape, instants.count, 3))
    for index in np.ndindex(shape):
        here = instants.flat.at_sites(index[list(parameters.sizes).index("site")]) if "site" in dims else instants.flat
        found[index] = sun_at(here, [None if column is None else float(column[index]) for column in columns])
    if any(length > 1 for length in shape):
        found = np.array(np.broadcast_to(found, (*parameters.sizes.values(), instants.count, 3)))
    return found.reshape(-1, instants.count, 3)


def instant_attributes(study: MisalignmentStudy) -> dict[str, str]:
    """Global attributes of a result that tell its sun and its sampling."""
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
        ends = [to_utc(date, float(second), zone) for second in (seconds[0], seconds[-1])]
        offsets = {utc.astimezone(zone).utcoffset() if is_shown else None for utc, is_shown in ends}
        offset = offsets.pop() if len(offsets) == 1 else None
        if offset is not None:
            since = np.round((seconds - offset.total_seconds()) * 1e9).astype("timedelta64[ns]")
            row[:] = np.datetime64(date, "ns") + since
        else:
            row[:] = [_shown(date, float(second), zone) for second in seconds]
    return table


def _shown(date: dt.date, seconds: float, zone: dt.tzinfo) -> np.datetime64:
    utc, is_shown = to_utc(date, seconds, zone)
    return np.datetime64(utc.replace(tzinfo=None) if is_shown else "NaT", "ns")


def _wall_seconds(time: CivilTime) -> NDArray[np.float64]:
    """Hours of a date on the wall clock, in seconds from midnight."""
    start, stop, step = time.window_seconds()
    return start + step * window_positions((stop - start) / step, time.sampling)

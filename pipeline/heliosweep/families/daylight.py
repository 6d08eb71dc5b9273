"""Whether the sun rises at all in a study: told before a run, with NumPy alone."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.sites import site_table
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import CivilTime, SolarTime, parse_timezone
from heliosweep.kernels import sun

#: Places times days that are looked at; of larger studies nothing is said here.
MAX_SUNS = 10**6
#: How far off the sun may be here on the civil clock: 4.3 deg for the equation of time, 1.7 deg for Cooper's
#: declination with the drift of the calendar from 1700 to 2200, and one to spare. [deg]
MARGIN = 7.0


class Place(NamedTuple):
    """A site, or all that a sweep of its latitude and longitude may combine."""

    latitudes: NDArray[np.float64]
    """Positive north, shape (latitude,). [deg]"""
    longitudes: NDArray[np.float64]
    """Positive east, shape (longitude,). [deg]"""
    timezone: str


def dark_latitudes(study: Study) -> tuple[NDArray[np.float64], bool]:
    """Latitudes at which the sun is down at every instant of a study.

    Parameters
    ----------
    study : Study
        With ``site`` or ``sites``, and ``time``; on the civil clock with longitudes and time zones.

    Returns
    -------
    latitudes : ndarray
        Those at which the sun surely never rises; on the civil clock there may be others. [deg]
    everywhere : bool
        Whether these are all latitudes of the study.
    """
    dark: list[NDArray[np.float64]] = []
    count = 0
    time: SolarTime | CivilTime = study.time  # type: ignore[attr-defined]
    for place in _places(study, time):
        height = _solar_height(time, place.latitudes) if isinstance(time, SolarTime) else _civil_height(time, place)
        dark.append(place.latitudes[height <= 0])
        count += place.latitudes.size
    latitudes = np.concatenate(dark) if dark else np.empty(0)
    return latitudes, 0 < count == latitudes.size


def _places(study: Study, time: SolarTime | CivilTime) -> Iterator[Place]:
    """Yield the places of a study; none if there are too many to look at."""
    single: Any = getattr(study, "site", None)
    sites = [single] if single is not None else site_table(study)
    clock = None if isinstance(time, SolarTime) else time.timezone
    suns = sum(_count(site.latitude) + _count(site.longitude) for site in sites) * _days(time)
    if suns > MAX_SUNS or (isinstance(time, SolarTime) and len(time.hours) > MAX_SUNS):
        return
    for site in sites:
        yield Place(_values(site.latitude), _values(site.longitude), clock or site.timezone or "+00:00")


def _days(time: SolarTime | CivilTime) -> int:
    if isinstance(time, CivilTime):
        return len(time.date_list())
    days = time.days if time.declination is None else time.declination
    return 0 if days is None else len(days)


def _solar_height(time: SolarTime, latitudes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sine of the highest elevation of the sun at each latitude, exactly."""
    declinations = time.declinations()
    days = sun.declination_cooper(time.day_numbers()) if declinations is None else np.radians(declinations)
    # Of all hours the sun is highest at the one nearest to noon.
    hours = time.solar_hours()
    noon = hours[np.abs(hours - 12).argmin()]
    return sun.solar_clock(np.radians(latitudes)[:, np.newaxis], days, noon)[..., 2].max(axis=1)


def _civil_height(time: CivilTime, place: Place) -> NDArray[np.float64]:
    """Sine of a bound of the highest elevation of the sun at each latitude, whatever the longitude."""
    dates = time.date_list()
    zone = parse_timezone(place.timezone)
    start, stop, _ = time.window_seconds()
    opens, closes = (
        np.array([_universal_hour(date, seconds, zone) for date in dates])[:, np.newaxis] + place.longitudes / 15
        for seconds in (start, stop)
    )
    holds_noon = opens + (12 - opens) % 24 <= closes
    ends = np.minimum(np.abs(opens % 24 - 12), np.abs(closes % 24 - 12))
    nearest = np.where(holds_noon, 0.0, ends).min(axis=1)  # hours between the window and noon, on each date
    declination = sun.declination_cooper([date.timetuple().tm_yday for date in dates])
    vectors = sun.solar_clock(np.radians(place.latitudes)[:, np.newaxis], declination, 12 + nearest)
    elevation = np.arcsin(np.clip(vectors[..., 2].max(axis=1), -1, 1))
    return np.sin(np.minimum(elevation + np.radians(MARGIN), np.pi / 2))


def _universal_hour(date: dt.date, seconds: float, zone: dt.tzinfo) -> float:
    """Hour of a wall-clock time in universal time, counted from midnight of the date."""
    wall = dt.datetime.combine(date, dt.time()) + dt.timedelta(seconds=seconds)
    offset = wall.replace(tzinfo=zone).utcoffset()
    assert offset is not None
    return (seconds - offset.total_seconds()) / 3600


def _count(value: float | Sweep | None) -> int:
    return len(value) if isinstance(value, Sweep) else 1


def _values(value: float | Sweep | None) -> NDArray[np.float64]:
    """Values of a key: all of a sweep, 0 where none is given."""
    return np.atleast_1d(np.asarray(value[:] if isinstance(value, Sweep) else value or 0.0, dtype=float))

"""Latitudes of a study without a sunrise, found before a run with NumPy alone."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.sites import places_of
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import CivilTime, SolarTime
from heliosweep.config.zones import parse_timezone, to_utc
from heliosweep.errors import Problem
from heliosweep.kernels.sun import clock as sun

#: Places times days that are looked at; of larger studies nothing is said here.
MAX_SUNS = 10**6
#: How far off the sun may be here on the civil clock: 4.3 deg for the equation of time, 1.7 deg for Cooper's
#: declination with the drift of the calendar from 1700 to 2200, and one to spare. [deg]
MARGIN = 7.0


def dark_latitudes(study: Study) -> tuple[NDArray[np.float64], bool]:
    """Latitudes at which the sun surely never rises in a study [deg], and whether these are all latitudes of the study.

    The study has ``site`` or ``sites``, and ``time``; on the civil clock with longitudes and time zones, and there may
    be other dark ones there.
    """
    sites = places_of(study)
    time: SolarTime | CivilTime = study.time  # type: ignore[attr-defined]
    suns = sum(_count(site.latitude) + _count(site.longitude) for site in sites) * _days(time)
    if not sites or suns > MAX_SUNS or (isinstance(time, SolarTime) and len(time.hours) > MAX_SUNS):
        return np.empty(0), False
    latitudes = [_values(site.latitude) for site in sites]
    heights = [
        _solar_height(time, here)
        if isinstance(time, SolarTime)
        else _civil_height(time, here, _values(site.longitude), time.timezone or site.timezone or "+00:00")
        for site, here in zip(sites, latitudes, strict=True)
    ]
    down = np.concatenate(heights) <= 0
    return np.concatenate(latitudes)[down], bool(down.all())


def dark_places(study: Study, missing: str) -> Iterator[Problem | str]:
    """Problem of a study without a sunrise, or a warning with the dark latitudes and the `missing` result."""
    dark, everywhere = dark_latitudes(study)
    if everywhere and isinstance(study.time, SolarTime):  # type: ignore[attr-defined]
        yield study.problem("time.hours", "the sun never rises at these latitudes, days and hours")
    elif everywhere:
        yield study.problem("time.window", "the sun never rises at these sites on these dates in this window")
    elif dark.size:
        listed = ", ".join(f"{value:g}" for value in dark[:6])
        more = f" and {dark.size - 6} more" if dark.size > 6 else ""
        yield f"the sun never rises at latitude {listed}{more} deg: {missing}"


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


def _civil_height(
    time: CivilTime, latitudes: NDArray[np.float64], longitudes: NDArray[np.float64], timezone: str
) -> NDArray[np.float64]:
    """Sine of a bound of the highest elevation of the sun at each latitude, at any of the longitudes."""
    dates = time.date_list()
    zone = parse_timezone(timezone)
    start, stop, _ = time.window_seconds()
    opens, closes = (
        np.array([_universal_hour(date, seconds, zone) for date in dates])[:, np.newaxis] + longitudes / 15
        for seconds in (start, stop)
    )
    holds_noon = opens + (12 - opens) % 24 <= closes
    ends = np.minimum(np.abs(opens % 24 - 12), np.abs(closes % 24 - 12))
    nearest = np.where(holds_noon, 0.0, ends).min(axis=1)  # hours between the window and noon, on each date
    declination = sun.declination_cooper([date.timetuple().tm_yday for date in dates])
    vectors = sun.solar_clock(np.radians(latitudes)[:, np.newaxis], declination, 12 + nearest)
    elevation = np.arcsin(np.clip(vectors[..., 2].max(axis=1), -1, 1))
    return np.sin(np.minimum(elevation + np.radians(MARGIN), np.pi / 2))


def night_share(study: Study) -> float:
    """Share of a study's instants on the civil clock at which the sun is below the horizon, to a few hundredths. [1]

    The estimate uses some of the places and dates, without the equation of time.
    """
    sites = places_of(study)
    time: CivilTime = study.time  # type: ignore[attr-defined]
    dates = _some(time.date_list())
    start, stop, _ = time.window_seconds()
    declination = sun.declination_cooper([date.timetuple().tm_yday for date in dates])[:, np.newaxis]
    shares = []
    for site in _some(sites):
        zone = parse_timezone(time.timezone or site.timezone or "+00:00")
        opens, closes = (np.array([_universal_hour(date, at, zone) for date in dates]) for at in (start, stop))
        hours = np.linspace(opens, closes, 145, axis=1)
        for latitude, longitude in product(_some(_values(site.latitude)), _some(_values(site.longitude))):
            up = sun.solar_clock(np.radians(latitude), declination, hours + longitude / 15)[..., 2]
            shares.append(np.mean(up < 0))
    return float(np.mean(shares))


def _some(values: Sequence[Any] | NDArray[np.float64]) -> Any:
    """Twelve of the values at the most, evenly picked."""
    return values[:: max(1, -(-len(values) // 12))]


def _universal_hour(date: dt.date, seconds: float, zone: dt.tzinfo) -> float:
    """Hour of a wall-clock time in universal time, counted from midnight of the date."""
    midnight = dt.datetime.combine(date, dt.time(), dt.UTC)
    return (to_utc(date, seconds, zone)[0] - midnight).total_seconds() / 3600


def _count(value: float | Sweep | None) -> int:
    return len(value) if isinstance(value, Sweep) else 1


def _values(value: float | Sweep | None) -> NDArray[np.float64]:
    """Return the values of a key: all values of a sweep, 0 without a value."""
    return np.atleast_1d(np.asarray(value[:] if isinstance(value, Sweep) else value or 0.0, dtype=float))

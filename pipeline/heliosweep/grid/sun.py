"""Instants of a study on its clock, the sun at its sites, and sites without a sunrise."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.sites import places_of
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import CivilTime, SolarTime, SunDirections, WeatherTime, parse_timezone, to_utc
from heliosweep.config.weather_files import WeatherFile, weather_files
from heliosweep.errors import Problem
from heliosweep.grid.parameters import Parameters
from heliosweep.kernels.sun import clock
from heliosweep.sun import direction, sun_vectors

#: More instants than this are planned for, but not made, before the plan has agreed.
MAX_INSTANTS = 10**7
#: Attributes of a coordinate of calendar dates.
DATE = {
    "long_name": "date at the site",
    "comment": (
        "date of the calendar in the time zone of the site; its midnight stands for it, without that zone's offset, "
        "so that sites of several zones share the dates"
    ),
    "axis": "T",
}


class Label(NamedTuple):
    """Values along dimensions, as a coordinate of a data set is given."""

    dims: tuple[str, ...]
    values: np.ndarray
    attrs: dict[str, str]

    def part(self, dim: str, span: slice | int) -> Label:
        """Return the values of a part of a dimension; all values if the label does not have the dimension."""
        if dim not in self.dims:
            return self
        values = self.values[(slice(None),) * self.dims.index(dim) + (span,)]
        kept = self.dims if isinstance(span, slice) else tuple(each for each in self.dims if each != dim)
        return Label(kept, values, self.attrs)


@dataclass(frozen=True)
class Instants:
    """The instants of a study, labelled along ``time``, on the clock ``solar``, ``civil``, ``weather`` or ``sun``.

    The labels are ``day`` or ``declination`` and ``solar_hour``, or ``utc`` (dimensions `dim` and ``time`` where the
    sites' clocks or the weather files differ), or the one ``instant`` of each direction of the sun. On the clock
    ``weather`` they are intervals: ``utc`` is the middle, ``hours`` the length of each.
    """

    labels: dict[str, Label]
    clock: str
    dim: str = "site"

    def coordinates(self) -> dict[str, Label]:
        """The labels as coordinates of a result; rising instants that all share are the coordinate ``time`` itself."""
        if self.clock == "sun":
            return {}
        labels = {name: label for name, label in self.labels.items() if name != "hours"}
        if "utc" in labels and labels["utc"].dims == ("time",):
            utc = labels["utc"]
            if np.all(np.diff(utc.values) > np.timedelta64(0)):
                clock = {"standard_name": "time", "units_metadata": "leap_seconds: none"}
                return {"time": utc._replace(attrs={**utc.attrs, **clock})}
        return labels

    def at_sites(self, part: slice | int) -> Instants:
        """The instants of some of the sites or weather files, or of one."""
        return replace(self, labels={name: label.part(self.dim, part) for name, label in self.labels.items()})

    def part(self, span: slice) -> Instants:
        """Some of the instants."""
        return replace(self, labels={name: label.part("time", span) for name, label in self.labels.items()})

    def thinned(self, count: int) -> Instants:
        """Some `count` of the instants at the most, evenly picked."""
        step = max(1, -(-self.size // count))
        return self.part(slice(None, None, step))

    @property
    def size(self) -> int:
        """Number of instants."""
        return next(iter(self.labels.values())).values.shape[-1]


def instant_count(time: SolarTime | CivilTime | SunDirections | WeatherTime) -> int:
    """Return the number of instants without creating them; changes to daylight-saving time do not count.

    Weather files count as hourly years: `sun.instants_of` reads their number of instants.
    """
    if isinstance(time, SunDirections):
        return 1
    if isinstance(time, WeatherTime):
        return 8760
    if isinstance(time, SolarTime):
        return time.count()
    start, stop, step = time.window_seconds()
    return len(time.date_list()) * window_count((stop - start) / step, time.sampling)


def solar_instants(time: SolarTime) -> Instants:
    """Return each hour of each day on the solar clock, day by day.

    The labels along ``time`` are ``day`` [1] or ``declination`` [deg], and ``solar_hour`` [h], sampled as in the study.
    """
    hours = time.solar_hours()
    declinations = time.declinations()
    outer: NDArray[Any]
    if declinations is None:
        name, outer = "day", time.day_numbers()
        attrs = {"long_name": "day of the year", "units": "1"}
    else:
        name, outer = "declination", declinations
        attrs = {"long_name": "declination of the sun", "units": "degree"}
    return Instants(
        {
            name: Label(("time",), np.repeat(outer, hours.size), attrs),
            "solar_hour": Label(
                ("time",), np.tile(hours, outer.size), {"long_name": "solar time of day", "units": "h"}
            ),
        },
        "solar",
    )


def direction_instant() -> Instants:
    """Return the single instant of a study with given sun directions."""
    return Instants({"instant": Label(("time",), np.zeros(1), {})}, "sun")


def weather_intervals(files: Sequence[WeatherFile], dim: str) -> Instants:
    """Return the intervals of weather files; several files are along the dimension `dim` of the result.

    ``utc``, the middle of each interval, and ``hours``, its length [h], are along ``time`` if all files share them,
    otherwise along (`dim`, ``time``), with NaT at the end of shorter files.
    """
    first = files[0]
    shared = all(file.hours == first.hours and np.array_equal(file.utc, first.utc) for file in files)
    rows = files[:1] if shared else files
    utc = np.full((len(rows), max(map(len, rows))), np.datetime64("NaT", "ns"))
    hours = np.zeros(utc.shape)
    for index, file in enumerate(rows):
        utc[index, : len(file)], hours[index, : len(file)] = file.utc, file.hours
    middle = {"long_name": "universal time", "comment": "middle of the interval of the weather file, of its own year"}
    length = {"long_name": "length of the interval", "units": "h"}
    dims, row = (("time",), 0) if shared else ((dim, "time"), slice(None))
    return Instants({"utc": Label(dims, utc[row], middle), "hours": Label(dims, hours[row], length)}, "weather", dim)


def civil_instants(time: CivilTime, timezones: list[str]) -> Instants:
    """Return each step of each date's window on the civil clock, in universal time, for the time zones of the sites.

    A window starts and stops at clock times and has equal steps of elapsed time, so that a window with a change of the
    clock is an hour shorter or longer. An end in the omitted hour is at the change; in a repeated hour, at its first
    occurrence.

    ``utc`` rises along ``time``, each instant once, if all sites share it; otherwise it is along (``site``, ``time``),
    with NaT at the end of sites with fewer instants.
    """
    rows = [np.unique(np.concatenate(daily_windows(time, zone))) for zone in timezones]
    attrs = {"long_name": "universal time"}
    if all(row.size == rows[0].size and bool(np.all(row == rows[0])) for row in rows):
        return Instants({"utc": Label(("time",), rows[0], attrs)}, "civil")
    table = np.full((len(rows), max(row.size for row in rows)), np.datetime64("NaT", "ns"))
    for index, row in enumerate(rows):
        table[index, : row.size] = row
    return Instants({"utc": Label(("site", "time"), table, attrs)}, "civil")


def civil_intervals(time: CivilTime, timezone: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the hours that each instant of `civil_instants` in a time zone represents, and the month of its date.

    They are one step, half a step at both ends of an inclusive window, and the sum for an instant of two windows.
    """
    pieces, step = daily_windows(time, timezone), time.window.step
    hours = [np.full(piece.size, step) for piece in pieces]
    if time.sampling == "inclusive":
        for each in hours:
            each[[0, -1]] -= step / 2
            each[-1] -= step / 2 if each.size == 1 else 0.0
    dates = np.repeat([date.month for date in time.date_list()], [piece.size for piece in pieces])
    _, first, where = np.unique(np.concatenate(pieces), return_index=True, return_inverse=True)
    return np.bincount(where, np.concatenate(hours)).astype(np.float64), dates[first]


@lru_cache(maxsize=16)
def daily_windows(time: CivilTime, timezone: str) -> list[NDArray[np.datetime64]]:
    """Instants of the window of each date in a time zone, in universal time and in the order of the study."""
    zone = parse_timezone(timezone)
    start, stop, step = time.window_seconds()
    pieces = []
    for date in time.date_list():
        opens, closes = (to_utc(date, seconds, zone)[0].timestamp() for seconds in (start, stop))
        seconds = opens + step * window_positions((closes - opens) / step, time.sampling)
        pieces.append(np.round(seconds * 1e9).astype(np.int64).view("datetime64[ns]"))
    return pieces


def window_count(steps: float, sampling: str) -> int:
    """Return the number of instants of a window of a number of steps, without effects of rounding."""
    if sampling == "left":
        return int(np.ceil(steps - 1e-9))
    return int(np.floor(steps + 1e-9)) + (sampling == "inclusive")


def window_positions(steps: float, sampling: str) -> NDArray[np.float64]:
    """Return the instants of a window of a number of steps, in steps from its start."""
    return np.arange(window_count(steps, sampling), dtype=np.float64) + (0.5 if sampling == "midpoint" else 0.0)


def instants_of(grid: Parameters) -> Instants:
    """The instants of the study's ``time`` block, on its clock."""
    time: SolarTime | CivilTime | SunDirections | WeatherTime = grid.study.time  # type: ignore[attr-defined]
    if isinstance(time, SunDirections):
        return direction_instant()
    if isinstance(time, SolarTime):
        return solar_instants(time)
    if isinstance(time, WeatherTime):
        dim = next((dim.name for dim in grid.study.dimensions() if "weather.file" in dim.sweeps), "site")
        return weather_intervals(weather_files(grid.study), dim).at_sites(grid.part(dim))
    # Made for all sites: how many there are, and whether sites share them, must not depend on the region.
    return civil_instants(time, Parameters(grid.study).timezones()).at_sites(grid.part("site"))


#: Sampling of the intervals of weather files.
MIDDLES = (
    "middle of each interval of the weather file; at sunrise and sunset of its part with the sun above the horizon"
)


def sun_attributes(
    time: SolarTime | CivilTime | SunDirections | WeatherTime,
    delta_t: float | None = None,
    elevation: str = "geometric",
) -> dict[str, str]:
    """Return the global attributes on the sun and the sampling.

    They follow from the ``time`` block, terrestrial minus universal time `delta_t` [s] (default: by year and month),
    and the kind of elevation: geometric, or apparent in a given air.
    """
    if isinstance(time, SunDirections):
        return {"sun_position": "directions as given, azimuth from north, clockwise, and geometric elevation"}
    if isinstance(time, SolarTime):
        declination = "Cooper (1969) by day of the year" if time.declination is None else "as given"
        return {"sun_position": f"solar clock, declination {declination}", "time_sampling": time.sampling}
    difference = "by year and month (pvlib)" if delta_t is None else f"{delta_t:g} s"
    return {
        "sun_position": (
            "SPA (Reda and Andreas 2004) by pvlib at daily nodes, splines between them, within 0.001 arcsec of it; "
            f"elevation {elevation}; delta_t {difference}"
        ),
        "time_sampling": MIDDLES if isinstance(time, WeatherTime) else time.sampling,
    }


def sun_at(instants: Instants, place: Sequence[float | None]) -> np.ndarray:
    """Return unit vectors towards the sun at one place, shape (time, 3): east, north, up; NaN for padded instants. [1]

    The instants are on the civil clock of the place's time zone; for weather files they are `lit_middles`. `place` has
    the values of `PLACE`, None without a value: latitude and longitude, positive north and east [deg], and altitude
    [m]; for given directions azimuth, clockwise from north, and elevation [deg].
    """
    latitude, longitude, altitude, azimuth, elevation = (np.nan if one is None else float(one) for one in place)
    labels = {name: label.values for name, label in instants.labels.items()}
    if instants.clock == "sun":
        return direction(azimuth, elevation)[np.newaxis]
    if instants.clock == "civil":
        return sun_vectors(labels["utc"], latitude, longitude, altitude)
    if instants.clock == "weather":
        return _lit_vectors(labels["utc"].tobytes(), labels["hours"].tobytes(), (latitude, longitude, altitude))
    if "declination" in labels:
        declination = np.radians(labels["declination"])
    else:
        declination = clock.declination_cooper(labels["day"])
    return clock.solar_clock(np.radians(latitude), declination, labels["solar_hour"])


@lru_cache(4)
def _lit_vectors(utc: bytes, hours: bytes, place: tuple[float, float, float]) -> np.ndarray:
    """Return unit vectors at `lit_middles`, once for the parts of a study. [1]"""
    return sun_vectors(lit_middles(np.frombuffer(utc, "datetime64[ns]"), np.frombuffer(hours), *place), *place)


def lit_middles(
    utc: NDArray[np.datetime64], hours: NDArray[np.float64], latitude: float, longitude: float, altitude: float
) -> NDArray[np.datetime64]:
    """Return middles of intervals; an interval with sunrise or sunset has the middle of its part above the horizon.

    `utc` are the middles of the intervals, shape (T,), and `hours` their lengths. Sunrise and sunset refer to the sun's
    centre without refraction, to a millisecond.
    """
    half = (hours * 1.8e12).astype("timedelta64[ns]")
    starts, ends = utc - half, utc + half

    def up(times: NDArray[np.datetime64]) -> NDArray[np.bool_]:
        lit: NDArray[np.bool_] = sun_vectors(times, latitude, longitude, altitude)[:, 2] > 0
        return lit

    before, after = up(starts), up(ends)
    edge = np.flatnonzero(before != after)
    lit, dark = (np.where(before[edge] == side, starts[edge], ends[edge]) for side in (True, False))
    bright = lit
    for _ in range(22):
        middle = dark + (lit - dark) // 2
        risen = up(middle)
        lit, dark = np.where(risen, middle, lit), np.where(risen, dark, middle)
    middles = utc.copy()
    middles[edge] = lit + (bright - lit) // 2
    return middles


#: Keys of a study that the sun at a place depends on, in the order of `sun_at`.
PLACE = ("site.latitude", "site.longitude", "site.altitude", "time.azimuth", "time.elevation")


class Suns:
    """Sun vectors at the points of a region, computed once for successive points at one place.

    A region with ``time`` has its instants only; `most` limits their number to evenly picked instants.
    """

    def __init__(self, parameters: Parameters, most: int | None = None) -> None:
        instants = instants_of(parameters)
        self._instants = instants.thinned(most) if most else instants.part(parameters.part("time"))
        dim = self._instants.dim
        self._sites = list(parameters.sizes).index(dim) if dim in parameters.sizes else None
        self._last: tuple[object, np.ndarray] = (None, np.empty((0, 3)))

    @property
    def size(self) -> int:
        """Number of instants."""
        return self._instants.size

    def at(self, index: tuple[int, ...], place: Sequence[float | None]) -> np.ndarray:
        """Unit vectors towards the sun at a point, shape (time, 3), from its index and the values of `PLACE`. [1]"""
        site = None if self._sites is None else index[self._sites]
        key = (site, tuple(place))
        if self._last[0] != key:
            here = self._instants if site is None else self._instants.at_sites(site)
            self._last = key, sun_at(here, place)
        return self._last[1]


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
    days = clock.declination_cooper(time.day_numbers()) if declinations is None else np.radians(declinations)
    # Of all hours the sun is highest at the one nearest to noon.
    hours = time.solar_hours()
    noon = hours[np.abs(hours - 12).argmin()]
    return clock.solar_clock(np.radians(latitudes)[:, np.newaxis], days, noon)[..., 2].max(axis=1)


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
    declination = clock.declination_cooper([date.timetuple().tm_yday for date in dates])
    vectors = clock.solar_clock(np.radians(latitudes)[:, np.newaxis], declination, 12 + nearest)
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
    declination = clock.declination_cooper([date.timetuple().tm_yday for date in dates])[:, np.newaxis]
    shares = []
    for site in _some(sites):
        zone = parse_timezone(time.timezone or site.timezone or "+00:00")
        opens, closes = (np.array([_universal_hour(date, at, zone) for date in dates]) for at in (start, stop))
        hours = np.linspace(opens, closes, 145, axis=1)
        for latitude, longitude in product(_some(_values(site.latitude)), _some(_values(site.longitude))):
            up = clock.solar_clock(np.radians(latitude), declination, hours + longitude / 15)[..., 2]
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

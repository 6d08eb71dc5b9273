"""Generate the instants of a study, compute sun positions at its sites, and find sites without a sunrise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import (
    CivilTime,
    SolarTime,
    Study,
    SunDirections,
    Sweep,
    WeatherTime,
    parse_timezone,
    places_of,
    to_utc,
    weather_of,
)
from heliosweep.errors import Problem
from heliosweep.grid.parameters import Parameters
from heliosweep.kernels import sun as clock
from heliosweep.lazy import xr
from heliosweep.sun import direction, sun_vectors

#: Maximum number of instants that are generated before the plan is accepted, or examined for sites without a sunrise.
MAX_INSTANTS = 10**7
#: Attributes of a coordinate that contains calendar dates.
DATE = {
    "long_name": "date at the site",
    "comment": (
        "calendar date in the time zone of the site, stored as midnight without an offset from universal time; sites "
        "in different time zones therefore share the same dates"
    ),
    "axis": "T",
}


@dataclass(frozen=True)
class Instants:
    """Instants of a study, with labels along ``time``.

    The labels depend on the clock:

    - ``solar``: ``day`` or ``declination``, and ``solar_hour``.
    - ``civil``: ``utc``, which also has the `dim` dimension if the clocks of the sites differ.
    - ``weather``: ``utc``, the midpoint of each interval, and ``hours``, the length of each interval. Both labels
      also have the `dim` dimension if the weather files differ.
    - ``sun``: a single ``instant`` for each sun direction.
    """

    labels: dict[str, xr.Variable]
    clock: str
    dim: str = "site"

    def coordinates(self) -> dict[str, xr.Variable]:
        """Return the labels as coordinates.

        If the instants are ascending and equal at all sites, the ``time`` coordinate contains the instants.
        """
        utc = self.labels.get("utc")
        if utc is not None and utc.dims == ("time",) and np.all(np.diff(utc.values) > np.timedelta64(0)):
            clock = {"standard_name": "time", "units_metadata": "leap_seconds: none"}
            return {"time": xr.Variable(utc.dims, utc.values, utc.attrs | clock)}
        return {name: label for name, label in self.labels.items() if name not in ("hours", "instant")}

    def isel(self, spans: Mapping[str, slice | int]) -> Instants:
        """Return a part of the instants by indices along ``time``, sites or weather files."""
        labels = {name: label.isel(spans, missing_dims="ignore") for name, label in self.labels.items()}
        return replace(self, labels=labels)

    @property
    def size(self) -> int:
        """Number of instants."""
        return next(iter(self.labels.values())).values.shape[-1]


def instant_count(time: SolarTime | CivilTime | SunDirections | WeatherTime) -> int:
    """Return the number of instants without generating them, ignoring changes to daylight-saving time.

    A weather file is assumed to contain one year of hourly values; `instants_of` reads the actual number.
    """
    if isinstance(time, SunDirections):
        return 1
    if isinstance(time, WeatherTime):
        return 8760
    if isinstance(time, SolarTime):
        return len(time.declination or time.days or ()) * len(time.solar_hours())
    start, stop, step = time.window_seconds()
    return len(time.date_list()) * window_count((stop - start) / step, time.sampling)


def solar_instants(time: SolarTime) -> Instants:
    """Return the instants of the solar clock: the hours of the first day, then the hours of the next days.

    The labels along ``time`` are ``day`` [1] or ``declination`` [deg], and ``solar_hour`` [h]. The hours depend on the
    study key ``sampling``.
    """
    hours, outer = time.solar_hours(), cast("Any", time.declinations())
    name, attrs = "declination", {"long_name": "declination of the sun", "units": "degree"}
    if outer is None:
        name, outer, attrs = "day", time.day_numbers(), {"long_name": "day of the year", "units": "1"}
    solar = {"long_name": "solar time of day", "units": "h"}
    return Instants(
        {
            name: xr.Variable("time", np.repeat(outer, hours.size), attrs),
            "solar_hour": xr.Variable("time", np.tile(hours, outer.size), solar),
        },
        "solar",
    )


def _table(rows: Sequence[NDArray[np.datetime64]], dim: str) -> tuple[tuple[str, ...], NDArray[np.datetime64]]:
    """Return the dimensions and values of a table of instants: one row if all rows are equal, otherwise padded rows."""
    if all(np.array_equal(row, rows[0]) for row in rows):
        return ("time",), rows[0]
    table = np.full((len(rows), max(row.size for row in rows)), np.datetime64("NaT", "ns"))
    for index, row in enumerate(rows):
        table[index, : row.size] = row
    return (dim, "time"), table


def civil_instants(time: CivilTime, timezones: list[str]) -> Instants:
    """Return the instants, in universal time, of the daily windows in the civil time of each site.

    A window starts and stops at clock times and has equal steps of elapsed time. A window that includes a clock change
    is therefore an hour shorter or longer. If the start or stop is in an hour that a clock change skips, the window
    starts or stops at the clock change. If the start or stop is in a repeated hour, its first occurrence is used.

    If all sites have equal instants, ``utc`` is along ``time``, in ascending order without repetitions. Otherwise
    ``utc`` is along (``site``, ``time``), and sites with fewer instants are padded with NaT.
    """
    dims, utc = _table([np.unique(np.concatenate(daily_windows(time, zone))) for zone in timezones], "site")
    return Instants({"utc": xr.Variable(dims, utc, {"long_name": "universal time"})}, "civil")


def civil_intervals(time: CivilTime, timezone: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the hours that each instant of `civil_instants` represents, and its month, for one time zone.

    An instant represents one step, or half a step at both ends of an inclusive window. For an instant in two windows,
    the hours are summed.
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
    """Return the instants of each date's window in a time zone, in universal time and in the order of the study."""
    zone = parse_timezone(timezone)
    start, stop, step = time.window_seconds()
    pieces = []
    for date in time.date_list():
        opens, closes = (to_utc(date, seconds, zone)[0].timestamp() for seconds in (start, stop))
        seconds = opens + step * window_positions((closes - opens) / step, time.sampling)
        pieces.append(np.round(seconds * 1e9).astype(np.int64).view("datetime64[ns]"))
    return pieces


def window_count(steps: float, sampling: str) -> int:
    """Return the number of instants in a window of `steps` steps, tolerating rounding errors."""
    if sampling == "left":
        return int(np.ceil(steps - 1e-9))
    return int(np.floor(steps + 1e-9)) + (sampling == "inclusive")


def window_positions(steps: float, sampling: str) -> NDArray[np.float64]:
    """Return the times of the instants in a window of `steps` steps, in steps from its start."""
    return np.arange(window_count(steps, sampling), dtype=np.float64) + (0.5 if sampling == "midpoint" else 0.0)


def instants_of(grid: Parameters) -> Instants:
    """Return the instants that the ``time`` block of the study specifies."""
    time: SolarTime | CivilTime | SunDirections | WeatherTime = grid.study.time  # type: ignore[attr-defined]
    if isinstance(time, SunDirections):
        return Instants({"instant": xr.Variable("time", np.zeros(1))}, "sun")
    if isinstance(time, SolarTime):
        return solar_instants(time)
    if isinstance(time, WeatherTime):
        dim = next((dim.name for dim in grid.study.dimensions() if "weather.file" in dim.sweeps), "site")
        # The labels are along `time` if they are equal for all files, and otherwise along `dim` and `time`.
        files = weather_of(grid.study)
        dims, utc = _table([file.utc for file in files], dim)
        if len(dims) == 1 and any(file.hours != files[0].hours for file in files):
            dims, utc = (dim, "time"), np.stack([file.utc for file in files])
        hours = np.where(np.isnat(utc), 0.0, files[0].hours if len(dims) == 1 else [[file.hours] for file in files])
        middle = "middle of the interval of the weather file, in the year of the file"
        labels = {
            "utc": xr.Variable(dims, utc, {"long_name": "universal time", "comment": middle}),
            "hours": xr.Variable(dims, hours, {"long_name": "length of the interval", "units": "h"}),
        }
        return Instants(labels, "weather", dim).isel({dim: grid.part(dim)})
    # Generate instants for all sites, because their number and dimensions must not depend on the region.
    return civil_instants(time, Parameters(grid.study).timezones()).isel({"site": grid.part("site")})


def sun_attributes(
    time: SolarTime | CivilTime | SunDirections | WeatherTime,
    delta_t: float | None = None,
    elevation: str = "geometric",
) -> dict[str, str]:
    """Return the global attributes that describe sun positions and time sampling.

    The attributes depend on the ``time`` block, on the kind of elevation (geometric or apparent), and on `delta_t`, the
    difference between terrestrial and universal time [s] (default: by year and month).
    """
    if isinstance(time, SunDirections):
        return {"sun_position": "directions from the study: azimuth clockwise from north, and geometric elevation"}
    if isinstance(time, SolarTime):
        declination = "Cooper (1969) by day of the year" if time.declination is None else "as given"
        return {"sun_position": f"solar clock, declination {declination}", "time_sampling": time.sampling}
    middles = "middle of each interval of the weather file, or of its sunlit part in intervals with sunrise or sunset"
    difference = "by year and month (pvlib)" if delta_t is None else f"{delta_t:g} s"
    return {
        "sun_position": (
            "SPA (Reda and Andreas 2004) from pvlib at daily nodes, with splines between nodes, accurate to 0.001 "
            f"arcsec; elevation {elevation}; delta_t {difference}"
        ),
        "time_sampling": middles if isinstance(time, WeatherTime) else time.sampling,
    }


def sun_at(instants: Instants, place: Sequence[float | None]) -> np.ndarray:
    """Return unit vectors to the sun at one site, shape (time, 3): east, north, up; NaN for padded instants. [1]

    For weather files, the directions are computed at the midpoints of the sunlit intervals. `place` contains the
    values of `PLACE`, each of which may be None: latitude (positive north) and longitude (positive east) [deg],
    altitude [m], and for given sun directions the azimuth (clockwise from north) and elevation [deg].
    """
    latitude, longitude, altitude, azimuth, elevation = (np.nan if one is None else float(one) for one in place)
    labels = {name: label.values for name, label in instants.labels.items()}
    if instants.clock == "sun":
        return direction(azimuth, elevation)[np.newaxis]
    if instants.clock == "civil":
        return sun_vectors(labels["utc"], latitude, longitude, altitude)
    if instants.clock == "weather":
        return _lit_vectors(labels["utc"].tobytes(), labels["hours"].tobytes(), (latitude, longitude, altitude))
    given = labels.get("declination")
    declination = clock.declination_cooper(labels["day"]) if given is None else np.radians(given)
    return clock.solar_clock(np.radians(latitude), declination, labels["solar_hour"])


@lru_cache(4)
def _lit_vectors(midpoints: bytes, lengths: bytes, place: tuple[float, float, float]) -> np.ndarray:
    """Return unit vectors to the sun at the midpoint of each interval of a weather file.

    In an interval with sunrise or sunset, the midpoint of the sunlit part is used. The arguments are the bytes of the
    midpoints and of the lengths of the intervals. Sunrise and sunset are computed to within a millisecond, for the
    sun's centre without refraction.
    """
    utc, hours = np.frombuffer(midpoints, "datetime64[ns]"), np.frombuffer(lengths)
    half = (hours * 1.8e12).astype("timedelta64[ns]")
    starts, ends = utc - half, utc + half

    def up(times: NDArray[np.datetime64]) -> Any:
        return sun_vectors(times, *place)[:, 2] > 0

    before = up(starts)
    edge = np.flatnonzero(before != up(ends))
    lit, dark = (np.where(before[edge] == side, starts[edge], ends[edge]) for side in (True, False))
    bright = lit
    for _ in range(22):
        middle = dark + (lit - dark) // 2
        risen = up(middle)
        lit, dark = np.where(risen, middle, lit), np.where(risen, dark, middle)
    middles = utc.copy()
    middles[edge] = lit + (bright - lit) // 2
    return sun_vectors(middles, *place)


#: Study keys that affect the sun at a site, in the order that `sun_at` uses.
PLACE = ("site.latitude", "site.longitude", "site.altitude", "time.azimuth", "time.elevation")


class Suns:
    """Sun vectors at the points of a region, computed once for successive points at one site.

    If the region is limited along ``time``, only the instants within the region are included.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._instants = instants_of(parameters).isel({"time": parameters.part("time")})
        dim = self._instants.dim
        self._sites = list(parameters.sizes).index(dim) if dim in parameters.sizes else None
        self._last: tuple[object, np.ndarray] = (None, np.empty((0, 3)))

    @property
    def size(self) -> int:
        """Number of instants."""
        return self._instants.size

    def at(self, index: tuple[int, ...], place: Sequence[float | None]) -> np.ndarray:
        """Return unit vectors to the sun at a point with the given index and values of `PLACE`, shape (time, 3). [1]"""
        site = 0 if self._sites is None else index[self._sites]
        key = (site, tuple(place))
        if self._last[0] != key:
            self._last = key, sun_at(self._instants.isel({self._instants.dim: site}), place)
        return self._last[1]


#: Maximum elevation error of `_heights` on the civil clock, with a margin of 1 deg. [deg]
#: The equation of time adds 4.3 deg; Cooper's declination with the calendar drift from 1700 to 2200 adds 1.7 deg.
MARGIN = 7.0


def dark_places(study: Study, missing: str) -> Iterator[Problem | str]:
    """Yield a problem if the sun never rises, or a warning that lists dark latitudes and ends with `missing`.

    On the civil clock, some dark latitudes may not be detected.
    """
    time: SolarTime | CivilTime = study.time  # type: ignore[attr-defined]
    places = [(site, latitude) for site in places_of(study) for latitude in _values(site.latitude)]
    margin, key, where, each = 0.0, "hours", "latitudes, days and hours", 365
    if isinstance(time, CivilTime):
        margin, key, where = np.sin(np.radians(MARGIN)), "window", "sites on these dates in this window"
        each = max(instant_count(time), 200)  # the overhead of a place corresponds to about 200 sun positions
    if not places or sum(_values(site.longitude).size for site, _ in places) * each > MAX_INSTANTS:
        return
    heights = [_heights(time, site, latitude, _values(site.longitude)).max() for site, latitude in places]
    dark = [latitude for (_, latitude), height in zip(places, heights, strict=True) if height <= -margin]
    if len(dark) == len(places):
        yield study.problem(f"time.{key}", f"the sun never rises at these {where}")
    elif dark:
        listed = ", ".join(f"{value:g}" for value in dark[:6])
        more = f" and {len(dark) - 6} more" if len(dark) > 6 else ""
        yield f"the sun never rises at latitude {listed}{more} deg: {missing}"


def night_share(study: Study) -> float:
    """Estimate the fraction of a study's civil-clock instants at which the sun is below the horizon. [1]

    The error is a few hundredths, because the estimate uses a selection of places and dates and neglects the equation
    of time.
    """
    time: CivilTime = study.time  # type: ignore[attr-defined]
    shares = [
        np.mean(_heights(time, site, latitude, _some(_values(site.longitude)), 2000) < 0)
        for site in _some(places_of(study))
        for latitude in _some(_values(site.latitude))
    ]
    return float(np.mean(shares))


def _heights(
    time: SolarTime | CivilTime, site: Any, latitude: float, longitudes: NDArray[np.float64], most: int = MAX_INSTANTS
) -> NDArray[np.float64]:
    """Return the sine of the sun elevation at a latitude for at most `most` instants, neglecting the equation of time.

    On the solar clock, only the hour nearest to noon, when the sun is highest, is used for each day.
    """
    if isinstance(time, SolarTime):
        given, hours = time.declinations(), time.solar_hours()
        declination = clock.declination_cooper(time.day_numbers()) if given is None else np.radians(given)
        return clock.solar_clock(np.radians(latitude), declination, hours[np.abs(hours - 12).argmin()])[..., 2]
    utc = np.concatenate(daily_windows(time, time.timezone or site.timezone or "+00:00"))
    utc = np.random.default_rng(0).choice(utc, min(utc.size, most), replace=False)
    date = utc.astype("datetime64[D]")
    declination = clock.declination_cooper((date - date.astype("datetime64[Y]")).astype(int) + 1)
    hours = ((utc - date) / np.timedelta64(1, "h"))[:, np.newaxis] + longitudes / 15
    return clock.solar_clock(np.radians(latitude), declination[:, np.newaxis], hours)[..., 2]


def _some(values: Any) -> Any:
    """Return at most 12 of the values, evenly spaced."""
    return values[:: max(1, -(-len(values) // 12))]


def _values(value: float | Sweep | None) -> NDArray[np.float64]:
    """Return the values of a key: all values of a sweep, or 0 if the key has no value."""
    return np.atleast_1d(np.asarray(value[:] if isinstance(value, Sweep) else value or 0.0, dtype=float))

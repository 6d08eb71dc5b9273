"""The sun of a study: unit vectors per site and instant, shared by every family and parameter combination.

On the civil clock they have the accuracy of the SPA at a hundredth of its cost: pvlib's SPA once a day, splines in
between. Largest difference to pvlib's SPA at the instants themselves: 0.001 arcsec over 1950 to 2050, a third of it the
rounding of the SPA's own Julian day.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.config.times import CivilTime, SolarTime, SunDirections, WeatherTime
from heliosweep.config.weather_files import weather_files
from heliosweep.files import PVLIB, named_in
from heliosweep.grid.clock import Instants, civil_instants, direction_instant, solar_instants, weather_intervals
from heliosweep.grid.parameters import Parameters
from heliosweep.kernels.sun import clock
from heliosweep.kernels.sun.ephemeris import DAY, daily_splines, sidereal_time, sun_at_sites


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
    # Made for all sites: how many there are, and whether sites share them, must not depend on the slab.
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
    """What a result says of its sun and its sampling, as global attributes.

    From the study's ``time`` block; terrestrial minus universal time `delta_t` [s], by year and month where left out;
    and whether the elevation is geometric, or apparent and in which air.
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
    """Unit vectors towards the sun at one place, shape (time, 3): east, north, up; NaN where instants are padded. [1]

    The instants are those of the study, on the civil clock of the place's own time zone; of the intervals of weather
    files, `lit_middles`. `place` has the values of
    `PLACE`, None where the study gives none: latitude and longitude, positive north and east [deg], and altitude [m];
    for given directions azimuth, from north, clockwise, and elevation [deg].
    """
    latitude, longitude, altitude, azimuth, elevation = (np.nan if one is None else float(one) for one in place)
    labels = {name: label.values for name, label in instants.labels.items()}
    if instants.clock == "sun":
        across = np.cos(np.radians(elevation))
        east, north = across * np.sin(np.radians(azimuth)), across * np.cos(np.radians(azimuth))
        return np.array([[east, north, np.sin(np.radians(elevation))]])
    if instants.clock == "civil":
        return sun_vectors(labels["utc"], latitude, longitude, altitude)
    if instants.clock == "weather":
        middles = lit_middles(labels["utc"], labels["hours"], latitude, longitude, altitude)
        return sun_vectors(middles, latitude, longitude, altitude)
    if "declination" in labels:
        declination = np.radians(labels["declination"])
    else:
        declination = clock.declination_cooper(labels["day"])
    return clock.solar_clock(np.radians(latitude), declination, labels["solar_hour"])


def lit_middles(
    utc: NDArray[np.datetime64], hours: NDArray[np.float64], latitude: float, longitude: float, altitude: float
) -> NDArray[np.datetime64]:
    """Middles of intervals; where the sun rises or sets within one, of its part with the sun above the horizon.

    `utc` are the middles of the whole intervals, of so many `hours` each, shape (T,). Sunrise and sunset are those of
    the sun's centre without refraction, to a millisecond.
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
    """Sun vectors at the points of a region, made once for points at the same place that follow each other.

    Where the region has ``time``, of those instants only; with `most`, of so many evenly picked instants.
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


#: Nodes beyond both ends of a year: what the end of a spline gets wrong fades by 0.27 a node.
MARGIN = 20


def sun_vectors(
    utc: ArrayLike,
    latitude: ArrayLike,
    longitude: ArrayLike,
    altitude: ArrayLike = 0.0,
    delta_t: float | None = None,
) -> NDArray[np.float64]:
    """Unit vectors towards the sun, geometric (without refraction), for all sites at the same instants.

    Universal times, of which NaT gives NaN; latitudes and longitudes, positive north and east [deg], and altitudes
    above sea level [m] broadcast. Terrestrial minus universal time `delta_t` [s] is by default as pvlib estimates it
    for the month of each instant. Of shape (*sites, T, 3): east, north, up. [1]

    Raises ValueError if `delta_t` is not finite or a day or more, or for an instant beyond what nanoseconds can count
    (1678 to 2261).
    """
    stamps = np.array(utc, "datetime64[ns]", order="C")  # a copy: read-only stamps would be compiled for anew
    given = np.asarray(utc, "datetime64")
    if given.dtype != stamps.dtype and not np.array_equal(
        given.astype("datetime64[D]"), stamps.astype("datetime64[D]"), equal_nan=True
    ):
        raise ValueError("nanoseconds count instants of the years 1678 to 2261 only")
    places = np.broadcast_arrays(np.radians(latitude), np.radians(longitude), np.asarray(altitude, np.float64))
    sites = np.stack([values.ravel() for values in places], axis=1)
    sun = np.empty((len(sites), stamps.size, 3))
    known = stamps[~np.isnat(stamps)].view(np.int64)
    if known.size == 0:
        sun[:] = np.nan
    else:
        first, last = int(known.min()), int(known.max())
        late = _delta_t(first // DAY, last // DAY, delta_t)
        # A microsecond to spare: the kernel rounds the days of terrestrial time.
        years = range(_year_of(first + int(late.min() * 1e9) - 1000), _year_of(last + int(late.max() * 1e9) + 1000) + 1)
        pieces = np.concatenate([_splines(year) for year in years])
        sun_at_sites(stamps.view(np.int64), late, first // DAY, pieces, _new_year(years[0]), sites, sun)
    return sun.reshape(*places[0].shape, stamps.size, 3)


@lru_cache(8)
def _delta_t(first: int, last: int, fixed: float | None) -> NDArray[np.float64]:
    """Terrestrial minus universal time [s] of each day, from one day since 1970 to another."""
    if fixed is not None:
        if not abs(fixed) < 86400.0:
            raise ValueError(f"delta_t must be less than a day, not {fixed} s")
        return np.full(last - first + 1, float(fixed))
    months = np.arange(first, last + 1).astype("datetime64[D]").astype("datetime64[M]").astype(int)
    each = np.arange(months[0], months[-1] + 1)
    return np.asarray(_spa().calculate_deltat(1970 + each // 12, each % 12 + 1), np.float64)[months - months[0]]


@cache
def _spa() -> Any:
    """Pvlib's module of the SPA alone: to import all of pvlib takes half a second."""
    spec = importlib.util.spec_from_file_location("pvlib_spa", named_in(Path(), f"{PVLIB}spa.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _year_of(nanoseconds: int) -> int:
    """Year of a time since 1970."""
    return 1970 + int(np.datetime64(nanoseconds // DAY, "D").astype("datetime64[Y]").astype(int))


def _new_year(year: int) -> int:
    """Days from 1970 to the first of January."""
    return int(np.datetime64(f"{year:04}-01-01", "D").astype(int))


@lru_cache(maxsize=256)
def _splines(year: int) -> NDArray[np.float64]:
    """Splines of the days of a year, in terrestrial time."""
    position = _spa().solar_position
    days = np.arange(_new_year(year) - MARGIN, _new_year(year + 1) + MARGIN + 1)
    unix = days * 86400.0
    apparent, ascension, declination = position(unix, 0, 0, 0, 0, 0, 0.0, 0, 1, sst=True)[:3]
    (distance,) = position(unix, 0, 0, 0, 0, 0, 0.0, 0, 1, esd=True)[:1]
    # The equation of the equinoxes goes with the right ascension: both depend on terrestrial time alone.
    mean = 360.0 * sidereal_time(days, 0.0)
    alpha = np.radians(ascension - (apparent - mean))
    delta = np.radians(declination)
    parallax = np.sin(np.radians(8.794 / (3600.0 * distance)))
    nodes = np.stack((np.cos(delta) * np.cos(alpha), np.cos(delta) * np.sin(alpha), np.sin(delta), parallax), axis=1)
    return daily_splines(nodes)[MARGIN:-MARGIN]

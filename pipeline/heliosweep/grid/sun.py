"""Sun of a study: unit vectors per site and instant, shared by all families and parameter combinations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.times import CivilTime, SolarTime, SunDirections, WeatherTime
from heliosweep.config.weather_files import weather_files
from heliosweep.grid.clock import Instants, civil_instants, direction_instant, solar_instants, weather_intervals
from heliosweep.grid.parameters import Parameters
from heliosweep.kernels.sun import clock
from heliosweep.sun import direction, sun_vectors


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

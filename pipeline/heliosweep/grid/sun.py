"""The sun of a study: unit vectors per site and instant, shared by every family and parameter combination."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from heliosweep.config.times import CivilTime, SolarTime, SunDirections
from heliosweep.grid import spa
from heliosweep.grid.clock import Instants, civil_instants, direction_instant, solar_instants
from heliosweep.grid.parameters import Parameters
from heliosweep.kernels.sun import clock


def instants_of(grid: Parameters) -> Instants:
    """The instants of the study's ``time`` block, on its clock."""
    time: SolarTime | CivilTime | SunDirections = grid.study.time  # type: ignore[attr-defined]
    if isinstance(time, SunDirections):
        return direction_instant()
    if isinstance(time, SolarTime):
        return solar_instants(time)
    # Made for all sites: how many there are, and whether sites share them, must not depend on the slab.
    return civil_instants(time, Parameters(grid.study).timezones()).at_sites(grid.part("site"))


def sun_attributes(
    time: SolarTime | CivilTime | SunDirections, delta_t: float | None = None, elevation: str = "geometric"
) -> dict[str, str]:
    """What a result says of its sun and its sampling, as global attributes.

    Parameters
    ----------
    time : SolarTime, CivilTime or SunDirections
        The study's ``time`` block.
    delta_t : float, optional
        Terrestrial minus universal time; by year and month where left out. [s]
    elevation : str
        Geometric, or apparent and in which air.
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
        "time_sampling": time.sampling,
    }


def sun_vectors(instants: Instants, place: Sequence[float | None]) -> np.ndarray:
    """Unit vectors towards the sun at one place.

    Parameters
    ----------
    instants : Instants
        Of the study; on the civil clock those of the place's own time zone.
    place : sequence of float
        Values of `PLACE`, None where the study gives none: latitude and longitude, positive north and east [deg], and
        altitude [m]; for given directions azimuth, from north, clockwise, and elevation [deg].

    Returns
    -------
    ndarray, shape (time, 3)
        East, north, up; NaN where instants are padded. [1]
    """
    latitude, longitude, altitude, azimuth, elevation = (np.nan if one is None else float(one) for one in place)
    labels = {name: label.to_numpy() for name, label in instants.labels.items()}
    if instants.clock == "sun":
        across = np.cos(np.radians(elevation))
        east, north = across * np.sin(np.radians(azimuth)), across * np.cos(np.radians(azimuth))
        return np.array([[east, north, np.sin(np.radians(elevation))]])
    if instants.clock == "civil":
        return spa.sun_vectors(labels["utc"], latitude, longitude, altitude)
    if "declination" in labels:
        declination = np.radians(labels["declination"])
    else:
        declination = clock.declination_cooper(labels["day"])
    return clock.solar_clock(np.radians(latitude), declination, labels["solar_hour"])


#: Keys of a study that the sun at a place depends on, in the order of `sun_vectors`.
PLACE = ("site.latitude", "site.longitude", "site.altitude", "time.azimuth", "time.elevation")


class Suns:
    """Sun vectors at the points of a region, made once for points at the same place that follow each other.

    Parameters
    ----------
    parameters : Parameters
        The region; where it has ``time``, of those instants only.
    most : int, optional
        Evenly picked instants at the most.
    """

    def __init__(self, parameters: Parameters, most: int | None = None) -> None:
        instants = instants_of(parameters)
        self._instants = instants.thinned(most) if most else instants.part(parameters.part("time"))
        self._sites = list(parameters.sizes).index("site") if "site" in parameters.sizes else None
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
            self._last = key, sun_vectors(here, place)
        return self._last[1]

"""The sun of a study: unit vectors per site and instant, shared by every family and parameter combination."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from heliosweep.config.times import CivilTime, SolarTime, SunDirections
from heliosweep.families import fast_sun
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import evaluate
from heliosweep.grid.instants import Instants, civil_instants, direction_instant, solar_instants
from heliosweep.kernels import sun as sun_kernels


def site_of(grid: Grid) -> dict[str, xr.DataArray]:
    """Latitude and longitude [deg] and altitude [m] of the study's site or sites, over what is swept.

    Where the study gives directions of the sun, its ``azimuth`` and ``elevation`` [deg] instead.
    """
    if grid.has("time.azimuth"):
        return {key: grid.parameter(f"time.{key}") for key in ("azimuth", "elevation")}
    keys = ("latitude", "longitude", "altitude")
    return {key: grid.parameter(f"site.{key}") for key in keys if grid.has(f"site.{key}")}


def instants_of(grid: Grid) -> Instants:
    """The instants of the study's ``time`` block, on its clock."""
    time: SolarTime | CivilTime | SunDirections = grid.study.time  # type: ignore[attr-defined]
    if isinstance(time, SunDirections):
        return direction_instant()
    if isinstance(time, SolarTime):
        return solar_instants(time)
    # Made for all sites: how many there are, and whether sites share them, must not depend on the slab.
    return civil_instants(time, Grid(grid.study).timezones()).at_sites(grid.part("site"))


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


def sun_vectors(site: Mapping[str, xr.DataArray], instants: Instants, chunks: Mapping[str, int]) -> xr.DataArray:
    """Unit vectors towards the sun, once per site and instant.

    Parameters
    ----------
    site : mapping of str to xarray.DataArray
        ``latitude`` and, for the civil clock, ``longitude`` (positive north and east) [deg] and ``altitude`` [m]; for
        given directions ``azimuth``, from north, clockwise, and ``elevation`` [deg].
    instants : Instants
        Of the study.
    chunks : mapping of str to int
        Block lengths along the dimensions of the site and ``time``.

    Returns
    -------
    xarray.DataArray
        Lazy, over the dimensions of the site, then ``time`` and ``xyz`` (east, north, up); NaN where the instants of
        a site are padded. [1]
    """
    keys = _KEYS[instants.clock]
    places = [site[key] for key in keys]
    dims = tuple(dict.fromkeys(str(dim) for place in places for dim in place.dims))
    sizes = {dim: place.sizes[dim] for place in places for dim in map(str, place.dims)}
    arguments = [*places, *instants.labels.values()]
    face = _FACES["declination" if "declination" in instants.labels else instants.clock]
    return evaluate(
        face,
        arguments,
        dims=(*dims, "time"),
        core=[()] * len(arguments),
        sizes={**sizes, "time": instants.size},
        chunks=chunks,
        outputs={"sun": {"units": "1", "long_name": "unit vector towards the sun (east, north, up)"}},
        name="sun",
        work=False,
        output_core={"xyz": 3},
    )["sun"]


def _solar_days(latitude: np.ndarray, day: np.ndarray, hour: np.ndarray) -> np.ndarray:
    return sun_kernels.solar_clock(np.radians(latitude), sun_kernels.declination_cooper(day), hour)[np.newaxis]


def _solar_declinations(latitude: np.ndarray, declination: np.ndarray, hour: np.ndarray) -> np.ndarray:
    return sun_kernels.solar_clock(np.radians(latitude), np.radians(declination), hour)[np.newaxis]


def _civil(latitude: np.ndarray, longitude: np.ndarray, altitude: np.ndarray, utc: np.ndarray) -> np.ndarray:
    """Geometric elevation, delta T by year and month; sites before the last dimension, instants along it."""
    shape = np.broadcast_shapes(latitude.shape, longitude.shape, altitude.shape, utc.shape)
    vectors = np.empty((1, *shape, 3))
    places = [np.broadcast_to(place, (*shape[:-1], 1)) for place in (latitude, longitude, altitude)]
    stamps = np.broadcast_to(utc, shape)
    for index in np.ndindex(shape[:-1]):
        vectors[0][index] = fast_sun.sun_vectors(stamps[index], *(float(place[index][0]) for place in places))
    return vectors


def _directions(azimuth: np.ndarray, elevation: np.ndarray, instant: np.ndarray) -> np.ndarray:
    """Azimuth from north, clockwise."""
    azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    across = np.cos(elevation) + 0 * instant
    vectors = np.broadcast_arrays(across * np.sin(azimuth), across * np.cos(azimuth), np.sin(elevation))
    return np.stack(vectors, axis=-1)[np.newaxis]


#: What is asked of the site, by clock.
_KEYS: dict[str, tuple[str, ...]] = {
    "solar": ("latitude",),
    "civil": ("latitude", "longitude", "altitude"),
    "sun": ("azimuth", "elevation"),
}
_FACES: dict[str, Callable[..., np.ndarray]] = {
    "solar": _solar_days,
    "declination": _solar_declinations,
    "civil": _civil,
    "sun": _directions,
}

"""The sun of a study: unit vectors per site and instant, shared by every family and parameter combination."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from heliosweep.config.times import CivilTime, SolarTime
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import evaluate
from heliosweep.grid.instants import Instants, civil_instants, solar_instants
from heliosweep.kernels import sun as sun_kernels

#: Air pressure [hPa] and temperature [deg C] given to SPA; they touch only the refracted elevation, not used here.
PRESSURE = 1013.25
TEMPERATURE = 12.0
#: Refraction at sunrise and sunset given to SPA, unused likewise. [deg]
SUNRISE_REFRACTION = 0.5667


def site_of(grid: Grid) -> dict[str, xr.DataArray]:
    """Latitude and longitude [deg] and altitude [m] of the study's site or sites, over what is swept."""
    keys = ("latitude", "longitude", "altitude")
    return {key: grid.parameter(f"site.{key}") for key in keys if grid.has(f"site.{key}")}


def instants_of(grid: Grid) -> Instants:
    """The instants of the study's ``time`` block, on its clock."""
    time: SolarTime | CivilTime = grid.study.time  # type: ignore[attr-defined]
    if isinstance(time, SolarTime):
        return solar_instants(time)
    return civil_instants(time, grid.timezones())


def sun_vectors(site: Mapping[str, xr.DataArray], instants: Instants, chunks: Mapping[str, int]) -> xr.DataArray:
    """Unit vectors towards the sun, once per site and instant.

    Parameters
    ----------
    site : mapping of str to xarray.DataArray
        ``latitude`` and, for the civil clock, ``longitude`` (positive north and east) [deg] and ``altitude`` [m].
    instants : Instants
        Of the study.
    chunks : mapping of str to int
        Block lengths along the dimensions of the site.

    Returns
    -------
    xarray.DataArray
        Lazy, over the dimensions of the site, then ``time`` and ``xyz`` (east, north, up); NaN where the instants of
        a site are padded. [1]
    """
    keys = ("latitude",) if instants.clock == "solar" else ("latitude", "longitude", "altitude")
    places = [site[key] for key in keys]
    dims = tuple(dict.fromkeys(str(dim) for place in places for dim in place.dims))
    sizes = {dim: place.sizes[dim] for place in places for dim in map(str, place.dims)}
    stamps = list(instants.labels.values())
    face = _FACES["declination" if "declination" in instants.labels else instants.clock]
    return evaluate(
        face,
        [*places, *stamps],
        dims=dims,
        core=[()] * len(places) + [("time",)] * len(stamps),
        sizes=sizes,
        chunks=chunks,
        outputs={"sun": {"units": "1", "long_name": "unit vector towards the sun (east, north, up)"}},
        name="sun",
        work=False,
        output_core={"time": instants.size, "xyz": 3},
    )["sun"]


def _solar_days(latitude: np.ndarray, day: np.ndarray, hour: np.ndarray) -> np.ndarray:
    declination = sun_kernels.declination_cooper(day)
    return sun_kernels.solar_clock(np.radians(latitude)[..., np.newaxis], declination, hour)[np.newaxis]


def _solar_declinations(latitude: np.ndarray, declination: np.ndarray, hour: np.ndarray) -> np.ndarray:
    vectors = sun_kernels.solar_clock(np.radians(latitude)[..., np.newaxis], np.radians(declination), hour)
    return vectors[np.newaxis]


def _civil(latitude: np.ndarray, longitude: np.ndarray, altitude: np.ndarray, utc: np.ndarray) -> np.ndarray:
    """Sun by pvlib's SPA (Reda and Andreas 2004), geometric elevation, delta T by year and month (Espenak, Meeus)."""
    from pvlib import spa

    shape = np.broadcast_shapes(latitude.shape, longitude.shape, altitude.shape)
    stamps = np.broadcast_to(utc, (*shape, utc.shape[-1]))
    places = [np.broadcast_to(place, shape) for place in (latitude, longitude, altitude)]
    vectors = np.full((1, *stamps.shape, 3), np.nan)
    for index in np.ndindex(shape):
        known = ~np.isnat(stamps[index])
        when = stamps[index][known]
        years = when.astype("datetime64[Y]").astype(int) + 1970
        months = when.astype("datetime64[M]").astype(int) % 12 + 1
        *_, elevation, azimuth, _ = spa.solar_position_numpy(
            when.astype("datetime64[ns]").astype(np.int64) / 1e9,
            *(float(place[index]) for place in places),
            PRESSURE,
            TEMPERATURE,
            spa.calculate_deltat(years, months),
            SUNRISE_REFRACTION,
            1,
        )
        up, clockwise = np.radians(elevation), np.radians(azimuth)
        vectors[0][index][known] = np.stack(
            [np.cos(up) * np.sin(clockwise), np.cos(up) * np.cos(clockwise), np.sin(up)], axis=-1
        )
    return vectors


_FACES: dict[str, Callable[..., np.ndarray]] = {
    "solar": _solar_days,
    "declination": _solar_declinations,
    "civil": _civil,
}

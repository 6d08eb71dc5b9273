"""Optical efficiency of a field over the azimuth and elevation of the sun, for SAM and SolarPILOT.

The conventions follow the source code of NREL's ssc and SolarPILOT:

- SAM's molten-salt power tower reads user-defined performance (``eta_map``) as rows of azimuth, zenith angle [deg] and
  efficiency. SAM interpolates at the azimuth of its weather reader, clockwise from north, 0 to 360 deg
  (`C_pt_sf_perf_interp::call`), without periodicity. If one of the azimuths 0 and 360 deg exists, rows for both
  azimuths are therefore written. Rows with the sun below the horizon are omitted, because SAM stops the field at night.
  Each row has a flux map (``flux_maps``) with the fraction of the receiver's light on each column. The columns of a
  cylinder run from south via east and north to west. SAM sums the flux over the height.
- SAM's generic solar field reads a matrix. The first column contains ascending zenith angles, the first row contains
  ascending azimuths, and the first cell is empty. Azimuth 0 is south, east is negative, and west is positive
  (`C_csp_gen_collector_receiver`).
- SolarPILOT's Python interface writes a zero and the elevations in the first row. The first column contains azimuths,
  clockwise from north (`save_optical_efficiency_table`).

The first two formats were tested with PySAM 7.1. For user-defined performance, SAM's power tower multiplies the
efficiency only by the direct irradiance, the mirror area and the hourly availability. The mirror area follows from the
number, width and height of the mirrors and ``dens_mirror``. The table must therefore include reflectivity, soiling,
attenuation, intercept and the absorptance of the receiver. A study with `optics` includes all of these factors except
the absorptance. Without `optics`, the table contains only cosine, shading and blocking. The argument `factor` is the
product of the missing factors. SAM's generic solar field multiplies by its own optical factors.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.config import Study, SunDirections, blocks_in, ends, load_mapping, places_of
from heliosweep.errors import Problem, StudyError
from heliosweep.files import write_rows
from heliosweep.share.fields import chosen, dimension_of
from heliosweep.store.folder import target_file

#: The form ``tower`` is rows for SAM's molten-salt power tower, and ``generic`` is a matrix for SAM's generic solar
#: field.
#: The form ``solarpilot`` is a matrix in the format of SolarPILOT's Python interface.
TableForm: TypeAlias = Literal["tower", "generic", "solarpilot"]

_AZIMUTH, _ELEVATION = "sun_azimuth", "sun_elevation"
#: Study keys and dimensions that given sun directions replace.
_GONE = ("site.", "sites", "time.", "weather.", "limits.", "availability.", "economics.", "budget.")
_SAME = 1e-9  # maximum difference between equal angles [deg]
#: Variables for an efficiency table in order of preference, and the factors that they include.
_FACTORS = {
    "field_total_efficiency": "cosine, shading, blocking, reflection, attenuation and intercept",
    "field_optical_efficiency": "cosine, shading and blocking",
}


def at_directions(study: Study, azimuth: Any = None, elevation: Any = None) -> Study:
    """Return a study of the same field for given sun directions.

    Parameters
    ----------
    study : Study
        Field study with any clock.
    azimuth, elevation : number, sequence or mapping, optional
        Azimuth (clockwise from north) and elevation of the sun, as in a study file (default: steps of 15 deg in azimuth
        and 5 deg in elevation). [deg]

    Returns
    -------
    Study
        Study with ``time: {clock: sun, ...}`` and without a site. File names in the study are relative to the working
        directory.

    Raises
    ------
    StudyError
        If the family cannot use sun directions, or if the directions are invalid.
    """
    time = type(study).model_fields.get("time")
    if time is None or SunDirections not in blocks_in(time.annotation):
        message = f"{study.family} does not support 'clock: sun', which a table over directions of the sun needs"
        raise StudyError(study.problem("family", message))
    content = study.resolved(lambda name: study.seen_from(Path(), name))
    altitudes = list(dict.fromkeys(site.altitude for site in places_of(study)))
    for key in ("site", "sites", "zip", "weather", "limits", "availability", "economics", "budget"):
        content.pop(key, None)
    for key in ("absorptance", "thermal_losses"):
        content.get("receiver", {}).pop(key, None)
    content["time"] = {
        "clock": "sun",
        "azimuth": {"start": 0, "stop": 360, "step": 15} if azimuth is None else azimuth,
        "elevation": {"start": 0, "stop": 90, "step": 5} if elevation is None else elevation,
    }
    output = content.get("output", {})
    content["output"] = {key: value for key, value in output.items() if key not in ("time_series", "field_series")}
    content.pop("design_point", None)
    optics = getattr(study, "optics", None)
    if altitudes and optics is not None and "vant_hull" in ends(optics.attenuation) and optics.altitude is None:
        content["optics"]["altitude"] = altitudes[0] if len(altitudes) == 1 else altitudes
    tied = [[key for key in dim.sweeps if not key.startswith(_GONE)] for dim in study.dimensions()]
    content["zip"] = [keys for keys in tied if len(keys) > 1]
    return load_mapping(content, {study.family: type(study)})


def efficiency_table(
    result: xr.Dataset,
    select: Mapping[str, Any] | None = None,
    *,
    variable: str | None = None,
    factor: float = 1.0,
) -> xr.DataArray:
    """Return the efficiency of a field over sun directions.

    Parameters
    ----------
    result : xarray.Dataset
        Result of a study with ``clock: sun``, from `open_result` or `build`.
    select : mapping of str to value, optional
        Value of each dimension of the result that is not a sun direction.
    variable : str, optional
        Variable of the whole field (default: total efficiency with `optics`, otherwise optical efficiency).
    factor : float
        Product of efficiency factors that the result omits, such as the absorptance of the receiver, 0 to 1. [1]

    Returns
    -------
    xarray.DataArray
        Efficiency over ``sun_elevation`` and ``sun_azimuth``, in memory; NaN if the sun is below the horizon. [1]

    Raises
    ------
    StudyError
        If the result has no sun directions, or if `select` has no value for another dimension of the result.
    """
    if not 0 < factor <= 1:
        raise StudyError(Problem(f"must be more than 0 and at most 1 (got {factor:g})", "factor"))
    if variable is None:
        variable = next((name for name in _FACTORS if name in result.data_vars), "field_optical_efficiency")
    made = _over_directions(result, variable, select) * factor
    text = _FACTORS.get(variable, variable) + (f", times {factor:g}" if factor != 1 else "")
    return made.assign_attrs(units="1", long_name=f"efficiency of the field: {text}")


def flux_maps(result: xr.Dataset, select: Mapping[str, Any] | None = None) -> xr.DataArray:
    """Return the fraction of the receiver's light that falls on each column, for each sun direction.

    Parameters
    ----------
    result : xarray.Dataset
        Result of a study with ``clock: sun`` and `output.flux_map`, from `open_result` or `build`.
    select : mapping of str to value, optional
        Value of each dimension of the result that is not a sun direction.

    Returns
    -------
    xarray.DataArray
        Fractions over ``sun_elevation``, ``sun_azimuth`` and the columns. The sum over the columns is 1. Columns of a
        cylinder run from south via east and north to west. Columns of a rectangle run from left to right as seen from
        the mirrors. Fractions are NaN if the sun is below the horizon. [1]

    Raises
    ------
    StudyError
        As in `efficiency_table`, or if no light reaches the receiver, or if a cylinder has an odd number of columns.
    """
    if "flux_map" not in result.data_vars:
        raise StudyError(Problem("the result has no flux map: add 'output: {flux_map: ...}' to the study"))
    flux = _over_directions(result, "flux_map", select, ("flux_row", "flux_column")).sum("flux_row", min_count=1)
    if flux["flux_column"].attrs["units"] == "degree":
        if flux.sizes["flux_column"] % 2:
            message = "must be even, because SAM's columns meet at south and at north"
            raise StudyError(Problem(message, "output.flux_map.columns"))
        flux = flux.isel(flux_column=np.argsort((180.0 - flux["flux_column"].to_numpy()) % 360.0))
    whole = flux.sum("flux_column", min_count=1)
    if (whole <= 0).any():
        raise StudyError(Problem("no light reaches the receiver for some directions of the sun", "flux_map"))
    return (flux / whole).assign_attrs(units="1", long_name="fraction of the receiver's light on a column")


def _over_directions(
    result: xr.Dataset, variable: str, select: Mapping[str, Any] | None, inner: tuple[str, ...] = ()
) -> xr.DataArray:
    if variable not in result.data_vars:
        raise StudyError(Problem(f"the result has no variable {variable!r}", "variable"))
    table = result[variable]
    if not {_AZIMUTH, _ELEVATION} <= set(table.coords):
        raise StudyError(Problem("the result has no directions of the sun: run the study with 'clock: sun'"))
    for key in select or {}:
        if dimension_of(table, key) not in table.dims and (
            key in {"site", "latitude", "longitude", "altitude", "time", "date", "day", "hour"} or key.startswith(_GONE)
        ):
            raise StudyError(Problem("directions of the sun replace sites and times: omit it", f"select.{key}"))
    tied = table[_AZIMUTH].dims == table[_ELEVATION].dims != ()
    directions = {*table[_AZIMUTH].dims, *table[_ELEVATION].dims, _AZIMUTH, _ELEVATION}
    remedy = ", for example with --select {}=... on the command line"
    table = chosen(table, select, [*map(str, directions), *inner], hint=remedy)
    if tied:
        raise StudyError(
            Problem("the directions are tied by 'zip', but a table needs all elevations at all azimuths", "zip")
        )
    table = table.expand_dims([dim for dim in (_AZIMUTH, _ELEVATION) if dim not in table.dims])
    return table.transpose(_ELEVATION, _AZIMUTH, *inner).compute().sortby(_ELEVATION)


def write_table(
    table: xr.DataArray, path: str | os.PathLike[str], form: TableForm = "tower", *, force: bool = False
) -> Path:
    """Write an efficiency table for SAM or SolarPILOT.

    Parameters
    ----------
    table : xarray.DataArray
        Table from `efficiency_table` or `flux_maps`. Flux maps need the format ``tower``. Their rows contain no
        angles and are in the order of the efficiency table.
    path : path
        CSV file to write. It appears under its name only when it is complete.
    form : {"tower", "generic", "solarpilot"}
        Format for SAM's molten-salt power tower, for SAM's generic solar field, or for SolarPILOT. If the sun is below
        the horizon, the format ``tower`` has no rows, and the other formats contain zeros.
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StudyError
        If the file exists, or if two azimuths are the same direction in the format.
    HeliosweepError
        If the file cannot be written.

    Examples
    --------
    >>> import heliosweep
    >>> table = heliosweep.efficiency_table("one_tower.yaml", azimuth=[90.0, 180.0], elevation=[20.0, 60.0])
    >>> heliosweep.write_table(table, "efficiency.csv").name
    'efficiency.csv'
    """
    forms = get_args(TableForm)
    if form not in forms or (table.ndim > 2 and form != "tower"):
        known = "'tower' for flux maps" if form in forms else ", ".join(forms)
        raise StudyError(Problem(f"unknown form {form!r}; use {known}"))
    file = target_file(path, force)
    write_rows(table_rows(table, form), file)
    return file


def table_rows(table: xr.DataArray, form: TableForm = "tower") -> list[list[object]]:
    """Return the rows of an efficiency table or of flux maps in one of the formats of `write_table`."""
    azimuth, order = _azimuths(table[_AZIMUTH].to_numpy(), south=form == "generic")
    values = table.to_numpy()[:, order]
    if form != "solarpilot" or azimuth.size < table.sizes[_AZIMUTH]:
        azimuth, values = _closed(azimuth, values, -180.0 if form == "generic" else 0.0)
    return [list(row) for row in _rows(form, azimuth, table[_ELEVATION].to_numpy(), values)]


def _rows(form: str, azimuth: NDArray, elevation: NDArray, values: NDArray) -> Iterator[Sequence[object]]:
    for i, j in np.ndindex(values.shape[:2]) if form == "tower" else ():
        if np.isfinite(values[i, j]).all():
            angles = (azimuth[j], 90 - elevation[i]) if values.ndim == 2 else ()
            yield [_number(each) for each in (*angles, *np.atleast_1d(values[i, j]))]
    if form != "tower":
        known = np.nan_to_num(values)
        matrix = ("", azimuth, 90 - elevation[::-1], known[::-1])
        corner, head, side, rows = (0, elevation, azimuth, known.T) if form == "solarpilot" else matrix
        yield corner, *map(_number, head)
        yield from ((_number(first), *map(_number, row)) for first, row in zip(side, rows, strict=True))


def _azimuths(north: NDArray, south: bool) -> tuple[NDArray, NDArray]:
    """Return the ascending azimuths of a format, and their order in the efficiency table.

    Azimuths from north are 0 to 360 deg, and azimuths from south -180 to 180 deg. Both ends of a range are the same
    direction, and the table may contain both ends. If a circle is closed elsewhere, such as -180 to 180 deg from north,
    one end is omitted.
    """
    low = -180.0 if south else 0.0
    shifted = np.asarray(north, dtype=float) - (180.0 if south else 0.0)
    inside = (shifted >= low) & (shifted <= low + 360.0)
    azimuth = np.where(inside, shifted, (shifted - low) % 360.0 + low)
    first, last = int(np.argmin(shifted)), int(np.argmax(shifted))
    is_circle = abs(shifted[last] - shifted[first] - 360.0) < _SAME and abs(azimuth[last] - azimuth[first]) < _SAME
    order = np.argsort(azimuth, kind="stable")
    order = order[order != last] if is_circle else order
    twice = np.flatnonzero(np.diff(azimuth[order]) < _SAME)
    if twice.size:
        raise StudyError(
            Problem(f"two azimuths are the same direction (got {azimuth[order][twice[0]]:g} twice)", _AZIMUTH)
        )
    return azimuth[order], order


def _closed(azimuth: NDArray, values: NDArray, low: float) -> tuple[NDArray, NDArray]:
    """Add values at the missing end of the full circle if one end exists. SAM does not interpolate periodically."""
    if azimuth[0] == low and azimuth[-1] != low + 360.0:
        return np.append(azimuth, low + 360.0), np.hstack([values, values[:, :1]])
    if azimuth[-1] == low + 360.0 and azimuth[0] != low:
        return np.insert(azimuth, 0, low), np.hstack([values[:, -1:], values])
    return azimuth, values


def _number(value: float) -> float | int:
    rounded = round(float(value), 9) + 0.0
    return int(rounded) if rounded.is_integer() else rounded

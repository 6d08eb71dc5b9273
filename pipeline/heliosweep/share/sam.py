"""Optical efficiency of a field over the azimuth and elevation of the sun, for SAM and SolarPILOT.

The conventions follow the source code of NREL's ssc and SolarPILOT:

- SAM's molten-salt power tower reads user-defined performance (``eta_map``) as rows of azimuth, zenith angle [deg] and
  efficiency. SAM interpolates at the azimuth of its weather reader, clockwise from north, 0 to 360 deg
  (`C_pt_sf_perf_interp::call`). The interpolation is not periodic, so rows for both 0 and 360 deg are written if the
  table has either azimuth. Rows with the sun below the horizon are omitted, because SAM stops the field at night. Each
  row has a flux map (``flux_maps``), which contains the fraction of the receiver's light on each column. The columns of
  a cylinder run from south via east and north to west. SAM sums the flux over the height.
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
product of the missing factors. SAM's generic solar field also multiplies the efficiency by its own
optical factors.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from heliosweep.config import YEAR, Study, SunDirections, blocks_in, ends, load_mapping, places_of, weather_of
from heliosweep.economics import levelized_cost
from heliosweep.errors import HeliosweepError, Problem, StudyError, load_extra
from heliosweep.files import write_rows
from heliosweep.lazy import pvlib
from heliosweep.share.fields import chosen, dimension_of, layout_of
from heliosweep.store.folder import target_file

#: Table formats: ``tower`` (rows for SAM's molten-salt power tower), ``generic`` (matrix for SAM's generic solar field)
#: and ``solarpilot`` (matrix for SolarPILOT's Python interface).
TableForm: TypeAlias = Literal["tower", "generic", "solarpilot"]

_AZIMUTH, _ELEVATION = "sun_azimuth", "sun_elevation"
#: Study keys and dimensions that sun directions replace.
_GONE = ("site.", "sites", "time.", "weather.", "limits.", "availability.", "economics.", "budget.")
_SAME = 1e-9  # maximum difference between angles that count as equal [deg]
#: Variables for an efficiency table in order of preference, with the factors included in each.
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
    if time is None or ("", SunDirections) not in blocks_in(time.annotation):
        message = f"{study.family} does not support 'clock: sun', which a table over sun directions needs"
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
        Value along each dimension of the result, except the sun directions.
    variable : str, optional
        Variable of the whole field (default: total efficiency with `optics`, otherwise optical efficiency).
    factor : float
        Product of efficiency factors that the result omits, such as the absorptance of the receiver, between 0 and 1.
        [1]

    Returns
    -------
    xarray.DataArray
        Efficiency over ``sun_elevation`` and ``sun_azimuth``, loaded into memory. The efficiency is NaN if the sun is
        below the horizon. [1]

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
        Value along each dimension of the result, except the sun directions.

    Returns
    -------
    xarray.DataArray
        Fractions over ``sun_elevation``, ``sun_azimuth`` and the columns. The sum over the columns is 1. Columns of a
        cylinder run from south via east and north to west. Columns of a rectangle run from left to right as seen from
        the mirrors. Fractions are NaN if the sun is below the horizon. [1]

    Raises
    ------
    StudyError
        If no light reaches the receiver, or if a cylinder has an odd number of columns. The errors of
        `efficiency_table` are also raised.
    """
    if "flux_map" not in result.data_vars:
        raise StudyError(Problem("the result has no flux map: add 'output: {flux_map: ...}' to the study"))
    flux = _over_directions(result, "flux_map", select, ("flux_row", "flux_column")).sum("flux_row", min_count=1)
    if flux["flux_column"].attrs["units"] == "degree":
        if flux.sizes["flux_column"] % 2:
            message = "must be even, because SAM's columns have edges at south and north"
            raise StudyError(Problem(message, "output.flux_map.columns"))
        flux = flux.isel(flux_column=np.argsort((180.0 - flux["flux_column"].to_numpy()) % 360.0))
    whole = flux.sum("flux_column", min_count=1)
    if (whole <= 0).any():
        raise StudyError(Problem("no light reaches the receiver for some sun directions", "flux_map"))
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
        Table from `efficiency_table` or `flux_maps`. Flux maps require the format ``tower``. Their rows contain no
        angles and have the same order as the rows of the efficiency table.
    path : path
        Output CSV file, written atomically.
    form : {"tower", "generic", "solarpilot"}
        Format for SAM's molten-salt power tower, for SAM's generic solar field, or for SolarPILOT. For sun directions
        below the horizon, the format ``tower`` contains no rows, and the other formats contain zeros.
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StudyError
        If the file exists, or if two azimuths are the same direction.
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
    """Return the rows of an efficiency table or of flux maps in one of the formats of `write_table`.

    If the table contains only one end of the full circle, its values are repeated at the other end, because SAM does
    not interpolate periodically.
    """
    azimuth, order = _azimuths(table[_AZIMUTH].to_numpy(), south=form == "generic")
    values, elevation = table.to_numpy()[:, order], table[_ELEVATION].to_numpy()
    low = -180.0 if form == "generic" else 0.0
    first, last = azimuth[0] == low, azimuth[-1] == low + 360.0
    if first != last and (form != "solarpilot" or azimuth.size < table.sizes[_AZIMUTH]):
        place, end, source = (azimuth.size, low + 360.0, 0) if first else (0, low, -1)
        azimuth, values = np.insert(azimuth, place, end), np.insert(values, place, values[:, source], axis=1)
    rows: list[list[Any]] = []
    if form == "tower":
        for i, j in np.ndindex(values.shape[:2]):
            if np.isfinite(values[i, j]).all():
                angles = [azimuth[j], 90 - elevation[i]] if values.ndim == 2 else []
                rows.append([*angles, *np.atleast_1d(values[i, j])])
    else:
        known = np.nan_to_num(values)
        matrix = ("", azimuth, 90 - elevation[::-1], known[::-1])
        corner, head, side, cells = (0, elevation, azimuth, known.T) if form == "solarpilot" else matrix
        rows = [[corner, *head], *([angle, *row] for angle, row in zip(side, cells, strict=True))]
    return [[cell if isinstance(cell, str) else _number(cell) for cell in row] for row in rows]


def _number(value: float) -> float | int:
    rounded = round(float(value), 9) + 0.0
    return int(rounded) if rounded.is_integer() else rounded


def _azimuths(north: NDArray, south: bool) -> tuple[NDArray, NDArray]:
    """Return the ascending azimuths of a format and their indices in the efficiency table.

    Azimuths from north range from 0 to 360 deg, and azimuths from south from -180 to 180 deg. Both ends of the range
    are the same direction, and the table may contain both. If a full circle has other ends, such as -180 and 180 deg
    from north, one end is omitted.
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


#: Python module of SAM, its package, and the extra that installs the package.
EXTRA = ("PySAM.TcsmoltenSalt", "nrel-pysam", "sam")
#: SAM output, unit and long name of each annual time series.
_SERIES = {
    "electric_power": ("P_out_net", "MW", "net electric power"),
    "absorbed_power": ("q_dot_rec_inc", "MW", "power absorbed by the receiver"),
    "receiver_loss": ("q_thermal_loss", "MW", "thermal losses of the receiver"),
    "receiver_heat": ("Q_thermal", "MW", "heat of the receiver"),
    "stored_heat": ("e_ch_tes", "MWh", "heat in the storage"),
    "dni": ("beam", "W/m2", "direct normal irradiance"),
}
#: SAM inputs and conversion factors for study keys. An acre is 4046.8564 m2, and 80 % of the costs are taxed.
_KEYS = {
    "receiver.height": ("h_tower", 1.0), "receiver.height_extent": ("rec_height", 1.0),
    "receiver.radius": ("D_rec", 2.0), "receiver.absorptance": ("rec_absorptance", 1.0),
    "receiver.thermal_losses.per_area": ("rec_hl_perm2", 1.0), "heliostat.height": ("helio_height", 1.0),
    "limits.wind_speed": ("v_wind_max", 1.0), "limits.sun_elevation": ("hel_stow_deploy", 1.0),
    "design_point.dni": ("dni_des", 1.0), "economics.site_cost": ("site_spec_cost", 1.0),
    "economics.heliostat_cost": ("heliostat_spec_cost", 1.0), "economics.land_cost": ("land_spec_cost", 4046.8564),
    "economics.further_land": ("csp_pt_sf_fixed_land_area", 1 / 4046.8564),
    "economics.tower_cost": ("tower_fixed_cost", 1.0), "economics.tower_scale": ("tower_exp", 1.0),
    "economics.receiver_cost": ("rec_ref_cost", 1.0), "economics.receiver_reference_area": ("rec_ref_area", 1.0),
    "economics.receiver_exponent": ("rec_cost_exp", 1.0), "economics.other_cost": ("cost_sf_fixed", 1.0),
    "economics.contingency": ("contingency_rate", 100.0), "economics.indirect": ("csp_pt_cost_epc_percent", 100.0),
    "economics.sales_tax": ("sales_tax_rate", 125.0), "economics.fixed_charge_rate": ("fixed_charge_rate", 1.0),
    "economics.operation_cost": ("operation", 1.0),
}  # fmt: skip
#: Variables needed for SAM's efficiency tables and flux maps, and study keys that provide them.
FIELD = ["field_total_efficiency", "flux_map", "field_mirror_area"]
OUTPUT = {"output.flux_map": {"columns": 20, "rows": 1}, "output.field_geometry": True}


def tower_electricity(
    efficiency: xr.DataArray, flux: xr.DataArray, weather: str | os.PathLike[str] | Mapping[str, Any],
    positions: ArrayLike, mirror_area: float, *, inputs: Mapping[str, Any] | None = None,
    heat: float | None = None, fixed_charge_rate: float = 0.07, operation: float = 0.0,
) -> xr.Dataset:  # fmt: skip
    """Compute the annual electricity from a tower plant with SAM's molten-salt power tower.

    Parameters
    ----------
    efficiency : xarray.DataArray
        Efficiency over ``sun_elevation`` and ``sun_azimuth``, without thermal losses. Use `efficiency_table` with the
        absorptance of the receiver as `factor`. [1]
    flux : xarray.DataArray
        Fraction of the receiver's light on each column, from `flux_maps`. [1]
    weather : path or mapping
        Weather data for one year as a file that SAM can read (TMY3, EPW or SAM CSV), or as SAM's
        ``solar_resource_data``.
    positions : array of shape (heliostats, 2)
        Coordinates of the heliostats east and north of the tower. [m]
    mirror_area : float
        Total area of all mirrors. [m2]
    inputs : mapping of str to value, optional
        Inputs of ``PySAM.TcsmoltenSalt`` that differ from the ``MSPTSingleOwner`` defaults, such as ``{"tshours": 6}``.
    heat : float, optional
        Thermal power of the receiver at the design point. The turbine power is
        ``P_ref = heat * design_eff / solarm`` (default: 115 MW). [MW]
    fixed_charge_rate : float
        Fraction of the installed cost that is paid each year. [1]
    operation : float
        Annual cost of operation and maintenance. [USD]

    Returns
    -------
    xarray.Dataset
        Annual values: `electricity` [MWh], `turbine_power` [MW], `capacity_factor` [1], `installed_cost` [USD] and
        `levelized_cost_of_electricity` [USD/MWh]. Time series: `electric_power`, `absorbed_power`, `receiver_loss` and
        `receiver_heat` [MW], `stored_heat` [MWh] and `dni` [W/m2]. The ``time`` coordinate is the middle of each
        interval, measured from the start of the year [h].

    Raises
    ------
    HeliosweepError
        If PySAM is not installed, or if SAM rejects an input.

    References
    ----------
    SAM technical manual for molten-salt power towers, NREL/TP-5500-57625 (2013).

    Examples
    --------
    Compute one year for a small field, with the receiver and turbine of SAM's default plant:

    >>> import heliosweep
    >>> sun = {"azimuth": {"start": 0, "stop": 360, "step": 45}, "elevation": [15, 45, 75]}
    >>> table = heliosweep.efficiency_table("cylinder.yaml", **sun)
    >>> maps = heliosweep.flux_maps("cylinder.yaml", **sun)
    >>> field = heliosweep.layout_of(heliosweep.load("cylinder.yaml"))
    >>> place = list(zip(field.x, field.y))
    >>> year = heliosweep.tower_electricity(table, maps, "greensboro.csv", place, 7.5e5)
    >>> round(float(year.capacity_factor), 2)
    0.26
    """
    model = load_extra(*EXTRA).default("MSPTSingleOwner")
    place = np.asarray(positions, np.float64)
    year = {"solar_resource_data": weather} if isinstance(weather, Mapping) else {"solar_resource_file": str(weather)}
    given: dict[str, Any] = {
        **year, "field_model_type": 3, "eta_map_aod_format": 0, "eta_map": table_rows(efficiency),
        "flux_maps": table_rows(flux), "helio_positions": place.tolist(), "N_hel": len(place),
        "dens_mirror": 1.0, "helio_height": model.value("helio_height"), **(inputs or {}),
    }  # fmt: skip
    # SAM computes the total mirror area from `dens_mirror` and the number and sides of the mirrors.
    given.setdefault("helio_width", mirror_area / len(place) / given["helio_height"] / given["dens_mirror"])
    if heat is not None:
        share, multiple = (given.get(key, model.value(key)) for key in ("design_eff", "solarm"))
        given.setdefault("P_ref", heat * share / multiple)
    name = ""
    try:
        for name, value in given.items():
            model.value(name, value)
        name = ""
        model.execute(0)
    except Exception as error:  # PySAM raises plain Exception
        raise HeliosweepError(f"SAM: {name and f'{name}: '}{' '.join(str(error).split())}") from error
    out = model.Outputs
    energy = out.annual_energy / 1e3
    cost = np.nan  # the plant consumes more electricity than it generates
    if energy > 0:
        cost = levelized_cost(
            out.total_installed_cost, energy, fixed_charge_rate=fixed_charge_rate, operation=operation
        )
    end = np.array(out.time_hr)
    made = {
        "electricity": ((), energy, {"units": "MWh", "long_name": "annual electricity"}),
        "turbine_power": ((), model.value("P_ref"), {"units": "MW", "long_name": "gross turbine power"}),
        "capacity_factor": ((), out.capacity_factor / 100, {"units": "1", "long_name": "capacity factor"}),
        "installed_cost": ((), out.total_installed_cost, {"units": "1", "long_name": "installed cost in USD"}),
        "levelized_cost_of_electricity": (
            (), cost, {"units": "MWh-1", "long_name": "levelized cost of electricity in USD"},
        ),
        **{
            key: ("time", np.array(getattr(out, series)), {"units": unit, "long_name": words})
            for key, (series, unit, words) in _SERIES.items()
        },
    }  # fmt: skip
    time = ("time", end - end[0] / 2, {"units": "h", "long_name": "time from the start of the year"})
    return xr.Dataset(made, {"time": time})


def _check(study: Study, values: Mapping[str, Any]) -> None:
    files, kind, currency = len(weather_of(study)), values.get("receiver.kind"), values.get("economics.currency")
    horizon, losses = any(key.startswith("site.horizon.") for key in values), "receiver.thermal_losses.file"
    wrong = (
        ("search", study.search is not None, "describes many plants: run the best plant without 'search'"),
        ("receiver.kind", kind != "cylinder", f"must be cylinder, SAM's external receiver (got {kind})"),
        ("site", "site.latitude" not in values, "is missing: SAM needs one site"),
        ("site.horizon", horizon, "is not supported by SAM: remove it"),
        (
            "economics.currency",
            currency not in (None, "USD"),
            f"must be USD, because SAM's other costs are in USD (got {currency})",
        ),
        (losses, values.get(losses), "is not supported by SAM: use 'per_area'"),
        ("weather.file", files != 1, f"must be one file with all hours of a year (got {files} files)"),
    )
    if problems := [study.problem(key, message) for key, is_wrong, message in wrong if is_wrong]:
        raise StudyError(problems)


def electricity_of(
    study: Study, result: xr.Dataset, select: Mapping[str, Any], inputs: Mapping[str, Any],
    field: Callable[[], xr.Dataset],
) -> xr.Dataset:  # fmt: skip
    """Compute the annual electricity of the plant in a result.

    The function `field` computes a result for the same field over sun directions.

    Raises
    ------
    StudyError
        If SAM cannot model the plant, or if `select` has no value for a swept parameter. The error is also raised if
        the result has no receiver heat at the design point, or if the weather does not cover a year.
    HeliosweepError
        As in `tower_electricity`.
    """
    values = {key: value for key, _, value in study.parameters()}
    _check(study, values)
    names = [name for name in ("field_receiver_energy", "field_heat", "design_point_heat", "loss") if name in result]
    here = chosen(result[names], select, ("stage",)).compute()
    if "P_ref" not in inputs and "design_point_heat" not in here:
        message = (
            "is needed for the turbine power: add it with 'receiver.absorptance', or specify P_ref in MW with --sam"
        )
        raise StudyError(study.problem("design_point", message))
    labels = {key: name for key, name in study.dimension_names().items() if key in study.sweeps()}
    values |= {key: here[name].item() for key, name in labels.items() if name in here.coords}
    given = {name: values[key] * factor for key, (name, factor) in _KEYS.items() if values.get(key) is not None}
    if (lost := values.get("receiver.thermal_losses.constant")) is not None:
        given["rec_hl_perm2"] = 1e3 * lost / (np.pi * given["D_rec"] * given["rec_height"])
    cost = {name: given.pop(name) for name in ("fixed_charge_rate", "operation") if name in given}
    energy = here["field_receiver_energy"]
    stopped = float(here["loss"].sel(stage="availability") if "availability" in here["stage"].values else 0.0)
    given |= {"sf_adjust_constant": 100.0 * stopped / (float(energy) + stopped), **inputs}
    heat = float(here["design_point_heat"]) if "design_point_heat" in here else None
    weather, time = _weather(study, values)
    directed, along = field(), result["kept" if "kept" in result else "x"]
    layout = layout_of(result, {key: select[key] for key in select if dimension_of(along, key) in along.dims})
    place, area = np.stack((layout.x, layout.y), axis=1), float(directed["field_mirror_area"].max())
    tables = efficiency_table(directed, factor=values["receiver.absorptance"] or 1.0), flux_maps(directed)
    year = tower_electricity(*tables, weather, place, area, inputs=given, heat=heat, **cost)
    year = year.assign_coords(time=("time", time, {"long_name": "local time"}))
    year = year.assign(here[[name for name in names if name.startswith("field_")]].reset_coords(drop=True))
    return year.assign_attrs({name: result.attrs[name] for name in ("title", "study_id") if name in result.attrs})


def _weather(study: Study, values: Mapping[str, Any]) -> tuple[dict[str, Any], pd.DatetimeIndex]:
    """Return the weather of a study as SAM's ``solar_resource_data``, and the local times of its rows.

    The rows begin on 1 January and omit 29 February. Missing temperatures are replaced by 20 C, and missing wind speeds
    by 0 m/s. Raises StudyError if the weather does not cover a year.
    """
    (file,) = weather_of(study)
    latitude, longitude, altitude = (values[f"site.{key}"] for key in ("latitude", "longitude", "altitude"))
    longitude = file.longitude if longitude is None else longitude
    zone, step = round(longitude / 15), round(60 * file.hours)
    local = pd.DatetimeIndex(file.utc) + pd.Timedelta(hours=zone)
    year = 365 * 24 * 60  # [min]
    is_leap_day = (local.month == 2) & (local.day == 29) & (len(file) * step > year)
    kept = np.flatnonzero(~is_leap_day)
    if kept.size * step != year:
        raise StudyError(study.problem("weather.file", f"must have all hours of a year (got {len(file):,} rows)"))
    minute = (60 * local.hour + local.minute).to_numpy()
    order = np.roll(kept, -np.argmin((1440 * (31 * local.month + local.day) + minute)[kept]))
    begin = pd.date_range(f"{YEAR}-01-01", periods=order.size, freq=pd.Timedelta(minutes=step))
    time = begin + pd.to_timedelta(minute[order] % step, "min")
    temperature = np.nan_to_num(file.temperature, nan=20.0)
    series = {
        **{key: getattr(time, key) for key in ("year", "month", "day", "hour", "minute")},
        "dn": (file.dni * (values.get("weather.dni_factor") or 1.0))[order], "gh": np.zeros(order.size),
        "df": np.zeros(order.size), "tdry": temperature[order], "tdew": temperature[order] - 10.0,
        "wspd": np.nan_to_num(file.wind)[order], "pres": np.full(order.size, pvlib.atmosphere.alt2pres(altitude) / 100),
    }  # fmt: skip
    data = {key: np.asarray(value, np.float64).tolist() for key, value in series.items()}
    return {**data, "lat": latitude, "lon": longitude, "tz": float(zone), "elev": altitude}, time

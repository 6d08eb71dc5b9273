"""Electricity from a tower plant, computed from an efficiency table with SAM's molten-salt power tower model."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike

from heliosweep.config import YEAR, Study, weather_of
from heliosweep.economics import levelized_cost
from heliosweep.errors import HeliosweepError, StudyError, load_extra
from heliosweep.lazy import pvlib
from heliosweep.share.fields import chosen, dimension_of, layout_of
from heliosweep.share.sam import efficiency_table, flux_maps, table_rows

#: Python module of SAM, package that contains the module, and extra that installs the package.
EXTRA = ("PySAM.TcsmoltenSalt", "nrel-pysam", "sam")
#: SAM output, unit and long name of each annual time series.
_SERIES = {
    "electric_power": ("P_out_net", "MW", "net electric power"),
    "absorbed_power": ("q_dot_rec_inc", "MW", "power that the receiver absorbs"),
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
#: Variables that SAM's efficiency tables and flux maps need, and the study keys that these variables require.
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
        Fraction of the receiver's light that falls on each column, from `flux_maps`. [1]
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
        `receiver_heat` [MW], `stored_heat` [MWh] and `dni` [W/m2]. The coordinate ``time`` is the middle of each
        interval, measured from the start of the year [h].

    Raises
    ------
    HeliosweepError
        If PySAM is not installed, or SAM rejects an input.

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
    # SAM computes the total mirror area from the number and sides of the mirrors and `dens_mirror`.
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
    except Exception as error:  # PySAM raises exceptions of the base class
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
        ("search", study.search is not None, "has many plants: run the best plant without 'search'"),
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
    """Compute the electricity from the plant that a result describes.

    The function `field` computes the result for the plant's field over sun directions.

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
        message = "is needed for the turbine power: add it with 'receiver.absorptance', or give P_ref in MW with --sam"
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
    """Return the weather in a study as SAM's ``solar_resource_data``, and the local times of its rows.

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

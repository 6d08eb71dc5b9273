"""Electricity of a tower plant behind an efficiency table, by the molten-salt tower of SAM."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from heliosweep.economics import levelized_cost
from heliosweep.errors import HeliosweepError, load_extra
from heliosweep.share.sam import tower_rows

#: Series of a year: output of SAM, unit and long name.
_SERIES = {
    "electric_power": ("P_out_net", "MW", "net electric power"),
    "receiver_power": ("q_dot_rec_inc", "MW", "power of the light on the receiver"),
    "receiver_loss": ("q_thermal_loss", "MW", "thermal losses of the receiver"),
    "receiver_heat": ("Q_thermal", "MW", "heat of the receiver"),
    "stored_heat": ("e_ch_tes", "MWh", "heat in the storage"),
    "dni": ("beam", "W/m2", "direct normal irradiance"),
}


def tower_electricity(
    efficiency: xr.DataArray, flux: xr.DataArray, weather: str | os.PathLike[str] | Mapping[str, Any],
    positions: ArrayLike, mirror_area: float, *, inputs: Mapping[str, Any] | None = None,
    fixed_charge_rate: float = 0.07, operation: float = 0.0,
) -> xr.Dataset:  # fmt: skip
    """Compute the electricity of a year with SAM's molten-salt power tower.

    Parameters
    ----------
    efficiency : xarray.DataArray
        Over ``sun_elevation`` and ``sun_azimuth``, from `efficiency_table`, without the receiver's losses. [1]
    flux : xarray.DataArray
        Shares of the receiver's columns, from `flux_maps`. [1]
    weather : path or mapping
        A year: a file in a form that SAM reads (TMY3, EPW or its own CSV), or SAM's ``solar_resource_data``.
    positions : array of shape (heliostats, 2)
        East and north of the tower. [m]
    mirror_area : float
        Area of all mirrors. [m2]
    inputs : mapping of str to value, optional
        Inputs of ``PySAM.TcsmoltenSalt`` that differ from its default ``MSPTSingleOwner``, such as
        ``{"tshours": 6}``.
    fixed_charge_rate : float
        Part of the installed cost that is paid in each year. [1]
    operation : float
        Cost of operation and maintenance in a year. [USD]

    Returns
    -------
    xarray.Dataset
        `electricity` [MWh], `capacity_factor` [1], `installed_cost` [USD] and `levelized_cost_of_electricity`
        [USD/MWh] of the year; over ``time``, the middle of each interval from the start of the year [h],
        `electric_power`, `receiver_power`, `receiver_loss` and `receiver_heat` [MW], `stored_heat` [MWh] and `dni`
        [W/m2].

    Raises
    ------
    HeliosweepError
        If PySAM is not installed, or SAM refuses an input.

    References
    ----------
    SAM technical manual for molten-salt power towers, NREL/TP-5500-57625 (2013).

    Examples
    --------
    The table of a small field, with the receiver and turbine of the default plant of SAM:

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
    model = load_extra("PySAM.TcsmoltenSalt", "nrel-pysam", "sam").default("MSPTSingleOwner")
    place = np.asarray(positions, np.float64)
    is_file = isinstance(weather, str | os.PathLike)
    given = {
        "solar_resource_file" if is_file else "solar_resource_data": os.fspath(weather) if is_file else dict(weather),
        "field_model_type": 3, "eta_map_aod_format": 0, "eta_map": tower_rows(efficiency),
        "flux_maps": tower_rows(flux), "helio_positions": place.tolist(), "N_hel": len(place),
        "dens_mirror": 1.0, "helio_height": model.value("helio_height"), **(inputs or {}),
    }  # fmt: skip
    # SAM computes the area of all mirrors from their number, sides and `dens_mirror`.
    given.setdefault("helio_width", mirror_area / len(place) / given["helio_height"] / given["dens_mirror"])
    name = ""
    try:
        for name, value in given.items():
            model.value(name, value)
        name = ""
        model.execute(0)
    except Exception as error:  # PySAM raises bare exceptions
        text = " ".join(str(error).split())
        raise HeliosweepError(f"SAM: {name and f'{name}: '}{text}") from error
    out = model.Outputs
    energy = out.annual_energy / 1e3
    cost = np.nan  # of a plant that consumes more than it generates
    if energy > 0:
        cost = levelized_cost(
            out.total_installed_cost, energy, fixed_charge_rate=fixed_charge_rate, operation=operation
        )
    end = np.array(out.time_hr)
    made = {
        "electricity": ((), energy, {"units": "MWh", "long_name": "electricity of a year"}),
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

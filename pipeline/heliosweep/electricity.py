"""Electricity of a tower plant behind an efficiency table, by the molten-salt tower of SAM."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.economics import levelized_cost
from heliosweep.errors import HeliosweepError

if TYPE_CHECKING:
    import xarray as xr


def tower_electricity(
    efficiency: xr.DataArray, flux: xr.DataArray, weather: str | os.PathLike[str], positions: ArrayLike,
    mirror_area: float, *, inputs: Mapping[str, Mapping[str, Any]] | None = None,
    fixed_charge_rate: float = 0.07, operation: float = 0.0,
) -> xr.Dataset:  # fmt: skip
    """Compute the electricity of a year with SAM's molten-salt power tower.

    Parameters
    ----------
    efficiency : xarray.DataArray
        Over ``sun_elevation`` and ``sun_azimuth``, from `efficiency_table`, without the receiver's losses. [1]
    flux : xarray.DataArray
        Shares of the receiver's columns, from `flux_maps`. [1]
    weather : path
        A year in the form of SAM.
    positions : array of shape (heliostats, 2)
        East and north of the tower. [m]
    mirror_area : float
        Area of all mirrors. [m2]
    inputs : mapping of group to mapping of name to value, optional
        Inputs of ``PySAM.TcsmoltenSalt`` that differ from its default ``MSPTSingleOwner``.
    fixed_charge_rate : float
        Part of the installed cost that is paid in each year. [1]
    operation : float
        Cost of operation and maintenance in a year. [USD]

    Returns
    -------
    xarray.Dataset
        `electricity` [MWh], `capacity_factor` [1], `levelized_cost_of_electricity` [MWh-1].

    Raises
    ------
    HeliosweepError
        If PySAM is not installed, or SAM refuses an input.

    References
    ----------
    SAM technical manual for molten-salt power towers, NREL/TP-5500-57625 (2013).

    Examples
    --------
    >>> import heliosweep
    >>> electricity = heliosweep.tower_electricity(table, maps, "site.csv", xy, 1.2e6)  # doctest: +SKIP
    """
    import xarray as xr

    from heliosweep.share.sam import tower_rows

    try:
        from PySAM import TcsmoltenSalt
    except ImportError:
        raise HeliosweepError("electricity needs nrel-pysam: pip install 'heliosweep[sam]'") from None
    place = np.asarray(positions, np.float64)
    given: dict[str, Mapping[str, Any]] = {
        "SolarResource": {"solar_resource_file": os.fspath(weather)},
        "HeliostatField": {
            "field_model_type": 3, "eta_map_aod_format": 0, "eta_map": tower_rows(efficiency),
            "flux_maps": tower_rows(flux), "helio_positions": place.tolist(), "N_hel": len(place),
            "A_sf_in": float(mirror_area),
        },
    }  # fmt: skip
    model = TcsmoltenSalt.default("MSPTSingleOwner")
    try:
        for group, values in [*given.items(), *(inputs or {}).items()]:
            for name, value in values.items():
                setattr(getattr(model, group), name, value)
        model.execute(0)
    except Exception as error:  # PySAM raises bare exceptions
        raise HeliosweepError(f"SAM: {error}") from error
    out = model.Outputs
    energy = out.annual_energy / 1e3
    cost = levelized_cost(out.total_installed_cost, energy, fixed_charge_rate=fixed_charge_rate, operation=operation)
    return xr.Dataset(
        {
            "electricity": ((), energy, {"units": "MWh", "long_name": "electricity of a year"}),
            "capacity_factor": ((), out.capacity_factor / 100, {"units": "1", "long_name": "capacity factor"}),
            "levelized_cost_of_electricity": ((), cost, {"units": "MWh-1", "long_name": "levelized cost"}),
        }
    )

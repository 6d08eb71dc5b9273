"""Capital cost of a solar tower plant and levelized cost of its heat, computed without a study file.

Default values are taken from the molten-salt power tower in the System Advisor Model (SAM). Results are in the currency
of the input costs; the default costs are in US dollars.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.lazy import xr

#: Items along the ``item`` dimension of `capital_cost`, in order.
ITEMS = ("site", "heliostats", "tower", "receiver", "other", "contingency", "land", "indirect", "sales_tax")


def capital_cost(
    mirror_area: ArrayLike, tower_height: ArrayLike, receiver_area: ArrayLike, receiver_height: ArrayLike,
    heliostat_height: ArrayLike, land_area: ArrayLike = 0.0, *, site_cost: ArrayLike = 16.0,
    heliostat_cost: ArrayLike = 127.0, tower_cost: ArrayLike = 3e6, tower_scale: ArrayLike = 0.0113,
    receiver_cost: ArrayLike = 103e6, receiver_reference_area: ArrayLike = 1571.0,
    receiver_exponent: ArrayLike = 0.7, other_cost: ArrayLike = 0.0, contingency: ArrayLike = 0.07,
    land_cost: ArrayLike = 2.47105, indirect: ArrayLike = 0.13, sales_tax: ArrayLike = 0.04,
) -> xr.Dataset:  # fmt: skip
    """Compute the itemized capital cost of a heliostat field, tower and receiver.

    The tower and receiver costs are

        tower = tower_cost * exp(tower_scale * (tower_height - receiver_height / 2 + heliostat_height / 2)),
        receiver = receiver_cost * (receiver_area / receiver_reference_area) ** receiver_exponent.

    Contingency is proportional to the direct costs. Indirect costs and sales tax are proportional to the direct costs
    including contingency.

    Parameters
    ----------
    mirror_area : float, array or DataArray
        Total area of all mirrors. [m2]
    tower_height : float, array or DataArray
        Height of the receiver centre above the ground. [m]
    receiver_area : float, array or DataArray
        Area of the absorbing surface. [m2]
    receiver_height, heliostat_height : float, array or DataArray
        Height of the receiver from its lower to its upper edge, and height of a mirror. [m]
    land_area : float, array or DataArray
        Land area to purchase. [m2]
    site_cost, heliostat_cost, land_cost : float, array or DataArray
        Site cost and heliostat cost per unit mirror area, and land cost per unit land area. [m-2]
    tower_cost, tower_scale : float, array or DataArray
        Cost of a tower of zero height [1], and exponential growth rate of the cost with height [m-1].
    receiver_cost, receiver_reference_area, receiver_exponent : float, array or DataArray
        Cost of a receiver with the reference area [1], the reference area [m2], and the exponent of the area ratio [1].
    other_cost : float, array or DataArray
        Other direct costs, for example for storage and the power block.
    contingency, indirect, sales_tax : float, array or DataArray
        Contingency as a fraction of the direct costs. Indirect costs and sales tax as fractions of the direct costs
        including contingency. [1]

    Returns
    -------
    xarray.Dataset
        Variables `capital_cost` with the ``item`` dimension, and `total_capital_cost`.

    Raises
    ------
    ValueError
        If an area, a height or a cost is negative or not finite.

    References
    ----------
    SAM technical manual for molten-salt power towers, NREL/TP-5500-57625 (2013), Sect. 6, and PySAM 7.1 defaults.

    Examples
    --------
    >>> import heliosweep
    >>> cost = heliosweep.capital_cost(10_000.0, 60.0, 100.0, 6.0, 8.0)
    >>> cost.capital_cost.sel(item=["heliostats", "tower"]).round(-4).values.tolist()
    [1270000.0, 5980000.0]
    """
    given = {name: _labelled(name, value) for name, value in locals().items() if name != "xr"}
    g = SimpleNamespace(**given)
    height = g.tower_height - g.receiver_height / 2 + g.heliostat_height / 2
    direct = [
        g.mirror_area * g.site_cost,
        g.mirror_area * g.heliostat_cost,
        g.tower_cost * np.exp(g.tower_scale * height),
        g.receiver_cost * (g.receiver_area / g.receiver_reference_area) ** g.receiver_exponent,
        g.other_cost,
    ]
    before = sum(direct)
    after = before * (1.0 + g.contingency)
    items = [*direct, after - before, g.land_area * g.land_cost, after * g.indirect, after * g.sales_tax]
    cost = xr.concat(xr.broadcast(*items), xr.DataArray(list(ITEMS), dims="item"))
    cost.attrs = {"long_name": "capital cost", "units": "1"}
    total = cost.sum("item")
    total.attrs = {"long_name": "capital cost of all items", "units": "1"}
    return xr.Dataset({"capital_cost": cost, "total_capital_cost": total})


def levelized_cost(
    capital: ArrayLike, energy: ArrayLike, *, fixed_charge_rate: ArrayLike = 0.07, operation: ArrayLike = 0.0
) -> Any:
    """Compute the levelized cost of heat or another form of energy.

        cost = (fixed_charge_rate * capital + operation) / energy

    Parameters
    ----------
    capital : float, array or DataArray
        Capital cost, in any currency.
    energy : float, array or DataArray
        Annual energy. [MWh]
    fixed_charge_rate : float, array or DataArray
        Fraction of the capital cost that is paid each year. [1]
    operation : float, array or DataArray
        Annual operation and maintenance cost, in the currency of the capital cost.

    Returns
    -------
    float, array or DataArray
        Levelized cost, in the currency of the capital cost. [MWh-1]

    Raises
    ------
    ValueError
        If a value is negative or not finite, or if the energy is 0.

    References
    ----------
    Short, Packey and Holt (1995), A manual for the economic evaluation of energy efficiency and renewable energy
    technologies, NREL/TP-462-5173, Sect. 4.

    Examples
    --------
    >>> import heliosweep
    >>> round(heliosweep.levelized_cost(10e6, 20_000.0, operation=100e3), 6)
    40.0
    """
    for name, value in list(locals().items()):
        _labelled(name, value)
    if (np.asarray(energy) == 0.0).any():
        raise ValueError("`energy` must be above 0")
    return (fixed_charge_rate * _plain(capital) + _plain(operation)) / _plain(energy)


def _plain(value: Any) -> Any:
    return value if isinstance(value, float | int) or hasattr(value, "dims") else np.asarray(value, np.float64)


def _labelled(name: str, value: Any) -> xr.DataArray:
    """Return a value as a DataArray; an array without labels gets the ``design`` dimension."""
    if not isinstance(value, xr.DataArray):
        value = xr.DataArray(np.asarray(value, np.float64), dims=("design",)[: np.ndim(value)])
    if not (np.isfinite(value) & (value >= 0.0)).all():
        raise ValueError(f"`{name}` must be finite and at least 0")
    return value

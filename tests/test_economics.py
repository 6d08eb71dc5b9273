"""Costs against SAM."""

import numpy as np
import pytest
import xarray as xr

import heliosweep

#: Inputs and costs of the default plant of PySAM 7.1.1, `TcsmoltenSalt.default("MSPTSingleOwner")`, executed with the
#: TMY3 file of pvlib. Storage, balance of plant and power block are further direct costs; acres of 4046.8564 m2.
PLANT = {
    "mirror_area": 1348316.2572, "tower_height": 194.227, "receiver_area": np.pi * 16.922 * 20.4598,
    "receiver_height": 20.4598, "heliostat_height": 12.2, "land_area": 2079.2855194841195 * 4046.8564,
    "other_cost": 61407766.99029126 + 33350000.0 + 119600000.0,
}  # fmt: skip
COSTS = {
    "site": 21573060.115199994, "heliostats": 171236164.66439995, "tower": 25705616.751593173,
    "receiver": 79628026.66564947, "other": 214357766.99029126, "contingency": 35875044.46309937,
    "land": 20792855.194841195, "indirect": 71288838.3545303, "sales_tax": 21935027.18600933,
}  # fmt: skip


def test_costs_of_the_default_plant_of_sam():
    found = heliosweep.capital_cost(**PLANT)
    assert found.capital_cost.to_series().to_dict() == pytest.approx(COSTS, rel=2e-6)
    assert float(found.total_capital_cost) == pytest.approx(662392400.3856139, rel=1e-6)


def test_dimensions_are_kept():
    heights = xr.DataArray([80.0, 120.0], {"receiver_height": [80.0, 120.0]}, "receiver_height")
    found = heliosweep.capital_cost(1e4, heights, 100.0, 6.0, 8.0)
    assert found.capital_cost.dims == ("item", "receiver_height")
    assert found.total_capital_cost.diff("receiver_height") > 0
    costs = heliosweep.levelized_cost(found.total_capital_cost, xr.DataArray(2e4), fixed_charge_rate=0.1)
    assert costs.values == pytest.approx(found.total_capital_cost.values * 5e-6)

"""Heat of the receiver and costs: against sums over the hours, tables, draws, kept fields, and wrong keys."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

import heliosweep
from tests.families.field_efficiency.test_energy import BLOCKS, LIMITS
from tests.families.field_efficiency.test_keep import DESIGN
from tests.families.studies import computed

#: A year, with a receiver of 18.8 m2 that loses 10 kW/m2.
PLANT: dict[str, Any] = {
    **BLOCKS, "tracking": "azimuth_elevation", "design_point": DESIGN, "limits": LIMITS,
    "receiver": {**BLOCKS["receiver"], "absorptance": 0.94, "thermal_losses": {"per_area": 10}},
}  # fmt: skip
LOST = 10e-3 * 2 * np.pi * 1 * 3


@pytest.fixture(scope="module")
def plant(small) -> xr.Dataset:
    output = {"field_series": True, "field_geometry": True}
    return computed(small(**PLANT, economics={"operation_cost": 1000, "currency": "USD"}, output=output))


def test_heat_is_the_absorbed_power_less_the_losses_at_each_instant(plant):
    heat = np.maximum(0.94 * plant.field_power - LOST, 0.0)
    np.testing.assert_allclose(plant.field_heat_power, heat, rtol=1e-12, atol=1e-15)
    assert float(plant.field_heat) == pytest.approx(float(heat.sum()), rel=1e-12)
    assert plant.monthly_heat.sum().item() == pytest.approx(float(plant.field_heat), rel=1e-12)
    assert float(plant.design_point_heat) == pytest.approx(0.94 * float(plant.design_point_power) - LOST, rel=1e-12)
    losses = plant.loss.to_series()
    assert losses["absorption"] == pytest.approx(0.06 * float(plant.field_receiver_energy), rel=1e-9)
    working = float((plant.field_power > 0).sum())
    assert 0.9 * LOST * working < losses["thermal losses"] < LOST * working
    assert losses.sum() == pytest.approx(float(plant.field_incident_energy - plant.field_heat), rel=1e-12)
    assert (plant.heliostat_loss >= 0).all()


def test_other_results_are_those_of_a_field_without_losses(plant, small):
    plain = computed(small(**{**PLANT, "receiver": BLOCKS["receiver"]}, output={"field_geometry": True}))
    for name in plain.data_vars:
        found = plant[name].isel(stage=slice(7)) if "stage" in plant[name].dims else plant[name]
        np.testing.assert_array_equal(found, plain[name], err_msg=name)


def test_a_table_of_losses_is_interpolated(plant, small, tmp_path):
    (tmp_path / "losses.csv").write_text("power,losses\n0,0.02\n0.5,0.03\n2,0.12\n")
    receiver = {**BLOCKS["receiver"], "thermal_losses": {"file": str(tmp_path / "losses.csv")}}
    found = computed(small(**{**PLANT, "receiver": receiver}))
    power = plant.field_power
    heat = np.maximum(power - np.interp(power, [0, 0.5, 2], [0.02, 0.03, 0.12]), 0.0)
    assert float(found.field_heat) == pytest.approx(float(heat.sum()), rel=1e-12)


def test_draws_follow_the_year(plant, small):
    """Draws trace a part of the instants; the light at the others follows the cosine of the incidence."""
    drawn = {**PLANT, "receiver": {**PLANT["receiver"], "absorptance": {"uniform": [0.9399, 0.9401]}}}
    drawn["optics"] = {key: value for key, value in BLOCKS["optics"].items() if key != "rays"} | {"precision": 0.02}
    found = computed(small(**drawn, sample={"size": 16}))
    lost, whole = (result.loss.sel(stage="thermal losses") for result in (found, plant))
    assert float(lost.mean()) == pytest.approx(float(whole), rel=0.03)


def test_a_field_is_cut_to_a_heat(small):
    layout = {"radial_stagger": {"clearance": 13, "inner_radius": 25, "heliostats": 40}}
    cut = {**PLANT, "layout": layout, "keep": {"heat_power": 0.6, "by": "design_point_total_efficiency"}}
    found = computed(small(**cut))
    fewer = {**cut, "keep": {"heliostats": int(found.field_heliostats) - 1, "by": cut["keep"]["by"]}}
    assert float(found.design_point_heat) >= 0.6 > float(computed(small(**fewer)).design_point_heat)


def test_costs_are_those_of_the_functions(plant):
    found = heliosweep.capital_cost(
        20 * 72.0, 30.0, 2 * np.pi * 3, 3.0, 8.0, float(plant.field_land_area) + 45 * 4046.8564
    )  # fmt: skip
    np.testing.assert_allclose(plant.capital_cost, found.capital_cost, rtol=1e-6)
    level = heliosweep.levelized_cost(float(found.total_capital_cost), float(plant.field_heat), operation=1000.0)
    assert float(plant.levelized_cost_of_heat) == pytest.approx(level, rel=1e-6)
    assert plant.levelized_cost_of_heat.attrs["long_name"].endswith("in USD")


def test_sampled_days_count_for_a_year(small):
    """Twice as many equal days give the same cost of heat."""
    clear = {**PLANT, "weather": {"clear_sky": {"model": "meinel"}}, "economics": {}, "limits": None,
             "site": {"latitude": 37, "longitude": 0}}  # fmt: skip
    window = {"start": "06:00", "stop": "18:00", "step": 3}
    clock = {"clock": "civil", "timezone": "+00:00", "window": window, "sampling": "midpoint"}
    costs = [computed(small(**{**clear, "time": {**clock, "dates": dates}})) for dates in
             (["2021-06-20"], ["2021-06-20", "2021-06-21"])]  # fmt: skip
    assert float(costs[1].field_heat) == pytest.approx(2 * float(costs[0].field_heat), rel=5e-3)
    for name in ("levelized_cost_of_heat", "total_capital_cost"):
        assert float(costs[1][name]) == pytest.approx(float(costs[0][name]), rel=5e-3)

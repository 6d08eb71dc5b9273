"""Heat of the receiver and costs: against sums over the hours, tables, draws, kept fields, and wrong keys."""

from typing import Any

import numpy as np
import pytest
import xarray as xr

import heliosweep
from heliosweep import api
from heliosweep.share.fields import layout_of, write_layout
from tests.families.field_efficiency.test_energy import BLOCKS, LIMITS
from tests.families.studies import computed

DESIGN = {"day": 80, "solar_hour": 12, "dni": 950}
#: A year, with a receiver of 18.8 m2 that loses 10 kW/m2.
PLANT: dict[str, Any] = {
    **BLOCKS, "tracking": "azimuth_elevation", "design_point": DESIGN, "limits": LIMITS,
    "receiver": {**BLOCKS["receiver"], "absorptance": 0.94, "thermal_losses": {"per_area": 10}},
}  # fmt: skip
LOST = 10e-3 * 2 * np.pi * 1 * 3
OUTPUT = {"field_geometry": True, "flux_map": {"columns": 4, "rows": 3}}


@pytest.fixture(scope="module")
def plant(small) -> xr.Dataset:
    economics, output = {"operation_cost": 1000, "currency": "USD"}, {"field_series": True, **OUTPUT}
    return computed(small(**PLANT, economics=economics, output=output))


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
    plain = computed(small(**{**PLANT, "receiver": BLOCKS["receiver"]}, output=OUTPUT))
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


RINGS = {"radial_stagger": {"clearance": 13, "inner_radius": 50, "rings": 5}}
#: A polar field with all that a year and the way of the light give.
YEAR: dict[str, Any] = {
    **BLOCKS, "tracking": "azimuth_elevation",
    "layout": {"radial_stagger": {"clearance": 13, "inner_radius": 25, "heliostats": 20}}, "design_point": DESIGN,
}  # fmt: skip
PLACE = {"site": {"latitude": 40}, "tracking": "azimuth_elevation"}


def by_itself(study_of: Any, blocks: dict[str, Any], cut: xr.Dataset, path: Any) -> xr.Dataset:
    """The kept heliostats as a layout of their own."""
    write_layout(layout_of(cut), path)
    mirror = {key: value for key, value in blocks["heliostat"].items() if key not in ("width", "height")}
    return computed(study_of(**{**blocks, "layout": {"file": str(path)}, "heliostat": mirror}))


@pytest.mark.parametrize(
    ("blocks", "keep"),
    [
        (YEAR, {"heliostats": 9, "by": "receiver_energy"}),
        (YEAR | {"aim": {"strategy": "spread", "levels": 3}}, {"field_power": 0.5, "by": "energy_per_mirror_area"}),
    ],
)  # fmt: skip
def test_a_cut_field_is_the_field_of_the_heliostats_that_are_kept(small, tmp_path, blocks, keep):
    output: dict[str, Any] = {"time_series": True, "field_geometry": True, "tracking_angles": True}
    output["flux_map"] = {"columns": 4, "rows": 3}
    cut = computed(small(**blocks, keep=keep, output=output))
    alone = by_itself(small, {**blocks, "output": output}, cut, tmp_path / "kept.csv")
    rows = np.flatnonzero(cut["kept"] == 1)
    assert 1 < rows.size < cut.sizes["heliostat"]
    for name, values in alone.data_vars.items():
        of = cut[name].isel(heliostat=rows) if "heliostat" in values.dims else cut[name]
        np.testing.assert_array_equal(of, values, err_msg=str(name))
    for name in cut.data_vars:
        if "heliostat" in cut[name].dims and name not in ("kept", "selection_rank"):
            assert cut[name].where(cut["kept"] == 0).isnull().all(), name


def test_no_heliostat_is_kept_that_ranks_below_one_left_out(small):
    keep: dict[str, Any] = {"heliostats": [10, 60], "by": ["optical_efficiency", "design_point_optical_efficiency"]}
    cut = computed(small(layout=RINGS, keep=keep, design_point=DESIGN))
    whole = computed(small(layout=RINGS, design_point=DESIGN))
    for number in (10, 60):
        here = cut.sel(kept_heliostats=number)
        assert (here["kept"].sum("heliostat") == number).all()
        assert (here["field_heliostats"] == number).all()
        assert (here["selection_rank"].where(here["kept"] == 1).max("heliostat") == number).all()
    for name in keep["by"]:
        here, value = cut.sel(kept_by=name), whole[name]
        assert (
            value.where(here["kept"] == 1).min("heliostat") >= value.where(here["kept"] == 0).max("heliostat")
        ).all()
        ranked = here["selection_rank"].broadcast_like(here["kept"]).transpose(..., "heliostat").to_numpy() - 1
        values = value.broadcast_like(here["kept"]).transpose(*here["kept"].dims).to_numpy()
        values = np.moveaxis(values, here["kept"].dims.index("heliostat"), -1)
        assert (np.diff(np.take_along_axis(values, np.argsort(ranked, axis=-1), axis=-1)) <= 0).all()
        # Without the others, each has no more shade and no more in its way.
        for effect in ("shading", "blocking"):
            gain = here[f"{effect}_efficiency"] - whole[f"{effect}_efficiency"]
            assert float(gain.min()) >= -1e-12
            assert float(gain.max()) > 0


def test_a_field_for_a_power_is_the_smallest_of_the_best(small):
    study = small(**PLACE, layout=RINGS, design_point=DESIGN, keep={"field_power": 4, "by": "optical_efficiency"})
    cut = computed(study)
    number = int(cut["kept"].sum())
    assert float(cut["design_point_power"]) >= 4
    fewer = small(**PLACE, layout=RINGS, design_point=DESIGN,
                  keep={"heliostats": number - 1, "by": "optical_efficiency"})  # fmt: skip
    assert float(computed(fewer)["design_point_power"]) < 4
    area = 72.0
    power = area * 950e-6 * cut["design_point_optical_efficiency"].sum()
    assert float(cut["design_point_power"]) == pytest.approx(float(power), rel=1e-12)


def test_a_power_that_the_field_has_not_is_told(small, tmp_path, caplog):
    keep = {"field_power": [4, 50], "by": "optical_efficiency"}
    study = small(**PLACE, layout=RINGS, design_point=DESIGN, keep=keep)
    with api.run(study, tmp_path, report=False).open() as result:
        assert result["kept"].isel(kept_power=1).all()
    assert "1 of 2 fields do not reach keep.field_power even with all heliostats (at most 8.003 MW)" in caplog.text

"""The search for the least cost of heat against all points of a grid, and the derivative at its optimum."""

from typing import Any

import numpy as np
import pytest

import heliosweep

HEIGHT, CLEARANCE = "receiver.height", "layout.radial_stagger.clearance"
#: `tower_and_spacing` with 80 heliostats and 8 instants.
PLANT: dict[str, Any] = {
    "family": "field_efficiency",
    "site": {"latitude": 35, "longitude": 0},
    "tracking": "azimuth_elevation",
    "time": {
        "clock": "civil", "timezone": "+00:00", "dates": ["2021-03-21", "2021-06-21", "2021-12-21"],
        "window": {"start": "08:00", "stop": "16:00", "step": 4}, "sampling": "midpoint",
    },
    "weather": {"clear_sky": {"model": "meinel"}},
    "layout": {"radial_stagger": {"inner_radius": 40, "heliostats": 80, "clearance": 20}},
    "heliostat": {"width": 11, "height": 11, "pivot_height": 7, "focus": "slant"},
    "receiver": {"kind": "cylinder", "height": 60, "radius": 1.5, "height_extent": 4, "absorptance": 0.94},
    "optics": {"sun_shape": {"kind": "limb_darkened"}, "slope_error": 1.5, "attenuation": "delsol_clear", "rays": 256},
    "economics": {},
}  # fmt: skip


def computed(**changes: Any) -> Any:
    keys = {HEIGHT: "height", CLEARANCE: "clearance"}
    return heliosweep.build(heliosweep.load(PLANT, {key: changes[name] for key, name in keys.items()})).compute()


@pytest.fixture(scope="module")
def best(tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    """The best point of a search and its cost."""
    over = {HEIGHT: [30, 90], CLEARANCE: [15.6, 28]}
    search = {"minimise": "levelized_cost_of_heat", "over": over, "budget": 45, "seed": 0}
    ran = heliosweep.run({**PLANT, "search": search}, tmp_path_factory.mktemp("cost") / "out", report=False)
    with ran.open() as found:
        row = found.isel(evaluation=int(found.levelized_cost_of_heat.argmin("evaluation")))
        return {name: float(row[name]) for name in ("receiver_height", "clearance", "levelized_cost_of_heat")}


def test_at_the_optimum_the_tower_costs_as_much_more_as_it_gains(best):
    """d(capital)/capital = d(heat)/heat: the first from the formula of the tower, the second from differences."""
    step = np.arange(-12.0, 13.0, 4.0)
    line = computed(height=(best["receiver_height"] + step).tolist(), clearance=best["clearance"])
    heat = line.field_heat.to_numpy() / float(line.field_heat[3])
    gained = np.polyfit(step, heat, 3)[2]
    middle = line.isel(receiver_height=3)
    tower = float(middle.capital_cost.sel(item="tower"))
    dearer = 0.0113 * tower * 1.07 * 1.17 / float(middle.total_capital_cost)
    assert gained == pytest.approx(dearer, rel=0.1)

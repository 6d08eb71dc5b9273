"""Flux maps of studies: power of the field, design point, year, figures, and what is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from heliosweep import api
from heliosweep.families.field_efficiency import figures
from heliosweep.report.draw import draw
from tests.families.field_efficiency.test_aim import NOON
from tests.families.field_efficiency.test_optics import OPTICS, RECEIVER, lit  # noqa: F401
from tests.families.studies import computed

MAP = {"columns": 8, "rows": 6, "limit": 60}
YEAR = {"clock": "civil", "timezone": "+00:00", "dates": {"start": "2021-01-04", "stop": "2021-12-24", "step": 15},
        "window": {"start": "03:30", "stop": "20:30", "step": "1 h"}, "sampling": "midpoint"}  # fmt: skip


@pytest.fixture
def mapped(lit):  # noqa: F811
    return lambda **blocks: lit(**{
        "time": NOON, "site": None, "tracking": "azimuth_elevation", "output": {"flux_map": MAP}, **blocks,
    })  # fmt: skip


def test_the_cells_hold_the_power_of_the_field(mapped):
    result = computed(mapped(time={**NOON, "elevation": [50, -5]})).transpose("sun_elevation", ...)
    area = 2 * np.pi * 3 * 7
    power = result["flux_map"].isel(sun_elevation=0).sum() * area / 48
    heliostats = 72 * result["total_efficiency"].isel(sun_elevation=0)
    assert float(power) == pytest.approx(float(heliostats.sum()), rel=1e-12)
    day = result.isel(sun_elevation=0)
    assert float(day["mean_flux"]) == pytest.approx(float(power) / area)
    assert float(day["peak_flux"]) == pytest.approx(float(day["flux_map"].max()), rel=0.02)
    assert float(day["peak_flux"]) > 60
    assert 0 < float(day["peak_flux_error"]) < 0.02 * float(day["peak_flux"])
    assert float((day["flux_map_error"] / day["flux_map"].max()).max()) < 0.02
    bright = day["flux_map"].where(day["flux_map"] > 60).sum() / day["flux_map"].sum()
    assert float(day["power_above_limit"]) == pytest.approx(float(bright))
    assert 0 < float(bright) < 1
    for name in ("flux_map", "peak_flux", "mean_flux", "power_above_limit"):
        assert np.isnan(result[name].isel(sun_elevation=1)).all()
    np.testing.assert_allclose(result["flux_column"], 22.5 + 45 * np.arange(8))
    np.testing.assert_allclose(result["flux_row"], 7 * ((np.arange(6) + 0.5) / 6 - 0.5))
    assert result["peak_flux"].attrs["comment"].endswith(", direct normal irradiance 1000 W/m2")
    assert result["mean_flux"].attrs["comment"].endswith(", direct normal irradiance 1000 W/m2")
    assert np.isnan(result["field_total_efficiency_error"].isel(sun_elevation=1)).all()
    assert "flux_map" not in computed(mapped(output={}))


def test_no_light_is_no_flux(mapped, tmp_path):
    (tmp_path / "north.csv").write_text("x,y\n0,90\n")
    face = {"kind": "rectangle", "height": 60, "azimuth": 180, "width": 4, "height_extent": 6}
    result = computed(mapped(receiver=face, layout={"file": str(tmp_path / "north.csv")}))
    assert float(result["peak_flux"]) == float(result["mean_flux"]) == 0.0
    assert np.isnan(result["power_above_limit"])


def test_a_swept_size_has_cells_over_it(mapped):
    face = {"kind": "rectangle", "height": 60, "azimuth": 0, "tilt": -20, "width": [4, 8], "height_extent": 6}
    result = computed(mapped(receiver=face))
    assert result["flux_column"].attrs["units"] == "1"
    assert result["flux_row"].attrs["units"] == "m"
    power = result["flux_map"].sum(("flux_row", "flux_column")) * 6 * result["receiver_width"] / 48
    np.testing.assert_allclose(power, 72 * result["total_efficiency"].sum("heliostat"), rtol=1e-12)


@pytest.mark.filterwarnings("ignore:DatetimeIndex.dayofyear")
def test_the_design_point_and_the_year(mapped):
    point = {"day": 80, "solar_hour": 12, "dni": 900}
    blocks = {
        "time": YEAR, "site": {"latitude": 37, "longitude": -6, "altitude": 100},
        "weather": {"clear_sky": {"model": "meinel"}}, "design_point": point,
        "layout": {"radial_stagger": {"clearance": 13, "inner_radius": 90, "heliostats": 6}},
    }  # fmt: skip
    result = computed(mapped(**blocks))
    area = 2 * np.pi * 3 * 7 / 48
    power = float(result["flux_map"].sum()) * area * 1e-3
    assert power == pytest.approx(float(result["design_point_power"]), rel=1e-12)
    energy = float(result["energy_flux_map"].sum()) * area
    assert energy == pytest.approx(float(result["field_receiver_energy"]), rel=1e-12)


def test_figures(mapped):
    result = computed(
        mapped(aim={"strategy": "spread", "levels": [1, 2, 3]}, tracking=["spinning_elevation", "azimuth_elevation"])
    )
    drawn = {one.name: one for one in draw(result, figures.figures(result))}
    assert {"flux_maps", "efficiency_over_aim_levels"} <= set(drawn)
    assert "unrolled by the azimuth" in drawn["flux_maps"].caption
    axes = drawn["flux_maps"].figure.axes
    assert len(axes) == 7  # two ways of tracking by three levels, and the colour bar
    assert "kW/m\N{SUPERSCRIPT TWO}" in axes[-1].get_xlabel()


def test_a_year_of_weather_needs_no_design_point(mapped):
    site = {"latitude": 37, "longitude": -6, "altitude": 100}
    study = mapped(time=YEAR, site=site, weather={"clear_sky": {"model": "meinel"}}, receiver=RECEIVER)
    names = set(api.build(study).variables)
    assert "energy_flux_map" in names
    assert "flux_map" not in names

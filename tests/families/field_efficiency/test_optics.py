"""Blocks of the way of the light: products, what stays as it was, and what is wrong with a study."""

import re
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import xarray as xr

from heliosweep.energy import transmittance
from heliosweep.families.family import families
from heliosweep.kernels import rays
from tests.families.studies import computed

NOON = {"clock": "sun", "azimuth": 170, "elevation": 50}
RECEIVER = {"kind": "cylinder", "height": 60, "radius": 3, "height_extent": 7}
OPTICS = {
    "sun_shape": {"kind": "pillbox"}, "slope_error": 2, "reflectivity": 0.9, "cleanliness": 0.95,
    "attenuation": "delsol_clear",
}  # fmt: skip


def _vant_hull(slant: Any, visibility: float) -> Any:
    return transmittance(slant, "vant_hull", visibility=visibility, water_vapour=3, altitude=1500, receiver_height=60)


@pytest.fixture
def lit(small):
    def make(**blocks: Any) -> Any:
        given = {"receiver": RECEIVER, "optics": OPTICS, "site": {"latitude": 40}, **blocks}
        return small(**{"heliostat": {"width": 9, "height": 8, "pivot_height": 5, "focus": "slant"}, **given})

    return make


def test_one_product_before_averaging(lit):
    layout = {"radial_stagger": {"clearance": 13, "inner_radius": 90, "heliostats": 12}}
    few = {
        "layout": layout, "receiver": {**RECEIVER, "radius": 1, "height_extent": 2}, "optics": {**OPTICS, "rays": 64},
    }  # fmt: skip
    result = computed(lit(**few))
    series = computed(lit(**few, output={"time_series": True, "field_series": True}))
    optical, total = (series[f"instantaneous_{name}_efficiency"] for name in ("optical", "total"))
    product = optical * series["instantaneous_intercept_efficiency"]
    product = product * result["reflection_efficiency"] * result["attenuation_efficiency"]
    np.testing.assert_allclose(total, product, rtol=1e-12)
    np.testing.assert_allclose(result["total_efficiency"], product.mean("time").transpose(..., "heliostat"), rtol=1e-11)
    mean = (optical * series["instantaneous_intercept_efficiency"]).mean("time") / optical.mean("time")
    np.testing.assert_allclose(result["intercept_efficiency"], mean, rtol=1e-11)
    np.testing.assert_allclose(
        result["field_total_efficiency"], result["total_efficiency"].mean("heliostat"), rtol=1e-13
    )
    of_field = (result["optical_efficiency"] * result["intercept_efficiency"]).mean("heliostat")
    np.testing.assert_allclose(
        result["field_optical_efficiency"] * result["field_intercept_efficiency"], of_field, rtol=1e-13
    )
    for name in ("optical", "total"):
        each = series[f"instantaneous_{name}_efficiency"].mean("heliostat")
        np.testing.assert_allclose(series[f"field_instantaneous_{name}_efficiency"], each, rtol=1e-12)
    assert np.all(result["reflection_efficiency"] == 0.9 * 0.95)
    assert 0.2 < float(result["field_intercept_efficiency"].min()) < 0.999


def test_rays_agree_with_exact_polygons(lit, small, tmp_path):
    """A huge receiver, flat mirrors and a point as the sun: shading and blocking of parallel light."""
    (tmp_path / "point.csv").write_text("angle,brightness\n0,1\n0.001,1\n")
    receiver = {"kind": "rectangle", "height": 60, "azimuth": 0, "tilt": -90, "width": 4000, "height_extent": 4000}
    plain, blocks = computed(small(site={"latitude": 40})), {"heliostat": {"width": 9, "height": 8, "pivot_height": 5}}
    point = {"kind": "table", "file": str(tmp_path / "point.csv")}
    optics = {"sun_shape": point, "slope_error": 0, "rays": 1024}
    result = computed(lit(receiver=receiver, optics=optics, **blocks))
    np.testing.assert_allclose(result["cosine_efficiency"], plain["cosine_efficiency"], rtol=1e-9)
    for name in ("shading", "blocking", "optical"):
        found, wanted = (one[f"{name}_efficiency"].to_numpy() for one in (result, plain))
        assert wanted.min() < 0.99 or name == "blocking"
        np.testing.assert_allclose(found, wanted, atol=2e-3)
    np.testing.assert_array_equal(result["intercept_efficiency"], 1.0)
    np.testing.assert_allclose(result["total_efficiency"], result["optical_efficiency"], rtol=1e-12)
    assert "total_efficiency" not in plain


def test_means_and_series_share_their_rays_in_either_order_and_in_threads(lit, monkeypatch):
    layout = {"radial_stagger": {"clearance": 13, "inner_radius": 90, "heliostats": 5}}
    output, optics = {"field_series": True, "tracking_angles": True}, {**OPTICS, "rays": 64}
    site = {"latitude": [30, 40]}
    study = lit(layout=layout, site=site, tracking="azimuth_elevation", optics=optics, output=output)
    family, trace, together, traced = families()[study.family], rays.trace, threading.Barrier(2, timeout=60), []

    def counted(*args: Any, **given: Any) -> Any:
        traced.append(together.wait())
        return trace(*args, **given)

    monkeypatch.setattr(rays, "trace", counted)
    time = {"time": slice(0, family.workload(study).inner["time"])}

    def both_points(inputs: Any, series: bool) -> list[Any]:
        regions = [{"latitude": slice(row, row + 1)} | (time if series else {}) for row in range(2)]
        with ThreadPoolExecutor(2) as pool:
            return list(pool.map(lambda region: family.compute(study, inputs, region), regions))

    means_first, series_first = family.inputs(study), family.inputs(study)
    means, series = both_points(means_first, False), both_points(means_first, True)
    assert len(traced) == 2
    later = both_points(series_first, True), both_points(series_first, False)
    assert len(traced) == 4
    for one, other in zip((*series, *means), (*later[0], *later[1]), strict=True):
        xr.testing.assert_identical(one, other)
    assert bool(means[0]["primary_angle_travel"].notnull().all())


def test_a_former_method_is_read_with_a_note(lit):
    study = lit(optics={**OPTICS, "method": "gaussian"})
    assert any("optics.method is no longer used" in note for note in study.notes())


def test_air_of_a_site(lit):
    optics = {**OPTICS, "attenuation": "vant_hull", "visibility": ["5 km", "50 km"], "water_vapour": 3}
    result = computed(lit(optics=optics, site={"latitude": 40, "altitude": 1500}))
    found = result["attenuation_efficiency"].isel(tracking=0)
    place = np.array([result[axis].to_numpy() for axis in ("x", "y")])
    slant = np.hypot(np.hypot(*place) - 3, 55)  # to the surface of the cylinder
    for visibility, values in zip((5e3, 50e3), found.transpose("visibility", ...), strict=True):
        np.testing.assert_allclose(values, _vant_hull(slant, visibility), rtol=1e-12)
    assert np.all(found.diff("visibility") > 0)
    given = computed(lit(optics={**optics, "altitude": [0, 1500]}))["attenuation_efficiency"].isel(tracking=0)
    np.testing.assert_array_equal(given.sel(air_altitude=1500).transpose(*found.dims), found)


def test_polynomials_alone_end(lit):
    far = {"layout": {"radial_stagger": {"clearance": 13, "inner_radius": 3100, "rings": 1}}}
    for model, warned in (("ballestrin_hazy", True), ("leary_hankins", False), ("vant_hull", False)):
        notes = lit(**far, optics={**OPTICS, "attenuation": model}).notes()
        assert any(re.match(r"[\d,]+ heliostats farther than 3 km", note) for note in notes) == warned


MAP = {"columns": 8, "rows": 6, "limit": 60}
YEAR = {"clock": "civil", "timezone": "+00:00", "dates": {"start": "2021-01-04", "stop": "2021-12-24", "step": 15},
        "window": {"start": "03:30", "stop": "20:30", "step": "1 h"}, "sampling": "midpoint"}  # fmt: skip


@pytest.fixture
def mapped(lit):
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

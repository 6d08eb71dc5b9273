"""Blocks of the way of the light: products, what stays as it was, and what is wrong with a study."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from heliosweep.energy import transmittance
from tests.families.studies import computed

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
        "layout": layout,
        "receiver": {**RECEIVER, "radius": 1, "height_extent": 2},
        "optics": {**OPTICS, "rays": 64},
    }
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


def test_standard_errors_cover_the_differences_between_seeds(lit):
    """Two standard errors hold 95 %, also of the field, whose 24 values are within them 21 times at least."""
    layout = {"radial_stagger": {"clearance": 13, "inner_radius": 60, "heliostats": 20}}
    few = {"layout": layout, "receiver": {**RECEIVER, "radius": 1, "height_extent": 2}, "tracking": "azimuth_elevation"}
    made = [computed(lit(**few, optics={**OPTICS, "rays": 64, "seed": seed})) for seed in range(24)]
    exact = computed(lit(**few, optics={**OPTICS, "rays": 2**14, "seed": 99}))
    for name in ("total", "optical", "intercept"):
        for of, least in (("", 0.93), ("field_", 21 / 24)):
            key = f"{of}{name}_efficiency"
            off = np.array([(one[key] - exact[key]) / one[f"{key}_error"].clip(1e-12) for one in made])
            off = off[np.array([one[f"{key}_error"] > 0 for one in made])]
            assert np.mean(np.abs(off) < 2) >= least
            assert np.sqrt(np.median(off**2)) > 0.1


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

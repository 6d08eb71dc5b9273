"""Blocks of the way of the light: products, what stays as it was, and what is wrong with a study."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from heliosweep import api
from heliosweep.errors import StudyError
from heliosweep.families.field_efficiency import chain
from heliosweep.families.field_efficiency.chain import Air, transmittance
from heliosweep.families.field_efficiency.optics import KEYS
from heliosweep.kernels.intercept.mirror import Facets
from tests.conftest import shipped
from tests.families.studies import computed

RECEIVER = {"kind": "cylinder", "height": 60, "radius": 3, "height_extent": 7}
OPTICS = {
    "sun_shape": {"kind": "pillbox"}, "slope_error": 2, "reflectivity": 0.9, "cleanliness": 0.95,
    "attenuation": "delsol_clear",
}  # fmt: skip


@pytest.fixture
def lit(small):
    def make(**blocks: Any) -> Any:
        given = {"receiver": RECEIVER, "optics": OPTICS, "site": {"latitude": 40}, **blocks}
        return small(**{"heliostat": {"width": 9, "height": 8, "pivot_height": 5, "focus": "slant"}, **given})

    return make


def test_one_product_before_averaging(lit):
    layout = {"radial_stagger": {"clearance": 13, "inner_radius": 90, "heliostats": 12}}
    few = {"layout": layout, "receiver": {**RECEIVER, "radius": 1, "height_extent": 2}}
    result = computed(lit(**few))
    series = computed(lit(**few, output={"time_series": True}))
    product = series["instantaneous_optical_efficiency"] * series["instantaneous_intercept_efficiency"]
    product = product * result["reflection_efficiency"] * result["attenuation_efficiency"]
    np.testing.assert_allclose(series["instantaneous_total_efficiency"], product, rtol=1e-14)
    np.testing.assert_allclose(result["total_efficiency"], product.mean("time").transpose(..., "heliostat"), rtol=1e-13)
    mean = series["instantaneous_intercept_efficiency"].mean("time")
    np.testing.assert_allclose(result["intercept_efficiency"], mean, rtol=1e-13)
    np.testing.assert_allclose(
        result["field_total_efficiency"], result["total_efficiency"].mean("heliostat"), rtol=1e-13
    )
    assert np.all(result["reflection_efficiency"] == 0.9 * 0.95)
    assert 0.2 < float(result["field_intercept_efficiency"].min()) < 0.999


def test_what_was_there_keeps_its_bits(lit, small):
    """A huge receiver, perfect mirrors and clear air: the old values are the same, and the total is the optical one."""
    receiver = {"kind": "rectangle", "height": 60, "azimuth": 0, "tilt": -90, "width": 4000, "height_extent": 4000}
    plain = computed(small(site={"latitude": 40}))
    result = computed(lit(receiver=receiver, optics={"sun_shape": {"kind": "pillbox"}, "slope_error": 0}))
    for name in plain.data_vars:
        np.testing.assert_array_equal(result[name], plain[name])
    np.testing.assert_allclose(result["total_efficiency"], plain["optical_efficiency"], rtol=1e-12)
    assert "total_efficiency" not in plain


def test_the_quick_method_is_near(lit):
    result = computed(lit(optics={**OPTICS, "method": ["accurate", "gaussian"]}))
    accurate, quick = (
        result["field_intercept_efficiency"].sel(intercept_method=name) for name in ("accurate", "gaussian")
    )
    assert 0 < float(abs(accurate - quick).max()) < 0.05


def test_transmittance_at_one_kilometre():
    wanted = {
        "delsol_clear": 0.902766, "delsol_hazy": 0.746210, "leary_hankins": 0.895310, "ballestrin_clear": 0.861913,
        "ballestrin_hazy": 0.569813, "none": 1.0, "vant_hull": 0.850984,
    }  # fmt: skip
    for model, value in wanted.items():
        assert transmittance(model, np.array([1000.0]), Air())[0] == pytest.approx(value, abs=1e-6)


def test_air_of_a_site(lit):
    optics = {**OPTICS, "attenuation": "vant_hull", "visibility": ["5 km", "50 km"], "water_vapour": 3}
    result = computed(lit(optics=optics, site={"latitude": 40, "altitude": 1500}))
    found = result["attenuation_efficiency"].isel(tracking=0)
    place = np.array([result[axis].to_numpy() for axis in ("x", "y")])
    slant = np.hypot(np.hypot(*place) - 3, 55)  # to the surface of the cylinder
    for visibility, values in zip((5e3, 50e3), found.transpose("visibility", ...), strict=True):
        np.testing.assert_allclose(values, transmittance("vant_hull", slant, Air(visibility, 3, 1500, 60)), rtol=1e-12)
    assert np.all(found.diff("visibility") > 0)
    given = computed(lit(optics={**optics, "altitude": [0, 1500]}))["attenuation_efficiency"].isel(tracking=0)
    np.testing.assert_array_equal(given.sel(air_altitude=1500).transpose(*found.dims), found)


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ({"receiver": {"height": 60}}, "receiver: 'kind' is missing"),
        ({"receiver": {"kind": "cylinder", "height": 60, "radius": 3}}, "receiver: 'height_extent' is missing"),
        ({"receiver": {**RECEIVER, "width": 3}}, "receiver.width: is not for a receiver of kind cylinder"),
        ({"receiver": {**RECEIVER, "radius": 70}}, "receiver.radius: must be less than the distance of the mirrors"),
        (
            {"heliostat": {"width": 9, "height": 8, "pivot_height": 5, "focus": "slnt"}},
            "heliostat.focus: must be a length in m, or 'flat' or 'slant'",
        ),
        ({"optics": None}, "receiver.kind: is used with 'optics' only"),
        ({"optics": {**OPTICS, "reflectivity": 1.2}}, "optics.reflectivity: must be between 0 and 1"),
        ({"optics": {"sun_shape": {"kind": "pillbox"}}}, "optics: give 'slope_error'"),
        ({"optics": {**OPTICS, "sun_shape": {"kind": "buie"}}}, "'circumsolar_ratio' is missing"),
        (
            {"optics": {**OPTICS, "sun_shape": {"kind": "buie", "circumsolar_ratio": 0.9}}},
            "optics.sun_shape.circumsolar_ratio: must be between 0.001 and 0.8",
        ),
        (
            {"optics": {**OPTICS, "slope_error_vertical": 2}},
            "optics.slope_error_vertical: is given by 'slope_error' too",
        ),
        (
            {"heliostat": {"width": 9, "height": 8, "pivot_height": 5, "facets": {"columns": 4, "rows": 2, "gap": 3}}},
            "heliostat.facets.gap: leaves no width for 4 facets on 9 m",
        ),
    ],
)
def test_what_is_wrong_is_told(lit, blocks, message):
    with pytest.raises(StudyError, match=message.replace("(", r"\(")):
        api.plan(lit(**blocks))


def test_polynomials_alone_end(lit):
    far = {"layout": {"radial_stagger": {"clearance": 13, "inner_radius": 3100, "rings": 1}}}
    for model, warned in (("ballestrin_hazy", True), ("leary_hankins", False), ("vant_hull", False)):
        notes = lit(**far, optics={**OPTICS, "attenuation": model}).notes()
        assert any(re.match(r"[\d,]+ heliostats farther than 3 km", note) for note in notes) == warned


def test_a_receiver_below_the_ground_is_told(lit):
    low = {"receiver": {"height": 10, "kind": "cylinder", "radius": 2, "height_extent": 26}}
    assert "the receiver reaches 3 m below the foot of the tower" in lit(**low).notes()


def test_the_round_robin():
    """Intercepts of the round robin's heliostat, converged."""
    result = shipped("round_robin_2025")
    wanted = {
        ("round_robin_north.csv", "flat"): 0.849936,
        ("round_robin_north.csv", "slant"): 0.990732,
        ("round_robin_southeast.csv", "flat"): 0.929927,
        ("round_robin_southeast.csv", "slant"): 0.99998,
    }
    for (layout, focus), value in wanted.items():
        found = result["intercept_efficiency"].sel(layout=layout, focus=focus)
        assert float(found[0]) == pytest.approx(value, abs=1e-5)


def test_instants_that_are_padded_leave_the_table_of_a_field_known(lit, monkeypatch):
    """Sites whose clocks change have days of other lengths: the sun of the instants that one has not is NaN."""
    inputs, made = chain.Inputs(lit()), []
    values = {key.rpartition(".")[2]: None for key in KEYS}
    way = chain.Way(lit(), inputs, inputs.at({}), values)
    monkeypatch.setattr(chain, "table_of", lambda *given: made.append(given))
    monkeypatch.setattr(chain.Way, "scene", lambda *_: None)
    for hour in (1.0, 1.0, 2.0, 1.0):
        inputs.field_table(way, (np.ones(3), 1), np.array([[0.0, hour, 1.0], [np.nan] * 3]), 0.6)
    assert len(made) == 2


def test_threads_that_share_slopes_find_their_own(lit):
    """Another thread may replace what is kept at any time, as that of a point with another map."""

    class Replaced(dict[str, Any]):
        """What is kept is another's right after it was looked up or kept."""

        def get(self, what: str, other: Any = None) -> Any:
            found = super().get(what, other)
            self[what] = None
            return found

        def __setitem__(self, what: str, _: object) -> None:
            super().__setitem__(what, ("their key", "theirs"))

    def at_nodes(*given: Any) -> tuple[Any, ...]:
        made.append(given)
        return given

    inputs, made = chain.Inputs(lit()), list[Any]()
    inputs.maps["map.csv"] = SimpleNamespace(at_nodes=at_nodes)
    for width in (9.0, 7.0, 7.0):
        inputs._last = Replaced(inputs._last)
        one = (width, 8.0, Facets(1, 1, 0.0), False)
        assert inputs.slopes_of("map.csv", *one) == one
        inputs._last = {"slopes": (("map.csv", *one), one)}
    assert len(made) == 2

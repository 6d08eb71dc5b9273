"""Aim points under a limit of the flux in a study: the array function, an independent trace, instants and bad input."""

from __future__ import annotations

import numpy as np
import pytest

import heliosweep
from heliosweep.families.family import families
from tests.families.field_efficiency.test_optics import OPTICS, RECEIVER, lit  # noqa: F401
from tests.families.studies import computed

NOON = {"clock": "sun", "azimuth": 170, "elevation": 50}
LAYOUT = {"radial_stagger": {"clearance": 13, "inner_radius": 60, "heliostats": 40}}
#: The flux of all heliostats at the centre is 53 kW/m2.
AIM = {"strategy": "flux_limit", "limit": 22, "rows": 5, "columns": 3, "flux_rows": 8, "flux_columns": 16}
MAP = {"flux_map": {"rows": 8, "columns": 16}}


@pytest.fixture
def sunny(lit):  # noqa: F811
    return lambda **blocks: lit(
        **{"time": NOON, "site": None, "tracking": "azimuth_elevation", "layout": LAYOUT, "aim": AIM, **blocks}
    )


def test_the_study_has_the_aims_of_the_array_function(sunny):
    result = computed(sunny(optics={**OPTICS, "attenuation": "none"}, output=MAP))
    field = np.column_stack([*(result[axis].to_numpy() for axis in "xy"), np.full(40, 5.0)])
    receiver = heliosweep.Cylinder(height=60, radius=3, height_extent=7)
    expected = heliosweep.flux_limited_aims(
        field, receiver, 170, 50, 22, rows=5, flux_map=(8, 16), reflectivity=0.9 * 0.95, width=9, height=8,
        slope_error=2, sun_shape="pillbox", focus="slant",
    )  # fmt: skip
    np.testing.assert_array_equal(result["aim"], expected["aim"])
    for name in ("aimed_power", "power_bound", "aimed_flux_map", "aim_z"):
        np.testing.assert_allclose(result[name], expected[name], rtol=1e-6)
    # The rays of the study have other numbers than those of the choice.
    assert float(result["peak_flux"]) <= 22 * 1.02
    power = result["field_total_efficiency"] * 40 * 9 * 8 * 1e-3
    assert float(power) == pytest.approx(float(result["aimed_power"]), rel=5e-3)
    assert result["aimed_flux_map"].attrs["comment"] == "direct normal irradiance 1000 W/m2"


def test_more_power_than_levels_at_the_same_peak(sunny):
    levels = computed(sunny(aim={"strategy": "spread", "levels": 3}, output=MAP))
    limited = computed(sunny(aim={**AIM, "limit": float(levels["peak_flux"])}, output=MAP))
    assert float(limited["peak_flux"]) <= 1.02 * float(levels["peak_flux"])
    assert float(limited["field_total_efficiency"]) > 1.01 * float(levels["field_total_efficiency"])


def test_safety_and_limits_of_rows(sunny):
    result = computed(sunny(aim={**AIM, "safety": 0.9, "limits": [[7, 5], [6, 10]]}))
    rows = result["aimed_flux_map"].max("flux_column").to_numpy()
    assert (rows <= 0.9 * 1.006 * np.array([22] * 6 + [10, 5])).all()
    assert rows.max() > 0.9 * 20


def test_each_instant_has_its_aims(sunny):
    """The power of the field at an instant is the power of the aims that are chosen for it, and of one study of it."""
    when = {"clock": "solar", "days": [80], "hours": [9, 12]}
    given = {"site": {"latitude": 40}, "aim": {**AIM, "at": "instants"}, "output": {"field_series": True}}
    result = computed(sunny(time=when, **given))
    total = result["field_instantaneous_total_efficiency"] * 40 * 72 * 1e-3
    np.testing.assert_allclose(result["aimed_power"], total, rtol=5e-3)
    assert (result["aim"].isel(time=0) != result["aim"].isel(time=1)).any()
    noon = computed(sunny(time={**when, "hours": [12]}, site={"latitude": 40}))
    np.testing.assert_array_equal(result["aim"].isel(time=1), noon["aim"])
    whole = total.mean() / (40 * 72 * 1e-3)
    assert float(result["field_total_efficiency"]) == pytest.approx(float(whole), rel=1e-9)


def test_heliostats_behind_the_face_of_a_receiver_are_stowed(sunny):
    face = {"kind": "rectangle", "height": 60, "width": 8, "height_extent": 8}
    study = sunny(receiver=face, aim={**AIM, "limit": 100, "rows": 1, "columns": 1})
    result = computed(study)
    behind = result["y"] < 0
    assert (result["aim"].where(behind, drop=True) == -1).all()
    assert (result["aim"].where(~behind, drop=True) == 0).sum() > 10
    words = f"heliostats behind the receiver's face are stowed: {int(behind.sum())} of 40"
    assert any(words in note for note in study.notes())


def test_the_plan_has_the_memory_of_the_images(sunny):
    """40 heliostats with 15 aims light at most 8 x 10 of the 8 x 16 cells around a cylinder, 16 bytes each."""
    family, work = families()["field_efficiency"], [sunny(aim=aim) for aim in (None, AIM)]
    least, most = (family.workload(study).working_bytes(1, 1) for study in work)
    assert most - least >= 40 * 15 * 8 * 10 * 16

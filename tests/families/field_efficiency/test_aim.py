"""Aim points of heliostats: levels over the receiver, points of the layout, and what is wrong with them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import heliosweep
from heliosweep.families.family import families
from heliosweep.families.field_efficiency.traced import Way, turns
from heliosweep.kernels.field.efficiency import field_sums, sorted_field
from tests.families.field_efficiency.test_optics import NOON, OPTICS, lit  # noqa: F401
from tests.families.studies import computed

FIELD = np.array([[0, 70, 0], [40, 60, 1], [70, 0, 0], [30, -80, 0], [-60, -50, 2], [-90, 20, 0]], float)


def table(path: Path, aims: Any) -> dict[str, Any]:
    rows = "\n".join(",".join(map(repr, map(float, row))) for row in np.hstack((FIELD, aims)))
    path.write_text(f"x,y,z,aim_x,aim_y,aim_z\n{rows}\n", encoding="utf-8")
    return {"file": str(path)}


def facing(height: float = 60.0, radius: float = 3.0) -> np.ndarray:
    away = radius / np.hypot(FIELD[:, 0], FIELD[:, 1])[:, None] * FIELD[:, :2]
    return np.column_stack((away, np.full(len(FIELD), height)))


@pytest.fixture
def sunny(lit):  # noqa: F811
    return lambda **blocks: lit(**{"time": NOON, "site": None, "tracking": "azimuth_elevation", **blocks})


def test_points_of_the_layout(sunny, tmp_path):
    """The points that all aim at by default give the same bits; others move rays, also those that are blocked."""
    layout = table(tmp_path / "field.csv", facing())
    plain, given = computed(sunny(layout=layout)), computed(sunny(layout=layout, aim={"strategy": "layout"}))
    for name in plain.data_vars:
        np.testing.assert_array_equal(plain[name], given[name])
    lower = facing(58.0)
    moved = computed(sunny(layout=table(tmp_path / "field.csv", lower), aim={"strategy": "layout"}))
    sun = np.radians([170.0, 50.0])
    to_sun = np.array([[np.sin(sun[0]) * np.cos(sun[1]), np.cos(sun[0]) * np.cos(sun[1]), np.sin(sun[1])]])
    half = np.ones(len(FIELD))
    x, y, z = (FIELD + np.array([0, 0, 5])).T
    sums, _ = field_sums(sorted_field(x, y, z, 4.5 * half, 4.0 * half, lower), 1, to_sun, 0, len(FIELD))
    np.testing.assert_allclose(moved["optical_efficiency"], sums[:, 3], rtol=1e-13)
    assert np.all(moved["intercept_efficiency"] < plain["intercept_efficiency"])
    assert any("not used" in note for note in sunny(layout=layout).notes())
    assert not any("not used" in note for note in sunny(layout=layout, aim={"strategy": "layout"}).notes())


def test_levels_take_turns_around_the_tower(sunny, monkeypatch):
    """Heights of the aims, caught on their way to the kernel: symmetric levels within the receiver, spots inside."""
    points, aims = list[np.ndarray](), Way.aims

    def caught(*args: Any) -> np.ndarray:
        points.append(aims(*args))
        return points[-1]

    monkeypatch.setattr(Way, "aims", caught)
    study = sunny(aim={"strategy": "spread", "levels": 3}, optics={**OPTICS, "slope_error": 1})
    family = families()["field_efficiency"]
    inputs = family.inputs(study)
    family.compute(study, inputs, {})
    found = points[-1]
    layout = inputs.layouts.at({})
    order = np.argsort(turns(np.column_stack((layout.x, layout.y))))
    azimuth = np.arctan2(layout.x, layout.y)[order] % (2 * np.pi)
    assert np.all(np.diff(azimuth) > -1e-8)
    signs = np.sign(np.round(found[order, 2] - 60.0, 9))
    np.testing.assert_array_equal(signs, np.resize([-1, 0, 1], len(signs)))
    assert np.abs(found[:, 2] - 60.0).max() < 3.5
    np.testing.assert_allclose(np.hypot(found[:, 0], found[:, 1]), 3.0, rtol=1e-12)
    slant = np.sqrt((found[:, 0] - layout.x) ** 2 + (found[:, 1] - layout.y) ** 2 + (55.0 - layout.z) ** 2)
    level = np.hypot(found[:, 0] - layout.x, found[:, 1] - layout.y) / slant
    sigma = 1e-3 * np.sqrt(4.65**2 / 4 + 4 * 1.0)
    outer = signs[np.argsort(order)] != 0
    np.testing.assert_allclose(np.abs(found[:, 2] - 60.0)[outer], (3.5 - 2 * sigma * slant / level)[outer], rtol=1e-6)


def test_on_a_tilted_face_levels_lie_in_it(sunny):
    face = {"kind": "rectangle", "height": 60, "azimuth": 0, "tilt": -30, "width": 6, "height_extent": 6}
    result = computed(sunny(receiver=face, aim={"strategy": "spread", "levels": [1, 2, 5]}))
    kept = result["field_intercept_efficiency"]
    assert float(kept.sel(aim_levels=2)) < float(kept.sel(aim_levels=5)) < float(kept.sel(aim_levels=1))


LAYOUT = {"radial_stagger": {"clearance": 13, "inner_radius": 60, "heliostats": 40}}
#: The flux of all heliostats at the centre is 53 kW/m2.
AIM = {"strategy": "flux_limit", "limit": 22, "rows": 5, "columns": 3, "flux_rows": 8, "flux_columns": 16}
MAP = {"flux_map": {"rows": 8, "columns": 16}}


@pytest.fixture
def limited_sunny(lit):  # noqa: F811
    return lambda **blocks: lit(
        **{"time": NOON, "site": None, "tracking": "azimuth_elevation", "layout": LAYOUT, "aim": AIM, **blocks}
    )


def test_the_study_has_the_aims_of_the_array_function(limited_sunny):
    result = computed(limited_sunny(optics={**OPTICS, "attenuation": "none"}, output=MAP))
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


def test_more_power_than_levels_at_the_same_peak(limited_sunny):
    levels = computed(limited_sunny(aim={"strategy": "spread", "levels": 3}, output=MAP))
    limited = computed(limited_sunny(aim={**AIM, "limit": float(levels["peak_flux"])}, output=MAP))
    assert float(limited["peak_flux"]) <= 1.02 * float(levels["peak_flux"])
    assert float(limited["field_total_efficiency"]) > 1.01 * float(levels["field_total_efficiency"])


def test_safety_and_limits_of_rows(limited_sunny):
    result = computed(limited_sunny(aim={**AIM, "safety": 0.9, "limits": [[7, 5], [6, 10]]}))
    rows = result["aimed_flux_map"].max("flux_column").to_numpy()
    assert (rows <= 0.9 * 1.006 * np.array([22] * 6 + [10, 5])).all()
    assert rows.max() > 0.9 * 20


def test_each_instant_has_its_aims(limited_sunny):
    """The power of the field at an instant is the power of the aims that are chosen for it, and of one study of it."""
    when = {"clock": "solar", "days": [80], "hours": [9, 12]}
    given = {"site": {"latitude": 40}, "aim": {**AIM, "at": "instants"}, "output": {"field_series": True}}
    result = computed(limited_sunny(time=when, **given))
    total = result["field_instantaneous_total_efficiency"] * 40 * 72 * 1e-3
    np.testing.assert_allclose(result["aimed_power"], total, rtol=5e-3)
    assert (result["aim"].isel(time=0) != result["aim"].isel(time=1)).any()
    noon = computed(limited_sunny(time={**when, "hours": [12]}, site={"latitude": 40}))
    np.testing.assert_array_equal(result["aim"].isel(time=1), noon["aim"])
    whole = total.mean() / (40 * 72 * 1e-3)
    assert float(result["field_total_efficiency"]) == pytest.approx(float(whole), rel=1e-9)


def test_heliostats_behind_the_face_of_a_receiver_are_stowed(limited_sunny):
    face = {"kind": "rectangle", "height": 60, "width": 8, "height_extent": 8}
    study = limited_sunny(receiver=face, aim={**AIM, "limit": 100, "rows": 1, "columns": 1})
    result = computed(study)
    behind = result["y"] < 0
    assert (result["aim"].where(behind, drop=True) == -1).all()
    assert (result["aim"].where(~behind, drop=True) == 0).sum() > 10
    words = f"heliostats behind the receiver's face are stowed: {int(behind.sum())} of 40"
    assert any(words in note for note in study.notes())


def test_the_plan_has_the_memory_of_the_images(limited_sunny):
    """40 heliostats with 15 aims light at most 8 x 10 of the 8 x 16 cells around a cylinder, 16 bytes each."""
    family, work = families()["field_efficiency"], [limited_sunny(aim=aim) for aim in (None, AIM)]
    least, most = (family.workload(study).working_bytes(1, 1) for study in work)
    assert most - least >= 40 * 15 * 8 * 10 * 16

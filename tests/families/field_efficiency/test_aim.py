"""Aim points of heliostats: levels over the receiver, points of the layout, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from heliosweep.families.family import families
from heliosweep.families.field_efficiency import compute as module
from heliosweep.families.field_efficiency.flux import aims, turns
from heliosweep.kernels.field.efficiency import field_sums, sorted_field
from tests.families.field_efficiency.test_optics import OPTICS, RECEIVER, lit  # noqa: F401
from tests.families.studies import computed

NOON = {"clock": "sun", "azimuth": 170, "elevation": 50}
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


def test_the_centre_is_the_default(sunny):
    plain, middle, one = (
        computed(sunny(aim=aim)) for aim in (None, {"strategy": "centre"}, {"strategy": "spread", "levels": 1})
    )
    for name in plain.data_vars:
        np.testing.assert_array_equal(plain[name], middle[name])
        np.testing.assert_array_equal(plain[name], one[name])


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
    points: list[np.ndarray] = []

    def caught(*args: Any) -> np.ndarray:
        points.append(aims(*args))
        return points[-1]

    monkeypatch.setattr(module, "aims", caught)
    study = sunny(aim={"strategy": "spread", "levels": 3}, optics={**OPTICS, "slope_error": 1})
    family = families()["field_efficiency"]
    inputs = family.inputs(study)
    family.compute(study, inputs, {})
    found = points[0]
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

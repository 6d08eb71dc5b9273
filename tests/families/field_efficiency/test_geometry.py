"""Land, mirrors and radius of a field, against scipy, Cauchy's formula and plain sums."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from shapely.geometry import MultiPoint

from heliosweep import api
from heliosweep.families.field_efficiency.values import land_area

GEOMETRY = {"field_geometry": True}


@pytest.mark.parametrize("kind", ["scattered", "grid", "line", "two", "one", "twice the same"])
def test_land_is_the_widened_hull(kind):
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0)), axis=-1).reshape(-1, 2) * 12
    line = np.outer([0, 3, 1, 2], [20.0, 15.0])
    points = {"scattered": rng.normal(0, 80, (40, 2)), "grid": grid, "line": line, "two": line[:2], "one": line[1:2]}
    places = points.get(kind, np.repeat(line[1:2], 2, axis=0))
    area = ConvexHull(places).volume if kind in ("scattered", "grid") else 0.0
    angle = np.linspace(0, 2 * np.pi, 20_000, endpoint=False)
    around = 2 * np.pi * np.max(places @ (np.cos(angle), np.sin(angle)), axis=0).mean()  # Cauchy: from mean width
    x, y = places.T
    assert land_area(x, y, 0.0) == pytest.approx(area, abs=1e-9)
    assert land_area(x, y, 7.5) == pytest.approx(area + 7.5 * around + np.pi * 7.5**2, rel=1e-7)


def test_sizes_of_a_field_are_those_of_its_layout(small):
    rings = {"radial_stagger": {"clearance": 13, "inner_radius": 50, "rings": [1, 2]}}
    mirrors = {"width": 9, "height": 8, "pivot_height": [5, 6]}
    study = small(layout=rings, heliostat=mirrors, output=GEOMETRY)
    assert study.study_id == small(layout=rings, heliostat=mirrors).study_id
    result = api.build(study).compute()
    for number, pivot in ((1, 5), (2, 6)):
        here = result.sel(rings=number, pivot_height=pivot).isel(latitude=0, tracking=0)
        placed = here["x"].notnull().to_numpy()
        x, y = (here[name].to_numpy()[placed] for name in "xy")
        land = MultiPoint(np.stack([x, y], axis=-1)).convex_hull.buffer(np.hypot(9, 8) / 2, quad_segs=2000).area
        assert float(here["field_heliostats"]) == placed.sum()
        assert float(here["field_mirror_area"]) == 72 * placed.sum()
        assert float(here["field_land_area"]) == pytest.approx(land, rel=1e-6)
        assert float(here["field_packing_factor"]) == pytest.approx(72 * placed.sum() / land, rel=1e-6)
        assert float(here["field_mean_radius"]) == pytest.approx(np.mean(np.hypot(x, y)), rel=1e-12)
        np.testing.assert_allclose(here["tower_distance"].to_numpy()[placed], np.hypot(x, y), rtol=1e-14)
        slope = np.tan(np.radians(here["target_elevation"].to_numpy()[placed]))
        np.testing.assert_allclose(slope, (60 - pivot) / np.hypot(x, y), rtol=1e-12)
        assert here["tower_distance"].isnull().to_numpy()[~placed].all()


def test_mirrors_of_several_sizes_weigh_and_take_land_by_their_own(small, tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z,width,height\n0,60,0,4,3\n0,90,2,12,9\n")
    study = small(layout={"file": str(tmp_path / "a.csv")}, heliostat={"pivot_height": 6}, output=GEOMETRY)
    result = api.build(study).compute().isel(latitude=0, tracking=0)
    assert float(result["field_mirror_area"]) == 12 + 108
    assert float(result["field_mean_radius"]) == pytest.approx((12 * 60 + 108 * 90) / 120)
    assert float(result["field_land_area"]) == pytest.approx(2 * 30 * 7.5 + np.pi * 7.5**2)

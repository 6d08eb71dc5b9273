"""A surface for each heliostat: maps against a ray trace of the tests, equal and zero maps, and files of others."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

import heliosweep
from heliosweep import api
from heliosweep.errors import StudyError
from heliosweep.families.field_efficiency.light_files import read_slopes
from tests.families.field_efficiency.test_light_files import FACE, PLACES, SLOPES, field, grid, intercept
from tests.families.field_efficiency.test_optics import RECEIVER

__all__ = ["RECEIVER", "field"]
SIDES = (9.0, 8.0)
X, Y = (side * ((np.arange(36) + 0.5) / 36 - 0.5) for side in SIDES)
#: A twisted mirror, a bent one, and one with a step between its halves. [mrad]
SHAPES = np.array([
    [0.3 * Y[:, np.newaxis] + 0 * X, 0.3 * X + 0 * Y[:, np.newaxis]],
    [-1.5 * X + 0 * Y[:, np.newaxis], 0.5 * Y[:, np.newaxis] + 0 * X],
    [0 * Y[:, np.newaxis] + 2.0 * np.sign(X), 1.5 * np.sin(Y)[:, np.newaxis] + 0 * X],
]).transpose(0, 2, 3, 1)  # fmt: skip


def maps(path: Any, slopes: Any, **labels: Any) -> str:
    """NetCDF file of maps, shape (heliostat, y, x, 2). [mrad]"""
    leans = {f"slope_{axis}": (("heliostat", "z", "y"), slopes[..., k]) for k, axis in enumerate("xy")}
    xr.Dataset(leans, {"y": X, "z": Y, **{key: ("heliostat", list(names)) for key, names in labels.items()}}).to_netcdf(
        path
    )
    return str(path)


def traced(place: Any, slope: Any, sun: Any, side: float, count: int = 400_000) -> tuple[float, float]:
    """Part of the light of a flat mirror with slopes [mrad] that meets a square receiver, and its standard error.

    Independent of the tracer: random numbers of NumPy, bilinear slopes of SciPy.
    """
    rng, target = np.random.default_rng(int(place[1])), np.array([0.0, 0.0, FACE["height"]])
    centre = np.array([*place[:2], 5.0])
    out = (target - centre) / np.linalg.norm(target - centre)
    normal = (sun + out) / np.linalg.norm(sun + out)
    right = np.cross((0.0, 0.0, 1.0), normal)
    right /= np.linalg.norm(right)
    up = np.cross(normal, right)
    u, v = ((rng.random(count) - 0.5) * length for length in SIDES)
    lean = RegularGridInterpolator((Y, X), slope, bounds_error=False, fill_value=None)(np.stack((v, u), axis=1))
    normals = normal + 1e-3 * (lean[:, :1] * right + lean[:, 1:] * up)
    normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
    radius, turn = 4.65e-3 * np.sqrt(rng.random(count)), 2.0 * np.pi * rng.random(count)
    across = np.cross(sun, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    plane = np.cos(turn)[:, np.newaxis] * across + np.sin(turn)[:, np.newaxis] * np.cross(across, sun)
    rays = sun + np.tan(radius)[:, np.newaxis] * plane
    rays /= np.linalg.norm(rays, axis=1)[:, np.newaxis]
    away = 2.0 * np.sum(rays * normals, axis=1)[:, np.newaxis] * normals - rays
    tilt = np.radians(float(FACE["tilt"]))  # type: ignore[arg-type]
    face, upwards = np.array([0.0, np.cos(tilt), np.sin(tilt)]), np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    start = centre + u[:, np.newaxis] * right + v[:, np.newaxis] * up - target
    hit = start - (start @ face / (away @ face))[:, np.newaxis] * away
    inside = (np.abs(hit[:, 0]) < side / 2) & (np.abs(hit @ upwards) < side / 2)
    weight = np.sum(rays * normals, axis=1)
    part = float(np.sum(weight * inside) / np.sum(weight))
    return part, float(np.sqrt(part * (1.0 - part) / count))


def test_three_surfaces_against_an_independent_ray_trace(field, tmp_path):
    name = maps(tmp_path / "maps.nc", SHAPES, name=["b1", "b2", "b3"])
    blocks = {
        "heliostat": {"width": 9, "height": 8, "pivot_height": 5, "focus": "flat"},
        "receiver": {**FACE, "width": 7, "height_extent": 7},
        "time": {"clock": "sun", "azimuth": 150, "elevation": 50},
    }
    study = field(blocks, slope_map=name, slope_error=None, rays=2**18)
    result = api.build(study).compute()
    assert result.attrs["slope_maps"].startswith("3 heliostats have a map of ")
    azimuth, elevation = np.radians((150.0, 50.0))
    sun = np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    found, errors = (result[f"intercept_efficiency{end}"].to_numpy().ravel() for end in ("", "_error"))
    wanted = [traced(place, slope, sun, 7.0) for place, slope in zip(PLACES, SHAPES, strict=True)]
    for value, error, (part, noise) in zip(found, errors, wanted, strict=True):
        assert value == pytest.approx(part, abs=3.0 * float(np.hypot(error, noise)) + 2e-4)
    assert np.ptp([part for part, _ in wanted]) > 0.05
    lit = api.build(field({**blocks, "output": {"flux_map": {"columns": 7, "rows": 7}}}, slope_map=name,
                          slope_error=None, rays=2**14)).compute()  # fmt: skip
    power = float(lit["flux_map"].sum())  # cells of 1 m2
    assert power == pytest.approx(72.0 * float(lit["total_efficiency"].sum()), rel=1e-9)
    cosine = result["cosine_efficiency"].to_numpy().ravel()
    assert power == pytest.approx(72.0 * sum(part * cosine[k] for k, (part, _) in enumerate(wanted)), rel=2e-3)
    swapped = maps(tmp_path / "swapped.nc", SHAPES[[2, 0, 1]], name=["b3", "b1", "b2"])  # by name, in any order
    np.testing.assert_array_equal(intercept(field(blocks, slope_map=swapped, slope_error=None, rays=2**18)), found)


def test_equal_maps_give_the_bits_of_one_and_zero_maps_a_perfect_mirror(field, tmp_path):
    one = api.build(field(slope_map=grid(tmp_path / "one.csv", *SIDES), slope_error=None, rays=2**12)).compute()
    x, y = (side * ((np.arange(n) + 0.5) / n - 0.5) for side, n in zip(SIDES, (18, 16), strict=True))
    leans = {f"slope_{axis}": (("heliostat", "z", "y"), np.stack([SLOPES[..., k]] * 3)) for k, axis in enumerate("xy")}
    xr.Dataset(leans, {"y": x, "z": y, "heliostat": [0, 1, 2]}).to_netcdf(tmp_path / "same.nc")
    same = api.build(field(slope_map=str(tmp_path / "same.nc"), slope_error=None, rays=2**12)).compute()
    for name in ("intercept_efficiency", "optical_efficiency", "field_total_efficiency"):
        np.testing.assert_array_equal(one[name], same[name])
    zero = intercept(field(slope_map=maps(tmp_path / "zero.nc", 0 * SHAPES, name=["b1", "b2", "b3"]),
                           slope_error=None, rays=2**12))  # fmt: skip
    np.testing.assert_array_equal(zero, intercept(field(slope_error=0, rays=2**12)))


def test_heliostats_without_a_map_have_the_slope_error(field, tmp_path):
    name = maps(tmp_path / "some.nc", 3 * SHAPES[1:2], name=["b2"])
    study = field(slope_map=name, slope_error=2)
    (note,) = study.notes()
    assert note.startswith("1 heliostats have a map of")
    assert note.endswith("2 the slope error of the study")
    found, plain = intercept(study), intercept(field(slope_error=2))
    np.testing.assert_allclose(found[:, [0, 2]], plain[:, [0, 2]], atol=2e-3)
    assert np.all(np.abs(found[:, 1] - plain[:, 1]) > 0.01)
    column = field(columns=",slope_error", rows=[(2,), (9,), (2,)], slope_map=name, slope_error=None)
    np.testing.assert_allclose(intercept(column), found, atol=2e-3)
    with pytest.raises(StudyError, match="has no map for 2 heliostats: give 'slope_error' for these"):
        api.plan(field(slope_map=name, slope_error=None))
    other = maps(tmp_path / "other.nc", SHAPES[:1], name=["Z9"])
    with pytest.raises(StudyError, match=r"has no map for a heliostat of .* by name, id or number: it has maps of Z9"):
        api.plan(field(slope_map=other, slope_error=1))


def paraboloid(path: Any, kind: str, focal: float = 100.0) -> None:
    """HDF5 file of a mirror of 9 m x 8 m in two facets with a gap, as PAINT and SOFAST have it."""
    with h5py.File(path, "w") as file:
        for number, (first, last) in enumerate(((-4.5, -0.01), (0.01, 4.5))):
            grid = np.meshgrid(np.linspace(first, last, 136), np.linspace(-4.0, 4.0, 241))
            points = np.stack([each.ravel() for each in grid], axis=1)
            points = np.column_stack((points, np.sum(points**2, axis=1) / (4.0 * focal)))
            slope = points[:, :2] / (2.0 * focal)
            if kind == "paint":
                group = file.create_group(f"facet{number + 1}")
                normals = np.column_stack((-slope, np.ones(len(slope))))
                group["surface_points"] = points
                group["surface_normals"] = normals / np.linalg.norm(normals, axis=1)[:, np.newaxis]
            else:
                group = file.create_group(f"DataSofastCalculation/facet/facet_{number:03d}/CalculationEnsemble")
                group["slopes_ensemble_xy"], group["v_surf_points_ensemble"] = slope.T, points.T


def test_a_single_facet_of_sofast(tmp_path):
    """Slopes of SOFAST are those of the surface: the normal leans the other way."""
    x, y = (each.ravel() for each in np.meshgrid([-0.5, 0.5], [-0.5, 0.5]))
    for place in ("SlopeSolverData", ""):  # an earlier version has no group
        with h5py.File(tmp_path / "facet.h5", "w") as file:
            group = file.create_group(f"DataSofastCalculation/facet/facet_000/{place}")
            group["slopes_facet_xy"], group["v_surf_points_facet"] = [0.002 * x, 0 * y], [x, y, 0 * x]
        found = heliosweep.read_slope_map(tmp_path / "facet.h5", step=1.0)
        np.testing.assert_allclose(found.slope_x, [[1.0, -1.0], [1.0, -1.0]], atol=1e-12)


@pytest.mark.parametrize("kind", ["paint", "sofast"])
def test_hdf5_files_have_the_whole_shape(field, tmp_path, kind):
    """Focus and canting of the study are for other heliostats: a measured paraboloid focuses by itself."""
    path = tmp_path / "b2-filled-2023-09-18Z08-49-09Z-deflectometry.h5"
    paraboloid(path, kind)
    found = read_slopes(path, path.name)
    assert found.plane
    assert found.fits(*SIDES)
    assert found.covered > 0.99
    assert found.names == (("b2",) if kind == "paint" else ())
    np.testing.assert_allclose(found.slope[0, :, :, 0], np.broadcast_to(-found.x / 200.0, found.known[0].shape),
                               atol=2e-4)  # fmt: skip
    blocks = {"heliostat": {"width": 9, "height": 8, "pivot_height": 5, "focus": 30}}
    bowl = field({"heliostat": {**blocks["heliostat"], "focus": 100}}, slope_error=0, rays=2**14)
    given = {"slope_map": str(path), "slope_error": 0 if kind == "paint" else None, "rays": 2**14}
    mapped = intercept(field(blocks, **given))
    np.testing.assert_allclose(mapped[:, 1], intercept(bowl)[:, 1], atol=3e-3)
    assert np.any(np.abs(mapped[:, 0] - intercept(bowl)[:, 0]) > 0.05) == (kind == "paint")


def test_maps_of_several_files_are_one_file(field, tmp_path):
    names = [tmp_path / f"{name}-deflectometry.h5" for name in ("b1", "b3")]
    for name, focal in zip(names, (60.0, 100.0), strict=True):
        paraboloid(name, "paint", focal)
    both = xr.concat([heliosweep.read_slope_map(name, step=0.25) for name in names], "heliostat")
    both.to_netcdf(tmp_path / "both.nc")
    found = read_slopes(tmp_path / "both.nc", "both.nc")
    assert found.names == ("b1", "b3")
    assert found.plane
    (note,) = field(slope_map=str(tmp_path / "both.nc"), slope_error=1).notes()
    assert note.startswith("2 heliostats")
    (tmp_path / "bad.h5").write_text("no HDF5")
    with pytest.raises(StudyError, match=r"bad\.h5: is not a readable deflectometry file of PAINT or SOFAST"):
        api.plan(field(slope_map=str(tmp_path / "bad.h5"), slope_error=1))
    with h5py.File(tmp_path / "local.h5", "w") as file:  # each facet counts from its own centre
        for number in (1, 2):
            group = file.create_group(f"facet{number}")
            group["surface_points"] = [(x, y, 0.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
            group["surface_normals"] = [(0.0, 0.0, 1.0)] * 4
    with pytest.raises(StudyError, match="its facets overlap"):
        heliosweep.read_slope_map(tmp_path / "local.h5")
    with h5py.File(tmp_path / "empty.h5", "w") as file:
        file.create_group("facet1")
    with pytest.raises(StudyError, match=r"empty\.h5: is not a readable deflectometry file of PAINT or SOFAST"):
        heliosweep.read_slope_map(tmp_path / "empty.h5")

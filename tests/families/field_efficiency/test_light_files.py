"""Files on the way of the light: what they change, and what is wrong with them."""

import itertools
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

import heliosweep
from heliosweep import api
from heliosweep.config.tables import read_profile
from heliosweep.errors import StudyError
from heliosweep.families.field_efficiency.light_files import read_slopes
from heliosweep.kernels import sunshapes
from tests.families.field_efficiency.test_optics import OPTICS, RECEIVER
from tests.families.studies import computed

FACE = {"kind": "rectangle", "height": 60, "azimuth": 0, "tilt": -20, "width": 3, "height_extent": 3}
NOON = {"clock": "sun", "azimuth": [150, 220], "elevation": 50}
PLACES = ((20.0, 80.0, "b1"), (-60.0, 110.0, "b2"), (45.0, 150.0, "b3"))
SLOPES = np.random.default_rng(3).normal(0.0, 2.0, (16, 18, 2))


def table(path: Any, header: str, rows: Any) -> str:
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n", encoding="utf-8")
    return str(path)


@pytest.fixture
def field(small, tmp_path):
    """A study of three heliostats; keyword arguments are keys of `optics`, those of `blocks` whole blocks."""

    def make(blocks: Any = None, columns: str = "", rows: Any = ((),) * 3, **optics: Any) -> Any:
        lines = [(*place, *row) for place, row in zip(PLACES, rows, strict=True)]
        layout = table(tmp_path / f"field_{columns or 0}.csv", f"x,y,name{columns}", lines)
        given = {"sun_shape": {"kind": "pillbox"}, "slope_error": 1, **optics}
        study = {
            "site": None, "time": NOON, "layout": {"file": layout}, "receiver": FACE, "tracking": "azimuth_elevation",
            "heliostat": {"width": 9, "height": 8, "pivot_height": 5, "focus": "slant"},
            "optics": {key: value for key, value in given.items() if value is not None},
        }  # fmt: skip
        return small(**study | (blocks or {}))

    return make


def intercept(study: Any) -> np.ndarray:
    return api.build(study).compute()["intercept_efficiency"].to_numpy()


def grid(path: Any, width: float, height: float, leans: np.ndarray = SLOPES) -> str:
    """A CSV table of slopes in the middles of the cells of a mirror. [mrad]"""
    rows, columns = leans.shape[:2]
    x, y = ((np.arange(n) + 0.5) / n * side - side / 2 for n, side in ((columns, width), (rows, height)))
    cells = [(x[k], y[j], *leans[j, k]) for j in range(rows) for k in range(columns)]
    return table(path, "x,y,slope_x,slope_y", np.array(cells)[np.random.default_rng(1).permutation(len(cells))])


def stored(path: Any, content: Any) -> str:
    """File of the result of a study."""
    api.build(api.load(content)).compute().to_netcdf(path)
    return str(path)


def calibrated(folder: Any, **blocks: Any) -> str:
    """Result of a synthetic calibration of the same heliostats, whose estimates are exact."""
    content = {
        "family": "misalignment", "mode": "calibration", "site": {"latitude": 40},
        "time": {"clock": "solar", "days": [80, 172], "hours": {"start": 8, "stop": 16, "step": 2}},
        "receiver": {"height": 60, "azimuth": 0, "tilt": 0, "width": 8, "height_extent": 8},
        "heliostats": {"pivot_height": 5}, "mount_errors": {"azimuth_reference": 1.5, "tilt_about_north": -1},
    }  # fmt: skip
    return stored(folder / "calibrated.nc", {**content, **blocks})


def test_a_table_of_the_sun_is_the_sun_of_the_formula(field, tmp_path):
    angle = np.linspace(0.0, 4.65, 60)
    rows = np.stack((angle, 1.0 - 0.56 * (1.0 - np.sqrt(1.0 - (angle / 4.65) ** 2))), axis=1)
    name = table(tmp_path / "sun.csv", "angle,brightness", rows)
    made, known = sunshapes.table(*map(np.array, read_profile(tmp_path / "sun.csv", name))), sunshapes.limb_darkened()
    assert made.spread == pytest.approx(known.spread, rel=2e-3)
    measured, given = (field(sun_shape=one, rays=2**18) for one in (
        {"kind": "table", "file": name}, {"kind": "limb_darkened"},
    ))  # fmt: skip
    np.testing.assert_allclose(intercept(measured), intercept(given), atol=4e-4)
    table(tmp_path / "sun.csv", "angle,brightness", [(0, 1), (2, 1.1), (1, 0)])
    with pytest.raises(StudyError, match=r"sun\.csv:4:.*the angles must increase \(got 1\)"):
        api.plan(field(sun_shape={"kind": "table", "file": name}))


def test_errors_of_mounts_are_drawn_for_each_heliostat_by_its_number(field):
    drawn = {"azimuth_reference": {"normal": [0, 1.5]}, "seed": [1, 2]}
    found = api.build(field(mount_errors=drawn)).compute()
    values = found["intercept_efficiency"]
    assert values.sizes["seed"] == 2
    one, other = (values.isel(seed=seed).to_numpy() for seed in (0, 1))
    assert np.all((one != other) | (one > 0.999))  # nothing misses the receiver, whatever the error
    assert len(np.unique((values - intercept(field())[:, None]).isel(seed=0, sun_azimuth=0))) == 3
    none = field(mount_errors={"azimuth_reference": {"normal": [0, 1.5]}, "scale": 0})
    np.testing.assert_array_equal(intercept(none), intercept(field(mount_errors={"collimation": 0})))
    fixed = api.build(field(mount_errors={"azimuth_reference": 2})).compute()
    assert fixed["azimuth_reference"].item() == 2.0


def test_errors_of_a_calibration_are_those_that_it_found(field, tmp_path):
    place = {"layout": {"file": field().layout.file}}
    name = calibrated(tmp_path, **place)
    found = intercept(field(mount_errors={"calibration": name}))
    given = field(mount_errors={"azimuth_reference": 1.5, "tilt_about_north": -1})
    np.testing.assert_allclose(found, intercept(given), atol=1e-7)
    assert np.all(found < intercept(field()))
    with pytest.raises(StudyError, match="is for azimuth_elevation mounts, but 'tracking' is for target_aligned"):
        api.plan(field({"tracking": "spinning_elevation"}, mount_errors={"calibration": name}))
    other = table(tmp_path / "other.csv", "x,y", [(25, 80), (-60, 110), (45, 150)])
    with pytest.raises(StudyError, match=r"has no heliostat 0 \(line 2\) of .*other\.csv \(1 are missing\)"):
        api.plan(field({"layout": {"file": other}}, mount_errors={"calibration": name}))
    for label in ("name", "id"):  # the same names at other rows
        if label == "id":
            place = {"layout": {"file": table(tmp_path / "ids.csv", "x,y,id", PLACES)}}
            name = calibrated(tmp_path, **place, heliostats={"pivot_height": 5})
        turned = table(tmp_path / "turned.csv", f"x,y,{label}", [PLACES[2], PLACES[0]])
        of_turned = intercept(field({"layout": {"file": turned}}, mount_errors={"calibration": name}))
        assert of_turned[:, 1] == pytest.approx(found[:, 0], abs=1e-3)


@pytest.mark.parametrize("kind", ["drawn", "calibration"])
def test_heliostats_that_are_kept_keep_their_errors(field, tmp_path, kind):
    """Also where nothing but its row tells a heliostat from others."""
    layout = {"file": table(tmp_path / "unnamed.csv", "x,y", [place[:2] for place in PLACES])}
    errors: dict[str, Any] = {"azimuth_reference": {"normal": [0, 1.5]}, "seed": 4}
    if kind == "calibration":
        errors = {"calibration": calibrated(tmp_path, layout=layout)}
    blocks = {"layout": layout, "site": {"latitude": 40}, "time": {"clock": "solar", "days": 80, "hours": [10, 12, 14]}}
    whole = api.build(field(blocks, mount_errors=errors)).compute()
    ranks = {"keep": {"heliostats": 2, "by": "optical_efficiency"}}
    cut = api.build(field({**blocks, **ranks}, mount_errors=errors)).compute()
    rows = np.flatnonzero(cut["kept"])
    assert rows.tolist() != [0, 1]
    kept, same = (one["intercept_efficiency"].isel(heliostat=rows) for one in (cut, whole))
    np.testing.assert_allclose(kept, same, atol=2e-3)
    assert np.ptp(whole["intercept_efficiency"].to_numpy()) > 5e-3


def test_a_map_is_in_place_of_a_slope_error(field, tmp_path):
    name = grid(tmp_path / "slopes.csv", 9.0, 8.0)
    found = intercept(field(slope_map=name, slope_error=None))
    none = intercept(field(slope_error=0))
    np.testing.assert_allclose(found, intercept(field(slope_error=SLOPES.std() * 2 / 3)), atol=0.02)  # straight lines
    assert np.all(found < none)
    facets = {
        "heliostat": {"width": 9, "height": 8, "pivot_height": 5, "facets": {"columns": 2, "rows": 2, "gap": 0.1}}
    }
    with pytest.raises(StudyError, match="has one map for all heliostats, but there is also a slope error"):
        api.plan(field(slope_map=name))
    half = grid(tmp_path / "facet.csv", 4.45, 3.95)
    assert np.all(intercept(field(facets, slope_map=half, slope_error=None)) > 0)
    with pytest.raises(
        StudyError, match=r"from -4\.25 to 4\.25 m and -3\.75 to 3\.75 m, do not fit a mirror of 9 m x 6 m"
    ):
        api.plan(field({"heliostat": {"width": 9, "height": 6, "pivot_height": 5}}, slope_map=name, slope_error=None))


def test_a_map_of_backward_gazing(field, tmp_path):
    """Of one module of 4 m x 4 m that is canted: the same as a turned mirror."""
    gazing = {
        "family": "backward_gazing", "output": {"maps": True}, "method": "LM", "referential": "exact",
        "heliostat": {"modules": [{"centre": [0, 0], "size": [4, 4]}], "pixel": 0.25, "distance": 120,
                      "focal_length": 120},
        "target": {"azimuth": 0, "elevation": 44, "tilt": 30, "face": 0}, "sun": {"azimuth": 30, "elevation": 60},
        "cameras": {"arrangement": "square", "radius": 0.24}, "defects": {"canting": {1: [0.6, -0.4]}},
    }  # fmt: skip
    name = stored(tmp_path / "gazed.nc", gazing)
    small_mirrors = {
        "heliostat": {"width": 4, "height": 4, "pivot_height": 5, "focus": "slant"},
        "receiver": {**FACE, "width": 1.2, "height_extent": 1.0},
    }
    found = intercept(field(small_mirrors, slope_map=name, slope_error=None))
    turned = field(small_mirrors, columns=",error_u,error_v", rows=[(0.6, -0.4)] * 3, slope_error=0)
    assert np.all(np.abs(intercept(field(small_mirrors, slope_error=0)) - found) > 5e-3)
    np.testing.assert_allclose(found, intercept(turned), atol=2e-3)


def test_dirt_between_washings(small):
    base = {"site": {"latitude": 40}, "receiver": RECEIVER, "tracking": "azimuth_elevation"}
    dirty = {**OPTICS, "soiling": {"rate": [0, 0.004], "washing_interval": 20}}
    result = computed(small(**base, optics=dirty))
    np.testing.assert_allclose(result["reflection_efficiency"].isel(heliostat=0), [0.855, 0.855 * 0.96], rtol=1e-14)


X, Y = np.arange(-1.575, 1.6, 0.05), np.arange(-1.175, 1.2, 0.05)


@pytest.mark.parametrize("form", ["nan", "left out"])
def test_holes_of_a_map(tmp_path, form):
    # As SOFAST (OpenCSP) writes masked maps: no slope outside of the facet, here in the corners.
    rows = []
    for y, x in itertools.product(Y.round(6), X.round(6)):
        hole = abs(x) > 1.25 and abs(y) > 0.9
        if not (hole and form == "left out"):
            rows.append(f"{x},{y}," + ("nan,nan" if hole else f"{x},{2 * y}"))
    (tmp_path / "map.csv").write_text("\n".join(["x,y,slope_x,slope_y", *rows]))
    found = read_slopes(tmp_path / "map.csv", "map.csv")
    inside = ~np.logical_and.outer(abs(Y) > 0.9, abs(X) > 1.25)
    np.testing.assert_array_equal(found.known[0], inside)
    assert found.covered == pytest.approx(inside.mean())
    np.testing.assert_allclose(found.x, X, atol=1e-9)
    wanted = 1e-3 * np.stack(np.broadcast_arrays(X, 2 * Y[:, np.newaxis]), axis=-1)
    np.testing.assert_allclose(found.slope[0][inside], wanted[inside], atol=1e-12)
    assert found.fits(3.2, 2.4)


def test_slopes_in_radians_are_noticed(field, tmp_path):
    name = grid(tmp_path / "map.csv", 9.0, 8.0)
    assert list(field(slope_map=name, slope_error=None).notes()) == []
    head, *rows = [line.split(",") for line in Path(name).read_text().splitlines()]
    scaled = [[x, y, *(repr(float(slope) / 1e3) for slope in slopes)] for x, y, *slopes in rows]
    Path(name).write_text("\n".join(",".join(row) for row in (head, *scaled)))
    (note,) = field(slope_map=name, slope_error=None).notes()
    assert "the RMS slope is 0.00" in note
    assert note.endswith("less than for any real mirror. If the file is in rad, convert it to mrad")


@pytest.mark.parametrize("tracking", ["azimuth_elevation", "spinning_elevation"])
def test_a_map_that_is_even_is_a_turn_and_a_sloping_one_bends_the_mirror(field, tmp_path, tracking):
    """Also of facets, each with the same map."""
    x, y = (side * ((np.arange(12) + 0.5) / 12 - 0.5) for side in (9.0, 8.0))
    sign = 1.0 if tracking == "azimuth_elevation" else -1.0
    blocks = {"tracking": tracking, "heliostat": {"width": 9, "height": 8, "pivot_height": 5}}
    even = grid(tmp_path / "even.csv", 9.0, 8.0, np.full((12, 12, 2), 1.0) * [1.0, -2.0])
    turned = field(blocks, columns=",error_u,error_v", rows=[(sign, -2 * sign)] * 3, slope_error=0, rays=2**14)
    mapped = field(blocks, slope_map=even, slope_error=None, rays=2**14)
    np.testing.assert_allclose(intercept(mapped), intercept(turned), atol=2e-3)
    bent = np.stack(np.meshgrid(x, y), axis=-1) * -0.5e3 / 120
    name = grid(tmp_path / "bent.csv", 9.0, 8.0, bent)
    bowl = field({**blocks, "heliostat": {**blocks["heliostat"], "focus": 120}}, slope_error=0, rays=2**14)
    mapped = field(blocks, slope_map=name, slope_error=None, rays=2**14)
    flat = field(blocks, slope_error=0, rays=2**14)
    assert np.all(abs(intercept(flat) - intercept(bowl)) > 0.05)
    np.testing.assert_allclose(intercept(mapped), intercept(bowl), atol=4e-3)


SIDES = (9.0, 8.0)
U, V = (side * ((np.arange(36) + 0.5) / 36 - 0.5) for side in SIDES)
#: A twisted mirror, a bent one, and one with a step between its halves. [mrad]
SHAPES = np.array([
    [0.3 * V[:, np.newaxis] + 0 * U, 0.3 * U + 0 * V[:, np.newaxis]],
    [-1.5 * U + 0 * V[:, np.newaxis], 0.5 * V[:, np.newaxis] + 0 * U],
    [0 * V[:, np.newaxis] + 2.0 * np.sign(U), 1.5 * np.sin(V)[:, np.newaxis] + 0 * U],
]).transpose(0, 2, 3, 1)  # fmt: skip


def maps(path: Any, slopes: Any, **labels: Any) -> str:
    """NetCDF file of maps, shape (heliostat, y, x, 2). [mrad]"""
    leans = {f"slope_{axis}": (("heliostat", "z", "y"), slopes[..., k]) for k, axis in enumerate("xy")}
    xr.Dataset(leans, {"y": U, "z": V, **{key: ("heliostat", list(names)) for key, names in labels.items()}}).to_netcdf(
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
    lean = RegularGridInterpolator((V, U), slope, bounds_error=False, fill_value=None)(np.stack((v, u), axis=1))
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
    assert result.attrs["slope_maps"].startswith("3 heliostats have a map in ")
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


def test_heliostats_without_a_map_have_the_slope_error(field, tmp_path):
    name = maps(tmp_path / "some.nc", 3 * SHAPES[1:2], name=["b2"])
    study = field(slope_map=name, slope_error=2)
    (note,) = study.notes()
    assert note.startswith("1 heliostats have a map in")
    assert note.endswith("2 use the slope error of the study")
    found, plain = intercept(study), intercept(field(slope_error=2))
    np.testing.assert_allclose(found[:, [0, 2]], plain[:, [0, 2]], atol=2e-3)
    assert np.all(np.abs(found[:, 1] - plain[:, 1]) > 0.01)
    column = field(columns=",slope_error", rows=[(2,), (9,), (2,)], slope_map=name, slope_error=None)
    np.testing.assert_allclose(intercept(column), found, atol=2e-3)
    with pytest.raises(StudyError, match="has no map for 2 heliostats: set 'slope_error' for them"):
        api.plan(field(slope_map=name, slope_error=None))
    other = maps(tmp_path / "other.nc", SHAPES[:1], name=["Z9"])
    with pytest.raises(StudyError, match=r"has no map that matches a heliostat of .* by name.*: its maps are for Z9"):
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
    with h5py.File(tmp_path / "empty.h5", "w") as file:
        file.create_group("facet1")
    for name in ("bad", "empty"):
        with pytest.raises(StudyError, match=rf"{name}\.h5: is not a readable PAINT or SOFAST deflectometry file"):
            heliosweep.read_slope_map(tmp_path / f"{name}.h5")
    with h5py.File(tmp_path / "local.h5", "w") as file:  # each facet counts from its own centre
        for number in (1, 2):
            group = file.create_group(f"facet{number}")
            group["surface_points"] = [(x, y, 0.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
            group["surface_normals"] = [(0.0, 0.0, 1.0)] * 4
    with pytest.raises(StudyError, match="its facets overlap"):
        heliosweep.read_slope_map(tmp_path / "local.h5")

"""Files on the way of the light: what they change, and what is wrong with them."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

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
    with pytest.raises(StudyError, match="is of azimuth_elevation mounts, and 'tracking' is of target_aligned"):
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
        StudyError, match=r"from -4\.25 to 4\.25 m and -3\.75 to 3\.75 m, are of no mirror of 9 m x 6 m"
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


def test_dirt_by_month_and_between_washings(small):
    base = {"site": {"latitude": 40}, "receiver": RECEIVER, "tracking": "azimuth_elevation"}
    months = {**OPTICS, "cleanliness_by_month": [0.5, *[1.0] * 10, 0.7]}
    del months["cleanliness"]
    hours = {"clock": "solar", "days": [15, 172, 350], "hours": {"start": 9, "stop": 15, "step": 3},
             "sampling": "inclusive"}  # fmt: skip
    result = api.build(small(**base, optics=months, time=hours)).compute()
    np.testing.assert_allclose(result["reflection_efficiency"], 0.9 * (0.5 + 1.0 + 0.7) / 3, rtol=1e-14)
    series = api.build(small(**base, optics=months, time=hours, output={"time_series": True})).compute()
    every = series["instantaneous_total_efficiency"] / series["instantaneous_optical_efficiency"]
    every = every / series["instantaneous_intercept_efficiency"] / result["attenuation_efficiency"] / 0.9
    np.testing.assert_allclose(every.isel(heliostat=0), np.repeat([0.5, 1.0, 0.7], 3), rtol=1e-12)
    np.testing.assert_allclose(
        result["total_efficiency"], series["instantaneous_total_efficiency"].mean("time"), rtol=1e-13
    )
    civil = {
        "clock": "civil",
        "dates": ["2025-01-31", "2025-12-01"],
        "window": {"start": "08:00", "stop": "16:00", "step": "1 h"},
    }
    place = {**base, "site": {"latitude": 40, "longitude": -120, "timezone": "-08:00"}}
    result = api.build(small(**place, optics=months, time=civil)).compute()
    assert 0.45 < float(result["reflection_efficiency"][0]) / 1.0 < 0.63
    dirty = {**OPTICS, "soiling": {"rate": [0, 0.004], "washing_interval": 20}}
    result = api.build(small(**base, optics=dirty, time=hours)).compute()
    np.testing.assert_allclose(result["reflection_efficiency"].isel(heliostat=0), [0.855, 0.855 * 0.96], rtol=1e-14)


@pytest.mark.parametrize(
    ("wave", "step", "wanted"),
    [
        # Maps of a mirror of 3.2 m x 2.4 m; intercepts by 1e7 rays with the analytic slopes, or the interpolated map.
        (lambda x, y: (2e-3 * np.sin(2 * np.pi * x / 1.6) + 0.8e-3 * x, -1.2e-3 * y + 1.5e-3 * (y / 1.2) ** 3), 0.05,
         0.63886),
        (lambda x, y: (2e-3 * np.sin(2 * np.pi * x / 1.6), 0 * y), 0.02, 0.56450),
    ],
)  # fmt: skip
def test_maps_of_slopes_are_not_averaged(small, tmp_path, wave, step, wanted):
    x, y = (side * (np.arange(round(side / step)) + 0.5) * step / side - side / 2 for side in (3.2, 2.4))
    leans = np.stack(np.broadcast_arrays(*wave(x, y[:, None])), axis=-1)
    rows = [(x[k], y[j], *1e3 * leans[j, k]) for j in range(len(y)) for k in range(len(x))]
    name = table(tmp_path / "map.csv", "x,y,slope_x,slope_y", rows)
    result = computed(small(
        site=None, time={"clock": "sun", "azimuth": 230, "elevation": 35}, tracking="azimuth_elevation",
        layout={"file": table(tmp_path / "one.csv", "x,y", [(-20, 100)])},
        heliostat={"width": 3.2, "height": 2.4, "pivot_height": 4, "focus": 110},
        receiver={"kind": "rectangle", "height": 50, "azimuth": 0, "tilt": -20, "width": 0.9, "height_extent": 0.9},
        optics={"sun_shape": {"kind": "pillbox"}, "slope_map": name, "rays": 2**18},
    ))  # fmt: skip
    assert float(result["intercept_efficiency"][0]) == pytest.approx(wanted, abs=6e-4)


X, Y = np.arange(-1.575, 1.6, 0.05), np.arange(-1.175, 1.2, 0.05)


@pytest.mark.parametrize("form", ["nan", "left out", "empty"])
def test_holes_of_a_map(tmp_path, form):
    # As SOFAST (OpenCSP) writes masked maps: no slope outside of the facet, here in the corners.
    rows = []
    for y, x in itertools.product(Y.round(6), X.round(6)):
        hole = abs(x) > 1.25 and abs(y) > 0.9
        if not (hole and form == "left out"):
            slopes = {"nan": "nan,nan", "empty": ","}[form] if hole else f"{x},{2 * y}"
            rows.append(f"{x},{y},{slopes}")
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

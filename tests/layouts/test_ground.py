"""Where heliostats may stand: sectors, polygons in both forms, and heights of the ground."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, TiffImagePlugin

from heliosweep.config.blocks import Zone
from heliosweep.errors import StudyError
from heliosweep.layouts import radial_stagger
from heliosweep.layouts.ground import Region, heights_at, read_area, read_heights, slope_heights
from heliosweep.layouts.patterns import rows, spiral

SQUARE = [[-200, -50], [200, -50], [200, 300], [-200, 300], [-200, -50]]
HOLE = [[-50, 100], [50, 100], [50, 200], [-50, 200], [-50, 100]]


def wkt(*rings: Sequence[Sequence[float]]) -> str:
    return f"POLYGON ({', '.join('(' + ', '.join(f'{x} {y}' for x, y in ring) + ')' for ring in rings)})"


def saved(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@settings(max_examples=40)
@given(
    sectors=st.lists(st.tuples(st.floats(-360, 360), st.floats(1, 360)), min_size=1, max_size=4),
    rings=st.integers(1, 8),
)
def test_sectors_leave_the_rings_of_the_whole_field(sectors, rings):
    whole, region = radial_stagger(13, 50, rings=rings), Region(tuple(sectors))
    azimuth = whole.columns["azimuth"]
    there = np.zeros(len(whole), bool)
    for middle, width in sectors:
        low = (middle - width / 2) % 360
        there |= ((azimuth - low) % 360 <= width + 1e-7) | ((azimuth - low) % 360 >= 360 - 1e-7)
    if not there.any():
        with pytest.raises(StudyError, match="leaves no space"):
            radial_stagger(13, 50, rings=rings, region=region)
        return
    part = radial_stagger(13, 50, rings=rings, region=region)
    for name, values in (("x", part.x), ("y", part.y), *part.columns.items()):
        of = getattr(whole, name) if name in "xy" else whole.columns[name]
        np.testing.assert_array_equal(values, of[there])


@pytest.mark.parametrize("form", ["wkt", "polygon", "feature", "collection"])
def test_polygons_in_all_forms(tmp_path, form):
    polygon = {"type": "Polygon", "coordinates": [SQUARE, HOLE]}
    feature = {"type": "Feature", "properties": {}, "geometry": polygon}
    texts = {
        "wkt": "# the site\n" + wkt(SQUARE, HOLE),
        "polygon": json.dumps(polygon),
        "feature": json.dumps(feature),
        "collection": json.dumps({"type": "FeatureCollection", "features": [feature]}),
    }
    region = Region((), read_area(saved(tmp_path / "site.txt", texts[form]), "boundary"))
    for layout in (
        radial_stagger(13, 50, region=region),
        spiral(5.0, 0.6, 50.0, region=region),
        rows(13.0, 13.0, 50.0, region=region),
        radial_stagger(13, zones=[Zone(start=50, rings=6)], region=region),
    ):
        inside = (abs(layout.x) < 200) & (layout.y > -50) & (layout.y < 300)
        assert inside.all()
        assert not ((abs(layout.x) < 50) & (layout.y > 100) & (layout.y < 200)).any()
    # Filled: no place of the endless field is left out.
    whole = radial_stagger(13, 50, rings=40)
    there = (abs(whole.x) < 200) & (whole.y > -50) & (whole.y < 300)
    hole = (abs(whole.x) <= 50) & (abs(whole.y - 150) <= 50)
    assert len(radial_stagger(13, 50, region=region)) == int((there & ~hole).sum())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("POLYGON ((0 0, 100 100, 100 0, 0 100, 0 0))", "crosses itself at 50, 50; list the corners"),
        ("POLYGON ((0 0, 1 1", "cannot be read as WKT: "),
        ("", "cannot be read as WKT: "),
        ("POLYGON EMPTY", r"must contain polygons \(got none\)"),
        ("POLYGON ((0 0, 1 1, 2 2, 0 0))", "Too few points|Self-intersection|crosses itself"),
        ("LINESTRING (0 0, 9 9)", r"must contain polygons \(got a LineString\)"),
        ("POLYGON ((500000 4000000, 501000 4000000, 501000 4001000, 500000 4000000))", "beyond any field"),
        ("POLYGON ((nan 0, 1 1, 1 0, nan 0))", "beyond any field|cannot be read as WKT"),
        ("POLYGON ((-6.26 37.44, -6.24 37.44, -6.24 37.45, -6.26 37.44))", "is probably in degrees"),
        ('{"type": "Polygon"}', "cannot be read as GeoJSON: "),
        ('{"type": "FeatureCollection", "features": []}', r"must contain polygons \(got none\)"),
    ],
)
def test_polygons_that_are_wrong(tmp_path, text, message):
    with pytest.raises(StudyError, match=message) as raised:
        read_area(saved(tmp_path / "site.txt", text), "boundary")
    assert raised.value.problems[0].key == "boundary"


@pytest.fixture(scope="module")
def edges():
    """A site and a road, places all over them, and how far these are from all edges."""
    site, road = shapely.Polygon(SQUARE, [HOLE]), shapely.box(-200, -20, 200, -10)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-220.5, 221, 7), np.arange(-70.5, 321, 7)))
    far = [shapely.distance(shapely.points(x, y), edge) for edge in (site.exterior, *site.interiors, road)]
    return site, road, x, y, np.min(far, axis=0)


@settings(max_examples=30)
@given(margin=st.floats(0.1, 60))
def test_a_margin_is_kept_from_all_edges(edges, margin):
    site, road, x, y, far = edges
    without, region = (Region((), site, road, each) for each in (0.0, margin))
    np.testing.assert_array_equal(region.inside(x, y), without.inside(x, y) & (far > margin))


def test_no_room(tmp_path):
    far = saved(tmp_path / "far.wkt", "POLYGON ((900 900, 900.1 900, 900 900.1, 900 900))")
    with pytest.raises(StudyError, match="boundary: leaves no space"):
        radial_stagger(13, 50, region=Region((), read_area(far, "boundary")))
    site, all_of_it = (
        saved(tmp_path / f"{side}.wkt", shapely.box(-side, -side, side, side).wkt) for side in (100, 1000)
    )
    covered = Region((), *(read_area(path, "boundary") for path in (site, all_of_it)))
    with pytest.raises(StudyError, match="exclude: leaves no space: it covers the whole boundary"):
        radial_stagger(13, 50, region=covered)
    small = Region((), read_area(site, "boundary"))
    fit = len(radial_stagger(13, 50, region=small))
    assert len(radial_stagger(13, 50, heliostats=fit, region=small)) == fit
    with pytest.raises(StudyError, match=rf"heliostats: only {fit} fit \(got {fit + 1}\)"):
        radial_stagger(13, 50, heliostats=fit + 1, region=small)


def grid(path: Path, x: np.ndarray, y: np.ndarray, heights: np.ndarray, **attrs: str) -> Path:
    data = xr.Dataset({"elevation": (("y", "x"), heights)}, coords={"x": ("x", x, attrs), "y": ("y", y)})
    data.to_netcdf(path)
    return path


def bilinear(x: np.ndarray, y: np.ndarray, level: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Heights above that at the tower: along x on every row, and then along y."""

    def at(east: float, north: float) -> float:
        return np.interp(north, y, [np.interp(east, x, row) for row in level])

    return np.array([at(*place) for place in places]) - at(0.0, 0.0)


def test_heights_are_bilinear(tmp_path):
    rng = np.random.default_rng(3)
    x, y = np.sort(rng.uniform(-500, 500, 30)), np.linspace(-400, 400, 17)
    level = rng.uniform(100, 140, (17, 30))
    places = rng.uniform(-1, 1, (200, 2)) * [min(-x[0], x[-1]), 400]
    expected = bilinear(x, y, level, places)
    for step in (1, -1):
        path = grid(tmp_path / f"{step}.nc", x[::step], y[::step], level[::step, ::step], units="m")
        np.testing.assert_allclose(heights_at(read_heights(path), path.name, *places.T), expected, atol=1e-9)


def geotiff(path: Path, level: np.ndarray, corner: tuple[float, float], keys: tuple[int, ...] = (1, 1), **more) -> Path:
    """Heights, the northernmost row first, of cells of 25 m; `corner` is that of the first cell in the northwest."""
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    model, raster, *units = keys
    entries = [(1024, model), (1025, raster), *more.get("code", ()), *zip((3076, 4099), units, strict=False)]
    tags[33550], tags[33922] = (25.0, 25.0, 0.0), (0.0, 0.0, 0.0, *corner, 0.0)
    tags[34735] = (1, 1, 0, len(entries), *(number for key, value in entries for number in (key, 0, 1, value)))
    tags[42113] = "-9999 "
    tags.tagtype |= {33550: 12, 33922: 12, 34735: 3, 42113: 2}
    for tag in more.get("without", ()):
        del tags[tag]
    Image.fromarray(level).save(path, tiffinfo=tags, compression=more.get("compression", "tiff_lzw"))
    return path


@pytest.mark.parametrize("dtype", [np.float32, np.int16])
def test_heights_of_a_geotiff_are_those_of_a_grid(tmp_path, dtype):
    tower = (254_000.0, 4_147_000.0)
    x, y = np.arange(-487.5, 488, 25), np.arange(-412.5, 413, 25)  # middles of cells
    level = np.random.default_rng(2).uniform(100, 140, (y.size, x.size)).astype(dtype)
    level[0, 0] = -9999
    places = np.random.default_rng(3).uniform(-380, 380, (200, 2))
    wanted = bilinear(x, y, level.astype(float), places)
    corner = (tower[0] + x[0], tower[1] + y[-1])
    for raster, shift in ((1, 12.5), (2, 0.0)):  # its corner, or its middle
        first = (corner[0] - shift, corner[1] + shift)
        path = geotiff(tmp_path / f"{raster}.tif", level[::-1], first, (1, raster, 9001))
        heights = read_heights(path, tower)
        np.testing.assert_allclose(heights_at(heights, path.name, *places.T), wanted, atol=1e-9)
        assert np.isnan(heights((-410.0, -480.0)))


def test_geotiff_that_is_wrong(tmp_path):
    level, metres = np.zeros((4, 4), np.float32), "must have coordinates and heights in m"
    for name, found, message in (
        ("degrees.tif", {"keys": (2, 1)}, "no map coordinates in m: project it"),
        ("feet.tif", {"code": [(3072, 2229)]}, metres),
        ("depth.tif", {"keys": (1, 1, 9001, 9002)}, metres),
        ("picture.tif", {"without": (33550,)}, "one band of heights with map coordinates"),
    ):
        with pytest.raises(StudyError, match=f"{name} .*{message}"):
            read_heights(geotiff(tmp_path / name, level, (0, 0), **found))
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(tmp_path / "colours.tif")
    whole = geotiff(tmp_path / "whole.tif", np.random.default_rng(0).normal(size=(64, 64)).astype(np.float32), (0, 0))
    (tmp_path / "cut.tif").write_bytes(whole.read_bytes()[:4000])
    for name, message in (("colours", "one band"), ("cut", r"cut\.tif "), ("none", "cannot be read")):
        with pytest.raises(StudyError, match=message):
            read_heights(tmp_path / f"{name}.tif")


def test_even_ground_falls_towards_its_azimuth():
    east = slope_heights(np.array([100.0, 0.0]), np.array([0.0, 100.0]), 5.0, 90.0)
    np.testing.assert_allclose(east, [-8.748866, 0.0], atol=1e-6)
    north = slope_heights(np.array([0.0]), np.array([100.0]), 5.0, 180.0)
    assert north == pytest.approx([8.748866], abs=1e-6)


def test_heights_that_are_wrong(tmp_path):
    x, gap = np.linspace(-100, 100, 5), np.zeros((5, 5))
    gap[4, 4] = np.nan
    for name, at, level, east, north, message in (
        (
            "small",
            x,
            np.zeros((5, 5)),
            [0.0, 101, -200],
            [0.0, 0, 0],
            "no heights at 2 of 3 heliostats.* x from -100 to 100 m",
        ),
        ("away", x + 500, np.zeros((5, 5)), [500.0, 510], [0.0, 0], "no heights at the tower"),
        ("gap", x, gap, [0.0, 99], [0.0, 99], "1 of 2 heliostats"),
    ):
        heights = read_heights(grid(tmp_path / f"{name}.nc", at, x, level))
        with pytest.raises(StudyError, match=message):
            heights_at(heights, f"{name}.nc", np.array(east), np.array(north))
    other = tmp_path / "other.nc"
    xr.Dataset({"z": ("i", x)}).to_netcdf(other)
    for file, message in (
        (grid(tmp_path / "degrees.nc", x, x, gap, units="degrees_east"), r"x in m \(got degrees_east\)"),
        (grid(tmp_path / "single.nc", x[:1], x, gap[:, :1]), "at least two values"),
        (grid(tmp_path / "twice.nc", np.array([0, 1, 1, 2, 3.0]), x, gap), "monotonic x and y"),
        (saved(tmp_path / "text.nc", "x,y\n"), "cannot be read as NetCDF"),
        (other, r"one variable over x and y, .*got z\(i\)"),
    ):
        with pytest.raises(StudyError, match=message):
            read_heights(file)

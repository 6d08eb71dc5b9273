"""Layouts as CSV: what is read, what comes back, and what each bad file is told."""

import math
import string
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from heliosweep import api
from heliosweep.config import text_of
from heliosweep.errors import StudyError
from heliosweep.layouts import Layout, check_layout, read_csv, too_close, write_csv
from heliosweep.layouts.layout import read_text

numbers = st.floats(allow_nan=False, allow_infinity=False)
words = st.text(string.ascii_letters + string.punctuation + " ", max_size=20).map(lambda text: "w" + text.strip())


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a file and gives its path."""

    def write(content: str | bytes) -> Path:
        path = tmp_path / "field.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def problems(path: Path, **options) -> list[str]:
    """Return what a bad file is told."""
    with pytest.raises(StudyError) as caught:
        read_csv(path, name="field.csv", **options)
    assert caught.value.exit_code == 2
    return [str(problem) for problem in caught.value.problems]


def test_columns_and_their_types(written):
    layout = read_csv(written("x,y,ring,azimuth,row,code\n1,2,1,0.5,A1,007\n-3.5,4e1,2,1,B2,010\n"), name="f.csv")
    assert layout.name == "f.csv"
    assert (layout.x.tolist(), layout.y.tolist(), layout.z.tolist()) == ([1, -3.5], [2, 40], [0, 0])
    kinds = [(key, values.dtype.kind) for key, values in layout.columns.items()]
    assert kinds == [("ring", "i"), ("azimuth", "f"), ("row", "U"), ("code", "U")]
    assert layout.columns["code"].tolist() == ["007", "010"]
    assert layout.lines is not None
    assert layout.lines.tolist() == [2, 3]


@pytest.mark.parametrize(
    "content",
    [
        "x;y;z;name\n0;61,3;0,5;A1\n-12,25;100;0;A 2\n",
        "sep=;\r\nx;y;z;name\r\n0;61,3;0,5;A1\r\n-12,25;100;0;A 2\r\n",
        "Easting (m),Northing (m),z,name\n0,61.3,0.5,A1\n-12.25,100,0,A 2\n",
        "x\ty\tz\tname\n0\t61,3\t0,5\tA1\n-12,25\t100\t0\tA 2\n",
        "x\ty\tz\tname\n0\t61.3\t0.5\tA1\n-12.25\t100\t0\tA 2\n".encode("utf-16"),
        "\ufeffX (m),Y [m],z,name\n0,61.3,0.5,A1\n-12.25,100,0,A 2\n",
        "X Position (m),Y Position (m),Z Position (m),Name\n0,61.3,0.5,A1\n-12.25,100,0,A 2\n",
        "sep=;\nX Position (m);Y Position (m);Z Position (m);Name\n0;61,3;0,5;A1\n-12,25;100;0;A 2\n",
        'x-location\ty-location\tz-location\tname\n"0"\t61,30\t0,5\tA1\n-12,25\t100\t0\tA 2\n'.replace('"', ""),
    ],
)
def test_as_spreadsheets_and_sam_write_it(written, content):
    layout = read_csv(written(content))
    assert (layout.x.tolist(), layout.y.tolist(), layout.z.tolist()) == ([0, -12.25], [61.3, 100], [0.5, 0])
    assert layout.columns["name"].tolist() == ["A1", "A 2"]


def test_what_is_tolerated(written):
    text = '\ufeff# by hand\n x , "y",z,row\n\n1,2,3,"A, 1"\n# a note; with, commas\n4 , 5,6, B \n\n  \n'
    layout = read_csv(written(text.replace("\n", "\r\n")))
    assert layout.x.tolist() == [1, 4]
    assert layout.z.tolist() == [3, 6]
    assert layout.columns["row"].tolist() == ["A, 1", "B"]
    assert layout.lines is not None
    assert layout.lines.tolist() == [4, 6]
    assert read_csv(written("x,y\r1,2\r3,4")).y.tolist() == [2, 4]


@settings(deadline=None, max_examples=60)
@given(rows=st.lists(st.tuples(numbers, numbers, numbers, st.integers(-(2**63) + 1, 2**63 - 1), words), min_size=1))
def test_round_trip_is_exact(tmp_path_factory, rows):
    x, y, z, ring, label = zip(*rows, strict=True)
    columns = {"ring": np.array(ring), "label": np.array(label), "power": np.array(z)}
    layout, path = Layout(np.array(x), np.array(y), np.array(z), columns), tmp_path_factory.getbasetemp() / "round.csv"
    write_csv(layout, path)
    again = read_csv(path)
    both = ((one.x, one.y, one.z, *one.columns.values()) for one in (layout, again))
    for first, second in zip(*both, strict=True):
        assert first.dtype.kind == second.dtype.kind
        np.testing.assert_array_equal(first, second)
    assert np.signbit(again.x).tolist() == np.signbit(layout.x).tolist()


def test_files_that_cannot_be_read(tmp_path):
    assert problems(tmp_path / "none.csv") == ["field.csv: there is no such file"]
    assert problems(tmp_path) == ["field.csv: is a folder, not a file"]
    assert problems(Path("/dev/null")) == ["field.csv: is not a regular file"]
    path = tmp_path / "large.csv"
    path.write_text("x,y\n1,2\n")
    with pytest.raises(StudyError, match=r"field\.csv: is larger than"):
        text_of(path, "field.csv", 5)


@pytest.mark.parametrize(
    ("content", "place", "words"),
    [
        ("", "", "is empty: it needs a header with the columns x and y"),
        ("x,y\n", "", "has a header but no heliostats"),
        (b"PK\x03\x04rest", "", "is a spreadsheet or an archive, not text"),
        ("x,y\n1,2\n".encode("utf-16-le"), ":1", "is a binary file, not text"),
        (b"\xff\xfe\x00", ":1", "is not UTF-8 text"),
        (b"x,y,row\n1,2,\xe9\n", ":2", "is not UTF-8 text"),
        ("site:\n  latitude: 0\n", ":1", "needs a column x"),
        ("x;y\n1,5;2.5\n", ":2", "has decimal points (2.5) and decimal commas (1,5): use one of them"),
        ("# tabs\nx\ty\n1,234\t2\n", ":3", "1,234 may be 1.234 or 1234; use decimal points"),
        ("x (kg),y\n1,2\n", ":1:1", "is in 'kg'; x must be in m"),
        ("X Position (east);Y Position (m)\n1;2\n", ":1:1", "is in 'east'; x must be in m"),
        ('x,y,row\n1,2,"A\n3,4,B\n', ":2", "contains a quoted cell that does not end on this line"),
        ("x,up\n1,2\n", ":1", "needs a column y with the distance north of the tower's base in m (got x, up)"),
        ("x,y,x\n1,2,3\n", ":1:5", "has two columns 'x'"),
        ("x,y\n1,2\n1,2,3\n", ":3", "has 3 fields, but the header has 2"),
        ("x,y\n1,two\n", ":2:3", "y must be a finite number (got 'two')"),
        ("x,y\n1,\n", ":2:3", "y is empty"),
        ("x,y\nnan,2\n", ":2:1", "x must be a finite number (got 'nan')"),
        ("x,y\n1,1e999\n", ":2:3", "y must be a finite number (got '1e999')"),
        ("x,y\n1,1_0\n", ":2:3", "y must be a finite number (got '1_0')"),
        ("x,y\n1,\u0663\n", ":2:3", "y must be a finite number (got '\u0663')"),
    ],
)
def test_bad_files(written, content, place, words):
    told = problems(written(content), reserved={"latitude", "x"})[0]
    assert told.startswith(f"field.csv{place}: ")
    assert words in told


def test_columns_that_nobody_needs_stop_nothing(written):
    text = "x (ft),y,latitude,,power,Num. Facets,ring,ring,2nd\n10,2,37,a,NaN,25,1,b,3\n0,4,38,b,7,36,2,c,4\n"
    layout = read_csv(written(text), reserved={"latitude", "x"})
    assert layout.x.tolist() == [pytest.approx(3.048), 0]
    assert layout.y.tolist() == [2, 4]
    assert layout.labels == ("layout_latitude", "column_4", "power", "num_facets", "layout_ring", "column_2nd")
    np.testing.assert_array_equal(layout.columns["power"], [np.nan, 7])
    long = read_csv(written("x,y,row\n1,2," + "A" * 101 + "\n"))
    assert long.columns["row"].tolist() == ["A" * 100]


def test_units_in_the_second_row(written):
    # Form of solsticepy's pos_and_aiming.csv (numpy.savetxt of titles, units and numbers).
    text = "x,y,z,foc,aim x,aim y,aim z,Zone,No.\nm,m,m,m,m,m,m,-,-\n0.0,80.5,3.0,95.25,0.0,0.0,62.0,1.0,2.0\n"
    layout = read_csv(written(text))
    assert (layout.x.tolist(), layout.y.tolist(), layout.z.tolist()) == ([0], [80.5], [3])
    assert layout.lines is not None
    assert layout.lines.tolist() == [3]
    assert {key: values.tolist() for key, values in layout.columns.items()} == {
        "focal_x": [95.25], "aim_x": [0], "aim_y": [0], "aim_z": [62], "zone": [1], "no": [2], "focal_y": [95.25],
    }  # fmt: skip
    assert layout.labels == ("zone", "no")
    assert read_csv(written("x,y,z\n1,1,1\n")).z.tolist() == [1]


def test_properties_of_single_heliostats(written):
    text = "x,y,Pivot Height,focal_length (mm),Slope error (rad),reflectivity,Mirror\n1,2,4,80000,0.002,0.9,A\n"
    layout = read_csv(written(text))
    expected = {"pivot_height": 4, "focal_x": 80, "focal_y": 80, "slope_error": 2, "reflectivity": 0.9}
    assert {key: layout.values(key)[0] for key in expected} == pytest.approx(expected)
    assert layout.labels == ("mirror",)
    assert layout.values("reflectivity", 0.5).tolist() == [0.5]
    assert layout.values("cleanliness", None, 1.0).tolist() == [1]
    np.testing.assert_array_equal(layout.focal_lengths("flat", np.array([90.0])), [[np.inf, np.inf]])
    np.testing.assert_array_equal(layout.focal_lengths("slant", np.array([90.0])), [[90, 90]])
    np.testing.assert_allclose(layout.focal_lengths("layout", np.array([90.0])), [[80, 80]])
    np.testing.assert_allclose(layout.focal_lengths(70.0, np.array([90.0])), [[70, 70]])


def test_many_bad_rows_are_counted(written):
    told = problems(written("x,y\n" + "a,b\n" * 1000))
    assert len(told) == 21
    assert told[0] == "field.csv:2:1: x must be a finite number (got 'a')"
    assert told[-1] == "field.csv: and 1,980 more problems"


def test_labels_of_files_are_names_and_else_numbers():
    place = np.arange(3.0)
    plain = Layout(place, place, place)
    assert plain.matches(["2", "0", "x"]).tolist() == [1, -1, 0]
    counted = Layout(place, place, place, {"id": np.array([1, 2, 3])})
    assert counted.matches(["1"]).tolist() == [0, -1, -1]
    assert counted.matches(["0", "3"]).tolist() == [0, -1, 1]
    named = Layout(place, place, place, {"id": np.array([7, 8, 9]), "name": np.array(["a", "b", "c"])})
    assert named.matches(["c", "1", "8"]).tolist() == [-1, 1, 0]


DATA = Path(__file__).parents[1] / "data" / "layouts"
CORNERS: dict[str, Any] = {"clock": "sun", "azimuth": [120, 180], "elevation": [15, 60]}
#: Field optical efficiency of the NSTTF, minimum and maximum [%]: exact cosine, shading and blocking of the positions
#: alone, which a ray count over 120 heliostats confirms within 5e-4.
NSTTF = (69.9608, 93.5509)


def efficiencies(**blocks: Any) -> tuple[float, float]:
    """Return the minimum and maximum of the field's optical efficiency. [%]"""
    study = api.load({"family": "field_efficiency", "tracking": "azimuth_elevation", "time": CORNERS, **blocks})
    values = 100 * api.build(study)["field_optical_efficiency"].compute()
    return float(values.min()), float(values.max())


def test_the_table_of_opencsp():
    layout = read_csv(DATA / "opencsp_nsttf.csv")
    assert len(layout) == 218
    assert (layout.x[0], layout.y[0], layout.z[0], layout.columns["name"][0]) == (92.61, 57.92, 5.45, "5E10")
    assert layout.labels == (
        "num_facets", "num_rows", "num_cols", "layout_pivot_height", "pivot_offset", "facet_width", "facet_height",
    )  # fmt: skip
    mirrors = {"heliostat": {"width": 6.1, "height": 6.1, "pivot_height": 0}, "receiver": {"height": 62}}
    file = {"file": str(DATA / "opencsp_nsttf.csv")}
    assert efficiencies(layout=file, **mirrors) == pytest.approx(NSTTF, abs=1e-4)


def test_the_parametric_export_of_solarpilot():
    layout = read_csv(DATA / "solarpilot_parametric.csv")
    assert (layout.x.tolist(), layout.y.tolist()) == ([-30, 0, 30], [80, 80, 80])
    mirrors = {"heliostat": {"width": 6, "height": 6, "pivot_height": 3}, "receiver": {"height": 90}}
    found = efficiencies(layout={"file": str(DATA / "solarpilot_parametric.csv")}, **mirrors)
    assert found == pytest.approx((86.66, 98.89), abs=0.006)  # of the table alone, without the parameters before it


def test_every_mirror_has_its_own_height():
    layout = read_csv(DATA / "own_heights.csv")
    assert set(layout.values("pivot_height")) == {3, 4.5, 6}
    time = {"time": {"clock": "sun", "azimuth": [120, 180], "elevation": [15, 50]}, "receiver": {"height": 84}}
    file = {"file": str(DATA / "own_heights.csv")}
    assert efficiencies(layout=file, heliostat={}, **time) == pytest.approx((67.9577, 76.8982), abs=1e-4)
    study = api.load({"family": "field_efficiency", "tracking": "azimuth_elevation", "layout": file,
                      "heliostat": {"pivot_height": 4}, **time})  # fmt: skip
    (note,) = study.notes()
    assert note.endswith("the column pivot_height is not used: 'heliostat.pivot_height' applies to all heliostats: "
                         "remove it to use the column")  # fmt: skip


#: Traced with 1e6 rays of an independent program: intercept of a cylinder at the file's focal lengths, 300 m and 80 m.
FOCAL = {None: ([0.7713, 0.3573], 5e-4), "slant": ([0.9984, 0.9797], 4e-4)}


@pytest.mark.parametrize("focus", [None, "slant"])
def test_focal_lengths_of_single_heliostats(focus):
    study = api.load({
        "family": "field_efficiency", "tracking": "azimuth_elevation",
        "time": {"clock": "sun", "azimuth": 180, "elevation": 45},
        "layout": {"file": str(DATA / "solarpilot_focal.csv")},
        "heliostat": {"width": 6, "height": 6, "pivot_height": 3, **({} if focus is None else {"focus": focus})},
        "receiver": {"kind": "cylinder", "height": 50, "radius": 1.5, "height_extent": 3},
        "optics": {"sun_shape": {"kind": "pillbox"}, "slope_error": 1},
    })  # fmt: skip
    expected, error = FOCAL[focus]
    found = api.build(study)["intercept_efficiency"].to_numpy().ravel()
    np.testing.assert_allclose(found, expected, atol=3 * error)
    assert any("focal_x, focal_y are not used" in note for note in study.notes()) == (focus == "slant")


def test_properties_reach_the_result():
    layout = read_csv(DATA / "properties.csv")
    optics = {"sun_shape": {"kind": "pillbox"}}
    blocks: dict[str, Any] = {
        "family": "field_efficiency", "tracking": "azimuth_elevation",
        "time": {"clock": "sun", "azimuth": 180, "elevation": 50},
        "heliostat": {"width": 6, "height": 6, "pivot_height": 4},
        "receiver": {"kind": "cylinder", "height": 84, "radius": 1.5, "height_extent": 3},
    }  # fmt: skip
    own = api.load({**blocks, "layout": {"file": str(DATA / "properties.csv")}, "optics": optics})
    result = api.build(own).compute()
    notes = list(own.notes())
    labels = "focal_length, layout_canting, layout_tracking, zone"
    assert notes[0].endswith(f"results do not depend on the columns {labels}, which are labels")
    assert len(notes) == 3
    assert notes[1].endswith("the column availability is not used: 'availability' is not set")
    assert "aim_x, aim_y, aim_z" in notes[2]
    for slope, reflectivity, focus in ((1.0, 0.9, 100.0), (5.0, 0.1, 50.0)):
        same = api.load({
            **blocks, "layout": {"x": layout.x, "y": layout.y},
            "heliostat": {**blocks["heliostat"], "focus": focus},
            "optics": {**optics, "slope_error": slope, "reflectivity": reflectivity, "cleanliness": 0.5},
        })  # fmt: skip
        rows = np.flatnonzero(layout.columns["slope_error"] == slope)
        alone = api.build(same).compute()
        for name in ("intercept_efficiency", "total_efficiency"):
            found, wanted = (one[name].to_numpy().ravel()[rows] for one in (result, alone))
            np.testing.assert_allclose(found, wanted, atol=0.012, rtol=0.01, err_msg=name)


@pytest.mark.parametrize(
    "text",
    [
        "Ost;Nord\n0;100\n50,5;100\n",
        "Este,Norte\n0,100\n50.5,100\n",
        "# x y z\n0.0 100.0 0.0\n50.5 100.0 0.0\n",  # numpy.savetxt(..., header="x y z")
        "# x,y\r\n0.0,100.0\r\n50.5,100.0\r\n",
        "# x and y in metres\nx,y\n0.0,100.0\n50.5,100.0\n",
    ],
)
def test_titles_of_other_languages_and_of_numpy(text):
    layout = read_text(text, "field.csv")
    assert layout.x.tolist() == [0.0, 50.5]
    assert layout.y.tolist() == [100.0, 100.0]


def at(*places: tuple[float, ...], lines: list[int] | None = None) -> Layout:
    """Return a layout of a few heliostats."""
    x, y, z = np.array([(*place, 0.0)[:3] for place in places]).T
    return Layout(x, y, z, name="field.csv", lines=None if lines is None else np.array(lines))


def messages(layout: Layout, width: ArrayLike = 10, height: ArrayLike = 10) -> tuple[list[str], list[str]]:
    problems, warnings = check_layout(layout, width, height)
    return [str(problem) for problem in problems], [str(warning) for warning in warnings]


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1), count=st.one_of(st.integers(2, 400), st.integers(500, 600)),
    size=st.sampled_from([1, 10, 100, 1e6]), limit=st.floats(1e-3, 20), flat=st.booleans(),
)  # fmt: skip
def test_pairs_against_a_tree(seed, count, size, limit, flat):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-size, size, (count, 3)) * [1, 1, 0 if flat else 1]
    pairs = too_close(points[:, 0], points[:, 1], points[:, 2], limit)

    apart = np.sqrt(((points[:, None] - points) ** 2).sum(axis=-1))
    low, high = np.nonzero(np.triu(apart < limit, 1))
    assert [gap for *_, gap in pairs] == sorted(gap for *_, gap in pairs)
    for first, second, gap in pairs:
        assert first < second
        assert gap == pytest.approx(math.dist(points[first], points[second]), rel=1e-12)
    np.fill_diagonal(apart, np.inf)
    assert {row for pair in pairs for row in pair[:2]} == set(np.flatnonzero((apart < limit).any(axis=1)))
    if (apart < limit).sum(axis=1).max() < 8:
        assert {pair[:2] for pair in pairs} == set(zip(low.tolist(), high.tolist(), strict=True))


def test_duplicates_name_the_rows():
    problems, warnings = messages(at((0, 50), (20, 50), (0, 50), (0, 50), lines=[2, 3, 4, 7]))
    assert problems == [
        "field.csv:4: heliostat 2 has the position of heliostat 0 (line 2)",
        "field.csv:7: heliostat 3 has the position of heliostat 0 (line 2)",
    ]
    assert warnings == []
    assert messages(at((0, 50), (0, 50, 12)))[0] == []


def test_colliding_mirrors_name_the_rows():
    problems, warnings = messages(at((0, 50), (9, 50), (40, 50), lines=[2, 3, 5]), width=12, height=10)
    assert problems == [
        "field.csv:3: heliostat 1 is 9 m from heliostat 0 (line 2), less than the shorter side of the "
        "mirrors, 10 m: they collide"
    ]
    assert warnings == []


def test_mirrors_of_unequal_size():
    layout, sides = at((0, 50), (9, 50), (9, 57)), np.array([12, 4, 4])
    problems, (warning,) = messages(layout, sides, sides)
    assert problems == []
    assert warning.endswith("heliostat 0 and heliostat 1, 9 m apart, with a diagonal of 11.3137 m")
    sides = np.array([12, 8, 2])
    (problem,), _ = messages(layout, sides, sides)
    assert problem == (
        "field.csv: heliostat 1 is 9 m from heliostat 0, less than the shorter side of the mirrors, 10 m: they collide"
    )


def test_below_the_diagonal_is_one_warning():
    problems, (warning,) = messages(at((0, 50), (12, 50), (40, 50), (40, 63), lines=[2, 3, 4, 5]))
    assert problems == []
    assert warning.startswith("field.csv: 2 pairs of neighbours are closer than the diagonal of the mirrors")
    assert warning.endswith("heliostat 0 (line 2) and heliostat 1 (line 3), 12 m apart, with a diagonal of 14.1421 m")
    assert messages(at((0, 0), (30, 0))) == ([], [])  # also at the foot of the tower
    assert messages(at((0, 50), (10, 50)))[0] == []  # one shorter side apart: a warning, not an error


@pytest.mark.parametrize("value", [math.nan, math.inf, -4.1e6])
def test_coordinates_off_any_field(value):
    problems, _ = messages(at((0, 50), (20, value)))
    assert len(problems) == 1
    assert problems[0].startswith("field.csv: heliostat 1 is beyond any field: x, y and z must be in metres")

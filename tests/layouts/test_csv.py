"""Layouts as CSV: what is read, what comes back, and what each bad file is told."""

import string
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heliosweep.config import text_of
from heliosweep.errors import StudyError
from heliosweep.layouts import Layout, read_csv, write_csv

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
        "X Position (m);Y Position (m);Z Position (m);Name\n0;61,3;0,5;A1\n-12,25;100;0;A 2\n",
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
        ("\n \n# nothing\n", "", "is empty: it needs a header with the columns x and y"),
        ("x,y\n", "", "has a header but no heliostats"),
        (b"PK\x03\x04rest", "", "is a spreadsheet or an archive, not text"),
        ("x,y\n1,2\n".encode("utf-16-le"), ":1", "is a binary file, not text"),
        (b"\xff\xfe\x00", ":1", "is not UTF-8 text"),
        (b"x,y,row\n1,2,\xe9\n", ":2", "is not UTF-8 text"),
        (b"x,y\n1,\x002\n", ":2", "is a binary file, not text"),
        ("site:\n  latitude: 0\n", ":1", "needs a column x"),
        ("x;y\n1,5;2.5\n", ":2", "has decimal points (2.5) and decimal commas (1,5): use one of them"),
        ("# tabs\nx\ty\n1,234\t2\n", ":3", "1,234 may be 1.234 or 1234; write numbers with a point"),
        ("x (kg),y\n1,2\n", ":1:1", "is in 'kg'; x must be in m"),
        ("X Position (east);Y Position (m)\n1;2\n", ":1:1", "is in 'east'; x must be in m"),
        ('x,y,row\n1,2,"A\n3,4,B\n', ":2", "contains a quoted text that does not end on this line"),
        ('x,y,row\n1,2,"A\n3,4,B"\n5,6,C\n', ":2", "contains a quoted text that does not end on this line"),
        ("x_east,y\n1,2\n", ":1", "(got x_east, y)"),
        ("x,up\n1,2\n", ":1", "needs a column y, the metres north of the tower's base (got x, up)"),
        ("x,z\n1,2\n", ":1", "(got x, z)"),
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


def test_all_bad_rows_at_once(written):
    assert problems(written("# a note\nx,y,z\n1,a,3\n\n1,2\nb,2,inf\n5,6,7\n")) == [
        "field.csv:3:3: y must be a finite number (got 'a')",
        "field.csv:5: has 2 fields, but the header has 3",
        "field.csv:6:1: x must be a finite number (got 'b')",
        "field.csv:6:5: z must be a finite number (got 'inf')",
    ]


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

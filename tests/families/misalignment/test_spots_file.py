"""Tables of measured spots: what is read, and that everything wrong is said with its line, column and remedy."""

from pathlib import Path

import numpy as np
import pytest

from heliosweep.errors import StudyError
from heliosweep.families.misalignment import spots_file
from heliosweep.families.misalignment.spots_file import read_spots

NAMES = ("A1", "A2", "B1", "B1")
TIME = "2024-06-21T09:30:00+02:00"


@pytest.fixture
def read(tmp_path, monkeypatch):
    """Read a table from its text."""

    def reader(text, heliostats=4, names=NAMES, timezone=""):
        monkeypatch.chdir(tmp_path)
        path = Path("spots.csv")
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_spots(path, heliostats, names, timezone=timezone)

    return reader


@pytest.fixture
def wrong(read):
    """Problems of a table, in words."""

    def problems(text, **options):
        with pytest.raises(StudyError) as caught:
            read(text, **options)
        return [str(problem) for problem in caught.value.problems]

    return problems


def test_times_names_weights_and_angles(read):
    table = read(
        "\ufeff# a comment\n"
        "heliostat,time,y,z,weight,azimuth,elevation,comment\n"
        f"A2,{TIME},0.25,-1.5,2,170.5,45,windy\n"
        "\n"
        '0,2024-06-21T07:30:00Z,1e-1,+0.5,0,-10,30.25,"clouds, some"\n'
    )
    assert table.heliostat.tolist() == [1, 0]
    assert table.utc[0] == table.utc[1] == np.datetime64("2024-06-21T07:30", "ns")
    assert table.position.tolist() == [[0.25, -1.5], [0.1, 0.5]]
    assert table.weight.tolist() == [2.0, 0.0]
    np.testing.assert_allclose(np.degrees(table.angles), [[170.5, 45], [-10, 30.25]], rtol=1e-15)
    assert table.lines.tolist() == [3, 5]
    assert table.timed
    assert np.isnan(table.sun).all()
    assert table.heliostat.size == 2


def test_other_columns_are_not_read_and_listed(read):
    table = read(f"heliostat,time,y,exposure,z,camera\nA2,{TIME},0.25,0.1,-1.5,east\n")
    assert table.position.tolist() == [[0.25, -1.5]]
    assert table.unused == ("exposure", "camera")


def test_times_of_a_log_on_the_clock_of_a_zone(read):
    """Madrid is 1 h ahead of universal time in winter and 2 h in summer; a time with an offset keeps it."""
    rows = ["2024-03-30T12:00:00", "2024-03-31T12:00:00", "2024-10-26T12:00", "2024-10-27T12:00", "2024-06-01T12:00Z"]
    text = "heliostat,time,y,z\n" + "".join(f"A1,{time},0,0\n" for time in rows)
    table = read(text, timezone="Europe/Madrid")
    hours = (table.utc - table.utc.astype("datetime64[D]")) / np.timedelta64(1, "h")
    assert hours.tolist() == [11, 10, 10, 11, 12]
    assert read(text.replace("Z", ""), timezone="-03:30").utc[0] == np.datetime64("2024-03-30T15:30", "ns")


def test_sun_vectors_are_normalised(read):
    table = read("heliostat,y,z,sun_x,sun_y,sun_z\n3,0,0,0,-0.6004,0.8004\n")
    assert not table.timed
    np.testing.assert_allclose(np.linalg.norm(table.sun, axis=1), 1.0, rtol=1e-15)
    assert np.isnat(table.utc).all()
    assert table.weight.tolist() == [1.0]
    assert np.isnan(table.angles).all()


def test_a_name_that_is_a_number_is_a_name(read):
    table = read(f"heliostat,time,y,z\n2,{TIME},0,0\n0,{TIME},0,0\n", names=("2", "1", "3", "4"))
    assert table.heliostat.tolist() == [0, 0]


HEADER, SUNS = "heliostat,time,y,z", "heliostat,y,z,sun_x,sun_y,sun_z"


@pytest.mark.parametrize(
    ("header", "row", "said"),
    [
        (HEADER, f"B11,{TIME},0,0", "3:1: heliostat is unknown; did you mean 'B1'? (got 'B11')"),
        (
            HEADER,
            f"Xylo,{TIME},0,0",
            "heliostat is unknown; heliostats are numbered from 0 to 3, or named as in the layout",
        ),
        (HEADER, f"1.0,{TIME},0,0", "heliostat is unknown"),
        (HEADER, f"B1,{TIME},0,0", "'B1' is the name of several heliostats: give the number"),
        (HEADER, f",{TIME},0,0", "3:1: heliostat is empty"),
        (HEADER, f"A1,{TIME},nan,0", "y must be a finite number (got 'nan')"),
        (HEADER, f"A1,{TIME},1e200,0", "3:30: y must be between -1e6 and 1e6 m (got '1e200')"),
        (HEADER, f"A1,{TIME},,0", "y is empty"),
        (HEADER, "A1,2024-06-21T09:30:00,0,0", "3:4: time needs an offset from UTC, such as +02:00 or Z"),
        (HEADER, "A1,21.06.2024 09:30,0,0", "time must be an ISO 8601 time"),
        (HEADER, "A1,1024-06-21T09:30Z,0,0", "time must be in the years 1700 to 2200"),
        (HEADER, "A1,0,0", "has 3 fields, but the header has 4"),
        (f"{HEADER},weight", f"A1,{TIME},0,0,-0.5", "2:34: weight must be at least 0, because it is an inverse varian"),
        (SUNS, "A1,0,0,0,0,1.0011", "the length of the sun vector is 1.0011, but must be 1 to within 0.001: divide it"),
        (SUNS, "A1,0,0,0.6,0,-0.8", "the sun is not above the horizon (elevation -53.13 deg); sun_z is positive up"),
        (SUNS, "A1,0,0,x,0,1", "2:8: sun_x must be a finite number (got 'x')"),
        ("time,y,z", "1,1,1", "needs a column heliostat: number of the heliostat"),
        ("heliostat,time,z", "1,1,1", "needs a column y:"),
        ("heliostat,y,z", "1,1,1", "needs a column time, or sun_x, sun_y, sun_z, to define the direction of the sun"),
        ("heliostat,y,z,sun_x,sun_z", "1,1,1,1,1", "needs the columns sun_y in addition to sun_x, sun_z"),
        ("heliostat,y,z,time,sun_x,sun_y,sun_z", "1,1,1,1,1,1,1", "has both time and sun_x: remove one"),
        ("heliostat,y,z,time,azimuth", "1,1,1,1,1", "needs a column elevation in addition to azimuth, or neither"),
        ("heliostat,y,z,time,y", "1,1,1,1,1", "1:20: has two columns 'y'; remove one"),
    ],
)
def test_wrong_rows_and_headers(wrong, header, row, said):
    good = f"A1,{TIME},0,0\n" if header == HEADER else ""
    (problem,) = wrong(f"{header}\n{good}{row}\n")
    assert problem.startswith({HEADER: "spots.csv:3", SUNS: "spots.csv:2"}.get(header, "spots.csv:"))
    assert said in problem


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "spots.csv: is empty: it needs a header"),
        ("heliostat,time,y,z\n", "has a header but no spots"),
        (b"PK\x03\x04rest", "is a spreadsheet"),
        (b"heliostat,time\n\xff\xfe\n", "spots.csv:2: is not UTF-8"),
        (f'heliostat,time,y,z\nA1,{TIME},0,"0\n0"\n', "spots.csv:2: contains a quoted cell"),
        (f'heliostat,time,y,z\n"A1,{TIME},0,0\n' + f"A1,{TIME},0,0\n" * 5, "spots.csv:2: contains a quoted cell"),
        (f'heliostat,time,y,z\nA1,{TIME},0,"0"1\n' + f"A1,{TIME},0,0\n" * 5, "spots.csv:2: is not CSV"),
    ],
)
def test_what_is_no_table(wrong, text, said):
    (problem,) = wrong(text)
    assert said in problem


def test_all_wrong_rows_at_once_and_long_lists_are_cut(wrong):
    problems = wrong("heliostat,time,y,z\n" + f"A1,{TIME},x,y\n" * 500)
    assert len(problems) == spots_file.MAX_LISTED + 1
    assert problems[0].startswith("spots.csv:2:30: y must be")
    assert problems[1].startswith("spots.csv:2:32: z must be")
    assert problems[-1] == "spots.csv: and 980 more problems"


def test_files_that_cannot_be_read(tmp_path):
    for path, said in ((tmp_path / "none.csv", "no such file"), (tmp_path, "is a folder")):
        with pytest.raises(StudyError, match=said):
            read_spots(path, 4)

"""Layouts of SolarPILOT: what is read, what comes back, and what bad files are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heliosweep import StudyError
from heliosweep.layouts import Layout, read_csv
from heliosweep.layouts.layout import SOLARPILOT_COLUMNS, write_solarpilot

#: As `SPFrame::LayoutSimulationExport` writes it: an empty line, the sun, the header with a comma at its end.
EXPORT = """\

Solar azimuth,180.00,deg
Solar zenith,30.00,deg
DNI,950.00,W/m2

Heliostat ID,Pos-x,Pos-y,Pos-z,Aim-x,Aim-y,Aim-z,Total eff,Power [kW],
7,0.00,60.00,0.50,0.10,0.00,1.25,0.7100,45.20,
9,-20.00,80.00,0.00,0.00,0.00,0.00,0.6900,44.00,
"""


@pytest.fixture
def written(tmp_path):
    """Write a file and give its path."""

    def write(content: str) -> Path:
        path = tmp_path / "field.csv"
        path.write_text(content, encoding="utf-8")
        return path

    return write


def test_without_header(written):
    layout = read_csv(written("0,1126.85,1362.1,0\n0,36.59,879.35,-1.5\n"))
    assert layout.x.tolist() == [1126.85, 36.59]
    assert layout.y.tolist() == [1362.1, 879.35]
    assert layout.z.tolist() == [0, -1.5]
    assert dict(layout.columns) == {}
    assert layout.lines is not None
    assert layout.lines.tolist() == [1, 2]


def test_all_columns_and_null(written):
    rows = "0,0,60,0,NULL,NULL,NULL,NULL,NULL,0,0,1.5\n1,20,60,0,80,81,NULL,NULL,NULL,NULL,NULL,NULL\n2,40,60,0\n"
    layout = read_csv(written(rows))
    assert list(layout.columns) == ["template", "focal_x", "focal_y", "aim_x", "aim_y", "aim_z"]
    assert layout.columns["template"].tolist() == [0, 1, 2]
    np.testing.assert_equal(layout.columns["focal_y"], [np.nan, 81, np.nan])
    np.testing.assert_equal(layout.columns["aim_z"], [1.5, np.nan, np.nan])


@pytest.mark.parametrize(
    "header",
    [
        "Template,Loc. X,Loc. Y,Loc. Z,Aim X,Aim Y,Aim Z",
        "template,Location X,Location Y,Location Z,aim x,aim y,aim z",
        "helio_template_id,x_location,y_location,z_location,aim_x,aim_y,aim_z",
    ],
)
@pytest.mark.parametrize("separator", [",", "\t"])
def test_headers(written, header, separator):
    text = f"{header}\n3,1,2,3,4,5,6\n4,-1,2,3,4,5,6\n".replace(",", separator)
    layout = read_csv(written(text))
    assert layout.x.tolist() == [1, -1]
    assert layout.z.tolist() == [3, 3]
    assert list(layout.columns) == ["template", "aim_x", "aim_y", "aim_z"]


def test_export_of_a_simulation(written):
    layout = read_csv(written(EXPORT), reserved={"power_kw"})
    assert layout.y.tolist() == [60, 80]
    assert layout.z.tolist() == [0.5, 0]
    assert list(layout.columns) == ["id", "aim_x", "aim_y", "aim_z", "total_eff", "layout_power_kw"]
    assert layout.lines is not None
    assert layout.lines.tolist() == [7, 8]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("0,1,2,3\n0,1,b,3\n", "field.csv:2:5: y must be a finite number (got 'b')"),
        ("0,1,2,3\n0,1\n", "field.csv:2: has 2 fields, but the header has 4"),
        ("Template,Loc. X,Loc. Y\n", "has a header but no heliostats"),
        ("Template,Loc. X,Loc. X,Loc. Y\n0,1,2,3\n", "has two columns 'x'"),
        ("1,2\n3,4\n", "needs a column x"),
    ],
)
def test_bad_files(written, content, said):
    with pytest.raises(StudyError) as caught:
        read_csv(written(content), name="field.csv")
    assert said in str(caught.value)


def test_mirrors_of_one_size_have_one_template(tmp_path):
    sides = {"width": np.array([1.0, 2.0, 1.0]), "height": np.array([1.0, 1.0, 1.0])}
    layout = Layout(np.array([0.0, 9.0, 18.0]), np.full(3, 9.0), np.zeros(3), sides)
    write_solarpilot(layout, tmp_path / "field.csv")
    assert [line.split(",")[0] for line in (tmp_path / "field.csv").read_text().splitlines()] == ["0", "1", "0"]


lengths = st.floats(-1e5, 1e5).map(lambda value: value + 0.0)


@settings(max_examples=25)
@given(data=st.data(), count=st.integers(1, 6), groups=st.sets(st.sampled_from(["focal", "cant", "aim"])))
def test_round_trip_to_the_last_bit(tmp_path_factory, data, count, groups):
    def column(values):
        return np.array(data.draw(st.lists(values, min_size=count, max_size=count)))

    columns = {key: column(lengths) for key in SOLARPILOT_COLUMNS[4:] if key.partition("_")[0] in groups}
    layout = Layout(column(lengths), column(lengths), column(lengths), columns)
    path = tmp_path_factory.mktemp("round") / "field.csv"
    write_solarpilot(layout, path)
    again = read_csv(path)
    for key in "xyz":
        np.testing.assert_array_equal(getattr(again, key), getattr(layout, key))
    assert set(again.columns) - {"template"} == set(columns)
    for key, values in columns.items():
        np.testing.assert_array_equal(again.columns[key], values, err_msg=key)
    # SolarPILOT reads every line with a comma as a heliostat, and needs at least four fields.
    rows = [line.split(",") for line in path.read_text().splitlines() if "," in line]
    assert len(rows) == count
    assert {len(row) for row in rows} <= {4, 6, 9, 12}

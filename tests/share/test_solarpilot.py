"""Layouts of SolarPILOT: what is read, what comes back, and what bad files are told."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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

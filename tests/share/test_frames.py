"""Results as tables and CSV."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from heliosweep import build, run, to_frame, write_csv
from heliosweep.cli import main


@pytest.fixture(scope="module")
def result(small):
    return build(small()).compute()


def test_a_row_for_each_point(result):
    frame = to_frame(result, ["optical_efficiency", "cosine_efficiency"])
    first = ["latitude", "tracking", "heliostat", "x", "y", "z", "ring", "azimuth"]
    assert list(frame.columns) == [*first, "optical_efficiency", "cosine_efficiency"]
    assert len(frame) == result["optical_efficiency"].size
    indexed = frame.set_index(["latitude", "tracking", "heliostat"]).to_xarray()
    chosen = result["optical_efficiency"]
    np.testing.assert_array_equal(indexed["optical_efficiency"].sel(tracking=chosen["tracking"]), chosen)
    np.testing.assert_array_equal(frame["x"].iloc[:48], result["x"])
    assert frame.attrs["units"]["x"] == "m"
    named = to_frame(result, "optical_efficiency", units=True)
    assert {"latitude [degrees_north]", "x [m]", "ring", "optical_efficiency"} <= set(named.columns)


def test_instants_are_written_in_full(small, tmp_path):
    time: dict[str, object] = {"clock": "civil", "timezone": "+01:00", "dates": "2021-06-21"}
    time |= {"window": {"start": "11:00", "stop": "12:00", "step": 0.5}}
    study = small(site={"latitude": 40, "longitude": 0}, time=time, output={"time_series": True})
    path = write_csv(build(study).compute(), tmp_path / "r.csv", "instantaneous_optical_efficiency")
    assert pd.to_datetime(pd.read_csv(path)["time"]).unique().tolist() == [
        pd.Timestamp("2021-06-21 10:00"),
        pd.Timestamp("2021-06-21 10:30"),
        pd.Timestamp("2021-06-21 11:00"),
    ]


def test_command(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run(small(), "out", report=False)
    assert main(["export", "out", "-o", "r.csv", "--variable", "field_optical_efficiency"]) == 0
    assert capsys.readouterr().out == "r.csv\n"
    assert list(pd.read_csv("r.csv").columns) == ["latitude [degrees_north]", "tracking", "field_optical_efficiency"]
    before = Path("r.csv").read_bytes()
    assert main(["export", "out", "-o", "r.csv", "--variable", "optical_efficiency"]) == 2
    assert Path("r.csv").read_bytes() == before
    assert main(["export", "out", "-o", "r.csv", "--variable", "optical_efficiency", "--force"]) == 0
    assert main(["export", "out", "--output", "all.csv"]) == 2
    assert main(["export", "out", "--variable", "optical_efficiency"]) == 2
    assert main(["export", "out", "--csv", "missing/all.csv", "--variable", "optical_efficiency"]) == 2
    said = capsys.readouterr().err
    assert "choose from the variables over latitude, tracking" in said
    assert "--output: specify a file, .csv or .xlsx" in said
    assert "its folder does not exist" in said
    assert {path.name for path in Path().iterdir()} == {"out", "r.csv"}

"""Interactive use: studies without YAML, lazy results with good reprs, plots and tables."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import heliosweep
from heliosweep import HeliosweepError, StudyError
from tests.conftest import SMALL


def blocks(**others):
    return {key: value for key, value in {**SMALL, **others}.items() if key != "family" and value is not None}


@pytest.fixture
def result() -> xr.Dataset:
    return heliosweep.build(
        heliosweep.study("field_efficiency", **blocks(site={"latitude": heliosweep.sweep(0, 40, num=3)}))
    )


def test_a_study_in_python_is_that_of_the_file(tmp_path):
    made = heliosweep.study("field_efficiency", **blocks(site={"latitude": heliosweep.sweep(0, 60, step=15)}))
    assert made == heliosweep.load({**SMALL, "site": {"latitude": {"start": 0, "stop": 60, "step": 15}}})
    listed = heliosweep.study("field_efficiency", **blocks(site={"latitude": np.arange(0, 61, 15)}))
    assert listed.study_id == made.study_id
    path = heliosweep.save(made, tmp_path / "study.yaml")
    assert path.read_text() == made.to_yaml(tmp_path)
    again = heliosweep.load(path)
    assert again.study_id == made.study_id
    assert again == made
    with pytest.raises(StudyError, match=r"exists already; --force \(force=True in Python\) replaces it"):
        heliosweep.save(made, path)
    assert heliosweep.save(made, path, force=True) == path


def test_files_are_named_as_seen_from_the_study_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("field.csv").write_text("x,y\n0,50\n15,50\n")
    Path("studies").mkdir()
    made = heliosweep.study("field_efficiency", **blocks(layout={"file": Path("field.csv")}))
    saved = heliosweep.save(made, "studies/one.yaml")
    assert "file: ../field.csv" in saved.read_text()
    assert heliosweep.load(saved).study_id == made.study_id


def test_build_is_lazy_and_shows_itself(result):
    assert all(variable.chunks is not None for variable in result.data_vars.values())
    text = repr(result)
    assert "dask.array" in text
    assert len(text) < 6000
    page = result._repr_html_()
    assert "degrees_north" in page
    assert len(page) < 200_000
    for name in ("x", "y", "z", "latitude", "heliostat", "receiver_height"):
        assert "units" in result[name].attrs, name
    assert all("units" in variable.attrs for variable in result.data_vars.values())
    assert result.attrs["title"] == "a small field"
    one = result["field_optical_efficiency"].sel(latitude=20, tracking="azimuth_elevation").compute()
    assert 0.5 < float(one) < 1
    assert "plot.map()" in repr(result.heliosweep)


@pytest.mark.parametrize("order", ["import xarray, heliosweep", "import heliosweep, xarray; heliosweep.build"])
def test_the_accessor_comes_with_the_import(order):
    last = "import heliosweep.accessor; " if order.endswith("build") else ""
    code = f"{order}; {last}print(repr(xarray.Dataset(attrs={{'title': 'mine'}}).heliosweep))"
    told = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.startswith("<heliosweep: mine; study, figures()")


def test_study_of_a_result(result, tmp_path):
    assert result.heliosweep.study.study_id == result.attrs["study_id"]
    assert result.sel(latitude=20).heliosweep.study.study_id == result.attrs["study_id"]
    with pytest.raises(HeliosweepError, match="contains no study"):
        _ = xr.Dataset({"a": 1}).heliosweep.study


def test_study_of_a_result_with_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("field.csv").write_text("x,y\n0,50\n15,50\n")
    made = heliosweep.study("field_efficiency", **blocks(layout={"file": "field.csv"}))
    with pytest.raises(HeliosweepError, match=r"load its study\.resolved\.yaml"):
        _ = heliosweep.build(made).heliosweep.study
    with heliosweep.run(made, "out", report=False).open() as opened:
        assert opened.heliosweep.study.study_id == made.study_id
    Path("field.csv").write_text("x,y\n0,50\n16,50\n")  # another field since
    with heliosweep.open_result("out") as opened, pytest.raises(HeliosweepError):
        _ = opened.heliosweep.study


def test_figures_and_maps(result, tmp_path):
    drawings = result.heliosweep.figures()
    assert [one.name for one in drawings][:1] == ["field_maps"]
    png = drawings[0]._repr_png_()
    assert png.startswith(b"\x89PNG")
    drawn = result.heliosweep.plot.map("shading_efficiency", latitude=20, tracking="azimuth_elevation")
    assert "at latitude 20° N, azimuth-elevation." in drawn.caption
    assert drawn._repr_png_().startswith(b"\x89PNG")
    assert drawn.save(tmp_path / "map.svg").read_bytes().startswith(b"<?xml")
    with pytest.raises(StudyError, match=r"must end in \.png, \.svg or \.pdf"):
        drawn.save(tmp_path / "map.gif")
    with pytest.raises(StudyError, match="exists already; --force"):
        drawn.save(tmp_path / "map.svg")
    assert drawn.save(tmp_path / "map.svg", force=True).read_bytes().startswith(b"<?xml")
    with pytest.raises(StudyError, match="its folder does not exist"):
        drawn.save(tmp_path / "nowhere" / "map.svg")
    assert [path.name for path in tmp_path.iterdir()] == ["map.svg"]
    curve = result.heliosweep.plot.curve("field_optical_efficiency", "latitude")
    (axes,) = curve.figure.axes
    assert len(axes.lines) == 2
    assert axes.get_xlabel() == "latitude"
    np.testing.assert_allclose(
        axes.lines[0].get_ydata(), 100 * result["field_optical_efficiency"].isel(tracking=0).to_numpy()
    )


def test_what_a_plot_needs(result):
    plot, optical = result.heliosweep.plot, "field_optical_efficiency"
    many = xr.Dataset({"x": ("draw", np.arange(16))}, {"draw": np.arange(16)})
    days = many.assign_coords(draw=np.arange("2021-06-01", "2021-06-17", dtype="datetime64[D]").astype("M8[ns]"))
    of_many, of_days = many.heliosweep.plot, days.heliosweep.plot
    for drawn, names, place, said in (
        (plot.map, (), {"latitude": 20}, "choose one value of tracking"),
        (plot.map, (optical,), {"latitude": 20, "tracking": "azimuth_elevation"},
         "has no dimension 'heliostat', which a map requires"),
        (plot.map, ("optical",), {}, "optical: no such variable"),
        (plot.map, (), {"latitude": 20, "tracking": "azimuth-elevation"},
         r"select\.tracking: is not in the result; did you mean 'azimuth_elevation'\?"),
        (of_many.map, ("x",), {}, r"choose one value of draw \(draw: 0, 1, .*, 9 and 6 more\)"),
        (of_days.map, ("x",), {}, r"choose one value of draw \(draw: 2021-06-01, 2021-06-02, "),
        (of_days.map, ("x",), {"draw": "2021-07-01"},
         r"choose from 2021-06-01, .*, 2021-06-10 and 6 more \(got 2021-07-01\)"),
        (of_days.map, ("x",), {"draw": "2021-06-03"}, "has no dimension 'heliostat'"),
        (plot.map, (), {"latitude": 21}, r"select\.latitude: is not in the result; choose from 0\.0, 20\.0, 40\.0"),
        (plot.curve, (optical, "time"), {"latitude": 20}, f"time: is not a dimension of {optical}"),
    ):  # fmt: skip
        with pytest.raises(StudyError, match=said):
            drawn(*names, **place)


def test_a_layout_from_a_table_and_a_result_that_says_what_it_holds(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    positions = pd.DataFrame({"x": [0.1, 30, 60], "y": [100, 100, 1 / 3 + 100], "name": ["A1", "A2", "B1"]})
    file = heliosweep.write_layout(positions, "small.csv")
    assert heliosweep.read_layout(file).y.tolist() == positions.y.tolist()
    with pytest.raises(heliosweep.StudyError, match="needs a column y"):
        heliosweep.write_layout(positions.drop(columns="y"), "other.csv")
    study = heliosweep.study("field_efficiency", **blocks(layout={"file": file}))
    result = heliosweep.run(study, "out", report=False, scheduler="synchronous", workers=1)
    assert "heliostat 3" in str(result)
    assert "mean optical efficiency of the field over the period: " in str(result)
    with result.open() as data:
        assert data.x.sel(name="A2") == 30
        assert data.heliosweep.sel(heliostat="A2").x == 30
        assert data.heliosweep.sel(heliostat=["B1", "A1"]).x.values.tolist() == [60, 0.1]
        assert data.heliosweep.sel(heliostat=2).x == data.heliosweep.sel(heliostat=slice(2, None)).x.item() == 60
        assert float((data.x - data.x.isel(heliostat=[1])).sum()) == 0  # both indexes go together
        with pytest.raises(heliosweep.StudyError, match=r"is not in the result; choose from .* \(got A3\)"):
            data.heliosweep.sel(heliostat="A3")
        with pytest.raises(heliosweep.StudyError, match="is the name of 2 heliostats; choose a number"):
            data.assign_coords(name=("heliostat", ["A", "A", "B"])).heliosweep.sel(heliostat="A")
    with pytest.raises(heliosweep.StudyError, match="workers: must be between 1 and 65536"):
        heliosweep.run(study, "out", workers=0)

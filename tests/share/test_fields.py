"""Layouts of studies and files, written for SolarPILOT and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from heliosweep import StudyError, layout_of, read_layout, save, write_layout
from heliosweep.cli import main


def test_layout_of_a_study(small):
    layout = layout_of(small())
    assert len(layout) == 48
    assert set(layout.columns) == {"ring", "azimuth", "width", "height"}
    assert set(layout.columns["width"]) == {9.0}
    swept = small(layout={"radial_stagger": {"clearance": [13, 14], "inner_radius": 50, "rings": 2}})
    with pytest.raises(StudyError, match=r"layout.radial_stagger.clearance: is swept: there are several layouts"):
        layout_of(swept)


@pytest.mark.parametrize("form", ["csv", "solarpilot"])
def test_there_and_back(small, tmp_path, form):
    layout = layout_of(small())
    path = write_layout(layout, tmp_path / "field.csv", form)
    again = read_layout(path)
    for key in "xyz":
        np.testing.assert_array_equal(getattr(again, key), getattr(layout, key))
    for key in ("width", "height"):
        np.testing.assert_array_equal(again.columns[key], layout.columns[key])
    with pytest.raises(StudyError, match="exists already"):
        write_layout(layout, path, form)
    assert write_layout(layout, path, form, force=True) == path
    with pytest.raises(StudyError, match="unknown form 'xml'"):
        write_layout(layout, path, "xml")  # type: ignore[arg-type]


def test_the_same_field_by_way_of_solarpilot(small, tmp_path, monkeypatch):
    from heliosweep.api import build

    monkeypatch.chdir(tmp_path)
    study = small()
    write_layout(layout_of(study), "field.csv", "solarpilot")
    again = small(layout={"file": "field.csv"}, heliostat={"pivot_height": 5})
    for name in ("optical_efficiency", "field_optical_efficiency"):
        np.testing.assert_array_equal(build(again)[name], build(study)[name])


def test_command(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save(small(), "study.yaml")
    assert main(["convert", "study.yaml", "pilot.csv"]) == 0
    assert Path("pilot.csv").read_text().splitlines()[0].startswith("0,0.0,50.0,0.0")
    assert Path("pilot.csv").read_text().splitlines()[-1] == "template 0: 9.0 m x 8.0 m"
    assert main(["convert", "pilot.csv", "plain.csv", "--to", "csv"]) == 0
    assert Path("plain.csv").read_text().splitlines()[0] == "x,y,z,width,height"
    assert capsys.readouterr().out == "pilot.csv\nplain.csv\n"
    assert main(["convert", "study.yaml", "pilot.csv"]) == 2
    assert main(["convert", "study.yaml", "pilot.csv", "--force"]) == 0
    assert main(["convert", "missing.csv", "other.csv"]) == 2
    assert "there is no such file" in capsys.readouterr().err

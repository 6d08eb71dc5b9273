"""Layouts of studies and files, written for SolarPILOT and back."""

from pathlib import Path

import numpy as np
import pytest

from heliosweep import StudyError, build, layout_of, read_layout, run, save, write_layout
from heliosweep.cli import main


def test_layout_of_a_result(small, tmp_path, capsys):
    rings = {"clearance": 13, "inner_radius": 50, "heliostats": [20, 40]}
    swept = small(layout={"radial_stagger": rings}, keep={"heliostats": [5, 9], "by": "optical_efficiency"})
    result = build(swept).compute()
    whole = build(small(layout={"radial_stagger": rings})).compute()
    with pytest.raises(StudyError, match=r"choose one value of heliostat_count \(heliostat_count: 20.0, 40.0\)"):
        layout_of(whole)
    assert len(layout_of(whole, {"heliostat_count": 20})) == 20
    chosen = {"latitude": 40, "tracking": "azimuth_elevation", "heliostat_count": "20", "kept_heliostats": 9}
    layout, here = layout_of(result, chosen), result.sel({**chosen, "heliostat_count": 20})
    kept = np.flatnonzero(here["kept"] == 1)
    assert layout.x.tolist() == here["x"][kept].values.tolist()
    assert set(layout.columns) == {"ring", "azimuth", "width", "height"}
    assert set(layout.columns["height"]) == {8.0}
    with pytest.raises(StudyError, match=r"select.kept_heliostats: is not in the result; choose from 5.0, 9.0"):
        layout_of(result, {**chosen, "kept_heliostats": 7})
    with pytest.raises(StudyError, match="has no heliostat field"):
        layout_of(result[["field_optical_efficiency"]])
    one = small(site={"latitude": 40}, tracking="azimuth_elevation", keep={"heliostats": 9, "by": "optical_efficiency"})
    folder, file = run(one, tmp_path / "run", report=False).folder, tmp_path / "kept.csv"
    assert main(["convert", str(folder), str(file)]) == 0
    assert len(read_layout(file)) == 9
    assert main(["convert", str(file), str(tmp_path / "again.csv"), "--select", "latitude=40"]) == 2
    assert "--select: requires a result folder" in capsys.readouterr().err


def test_command(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save(small(), "study.yaml")
    assert main(["convert", "study.yaml", "pilot.csv"]) == 0
    assert Path("pilot.csv").read_text().splitlines()[0].startswith("0,0.0,50.0,0.0")
    assert main(["convert", "pilot.csv", "plain.csv", "--to", "csv"]) == 0
    assert Path("plain.csv").read_text().splitlines()[0] == "x,y,z"
    assert capsys.readouterr().out == "pilot.csv\nplain.csv\n"
    assert main(["convert", "study.yaml", "pilot.csv"]) == 2
    assert main(["convert", "study.yaml", "pilot.csv", "--force"]) == 0
    with pytest.raises(StudyError, match="unknown form 'xml'"):
        write_layout(read_layout("pilot.csv"), "pilot.xml", "xml")  # type: ignore[arg-type]
    assert main(["convert", "missing.csv", "other.csv"]) == 2
    assert "there is no such file" in capsys.readouterr().err

"""Results as workbooks of Excel."""

import sys

import numpy as np
import pandas as pd
import pytest

import heliosweep
from heliosweep import HeliosweepError, build, run, write_xlsx
from heliosweep.cli import main

pytest.importorskip("openpyxl")


@pytest.fixture(scope="module")
def result(small):
    return build(small()).compute()


def test_a_sheet_for_each_group_of_variables_and_one_that_says_what_is_where(result, tmp_path):
    book = pd.read_excel(write_xlsx(result, tmp_path / "all.xlsx"), sheet_name=None)
    assert list(book) == ["contents", "latitude tracking heliostat", "latitude tracking"]
    contents = {str(line["name"]): line for line in book["contents"].to_dict("records")}
    assert (contents["receiver_height"]["value"], contents["receiver_height"]["unit"]) == (60, "m")
    assert contents["field_optical_efficiency"]["sheet"] == "latitude tracking"
    assert contents["optical_efficiency"]["meaning"] == result["optical_efficiency"].attrs["long_name"]
    assert {str(name) for name in result.data_vars} <= set(contents)
    field, name = book["latitude tracking"], "field_optical_efficiency"
    assert list(field.columns[:2]) == ["latitude [degrees_north]", "tracking"]
    np.testing.assert_array_equal(field[name], result[name].to_numpy().ravel())


def test_without_openpyxl_the_remedy_is_named(result, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(HeliosweepError, match="the package openpyxl is missing; run: pip install openpyxl"):
        write_xlsx(result, tmp_path / "r.xlsx")
    assert not list(tmp_path.iterdir())


def test_the_command_adds_the_tables_of_the_page_and_published_numbers(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "published.csv").write_text("quantity,published,unit,tolerance\nfield_cosine_efficiency,1,1,1\n")
    study = small(
        site={"latitude": 40},
        tracking="azimuth_elevation",
        design_point={"day": 80, "solar_hour": 12, "dni": 950},
        report={"published": {"file": "published.csv", "source": "Nobody (2026)"}},
    )
    heliosweep.save(study, "study.yaml")
    run("study.yaml")
    assert main(["export", "study.yaml", "-o", "r.xlsx"]) == 0
    assert capsys.readouterr().out == "r.xlsx\n"
    book = pd.read_excel("r.xlsx", sheet_name=None)
    assert "published numbers" in book
    tables = build(study).heliosweep.tables()
    assert len(book) > len(tables) > 0
    assert main(["export", "study.yaml", "-o", "r.txt"]) == 2

"""Sites from the headers of weather files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from heliosweep import StudyError
from heliosweep.api import load
from heliosweep.config.sites import site_table
from tests.conftest import SMALL

EPW_HEADER = "LOCATION,San Francisco Intl Ap,CA,USA,TMY3,724940,37.62,-122.40,-8.0,2.0"
TMY3_HEADER = '724666,"DENVER/CENTENNIAL [GOLDEN - NREL]",CO,-7.0,39.742,-105.179,1829'
CIVIL = {"clock": "civil", "dates": "2021-06-21", "window": {"start": "08:00", "stop": "16:00", "step": 2}}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Working directory with an EPW and a TMY3 file of a day."""
    monkeypatch.chdir(tmp_path)
    hours = [f"1999,6,21,{hour},0,?9,{', '.join(['1'] * 29)}" for hour in range(1, 25)]
    rest = ["DESIGN CONDITIONS,0", *["-"] * 5, "DATA PERIODS,1,1,Data,Sunday, 6/21, 6/21"]
    Path("sf.epw").write_text("\n".join([EPW_HEADER, *rest, *hours, ""]))
    rows = [f"06/21/1999,{hour:02}:00,1" for hour in range(1, 25)]
    Path("denver.csv").write_text("\n".join([TMY3_HEADER, "Date (MM/DD/YYYY),Time (HH:MM),ETR (W/m^2)", *rows, ""]))
    return tmp_path


def field(**blocks: Any) -> Any:
    content = {**SMALL, "time": CIVIL, "site": None, **blocks}
    return load({key: value for key, value in content.items() if value is not None})


def test_the_same_as_a_site_written_out(folder):
    study = field(site={"file": "sf.epw"})
    written = {"latitude": 37.62, "longitude": -122.4, "altitude": 2, "timezone": "-08:00"}
    assert study == field(site=written)
    assert study.study_id == field(site=written).study_id
    assert study.files() == {}


def test_what_pvlib_reads(folder):
    from pvlib import iotools

    epw, tmy3 = iotools.read_epw("sf.epw")[1], iotools.read_tmy3("denver.csv", map_variables=True)[1]
    sites = site_table(field(sites=[{"file": "sf.epw"}, {"file": "denver.csv"}]))
    for site, meta, name in zip(sites, (epw, tmy3), (epw["city"], tmy3["Name"].strip('"')), strict=True):
        assert (site.latitude, site.longitude, site.altitude) == (meta["latitude"], meta["longitude"], meta["altitude"])
        assert site.name == name
        assert site.timezone == f"{'-' if meta['TZ'] < 0 else '+'}{abs(meta['TZ']):02.0f}:00"


def test_forms(folder):
    mixed = field(
        sites=[{"file": "sf.epw", "name": "bay"}, {"name": "b", "latitude": 1, "longitude": 2, "timezone": "+00:00"}]
    )
    assert [site.name for site in site_table(mixed)] == ["bay", "b"]
    assert field(site={"file": "sf.epw", "timezone": "America/Los_Angeles"}).site.timezone == "America/Los_Angeles"
    earlier = field(sites={"file": ["sf.epw", "denver.csv"]})  # the form of version 0.1
    assert site_table(earlier) == site_table(field(sites=[{"file": "sf.epw"}, {"file": "denver.csv"}]))
    swept = field(site={"file": "sf.epw", "latitude": [30, 40]})
    np.testing.assert_array_equal(swept.sweeps()["site.latitude"].values(), [30, 40])


@pytest.mark.parametrize(
    ("hours", "offset"), [("5.75", "+05:45"), ("-3.5", "-03:30"), ("0", "+00:00"), ("14", "+14:00")]
)
def test_offsets(folder, hours, offset):
    Path("sf.epw").write_text(EPW_HEADER.replace("-8.0", hours))
    assert field(site={"file": "sf.epw"}).site.timezone == offset


@pytest.mark.parametrize(
    ("site", "said"),
    [
        ("site: {file: no.epw}", "study.yaml:2:14: site.file: no such file, relative to the study file"),
        (
            "site: {file: 3}",
            "study.yaml:2:14: site.file: must be the name of a weather file, such as EPW, TMY3 or PSM (got 3)",
        ),
        ("site: {file: bad.epw}", "bad.epw:1: field 7, the latitude, must be between -90 and 90 (got '97'); field 8"),
        ("site: {file: short.epw}", "short.epw:1: the header has 3 fields, and EPW files have 10"),
        ("site: {file: study.yaml}", "study.yaml:2:14: site.file: is not a weather file: EPW files begin"),
        ("sites: [{file: sf.epw}, {file: sf.epw}]", "another site has this name (got 'San Francisco Intl Ap')"),
        ("sites: [{file: sf.epw}, {file: no.epw}]", "study.yaml:2:32: sites[1].file: no such file"),
        ("sites: {file: no.csv}", "study.yaml:2:15: sites.file: no such file, relative to the study file"),
        ("site: {file: sf.epw, latitude: 99}", "study.yaml:2:32: site.latitude: must be between -90 and 90 deg"),
        ("site: {file: sf.epw, nothing: 99}", "study.yaml:2:22: site.nothing: unknown key"),
    ],
)
def test_located_errors(folder, site, said):
    Path("bad.epw").write_text(EPW_HEADER.replace("37.62", "97").replace("-122.40", "west"))
    Path("short.epw").write_text("LOCATION,a,b\n")
    content = {key: value for key, value in SMALL.items() if key not in ("site", "family")}
    Path("study.yaml").write_text(f"family: field_efficiency\n{site}\n{yaml.safe_dump({**content, 'time': CIVIL})}")
    with pytest.raises(StudyError) as caught:
        load("study.yaml")
    assert said in str(caught.value)
    assert caught.value.count == 1

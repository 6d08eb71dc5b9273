"""What must hold between weather files, places and limits, located in the study file."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from heliosweep import StudyError
from heliosweep.api import load
from tests import weather
from tests.conftest import SMALL

ONES = 400.0 * ((weather.HOURS >= 9) & (weather.HOURS < 16))  # with the sun up all year
REST = {key: value for key, value in SMALL.items() if key not in ("site", "time")}


@pytest.fixture
def checked(tmp_path, monkeypatch):
    """Load a study file of the given first lines, beside weather files of one place."""
    monkeypatch.chdir(tmp_path)
    Path("a.epw").write_text(weather.epw(ONES))
    Path("b.csv").write_text(weather.psm(ONES))
    Path("far.epw").write_text(weather.epw(ONES).replace("Town", "Far").replace("37.0", "38.0"))
    Path("calm.csv").write_text(weather.plain(ONES, 0.0))
    Path("dark.epw").write_text(weather.epw(0 * ONES))

    def read(*lines: str):
        Path("study.yaml").write_text("\n".join([*lines, yaml.safe_dump(REST)]))
        return load("study.yaml")

    return read


CLOCK, SITE = "time: {clock: weather}", "site: {latitude: 37.3, longitude: -2.5, altitude: 500, timezone: '+01:00'}"


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (
            (SITE, CLOCK, "weather: {file: far.epw}"),
            "study.yaml:3:17: weather.file: far.epw is of another place: latitude 38, longitude -2.5 deg, 78 km from "
            "the site at 37.3, -2.5 deg, and 50 km are allowed; give the file of the site, or take the site from the "
            "file: site: {file: ...}",
        ),
        (
            (SITE.replace("37.3", "[37.3, 37.2]"), CLOCK, "weather: {file: [a.epw, far.epw]}"),
            "study.yaml:3:17: weather.file: far.epw is of another place",
        ),
        (
            ("site: {latitude: 37.3}", CLOCK, "weather: {file: a.epw}"),
            "study.yaml:1:1: site.longitude: is missing: the civil clock needs the longitude, in deg east",
        ),
        (
            ("sites: {file: [a.epw, far.epw]}", CLOCK, "weather: {file: [a.epw]}"),
            "study.yaml:3:17: weather.file: names 1 files for 2 sites: give one for each, in their order",
        ),
        (
            ("sites: {file: [a.epw, far.epw]}", CLOCK, "weather: {file: [far.epw, a.epw]}"),
            "study.yaml:3:17: weather.file: far.epw is of another place",
        ),
        (
            (SITE, CLOCK, "weather: {file: calm.csv, label: start}", "limits: {wind_speed: 10}"),
            "study.yaml:4:22: limits.wind_speed: calm.csv has no wind speed; remove this limit",
        ),
        (
            (SITE, CLOCK, "weather: {file: a.epw}", "limits: {dni: 600}"),
            "study.yaml:4:9: limits: leave no instant at which the field works",
        ),
        (
            (SITE, CLOCK, "weather: {file: a.epw}", "limits: {sun_elevation: 80}"),
            "study.yaml:4:9: limits: leave no instant at which the field works",
        ),
        (
            (SITE, CLOCK, "weather: {file: dark.epw}"),
            "study.yaml:3:10: weather: leaves no instant with direct irradiance and the sun above the horizon",
        ),
        (
            (SITE, CLOCK, "weather: {file: calm.csv}"),
            "study.yaml:3:17: weather.file: calm.csv: does not state the meaning of its times: give weather.label",
        ),
        (
            (SITE, CLOCK, "weather: {file: study.yaml}"),
            "study.yaml:3:17: weather.file: study.yaml: is no weather file: EPW files begin with LOCATION",
        ),
    ],
)  # fmt: skip
def test_located(checked, lines, said):
    with pytest.raises(StudyError) as caught:
        checked(*lines)
    assert said in str(caught.value)


def test_what_is_right(checked):
    assert checked(SITE, CLOCK, "weather: {file: [a.epw, b.csv]}", "limits: {wind_speed: 10}").notes() == [
        "b.csv: columns that are not used: Cloud Type"
    ]
    checked("sites: {file: [a.epw, far.epw]}", CLOCK, "weather: {file: [a.epw, far.epw]}")
    checked("site: {file: b.csv}", CLOCK, "weather: {file: calm.csv, label: start}")  # a CSV file names no place
    some = checked(SITE, CLOCK, "weather: {file: a.epw}", "limits: {sun_elevation: [5, 80]}")
    assert some.notes() == ["at 1 of 2 points the limits leave no instant at which the field works"]


def test_irradiance_at_night_is_told(checked):
    """A wrong offset moves it there, and it would be missing without a word."""
    Path("moved.csv").write_text(weather.plain(ONES, 0.0, "-08:00"))
    (said,) = checked(SITE, CLOCK, "weather: {file: moved.csv, label: start}").notes()
    assert "of the irradiation in moved.csv comes with the sun below the horizon, and does not count" in said.replace(
        str(Path().absolute()) + "/", ""
    )


def test_irradiance_that_no_sky_has_is_told(checked):
    Path("bright.csv").write_text(weather.plain(3.25 * ONES, 0.0))
    (said,) = checked(SITE, CLOCK, "weather: {file: bright.csv, label: start}").notes()
    assert said == "the direct normal irradiance goes up to 1,300 W/m2; no sky over land is that clear"

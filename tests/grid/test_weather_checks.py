"""What must hold between weather files, places and limits, located in the study file."""

import gzip
import re
from collections.abc import Callable
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path

import pytest
import yaml

from heliosweep.api import load
from heliosweep.families.family import study_classes
from tests import bad_studies, weather
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


@pytest.mark.usefixtures("checked")
@pytest.mark.parametrize(("case", "good", "tables"), bad_studies.sections(Path(__file__).with_name("bad_weather.txt")))
def test_located(case, good, tables):
    bad_studies.check(case, good, study_classes())


def test_what_is_right(checked):
    assert checked(SITE, CLOCK, "weather: {file: [a.epw, b.csv]}", "limits: {wind_speed: 10}").notes() == [
        "b.csv: ignored columns: Cloud Type"
    ]
    checked("sites: [{file: a.epw}, {file: far.epw}]", CLOCK, "weather: {file: [a.epw, far.epw]}")
    checked("site: {file: b.csv}", CLOCK, "weather: {file: calm.csv, label: start}")  # a CSV file names no place
    some = checked(SITE, CLOCK, "weather: {file: a.epw}", "limits: {sun_elevation: [5, 80]}")
    assert some.notes() == ["at 1 of 2 points the limits leave no instant at which the field operates"]


def test_irradiance_at_night_is_told(checked):
    """A wrong offset moves it there, and it would be missing without a word."""
    Path("moved.csv").write_text(weather.plain(ONES, 0.0, "-08:00"))
    (said,) = checked(SITE, CLOCK, "weather: {file: moved.csv, label: start}").notes()
    assert "of the irradiation in moved.csv occurs with the sun below the horizon and is not used" in said.replace(
        str(Path().absolute()) + "/", ""
    )


def test_irradiance_that_no_sky_has_is_told(checked):
    Path("bright.csv").write_text(weather.plain(3.25 * ONES, 0.0))
    (said,) = checked(SITE, CLOCK, "weather: {file: bright.csv, label: start}").notes()
    assert said == "the direct normal irradiance reaches 1,300 W/m2, more than under any clear sky over land"


@cache
def real_rows() -> list[tuple[datetime, float, float, float]]:
    """Instants in universal time, GHI, DHI and DNI of NREL's NSRDB (a file of pvlib's tests, BSD-3)."""
    file = Path(__file__).parents[1] / "data" / "weather" / "psm4_full_disc_2023.csv.gz"
    rows = [line.split(",") for line in gzip.decompress(file.read_bytes()).decode().splitlines()[3:]]
    return [
        (datetime(*map(int, row[:5])) + timedelta(hours=7), float(row[7]), float(row[5]), float(row[6]))  # type: ignore[arg-type]
        for row in rows
    ]


def real(minutes: int = 0, dni: Callable[[float, float, float], float] = lambda ghi, dhi, dni: dni) -> str:
    """CSV file whose times are so many minutes after the instants."""
    rows = [
        f"{time + timedelta(minutes=minutes):%Y-%m-%dT%H:%M}Z,{ghi},{dhi},{dni(ghi, dhi, direct):.1f}"
        for time, ghi, dhi, direct in real_rows()
    ]
    return "\n".join(["time,ghi,dhi,dni", *rows, ""])


REAL_SITE = "site: {latitude: 40.51, longitude: -108.54, altitude: 2126, timezone: '-07:00'}"


@pytest.mark.parametrize(
    ("minutes", "said"),
    [
        (-60, "60 min later, .* give weather.offset: 1.00,"),
        (-30, "30 min later, .* give weather.label: start,"),
        (-10, "10 min later, .* give weather.offset: 0.17,"),
        (2, ""),
        (30, "30 min earlier, .* give weather.label: end,"),
        (60, "60 min earlier, .* give weather.offset: -1.00,"),
        (120, "with the times in the file: check the time zone and the site"),  # beyond the tested shifts
    ],
)
def test_closure_finds_the_shift_of_the_sun(checked, minutes, said):
    Path("real.csv").write_text(real(minutes))
    notes = checked(REAL_SITE, CLOCK, "weather: {file: real.csv, label: middle}").notes()
    assert bool(notes) == bool(said)
    assert not said or re.search(said, notes[-1])
    if "give" in said:
        assert "real.csv: GHI = DHI + DNI cos z holds within 0.1 % of GHI with the sun " in notes[-1]
        key, value = re.search(r"weather\.(\w+): ([-\w.]+),", notes[-1]).groups()  # type: ignore[union-attr]
        assert checked(REAL_SITE, CLOCK, f"weather: {{file: real.csv, {key}: {value}}}").notes() == []


def test_direct_irradiance_on_the_horizontal_plane_is_told(checked):
    Path("flat.csv").write_text(real(0, lambda ghi, dhi, dni: max(ghi - dhi, 0)))
    (said,) = checked(REAL_SITE, CLOCK, "weather: {file: flat.csv, label: middle}").notes()
    assert said == "flat.csv: GHI = DHI + DNI in nearly all rows: the column dni contains direct horizontal irradiance"
    Path("low.csv").write_text(real(0, lambda ghi, dhi, dni: dni / 4))
    notes = checked(REAL_SITE, CLOCK, "weather: {file: low.csv, label: middle}").notes()
    assert any(
        re.match(r"low.csv: the DNI never exceeds \d+ W/m2: check that the column does not contain horizontal", note)
        for note in notes
    )

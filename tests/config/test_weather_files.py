"""Rows of weather files, as pvlib reads them too, and what is said of wrong ones."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pvlib
import pytest

from heliosweep import StudyError
from heliosweep.config.weather_files import read_weather, weather_of
from heliosweep.files import write_whole
from tests import weather

DATA = Path(pvlib.__file__).parent / "data"
MEANS = np.round(500.0 + 400.0 * np.sin(np.arange(8760.0)), 1)


def starts(labels: pd.DatetimeIndex, minutes: int) -> np.ndarray:
    """Middle of intervals from labels of pvlib, in universal time."""
    return (labels.tz_convert("UTC").tz_localize(None) + pd.Timedelta(minutes=minutes)).to_numpy("datetime64[ns]")


def written(name: str, text: str) -> Path:
    write_whole(Path(name), text)
    return Path(name)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", ["703165TY.csv", "723170TYA.CSV"])
def test_tmy3_of_pvlib(name):
    file = read_weather(DATA / name)
    data, meta = pvlib.iotools.read_tmy3(DATA / name)
    np.testing.assert_array_equal(file.dni, data["dni"])
    np.testing.assert_array_equal(file.wind, data["wind_speed"])
    # pvlib moves the last hour of 28 February of a leap year to the next day.
    moved = file.utc != starts(data.index, -30)
    assert np.flatnonzero(moved).tolist() == ([1415] if name == "723170TYA.CSV" else [])
    np.testing.assert_array_equal(file.month, (data.index - pd.Timedelta(minutes=30)).month)
    assert (file.latitude, file.longitude, file.hours) == (meta["latitude"], meta["longitude"], 1.0)


def test_other_letters_and_missing_wind():
    text = weather.epw(MEANS, wind=999.0).replace("Town", "Zürich").replace("\n", "\r\n")
    Path("a.epw").write_bytes(text.encode("latin-1"))
    file = read_weather(Path("a.epw"))
    np.testing.assert_array_equal(file.dni, MEANS)
    assert np.isnan(file.wind).all()


@pytest.mark.parametrize(
    ("head", "form"),
    [
        ("time", "%Y%m%dT%H%M%S"),
        ("Fecha;Hora", "%d/%m/%Y;%-H"),
        ("Month;Day;Hour", "%m;%d;%H"),
        ("Date;Hour", "%Y-%m-%d;%H:00"),
    ],
)
def test_other_clocks(head, form):
    """Rows of January 2021, one hour east of universal time, with decimal commas."""
    hours = pd.date_range("2021-01-01", periods=744, freq="h")
    rows = (f"{hour:{form}};{mean:.1f}".replace(".", ",") for hour, mean in zip(hours, MEANS, strict=False))
    file = read_weather(written("a.csv", "\n".join([f"{head};DNI", *rows])), label="start", timezone="+01:00")
    np.testing.assert_array_equal(file.utc, (hours - pd.Timedelta(minutes=30)).to_numpy("datetime64[ns]"))
    np.testing.assert_array_equal(file.dni, MEANS[:744])
    assert file.notes == (("has no year: 2021 is assumed",) if head == "Month;Day;Hour" else ())


def test_hourly_files_of_pvgis_with_two_axes():
    """The beam on a plane that follows the sun is the DNI."""
    hours = pd.date_range("2021-01-01T00:10", periods=744, freq="h")
    rows = [
        {"time": f"{hour:%Y%m%d:%H%M}", "Gb(i)": mean, "Gd(i)": 0.0, "Int": 0.0}
        for hour, mean in zip(hours, MEANS.tolist(), strict=False)
    ]
    axes = {"two_axis": {"slope": {"value": "-"}}}
    inputs = {"location": {"latitude": 37.1, "longitude": -2.36, "elevation": 500}, "mounting_system": axes}
    file = read_weather(written("a.json", json.dumps({"inputs": inputs, "outputs": {"hourly": rows}})))
    np.testing.assert_array_equal(file.utc, hours.to_numpy("datetime64[ns]"))
    np.testing.assert_array_equal(file.dni, MEANS[:744])


def test_parts_of_hours():
    file = read_weather(written("a.csv", weather.psm(MEANS, minutes=(0, 30))))
    assert (file.hours, file.utc[0]) == (0.5, np.datetime64("2020-12-31T23:00"))  # the time marks the middle
    file = read_weather(written("a.epw", weather.epw(MEANS, minutes=(15, 30, 45, 60))))
    assert (file.hours, file.utc[0]) == (0.25, np.datetime64("2020-12-31T23:07:30"))


def test_leap_years():
    leap = np.zeros(8784)
    file = read_weather(written("a.csv", weather.plain(leap, 0.0, year=2020)), "start")
    assert np.sum(file.month == 2) == 29 * 24
    lines = weather.epw(MEANS).splitlines()
    day = [line.replace("2021,2,28,", "2020,2,29,") for line in lines if line.startswith("2021,2,28,")]
    place = next(number for number, line in enumerate(lines) if line.startswith("2021,3,1,"))
    file = read_weather(written("a.epw", "\n".join(lines[:place] + day + lines[place:])))
    assert file.utc.size == 8784
    # A leap year without its day, as typical years have it: 28 February is followed by 1 March.
    file = read_weather(written("b.epw", weather.epw(MEANS, (2020,) * 12)))
    assert np.unique(np.diff(file.utc)[: 24 * 90]).tolist() == [3600 * 10**9, 25 * 3600 * 10**9]


LINES = weather.tmy3(MEANS).splitlines()


def put(number: int, text: str) -> Callable[[list[str]], None]:
    """Replace a line, counted from 1."""
    return lambda lines: lines.__setitem__(number - 1, text)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda lines: lines.pop(99), "a.csv:100: comes after a gap: 1 rows of 60 minutes are missing before it"),
        (lambda lines: lines.insert(99, lines[99]), "a.csv:101: repeats the time of the previous row: remove one"),
        (lambda lines: lines.insert(99, lines[50]), "a.csv:100: is earlier than the previous row"),
        (lambda lines: lines.pop(), "a.csv: has 8,759 rows of 60 minutes, but a whole year has 8,760"),
        (lambda lines: lines.pop(2), "a.csv: has 8,759 rows of 60 minutes, but a whole year has 8,760"),
        (put(9, "01/01/2021,07:30,1,1"), "a.csv:9: is 90 minutes after the previous row, not 60"),
        (put(9, "01/01/2021,07:00,-11,1"), "a.csv:9:18: dni must be between 0 and 1412 W/m2; fill missing"),
        (put(9, "01/01/2021,07:00,nan,1"), "a.csv:9:18: dni must be a finite number (got 'nan')"),
        (put(9, "01/01/2021,07:00,,1"), "a.csv:9:18: dni is empty"),
        (put(9, "01/01/2021,07:00,1"), "a.csv:9: has 3 fields, but the header has 4"),
        (put(9, "02/29/2021,07:00,1,1"), "a.csv:9:12: time must be a time such as 2021-06-21T12:00+01:00 (got '02/29/"),
        (put(9, "01/01/1021,07:00,1,1"), "a.csv:9:12: time must be in the years 1700 to 2200"),
        (put(2, LINES[1].replace("DNI", "GHI")), "a.csv:2: needs a column dni: direct normal"),
        (put(1, LINES[0].replace("37.0", "north")), "a.csv:1: field 5, the latitude, must be between -90 and 90"),
        (lambda lines: lines.__delitem__(slice(2, None)), "a.csv: has a header but no hours: add one row for each"),
        (lambda lines: lines.__delitem__(slice(3, None)), "a.csv: needs at least two rows"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_located(change, said):
    lines = LINES[: None if "year" in said else 200]
    change(lines)
    with pytest.raises(StudyError) as caught:
        read_weather(written("a.csv", "\n".join(lines)))
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "a.csv: is empty: it needs a row for each interval"),
        ("family: field_efficiency\n", "a.csv: is not a weather file: EPW files begin with LOCATION"),
        ("LOCATION,a,b\n", "a.csv:1: the header has 3 fields, and EPW files have 10"),
        (weather.psm(MEANS).replace(",Time Zone", ",Zone", 1), "a.csv:1: the header has no field 'Time Zone'"),
        (weather.psm(MEANS).replace("2021,1,31,", "2021,2,31,"), "a.csv:724:8: day 31 does not exist in month 2 of"),
        (weather.epw(MEANS).replace("2021,1,1,3,60", "2021,1,1,30,60"), "a.csv:11:10: hour must be between 0 and 24"),
        (weather.epw(MEANS)[:-100] + "\n", "a.csv:8767: has 28 fields, but the header has 35"),
        ("time,wind_speed\n", "a.csv:1: needs a column dni: direct normal irradiance, in W/m2"),
        (weather.plain(MEANS, 0), "a.csv: does not define which part of an interval its times mark: set weather.label"),
        (weather.plain(MEANS, 0, ""), "a.csv:2:1: time needs an offset from universal time, as in 2021-06-21"),
        ("time,dni\n2021-06-21T12:00Z,5\n2021-06-21T18:00Z,5\n", "a.csv: does not define which part of an interval"),
    ],
)  # fmt: skip
def test_no_weather_file(text, said):
    with pytest.raises(StudyError) as caught:
        read_weather(written("a.csv", text))
    assert said in str(caught.value)


def test_a_pipe_and_a_folder_are_refused():
    os.mkfifo("pipe")
    Path("folder").mkdir()
    for name, said in (("pipe", "is not a regular file"), ("folder", "is a folder")):
        with pytest.raises(StudyError, match=said):
            read_weather(Path(name))


def test_of_a_study(small):
    """Contents count for its identity, names do not; a changed file is read again."""
    blocks = {"site": {"file": "a.epw"}, "weather": {"file": "a.epw"}, "time": {"clock": "weather"}}
    written("a.epw", weather.epw(MEANS))
    written("b.epw", weather.epw(MEANS))
    first = small(**blocks)
    assert first.study_id == small(**{**blocks, "weather": {"file": "b.epw"}}).study_id
    assert weather_of(first)[0].dni[0] == MEANS[0]
    summer = weather_of(small(**{**blocks, "time": {"clock": "weather", "months": [6, 7]}}))[0]
    assert len(summer) == 61 * 24
    before = first.study_id
    written("a.epw", weather.epw(MEANS + 1))
    assert small(**blocks).study_id != before
    assert weather_of(first)[0].dni[0] == MEANS[0] + 1

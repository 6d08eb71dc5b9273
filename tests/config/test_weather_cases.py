"""Weather files as users have them, with yearly energies that pvlib's SPA and a closed formula give.

Two mirrors of 25 m2 at (0, 150) and (150, 0) m, pivots at 3 m, aim at 50 m, elevation of the sun at least 10 deg: the
sum over the rows of DNI x 25 m2 x sqrt((1 + r.s)/2) x hours. The expected energies [MWh] were computed without
heliosweep. Data: three years of a clear sky made for these tests (``made_dni.csv.gz``), and rows of two real files of
the tests of pvlib (BSD-3), ``test_psm4_full_disc_2023.csv`` and ``tmy_45.000_8.000_2005_2023.csv``.
"""

import gzip
import json
from collections.abc import Callable
from datetime import datetime, timedelta
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pvlib
import pytest

from heliosweep import StudyError
from heliosweep.config.weather_files import WeatherFile, read_weather
from heliosweep.files import write_whole
from tests.weather import epw, psm, tmy3

DATA = Path(__file__).parents[1] / "data" / "weather"
ALMERIA, PHOENIX, DELHI = (37.1, -2.36), (33.45, -111.98), (28.6, 77.2)
SPANISH, INDIAN, ARIZONAN = (63.645891, 53.931194), (64.834306, 56.297841), (64.414609, 55.272567)
HOURS = [datetime(2019, 1, 1) + timedelta(hours=hour) for hour in range(8760)]


@cache
def text_of(name: str) -> str:
    return gzip.decompress((DATA / name).read_bytes()).decode()


@cache
def dni_of(place: str) -> list[str]:
    lines = [line.split(",") for line in text_of("made_dni.csv.gz").splitlines()]
    return [line[lines[0].index(place)] for line in lines[1:]]


@cache
def to_sun(utc: bytes, place: tuple[float, float]) -> np.ndarray:
    """Unit vectors towards the sun by pvlib, east, north and up."""
    times = pd.DatetimeIndex(np.frombuffer(utc, "datetime64[ns]"), tz="UTC")
    sun = pvlib.solarposition.spa_python(times, *place, delta_t=None)
    elevation, azimuth = np.radians(sun["elevation"].to_numpy()), np.radians(sun["azimuth"].to_numpy())
    return np.stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], axis=1
    )


def energies(file: WeatherFile, place: tuple[float, float]) -> list[float]:
    """Energy on the receiver of both mirrors, independent of heliosweep. [MWh]"""
    sun, found = to_sun(file.utc.tobytes(), place), []
    for mirror in ((0.0, 150.0, 3.0), (150.0, 0.0, 3.0)):
        to_aim = np.array([0.0, 0.0, 50.0]) - mirror
        cosine = np.sqrt((1 + sun @ to_aim / np.linalg.norm(to_aim)) / 2)
        found.append(float(np.sum((file.dni * cosine * 25 * file.hours)[sun[:, 2] >= np.sin(np.radians(10))]) / 1e6))
    return found


def of_year(kind: Callable[..., str], place: str = "almeria", where: str = "37.1,-2.36", **options: Any) -> str:
    """File of the made DNI of a place in 2019, by a writer of `tests.weather`."""
    return kind(np.array(dni_of(place), float), (2019,) * 12, place=where, **options)


def table(head: str, row: Callable[[datetime, str], str], hours: int = 8760) -> str:
    return "\n".join([head, *map(row, HOURS[:hours], dni_of("almeria")), ""])


def is_january(file: WeatherFile) -> bool:
    """Compare instants and DNI of hours from the start of 2019 on, one hour east of universal time."""
    instants = np.datetime64("2018-12-31T23:30") + np.arange(len(file)) * np.timedelta64(1, "h")
    dni = np.array(dni_of("almeria")[: len(file)], float)
    return np.array_equal(file.utc, instants) and np.array_equal(file.dni, dni)


def solargis(time: datetime, dni: str) -> str:
    return f"{time:%d.%m.%Y};{time.hour:02}:30;0;{dni};0;20.5"


def american(time: datetime, dni: str) -> str:
    return f"{time.month}/{time.day}/{time.year} {time:%I:%M %p},{dni}"


def measured(time: datetime, dni: str) -> str:
    return f"{time:%Y-%m-%dT%H:%M}+01:00,{dni if float(dni) else '-0.4'}"


def pvgis_rows() -> list[list[str]]:
    lines = text_of("pvgis_tmy_45_8.csv.gz").splitlines()
    return [line.split(",") for line in lines if line[:8].isdecimal()]


def pvgis_epw(_: object = None) -> str:
    """PVGIS counts hours 1 to 24 of UTC and states a zone of 1 h."""
    head = ["LOCATION,unknown,-,unknown,ECMWF/ERA,unknown,45.0,8.0,1,250", *["-"] * 5]
    head += ["COMMENTS 2,Irradiance Time Offset (h):-0.8239", "DATA PERIODS,1,1,Data,Thursday, 1/ 1,12/31"]
    rows = [
        f"{time[:4]},{time[4:6]},{time[6:8]},{int(time[9:11]) + 1},0,B,{'1,' * 7}{ghi},{dni},{dhi},{'1,' * 5}{wind},1,1"
        for time, ghi, dni, dhi, wind in pvgis_rows()
    ]
    return "\n".join([*head, *rows, ""])


def pvgis_json() -> str:
    titles = ("time(UTC)", "G(h)", "Gb(n)", "Gd(h)", "WS10m")
    rows = [dict(zip(titles, [row[0], *map(float, row[1:])], strict=True)) for row in pvgis_rows()]
    location = {"latitude": 45.0, "longitude": 8.0, "elevation": 250.0, "irradiance_time_offset": 0.1761}
    return json.dumps({"inputs": {"location": location}, "outputs": {"tmy_hourly": rows}, "meta": {}})


def own_typical_year() -> str:
    rows = [f"{row[0][:4]}-{row[0][4:6]}-{row[0][6:8]}T{row[0][9:11]}:10Z,{float(row[2]):g}" for row in pvgis_rows()]
    return "\n".join(["time,dni", *rows, ""])


def nasa(standard: str, hours: int = 8760) -> str:
    head = f"""-BEGIN HEADER-
NASA/POWER CERES/MERRA2 Native Resolution Hourly Data
Dates (month/day/year): 01/01/2019 through 12/31/2019 in {standard}
Location: Latitude  37.1   Longitude -2.36
Value for missing model data cannot be computed or out of model availability range: -999
-END HEADER-
YEAR,MO,DY,HR,ALLSKY_SFC_SW_DNI,WS10M"""
    return table(head, lambda time, dni: f"{time.year},{time.month},{time.day},{time.hour},{dni},3")


def cams() -> str:
    head = """# Coding: utf-8
# Title: CAMS Radiation Service v3.2 all-sky irradiation (derived from satellite data).
# Latitude (positive North, ISO 19115): 37.1
# Longitude (positive East, ISO 19115): -2.36
# Altitude (m): 500.00
# Time reference: Universal time (UT)
# Summarization (integration) period: 0 year 0 month 0 day 1 h 0 min 0 s
# Observation period;TOA;Clear sky BNI;BNI;Reliability"""

    def row(time: datetime, dni: str) -> str:
        start = time - timedelta(hours=1)
        return f"{start:%Y-%m-%dT%H:%M:%S.0}/{time:%Y-%m-%dT%H:%M:%S.0};1;1;{dni};1.0"

    return table(head, row)


#: Files of the made DNI of Almeria and their options.
HERE: dict[str, tuple[Callable[[], str], dict[str, Any]]] = {
    "PSM names": (partial(of_year, psm, where="37.1,-2.36,1", city='"Almeria, PSA"'), {}),
    "EPW": (partial(of_year, epw), {}),
    "EPW names": (partial(of_year, epw, city='"Almeria, PSA"'), {}),
    "EPW hours 0 to 23": (partial(of_year, epw, hour=0), {}),
    "EPW hours 0 to 23, label": (partial(of_year, epw, hour=0), {"label": "start"}),
    "TMY3 names": (partial(of_year, tmy3, city="ALMERIA, PSA"), {}),
    "TMY3 offset": (partial(of_year, tmy3), {"offset": -0.5}),
    "NASA POWER": (lambda: nasa("UTC"), {"timezone": "+01:00"}),
    "CAMS": (cams, {}),
}
#: Heads of tables, a row of each, and their options.
TABLES: dict[str, tuple[str, Callable[[datetime, str], str], dict[str, Any]]] = {
    "night offset": ("time,dni", measured, {"label": "start"}),
    "Solargis": ("#SOLARGIS\n#Latitude: 37.1\n#Time zone: UTC+1\nDate;Time;GHI;DNI;DIF;TEMP", solargis, {}),
    "date and time": ("Date;Time;GHI;DNI;DIF;TEMP", solargis, {"label": "middle", "timezone": "+01:00"}),
    "Excel, USA": ("Date/Time,DNI [W/m^2]", american, {"label": "start", "timezone": "Etc/GMT-1"}),
    "five columns": ("Year,Month,Day,Hour,Minute,DNI", lambda time, dni: f"{time:%Y,%m,%d,%H},30,{dni}",
                     {"label": "middle", "timezone": "+01:00"}),
    "row of units": ("timestamp (UTC+1);dni;note\n-;W per m2;", lambda time, dni: f"{time:%Y-%m-%d %H:%M};{dni};a",
                     {"label": "start"}),
    "kW/m2": ("time;DNI (kW/m2)", lambda time, dni: f"{time:%Y-%m-%d %H:%M}+01:00;{float(dni) / 1000!r}",
              {"label": "start"}),
    "SAM without minutes": ("Latitude,Longitude,Time Zone,Elevation\n37.1,-2.36,1,500\nYear,Month,Day,Hour,Beam,Wspd",
                            lambda time, dni: f"{time:%Y,%m,%d,%H},{dni},2", {}),
    "logger": ('"TOA5","PSA, Almeria","CR1000"\n"TIMESTAMP","RECORD","DNI_Avg"\n"TS","RN","W/m^2"\n"","","Avg"',
               lambda time, dni: f'"{time + timedelta(hours=1):%Y-%m-%d %H:%M:%S}",1,{dni}',
               {"label": "end", "timezone": "+01:00"}),
    "pandas": (",dni", lambda time, dni: f"{time:%Y-%m-%d %H:%M:%S}+01:00,{dni}", {"label": "start"}),
    "end of the period": ("PeriodEnd,PeriodStart,Dni", lambda time, dni: f"{time:%Y-%m-%dT%H:%M}Z,-,{dni}", {}),
    "date and hour": ("Datum;Hour;DNI",
                      lambda time, dni: f"{time:%d.%m.%Y};{time.hour + 1};{dni.replace('.', ',')}",
                      {"label": "end", "timezone": "+01:00"}),
    "day of the year": ("Year;Day;Time;DNI", lambda time, dni: f"2019;{time.timetuple().tm_yday};{time:%H:30};{dni}",
                        {"label": "middle", "timezone": "+01:00"}),
}  # fmt: skip
PVGIS = (45.0, 8.0)
MADE: dict[str, tuple[Callable[[], str], dict[str, Any], tuple[float, float], tuple[float, float]]] = {
    **{name: (*made, ALMERIA, SPANISH) for name, made in HERE.items()},
    **{name: (partial(table, head, row), given, ALMERIA, SPANISH) for name, (head, row, given) in TABLES.items()},
    "PSM 3 padded": (partial(of_year, psm, "delhi", "28.6,77.2,5.5", padding=",,,,,"), {}, DELHI, INDIAN),
    "PSM minute 0": (partial(of_year, psm, "phoenix", "33.45,-111.98,-7", minutes=[0]), {}, PHOENIX, ARIZONAN),
    "PVGIS EPW": (pvgis_epw, {}, PVGIS, (33.603347, 28.115348)),
    "PVGIS CSV": (lambda: text_of("pvgis_tmy_45_8.csv.gz"), {}, PVGIS, (33.603347, 28.115348)),
    "PVGIS JSON": (pvgis_json, {}, PVGIS, (33.603347, 28.115348)),
    "typical year": (own_typical_year, {"label": "middle"}, PVGIS, (33.595150, 28.087646)),
    "PSM 4 full disc": (lambda: text_of("psm4_full_disc_2023.csv.gz"), {}, (40.51, -108.54), (47.878192, 39.233645)),
}


@pytest.mark.parametrize("name", MADE)
def test_energies_of_a_year(name, tmp_path):
    written, options, place, expected = MADE[name]
    write_whole(tmp_path / "a.csv", written())
    file = read_weather(tmp_path / "a.csv", **options)
    assert energies(file, place) == pytest.approx(expected, abs=2e-6)
    if np.isfinite(file.latitude) and np.isfinite(file.longitude):
        assert (file.latitude, file.longitude) == place


def read_of(text: str, **options: Any) -> WeatherFile:
    write_whole(Path("a.csv"), text)
    return read_weather(Path("a.csv"), **options)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_notes():
    assert read_of(table("time,dni", measured, 1000), label="start").notes == (
        f"DNI slightly below 0 in {dni_of('almeria')[:1000].count('0')} rows (minimum -0.4 W/m2) is set to 0",
    )
    assert "has hours 0 to 23" in read_of(of_year(epw, hour=0)).notes[0]
    rows = table("time,dni,ghi,relay", lambda time, dni: f"{time:%Y-%m-%dT%H:%M}Z,{dni},1,x", 48)
    assert read_of(rows, label="start").notes == ("ignored columns: relay",)


@pytest.mark.parametrize(("hour", "minutes"), [(1, (30, 60)), (1, (0, 30)), (0, (30, 60)), (0, (0, 30))])
def test_half_hours_of_epw(hour, minutes):
    """Two rows an hour of one year, with the hours and minutes that programs write."""
    file = read_of(of_year(epw, hour=hour, minutes=minutes), timezone="+00:00")
    assert file.hours == 0.5
    found = (file.utc[:2] - np.datetime64("2019-01-01T00:00")) / np.timedelta64(1, "m")
    assert tuple(found) == (15, 45)


def test_sam_csv_with_hours_1_to_24():
    """The mean of 0 to 1 h has hour 1; hours of SAM CSV are 0 to 23, without a minute they are intervals."""
    head = "Latitude,Longitude,Time Zone,Elevation\n37.1,-2.36,1,500\nYear,Month,Day,Hour,Beam"
    file = read_of(table(head, lambda time, dni: f"{time:%Y,%m,%d},{time.hour + 1},{dni}"))
    assert energies(file, ALMERIA) == pytest.approx(SPANISH, abs=2e-6)
    assert "has hours 1 to 24" in file.notes[0]


@pytest.mark.parametrize(("part", "minutes"), [("start", 0), ("beginning", 0), ("center", 30), ("end", 60)])
def test_solargis_states_the_part_of_the_interval(part, minutes):
    head = f"#SOLARGIS\n#Time reference: UTC+1, time stamp in {part} of the interval, 60 min\nDate;Time;DNI"

    def row(time: datetime, dni: str) -> str:
        return f"{time + timedelta(minutes=minutes):%d.%m.%Y;%H:%M};{dni}"

    assert is_january(read_of(table(head, row, 744)))


@pytest.mark.parametrize(("unit", "factor"), [("Wh/m2", 1.0), ("kWh/m2", 1e-3), ("MJ/m2", 3.6e-3)])
@pytest.mark.parametrize("parts", [1, 4])
def test_energies_of_intervals(unit, factor, parts):
    """1 W/m2 over an hour is 1 Wh/m2 or 3.6 kJ/m2; a quarter of an hour has a quarter of it."""
    step = timedelta(hours=1) / parts
    rows = [
        f"{time + part * step:%Y-%m-%d %H:%M},{float(dni) * factor / parts!r}"
        for time, dni in zip(HOURS[:744], dni_of("almeria"), strict=False) for part in range(parts)
    ]  # fmt: skip
    file = read_of("\n".join([f"time,dni ({unit})", *rows]), label="start", timezone="+01:00")
    assert file.dni[::parts] == pytest.approx(np.array(dni_of("almeria")[:744], float), rel=1e-12, abs=1e-12)


def test_missing_values_are_one_message_with_their_number():
    bad = table("time,dni", measured, 1000).replace(",-0.4", ",-999")
    with pytest.raises(StudyError) as caught:
        read_of(bad, label="start")
    assert str(caught.value) == (
        "a.csv:2:24: dni must be between 0 and 1412 W/m2; fill missing values (got '-999'), and also in 547 more rows"
    )
    assert caught.value.count == 1
    with pytest.raises(StudyError, match="dni is -9, which marks a missing value: fill in the value"):
        read_of(table("#Solargis\n#Time zone: UTC+1\nDate;Time;DNI", lambda t, d: f"{t:%d.%m.%Y};{t:%H:30};-9", 48))


def test_both_clock_changes():
    """Wall times of Madrid: an hour is missing in March, and one occurs twice in October."""
    times = pd.date_range("2018-12-31T23:00", periods=8760, freq="h", tz="UTC").tz_convert("Europe/Madrid")
    rows = [f"{time:%Y-%m-%d %H:%M},{dni}" for time, dni in zip(times, dni_of("almeria"), strict=True)]
    file = read_of("\n".join(["time,dni", *rows]), label="start", timezone="Europe/Madrid")
    assert energies(file, ALMERIA) == pytest.approx(SPANISH, abs=2e-6)
    standard = table("time,dni", lambda time, dni: f"{time:%Y-%m-%d %H:%M},{dni}")
    with pytest.raises(StudyError, match=r"repeats the time .* the clocks of Europe/Madrid change here"):
        read_of(standard, label="start", timezone="Europe/Madrid")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,ghi,dni\n01/02/2024 08:00,1,1\n01/02/2024 09:00,1,1\n", "a.csv:2:1: time must be .* specify the order"),
        ("time,Gb(i)\n20240101:0010,1\n20240101:0110,1\n", "a.csv:1: needs a column dni"),
        ("Radiation database: PVGIS-SARAH\ntime,Gb(i)\n20240101:0010,1\n", "has no DNI: PVGIS provides the DNI as Gb"),
        ("hour,dni\n1,1\n2,1\n", "needs a column time, or date and time, or year, month, day and hour"),
        ("# Time reference: True solar time (TST)\ntime,dni\n2024-01-01,1\n", "true solar time: download the file in"),
        ('{"a": 1}', "is not a PVGIS or NASA POWER JSON file"),
    ],
)
def test_refused(text, said):
    with pytest.raises(StudyError, match=said):
        read_of(text, label="middle", timezone="+00:00")

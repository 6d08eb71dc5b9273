"""Dates and numbers of spreadsheets: read where one thing is meant, refused where it could be two."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heliosweep.config.tables import iso_dates, with_points
from heliosweep.config.weather_files import read_weather
from heliosweep.errors import StudyError
from heliosweep.families.misalignment.spots_file import read_spots


@pytest.mark.parametrize(
    ("form", "text", "iso"),
    [
        ("DD/MM/YYYY hh:mm", "21/06/2024 9:30", "2024-06-21T09:30:00"),
        ("MM/DD/YYYY", "6/21/2024", "2024-06-21T00:00:00"),
        ("DD.MM.YYYY hh:mm:ss, +01:00", "1.2.2024 23:59:58", "2024-02-01T23:59:58+01:00"),
        ("dd-mm-yyyy hh:mm UTC", "01-02-2024 00:05", "2024-02-01T00:05:00Z"),
        ("YYYY/MM/DD hh:mm Z", "2024/2/1 00:05", "2024-02-01T00:05:00Z"),
        ("DD/MM/YYYY hh:mm", "2024-06-21T09:30+02:00", "2024-06-21T09:30+02:00"),
        ("", "21/06/2024 9:30", "2024-06-21T09:30:00"),  # 21 is no month
        ("", "6/21/2024 9:30 PM", "2024-06-21T21:30:00"),
        ("", "6/21/2024 12:05 AM", "2024-06-21T00:05:00"),
        ("", "5.6.2024 9:30", "2024-06-05T09:30:00"),  # dots: the day first
        ("", "5/6/2024 9:30", "5/6/2024 9:30"),  # 5 June or 6 May
        ("", "21/06/24 9:30", "21/06/24 9:30"),
        ("m", "2024/6/5", "2024-06-05T00:00:00"),
        ("DD/DD/YYYY", "5/6/2024", "5/6/2024"),
        ("", "20240621:0930", "2024-06-21T09:30"),  # PVGIS
        ("", "2024062109", "2024-06-21T09:00"),  # NASA POWER
        ("", "noon", "noon"),
    ],
)
def test_dates_become_iso(form, text, iso):
    assert iso_dates([text], form) == [iso]


def test_the_order_of_a_column_is_that_of_its_unambiguous_dates():
    assert iso_dates(["1/2/2024", "13/2/2024"]) == ["2024-02-01T00:00:00", "2024-02-13T00:00:00"]
    assert iso_dates(["1/2/2024", "2/13/2024"]) == ["2024-01-02T00:00:00", "2024-02-13T00:00:00"]


@given(st.lists(st.floats(-1e6, 1e6, allow_nan=False).filter(lambda value: value % 1), min_size=1))
def test_decimal_commas_between_semicolons_are_what_points_are(values):
    rows, problem = with_points([[repr(value).replace(".", ","), "A, 1"] for value in values], ";")
    assert problem is None
    assert [float(number) for number, _ in rows] == values
    assert all(text == "A, 1" for _, text in rows)


def test_numbers_that_could_be_two_are_refused():
    assert with_points([["1,234"]], ";") == ([["1.234"]], None)
    assert with_points([["0,234", "1,234"]], "\t") == ([["0.234", "1.234"]], None)
    for rows, separator in (([["1,234"]], "\t"), ([["1,5", "2.5"]], ";"), ([["1,5", "2.5"]], "\t")):
        _, problem = with_points(rows, separator)
        assert problem


def test_weather_and_spots_of_a_spreadsheet(tmp_path: Path):
    weather, spots = tmp_path / "dni.csv", tmp_path / "spots.csv"
    rows = "".join(f"21/06/2024 {hour}:00;{hour}00,5;{hour},25\n" for hour in (8, 9, 10))
    weather.write_text(f"Time (DD/MM/YYYY hh:mm);DNI (W/m2);Wind Speed (m/s)\n{rows}")
    read = read_weather(weather, "start", "+02:00")
    assert read.dni.tolist() == [800.5, 900.5, 1000.5]
    assert read.wind.tolist() == [8.25, 9.25, 10.25]
    assert read.utc[0] == np.datetime64("2024-06-21T06:30")
    spots.write_text("Heliostat;Time (DD/MM/YYYY hh:mm, +02:00);y (m);z (m)\n0;21/06/2024 9:30;0,25;-1,5\n")
    found = read_spots(spots, 1)
    assert found.utc[0] == np.datetime64("2024-06-21T07:30")
    assert found.position.tolist() == [[0.25, -1.5]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "heliostat,time,y,z\n0,05/06/2024 9:30,0,0\n",
            "spots.csv:2:3: time must be .* specify the order in the column title",
        ),
        (
            "heliostat,time (DD/MM/YYYY hh:mm Z),y,z\n0,06/21/2024 9:30,0,0\n",
            "spots.csv:2:3: time must be an ISO 8601 time",
        ),
        ("heliostat,time (DD/MM/YYYY hh:mm Z),y,z\n0,21/06/24 9:30,0,0\n", "the year with four digits"),
        ("heliostat,time (DD/MM/YYYY hh:mm),y,z\n0,21/06/2024 9:30,0,0\n", "needs an offset from UTC"),
        ("heliostat,time,y (mm),z\n0,2024-06-21T09:30Z,0,0\n", "spots.csv:1:16: is in 'mm'; y must be in m"),
    ],
)
def test_dates_and_units_that_are_not_told_are_refused_at_their_place(tmp_path, monkeypatch, text, said):
    monkeypatch.chdir(tmp_path)
    Path("spots.csv").write_text(text)
    with pytest.raises(StudyError, match=said):
        read_spots(Path("spots.csv"), 1)

"""Irradiance and sun at the instants of a study: weather files, clear skies and limits."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pvlib
import pytest
from scipy.optimize import brentq

from heliosweep.config.times import CivilTime, SolarTime
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import PLACE, Suns, civil_instants, civil_intervals, instants_of, solar_instants, sun_vectors
from heliosweep.grid.weather import LIMITS, Irradiance, Weathers, clear_sky, used
from tests import weather

ON_ITS_CLOCK = {"time": {"clock": "weather"}}
PLACE_OF_FILES = (weather.LATITUDE, weather.LONGITUDE, 500.0)
ONES = np.ones(8760)


def elevation(times: pd.DatetimeIndex) -> np.ndarray:
    """Elevation of the sun by pvlib, without refraction, with terrestrial time of each month. [deg]"""
    latitude, longitude, altitude = PLACE_OF_FILES
    found = pvlib.solarposition.get_solarposition(
        times, latitude, longitude, altitude, method="nrel_numpy", delta_t=None
    )
    return found["elevation"].to_numpy()


def day_of(month: int, day: int) -> slice:
    start = 24 * int((np.datetime64(f"2021-{month:02}-{day:02}") - np.datetime64("2021-01-01")).astype(int))
    return slice(start, start + 24)


def clear_minutes(longitude: float = weather.LONGITUDE) -> tuple[np.ndarray, np.ndarray]:
    """Irradiance of a clear sky in every minute of 2021 in local time, and the sun then."""
    start = np.datetime64("2020-12-31T23:00:30", "ns")
    utc = start + np.arange(525_600) * np.timedelta64(60, "s")
    sun = sun_vectors(utc, weather.LATITUDE, longitude, 500.0)
    return clear_sky(utc, sun, (weather.LATITUDE, longitude, 500.0), "meinel"), sun


def only(study: Any) -> tuple[np.ndarray, Irradiance]:
    """Sun and irradiance of a study of one point."""
    parameters = Parameters(study)
    suns, weathers = Suns(parameters), Weathers(parameters)
    ((index, place),) = parameters.points(*PLACE)
    return suns.at(index, place), weathers.at(index, place)


@pytest.fixture
def of_file(small, tmp_path, monkeypatch):
    """Sun and irradiance of a weather file at a place."""
    monkeypatch.chdir(tmp_path)

    def read(text: str, longitude: float = weather.LONGITUDE, **more: Any) -> tuple[np.ndarray, Irradiance]:
        Path("weather.csv").write_text(text)
        site = {"latitude": weather.LATITUDE, "longitude": longitude, "altitude": 500, "timezone": "+01:00"}
        single = {"site": site, "tracking": "azimuth_elevation", "weather": {"file": "weather.csv", **more}}
        return only(small(**ON_ITS_CLOCK, **single))

    return read


def symmetry(sun: np.ndarray, irradiance: Irradiance, hours: slice) -> float:
    """Energy on a plane that faces east over that on one that faces west, less 1."""
    power = irradiance.dni * irradiance.hours
    east, west = (np.sum((power * np.maximum(side * sun[:, 0], 0.0))[hours]) for side in (1, -1))
    return float(east / west - 1)


@pytest.mark.parametrize("kind", [weather.epw, weather.tmy3, weather.psm])
def test_a_clear_day_is_symmetric_about_solar_noon(kind, of_file):
    """At the solstice, at a longitude at which solar noon is at 12:00 of the clock: 15 deg less 1.85 min a deg."""
    equation = float(pvlib.solarposition.equation_of_time_spencer71(172))  # [min]
    longitude = 15.0 * weather.ZONE - equation / 4
    dni = clear_minutes(longitude)[0].reshape(-1, 60).mean(axis=1)
    text = kind(dni).replace(f"{weather.LONGITUDE}", f"{longitude:.4f}")
    sun, irradiance = of_file(text, longitude)
    np.testing.assert_array_equal(irradiance.dni, dni)
    assert abs(symmetry(sun, irradiance, day_of(6, 21))) < 1e-5
    shifted = Irradiance(np.roll(dni, 1), *irradiance[1:])
    assert abs(symmetry(sun, shifted, day_of(6, 21))) > 0.3  # an hour is seen


def test_sun_at_the_middle_of_the_lit_part(of_file):
    """Against pvlib's own sun position, and sunrise and sunset found with it by another method."""
    sun, _ = of_file(weather.epw(ONES))
    ends = pd.date_range("2021-01-01 00:00", periods=8761, freq="h", tz="+01:00")
    heights = elevation(ends)
    lit = np.flatnonzero((heights[:-1] > 0) & (heights[1:] > 0))
    dark = np.flatnonzero((heights[:-1] <= 0) & (heights[1:] <= 0))
    shown = np.degrees(np.arcsin(sun[:, 2]))
    np.testing.assert_allclose(shown[lit], elevation(ends[lit] + pd.Timedelta(minutes=30)), atol=1e-6)
    assert np.all(shown[dark] <= 0)
    edges = np.flatnonzero((heights[:-1] > 0) != (heights[1:] > 0))
    assert edges.size == 730
    for hour in edges[::150].tolist():
        start = ends[hour]
        crossing = brentq(
            lambda s, start=start: elevation(pd.DatetimeIndex([start + pd.Timedelta(seconds=s)]))[0], 0, 3600
        )
        low, high = (crossing, 3600.0) if heights[hour] <= 0 else (0.0, crossing)
        middle = pd.DatetimeIndex([start + pd.Timedelta(seconds=(low + high) / 2)])
        np.testing.assert_allclose(shown[hour], elevation(middle)[0], atol=1e-5)


@pytest.fixture
def several(small, tmp_path, monkeypatch):
    """Study on the clock of weather files of several sites and years."""
    monkeypatch.chdir(tmp_path)
    Path("a.epw").write_text(weather.epw(ONES))
    Path("b.csv").write_text(weather.tmy3(2 * ONES, (2020,) * 12))
    for year, hours in ((2019, 8760), (2020, 8784)):
        Path(f"{year}.csv").write_text(weather.plain(np.full(hours, float(year - 2000)), 0.0, year=year))
    return partial(small, **ON_ITS_CLOCK, tracking="azimuth_elevation", site={"file": "a.epw"})


YEARS = {"file": ["2019.csv", "2020.csv"], "label": "start"}


def test_files_of_sites_in_their_order_or_one_for_all(several):
    names = {"file": ["a.epw", "b.csv"]}
    sites = [{"file": name} for name in names["file"]]
    study = several(site=None, sites=sites, weather=names)
    assert [dim.name for dim in study.dimensions()] == ["site"]
    parameters = Parameters(study)
    labels = parameters.coordinates()
    assert labels["weather"].dims == ("site",)
    assert labels["weather"].values.tolist() == ["a.epw", "b.csv"]
    weathers = Weathers(parameters)
    assert [weathers.at(index, place).dni[0] for index, place in parameters.points(*PLACE)] == [1, 2]
    assert instants_of(parameters).labels["utc"].dims == ("site", "time")
    parameters = Parameters(several(site=None, sites=sites, weather={"file": "a.epw"}))
    weathers = Weathers(parameters)
    assert {weathers.at(index, place).dni[0] for index, place in parameters.points(*PLACE)} == {1.0}
    assert instants_of(parameters).coordinates()["time"].values.size == 8760


def test_files_of_years(several):
    """A shorter year is padded; parts of the swept dimensions and of the time have the values of the whole."""
    study = several(weather=YEARS, limits={"dni": [5, 19.5]})
    parameters = Parameters(study)
    assert parameters.sizes == {"weather": 2, "dni_limit": 2}
    suns, weathers = Suns(parameters), Weathers(parameters)
    assert suns.size == 8784
    found = {}
    for index, (*place, dni, sun_elevation, wind_speed) in parameters.points(*PLACE, *LIMITS):
        sun, irradiance = suns.at(index, place), weathers.at(index, place)
        found[index] = used(irradiance, sun, (dni, sun_elevation, wind_speed))
        hours = 8760 + 24 * index[0]
        assert np.all(irradiance.dni[:hours] == 19 + index[0])
        assert np.all(irradiance.hours == (np.arange(8784) < hours))
        assert np.isnan(sun[hours:]).all()
        assert np.isfinite(sun[:hours]).all()
    assert not found[0, 1][0].any()
    np.testing.assert_array_equal(found[1, 0][0], found[1, 1][0])
    part = Parameters(study, {"weather": slice(1, 2), "time": slice(5000, 5100)})
    _, where = next(iter(part.points(*PLACE)))
    np.testing.assert_array_equal(suns.at((1, 0), where)[5000:5100], Suns(part).at((0, 0), where))
    for every, some in zip(weathers.at((1, 0), where), Weathers(part).at((0, 0), where), strict=True):
        np.testing.assert_array_equal(every[5000:5100], some)


CIVIL = {
    "clock": "civil", "dates": {"start": "2021-01-05", "stop": "2021-12-31", "step": 30}, "sampling": "midpoint",
    "window": {"start": "00:00", "stop": "24:00", "step": 0.5},
}  # fmt: skip
SITE = {"latitude": 37.1, "longitude": -2.36, "altitude": 500, "timezone": "Europe/Madrid"}


@pytest.mark.filterwarnings("ignore:DatetimeIndex.dayofyear")
@pytest.mark.parametrize("model", ["ineichen", "simplified_solis"])
def test_clear_sky_as_pvlib(model, small):
    study = small(site=SITE, time=CIVIL, weather={"clear_sky": {"model": model}}, tracking="azimuth_elevation")
    sun, irradiance = only(study)
    times = pd.DatetimeIndex(instants_of(Parameters(study)).labels["utc"].values, tz="UTC")
    place = pvlib.location.Location(37.1, -2.36, altitude=500)
    expected = place.get_clearsky(
        times, model=model, solar_position=place.get_solarposition(times, method="nrel_numpy")
    )
    up = sun[:, 2] > 0
    np.testing.assert_allclose(irradiance.dni[up], expected["dni"][up], atol=0.02)
    assert np.all(irradiance.dni[~up] == 0)
    assert np.all(irradiance.hours == 0.5)
    np.testing.assert_array_equal(irradiance.month, times.tz_convert("Europe/Madrid").month)


def test_meinel_and_ashrae():
    """By hand: with the sun at the zenith at the sea the air mass is 1; A and B of the table on 21 June."""
    zenith, utc = np.array([[0.0, 0.0, 1.0]]), np.array(["2021-06-21T12:00"], "datetime64[ns]")
    place = (23.4, 0.0, 0.0)
    np.testing.assert_allclose(clear_sky(utc, zenith, place, "meinel"), 1367 * 0.7, rtol=1e-3)
    np.testing.assert_allclose(clear_sky(utc, zenith, place, "ashrae"), 1088 * np.exp(-0.205), rtol=1e-12)
    half = np.array([[0.0, np.sqrt(0.75), 0.5]])
    np.testing.assert_allclose(clear_sky(utc, half, place, "ashrae"), 1088 * np.exp(-0.205 / 0.5), rtol=1e-3)
    between = np.array(["2021-07-06T12:00"], "datetime64[ns]")
    np.testing.assert_allclose(clear_sky(between, zenith, place, "ashrae"), 1086.5 * np.exp(-0.206), rtol=1e-4)


@pytest.mark.parametrize(("sampling", "step"), [("inclusive", 1), ("left", 1), ("midpoint", 2), ("inclusive", 0.25)])
def test_hours_of_civil_windows(sampling, step):
    window = {"start": "04:00", "stop": "20:00", "step": step}
    time = CivilTime.model_validate({**CIVIL, "dates": ["2021-02-28", "2021-03-01"], "window": window,
                                     "sampling": sampling})  # fmt: skip
    found, month = civil_intervals(time, "+01:00")
    assert np.bincount(month, found)[2:].tolist() == [16, 16]
    assert found.size == civil_instants(time, ["+01:00"]).size


def test_hours_of_a_shared_midnight_and_of_summer_time():
    dates, window = {"start": "2021-03-27", "stop": "2021-03-29"}, {"start": "00:00", "stop": "24:00", "step": 1}
    time = CivilTime.model_validate({"clock": "civil", "dates": dates, "window": window})
    found, _ = civil_intervals(time, "Europe/Madrid")
    assert found.size == civil_instants(time, ["Europe/Madrid"]).size == 72
    assert found.sum() == 71  # hours of these days
    assert found[0] == found[-1] == 0.5


def test_used():
    sun = np.zeros((6, 3))
    sun[:, 2] = np.sin(np.radians([-1, 30, 30, 2, 30, 2]))
    dni, wind = np.array([900.0, 100, 900, 900, 900, 100]), np.array([0.0, 1, np.nan, 1, 20, 20])
    irradiance = Irradiance(dni, np.ones(6), np.ones(6, int), wind)
    works, cause = used(irradiance, sun, (200, 5, 15))
    assert works.tolist() == [False, False, True, False, False, False]
    assert cause.tolist() == [-1, 0, -1, 1, 2, 0]
    assert used(irradiance, sun, (None, None, None))[0].tolist() == [False, True, True, True, True, True]
    assert used(irradiance, sun, (100, 2 - 1e-9, 20))[0].tolist() == [False, True, True, True, True, True]


DAY = {"start": "00:00", "stop": "24:00", "step": "1 h"}


def civil(
    dates: object, window: dict = DAY, sampling: str = "left", zones: tuple[str, ...] = ("+08:00",)
) -> np.ndarray:
    time = CivilTime.model_validate({"clock": "civil", "dates": dates, "window": window, "sampling": sampling})
    return civil_instants(time, list(zones)).labels["utc"].values


def test_solar_instants_run_day_by_day():
    time = SolarTime.model_validate(
        {"clock": "solar", "days": [80, 81], "hours": {"start": 8, "stop": 16, "step": 4}, "sampling": "inclusive"}
    )
    labels = solar_instants(time).labels
    assert labels["day"].values.tolist() == [80, 80, 80, 81, 81, 81]
    assert labels["solar_hour"].values.tolist() == [8, 12, 16, 8, 12, 16]


@pytest.mark.parametrize(
    ("sampling", "expected"),
    [
        ("left", ["2020-12-31T23:00", "2020-12-31T23:30"]),
        ("midpoint", ["2020-12-31T23:15", "2020-12-31T23:45"]),
        ("inclusive", ["2020-12-31T23:00", "2020-12-31T23:30", "2021-01-01T00:00"]),
    ],
)
def test_samplings_of_a_window_across_the_new_year_in_utc(sampling, expected):
    window = {"start": "07:00", "stop": "08:00", "step": "30 min"}
    np.testing.assert_array_equal(civil(["2021-01-01"], window, sampling), np.array(expected, dtype="datetime64[ns]"))


def test_sites_with_other_clocks_have_their_own_instants():
    table = civil(["2021-03-28"], zones=("Europe/Berlin", "Asia/Shanghai"))
    assert table.shape == (2, 24)
    assert np.isnat(table).sum(axis=1).tolist() == [1, 0]
    assert civil(["2021-03-28"], zones=("+08:00", "Asia/Shanghai")).shape == (24,)

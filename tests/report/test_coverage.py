"""What a page says of dates, hours, heliostats and the sun."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from heliosweep import api
from heliosweep.grid.sun import sun_vectors
from heliosweep.report.coverage import coverage
from heliosweep.report.inputs import inputs
from heliosweep.report.tables import summary
from tests.weather import plain

FIELD = {
    "family": "field_efficiency",
    "site": {"latitude": [0, 30]},
    "tracking": "azimuth_elevation",
    "layout": {"radial_stagger": {"clearance": 16, "zones": [{"start": 61.3, "rings": 1, "pitch": 15}]}},
    "heliostat": {"width": 1, "height": 1, "pivot_height": 7},
    "receiver": {"height": 95},
}
HOURS = {"start": 8, "stop": 16, "step": 0.5}


def said(**changes):
    study = api.load({**FIELD, **changes})
    return dict(coverage(api.build(study), study))


@pytest.mark.parametrize(("sampling", "hours"), [("inclusive", "8 to 16 h on the solar clock, 17"),
                                                 ("left", "8 to 15.5 h on the solar clock, 16"),
                                                 ("midpoint", "8.25 to 15.75 h on the solar clock, 16")])  # fmt: skip
def test_solar_clock(sampling, hours):
    found = said(time={"clock": "solar", "days": [80, 172], "hours": HOURS, "sampling": sampling})
    assert found["dates"] == "days of the year 80, 172"
    assert found["hours"] == f"{hours} instants a day, sampling {sampling}"
    assert found["heliostats"] == "24"


def test_solar_elevation_at_noon_of_an_equinox_is_that_of_the_latitude():
    found = said(time={"clock": "solar", "declination": [0], "hours": [12]})
    assert found["dates"] == "declination of the sun (\N{DEGREE SIGN}) 0"
    assert (
        found["mean elevation of the sun"]
        == "60.0\N{DEGREE SIGN} to 90.0\N{DEGREE SIGN}, while it is above the horizon"
    )


@pytest.mark.parametrize(("count", "text"), [(2, "place 0, place 1"), (9, "9, place 0 to place 8")])
def test_sites_by_their_names(count, text):
    sites = [{"name": f"place {number}", "latitude": 5 * number} for number in range(count)]
    time = {"clock": "solar", "days": [80], "hours": [12]}
    field = {key: value for key, value in FIELD.items() if key != "site"}
    study = api.load({**field, "sites": sites, "time": time})
    result = api.build(study)
    assert coverage(result, study)[0] == ("sites", text)
    table = inputs(study, [])
    assert table is not None
    names, _, _, keys = (column.values for column in table.columns)
    assert names[keys.index("sites[1].latitude")] == "latitude, place 1"
    assert f"; best of {count} points, at place " in list(summary(result, ["field_optical_efficiency"]))[-1]


@pytest.mark.parametrize(("sampling", "count"), [("inclusive", 25), ("left", 24), ("midpoint", 24)])
def test_civil_clock_against_the_sun_at_each_instant(sampling, count):
    window = {"start": "00:00", "stop": "12:00", "step": "30 min"}
    time = {"clock": "civil", "timezone": "+01:00", "dates": {"start": "2021-06-01", "stop": "2021-06-29", "step": 7},
            "window": window, "sampling": sampling}  # fmt: skip
    found = said(site={"latitude": 50, "longitude": 10}, time=time)
    assert found["dates"] == "2021-06-01 to 2021-06-29, every 7 days: 5 dates"
    assert found["hours"] == f"00:00 to 12:00 (+01:00), every 30 min, {count} instants a day, sampling {sampling}"
    half = np.arange(count) * 30 + 15 * (sampling == "midpoint") - 60
    days = np.array("2021-06-01", "datetime64[m]") + np.arange(5)[:, None] * np.timedelta64(7, "D")
    up = sun_vectors((days + half.astype("timedelta64[m]")).ravel(), 50.0, 10.0)[:, 2]
    mean = np.degrees(np.arcsin(up[up > 0])).mean()
    assert found["mean elevation of the sun"] == f"{mean:.1f}\N{DEGREE SIGN}, while it is above the horizon"


def test_clock_of_a_weather_file(tmp_path):
    path = tmp_path / "weather.csv"
    path.write_text(plain(np.ones(48), 0.0), encoding="utf-8")
    blocks = {"weather": {"file": path, "label": "start"}, "site": {"latitude": 37, "longitude": -2}}
    found = said(**blocks, time={"clock": "weather", "months": [1, 2]})
    assert found["months"] == "1, 2"
    assert found["hours"] == "those of the weather file, the sun at the middle of each lit part"


def test_a_place_where_the_sun_never_rises_is_left_out():
    found = said(site={"latitude": [0, 89]}, time={"clock": "solar", "declination": [-10], "hours": [12]})
    assert found["mean elevation of the sun"] == "80.0\N{DEGREE SIGN}, while it is above the horizon"


def test_a_result_without_its_study():
    result = xr.Dataset(coords={"sun_elevation": 60.0, "heliostat": range(3)})
    assert coverage(result, None) == [
        ("heliostats", "3"), ("mean elevation of the sun", "60.0\N{DEGREE SIGN}"),
    ]  # fmt: skip

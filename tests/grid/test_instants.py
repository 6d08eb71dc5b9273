"""Instants on both clocks: sampling, time zones, daylight-saving changes, the new year."""

from __future__ import annotations

import numpy as np
import pytest

from heliosweep.config.times import CivilTime, SolarTime
from heliosweep.grid.sun import civil_instants, solar_instants


def civil(dates: object, window: dict, sampling: str = "left", zones: tuple[str, ...] = ("+08:00",)) -> np.ndarray:
    time = CivilTime.model_validate({"clock": "civil", "dates": dates, "window": window, "sampling": sampling})
    return civil_instants(time, list(zones)).labels["utc"].values


def utc(*texts: str) -> np.ndarray:
    return np.array(texts, dtype="datetime64[ns]")


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
    np.testing.assert_array_equal(civil(["2021-01-01"], window, sampling), utc(*expected))


def test_daylight_saving_changes_shorten_and_lengthen_the_day():
    window = {"start": "00:00", "stop": "24:00", "step": "1 h"}
    days = {
        date: civil([date], window, zones=("Europe/Berlin",)) for date in ("2021-03-28", "2021-06-01", "2021-10-31")
    }
    assert [instants.size for instants in days.values()] == [23, 24, 25]
    for instants in days.values():
        assert set(np.diff(instants)) == {np.timedelta64(1, "h")}


def test_a_window_that_opens_in_the_hour_left_out_opens_with_the_change():
    window = {"start": "02:30", "stop": "03:30", "step": "10 min"}
    instants = civil(["2021-03-14"], window, "left", zones=("America/New_York",))
    np.testing.assert_array_equal(instants, utc("2021-03-14T07:00", "2021-03-14T07:10", "2021-03-14T07:20"))


def test_a_date_that_a_clock_left_out_has_no_window():
    window = {"start": "07:00", "stop": "21:00", "step": "1 h"}
    assert civil(["2011-12-30"], window, zones=("Pacific/Apia",)).size == 0


def test_the_hour_that_occurs_twice_is_taken_first():
    window = {"start": "02:30", "stop": "04:00", "step": "30 min"}
    instants = civil(["2021-10-31"], window, zones=("Europe/Berlin",))
    assert instants[0] == np.datetime64("2021-10-31T00:30")
    assert instants.size == 5  # 02:30 summer time to 04:00 winter time


def test_leap_day():
    window = {"start": "12:00", "stop": "13:00", "step": "1 h"}
    instants = civil({"start": "2024-02-28", "stop": "2024-03-01"}, window, zones=("+00:00",))
    assert instants.size == 3
    assert instants[1] == np.datetime64("2024-02-29T12:00")


def test_sites_with_other_clocks_have_their_own_instants():
    window = {"start": "00:00", "stop": "24:00", "step": "1 h"}
    table = civil(["2021-03-28"], window, zones=("Europe/Berlin", "Asia/Shanghai"))
    assert table.shape == (2, 24)
    assert np.isnat(table[0]).sum() == 1
    assert not np.isnat(table[1]).any()
    shared = civil(["2021-03-28"], window, zones=("+08:00", "Asia/Shanghai"))
    assert shared.shape == (24,)

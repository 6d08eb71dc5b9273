"""Instants on both clocks: sampling, time zones, daylight-saving changes, the new year."""

from __future__ import annotations

import numpy as np
import pytest

from heliosweep.config.times import CivilTime, SolarTime
from heliosweep.grid.sun import civil_instants, solar_instants

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


def test_daylight_saving_changes_shorten_and_lengthen_the_day():
    dates = ("2021-03-28", "2021-06-01", "2021-10-31")
    days = [civil([date], zones=("Europe/Berlin",)) for date in dates]
    assert [instants.size for instants in days] == [23, 24, 25]
    assert all(set(np.diff(instants)) == {np.timedelta64(1, "h")} for instants in days)


def test_sites_with_other_clocks_have_their_own_instants():
    table = civil(["2021-03-28"], zones=("Europe/Berlin", "Asia/Shanghai"))
    assert table.shape == (2, 24)
    assert np.isnat(table).sum(axis=1).tolist() == [1, 0]
    assert civil(["2021-03-28"], zones=("+08:00", "Asia/Shanghai")).shape == (24,)

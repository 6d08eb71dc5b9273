"""The time block on both clocks."""

from __future__ import annotations

import datetime as dt
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from heliosweep.config.times import CivilTime, SolarTime, Time

time_block: TypeAdapter[SolarTime | CivilTime] = TypeAdapter(Time)


def solar(**keys: Any) -> SolarTime:
    time = time_block.validate_python({"clock": "solar", "hours": {"start": 8, "stop": 16, "step": 0.2}} | keys)
    assert isinstance(time, SolarTime)
    return time


def civil(**keys: Any) -> CivilTime:
    window = {"start": "07:00", "stop": "21:00", "step": "30 min"}
    time = time_block.validate_python({"clock": "civil", "dates": "2021-06-21", "window": window} | keys)
    assert isinstance(time, CivilTime)
    return time


def test_defaults() -> None:
    time = solar()
    assert time.sampling == "inclusive"
    assert time.day_numbers().tolist() == list(range(1, 366))
    assert time.declinations() is None
    assert time.solar_hours().size == 41
    assert time.count() == 365 * 41


def test_sampling() -> None:
    left, midpoint = solar(sampling="left"), solar(sampling="midpoint")
    assert left.solar_hours()[[0, -1]].tolist() == [8.0, 15.8]
    assert midpoint.solar_hours()[[0, -1]].tolist() == [8.1, 15.9]
    assert left.count() == midpoint.count() == 365 * 40 == 365 * midpoint.solar_hours().size


def test_declination_instead_of_days() -> None:
    time = solar(declination=[-23.45, "0.1 rad"])
    assert time.declinations() == pytest.approx([-23.45, np.degrees(0.1)], rel=1e-15)
    assert time.day_numbers().size == 0
    assert time.count() == 2 * 41


def test_civil() -> None:
    time = civil(timezone="+08:00", sampling="left")
    assert time.date_list() == [dt.date(2021, 6, 21)]
    assert time.window_seconds() == (7 * 3600, 21 * 3600, 1800)
    assert civil(window={"start": "0:00", "stop": "24:00", "step": 1}).window_seconds() == (0, 86400, 3600)
    assert civil(timezone="Asia/Shanghai").timezone == "Asia/Shanghai"


def test_dates() -> None:
    year = civil(dates={"start": "2020-01-01", "stop": "2020-12-31"})
    assert len(year.date_list()) == 366
    week = civil(dates={"start": "2021-02-22", "stop": "2021-03-10", "step": "7 d"})
    assert week.date_list() == [dt.date(2021, 2, 22), dt.date(2021, 3, 1), dt.date(2021, 3, 8)]
    assert civil(dates=["2021-06-21", "2021-12-21"]).date_list()[1] == dt.date(2021, 12, 21)

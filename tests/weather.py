"""Weather files of a year, made for tests."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date, timedelta

import numpy as np

#: Day of each hour of a year of 365 days, and the hour that it begins with.
DAYS = np.repeat(np.arange(365), 24)
HOURS = np.tile(np.arange(24), 365)

LATITUDE, LONGITUDE, ZONE = 37.0, -2.5, 1


def dates(years: Sequence[int]) -> list[date]:
    """Date of each hour of a typical year, whose months are of these years."""
    common = [date(2021, 1, 1) + timedelta(int(day)) for day in DAYS]
    return [day.replace(year=years[day.month - 1]) for day in common]


def epw(dni: np.ndarray, years: Sequence[int] = (2021,) * 12, wind: float = 3.0) -> str:
    """EPW file of hourly means."""
    head = [f"LOCATION,Town,-,ESP,test,1,{LATITUDE},{LONGITUDE},{ZONE}.0,500", "DESIGN CONDITIONS,0", *["-"] * 5]
    head.append("DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31")
    rows = [
        f"{day.year},{day.month},{day.day},{hour + 1},60,?9,{'1,' * 8}{value!r},1,1,1,1,1,0,{wind},{','.join('1' * 13)}"
        for day, hour, value in zip(dates(years), HOURS, dni.tolist(), strict=True)
    ]
    return "\n".join([*head, *rows, ""])


def tmy3(dni: np.ndarray, years: Sequence[int] = (2021,) * 12, wind: float = 3.0) -> str:
    """TMY3 file of hourly means."""
    head = [f'1,"TOWN",ES,{ZONE}.0,{LATITUDE},{LONGITUDE},500']
    head.append("Date (MM/DD/YYYY),Time (HH:MM),DNI (W/m^2),Wspd (m/s)")
    rows = [
        f"{day:%m/%d/%Y},{hour + 1:02}:00,{value!r},{wind}"
        for day, hour, value in zip(dates(years), HOURS, dni.tolist(), strict=True)
    ]
    return "\n".join([*head, *rows, ""])


def psm(dni: np.ndarray, years: Sequence[int] = (2021,) * 12, wind: float = 3.0, minute: int = 30) -> str:
    """PSM file of hourly means."""
    head = [
        "Source,Location ID,City,State,Country,Latitude,Longitude,Time Zone,Elevation,Local Time Zone,DNI Units",
        f"NSRDB,77,-,-,-,{LATITUDE},{LONGITUDE},{ZONE},500,{ZONE},w/m2",
        "Year,Month,Day,Hour,Minute,DNI,Wind Speed,Cloud Type",
    ]
    rows = [
        f"{day.year},{day.month},{day.day},{hour},{minute},{value!r},{wind},0"
        for day, hour, value in zip(dates(years), HOURS, dni.tolist(), strict=True)
    ]
    return "\n".join([*head, *rows, ""])


def plain(dni: np.ndarray, late: float, offset: str = "+01:00", year: int = 2021) -> str:
    """CSV file of hourly means, whose times are so many hours after the start of each."""
    start = np.datetime64(f"{year}-01-01T00:00") + np.timedelta64(round(60 * late), "m")
    times = start + np.arange(dni.size) * np.timedelta64(1, "h")
    rows = [f"{time}{offset},{value!r}" for time, value in zip(times, dni.tolist(), strict=True)]
    return "\n".join(["time,dni", *rows, ""])

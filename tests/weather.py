"""Weather files of a year, made for tests."""

from collections.abc import Sequence
from datetime import date, timedelta
from pathlib import Path

import numpy as np

#: Day of each hour of a year of 365 days, and the hour that it begins with.
DAYS = np.repeat(np.arange(365), 24)
HOURS = np.tile(np.arange(24), 365)

LATITUDE, LONGITUDE, ZONE = 37.0, -2.5, 1


def dates(years: Sequence[int]) -> list[date]:
    """Date of each hour of a typical year, whose months are of these years."""
    common = [date(2021, 1, 1) + timedelta(int(day)) for day in DAYS]
    return [day.replace(year=years[day.month - 1]) for day in common]


def epw(
    dni: np.ndarray,
    years: Sequence[int] = (2021,) * 12,
    wind: float = 3.0,
    hour: int = 1,
    minutes: Sequence[int] = (60,),
    city: str = "Town",
    place: str = f"{LATITUDE},{LONGITUDE}",
) -> str:
    """EPW file of hourly means, whose days begin with an hour; with several minutes a row for each."""
    head = [f"LOCATION,{city},-,ESP,test,1,{place},{ZONE}.0,500", "DESIGN CONDITIONS,0", *["-"] * 5]
    head.append("DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31")
    rows = [
        f"{day.year},{day.month},{day.day},{start + hour},{minute},?9,{'1,' * 8}{value!r},1,1,1,1,1,0,{wind},"
        f"{','.join('1' * 13)}"
        for day, start, value in zip(dates(years), HOURS, dni.tolist(), strict=True)
        for minute in minutes
    ]
    return "\n".join([*head, *rows, ""])  # fmt: skip


def tmy3(
    dni: np.ndarray,
    years: Sequence[int] = (2021,) * 12,
    wind: float = 3.0,
    city: str = "TOWN",
    place: str = f"{LATITUDE},{LONGITUDE}",
) -> str:
    """TMY3 file of hourly means."""
    head = [f'1,"{city}",ES,{ZONE}.0,{place},500', "Date (MM/DD/YYYY),Time (HH:MM),DNI (W/m^2),Wspd (m/s)"]
    rows = [
        f"{day:%m/%d/%Y},{hour + 1:02}:00,{value!r},{wind}"
        for day, hour, value in zip(dates(years), HOURS, dni.tolist(), strict=True)
    ]
    return "\n".join([*head, *rows, ""])  # fmt: skip


def psm(
    dni: np.ndarray,
    years: Sequence[int] = (2021,) * 12,
    wind: float = 3.0,
    minutes: Sequence[int] = (30,),
    city: str = "-",
    place: str = f"{LATITUDE},{LONGITUDE},{ZONE}",
    padding: str = "",
) -> str:
    """PSM file of hourly means; with several minutes a row for each."""
    head = [
        "Source,Location ID,City,State,Country,Latitude,Longitude,Time Zone,Elevation,Local Time Zone,DNI Units",
        f"NSRDB,77,{city},-,-,{place},500,{ZONE},w/m2",
        f"Year,Month,Day,Hour,Minute,DNI,Wind Speed,Cloud Type{padding}",
    ]
    rows = [
        f"{day.year},{day.month},{day.day},{hour},{minute},{value!r},{wind},0{padding}"
        for day, hour, value in zip(dates(years), HOURS, dni.tolist(), strict=True)
        for minute in minutes
    ]
    return "\n".join([*head, *rows, ""])  # fmt: skip


def plain(dni: np.ndarray, late: float, offset: str = "+01:00", year: int = 2021) -> str:
    """CSV file of hourly means, whose times are so many hours after the start of each."""
    start = np.datetime64(f"{year}-01-01T00:00") + np.timedelta64(round(60 * late), "m")
    times = start + np.arange(dni.size) * np.timedelta64(1, "h")
    rows = [f"{time}{offset},{value!r}" for time, value in zip(times, dni.tolist(), strict=True)]
    return "\n".join(["time,dni", *rows, ""])


def write_sam_year(path: Path, sunrise: int, sunset: int) -> Path:
    """Write a year of clear days in the form of SAM, with 900 W/m2 from sunrise to sunset."""
    lines = ["Latitude,Longitude,Time Zone,Elevation", "35,-116.8,-8,500"]
    lines.append("Year,Month,Day,Hour,Minute,DNI,DHI,GHI,Tdry,Tdew,RH,Pres,Wspd,Wdir,Albedo")
    for day in dates((2001,) * 12)[::24]:
        for hour in range(24):
            beam = 900 if sunrise <= hour < sunset else 0
            start = f"{day.year},{day.month},{day.day},{hour},30"
            lines.append(f"{start},{beam},{beam // 9},{beam * 8 // 9},20,5,30,950,1,0,0.2")
    path.write_text("\n".join([*lines, ""]))
    return path

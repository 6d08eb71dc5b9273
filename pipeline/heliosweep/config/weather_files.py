"""The rows of weather files: means of direct normal irradiance (DNI) and wind speed over intervals of time.

The time of a row marks another part of its interval in each kind of file:

- EPW: the hour that ends at the hour given, 1 to 24 (EnergyPlus, Auxiliary Programs). pvlib labels it with its start.
- TMY3: the hour before the time given (Wilcox and Marion 2008, NREL/TP-581-43156). pvlib labels it with its end.
- PSM of NREL's NSRDB, 3 or 4: the middle. Hourly rows stand for the hour in which their time is: half past since 2019,
  the full hour before (pvlib-python, issue 733).
- CSV: what the study says.

Read by the reader of all tables, which tells line and column of what is wrong, and not by `pvlib.iotools`, which gives
the same for files that are right.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from heliosweep.config import zones
from heliosweep.config.sites import BEGINNINGS, header_site, weather_kind
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.tables import Column, Table, numbers, table_lines, table_text
from heliosweep.config.times import FIRST_YEAR, LAST_YEAR, WeatherTime
from heliosweep.errors import Problem, StudyError
from heliosweep.files import read_once

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Largest irradiance: the extraterrestrial one at perihelion, of a solar constant of 1366 W/m2. [W/m2]
MOST_DNI = 1412.0
#: Wind speeds outside of this are signs for missing values. [m/s]
MOST_WIND = 150.0

_MINUTE = np.timedelta64(1, "m")


@dataclass(frozen=True, eq=False)
class WeatherFile:
    """Rows of a weather file, in their order.

    Parameters
    ----------
    name : str
        What messages call it.
    latitude, longitude : float
        Place that its header names; NaN where it names none. [deg]
    hours : float
        Length of each interval. [h]
    utc : ndarray of datetime64, shape (T,)
        Middle of each interval, of the row's own year, in universal time.
    month : ndarray of int, shape (T,)
        Its month, 1 to 12, in the standard time of the file.
    dni, wind : ndarray, shape (T,)
        Mean direct normal irradiance [W/m2], and wind speed, NaN where it is not known. [m/s]
    """

    name: str
    latitude: float
    longitude: float
    hours: float
    utc: NDArray[np.datetime64]
    month: NDArray[np.int64]
    dni: NDArray[np.float64]
    wind: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of rows."""
        return self.utc.size


def with_weather(study: Study) -> Study:
    """Return the study with its weather files read, so that no file is read again."""
    files = weather_files(study)
    if not files:
        return study
    copied = study.model_copy()
    copied._weather = files
    return copied


def weather_files(study: Study) -> tuple[WeatherFile, ...]:
    """Return the weather files of a study in order, of the months that it looks at; none where it names none.

    Raises
    ------
    StudyError
        Everything that is wrong with any of them, at its line.
    """
    block: Any = getattr(study, "weather", None)
    if block is None or block.file is None or study._weather:
        return study._weather
    swept, found, problems = isinstance(block.file, Sweep), [], list[Problem]()
    for number, name in enumerate(block.file.values() if swept else (block.file,)):
        path = study.resolve(name)
        try:
            found.append(_kept(path, block.label, block.timezone))
        except StudyError as error:
            key = f"weather.file[{number}]" if swept else "weather.file"
            problems += (
                problem if problem.line else study.problem(key, f"{name}: {problem.message}")
                for problem in error.problems
            )
    if problems:
        raise StudyError(problems)
    time: Any = getattr(study, "time", None)
    if isinstance(time, WeatherTime) and time.months is not None:
        found = [_of_months(file, time.months.values()) for file in found]
    return tuple(found)


def _of_months(file: WeatherFile, months: NDArray[np.float64]) -> WeatherFile:
    kept = np.isin(file.month, months)
    arrays = {name: getattr(file, name)[kept] for name in ("utc", "month", "dni", "wind")}
    return replace(file, **arrays)


def read_weather(path: Path, label: str | None = None, timezone: str | None = None) -> WeatherFile:
    """Read a weather file: EPW, TMY3, PSM or CSV.

    Parameters
    ----------
    path : Path
        The file.
    label, timezone : str, optional
        What the times of a CSV file mark, ``start``, ``middle`` or ``end``, and their offset from universal time, such
        as ``+01:00``, where they have none.

    Raises
    ------
    StudyError
        It is no such file, a year or an interval is missing, or values are out of range: each at its line.
    """
    name = str(path)
    at, texts = table_lines(table_text(path, name, old=True), name)
    kind = weather_kind("\n".join(texts[:2]))
    for key, given in (("label", label), ("timezone", timezone)):
        if kind and given is not None:
            raise StudyError(Problem(f"is {kind}, which says it itself: remove weather.{key}", file=name))
    try:
        head = header_site("\n".join(texts[:2])) if kind else {"latitude": np.nan, "longitude": np.nan}
    except ValueError as error:
        raise StudyError(Problem(str(error), file=name, line=1)) from None
    skipped = _SKIPPED[kind]
    lines, cells = (at[skipped:], texts[skipped:]), None
    if kind == "EPW" and len(texts) > skipped:
        cells = [text.split(",") for text in lines[1]]
        names = {place: key for key, place in _EPW_PLACES.items()}
        header = [names.get(place, str(place + 1)) for place in range(len(cells[0]))]
        # Header and lines stay one to one: it stands on the first line.
        lines, cells = (lines[0][:1] + lines[0], lines[1][:1] + lines[1]), [header, *cells]
    table = Table(name, lines, cells, rows="hours", needs="a row for each interval")
    columns = _columns(kind, None if timezone is None else zones.parse_timezone(timezone))
    table.check_header(columns, others=True)
    if not kind and not {"time", "dni"} & set(table.header):
        raise StudyError(Problem(f"is no weather file: {BEGINNINGS}, a CSV file has columns time and dni", file=name))
    table.check_rows()
    read = {key: table.column(key) for key, column in columns.items() if column.required}
    table.finish()
    if not kind and label is None:
        _fail(table, "does not say what its times mark: give weather.label, start, middle or end of the interval")
    zone = zones.parse_timezone(str(head["timezone"])) if kind else read["time"][0].tzinfo
    offset = np.timedelta64(zone.utcoffset(None if kind else read["time"][0]), "s")
    if not kind:
        utc = np.array([time.astimezone(dt.UTC).replace(tzinfo=None) for time in read["time"]], "datetime64[s]")
        local, position, days = utc + offset, utc.astype(np.int64) / 60, 0
    elif kind == "TMY3":
        local, position, days = _of_year(read["Date (MM/DD/YYYY)"], read["Time (HH:MM)"])
    else:
        local, position, days = _of_year(*_dates(table, read, kind == "EPW" and _epw_hourly(texts[:skipped])))
    table.finish()
    step = _step(table, position, 1440 * days)
    table.finish()
    mark = {"EPW": "end", "TMY3": "end", "PSM": "middle"}.get(kind, label)
    if kind == "PSM" and step == 60:
        local = local.astype("datetime64[h]").astype("datetime64[m]") + 30 * _MINUTE
    seconds = round(30 * step) * {"start": 1, "middle": 0, "end": -1}[str(mark)]
    middle = local.astype("datetime64[s]") + np.timedelta64(seconds, "s")
    return WeatherFile(
        name,
        head["latitude"],
        head["longitude"],
        step / 60,
        (middle - offset).astype("datetime64[ns]"),
        middle.astype("datetime64[M]").astype(np.int64) % 12 + 1,
        read[_DNI[kind]].astype(float),
        _wind(table, _WIND[kind]),
    )


#: Lines before the header, or before the rows of EPW files, which have none, by kind.
_SKIPPED = {"EPW": 8, "TMY3": 1, "PSM": 2, "": 0}
#: Columns of EPW files, from 0.
_EPW_PLACES = {"year": 0, "month": 1, "day": 2, "hour": 3, "minute": 4, "dni": 14, "wind_speed": 21}
_DNI = {"EPW": "dni", "TMY3": "DNI (W/m^2)", "PSM": "DNI", "": "dni"}
_WIND = {"EPW": "wind_speed", "TMY3": "Wspd (m/s)", "PSM": "Wind Speed", "": "wind_speed"}


def _columns(kind: str, zone: dt.tzinfo | None) -> dict[str, Column]:
    """Columns that a kind of file has; `zone` is that of times of a CSV file that have none."""
    irradiance = Column(
        "direct normal irradiance, in W/m2", True, 0, MOST_DNI,
        f"between 0 and {MOST_DNI:g} W/m2; replace what stands for a missing value",
    )  # fmt: skip
    found = {_DNI[kind]: irradiance, _WIND[kind]: Column("wind speed, in m/s")}
    if kind == "TMY3":
        found["Date (MM/DD/YYYY)"] = Column(
            "date", True, read=_us_date, dtype="datetime64[D]", missing=np.datetime64("NaT")
        )
        found["Time (HH:MM)"] = Column("time at the end of the interval", True, read=_clock, dtype=int, missing=0)
    elif kind:
        bounds = {"year": (FIRST_YEAR, LAST_YEAR), "month": (1, 12), "day": (1, 31), "hour": (0, 24), "minute": (0, 60)}
        for key, (low, high) in bounds.items():
            title = key.title() if kind == "PSM" else key
            found[title] = Column(key, True, low, high, f"between {low} and {high}")
    else:
        meaning = "time, as 2021-06-21T12:00+01:00"
        found["time"] = Column(meaning, True, read=partial(_stamp, zone), dtype=object)
    return found


def _us_date(text: str) -> np.datetime64:
    try:
        month, day, year = map(int, text.split("/"))
        date = dt.date(year, month, day)
    except ValueError:
        raise ValueError(f"must be a date MM/DD/YYYY (got {text[:40]!r})") from None
    _check_year(year)
    return np.datetime64(date, "D")


def _clock(text: str) -> int:
    hours, _, minutes = text.partition(":")
    if not (hours.isdecimal() and minutes.isdecimal() and int(hours) * 60 + int(minutes) <= 1440):
        raise ValueError(f"must be a time of day HH:MM, 00:00 to 24:00 (got {text[:40]!r})")
    return int(hours) * 60 + int(minutes)


def _stamp(zone: dt.tzinfo | None, text: str) -> dt.datetime:
    """Time of a CSV file with its offset from universal time, that of `zone` where it has none."""
    try:
        time = dt.datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(f"must be a time as 2021-06-21T12:00+01:00 (got {text[:40]!r})") from None
    if time.tzinfo is None and zone is None:
        raise ValueError("needs an offset from universal time, as 2021-06-21T12:00+01:00; or give weather.timezone")
    _check_year(time.year)
    return time if time.tzinfo is not None else time.replace(tzinfo=zone)


def _check_year(year: int) -> None:
    if not FIRST_YEAR <= year <= LAST_YEAR:
        raise ValueError(f"must be of the years {FIRST_YEAR} to {LAST_YEAR}")


def _epw_hourly(header: list[str]) -> bool:
    """Whether the last line of the header, ``DATA PERIODS,periods,records per hour``, says one record an hour."""
    fields = header[-1].split(",")
    return len(fields) < 3 or fields[2].strip() in ("", "1")


def _dates(table: Table, read: Mapping[str, Any], hourly: bool) -> tuple[NDArray[np.datetime64], NDArray[np.int64]]:
    """Dates and minutes of the day in EPW and PSM files."""
    epw = "hour" in read
    year, month, day, hour, minute = (
        read[key if epw else key.title()].astype(np.int64) for key in ("year", "month", "day", "hour", "minute")
    )
    dates = ((year - 1970) * 12 + month - 1).astype("datetime64[M]").astype("datetime64[D]") + (day - 1)
    for row in np.flatnonzero(dates.astype("datetime64[M]").astype(np.int64) % 12 + 1 != month).tolist():
        table.add(f"there is no day {day[row]} in month {month[row]} of {year[row]}", row, "day" if epw else "Day")
    if epw:
        hour, minute = (hour, 0 * minute) if hourly else (hour - 1, minute)
    return dates, 60 * hour + minute


def _of_year(dates: NDArray[np.datetime64], minutes: NDArray[np.int64]) -> tuple[Any, Any, int]:
    """Times from dates and minutes of the day; minutes since the year began, whatever the year; days of the year.

    The rows of a typical year are of several years: their months follow each other all the same. A year has 366 days
    if any row is of 29 February.
    """
    months, month = dates.astype("datetime64[M]"), dates.astype("datetime64[M]").astype(np.int64) % 12
    day = (dates - months.astype("datetime64[D]")).astype(np.int64)
    leap = bool(np.any((month == 1) & (day == 28)))
    before = np.cumsum([0, 31, 28 + leap, 31, 30, 31, 30, 31, 31, 30, 31, 30])
    return dates.astype("datetime64[m]") + minutes * _MINUTE, (before[month] + day) * 1440 + minutes, 365 + leap


def _step(table: Table, position: NDArray[Any], year: int) -> float:
    """Minutes between rows at `position` [min]; notes rows that are missing, repeated or out of order.

    The rows must fill a `year` [min], unless that is 0.
    """
    if position.size < 2:
        _fail(table, "needs at least two rows, to tell the length of an interval")
    steps = np.diff(position)
    step = float(np.median(steps))
    if not 0 < step <= 60 or 1440 % step:
        _fail(table, f"has rows {step:g} minutes apart: give intervals of an hour or of a part of it")
    for row in np.flatnonzero(steps != step).tolist():
        gap = float(steps[row])
        if gap == 0:
            message = "repeats the time of the row before: remove one"
        elif gap < 0:
            message = "is earlier than the row before: sort the rows, one year in a file"
        elif gap % step:
            message = f"is {gap:g} minutes after the row before, not {step:g}"
        else:
            message = f"comes after a gap: {gap / step - 1:,.0f} rows of {step:g} minutes are missing before it"
        table.add(message, row + 1)
    if year and not np.any(steps != step) and position.size * step != year:
        table.add(f"has {position.size:,} rows of {step:g} minutes, and a whole year {year / step:,.0f}")
    return step


def _wind(table: Table, key: str) -> NDArray[np.float64]:
    """Wind speed, NaN where it is not known. [m/s]"""
    if key not in table.header:
        return np.full(len(table), np.nan)
    values = numbers(table.texts(key))
    return np.where((values >= 0) & (values <= MOST_WIND), values, np.nan)


def _fail(table: Table, message: str) -> NoReturn:
    table.add(message)
    table.finish()
    raise AssertionError


_kept = read_once(8)(read_weather)

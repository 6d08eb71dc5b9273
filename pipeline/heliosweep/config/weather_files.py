"""Rows of weather files: means of direct normal irradiance (DNI) and wind speed over intervals of time.

The time of a row marks another part of its interval in each format: see `weather_formats`.
The readers of pvlib report no line of a wrong row, refuse hours 0 to 23, names with commas and a row of units, and date
the TMY3 row of 24:00 on 28 February of a leap year to 1 March.
"""

from __future__ import annotations

import datetime as dt
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from heliosweep.config import zones
from heliosweep.config.faults import few_of
from heliosweep.config.spreadsheets import hint, iso_dates
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep, ends
from heliosweep.config.tables import Table, numbers
from heliosweep.config.times import FIRST_YEAR, LAST_YEAR
from heliosweep.config.weather_formats import COLUMNS, Sheet, parse_weather
from heliosweep.errors import Problem, StudyError
from heliosweep.files import read_once

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Year of tables without one.
YEAR = 2021
#: Largest wind speed; greater ones mark missing values. [m/s]
MOST_WIND = 150.0
#: Columns whose numbers make a time.
_PARTS = ("year", "month", "day", "hour", "minute")
#: Time from the mark of an interval to its middle, in its length. [1]
_TO_MIDDLE = {"start": 0.5, "middle": 0.0, "end": -0.5}
#: Formats of whole years.
_YEARS = ("EPW", "TMY3", "SAM")


@dataclass(frozen=True, eq=False)
class WeatherFile:
    """Rows of a weather file, in their order.

    Parameters
    ----------
    name : str
        Name in messages.
    latitude, longitude : float
        Place in the header; NaN if there is none. [deg]
    hours : float
        Length of each interval. [h]
    utc : ndarray of datetime64, shape (T,)
        Instant of each row, in general the middle of its interval, of the row's own year, in universal time.
    month : ndarray of int, shape (T,)
        Month, 1 to 12, on the clock of the file.
    dni, wind : ndarray, shape (T,)
        Mean direct normal irradiance [W/m2], and wind speed, NaN if unknown. [m/s]
    ghi, dhi : ndarray, shape (T,)
        Global and diffuse horizontal irradiance, NaN if unknown. [W/m2]
    shift : float
        Time from the time of a row in the file to its instant. [h]
    notes : tuple of str
        Warnings.
    """

    name: str
    latitude: float
    longitude: float
    hours: float
    utc: NDArray[np.datetime64]
    month: NDArray[np.int64]
    dni: NDArray[np.float64]
    wind: NDArray[np.float64]
    ghi: NDArray[np.float64]
    dhi: NDArray[np.float64]
    shift: float
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of rows."""
        return self.utc.size


def with_weather(study: Study) -> Study:
    """Return the study with its weather files, so that no file is read again."""
    copied = study.model_copy()
    copied._weather = weather_files(study)
    return copied


def weather_files(study: Study) -> tuple[WeatherFile, ...]:
    """Return the weather files of a study in order, limited to its months; none if it names no file.

    Raises
    ------
    StudyError
        With every problem of any of the files, at its line.
    """
    block: Any = getattr(study, "weather", None)
    if block is None or block.file is None or study._weather:
        return study._weather
    found, problems = list[WeatherFile](), list[Problem]()
    for number, name in enumerate(ends(block.file)):
        try:
            found.append(_kept(study.resolve(name), block.label, block.timezone, block.offset))
        except StudyError as error:
            key = f"weather.file[{number}]" if isinstance(block.file, Sweep) else "weather.file"
            problems += (
                problem if problem.line or problem.unlisted else study.problem(key, f"{name}: {problem.message}")
                for problem in error.problems
            )
    if problems:
        raise StudyError(problems)
    months = getattr(getattr(study, "time", None), "months", None)
    return tuple(found if months is None else (_of_months(file, months.values()) for file in found))


def _of_months(file: WeatherFile, months: NDArray[np.float64]) -> WeatherFile:
    kept = np.isin(file.month, months)
    return replace(file, **{name: getattr(file, name)[kept] for name in ("utc", "month", "dni", "wind", "ghi", "dhi")})


def read_weather(
    path: Path, label: str | None = None, timezone: str | None = None, offset: float | None = None
) -> WeatherFile:
    """Read a weather file of any of the formats of `weather_formats`.

    Parameters
    ----------
    path : Path
        The file.
    label : str, optional
        Part of its interval that the time of a row marks: ``start``, ``middle`` or ``end`` (default: the
        convention of the format).
    timezone : str, optional
        Time zone of times without an offset from universal time, such as ``+01:00`` or ``Europe/Madrid`` (default:
        the zone in the file).
    offset : float, optional
        Time from the time of a row to its instant, instead of `label`. [h]

    Raises
    ------
    StudyError
        If it is no such file, an interval is missing, or values are out of range: each cause at its first line.
    """
    sheet = parse_weather(path)
    notes: list[str] = []
    table = Table(
        sheet.name, (sheet.numbers, sheet.texts), sheet.cells, rows="hours", needs="a row for each interval",
        separator=sheet.separator, most_listed=1,
    )  # fmt: skip
    table.check_header(COLUMNS, others=True)
    if table.header[:1] == [""] and not {"time", "date", "hour"} & {*table.header}:
        table.header[0] = "time"  # the index of a pandas table
    if sheet.kind == "PVGIS" and "dni" not in table.header:
        _fail(table, "has no DNI: PVGIS gives it as Gb(n) in typical years, and as Gb(i) with components and two axes")
    table.check_rows()
    mark = label or sheet.mark
    if {"time", "date"} & {*table.header}:
        walls, offsets = _read_times(table, sheet)
    else:
        walls, offsets = _read_parts(table, sheet), np.full(len(table), np.nan)
        if "year" not in table.header:
            notes.append(f"has no year: read as {YEAR}")
        mark = _mark_of_hours(table, sheet, notes) if label is None else label
    shift = offset if offset is not None else None if label else sheet.shift
    if shift is None and not mark:
        table.add("does not state the meaning of its times: give weather.label: start, middle or end of the interval")
    utc = _to_utc(table, walls, offsets, timezone or sheet.site.get("timezone"))
    step = _step(table, sheet, walls, utc, timezone)
    dni = table.column("dni")
    if sheet.kind == "Solargis":
        for row in np.flatnonzero(dni == -9).tolist():
            table.add("dni is -9, a missing value: fill it", row, "dni")
    table.finish()
    shift = step / 60 * _TO_MIDDLE[mark] if shift is None else shift
    seconds = np.timedelta64(round(3600 * shift), "s")
    if small := np.count_nonzero(dni < 0):
        notes.append(f"DNI slightly below 0 in {small:,} rows (minimum {dni.min():g} W/m2) counts as 0")
    if unused := table.unused() if sheet.kind not in ("EPW", "TMY3") else []:  # these have fixed columns
        notes.append(f"columns that are not used: {few_of(unused)}")
    return WeatherFile(
        sheet.name,
        sheet.site.get("latitude", np.nan),
        sheet.site.get("longitude", np.nan),
        step / 60,
        (utc + seconds).astype("datetime64[ns]"),
        (walls + seconds).astype("datetime64[M]").astype(np.int64) % 12 + 1,
        np.maximum(dni, 0.0) * _scale(table, sheet, "dni", step),
        _optional(table, "wind_speed", 0, MOST_WIND),
        _optional(table, "ghi", -10, 2000) * _scale(table, sheet, "ghi", step),
        _optional(table, "dhi", -10, 2000) * _scale(table, sheet, "dhi", step),
        shift,
        tuple(notes),
    )


def _mark_of_hours(table: Table, sheet: Sheet, notes: list[str]) -> str:
    """Return the mark of a file with columns of hours; unusual hours are added to `notes`."""
    first, last = _hours(table)
    if sheet.kind == "EPW":
        minutes = numbers(table.texts("minute"))
        single = np.all(minutes == minutes[0])
        if first == 0 if single else minutes.min() == 0:
            unusual = "hours 0 to 23 instead of 1 to 24" if single else "minute 0 instead of 60"
            notes.append(f"has {unusual}: read as the start of each interval")
            return "start"
    elif sheet.kind == "SAM" and last == 24:
        notes.append("has hours 1 to 24 instead of 0 to 23: hour 24 ends the day; otherwise give weather.offset")
    return sheet.mark


def _scale(table: Table, sheet: Sheet, key: str, step: float) -> float:
    """Return the factor from the unit of a column to W/m2."""
    unit = table.units.get(key, "")
    if unit == "" and sheet.kind == "CAMS":
        unit = "Wh/m2"
    energies = {"Wh/m2": 1.0, "kWh/m2": 1000.0, "MJ/m2": 1e6 / 3600}
    return energies[unit] * 60 / step if unit in energies else 1000.0 if unit == "kW/m2" else 1.0


def _optional(table: Table, key: str, least: float, most: float) -> NDArray[np.float64]:
    """Return a column that a file need not have, NaN if it is unknown or out of bounds."""
    values = numbers(table.texts(key)) if key in table.header else np.full(len(table), np.nan)
    return np.where((values >= least) & (values <= most), values, np.nan)


def _read_times(table: Table, sheet: Sheet) -> tuple[NDArray[np.datetime64], NDArray[np.float64]]:
    """Return times on the clock of the file, and their offsets [s] from universal time, NaN if they have none."""
    key = "time" if "time" in table.header else "date"
    texts = _time_texts(table, sheet, key)
    form = "MM/DD/YYYY" if sheet.kind == "SolarAnywhere" else table.forms.get("date") or table.forms.get(key, "")
    walls, offsets = np.zeros(len(table), "datetime64[s]"), np.full(len(table), np.nan)
    for row, (text, time) in enumerate(zip(texts, iso_dates(texts, form), strict=True)):
        begun = re.sub("(?<=[T ])24:", "00:", time)  # 24:00 is 0:00 of the next day
        try:
            stamp = dt.datetime.fromisoformat(begun)
        except ValueError:
            remedy = hint(text) if text == time else ""
            table.add(f"{key} must be a time such as 2021-06-21T12:00+01:00 (got {text[:40]!r}){remedy}", row, key)
            continue
        if not FIRST_YEAR <= stamp.year <= LAST_YEAR:
            table.add(f"{key} must be of the years {FIRST_YEAR} to {LAST_YEAR} (got {text[:40]!r})", row, key)
        walls[row] = np.datetime64(stamp.replace(tzinfo=None), "s") + np.timedelta64(begun != time, "D")
        if (offset := stamp.utcoffset()) is not None:
            offsets[row] = offset.total_seconds()
    return walls, offsets


def _time_texts(table: Table, sheet: Sheet, key: str) -> list[str]:
    """Return dates with their time of day, from one column or several."""
    texts = [re.split(r"/(?=\d{4}-)", text)[0] for text in table.texts(key)]  # CAMS: start/end
    if key == "date":
        hours = table.texts("hour") if "hour" in table.header else [""] * len(texts)
        return [f"{date} {_clock(hour)}".strip() for date, hour in zip(texts, hours, strict=True)]
    if not {"date", "day"} & {*table.header}:
        return texts
    days = _read_parts(table, sheet).astype("datetime64[D]") if "date" not in table.header else table.texts("date")
    return [f"{day} {_clock(time)}" for day, time in zip(days, texts, strict=True)]


def _clock(time: str) -> str:
    """Return a time of day; a whole number is an hour."""
    return f"{int(time):02}:00" if time.isdecimal() and len(time) < 3 else time


def _read_parts(table: Table, sheet: Sheet) -> NDArray[np.datetime64]:
    """Return times on the clock of the file from columns of year, month, day, hour and minute."""
    if missing := [key for key in ("day", "hour") if key not in table.header and "time" not in table.header]:
        _fail(table, f"needs a column time, or date and time, or year, month, day and hour (there is no {missing[0]})")
    parts = {key: table.column(key) for key in _PARTS if key in table.header}
    table.finish()
    year, month, day = (parts.get(key, np.full(len(table), default)).astype(np.int64) for key, default in
                        (("year", YEAR), ("month", 1), ("day", 1)))  # fmt: skip
    minute = parts.get("minute", np.full(len(table), 30.0 if sheet.kind == "SAM" else 0.0))
    if sheet.kind == "EPW" and np.all(minute == minute[0]):
        minute = 0 * minute  # has no meaning in hourly rows
    elif np.any(minute > 0) and _hours(table)[1] == 24:
        minute -= 60  # within hours that are named by their end
    first = ((year - 1970) * 12 + month - 1).astype("datetime64[M]").astype("datetime64[D]")
    dates = first + (day - 1)
    wrong = dates.astype("datetime64[M]") != first.astype("datetime64[M]") if "month" in parts else day > 366
    for row in np.flatnonzero(wrong).tolist():
        table.add(f"day {day[row]} does not exist in month {month[row]} of {year[row]}", row, "day")
    seconds = np.round(3600 * parts.get("hour", 0.0) + 60 * minute).astype(np.int64)
    return dates.astype("datetime64[s]") + seconds.astype("timedelta64[s]")


def _hours(table: Table) -> tuple[float, float]:
    """Return the first and the last hour of the days: 0 and 23, or 1 and 24."""
    hours = numbers(table.texts("hour")) if "hour" in table.header else np.zeros(1)
    return float(np.min(hours, initial=1)), 24.0 if np.any(hours == 24) and not np.any(hours == 0) else 23.0


def _to_utc(
    table: Table, walls: NDArray[np.datetime64], offsets: NDArray[np.float64], zone: str | None
) -> NDArray[np.datetime64]:
    """Return universal times; rows without an offset are on the clock of a zone."""
    bare = np.isnan(offsets)
    if zone is None and (rows := np.flatnonzero(bare).tolist()):
        key = next(key for key in ("time", "date", "hour") if key in table.header)
        message = "needs an offset from universal time, as 2021-06-21T12:00+01:00; or give weather.timezone"
        table.add(f"{key} {message}", rows[0], key)
    table.finish()
    utc = walls - np.where(bare, 0, offsets).astype(np.int64).astype("timedelta64[s]")
    if bare.any():
        utc[bare] = zones.wall_to_utc(walls[bare], zones.parse_timezone(str(zone)))
    return utc


def _step(
    table: Table, sheet: Sheet, walls: NDArray[np.datetime64], utc: NDArray[np.datetime64], zone: str | None
) -> float:
    """Return the minutes between rows; note missing, repeated and unsorted rows.

    The rows follow each other, or are a typical year: months of several years whose days and hours run through one
    year.
    """
    if walls.size < 2:
        _fail(table, "needs at least two rows, to find the length of an interval")
    real = np.diff(utc.astype(np.int64)) / 60
    step = float(np.median(real))
    if step < 0:
        _fail(table, "has its last row first: sort the rows by time")
    if not 0 < step <= 60 or 1440 % step:
        _fail(table, f"has rows {step:g} minutes apart: give intervals of an hour or of a part of it")
    # Middles of the intervals on a clock without summer time: the end of 28 February is no 29 February.
    walls = utc + (walls[0] - utc[0]) + np.timedelta64(round(60 * step * _TO_MIDDLE.get(sheet.mark, 0)), "s")
    dates, months = walls.astype("datetime64[D]"), walls.astype("datetime64[M]")
    month, day = months.astype(np.int64) % 12, (dates - months.astype("datetime64[D]")).astype(np.int64)
    candidates, year = [real], 0
    for leap in (0, 1):
        before = np.cumsum([0, 31, 28 + leap, 31, 30, 31, 30, 31, 31, 30, 31, 30])
        place = (before[month] + day) * 1440 + (walls - dates.astype("datetime64[s]")).astype(np.int64) / 60
        year = 1440 * (365 + leap)
        candidates.append((np.diff(place) + year / 2) % year - year / 2)
    best = min(range(3), key=lambda at: int(np.count_nonzero(candidates[at] != step)))
    change = f" (or the clocks of {zone} change there, and the times are standard time)" if zone and "/" in zone else ""
    gaps = candidates[best]
    for row in np.flatnonzero(gaps != step).tolist():
        gap = float(gaps[row])
        message = f"comes after a gap: {gap / step - 1:,.0f} rows of {step:g} minutes are missing before it"
        if gap == 0:
            message = f"repeats the time of the row before: remove one{change}"
        elif gap < 0:
            message = "is earlier than the row before: sort the rows; months of several years must make up one year"
        elif gap % step:
            message = f"is {gap:g} minutes after the row before, not {step:g}"
        table.add(message, row + 1)
    days, whole = walls.size * step / 1440, bool(best) or sheet.kind in _YEARS
    if whole and np.all(gaps == step) and (days % 1 or days < 365 or (best and days > 366)):
        whole_year = f"{(364 + max(best, 1)) * 1440 / step:,.0f}"
        table.add(f"has {walls.size:,} rows of {step:g} minutes, and a whole year {whole_year}")
    return step


def _fail(table: Table, message: str) -> NoReturn:
    table.add(message)
    table.finish()
    raise AssertionError


_kept = read_once(8)(read_weather)

"""Read mean direct normal irradiance (DNI) and wind speed over time intervals from weather files.

The time of a row marks the start, middle or end of an interval, depending on the format. This module does not use the
readers of pvlib, because they do not report the line of an invalid row. These readers also reject hours 0 to 23, names
with commas, and a row of units. In TMY3 files, pvlib assigns the row for 24:00 on 28 February of a leap year to 1
March.

References
----------
EPW: EnergyPlus, Auxiliary Programs. TMY3: Wilcox and Marion (2008), NREL/TP-581-43156. SAM CSV: System Advisor Model,
help, "Weather File CSV Format". PVGIS, CAMS, NASA POWER and SolarAnywhere: documentation of `pvlib.iotools`.
"""

from __future__ import annotations

import csv
import datetime as dt
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.faults import few_of, require
from heliosweep.config.source import text_of
from heliosweep.config.study import Study
from heliosweep.config.tables import (
    Column,
    Table,
    hint,
    iso_dates,
    numbers,
    separator_of,
    split_title,
    variable_name,
)
from heliosweep.config.times import FIRST_YEAR, LAST_YEAR, offset_text, parse_timezone, wall_to_utc
from heliosweep.config.values import Sweep, ends
from heliosweep.errors import Problem, StudyError
from heliosweep.files import read_once

#: Maximum irradiance: the extraterrestrial value at perihelion, for a solar constant of 1366 W/m2. [W/m2]
MOST_DNI = 1412.0
#: Words in a title or a preamble, and the part of the interval that they indicate.
_MARKS = {
    "start": "start", "begin": "start", "cent": "middle", "mid": "middle", "end": "end",
    "period_end": "end", "periodend": "end", "period_start": "start", "periodstart": "start",
}  # fmt: skip
_IRRADIANCE = ("Wh/m2", "kW/m2", "kWh/m2", "MJ/m2")
#: Columns of weather files, with their titles in the supported formats.
COLUMNS = {
    "dni": Column(
        "direct normal irradiance, in W/m2", True, -10, MOST_DNI,
        f"between 0 and {MOST_DNI:g} W/m2; fill missing values",
        names=("gb_n", "bni", "beam", "dn", "ebn", "allsky_sfc_sw_dni", "direct_normal_irradiance", "dni_w_m2",
               "direct_normal_irradiance_dni_w_m2", "direct_normal_radiation", "direct_normal", "dni_wm2", "dni_w_m_2",
               "dni_avg"),
        units=_IRRADIANCE,
    ),
    "ghi": Column(
        "global horizontal irradiance, in W/m2", units=_IRRADIANCE, least=-10, most=2000,
        names=("g_h", "global", "gh", "allsky_sfc_sw_dwn", "global_horizontal_irradiance", "ghi_w_m2",
               "global_horizontal_irradiance_ghi_w_m2"),
    ),
    "dhi": Column(
        "diffuse horizontal irradiance, in W/m2", units=_IRRADIANCE, least=-10, most=2000,
        names=("gd_h", "dif", "diffuse", "df", "allsky_sfc_sw_diff", "diffuse_horizontal_irradiance", "dhi_w_m2",
               "diffuse_horizontal_irradiance_dif_w_m2"),
    ),
    "wind_speed": Column(
        "wind speed, in m/s", least=0, most=150,  # greater values indicate missing data
        names=("wspd", "ws", "ws10m", "windspeed", "wind_speed_m_s", "windspeed_m_s", "wind_speed_10m"),
    ),
    "temperature": Column(
        "air temperature, in C", least=-90, most=60,
        names=("dry_bulb", "t2m", "tdry", "temp", "temp_air", "air_temperature"), units=("degC", "deg C"),
    ),
    "time": Column(
        "time, such as 2021-06-21T12:00+01:00",
        names=("time_utc", "datetime", "date_time", "timestamp", "time_stamp", "observation_period", "utc", "utc_time",
               "observationtime", "observationtime_lst", "local_time", "localtime", "period_end", "period_start",
               "periodend", "periodstart", "zeit", "uhrzeit", "hora"),
    ),
    "date": Column("date", names=("date_mm_dd_yyyy", "local_date", "datum", "fecha")),
    "year": Column("year", False, FIRST_YEAR, LAST_YEAR, f"between {FIRST_YEAR} and {LAST_YEAR}", names=("yr", "yyyy")),
    "month": Column("month", False, 1, 12, "between 1 and 12", names=("mo", "mon")),
    "day": Column("day", False, 1, 366, "between 1 and 31", names=("dy", "doy", "day_of_year")),
    "hour": Column("hour", False, 0, 24, "between 0 and 24", names=("hr", "hh")),
    "minute": Column("minute", False, 0, 60, "between 0 and 60", names=("min", "mm")),
}  # fmt: skip
#: Index of each site field in the first line of a file, by format.
_PLACES = {
    "EPW": {"latitude": 6, "longitude": 7, "time zone": 8, "altitude": 9},
    "TMY3": {"latitude": 4, "longitude": 5, "time zone": 3, "altitude": 6},
}
#: Titles of the site fields in SAM CSV files.
_TITLES = {
    "latitude": ("latitude", "lat"), "longitude": ("longitude", "lon", "long", "lng"),
    "time zone": ("time zone", "timezone", "tz"), "altitude": ("elevation", "elev", "altitude", "site elevation"),
}  # fmt: skip
_SHIFT = re.compile(r"Irradiance Time Offset \(h\) *: *([-+]?[\d.]+)", re.IGNORECASE)
_COMMENT = re.compile(r"^[#\s]+")
#: Description of the formats in messages.
FORMATS = (
    "EPW files begin with LOCATION, TMY3 and SolarAnywhere files begin with the station, and SAM CSV and PSM files "
    "begin with titles such as Latitude; tables contain times and a column dni (or DNI, Gb(n), BNI)"
)


@dataclass
class Sheet:
    """Contents of a weather file before the cells are converted to numbers.

    Parameters
    ----------
    name, kind : str
        Name of the file in messages, and its format (empty for a table of unknown origin).
    site : dict
        Name, latitude, longitude, altitude and time zone of the site, if the file contains them.
    numbers, texts : list
        Line numbers and texts of the header and the rows.
    titles : list of str
        Column titles of a CSV file.
    separator : str
        Cell separator.
    mark : str
        Part of the interval that timestamps mark: ``"start"``, ``"middle"`` or ``"end"``; empty if unknown.
    shift : float, optional
        Offset from the time of a row to the instant of the row, if the file contains this offset. [h]
    """

    name: str
    kind: str = ""
    site: dict[str, Any] = field(default_factory=dict)
    numbers: list[int] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    titles: list[str] = field(default_factory=list)
    separator: str = ","
    mark: str = ""
    shift: float | None = None


@read_once(8)
def parse_weather(path: Path) -> Sheet:
    """Split a weather file into site, header and rows. Raises StudyError if the file is not a weather file."""
    sheet = Sheet(str(path))
    text = text_of(path, sheet.name, old=True)
    if not text.strip():
        raise StudyError(Problem("is empty: it needs a row for each interval", file=sheet.name))
    if text.lstrip()[:1] == "{":
        _read_json(sheet, text)
    else:
        _read_lines(sheet, text.replace("\r\n", "\n").replace("\r", "\n").split("\n"))
    marks = {
        **dict.fromkeys(("EPW", "TMY3", "SolarAnywhere"), "end"),
        **dict.fromkeys(("SAM", "PVGIS", "Solargis"), "middle"),
        **dict.fromkeys(("CAMS", "NASA POWER"), "start"),
    }
    sheet.mark = sheet.mark or marks.get(sheet.kind, "")  # the mark of other tables is unknown
    return sheet


def _read_json(sheet: Sheet, text: str) -> None:
    try:
        data = json.loads(text)
        if "outputs" in data:
            location, outputs = data["inputs"]["location"], data["outputs"]
            rows = outputs.get("tmy_hourly") or outputs["hourly"]
            tracked = "two_axis" in data["inputs"].get("mounting_system", {})
            header, cells = list(rows[0]), [[str(value) for value in row.values()] for row in rows]
            sheet.kind, sheet.shift, zone = "PVGIS", location.get("irradiance_time_offset"), "+00:00"
            sheet.site = {key: location[key] for key in ("latitude", "longitude")} | {"altitude": location["elevation"]}
            header = ["dni" if tracked and title == "Gb(i)" else title for title in header]
        else:
            values, (east, north, *height) = data["properties"]["parameter"], data["geometry"]["coordinates"]
            times = list(next(iter(values.values())))
            header, cells = ["time", *values], [[time, *(str(one[time]) for one in values.values())] for time in times]
            local = str(data.get("header", {}).get("time_standard", "")).upper() == "LST"
            sheet.kind, zone = "NASA POWER", offset_text(round(east / 15) if local else 0)
            sheet.site = dict(zip(("latitude", "longitude", "altitude"), (north, east, *height[:1]), strict=False))
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        problem = f"is not a PVGIS or NASA POWER JSON file ({type(error).__name__}: {str(error)[:60]})"
        raise StudyError(Problem(problem, file=sheet.name)) from None
    sheet.site |= {"name": sheet.kind, "timezone": zone}
    sheet.texts = [",".join(f'"{cell}"' for cell in row) for row in (header, *cells)]
    sheet.numbers = [1] * len(sheet.texts)


def _read_lines(sheet: Sheet, lines: list[str]) -> None:
    heads = [_fields(line) for line in (*lines[:3], "", "")]
    titles, keys = [title.lower() for title in heads[0]], _keys(heads[2])
    try:
        if heads[0][:1] == ["LOCATION"]:
            sheet.kind, sheet.site = "EPW", _site("EPW", heads[0])
            first = next((at for at, line in enumerate(lines[:50], 1) if line.startswith("DATA PERIODS")), 8)
            if found := _SHIFT.search("\n".join(lines[:first])):
                # A negative offset is relative to the hour after the time of the row.
                sheet.shift = float(found[1]) + (1.0 if float(found[1]) < 0 else 0.0)
            names = {0: "year", 1: "month", 2: "day", 3: "hour", 4: "minute", 6: "temperature", 13: "ghi", 14: "dni"}
            width = len(_fields("".join(lines[first : first + 1])))
            header = (({**names, 15: "dhi", 21: "wind_speed"}).get(at, str(at + 1)) for at in range(width))
            _keep(sheet, [*lines[:first], ",".join(header), *lines[first:]], first)
            sheet.numbers[1:] = [number - 1 for number in sheet.numbers[1:]]
        elif re.match('"?(Date \\(MM/DD/YYYY\\)|ObservationTime)', lines[1].strip() if lines[1:] else ""):
            sheet.kind = "TMY3" if heads[1][0].startswith("Date") else "SolarAnywhere"
            sheet.site = _site("TMY3", heads[0])
            _keep(sheet, lines, 1)
        elif {"latitude", "lat"} & {*titles} and keys & {"dni", "ghi", "year", "hour"}:
            sheet.kind, sheet.site = "SAM", _site("SAM", heads[1], titles)
            _keep(sheet, lines, 2)
        else:
            _read_table(sheet, lines)
    except ValueError as error:
        raise StudyError(Problem(str(error), file=sheet.name, line=1)) from None


def _read_table(sheet: Sheet, lines: list[str]) -> None:
    first = _header_row(lines)
    if first is None:
        raise StudyError(Problem(f"is not a weather file: {FORMATS}", file=sheet.name))
    preamble = "\n".join(lines[:first])
    if re.search("true solar time", preamble, re.IGNORECASE):
        raise StudyError(
            Problem("contains times in true solar time: download the file in universal time", file=sheet.name)
        )
    signs = {
        "PVGIS": "PVGIS|Radiation database|Irradiance Time Offset", "CAMS": r"CAMS|Summarization \(integration",
        "NASA POWER": "-BEGIN HEADER-|NASA/POWER", "Solargis": "Solargis",
    }  # fmt: skip
    sheet.kind = next((kind for kind, sign in signs.items() if re.search(sign, preamble, re.IGNORECASE)), "")
    if found := _SHIFT.search(preamble):
        sheet.shift = float(found[1])
    lines[first] = _COMMENT.sub("", lines[first])
    if sheet.kind == "PVGIS" and re.search(r"slope: *-", preamble, re.IGNORECASE):
        lines[first] = lines[first].replace("Gb(i)", "dni")
    _keep(sheet, lines, first, until_blank=sheet.kind == "PVGIS")
    marks = r"\b(start|begin|cent|mid|end)\w* of (?:the |each )?(?:\w+ )?(?:interval|period)"
    stated = [found[1].lower() for found in re.finditer(marks, preamble, re.IGNORECASE)]
    sheet.mark = next((_MARKS[name] for name in [*map(variable_name, sheet.titles), *stated] if name in _MARKS), "")
    numbers_of = r"\b(latitude|longitude|elevation|altitude)[\s:=;,]*([-+]?\d+(?:\.\d+)?)"
    found_places = re.findall(numbers_of, re.sub(r"\([^)]*\)", "", preamble), re.IGNORECASE)
    place = {key.lower(): float(number) for key, number in found_places}
    place["altitude"] = place.pop("elevation", place.get("altitude", 0.0))
    zone = _stated_zone(sheet, preamble, place.get("longitude", 0.0))
    sheet.site = {"name": sheet.kind or "table", **place} | ({"timezone": zone} if zone else {})


def _header_row(lines: Sequence[str]) -> int | None:
    """Return the index of the first line with titles for DNI and time, or for one of the two; None if absent."""
    titles = [_fields(line, separator_of(line)) for line in (_COMMENT.sub("", line) for line in lines[:200])]
    keys = [_keys(row) if len(row) > 1 else set[str]() for row in titles]
    whole = (at for at, found in enumerate(keys) if "dni" in found and found & {"time", "date", "day", "hour"})
    plain = (at for at, found in enumerate(keys) if found & {"dni", "time", "date"} and not lines[at].startswith("#"))
    return next(whole, next(plain, None))


def _stated_zone(sheet: Sheet, preamble: str, longitude: float) -> str:
    """Return the UTC offset that the data service uses, or that a title or a comment in the file specifies."""
    if sheet.kind in ("PVGIS", "CAMS") or (sheet.kind == "NASA POWER" and "in UTC" in preamble):
        return "+00:00"
    if sheet.kind == "NASA POWER":  # local solar time
        return offset_text(round(longitude / 15))
    titles = [title for title in sheet.titles if "time" in title.lower()][:1]
    zones = re.findall("^.*(?:time ?zone|time reference).*$", preamble, re.IGNORECASE | re.MULTILINE)
    utc = re.compile(r"\b(?:UTC?|GMT)\b(?: *([-+]) *(\d{1,2})(?:[:.]?([0-5]\d))?)?", re.IGNORECASE)
    found = next(filter(None, map(utc.search, titles + zones)), None)
    hours = int(found[2] or 0) + int(found[3] or 0) / 60 if found else 0.0
    return offset_text(-hours if found[1] == "-" else hours) if found else ""


def _keep(sheet: Sheet, lines: Sequence[str], first: int, *, until_blank: bool = False) -> None:
    mark = sheet.separator = separator_of("".join(lines[first : first + 1]))
    end = next((at for at in range(first, len(lines)) if until_blank and not lines[at].strip()), len(lines))
    kept = [at for at in range(first, end) if lines[at].strip() and not lines[at].lstrip().startswith("#")]
    sheet.titles = _fields("".join(lines[at] for at in kept[:1]), mark)
    while len(kept) > 2 and not re.search(r"(^|\n)[-+.]?\d", "\n".join(_fields(lines[kept[1]], mark))):
        del kept[1]  # remove rows of units
    sheet.numbers, sheet.texts = [at + 1 for at in kept], [lines[at] for at in kept]


def _fields(line: str, separator: str = ",") -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _keys(titles: Sequence[str]) -> set[str]:
    names = {variable_name(text) for title in titles for text in (title, split_title(title)[0])}
    return {key for key, column in COLUMNS.items() if names & {key, *column.names}}


def _site(kind: str, fields: Sequence[str], titles: Sequence[str] = ()) -> dict[str, Any]:
    in_titles = {key: titles.index(name) for key, names in _TITLES.items() for name in names if name in titles}
    places = _PLACES.get(kind, in_titles)
    for key in ("longitude", "time zone"):
        require(key in places, f"the header has no field {key.title()!r}")
    width = max(places.values()) + 1
    require(len(fields) >= width, f"the header has {len(fields)} fields, and {kind} files have {width}")
    got = {name: float(numbers([fields[place]])[0]) for name, place in places.items()}
    bounds = {"latitude": (-90, 90), "longitude": (-180, 180), "time zone": (-14, 14), "altitude": (-500, 10_000)}
    wrong = [
        f"field {places[name] + 1}, the {name}, must be between {low:g} and {high:g} (got {fields[places[name]]!r})"
        for name, (low, high) in bounds.items()
        if name in got and not low <= got[name] <= high
    ]
    require(not wrong, "; ".join(wrong))
    whole = f"field {places['time zone'] + 1}, the time zone, must be in whole minutes (got {got['time zone']:g} h)"
    require(got["time zone"] * 60 % 1 == 0, whole)
    zone = offset_text(got.pop("time zone"))
    city = fields[titles.index("city")] if "city" in titles else ""
    return {"name": city.strip("- ") or fields[1] or "unnamed", **got, "timezone": zone}


#: Year assumed for tables without a year.
YEAR = 2021
#: Time from the marked part of an interval to its middle, as a fraction of the interval length. [1]
_TO_MIDDLE = {"start": 0.5, "middle": 0.0, "end": -0.5}


@dataclass(frozen=True, eq=False)
class WeatherFile:
    """Rows of a weather file, in the order of the file.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    latitude, longitude : float
        Position of the site in the header; NaN if the header contains no position. [deg]
    hours : float
        Length of each interval. [h]
    utc : ndarray of datetime64, shape (T,)
        Instant of each row in universal time, in the year of the file. The instant is usually the middle of the
        interval.
    month : ndarray of int, shape (T,)
        Month, 1 to 12, on the clock of the file.
    dni, wind, temperature : ndarray, shape (T,)
        Mean direct normal irradiance [W/m2], wind speed [m/s] and air temperature [C]; NaN if unknown.
    ghi, dhi : ndarray, shape (T,)
        Global and diffuse horizontal irradiance, NaN if unknown. [W/m2]
    shift : float
        Offset from the time of a row in the file to the instant of the row. [h]
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
    temperature: NDArray[np.float64]
    ghi: NDArray[np.float64]
    dhi: NDArray[np.float64]
    shift: float
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return self.utc.size


def weather_of(study: Study) -> tuple[WeatherFile, ...]:
    """Return the weather files of a study in order, limited to the months of the study.

    The tuple is empty if the study has no weather files.

    Raises
    ------
    StudyError
        If a file is invalid. The message lists all problems with file and line.
    """
    block: Any = getattr(study, "weather", None)
    if block is None or block.file is None or study._weather:
        return study._weather
    found, problems = list[WeatherFile](), list[Problem]()
    for number, name in enumerate(ends(block.file)):
        try:
            found.append(read_weather(study.resolve(name), block.label, block.timezone, block.offset))
        except StudyError as error:
            key = f"weather.file[{number}]" if isinstance(block.file, Sweep) else "weather.file"
            problems += (
                problem if problem.line or problem.unlisted else study.problem(key, f"{name}: {problem.message}")
                for problem in error.problems
            )
    if problems:
        raise StudyError(problems)
    months: Sweep | None = getattr(getattr(study, "time", None), "months", None)
    if months is None:
        return tuple(found)
    series = ("utc", "month", "dni", "wind", "temperature", "ghi", "dhi")
    pairs = [(file, np.isin(file.month, months.values())) for file in found]
    return tuple(replace(file, **{key: getattr(file, key)[kept] for key in series}) for file, kept in pairs)


@read_once(8)
def read_weather(
    path: Path, label: str | None = None, timezone: str | None = None, offset: float | None = None
) -> WeatherFile:
    """Read a weather file in one of the formats that this module supports.

    Parameters
    ----------
    path : Path
        The file.
    label : str, optional
        Part of the interval that the time of a row marks: ``start``, ``middle`` or ``end`` (default: the convention of
        the format).
    timezone : str, optional
        Time zone of times without an offset from universal time, such as ``+01:00`` or ``Europe/Madrid`` (default:
        the zone in the file).
    offset : float, optional
        Offset from the time of a row to the instant of the row, instead of `label`. [h]

    Raises
    ------
    StudyError
        If the file is not a weather file, if an interval is missing, or if values are out of range. Problems with the
        same cause are reported once, at the first line.
    """
    sheet, notes = parse_weather(path), list[str]()
    table = Table(
        sheet.name, (sheet.numbers, sheet.texts), rows="hours", needs="a row for each interval",
        separator=sheet.separator, most_listed=1,
    )  # fmt: skip
    table.check_header(COLUMNS, others=True)
    if table.header[:1] == [""] and not {"time", "date", "hour"} & {*table.header}:
        table.header[0] = "time"  # the index of a pandas table
    tracked = (
        "has no DNI: PVGIS provides the DNI as Gb(n) in typical years, and as Gb(i) if components and two axes are "
        "selected"
    )
    table.require(sheet.kind != "PVGIS" or "dni" in table.header, tracked)
    table.check_rows()
    if {"time", "date"} & {*table.header}:
        (walls, offsets), mark = _read_times(table, sheet), sheet.mark
    else:
        walls, offsets = _read_parts(table, sheet), np.full(len(table), np.nan)
        mark = _mark_of_hours(table, sheet, notes)
    shift, mark = offset if offset is not None or label else sheet.shift, label or mark
    if shift is None and not mark:
        table.add("does not define which part of an interval its times mark: set weather.label to start, middle or end")
    utc = _to_utc(table, sheet, walls, offsets, timezone)
    step = _step(table, sheet, walls, utc, timezone)
    dni, series = table.column("dni"), dict[str, Any]()
    for row in np.flatnonzero((dni == -9) & (sheet.kind == "Solargis")).tolist():
        table.add("dni is -9, which marks a missing value: fill in the value", row, "dni")
    table.finish()
    shift = step / 60 * _TO_MIDDLE[mark] if shift is None else shift
    seconds = np.timedelta64(round(3600 * shift), "s")
    for key in ("wind_speed", "temperature", "ghi", "dhi"):  # NaN if unknown or out of bounds
        values = numbers(table.texts(key)) if key in table.header else np.full(len(table), np.nan)
        values[(values < COLUMNS[key].least) | (values > COLUMNS[key].most)] = np.nan
        series[key.removesuffix("_speed")] = values * _scale(table, sheet, key, step)
    return WeatherFile(
        sheet.name,
        sheet.site.get("latitude", np.nan),
        sheet.site.get("longitude", np.nan),
        step / 60,
        utc=(utc + seconds).astype("datetime64[ns]"),
        month=(walls + seconds).astype("datetime64[M]").astype(np.int64) % 12 + 1,
        dni=np.maximum(dni, 0.0) * _scale(table, sheet, "dni", step),
        shift=shift,
        notes=(*notes, *_notes(table, sheet, dni)),
        **series,
    )


def _notes(table: Table, sheet: Sheet, dni: NDArray[np.float64]) -> Iterator[str]:
    if small := np.count_nonzero(dni < 0):
        yield f"DNI slightly below 0 in {small:,} rows (minimum {dni.min():g} W/m2) is set to 0"
    if unused := table.unused() if sheet.kind not in ("EPW", "TMY3") else []:  # these formats have fixed columns
        yield f"ignored columns: {few_of(unused)}"


def _mark_of_hours(table: Table, sheet: Sheet, notes: list[str]) -> str:
    """Return the part of the interval marked by the hours in a file, and add a note on unusual conventions."""
    first, last = _hours(table)
    if "year" not in table.header:
        notes.append(f"has no year: {YEAR} is assumed")
    if sheet.kind == "EPW":
        minutes = numbers(table.texts("minute"))
        single = np.all(minutes == minutes[0])
        if first == 0 if single else minutes.min() == 0:
            unusual = "hours 0 to 23 instead of 1 to 24" if single else "minute 0 instead of 60"
            notes.append(f"has {unusual}: read as the start of each interval")
            return "start"
    elif sheet.kind == "SAM" and last == 24:
        notes.append(
            "has hours 1 to 24 instead of 0 to 23: hour 24 is read as the end of the day; if this is wrong, set "
            "weather.offset"
        )
    return sheet.mark


def _scale(table: Table, sheet: Sheet, key: str, step: float) -> float:
    unit = table.units.get(key) or ("Wh/m2" if sheet.kind == "CAMS" else "")
    energies = {"Wh/m2": 1.0, "kWh/m2": 1000.0, "MJ/m2": 1e6 / 3600}
    return energies[unit] * 60 / step if unit in energies else 1000.0 if unit == "kW/m2" else 1.0


def _read_times(table: Table, sheet: Sheet) -> tuple[NDArray[np.datetime64], NDArray[np.float64]]:
    """Return the times on the clock of the file, and their offsets from universal time [s] (NaN if unknown)."""
    key = "time" if "time" in table.header else "date"
    texts = _time_texts(table, sheet, key)
    form = "MM/DD/YYYY" if sheet.kind == "SolarAnywhere" else table.forms.get("date") or table.forms.get(key, "")
    walls, offsets = np.zeros(len(table), "datetime64[s]"), np.full(len(table), np.nan)
    for row, (text, time) in enumerate(zip(texts, iso_dates(texts, form), strict=True)):
        begun = re.sub("(?<=[T ])24:", "00:", time)  # 24:00 is 0:00 on the next day
        try:
            stamp = dt.datetime.fromisoformat(begun)
        except ValueError:
            remedy = hint(text) if text == time else ""
            table.add(f"{key} must be a time such as 2021-06-21T12:00+01:00 (got {text[:40]!r}){remedy}", row, key)
            continue
        if not FIRST_YEAR <= stamp.year <= LAST_YEAR:
            table.add(f"{key} must be in the years {FIRST_YEAR} to {LAST_YEAR} (got {text[:40]!r})", row, key)
        walls[row] = np.datetime64(stamp.replace(tzinfo=None), "s") + np.timedelta64(begun != time, "D")
        if (offset := stamp.utcoffset()) is not None:
            offsets[row] = offset.total_seconds()
    return walls, offsets


def _time_texts(table: Table, sheet: Sheet, key: str) -> list[str]:
    texts = [re.split(r"/(?=\d{4}-)", text)[0] for text in table.texts(key)]  # CAMS: start/end
    if key == "date":
        days, times = texts, table.texts("hour") if "hour" in table.header else [""] * len(texts)
    elif {"date", "day"} & {*table.header}:
        days, times = table.texts("date") if "date" in table.header else [], texts
        days = days or list(map(str, _read_parts(table, sheet).astype("datetime64[D]")))
    else:
        return texts
    times = [f"{int(time):02}:00" if time.isdecimal() and len(time) < 3 else time for time in times]
    return [f"{day} {time}".strip() for day, time in zip(days, times, strict=True)]


def _read_parts(table: Table, sheet: Sheet) -> NDArray[np.datetime64]:
    """Return the times on the clock of the file, read from the columns year, month, day, hour and minute."""
    missing = next((key for key in ("day", "hour") if not {key, "time"} & {*table.header}), "")
    wanted = f"needs a column time, or date and time, or year, month, day and hour (there is no {missing})"
    table.require(not missing, wanted)
    parts: dict[str, Any] = {
        key: table.column(key) for key in ("year", "month", "day", "hour", "minute") if key in table.header
    }
    table.finish()
    year, month, day = (parts.get(key, np.full(len(table), default)).astype(np.int64) for key, default in
                        (("year", YEAR), ("month", 1), ("day", 1)))  # fmt: skip
    minute = parts.get("minute", np.full(len(table), 30.0 if sheet.kind == "SAM" else 0.0))
    if sheet.kind == "EPW" and np.all(minute == minute[0]):
        minute = 0 * minute  # ignore the minutes of hourly rows
    elif np.any(minute > 0) and _hours(table)[1] == 24:
        minute -= 60  # the minutes belong to hours that are labelled by their end
    first = ((year - 1970) * 12 + month - 1).astype("datetime64[M]").astype("datetime64[D]")
    dates = first + (day - 1)
    wrong = dates.astype("datetime64[M]") != first.astype("datetime64[M]") if "month" in parts else day > 366
    for row in np.flatnonzero(wrong).tolist():
        table.add(f"day {day[row]} does not exist in month {month[row]} of {year[row]}", row, "day")
    seconds = np.round(3600 * parts.get("hour", 0.0) + 60 * minute).astype(np.int64)
    return dates.astype("datetime64[s]") + seconds.astype("timedelta64[s]")


def _hours(table: Table) -> tuple[float, float]:
    """Return the first and the last hour of a day in the file: 0 and 23, or 1 and 24."""
    hours = numbers(table.texts("hour")) if "hour" in table.header else np.zeros(1)
    return float(np.min(hours, initial=1)), 24.0 if np.any(hours == 24) and not np.any(hours == 0) else 23.0


def _to_utc(
    table: Table, sheet: Sheet, walls: NDArray[np.datetime64], offsets: NDArray[np.float64], timezone: str | None
) -> NDArray[np.datetime64]:
    """Convert times to universal time.

    Times without an offset are in the time zone `timezone` (default: the time zone in the file).
    """
    zone = timezone or sheet.site.get("timezone")
    bare = np.isnan(offsets)
    if zone is None and (rows := np.flatnonzero(bare).tolist()):
        key = next(key for key in ("time", "date", "hour") if key in table.header)
        message = "needs an offset from universal time, as in 2021-06-21T12:00+01:00: add it, or set weather.timezone"
        table.add(f"{key} {message}", rows[0], key)
    table.finish()
    utc = walls - np.where(bare, 0, offsets).astype(np.int64).astype("timedelta64[s]")
    if bare.any():
        utc[bare] = wall_to_utc(walls[bare], parse_timezone(str(zone)))
    return utc


def _step(
    table: Table, sheet: Sheet, walls: NDArray[np.datetime64], utc: NDArray[np.datetime64], zone: str | None
) -> float:
    """Return the number of minutes between rows, and record missing, repeated and unsorted rows.

    The rows are in chronological order, or form a typical year that combines months from different years.
    """
    table.require(walls.size > 1, "needs at least two rows to determine the length of an interval")
    real = np.diff(utc.astype(np.int64)) / 60
    step = float(np.median(real))
    table.require(step >= 0, "has rows in reverse order: sort the rows by time")
    apart = f"has rows {step:g} minutes apart: use intervals of an hour or of a fraction of an hour"
    table.require(0 < step <= 60 and 1440 % step == 0, apart)
    # Use interval midpoints on a clock without summer time, because the last row of 28 February may be at 0:00 of the
    # next day.
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
    change = f" (or the clocks of {zone} change here, but the file uses standard time)" if zone and "/" in zone else ""
    gaps = candidates[best]
    for row in np.flatnonzero(gaps != step).tolist():
        gap = float(gaps[row])
        messages = {
            f"repeats the time of the previous row: remove one of them{change}": gap == 0,
            "is earlier than the previous row: sort the rows; months of several years must form one year": gap < 0,
            f"is {gap:g} minutes after the previous row, not {step:g}": gap % step > 0,
            f"comes after a gap: {gap / step - 1:,.0f} rows of {step:g} minutes are missing before it": True,
        }
        table.add(next(message for message, applies in messages.items() if applies), row + 1)
    days, whole = walls.size * step / 1440, bool(best) or sheet.kind in ("EPW", "TMY3", "SAM")
    if whole and np.all(gaps == step) and (days % 1 or days < 365 or (best and days > 366)):
        whole_year = f"{(364 + max(best, 1)) * 1440 / step:,.0f}"
        table.add(f"has {walls.size:,} rows of {step:g} minutes, but a whole year has {whole_year}")
    return step

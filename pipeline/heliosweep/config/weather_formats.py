"""Formats of weather files: site, columns and the meaning of a time, from the contents of a file.

References
----------
EPW: EnergyPlus, Auxiliary Programs. TMY3: Wilcox and Marion (2008), NREL/TP-581-43156. SAM CSV: System Advisor Model,
help, "Weather File CSV Format". PVGIS, CAMS, NASA POWER and SolarAnywhere: documentation of `pvlib.iotools`.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from heliosweep.config.spreadsheets import separator_of, split_title, variable_name
from heliosweep.config.tables import Column, numbers, table_text
from heliosweep.config.zones import offset_text
from heliosweep.errors import Problem, StudyError
from heliosweep.files import read_once

#: Largest irradiance: extraterrestrial at perihelion, for a solar constant of 1366 W/m2. [W/m2]
MOST_DNI = 1412.0
#: Part of the interval that the time of a row marks, by format; a table of unknown origin marks none.
MARKS = {
    "EPW": "end", "TMY3": "end", "SolarAnywhere": "end", "SAM": "middle", "PVGIS": "middle", "Solargis": "middle",
    "CAMS": "start", "NASA POWER": "start",
}  # fmt: skip
#: Marks that a title or a preamble states.
_MARKS = {
    "start": "start", "begin": "start", "cent": "middle", "mid": "middle", "end": "end",
    "period_end": "end", "periodend": "end", "period_start": "start", "periodstart": "start",
}  # fmt: skip
_IRRADIANCE = ("Wh/m2", "kW/m2", "kWh/m2", "MJ/m2")
#: Columns of weather files by the names that the formats give them.
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
        "global horizontal irradiance, in W/m2", units=_IRRADIANCE,
        names=("g_h", "global", "gh", "allsky_sfc_sw_dwn", "global_horizontal_irradiance", "ghi_w_m2",
               "global_horizontal_irradiance_ghi_w_m2"),
    ),
    "dhi": Column(
        "diffuse horizontal irradiance, in W/m2", units=_IRRADIANCE,
        names=("gd_h", "dif", "diffuse", "df", "allsky_sfc_sw_diff", "diffuse_horizontal_irradiance", "dhi_w_m2",
               "diffuse_horizontal_irradiance_dif_w_m2"),
    ),
    "wind_speed": Column(
        "wind speed, in m/s",
        names=("wspd", "ws", "ws10m", "windspeed", "wind_speed_m_s", "windspeed_m_s", "wind_speed_10m"),
    ),
    "time": Column(
        "time, such as 2021-06-21T12:00+01:00",
        names=("time_utc", "datetime", "date_time", "timestamp", "time_stamp", "observation_period", "utc", "utc_time",
               "observationtime", "observationtime_lst", "local_time", "localtime", "period_end", "period_start",
               "periodend", "periodstart", "zeit", "uhrzeit", "hora"),
    ),
    "date": Column("date", names=("date_mm_dd_yyyy", "local_date", "datum", "fecha")),
    "year": Column("year", False, 1700, 2200, "between 1700 and 2200", names=("yr", "yyyy")),
    "month": Column("month", False, 1, 12, "between 1 and 12", names=("mo", "mon")),
    "day": Column("day", False, 1, 366, "between 1 and 31", names=("dy", "doy", "day_of_year")),
    "hour": Column("hour", False, 0, 24, "between 0 and 24", names=("hr", "hh")),
    "minute": Column("minute", False, 0, 60, "between 0 and 60", names=("min", "mm")),
}  # fmt: skip
_EPW = dict(enumerate(("year", "month", "day", "hour", "minute"))) | {13: "ghi", 14: "dni", 15: "dhi", 21: "wind_speed"}
#: Places of the site in the first line of a file, and titles of its fields in SAM CSV.
_PLACES = {
    "EPW": {"latitude": 6, "longitude": 7, "time zone": 8, "altitude": 9},
    "TMY3": {"latitude": 4, "longitude": 5, "time zone": 3, "altitude": 6},
}
_TITLES = {
    "latitude": ("latitude", "lat"), "longitude": ("longitude", "lon", "long", "lng"),
    "time zone": ("time zone", "timezone", "tz"), "altitude": ("elevation", "elev", "altitude", "site elevation"),
}  # fmt: skip
_BOUNDS = {"latitude": (-90, 90), "longitude": (-180, 180), "time zone": (-14, 14), "altitude": (-500, 10_000)}
_STATED = re.compile(r"\b(latitude|longitude|elevation|altitude)[\s:=;,]*([-+]?\d+(?:\.\d+)?)", re.IGNORECASE)
_UTC = re.compile(r"\b(?:UTC?|GMT)\b(?: *([-+]) *(\d{1,2})(?:[:.]?([0-5]\d))?)?", re.IGNORECASE)
_MARK = re.compile(r"\b(start|begin|cent|mid|end)\w* of (?:the |each )?(?:\w+ )?(?:interval|period)", re.IGNORECASE)
_SHIFT = re.compile(r"Irradiance Time Offset \(h\) *: *([-+]?[\d.]+)", re.IGNORECASE)
_ZONES = re.compile("^.*(?:time ?zone|time reference).*$", re.IGNORECASE | re.MULTILINE)
_COMMENT = re.compile(r"^[#\s]+")
#: Words in the preambles of services.
_SIGNS = {
    "PVGIS": "PVGIS|Radiation database|Irradiance Time Offset", "CAMS": r"CAMS|Summarization \(integration",
    "NASA POWER": "-BEGIN HEADER-|NASA/POWER", "Solargis": "Solargis",
}  # fmt: skip
#: Lines in which the header is looked for.
_MOST_PREAMBLE = 200
#: Description of the formats in messages.
FORMATS = (
    "EPW files begin with LOCATION, TMY3 and SolarAnywhere files with their station, SAM CSV and PSM files with titles "
    "such as Latitude; tables have a column dni (or DNI, Gb(n), BNI) and times"
)


@dataclass
class Sheet:
    """Contents of a weather file before its numbers are read.

    Parameters
    ----------
    name, kind : str
        Name of the file in messages, and format; empty for a table of unknown origin.
    site : dict
        Name, latitude, longitude, altitude and time zone, if the file states them.
    numbers, texts, cells : list
        Line number, text and cells of the header and of each row; no cells for a CSV file.
    titles : list of str
        Titles of the columns of a CSV file.
    separator : str
        Separator of the cells.
    mark : str
        Part of its interval that the time of a row marks; empty if unknown.
    shift : float, optional
        Time from the time of a row to its instant, as the file states it. [h]
    """

    name: str
    kind: str = ""
    site: dict[str, Any] = field(default_factory=dict)
    numbers: list[int] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    cells: list[list[str]] | None = None
    titles: list[str] = field(default_factory=list)
    separator: str = ","
    mark: str = ""
    shift: float | None = None


def _parse(path: Path) -> Sheet:
    """Split a weather file into site, header and rows. Raises StudyError if it is none."""
    sheet = Sheet(str(path))
    text = table_text(path, sheet.name, old=True)
    if not text.strip():
        raise StudyError(Problem("is empty: it needs a row for each interval", file=sheet.name))
    if text.lstrip()[:1] == "{":
        _read_json(sheet, text)
    else:
        _read_lines(sheet, text.replace("\r\n", "\n").replace("\r", "\n").split("\n"))
    sheet.mark = sheet.mark or MARKS.get(sheet.kind, "")
    return sheet


parse_weather = read_once(8)(_parse)


def _read_json(sheet: Sheet, text: str) -> None:
    """Read the JSON of PVGIS and of NASA POWER."""
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
        problem = f"is no JSON of PVGIS or NASA POWER ({type(error).__name__}: {str(error)[:60]})"
        raise StudyError(Problem(problem, file=sheet.name)) from None
    sheet.site |= {"name": sheet.kind, "timezone": zone}
    sheet.cells = [header, *cells]
    sheet.numbers, sheet.texts = [1] * (len(cells) + 1), ['"'] * (len(cells) + 1)


def _read_lines(sheet: Sheet, lines: list[str]) -> None:
    """Recognise the format of a text file by its first lines; note its site, header and rows."""
    heads = [_fields(line) for line in (*lines[:3], "", "")]
    titles, keys = [title.lower() for title in heads[0]], _keys(heads[2])
    try:
        if heads[0][:1] == ["LOCATION"]:
            sheet.kind, sheet.site = "EPW", _site("EPW", heads[0], _PLACES["EPW"])
            first = next((at for at, line in enumerate(lines[:50], 1) if line.startswith("DATA PERIODS")), 8)
            if found := _SHIFT.search("\n".join(lines[:first])):
                # PVGIS counts it from the hour after the time of the row.
                sheet.shift = float(found[1]) + (1.0 if float(found[1]) < 0 else 0.0)
            width = len(_fields(lines[first])) if first < len(lines) else 0
            _keep(sheet, lines, first, [_EPW.get(place, str(place + 1)) for place in range(width)])
        elif re.match('"?(Date \\(MM/DD/YYYY\\)|ObservationTime)', lines[1].strip() if lines[1:] else ""):
            sheet.kind = "TMY3" if heads[1][0].startswith("Date") else "SolarAnywhere"
            sheet.site = _site("TMY3", heads[0], _PLACES["TMY3"])
            _keep(sheet, lines, 1)
        elif {"latitude", "lat"} & {*titles} and keys & {"dni", "ghi", "year", "hour"}:
            sheet.kind, sheet.site = "SAM", _site("SAM", heads[1], _sam_places(titles), titles)
            _keep(sheet, lines, 2)
        else:
            _read_table(sheet, lines)
    except ValueError as error:
        raise StudyError(Problem(str(error), file=sheet.name, line=1)) from None


def _sam_places(titles: Sequence[str]) -> dict[str, int]:
    """Return the places of the site in line 2 of SAM CSV. Raises ValueError."""
    places = {key: titles.index(name) for key, names in _TITLES.items() for name in names if name in titles}
    if missing := [key.title() for key in ("longitude", "time zone") if key not in places]:
        raise ValueError(f"the header has no field {missing[0]!r}")
    return places


def _read_table(sheet: Sheet, lines: list[str]) -> None:
    """Find the header below a preamble, and the statements of the preamble."""
    first = _header_row(lines)
    if first is None:
        raise StudyError(Problem(f"is no weather file: {FORMATS}", file=sheet.name))
    preamble = "\n".join(lines[:first])
    if re.search("true solar time", preamble, re.IGNORECASE):
        raise StudyError(Problem("has true solar time: get the file in universal time", file=sheet.name))
    sheet.kind = next((kind for kind, sign in _SIGNS.items() if re.search(sign, preamble, re.IGNORECASE)), "")
    if found := _SHIFT.search(preamble):
        sheet.shift = float(found[1])
    lines[first] = _COMMENT.sub("", lines[first])
    if sheet.kind == "PVGIS" and re.search(r"slope: *-", preamble, re.IGNORECASE):
        lines[first] = lines[first].replace("Gb(i)", "dni")
    _keep(sheet, lines, first, until_blank=sheet.kind == "PVGIS")
    stated = [found[1].lower() for found in _MARK.finditer(preamble)]
    sheet.mark = next((_MARKS[name] for name in [*map(variable_name, sheet.titles), *stated] if name in _MARKS), "")
    place = {found[1].lower(): float(found[2]) for found in _STATED.finditer(re.sub(r"\([^)]*\)", "", preamble))}
    place["altitude"] = place.pop("elevation", place.get("altitude", 0.0))
    zone = _stated_zone(sheet, preamble, place.get("longitude", 0.0))
    sheet.site = {"name": sheet.kind or "table", **place} | ({"timezone": zone} if zone else {})


def _header_row(lines: Sequence[str]) -> int | None:
    """Return the first line with titles of DNI and times; else of one of them, no comment; None if there is none."""
    titles = [_fields(line, separator_of(line)) for line in (_COMMENT.sub("", line) for line in lines[:_MOST_PREAMBLE])]
    keys = [_keys(row) if len(row) > 1 else set[str]() for row in titles]
    whole = (at for at, found in enumerate(keys) if "dni" in found and found & {"time", "date", "day", "hour"})
    plain = (at for at, found in enumerate(keys) if found & {"dni", "time", "date"} and not lines[at].startswith("#"))
    return next(whole, next(plain, None))


def _stated_zone(sheet: Sheet, preamble: str, longitude: float) -> str:
    """Return the offset from universal time that a service uses, or that the title of the time or a comment states."""
    if sheet.kind in ("PVGIS", "CAMS") or (sheet.kind == "NASA POWER" and "in UTC" in preamble):
        return "+00:00"
    if sheet.kind == "NASA POWER":  # local solar time
        return offset_text(round(longitude / 15))
    titles = [title for title in sheet.titles if "time" in title.lower()][:1]
    found = next(filter(None, map(_UTC.search, titles + _ZONES.findall(preamble))), None)
    hours = int(found[2] or 0) + int(found[3] or 0) / 60 if found else 0.0
    return offset_text(-hours if found[1] == "-" else hours) if found else ""


def _keep(
    sheet: Sheet, lines: Sequence[str], first: int, header: list[str] | None = None, *, until_blank: bool = False
) -> None:
    """Note header and rows from line `first` on; the header is in the file, or is given."""
    mark = sheet.separator = separator_of(lines[first]) if header is None and first < len(lines) else ","
    end = next((at for at in range(first, len(lines)) if until_blank and not lines[at].strip()), len(lines))
    kept = [at for at in range(first, end) if lines[at].strip() and not lines[at].lstrip().startswith("#")]
    if header is not None and kept:
        sheet.cells = [header, *(_fields(lines[at]) for at in kept)]
        kept = [kept[0], *kept]  # header and lines stay one to one
    elif kept:
        sheet.titles = _fields(lines[kept[0]], mark)
        while len(kept) > 2 and not any(map(_is_number, _fields(lines[kept[1]], mark))):
            del kept[1]  # rows of units
    sheet.numbers, sheet.texts = [at + 1 for at in kept], [lines[at] for at in kept]


def _is_number(cell: str) -> bool:
    return bool(re.match(r"\s*[-+.]?\d", cell))


def _fields(line: str, separator: str = ",") -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _keys(titles: Sequence[str]) -> set[str]:
    """Return the declared columns that titles name."""
    names = {variable_name(text) for title in titles for text in (title, split_title(title)[0])}
    return {key for key, column in COLUMNS.items() if names & {key, *column.names}}


def _site(kind: str, fields: Sequence[str], places: Mapping[str, int], titles: Sequence[str] = ()) -> dict[str, Any]:
    """Return name, latitude, longitude, altitude and time zone from a header. Raises ValueError."""
    width = max(places.values()) + 1
    if len(fields) < width:
        raise ValueError(f"the header has {len(fields)} fields, and {kind} files have {width}")
    got = {name: numbers([fields[place]])[0] for name, place in places.items()}
    wrong = [
        f"field {places[name] + 1}, the {name}, must be between {low:g} and {high:g} (got {fields[places[name]]!r})"
        for name, (low, high) in _BOUNDS.items()
        if name in got and not low <= got[name] <= high
    ]
    if not wrong and got["time zone"] * 60 % 1:
        wrong = [f"field {places['time zone'] + 1}, the time zone, must be whole minutes (got {got['time zone']:g} h)"]
    if wrong:
        raise ValueError("; ".join(wrong))
    zone = offset_text(got.pop("time zone"))
    city = fields[titles.index("city")] if "city" in titles else ""
    site = {name: float(value) for name, value in got.items()}
    return {"name": city.strip("- ") or fields[1] or "unnamed", **site, "timezone": zone}

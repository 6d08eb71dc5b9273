"""The sites of a study: written in the study file, in a CSV table beside it, or in the headers of weather files.

Weather files are EPW (EnergyPlus), TMY3 and PSM (NREL). Where a study names one (``site: {file: x.epw}``,
``sites: [{file: a.epw}, ...]``), its site stands in the study instead of it before anything is checked: only the header
counts for the study's identity.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from heliosweep.config.block import translate
from heliosweep.config.blocks import NamedSite, Site, SiteFile
from heliosweep.config.faults import Invalid, shown
from heliosweep.config.source import Source
from heliosweep.config.study import Study
from heliosweep.config.tables import Column, read_table
from heliosweep.config.times import CivilTime
from heliosweep.errors import Problem, StudyError
from heliosweep.files import named_in

MAX_BYTES = 2**20
_COLUMNS = {
    name: Column(declared.purpose, required=NamedSite.model_fields[name].is_required())
    for name in NamedSite.model_fields
    if (declared := NamedSite.parameter(name))
}
_NUMBERS = ("latitude", "longitude", "altitude")

#: Most of a file that is looked at, and first words of an EPW file. [bytes]
_HEAD, _EPW = 4096, "LOCATION"
#: Second line of a TMY3 file begins so, and the first one of a PSM file.
_TMY3, _PSM = "Date (MM/DD/YYYY)", "Source,Location ID,"
#: Places of the numbers in their headers, or titles, and bounds.
_PLACES = {
    "EPW": {"latitude": 6, "longitude": 7, "time zone": 8, "altitude": 9},
    "TMY3": {"latitude": 4, "longitude": 5, "time zone": 3, "altitude": 6},
}
_TITLES = {"latitude": "Latitude", "longitude": "Longitude", "time zone": "Time Zone", "altitude": "Elevation"}
_BOUNDS = {"latitude": (-90, 90), "longitude": (-180, 180), "time zone": (-14, 14), "altitude": (-500, 10_000)}


def site_table(study: Study) -> tuple[NamedSite, ...]:
    """Return the sites of a study in order; none where it has a single ``site``.

    Raises
    ------
    StudyError
        The table cannot be read; every wrong cell at its line.
    """
    sites: Any = getattr(study, "sites", None)
    if sites is None:
        return ()
    if not isinstance(sites, SiteFile):
        return sites
    path = study.resolve(sites.file)
    table = read_table(path, str(path), _COLUMNS, rows="sites", most_bytes=MAX_BYTES)
    columns = {name: table.texts(name) for name in table.header}
    found: list[NamedSite] = []
    first: dict[str, int] = {}
    for row in range(len(table)):
        cells = {name: _value(name, texts[row]) for name, texts in columns.items() if texts[row]}
        try:
            site = NamedSite.model_validate(cells)
        except ValidationError as error:
            for problem in translate(error, NamedSite, Source(cells)):
                table.add(problem.message, row, key=problem.key)
            continue
        found.append(site)
        if first.setdefault(site.name, row) != row:
            table.add(f"another site has this name (got {site.name!r})", row, key="name")
    table.finish()
    return tuple(found)


def places_of(study: Study) -> tuple[Site | NamedSite, ...]:
    """Return the single site of a study, or its sites in order; none where it has neither. Raises as `site_table`."""
    single: Site | None = getattr(study, "site", None)
    return site_table(study) if single is None else (single,)


def with_sites(study: Study) -> Study:
    """Return the study with the sites of its table in the place of the table's name, so that no file is read again."""
    table = site_table(study)
    return study.model_copy(update={"sites": table}) if table else study


def civil_clock_problems(study: Study) -> Iterator[Problem]:
    """Yield what real dates miss: the longitude of a site, or a time zone where the civil ``time`` block has none."""
    single: Any = getattr(study, "site", None)
    places = [("site", single)] if single is not None else []
    places += [(f"sites[{number}]", site) for number, site in enumerate(site_table(study))]
    for key, place in places:
        if place.longitude is None:
            yield study.problem(f"{key}.longitude", "is missing: the civil clock needs the longitude, in deg east")
    time: Any = study.time  # type: ignore[attr-defined]
    if isinstance(time, CivilTime) and time.timezone is None and any(place.timezone is None for _, place in places):
        yield study.problem("time.timezone", "is missing: the civil clock needs a time zone, such as '+08:00'")


def _value(name: str, cell: str) -> str | float:
    """Number that a cell of a column of numbers holds; its text otherwise, which may have a unit."""
    if name in _NUMBERS:
        with suppress(ValueError):
            return float(cell)
    return cell


def with_weather_sites(source: Source, problems: list[Problem]) -> Source:
    """Return the study as it was written with the sites of the weather files that it names in their place.

    `problems` takes what is wrong with the files; a site of no consequence stands for such a file.
    """

    def filled(entry: Any, *place: str | int) -> Any:
        """The site of an entry: from the header of its file, and what is given beside it, which counts more."""
        if not (isinstance(entry, dict) and "file" in entry):
            return entry
        # Stands for a site that is wrong, so that nothing else is said of it.
        found: dict[str, Any] = {"name": f"site {place}", "latitude": 0.0, "longitude": 0.0, "timezone": "+00:00"}
        try:
            found = _weather_site(source.directory, entry["file"])
        except Invalid as error:
            problems.append(source.problem(place, f"{error} (got {shown(entry['file'])})"))
        except StudyError as error:
            problems.extend(error.problems)
        return found | {key: value for key, value in entry.items() if key != "file"}

    site, sites = source.data.get("site"), source.data.get("sites")
    names = sites["file"] if isinstance(sites, dict) and list(sites) == ["file"] else None
    new: dict[str, Any] = {}
    if isinstance(site, dict) and "file" in site:
        new["site"] = {key: value for key, value in filled(site, "site", "file").items() if key != "name"}
    if isinstance(sites, list):
        new["sites"] = [filled(entry, "sites", number, "file") for number, entry in enumerate(sites)]
    elif isinstance(names, list) and names:
        new["sites"] = [filled({"file": name}, "sites", "file", number) for number, name in enumerate(names)]
    elif isinstance(names, str) and weather_kind(_head(named_in(source.directory, names))):  # else a table of sites
        new["sites"] = [filled({"file": names}, "sites", "file")]
    return replace(source, data={**source.data, **new}) if new else source


def _weather_site(folder: Path, name: Any) -> dict[str, Any]:
    """Site of a weather file. Raises Invalid for what is none, and StudyError for one that is wrong."""
    if not isinstance(name, str) or not name.strip():
        raise Invalid("must be the name of a weather file, EPW, TMY3 or PSM")
    head = _head(named_in(folder, name))
    if not head:
        raise Invalid("no such file, looked for relative to the study file")
    if not weather_kind(head):
        raise Invalid(f"is no EPW, TMY3 or PSM file: {BEGINNINGS}")
    try:
        return header_site(head)
    except ValueError as error:
        raise StudyError(Problem(str(error), file=str(named_in(folder, name)), line=1)) from None


def _head(file: Path) -> str:
    """First two lines of a file; none where it cannot be read."""
    try:
        if not file.is_file():  # reading a pipe would wait
            return ""
        with file.open("rb") as stream:
            data = stream.read(_HEAD)
    except (OSError, ValueError):
        return ""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # names of places, in files of which nobody says the encoding
    return "\n".join(text.replace("\r\n", "\n").replace("\r", "\n").split("\n")[:2])


#: How to tell weather files apart.
BEGINNINGS = f"an EPW file begins with {_EPW}, a TMY3 file with its station, a PSM file with {_PSM.strip(',')}"


def weather_kind(head: str) -> str:
    """Kind of the weather file that begins with two lines: ``EPW``, ``TMY3``, ``PSM``, or empty for any other file."""
    first, _, second = head.partition("\n")
    if first.split(",")[0].strip() == _EPW:
        return "EPW"
    if second.strip().strip('"').startswith(_TMY3):
        return "TMY3"
    return "PSM" if first.replace('"', "").startswith(_PSM) else ""


def header_site(head: str) -> dict[str, Any]:
    """Name, latitude, longitude, altitude and time zone from the first two lines of a weather file.

    ``LOCATION,city,state,country,source,WMO,latitude,longitude,time zone,altitude`` of an EPW file;
    ``USAF,"station",state,time zone,latitude,longitude,altitude`` of a TMY3 file; fields of a PSM file by their titles
    on its first line: deg north and east, hours ahead of UTC, metres (EnergyPlus, Auxiliary Programs; Wilcox and Marion
    2008, NREL/TP-581-43156; pvlib.iotools.read_nsrdb_psm4). Raises ValueError.
    """
    kind = weather_kind(head)
    first, _, second = head.partition("\n")
    if kind == "PSM":
        titles = first.replace('"', "").split(",")
        if missing := [title for title in _TITLES.values() if title not in titles]:
            raise ValueError(f"the header has no field {missing[0]!r}")
        places = {name: titles.index(title) for name, title in _TITLES.items()}
    else:
        places = _PLACES[kind]
    fields = [field.strip() for field in (second if kind == "PSM" else first).split(",")]
    width = max(places.values()) + 1
    if len(fields) < width:
        raise ValueError(f"the header has {len(fields)} fields where that of {kind} files has {width}")
    values: dict[str, float] = {}
    wrong: list[str] = []
    for name, place in sorted(places.items(), key=itemgetter(1)):
        low, high = _BOUNDS[name]
        with suppress(ValueError):
            values[name] = float(fields[place])
        got = f"(got {fields[place]!r})"
        if not low <= values.get(name, float("nan")) <= high:
            wrong.append(f"field {place + 1}, the {name}, must be between {low:g} and {high:g} {got}")
        elif name == "time zone" and values[name] * 60 % 1:
            wrong.append(f"field {place + 1}, the {name}, must be whole minutes, in hours {got}")
    if wrong:
        raise ValueError("; ".join(wrong))
    minutes = round(abs(values["time zone"]) * 60)
    offset = f"{'-' if values.pop('time zone') < 0 else '+'}{minutes // 60:02}:{minutes % 60:02}"
    return {"name": fields[1].strip('"').strip() or "unnamed", **values, "timezone": offset}

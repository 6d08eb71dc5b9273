"""The sites of a study: written in the study file, in a CSV table, or in the headers of weather files.

If a study names a weather file (``site: {file: x.epw}``, ``sites: [{file: a.epw}, ...]``), its site replaces the name
before the study is checked: only the header counts for the study's identity.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from heliosweep.config.block import translate
from heliosweep.config.blocks import NamedSite, Site, SiteFile
from heliosweep.config.faults import Invalid, few_of, shown
from heliosweep.config.source import Source
from heliosweep.config.study import Study
from heliosweep.config.tables import Column, Table, read_table
from heliosweep.config.times import CivilTime
from heliosweep.config.weather_formats import FORMATS, parse_weather
from heliosweep.errors import Problem, StudyError
from heliosweep.files import named_in

MAX_BYTES = 2**20
_NUMBERS = {"latitude", "longitude", "altitude"}
#: Other titles of the columns of a table of sites.
_NAMES = {
    "name": ("site", "station", "location", "site_name"),
    "latitude": ("lat",),
    "longitude": ("lon", "lng", "long"),
    "altitude": ("elevation", "elev", "height_above_sea_level"),
    "timezone": ("time_zone", "tz", "utc_offset"),
}
_COLUMNS = {
    name: Column(getattr(NamedSite.parameter(name), "purpose", ""), name in ("name", "latitude"), names=names)
    for name, names in _NAMES.items()
}


def site_table(study: Study) -> tuple[NamedSite, ...]:
    """Return the sites of a study in order; none if it has a single ``site``.

    Raises
    ------
    StudyError
        If the table cannot be read; with every wrong cell at its line.
    """
    sites: Any = getattr(study, "sites", None)
    if not isinstance(sites, SiteFile):
        return sites or ()
    table = _table(study, sites)
    columns = {name: table.texts(name) for name in table.header if name in _COLUMNS}
    found: list[NamedSite] = []
    for row in range(len(table)):
        cells: dict[str, Any] = {name: texts[row] for name, texts in columns.items() if texts[row]}
        for name in _NUMBERS & cells.keys():
            with suppress(ValueError):  # text can have a unit
                cells[name] = float(cells[name])
        try:
            site = NamedSite.model_validate(cells)
            if any(site.name == other.name for other in found):
                table.add(f"another site has this name (got {site.name!r})", row, key="name")
            found.append(site)
        except ValidationError as error:
            for problem in translate(error, NamedSite, Source(cells)):
                table.add(problem.message, row, key=problem.key)
    table.finish()
    return tuple(found)


def _table(study: Study, sites: SiteFile) -> Table:
    path = study.resolve(sites.file)
    return read_table(path, str(path), _COLUMNS, others=True, rows="sites", most_bytes=MAX_BYTES)


def site_notes(study: Study) -> Iterator[str]:
    """Yield a warning that lists the columns of the table of sites that are not used."""
    sites: Any = getattr(study, "sites", None)
    if isinstance(sites, SiteFile) and (unused := _table(study, sites).unused()):
        yield f"{sites.file}: columns that are not used: {few_of(unused)}"


def places_of(study: Study) -> tuple[Site | NamedSite, ...]:
    """Return the single site of a study, or its sites in order; none if it has neither. Raises as `site_table`."""
    single: Site | None = getattr(study, "site", None)
    return site_table(study) if single is None else (single,)


def with_sites(study: Study) -> Study:
    """Return the study with the sites of its table instead of the table's name, so that no file is read again."""
    table = site_table(study)
    return study.model_copy(update={"sites": table}) if table else study


def civil_clock_problems(study: Study) -> Iterator[Problem]:
    """Yield problems of real dates: a site without longitude, or without time zone if ``time`` has none."""
    single: Any = getattr(study, "site", None)
    places = [("site", single)] if single is not None else []
    places += [(f"sites[{number}]", site) for number, site in enumerate(site_table(study))]
    for key, place in places:
        if place.longitude is None:
            yield study.problem(f"{key}.longitude", "is missing: the civil clock needs the longitude, in deg east")
    time: Any = study.time  # type: ignore[attr-defined]
    if isinstance(time, CivilTime) and time.timezone is None and any(place.timezone is None for _, place in places):
        yield study.problem("time.timezone", "is missing: the civil clock needs a time zone, such as '+08:00'")


def with_weather_sites(source: Source, problems: list[Problem]) -> Source:
    """Return the study with the sites of the weather files that it names instead of their names.

    Problems of the files are added to `problems`, and a dummy site replaces such a file.
    """

    def filled(entry: Any, *place: str | int) -> Any:
        """Return the site of an entry: from the header of its file, and from its other keys, which override it."""
        if not (isinstance(entry, dict) and "file" in entry):
            return entry
        # A dummy site, so that nothing else is reported of it.
        found: dict[str, Any] = {"name": f"site {place}", "latitude": 0.0, "longitude": 0.0, "timezone": "+00:00"}
        try:
            found = _weather_site(source.directory, entry["file"])
        except Invalid as error:
            problems.append(source.problem(place, f"{error} (got {shown(entry['file'])})"))
        except StudyError as error:
            problems.extend(error.problems)
        return found | {key: value for key, value in entry.items() if key != "file"}

    site, sites = source.data.get("site"), source.data.get("sites")
    new: dict[str, Any] = {}
    if isinstance(site, dict) and "file" in site:
        new["site"] = {key: value for key, value in filled(site, "site", "file").items() if key != "name"}
    if isinstance(sites, list):
        new["sites"] = [filled(entry, "sites", number, "file") for number, entry in enumerate(sites)]
    elif isinstance(sites, dict) and list(sites) == ["file"]:
        names = sites["file"]
        if isinstance(names, list) and names:
            new["sites"] = [filled({"file": name}, "sites", "file", number) for number, name in enumerate(names)]
        elif isinstance(names, str) and _is_weather(named_in(source.directory, names)):
            new["sites"] = [filled(sites, "sites", "file")]
    return replace(source, data={**source.data, **new}) if new else source


def _is_weather(path: Path) -> bool:
    """Return False for a table of sites, and for a file that cannot be read."""
    try:
        return bool(parse_weather(path).kind)
    except StudyError as error:
        return any(problem.line for problem in error.problems)  # a wrong header of a weather file


def _weather_site(folder: Path, name: Any) -> dict[str, Any]:
    """Return the site of a weather file. Raises Invalid if it names none, and StudyError if its header is wrong."""
    if not isinstance(name, str) or not name.strip():
        raise Invalid("must be the name of a weather file, such as EPW, TMY3 or PSM")
    path = named_in(folder, name)
    if not os.path.isfile(path):  # noqa: PTH113 -- False for names that no file can have
        raise Invalid("no such file, looked for relative to the study file")
    try:
        site = parse_weather(path).site
    except StudyError as error:
        if error.problems[0].line:
            raise
        raise Invalid(error.problems[0].message) from None
    if "latitude" not in site or "longitude" not in site:
        raise Invalid(f"has no latitude and longitude in its header: {FORMATS}")
    return site

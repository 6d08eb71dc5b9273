"""Sites from the headers of weather files: EPW (EnergyPlus) and TMY3 (NREL), read by pvlib.

Where a study names a weather file (``site: {file: x.epw}``, ``sites: [{file: a.epw}, ...]``), its site stands in the
study instead of it before anything is checked: only the header counts for the study's identity.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from heliosweep.config.faults import shown
from heliosweep.config.source import Source
from heliosweep.errors import Problem

#: Most of a file that is looked at, and first words of an EPW file. [bytes]
_HEAD, _EPW = 4096, "LOCATION"
#: Second line of a TMY3 file begins so.
_TMY3 = "Date (MM/DD/YYYY)"
_USED = ("name", "latitude", "longitude", "altitude", "timezone")

#: What pvlib's readers want behind the header, of which we want nothing: the rest of the headers, and one hour.
_EPW_REST = "-\n" * 7 + "2001,1,1,1,0,-" + ",0" * 29 + "\n"
_TMY3_REST = f"{_TMY3},Time (HH:MM)\n01/01/2001,01:00\n"


class Unreadable(Exception):
    """A weather file whose header is wrong."""


def with_weather_sites(source: Source, problems: list[Problem]) -> Source:
    """Put the sites of the weather files that a study names in their place.

    Parameters
    ----------
    source : Source
        The study as it was written.
    problems : list of Problem
        Takes what is wrong with the files; a site of no consequence stands for such a file.

    Returns
    -------
    Source
        The same object where no weather file is named.
    """
    found: dict[str, Any] = {}
    site, sites = source.data.get("site"), source.data.get("sites")
    if isinstance(site, dict) and "file" in site:
        merged = _merged(source, ("site",), site, problems, required=True) or {}
        found["site"] = {key: value for key, value in merged.items() if key != "name"}
    if isinstance(sites, list):
        entries = [
            (_merged(source, ("sites", place), entry, problems, required=True) or entry)
            if isinstance(entry, dict) and "file" in entry
            else entry
            for place, entry in enumerate(sites)
        ]
        found |= {"sites": entries} if entries != sites else {}
    elif isinstance(sites, dict) and list(sites) == ["file"]:
        names = sites["file"] if isinstance(sites["file"], list) else [sites["file"]]
        several = isinstance(sites["file"], list)
        listed = [
            _merged(source, ("sites", "file", *((place,) if several else ())), {"file": name}, problems, several)
            for place, name in enumerate(names)
        ]
        if listed and all(listed):
            found["sites"] = listed
    return replace(source, data={**source.data, **found}) if found else source


def _merged(
    source: Source, path: tuple[str | int, ...], entry: dict[str, Any], problems: list[Problem], required: bool
) -> dict[str, Any] | None:
    """Return a site with what the header of its file says and what is given beside it, which counts more."""
    name, given = entry["file"], {key: value for key, value in entry.items() if key != "file"}
    place = (*path, "file") if path[-1] != "file" and "file" not in path else path
    if not isinstance(name, str) or not name.strip():
        problems.append(source.problem(place, f"must be the name of a weather file, EPW or TMY3 (got {shown(name)})"))
        return _nowhere(path) | given
    file = source.directory / name
    try:
        head = _head(file)
    except (OSError, ValueError):
        if required:
            what = f"no such file, looked for relative to the study file (got {shown(name)})"
            problems.append(source.problem(place, what))
            return _nowhere(path) | given
        return None
    if not is_weather(head):
        if not required:
            return None
        message = f"is no EPW or TMY3 file: an EPW file begins with {_EPW}, a TMY3 file with its station (got {name})"
        problems.append(source.problem(place, message))
        return _nowhere(path) | given
    try:
        return dict(header_site(head)) | given
    except Unreadable as error:
        problems.append(Problem(str(error), file=str(file), line=1))
        return _nowhere(path) | given


def _nowhere(path: tuple[str | int, ...]) -> dict[str, Any]:
    """Return a site that stands for one that is wrong, so that nothing else is said of it."""
    return {"name": f"site {path[-1]}", "latitude": 0.0, "longitude": 0.0, "timezone": "+00:00"}


def _head(file: Path) -> str:
    """Return the first two lines. Raises OSError, and ValueError for what cannot be a name."""
    if not file.is_file():  # reading a pipe would wait
        raise FileNotFoundError
    with file.open("rb") as stream:
        data = stream.read(_HEAD)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # names of places, in files of which nobody says the encoding
    return "\n".join(text.replace("\r\n", "\n").replace("\r", "\n").split("\n")[:2])


def is_weather(head: str) -> bool:
    """Whether the first two lines of a file are those of an EPW or TMY3 file."""
    first, _, second = head.partition("\n")
    return first.split(",")[0].strip() == _EPW or second.strip().strip('"').startswith(_TMY3)


@lru_cache(maxsize=256)
def header_site(head: str) -> dict[str, Any]:
    """Return name, latitude, longitude, altitude and time zone from the first two lines of a weather file.

    Parameters
    ----------
    head : str
        ``LOCATION,city,state,country,source,WMO,latitude,longitude,time zone,altitude`` of an EPW file, or
        ``USAF,"station",state,time zone,latitude,longitude,altitude`` of a TMY3 file: deg north and east, hours
        ahead of UTC, metres (EnergyPlus, Auxiliary Programs; Wilcox and Marion 2008, NREL/TP-581-43156).

    Raises
    ------
    Unreadable
        Says what is wrong with the header.
    """
    first = head.partition("\n")[0]
    epw = first.split(",")[0].strip() == _EPW
    names = {6: "latitude", 7: "longitude", 8: "time zone", 9: "altitude"}
    names = names if epw else {3: "time zone", 4: "latitude", 5: "longitude", 6: "altitude"}
    fields = first.split(",")
    kind, width = ("EPW", 10) if epw else ("TMY3", 7)
    if len(fields) < width:
        raise Unreadable(f"the header has {len(fields)} fields where that of {kind} files has {width}")
    problems = list(_wrong(fields, names))
    if problems:
        raise Unreadable("; ".join(problems))
    from pvlib import iotools

    try:
        if epw:
            meta = iotools.read_epw(io.StringIO(f"{first}\n{_EPW_REST}"))[1]
        else:
            meta = iotools.read_tmy3(io.StringIO(f"{first}\n{_TMY3_REST}"), map_variables=True)[1]
    except Exception as error:  # whatever another package says of a file that it cannot read
        raise Unreadable(f"pvlib cannot read the header: {error}") from error
    name = str(meta["city" if epw else "Name"]).strip().strip('"').strip()
    values = (name or "unnamed", meta["latitude"], meta["longitude"], meta["altitude"], _offset(meta["TZ"]))
    return dict(zip(_USED, values, strict=True))


_BOUNDS = {"latitude": (-90, 90), "longitude": (-180, 180), "time zone": (-14, 14), "altitude": (-500, 10_000)}


def _wrong(fields: list[str], names: dict[int, str]) -> Iterator[str]:
    for place, name in names.items():
        low, high = _BOUNDS[name]
        try:
            value = float(fields[place])
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            yield f"field {place + 1}, the {name}, must be between {low:g} and {high:g} (got {fields[place].strip()!r})"
        elif name == "time zone" and value * 60 % 1:
            yield f"field {place + 1}, the {name}, must be whole minutes, in hours (got {fields[place].strip()!r})"


def _offset(hours: float) -> str:
    """Return hours ahead of UTC as an offset such as ``+05:30``."""
    minutes = round(abs(hours) * 60)
    return f"{'-' if hours < 0 else '+'}{minutes // 60:02}:{minutes % 60:02}"

"""Define the blocks for sites, weather and operating limits, and read sites from tables and weather files.

If a site is given as a weather file, as in ``site: {file: x.epw}`` or ``sites: [{file: a.epw}, ...]``, the site data in
the header of the file replace the file name before the study is checked. The study id therefore depends only on the
site data in the header.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any, ClassVar

from pydantic import Discriminator, Field, Tag, ValidationError

from heliosweep.config.blocks import Block, translate
from heliosweep.config.faults import Fault, Path, few_of, shown, when
from heliosweep.config.source import Source, scalar
from heliosweep.config.study import Study
from heliosweep.config.tables import Column, Table, read_table
from heliosweep.config.times import CivilTime, TimeZone
from heliosweep.config.values import Choice, FileName, Quantity, Sweep, Text, ends
from heliosweep.config.weather_files import FORMATS, parse_weather, weather_of
from heliosweep.errors import Problem, StudyError, log
from heliosweep.files import named_in

_LATITUDE = Quantity(
    "Geographic latitude, positive north", "deg", ge=-90, le=90, title="latitude", standard_name="latitude"
)
_LONGITUDE = Quantity(
    "Geographic longitude, positive east; required for the civil clock",
    "deg", ge=-180, le=180, title="longitude", standard_name="longitude",
)  # fmt: skip
_ALTITUDE = Quantity(
    "Height above sea level", "m", ge=-500, le=10_000, title="altitude", standard_name="altitude"
)  # fmt: skip
_TIMEZONE = TimeZone(
    "Time zone: an offset such as +08:00, or an IANA name; required for the civil clock if 'time' has no time zone"
)  # fmt: skip
_FILE = FileName("EPW, TMY3 or PSM weather file whose header supplies the omitted keys", sweep=False)


class Site(Block):
    """Site of the plant."""

    latitude: Annotated[float | Sweep, _LATITUDE]
    longitude: Annotated[float | Sweep | None, _LONGITUDE] = None
    altitude: Annotated[float | Sweep, _ALTITUDE] = 0.0
    timezone: Annotated[str | None, _TIMEZONE] = None
    file: Annotated[str | None, _FILE] = None


class NamedSite(Block):
    """Site in a list of several sites."""

    name: Annotated[str, Text("Name of the site, used as its label in the result")]
    latitude: Annotated[float, replace(_LATITUDE, sweep=False)]
    longitude: Annotated[float | None, replace(_LONGITUDE, sweep=False)] = None
    altitude: Annotated[float, replace(_ALTITUDE, sweep=False)] = 0.0
    timezone: Annotated[str | None, _TIMEZONE] = None
    file: Annotated[str | None, _FILE] = None


class SiteFile(Block):
    """A table of sites."""

    file: Annotated[
        str,
        FileName(
            "CSV table of sites with the columns name and latitude, and optionally longitude, altitude and timezone",
            sweep=False,
        ),
    ]


def _sites_form(raw: Any) -> str | None:
    if isinstance(raw, list | tuple):
        return "list"
    if isinstance(raw, dict) and any(isinstance(value, dict) for value in raw.values()):
        return None  # sites must be a list, not a mapping by name
    return "table" if isinstance(raw, dict | SiteFile) else None


Sites = Annotated[
    Annotated[tuple[NamedSite, ...], Field(min_length=1), Tag("list")] | Annotated[SiteFile, Tag("table")],
    Discriminator(
        _sites_form,
        custom_error_type="fault",
        custom_error_message="must be a list of sites, such as [{file: a.epw}, {file: b.epw}], or {file: NAME.csv}",
    ),
    Field(description="Several named sites: a list, or a CSV table"),
]


def _of(model: str, title: str, default: str, unit: str, low: float, high: float) -> Quantity:
    description = f"{title[0].upper()}{title[1:]} for the {model} model (default: {default})"
    return Quantity(description, unit, ge=low, le=high, title=title)


class ClearSky(Block):
    """Irradiance under a cloudless sky."""

    model: Annotated[
        str | Sweep,
        Choice(
            "Clear-sky model",
            {
                "ineichen": "Ineichen and Perez (2002), from the Linke turbidity",
                "simplified_solis": "Ineichen (2008), from the aerosol optical depth and precipitable water",
                "meinel": "Meinel and Meinel (1976): 1367 * 0.7^(AM^0.678) W/m2, where AM is the air mass",
                "ashrae": "ASHRAE (1972): A exp(-B / sin(elevation)), with monthly values of A and B",
            },
            dimension="clear_sky_model",
            title="clear-sky model",
        ),
    ]
    linke_turbidity: Annotated[
        float | Sweep | None,
        _of("ineichen", "Linke turbidity", "the value in pvlib's table for the site and date", "1", 1, 20),
    ] = None
    aerosol_optical_depth: Annotated[
        float | Sweep | None,
        _of("simplified_solis", "aerosol optical depth at 700 nm", "0.1", "1", 0, 0.45),
    ] = None
    precipitable_water: Annotated[
        float | Sweep | None,
        _of("simplified_solis", "precipitable water", "1 cm", "cm", 0.2, 10),
    ] = None

    def rules(self) -> Iterator[Fault]:
        """Check that the clear-sky model uses the given atmospheric keys."""
        return when(
            *((getattr(self, key) is not None and model not in ends(self.model),
               Fault(f"is used only by the {model} model: remove it", (key,))) for key, model in KEYS_OF.items())
        )  # fmt: skip


#: Clear-sky model that uses each atmospheric key.
KEYS_OF = {
    "linke_turbidity": "ineichen",
    "aerosol_optical_depth": "simplified_solis",
    "precipitable_water": "simplified_solis",
}
#: Dimensions of swept keys in the blocks `weather` and `limits`.
DIMENSIONS = ("weather", "clear_sky_model", *KEYS_OF, "dni_limit", "sun_elevation_limit", "wind_speed_limit")


class Weather(Block):
    """Source of the direct normal irradiance: a weather file or a clear-sky model."""

    ONE_OF: ClassVar = ("file", "clear_sky")

    file: Annotated[
        str | Sweep | None,
        FileName(
            "Weather file: EPW, TMY3, SAM CSV (PSM of the NSRDB), PVGIS, CAMS, NASA POWER, Solargis, SolarAnywhere, "
            "or a CSV file with columns for the time, dni [W/m2] and optionally wind_speed [m/s]. For several "
            "'sites', give one file for each site, in the order of the sites, or one file for all sites",
            sweep=True, dimension="weather", title="weather file",
        ),
    ] = None  # fmt: skip
    label: Annotated[
        str | None,
        Choice(
            "Part of the interval to which the time of a row refers (default: the convention of the format)",
            {"start": "start of the interval", "middle": "middle of the interval", "end": "end of the interval"},
            sweep=False,
        ),
    ] = None
    offset: Annotated[
        float | None,
        Quantity(
            (
                "Offset added to the time of a row to obtain the instant at which the sun position is computed; "
                "replaces 'label'"
            ), "h", ge=-2, le=2, sweep=False
        ),
    ] = None  # fmt: skip
    timezone: Annotated[
        str | None,
        TimeZone(
            "Time zone of times that are written without a UTC offset: an offset such as +08:00, or an IANA name "
            "(default: the zone in the file)"
        ),
    ] = None  # fmt: skip
    dni_factor: Annotated[
        float | Sweep | None,
        Quantity((
            "Factor applied to the direct normal irradiance, for example to represent interannual variation or a "
            "sensor error (default: 1)"
        ),
                 "1", gt=0, le=2, title="factor on the direct normal irradiance"),
    ] = None  # fmt: skip
    clear_sky: Annotated[
        ClearSky | None, Field(description="Clear-sky model instead of a file; requires 'clock: civil'")
    ] = None

    def rules(self) -> Iterator[Fault]:
        """Check that keys for weather files are given only with a file, and that `offset` is not given with `label`."""
        return when(
            *((self.file is None and getattr(self, key) is not None,
               Fault("applies only to a weather file: remove it", (key,))) for key in ("label", "offset", "timezone")),
            (self.label is not None and self.offset is not None,
             Fault("give either 'label' or 'offset', not both", ("offset",))),
        )  # fmt: skip


class Limits(Block):
    """Conditions under which the field operates."""

    dni: Annotated[
        float | Sweep | None,
        Quantity("Minimum direct normal irradiance", "W/m2", ge=0, le=1412, dimension="dni_limit",
                 title="minimum direct normal irradiance"),
    ] = None  # fmt: skip
    sun_elevation: Annotated[
        float | Sweep | None,
        Quantity("Minimum elevation of the sun", "deg", ge=0, le=90, dimension="sun_elevation_limit",
                 title="minimum elevation of the sun"),
    ] = None  # fmt: skip
    wind_speed: Annotated[
        float | Sweep | None,
        Quantity("Maximum wind speed; the field also operates if the wind speed is unknown", "m/s", gt=0, le=100,
                 dimension="wind_speed_limit", title="maximum wind speed"),
    ] = None  # fmt: skip


#: Columns of a site table, with their alternative titles.
_COLUMNS = {
    name: Column(getattr(NamedSite.parameter(name), "purpose", ""), name in ("name", "latitude"), names=names)
    for name, names in {
        "name": ("site", "station", "location", "site_name"),
        "latitude": ("lat",),
        "longitude": ("lon", "lng", "long"),
        "altitude": ("elevation", "elev", "height_above_sea_level"),
        "timezone": ("time_zone", "tz", "utc_offset"),
    }.items()
}


def site_table(study: Study) -> tuple[NamedSite, ...]:
    """Return the named sites of a study in order. The tuple is empty if the study has a single ``site``.

    Raises
    ------
    StudyError
        If the table cannot be read. The message lists every invalid cell with its line.
    """
    sites: Any = getattr(study, "sites", None)
    if not isinstance(sites, SiteFile):
        return sites or ()
    table = _table(study, sites)
    columns = {name: table.texts(name) for name in table.header if name in _COLUMNS}
    found: list[NamedSite] = []
    for row in range(len(table)):
        cells = {
            name: scalar(texts[row]) if name in ("latitude", "longitude", "altitude") else texts[row]
            for name, texts in columns.items()
        }
        cells = {name: cell for name, cell in cells.items() if cell not in (None, "")}
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
    return read_table(path, str(path), _COLUMNS, others=True, rows="sites", most_bytes=2**20)


def site_notes(study: Study) -> Iterator[Problem | str]:
    """Yield a problem for each duplicate site name, and a warning for unused columns of the site table."""
    sites: Any = getattr(study, "sites", None)
    if isinstance(sites, SiteFile) and (unused := _table(study, sites).unused()):
        yield f"{sites.file}: ignored columns: {few_of(unused)}"
    first: dict[str, int] = {}
    for position, site in enumerate(sites if isinstance(sites, tuple) else ()):
        if first.setdefault(site.name, position) != position:
            yield study.problem(f"sites[{position}].name", f"another site has this name (got {shown(site.name)})")


def places_of(study: Study) -> tuple[Site | NamedSite, ...]:
    """Return all sites of a study in order. The tuple is empty if the study has no sites. Raises StudyError."""
    single: Site | None = getattr(study, "site", None)
    return site_table(study) if single is None else (single,)


def with_inputs(study: Study) -> Study:
    """Return the study with its sites and weather files attached, so that the files are not read again."""
    table = site_table(study)
    copied = study.model_copy(update={"sites": table} if table else {})
    copied._weather = weather_of(study)
    return copied


def civil_clock_problems(study: Study) -> Iterator[Problem]:
    """Yield the problems of a study with a civil clock: missing longitudes and a missing time zone."""
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
    """Replace the weather files of sites with the site data in the file headers.

    Problems with weather files are added to `problems`. Each invalid weather file is replaced with a dummy site.
    """
    site, sites = source.data.get("site"), source.data.get("sites")
    new: dict[str, Any] = {}
    if isinstance(site, dict) and "file" in site:
        new["site"] = _filled(source, site, ("site", "file"), problems)
        new["site"].pop("name", None)
    if isinstance(sites, dict) and isinstance(sites.get("file"), list):
        log.warning("sites: {file: [a.epw, b.epw]} is deprecated; write sites: [{file: a.epw}, {file: b.epw}]")
        sites = [{"file": name} for name in sites["file"]]
    if isinstance(sites, list):
        new["sites"] = [_filled(source, entry, ("sites", at, "file"), problems) for at, entry in enumerate(sites)]
    return replace(source, data={**source.data, **new}) if new else source


def _filled(source: Source, entry: Any, place: Path, problems: list[Problem]) -> Any:
    """Return the site data in the header of an entry's weather file. Keys of the entry override the header data."""
    if not (isinstance(entry, dict) and "file" in entry):
        return entry
    # Use a dummy site to avoid reporting consequential problems.
    site: dict[str, Any] = {"name": f"site {place}", "latitude": 0.0, "longitude": 0.0, "timezone": "+00:00"}
    name, message = entry["file"], ""
    try:
        if not isinstance(name, str) or not name.strip():
            message = "must be the name of a weather file, such as EPW, TMY3 or PSM"
        elif not os.path.isfile(path := named_in(source.directory, name)):  # noqa: PTH113 -- False for invalid names
            message = "no such file, relative to the study file"
        elif {"latitude", "longitude"} <= (found := parse_weather(path).site).keys():
            site = found
        else:
            message = f"has no latitude and longitude in its header: {FORMATS}"
    except StudyError as error:
        located = any(problem.line for problem in error.problems)
        problems.extend(error.problems if located else ())
        message = "" if located else error.problems[0].message
    if message:
        problems.append(source.problem(place, f"{message} (got {shown(name)})"))
    return site | {key: value for key, value in entry.items() if key != "file"}

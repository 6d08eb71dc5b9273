"""Blocks of a study file that families share. A family adds its own in the same way."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag

from heliosweep.config.block import Block
from heliosweep.config.execution import Execution
from heliosweep.config.faults import Fault, to_pydantic
from heliosweep.config.layouts import Layout
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import CivilTime, SolarTime, Time, TimeZone
from heliosweep.config.values import Choice, FileName, Flag, Quantity, Text

__all__ = [
    "Block", "CivilTime", "Execution", "Heliostat", "Layout", "NamedSite", "Output", "Receiver", "Report", "Site",
    "SiteFile", "Sites", "SolarTime", "Time",
]  # fmt: skip

_LATITUDE = Quantity(
    "Geographic latitude, positive north", "deg", ge=-90, le=90, title="latitude", standard_name="latitude"
)
_LONGITUDE = Quantity(
    "Geographic longitude, positive east; needed for the civil clock",
    "deg", ge=-180, le=180, title="longitude", standard_name="longitude",
)  # fmt: skip
_ALTITUDE = Quantity(
    "Height above sea level", "m", ge=-500, le=10_000, title="altitude", standard_name="altitude"
)  # fmt: skip
_TIMEZONE = TimeZone(
    "Time zone, an offset (+08:00) or an IANA name; needed for the civil clock where 'time' has none"
)  # fmt: skip


_FILE = FileName("EPW, TMY3 or PSM weather file whose header supplies the keys that are omitted", sweep=False)


def _or_weather_file(schema: dict[str, Any]) -> None:
    """Let a weather file replace the keys that are required: see `config.sites`."""
    schema["anyOf"] = [{"required": schema.pop("required")}, {"required": ["file"]}]


class Site(Block):
    """Place of the plant."""

    model_config = ConfigDict(json_schema_extra=_or_weather_file)

    latitude: Annotated[float | Sweep, _LATITUDE]
    longitude: Annotated[float | Sweep | None, _LONGITUDE] = None
    altitude: Annotated[float | Sweep, _ALTITUDE] = 0.0
    timezone: Annotated[str | None, _TIMEZONE] = None
    file: Annotated[str | None, _FILE] = None


class NamedSite(Block):
    """One of several sites."""

    model_config = ConfigDict(json_schema_extra=_or_weather_file)

    name: Annotated[str, Text("Name of the site, its label in the result")]
    latitude: Annotated[float, replace(_LATITUDE, sweep=False)]
    longitude: Annotated[float | None, replace(_LONGITUDE, sweep=False)] = None
    altitude: Annotated[float, replace(_ALTITUDE, sweep=False)] = 0.0
    timezone: Annotated[str | None, _TIMEZONE] = None
    file: Annotated[str | None, _FILE] = None


def _or_weather_files(schema: dict[str, Any]) -> None:
    """Allow a list of weather files: their sites replace them before the study is checked."""
    properties = schema["properties"]
    name = properties["file"]
    properties["file"] = {"anyOf": [name, {"type": "array", "items": name, "minItems": 1}]}


class SiteFile(Block):
    """A table of sites."""

    model_config = ConfigDict(json_schema_extra=_or_weather_files)

    file: Annotated[
        str,
        FileName("CSV table of sites, columns name, latitude and optional longitude, altitude, timezone; or weather "
                  "files, EPW, TMY3 or PSM, whose headers contain the sites", sweep=False),
    ]  # fmt: skip


def _distinct(sites: tuple[NamedSite, ...]) -> tuple[NamedSite, ...]:
    positions: dict[str, int] = {}
    faults = [
        Fault("another site has this name", (position, "name"))
        for position, site in enumerate(sites)
        if positions.setdefault(site.name, position) != position
    ]
    if faults:
        raise to_pydantic(faults)
    return sites


def _sites_form(raw: Any) -> str | None:
    if isinstance(raw, list | tuple):
        return "list"
    if isinstance(raw, dict) and any(isinstance(value, dict) for value in raw.values()):
        return None  # sites by name: they belong in a list
    return "table" if isinstance(raw, dict | SiteFile) else None


Sites = Annotated[
    Annotated[tuple[NamedSite, ...], Field(min_length=1), AfterValidator(_distinct), Tag("list")]
    | Annotated[SiteFile, Tag("table")],
    Discriminator(
        _sites_form, custom_error_type="fault", custom_error_message="must be a list of named sites or {file: NAME.csv}"
    ),
    Field(description="Several named sites: a list, or a CSV table"),
]


class Receiver(Block):
    """The aim of all heliostats: a point on the tower."""

    height: Annotated[
        float | Sweep,
        Quantity(
            "Height of the aim point above the tower's base", "m", gt=0, dimension="receiver_height",
            title="receiver height",
        ),
    ]  # fmt: skip


def _side(side: str) -> Quantity:
    description = f"{side.title()} of the mirror; omit it to use the column '{side}' of the layout"
    return Quantity(description, "m", gt=0, dimension=f"heliostat_{side}", title=f"mirror {side}")


class Heliostat(Block):
    """The mirror of every heliostat, one flat rectangle."""

    width: Annotated[float | Sweep | None, _side("width")] = None
    height: Annotated[float | Sweep | None, _side("height")] = None
    pivot_height: Annotated[
        float | Sweep | None,
        Quantity(
            "Height of the mirror centre above the heliostat's base at z of the layout; omit it to use the column "
            "'pivot_height' of the layout; 0 if z is the height of the centre",
            "m", ge=0, title="height of the mirror centre above the heliostat's base",
        ),
    ] = None  # fmt: skip


class Output(Block):
    """Stored variables and their format; not part of the study's identity."""

    #: Flags that add results of one number for each point; a search sets them.
    OF_POINTS: ClassVar[tuple[str, ...]] = ()

    time_series: Annotated[bool, Flag("Store the values of every instant too")] = False
    format: Annotated[
        str,
        Choice(
            "Format of the result",
            {"netcdf": "one file, result.nc", "zarr": "a folder, result.zarr, for more than fits a file comfortably"},
            sweep=False,
        ),
    ] = "netcdf"
    compression: Annotated[
        str,
        Choice(
            "Compression: of the time series in result.nc, of all values in result.zarr",
            {"none": "fastest", "zlib": "smaller, read everywhere", "zstd": "smaller and fast, result.zarr only"},
            sweep=False,
        ),
    ] = "none"
    compression_level: Annotated[
        int, Quantity("Level of compression, 1 fast to 9 small", "1", ge=1, le=9, integer=True, sweep=False)
    ] = 4

    def rules(self) -> Iterator[Fault]:
        """Check that the format supports the compression."""
        if self.compression == "zstd" and self.format != "zarr":
            yield Fault("is for 'format: zarr' only; some readers of NetCDF do not support it", ("compression",))

    def without_series(self) -> Iterable[Fault]:
        """Yield a fault if a time series is requested although the instants are points of the result."""
        if self.time_series:
            message = "adds nothing: each instant is a point of the result already; remove it"
            yield Fault(message, ("output", "time_series"), show_value=False)


class Published(Block):
    """Published numbers to compare the result with."""

    file: Annotated[str, FileName("CSV table of the published numbers", sweep=False)]
    source: Annotated[str, Text("Publication of the numbers")]


class Report(Block):
    """Additions of the report to the figures of the result."""

    published: Annotated[Published | None, Field(description="Published numbers to compare with")] = None

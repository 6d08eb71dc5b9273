"""Define the blocks shared by all families, and convert pydantic errors to problems with line and column numbers.

Families declare their own blocks as subclasses of `Block`. The `execution` block does not affect the numerical results.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, Self, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from heliosweep.config.faults import (
    MAX_FAULTS,
    SYNONYMS,
    Fault,
    Invalid,
    Path,
    in_short,
    nearest,
    one_of,
    require,
    shown,
    to_pydantic,
    when,
)
from heliosweep.config.source import Source
from heliosweep.config.values import Choice, FileName, Flag, Numbers, Parameter, Quantity, Sweep, Text, free_text
from heliosweep.errors import Problem, log

UNKNOWN_KEY = "unknown key"
#: Marker for a path that does not exist in the file.
_ABSENT = object()


class Block(BaseModel):
    """Base class of the blocks in a study file: immutable mappings that reject unknown keys.

    A subclass declares its keys as annotated fields and may check relations between keys in :meth:`rules`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)
    #: Mutually exclusive keys, exactly one of which is required.
    ONE_OF: ClassVar[tuple[str, ...]] = ()

    def rules(self) -> Iterable[Fault]:
        """Yield a fault for each conflict between keys of the block. Called only if every key is valid."""
        return ()

    def __setattr__(self, name: str, value: Any) -> None:
        """Raise AttributeError for the keys of the block, because a validated study is immutable."""
        if name in type(self).model_fields:
            raise AttributeError(f"{name}: a study is immutable; create a new study with heliosweep.study or load")
        super().__setattr__(name, value)

    @model_validator(mode="after")
    def _keep_rules(self) -> Self:
        faults, given = list(self.rules()), [key for key in self.ONE_OF if getattr(self, key) is not None]
        if self.ONE_OF and len(given) != 1:
            faults.insert(0, Fault(f"give exactly one of {one_of(self.ONE_OF, 'and')}", show_value=False))
        if faults:
            raise to_pydantic(faults)
        return self

    @classmethod
    def parameter(cls, key: str) -> Parameter | None:
        """Return the declaration (such as a Quantity) of the field `key`, or None if the field is a block or a list."""
        return next((item for item in cls.model_fields[key].metadata if isinstance(item, Parameter)), None)

    @classmethod
    def literals(cls, key: str) -> tuple[str, ...]:
        """Return the allowed values of the field `key` if its type is a Literal, as for ``clock: solar``.

        The tuple is empty for any other field.
        """
        annotation = cls.model_fields[key].annotation if key in cls.model_fields else None
        return get_args(annotation) if get_origin(annotation) is Literal else ()


def blocks_at(block: type[Block], location: Iterable[int | str]) -> list[type[Block]]:
    """Return the possible classes of the block at a location within another block.

    The location, as reported by pydantic, contains keys, list indices and union tags such as ``solar``.
    """
    candidates = [block]
    for part in location:
        if isinstance(part, int):
            continue
        fields = [candidate.model_fields[part] for candidate in candidates if part in candidate.model_fields]
        if fields:
            candidates = [inner for field in fields for _, inner in blocks_in(field.annotation)]
        else:
            tagged = [one for one in candidates if any(part in one.literals(key) for key in one.model_fields)]
            candidates = tagged or candidates
    return candidates


def declares(block: type[Block], key: str) -> bool:
    """Return True if a block or one of its nested blocks has a field with this dotted key."""
    name, _, rest = key.partition(".")
    field = block.model_fields.get(name)
    return field is not None and (not rest or any(declares(inner, rest) for _, inner in blocks_in(field.annotation)))


def blocks_in(annotation: Any, place: str = "") -> Iterator[tuple[str, type[Block]]]:
    """Yield the container and the class of each block in an annotation.

    The container is ``[]`` for a list and ``{}`` for a mapping. Otherwise, it is `place`.
    """
    if isinstance(annotation, type) and issubclass(annotation, Block):
        yield place, annotation
    for argument in get_args(annotation):
        yield from blocks_in(argument, {tuple: "[]", dict: "{}"}.get(get_origin(annotation), place))


def translate(error: ValidationError, block: type[Block], source: Source) -> Iterator[Problem]:
    """Yield a problem for each validation error in `source.data`, except errors caused by other errors."""
    errors = [(details, *_located(details, source.data)) for details in error.errors(include_url=False)]
    extra = [(details, path) for details, path, _ in errors if details["type"] == "extra_forbidden"]
    unknown = {path: _meant(details, block) for details, path in extra[: MAX_FAULTS + 1]}
    meant = {(*path[:-1], key) for path, (key, _) in unknown.items()}  # not reported as missing keys
    for details, path, value in errors:
        kind = details["type"]
        if kind == "extra_forbidden":
            yield source.problem(path, f"{UNKNOWN_KEY}{unknown.get(path, ('', ''))[1]}", at_key=True)
        elif path in meant:
            continue
        elif kind in ("missing", "rule") or value is _ABSENT:
            if not (kind == "rule" and isinstance(value, dict) and None in value.values()):
                yield source.problem(path, _message(details, block))
        # empty keys and invalid entries have already been reported
        elif value is not None and not (kind == "too_short" and value):
            yield source.problem(path, f"{_message(details, block)} (got {shown(value)})")


def _message(details: ErrorDetails, block: type[Block]) -> str:
    kind, context = details["type"], details.get("ctx", {})
    if kind in ("fault", "rule"):
        return details["msg"]
    if kind == "missing":
        key = str(details["loc"][-1])
        inner = next(one for one in blocks_at(block, details["loc"][:-1]) if key in one.model_fields)
        parameter, description = inner.parameter(key), inner.model_fields[key].description
        return f"is missing: {parameter.purpose if parameter else description or one_of(inner.literals(key))}"
    if kind == "literal_error":
        return f"must be {context['expected']}"
    if not kind.startswith("union_tag"):
        return {
            **dict.fromkeys(
                ("model_type", "model_attributes_type", "dict_type"), "must be a mapping of keys to values"
            ),
            **{"tuple_type": "must be a list", "list_type": "must be a list", "string_type": "must be text"},
            **{
                "too_short": "must not be empty",
                "invalid_key": "keys must be text",
                "int_type": "must be a whole number",
            },
            **{"bool_type": "must be true or false", "float_type": "must be a number"},
        }.get(kind, "is not valid here")
    tag = context["discriminator"].strip("'")
    names = [name for inner in blocks_at(block, details["loc"]) for name in inner.literals(tag)]
    return f"{'is missing:' if kind == 'union_tag_not_found' else 'must be'} {one_of(names)}"


def _located(details: ErrorDetails, data: Any) -> tuple[Path, Any]:
    """Return the path of an error in the file, and the value at this path.

    The location from pydantic also contains the selected union members, which are not part of the path.
    """
    location, path = details["loc"], list[str | int]()
    for position, part in enumerate(location):
        if isinstance(part, int) if isinstance(data, list | tuple) else isinstance(data, dict) and part in data:
            data = data[part]
            path.append(part)
        elif position == len(location) - 1 and details["type"] in ("missing", "extra_forbidden"):
            path.append(part)
    if details["type"].startswith("union_tag"):
        tag = details["ctx"]["discriminator"].strip("'")
        return (*path, tag), data.get(tag, _ABSENT) if isinstance(data, dict) else _ABSENT
    return tuple(path), data


def _meant(details: ErrorDetails, block: type[Block]) -> tuple[str, str]:
    """Return the most similar known key (empty if no known key is similar), and a hint for the user."""
    word = str(details["loc"][-1])
    known = [key for inner in blocks_at(block, details["loc"][:-1]) for key in inner.model_fields]
    glued = re.match(r"(\w+)[\s:=]+(\S.*)", word)
    if glued and glued[1] in known:
        return glued[1], f"; write '{glued[1]}: {in_short(glued[2])}', with a colon and a space"
    if re.fullmatch(r"[-+.\d]+", word):
        return "", "; write several values in brackets, such as [1, 2.5], with decimal points"
    if remedy := SYNONYMS.get(word.casefold()):
        return "", f"; {remedy}"
    key = nearest(word, known)
    return key or "", f"; did you mean '{key}'?" if key else ""


class Receiver(Block):
    """Aim point on the tower, common to all heliostats."""

    height: Annotated[
        float | Sweep,
        Quantity(
            "Height of the aim point above the tower's base", "m", gt=0, dimension="receiver_height",
            title="receiver height",
        ),
    ]  # fmt: skip


def _side(side: str) -> Quantity:
    description = f"{side.title()} of the mirror (default: the layout column '{side}')"
    return Quantity(description, "m", gt=0, dimension=f"heliostat_{side}", title=f"mirror {side}")


class Heliostat(Block):
    """Flat rectangular mirror of each heliostat."""

    width: Annotated[float | Sweep | None, _side("width")] = None
    height: Annotated[float | Sweep | None, _side("height")] = None
    pivot_height: Annotated[
        float | Sweep | None,
        Quantity(
            "Height of the mirror centre above the heliostat's base (default: the layout column 'pivot_height'). The "
            "height of the base is z in the layout; set to 0 if z is the height of the mirror centre",
            "m", ge=0, title="height of the mirror centre above the heliostat's base",
        ),
    ] = None  # fmt: skip


class Output(Block):
    """Stored variables and file format. These keys do not affect the study id."""

    #: Flags for additional scalar results, with one number for each point. A search enables these flags.
    OF_POINTS: ClassVar[tuple[str, ...]] = ()

    time_series: Annotated[bool, Flag("Also store the variables at each instant")] = False
    format: Annotated[
        str,
        Choice("Format of the result", {"netcdf": "one file, result.nc"}, sweep=False),
    ] = "netcdf"
    compression: Annotated[
        str,
        Choice(
            "Compression of the time series",
            {"none": "fastest", "zlib": "smaller file"},
            sweep=False,
        ),
    ] = "none"
    compression_level: Annotated[
        int,
        Quantity("Compression level from 1 (fastest) to 9 (smallest file)", "1", ge=1, le=9, integer=True, sweep=False),
    ] = 4

    @model_validator(mode="before")
    @classmethod
    def _read_zarr(cls, data: Any) -> Any:
        """Replace the ``zarr`` format of version 0.1 with ``netcdf``, because Zarr files are no longer written."""
        if not isinstance(data, dict) or data.get("format") != "zarr":
            return data
        log.warning(
            "output.format: zarr is deprecated; the result is written as NetCDF. Convert it with "
            "xarray.open_dataset('result.nc', chunks={}).to_zarr('result.zarr')"
        )
        return data | {"format": "netcdf", "compression": "none" if data.get("compression") == "none" else "zlib"}

    def without_series(self) -> Iterable[Fault]:
        """Yield a fault if a time series is requested although each instant is already a point of the result."""
        message = "has no effect, because each instant is already a point of the result: remove it"
        return when((self.time_series, Fault(message, ("output", "time_series"), show_value=False)))


class Published(Block):
    """Published values for comparison with the result."""

    file: Annotated[str, FileName("CSV table of published values", sweep=False)]
    source: Annotated[str, Text("Publication that contains the values")]


class Report(Block):
    """Contents of the report in addition to the figures of the result."""

    published: Annotated[
        Published | None, Field(description="Published values that the report compares with the result")
    ] = None


_ADDRESS = re.compile(r"(?:tcp|tls)://(?:[A-Za-z0-9](?:[A-Za-z0-9._-]{0,252})|\[[0-9A-Fa-f:.]{2,45}\]):([0-9]{1,5})")


@dataclass(frozen=True)
class Scheduler(Choice):
    """Name of a scheduler, or the address of a Dask scheduler."""

    def _one_schema(self) -> dict[str, Any]:
        return {"anyOf": [super()._one_schema(), {"type": "string", "pattern": f"^{_ADDRESS.pattern}$"}]}

    def _one(self, raw: Any) -> str:
        if not isinstance(raw, str) or "://" not in raw:
            return super()._one(raw)
        found = _ADDRESS.fullmatch(raw)
        allowed = found and 1 <= int(found.group(1)) <= 65535
        require(allowed, "must be tcp://HOST:PORT or tls://HOST:PORT, with PORT between 1 and 65535")
        return raw


class Execution(Block):
    """Computing settings of a run. These settings do not affect the numerical results."""

    scheduler: Annotated[
        str,
        Scheduler(
            "Scheduler of the run, or the address of a Dask scheduler, tcp://HOST:PORT or tls://HOST:PORT",
            {
                "threads": "threads of this process",
                "processes": "worker processes",
                "synchronous": "one chunk at a time",
                "distributed": "worker processes that restart after a crash and have a dashboard, or the workers of "
                "`cluster`",
            },
            sweep=False,
        ),
    ] = "threads"
    workers: Annotated[
        int | None,
        Quantity(
            "Number of workers (default: number of available cores)", "1", ge=1, le=65536, integer=True, sweep=False
        ),
    ] = None
    device: Annotated[
        str,
        Choice(
            "Processor for ray tracing",
            {"cpu": "CPU cores", "cuda": "an NVIDIA GPU, which requires heliosweep[gpu]"},
            sweep=False,
        ),
    ] = "cpu"
    memory: Annotated[
        int | None,
        Quantity("Memory limit (default: 80 % of the available memory)", "B", gt=0, integer=True, sweep=False),
    ] = None
    chunks: Annotated[
        dict[str, Annotated[int, Quantity("Chunk size", "1", ge=1, integer=True, sweep=False)]],
        Field(description="Chunk size along each dimension (default: chosen automatically)"),
    ] = Field(default_factory=dict)
    cluster: Annotated[
        dict[str, Any] | None,
        Field(description=("Dask cluster for `scheduler: distributed`: its `class`, such as "
                          "dask_jobqueue.SLURMCluster, and keyword arguments (default: processes on this machine)")),
    ] = None  # fmt: skip

    @model_validator(mode="before")
    @classmethod
    def _read_earlier_keys(cls, data: Any) -> Any:
        """Convert the keys `job`, `profile` and `profiles` of version 0.1 to the current keys."""
        if not isinstance(data, dict) or not {"job", "profile", "profiles"} & data.keys():
            return data
        log.warning(
            "execution: job, profile and profiles are deprecated; write scheduler: distributed and cluster: "
            "{class: dask_jobqueue.SLURMCluster, ...}, and include a separate file with the keys of each machine"
        )
        profiles = data.get("profiles")
        named = profiles.get(data.get("profile")) if isinstance(profiles, dict) else None
        keys = {**data, **(named if isinstance(named, dict) else {})}
        queues = {name: name.upper() for name in ("slurm", "pbs", "sge", "lsf", "oar")} | {"htcondor": "HTCondor"}
        job = keys.get("job")
        if queue := queues.get(str(keys.get("scheduler"))):
            now = {"directives": "job_extra_directives", "setup": "job_script_prologue"}
            keywords = {now.get(key, key): value for key, value in job.items()} if isinstance(job, dict) else {}
            keys |= {"scheduler": "distributed", "cluster": {"class": f"dask_jobqueue.{queue}Cluster", **keywords}}
        return {key: value for key, value in keys.items() if key not in ("job", "profile", "profiles")}

    def rules(self) -> Iterable[Fault]:
        """Check that `cluster` has a class and is used only with the scheduler ``distributed``."""
        given, named = self.cluster is not None, "." in str((self.cluster or {}).get("class", ""))
        return when(
            (given and not named, Fault("must have a class, such as class: dask_jobqueue.SLURMCluster", ("cluster",))),
            (named and self.scheduler != "distributed",
             Fault("applies only to scheduler: distributed", ("cluster",), show_value=False)),
        )  # fmt: skip


#: Prefix for the identifiers of licences that are not in the SPDX list.
OWN = "LicenseRef-"


def _matched(expression: str, example: str, raw: Any) -> str:
    """Return the text matched by the group of an expression, or by the whole expression without a group.

    Raises Invalid if the expression does not match.
    """
    match = re.fullmatch(expression, free_text(raw).strip())
    if match is None:
        raise Invalid(f"must be {example}")
    return match[match.lastindex or 0]


def licence(text: str) -> str:
    """Return the identifier of a licence. Raises Invalid if the text cannot be an SPDX identifier."""
    return _matched(
        r"[A-Za-z0-9][A-Za-z0-9.+-]*", f"an SPDX identifier such as CC-BY-4.0 or CC0-1.0, or {OWN}NAME", text
    )


class Creator(Block):
    """A person or group that created the data set."""

    name: Annotated[str, Text("Name, in the form 'Family, Given' for a person")]
    orcid: Annotated[
        str | None,
        Text(
            "ORCID iD, such as 0000-0002-1825-0097",
            form=partial(
                _matched,
                r"(?:https://orcid\.org/)?(\d{4}-\d{4}-\d{4}-\d{3}[\dX])",
                "an ORCID iD such as 0000-0002-1825-0097",
            ),
        ),
    ] = None
    affiliation: Annotated[str | None, Text("Institution")] = None
    email: Annotated[str | None, Text("E-mail address for questions")] = None


class Funding(Block):
    """A source of funding."""

    funder: Annotated[str, Text("Funding organization")]
    award: Annotated[str | None, Text("Number or title of the grant")] = None


class Dataset(Block):
    """Authors, licence and keywords of the published result. These keys do not affect the study id."""

    creators: Annotated[tuple[Creator, ...], Field(description="Authors, in the order of citation")] = ()
    license: Annotated[
        str | None,
        Text(
            "Licence of the data: an SPDX identifier such as CC-BY-4.0 or CC0-1.0, or LicenseRef-NAME",
            form=licence,
        ),
    ] = None
    doi: Annotated[
        str | None,
        Text("DOI of the published data set, such as 10.5281/zenodo.1234567",
             form=partial(_matched, r"(?:https?://(?:dx\.)?doi\.org/|doi:)?(10\.\d{4,9}(?:\.\d+)*/\S+)",
                          "a DOI such as 10.5281/zenodo.1234567")),
    ] = None  # fmt: skip
    keywords: Annotated[
        tuple[Annotated[str, Text("Keyword")], ...],
        Field(description="Keywords to add to the family's own keywords"),
    ] = ()
    version: Annotated[str | None, Text("Version of the data set, such as '1.0'")] = None
    publisher: Annotated[str | None, Text("Repository or institution that publishes the data set, such as Zenodo")] = (
        None
    )
    funding: Annotated[tuple[Funding, ...], Field(description="Sources of funding")] = ()
    naming_authority: Annotated[
        str | None,
        Text("Domain of the organization that assigns the 'id' of the result, such as institute.example.org"),
    ] = None


#: Keys of the layout generators.
GENERATORS = ("radial_stagger", "spiral", "rows")
#: Keys that specify the heliostat positions. A layout has exactly one of these keys.
SOURCES = ("file", "table", *GENERATORS)
#: Keys that define the area and the terrain of a generated layout.
GROUND = ("sectors", "boundary", "exclude", "margin", "terrain")

_Heliostats = Annotated[
    int | Sweep | None, Quantity("Number of heliostats", "1", ge=1, integer=True, dimension="heliostat_count")
]
_InnerRadius = Annotated[
    float | Sweep,
    Quantity("Radius of the area around the tower without heliostats", "m", ge=0, title="inner radius"),
]


def _azimuth(description: str, dimension: str, title: str) -> Quantity:
    return Quantity(description, "deg", ge=-360, le=360, dimension=dimension, title=title)


class Zone(Block):
    """Consecutive rings of a field that have the same angular pitch."""

    start: Annotated[float, Quantity("Radius of the first ring", "m", gt=0, sweep=False)]
    rings: Annotated[int, Quantity("Number of rings", "1", ge=1, integer=True, sweep=False)]
    pitch: Annotated[
        float | None,
        Quantity(
            "Angle between neighbours in a ring (default: the angle at which neighbours are one clearance apart)",
            "deg", gt=0, le=180, sweep=False,
        ),
    ] = None  # fmt: skip


class RadialStagger(Block):
    """Heliostats in rings around the tower, each rotated by half a pitch relative to the previous ring."""

    clearance: Annotated[
        float | Sweep, Quantity("Minimum distance between heliostat centres", "m", gt=0, title="clearance")
    ]
    inner_radius: Annotated[
        float | Sweep | None,
        Quantity("Radius of the first ring; optional if 'zones' is given", "m", gt=0, title="radius of the first ring"),
    ] = None
    rings: Annotated[int | Sweep | None, Quantity("Number of rings", "1", ge=1, le=10_000, integer=True)] = None
    heliostats: _Heliostats = None
    zones: Annotated[
        tuple[Zone, ...] | None, Field(description="Zones from the tower outwards", min_length=1)
    ] = None  # fmt: skip
    spacing: Annotated[
        str | Sweep | None,
        Choice(
            (
                "Rule by which the distances between rings and between neighbours increase with the distance from the "
                "tower"
            ),
            {
                "delsol": "the empirical spacing of DELSOL3 (Kistler 1986)",
                "no_blocking": "rings as close together as possible without blocking between heliostats at the "
                "same azimuth",
            },
            title="spacing of the rings",
        ),
    ] = None

    def rules(self) -> Iterable[Fault]:
        """Check that at most one key defines the extent, the first radius is given, and zones have no spacing rule."""
        given = [key for key in ("rings", "heliostats", "zones") if getattr(self, key) is not None]
        return when(
            (len(given) > 1,
             Fault("give exactly one of 'rings', 'heliostats' and 'zones'", tuple(given[1:2]), show_value=False)),
            (self.inner_radius is None and self.zones is None,
             Fault("'inner_radius' is missing: the radius of the first ring, in m", show_value=False)),
            (self.spacing is not None and self.zones is not None,
             Fault("generates its own zones: remove 'zones' or this key", ("spacing",), show_value=False)),
        )  # fmt: skip


class Spiral(Block):
    """Phyllotaxis spiral: heliostat k has the azimuth 360 k / phi^2 deg and the radius a k^b (phi: golden ratio)."""

    a: Annotated[
        float | Sweep,
        Quantity("Radius of heliostat 1", "m", gt=0, dimension="spiral_a", title="coefficient a of the spiral"),
    ]
    b: Annotated[
        float | Sweep,
        Quantity("Exponent of the radius: 0.5 for a uniform density, larger for a density that decreases with "
                 "the distance from the tower", "1", gt=0, le=2, dimension="spiral_b",
                 title="exponent b of the spiral"),
    ]  # fmt: skip
    inner_radius: _InnerRadius
    heliostats: _Heliostats = None


class Rows(Block):
    """Parallel rows of heliostats. If `heliostats` is given, the positions nearest to the tower are used."""

    spacing: Annotated[
        float | Sweep,
        Quantity("Distance between neighbours in a row", "m", gt=0, dimension="row_spacing",
                 title="distance between neighbours in a row"),
    ]  # fmt: skip
    distance: Annotated[
        float | Sweep,
        Quantity("Distance between rows", "m", gt=0, dimension="row_distance", title="distance between rows"),
    ]
    inner_radius: _InnerRadius
    azimuth: Annotated[
        float | Sweep,
        _azimuth("Azimuth perpendicular to the rows, clockwise from north; 0 for east-west rows",
                 "row_azimuth", "azimuth perpendicular to the rows"),
    ] = 0.0  # fmt: skip
    pattern: Annotated[
        str | Sweep,
        Choice(
            "Arrangement of the rows",
            {
                "staggered": "each row is shifted by half a spacing relative to the next",
                "straight": "the heliostats in all rows are aligned",
            },
            title="pattern of the rows",
        ),
    ] = "staggered"
    heliostats: _Heliostats = None


class Sector(Block):
    """Range of heliostat azimuths, as seen from the tower."""

    azimuth: Annotated[
        float | Sweep,
        _azimuth("Azimuth of the middle of the sector, clockwise from north", "sector_azimuth",
                 "azimuth of the middle of the sector"),
    ]  # fmt: skip
    width: Annotated[
        float | Sweep,
        Quantity("Full width of the sector, centred on 'azimuth'", "deg", gt=0, le=360,
                 dimension="sector_width",
                 title="width of the sector"),
    ]  # fmt: skip


class Terrain(Block):
    """Heights of the ground below the heliostats, relative to the tower's base."""

    ONE_OF: ClassVar = ("file", "slope")
    file: Annotated[
        str | None,
        FileName("NetCDF or GeoTIFF height grid, with x east and y north of the tower, in m", sweep=False),
    ] = None
    slope: Annotated[
        float | Sweep | None,
        Quantity("Slope of planar ground, instead of a height grid", "deg", ge=0, le=45, dimension="terrain_slope",
                 title="slope of the ground"),
    ] = None  # fmt: skip
    azimuth: Annotated[
        float | Sweep | None,
        _azimuth("Downhill azimuth, clockwise from north", "terrain_azimuth",
                 "azimuth towards which the ground falls"),
    ] = None  # fmt: skip

    def rules(self) -> Iterable[Fault]:
        """Check that a slope is given with its azimuth."""
        one, together = (self.file is None) != (self.slope is None), (self.slope is None) == (self.azimuth is None)
        both = "'slope' and 'azimuth' must be given together: steepness and direction of the slope"
        return when((one and not together, Fault(both, show_value=False)))


class Layout(Block):
    """Positions of the heliostats: a table, or a generator with its parameters."""

    ONE_OF: ClassVar = SOURCES
    file: Annotated[
        str | Sweep | None,
        FileName("CSV table of heliostats with the columns x, y and optionally z (all in m), and optional columns of "
                 "heliostat properties and labels; a file pattern such as layouts/*.csv defines a sweep",
                 dimension="layout"),
    ] = None  # fmt: skip
    table: Annotated[
        dict[str, tuple[Any, ...]] | None,
        Field(description="Layout table, as lists of values by column name (x, y and others)", min_length=1),
    ] = None
    radial_stagger: Annotated[RadialStagger | None, Field(description="Rings around the tower")] = None
    spiral: Annotated[Spiral | None, Field(description="Phyllotaxis spiral around the tower")] = None
    rows: Annotated[Rows | None, Field(description="Parallel rows around the tower")] = None
    sectors: Annotated[
        tuple[Sector, ...] | None,
        Field(description="Azimuth sectors that contain heliostats (default: all azimuths)", min_length=1),
    ] = None
    boundary: Annotated[
        str | Sweep | None,
        FileName(
            "GeoJSON or WKT file with polygons that contain all heliostat centres, in m east and north of the tower"
        ),
    ] = None
    exclude: Annotated[
        str | Sweep | None,
        FileName(
            "File in the same format as 'boundary', with polygons that contain no heliostat centres, such as roads"
        ),
    ] = None
    margin: Annotated[
        float | Sweep | None,
        Quantity("Minimum distance of heliostat centres from the edges of 'boundary' and 'exclude'; if it is half "
                 "the mirror diagonal, no mirror crosses these edges", "m", ge=0, dimension="boundary_margin",
                 title="distance of heliostat centres from the boundary"),
    ] = None  # fmt: skip
    terrain: Annotated[Terrain | None, Field(description="Ground heights (default: level ground)")] = None
    origin: Annotated[
        tuple[float, float] | None,
        Numbers("Position of the tower in the coordinate system of the layout ('file' or 'table') or of the ground "
                "('boundary', 'exclude' and the 'terrain' grid), for example UTM. The axes of this system are treated "
                "as east and north", "m",
                ("east", "north")),
    ] = None  # fmt: skip

    @model_validator(mode="before")
    @classmethod
    def _columns_as_table(cls, data: Any) -> Any:
        """Convert columns given directly in the block, as in ``layout: {x: [...], y: [...]}``, to a layout table."""
        if not isinstance(data, dict) or {*SOURCES} & {*data}:
            return data
        known = {key: value for key, value in data.items() if key in cls.model_fields}
        table = {key: value for key, value in data.items() if key not in known}
        if sum(isinstance(values, list) for values in table.values()) < 2:
            return data
        return {"table": table, **known}

    def rules(self) -> Iterable[Fault]:
        """Check that the other keys apply to the source of the positions, and that a generated field is limited."""
        given = [key for key in type(self).model_fields if getattr(self, key) is not None]
        sources = [key for key in given if key in SOURCES]
        if len(sources) != 1:
            return ()
        source = sources[0]
        if source in ("file", "table"):
            unequal = len(set(map(len, (self.table or {"": ()}).values()))) != 1
            message = f"applies only to generated layouts: remove it, or '{source}'"
            return when(
                (unequal, Fault("must contain lists of equal length, one per column", ("table",), show_value=False)),
                *((key in given, Fault(message, (key,), show_value=False)) for key in GROUND),
            )
        areas = {"boundary": self.boundary, "exclude": self.exclude}
        files: dict[str, Any] = {
            "margin": areas,
            "origin": areas | {"terrain.file": self.terrain and self.terrain.file},
        }
        block = getattr(self, source)
        ends = [key for key in ("rings", "heliostats", "zones") if key in type(block).model_fields]
        what = f"exactly one of {one_of(ends, 'and')}" if len(ends) > 1 else "'heliostats'"
        return when(
            *((key in given and not any(paths.values()),
               Fault(f"applies only to {one_of(paths)}: give one of these, or remove this key", (key,),
                     show_value=False))
              for key, paths in files.items()),
            (self.boundary is None and all(getattr(block, key) is None for key in ends),
             Fault(f"must have a limited extent: give {what}, or a 'boundary'", (source,), show_value=False)),
        )  # fmt: skip

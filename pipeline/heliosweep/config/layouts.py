"""The `layout` block of a study file: a table of positions, or a generator with its ground data."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import Field, model_validator

from heliosweep.config.blocks import Block
from heliosweep.config.faults import Fault, one_of, when
from heliosweep.config.values import Choice, FileName, Numbers, Quantity, Sweep

#: Keys of the layout generators.
GENERATORS = ("radial_stagger", "spiral", "rows")
#: Keys that specify the heliostat positions. A layout has exactly one of these keys.
SOURCES = ("file", "table", *GENERATORS)
#: Keys that describe the ground of a generated layout.
GROUND = ("sectors", "boundary", "exclude", "margin", "terrain")

_Heliostats = Annotated[
    int | Sweep | None, Quantity("Number of heliostats", "1", ge=1, integer=True, dimension="heliostat_count")
]
_InnerRadius = Annotated[
    float | Sweep,
    Quantity("Radius of the circle around the tower that contains no heliostats", "m", ge=0, title="inner radius"),
]


def _azimuth(description: str, dimension: str, title: str) -> Quantity:
    return Quantity(description, "deg", ge=-360, le=360, dimension=dimension, title=title)


class Zone(Block):
    """Consecutive rings of a field with a common angular pitch."""

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
    """A field of rings around the tower, each rotated by half a pitch relative to the previous ring."""

    clearance: Annotated[
        float | Sweep, Quantity("Minimum distance between heliostat centres", "m", gt=0, title="clearance")
    ]
    inner_radius: Annotated[
        float | Sweep | None,
        Quantity("Radius of the first ring; optional with zones", "m", gt=0, title="radius of the first ring"),
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
                "Rule by which the distances between rings and between neighbours increase with the distance from "
                "the tower"
            ),
            {
                "delsol": "the empirical spacing of DELSOL3 (Kistler 1986), which increases with the distance",
                "no_blocking": "rings as close as possible without blocking by the heliostat in front at the "
                "same azimuth",
            },
            title="spacing of the rings",
        ),
    ] = None

    def rules(self) -> Iterable[Fault]:
        """Check that exactly one key specifies the extent of the field."""
        given = [key for key in ("rings", "heliostats", "zones") if getattr(self, key) is not None]
        return when(
            (len(given) > 1,
             Fault("give exactly one of 'rings', 'heliostats' and 'zones'", tuple(given[1:2]), show_value=False)),
            (self.inner_radius is self.zones is None,
             Fault("'inner_radius' is missing: the radius of the first ring, in m", show_value=False)),
            (self.spacing is not None and self.zones is not None,
             Fault("generates zones itself: remove 'zones', or this key", ("spacing",), show_value=False)),
        )  # fmt: skip


class Spiral(Block):
    """A phyllotaxis spiral: heliostat k has the azimuth 360 k / phi^2 deg and the radius a k^b (phi: golden ratio)."""

    a: Annotated[
        float | Sweep,
        Quantity("Radius of heliostat 1", "m", gt=0, dimension="spiral_a", title="coefficient a of the spiral"),
    ]
    b: Annotated[
        float | Sweep,
        Quantity("Exponent of the radius: 0.5 for a uniform density, larger for a density that decreases with "
                 "distance", "1", gt=0, le=2, dimension="spiral_b", title="exponent b of the spiral"),
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
        _azimuth("Azimuth perpendicular to the rows, clockwise from north; 0 for rows from west to east",
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
        Quantity("Full width of the sector, half on either side of the middle", "deg", gt=0, le=360,
                 dimension="sector_width",
                 title="width of the sector"),
    ]  # fmt: skip


class Terrain(Block):
    """Heights of the ground below the heliostats, relative to the tower's base."""

    file: Annotated[
        str | None,
        FileName("NetCDF or GeoTIFF grid of heights; x and y are in m east and north of the tower", sweep=False),
    ] = None
    slope: Annotated[
        float | Sweep | None,
        Quantity("Slope of plane ground, instead of a height grid", "deg", ge=0, le=45, dimension="terrain_slope",
                 title="slope of the ground"),
    ] = None  # fmt: skip
    azimuth: Annotated[
        float | Sweep | None,
        _azimuth("Azimuth towards which the ground falls, clockwise from north", "terrain_azimuth",
                 "azimuth towards which the ground falls"),
    ] = None  # fmt: skip

    def rules(self) -> Iterable[Fault]:
        """Check that the terrain is either a grid, or a slope with its azimuth."""
        one = (self.file is None) != (self.slope is None)
        both = "'slope' and 'azimuth' must be given together: steepness and direction of the slope"
        return when(
            (not one, Fault("give exactly one of 'file' and 'slope'", show_value=False)),
            (one and (self.slope is None) != (self.azimuth is None), Fault(both, show_value=False)),
        )


class Layout(Block):
    """Positions of the heliostats: a table, or a generator with its parameters."""

    file: Annotated[
        str | Sweep | None,
        FileName("CSV table of heliostats with the columns x, y and optionally z, all in m, and with heliostat "
                 "properties and labels; a file pattern such as layouts/*.csv defines a sweep", dimension="layout"),
    ] = None  # fmt: skip
    table: Annotated[
        dict[str, tuple[Any, ...]] | None,
        Field(description="Layout table: column names (x, y and others), each with a list of values", min_length=1),
    ] = None
    radial_stagger: Annotated[RadialStagger | None, Field(description="Rings around the tower")] = None
    spiral: Annotated[Spiral | None, Field(description="Phyllotaxis spiral around the tower")] = None
    rows: Annotated[Rows | None, Field(description="Parallel rows around the tower")] = None
    sectors: Annotated[
        tuple[Sector, ...] | None,
        Field(description="Azimuths of the heliostats (default: all)", min_length=1),
    ] = None
    boundary: Annotated[
        str | Sweep | None,
        FileName("GeoJSON or WKT polygons that must contain the heliostat centres, in m east and north of the tower"),
    ] = None
    exclude: Annotated[
        str | Sweep | None,
        FileName("Polygons, such as roads, that must not contain heliostat centres, in the same form as 'boundary'"),
    ] = None
    margin: Annotated[
        float | Sweep | None,
        Quantity("Minimum distance of heliostat centres from the edges of 'boundary' and 'exclude'; half the "
                 "diagonal of a mirror keeps mirrors clear of these edges", "m", ge=0, dimension="boundary_margin",
                 title="distance of heliostat centres from the boundary"),
    ] = None  # fmt: skip
    terrain: Annotated[Terrain | None, Field(description="Heights of the ground (default: level)")] = None
    origin: Annotated[
        tuple[float, float] | None,
        Numbers("Position of the tower in the coordinates of 'file' or 'table', or of 'boundary', 'exclude' and the "
                "grid of 'terrain', for example UTM coordinates. The axes of these coordinates are treated as east "
                "and north", "m",
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
        """Check that the layout has one source of positions, and that a generated field has a limited extent."""
        sources = [key for key in SOURCES if getattr(self, key) is not None]
        if len(sources) != 1:
            return [Fault(f"give exactly one of {one_of(SOURCES).replace(' or ', ' and ')}", show_value=False)]
        given, (source,) = {key for key in type(self).model_fields if getattr(self, key) is not None}, sources
        if source in ("file", "table"):
            unequal = len(set(map(len, (self.table or {"": ()}).values()))) != 1
            message = f"applies only to generated layouts: remove it, or '{source}'"
            return when(
                (unequal, Fault("needs lists of equal length, one for each column", ("table",), show_value=False)),
                *((key in given, Fault(message, (key,), show_value=False)) for key in GROUND),
            )
        areas = {"boundary": self.boundary, "exclude": self.exclude}
        files: dict[str, Any] = {
            "margin": areas,
            "origin": areas | {"terrain.file": self.terrain and self.terrain.file},
        }
        block = getattr(self, source)
        ends = [key for key in ("rings", "heliostats", "zones") if key in type(block).model_fields]
        what = f"exactly one of {one_of(ends).replace(' or ', ' and ')}" if len(ends) > 1 else "'heliostats'"
        return when(
            *((key in given and not any(paths.values()),
               Fault(f"is for {one_of(paths)}: give one of these, or remove it", (key,), show_value=False))
              for key, paths in files.items()),
            (self.boundary is None and all(getattr(block, key) is None for key in ends),
             Fault(f"give {what}, or a 'boundary' to fill: the extent of the field", (source,), show_value=False)),
        )  # fmt: skip

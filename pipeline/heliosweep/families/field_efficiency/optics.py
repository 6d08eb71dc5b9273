"""Study blocks for the optical path: mirrors, losses in mirrors and air, the receiver, flux maps and aim points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from heliosweep.aiming import RAYS, image_bytes
from heliosweep.config import (
    MAX_SEED,
    Block,
    Choice,
    Distribution,
    Fault,
    FileName,
    Invalid,
    ListOfNumbers,
    Numbers,
    Quantity,
    SunDirections,
    Sweep,
    ends,
    list_schema,
    one_of,
    read_items,
    when,
)
from heliosweep.config import Heliostat as HeliostatBlock
from heliosweep.config import Receiver as ReceiverPoint
from heliosweep.families.field_efficiency.heat import ThermalLosses
from heliosweep.families.mount_errors import NOT_DRAWN, MountAngles
from heliosweep.grid.sun import instant_count
from heliosweep.kernels import rays
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.mounts import ERRORS

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy


@dataclass(frozen=True)
class Focus(Quantity):
    """Focal length in m, or a keyword."""

    words: tuple[str, ...] = field(default=("flat", "slant", "layout"), kw_only=True)

    def read(self, raw: Any) -> Any:
        """Return the focal length as a keyword or a number. Raises Invalid."""
        if isinstance(raw, list | tuple) and raw and all(each in self.words for each in raw):
            return Sweep(read_items(raw, lambda word: word))
        if isinstance(raw, str) and raw.isalpha():
            if raw not in self.words:
                raise Invalid(f"must be a length in m, or {one_of(self.words)}")
            return raw
        return super().read(raw)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema for a keyword or a number."""
        word = {"enum": list(self.words)}
        return {"anyOf": [word, list_schema(word), super().json_schema()]}


class FacetGrid(Block):
    """Equal facets of a mirror, arranged in columns and rows."""

    columns: Annotated[
        int,
        Quantity(
            "Number of facets along the width", "1", ge=1, le=50, integer=True, sweep=False, dimension="facet_columns"
        ),
    ]
    rows: Annotated[
        int,
        Quantity(
            "Number of facets along the height", "1", ge=1, le=50, integer=True, sweep=False, dimension="facet_rows"
        ),
    ]
    gap: Annotated[float, Quantity("Gap between facets", "m", ge=0, sweep=False, dimension="facet_gap")] = 0.0
    canting: Annotated[
        str | Sweep,
        Choice(
            "Canting of the facets",
            {
                "none": "all facets in one plane",
                "on_axis": "facets tilted to focus at each heliostat's slant range",
            },
            title="canting of the facets",
        ),
    ] = "none"


class Heliostat(HeliostatBlock):
    """Mirror of each heliostat: a rectangle, in one piece or with facets. The key 'focus' requires 'optics'."""

    focus: Annotated[
        float | str | Sweep | None,
        Focus("Focal length of the mirror or of its facets; 'flat', 'slant' for the slant range of each heliostat, or "
              "'layout' for the layout columns focal_x and focal_y, or focal_length (default: these columns if "
              "present, otherwise flat)",
              "m", gt=0, title="focal length of the mirror"),
    ] = None  # fmt: skip
    facets: Annotated[FacetGrid | None, Field(description="Facets of the mirror (default: one piece)")] = None


class Receiver(ReceiverPoint):
    """Receiver: the aim point of all heliostats and, with 'optics', the surface around this point."""

    kind: Annotated[
        str | None,
        Choice(
            "Shape of the receiver",
            {
                "rectangle": "a flat face; heliostats aim at its centre",
                "cavity": "the rectangular aperture of a cavity; heliostats aim at its centre",
                "cylinder": "the outside of an upright cylinder; each heliostat aims at the surface point that "
                "faces it",
            },
            sweep=False,
            dimension="receiver_kind",
        ),
    ] = None
    azimuth: Annotated[
        float | Sweep | None,
        Quantity("Azimuth that a rectangle or cavity faces, clockwise from north; 0 for a field in the north", "deg",
                 ge=-360, le=360, dimension="receiver_azimuth", title="azimuth of the receiver's normal"),
    ] = None  # fmt: skip
    tilt: Annotated[
        float | Sweep | None,
        Quantity("Tilt of the receiver's normal above the horizontal; negative values face down", "deg", ge=-90, le=90,
                 dimension="receiver_tilt", title="tilt of the receiver's normal above the horizontal"),
    ] = None  # fmt: skip
    width: Annotated[
        float | Sweep | None,
        Quantity("Width of a rectangle or cavity", "m", gt=0, dimension="receiver_width", title="receiver width"),
    ] = None
    radius: Annotated[
        float | Sweep | None,
        Quantity("Radius of a cylinder", "m", gt=0, dimension="receiver_radius", title="receiver radius"),
    ] = None
    height_extent: Annotated[
        float | Sweep | None,
        Quantity("Height of the receiver's surface, along its face", "m", gt=0, title="height of the receiver surface"),
    ] = None
    absorptance: Annotated[
        float | Sweep | None,
        Quantity("Absorbed fraction of the light on the receiver, to compute heat", "1", gt=0, le=1,
                 title="absorptance of the receiver"),
    ] = None  # fmt: skip
    thermal_losses: Annotated[
        ThermalLosses | None, Field(description="Thermal losses of the receiver, to compute heat (default: none)")
    ] = None

    def rules(self) -> Iterator[Fault]:
        """Check that each key applies to this kind of receiver."""
        wanted = {None: (), "cylinder": ("radius", "height_extent")}.get(self.kind, ("width", "height_extent"))
        known = wanted if self.kind in (None, "cylinder") else (*wanted, "azimuth", "tilt")
        of = f"is not used for a receiver of kind {self.kind}" if self.kind else "needs 'receiver.kind'"
        missing = f"is missing: a receiver of kind {self.kind} needs it, in m"
        return when(
            *((key not in known and getattr(self, key) is not None, Fault(f"{of}; remove it", (key,)))
              for key in ("azimuth", "tilt", "width", "radius", "height_extent")),
            *((getattr(self, key) is None, Fault(f"'{key}' {missing}", show_value=False)) for key in wanted),
        )  # fmt: skip


class SunShape(Block):
    """Brightness of the sun as a function of the angle from its centre."""

    kind: Annotated[
        str | Sweep,
        Choice(
            "Sun shape",
            {
                "pillbox": "a uniform disc with a radius of 4.65 mrad",
                "gaussian": "a Gaussian with a standard deviation of 2.73 mrad per axis",
                "limb_darkened": "a disc with a radius of 4.65 mrad, whose limb is 56 % darker than its centre",
                "jose": "the disc of Jose (1957), as in backward gazing",
                "buie": "disc and aureole of Buie et al. (2003), defined by circumsolar_ratio",
                "table": "brightness as a function of the angle, read from a file",
            },
            dimension="sun_shape",
            title="sun shape",
        ),
    ]
    circumsolar_ratio: Annotated[
        float | Sweep | None,
        Quantity("Fraction of the light from the aureole, for buie", "1", ge=0.001, le=0.8,
                 title="circumsolar ratio"),
    ] = None  # fmt: skip

    file: Annotated[
        str | None,
        FileName(
            "CSV table of a measured sun shape, for kind table: angle from the sun's centre in mrad, and brightness",
            sweep=False,
        ),
    ] = None

    def rules(self) -> Iterator[Fault]:
        """Check the keys that apply to only one sun shape."""
        of_kinds = (("buie", "circumsolar_ratio", ", from 0.001 to 0.8"), ("table", "file", ""))
        return when(
            *((kind in ends(self.kind) and getattr(self, key) is None,
               Fault(f"'{key}' is missing: {kind} needs it{what}", show_value=False)) for kind, key, what in of_kinds),
            *((kind not in ends(self.kind) and getattr(self, key) is not None,
               Fault(f"is only for the sun shape {kind}; remove it", (key,))) for kind, key, _ in of_kinds),
        )  # fmt: skip


class PointingErrors(MountAngles):
    """Fixed mount errors that the controller does not correct, drawn once for each heliostat."""

    seed: Annotated[
        int | Sweep | None,
        Quantity("Seed of the random draws for all heliostats (default: 0)", "1", ge=0, le=MAX_SEED,
                 integer=True, title="seed of the mount errors"),
    ] = None  # fmt: skip
    calibration: Annotated[
        str | None,
        FileName("Calibration result (family misalignment) with estimates that replace the six errors",
                 sweep=False),
    ] = None  # fmt: skip

    def rules(self) -> Iterator[Fault]:
        """Check that errors are given only once, and that keys for draws are used only with drawn errors."""
        fixed, calibrated, drawn = not self.drawn(), self.calibration is not None, self.drawn().items()
        none = f"contains no error: give {', '.join(ERRORS)} in mrad, or 'calibration'"
        several = "does not apply to a field, because each heliostat has one draw: remove it, or sweep 'seed'"
        return when(
            *((calibrated and getattr(self, key) != 0.0,
               Fault("is also given by 'calibration': remove one of them", (key,), show_value=False))
              for key in ERRORS),
            (not calibrated and not self.model_fields_set & set(ERRORS), Fault(none, show_value=False)),
            (fixed and self.seed is not None, Fault(NOT_DRAWN, ("seed",), show_value=False)),
            (fixed and self.scale != 1.0 and not calibrated, Fault(NOT_DRAWN, ("scale",), show_value=False)),
            *((error.samples is not None, Fault(several, (key, "samples"))) for key, error in drawn),
        )  # fmt: skip


class Soiling(Block):
    """Soiling that grows linearly between washings. Mirrors are washed in turn."""

    rate: Annotated[
        float | Sweep,
        Quantity("Fraction of the light lost to soiling per day", "1", ge=0, le=0.5, dimension="soiling_rate",
                 title="soiling rate per day"),
    ]  # fmt: skip
    washing_interval: Annotated[
        float | Sweep,
        Quantity("Time between two washings of a mirror, in days", "1", gt=0, le=3660,
                 title="days between two washings"),
    ]  # fmt: skip

    def rules(self) -> Iterator[Fault]:
        """Check that the cleanliness does not fall below zero before a washing."""
        return when(
            (
                max(ends(self.rate)) * max(ends(self.washing_interval)) > 1,
                Fault(
                    "leaves no light before a washing: rate times washing_interval must be at most 1", show_value=False
                ),
            )
        )


MONTHS = ("January", "February", "March", "April", "May", "June", "July", "August", "September", "October",
          "November", "December")  # fmt: skip


def _error(description: str, title: str) -> Quantity:
    return Quantity(description, "mrad", ge=0, le=50, title=title)


class Optics(Block):
    """Optics between mirror and receiver."""

    sun_shape: Annotated[
        SunShape, Field(description="Brightness of the sun as a function of the angle from its centre")
    ]
    reflectivity: Annotated[
        float | Sweep | None,
        Quantity("Fraction of the light that a clean mirror reflects (default: the column 'reflectivity' of the "
                 "layout, otherwise 1)", "1", ge=0, le=1, title="reflectivity"),
    ] = None  # fmt: skip
    cleanliness: Annotated[
        float | Sweep | None,
        Quantity("Reflectivity of the soiled mirror divided by its clean reflectivity (default: the column "
                 "'cleanliness' of the layout, otherwise 1)",
                 "1", ge=0, le=1, title="cleanliness"),
    ] = None  # fmt: skip
    cleanliness_by_month: Annotated[
        tuple[float, ...] | None,
        Numbers("Cleanliness in each month, instead of 'cleanliness'", "1", MONTHS, ge=0, le=1),
    ] = None
    soiling: Annotated[
        Soiling | None, Field(description="Soiling between washings, which further reduces 'cleanliness'")
    ] = None
    attenuation: Annotated[
        str | Sweep,
        Choice(
            "Attenuation by the air between mirror and receiver",
            {
                "none": "no losses in the air",
                "delsol_clear": "DELSOL3, visibility 23 km",
                "delsol_hazy": "DELSOL3, visibility 5 km",
                "leary_hankins": "Leary and Hankins (1979), MIRVAL",
                "ballestrin_clear": "Ballestrin and Marzo (2012), clear",
                "ballestrin_hazy": "Ballestrin and Marzo (2012), hazy",
                "vant_hull": "Vant-Hull, from visibility, water_vapour, altitude and receiver height",
            },
            title="attenuation in air",
        ),
    ] = "none"
    visibility: Annotated[
        float | Sweep | None,
        Quantity("Visibility, for vant_hull (default: 23 km)", "m", ge=2000, le=500e3, title="visibility"),
    ] = None
    water_vapour: Annotated[
        float | Sweep | None,
        Quantity("Density of water vapour, for vant_hull (default: 5.9 g/m3)", "g/m3", ge=0, le=40,
                 title="density of water vapour"),
    ] = None  # fmt: skip
    altitude: Annotated[
        float | Sweep | None,
        Quantity("Altitude, for vant_hull (default: altitude of the site)", "m", ge=-500, le=10_000,
                 dimension="air_altitude", title="altitude of the air"),
    ] = None  # fmt: skip
    slope_error: Annotated[
        float | Sweep | None,
        _error(
            "Standard deviation of the mirror's normal, per axis (if omitted: the column 'slope_error' of the layout)",
            "slope error",
        ),
    ] = None
    slope_error_horizontal: Annotated[
        float | Sweep | None,
        _error("Standard deviation of the normal along the mirror's width", "slope error along the width"),
    ] = None
    slope_error_vertical: Annotated[
        float | Sweep | None,
        _error("Standard deviation of the normal along the mirror's height", "slope error along the height"),
    ] = None
    slope_map: Annotated[
        str | Sweep | None,
        FileName("Measured slopes of a mirror or facet. One map for all heliostats: CSV table with x, y in m and "
                 "slope_x, slope_y in mrad, backward_gazing result, or SOFAST HDF5 file. Maps for several "
                 "heliostats: NetCDF file with a dimension heliostat, or PAINT HDF5 file; the slope error applies "
                 "to heliostats without a map",
                 title="slope map"),
    ] = None  # fmt: skip
    specularity_error: Annotated[
        float | Sweep,
        _error("Standard deviation of the reflected ray's direction, per axis", "specularity error"),
    ] = 0.0
    tracking_error: Annotated[
        float | Sweep,
        _error("Standard deviation of the normal due to random tracking errors, per axis", "tracking error"),
    ] = 0.0
    mount_errors: Annotated[
        PointingErrors | None,
        Field(description="Fixed mount errors, which displace the images from the aim points"),
    ] = None
    precision: Annotated[
        float | None,
        Quantity("Relative standard error of the field's energy, which determines the number of rays; in bright cells "
                 "of flux maps, the error relative to the peak is 40 times larger (default: 1e-4, for draws 2e-3)",
                 "1", ge=1e-6, le=0.1, sweep=False),
    ] = None  # fmt: skip
    rays: Annotated[
        int | None,
        Quantity("Number of rays for each heliostat and instant, instead of 'precision'; rounded up to a "
                 "power of two, at least 16",
                 "1", ge=1, le=2**22, integer=True, sweep=False, dimension="rays"),
    ] = None  # fmt: skip
    seed: Annotated[
        int,
        Quantity("Seed of the random numbers for ray tracing", "1", ge=0, le=MAX_SEED, integer=True, sweep=False,
                 dimension="ray_seed"),
    ] = 0  # fmt: skip
    method: Annotated[
        str | None,
        Choice(
            "No longer used, because all light is traced with rays",
            {"accurate": "light is traced with rays", "gaussian": "light is traced with rays"},
            sweep=False,
            dimension="intercept_method",
        ),
    ] = None

    def rules(self) -> Iterator[Fault]:
        """Check that slopes, cleanliness and rays are specified once, and that only vant_hull has air properties."""
        axes = ("slope_error_horizontal", "slope_error_vertical")
        given, air = [getattr(self, key) is not None for key in axes], "vant_hull" in ends(self.attenuation)
        twice = "is also given by '{}': remove one of them"
        return when(
            *((self.slope_error is not None and there, Fault(twice.format("slope_error"), (key,)))
              for key, there in zip(axes, given, strict=True)),
            (self.slope_error is None and given[0] != given[1],
             Fault("give 'slope_error', or both 'slope_error_horizontal' and 'slope_error_vertical', in mrad, or "
                   "'slope_map'", show_value=False)),
            (self.cleanliness_by_month is not None and self.cleanliness not in (None, 1.0),
             Fault(twice.format("cleanliness_by_month"), ("cleanliness",))),
            *((not air and getattr(self, key) is not None,
               Fault("is only for the attenuation vant_hull; remove it", (key,)))
              for key in ("visibility", "water_vapour", "altitude")),
            (self.rays is not None and self.precision is not None, Fault(twice.format("rays"), ("precision",))),
        )  # fmt: skip


#: Keys that affect the light on the receiver or its heat, excluding mirror positions, mirror sizes and sun directions.
KEYS = (
    *("heliostat.focus", "heliostat.facets.canting", "receiver.azimuth", "receiver.tilt", "receiver.width"),
    *("receiver.radius", "receiver.height", "receiver.height_extent", "optics.sun_shape.kind"),
    *("optics.sun_shape.circumsolar_ratio", "optics.reflectivity", "optics.cleanliness", "optics.soiling.rate"),
    *("optics.soiling.washing_interval", "optics.attenuation", "optics.visibility", "optics.water_vapour"),
    "optics.altitude",
    *("optics.slope_error", "optics.slope_error_horizontal", "optics.slope_error_vertical", "optics.slope_map"),
    *("optics.specularity_error", "optics.tracking_error"),
    *(f"optics.mount_errors.{name}" for name in (*ERRORS, "scale", "seed")),
    *("optics.precision", "optics.rays", "optics.seed"),
    *("receiver.absorptance", "receiver.thermal_losses.constant", "receiver.thermal_losses.per_area"),
)
#: Reserved names of swept keys and results, which layout columns must not use.
NAMES = (
    *("focus", "canting", "receiver_kind", "receiver_azimuth", "receiver_tilt", "receiver_width", "receiver_radius"),
    *("height_extent", "facet_columns", "facet_rows", "facet_gap", "sun_shape", "circumsolar_ratio", "reflectivity"),
    *("cleanliness", "soiling_rate", "washing_interval", "attenuation", "visibility", "water_vapour", "slope_error"),
    "air_altitude",
    *("slope_error_horizontal", "slope_error_vertical", "slope_map", "specularity_error", "tracking_error"),
    *(*ERRORS, "error_scale", "seed", "intercept_method", "rays", "ray_seed", "precision"),
    *(f"{of}{name}_efficiency" for of in ("", "field_", "instantaneous_")
      for name in ("intercept", "attenuation", "reflection", "total")),
)  # fmt: skip


def label_keys(study: Any) -> list[str]:
    """Return the keys of the optical path that label a result even if they are not swept."""
    if study.optics is None:
        return []
    known = {*KEYS, "receiver.kind", *(f"heliostat.facets.{key}" for key in ("columns", "rows", "gap"))}
    errors = study.optics.mount_errors
    if errors is None or errors.calibration is not None:
        known -= {f"optics.mount_errors.{key}" for key in ERRORS}
        known -= {"optics.mount_errors.scale"} if errors is None or errors.scale == 1.0 else set()
    elif not errors.drawn():
        known.remove("optics.mount_errors.scale")
    return [
        key
        for key, parameter, value in study.parameters()
        if key in known and not isinstance(parameter, FileName) and not isinstance(value, Distribution)
    ]


#: Default direct normal irradiance. [W/m2]
IRRADIANCE = 1000.0
DIMS = ("flux_row", "flux_column")


class FluxMap(Block):
    """Flux map on a grid of receiver cells. The flux is averaged over each cell."""

    columns: Annotated[
        int,
        Quantity("Number of cells along the width of a rectangle or around a cylinder", "1", ge=1, le=360, integer=True,
                 sweep=False),
    ]  # fmt: skip
    rows: Annotated[int, Quantity("Number of cells along the height", "1", ge=1, le=360, integer=True, sweep=False)]
    limit: Annotated[
        float | None,
        Quantity(
            "Flux limit; the fraction of the power on cells above this limit is stored", "kW/m2", gt=0, sweep=False
        ),
    ] = None


def flux_cells(study: FieldEfficiencyStudy) -> tuple[int, int] | None:
    """Return the numbers of rows and columns of the flux map; None if the study has no flux map."""
    wanted = study.output.flux_map
    return None if wanted is None else (wanted.rows, wanted.columns)


def cells_of(study: FieldEfficiencyStudy) -> tuple[int, int] | None:
    """Return the numbers of rows and columns of receiver cells; None without a flux limit or flux map."""
    if study.aim is not None and is_limited(study):
        return study.aim.flux_rows, study.aim.flux_columns
    return flux_cells(study)


def is_limited(study: FieldEfficiencyStudy) -> bool:
    """Return True if the aim points are chosen under a flux limit."""
    return study.aim is not None and study.aim.strategy == "flux_limit"


def varies(study: FieldEfficiencyStudy) -> bool:
    """Return True if the aim points are chosen separately for each instant."""
    return study.aim is not None and study.aim.at == "instants"


def has_instant(study: FieldEfficiencyStudy) -> bool:
    """Return True if the study has one instant for flux maps: a design point, or a single instant."""
    return study.design_point is not None or instant_count(study.time) == 1


def flux_labels(study: FieldEfficiencyStudy) -> dict[str, Any]:
    """Return the centres of the receiver cells and their attributes.

    Centres are in metres, or in degrees around a cylinder. If the size of the receiver is swept, the centres are
    fractions of this size. The result is empty without flux maps.
    """
    cells, receiver = cells_of(study), study.receiver
    if cells is None:
        return {}
    places = [(np.arange(count) + 0.5) / count for count in cells]
    middle = "from the middle of the receiver"
    row = _label(places[0] - 0.5, receiver.height_extent, "height on the receiver", f"{middle}, along its height")
    if receiver.kind == "cylinder":
        words = {"long_name": "azimuth on the receiver", "comment": "of the receiver's surface, clockwise from north"}
        column = 360.0 * places[1], {"units": "degree", **words}
    else:
        right = f"{middle}, to the right as seen from the mirrors"
        column = _label(places[1] - 0.5, receiver.width, "position across the receiver", right)
    return dict(zip(DIMS, (row, column), strict=True))


def _label(part: Floats, size: Any, long_name: str, comment: str) -> tuple[Floats, dict[str, str]]:
    if isinstance(size, Sweep):
        return part, {"units": "1", "long_name": f"{long_name}, relative to its size", "comment": comment}
    return part * float(size), {"units": "m", "long_name": long_name, "comment": comment}


#: Layout columns that contain the aim point of each heliostat.
COLUMNS = ("aim_x", "aim_y", "aim_z")


def _count(description: str, most: int) -> Quantity:
    return Quantity(description, "1", ge=1, le=most, integer=True, sweep=False)


class Aim(Block):
    """Aim points of the heliostats."""

    strategy: Annotated[
        str,
        Choice(
            "Aiming strategy",
            {
                "centre": "the centre of the receiver; on a cylinder, the point at mid-height that faces the heliostat",
                "spread": "several levels of the receiver, assigned cyclically around the tower",
                "layout": "the points aim_x, aim_y, aim_z of the layout [m]",
                "flux_limit": "grid points that maximise the power under a flux limit; heliostats may be stowed",
            },
            sweep=False,
        ),
    ] = "centre"
    levels: Annotated[
        int | Sweep | None,
        Quantity("Number of levels for spread; 1 is the centre", "1", ge=1, le=99, integer=True, dimension="aim_levels",
                 title="number of aim levels"),
    ] = None  # fmt: skip
    limit: Annotated[
        float | Sweep | None,
        Quantity("Maximum flux on each receiver cell, for flux_limit", "kW/m2", gt=0, dimension="flux_limit",
                 title="flux limit"),
    ] = None  # fmt: skip
    limits: Annotated[
        tuple[tuple[float, ...], ...] | None,
        ListOfNumbers("Individual limits of cell rows: row number, counted from 0 at the bottom, and limit in kW/m2",
                      ("1", "kW/m2"), ("row", "limit"), ge=0),
    ] = None  # fmt: skip
    safety: Annotated[float, Quantity("Maximum flux as a fraction of the limit", "1", gt=0, le=1, sweep=False)] = 1.0
    rows: Annotated[int, _count("Number of rows of aim points", 99)] = 7
    columns: Annotated[int, _count("Number of columns of aim points", 99)] = 3
    azimuth_span: Annotated[
        float,
        Quantity((
            "Azimuth range of the aim points on a cylinder, centred on the point nearest to the heliostat"
        ), "deg", ge=0, le=170,
                 sweep=False),
    ] = 40.0  # fmt: skip
    flux_rows: Annotated[int, _count("Number of cell rows to which the limit applies", 360)] = 20
    flux_columns: Annotated[int, _count("Number of cell columns to which the limit applies", 360)] = 36
    at: Annotated[
        str,
        Choice(
            "Instants for which aim points are chosen",
            {
                "design_point": "one set of aim points, for the design point or the only instant",
                "instants": "one set for each instant",
            },
            sweep=False,
        ),
    ] = "design_point"

    def rules(self) -> Iterator[Fault]:
        """Check that each key belongs to the strategy, and that the limits refer to existing rows of receiver cells."""
        limited, limits = self.strategy == "flux_limit", self.limits or ()
        others = {key: "spread" if key == "levels" else "flux_limit" for key in self.model_fields_set - {"strategy"}}
        # Resolved studies contain the default values of all keys.
        fields, rows = type(self).model_fields, [row for row, _ in limits]
        return when(
            *((strategy != self.strategy and getattr(self, key) != fields[key].default,
               Fault(f"is only for the strategy {strategy}; remove it", (key,))) for key, strategy in others.items()),
            (limited and self.limit is None,
             Fault("'limit' is missing: the strategy flux_limit requires it, in kW/m2", show_value=False)),
            *((row % 1 or row >= self.flux_rows or limit <= 0.0,
               Fault(f"must be a row from 0 to {self.flux_rows - 1}, and a limit above 0", ("limits", k)))
              for k, (row, limit) in enumerate(limits)),
            *((row in rows[:k], Fault(f"has a second limit for row {row:g}; remove one", ("limits", k)))
              for k, row in enumerate(rows)),
        )  # fmt: skip


#: Maximum number of instants for which aim points can be chosen separately.
MOST_INSTANTS = 100


def limit_rules(study: FieldEfficiencyStudy) -> tuple[tuple[object, str, str], ...]:
    """Return the rules for a flux limit as tuples (condition of a fault, key, message)."""
    instants, shown = instant_count(study.time), study.output.flux_map
    some = isinstance(study.time, SunDirections) or study.design_point or instants > MOST_INSTANTS
    return (
        (is_limited(study) and not varies(study) and not has_instant(study), "aim",
         "requires an instant at which the flux is limited: add 'design_point', or set 'at: instants'"),
        (varies(study) and some, "aim.at",
         f"applies to at most {MOST_INSTANTS} instants at a site without 'design_point' (got {instants:,}): remove it"),
        (is_limited(study) and shown and flux_cells(study) != cells_of(study), "output.flux_map",
         f"must have the same cells as the flux limit, {' x '.join(map(str, cells_of(study) or ()))}: set "
         "'aim.flux_rows' and 'aim.flux_columns' to the rows and columns of the map"),
    )  # fmt: skip


def images(study: FieldEfficiencyStudy, heliostats: int, instants: int) -> tuple[float, int]:
    """Return the number of rays per heliostat for the images at all instants, and the image memory. [1, bytes]"""
    if study.aim is None or not is_limited(study):
        return 0.0, 0
    aims, kind = study.aim.rows * study.aim.columns, rays.CYLINDER if study.receiver.kind == "cylinder" else 0
    size = image_bytes(kind, heliostats, aims, (study.aim.flux_rows, study.aim.flux_columns), RAYS)
    return float(aims * RAYS * (instants if varies(study) else 1)), size

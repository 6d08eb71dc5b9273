"""Study model of the `field_efficiency` family, with checks across blocks, layouts and the sun."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterable, Iterator
from operator import attrgetter
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from heliosweep.aiming import VARIABLES as AIM_VARIABLES
from heliosweep.config import (
    DIMENSIONS,
    Block,
    Choice,
    Fault,
    Flag,
    Limits,
    Output,
    Quantity,
    Sites,
    SolarTime,
    Study,
    SunDirections,
    Sweep,
    TimeOrDirections,
    Weather,
    WeatherTime,
    civil_clock_problems,
    ends,
    places_of,
    site_notes,
    when,
)
from heliosweep.config import Layout as LayoutBlock
from heliosweep.errors import Problem
from heliosweep.families.field_efficiency.heat import Economics, check_losses, has_heat, heat_rules
from heliosweep.families.field_efficiency.light_checks import aim_faults, light_faults
from heliosweep.families.field_efficiency.losses import (
    Availability,
    FieldSite,
    Tower,
    budget_problems,
    check_availability,
    check_tower,
)
from heliosweep.families.field_efficiency.optics import (
    DIMS,
    NAMES,
    Aim,
    FluxMap,
    Heliostat,
    Optics,
    Receiver,
    has_instant,
    is_limited,
    limit_rules,
)
from heliosweep.families.field_efficiency.variables import NAMES as VARIABLE_NAMES
from heliosweep.grid import check_weather, dark_places, instant_count, weather_faults
from heliosweep.kernels.sun import declination_cooper, solar_clock
from heliosweep.layouts.layout import LAYOUT, PROPERTIES, Layout, check_layout, check_property
from heliosweep.layouts.resolve import SIZE_COLUMNS, Layouts

TRACKING = {
    "spinning_elevation": "rotated about the line of sight to the target, then tilted",
    "azimuth_elevation": "rotated about the vertical, then tilted",
}

#: Reserved names in the result, which layout columns must not use.
RESERVED = frozenset((
    *("heliostat", "time", "utc", "day", "declination", "solar_hour", "site", "latitude", "longitude", "altitude"),
    *("tracking", "layout", "clearance", "inner_radius", "rings", "pivot_height", "receiver_height"),
    *("heliostat_width", "heliostat_height", "heliostat_count", "month", "stage", "cause", "effect", "image", "corner"),
    *("aim_levels", "flux_limit", "kept_heliostats", "kept_power", "kept_heat", "kept_by", "item"),
    *("absorptance", "thermal_losses", "thermal_losses_per_area", "tower_radius", "tower_top", "availability"),
    *(*DIMENSIONS, *NAMES, *VARIABLE_NAMES, *DIMS, *Economics.model_fields, "budget_part", "budget_cause"),
))  # fmt: skip


#: Results by which heliostats can be ranked, with the definition of each result.
BY = {
    "receiver_energy": "energy on the receiver; needs 'weather'",
    "energy_per_mirror_area": "energy on the receiver per mirror area; needs 'weather'",
    "total_efficiency": "mean over the period of the product of all factors; needs 'optics'",
    "optical_efficiency": "mean over the period of the product of cosine, shading and blocking",
    "design_point_total_efficiency": "total efficiency at the design point; needs 'optics' and 'design_point'",
    "design_point_optical_efficiency": "optical efficiency at the design point; needs 'design_point'",
}
#: Study blocks required to rank heliostats by each result.
_NEEDS: dict[str, tuple[str, ...]] = {
    "receiver_energy": ("weather",),
    "energy_per_mirror_area": ("weather",),
    "total_efficiency": ("optics",),
    "design_point_total_efficiency": ("optics", "design_point"),
    "design_point_optical_efficiency": ("design_point",),
}


class Keep(Block):
    """Selection of the best heliostats of a layout. The field is then recomputed with only these heliostats."""

    ONE_OF: ClassVar = ("heliostats", "field_power", "heat_power")

    heliostats: Annotated[
        int | Sweep | None,
        Quantity("Number of heliostats", "1", ge=1, integer=True, dimension="kept_heliostats",
                 title="number of kept heliostats"),
    ] = None  # fmt: skip
    field_power: Annotated[
        float | Sweep | None,
        Quantity("Required field power at the design point, reached with the minimum number of best heliostats",
                 "MW", gt=0,
                 dimension="kept_power", title="required power at the design point"),
    ] = None  # fmt: skip
    heat_power: Annotated[
        float | Sweep | None,
        Quantity("Required receiver heat at the design point, reached with the minimum number of best heliostats",
                 "MW", gt=0,
                 dimension="kept_heat", title="required heat at the design point"),
    ] = None  # fmt: skip
    by: Annotated[str | Sweep, Choice("Result by which heliostats are ranked, in descending order", BY,
                                      dimension="kept_by", title="result by which heliostats are ranked")]  # fmt: skip


def keep_faults(study: FieldEfficiencyStudy) -> Iterator[Fault]:
    """Yield faults in a study with `keep`: missing keys, and keys that cannot be combined with `keep`."""
    keep, point = study.keep, study.design_point
    if keep is None:
        return iter(())
    message = (
        "cannot be used with 'clock: sun', because heliostats are ranked over a period: run a study of a period with "
        "'keep' first; 'heliosweep table DIR' of its result uses the kept heliostats"
    )
    if isinstance(study.time, SunDirections):
        return iter((Fault(message, ("keep",), show_value=False),))
    heat, outlines = keep.heat_power is not None and not has_heat(study), study.output.outlines
    return when(
        *((getattr(study, key) is None, Fault(f"needs '{key}' for {name}: add it, or rank by another result",
                                              ("keep", "by")))
          for name in ends(keep.by) for key in _NEEDS.get(name, ())),
        *((getattr(keep, key) is not None and point is None, Fault("needs a design point: add 'design_point'",
                                                                   ("keep", key)))
          for key in ("field_power", "heat_power")),
        (heat, Fault("needs 'receiver.absorptance' or 'receiver.thermal_losses': add one", ("keep", "heat_power"))),
        (outlines, Fault("cannot be used with 'keep': remove one of them", ("output", "outlines"))),
    )  # fmt: skip


class FieldOutput(Output):
    """Stored variables and their format. The output keys do not affect the identity of the study."""

    OF_POINTS: ClassVar = ("field_geometry",)

    tracking_angles: Annotated[
        bool,
        Flag("Also store the range and maximum rate of both mount angles over the period"),
    ] = False
    field_geometry: Annotated[
        bool, Flag("Also store mirror area, land area, packing factor and radius of the field")
    ] = False
    field_series: Annotated[
        bool, Flag("Also store the efficiencies and powers of the field, and the sun direction, at each instant")
    ] = False
    outlines: Annotated[
        int,
        Quantity(
            "Maximum number of shadow outlines, and of blocking outlines, stored for each mirror in descending order "
            "of area; only for one instant or for sun directions",
            "1", ge=0, le=100, integer=True, sweep=False,
        ),
    ] = 0  # fmt: skip
    flux_map: Annotated[
        FluxMap | None,
        Field(description="Receiver flux map: at the design point or one instant, and over the year"),
    ] = None


class DesignPoint(Block):
    """Design point of a plant: an instant in solar time, and the irradiance."""

    day: Annotated[float, Quantity("Day of the year, for Cooper's declination", "1", ge=1, le=366, sweep=False)]
    solar_hour: Annotated[float, Quantity("Solar time of day; 12 is noon", "h", ge=0, le=24, sweep=False)]
    dni: Annotated[float, Quantity("Direct normal irradiance", "W/m2", gt=0, le=1412, sweep=False)]

    def sun(self, latitude: float) -> NDArray[np.float64]:
        """Return the unit vector to the sun at a latitude [deg], shape (1, 3), with Cooper's (1969) declination. [1]"""
        return solar_clock(np.radians(latitude), declination_cooper([self.day]), self.solar_hour)

    def month(self) -> int:
        """Return the month that contains the day of the design point, counted from 0."""
        return (dt.date(2001, 1, 1) + dt.timedelta(min(int(self.day), 365) - 1)).month - 1


class FieldEfficiencyStudy(Study):
    """Optical efficiency of a heliostat field over a period, with cosine, shading and blocking losses."""

    family: Literal["field_efficiency"]
    site: Annotated[FieldSite | None, Field(description="Site of the plant (for several sites, use 'sites')")] = None
    sites: Annotated[Sites | None, Field(description="Several named sites: a list, or a CSV table")] = None
    tracking: Annotated[str | Sweep, Choice("Tracking method of the mirrors", TRACKING, title="sun-tracking method")]
    time: Annotated[
        TimeOrDirections,
        Field(description="Instants over which efficiencies are averaged, or sun directions"),
    ]
    layout: Annotated[LayoutBlock, Field(description="Layout of the field")]
    heliostat: Annotated[Heliostat, Field(description="Mirror of all heliostats")]
    receiver: Annotated[Receiver, Field(description="Receiver, which also defines the aim point of all heliostats")]
    tower: Annotated[Tower | None, Field(description="Tower that shades the mirrors (default: none)")] = None
    optics: Annotated[
        Optics | None, Field(description="Optics between mirror and receiver, computed by ray tracing (default: none)")
    ] = None
    aim: Annotated[
        Aim | None, Field(description="Aim points of the heliostats (default: the centre of the receiver)")
    ] = None
    weather: Annotated[
        Weather | None,
        Field(description="Weather file or clear-sky model; its direct normal irradiance weights the means over time"),
    ] = None
    availability: Annotated[
        Availability | None, Field(description="Availability of the heliostats; needs 'weather' (default: always)")
    ] = None
    limits: Annotated[Limits | None, Field(description="Conditions for operation of the field; needs 'weather'")] = None
    design_point: Annotated[
        DesignPoint | None, Field(description="Instant and irradiance for which power and efficiencies are also stored")
    ] = None
    keep: Annotated[
        Keep | None,
        Field(description="Selection of the best heliostats for the final field (default: all)"),
    ] = None
    economics: Annotated[
        Economics | None, Field(description="Costs of the field, tower, receiver and heat (default: none)")
    ] = None
    budget: Annotated[
        dict[str, dict[str, Any]] | None,
        Field(description=("Error budget; needs 'weather'. For each cause of a loss, its keys and their undisturbed "
                          "values, such as {slope errors: {optics.slope_error: 0}}")),
    ] = None  # fmt: skip
    output: Annotated[FieldOutput, Field(description="Stored variables and their format")] = FieldOutput()

    def reserved_names(self) -> frozenset[str]:
        """Return the reserved names in the result, which layout columns must not use."""
        return RESERVED | frozenset(AIM_VARIABLES if is_limited(self) else ())

    def rules(self) -> Iterator[Fault]:
        """Check that the study has either sites or sun directions, and the blocks that each key requires."""
        directions, given = (
            isinstance(self.time, SunDirections),
            [key for key in ("site", "sites") if getattr(self, key)],
        )
        series = [key for key in ("time_series", "field_series") if getattr(self.output, key)]
        count, wanted = instant_count(self.time), self.output.flux_map
        checks: tuple[tuple[object, str, str], ...] = (
            (self.output.outlines and count > 1, "output.outlines",
             f"need one instant, but the study has {count:,}: give one, or 'clock: sun' with directions"),
            (self.optics and self.receiver.kind is None, "receiver",
             "'kind' is missing: with 'optics' the receiver has a size, such as {kind: rectangle, width: 12, ...}"),
            (wanted and self.weather is None and not has_instant(self), "output.flux_map",
             "needs one instant or a year: give 'design_point', 'weather', or 'clock: sun' with directions"),
            *((self.optics is None and attrgetter(key)(self) is not None, key,
               "needs 'optics': add 'optics', or remove this key")
              for key in ("receiver.kind", "heliostat.focus", "heliostat.facets", "aim", "output.flux_map")),
            *heat_rules(self),
            *limit_rules(self),
            *((directions, name, "is not needed: 'time' gives the direction of the sun") for name in given),
            *((directions, f"output.{key}",
               "needs instants: with 'clock: sun' each direction is a point of the result") for key in series),
            (directions and self.design_point, "design_point",
             "needs a site: with 'clock: sun' give this direction of the sun in 'time'"),
            (not directions and not given, "", "give 'site' or 'sites'"),
            (not directions and len(given) > 1, "sites", "give 'site' or 'sites', not both"),
        )  # fmt: skip
        yield from weather_faults(self)
        yield from keep_faults(self)
        yield from when(*(
            (wrong, Fault(message, tuple(key.split(".")) if key else (), show_value=False))
            for wrong, key, message in checks
        ))  # fmt: skip

    def dimension_names(self) -> dict[str, str]:
        """Return the names of the dimensions, as in `Study.dimension_names`.

        If the study has several sites, weather files vary along the site dimension.
        """
        names = super().dimension_names()
        return names | {"weather.file": "site"} if self.sites is not None and "weather.file" in names else names

    def examinations(self) -> Iterable[Callable[[FieldEfficiencyStudy], Iterable[Problem | str]]]:
        """Return the functions that check relations between study blocks, the layout and the sun."""
        return (
            _sun, site_notes, _columns, _mirrors, _tower, check_tower, light_faults, check_losses, aim_faults,
            check_weather, check_availability, budget_problems,
        )  # fmt: skip


def _sun(study: FieldEfficiencyStudy) -> Iterator[Problem | str]:
    """Check that the sun rises and is up at the design point for at least one site, and warn about other sites."""
    if isinstance(study.time, SunDirections):
        heights = ends(study.time.elevation)
        if max(heights) <= 0:
            yield study.problem("time.elevation", "the sun is never above the horizon")
        elif min(heights) <= 0:
            yield "results are missing (NaN) if the sun is not above the horizon"
        return
    if not isinstance(study.time, SolarTime) and (missing := list(civil_clock_problems(study))):
        yield from missing
        return
    if (point := study.design_point) is not None:
        latitudes = [latitude for site in places_of(study) for latitude in ends(site.latitude)]
        down = [latitude for latitude in latitudes if point.sun(latitude)[0, 2] <= 0]
        if down and len(down) == len(latitudes):
            yield study.problem("design_point", f"the sun is down at this instant at latitude {down[0]:g} deg")
        elif down:
            where = f"at latitude {down[0]:g} deg: results for this site are missing (NaN)"
            yield f"the sun is down at the design point {where}"
    if not isinstance(study.time, WeatherTime):
        missing_there = "its efficiencies are missing (NaN), and its energies are 0"
        yield from dark_places(study, "its result is missing (NaN)" if study.weather is None else missing_there)


def _columns(study: FieldEfficiencyStudy) -> Iterator[Problem | str]:
    """Check the layout columns that the study uses, and warn about unused columns."""
    layouts, optics = Layouts(study), study.optics
    needed = {key: PROPERTIES[key].key for key in (*SIZE_COLUMNS, "pivot_height")}
    if study.heliostat.focus == LAYOUT:
        needed |= dict.fromkeys(("focal_x", "focal_y"), "heliostat.focus")
    if optics is not None and (optics.slope_map, optics.slope_error_horizontal) == (None, None):
        needed["slope_error"] = "optics.slope_error"
    for layout, values in layouts.some():
        for name, key in needed.items():
            if values.get(key) in (None, LAYOUT) and name not in layout.columns:
                yield study.problem(
                    key, f"is missing: give it in {PROPERTIES[name].unit}, or as a column {name!r} of the layout"
                )
        for name in layouts.uses(layout):
            if not name.startswith("aim"):
                yield from _in_study(study, layout, check_property(layout, name))
    yield from layouts.remarks()


def _mirrors(study: FieldEfficiencyStudy) -> Iterator[Problem | str]:
    """Check that mirrors do not collide; warn if mirrors can touch each other or the ground."""
    keys = {f"heliostat.{side}": max for side in SIZE_COLUMNS} | {"heliostat.pivot_height": min}
    for layout, values in Layouts(study).some(keys):
        width, height, pivot = (
            layout.values(name, values.get(f"heliostat.{name}")) for name in (*SIZE_COLUMNS, "pivot_height")
        )
        if not np.isfinite(width + height).all():
            return
        colliding, touching = (_in_study(study, layout, found) for found in check_layout(layout, width, height))
        yield from colliding
        yield from map(str, touching)
        centre = pivot if pivot.any() else layout.z
        low = np.flatnonzero(centre - height / 2 < 0)
        if low.size and (pivot.any() or not layout.z.any()):
            row = low[0]
            yield (
                f"the mirrors of {low.size:,} heliostats reach into the ground when upright: the centre of "
                f"{layout.where(row)} is {centre[row]:g} m high, half of its mirror height is {height[row] / 2:g} m"
            )


def _tower(study: FieldEfficiencyStudy) -> Iterator[Problem | str]:
    """Check that the receiver is above all mirrors, and that `keep` needs no more heliostats than the layout has."""
    for layout, values in Layouts(study).some({"heliostat.pivot_height": max, "receiver.height": min}):
        centre = layout.z + layout.values("pivot_height", values.get("heliostat.pivot_height"), 0.0)
        top, receiver = centre.max(initial=-np.inf), values["receiver.height"]
        if receiver <= top:
            message = f"must be above the mirrors, whose highest centre is at {top:g} m (got {receiver:g})"
            yield study.problem("receiver.height", message)
            break
    if study.keep is not None and study.keep.heliostats is not None:
        most, least = max(ends(study.keep.heliostats)), min(len(layout) for layout, _ in Layouts(study).some())
        if most > least:
            message = f"must be at most the number of heliostats of the layout, {least:,}: generate more (got {most:g})"
            yield study.problem("keep.heliostats", message)


def _in_study(study: FieldEfficiencyStudy, layout: Layout, found: list[Problem]) -> list[Problem]:
    """Merge all problems of a generated layout into one problem, because users cannot correct generated rows."""
    if layout.lines is not None or not found:
        return found
    more = f" (and {len(found) - 1:,} more)" if len(found) > 1 else ""
    return [study.problem("layout", found[0].message + more)]

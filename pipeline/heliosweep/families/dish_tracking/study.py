"""Define the study keys of the `dish_tracking` family, and check blocks, dates and weather."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from heliosweep.config import (
    Block,
    Choice,
    CivilTime,
    Drawn,
    Fault,
    FileName,
    Flag,
    Quantity,
    Samples,
    Site,
    Sites,
    Study,
    Sweep,
    WallTime,
    Window,
    civil_clock_problems,
    ends,
    read_weather,
    site_notes,
)
from heliosweep.errors import Problem
from heliosweep.grid.sun import night_share

MODELS = {
    "rigid": "the whole mount is tilted, and the controller does not correct the tilt",
    "untilted_home_axes": "only the azimuth axis is tilted; the home positions are correct (Liu et al. 2022)",
}
#: Maximum number of tilt directions that are checked for repetitions. Fraction of nighttime instants above which a
#: warning is given. Name of the window from sunrise to sunset.
MOST_DIRECTIONS, NIGHT, SUNLIT = 100_000, 0.01, "sunrise_to_sunset"


@dataclass(frozen=True)
class SunTime(WallTime):
    """Wall-clock time of day, or the name of a sun event (sunrise or sunset)."""

    event: str = field(default="", kw_only=True)

    def read(self, raw: Any) -> str:
        """Return the name of the event or the time, as written in the study file. Raises Invalid."""
        return raw if raw == self.event else super().read(raw)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a time of day or of the event's name."""
        return {"anyOf": [{"const": self.event}, super().json_schema()]}


class DishWindow(Block):
    """Daily time window: between two wall-clock times, or from sunrise to sunset.

    The word ``sunrise_to_sunset`` is short for ``{start: sunrise, stop: sunset, step: 10 min}``.
    """

    start: Annotated[str, SunTime("Wall-clock time at which the window begins, HH:MM, or sunrise", event="sunrise")]
    stop: Annotated[str, SunTime("Wall-clock time at which the window ends, HH:MM, or sunset", event="sunset")]
    step: Annotated[
        float,
        Quantity(
            "Time between instants; from sunrise to sunset, the nearest step that divides the window equally",
            "h",
            gt=0,
            le=24,
            sweep=False,
        ),
    ]

    @model_validator(mode="before")
    @classmethod
    def _from_word(cls, raw: Any) -> Any:
        return {"start": "sunrise", "stop": "sunset", "step": "10 min"} if raw == SUNLIT else raw

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"const": SUNLIT}, handler(schema)]}

    @property
    def sunlit(self) -> bool:
        """True if the window extends from sunrise to sunset."""
        return self.start == "sunrise"

    def rules(self) -> Iterator[Fault]:
        """Check that start and stop are both sun events, or wall-clock times at least one step apart."""
        if self.sunlit != (self.stop == "sunset"):
            yield Fault("must extend from sunrise to sunset, or between two wall-clock times", ("stop",))
        elif not self.sunlit:
            yield from Window.rules(self)  # type: ignore[arg-type]


class DishTime(CivilTime):
    """Dates and a daily window, with the option to omit instants at which the sun is below the horizon."""

    window: Annotated[DishWindow, Field(description="Daily time window")]  # type: ignore[assignment]
    daylight_only: Annotated[bool, Flag("True to evaluate only instants with the sun above the horizon")] = False

    def rules(self) -> Iterator[Fault]:
        """Check that the dates increase, and that a wall-clock window contains a whole number of steps.

        Inclusive sampling does not require a whole number of steps.
        """
        if not self.window.sunlit:
            yield from super().rules()
        if any(later <= earlier for earlier, later in itertools.pairwise(self.date_list())):
            yield Fault("must increase", ("dates",), show_value=False)

    def window_seconds(self) -> tuple[float, float, float]:
        """Return the start and end of the window, measured from midnight, and the time step. [s]"""
        return (0.0, 86400.0, self.window.step * 3600) if self.window.sunlit else super().window_seconds()


class DishMount(Block):
    """Model of the tilted mount."""

    model: Annotated[str | Sweep, Choice("Model of the tilted mount", MODELS, title="model of the tilted mount")]


class MountErrors(Block):
    """Mount errors that the controller does not correct."""

    axis_tilt: Annotated[
        float | Sweep,
        Quantity("Tilt of the azimuth axis from the vertical", "deg", ge=0, le=90, title="tilt of the azimuth axis"),
    ]
    axis_tilt_direction: Annotated[
        float | Sweep,
        Quantity(
            "Direction in which the foot of the axis leans: 0 south, 90 west",
            "deg",
            ge=-360,
            le=360,
            title="direction in which the foot of the azimuth axis leans, from south towards west",
        ),
    ] = 0.0
    home_azimuth_offset: Annotated[
        float | Sweep,
        Quantity("Offset of the home position in azimuth", "deg", ge=-180, le=180, title="home azimuth offset"),
    ] = 0.0
    home_elevation_offset: Annotated[
        float | Sweep,
        Quantity("Offset of the home position in elevation", "deg", ge=-180, le=180, title="home elevation offset"),
    ] = 0.0
    azimuth_reference: Annotated[
        float | Sweep | None,
        Quantity(
            "Excess rotation of the whole mount about its azimuth axis, clockwise seen from above",
            "deg",
            ge=-180,
            le=180,
            title="azimuth reference error",
        ),
    ] = None
    non_orthogonality: Annotated[
        float | Sweep | None,
        Quantity(
            "Angle between the elevation axis and the plane normal to the azimuth axis, positive if the end to the "
            "right of the focal axis is lower",
            "deg",
            ge=-45,
            le=45,
            title="non-orthogonality",
        ),
    ] = None
    collimation: Annotated[
        float | Sweep | None,
        Quantity(
            "Angle between the focal axis and the plane normal to the elevation axis, positive to the right; equal to "
            "home_azimuth_offset with the opposite sign",
            "deg",
            ge=-45,
            le=45,
            title="collimation error",
        ),
    ] = None


def _length(description: str, title: str) -> Quantity:
    return Quantity(description, "m", gt=0, le=1000, title=title)


class Concentrator(Block):
    """Paraboloid with a round aperture at its focus, for computing the annual energy from a weather file."""

    weather: Annotated[
        str,
        FileName("Weather file with the direct normal irradiance of a year; the energy includes all hours with the "
                 "sun above the horizon, not only the hours in 'time'", sweep=False),
    ]  # fmt: skip
    focal_length: Annotated[float | Sweep, _length("Focal length", "focal length of the dish")]
    diameter: Annotated[float | Sweep, _length("Diameter of the mirror", "diameter of the dish")]
    aperture_radius: Annotated[
        float | Sweep, _length("Radius of the aperture in the focal plane", "radius of the aperture")
    ]
    spread: Annotated[
        float | Sweep,
        Quantity("Standard deviation per axis of the direction of the reflected light, from sun, slope errors (twice) "
                 "and specularity", "mrad", ge=0.1, le=100, title="spread of the reflected light"),
    ]  # fmt: skip

    def rules(self) -> Iterator[Fault]:
        """Check that the rim angle of the mirror is below 90 deg."""
        if max(ends(self.diameter)) >= 4.0 * min(ends(self.focal_length)):
            yield Fault("must be below four times the focal length", ("diameter",))


class Ephemeris(Block):
    """Settings of the solar position algorithm (SPA)."""

    elevation: Annotated[
        str,
        Choice(
            "Elevation of the sun that the mount tracks",
            {"geometric": "without refraction", "apparent": "with atmospheric refraction"},
            sweep=False,
        ),
    ] = "geometric"
    pressure: Annotated[
        float, Quantity("Air pressure, for the apparent elevation", "hPa", ge=0, le=1200, sweep=False)
    ] = 1013.25
    temperature: Annotated[
        float, Quantity("Air temperature, for the apparent elevation", "degC", ge=-90, le=70, sweep=False)
    ] = 12.0

    delta_t: Annotated[
        float | None,
        Quantity(
            "Terrestrial time minus universal time (default: from the year and month)",
            "s",
            ge=-1000,
            le=10_000,
            sweep=False,
        ),
    ] = None


class Statistics(Block):
    """Settings for tolerable tilts, which are computed by root finding."""

    required_factor: Annotated[
        Sweep,
        Samples(
            "Required minimum daily tracking factors; the maximum tolerable tilt is computed for each factor",
            "1",
            ge=0,
            lt=1,
            title="required effective tracking factor",
        ),
    ]


class DishTrackingStudy(Study):
    """Effective tracking factor of a dish with mount errors."""

    family: Literal["dish_tracking"]
    site: Annotated[Site | None, Field(description="Site of the dish (for several sites, use 'sites')")] = None
    sites: Annotated[Sites | None, Field(description="Several named sites: a list, or a CSV table")] = None
    time: Annotated[DishTime, Field(description="Dates and daily window of the tracking factor")]
    mount: Annotated[DishMount, Field(description="Mount model")]
    errors: Annotated[MountErrors, Field(description="Mount errors")]
    tolerance: Annotated[
        float | Sweep,
        Quantity(
            "Tracking error at which the factor is zero, e_f in the paper",
            "mrad",
            ge=1e-6,
            le=1e6,
            dimension="tracking_tolerance",
            title="tolerance",
        ),
    ]
    clip: Annotated[bool, Flag("True to limit each error to `tolerance`")] = False
    concentrator: Annotated[
        Concentrator | None, Field(description="Mirror and aperture, for the annual energy (default: none)")
    ] = None
    statistics: Annotated[
        Statistics | None,
        Field(description=("Results computed by root finding, in addition to the values on the grid")),
    ] = None
    ephemeris: Annotated[Ephemeris, Field(description="Solar position algorithm")] = Ephemeris()

    def rules(self) -> Iterator[Fault]:
        """Check that either `site` or `sites` is given, and that stored instants are common to all sites."""
        if (self.site is None) == (self.sites is None):
            yield Fault("give either 'site' or 'sites'", show_value=False)
        if self.concentrator is not None and self.site is None:
            yield Fault("contains data of one site: give 'site'", ("concentrator", "weather"), show_value=False)
        if self.output.time_series and self.time.window.sunlit:
            message = "needs a window between wall-clock times, because instants from sunrise to sunset differ"
            yield Fault(f"{message} between sites", ("output", "time_series"), show_value=False)

    def examinations(self) -> Iterable[Callable[[DishTrackingStudy], Iterable[Problem | str]]]:
        """Return the functions that check civil clocks, sites, tilt directions, nighttime instants and weather."""
        return civil_clock_problems, site_notes, _doubts, _weather


def _weather(study: DishTrackingStudy) -> Iterator[Problem | str]:
    if study.concentrator is not None:
        yield from read_weather(study.resolve(study.concentrator.weather)).notes


def _doubts(study: DishTrackingStudy) -> Iterator[Problem | str]:
    """Yield problems if tilt directions repeat, or if 'zip' ties the tilt to another key.

    Yield a warning if many of the evaluated instants are at night.
    """
    direction = study.errors.axis_tilt_direction
    if isinstance(direction, Sweep) and not isinstance(direction, Drawn) and len(direction) <= MOST_DIRECTIONS:
        turns = np.round(np.mod(direction.values(), 360.0), 9) % 360.0
        if len(np.unique(turns)) < len(direction):
            message = "contains the same direction twice (directions 360 deg apart are equal)"
            yield study.problem("errors.axis_tilt_direction", message)
    tied = any("errors.axis_tilt" in dim.sweeps and len(dim.sweeps) > 1 for dim in study.dimensions())
    if study.statistics is not None and tied:
        message = "cannot be computed if 'zip' ties errors.axis_tilt to another key"
        yield study.problem("statistics.required_factor", message)
    counted = not (study.time.window.sunlit or study.time.daylight_only or list(civil_clock_problems(study)))
    if counted and (share := night_share(study)) > NIGHT:
        yield (
            f"the sun is below the horizon at about {100 * share:.0f} % of the instants, which are evaluated like "
            "all other instants: set time.daylight_only: true to omit them"
        )

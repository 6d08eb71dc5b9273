"""Define the study keys of the `misalignment` family, and check blocks, layouts and the sun."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import PurePath
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from heliosweep.config import (
    MAX_SAMPLES,
    MAX_SEED,
    Block,
    Choice,
    CivilTime,
    Fault,
    FileName,
    Invalid,
    Layout,
    ListOfNumbers,
    Parameter,
    Quantity,
    Samples,
    Schema,
    Site,
    Sites,
    Study,
    Sweep,
    Time,
    TimeZone,
    civil_clock_problems,
    ends,
    free_text,
    object_schema,
    one_of,
    read_items,
    read_mapping,
    site_notes,
    when,
)
from heliosweep.config import Receiver as ReceiverPoint
from heliosweep.errors import Problem, StudyError
from heliosweep.families.misalignment.spots_file import COLUMNS, SCALED, MeasuredSpots, examine_table, read_spots
from heliosweep.families.mount_errors import NOT_DRAWN, MountAngles
from heliosweep.grid.sun import dark_places
from heliosweep.kernels.mounts import ERRORS
from heliosweep.layouts.layout import Layout as Places
from heliosweep.layouts.resolve import Layouts

Rule: TypeAlias = tuple[object, Fault]
Triple = tuple[float, float, float]

#: Mount kinds, in the order of their codes in the kernels.
MOUNTS = {
    "azimuth_elevation": "vertical primary axis",
    "target_aligned": "primary axis towards the target",
    "polar": "primary axis towards the celestial north pole",
    "tilt_roll": "horizontal primary axis with the azimuth axis_azimuth",
}
#: Error sources, in the order of their codes in the kernels.
SOURCES = {
    "canting": "the mirror rotates about its centre",
    "encoder": "the mirror, including its offset, rotates about the pivot",
    "tilt": "the whole mount rotates about its base, pedestal_height below the pivot",
}
#: Error axes, in the order of their codes in the kernels.
AXES = {
    "elevation": "about the horizontal axis in the mirror plane; positive errors raise the normal",
    "azimuth": "about the upward axis in the mirror plane; positive clockwise, seen from the end of the primary axis",
    "encoder_azimuth": "about the primary axis of the mount; positive clockwise, seen from the end of the axis",
}
#: Function that creates a fault whose message omits the invalid value.
fault = partial(Fault, show_value=False)
#: Role of the mount errors in each mode that requires them if the study has no spot table.
TRUTH = {
    "mount_errors": "the mount errors",
    "calibration": "the true errors of synthetic spots",
    "detectors": "the true errors of synthetic crossings",
}
LOSSES = {"squared": "least squares", "huber": "linear beyond loss_scale", "cauchy": "logarithmic beyond loss_scale"}


class Sun(Block):
    """Fixed position of the sun or of a laboratory lamp."""

    azimuth: Annotated[
        float | Sweep,
        Quantity(
            "Azimuth of the sun, clockwise from north",
            "deg", ge=-360, le=360, dimension="sun_azimuth", title="azimuth of the sun, clockwise from north",
            standard_name="solar_azimuth_angle",
        ),
    ]  # fmt: skip
    elevation: Annotated[
        float | Sweep,
        Quantity(
            "Elevation of the sun", "deg", gt=0, le=90, dimension="sun_elevation", title="elevation of the sun",
            standard_name="solar_elevation_angle",
        ),
    ]  # fmt: skip


class Receiver(ReceiverPoint):
    """Flat rectangular receiver whose centre is the aim point of all heliostats."""

    azimuth: Annotated[
        float | Sweep,
        Quantity(
            "Azimuth of the receiver's outward normal, clockwise from north; at 0, it faces a field in the north",
            "deg", ge=-360, le=360, dimension="receiver_azimuth", title="azimuth of the receiver's normal",
        ),
    ] = 0.0  # fmt: skip
    tilt: Annotated[
        float | Sweep,
        Quantity(
            "Tilt of the receiver's outward normal above the horizontal; negative if the receiver faces down",
            "deg", ge=-90, le=90, dimension="receiver_tilt", title="tilt of the receiver's normal above the horizontal",
        ),
    ] = 0.0  # fmt: skip
    width: Annotated[
        float | Sweep,
        Quantity("Width of the aperture", "m", gt=0, dimension="receiver_width", title="width of the aperture"),
    ]
    height_extent: Annotated[
        float | Sweep,
        Quantity(
            "Height of the aperture, measured along the receiver's face",
            "m", gt=0, dimension="receiver_height_extent", title="height of the aperture",
        ),
    ]  # fmt: skip


class Heliostats(Block):
    """Positions of the heliostats' pivots."""

    positions: Annotated[
        tuple[Triple, ...] | None,
        ListOfNumbers(
            "Pivot positions relative to the tower's base: east, north and up; instead of 'layout'",
            "m",
            ("x", "y", "z"),
        ),
    ] = None
    pivot_height: Annotated[
        float | Sweep | None,
        Quantity(
            "Height of the pivot above the heliostat's base; requires a 'layout' (default: 0)",
            "m", ge=0, title="height of the pivot above the heliostat's base",
        ),
    ] = None  # fmt: skip


class Mount(Block):
    """Two-axis mount of all heliostats."""

    kind: Annotated[
        str | Sweep, Choice("Direction of the primary axis", MOUNTS, dimension="mount_kind", title="kind of mount")
    ] = "azimuth_elevation"
    mirror_offset: Annotated[
        float | Sweep,
        Quantity(
            "Distance from the elevation axis to the mirror's centre, along the mirror's normal",
            "m", ge=0, title="offset of the mirror along its normal",
        ),
    ] = 0.0  # fmt: skip
    axis_offset: Annotated[
        float | Sweep,
        Quantity(
            "Distance from the primary axis to the elevation axis, positive to the front; 0 in mode: curves",
            "m", title="offset of the elevation axis from the primary axis",
        ),
    ] = 0.0  # fmt: skip
    pedestal_height: Annotated[
        float | Sweep,
        Quantity(
            "Vertical distance from the pivot down to the point about which the mount tilts",
            "m", ge=0, title="height of the pivot above the point about which the mount tilts",
        ),
    ] = 0.0  # fmt: skip
    axis_azimuth: Annotated[
        float | Sweep,
        Quantity(
            "Azimuth of the primary axis of a tilt_roll mount, clockwise from north",
            "deg", ge=-360, le=360, title="azimuth of the primary axis",
        ),
    ] = 0.0  # fmt: skip


class Error(Block):
    """Misalignment for which deviation curves are computed."""

    source: Annotated[str | Sweep, Choice("Misaligned part", SOURCES, title="source of the error")] = "canting"
    axis: Annotated[str | Sweep, Choice("Axis of the error", AXES, title="axis of the error")] = "elevation"
    size: Annotated[
        float | Sweep,
        Quantity(
            "Angle of the error",
            "mrad", ge=-1500, le=1500, dimension="error_size", title="angle of the error",
        ),
    ]  # fmt: skip


class Beam(Block):
    """Conical beam with a given divergence and width."""

    divergence: Annotated[
        float | Sweep,
        Quantity("Full divergence angle of the beam (9.3 mrad for sunlight)", "mrad", gt=0, le=500,
                 dimension="beam_divergence", title="full angle of the beam"),
    ]  # fmt: skip
    width: Annotated[
        float | Sweep,
        Quantity("Width of the beam at the mirror", "m", ge=0, le=100, dimension="beam_width",
                 title="width of the beam at the mirror"),
    ] = 0.0  # fmt: skip


class MountErrors(MountAngles):
    """Mount errors. Each error is fixed, swept, or drawn from a distribution."""

    samples: Annotated[
        int | None,
        Quantity("Number of draws from each distribution", "1", ge=1, le=MAX_SAMPLES, integer=True, sweep=False),
    ] = None
    seed: Annotated[
        int | None,
        Quantity(
            "Seed for distributions without a seed of their own", "1", ge=0, le=MAX_SEED, integer=True, sweep=False
        ),
    ] = None

    def draws(self) -> int:
        """Return the number of draws for each heliostat; 0 if no error is drawn."""
        drawn = self.drawn().values()
        return max(self.samples or 1, *(error.samples or 1 for error in drawn)) if drawn else 0

    def rules(self) -> Iterator[Fault]:
        """Check that the number of draws is given and is the same for all distributions."""
        drawn = self.drawn()
        given = {("samples",): self.samples} | {(name, "samples"): error.samples for name, error in drawn.items()}
        counts = {path: count for path, count in given.items() if count is not None}
        first = next(iter(counts.values()), 0)
        idle = {"samples": self.samples is not None, "scale": self.scale != 1}
        yield from when(
            *((wrong and not drawn, fault(NOT_DRAWN, (key,))) for key, wrong in idle.items()),
            (drawn and not counts,
             fault("'samples' is missing: give the number of draws from each distribution")),
            *((count != first, Fault(f"must be {first:,}, because all errors need the same number of draws", path))
              for path, count in counts.items()),
        )  # fmt: skip


class Statistics(Block):
    """Settings for statistics over the draws."""

    percentiles: Annotated[
        Sweep, Samples("Percentiles of the remaining tolerance", "1", ge=0, le=100, title="percentile")
    ]


_PARAMETERS = Quantity(
    "Number of estimated errors: 2 for the encoder references, 4 to add the tilts, 6 for all errors",
    "1", integer=True, only=(2, 4, 6), title="number of estimated errors",
)  # fmt: skip
_LIMIT = Quantity(
    "Condition number above which a warning is given (default: 1000 for six errors, otherwise 100)",
    "1", ge=1, sweep=False,
)  # fmt: skip
#: Methods that correct the commands in a closed loop.
CORRECTIONS = {
    "mount": "mount errors, estimated from all previous crossings",
    "instant": "offsets of both encoders, estimated for each instant from its crossings in the previous round",
}


#: Maximum number of detector arrays.
MAX_ARRAYS = 100


class DetectorArray(Block):
    """Detectors along a polyline."""

    points: Annotated[
        tuple[tuple[float, float], ...],
        ListOfNumbers(
            "Vertices of the polyline: distances to the right of the aim point and above it", "m", ("y", "z")
        ),
    ]


class Detectors(Block):
    """Detectors in the receiver plane, and settings for estimating mount errors from detector readings."""

    lines: Annotated[
        tuple[Triple, ...] | None,
        ListOfNumbers(
            "Infinite lines l0 Y + l1 Z = l2, with Y to the right and Z up, in m", ("1", "1", "m"), ("l0", "l1", "l2")
        ),
    ] = None
    arrays: Annotated[
        tuple[DetectorArray, ...] | None,
        Field(description=f"Detector arrays along polylines, at most {MAX_ARRAYS}; mode: detectors only"),
    ] = None
    pitch: Annotated[
        float | Sweep | None,
        Quantity("Distance between the detectors of an array; positions are rounded to the nearest detector (default: "
                 "no rounding)",
                 "m", ge=0, dimension="detector_pitch", title="distance between the detectors"),
    ] = None  # fmt: skip
    noise: Annotated[
        float | Sweep | None,
        Quantity("Standard deviation of the noise in positions along an array (default: 0)", "m", ge=0,
                 dimension="detector_noise", title="noise of the position along an array"),
    ] = None  # fmt: skip
    parameters: Annotated[
        int | Sweep | None, replace(_PARAMETERS, description=f"{_PARAMETERS.description} (default: 4)")
    ] = None
    correction: Annotated[
        str | Sweep | None,
        Choice("Method that corrects the commands (default: mount)", CORRECTIONS, title="correction of the commands"),
    ] = None
    rounds: Annotated[
        int | None,
        Quantity("Number of closed-loop rounds, each over all days and hours (default: 1)", "1", ge=1, le=50,
                 integer=True, sweep=False),
    ] = None  # fmt: skip
    crossings: Annotated[
        str | None,
        FileName(
            "CSV table of measured crossings: heliostat, trace, y and z in m, time or sun "
            "vector, optional weight (default: synthetic crossings computed with 'mount_errors')",
            sweep=False,
        ),
    ] = None
    condition_limit: Annotated[float | None, _LIMIT] = None

    def rules(self) -> Iterator[Fault]:
        """Check the detectors, and that measured crossings are not combined with a closed loop."""
        arrays, pitch = self.arrays or (), 0.0 if self.pitch is None else max(ends(self.pitch))
        shortest = min((sum(itertools.starmap(math.dist, itertools.pairwise(one.points))) for one in arrays), default=0)
        message = "applies only to synthetic crossings, because a table of crossings has no commands: remove it"
        yield from when(
            (self.lines is None and self.arrays is None,
             fault("has no detectors: give 'arrays', a list of {points: [[y, z], ...]}, or 'lines'")),
            (self.arrays is not None and not 1 <= len(arrays) <= MAX_ARRAYS,
             fault(f"must have 1 to {MAX_ARRAYS} arrays (got {len(arrays):,})", ("arrays",))),
            (arrays and pitch > shortest,
             fault(f"must be at most {shortest:.6g} m, the length of the shortest array (got {pitch:g})",
                   ("pitch",))),
            *((not any(line[:2]),
               Fault("is not a line: the first two numbers must not both be zero", ("lines", number)))
              for number, line in enumerate(self.lines or ())),
            *((len(one.points) < 2,
               fault("must have at least two points, the ends of the line", ("arrays", number, "points")))
              for number, one in enumerate(arrays)),
            *((self.crossings is not None and getattr(self, key) is not None, fault(message, (key,)))
              for key in ("rounds", "correction")),
        )  # fmt: skip


@dataclass(frozen=True)
class SpotColumns(Parameter):
    """Column titles in a spot table."""

    def read(self, raw: Any) -> dict[str, dict[str, Any]]:
        """Return the title, the scale and the offset of each column. Raises Invalid."""
        readers = {key: partial(self._column, key in SCALED) for key in COLUMNS if key != "comment"}
        found = read_mapping(raw, readers, (), "write {column: title}, such as {heliostat: Heliostat}")
        keys: dict[str, str] = {}
        for key, one in found.items():
            if (first := keys.setdefault(one["from"], key)) != key:
                raise Invalid(Fault(f"{one['from']!r} is also the title of {first}", (key,)))
        return found

    def _column(self, scaled: bool, raw: Any) -> dict[str, Any]:
        if isinstance(raw, str):
            return {"from": raw}
        number = Quantity("", "1", sweep=False).read
        readers: dict[str, Any] = {"from": free_text} | ({"scale": number, "offset": number} if scaled else {})
        found = read_mapping(raw, readers, ("from",), "write a title, or {from: title, scale, offset}")
        if found.get("scale") == 0:
            raise Invalid(Fault("must not be 0", ("scale",)))
        return found

    def _one_schema(self) -> Schema:
        title: Schema = {"type": "string", "minLength": 1}
        numbers: Any = {key: {"type": ["number", "string"]} for key in ("scale", "offset")}
        column = {"anyOf": [title, object_schema("", {"from": title}, numbers)]}
        return object_schema("", {}, {key: column for key in COLUMNS if key != "comment"})


@dataclass(frozen=True)
class HeldOut(Parameter):
    """Number of held-out spots, or a list of their names."""

    def read(self, raw: Any) -> int | tuple[str, ...]:
        """Return the number of held-out spots, or their names. Raises Invalid."""
        if isinstance(raw, str):
            raise Invalid("must be a number of spots, or a list of names in the column 'spot'")
        if isinstance(raw, list | tuple):
            return read_items([str(name) for name in raw], free_text)
        return int(Quantity("", "1", ge=1, integer=True, sweep=False).read(raw))

    def _one_schema(self) -> Schema:
        names = {"type": "array", "items": {"type": ["string", "integer"]}, "minItems": 1}
        return {"anyOf": [{"type": "integer", "minimum": 1}, names]}


class Calibration(Block):
    """Settings for estimating mount errors from spots."""

    parameters: Annotated[int | Sweep, _PARAMETERS] = 4
    spots: Annotated[
        str | Sweep | None,
        FileName(
            "CSV table of measured spots: heliostat, y and z in m, time or sun vector, optional weight (default: "
            "synthetic spots computed with 'mount_errors'). A list of files adds the dimension campaign",
            dimension="campaign", title="file of measured spots",
        ),
    ] = None  # fmt: skip
    columns: Annotated[
        Mapping[str, Any] | None,
        SpotColumns("Column titles in the file 'spots', each given as a title or as {from: title, scale, offset}"),
    ] = None
    held_out: Annotated[
        int | tuple[str, ...] | None,
        HeldOut("Spots that test the calibration and are excluded from the fit: a list of names in the column 'spot', "
                "or a number, which selects the latest spots of each heliostat (the last in the file if they have no "
                "times)"),
    ] = None  # fmt: skip
    window: Annotated[
        float | None,
        Quantity(
            "Length of the moving windows in which errors are estimated separately to detect drift",
            "d",
            gt=0,
            sweep=False,
        ),
    ] = None
    window_step: Annotated[
        float | None,
        Quantity(
            "Time between the starts of consecutive windows (default: the length of a window)", "d", gt=0, sweep=False
        ),
    ] = None
    timezone: Annotated[
        str | None, TimeZone("Time zone for spot times without an offset: an offset such as +08:00, or an IANA name")
    ] = None
    noise: Annotated[
        float | Sweep,
        Quantity(
            "Standard deviation of the noise in each coordinate of synthetic spots",
            "m",
            ge=0,
            title="noise of the spots",
        ),
    ] = 0.0
    days_used: Annotated[
        int | Sweep | None,
        Quantity(
            "Number of days with synthetic spots, counted from the first day of 'time' (default: all days)",
            "1", ge=1, integer=True, title="number of days with spots",
        ),
    ] = None  # fmt: skip
    loss: Annotated[str | Sweep, Choice("Loss function for the residuals", LOSSES, title="loss function")] = "squared"
    loss_scale: Annotated[
        float | Sweep,
        Quantity(
            "Residual above which a robust loss grows more slowly than the square of the residual",
            "m",
            gt=0,
            title="scale of the loss",
        ),
    ] = 0.1
    condition_limit: Annotated[float | None, _LIMIT] = None


#: Modes that allow each block. Blocks that are not listed here are allowed in all modes.
BLOCKS_OF_MODES = {
    "error": ("curves",),
    "beam": ("curves",),
    "measured": ("curves",),
    "detectors": ("curves", "detectors"),
    "mount_errors": ("curves", "mount_errors", "calibration", "detectors"),
    "statistics": ("mount_errors",),
    "calibration": ("calibration",),
}
#: Names of all result variables and coordinates. The names are repeated here because importing the modules that declare
#: the variables is slow. A test compares this list with the declared variables.
_NAMES_OF_RESULTS = """
    heliostat layout clearance inner_radius rings heliostat_count pivot_height site latitude longitude altitude
    sun_azimuth sun_elevation time day declination date hour utc sample percentile tolerance_axis spot receiver_height
    receiver_azimuth receiver_tilt receiver_width receiver_height_extent mount_kind mirror_offset axis_offset
    pedestal_height axis_azimuth source axis error_size conic_coefficient detector error_scale parameter parameter_2
    parameters noise days_used loss loss_scale l0 l1 l2
    spot_y spot_z spot_status is_real inside hit_fraction tracking_tolerance conic eccentricity focus_y focus_z
    minimum_tolerance day_of_minimum_tolerance hour_of_minimum_tolerance declination_of_minimum_tolerance
    date_of_minimum_tolerance crossing_y crossing_z crossing_error
    spot_y_mean spot_z_mean spot_y_variance spot_z_variance spot_yz_covariance real_fraction remaining_tolerance
    day_hit_fraction field_hit_fraction
    beam_residual_rms uncalibrated_beam_residual_rms spot_deviation spot_time better_reading campaign
    held_out held_out_spots held_out_residual_rms uncalibrated_held_out_residual_rms period period_error
    period_standard_error period_change period_change_error period_spots drift
    estimated_error true_error standard_error covariance condition_number residual_rms leave_one_out_rms spots_used
    instants_without_command calibration_status least_known_direction residual_y residual_z
    beam_divergence beam_width detector_pitch detector_noise correction trace crossing round outline edge
    outline_y outline_z edge_y edge_z measured_y measured_z
    crossing_place crossing_angle detector_status crossed_fraction misses_array instant_azimuth_error
    instant_elevation_error instant_azimuth_standard_error instant_elevation_standard_error crossings_used
    crossing_residual beam_error_rms spot_distance_rms round_hit_fraction
    spot_y_before spot_z_before spot_y_after spot_z_after nominal_azimuth nominal_elevation corrected_azimuth
    corrected_elevation
"""
#: Names of result variables and coordinates, which layout columns must not use.
RESERVED = frozenset((*ERRORS, *_NAMES_OF_RESULTS.split()))

MODES = {
    "curves": "spots for a single misalignment, and the error at which the spot leaves the aperture",
    "mount_errors": "spots for the six errors of a mount, which are fixed, swept or drawn",
    "calibration": "mount errors estimated from spots",
    "detectors": "crossings of heliostat traces with detector arrays, and mount errors estimated from the crossings",
}


class MisalignmentStudy(Study):
    """Beams of misaligned heliostats."""

    family: Literal["misalignment"]
    mode: Annotated[str, Choice("Type of computation", MODES, sweep=False)] = "curves"
    site: Annotated[Site | None, Field(description="Site of the plant (for several sites, use 'sites')")] = None
    sites: Annotated[Sites | None, Field(description="Several named sites: a list, or a CSV table")] = None
    time: Annotated[Time | None, Field(description="Days and hours of the study, instead of a fixed 'sun'")] = None
    sun: Annotated[Sun | None, Field(description="Fixed sun, instead of 'time'")] = None
    receiver: Annotated[
        Receiver, Field(description="The receiver: the aim point of all heliostats, and the aperture around it")
    ]
    heliostats: Annotated[Heliostats, Field(description="Pivots of the heliostats")] = Heliostats()
    layout: Annotated[Layout | None, Field(description="Layout of the field, instead of positions")] = None
    mount: Annotated[Mount, Field(description="Mount of all heliostats")] = Mount()
    error: Annotated[Error | None, Field(description="The misalignment; mode: curves only")] = None
    beam: Annotated[Beam | None, Field(description="Beam whose outlines are computed; mode: curves only")] = None
    measured: Annotated[
        str | None,
        FileName("CSV table of measured spots to draw over the curves; same columns as calibration.spots", sweep=False),
    ] = None
    detectors: Annotated[Detectors | None, Field(description="Detectors; modes: curves and detectors only")] = None
    mount_errors: Annotated[MountErrors | None, Field(description="Mount errors")] = None
    statistics: Annotated[
        Statistics | None, Field(description="Statistics over the draws; mode: mount_errors only")
    ] = None
    calibration: Annotated[
        Calibration | None, Field(description="Spots and settings of the calibration; mode: calibration only")
    ] = None

    @model_validator(mode="before")
    @classmethod
    def _with_calibration(cls, given: Any) -> Any:
        if isinstance(given, Mapping) and given.get("mode") == "calibration" and given.get("calibration") is None:
            return {**given, "calibration": {}}
        return given

    def reserved_names(self) -> frozenset[str]:
        """Return the names of variables and coordinates that layout columns must not use."""
        return RESERVED

    def rules(self) -> Iterator[Fault]:
        """Check that the study defines heliostats, the sun, and only the blocks that its mode allows."""
        yield from self.output.without_series()
        yield from when(*self._sun_rules(), *self._time_rules(), *self._mode_rules(), *self._error_rules())

    def _sun_rules(self) -> Iterable[Rule]:
        positions, time, sun = self.heliostats.positions, self.time, self.sun
        placed = self.site is not None or self.sites is not None
        twice = (
            (("heliostats", "positions"), "'positions' or a 'layout'", positions, self.layout),
            (("sites",), "'site' or 'sites'", self.site, self.sites),
            (("sun",), "'time' or 'sun'", time, sun),
        )
        needed = {
            "'heliostats: {positions: [[x, y, z], ...]}' or a 'layout'": positions is None and self.layout is None,
            "'time', with days and hours, or 'sun', with azimuth and elevation": time is None and sun is None,
            "'site' or 'sites': the sun depends on the latitude": time is not None and sun is None and not placed,
            "'site' or 'sites': a polar mount depends on the latitude": time is None
            and sun is not None
            and not placed
            and "polar" in ends(self.mount.kind),
        }
        return (
            *(
                (one is not None and other is not None, fault(f"give {words}, not both", path))
                for path, words, one, other in twice
            ),
            *((missing, fault(f"give {words}")) for words, missing in needed.items()),
            (
                positions is not None and self.heliostats.pivot_height is not None,
                fault(
                    "needs a 'layout', because 'positions' are the positions of the pivots: remove this key, or "
                    "give a 'layout' instead of positions",
                    ("heliostats", "pivot_height"),
                ),
            ),
        )

    def _time_rules(self) -> Iterable[Rule]:
        time, used = self.time, max(ends((self.calibration and self.calibration.days_used) or 0))
        sweeps = {key: getattr(time, key, None) for key in ("days", "declination", "hours")}
        axes: dict[str, Any] = {key: sweep.items() for key, sweep in sweeps.items() if sweep is not None}
        axes = {"dates": time.date_list()} if isinstance(time, CivilTime) else axes
        days = min((len(values) for key, values in axes.items() if key != "hours"), default=0)
        most = f"must be at most {days}, the number of days in 'time' (got {used:g})"
        one = "cannot be used in this mode, because a single sun position cannot distinguish the errors: give 'time'"
        return (
            (self.mode == "calibration" and self.sun is not None, fault(one, ("sun",))),
            (axes and used > days, fault(most, ("calibration", "days_used"))),
            *(
                (any(later <= earlier for earlier, later in itertools.pairwise(values)),
                 fault("must increase", ("time", key)))
                for key, values in axes.items()
            ),
        )  # fmt: skip

    def _mode_rules(self) -> Iterable[Rule]:
        mode, errors, names = self.mode, self.mount_errors, one_of(ERRORS)
        given = errors is not None or self.table_of_spots() is not None or (mode == "detectors" and not self.detectors)
        empty = errors is not None and not errors.model_fields_set & set(ERRORS)
        return (
            *(
                (getattr(self, block) and mode not in modes,
                 fault(f"is only for mode: {' or '.join(modes)}: remove it, or change 'mode'", (block,)))
                for block, modes in BLOCKS_OF_MODES.items()
            ),
            (mode in TRUTH and not given,
             fault(f"'mount_errors' is missing: give {TRUTH.get(mode)}, such as {names}, in mrad")),
            (mode == "detectors" and not self.detectors,
             fault("'detectors' is missing: give {arrays, ...} with the positions of the detectors")),
            (mode == "curves" and self.error is None,
             fault("'error' is missing: give {source, axis, size}, the misalignment for the curves")),
            (empty and mode in ("curves", "mount_errors"),
             fault(f"contains no error: give {names}, in mrad", ("mount_errors",))),
        )  # fmt: skip

    def _error_rules(self) -> Iterable[Rule]:
        """Return the rules that reject keys without effect, such as a seed without drawn errors."""
        mode, mount = self.mode, self.mount
        errors = self.mount_errors or MountErrors()
        idle = mode in ("curves", "mount_errors") and errors.model_fields_set & set(ERRORS) and not errors.drawn()
        swept = isinstance(mount.axis_azimuth, Sweep) and "tilt_roll" not in ends(mount.kind)
        block = self.calibration or Calibration()
        synthetic = mode == "calibration" and block.spots is None
        return (
            *(
                (synthetic and getattr(block, key) is not None,
                 fault("needs measured spots: give 'spots', or remove this key", ("calibration", key)))
                for key in ("columns", "held_out", "window")
            ),
            (block.window_step is not None and block.window is None,
             fault("needs windows: give 'window', or remove this key", ("calibration", "window_step"))),
            (mode == "curves" and any(ends(mount.axis_offset)),
             Fault("must be 0 in mode: curves, in which both axes of a mount pass through the pivot",
                   ("mount", "axis_offset"))),
            (swept, Fault("is only used for 'kind: tilt_roll', which this study does not have",
                          ("mount", "axis_azimuth"))),
            (mode == "curves" and errors.drawn(),
             fault("draws cannot be used in mode: curves: give numbers or sweeps", ("mount_errors",))),
            (idle and errors.seed is not None, fault(NOT_DRAWN, ("mount_errors", "seed"))),
            (idle and self.statistics, fault(NOT_DRAWN, ("statistics",))),
            *(
                (mode == "curves" and key != "lines" and getattr(self.detectors, key, None) is not None,
                 fault("is only used in mode: detectors; in mode: curves give 'lines'", ("detectors", key)))
                for key in sorted(Detectors.model_fields)
            ),
        )  # fmt: skip

    def examinations(self) -> Iterable[Callable[[MisalignmentStudy], Iterable[Problem | str]]]:
        """Return the functions that check the blocks, the layout and the sun."""
        return _sun, site_notes, _distances, examine_table

    def heliostat_names(self) -> tuple[int, tuple[str, ...]]:
        """Return the number and the names of the heliostats in the first layout; no names if they have none."""
        if self.layout is None:
            return len(self.heliostats.positions or ()), ()
        layout = Layouts(self)[()]
        # Numbers in a column "id" could be mistaken for row numbers.
        kinds = {key: layout.columns[key].dtype.kind for key in ("name", "id") if key in layout.columns}
        names = [key for key, kind in kinds.items() if key == "name" or kind in "OU"]
        return len(layout), tuple(map(str, layout.columns[names[0]])) if names else ()

    def table_of_spots(self) -> tuple[str, tuple[str, ...]] | None:
        """Return the study key and the files of measured spots or crossings, or None if there are none."""
        given = {
            "calibration.spots": self.calibration and self.calibration.spots,
            "detectors.crossings": self.detectors and self.detectors.crossings,
            "measured": self.measured,
        }
        return next(((key, ends(name)) for key, name in given.items() if name), None)

    def campaigns(self) -> dict[str, MeasuredSpots]:
        """Return the measured spots or crossings, with sun vectors, by file name. Raises StudyError."""
        key, names = self.table_of_spots() or ("", ())
        if not names:  # a study without measured spots may sweep its layouts
            return {}
        site: Any = self.site or Site(latitude=0.0)
        block = (self.calibration if key == "calibration.spots" else None) or Calibration()
        columns = tuple(
            (name, one["from"], one.get("scale", 1.0), one.get("offset", 0.0))
            for name, one in (block.columns or {}).items()
        )
        place, crossings = (site.latitude, site.longitude, site.altitude), key == "detectors.crossings"
        more = *self.heliostat_names(), place, crossings, block.timezone or "", columns
        found = {PurePath(name).name: read_spots(self.resolve(name), *more) for name in names}
        if len(found) < len(names):
            message = "files have the same name, but file names label the campaigns: rename one of the files"
            raise StudyError(self.problem(key, message))
        if any(measured.timed for measured in found.values()):
            message = "is missing, but is needed to compute the sun at the times of the spots: give the longitude"
            raise StudyError(self.problem("site.longitude", f"{message}, or give sun vectors"))
        return found


def _sun(study: MisalignmentStudy) -> Iterable[Problem | str]:
    """Check that the sun rises at one or more sites. Sites without a sunrise have no spots."""
    missing = list(civil_clock_problems(study)) if isinstance(study.time, CivilTime) else []
    return missing or (dark_places(study, "it has no spots (NaN)") if study.time else ())


def _distances(study: MisalignmentStudy) -> Iterator[Problem | str]:
    """Check that the mirror offsets are smaller than the distance of each pivot from the aim point."""
    layouts = [Places(*np.array(study.heliostats.positions or np.empty((0, 3))).T)]
    if study.layout is not None:
        yield from Layouts(study).remarks()
        layouts = [layout for layout, _ in Layouts(study).some()]
    keys = "mirror_offset", "axis_offset"
    given = (getattr(study.mount, key) for key in keys)
    sizes = [np.abs(one.values() if isinstance(one, Sweep) else one) for one in given]
    first, least = float(np.min(sizes[0])), float(np.min(sizes[0]) + np.min(sizes[1]))
    pivots, aims = ends(study.heliostats.pivot_height or 0.0), ends(study.receiver.height)
    for layout in layouts if least > 0 else ():
        z = np.max([np.abs(layout.z + pivot - aim) for pivot in pivots for aim in aims], axis=0)
        distance = np.sqrt(layout.x**2 + layout.y**2 + z**2)
        if (never := np.flatnonzero(least >= distance)).size:
            row = int(never[np.argmin(distance[never])])
            which = int(first < distance[row])
            words = " together with mirror_offset" if which and first > 0 else ""
            place = layout.where(row) + f" of {layout.name}" * bool(layout.name)
            message = f"must{words} be smaller than the distance from {place} to the aim point, {distance[row]:.6g} m"
            got = (first, float(np.max(sizes[1])))[which]
            yield study.problem(f"mount.{keys[which]}", f"{message} (got {got:g})")
            return

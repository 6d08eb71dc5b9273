"""Blocks of the study file of the family `misalignment`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, TypeAlias

from pydantic import Field

from heliosweep.config.blocks import Block
from heliosweep.config.blocks import Receiver as ReceiverPoint
from heliosweep.config.faults import Fault, Invalid
from heliosweep.config.sweep import Sweep, ends
from heliosweep.config.times import TimeZone
from heliosweep.config.values import (
    MAX_SAMPLES,
    MAX_SEED,
    Choice,
    Distribution,
    FileName,
    ListOfNumbers,
    Quantity,
    Samples,
    Uncertain,
)
from heliosweep.kernels.mounts.kinematics import ERRORS

Triple = tuple[float, float, float]

#: Kinds of mounts, in the order of their codes in the kernels.
MOUNTS = {
    "azimuth_elevation": "primary axis vertical",
    "target_aligned": "primary axis towards the target",
    "polar": "primary axis towards the celestial north pole",
    "tilt_roll": "primary axis horizontal, in the direction of axis_azimuth",
}
#: Sources of error, in the order of their codes in the kernels.
SOURCES = {
    "canting": "the mirror turns about its own centre",
    "encoder": "mirror and offset turn about the pivot",
    "tilt": "the whole mount turns about its base, pedestal_height below the pivot",
}
#: Axes of error, in the order of their codes in the kernels.
AXES = {
    "elevation": "about the horizontal axis in the mirror; positive raises the normal",
    "azimuth": "about the up-slope axis in the mirror; positive clockwise seen from the end of the primary axis",
    "encoder_azimuth": "about the primary axis of the mount; positive clockwise seen from its end",
}
#: Message on keys that affect drawn errors only.
NOT_DRAWN = "is for errors that are drawn, and none is: remove it, or draw one, such as {normal: [0, 1]}"
LOSSES = {"squared": "least squares", "huber": "linear beyond loss_scale", "cauchy": "logarithmic beyond loss_scale"}


@dataclass(frozen=True)
class Lines(ListOfNumbers):
    """Lines ``l0 Y + l1 Z = l2`` on the receiver's plane."""

    def entry_faults(self, entry: tuple[float, ...]) -> Iterator[Fault]:
        """The first two numbers are the direction across the line: not both may be zero."""
        if entry[0] == 0.0 and entry[1] == 0.0:
            yield Fault("is no line: its first two numbers must not both be zero")


@dataclass(frozen=True)
class OneOf(Quantity):
    """One of a few numbers, `options`."""

    options: tuple[int, ...] = field(default=(), kw_only=True)

    def bounds(self) -> str:
        """Return the numbers in words."""
        *most, last = map(str, self.options)
        return f"{', '.join(most)} or {last}"

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the number, or of a list of them."""
        one = {"enum": list(self.options)}
        listed = {"type": "array", "items": one, "minItems": 1, "uniqueItems": True, "description": "Swept: a list"}
        return {"anyOf": [one, listed]} if self.sweep else one

    def _check(self, value: float) -> None:
        if value not in self.options:
            raise Invalid(f"must be {self.bounds()}")


class Sun(Block):
    """Fixed sun, such as a lamp in a laboratory."""

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
    """The aim of all heliostats, in the middle of a flat rectangular face."""

    azimuth: Annotated[
        float | Sweep,
        Quantity(
            "Azimuth of the face's outward normal, clockwise from north: 0 faces a field in the north",
            "deg", ge=-360, le=360, dimension="receiver_azimuth", title="azimuth of the receiver's normal",
        ),
    ] = 0.0  # fmt: skip
    tilt: Annotated[
        float | Sweep,
        Quantity(
            "Tilt of the face's outward normal above the horizontal; negative faces down",
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
            "Height of the aperture, along the face",
            "m", gt=0, dimension="receiver_height_extent", title="height of the aperture",
        ),
    ]  # fmt: skip


class Heliostats(Block):
    """The pivots of the heliostats."""

    positions: Annotated[
        tuple[Triple, ...] | None,
        ListOfNumbers("Pivots, east, north and up of the tower's base; or a 'layout'", "m", ("x", "y", "z")),
    ] = None
    pivot_height: Annotated[
        float | Sweep | None,
        Quantity(
            "Height of the pivot above the heliostat's base; with a layout only, 0 where left out",
            "m", ge=0, title="height of the pivot above the heliostat's base",
        ),
    ] = None  # fmt: skip

    def rules(self) -> Iterator[Fault]:
        """Positions are pivots already."""
        if self.positions is not None and self.pivot_height is not None:
            message = "positions refer to the pivots; remove this key, or give a 'layout' instead of positions"
            yield Fault(message, ("pivot_height",), show_value=False)


class Mount(Block):
    """The two-axis mount of every heliostat."""

    kind: Annotated[
        str | Sweep, Choice("Direction of the primary axis", MOUNTS, dimension="mount_kind", title="kind of mount")
    ] = "azimuth_elevation"
    mirror_offset: Annotated[
        float | Sweep,
        Quantity(
            "Distance of the mirror's centre in front of the elevation axis, along its normal",
            "m", ge=0, title="offset of the mirror along its normal",
        ),
    ] = 0.0  # fmt: skip
    axis_offset: Annotated[
        float | Sweep,
        Quantity(
            "Distance of the elevation axis from the primary axis, positive to the front; not in mode: curves",
            "m", title="offset of the elevation axis from the primary axis",
        ),
    ] = 0.0  # fmt: skip
    pedestal_height: Annotated[
        float | Sweep,
        Quantity(
            "Height of the pivot above the point about which the mount tilts: straight below it, for every mount",
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
    """The misalignment whose deviation curves are traced."""

    source: Annotated[str | Sweep, Choice("What is misaligned", SOURCES, title="source of the error")] = "canting"
    axis: Annotated[str | Sweep, Choice("About which axis", AXES, title="axis of the error")] = "elevation"
    size: Annotated[
        float | Sweep,
        Quantity(
            "Angle of the error",
            "mrad", ge=-1500, le=1500, dimension="error_size", title="angle of the error",
        ),
    ]  # fmt: skip


class Beam(Block):
    """A beam that opens as a cone about its central ray."""

    divergence: Annotated[
        float | Sweep,
        Quantity("Full angle of the beam, 9.3 mrad of the sun", "mrad", gt=0, le=500, dimension="beam_divergence",
                 title="full angle of the beam"),
    ]  # fmt: skip


def _angle(description: str, title: str) -> Uncertain:
    return Uncertain(description, "mrad", ge=-500, le=500, title=title)


_AZIMUTH = "Offset of the primary encoder's zero, positive clockwise seen from the end of the primary axis"
_ELEVATION = "Offset of the secondary encoder's zero, positive up"
_EAST = "Tilt of the primary axis about the first axis of the mount's frame (east)"
_NORTH = "Tilt of the primary axis about the second axis of the mount's frame (north)"
_ASKEW = "Angle between the secondary axis and the normal plane of the primary axis"
_COLLIMATION = "Angle between the mirror's normal and the normal plane of the secondary axis"

Angle: TypeAlias = float | Sweep | Distribution


class MountAngles(Block):
    """The six errors of a mount: fixed, swept, or drawn from distributions."""

    azimuth_reference: Annotated[Angle, _angle(_AZIMUTH, "azimuth reference error")] = 0.0
    elevation_reference: Annotated[Angle, _angle(_ELEVATION, "elevation reference error")] = 0.0
    tilt_about_east: Annotated[Angle, _angle(_EAST, "tilt about east")] = 0.0
    tilt_about_north: Annotated[Angle, _angle(_NORTH, "tilt about north")] = 0.0
    non_orthogonality: Annotated[Angle, _angle(_ASKEW, "non-orthogonality")] = 0.0
    collimation: Annotated[Angle, _angle(_COLLIMATION, "collimation error")] = 0.0
    scale: Annotated[
        float | Sweep,
        Quantity(
            "Factor on the deviations of all drawn errors from their mean",
            "1", ge=0, dimension="error_scale", title="factor on the deviations of the drawn errors from their mean",
        ),
    ] = 1.0  # fmt: skip

    def errors(self) -> tuple[float | Sweep | Distribution, ...]:
        """The six errors in the order of the kernels. [mrad]"""
        return tuple(getattr(self, name) for name in ERRORS)

    def drawn(self) -> dict[str, Distribution]:
        """The errors that are drawn, by name."""
        return {name: error for name in ERRORS if isinstance(error := getattr(self, name), Distribution)}


class MountErrors(MountAngles):
    """Errors of the mount: fixed, swept, or drawn from distributions."""

    samples: Annotated[
        int | None,
        Quantity("Number of draws of all distributions", "1", ge=1, le=MAX_SAMPLES, integer=True, sweep=False),
    ] = None
    seed: Annotated[
        int | None,
        Quantity("Seed of the draws of all distributions", "1", ge=0, le=MAX_SEED, integer=True, sweep=False),
    ] = None

    def draws(self) -> int:
        """Maximum number of draws of a heliostat; 0 without drawn errors."""
        drawn = self.drawn().values()
        said = [self.samples, *(error.samples for error in drawn)]
        return max((count for count in said if count), default=1) if drawn else 0

    def rules(self) -> Iterator[Fault]:
        """Check that all distributions are drawn equally often, and how often."""
        drawn = self.drawn()
        if not drawn and self.samples is not None:
            yield Fault(NOT_DRAWN, ("samples",), show_value=False)
        if not drawn and self.scale != 1:
            yield Fault(NOT_DRAWN, ("scale",), show_value=False)
        said = {"": self.samples} | {name: error.samples for name, error in drawn.items()}
        counts = {name: count for name, count in said.items() if count is not None}
        if drawn and not counts:
            yield Fault("'samples' is missing: how many times the distributions are drawn", show_value=False)
        for name, count in counts.items():
            first = next(iter(counts.values()))
            if count != first:
                yield Fault(f"must be {first:,}, as all errors are drawn equally often", (name, "samples"))


class Statistics(Block):
    """Statistics over the draws."""

    percentiles: Annotated[
        Sweep, Samples("Percentiles of the remaining tolerance", "1", ge=0, le=100, title="percentile")
    ]


_PARAMETERS = OneOf(
    "Number of estimated errors: 2 encoder references, 4 also the tilts, 6 all",
    "1", integer=True, options=(2, 4, 6), title="number of estimated errors",
)  # fmt: skip
_LIMIT = Quantity(
    "Condition number above which a warning is given; 1000 for six errors and 100 for fewer where left out",
    "1", ge=1, sweep=False,
)  # fmt: skip
#: Corrections of the commands in a closed loop.
CORRECTIONS = {
    "mount": "the errors of the mount, from all crossings so far",
    "instant": "the offsets of both encoders at each instant, from its crossings in the round before",
}


#: Most arrays of detectors.
MAX_ARRAYS = 100


class DetectorArray(Block):
    """Detectors along a line of straight pieces."""

    points: Annotated[
        tuple[tuple[float, float], ...],
        ListOfNumbers("Ends of the straight pieces, to the right of the aim point and above it", "m", ("y", "z")),
    ]

    def rules(self) -> Iterator[Fault]:
        """One point is no line."""
        if len(self.points) < 2:
            yield Fault("must have two points at least, the ends of the line", ("points",), show_value=False)


class Detectors(Block):
    """Detectors on the plane of the receiver, and the use of their measurements."""

    lines: Annotated[
        tuple[Triple, ...] | None,
        Lines(
            "Lines without ends, l0 Y + l1 Z = l2, Y to the right and Z up, in m", ("1", "1", "m"), ("l0", "l1", "l2")
        ),
    ] = None
    arrays: Annotated[
        tuple[DetectorArray, ...] | None,
        Field(description=f"Arrays of detectors along straight pieces, {MAX_ARRAYS} at most; mode: detectors only"),
    ] = None
    pitch: Annotated[
        float | Sweep | None,
        Quantity("Distance of the detectors of an array, the resolution of positions (default: continuous)",
                 "m", ge=0, dimension="detector_pitch", title="distance of the detectors"),
    ] = None  # fmt: skip
    noise: Annotated[
        float | Sweep | None,
        Quantity("Standard deviation of positions measured along an array (default: 0)", "m", ge=0,
                 dimension="detector_noise", title="noise of the place along an array"),
    ] = None  # fmt: skip
    parameters: Annotated[
        int | Sweep | None, replace(_PARAMETERS, description=f"{_PARAMETERS.description}; 4 where left out")
    ] = None
    correction: Annotated[
        str | Sweep | None,
        Choice("Correction of the commands (default: mount)", CORRECTIONS, title="what corrects the commands"),
    ] = None
    rounds: Annotated[
        int | None,
        Quantity("Rounds of the closed loop, each of all days and hours; 1 where left out", "1", ge=1, le=50,
                 integer=True, sweep=False),
    ] = None  # fmt: skip
    crossings: Annotated[
        str | None,
        FileName(
            "CSV table of measured crossings: heliostat, trace, y and z in m, time or sun "
            "vector, optional weight (default: crossings of 'mount_errors')",
            sweep=False,
        ),
    ] = None
    condition_limit: Annotated[float | None, _LIMIT] = None

    def rules(self) -> Iterator[Fault]:
        """There must be something that detects, and no loop from a table."""
        if self.lines is None and self.arrays is None:
            yield Fault(
                "gives no detectors: give 'arrays', a list of {points: [[y, z], ...]}, or 'lines'", show_value=False
            )
        if self.arrays is not None and not 1 <= len(self.arrays) <= MAX_ARRAYS:
            message = f"must have 1 to {MAX_ARRAYS} arrays (got {len(self.arrays):,})"
            yield Fault(message, ("arrays",), show_value=False)
        lengths = [sum(itertools.starmap(math.dist, itertools.pairwise(array.points))) for array in self.arrays or ()]
        if lengths and self.pitch is not None and max(ends(self.pitch)) > min(lengths):
            message = f"must be at most {min(lengths):.6g} m, the length of the shortest of 'arrays'"
            yield Fault(f"{message} (got {max(ends(self.pitch)):g})", ("pitch",), show_value=False)
        if self.crossings is not None:
            for key in ("rounds", "correction"):
                if getattr(self, key) is not None:
                    message = "is for crossings of 'mount_errors': a table has no commands; remove it"
                    yield Fault(message, (key,), show_value=False)


class Calibration(Block):
    """Estimate of the mount errors from spots."""

    parameters: Annotated[int | Sweep, _PARAMETERS] = 4
    spots: Annotated[
        str | None,
        FileName(
            "CSV table of measured spots: heliostat, y and z in m, time or sun vector, optional weight; "
            "synthetic spots of 'mount_errors' where left out",
            sweep=False,
        ),
    ] = None
    timezone: Annotated[
        str | None, TimeZone("Time zone of spots whose times have no offset: an offset (+08:00) or an IANA name")
    ] = None
    noise: Annotated[
        float | Sweep,
        Quantity("Standard deviation of each coordinate of synthetic spots", "m", ge=0, title="noise of the spots"),
    ] = 0.0
    days_used: Annotated[
        int | Sweep | None,
        Quantity(
            "Number of days of 'time' with spots (default: all)",
            "1", ge=1, integer=True, title="number of days with spots",
        ),
    ] = None  # fmt: skip
    loss: Annotated[str | Sweep, Choice("Loss function of a residual", LOSSES, title="loss function")] = "squared"
    loss_scale: Annotated[
        float | Sweep,
        Quantity("Residual from which a robust loss grows less than its square", "m", gt=0, title="scale of the loss"),
    ] = 0.1
    condition_limit: Annotated[float | None, _LIMIT] = None


#: Blocks that only some modes have.
BLOCKS_OF_MODES = {
    "error": ("curves",),
    "beam": ("curves",),
    "measured": ("curves",),
    "detectors": ("curves", "detectors"),
    "mount_errors": ("curves", "mount_errors", "calibration", "detectors"),
    "statistics": ("mount_errors",),
    "calibration": ("calibration",),
}

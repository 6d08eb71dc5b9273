"""Measured spots in the form of PAINT, the database of the Jülich solar tower, as the family `misalignment` reads them.

In addition to the files of `paint`, a folder holds ``*calibration-properties*.json``, one for each spot, with the
positions of both motors, the sun, the target and the middle of the spot. Its heliostat is named by the file
(``AA39-calibration-properties_1.json``), else by its folder or the one above, else it is the only one.

The first axis of these mounts is level and points east, the second is mounted on it; at angles of zero the mirror
faces up.
So they are mounts ``tilt_roll`` with ``axis_azimuth: 90``, whose primary angle is minus the first one of PAINT and
whose secondary angle is its second one. Azimuths of the sun are from the south, positive towards the *east*: so
ARTIST, with which the data came, reads them, and only so the spots are where the motors send them.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Tag

from heliosweep.config.faults import Fault
from heliosweep.config.source import read
from heliosweep.config.tables import MAX_LISTED
from heliosweep.config.values import Text
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.files import user_path
from heliosweep.kernels.arrays import Floats
from heliosweep.layouts.paint import (
    Plant,
    Position,
    Record,
    files_of,
    heliostat_files,
    local_positions,
    number,
    read_paint,
    read_record,
    read_tower,
)

#: Ways by which the middles of spots were found, the usual one first.
EVALUATIONS = ("UTIS", "HeliOS")
_PATTERN, _MIDDLE = "*calibration-properties*.json", "calibration-properties"
_DIGITS = 9
#: Steps in which the mirror's centre is found: each is some hundred times nearer than the one before.
_STEPS = 8


class Actuator(Record):
    """A linear actuator: the side of a triangle that turns a joint.

    The other two sides, `offset` and `pivot_radius`, meet in the joint. The stroke is `initial_stroke_length` with the
    motor at 0, and longer by 1 / `increment` for each count.
    """

    increment: Annotated[float, number("Counts of the motor for a metre of stroke", "1", 1, 1e9)]
    initial_stroke_length: Annotated[float, number("Length of the stroke with the motor at 0", "m", 1e-3, 10)]
    offset: Annotated[float, number("Distance of the actuator's foot from the joint", "m", 1e-3, 10)]
    pivot_radius: Annotated[float, number("Distance of the actuator's head from the joint", "m", 1e-3, 10)]
    clockwise_axis_movement: Annotated[float, number("1 if the angle falls while the stroke grows", "1", 0, 1)]
    initial_angle: Annotated[float, number("Angle of the joint with the motor at 0, in rad", "1", -10, 10)]

    def rules(self) -> Iterator[Fault]:
        """Check that the sides close a triangle."""
        if math.isnan(self.opening(0)):
            message = "initial_stroke_length, offset and pivot_radius close no triangle"
            yield Fault(message, show_value=False)

    def opening(self, counts: float) -> float:
        """Return the angle of the triangle at the joint, by the law of cosines; NaN without such a triangle. [rad]"""
        stroke = self.initial_stroke_length + counts / self.increment
        cosine = (self.offset**2 + self.pivot_radius**2 - stroke**2) / (2 * self.offset * self.pivot_radius)
        return math.acos(cosine) if abs(cosine) <= 1 and stroke > 0 else math.nan

    def joint_angle(self, counts: float) -> float:
        """Return the angle of the joint at a motor position; NaN if the stroke closes no triangle. [rad]"""
        sense = 1.0 if self.clockwise_axis_movement else -1.0
        return self.initial_angle + sense * (self.opening(0) - self.opening(counts))


class _Other(Record):
    """An actuator of another type."""


def _type(raw: Any) -> str:
    return "linear" if isinstance(raw, dict) and raw.get("type_axis") == "linear" else "other"


class _Actuators(Record):
    actuators: tuple[
        Annotated[Annotated[Actuator, Tag("linear")] | Annotated[_Other, Tag("other")], Discriminator(_type)], ...
    ]


class _Joints(Record):
    kinematics_properties: _Actuators


class _Motors(Record):
    axis_1_motor_position: Annotated[float, number("Position of the first motor", "1", -1e9, 1e9)]
    axis_2_motor_position: Annotated[float, number("Position of the second motor", "1", -1e9, 1e9)]


class _Measurement(Record):
    motor_position: _Motors
    sun_azimuth: Annotated[float, number("Azimuth of the sun", "deg", -360, 360)]
    sun_elevation: Annotated[float, number("Elevation of the sun", "deg", 0.01, 90)]
    focal_spot: dict[str, Annotated[tuple[float, ...], Position("Middle of the spot")]]
    target_name: Annotated[str, Text("Name of the target")]


class PaintSpots(NamedTuple):
    """Measured spots of a field, as a study of the family `misalignment` takes them."""

    #: The field, aimed at the target whose plane the spots are on.
    plant: Plant
    #: Block ``mount``.
    mount: dict[str, Any]
    #: Columns of ``calibration.spots``: places and offsets in m, sun vectors, angles in deg.
    columns: dict[str, NDArray[Any]]
    #: Origin of the spots, and the blocks of a study.
    notes: tuple[str, ...]


def read_paint_spots(
    folder: str | os.PathLike[str], target: str = "receiver", evaluation: str = EVALUATIONS[0]
) -> PaintSpots:
    """Read measured spots and motor angles from a folder of PAINT.

    Parameters
    ----------
    folder : path
        As `read_paint` takes it, with ``*calibration-properties.json`` for each spot in the folder of its heliostat.
    target : str
        Target whose middle is the origin of the spots and whose plane they are on. Spots on other targets are moved
        to it, along their beam from the mirror's centre: exact but for the residual of the fit, which grows as
        the distance does.
    evaluation : {"UTIS", "HeliOS"}
        Which evaluation of the images.

    Returns
    -------
    PaintSpots
        `columns` of ``calibration.spots``, the block `mount`, the `plant` that `read_paint` gives, and `notes`.
        Heliostats are named by the layout's column ``id``; those without linear actuators are left out.

    Raises
    ------
    StudyError
        All that is wrong with the files, at their lines.
    """
    if evaluation not in EVALUATIONS:
        raise StudyError(Problem(f"unknown evaluation {evaluation!r}; use {' or '.join(EVALUATIONS)}"))
    folder = user_path(folder)
    plant = read_paint(folder, target)
    aim = _aim(plant, folder, target)
    files, problems = heliostat_files(folder), list[Problem]()
    measured, strays = _calibrations(folder, files)
    spots, left_out, offsets = list[dict[str, Any]](), list[str](), list[float]()
    for row, (name, path) in enumerate(files.items()):
        try:
            joints = read_record(path, _Joints).kinematics_properties.actuators
            if name not in measured:
                continue
            if len(joints) != 2 or not all(isinstance(joint, Actuator) for joint in joints):
                left_out.append(name)
                continue
            offsets.append(plant.offsets[row])
            pivot = np.array([getattr(plant.layout, axis)[row] for axis in "xyz"])
            for file in measured[name]:
                spots.append({"heliostat": name, **_spot(file, joints, evaluation, aim, pivot, offsets[-1])})
        except StudyError as error:
            problems += error.problems
    if problems:
        raise StudyError(listed(problems, MAX_LISTED, len(problems)))
    if not spots:
        raise StudyError(
            Problem(f"holds no {_PATTERN}{_missing(left_out, strays, next(iter(files)))}", file=str(folder))
        )
    mount = {"kind": "tilt_roll", "axis_azimuth": 90, "mirror_offset": round(float(np.mean(offsets)), 4)}
    columns = {key: np.array([spot[key] for spot in spots]) for key in spots[0]}
    columns["target"] = np.full(len(spots), target)
    receiver = {key: value for key, value in plant.receiver.items() if key != "kind"}
    blocks = {"site": plant.site, "receiver": receiver, "mount": mount}
    names = list(dict.fromkeys(spot["heliostat"] for spot in spots))
    which = f"heliostat {names[0]}" if len(names) == 1 else f"{len(names)} heliostats"
    notes = (
        f"{len(spots)} spots of {which} of the PAINT folder {folder.absolute().name!r} on the plane of {target!r},",
        f"middles by {evaluation}; those on other targets are moved along their beams. Comments: target, motors.",
        "Source: PAINT, doi 10.1038/s41560-026-02070-1; MIT licence, copyright 2024 Deutsches Zentrum für Luft- und",
        "Raumfahrt and Karlsruher Institut für Technologie.",
        *(f"{key}: {json.dumps(block).replace(chr(34), '')}" for key, block in blocks.items()),
        *([f"Left out, since their actuators are not linear: {', '.join(left_out)}."] if left_out else []),
        *([f"Left out, since their heliostat is unknown: {len(strays)} files."] if strays else []),
    )
    return PaintSpots(plant, mount, columns, notes)


def _missing(left_out: list[str], strays: list[Path], name: str) -> str:
    """Return the hint if no spot was read."""
    if strays:
        path = strays[0].name
        return f" of a heliostat: rename {path} to {name}-{path}, or put it into a folder {name}"
    return f" of heliostats with linear actuators; {', '.join(left_out)} have others" if left_out else ""


class _Aim(NamedTuple):
    """The target's plane, relative to the plant's origin below the target's centre."""

    #: Its centre. [m]
    middle: Floats
    #: Rows outwards, right and up along the face, as seen from the field.
    axes: Floats
    #: Point below the target's centre, east, north and up of the plant. [m]
    below: Floats
    #: Latitude, longitude [deg] and height of the plant. [m]
    origin: tuple[float, ...]


def _aim(plant: Plant, folder: Path, target: str) -> _Aim:
    """Read the plane of a target."""
    origin, _, middle, _ = read_tower(files_of(folder, "*tower-measurements.json")[0], target)
    azimuth, tilt = (math.radians(plant.receiver[key]) for key in ("azimuth", "tilt"))
    out = (math.cos(tilt) * math.sin(azimuth), math.cos(tilt) * math.cos(azimuth), math.sin(tilt))
    right = np.array([-math.cos(azimuth), math.sin(azimuth), 0.0])
    axes = np.array([out, right, np.cross(out, right)])
    return _Aim(np.array([0.0, 0.0, float(plant.receiver["height"])]), axes, np.array([*middle[:2], 0.0]), origin)


def _spot(
    path: Path, joints: Sequence[Any], evaluation: str, aim: _Aim, pivot: Floats, offset: float
) -> dict[str, Any]:
    """Read a measurement as a row of the table. Raises StudyError."""

    def wrong(keys: tuple[str, ...], message: str) -> StudyError:
        return StudyError(read(path).problem(keys, message))

    record = read_record(path, _Measurement)
    if evaluation not in record.focal_spot:
        raise wrong(("focal_spot",), f"has no {evaluation!r}")
    azimuth, elevation = math.radians(record.sun_azimuth), math.radians(record.sun_elevation)
    level = math.cos(elevation)
    sun = np.array([level * math.sin(azimuth), -level * math.cos(azimuth), math.sin(elevation)])
    counts = [getattr(record.motor_position, key) for key in _Motors.model_fields]
    angles = [joint.joint_angle(count) for joint, count in zip(joints, counts, strict=True)]
    for key, angle in zip(_Motors.model_fields, angles, strict=True):
        if math.isnan(angle):
            raise wrong(("motor_position", key), "is a stroke that closes no triangle of the actuator")
    spot = local_positions(record.focal_spot[evaluation], aim.origin) - aim.below
    centre = pivot
    for _ in range(_STEPS):
        way = spot - centre
        middle = sun + way / math.sqrt(float(np.sum(way**2)))
        centre = pivot + offset * middle / math.sqrt(float(np.sum(middle**2)))
    way = spot - centre
    before, towards = (float(np.sum(vector * aim.axes[0])) for vector in (centre - aim.middle, -way))
    if before <= 0 or towards <= 0:
        raise wrong(("focal_spot",), "is a spot whose beam does not reach the plane of the target: choose another one")
    place = centre + before / towards * way - aim.middle
    y, z = (round(float(np.sum(place * axis)), _DIGITS) for axis in aim.axes[1:])
    name, target = path.stem.replace(f"-{_MIDDLE}", ""), record.target_name[:60].replace("\n", " ")
    return {
        "y": y,
        "z": z,
        **dict(zip(("sun_x", "sun_y", "sun_z"), sun.round(_DIGITS).tolist(), strict=True)),
        "azimuth": round(-math.degrees(angles[0]), _DIGITS),
        "elevation": round(math.degrees(angles[1]), _DIGITS),
        "comment": f"{name} on {target} at {counts[0]:g} and {counts[1]:g} counts",
    }


def _calibrations(folder: Path, names: Collection[str]) -> tuple[dict[str, list[Path]], list[Path]]:
    """Return the files of the spots of each heliostat, and files whose heliostat is unknown."""
    found: dict[str, list[Path]] = {}
    strays: list[Path] = []
    for path in files_of(folder.absolute(), _PATTERN):
        only = names if len(names) == 1 else ()
        owners = (path.name.partition(f"-{_MIDDLE}")[0], path.parent.name, path.parent.parent.name, *only)
        owner = next((name for name in owners if name in names), None)
        (strays if owner is None else found.setdefault(owner, [])).append(path)
    return found, strays

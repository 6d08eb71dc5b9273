"""Measured spots in the form of PAINT, the database of the Jülich solar tower, as the family `misalignment` reads them.

In addition to the files of `paint`, a folder holds ``*calibration-properties*.json``, one for each spot, with the
positions of both motors, the sun, the target and the middle of the spot. Its heliostat is named by the file
(``AA39-calibration-properties_1.json``), else by its folder or the one above, else it is the only one.

The first axis of these mounts is level and points east, the second stands on it; at angles of zero the mirror faces up.
So they are mounts ``tilt_roll`` with ``axis_azimuth: 90``, whose primary angle is minus the first one of PAINT and
whose secondary angle is its second one. Azimuths of the sun are from the south, positive towards the *east*: so
ARTIST, with which the data came, reads them, and only so the spots are where the motors send them.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.tables import MAX_LISTED
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.files import user_path
from heliosweep.kernels.arrays import Floats
from heliosweep.layouts.paint import Plant, Record, files_of, heliostat_files, local_positions, read_paint

#: Ways by which the middles of spots were found, the usual one first.
EVALUATIONS = ("UTIS", "HeliOS")
_PATTERN, _MIDDLE = "*calibration-properties*.json", "calibration-properties"
_DIGITS = 9
#: Steps in which the mirror's centre is found: each is some hundred times nearer than the one before.
_STEPS = 8


class Actuator(NamedTuple):
    """A linear actuator: the side of a triangle that turns a joint.

    The other two sides, `offset` and `radius`, meet in the joint. The stroke is `stroke` with the motor at 0, and
    longer by 1 / `increment` for each count.
    """

    #: Counts of the motor for a metre of stroke. [1/m]
    increment: float
    #: Length of the stroke with the motor at 0. [m]
    stroke: float
    #: Distance of the actuator's foot from the joint. [m]
    offset: float
    #: Distance of the actuator's head from the joint. [m]
    radius: float
    #: 1 where the angle falls while the stroke grows, as with PAINT's ``clockwise_axis_movement``; else -1.
    sense: float
    #: Angle of the joint with the motor at 0. [rad]
    angle: float

    def opening(self, counts: float) -> float:
        """Angle of the triangle at the joint, by the law of cosines; NaN where there is no such triangle. [rad]"""
        stroke = self.stroke + counts / self.increment
        cosine = (self.offset**2 + self.radius**2 - stroke**2) / (2 * self.offset * self.radius)
        return math.acos(cosine) if abs(cosine) <= 1 and stroke > 0 else math.nan

    def joint_angle(self, counts: float) -> float:
        """Angle of the joint at a motor position; NaN where the stroke closes no triangle. [rad]"""
        return self.angle + self.sense * (self.opening(0) - self.opening(counts))

    @classmethod
    def of(cls, record: Record, number: int) -> Actuator | None:
        """Read the actuator of an axis; None where it is of another type. Raises StudyError."""
        at = ("kinematics_properties", "actuators", number)
        if record.value(*at, "type_axis") != "linear":
            return None

        def value(name: str, least: float = 1e-3, most: float = 10.0) -> float:
            return record.number(*at, name, least=least, most=most)

        found = cls(
            value("increment", 1.0, 1e9),
            value("initial_stroke_length"),
            value("offset"),
            value("pivot_radius"),
            1.0 if value("clockwise_axis_movement", 0.0, 1.0) else -1.0,
            value("initial_angle", -10.0),
        )
        if math.isnan(found.opening(0)):
            raise StudyError(record.problem(at, "initial_stroke_length, offset and pivot_radius close no triangle"))
        return found


class PaintSpots(NamedTuple):
    """Measured spots of a field, as a study of the family `misalignment` takes them."""

    #: The field, aimed at the target whose plane the spots are on.
    plant: Plant
    #: Block ``mount``.
    mount: dict[str, Any]
    #: Columns of ``calibration.spots``: places and offsets in m, sun vectors, angles in deg.
    columns: dict[str, NDArray[Any]]
    #: Where the spots are from, and the blocks of a study.
    notes: tuple[str, ...]


def read_paint_spots(
    folder: str | os.PathLike[str], target: str = "receiver", evaluation: str = EVALUATIONS[0]
) -> PaintSpots:
    """Read the measured spots of a folder of PAINT, with the angles that its motors stood at.

    Parameters
    ----------
    folder : path
        As `read_paint` takes it, with ``*calibration-properties.json`` for each spot in the folder of its heliostat.
    target : str
        Target whose middle is the origin of the spots and whose plane they are on. Those measured on other targets are
        moved to it, along their beam from the mirror's centre: exact but for the residual of the fit, which grows as
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
    aim = _Aim.of(plant, folder, target)
    files, problems = heliostat_files(folder), list[Problem]()
    measured, strays = _calibrations(folder, files)
    spots, left_out, offsets = list[dict[str, Any]](), list[str](), list[float]()
    for number, (name, path) in enumerate(files.items()):
        try:
            record = Record(path)
            joints = [Actuator.of(record, axis) for axis in (0, 1)]
            if name not in measured:
                continue
            if joints[0] is None or joints[1] is None:
                left_out.append(name)
                continue
            offsets.append(plant.offsets[number])
            pivot = np.array([plant.layout.x[number], plant.layout.y[number], plant.layout.z[number]])
            for each in measured[name]:
                spot = _Spot.of(each, (joints[0], joints[1]), evaluation)
                spots.append({"heliostat": name, **spot.columns(aim, pivot, offsets[-1])})
        except StudyError as error:
            problems += error.problems
    if problems:
        raise StudyError(listed(problems, MAX_LISTED, len(problems)))
    if not spots:
        which = f" of heliostats with linear actuators; {', '.join(left_out)} have others" if left_out else ""
        if strays:
            which = (
                f" of a heliostat: rename {strays[0].name} to {next(iter(files))}-{strays[0].name}, or put it into a "
            )
            which += f"folder {next(iter(files))}"
        raise StudyError(Problem(f"holds no {_PATTERN}{which}", file=str(folder)))
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


class _Aim(NamedTuple):
    """The target's plane, relative to the plant's origin below the target's centre."""

    #: Its centre. [m]
    middle: Floats
    #: Rows outwards, right and up along the face, as seen from the field.
    axes: Floats
    #: Point below the target's centre, east, north and up of the plant. [m]
    below: Floats
    #: Latitude, longitude [deg] and height of the plant. [m]
    origin: list[float]

    @classmethod
    def of(cls, plant: Plant, folder: Path, target: str) -> _Aim:
        tower = Record(files_of(folder, "*tower-measurements.json")[0])
        origin = tower.place("power_plant_properties", "coordinates")
        middle = local_positions(tower.place(target, "coordinates", "center"), origin)
        azimuth, tilt = (math.radians(plant.receiver[key]) for key in ("azimuth", "tilt"))
        out = (math.cos(tilt) * math.sin(azimuth), math.cos(tilt) * math.cos(azimuth), math.sin(tilt))
        right = np.array([-math.cos(azimuth), math.sin(azimuth), 0.0])
        height = float(plant.receiver["height"])
        axes = np.array([out, right, np.cross(out, right)])
        return cls(np.array([0.0, 0.0, height]), axes, np.array([*middle[:2], 0.0]), origin)


class _Spot(NamedTuple):
    """One measurement."""

    record: Record
    #: Latitude, longitude [deg] and height of the middle of the spot. [m]
    place: list[float]
    sun: Floats
    #: Of the first and second joint. [rad]
    angles: tuple[float, float]
    #: Positions of the motors.
    counts: tuple[float, float]

    @classmethod
    def of(cls, path: Path, joints: tuple[Actuator, Actuator], evaluation: str) -> _Spot:
        """Read a measurement. Raises StudyError."""
        record = Record(path)
        keys = [("motor_position", f"axis_{axis}_motor_position") for axis in (1, 2)]
        first, second = (record.number(*key, least=-1e9, most=1e9) for key in keys)
        azimuth = math.radians(record.number("sun_azimuth", least=-360, most=360))
        elevation = math.radians(record.number("sun_elevation", least=0.01, most=90))
        level = math.cos(elevation)
        sun = np.array([level * math.sin(azimuth), -level * math.cos(azimuth), math.sin(elevation)])
        angles = joints[0].joint_angle(first), joints[1].joint_angle(second)
        for key, angle in zip(keys, angles, strict=True):
            if math.isnan(angle):
                raise StudyError(record.problem(key, "is a stroke that closes no triangle of the actuator"))
        return cls(record, record.place("focal_spot", evaluation), sun, angles, (first, second))

    def columns(self, aim: _Aim, pivot: Floats, offset: float) -> dict[str, Any]:
        """Row of the table. Raises StudyError where the beam does not come to the target's plane."""
        spot = local_positions(self.place, aim.origin) - aim.below
        centre = pivot
        for _ in range(_STEPS):
            way = spot - centre
            middle = self.sun + way / math.sqrt(float(np.sum(way**2)))
            centre = pivot + offset * middle / math.sqrt(float(np.sum(middle**2)))
        way = spot - centre
        before, towards = (float(np.sum(vector * aim.axes[0])) for vector in (centre - aim.middle, -way))
        if before <= 0 or towards <= 0:
            message = "is a spot whose beam does not come to the plane of the target: choose another one"
            raise StudyError(self.record.problem(("focal_spot",), message))
        place = centre + before / towards * way - aim.middle
        y, z = (float(np.sum(place * axis)) for axis in aim.axes[1:])
        name = self.record.path.stem.replace(f"-{_MIDDLE}", "")
        on = str(self.record.value("target_name"))[:60].replace("\n", " ")
        sun = dict(zip(("sun_x", "sun_y", "sun_z"), self.sun.round(_DIGITS).tolist(), strict=True))
        return {
            "y": round(y, _DIGITS),
            "z": round(z, _DIGITS),
            **sun,
            "azimuth": round(-math.degrees(self.angles[0]), _DIGITS),
            "elevation": round(math.degrees(self.angles[1]), _DIGITS),
            "comment": f"{name} on {on} at {self.counts[0]:g} and {self.counts[1]:g} counts",
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

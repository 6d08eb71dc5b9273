"""Measured fields and spots from PAINT, the database of the Jülich solar tower.

A folder contains one file ``*tower-measurements.json``, and a file ``*heliostat-properties.json`` for each heliostat. A
heliostat's name is the name of its subfolder, or the part of the file name before a hyphen, as in
``AA39-heliostat-properties.json``. Positions are WGS84 latitudes and longitudes [deg] and heights [m]. The function
`local_positions` converts them to positions east, north and up from an origin [m]. The database is described in doi
10.1038/s41560-026-02070-1. This package models a heliostat as a rectangle with a grid of equal facets that are canted
on axis, and a target as a rectangle. `Plant.notes` lists the differences.

A file ``*calibration-properties*.json`` contains one measured spot, with the positions of both motors, the sun
position, the target and the centre of the spot. The heliostat is identified by the file name
(``AA39-calibration-properties_1.json``), otherwise by the name of its folder or of the parent folder. If the
folder contains only one heliostat, all spots belong to this heliostat.

The first axis of a PAINT mount is horizontal and points east. The second axis is mounted on the first. The mirror faces
up if both angles are zero. In a study, a PAINT mount is a ``tilt_roll`` mount with ``axis_azimuth: 90``. The primary
angle is minus PAINT's first angle, and the secondary angle is PAINT's second angle. Sun azimuths are measured from
south, positive towards *east*, as in ARTIST. Only with this convention do the motor positions reproduce the measured
spots.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, Discriminator, Field, Tag, ValidationError, create_model

from heliosweep.config import Block, Fault, Invalid, Numbers, Parameter, Quantity, Text, each, read, translate
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.files import user_path
from heliosweep.kernels.compiled import Floats
from heliosweep.layouts.layout import FARTHEST, MAX_LISTED, Layout
from heliosweep.sun import direction

#: Semi-major axis [m] and flattening of the WGS84 ellipsoid.
SEMI_MAJOR_AXIS, FLATTENING = 6378137.0, 1 / 298.257223563
#: Layout columns that contain the motor steps per degree of the primary and secondary angles.
STEPS = ("azimuth_steps", "elevation_steps")
#: Image evaluations that provide spot centres; the first evaluation is the default.
EVALUATIONS = ("UTIS", "HeliOS")

#: Tolerance for facet centres and sizes in a regular grid. [m]
_OFF_GRID = 5e-3
#: Number of decimals to which lengths are rounded [m], for a resolution of 1 micrometre.
_DIGITS = 6
_PROPERTIES, _SPOTS, _TOWER = "heliostat-properties.json", "calibration-properties", "*tower-measurements.json"
_SOURCE = (
    "Source: PAINT, doi 10.1038/s41560-026-02070-1; MIT licence, copyright 2024 Deutsches Zentrum für Luft- und",
    "Raumfahrt and Karlsruher Institut für Technologie.",
)


class Plant(NamedTuple):
    """Measured field, in the form of study blocks."""

    #: Layout with mirror sizes, ``id`` and ``canting_distance``.
    #: The positions are those of the pivots, relative to the point below the target's centre.
    layout: Layout
    #: Block ``site`` with the geographic coordinates of the plant.
    site: dict[str, Any]
    #: Block ``heliostat`` without sizes, which are layout columns, and without the focus, which is unknown.
    heliostat: dict[str, Any]
    #: Block ``receiver`` that describes the target.
    receiver: dict[str, Any]
    #: Summary of the folder's contents, and plant properties that a study cannot express.
    notes: tuple[str, ...]
    #: Distance of each mirror's surface from its pivot. [m]
    offsets: tuple[float, ...] = ()


class PaintSpots(NamedTuple):
    """Measured spots of a field for a study of the family `misalignment`."""

    #: Field aimed at the target whose plane contains the spots.
    plant: Plant
    #: Block ``mount``.
    mount: dict[str, Any]
    #: Columns of ``calibration.spots``: positions and offsets [m], sun vectors [1] and angles [deg].
    columns: dict[str, NDArray[Any]]
    #: Comments on the origin of the spots, and the study blocks as text.
    notes: tuple[str, ...]


def local_positions(place: ArrayLike, origin: Sequence[float]) -> Floats:
    """Convert geographic positions to positions relative to an origin.

    Parameters
    ----------
    place : array_like, shape (..., 3)
        Latitude and longitude [deg] and height above the WGS84 ellipsoid [m].
    origin : sequence of float
        Latitude and longitude [deg] and height [m] of the origin.

    Returns
    -------
    ndarray, shape (..., 3)
        Position east, north and up relative to the origin. [m]

    Notes
    -----
    Geographic coordinates are converted to geocentric and then to topocentric coordinates, without approximations, by
    methods 9602 and 9836 of IOGP (2019), Geomatics guidance note 7-2.
    """
    latitude, longitude = np.radians(origin[:2])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    away = _geocentric(np.asarray(place, float)) - _geocentric(np.asarray(origin, float))
    return np.stack([np.sum(away * axis, axis=-1) for axis in (east, np.cross(up, east), up)], axis=-1)


def _geocentric(place: Floats) -> Floats:
    latitude, longitude, height = np.radians(place[..., 0]), np.radians(place[..., 1]), place[..., 2]
    squared = FLATTENING * (2 - FLATTENING)
    normal = SEMI_MAJOR_AXIS / np.sqrt(1 - squared * np.sin(latitude) ** 2)
    level = (normal + height) * np.cos(latitude)
    upward = (normal * (1 - squared) + height) * np.sin(latitude)
    return np.stack((level * np.cos(longitude), level * np.sin(longitude), upward), axis=-1)


class _Record(Block):
    """A PAINT JSON file, or part of such a file. Undeclared keys are ignored."""

    model_config = ConfigDict(extra="ignore")


@dataclass(frozen=True)
class _Position(Parameter):
    def read(self, raw: Any) -> tuple[float, ...]:
        if not isinstance(raw, list | tuple) or len(raw) != 3:
            raise Invalid("must be [latitude, longitude, height]")
        kinds = (_number("deg", -90, 90), _number("deg", -180, 180), _number("m", -500, 10_000))
        return tuple(each(zip(kinds, raw, strict=True), lambda pair: pair[0].read(pair[1])))


def _number(unit: str, low: float, high: float, meaning: str = "") -> Quantity:
    return Quantity(meaning, unit, ge=low, le=high, sweep=False)


def _record(base: type[_Record] = _Record, /, **keys: Any) -> Any:
    """Create a record class with required keys, each declared by a type or a `Quantity`."""
    fields: Any = {
        key: (Annotated[float, kind] if isinstance(kind, Quantity) else kind, ...) for key, kind in keys.items()
    }
    return create_model("Record", __base__=base, **fields)


_VECTOR = Annotated[tuple[float, ...], Numbers("Vector", "m", ("east", "north", "up"), ge=-100, le=100)]
_POSITION = Annotated[tuple[float, ...], _Position("Latitude, longitude [deg] and height [m]")]
_FACET: Any = _record(translation_vector=_VECTOR, canting_e=_VECTOR, canting_n=_VECTOR)
_HELIOSTAT = _record(
    heliostat_position=_POSITION,
    width=_number("m", 0.01, 100),
    height=_number("m", 0.01, 100),
    facet_properties=_record(facets=Annotated[tuple[_FACET, ...], Field(min_length=1)]),
    kinematics_properties=_record(concentrator_translation_n=_number("m", -10, 10)),
)
_RADIUS: Any = Annotated[float | None, _number("m", 0.1, 1000)]
_TARGET: Any = create_model(
    "Record",
    __base__=_record(normal_vector=_VECTOR, coordinates=dict[str, _POSITION]),
    radius=(_RADIUS, None),
)
_MOTORS = ("axis_1_motor_position", "axis_2_motor_position")
_MEASUREMENT = _record(
    motor_position=_record(**dict.fromkeys(_MOTORS, _number("1", -1e9, 1e9))),
    sun_azimuth=_number("deg", -360, 360),
    sun_elevation=_number("deg", 0.01, 90),
    focal_spot=dict[str, _POSITION],
    target_name=Annotated[str, Text("Name of the target")],
)
_ACTUATOR: Any = _record(
    increment=_number("1", 1, 1e9, "Motor counts per metre of stroke"),
    initial_stroke_length=_number("m", 1e-3, 10, "Stroke at motor position 0"),
    offset=_number("m", 1e-3, 10, "Distance of the actuator's foot from the joint"),
    pivot_radius=_number("m", 1e-3, 10, "Distance of the actuator's head from the joint"),
    clockwise_axis_movement=_number("1", 0, 1, "1 if the angle decreases while the stroke increases"),
    initial_angle=_number("1", -10, 10, "Joint angle at motor position 0, in rad"),
)


class Actuator(_ACTUATOR):
    """Linear actuator that rotates a joint and forms one side of a triangle.

    The other two sides, `offset` and `pivot_radius`, meet at the joint. The stroke is `initial_stroke_length` at motor
    position 0, and increases by 1 / `increment` with each motor count.
    """

    def rules(self) -> Iterator[Fault]:
        """Check that the sides form a triangle."""
        if math.isnan(self.opening(0)):
            yield Fault("initial_stroke_length, offset and pivot_radius do not form a triangle", show_value=False)

    def opening(self, counts: float) -> float:
        """Return the angle of the triangle at the joint by the law of cosines; NaN if there is no triangle. [rad]"""
        stroke = self.initial_stroke_length + counts / self.increment
        cosine = (self.offset**2 + self.pivot_radius**2 - stroke**2) / (2 * self.offset * self.pivot_radius)
        return math.acos(cosine) if abs(cosine) <= 1 and stroke > 0 else math.nan

    def joint_angle(self, counts: float) -> float:
        """Return the angle of the joint at a motor position; NaN if there is no triangle with this stroke. [rad]"""
        sense = 1.0 if self.clockwise_axis_movement else -1.0
        return self.initial_angle + sense * (self.opening(0) - self.opening(counts))

    def steps(self, counts: float) -> float:
        """Return the motor counts per degree of joint rotation at a motor position. [1/deg]"""
        return 2.0 / math.degrees(self.joint_angle(counts + 1.0) - self.joint_angle(counts - 1.0))


_ACTUATORS: Any = Annotated[
    Annotated[Actuator, Tag("linear")] | Annotated[_Record, Tag("other")],
    Discriminator(lambda raw: "linear" if isinstance(raw, dict) and raw.get("type_axis") == "linear" else "other"),
]


def _read_record(path: Path, kind: Any) -> Any:
    source = read(path)  # JSON is a subset of YAML
    try:
        return kind.model_validate(source.data)
    except ValidationError as error:
        empty = source.problem(tuple(error.errors()[0]["loc"]), "is empty")
        raise StudyError(list(translate(error, kind, source)) or empty) from None


def _need(good: Any, path: Path, keys: tuple[str, ...], message: str) -> None:
    if not good:
        raise StudyError(read(path).problem(keys, message))


def _files(folder: Path, pattern: str) -> list[Path]:
    """Return the files in a folder and its subfolders that match a pattern, sorted by depth and name."""
    return [path for depth in range(4) for path in sorted(folder.glob("*/" * depth + pattern))]


def _heliostat_files(folder: Path) -> dict[str, Path]:
    files, problems = dict[str, Path](), []
    for path in _files(folder, f"*{_PROPERTIES}"):
        name = path.name.removesuffix(_PROPERTIES).rstrip("-_") or path.parent.name
        if files.setdefault(name, path) != path:
            message = f"is the second file of heliostat {name}; the first is {files[name]}"
            problems.append(Problem(message, file=str(path)))
    if not files:
        reason = f"it contains no *{_PROPERTIES}" if folder.is_dir() else "there is no such folder"
        problems = [Problem(f"is not a PAINT folder: {reason}", file=str(folder))]
    if problems:
        raise StudyError(problems)
    return dict(sorted(files.items()))


def _each(paths: Iterable[Path], read_file: Any) -> list[Any]:
    records, problems = [], list[Problem]()
    for path in paths:
        try:
            records.append(read_file(path))
        except StudyError as error:
            problems += error.problems
    if problems:
        raise StudyError(listed(problems, MAX_LISTED, len(problems)))
    return records


def _which(names: Sequence[str]) -> str:
    return f"heliostat {names[0]}" if len(names) == 1 else f"{len(names)} heliostats"


def _block_lines(blocks: dict[str, Any]) -> Iterator[str]:
    yield from (f"{key}: {json.dumps(block).replace(chr(34), '')}" for key, block in blocks.items())


def read_paint(folder: str | os.PathLike[str], target: str = "receiver") -> Plant:
    """Read a folder with data from PAINT, the database of the Jülich solar tower.

    Parameters
    ----------
    folder : path
        Folder with one file ``*tower-measurements.json``, and a file ``*heliostat-properties.json`` for each heliostat.
    target : str
        Name of the target at which the heliostats aim.

    Returns
    -------
    Plant
        The `layout` (for `write_layout`), the study blocks `site`, `heliostat` and `receiver`, and `notes` on the
        differences between the plant and the study. The origin is below the centre of the target, at the altitude of
        the plant.

    Raises
    ------
    StudyError
        If files are invalid. The message lists all problems with file and line.
    """
    folder = user_path(folder)
    files = _heliostat_files(folder)
    origin, receiver, centre, about = _read_tower(folder, target)
    mirrors: list[_Mirror] = _each(files.values(), lambda path: _mirror(path, origin))
    across, rows, gap = mirrors[0].grid
    message = f"must be {across} x {rows} facets with gaps of {gap:g} m, like the other heliostats of the field"
    for path, mirror in zip(files.values(), mirrors, strict=True):
        _need(mirror.grid == mirrors[0].grid, path, ("facet_properties",), message)
    pivots = np.array([mirror.pivot for mirror in mirrors]) - (*centre[:2], 0.0)
    columns: dict[str, Any] = {"id": np.array(list(files)), "target": np.full(len(files), target)}
    for key in ("width", "height", "canting_distance"):
        columns[key] = np.array([getattr(mirror, key) for mirror in mirrors]).round(_DIGITS)
    canting = "on_axis" if columns["canting_distance"].any() else "none"
    facets = dict(zip(("columns", "rows", "gap"), mirrors[0].grid, strict=True)) | {"canting": canting}
    site = dict(zip(("latitude", "longitude", "altitude"), origin, strict=True))
    blocks: dict[str, Any] = {"site": site, "heliostat": {"pivot_height": 0, "facets": facets}, "receiver": receiver}
    slant = np.sqrt(np.sum((pivots - (0.0, 0.0, centre[2])) ** 2, axis=1))
    apart = 1e3 * max(mirror.canting_error(distance) for mirror, distance in zip(mirrors, slant, strict=True))
    exact = 1e3 * max(mirror.canting_error(mirror.canting_distance) for mirror in mirrors)
    offsets, name = tuple(mirror.offset for mirror in mirrors), folder.absolute().name
    which = _which(list(files))
    notes = (
        f"{which[0].upper()}{which[1:]} of the PAINT folder {name!r}, aimed at {target!r}. Blocks for a study:",
        *_block_lines(blocks),
        *_SOURCE,
        "x and y are relative to the point below the target's centre; z is the height of the pivot above the "
        "plant's altitude.",
        f"Facets are canted on axis for canting_distance, to {exact:.2g} mrad. With canting: on_axis they are canted",
        f"for the slant range, and normals differ by up to {apart:.2g} mrad. The files do not contain the focus of "
        "the facets.",
        f"The study does not include mirrors up to {max(offsets):.3f} m in front of their pivots, or the order and "
        f"errors of axes{about}.",
    )
    east, north, up = (pivots.round(_DIGITS) + 0.0).T
    return Plant(Layout(east, north, up, columns, name, notes=notes), **blocks, notes=notes, offsets=offsets)


def _read_tower(folder: Path, target: str) -> tuple[tuple[float, ...], dict[str, Any], Floats, str]:
    """Read one target of the tower. Raises a StudyError that refers to lines of the file.

    Returns the latitude, longitude [deg] and height [m] of the plant, the study block, and the centre of the target,
    shape (3,) [m]. The last value is a note on the curvature of the target, which the study block does not describe.
    """
    towers = _files(folder, _TOWER)
    if len(towers) != 1:
        message = f"is not a PAINT folder: it contains {len(towers)} files {_TOWER}, but must contain one"
        raise StudyError(Problem(message, file=str(folder)))
    path, data = towers[0], read(towers[0]).data
    known = [key for key, value in data.items() if isinstance(value, dict) and "normal_vector" in value]
    if target not in known:
        raise StudyError(Problem(f"has no target {target!r}; it has {', '.join(known) or 'none'}", file=str(path)))
    tower = _read_record(path, _record(**{target: _TARGET}, power_plant_properties=_record(coordinates=_POSITION)))
    origin, record = tower.power_plant_properties.coordinates, getattr(tower, target)
    inner = "receiver_inner_" if "receiver_inner_upper_left" in record.coordinates else ""
    names = [*(f"{inner}{height}_{side}" for height in ("upper", "lower") for side in ("left", "right")), "center"]
    missing = next((name for name in names if name not in record.coordinates), "")
    _need(not missing, path, (target, "coordinates"), f"has no {missing!r}")
    *corners, centre = local_positions([record.coordinates[name] for name in names], origin)
    edges, normal = np.reshape(corners, (2, 2, 3)), np.array(record.normal_vector)
    good = np.any(normal) and np.sum((edges.mean(axis=(0, 1)) - centre) ** 2) <= 1.0
    _need(good, path, (target,), "must have a normal, and a centre within 1 m of the centre of its corners")
    width, height = (np.mean(np.sqrt(np.sum(np.diff(edges, axis=axis) ** 2, axis=-1))) for axis in (1, 0))
    numbers = {
        "height": centre[2],
        "azimuth": math.degrees(math.atan2(normal[0], normal[1])),
        "tilt": math.degrees(math.atan2(normal[2], math.hypot(normal[0], normal[1]))),
        "width": width,
        "height_extent": height,
    }
    block = {"kind": "rectangle"} | {key: round(float(value), 4) for key, value in numbers.items()}
    about = f", curvature of the target (radius {record.radius:g} m)" if record.radius else ""
    return origin, block, centre, about


class _Mirror(NamedTuple):
    pivot: Floats
    width: float
    height: float
    #: Columns, rows and gap of the facets. [1, 1, m]
    grid: tuple[int, int, float]
    #: Distance for which the facets are canted on axis; 0 if facets are not canted. [m]
    canting_distance: float
    #: Distance of the mirror's surface from the pivot. [m]
    offset: float
    #: Coordinates of the facet centres along the width and the height of the mirror, shape (facets, 2). [m]
    centres: Floats
    #: Slopes of the facets along the width and the height of the mirror, shape (facets, 2). [1]
    slopes: Floats

    def canting_error(self, distance: float) -> float:
        """Return the maximum angle between facet normals and on-axis canting for a distance. [rad]"""
        aimed = self.centres * (0.5 / distance if distance else 0.0)
        return float(np.max(np.sqrt(np.sum((self.slopes - aimed) ** 2, axis=1))))


def _mirror(path: Path, origin: Sequence[float]) -> _Mirror:
    record = _read_record(path, _HELIOSTAT)
    pivot = local_positions(record.heliostat_position, origin)
    away = float(np.max(np.abs(pivot)))
    _need(away <= FARTHEST, path, ("heliostat_position",), f"is {away / 1e3:,.0f} km from the tower")
    facets, sides = record.facet_properties.facets, (record.width, record.height)
    moved, along, across = (np.array([getattr(facet, name) for facet in facets]) for name in _FACET.model_fields)
    normal = np.cross(along, across)
    _need((normal[:, 2] > 0).all(), path, ("facet_properties",), "canting vectors must span a facet that faces up")
    grid = _grid(moved[:, :2], 2 * np.array([along[:, 0], across[:, 1]]).T, sides)
    message = f"must be a grid of equal facets with equal gaps, on {sides[0]:g} m x {sides[1]:g} m, within 5 mm"
    _need(grid, path, ("facet_properties",), message)
    centres, slopes = moved[:, :2], -normal[:, :2] / normal[:, 2:]
    curvature = float(np.sum(slopes * centres) / max(np.sum(centres**2), 1e-12))
    offset = abs(record.kinematics_properties.concentrator_translation_n) + abs(float(moved[:, 2].mean()))
    return _Mirror(pivot, *sides, grid, 0.5 / curvature if curvature > 1e-9 else 0.0, offset, centres, slopes)


def _grid(centres: Floats, sizes: Floats, sides: tuple[float, float]) -> Any:
    """Return the columns, rows and gap of the facets [1, 1, m], or None if they do not form a regular grid."""
    counts = np.array([np.unique((centres[:, axis] / _OFF_GRID).round()).size for axis in (0, 1)])
    pitch = (np.array(sides) - sizes.mean(axis=0)) / np.maximum(counts - 1, 1)
    gaps = (pitch - sizes.mean(axis=0))[counts > 1]
    gap = float(np.mean(gaps)) if gaps.size else 0.0
    expected = [(np.arange(count) - (count - 1) / 2) * step for count, step in zip(counts, pitch, strict=True)]
    whole = np.stack(np.meshgrid(*expected, indexing="ij"), axis=-1).reshape(-1, 2)
    if len(whole) != len(centres) or np.ptp([*gaps, gap]) > _OFF_GRID or gap < -_OFF_GRID:
        return None
    nearest = np.abs(centres[:, np.newaxis] - whole).max(axis=-1)
    alike = np.all(nearest.min(axis=0) < _OFF_GRID) and np.ptp(sizes, axis=0).max() < _OFF_GRID
    return (int(counts[0]), int(counts[1]), round(max(gap, 0.0), 4)) if alike else None


def read_paint_spots(
    folder: str | os.PathLike[str], target: str = "receiver", evaluation: str = EVALUATIONS[0]
) -> PaintSpots:
    """Read measured spots and motor angles from a PAINT folder.

    Parameters
    ----------
    folder : path
        Folder as in `read_paint`. The folder of each heliostat also contains a file ``*calibration-properties.json``
        for each spot.
    target : str
        Target whose centre is the origin of the spot coordinates, and whose plane contains the spots. Spots on other
        targets are moved to this plane along the beam from the mirror's centre. The new position is exact for the
        measured beam. In a later fit, the residual is proportional to the beam length.
    evaluation : {"UTIS", "HeliOS"}
        Image evaluation from which the spot centres are read.

    Returns
    -------
    PaintSpots
        The `columns` of ``calibration.spots``, the `mount` block, the `plant` as returned by `read_paint`, and `notes`.
        Heliostats are identified by the layout column ``id``. Heliostats without linear actuators are omitted.

    Raises
    ------
    StudyError
        If files are invalid. The message lists all problems with file and line.
    """
    if evaluation not in EVALUATIONS:
        raise StudyError(Problem(f"unknown evaluation {evaluation!r}; use {' or '.join(EVALUATIONS)}"))
    folder = user_path(folder)
    plant, files = read_paint(folder, target), _heliostat_files(folder)
    origin, _, middle, _ = _read_tower(folder, target)
    owners, only = dict[Path, str](), [*files][: len(files) == 1]
    for path in _files(folder.absolute(), f"*{_SPOTS}*.json"):
        names = (path.name.partition(f"-{_SPOTS}")[0], path.parent.name, path.parent.parent.name, *only)
        owners[path] = next((name for name in names if name in files), "")
    joint = _record(kinematics_properties=_record(actuators=tuple[_ACTUATORS, ...]))
    joints = _each(files.values(), lambda path: _read_record(path, joint).kinematics_properties.actuators)
    pivots = np.stack([plant.layout.x, plant.layout.y, plant.layout.z], axis=1)
    every = zip(files, zip(joints, pivots, plant.offsets, strict=True), strict=True)
    mirrors = {name: mirror for name, mirror in every if list(map(type, mirror[0])) == [Actuator, Actuator]}
    paths = sorted((path for path, owner in owners.items() if owner in mirrors), key=owners.__getitem__)
    origins = (origin, np.array([*middle[:2], 0.0]))
    spots = _each(paths, lambda path: _spot(path, owners[path], mirrors, evaluation, plant.receiver, origins))
    strays = [path for path, owner in owners.items() if not owner]
    left_out = sorted({*owners.values()} - {*mirrors, ""})
    if not spots:
        raise StudyError(Problem(f"contains no *{_SPOTS}*.json{_remedy(strays, left_out, files)}", file=str(folder)))
    columns = {key: np.array([spot[key] for spot in spots]) for key in spots[0]}
    columns["target"] = np.full(len(spots), target)
    counts, names = columns.pop("counts"), np.unique(columns["heliostat"]).tolist()
    steps = np.full((len(files), 2), np.nan)
    for name in names:
        means = counts[columns["heliostat"] == name].mean(axis=0).tolist()
        steps[list(files).index(name)] = [joint.steps(at) for joint, at in zip(mirrors[name][0], means, strict=True)]
    # The primary angle is minus PAINT's first angle.
    labels = dict(zip(STEPS, (steps * (-1.0, 1.0)).round(3).T, strict=True))
    plant = plant._replace(layout=replace(plant.layout, columns={**plant.layout.columns, **labels}))
    mean = float(np.mean([mirrors[name][2] for name in names]))
    mount = {"kind": "tilt_roll", "axis_azimuth": 90, "mirror_offset": round(mean, 4)}
    receiver = dict(plant.receiver)
    del receiver["kind"]
    notes = (
        f"{len(spots)} spots of {_which(names)} of the PAINT folder {plant.layout.name!r} on the plane of {target!r},",
        f"middles by {evaluation}; spots on other targets are moved along their beams. Comments contain the target "
        "and the motors.",
        *_SOURCE,
        *_block_lines({"site": plant.site, "receiver": receiver, "mount": mount}),
        *[f"Omitted, because their actuators are not linear: {', '.join(left_out)}."] * bool(left_out),
        *[f"Omitted, because their heliostat is unknown: {len(strays)} files."] * bool(strays),
    )
    return PaintSpots(plant, mount, columns, notes)


def _remedy(strays: Sequence[Path], others: Sequence[str], names: Iterable[str]) -> str:
    if strays:
        name, stray = next(iter(names)), strays[0].name
        return f" of a heliostat: rename {stray} to {name}-{stray}, or put it into a folder {name}"
    return f" of heliostats with linear actuators; the actuators of {', '.join(others)} are not linear" * bool(others)


def _spot(
    path: Path,
    name: str,
    mirrors: dict[str, tuple[Any, Floats, float]],
    evaluation: str,
    receiver: dict[str, Any],
    origins: tuple[tuple[float, ...], Floats],
) -> dict[str, Any]:
    (joints, pivot, offset), (origin, below) = mirrors[name], origins
    record = _read_record(path, _MEASUREMENT)
    sun = direction(180.0 - record.sun_azimuth, record.sun_elevation)
    counts = [getattr(record.motor_position, key) for key in _MOTORS]
    angles = [joint.joint_angle(count) for joint, count in zip(joints, counts, strict=True)]
    for key, angle in zip(_MOTORS, angles, strict=True):
        message = "corresponds to a stroke at which the actuator cannot form a triangle"
        _need(not math.isnan(angle), path, ("motor_position", key), message)
    _need(evaluation in record.focal_spot, path, ("focal_spot",), f"has no {evaluation!r}")
    spot, centre = local_positions(record.focal_spot[evaluation], origin) - below, pivot
    for _ in range(8):  # each step reduces the error by a factor of a few hundred
        way = spot - centre
        middle = sun + way / math.sqrt(float(np.sum(way**2)))
        centre = pivot + offset * middle / math.sqrt(float(np.sum(middle**2)))
    out = direction(receiver["azimuth"], receiver["tilt"])
    right = direction(receiver["azimuth"] - 90.0, 0.0)
    # Move the spot along the beam to the plane of the target.
    way, target = spot - centre, np.array([0.0, 0.0, float(receiver["height"])])
    before, towards = float((centre - target) @ out), float(-way @ out)
    message = "is a spot whose beam does not reach the plane of the target: choose another target"
    _need(before > 0 and towards > 0, path, ("focal_spot",), message)
    place = centre + before / towards * way - target
    label, on = path.stem.replace(f"-{_SPOTS}", ""), record.target_name[:60].replace("\n", " ")
    numbers = {
        "y": place @ right,
        "z": place @ np.cross(out, right),
        **dict(zip(("sun_x", "sun_y", "sun_z"), sun, strict=True)),
        "azimuth": -math.degrees(angles[0]),
        "elevation": math.degrees(angles[1]),
    }
    return {
        "heliostat": name,
        **{key: round(float(value), 9) for key, value in numbers.items()},
        "spot": label,
        "comment": f"{label} on {on} at {counts[0]:g} and {counts[1]:g} counts",
        "counts": counts,
    }

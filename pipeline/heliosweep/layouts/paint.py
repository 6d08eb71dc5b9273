"""Measured fields in the form of PAINT, the database of the Jülich solar tower: positions, facets and targets.

A folder holds one file ``*tower-measurements.json``, and ``*heliostat-properties.json`` for each heliostat: in a folder
that has its name, or with its name before a hyphen, as in ``AA39-heliostat-properties.json``. Places are latitude,
longitude [deg] and height [m] of WGS84; here they become metres towards east, north and up (`local_positions`). For
the data: doi 10.1038/s41560-026-02070-1.

heliosweep takes a heliostat as a rectangle about its pivot, with a grid of equal facets that are canted on axis, and a
target as a rectangle. `Plant.notes` lists the differences.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ConfigDict, Field, ValidationError, create_model

from heliosweep.config.blocks import Block, translate
from heliosweep.config.faults import Invalid, each
from heliosweep.config.source import read
from heliosweep.config.values import Numbers, Parameter, Quantity
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.files import user_path
from heliosweep.kernels.arrays import Floats
from heliosweep.layouts.layout import FARTHEST, MAX_LISTED, Layout

#: Semi-major axis [m] and flattening of the ellipsoid WGS84.
SEMI_MAJOR_AXIS, FLATTENING = 6378137.0, 1 / 298.257223563

#: Folders in folders that are looked into, as PAINT has them: PLANT/AA39/Properties.
_DEEPEST = 3
#: Tolerance of facet centres and sizes of a grid. [m]
_OFF_GRID = 5e-3
_DIGITS = 6  # decimals of written lengths: a micrometre
#: Latitude, longitude and height of a position.
_PLACE = tuple(
    Quantity("", unit, ge=low, le=high, sweep=False)
    for unit, low, high in (("deg", -90, 90), ("deg", -180, 180), ("m", -500, 10_000))
)
RecordT = TypeVar("RecordT", bound="Record")


class Plant(NamedTuple):
    """A measured field, as a study names it."""

    #: Pivots of the heliostats from below the target's centre, their mirrors, ``id`` and ``canting_distance``.
    layout: Layout
    #: Block ``site``: the origin of the plant.
    site: dict[str, Any]
    #: Block ``heliostat`` without sizes, which are columns of the layout, and without the focus, which is unknown.
    heliostat: dict[str, Any]
    #: Block ``receiver``: the target.
    receiver: dict[str, Any]
    #: Contents of the folder, and properties that a study cannot express.
    notes: tuple[str, ...]
    #: Distance of each mirror's surface from its pivot. [m]
    offsets: tuple[float, ...] = ()


def local_positions(place: ArrayLike, origin: Sequence[float]) -> Floats:
    """Positions on the Earth, seen from an origin.

    Parameters
    ----------
    place : array_like, shape (..., 3)
        Latitude and longitude [deg] and height above the ellipsoid WGS84 [m].
    origin : sequence of float
        The same of the origin.

    Returns
    -------
    ndarray, shape (..., 3)
        Towards east, north and up at the origin. [m]

    Notes
    -----
    Exact: geographic to geocentric, then geocentric to topocentric coordinates, methods 9602 and 9836 of IOGP (2019),
    Geomatics guidance note 7-2.
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


class Record(Block):
    """A JSON file of PAINT, or a part of one; keys that are not declared are ignored."""

    model_config = ConfigDict(extra="ignore")


@dataclass(frozen=True)
class Position(Parameter):
    """Latitude, longitude [deg] and height [m]."""

    def read(self, raw: Any) -> tuple[float, ...]:
        """Return the three numbers. Raises Invalid."""
        if not isinstance(raw, list | tuple) or len(raw) != len(_PLACE):
            raise Invalid("must be [latitude, longitude, height]")
        return tuple(each(zip(_PLACE, raw, strict=True), lambda pair: pair[0].read(pair[1])))


def number(meaning: str, unit: str, low: float, high: float) -> Quantity:
    """Return the kind of value of a number within bounds."""
    return Quantity(meaning, unit, ge=low, le=high, sweep=False)


def read_record(path: Path, kind: type[RecordT]) -> RecordT:
    """Read a JSON file. Raises StudyError with all that is wrong, at its lines."""
    source = read(path)  # JSON is YAML
    try:
        return kind.model_validate(source.data)
    except ValidationError as error:
        empty = source.problem(tuple(error.errors()[0]["loc"]), "is empty")
        raise StudyError(list(translate(error, kind, source)) or empty) from None


_Vector = Annotated[tuple[float, ...], Numbers("Vector", "m", ("east", "north", "up"), ge=-100, le=100)]
_Position = Annotated[tuple[float, ...], Position("Latitude, longitude [deg] and height [m]")]


class _Facet(Record):
    translation_vector: _Vector
    canting_e: _Vector
    canting_n: _Vector


class _Facets(Record):
    facets: Annotated[tuple[_Facet, ...], Field(min_length=1)]


class _Kinematics(Record):
    concentrator_translation_n: Annotated[float, number("Distance of the mirror from its pivot", "m", -10, 10)]


class _Heliostat(Record):
    heliostat_position: _Position
    width: Annotated[float, number("Width of the mirror", "m", 0.01, 100)]
    height: Annotated[float, number("Height of the mirror", "m", 0.01, 100)]
    facet_properties: _Facets
    kinematics_properties: _Kinematics


class _Target(Record):
    normal_vector: _Vector
    coordinates: dict[str, _Position]
    radius: Annotated[float | None, number("Radius of the target", "m", 0.1, 1000)] = None


class _Plant(Record):
    coordinates: _Position


def files_of(folder: Path, pattern: str) -> list[Path]:
    """Return the files of a folder and its subfolders that match a pattern, in the order of their names."""
    return [path for depth in range(_DEEPEST + 1) for path in sorted(folder.glob("*/" * depth + pattern))]


def heliostat_files(folder: Path) -> dict[str, Path]:
    """File of properties of each heliostat, by its name, in the order of names.

    Raises
    ------
    StudyError
        There are none, or two have the same name.
    """
    ending, found, problems = "heliostat-properties.json", dict[str, Path](), []
    for path in files_of(folder, f"*{ending}"):
        name = path.name.removesuffix(ending).rstrip("-_") or path.parent.name
        if found.setdefault(name, path) != path:
            problems.append(
                Problem(f"is the second file of heliostat {name}; the first is {found[name]}", file=str(path))
            )
    if not folder.is_dir():
        problems = [Problem("is no folder of PAINT: there is no such folder", file=str(folder))]
    elif not found:
        problems = [Problem(f"is no folder of PAINT: it holds no *{ending}", file=str(folder))]
    if problems:
        raise StudyError(problems)
    return dict(sorted(found.items()))


def read_paint(folder: str | os.PathLike[str], target: str = "receiver") -> Plant:
    """Read a folder of PAINT, the database of the Jülich solar tower.

    Parameters
    ----------
    folder : path
        With one file ``*tower-measurements.json``, and ``*heliostat-properties.json`` for each heliostat.
    target : str
        Which of the measured targets the heliostats aim at.

    Returns
    -------
    Plant
        `layout`, which `write_layout` writes, the blocks `site`, `heliostat` and `receiver` of a study, and `notes`
        on the differences. Its origin is below the centre of the target, at the height of the plant.

    Raises
    ------
    StudyError
        All that is wrong with the files, at their lines.
    """
    folder = user_path(folder)
    files = heliostat_files(folder)
    towers = files_of(folder, "*tower-measurements.json")
    if len(towers) != 1:
        given = f"holds {len(towers)} files *tower-measurements.json: one is needed"
        raise StudyError(Problem(f"is no folder of PAINT: it {given}", file=str(folder)))
    origin, receiver, centre, about = read_tower(towers[0], target)
    mirrors, problems = [], list[Problem]()
    for path in files.values():
        try:
            mirrors.append(_mirror(path, origin))
            if mirrors[-1].grid != mirrors[0].grid:
                across, rows, gap = mirrors[0].grid
                message = f"must be {across} x {rows} facets with gaps of {gap:g} m, as others of the field have them"
                problems.append(read(path).problem(("facet_properties",), message))
        except StudyError as error:
            problems += error.problems
    if problems:
        raise StudyError(listed(problems, MAX_LISTED, len(problems)))
    pivots = np.array([mirror.pivot for mirror in mirrors]) - (*centre[:2], 0.0)
    columns: dict[str, Any] = {"id": np.array(list(files)), "target": np.full(len(files), target)}
    for key in ("width", "height", "canting_distance"):
        columns[key] = np.array([getattr(mirror, key) for mirror in mirrors]).round(_DIGITS)
    site = dict(zip(("latitude", "longitude", "altitude"), origin, strict=True))
    canting = "on_axis" if any(mirror.canting_distance for mirror in mirrors) else "none"
    facets = dict(zip(("columns", "rows", "gap"), mirrors[0].grid, strict=True)) | {"canting": canting}
    heliostat = {"pivot_height": 0, "facets": facets}
    slant = np.sqrt(np.sum((pivots - (0.0, 0.0, centre[2])) ** 2, axis=1))
    apart = 1e3 * max(one.canting_error(distance) for one, distance in zip(mirrors, slant, strict=True))
    exact = 1e3 * max(one.canting_error(one.canting_distance) for one in mirrors)
    blocks = {"site": site, "heliostat": heliostat, "receiver": receiver}
    name = folder.absolute().name
    which = f"Heliostat {next(iter(files))}" if len(files) == 1 else f"{len(files)} heliostats"
    in_front = max(mirror.offset for mirror in mirrors)
    notes = (
        f"{which} of the PAINT folder {name!r}, aimed at {target!r}. A study takes from it:",
        *(f"{key}: {json.dumps(block).replace(chr(34), '')}" for key, block in blocks.items()),
        "Source: PAINT, doi 10.1038/s41560-026-02070-1; MIT licence, copyright 2024 Deutsches Zentrum für Luft- und",
        "Raumfahrt and Karlsruher Institut für Technologie.",
        "x and y count from below the target's centre; z is the height of the pivot above the plant's altitude.",
        f"Facets are canted on axis for canting_distance, to {exact:.2g} mrad. With canting: on_axis they are canted",
        f"for the slant range: normals differ by up to {apart:.2g} mrad. The focus of the facets is not in the files.",
        f"Not in the study: mirrors up to {in_front:.3f} m before their pivots, order and errors of axes{about}.",
    )
    east, north, up = (pivots.round(_DIGITS) + 0.0).T
    layout = Layout(east, north, up, columns, name, notes=notes)
    return Plant(layout, site, heliostat, receiver, notes, tuple(mirror.offset for mirror in mirrors))


def read_tower(path: Path, target: str) -> tuple[tuple[float, ...], dict[str, Any], Floats, str]:
    """Read a target of the tower.

    Parameters
    ----------
    path : Path
        ``*tower-measurements.json``.
    target : str
        Name of the target.

    Returns
    -------
    origin : tuple of float
        Latitude, longitude [deg] and height [m] of the plant.
    receiver : dict
        Block of a study.
    centre : ndarray, shape (3,)
        Centre of the target, east, north and up of the origin. [m]
    about : str
        Properties of the target that the block lacks.

    Raises
    ------
    StudyError
        If the file is wrong, at its lines.
    """
    source = read(path)
    known = [key for key, value in source.data.items() if isinstance(value, dict) and "normal_vector" in value]
    if target not in known:
        message = f"has no target {target!r}; it has {', '.join(known) or 'none'}"
        raise StudyError(Problem(message, file=str(path)))
    fields: dict[str, Any] = {target: (_Target, ...), "power_plant_properties": (_Plant, ...)}
    tower: Any = read_record(path, create_model("Tower", __base__=Record, **fields))
    origin, record = tower.power_plant_properties.coordinates, getattr(tower, target)
    inner = "receiver_inner_" if "receiver_inner_upper_left" in record.coordinates else ""
    names = [f"{inner}{height}_{side}" for height in ("upper", "lower") for side in ("left", "right")]
    if missing := [name for name in (*names, "center") if name not in record.coordinates]:
        raise StudyError(source.problem((target, "coordinates"), f"has no {missing[0]!r}"))
    corners = local_positions([record.coordinates[name] for name in names], origin).reshape(2, 2, 3)
    centre, normal = local_positions(record.coordinates["center"], origin), np.array(record.normal_vector)
    if not np.any(normal) or np.sum((corners.mean(axis=(0, 1)) - centre) ** 2) > 1.0:
        raise StudyError(
            source.problem((target,), "has no normal, or a centre more than 1 m from the centre of its corners")
        )
    sides = [float(np.mean(np.sqrt(np.sum(np.diff(corners, axis=axis) ** 2, axis=-1)))) for axis in (1, 0)]
    block = {
        "kind": "rectangle",
        "height": round(float(centre[2]), 4),
        "azimuth": round(math.degrees(math.atan2(normal[0], normal[1])), 4),
        "tilt": round(math.degrees(math.atan2(normal[2], math.hypot(normal[0], normal[1]))), 4),
        "width": round(sides[0], 4),
        "height_extent": round(sides[1], 4),
    }
    about = f", curvature of the target (radius {record.radius:g} m)" if record.radius else ""
    return origin, block, centre, about


class _Mirror(NamedTuple):
    """A heliostat of PAINT."""

    pivot: Floats
    width: float
    height: float
    #: Columns, rows and gap of the facets. [1, 1, m]
    grid: tuple[int, int, float]
    #: Distance at which the facets would be canted on axis; 0 if they are not canted. [m]
    canting_distance: float
    #: Distance of the mirror's surface from the pivot. [m]
    offset: float
    #: Centres of the facets along width and height, shape (facets, 2). [m]
    centres: Floats
    #: Slopes of their surfaces towards the sun along width and height, shape (facets, 2). [1]
    slopes: Floats

    def canting_error(self, distance: float) -> float:
        """Return the maximum angle between a facet's normal and canting on axis for a distance. [rad]"""
        aimed = self.centres * (0.5 / distance if distance else 0.0)
        return float(np.max(np.sqrt(np.sum((self.slopes - aimed) ** 2, axis=1))))


def _mirror(path: Path, origin: Sequence[float]) -> _Mirror:
    """Read the properties of a heliostat. Raises StudyError."""
    record, wrong = read_record(path, _Heliostat), ""
    pivot = local_positions(record.heliostat_position, origin)
    if (away := float(np.max(np.abs(pivot)))) > FARTHEST:
        raise StudyError(read(path).problem(("heliostat_position",), f"is {away / 1e3:,.0f} km from the tower"))
    facets, sides = record.facet_properties.facets, (record.width, record.height)
    moved, along, across = (np.array([getattr(facet, name) for facet in facets]) for name in _Facet.model_fields)
    normal = np.cross(along, across)
    grid = _grid(moved[:, :2], 2 * np.array([along[:, 0], across[:, 1]]).T, sides)
    if np.any(normal[:, 2] <= 0):
        wrong = "canting vectors must span a facet that looks up"
    elif grid is None:
        wrong = f"must be a grid of equal facets with equal gaps, on {sides[0]:g} m x {sides[1]:g} m, within 5 mm"
    if wrong or grid is None:
        raise StudyError(read(path).problem(("facet_properties",), wrong))
    centres, slopes = moved[:, :2], -normal[:, :2] / normal[:, 2:]
    curvature = float(np.sum(slopes * centres) / max(np.sum(centres**2), 1e-12))
    offset = abs(record.kinematics_properties.concentrator_translation_n) + abs(float(moved[:, 2].mean()))
    return _Mirror(pivot, *sides, grid, 0.5 / curvature if curvature > 1e-9 else 0.0, offset, centres, slopes)


def _grid(centres: Floats, sizes: Floats, sides: tuple[float, float]) -> tuple[int, int, float] | None:
    """Columns, rows and gap of facets [1, 1, m]; None if they are no such grid."""
    counts, gaps, expected = [], [], []
    for axis in (0, 1):
        count = np.unique((centres[:, axis] / _OFF_GRID).round()).size
        pitch = (sides[axis] - sizes[:, axis].mean()) / max(count - 1, 1)
        counts.append(count)
        gaps += [pitch - sizes[:, axis].mean()] * (count > 1)
        expected.append((np.arange(count) - (count - 1) / 2) * pitch)
    gap = float(np.mean(gaps or [0.0]))
    whole = np.stack(np.meshgrid(*expected, indexing="ij"), axis=-1).reshape(-1, 2)
    if len(whole) != len(centres) or np.any(np.ptp(np.array([*gaps, gap])) > _OFF_GRID) or gap < -_OFF_GRID:
        return None
    nearest = np.abs(centres[:, np.newaxis] - whole).max(axis=-1)
    alike = np.all(nearest.min(axis=0) < _OFF_GRID) and np.ptp(sizes, axis=0).max() < _OFF_GRID
    return (counts[0], counts[1], round(max(gap, 0.0), 4)) if alike else None

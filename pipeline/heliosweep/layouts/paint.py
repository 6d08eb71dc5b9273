"""Measured fields in the form of PAINT, the database of the Jülich solar tower: positions, facets and targets.

A folder holds one file ``*tower-measurements.json``, and ``*heliostat-properties.json`` for each heliostat: in a folder
that has its name, or with its name before a hyphen, as in ``AA39-heliostat-properties.json``. Places are latitude,
longitude [deg] and height [m] of WGS84; here they become metres towards east, north and up (`local_positions`). For
the data: doi 10.1038/s41560-026-02070-1.

heliosweep takes a heliostat as a rectangle about its pivot, with a grid of equal facets that are canted on axis, and a
target as a rectangle. What this leaves out is told in `Plant.notes`.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.config.source import dotted, read
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.files import user_path
from heliosweep.kernels.arrays import Floats
from heliosweep.layouts.layout import FARTHEST, MAX_LISTED, Layout

#: Semi-major axis [m] and flattening of the ellipsoid WGS84.
SEMI_MAJOR_AXIS, FLATTENING = 6378137.0, 1 / 298.257223563

#: Folders in folders that are looked into, as PAINT has them: PLANT/AA39/Properties.
_DEEPEST = 3
#: A larger file is none of these. [bytes]
_MOST_BYTES = 2**20
#: Facet centres and sizes that differ by more from those of a grid are none. [m]
_OFF_GRID = 5e-3
_DIGITS = 6  # of what is written: a micrometre
_PLACE = (("latitude", -90.0, 90.0), ("longitude", -180.0, 180.0), ("height", -500.0, 10_000.0))


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
    #: What was read, and what of it a study cannot express.
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


class Record:
    """A JSON file of PAINT, whose values are checked where they are read.

    Raises StudyError where the file cannot be read or is no JSON.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            if not path.is_file():
                raise StudyError(Problem("is not a regular file", file=str(path)))
            if path.stat().st_size > _MOST_BYTES:
                raise StudyError(Problem("is larger than 1 MiB: no file of PAINT", file=str(path)))
            self.data = json.loads(path.read_bytes())
        except json.JSONDecodeError as error:
            raise StudyError(Problem(f"is not JSON: {error.msg}", "", str(path), error.lineno, error.colno)) from None
        except (OSError, ValueError, RecursionError) as error:
            message = getattr(error, "strerror", None) or "is not JSON"
            raise StudyError(Problem(message, file=str(path))) from None

    def value(self, *keys: str | int) -> Any:
        """What stands at these keys. Raises StudyError where one is missing."""
        value: Any = self.data
        for depth, key in enumerate(keys):
            try:
                value = value[key]
            except (LookupError, TypeError):
                raise StudyError(self.problem(keys[:depth], f"has no {key!r}")) from None
        return value

    def number(self, *keys: str | int, least: float, most: float) -> float:
        """A number within bounds. Raises StudyError."""
        value = self.value(*keys)
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
            message = f"must be a number from {least:g} to {most:g} (got {str(value)[:40]})"
            raise StudyError(self.problem(keys, message))
        return float(value)

    def vector(self, *keys: str | int) -> Floats:
        """Three numbers, at most 100 each way. Raises StudyError."""
        return np.array([self.number(*keys, axis, least=-100.0, most=100.0) for axis in range(3)])

    def place(self, *keys: str | int) -> list[float]:
        """Latitude, longitude [deg] and height [m]. Raises StudyError."""
        return [self.number(*keys, axis, least=low, most=high) for axis, (_, low, high) in enumerate(_PLACE)]

    def problem(self, keys: Sequence[str | int], message: str) -> Problem:
        """A problem at the line that has these keys, as far as it can be told."""
        try:
            return read(self.path).problem(tuple(keys), message)  # JSON is YAML
        except StudyError:
            return Problem(message, dotted(tuple(keys)), str(self.path))


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
        on what they leave out. Its origin is below the centre of the target, at the height of the plant.

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
    tower = Record(towers[0])
    origin = tower.place("power_plant_properties", "coordinates")
    receiver, centre, about = _target(tower, target, origin)
    mirrors, problems = [], list[Problem]()
    for path in files.values():
        try:
            mirrors.append(_Mirror.of(record := Record(path), origin))
            if mirrors[-1].grid != mirrors[0].grid:
                across, rows, gap = mirrors[0].grid
                message = f"must be {across} x {rows} facets with gaps of {gap:g} m, as others of the field have them"
                problems.append(record.problem(("facet_properties",), message))
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


def _target(tower: Record, target: str, origin: Sequence[float]) -> tuple[dict[str, Any], Floats, str]:
    """Block of a target, its centre east, north and up of the origin [m], and what the block does not tell."""
    known = [key for key, value in tower.data.items() if isinstance(value, dict) and "normal_vector" in value]
    if target not in known:
        message = f"has no target {target!r}; it has {', '.join(known) or 'none'}"
        raise StudyError(Problem(message, file=str(tower.path)))
    inner = "receiver_inner_" if "receiver_inner_upper_left" in str(tower.value(target, "coordinates")) else ""
    names = [f"{inner}{height}_{side}" for height in ("upper", "lower") for side in ("left", "right")]
    corners = local_positions([tower.place(target, "coordinates", name) for name in names], origin).reshape(2, 2, 3)
    centre = local_positions(tower.place(target, "coordinates", "center"), origin)
    normal = tower.vector(target, "normal_vector")
    if not np.any(normal) or np.sum((corners.mean(axis=(0, 1)) - centre) ** 2) > 1.0:
        raise StudyError(tower.problem((target,), "has no normal, or a centre more than 1 m from that of its corners"))
    sides = [float(np.mean(np.sqrt(np.sum(np.diff(corners, axis=axis) ** 2, axis=-1)))) for axis in (1, 0)]
    block = {
        "kind": "rectangle",
        "height": round(float(centre[2]), 4),
        "azimuth": round(math.degrees(math.atan2(normal[0], normal[1])), 4),
        "tilt": round(math.degrees(math.atan2(normal[2], math.hypot(normal[0], normal[1]))), 4),
        "width": round(sides[0], 4),
        "height_extent": round(sides[1], 4),
    }
    if "radius" not in tower.data[target]:
        return block, centre, ""
    radius = tower.number(target, "radius", least=0.1, most=1000.0)
    return block, centre, f", curvature of the target (radius {radius:g} m)"


class _Mirror(NamedTuple):
    """A heliostat of PAINT."""

    pivot: Floats
    width: float
    height: float
    #: Columns, rows and gap of the facets. [1, 1, m]
    grid: tuple[int, int, float]
    #: Distance at which the facets would be canted on axis; 0 where they are not canted. [m]
    canting_distance: float
    #: Distance of the mirror's surface from the pivot. [m]
    offset: float
    #: Centres of the facets along width and height, shape (facets, 2). [m]
    centres: Floats
    #: Slopes of their surfaces towards the sun along width and height, the same shape. [1]
    slopes: Floats

    @classmethod
    def of(cls, record: Record, origin: Sequence[float]) -> _Mirror:
        """Read the properties of a heliostat. Raises StudyError."""
        pivot = local_positions(record.place("heliostat_position"), origin)
        if (away := float(np.max(np.abs(pivot)))) > FARTHEST:
            raise StudyError(record.problem(("heliostat_position",), f"is {away / 1e3:,.0f} km from the tower"))
        width, height = (record.number(side, least=0.01, most=100.0) for side in ("width", "height"))
        facets = record.value("facet_properties", "facets")
        keys = [("facet_properties", "facets", each) for each in range(len(facets) if isinstance(facets, list) else 0)]
        offset = record.number("kinematics_properties", "concentrator_translation_n", least=-10, most=10)
        if not keys:
            raise StudyError(record.problem(("facet_properties", "facets"), "holds no facets"))
        moved, along, across = (
            np.array([record.vector(*key, name) for key in keys])
            for name in ("translation_vector", "canting_e", "canting_n")
        )
        normal = np.cross(along, across)
        if np.any(normal[:, 2] <= 0):
            raise StudyError(record.problem(("facet_properties",), "canting vectors must span a facet that looks up"))
        centres, slopes = moved[:, :2], -normal[:, :2] / normal[:, 2:]
        grid = _grid(centres, 2 * np.array([along[:, 0], across[:, 1]]).T, (width, height))
        if grid is None:
            message = f"must be a grid of equal facets with equal gaps, on {width:g} m x {height:g} m, within 5 mm"
            raise StudyError(record.problem(("facet_properties",), message))
        curvature = float(np.sum(slopes * centres) / max(np.sum(centres**2), 1e-12))
        distance = 0.5 / curvature if curvature > 1e-9 else 0.0
        return cls(pivot, width, height, grid, distance, abs(offset) + abs(float(moved[:, 2].mean())), centres, slopes)

    def canting_error(self, distance: float) -> float:
        """Largest turn of a facet's normal against canting on axis for a distance. [rad]"""
        aimed = self.centres * (0.5 / distance if distance else 0.0)
        return float(np.max(np.sqrt(np.sum((self.slopes - aimed) ** 2, axis=1))))


def _grid(centres: Floats, sizes: Floats, sides: tuple[float, float]) -> tuple[int, int, float] | None:
    """Columns, rows and gap of facets [1, 1, m]; None where they are no such grid."""
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

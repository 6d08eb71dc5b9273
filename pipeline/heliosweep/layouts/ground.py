"""The ground of a generated field: where heliostats may stand, and how high it is there.

Polygons are text, GeoJSON or WKT; a grid of heights is NetCDF. All are in metres east and north of the tower.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.errors import Problem, StudyError
from heliosweep.layouts.layout import FARTHEST

Floats = NDArray[np.float64]

MAX_BYTES = 64 * 2**20
"""Largest file of polygons that is read."""

AREAS = {"boundary": "layout_boundary", "exclude": "layout_exclude"}
"""Attributes by which a result tells its polygons, by key of the study."""

EDGE = 1e-9
"""Angle by which a heliostat may be beyond the edge of a sector: rounding. [deg]"""

_IN_METRES = f"it must be in metres from the tower's base, at most {FARTHEST:,.0f}"
_UNITS = ("m", "metre", "metres", "meter", "meters")


@dataclass(frozen=True, eq=False)
class Region:
    """Where heliostats may stand.

    Parameters
    ----------
    sectors : sequence of (float, float)
        Azimuth of the middle, and width, of each sector seen from the tower; none for all azimuths. [deg]
    boundary, exclude : shapely geometry, optional
        Polygons within which heliostats stand, and within which none does. [m]
    key : str
        Key of what heliostats could have no room in, for messages.
    """

    sectors: Sequence[tuple[float, float]] = ()
    boundary: Any = None
    exclude: Any = None
    key: str = "sectors"

    def inside(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether heliostats may stand at some places, shape (n,); not on the line of a boundary. [m]"""
        inside = np.ones(x.shape, bool)
        if self.sectors:
            azimuth = np.degrees(np.arctan2(x, y))
            off = ((abs((azimuth - middle + 180) % 360 - 180), width / 2) for middle, width in self.sectors)
            inside = np.logical_or.reduce([angle <= half + EDGE for angle, half in off])
        if self.boundary is not None or self.exclude is not None:
            from shapely import contains_xy, intersects_xy

            if self.boundary is not None:
                inside &= contains_xy(self.boundary, x, y)
            if self.exclude is not None:
                inside &= ~intersects_xy(self.exclude, x, y)
        return inside

    @property
    def reach(self) -> float:
        """Distance from the tower beyond which there is no room. [m]"""
        if self.boundary is None:
            return FARTHEST
        from shapely import get_coordinates

        return float(np.hypot(*get_coordinates(self.boundary).T).max())

    def no_room(self) -> StudyError:
        """What is said where no heliostat fits."""
        hint = "; it counts in metres from the tower's base" if self.boundary is not None else ""
        return StudyError(Problem(f"leaves no room for a heliostat{hint}", self.key))


@lru_cache(maxsize=8)
def region_of(
    sectors: tuple[tuple[float, float], ...],
    boundary: Path | None,
    exclude: Path | None,
    stamps: tuple[int | None, ...],
) -> Region:
    """Region of some sectors and files, read once while these do not change (`stamps`); one object for the same.

    Raises StudyError, each problem with its key: ``boundary`` or ``exclude``.
    """
    areas = [
        None if path is None else read_area(path, key) for key, path in (("boundary", boundary), ("exclude", exclude))
    ]
    within, without = areas
    if within is not None and without is not None and within.difference(without).area == 0:
        raise StudyError(Problem("leaves no room: it covers the whole boundary", "exclude"))
    key = "boundary" if boundary is not None else "sectors" if sectors else "exclude"
    return Region(sectors, within, without, key)


def read_area(path: Path, key: str) -> Any:
    """Read polygons, GeoJSON or WKT, as one prepared geometry. [m]

    Raises StudyError, with this key, for what is none, holds no polygon, or one that crosses itself.
    """
    import shapely

    def wrong(message: str) -> StudyError:
        return StudyError(Problem(f"{path.name} {message}", key))

    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        text = data.decode("utf-8-sig")
    except OSError as error:
        raise wrong(f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise wrong("is not text; save the polygons as GeoJSON or WKT") from None
    if len(data) > MAX_BYTES:
        raise wrong(f"is larger than {MAX_BYTES // 2**20} MiB")
    text = "\n".join(line for line in text.splitlines() if not line.startswith("#")).strip()
    form = "GeoJSON" if text.startswith("{") else "WKT"
    try:
        read = shapely.from_geojson(text) if form == "GeoJSON" else shapely.from_wkt(text)
    except shapely.errors.ShapelyError as error:
        said = re.sub(r"^\w+Exception: ", "", str(error)).splitlines()[0][:100]
        raise wrong(f"is no {form}: {said}; give polygons as POLYGON ((0 0, 9 0, 9 9, 0 0))") from None
    polygons = list(_polygons(read))
    others = {part.geom_type for part in polygons} - {"Polygon"}
    if others or not polygons:
        found = f"a {min(others)}" if others else "none"
        raise wrong(f"must hold polygons (got {found}); give a road as the polygon that it covers")
    for polygon in polygons:
        corners = shapely.get_coordinates(polygon)
        if not (np.abs(corners) <= FARTHEST).all():
            place = ", ".join(f"{value:.6g}" for value in corners[~(np.abs(corners) <= FARTHEST).all(axis=1)][0])
            raise wrong(f"has a corner out of any field: {_IN_METRES} (got {place})")
        if not polygon.is_valid:
            reason = shapely.is_valid_reason(polygon)
            crossing = re.fullmatch(r"(?:Ring )?Self-intersection\[(\S+) (\S+)\]", reason)
            what = f"crosses itself at {float(crossing[1]):.6g}, {float(crossing[2]):.6g}" if crossing else reason
            raise wrong(f"{what}; list the corners in their order along the edge")
    area = shapely.union_all(polygons)
    if area.area == 0:
        raise wrong("leaves no room: its polygons have no area")
    shapely.prepare(area)
    return area


def _polygons(geometry: Any) -> Iterator[Any]:
    """Single geometries of a geometry, however they are nested; empty ones left out."""
    if geometry is None or geometry.is_empty:
        return
    parts = getattr(geometry, "geoms", None)
    if parts is None:
        yield geometry
        return
    for part in parts:
        yield from _polygons(part)


def slope_heights(x: Floats, y: Floats, slope: float, azimuth: float) -> Floats:
    """Height of even ground above the tower's base; it falls by `slope` towards `azimuth`. [m, deg]"""
    down = math.radians(azimuth)
    return -math.tan(math.radians(slope)) * (math.sin(down) * x + math.cos(down) * y)


@dataclass(frozen=True, eq=False)
class Heights:
    """A grid of heights over rising x, shape (X,), and y, shape (Y,), with straight lines between. [m]"""

    x: Floats
    y: Floats
    height: Floats
    """Above any level, shape (Y, X); NaN where nothing is known."""

    def at(self, x: Floats, y: Floats) -> Floats:
        """Height at some places above that at the tower; bilinear. NaN where the grid does not tell it."""
        return self._level(x, y) - self._level(np.zeros(1), np.zeros(1))

    def _level(self, x: Floats, y: Floats) -> Floats:
        column, right = _cell(self.x, x)
        row, up = _cell(self.y, y)
        h = self.height
        low = h[row, column] * (1 - right) + h[row, column + 1] * right
        high = h[row + 1, column] * (1 - right) + h[row + 1, column + 1] * right
        return low * (1 - up) + high * up


def _cell(grid: Floats, at: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Number of the cell of each place along a rising grid, and the part of it that lies before; NaN outside."""
    cell = np.clip(np.searchsorted(grid, at, side="right") - 1, 0, len(grid) - 2)
    part = (at - grid[cell]) / (grid[cell + 1] - grid[cell])
    return cell, np.where((part >= 0) & (part <= 1), part, np.nan)


@lru_cache(maxsize=4)
def read_heights(path: Path, stamp: int | None) -> Heights:
    """Read a grid of heights, once while the file does not change (`stamp`).

    Raises StudyError, with the key ``terrain.file``, for what is no NetCDF or no grid over x and y.
    """
    import xarray as xr

    def wrong(message: str) -> StudyError:
        return StudyError(Problem(f"{path.name} {message}", "terrain.file"))

    try:
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as data:
            grids = [name for name, one in data.data_vars.items() if set(one.dims) == {"x", "y"}]
            sides = [data[side] if side in data.coords else None for side in "xy"]
            if len(grids) != 1 or any(side is None for side in sides):
                found = ", ".join(f"{name}({', '.join(map(str, one.dims))})" for name, one in data.data_vars.items())
                raise wrong(f"must hold one variable over x and y, both with coordinates in m (got {found or 'none'})")
            for name in ("x", "y", *grids):
                if (unit := str(data[name].attrs.get("units", "m"))) not in _UNITS:
                    raise wrong(f"must have {name} in m (got {unit})")
            x, y, height = (
                data[name].transpose(*order).to_numpy().astype(float)
                for name, order in (("x", "x"), ("y", "y"), (grids[0], ("y", "x")))
            )
    except (OSError, ValueError, TypeError) as error:
        said = getattr(error, "strerror", None) or str(error).splitlines()[0][:100]
        raise wrong(f"is no NetCDF file that can be read: {said}") from None
    if min(x.size, y.size) < 2 or not all(np.isfinite(side).all() for side in (x, y)):
        raise wrong("must have at least two values along x and along y, all finite")
    if x[0] > x[-1]:
        x, height = x[::-1], height[:, ::-1]
    if y[0] > y[-1]:
        y, height = y[::-1], height[::-1]
    if not ((np.diff(x) > 0).all() and (np.diff(y) > 0).all()):
        raise wrong("must have x and y that rise or fall all along")
    return Heights(x, y, np.ascontiguousarray(height))


def heights_at(heights: Heights, name: str, x: Floats, y: Floats) -> Floats:
    """Heights of the ground at all places [m]. Raises StudyError, key ``terrain.file``, where one is not told."""
    found = heights.at(x, y)
    if (missing := int(np.isnan(found).sum())) > 0:
        spans = (f"{axis} from {side[0]:g} to {side[-1]:g} m" for axis, side in (("x", heights.x), ("y", heights.y)))
        where = "the tower" if missing == found.size else f"{missing:,} of {found.size:,} heliostats"
        message = f"{name} does not cover the field: {where} beyond its heights, {' and '.join(spans)}; add a boundary"
        raise StudyError(Problem(f"{message}, or take a larger grid", "terrain.file"))
    return found

"""The ground of a generated field: where heliostats may stand, and how high it is there.

Polygons are text, GeoJSON or WKT; a grid of heights is NetCDF or GeoTIFF. All are in metres east and north of the
tower, or of an origin of which the tower's coordinates are known, as those of a map.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.tables import table_text
from heliosweep.errors import Problem, StudyError
from heliosweep.files import read_once
from heliosweep.kernels.arrays import Floats
from heliosweep.layouts.layout import FARTHEST

_NESTED = 3
"""Maximum depth of collections of polygons."""

AREAS = {"boundary": "layout_boundary", "exclude": "layout_exclude"}
"""Attributes by which a result tells its polygons, by key of the study."""

MAX_CELLS = 25_000_000
"""Heights of the largest grid that is read."""

EDGE = 1e-9
"""Angle by which a heliostat may be beyond the edge of a sector: rounding. [deg]"""

LEAST_EXTENT = 1.0
"""Polygons that are all together smaller, with corners that may be longitudes and latitudes, are in degrees. [m]"""

Place = tuple[float, float]
"""East and north. [m]"""

AT_TOWER: Place = (0.0, 0.0)

_IN_METRES = f"it must be in metres from the tower's base, at most {FARTHEST:,.0f}; of map coordinates give 'origin'"
_IN_DEGREES = (
    "is in degrees, as it seems: all of it is less than 1 m across; project it to metres, as to UTM, and give 'origin'"
)
_UNITS = ("m", "metre", "metres", "meter", "meters")
_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


@dataclass(frozen=True, eq=False)
class Region:
    """Where heliostats may stand.

    Parameters
    ----------
    sectors : sequence of (float, float)
        Azimuth of the middle, and width, of each sector seen from the tower; none for all azimuths. [deg]
    boundary, exclude : shapely geometry, optional
        Polygons within which heliostats stand, and within which none does. [m]
    margin : float
        Distance that they keep from the edges of both. [m]
    key : str
        Key of what heliostats could have no room in, for messages.
    """

    sectors: Sequence[tuple[float, float]] = ()
    boundary: Any = None
    exclude: Any = None
    margin: float = 0.0
    key: str = "sectors"

    def inside(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether heliostats may stand at some places, shape (n,); not on the line of a boundary or margin. [m]"""
        inside = np.ones(x.shape, bool)
        if self.sectors:
            azimuth = np.degrees(np.arctan2(x, y))
            off = ((abs((azimuth - middle + 180) % 360 - 180), width / 2) for middle, width in self.sectors)
            inside = np.logical_or.reduce([angle <= half + EDGE for angle, half in off])
        if self.boundary is not None or self.exclude is not None:
            from shapely import contains_xy, dwithin, intersects_xy, points

            if self.boundary is not None:
                inside &= contains_xy(self.boundary, x, y)
            if self.exclude is not None:
                inside &= ~intersects_xy(self.exclude, x, y)
            for edge in self._edges if self.margin else ():
                left = np.flatnonzero(inside)
                inside[left] = ~dwithin(edge, points(x[left], y[left]), self.margin)
        return inside

    @cached_property
    def _edges(self) -> list[Any]:
        from shapely import prepare

        edges = [area.boundary for area in (self.boundary, self.exclude) if area is not None]
        for edge in edges:
            prepare(edge)
        return edges

    @property
    def reach(self) -> float:
        """Distance from the tower beyond which there is no room. [m]"""
        if self.boundary is None:
            return FARTHEST
        from shapely import get_coordinates

        return float(np.hypot(*get_coordinates(self.boundary).T).max())

    def no_room(self) -> StudyError:
        """What is said where no heliostat fits."""
        hint = ""
        if self.boundary is not None:
            hint = f" {self.margin:g} m from its edge" if self.margin else ""
            hint += "; it counts in metres from the tower's base, or from 'origin'"
        return StudyError(Problem(f"leaves no room for a heliostat{hint}", self.key))


@lru_cache(maxsize=8)
def region_of(
    sectors: tuple[tuple[float, float], ...], boundary: Any = None, exclude: Any = None, margin: float = 0.0
) -> Region:
    """Region of some sectors and polygons; one object for the same. Raises StudyError, its key ``exclude``."""
    if boundary is not None and exclude is not None and boundary.difference(exclude).area == 0:
        raise StudyError(Problem("leaves no room: it covers the whole boundary", "exclude"))
    key = "boundary" if boundary is not None else "sectors" if sectors else "exclude"
    return Region(sectors, boundary, exclude, margin, key)


@read_once(8)
def read_area(path: Path, key: str, tower: Place = AT_TOWER) -> Any:
    """Read polygons, GeoJSON or WKT, as one prepared geometry about a tower, whose place they count from. [m]

    Raises StudyError, with this key, for what is none, holds no polygon, or one that crosses itself.
    """
    import shapely
    from shapely.affinity import translate

    def wrong(message: str) -> StudyError:
        return StudyError(Problem(f"{path.name} {message}", key))

    try:
        text = table_text(path, path.name)
    except StudyError as error:
        raise wrong(error.problems[0].message) from None
    text = "\n".join(line for line in text.splitlines() if not line.startswith("#")).strip()
    form = "GeoJSON" if text.startswith("{") else "WKT"
    try:
        read = shapely.from_geojson(text) if form == "GeoJSON" else shapely.from_wkt(text)
    except shapely.errors.ShapelyError as error:
        said = re.sub(r"^\w+Exception: ", "", str(error)).splitlines()[0][:100]
        raise wrong(f"is no {form}: {said}; give polygons as POLYGON ((0 0, 9 0, 9 9, 0 0))") from None
    polygons = shapely.get_parts([read])
    for _ in range(_NESTED):
        polygons = shapely.get_parts(polygons)
    polygons = polygons[~(shapely.is_empty(polygons) | shapely.is_missing(polygons))]
    others = {part.geom_type for part in polygons} - {"Polygon"}
    if others or not polygons.size:
        found = f"a {min(others)}" if others else "none"
        raise wrong(f"must hold polygons (got {found}); give a road as the polygon that it covers")
    corners = shapely.get_coordinates(polygons)
    if (np.abs(corners) <= (180.0, 90.0)).all() and np.ptp(corners, axis=0).max() < LEAST_EXTENT:
        raise wrong(_IN_DEGREES)
    if tower != AT_TOWER:
        polygons = np.array([translate(polygon, -tower[0], -tower[1]) for polygon in polygons])
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


def slope_heights(x: Floats, y: Floats, slope: float, azimuth: float) -> Floats:
    """Height of even ground above the tower's base; it falls by `slope` towards `azimuth`. [m, deg]"""
    down = math.radians(azimuth)
    return -math.tan(math.radians(slope)) * (math.sin(down) * x + math.cos(down) * y)


@read_once(4)
def read_heights(path: Path, tower: Place = AT_TOWER) -> Any:
    """Read a grid of heights as a bilinear function of (y, x) about a tower; NaN where the grid does not tell it. [m]

    Raises StudyError, with the key ``terrain.file``, for what is neither NetCDF nor GeoTIFF, or no grid over x and y.
    """

    from scipy.interpolate import RegularGridInterpolator

    def wrong(message: str) -> StudyError:
        return StudyError(Problem(f"{path.name} {message}", "terrain.file"))

    try:
        with path.open("rb") as file:
            tiff = file.read(4) in _MAGIC
    except OSError as error:
        raise wrong(f"cannot be read: {error.strerror}") from None
    x, y, height = _geotiff(path, wrong) if tiff else _netcdf(path, wrong)
    if min(x.size, y.size) < 2 or not all(np.isfinite(side).all() for side in (x, y)):
        raise wrong("must have at least two values along x and along y, all finite")
    if x[0] > x[-1]:
        x, height = x[::-1], height[:, ::-1]
    if y[0] > y[-1]:
        y, height = y[::-1], height[::-1]
    if not ((np.diff(x) > 0).all() and (np.diff(y) > 0).all()):
        raise wrong("must have x and y that rise or fall all along")
    return RegularGridInterpolator((y - tower[1], x - tower[0]), np.ascontiguousarray(height), bounds_error=False)


def _netcdf(path: Path, wrong: Callable[[str], StudyError]) -> tuple[Floats, Floats, Floats]:
    """Places along x and y, and heights over (y, x), of a NetCDF file."""
    import xarray as xr

    from heliosweep.netcdf import LIBRARY_LOCK

    try:
        with LIBRARY_LOCK, xr.open_dataset(path, engine="netcdf4", decode_times=False, lock=LIBRARY_LOCK) as data:
            grids = [name for name, one in data.data_vars.items() if set(one.dims) == {"x", "y"}]
            sides = [data[side] if side in data.coords else None for side in "xy"]
            if len(grids) != 1 or any(side is None for side in sides):
                found = ", ".join(f"{name}({', '.join(map(str, one.dims))})" for name, one in data.data_vars.items())
                raise wrong(f"must hold one variable over x and y, both with coordinates in m (got {found or 'none'})")
            if data[grids[0]].size > MAX_CELLS:
                raise wrong(_too_large(data[grids[0]].size))
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
    return x, y, height


def _too_large(cells: int) -> str:
    return f"has {cells:,} heights, and {MAX_CELLS:,} are read: cut it to the field, or take a coarser grid"


def _geotiff(path: Path, wrong: Callable[[str], StudyError]) -> tuple[Floats, Floats, Floats]:
    """Places along x and y, and heights over (y, x), of a GeoTIFF file; missing heights are NaN."""
    try:
        import rasterio
    except ImportError:
        raise wrong("is a GeoTIFF, which needs the package rasterio: pip install 'heliosweep[terrain]'") from None
    try:
        with catch_warnings(action="ignore"), rasterio.open(path) as grid:
            cell, reference = grid.transform, grid.crs
            if grid.width * grid.height > MAX_CELLS:
                raise wrong(_too_large(grid.width * grid.height))
            if grid.count != 1 or cell.is_identity or not cell.is_rectilinear:
                raise wrong("must be one band of heights with its place on the map, north up, as gdalwarp writes it")
            if reference is not None and reference.is_geographic:
                raise wrong("has no map coordinates in m; project it, as by gdalwarp -t_srs EPSG:32630")
            in_metres = reference is None or not reference.is_projected or reference.linear_units_factor[1] == 1.0
            if not in_metres or (grid.units[0] or "m") not in _UNITS:
                raise wrong("must be in m, its coordinates and its heights")
            height = grid.read(1, masked=True).astype(float).filled(np.nan)
    except rasterio.errors.RasterioError as error:
        said = str(error).splitlines()[0][:100]
        raise wrong(f"is no GeoTIFF that can be read: {said}; convert it by gdal_translate") from None
    x = cell.c + (np.arange(height.shape[1]) + 0.5) * cell.a
    y = cell.f + (np.arange(height.shape[0]) + 0.5) * cell.e
    return x, y, height


def heights_at(heights: Any, name: str, x: Floats, y: Floats) -> Floats:
    """Heights of the ground at all places above that at the tower, from `read_heights`. [m]

    Raises StudyError, key ``terrain.file``, where one is not told.
    """
    found: Floats = heights((y, x)) - heights((0.0, 0.0))
    if (missing := int(np.isnan(found).sum())) > 0:
        sides = zip("xy", reversed(heights.grid), strict=True)
        spans = (f"{axis} from {side[0]:g} to {side[-1]:g} m" for axis, side in sides)
        where = "the tower" if missing == found.size else f"{missing:,} of {found.size:,} heliostats"
        message = f"{name} does not cover the field: {where} beyond its heights, {' and '.join(spans)}"
        message += "; for map coordinates set 'origin', or add a boundary, or take a larger grid"
        raise StudyError(Problem(message, "terrain.file"))
    return found

"""The ground of a generated field: areas for heliostats, and heights.

Polygons are text, GeoJSON or WKT; a grid of heights is NetCDF or GeoTIFF. All are in metres east and north of the
tower, or of an origin such as the origin of a map.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
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

#: Maximum depth of collections of polygons.
_NESTED = 3

#: Attributes of a result for its polygons, by key of the study.
AREAS = {"boundary": "layout_boundary", "exclude": "layout_exclude"}

#: Heights of the largest grid that is read.
MAX_CELLS = 25_000_000

#: Angle by which a heliostat may be beyond the edge of a sector: rounding. [deg]
EDGE = 1e-9

#: Polygons that are all together smaller, with corners that may be longitudes and latitudes, are in degrees. [m]
LEAST_EXTENT = 1.0

#: East and north. [m]
Place = tuple[float, float]

AT_TOWER: Place = (0.0, 0.0)

_IN_METRES = f"it must be in metres from the tower's base, at most {FARTHEST:,.0f}; of map coordinates give 'origin'"
_IN_DEGREES = (
    "is in degrees, as it seems: all of it is less than 1 m across; project it to metres, as to UTM, and give 'origin'"
)
_UNITS = ("m", "metre", "metres", "meter", "meters")
_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


@dataclass(frozen=True, eq=False)
class Region:
    """Ground for heliostats.

    Parameters
    ----------
    sectors : sequence of (float, float)
        Azimuth of the middle, and width, of each sector seen from the tower; none for all azimuths. [deg]
    boundary, exclude : shapely geometry, optional
        Polygons that contain all heliostats, and polygons that contain none. [m]
    margin : float
        Minimum distance of heliostats from the edges of both. [m]
    key : str
        Key of the ground in messages.
    """

    sectors: Sequence[tuple[float, float]] = ()
    boundary: Any = None
    exclude: Any = None
    margin: float = 0.0
    key: str = "sectors"

    def inside(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.bool_]:
        """Return True for positions inside the region, not on a boundary or margin, shape (n,). [m]"""
        inside = np.full(x.shape, not self.sectors)
        azimuth = np.degrees(np.arctan2(x, y)) if self.sectors else x
        for middle, width in self.sectors:
            inside |= np.abs((azimuth - middle + 180) % 360 - 180) <= width / 2 + EDGE
        areas = [area for area in (self.boundary, self.exclude) if area is not None]
        if areas:
            from shapely import contains_xy, dwithin, intersects_xy, points

            if self.boundary is not None:
                inside &= contains_xy(self.boundary, x, y)
            if self.exclude is not None:
                inside &= ~intersects_xy(self.exclude, x, y)
            for area in areas if self.margin else ():
                left = np.flatnonzero(inside)
                inside[left] = ~dwithin(_edge(area), points(x[left], y[left]), self.margin)
        return inside

    @property
    def reach(self) -> float:
        """Maximum distance of heliostats from the tower. [m]"""
        if self.boundary is None:
            return FARTHEST
        from shapely import get_coordinates

        return float(np.hypot(*get_coordinates(self.boundary).T).max())

    def no_room(self) -> StudyError:
        """Return the error if no heliostat fits."""
        hint = f" {self.margin:g} m from its edge" * bool(self.margin and self.boundary is not None)
        if self.boundary is not None:
            hint += "; it counts in metres from the tower's base, or from 'origin'"
        return StudyError(Problem(f"leaves no room for a heliostat{hint}", self.key))


@lru_cache(maxsize=8)
def _edge(area: Any) -> Any:
    """Return the prepared edge of polygons."""
    from shapely import prepare

    edge = area.boundary
    prepare(edge)
    return edge


@lru_cache(maxsize=8)
def region_of(
    sectors: tuple[tuple[float, float], ...], boundary: Any = None, exclude: Any = None, margin: float = 0.0
) -> Region:
    """Return the region of sectors and polygons; one object for the same. Raises StudyError, its key ``exclude``."""
    if boundary is not None and exclude is not None and boundary.difference(exclude).area == 0:
        raise StudyError(Problem("leaves no room: it covers the whole boundary", "exclude"))
    key = "boundary" if boundary is not None else "sectors" if sectors else "exclude"
    return Region(sectors, boundary, exclude, margin, key)


@read_once(8)
def read_area(path: Path, key: str, tower: Place = AT_TOWER) -> Any:
    """Read polygons, GeoJSON or WKT, as one prepared geometry relative to a tower. [m]

    Raises StudyError, with this key, if the file contains no valid polygons.
    """
    import shapely

    def wrong(message: str) -> StudyError:
        return StudyError(Problem(f"{path.name} {message}", key))

    try:
        text = table_text(path, path.name)
    except StudyError as error:
        raise wrong(error.problems[0].message) from None
    text = "\n".join(line for line in text.splitlines() if not line.startswith("#")).strip()
    form, read = ("GeoJSON", shapely.from_geojson) if text.startswith("{") else ("WKT", shapely.from_wkt)
    try:
        polygons = np.array([read(text)])
    except shapely.errors.ShapelyError as error:
        said = re.sub(r"^\w+Exception: ", "", str(error)).splitlines()[0][:100]
        raise wrong(f"is no {form}: {said}; give polygons as POLYGON ((0 0, 9 0, 9 9, 0 0))") from None
    for _ in range(_NESTED):
        polygons = shapely.get_parts(polygons)
    polygons = polygons[~(shapely.is_empty(polygons) | shapely.is_missing(polygons))]
    others = {part.geom_type for part in polygons} - {"Polygon"}
    if others or not polygons.size:
        found = f"a {min(others)}" if others else "none"
        raise wrong(f"must contain polygons (got {found}); give a road as the polygon that it covers")
    corners = shapely.get_coordinates(polygons)
    if (np.abs(corners) <= (180.0, 90.0)).all() and np.ptp(corners, axis=0).max() < LEAST_EXTENT:
        raise wrong(_IN_DEGREES)
    polygons = shapely.transform(polygons, lambda places: places - tower)
    for polygon in polygons:
        corners = shapely.get_coordinates(polygon)
        stray = corners[~(np.abs(corners) <= FARTHEST).all(axis=1)]
        if stray.size:
            raise wrong(f"has a corner out of any field: {_IN_METRES} (got {stray[0, 0]:.6g}, {stray[0, 1]:.6g})")
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
    """Read a grid of heights as a bilinear function of (y, x) relative to a tower; NaN outside of the grid. [m]

    Raises StudyError, with the key ``terrain.file``, if the file is neither NetCDF nor GeoTIFF, or no grid over x and
    y.
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
    step_x, step_y = (-1 if side[0] > side[-1] else 1 for side in (x, y))
    x, y, height = x[::step_x], y[::step_y], height[::step_y, ::step_x]
    if not ((np.diff(x) > 0).all() and (np.diff(y) > 0).all()):
        raise wrong("must have x and y that rise or fall all along")
    return RegularGridInterpolator((y - tower[1], x - tower[0]), np.ascontiguousarray(height), bounds_error=False)


def _netcdf(path: Path, wrong: Callable[[str], StudyError]) -> tuple[Floats, Floats, Floats]:
    """Return the positions along x and y, and the heights over (y, x), of a NetCDF file."""
    import xarray as xr

    from heliosweep.netcdf import LIBRARY_LOCK

    try:
        with LIBRARY_LOCK, xr.open_dataset(path, engine="netcdf4", decode_times=False, lock=LIBRARY_LOCK) as data:
            grids = [name for name, one in data.data_vars.items() if set(one.dims) == {"x", "y"}]
            if len(grids) != 1 or not {"x", "y"} <= set(data.coords):
                found = ", ".join(f"{name}({', '.join(map(str, one.dims))})" for name, one in data.data_vars.items())
                raise wrong(f"must hold one variable over x and y, both with coordinates in m (got {found or 'none'})")
            grid = data[grids[0]]
            _check_size(grid.size, wrong)
            for name in ("x", "y", *grids):
                if (unit := str(data[name].attrs.get("units", "m"))) not in _UNITS:
                    raise wrong(f"must have {name} in m (got {unit})")
            x, y, height = (one.to_numpy().astype(float) for one in (grid.x, grid.y, grid.transpose("y", "x")))
    except (OSError, ValueError, TypeError) as error:
        said = getattr(error, "strerror", None) or str(error).splitlines()[0][:100]
        raise wrong(f"is no NetCDF file that can be read: {said}") from None
    return x, y, height


def _check_size(cells: int, wrong: Callable[[str], StudyError]) -> None:
    if cells > MAX_CELLS:
        raise wrong(f"has {cells:,} heights, and {MAX_CELLS:,} are read: cut it to the field, or take a coarser grid")


def _geotiff(path: Path, wrong: Callable[[str], StudyError]) -> tuple[Floats, Floats, Floats]:
    """Return the positions along x and y, and the heights over (y, x), of a GeoTIFF file; NaN for missing heights."""
    try:
        import rasterio
    except ImportError:
        raise wrong("is a GeoTIFF, which needs the package rasterio: pip install 'heliosweep[terrain]'") from None
    try:
        with catch_warnings(action="ignore"), rasterio.open(path) as grid:
            cell, reference = grid.transform, grid.crs
            _check_size(grid.width * grid.height, wrong)
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
    return x, cell.f + (np.arange(height.shape[0]) + 0.5) * cell.e, height


def heights_at(heights: Any, name: str, x: Floats, y: Floats) -> Floats:
    """Heights of the ground at all places above that at the tower, from `read_heights`. [m]

    Raises StudyError, key ``terrain.file``, if a height is missing.
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

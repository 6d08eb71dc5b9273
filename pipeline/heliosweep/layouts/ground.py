"""Ground data for generated fields: areas where heliostats may be placed, and ground heights.

Polygons are read from GeoJSON or WKT files, and grids of heights from NetCDF or GeoTIFF files. Coordinates are in
metres east and north of the tower, or of another origin such as a map origin.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import text_of
from heliosweep.errors import Problem, StudyError
from heliosweep.files import read_once
from heliosweep.kernels.compiled import Floats
from heliosweep.layouts.layout import FARTHEST
from heliosweep.lazy import scipy, shapely, xr

#: Names of the result attributes that contain the polygons, by study key.
AREAS = {"boundary": "layout_boundary", "exclude": "layout_exclude"}

#: Maximum number of heights in a grid.
MAX_CELLS = 25_000_000
TOO_MANY = "has {:,} heights, " + f"more than {MAX_CELLS:,}: crop it to the field, or use a coarser grid"

#: Distances east and north of an origin. [m]
Place = tuple[float, float]

AT_TOWER: Place = (0.0, 0.0)

_UNITS = ("m", "metre", "metres", "meter", "meters")


@dataclass(frozen=True)
class Region:
    """Ground on which heliostats may be placed.

    Parameters
    ----------
    sectors : sequence of (float, float)
        Middle azimuth and width of each sector, seen from the tower. An empty sequence allows all azimuths. [deg]
    boundary, exclude : shapely geometry, optional
        Polygons that contain all heliostats, and polygons that contain none. [m]
    margin : float
        Minimum distance between heliostats and the edges of all polygons. [m]
    """

    sectors: Sequence[tuple[float, float]] = ()
    boundary: Any = None
    exclude: Any = None
    margin: float = 0.0

    def inside(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.bool_]:
        """Return a mask, shape (n,), that is True for positions [m] inside the region and outside its margin."""
        inside = np.full(x.shape, not self.sectors)
        azimuth = np.degrees(np.arctan2(x, y)) if self.sectors else x
        for middle, width in self.sectors:
            inside |= np.abs((azimuth - middle + 180) % 360 - 180) <= width / 2 + 1e-9  # tolerance for rounding
        if self.boundary is not None:
            inside &= shapely.contains_xy(self.boundary, x, y)
        if self.exclude is not None:
            inside &= ~shapely.intersects_xy(self.exclude, x, y)
        for area in filter(None, (self.boundary, self.exclude) if self.margin else ()):
            left = np.flatnonzero(inside)
            shapely.prepare(edge := area.boundary)
            inside[left] = ~shapely.dwithin(edge, shapely.points(x[left], y[left]), self.margin)
        return inside

    @property
    def key(self) -> str:
        """Study key to report if no heliostat fits."""
        return "boundary" if self.boundary is not None else "sectors" if self.sectors else "exclude"

    @property
    def reach(self) -> float:
        """Maximum possible distance of a heliostat from the tower. [m]"""
        if self.boundary is None:
            return FARTHEST
        return float(np.hypot(*shapely.get_coordinates(self.boundary).T).max())

    def no_room(self) -> StudyError:
        """Return the error for a region in which no heliostat fits."""
        hint = ""
        if self.boundary is not None:
            if self.exclude is not None and self.boundary.difference(self.exclude).area == 0:
                return StudyError(Problem("leaves no space: it covers the whole boundary", "exclude"))
            hint = f" {self.margin:g} m from its edge" * bool(self.margin)
            hint += "; its coordinates are in metres from the tower's base, or from 'origin'"
        return StudyError(Problem(f"leaves no space for a heliostat{hint}", self.key))


def _checker(path: Path, key: str) -> Callable[[Any, str], None]:

    def need(good: Any, message: str) -> None:
        if not good:
            raise StudyError(Problem(f"{path.name} {message}", key))

    return need


@read_once(8)
def read_area(path: Path, key: str, tower: Place = AT_TOWER) -> Any:
    """Read polygons from a GeoJSON or WKT file as one prepared geometry.

    The coordinates of the geometry are relative to the tower [m]. Raises a StudyError for `key` if the file contains no
    valid polygons.
    """
    need, text, polygons = _checker(path, key), "", np.empty(0, object)
    try:
        text = re.sub(r"(?m)^#.*$", "", text_of(path, path.name)).strip()
    except StudyError as error:
        need(False, error.problems[0].message)
    form, read = ("GeoJSON", shapely.from_geojson) if text.startswith("{") else ("WKT", shapely.from_wkt)
    try:
        polygons = np.array([read(text)])
    except shapely.errors.ShapelyError as error:
        reason = re.sub(r"^\w+Exception: ", "", str(error)).splitlines()[0][:100]
        need(False, f"cannot be read as {form}: {reason}; give polygons such as POLYGON ((0 0, 9 0, 9 9, 0 0))")
    for _ in range(3):  # flatten nested collections
        polygons = shapely.get_parts(polygons)
    polygons = polygons[~(shapely.is_empty(polygons) | shapely.is_missing(polygons))]
    kinds = sorted({part.geom_type for part in polygons}, key="Polygon".__eq__)
    found = f"a {kinds[0]}" if kinds else "none"
    need(kinds == ["Polygon"], f"must contain polygons (got {found}); describe a road by a polygon around its area")
    corners = shapely.get_coordinates(polygons)
    degrees = (np.abs(corners) <= (180.0, 90.0)).all() and np.ptp(corners, axis=0).max() < 1.0
    advice = "is less than 1 m across: project it to metres, for example to UTM, and give 'origin'"
    need(not degrees, f"is probably in degrees, because it {advice}")
    polygons = shapely.transform(polygons, lambda places: places - tower)
    corners = shapely.get_coordinates(polygons)
    stray = corners[~(np.abs(corners) <= FARTHEST).all(axis=1)]
    got = ", ".join(f"{value:.6g}" for value in stray[:1].ravel())
    rule = f"it must be in metres from the tower's base, at most {FARTHEST:,.0f}; for map coordinates give 'origin'"
    need(not stray.size, f"has a corner beyond any field: {rule} (got {got})")
    for reason in shapely.is_valid_reason(polygons[~shapely.is_valid(polygons)]):
        crossing = re.fullmatch(r"(?:Ring )?Self-intersection\[(\S+) (\S+)\]", reason)
        fault = f"crosses itself at {float(crossing[1]):.6g}, {float(crossing[2]):.6g}" if crossing else reason
        need(False, f"{fault}; list the corners in order along the edge")
    area = shapely.union_all(polygons)
    need(area.area > 0, "leaves no space: its polygons have no area")
    shapely.prepare(area)
    return area


def slope_heights(x: Floats, y: Floats, slope: float, azimuth: float) -> Floats:
    """Return heights above the tower's base [m] on a plane that descends by `slope` [deg] towards `azimuth` [deg]."""
    down = math.radians(azimuth)
    return -math.tan(math.radians(slope)) * (math.sin(down) * x + math.cos(down) * y)


@read_once(4)
def read_heights(path: Path, tower: Place = AT_TOWER) -> Any:
    """Read a grid of heights [m] and return a bilinear interpolation function.

    The function takes (y, x), relative to the tower [m], and returns NaN outside the grid.

    Raises a StudyError for the ``terrain.file`` key if the file is neither NetCDF nor GeoTIFF, or contains no grid over
    x and y.
    """
    need, form = _checker(path, "terrain.file"), "a file"
    try:
        with path.open("rb") as file:
            is_tiff = file.read(4) in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
        form, read = ("GeoTIFF", _geotiff) if is_tiff else ("NetCDF", _netcdf)
        x, y, height = read(path, need)
    except (OSError, ValueError, TypeError) as error:
        reason = getattr(error, "strerror", None) or str(error).splitlines()[0][:100]
        need(False, f"cannot be read as {form}: {reason}")
    need(
        min(x.size, y.size) > 1 and np.isfinite([*x, *y]).all(),
        "must have at least two values along x and y, all finite",
    )
    step_x, step_y = (-1 if side[0] > side[-1] else 1 for side in (x, y))
    x, y, height = x[::step_x], y[::step_y], height[::step_y, ::step_x]
    need((np.diff(x) > 0).all() and (np.diff(y) > 0).all(), "must have monotonic x and y")
    return scipy.interpolate.RegularGridInterpolator(
        (y - tower[1], x - tower[0]), np.ascontiguousarray(height), bounds_error=False
    )


def _netcdf(path: Path, need: Callable[[Any, str], None]) -> tuple[Floats, Floats, Floats]:
    from heliosweep.files import LIBRARY_LOCK

    with LIBRARY_LOCK, xr.open_dataset(path, engine="netcdf4", decode_times=False, lock=LIBRARY_LOCK) as data:
        grids = [name for name, grid in data.data_vars.items() if set(grid.dims) == {"x", "y"}]
        found = ", ".join(f"{name}({', '.join(map(str, grid.dims))})" for name, grid in data.data_vars.items())
        need(
            len(grids) == 1 and {"x", "y"} <= set(data.coords),
            f"must contain one variable over x and y, both with coordinates in m (got {found or 'none'})",
        )
        grid = data[grids[0]].transpose("y", "x")
        need(grid.size <= MAX_CELLS, TOO_MANY.format(grid.size))
        for name in ("x", "y", *grids):
            unit = str(data[name].attrs.get("units", "m"))
            need(unit in _UNITS, f"must have {name} in m (got {unit})")
        return grid.x.to_numpy().astype(float), grid.y.to_numpy().astype(float), grid.to_numpy().astype(float)


def _geotiff(path: Path, need: Callable[[Any, str], None]) -> tuple[Floats, Floats, Floats]:
    try:
        import rasterio
    except ImportError:
        need(False, "is a GeoTIFF, which needs the package rasterio: pip install 'heliosweep[terrain]'")
    with catch_warnings(action="ignore"), rasterio.open(path) as grid:
        cell, crs = grid.transform, grid.crs
        need(grid.width * grid.height <= MAX_CELLS, TOO_MANY.format(grid.width * grid.height))
        placed = grid.count == 1 and not cell.is_identity and cell.is_rectilinear
        need(placed, "must contain one band of heights with map coordinates and north up, as written by gdalwarp")
        need(
            crs is None or not crs.is_geographic,
            "has no map coordinates in m: project it, for example with gdalwarp -t_srs EPSG:32630",
        )
        in_metres = crs is None or not crs.is_projected or crs.linear_units_factor[1] == 1.0
        need(in_metres and (grid.units[0] or "m") in _UNITS, "must have coordinates and heights in m")
        height = grid.read(1, masked=True).astype(float).filled(np.nan)
    x = cell.c + (np.arange(height.shape[1]) + 0.5) * cell.a
    return x, cell.f + (np.arange(height.shape[0]) + 0.5) * cell.e, height


def heights_at(heights: Any, name: str, x: Floats, y: Floats) -> Floats:
    """Return the ground height at each position relative to the ground at the tower. [m]

    `heights` is the function returned by `read_heights`. Raises a StudyError for the ``terrain.file`` key if a height
    is missing.
    """
    found: Floats = heights((y, x)) - heights((0.0, 0.0))
    if (missing := int(np.isnan(found).sum())) > 0:
        sides = zip("xy", reversed(heights.grid), strict=True)
        spans = (f"{axis} from {side[0]:g} to {side[-1]:g} m" for axis, side in sides)
        where = "the tower" if missing == found.size else f"{missing:,} of {found.size:,} heliostats"
        message = f"{name} does not cover the field: it has no heights at {where}, only for {' and '.join(spans)}"
        remedy = "for map coordinates set 'origin', or add a boundary, or use a larger grid"
        raise StudyError(Problem(f"{message}; {remedy}", "terrain.file"))
    return found

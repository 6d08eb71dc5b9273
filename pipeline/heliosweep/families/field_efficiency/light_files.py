"""Optical input files: measured sun shapes, mirror slope maps, and mount errors from a calibration."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import Column, numbers, read_table
from heliosweep.errors import Problem, StudyError, load_extra
from heliosweep.files import read_once, user_path
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.mounts import ERRORS
from heliosweep.layouts.layout import Layout, label_of
from heliosweep.lazy import xr

#: Maximum number of rows in a slope map table.
MAX_POINTS = 1_000_000
#: Maximum absolute slope in a slope map. [mrad]
MOST_SLOPE = 100.0
#: Layout columns with the rotation angles of the heliostat normals. [mrad]
TURN_COLUMNS = ("error_u", "error_v")
_MAP = {
    **{axis: Column(f"position {way} the centre, in m", required=True, least=-100, most=100,
                    bounds="between -100 and 100 m") for axis, way in (("x", "to the right of"), ("y", "above"))},
    **{f"slope_{axis}": Column(f"tilt of the normal {way}, in mrad", required=True, least=-MOST_SLOPE, most=MOST_SLOPE,
                               bounds=f"between {-MOST_SLOPE:g} and {MOST_SLOPE:g} mrad")
       for axis, way in (("x", "to the right"), ("y", "upwards"))},
}  # fmt: skip


class SlopeMap(NamedTuple):
    """Gridded slopes of one or more mirrors, as seen from the target."""

    #: Positions to the right of the centre, in ascending order. [m]
    x: Floats
    #: Positions above the centre, in ascending order. [m]
    y: Floats
    #: Tilts of the normal to the right and upwards, shape (map, y, x, 2); NaN in holes and outside the facet. [rad]
    slope: Floats
    #: Heliostat name or number for each map; empty if one map applies to all heliostats.
    names: tuple[str, ...] = ()
    #: True if slopes are relative to the plane of the mirror and therefore include focus and canting.
    plane: bool = False

    @property
    def known(self) -> NDArray[np.bool_]:
        """True at grid positions with a known slope, shape (map, y, x)."""
        return np.all(np.isfinite(self.slope), axis=-1)

    @property
    def covered(self) -> float:
        """Minimum over all maps of the fraction of grid positions with a known slope. [1]"""
        return float(self.known.mean(axis=(1, 2)).min())

    def numbers(self, layout: Layout) -> NDArray[np.int64]:
        """Return the map index of each heliostat in a layout, matched by name, `id` or number; -1 without a map."""
        return layout.matches(self.names) if self.names else np.zeros(len(layout), np.int64)

    def fits(self, width: float, height: float, facets: Any = None) -> bool:
        """Return True if the map fits a mirror or a facet: its outer points are within one grid step of the edges."""
        sizes = [(width, height)]
        if facets is not None:
            counts = ((width, facets.columns), (height, facets.rows))
            sizes.append(tuple((side + facets.gap) / count - facets.gap for side, count in counts))
        return any(
            all(
                abs(sign * at[end] - side / 2) <= 1.000001 * (at[1] - at[0])
                for at, side in zip((self.x, self.y), size, strict=True)
                for end, sign in ((0, -1), (-1, 1))
            )
            for size in sizes
        )


@read_once(4)
def read_slopes(path: Path, name: str) -> SlopeMap:
    """Read slopes from a CSV table, a NetCDF file, or a PAINT or SOFAST HDF5 file. Raises StudyError."""
    ending = path.suffix.lower()
    if ending in (".h5", ".hdf5"):
        return _slopes_of_dataset(read_slope_map(path, name=name), name)
    if ending != ".nc":
        return _slopes_of_table(path, name)
    with _result(path, name) as result:
        return _slopes_of_dataset(result, name)


def _slopes_of_table(path: Path, name: str) -> SlopeMap:
    table = read_table(path, name, _MAP, rows="places", most_rows=MAX_POINTS)
    x, y = table.column("x"), table.column("y")
    leans = []
    for key in ("slope_x", "slope_y"):
        texts = table.texts(key)
        holes = np.array([text.lower() in ("", "-", "nan", "na", "n/a", "null", "none") for text in texts])
        lean = numbers(texts)
        table.note_bad_numbers(key, texts, np.where(holes, 0.0, lean))
        for row in np.flatnonzero(np.abs(lean) > MOST_SLOPE):
            table.add(f"{key} must be {_MAP[key].bounds} (got {texts[row]})", int(row), key)
        leans.append(np.where(holes, np.nan, lean))
    table.finish()
    (columns, column), (rows, row) = _even(x, "x", name), _even(y, "y", name)
    times = np.bincount(row * len(columns) + column)
    if (times > 1).any():
        raise StudyError(
            Problem(f"contains duplicate positions ({int((times > 1).sum()):,}); list each position once", file=name)
        )
    slope = np.full((len(rows), len(columns), 2), np.nan)
    slope[row, column] = 1e-3 * np.stack(leans, axis=-1)
    return _checked(SlopeMap(columns, rows, slope[np.newaxis]), name)


def _even(at: Floats, axis: str, name: str) -> tuple[Floats, Any]:
    """Return uniform coordinates that include all values of `at`, and the index of each value. Raises StudyError."""
    places = np.unique(np.round(at, 9))
    if len(places) < 2:
        raise StudyError(Problem(f"has one position along {axis}; a slope map needs at least 2", file=name))
    span = places[-1] - places[0]
    count = round(span / np.diff(places).min())
    index = (at - places[0]) * (count / span)
    if count >= MAX_POINTS or np.abs(index - index.round()).max() > 0.01:
        raise StudyError(Problem(f"has uneven steps along {axis}: give positions in equal steps", file=name))
    return np.linspace(places[0], places[-1], count + 1), index.round().astype(int)


def _checked(found: SlopeMap, name: str) -> SlopeMap:
    """Trim empty rows and columns at the edges of the maps. Raises StudyError if too many values are missing."""
    for axis in (0, 1):
        (there,) = np.nonzero(found.known.any(axis=(0, 2 - axis)))
        inside = slice(there[0], there[-1] + 1) if there.size else slice(None)
        y, x = (inside, slice(None)) if axis == 0 else (slice(None), inside)
        found = found._replace(x=found.x[x], y=found.y[y], slope=found.slope[:, y, x])
    if found.covered < 0.5:
        message = f"lacks {100 * (1 - found.covered):.0f} % of the slopes; at most 50 % may be missing"
        raise StudyError(Problem(message, file=name))
    return found


def _slopes_of_dataset(result: xr.Dataset, name: str) -> SlopeMap:
    """Return the slope maps in a dataset with dimensions (z, y) or (y, x), and optionally `heliostat`.

    Raises StudyError.
    """
    maps = [result[name] for name in ("slope_x", "slope_y") if name in result]
    up, right = next((dims for dims in (("z", "y"), ("y", "x")) if all({*dims} <= {*each.dims} for each in maps)),
                     ("", ""))  # fmt: skip
    if len(maps) < 2 or not up:
        message = "has no slope_x and slope_y with dimensions z and y: give a backward_gazing result, simulated with "
        raise StudyError(Problem(f"{message}'output: {{maps: true}}', or maps from heliosweep.grid_slopes", file=name))
    several = "heliostat" in maps[0].dims
    maps = [each if several else each.expand_dims("heliostat") for each in maps]
    slope = 1e-3 * np.stack([_single(each, ("heliostat", up, right), name) for each in maps], axis=-1)
    places = result[right].to_numpy().astype(float), result[up].to_numpy().astype(float)
    x, y = (_even(at, axis, name)[0] for at, axis in zip(places, "xy", strict=True))
    seen = np.isfinite(slope).any(axis=(1, 2, 3)) | (not several)
    labels = result[label_of(result.coords)].to_numpy()[seen] if several else ()
    return _checked(
        SlopeMap(x, y, slope[seen], tuple(map(str, labels)), maps[0].attrs.get("reference") == "plane"), name
    )


def read_slope_map(path: str | os.PathLike[str], *, step: float = 0.05, name: str = "") -> xr.Dataset:
    """Read a measured heliostat surface from a PAINT or SOFAST HDF5 file.

    Parameters
    ----------
    path : path
        PAINT deflectometry file (groups ``facet1``, ``facet2``, ... with `surface_points` and `surface_normals`), or
        OpenCSP SOFAST file for one facet or a facet ensemble (group ``DataSofastCalculation``).
    step : float
        Side length of a map cell. [m]
    name : str
        Name of the file in messages (default: `path`).

    Returns
    -------
    xarray.Dataset
        Slopes as returned by `grid_slopes`, with all facets in one map. Maps from PAINT files have a dimension
        ``heliostat`` of length 1. Its label is the part of the file name before the first hyphen. To use several maps
        in `optics.slope_map`, join them with ``xarray.concat(maps, "heliostat")`` and save the result with
        ``to_netcdf``.

    Raises
    ------
    StudyError
        If the file cannot be read or contains no slopes.

    References
    ----------
    PAINT: doi 10.1038/s41560-026-02070-1. OpenCSP: github.com/sandialabs/OpenCSP, `ProcessSofastFringe`.

    Examples
    --------
    >>> import h5py, heliosweep
    >>> with h5py.File("AA39-deflectometry.h5", "w") as file:
    ...     facet = file.create_group("facet1")
    ...     facet["surface_points"] = [(x, y, 0.0) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    ...     facet["surface_normals"] = [(0.001, 0.0, 1.0)] * 4
    >>> heliosweep.read_slope_map("AA39-deflectometry.h5", step=1.0).slope_x.values.tolist()
    [[[1.0, 1.0], [1.0, 1.0]]]
    """
    from heliosweep.gazing import grid_slopes

    file, name = user_path(path), name or str(path)
    h5py = load_extra("h5py", "h5py", "hdf5")
    try:
        with h5py.File(file, "r") as data:
            paint = [group for key, group in data.items() if key.startswith("facet") and "surface_normals" in group]
            facets = [tuple(group[f"surface_{what}"][:] for what in ("points", "normals")) for group in paint]
            for group in data["DataSofastCalculation/facet"].values() if not paint else ():
                kind = "ensemble" if "CalculationEnsemble" in group else "facet"
                inner = group.get("CalculationEnsemble") or group.get("SlopeSolverData", group)
                slopes = inner["slopes_ensemble_xy" if kind == "ensemble" else "slopes_facet_xy"][:]
                normals = np.stack([-slopes[0], -slopes[1], np.ones(slopes.shape[1])], axis=1)
                facets.append((inner[f"v_surf_points_{kind}"][:].T, normals))
        middles = np.stack([0.5 * (place.min(axis=0) + place.max(axis=0))[:2] for place, _ in facets])
        sides = np.ptp(facets[0][0][:, :2], axis=0)
        if len(facets) > 1 and (np.abs(middles - middles[0]) < 0.5 * sides).all():
            raise ValueError("its facets overlap; positions must be relative to the centre of the mirror")
        points, normals = (np.concatenate(each) for each in zip(*facets, strict=True))
        found: xr.Dataset = grid_slopes(points, normals, step=step)
    except (OSError, KeyError, ValueError) as error:
        message = f"is not a readable PAINT or SOFAST deflectometry file: {error.args[0] if error.args else error}"
        raise StudyError(Problem(message, file=name)) from None
    return found.expand_dims(heliostat=[file.name.partition("-")[0]]) if paint else found


class Calibrated(NamedTuple):
    """Mount errors of a calibrated field."""

    #: Errors in the order of `ERRORS`, shape (heliostats, 6). Errors that were not estimated are 0. [rad]
    errors: Floats
    #: Positions x and y of the heliostats, shape (heliostats, 2). [m]
    place: Floats
    #: Heliostat names from the column `name` or `id` of the calibrated layout; empty if both columns are missing.
    names: tuple[str, ...]
    #: Mount kind.
    mount: str
    file: str

    def of(self, layout: Layout) -> Floats:
        """Return the errors of a layout's heliostats, matched by name or `id`, otherwise by number and position.

        Raises StudyError if a heliostat is missing from the calibration or has no estimate.
        """
        names = layout.columns.get(label_of(layout.columns))
        if self.names and names is not None:
            rows = layout.matches(self.names)
            lost = rows < 0
        else:
            rows = layout.numbers
            lost = rows >= len(self.errors)
            apart = self.place[np.where(lost, 0, rows)] - np.stack((layout.x, layout.y), axis=1)
            lost |= np.hypot(*apart.T) > 0.01  # m
        if lost.any():
            row = int(np.argmax(lost))
            where = layout.where(row) if names is None else f"{layout.where(row)}, {names[row]!s}"
            message = f"has no {where} of {layout.name or 'the layout'} ({int(lost.sum()):,} are missing)"
            raise StudyError(
                Problem(f"{message}: calibrate the same field, or add names to both layouts", file=self.file)
            )
        found = self.errors[rows]
        if (empty := np.isnan(found).any(axis=1)).any():
            message = f"has no estimate for {layout.where(int(np.argmax(empty)))} ({int(empty.sum()):,} have none)"
            raise StudyError(Problem(message, file=self.file))
        return found


@read_once(4)
def read_calibration(path: Path, name: str) -> Calibrated:
    """Read the estimated mount errors from a calibration result. Raises StudyError."""
    with _result(path, name) as result:
        if (found := result.get("estimated_error")) is None:
            raise StudyError(Problem("is not a calibration result: it has no estimated_error", file=name))
        errors = 1e-3 * _single(found, ("heliostat", "parameter"), name)
        known = [ERRORS.index(str(label)) for label in result["parameter"].to_numpy()]
        six = np.zeros((len(errors), len(ERRORS)))
        # An error that was not estimated is NaN for all heliostats. A heliostat without an estimate has NaN for all
        # errors.
        six[:, known] = np.where(np.isnan(errors).all(axis=0), 0.0, errors)
        six[np.isnan(errors).all(axis=1)] = np.nan
        place = np.stack([result[axis].to_numpy().reshape(-1, len(errors))[0] for axis in ("x", "y")], axis=1)
        label = label_of(result.coords)
        names = () if label == "heliostat" else tuple(map(str, result[label].to_numpy()))
        mount = str(result["mount_kind"].to_numpy()) if "mount_kind" in result.coords else ""
    return Calibrated(six, place, names, mount, name)


def _result(path: Path, name: str) -> xr.Dataset:
    from heliosweep.store.folder import is_netcdf, open_result

    try:
        if is_netcdf(path):
            return open_result(path)
        message = "is not a result: give a result.nc file"
    except OSError as error:
        message = f"cannot be read: {error.strerror or error}"
    raise StudyError(Problem(message, file=name))


def _single(array: xr.DataArray, dims: tuple[str, ...], name: str) -> Any:
    """Return the values of an array with dimensions `dims`. Other dimensions must have length 1. Raises StudyError."""
    many = [str(dim) for dim, size in array.sizes.items() if dim not in dims and size > 1]
    if many:
        raise StudyError(Problem(f"has several values of {', '.join(many)}: give a result with one value", file=name))
    array = array.isel({dim: 0 for dim in array.dims if dim not in dims})
    return array.transpose(*dims).to_numpy().astype(float)

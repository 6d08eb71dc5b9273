"""Files on the way of the light: a measured sun, slopes of mirrors, and errors of mounts from a calibration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.tables import Column, numbers, read_table
from heliosweep.errors import Problem, StudyError
from heliosweep.files import read_once
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.mounts import ERRORS
from heliosweep.layouts.layout import Layout

if TYPE_CHECKING:  # they take longer to import than reading a study
    import xarray as xr

#: Maximum number of rows of a map.
MAX_POINTS = 1_000_000
#: Largest slope, of a map and of a layout's column. [mrad]
MOST_SLOPE = 100.0
#: Minimum part of a map that must be known.
MIN_KNOWN = 0.5
#: RMS slope below which a map must be in another unit, such as rad. [mrad]
MIN_RMS = 0.01
#: Distance between a heliostat and the one of its number in a calibration from which they are not the same. [m]
SAME_PLACE = 0.01
#: Columns of a layout that turn the normals of the heliostats, in mrad.
TURN_COLUMNS = ("error_u", "error_v")
#: Cells of a hole, in small letters.
_HOLE = ("", "-", "nan", "na", "n/a", "null", "none")
_MAP = {
    **{axis: Column(f"place {way} of the centre, in m", required=True, least=-100, most=100,
                    bounds="between -100 and 100 m") for axis, way in (("x", "to the right"), ("y", "upwards"))},
    **{f"slope_{axis}": Column(f"lean of the normal {way}, in mrad", required=True, least=-MOST_SLOPE, most=MOST_SLOPE,
                               bounds=f"between {-MOST_SLOPE:g} and {MOST_SLOPE:g} mrad")
       for axis, way in (("x", "to the right"), ("y", "upwards"))},
}  # fmt: skip


class SlopeMap(NamedTuple):
    """Slopes on a grid, seen from the target."""

    #: Places to the right of the centre, rising. [m]
    x: Floats
    #: Places above the centre, rising. [m]
    y: Floats
    #: Slope of the normal to the right and upwards, shape (y, x, 2); NaN for holes, outside of the facet. [rad]
    slope: Floats

    @property
    def known(self) -> NDArray[np.bool_]:
        """True for places that are no hole, shape (y, x)."""
        return np.all(np.isfinite(self.slope), axis=-1)

    @property
    def covered(self) -> float:
        """Part of the rectangle that is no hole. [1]"""
        return float(self.known.mean())

    def fits(self, width: float, height: float) -> bool:
        """True if the map fits a mirror: its points begin at most one step inside or outside each edge."""
        return all(
            abs(sign * at[end] - side / 2) <= 1.000001 * (at[1] - at[0])
            for at, side in ((self.x, width), (self.y, height))
            for end, sign in ((0, -1), (-1, 1))
        )


def facet_side(side: float, count: int, gap: float) -> float:
    """Width or height of a facet, for a number of facets along a side of the mirror. [m]"""
    return (side + gap) / count - gap


@read_once(4)
def read_slopes(path: Path, name: str) -> SlopeMap:
    """Slopes of a mirror or facet from a CSV table, or from a result of backward gazing. Raises StudyError."""
    return _slopes_of_result(path, name) if path.suffix == ".nc" else _slopes_of_table(path, name)


def _slopes_of_table(path: Path, name: str) -> SlopeMap:
    table = read_table(path, name, _MAP, rows="places", most_rows=MAX_POINTS)
    x, y = table.column("x"), table.column("y")
    leans = []
    for key in ("slope_x", "slope_y"):
        texts = table.texts(key)
        holes = np.array([text.lower() in _HOLE for text in texts])
        lean = numbers(texts)
        table.note_bad_numbers(key, texts, np.where(holes, 0.0, lean))
        for row in np.flatnonzero(np.abs(lean) > MOST_SLOPE):
            table.add(f"{key} must be {_MAP[key].bounds} (got {texts[row]})", int(row), key)
        leans.append(np.where(holes, np.nan, lean))
    table.finish()
    (columns, column), (rows, row) = _even(x, "x", name), _even(y, "y", name)
    times = np.bincount(row * len(columns) + column)
    if (times > 1).any():
        raise StudyError(Problem(f"gives {int((times > 1).sum()):,} places twice; give each place once", file=name))
    slope = np.full((len(rows), len(columns), 2), np.nan)
    slope[row, column] = 1e-3 * np.stack(leans, axis=-1)
    return _checked(SlopeMap(columns, rows, slope), name)


def _even(at: Floats, axis: str, name: str) -> tuple[Floats, Any]:
    """Return even coordinates that include all of `at`, and the index of each of these. Raises StudyError."""
    places = np.unique(np.round(at, 9))
    if len(places) < 2:
        raise StudyError(Problem(f"has one place along {axis}; a map of slopes needs 2 at least", file=name))
    span = places[-1] - places[0]
    count = round(span / np.diff(places).min())
    index = (at - places[0]) * (count / span)
    if count >= MAX_POINTS or np.abs(index - index.round()).max() > 0.01:
        raise StudyError(Problem(f"has uneven steps along {axis}: give places in even steps", file=name))
    return np.linspace(places[0], places[-1], count + 1), index.round().astype(int)


def _checked(found: SlopeMap, name: str) -> SlopeMap:
    """Return a map without rows and columns of holes at its edges. Raises StudyError if too little is known."""
    for axis in (0, 1):
        (there,) = np.nonzero(found.known.any(axis=1 - axis))
        inside = slice(there[0], there[-1] + 1) if there.size else slice(None)
        y, x = (inside, slice(None)) if axis == 0 else (slice(None), inside)
        found = SlopeMap(found.x[x], found.y[y], found.slope[y, x])
    if found.covered < MIN_KNOWN:
        message = (
            f"lacks {100 * (1 - found.covered):.0f} % of the slopes; at most {100 * (1 - MIN_KNOWN):g} % may be holes"
        )
        raise StudyError(Problem(message, file=name))
    return found


def _slopes_of_result(path: Path, name: str) -> SlopeMap:
    with _result(path, name) as result:
        maps = [result[name] for name in ("slope_x", "slope_y") if name in result]
        if len(maps) < 2 or any(not {"z", "y"} <= set(found.dims) for found in maps):
            message = "has no maps of slopes: name a result of backward_gazing, of its mode simulated with "
            raise StudyError(Problem(f"{message}'output: {{maps: true}}'", file=name))
        leans = [_single(found, ("z", "y"), name) for found in maps]
        places = result["y"].to_numpy().astype(float), result["z"].to_numpy().astype(float)
    x, y = (_even(at, axis, name)[0] for at, axis in zip(places, "xy", strict=True))
    return _checked(SlopeMap(x, y, 1e-3 * np.stack(leans, axis=-1)), name)


class Calibrated(NamedTuple):
    """Errors of the mounts of a field that was calibrated."""

    #: Shape (heliostats, 6), in the order of `ERRORS`; 0 for errors that were not estimated. [rad]
    errors: Floats
    #: x and y, shape (heliostats, 2). [m]
    place: Floats
    #: Names, where the layout of the calibration has them.
    names: tuple[str, ...]
    #: Kind of the mounts.
    mount: str
    file: str

    def of(self, layout: Layout) -> Floats:
        """Errors of the heliostats of a layout: of those with the same name, or else number and place.

        Raises StudyError where the calibration lacks one, or has no estimate for it.
        """
        rows, names = layout.numbers, layout.columns.get("name")
        if self.names and names is not None:
            at = {name: row for row, name in enumerate(self.names)}
            rows = np.array([at.get(str(name), len(self.names)) for name in names])
        lost = rows >= len(self.errors)
        if not (self.names and names is not None):
            apart = self.place[np.where(lost, 0, rows)] - np.stack((layout.x, layout.y), axis=1)
            lost |= np.hypot(*apart.T) > SAME_PLACE
        if lost.any():
            row = int(np.argmax(lost))
            where = layout.where(row) if names is None else f"{layout.where(row)}, {names[row]!s}"
            message = f"has no {where} of {layout.name or 'the layout'} ({int(lost.sum()):,} are missing)"
            raise StudyError(
                Problem(f"{message}: calibrate the same field, or give both layouts names", file=self.file)
            )
        found = self.errors[rows]
        if (empty := np.isnan(found).any(axis=1)).any():
            message = f"has no estimate for {layout.where(int(np.argmax(empty)))} ({int(empty.sum()):,} have none)"
            raise StudyError(Problem(message, file=self.file))
        return found


@read_once(4)
def read_calibration(path: Path, name: str) -> Calibrated:
    """Estimated errors of a calibration's result. Raises StudyError."""
    with _result(path, name) as result:
        if (found := result.get("estimated_error")) is None:
            raise StudyError(Problem("is no result of a calibration: it has no estimated_error", file=name))
        errors = 1e-3 * _single(found, ("heliostat", "parameter"), name)
        known = [ERRORS.index(str(label)) for label in result["parameter"].to_numpy()]
        six = np.zeros((len(errors), len(ERRORS)))
        # Errors without an estimate are missing for all; a heliostat without an estimate lacks all errors.
        six[:, known] = np.where(np.isnan(errors).all(axis=0), 0.0, errors)
        six[np.isnan(errors).all(axis=1)] = np.nan
        place = np.stack([result[axis].to_numpy().reshape(-1, len(errors))[0] for axis in ("x", "y")], axis=1)
        names = tuple(map(str, result["name"].to_numpy())) if "name" in result.coords else ()
        mount = str(result["mount_kind"].to_numpy()) if "mount_kind" in result.coords else ""
    return Calibrated(six, place, names, mount, name)


def _result(path: Path, name: str) -> xr.Dataset:
    """Open a result in a file. Raises StudyError."""
    from heliosweep.store.read import is_netcdf, open_result

    try:
        if is_netcdf(path):
            return open_result(path)
        message = "is no result: name a file result.nc"
    except OSError as error:
        message = f"cannot be read: {error.strerror or error}"
    raise StudyError(Problem(message, file=name))


def _single(array: xr.DataArray, dims: tuple[str, ...], name: str) -> Any:
    """Values over some dimensions, of which no other is longer than 1. Raises StudyError."""
    many = [str(dim) for dim, size in array.sizes.items() if dim not in dims and size > 1]
    if many:
        raise StudyError(Problem(f"has several values of {', '.join(many)}: name a result of one", file=name))
    array = array.isel({dim: 0 for dim in array.dims if dim not in dims})
    return array.transpose(*dims).to_numpy().astype(float)

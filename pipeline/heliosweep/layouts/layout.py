"""Heliostat layouts: positions in a fixed order, properties of single heliostats, and checks before a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.errors import Problem, listed

#: Maximum number of heliostats of a layout.
MAX_HELIOSTATS = 1_000_000

#: Maximum number of listed problems of one kind; the rest is counted.
MAX_LISTED = 20

#: Distance from the tower beyond which coordinates must be map coordinates or in another unit. [m]
FARTHEST = 100e3

#: Number of nearest heliostats, itself included, with which a heliostat is compared.
NEIGHBOURS = 8
#: Number of heliostats up to which all distances take less time than importing SciPy.
FEW = 500

#: Value of a key of the study that takes the column of the layout.
LAYOUT = "layout"

_POSITION = ("x", "y", "z")


class Property(NamedTuple):
    """A column of a layout with a value for each heliostat, which physics uses."""

    #: Key of the study that gives one value for all heliostats; empty if there is none.
    key: str
    unit: str
    #: Exclusive lower bound, or `least` if the bound itself is allowed.
    above: float
    most: float
    #: True if it has an effect with ``optics`` only.
    optical: bool = True


#: Columns that physics uses, by name.
PROPERTIES = {
    "width": Property("heliostat.width", "m", 0.0, 1000.0, False),
    "height": Property("heliostat.height", "m", 0.0, 1000.0, False),
    "pivot_height": Property("heliostat.pivot_height", "m", -1e-9, 1000.0, False),
    "focal_x": Property("heliostat.focus", "m", 0.0, 1e6),
    "focal_y": Property("heliostat.focus", "m", 0.0, 1e6),
    "reflectivity": Property("optics.reflectivity", "1", -1e-9, 1.0),
    "cleanliness": Property("optics.cleanliness", "1", -1e-9, 1.0),
    "slope_error": Property("optics.slope_error", "mrad", -1e-9, 50.0),
    "aim_x": Property("aim.strategy", "m", -FARTHEST, FARTHEST),
    "aim_y": Property("aim.strategy", "m", -FARTHEST, FARTHEST),
    "aim_z": Property("aim.strategy", "m", -FARTHEST, FARTHEST),
    "error_u": Property("", "mrad", -100.000001, 100.0),
    "error_v": Property("", "mrad", -100.000001, 100.0),
}

#: Columns whose names in a result begin with ``heliostat_``, since keys of the study have their names.
NAMED_BY_HELIOSTAT = ("width", "height", "pivot_height", "reflectivity", "cleanliness", "slope_error")


@dataclass(frozen=True, eq=False)
class Layout:
    """Positions and properties of the heliostats of a field.

    The order is the order of the dimension ``heliostat`` in the result. All arrays are read-only copies.

    Parameters
    ----------
    x, y, z : array_like, shape (heliostat,)
        Base of each heliostat, towards east, north and up, from the base of the tower. [m]
    columns : mapping of str to array, optional
        Properties of each heliostat (`PROPERTIES`) and labels such as its name: float64, int64 or str arrays that
        become coordinates of the result.
    name : str, optional
        Name of the file, as the user gave it, or of the generator.
    lines : array_like of int, shape (heliostat,), optional
        Line of each heliostat in the file, counted from 1; None for a generated layout.
    notes : tuple of str, optional
        Comments that are written before the table of a CSV file.
    numbers : array_like of int, shape (heliostat,), optional
        Row of each heliostat in the full layout that this is a part of (default: 0, 1, ...).
    labels : tuple of str, optional
        Titles of the columns that no number depends on.

    Raises
    ------
    ValueError
        If the arrays differ in length or are not one-dimensional.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]
    columns: Mapping[str, NDArray] = field(default_factory=dict)
    name: str = ""
    lines: NDArray[np.int64] | None = None
    notes: tuple[str, ...] = ()
    numbers: NDArray[np.int64] = None  # type: ignore[assignment]
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Take read-only copies."""
        shape = (np.size(self.x),)
        numbers = np.arange(shape[0]) if self.numbers is None else self.numbers
        arrays = {axis: np.array(getattr(self, axis), np.float64) for axis in _POSITION}
        arrays |= {"numbers": np.array(numbers, np.int64)}
        if self.lines is not None:
            arrays["lines"] = np.array(self.lines, np.int64)
        columns = {key: np.array(values) for key, values in self.columns.items()}
        for key, array in (*arrays.items(), *columns.items()):
            if array.shape != shape:
                raise ValueError(f"{key} has shape {array.shape}, not {shape} as x")
            array.flags.writeable = False
        self.__dict__.update(arrays, columns=columns)

    def __len__(self) -> int:
        """Return the number of heliostats."""
        return self.x.size

    def where(self, row: int) -> str:
        """Return the name of a heliostat in messages: its index, counted from 0, and its line if there is one."""
        return f"heliostat {self.numbers[row]}" + ("" if self.lines is None else f" (line {self.lines[row]})")

    def part(self, rows: NDArray[np.int64]) -> Layout:
        """Return some heliostats as a layout."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        lines = None if self.lines is None else self.lines[rows]
        return Layout(
            self.x[rows], self.y[rows], self.z[rows], columns, self.name, lines, self.notes, self.numbers[rows],
            self.labels,
        )  # fmt: skip

    def values(self, name: str, given: float | str | None = None, otherwise: float = np.nan) -> NDArray[np.float64]:
        """Return a property of each heliostat.

        Parameters
        ----------
        name : str
            Column, one of `PROPERTIES`.
        given : float, optional
            Value of the study for all heliostats; None or ``"layout"`` takes the column.
        otherwise : float
            Value if neither is there.

        Returns
        -------
        ndarray, shape (heliostat,)
        """
        if given is None or given == LAYOUT:
            column = self.columns.get(name)
            return np.full(len(self), otherwise) if column is None else column.astype(np.float64)
        return np.full(len(self), float(given))

    def focal_lengths(self, focus: float | str | None, slant: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the focal lengths of each mirror along its width and height, infinite for a flat one.

        Parameters
        ----------
        focus : float or str, optional
            ``heliostat.focus`` of the study: a length [m], ``"flat"``, ``"slant"``, or ``"layout"`` (or None) for the
            columns ``focal_x`` and ``focal_y``, flat if there are none.
        slant : ndarray, shape (heliostat,)
            Slant range of each heliostat. [m]

        Returns
        -------
        ndarray, shape (heliostat, 2)
            [m]
        """
        words = {"flat": np.full(len(self), np.inf), "slant": slant}
        if focus in words:
            return np.stack([words[str(focus)]] * 2, axis=1)
        return np.stack([self.values(name, focus, np.inf) for name in ("focal_x", "focal_y")], axis=1)


def check_property(layout: Layout, name: str) -> list[Problem]:
    """Return a problem for each heliostat with an unusable value of a property, such as a missing one."""
    if name not in layout.columns:
        return [Problem(f"has no column {name}", file=layout.name)]
    bounds, values = PROPERTIES[name], layout.columns[name]
    good = np.zeros(len(layout), bool)
    if values.dtype.kind in "if":
        good = (values > bounds.above) & (values <= bounds.most)
    unit = "" if bounds.unit == "1" else f" {bounds.unit}"
    low = f"greater than {bounds.above:g}" if bounds.above == 0 else f"at least {round(bounds.above):g}"
    rows = np.flatnonzero(~good)
    return _listed(
        layout, rows, (f"needs {name} {low} and at most {bounds.most:g}{unit} (got {values[row]})" for row in rows)
    )


def too_close(x: ArrayLike, y: ArrayLike, z: ArrayLike, limit: ArrayLike) -> list[tuple[int, int, float]]:
    """Find the heliostats that are closer to another one than a limit.

    Parameters
    ----------
    x, y, z : array_like, shape (heliostat,)
        Finite positions. [m]
    limit : array_like, shape (heliostat,) or scalar
        Distance between centres below which a pair is too close; of unequal heliostats the mean of both. [m]

    Returns
    -------
    list of (int, int, float)
        Rows of each pair, the lower first, and their distance [m]; the closest pair first. Each heliostat is compared
        with its 7 nearest neighbours.
    """
    points = np.column_stack([np.asarray(axis, float) for axis in (x, y, z)])
    if len(points) < 2:
        return []
    limits = np.broadcast_to(np.asarray(limit, float), len(points))
    nearest = min(NEIGHBOURS, len(points))
    if len(points) <= FEW:
        apart = np.linalg.norm(points[:, np.newaxis] - points, axis=2)
        other = np.argsort(apart, axis=1)[:, :nearest]
        distance = np.take_along_axis(apart, other, axis=1)
    else:
        from scipy.spatial import cKDTree

        distance, other = cKDTree(points).query(points, k=nearest)
    row = np.broadcast_to(np.arange(len(points))[:, np.newaxis], other.shape)
    close = (row != other) & (distance < (limits[row] + limits[other]) / 2)
    pairs, gaps = np.sort(np.stack([row[close], other[close]], axis=1), axis=1).tolist(), distance[close].tolist()
    unique = {(low, high): gap for (low, high), gap in zip(pairs, gaps, strict=True)}
    return [(low, high, gap) for gap, low, high in sorted((gap, *pair) for pair, gap in unique.items())]


def check_layout(layout: Layout, width: ArrayLike, height: ArrayLike) -> tuple[list[Problem], list[Problem]]:
    """Check that the heliostats of a layout have space to rotate.

    Parameters
    ----------
    layout : Layout
    width, height : array_like, shape (heliostat,) or scalar
        Sides of the mirrors; of a sweep, the maximum. [m]

    Returns
    -------
    problems : list of Problem
        No heliostats, coordinates that are not numbers or beyond any field, two heliostats at one position, centres
        closer than the shorter side of the mirrors.
    warnings : list of Problem
        One if centres are closer than the diagonal: only then can two mirrors that rotate freely touch. Postures of a
        study are not followed.
    """
    if not len(layout):
        return [Problem("the layout has no heliostats", file=layout.name)], []
    points = np.column_stack([layout.x, layout.y, layout.z])
    stray = np.flatnonzero(~(np.abs(points) <= FARTHEST).all(axis=1))
    if stray.size:
        rule = (
            f"x, y and z must be metres from the base of the tower, at most {FARTHEST:,.0f}; for map coordinates set "
            "'layout.origin: [east, north]' of the tower"
        )
        places = (", ".join(f"{value:.6g}" for value in points[row]) for row in stray)
        return _listed(layout, stray, (f"is out of any field: {rule} (got {place})" for place in places)), []

    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    original = first[inverse.ravel()]
    distinct, repeated = np.unique(first), np.flatnonzero(original != np.arange(len(layout)))
    problems = _listed(layout, repeated, (f"has the position of {layout.where(original[row])}" for row in repeated))
    sides = np.sort(np.broadcast_to(np.stack(np.broadcast_arrays(width, height)).T, (len(layout), 2)), axis=1)
    diagonal, (x, y, z) = np.hypot(*sides.T), points[distinct].T
    tight = [(int(distinct[low]), int(distinct[high]), apart)
             for low, high, apart in too_close(x, y, z, diagonal[distinct])]  # fmt: skip
    least = [sides[[low, high], 0].mean() for low, high, _ in tight]
    colliding = [pair for pair, side in zip(tight, least, strict=True) if pair[2] < side]
    touching = [pair for pair, side in zip(tight, least, strict=True) if pair[2] >= side]
    problems += _listed(
        layout,
        [high for _, high, _ in colliding],
        (
            f"is {apart:.6g} m from {layout.where(low)}, less than the shorter side of the mirrors, "
            f"{sides[[low, high], 0].mean():.6g} m: they collide"
            for low, high, apart in colliding
        ),
    )
    if not touching:
        return problems, []
    low, high, apart = touching[0]
    number = "1 pair of neighbours is" if len(touching) == 1 else f"{len(touching):,} pairs of neighbours are"
    message = (
        f"{number} closer than the diagonal of the mirrors, which can touch; the postures of this study are not "
        "checked, and numbers are computed as if mirrors could pass through each other; the closest are "
        f"{layout.where(low)} and {layout.where(high)}, {apart:.6g} m apart, with a diagonal of "
        f"{diagonal[[low, high]].mean():.6g} m"
    )
    longer = sides[[low, high], 1].mean()
    message += f" and a longer side of {longer:.6g} m: with these sides in line they always overlap" * bool(
        apart < longer
    )
    return problems, [Problem(message, file=layout.name)]


def _listed(layout: Layout, rows: Sequence[int] | NDArray[np.int64], messages: Iterable[str]) -> list[Problem]:
    """Return a problem for each of the first rows, and one that counts the rest."""
    problems = (
        Problem(f"heliostat {row} {message}", "", layout.name, None if layout.lines is None else int(layout.lines[row]))
        for row, message in zip(rows, messages, strict=True)
    )
    return listed(problems, MAX_LISTED, len(rows), "more of this kind")

"""Heliostat layouts: positions and properties of an ordered list of heliostats, and the checks made before a run.

A CSV table contains one row per heliostat. Tables from SolarPILOT, OpenCSP and solsticepy can also be read. The
header is the first line with titles for ``x`` and ``y`` (``Pos-x``, ``X Position (m)``, ...). Lines before the header,
such as the parameters in SolarPILOT's exports, are ignored. Lengths are converted to metres if the titles, or a row of
units below the header (solsticepy), specify another unit.

A table without a header is read as SolarPILOT's user-defined layout (`SolarField::parseHeliostatXYZFile` in NREL's
ssc). The columns of a table without a header are template, x, y, z [m], two focal lengths [m], a canting vector and an
aim point [m]. The columns after z may be ``NULL``. In SolarPILOT, z is the height of the mirror's centre above the
centre of a mirror at the tower's foot. If all pivots are equally high, SolarPILOT's z equals z in this package: the
height of the heliostat's base above the tower's base.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.config import (
    HEADER,
    MAX_LISTED,
    UNITS,
    Table,
    factor,
    numbers,
    separator_of,
    split_title,
    table_lines,
    text_of,
    variable_name,
)
from heliosweep.errors import Problem, StudyError, listed, printable
from heliosweep.files import write_rows
from heliosweep.lazy import scipy

#: Maximum number of heliostats in a layout.
MAX_HELIOSTATS = 1_000_000
#: Distance from the tower beyond which coordinates are probably map coordinates, or not in metres. [m]
FARTHEST = 100e3
#: Maximum number of heliostats for which computing all pairwise distances is faster than importing SciPy.
FEW = 500
#: Value of a study key that selects the corresponding layout column.
LAYOUT = "layout"
_POSITION = ("x", "y", "z")


class Property(NamedTuple):
    """Layout column that affects results, with a value for each heliostat."""

    #: Study key with one value for all heliostats; empty if there is none.
    key: str
    unit: str
    #: Exclusive lower bound; slightly negative if 0 is allowed.
    above: float
    most: float
    #: True if the column is used only with an ``optics`` block in the study.
    optical: bool = True


#: Layout columns that affect results, by name.
PROPERTIES = {
    "width": Property("heliostat.width", "m", 0.0, 1000.0, False),
    "height": Property("heliostat.height", "m", 0.0, 1000.0, False),
    "pivot_height": Property("heliostat.pivot_height", "m", -1e-9, 1000.0, False),
    "focal_x": Property("heliostat.focus", "m", 0.0, 1e6),
    "focal_y": Property("heliostat.focus", "m", 0.0, 1e6),
    "reflectivity": Property("optics.reflectivity", "1", -1e-9, 1.0),
    "cleanliness": Property("optics.cleanliness", "1", -1e-9, 1.0),
    "availability": Property("availability.fraction", "1", -1e-9, 1.0, False),
    "slope_error": Property("optics.slope_error", "mrad", -1e-9, 50.0),
    "aim_x": Property("aim.strategy", "m", -FARTHEST, FARTHEST),
    "aim_y": Property("aim.strategy", "m", -FARTHEST, FARTHEST),
    "aim_z": Property("aim.strategy", "m", -FARTHEST, FARTHEST),
    "error_u": Property("", "mrad", -100.000001, 100.0),
    "error_v": Property("", "mrad", -100.000001, 100.0),
}
#: Columns that are prefixed with ``heliostat_`` in a result, because study keys use the short names.
NAMED_BY_HELIOSTAT = ("width", "height", "pivot_height", "reflectivity", "cleanliness", "slope_error", "availability")


@dataclass(frozen=True, eq=False)
class Layout:
    """Positions and properties of the heliostats of a field.

    The heliostats have the same order as the ``heliostat`` dimension of the result. All arrays are read-only copies.

    Parameters
    ----------
    x, y, z : array_like, shape (heliostat,)
        Position of each heliostat's base east, north and up from the base of the tower. [m]
    columns : mapping of str to array, optional
        Properties (`PROPERTIES`) and labels of each heliostat, such as its name, as float64, int64 or str arrays. The
        columns become coordinates of the result.
    name : str, optional
        Name of the file as given by the user, or name of the generator.
    lines : array_like of int, shape (heliostat,), optional
        Line number of each heliostat in the file, counted from 1; None for a generated layout.
    notes : tuple of str, optional
        Comments that precede the table in a CSV file.
    numbers : array_like of int, shape (heliostat,), optional
        Row of each heliostat in the full layout, if only a part of the layout is selected (default: 0, 1, ...).
    labels : tuple of str, optional
        Titles of the columns that do not affect results.

    Raises
    ------
    ValueError
        If the arrays have different lengths or are not one-dimensional.
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
        return self.x.size

    def matches(self, labels: Sequence[str]) -> NDArray[np.int64]:
        """Return the index of each heliostat in `labels`, shape (heliostat,), or -1 for unlisted heliostats.

        A label is a value in the ``name`` column, or in ``id`` if there are no names. Any other label is a heliostat
        number.
        """
        column = self.columns.get(label_of(self.columns), np.full(len(self), ""))
        names, index = [*map(str, column)], {label: at for at, label in enumerate(labels)}
        numbers = {label: index[label] for label in index.keys() - names}
        pairs = zip(names, map(str, self.numbers), strict=True)
        return np.array([index.get(name, numbers.get(number, -1)) for name, number in pairs], np.int64)

    def where(self, row: int) -> str:
        """Return the name of a heliostat for messages: its index, counted from 0, and its line if known."""
        return f"heliostat {self.numbers[row]}" + ("" if self.lines is None else f" (line {self.lines[row]})")

    def part(self, rows: NDArray[np.int64]) -> Layout:
        """Return a layout with only the heliostats in the given rows."""
        arrays: dict[str, Any] = {name: getattr(self, name)[rows] for name in (*_POSITION, "numbers")}
        columns = {name: values[rows] for name, values in self.columns.items()}
        return replace(self, columns=columns, lines=None if self.lines is None else self.lines[rows], **arrays)

    def values(self, name: str, given: float | str | None = None, otherwise: float = np.nan) -> NDArray[np.float64]:
        """Return the values of a property, one for each heliostat.

        Parameters
        ----------
        name : str
            Name of a column in `PROPERTIES`.
        given : float, optional
            Value in the study for all heliostats; None or ``"layout"`` selects the column.
        otherwise : float
            Value used if there is neither a value in the study nor a column.

        Returns
        -------
        ndarray, shape (heliostat,)
        """
        if given is None or given == LAYOUT:
            column = self.columns.get(name)
            return np.full(len(self), otherwise) if column is None else column.astype(np.float64)
        return np.full(len(self), float(given))

    def focal_lengths(self, focus: float | str | None, slant: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the focal lengths of each mirror along its width and height; infinite for flat mirrors.

        Parameters
        ----------
        focus : float or str, optional
            ``heliostat.focus`` of the study: a length [m], ``"flat"``, ``"slant"``, or ``"layout"`` (or None) for the
            columns ``focal_x`` and ``focal_y``. Without these columns, mirrors are flat.
        slant : ndarray, shape (heliostat,)
            Slant range of each heliostat. [m]

        Returns
        -------
        ndarray, shape (heliostat, 2)
            Focal lengths. [m]
        """
        given = {"flat": np.inf, "slant": None}.get(str(focus), focus)
        lengths = [slant if focus == "slant" else self.values(name, given, np.inf) for name in ("focal_x", "focal_y")]
        return np.stack(lengths, axis=1)


def label_of(columns: Container[Any]) -> str:
    """Return the name of the column or coordinate that labels the heliostats: ``name``, otherwise ``id``."""
    return next((key for key in ("name", "id") if key in columns), "heliostat")


def check_property(layout: Layout, name: str) -> list[Problem]:
    """Return a problem for each heliostat whose value of a property is missing or invalid."""
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
    """Find pairs of heliostats that are closer together than a limit.

    Parameters
    ----------
    x, y, z : array_like, shape (heliostat,)
        Finite positions. [m]
    limit : array_like, shape (heliostat,) or scalar
        Minimum distance between centres. For two heliostats with different limits, the mean of the limits is used. [m]

    Returns
    -------
    list of (int, int, float)
        Rows of each pair (lower row first) and distance between the two heliostats [m], sorted by distance. Each
        heliostat is compared only with its 7 nearest neighbours.
    """
    points = np.column_stack([np.asarray(axis, float) for axis in (x, y, z)])
    if len(points) < 2:
        return []
    limits = np.broadcast_to(np.asarray(limit, float), len(points))
    nearest = min(8, len(points))  # including the heliostat itself
    if len(points) <= FEW:
        apart = np.linalg.norm(points[:, np.newaxis] - points, axis=2)
        other = np.argsort(apart, axis=1)[:, :nearest]
        distance = np.take_along_axis(apart, other, axis=1)
    else:
        distance, other = scipy.spatial.cKDTree(points).query(points, k=nearest)
    row = np.broadcast_to(np.arange(len(points))[:, np.newaxis], other.shape)
    close = (row != other) & (distance < (limits[row] + limits[other]) / 2)
    pairs = zip(distance[close].tolist(), row[close].tolist(), other[close].tolist(), strict=True)
    return [(low, high, gap) for gap, low, high in sorted({(gap, *sorted(pair)) for gap, *pair in pairs})]


def check_layout(layout: Layout, width: ArrayLike, height: ArrayLike) -> tuple[list[Problem], list[Problem]]:
    """Check that the heliostats of a layout have enough space to rotate.

    Parameters
    ----------
    layout : Layout
    width, height : array_like, shape (heliostat,) or scalar
        Mirror width and height. If the sizes are swept, give the maximum values. [m]

    Returns
    -------
    problems : list of Problem
        Problems of a layout that is empty, has invalid coordinates (infinite, NaN or unrealistically large), or has
        heliostats with equal positions or with centres closer together than the shorter side of the mirrors.
    warnings : list of Problem
        One warning if centres are closer together than the diagonal of the mirrors, because two freely rotating mirrors
        could touch. The check does not consider the actual orientations in a study.
    """
    if not len(layout):
        return [Problem("the layout has no heliostats", file=layout.name)], []
    points = np.column_stack([layout.x, layout.y, layout.z])
    stray = np.flatnonzero(~(np.abs(points) <= FARTHEST).all(axis=1))
    if stray.size:
        rule = (
            f"x, y and z must be in metres from the base of the tower, at most {FARTHEST:,.0f}; for map coordinates "
            "set 'layout.origin: [east, north]' of the tower"
        )
        places = (", ".join(f"{value:.6g}" for value in points[row]) for row in stray)
        return _listed(layout, stray, (f"is beyond any field: {rule} (got {place})" for place in places)), []

    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    original = first[inverse.ravel()]
    distinct, repeated = np.unique(first), np.flatnonzero(original != np.arange(len(layout)))
    problems = _listed(layout, repeated, (f"has the position of {layout.where(original[row])}" for row in repeated))
    sides = np.sort(np.broadcast_to(np.stack(np.broadcast_arrays(width, height)).T, (len(layout), 2)), axis=1)
    diagonal, (x, y, z) = np.hypot(*sides.T), points[distinct].T
    tight = [(*distinct[[low, high]].tolist(), apart, sides[distinct[[low, high]], 0].mean())
             for low, high, apart in too_close(x, y, z, diagonal[distinct])]  # fmt: skip
    colliding = [
        (high, f"{apart:.6g} m from {layout.where(low)}, less than the shorter side of the mirrors, {side:.6g} m")
        for low, high, apart, side in tight
        if apart < side
    ]
    problems += _listed(layout, [row for row, _ in colliding], (f"is {text}: they collide" for _, text in colliding))
    touching = [(low, high, apart) for low, high, apart, side in tight if apart >= side]
    if not touching:
        return problems, []
    low, high, apart = touching[0]
    number = "1 pair of neighbours is" if len(touching) == 1 else f"{len(touching):,} pairs of neighbours are"
    message = (
        f"{number} closer than the diagonal of the mirrors and can touch; the orientations in this study are not "
        "checked, and results are computed as if mirrors could pass through each other; the closest are "
        f"{layout.where(low)} and {layout.where(high)}, {apart:.6g} m apart, with a diagonal of "
        f"{diagonal[[low, high]].mean():.6g} m"
    )
    longer = sides[[low, high], 1].mean()
    overlap = f" and a longer side of {longer:.6g} m: if these sides are in line, the mirrors always overlap"
    return problems, [Problem(message + overlap * bool(apart < longer), file=layout.name)]


def _listed(layout: Layout, rows: Sequence[int] | NDArray[np.int64], messages: Iterable[str]) -> list[Problem]:
    """Return a problem for each listed row, and one problem that states the number of unlisted invalid rows."""
    problems = (
        Problem(f"heliostat {row} {message}", "", layout.name, None if layout.lines is None else int(layout.lines[row]))
        for row, message in zip(rows, messages, strict=True)
    )
    return listed(problems, MAX_LISTED, len(rows), "more problems of this kind")


#: Columns of SolarPILOT's user-defined layout. Each group after the fourth column is either complete or absent.
SOLARPILOT_COLUMNS = (
    *("template", "x", "y", "z"),
    *("focal_x", "focal_y"),
    *("cant_i", "cant_j", "cant_k"),
    *("aim_x", "aim_y", "aim_z"),
)
#: Titles of a column that contains one focal length for both directions.
_BOTH = ("foc", "focus", "focallength")
#: Column names for each title, written without spaces and punctuation.
#: SolarPILOT uses the titles ``Loc. X`` in layouts, ``Pos-x`` in exports and ``x_location`` in the Python interface.
_TITLES = {
    **{name.replace("_", ""): name for name in (*PROPERTIES, *SOLARPILOT_COLUMNS)},
    **dict.fromkeys(("templateid", "heliotemplateid"), "template"),
    **{f"{title}{axis}": axis for title in ("loc", "location", "pos", "position") for axis in "xyz"},
    **{f"{axis}{title}": axis for title in ("location", "position", "coordinate") for axis in "xyz"},
    **{f"{title}{axis}": f"focal_{axis}" for title in ("foc", "focallength") for axis in "xy"},
    **{f"{axis}focallength": f"focal_{axis}" for axis in "xy"},
    **dict.fromkeys(_BOTH, "focal_x"),
    **dict.fromkeys(("east", "easting", "xm", "xcoord", "ost", "osten", "este", "est"), "x"),
    **dict.fromkeys(("north", "northing", "ym", "ycoord", "nord", "norden", "norte"), "y"),
    **{f"cant{axis}": f"cant_{vector}" for axis, vector in zip("xyz", "ijk", strict=True)},
    **dict.fromkeys(("id", "heliostatid"), "id"),
}


def read_csv(path: str | Path, reserved: Collection[str] = (), name: str | None = None) -> Layout:
    """Read a layout from a CSV file.

    Parameters
    ----------
    path : path
        File with the columns ``x`` and ``y``, which contain the distances east and north of the tower's base [m]. The
        optional columns are the height ``z`` [m] (default: 0), the heliostat properties in
        `heliosweep.layouts.layout.PROPERTIES`, and labels. The docstring of this module describes other supported
        tables. Empty lines and lines that start with ``#`` are skipped.
    reserved : collection of str
        Reserved names in the result. Labels with these names are prefixed with ``layout_``.
    name : str, optional
        Name of the file in messages (default: `path`).

    Returns
    -------
    Layout
        Layout with the heliostats in the order of the file. Titles of label columns are converted to
        names (``Num. Facets`` becomes ``num_facets``).

    Raises
    ------
    StudyError
        If the file cannot be read or contains no valid table. The message lists all invalid rows with file, line and
        column.
    """
    name = str(path) if name is None else name
    return read_text(text_of(Path(path), name), name, reserved)


def read_text(text: str, name: str, reserved: Collection[str] = ()) -> Layout:
    """Read a layout from the text of a CSV file, like `read_csv`."""
    lines, texts = table_lines(text)
    if not re.search(r"[,;\t]", "".join(texts)):  # the file was written by numpy.savetxt
        texts = [",".join(line.split()) for line in texts]
    header = next((row for row, line in enumerate(texts[:1000]) if _is_header(line)), 0)
    separator = separator_of("".join(texts[header : header + 1]))
    if texts and not _is_header(texts[header]):
        first = ",".join(re.split(r"[\s,;]+", text.lstrip()[1:].partition("\n")[0]))
        if text.lstrip().startswith("#") and _is_header(first):  # a header of numpy.savetxt
            return read_text(text.replace("#", "", 1), name, reserved)
        lines, texts = _with_header(lines, texts, separator)
    lines, texts = lines[header:], texts[header:]
    units = [cell.strip(" ()[]") for cell in "".join(texts[1:2]).split(separator)]
    if UNITS.keys().isdisjoint(units) or "1" in units or not all(unit in ("", "-") or unit in UNITS for unit in units):
        units = []
    del lines[1 : 1 + bool(units)], texts[1 : 1 + bool(units)]
    needs = "a header with the columns x and y, and one row for each heliostat"
    table = Table(name, (lines, texts), rows="heliostats", most_rows=MAX_HELIOSTATS, needs=needs, separator=separator)
    return _layout_of(table, units, reserved)


def _with_header(lines: list[int], texts: list[str], separator: str) -> tuple[list[int], list[str]]:
    """Add a header to a SolarPILOT user-defined layout, and pad short rows with ``NULL``.

    Lines of any other table are returned unchanged.
    """
    rows = [line.rstrip(f" {separator}").split(separator) for line in texts]
    if len(rows[0]) < 4 or not rows[0][0].strip().isdecimal() or not np.isfinite(numbers(rows[0][1:4])).all():
        return lines, texts
    width = max(map(len, rows))
    header = [*SOLARPILOT_COLUMNS, *(f"column_{place}" for place in range(len(SOLARPILOT_COLUMNS), width))][:width]
    filled = [row + ["NULL"] * (width - len(row)) if len(row) >= 4 else row for row in rows]
    return [lines[0], *lines], [separator.join(row) for row in (header, *filled)]


def _columns_of(table: Table, units: Sequence[str], reserved: Collection[str]) -> tuple[list[str], dict[str, float]]:
    """Return the names of the columns, and the factors that convert columns in other units."""
    keys, scales, lengths = list[str](), dict[str, float](), dict.fromkeys(_POSITION, "m")
    wanted = {name: one.unit for name, one in PROPERTIES.items()} | lengths
    # Positions in OpenCSP's tables, which have the column pivot_offset, are pivot positions.
    pivots = "pivot_offset" in map(variable_name, table.header)
    for place, title in enumerate(table.header):
        name, unit = split_title(title)
        key, unit = _TITLES.get(_letters(name), ""), "".join(units[place : place + 1]) or unit
        if not key or (key in keys and key not in _POSITION) or (pivots and key == "pivot_height"):
            key = variable_name(title)
            key = key if key[:1].isalpha() else f"column_{key or place + 1}"
            key = f"layout_{key}" if key in {*reserved, *PROPERTIES, *keys} else key
        if key in keys:
            table.add(f"has two columns {key!r}; remove one", HEADER, place)
        keys.append(key)
        if key in wanted and unit not in ("", "-", wanted[key]):
            try:
                scales[key] = factor(unit, wanted[key])
            except ValueError:
                table.add(f"is in {unit!r}; {key} must be in {wanted[key]}", HEADER, place)
    return keys, scales


def _layout_of(table: Table, units: Sequence[str], reserved: Collection[str]) -> Layout:
    keys, scales = _columns_of(table, units, reserved)
    for key, direction in (("x", "east"), ("y", "north")):
        if key not in keys:
            there = printable(", ".join(table.header))[:200]
            table.add(
                f"needs a column {key} with the distance {direction} of the tower's base in m (got {there})", HEADER
            )
    title = dict(zip(keys, table.header, strict=True)).get("focal_x", "")
    both = _letters(split_title(title)[0]) in _BOTH
    table.header = keys
    table.check_rows()
    columns: dict[str, NDArray] = {}
    for key in keys:
        texts = table.texts(key)
        values = numbers(texts) if key in _POSITION else _typed(texts)
        if values is not None:
            if key in _POSITION:
                table.note_bad_numbers(key, texts, values)
            columns[key] = values * scales.get(key, 1) if values.dtype.kind in "if" else values
    table.finish()
    if both and "focal_x" in columns:
        columns.setdefault("focal_y", columns["focal_x"])
    if "template" in columns and (columns["template"] == columns["template"][0]).all():
        del columns["template"]
    x, y, z = columns.pop("x"), columns.pop("y"), columns.pop("z", np.zeros(len(table)))
    identity = ("id", "name", "template", "ring", "azimuth", "turn", "row", "canting_distance", "target")
    unused = columns.keys() - {*PROPERTIES, *identity}
    return Layout(x, y, z, columns, table.name, table.lines, labels=tuple(filter(unused.__contains__, columns)))


def _typed(texts: list[str]) -> NDArray | None:
    """Return a column as int64, float64 (NaN for gaps) or strings; None if the column is empty or ``NULL``."""
    if set(texts) <= {"", "NULL"}:
        return None
    values, words = numbers(texts), np.array([text[:100] for text in texts], str)
    known = np.isfinite(values)
    gaps = {"", "-", "na", "n/a", "nan", "null", "none", "inf", "infinity", "-inf"}
    coded = re.search(r"(^|,)\s*[+-]?0[0-9]", ",".join(texts))  # values with leading zeros, such as 007, are names
    if not known.any() or not {text.lower() for text in words[~known]} <= gaps or coded:
        return words
    if not known.all() or not re.fullmatch(r"[0-9+\-\s]*", "".join(texts)):
        return np.where(known, values, np.nan)
    integers = np.array(list(map(int, texts)))
    return integers if integers.dtype == np.int64 else words  # longer integers would lose digits as floats


def _is_header(line: str) -> bool:
    names = (split_title(title.strip())[0] for title in line.split(separator_of(line)))
    return {"x", "y"} <= {_TITLES.get(_letters(name)) for name in names}


def _letters(title: str) -> str:
    return re.sub(r"[^a-z0-9]", "", title.lower())


def write_csv(layout: Layout, path: str | Path) -> None:
    """Write a layout to a CSV file from which `read_csv` restores identical numbers. An existing file is replaced.

    The file appears under the given name only when it is complete. The layout's notes are written as comments before
    the table. Text that looks like a number will be read as a number. Raises HeliosweepError if the file cannot be
    written; partial files are removed.
    """
    columns = {"x": layout.x, "y": layout.y, "z": layout.z, **layout.columns}
    rows = zip(*(_cells(values, "") for values in columns.values()), strict=True)
    write_rows(itertools.chain([columns], rows), Path(path), layout.notes)


def write_solarpilot(layout: Layout, path: str | Path) -> None:
    """Write SolarPILOT's user-defined layout, from which `read_csv` restores identical numbers.

    The table contains positions and the `SOLARPILOT_COLUMNS` of the layout; other columns are omitted. Heliostats with
    equal mirror sizes have equal templates. An existing file is replaced when the new file is complete. Raises
    StudyError if one of the `SOLARPILOT_COLUMNS` contains text, and HeliosweepError if the file cannot be written.
    """
    given = {key: values for key, values in layout.columns.items() if key in SOLARPILOT_COLUMNS}
    for key, values in given.items():
        if values.dtype.kind not in ("i" if key == "template" else "if"):
            message = (
                f"{key} must contain {'integers' if key == 'template' else 'numbers'} for SolarPILOT: rename the column"
            )
            raise StudyError(Problem(message, file=layout.name))
    sides = np.stack([layout.values(side, None, 0.0) for side in ("width", "height")], axis=1)
    order = {size: number for number, size in enumerate(dict.fromkeys(map(tuple, sides.tolist())))}
    template = np.array([order[size] for size in map(tuple, sides.tolist())], int)
    last = max(map(SOLARPILOT_COLUMNS.index, given), default=0)
    blank = dict.fromkeys(SOLARPILOT_COLUMNS[: next(end for end in (4, 6, 9, 12) if last < end)], sides[:, 0] * np.nan)
    columns = {**blank, "template": template, "x": layout.x, "y": layout.y, "z": layout.z}
    write_rows(zip(*(_cells(values, "NULL") for values in (columns | given).values()), strict=True), Path(path))


def _cells(values: NDArray, gap: str) -> list[Any]:
    return [gap if isinstance(value, float) and np.isnan(value) else value for value in values.tolist()]

"""Layouts as CSV tables, a row for each heliostat: own tables and tables of SolarPILOT, OpenCSP and solsticepy.

The header is the first line that names columns ``x`` and ``y`` (``Pos-x``, ``X Position (m)``, ...); lines before it,
such as the parameters of SolarPILOT's exports, are not read. Lengths in other units than metres are converted. A row of
units below the header (solsticepy) is used in the same way.

A table without a header is SolarPILOT's user-defined layout (`SolarField::parseHeliostatXYZFile` in NREL's ssc):
template, x, y, z [m], then, all or ``NULL``, two focal lengths [m], a canting vector and an aim point [m]. Its z is the
height of the mirror's centre above a plane through the centre of a mirror at the tower's foot: here the height of its
base above the tower's base, as long as all pivots are equally high.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.tables import (
    HEADER,
    Table,
    numbers,
    separator_of,
    split_title,
    table_lines,
    table_text,
    variable_name,
)
from heliosweep.config.units import factor, is_unit
from heliosweep.errors import Problem, StudyError, printable
from heliosweep.files import write_rows
from heliosweep.layouts.layout import MAX_HELIOSTATS, PROPERTIES, Layout

#: Columns of SolarPILOT's user-defined layout; each group after the fourth is complete or absent.
SOLARPILOT_COLUMNS = (
    *("template", "x", "y", "z"),
    *("focal_x", "focal_y"),
    *("cant_i", "cant_j", "cant_k"),
    *("aim_x", "aim_y", "aim_z"),
)
#: Maximum length of a text in a column; longer ones are cut.
MAX_TEXT = 100
#: Maximum number of lines before the header.
MAX_PREAMBLE = 1000
#: Labels that are not listed as unused.
IDENTITY = ("id", "name", "template", "ring", "azimuth", "turn", "row", "canting_distance", "target")

_POSITION = ("x", "y", "z")
#: Titles of one focal length for both directions.
_BOTH = ("foc", "focus", "focallength")
#: Columns by their titles without blanks and signs. Titles of positions occur in SolarPILOT's layout (``Loc. X``), of
#: its exports (``Pos-x``) and of its Python interface (``x_location``).
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
_GAPS = ("", "-", "na", "n/a", "nan", "null", "none", "inf", "infinity", "-inf")
_DIGITS = re.compile(r"[0-9+\-\s]*")
_CODE = re.compile(r"(^|,)\s*[+-]?0[0-9]")  # 007 is a name, not the number 7
_NEEDS = "a header with the columns x and y, and one row for each heliostat"


def read_csv(path: str | Path, reserved: Collection[str] = (), name: str | None = None) -> Layout:
    """Read a layout from a CSV file.

    Parameters
    ----------
    path : path
        File with the columns ``x`` and ``y``, from the tower's base towards east and north [m], optional ``z``, upwards
        [m, default 0], properties of the heliostats (`heliosweep.layouts.layout.PROPERTIES`) and labels; or one of the
        tables in the notes of this module. Empty lines and lines that start with ``#`` are skipped.
    reserved : collection of str
        Names that the result uses: labels of these names are prefixed with ``layout_``.
    name : str, optional
        Name of the file in messages (default: `path`).

    Returns
    -------
    Layout
        Rows in the order of the file. Titles of labels become names (``Num. Facets``: ``num_facets``).

    Raises
    ------
    StudyError
        If the file cannot be read or is no such table: all bad rows, with file, line and column.
    """
    name = str(path) if name is None else name
    return read_text(table_text(Path(path), name), name, reserved)


def read_text(text: str, name: str, reserved: Collection[str] = ()) -> Layout:
    """Read a layout from the text of a CSV file, as `read_csv` does."""
    lines, texts = table_lines(text)
    if not re.search(r"[,;\t]", "".join(texts)):  # as numpy.savetxt writes it
        texts = [",".join(line.split()) for line in texts]
    header = next((row for row, line in enumerate(texts[:MAX_PREAMBLE]) if _is_header(line)), 0)
    separator = separator_of("".join(texts[header : header + 1]))
    if texts and not _is_header(texts[header]):
        first = ",".join(re.split(r"[\s,;]+", text.lstrip()[1:].partition("\n")[0]))
        if text.lstrip().startswith("#") and _is_header(first):  # a header of numpy.savetxt
            return read_text(text.replace("#", "", 1), name, reserved)
        lines, texts = _with_header(lines, texts, separator)
    lines, texts = lines[header:], texts[header:]
    units = [cell.strip(" ()[]") for cell in texts[1].split(separator)] if len(texts) > 1 else []
    if any(map(is_unit, units)) and "1" not in units and all(unit in ("", "-") or is_unit(unit) for unit in units):
        del lines[1], texts[1]
    else:
        units = []
    table = Table(name, (lines, texts), rows="heliostats", most_rows=MAX_HELIOSTATS, needs=_NEEDS, separator=separator)
    return _layout_of(table, units, reserved)


def _with_header(lines: list[int], texts: list[str], separator: str) -> tuple[list[int], list[str]]:
    """Return a user-defined layout of SolarPILOT with a header, shorter rows filled with ``NULL``; else the lines."""
    rows = [line.rstrip(f" {separator}").split(separator) for line in texts]
    if len(rows[0]) < 4 or not rows[0][0].strip().isdecimal() or not np.isfinite(numbers(rows[0][1:4])).all():
        return lines, texts
    width = max(map(len, rows))
    header = [*SOLARPILOT_COLUMNS, *(f"column_{place}" for place in range(len(SOLARPILOT_COLUMNS), width))][:width]
    filled = [row + ["NULL"] * (width - len(row)) if len(row) >= 4 else row for row in rows]
    return [lines[0], *lines], [separator.join(row) for row in (header, *filled)]


def _layout_of(table: Table, units: Sequence[str], reserved: Collection[str]) -> Layout:
    """Return the layout of a table. Raises StudyError with everything that is wrong."""
    titles, brackets = zip(*map(split_title, table.header), strict=True)
    keys = _keys_of(table.header, titles, reserved)
    for key, direction in (("x", "east"), ("y", "north")):
        if key not in keys:
            there = printable(", ".join(table.header))[:200]
            table.add(f"needs a column {key}, the metres {direction} of the tower's base (got {there})", HEADER)
    scales = _scales_of(table, keys, units or brackets)
    both = "focal_x" in keys and _letters(titles[keys.index("focal_x")]) in _BOTH
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
    unused = tuple(key for key in columns if key not in (*PROPERTIES, *IDENTITY))
    return Layout(x, y, z, columns, table.name, table.lines, labels=unused)


def _keys_of(header: Sequence[str], titles: Sequence[str], reserved: Collection[str]) -> list[str]:
    """Return the names of the columns."""
    keys: list[str] = []
    # Positions of OpenCSP's tables, which have the column pivot_offset, are the pivots.
    pivots = "pivot_offset" in map(variable_name, header)
    for place, (title, name) in enumerate(zip(header, titles, strict=True)):
        key = _TITLES.get(_letters(name), "")
        if not key or (key in keys and key not in _POSITION) or (pivots and key == "pivot_height"):
            key = variable_name(title)
            key = key if key[:1].isalpha() else f"column_{key or place + 1}"
            key = f"layout_{key}" if key in {*reserved, *PROPERTIES, *keys} else key
        keys.append(key)
    return keys


def _scales_of(table: Table, keys: Sequence[str], units: Sequence[str]) -> dict[str, float]:
    """Return the factors to the units of the columns; note wrong units and repeated columns."""
    scales: dict[str, float] = {}
    for place, (key, unit) in enumerate(zip(keys, units, strict=False)):
        expected = "m" if key in _POSITION else PROPERTIES[key].unit if key in PROPERTIES else ""
        if key in keys[:place]:
            table.add(f"has two columns {key!r}; remove one", HEADER, place)
        if expected and unit not in ("", "-", expected):
            try:
                scales[key] = factor(unit, expected)
            except ValueError:
                table.add(f"is in {unit!r}; {key} must be in {expected}", HEADER, place)
    return scales


def _typed(texts: list[str]) -> NDArray | None:
    """Return a column as int64, as float64 with NaN for gaps, or as text; None if it is empty or ``NULL``."""
    if set(texts) <= {"", "NULL"}:
        return None
    values, words = numbers(texts), np.array([text[:MAX_TEXT] for text in texts], str)
    known = np.isfinite(values)
    if not known.any() or not {text.lower() for text in words[~known]} <= {*_GAPS} or _CODE.search(",".join(texts)):
        return words
    if not known.all() or not _DIGITS.fullmatch("".join(texts)):
        return np.where(known, values, np.nan)
    integers = np.array(list(map(int, texts)))
    return integers if integers.dtype == np.int64 else words  # beyond 64 bits a float would lose digits


def _is_header(line: str) -> bool:
    """Return True if the titles of a line name the columns x and y."""
    names = (split_title(title.strip())[0] for title in line.split(separator_of(line)))
    return {"x", "y"} <= {_TITLES.get(_letters(name)) for name in names}


def _letters(title: str) -> str:
    return re.sub(r"[^a-z0-9]", "", title.lower())


def write_csv(layout: Layout, path: str | Path) -> None:
    """Write a layout that `read_csv` reads back with identical numbers; an existing file is replaced.

    The file appears under its name when it is complete; the layout's notes are comments before the table. Text that
    reads as a number comes back as one. Raises HeliosweepError if the file cannot be written; nothing is left behind.
    """
    columns = {"x": layout.x, "y": layout.y, "z": layout.z, **layout.columns}
    rows = zip(*(_cells(values, "") for values in columns.values()), strict=True)
    write_rows(itertools.chain([columns], rows), Path(path), layout.notes)


def write_solarpilot(layout: Layout, path: str | Path) -> None:
    """Write SolarPILOT's user-defined layout, which `read_csv` reads back with identical numbers.

    Positions and known `SOLARPILOT_COLUMNS` are written; heliostats of one mirror size have one template. The table
    cannot contain further columns. An existing file is replaced when the new one is complete. Raises StudyError if
    one of these columns contains text, and HeliosweepError if the file cannot be written.
    """
    given = {key: values for key, values in layout.columns.items() if key in SOLARPILOT_COLUMNS}
    for key, values in given.items():
        if values.dtype.kind not in ("i" if key == "template" else "if"):
            message = f"{key} must hold {'whole ' * (key == 'template')}numbers for SolarPILOT; rename the column"
            raise StudyError(Problem(message, file=layout.name))
    sides = np.stack([layout.values(side, None, 0.0) for side in ("width", "height")], axis=1)
    order = {size: number for number, size in enumerate(dict.fromkeys(map(tuple, sides.tolist())))}
    template = np.array([order[size] for size in map(tuple, sides.tolist())], int)
    last = max(map(SOLARPILOT_COLUMNS.index, given), default=0)
    blank = dict.fromkeys(SOLARPILOT_COLUMNS[: next(end for end in (4, 6, 9, 12) if last < end)], sides[:, 0] * np.nan)
    columns = {**blank, "template": template, "x": layout.x, "y": layout.y, "z": layout.z}
    write_rows(zip(*(_cells(values, "NULL") for values in (columns | given).values()), strict=True), Path(path))


def _cells(values: NDArray, gap: str) -> list[Any]:
    """Return the cells of a column, with a text for NaN."""
    return [gap if isinstance(value, float) and np.isnan(value) else value for value in values.tolist()]

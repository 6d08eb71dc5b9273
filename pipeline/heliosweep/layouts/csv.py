"""Layouts as CSV: one heliostat a row, columns ``x``, ``y``, optional ``z``, and any others; or as SolarPILOT has them.

SolarPILOT's user-defined layout (`SolarField::parseHeliostatXYZFile` in NREL's ssc, and `assign_layout` of its Python
interface) is a table without a header, a heliostat a row: template, x, y, z [m], then, all or ``NULL``, two focal
lengths [m], a canting vector and an aim point [m]. x points east, y north, and z is the height of the mirror's centre
above a plane through the centre of a mirror at the tower's foot: here that of its base above the tower's base, as
long as all pivots are equally high. The first four columns are required. A line without a comma is passed over if
none follows with one; `write_solarpilot` notes the mirror sizes of the templates on such lines.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.spreadsheets import separator_of, split_title, told_separator, variable_name
from heliosweep.config.tables import Table, numbers, table_lines, table_text
from heliosweep.errors import Problem, StudyError
from heliosweep.files import write_rows
from heliosweep.layouts.layout import MAX_HELIOSTATS, Layout, layout_of

#: Columns of a user-defined layout; one of the groups after the first is there or not, as a whole.
SOLARPILOT_COLUMNS = (
    *("template", "x", "y", "z"),
    *("focal_x", "focal_y"),
    *("cant_i", "cant_j", "cant_k"),
    *("aim_x", "aim_y", "aim_z"),
)
_GROUPS = (SOLARPILOT_COLUMNS[4:6], SOLARPILOT_COLUMNS[6:9], SOLARPILOT_COLUMNS[9:12])

#: Titles of columns in SolarPILOT's tables without blanks and signs: of its layout, of the export of simulations
#: (``Pos-x``, `SPFrame::LayoutSimulationExport`) and of its Python interface (``x_location``, `get_layout_info`).
_TITLES = {
    **dict.fromkeys(("template", "templateid", "heliotemplateid"), "template"),
    **{f"{title}{axis}": axis for title in ("loc", "location", "pos", "position") for axis in "xyz"},
    **{f"{axis}{title}": axis for title in ("location", "position", "coordinate") for axis in "xyz"},
    **{f"{title}{axis}": f"focal_{axis}" for title in ("foc", "focal", "focallength") for axis in "xy"},
    **{f"{axis}focallength": f"focal_{axis}" for axis in "xy"},
    **{f"cant{axis}": f"cant_{axis}" for axis in "ijk"},
    **{f"cant{axis}": f"cant_{vector}" for axis, vector in zip("xyz", "ijk", strict=True)},
    **{f"aim{axis}": f"aim_{axis}" for axis in "xyz"},
    **dict.fromkeys(("id", "heliostatid"), "id"),
}
#: Lines that the export of a simulation has before its header.
_PREAMBLE = ("solarazimuth", "solarzenith", "dni")
_MOST_PREAMBLE = 10

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"[+-]?[0-9]{1,18}")
_SIZE = re.compile(r"template (\d{1,9}): (\S+) m x (\S+) m")


def read_csv(path: str | Path, reserved: Collection[str] = (), name: str | None = None) -> Layout:
    """Read a layout from a CSV file.

    The first row names the columns: ``x`` and ``y``, metres east and north of the tower's base, ``z``, metres above it
    (0 if left out), and any others, which are kept as integers, numbers or text. Rows stay in order. Empty lines and
    lines that start with ``#`` are skipped. Text is UTF-8, with or without byte-order mark. Tables of SolarPILOT are
    known by their header, or by having none, and read as the notes of this module say.

    Other columns must not have `reserved` names, since the result uses them. `name` is what messages and the layout
    call the file; `path` by default. Raises StudyError if the file cannot be read or is no such table: all bad rows at
    once, with file, line and column.
    """
    name = str(path) if name is None else name
    return read_text(table_text(Path(path), name), name, reserved)


def read_text(text: str, name: str, reserved: Collection[str] = ()) -> Layout:
    """Read a layout from the text of a CSV file, as `read_csv` does."""
    lines = table_lines(text, name)
    form = _solarpilot_form(lines[1])
    if form is not None:
        return _read_solarpilot(name, lines, *form, reserved)
    needs = "a header with the columns x and y, and one row for each heliostat"
    return layout_of(Table(name, lines, rows="heliostats", most_rows=MAX_HELIOSTATS, needs=needs), reserved)


def write_csv(layout: Layout, path: str | Path) -> None:
    """Write a layout so that `read_csv` gives back the same numbers, to the last bit; an existing file is replaced.

    The file appears under its name only when it is complete; the layout's notes are comments before the table. Text
    that reads as a number comes back as one; numbers that are not known (NaN), as SolarPILOT's tables may have them,
    cannot be read back. Raises HeliosweepError if the file cannot be written; nothing is left behind.
    """
    columns = {"x": layout.x, "y": layout.y, "z": layout.z, **layout.columns}
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    write_rows(itertools.chain([columns], rows), Path(path), layout.notes)


def _solarpilot_form(lines: Sequence[str]) -> tuple[str, int | None] | None:
    """Return what separates fields of a table of SolarPILOT, and which line is its header; None for any other table.

    `lines` are those that hold something. A layout has no header: None stands for it.
    """
    for position, line in enumerate(lines[: _MOST_PREAMBLE + 1]):
        if position == 0 and told_separator(line):
            continue
        separator = separator_of(line)
        fields = _fields(line, separator)
        plain = [_letters(split_title(field)[0]) for field in fields]
        meant = [_TITLES.get(title) for title in plain]
        if {"x", "y"} <= set(meant) and not {"x", "y"} & set(plain):
            return separator, position
        if position == 0 and _is_row(fields):
            return separator, None
        if not plain[0].startswith(_PREAMBLE):
            return None
    return None


def _read_solarpilot(
    name: str, lines: tuple[list[int], list[str]], separator: str, header: int | None, reserved: Collection[str]
) -> Layout:
    """Read a table of SolarPILOT: a layout, the export of a simulation, or what its Python interface gives.

    Columns of a layout get the names of `SOLARPILOT_COLUMNS`, others theirs in small letters. A column that is nowhere
    given (``NULL``) is left out, as is the template where all share one. Sizes of templates become ``width`` and
    ``height``. Raises StudyError with all that is wrong.
    """
    at, texts = lines[0][header or 0 :], lines[1][header or 0 :]
    sizes: dict[int, tuple[float, float]] = {}
    while len(texts) > 1 and (size := _SIZE.fullmatch(texts[-1].strip())):
        sizes[int(size[1])] = _side(size[2], name, at[-1]), _side(size[3], name, at[-1])
        del at[-1], texts[-1]
    cells = [_fields(text, separator) for text in texts]
    if header is None:
        width = max(map(len, cells))
        # A row may end where nothing more is given. Header and lines stay one to one: it stands on the first line.
        cells = [row + ["NULL"] * (width - len(row)) if len(row) >= 4 else row for row in cells]
        at, texts, cells = [at[0], *at], [texts[0], *texts], [list(SOLARPILOT_COLUMNS[:width]), *cells]
    else:
        titles = [split_title(title) for title in cells[0]]
        keys = [_TITLES.get(_letters(called)) for called, _ in titles]
        if wrong := [
            said
            for key, (_, said) in zip(keys, titles, strict=True)
            if key in ("x", "y", "z") and said not in ("", "m")
        ]:
            raise StudyError(Problem(f"has positions in {wrong[0]!r}; they must be in m", file=name, line=at[0]))
        cells[0] = [key or variable_name(title) for key, title in zip(keys, cells[0], strict=True)]
    cells[0] = [f"solarpilot_{key}" if key in reserved and key not in ("x", "y", "z") else key for key in cells[0]]
    table = Table(name, (at, texts), cells, rows="heliostats", most_rows=MAX_HELIOSTATS, separator=separator)
    layout = layout_of(table, unknown="NULL")
    columns = {key: values for key, values in layout.columns.items() if not _is_unknown(values)}
    template = columns.get("template", np.zeros(len(layout), np.int64))
    if template.dtype.kind != "i":
        bad = (row for row, text in enumerate(table.texts("template")) if not _WHOLE.fullmatch(text))
        table.add("template must be a whole number", next(bad, 0), "template")
    for key in SOLARPILOT_COLUMNS[4:]:
        if key in columns and columns[key].dtype.kind not in "if":
            table.note_bad_numbers(key, texts := table.texts(key), numbers(texts))
    table.finish()
    if missing := [number for number in np.unique(template).tolist() if sizes and number not in sizes]:
        table.add(f"gives no mirror size for template {missing[0]}, but sizes for others")
        table.finish()
    if sizes:
        sides = np.array([sizes[number] for number in template.tolist()])
        columns |= {"width": sides[:, 0], "height": sides[:, 1]}
    if (template == template[0]).all():
        columns.pop("template", None)
    for group in _GROUPS:
        there = [key for key in group if key in columns]
        if there and len(there) < len(group):
            table.add(f"has a column {there[0]} but not all of {', '.join(group)}")
    table.finish()
    return Layout(layout.x, layout.y, layout.z, columns, layout.name, layout.lines)


def _side(text: str, name: str, line: int) -> float:
    """Length of a side of a mirror. Raises StudyError. [m]"""
    side = float(text) if _NUMBER.fullmatch(text) else 0.0
    if not 0 < side < np.inf:
        raise StudyError(Problem(f"a mirror's side must be a positive number (got {text})", file=name, line=line))
    return side


def write_solarpilot(layout: Layout, path: str | Path) -> None:
    """Write a layout that SolarPILOT takes as user-defined, and that `read_csv` gives back to the last bit.

    Written are the positions, what is known of `SOLARPILOT_COLUMNS`, and the mirror sizes (``width``, ``height``), for
    each of which there is a template; further columns have no place in the table. A file of this name is replaced when
    the new one is complete. Raises StudyError if one of these columns holds words, or heliostats of one template have
    mirrors of different sizes, and HeliosweepError if the file cannot be written.
    """
    for key in (*SOLARPILOT_COLUMNS[4:], "template", "width", "height"):
        kinds, what, right = ("i", "whole numbers", _WHOLE) if key == "template" else ("if", "numbers", _NUMBER)
        if (values := layout.columns.get(key)) is not None and values.dtype.kind not in kinds:
            row = next((row for row, text in enumerate(values.tolist()) if not right.fullmatch(str(text))), 0)
            message = f"{key} must hold {what} for SolarPILOT (got {str(values[row])[:40]!r} for {layout.where(row)})"
            raise StudyError(Problem(f"{message}; correct or rename the column", file=layout.name))
    numbers, sizes = _templates(layout)
    groups = [all(key in layout.columns for key in group) for group in _GROUPS]
    last = max((place + 1 for place, there in enumerate(groups) if there), default=0)
    columns: list[list[Any]] = [values.tolist() for values in (numbers, layout.x, layout.y, layout.z)]
    for group, there in zip(_GROUPS[:last], groups, strict=False):
        columns += [_written(layout.columns[key]) if there else ["NULL"] * len(layout) for key in group]

    def rows() -> Iterator[Sequence[Any]]:
        yield from zip(*columns, strict=True)
        for number, (width, height) in sizes.items():
            yield (f"template {number}: {width!r} m x {height!r} m",)

    write_rows(rows(), Path(path))


def _templates(layout: Layout) -> tuple[NDArray[np.int64], dict[int, tuple[float, float]]]:
    """Return the template of every heliostat, and the mirror size of each template where sizes are known."""
    given, width, height = (layout.columns.get(key) for key in ("template", "width", "height"))
    if width is None or height is None:
        return np.zeros(len(layout), np.int64) if given is None else given, {}
    pairs = list(zip(width.astype(float).tolist(), height.astype(float).tolist(), strict=True))
    if given is None:
        order = {pair: number for number, pair in enumerate(dict.fromkeys(pairs))}
        return np.array([order[pair] for pair in pairs], np.int64), {number: pair for pair, number in order.items()}
    sizes: dict[int, tuple[float, float]] = {}
    for row, (number, pair) in enumerate(zip(given.tolist(), pairs, strict=True)):
        if sizes.setdefault(number, pair) != pair:
            message = f"{layout.where(row)} of template {number} has a mirror of another size than others of it"
            raise StudyError(Problem(message, file=layout.name))
    return given, sizes


def _written(values: NDArray) -> list[Any]:
    return ["NULL" if isinstance(value, float) and np.isnan(value) else value for value in values.tolist()]


def _fields(line: str, separator: str) -> list[str]:
    """Return the fields of a line without the empty one behind a separator at its end."""
    fields = [field.strip() for field in line.split(separator)]
    return fields[:-1] if len(fields) > 1 and not fields[-1] else fields


def _letters(title: str) -> str:
    return re.sub(r"[^a-z0-9]", "", title.lower())


def _is_row(fields: Sequence[str]) -> bool:
    """True for the fields of a heliostat of a layout without header."""
    if not 4 <= len(fields) <= len(SOLARPILOT_COLUMNS) or not fields[0].isdecimal():
        return False
    is_number: Callable[[str], Any] = _NUMBER.fullmatch
    return all(map(is_number, fields[1:4])) and all(field == "NULL" or is_number(field) for field in fields[4:])


def _is_unknown(values: NDArray) -> bool:
    return values.dtype.kind == "f" and values.size > 0 and bool(np.isnan(values).all())

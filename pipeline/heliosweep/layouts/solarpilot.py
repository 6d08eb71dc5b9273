"""Layouts as SolarPILOT writes and reads them.

SolarPILOT's user-defined layout (`SolarField::parseHeliostatXYZFile` in NREL's ssc, and `assign_layout` of its Python
interface) is a table without a header, a heliostat a row: template, x, y, z [m], then, all or ``NULL``, two focal
lengths [m], a canting vector and an aim point [m]. x points east, y north, and z is the height of the mirror's centre
above a plane through the centre of a mirror at the tower's foot: here that of its base above the tower's base, as
long as all pivots are equally high. The first four columns are required. A line without a comma is passed over if
none follows with one; `write_solarpilot` notes the mirror sizes of the templates on such lines.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.tables import table_lines
from heliosweep.errors import Problem, StudyError
from heliosweep.layouts.csv import Reader, write_rows
from heliosweep.layouts.layout import Layout

#: Columns of a user-defined layout; one of the groups after the first is there or not, as a whole.
COLUMNS = (
    *("template", "x", "y", "z"),
    *("focal_x", "focal_y"),
    *("cant_i", "cant_j", "cant_k"),
    *("aim_x", "aim_y", "aim_z"),
)
_GROUPS = (COLUMNS[4:6], COLUMNS[6:9], COLUMNS[9:12])

#: Titles of columns in SolarPILOT's tables without blanks and signs: of its layout, of the export of simulations
#: (``Pos-x``, `SPFrame::LayoutSimulationExport`) and of its Python interface (``x_location``, `get_layout_info`).
_TITLES = {
    **dict.fromkeys(("template", "templateid", "heliotemplateid"), "template"),
    **{f"{title}{axis}": axis for title in ("loc", "location", "pos") for axis in "xyz"},
    **{f"{axis}location": axis for axis in "xyz"},
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
_SIZE = re.compile(r"template (\d{1,9}): (\S+) m x (\S+) m")


@dataclass(frozen=True)
class Form:
    """How a table of SolarPILOT is written.

    Parameters
    ----------
    separator : str
        Between fields.
    header : int or None
        Position of the header among the lines that hold something; None where there is none.
    """

    separator: str
    header: int | None


def recognised(text: str) -> Form | None:
    """Return how a table of SolarPILOT is written; None for any other text."""
    lines = table_lines(text[: 2**16])[1][: _MOST_PREAMBLE + 1]
    for position, line in enumerate(lines):
        separator = "," if "," in line else "\t"
        fields = _fields(line, separator)
        plain = [_plain(field) for field in fields]
        meant = [_TITLES.get(title) for title in plain]
        if {"x", "y"} <= set(meant) and not {"x", "y"} & set(plain):
            return Form(separator, position)
        if position == 0 and _is_row(fields):
            return Form(separator, None)
        if not plain[0].startswith(_PREAMBLE):
            return None
    return None


class SolarPilotReader(Reader):
    """Reads a table of SolarPILOT: a layout, the export of a simulation, or what its Python interface gives.

    Columns of a layout get the names of `COLUMNS`, others theirs in small letters. A column that is nowhere given
    (``NULL``) is left out, as is the template where all share one. Sizes of templates become ``width`` and ``height``.

    Parameters
    ----------
    name : str
        Name of the file.
    form : Form
        From `recognised`.
    """

    def __init__(self, name: str, form: Form) -> None:
        super().__init__(name)
        self.form = form
        self.sizes: dict[int, tuple[float, float]] = {}

    def read(self, text: str, reserved: Collection[str]) -> Layout:
        """Return the layout that a text holds, or raise with all that is wrong."""
        layout = super().read(text, reserved)
        columns = {key: values for key, values in layout.columns.items() if not _unknown(values)}
        template = columns.get("template")
        if self.sizes:
            columns |= self._sizes(layout, template)
        if template is not None and (template == template[0]).all():
            del columns["template"]
        for group in _GROUPS:
            there = [key for key in group if key in columns]
            if there and len(there) < len(group):
                self._add(f"has a column {there[0]} but not all of {', '.join(group)}")
        self._finish()
        return Layout(layout.x, layout.y, layout.z, columns, layout.name, layout.lines)

    def _lines(self, text: str) -> tuple[list[int], list[str]]:
        numbers, lines = super()._lines(text)
        if self.form.header is None:
            # Header and lines stay one to one: the header that is missing stands on the first line.
            width = max(len(_fields(line, self.form.separator)) for line in lines)
            numbers, lines = [numbers[0], *numbers], [self.form.separator.join(COLUMNS[:width]), *lines]
        else:
            numbers, lines = numbers[self.form.header :], lines[self.form.header :]
        while len(lines) > 1 and (size := _SIZE.fullmatch(lines[-1].strip())):
            self.sizes[int(size[1])] = self._side(size[2], numbers[-1]), self._side(size[3], numbers[-1])
            del numbers[-1], lines[-1]
        return numbers, lines

    def _rows(self) -> list[list[str]]:
        rows = [_fields(line, self.form.separator) for line in self.lines]
        if self.form.header is not None:
            names: list[str] = []
            for title in rows[0]:
                name = _TITLES.get(_plain(title)) or re.sub(r"[^a-z0-9]+", "_", title.lower()).strip("_")
                names.append(name)
            rows[0] = names
        width = len(rows[0])
        if self.form.header is None:  # a row may end where nothing more is given
            rows = [[*row, *["NULL"] * (width - len(row))] if 4 <= len(row) < width else row for row in rows]
        return rows

    def _check_header(self, header: list[str], reserved: Collection[str]) -> None:
        for position, key in enumerate(header):
            if key in reserved and key not in ("x", "y", "z"):
                header[position] = f"solarpilot_{key}"
        super()._check_header(header, ())

    def _column(self, key: str, index: int, values: Sequence[str], rows: list[int]) -> NDArray:
        if key in ("x", "y", "z") or "NULL" not in values:
            column = super()._column(key, index, values, rows)
            if key == "template" and column.dtype.kind != "i":
                self._add_rows(rows[:1], index, lambda row: "template must be a whole number")
            return column
        given = [place for place, value in enumerate(values) if value != "NULL"]
        column = np.full(len(values), np.nan)
        if given:
            column[given] = super()._column(key, index, [values[place] for place in given], [rows[p] for p in given])
        return column

    def _side(self, text: str, line: int) -> float:
        """Return the length of a side of a mirror, or note that it is none."""
        side = float(text) if _NUMBER.fullmatch(text) else 0.0
        if not 0 < side < np.inf:
            self.problems.append(
                Problem(f"a mirror's side must be a positive number (got {text})", "", self.name, line)
            )
        return side

    def _sizes(self, layout: Layout, template: NDArray | None) -> dict[str, NDArray]:
        """Width and height of every mirror, by its template."""
        numbers = np.zeros(len(layout), np.int64) if template is None else template
        missing = [int(number) for number in np.unique(numbers) if int(number) not in self.sizes]
        if missing:
            self._add(f"gives no mirror size for template {missing[0]}, but sizes for others")
            self._finish()
        table = np.array([self.sizes[int(number)] for number in numbers])
        return {"width": table[:, 0], "height": table[:, 1]}


def write_solarpilot(layout: Layout, path: str | Path) -> None:
    """Write a layout that SolarPILOT takes as user-defined, and that `read_csv` gives back to the last bit.

    Written are the positions, what is known of `COLUMNS`, and the mirror sizes (``width``, ``height``), for each of
    which there is a template; further columns have no place in the table. A file of this name is replaced.

    Parameters
    ----------
    layout : Layout
        The heliostats.
    path : str or Path
        File to write; appears under its name when it is complete.

    Raises
    ------
    StudyError
        If heliostats of one template have mirrors of different sizes.
    OSError
        If the file cannot be written.
    """
    numbers, sizes = _templates(layout)
    count = len(layout)
    groups = [all(key in layout.columns for key in group) for group in _GROUPS]
    last = max((place + 1 for place, there in enumerate(groups) if there), default=0)
    columns: list[list[Any]] = [numbers.tolist(), layout.x.tolist(), layout.y.tolist(), layout.z.tolist()]
    for group, there in zip(_GROUPS[:last], groups, strict=False):
        columns += [_written(layout.columns[key]) if there else ["NULL"] * count for key in group]

    def rows() -> Iterator[Sequence[Any]]:
        yield from zip(*columns, strict=True)
        for number, (width, height) in sizes.items():
            yield (f"template {number}: {width!r} m x {height!r} m",)

    write_rows(rows(), path)


def _templates(layout: Layout) -> tuple[NDArray[np.int64], dict[int, tuple[float, float]]]:
    """Return the template of every heliostat, and the mirror size of each template where sizes are known."""
    count = len(layout)
    given = layout.columns.get("template")
    sides = [layout.columns.get(side) for side in ("width", "height")]
    width, height = sides
    if width is None or height is None:
        return np.zeros(count, np.int64) if given is None else given, {}
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


def _plain(title: str) -> str:
    return re.sub(r"[^a-z0-9]", "", title.lower())


def _is_row(fields: Sequence[str]) -> bool:
    """Whether these are the fields of a heliostat of a layout without header."""
    if not 4 <= len(fields) <= len(COLUMNS) or not fields[0].isdecimal():
        return False
    is_number: Callable[[str], Any] = _NUMBER.fullmatch
    return all(map(is_number, fields[1:4])) and all(field == "NULL" or is_number(field) for field in fields[4:])


def _unknown(values: NDArray) -> bool:
    return values.dtype.kind == "f" and values.size > 0 and bool(np.isnan(values).all())

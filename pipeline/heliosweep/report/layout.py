"""Sheets of panels: as wide as a page, as high as the panels need with what stands around them."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from heliosweep.report.labels import LEGEND_LETTERS, ROUND, is_latitude, latitude_text, steps_of
from heliosweep.report.style import DPI, PlainPowers

#: Width of a figure over both columns of a journal page, of one with a single panel, and its largest height. [inch]
PAGE_WIDTH, SINGLE_WIDTH, MOST_HEIGHT = 7.2, 4.8, 9.6

#: Room beside what stands around panels, between it and a colour bar, and height of a bar. [inch]
_GAP, _ABOVE_BAR, _BAR = 0.05, 0.14, 0.09

#: Left, right, below and above panels, before that is measured. [inch]
_GUESS = (0.5, 0.1, 0.4, 0.3)


def abreast(count: int, most: int) -> int:
    """Columns in which so many panels stand in rows that are as even as can be."""
    return -(-count // -(-count // most)) if count else 1


def sheet(
    count: int, columns: int, *, sharex: bool = False, sharey: bool | Literal["row"] = False, wide: bool = False
) -> tuple[Figure, list[Axes]]:
    """Figure with axes in rows, which `fit` makes as large as they need, and the axes in reading order.

    `sharex` and `sharey` are those of `matplotlib.figure.Figure.subplots`; if `wide`, one column is as wide as a page.
    """
    rows = -(-count // columns)
    width = PAGE_WIDTH if wide or columns > 1 else SINGLE_WIDTH
    figure = Figure(figsize=(width, MOST_HEIGHT), dpi=DPI)  # measured as it is drawn: letters take whole pixels
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.remove()
    for axes in grid[:count]:
        axes.spines[:].set_in_layout(False)  # they reach no further than ticks, and to measure them takes a quarter
    return figure, list(grid[:count])


def label_outside(axes: Sequence[Axes], columns: int, x: str, y: Sequence[str], own: bool = False) -> None:
    """Label the first axes of each row and the last ones of each column; the others have no numbers.

    Axes are in reading order, each with its label in `y`; with `own` each has a vertical axis of its own.
    """
    for index, (one, label) in enumerate(zip(axes, y, strict=True)):
        left, bottom = own or index % columns == 0, index + columns >= len(axes)
        one.tick_params(labelleft=left, labelbottom=bottom)
        one.set(xlabel=x if bottom else "", ylabel=label if left else "")


def legend(
    figure: Figure,
    entries: Mapping[str, Artist],
    title: str = "",
    loc: Literal["upper center", "lower center"] = "upper center",
) -> None:
    """Write a legend above or below all axes, in as few rows as fit."""
    names = [textwrap.fill(name, LEGEND_LETTERS) for name in entries]
    for rows in range(1, len(entries) + 1):
        columns = -(-len(entries) // rows)
        written = figure.legend(list(entries.values()), names, loc=loc, ncols=columns, title=title or None)
        if rows == len(entries) or written.get_window_extent().width <= 0.98 * figure.bbox.width:
            return
        written.remove()


def colour_bar(figure: Figure, mappable: ScalarMappable, axes: Sequence[Axes], label: str, extend: str) -> Colorbar:
    """Draw the colour bar of one of the axes, or of all of them, below: `fit` places it."""
    alone = len(axes) == 1
    bar = figure.colorbar(
        mappable,
        cax=figure.add_axes((0.1, 0.1, 0.85 if alone else 0.6, 0.1)),
        orientation="horizontal",
        label=label,
        extend=extend,
        ticks=MaxNLocator(5 if alone else 7, steps=[*ROUND, 10]),
    )
    bar.outline.set_linewidth(0.5)
    return bar


def tick(axis: Axis, coordinate: xr.DataArray, logarithmic: bool = False, most: int = 7) -> None:
    """Place and word the ticks of an axis along which the values of a coordinate stand."""
    if coordinate.dtype.kind == "M":
        locator = AutoDateLocator(minticks=3, maxticks=most)
        axis.set_major_locator(locator)
        axis.set_major_formatter(ConciseDateFormatter(locator, show_offset=False))
    elif logarithmic:
        axis.set_major_formatter(PlainPowers())
        axis.set_minor_formatter(PlainPowers(labelOnlyBase=False))
    else:
        values, steps = coordinate.to_numpy(), [*steps_of(coordinate), 10]
        span = np.ptp(values)
        if is_latitude(coordinate):
            steps = [1, 1.5, 2, 3, 5, 10]
            axis.set_major_formatter(FuncFormatter(lambda value, _: latitude_text(round(value, 6))))
        whole = bool(span <= most and not np.any(values % 1))
        axis.set_major_locator(MaxNLocator(most, steps=steps, integer=whole))


def tick_decades(axis: Axis, low: float, high: float) -> None:
    """Plain numbers along a logarithmic axis with these ends."""
    axis.set_major_locator(LogLocator(subs=(1.0,) if high > 1000 * low else (1.0, 2.0, 5.0), numticks=10))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def fit(figure: Figure, box: float) -> Figure:
    """Break texts that are longer than their axes, make a figure as high as it need be, and fix all in its place.

    `box` is height over width of the axes.
    """
    page, room, moved = figure.get_figwidth(), np.tile(_GUESS, (len(figure.axes), 1)), True
    _place(figure, page, box, room)
    for _ in range(4):  # broken labels make axes narrower, and other ticks come with another size
        around = np.array([_around(axes, figure.dpi) for axes in figure.axes])
        if not moved and np.all((around <= room + _GAP / 2) & (around >= room - 2 * _GAP)):
            break
        room = around
        _place(figure, page, box, room)
        sides = [(axes, *axes.get_window_extent().size) for axes in figure.axes]
        broken = [_break(text, wide, 0) for axes, wide, _ in sides for text in (axes.title, axes.xaxis.label)]
        moved = any(broken + [_break(axes.yaxis.label, high, 1) for axes, _, high in sides])
    return figure


def _around(axes: Axes, dpi: float) -> list[float]:
    """How far what belongs to axes reaches out on the left, on the right, below and above. [inch]"""
    inner, outer = axes.get_window_extent(), axes.get_tightbbox(for_layout_only=True)
    assert outer
    ends = inner.x0 - outer.x0, outer.x1 - inner.x1, inner.y0 - outer.y0, outer.y1 - inner.y1
    return [max(0.0, end) / dpi for end in ends]


def _place(figure: Figure, page: float, box: float, around: np.ndarray) -> None:
    """Give panels one size and the room that they need around, on a page so wide [inch]; colour bars stand below."""
    specs = [spec for axes in figure.axes if (spec := axes.get_subplotspec())]
    count, (rows, columns) = len(specs), specs[0].get_gridspec().get_geometry()
    row, column = np.divmod([spec.num1 for spec in specs], columns)
    left, right, below, above = (np.zeros(length) for length in (columns, columns, rows, rows))
    for room, at, found in zip((left, right, below, above), (column, column, row, row), around[:count].T, strict=True):
        np.maximum.at(room, at, found + _GAP)
    bars, under = figure.axes[count:], np.zeros(rows)
    own = len(bars) == count
    if bars:
        under[slice(None) if own else -1] = _ABOVE_BAR + _BAR + around[count:, 2].max() + _GAP
    top = bottom = _GAP
    for written in figure.legends:
        extent = written.get_window_extent()
        high = extent.height / figure.dpi + 2 * _GAP
        top, bottom = (top + high, bottom) if extent.y0 > figure.bbox.height / 2 else (top, bottom + high)
    beside, over = (left + right).sum(), (below + under + above).sum() + top + bottom
    wide = min((page - beside) / columns, (MOST_HEIGHT - over) / (rows * box))
    high = wide * box
    size = beside + columns * wide, over + rows * high
    figure.set_size_inches(size)
    x: np.ndarray = np.cumsum(left + wide + right) - wide - right
    y: np.ndarray = size[1] - top - np.cumsum(above + high + below + under) + below + under
    for axes, i, j in zip(figure.axes, row, column, strict=False):
        axes.set_position((x[j] / size[0], y[i] / size[1], wide / size[0], high / size[1]))
    for number, bar in enumerate(bars):
        i, first, last = (row[number], column[number], column[number]) if own else (-1, 0, -1)
        middle, length = (x[first] + x[last] + wide) / 2, (0.85 if own else 0.6) * (x[last] + wide - x[first])
        start, lower = middle - length / 2, y[i] - below[i] - _ABOVE_BAR - _BAR
        bar.set_position((start / size[0], lower / size[1], length / size[0], _BAR / size[1]))


def _break(text: Text, room: float, side: int) -> bool:
    """Break a text into lines that are no longer than so many pixels along x (0) or y (1); whether that changed it."""
    before = text.get_text()
    long = text.get_window_extent().size[side] if before else 0.0
    if long > 1.03 * room:
        lines = before.split("\n")
        letters = max(8, int(0.97 * max(map(len, lines)) * room / long))
        text.set_text("\n".join(part for line in lines for part in textwrap.wrap(line, letters)))
    return bool(text.get_text() != before)

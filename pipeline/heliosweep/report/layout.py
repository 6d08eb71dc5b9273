"""Sheets of panels: as wide as a page, as high as the panels need, placed by matplotlib's constrained layout."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, Literal
from unittest import mock

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
from heliosweep.report.style import PlainPowers

#: Width of a figure over both columns of a journal page, of one with a single panel, and its largest height. [inch]
PAGE_WIDTH, SINGLE_WIDTH, MOST_HEIGHT = 7.2, 4.8, 9.6


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
    figure = Figure(figsize=(width, MOST_HEIGHT), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.remove()
    return figure, list(grid[:count])


def label_outside(axes: Sequence[Axes], columns: int, x: str, y: Sequence[str], own: bool = False) -> None:
    """Label the first axes of each row and the last ones of each column; the others have no numbers.

    Axes are in reading order, each with its label in `y`; with `own` each has a vertical axis of its own.
    """
    for index, (one, label) in enumerate(zip(axes, y, strict=True)):
        left, bottom = own or index % columns == 0, index + columns >= len(axes)
        one.tick_params(labelleft=left, labelbottom=bottom)
        one.set(xlabel=x if bottom else "", ylabel=label if left else "")


def legend(figure: Figure, entries: Mapping[str, Artist], title: str = "", loc: str = "upper center") -> None:
    """Write a legend outside of all axes, in as few rows as fit."""
    place: Any = f"outside {loc}"
    names = [textwrap.fill(name, LEGEND_LETTERS) for name in entries]
    for rows in range(1, len(entries) + 1):
        columns = -(-len(entries) // rows)
        written = figure.legend(list(entries.values()), names, loc=place, ncols=columns, title=title or None)
        if rows == len(entries) or written.get_window_extent().width <= 0.98 * figure.bbox.width:
            return
        written.remove()


def colour_bar(figure: Figure, mappable: ScalarMappable, axes: Sequence[Axes], label: str, extend: str) -> Colorbar:
    """Draw the colour bar of some axes below them."""
    alone = len(axes) == 1
    bar = figure.colorbar(
        mappable,
        ax=list(axes),
        location="bottom",
        label=label,
        extend=extend,
        shrink=0.85 if alone else 0.6,
        pad=0.03,
        aspect=30 if alone else 45,
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
    places = [(axes, axes.get_subplotspec()) for axes in figure.axes]
    rows, columns = next(place.get_gridspec().get_geometry() for _, place in places if place)
    panels = [axes for axes, place in places if place]
    for _ in range(3):  # broken labels make axes narrower
        _place(figure)
        sides = [(axes, axes.get_window_extent().width) for axes in figure.axes]
        broken = [_break(text, wide, 0) for axes, wide in sides for text in (axes.title, axes.xaxis.label)]
        if not any(broken + [_break(axes.yaxis.label, box * wide, 1) for axes, wide in sides]):
            break
    size = figure.get_size_inches()
    wide, high = np.min([axes.get_position().size for axes in panels], axis=0) * size
    wanted = min(wide, (MOST_HEIGHT - size[1] + rows * high) / (rows * box))
    figure.set_size_inches(size[0] + columns * (wanted - wide), size[1] + rows * (wanted * box - high))
    for _ in range(3):
        _place(figure)
        held = figure.get_tightbbox()
        if min(*held.min, *(figure.get_size_inches() - held.max)) >= 0:  # else other ticks came with another size
            break
    for axes in panels:
        axes.set_box_aspect(box)
        axes.apply_aspect()
    figure.set_layout_engine("none")
    return figure


def _place(figure: Figure) -> None:
    """Place all by constrained layout, which measures a colour bar once for each of its axes: here once where it is."""
    engine: Any = figure.get_layout_engine()
    with ExitStack() as stack:
        for axes in figure.axes:  # of this figure alone, for other threads may draw others
            stack.enter_context(mock.patch.object(axes, "get_tightbbox", _measured_once(axes)))
        engine.execute(figure)


def _measured_once(axes: Axes) -> Callable[..., Any]:
    measured, known = axes.get_tightbbox, dict[Any, Any]()

    def reach(*args: Any, **options: Any) -> Any:
        here = axes.get_position(original=True).bounds
        known[here] = known.get(here) or measured(*args, **options)
        return known[here]

    return reach


def _break(text: Text, room: float, side: int) -> bool:
    """Break a text into lines that are no longer than so many pixels along x (0) or y (1); whether that changed it."""
    before = text.get_text()
    long = text.get_window_extent().size[side] if before else 0.0
    if long > 1.03 * room:
        lines = before.split("\n")
        letters = max(8, int(0.97 * max(map(len, lines)) * room / long))
        text.set_text("\n".join(part for line in lines for part in textwrap.wrap(line, letters)))
    return bool(text.get_text() != before)

"""Maps of a heliostat field: every mirror in its place, coloured by a value, several maps on one scale."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import Collection, PolyCollection
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from heliosweep.report.style import NO_VALUE, PAGE_WIDTH, new_figure, styled

#: Maps beside each other in one figure.
COLUMNS = 3

#: A mirror is drawn at least so large, as a part of the map's larger side, or it would vanish.
SMALLEST = 1 / 250

#: Height over width that a map's frame may have; a longer field gets empty land around it.
_ASPECTS = (0.45, 1.6)

_LEFT, _RIGHT, _TOP, _BOTTOM, _GAP, _BETWEEN = 0.58, 0.1, 0.36, 0.92, 0.12, 0.42
_WIDEST = {1: 4.2, 2: 3.2}
_EDGE = (0.0, 0.0, 0.0, 0.35)
_CROWD = 3000


@dataclass(frozen=True)
class FieldMap:
    """One map.

    Parameters
    ----------
    title : str
        Above the map; may have two lines.
    x, y : ndarray, shape (n,)
        Places of the mirrors east and north of the tower; NaN is left out. [m]
    width, height : ndarray, shape (n,)
        Sides of the mirrors. [m]
    values : ndarray, shape (n,)
        What is shown; NaN is grey.
    """

    title: str
    x: np.ndarray
    y: np.ndarray
    width: np.ndarray
    height: np.ndarray
    values: np.ndarray


def value_scale(maps: Sequence[FieldMap]) -> tuple[float, float]:
    """Ends of a common colour scale over all maps, rounded outwards to a tenth of the range's decade."""
    low, high = _extremes(maps)
    step = 10.0 ** math.floor(math.log10(max(high - low, 1e-2))) / 2
    ends = math.floor(low / step + 1e-9) * step, math.ceil(high / step - 1e-9) * step
    return ends if ends[0] < ends[1] else (ends[0] - step, ends[1] + step)


def difference_scale(maps: Sequence[FieldMap]) -> tuple[float, float]:
    """Ends of a common colour scale that is symmetric about zero."""
    low, high = _extremes(maps)
    end = max(abs(low), abs(high), 1e-3)
    step = 10.0 ** math.floor(math.log10(end)) / 2
    end = math.ceil(end / step - 1e-9) * step
    return -end, end


def _extremes(maps: Sequence[FieldMap]) -> tuple[float, float]:
    values = np.concatenate([one.values[np.isfinite(one.values)] for one in maps])
    return (float(values.min()), float(values.max())) if values.size else (0.0, 100.0)


def pages(maps: int, rows: int) -> list[slice]:
    """Share `maps` columns of maps among figures as evenly as can be.

    Parameters
    ----------
    maps : int
        Columns of maps.
    rows : int
        Maps in each column; with a single one, a figure takes two rows.

    Returns
    -------
    list of slice
        Columns of each figure.
    """
    room = COLUMNS if rows > 1 else 2 * COLUMNS
    sheets = max(1, math.ceil(maps / room))
    ends = [math.ceil(maps * sheet / sheets) for sheet in range(sheets + 1)]
    return [slice(start, stop) for start, stop in itertools.pairwise(ends)]


@styled
def map_figure(rows: Sequence[Sequence[FieldMap]], scale: tuple[float, float], label: str, colours: str) -> Figure:
    """Draw maps in rows and columns on one colour scale, with its bar below.

    Parameters
    ----------
    rows : sequence of sequences of FieldMap
        From top to bottom, from left to right; the last row may be shorter.
    scale : tuple of float
        Ends of the colour scale.
    label : str
        Of the colour bar, with the unit.
    colours : str
        Name of the colour map.

    Returns
    -------
    matplotlib.figure.Figure
    """
    columns = max(map(len, rows))
    x_ends, y_ends = _frame([one for row in rows for one in row])
    across = (PAGE_WIDTH - _LEFT - _RIGHT - _GAP * (columns - 1)) / columns
    across = min(across, _WIDEST.get(columns, across))
    up = across * (y_ends[1] - y_ends[0]) / (x_ends[1] - x_ends[0])
    width = _LEFT + columns * across + (columns - 1) * _GAP + _RIGHT
    height = _TOP + len(rows) * up + (len(rows) - 1) * _BETWEEN + _BOTTOM
    figure = new_figure(width, height)
    norm = Normalize(*scale)
    palette = colormaps[colours].with_extremes(bad=NO_VALUE)
    for i, row in enumerate(rows):
        for j, one in enumerate(row):
            left, bottom = _LEFT + j * (across + _GAP), _BOTTOM + (len(rows) - 1 - i) * (up + _BETWEEN)
            axes = figure.add_axes((left / width, bottom / height, across / width, up / height))
            axes.set(xlim=x_ends, ylim=y_ends)
            _draw(axes, one, norm, palette, 72 * across / (x_ends[1] - x_ends[0]))
            last = i == len(rows) - 1 or j >= len(rows[i + 1])
            _label_sides(axes, left=j == 0, bottom=last)
    bar = figure.add_axes((0.32, 0.38 / height, 0.6, 0.1 / height))
    figure.colorbar(ScalarMappable(norm, palette), cax=bar, orientation="horizontal").outline.set_linewidth(0.5)
    bar.set_xlabel(label, labelpad=2)
    bar.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 5, 10]))
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="center left", bbox_to_anchor=(0.02, 0.43 / height), handletextpad=0.2)
    return figure


def magnification(maps: Sequence[FieldMap]) -> float:
    """How many times larger than to scale mirrors are drawn, at least 1."""
    x_ends, y_ends = _frame(maps)
    smallest = SMALLEST * max(x_ends[1] - x_ends[0], y_ends[1] - y_ends[0])
    sides = np.concatenate([np.minimum(one.width, one.height) for one in maps])
    sides = sides[np.isfinite(sides) & (sides > 0)]
    return max(1.0, float(smallest / np.median(sides))) if sides.size else 1.0


def _frame(maps: Sequence[FieldMap]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Common ends of the axes: all mirrors and the tower, a margin, and a shape that fits a page."""
    x, y, size = (np.concatenate([getattr(one, name) for one in maps]) for name in ("x", "y", "width"))
    ends = [(min(0.0, _least(axis)), max(0.0, _most(axis))) for axis in (x, y)]
    largest = max(high - low for low, high in ends)
    margin = max(0.04 * largest, 1.2 * _most(size), 1.0)
    spans = [high - low + 2 * margin for low, high in ends]
    spans = [max(spans[0], spans[1] / _ASPECTS[1]), max(spans[1], spans[0] * _ASPECTS[0])]
    (left, right), (bottom, top) = (
        ((low + high - span) / 2, (low + high + span) / 2) for (low, high), span in zip(ends, spans, strict=True)
    )
    return (left, right), (bottom, top)


def _least(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.min()) if finite.size else 0.0


def _most(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0


def _draw(axes: Axes, one: FieldMap, norm: Normalize, colours: Colormap, points: float) -> None:
    """Mirrors, tower and title of one map; a metre is so many `points` long."""
    placed = np.isfinite(one.x) & np.isfinite(one.y)
    x, y, values = one.x[placed], one.y[placed], np.ma.masked_invalid(one.values[placed])
    grow = magnification([one])
    width, height = grow * one.width[placed], grow * one.height[placed]
    # Without a hair-thin edge pale mirrors would vanish; in a crowd it would darken all, and no one sees which way
    # a mirror is turned.
    squares: Collection
    if x.size <= _CROWD:
        corners: Any = _corners(x, y, width, height)  # one array is much faster than a list of them
        squares = PolyCollection(corners, edgecolors=_EDGE, linewidths=0.3)
        axes.add_collection(squares, autolim=False)
    else:
        squares = axes.scatter(x, y, width * height * points**2, marker="s", linewidths=0)
    squares.set(array=values, cmap=colours, norm=norm, rasterized=True)
    axes.plot(0, 0, "^", color="black", markersize=5, markeredgecolor="white", markeredgewidth=0.6, label="tower")
    axes.set_title(one.title, pad=3, linespacing=1.25)


def _corners(x: np.ndarray, y: np.ndarray, width: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Corners of mirrors laid flat with one side towards the tower, shape (n, 4, 2)."""
    centre = np.stack([x, y], axis=-1)
    far = np.hypot(x, y)[:, np.newaxis]
    outwards = np.divide(centre, far, out=np.tile([0.0, 1.0], (x.size, 1)), where=far > 0)
    along = np.stack([outwards[:, 1], -outwards[:, 0]], axis=-1) * width[:, np.newaxis] / 2
    outwards = outwards * height[:, np.newaxis] / 2
    return np.stack([centre + i * along + j * outwards for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))], axis=1)


def _label_sides(axes: Axes, left: bool, bottom: bool) -> None:
    """Label the outer sides; ticks keep away from the corners, where those of the next map would touch."""
    sides = ((axes.xaxis, axes.get_xlim(), bottom, "east (m)"), (axes.yaxis, axes.get_ylim(), left, "north (m)"))
    for axis, (low, high), shown, name in sides:
        margin = 0.06 * (high - low)
        ticks = np.asarray(MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(low, high))
        axis.set_ticks(ticks[(ticks > low + margin) & (ticks < high - margin)])
        if shown:
            axis.set_label_text(name)
    axes.tick_params(labelbottom=bottom, labelleft=left)
    axes.yaxis.labelpad = 1

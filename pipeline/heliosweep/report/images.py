"""Pictures of maps on a plane: rows and columns on one colour scale, the same metre everywhere, parts outlined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from heliosweep.report.shades import Kinds, Shades
from heliosweep.report.style import NO_VALUE, PAGE_WIDTH, new_figure, styled

#: Height over width that the frame of a picture may have; a longer mirror gets empty room beside it.
_ASPECTS = (0.4, 1.6)

#: Largest height of a figure. [inch]
_HIGHEST = 9.6

#: Widest picture by the number of columns. [inch]
_WIDEST = {1: 3.6, 2: 2.7}

_LEFT, _NAME, _RIGHT, _GAP, _FOOT, _BAR, _TITLE, _LINE = 0.55, 0.15, 0.1, 0.12, 0.45, 0.55, 0.14, 0.18
_BETWEEN, _LETTER = 0.1, 0.068
_OUTLINE: dict[str, Any] = {"facecolor": "none", "edgecolor": "#333333", "linewidth": 0.5}


@dataclass(frozen=True)
class Outline:
    """Rectangle that is drawn on every picture.

    Parameters
    ----------
    x, y : float
        Centre. [m]
    width, height : float
        Sides. [m]
    text : str
        Written at its centre on the first picture.
    """

    x: float
    y: float
    width: float
    height: float
    text: str = ""


@dataclass(frozen=True)
class Ground:
    """What all pictures of a figure show.

    Parameters
    ----------
    x, y : ndarray, shape (nx,), (ny,)
        Centres of the pixels, evenly spaced, rising or falling. [m]
    x_label, y_label : str
        Of the axes, with the unit.
    outlines : sequence of Outline
        Parts of the plane.
    """

    x: np.ndarray
    y: np.ndarray
    x_label: str
    y_label: str
    outlines: Sequence[Outline] = ()

    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge of the pixels. [m]"""
        steps = [float(np.abs(np.diff(side)).mean()) for side in (self.x, self.y) if side.size > 1]
        ends: list[float] = []
        for side in (self.x, self.y):
            step = float(np.abs(np.diff(side)).mean()) if side.size > 1 else min(steps, default=1.0)
            ends += [float(side.min()) - step / 2, float(side.max()) + step / 2]
        return ends[0], ends[1], ends[2], ends[3]

    def frame(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ends of the axes: pixels and outlines with a rim, in a shape that fits a page."""
        left, right, bottom, top = self.extent()
        for one in self.outlines:
            left, right = min(left, one.x - one.width / 2), max(right, one.x + one.width / 2)
            bottom, top = min(bottom, one.y - one.height / 2), max(top, one.y + one.height / 2)
        rim = 0.02 * max(right - left, top - bottom)
        wide, high = right - left + 2 * rim, top - bottom + 2 * rim
        wide, high = max(wide, high / _ASPECTS[1]), max(high, wide * _ASPECTS[0])
        x, y = (left + right) / 2, (bottom + top) / 2
        return (x - wide / 2, x + wide / 2), (y - high / 2, y + high / 2)


@dataclass(frozen=True)
class Picture:
    """One picture.

    Parameters
    ----------
    values : ndarray, shape (ny, nx)
        What is shown; NaN is grey.
    title : str
        Above it; may have two lines.
    """

    values: np.ndarray
    title: str = ""


@dataclass(frozen=True)
class Row:
    """Pictures beside each other.

    Parameters
    ----------
    pictures : sequence of Picture
        From left to right.
    name : str
        Left of them; may have two lines.
    """

    pictures: Sequence[Picture]
    name: str = ""


@styled
def picture_figure(rows: Sequence[Row], ground: Ground, colours: Shades | Kinds) -> Figure:
    """Draw pictures in rows and columns, with their colour bar or legend below.

    Parameters
    ----------
    rows : sequence of Row
        From top to bottom; shorter ones leave their right end empty.
    ground : Ground
        What the pictures show.
    colours : Shades or Kinds
        What the colours of all of them mean.

    Returns
    -------
    matplotlib.figure.Figure
    """
    columns = max(len(row.pictures) for row in rows)
    x_ends, y_ends = ground.frame()
    aspect = (y_ends[1] - y_ends[0]) / (x_ends[1] - x_ends[0])
    start = _LEFT + _NAME * max(1 + row.name.count("\n") if row.name else 0 for row in rows)
    titles = [max((1 + one.title.count("\n") if one.title else 0) for one in row.pictures) for row in rows]
    heads = [_TITLE * lines + _BETWEEN for lines in titles]
    names = _words(colours)
    abreast = max(1, int((PAGE_WIDTH - 0.3) / (0.5 + _LETTER * max(map(len, names), default=1))))
    foot = _FOOT + (_BAR if isinstance(colours, Shades) else _LINE * -(-len(names) // abreast))
    across = (PAGE_WIDTH - start - _RIGHT - _GAP * (columns - 1)) / columns
    across = min(across, _WIDEST.get(columns, across), (_HIGHEST - sum(heads) - foot) / (len(rows) * aspect))
    up = across * aspect
    width = max(start + columns * across + (columns - 1) * _GAP + _RIGHT, _least_width(colours))
    height = sum(heads) + len(rows) * up + foot
    figure = new_figure(width, height)
    palette, norm = _palette(colours)
    bottom = height
    for i, row in enumerate(rows):
        bottom -= heads[i] + up
        for j, one in enumerate(row.pictures):
            left = start + j * (across + _GAP)
            axes = figure.add_axes((left / width, bottom / height, across / width, up / height))
            axes.set(xlim=x_ends, ylim=y_ends)
            axes.set_title(one.title, pad=3, linespacing=1.25)
            _draw(axes, one, ground, palette, norm)
            if i == 0 and j == 0:
                _number(axes, ground)
            last = i == len(rows) - 1 or j >= len(rows[i + 1].pictures)
            _label_sides(axes, ground, left=j == 0, bottom=last, wide=across)
        if row.name:
            place = ((start - _LEFT + 0.04) / width, (bottom + up / 2) / height)
            figure.text(*place, row.name, rotation=90, ha="right", va="center", multialignment="center")
    if isinstance(colours, Shades):
        _bar(figure, colours, palette, norm, [one for row in rows for one in row.pictures])
    else:
        shown = {
            value for row in rows for one in row.pictures for value in np.unique(one.values[np.isfinite(one.values)])
        }
        patches = [
            Patch(facecolor=colour, edgecolor="#666666", linewidth=0.5, label=word)
            for value, (word, colour) in colours.looks.items()
            if value in shown
        ]
        if patches:
            figure.legend(handles=patches, loc="lower center", ncols=min(abreast, len(patches)), borderaxespad=0.3)
    return figure


def _words(colours: Shades | Kinds) -> list[str]:
    return [] if isinstance(colours, Shades) else [word for word, _ in colours.looks.values()]


def _least_width(colours: Shades | Kinds) -> float:
    """Width that the words below need. [inch]"""
    words = [colours.label] if isinstance(colours, Shades) else _words(colours)
    return min(PAGE_WIDTH, 0.6 + _LETTER * max(map(len, words), default=0))


def _palette(colours: Shades | Kinds) -> tuple[Colormap, Normalize]:
    if isinstance(colours, Shades):
        return colormaps[colours.palette].with_extremes(bad=NO_VALUE), Normalize(colours.low, colours.high)
    values = sorted(colours.looks)
    palette = ListedColormap([colours.looks[value][1] for value in values])
    edges = [values[0] - 0.5, *(value + 0.5 for value in values)]
    return palette.with_extremes(bad=NO_VALUE), BoundaryNorm(edges, len(values))


def _draw(axes: Axes, one: Picture, ground: Ground, palette: Colormap, norm: Normalize) -> None:
    """Pixels and outlines of one picture."""
    turned = (slice(None, None, -1 if side.size > 1 and side[0] > side[-1] else 1) for side in (ground.y, ground.x))
    values = np.ma.masked_invalid(one.values[tuple(turned)].astype(float))
    axes.imshow(
        values,
        cmap=palette,
        norm=norm,
        extent=ground.extent(),
        origin="lower",
        interpolation="nearest",
        aspect="auto",
        rasterized=True,
    )
    axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())
    for part in ground.outlines:
        corner = (part.x - part.width / 2, part.y - part.height / 2)
        axes.add_patch(Rectangle(corner, part.width, part.height, **_OUTLINE))


def _number(axes: Axes, ground: Ground) -> None:
    """Write what the outlines are called."""
    for part in ground.outlines:
        halo = [withStroke(linewidth=1.6, foreground="white")]
        axes.text(part.x, part.y, part.text, ha="center", va="center", fontsize=6.5, path_effects=halo)


def _label_sides(axes: Axes, ground: Ground, left: bool, bottom: bool, wide: float) -> None:
    """Label the outer sides; ticks keep away from the corners, where those of the next picture would touch."""
    most = 5 if wide > 1.3 else 3
    sides = ((axes.xaxis, axes.get_xlim(), bottom, ground.x_label), (axes.yaxis, axes.get_ylim(), left, ground.y_label))
    for axis, (low, high), shown, label in sides:
        margin = 0.06 * (high - low)
        ticks = np.asarray(MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high))
        axis.set_ticks(ticks[(ticks > low + margin) & (ticks < high - margin)])
        if shown:
            axis.set_label_text(label)
    axes.tick_params(labelbottom=bottom, labelleft=left, bottom=bottom, left=left)
    axes.xaxis.labelpad, axes.yaxis.labelpad = 2, 1


def _bar(figure: Figure, colours: Shades, palette: Colormap, norm: Normalize, pictures: Sequence[Picture]) -> None:
    """Colour bar, with pointed ends where values lie beyond."""
    width, height = figure.get_size_inches()
    values = np.concatenate([one.values[np.isfinite(one.values)] for one in pictures])
    slack = 1e-9 * (colours.high - colours.low)
    below, above = bool((values < colours.low - slack).any()), bool((values > colours.high + slack).any())
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get((below, above), "neither")
    long = min(4.2, 0.75 * width)
    bar = figure.add_axes(((width - long) / 2 / width, 0.38 / height, long / width, 0.1 / height))
    mappable = ScalarMappable(norm, palette)
    figure.colorbar(mappable, cax=bar, orientation="horizontal", extend=extend).outline.set_linewidth(0.5)
    bar.set_xlabel(colours.label, labelpad=2)
    bar.xaxis.set_major_locator(MaxNLocator(5 if long < 3 else 7, steps=[1, 2, 2.5, 5, 10]))

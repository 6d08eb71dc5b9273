"""Intervals: values with unequal error bars over words, beside each other, and marks of what they are held against."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from heliosweep.report.style import COLOURS, MARKERS, PAGE_WIDTH, new_figure, styled

#: Panels beside each other.
COLUMNS = 4

#: More letters than this in each word and they are written upwards. [letters per inch]
_LETTERS = 13.0

_LEFT, _RIGHT, _GAP, _FOOT, _UP, _TITLE, _LETTER = 0.7, 0.1, 0.1, 0.24, 1.75, 0.24, 0.068
_DIGIT, _SHORT = 0.06, 4
_STEPS = MaxNLocator(6, steps=[1, 2, 5, 10])
_WIDEST = {1: 4.2, 2: 3.2}


@dataclass(frozen=True)
class Interval:
    """One value for each word.

    Parameters
    ----------
    value : ndarray, shape (n,)
        Middle; none is drawn where it is missing.
    low, high : ndarray, shape (n,), optional
        Ends of the bar; none where missing.
    """

    value: np.ndarray
    low: np.ndarray | None = None
    high: np.ndarray | None = None


@dataclass(frozen=True)
class Beside:
    """One panel.

    Parameters
    ----------
    words : sequence of str
        Along the horizontal axis.
    series : mapping of str to Interval
        By name; the same name looks the same in every panel.
    title : str
        Above it.
    marks : ndarray, shape (n,), optional
        Values that are held against, a bar across the place of each word.
    """

    words: Sequence[str]
    series: Mapping[str, Interval]
    title: str = ""
    marks: np.ndarray | None = None


@dataclass(frozen=True)
class Strip:
    """Panels beside each other with the same value axis.

    Parameters
    ----------
    label : str
        Of the value axis, with the unit.
    panels : sequence of Beside
        From left to right.
    """

    label: str
    panels: Sequence[Beside]


@dataclass(frozen=True)
class Around:
    """What stands around the panels.

    Parameters
    ----------
    x_label : str
        What the words are.
    mark : str
        What the marks are, in the legend.
    legend : str
        What the names are, above the legend.
    colours : mapping of str to str
        Of some names; the others take theirs in the order of use.
    """

    x_label: str = ""
    mark: str = ""
    legend: str = ""
    colours: Mapping[str, str] = field(default_factory=dict)


@styled
def interval_figure(
    strips: Sequence[Strip], around: Around, *, floor: float | None = None, least_span: float = 0.0
) -> Figure:
    """Draw panels in strips, with one legend above them.

    Parameters
    ----------
    strips : sequence of Strip
        From top to bottom.
    around : Around
        Words of the figure.
    floor : float, optional
        Value axes are logarithmic, and values below this one are drawn there, without a filling.
    least_span : float
        Least height of a value axis that is not. [unit of the axis]

    Returns
    -------
    matplotlib.figure.Figure
    """
    columns = max(len(strip.panels) for strip in strips)
    panels = [panel for strip in strips for panel in strip.panels]
    names = list(dict.fromkeys(name for panel in panels for name in panel.series))
    ends = [_ends(strip, floor, least_span) for strip in strips]
    start = _LEFT + _DIGIT * max(0, *(_digits(end) - _SHORT for end in ends))
    across = (PAGE_WIDTH - start - _RIGHT - _GAP * (columns - 1)) / columns
    across = min(across, _WIDEST.get(columns, across))
    most = max(sum(map(len, panel.words)) + 2 * len(panel.words) for panel in panels)
    upright = most > _LETTERS * across * 1.2
    foot = (
        _FOOT + 0.14 * bool(around.x_label) + (_LETTER * max(len(w) for p in panels for w in p.words) if upright else 0)
    )
    marked = any(panel.marks is not None and np.isfinite(panel.marks).any() for panel in panels)
    looks = _looks(names, around.colours)
    handles = {name: _handle(*looks[name]) for name in names if name}
    if marked:
        handles[around.mark] = Line2D([], [], color="black", linewidth=2.0)
    width = start + columns * across + (columns - 1) * _GAP + _RIGHT
    width = max(width, min(PAGE_WIDTH, 0.7 + _LETTER * max(map(len, [*handles, around.legend]), default=0)))
    abreast = max(1, int(width / (0.55 + _LETTER * max(map(len, handles), default=1))))
    lines = (-(-len(handles) // abreast) + bool(around.legend)) if handles else 0
    titles = [_TITLE if any(panel.title for panel in strip.panels) else 0.1 for strip in strips]
    head = 0.06 + 0.175 * lines
    height = head + sum(titles) + len(strips) * _UP + foot
    figure = new_figure(width, height)
    bottom = height - head
    for index, strip in enumerate(strips):
        bottom -= titles[index] + _UP
        first: Axes | None = None
        for column, panel in enumerate(strip.panels):
            place = (start + column * (across + _GAP)) / width, bottom / height, across / width, _UP / height
            axes = figure.add_axes(place, sharey=first)
            first = first or axes
            axes.set_title(panel.title, pad=3)
            axes.grid(True, axis="y")
            _draw(axes, panel, looks, floor)
            last = index == len(strips) - 1 or column >= len(strips[index + 1].panels)
            axes.set_xticks(range(len(panel.words)), panel.words, rotation=90 if upright else 0)
            axes.set_xlim(-0.5, len(panel.words) - 0.5)
            axes.tick_params(labelbottom=last, labelleft=column == 0)
            axes.tick_params(axis="x", length=0)
            if last:
                axes.set_xlabel(around.x_label, labelpad=2)
        if first is not None:
            first.set_ylabel(strip.label)
            _scale(first, ends[index], floor is not None)
    if handles:
        figure.legend(
            list(handles.values()),
            list(handles),
            loc="upper center",
            ncols=min(abreast, len(handles)),
            borderaxespad=0.3,
            title=around.legend or None,
        )
    return figure


def _looks(names: Sequence[str], given: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Colour and marker of each name."""
    free = cycle(colour for colour in COLOURS if colour not in given.values())
    return {name: (given.get(name) or next(free), marker) for name, marker in zip(names, cycle(MARKERS), strict=False)}


def _handle(colour: str, marker: str) -> Line2D:
    return Line2D([], [], color=colour, marker=marker, markersize=4, linewidth=1)


def _draw(axes: Axes, panel: Beside, looks: Mapping[str, tuple[str, str]], floor: float | None) -> None:
    """Points of a panel: those at the same word beside each other, as many as there are."""
    for place in range(len(panel.words)):
        axes.axvline(place + 0.5, color="#e2e2e2", linewidth=0.5, zorder=0)
        here = [name for name, one in panel.series.items() if np.isfinite(one.value[place])]
        for rank, name in enumerate(here):
            x = place + (rank - (len(here) - 1) / 2) * min(0.7 / len(here), 0.22)
            colour, marker = looks[name]
            one = panel.series[name]
            value = float(one.value[place])
            shown = value if floor is None else max(value, floor)
            if one.low is not None and one.high is not None:
                low, high = float(one.low[place]), float(one.high[place])
                if np.isfinite(low) and np.isfinite(high):
                    low, high = (low, high) if floor is None else (max(low, floor), max(high, floor))
                    axes.plot([x, x], [low, high], color=colour, linewidth=1, marker="_", markersize=4)
            axes.plot(
                x,
                shown,
                color=colour,
                marker=marker,
                markersize=4,
                markeredgewidth=0.8,
                markerfacecolor="white" if shown > value else colour,
                clip_on=False,
                zorder=3,
            )
        if panel.marks is not None and np.isfinite(panel.marks[place]):
            axes.plot([place - 0.4, place + 0.4], [panel.marks[place]] * 2, color="black", linewidth=1.8, zorder=2.5)


def _ends(strip: Strip, floor: float | None, least_span: float) -> tuple[float, float]:
    """Ends of a value axis about all that is drawn; from its floor where there is one."""
    parts = [part for panel in strip.panels for one in panel.series.values() for part in (one.value, one.low, one.high)]
    parts += [panel.marks for panel in strip.panels]
    values = np.concatenate([np.ravel(part) for part in parts if part is not None] or [np.empty(0)])
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    if floor is None:
        half = max(1.16 * (high - low), least_span) / 2 or 0.5
        return (low + high) / 2 - half, (low + high) / 2 + half
    return max(floor, low / 1.8), 1.8 * max(high, 10 * floor)


def _digits(ends: tuple[float, float]) -> int:
    """Letters of the longest number beside the ticks of an axis."""
    ticks = _STEPS.tick_values(*ends)
    decimals = max(0, -math.floor(math.log10(float(np.diff(ticks).min())) + 1e-9))
    return max(len(f"{tick:.{decimals}f}") for tick in ticks)


def _scale(axes: Axes, ends: tuple[float, float], logarithmic: bool) -> None:
    """Ticks of a value axis at round numbers, written plainly."""
    if logarithmic:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if ends[1] > 300 * ends[0] else (1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.set_ylim(*ends)

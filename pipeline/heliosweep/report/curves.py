"""Curves: several quantities over one axis, a panel each, the same lines in every panel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from typing import Any, Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, FuncFormatter, LogLocator, MaxNLocator, MultipleLocator, NullFormatter

from heliosweep.report.labels import latitude_text
from heliosweep.report.style import COLOURS, DASHES, MARKERS, PAGE_WIDTH, VALUES, PlainPowers, new_figure, styled

#: More points than this are drawn without markers.
MARKED = 40

#: More words than this along a horizontal axis are written upwards.
WORDS_ABREAST = 7

#: Width of a letter of a legend or tick. [inch]
LETTER = 0.065

#: Least height of a value axis, or rounding errors would look like mountains. [unit of the axis]
LEAST_SPAN = 0.1

_WORDS = "OU"


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Parameters
    ----------
    label : str
        Of the value axis, with the unit.
    lines : mapping of str to (x, y)
        Values by the name of the line; the same name looks the same in every panel. Either may be dates. Dates on the
        value axis and words on the horizontal one are points without a line between them.
    title : str
        Above the panel, if any.
    bands : mapping of str to ndarray
        Half-width of the band about a line, in the unit of the axis, or those below and above it, shape (2, n); error
        bars where the horizontal axis is words.
    """

    label: str
    lines: Mapping[str, tuple[np.ndarray, np.ndarray]]
    title: str = ""
    bands: Mapping[str, np.ndarray] = field(default_factory=dict)


@styled
def curve_figure(
    panels: Sequence[Panel],
    x_label: str,
    *,
    columns: int = 2,
    latitude: bool = False,
    logarithmic: bool = False,
    logarithmic_values: bool = False,
    same_scale: bool | Literal["row"] = False,
    legend: str = "",
    ordered: bool = False,
    step: float | None = None,
    least_span: float = LEAST_SPAN,
    ceiling: float | None = None,
    looks: Mapping[str, dict[str, Any]] | None = None,
) -> Figure:
    """Draw panels in rows of at most `columns`, with one legend above them.

    Parameters
    ----------
    panels : sequence of Panel
        In reading order.
    x_label : str
        Of the common horizontal axis, with the unit.
    columns : int
        Panels beside each other.
    latitude : bool
        Whether the horizontal axis is latitude, ticked with hemispheres.
    logarithmic : bool
        Whether the horizontal axis is logarithmic.
    logarithmic_values : bool
        Whether the value axes are; values must be positive or missing.
    same_scale : bool or "row"
        Whether all value axes, or those of each row, have the same ends.
    legend : str
        What the names of the lines are, above the legend.
    ordered : bool
        Whether the lines follow a number: colours then go from dark to light.
    step : float, optional
        Distance of the ticks of the horizontal axis; chosen by the range where left out.
    least_span : float
        Least height of a value axis. [unit of the axis]
    ceiling : float, optional
        What no value can exceed, such as 100 %: no value axis goes on beyond it.
    looks : mapping of str to dict, optional
        What is special in the look of some lines, as matplotlib's properties.

    Returns
    -------
    matplotlib.figure.Figure
    """
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    words = _words(panels)
    width = PAGE_WIDTH if columns > 1 or len(words) > WORDS_ABREAST else 4.6
    names = list(dict.fromkeys(name for panel in panels for name in panel.lines))
    abreast = _abreast(names, width)
    head = 0.34 + 0.17 * (-(-len(names) // abreast) - 1 + bool(legend)) + 0.2 * any(panel.title for panel in panels)
    foot = 0.5 + LETTER * (max(map(len, words)) - 1 if len(words) > WORDS_ABREAST else 0)
    height = head + rows * (2.15 if rows > 1 else 2.6) + foot - 0.2
    figure = new_figure(width, height)
    grid = figure.subplots(rows, columns, sharex=True, sharey=same_scale, squeeze=False).ravel()
    figure.subplots_adjust(
        left=0.6 / width,
        right=1 - 0.12 / width,
        bottom=foot / height,
        top=1 - head / height,
        wspace=0.12 if same_scale else 0.27,
        hspace=0.2 if any(panel.title for panel in panels) else 0.1,
    )
    for index, (axes, panel) in enumerate(zip(grid, panels, strict=False)):
        _draw(axes, panel, _looks(names, ordered, looks or {}))
        if logarithmic_values:
            _logarithmic(axes)
        if step:
            axes.xaxis.set_major_locator(MultipleLocator(step))
        elif logarithmic:
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(PlainPowers())
            axes.xaxis.set_minor_formatter(PlainPowers(labelOnlyBase=False))
        elif latitude:
            axes.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 1.5, 2, 3, 5, 10]))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: latitude_text(round(value, 6))))
        elif columns > 1 and isinstance(axes.xaxis.get_major_locator(), AutoLocator):
            axes.locator_params(axis="x", nbins=7)
        axes.set_title(panel.title)
        if index % columns == 0 or not same_scale:
            axes.set_ylabel(panel.label)
        if index + columns >= len(panels):
            axes.set_xlabel(x_label)
            axes.tick_params(labelbottom=True)
    together = {True: len(panels), "row": columns, False: 1}[same_scale]
    for start in range(0, 0 if logarithmic_values else len(panels), together):
        part = slice(start, min(start + together, len(panels)))
        _heighten(list(grid[part]), panels[part], least_span)
    for axes in grid[len(panels) :]:
        axes.remove()
    handles = {name: line for axes in grid[::-1] for line, name in zip(*axes.get_legend_handles_labels(), strict=True)}
    if ceiling is not None:
        for axes in grid[: len(panels)]:
            low, high = axes.get_ylim()
            axes.set_ylim(top=min(high, ceiling + 0.05 * (ceiling - low)))
    if len(names) > 1 or names[0]:
        drawn = [name for name in names if _has_values(panels, name)] or names
        figure.legend(
            [handles[name] for name in drawn],
            drawn,
            loc="upper center",
            ncols=abreast,
            borderaxespad=0.4,
            title=legend or None,
        )
    cut = -figure.get_tightbbox().x0
    if cut > 0:  # long numbers beside the ticks
        figure.subplots_adjust(left=(0.62 + cut) / width)
    return figure


def _has_values(panels: Sequence[Panel], name: str) -> bool:
    """Whether a line has a value in any panel."""
    return any(not np.isnan(panel.lines[name][1]).all() for panel in panels if name in panel.lines)


def _words(panels: Sequence[Panel]) -> np.ndarray:
    """Words along the horizontal axis, if there are words."""
    x = next(iter(panels[0].lines.values()))[0]
    return x if x.dtype.kind in _WORDS else x[:0].astype(str)


def _abreast(names: Sequence[str], width: float) -> int:
    """Names of lines beside each other in the legend, in rows that are as even as can be."""
    fit = max(1, int(width / (0.55 + LETTER * max(map(len, names)))))
    return -(-len(names) // -(-len(names) // fit))


def _looks(names: Sequence[str], ordered: bool, special: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Colour, dashes and marker of each line."""
    colours = colormaps[VALUES](np.linspace(0.0, 0.85, len(names))) if ordered else COLOURS
    dashes = ("-",) if ordered else DASHES
    return {
        name: {"color": colour, "linestyle": dash, "marker": marker, **special.get(name, {})}
        for name, colour, dash, marker in zip(names, cycle(colours), cycle(dashes), cycle(MARKERS), strict=False)
    }


def _draw(axes: Axes, panel: Panel, looks: Mapping[str, dict[str, Any]]) -> None:
    axes.grid(True)
    for name, (x, y) in panel.lines.items():
        look = {**looks[name], "markeredgewidth": 0, "label": name}
        if len(x) > MARKED:
            look["marker"] = ""
        half = panel.bands.get(name)
        if x.dtype.kind in _WORDS:
            # Lines of the same word stand beside each other.
            beside = (list(panel.lines).index(name) - (len(panel.lines) - 1) / 2) * 0.6 / len(panel.lines)
            look |= {"linestyle": "", "marker": looks[name]["marker"], "markeredgewidth": 1}
            axes.errorbar(np.arange(len(x)) + beside, y, half, **look, capsize=2, elinewidth=1)
            axes.set_xticks(np.arange(len(x)), x, rotation=90 if len(x) > WORDS_ABREAST else 0)
            axes.set_xlim(-0.5, len(x) - 0.5)
            continue
        if half is not None:
            below, above = np.broadcast_to(half, (2, len(y)))
            axes.fill_between(x, y - below, y + above, color=look["color"], alpha=0.2, linewidth=0)
        if y.dtype.kind == "M":
            look |= {"linestyle": "", "marker": looks[name]["marker"]}
        axes.plot(x, y, **look)
    x, y = next(iter(panel.lines.values()))
    for axis, values in ((axes.xaxis, x), (axes.yaxis, y)):
        if values.dtype.kind == "M":
            _date_ticks(axis)


def _heighten(group: Sequence[Axes], panels: Sequence[Panel], least_span: float) -> None:
    """Give value axes with the same ends at least a height, about all of their values."""
    lines = [y for panel in panels for _, y in panel.lines.values()]
    if any(y.dtype.kind == "M" for y in lines):
        return
    values = np.concatenate(lines)
    values = values[np.isfinite(values)]
    if values.size and np.ptp(values) < least_span:
        middle = (values.min() + values.max()) / 2
        for axes in group:
            axes.set_ylim(middle - least_span, middle + least_span)


def _logarithmic(axes: Axes) -> None:
    """Logarithmic value axis over at least a factor of four, with plain numbers."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    if high < 4 * low:
        middle = (low * high) ** 0.5
        axes.set_ylim(middle / 2, middle * 2)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 2000 * low else (1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _date_ticks(axis: Axis) -> None:
    """Months by name, the year with January, no more ticks than a small panel has room for."""
    locator = AutoDateLocator(minticks=3, maxticks=7)
    axis.set_major_locator(locator)
    axis.set_major_formatter(ConciseDateFormatter(locator, show_offset=False))

"""Panels of curves, and of values with error bars over words: the same lines in every panel, one legend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from typing import Any, Literal

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from heliosweep.report.colours import COLOURS, DASHES, MARKERS, VALUES
from heliosweep.report.labels import folded, value_text
from heliosweep.report.layout import fit, label_outside, legend, sheet, tick, tick_decades
from heliosweep.report.selection import Point, Shown, at
from heliosweep.report.style import styled

#: More points than this are drawn without markers.
MARKED = 40

#: More letters than this along all horizontal axes of a row are written upwards.
LETTERS = 90

#: Least height of a value axis, or rounding errors would look like mountains. [unit of the axis]
LEAST_SPAN = 0.1

_WORDS = "OU"
_POINT: dict[str, Any] = {"linestyle": "", "markersize": 4}


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Parameters
    ----------
    label : str
        Of the value axis, with the unit.
    lines : mapping of str to DataArray
        Values along the same dimension by the name of the line; the same name looks the same in every panel. Along
        words they are points beside each other, dates are points, numbers are curves in the order of the numbers.
    title : str
        Above the panel, if any.
    bands : mapping of str to (DataArray, DataArray)
        Lower and upper end of the band about a line, or of the bars about points.
    marks : DataArray, optional
        Values that points over words are held against, a bar across the place of each word.
    least_span : float, optional
        Least height of the value axis, in place of that of the figure. [unit of the axis]
    """

    label: str
    lines: Mapping[str, xr.DataArray]
    title: str = ""
    bands: Mapping[str, tuple[xr.DataArray, xr.DataArray]] = field(default_factory=dict)
    marks: xr.DataArray | None = None
    least_span: float | None = None


def panels_over(
    shown: Shown,
    array: xr.DataArray,
    label: str,
    stands: Point,
    lines: Sequence[Point] = ({},),
    panels: Sequence[Point] = ({},),
    band: tuple[xr.DataArray, xr.DataArray] | None = None,
) -> list[Panel]:
    """Panels of an array along the one dimension that is left: a line for each of some points, a panel for others.

    Parameters
    ----------
    shown : Shown
        The result, for the names of lines and panels.
    array : DataArray
        Values; numbers that the points do not fix stand where `stands` says.
    label : str
        Of the value axes, with the unit.
    stands, lines, panels : dict and sequences of dict
        Positions by dimension.
    band : (DataArray, DataArray), optional
        Lower and upper end of the bands about the lines.
    """
    return [
        Panel(
            label,
            {shown.values(line): at(array, stands, line, panel) for line in lines},
            shown.fulls(panel),
            {shown.values(line): (at(band[0], stands, line, panel), at(band[1], stands, line, panel)) for line in lines}
            if band
            else {},
        )
        for panel in panels
    ]


@styled
def curve_figure(
    panels: Sequence[Panel],
    x_label: str,
    *,
    columns: int = 2,
    same_scale: bool | Literal["row"] = False,
    logarithmic: bool = False,
    logarithmic_values: bool = False,
    floor: float | None = None,
    least_span: float = LEAST_SPAN,
    ceiling: float | None = None,
    legend_title: str = "",
    mark: str = "",
    ordered: bool = False,
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
    same_scale : bool or "row"
        Whether all value axes, or those of each row, have the same ends.
    logarithmic, logarithmic_values : bool
        Whether the horizontal axis and the value axes are logarithmic; values must be positive or missing.
    floor : float, optional
        Value axes are logarithmic and begin here; lower values are drawn there, points without a filling.
    least_span : float
        Least height of a value axis. [unit of the axis]
    ceiling : float, optional
        What no value can exceed, such as 100 %: no value axis goes on beyond it.
    legend_title, mark : str
        What the names of the lines and what the marks are, in the legend.
    ordered : bool
        Whether the lines follow a number: colours then go from dark to light.
    looks : mapping of str to dict, optional
        What is special in the look of some lines, as matplotlib's properties.

    Returns
    -------
    matplotlib.figure.Figure
    """
    columns = min(columns, len(panels))
    along = _coordinate(next(iter(panels[0].lines.values())))
    names = list(dict.fromkeys(name for panel in panels for name in panel.lines))
    styles = _looks(names, ordered, looks or {})
    plain = [value_text(word).replace("_", " ") for word in along] if along.dtype.kind in _WORDS else []
    words = [folded(word, number) for number, word in enumerate(plain, 1)]
    letters = columns * len("  ".join(max(word.split("\n"), key=len) for word in words))
    box = 0.8 if columns > 2 else 0.42 if columns == 1 and words else 0.62
    figure, grid = sheet(len(panels), columns, sharex=not words, sharey=same_scale, wide=letters >= LETTERS)
    for axes, panel in zip(grid, panels, strict=True):
        axes.set_title(panel.title)
        axes.grid(True, axis="y" if words else "both")
        if words:
            _draw_points(axes, panel, styles, floor)
            axes.set_xticks(range(len(words)), words, rotation=90 if letters > LETTERS else 0)
            axes.tick_params(axis="x", length=0)
        else:
            _draw_lines(axes, panel, styles, floor)
            axes.set_xscale("log" if logarithmic else "linear")
            tick(axes.xaxis, along, logarithmic, 7 if columns < 3 else 5)
    for axes, panel in zip(grid, panels, strict=True):  # of those with the same ends, all are drawn now
        _scale(axes, panel, logarithmic_values, floor, least_span, ceiling)
    label_outside(grid, columns, x_label, [panel.label for panel in panels], own=not same_scale)
    known = {name for panel in panels for name, line in panel.lines.items() if line.notnull().any()}
    hidden = {"marker": ""} if along.size > MARKED else {}
    entries = {
        name: Line2D([], [], **(styles[name] | (_POINT if words else hidden)))
        for name in names
        if name and (name in known or not known)
    }
    if any(panel.marks is not None and panel.marks.notnull().any() for panel in panels):
        entries[mark] = Line2D([], [], color="black", linewidth=2)
    legend(figure, entries, legend_title)
    return fit(figure, box)


def _coordinate(line: xr.DataArray) -> xr.DataArray:
    """Values that a line runs along; the numbers 1, 2, ... where they are not told."""
    dim = str(line.dims[0])
    return line[dim] if dim in line.coords else xr.DataArray(np.arange(1, line.size + 1), dims=dim)


def _looks(names: Sequence[str], ordered: bool, special: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Colour, dashes and marker of each line."""
    colours = colormaps[VALUES](np.linspace(0.0, 0.85, len(names))) if ordered else COLOURS
    dashes = ("-",) if ordered else DASHES
    return {
        name: {"color": colour, "linestyle": dash, "marker": marker, "markeredgewidth": 0, **special.get(name, {})}
        for name, colour, dash, marker in zip(names, cycle(colours), cycle(dashes), cycle(MARKERS), strict=False)
    }


def _draw_lines(axes: Axes, panel: Panel, looks: Mapping[str, dict[str, Any]], floor: float | None) -> None:
    """Curves in the order of their numbers, with the bands about them."""
    for name, line in panel.lines.items():
        x = _coordinate(line).to_numpy()
        order = np.argsort(x, kind="stable")
        parts = [part.to_numpy() for part in (line, *panel.bands.get(name, ()))]
        y, *ends = (part[order] if floor is None else np.maximum(part[order], floor) for part in parts)
        look = dict(looks[name], label=name)
        if len(x) > MARKED:
            look["marker"] = ""
        if y.dtype.kind == "M":
            look |= {"linestyle": "", "marker": looks[name]["marker"]}
            tick(axes.yaxis, line)
        if ends:
            axes.fill_between(x[order], *ends, color=look["color"], alpha=0.2, linewidth=0)
        axes.plot(x[order], y, **look)


def _draw_points(axes: Axes, panel: Panel, looks: Mapping[str, dict[str, Any]], floor: float | None) -> None:
    """Points with error bars, those of the same word beside each other."""
    values = {name: line.to_numpy() for name, line in panel.lines.items()}
    count = next(iter(values.values())).size
    here = np.cumsum([np.isfinite(y) for y in values.values()], axis=0)
    most = np.maximum(here[-1], 1)
    for rank, (name, y) in zip(here, values.items(), strict=True):
        x = np.arange(count) + (rank - (most + 1) / 2) * np.minimum(0.7 / most, 0.22)
        ends = np.array([end.to_numpy() for end in panel.bands.get(name, ())])
        low = np.full(count, floor if floor is not None else -np.inf)
        shown, ends = np.where(np.isnan(y), y, np.maximum(y, low)), np.maximum(ends, low) if ends.size else ends
        look = {**looks[name], **_POINT}
        if ends.size:
            axes.errorbar(x, shown, np.abs(ends - shown), fmt="none", ecolor=look["color"], elinewidth=1, capsize=2)
        hollow = {"markerfacecolor": "white", "markeredgecolor": look["color"], "markeredgewidth": 1.0}
        for kept, more in ((y >= low, {}), (y < low, hollow)):
            if kept.any():
                axes.plot(x[kept], shown[kept], **(look | more), clip_on=False, zorder=3, label=name)
    if panel.marks is not None:
        axes.hlines(panel.marks, np.arange(count) - 0.4, np.arange(count) + 0.4, color="black", linewidth=1.8, zorder=2)
    between: Any = {"transform": axes.get_xaxis_transform(), "color": "#e2e2e2", "linewidth": 0.5, "zorder": 0}
    axes.vlines(np.arange(count - 1) + 0.5, 0, 1, **between)
    axes.set_xlim(-0.5, count - 0.5)


def _scale(
    axes: Axes, panel: Panel, logarithmic: bool, floor: float | None, least_span: float, ceiling: float | None
) -> None:
    """Ends of a value axis, with a least height about what it shows and plain numbers where it is logarithmic."""
    if any(line.dtype.kind == "M" for line in panel.lines.values()):
        return
    if logarithmic or floor is not None:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        if floor is not None:
            low, high = max(floor, low), max(high, 10 * floor)
        elif high < 4 * low:
            low, high = (low * high) ** 0.5 / 2, (low * high) ** 0.5 * 2
        axes.set_ylim(low, high)
        tick_decades(axes.yaxis, low, high)
        return
    low, high = axes.get_ylim()
    least_span = least_span if panel.least_span is None else panel.least_span
    if high - low < 1.1 * least_span:
        low, high = (low + high) / 2 - least_span, (low + high) / 2 + least_span
    if ceiling is not None:
        high = min(high, ceiling + 0.05 * (ceiling - low))
    axes.set_ylim(low, high)
    axes.locator_params(axis="y", nbins=7, steps=[1, 2, 2.5, 5, 10])

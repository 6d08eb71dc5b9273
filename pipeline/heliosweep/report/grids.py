"""Maps over two swept numbers: a colour for every pair, each map with its own scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator

from heliosweep.report.labels import latitude_text
from heliosweep.report.style import NO_VALUE, PAGE_WIDTH, VALUES, PlainPowers, new_figure, styled

#: Least span of a colour scale as a part of the largest value.
LEAST_PART = 0.01

_LEFT, _RIGHT, _BETWEEN, _TOP, _BOTTOM, _UP, _WIDEST = 0.62, 0.15, 0.25, 0.1, 1.0, 2.5, 3.6


@dataclass(frozen=True)
class Grid:
    """One map.

    Parameters
    ----------
    label : str
        What is shown, with the unit.
    values : ndarray, shape (y, x)
        NaN is grey.
    """

    label: str
    values: np.ndarray


@dataclass(frozen=True)
class Side:
    """One side of all maps.

    Parameters
    ----------
    label : str
        What it is, with the unit.
    values : ndarray, shape (n,)
        Where the values stand; need not be evenly spaced.
    step : float, optional
        Distance of its ticks; chosen by the range where left out.
    latitude : bool
        Whether ticks are latitudes with their hemisphere.
    logarithmic : bool
        Whether the side is logarithmic; values must be positive.
    """

    label: str
    values: np.ndarray
    step: float | None = None
    latitude: bool = False
    logarithmic: bool = False

    def edges(self) -> np.ndarray:
        """Between which numbers each value stands, in the middle of its neighbours."""
        values = np.log(self.values) if self.logarithmic else self.values
        if values.size < 2:
            ends = np.array([values[0] - 0.5, values[0] + 0.5])
        else:
            middle = (values[1:] + values[:-1]) / 2
            ends = np.array([2 * values[0] - middle[0], *middle, 2 * values[-1] - middle[-1]])
        return np.exp(ends) if self.logarithmic else ends

    def tick(self, axis: Axis) -> None:
        """Place and word the ticks of an axis."""
        if self.logarithmic:
            axis.set_major_formatter(PlainPowers())
            axis.set_minor_formatter(PlainPowers(labelOnlyBase=False))
            return
        few = MaxNLocator(7, steps=[1, 1.5, 2, 2.5, 3, 5, 10])
        axis.set_major_locator(MultipleLocator(self.step) if self.step else few)
        if self.latitude:
            axis.set_major_formatter(FuncFormatter(lambda value, _: latitude_text(round(value, 6))))


@styled
def grid_figure(grids: Sequence[Grid], x: Side, y: Side) -> Figure:
    """Draw maps beside each other, each with its colour bar below.

    Parameters
    ----------
    grids : sequence of Grid
        From left to right.
    x, y : Side
        Horizontal and vertical side.

    Returns
    -------
    matplotlib.figure.Figure
    """
    room = PAGE_WIDTH - _LEFT - _RIGHT - _BETWEEN * (len(grids) - 1)
    across = min(room / len(grids), _WIDEST)
    width = PAGE_WIDTH - room + across * len(grids)
    height = _TOP + _UP + _BOTTOM
    figure = new_figure(width, height)
    palette = colormaps[VALUES].with_extremes(bad=NO_VALUE)
    for index, one in enumerate(grids):
        left = (_LEFT + index * (across + _BETWEEN)) / width
        axes = figure.add_axes((left, _BOTTOM / height, across / width, _UP / height))
        values = np.ma.masked_invalid(one.values)
        mesh = axes.pcolormesh(x.edges(), y.edges(), values, cmap=palette, shading="flat", rasterized=True)
        axes.set(xscale="log" if x.logarithmic else "linear", yscale="log" if y.logarithmic else "linear")
        mesh.set_clim(*_ends(values))
        axes.set_facecolor(NO_VALUE)
        x.tick(axes.xaxis)
        y.tick(axes.yaxis)
        axes.set_xlabel(x.label, labelpad=2)
        axes.tick_params(labelleft=index == 0)
        if index == 0:
            axes.set_ylabel(y.label)
        bar = figure.add_axes((left + 0.1 * across / width, 0.42 / height, 0.8 * across / width, 0.1 / height))
        figure.colorbar(mesh, cax=bar, orientation="horizontal").outline.set_linewidth(0.5)
        bar.set_xlabel(one.label, labelpad=2)
        bar.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    return figure


def _ends(values: np.ma.MaskedArray) -> tuple[float, float]:
    """Ends of a colour scale, a little apart where all values are nearly the same."""
    known = values.compressed()
    if not known.size:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    least = LEAST_PART * max(abs(low), abs(high)) or 1.0
    return (low, high) if high - low > least else ((low + high - least) / 2, (low + high + least) / 2)

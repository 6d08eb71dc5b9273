"""Figures of a search: its course, the goal over what was searched, and the front of two goals."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from heliosweep.report.colours import COLOURS, VALUES
from heliosweep.report.contents import NamedFigure
from heliosweep.report.labels import axis_label, is_fraction, printed, title_of, value_text
from heliosweep.report.layout import abreast, colour_bar, fit, legend, sheet
from heliosweep.report.style import styled
from heliosweep.search.course import EVALUATION
from heliosweep.search.result import best_of, goals_of, keys_of, point_text, so_far

#: Panels beside each other.
COLUMNS = 3
_POINT: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 3, "markeredgewidth": 0}
_KEPT = _POINT | {"color": COLOURS[4]}
_MISSED: dict[str, Any] = {"linestyle": "", "marker": "x", "markersize": 3, "markeredgewidth": 0.6, "color": "#999999"}
_FRONT: dict[str, Any] = {"linestyle": "-", "linewidth": 0.8, "marker": "o", "markersize": 4, "color": COLOURS[0]}
_BEST: dict[str, Any] = {"linestyle": "", "marker": "*", "markersize": 11, "color": COLOURS[1], "markeredgewidth": 0}
_LINE: dict[str, Any] = {"color": COLOURS[0], "linewidth": 1.3, "drawstyle": "steps-post"}


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Draw the course of a search for one goal, or the front of two, and the goal over the searched keys."""
    goals, keys = list(goals_of(result)), list(keys_of(result).values())
    best = best_of(result)
    at_best = f" at {point_text(result, best)}" if best is not None else ""
    if len(goals) == 2:
        caption = (
            "The front of best compromises: no evaluation is better in one goal without being worse in the other. "
            f"The star is the one nearest to the best of both{at_best}."
        )
        yield NamedFigure("front", caption, _front(result))
    else:
        caption = "Course of the search: every evaluation, and the best so far."
        named = f" The best is evaluation {best + 1}{at_best}." if best is not None else ""
        yield NamedFigure("course", caption + named, _course(result))
    numbers = all(result[name].dtype.kind == "f" for name in keys)
    if len(goals) == 1 and len(keys) == 2 and numbers:
        goal = title_of(result[goals[0]])
        yield NamedFigure("map", f"Evaluations over both searched keys, coloured by the {goal}.", _map(result))
    else:
        what = "the front and all other evaluations" if len(goals) == 2 else "all evaluations"
        yield NamedFigure("keys", f"Each goal over each searched key: {what}.", _keys(result))


def _kept(result: xr.Dataset) -> np.ndarray:
    return np.asarray(result["feasible"].to_numpy() == 1)


def _legend(figure: Figure, result: xr.Dataset, looks: dict[str, dict[str, Any]]) -> None:
    """Legend of the looks that some evaluation has."""
    there = {"infeasible": not _kept(result).all(), "best": bool(result["best"].any())}
    called = {"best": "best compromise"} if len(goals_of(result)) > 1 else {}
    entries = {called.get(name, name): Line2D([], [], **look) for name, look in looks.items() if there.get(name, True)}
    legend(figure, entries)


@styled
def _course(result: xr.Dataset) -> Figure:
    (goal,) = goals_of(result)
    figure, (axes,) = sheet(1, 1)
    numbers, values, kept = result[EVALUATION].to_numpy(), printed(result[goal]), _kept(result)
    axes.plot(numbers[~kept], values[~kept], **_MISSED)
    axes.plot(numbers[kept], values[kept], **_KEPT)
    best = so_far(result) * (100.0 if is_fraction(result[goal]) else 1.0)
    axes.plot(numbers, best, **_LINE)
    if (place := best_of(result)) is not None:
        axes.plot(numbers[place], values[place], **_BEST)
    axes.set(xlabel=title_of(result[EVALUATION]).split(",")[0], ylabel=axis_label(result[goal]))
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.grid(True)
    _legend(figure, result, {"evaluation": _KEPT, "infeasible": _MISSED, "best so far": _LINE, "best": _BEST})
    return fit(figure, 0.62)


@styled
def _map(result: xr.Dataset) -> Figure:
    (goal,) = goals_of(result)
    x, y = (result[name] for name in keys_of(result).values())
    figure, (axes,) = sheet(1, 1)
    values, kept = printed(result[goal]), _kept(result)
    axes.plot(x[~kept], y[~kept], **_MISSED)
    shades = axes.scatter(x[kept], y[kept], c=values[kept], cmap=VALUES, s=22, linewidths=0.3, edgecolors="white")
    if (place := best_of(result)) is not None:
        axes.plot(x[place], y[place], **_BEST)
    axes.set(xlabel=axis_label(x), ylabel=axis_label(y))
    axes.grid(True)
    colour_bar(figure, shades, [axes], axis_label(result[goal]), "neither")
    _legend(figure, result, {"evaluation": _KEPT | {"color": "#777777"}, "infeasible": _MISSED, "best": _BEST})
    return fit(figure, 0.8)


@styled
def _front(result: xr.Dataset) -> Figure:
    x, y = (result[name] for name in goals_of(result))
    figure, (axes,) = sheet(1, 1)
    _compared(axes, result, printed(x), printed(y))
    axes.set(xlabel=axis_label(x), ylabel=axis_label(y))
    axes.grid(True)
    _legend(figure, result, {"evaluation": _KEPT, "infeasible": _MISSED, "front": _FRONT, "best": _BEST})
    return fit(figure, 0.8)


@styled
def _keys(result: xr.Dataset) -> Figure:
    goals, keys = list(goals_of(result)), list(keys_of(result).values())
    count = len(goals) * len(keys)
    columns = abreast(len(keys), COLUMNS) if len(keys) > 1 else 1
    figure, grid = sheet(count, columns)
    pairs = [(goal, key) for goal in goals for key in keys]
    for axes, (goal, key) in zip(grid, pairs, strict=True):
        along, words = _places(result[key])
        _compared(axes, result, along, printed(result[goal]), line=False)
        if words:
            axes.set_xticks(range(len(words)), words, rotation=90 if len(words) > 3 else 0)
            axes.set_xlim(-0.5, len(words) - 0.5)
        axes.set(xlabel=title_of(result[key]) if words else axis_label(result[key]), ylabel=axis_label(result[goal]))
        axes.grid(True)
    looks = {"evaluation": _KEPT, "infeasible": _MISSED, "best": _BEST}
    looks |= {"front": _FRONT | {"linestyle": ""}} if len(goals) == 2 else {}
    _legend(figure, result, looks)
    return fit(figure, 0.8)


def _compared(axes: Axes, result: xr.Dataset, x: np.ndarray, y: np.ndarray, line: bool = True) -> None:
    """Draw all evaluations, the front among them, and the best."""
    kept, best = _kept(result), result["best"].to_numpy() == 1
    axes.plot(x[~kept], y[~kept], **_MISSED)
    axes.plot(x[kept], y[kept], **_KEPT)
    if len(goals_of(result)) == 2:
        order = np.flatnonzero(best)[np.argsort(x[best], kind="stable")]
        axes.plot(x[order], y[order], **(_FRONT if line else _FRONT | {"linestyle": ""}))
    if (place := best_of(result)) is not None:
        axes.plot(x[place], y[place], **_BEST)


def _places(key: xr.DataArray) -> tuple[np.ndarray, list[str]]:
    """Places of the values of a key along an axis; of names with the words for them."""
    if key.dtype.kind == "f":
        return key.to_numpy(), []
    names = list(dict.fromkeys(key.to_numpy().tolist()))
    first = {name: int(np.flatnonzero(key.to_numpy() == name)[0]) for name in names}
    words = [textwrap.fill(value_text(key[place]).replace("_", " "), 14) for place in first.values()]
    return np.array([names.index(name) for name in key.to_numpy().tolist()], dtype=float), words

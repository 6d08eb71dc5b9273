"""Figures of a search: its course, the goal over the searched keys, and the front of two goals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.colours import COLOURS, VALUES
from heliosweep.report.figures import Figure, Special
from heliosweep.report.labels import axis_label, is_fraction, printed, title_of, value_text
from heliosweep.search.course import EVALUATION
from heliosweep.search.result import best_of, goals_of, keys_of, point_text, so_far

_LOOKS: dict[str, dict[str, Any]] = {
    "evaluation": {"linestyle": "", "marker": "o", "markersize": 3, "color": COLOURS[4]},
    "infeasible": {"linestyle": "", "marker": "x", "markersize": 3, "color": "#999999"},
    "front": {"linestyle": "-", "linewidth": 0.8, "marker": "o", "markersize": 4, "color": COLOURS[0]},
    "best": {"linestyle": "", "marker": "*", "markersize": 11, "color": COLOURS[1]},
}


def figures(result: xr.Dataset) -> Iterator[Figure]:
    """Yield the course of a search for one goal or the front of two, and the goals over the searched keys."""
    goals, keys = list(goals_of(result)), list(keys_of(result).values())
    best = best_of(result)
    at_best = f" at {point_text(result, best)}" if best is not None else ""
    numbers = all(result[name].dtype.kind == "f" for name in keys)
    if len(goals) == 1 and len(keys) == 2 and numbers:
        title = f"Evaluations over both searched keys, coloured by the {title_of(result[goals[0]])}"
        yield Special("map", title, draw=_map, notes=f"Star: best{at_best}.")
    else:
        yield Special("keys", "Goals over each searched key", draw=_keys, notes=f"Star: best{at_best}.")
    if len(goals) == 2:
        notes = "No evaluation is better in one goal without being worse in the other."
        yield Special(
            "front",
            "Front of the best compromises",
            draw=_front,
            notes=f"{notes} Star: nearest to the best of both{at_best}.",
        )
    else:
        yield Special("course", "Course of the search: every evaluation, and the best so far", draw=_course)


def _points(axes: Any, result: xr.Dataset, x: np.ndarray, y: np.ndarray, line: bool = False) -> dict[str, Any]:
    """Draw all evaluations, the front among them, and the best; return the entries of the legend."""
    kept, best = result["feasible"].to_numpy() == 1, result["best"].to_numpy() == 1
    order: Any = np.flatnonzero(best)[np.argsort(x[best], kind="stable")] if len(goals_of(result)) == 2 else []
    place = best_of(result)
    chosen = {"infeasible": ~kept, "evaluation": kept, "front": order, "best": [] if place is None else [place]}
    entries = {}
    for name, which in chosen.items():
        look = _LOOKS[name] if line or name != "front" else {**_LOOKS[name], "linestyle": ""}
        if np.size(x[which]):
            (entries[name],) = axes.plot(x[which], y[which], **look)
    axes.grid(True)
    return entries


def _course(result: xr.Dataset) -> Any:
    from heliosweep.report.draw import legend, panels
    from heliosweep.report.labels import fold

    (goal,) = goals_of(result)
    drawing, (axes,) = panels(1, 1, 0.62)
    numbers = result[EVALUATION].to_numpy()
    best = so_far(result) * (100.0 if is_fraction(result[goal]) else 1.0)
    entries = _points(axes, result, numbers, printed(result[goal]))
    (entries["best so far"],) = axes.plot(numbers, best, color=COLOURS[0], linewidth=1.3, drawstyle="steps-post")
    axes.set(xlabel="number of the evaluation", ylabel=fold(axis_label(result[goal])))
    legend(drawing, entries)
    return drawing


def _map(result: xr.Dataset) -> Any:
    from heliosweep.report.draw import panels
    from heliosweep.report.labels import fold

    (goal,) = goals_of(result)
    x, y = (result[name] for name in keys_of(result).values())
    drawing, (axes,) = panels(1, 1, 0.8)
    values, kept, place = printed(result[goal]), result["feasible"].to_numpy() == 1, best_of(result)
    axes.plot(x[~kept], y[~kept], **_LOOKS["infeasible"])
    dots = axes.scatter(x[kept], y[kept], c=values[kept], cmap=VALUES, s=22, linewidths=0.3, edgecolors="white")
    if place is not None:
        axes.plot(x[place], y[place], **_LOOKS["best"])
    axes.grid(True)
    axes.set(xlabel=fold(axis_label(x)), ylabel=fold(axis_label(y)))
    drawing.colorbar(dots, ax=axes, location="bottom", label=fold(axis_label(result[goal]), 50), aspect=40)
    return drawing


def _front(result: xr.Dataset) -> Any:
    from heliosweep.report.draw import legend, panels
    from heliosweep.report.labels import fold

    x, y = (result[name] for name in goals_of(result))
    drawing, (axes,) = panels(1, 1, 0.8)
    entries = _points(axes, result, printed(x), printed(y), line=True)
    axes.set(xlabel=fold(axis_label(x)), ylabel=fold(axis_label(y)))
    legend(drawing, entries)
    return drawing


def _keys(result: xr.Dataset) -> Any:
    from heliosweep.report.draw import abreast, legend, panels
    from heliosweep.report.labels import fold

    goals, keys = list(goals_of(result)), list(keys_of(result).values())
    drawing, grid = panels(len(goals) * len(keys), abreast(len(keys)), 0.8)
    entries: dict[str, Any] = {}
    for axes, (goal, key) in zip(grid, [(goal, key) for goal in goals for key in keys], strict=True):
        along, words = result[key].to_numpy(), list[str]()
        if along.dtype.kind != "f":
            names = list(dict.fromkeys(along.tolist()))
            first = [int(np.flatnonzero(along == name)[0]) for name in names]
            words = [fold(value_text(result[key][place]).replace("_", " "), 14) for place in first]
            along = np.array([names.index(name) for name in along.tolist()], dtype=float)
            axes.set_xticks(range(len(words)), words, rotation=90 if len(words) > 3 else 0)
        entries |= _points(axes, result, along, printed(result[goal]))
        axes.set(
            xlabel=fold(title_of(result[key]) if words else axis_label(result[key])),
            ylabel=fold(axis_label(result[goal])),
        )
    legend(drawing, entries)
    return drawing

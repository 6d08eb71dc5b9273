"""Figures of a search: its course, the goal over the searched keys, and the front of two goals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.colours import COLOURS, VALUES
from heliosweep.report.figures import Figure, Special
from heliosweep.report.labels import axis_label, fold, is_fraction, printed, title_of
from heliosweep.search.course import EVALUATION
from heliosweep.search.result import best_of, goals_of, keys_of, point_text, so_far

_LOOKS: dict[str, dict[str, Any]] = {
    "infeasible": {"linestyle": "", "marker": "x", "markersize": 3, "color": "#999999"},
    "evaluation": {"linestyle": "", "marker": "o", "markersize": 3, "color": COLOURS[4]},
    "front": {"linestyle": "", "marker": "o", "markersize": 4, "color": COLOURS[0]},
    "best": {"linestyle": "", "marker": "*", "markersize": 11, "color": COLOURS[1]},
}


def figures(result: xr.Dataset) -> Iterator[Figure]:
    """Yield the goals over the searched keys, and the course of a search for one goal or the front of two."""
    goals, keys, best = list(goals_of(result)), list(keys_of(result).values()), best_of(result)
    star = f"Star: best{f' at {point_text(result, best)}' if best is not None else ''}."
    if len(goals) == 1 and len(keys) == 2 and all(result[name].dtype.kind == "f" for name in keys):
        title = f"Evaluations over both searched keys, coloured by the {title_of(result[goals[0]])}"
        yield Special("map", title, draw=partial(_evaluations, [keys], colour=goals[0]), notes=star)
    else:
        pairs = [[key, goal] for goal in goals for key in keys]
        yield Special("keys", "Goals over each searched key", draw=partial(_evaluations, pairs), notes=star)
    if len(goals) == 2:
        notes = f"No evaluation is better in one goal without being worse in the other. {star}"
        yield Special("front", "Front of the best compromises", draw=partial(_evaluations, [goals]), notes=notes)
    else:
        title = "Course of the search: every evaluation, and the best so far"
        yield Special("course", title, draw=partial(_evaluations, [[EVALUATION, goals[0]]]))


def _evaluations(pairs: Sequence[Sequence[str]], result: xr.Dataset, *, colour: str = "") -> Any:
    """Draw all evaluations in planes of two variables, with the front and the best."""
    from heliosweep.report.draw import abreast, legend, panels

    feasible, best, place = result["feasible"].to_numpy() == 1, result["best"].to_numpy() == 1, best_of(result)
    chosen = {"infeasible": ~feasible, "evaluation": feasible, "best": [] if place is None else [place]}
    chosen |= {"front": best} if len(goals_of(result)) == 2 else {}
    drawing, grid = panels(len(pairs), abreast(len(pairs)), 0.75)
    entries: dict[str, Any] = {}
    for axes, (across, up) in zip(grid, pairs, strict=True):
        x, y = printed(result[across]), printed(result[up])
        if x.dtype.kind != "f" and across != EVALUATION:
            words, x = np.unique(x.astype(str), return_inverse=True)
            names = [fold(word.replace("_", " "), 14) for word in words]
            axes.set_xticks(range(words.size), names, rotation=90 if words.size > 3 else 0)
        for name in filter(chosen.__contains__, _LOOKS):
            if colour and name == "evaluation":
                values = printed(result[colour])[feasible]
                look: Any = {"cmap": VALUES, "s": 22, "linewidths": 0.3, "edgecolors": "white"}
                dots = axes.scatter(x[feasible], y[feasible], c=values, **look)
                label = fold(axis_label(result[colour]), 50)
                drawing.colorbar(dots, ax=axes, location="bottom", label=label, aspect=40)
            elif np.size(x[chosen[name]]):
                (entries[name],) = axes.plot(x[chosen[name]], y[chosen[name]], **_LOOKS[name])
        if across == EVALUATION:
            course = so_far(result) * (100.0 if is_fraction(result[up]) else 1.0)
            (entries["best so far"],) = axes.plot(x, course, color=COLOURS[0], linewidth=1.3, drawstyle="steps-post")
        axes.grid(True)
        axes.set(xlabel=fold(axis_label(result[across])), ylabel=fold(axis_label(result[up])))
    legend(drawing, entries)
    return drawing

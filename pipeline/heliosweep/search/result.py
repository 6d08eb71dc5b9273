"""Search results: all evaluations, best evaluations, figures and tables."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.config import EVALUATION
from heliosweep.grid.regions import Variable, flags, quantity
from heliosweep.report.figures import COLOURS, Curves, Figure, printed, title_of, unit_of, value_texts
from heliosweep.report.tables import SOURCE, Table, numbers
from heliosweep.search.optimise import front

#: Maximum difference between near-optimal values and the best value [percentage points, or % of the best value].
#: Number of best evaluations on the page.
FLAT, LISTED = 0.1, 10

#: Styles of lines and markers for each kind of evaluation in figures.
_LOOKS: dict[str, dict[str, Any]] = {
    "infeasible": {"linestyle": "", "marker": "x", "markersize": 3, "color": "#999999"},
    "evaluation": {"linestyle": "", "marker": "o", "markersize": 3, "color": COLOURS[4]},
    "front": {"linestyle": "", "marker": "o", "markersize": 4, "color": COLOURS[0]},
    "best so far": {"linestyle": "-", "marker": "", "color": COLOURS[0], "drawstyle": "steps-post"},
    "best": {"linestyle": "", "marker": "*", "markersize": 11, "color": COLOURS[1]},
}
#: Variables that a search adds to the results.
_OWN = {
    "generation": quantity((EVALUATION,), "1", "generation of the evaluation, counted from 0", dtype="int32"),
    "feasible": flags(
        (EVALUATION,),
        "flag for evaluations that satisfy all bounds",
        {0: "bounds_are_missed", 1: "bounds_are_kept"},
        "bounds also count as violated if a plant is infeasible or has no value",
    ),
    "best": flags(
        (EVALUATION,),
        "flag for the best evaluation, or for the evaluations on the Pareto front",
        {0: "another_is_better", 1: "no_other_is_better"},
        "on the Pareto front, no other evaluation is better in one objective without being worse in the other",
    ),
}


def missed_by(values: Mapping[str, np.ndarray], limits: Mapping[str, Any]) -> np.ndarray:
    """Return the sum of the relative violations of the bounds. Evaluations without a value have an infinite sum."""
    total = np.zeros(len(next(iter(values.values()))))
    for name, limit in limits.items():
        for bound, sign in ((limit.at_least, 1.0), (limit.at_most, -1.0)):
            if bound is not None:
                total += np.maximum(sign * (bound - values[name]), 0.0) / (abs(bound) or 1.0)
    return np.where(np.isnan(total), np.inf, total)


def described(
    values: Mapping[str, np.ndarray],
    variables: Mapping[str, Variable],
    goals: np.ndarray,
    missed: np.ndarray,
    generations: list[int],
) -> tuple[dict[str, Variable], dict[str, np.ndarray]]:
    """Return the variables of a search result and their values.

    The mappings `values` and `variables` contain the results by name. `goals` contains the minimised objectives, shape
    (evaluations, objectives), and `missed` contains the violations of the bounds, shape (evaluations,).
    """
    arrays = {name: np.asarray(values[name], float) for name in variables}
    own = (generations, missed == 0.0, front(goals, missed))
    arrays |= {name: np.array(one, _OWN[name].dtype) for name, one in zip(_OWN, own, strict=True)}
    return {**variables, **_OWN}, arrays


def goals_of(result: xr.Dataset) -> dict[str, bool]:
    """Return the objectives of a result by name, with True for minimised objectives."""
    said = json.loads(result.attrs["study"])["search"]
    names = [(name, way == "minimise") for way in ("maximise", "minimise") for name in said.get(way, ())]
    return {name if name in result else f"field_{name}": least for name, least in names}


def keys_of(result: xr.Dataset) -> dict[str, str]:
    """Return the name of the coordinate of each searched key."""
    return {str(one.attrs["key"]): str(name) for name, one in result.coords.items() if "key" in one.attrs}


def best_of(result: xr.Dataset) -> int | None:
    """Return the index of the best evaluation, or None if none satisfies all bounds.

    On a Pareto front, the best evaluation is closest to the best values of both objectives.
    """
    places = np.flatnonzero(result["best"].to_numpy())
    if not places.size:
        return None
    goals = np.stack([
        result[name].to_numpy()[places] * (1.0 if least else -1.0) for name, least in goals_of(result).items()
    ])  # fmt: skip
    span = np.ptp(goals, axis=1)
    shares = (goals - goals.min(axis=1)[:, None]) / np.where(span > 0, span, 1.0)[:, None]
    return int(places[np.argmin((shares**2).sum(axis=0))])


def point_text(result: xr.Dataset, place: int) -> str:
    """Return the values of the searched keys of an evaluation as text."""
    at = result.isel({EVALUATION: place})
    return ", ".join(f"{title_of(at[name])} {value_texts(at[name])[0]}" for name in keys_of(result).values())


def answers(result: xr.Dataset) -> Iterator[str]:
    """Yield a sentence with the optimum, its point and the near-optimal key ranges.

    Nothing is yielded for two objectives, or if no evaluation satisfies all bounds.
    """
    best, goals = best_of(result), goals_of(result)
    if best is None or len(goals) > 1:
        return
    ((name, least),) = goals.items()
    values, unit = printed(result[name]), unit_of(result[name])
    is_share = unit == "%"
    margin = FLAT if is_share else FLAT / 100 * abs(values[best])
    with np.errstate(invalid="ignore"):
        near = (np.abs(values - values[best]) <= margin) & (result["feasible"].to_numpy() == 1)
    ranges = []
    for key in keys_of(result).values():
        if result[key].dtype.kind == "f":
            ends = result[key].to_numpy()[near]
            ranges.append(
                f"{title_of(result[key])} {ends.min():.4g} to {ends.max():.4g} {unit_of(result[key])}".strip()
            )
    count = result.sizes[EVALUATION]
    where = f"{point_text(result, best)} (evaluation {best + 1} of {count:,})"
    flat = f"; within {FLAT:g} {'points' if is_share else '%'}: {', '.join(ranges)}" if ranges else ""
    yield f"{'minimum' if least else 'maximum'} {values[best]:.5g} {unit} at {where}{flat}"


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield remarks about missing values, unsatisfied bounds, and best values on a bound of the search."""
    best, count = best_of(result), result.sizes[EVALUATION]
    lost = int(np.isnan(np.stack([result[name].to_numpy() for name in goals_of(result)])).any(axis=0).sum())
    if lost:
        yield f"{lost:,} of {count:,} evaluations have no value, because the plant is infeasible or has no result"
    if best is None:
        yield "no evaluation satisfies all bounds of 'subject_to': widen the search or relax the bounds"
        return
    over = json.loads(result.attrs["study"])["search"]["over"]
    for key, name in keys_of(result).items() if len(goals_of(result)) == 1 else ():
        value, ends = result[name].to_numpy()[best], over[key] if isinstance(over[key], list) else []
        for bound, which in zip(ends, ("lower", "upper"), strict=False):
            if abs(value - bound) <= 1e-3 * (ends[1] - ends[0]):
                yield f"the best {key} is on the {which} bound of the search, {bound:g}; a better point may lie beyond"


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Yield a table of the best evaluations, or of the front, with the values of the searched keys."""
    goals, keys = goals_of(result), list(keys_of(result).values())
    ((first, least), *others) = goals.items()
    kept = np.flatnonzero(result["best" if others else "feasible"].to_numpy() == 1)
    order = kept[np.argsort(result[first].to_numpy()[kept] * (1 if least else -1), kind="stable")]
    shown = order[np.unique(np.linspace(0, len(order) - 1, LISTED).astype(int))] if others else order[:LISTED]
    if not len(order):
        return
    data = result.isel({EVALUATION: shown}).reset_coords(keys)
    named = [data[name].rename(name.removeprefix("field_")).assign_attrs({SOURCE: name}) for name in goals]
    note = (
        f"{len(shown)} of {len(order):,} evaluations {'on the front' if others else 'that satisfy all bounds'} "
        "are shown."
    )
    label = "Along the front" if others else "The best evaluations"
    yield numbers(data, [EVALUATION], [*(data[name] for name in keys), *named], label, [note], digits=5)


def figures(result: xr.Dataset) -> Iterator[Figure]:
    """Yield figures of the objectives over the searched keys, and of the convergence or the Pareto front."""
    goals, best = list(goals_of(result)), best_of(result)
    star = f"Star: best{f' at {point_text(result, best)}' if best is not None else ''}."
    shared: Any = {"lines": ["evaluations"], "looks": _LOOKS, "styled": True, "interactive": False, "notes": star}
    for key in keys_of(result).values():
        if result[key].dtype.kind == "f":
            title = f"Evaluations over the {title_of(result[key])}"
            yield Curves(f"over_{key}", title, goals, over=[key], derive=partial(_marked, key), **shared)
    if len(goals) == 2:
        shared["notes"] = f"No evaluation is better in one objective without being worse in the other. {star}"
        title, derive = "Pareto front", partial(_marked, goals[0])
        yield Curves("front", title, goals[1:], over=goals[:1], derive=derive, **shared)
    else:
        title = "Convergence of the search: all evaluations, and the best value so far"
        yield Curves("course", title, goals, over=[EVALUATION], derive=partial(_marked, EVALUATION), **shared)


def _marked(axis: str, result: xr.Dataset) -> xr.Dataset:
    goals, feasible, place = list(goals_of(result)), result["feasible"] == 1, best_of(result)
    kinds = {"infeasible": ~feasible, "evaluation": feasible}
    kinds |= {"front": result["best"] == 1} if len(goals) == 2 else {}
    kinds |= {} if place is None else {"best": result[EVALUATION] == result[EVALUATION][place]}
    values = result[goals].reset_coords(drop=True)
    parts = {kind: values.where(mask.reset_coords(drop=True)) for kind, mask in kinds.items()}
    if axis == EVALUATION:
        fold: Any = np.fmin if goals_of(result)[goals[0]] else np.fmax
        # the best value is missing before the first evaluation that satisfies all bounds
        kept = np.where(feasible, result[goals[0]], np.nan)
        parts["best so far"] = values.copy(data={goals[0]: fold.accumulate(kept)})
    marked = xr.concat(list(parts.values()), xr.IndexVariable("evaluations", list(parts)))
    if axis != EVALUATION:
        attrs = {"units": unit_of(result[axis]), "long_name": title_of(result[axis])}
        marked = marked.drop_vars(axis, errors="ignore").assign_coords(
            {axis: (EVALUATION, printed(result[axis]), attrs)}
        )
        marked = marked.swap_dims({EVALUATION: axis})
    return marked

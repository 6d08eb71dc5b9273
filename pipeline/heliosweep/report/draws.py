"""Figures and tables of results with draws: uncertainty of the results, and sensitivity to each key."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.colours import COLOURS
from heliosweep.report.figures import Figure, Special, default_figures
from heliosweep.report.labels import axis_label, coordinate_text, is_fraction, title_of, unit_of
from heliosweep.report.tables import Column, Table

SAMPLE, PARAMETER = "sample", "parameter"
#: Number of points of a sweep with a panel, of keys with a bar, and of dots; width of an interval that is wide.
MOST_PANELS, MOST_BARS, MOST_DOTS, WIDE = 6, 20, 4000, 0.1
#: First draw of running means; number of Sobol sequences that alternate.
FIRST_MEAN, SEQUENCES = 16, 8
_INDICES = {"first_order_index": "first-order index", "total_index": "total index"}
_CHANGES = {"change_down": "one deviate less", "change_up": "one deviate more"}
#: Columns of the table of each kind of sensitivity, and a sentence.
_COLUMNS = {
    "sobol": (_INDICES, "With half widths of 95 % intervals; draw more if they are wider than 0.1."),
    "morris": (
        {"effect_mean": "mean effect", "effect_mean_magnitude": "mean magnitude",
         "effect_standard_deviation": "standard deviation"},
        "Change as the key goes from its 12.5 to its 87.5 % quantile.",
    ),
    "local": (_CHANGES, "Change with one standard normal deviate less and more, the other keys at their median."),
}  # fmt: skip


class Draws:
    """Numbers of a result with draws, and the keys that are drawn."""

    def __init__(self, result: xr.Dataset, headlines: Sequence[str] = ()) -> None:
        self.result = result
        self.sample: dict[str, Any] = json.loads(result.attrs["study"])["sample"]
        self.sensitivity = self.sample.get("sensitivity", "")
        drawn = [str(name) for name, one in result.data_vars.items() if SAMPLE in one.dims and one.dtype.kind == "f"]
        common = set.intersection(*(set(result[name].dims) for name in drawn)) if drawn else set()
        self.names = [name for name in drawn if set(result[name].dims) == common]
        self.headline = next((name for name in headlines if name in drawn), next(iter(self.names), ""))
        self.names = [self.headline, *(name for name in self.names if name != self.headline)]
        self.keys = [one for one in result.coords.values() if one.dims == (SAMPLE,) and "key" in one.attrs]

    def points(self, name: str = "") -> list[dict[str, int]]:
        """Return the points of a result with draws."""
        dims = [str(dim) for dim in self.result[name or self.headline].dims if dim != SAMPLE]
        shape = [self.result.sizes[dim] for dim in dims]
        return [dict(zip(dims, index, strict=True)) for index in np.ndindex(*shape)]

    def where(self, point: Mapping[str, int]) -> str:
        """Return a point in words."""
        labelled = [dim for dim in point if dim in self.result.coords]
        return ", ".join(coordinate_text(self.result[dim].isel({dim: point[dim]})) for dim in labelled)

    def values(self, kind: str, point: Mapping[str, int], name: str = "") -> np.ndarray:
        """Return the numbers of a statistic ``NAME_KIND`` at a point, as they are printed."""
        name = name or self.headline
        full = f"{name}_{kind}" if kind else name
        array = self.result[full]
        pure = kind.endswith(("_index", "_interval"))
        scale = 100.0 if not pure and name in self.result and is_fraction(self.result[name]) else 1.0
        return np.asarray(array.isel({dim: at for dim, at in point.items() if dim in array.dims}).to_numpy() * scale)

    def draws(self, name: str, point: Mapping[str, int]) -> np.ndarray:
        """Return the draws at a point that follow the distributions."""
        values = self.values("", point, name)
        if self.sensitivity != "sobol":
            return values
        rows = self.result.sizes[PARAMETER] + 2
        return np.concatenate([values[::rows], values[rows - 1 :: rows]])

    def parameters(self) -> list[str]:
        """Return the names of the parameters."""
        titles = {one.attrs["key"]: title_of(one) for one in self.keys}
        return [titles.get(str(name), str(name).replace("_", " ")) for name in self.result[PARAMETER].to_numpy()]

    def panels(self, height: float = 0.62) -> tuple[Any, list[tuple[Any, dict[str, int]]]]:
        """Return a figure with a panel for each of the first points."""
        from heliosweep.report.draw import panels
        from heliosweep.report.labels import fold

        points = self.points()[:MOST_PANELS]
        drawing, grid = panels(len(points), 2, height)
        for axes, point in zip(grid, points, strict=True):
            axes.set_title(fold(self.where(point)))
            axes.grid(True)
        return drawing, list(zip(grid, points, strict=True))


def figures(result: xr.Dataset, headlines: Sequence[str] = ()) -> Iterator[Figure]:
    """Yield figures of the headline number: distribution, sensitivities, draws over the leading keys, running mean."""
    shown = Draws(result, headlines)
    if not shown.headline:
        return
    what = title_of(result[shown.headline])
    statistics = f"{shown.headline}_sample_mean" in result
    if statistics:
        yield Special(
            "distribution", f"Draws of the {what}, with mean and percentiles", draw=partial(_distribution, shown)
        )
    kinds = {
        "sobol": (
            "sensitivity_indices",
            f"Part of the variance of the {what} due to each key, with 95 % intervals",
            _bars,
        ),
        "local": ("tornado", f"Change of the {what} with one standard normal deviate of each key", _bars),
        "morris": ("elementary_effects", f"Elementary effects of each key on the {what}", _effects),
    }
    if shown.sensitivity in kinds:
        name, title, draw = kinds[shown.sensitivity]
        yield Special(name, title, draw=partial(draw, shown))
    if statistics:
        if any(one.dtype.kind == "f" for one in shown.keys):
            yield Special(
                "leading_keys", f"Draws of the {what} over the most important keys", draw=partial(_scatter, shown)
            )
        yield Special(
            "running_mean",
            f"Mean of the {what} over the first draws, with standard error",
            draw=partial(_running, shown),
        )
    yield from default_figures(result[[name for name in result.data_vars if str(name).endswith("_sample_mean")]])


def tables(result: xr.Dataset, headlines: Sequence[str] = ()) -> Iterator[Table]:
    """Yield statistics of each result, sensitivities of the first, and the drawn keys."""
    shown = Draws(result, headlines)
    if not shown.headline:
        return
    if f"{shown.headline}_sample_mean" in result:
        yield _statistics(shown)
    if PARAMETER in result.sizes:
        yield _parameters(shown)
    texts = [(title_of(one), str(one.attrs["distribution"]), str(one.attrs.get("units", ""))) for one in shown.keys]
    design = str(result.attrs.get("sample_design", ""))
    heads = ("key", "distribution", "unit")
    columns = [Column(head, [row[i] for row in texts]) for i, head in enumerate(heads)]
    yield Table("Drawn keys", columns, notes=[f"{design[:1].upper()}{design[1:]}."] if design else [])


def _statistics(shown: Draws) -> Table:
    """Tabulate mean with standard error, standard deviation and percentiles of each result and point."""
    from heliosweep.report.tables import number_texts

    percentiles = [f"{value:g} %" for value in shown.result["sample_percentile"].to_numpy()]
    pairs = [(name, point) for name in shown.names for point in shown.points(name)][:60]
    rows = []
    for name, point in pairs:
        kinds = ("sample_mean", "sample_standard_error", "sample_standard_deviation")
        rows.append(
            [
                *(float(shown.values(kind, point, name)) for kind in kinds),
                *shown.values("sample_percentile", point, name),
            ]
        )
    texts = [number_texts(np.array(row), 5) for row in rows]
    titles = [f"{title_of(shown.result[name])} {unit_of(shown.result[name])}".rstrip() for name, _ in pairs]
    where = [shown.where(point) for _, point in pairs]
    heads = ["mean", "standard error", "standard deviation", *percentiles]
    columns = [Column("result", titles), *([Column("at", where)] if any(where) else [])]
    return Table(
        "Results over the draws", [*columns, *(Column(head, [row[i] for row in texts]) for i, head in enumerate(heads))]
    )


def _parameters(shown: Draws) -> Table:
    """Tabulate the sensitivities of the headline number, the most important key first."""
    kinds, note = _COLUMNS[shown.sensitivity]
    points = shown.points()[: max(1, 60 // shown.result.sizes[PARAMETER])]
    cells: dict[str, list[Any]] = {kind: [] for kind in kinds}
    errors: dict[str, list[float]] = {kind: [] for kind in kinds}
    where, keys, names = list[str](), list[str](), shown.parameters()
    for point in points:
        numbers = {kind: shown.values(kind, point) for kind in kinds}
        order = _order(np.fmax.reduce(np.abs(list(numbers.values()))))
        where += [shown.where(point)] * order.size
        keys += [names[at] for at in order]
        for kind, values in numbers.items():
            cells[kind] += values[order].tolist()
            if shown.sensitivity == "sobol":
                errors[kind] += shown.values(kind.replace("_index", "_interval"), point)[order].tolist()
    unit = "" if shown.sensitivity == "sobol" else unit_of(shown.result[shown.headline])
    columns = [*([Column("at", where)] if any(where) else []), Column("key", keys)]
    columns += [Column(head, cells[kind], unit, errors=errors[kind]) for kind, head in kinds.items()]
    return Table(f"Sensitivity of the {title_of(shown.result[shown.headline])}", columns, [note])


def _order(values: np.ndarray) -> np.ndarray:
    """Return the positions from the largest magnitude down; missing values last."""
    return np.argsort(-np.nan_to_num(np.abs(values), nan=-1.0), kind="stable")


def _distribution(shown: Draws, result: xr.Dataset) -> Any:
    from heliosweep.report.draw import legend
    from heliosweep.report.labels import fold

    drawing, panels = shown.panels()
    entries: dict[str, Any] = {}
    percents = ", ".join(f"{value:g}" for value in result["sample_percentile"].to_numpy())
    for axes, point in panels:
        values = shown.draws(shown.headline, point)
        values = values[np.isfinite(values)]
        if values.size:
            axes.hist(values, bins=int(np.clip(np.sqrt(values.size), 8, 50)), color=COLOURS[4], edgecolor="white")
        entries["mean"] = axes.axvline(float(shown.values("sample_mean", point)), color=COLOURS[1])
        for value in shown.values("sample_percentile", point):
            entries[f"percentiles {percents}"] = axes.axvline(value, color=COLOURS[0], linestyle="--", linewidth=0.9)
        axes.set(xlabel=fold(axis_label(result[shown.headline])), ylabel="draws")
    legend(drawing, entries)
    return drawing


def _running(shown: Draws, result: xr.Dataset) -> Any:
    from heliosweep.report.labels import fold

    drawing, panels = shown.panels()
    sobol, indices = shown.sample["design"] == "sobol", shown.sensitivity == "sobol"
    for axes, point in panels:
        values = shown.draws(shown.headline, point)
        if indices:  # both halves of a base point together, of one sequence
            values = values.reshape(2, -1).mean(axis=0)
        step = SEQUENCES if sobol else 1
        count = np.arange(step, values.size + 1, step)
        mean = (np.cumsum(values) / np.arange(1, values.size + 1))[count - 1]
        if sobol:
            each = np.cumsum(values[: count[-1]].reshape(-1, SEQUENCES), axis=0) / np.arange(1, count.size + 1)[:, None]
            error = each.std(axis=1, ddof=1) / np.sqrt(SEQUENCES)
        else:
            square = (np.cumsum((values - values[0]) ** 2) / np.arange(1, values.size + 1))[count - 1]
            error = np.sqrt(np.maximum(square - (mean - values[0]) ** 2, 0) / np.maximum(count - 1, 1))
        late = count >= min(FIRST_MEAN, count[-1])
        x = count[late] * (1 + indices)
        axes.fill_between(x, (mean - error)[late], (mean + error)[late], color=COLOURS[4], alpha=0.4)
        axes.plot(x, mean[late], color=COLOURS[0])
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set(xlabel="draws", ylabel=fold(axis_label(result[shown.headline]), 30))
    return drawing


def _bars(shown: Draws, result: xr.Dataset) -> Any:
    """Draw bars of the indices or changes of each key, the longest first."""
    from heliosweep.report.draw import legend
    from heliosweep.report.labels import fold

    kinds = _INDICES if shown.sensitivity == "sobol" else _CHANGES
    label = "part of the variance" if kinds is _INDICES else f"change of the {axis_label(result[shown.headline])}"
    names, entries = shown.parameters(), dict[str, Any]()
    drawing, panels = shown.panels(0.3 + 0.05 * min(len(names), MOST_BARS))
    for axes, point in panels:
        every = {kind: shown.values(kind, point) for kind in kinds}
        order = _order(np.fmax.reduce(np.abs(list(every.values()))))[:MOST_BARS]
        for side, (kind, values) in enumerate(every.items()):
            indices = kinds is _INDICES
            half = shown.values(kind.replace("_index", "_interval"), point)[order] if indices else None
            shift, height = (0.4 * side - 0.2, 0.38) if indices else (0.0, 0.7)
            look: Any = {
                "color": COLOURS[(4, 0)[side] if indices else side],
                "xerr": half,
                "error_kw": {"elinewidth": 0.8},
            }
            entries[kinds[kind]] = axes.barh(np.arange(order.size) + shift, values[order], height, **look)
        axes.set_yticks(range(order.size), [fold(names[at], 30) for at in order])
        axes.invert_yaxis()
        axes.set_xlabel(fold(label, 45))
    legend(drawing, entries)
    return drawing


def _effects(shown: Draws, result: xr.Dataset) -> Any:
    from heliosweep.report.labels import fold

    drawing, panels = shown.panels()
    names, unit = shown.parameters(), unit_of(result[shown.headline])
    unit = f" ({unit})" if unit else ""
    for axes, point in panels:
        right, up = (shown.values(f"effect_{kind}", point) for kind in ("mean_magnitude", "standard_deviation"))
        axes.plot(right, up, "o", color=COLOURS[0])
        for at in _order(right)[:MOST_BARS]:
            far = 2 * right[at] > right.max()
            axes.annotate(fold(names[at], 24), (right[at], up[at]), (-4 if far else 4, 3), fontsize=6.5,
                          textcoords="offset points", ha="right" if far else "left")  # fmt: skip
        axes.margins(0.18)
        axes.set(xlabel=f"mean magnitude of the effects{unit}", ylabel=f"standard deviation of the effects{unit}")
    return drawing


def _scatter(shown: Draws, result: xr.Dataset) -> Any:
    """Draw the headline number over the two keys with the highest rank correlation."""
    from scipy.stats import spearmanr

    from heliosweep.report.draw import panels, tick
    from heliosweep.report.labels import fold

    point = shown.points()[0]
    values = shown.draws(shown.headline, point)
    columns = {str(one.name): shown.draws(str(one.name), {}) for one in shown.keys if one.dtype.kind == "f"}
    varied = {name: column for name, column in columns.items() if np.ptp(column) > 0}
    strength = {name: abs(np.nan_to_num(spearmanr(column, values).statistic)) for name, column in varied.items()}
    leading = sorted(strength, key=lambda name: -strength[name])[:2]
    if not leading:
        return None
    drawing, grid = panels(len(leading), 2, 0.75, sharey=True)
    for axes, name in zip(grid, leading, strict=True):
        axes.plot(columns[name][:MOST_DOTS], values[:MOST_DOTS], ".", markersize=2.5, color=COLOURS[0], alpha=0.6)
        tick(axes.xaxis, result[name], most=5)
        axes.grid(True)
        axes.set(xlabel=fold(axis_label(result[name])))
    grid[0].set_ylabel(fold(axis_label(result[shown.headline])))
    return drawing, f"At {shown.where(point)}." if shown.where(point) else ""

"""Figures and tables of a result with draws: how sure its numbers are, and which key they owe it to."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from heliosweep.report.colours import COLOURS
from heliosweep.report.contents import NamedFigure, Table
from heliosweep.report.labels import axis_label, coordinate_text, folded, is_fraction, number_text, title_of, unit_of
from heliosweep.report.layout import abreast, fit, legend, sheet, tick
from heliosweep.report.sections import number_texts
from heliosweep.report.style import styled

SAMPLE, PARAMETER = "sample", "parameter"
#: Points of what is swept that a figure shows, keys that bars are drawn of, and dots of a scatter.
MOST_PANELS, MOST_BARS, MOST_DOTS = 6, 20, 4000
#: Draws from which running means are drawn, and sequences that Sobol draws are of, one after the other.
FIRST_MEAN, SEQUENCES = 16, 8
#: Rank correlation of keys that have the same draws.
TIED = 0.9999
#: Numbers of each key that bars are drawn of.
_INDICES = {"first_order_index": "first-order index", "total_index": "total index"}
_CHANGES = {"change_down": "one deviate less", "change_up": "one deviate more"}
#: Results in the table of statistics, and rows of a table.
MOST_ROWS = 60

#: Of each kind of sensitivity: the numbers of each key, heads of the columns of its table, and what is said below.
_TOLD = {
    "sobol": (
        ["first_order_index", "first_order_interval", "total_index", "total_interval"],
        ["first-order index", "total index"],
        "Behind each index stands half of its 95 % interval; * marks those wider than 0.1: draw more.",
    ),
    "morris": (
        ["effect_mean", "effect_mean_magnitude", "effect_standard_deviation"],
        ["mean effect", "mean magnitude", "standard deviation"],
        "Change as the key goes from its 12.5 to its 87.5 % quantile.",
    ),
    "local": (
        [*_CHANGES],
        [*_CHANGES.values()],
        "Change with one standard normal deviate less, and more, of the key, the others at their median.",
    ),
}


class Draws:
    """The numbers of a result that are drawn, and the keys that they are drawn from."""

    def __init__(self, result: xr.Dataset, headlines: Sequence[str] = ()) -> None:
        self.result = result
        self.sample: dict[str, Any] = json.loads(result.attrs["study"])["sample"]
        self.sensitivity = self.sample.get("sensitivity", "")
        drawn = [str(name) for name, one in result.data_vars.items() if SAMPLE in one.dims and one.dtype.kind == "f"]
        common = set.intersection(*(set(result[name].dims) for name in drawn)) if drawn else set()
        #: Results with the fewest dimensions: numbers of a draw at each point of what is swept; the headline first.
        self.names = [name for name in drawn if set(result[name].dims) == common]
        self.headline = next((name for name in headlines if name in drawn), next(iter(self.names), ""))
        self.names = [self.headline, *(name for name in self.names if name != self.headline)]
        self.keys = [one for one in result.coords.values() if one.dims == (SAMPLE,) and "key" in one.attrs]

    def points(self, name: str = "") -> list[dict[str, int]]:
        """Points of a result, by default of the headline, for each of which there are draws."""
        dims = [str(dim) for dim in self.result[name or self.headline].dims if dim != SAMPLE]
        shape = [self.result.sizes[dim] for dim in dims]
        return [dict(zip(dims, index, strict=True)) for index in np.ndindex(*shape)]

    def where(self, point: dict[str, int]) -> str:
        """A point in words."""
        labelled = [dim for dim in point if dim in self.result.coords]
        return ", ".join(coordinate_text(self.result[dim].isel({dim: point[dim]})) for dim in labelled)

    def values(self, name: str, point: dict[str, int]) -> np.ndarray:
        """Numbers at a point, as they are printed."""
        array = self.result[name].isel({dim: at for dim, at in point.items() if dim in self.result[name].dims})
        return array.to_numpy() * self.factor(name)

    def factor(self, name: str) -> float:
        """100 for fractions of one and what is derived of them in their unit, which are printed in percent."""
        own = next((one for one in self.names if name == one or name.startswith(f"{one}_")), name)
        pure = name.endswith(("_index", "_interval"))
        return 100.0 if not pure and own in self.result and is_fraction(self.result[own]) else 1.0

    def draws(self, name: str, point: dict[str, int]) -> np.ndarray:
        """Draws at a point that follow the distributions."""
        values = self.values(name, point)
        if self.sensitivity != "sobol":
            return values
        rows = self.result.sizes[PARAMETER] + 2
        return np.concatenate([values[::rows], values[rows - 1 :: rows]])

    def parameter(self, name: str) -> str:
        """What a parameter is called: the key's words, or the name of a group."""
        return next((title_of(one) for one in self.keys if one.attrs["key"] == name), name.replace("_", " "))


def figures(result: xr.Dataset, headlines: Sequence[str] = ()) -> Iterator[NamedFigure]:
    """Distribution and running mean, bars of what each key does, and the result over the two leading keys."""
    shown = Draws(result, headlines)
    if not shown.headline:
        return
    what = title_of(result[shown.headline])
    if f"{shown.headline}_sample_mean" in result:
        caption = f"Distribution of the {what}: its draws, their mean, and percentiles."
        yield NamedFigure("distribution", caption, _distribution(shown))
    if shown.sensitivity == "sobol":
        caption = f"What the variance of the {what} owes to each key, with 95 % intervals."
        yield NamedFigure("sensitivity_indices", caption, _bars(shown, _INDICES, "part of the variance"))
    if shown.sensitivity == "local":
        caption = f"Change of the {what} with one standard normal deviate of each key, the others at their median."
        label = f"change of the {axis_label(result[shown.headline])}"
        yield NamedFigure("tornado", caption, _bars(shown, _CHANGES, label))
    if shown.sensitivity == "morris":
        caption = (
            f"Elementary effects of each key on the {what}: to the right it matters, upwards it bends or interacts."
        )
        yield NamedFigure("elementary_effects", caption, _effects(shown))
    if f"{shown.headline}_sample_mean" in result:
        if any(one.dtype.kind == "f" for one in shown.keys):
            yield NamedFigure("leading_keys", f"Draws of the {what} over the keys it follows most.", _scatter(shown))
        caption = f"Mean of the {what} over the first draws, with its standard error."
        yield NamedFigure("running_mean", caption, _running(shown))


def tables(result: xr.Dataset, headlines: Sequence[str] = ()) -> Iterator[Table]:
    """Mean, error, deviation and percentiles of each result, and what each key does to the first."""
    shown = Draws(result, headlines)
    if not shown.headline:
        return
    if f"{shown.headline}_sample_mean" in result:
        yield _statistics(shown)
    if PARAMETER in result.sizes:
        yield _parameters(shown)
    design = str(result.attrs.get("sample_design", ""))
    yield Table(
        "Drawn keys",
        ["key", "distribution", "unit"],
        [[title_of(one), str(one.attrs["distribution"]), str(one.attrs.get("units", ""))] for one in shown.keys],
        words=range(3),
        notes=[f"{design[:1].upper()}{design[1:]}."],
    )


def _statistics(shown: Draws) -> Table:
    result, rows = shown.result, list[list[str]]()
    percentiles = [f"{value:g} %" for value in result["sample_percentile"].to_numpy()]
    for name, point in islice(((one, at) for one in shown.names for at in shown.points(one)), MOST_ROWS):
        numbers = [shown.values(f"{name}_sample_{what}", point) for what in ("mean", "standard_error")]
        numbers += [shown.values(f"{name}_sample_standard_deviation", point)]
        numbers += list(shown.values(f"{name}_sample_percentile", point))
        label = f"{title_of(result[name])}{f' ({unit})' if (unit := unit_of(result[name])) else ''}"
        rows.append([label, shown.where(point), *_alike(np.array(numbers, float))])
    if not any(row[1] for row in rows):
        rows = [[row[0], *row[2:]] for row in rows]
    several = [""] if len(rows[0]) == 5 + len(percentiles) else []
    header = ["result", *several, "mean", "standard error", "standard deviation", *percentiles]
    return Table("Results over the draws", header, rows, words=range(1 + len(several)))


def _alike(values: np.ndarray) -> list[str]:
    """Mean, error, deviation and percentiles: the error with two digits, the others with three of the deviation."""
    error, deviation = values[1:3]
    if not np.isfinite(values).all() or error <= 0 or deviation <= 0:
        return number_texts(values)
    own, decimals = (
        int(np.clip(digits - np.floor(np.log10(value)), 0, 8)) for digits, value in ((1, error), (2, deviation))
    )
    return [number_text(value, own if place == 1 else decimals) for place, value in enumerate(values)]


def _parameters(shown: Draws) -> Table:
    result, name, rows = shown.result, shown.headline, list[list[str]]()
    columns, header, note = _TOLD[shown.sensitivity]
    for point in shown.points()[: max(1, MOST_ROWS // result.sizes[PARAMETER])]:
        numbers = [shown.values(f"{name}_{column}", point) for column in columns]
        for at in _order(numbers[2 if shown.sensitivity == "sobol" else 1]):
            cells = [number_text(float(column[at]), 3) for column in numbers]
            if shown.sensitivity == "sobol":
                wide = [" *" if 2 * numbers[k][at] > 0.1 else "" for k in (1, 3)]
                plus = "\N{PLUS-MINUS SIGN}"
                cells = [f"{cells[k]} {plus} {cells[k + 1]}{wide[k // 2]}" for k in (0, 2)]
            rows.append([shown.where(point), shown.parameter(str(result[PARAMETER].to_numpy()[at])), *cells])
    unit = "" if shown.sensitivity == "sobol" else unit_of(result[name])
    several = any(row[0] for row in rows)
    rows = rows if several else [row[1:] for row in rows]
    words = [""] * several + ["key"]
    units = [*("" for _ in words), *(unit for _ in header)]
    return Table(
        f"Sensitivity of the {title_of(result[name])}", [*words, *header], rows, range(len(words)), [note], units
    )


def _order(values: np.ndarray) -> np.ndarray:
    """Positions from the largest magnitude down; missing values last."""
    return np.argsort(-np.nan_to_num(np.abs(values), nan=-1.0), kind="stable")


def _panels(shown: Draws, high: bool = False) -> tuple[Figure, list[tuple[Axes, dict[str, int]]]]:
    """A panel for each of the first points."""
    points = shown.points()[:MOST_PANELS]
    columns = abreast(len(points), 2)
    figure, axes = sheet(len(points), columns, wide=high)
    for one, point in zip(axes, points, strict=True):
        one.set_title(shown.where(point))
    return figure, list(zip(axes, points, strict=True))


@styled
def _distribution(shown: Draws) -> Figure:
    figure, panels = _panels(shown)
    entries: dict[str, Any] = {}
    for axes, point in panels:
        values = shown.draws(shown.headline, point)
        values = values[np.isfinite(values)]
        if values.size:
            bins = int(np.clip(np.sqrt(values.size), 8, 50))
            axes.hist(values, bins=bins, color=COLOURS[4], edgecolor="white", linewidth=0.3)
        mean = axes.axvline(float(shown.values(f"{shown.headline}_sample_mean", point)), color=COLOURS[1])
        entries["mean"] = mean
        percents = shown.result["sample_percentile"].to_numpy()
        for value in shown.values(f"{shown.headline}_sample_percentile", point):
            line = axes.axvline(value, color=COLOURS[0], linestyle=(0, (4, 1.6)), linewidth=0.9)
            entries[f"percentiles {', '.join(f'{each:g}' for each in percents)}"] = line
        axes.set(xlabel=axis_label(shown.result[shown.headline]), ylabel="draws")
    legend(figure, entries)
    return fit(figure, 0.62)


@styled
def _running(shown: Draws) -> Figure:
    figure, panels = _panels(shown)
    sobol = shown.sample["design"] == "sobol"
    for axes, point in panels:
        values = shown.draws(shown.headline, point)
        if shown.sensitivity == "sobol":  # both halves of a base point side by side, of one sequence
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
        points_of = 2 if shown.sensitivity == "sobol" else 1
        axes.fill_between(
            points_of * count[late], (mean - error)[late], (mean + error)[late], color=COLOURS[4], alpha=0.4
        )
        axes.plot(points_of * count[late], mean[late], color=COLOURS[0])
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.grid(True)
        axes.set(xlabel="draws", ylabel=axis_label(shown.result[shown.headline]))
    return fit(figure, 0.62)


@styled
def _bars(shown: Draws, kinds: Mapping[str, str], label: str) -> Figure:
    """Draw bars of some numbers of each key, with their intervals where they have some, the longest first."""
    figure, panels = _panels(shown, high=True)
    names, entries = shown.result[PARAMETER].to_numpy(), dict[str, Any]()
    for axes, point in panels:
        every = {kind: shown.values(f"{shown.headline}_{kind}", point) for kind in kinds}
        order = _order(np.fmax.reduce(np.abs(list(every.values()))))[:MOST_BARS]
        for side, (kind, values) in enumerate(every.items()):
            interval = f"{shown.headline}_{kind.removesuffix('_index')}_interval"
            half = shown.values(interval, point)[order] if interval in shown.result else None
            shift, height, colours = (0.0, 0.7, (0, 1)) if half is None else (0.4 * side - 0.2, 0.38, (4, 0))
            look: Any = {"color": COLOURS[colours[side]], "ecolor": "#333333"}
            look |= {"xerr": half, "error_kw": {"elinewidth": 0.8, "capsize": 1.5}}
            entries[kinds[kind]] = axes.barh(np.arange(order.size) + shift, values[order], height, **look)
        _name_bars(axes, [shown.parameter(str(names[at])) for at in order])
        axes.axvline(0, color="#444444", linewidth=0.8)
        axes.set_xlabel(label)
    legend(figure, entries)
    return fit(figure, 0.62)


@styled
def _effects(shown: Draws) -> Figure:
    figure, panels = _panels(shown, high=True)
    names = shown.result[PARAMETER].to_numpy()
    unit = unit_of(shown.result[shown.headline])
    for axes, point in panels:
        right, up = (
            shown.values(f"{shown.headline}_effect_{what}", point) for what in ("mean_magnitude", "standard_deviation")
        )
        axes.plot(right, up, "o", color=COLOURS[0])
        for at in _order(right)[:MOST_BARS]:
            word = folded(shown.parameter(str(names[at])), at + 1)
            far = 2 * right[at] > right.max()
            axes.annotate(word, (right[at], up[at]), (-4 if far else 4, 3), textcoords="offset points",
                          fontsize=6.5, ha="right" if far else "left")  # fmt: skip
        axes.margins(0.18)
        axes.grid(True)
        axes.set(
            xlabel=f"mean magnitude of the effects ({unit or '1'})", ylabel=f"their standard deviation ({unit or '1'})"
        )
    return fit(figure, 0.62)


def _name_bars(axes: Axes, words: Sequence[str]) -> None:
    axes.set_yticks(range(len(words)), [folded(word, number, 30) for number, word in enumerate(words, 1)])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.grid(True, axis="x")


@styled
def _scatter(shown: Draws) -> Figure:
    point = shown.points()[0]
    values = shown.draws(shown.headline, point)
    columns = {str(one.name): shown.draws(str(one.name), {}) for one in shown.keys if one.dtype.kind == "f"}
    strength = {name: _rank_correlation(column, values) for name, column in columns.items()}
    leading: list[str] = []
    for name in sorted(strength, key=lambda name: -strength[name]):
        tied = any(_rank_correlation(columns[name], columns[other]) > TIED for other in leading)
        leading += [] if tied or len(leading) == 2 else [name]
    figure, axes = sheet(len(leading), len(leading), sharey=True)
    for one, name in zip(axes, leading, strict=True):
        one.plot(columns[name][:MOST_DOTS], values[:MOST_DOTS], ".", markersize=2.5, color=COLOURS[0], alpha=0.6)
        tick(one.xaxis, shown.result[name], most=5)
        one.grid(True)
        one.set(xlabel=axis_label(shown.result[name]))
    axes[0].set_ylabel(axis_label(shown.result[shown.headline]))
    if where := shown.where(point):
        axes[0].set_title(where)
    return fit(figure, 0.75)


def _rank_correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Magnitude of Spearman's rank correlation; 0 where one does not vary or a value is missing."""
    if not (np.isfinite(one).all() and np.isfinite(other).all()) or np.ptp(one) == 0 or np.ptp(other) == 0:
        return 0.0
    ranks = np.stack([np.argsort(np.argsort(values)).astype(float) for values in (one, other)])
    return float(abs(np.corrcoef(ranks)[0, 1]))

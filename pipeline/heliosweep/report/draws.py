"""Figures and tables of results with draws: uncertainty of the results, and sensitivity to each key."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.colours import COLOURS
from heliosweep.report.context import Context
from heliosweep.report.figures import Figure, Special, default_figures
from heliosweep.report.labels import axis_label, fold, is_fraction, quantities, title_of, unit_of
from heliosweep.report.tables import Column, Table, number_texts

SAMPLE, PARAMETER = "sample", "parameter"
#: Maximum number of points with a panel, of keys with a bar, of dots, and of rows of a table.
MOST_PANELS, MOST_BARS, MOST_DOTS, MOST_ROWS = 6, 20, 4000, 60
#: Title of the figure of each kind of sensitivity, its statistics with their names, and a sentence for the table.
_KINDS: dict[str, tuple[str, dict[str, str], str]] = {
    "sobol": (
        "Part of the variance of the {} due to each key, with 95 % intervals",
        {"first_order_index": "first-order index", "total_index": "total index"},
        "The errors are half widths of 95 % intervals; increase the sample size if they exceed 0.1.",
    ),
    "morris": (
        "Elementary effects of each key on the {}",
        {"effect_mean_magnitude": "mean magnitude", "effect_standard_deviation": "standard deviation",
         "effect_mean": "mean effect"},
        "Change as the key goes from its 12.5 to its 87.5 % quantile.",
    ),
    "local": (
        "Change of the {} with one standard normal deviate of each key",
        {"change_down": "one deviate less", "change_up": "one deviate more"},
        "Change with one standard normal deviate less and more, the other keys at their median.",
    ),
}  # fmt: skip


class Draws:
    """Numbers of a result with draws, and the keys that are drawn."""

    def __init__(self, result: xr.Dataset, headlines: Sequence[str] = ()) -> None:
        self.result = result
        self.sensitivity = json.loads(result.attrs["study"])["sample"].get("sensitivity", "")
        drawn = [name for name in quantities(result) if SAMPLE in result[name].dims and result[name].dtype.kind == "f"]
        self.headline = next((name for name in headlines if name in drawn), next(iter(drawn), ""))
        common = set.intersection(*(set(result[name].dims) for name in drawn)) if drawn else set()
        names = [name for name in drawn if set(result[name].dims) == common and name != self.headline]
        self.names = [self.headline, *names]
        self.keys = [one for one in result.coords.values() if one.dims == (SAMPLE,) and "key" in one.attrs]
        titles = {one.attrs["key"]: title_of(one) for one in self.keys}
        keys = map(str, result[PARAMETER].to_numpy()) if PARAMETER in result.sizes else ()
        self.parameters = [titles.get(key, key.replace("_", " ")) for key in keys]

    def points(self, name: str = "") -> list[dict[str, int]]:
        """Return the points of a result with draws."""
        sizes = {str(dim): size for dim, size in self.result[name or self.headline].sizes.items() if dim != SAMPLE}
        return [dict(zip(sizes, index, strict=True)) for index in np.ndindex(*sizes.values())]

    def where(self, point: Mapping[str, int]) -> str:
        """Return a point in words."""
        return Context(self.result).fulls({dim: at for dim, at in point.items() if dim in self.result.coords})

    def values(self, kind: str, point: Mapping[str, int], name: str = "") -> np.ndarray:
        """Return the numbers of a statistic ``NAME_KIND`` at a point, as they are printed."""
        name = name or self.headline
        array = self.result[f"{name}_{kind}" if kind else name]
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

    def ranked(self, point: Mapping[str, int]) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Return the order of the keys by magnitude at a point, the sensitivities, and half widths of intervals."""
        numbers = {kind: self.values(kind, point) for kind in _KINDS[self.sensitivity][1]}
        largest = np.fmax.reduce(np.abs(list(numbers.values())))
        halves = {kind: self.values(kind.replace("_index", "_interval"), point)
                  for kind in numbers if self.sensitivity == "sobol"}  # fmt: skip
        return np.argsort(-np.nan_to_num(largest, nan=-1.0), kind="stable"), numbers, halves

    def panels(self, height: float = 0.62) -> tuple[Any, list[tuple[Any, dict[str, int]]]]:
        """Return a figure with a panel for each of the first points."""
        from heliosweep.report.draw import panels

        points = self.points()[:MOST_PANELS]
        drawing, grid = panels(len(points), 2, height)
        for axes, point in zip(grid, points, strict=True):
            axes.set_title(fold(self.where(point)))
            axes.grid(True)
        return drawing, list(zip(grid, points, strict=True))


def figures(result: xr.Dataset, headlines: Sequence[str] = ()) -> Iterator[Figure]:
    """Yield figures of the headline number: distribution, sensitivities, and draws over the leading keys."""
    shown = Draws(result, headlines)
    if not shown.headline:
        return
    title, statistics = title_of(result[shown.headline]), f"{shown.headline}_sample_mean" in result
    if statistics:
        yield Special(
            "distribution", f"Draws of the {title}, with mean and percentiles", draw=partial(_histogram, shown)
        )
    if shown.sensitivity in _KINDS:
        yield Special("sensitivity", _KINDS[shown.sensitivity][0].format(title), draw=partial(_bars, shown))
    if statistics and any(one.dtype.kind == "f" for one in shown.keys):
        yield Special("leading_keys", f"Draws of the {title} over the most important keys", draw=partial(_dots, shown))
    yield from default_figures(result[[name for name in result.data_vars if str(name).endswith("_sample_mean")]])


def tables(result: xr.Dataset, headlines: Sequence[str] = ()) -> Iterator[Table]:
    """Yield statistics of each result, sensitivities of the first, and the drawn keys."""
    shown = Draws(result, headlines)
    if not shown.headline:
        return
    if f"{shown.headline}_sample_mean" in result:
        yield _statistics(shown)
    if PARAMETER in result.sizes:
        yield _sensitivities(shown)
    texts = [(title_of(one), str(one.attrs["distribution"]), str(one.attrs.get("units", ""))) for one in shown.keys]
    design = str(result.attrs.get("sample_design", ""))
    columns = [Column(head, [row[i] for row in texts]) for i, head in enumerate(("key", "distribution", "unit"))]
    yield Table("Drawn keys", columns, notes=[f"{design[:1].upper()}{design[1:]}."] if design else [])


def _statistics(shown: Draws) -> Table:
    """Tabulate mean with standard error, standard deviation and percentiles of each result and point."""
    percentiles = [f"{value:g} %" for value in shown.result["sample_percentile"].to_numpy()]
    kinds = ("sample_mean", "sample_standard_error", "sample_standard_deviation", "sample_percentile")
    pairs = [(name, point) for name in shown.names for point in shown.points(name)][:MOST_ROWS]
    rows = [np.hstack([shown.values(kind, point, name) for kind in kinds]) for name, point in pairs]
    titles = [f"{title_of(shown.result[name])} {unit_of(shown.result[name])}".rstrip() for name, _ in pairs]
    where = [shown.where(point) for _, point in pairs]
    heads = ["mean", "standard error", "standard deviation", *percentiles]
    columns = [Column("result", titles), *([Column("at", where)] if any(where) else [])]
    texts = zip(*(number_texts(row, 5) for row in rows), strict=True)
    return Table("Results over the draws", [*columns, *map(Column, heads, map(list, texts))])


def _sensitivities(shown: Draws) -> Table:
    """Tabulate the sensitivities of the headline number, the most important key first."""
    _, kinds, note = _KINDS[shown.sensitivity]
    where, keys = list[str](), list[str]()
    cells, errors = ({kind: list[float]() for kind in kinds} for _ in range(2))
    for point in shown.points()[: max(1, MOST_ROWS // shown.result.sizes[PARAMETER])]:
        order, numbers, halves = shown.ranked(point)
        where += [shown.where(point)] * order.size
        keys += [shown.parameters[at] for at in order]
        for kind in kinds:
            cells[kind] += numbers[kind][order].tolist()
            errors[kind] += halves[kind][order].tolist() if halves else []
    unit = "" if shown.sensitivity == "sobol" else unit_of(shown.result[shown.headline])
    columns = [*([Column("at", where)] if any(where) else []), Column("key", keys)]
    columns += [Column(head, cells[kind], unit, errors=errors[kind]) for kind, head in kinds.items()]
    return Table(f"Sensitivity of the {title_of(shown.result[shown.headline])}", columns, [note])


def _histogram(shown: Draws, result: xr.Dataset) -> Any:
    """Draw the distribution of the headline number."""
    from heliosweep.report.draw import legend

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
        axes.set(xlabel=fold(axis_label(result[shown.headline])), ylabel="number of draws")
    legend(drawing, entries)
    return drawing


def _bars(shown: Draws, result: xr.Dataset) -> Any:
    """Draw bars of the sensitivities of each key, the longest first."""
    from heliosweep.report.draw import legend

    is_sobol, kinds = shown.sensitivity == "sobol", list(_KINDS[shown.sensitivity][1].items())[:2]
    label = "part of the variance" if is_sobol else f"change of the {axis_label(result[shown.headline])}"
    entries: dict[str, Any] = {}
    drawing, panels = shown.panels(0.3 + 0.05 * min(len(shown.parameters), MOST_BARS))
    for axes, point in panels:
        order, numbers, halves = shown.ranked(point)
        order = order[:MOST_BARS]
        shift = 0.0 if shown.sensitivity == "local" else 0.2  # bars to the left and the right share a row
        for side, (kind, head) in enumerate(kinds):
            look: Any = {"color": COLOURS[(4, 0)[side]], "error_kw": {"elinewidth": 0.8}}
            errors = halves[kind][order] if halves else None
            rows = np.arange(order.size) + shift * (2 * side - 1)
            entries[head] = axes.barh(rows, numbers[kind][order], 0.38 if shift else 0.7, xerr=errors, **look)
        axes.set_yticks(range(order.size), [fold(shown.parameters[at], 30) for at in order])
        axes.invert_yaxis()
        axes.set_xlabel(fold(label, 45))
    legend(drawing, entries)
    return drawing


def _dots(shown: Draws, result: xr.Dataset) -> Any:
    """Draw the headline number over the two keys with the highest rank correlation."""
    from scipy.stats import spearmanr

    from heliosweep.report.draw import panels

    point = shown.points()[0]
    values = shown.draws(shown.headline, point)
    columns = {str(one.name): shown.draws(str(one.name), {}) for one in shown.keys if one.dtype.kind == "f"}
    strength = {name: abs(np.nan_to_num(spearmanr(column, values).statistic))
                for name, column in columns.items() if np.ptp(column) > 0}  # fmt: skip
    leading = sorted(strength, key=lambda name: -strength[name])[:2]
    if not leading:
        return None
    drawing, grid = panels(len(leading), 2, 0.75, sharey=True)
    for axes, name in zip(grid, leading, strict=True):
        axes.plot(columns[name][:MOST_DOTS], values[:MOST_DOTS], ".", markersize=2.5, color=COLOURS[0], alpha=0.6)
        axes.set(xlabel=fold(axis_label(result[name])))
        axes.grid(True)
    grid[0].set_ylabel(fold(axis_label(result[shown.headline])))
    return drawing, f"At {shown.where(point)}." if shown.where(point) else ""

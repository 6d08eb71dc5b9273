"""Errors against what is swept: curves over one number, maps over two, with the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing import report_views as views
from heliosweep.families.backward_gazing import report_words as wording
from heliosweep.families.backward_gazing.report_errors import FLOOR, middle, percent
from heliosweep.families.backward_gazing.report_views import (
    DIRECTIONS,
    HELIOSTAT,
    METHOD,
    MODULE,
    REFERENTIAL,
    Way,
    at,
    needs,
)
from heliosweep.families.registry import NamedFigure
from heliosweep.report.curves import Panel, curve_figure
from heliosweep.report.grids import Grid, Side, grid_figure
from heliosweep.report.labels import is_latitude

#: Swept numbers with curves; lines up to which each has its band.
MOST_RUNS, MOST_BANDS = 3, 4

#: Least height of an axis of errors in percent and in mrad.
LEAST_PERCENT, LEAST_MRAD = 0.02, 2e-4

#: From this ratio of the ends on, numbers that are all positive are drawn on a logarithmic axis.
LOGARITHMIC = 30.0

#: Values below this are rounding and do not stand on logarithmic axes. [mrad]
ROUNDING = 1e-7

#: Parts of pixels and cameras that change less than this are not shown. [%]
LEAST_CHANGE = 0.1

#: A line whose least value is a smaller part of its largest comes down to nothing.
LEAST_PART = 0.01

_BOUND = "Cramér-Rao bound"


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Curves and maps over swept numbers.

    Parameters
    ----------
    result : xarray.Dataset
        The result.

    Yields
    ------
    NamedFigure
    """
    for draw in (_relative_errors, _rms_errors, _sight, _grids):
        yield from draw(result)


@needs("relative_error_x", "relative_error_y")
def _relative_errors(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Relative error of one module over each swept number, for every method and referential."""
    start, end_of = middle(result)
    name = f"{start}x{end_of}"
    if HELIOSTAT in result[name].dims:
        return
    factor = percent(result, name)
    for run in views.swept(result, name)[:MOST_RUNS]:
        stands = views.fixed(result, name, run, METHOD, REFERENTIAL, views.sort_of(result, name), MODULE)
        module = views.modules(result, name, most=1)[0]
        ways, profiles = views.ways(result, name), views.sorts(result, name)
        order = views.ordered(result, run)
        x = result[run].to_numpy()[order].astype(float)
        panels = []
        for profile, where in profiles:
            for end, direction in DIRECTIONS.items():
                points = (stands, module[1], where)
                lines = {
                    way.name: (x, factor * _line(result, f"{start}{end}{end_of}", order, run, *points, way.point))
                    for way in ways
                }
                bands = {}
                if end_of and len(ways) <= MOST_BANDS:
                    for way in ways:
                        low, high = (
                            factor * _line(result, f"{start}{end}_{kind}", order, run, *points, way.point)
                            for kind in ("low", "high")
                        )
                        median = lines[way.name][1]
                        bands[way.name] = np.maximum(np.stack([median - low, high - median]), 0.0)
                title = ", ".join(filter(None, [profile, direction]))
                panels.append(Panel("error of the slope (% of the canting)", lines, title, bands))
        if not _known(panels):
            continue
        logarithmic = _many_decades(panels, FLOOR)
        if logarithmic:
            panels = [_floored(panel) for panel in panels]
        floor = f" Less than {FLOOR:g} % is drawn there." if logarithmic else ""
        lines_are = " Lines: median over the seeds" + (", bands: 5 to 95 %." if panels[0].bands else ".")
        caption = (
            f"Mean error of the slopes of {module[0] or 'the module'} against the "
            f"{wording.title(result, run)}, by method and referential.{lines_are if end_of else ''}{floor}"
            f"{wording.note(result, stands, (views.sort_of(result, name), profiles))}"
        )
        figure = curve_figure(
            panels,
            wording.label(result, run),
            latitude=is_latitude(result[run]),
            logarithmic=_is_logarithmic(x),
            logarithmic_values=logarithmic,
            same_scale="row",
            least_span=LEAST_PERCENT,
            looks=_looks(ways),
        )
        yield NamedFigure(f"errors_over_{run}", caption, figure)


@needs("slope_rms_x", "slope_rms_y")
def _rms_errors(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Scatter of the slopes of the pixels over each swept number, with the bound that the cameras leave."""
    name = "slope_rms_x"
    bound = "cramer_rao_bound_x" in result and "cramer_rao_bound_y" in result
    if MODULE not in result[name].dims or not bound:
        return
    for run in views.swept(result, name)[:MOST_RUNS]:
        stands = views.fixed(result, name, run, METHOD, REFERENTIAL, MODULE, *views.SEEDS)
        module = views.modules(result, name, most=1)[0]
        ways = [way for way in views.ways(result, name) if way.referential in ("", "exact")] or views.ways(result, name)
        order = views.ordered(result, run)
        x = result[run].to_numpy()[order].astype(float)
        panels = []
        for end, direction in DIRECTIONS.items():
            points = (stands, module[1])
            lines = {
                way.name: (x, _line(result, f"slope_rms_{end}", order, run, *points, way.point, seeds=True))
                for way in ways
            }
            least = _line(result, f"cramer_rao_bound_{end}", order, run, *points, seeds=True)
            lines[_BOUND] = (x, np.where(least > ROUNDING, least, np.nan))
            panels.append(Panel("rms error of the slope (mrad)", lines, direction))
        bounds = [panel.lines[_BOUND][1] for panel in panels]
        if not _known(panels) or not np.isfinite(bounds).any():
            continue
        caption = (
            f"Root mean square error of the slopes of the pixels of {module[0] or 'the module'} against the "
            f"{wording.title(result, run)}; bound: least standard deviation that noise and levels of the cameras leave."
            f"{_over_seeds(result, name)}"
            f"{wording.note(result, stands)}"
        )
        figure = curve_figure(
            panels,
            wording.label(result, run),
            logarithmic=_is_logarithmic(x),
            logarithmic_values=_many_decades(panels, ROUNDING),
            same_scale=True,
            least_span=LEAST_MRAD,
            looks={**_looks(ways), _BOUND: {"color": "#000000", "linestyle": (0, (4, 1.6)), "marker": ""}},
        )
        yield NamedFigure(f"rms_errors_over_{run}", caption, figure)


@needs("usable_fraction", "lit_cameras")
def _sight(result: xr.Dataset) -> Iterator[NamedFigure]:
    """How much of the modules has slopes over each swept number."""
    if MODULE not in result["usable_fraction"].dims:
        return
    for run in views.swept(result, "lit_cameras")[:MOST_RUNS]:
        stands = {
            **views.fixed(result, "usable_fraction", run, MODULE),
            **views.fixed(result, "lit_cameras", run, MODULE),
        }
        order = views.ordered(result, run)
        x = result[run].to_numpy()[order].astype(float)
        shown = views.modules(result, "lit_cameras")
        panels = [
            Panel("part (%)", {t: (x, 100 * _line(result, name, order, run, stands, one)) for t, one in shown}, title)
            for name, title in (("usable_fraction", "pixels with slopes"), ("lit_cameras", "lit cameras"))
            if run in result[name].dims
        ]
        values = np.concatenate([y for panel in panels for _, y in panel.lines.values()])
        values = values[np.isfinite(values)]
        if not values.size or np.ptp(values) < LEAST_CHANGE:
            continue
        caption = (
            "Part of the pixels of a module that have slopes, and part of the cameras that see the sun in it, "
            f"against the {wording.title(result, run)}.{wording.note(result, stands, (MODULE, shown))}"
        )
        figure = curve_figure(
            panels, wording.label(result, run), logarithmic=_is_logarithmic(x), same_scale=True, least_span=5.0
        )
        yield NamedFigure(f"sight_over_{run}", caption, figure)


@needs("slope_rms_x", "slope_rms_y", "usable_fraction")
def _grids(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Error and reach of the best method over two swept numbers."""
    name = "slope_rms_x"
    dims = views.swept(result, name)
    if len(dims) < 2 or MODULE not in result[name].dims:
        return
    across, up = dims[:2]
    stands = views.fixed(result, name, across, up, MODULE, *views.SEEDS)
    module = views.modules(result, name, most=1)[0]
    orders = {dim: views.ordered(result, dim) for dim in (across, up)}

    def grid(variable: str, factor: float = 1.0) -> np.ndarray:
        array = _rms(at(result[variable], stands, module[1])).isel(orders).transpose(up, across)
        return factor * array.to_numpy().astype(float)

    if not {across, up} <= set(result["usable_fraction"].dims):
        return
    grids = [Grid(f"rms error of {word} slope (mrad)", grid(f"slope_rms_{end}")) for end, word in DIRECTIONS.items()]
    usable = grid("usable_fraction", 100.0)
    known = usable[np.isfinite(usable)]
    seen = bool(known.size and np.ptp(known) > LEAST_CHANGE)
    grids += [Grid("pixels with slopes (%)", usable)] if seen else []
    if not any(np.isfinite(one.values).any() for one in grids[:2]):
        return
    method = views.short(result, METHOD, stands[METHOD]) if METHOD in stands else ""
    by = f"{method} finds for" if method else "are found for"
    caption = (
        f"Root mean square error of the slopes that {by} {module[0] or 'the module'}"
        f"{', and part of its pixels that have slopes. Grey: none' if seen else ''}.{_over_seeds(result, name)}"
        f"{wording.note(result, stands)}"
    )
    sides = []
    for dim in (across, up):
        values = result[dim].to_numpy()[orders[dim]].astype(float)
        sides.append(Side(wording.short_label(result, dim), values, logarithmic=_is_logarithmic(values)))
    yield NamedFigure(f"accuracy_over_{across}_and_{up}", caption, grid_figure(grids, *sides))


def _over_seeds(result: xr.Dataset, quantity: str) -> str:
    seeds = [result.sizes[dim] for dim in views.SEEDS if dim in result[quantity].dims]
    return f" Over {int(np.prod(seeds))} seeds." if seeds else ""


def _rms(array: xr.DataArray) -> xr.DataArray:
    """Root mean square over the seeds."""
    seeds = [dim for dim in views.SEEDS if dim in array.dims]
    return (array**2).mean(seeds) ** 0.5 if seeds else array


def _line(
    result: xr.Dataset, name: str, order: np.ndarray, run: str, *points: views.Point, seeds: bool = False
) -> np.ndarray:
    """Values along one dimension, in its order; constant where the variable does not have it.

    With `seeds`, the points leave the seeds, and values are root mean squares over them.
    """
    array = at(result[name], *points)
    array = _rms(array) if seeds else array
    if run not in array.dims:
        return np.full(order.size, float(array))
    return array.to_numpy().astype(float)[order]


def _looks(ways: Sequence[Way]) -> dict[str, dict[str, object]]:
    return {way.name: way.look for way in ways}


def _known(panels: Sequence[Panel]) -> bool:
    return any(np.isfinite(y).any() for panel in panels for _, y in panel.lines.values())


def _is_logarithmic(x: np.ndarray) -> bool:
    """Whether numbers are many times each other and more evenly spaced by their logarithms."""
    return bool(x.size > 2 and x[0] > 0 and x[-1] >= LOGARITHMIC * x[0])


def _many_decades(panels: Sequence[Panel], floor: float) -> bool:
    """Whether lines are far from each other, and none comes down to nothing from far above."""
    lines = [y[np.isfinite(y)] for panel in panels for _, y in panel.lines.values()]
    lines = [y for y in lines if y.size]
    if not lines or min(float(y.min()) for y in lines) < 0:
        return False
    spans = [(max(float(y.min()), floor), max(float(y.max()), floor)) for y in lines]
    down = any(low < LEAST_PART * high for low, high in spans)
    return not down and max(high for _, high in spans) > LOGARITHMIC * min(low for low, _ in spans)


def _floored(panel: Panel) -> Panel:
    lines = {name: (x, np.where(np.isfinite(y), np.maximum(y, FLOOR), y)) for name, (x, y) in panel.lines.items()}
    return replace(panel, lines=lines, bands={})

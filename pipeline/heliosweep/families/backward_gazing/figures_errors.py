"""Errors of each method: beside the published ones, as canting of the modules, and against what is swept."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import ndtri

from heliosweep.families.backward_gazing.shown import (
    DIRECTIONS,
    HELIOSTAT,
    METHOD,
    MODULE,
    PROFILE,
    REFERENTIAL,
    SEEDS,
    Gazing,
    Way,
    canting,
    study,
)
from heliosweep.report.colours import COLOURS
from heliosweep.report.comparison import published_in
from heliosweep.report.contents import NamedFigure
from heliosweep.report.labels import number_text, unit_of
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import grid_figure
from heliosweep.report.selection import Point, at

#: Panels beside each other; modules of one figure of canting.
COLUMNS, MOST = 4, 16
#: Values below are shown there. [%]
FLOOR = 1e-3
#: Half-width of a 95 % interval over the standard error.
WIDE = float(ndtri(0.975))
#: Swept numbers with curves; lines up to which each has its band.
MOST_RUNS, MOST_BANDS = 3, 4
#: Least height of an axis of canting [mrad], of errors in percent, and in mrad.
LEAST_CANTING, LEAST_PERCENT, LEAST_MRAD = 0.02, 0.02, 2e-4
#: From this ratio of the ends on, numbers that are all positive are drawn on a logarithmic axis.
LOGARITHMIC = 30.0
#: Values below this are rounding and do not stand on logarithmic axes. [mrad]
ROUNDING = 1e-7
#: Parts of pixels and cameras that change less than this are not shown. [%]
LEAST_CHANGE = 0.1
#: A line whose least value is a smaller part of its largest comes down to nothing.
LEAST_PART = 0.01

_ERROR, _RMS, _BOUND = "relative_error_x", "slope_rms_x", "Cramér-Rao bound"
#: What O2 and LM are called beside the referentials of the others.
_DIRECT = "needs none"
_COLOURS = {"none": COLOURS[0], "roll": COLOURS[5], "exact": COLOURS[2], _DIRECT: COLOURS[3]}


def errors(shown: Gazing) -> Iterator[NamedFigure]:
    """Median and spread over the seeds; a panel for each profile and module, a row for each direction."""
    result = shown.result
    if not shown.has(_ERROR, "relative_error_y", _RMS):
        return
    name = f"{_ERROR}{_median(result)}"
    if not {MODULE, METHOD} <= set(result[name].dims):
        return
    stands = shown.fixed(name, METHOD, REFERENTIAL, MODULE, shown.sort_dim(name))
    sorts, modules = shown.sorts(name), _published_modules(shown, name)
    together = len(sorts) * len(modules) <= COLUMNS
    for part in [sorts] if together else [[one] for one in sorts]:
        panels = [
            Panel(
                f"error of {direction} slope\n(% of the canting)",
                lines,
                "" if end == "y" else ", ".join(filter(None, [shown.values(where), shown.fulls(module)])),
                bands,
                _marks(shown, f"relative_error_{end}", where, module),
            )
            for end, direction in DIRECTIONS.items()
            for where in part
            for module in modules
            for lines, bands in [_by_referential(shown, end, stands, where, module)]
        ]
        values = _values(panels)
        if not values.size or not values.max() > 0:
            continue
        floor = FLOOR if values.max() > 10 * FLOOR else None
        low = " Open symbols: below the scale." if floor and (values < floor).any() else ""
        counts = [result.sizes[dim] for dim in SEEDS if dim in result.sizes]
        seeds = f"{int(np.prod(counts))} seeds" if counts else "the seeds"
        bars = f" Symbols: median over {seeds}; bars: 5 to 95 %." if _median(result) else ""
        marked = any(panel.marks is not None for panel in panels)
        caption = (
            "Mean error of the slopes of a module, less what the same method finds on the ideal heliostat, by method "
            f"and referential.{bars}{' Black: published.' if marked else ''}{low}"
            f"{shown.note(stands, modules, sorts)}"
        )
        figure = curve_figure(
            panels,
            "method",
            columns=len(panels) // 2,
            same_scale="row",
            floor=floor,
            least_span=FLOOR,
            legend_title="referential",
            mark="published",
            looks={key: {"color": colour} for key, colour in _COLOURS.items()},
        )
        one = shown.values(part[0])
        yield NamedFigure("errors" if together or not one else f"errors_{one.replace(' ', '_')}", caption, figure)


def _by_referential(shown: Gazing, end: str, *points: Point) -> tuple[dict[str, Any], dict[str, Any]]:
    """Errors of all methods in one direction, by referential, and their 5 and 95 % points. [%]"""
    name = f"relative_error_{end}"
    kinds = [f"{name}{kind}" for kind in ("_median", "_low", "_high")] if _median(shown.result) else [name]
    methods = [shown.value(METHOD, i) for i in range(shown.result.sizes[METHOD])]
    empty = xr.DataArray(np.full(len(methods), np.nan), {METHOD: methods}, METHOD)
    found: dict[str, list[xr.DataArray]] = {}
    for way in shown.ways(kinds[0]):
        key = way.referential or (_DIRECT if len(methods) > 1 else "")
        lines = found.setdefault(key, [empty.copy() for _ in kinds])
        for kind, line in zip(kinds, lines, strict=True):
            if kind in shown.result:
                line[way.point[METHOD]] = at(shown.result[kind], *points, way.point)
    bands = {key: (lines[1], lines[2]) for key, lines in found.items() if len(lines) == 3}
    return {key: lines[0] for key, lines in found.items()}, bands


def _marks(shown: Gazing, name: str, where: Point, module: Point) -> xr.DataArray | None:
    """Published errors of each method at one profile and module; none where there are none. [%]"""
    result = shown.result
    methods = [shown.value(METHOD, i) for i in range(result.sizes[METHOD])]
    here = {dim: str(result[dim].to_numpy()[i]) for dim, i in {**where, **module}.items() if dim in result.coords}
    if PROFILE in result.coords and not result[PROFILE].ndim:
        here[PROFILE] = str(result[PROFILE].item())
    marks = xr.DataArray(np.full(len(methods), np.nan), {METHOD: methods}, METHOD)
    for one in [*published_in(result, name), *published_in(result, f"{name}_median")]:
        method = one.where.get(METHOD)
        if method in methods and all(_same(one.where[dim], here[dim]) for dim in one.where.keys() & here.keys()):
            marks[methods.index(method)] = one.published * (1.0 if one.unit == "percent" else 100.0)
    return marks if marks.notnull().any() else None


def _same(one: str, other: str) -> bool:
    """True for the same word, or the same number however it is written."""
    try:
        return float(one) == float(other)
    except ValueError:
        return one == other


def _published_modules(shown: Gazing, name: str) -> list[dict[str, int]]:
    """Modules with published numbers, else those that figures show."""
    published = {
        float(one.where[MODULE])
        for end in DIRECTIONS
        for kind in ("", "_median")
        for one in published_in(shown.result, f"relative_error_{end}{kind}")
        if MODULE in one.where
    }
    numbers = shown.coordinate(MODULE).to_numpy()
    every = shown.modules(name, most=shown.result.sizes[MODULE])
    return [one for one in every if numbers[one[MODULE]] in published][:COLUMNS] or shown.modules(name)


def modules(shown: Gazing) -> Iterator[NamedFigure]:
    """Canting of each module by each method, with 95 % intervals; its error where the true one is known."""
    result, name = shown.result, "canting_x"
    if not shown.has(name, "canting_y") or MODULE not in result[name].dims:
        return
    sorts, ways = shown.sorts(name), shown.best_ways(name)
    stands = shown.fixed(name, METHOD, REFERENTIAL, shown.sort_dim(name), MODULE)
    places = shown.chosen(MODULE, MOST)
    named = {MODULE: [f"{number:g}" for number in shown.coordinate(MODULE).to_numpy()]}
    entered = [_entered(shown, end, stands) for end in DIRECTIONS]
    known = all(values is not None for values in entered)
    panels = []
    for (end, direction), true in zip(DIRECTIONS.items(), entered, strict=True):
        for where in sorts:
            lines, bands = {}, {}
            for way in ways:
                word = way.name if len(ways) > 1 else ""
                points, kept = (stands, where, way.point), {MODULE: [one[MODULE] for one in places]}
                array = at(result[f"canting_{end}"], *points) - (0.0 if true is None else true)
                lines[word] = array.assign_coords(named).isel(kept)
                error = f"canting_{end}_standard_error"
                if error in result:
                    half = WIDE * at(result[error], *points).assign_coords(named).isel(kept)
                    bands[word] = (lines[word] - half, lines[word] + half)
            label = f"error of {direction}\ncanting (mrad)" if known else f"{direction} canting\n(mrad)"
            panels.append(Panel(label, lines, shown.values(where) if end == "x" else "", bands))
    if not _values(panels).size:
        return
    less = ", less the one that was entered" if known else ""
    single = f" Method {ways[0].name}." if len(ways) == 1 and ways[0].name else ""
    caption = (
        "Canting: slope at the centre of each module less the pointing of the heliostat, which is the median over the "
        f"modules{less}; bars: 95 % intervals from the scatter of the pixels alone.{single}"
        f"{_whole(result, {**stands, **sorts[0], **ways[-1].point}, ways[-1].name)}"
        f"{shown.note(stands, sorts, places)}"
    )
    looks = {way.name if len(ways) > 1 else "": {"color": way.look["color"]} for way in ways}
    figure = curve_figure(panels, "module", columns=len(sorts), same_scale="row", least_span=LEAST_CANTING, looks=looks)
    yield NamedFigure("canting", caption, figure)


def _entered(shown: Gazing, end: str, stands: Point) -> np.ndarray | None:
    """Canting that was entered less its median over the modules; none where the result does not tell. [mrad]"""
    result, given = shown.result, canting(shown.result)
    scale: Any = study(result).get("defects", {}).get("canting_scale", 1.0)
    if "canting_scale" in result.coords:
        found = at(result["canting_scale"], stands)
        scale = None if found.ndim else float(found)
    if not given or not isinstance(scale, int | float) or "true_focal_length" in result.coords:
        return None
    side = list(DIRECTIONS).index(end)
    numbers = shown.coordinate(MODULE).to_numpy()
    values = float(scale) * np.array([given.get(int(number), (0.0, 0.0))[side] for number in numbers])
    return np.asarray(values - np.median(values))


def _whole(result: xr.Dataset, point: Point, method: str) -> str:
    """Pointing and focal length of the heliostat, as a sentence."""
    said = []
    for name, words, unit, decimals in (
        ("pointing_x", "horizontal pointing", "mrad", 3),
        ("pointing_y", "vertical pointing", "mrad", 3),
        ("focal_length_estimate", "focal length", "m", 2),
    ):
        error = f"{name.removesuffix('_estimate')}_standard_error"
        if name in result and error in result:
            value, half = (float(at(result[one], point)) for one in (name, error))
            if np.isfinite(value) and np.isfinite(half):
                said.append(f"{words} {number_text(value, decimals)} ± {number_text(WIDE * half, decimals)} {unit}")
    of = f" by {method}" if method else ""
    return f" Of the whole heliostat{of}: {', '.join(said)}." if said else ""


def relative_errors(shown: Gazing) -> Iterator[NamedFigure]:
    """Relative error of one module over each swept number, for every method and referential."""
    result = shown.result
    if not shown.has(_ERROR, "relative_error_y"):
        return
    median = _median(result)
    name = f"{_ERROR}{median}"
    if HELIOSTAT in result[name].dims:
        return
    ways, sorts = shown.ways(name), shown.sorts(name)
    for run in shown.numbers(name)[:MOST_RUNS]:
        stands = shown.fixed(name, run, METHOD, REFERENTIAL, shown.sort_dim(name), MODULE)
        (module,) = shown.modules(name, most=1)
        banded = bool(median and len(ways) <= MOST_BANDS)
        panels = []
        for where in sorts:
            for end, direction in DIRECTIONS.items():
                lines, low, high = (
                    {
                        way.name: _along(shown, f"relative_error_{end}{kind}", run, stands, module, where, way.point)
                        for way in ways
                        if kind == median or banded
                    }
                    for kind in (median, "_low", "_high")
                )
                ends = {word: (low[word].clip(max=lines[word]), high[word].clip(min=lines[word])) for word in low}
                title = ", ".join(filter(None, [shown.values(where), direction]))
                panels.append(Panel("error of the slope (% of the canting)", lines, title, ends))
        if not _values(panels).size:
            continue
        floor = FLOOR if _many_decades(panels, FLOOR) else None
        if floor:
            panels = [Panel(panel.label, panel.lines, panel.title) for panel in panels]
        said = f" Less than {FLOOR:g} % is drawn there." if floor else ""
        lines_are = " Lines: median over the seeds" + (", bands: 5 to 95 %." if panels[0].bands else ".")
        caption = (
            f"Mean error of the slopes of {shown.fulls(module) or 'the module'} against the {shown.title(run)}, "
            f"by method and referential.{lines_are if median else ''}{said}{shown.note(stands, sorts)}"
        )
        more: dict[str, Any] = {"floor": floor, "same_scale": "row", "least_span": LEAST_PERCENT}
        yield _over(shown, "errors", run, panels, caption, ways, **more)


def rms_errors(shown: Gazing) -> Iterator[NamedFigure]:
    """Scatter of the slopes of the pixels over each swept number, with the bound that the cameras leave."""
    result = shown.result
    if not shown.has(_RMS, "slope_rms_y", "cramer_rao_bound_x", "cramer_rao_bound_y"):
        return
    if MODULE not in result[_RMS].dims:
        return
    every = shown.ways(_RMS)
    ways = [way for way in every if way.referential in ("", "exact")] or every
    for run in shown.numbers(_RMS)[:MOST_RUNS]:
        stands = shown.fixed(_RMS, run, METHOD, REFERENTIAL, MODULE, *SEEDS)
        (module,) = shown.modules(_RMS, most=1)
        panels = []
        for end, direction in DIRECTIONS.items():
            points = (stands, module)
            lines = {way.name: _along(shown, f"slope_rms_{end}", run, *points, way.point) for way in ways}
            bound = _along(shown, f"cramer_rao_bound_{end}", run, *points)
            lines[_BOUND] = bound.where(bound > ROUNDING)
            panels.append(Panel("rms error of the slope (mrad)", lines, direction))
        if not any(np.isfinite(panel.lines[_BOUND]).any() for panel in panels):
            continue
        caption = (
            f"Root mean square error of the slopes of the pixels of {shown.fulls(module) or 'the module'} against the "
            f"{shown.title(run)}; bound: least standard deviation that noise and levels of the cameras leave."
            f"{_over_seeds(result)}{shown.note(stands)}"
        )
        more: dict[str, Any] = {"same_scale": True, "least_span": LEAST_MRAD}
        more["logarithmic_values"] = _many_decades(panels, ROUNDING)
        black = {"color": "#000000", "linestyle": (0, (4, 1.6)), "marker": ""}
        yield _over(shown, "rms_errors", run, panels, caption, ways, {_BOUND: black}, **more)


def sight(shown: Gazing) -> Iterator[NamedFigure]:
    """How much of the modules has slopes over each swept number."""
    result, names = shown.result, {"usable_fraction": "pixels with slopes", "lit_cameras": "lit cameras"}
    if not shown.has(*names) or MODULE not in result["usable_fraction"].dims:
        return
    for run in shown.numbers("lit_cameras")[:MOST_RUNS]:
        stands = {dim: i for name in names for dim, i in shown.fixed(name, run, MODULE).items()}
        places = shown.modules("lit_cameras")
        panels = [
            Panel("part (%)", {shown.fulls(one): 100 * _along(shown, name, run, stands, one) for one in places}, title)
            for name, title in names.items()
            if run in result[name].dims
        ]
        values = _values(panels)
        if values.size and np.ptp(values) >= LEAST_CHANGE:
            caption = (
                "Part of the pixels of a module that have slopes, and part of the cameras that see the sun in it, "
                f"against the {shown.title(run)}.{shown.note(stands, places)}"
            )
            yield _over(shown, "sight", run, panels, caption, same_scale=True, least_span=5.0)


def grids(shown: Gazing) -> Iterator[NamedFigure]:
    """Error and reach of the best method over two swept numbers."""
    result, reach = shown.result, "usable_fraction"
    if not shown.has(_RMS, "slope_rms_y", reach):
        return
    dims = shown.numbers(_RMS)[:2]
    if len(dims) < 2 or MODULE not in result[_RMS].dims or not set(dims) <= set(result[reach].dims):
        return
    x, y = dims
    stands = shown.fixed(_RMS, x, y, MODULE, *SEEDS)
    (module,) = shown.modules(_RMS, most=1)
    arrays = {
        f"rms error of {word} slope (mrad)": _rms(at(result[f"slope_rms_{end}"], stands, module)).transpose(y, x)
        for end, word in DIRECTIONS.items()
    }
    if not any(np.isfinite(array).any() for array in arrays.values()):
        return
    usable = 100 * _rms(at(result[reach], stands, module)).transpose(y, x)
    seen = bool(usable.max() - usable.min() > LEAST_CHANGE)
    arrays |= {"pixels with slopes (%)": usable} if seen else {}
    method = shown.value(METHOD, stands[METHOD]) if METHOD in stands else ""
    reached = ", and part of its pixels that have slopes. Grey: none" if seen else ""
    caption = (
        f"Root mean square error of the slopes that {f'{method} finds' if method else 'are found'} for "
        f"{shown.fulls(module) or 'the module'}{reached}."
        f"{_over_seeds(result)}{shown.note(stands)}"
    )
    labels = [f"{shown.title(dim)} ({unit_of(result[dim]) or '1'})" for dim in dims]
    logarithmic = [_is_logarithmic(result[dim]) for dim in dims]
    figure = grid_figure(arrays, (labels[0], labels[1]), (logarithmic[0], logarithmic[1]))
    yield NamedFigure(f"accuracy_over_{x}_and_{y}", caption, figure)


FIGURES = (errors, modules, relative_errors, rms_errors, sight, grids)


def _over(
    shown: Gazing,
    name: str,
    run: str,
    panels: Sequence[Panel],
    caption: str,
    ways: Iterable[Way] = (),
    looks: Mapping[str, Any] | None = None,
    **more: Any,
) -> NamedFigure:
    """Curves over one swept number, those of methods in their colours."""
    looks = {way.name: way.look for way in ways} | dict(looks or {})
    logarithmic = _is_logarithmic(shown.result[run])
    figure = curve_figure(panels, shown.label(run), logarithmic=logarithmic, looks=looks, **more)
    return NamedFigure(f"{name}_over_{run}", caption, figure)


def _median(result: xr.Dataset) -> str:
    """End of the name of the relative error: its median over the seeds where there is one."""
    return "_median" if f"{_ERROR}_median" in result else ""


def _over_seeds(result: xr.Dataset) -> str:
    seeds = [result.sizes[dim] for dim in SEEDS if dim in result[_RMS].dims]
    return f" Over {int(np.prod(seeds))} seeds." if seeds else ""


def _rms(array: xr.DataArray) -> xr.DataArray:
    """Root mean square over the seeds."""
    seeds = [dim for dim in SEEDS if dim in array.dims]
    return (array**2).mean(seeds) ** 0.5 if seeds else array


def _along(shown: Gazing, name: str, run: str, *points: Point) -> xr.DataArray:
    """Values along one dimension, root mean squares over seeds that are left; constant where there is no dimension."""
    array = _rms(at(shown.result[name], *points)).astype(float)
    return array if run in array.dims else array.broadcast_like(shown.result[run])


def _values(panels: Iterable[Panel]) -> np.ndarray:
    """All values of all lines that are finite."""
    values = np.concatenate([np.ravel(line) for panel in panels for line in panel.lines.values()])
    return values[np.isfinite(values)]


def _is_logarithmic(coordinate: xr.DataArray) -> bool:
    """Whether numbers are many times each other and more evenly spaced by their logarithms."""
    low, high = float(coordinate.min()), float(coordinate.max())
    return bool(coordinate.size > 2 and low > 0 and high >= LOGARITHMIC * low)


def _many_decades(panels: Sequence[Panel], floor: float) -> bool:
    """Whether lines are far from each other, and none comes down to nothing from far above."""
    lines = [np.ravel(line)[np.isfinite(np.ravel(line))] for panel in panels for line in panel.lines.values()]
    lines = [y for y in lines if y.size]
    if not lines or min(float(y.min()) for y in lines) < 0:
        return False
    spans = [(max(float(y.min()), floor), max(float(y.max()), floor)) for y in lines]
    down = any(low < LEAST_PART * high for low, high in spans)
    return not down and max(high for _, high in spans) > LOGARITHMIC * min(low for low, _ in spans)

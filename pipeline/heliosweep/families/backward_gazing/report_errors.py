"""Errors of each method beside the published ones, after Table 1 of the paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing import report_views as views
from heliosweep.families.backward_gazing import report_words as wording
from heliosweep.families.backward_gazing.report_views import DIRECTIONS, METHOD, MODULE, PROFILE, REFERENTIAL, at, needs
from heliosweep.families.registry import NamedFigure
from heliosweep.report.comparison import Comparison, published_in
from heliosweep.report.intervals import Around, Beside, Interval, Strip, interval_figure
from heliosweep.report.style import COLOURS

#: Panels beside each other.
COLUMNS = 4

#: Values below are shown there. [%]
FLOOR = 1e-3

#: Coordinates that tell where a published number belongs.
_PLACES = (METHOD, PROFILE, MODULE)

#: What O2 and LM are called beside the referentials of the others.
_DIRECT = "needs none"
_LOOKS = {"none": COLOURS[0], "roll": COLOURS[5], "exact": COLOURS[2], _DIRECT: COLOURS[3]}


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Errors of the slopes in percent of the canting that was entered.

    Parameters
    ----------
    result : xarray.Dataset
        The result; the published numbers are those that it tells.

    Yields
    ------
    NamedFigure
    """
    yield from _errors(result)


@needs("relative_error_x", "relative_error_y", "slope_rms_x")
def _errors(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Median and spread over the seeds; a panel for each profile and module, a row for each direction."""
    base = middle(result)
    array = result[f"{base[0]}x{base[1]}"]
    if MODULE not in array.dims or METHOD not in array.dims:
        return
    stands = views.fixed(result, str(array.name), METHOD, REFERENTIAL, MODULE, views.sort_of(result, str(array.name)))
    profiles, modules = views.sorts(result, str(array.name)), _modules(result, str(array.name))
    together = len(profiles) * len(modules) <= COLUMNS
    for part in [profiles] if together else [[one] for one in profiles]:
        strips = [
            Strip(
                f"error of {direction} slope\n(% of the canting)",
                [
                    _panel(result, end, stands, where, module, "" if end == "y" else _title(profile, name))
                    for profile, where in part
                    for name, module in modules
                ],
            )
            for end, direction in DIRECTIONS.items()
        ]
        parts = [one.value for strip in strips for panel in strip.panels for one in panel.series.values()]
        values = np.concatenate([one[np.isfinite(one)] for one in parts])
        if not values.size or not values.max() > 0:
            continue
        marked = any(panel.marks is not None and np.isfinite(panel.marks).any() for s in strips for panel in s.panels)
        low = " Open symbols: below the scale." if (values < FLOOR).any() else ""
        bars = f" Symbols: median over {_seeds(result)}; bars: 5 to 95 %." if base[1] else ""
        published = " Black: published." if marked else ""
        floor = FLOOR if values.max() > 10 * FLOOR else None
        if floor is None:
            low = ""
        caption = (
            "Mean error of the slopes of a module, less what the same method finds on the ideal heliostat, by method "
            f"and referential.{bars}{published}{low}"
            f"{wording.note(result, stands, (MODULE, modules), (views.sort_of(result, str(array.name)), profiles))}"
        )
        around = Around("method", "published", "referential", _LOOKS)
        name = "errors" if together or not part[0][0] else f"errors_{part[0][0].replace(' ', '_')}"
        yield NamedFigure(name, caption, interval_figure(strips, around, floor=floor, least_span=FLOOR))


def middle(result: xr.Dataset) -> tuple[str, str]:
    """Start and end of the name of the relative error: its median over the seeds where there is one."""
    return "relative_error_", "_median" if "relative_error_x_median" in result else ""


def percent(result: xr.Dataset, name: str) -> float:
    """What a variable is multiplied with to be in percent."""
    return 1.0 if result[name].attrs.get("units") == "percent" else 100.0


def _panel(
    result: xr.Dataset, end: str, stands: views.Point, where: views.Point, module: views.Point, title: str
) -> Beside:
    """Errors of all methods in one direction."""
    methods = _names(result)
    name = f"relative_error_{end}"
    kinds = [f"{name}{kind}" for kind in ("_median", "_low", "_high")] if middle(result)[1] else [name]
    series: dict[str, list[np.ndarray]] = {}
    for way in views.ways(result, kinds[0]):
        key = way.referential or (_DIRECT if len(methods) > 1 else "")
        column = series.setdefault(key, [np.full(len(methods), np.nan) for _ in kinds])
        for kind, values in zip(kinds, column, strict=True):
            if kind in result:
                values[way.point[METHOD]] = percent(result, kind) * float(
                    at(result[kind], stands, where, module, way.point)
                )
    intervals = {key: Interval(*parts) for key, parts in series.items()}
    return Beside(methods, intervals, title, _marks(result, name, methods, where, module))


def _marks(
    result: xr.Dataset, name: str, methods: Sequence[str], where: views.Point, module: views.Point
) -> np.ndarray | None:
    """Published errors of each method at one profile and module. [%]"""
    here = {
        dim: str(result[dim].to_numpy()[index]) for dim, index in {**where, **module}.items() if dim in result.coords
    }
    if PROFILE in result.coords and not result[PROFILE].ndim:
        here[PROFILE] = str(result[PROFILE].item())
    marks = np.full(len(methods), np.nan)
    for one in [*published_in(result, name), *published_in(result, f"{name}_median")]:
        if one.where.get(METHOD) in methods and all(_same(one, dim, here) for dim in (PROFILE, MODULE)):
            marks[methods.index(one.where[METHOD])] = one.published * (1.0 if one.unit == "percent" else 100.0)
    return marks if np.isfinite(marks).any() else None


def _same(one: Comparison, dim: str, here: dict[str, str]) -> bool:
    """Whether a published number belongs to where a panel stands, as far as both tell."""
    if dim not in one.where or dim not in here:
        return True
    try:
        return float(one.where[dim]) == float(here[dim])
    except ValueError:
        return one.where[dim] == here[dim]


def _modules(result: xr.Dataset, quantity: str) -> list[tuple[str, views.Point]]:
    """Modules with published numbers, else those that figures show."""
    published = {
        int(float(one.where[MODULE]))
        for end in DIRECTIONS
        for kind in ("", "_median")
        for one in published_in(result, f"relative_error_{end}{kind}")
        if MODULE in one.where
    }
    every = views.modules(result, quantity, most=result.sizes[MODULE])
    known = [one for one in every if one[0].removeprefix("module ") in map(str, published)]
    return known[:COLUMNS] or views.modules(result, quantity)


def _names(result: xr.Dataset) -> list[str]:
    count = result.sizes[METHOD]
    return (
        [str(name) for name in result[METHOD].to_numpy()] if METHOD in result.coords else [f"{i}" for i in range(count)]
    )


def _title(profile: str, module: str) -> str:
    return ", ".join(filter(None, [profile, module]))


def _seeds(result: xr.Dataset) -> str:
    counts = [result.sizes[dim] for dim in views.SEEDS if dim in result.sizes]
    return f"{int(np.prod(counts))} seeds" if counts else "the seeds"

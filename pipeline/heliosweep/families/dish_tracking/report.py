"""Figures of a finished result, after Figures 5 and 7 to 13 and Tables 2 and 3 of Liu, Peng and Yan (2022).

Each figure takes from the sweep what it can show, and its caption says at which values the rest stands; one that
needs what the result does not have is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain, islice
from typing import Literal

import numpy as np
import xarray as xr

from heliosweep.families.dish_tracking import views
from heliosweep.families.dish_tracking.views import DIRECTION, OFFSETS, View
from heliosweep.families.registry import NamedFigure
from heliosweep.report import grids
from heliosweep.report.curves import Panel, curve_figure
from heliosweep.report.labels import DEGREE, is_latitude, value_text
from heliosweep.report.selection import evenly

#: Figures of one result.
MOST_FIGURES = 8

#: Panels beside each other where there are more than four.
COLUMNS = 3

#: Latitudes and directions from which on there is a map.
LEAST_LATITUDES, LEAST_DIRECTIONS = 7, 4

#: Names along an axis; lines with bands that overlap.
MOST_NAMES, MOST_BANDS = 40, 5

#: Least height of the axes of factors and errors: less is of no interest. [1, mrad]
LEAST_SPAN = 5e-3

_FACTOR = "effective_tracking_factor"
_AVERAGE = "average"
_FACTOR_LABEL = "effective tracking factor (1)"
_COMPASS = "Direction of the tilt: where the foot of the azimuth axis leans, 0 south, 90 west."


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of a result, each drawn when it is asked for.

    Parameters
    ----------
    result : xarray.Dataset
        From `heliosweep.open_result`; values are read as they are needed.

    Yields
    ------
    NamedFigure
    """
    if f"annual_{_FACTOR}_mean" in result:
        average = result[f"annual_{_FACTOR}_mean"]
    else:
        average = result[_FACTOR].isel(date=0, drop=True)
    result = result.assign({_AVERAGE: average})
    return islice(chain.from_iterable(draw(result) for draw in _FIGURES), MOST_FIGURES)


def _over_first(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Factor over the direction, or over the first swept number where the direction is not swept."""
    x, others = _axis(result, _AVERAGE)
    if x is None:
        return
    lines, panels, *_ = *others, None, None
    view = View(result, _AVERAGE, x, lines=lines, panels=panels)
    caption = f"Effective tracking factor against {views.short_title(result, x)}, {_when(result)}."
    yield _curves(f"factor_over_{x}", caption, _panels(view, _AVERAGE), view)


def _directions_together(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Mean and standard deviation over the directions, against up to two of what is swept, sites first."""
    directed = result[_AVERAGE].sizes.get(DIRECTION, 0) > 1
    dims = [dim for dim in views.swept(result, _AVERAGE) if dim != DIRECTION]
    named = [dim for dim in dims if dim in result.coords and result[dim].dtype.kind in "OU"]
    numbers = [dim for dim in dims if directed and views.is_number(result, dim)]
    for x in _places_first(result, [*named, *numbers])[:2]:
        whole = (x, DIRECTION) if directed else (x,)
        few = result.isel({x: evenly(result.sizes[x], MOST_NAMES)}) if x in named else result
        view = View(few, _AVERAGE, *whole, lines=_first(dims, x), most_lines=MOST_BANDS)
        values = np.array([value_text(one) for one in few[x]]) if x in named else few[x].to_numpy()
        lines, bands = {}, {}
        for line in view.line_points:
            name, factor = view.line_text(line), view.at(_AVERAGE, line)
            if directed:
                bands[name] = factor.std(DIRECTION, ddof=1, skipna=False).to_numpy()
                factor = factor.mean(DIRECTION, skipna=False)
            lines[name] = (values, factor.to_numpy())
        caption = f"Effective tracking factor against {views.short_title(result, x)}, {_when(result)}."
        if directed:
            shape = "bars" if x in named else "bands"
            caption += f" Mean over the directions of the tilt; {shape}: sample standard deviation over them."
        if few.sizes[x] < result.sizes[x]:
            caption += f" The axis has {few.sizes[x]} of {result.sizes[x]} values."
        yield _curves(f"directions_over_{x}", caption, [Panel(_FACTOR_LABEL, lines, bands=bands)], view)


def _over_year(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Factor of each date."""
    if result.sizes["date"] < 2:
        return
    view = _calendar(result)
    yield _curves("factor_over_year", "Effective tracking factor of each date.", _panels(view, _FACTOR), view)


def _by_month(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Monthly mean with the standard deviation over its dates."""
    if result.sizes.get("month", 0) < 2:
        return
    view = _calendar(result)
    mean, deviation = (f"monthly_{_FACTOR}_{name}" for name in ("mean", "std"))
    middles = result["month"].to_numpy().astype("datetime64[M]").astype("datetime64[D]") + np.timedelta64(14, "D")
    panels = _panels(view, mean, x=middles, band=deviation)
    caption = "Effective tracking factor: mean of each month; bands: sample standard deviation over its dates."
    yield _curves("factor_by_month", caption, panels, view)


def _calendar(result: xr.Dataset) -> View:
    """Lines for some directions, a panel for each place."""
    dims = views.swept(result, _FACTOR)
    lines = _first([DIRECTION] if DIRECTION in dims else dims)
    return View(result, _FACTOR, "date", lines=lines, panels=_first(_places_first(result, dims), lines))


def _extremes(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Least and largest daily factor, and on which date each falls."""
    quantities = ((f"{_FACTOR}_min", "date_of_min", "least"), (f"{_FACTOR}_max", "date_of_max", "largest"))
    x, others = _axis(result, _AVERAGE)
    if x is None or quantities[0][0] not in result:
        return
    view = View(result, _AVERAGE, x, panels=_first(_places_first(result, others)), most_panels=COLUMNS)
    values = [
        Panel(_FACTOR_LABEL, {name: _curve(view, one, panel) for one, _, name in quantities}, view.panel_text(panel))
        for panel in view.panel_points
    ]
    dates = [
        Panel("date (month)", {name: _curve(view, one, panel) for _, one, name in quantities})
        for panel in view.panel_points
    ]
    caption = f"Least and largest effective tracking factor of {views.period(result['date'])}, and when they occur."
    yield _curves("extremes", caption, [*values, *dates], view, columns=len(values), same_scale="row")


def _map(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Factor over latitude and direction."""
    dims = result[_AVERAGE].dims
    if DIRECTION not in dims or "latitude" not in dims:
        return
    if result.sizes["latitude"] < LEAST_LATITUDES or result.sizes[DIRECTION] < LEAST_DIRECTIONS:
        return
    view = View(result, _AVERAGE, DIRECTION, "latitude")
    labels = {_AVERAGE: _FACTOR_LABEL}
    if f"{_FACTOR}_min" in result:
        labels = {_AVERAGE: f"mean {_FACTOR_LABEL}", f"{_FACTOR}_min": f"least daily {_FACTOR_LABEL}"}
    caption = f"Effective tracking factor against latitude and direction of the tilt, {_when(result)}."
    yield _grids("latitude_map", caption, view, {name: (label, view.at(name)) for name, label in labels.items()})


def _tolerable(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Largest tilt that keeps every date above the required factors."""
    name, required = "tolerable_axis_tilt", "required_factor"
    if name not in result:
        return
    others = [dim for dim in views.swept(result, name) if dim != required]
    x = "latitude" if result.sizes.get("latitude", 0) >= LEAST_DIRECTIONS and "latitude" in others else None
    x = x or next((dim for dim in [DIRECTION, *others] if dim in others and views.is_number(result, dim)), None)
    if x is None:
        return
    lines = _first([dim for dim in [DIRECTION, *others] if dim in others], x)
    view = View(result, name, x, lines=lines or required, panels=required if lines else None)
    caption = (
        "Largest tilt of the azimuth axis with which the effective tracking factor of every date reaches the required "
        f"one, over {views.period(result['date'])}."
    )
    panels = _panels(view, name, f"tolerable tilt ({DEGREE})")
    yield _curves(name, caption, panels, view, "axis_tilt", same_scale=False)


def _errors(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Mean and largest tracking error over the offsets of the home position."""
    offsets = [name for name in OFFSETS if name in result[_FACTOR].dims and views.is_number(result, name)]
    if not offsets:
        return
    mean, largest = "mean_tracking_error", "max_tracking_error"
    labels = {mean: "mean tracking error (mrad)", largest: "largest tracking error (mrad)"}
    reductions: dict[str, Callable[[xr.DataArray], xr.DataArray]] = {
        mean: lambda errors: errors.mean("date"),
        largest: lambda errors: errors.reduce(np.fmax.reduce, "date"),
    }
    span = f"over {views.period(result['date'])}" if result.sizes["date"] > 1 else _when(result)
    caption = f"Mean and largest tracking error against the offset of the home position, {span}."
    if len(offsets) > 1:
        view = View(result, _FACTOR, offsets[0], offsets[1])
        drawn = {name: (label, reductions[name](view.at(name))) for name, label in labels.items()}
        yield _grids("tracking_errors", caption, view, drawn)
        return
    others = [dim for dim in views.swept(result, _FACTOR) if dim not in offsets]
    lines = _first([DIRECTION] if DIRECTION in others else others)
    view = View(result, _FACTOR, offsets[0], lines=lines)
    x = result[offsets[0]].to_numpy()
    panels = [
        Panel(
            label,
            {view.line_text(line): (x, reductions[name](view.at(name, line)).to_numpy()) for line in view.line_points},
        )
        for name, label in labels.items()
    ]
    yield _curves("tracking_errors", caption, panels, view, same_scale=False)


_FIGURES = (_over_first, _directions_together, _over_year, _by_month, _extremes, _map, _tolerable, _errors)


def _first(dims: Sequence[str], *taken: str | None) -> str | None:
    return next((dim for dim in dims if dim not in taken), None)


def _places_first(result: xr.Dataset, dims: Sequence[str]) -> list[str]:
    return sorted(dims, key=lambda dim: not views.is_place(result, dim))


def _axis(result: xr.Dataset, quantity: str) -> tuple[str | None, list[str]]:
    """Dimension for the horizontal axis, the direction if it is swept, and the other ones."""
    dims = views.swept(result, quantity)
    numbers = [dim for dim in dims if views.is_number(result, dim)]
    x = _first([DIRECTION] if DIRECTION in numbers else numbers)
    return x, [dim for dim in dims if dim != x]


def _panels(
    view: View, quantity: str, label: str = _FACTOR_LABEL, x: np.ndarray | None = None, band: str = ""
) -> list[Panel]:
    """All lines of a quantity in all panels, with another one as the half-width of bands."""
    x = view.result[view.whole[0]].to_numpy() if x is None else x
    return [
        Panel(
            label,
            {view.line_text(line): (x, view.at(quantity, line, panel).to_numpy()) for line in view.line_points},
            view.panel_text(panel),
            {view.line_text(line): view.at(band, line, panel).to_numpy() for line in view.line_points} if band else {},
        )
        for panel in view.panel_points
    ]


def _curve(view: View, quantity: str, *points: views.Point) -> tuple[np.ndarray, np.ndarray]:
    return view.result[view.whole[0]].to_numpy(), view.at(quantity, *points).to_numpy()


def _when(result: xr.Dataset) -> str:
    words = views.period(result["date"])
    return f"mean over {words}" if result.sizes["date"] > 1 else f"on {words}"


def _curves(
    name: str,
    caption: str,
    panels: list[Panel],
    view: View,
    *unsaid: str,
    columns: int = 0,
    same_scale: bool | Literal["row"] = True,
) -> NamedFigure:
    x = view.result[view.whole[0]]
    columns = min(columns or (COLUMNS if len(panels) > 4 else 2), len(panels))
    figure = curve_figure(
        panels,
        views.x_label(view.result, view.whole[0]),
        columns=columns,
        latitude=is_latitude(x),
        same_scale=same_scale,
        legend=view.legend,
        ordered=view.ordered,
        step=views.tick_step(x.to_numpy(), 8 if columns < COLUMNS else 4) if x.name == DIRECTION else None,
        least_span=LEAST_SPAN,
    )
    return NamedFigure(name, f"{caption}{_compass(view)}{view.note(*unsaid)}", figure)


def _grids(name: str, caption: str, view: View, drawn: dict[str, tuple[str, xr.DataArray]]) -> NamedFigure:
    x, y = view.whole
    figure = grids.grid_figure(
        [grids.Grid(label, values.transpose(y, x).to_numpy()) for label, values in drawn.values()],
        _side(view.result, x),
        _side(view.result, y),
    )
    return NamedFigure(name, f"{caption}{_compass(view)}{view.note()}", figure)


def _side(result: xr.Dataset, dim: str) -> grids.Side:
    values = result[dim].to_numpy()
    step = views.tick_step(values) if dim == DIRECTION else None
    return grids.Side(views.x_label(result, dim), values, step, is_latitude(result[dim]))


def _compass(view: View) -> str:
    """What the directions mean, where they are on an axis."""
    return f" {_COMPASS}" if DIRECTION in view.whole[:1] else ""

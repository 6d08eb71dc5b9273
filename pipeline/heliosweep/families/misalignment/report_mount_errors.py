"""Figures of mounts with drawn errors: the spread of their spots, and how often they hit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from heliosweep.families.misalignment import report_views as views
from heliosweep.families.misalignment import report_words as wording
from heliosweep.families.misalignment.report_tolerances import symbols
from heliosweep.families.misalignment.report_views import FIELD, HELIOSTAT, HOUR, at, needs
from heliosweep.families.registry import NamedFigure
from heliosweep.report import maps
from heliosweep.report.curves import Panel, curve_figure
from heliosweep.report.labels import is_latitude, number_text
from heliosweep.report.planes import plane_figure
from heliosweep.report.shapes import Ellipse, Look, Plane, Scale, Track
from heliosweep.report.style import VALUES

#: Hours of which ellipses are drawn.
MOST_HOURS = 9

_AIM, _SPREAD, _MEAN = "aim", "95 % of the draws", "mean"
_LOOKS = {
    _SPREAD: Look("#555555", "-", width=1.1),
    _MEAN: Look("#555555", "", "o", size=3),
    _AIM: Look("#000000", "", "+", size=6),
}
_MOMENTS = ("spot_y_mean", "spot_z_mean", "spot_y_variance", "spot_z_variance", "spot_yz_covariance")
_HITS = "field_hit_fraction"


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of the draws of the mode `mount_errors`.

    Parameters
    ----------
    result : xarray.Dataset
        The result.

    Yields
    ------
    NamedFigure
    """
    for draw in (_spread, _hits_over_day, _hits_over_sweep, _hit_map, _remaining_tolerance):
        yield from draw(result)


@needs(*_MOMENTS)
def _spread(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Mean and covariance of the spots on the receiver plane, an ellipse for each hour, some heliostats."""
    first = result[_MOMENTS[0]]
    if HELIOSTAT not in first.dims:
        return
    hour = HOUR if HOUR in first.dims else None
    stands = views.fixed(result, _MOMENTS[0], hour, HELIOSTAT)
    shown, hours = (
        views.heliostats(result, _MOMENTS[0], stands),
        views.chosen(result, hour, MOST_HOURS, at(first, stands)),
    )
    planes = []
    for one in shown:
        tracks, ellipses = [Track(np.zeros(1), np.zeros(1), _AIM)], []
        for moment in hours:
            y, z, yy, zz, yz = (float(at(result[name], stands, one, moment)) for name in _MOMENTS)
            number = float(result[HOUR].isel(moment)) if hour else None
            ellipse = Ellipse(y, z, np.array([[yy, yz], [yz, zz]]), _SPREAD, number)
            if ellipse.known:
                ellipses.append(ellipse)
                numbers = None if number is None else np.array([number])
                tracks.append(Track(np.array([y]), np.array([z]), _MEAN, numbers=numbers))
        title = wording.heliostat_text(result, {**stands, **one})
        planes.append(Plane(title, tracks, ellipses, views.aperture(result, stands)))
    drawn = [ellipse.number for plane in planes for ellipse in plane.ellipses]
    if not drawn:
        return
    known = [number for number in drawn if number is not None]
    scale = (
        Scale(wording.label(result, HOUR), min(known), max(known)) if known and views.several(result, HOUR) else None
    )
    caption = (
        "Spread of the centre of the beam over the draws of the mount errors, on the receiver plane: the ellipse of a "
        f"normal distribution with the mean and covariance of the draws that holds 95 %; {wording.seen(result)}."
        f"{wording.note(result, stands, (HELIOSTAT, shown), (hour, hours))}"
    )
    yield NamedFigure("spot_spread", caption, plane_figure(planes, _LOOKS, words=wording.around(result), scale=scale))


@needs(_HITS)
def _hits_over_day(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Part of the draws and heliostats whose spot is inside, over the hours."""
    array = result[_HITS]
    if not views.several(result, HOUR) or HOUR not in array.dims:
        return
    day = views.day_of(result)
    dims = views.swept(result, _HITS)
    line = dims[0] if dims else day if views.several(result, day) and day in array.dims else None
    panel = day if line != day and views.several(result, day) and day in array.dims else None
    stands = views.fixed(result, _HITS, HOUR, line, panel)
    lines, panels = views.chosen(result, line, views.MOST_LINES), views.chosen(result, panel, 4)
    order = views.ordered(result, HOUR)
    x = result[HOUR].to_numpy()[order]
    drawn = [
        Panel(
            "spots inside (%)",
            {
                wording.short(result, line, one[line]) if line else "": (
                    x,
                    100 * at(array, stands, one, where).to_numpy()[order],
                )
                for one in lines
            },
            wording.full(result, panel, where[panel]) if panel else "",
        )
        for where in panels
    ]
    if not any(np.isfinite(y).any() for one in drawn for _, y in one.lines.values()):
        return
    of = f"{result.sizes[HELIOSTAT]} heliostats" if result.sizes.get(HELIOSTAT, 1) > 1 else "the heliostat"
    caption = (
        f"Part of all draws in which the centre of the beam is inside the aperture, {of}."
        f"{wording.note(result, stands, (line, lines), (panel, panels))}"
    )
    figure = curve_figure(
        drawn,
        wording.label(result, HOUR),
        same_scale=True,
        step=wording.hour_step(result),
        legend=wording.heading(result, line),
        ordered=bool(wording.heading(result, line)),
        ceiling=100.0,
        columns=3 if len(drawn) == 3 else 2,
        least_span=5.0,
    )
    yield NamedFigure("hits_over_day", caption, figure)


@needs("day_hit_fraction")
def _hits_over_sweep(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Hits of a whole day over each swept number, a line for each day; a field by its mean and its worst heliostat."""
    array = result["day_hit_fraction"]
    dims = views.swept(result, "day_hit_fraction")
    if HELIOSTAT not in array.dims:
        return
    day = next((dim for dim in views.DAYS if dim in array.dims), None)
    for dim in views.numbers(result, dims)[:2]:
        stands = views.fixed(result, "day_hit_fraction", dim, day, HELIOSTAT)
        days, order = views.chosen(result, day, 4), views.ordered(result, dim)
        lines: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for one in days:
            values = 100 * at(array, stands, one).transpose(dim, HELIOSTAT).to_numpy()[order]
            name = wording.full(result, day, one[day]) if day and len(days) > 1 else ""
            parts = {"mean": _mean(values)}
            if values.shape[1] > 1:
                parts["worst heliostat"] = np.fmin.reduce(values, axis=1)
            for part, y in parts.items():
                words = ", ".join(filter(None, [name, part if len(parts) > 1 else ""]))
                lines[words] = (result[dim].to_numpy()[order], y)
        if not any(np.isfinite(y).any() for _, y in lines.values()):
            continue
        caption = (
            "Part of all draws and hours with sun in which the centre of the beam is inside the aperture."
            f"{wording.note(result, stands, (day, days))}"
        )
        figure = curve_figure(
            [Panel("spots inside (%)", lines)],
            wording.label(result, dim),
            latitude=is_latitude(result[dim]),
            least_span=5.0,
        )
        yield NamedFigure(f"hits_over_{dim}", caption, figure)


@needs("day_hit_fraction")
def _hit_map(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Hits of a whole day on the map of a field, for some days or some values of what is swept."""
    name = "day_hit_fraction"
    if result.sizes.get(HELIOSTAT, 0) < FIELD or HELIOSTAT not in result[name].dims:
        return
    dims = [*views.swept(result, name), *(dim for dim in views.DAYS if dim in result[name].dims)]
    run = next((dim for dim in dims if views.several(result, dim)), None)
    stands = views.fixed(result, name, run, HELIOSTAT)
    shown = views.chosen(result, run, views.MOST_MAPS)
    drawn = []
    for one in shown:
        values = 100 * at(result[name], stands, one).to_numpy()
        finite = values[np.isfinite(values)]
        mean = f"mean {number_text(float(finite.mean()), 1)} %" if finite.size else "no value"
        title = f"{wording.full(result, run, one[run])}\n{mean}" if run else mean
        field = views.field_map(result, values, {**stands, **one}, title)
        if field is None:
            return
        drawn.append(field)
    if not any(np.isfinite(one.values).any() for one in drawn):
        return
    caption = (
        "Part of all draws and hours with sun in which the centre of each heliostat's beam is inside the aperture. "
        f"{symbols(drawn)}{wording.note(result, stands, (run, shown))}"
    )
    figure = maps.map_figure(views.rows_of(drawn), _percent(drawn), "spots inside (%)", VALUES)
    yield NamedFigure("hit_map", caption, figure)


@needs("remaining_tolerance")
def _remaining_tolerance(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Percentiles over the draws of what an aperture still tolerates, over the hours, of one heliostat."""
    array = result["remaining_tolerance"]
    if "percentile" not in array.dims or not views.several(result, HOUR) or HOUR not in array.dims:
        return
    axis = "tolerance_axis" if "tolerance_axis" in array.dims else None
    stands = views.fixed(result, "remaining_tolerance", HOUR, "percentile", axis, HELIOSTAT)
    among = views.heliostats(result, _real(result), stands, 3)
    if not among:
        return
    one = among[len(among) // 2]
    percentiles, order = views.chosen(result, "percentile", views.MOST_LINES), views.ordered(result, HOUR)
    x = result[HOUR].to_numpy()[order]
    panels = []
    for point in [{axis: i} for i in range(result.sizes[axis])] if axis else [{}]:
        lines = {
            f"{float(result['percentile'].isel(part)):g} %": (
                x,
                at(array, stands, one, point, part).to_numpy()[order].astype(float),
            )
            for part in percentiles
        }
        lines = {name: (x, np.where(np.isfinite(y), y, np.nan)) for name, (x, y) in lines.items()}
        title = f"{wording.short(result, axis, point[axis])} axis" if axis else ""
        panels.append(Panel("remaining tolerance (mrad)", lines, title))
    if not any(np.isfinite(y).any() for panel in panels for _, y in panel.lines.values()):
        return
    where = wording.heliostat_text(result, {**stands, **one})
    caption = (
        "Smallest further error with which the centre of the beam leaves the aperture, 0 where it is outside already: "
        f"percentiles over the draws{f', {where}' if where else ''}.{wording.note(result, stands)}"
    )
    figure = curve_figure(
        panels,
        wording.label(result, HOUR),
        same_scale=True,
        step=wording.hour_step(result),
        legend="percentile",
        ordered=True,
        least_span=1.0,
    )
    yield NamedFigure("remaining_tolerance", caption, figure)


def _real(result: xr.Dataset) -> str:
    """Variable that only heliostats with spots have."""
    return _MOMENTS[0] if _MOMENTS[0] in result else "remaining_tolerance"


def _percent(drawn: list[maps.FieldMap]) -> tuple[float, float]:
    low, high = maps.value_scale(drawn)
    return max(low, 0.0), max(min(high, 100.0), low + 0.1)


def _mean(values: np.ndarray) -> np.ndarray:
    """Mean over the heliostats that have a value."""
    count = np.isfinite(values).sum(axis=1)
    return np.divide(np.nansum(values, axis=1), count, out=np.full(count.shape, np.nan), where=count > 0)

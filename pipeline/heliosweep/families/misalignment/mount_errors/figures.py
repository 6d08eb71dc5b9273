"""Figures of mounts with drawn errors: the spread of their spots, and how often they hit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from heliosweep.families.misalignment.figures import (
    DAYS,
    FIELD,
    HELIOSTAT,
    HOUR,
    MOST_LINES,
    MOST_MAPS,
    Spots,
    any_known,
    aperture,
    mean,
)
from heliosweep.report.contents import NamedFigure
from heliosweep.report.labels import number_text
from heliosweep.report.panels import Panel, curve_figure, panels_over
from heliosweep.report.pictures import Shades, picture_figure, symbols, within
from heliosweep.report.selection import at
from heliosweep.report.tracks import Ellipse, Plane, Track, origin, plane_figure

#: Hours of which ellipses are drawn.
MOST_HOURS = 9

_MOMENTS = ("spot_y_mean", "spot_z_mean", "spot_y_variance", "spot_z_variance", "spot_yz_covariance")
_EDGE = {"color": "#555555", "linewidth": 1.1}
_DOT = {"color": "#555555", "linestyle": "", "marker": "o", "markersize": 3}
_INSIDE = "spots inside (%)"


def spread(shown: Spots) -> Iterator[NamedFigure]:
    """Mean and covariance of the spots on the receiver plane, an ellipse for each hour, some heliostats."""
    if not shown.has(*_MOMENTS) or HELIOSTAT not in shown.result[_MOMENTS[0]].dims:
        return
    result, first = shown.result, shown.result[_MOMENTS[0]]
    hour = HOUR if HOUR in first.dims else None
    stands = shown.fixed(_MOMENTS[0], hour, HELIOSTAT)
    heliostats = shown.heliostats(_MOMENTS[0], stands)
    hours = shown.chosen(hour, MOST_HOURS, at(first, stands))
    planes, known = [], []
    for one in heliostats:
        tracks, ellipses = [origin("aim")], []
        for moment in hours:
            y, z, yy, zz, yz = (float(at(result[name], stands, one, moment)) for name in _MOMENTS)
            number = float(shown.coordinate(HOUR).isel(moment)) if hour else None
            ellipse = Ellipse(y, z, np.array([[yy, yz], [yz, zz]]), _EDGE, "95 % of the draws", number)
            if ellipse.known:
                ellipses.append(ellipse)
                known.append(number)
                numbers = None if number is None else np.array([number])
                tracks.append(Track(np.array([y]), np.array([z]), _DOT, "mean", numbers=numbers))
        planes.append(Plane(shown.heliostat({**stands, **one}), tracks, ellipses, aperture(result, stands)))
    if not known:
        return
    numbered = [number for number in known if number is not None]
    scale = Shades(shown.label(HOUR), min(numbered), max(numbered)) if numbered and shown.several(HOUR) else None
    caption = (
        "Spread of the centre of the beam over the draws of the mount errors, on the receiver plane: the ellipse of a "
        f"normal distribution with the mean and covariance of the draws that holds 95 %; {shown.seen}."
        f"{shown.note(stands, heliostats, hours)}"
    )
    yield NamedFigure("spot_spread", caption, plane_figure(planes, shown.plane, scale=scale))


def hits_over_day(shown: Spots) -> Iterator[NamedFigure]:
    """Part of the draws and heliostats whose spot is inside, over the hours."""
    result, name = shown.result, "field_hit_fraction"
    if not shown.has(name) or not shown.several(HOUR) or HOUR not in result[name].dims:
        return
    day = shown.day if shown.several(shown.day) and shown.day in result[name].dims else None
    line = next(iter(shown.swept(name)), day)
    panel = day if line != day else None
    stands = shown.fixed(name, HOUR, line, panel)
    lines, panels = shown.chosen(line, MOST_LINES), shown.chosen(panel, 4)
    drawn = panels_over(shown, 100 * result[name], _INSIDE, stands, lines, panels)
    if not any_known([y for one in drawn for y in one.lines.values()]):
        return
    count = result.sizes.get(HELIOSTAT, 1)
    of = f"{count} heliostats" if count > 1 else "the heliostat"
    caption = (
        f"Part of all draws in which the centre of the beam is inside the aperture, {of}."
        f"{shown.note(stands, lines, panels)}"
    )
    figure = curve_figure(
        drawn,
        shown.label(HOUR),
        same_scale=True,
        legend_title=shown.heading(line),
        ordered=bool(shown.heading(line)),
        ceiling=100.0,
        columns=3 if len(drawn) == 3 else 2,
        least_span=5.0,
    )
    yield NamedFigure("hits_over_day", caption, figure)


def hits_over_sweep(shown: Spots) -> Iterator[NamedFigure]:
    """Hits of a whole day over each swept number, a line for each day; a field by its mean and its worst heliostat."""
    result, name = shown.result, "day_hit_fraction"
    if not shown.of_heliostats(name):
        return
    day = next((dim for dim in DAYS if dim in result[name].dims), None)
    for dim in shown.numbers(name)[:2]:
        stands, days = shown.fixed(name, dim, day, HELIOSTAT), shown.chosen(day, 4)
        lines = {}
        for one in days:
            values = 100 * at(result[name], stands, one).compute()
            parts = {"mean": mean(values)}
            if values.sizes[HELIOSTAT] > 1:
                parts["worst heliostat"] = values.min(HELIOSTAT)
            for part, line in parts.items():
                words = [shown.fulls(one) if len(days) > 1 else "", part if len(parts) > 1 else ""]
                lines[", ".join(filter(None, words))] = line
        if any_known(list(lines.values())):
            caption = (
                "Part of all draws and hours with sun in which the centre of the beam is inside the aperture."
                f"{shown.note(stands, days)}"
            )
            figure = curve_figure([Panel(_INSIDE, lines)], shown.label(dim), least_span=5.0)
            yield NamedFigure(f"hits_over_{dim}", caption, figure)


def hit_map(shown: Spots) -> Iterator[NamedFigure]:
    """Hits of a whole day on the map of a field, for some days or some values of what is swept."""
    result, name = shown.result, "day_hit_fraction"
    if not shown.of_heliostats(name, FIELD):
        return
    dims = [*shown.swept(name), *(dim for dim in DAYS if dim in result[name].dims)]
    run = next((dim for dim in dims if shown.several(dim)), None)
    stands = shown.fixed(name, run, HELIOSTAT)
    points = shown.chosen(run, MOST_MAPS)
    maps = []
    for one in points:
        values = 100 * at(result[name], stands, one).to_numpy()
        finite = values[np.isfinite(values)]
        said = f"mean {number_text(float(finite.mean()), 1)} %" if finite.size else "no value"
        maps.append(shown.map(values, {**stands, **one}, "\n".join(filter(None, [shown.fulls(one), said]))))
    drawn = [one for one in maps if one]
    if len(drawn) < len(maps) or not any(np.isfinite(one.values).any() for one in drawn):
        return
    caption = (
        "Part of all draws and hours with sun in which the centre of each heliostat's beam is inside the aperture. "
        f"{symbols(drawn)}{shown.note(stands, points)}"
    )
    ends = within(_INSIDE, [one.values for one in drawn], held=1.0)
    shades = Shades(_INSIDE, max(ends.low, 0.0), max(min(ends.high, 100.0), ends.low + 0.1))
    yield NamedFigure("hit_map", caption, picture_figure(drawn, shades))


def remaining_tolerance(shown: Spots) -> Iterator[NamedFigure]:
    """Percentiles over the draws of what an aperture still tolerates, over the hours, of one heliostat."""
    result, name, axis = shown.result, "remaining_tolerance", "tolerance_axis"
    if not shown.has(name) or not shown.several(HOUR) or not {"percentile", HOUR} <= set(result[name].dims):
        return
    stands = shown.fixed(name, HOUR, "percentile", axis, HELIOSTAT)
    among = shown.heliostats(_MOMENTS[0] if _MOMENTS[0] in result else name, stands, 3)
    if not among:
        return
    one = among[len(among) // 2]
    known = at(result[name], one)
    percentiles = shown.chosen("percentile", MOST_LINES)
    axes = [{axis: i} for i in range(result.sizes[axis])] if axis in result[name].dims else [{}]
    panels = [
        Panel(
            "remaining tolerance (mrad)",
            {
                f"{float(result['percentile'].isel(part)):g} %": line.where(np.isfinite(line))
                for part in percentiles
                for line in [at(known, stands, point, part)]
            },
            f"{shown.values(point)} axis" if point else "",
        )
        for point in axes
    ]
    if not any_known([line for panel in panels for line in panel.lines.values()]):
        return
    where = shown.heliostat({**stands, **one})
    caption = (
        "Smallest further error with which the centre of the beam leaves the aperture, 0 where it is outside already: "
        f"percentiles over the draws{f', {where}' if where else ''}.{shown.note(stands)}"
    )
    options: dict[str, Any] = {"same_scale": True, "legend_title": "percentile", "ordered": True, "least_span": 1.0}
    yield NamedFigure("remaining_tolerance", caption, curve_figure(panels, shown.label(HOUR), **options))


FIGURES = (spread, hits_over_day, hits_over_sweep, hit_map, remaining_tolerance)

"""Figures of a finished result: maps of the field after Figures 6 to 8 of Chong and Tan (2012), and curves.

Every figure reads only what it draws; long sweeps are thinned, and the caption says what is shown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.field_efficiency import figures_energy as energy
from heliosweep.families.field_efficiency.figures_surfaces import flux_figures, motion_maps, outline_figures
from heliosweep.families.field_efficiency.variables import ANGLE_SERIES
from heliosweep.report.contents import NamedFigure, one_by_one
from heliosweep.report.labels import DEGREE, axis_label, is_fraction, number_text, printed, unit_of
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import COLUMNS, FieldMap, Shades, about_zero, field_map, picture_figure, symbols, within
from heliosweep.report.selection import Point, Shown, at, evenly, is_geometric

#: Figures of one result.
MOST_FIGURES = 12

#: Latitudes (or sites, layouts, ...) of which maps are drawn; latitudes from which on curves say more than the maps.
MOST_MAPS, LEAST_LATITUDES = 6, 4

#: Figures of curves, one for each swept number.
MOST_CURVES = 3

#: Change of an efficiency below which it has no panel, and least height of a panel of energies. [%, MWh/m2]
LEAST_CHANGE, LEAST_ENERGY = 0.05, 0.01

#: Equinoxes and solstices by day of the year, and how far the nearest day may be away. [d]
SEASONS = {80: "March equinox", 172: "June solstice", 266: "September equinox", 355: "December solstice"}
NEAR = 10

#: Days and places of which the course is drawn, and how much of a series is held at a time. [bytes]
MOST_DAYS, MOST_PLACES, PIECE = 4, 3, 16 * 2**20

_METHODS = ("spinning_elevation", "azimuth_elevation")
_MAPPED, _SERIES, _METHOD = "optical_efficiency", "instantaneous_optical_efficiency", "tracking"
#: What is mapped where there is weather.
_ENERGY = "energy_per_mirror_area"
_CURVES = (
    *(_ENERGY, "total_efficiency"),
    *(f"{name}_efficiency" for name in ("optical", "cosine", "shading", "blocking", "intercept")),
)
#: What maps say of a number of each heliostat, and its decimals.
_SAID = {
    _MAPPED: ("Mean optical efficiency of each heliostat over the period", 2),
    _ENERGY: ("Energy of each heliostat per mirror area", 4),
}


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of a result, each drawn when it is asked for; values are read as they are needed."""
    shown = Shown(result)
    dims = [str(dim) for dim in result[f"field_{_MAPPED}"].dims]
    others = [dim for dim in dims if dim != _METHOD]
    along = next((dim for dim in ("latitude", "site", *others) if dim in others), None)
    stands = shown.fixed(f"field_{_MAPPED}", _METHOD, along)
    methods = [{_METHOD: i} for i in range(result.sizes[_METHOD])] if _METHOD in dims else [{}]
    curves, maps = partial(_curves, others=others), partial(_maps, stands=stands, along=along)
    draws = [curves, maps]
    if _ENERGY in result:
        first = (energy.losses, energy.months, energy.ranks)
        draws = [*(partial(draw, stands=stands, along=along) for draw in first), *draws]
    asked = {
        "total_efficiency": energy.factor_maps,
        "field_power": energy.durations,
        "hours_lost": energy.hours,
        "primary_angle_range": motion_maps,
        "outline_u": outline_figures,
        "peak_flux" if "peak_flux" in result else "energy_flux_map": flux_figures,
        _SERIES: _day_courses,
        ANGLE_SERIES[0]: _angle_courses,
    }
    draws += [partial(draw, stands=stands, along=along) for name, draw in asked.items() if name in result]
    return one_by_one([partial(draw, methods=methods) for draw in draws], shown, MOST_FIGURES)


def _maps(shown: Shown, methods: list[dict[str, int]], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Maps of each method and place, and of the differences between methods."""
    result, places = shown.result, shown.chosen(along, MOST_MAPS)
    mapped = _ENERGY if _ENERGY in result else _MAPPED
    maps = [[_field_map(shown, mapped, stands, method, place) for place in places] for method in methods]
    note = shown.note(stands, places)
    everything = [one for row in maps for one in row]
    shades = within(axis_label(result[mapped]), [one.values for one in everything], held=1.0)
    said, decimals = _SAID[mapped]
    meant = symbols(everything, sized=True, missing="left out" if "kept" in result else "no value")
    caption = f"{said}, on one colour scale for all maps. {meant}{note}"
    yield from _sheets("field_maps", caption, maps, shades)
    words = list(result[_METHOD].to_numpy()) if methods[0] else []
    if set(_METHODS) <= set(words):
        first, second = (words.index(method) for method in _METHODS)
        pairs = zip(maps[first], maps[second], places, strict=True)
        unit = "percentage points" if mapped == _MAPPED else unit_of(result[mapped])
        differences = [
            _difference(one, other, _place(shown, place), unit.split()[-1], decimals) for one, other, place in pairs
        ]
        label = f"spinning-elevation minus azimuth-elevation ({unit})"
        shades = about_zero(label, [one.values for one in differences], 1e-3, held=1.0)
        caption = (
            f"{said}, spinning-elevation minus azimuth-elevation: red where spinning-elevation is better. "
            f"{symbols(differences, sized=True)}{note}"
        )
        yield from _sheets("difference_maps", caption, [differences], shades)


def _place(shown: Shown, point: Point) -> str:
    """Where and how a map was computed; where nothing but the tracking is swept, the latitude that all share."""
    if point or "latitude" not in shown.result.coords or shown.result["latitude"].ndim:
        return shown.fulls(point)
    return shown.full("latitude", 0)


def _title(shown: Shown, method: Point, place: Point) -> str:
    single = not method and _METHOD in shown.result.coords and not shown.result[_METHOD].ndim
    words = shown.value(_METHOD, 0) if single else shown.values(method)
    return ", ".join(filter(None, [words, _place(shown, place)]))


def _field_map(shown: Shown, mapped: str, stands: Point, method: Point, place: Point) -> FieldMap:
    """Map of one method at one place, titled with the mean of its field."""
    here = shown.result.isel({**stands, **method, **place})
    mean = float(printed(here[f"field_{mapped}"]))
    words = (
        f"field mean {number_text(mean, _SAID[mapped][1])} {unit_of(here[mapped])}" if np.isfinite(mean) else "no value"
    )
    title = "\n".join(filter(None, [_title(shown, method, place), words]))
    found = field_map(here, printed(here[mapped]), title)
    if found is None:  # a part of a result may lack them
        raise KeyError("x")
    return found


def _difference(one: FieldMap, other: FieldMap, place: str, unit: str, decimals: int) -> FieldMap:
    values = one.values - other.values
    finite = values[np.isfinite(values)]
    ends = (
        [number_text(float(end), decimals, signed=True) for end in (finite.min(), finite.max())] if finite.size else []
    )
    title = f"{' to '.join(dict.fromkeys(ends))} {unit}" if ends else "no value"
    return replace(one, values=values, title="\n".join(filter(None, [place, title])))


def _sheets(name: str, caption: str, maps: list[list[FieldMap]], shades: Shades) -> Iterator[NamedFigure]:
    """Share columns of maps among figures of a size that can be read; a single row takes two."""
    columns = len(maps[0])
    parts = -(-columns // (COLUMNS if len(maps) > 1 else 2 * COLUMNS))
    for part in range(parts):
        chosen = slice(-(-columns * part // parts), -(-columns * (part + 1) // parts))
        drawn = [one for row in maps for one in row[chosen]]
        which = f" (Part {part + 1} of {parts}.)" if parts > 1 else ""
        figure = picture_figure(drawn, shades, len(drawn) // len(maps) if len(maps) > 1 and columns > 1 else 0)
        yield NamedFigure(name if part == 0 else f"{name}_{part + 1}", caption + which, figure)


def _curves(shown: Shown, methods: list[dict[str, int]], others: list[str]) -> Iterator[NamedFigure]:
    """Efficiencies of the field over each swept number."""
    names = [f"field_{name}" for name in _CURVES if f"field_{name}" in shown.result]
    if "field_total_efficiency" in names:
        names.remove(f"field_{_MAPPED}")
    swept = [dim for dim in others if shown.is_number(dim)]
    swept = [dim for dim in swept if shown.result.sizes[dim] >= (LEAST_LATITUDES if dim == "latitude" else 2)]
    for dim in sorted(swept, key=lambda dim: dim != "latitude")[:MOST_CURVES]:
        stands = shown.fixed(f"field_{_MAPPED}", _METHOD, dim)
        panels, same = [], list[str]()
        for name in names:
            array, scale = shown.result[name], 100 if is_fraction(shown.result[name]) else 1
            lines = {
                _title(shown, one, {}).split(",")[0] if one else "": scale * at(array, stands, one) for one in methods
            }
            words = name.removeprefix("field_").replace("_", " ")
            changes = [float(line.max() - line.min()) for line in lines.values()]
            if is_fraction(array) and np.isfinite(changes).any() and np.nanmax(changes) < LEAST_CHANGE:
                same.append(words)
                continue
            panels.append(
                Panel(f"{words} ({unit_of(array)})", lines, least_span=None if scale == 100 else LEAST_ENERGY)
            )
        if not panels:
            continue
        figure = curve_figure(panels, shown.label(dim), logarithmic=is_geometric(shown.result[dim].to_numpy()))
        said = "Energy per mirror area and mean efficiencies" if _ENERGY in shown.result else "Mean efficiencies"
        hardly = f" Less than {LEAST_CHANGE:g} % changes: {', '.join(same)}." if same else ""
        caption = f"{said} of the field over the period against {shown.title(dim)}.{hardly}{shown.note(stands)}"
        yield NamedFigure(f"efficiency_over_{dim}", caption, figure)


def _day_courses(
    shown: Shown, methods: list[dict[str, int]], stands: Point, along: str | None
) -> Iterator[NamedFigure]:
    """Mean efficiency of the field over some days; a panel for each method and place, a line for each day."""
    panels, kind, places = [], "", shown.chosen(along, MOST_PLACES)
    for method in methods:
        for place in places:
            here = shown.result.isel({**stands, **method, **place})
            kind, days, hours = _clock(here)
            lines = {}
            for name, instants in _days(kind, days).items():
                start, stop = int(instants[0]), int(instants[-1]) + 1
                means = field_means(here, slice(start, stop))[instants - start]
                lines[name] = xr.DataArray(means, {"hour": ("hour", hours[instants], {"units": "h"})})
            panels.append(Panel("optical efficiency (%)", lines, _title(shown, method, place)))
    count = len({name for panel in panels for name in panel.lines})
    clock = "universal time of day" if kind == "date" else "solar time of day"
    figure = curve_figure(panels, f"{clock} (h)", columns=len(places), same_scale=True)
    caption = (
        "Optical efficiency of the field at each instant (mean over the heliostats, weighted by mirror area) on "
        f"{count} of the days computed.{shown.note(stands, places)}"
    )
    yield NamedFigure("day_courses", caption, figure)


def _angle_courses(
    shown: Shown, methods: list[dict[str, int]], stands: Point, along: str | None
) -> Iterator[NamedFigure]:
    """Angles of the mounts of the northernmost and the easternmost heliostat over some days, a line for each day."""
    panels, kind, place = [], "", shown.chosen(along, 1)[0]
    whole = shown.result.isel({**stands, **place})
    chosen = {word: int(np.nanargmax(whole[side].to_numpy())) for word, side in (("north", "y"), ("east", "x"))}
    for name in ANGLE_SERIES:
        label = f"{name.split('_')[1]} angle (deg)"
        for method in methods:
            for word, index in chosen.items():
                here = shown.result.isel({**stands, **method, **place, "heliostat": index})
                kind, days, hours = _clock(here)
                lines = {}
                for day, instants in _days(kind, days).items():
                    values = here[name].isel(time=instants).to_numpy().copy()
                    values[np.isfinite(values)] = np.unwrap(values[np.isfinite(values)], period=360.0)
                    lines[day] = xr.DataArray(values, {"hour": ("hour", hours[instants], {"units": "h"})})
                title = ", ".join(filter(None, [shown.values(method), f"heliostat {index} in the {word}"]))
                panels.append(Panel(label, lines, title))
    clock = "universal time of day" if kind == "date" else "solar time of day"
    caption = (
        "Angles of the primary and the secondary axis of the northernmost and the easternmost heliostat, counted on "
        f"beyond a full turn.{shown.note(stands, [place])}"
    )
    figure = curve_figure(panels, f"{clock} (h)", columns=len(panels) // len(ANGLE_SERIES), same_scale="row")
    yield NamedFigure("angle_courses", caption, figure)


def field_means(here: xr.Dataset, part: slice) -> np.ndarray:
    """Mean over the heliostats at some instants of one parameter point, in percent; NaN with the sun down.

    The series of the point has the dimensions ``time`` and ``heliostat``; it is read in pieces of bounded size.
    """
    series = here[_SERIES]
    area = xr.ones_like(here["x"], dtype=float)
    for side in ("heliostat_width", "heliostat_height"):
        area = area * (here[side] if side in here.coords else 1.0)
    length = max(1, PIECE // (8 * area.size))
    scale = 100.0 if is_fraction(series) else 1.0
    starts = range(part.start, part.stop, length)
    pieces = [series.isel(time=slice(start, min(start + length, part.stop))).compute() for start in starts]
    means = [scale * piece.weighted(area.fillna(0.0)).mean("heliostat").to_numpy() for piece in pieces]
    return np.concatenate(means)


def _clock(here: xr.Dataset) -> tuple[str, np.ndarray, np.ndarray]:
    """What days are told by (day of the year, declination in degrees, or date), day and hour [h] of all instants."""
    for name in ("day", "declination"):
        if name in here.coords:
            return name, here[name].to_numpy(), here["solar_hour"].to_numpy()
    stamps = here["utc" if "utc" in here.coords else "time"].to_numpy()
    dates = stamps.astype("datetime64[D]")
    return "date", dates, (stamps - dates) / np.timedelta64(1, "h")


def _days(kind: str, days: np.ndarray) -> dict[str, np.ndarray]:
    """Instants of the days that are drawn, by name: equinoxes and solstices where near, else evenly chosen ones."""
    known = np.unique(days[~np.isnat(days)] if kind == "date" else days)
    named: dict[int, str] = {}
    if kind != "declination":
        numbers = known if kind == "day" else (known - known.astype("datetime64[Y]")).astype(float) + 1
        for season, name in SEASONS.items():
            index = int(np.argmin(np.abs(numbers - season)))
            if abs(numbers[index] - season) <= NEAR:
                named.setdefault(index, name)
    chosen = list(named) or evenly(known.size, MOST_DAYS)
    return {_day(kind, known[index], named.get(index)): np.flatnonzero(days == known[index]) for index in chosen}


def _day(kind: str, day: Any, season: str | None) -> str:
    if kind == "declination":
        return f"declination {number_text(float(day), 1)}{DEGREE}"
    text = str(day) if kind == "date" else f"day {day:g}"
    return f"{text} ({season})" if season else text

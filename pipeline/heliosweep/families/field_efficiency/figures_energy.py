"""Figures of the energy of a field: where it is lost, when it comes, and what each heliostat brings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from heliosweep.families.field_efficiency.tables import STAGES, arrival
from heliosweep.report.colours import COLOURS, DASHES
from heliosweep.report.contents import NamedFigure
from heliosweep.report.labels import number_text, printed
from heliosweep.report.layout import abreast, colour_bar, fit, label_outside, legend, sheet
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import COLUMNS, FieldMap, field_map, symbols, within
from heliosweep.report.selection import Point, Shown, at, evenly
from heliosweep.report.style import styled
from heliosweep.report.views import FIELD

#: Places (sites, latitudes, layouts ...) of which there are panels, lines, and bars of hours.
MOST_PANELS, MOST_LINES, MOST_BARS = 4, 3, 12
#: Points of a curve. [1]
MOST_POINTS = 1000
#: Part of all hours below which a bar has no number in it. [1]
LEAST_NAMED = 0.04

_CAUSES = {
    "dni": "irradiance below its limit",
    "sun_elevation": "sun below its limit",
    "wind_speed": "wind above its limit",
}
_MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
_ALL, _LOST, _KEPT, _USED = "#b0b0b0", COLOURS[1], COLOURS[0], COLOURS[2]
#: At each instant: labels of axes.
_COURSES = {"dni": "direct normal irradiance (W/m\N{SUPERSCRIPT TWO})", "field_power": "power of the field (MW)"}
#: Factors of which there are maps.
_FACTORS = [f"{one}_efficiency" for one in ("cosine", "shading", "blocking", "attenuation", "intercept", "total")]


class _Loss(NamedTuple):
    """The way of the energy of one field: words and energies of all steps, and where their bars begin. [MWh]"""

    title: str
    steps: list[str]
    energies: np.ndarray
    starts: np.ndarray


def losses(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Waterfall from the incident to the received energy, a panel for each place and method."""
    result, places = shown.result, shown.chosen(along, MOST_PANELS)
    points = [{**stands, **method, **place} for place, method in product(places, methods)]
    taken = np.array([at(result["loss"], point).to_numpy() for point in points])
    happens = (taken != 0).any(axis=0)
    stages = [STAGES.get(stage, stage) for stage in result["stage"].to_numpy()[happens]]
    panels = []
    for point, (place, method), lost in zip(points, product(places, methods), taken[:, happens], strict=True):
        incident, received = (float(at(result[f"field_{name}_energy"], point)) for name in ("incident", "receiver"))
        left = incident - np.cumsum(lost)
        title = ", ".join(filter(None, [shown.fulls(place), shown.values(method)]))
        steps, energies = ["incident", *stages, arrival(result)], np.array([incident, *lost, received])
        panels.append(_Loss(title, steps, energies, np.array([0.0, *left, 0.0])))
    caption = (
        "Where the energy goes, from the direct sunlight on all mirrors with the sun above the horizon to what is "
        f"{arrival(result)}, in percent of the first.{shown.note(stands, places)}"
    )
    yield NamedFigure("energy_losses", caption, _waterfalls(panels, len(methods) if len(methods) > 1 else 2))


def _energy(energy: float) -> str:
    """Energy with as many decimals as a bar has room for."""
    return f"{energy:,.0f}" if abs(energy) >= 1000 else f"{energy:.3g}"


@styled
def _waterfalls(panels: Sequence[_Loss], columns: int) -> Figure:
    """Draw each loss as a bar that ends where the one above begins."""
    columns = min(columns, len(panels))
    figure, grid = sheet(len(panels), columns, sharex=True, sharey=True, wide=True)
    for axes, (title, steps, energies, starts) in zip(grid, panels, strict=True):
        colours = [_ALL, *[_LOST] * (len(steps) - 2), _KEPT]
        rows, whole = range(len(steps)), energies[0]
        axes.barh(rows, energies, left=starts, color=colours, height=0.72, edgecolor=colours, linewidth=0.6)
        axes.set(title=title, yticks=rows, yticklabels=steps)
        axes.tick_params(axis="y", length=0)
        axes.grid(True, axis="x")
        for row, energy, start in zip(rows, energies, starts, strict=True):
            part = 100 * energy / whole if whole else np.nan
            text = f"{_energy(energy)} ({number_text(part, 2 if 0 < abs(part) < 0.1 else 1)} %)"
            if colours[row] != _LOST:
                axes.text(0.02 * whole, row, text, va="center", fontsize=7, color="white" if row else "black")
            elif start > 0.4 * whole:
                axes.text(start - 0.02 * whole, row, text, ha="right", va="center", fontsize=7)
            else:
                axes.text(start + energy + 0.02 * whole, row, text, va="center", fontsize=7)
    grid[0].set_ylim(len(panels[0].steps) - 0.5, -0.5)
    label_outside(grid, columns, "energy (MWh)", ["stage"] * len(grid))
    return fit(figure, 0.045 * len(panels[0].steps) * columns)


def months(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Energy of each month, incident and received, a panel for each place."""
    result, places = shown.result, shown.chosen(along, MOST_PANELS)
    panels = {
        shown.fulls(place): (
            at(result["monthly_incident_energy"], stands, methods[0], place).to_numpy(),
            {
                shown.values(one): at(result["monthly_receiver_energy"], stands, one, place).to_numpy()
                for one in methods
            },
        )
        for place in places
    }
    caption = (
        f"Energy of the field in each month: direct sunlight on the mirrors, and what of it is {arrival(result)}."
        f"{shown.note(stands, places)}"
    )
    yield NamedFigure("monthly_energy", caption, _months(panels, arrival(result)))


@styled
def _months(panels: dict[str, tuple[np.ndarray, dict[str, np.ndarray]]], received: str) -> Figure:
    """Draw bars of the received energies beside each other, before those of the incident energy."""
    columns = min(2, len(panels))
    figure, grid = sheet(len(panels), columns, sharex=True, sharey=True)
    entries: dict[str, Any] = {"incident": Patch(facecolor="#dddddd")}
    for axes, (title, (incident, bars)) in zip(grid, panels.items(), strict=True):
        number = np.arange(1, incident.size + 1)
        axes.bar(number, incident, 0.86, color="#dddddd")
        for index, (name, energies) in enumerate(bars.items()):
            width = 0.7 / len(bars)
            axes.bar(number + (index + 0.5) * width - 0.35, energies, width, color=COLOURS[index])
            entries[", ".join(filter(None, [name, received]))] = Patch(facecolor=COLOURS[index])
        axes.set_title(title)
        axes.set_xticks(number, _MONTHS)
        axes.tick_params(axis="x", length=0, labelsize=6)
        axes.grid(True, axis="y")
    label_outside(grid, columns, "month", ["energy (MWh)"] * len(grid))
    legend(figure, entries)
    return fit(figure, 0.55)


def hours(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Hours in which the field works, and those that each limit takes, a bar for each place."""
    result, places = shown.result, shown.chosen(along, MOST_BARS)
    causes = [str(cause) for cause in result["cause"].to_numpy()]
    bars = {}
    for place in places:
        used, lost = (at(result[name], stands, methods[0], place).to_numpy() for name in ("hours_used", "hours_lost"))
        bars[shown.fulls(place)] = np.array([used, *lost])
    if len({each.tobytes() for each in bars.values()}) == 1:  # what is swept has no part in it
        along, places, bars = None, [], {"": next(iter(bars.values()))}
    if not np.any([each[1:] for each in bars.values()]):
        return
    words = ["used", *(_CAUSES.get(cause, cause) for cause in causes)]
    stowed = 100 * (result["loss"].sel(stage="stow") / result["field_incident_energy"])
    low, high = (f"{float(end):.2g}" for end in (stowed.min(), stowed.max()))
    caption = (
        "Hours with the sun above the horizon: those in which the field works, and those lost to each limit, counted "
        f"for the first that is not kept. In the hours lost comes {low if low == high else f'{low} to {high}'} % of "
        f"the direct irradiation.{shown.note(stands, places)}"
    )
    yield NamedFigure("hours_lost", caption, _hours(bars, words, shown.title(along) if along else ""))


@styled
def _hours(bars: dict[str, np.ndarray], words: Sequence[str], along: str) -> Figure:
    """Draw the hours of each place as parts of one bar."""
    figure, (axes,) = sheet(1, 1, wide=True)
    every = np.array(list(bars.values()))
    most = every.sum(axis=1).max()
    entries: dict[str, Any] = {}
    for part, (word, colour) in enumerate(zip(words, (_USED, COLOURS[5], COLOURS[4], COLOURS[3]), strict=True)):
        if not every[:, part].any():
            continue
        start = every[:, :part].sum(axis=1)
        entries[word] = axes.barh(range(len(bars)), every[:, part], left=start, color=colour, height=0.7)
        for row, (left, length) in enumerate(zip(start, every[:, part], strict=True)):
            if length > LEAST_NAMED * most:
                axes.text(left + length / 2, row, f"{length:,.0f}", ha="center", va="center", fontsize=7)
    axes.set(
        yticks=range(len(bars)), yticklabels=list(bars), ylim=(len(bars) - 0.5, -0.5), xlabel="time (h)", ylabel=along
    )
    axes.tick_params(axis="y", length=0)
    axes.grid(True, axis="x")
    legend(figure, entries)
    return fit(figure, 0.06 * len(bars) + 0.06)


def ranks(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Energy per mirror area of the heliostats from the best to the worst, and the part of all that they bring."""
    result, places = shown.result, shown.chosen(along, MOST_LINES)
    if result.sizes["heliostat"] < FIELD:
        return
    each: dict[str, xr.DataArray] = {}
    share: dict[str, xr.DataArray] = {}
    for place, method in product(places, methods):
        here = result[["rank", "energy_per_mirror_area", "receiver_energy"]].isel({**stands, **place, **method})
        order = np.argsort(here["rank"].to_numpy())[: int(here["rank"].notnull().sum())]
        if not order.size:  # a field that receives nothing
            continue
        name = ", ".join(filter(None, [shown.values(place), shown.values(method)]))
        rank = {"rank": ("rank", np.arange(1, order.size + 1))}
        each[name] = xr.DataArray(here["energy_per_mirror_area"].to_numpy()[order], rank)
        energy = np.cumsum(here["receiver_energy"].to_numpy()[order])
        share[name] = xr.DataArray(100 * energy / energy[-1], rank)
    if not each:
        return
    panels = [
        Panel("energy per mirror area (MWh/m\N{SUPERSCRIPT TWO})", each),
        Panel("share of the field's energy (%)", share),
    ]
    caption = (
        f"Energy {arrival(result)} per mirror area of the heliostats, from the best to the worst, and the share of "
        f"the field's energy that all up to each bring.{shown.note(stands, places)}"
    )
    figure = curve_figure(panels, "rank of the heliostat", least_span=1e-3)
    yield NamedFigure("energy_by_rank", caption, figure)


def durations(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Hours in which irradiance and power are at least so large."""
    result, places = shown.result, shown.chosen(along, MOST_LINES)
    panels = []
    for place, (name, label) in product(places, _COURSES.items()):
        lines = {}
        for method in methods if name == "field_power" else methods[:1]:
            here = result[[name, "sun_elevation", "hours_used", "hours_lost"]].isel({**stands, **place, **method})
            values = np.sort(here[name].to_numpy())[::-1]
            values = values[values > 0]
            lit = int(here["sun_elevation"].notnull().sum())
            if values.size:
                each = float(here["hours_used"] + here["hours_lost"].sum()) / lit
                shown_at = evenly(values.size, MOST_POINTS)
                passed = {"duration": ("duration", each * (np.array(shown_at) + 1.0), {"units": "h"})}
                lines[shown.values(method) if name == "field_power" else ""] = xr.DataArray(values[shown_at], passed)
        if lines:
            panels.append(Panel(label, lines, shown.fulls(place)))
    if panels:
        caption = (
            "Hours in which direct normal irradiance and power are at least so large; each instant with the sun up "
            f"stands for the same time.{shown.note(stands, places)}"
        )
        kinds: Any = zip(map(shown.values, methods), COLOURS, DASHES, strict=False)
        looks = {"": {"color": "black"}} | {name: {"color": colour, "linestyle": dash} for name, colour, dash in kinds}
        yield NamedFigure("duration_curves", caption, curve_figure(panels, "duration (h)", looks=looks))


def factor_maps(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Map of each factor of the light of every heliostat, at one place and by one method."""
    result, point = shown.result, {**stands, **methods[0], **shown.chosen(along, 1)[0]}
    if result.sizes["heliostat"] < FIELD:
        return
    here, maps = result.isel(point), {}
    for name in (name for name in _FACTORS if name in result):
        words, values = name.replace("_", " "), printed(here[name])
        one = field_map(here, values, f"field mean {number_text(float(printed(here[f'field_{name}'])))} %")
        if one is not None and np.isfinite(values).any() and np.nanmin(values) < np.nanmax(values):
            maps[f"{words} (%)"] = one
    if maps:
        caption = (
            "Mean factors of the light of every heliostat, each on its own colour scale. "
            f"{symbols(list(maps.values()), sized=True)}{shown.note(point)}"
        )
        yield NamedFigure("factor_maps", caption, _factors(maps))


@styled
def _factors(maps: dict[str, FieldMap]) -> Figure:
    """Draw maps beside each other, each with its bar below."""
    columns = abreast(len(maps), COLUMNS)
    figure, grid = sheet(len(maps), columns)
    low, high = np.transpose(next(iter(maps.values())).ends())
    for axes, (label, one) in zip(grid, maps.items(), strict=True):
        shades = within(label, [one.values])
        shades = replace(shades, high=min(shades.high, 100.0))
        one.draw(axes, shades.colours, shades.norm, False)
        axes.set(title=one.title, xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        colour_bar(figure, ScalarMappable(shades.norm, shades.colours), [axes], label, shades.beyond([one.values]))
    label_outside(grid, columns, FieldMap.sides[0], [FieldMap.sides[1]] * len(grid))
    return fit(figure, float((high - low)[1] / (high - low)[0]))

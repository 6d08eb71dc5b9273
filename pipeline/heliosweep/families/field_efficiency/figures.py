"""Figures of a field: energy losses, maps of the heliostats, and curves over swept keys."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.field_efficiency.budget import budget_columns, budget_figure
from heliosweep.families.field_efficiency.limited import draw_aims
from heliosweep.families.field_efficiency.variables import EFFICIENCIES, FACTORED, LIGHT, PRODUCT
from heliosweep.report.context import Context, at
from heliosweep.report.figures import FIELD, HELIOSTAT, Curves, Figure, Maps, Rasters, Special, is_ordered
from heliosweep.report.tables import SOURCE, Table, numbers

#: Names of stages in tables and figures if they differ from the labels in the result.
STAGES = {"stow": "stow (limits)"}
_COST = ("levelized_cost_of_heat", "total_capital_cost", "field_heat", "design_point_heat")
_AIMS = ("aimed_power", "unlimited_power", "limit_loss", "aim_gap", "aimed_peak_flux", "unlimited_peak_flux",
         "stowed_heliostats")  # fmt: skip


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Yield one table of energies and power, and one of efficiencies and losses."""
    dims = [str(dim) for dim in result["field_optical_efficiency"].dims]
    whole = {str(name) for name, array in result.data_vars.items() if set(array.dims) == set(dims)}
    names = [*_COST, "field_receiver_energy", "field_energy_per_mirror_area", "field_incident_energy", "hours_used",
             "design_point_power", *_AIMS, "peak_flux", "mean_flux", "power_above_limit",
             "field_heliostats", "field_mirror_area", "field_land_area", "field_packing_factor"]  # fmt: skip
    columns = [_named(result, name) for name in names if name in whole]
    if "hours_lost" in result:
        causes = zip(result["cause"].to_numpy(), result["hours_lost"].transpose("cause", *dims), strict=True)
        columns += [lost.rename(f"hours lost to {cause}") for cause, lost in causes if bool((lost > 0).any())]
    energy = "field_receiver_energy" in result
    if columns:
        yield numbers(result, dims, columns, "Energy, power and size", [_sums(result)] if energy else [], digits=4)
    if parts := budget_columns(result):
        yield numbers(
            result,
            dims,
            parts,
            "Error budget",
            ["Loss of each cause alone, and the loss of all causes minus these losses."],
            digits=4,
        )
    years = [_named(result, name) for name in map(str, result.data_vars) if name.endswith(("_p50", "_p90"))]
    if years:
        note = "Values that a weather year exceeds with a probability of 50 % and 90 %: quantiles of the years."
        yield numbers(result, [str(dim) for dim in years[0].dims], years, "Weather years", [note], digits=4)
    order = dict.fromkeys(["total_efficiency", "optical_efficiency", *EFFICIENCIES, *LIGHT])
    means = [_named(result, f"field_{name}") for name in order if f"field_{name}" in whole]
    if FACTORED in whole:
        means.append(_named(result, FACTORED))
    means += [_named(result, name) for name in (f"field_design_point_{name}" for name in order) if name in whole]
    notes = ["Factored: product of the means of cosine, shading and blocking efficiency."]
    yield numbers(result, dims, means, "Mean efficiencies over the period", notes)


def _named(result: xr.Dataset, name: str) -> xr.DataArray:
    words = name.removeprefix("field_").removesuffix("_efficiency").replace("_", " ")
    array = result[name].assign_attrs({SOURCE: name})
    return array.rename({"heliostats": "number of heliostats"}.get(words, words))


def _sums(result: xr.Dataset) -> str:
    """Return a sentence about the number of hours over which energies are summed."""
    daylight = (result["hours_used"] + result["hours_lost"].sum("cause")).to_numpy()
    low, high = float(daylight.min()), float(daylight.max())
    hours = f"{low:,.0f} h" if high - low < 0.5 else f"{low:,.0f} to {high:,.0f} h"
    year = 4250.0 < low <= high < 4900.0  # h: about half of all hours, plus partly lit intervals
    return f"Sums over {hours} with the sun above the horizon, {'a full year' if year else 'less or more than a year'}."


def arrival(result: xr.Dataset) -> str:
    """Return a phrase for the point in the optical path at which energies are given."""
    return "on the receiver" if "total_efficiency" in result else "sent to the receiver"


_LIGHT = ("total", "optical", "cosine", "shading", "blocking", "attenuation", "intercept", "reflection")
_EFFICIENCIES = tuple(f"{name}_efficiency" for name in _LIGHT)
_ENERGY = ("energy_per_mirror_area", "receiver_energy", "rank")
_PLACES = ("latitude", "site", "layout")
_FLUX = ("flux_row", "flux_column")
_ANGLES = ("primary_angle", "secondary_angle")
#: Dimensions that have separate figures.
_OWN = (HELIOSTAT, "time", "month", "stage", "cause", "item", *_FLUX, "effect", "image", "corner")


def figures(result: xr.Dataset) -> list[Figure]:
    """Return the figures of a result, with the main figure first."""
    energy, context = _ENERGY[0] in result, Context(result)
    means = "Energies are sums, efficiencies are means over the period." if energy else "Means over the period."
    field = [f"field_{name}" for name in (*_ENERGY[:2], *_EFFICIENCIES)]
    others = ["design_point_power", "field_heliostats", "peak_flux", "mean_flux", "power_above_limit", "hours_used"]
    swept = [str(dim) for dim in result.sizes if dim not in _OWN and is_ordered(result, str(dim))]
    series = [f"instantaneous_{name}" for name in _EFFICIENCIES if f"instantaneous_{name}" in result]
    lines, places = ("tracking",), _PLACES
    return [
        Special("energy_losses",
                f"Energy from the direct sunlight on all mirrors to the energy {arrival(result)}, in percent of the "
                "first",
                ("loss", "field_incident_energy", "field_receiver_energy"), draw=_losses),
        budget_figure(result),
        Maps("field_maps", "Energy and efficiency of every heliostat" if energy else "Efficiency of every heliostat",
             (*_ENERGY[:1], *_EFFICIENCIES, PRODUCT, *_ENERGY[1:], *(f"design_point_{name}" for name in _EFFICIENCIES)),
             panels=places, lines=lines, less="tracking", notes=means),
        *(Curves(f"cost_of_heat_over_{dim}", f"Cost of heat over the {context.title(dim)}", _COST, over=(dim,),
                 lines=[str(other) for other in result[_COST[0]].dims if other != dim])
          for dim in swept if _COST[0] in result),
        Special("aim_points", "Aim points of the heliostats and flux under the limit",
                ("aim_x", "aim_y", "aim_z", "aimed_flux_map"), draw=draw_aims),
        Rasters("flux_and_limit", "Flux on the receiver without and with the limit",
                ("unlimited_flux_map", "aimed_flux_map"), over=_FLUX, panels=("flux_limit", *places)),
        Rasters("flux_price", "Power that a unit of the limit of a cell is worth", ("flux_price",), over=_FLUX,
                panels=("flux_limit", *places)),
        Curves("power_over_limit", "Power on the receiver over the limit of the flux", ("power_bound", *_AIMS),
               over=("flux_limit",), lines=lines),
        Special("capital_cost", "Capital cost by item", ("capital_cost", "total_capital_cost"), draw=_costs),
        *(Curves(f"efficiency_over_{dim}", f"Energy and mean efficiency of the field over the {context.title(dim)}",
                 (*field, *others), over=(dim,), lines=lines, notes=f"{means} Field means are weighted by mirror area.")
          for dim in sorted(swept, key=lambda dim: dim != "latitude")),
        Maps("factor_maps", "Mean factors of the light of every heliostat",
             _EFFICIENCIES[2:7] if "total_efficiency" in result else (), each=True, at={"latitude": 0.0},
             interactive=False),
        Curves("monthly_energy", "Energy of the field by month", ("monthly_receiver_energy", "monthly_incident_energy"),
               over=("month",), lines=lines,
               notes="Incident: direct sunlight on all mirrors with the sun above the horizon."),
        Curves("energy_by_rank",
               f"Heliostats in descending order of energy {arrival(result)} per mirror area",
               ("ranked_energy", "cumulated_energy"), over=("number_of_heliostats",), lines=lines, derive=_ranked,
               interactive=False),
        Curves("power", "Power of the field at each instant, in universal time",
               ("field_power", "dni", *(f"field_instantaneous_{name}" for name in _EFFICIENCIES), "sun_elevation"),
               over=("time",) if "time" in result.coords else ("none",), lines=lines, image=False),
        Curves("duration_curves", "Hours in which the irradiance and the power are at least as high as the curve",
               ("dni_reached", "power_reached"), over=("duration",), lines=lines, derive=_durations,
               interactive=False),
        Curves("efficiency_over_time", "Mean efficiency of the heliostats at each instant",
               [name for name in series if result[name].size <= 4_000_000], over=("time",), lines=lines,
               reduce={HELIOSTAT: "mean"}, image=result.sizes.get("time", 0) <= 400),
        Curves("angles", "Angles of the axes", _ANGLES, over=("time",), image=False),
        *(Maps(f"{axis}_motion_maps", f"Range of motion of the {axis} axis of every heliostat over the period",
               (*(f"{axis}_angle_{of}" for of in ("range", "rate", "travel")), f"{axis}_angle"), panels=places,
               lines=lines)
          for axis in ("primary", "secondary")),
        Special("mirror_outlines",
                "Mirror with the largest shadows and blocked parts, seen from the front; numbers are the heliostats "
                "that shade or block",
                ("outline_u", "outline_v", "outline_heliostat", "shading_efficiency", "blocking_efficiency"),
                draw=_outlines),
        *(Rasters(f"{name}s", words, (name,), over=_FLUX, panels=("aim_levels", *places),
                  notes="Mean over each cell. A cylinder is unrolled by the azimuth of its surface, clockwise from "
                  "north.")
          for name, words in (("flux_map", "Flux on the receiver"), ("energy_flux_map", "Energy on the receiver"))),
    ]  # fmt: skip


def _losses(result: xr.Dataset) -> Any:
    """Draw a waterfall chart of the energy for each point of the sweep."""
    from heliosweep.report.context import fold
    from heliosweep.report.draw import label_outside, panels
    from heliosweep.report.figures import COLOURS

    context, received = Context(result), result["field_receiver_energy"]
    dims = [dim for dim in received.dims if received.sizes[dim] > 1]
    dim = str(next((one for one in (*_PLACES, *dims) if one in dims), ""))
    other = "tracking" if "tracking" in dims and dim != "tracking" else None
    fixed = context.fixed(received, dim, other)
    points = [{**p, **q} for p in context.chosen(dim, 4 if not other else 2) for q in context.chosen(other, 2)]
    happens = (result["loss"] != 0).any([one for one in result["loss"].dims if one != "stage"]).to_numpy()
    stages = [STAGES.get(stage, stage).replace("_", " ") for stage in result["stage"].to_numpy()[happens]]
    heat = "field_heat" in result
    steps = ["incident", *stages, "heat" if heat else arrival(result)]
    colours = ["#b0b0b0", *[COLOURS[1]] * len(stages), COLOURS[0]]
    drawing, grid = panels(len(points), 2, 0.06 * len(steps), wide=True, sharex=True, sharey=True)
    for axes, point in zip(grid, points, strict=True):
        lost = at(result["loss"], fixed, point).to_numpy()[happens]
        whole = float(at(result["field_incident_energy"], fixed, point))
        rest = float(at(result["field_heat" if heat else "field_receiver_energy"], fixed, point))
        _waterfall(axes, whole, lost, rest, colours)
        axes.set(title=fold(context.fulls(point), 55), yticks=range(len(steps)), yticklabels=steps)
        axes.set_xlabel("energy (MWh)")
        axes.grid(True, axis="x")
    grid[0].set_ylim(len(steps) - 0.5, -0.5)
    label_outside(grid, 2)
    return drawing, context.note(fixed)


def _costs(result: xr.Dataset) -> Any:
    """Draw the capital cost by item as stacked bars for some points of the sweep."""
    from heliosweep.report.draw import legend, panels
    from heliosweep.report.figures import COLOURS

    context, cost = Context(result), result["capital_cost"]
    dims = [*(str(dim) for dim in cost.dims if dim != "item" and cost.sizes[dim] > 1), None, None][:2]
    fixed = context.fixed(cost, "item", *dims)
    points = [{**p, **q} for p in context.chosen(dims[0], 4) for q in context.chosen(dims[1], 3)]
    drawing, (axes,) = panels(1, 1, 0.1 + 0.05 * len(points), wide=True)
    left, bars, names = np.zeros(len(points)), {}, result["item"].to_numpy()
    for row, (name, colour) in enumerate(zip(names, [*COLOURS, "#b0b0b0", "#707070"] * 2, strict=False)):
        amounts = np.array([float(at(cost, fixed, point)[row]) for point in points]) * 1e-6
        if amounts.any():
            bars[str(name).replace("_", " ")] = axes.barh(range(len(points)), amounts, left=left, color=colour)
            left = left + amounts
    words = [context.fulls(point) or "field, tower and receiver" for point in points]
    axes.set(yticks=range(len(points)), yticklabels=words, ylim=(len(points) - 0.5, -0.5),
             xlabel=f"million {cost.attrs['long_name'].split()[-1]}")  # fmt: skip
    axes.grid(True, axis="x")
    legend(drawing, bars)
    return drawing, context.note(fixed)


def _waterfall(axes: Any, whole: float, lost: Any, rest: float, colours: list[str]) -> None:
    """Draw bars for the total energy, each loss and the remaining energy, labelled with amounts and percentages."""
    lengths, starts = np.array([whole, *lost, rest]), np.array([0.0, *(whole - np.cumsum(lost)), 0.0])
    last, gap = len(lengths) - 1, 0.02 * whole
    axes.barh(range(len(lengths)), lengths, left=starts, color=colours, height=0.72)
    for row, (length, start) in enumerate(zip(lengths, starts, strict=True)):
        share = 100 * length / whole if whole else np.nan
        amount = f"{length:,.0f}" if abs(length) >= 1000 else f"{length:.3g}"
        inside = row in (0, last)
        left = inside or start < 0.4 * whole
        axes.text(
            gap if inside else start + length + gap if left else start - gap, row,
            f"{amount} ({share:.{2 if 0 < share < 0.1 else 1}f} %)", ha="left" if left else "right", va="center",
            fontsize=7, color="white" if row == last else "black",
        )  # fmt: skip


def _ranked(result: xr.Dataset) -> xr.Dataset:
    """Return the heliostat energies sorted by rank, with the cumulative share of the field's energy."""
    names = ("energy_per_mirror_area", "receiver_energy")
    if not set(names) <= set(result.data_vars) or result.sizes[HELIOSTAT] < FIELD:
        return result
    dim = "number_of_heliostats"
    per_area, energy = (result[name].fillna(0.0).rename({HELIOSTAT: dim}) for name in names)
    order = (-per_area).argsort(axis=per_area.get_axis_num(dim))
    per_area, energy = (one.drop_vars([dim], errors="ignore").isel({dim: order}) for one in (per_area, energy))
    share = (energy.cumsum(dim) / energy.sum(dim)).where(per_area > 0)
    number = {dim: (dim, np.arange(1, per_area.sizes[dim] + 1), {"long_name": "rank of the heliostat"})}
    keep = [name for name in per_area.coords if name == dim or dim in per_area[name].dims]
    attrs = {"units": "1", "valid_range": [0.0, 1.0], "long_name": "share of the energy of the field"}
    energies = {"units": "MWh m-2", "long_name": "energy per mirror area"}
    return result.assign(
        ranked_energy=per_area.where(per_area > 0).drop_vars(keep).assign_coords(number).assign_attrs(energies),
        cumulated_energy=share.drop_vars(keep, errors="ignore").assign_coords(number).assign_attrs(attrs),
    )


def _durations(result: xr.Dataset) -> xr.Dataset:
    """Return duration curves: irradiance and power in descending order against cumulative hours."""
    if not {"dni", "field_power", "hours_used", "hours_lost"} <= set(result.data_vars):
        return result
    instants = int((result["dni"] > 0).sum("time").max())
    hours = float((result["hours_used"] + result["hours_lost"].sum("cause")).max())
    lit = max(int(result["sun_elevation"].notnull().sum("time").max()) if "sun_elevation" in result else instants, 1)
    duration = ("duration", hours / lit * np.arange(1, instants + 1), {"units": "h", "long_name": "duration"})

    def ordered(name: str, words: str) -> xr.DataArray:
        values = result[name].fillna(0.0).transpose(..., "time")
        descending = -np.sort(-values.to_numpy(), axis=-1)[..., :instants]
        dims = [*values.dims[:-1], "duration"]
        return xr.DataArray(descending, {"duration": duration}, dims, attrs={**values.attrs, "long_name": words})

    dni, power = ordered("dni", "direct normal irradiance"), ordered("field_power", "power of the field")
    return result.assign(dni_reached=dni, power_reached=power)


def _outlines(result: xr.Dataset) -> Any:
    """Draw the shaded and blocked areas on the mirror with the largest loss, for some points of the sweep."""
    from matplotlib.patches import Patch, Polygon, Rectangle
    from matplotlib.patheffects import withStroke

    from heliosweep.report.context import fold
    from heliosweep.report.draw import legend, panels
    from heliosweep.report.figures import COLOURS

    context, shading = Context(result), result["shading_efficiency"]
    looks = {
        "shading": ("shadow", COLOURS[0], "", "shaded"),
        "blocking": ("blocked part", COLOURS[1], "///", "blocked"),
    }
    shown = [str(dim) for dim in shading.dims if dim != HELIOSTAT and result.sizes[dim] > 1][:2]
    fixed, dims = context.fixed(shading, HELIOSTAT, *shown), (*shown, None, None)
    points = [{**p, **q} for p in context.chosen(dims[0], 2) for q in context.chosen(dims[1], 2)]
    points = [point for point in points if bool(shading.isel({**fixed, **point}).notnull().any())]  # the sun is up
    if not points:
        return None
    drawing, grid = panels(len(points), 2, 0.9, layout="compressed", sharex=True, sharey=True)
    for axes, point in zip(grid, points, strict=True):
        field = result.isel({**fixed, **point})
        lost = 1 - field[["shading_efficiency", "blocking_efficiency"]].to_dataarray().to_numpy()
        worst = int(np.nanargmax(np.minimum(*lost) + 1e-3 * np.maximum(*lost)))
        one = field.isel({HELIOSTAT: worst}).load()
        a, b = (float(one[f"heliostat_{side}"]) / 2 for side in ("width", "height"))
        axes.add_patch(Rectangle((-a, -b), 2 * a, 2 * b, facecolor="#f2f2f2", edgecolor="black"))
        for effect, (_, colour, hatch, _) in looks.items():
            part = one.sel(effect=effect)
            shapes = np.stack([part[f"outline_{side}"].transpose("image", ...).to_numpy() for side in "uv"], axis=-1)
            for corners, number in zip(shapes, part["outline_heliostat"].to_numpy(), strict=True):
                corners = corners[np.isfinite(corners[:, 0])]
                if len(corners):
                    axes.add_patch(
                        Polygon(corners, facecolor=f"{colour}40", edgecolor=colour, hatch=hatch, linewidth=0.8)
                    )
                    u, v = map(float, corners.mean(axis=0))
                    axes.text(u, v, f"{number:.0f}", ha="center", va="center",
                              color=colour, path_effects=[withStroke(linewidth=2, foreground="white")])  # fmt: skip
        words = " and ".join(f"{100 * (1 - float(one[f'{name}_efficiency'])):.1f} % {look[3]}"
                            for name, look in looks.items())  # fmt: skip
        axes.set(title=f"{fold(context.fulls(point), 45)}\nheliostat {int(one[HELIOSTAT])}: {words}", aspect="equal",
                 xlim=(-1.06 * a, 1.06 * a), ylim=(-1.06 * b, 1.06 * b), xlabel="along the width (m)",
                 ylabel="along the height (m)")  # fmt: skip
    legend(drawing, {word: Patch(facecolor=f"{colour}40", edgecolor=colour, hatch=hatch)
                     for word, colour, hatch, _ in looks.values()})  # fmt: skip
    return drawing, context.note(fixed)

"""Figures of a field: energy losses, heliostat maps, and curves over swept keys."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.field_efficiency.optics import DIMS
from heliosweep.families.field_efficiency.variables import ANGLES, EFFICIENCIES, FACTORED, LIGHT, PRODUCT
from heliosweep.report.figures import FIELD, HELIOSTAT, Context, Curves, Figure, Maps, Rasters, Special, is_ordered
from heliosweep.report.tables import SOURCE, Table, numbers

_COST = ("levelized_cost_of_heat", "total_capital_cost", "field_heat", "design_point_heat")
_AIMS = ("aimed_power", "unlimited_power", "limit_loss", "aim_gap", "aimed_peak_flux", "unlimited_peak_flux",
         "stowed_heliostats")  # fmt: skip


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Yield tables of energies, the error budget, weather years and mean efficiencies."""
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
        note = (
            "Loss due to each cause alone. Interaction: loss due to all causes together minus the sum of these losses."
        )
        yield numbers(result, dims, parts, "Error budget", [note], digits=4)
    years = [_named(result, name) for name in map(str, result.data_vars) if name.endswith(("_p50", "_p90"))]
    if years:
        note = "P50 and P90: values that a weather year exceeds with probabilities of 50 % and 90 %."
        yield numbers(result, [str(dim) for dim in years[0].dims], years, "Weather years", [note], digits=4)
    order = dict.fromkeys(["total_efficiency", "optical_efficiency", *EFFICIENCIES, *LIGHT])
    names = [*(f"field_{name}" for name in order), FACTORED, *(f"field_design_point_{name}" for name in order)]
    means = [_named(result, name) for name in names if name in whole]
    notes = ["Factored: product of the mean cosine, shading and blocking efficiencies."]
    yield numbers(result, dims, means, "Mean efficiencies over the period", notes)


def first_headlines(result: xr.Dataset) -> tuple[str, ...]:
    """Return the headlines that a study with `keep` lists first.

    The first headline is the optimised quantity. `keep` maximises the energy per mirror area of a given number of
    heliostats, or minimises the number of heliostats for a required power.
    """
    keep = json.loads(result.attrs["study"]).get("keep")
    size, gain = ("field_heliostats", "field_mirror_area", "design_point_power"), "field_energy_per_mirror_area"
    return () if not keep else (gain, *size) if "heliostats" in keep else (*size, gain)


def figures_of_draws(result: xr.Dataset) -> list[Figure]:
    """Return the figures of a result with draws: the error budget."""
    return [budget_figure(result)]


def budget_columns(result: xr.Dataset) -> list[xr.DataArray]:
    """Return the columns of the budget table: the loss due to each part and the gain from removing each cause."""
    named = (("budget_loss", "budget_part", "{}"), ("budget_gain", "budget_cause", "gain without {}"))
    return [result[name].sel({dim: label}, drop=True).rename(words.format(label))
            for name, dim, words in named if name in result for label in result[dim].to_numpy()]  # fmt: skip


def budget_figure(result: xr.Dataset) -> Figure:
    """Declare the budget figure, which shows means if the result has draws."""
    mean = "_sample_mean" * ("budget_loss_sample_mean" in result)
    names = [f"budget_{name}{mean}" for name in ("loss", "gain", "energy", "stage_loss")]
    title = f"{'Mean e' if mean else 'E'}nergy lost to each cause, relative to the energy without the causes"
    return _special("error_budget", title, names)


def _special(name: str, title: str, variables: Sequence[str]) -> Special:
    """Declare a figure drawn by the function `name` in `drawing`."""

    def draw(result: xr.Dataset) -> Any:
        from heliosweep.families.field_efficiency import drawing

        return getattr(drawing, name)(result)

    return Special(name, title, variables, draw=draw)


def _named(result: xr.Dataset, name: str) -> xr.DataArray:
    words = name.removeprefix("field_").removesuffix("_efficiency").replace("_", " ")
    array = result[name].assign_attrs({SOURCE: name})
    if name in _COST[:2]:
        words += f" in {array.attrs['long_name'].rpartition(' in ')[2]}"  # the currency
    return array.rename({"heliostats": "number of heliostats"}.get(words, words))


def _sums(result: xr.Dataset) -> str:
    """Return a sentence with the number of daylight hours over which energies are summed."""
    daylight = (result["hours_used"] + result["hours_lost"].sum("cause")).to_numpy()
    low, high = float(daylight.min()), float(daylight.max())
    hours = f"{low:,.0f} h" if high - low < 0.5 else f"{low:,.0f} to {high:,.0f} h"
    year = 4250.0 < low <= high < 4900.0  # daylight of a full year, including partly lit intervals [h]
    return f"Sums over {hours} with the sun above the horizon, {'a full year' if year else 'not a full year'}."


_EFFICIENCIES = tuple(f"{name}_efficiency" for name in (
    "total", "optical", "cosine", "shading", "blocking", "attenuation", "intercept", "reflection"
))  # fmt: skip
_ENERGY = ("energy_per_mirror_area", "receiver_energy", "rank")
PLACES = ("latitude", "site", "layout")
#: Dimensions that are not swept keys and have their own figures.
_OWN = (HELIOSTAT, "time", "month", "stage", "cause", "item", *DIMS, "effect", "image", "corner")


def figures(result: xr.Dataset) -> list[Figure]:
    """Return the figures of a result, with the main figure first."""
    energy, context = _ENERGY[0] in result, Context(result)
    arrival = "on the receiver" if "total_efficiency" in result else "sent to the receiver"
    last = "the heat of the receiver" if "field_heat" in result else f"the energy {arrival}"
    means = "Energies are sums and efficiencies are means over the period." if energy else "Means over the period."
    title = "Energy and mean efficiency" if energy else "Mean efficiency"
    field = [f"field_{name}" for name in (*_ENERGY[:2], *_EFFICIENCIES)]
    others = ["design_point_power", "field_heliostats", "peak_flux", "mean_flux", "power_above_limit", "hours_used"]
    swept = [str(dim) for dim in result.sizes if dim not in _OWN and is_ordered(result, str(dim))]
    series = [f"instantaneous_{name}" for name in _EFFICIENCIES if f"instantaneous_{name}" in result]
    lines, places = ("tracking",), PLACES
    return [
        _special("energy_losses",
                f"Energy losses between the direct sunlight on all mirrors and {last}, in percent of the direct "
                "sunlight",
                ("loss", "field_incident_energy", "field_receiver_energy")),
        budget_figure(result),
        Maps("field_maps", "Energy and efficiency of each heliostat" if energy else "Efficiency of each heliostat",
             (*_ENERGY[:1], *_EFFICIENCIES, PRODUCT, *_ENERGY[1:], *(f"design_point_{name}" for name in _EFFICIENCIES)),
             panels=places, lines=lines, less="tracking", notes=means),
        *(Curves(f"cost_of_heat_over_{dim}", f"Cost of heat against the {context.title(dim)}", _COST, over=(dim,),
                 lines=[str(other) for other in result[_COST[0]].dims if other != dim])
          for dim in swept if _COST[0] in result),
        _special("aim_points", "Heliostat aim points, and flux under the limit",
                ("aim_x", "aim_y", "aim_z", "aimed_flux_map")),
        Rasters("flux_and_limit", "Flux on the receiver without and with the limit",
                ("unlimited_flux_map", "aimed_flux_map"), over=DIMS, panels=("flux_limit", *places)),
        Rasters("flux_price", "Power gained per unit increase of the flux limit in a cell", ("flux_price",), over=DIMS,
                panels=("flux_limit", *places)),
        Curves("power_over_limit", "Power on the receiver against the flux limit", ("power_bound", *_AIMS),
               over=("flux_limit",), lines=lines),
        _special("capital_cost", "Capital cost by item", ("capital_cost", "total_capital_cost")),
        *(Curves(f"efficiency_over_{dim}", f"{title} of the field against the {context.title(dim)}",
                 (*field, *others), over=(dim,), lines=lines, notes=f"{means} Field means are weighted by mirror area.")
          for dim in sorted(swept, key=lambda dim: dim != "latitude")),
        Maps("factor_maps", "Mean efficiencies of each heliostat by factor",
             _EFFICIENCIES[2:7] if "total_efficiency" in result else (), each=True, at={"latitude": 0.0},
             interactive=False),
        Curves("monthly_energy", "Field energy by month", ("monthly_receiver_energy", "monthly_incident_energy"),
               over=("month",), lines=lines,
               notes="Incident: direct sunlight on all mirrors with the sun above the horizon."),
        Curves("energy_by_rank",
               f"Heliostats in descending order of energy {arrival} per mirror area",
               ("ranked_energy", "cumulated_energy"), over=("number_of_heliostats",), lines=lines, derive=_ranked,
               interactive=False),
        Curves("power", "Field power at each instant, in universal time",
               ("field_power", "dni", *(f"field_instantaneous_{name}" for name in _EFFICIENCIES), "sun_elevation"),
               over=("time",) if "time" in result.coords else ("none",), lines=lines, image=False),
        Curves("duration_curves", (
            "Number of hours during which the irradiance or the power is at least the value on the curve"
        ),
               ("dni_reached", "power_reached"), over=("duration",), lines=lines, derive=_durations,
               interactive=False),
        Curves("efficiency_over_time", "Mean efficiency of the heliostats at each instant",
               [name for name in series if result[name].size <= 4_000_000], over=("time",), lines=lines,
               reduce={HELIOSTAT: "mean"}, image=result.sizes.get("time", 0) <= 400),
        Curves("angles", "Angles of the axes", ANGLES, over=("time",), image=False),
        *(Maps(f"{axis}_motion_maps", f"Range of motion of each heliostat's {axis} axis over the period",
               (*(f"{axis}_angle_{of}" for of in ("range", "rate", "travel")), f"{axis}_angle"), panels=places,
               lines=lines)
          for axis in ("primary", "secondary")),
        _special("mirror_outlines",
                "Mirror with the largest shadows and blocked parts, seen from the front; numbers identify the "
                "heliostats that shade or block it",
                ("outline_u", "outline_v", "outline_heliostat", "shading_efficiency", "blocking_efficiency")),
        *(Rasters(f"{name}s", words, (name,), over=DIMS, panels=("aim_levels", *places),
                  notes="Mean over each cell. A cylinder is unrolled by the azimuth of its surface, clockwise from "
                  "north.")
          for name, words in (("flux_map", "Flux on the receiver"), ("energy_flux_map", "Energy on the receiver"))),
    ]  # fmt: skip


def _ranked(result: xr.Dataset) -> xr.Dataset:
    """Add heliostat energies in rank order, and their cumulative share of the field energy, to a result."""
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
    attrs = {"units": "1", "valid_range": [0.0, 1.0], "long_name": "fraction of the field's energy"}
    energies = {"units": "MWh m-2", "long_name": "energy per mirror area"}
    return result.assign(
        ranked_energy=per_area.where(per_area > 0).drop_vars(keep).assign_coords(number).assign_attrs(energies),
        cumulated_energy=share.drop_vars(keep, errors="ignore").assign_coords(number).assign_attrs(attrs),
    )


def _durations(result: xr.Dataset) -> xr.Dataset:
    """Add duration curves of irradiance and power to a result: values in descending order against hours."""
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

    dni, power = ordered("dni", "direct normal irradiance"), ordered("field_power", "field power")
    return result.assign(dni_reached=dni, power_reached=power)

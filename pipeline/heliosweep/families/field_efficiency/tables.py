"""Tables of a finished result: the energy of a field, where it is lost, its design point, and means over the period."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from heliosweep.families.field_efficiency.variables import EFFICIENCIES, FACTORED, LIGHT
from heliosweep.report.contents import Table
from heliosweep.report.sections import numbers

#: Hours of a year with the sun above the horizon: half of all, and more with the whole of partly lit intervals. [h]
DAYLIGHT = 4250.0, 4900.0

#: Stages at which energy is lost, where their names say too little.
STAGES = {"stow": "stow (limits)"}
_SWEPT = "field_optical_efficiency"
_FACTORED = "Factored: product of the means of cosine, shading and blocking efficiency."


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Answers first: energy, efficiency, power, size; then losses, the design point and the means over the period."""
    if not {"field_receiver_energy", "design_point_power"} & set(result.data_vars):
        return
    dims = [str(dim) for dim in result[_SWEPT].dims]

    def named(name: str, words: str) -> xr.DataArray:
        return result[name].rename(words)

    sizes = [("field_mirror_area", "mirror area"), ("field_heliostats", "heliostats")]
    power = [("design_point_power", "power at the design point")]
    if "field_receiver_energy" in result:
        incident, received = result["field_incident_energy"], result["field_receiver_energy"]
        first = [named("field_receiver_energy", f"energy {arrival(result)}"), _part(received, incident, "efficiency")]
        rest = [
            *power,
            *sizes,
            ("field_energy_per_mirror_area", "energy per mirror area"),
            ("hours_used", "hours used"),
        ]
        first += [named(name, words) for name, words in rest if name in result]
        yield numbers(result, dims, first, "Energy of the field", [_sums(result)], digits=4)
        stages = [
            (result["loss"].isel(stage=index), str(name)) for index, name in enumerate(result["stage"].to_numpy())
        ]
        parts = [_part(lost, incident, STAGES.get(name, name)) for lost, name in stages]
        shares = [named("field_incident_energy", "incident energy"), *parts]
        yield numbers(result, dims, shares, "Losses by stage, in percent of the incident energy")
    order = [f"{name}_efficiency" for name in ("total", "optical")]
    order += [name for name in (*EFFICIENCIES, *LIGHT) if name not in order]
    if "design_point_power" in result:
        known = [(name, name.replace("_", " ")) for name in ("peak_flux", "mean_flux")]
        known += [(f"field_design_point_{name}", name.removesuffix("_efficiency")) for name in order]
        told = () if "field_receiver_energy" in result else sizes
        arrays = [named(*one) for one in ((power[0][0], "power"), *told, *known) if one[0] in result]
        yield numbers(
            result,
            dims,
            [one for one in arrays if set(one.dims) == set(dims)],
            "Power and efficiencies of the field at the design point",
        )
    means = [named(f"field_{name}", name.removesuffix("_efficiency")) for name in order if name in result]
    means.append(named(FACTORED, "factored"))
    yield numbers(result, dims, means, "Mean efficiencies of the field over the period", [_FACTORED])


def _part(part: xr.DataArray, whole: xr.DataArray, name: str) -> xr.DataArray:
    """Part of a whole, to be printed in percent."""
    found = part / whole.where(whole != 0)
    return found.assign_attrs(units="1", valid_range=[0.0, 1.0]).rename(name)


def _sums(result: xr.Dataset) -> str:
    """Sentence on what energies are sums of."""
    daylight = (result["hours_used"] + result["hours_lost"].sum("cause")).to_numpy()
    low, high = float(daylight.min()), float(daylight.max())
    hours = f"{low:,.0f} h" if high - low < 0.5 else f"{low:,.0f} to {high:,.0f} h"
    year = DAYLIGHT[0] < low <= high < DAYLIGHT[1]
    said = (
        f"the {hours} of a year with the sun above the horizon" if year else f"{hours} with the sun above the horizon"
    )
    return (
        f"Sums over {said}{'' if year else ', which are not those of a year'}. Efficiency: this energy over "
        "that of the direct sunlight on the mirrors in all these hours."
    )


def arrival(result: xr.Dataset) -> str:
    """Where the energy of a field arrives, in words."""
    return "on the receiver" if "total_efficiency" in result else "sent to the receiver"

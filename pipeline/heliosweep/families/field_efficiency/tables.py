"""Tables of a field: energy, losses, design point, and means over the period."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from heliosweep.families.field_efficiency.variables import EFFICIENCIES, FACTORED, LIGHT
from heliosweep.report.tables import SOURCE, Table, numbers

#: Hours of a year with the sun above the horizon: half of all, and more with partly lit intervals. [h]
DAYLIGHT = 4250.0, 4900.0
#: Names of stages in tables and figures, if they differ.
STAGES = {"stow": "stow (limits)"}
_SIZE = ("field_heliostats", "field_mirror_area", "field_land_area", "field_packing_factor")


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Yield one table of energies and power, and one of efficiencies and losses."""
    dims = [str(dim) for dim in result["field_optical_efficiency"].dims]
    whole = {str(name) for name, array in result.data_vars.items() if set(array.dims) == set(dims)}
    names = ["field_receiver_energy", "field_energy_per_mirror_area", "field_incident_energy", "hours_used",
             "design_point_power", "peak_flux", "mean_flux", "power_above_limit", *_SIZE]  # fmt: skip
    columns = [_named(result, name) for name in names if name in whole]
    if "hours_lost" in result:
        causes = zip(result["cause"].to_numpy(), result["hours_lost"].transpose("cause", *dims), strict=True)
        columns += [lost.rename(f"hours lost to {cause}") for cause, lost in causes if bool((lost > 0).any())]
    energy = "field_receiver_energy" in result
    if columns:
        yield numbers(result, dims, columns, "Energy, power and size", [_sums(result)] if energy else [], digits=4)
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
    """Return a sentence about the hours that energies are summed over."""
    daylight = (result["hours_used"] + result["hours_lost"].sum("cause")).to_numpy()
    low, high = float(daylight.min()), float(daylight.max())
    hours = f"{low:,.0f} h" if high - low < 0.5 else f"{low:,.0f} to {high:,.0f} h"
    year = DAYLIGHT[0] < low <= high < DAYLIGHT[1]
    return f"Sums over {hours} with the sun above the horizon, {'a full year' if year else 'less or more than a year'}."


def arrival(result: xr.Dataset) -> str:
    """Return the end of the energy's way, in words."""
    return "on the receiver" if "total_efficiency" in result else "sent to the receiver"

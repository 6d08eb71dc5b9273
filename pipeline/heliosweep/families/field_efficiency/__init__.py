"""Optical efficiency of a heliostat field over a period, with exact cosine, shading and blocking losses.

The efficiencies are defined as in Chong and Tan (2012), doi 10.1155/2012/908364.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from heliosweep.families.family import Family
from heliosweep.lazy import xr

if TYPE_CHECKING:
    from heliosweep.report.figures import Figure


class FieldEfficiency(Family):
    """Study family for the optical efficiency of heliostat fields."""

    def of_result(self, result: xr.Dataset) -> Family:
        """Return the family with headlines chosen for a result.

        If the study has `keep`, the number of heliostats, the mirror area and the design-point power come first.
        """
        keep = json.loads(result.attrs["study"]).get("keep")
        if not keep:
            return self
        cut, size = object.__new__(type(self)), ("field_heliostats", "field_mirror_area", "design_point_power")
        vars(cut).update(vars(self))  # copy.copy would return the registered family itself
        # `keep` minimises the number of heliostats for a required power, or maximises the energy of a given number of
        # heliostats.
        gain = ("field_energy_per_mirror_area", *self.headlines)
        cut.headlines = (*size, *gain) if "heliostats" not in keep else (*gain[:1], *size, *gain[1:])
        return cut

    def figures_of_draws(self, result: xr.Dataset) -> Iterable[Figure]:
        """Return the error budget figure if the result has an error budget."""
        from heliosweep.families.field_efficiency.figures import budget_figure

        return [budget_figure(result)] if "budget_loss_sample_mean" in result else []


FAMILY = FieldEfficiency(
    "field_efficiency",
    "cosine, shading, blocking and optical efficiency of a heliostat field",
    f"{__name__}.study:FieldEfficiencyStudy",
    f"{__name__}.compute:computation",
    example=Path(__file__).with_name("default.yaml"),
    references=("Chong and Tan (2012), International Journal of Photoenergy, doi 10.1155/2012/908364",),
    keywords=("heliostat field", "optical efficiency", "shading", "blocking"),
    headlines=(
        "levelized_cost_of_heat",
        "field_heat",
        "field_heat_p50",
        "field_heat_p90",
        "field_receiver_energy",
        "field_receiver_energy_p50",
        "field_receiver_energy_p90",
        "aimed_power",
        "limit_loss",
        "field_total_efficiency",
        "field_optical_efficiency",
        "design_point_power",
        "field_heliostats",
        "field_mirror_area",
    ),
    optional={
        **dict.fromkeys(("peak_flux", "mean_flux"), "output.flux_map"),
        "power_above_limit": "output.flux_map.limit",
        **dict.fromkeys(("field_receiver_energy", "field_incident_energy", "hours_used"), "weather"),
        **dict.fromkeys(("field_total_efficiency", "field_intercept_efficiency"), "optics"),
        "design_point_power": "design_point",
        **dict.fromkeys(("aimed_power", "limit_loss"), "aim.limit"),
        **dict.fromkeys(("field_heat", "design_point_heat"), "receiver.absorptance"),
        **dict.fromkeys(("total_capital_cost", "levelized_cost_of_heat"), "economics"),
    },
    figures=f"{__name__}.figures:figures",
    tables=f"{__name__}.figures:tables",
    remarks=f"{__name__}.compute:remarks",
)

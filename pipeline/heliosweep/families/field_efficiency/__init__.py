"""Optical efficiency of a heliostat field over a period, with exact cosine, shading and blocking losses.

The efficiencies are defined as in Chong and Tan (2012), doi 10.1155/2012/908364.
"""

from __future__ import annotations

from pathlib import Path

from heliosweep.families.family import Family

FAMILY = Family(
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
    first_headlines=f"{__name__}.figures:first_headlines",
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
    figures_of_draws=f"{__name__}.figures:figures_of_draws",
    remarks=f"{__name__}.compute:remarks",
)

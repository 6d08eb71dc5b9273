"""Optical efficiency of a heliostat field over a period: cosine, shading and blocking, exactly.

After Chong and Tan (2012), doi 10.1155/2012/908364.
"""

from __future__ import annotations

import json
from types import MappingProxyType
from typing import TYPE_CHECKING

from heliosweep.families.modules import ModuleFamily

if TYPE_CHECKING:
    import xarray as xr


class FieldEfficiency(ModuleFamily):
    """The family; see `heliosweep.families.family.Family`."""

    name = "field_efficiency"
    title = "cosine, shading, blocking and optical efficiency of a heliostat field"
    references = ("Chong and Tan (2012), International Journal of Photoenergy, doi 10.1155/2012/908364",)
    keywords = ("heliostat field", "optical efficiency", "shading", "blocking")
    headlines: tuple[str, ...] = (
        "field_receiver_energy",
        "field_total_efficiency",
        "field_optical_efficiency",
        "design_point_power",
        "field_heliostats",
        "field_mirror_area",
    )
    optional = MappingProxyType(
        {
            **dict.fromkeys(("peak_flux", "mean_flux"), "output.flux_map"),
            "power_above_limit": "output.flux_map.limit",
            **dict.fromkeys(("field_receiver_energy", "field_incident_energy", "hours_used"), "weather"),
            **dict.fromkeys(("field_total_efficiency", "field_intercept_efficiency"), "optics"),
            "design_point_power": "design_point",
        }
    )

    def of_result(self, result: xr.Dataset) -> ModuleFamily:
        """Return the family; of a field that is cut, with the number of heliostats, mirror area and power first."""
        keep = json.loads(result.attrs["study"]).get("keep")
        if not keep:
            return self
        cut, size = FieldEfficiency(), ("field_heliostats", "field_mirror_area", "design_point_power")
        # The fewest heliostats that have a power are sought, or the most energy of a given number.
        gain = ("field_energy_per_mirror_area", *self.headlines)
        cut.headlines = (*size, *gain) if "field_power" in keep else (*gain[:1], *size, *gain[1:])
        return cut


FAMILY = FieldEfficiency()

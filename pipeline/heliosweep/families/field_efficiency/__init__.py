"""Optical efficiency of a heliostat field over a period: cosine, shading and blocking, exactly.

After Chong and Tan (2012), doi 10.1155/2012/908364.
"""

from __future__ import annotations

from heliosweep.families.family import Family


class FieldEfficiency(Family):
    """The family; see `heliosweep.families.family.Family`."""

    name = "field_efficiency"
    title = "cosine, shading, blocking and optical efficiency of a heliostat field"
    references = ("Chong and Tan (2012), International Journal of Photoenergy, doi 10.1155/2012/908364",)
    keywords = ("heliostat field", "optical efficiency", "shading", "blocking")
    headlines = ("field_receiver_energy", "field_total_efficiency", "field_optical_efficiency")


FAMILY = FieldEfficiency()

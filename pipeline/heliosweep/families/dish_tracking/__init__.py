"""Effective tracking factor of a dish whose mount has errors.

After Liu, Peng and Yan (2022), doi 10.3390/en15093261.
"""

from __future__ import annotations

from heliosweep.families.modules import ModuleFamily


class DishTracking(ModuleFamily):
    """The family; see `heliosweep.families.family.Family`."""

    name = "dish_tracking"
    title = "effective tracking factor of a solar dish whose azimuth axis is tilted"
    references = ("Liu, Peng and Yan (2022), Energies 15, 3261, doi 10.3390/en15093261",)
    keywords = ("solar dish", "tracking error")
    headlines = (
        "tolerable_axis_tilt",
        "effective_tracking_factor_mean_over_dates",
        "effective_tracking_factor_min",
    )


FAMILY = DishTracking()

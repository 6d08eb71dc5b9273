"""Effective tracking factor of a dish with mount errors.

The model follows Liu, Peng and Yan (2022), doi 10.3390/en15093261.
"""

from pathlib import Path

from heliosweep.families.family import Family

FAMILY = Family(
    "dish_tracking",
    "effective tracking factor of a solar dish whose azimuth axis is tilted",
    f"{__name__}.study:DishTrackingStudy",
    f"{__name__}.compute:computation",
    example=Path(__file__).with_name("default.yaml"),
    references=("Liu, Peng and Yan (2022), Energies 15, 3261, doi 10.3390/en15093261",),
    keywords=("solar dish", "tracking error"),
    headlines=("tolerable_axis_tilt", "effective_tracking_factor_mean_over_dates", "effective_tracking_factor_min"),
    figures=f"{__name__}.figures:figures",
    remarks=f"{__name__}.compute:remarks",
)

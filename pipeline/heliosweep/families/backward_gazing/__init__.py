"""Mirror slopes from four camera images of the reflected sun, for simulated heliostats, fields and measurements.

The method follows P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field
in a concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270.
"""

from __future__ import annotations

from pathlib import Path

from heliosweep.families.family import Family

FAMILY = Family(
    "backward_gazing",
    "mirror slopes from four camera images of the reflected sun",
    f"{__name__}.study:BackwardGazingStudy",
    f"{__name__}.compute:computation",
    example=Path(__file__).with_name("default.yaml"),
    references=("Defieux, Caliot and Henault (2020), AIP Conf. Proc. 2303, 100002, doi 10.1063/5.0029270",),
    keywords=("heliostat", "slope error", "canting", "backward gazing"),
    headlines=("relative_error_x_median", "slope_rms_x", "canting_x"),
    figures=f"{__name__}.figures:figures",
    remarks=f"{__name__}.compute:remarks",
)

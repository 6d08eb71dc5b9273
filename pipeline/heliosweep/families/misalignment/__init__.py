"""Beams of misaligned heliostats, tolerances to misalignment, and calibration from spots on the receiver.

The models follow "Evaluation and measurement of heliostat misalignment in solar power plant using vector model", Optics
Express 27 (8), A257 (2019).
"""

from pathlib import Path

from heliosweep.families.family import Family

FAMILY = Family(
    "misalignment",
    "deviation curves, tolerances and calibration of misaligned heliostats",
    f"{__name__}.study:MisalignmentStudy",
    f"{__name__}.spots:computation",
    example=Path(__file__).with_name("default.yaml"),
    references=(
        "Evaluation and measurement of heliostat misalignment in solar power plant using vector model, Optics Express "
        "27 (8), A257 (2019)",
    ),
    keywords=("heliostat", "tracking error", "calibration"),
    headlines=(
        "minimum_tolerance",
        "day_hit_fraction",
        "hit_fraction",
        "held_out_residual_rms",
        "beam_residual_rms",
        "residual_rms",
        "tracking_tolerance",
    ),
    figures=f"{__name__}.report:figures",
    tables=f"{__name__}.report:tables",
    remarks=f"{__name__}.report:remarks",
)

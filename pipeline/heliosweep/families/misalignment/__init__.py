"""Beams of misaligned heliostats, the misalignment that a receiver tolerates, and calibration from spots.

After "Evaluation and measurement of heliostat misalignment in solar power plant using vector model", Optics Express
27 (8), A257 (2019).
"""

from __future__ import annotations

from typing import Any

from heliosweep.families.modules import ModuleFamily


class Misalignment(ModuleFamily):
    """The family; see `heliosweep.families.family.Family`."""

    name = "misalignment"
    title = "deviation curves, tolerances and calibration of misaligned heliostats"
    references = (
        "Evaluation and measurement of heliostat misalignment in solar power plant using vector model, Optics Express "
        "27 (8), A257 (2019)",
    )
    keywords = ("heliostat", "tracking error", "calibration")
    headlines = (
        "least_tolerance",
        "day_hit_fraction",
        "hit_fraction",
        "beam_residual_rms",
        "residual_rms",
        "tracking_tolerance",
    )

    def room(self, mode: str) -> str:
        """Package of a mode: ``curves``, ``mount_errors``, ``calibration`` or ``detectors``."""
        return f"{__name__}.{mode}"

    def mode(self, study: Any) -> str:
        """Mode of a study."""
        return str(study.mode)


FAMILY = Misalignment()

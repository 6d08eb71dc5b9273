"""Where misaligned heliostats send their beams, how much misalignment a receiver tolerates, and calibration from spots.

After "Evaluation and measurement of heliostat misalignment in solar power plant using vector model", Optics Express
27 (8), A257 (2019).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.misalignment.config import MisalignmentStudy
    from heliosweep.families.registry import NamedFigure, Table
    from heliosweep.grid.plan import Workload
    from heliosweep.report.views import View


class Misalignment:
    """The family, for the registry; see `heliosweep.families.registry.Family`."""

    name = "misalignment"
    title = "deviation curves, tolerances and calibration of misaligned heliostats"
    references = (
        "Evaluation and measurement of heliostat misalignment in solar power plant using vector model, Optics Express "
        "27 (8), A257 (2019)",
    )
    keywords = ("heliostat", "tracking error", "calibration")
    headlines = ("least_tolerance", "day_hit_fraction", "hit_fraction", "residual_rms", "tolerance")

    def study_class(self) -> type[MisalignmentStudy]:
        """Pydantic model of the study file."""
        from heliosweep.families.misalignment.config import MisalignmentStudy

        return MisalignmentStudy

    def example(self) -> str:
        """Commented study file to start from."""
        return resources.files(__name__).joinpath("default.yaml").read_text(encoding="utf-8")

    def workload(self, study: MisalignmentStudy) -> Workload:
        """Sizes and cost, for the plan."""
        from heliosweep.families.misalignment import model

        return model.workload(study)

    def prepare(self, study: MisalignmentStudy) -> tuple[float, bool]:
        """Load or compile the kernels of the study's mode; seconds it took, and whether something was compiled."""
        from heliosweep.kernels import warm

        if study.mode == "curves":
            return warm.warm_curves(study.detectors is not None)
        if study.mode == "mount_errors":
            from heliosweep.families.misalignment.mount_errors import is_drawn

            return warm.warm_mount_errors(is_drawn(study))
        return warm.warm_calibration()

    def build(self, study: MisalignmentStudy, chunks: Mapping[str, int], select: Mapping[str, slice]) -> xr.Dataset:
        """Lazy result over a part of the parameter grid."""
        from heliosweep.families.misalignment import model

        return model.build(study, chunks, select)

    def coordinates(self, study: MisalignmentStudy) -> xr.Dataset:
        """Coordinates of the whole result, in memory."""
        from heliosweep.families.misalignment import model

        return model.coordinates(study)

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """Heliostats and rays without spots, and why; in calibrations what the spots cannot tell."""
        from heliosweep.families.misalignment import model

        return model.remarks(result)

    def figures(self, result: xr.Dataset) -> Iterable[NamedFigure]:
        """Curves, drifts, tolerances, statistics or calibrations, by the mode."""
        from heliosweep.families.misalignment import report

        return report.figures(result)

    def tables(self, result: xr.Dataset) -> Iterable[Table]:
        """Errors that a calibration found, and how often drawn mounts hit."""
        from heliosweep.families.misalignment import report_tables

        return report_tables.tables(result)

    def views(self, result: xr.Dataset) -> Iterable[View]:
        """Maps, spots and curves that a reader may turn and switch."""
        from heliosweep.families.misalignment import interactive

        return interactive.views(result)


FAMILY = Misalignment()

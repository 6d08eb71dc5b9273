"""Slopes of mirrors from four camera images of the reflected sun: simulated, of whole fields, and measured.

After P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.backward_gazing.config import BackwardGazingStudy
    from heliosweep.families.registry import NamedFigure
    from heliosweep.grid.plan import Workload
    from heliosweep.report.views import View


class BackwardGazing:
    """The family, for the registry; see `heliosweep.families.registry.Family`."""

    name = "backward_gazing"
    title = "slopes of mirrors from four camera images of the reflected sun"
    references = ("Defieux, Caliot and Henault (2020), AIP Conf. Proc. 2303, 100002, doi 10.1063/5.0029270",)
    keywords = ("heliostat", "slope error", "canting", "backward gazing")
    headlines = ("relative_error_x_median", "slope_rms_x", "canting_x")

    def study_class(self) -> type[BackwardGazingStudy]:
        """Pydantic model of the study file."""
        from heliosweep.families.backward_gazing.config import BackwardGazingStudy

        return BackwardGazingStudy

    def example(self) -> str:
        """Commented study file to start from."""
        return resources.files(__name__).joinpath("default.yaml").read_text(encoding="utf-8")

    def workload(self, study: BackwardGazingStudy) -> Workload:
        """Sizes and cost, for the plan."""
        from heliosweep.families.backward_gazing import model

        return model.workload(study)

    def prepare(self, study: BackwardGazingStudy) -> tuple[float, bool]:
        """Load or compile the kernels of the study's methods; seconds it took, and whether something was compiled."""
        from heliosweep.kernels.warm import warm_gazing

        level = study.cameras.images
        levels = (level,) if isinstance(level, str) else level.values()
        return warm_gazing(study.method, cameras=study.mode == "measured" or "camera" in levels)

    def build(self, study: BackwardGazingStudy, chunks: Mapping[str, int], select: Mapping[str, slice]) -> xr.Dataset:
        """Lazy result over a part of the parameter grid."""
        from heliosweep.families.backward_gazing import model

        return model.build(study, chunks, select)

    def coordinates(self, study: BackwardGazingStudy) -> xr.Dataset:
        """Coordinates of the whole result, in memory."""
        from heliosweep.families.backward_gazing import model

        return model.coordinates(study)

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """Heliostats that no camera sees, modules without slopes, and what else the user should know."""
        from heliosweep.families.backward_gazing import model

        return model.remarks(result)

    def figures(self, result: xr.Dataset) -> Iterable[NamedFigure]:
        """Images, maps of slopes, errors of the methods, or a map of the field."""
        from heliosweep.families.backward_gazing import report

        return report.figures(result)

    def views(self, result: xr.Dataset) -> Iterable[View]:
        """Slopes, maps and errors that a reader may turn and switch."""
        from heliosweep.families.backward_gazing import interactive

        return interactive.views(result)


FAMILY = BackwardGazing()

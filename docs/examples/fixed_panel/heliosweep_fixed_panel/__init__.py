"""Family `fixed_panel`: how squarely the sun meets a panel that does not move.

What the program asks of a family: see `heliosweep.families.registry.Family`. Each method imports what it needs when it
is called, so that listing and validating stay quick.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.registry import NamedFigure
    from heliosweep.grid.plan import Workload
    from heliosweep_fixed_panel.config import FixedPanelStudy


class FixedPanel:
    """The family, for the registry."""

    name = "fixed_panel"
    title = "mean cosine of the incidence on a panel that does not move"
    references = ("Duffie and Beckman (2013), Solar Engineering of Thermal Processes, section 1.6",)

    def study_class(self) -> type[FixedPanelStudy]:
        """Pydantic model of the study file."""
        from heliosweep_fixed_panel.config import FixedPanelStudy

        return FixedPanelStudy

    def example(self) -> str:
        """Commented study file to start from."""
        return resources.files(__name__).joinpath("default.yaml").read_text(encoding="utf-8")

    def workload(self, study: FixedPanelStudy) -> Workload:
        """Sizes and cost, for the plan."""
        from heliosweep_fixed_panel import model

        return model.workload(study)

    def prepare(self, study: FixedPanelStudy) -> tuple[float, bool]:
        """Compile kernels: there are none, NumPy is quick enough here."""
        return 0.0, False

    def build(self, study: FixedPanelStudy, chunks: Mapping[str, int], select: Mapping[str, slice]) -> xr.Dataset:
        """Lazy result over a part of the parameter grid."""
        from heliosweep_fixed_panel import model

        return model.build(study, chunks, select)

    def coordinates(self, study: FixedPanelStudy) -> xr.Dataset:
        """Coordinates of the whole result, in memory."""
        from heliosweep_fixed_panel import model

        return model.coordinates(study)

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """What the user should be told of a finished result."""
        if bool(result.mean_cosine.isnull().any()):
            yield "there are points without sun: their means are missing"

    def figures(self, result: xr.Dataset) -> Iterable[NamedFigure]:
        """Mean cosine against the tilt."""
        from heliosweep_fixed_panel import report

        return report.figures(result)


FAMILY = FixedPanel()

"""Annual optical efficiency of a heliostat field: cosine, shading and blocking, exactly.

After Chong and Tan (2012), doi 10.1155/2012/908364.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.field_efficiency.config import FieldEfficiencyStudy
    from heliosweep.families.registry import NamedFigure
    from heliosweep.grid.plan import Workload
    from heliosweep.report.views import View


class FieldEfficiency:
    """The family, for the registry; see `heliosweep.families.registry.Family`."""

    name = "field_efficiency"
    title = "annual cosine, shading, blocking and optical efficiency of a heliostat field"
    references = ("Chong and Tan (2012), International Journal of Photoenergy, doi 10.1155/2012/908364",)
    keywords = ("heliostat field", "optical efficiency", "shading", "blocking")
    headlines = ("field_optical_efficiency",)

    def study_class(self) -> type[FieldEfficiencyStudy]:
        """Pydantic model of the study file."""
        from heliosweep.families.field_efficiency.config import FieldEfficiencyStudy

        return FieldEfficiencyStudy

    def example(self) -> str:
        """Commented study file to start from."""
        return resources.files(__name__).joinpath("default.yaml").read_text(encoding="utf-8")

    def workload(self, study: FieldEfficiencyStudy) -> Workload:
        """Sizes and cost, for the plan."""
        from heliosweep.families.field_efficiency import model

        return model.workload(study)

    def prepare(self, study: FieldEfficiencyStudy) -> tuple[float, bool]:
        """Load or compile the kernels; seconds it took, and whether something was compiled."""
        from heliosweep.kernels.warm import warm_field

        return warm_field()

    def build(self, study: FieldEfficiencyStudy, chunks: Mapping[str, int], select: Mapping[str, slice]) -> xr.Dataset:
        """Lazy result over a part of the parameter grid."""
        from heliosweep.families.field_efficiency import model

        return model.build(study, chunks, select)

    def coordinates(self, study: FieldEfficiencyStudy) -> xr.Dataset:
        """Coordinates of the whole result, in memory."""
        from heliosweep.families.field_efficiency import model

        return model.coordinates(study)

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """Nothing: the checks of the study say which latitudes have no sun."""
        return ()

    def figures(self, result: xr.Dataset) -> Iterable[NamedFigure]:
        """Field maps, efficiency against latitude and what else the sweep shows."""
        from heliosweep.families.field_efficiency import report

        return report.figures(result)

    def views(self, result: xr.Dataset) -> Iterable[View]:
        """Maps and curves that a reader may turn and switch."""
        from heliosweep.families.field_efficiency import interactive

        return interactive.views(result)


FAMILY = FieldEfficiency()

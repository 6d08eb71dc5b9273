"""Effective tracking factor of a dish whose mount has errors.

After Liu, Peng and Yan (2022), doi 10.3390/en15093261.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.dish_tracking.config import DishTrackingStudy
    from heliosweep.families.registry import NamedFigure
    from heliosweep.grid.plan import Workload
    from heliosweep.report.views import View


class DishTracking:
    """The family, for the registry; see `heliosweep.families.registry.Family`."""

    name = "dish_tracking"
    title = "effective tracking factor of a solar dish whose azimuth axis is tilted"
    references = ("Liu, Peng and Yan (2022), Energies 15, 3261, doi 10.3390/en15093261",)
    keywords = ("solar dish", "tracking error")
    headlines = ("annual_effective_tracking_factor_mean", "effective_tracking_factor_min")

    def study_class(self) -> type[DishTrackingStudy]:
        """Pydantic model of the study file."""
        from heliosweep.families.dish_tracking.config import DishTrackingStudy

        return DishTrackingStudy

    def example(self) -> str:
        """Commented study file to start from."""
        return resources.files(__name__).joinpath("default.yaml").read_text(encoding="utf-8")

    def workload(self, study: DishTrackingStudy) -> Workload:
        """Sizes and cost, for the plan."""
        from heliosweep.families.dish_tracking import model

        return model.workload(study)

    def prepare(self, study: DishTrackingStudy) -> tuple[float, bool]:
        """Load or compile the kernels; seconds it took, and whether something was compiled."""
        from heliosweep.kernels.warm import warm_dish

        return warm_dish()

    def build(self, study: DishTrackingStudy, chunks: Mapping[str, int], select: Mapping[str, slice]) -> xr.Dataset:
        """Lazy result over a part of the parameter grid."""
        from heliosweep.families.dish_tracking import model

        return model.build(study, chunks, select)

    def coordinates(self, study: DishTrackingStudy) -> xr.Dataset:
        """Coordinates of the whole result, in memory."""
        from heliosweep.families.dish_tracking import model

        return model.coordinates(study)

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """How many dates have no instant that counts, and so no factor."""
        empty = int(result["window_is_empty"].sum())
        if empty:
            yield f"{empty} of {result['window_is_empty'].size} days have no instant that counts: no factor (NaN) there"

    def figures(self, result: xr.Dataset) -> Iterable[NamedFigure]:
        """Factors over direction, site and date."""
        from heliosweep.families.dish_tracking import report

        return report.figures(result)

    def views(self, result: xr.Dataset) -> Iterable[View]:
        """Factors over months, directions and days, with switches."""
        from heliosweep.families.dish_tracking import interactive

        return interactive.views(result)


FAMILY = DishTracking()

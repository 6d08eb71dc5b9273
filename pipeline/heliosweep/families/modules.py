"""Families whose computation is in modules that are found by their names."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module, resources
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from heliosweep.families.family import Family

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.study import Study
    from heliosweep.grid.plan import Workload
    from heliosweep.grid.regions import Region, Variable
    from heliosweep.report.figures import Figure
    from heliosweep.report.tables import Table


class ModuleFamily(Family):
    """Package with modules ``study``, ``variables``, ``compute``, ``figures``, ``tables``, and ``default.yaml``."""

    _answers: Any = None

    def __init__(self) -> None:
        pass

    def room(self, mode: str) -> str:
        """Package with ``variables`` and ``compute`` of a mode; that of the family where it has no modes."""
        return type(self).__module__

    def mode(self, study: Any) -> str:
        """Mode of a study, empty where the family has none; the attribute ``mode`` of its result."""
        return ""

    def module(self, name: str, mode: str = "") -> Any:
        """One of the modules of a mode."""
        return import_module(f"{self.room(mode)}.{name}")

    def study_class(self) -> type[Study]:
        """Pydantic model of the study file."""
        model: type[Study] = import_module(f"{type(self).__module__}.study").STUDY
        return model

    def example(self) -> str:
        """Commented study file to start from."""
        return resources.files(type(self).__module__).joinpath("default.yaml").read_text(encoding="utf-8")

    def workload(self, study: Any) -> Workload:
        """Sizes and cost, for the plan."""
        return self.module("compute", self.mode(study)).workload(study)

    def variables(self, study: Any) -> dict[str, Variable]:
        """Variables of the result, in the order of the file: dimensions, attributes, types, and who makes them."""
        return self.module("variables", self.mode(study)).variables(study)

    def coordinates(self, study: Any) -> xr.Dataset:
        """Coordinates of the whole result, in memory; its attributes go to those of the file."""
        mode = self.mode(study)
        labels: xr.Dataset = self.module("compute", mode).coordinates(study)
        return labels.assign_attrs(mode=mode) if mode else labels

    def prepare(self, study: Any) -> tuple[float, bool]:
        """Load or compile the kernels that a study calls, if any; seconds it took, and whether some were compiled."""
        return getattr(self.module("compute", self.mode(study)), "prepare", lambda _: (0.0, False))(study)

    def inputs(self, study: Any) -> Any:
        """Contents of files that `compute` needs; read once."""
        return getattr(self.module("compute", self.mode(study)), "inputs", lambda _: None)(study)

    def compute(self, study: Any, inputs: Any, region: Region) -> xr.Dataset:
        """Values over a region of the result."""
        return self.module("compute", self.mode(study)).compute(study, inputs, region)

    def finish(self, study: Any, inputs: Any, region: Region, computed: xr.Dataset) -> xr.Dataset:
        """Variables that follow from whole points."""
        return self.module("compute", self.mode(study)).finish(study, inputs, region, computed)

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """Return warnings about a finished result."""
        return _call(f"{self.room(str(result.attrs.get('mode', '')))}.compute", "remarks", result)

    def figures(self, result: xr.Dataset) -> Iterable[Figure]:
        """Return the declared figures of a result; default figures if the family declares none."""
        from heliosweep.report.figures import default_figures

        return _call(f"{type(self).__module__}.figures", "figures", result, default_figures)

    def tables(self, result: xr.Dataset) -> Iterable[Table]:
        """Tables of headline numbers; without any, the page shows variables over the dimensions that all have."""
        return _call(f"{type(self).__module__}.tables", "tables", result)


def _call(
    module: str,
    function: str,
    result: xr.Dataset,
    otherwise: Callable[[xr.Dataset], Iterable[Any]] = lambda result: (),
) -> Iterable[Any]:
    there = None
    with suppress(ModuleNotFoundError):  # a family in a single module has none beside it
        there = find_spec(module)
    found = there and getattr(import_module(module), function, None)
    return (found or otherwise)(result)

"""From a study to its lazy result: one heliostat, a field of them, or measured images."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.backward_gazing.config import BackwardGazingStudy
    from heliosweep.grid.plan import Workload


def _module(kind: str) -> Any:
    """Module of a kind of study, with the functions below; imported when it is first asked for."""
    return import_module(f"{__package__}.{kind}")


def kind_of(study: BackwardGazingStudy) -> str:
    """Name of the module that computes a study: ``scenes``, ``field`` or ``measured``."""
    if study.mode == "measured":
        return "measured"
    return "scenes" if study.field is None else "field"


def workload(study: BackwardGazingStudy) -> Workload:
    """Sizes and cost, for the plan."""
    planned: Workload = _module(kind_of(study)).workload(study)
    return planned


def build(study: BackwardGazingStudy, chunks: Mapping[str, int], select: Mapping[str, slice]) -> xr.Dataset:
    """Lazy result over a part of the parameter grid."""
    result: xr.Dataset = _module(kind_of(study)).build(study, chunks, select)
    return result


def coordinates(study: BackwardGazingStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory; the attribute ``kind`` tells `remarks` whose result it is."""
    labels: xr.Dataset = _module(kind_of(study)).coordinates(study)
    return labels.assign_attrs(kind=kind_of(study))


def remarks(result: xr.Dataset) -> Iterable[str]:
    """What the user should be told of a finished result."""
    told: Iterable[str] = _module(result.attrs["kind"]).remarks(result)
    return told

"""From a study to its lazy result: by the study's mode."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.misalignment.config import MisalignmentStudy
    from heliosweep.grid.plan import Workload


def mode(name: str) -> Any:
    """Module of a mode, with the functions below; imported when it is first asked for."""
    return import_module(f"{__package__}.{name}")


def workload(study: MisalignmentStudy) -> Workload:
    """Sizes and cost, for the plan."""
    planned: Workload = mode(study.mode).workload(study)
    return planned


def build(study: MisalignmentStudy, chunks: Mapping[str, int], select: Mapping[str, slice]) -> xr.Dataset:
    """Lazy result over a part of the parameter grid."""
    result: xr.Dataset = mode(study.mode).build(study, chunks, select)
    return result


def coordinates(study: MisalignmentStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory; the attribute ``mode`` tells `remarks` whose result it is."""
    labels: xr.Dataset = mode(study.mode).coordinates(study)
    return labels.assign_attrs(mode=study.mode)


def remarks(result: xr.Dataset) -> Iterable[str]:
    """What the user should be told of a finished result."""
    told: Iterable[str] = mode(result.attrs["mode"]).remarks(result)
    return told

"""Compute a planned study part by part and write each part while the next one is computed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.config.study import Study
from heliosweep.families.registry import Family
from heliosweep.grid.plan import Plan
from heliosweep.runtime.progress import Silent, show_progress
from heliosweep.runtime.scheduler import scheduler
from heliosweep.runtime.signals import TidyStack
from heliosweep.store.attributes import global_attributes
from heliosweep.store.manifest import DESCRIPTIONS
from heliosweep.store.netcdf import ResultWriter, Variable

Part = tuple[dict[str, np.ndarray], Mapping[str, slice]]
Compute = Callable[[xr.Dataset], xr.Dataset]


def execute(family: Family[Any], study: Study, plan: Plan, path: Path, show: bool) -> None:
    """Run a planned study and leave its result file.

    Parameters
    ----------
    family : Family
        Of the study.
    study : Study
        Checked study.
    plan : Plan
        Its plan.
    path : pathlib.Path
        Result file; appears when it is complete, or not at all.
    show : bool
        Whether to show progress on standard error.
    """
    first = family.build(study, plan.chunks, {dim: slice(0, 1) for dim in plan.workload.parameters})
    level = study.output.compression_level if study.output.compression == "zlib" else 0
    chunked = plan.series.storage if plan.series and level else {}
    variables = {
        str(name): Variable(
            tuple(map(str, array.dims)), array.attrs, array.dtype, chunked if "time" in array.dims else {}
        )
        for name, array in first.data_vars.items()
    }
    coordinates = family.coordinates(study)
    attributes = {**global_attributes(study, family.title, family.references), **coordinates.attrs}
    with TidyStack() as stack:
        writer = stack.enter_context(
            ResultWriter(path, plan.workload.sizes, coordinates, variables, attributes, level, replaces=DESCRIPTIONS)
        )
        display = show_progress(study.title or study.family, plan.blocks) if show else nullcontext(Silent())
        progress = stack.enter_context(display)
        compute = stack.enter_context(scheduler(study.execution.scheduler, plan.workers, progress))
        pool = stack.enter_context(ThreadPoolExecutor(1))
        # This thread computes, so that an interruption reaches it; the other one only writes.
        pending: Future[None] | None = None
        for values, region in _parts(family, study, plan, compute):
            if pending:
                pending.result()
            pending = pool.submit(writer.write, values, region)
        if pending:
            pending.result()


def _parts(family: Family[Any], study: Study, plan: Plan, compute: Compute) -> Iterator[Part]:
    """Values of every part in the order of the file: all that has no ``time`` first, then the time series."""
    for region in plan.parts():
        lazy = family.build(study, plan.chunks, region)
        lazy = lazy[[name for name, array in lazy.data_vars.items() if "time" not in array.dims]]
        yield _values(lazy, compute), region
    if plan.series is None:
        return
    lazy, built = xr.Dataset(), None
    for region in plan.series_parts():
        point = {dim: span for dim, span in region.items() if dim in plan.workload.parameters}
        if point != built:
            whole = family.build(study, plan.series.chunks, point)
            lazy = whole[[name for name, array in whole.data_vars.items() if "time" in array.dims]]
            built = point
        inner = {dim: span for dim, span in region.items() if dim not in point}
        yield _values(lazy.isel(inner), compute), region


def _values(lazy: xr.Dataset, compute: Compute) -> dict[str, np.ndarray]:
    done = compute(lazy.drop_vars(lazy.coords))
    return {str(name): array.to_numpy() for name, array in done.data_vars.items()}

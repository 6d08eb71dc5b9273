"""Compute the parts of a planned study that are missing, and store each as soon as it is there."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from typing import Any

import xarray as xr

from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError
from heliosweep.families.registry import Family
from heliosweep.grid.plan import Plan
from heliosweep.grid.slabs import Part
from heliosweep.runtime.engines import engine
from heliosweep.runtime.inputs import Inputs
from heliosweep.runtime.progress import Silent, show_progress
from heliosweep.runtime.signals import TidyStack, raise_if_interrupted
from heliosweep.runtime.work import TRIES, Work
from heliosweep.store.attributes import global_attributes
from heliosweep.store.encoding import Variable
from heliosweep.store.skeleton import Skeleton
from heliosweep.store.working import WorkingStore

#: Where so many parts fail and none comes through, the others would fail too.
HOPELESS = 3
#: Failed parts that a message lists.
_LISTED = 10


def skeleton_of(family: Family[Any], study: Study, plan: Plan, coordinates: xr.Dataset) -> Skeleton:
    """Everything of a study's result but its values; `coordinates` are those of the family."""
    first = family.build(study, plan.chunks, {dim: slice(0, 1) for dim in plan.workload.parameters})
    compressed = study.output.format == "netcdf" and study.output.compression != "none"
    chunked = plan.series.storage if plan.series and compressed else {}
    variables = {
        str(name): Variable(
            tuple(map(str, array.dims)), array.attrs, array.dtype, chunked if "time" in array.dims else {}
        )
        for name, array in first.data_vars.items()
    }
    return Skeleton(plan.workload.sizes, coordinates, variables, attributes_of(family, study, coordinates))


def attributes_of(family: Family[Any], study: Study, coordinates: xr.Dataset) -> dict[str, Any]:
    """Global attributes of a study's result; `coordinates` are those of the family."""
    keywords = getattr(family, "keywords", ())
    return {**global_attributes(study, family.title, family.references, keywords), **coordinates.attrs}


def execute(
    family: Family[Any], study: Study, plan: Plan, store: WorkingStore, skeleton: Skeleton, inputs: Inputs, show: bool
) -> None:
    """Compute and store the parts of a study that its working store lacks.

    Parameters
    ----------
    family : Family
        Of the study.
    study : Study
        Checked study.
    plan : Plan
        Its plan.
    store : WorkingStore
        Holds what earlier runs computed, and is given the rest.
    skeleton : Skeleton
        Of the result: its coordinates say where a part that failed lies.
    inputs : Inputs
        The files that the study names: no part is stored that was computed after one of them was edited.
    show : bool
        Whether to show progress on standard error.

    Raises
    ------
    HeliosweepError
        Where parts failed: all others are stored; lists them with their coordinates. Where nothing can be stored.
    """
    missing = [part for part in plan.parts() if part.name not in store.journal.done]
    if not missing:
        return
    failed: dict[str, str] = {}
    with TidyStack() as stack:
        blocks = sum(map(plan.blocks_of, missing))
        display = show_progress(study.title or study.family, blocks) if show else nullcontext(Silent())
        progress = stack.enter_context(display)
        # This thread waits for parts, so that an interruption reaches it; another one stores them meanwhile.
        storing = stack.enter_context(ThreadPoolExecutor(1))
        started = stack.enter_context(engine(study.execution, plan, progress))
        pending: Future[None] | None = None
        for outcome in started.run(_works(family, study, plan, missing)):
            raise_if_interrupted()
            if pending:
                pending.result()
            if outcome.values is None:
                why = f"{type(outcome.error).__name__}: {outcome.error}".rstrip(": ")
                failed[outcome.part.name] = f"{place(outcome.part, skeleton.coordinates)}: {why}"
                pending = storing.submit(store.fail, outcome.part, failed[outcome.part.name])
                if len(failed) >= HOPELESS and not store.journal.done:
                    break
                continue
            inputs.check()
            pending = storing.submit(store.commit, outcome.part, outcome.values)
        if pending:
            pending.result()
    if failed:
        raise HeliosweepError(_failures(failed, plan, store))


def place(part: Part, coordinates: xr.Dataset) -> str:
    """Where a part lies, in words: the first and last value along each of its dimensions that is cut."""
    words = []
    for dim, span in part.region.items():
        first, last = span.start, span.stop - 1
        if dim in coordinates.coords and coordinates[dim].dims == (dim,):
            first, last = (coordinates[dim].values[end] for end in (first, last))
        words.append(f"{dim} {first}" + (f" to {last}" if span.stop - span.start > 1 else ""))
    return ", ".join(words) or "all"


def _works(family: Family[Any], study: Study, plan: Plan, parts: list[Part]) -> Iterator[Work]:
    """Lazy values of parts."""
    for part in parts:
        chunks = plan.series.chunks if part.kind == "series" and plan.series else plan.chunks
        lazy = _of_kind(family.build(study, chunks, part.region), part.kind)
        # A family may build time series whole along dimensions that are not of the parameter grid.
        whole = {
            dim: span for dim, span in part.region.items() if dim in lazy.sizes and lazy.sizes[dim] != _length(span)
        }
        yield Work(part, lazy.isel(whole))


def _length(span: slice) -> int:
    return span.stop - span.start


def _of_kind(lazy: xr.Dataset, kind: str) -> xr.Dataset:
    names = [name for name, array in lazy.data_vars.items() if ("time" in array.dims) == (kind == "series")]
    chosen = lazy[names]
    return chosen.drop_vars(chosen.coords)


def _failures(failed: dict[str, str], plan: Plan, store: WorkingStore) -> str:
    lines = [f"  {name} ({why})" for name, why in list(failed.items())[:_LISTED]]
    if len(failed) > _LISTED:
        lines.append(f"  and {len(failed) - _LISTED:,} more")
    done = len(store.journal.done)
    kept = f"{done:,} are done and kept" if done else "none is done"
    return "\n".join(
        [
            f"{len(failed):,} of {plan.part_count:,} parts failed, each {TRIES} times ({kept}); "
            "run the same command again when the cause is mended:",
            *lines,
        ]
    )

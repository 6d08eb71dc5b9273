"""One run of a study: find what is there, compute what is missing, leave the result."""

from __future__ import annotations

import logging
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.config.execution import Execution
from heliosweep.config.study import Study
from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError, reason_of
from heliosweep.families.family import Family
from heliosweep.files import remove_at_once
from heliosweep.grid.lazy import Work
from heliosweep.grid.plan import Plan
from heliosweep.grid.regions import Part, in_result, parts_by_slab
from heliosweep.runs.executors import TRIES, Pool, compute_parts, local_pool, safe_path
from heliosweep.runs.shorter import take_draws
from heliosweep.runs.signals import TidyStack, raise_if_interrupted
from heliosweep.runs.status import show_progress
from heliosweep.store import parts
from heliosweep.store.encoding import Skeleton, slab_rows
from heliosweep.store.manifest import Finished, attributes_of, identity_of, listed, words_of, write_manifest
from heliosweep.store.parts import PartStore
from heliosweep.store.read import import_no_other_arrays, open_result
from heliosweep.store.result import publish

if TYPE_CHECKING:
    import xarray as xr

log = logging.getLogger("heliosweep")

#: What of an identity numbers depend on, and all that the bytes of a result depend on.
_NUMBERS = ("study", "code")
_ASPECTS = (*_NUMBERS, "output", "attributes")
#: Where so many parts fail and none comes through, the others would fail too.
HOPELESS = 3
#: Failed parts that a message lists.
_LISTED = 10


class Run:
    """One run of a study in a result folder that it has claimed; `planned` makes the plan, where one is needed.

    `study_id` is that of the study and its files as they are when the run begins, `seconds` the time spent in each
    stage, `stage` the one that runs, or ran last, `store` what is computed so far.
    """

    def __init__(self, family: Family, study: Study, folder: Path, planned: Callable[[], Plan]) -> None:
        self.family, self.study, self.folder = family, study, folder
        self._planned = planned
        self.study_id = study.study_id
        self.seconds: dict[str, float] = {}
        self.stage = "prepare"
        self.store: PartStore | None = None
        self._taken: Finished | None = None

    @cached_property
    def plan(self) -> Plan:
        """The plan of the study."""
        return self._planned()

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Measure the time of a stage."""
        start, self.stage = time.perf_counter(), stage
        yield
        self.seconds[stage] = time.perf_counter() - start
        log.debug("%s: %.2f s", stage, self.seconds[stage])

    @cached_property
    def coordinates(self) -> xr.Dataset:
        """Coordinates of the whole result."""
        import_no_other_arrays()
        return self.family.coordinates(self.study)

    @cached_property
    def _words(self) -> dict[str, Any]:
        return words_of(self.family, self.study)

    @cached_property
    def attributes(self) -> dict[str, Any]:
        """Global attributes of the result."""
        return attributes_of(self._words, self.coordinates)

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What the result belongs to."""
        return identity_of(self.study, self._words, self.family.numbers_from(self.study))

    @cached_property
    def work(self) -> Work:
        """What computes regions, with everything that is read from files.

        Raises HeliosweepError where a file was edited since the run began: what would be computed belongs to no study.
        """
        plan = self.plan
        work = Work(self.family, self.study, plan.variables, plan.workload.sizes)
        if self.study.study_id != self.study_id:
            raise HeliosweepError("the files of the study were edited while it started; run it again")
        return work

    def result(self, *, force: bool, progress: bool) -> Path:
        """Leave the result in the folder, with its manifest and resolved study, from what is there and what is
        computed.

        With `force` all of it is computed, whatever is there; with `progress` that is shown on standard error.
        """
        if not force and (found := self.complete()):
            if self._unfinished():  # of a run that was killed when its result was complete
                remove_at_once(self.folder / parts.WORKING)
            return found
        _ = self.plan  # what does not fit is refused here, before anything is expanded
        _ = self.coordinates  # files are read once, at the start
        self._taken = None if force else self._earlier()
        self.store = self._store(force)
        if not force and self._taken is None:
            take_draws(self.folder, self.study, self.identity, self.plan, self.store)
        if any(True for _ in self._missing(self.store)):
            with self.timed("prepare"):
                prepare_kernels(self.family, self.study)
            with self.timed("compute"):
                self._compute(self.store, progress)
        with self.timed("publish"):
            plan, sizes = self.plan, self.plan.workload.sizes
            stored = in_result(plan.variables)
            skeleton = Skeleton(sizes, self.coordinates, stored, self.attributes, plan.storage, plan.cuts)
            path, digests = publish(self._slabs(self.store), skeleton, self.study.output, self.folder)
        with self.timed("record"):
            self._record(path, digests)
            self.store.remove()
        return path

    def complete(self) -> Path | None:
        """The result, where the folder holds just what this run would leave and no run goes on that makes it anew."""
        earlier = Finished.find(self.folder)
        if earlier is None or self._unfinished().get("forced"):
            return None
        if any(earlier.changes(self.identity, key) for key in _ASPECTS):
            return None
        return earlier.path if earlier.is_whole() else None  # last, for it reads all of the result

    def left(self) -> str:
        """What a run that ends now leaves, and how to go on, in words."""
        again = "run the same command again to go on"
        if self.stage == "report":
            return f"the result is whole, but its report is not; {again}"
        if not (self.folder / parts.WORKING).exists():
            return f"nothing was computed yet; {again}"
        if self.store is None:
            return f"the parts that were done are kept in {self.folder}; {again}"
        done = f"{len(self.store.done):,} of {self.plan.part_count:,} parts are done and kept in {self.folder}"
        return f"{done}; {again}" + (f", without {FORCE}" if self.store.identity.get("forced") else "")

    def tidy(self) -> None:
        """Close the working store, and remove it where nothing came into it."""
        if self.store:
            self.store.close()
            if not self.store.done and not self.store.failed:
                self.store.remove()

    def _unfinished(self) -> dict[str, Any]:
        """What the parts in the folder belong to, where they are of this study; else nothing."""
        with suppress(HeliosweepError):
            found = PartStore.open(self.folder / parts.WORKING).identity
            if not any(listed(found.get(key), self.identity[key]) for key in _NUMBERS):
                return found
        return {}

    def _earlier(self) -> Finished | None:
        """The finished result in the folder, where its numbers are those of this study and nobody makes it anew."""
        earlier, unfinished = Finished.find(self.folder), self._unfinished()
        if earlier is None or unfinished.get("forced"):
            return None
        if differences := earlier.changes(self.identity, "study"):
            raise StudyError(
                Problem(
                    f"holds the result of another study ({differences}); {FORCE} replaces it, --output names another "
                    "folder",
                    file=str(self.folder),
                )
            )
        if differences := earlier.changes(self.identity, "code"):
            log.warning("computed anew, for it was computed with other code: %s", differences)
        elif not earlier.is_whole():
            log.warning("%s is not what was written (damaged?); computed anew", earlier.path)
        else:
            return earlier
        return None

    def _store(self, force: bool) -> PartStore:
        """The working store of the folder, with what earlier runs have computed; or a new one."""
        place, plan = self.folder / parts.WORKING, self.plan
        if force:
            remove_at_once(place)
        if not place.exists():
            said = {**self.identity, "forced": force}
            return PartStore.create(place, said, plan.cuts, plan.variables, plan.workload.sizes)
        store = PartStore.open(place)
        for key, what in (("study", "another study"), ("code", "other code")):
            if differences := listed(store.identity.get(key), self.identity[key]):
                raise _mixed(place, f"{what} ({differences})")
        if slab_rows(store.cuts) != slab_rows(plan.cuts):
            raise _mixed(place, "other variables")
        # Another machine or other chunks may have cut the slabs into other parts.
        self.plan = replace(plan, cuts=store.cuts)
        log.info("goes on: %d of %d parts are done, and are checked first", len(store.done), self.plan.part_count)
        damaged = store.drop_damaged()
        if damaged:
            log.warning("%d parts were damaged on the disk and are computed anew: %s", len(damaged), damaged[0].name)
        return store

    def _is_taken(self, kind: str) -> bool:
        """True where the earlier result holds all variables of a kind; a time series may be wanted only now."""
        return self._taken is not None and self._taken.holds(kind, self.plan)

    def _missing(self, store: PartStore) -> Iterator[Part]:
        """Parts that no run has computed."""
        kinds = {kind for kind in self.plan.cuts if not self._is_taken(kind)}
        return (part for part in self.plan.parts() if part.kind in kinds and part.name not in store.done)

    def _compute(self, store: PartStore, show: bool) -> None:
        """Compute and store the parts that are missing."""
        plan, failed, missing = self.plan, dict[str, str](), self._missing(store)
        count = sum(cut.part_count for kind, cut in plan.cuts.items() if not self._is_taken(kind))
        title = self.study.title or self.study.family
        with TidyStack() as stack:
            display = show_progress(title, count, done=len(store.done)) if show else nullcontext(lambda: None)
            advance = stack.enter_context(display)
            # This thread waits for parts, so that an interruption reaches it; another one stores them meanwhile.
            storing = stack.enter_context(ThreadPoolExecutor(1))
            scratch = stack.enter_context(tempfile.TemporaryDirectory(dir=store.folder, ignore_cleanup_errors=True))
            execution = self.study.execution
            stack.enter_context(safe_path())
            pool = stack.enter_context(pool_of(execution, self.work, plan.workers, Path(scratch)))
            pending: Future[None] | None = None
            for outcome in compute_parts(pool, missing):
                raise_if_interrupted()
                if pending:
                    pending.result()
                advance()
                if outcome.values is None:
                    failed[outcome.part.name] = (
                        f"{place_of(outcome.part, self.coordinates)}: {reason_of(outcome.error)}"
                    )
                    pending = storing.submit(store.fail, outcome.part, failed[outcome.part.name])
                    if len(failed) >= HOPELESS and not store.done:
                        break
                    continue
                pending = storing.submit(store.commit, outcome.part, outcome.values)
            if pending:
                pending.result()
            store.sync()
        if failed:
            raise HeliosweepError(_failures(failed, plan, store))

    def _slabs(self, store: PartStore) -> Iterator[tuple[Part, Mapping[str, Any] | xr.Dataset]]:
        """Finished slabs: of the earlier result, or from the parts that are stored."""
        for slab, pieces in parts_by_slab(self.plan.cuts):
            if self._is_taken(slab.kind):
                assert self._taken is not None
                yield slab, self._taken.read(slab)
                continue
            yield slab, self.work.finish(slab, partial(_read, store, pieces))

    def _record(self, path: Path, digests: dict[str, str]) -> None:
        """Write the manifest and the resolved study, for good."""
        study, plan, folder = self.study, self.plan, self.folder
        with open_result(path) as data:
            remarks = list(self.family.remarks(data))
        for remark in remarks:
            log.warning("warning: %s", remark)
        write_manifest(
            folder,
            study,
            path,
            {
                "study_id": self.study_id,
                "identity": self.identity,
                "study_file": str(study.source.path),
                "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
                "slabs": {
                    "cut": slab_rows(plan.cuts),
                    "digests": digests,
                    "variables": list(in_result(plan.variables)),
                },
                "plan": {
                    "dimensions": plan.workload.sizes,
                    "points": plan.workload.points,
                    "evaluations": plan.workload.points * plan.workload.evaluations,
                    "parts": plan.part_count,
                    "peak_memory": plan.peak_memory,
                },
                "remarks": remarks,
                "scheduler": study.execution.scheduler,
                "workers": plan.workers,
                "seconds": self.seconds,
            },
        )


def _read(store: PartStore, pieces: Iterable[Part]) -> Iterator[tuple[Part, Mapping[str, Any]]]:
    """Parts with their values, as stored."""
    return ((part, store.read(part)) for part in pieces)


def _mixed(place: Path, what: str) -> HeliosweepError:
    return HeliosweepError(
        f"{place}: holds parts of a run with {what}, and parts of two are never mixed: {FORCE} removes them and starts "
        "anew, --output names another folder"
    )


def pool_of(execution: Execution, work: Work, workers: int, scratch: Path) -> AbstractContextManager[Pool]:
    """Workers that a study asks for; a cluster may write to `scratch` while it runs."""
    if execution.scheduler in ("synchronous", "threads", "processes"):
        return local_pool(execution.scheduler, work, workers)
    from heliosweep.runs.cluster import cluster_pool

    return cluster_pool(execution, work, workers, scratch)


def place_of(part: Part, coordinates: xr.Dataset) -> str:
    """Where a part lies, in words: the first and last value along each of its dimensions."""
    words = []
    for dim, span in part.region.items():
        first, last = span.start, span.stop - 1
        if dim in coordinates.coords and coordinates[dim].dims == (dim,):
            first, last = (coordinates[dim].values[end] for end in (first, last))
        words.append(f"{dim} {first}" + (f" to {last}" if span.stop - span.start > 1 else ""))
    return ", ".join(words) or "all"


def _failures(failed: dict[str, str], plan: Plan, store: PartStore) -> str:
    lines = [f"  {name} ({why})" for name, why in list(failed.items())[:_LISTED]]
    if len(failed) > _LISTED:
        lines.append(f"  and {len(failed) - _LISTED:,} more")
    done = len(store.done)
    kept = f"{done:,} are done and kept" if done else "none is done"
    return "\n".join(
        [
            f"{len(failed):,} of {plan.part_count:,} parts failed, each {TRIES} times ({kept}); "
            "run the same command again when the cause is mended:",
            *lines,
        ]
    )


def prepare_kernels(family: Family, study: Study) -> None:
    """Load the kernels, and tell a user who waits that the first run compiles them.

    Logged as warnings, which Python shows also where nobody set up logging.
    """
    from heliosweep.kernels import compiled

    waiting = threading.Timer(1.5, log.warning, ["compiling the kernels, once on this machine ..."])
    waiting.start()
    try:
        seconds, fresh = family.prepare(study)
    finally:
        waiting.cancel()
    if fresh and compiled.UNCACHED:
        log.warning(
            "compiled the kernels in %.0f s; no folder for compiled code can be written, so every run compiles them: "
            "name one in the environment variable NUMBA_CACHE_DIR",
            seconds,
        )
    elif fresh:
        log.warning("compiled the kernels in %.0f s; later runs find them in the cache", seconds)

"""One run of a study: claim the folder, find what is there, compute what is missing, leave the result."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.config.study import Study
from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError
from heliosweep.families.registry import Family
from heliosweep.grid.plan import Plan
from heliosweep.runtime.engines import get_ready
from heliosweep.runtime.execute import attributes_of, execute, skeleton_of
from heliosweep.runtime.inputs import Inputs
from heliosweep.store import working
from heliosweep.store.contents import read_parts
from heliosweep.store.digest import content_digest, tree
from heliosweep.store.finished import Finished, result_digest
from heliosweep.store.identity import identity_of, listed
from heliosweep.store.manifest import environment, write_atomically, write_manifest
from heliosweep.store.open_result import open_result
from heliosweep.store.publish import publish
from heliosweep.store.skeleton import Skeleton
from heliosweep.store.temporary import sync
from heliosweep.store.working import WorkingStore

if TYPE_CHECKING:
    import xarray as xr

log = logging.getLogger("heliosweep")

#: What of an identity numbers depend on, and all that the bytes of a result depend on.
_NUMBERS = ("study", "code")
_ASPECTS = (*_NUMBERS, "output", "attributes")


class Run:
    """One run of a study.

    Parameters
    ----------
    family : Family
        Of the study.
    study : Study
        Checked study.
    folder : pathlib.Path
        Result folder, claimed by this run.
    planned : callable
        Makes the plan, where one is needed.

    Attributes
    ----------
    seconds : dict of str to float
        Time spent in each stage. [s]
    stage : str
        The stage that runs, or ran last.
    store : WorkingStore or None
        What is computed so far.
    """

    def __init__(self, family: Family[Any], study: Study, folder: Path, planned: Callable[[], Plan]) -> None:
        self.family, self.study, self.folder = family, study, folder
        self._planned = planned
        self.inputs = Inputs(study)
        self.seconds: dict[str, float] = {}
        self.stage = "prepare"
        self.store: WorkingStore | None = None

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
        return self.family.coordinates(self.study)

    @cached_property
    def skeleton(self) -> Skeleton:
        """Everything of the result but its values."""
        return skeleton_of(self.family, self.study, self.plan, self.coordinates)

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What the result belongs to."""
        return identity_of(self.study, attributes_of(self.family, self.study, self.coordinates))

    def result(self, *, force: bool, progress: bool) -> Path:
        """Leave the result in the folder, from what is there and what is computed now.

        Parameters
        ----------
        force : bool
            Whether to compute all of it, whatever is there.
        progress : bool
            Whether to show progress on standard error.

        Returns
        -------
        pathlib.Path
            The result, with its manifest and resolved study beside it.
        """
        if not force and (found := self.complete()):
            self._clear()
            return found
        get_ready(self.study.execution, self.family)
        parts = self.plan.part_count  # what does not fit is refused here, before anything is expanded
        earlier = None if force else self._earlier()
        self.store = self._store(force)
        if earlier:
            self._take_over(earlier)
        if len(self.store.journal.done) < parts:
            with self.timed("prepare"):
                prepare_kernels(self.family, self.study)
            with self.timed("compute"):
                execute(self.family, self.study, self.plan, self.store, self.skeleton, self.inputs, progress)
        with self.timed("publish"):
            path = publish(self.store, self.skeleton, self.plan, self.study.output, self.folder)
        with self.timed("record"):
            self._record(path)
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
        if not (self.folder / working.NAME).exists():
            return f"nothing was computed yet; {again}"
        if self.store is None:
            return f"the parts that were done are kept in {self.folder}; {again}"
        done = f"{len(self.store.journal.done):,} of {self.plan.part_count:,} parts are done and kept in {self.folder}"
        return f"{done}; {again}" + (f", without {FORCE}" if self.store.identity.get("forced") else "")

    def tidy(self) -> None:
        """Remove the working store where nothing came into it."""
        if self.store and not self.store.journal.done and not self.store.journal.failed:
            self.store.remove()

    def _unfinished(self) -> dict[str, Any]:
        """What the parts in the folder belong to, where they are of this study; else nothing."""
        with suppress(HeliosweepError):
            found = working.read_identity(self.folder / working.NAME)
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

    def _store(self, force: bool) -> WorkingStore:
        """The working store of the folder, with what earlier runs have computed; or a new one."""
        place = self.folder / working.NAME
        if force:
            working.remove(place)
        if not place.exists():
            output = self.study.output
            compression: Any = output.compression if output.format == "zarr" else "none"
            said = {**self.identity, "parts": self.plan.part_count, "forced": force}
            return WorkingStore.create(place, said, self.skeleton, self.plan.cut, compression, output.compression_level)
        self._refuse_to_mix(working.read_identity(place), place)
        store = WorkingStore(place)
        log.info(
            "goes on: %d of %d parts are done, and are checked first", len(store.journal.done), self.plan.part_count
        )
        damaged = store.drop_damaged(self.plan.parts())
        if damaged:
            log.warning("%d parts were damaged on the disk and are computed anew: %s", len(damaged), damaged[0].name)
        return store

    def _clear(self) -> None:
        """Remove what a run has left that was killed when its result was complete, but not the parts of another."""
        if self._unfinished():
            working.remove(self.folder / working.NAME)

    def _refuse_to_mix(self, found: dict[str, Any], place: Path) -> None:
        now = {**self.identity, "cut": self.plan.cut, "variables": list(self.skeleton.variables)}
        kinds = {"study": "another study", "code": "other code", "variables": "other variables", "cut": "another cut"}
        for key, what in kinds.items():
            if differences := listed(found.get(key), now[key]):
                raise HeliosweepError(
                    f"{place}: holds parts of a run with {what} ({differences}), and parts of two are never "
                    f"mixed: {FORCE} removes them and starts anew, --output names another folder"
                )

    def _take_over(self, earlier: Finished) -> None:
        """Use the parts of a finished result of the same numbers, of which other words or another format are wanted."""
        assert self.store is not None
        parts = [part for part in self.plan.parts() if part.name in earlier.digests]
        for part, values in zip(parts, read_parts(earlier.path, parts, earlier.digests), strict=True):
            if values is not None and part.name not in self.store.journal.done:
                self.store.commit(part, values)

    def _record(self, path: Path) -> None:
        """Write the manifest and the resolved study, for good."""
        from heliosweep.config.identity import resolved_yaml

        assert self.store is not None
        study, plan, folder, digests = self.study, self.plan, self.folder, dict(self.store.journal.done)
        write_atomically(folder / "study.resolved.yaml", resolved_yaml(study, relative_to=folder))
        with open_result(path) as data:
            remarks = list(self.family.remarks(data))
        for remark in remarks:
            log.warning("warning: %s", remark)
        write_manifest(
            folder / "manifest.json",
            {
                "study_id": study.study_id,
                "identity": self.identity,
                "study_file": str(study.source.path),
                "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
                "result": {
                    "file": path.name,
                    "bytes": sum(tree(path).values()) if path.is_dir() else path.stat().st_size,
                    "sha256": result_digest(path),
                    "content_digest": content_digest(path),
                },
                "parts": {"cut": plan.cut, "digests": digests, "variables": list(self.skeleton.variables)},
                "plan": {
                    "dimensions": plan.workload.sizes,
                    "points": plan.workload.points,
                    "evaluations": plan.workload.points * plan.workload.evaluations,
                    "blocks": plan.blocks,
                    "chunks": plan.chunks,
                    "seconds": plan.seconds,
                    "peak_memory": plan.peak_memory,
                },
                "remarks": remarks,
                "scheduler": study.execution.scheduler,
                "workers": plan.workers,
                "seconds": self.seconds,
                "environment": environment(),
            },
        )
        sync(folder)


def prepare_kernels(family: Family[Any], study: Study) -> None:
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

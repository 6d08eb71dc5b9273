"""Run of a study: compute the missing chunks, write the result, write the manifest."""

from __future__ import annotations

import hashlib
import json
import logging
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.config.study import Study
from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError
from heliosweep.families.family import Family
from heliosweep.grid.blocks import Piece, chunks_by_block
from heliosweep.grid.lazy import Chunks, Work
from heliosweep.grid.plan import Plan
from heliosweep.grid.regions import in_result
from heliosweep.runs.executors import TRIES, Workers, explain_failure
from heliosweep.runs.planning import plan_study
from heliosweep.runs.progress import show_progress
from heliosweep.store.chunks import CHUNKS, ChunkStore
from heliosweep.store.folder import read_manifest
from heliosweep.store.manifest import attributes_of, finished, identity_of, listed, words_of, write_manifest
from heliosweep.store.read import check_digest, open_result, result_digest

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.store.writer import Template

log = logging.getLogger("heliosweep")

#: Number of failed chunks after which a run without any computed chunk stops.
HOPELESS = 3
#: Maximum number of failed chunks in a message.
_LISTED = 10


class Run:
    """One run of a study in a result folder.

    Parameters
    ----------
    family : Family
        Family of the study.
    study : Study
        The study.
    folder : pathlib.Path
        Result folder.
    """

    def __init__(self, family: Family, study: Study, folder: Path) -> None:
        self.family, self.study, self.folder = family, study, folder
        self.study_id = study.study_id
        self.seconds: dict[str, float] = {}
        self.stage = "prepare"

    @cached_property
    def plan(self) -> Plan:
        """Plan of the study."""
        return plan_study(self.study, self.folder, connect=True)

    @cached_property
    def coordinates(self) -> xr.Dataset:
        """Coordinates of the whole result."""
        return self.family.coordinates(self.study)

    @cached_property
    def _words(self) -> dict[str, Any]:
        return words_of(self.family, self.study)

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Everything that the bytes of the result depend on."""
        return identity_of(self.study, self._words, type(self.study).__module__)

    @cached_property
    def store(self) -> ChunkStore:
        """Chunks of this study, computed by this code."""
        key = json.dumps([self.identity["code"], self.identity["output"]], sort_keys=True)
        digest = hashlib.sha256(key.encode()).hexdigest()[:12]
        return ChunkStore(self.folder / f"{CHUNKS}{self.study_id}-{digest}")

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Measure the time of a stage."""
        start, self.stage = time.perf_counter(), stage
        yield
        self.seconds[stage] = time.perf_counter() - start
        log.debug("%s: %.2f s", stage, self.seconds[stage])

    def complete(self) -> Path | None:
        """Return the result if the folder holds the undamaged result of this study, code and output options."""
        earlier = finished(self.folder)
        if earlier is None or any(listed(earlier[1].get(key), self.identity[key]) for key in self.identity):
            return None
        recorded = read_manifest(self.folder)["result"]["sha256"]
        return earlier[0] if recorded == result_digest(earlier[0]) else None

    def result(self, *, force: bool, progress: bool) -> Path:
        """Leave the result with its manifest in the folder and return its path.

        With `force`, everything is computed again; with `progress`, the progress is shown on standard error.
        """
        if not force and (found := self.complete()):
            self.store.remove()
            return found
        self._check_earlier(force)
        if force:
            self.store.remove()
        plan = self.plan  # a study that does not fit is refused before the kernels are compiled
        from heliosweep.store.writer import write_result

        template, blocks = self.compute(plan, progress)
        with self.timed("publish"):
            path = write_result(blocks, template, self.study.output, self.folder)
        with self.timed("record"):
            self._record(path)
            for place in self.folder.glob(f"{CHUNKS}*"):
                ChunkStore(place).remove()
        return path

    def compute(self, plan: Plan, progress: bool) -> tuple[Template, Iterator[tuple[Piece, xr.Dataset]]]:
        """Compute the missing chunks and return the template of the result and its blocks."""
        from heliosweep.store.writer import Template

        cuts = self.store.create(plan.cuts, identity=self.identity, study_id=self.study_id)
        self.plan = plan = replace(plan, cuts=cuts)
        work = Work(self.family, self.study, plan.variables, plan.workload.sizes)
        if self.study.study_id != self.study_id:
            raise HeliosweepError("the files of the study were edited while it started; run it again")
        done = self.store.done()
        missing = [chunk for chunk in plan.chunks() if chunk.name not in done]
        if done:
            log.info("resumes: %d of %d chunks are done", plan.chunk_count - len(missing), plan.chunk_count)
        if missing:
            with self.timed("prepare"):
                prepare_kernels(self.family, self.study)
            with self.timed("compute"):
                self._compute(work, missing, progress)
        template = Template(
            plan.workload.sizes,
            self.coordinates,
            in_result(plan.variables),
            attributes_of(self._words, self.coordinates),
            plan.cuts,
        )
        return template, self._blocks(work)

    def _compute(self, work: Work, missing: list[Piece], progress: bool) -> None:
        """Compute and store chunks. Raises HeliosweepError if some fail."""
        failed: dict[str, str] = {}
        total, stored = self.plan.chunk_count, 0
        display = show_progress(self.study.title or self.study.family, total, done=total - len(missing), shown=progress)
        with display as advance, Workers(self.study.execution, self.plan.workers) as workers:
            for chunk, outcome in workers.compute(work, missing):
                if isinstance(outcome, Exception):
                    log.debug("chunk %s failed", chunk.name, exc_info=outcome)
                    failed[chunk.name] = f"{place_of(chunk, self.coordinates)}: {explain_failure(outcome)}"
                    if len(failed) >= HOPELESS and not stored:
                        break
                    continue
                self.store.save(chunk.name, outcome)
                stored += 1
                advance()
        if failed:
            lines = [f"  {name} ({why})" for name, why in list(failed.items())[:_LISTED]]
            more = [f"  and {len(failed) - _LISTED:,} more"] if len(failed) > _LISTED else []
            counts = f"{len(failed):,} of {total:,} chunks failed, each {TRIES} times"
            head = f"{counts} ({len(self.store.done()):,} stored); correct the cause and run the same command again:"
            raise HeliosweepError("\n".join([head, *lines, *more]))

    def _blocks(self, work: Work) -> Iterator[tuple[Piece, xr.Dataset]]:
        """Yield finished blocks; a damaged chunk is computed again."""
        for block, chunks in chunks_by_block(self.plan.cuts):
            yield block, work.finish(block, partial(self._read, work, chunks))

    def _read(self, work: Work, chunks: Iterable[Piece]) -> Chunks:
        for chunk in chunks:
            values = self.store.load(chunk.name)
            if values is None:
                log.warning("chunk %s is damaged, and is computed again", chunk.name)
                values = work.compute(chunk)
                self.store.save(chunk.name, values)
            yield chunk, values

    def _check_earlier(self, force: bool) -> None:
        """Refuse to replace the result of another study without `force`. Raises StudyError."""
        earlier = finished(self.folder)
        if earlier is None or force:
            return
        if differences := listed(earlier[1].get("study"), self.identity["study"]):
            raise StudyError(
                Problem(
                    f"contains the result of another study ({differences}); {FORCE} replaces it, --output names "
                    "another folder",
                    file=str(self.folder),
                )
            )
        if differences := listed(earlier[1].get("code"), self.identity["code"]):
            log.warning("the existing result was computed by other code (%s); it is computed again", differences)
            return
        try:
            check_digest(earlier[0])
        except HeliosweepError:
            log.warning("%s is damaged; it is computed again", earlier[0])

    def left(self) -> str:
        """Return a message that explains how to resume."""
        again = "run the same command again to resume"
        if self.stage == "report":
            return f"the result is complete, but its report is not; {again}"
        count = len(self.store.done()) if self.store.folder.is_dir() else 0
        if not count:
            return f"no chunk was computed; {again}"
        return f"{count:,} of {self.plan.chunk_count:,} chunks are done and stored in {self.folder}; {again}"

    def _record(self, path: Path) -> None:
        """Write the manifest and the resolved study."""
        study, plan = self.study, self.plan
        with open_result(path) as data:
            remarks = list(self.family.remarks(data))
        for remark in remarks:
            log.warning("warning: %s", remark)
        write_manifest(
            self.folder,
            study,
            path,
            {
                "study_id": self.study_id,
                "identity": self.identity,
                "study_file": str(study.source.path),
                "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
                "plan": {
                    "dimensions": plan.workload.sizes,
                    "points": plan.workload.points,
                    "evaluations": plan.workload.points * plan.workload.evaluations,
                    "chunks": plan.chunk_count,
                    "peak_memory": plan.peak_memory,
                },
                "remarks": remarks,
                "scheduler": study.execution.scheduler,
                "workers": plan.workers,
                "seconds": self.seconds,
            },
        )


def place_of(chunk: Piece, coordinates: xr.Dataset) -> str:
    """Return the first and last coordinate of a chunk along each of its dimensions, in words."""
    words = []
    for dim, span in chunk.region.items():
        first, last = span.start, span.stop - 1
        if dim in coordinates.coords and coordinates[dim].dims == (dim,):
            first, last = (coordinates[dim].values[end] for end in (first, last))
        words.append(f"{dim} {first}" + (f" to {last}" if span.stop - span.start > 1 else ""))
    return ", ".join(words) or "all"


def prepare_kernels(family: Family, study: Study) -> None:
    """Load the kernels of a study; report if they are being compiled, which takes some seconds."""
    from heliosweep.kernels import compiled

    message = "compiling the kernels, once on this machine; 'heliosweep setup' compiles those of all families ..."
    with compiled.on_compilation(lambda: log.warning(message)):
        seconds, fresh = family.prepare(study)
    if fresh and compiled.UNCACHED:
        log.warning(
            "compiled the kernels in %.0f s; no folder for compiled code can be written, so every run compiles them: "
            "name one in the environment variable NUMBA_CACHE_DIR",
            seconds,
        )
    elif fresh:
        log.warning("compiled the kernels in %.0f s; later runs find them in the cache", seconds)

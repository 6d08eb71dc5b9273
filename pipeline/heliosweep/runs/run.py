"""Runs of studies: planning, computing the missing chunks, and writing the result and its manifest.

Threads, processes and dask clusters use the same loop over the chunks.
"""

from __future__ import annotations

import hashlib
import json
import logging
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import cache, cached_property, lru_cache, partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TextIO, TypeAlias

from heliosweep import sources
from heliosweep.config import Execution, Study
from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError, log, printable, reason_of
from heliosweep.families.family import Family
from heliosweep.families.lookup import Searched, family_of
from heliosweep.grid import (
    Chunks,
    Piece,
    Plan,
    Work,
    chunks_by_block,
    human_seconds,
    in_result,
    machine_limits,
    make_plan,
    trial_seconds,
)
from heliosweep.lazy import xr
from heliosweep.store import writer
from heliosweep.store.folder import CHUNKS, ChunkStore, check_digest, open_result, status_of
from heliosweep.store.writer import finished, identity_of, listed, words_of

if TYPE_CHECKING:
    import numpy as np
    from distributed import Client

    Values: TypeAlias = dict[str, np.ndarray]


#: Maximum number of attempts to compute a chunk.
TRIES = 2
#: Hint in messages about failed worker processes.
_GUARD = 'in a script, calls that run studies must be inside an `if __name__ == "__main__":` block'


class Workers(ExitStack):
    """Workers for a study. They start when the first chunk is computed.

    Parameters
    ----------
    execution : Execution
        Settings that select the kind of workers.
    count : int
        Number of chunks computed at the same time.
    """

    def __init__(self, execution: Execution, count: int) -> None:
        super().__init__()
        self.execution, self.count = execution, count
        self._submit: Callable[[Work, Piece], Future[Values]] | None = None

    def compute(self, work: Work, chunks: Iterable[Piece]) -> Iterator[tuple[Piece, Values | Exception]]:
        """Yield each chunk when it is complete, with its values or its error.

        If the computation of a chunk fails, it is repeated once with new workers.
        """
        remaining = list(chunks)
        for attempt in range(TRIES):
            failed = []
            for chunk, outcome in self._once(work, remaining):
                if isinstance(outcome, HeliosweepError):
                    raise outcome
                if isinstance(outcome, Exception) and attempt + 1 < TRIES:
                    log.debug("chunk %s failed and is computed again: %s", chunk.name, reason_of(outcome))
                    failed.append(chunk)
                else:
                    yield chunk, outcome
            if not (remaining := failed):
                return
            self.close()
            self._submit = None

    def _once(self, work: Work, chunks: Iterable[Piece]) -> Iterator[tuple[Piece, Values | Exception]]:
        waiting = iter(chunks)
        pending: dict[Future[Values], Piece] = {}
        while True:
            while len(pending) < self.count + 2 and (chunk := next(waiting, None)) is not None:
                submit = self._submit = self._submit or self._started()
                try:
                    pending[submit(work, chunk)] = chunk
                except Exception as refusal:  # for example, the process pool is broken
                    yield chunk, refusal
            if not pending:
                return
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                error = future.exception()
                if isinstance(error, BaseException) and not isinstance(error, Exception):
                    raise error
                yield pending.pop(future), future.result() if error is None else error

    def _started(self) -> Callable[[Work, Piece], Future[Values]]:
        name, send = self.execution.scheduler, lru_cache(1)(lambda work: work)
        pool: Executor
        if name in ("synchronous", "threads"):
            pool = ThreadPoolExecutor(1 if name == "synchronous" else self.count)
            self.callback(pool.shutdown, cancel_futures=True)
        elif name == "processes":
            context = multiprocessing.get_context("spawn")
            pool, send = ProcessPoolExecutor(self.count, context, _begin_worker), lru_cache(1)(pickle.dumps)
            self.callback(pool.shutdown, cancel_futures=True)
        else:
            client = self.enter_context(connected(self.execution, self.count))
            _check_workers(client, name)
            pool, send = client.get_executor(), lru_cache(1)(partial(client.scatter, broadcast=True, hash=False))
        return lambda work, chunk: pool.submit(_compute, send(work), chunk)


def _compute(work: Work | bytes, chunk: Piece) -> Values:
    return (_unpickled(work) if isinstance(work, bytes) else work).compute(chunk)


_unpickled = lru_cache(1)(pickle.loads)


def _begin_worker() -> None:
    """Ignore Ctrl-C, which reaches all processes of a terminal, and exit if the main process is killed."""

    def end_with_parent() -> None:
        if parent := multiprocessing.parent_process():
            parent.join()
            os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_parent, daemon=True).start()


@contextmanager
def connected(execution: Execution, workers: int) -> Iterator[Client]:
    """Connect to the scheduler at the given address, or start a cluster. Raises StudyError or HeliosweepError."""
    from distributed import Client, LocalCluster
    from distributed.security import Security

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    address = execution.scheduler if "://" in execution.scheduler else None
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder, ExitStack() as stack:
        try:
            cluster: Any = address
            if not address and execution.cluster:
                module, _, name = str(execution.cluster["class"]).rpartition(".")
                keywords = {key: value for key, value in execution.cluster.items() if key != "class"}
                cluster = getattr(import_module(module), name)(**keywords)
                cluster.scale(workers)
            elif not address:
                cluster = LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    local_directory=folder,
                    protocol="tls://",
                    security=Security.temporary(),
                    silence_logs=logging.CRITICAL,
                )
            if not address:
                stack.callback(_close, cluster, 10)
            client = Client(cluster, timeout=10 if address else 120, set_as_default=False)
            stack.callback(_close, client, 2)
        except (ImportError, AttributeError, TypeError, ValueError) as error:
            raise StudyError(Problem(f"cannot start: {reason_of(error)}", "execution.cluster")) from None
        except OSError as error:
            problem = f"no dask scheduler answers at {address}; start it with: dask scheduler ({error})"
            raise StudyError(Problem(problem, "execution.scheduler")) from None
        except RuntimeError as error:
            raise HeliosweepError(f"the workers did not start ({str(error).splitlines()[0]}); {_GUARD}") from None
        if client.dashboard_link:
            log.info("dashboard: %s", client.dashboard_link)
        yield client


def _close(connection: Any, seconds: float) -> None:
    with suppress(TimeoutError):  # all results have arrived
        connection.close(timeout=seconds)


def _check_workers(client: Client, name: str) -> None:
    own = sources.code_versions()
    for worker, answer in client.run(sources.code_versions, on_error="return").items():
        if isinstance(answer, OSError):
            continue  # the worker is no longer connected
        if isinstance(answer, Exception):
            raise HeliosweepError(
                f"worker {worker} of {name} cannot run heliosweep ({reason_of(answer)}): install the same version there"
            )
        if other := [key for key in own if own[key] != answer.get(key)]:
            details = ", ".join(f"{key} {answer.get(key)} instead of {own[key]}" for key in other)
            raise HeliosweepError(
                f"worker {worker} of {name} has other versions: {details}, so results could differ: install the "
                "same versions there and restart its workers"
            )


def explain_failure(error: Exception) -> str:
    """Return the reason why a chunk failed, with a hint if a worker process ended early."""
    if type(error).__name__ in ("BrokenProcessPool", "KilledWorker"):
        return f"a worker process ended before its work was complete; {_GUARD}, and each worker needs enough memory"
    return reason_of(error)


#: Time between progress updates on a terminal and on other streams. [s]
TERMINAL_SECONDS, LINE_SECONDS = 0.5, 10.0


def plan_study(study: Study, folder: Path, *, connect: bool = False) -> Plan:
    """Return the plan of a study.

    Parameters
    ----------
    study : Study
        Study to plan.
    folder : pathlib.Path
        Result folder. Its file system determines the available disk space.
    connect : bool
        If True, read the number of workers from the remote scheduler specified in the study.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        If the study does not fit in the available memory or disk space.
    StudyError
        If a scheduler does not respond, or if the chunk settings name an unknown dimension.
    """
    execution, family = study.execution, family_of(study)
    if isinstance(family, Searched):  # a generation of a search must fit in memory
        return family.plan(study, plan_study(family.first(study), folder, connect=connect))
    workers, remote = execution.workers, "://" in execution.scheduler
    try:
        if connect and remote:
            with connected(execution, 1) as client:
                workers = max(1, sum(client.nthreads().values()))
        limits = machine_limits(workers, execution.memory, folder)
        stored = sum(file.stat().st_size for file in folder.glob(f"{CHUNKS}*/*"))
        limits = replace(limits, disk=limits.disk + stored)  # existing chunks need no additional disk space
        local: Any = "here" if execution.scheduler in ("synchronous", "threads") else "processes"
        return make_plan(
            family.workload(study),
            family.variables(study),
            limits,
            execution.chunks,
            where="elsewhere" if remote or execution.cluster else local,
        )
    except StudyError as error:  # these problems have no position in the study file yet
        raise StudyError(
            problem if problem.file or study.source.data.get("execution") is None
            else study.problem(problem.key, problem.message)
            for problem in error.problems
        ) from None  # fmt: skip


def timed_plan(study: Study, folder: Path) -> Plan:
    """Plan a study and estimate its run time from a small region.

    The estimate is omitted if the region takes too long.
    """
    plan, family = plan_study(study, folder), family_of(study)
    tried = plan
    if isinstance(family, Searched):
        first = family.first(study)
        tried, family, study = plan_study(first, folder), family.inner, first
    seconds = trial_seconds(Work(family, study, tried.variables, tried.workload.sizes), tried)
    return plan if seconds is None else replace(plan, seconds=seconds * plan.workload.points / tried.workload.points)


def plan_text(study: Study, plan: Plan, folder: Path) -> str:
    """Format the plan of a study, with one quantity per line."""
    words, status = plan.in_words(), status_of(folder)
    done = {"complete": "; all are complete", "not run": ""}.get(status.state, f"; {status.detail}")
    rows = {"study": f"{study.title or study.family} ({study.family}, {study.study_id})", **words}
    rows["chunks"] += done
    rows["workers"] += f" ({study.execution.scheduler})"
    rows["output"] += f" in {folder}"
    return "\n".join(f"{name:{max(map(len, rows))}}  {value}" for name, value in rows.items())


@contextmanager
def show_progress(
    title: str, total: int, done: int = 0, *, shown: bool = True, stream: TextIO | None = None
) -> Iterator[Callable[[], object]]:
    """Show the progress of a run on `stream` (default: standard error).

    On a terminal, a single line is updated; on other streams, each update is a new line. The context manager yields a
    function that must be called after each completed chunk. At the start, `done` of the `total` chunks are complete.
    """
    stream, start, before = stream or sys.stderr, time.monotonic(), done
    pause, last = TERMINAL_SECONDS if stream.isatty() else LINE_SECONDS, start
    head, end = ("\r\x1b[K", "") if stream.isatty() else ("", "\n")

    def advance() -> None:
        nonlocal done, last
        done, now = done + 1, time.monotonic()
        if shown and now - last >= pause and done < total:
            last, left = now, (now - start) / (done - before) * (total - done)
            times = f"elapsed {human_seconds(now - start)}, left about {human_seconds(left)}"
            print(f"{head}{printable(title)}: {done:,} of {total:,} chunks, {times}", end=end, file=stream, flush=True)

    try:
        yield advance
    finally:
        if head and last > start:
            print(head, end="", file=stream, flush=True)


class Run:
    """Run of a study in a result folder.

    Parameters
    ----------
    family : Family
        Family of the study.
    study : Study
        Study to run.
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
        """Coordinates of the complete result."""
        return self.family.coordinates(self.study)

    @cached_property
    def _words(self) -> dict[str, Any]:
        return words_of(self.family, self.study)

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Inputs that determine the bytes of the result file."""
        return identity_of(self.study, self._words, type(self.study).__module__)

    @cached_property
    def store(self) -> ChunkStore:
        """Store of the chunks computed for the study by this version of the code."""
        key = json.dumps([self.identity["code"], self.identity["output"]], sort_keys=True)
        digest = hashlib.sha256(key.encode()).hexdigest()[:12]
        return ChunkStore(self.folder / f"{CHUNKS}{self.study_id}-{digest}")

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Measure the elapsed time of a stage of the run."""
        start, self.stage = time.perf_counter(), stage
        yield
        self.seconds[stage] = time.perf_counter() - start
        log.debug("%s: %.2f s", stage, self.seconds[stage])

    def complete(self, *, replace: bool = False) -> Path | None:
        """Return the path of the existing result if it is undamaged and up to date.

        An up-to-date result agrees with the study, the code and the output options. Otherwise, None is returned, and
        the reason is logged if `replace` is True. Raises StudyError if the result belongs to another study.
        """
        path, recorded = finished(self.folder)
        if path is None:
            return None
        changed = {key: text for key in self.identity if (text := listed(recorded.get(key), self.identity[key]))}
        if replace and "study" in changed:
            message = (
                f"contains the result of another study ({changed['study']}); {FORCE} replaces it, --output selects "
            )
            raise StudyError(Problem(f"{message}another folder", file=str(self.folder)))
        reason = f"was computed by a different version of the code ({changed['code']})" if "code" in changed else ""
        with suppress(HeliosweepError):
            check_digest(path)
            if not changed:
                return path
            reason = reason or "has different output options"
        if replace:
            log.warning("the existing result %s and is computed again", reason or "is damaged")
        return None

    def result(self, *, force: bool, progress: bool) -> Path:
        """Write the result and its manifest and return the path of the result.

        If `force` is True, all chunks are recomputed. If `progress` is True, progress is shown on standard error.
        """
        if not force and (found := self.complete(replace=True)):
            self.store.remove()
            return found
        if force:
            self.store.remove()
        _ = self.plan  # rejects oversized studies before the kernels are compiled
        blocks = self.compute(progress)
        with self.timed("publish"):
            coordinates = self.coordinates.assign_attrs({**self._words, **self.coordinates.attrs})
            variables, sizes = in_result(self.plan.variables), self.plan.workload.sizes
            path = writer.write_result(
                blocks, coordinates, variables, sizes, self.plan.cuts, self.study.output, self.folder
            )
        with self.timed("record"):
            self._record(path)
            for place in self.folder.glob(f"{CHUNKS}*"):
                ChunkStore(place).remove()
        return path

    def compute(self, progress: bool) -> Iterator[tuple[Piece, Mapping[Any, Any]]]:
        """Compute the missing chunks and return an iterator over the finished blocks."""
        cuts = self.store.create(self.plan.cuts, identity=self.identity, study_id=self.study_id)
        self.plan = plan = replace(self.plan, cuts=cuts)
        work = Work(self.family, self.study, plan.variables, plan.workload.sizes)
        if self.study.study_id != self.study_id:
            raise HeliosweepError("the files of the study changed while the run started: run it again")
        done = self.store.done()
        missing = [chunk for chunk in plan.chunks() if chunk.name not in done]
        if done:
            log.info("resumes: %d of %d chunks are complete", plan.chunk_count - len(missing), plan.chunk_count)
        if missing:
            with self.timed("prepare"):
                prepare_kernels(self.family, self.study)
            with self.timed("compute"):
                self._compute(work, missing, progress)
        return ((block, work.finish(block, partial(self._read, work, own))) for block, own in chunks_by_block(cuts))

    def _compute(self, work: Work, missing: list[Piece], progress: bool) -> None:
        failed: dict[str, str] = {}
        total, stored = self.plan.chunk_count, 0
        display = show_progress(self.study.title or self.study.family, total, total - len(missing), shown=progress)
        with display as advance, Workers(self.study.execution, self.plan.workers) as workers:
            for chunk, outcome in workers.compute(work, missing):
                if isinstance(outcome, Exception):
                    log.debug("chunk %s failed", chunk.name, exc_info=outcome)
                    failed[chunk.name] = f"{place_of(chunk, self.coordinates)}: {explain_failure(outcome)}"
                    if len(failed) >= 3 and not stored:  # presumably, no chunk can be computed
                        break
                    continue
                self.store.save(chunk.name, outcome)
                stored += 1
                advance()
        if failed:
            lines = [f"  {name} ({why})" for name, why in list(failed.items())[:10]]
            more = [f"  and {len(failed) - 10:,} more"] if len(failed) > 10 else []
            counts = f"{len(failed):,} of {total:,} chunks failed, each {TRIES} times"
            head = f"{counts} ({len(self.store.done()):,} stored): correct the cause and run the same command again:"
            raise HeliosweepError("\n".join([head, *lines, *more]))

    def _read(self, work: Work, chunks: list[Piece], names: list[str]) -> Chunks:
        for chunk in chunks:
            values = self.store.load(chunk.name, names)
            if values is None:
                log.warning("chunk %s is damaged and is computed again", chunk.name)
                values = work.compute(chunk)
                self.store.save(chunk.name, values)
            yield chunk, values

    def left(self) -> str:
        """Return a message that explains how to resume the run."""
        again = "run the same command again to resume"
        if self.stage == "report":
            return f"the result is complete, but its report is not; {again}"
        if count := len(self.store.done()):
            return f"{count:,} of {self.plan.chunk_count:,} chunks are complete and stored in {self.folder}; {again}"
        return f"no chunk was computed; {again}"

    def _record(self, path: Path) -> None:
        study, plan = self.study, self.plan
        with open_result(path) as data:
            remarks = list(self.family.remarks(data))
        for remark in remarks:
            log.warning("warning: %s", remark)
        content = {
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
        }
        writer.write_manifest(self.folder, study, path, content)


def place_of(chunk: Piece, coordinates: xr.Dataset) -> str:
    """Describe a chunk by its first and last coordinates along each dimension."""
    words = []
    for dim, span in chunk.region.items():
        first, last = span.start, span.stop - 1
        if dim in coordinates.coords and coordinates[dim].dims == (dim,):
            first, last = (coordinates[dim].values[end] for end in (first, last))
        words.append(f"{dim} {first}" + (f" to {last}" if span.stop - span.start > 1 else ""))
    return ", ".join(words) or "all"


def prepare_kernels(family: Family, study: Study) -> None:
    """Load the kernels of a study. If the kernels must first be compiled, a message is logged once per process."""
    from heliosweep.kernels import compiled

    with compiled.on_compilation(_report_compilation):
        family.prepare(study)


@cache
def _report_compilation() -> None:
    from heliosweep.kernels import compiled

    log.warning(
        "compiling the kernels, once on this machine; 'heliosweep setup' compiles the kernels of all families ..."
    )
    if compiled.UNCACHED:
        remedy = "set the environment variable NUMBA_CACHE_DIR to a folder"
        log.warning("no folder for compiled code is writable, so every run compiles the kernels: %s", remedy)

"""Parts computed by a cluster of dask.distributed: a local one, one by its address, or jobs of a job queue."""

from __future__ import annotations

import asyncio
import concurrent.futures
import logging
import queue
import uuid
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from heliosweep.config.execution import QUEUES
from heliosweep.errors import HeliosweepError, RunInterrupted
from heliosweep.grid.evaluate import TASK_MARK
from heliosweep.runtime.connect import Connection, connected
from heliosweep.runtime.fused import Graph, fused
from heliosweep.runtime.progress import Progress
from heliosweep.runtime.versions import check_workers
from heliosweep.runtime.work import TRIES, Engine, Outcome, Work

if TYPE_CHECKING:
    from distributed import Future

    from heliosweep.config.blocks import Execution
    from heliosweep.grid.plan import Plan

log = logging.getLogger("heliosweep")

#: Tasks in flight at the most, whatever the study's size.
TASKS_IN_FLIGHT = 20_000
#: Results of the parts in flight: enough for two of the largest. [bytes]
BYTES_IN_FLIGHT = 128 * 2**20
#: Blocks in flight per worker, so that none waits for work.
BLOCKS_PER_WORKER = 4
#: How often a cluster is looked after while nothing comes from it. [s]
LOOK_SECONDS = 1.0


def worker_count(execution: Execution) -> int | None:
    """How many workers a cluster will have that is not of this machine, for the plan.

    Parameters
    ----------
    execution : Execution
        Resolved block of the study.

    Returns
    -------
    int or None
        None where this machine's cores decide: the workers are its own.

    Raises
    ------
    StudyError
        Where a scheduler is given by its address and cannot be reached.
    """
    if "://" in execution.scheduler:
        from heliosweep.runtime.connect import reachable_threads

        return execution.workers or max(1, reachable_threads(execution.scheduler))
    if execution.scheduler in QUEUES:
        return execution.workers or (execution.job.cores if execution.job else 1)
    return None


@contextmanager
def cluster_engine(execution: Execution, plan: Plan, progress: Progress) -> Iterator[Engine]:
    """Start or find the cluster that a study asks for, and leave it at the end.

    Parameters
    ----------
    execution : Execution
        Resolved block of the study.
    plan : Plan
        Its plan: the number of workers to start.
    progress : Progress
        Is told of the blocks of every part that is done.

    Yields
    ------
    Engine

    Raises
    ------
    StudyError
        Where the scheduler cannot be reached, or the job queue not be used.
    HeliosweepError
        Where workers do not start, or run other versions than this process.
    RunInterrupted
        Where the scheduler is lost.
    """
    workers = (execution.workers or plan.workers) if execution.scheduler in QUEUES else plan.workers
    with connected(execution, workers) as connection:
        yield _Cluster(connection, workers, progress)


@dataclass(frozen=True)
class _Load:
    """A part, and what it is in the scheduler."""

    work: Work
    key: str
    graph: Graph
    blocks: int
    nbytes: int
    alone: bool = False

    @classmethod
    def of(cls, work: Work, run: str) -> _Load:
        lazy = work.lazy if work.lazy.__dask_graph__() else work.lazy.chunk()
        blocks = sum(len(layer) for name, layer in lazy.__dask_graph__().layers.items() if TASK_MARK in name)
        key = f"{work.part.name}-{uuid.uuid4().hex}"
        return cls(work, key, fused(lazy, key, run), blocks, lazy.nbytes)


class _Cluster:
    def __init__(self, connection: Connection, workers: int, progress: Progress) -> None:
        self._client, self._connection, self._progress = connection.client, connection, progress
        self._workers = workers
        self._checked: set[str] = set()
        self._told_idle = False

    def run(self, works: Iterator[Work]) -> Iterator[Outcome]:
        """Compute all `works`."""
        self._check()
        flight: dict[Future, _Load] = {}
        done: queue.SimpleQueue[Future] = queue.SimpleQueue()
        # A part that was in flight when the worker of another one died may be innocent: it gets a try alone.
        suspects: deque[_Load] = deque()
        run = uuid.uuid4().hex
        loads = (_Load.of(work, run) for work in works)
        following = next(loads, None)
        while following or flight or suspects:
            while following and self._room(flight, following):
                self._submit(following, flight, done)
                following = next(loads, None)
            if not flight:
                again = _Load.of(suspects.popleft().work, run)  # by another name: the old one stands for its failure
                self._submit(replace(again, alone=True), flight, done)
            future = self._wait(done)
            load = flight.pop(future)
            outcome, killed = self._outcome(future, load, done)
            if killed and not load.alone and (flight or following or suspects):
                suspects.append(load)
                continue
            self._check()
            self._progress.advance(load.blocks)
            del future
            yield outcome

    def _room(self, flight: dict[Future, _Load], load: _Load) -> bool:
        """Whether one more part may be handed out."""
        flying = flight.values()
        if not flying:
            return True
        if sum(len(one.graph) for one in flying) + len(load.graph) > TASKS_IN_FLIGHT:
            return False
        if sum(one.nbytes for one in flying) + load.nbytes > BYTES_IN_FLIGHT:
            return False
        return len(flying) < 2 or sum(one.blocks for one in flying) < BLOCKS_PER_WORKER * self._workers

    def _submit(self, load: _Load, flight: dict[Future, _Load], done: queue.SimpleQueue[Future]) -> None:
        # Part after part, so that the workers are busy with the next one while another is handed out; and no priority,
        # which would put this run behind all others of a scheduler that is shared.
        future = self._client.get(load.graph, load.key, sync=False, retries=TRIES - 1, fifo_timeout="0s")
        flight[future] = load
        future.add_done_callback(done.put)

    def _wait(self, done: queue.SimpleQueue[Future]) -> Future:
        """Wait for a part, and look after the cluster meanwhile."""
        while True:
            try:
                return done.get(timeout=LOOK_SECONDS)
            except queue.Empty:
                if self._client.status != "running":
                    raise self._lost() from None
                self._connection.look_after()
                self._tell_idle()

    def _outcome(self, future: Future, load: _Load, done: queue.SimpleQueue[Future]) -> tuple[Outcome, bool]:
        """What became of a part, and whether its worker was killed."""
        from distributed.scheduler import KilledWorker

        try:
            values = future.result()
        except (concurrent.futures.CancelledError, asyncio.CancelledError, OSError, TimeoutError) as error:
            if future.status == "error" and self._client.status == "running":
                return Outcome(load.work.part, None, _plain(error)), False
            raise self._lost() from None
        except KilledWorker as error:
            return Outcome(load.work.part, None, HeliosweepError(_killed(error))), True
        except HeliosweepError:
            raise
        except Exception as error:
            return Outcome(load.work.part, None, error), False
        return Outcome(load.work.part, values), False

    def _check(self) -> None:
        """Check who came since the last time, before anything that they may have computed is let out."""
        try:
            threads = self._client.nthreads()
            self._workers = max(self._workers, sum(threads.values()))
            if new := set(threads) - self._checked:
                self._checked |= check_workers(self._client, new, self._connection.where)
        except (OSError, concurrent.futures.CancelledError, asyncio.CancelledError):
            raise self._lost() from None

    def _tell_idle(self) -> None:
        idle = not self._client.scheduler_info(n_workers=1)["workers"]
        if idle and not self._told_idle:
            log.warning("waiting for workers of %s ...", self._connection.where)
        self._told_idle = idle

    def _lost(self) -> RunInterrupted:
        return RunInterrupted(
            f"the scheduler of {self._connection.where} is gone; the parts that were done are kept: "
            "run the same command again when there is one"
        )


def _plain(error: BaseException) -> Exception:
    return error if isinstance(error, Exception) else RuntimeError(f"{type(error).__name__}: {error}")


def _killed(error: Any) -> str:
    times = error.allowed_failures + 1
    return (
        f"its worker died {times} times; there may be too little memory: raise execution.memory, use fewer workers or "
        "smaller chunks"
    )

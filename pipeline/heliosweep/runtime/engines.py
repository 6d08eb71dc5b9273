"""The choice of dask's scheduler, and the local ones: one by one, threads, processes."""

from __future__ import annotations

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import dask.multiprocessing
import dask.threaded
import numpy as np

from heliosweep.config.execution import Execution
from heliosweep.errors import HeliosweepError
from heliosweep.families.registry import Family
from heliosweep.grid.evaluate import TASK_MARK
from heliosweep.grid.plan import Plan
from heliosweep.runtime.progress import Progress
from heliosweep.runtime.work import TRIES, Engine, Outcome, Work

if TYPE_CHECKING:
    import xarray as xr

#: Parts that threads compute at a time: the next one fills the cores that the end of the last one leaves free.
IN_FLIGHT = 2

_WORKER_DIED = (
    "a worker process ended before its work was done; a script that runs a study with processes must do so below "
    '`if __name__ == "__main__":`, and there must be memory enough for every worker'
)


def get_ready(execution: Execution, family: Family[Any]) -> None:
    """Begin what an engine takes some time to start, while this process does other things before it needs it.

    Parameters
    ----------
    execution : Execution
        Which engine.
    family : Family
        Of the study that it will compute.
    """
    if execution.scheduler == "distributed":
        from heliosweep.runtime.local_cluster import start_ahead

        start_ahead(f"{type(family).__module__}.model")  # by convention what its blocks need; it may not exist


@contextmanager
def engine(execution: Execution, plan: Plan, progress: Progress) -> Iterator[Engine]:
    """Start the workers that a study asks for, and stop them at the end.

    Nothing is set that another run in this process would see.

    Parameters
    ----------
    execution : Execution
        Which engine, and with how many workers.
    plan : Plan
        The plan of the study.
    progress : Progress
        Is told of every block that is done.

    Yields
    ------
    Engine
    """
    match execution.scheduler:
        case "synchronous":
            yield _InTurn(progress)
        case "threads":
            # Left the other way round: without workers, those who hand out blocks end too.
            with _pool(ThreadPoolExecutor(IN_FLIGHT)) as drivers, _pool(ThreadPoolExecutor(plan.workers)) as workers:
                yield _Threads(progress, drivers, workers)
        case "processes":
            with _Processes(progress, plan.workers) as processes:
                yield processes
        case _:
            from heliosweep.runtime.cluster import cluster_engine

            with cluster_engine(execution, plan, progress) as cluster:
                yield cluster


class _InTurn:
    """One part after the other, one block after the other."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def run(self, works: Iterator[Work]) -> Iterator[Outcome]:
        """Compute all `works`."""
        yield from map(self._attempt, works)

    def _attempt(self, work: Work) -> Outcome:
        """Try to compute a part up to three times."""
        for attempt in range(1, TRIES + 1):
            try:
                return Outcome(work.part, self._values(work.lazy))
            except (HeliosweepError, CancelledError):  # the user's to mend, or the end of the run
                raise
            except Exception as error:
                if attempt == TRIES:
                    return Outcome(work.part, None, error)
                self._repair(error)
        raise AssertionError("tried out")

    def _values(self, lazy: xr.Dataset) -> dict[str, np.ndarray]:
        return _computed(lazy, self._progress, get=dask.get)

    def _repair(self, error: Exception) -> None:
        """Make ready for another try."""


class _Threads(_InTurn):
    """Blocks on the threads of one pool, those of two parts at a time."""

    def __init__(self, progress: Progress, drivers: Executor, workers: Executor) -> None:
        super().__init__(progress)
        self._drivers = drivers  # which only hand out blocks, so that this thread stays free for interruptions
        self._workers = workers

    def run(self, works: Iterator[Work]) -> Iterator[Outcome]:
        """Compute all `works`."""
        pending: deque[Future[Outcome]] = deque()
        for work in works:
            pending.append(self._drivers.submit(self._attempt, work))
            if len(pending) == IN_FLIGHT:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()

    def _values(self, lazy: xr.Dataset) -> dict[str, np.ndarray]:
        return _computed(lazy, self._progress, get=dask.threaded.get, pool=self._workers)


class _Processes(_InTurn):
    """Blocks in worker processes, those of one part at a time: which part killed a worker must be known."""

    def __init__(self, progress: Progress, workers: int) -> None:
        super().__init__(progress)
        self._count = workers
        self._workers = self._started()

    def _started(self) -> ProcessPoolExecutor:
        # Ctrl-C reaches every process of a terminal: this one alone acts on it.
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._count, context, signal.signal, (signal.SIGINT, signal.SIG_IGN))

    def _values(self, lazy: xr.Dataset) -> dict[str, np.ndarray]:
        try:
            return _computed(lazy, self._progress, get=dask.multiprocessing.get, pool=self._workers)
        except BrokenProcessPool:
            raise _WorkerDied(_WORKER_DIED) from None

    def _repair(self, error: Exception) -> None:
        if isinstance(error, _WorkerDied):
            self._workers.shutdown(cancel_futures=True)
            self._workers = self._started()

    def __enter__(self) -> _Processes:
        return self

    def __exit__(self, *_: object) -> None:
        self._workers.shutdown(cancel_futures=True)


class _WorkerDied(Exception):
    """A worker process ended before its work was done."""


@contextmanager
def _pool(pool: Executor) -> Iterator[Executor]:
    """Shut a pool down at the end, without waiting for what it has not begun."""
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _computed(
    lazy: xr.Dataset, progress: Progress, get: Callable[..., Any], pool: Executor | None = None
) -> dict[str, np.ndarray]:
    """Values of all variables, computed in one go by a scheduler of dask; by its name, dask imports distributed."""
    options = {"pool": pool} if pool else {}
    # The five places of a dask callback: start, start_state, pretask, posttask, finish.
    done = lazy.compute(scheduler=get, **options, callbacks=[(None, None, None, _counter(progress), None)])
    return {str(name): array.to_numpy() for name, array in done.data_vars.items()}


def _counter(progress: Progress) -> Callable[..., None]:
    def finished(key: Any, *_: object) -> None:
        if TASK_MARK in str(key[0] if isinstance(key, tuple) else key):
            progress.advance()

    return finished

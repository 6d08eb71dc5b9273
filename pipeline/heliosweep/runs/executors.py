"""Workers that compute chunks: threads, processes, or a dask cluster, behind one loop."""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from functools import lru_cache, partial
from importlib import import_module
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeAlias

from heliosweep import sources
from heliosweep.config.blocks import Execution
from heliosweep.errors import HeliosweepError, Problem, StudyError, reason_of

if TYPE_CHECKING:
    import numpy as np
    from distributed import Client

    from heliosweep.grid.lazy import Work
    from heliosweep.grid.regions import Piece

    Values: TypeAlias = dict[str, np.ndarray]

log = logging.getLogger("heliosweep")

#: Number of times that a chunk is computed before it counts as failed.
TRIES = 2
#: Time to wait for the scheduler of a cluster. [s]
PATIENCE = 10
#: Hint of messages about processes.
_GUARD = 'a script that runs a study with processes must do so below `if __name__ == "__main__":`'


class Workers(ExitStack):
    """Workers of a study; started when the first chunk is computed.

    Parameters
    ----------
    execution : Execution
        Kind of workers.
    count : int
        Number of chunks that are computed at a time.
    """

    def __init__(self, execution: Execution, count: int) -> None:
        super().__init__()
        self.execution, self.count = execution, count
        self._submit: Callable[[Work, Piece], Future[Values]] | None = None

    def compute(self, work: Work, chunks: Iterable[Piece]) -> Iterator[tuple[Piece, Values | Exception]]:
        """Yield chunks in the order in which they are done, with their values or the error of the second try.

        The second try has new workers.
        """
        remaining = list(chunks)
        for attempt in range(TRIES):
            failed = []
            for chunk, outcome in self._once(work, remaining):
                if isinstance(outcome, HeliosweepError):
                    raise outcome
                if isinstance(outcome, Exception) and attempt + 1 < TRIES:
                    log.debug("chunk %s failed, and is tried again: %s", chunk.name, reason_of(outcome))
                    failed.append(chunk)
                else:
                    yield chunk, outcome
            if not (remaining := failed):
                return
            self.close()
            self._submit = None

    def _once(self, work: Work, chunks: Iterable[Piece]) -> Iterator[tuple[Piece, Values | Exception]]:
        """Keep a few chunks submitted, and yield each with its values or its error."""
        waiting = iter(chunks)
        pending: dict[Future[Values], Piece] = {}
        while True:
            while len(pending) < self.count + 2 and (chunk := next(waiting, None)) is not None:
                submit = self._submit = self._submit or self._started()
                try:
                    pending[submit(work, chunk)] = chunk
                except Exception as refusal:  # by a broken pool
                    yield chunk, refusal
            if not pending:
                return
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                error = future.exception()
                if isinstance(error, BaseException) and not isinstance(error, Exception):
                    raise error
                yield pending.pop(future), future.result() if error is None else error

    def _started(self) -> Callable[[Work, Piece], Future[Values]]:
        """Start workers and return a function that submits a chunk to them."""
        name, send = self.execution.scheduler, lru_cache(1)(lambda work: work)
        pool: Executor
        if name in ("synchronous", "threads"):
            pool = ThreadPoolExecutor(1 if name == "synchronous" else self.count)
            self.callback(pool.shutdown, cancel_futures=True)
        elif name == "processes":
            pool, send = _processes(self.count), lru_cache(1)(pickle.dumps)
            self.callback(pool.shutdown, cancel_futures=True)
        else:
            client = self.enter_context(connected(self.execution, self.count))
            _check_workers(client, name)
            pool, send = client.get_executor(), lru_cache(1)(partial(client.scatter, broadcast=True, hash=False))
        return lambda work, chunk: pool.submit(_compute, send(work), chunk)


def _processes(count: int) -> Executor:
    return ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _begin_worker)


def _compute(work: Work | bytes, chunk: Piece) -> Values:
    """Compute a chunk in a worker."""
    return (_unpickled(work) if isinstance(work, bytes) else work).compute(chunk)


@lru_cache(1)
def _unpickled(data: bytes) -> Any:
    return pickle.loads(data)


def _begin_worker() -> None:
    """Ignore Ctrl-C, which reaches all processes of a terminal, and end when the main process is killed."""

    def end_with_parent() -> None:
        if parent := multiprocessing.parent_process():
            parent.join()
            os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_parent, daemon=True).start()


@contextmanager
def connected(execution: Execution, workers: int) -> Iterator[Client]:
    """Connect to the scheduler at an address, or start a cluster. Raises StudyError or HeliosweepError."""
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
                stack.callback(cluster.close, timeout=10)
            client = Client(cluster, timeout=PATIENCE, set_as_default=False)
            stack.callback(client.close, timeout=2)
        except (ImportError, AttributeError, TypeError, ValueError) as error:
            raise StudyError(Problem(f"cannot start: {reason_of(error)}", "execution.cluster")) from None
        except OSError as error:
            problem = f"no dask scheduler answers at {address}; start one there with: dask scheduler ({error})"
            raise StudyError(Problem(problem, "execution.scheduler")) from None
        except RuntimeError as error:
            raise HeliosweepError(f"the workers do not start ({str(error).splitlines()[0]}); {_GUARD}") from None
        if client.dashboard_link:
            log.info("dashboard: %s", client.dashboard_link)
        yield client


def _check_workers(client: Client, name: str) -> None:
    """Raise HeliosweepError if a worker has other versions of code that numbers depend on."""
    own = sources.code_versions()
    for worker, answer in client.run(sources.code_versions, on_error="return").items():
        if isinstance(answer, OSError):
            continue  # it left
        if isinstance(answer, Exception):
            raise HeliosweepError(
                f"worker {worker} of {name} cannot run heliosweep ({reason_of(answer)}); install the same version there"
            )
        if other := [key for key in own if own[key] != answer.get(key)]:
            details = ", ".join(f"{key} {answer.get(key)} instead of {own[key]}" for key in other)
            raise HeliosweepError(
                f"worker {worker} of {name} has other versions: {details}; numbers could differ. Install the same "
                "versions there and restart its workers"
            )


def explain_failure(error: Exception) -> str:
    """Return the reason of a failed chunk, with a hint if a worker process ended."""
    if type(error).__name__ in ("BrokenProcessPool", "KilledWorker"):
        return f"a worker process ended before its work was done; {_GUARD}, and each worker needs enough memory"
    return reason_of(error)

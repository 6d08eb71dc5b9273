"""Where parts are computed: in turn, by threads, by processes, by a dask cluster; one loop hands them out to any."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import queue
import signal
import subprocess
import tempfile
import threading
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from heliosweep.errors import HeliosweepError
from heliosweep.grid.lazy import Work
from heliosweep.grid.regions import Part

if TYPE_CHECKING:
    from multiprocessing.context import BaseContext

    import numpy as np

    Values = dict[str, np.ndarray]

#: How often a part is tried before it counts as failed.
TRIES = 3
#: How often a pool is looked after while nothing comes from it. [s]
LOOK_SECONDS = 1.0
#: How long workers may take to end before they are killed: one that waits for what a dead one held never ends. [s]
END_SECONDS = 10.0
#: Letters that the name of a socket may have.
SOCKET_LETTERS = 104
#: Variable of the environment with which Python imports nothing that lies in the working directory.
SAFE_PATH = "PYTHONSAFEPATH"


@dataclass(frozen=True)
class Outcome:
    """What came of a part: its values, or the error of its last try."""

    part: Part
    values: Values | None
    error: Exception | None = None


class WorkerDied(Exception):
    """A worker ended before its part was done, so many times; the part, or another of that worker, may be the cause."""

    def __init__(self, message: str, times: int = 1) -> None:
        super().__init__(message)
        self.times = times


class Pool:
    """Workers that compute parts: here those of an executor of this process; without one, the thread that asks.

    `room` is how many parts may be handed out at a time.
    """

    def __init__(self, executor: Executor | None, work: Work, room: int) -> None:
        self._executor, self._work, self.room = executor, work, room

    def submit(self, part: Part) -> Any:
        """Hand out a part; a future as of `concurrent.futures`."""
        if self._executor:
            return self._executor.submit(self._work.compute, part)
        future: Future[Values] = Future()
        try:
            future.set_result(self._work.compute(part))
        except Exception as error:
            future.set_exception(error)
        return future

    def result(self, future: Any) -> Values:
        """Values of a part that is done. Raises WorkerDied, RunInterrupted, or what computing raised."""
        values: Values = future.result()
        return values

    def look(self) -> None:
        """Look after the workers while nothing comes from them; threads and processes need no care. May raise."""

    def close(self) -> None:
        """End the workers; what they have not begun is not waited for."""
        if self._executor:
            self._executor.shutdown(cancel_futures=True)


def compute_parts(pool: Pool, parts: Iterator[Part]) -> Iterator[Outcome]:
    """Compute parts on the workers of a pool; they are taken as there is room, and come back in any order.

    A part is tried three times. Parts that were at work when a worker died are tried again alone, at the end, so that
    the one that kills workers is known and the others come through. Raises HeliosweepError for what the user has to
    mend: it would befall all parts.
    """
    done: queue.SimpleQueue[Any] = queue.SimpleQueue()
    flight: dict[Any, tuple[Part, int]] = {}
    suspects: deque[tuple[Part, int]] = deque()

    def submit(part: Part, tries: int) -> None:
        future = pool.submit(part)
        flight[future] = part, tries + 1
        future.add_done_callback(done.put)

    following = next(parts, None)
    while following or flight or suspects:
        while following and len(flight) < pool.room:
            submit(following, 0)
            following = next(parts, None)
        alone = not following and not flight
        if alone:
            submit(*suspects.popleft())
        future = _next_done(pool, done)
        part, tries = flight.pop(future)
        try:
            yield Outcome(part, pool.result(future))
        except (HeliosweepError, CancelledError):
            raise
        except WorkerDied as error:
            tries += error.times - 1
            if alone and tries >= TRIES:
                yield Outcome(part, None, error)
            else:
                suspects.append((part, tries if alone else 0))
        except Exception as error:
            if tries < TRIES:
                submit(part, tries)
            else:
                yield Outcome(part, None, error)
        del future


def _next_done(pool: Pool, done: queue.SimpleQueue[Any]) -> Any:
    while True:
        try:
            return done.get(timeout=LOOK_SECONDS)
        except queue.Empty:
            pool.look()


_safety = threading.Lock()
_safe_runs, _unsafe_value = 0, os.environ.get(SAFE_PATH)
"""Runs in this process that have asked for a safe path, and what the variable was before the first."""


@contextmanager
def safe_path() -> Iterator[None]:
    """Let the Python processes that are started in the context import nothing that lies in the working directory."""
    global _safe_runs, _unsafe_value
    with _safety:
        if _safe_runs == 0:
            _unsafe_value = os.environ.get(SAFE_PATH)
        _safe_runs += 1
        os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        with _safety:
            _safe_runs -= 1
            if _safe_runs == 0 and _unsafe_value is None:
                os.environ.pop(SAFE_PATH, None)
            elif _safe_runs == 0:
                os.environ[SAFE_PATH] = str(_unsafe_value)


@contextmanager
def local_pool(scheduler: str, work: Work, workers: int) -> Iterator[Pool]:
    """Start workers of this machine (``synchronous``, ``threads`` or ``processes``), and stop them at the end."""
    if scheduler == "synchronous":
        yield Pool(None, work, 1)
        return
    threads = scheduler == "threads"
    pool = Pool(ThreadPoolExecutor(workers), work, workers + 2) if threads else _Processes(work, workers)
    try:
        yield pool
    finally:
        pool.close()


class _Processes(Pool):
    """Worker processes of this machine."""

    _executor: ProcessPoolExecutor

    def __init__(self, work: Work, workers: int) -> None:
        self._data, self._count = pickle.dumps(work), workers
        super().__init__(self._begun(), work, workers + 2)

    def _begun(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._count, forking_context(), _receive, (self._data,))

    def submit(self, part: Part) -> Future[Values]:
        try:
            return self._executor.submit(_compute, part)
        except BrokenProcessPool:  # all that it had at work is redone; its workers are not
            self._executor.shutdown(wait=False, cancel_futures=True)
            self._executor = self._begun()
            return self._executor.submit(_compute, part)

    def close(self) -> None:
        workers = list((self._executor._processes or {}).values())

        def kill() -> None:
            for worker in workers:
                worker.kill()

        late = threading.Timer(END_SECONDS, kill)
        late.start()
        try:
            super().close()
        finally:
            late.cancel()

    def result(self, future: Future[Values]) -> Values:
        try:
            return future.result()
        except BrokenProcessPool:
            raise WorkerDied(
                "a worker process ended before its work was done; a script that runs a study with processes must do "
                'so below `if __name__ == "__main__":`, and there must be memory enough for every worker'
            ) from None


def forking_context() -> BaseContext:
    """How worker processes are started: forked from one that has imported what they need, where the system can."""
    # Some folders for temporary files have too long a name for a socket in them.
    room = len(os.fsencode(tempfile.gettempdir())) + len("/pymp-________/listener-________") < SOCKET_LETTERS
    if "forkserver" not in multiprocessing.get_all_start_methods() or not room:
        return multiprocessing.get_context("spawn")
    from multiprocessing import forkserver, resource_tracker, util
    from unittest import mock

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([f"{__package__}.forked", __name__, "heliosweep.kernels.compiled"])
    with mock.patch.object(util, "spawnv_passfds", _in_its_own_group):
        resource_tracker.ensure_running()
        forkserver.ensure_running()
    return context


def _in_its_own_group(path: bytes, arguments: Sequence[str], kept: Iterable[int]) -> int:
    """Start a process that no signal to the group of this one reaches: what this one leaves it can then remove."""
    process = subprocess.Popen(arguments, executable=path, pass_fds=tuple(kept), process_group=0)
    process.returncode = 0  # whoever asked for it waits for its end
    return process.pid


_received: Work


def _receive(data: bytes) -> None:
    """Take over what is computed; Ctrl-C and a closed terminal reach every process, and the main one acts on them."""
    global _received
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _received = pickle.loads(data)


def _end_with_parent() -> None:
    """End this process when the one that hands out parts was killed: of itself it would wait for the next forever."""
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)


def _compute(part: Part) -> Values:
    return _received.compute(part)

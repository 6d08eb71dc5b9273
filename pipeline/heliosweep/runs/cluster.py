"""Workers of dask.distributed: a cluster of this machine, one by its address, or jobs of a job queue."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import os
import pickle
import signal
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.config.execution import QUEUES
from heliosweep.errors import HeliosweepError, Problem, RunInterrupted, StudyError
from heliosweep.grid.lazy import Work
from heliosweep.grid.regions import Part
from heliosweep.kernels import compiled
from heliosweep.runs.executors import Pool, WorkerDied, forking_context
from heliosweep.runs.jobs import WORKER_SETTINGS, dashboard_link, free_dashboard, job_queue, only_ours
from heliosweep.runs.signals import TidyStack, interruptions_blocked
from heliosweep.sources import code_versions

if TYPE_CHECKING:
    from distributed import Client

    from heliosweep.config.execution import Execution
    from heliosweep.runs.executors import Values

log = logging.getLogger("heliosweep")

#: After so long a scheduler that does not answer counts as unreachable. [s]
PATIENCE = 8
#: Parts handed out for each worker, so that none waits for the next.
PARTS_PER_WORKER = 3
#: A worker process gets no less memory. [bytes]
LEAST_MEMORY = 512 * 2**20

#: How often workers that are importing are asked again, a second apart.
IMPORT_TRIES = 20

_NOISY = ("distributed", "tornado", "asyncio")
_COMM_SETTINGS = {
    "distributed.comm.timeouts.connect": f"{PATIENCE}s",
    "distributed.comm.timeouts.tcp": "12s",  # of silence; less is refused
    "distributed.admin.large-graph-warning-threshold": "1GB",
}


def worker_count(execution: Execution, *, connect: bool) -> int | None:
    """Number of workers of a cluster that is not of this machine, for the plan; None where they are its own.

    A scheduler that is given by its address counts as having one worker, unless `connect`: then it is asked. Raises
    StudyError where it cannot be reached.
    """
    if "://" in execution.scheduler:
        return execution.workers or (max(1, _reachable_threads(execution.scheduler)) if connect else 1)
    if execution.scheduler in QUEUES:
        return execution.workers or (execution.job.cores if execution.job else 1)
    return None


@contextmanager
def cluster_pool(execution: Execution, work: Work, workers: int, folder: Path) -> Iterator[_Cluster]:
    """Connect to the cluster that a study asks for, or start it, and leave it at the end.

    The scheduler is ``distributed``, an address or a job queue; so many workers are started. Schedulers and workers of
    this machine may write to `folder`. Raises StudyError where the scheduler cannot be reached, or the job queue not be
    used, and HeliosweepError where workers do not start, or run other versions than this process.
    """
    import dask

    with TidyStack() as stack:
        stack.callback(sys.path.__setitem__, slice(None), list(sys.path))  # to which a scheduler adds its folder
        stack.enter_context(_quiet())
        stack.enter_context(dask.config.set(_COMM_SETTINGS))
        if "://" in execution.scheduler:
            client, where = stack.enter_context(_client(execution.scheduler)), execution.scheduler
            yield _Cluster(client, where, work, workers)
            return
        stack.enter_context(dask.config.set(WORKER_SETTINGS))
        if execution.scheduler in QUEUES:
            cluster, look_after = stack.enter_context(job_queue(execution, execution.workers or workers, folder))
            client = stack.enter_context(_client(cluster))
            yield _Cluster(client, f"the job queue {execution.scheduler}", work, workers, look_after)
        else:
            cluster = stack.enter_context(_local_cluster(workers, execution.memory, folder))
            yield _Cluster(stack.enter_context(_client(cluster)), "the local cluster", work, workers)


class _Cluster(Pool):
    """Workers behind a client of dask.distributed.

    What is computed is sent to the scheduler once, as the argument of a task, so that it survives any worker.
    """

    def __init__(
        self, client: Any, where: str, work: Work, workers: int, look_after: Callable[[], None] = lambda: None
    ) -> None:
        super().__init__(None, work, 2 + PARTS_PER_WORKER * workers)
        self._client, self._where, self._look_after = client, where, look_after
        self._module = work.module
        self._token = versions_token(self._module)
        self._told_idle, self._counted = False, 0.0
        self._count()
        check_workers(client, where, self._module)
        self._run, self._number = uuid.uuid4().hex, 0
        self._work = client.submit(pickle.loads, pickle.dumps(work), key=f"study-{self._run}")

    def submit(self, part: Part) -> Any:
        """Hand out a part, by a name of its own: an earlier one stands for the failure of an earlier try."""
        self._number += 1
        key = (f"part-{self._run}", self._number)
        return self._client.submit(_compute, self._work, part, key=key, pure=False)

    def result(self, future: Any) -> Values:
        """Values of a part."""
        from distributed.scheduler import KilledWorker

        try:
            values, token = future.result()
        except KilledWorker as error:
            raise WorkerDied(
                "its worker died, every time; there may be too little memory: raise execution.memory, use fewer "
                "workers or smaller chunks",
                error.allowed_failures + 1,
            ) from None
        except (CancelledError, asyncio.CancelledError, OSError, TimeoutError) as error:
            if future.status == "error" and self._client.status == "running":  # of the computation
                raise (error if isinstance(error, Exception) else RuntimeError(repr(error))) from None
            raise self._lost() from None
        if token != self._token:  # of a worker that came since the start
            check_workers(self._client, self._where, self._module)
            raise HeliosweepError(f"a worker of {self._where} computed with other versions and is gone; run again")
        self._count()
        return values

    def look(self) -> None:
        """Look after the cluster while nothing comes from it."""
        if self._client.status != "running":
            raise self._lost()
        self._look_after()
        idle = not self._client.scheduler_info(n_workers=1)["workers"]
        if idle and not self._told_idle:
            log.warning("waiting for workers of %s ...", self._where)
        self._told_idle = idle

    def _count(self) -> None:
        """Count the workers anew, at most once a second."""
        if time.monotonic() - self._counted < 1.0:
            return
        try:
            self.room = max(self.room, 2 + PARTS_PER_WORKER * sum(self._client.nthreads().values()))
        except (OSError, CancelledError, asyncio.CancelledError):
            raise self._lost() from None
        self._counted = time.monotonic()

    def _lost(self) -> RunInterrupted:
        return RunInterrupted(
            f"the scheduler of {self._where} is gone; the parts that were done are kept: "
            "run the same command again when there is one"
        )


def _compute(work: Work, part: Part) -> tuple[Values, str]:
    """Values of a part, and what stands for the versions that they were computed with."""
    return work.compute(part), versions_token(work.module)


@contextmanager
def _local_cluster(workers: int, memory: int | None, folder: Path) -> Iterator[Any]:
    """Worker processes of this machine, one thread each, that nobody else can reach."""
    import dask
    from distributed import LocalCluster
    from distributed.system import MEMORY_LIMIT

    method = forking_context().get_start_method()
    settings = {
        "distributed.worker.multiprocessing-method": method,
        "distributed.nanny.pre-spawn-environ": {},
    }
    limit = max((memory or MEMORY_LIMIT) // workers, LEAST_MEMORY)
    security, secret = only_ours(folder)
    with dask.config.set(settings):
        try:
            with free_dashboard("127.0.0.1", secret) as dashboard, interruptions_blocked():
                cluster = LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    memory_limit=limit,
                    dashboard_address=dashboard,
                    silence_logs=logging.CRITICAL,
                    local_directory=str(folder),
                    protocol="tls://",
                    security=security,
                    scheduler_kwargs={"local_directory": str(folder), "http_prefix": secret},
                )
        except RuntimeError as error:
            raise HeliosweepError(
                f"the workers of the local cluster do not start ({str(error).splitlines()[0]}); a script that runs a "
                'study with them must do so below `if __name__ == "__main__":`'
            ) from None
        try:
            log.info("dashboard: %s", dashboard_link(cluster, secret))
            yield cluster
        finally:
            _end(cluster)


def _end(cluster: Any) -> None:
    """End the workers at once: what they still compute nobody waits for."""
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
        if nanny.pid:
            with suppress(ProcessLookupError):
                os.kill(nanny.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
    with suppress(TimeoutError):
        cluster.close(timeout=10)


def _reachable_threads(address: str) -> int:
    """Threads of all workers of the scheduler at an address. Raises StudyError where it cannot be reached."""
    import dask

    with _quiet(), dask.config.set(_COMM_SETTINGS), _client(address) as client:
        return sum(client.nthreads().values())


@contextmanager
def _client(cluster: Any) -> Iterator[Any]:
    from distributed import Client

    try:
        if isinstance(cluster, str):
            _shake_hands(cluster)
        client = Client(cluster, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        if not isinstance(cluster, str):
            raise
        raise StudyError(Problem(_unreachable(cluster, error), "execution.scheduler")) from None
    try:
        yield client
    finally:
        with suppress(OSError, TimeoutError):
            client.close(timeout=2)


def _shake_hands(address: str) -> None:
    """Find out whether a scheduler answers: a client would wait forever for a silent program. Raises OSError."""
    from distributed.comm import connect
    from distributed.security import Security

    async def shake() -> None:
        options = Security().get_connection_args("client")
        comm = await asyncio.wait_for(connect(address, timeout=PATIENCE, **options), PATIENCE + 1)
        comm.abort()

    answer: Future[None] = Future()

    def ask() -> None:
        try:
            answer.set_result(asyncio.run(shake()))
        except BaseException as error:
            answer.set_exception(error)

    # Not in this thread, which may have a loop of its own, as in a notebook.
    threading.Thread(target=ask, daemon=True).start()
    try:
        answer.result()
    except TimeoutError:
        raise OSError(f"something listens there, but said nothing in {PATIENCE} s") from None


def _unreachable(address: str, error: Exception) -> str:
    protocol, place = address.split("://")
    if protocol == "tls":
        from distributed.security import Security

        config = Security().get_tls_config_for_role("client")
        missing = [name for name in ("ca_file", "cert", "key") if not config[name]]
        if missing:
            return (
                f"{address} needs certificates, and dask is configured without; name the files in the keys "
                "distributed.comm.tls.ca-file, distributed.comm.tls.client.cert and distributed.comm.tls.client.key of "
                "~/.config/dask/distributed.yaml, or as DASK_DISTRIBUTED__COMM__TLS__CA_FILE and so on"
            )
        hint = "; does it run, and do the certificates that dask is configured with belong to it?"
    else:
        port = place.rpartition(":")[2]
        hint = f"; start one there with: dask scheduler --port {port}"
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    return f"no dask scheduler answers at {address}{hint} ({reason})"


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the log of distributed from standard error: what matters is told by exceptions."""
    import distributed  # noqa: F401  # sets levels of its own

    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in _NOISY]
    levels = {logger: logger.level for logger in map(logging.getLogger, {*_NOISY, *names})}
    for logger in levels:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in levels.items():
            logger.setLevel(level)


@cache
def versions(module: str) -> dict[str, str]:
    """Versions in this process of everything that the numbers of a module depend on."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return {"python": python, **code_versions(module), "kernels": "plain" if compiled.PURE_PYTHON else "compiled"}


@cache
def versions_token(module: str) -> str:
    """Digest of `versions`."""
    return hashlib.sha256(repr(sorted(versions(module).items())).encode()).hexdigest()[:16]


def check_workers(client: Client, where: str, module: str) -> None:
    """Ask the workers of a cluster for their versions of what the numbers of a module depend on.

    `where` is what the cluster is called in messages. Raises HeliosweepError where a worker has other versions than
    this process, with which numbers may change, or cannot run heliosweep.
    """
    own, answers = versions(module), client.run(versions, module, on_error="return")
    for _ in range(IMPORT_TRIES):  # while another thread of a worker imports the same packages
        if not any("partially initialized" in str(answer) for answer in answers.values()):
            break
        time.sleep(1.0)
        answers = client.run(versions, module, on_error="return")
    for worker, answer in answers.items():
        if isinstance(answer, OSError):
            continue  # it left
        if isinstance(answer, Exception):
            raise HeliosweepError(
                f"worker {worker} of {where} cannot run heliosweep ({type(answer).__name__}: {answer}); "
                "install the same version there"
            )
        other = [name for name in {**own, **answer} if own.get(name) != answer.get(name)]
        if other:
            told = ", ".join(f"{name} {answer.get(name, 'missing')} instead of {own.get(name)}" for name in other)
            raise HeliosweepError(
                f"worker {worker} of {where} would compute with other versions: {told}; numbers could differ. "
                "Install the same versions there and start its workers again"
            )

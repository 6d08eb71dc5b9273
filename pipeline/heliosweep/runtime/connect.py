"""Clusters of dask.distributed: one of this machine is started, one that runs is connected to."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from heliosweep.config.execution import QUEUES
from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.runtime.scratch import scratch
from heliosweep.runtime.signals import TidyStack

if TYPE_CHECKING:
    from distributed import Client

    from heliosweep.config.blocks import Execution

log = logging.getLogger("heliosweep")

#: After so long a scheduler that does not answer counts as unreachable. [s]
PATIENCE = 8
#: A worker process gets no less memory. [bytes]
LEAST_MEMORY = 512 * 2**20
#: Where the dashboard stands if that port is free.
DASHBOARD_PORT = 8787
#: A task whose worker dies more often has failed.
ALLOWED_FAILURES = 2

#: What workers need, imported once for all of them.
_IMPORTS = (
    "distributed", "xarray", "numba", "scipy", "pvlib", "heliosweep.workflow", "heliosweep.runtime.versions",
    "heliosweep.kernels.warm",
)  # fmt: skip

#: Nothing is read back from disk: values on workers stay in memory, and are few.
WORKER_SETTINGS: dict[str, Any] = {
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.profile.enabled": False,
    "distributed.scheduler.allowed-failures": ALLOWED_FAILURES,
}
_NOISY = ("distributed", "tornado", "asyncio")
_COMM_SETTINGS = {
    "distributed.comm.timeouts.connect": f"{PATIENCE}s",
    "distributed.comm.timeouts.tcp": "12s",  # of silence; less is refused
    "distributed.admin.large-graph-warning-threshold": "1GB",
}


@dataclass(frozen=True)
class Connection:
    """A cluster that takes work.

    Parameters
    ----------
    client : distributed.Client
        Connected to its scheduler.
    where : str
        What it is called in messages.
    look_after : callable
        Called now and then while work is waited for; may raise.
    """

    client: Client
    where: str
    look_after: Callable[[], None] = lambda: None


@contextmanager
def connected(execution: Execution, workers: int) -> Iterator[Connection]:
    """Connect to the cluster that a study asks for, and start it where it is one's own.

    Parameters
    ----------
    execution : Execution
        With a `scheduler` that is ``distributed``, an address or a job queue.
    workers : int
        How many workers to start.

    Yields
    ------
    Connection

    Raises
    ------
    StudyError
        Where the scheduler cannot be reached, or the job queue not be used.
    HeliosweepError
        Where workers cannot be started.
    """
    import dask

    with TidyStack() as stack:
        stack.callback(sys.path.__setitem__, slice(None), list(sys.path))  # to which a scheduler adds its folder
        stack.enter_context(_quiet())
        stack.enter_context(dask.config.set(_COMM_SETTINGS))
        if "://" in execution.scheduler:
            yield Connection(stack.enter_context(_client(execution.scheduler)), execution.scheduler)
        elif execution.scheduler in QUEUES:
            from heliosweep.runtime.jobs import job_queue

            stack.enter_context(dask.config.set(WORKER_SETTINGS))
            cluster, look_after = stack.enter_context(job_queue(execution, workers))
            client = stack.enter_context(_client(cluster))
            yield Connection(client, f"the job queue {execution.scheduler}", look_after)
        else:
            stack.enter_context(dask.config.set(WORKER_SETTINGS))
            cluster = stack.enter_context(_local(workers, execution.memory))
            yield Connection(stack.enter_context(_client(cluster)), "the local cluster")


def reachable_threads(address: str) -> int:
    """Threads of all workers of the scheduler at an address. Raises StudyError where it cannot be reached."""
    import dask

    with _quiet(), dask.config.set(_COMM_SETTINGS), _client(address) as client:
        return sum(client.nthreads().values())


@contextmanager
def _client(cluster: Any) -> Iterator[Client]:
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

    def work() -> None:
        try:
            answer.set_result(asyncio.run(shake()))
        except BaseException as error:
            answer.set_exception(error)

    # Not in this thread, which may have a loop of its own, as in a notebook.
    threading.Thread(target=work, daemon=True).start()
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
def _local(workers: int, memory: int | None) -> Iterator[Any]:
    """Worker processes of this machine, one thread each, that nobody outside it can reach."""
    from distributed import LocalCluster
    from distributed.system import MEMORY_LIMIT

    limit = max((memory or MEMORY_LIMIT) // workers, LEAST_MEMORY)
    with ExitStack() as stack:
        folder = stack.enter_context(scratch())
        try:
            stack.enter_context(_forked())
            with _interruptions_blocked():
                cluster = LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    memory_limit=limit,
                    dashboard_address=free_dashboard("127.0.0.1"),
                    silence_logs=logging.CRITICAL,
                    local_directory=folder,
                    scheduler_kwargs={"local_directory": folder},
                )
        except RuntimeError as error:
            raise HeliosweepError(
                f"the workers of the local cluster do not start ({str(error).splitlines()[0]}); a script that runs a "
                'study with them must do so below `if __name__ == "__main__":`'
            ) from None
        stack.callback(_close, cluster)
        log.info("dashboard: %s", cluster.dashboard_link)
        yield cluster


@contextmanager
def _forked() -> Iterator[None]:
    """Start workers, also those that replace others, from one process that has imported all they need."""
    import multiprocessing

    import dask
    from distributed.utils import get_mp_context

    if "forkserver" not in multiprocessing.get_all_start_methods():
        yield
        return
    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}):
        get_mp_context().set_forkserver_preload(list(_IMPORTS))
        yield


def _close(cluster: Any) -> None:
    """End the workers at once: what they still compute nobody waits for."""
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
        if nanny.pid:
            with suppress(ProcessLookupError):
                os.kill(nanny.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
    with suppress(TimeoutError):
        cluster.close(timeout=10)


def free_dashboard(host: str) -> str:
    """Address for a dashboard: the usual port where it is free, else any."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, DASHBOARD_PORT))
        except OSError:
            return f"{host}:0"
    return f"{host}:{DASHBOARD_PORT}"


@contextmanager
def _interruptions_blocked() -> Iterator[None]:
    """Hand on blocked signals to threads, and by them to processes, that are started meanwhile.

    Ctrl-C reaches every process of a terminal: this one alone acts on it, when the context is left.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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

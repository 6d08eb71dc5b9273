"""Connections to clusters of dask.distributed: to one of this machine, to one that runs, to jobs of a queue."""

from __future__ import annotations

import asyncio
import logging
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from heliosweep.config.execution import QUEUES
from heliosweep.errors import Problem, StudyError
from heliosweep.runtime.local_cluster import local_cluster
from heliosweep.runtime.signals import TidyStack

if TYPE_CHECKING:
    from distributed import Client

    from heliosweep.config.blocks import Execution

log = logging.getLogger("heliosweep")

#: After so long a scheduler that does not answer counts as unreachable. [s]
PATIENCE = 8
#: A task whose worker dies more often has failed.
ALLOWED_FAILURES = 2

#: Nothing is read back from disk: values on workers stay in memory, and are few.
WORKER_SETTINGS: dict[str, Any] = {
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.profile.enabled": False,
    "distributed.scheduler.allowed-failures": ALLOWED_FAILURES,
    # Blocks that wait for large constants are handed out as all others: one by one, so that all workers end together.
    "distributed.scheduler.rootish-taskgroup-dependencies": 1000,
    # Of itself distributed wakes up every 20 ms for every scheduler, nanny, worker and client, on the workers' cores.
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "2s",
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
            cluster = stack.enter_context(local_cluster(workers, execution.memory))
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

"""A cluster of this machine alone: worker processes that are forked from one that has imported what they need."""

from __future__ import annotations

import logging
import os
import signal
import socket
import sys
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

from heliosweep.errors import HeliosweepError
from heliosweep.runtime.scratch import scratch
from heliosweep.runtime.signals import uninterrupted

log = logging.getLogger("heliosweep")

#: A worker process gets no less memory. [bytes]
LEAST_MEMORY = 512 * 2**20
#: Where the dashboard stands if that port is free.
DASHBOARD_PORT = 8787


def start_ahead(*modules: str) -> bool:
    """Start the process that workers are forked from: it imports what they need while this one goes on.

    Parameters
    ----------
    *modules : str
        What they need that this process has not yet imported.

    Returns
    -------
    bool
        Whether there is one: not where the system cannot fork, nor where the folder for temporary files has so long a
        name that no socket can stand in it.
    """
    import multiprocessing

    if "forkserver" not in multiprocessing.get_all_start_methods():
        return False
    from multiprocessing import forkserver, resource_tracker

    with _interruptions_blocked():
        resource_tracker.ensure_running()  # it unblocks Ctrl-C once it runs, and would do so below
    with _interruptions_blocked():
        forkserver.set_forkserver_preload(_needed(*modules))
        try:
            forkserver.ensure_running()
        except OSError as error:
            log.debug("workers are started one by one: %s", error)
            return False
    return True


def end_ahead() -> None:
    """End the process of `start_ahead`, if there is one: it keeps memory, and standard output open."""
    forkserver = sys.modules.get("multiprocessing.forkserver")
    pid = getattr(getattr(forkserver, "_forkserver", None), "_forkserver_pid", None)
    if forkserver and pid:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)  # type: ignore[attr-defined, unused-ignore]  # no such signal on Windows
        forkserver._forkserver._stop()


def _needed(*modules: str) -> list[str]:
    """What workers need: what this process has imported of our own, `modules`, and the libraries."""
    ours = [name for name in sys.modules if name.partition(".")[0] == "heliosweep"]
    return ["heliosweep.runtime.preloading", *ours, *modules, "heliosweep.runtime.preloaded"]


@contextmanager
def local_cluster(workers: int, memory: int | None) -> Iterator[Any]:
    """Worker processes of this machine, one thread each, that nobody outside it can reach."""
    forked = start_ahead()
    from distributed import LocalCluster
    from distributed.system import MEMORY_LIMIT

    limit = max((memory or MEMORY_LIMIT) // workers, LEAST_MEMORY)
    with ExitStack() as stack:
        folder = stack.enter_context(scratch())
        try:
            stack.enter_context(_started(forked))
            with free_dashboard("127.0.0.1") as dashboard, _interruptions_blocked():
                cluster = LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    memory_limit=limit,
                    dashboard_address=dashboard,
                    silence_logs=logging.CRITICAL,
                    local_directory=folder,
                    scheduler_kwargs={"local_directory": folder, "dashboard": False},
                )
                stack.callback(_close, cluster)
        except RuntimeError as error:
            raise HeliosweepError(
                f"the workers of the local cluster do not start ({str(error).splitlines()[0]}); a script that runs a "
                'study with them must do so below `if __name__ == "__main__":`'
            ) from None
        _offer_dashboard(cluster.scheduler)
        log.info("dashboard: %s", cluster.dashboard_link)
        yield cluster


@contextmanager
def _started(forked: bool) -> Iterator[None]:
    """Fork workers, also those that replace others, from the process of `start_ahead`; or start each by itself."""
    import dask
    from distributed.utils import get_mp_context

    method = "forkserver" if forked else "spawn"
    with dask.config.set({"distributed.worker.multiprocessing-method": method}):
        if forked:
            get_mp_context().set_forkserver_preload(_needed())  # in place of distributed's own choice
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


def _offer_dashboard(scheduler: Any) -> None:
    """Let a scheduler import what shows its dashboard, which takes as long as its start, when somebody looks at it."""
    from tornado.web import Application

    pages = scheduler.http_application

    class Dashboard(Application):
        def find_handler(self, request: Any, **options: Any) -> Any:
            if self in pages.applications:
                pages.applications.remove(self)
                with suppress(ImportError):  # there is no bokeh
                    from distributed.dashboard.scheduler import connect

                    connect(pages, scheduler.http_server, scheduler, prefix="/")
            return pages.find_handler(request, **options)

    pages.add_application(Dashboard())


@contextmanager
def free_dashboard(host: str) -> Iterator[str]:
    """Address for a dashboard that is started in the context: the usual port where it is free, else any."""
    address = f"{host}:{DASHBOARD_PORT}"
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, DASHBOARD_PORT))
        except OSError:
            address = f"{host}:0"
    with warnings.catch_warnings():  # another run may take the port first: then distributed takes any, and warns
        warnings.filterwarnings("ignore", "Port .* is already in use", UserWarning)
        yield address


@contextmanager
def _interruptions_blocked() -> Iterator[None]:
    """Hand on blocked signals to threads, and by them to processes, that are started meanwhile.

    Ctrl-C reaches every process of a terminal: this one alone acts on it, when the context is left. (Blocked here, a
    signal may come by way of another thread.)
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        with uninterrupted():
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

"""Clusters whose workers are jobs of a job queue, through dask-jobqueue."""

from __future__ import annotations

import logging
import os
import secrets
import shlex
import shutil
import signal
import socket
import subprocess
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

from heliosweep.config.execution import Job
from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.runs.executors import SAFE_PATH

if TYPE_CHECKING:
    from heliosweep.config.blocks import Execution

log = logging.getLogger("heliosweep")

#: Where the dashboard stands if that port is free.
DASHBOARD_PORT = 8787
#: Nothing is read back from disk: values on workers stay in memory, and are few.
WORKER_SETTINGS: dict[str, Any] = {
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.profile.enabled": False,
    "distributed.scheduler.allowed-failures": 0,  # parts are tried again here, and alone
    "distributed.worker.http.routes": [],  # pages of single workers, which anybody could read
    # Of itself distributed wakes up every 20 ms for every scheduler, nanny, worker and client, on the workers' cores.
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "2s",
}
#: Jobs that ended are submitted again, at most so often. [s]
RENEWAL_SECONDS = 20.0

#: Held while a scheduler starts, of which there may be several in a process.
_starting = threading.Lock()

_CLUSTERS = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "htcondor": "HTCondorCluster",
    "oar": "OARCluster",
}
#: Whom the queue calls project instead of account.
_PROJECT = ("sge", "lsf", "oar")


@contextmanager
def job_queue(execution: Execution, workers: int, folder: Path) -> Iterator[tuple[Any, Callable[[], None]]]:
    """Submit the jobs of a queue that hold so many workers, one a core, and cancel them at the end.

    A scheduler, and workers of this machine, may write to `folder`. Yields the cluster, and what is to be called now
    and then: it submits jobs again that ended, and raises HeliosweepError where the queue refuses. Raises StudyError
    where dask-jobqueue or the queue's commands are not installed.
    """
    import dask
    from distributed.utils import get_ip

    job, certificates = execution.job or Job(), str(folder.absolute())
    if shlex.quote(certificates) != certificates:
        problem = (
            f"the certificates of its workers would lie in {folder.absolute()}, which a job script cannot name: run in "
            "a folder, and name a study, with letters, digits, and - _ . / only, or name another with --output"
        )
        raise StudyError(Problem(problem, "execution.scheduler"))
    jobs = -(-workers // job.cores)
    refusals: list[str] = []
    cluster_class, job_class = _classes(execution.scheduler, refusals)
    _check_command(execution.scheduler, job_class)
    with ExitStack() as stack:
        local = execution.scheduler == "local-jobs"
        options = _job_options(execution.scheduler, job)
        options["local_directory"] = str(folder) if local else "${TMPDIR:-/tmp}"  # read by the shell of the job
        security, secret = only_ours(folder)
        scheduler = {"local_directory": str(folder), "http_prefix": secret}
        known = dask.config.get(f"jobqueue.{execution.scheduler}.interface", None)
        if local or not (job.interface or known):
            scheduler["host"] = "127.0.0.1" if local else get_ip()
        try:
            with free_dashboard("127.0.0.1", secret) as dashboard:
                cluster = cluster_class(
                    job_cls=job_class,
                    scheduler_options={"dashboard_address": dashboard, **scheduler},
                    security=security,
                    silence_logs=logging.CRITICAL,
                    **options,
                )
        except (OSError, ValueError, RuntimeError) as error:
            problem = f"the job queue cannot be used: {str(error).splitlines()[0]}"
            raise StudyError(Problem(problem, "execution.scheduler")) from None
        stack.callback(_close, cluster)
        log.info("dashboard: %s", dashboard_link(cluster, secret))
        cluster.scale(jobs=jobs)
        renewal = time.monotonic() + RENEWAL_SECONDS

        def look_after() -> None:
            nonlocal renewal
            if refusals:
                raise HeliosweepError(f"the job queue refused a job: {refusals[0]}")
            if time.monotonic() >= renewal:
                renewal = time.monotonic() + RENEWAL_SECONDS
                cluster.scale(jobs=jobs)  # submits those again that are gone

        yield cluster, look_after


def _classes(name: str, refusals: list[str]) -> tuple[Any, Any]:
    """Classes of the cluster and of its jobs, which note what the queue refuses."""
    try:
        import dask_jobqueue
    except ImportError:
        problem = f"the job queue {name} needs dask-jobqueue: pip install 'heliosweep[jobqueue]'"
        raise StudyError(Problem(problem, "execution.scheduler")) from None
    if name == "local-jobs":
        return dask_jobqueue.JobQueueCluster, _noting(_shell_job(), refusals)
    cluster_class = getattr(dask_jobqueue, _CLUSTERS[name])
    return cluster_class, _noting(cluster_class.job_cls, refusals)


def _noting(job_class: Any, refusals: list[str]) -> Any:
    from distributed.core import Status

    class Noting(job_class):
        async def _submit_job(self, script_filename: str) -> Any:
            try:
                return await super()._submit_job(script_filename)
            except Exception as error:
                said = [line for line in str(error).splitlines() if line.strip()]
                refusals.append(" ".join(said) or type(error).__name__)
                self.status = Status.failed  # which a cluster wants to know when it closes
                raise

    return Noting


def _shell_job() -> Any:
    from dask_jobqueue.core import Job as QueueJob

    class ShellJob(QueueJob):
        """Job script that runs at once, on this machine."""

        submit_command: Any = "bash"
        cancel_command: Any = "kill"
        config_name = "local"

        def __init__(self, scheduler: Any = None, name: Any = None, config_name: Any = None, **options: Any) -> None:
            super().__init__(scheduler=scheduler, name=name, config_name=config_name, shebang="", **options)
            self.job_header = ""

        async def _submit_job(self, script_filename: str) -> str:
            with open(script_filename) as script:  # noqa: PTH123  # it is removed when this returns
                text = script.read()
            quiet = subprocess.DEVNULL
            self._shell = subprocess.Popen(
                [self.submit_command, "-c", text], stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True
            )
            return str(self._shell.pid)

        def _job_id_from_submit_output(self, out: str) -> str:
            return out

        async def close(self) -> None:
            if (shell := getattr(self, "_shell", None)) is not None:
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(shell.pid, signal.SIGKILL)
                shell.wait()
            self.job_id = ""
            await super().close()

        @classmethod
        async def _close_job(cls, job_id: str, cancel_command: str) -> None:
            """Nothing is left to cancel."""

    return ShellJob


def _check_command(name: str, job_class: Any) -> None:
    command = job_class.submit_command.split()[0]
    if shutil.which(command) is None:
        problem = f"the job queue {name} is not usable from this machine: there is no command {command}"
        raise StudyError(Problem(problem, "execution.scheduler"))


def _job_options(name: str, job: Job) -> dict[str, Any]:
    settings = [
        f"export DASK_{key.replace('.', '__').replace('-', '_').upper()}={value}"
        for key, value in WORKER_SETTINGS.items()
        if key.startswith("distributed.worker.")
    ]
    options: dict[str, Any] = {
        "cores": job.cores,
        "processes": job.cores,
        "memory": f"{job.memory} B",
        "job_extra_directives": list(job.directives),
        "job_script_prologue": [*settings, f"export {SAFE_PATH}=1", *job.setup],
        "worker_extra_args": ["--no-dashboard"],
    }
    if job.interface:
        options["interface"] = job.interface
    if job.python:
        options["python"] = job.python
    if name == "local-jobs":
        return options
    if name == "htcondor":
        pairs = (line.partition("=") for line in job.directives)
        options["job_extra_directives"] = {key.strip(): value.strip() for key, _, value in pairs}
        options["disk"] = "1 GB"
        return options
    options["account" if name not in _PROJECT else "project"] = job.account
    options["queue"] = job.queue
    options["walltime"] = job.walltime
    return {key: value for key, value in options.items() if value is not None}


def only_ours(folder: Path) -> tuple[Any, str]:
    """Certificates without which nobody gets to scheduler and workers, and a secret part of the dashboard's address.

    Both are made anew for each run, and known to its processes only. The certificates are files in `folder`: those in
    memory distributed writes to the folder for temporary files at every use, where a run that is killed leaves them.
    """
    from distributed import Security

    made, roles = Security.temporary(), ("client", "scheduler", "worker")
    cert, key = (str(folder.absolute() / f"{name}.pem") for name in ("certificate", "key"))
    for name, text in ((cert, made.tls_client_cert), (key, made.tls_client_key)):
        with os.fdopen(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
            file.write(text)
    files = {f"tls_{role}_{name}": path for role in roles for name, path in (("cert", cert), ("key", key))}
    return Security(require_encryption=True, tls_ca_file=cert, **files), secrets.token_urlsafe(16)


def dashboard_link(cluster: Any, secret: str) -> str:
    """Address of the dashboard, where it listens."""
    return f"http://127.0.0.1:{cluster.scheduler_info['services']['dashboard']}/{secret}/status"


@contextmanager
def free_dashboard(host: str, secret: str) -> Iterator[str]:
    """Address for a dashboard that is started in the context: the usual port where it is free, else any.

    It has no page but those below its secret part: of itself distributed leads from its first page, and from a list of
    all, to that part.
    """
    from distributed import node
    from tornado.web import ErrorHandler

    class BelowSecret(node.RoutingApplication):
        def find_handler(self, request: Any, **options: Any) -> Any:
            if request.path.startswith(f"/{secret}/"):
                return super().find_handler(request, **options)
            return self.get_handler_delegate(request, ErrorHandler, {"status_code": 404})

    address = f"{host}:{DASHBOARD_PORT}"
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, DASHBOARD_PORT))
        except OSError:
            address = f"{host}:0"
    with warnings.catch_warnings():  # another run may take the port first: then distributed takes any, and warns
        warnings.filterwarnings("ignore", "Port .* is already in use", UserWarning)
        with _starting, mock.patch.object(node, "RoutingApplication", BelowSecret):
            yield address


def _close(cluster: Any) -> None:
    with suppress(TimeoutError):
        cluster.close(timeout=10)

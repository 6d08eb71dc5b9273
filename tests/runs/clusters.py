"""Clusters for tests, and parts for them to compute."""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.config.execution import Execution
from heliosweep.grid.regions import Part
from heliosweep.runs import cluster
from heliosweep.runs.executors import Outcome, compute_parts

ROOT = Path(__file__).parent.parent.parent


def nothing(number: int) -> None:
    """Called before each part."""


class FakeWork:
    """Doubles the number of a part; `before` is called first with the number, and is pickled by value."""

    module = "heliosweep.families.field_efficiency.compute"

    def __init__(self, before: Callable[[int], object] = nothing) -> None:
        import cloudpickle  # type: ignore[import-untyped]

        self.before = cloudpickle.dumps(before)

    def compute(self, part: Part) -> xr.Dataset:
        import pickle

        start, stop = part.region["a"].start, part.region["a"].stop
        pickle.loads(self.before)(start)
        return xr.Dataset({"double": ("a", 2.0 * np.arange(start, stop))})


def parts(count: int) -> Iterator[Part]:
    return (Part(f"points-{n:05}", "points", {"a": slice(n, n + 1)}) for n in range(count))


class Pool:
    """A cluster that may compute several works, one after the other."""

    def __init__(self, started: Any) -> None:
        self.client, self._rest = started._client, (started._where, started._look_after)

    @contextmanager
    def computing(self, work: Any) -> Iterator[Any]:
        where, look_after = self._rest
        yield cluster._Cluster(self.client, where, work, 1, look_after)


@contextmanager
def pool(scheduler: str = "distributed", workers: int = 2, **execution: Any) -> Iterator[Pool]:
    asked: Any = Execution(scheduler=scheduler, workers=workers, **execution)
    with tempfile.TemporaryDirectory() as folder:
        work: Any = FakeWork()
        with cluster.cluster_pool(asked, work, workers, Path(folder)) as started:
            yield Pool(started)


def outcomes(pool: Pool, numbers: Iterator[Part], work: Any = None) -> dict[str, Outcome]:
    with pool.computing(work or FakeWork()) as started:
        return {outcome.part.name: outcome for outcome in compute_parts(started, numbers)}


def check(done: dict[str, Outcome]) -> None:
    """Check the values of what `FakeWork` made."""
    for name, outcome in done.items():
        assert outcome.values is not None, outcome.error
        assert outcome.values["double"].item() == 2.0 * int(name[-5:])


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def scheduler_and_workers(
    folder: Path, workers: int = 2, options: tuple[str, ...] = (), protocol: str = "tcp"
) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A scheduler and workers of their own, as somebody else may have started them."""
    port = free_port()
    address = f"{protocol}://127.0.0.1:{port}"
    scheduler = [f"{protocol}://127.0.0.1", "--port", str(port), "--no-dashboard", "--no-show"]
    worker = [address, "--nthreads", "1", "--local-directory", str(folder), "--no-dashboard"]
    with ExitStack() as stack:

        def start(module: str, arguments: list[str]) -> subprocess.Popen[bytes]:
            command = [sys.executable, "-m", f"distributed.cli.{module}", *arguments, *options]
            with (folder / f"{module}.log").open("ab") as said:
                process = subprocess.Popen(command, cwd=ROOT, stderr=said, stdout=said, start_new_session=True)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        first = start("dask_scheduler", ["--host", *scheduler])
        for _ in range(workers):
            start("dask_worker", [*worker, "--no-nanny"])
        wait_until(lambda: reachable(port))
        yield address, first


def reachable(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def wait_until(done: Callable[[], object], seconds: float = 30) -> None:
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)

"""What the tests of clusters share: works to compute, and the engine to compute them."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, cast

import dask.array as da
import numpy as np
import xarray as xr

from heliosweep import workflow
from heliosweep.config.blocks import Execution
from heliosweep.config.study import Study
from heliosweep.grid.evaluate import TASK_MARK
from heliosweep.grid.plan import Plan
from heliosweep.grid.slabs import Part
from heliosweep.runtime.cluster import cluster_engine
from heliosweep.runtime.work import Engine, Outcome, Work

ROOT = Path(__file__).parent.parent.parent


class Count:
    def __init__(self) -> None:
        self.blocks = 0

    def advance(self, blocks: int = 1) -> None:
        self.blocks += blocks


class Planned:
    def __init__(self, workers: int = 2) -> None:
        self.workers = workers


@contextmanager
def engine(scheduler: str = "distributed", workers: int = 2, **execution: Any) -> Iterator[Engine]:
    asked = Execution(scheduler=scheduler, workers=workers, **execution)
    with cluster_engine(asked, cast(Plan, Planned(workers)), Count()) as started:
        yield started


def part(number: int) -> Part:
    return Part(f"points-{number:05}", "points", {"x": slice(number, number + 1)})


def work(number: int, function: Callable[[np.ndarray], np.ndarray] = lambda block: block, blocks: int = 3) -> Work:
    """A part of some blocks; `function` is pickled by value."""
    name = f"{TASK_MARK}test-{number}-{os.urandom(8).hex()}"
    numbers = da.arange(100 * number, 100 * number + 3 * blocks, chunks=3, dtype=float)
    return Work(part(number), xr.Dataset({"a": ("x", da.map_blocks(function, numbers, dtype=float, name=name))}))


def expected(number: int, blocks: int = 3) -> np.ndarray:
    return np.arange(100.0 * number, 100 * number + 3 * blocks)


def check(outcome: Outcome, blocks: int = 3) -> None:
    """Check the values of what `work` made."""
    assert outcome.values is not None, outcome.error
    np.testing.assert_array_equal(outcome.values["a"], expected(int(outcome.part.name[-5:]), blocks))


def outcomes(engine: Engine, works: Iterator[Work]) -> dict[int, Outcome]:
    return {int(outcome.part.name[-5:]): outcome for outcome in engine.run(works)}


def study_works(study: Study) -> list[Work]:
    """A study in parts along its first dimension that may be cut, time series included."""
    family, plan = workflow.family_of(study), workflow.plan(study)
    free = [(dim, n) for dim, n in plan.workload.parameters.items() if dim not in plan.workload.whole]
    if not free:
        lazy = family.build(study, plan.chunks, {})
        return [Work(Part("points-00000", "points", {}), lazy.drop_vars(lazy.coords))]
    dim, size = free[0]
    chunks = {**plan.chunks, dim: 1, **({plan.workload.splittable: 7} if plan.workload.splittable else {})}
    works = []
    for number in range(size):
        region = {dim: slice(number, number + 1)}
        lazy = family.build(study, chunks, region)
        works.append(Work(Part(f"points-{number:05}", "points", region), lazy.drop_vars(lazy.coords)))
    return works


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

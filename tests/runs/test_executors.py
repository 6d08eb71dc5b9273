"""Executors: all parts come through, three tries each, and nothing that another run would see."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import xarray as xr

from heliosweep.errors import HeliosweepError
from heliosweep.grid.regions import Part
from heliosweep.runs import executors
from heliosweep.runs.executors import Outcome, compute_parts, local_pool
from tests.runs.clusters import nothing, parts

LOCAL = ["threads", "synchronous", "processes"]


class FakeWork:
    """Doubles the number of a part; `before` is called first with the number."""

    def __init__(self, before: Callable[[int], object] = nothing) -> None:
        self.before = before

    def compute(self, part: Part) -> xr.Dataset:
        start, stop = part.region["a"].start, part.region["a"].stop
        self.before(start)
        return xr.Dataset({"double": ("a", 2.0 * np.arange(start, stop))})


def compute(name: str, work: Any, numbers: Iterator[Part], workers: int = 2) -> dict[str, Outcome]:
    with local_pool(name, work, workers) as pool:
        return {outcome.part.name: outcome for outcome in compute_parts(pool, numbers)}


@pytest.mark.parametrize("name", LOCAL)
def test_values_of_every_part(name):
    outcomes = compute(name, FakeWork(nothing), parts(20))
    for part in parts(20):
        values = outcomes.pop(part.name).values
        assert values is not None
        assert values["double"].item() == 2.0 * part.region["a"].start
    assert not outcomes


def test_no_more_threads_than_workers_and_none_is_left():
    threads = set()
    compute("threads", FakeWork(lambda number: threads.add(threading.current_thread())), parts(60), 3)
    assert 1 <= len(threads) <= 3
    assert not threads & set(threading.enumerate())


@pytest.mark.parametrize("name", LOCAL[:2])
def test_a_part_is_tried_three_times_and_the_others_come_through(name):
    tries: list[int] = []

    def fail(number: int) -> None:
        tries.append(number)
        if number == 7 or (number == 0 and tries.count(0) < 3):
            raise ArithmeticError(f"not {number}")

    outcomes = compute(name, FakeWork(fail), parts(9), 1)
    assert [number for number in range(9) if outcomes[f"points-{number:05}"].values is None] == [7]
    assert repr(outcomes["points-00007"].error) == "ArithmeticError('not 7')"
    assert (tries.count(0), tries.count(7), tries.count(8)) == (3, 3, 1)


@pytest.mark.parametrize("name", LOCAL[:2])
def test_errors_of_the_user_end_the_run_at_once(name):
    tries = []

    def wrong(number: int) -> None:
        tries.append(number)
        raise HeliosweepError("the file is gone")

    with pytest.raises(HeliosweepError, match="the file is gone"):
        compute(name, FakeWork(wrong), parts(50), 1)
    assert len(tries) <= 3


class Killing:
    """Kills its process at some parts: always, or the first time only."""

    def __init__(self, folder: Path, once: set[int], always: set[int]) -> None:
        self.folder, self.once, self.always = folder, once, always

    def __call__(self, number: int) -> None:
        mark = self.folder / str(number)
        if number in self.always or (number in self.once and not mark.exists()):
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX systems")
def test_dead_worker_processes_are_replaced_and_only_the_part_that_kills_fails(tmp_path):
    killing = Killing(tmp_path, once={5}, always={3})
    outcomes = compute("processes", FakeWork(killing), parts(12), 2)
    assert [n for n in range(12) if outcomes[f"points-{n:05}"].values is None] == [3]
    assert "a worker process ended before its work was done" in str(outcomes["points-00003"].error)


def test_what_was_not_begun_is_not_waited_for():
    begun: list[int] = []

    def slow(number: int) -> None:
        begun.append(number)
        time.sleep(0.2)

    def interrupted() -> Iterator[Part]:
        yield from parts(2)
        while not begun:
            time.sleep(0.01)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compute("threads", FakeWork(slow), interrupted())
    assert len(begun) <= 2


def test_few_parts_are_taken_ahead():
    taken = 0

    def counted() -> Iterator[Part]:
        nonlocal taken
        for part in parts(1000):
            taken += 1
            yield part

    with local_pool("threads", FakeWork(), 2) as pool:  # type: ignore[arg-type]
        for done, _ in enumerate(compute_parts(pool, counted()), start=1):
            assert taken <= done + pool.room + 1


def test_a_pool_is_looked_after_while_nothing_comes(monkeypatch):
    monkeypatch.setattr(executors, "LOOK_SECONDS", 0.02)
    looked = []
    with local_pool("threads", FakeWork(lambda n: time.sleep(0.3)), 1) as pool:  # type: ignore[arg-type]
        pool.look = lambda: looked.append(1)  # type: ignore[method-assign]
        list(compute_parts(pool, parts(1)))
    assert looked


@pytest.mark.parametrize("before", [None, "", "yes"])
def test_a_safe_path_lasts_as_long_as_any_run_and_leaves_what_was_there(monkeypatch, before):
    monkeypatch.delenv(executors.SAFE_PATH, raising=False)
    if before is not None:
        monkeypatch.setenv(executors.SAFE_PATH, before)
    first, second = executors.safe_path(), executors.safe_path()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert os.environ[executors.SAFE_PATH] == "1"
    second.__exit__(None, None, None)
    assert os.environ.get(executors.SAFE_PATH) == before


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="nothing stops a process here")
def test_workers_that_do_not_end_are_killed(monkeypatch):
    monkeypatch.setattr(executors, "END_SECONDS", 0.5)
    with local_pool("processes", FakeWork(), 2) as pool:  # type: ignore[arg-type]
        assert len(list(compute_parts(pool, parts(4)))) == 4
        children = [child for one in psutil.Process().children() for child in one.children()]
        workers = [child for child in children if child.is_running()]
        assert workers
        for worker in workers:
            worker.suspend()
    assert not any(worker.is_running() for worker in workers)


@pytest.mark.parametrize(
    ("missing", "told"),
    [("Lock.__new__(Lock).__setstate__((0, 1, 1, '/gone'))", False), ("open('a table of the script')", True)],
)
def test_a_worker_whose_run_has_ended_says_nothing(missing, told):
    """A semaphore that is gone is the run's; any other file that is missing is told."""
    code = f"from multiprocessing.synchronize import Lock\nfrom heliosweep.runs import forked\n{missing}"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ended.returncode == 1
    assert ("FileNotFoundError" in ended.stderr) == told, ended.stderr

"""Engines: blocks counted as dask finishes them, three tries, and nothing that another run would see."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dask
import numpy as np
import pytest
import xarray as xr
from dask.callbacks import Callback

from heliosweep.config.execution import Execution
from heliosweep.errors import HeliosweepError
from heliosweep.grid.evaluate import evaluate
from heliosweep.grid.slabs import Part
from heliosweep.runtime.engines import engine
from heliosweep.runtime.work import Outcome, Work


class Count:
    def __init__(self) -> None:
        self.blocks = 0

    def advance(self, blocks: int = 1) -> None:
        self.blocks += blocks


def same(block: np.ndarray) -> np.ndarray:
    return block[np.newaxis]


def lazy(blocks: int, function: Callable[[np.ndarray], np.ndarray] = same, first: float = 0.0) -> xr.Dataset:
    variables = evaluate(
        function,
        [xr.DataArray(first + np.arange(3.0 * blocks), dims="a")],
        dims=("a",),
        core=[()],
        sizes={"a": 3 * blocks},
        chunks={"a": 3},
        outputs={"same": {}},
        name="test",
    )
    return xr.Dataset(variables)


def works(*parts: xr.Dataset) -> Iterator[Work]:
    for number, part in enumerate(parts):
        yield Work(Part(f"points-{number:05}", "points", {}), part)


def compute(name: str, workers: int, parts: Iterator[Work], progress: Any = None) -> list[Outcome]:
    plan: Any = SimpleNamespace(workers=workers)
    with engine(Execution(scheduler=name), plan, progress or Count()) as started:
        return list(started.run(parts))


@pytest.mark.parametrize("name", ["threads", "synchronous", "processes"])
def test_values_of_every_part_and_its_blocks_counted(name):
    count = Count()
    outcomes = compute(name, 2, works(*(lazy(4, first=100.0 * n) for n in range(5))), count)
    assert [outcome.part.name for outcome in outcomes] == [f"points-{n:05}" for n in range(5)]
    for number, outcome in enumerate(outcomes):
        assert outcome.values is not None
        np.testing.assert_array_equal(outcome.values["same"], 100 * number + np.arange(12.0))
    assert count.blocks == 20


def test_workers_and_nothing_global():
    threads, settings = set(), set()

    def look(block: np.ndarray) -> np.ndarray:
        threads.add(threading.current_thread())
        settings.add((len(Callback.active), dask.config.get("scheduler", None), dask.config.get("num_workers", None)))
        return block[np.newaxis]

    compute("threads", 3, works(lazy(30, look), lazy(30, look)))
    assert settings == {(0, None, None)}
    assert 1 <= len(threads) <= 3
    assert not threads & set(threading.enumerate())


def test_runs_side_by_side_count_their_own_blocks():
    meet = threading.Barrier(2, timeout=30)
    counts = [Count(), Count()]

    def parts(blocks: int) -> Iterator[Work]:
        meet.wait()
        yield from works(lazy(blocks))
        meet.wait()

    threads = [
        threading.Thread(target=compute, args=("threads", 1, parts(blocks), count))
        for count, blocks in zip(counts, (20, 50), strict=True)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [count.blocks for count in counts] == [20, 50]


@pytest.mark.parametrize("name", ["threads", "synchronous"])
def test_a_part_is_tried_three_times_and_the_others_come_through(name):
    tries: list[float] = []

    def sometimes(block: np.ndarray) -> np.ndarray:
        tries.append(block[0])
        if len(tries) < 3:
            raise ArithmeticError("not yet")
        return block[np.newaxis]

    def never(block: np.ndarray) -> np.ndarray:
        raise ArithmeticError(f"not {block[0]:g}")

    outcomes = compute(name, 1, works(lazy(1, sometimes), lazy(1, never, 7.0), lazy(1)))
    assert len(tries) == 3
    assert [outcome.values is None for outcome in outcomes] == [False, True, False]
    assert repr(outcomes[1].error) == "ArithmeticError('not 7')"


def test_errors_of_the_user_end_the_run_at_once():
    tries = []

    def wrong(block: np.ndarray) -> np.ndarray:
        tries.append(1)
        raise HeliosweepError("the file is gone")

    with pytest.raises(HeliosweepError, match="the file is gone"):
        compute("threads", 1, works(lazy(1, wrong), lazy(1)))
    assert len(tries) == 1


class Once:
    """Kills its worker process, but only the first time."""

    def __init__(self, mark: Path, always: bool = False) -> None:
        self.mark, self.always = mark, always

    def __call__(self, block: np.ndarray) -> np.ndarray:
        if self.always or not self.mark.exists():
            self.mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return block[np.newaxis]


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX systems")
def test_dead_worker_processes_are_replaced_and_their_part_redone(tmp_path):
    once, always = Once(tmp_path / "once"), Once(tmp_path / "always", always=True)
    outcomes = compute("processes", 1, works(lazy(2, once), lazy(1, always), lazy(2)))
    assert [outcome.values is None for outcome in outcomes] == [False, True, False]
    assert "a worker process ended before its work was done" in str(outcomes[1].error)


def test_what_was_not_begun_is_not_waited_for():
    begun: list[float] = []
    release = threading.Event()

    def slow(block: np.ndarray) -> np.ndarray:
        begun.append(block[0])
        release.wait(30)
        return block[np.newaxis]

    def interrupted() -> Iterator[Work]:
        yield from works(lazy(50, slow))
        while not begun:
            threading.Event().wait(0.01)
        threading.Timer(0.1, release.set).start()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compute("threads", 2, interrupted())
    assert len(begun) <= 8

"""Schedulers: blocks counted as dask finishes them, and nothing that another run in the process would see."""

from __future__ import annotations

import threading
from collections.abc import Callable

import dask
import numpy as np
import pytest
import xarray as xr
from dask.callbacks import Callback

from heliosweep.grid.evaluate import evaluate
from heliosweep.runtime.scheduler import scheduler


class Count:
    def __init__(self) -> None:
        self.blocks = 0

    def advance(self, blocks: int = 1) -> None:
        self.blocks += blocks


def lazy(blocks: int, function: Callable[[np.ndarray], np.ndarray] = lambda a: a[np.newaxis]) -> xr.Dataset:
    variables = evaluate(
        function,
        [xr.DataArray(np.arange(3.0 * blocks), dims="a")],
        dims=("a",),
        core=[()],
        sizes={"a": 3 * blocks},
        chunks={"a": 3},
        outputs={"same": {}},
        name="test",
    )
    return xr.Dataset(variables)


@pytest.mark.parametrize("name", ["threads", "synchronous"])
def test_blocks_are_counted(name):
    count = Count()
    with scheduler(name, 2, count) as compute:
        np.testing.assert_array_equal(compute(lazy(4))["same"], np.arange(12.0))
    assert count.blocks == 4


def test_workers_and_nothing_global():
    threads, settings = set(), set()

    def look(block: np.ndarray) -> np.ndarray:
        threads.add(threading.current_thread())
        settings.add((len(Callback.active), dask.config.get("scheduler", None), dask.config.get("num_workers", None)))
        return block[np.newaxis]

    with scheduler("threads", 3, Count()) as compute:
        compute(lazy(30, look))
    assert settings == {(0, None, None)}
    assert 1 <= len(threads) <= 3
    assert not threads & set(threading.enumerate())


def test_runs_side_by_side_count_their_own_blocks():
    meet = threading.Barrier(2, timeout=30)
    counts = [Count(), Count()]

    def work(count: Count, blocks: int) -> None:
        with scheduler("threads", 1, count) as compute:
            meet.wait()
            compute(lazy(blocks))
            meet.wait()

    threads = [threading.Thread(target=work, args=job) for job in zip(counts, (20, 50), strict=True)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [count.blocks for count in counts] == [20, 50]

"""The choice of dask's scheduler."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

import xarray as xr

from heliosweep.errors import HeliosweepError
from heliosweep.grid.evaluate import TASK_MARK
from heliosweep.runtime.progress import Progress


@contextmanager
def scheduler(name: str, workers: int, progress: Progress) -> Iterator[Callable[[xr.Dataset], xr.Dataset]]:
    """Start the workers of one of dask's local schedulers, and stop them at the end.

    Nothing is set that another run in this process would see.

    Parameters
    ----------
    name : {"threads", "processes", "synchronous"}
        Kernels release the GIL, so threads are the right choice but for debugging.
    workers : int
        Blocks that run at a time.
    progress : Progress
        Is told of every block that is done.

    Yields
    ------
    callable
        Computes all variables of a lazy data set in one go.

    Raises
    ------
    HeliosweepError
        Where a worker process ended before its work.
    """

    def finished(key: Any, *_: object) -> None:
        if TASK_MARK in str(key[0] if isinstance(key, tuple) else key):
            progress.advance()

    # The five places of a dask callback: start, start_state, pretask, posttask, finish.
    options: dict[str, Any] = {"scheduler": name, "callbacks": [(None, None, None, finished, None)]}
    pool = _pool(name, workers)
    if pool is not None:
        options["pool"] = pool

    def compute(lazy: xr.Dataset) -> xr.Dataset:
        try:
            return lazy.compute(**options)
        except BrokenProcessPool:
            raise HeliosweepError(
                "a worker process ended before its work was done; a script that runs a study with processes must do "
                'so below `if __name__ == "__main__":`, and there must be memory enough for every worker'
            ) from None

    try:
        yield compute
    finally:
        if pool is not None:
            pool.shutdown(cancel_futures=True)


def _pool(name: str, workers: int) -> ThreadPoolExecutor | ProcessPoolExecutor | None:
    if name == "threads":
        return ThreadPoolExecutor(workers)
    if name == "processes":
        # Ctrl-C reaches every process of a terminal: this one alone acts on it.
        return ProcessPoolExecutor(
            workers, multiprocessing.get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_IGN)
        )
    return None

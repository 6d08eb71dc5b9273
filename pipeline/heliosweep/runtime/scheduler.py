"""The choice of dask's scheduler."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import dask
import xarray as xr

from heliosweep.runtime.progress import CountBlocks, Progress


@contextmanager
def scheduler(name: str, workers: int) -> Iterator[None]:
    """Use one of dask's local schedulers while the context lasts.

    Parameters
    ----------
    name : {"threads", "processes", "synchronous"}
        Kernels release the GIL, so threads are the right choice but for debugging.
    workers : int
        Blocks that run at a time.
    """
    with dask.config.set(scheduler=name, num_workers=workers):
        yield


def compute(dataset: xr.Dataset, progress: Progress) -> xr.Dataset:
    """Compute all variables of a lazy data set in one go, counting blocks."""
    with CountBlocks(progress):
        return dataset.compute()

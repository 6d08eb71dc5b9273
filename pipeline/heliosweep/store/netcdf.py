"""NetCDF files: writing `result.nc` slab by slab, and the lock around the library.

The bytes depend on the values and on the library versions alone. HDF5 lays storage out in the order of writing, which
is that of the slabs, whatever the parts, workers and engine of a run: annual variables are contiguous, and so are time
series but compressed ones, which are written one whole storage chunk after the other.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import netCDF4
import numpy as np
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

from heliosweep.errors import HeliosweepError
from heliosweep.files import why_not_written
from heliosweep.grid.regions import Part, Region
from heliosweep.store.encoding import Skeleton, encode, stored

#: Writes the encoded values of a slab.
Write = Callable[[Part, Mapping[str, np.ndarray]], None]


class _LibraryLock:
    """xarray's lock for the library, made reentrant: two threads must not enter it, not even for two files.

    xarray reads values under its lock, but opens files and reads attributes without one; whoever holds this lock may
    open a file with xarray, and nobody else, be it xarray itself, is in the library meanwhile.
    """

    def __init__(self) -> None:
        self._own = threading.RLock()
        self._depth = 0

    def acquire(self, blocking: bool = True) -> bool:
        if not self._own.acquire(blocking):
            return False
        got = self._depth > 0
        try:
            got = got or NETCDF4_PYTHON_LOCK.acquire(blocking)
        finally:
            if not got:
                self._own.release()
        self._depth += got
        return got

    def release(self) -> None:
        self._depth -= 1
        if not self._depth:
            NETCDF4_PYTHON_LOCK.release()
        self._own.release()

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def __reduce__(self) -> str:
        return "LIBRARY_LOCK"  # there is one in each process


LIBRARY_LOCK = _LibraryLock()


@contextmanager
def netcdf_file(path: Path, skeleton: Skeleton, level: int, named: Path) -> Iterator[Write]:
    """Write a NetCDF file; it is complete when the context is left.

    Parameters
    ----------
    path : pathlib.Path
        File to write.
    skeleton : Skeleton
        Of the result.
    level : int
        Deflate level of time series, 0 for none.
    named : pathlib.Path
        Name of the file in messages.

    Yields
    ------
    callable
        Writes the encoded values of a slab; may be called from any thread, one at a time.

    Raises
    ------
    HeliosweepError
        It cannot be written; says how much room there is.
    """
    with _library(named):
        file = netCDF4.Dataset(path.absolute(), "w", format="NETCDF4")
    try:
        with _library(named):
            _define(file, skeleton, level)
        chunked = {name for name, one in skeleton.variables.items() if level and one.kind == "series"}

        def write(slab: Part, values: Mapping[str, np.ndarray]) -> None:
            with _library(named):
                for name in [name for name in values if name not in chunked]:
                    file[name][_index(skeleton, name, slab.region)] = values[name]
                _write_chunks(file, skeleton, slab.region, {name: values[name] for name in values if name in chunked})

        yield write
    except BaseException:
        with LIBRARY_LOCK, suppress(OSError, RuntimeError):
            file.close()  # which writes, and fails again where the disk is full
        raise
    with _library(named):
        file.close()


@contextmanager
def _library(named: Path) -> Iterator[None]:
    """Keep other threads out of the library, and say in words why it failed to write."""
    try:
        with LIBRARY_LOCK:
            yield
    except (OSError, RuntimeError) as error:
        raise HeliosweepError(why_not_written(named, error)) from error


def _define(file: netCDF4.Dataset, skeleton: Skeleton, level: int) -> None:
    file.set_auto_maskandscale(False)
    file.set_fill_off()  # every value is written once; filling first would write the file twice
    file.setncatts(dict(skeleton.attributes))
    for dim, size in skeleton.sizes.items():
        file.createDimension(dim, size)
    for name, coordinate in skeleton.coordinates.coords.items():
        values, attrs = encode(coordinate)
        dtype = str if values.dtype == object else values.dtype
        target = file.createVariable(str(name), dtype, coordinate.dims, fill_value=False)
        target.setncatts(attrs)
        target[...] = values
    for name, variable in skeleton.variables.items():
        dtype, attrs = stored(variable)
        storage: dict[str, Any] = {"contiguous": True}
        if level and variable.kind == "series":
            chunks = [min(skeleton.storage.get(dim, 1), skeleton.sizes[dim]) for dim in variable.dims]
            storage = {"chunksizes": chunks, "compression": "zlib", "complevel": level}
        fill = np.nan if dtype.kind == "f" else False
        target = file.createVariable(name, dtype, variable.dims, fill_value=fill, **storage)
        target.setncatts({**attrs, **skeleton.labels(variable)})
    file.sync()
    if level:
        for name in skeleton.of_kind("series"):
            # Each chunk is written once and whole: a cache would only hold memory, 64 MB a variable.
            file[name].set_var_chunk_cache(size=1, nelems=1, preemption=1.0)


def _index(skeleton: Skeleton, name: str, region: Region) -> tuple[slice, ...]:
    return tuple(region.get(dim, slice(0, skeleton.sizes[dim])) for dim in skeleton.variables[name].dims)


def _write_chunks(file: netCDF4.Dataset, skeleton: Skeleton, region: Region, values: Mapping[str, np.ndarray]) -> None:
    """Write compressed variables, one storage chunk of each after the other, last dimension fastest."""
    for dims in dict.fromkeys(skeleton.variables[name].dims for name in values):
        names = [name for name in values if skeleton.variables[name].dims == dims]
        whole = _index(skeleton, names[0], region)
        lengths = [skeleton.storage.get(dim, 1) for dim in dims]
        pieces = [
            [slice(start, min(start + length, span.stop)) for start in range(span.start, span.stop, length)]
            for span, length in zip(whole, lengths, strict=True)
        ]
        for cell in itertools.product(*pieces):
            within = tuple(slice(c.start - w.start, c.stop - w.start) for c, w in zip(cell, whole, strict=True))
            for name in names:
                file[name][cell] = values[name][within]

"""Writing `result.nc`: by regions, in one fixed order, under a temporary name until it is whole.

The bytes depend on the values and on the library versions alone. HDF5 lays storage out in the order of writing, so
everything is written in an order that the blocks, workers and parts of a run do not change: annual variables are
contiguous, and so are time series but compressed ones, which are written one whole storage chunk after the other.
"""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import netCDF4
import numpy as np
import xarray as xr

from heliosweep.errors import HeliosweepError
from heliosweep.store.encoding import Variable, encode, labels, numbers, stored
from heliosweep.store.full import why_not_written
from heliosweep.store.lock import LIBRARY_LOCK
from heliosweep.store.temporary import temporary_name


class ResultWriter:
    """A NetCDF-4 file that appears under its name only when it is complete.

    Parameters
    ----------
    path : path
        Where the file shall stand. Its folder must exist.
    sizes : mapping of str to int
        Dimensions, in the order of the file.
    coordinates : xarray.Dataset
        Coordinate variables, in memory.
    variables : mapping of str to Variable
        Data variables, to be filled by `write`.
    attributes : mapping
        Global attributes, strings and numbers.
    compression_level : int
        Deflate level of chunked variables, 0 for none.
    replaces : sequence of str
        Names of files beside it that describe the file it may replace; they are removed with that one.

    Raises
    ------
    HeliosweepError
        Where the file cannot be written, here and in every method; says how much room there is.

    Notes
    -----
    Use as a context manager: leaving it normally renames the file into place, leaving it by an exception removes it.
    Each method may be called from any thread, one at a time.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        sizes: Mapping[str, int],
        coordinates: xr.Dataset,
        variables: Mapping[str, Variable],
        attributes: Mapping[str, Any],
        compression_level: int = 1,
        replaces: Sequence[str] = (),
    ) -> None:
        self.path = Path(path)
        self.temporary = temporary_name(self.path)
        self._variables = variables
        self._sizes = sizes
        self._replaces = replaces
        with contextlib.ExitStack() as failed:
            failed.callback(self.temporary.unlink, missing_ok=True)
            with self._library():
                self._file = netCDF4.Dataset(self.temporary, "w", format="NETCDF4")
                failed.callback(self._close_quietly)
                self._define(sizes, coordinates, variables, attributes, compression_level)
            failed.pop_all()

    def _define(
        self,
        sizes: Mapping[str, int],
        coordinates: xr.Dataset,
        variables: Mapping[str, Variable],
        attributes: Mapping[str, Any],
        compression_level: int,
    ) -> None:
        self._file.set_auto_maskandscale(False)
        self._file.set_fill_off()  # every value is written once; filling first would write the file twice
        self._file.setncatts(dict(attributes))
        for dim, size in sizes.items():
            self._file.createDimension(dim, size)
        for name, coordinate in coordinates.coords.items():
            values, attrs = encode(coordinate)
            target = self._file.createVariable(
                str(name), str if values.dtype == object else values.dtype, coordinate.dims, fill_value=False
            )
            target.setncatts(attrs)
            target[...] = values
        for name, variable in variables.items():
            dtype, encoded = stored(variable)
            storage: dict[str, Any] = {"contiguous": True}
            if variable.storage:
                storage = {
                    "chunksizes": [min(variable.storage.get(dim, 1), sizes[dim]) for dim in variable.dims],
                    "compression": "zlib" if compression_level else None,
                    "complevel": compression_level,
                }
            target = self._file.createVariable(
                name,
                dtype,
                variable.dims,
                fill_value=np.nan if dtype.kind == "f" else False,
                **storage,
            )
            target.setncatts({**encoded, **labels(variable, coordinates, sizes)})
        self._file.sync()
        for name, variable in variables.items():
            if variable.storage:
                # Each chunk is written once and whole: a cache would only hold memory, 64 MB a variable.
                self._file[name].set_var_chunk_cache(size=1, nelems=1, preemption=1.0)

    def write(self, values: Mapping[str, np.ndarray], region: Mapping[str, slice]) -> None:
        """Write variables over one region of the grid.

        Parameters
        ----------
        values : mapping of str to ndarray
            Arrays in the order of each variable's dimensions. Regions of chunked variables must begin and end at
            storage chunks.
        region : mapping of str to slice
            Start and stop along the dimensions that the values do not span whole.
        """
        with self._library():
            self._write(values, region)

    def _write(self, values: Mapping[str, np.ndarray], region: Mapping[str, slice]) -> None:
        chunked = {name: array for name, array in values.items() if self._variables[name].storage}
        for name, array in values.items():
            if name not in chunked:
                self._file[name][self._index(name, region)] = numbers(array)
        if not chunked:
            return
        dims = self._variables[next(iter(chunked))].dims
        for cell in self._cells(next(iter(chunked)), region):
            for name, array in chunked.items():
                index = tuple(
                    slice(c.start - o.start, c.stop - o.start)
                    for c, o in zip(cell, self._index(name, region), strict=True)
                )
                if self._variables[name].dims != dims:
                    raise ValueError(f"{name} is not chunked like the variables written with it")
                self._file[name][cell] = array[index]

    def _index(self, name: str, region: Mapping[str, slice]) -> tuple[slice, ...]:
        return tuple(region.get(dim, slice(0, self._sizes[dim])) for dim in self._variables[name].dims)

    def _cells(self, name: str, region: Mapping[str, slice]) -> Iterator[tuple[slice, ...]]:
        """Storage chunks of a region, last dimension fastest."""
        variable = self._variables[name]
        ranges = []
        for dim, span in zip(variable.dims, self._index(name, region), strict=True):
            length = variable.storage.get(dim, 1)
            ranges.append([slice(i, min(i + length, span.stop)) for i in range(span.start, span.stop, length)])
        yield from itertools.product(*ranges)

    @contextlib.contextmanager
    def _library(self) -> Iterator[None]:
        """Keep other threads out of the library, and say in words why it failed to write."""
        try:
            with LIBRARY_LOCK:
                yield
        except (OSError, RuntimeError) as error:
            raise HeliosweepError(why_not_written(self.path, error)) from error

    def _close_quietly(self) -> None:
        # Closing flushes, which fails again where the disk is full.
        with LIBRARY_LOCK, contextlib.suppress(OSError, RuntimeError):
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._publish()
            else:
                self._close_quietly()
        finally:
            self.temporary.unlink(missing_ok=True)

    def _publish(self) -> None:
        with self._library():
            self._file.close()
            with self.temporary.open("rb") as file:
                os.fsync(file.fileno())
            for name in self._replaces:
                self.path.with_name(name).unlink(missing_ok=True)
            self.temporary.replace(self.path)

"""Write results block by block to ``result.nc`` with netCDF4.

The bytes depend only on the values and the library versions, because blocks are always written in the same order. Dask
is not used for writing, because its NetCDF files differ from run to run.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np

from heliosweep.errors import HeliosweepError
from heliosweep.files import LIBRARY_LOCK, remove, sync, why_not_written, written_whole
from heliosweep.grid.regions import Cut, Piece, Variable, index_of
from heliosweep.lazy import xr
from heliosweep.store.folder import DESCRIPTIONS, RESULT

if TYPE_CHECKING:
    from heliosweep.config.blocks import Output

    Blocks = Iterable[tuple[Piece, Mapping[Any, Any]]]  # each maps names to arrays

_TIME_ATTRIBUTES = {"units": "seconds since 1970-01-01T00:00:00Z", "calendar": "standard"}


@dataclass(frozen=True)
class Template:
    """Contents of a result file except the values of its variables.

    Parameters
    ----------
    sizes : mapping of str to int
        Dimensions in the order of the result.
    coordinates : xarray.Dataset
        Coordinates of the result, in memory.
    variables : mapping of str to Variable
        Data variables in the order of the result.
    attributes : mapping of str to object
        Global attributes.
    cuts : mapping of str to Cut
        Division of each kind of variable into blocks, which are also the storage chunks of compressed variables.
    """

    sizes: Mapping[str, int]
    coordinates: xr.Dataset
    variables: Mapping[str, Variable]
    attributes: Mapping[str, Any]
    cuts: Mapping[str, Cut]


def write_result(blocks: Blocks, template: Template, output: Output, folder: Path) -> Path:
    """Write the result of a study, replacing an existing result.

    Parameters
    ----------
    blocks : iterable of (Piece, mapping of str to array)
        All blocks of the result in the order of the file, with the values of their variables.
    template : Template
        Contents of the result file except the values.
    output : Output
        Block `output` of the study, which specifies the compression.
    folder : pathlib.Path
        Result folder.

    Returns
    -------
    pathlib.Path
        Path of ``result.nc``.

    Raises
    ------
    HeliosweepError
        If the result cannot be written. An existing result is then kept.
    """
    path = folder / RESULT
    level = 0 if output.compression == "none" else output.compression_level
    with written_whole(path) as temporary:
        _write_netcdf(temporary, blocks, template, level, path)
        sync(temporary)
        # If a run is killed here, the folder has no manifest, and the next run starts again.
        for name in DESCRIPTIONS:
            remove(folder / name)
    return path


def _write_netcdf(path: Path, blocks: Blocks, template: Template, level: int, named: Path) -> None:
    """Write a NetCDF file with time series compressed at `level` (0: none). Messages contain the name `named`."""
    with LIBRARY_LOCK:
        file = netCDF4.Dataset(path.absolute(), "w", format="NETCDF4")
    try:
        with LIBRARY_LOCK:
            _define(file, template, level)
        for block, values in blocks:
            for name in values:
                array = _numbers(np.asarray(values[name]))
                with LIBRARY_LOCK:
                    file[name][index_of(template.variables[name].dims, block.region) or ...] = array
        with LIBRARY_LOCK:
            file.close()
    except (OSError, RuntimeError) as error:
        raise HeliosweepError(why_not_written(named, error)) from error
    finally:
        with LIBRARY_LOCK, suppress(OSError, RuntimeError):
            if file.isopen():
                file.close()  # closing the file writes data, and fails again if the disk is full


def _define(file: netCDF4.Dataset, template: Template, level: int) -> None:
    file.set_auto_maskandscale(False)
    file.set_fill_off()  # each value is written exactly once
    file.setncatts(dict(template.attributes))
    for dim, size in template.sizes.items():
        file.createDimension(dim, size)
    _write_coordinates(file, template.coordinates)
    for name, variable in template.variables.items():
        dtype = np.dtype(np.float64) if variable.dtype.kind == "M" else variable.dtype
        storage: dict[str, Any] = {"contiguous": True}
        if level and variable.kind == "series":
            block = {**template.sizes, **template.cuts["series"].block}
            chunks = [block[dim] for dim in variable.dims]
            storage = {"chunksizes": chunks, "compression": "zlib", "complevel": level}
        fill = np.nan if dtype.kind == "f" else False
        target = file.createVariable(name, dtype, variable.dims, fill_value=fill, **storage)
        # each chunk is written once, so a chunk cache would waste 64 MB per variable
        if level and variable.kind == "series":
            target.set_var_chunk_cache(size=1, nelems=1, preemption=1.0)
        labels = [
            str(label)
            for label, one in template.coordinates.variables.items()
            if label not in template.sizes and set(one.dims) <= set(variable.dims)
        ]
        target.setncatts({**variable.attrs, "coverage_content_type": "modelResult"})
        target.setncatts(_TIME_ATTRIBUTES if variable.dtype.kind == "M" else {})
        target.setncatts({"coordinates": " ".join(labels)} if labels else {})
    file.sync()


def _write_coordinates(file: netCDF4.Dataset, coordinates: xr.Dataset) -> None:
    for name, coordinate in coordinates.coords.items():
        values, attrs = coordinate.values, dict(coordinate.attrs)
        dims = tuple(map(str, coordinate.dims))
        if values.dtype.kind in "UOT":
            # HDF5 crashes if a file with strings is opened twice and then closed once (netcdf-c, issue 2510).
            encoded = np.strings.encode(values.astype(str), "utf-8")
            values = np.ascontiguousarray(encoded).view("S1").reshape(*encoded.shape, encoded.itemsize)
            dims, attrs = (*dims, f"string{values.shape[-1]}"), {**attrs, "_Encoding": "utf-8"}
            if dims[-1] not in file.dimensions:
                file.createDimension(dims[-1], values.shape[-1])
        elif values.dtype.kind == "M":
            values, attrs = _numbers(values), {**attrs, **_TIME_ATTRIBUTES}
        if values.dtype.kind == "f" and np.isnan(values).any():
            attrs["missing_value"] = values.dtype.type(np.nan)
        target = file.createVariable(str(name), values.dtype, dims, fill_value=False)
        target.set_auto_chartostring(False)
        target.setncatts(attrs)
        target[...] = values


def _numbers(values: np.ndarray) -> np.ndarray:
    """Return times as seconds since 1970, and NaT as NaN. Other values are returned unchanged."""
    if values.dtype.kind != "M":
        return values
    return np.where(np.isnat(values), np.nan, values.astype("datetime64[ns]").astype(np.int64) / 1e9)

"""Writing of results, block by block: ``result.nc`` by netCDF4, ``result.zarr`` by xarray.

The bytes depend on the values and the library versions only, because blocks are written in one order, whatever workers
computed their chunks. dask is not used for writing: a NetCDF file that it writes is never the same twice.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np

from heliosweep.errors import HeliosweepError
from heliosweep.files import LIBRARY_LOCK, remove, sync, temporary_name, why_not_written, writing
from heliosweep.grid.regions import Cut, Piece, Variable, index_of
from heliosweep.store.folder import DESCRIPTIONS, FORMATS

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.blocks import Output

    Blocks = Iterable[tuple[Piece, Mapping[Any, Any]]]  # names and arrays, perhaps as an xarray.Dataset

_TIME_ATTRIBUTES = {"units": "seconds since 1970-01-01T00:00:00Z", "calendar": "standard"}


@dataclass(frozen=True)
class Template:
    """Result without its values.

    Parameters
    ----------
    sizes : mapping of str to int
        Dimensions in the order of the result.
    coordinates : xarray.Dataset
        Coordinates, in memory.
    variables : mapping of str to Variable
        Data variables in the order of the result.
    attributes : mapping of str to object
        Global attributes.
    cuts : mapping of str to Cut
        Blocks of the variables of each kind; also the storage chunks of compressed variables.
    """

    sizes: Mapping[str, int]
    coordinates: xr.Dataset
    variables: Mapping[str, Variable]
    attributes: Mapping[str, Any]
    cuts: Mapping[str, Cut]


def write_result(blocks: Blocks, template: Template, output: Output, folder: Path) -> Path:
    """Write the result of a study in place of an existing one of either format.

    Parameters
    ----------
    blocks : iterable of (Piece, mapping of str to array)
        All blocks in the order of the file, with the values of their variables.
    template : Template
        Everything else.
    output : Output
        Format and compression.
    folder : pathlib.Path
        Result folder.

    Returns
    -------
    pathlib.Path
        ``result.nc`` or ``result.zarr``.

    Raises
    ------
    HeliosweepError
        If it cannot be written. An existing result stays in place.
    """
    path = folder / FORMATS[output.format]
    temporary, group = temporary_name(folder / FORMATS["netcdf"]), temporary_name(folder / FORMATS["zarr"])
    is_zarr = output.format == "zarr"
    level = 0 if is_zarr or output.compression == "none" else output.compression_level
    try:
        _write_netcdf(temporary, blocks, template, level, path)
        with writing(path):
            if is_zarr:
                _write_zarr(temporary, group, template, output)
            else:
                sync(temporary)
            # A folder without its manifest holds no result, so a run that is killed here starts again.
            for name in (*DESCRIPTIONS, *FORMATS.values()):
                if name != path.name or is_zarr:
                    remove(folder / name)
            (group if is_zarr else temporary).replace(path)
    finally:
        for left in (temporary, group):
            with suppress(OSError):
                remove(left)
    return path


def _write_netcdf(path: Path, blocks: Blocks, template: Template, level: int, named: Path) -> None:
    """Write a NetCDF file with time series deflated at a level (0: not compressed); `named` is its name in messages."""
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
                file.close()  # which writes, and fails again if the disk is full


def _define(file: netCDF4.Dataset, template: Template, level: int) -> None:
    """Create dimensions, coordinates and variables of a NetCDF file."""
    file.set_auto_maskandscale(False)
    file.set_fill_off()  # every value is written once
    file.setncatts(dict(template.attributes))
    for dim, size in template.sizes.items():
        file.createDimension(dim, size)
    _write_coordinates(file, template.coordinates)
    for name, variable in template.variables.items():
        dtype = np.dtype(np.float64) if variable.dtype.kind == "M" else variable.dtype
        storage: dict[str, Any] = {"contiguous": True}
        if level and variable.kind == "series":
            storage = {"chunksizes": _block_shape(template, variable), "compression": "zlib", "complevel": level}
        fill = np.nan if dtype.kind == "f" else False
        target = file.createVariable(name, dtype, variable.dims, fill_value=fill, **storage)
        if level and variable.kind == "series":  # each chunk is written once: a cache would only take 64 MB a variable
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
            # HDF5 crashes if a file with strings is open twice and one of the two is closed (netcdf-c, issue 2510).
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


def _block_shape(template: Template, variable: Variable) -> tuple[int, ...]:
    return tuple(template.cuts[variable.kind].block.get(dim, template.sizes[dim]) for dim in variable.dims)


def _numbers(values: np.ndarray) -> np.ndarray:
    """Times as seconds since 1970, NaT as NaN; other values unchanged."""
    if values.dtype.kind != "M":
        return values
    return np.where(np.isnat(values), np.nan, values.astype("datetime64[ns]").astype(np.int64) / 1e9)


def _write_zarr(source: Path, path: Path, template: Template, output: Output) -> None:
    """Write the data set of a NetCDF file as a Zarr group of format 3; its chunks are the blocks."""
    import dask
    from zarr.codecs import BloscCname, BloscCodec

    from heliosweep.store.read import open_result

    codecs = None  # not GzipCodec, which writes the time
    if output.compression != "none":
        codecs = [BloscCodec(cname=BloscCname(output.compression), clevel=output.compression_level)]
    with open_result(source, chunks={}) as stored, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Consolidated metadata")  # not in the specification of format 3 yet
        # Strings of variable length: those of fixed length have no specification in Zarr 3.
        texts = {name: one.compute().astype(object) for name, one in stored.coords.items() if one.dtype.kind in "UT"}
        result = stored.drop_encoding().assign_coords(texts)
        encoding: dict[Any, dict[str, Any]] = {name: {"compressors": None} for name in result.coords}
        for name, variable in template.variables.items():
            lengths = _block_shape(template, variable)
            result[name] = result[name].chunk(dict(zip(variable.dims, lengths, strict=True)))
            encoding[name] = {"chunks": lengths, "compressors": codecs}
        for key, one in result.variables.items():
            if one.dtype.kind == "M":
                encoding[key] |= {"units": _TIME_ATTRIBUTES["units"], "dtype": "float64", "_FillValue": np.nan}
            elif one.dtype.kind == "f" and key in template.variables:
                encoding[key]["_FillValue"] = np.nan
        with dask.config.set(scheduler="synchronous"):  # one block in memory at a time
            result.to_zarr(path, mode="w", encoding=encoding, zarr_format=3, consolidated=True)

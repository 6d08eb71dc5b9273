"""Writing results slab by slab as NetCDF files and Zarr groups, and reading what a group says of itself.

The bytes depend on the values and on the library versions alone. HDF5 lays storage out in the order of writing, which
is that of the slabs, whatever the parts, workers and engine of a run: annual variables are contiguous, and so are time
series but compressed ones, which are written one whole storage chunk after the other. Zarr groups are of format 2, for
its consolidated metadata and its text are standardised; those of format 3 are not. Their chunks are the slabs, and
every chunk is written, also one of nothing but NaN.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from heliosweep.errors import HeliosweepError
from heliosweep.files import why_not_written, writing
from heliosweep.grid.regions import Part, Region, index_of
from heliosweep.netcdf import LIBRARY_LOCK
from heliosweep.store.encoding import Skeleton, encode, slab_rows, stored
from heliosweep.store.folder import CONSOLIDATED

#: Writes the encoded values of a slab; may be called from any thread, one at a time.
Write = Callable[[Part, Mapping[str, np.ndarray]], None]
#: Codecs of Zarr groups that heliosweep writes. Others are not decoded: one of them, pickle, runs what it reads.
CODECS = {"vlen-utf8", "shuffle", "zlib", "zstd"}
#: Our key beside the consolidated metadata, which readers pass over: what NetCDF knows and Zarr does not.
_RECORD = "heliosweep"
_ENCODING = "utf-8"


@contextmanager
def netcdf_file(path: Path, skeleton: Skeleton, level: int, named: Path) -> Iterator[Write]:
    """Write a NetCDF file, with time series deflated at a level (0 for none); it is complete when the context is left.

    `named` is the name of the file in messages. Raises HeliosweepError where it cannot be written; says how much room
    there is.
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
                    file[name][index_of(skeleton.variables[name].dims, slab.region) or ...] = values[name]
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
        dims = tuple(map(str, coordinate.dims))
        if values.dtype == object:
            # HDF5 crashes where a file with strings is open twice and one of the two is closed (netcdf-c, issue 2510).
            values = _characters(values)
            dims, attrs = (*dims, f"string{values.shape[-1]}"), {**attrs, "_Encoding": _ENCODING}
            if dims[-1] not in file.dimensions:
                file.createDimension(dims[-1], values.shape[-1])
        target = file.createVariable(str(name), values.dtype, dims, fill_value=False)
        target.set_auto_chartostring(False)
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


def _characters(text: np.ndarray) -> np.ndarray:
    """Text as characters along one more dimension, filled up with zeros."""
    encoded = np.strings.encode(text.astype(str), _ENCODING)
    return np.ascontiguousarray(encoded).view("S1").reshape(*text.shape, encoded.itemsize)


def _write_chunks(file: netCDF4.Dataset, skeleton: Skeleton, region: Region, values: Mapping[str, np.ndarray]) -> None:
    """Write compressed variables, one storage chunk of each after the other, last dimension fastest."""
    for dims in dict.fromkeys(skeleton.variables[name].dims for name in values):
        names = [name for name in values if skeleton.variables[name].dims == dims]
        whole = [region.get(dim, slice(0, skeleton.sizes[dim])) for dim in dims]
        lengths = [skeleton.storage.get(dim, 1) for dim in dims]
        pieces = [
            [slice(start, min(start + length, span.stop)) for start in range(span.start, span.stop, length)]
            for span, length in zip(whole, lengths, strict=True)
        ]
        for cell in itertools.product(*pieces):
            within = tuple(slice(c.start - w.start, c.stop - w.start) for c, w in zip(cell, whole, strict=True))
            for name in names:
                file[name][cell] = values[name][within]


@contextmanager
def zarr_group(path: Path, skeleton: Skeleton, compression: str, level: int, named: Path) -> Iterator[Write]:
    """Write a Zarr group (a folder), its data variables compressed by ``none``, ``zlib`` or ``zstd``.

    It is complete when the context is left; else as `netcdf_file`.
    """
    with writing(named):
        arrays = _create(path, skeleton, compression, level)

    def write(slab: Part, values: Mapping[str, np.ndarray]) -> None:
        with writing(named):
            for name, array in values.items():
                arrays[name][index_of(skeleton.variables[name].dims, slab.region) or ...] = array

    yield write


def _create(path: Path, skeleton: Skeleton, compression: str, level: int) -> dict[str, Any]:
    """Make a group with its coordinates and metadata, whole but for the values of its variables, and return these."""
    import zarr
    from numcodecs import VLenUTF8  # type: ignore[import-untyped]
    from zarr.storage import LocalStore

    class OwnStore(LocalStore):
        """Folder that nobody else writes to: no hard link is needed, which not every file system has."""

        async def set_if_not_exists(self, key: str, value: Any) -> None:
            if not await self.exists(key):
                await self.set(key, value)

    types: dict[str, dict[str, str]] = {}
    store = OwnStore(path.absolute())
    group = zarr.create_group(store, zarr_format=2, attributes=_plain("", skeleton.attributes, types))

    def create(name: str, dims: Any, shape: Any, attrs: Mapping[str, Any], **options: Any) -> Any:
        attributes = {"_ARRAY_DIMENSIONS": list(dims), **_plain(name, attrs, types)}
        return group.create_array(
            name, shape=shape, attributes=attributes, config={"write_empty_chunks": True}, **options
        )

    for label, coordinate in skeleton.coordinates.coords.items():
        values, attrs = encode(coordinate)
        text = values.dtype == object
        array = create(
            str(label),
            map(str, coordinate.dims),
            values.shape,
            attrs,
            chunks=values.shape,
            dtype=np.dtypes.StringDType() if text else values.dtype.newbyteorder("<"),
            fill_value=None,
            filters=[VLenUTF8()] if text else None,
            compressors=None,
        )
        array[...] = values
    made = {}
    for name, variable in skeleton.variables.items():
        dtype, attrs = stored(variable)
        slab, shape = skeleton.cuts[variable.kind].slab, tuple(skeleton.sizes[dim] for dim in variable.dims)
        made[name] = create(
            name,
            variable.dims,
            shape,
            {**attrs, **skeleton.labels(variable)},
            chunks=tuple(min(slab.get(dim, size), size) for dim, size in zip(variable.dims, shape, strict=True)),
            dtype=dtype.newbyteorder("<"),
            fill_value=np.nan if dtype.kind == "f" else None,
            **_codecs(compression, level, dtype),
        )
    record = {
        "sizes": list(map(list, skeleton.sizes.items())),
        "types": types,
        "variables": list(skeleton.variables),
        "slabs": slab_rows(skeleton.cuts),
        "storage": list(map(list, skeleton.storage.items())),
    }
    _consolidate(path, [*map(str, skeleton.coordinates.coords), *skeleton.variables], record)
    return made


def _codecs(compression: str, level: int, dtype: np.dtype) -> dict[str, Any]:
    if compression == "none":
        return {"filters": None, "compressors": None}
    import numcodecs

    codec = {"zlib": numcodecs.Zlib, "zstd": numcodecs.Zstd}[compression]
    # Bytes of like significance side by side, as NetCDF has it.
    shuffle = [numcodecs.Shuffle(dtype.itemsize)] if dtype.itemsize > 1 else None
    return {"filters": shuffle, "compressors": codec(level)}


def _plain(owner: str, attrs: Mapping[str, Any], types: dict[str, dict[str, str]]) -> dict[str, Any]:
    """Attributes as JSON has them; what types they had is noted in `types`."""
    plain = {}
    for name, value in attrs.items():
        array = np.asarray(value)
        if isinstance(value, np.ndarray | np.generic) and array.dtype not in (np.int64, np.float64):
            types.setdefault(owner, {})[name] = array.dtype.str
        if isinstance(value, str):
            plain[name] = str(value)
        else:
            # NetCDF knows no lists of one.
            plain[name] = array.item() if array.size == 1 else array.tolist()
    return plain


def _consolidate(path: Path, names: list[str], record: Mapping[str, Any]) -> None:
    """Gather the metadata in one file, in the order of the result: other programs sort them."""
    files = [".zattrs", ".zgroup", *(f"{name}/{file}" for name in names for file in (".zarray", ".zattrs"))]
    entries = {name: json.loads((path / name).read_text(encoding="utf-8")) for name in files}
    content = {"zarr_consolidated_format": 1, "metadata": entries, _RECORD: record}
    (path / CONSOLIDATED).write_text(json.dumps(content, indent=1, ensure_ascii=False), encoding="utf-8")


def read_metadata(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Content of each metadata file of a group by its name, and what `zarr_group` has noted beside.

    That is ``sizes``, ``types``, ``variables``, ``slabs`` and ``storage`` as they were written; empty where another
    program consolidated. Raises HeliosweepError where the metadata are damaged, or name codecs that heliosweep does not
    write.
    """
    try:
        content = json.loads((path / CONSOLIDATED).read_text(encoding="utf-8"))
        entries = content["metadata"]
        arrays = [entry for name, entry in entries.items() if name.endswith(".zarray")]
        used = {codec["id"] for entry in arrays for codec in (*(entry["filters"] or ()), entry["compressor"]) if codec}
    except OSError as error:
        raise HeliosweepError(f"{path}: is no Zarr result: {CONSOLIDATED}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise HeliosweepError(f"{path}: its metadata ({CONSOLIDATED}) are damaged") from None
    if foreign := sorted(map(str, used - CODECS)):
        raise HeliosweepError(f"{path}: not read, for it names codecs that heliosweep does not write: {foreign}")
    record = content.get(_RECORD)
    empty: dict[str, Any] = {"sizes": [], "types": {}, "variables": [], "slabs": {}, "storage": []}
    return entries, {**empty, **(record if isinstance(record, dict) else {})}

"""`result.zarr`: a result as a Zarr group of format 2, and the working store of a run, which becomes one.

Format 2, for its consolidated metadata and its text are standardised; those of format 3 are not. A chunk is a part of
the run, so that no two parts write to one file, and every chunk is written, also one of nothing but NaN.
"""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from heliosweep.errors import HeliosweepError
from heliosweep.store.encoding import Variable, encode, labels, stored

if TYPE_CHECKING:
    import zarr

CONSOLIDATED = ".zmetadata"
#: Codecs that heliosweep writes. Others are not decoded: one of them, pickle, runs what it reads.
CODECS = {"vlen-utf8", "shuffle", "zlib", "zstd"}
#: Our key beside the consolidated metadata, which readers pass over: what NetCDF knows and Zarr does not.
_RECORD = "heliosweep"

Compression = Literal["none", "zlib", "zstd"]


def create(
    path: str | os.PathLike[str],
    sizes: Mapping[str, int],
    coordinates: xr.Dataset,
    variables: Mapping[str, Variable],
    attributes: Mapping[str, Any],
    chunks: Mapping[str, Mapping[str, int]],
    compression: Compression = "none",
    level: int = 1,
    cut: Mapping[str, Mapping[str, int]] | None = None,
) -> dict[str, zarr.Array]:
    """Make a Zarr group with its coordinates and metadata, whole but for the values of its variables.

    Parameters
    ----------
    path : path
        Folder that is not there yet.
    sizes : mapping of str to int
        Dimensions, in the order of the result.
    coordinates : xarray.Dataset
        Coordinate variables, in memory.
    variables : mapping of str to Variable
        Data variables; their `storage` is not used here.
    attributes : mapping
        Global attributes, strings and numbers.
    chunks : mapping of str to mapping of str to int
        Lengths of each variable's chunks; dimensions that are not named are whole.
    compression : {"none", "zlib", "zstd"}
        Of the data variables.
    level : int
        Of the compression.
    cut : mapping of str to mapping of str to int, optional
        How the run was cut into parts ("points", "series", "storage"), for an export to write in the same order.

    Returns
    -------
    dict of str to zarr.Array
        The data variables, to be filled. Write to these or to those from `arrays`: other ways of opening them leave
        out chunks of nothing but NaN.
    """
    import zarr
    from numcodecs import VLenUTF8  # type: ignore[import-untyped]

    types: dict[str, dict[str, str]] = {}
    group = zarr.create_group(path, zarr_format=2, attributes=_plain("", attributes, types))
    for label, coordinate in coordinates.coords.items():
        name = str(label)
        values, attrs = encode(coordinate)
        text = values.dtype == object
        array = group.create_array(
            name,
            shape=values.shape,
            chunks=values.shape,
            dtype=np.dtypes.StringDType() if text else _little(values.dtype),
            fill_value=None,
            filters=[VLenUTF8()] if text else None,
            compressors=None,
            attributes={"_ARRAY_DIMENSIONS": list(map(str, coordinate.dims)), **_plain(name, attrs, types)},
            config={"write_empty_chunks": True},
        )
        array[...] = values
    made = {}
    for name, variable in variables.items():
        dtype, attrs = stored(variable)
        own = chunks.get(name, {})
        made[name] = group.create_array(
            name,
            shape=tuple(sizes[dim] for dim in variable.dims),
            chunks=tuple(min(own.get(dim, sizes[dim]), sizes[dim]) for dim in variable.dims),
            dtype=_little(dtype),
            fill_value=np.nan if dtype.kind == "f" else None,
            attributes={
                "_ARRAY_DIMENSIONS": list(variable.dims),
                **_plain(name, {**attrs, **labels(variable, coordinates, sizes)}, types),
            },
            config={"write_empty_chunks": True},
            **_codecs(compression, level, dtype),
        )
    record = {
        "sizes": list(map(list, sizes.items())),
        "types": types,
        "variables": list(variables),
        "cut": {key: list(map(list, lengths.items())) for key, lengths in (cut or {}).items()},
    }
    _consolidate(Path(path), [*map(str, coordinates.coords), *variables], record)
    return made


def arrays(path: str | os.PathLike[str], mode: Literal["r", "r+"] = "r+") -> dict[str, zarr.Array]:
    """Arrays of a group, coordinates included, for reading or to go on writing.

    Parameters
    ----------
    path : path
        Group made by `create`.
    mode : {"r", "r+"}
        Read, or read and write.

    Returns
    -------
    dict of str to zarr.Array
        In the order of the result.

    Raises
    ------
    HeliosweepError
        It is none of heliosweep's groups, or damaged.
    """
    import zarr

    metadata = read_metadata(path)
    group = zarr.open_group(path, mode=mode, zarr_format=2, use_consolidated=True)
    names = [name.removesuffix("/.zarray") for name in metadata["metadata"] if name.endswith("/.zarray")]
    made = {}
    with zarr.config.set({"array.write_empty_chunks": True}):  # arrays keep what it was when they were opened
        for name in names:
            array = group[name]
            assert isinstance(array, zarr.Array)
            made[name] = array
    return made


def finish(path: str | os.PathLike[str]) -> None:
    """Check that every chunk was written; the metadata were consolidated by `create`.

    Raises
    ------
    HeliosweepError
        Chunks are missing; names some.
    """
    place = Path(path)
    missing = [
        f"{name}/{chunk}"
        for name, array in arrays(place, "r").items()
        for chunk in sorted({*_chunk_names(array)} - {entry.name for entry in os.scandir(place / name)})
    ]
    if missing:
        more = ", ..." if len(missing) > 3 else ""
        raise HeliosweepError(f"{place}: {len(missing):,} chunks are missing: {', '.join(missing[:3])}{more}")


def open_zarr(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a Zarr result lazily, as `xarray.open_dataset` opens a NetCDF file.

    Raises
    ------
    HeliosweepError
        It is none of heliosweep's groups, or damaged.
    """
    read_metadata(path)
    result = xr.open_zarr(path, chunks=None, consolidated=True, zarr_format=2)
    # Text as NetCDF's readers give it.
    return result.assign_coords(
        {
            name: coordinate.copy(data=coordinate.to_numpy().astype(object).astype(str))
            for name, coordinate in result.coords.items()
            if coordinate.dtype.kind == "T"
        }
    )


def read_metadata(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read and check the consolidated metadata of a group.

    Returns
    -------
    dict
        Of ``metadata``, one entry for each metadata file, and ``heliosweep``: ``sizes``, ``types``, ``variables`` and
        ``cut``, which are empty where another program consolidated.

    Raises
    ------
    HeliosweepError
        They are damaged, or name codecs that heliosweep does not write.
    """
    place = Path(path)
    try:
        content = json.loads((place / CONSOLIDATED).read_text(encoding="utf-8"))
        entries = content["metadata"]
        used = {codec["id"] for name, entry in entries.items() if name.endswith(".zarray") for codec in _used(entry)}
    except OSError as error:
        raise HeliosweepError(f"{place}: is no Zarr result: {CONSOLIDATED}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise HeliosweepError(f"{place}: its metadata ({CONSOLIDATED}) are damaged") from None
    if foreign := sorted(map(str, used - CODECS)):
        raise HeliosweepError(f"{place}: not read, for it names codecs that heliosweep does not write: {foreign}")
    record = content.get(_RECORD)
    return {
        "metadata": entries,
        _RECORD: {"sizes": [], "types": {}, "variables": [], "cut": {}, **(record if isinstance(record, dict) else {})},
    }


def _used(entry: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    codecs = [*(entry["filters"] or ()), entry["compressor"]]
    return [codec for codec in codecs if codec]


def _little(dtype: np.dtype) -> np.dtype:
    return dtype.newbyteorder("<")


def _codecs(compression: Compression, level: int, dtype: np.dtype) -> dict[str, Any]:
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


def _chunk_names(array: zarr.Array) -> Iterator[str]:
    counts = [math.ceil(size / length) for size, length in zip(array.shape, array.chunks, strict=True)]
    for corner in itertools.product(*map(range, counts)):
        yield ".".join(map(str, corner)) or "0"

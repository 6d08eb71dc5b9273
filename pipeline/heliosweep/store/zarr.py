"""Zarr groups: writing `result.zarr` slab by slab, and reading what a group says of itself.

Of format 2, for its consolidated metadata and its text are standardised; those of format 3 are not. A chunk is a slab
of the result, and every chunk is written, also one of nothing but NaN.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from heliosweep.errors import HeliosweepError
from heliosweep.files import writing
from heliosweep.grid.regions import Part, index_of
from heliosweep.store.encoding import Skeleton, encode, slab_rows, stored
from heliosweep.store.netcdf import Write

CONSOLIDATED = ".zmetadata"
#: Codecs that heliosweep writes. Others are not decoded: one of them, pickle, runs what it reads.
CODECS = {"vlen-utf8", "shuffle", "zlib", "zstd"}
#: Our key beside the consolidated metadata, which readers pass over: what NetCDF knows and Zarr does not.
_RECORD = "heliosweep"


@contextmanager
def zarr_group(path: Path, skeleton: Skeleton, compression: str, level: int, named: Path) -> Iterator[Write]:
    """Write a Zarr group; it is complete when the context is left.

    Parameters
    ----------
    path : pathlib.Path
        Folder to make.
    skeleton : Skeleton
        Of the result.
    compression : {"none", "zlib", "zstd"}
        Of the data variables.
    level : int
        Of the compression.
    named : pathlib.Path
        Name of the group in messages.

    Yields
    ------
    callable
        Writes the encoded values of a slab.

    Raises
    ------
    HeliosweepError
        It cannot be written; says how much room there is.
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
    group = zarr.create_group(
        OwnStore(path.absolute()), zarr_format=2, attributes=_plain("", skeleton.attributes, types)
    )

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
    """Read and check the consolidated metadata of a group.

    Returns
    -------
    dict
        Content of each metadata file.
    dict
        ``sizes``, ``types``, ``variables``, ``slabs`` and ``storage`` as they were written; empty where another
        program consolidated.

    Raises
    ------
    HeliosweepError
        They are damaged, or name codecs that heliosweep does not write.
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

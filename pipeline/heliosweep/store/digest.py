"""Digests of results: of the bytes of a file, and of its meaning."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import netCDF4
import numpy as np

from heliosweep.store.encoding import numbers
from heliosweep.store.lock import LIBRARY_LOCK

#: Values hashed at a time. [bytes]
_PIECE = 16 * 2**20


def file_digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file, as hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def tree_digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 over the names and bytes of all files of a folder, as hexadecimal digits; their order does not count."""
    root = Path(path)
    digest = hashlib.sha256()
    for name, size in sorted(tree(root).items()):
        digest.update(name.encode("utf-8", "surrogateescape") + b"\0" + size.to_bytes(8, "little"))
        with (root / name).open("rb") as file:
            while piece := file.read(_PIECE):
                digest.update(piece)
    return digest.hexdigest()


def tree(path: Path) -> dict[str, int]:
    """Files of a folder and of those in it: relative name with slashes, size. [bytes]."""
    return {file.relative_to(path).as_posix(): file.stat().st_size for file in path.rglob("*") if file.is_file()}


def part_digest(values: Mapping[str, np.ndarray]) -> str:
    """SHA-256 over the values of one part of a run.

    Parameters
    ----------
    values : mapping of str to numpy.ndarray
        Values of each variable in the part's region, as computed or as stored: times count as what is stored for them.

    Returns
    -------
    str
        Hexadecimal digits; the same whatever the format of the file that holds the values.
    """
    digest = hashlib.sha256()
    for name in sorted(values):
        array = numbers(values[name])
        digest.update(name.encode() + b"\0")
        digest.update(np.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(-1).view(np.uint8))
    return digest.hexdigest()


def content_digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 over names, dimensions, types, attributes and values of a NetCDF file.

    Equal for files that say the same, whatever library version, storage layout or compression wrote them.

    Parameters
    ----------
    path : path
        NetCDF file.

    Returns
    -------
    str
        Hexadecimal digits.
    """
    digest = hashlib.sha256()
    with LIBRARY_LOCK, netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        digest.update(_canonical({name: len(dim) for name, dim in file.dimensions.items()}))
        digest.update(_canonical(_attributes(file)))
        for name in sorted(file.variables):
            variable = file.variables[name]
            text = variable.dtype is str
            digest.update(_canonical([name, variable.dimensions, "str" if text else variable.dtype.str]))
            digest.update(_canonical(_attributes(variable)))
            for piece in _pieces(variable):
                digest.update(_canonical(piece.tolist()) if text else np.ascontiguousarray(piece).tobytes())
    return digest.hexdigest()


def _attributes(item: netCDF4.Dataset | netCDF4.Variable) -> dict[str, object]:
    values = {name: item.getncattr(name) for name in sorted(item.ncattrs())}
    return {name: np.asarray(value).tolist() for name, value in values.items()}


def _canonical(value: object) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":")).encode()


def _pieces(variable: netCDF4.Variable) -> Iterator[np.ndarray]:
    """The values in the order of their dimensions, in pieces of bounded size made of whole storage chunks."""
    if variable.ndim == 0:
        yield np.asarray(variable[...])
        return
    storage = variable.chunking()
    if storage == "contiguous" or variable.dtype is str:
        storage = [1] * variable.ndim
    else:
        variable.set_var_chunk_cache(size=0, nelems=1)  # every chunk is read once
    room = _PIECE // 8
    lengths = []
    for size, stored in zip(reversed(variable.shape), reversed(storage), strict=True):
        lengths.append(min(size, max(room // stored, 1) * stored) if room else 1)
        room //= max(1, size)
    lengths.reverse()
    starts = [range(0, size, length) for size, length in zip(variable.shape, lengths, strict=True)]
    for corner in itertools.product(*starts):
        yield variable[tuple(slice(i, i + n) for i, n in zip(corner, lengths, strict=True))]

"""Digests of results: of the bytes of a file, and of its meaning."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from heliosweep.store.encoding import numbers

#: Values hashed at a time. [bytes]
_PIECE = 16 * 2**20
#: Files of a Zarr group besides its chunks.
_METADATA = (".zgroup", ".zattrs", ".zmetadata", ".zarray")


def file_digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file, as hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def tree_digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 over the names and bytes of all files of a Zarr group, as hexadecimal digits; their order is nothing."""
    root = Path(path)
    digest = hashlib.sha256()
    for name, size in sorted(tree(root).items()):
        digest.update(name.encode("utf-8", "surrogateescape") + b"\0" + size.to_bytes(8, "little"))
        with (root / name).open("rb") as file:
            while piece := file.read(_PIECE):
                digest.update(piece)
    return digest.hexdigest()


def tree(path: Path) -> dict[str, int]:
    """Zarr's own files of a folder and of those in it: relative name with slashes, size. [bytes]."""
    return {file.relative_to(path).as_posix(): file.stat().st_size for file in _files(path) if _is_own(file.name)}


def foreign(path: Path) -> list[str]:
    """Names of the other files in a Zarr group: of what browses folders, shares or unpacks them, and leaves its own."""
    return sorted(file.relative_to(path).as_posix() for file in _files(path) if not _is_own(file.name))


def odd(path: Path) -> list[str]:
    """Names of what stands for chunks or metadata of a Zarr group and is no file: a pipe would be waited for."""
    there = (entry for entry in path.rglob("*") if _is_own(entry.name) and not entry.is_file() and not entry.is_dir())
    return sorted(entry.relative_to(path).as_posix() for entry in there)


def _files(path: Path) -> Iterator[Path]:
    return (file for file in path.rglob("*") if file.is_file())


def _is_own(name: str) -> bool:
    """Whether a file is metadata or a chunk, as ``0.3.0``."""
    return name in _METADATA or (name.isascii() and name.replace(".", "").isdecimal())


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
        digest.update(_bytes(array))
    return digest.hexdigest()


def content_digest(path: str | os.PathLike[str], told: Callable[[], object] = lambda: None) -> str:
    """SHA-256 over names, dimensions, types, attributes and values of a result.

    Equal for results that say the same, whatever library version, format, storage layout or compression wrote them.

    Parameters
    ----------
    path : path
        NetCDF file or Zarr group.
    told : callable
        Called after every piece that was read.

    Returns
    -------
    str
        Hexadecimal digits.
    """
    from heliosweep.store.raw import open_raw

    digest = hashlib.sha256()
    with open_raw(path, told) as raw:
        digest.update(_canonical(raw.sizes))
        digest.update(_canonical(raw.attributes))
        for name, variable in sorted(raw.variables.items()):
            digest.update(_canonical([name, variable.dims, "str" if variable.text else variable.dtype.str]))
            digest.update(_canonical(variable.attributes))
            for index in raw.pieces(name):
                piece = raw.read(name, index)
                digest.update(_canonical(piece.tolist()) if variable.text else _bytes(piece))
                del piece  # before the next one is read
    return digest.hexdigest()


def _canonical(value: object) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":")).encode()


def _bytes(values: np.ndarray) -> memoryview:
    return np.ascontiguousarray(values, values.dtype.newbyteorder("<")).reshape(-1).view(np.uint8).data

"""Cutting a grid: slabs in the order of the file, and how time series are stored, computed and written."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

#: Time series that one part holds. [bytes]
SERIES_PART_BYTES = 32 * 2**20
#: Instants of a part of a large field: enough that many of them have similar sun directions.
SERIES_INSTANTS = 512
#: Blocks of such a part along the split dimension, and their least length.
SERIES_BLOCKS, LEAST_BLOCK = 8, 64
#: One storage chunk of one time series. [bytes]
STORAGE_BYTES = 2**20


class Part(NamedTuple):
    """A slab of the result that is computed, stored and resumed as one."""

    name: str
    """Stable name, as ``points-00012``."""
    kind: str
    """``points``: all that has no ``time``; ``series``: time series."""
    region: dict[str, slice]
    """Where it lies."""


def slabs(sizes: Mapping[str, int], lengths: Mapping[str, int]) -> Iterator[dict[str, slice]]:
    """Cut a grid into slabs, last dimension fastest.

    Parameters
    ----------
    sizes, lengths : mapping of str to int
        Length of each dimension, and of a slab along it.

    Yields
    ------
    dict of str to slice
    """
    counts = [-(-size // lengths[dim]) for dim, size in sizes.items()]
    for corner in itertools.product(*map(range, counts)):
        yield {
            dim: slice(number * lengths[dim], min((number + 1) * lengths[dim], size))
            for (dim, size), number in zip(sizes.items(), corner, strict=True)
        }


def slab_lengths(sizes: Mapping[str, int], fits: Callable[[Mapping[str, int]], bool]) -> dict[str, int]:
    """Largest slab that is contiguous in the order of the file: whole from the last dimension on, then cut.

    Parameters
    ----------
    sizes : mapping of str to int
        Lengths of the dimensions.
    fits : callable
        Whether a slab of the given lengths fits.

    Returns
    -------
    dict of str to int
        Lengths of the slab, 1 where nothing larger fits.
    """
    slab = dict.fromkeys(sizes, 1)
    for dim, size in reversed(list(sizes.items())):
        if fits({**slab, dim: size}):
            slab[dim] = size
            continue
        while slab[dim] * 2 < size and fits({**slab, dim: slab[dim] * 2}):
            slab[dim] *= 2
        break
    return slab


class Series(NamedTuple):
    """How time series are cut."""

    storage: dict[str, int]
    """Lengths of a storage chunk along ``time`` and the split dimension."""
    chunks: dict[str, int]
    """Block lengths; blocks do not reach over a part."""
    part: dict[str, int]
    """Part lengths along all dimensions. They follow from the sizes alone, for storage is laid out as it is written."""


def series_lengths(
    parameters: Mapping[str, int], times: int, split: Mapping[str, int], value_bytes: int, asked: Mapping[str, int]
) -> Series:
    """Cut the time series of a study.

    Parameters
    ----------
    parameters : mapping of str to int
        Swept dimensions.
    times : int
        Instants.
    split : mapping of str to int
        Name and length of the dimension along which a point may be cut.
    value_bytes : int
        Bytes of all series at one instant and place.
    asked : mapping of str to int
        Block lengths that the user wants; they bound those chosen here.

    Returns
    -------
    Series
    """
    ((name, size),) = split.items()
    instants = min(times, SERIES_INSTANTS)
    places = SERIES_PART_BYTES // (value_bytes * instants)
    if places >= size:
        places, instants = size, min(times, SERIES_PART_BYTES // (value_bytes * size))
    else:
        places = 2 ** int(math.log2(places))
    rows = max(1, min(instants, STORAGE_BYTES // 8 // places))
    if instants < times:
        instants -= instants % rows
    points = dict.fromkeys(parameters, 1)
    if instants == times and places == size:
        point_bytes = value_bytes * times * size
        points = slab_lengths(parameters, lambda slab: point_bytes * math.prod(slab.values()) <= SERIES_PART_BYTES)
    wanted = max(LEAST_BLOCK, -(-places // SERIES_BLOCKS))
    chunks = {dim: min(asked.get(dim, length), length) for dim, length in points.items()}
    chunks["time"] = _within(min(asked.get("time", instants), instants), instants, times)
    chunks[name] = _within(min(asked.get(name, wanted), wanted, places), places, size)
    return Series({"time": rows, name: places}, chunks, {**points, "time": instants, name: places})


def _within(length: int, part: int, size: int) -> int:
    """Largest block of at most `length` that does not reach over a part."""
    if part == size:
        return length
    return next(block for block in range(length, 0, -1) if part % block == 0)

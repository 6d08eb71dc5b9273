"""Regions of a result: its variables, and how it is cut into what is computed and written at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

#: A part of a result: dimension -> slice with start and stop; dimensions that are not named are whole.
Region: TypeAlias = Mapping[str, slice]

#: Values of all time series that one slab holds. [bytes]
SERIES_SLAB_BYTES = 32 * 2**20
#: Instants of a slab of a large field: enough that many of them have similar sun directions.
SERIES_INSTANTS = 512
#: Parts of such a slab along the split dimension, and their least length.
SERIES_PARTS, LEAST_LENGTH = 8, 64
#: One storage chunk of one time series. [bytes]
STORAGE_BYTES = 2**20
#: Values of passing variables that are finished at a time. [bytes]
PASS_BYTES = 16 * 2**20


#: Attribute by which a variable says that its largest or its smallest value is the best; without it neither is.
BEST_VALUE, LARGEST, SMALLEST = "best_value", "largest", "smallest"


@dataclass(frozen=True)
class Variable:
    """A variable of a result, before its values are there.

    Parameters
    ----------
    dims : tuple of str
        Dimensions in the order of the file.
    attrs : mapping
        CF attributes; ``units`` and ``long_name`` among them.
    dtype : numpy.dtype
        Type of the values.
    finished : bool
        True where `Family.finish` makes it from whole points, False where `Family.compute` does.
    passing : bool
        True where it is computed for what is finished from it, and no part of the result.
    without : tuple of str
        Swept dimensions along which a declared variable does not vary.
    missing : object
        Value if the function of a family returns none (default: NaN, NaT or 0).
    """

    dims: tuple[str, ...]
    attrs: Mapping[str, Any]
    dtype: np.dtype = field(default_factory=lambda: np.dtype(np.float64))
    finished: bool = False
    passing: bool = False
    without: tuple[str, ...] = ()
    missing: Any = None

    @property
    def kind(self) -> str:
        """Kind of the parts that hold it: ``series`` where it varies along ``time``, else ``points``."""
        return "series" if "time" in self.dims else "points"


def quantity(
    dims: tuple[str, ...],
    units: str,
    long_name: str,
    comment: str = "",
    *,
    dtype: str = "float64",
    finished: bool = False,
    without: tuple[str, ...] = (),
    missing: Any = None,
    **more: Any,
) -> Variable:
    """Variable of numbers; `more` are further attributes."""
    attrs = {"units": units, "long_name": long_name, **({"comment": comment} if comment else {}), **more}
    return Variable(dims, attrs, np.dtype(dtype), finished, without=without, missing=missing)


def flags(
    dims: tuple[str, ...], long_name: str, meanings: Mapping[int, str], comment: str = "", kind: str = "flag_values"
) -> Variable:
    """Variable of codes with a meaning each; of sums of several codes with the `kind` ``flag_masks``."""
    attrs: dict[str, Any] = {
        kind: np.array(list(meanings), np.int8),
        "flag_meanings": " ".join(meanings.values()),
    }
    return quantity(dims, "1", long_name, comment, dtype="int8", **attrs)


def pair(
    name: str, words: Mapping[str, str], dims: tuple[str, ...], units: str, long_name: str, comment: str = ""
) -> dict[str, Variable]:
    """A quantity along both axes: ``%`` in the name stands for a key of `words`, in the long name for its word."""
    return {
        name.replace("%", axis): quantity(dims, units, long_name.replace("%", word), comment)
        for axis, word in words.items()
    }


def with_best(
    variables: Mapping[str, Variable], largest: Iterable[str], smallest: Iterable[str] = ()
) -> dict[str, Variable]:
    """The same variables, of which those that are named say which of their values is the best."""
    best = dict.fromkeys(largest, LARGEST) | dict.fromkeys(smallest, SMALLEST)
    return {
        name: replace(one, attrs={**one.attrs, BEST_VALUE: best[name]}) if name in best else one
        for name, one in variables.items()
    }


def of_kind(variables: Mapping[str, Variable], kind: str) -> dict[str, Variable]:
    """Variables that `Family.compute` makes in parts of one kind."""
    return {name: one for name, one in variables.items() if one.kind == kind and not one.finished}


def in_result(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Variables that the result has."""
    return {name: one for name, one in variables.items() if not one.passing}


def bytes_of(variables: Mapping[str, Variable], sizes: Mapping[str, int]) -> int:
    """Size of variables for the given lengths of dimensions. [bytes]"""
    return sum(one.dtype.itemsize * math.prod(sizes[dim] for dim in one.dims) for one in variables.values())


def shape_of(variable: Variable, region: Region, sizes: Mapping[str, int]) -> tuple[int, ...]:
    """Shape of a variable over a region of a result with these dimensions."""
    return tuple(len(range(sizes[dim])[region.get(dim, slice(None))]) for dim in variable.dims)


def index_of(dims: tuple[str, ...], region: Region, within: Region | None = None) -> tuple[slice, ...]:
    """Index of a region in an array over `dims`, of a whole result or of a region around it."""
    index = []
    for dim in dims:
        span = region.get(dim, slice(None))
        start = within[dim].start if within and dim in within and span != slice(None) else 0
        index.append(slice(span.start - start, span.stop - start) if start else span)
    return tuple(index)


def checked(
    made: xr.Dataset, variables: Mapping[str, Variable], region: Region, sizes: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """Arrays of what a family computed over a region, in the order and with the dimensions that it has stated.

    `made` is from `Family.compute` or `Family.finish`, `variables` are those that it must have, `sizes` the dimensions
    of the whole result. Raises ValueError where a variable is missing, or has other dimensions, lengths or another
    type.
    """
    arrays = {}
    for name, variable in variables.items():
        if name not in made:
            raise ValueError(f"the family did not compute {name!r}")
        array, shape = made.variables[name].transpose(*variable.dims), shape_of(variable, region, sizes)
        if array.shape != shape or array.dtype != variable.dtype:
            raise ValueError(f"{name}: {array.dtype} of shape {array.shape}, not {variable.dtype} of shape {shape}")
        arrays[name] = np.ascontiguousarray(array.to_numpy()).reshape(shape)
    return arrays


class Part(NamedTuple):
    """A region of the result that is computed, stored and resumed as one."""

    name: str
    """Its kind and number, as ``points-00012``."""
    kind: str
    """``points``: all that has no ``time``; ``series``: time series."""
    region: dict[str, slice]
    """Where it lies."""


@dataclass(frozen=True)
class Cut:
    """How the variables of one kind are cut.

    Slabs are finished and written at a time: they follow from the study alone, and with them the bytes of a result.
    Parts are computed at a time; no part reaches over a slab.

    Parameters
    ----------
    sizes, slab, part : mapping of str to int
        Lengths of the dimensions that are cut, of a slab and of a part along each of them.
    """

    sizes: Mapping[str, int]
    slab: Mapping[str, int]
    part: Mapping[str, int]

    def slabs(self) -> Iterator[dict[str, slice]]:
        """Regions of the slabs in the order of the file, last dimension fastest."""
        return regions({dim: slice(0, size) for dim, size in self.sizes.items()}, self.slab)

    @property
    def slab_count(self) -> int:
        """Number of slabs."""
        return piece_count({dim: slice(0, size) for dim, size in self.sizes.items()}, self.slab)

    @property
    def part_count(self) -> int:
        """Number of parts."""
        return math.prod(
            sum(piece_count({dim: span}, self.part) for span in _spans(0, size, self.slab[dim]))
            for dim, size in self.sizes.items()
        )


def slabs(cuts: Mapping[str, Cut]) -> Iterator[Part]:
    """Slabs of a result in the order of the file, those without ``time`` first."""
    for kind, cut in cuts.items():
        yield from _numbered(kind, cut.slabs())


def parts_by_slab(cuts: Mapping[str, Cut]) -> Iterator[tuple[Part, list[Part]]]:
    """Yield each slab of a result with its parts, last dimension fastest."""
    numbers = dict.fromkeys(cuts, 0)
    for slab in slabs(cuts):
        parts = list(_numbered(slab.kind, regions(slab.region, cuts[slab.kind].part), numbers[slab.kind]))
        numbers[slab.kind] += len(parts)
        yield slab, parts


def parts_of(cuts: Mapping[str, Cut]) -> Iterator[Part]:
    """All parts of a result, slab by slab."""
    return (part for _, parts in parts_by_slab(cuts) for part in parts)


def part_name(kind: str, number: int) -> str:
    """Name of a slab or part of a kind."""
    return f"{kind}-{number:05}"


def _numbered(kind: str, pieces: Iterator[dict[str, slice]], first: int = 0) -> Iterator[Part]:
    return (Part(part_name(kind, number), kind, region) for number, region in enumerate(pieces, first))


def regions(around: Region, lengths: Mapping[str, int]) -> Iterator[dict[str, slice]]:
    """Cut a region into pieces of at most these lengths, last dimension fastest; one after the other, never a list."""
    if not around:
        yield {}
        return
    (dim, span), *others = around.items()
    rest = dict(others)
    for piece in _spans(span.start, span.stop, lengths[dim]):
        for inner in regions(rest, lengths):
            yield {dim: piece, **inner}


def piece_count(around: Region, lengths: Mapping[str, int]) -> int:
    """Number of pieces that `regions` gives."""
    return math.prod(-(-(span.stop - span.start) // lengths[dim]) for dim, span in around.items())


def _spans(start: int, stop: int, length: int) -> Iterator[slice]:
    return (slice(first, min(first + length, stop)) for first in range(start, stop, length))


def slab_lengths(
    sizes: Mapping[str, int], fits: Callable[[Mapping[str, int]], bool], most: Mapping[str, int] | None = None
) -> dict[str, int]:
    """Lengths of the largest slab that is contiguous in the order of the file: whole from the last dimension on.

    `fits` is true for lengths of a slab that is not too large, `most` has the longest lengths that are allowed. The
    lengths are 1 along the dimensions before the one that is cut.
    """
    slab = dict.fromkeys(sizes, 1)
    for dim, size in reversed(list(sizes.items())):
        length = min(size, (most or {}).get(dim, size))
        if not fits({**slab, dim: length}):
            while slab[dim] * 2 < length and fits({**slab, dim: slab[dim] * 2}):
                slab[dim] *= 2
            break
        slab[dim] = length
        if length < size and (most or {}).get(dim, 0) != length:
            break
    return slab


def series_cut(
    parameters: Mapping[str, int],
    times: int,
    split: tuple[str, int],
    value_bytes: int,
    most: Mapping[str, int],
    whole: bool = False,
) -> tuple[Cut, dict[str, int]]:
    """Cut of the time series of a study, over its parameters, ``time`` and the dimension along which a point may be
    cut.

    `split` is the name and length of that dimension, empty and 1 where there is none, `value_bytes` the bytes of all
    series at one instant and place, `most` the longest parts that are allowed; where some series are of the `whole` of
    that dimension, it is not cut. Returned too are the lengths of a storage chunk along ``time`` and the split
    dimension.
    """
    name, size = split
    instants = min(times, SERIES_INSTANTS)
    places = SERIES_SLAB_BYTES // (value_bytes * instants)
    if whole or places >= size:
        places, instants = size, max(1, min(times, SERIES_SLAB_BYTES // (value_bytes * size)))
    else:
        places = 2 ** int(math.log2(places))
    rows = max(1, min(instants, STORAGE_BYTES // 8 // places))
    if instants < times:
        instants -= instants % rows
    points = dict.fromkeys(parameters, 1)
    if instants == times and places == size:
        point_bytes = value_bytes * times * size
        points = slab_lengths(parameters, lambda slab: point_bytes * math.prod(slab.values()) <= SERIES_SLAB_BYTES)
    slab = {**points, "time": instants, name: places}
    part = {**slab, name: max(LEAST_LENGTH, -(-places // SERIES_PARTS))}
    part = {dim: min(length, slab[dim], most.get(dim, length)) for dim, length in part.items()}
    sizes, chunk = {**parameters, "time": times, name: size}, {"time": rows, name: places}
    chunk = {dim: n for dim, n in chunk.items() if dim}
    uncut = name if whole else ""
    sizes, slab, part = ({dim: n for dim, n in one.items() if dim not in ("", uncut)} for one in (sizes, slab, part))
    return Cut(sizes, slab, part), chunk

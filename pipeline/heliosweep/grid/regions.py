"""Variables and regions of a result. A block is written as one unit, and a chunk is computed as one unit."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from heliosweep.lazy import xr

#: Slice of each dimension, with start and stop. The region includes the full length of dimensions that are not listed.
Region: TypeAlias = Mapping[str, slice]

#: Attribute that marks the maximum or the minimum as a variable's best value, and the values of this attribute.
BEST_VALUE, LARGEST, SMALLEST = "best_value", "largest", "smallest"


@dataclass(frozen=True)
class Variable:
    """Declaration of a result variable.

    Parameters
    ----------
    dims : tuple of str
        Dimensions in the order of the file.
    attrs : mapping
        CF attributes, including ``units`` and ``long_name``.
    dtype : numpy.dtype
        Type of the values.
    finished : bool
        True if `Family.finish` computes the variable from complete points, False if `Family.compute` computes it.
    passing : bool
        True if the variable is used only to compute finished variables, and is not part of the result.
    without : tuple of str
        Swept dimensions along which the variable does not vary.
    missing : object
        Value used if the family's function does not return the variable (default: NaN, NaT or 0).
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
        """``series`` if the variable has the ``time`` dimension, otherwise ``points``."""
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
    """Declare a numeric variable; `more` contains additional attributes."""
    attrs = {"units": units, "long_name": long_name, **({"comment": comment} if comment else {}), **more}
    return Variable(dims, attrs, np.dtype(dtype), finished, without=without, missing=missing)


def flags(
    dims: tuple[str, ...], long_name: str, meanings: Mapping[int, str], comment: str = "", kind: str = "flag_values"
) -> Variable:
    """Declare a variable whose values are codes, or sums of codes if `kind` is ``flag_masks``."""
    attrs: dict[str, Any] = {
        kind: np.array(list(meanings), np.int8),
        "flag_meanings": " ".join(meanings.values()),
    }
    return quantity(dims, "1", long_name, comment, dtype="int8", **attrs)


def pair(
    name: str, words: Mapping[str, str], dims: tuple[str, ...], units: str, long_name: str, comment: str = ""
) -> dict[str, Variable]:
    """Declare one variable for each axis in `words`.

    The character ``%`` is replaced by a key of `words` in variable names, and by the text for this key in long names.
    """
    return {
        name.replace("%", axis): quantity(dims, units, long_name.replace("%", word), comment)
        for axis, word in words.items()
    }


def with_best(
    variables: Mapping[str, Variable], largest: Iterable[str], smallest: Iterable[str] = ()
) -> dict[str, Variable]:
    """Return the variables with the attribute `BEST_VALUE` set for each variable in `largest` or `smallest`."""
    best = dict.fromkeys(largest, LARGEST) | dict.fromkeys(smallest, SMALLEST)
    return {
        name: replace(one, attrs={**one.attrs, BEST_VALUE: best[name]}) if name in best else one
        for name, one in variables.items()
    }


def of_kind(variables: Mapping[str, Variable], kind: str) -> dict[str, Variable]:
    """Return the variables of one kind that are computed by `Family.compute`."""
    return {name: one for name, one in variables.items() if one.kind == kind and not one.finished}


def in_result(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the variables that the result contains."""
    return {name: one for name, one in variables.items() if not one.passing}


def bytes_of(variables: Mapping[str, Variable], sizes: Mapping[str, int]) -> int:
    """Return the total size of variables for given dimension lengths. [bytes]"""
    return sum(one.dtype.itemsize * math.prod(sizes[dim] for dim in one.dims) for one in variables.values())


def shape_of(variable: Variable, region: Region, sizes: Mapping[str, int]) -> tuple[int, ...]:
    """Return the shape of a variable over a region; `sizes` contains the dimension lengths of the result."""
    return tuple(len(range(sizes[dim])[region.get(dim, slice(None))]) for dim in variable.dims)


def index_of(dims: tuple[str, ...], region: Region, within: Region | None = None) -> tuple[slice, ...]:
    """Return the index of a region in an array over `dims` that covers the full result or the region `within`."""
    index = []
    for dim in dims:
        span = region.get(dim, slice(None))
        start = within[dim].start if within and dim in within and span != slice(None) else 0
        index.append(slice(span.start - start, span.stop - start) if start else span)
    return tuple(index)


def checked(
    made: xr.Dataset, variables: Mapping[str, Variable], region: Region, sizes: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """Check computed values and return the arrays of a region in the order of declaration.

    Parameters
    ----------
    made : xarray.Dataset
        Values returned by `Family.compute` or `Family.finish`.
    variables : mapping of str to Variable
        Required variables.
    region : Region
        Region of the arrays.
    sizes : mapping of str to int
        Lengths of the dimensions of the full result.

    Raises
    ------
    ValueError
        If a variable is missing, or has an unexpected shape or type.
    """
    arrays = {}
    for name, variable in variables.items():
        if name not in made:
            raise ValueError(f"the family did not compute {name!r}")
        array, shape = made.variables[name].transpose(*variable.dims), shape_of(variable, region, sizes)
        if array.shape != shape or array.dtype != variable.dtype:
            raise ValueError(f"{name}: {array.dtype} of shape {array.shape}, not {variable.dtype} of shape {shape}")
        arrays[name] = np.ascontiguousarray(array.values).reshape(shape)
    return arrays


class Piece(NamedTuple):
    """Block or chunk of a result."""

    #: Name that consists of the kind and a number, such as ``points-00012``.
    name: str
    #: ``series`` for variables with the ``time`` dimension, otherwise ``points``.
    kind: str
    #: Slice of each divided dimension.
    region: dict[str, slice]


@dataclass(frozen=True)
class Cut:
    """Lengths of blocks and chunks for the variables of one kind.

    Blocks, and therefore the bytes of a result, depend only on the study. Each chunk is within one block.

    Parameters
    ----------
    sizes, block, chunk : mapping of str to int
        Lengths of the divided dimensions, and lengths of a block and of a chunk along these dimensions.
    """

    sizes: Mapping[str, int]
    block: Mapping[str, int]
    chunk: Mapping[str, int]

    def blocks(self) -> Iterator[dict[str, slice]]:
        """Return the regions of the blocks in the order of the file; the last dimension varies fastest."""
        return regions({dim: slice(0, size) for dim, size in self.sizes.items()}, self.block)

    @property
    def chunk_count(self) -> int:
        """Number of chunks."""
        return math.prod(
            size // block * -(-block // chunk) + -(-(size % block) // chunk)
            for size, block, chunk in ((size, self.block[dim], self.chunk[dim]) for dim, size in self.sizes.items())
        )


def chunks_by_block(cuts: Mapping[str, Cut]) -> Iterator[tuple[Piece, list[Piece]]]:
    """Yield the blocks of a result in the order of the file, each with its chunks."""
    for kind, cut in cuts.items():
        chunks = itertools.count()
        for number, block in enumerate(cut.blocks()):
            parts = [Piece(piece_name(kind, next(chunks)), kind, part) for part in regions(block, cut.chunk)]
            yield Piece(piece_name(kind, number), kind, block), parts


def piece_name(kind: str, number: int) -> str:
    """Return the name of a block or chunk."""
    return f"{kind}-{number:05}"


def regions(region: Region, lengths: Mapping[str, int]) -> Iterator[dict[str, slice]]:
    """Divide a region into pieces with at most the given lengths; the last dimension varies fastest."""
    spans = (
        [slice(first, min(first + lengths[dim], span.stop)) for first in range(span.start, span.stop, lengths[dim])]
        for dim, span in region.items()
    )
    return (dict(zip(region, each, strict=True)) for each in itertools.product(*spans))


def shortened(
    lengths: Mapping[str, int], order: Iterable[tuple[str, int]], fits: Callable[[Mapping[str, int]], bool]
) -> dict[str, int]:
    """Halve the lengths of dimensions, one dimension after another in `order`, until `fits` returns True."""
    found = dict(lengths)
    for dim, minimum in order:
        while found[dim] > minimum and not fits(found):
            found[dim] = max(minimum, -(-found[dim] // 2))
    return found

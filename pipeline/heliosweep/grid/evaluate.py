"""The one place that hands kernels to xarray and dask.

A kernel face is a plain NumPy function over one block of the grid. `evaluate` calls it once per block, as one dask
task, for all its outputs together; one task more for each output takes its values out.
"""

from __future__ import annotations

import itertools
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import dask.array as da
import numpy as np
import xarray as xr
from dask.highlevelgraph import HighLevelGraph
from numpy.typing import NDArray

from heliosweep.grid.pieces import Constant, Embedded, Given, Joined, Made, Remade, View, Widened, compact_bytes

__all__ = ["CONSTANT_MARK", "PREPARE_MARK", "TASK_MARK", "Made", "Output", "evaluate"]

#: Stands in the names of the tasks that do the planned work; the progress display counts them.
TASK_MARK = "evaluate-"
#: Begin the names of those that make no planned work, and of arrays that blocks share.
PREPARE_MARK, CONSTANT_MARK = "prepare-", "constant-"
#: Pieces of an array up to this size stand in the task itself, larger ones have a key that blocks share. [bytes]
EMBEDDED = 4096

Values: TypeAlias = NDArray[Any]
_Graph: TypeAlias = dict[Any, Any]
_Piece: TypeAlias = Callable[..., Values]


class Output(NamedTuple):
    """An output variable that is cut out of the one block that a face returns.

    Parameters
    ----------
    attrs : mapping
        Attributes of the variable.
    cut : callable
        The face's block, over the dimensions of the grid and then any others -> the variable's values, over the
        dimensions of the grid and those of `sizes`.
    sizes : mapping of str to int
        Dimensions of the variable beyond those of the grid, and their lengths.
    dtype : type
        Of its values.
    """

    attrs: Mapping[str, Any]
    cut: Callable[[Values], Values]
    sizes: Mapping[str, int]
    dtype: Any = np.float64


def evaluate(
    function: Callable[..., np.ndarray],
    inputs: Sequence[xr.DataArray | Made],
    *,
    dims: Sequence[str],
    core: Sequence[Sequence[str]],
    sizes: Mapping[str, int],
    chunks: Mapping[str, int],
    outputs: Mapping[str, Mapping[str, Any] | Output],
    name: str,
    output_core: Mapping[str, int] | None = None,
    order: Mapping[str, Sequence[str]] | None = None,
    shared: Mapping[str, Any] | None = None,
    work: bool = True,
    dtype: Any = np.float64,
) -> dict[str, xr.DataArray]:
    """Evaluate a kernel face lazily over the grid spanned by its inputs.

    Parameters
    ----------
    function : callable
        Takes one NumPy block per input, each with all of `dims` in order (length 1 where the input does not vary)
        and then its core dimensions; returns one block of shape (outputs, *block of `dims`, *`output_core`), or
        (1, *block of `dims`, ...) where outputs are cut out of it.
    inputs : sequence of xarray.DataArray or Made
        Dimensions are a subset of `dims` plus the input's core dimensions, in any order.
    dims : sequence of str
        Dimensions of every output, in order; the kernel loops over these and they may be chunked.
    core : sequence of sequence of str
        Per input the dimensions that a block always holds whole.
    sizes : mapping of str to int
        Lengths of `dims`.
    chunks : mapping of str to int
        Block lengths along `dims`; a dimension not named is whole.
    outputs : mapping of str to mapping or Output
        Attributes of each output variable by name, in the order in which `function` stacks them; or how each is cut
        out of what it returns.
    name : str
        What the tasks are called.
    output_core : mapping of str to int, optional
        Dimensions that every output has beyond `dims`, whole in each block, and their lengths.
    order : mapping of str to sequence of str, optional
        Dimensions of those outputs that shall have them in another order.
    shared : mapping of str to object, optional
        Keyword arguments of `function` that are large and the same for all blocks.
    work : bool
        Whether these tasks are what the plan counted as blocks and the progress display shows.
    dtype : type
        Of the outputs that have none of their own.

    Returns
    -------
    dict of str to xarray.DataArray
        Lazy variables over `dims` and `output_core`.
    """
    lengths = {dim: _blocks(sizes[dim], chunks.get(dim, sizes[dim])) for dim in dims}
    unique = uuid.uuid4().hex
    made = f"{TASK_MARK if work else PREPARE_MARK}{name}-{unique}"
    graph: _Graph = {}
    arguments = [
        _Argument(array, dims, whole, lengths, f"{CONSTANT_MARK}{number}-{unique}", graph)
        for number, (array, whole) in enumerate(zip(inputs, core, strict=True))
    ]
    spanned = {dim for argument in arguments for dim in argument.dims}
    unused = [(axis, dim) for axis, dim in enumerate(dims) if dim not in spanned]
    names = tuple(shared or ())
    keys = [f"{CONSTANT_MARK}{keyword}-{unique}" for keyword in names]
    graph |= {key: (Constant(value),) for key, value in zip(keys, (shared or {}).values(), strict=True)}
    entries = list(outputs.items())
    order = {label: tuple(wanted) for label, wanted in (order or {}).items()}
    natural = (*dims, *(output_core or {}))
    direct = len(entries) == 1 and not isinstance(entries[0][1], Output)
    direct = direct and order.get(entries[0][0], natural) == natural
    for number in itertools.product(*(range(len(each)) for each in lengths.values())):
        pieces, given = [], []
        for argument in arguments:
            piece, key = argument.at(number)
            pieces.append(piece)
            if key is not None:
                given.append(key)
        if unused:  # a dimension that nothing depends on is one all the same
            wide = tuple((axis, lengths[dim][number[axis]]) for axis, dim in unused)
            pieces[0] = Widened(pieces[0], wide)
        zeros = (0,) * len(output_core or {}) if direct else ()
        graph[(made, *number, *zeros)] = (_Block(function, tuple(pieces), names, direct), *keys, *given)
    lazy: list[Any] = [argument.lazy for argument in arguments if argument.lazy is not None]
    blocks = da.Array(
        HighLevelGraph.from_collections(made, graph, dependencies=lazy),
        made,
        tuple(lengths.values()) + tuple((size,) for size in (output_core or {}).values() if direct),
        dtype=dtype,
        meta=np.empty((0,) * (len(dims) + (len(output_core or {}) if direct else 0)), dtype),
    )
    if direct:
        ((only, attrs),) = outputs.items()
        assert not isinstance(attrs, Output)
        return {only: xr.DataArray(blocks, dims=natural, attrs=dict(attrs))}
    return {
        label: _taken(blocks, lengths, place, label, output, output_core or {}, order.get(label), dtype)
        for place, (label, output) in enumerate(entries)
    }


def _blocks(size: int, block: int) -> tuple[int, ...]:
    """Block lengths that cover `size`, all `block` long but perhaps the last."""
    whole, rest = divmod(size, block)
    return (block,) * whole + ((rest,) if rest else ())


def _taken(
    blocks: Any,
    lengths: Mapping[str, tuple[int, ...]],
    place: int,
    label: str,
    output: Mapping[str, Any] | Output,
    output_core: Mapping[str, int],
    order: Sequence[str] | None,
    dtype: Any,
) -> xr.DataArray:
    """One output variable out of what the blocks return."""
    if isinstance(output, Output):
        attrs, cut, new, dtype = output
    else:
        attrs, cut, new = output, None, output_core
    dims = (*lengths, *new)
    order = tuple(order or dims)
    axes = tuple(dims.index(dim) for dim in order)
    take = _Taken(0 if cut else place, cut, axes if order != dims else None)
    name = f"{label}-{blocks.name.rpartition('-')[2]}"
    numbers = itertools.product(*(range(len(each)) for each in lengths.values()))
    zeros = (0,) * len(new)
    graph: _Graph = {}
    for number in numbers:
        position = (*number, *zeros)
        graph[(name, *(position[axis] for axis in axes))] = (take, (blocks.name, *number))
    chunks = {**lengths, **{dim: (size,) for dim, size in new.items()}}
    data = da.Array(
        HighLevelGraph.from_collections(name, graph, dependencies=[blocks]),
        name,
        tuple(chunks[dim] for dim in order),
        dtype=dtype,
        meta=np.empty((0,) * len(order), dtype),
    )
    return xr.DataArray(data, dims=order, attrs=dict(attrs))


@dataclass(frozen=True, slots=True)
class _Taken:
    """Takes one output out of a block."""

    place: int
    cut: Callable[[Values], Values] | None
    axes: tuple[int, ...] | None

    def __call__(self, block: Values) -> Values:
        values = block[self.place]
        if self.cut is not None:
            values = self.cut(values)
        return values if self.axes is None else values.transpose(self.axes)


@dataclass(frozen=True, slots=True)
class _Block:
    """Calls a face on the pieces of its inputs that make one block."""

    function: Callable[..., Values]
    pieces: tuple[_Piece, ...]
    shared: tuple[str, ...]
    direct: bool

    def __call__(self, *given: Any) -> Values:
        others = iter(given)
        keywords = {name: next(others) for name in self.shared}
        arrays = [piece(next(others)) if _waits(piece) else piece() for piece in self.pieces]
        made = self.function(*arrays, **keywords)
        return made[0] if self.direct else made


def _waits(piece: _Piece) -> bool:
    """Whether a piece comes from another task."""
    return isinstance(piece.piece if isinstance(piece, Widened) else piece, Given | Joined)


class _Argument:
    """One input, cut into pieces for blocks."""

    def __init__(
        self,
        source: xr.DataArray | Made,
        dims: Sequence[str],
        core: Sequence[str],
        lengths: Mapping[str, tuple[int, ...]],
        key: str,
        graph: _Graph,
    ) -> None:
        self._made = source if isinstance(source, Made) else None
        array = source.array if isinstance(source, Made) else source
        self.dims = array.dims
        order = [*(dim for dim in dims if dim in array.dims), *core]
        self._view = View(
            tuple(array.dims.index(dim) for dim in order),
            (*(slice(None) if dim in array.dims else None for dim in dims), ...),
        )
        self._axes = [axis for axis, dim in enumerate(dims) if dim in array.dims]
        self._key, self._graph = key, graph
        self._spans = {dim: _spans(lengths[dim]) for dim in dims if dim in array.dims}
        self._places = {dim: axis for axis, dim in enumerate(dims)}
        self._known: dict[tuple[int, ...], tuple[_Piece, Any]] = {}
        self.lazy: da.Array | None = None
        self._values: Values = np.empty(0)
        if isinstance(array.data, da.Array):
            cut = {axis: lengths[str(dim)] for axis, dim in enumerate(array.dims) if dim in lengths}
            same = all(array.data.chunks[axis] == blocks for axis, blocks in cut.items())
            self.lazy = array.data if same else array.data.rechunk(cut)
        else:
            self._values = array.to_numpy()

    def at(self, number: tuple[int, ...]) -> tuple[_Piece, Any]:
        """The piece of a block, and the key or keys of the tasks that it waits for, if any."""
        own = tuple(number[axis] for axis in self._axes)
        if own not in self._known:
            self._known[own] = self._of_lazy(number) if self.lazy is not None else self._of_array(number)
        return self._known[own]

    def _of_array(self, number: tuple[int, ...]) -> tuple[_Piece, Any]:
        region: tuple[Any, ...] = (
            *(
                self._spans[str(dim)][number[self._places[str(dim)]]] if dim in self._spans else slice(None)
                for dim in self.dims
            ),
            ...,  # an array also where there are no dimensions
        )
        part = self._values[region]
        if self._made is not None and part.nbytes > 8 * len(repr(self._made.arguments)):
            return Remade(self._made, region, self._view), None
        # What is repeated in memory stays so.
        piece = self._view(part) if compact_bytes(part) == part.nbytes else self._view.of(part)
        if compact_bytes(piece) <= EMBEDDED or piece.dtype.hasobject:
            return Embedded(piece), None
        key = f"{self._key}-{len(self._known)}"
        self._graph[key] = (Constant(piece),)
        return Given(), key

    def _of_lazy(self, number: tuple[int, ...]) -> tuple[_Piece, Any]:
        assert self.lazy is not None
        ranges = [
            (number[self._places[str(dim)]],) if dim in self._spans else range(len(blocks))
            for dim, blocks in zip(self.dims, self.lazy.chunks, strict=True)
        ]
        keys = [(self.lazy.name, *place) for place in itertools.product(*ranges)]
        return Joined(tuple(map(len, ranges)), self._view), keys


def _spans(lengths: tuple[int, ...]) -> list[slice]:
    """Parts of a dimension that blocks of these lengths are."""
    ends = list(itertools.accumulate(lengths))
    return [slice(end - length, end) for end, length in zip(ends, lengths, strict=True)]

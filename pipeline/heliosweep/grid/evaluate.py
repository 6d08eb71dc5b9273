"""The one place that hands kernels to xarray and dask.

A kernel face is a plain NumPy function over one block of the grid. `evaluate` calls it once per block, as one dask
task, for all its outputs together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import dask.array as da
import numpy as np
import xarray as xr

#: Stands in the names of the tasks that do the planned work; the progress display counts them.
TASK_MARK = "evaluate-"


def evaluate(
    function: Callable[..., np.ndarray],
    inputs: Sequence[xr.DataArray],
    *,
    dims: Sequence[str],
    core: Sequence[Sequence[str]],
    sizes: Mapping[str, int],
    chunks: Mapping[str, int],
    outputs: Mapping[str, Mapping[str, Any]],
    name: str,
    output_core: Mapping[str, int] | None = None,
    work: bool = True,
    dtype: type = np.float64,
) -> dict[str, xr.DataArray]:
    """Evaluate a kernel face lazily over the grid spanned by its inputs.

    Parameters
    ----------
    function : callable
        Takes one NumPy block per input, each with all of `dims` in order (length 1 where the input does not vary)
        and then its core dimensions; returns one block of shape (outputs, *block of `dims`, *`output_core`).
    inputs : sequence of xarray.DataArray
        Dimensions are a subset of `dims` plus the input's core dimensions, in any order.
    dims : sequence of str
        Dimensions of every output, in order; the kernel loops over these and they may be chunked.
    core : sequence of sequence of str
        Per input the dimensions that a block always holds whole.
    sizes : mapping of str to int
        Lengths of `dims`.
    chunks : mapping of str to int
        Block lengths along `dims`; a dimension not named is whole.
    outputs : mapping of str to mapping
        Attributes of each output variable by name, in the order in which `function` stacks them.
    name : str
        What the tasks are called.
    output_core : mapping of str to int, optional
        Dimensions that every output has beyond `dims`, whole in each block, and their lengths.
    work : bool
        Whether these tasks are what the plan counted as blocks and the progress display shows.
    dtype : type
        Of the outputs.

    Returns
    -------
    dict of str to xarray.DataArray
        Lazy variables over `dims` and `output_core`.
    """
    block_sizes = {dim: _blocks(sizes[dim], chunks.get(dim, sizes[dim])) for dim in dims}
    arguments: list[Any] = []
    spanned = {dim for array in inputs for dim in array.dims}
    unused = {dim: sizes[dim] for dim in dims if dim not in spanned}
    inputs = [inputs[0].expand_dims(unused), *inputs[1:]]  # a dimension that nothing depends on is one all the same
    for array, core_dims in zip(inputs, core, strict=True):
        arguments += [_as_dask(array, dims, core_dims, block_sizes), (*dims, *(f"core-{dim}" for dim in core_dims))]
    new = dict(output_core or {})
    labels = ("output", *dims, *new)
    stacked = da.blockwise(
        function,
        labels,
        *arguments,
        new_axes={"output": len(outputs), **new},
        concatenate=True,
        align_arrays=False,  # they are, by `_as_dask`
        adjust_chunks=block_sizes,
        dtype=dtype,
        meta=np.empty((0,) * len(labels), dtype=dtype),
        token=(TASK_MARK if work else "prepare-") + name,
    )
    return {
        output: xr.DataArray(stacked[index], dims=labels[1:], attrs=dict(attrs))
        for index, (output, attrs) in enumerate(outputs.items())
    }


def _blocks(size: int, block: int) -> tuple[int, ...]:
    """Block lengths that cover `size`, all `block` long but perhaps the last."""
    whole, rest = divmod(size, block)
    return (block,) * whole + ((rest,) if rest else ())


def _as_dask(
    array: xr.DataArray, dims: Sequence[str], core_dims: Sequence[str], block_sizes: Mapping[str, tuple[int, ...]]
) -> da.Array:
    """`array` over (dims, core dims), length 1 where it does not vary, chunked along `dims` only."""
    missing = [dim for dim in dims if dim not in array.dims]
    full = array.variable.set_dims({**dict.fromkeys(missing, 1), **dict(zip(array.dims, array.shape, strict=True))})
    ordered = full.transpose(*dims, *core_dims)
    blocks = tuple((1,) if dim in missing else block_sizes[dim] for dim in dims)
    whole = tuple((size,) for size in ordered.shape[len(dims) :])
    if isinstance(ordered.data, da.Array):
        return ordered.data.rechunk(blocks + whole)
    return da.from_array(ordered.to_numpy(), chunks=blocks + whole)

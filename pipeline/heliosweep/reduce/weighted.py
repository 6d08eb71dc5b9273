"""Weighted means whose bits do not depend on how the data are chunked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.grid.evaluate import evaluate


def weighted_mean(
    values: xr.DataArray, weights: xr.DataArray, dim: str, chunks: Mapping[str, int], attrs: Mapping[str, Any]
) -> xr.DataArray:
    """Mean over one dimension, lazily; the whole dimension is summed in one block and one order.

    Parameters
    ----------
    values : xarray.DataArray
        Any dimensions, `dim` among them.
    weights : xarray.DataArray
        Over `dim` and any of the others; values of weight zero are left out, also where they are NaN.
    dim : str
        Dimension that is averaged over.
    chunks : mapping of str to int
        Block lengths along the other dimensions.
    attrs : mapping
        Attributes of the mean.

    Returns
    -------
    xarray.DataArray
        NaN where all weights are zero.
    """
    dims = tuple(str(name) for name in values.dims if name != dim)
    sizes = {name: values.sizes[name] for name in dims}
    mean = evaluate(
        _mean,
        [values, weights],
        dims=dims,
        core=[(dim,), (dim,)],
        sizes=sizes,
        chunks=chunks,
        outputs={"mean": attrs},
        name="mean",
        work=False,
    )
    return mean["mean"]


def _mean(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    weights = np.broadcast_to(weights, values.shape)
    means = np.full(values.shape[:-1], np.nan)
    for index in np.ndindex(values.shape[:-1]):
        used = weights[index] > 0  # taken out, so that padding does not change the order of the sum
        if used.any():
            means[index] = np.sum(values[index][used] * weights[index][used]) / np.sum(weights[index][used])
    return means[np.newaxis]

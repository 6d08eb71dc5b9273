"""How results are encoded for storage, the same in NetCDF and in Zarr: types, attributes, times and text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

_TIME_ATTRIBUTES = {"units": "seconds since 1970-01-01T00:00:00Z", "calendar": "standard"}


@dataclass(frozen=True)
class Variable:
    """What the file is told of a variable before its values come.

    Parameters
    ----------
    dims : tuple of str
        Dimensions in the order of storage.
    attrs : mapping
        Attributes; ``units`` and ``long_name`` among them.
    dtype : numpy.dtype
        Of the stored values.
    storage : mapping of str to int
        Lengths of a storage chunk; empty: contiguous, uncompressed.
    """

    dims: tuple[str, ...]
    attrs: Mapping[str, Any]
    dtype: np.dtype = field(default_factory=lambda: np.dtype(np.float64))
    storage: Mapping[str, int] = field(default_factory=dict)


def stored(variable: Variable) -> tuple[np.dtype, dict[str, Any]]:
    """Type and attributes of a data variable as they are stored."""
    attrs = {**variable.attrs, "coverage_content_type": "modelResult"}
    if variable.dtype.kind == "M":
        return np.dtype(np.float64), {**attrs, **_TIME_ATTRIBUTES}
    return variable.dtype, attrs


def numbers(values: np.ndarray) -> np.ndarray:
    """Times as seconds since 1970, NaN for none; anything else as it is."""
    if values.dtype.kind != "M":
        return values
    return np.where(np.isnat(values), np.nan, values.astype("datetime64[ns]").astype(np.int64) / 1e9)


def encode(coordinate: xr.DataArray) -> tuple[np.ndarray, dict[str, Any]]:
    """Values and attributes of a coordinate as they are stored: text as strings, times as seconds since 1970."""
    values, attrs = coordinate.to_numpy(), dict(coordinate.attrs)
    if values.dtype.kind in "UOT":
        return values.astype(str).astype(object), attrs
    if values.dtype.kind == "M":
        values, attrs = numbers(values), {**attrs, **_TIME_ATTRIBUTES}
    if values.dtype.kind == "f" and np.isnan(values).any():
        attrs["missing_value"] = values.dtype.type(np.nan)
    return values, attrs


def labels(variable: Variable, coordinates: xr.Dataset, sizes: Mapping[str, int]) -> dict[str, str]:
    """The attribute ``coordinates``: those that are no dimensions and belong to the variable; empty without any."""
    names = [
        str(name)
        for name, coordinate in coordinates.coords.items()
        if name not in sizes and set(coordinate.dims) <= set(variable.dims)
    ]
    return {"coordinates": " ".join(names)} if names else {}

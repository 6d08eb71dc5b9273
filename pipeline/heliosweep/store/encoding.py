"""Encoding of results for storage, the same in NetCDF and in Zarr: types, attributes, times and text."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.errors import HeliosweepError
from heliosweep.grid.regions import Cut, Part, Variable, slabs

if TYPE_CHECKING:
    import xarray as xr

_TIME_ATTRIBUTES = {"units": "seconds since 1970-01-01T00:00:00Z", "calendar": "standard"}


@dataclass(frozen=True)
class Skeleton:
    """Everything of a result but its values.

    `sizes` are its dimensions and `variables` the data variables, both in the order of the result; `coordinates` are in
    memory, global `attributes` strings and numbers; `storage` has the lengths of a storage chunk of compressed time
    series in a NetCDF file; `cuts` say how it is cut into slabs, which are written at a time.
    """

    sizes: Mapping[str, int]
    coordinates: xr.Dataset
    variables: Mapping[str, Variable]
    attributes: Mapping[str, Any]
    storage: Mapping[str, int]
    cuts: Mapping[str, Cut]

    def of_kind(self, kind: str) -> dict[str, Variable]:
        """Variables that slabs of a kind hold."""
        return {name: one for name, one in self.variables.items() if one.kind == kind}

    def labels(self, variable: Variable) -> dict[str, str]:
        """The attribute ``coordinates`` of a variable: those that are no dimensions; empty without any."""
        names = [
            str(name)
            for name, coordinate in self.coordinates.coords.items()
            if name not in self.sizes and set(coordinate.dims) <= set(variable.dims)
        ]
        return {"coordinates": " ".join(names)} if names else {}


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


def slab_digest(values: Mapping[str, np.ndarray]) -> str:
    """SHA-256 over the values of a slab by variable, whatever the format of the file that holds them.

    Times count as what is stored for them.
    """
    digest = hashlib.sha256()
    for name in sorted(values):
        digest.update(name.encode() + b"\0")
        digest.update(little_endian(numbers(values[name])))
    return digest.hexdigest()


def little_endian(values: np.ndarray) -> memoryview:
    """Bytes of numbers in the order of their dimensions."""
    return np.ascontiguousarray(values, values.dtype.newbyteorder("<")).reshape(-1).view(np.uint8).data


def slab_rows(cuts: Mapping[str, Cut]) -> dict[str, list[list[Any]]]:
    """Slabs of a result as plain data: by kind, rows of a dimension, its size and the length of a slab along it."""
    return {kind: [[dim, size, cut.slab[dim]] for dim, size in cut.sizes.items()] for kind, cut in cuts.items()}


def slabs_of(rows: Mapping[str, Any], sizes: Mapping[str, int]) -> Iterator[Part]:
    """Slabs of a result of these dimensions from `slab_rows`, in the order of the file.

    Raises HeliosweepError where they are not of such a result.
    """
    cuts = {}
    try:
        for kind, lines in rows.items():
            if wrong := [dim for dim, size, _ in lines if sizes.get(dim) != size]:
                raise ValueError(f"{wrong[0]} has another length")
            slab = {dim: int(length) for dim, _, length in lines}
            cuts[kind] = Cut({dim: sizes[dim] for dim in slab}, slab, slab)
        yield from slabs(cuts)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise HeliosweepError(f"the cut into slabs does not fit the result: {error}") from None

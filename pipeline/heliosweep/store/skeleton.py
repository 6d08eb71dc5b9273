"""Everything of a result but its values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.store.encoding import Variable

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.store.zarr_result import Compression


@dataclass(frozen=True)
class Skeleton:
    """Everything of a result but its values.

    Parameters
    ----------
    sizes : mapping of str to int
        Dimensions, in the order of the result.
    coordinates : xarray.Dataset
        Coordinate variables, in memory.
    variables : mapping of str to Variable
        Data variables.
    attributes : mapping
        Global attributes, strings and numbers.
    """

    sizes: Mapping[str, int]
    coordinates: xr.Dataset
    variables: Mapping[str, Variable]
    attributes: Mapping[str, Any]

    def create_zarr(
        self, path: Path, cut: Mapping[str, Mapping[str, int]], compression: Compression = "none", level: int = 1
    ) -> None:
        """Make a Zarr group without values, with one chunk for each part of the run and variable."""
        from heliosweep.store.zarr_result import create

        chunks = {
            name: cut["series" if "time" in variable.dims else "points"] for name, variable in self.variables.items()
        }
        create(path, self.sizes, self.coordinates, self.variables, self.attributes, chunks, compression, level, cut=cut)

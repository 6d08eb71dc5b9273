"""Opening a result, of either format."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from heliosweep.errors import Problem, StudyError
from heliosweep.store.lock import LIBRARY_LOCK
from heliosweep.store.raw import is_netcdf, locate

if TYPE_CHECKING:
    import xarray as xr


def open_result(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a result; safe also while other threads run studies.

    Parameters
    ----------
    path : path
        A result folder, or its ``result.nc`` or ``result.zarr``.

    Returns
    -------
    xarray.Dataset
        Lazily read; close it, or use it as a context manager.

    Raises
    ------
    StudyError
        A folder without a result, or a file that is none.
    """
    place = locate(path)
    if place.is_dir():
        from heliosweep.store.zarr_result import open_zarr

        return open_zarr(place)
    if not is_netcdf(place):
        raise StudyError(Problem("is no result; name a result folder", file=str(place)))
    import xarray as xr

    with LIBRARY_LOCK:
        return xr.open_dataset(place, engine="netcdf4", lock=LIBRARY_LOCK)

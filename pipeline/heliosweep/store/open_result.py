"""Opening a result, of either format."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from heliosweep.errors import Problem, StudyError
from heliosweep.store.lock import LIBRARY_LOCK

if TYPE_CHECKING:
    import xarray as xr

#: Name of the result in its folder, by format.
RESULTS = {"netcdf": "result.nc", "zarr": "result.zarr"}


def find_result(path: str | os.PathLike[str]) -> Path:
    """The result that a path means: the path itself, or the result in that result folder.

    Raises
    ------
    StudyError
        Where there is none.
    """
    place = Path(path)
    if place.is_dir() and not (place / ".zgroup").exists():
        for name in RESULTS.values():
            if (place / name).exists():
                return place / name
        raise StudyError(Problem("holds no result.nc and no result.zarr; run the study first", file=str(place)))
    return place


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
        A folder without a result.
    """
    place = find_result(path)
    if place.is_dir():
        from heliosweep.store.zarr_result import open_zarr

        return open_zarr(place)
    import xarray as xr

    with LIBRARY_LOCK:
        return xr.open_dataset(place, engine="netcdf4", lock=LIBRARY_LOCK)

"""Reading of results: find, open and digest them."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from heliosweep.errors import HeliosweepError, Problem, StudyError, reason_of
from heliosweep.files import LIBRARY_LOCK, user_path
from heliosweep.lazy import xr
from heliosweep.store.folder import RESULT, read_manifest, unfinished


def is_netcdf(path: Path) -> bool:
    """Return True for a file that begins as NetCDF files do."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(8).startswith((b"\x89HDF", b"CDF"))  # on HDF5, and older ones


def locate(path: str | os.PathLike[str]) -> Path:
    """Return the path of a result: a NetCDF file, or the result in a folder. Raises StudyError."""
    place = user_path(path)
    if not place.exists():
        raise StudyError(Problem("no such file or folder", file=str(place)))
    if place.is_dir() and not (place / RESULT).is_file():
        left = "; its run is unfinished" if unfinished(place) else ""
        raise StudyError(Problem(f"holds no result{left}", file=str(place)))
    return place / RESULT if place.is_dir() else place


def open_result(path: str | os.PathLike[str], chunks: Any = None) -> xr.Dataset:
    """Open a result folder, or its ``result.nc``, as a lazily read data set; safe while other threads run studies.

    Parameters
    ----------
    path : path
        Result folder or file.
    chunks : optional
        As for `xarray.open_dataset`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    StudyError
        If there is no result.
    HeliosweepError
        If it is damaged.
    """
    place = locate(path)
    if not is_netcdf(place):
        raise StudyError(Problem("is no result; name a result folder", file=str(place)))
    try:
        with LIBRARY_LOCK:
            result = stored = xr.open_dataset(place.absolute(), engine="netcdf4", lock=LIBRARY_LOCK, chunks=chunks)
    except Exception as error:  # the libraries raise anything for damaged files
        raise HeliosweepError(f"{place}: is damaged: {reason_of(error)}; run the study again") from error
    old = [str(name) for name in result.variables if "least_tolerance" in str(name)]  # of version 0.1
    result = result.rename({name: name.replace("least_tolerance", "minimum_tolerance") for name in old})
    texts = {name: item for name, item in result.coords.items() if item.dtype.kind in "OT"}
    decoded = result.assign_coords(
        {name: (item.dims, item.values.astype(object).astype(str), item.attrs) for name, item in texts.items()}
    )
    decoded.set_close(stored.close)
    return decoded


def result_digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_digest(place: Path) -> None:
    """Raise HeliosweepError if the bytes of a result differ from the manifest in its folder, if any."""
    try:
        recorded = read_manifest(place.parent)["result"]
    except HeliosweepError:
        return
    if recorded["file"] == place.name and recorded["sha256"] != result_digest(place):
        raise HeliosweepError(f"{place}: is damaged: its SHA-256 differs from the manifest; run the study again")

"""Reading of results: find, open, digest and export them."""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from heliosweep.errors import HeliosweepError, Problem, StudyError, reason_of
from heliosweep.files import user_path, written_whole
from heliosweep.store.folder import FORMATS, RESULTS, is_zarr, read_manifest, target_file, unfinished

if TYPE_CHECKING:
    import xarray as xr

#: File that an export writes by default: not named like a result, because the folder holds one.
EXPORT = "export.nc"


def is_netcdf(path: Path) -> bool:
    """Return True for a file that begins as NetCDF files do."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(8).startswith((b"\x89HDF", b"CDF"))  # on HDF5, and older ones


def locate(path: str | os.PathLike[str]) -> Path:
    """Return the path of a result: a NetCDF file, a Zarr group, or the result in a folder. Raises StudyError."""
    place = user_path(path)
    if not place.exists():
        raise StudyError(Problem("no such file or folder", file=str(place)))
    if not place.is_dir() or is_zarr(place):
        return place
    found = [name for name in RESULTS if (place / name).exists()]
    if not found:
        left = "; its run is unfinished" if unfinished(place) else ""
        raise StudyError(Problem(f"holds no result{left}", file=str(place)))
    return place / found[0]


def open_result(path: str | os.PathLike[str], chunks: Any = None) -> xr.Dataset:
    """Open a result folder, or its ``result.nc`` or ``result.zarr``, as a lazily read data set.

    The encoding of a Zarr group is dropped, so that the data set can be saved in any format. Safe also while other
    threads run studies.

    Parameters
    ----------
    path : path
        Result folder, file or group.
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
    import xarray as xr

    from heliosweep.files import LIBRARY_LOCK

    place = locate(path)
    if not place.is_dir() and not is_netcdf(place):
        raise StudyError(Problem("is no result; name a result folder", file=str(place)))
    try:
        if place.is_dir():
            stored = xr.open_zarr(place.absolute(), chunks=chunks, consolidated=True)
            result = stored.drop_encoding()
            for item in result.variables.values():  # JSON has no type for them, and CF wants that of the variable
                for name in item.attrs.keys() & {"flag_values", "flag_masks"}:
                    item.attrs[name] = np.asarray(item.attrs[name], item.dtype)
        else:
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
    """Return the SHA-256 of a result: of the file, or of the names and bytes of all files of a Zarr group."""
    if not path.is_dir():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    digest = hashlib.sha256()
    for name, size in sorted(tree(path).items()):
        digest.update(name.encode("utf-8", "surrogateescape") + b"\0" + size.to_bytes(8, "little"))
        with (path / name).open("rb") as file:
            while piece := file.read(2**24):
                digest.update(piece)
    return digest.hexdigest()


def result_bytes(path: Path) -> int:
    """Return the size of a result. [bytes]"""
    return sum(tree(path).values()) if path.is_dir() else path.stat().st_size


def tree(path: Path) -> dict[str, int]:
    """Return relative names and sizes of the files of a Zarr group, without files of other programs. [bytes]

    They are metadata and chunks: ``c/0/3`` in format 3, ``0.3`` in format 2.
    """
    metadata = (".zgroup", ".zattrs", ".zmetadata", ".zarray", "zarr.json", "c")
    chunk = re.compile(r"[0-9]+(\.[0-9]+)*")
    own = (file for file in path.rglob("*") if file.name in metadata or chunk.fullmatch(file.name))
    return {file.relative_to(path).as_posix(): file.stat().st_size for file in own if file.is_file()}


def export(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str] | None = None,
    *,
    compression: Literal["none", "zlib"] = "none",
    level: int = 1,
    force: bool = False,
) -> Path:
    """Write a Zarr result as one NetCDF file and return its path.

    Parameters
    ----------
    source : path
        Zarr group, or result folder with one.
    target : path, optional
        File to write (default: ``export.nc`` in the result folder).
    compression : {"none", "zlib"}
        Compression of time series.
    level : int
        Level of compression.
    force : bool
        Replace an existing file.

    Raises
    ------
    StudyError
        If there is no Zarr result, or the target exists.
    HeliosweepError
        If the result is damaged, or the file cannot be written.
    """
    place = user_path(source)
    if target is not None:
        target_file(target, force, endings=(".nc", ".csv", ".xlsx"))
    if place.is_dir() and (place / FORMATS["zarr"]).is_dir():
        place = place / FORMATS["zarr"]
    if not is_zarr(place):
        raise StudyError(Problem("is no Zarr result; a NetCDF result needs no export", file=str(source)))
    file = target_file(place.with_name(EXPORT) if target is None else target, force, endings=(".nc",))
    check_digest(place)
    with open_result(place, chunks={}) as result, written_whole(file) as temporary:
        encoding: dict[str, dict[str, Any]] = {
            str(name): {"dtype": "S1"} for name, item in result.variables.items() if item.dtype.kind in "UOT"
        }
        if compression == "zlib":
            series = (name for name, item in result.data_vars.items() if "time" in item.dims)
            encoding |= {str(name): {"zlib": True, "complevel": level} for name in series}
        result.to_netcdf(temporary, engine="netcdf4", encoding=encoding)
    return file


def check_digest(place: Path) -> None:
    """Raise HeliosweepError if the bytes of a result differ from the manifest in its folder, if any."""
    try:
        recorded = read_manifest(place.parent)["result"]
    except HeliosweepError:
        return
    if recorded["file"] == place.name and recorded["sha256"] != result_digest(place):
        raise HeliosweepError(f"{place}: is damaged: its SHA-256 differs from the manifest; run the study again")

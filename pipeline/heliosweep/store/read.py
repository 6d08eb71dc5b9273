"""Functions that locate, open and verify results."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from heliosweep.errors import HeliosweepError, Problem, StudyError, reason_of
from heliosweep.files import LIBRARY_LOCK, human_bytes, user_path
from heliosweep.lazy import xr
from heliosweep.store.folder import MANIFEST, RESULT, is_locked, manifest_digest, read_manifest, unfinished


def is_netcdf(path: Path) -> bool:
    """Return True if a file has the signature of NetCDF."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(8).startswith((b"\x89HDF", b"CDF"))  # signatures of HDF5-based and of classic files


def locate(path: str | os.PathLike[str]) -> Path:
    """Return the path of a NetCDF file, or of the result in a folder. Raises StudyError if there is no result."""
    place = user_path(path)
    if not place.exists():
        raise StudyError(Problem("no such file or folder", file=str(place)))
    if place.is_dir() and not (place / RESULT).is_file():
        left = "; its run is not finished" if unfinished(place) else ""
        if (place / "result.zarr").exists():
            left = " in NetCDF; open result.zarr of version 0.1 with xarray.open_zarr, or run the study again"
        raise StudyError(Problem(f"holds no result{left}", file=str(place)))
    return place / RESULT if place.is_dir() else place


def open_result(path: str | os.PathLike[str], chunks: Any = None) -> xr.Dataset:
    """Open a result folder, or a file ``result.nc``, as a lazy data set.

    Parameters
    ----------
    path : path
        Result folder or file.
    chunks : optional
        As in `xarray.open_dataset`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    StudyError
        If the path contains no result.
    HeliosweepError
        If the result is damaged.
    """
    place = locate(path)
    if not is_netcdf(place):
        raise StudyError(Problem("is not a result: give a result folder", file=str(place)))
    try:
        with LIBRARY_LOCK:
            result = stored = xr.open_dataset(place.absolute(), engine="netcdf4", lock=LIBRARY_LOCK, chunks=chunks)
    except Exception as error:  # for damaged files, the libraries may raise any type of exception
        raise HeliosweepError(f"{place}: is damaged: {reason_of(error)}; run the study again") from error
    old = [str(name) for name in result.variables if "least_tolerance" in str(name)]  # names used by version 0.1
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
    """Raise HeliosweepError if the digest of a result differs from the digest in its manifest."""
    try:
        recorded = read_manifest(place.parent)["result"]
    except HeliosweepError:
        return
    if recorded["file"] == place.name and recorded["sha256"] != result_digest(place):
        raise HeliosweepError(
            f"{place}: is damaged, because its SHA-256 differs from the manifest: run the study again"
        )


class Verification(NamedTuple):
    """Findings of the verification of a result folder. The field `ok` is False if a file is damaged or missing."""

    folder: Path
    finished: bool
    ok: bool
    lines: list[str]

    def __str__(self) -> str:
        verdict = ("all right" if self.finished else "unfinished, no damage so far") if self.ok else "NOT all right"
        return "\n".join([f"{self.folder}: {verdict}", *(f"  {line}" for line in self.lines)])


def verify(folder: str | os.PathLike[str]) -> Verification:
    """Check a finished or unfinished result folder without changing it. Damage is reported without an exception."""
    place = user_path(folder)
    finished = (place / MANIFEST).exists() or unfinished(place) is None
    found = list[tuple[bool, str]]()
    try:
        found.extend(_of_finished(place) if finished else _of_chunks(place))
    except (HeliosweepError, OSError, ValueError) as error:
        found.append((False, str(error).removeprefix(f"{place}/")))
    return Verification(place, finished, all(good for good, _ in found), [line for _, line in found])


def _of_finished(folder: Path) -> Iterator[tuple[bool, str]]:
    if not folder.is_dir():
        raise HeliosweepError("is not a folder: give a result folder, or run the study")
    manifest, path = read_manifest(folder), folder / RESULT
    if not path.exists():
        yield False, f"{RESULT}: is missing"
    elif result_digest(path) != manifest["result"]["sha256"]:
        yield False, f"{RESULT}: is not as written (SHA-256); run the study again"
    else:
        yield True, f"{RESULT}: {human_bytes(path.stat().st_size)}, as written (SHA-256)"
    if manifest.get("digest", manifest_digest(manifest)) != manifest_digest(manifest):
        yield False, f"{MANIFEST}: is not as written (SHA-256)"
    if not (folder / "report.html").is_file():
        yield True, f"note: there is no report.html; write it with: heliosweep report {folder}"


def _of_chunks(folder: Path) -> Iterator[tuple[bool, str]]:
    store = unfinished(folder)
    assert store is not None
    done = sorted(store.done())
    damaged = [name for name in done if store.load(name) is None]
    yield True, f"{len(done) - len(damaged):,} of {store.record['chunks']:,} chunks are done"
    yield from ((False, f"chunk {name}: is damaged; the next run computes it again") for name in damaged)
    if is_locked(folder):
        yield True, "note: a run is active in this folder"

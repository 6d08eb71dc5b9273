"""Functions to read and write files, resolve user paths, lock the NetCDF library, and count processors."""

from __future__ import annotations

import csv
import importlib.util
import itertools
import math
import os
import platform
import re
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, TypeVar

import psutil

from heliosweep.errors import HeliosweepError, Problem, StudyError

T = TypeVar("T")
_numbers = itertools.count()
#: Prefix that marks the name of a file in the pvlib package, such as ``pvlib:data/723170TYA.CSV``.
PVLIB = "pvlib:"


def read_once(most: int) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Cache up to `most` results of a function whose first argument is a file, until the file changes.

    A result is not cached if the file changed within the last 20 ms, because a later change could have the same time
    stamp.
    """

    def decorated(read: Callable[..., T]) -> Callable[..., T]:
        kept = lru_cache(most)(lambda stamp, *args, **kwargs: read(*args, **kwargs))

        @wraps(read)
        def reading(path: Path, *args: Any, **kwargs: Any) -> T:
            with suppress(OSError, ValueError):  # for example, if the name contains a NUL character
                status = path.stat()
                if not 0 <= time.time_ns() - status.st_mtime_ns < 20_000_000:
                    return kept((status.st_mtime_ns, status.st_size), path, *args, **kwargs)
            return read(path, *args, **kwargs)

        return reading

    return decorated


def user_path(path: str | os.PathLike[str]) -> Path:
    """Return a path given by the user, with ``~`` and ``~name`` expanded.

    Raises
    ------
    StudyError
        If the home folder does not exist, or if `path` is a URL such as ``s3://bucket/folder``.
    """
    name = os.fspath(path)
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", name):  # such as s3://bucket, but not a drive letter such as C:
        raise StudyError(Problem("is a URL, not a path on this machine; specify a local file or folder", file=name))
    expanded = os.path.expanduser(name)  # noqa: PTH111  # pathlib also expands "./~" to the home folder
    if expanded == name and name.startswith("~"):
        problem = "there is no such home folder; for a file with this name, use a ./ prefix or the full path"
        raise StudyError(Problem(problem, file=name))
    place = Path(expanded)  # `Path` drops the "./" of "./~"
    return place.absolute() if place.parts[:1] and place.parts[0].startswith("~") else place


def named_in(folder: Path, name: str) -> Path:
    """Return the path of a file whose name is relative to `folder`, or begins with ``~`` or ``pvlib:``.

    Raises StudyError under the same conditions as `user_path`.
    """
    if name.startswith(PVLIB):
        spec: Any = importlib.util.find_spec("pvlib")  # finds pvlib without importing it
        return Path(spec.origin).parent / name.removeprefix(PVLIB)
    return folder / (user_path(name) if name.startswith("~") else name)


def seen_from(folder: Path, path: Path) -> str:
    """Return a file name relative to `folder`, from which `named_in` recovers the path."""
    seen = os.path.relpath(path, folder)
    if os.path.realpath(folder / seen) != os.path.realpath(path):
        seen = os.path.relpath(Path(os.path.realpath(path.parent)) / path.name, os.path.realpath(folder))
    return Path(seen).as_posix()


@contextmanager
def written_whole(path: Path, outdated: Iterable[Path] = ()) -> Iterator[Path]:
    """Yield a temporary file name, and rename the complete file to `path`.

    The file is flushed to disk before it is renamed.

    Parameters
    ----------
    path : pathlib.Path
        File to write. An existing file is replaced atomically.
    outdated : iterable of pathlib.Path
        Files to remove after the flush, immediately before the file is renamed.

    Yields
    ------
    pathlib.Path
        Unique file name in the folder of `path`.

    Raises
    ------
    HeliosweepError
        If the file cannot be written. The message gives the reason, and no temporary file remains.
    """
    temporary = temporary_name(path)
    try:
        with writing(path):
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            for each in outdated:
                each.unlink(missing_ok=True)
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file atomically. Characters that UTF-8 cannot encode are escaped.

    Raises
    ------
    HeliosweepError
        If the file cannot be written. The message gives the reason.
    """
    data = content.encode(errors="backslashreplace") if isinstance(content, str) else content
    with written_whole(path) as temporary:
        temporary.write_bytes(data)


def write_rows(rows: Iterable[Iterable[object]], path: Path, notes: Iterable[str] = ()) -> None:
    """Write comment lines and rows to a UTF-8 CSV file atomically. Raises HeliosweepError on failure."""
    with written_whole(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.writelines(f"# {line}\n" for line in notes)
        csv.writer(file, lineterminator="\n").writerows(rows)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Convert an OSError during writing to a HeliosweepError that states the reason.

    Raises
    ------
    HeliosweepError
        If the file cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise HeliosweepError(why_not_written(path, error)) from error


def why_not_written(path: Path, error: Exception) -> str:
    """Return a message with the reason for a failed write and the free disk space.

    Parameters
    ----------
    path : pathlib.Path
        File or folder that could not be written, which need not exist.
    error : OSError or RuntimeError
        Error raised by the operating system or by a library.

    Returns
    -------
    str
        Message such as ``result.nc: cannot be written: disk full (12.3 kB free)``.
    """
    there = next(place for place in (path, *path.absolute().parents) if place.exists())
    free = shutil.disk_usage(there).free
    cause = "disk full" if free < 2**20 else getattr(error, "strerror", None) or error
    return f"{path}: cannot be written: {cause} ({human_bytes(free)} free)"


def human_bytes(count: float) -> str:
    """Format a number of bytes, for example as ``1.4 GB``."""
    for unit in ("B", "kB", "MB", "GB", "TB", "PB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "B" or count >= 100 else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.3g} EB"


def temporary_name(path: Path) -> Path:
    """Return a hidden name in the folder of `path` that no other process or thread uses."""
    return path.with_name(f".{path.name}.{platform.node()}.{os.getpid()}-{next(_numbers)}.part")


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files left by this process and by processes on this machine that have ended."""
    for path in folder.glob(f".*.{platform.node()}.*-*.part"):
        pid = path.name.split(".")[-2].partition("-")[0]
        if pid.isdecimal() and (int(pid) == os.getpid() or not psutil.pid_exists(int(pid))):
            if path.is_dir():  # a Zarr store that version 0.1 left
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)


class _LibraryLock:
    """Reentrant lock for the NetCDF library. Each process has one lock; unpickling returns the lock of the process.

    Only one thread at a time may call the library, even for different files. xarray acquires this lock to read values,
    but not to open files or to read attributes.
    """

    def __init__(self) -> None:
        lock = threading.RLock()
        self.acquire, self.release = lock.acquire, lock.release

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()

    def __reduce__(self) -> str:
        return "LIBRARY_LOCK"


LIBRARY_LOCK = _LibraryLock()


def processors() -> int:
    """Return the number of processors that this process may use, limited by CPU affinity and container quota."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with suppress(OSError, ValueError):  # the process runs outside a container, or without a quota
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text().split()
        count = min(count, math.ceil(int(quota) / int(period)))
    return max(1, count)

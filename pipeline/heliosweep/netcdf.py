"""The NetCDF library, which one thread at a time may enter."""

from __future__ import annotations

import threading
from types import TracebackType

from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK


class _LibraryLock:
    """xarray's lock for the library, made reentrant: two threads must not enter it, not even for two files.

    xarray reads values under its lock, but opens files and reads attributes without one; whoever holds this lock may
    open a file with xarray, and nobody else, be it xarray itself, is in the library meanwhile.
    """

    def __init__(self) -> None:
        self._own = threading.RLock()
        self._depth = 0

    def acquire(self, blocking: bool = True) -> bool:
        if not self._own.acquire(blocking):
            return False
        got = self._depth > 0
        try:
            got = got or NETCDF4_PYTHON_LOCK.acquire(blocking)
        finally:
            if not got:
                self._own.release()
        self._depth += got
        return got

    def release(self) -> None:
        self._depth -= 1
        if not self._depth:
            NETCDF4_PYTHON_LOCK.release()
        self._own.release()

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def __reduce__(self) -> str:
        return "LIBRARY_LOCK"  # there is one in each process


LIBRARY_LOCK = _LibraryLock()

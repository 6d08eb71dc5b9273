"""The NetCDF library, which one thread at a time may enter."""

from __future__ import annotations

import threading


class _LibraryLock:
    """Reentrant lock that remains itself when it is pickled: each process has one.

    Two threads must not enter the library, not even for two files. xarray reads values under the lock that it is given,
    but opens files and reads attributes without one.
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

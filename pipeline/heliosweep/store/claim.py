"""One run at a time in a result folder: a claim that ends with the process that holds it, however that ends."""

from __future__ import annotations

import errno
import json
import logging
import multiprocessing
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from heliosweep.errors import HeliosweepError

if os.name == "posix":
    import fcntl
else:  # pragma: no cover
    import msvcrt

log = logging.getLogger("heliosweep")

#: The claimed file of a result folder.
NAME = ".heliosweep.lock"
#: How often to look whether a claimed folder is free again, and after how long to say that one waits. [s]
_LOOK, _PATIENCE = 0.2, 0.5
#: File systems without locks answer so.
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Hold a result folder against other runs, and wait while another one holds it.

    The system lets go of the claim when the process ends, so a killed run leaves none.

    Parameters
    ----------
    folder : pathlib.Path
        Existing folder.

    Raises
    ------
    HeliosweepError
        In a worker process that only begins.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        # Waiting would never end: the process that waits for this one to start holds the folder.
        raise HeliosweepError('a script that runs a study must do so below `if __name__ == "__main__":`')
    path = folder / NAME
    descriptor = _wait(path)
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()  # whoever waits notices, for it looks whether the name still means the same file
        os.close(descriptor)


def holder(folder: Path) -> str | None:
    """Process that runs a study in a folder now, in words; None where there is none."""
    path = folder / NAME
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return None
    try:
        return None if _take(descriptor, shared=True) else _who(path)
    finally:
        os.close(descriptor)


def _wait(path: Path) -> int:
    start, told = time.monotonic(), False
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except FileNotFoundError:  # a run that left nothing takes its folder with it
            path.parent.mkdir(parents=True, exist_ok=True)
            continue
        try:
            if _take(descriptor) and _is(path, descriptor):
                with suppress(OSError):  # a full disk; it is only a courtesy to others
                    os.ftruncate(descriptor, 0)
                    os.write(descriptor, json.dumps({"process": os.getpid(), "host": platform.node()}).encode())
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)
        if not told and time.monotonic() - start > _PATIENCE:
            told = True
            log.warning("%s is at work in %s; waiting for it (Ctrl-C to give up)", _who(path), path.parent)
        time.sleep(_LOOK)


def _take(descriptor: int, shared: bool = False) -> bool:
    """Try to lock an open file; true also where the file system knows no locks."""
    try:
        if os.name == "posix":
            fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        else:  # pragma: no cover
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except OSError as error:
        return error.errno in _NO_LOCKS
    return True


def _is(path: Path, descriptor: int) -> bool:
    """Whether the name still means the open file, which another run may have removed meanwhile."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _who(path: Path) -> str:
    try:
        said = json.loads(path.read_text())
        return f"process {said['process']} on {said['host']}"
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "another process"

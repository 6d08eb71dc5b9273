"""Files and folders that are not whole yet: their names, and what killed runs have left of them."""

from __future__ import annotations

import contextlib
import itertools
import os
import platform
import secrets
import shutil
import time
from pathlib import Path

_numbers = itertools.count()
#: Tells this process from an earlier one of the same number: in a container that starts again, every run has it.
_token = secrets.token_hex(3)


def temporary_name(path: Path) -> Path:
    """Name beside `path` that no other process, thread or machine uses: ``.NAME.HOST.PID-TOKEN-NUMBER.part``."""
    return path.with_name(f".{path.name}.{platform.node()}.{os.getpid()}-{_token}-{next(_numbers)}.part")


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files and folders of processes of this machine that are no more."""
    for path in folder.glob(f".*.{platform.node()}.*-*.part"):
        pid, _, rest = path.name.split(".")[-2].partition("-")
        if pid.isdecimal() and (not rest.startswith(_token) if int(pid) == os.getpid() else not _alive(int(pid))):
            remove(path)


def sync(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    if os.name != "posix" and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove(path: Path) -> None:
    """Remove a file, or a folder with all that is in it; nothing where it is gone."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def discard(path: Path) -> None:
    """Remove a file or a folder as far as that goes, also one that other threads still write to for a moment."""
    for pause in (0.0, 0.01, 0.1, 0.5):
        time.sleep(pause)
        with contextlib.suppress(OSError):
            remove(path)
        if not path.exists():
            return


def _alive(pid: int) -> bool:
    if os.name != "posix":
        return True  # elsewhere signal 0 is no question but an interruption
    with contextlib.suppress(PermissionError, OverflowError):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
    return True

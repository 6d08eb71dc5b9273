"""Files and folders that are not whole yet: their names, and what killed runs have left of them."""

from __future__ import annotations

import contextlib
import itertools
import os
import platform
import shutil
from pathlib import Path

_numbers = itertools.count()


def temporary_name(path: Path) -> Path:
    """Name beside `path` that no other process, thread or machine uses: ``.NAME.HOST.PID-NUMBER.part``."""
    return path.with_name(f".{path.name}.{platform.node()}.{os.getpid()}-{next(_numbers)}.part")


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files and folders of processes of this machine that are no more."""
    for path in folder.glob(f".*.{platform.node()}.*-*.part"):
        pid = path.name.split(".")[-2].partition("-")[0]
        if pid.isdecimal() and not _alive(int(pid)):
            remove(path)


def remove(path: Path) -> None:
    """Remove a file, or a folder with all that is in it; nothing where it is gone."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _alive(pid: int) -> bool:
    if os.name != "posix":
        return True  # elsewhere signal 0 is no question but an interruption
    with contextlib.suppress(PermissionError, OverflowError):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
    return True

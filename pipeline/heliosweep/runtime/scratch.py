"""Folders for what a cluster keeps on the disk while it runs, and what killed runs have left of them."""

from __future__ import annotations

import os
import platform
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: Those of this process: an earlier one may have had its number, as in a container that starts again.
_own: set[Path] = set()


@contextmanager
def scratch() -> Iterator[str]:
    """Give a folder of its own, and remove it at the end; those of processes that are no more go first."""
    sweep()
    prefix = f"heliosweep-{platform.node()}-{os.getpid()}-"
    with tempfile.TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True) as folder:
        _own.add(Path(folder))
        try:
            yield folder
        finally:
            _own.discard(Path(folder))


def sweep() -> None:
    """Remove the folders that killed processes of this user have left on this machine."""
    form = re.compile(rf"heliosweep-{re.escape(platform.node())}-([0-9]{{1,9}})-[^-]+")
    with suppress(OSError):
        for folder in sorted(Path(tempfile.gettempdir()).iterdir()):
            match = form.fullmatch(folder.name)
            if match and folder not in _own and not _alive(int(match[1])) and _is_mine(folder):
                shutil.rmtree(folder, ignore_errors=True)


def _alive(process: int) -> bool:
    """Whether another process has this number."""
    import psutil  # type: ignore[import-untyped]

    return process != os.getpid() and psutil.pid_exists(process)


def _is_mine(folder: Path) -> bool:
    """Whether it is a folder, no link to one, and of this user: anybody may write to where it stands."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return folder.is_dir() and not folder.is_symlink() and (os.name != "posix" or found.st_uid == os.getuid())

"""What this machine offers, and how sizes and durations are put in words."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from heliosweep.errors import HeliosweepError
from heliosweep.processors import group_folders, processors, words_of

try:
    import resource
except ImportError:  # no Unix
    resource = None  # type: ignore[assignment]

#: Files of limit and use, and the name of cached files in ``memory.stat``, of control groups of version 2 and 1.
_MEMORY = (
    ("memory.max", "memory.current", "file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_cache"),
)
#: Addresses and data that a process asks for and does not use: of the libraries, and of each thread. [bytes]
UNUSED_ADDRESSES, UNUSED_DATA, UNUSED_PER_WORKER = 1100 * 2**20, 200 * 2**20, 80 * 2**20

#: Files that a run may have open at a time; with processes, it needs twice as many.
OPEN_FILES = 32


@dataclass(frozen=True)
class Limits:
    """Limits of the machine and of the study's ``execution`` block: workers, memory and disk. [1, bytes, bytes]"""

    workers: int
    memory: int
    disk: int


def machine_limits(workers: int | None, memory: int | None, folder: str | os.PathLike[str]) -> Limits:
    """What the machine offers, where the study asks for nothing else.

    Workers are the processors that this process may use, its control group considered; memory [bytes] is 80 % of what
    is available now, or of what its control groups and the limits of the process (``ulimit -v``, ``-d``) leave; disk is
    what is free where the result will be written, at the nearest existing parent of `folder`.
    """
    workers = workers or processors()
    available = [psutil.virtual_memory().available, *_group_memory(), *_process_memory(workers)]
    disk = _free_disk(Path(folder).absolute())
    return Limits(workers, memory or int(0.8 * max(0, min(available))), disk)


def check_open_files(scheduler: str) -> None:
    """Refuse to begin a run that cannot open the files it needs, for libraries tell of it as of damage or of nothing.

    Raises HeliosweepError, with the limit (``ulimit -n``) and how to raise it.
    """
    if resource is None:
        return
    needed = OPEN_FILES if scheduler in ("synchronous", "threads") else 2 * OPEN_FILES
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    try:
        left = limit - psutil.Process().num_fds()
    except OSError:  # to count them, a file is opened
        left = 0
    if limit != resource.RLIM_INFINITY and left < needed:
        raise HeliosweepError(
            f"a process may have {limit:,} files open here, {max(left, 0):,} of them are left, and this run needs "
            f"{needed}; allow more (ulimit -n 1024) and run it again: nothing is lost"
        )


def _process_memory(workers: int) -> Iterator[int]:
    """What the limits of this process (``ulimit -v`` and ``-d``) leave of memory. [bytes]"""
    if resource is None:
        return
    for kind, unused in (("RLIMIT_AS", UNUSED_ADDRESSES), ("RLIMIT_DATA", UNUSED_DATA)):
        limit, _ = resource.getrlimit(getattr(resource, kind))
        if limit != resource.RLIM_INFINITY:
            yield limit - unused - workers * UNUSED_PER_WORKER


def _group_memory() -> Iterator[int]:
    """What the limits of this process's control groups leave of memory. [bytes]"""
    for place in group_folders("memory"):
        for limit, used, cached in _MEMORY:
            if (allowed := _number(place / limit)) is not None:
                # What other processes of the group hold; files in the cache give way.
                statistics = dict(zip(*[iter(words_of(place / "memory.stat"))] * 2, strict=False))
                held = (_number(place / used) or 0) - int(statistics.get(cached, 0))
                yield allowed - max(0, held - psutil.Process().memory_info().rss)


def _number(file: Path) -> int | None:
    """The number in a file; None where there is none."""
    words = words_of(file)
    return int(words[0]) if words and words[0].isdecimal() else None


def _free_disk(folder: Path) -> int:
    """Free disk at the nearest parent that exists and may be looked at. [bytes]"""
    for place in (folder, *folder.parents):
        with suppress(OSError, ValueError):
            return shutil.disk_usage(place).free
    return 0


def human_seconds(seconds: float) -> str:
    """A duration in words, for instance ``4.2 s`` or ``2 h 05 min``."""
    if seconds < 90:
        return f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"

"""Resources of this machine, and durations in words."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from heliosweep.processors import processors

#: Control groups of Linux, and the one of this process.
_CGROUPS, _OWN_GROUP = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
#: Share of the free memory that a run may use. [1]
_SHARE = 0.8


@dataclass(frozen=True)
class Limits:
    """Limits of the machine and of the study's ``execution`` block: workers, memory and disk. [1, bytes, bytes]"""

    workers: int
    memory: int
    disk: int


def machine_limits(workers: int | None, memory: int | None, folder: str | os.PathLike[str]) -> Limits:
    """Return the limits of this machine or of the study.

    Parameters
    ----------
    workers : int, optional
        Number of workers (default: all processors that this process may use).
    memory : int, optional
        Memory (default: 80 % of the memory that is available now, also to the control groups of this process). [bytes]
    folder : path
        Result folder; the free disk space is measured at its nearest existing parent.
    """
    available = min([psutil.virtual_memory().available, *_group_memory()])
    disk = _free_disk(Path(folder).absolute())
    return Limits(workers or processors(), memory or int(_SHARE * max(0, available)), disk)


def _group_memory() -> Iterator[int]:
    """Memory that the control groups of this process leave, in versions 2 and 1. [bytes]"""
    try:
        lines = _OWN_GROUP.read_text(encoding="utf-8").splitlines()
    except OSError:
        return
    for _, controllers, group in (line.split(":", 2) for line in lines):
        if controllers and "memory" not in controllers.split(","):
            continue
        root = _CGROUPS / "memory" if controllers else _CGROUPS
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes") if controllers else ("memory.max", "memory.current")
        place = root / group.strip("/")
        for folder in (place, *place.parents):
            with suppress(OSError, ValueError):
                limit, used = (int((folder / name).read_text()) for name in names)
                statistics = (folder / "memory.stat").read_text().split()
                cached = dict(zip(statistics[::2], statistics[1::2], strict=True)).get("inactive_file", 0)
                yield limit - used + int(cached) + psutil.Process().memory_info().rss
            if folder == root:
                break


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

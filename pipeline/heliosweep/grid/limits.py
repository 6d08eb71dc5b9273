"""What this machine offers, and how sizes and durations are put in words."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

#: What the system says of this process, and where the limits of control groups (version 2) are; Linux only.
_PROC, _CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class Limits:
    """What this machine and the study's ``execution`` block allow."""

    workers: int
    memory: int
    disk: int


def machine_limits(workers: int | None, memory: int | None, folder: str | os.PathLike[str]) -> Limits:
    """What the machine offers, where the study asks for nothing else.

    Parameters
    ----------
    workers : int, optional
        Asked for by the user; otherwise the processors that this process may use, its control group considered.
    memory : int, optional
        Asked for by the user; otherwise 80 % of what is available now, or of the limit of its control group. [bytes]
    folder : path
        Where the result will be written; the nearest existing parent tells the free disk.

    Returns
    -------
    Limits
    """
    return Limits(
        workers or _processors(),
        memory or int(0.8 * _available_memory()),
        _free_disk(Path(folder).absolute()),
    )


def _processors() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    usable = len(affinity(0)) if affinity else os.cpu_count() or 1
    return min([usable, *(math.ceil(int(quota) / int(period)) for quota, period in _group_limits("cpu.max"))])


def _available_memory() -> int:
    """Memory that can be had without swapping; where the system does not tell, a careful 4 GB. [bytes]."""
    try:
        text = (_PROC / "meminfo").read_text(encoding="ascii")
        lines = dict(line.split(":", 1) for line in text.splitlines())
        available = int(lines["MemAvailable"].split()[0]) * 1024
    except (OSError, KeyError, ValueError):
        available = 4 * 2**30
    return min([available, *(int(limit) for (limit,) in _group_limits("memory.max"))])


def _group_limits(name: str) -> Iterator[list[str]]:
    """Words of the file `name` in this process's control group and in those around it that set a limit."""
    try:
        groups = (_PROC / "self/cgroup").read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        return
    for own in (line.removeprefix("0::/") for line in groups if line.startswith("0::/")):
        place = _CGROUPS / own
        while place.is_relative_to(_CGROUPS):
            with suppress(OSError):
                words = (place / name).read_text(encoding="ascii").split()
                if words[0] != "max":
                    yield words
            place = place.parent


def _free_disk(folder: Path) -> int:
    """Free disk at the nearest parent that exists and may be looked at. [bytes]."""
    for place in (folder, *folder.parents):
        with suppress(OSError, ValueError):
            return shutil.disk_usage(place).free
    return 0


def human_bytes(count: float) -> str:
    """`count` bytes in words, for instance ``1.4 GB``."""
    for unit in ("B", "kB", "MB", "GB", "TB", "PB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "B" or count >= 100 else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.3g} EB"


def human_seconds(seconds: float) -> str:
    """A duration in words, for instance ``4.2 s`` or ``2 h 05 min``."""
    if seconds < 90:
        return f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"

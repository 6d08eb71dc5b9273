"""What this machine offers, and how sizes and durations are put in words."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path


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
        Asked for by the user; otherwise the processors that this process may use.
    memory : int, optional
        Asked for by the user; otherwise 80 % of what is available now. [bytes]
    folder : path
        Where the result will be written; the nearest existing parent tells the free disk.

    Returns
    -------
    Limits
    """
    place = Path(folder).absolute()
    while not place.exists():
        place = place.parent
    return Limits(
        workers or _processors(),
        memory or int(0.8 * _available_memory()),
        shutil.disk_usage(place).free,
    )


def _processors() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _available_memory() -> int:
    """Memory that can be had without swapping; where the system does not tell, a careful 4 GB. [bytes]."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        lines = dict(line.split(":", 1) for line in text.splitlines())
        return int(lines["MemAvailable"].split()[0]) * 1024
    except (OSError, KeyError, ValueError):
        return 4 * 2**30


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

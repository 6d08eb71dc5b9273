"""What this machine offers, and how sizes and durations are put in words."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

try:
    import resource
except ImportError:  # no Unix
    resource = None  # type: ignore[assignment]

#: What the system says of this process, and where the limits of control groups are; Linux only.
_PROC, _CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")
#: Names of limit, use and cached files in control groups of version 1, and what stands there without a limit. [bytes]
_MEMORY_1, _NO_LIMIT = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_cache"), 2**60
#: Addresses and data that a process asks for and does not use: of the libraries, and of each thread. [bytes]
UNUSED_ADDRESSES, UNUSED_DATA, UNUSED_PER_WORKER = 1100 * 2**20, 200 * 2**20, 80 * 2**20


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
        Asked for by the user; otherwise 80 % of what is available now, or of what its control groups and the limits
        of the process (``ulimit -v``, ``-d``) leave. [bytes]
    folder : path
        Where the result will be written; the nearest existing parent tells the free disk.

    Returns
    -------
    Limits
    """
    workers = workers or _processors()
    return Limits(
        workers,
        memory or int(0.8 * _available_memory(workers)),
        _free_disk(Path(folder).absolute()),
    )


def _processors() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    usable = len(affinity(0)) if affinity else os.cpu_count() or 1
    quotas = [math.ceil(quota / period) for quota, period in _group_quotas() if quota > 0 and period > 0]
    return max(1, min([usable, *quotas]))


def _available_memory(workers: int) -> int:
    """Memory that can be had without swapping; where the system does not tell, a careful 4 GB. [bytes]."""
    try:
        text = (_PROC / "meminfo").read_text(encoding="ascii")
        lines = dict(line.split(":", 1) for line in text.splitlines())
        available = int(lines["MemAvailable"].split()[0]) * 1024
    except (OSError, KeyError, ValueError):
        available = 4 * 2**30
    return max(0, min([available, *_group_memory(), *_process_memory(workers)]))


def _process_memory(workers: int) -> Iterator[int]:
    """What the limits of this process (``ulimit -v`` and ``-d``) leave of memory. [bytes]."""
    if resource is None:
        return
    for kind, unused in (("RLIMIT_AS", UNUSED_ADDRESSES), ("RLIMIT_DATA", UNUSED_DATA)):
        limit, _ = resource.getrlimit(getattr(resource, kind))
        if limit != resource.RLIM_INFINITY:
            yield limit - unused - workers * UNUSED_PER_WORKER


def _group_memory() -> Iterator[int]:
    """What the limits of this process's control groups leave of memory. [bytes]."""
    for place in _group_folders("memory"):
        for limit, used, cached in (("memory.max", "memory.current", "file"), _MEMORY_1):
            allowed = _number(place / limit)
            if allowed is not None and allowed < _NO_LIMIT:
                # What other processes of the group hold; files in the cache give way.
                others = (_number(place / used) or 0) - _statistic(place / "memory.stat", cached) - _own_memory()
                yield allowed - max(0, others)


def _group_quotas() -> Iterator[tuple[int, int]]:
    """Processor time and the period it is for, of this process's control groups."""
    for place in _group_folders("cpu"):
        with suppress(OSError, ValueError):
            quota, period = (place / "cpu.max").read_text(encoding="ascii").split()
            if quota != "max":
                yield int(quota), int(period)
        quota_1, period_1 = (_number(place / f"cpu.cfs_{name}_us") for name in ("quota", "period"))
        if quota_1 is not None and period_1 is not None:
            yield quota_1, period_1


def _group_folders(controller: str) -> Iterator[Path]:
    """Folders of this process's control groups and of those around them, of both versions, innermost first."""
    try:
        groups = (_PROC / "self/cgroup").read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        return
    for line in groups:
        number, _, rest = line.partition(":")
        controllers, _, own = rest.partition(":")
        if number == "0" and not controllers:
            roots = [_CGROUPS, _CGROUPS / "unified"]
        elif controller in controllers.split(","):
            roots = [_CGROUPS / controllers, _CGROUPS / controller]
        else:
            continue
        for root in roots:
            # Within a container the name is that outside of it, and the group itself is the root.
            place = root / own.removeprefix("/")
            while place.is_relative_to(root):
                yield place
                place = place.parent


def _number(file: Path) -> int | None:
    try:
        return int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def _statistic(file: Path, name: str) -> int:
    """A number of a file of names and numbers; 0 where it is missing."""
    with suppress(OSError, ValueError):
        for line in file.read_text(encoding="ascii").splitlines():
            if line.startswith(f"{name} "):
                return int(line.split()[1])
    return 0


def _own_memory() -> int:
    """Memory that this process holds already. [bytes]."""
    with suppress(OSError, ValueError, IndexError):
        pages = int((_PROC / "self/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")
    return 0


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


def human_lengths(sizes: Mapping[str, int]) -> str:
    """Lengths of dimensions in words, for instance ``site 25, heliostat 317``."""
    return ", ".join(f"{dim} {length:,}" for dim, length in sizes.items())


def human_seconds(seconds: float) -> str:
    """A duration in words, for instance ``4.2 s`` or ``2 h 05 min``."""
    if seconds < 90:
        return f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"

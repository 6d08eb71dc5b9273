"""Processors that this process may use, and the control groups that limit it."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

#: What the system says of this process, and where the limits of control groups are; Linux only.
_PROC, _CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")


def processors() -> int:
    """Processors that this process may use, its control group considered."""
    affinity = getattr(os, "sched_getaffinity", None)
    usable = len(affinity(0)) if affinity else os.cpu_count() or 1
    quotas = []
    for place in group_folders("cpu"):
        older = (place / "cpu.cfs_quota_us", place / "cpu.cfs_period_us")
        words = words_of(place / "cpu.max") or [word for file in older for word in words_of(file)]
        if len(words) == 2 and words[0].isdecimal() and int(words[1]) > 0:  # none: "max" or -1
            quotas.append(math.ceil(int(words[0]) / int(words[1])))
    return max(1, min([usable, *quotas]))


def group_folders(controller: str) -> Iterator[Path]:
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


def words_of(file: Path) -> list[str]:
    """Words of a small file; none where it cannot be read."""
    try:
        return file.read_text(encoding="ascii").split()
    except (OSError, ValueError):
        return []

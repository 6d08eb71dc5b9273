"""Time zones by their IANA name, from the package `tzdata` alone.

`zoneinfo` looks for the files of the system first, which differ from one machine to the next and which nothing
records; the version of the package is part of what a result was computed with.
"""

from __future__ import annotations

import zoneinfo
from collections.abc import Callable
from functools import cache
from importlib import resources
from typing import Any


class Zone(zoneinfo.ZoneInfo):
    """A time zone of the package, which processes may send to each other: as its name."""

    def __reduce__(self) -> tuple[Callable[[str], Zone], tuple[Any]]:
        """Return what makes it again."""
        return zone, (self.key,)


@cache
def names() -> frozenset[str]:
    """Names of all zones, with the older names that some of them have."""
    return frozenset(resources.files("tzdata").joinpath("zones").read_text(encoding="utf-8").split())


@cache
def zone(name: str) -> Zone:
    """The zone of a name.

    Raises
    ------
    KeyError
        There is none.
    """
    if name not in names():  # a name is also part of a path
        raise KeyError(name)
    with resources.files("tzdata").joinpath("zoneinfo", *name.split("/")).open("rb") as file:
        return Zone.from_file(file, key=name)

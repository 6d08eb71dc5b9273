"""Time zones, and the one way from the clock on the wall to universal time.

Zones by their IANA name come from the package `tzdata` alone: `zoneinfo` looks for the files of the system first, which
differ from one machine to the next and which nothing records; the version of the package is part of what a result was
computed with.
"""

from __future__ import annotations

import datetime as dt
import math
import re
import zoneinfo
from collections.abc import Callable
from functools import cache
from importlib import resources
from typing import Any

#: A fixed offset from universal time, such as ``+08:00``.
OFFSET = re.compile(r"[+-]([0-9]{2}):([0-9]{2})")


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


def parse_timezone(timezone: str) -> dt.tzinfo:
    """Return the time zone that an offset such as ``+08:00`` or a name such as ``Asia/Shanghai`` stands for."""
    if match := OFFSET.fullmatch(timezone):
        offset = dt.timedelta(hours=int(match[1]), minutes=int(match[2]))
        return dt.timezone(-offset if timezone[0] == "-" else offset)
    return zone(timezone)


def to_utc(date: dt.date, seconds: float, zone: dt.tzinfo) -> tuple[dt.datetime, bool]:
    """Universal time of a time on the wall clock, and whether the clock shows that time at all.

    Of an hour that occurs twice, where the clock is set back, the first occurrence counts. For a time that is left out,
    where the clock is set forward, the instant of the change stands, and the second value is False.

    Parameters
    ----------
    date : datetime.date
        Date on the wall clock.
    seconds : float
        Since its midnight on the wall clock, at most 86,400; whole microseconds count.
    zone : datetime.tzinfo
        From `parse_timezone`.

    Returns
    -------
    utc : datetime.datetime
        With the time zone ``datetime.UTC``.
    is_shown : bool
        False for a time that is left out.
    """
    wall = dt.datetime.combine(date, dt.time()) + dt.timedelta(seconds=seconds)
    early, late = sorted(wall.replace(tzinfo=zone, fold=fold).astimezone(dt.UTC) for fold in (0, 1))
    if early.astimezone(zone).replace(tzinfo=None) == wall:
        return early, True
    before, after = math.floor(early.timestamp()), math.ceil(late.timestamp())
    while after - before > 1:  # time zones change at whole seconds
        middle = (before + after) // 2
        if dt.datetime.fromtimestamp(middle, zone).utcoffset() == early.astimezone(zone).utcoffset():
            before = middle
        else:
            after = middle
    return dt.datetime.fromtimestamp(after, dt.UTC), False

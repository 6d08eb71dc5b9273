"""Time zones, and the one way from the clock on the wall to universal time.

The package `tzdata` supplies all named zones, and the files of the system are not used: they differ between machines.
"""

from __future__ import annotations

import datetime as dt
import math
import re
import zoneinfo
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.config.faults import nearest

if TYPE_CHECKING:
    from numpy.typing import NDArray

zoneinfo.reset_tzpath(to=())

#: A fixed offset from universal time, such as ``+08:00``.
OFFSET = re.compile(r"[+-]([0-9]{2}):([0-9]{2})")
_LOOSE = re.compile(r"(?:UTC|GMT)? *([+\u2212-]?) *([0-9]{1,2})(?::?([0-5][0-9]))? *h?", re.IGNORECASE)
#: Zones whose abbreviations (``CEST``, ``PST``) messages explain.
_EXAMPLES = (
    *("Europe/Madrid", "Europe/London", "Europe/Athens", "America/New_York", "America/Chicago", "America/Denver"),
    *("America/Los_Angeles", "Africa/Johannesburg", "Asia/Jerusalem", "Asia/Kolkata", "Asia/Shanghai"),
    *("Australia/Perth", "Australia/Adelaide", "Australia/Brisbane", "Australia/Sydney"),
)


@cache
def names() -> frozenset[str]:
    """Return the names of all zones, including older ones."""
    return frozenset(zoneinfo.available_timezones())


def parse_timezone(timezone: str) -> dt.tzinfo:
    """Return the time zone of an offset such as ``+08:00`` or of a name such as ``Asia/Shanghai``."""
    if match := OFFSET.fullmatch(timezone):
        offset = dt.timedelta(hours=int(match[1]), minutes=int(match[2]))
        return dt.timezone(-offset if timezone[0] == "-" else offset)
    return zoneinfo.ZoneInfo(timezone)


def offset_text(hours: float) -> str:
    """Return an offset from universal time in hours as text: ``+05:30``."""
    minutes = round(abs(hours) * 60)
    return f"{'-' if hours < 0 else '+'}{minutes // 60:02}:{minutes % 60:02}"


def suggestion(text: str) -> str:
    """Return the offset and the zones that an unknown name can mean (``CEST``, ``UTC+2``, ``Berlin``), or no text."""
    if (found := _LOOSE.fullmatch(text.strip())) and int(found[2]) <= 14:
        hours = int(found[2]) + int(found[3] or 0) / 60
        return f"'{offset_text(hours if found[1] in ('', '+') else -hours)}'"
    seasons = [dt.datetime(2024, month, 1, tzinfo=parse_timezone(name)) for name in _EXAMPLES for month in (1, 7)]
    meant: dict[str, str] = {}
    for time in seasons:
        if time.tzname() == text.upper():
            hours = (time.utcoffset() or dt.timedelta()) / dt.timedelta(hours=1)
            meant.setdefault(offset_text(hours), f"'{offset_text(hours)}' or '{time.tzinfo}'")
    city = text.casefold().replace(" ", "_")
    cities = sorted(name for name in names() if city in (name.casefold(), name.casefold().rpartition("/")[2]))
    if "/" in text and not cities:  # a typo; short names are near to zones of other offsets
        cities = list(filter(None, [nearest(text, names())]))
    return " or ".join([*meant.values()] or [f"'{name}'" for name in cities])


def wall_to_utc(walls: NDArray[np.datetime64], zone: dt.tzinfo) -> NDArray[np.datetime64]:
    """Convert a series of times on the wall clock to universal time.

    Parameters
    ----------
    walls : ndarray of datetime64[s], shape (n,)
        Times on the wall clock, in the order of their file.
    zone : datetime.tzinfo
        From `parse_timezone`.

    Returns
    -------
    ndarray of datetime64[s], shape (n,)
        Universal time. If the clock is set back, the second row with the same wall time is the later instant. A time
        that the clock omits counts from the offset before the change.
    """
    if isinstance(zone, dt.timezone):
        return walls - np.timedelta64(zone.utcoffset(None), "s")
    times = walls.astype("datetime64[s]").tolist()
    first, second = (
        np.array([time.replace(tzinfo=zone, fold=fold).utcoffset() for time in times], "timedelta64[s]")
        for fold in (0, 1)
    )
    again = np.ones(walls.size, bool)
    again[np.unique(walls, return_index=True)[1]] = False
    return walls - np.where(again & (second < first), second, first)


def to_utc(date: dt.date, seconds: float, zone: dt.tzinfo) -> tuple[dt.datetime, bool]:
    """Convert a time on the wall clock to universal time, and return if the clock shows that time.

    An hour that occurs twice, when the clock is set back, is its first occurrence. A time that the clock omits, when
    the clock is set forward, becomes the instant of the change, and the second value is False.

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
        False for a time that the clock omits.
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

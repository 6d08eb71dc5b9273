"""Define the `time` block, and convert times between time zones.

The block specifies instants on the solar, civil or weather clock, or sun directions.

The package `tzdata` supplies all named time zones. Time zone files of the operating system are not used, because they
differ between machines.
"""

from __future__ import annotations

import datetime as dt
import math
import re
import zoneinfo
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from heliosweep.config.blocks import Block
from heliosweep.config.faults import Fault, Invalid, nearest, require, when
from heliosweep.config.values import (
    Choice,
    Parameter,
    Quantity,
    Samples,
    Sweep,
    Text,
    even_range,
    midpoints,
    object_schema,
    read_items,
    read_mapping,
)

zoneinfo.reset_tzpath(to=())
#: Pattern of a fixed offset from universal time, such as ``+08:00``.
OFFSET = re.compile(r"[+-]([0-9]{2}):([0-9]{2})")


@cache
def zone_names() -> frozenset[str]:
    """Return the names of all time zones, including obsolete names."""
    return frozenset(zoneinfo.available_timezones())


def parse_timezone(timezone: str) -> dt.tzinfo:
    """Return the time zone for an offset such as ``+08:00`` or a name such as ``Asia/Shanghai``."""
    fixed = dt.datetime.strptime(timezone, "%z").tzinfo if OFFSET.fullmatch(timezone) else None
    return fixed or zoneinfo.ZoneInfo(timezone)


def offset_text(hours: float) -> str:
    """Format an offset from universal time [h] as text such as ``+05:30``."""
    minutes = round(abs(hours) * 60)
    return f"{'-' if hours < 0 else '+'}{minutes // 60:02}:{minutes % 60:02}"


def suggestion(text: str) -> str:
    """Return offsets or time zones similar to an unknown name, such as ``UTC+2`` or ``Berlin``; empty if none."""
    loose = r"(?:UTC|GMT)? *([+\u2212-]?) *([0-9]{1,2})(?::?([0-5][0-9]))? *h?"
    if (found := re.fullmatch(loose, text.strip(), re.IGNORECASE)) and int(found[2]) <= 14:
        hours = int(found[2]) + int(found[3] or 0) / 60
        return f"'{offset_text(hours if found[1] in ('', '+') else -hours)}'"
    city = text.casefold().replace(" ", "_")
    cities = sorted(name for name in zone_names() if city in (name.casefold(), name.casefold().rpartition("/")[2]))
    if "/" in text and not cities:  # short names resemble zones with other offsets
        cities = list(filter(None, [nearest(text, zone_names())]))
    return " or ".join(f"'{name}'" for name in cities)


def wall_to_utc(walls: NDArray[np.datetime64], zone: dt.tzinfo) -> NDArray[np.datetime64]:
    """Convert a series of wall-clock times to universal time.

    Parameters
    ----------
    walls : ndarray of datetime64[s], shape (n,)
        Wall-clock times, in the order of the file.
    zone : datetime.tzinfo
        Time zone from `parse_timezone`.

    Returns
    -------
    ndarray of datetime64[s], shape (n,)
        Universal time. If a wall-clock time occurs twice because the clock is set back, the second row is the later
        instant. For a time that the clock skips, the offset before the change is used.
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
    """Convert a wall-clock time to universal time, and check that the time exists.

    If the clock is set back and the time occurs twice, the first occurrence is used. If the clock is set forward and
    skips the time, the result is the instant of the change.

    Parameters
    ----------
    date : datetime.date
        Local date.
    seconds : float
        Wall-clock time since midnight in seconds, at most 86,400, a multiple of 1 microsecond.
    zone : datetime.tzinfo
        Time zone from `parse_timezone`.

    Returns
    -------
    utc : datetime.datetime
        Universal time with the time zone ``datetime.UTC``.
    is_shown : bool
        False for a time that the clock skips.
    """
    wall = dt.datetime.combine(date, dt.time()) + dt.timedelta(seconds=seconds)
    early, late = sorted(wall.replace(tzinfo=zone, fold=fold).astimezone(dt.UTC) for fold in (0, 1))
    if early.astimezone(zone).replace(tzinfo=None) == wall:
        return early, True
    # offsets from universal time change at whole seconds
    seconds_between = range(math.floor(early.timestamp()) + 1, math.ceil(late.timestamp()))
    offset = early.astimezone(zone).utcoffset()
    change = bisect_left(
        seconds_between, True, key=lambda second: dt.datetime.fromtimestamp(second, zone).utcoffset() != offset
    )
    return dt.datetime.fromtimestamp(seconds_between.start + change, dt.UTC), False


Sampling = Annotated[
    str,
    Choice(
        "Instants that represent the steps of a range of hours or a window",
        {
            "inclusive": "the start of each step and the end of the last step",
            "left": "the start of each step",
            "midpoint": "the middle of each step",
        },
        sweep=False,
    ),
]
#: First and last year of allowed dates. The range is limited by nanosecond timestamps and by the accuracy of sun
#: positions.
FIRST_YEAR, LAST_YEAR = 1700, 2200
_DAYS = Quantity("Number of days between dates", "d", ge=1, integer=True, sweep=False)


class SolarTime(Block):
    """Days and hours on the solar clock, where the sun culminates at 12 h."""

    clock: Literal["solar"]
    declination: Annotated[
        Sweep | None, Samples("Declination of the sun, positive north, instead of days", "deg", ge=-90, le=90)
    ] = None
    days: Annotated[
        Sweep | None,
        Samples("Days of the year, 1 = 1 January (default: 1 to 365)", "1", ge=1, le=365, integer=True),
        Field(default_factory=lambda given: None if given.get("declination") else even_range(1.0, 365.0, 365)),
    ]
    hours: Annotated[Sweep, Samples("Solar hours on each day, 12 = noon", "h", ge=0, le=24)]
    sampling: Sampling = "inclusive"

    def rules(self) -> Iterable[Fault]:
        """Check that days and declinations are not combined, and that the sampling suits the range of hours."""
        steps, even = self.sampling != "inclusive", len(self.hours) > 1 and "num" in (self.hours.form or ())
        message = f"must be a range {{start, stop, step}} for the sampling '{self.sampling}'"
        return when(
            (self.declination is not None and self.days is not None,
             Fault("give 'days' or 'declination', not both", ("declination",), show_value=False)),
            (steps and not even, Fault(message, ("hours",), show_value=False)),
            (steps and even and not self.hours.reaches, _uneven(self.sampling, ("hours", "step"))),
        )  # fmt: skip

    def day_numbers(self) -> NDArray[np.int64]:
        """Return the days of the year, 1 to 365, shape (days,); empty if the study specifies declinations."""
        return np.empty(0, np.int64) if self.days is None else self.days.values().astype(np.int64)

    def declinations(self) -> NDArray[np.float64] | None:
        """Return the declinations [deg], shape (declinations,); None if the study specifies days."""
        return None if self.declination is None else self.declination.values()

    def solar_hours(self) -> NDArray[np.float64]:
        """Return the solar hours at which each day is sampled [h], shape (hours,)."""
        if self.sampling == "midpoint":
            return midpoints(self.hours).values()
        return self.hours[:-1] if self.sampling == "left" else self.hours.values()


@dataclass(frozen=True)
class DateList:
    """Ordered calendar dates."""

    items: tuple[dt.date, ...]

    @property
    def step(self) -> int:
        """Number of days between evenly spaced dates; 0 if the dates are not evenly spaced."""
        steps = {(after - before).days for before, after in pairwise(self.items)}
        return max(*steps, 0) if len(steps) == 1 else 0

    def spec(self) -> Any:
        """Return the dates as plain data for a study file; evenly spaced dates become a range."""
        ends = {"start": self.items[0], "stop": self.items[-1], "step": self.step}
        return ends if self.step else list(self.items)


@dataclass(frozen=True)
class Dates(Parameter):
    """Calendar dates: a single date, a list, or ``{start, stop, step}`` with the step in days."""

    def read(self, raw: Any) -> DateList:
        """Return the dates. Raises Invalid."""
        if not isinstance(raw, Mapping):
            return DateList(read_items(raw, _date) if isinstance(raw, list | tuple) else (_date(raw),))
        readers = {"start": _date, "stop": _date, "step": _DAYS.read}
        form = "a range of dates is {start, stop, step}"
        values = {"step": 1} | read_mapping(raw, readers, ("start", "stop"), form)
        first, last, step = values["start"].toordinal(), values["stop"].toordinal(), values["step"]
        require(first <= last, f"must not be before the start, {values['start']}", "stop")
        return DateList(tuple(dt.date.fromordinal(day) for day in range(first, last + 1, step)))

    def _one_schema(self) -> dict[str, Any]:
        date = {"type": "string", "format": "date"}
        span = object_schema("A range of dates", {"start": date, "stop": date}, {"step": _DAYS.json_schema()})
        return {"anyOf": [date, {"type": "array", "items": date, "minItems": 1}, span]}


def wall_time(raw: Any) -> str:
    """Return a time of day on the wall clock as ``HH:MM`` or ``HH:MM:SS``. Raises Invalid."""
    match = re.fullmatch(r"([0-9]{1,2}):([0-9]{2})(?::([0-9]{2}))?", raw) if isinstance(raw, str) else None
    if match is None:
        sunlit = "; 'sunrise' and 'sunset' are allowed only in dish_tracking" * (raw in ("sunrise", "sunset"))
        raise Invalid(f"must be a time of day such as '07:00'{sunlit}")
    hours, minutes, seconds = (int(part or 0) for part in match.groups())
    valid = minutes < 60 and seconds < 60 and (hours, minutes, seconds) <= (24, 0, 0)
    require(valid, "must be a time of day between '00:00' and '24:00'")
    return f"{hours:02}:{minutes:02}" + (f":{seconds:02}" if seconds else "")


@dataclass(frozen=True)
class WallTime(Text):
    """Time of day on the wall clock, ``HH:MM`` or ``HH:MM:SS``."""

    form: Callable[[Any], str] = field(default=wall_time, kw_only=True)


def time_zone(raw: Any) -> str:
    """Return a fixed offset from UTC such as ``+08:00``, or an IANA name such as ``Asia/Shanghai``. Raises Invalid."""
    hint = "must be an offset such as '+08:00' or a name such as 'Asia/Shanghai'"
    require(isinstance(raw, str), f"{hint}, in quotes")
    if raw[:1] in ("+", "-"):
        match = OFFSET.fullmatch(raw)
        require(match and int(match[1]) <= 14 and int(match[2]) <= 59, hint)
    elif raw not in zone_names():
        near = suggestion(raw)
        raise Invalid(f"unknown time zone; did you mean {near}?" if near else f"unknown time zone; it {hint}")
    return str(raw)


#: Parameter whose value is a time zone.
TimeZone = partial(Text, form=time_zone)


class Window(Block):
    """Daily time window on the wall clock."""

    start: Annotated[str, WallTime("Wall-clock time at which the window begins, HH:MM")]
    stop: Annotated[str, WallTime("Wall-clock time at which the window ends, HH:MM, at most 24:00")]
    step: Annotated[float, Quantity("Time between instants", "h", gt=0, le=24, sweep=False)]

    def rules(self) -> Iterable[Fault]:
        """Check that the window ends after its start and contains at least one step."""
        length = seconds_of(self.stop) - seconds_of(self.start)
        return when(
            (length <= 0, Fault(f"must be after the start, {self.start}", ("stop",))),
            (0 < length * (1 + 1e-9) < self.step * 3600, Fault("must not be longer than the window", ("step",))),
        )


class CivilTime(Block):
    """Dates and a daily time window in a given time zone."""

    clock: Literal["civil"]
    timezone: Annotated[
        str | None, TimeZone("Time zone of the dates and the window: an offset such as +08:00, or an IANA name")
    ] = None
    dates: Annotated[DateList, Dates("Calendar dates, YYYY-MM-DD; the step of a range is in days")]
    window: Annotated[Window, Field(description="Daily time window")]
    sampling: Sampling = "inclusive"

    def rules(self) -> Iterable[Fault]:
        """Check that the window contains a whole number of steps if each instant represents a step."""
        start, stop, step = self.window_seconds()
        steps = (stop - start) / step
        uneven = math.isinf(steps) or abs(steps - round(steps)) > 1e-9 * steps
        return when((self.sampling != "inclusive" and uneven, _uneven(self.sampling, ("window", "step"))))

    def date_list(self) -> list[dt.date]:
        """Return the dates as a list."""
        return list(self.dates.items)

    def window_seconds(self) -> tuple[float, float, float]:
        """Return the start and the end of the window (wall-clock seconds after midnight), and the step [s]."""
        return seconds_of(self.window.start), seconds_of(self.window.stop), self.window.step * 3600


Time = Annotated[SolarTime | CivilTime, Field(discriminator="clock", description="Instants of the study")]


class SunDirections(Block):
    """Sun directions instead of instants. If the directions are swept, each direction is a point of the result."""

    clock: Literal["sun"]
    azimuth: Annotated[
        float | Sweep,
        Quantity(
            "Azimuth of the sun, clockwise from north", "deg", ge=-360, le=360, repeats=True, dimension="sun_azimuth",
            title="azimuth of the sun, clockwise from north", standard_name="solar_azimuth_angle",
        ),
    ]  # fmt: skip
    elevation: Annotated[
        float | Sweep,
        Quantity(
            "Elevation of the sun above the horizon; the result is missing if the elevation is not positive", "deg",
            ge=-90, le=90, repeats=True, dimension="sun_elevation", title="elevation of the sun above the horizon",
            standard_name="solar_elevation_angle",
        ),
    ]  # fmt: skip


class WeatherTime(Block):
    """Intervals of a weather file, used as the instants of the study."""

    clock: Literal["weather"]
    months: Annotated[
        Sweep | None, Samples("Months of the year, 1 = January (default: all)", "1", ge=1, le=12, integer=True)
    ] = None


TimeOrDirections = Annotated[
    SolarTime | CivilTime | SunDirections | WeatherTime,
    Field(discriminator="clock", description="Instants or sun directions of the study"),
]


def seconds_of(wall_time: str) -> float:
    """Convert a wall-clock time, ``HH:MM`` or ``HH:MM:SS``, to seconds after midnight."""
    return float(sum(int(part) * unit for part, unit in zip(wall_time.split(":"), (3600, 60, 1), strict=False)))


def _uneven(sampling: str, path: tuple[str, ...]) -> Fault:
    return Fault(f"must divide the window into a whole number of steps for the sampling '{sampling}'", path)


def _date(raw: Any) -> dt.date:
    date = raw.date() if isinstance(raw, dt.datetime) else raw
    if isinstance(raw, str) and re.fullmatch("[0-9]{4}-[0-9]{2}-[0-9]{2}", raw):
        try:
            date = dt.date.fromisoformat(raw)
        except ValueError:
            raise Invalid("is not a calendar date") from None
    require(isinstance(date, dt.date), "must be a date in the form YYYY-MM-DD")
    midnight = not isinstance(raw, dt.datetime) or raw.time() == dt.time()
    require(midnight, "must be a date without a time of day")
    require(FIRST_YEAR <= date.year <= LAST_YEAR, f"must be in the years {FIRST_YEAR} to {LAST_YEAR}")
    return date

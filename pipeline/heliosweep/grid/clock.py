"""Instants of a study, on the solar or on the civil clock, as labelled arrays along ``time``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from heliosweep.config.times import CivilTime, SolarTime, SunDirections
from heliosweep.config.zones import parse_timezone, to_utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Attributes of a coordinate of calendar dates.
DATE = {
    "long_name": "date at the site",
    "comment": (
        "date of the calendar in the time zone of the site; its midnight stands for it, without that zone's offset, "
        "so that sites of several zones share the dates"
    ),
    "axis": "T",
}


class Label(NamedTuple):
    """Values along dimensions, as a coordinate of a data set is given."""

    dims: tuple[str, ...]
    values: np.ndarray
    attrs: dict[str, str]

    def part(self, dim: str, span: slice | int) -> Label:
        """Values of a part of a dimension; all where there is no such dimension."""
        if dim not in self.dims:
            return self
        values = self.values[(slice(None),) * self.dims.index(dim) + (span,)]
        kept = self.dims if isinstance(span, slice) else tuple(each for each in self.dims if each != dim)
        return Label(kept, values, self.attrs)


@dataclass(frozen=True)
class Instants:
    """The instants of a study, labelled along ``time``, on the clock ``solar``, ``civil`` or ``sun``.

    The labels are ``day`` or ``declination`` and ``solar_hour``, or ``utc`` (dimensions ``site`` and ``time`` where the
    sites' clocks differ), or the one ``instant`` of each direction of the sun.
    """

    labels: dict[str, Label]
    clock: str

    def coordinates(self) -> dict[str, Label]:
        """The labels as coordinates of a result; instants that all sites share are the coordinate ``time`` itself."""
        if self.clock == "sun":
            return {}
        if self.clock == "civil" and self.labels["utc"].dims == ("time",):
            utc = self.labels["utc"]
            clock = {"standard_name": "time", "units_metadata": "leap_seconds: none"}
            return {"time": utc._replace(attrs={**utc.attrs, **clock})}
        return self.labels

    def at_sites(self, part: slice | int) -> Instants:
        """The instants of some of the sites, or of one."""
        return Instants({name: label.part("site", part) for name, label in self.labels.items()}, self.clock)

    def part(self, span: slice) -> Instants:
        """Some of the instants."""
        return Instants({name: label.part("time", span) for name, label in self.labels.items()}, self.clock)

    def thinned(self, count: int) -> Instants:
        """Some `count` of the instants at the most, evenly picked."""
        step = max(1, -(-self.size // count))
        return self.part(slice(None, None, step))

    @property
    def size(self) -> int:
        """Number of instants."""
        return next(iter(self.labels.values())).values.shape[-1]


def instant_count(time: SolarTime | CivilTime | SunDirections) -> int:
    """Number of instants, without making them; on the civil clock not counting changes to daylight-saving time."""
    if isinstance(time, SunDirections):
        return 1
    if isinstance(time, SolarTime):
        return time.count()
    start, stop, step = time.window_seconds()
    return len(time.date_list()) * window_count((stop - start) / step, time.sampling)


def solar_instants(time: SolarTime) -> Instants:
    """Every hour of every day on the solar clock, day by day.

    Labelled with ``day`` [1] or ``declination`` [deg], and ``solar_hour`` [h], along ``time``: sampled as the study
    says.
    """
    hours = time.solar_hours()
    declinations = time.declinations()
    outer: NDArray[Any]
    if declinations is None:
        name, outer = "day", time.day_numbers()
        attrs = {"long_name": "day of the year", "units": "1"}
    else:
        name, outer = "declination", declinations
        attrs = {"long_name": "declination of the sun", "units": "degree"}
    return Instants(
        {
            name: Label(("time",), np.repeat(outer, hours.size), attrs),
            "solar_hour": Label(
                ("time",), np.tile(hours, outer.size), {"long_name": "solar time of day", "units": "h"}
            ),
        },
        "solar",
    )


def direction_instant() -> Instants:
    """The one instant at which the sun is looked at where a study gives its directions."""
    return Instants({"instant": Label(("time",), np.zeros(1), {})}, "sun")


def civil_instants(time: CivilTime, timezones: list[str]) -> Instants:
    """Every step of every date's window on the civil clock, in universal time, for the time zones of the sites.

    A window opens and closes on the wall clock and is cut in equal steps of elapsed time, so that the day of a
    daylight-saving change is an hour shorter or longer where the window holds the change. What opens or closes in an
    hour that is left out does so at the change; in one that occurs twice, at its first occurrence.

    ``utc`` is along ``time``, rising, each instant once, where all sites share them; along (``site``, ``time``)
    otherwise, where sites with fewer instants are padded with NaT.
    """
    rows = [np.unique(np.concatenate(daily_windows(time, zone))) for zone in timezones]
    attrs = {"long_name": "universal time"}
    if all(row.size == rows[0].size and bool(np.all(row == rows[0])) for row in rows):
        return Instants({"utc": Label(("time",), rows[0], attrs)}, "civil")
    table = np.full((len(rows), max(row.size for row in rows)), np.datetime64("NaT", "ns"))
    for index, row in enumerate(rows):
        table[index, : row.size] = row
    return Instants({"utc": Label(("site", "time"), table, attrs)}, "civil")


@lru_cache(maxsize=16)
def daily_windows(time: CivilTime, timezone: str) -> list[NDArray[np.datetime64]]:
    """Instants of the window of each date in a time zone, in universal time and in the order of the study."""
    zone = parse_timezone(timezone)
    start, stop, step = time.window_seconds()
    pieces = []
    for date in time.date_list():
        opens, closes = (to_utc(date, seconds, zone)[0].timestamp() for seconds in (start, stop))
        seconds = opens + step * window_positions((closes - opens) / step, time.sampling)
        pieces.append(np.round(seconds * 1e9).astype(np.int64).view("datetime64[ns]"))
    return pieces


def window_count(steps: float, sampling: str) -> int:
    """Number of instants of a window of so many steps, where rounding alone makes no step more or less."""
    if sampling == "left":
        return int(np.ceil(steps - 1e-9))
    return int(np.floor(steps + 1e-9)) + (sampling == "inclusive")


def window_positions(steps: float, sampling: str) -> NDArray[np.float64]:
    """Instants of a window of so many steps, in steps from its opening."""
    return np.arange(window_count(steps, sampling), dtype=np.float64) + (0.5 if sampling == "midpoint" else 0.0)

"""Instants of a study, on the solar or on the civil clock, as labelled arrays along ``time``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from heliosweep.config.times import CivilTime, SolarTime, SunDirections, WeatherTime
from heliosweep.config.zones import parse_timezone, to_utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.config.weather_files import WeatherFile

#: More instants than this are planned for, but not made, before the plan has agreed.
MAX_INSTANTS = 10**7
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
        """Return the values of a part of a dimension; all values if the label does not have the dimension."""
        if dim not in self.dims:
            return self
        values = self.values[(slice(None),) * self.dims.index(dim) + (span,)]
        kept = self.dims if isinstance(span, slice) else tuple(each for each in self.dims if each != dim)
        return Label(kept, values, self.attrs)


@dataclass(frozen=True)
class Instants:
    """The instants of a study, labelled along ``time``, on the clock ``solar``, ``civil``, ``weather`` or ``sun``.

    The labels are ``day`` or ``declination`` and ``solar_hour``, or ``utc`` (dimensions `dim` and ``time`` where the
    sites' clocks or the weather files differ), or the one ``instant`` of each direction of the sun. On the clock
    ``weather`` they are intervals: ``utc`` is the middle, ``hours`` the length of each.
    """

    labels: dict[str, Label]
    clock: str
    dim: str = "site"

    def coordinates(self) -> dict[str, Label]:
        """The labels as coordinates of a result; rising instants that all share are the coordinate ``time`` itself."""
        if self.clock == "sun":
            return {}
        labels = {name: label for name, label in self.labels.items() if name != "hours"}
        if "utc" in labels and labels["utc"].dims == ("time",):
            utc = labels["utc"]
            if np.all(np.diff(utc.values) > np.timedelta64(0)):
                clock = {"standard_name": "time", "units_metadata": "leap_seconds: none"}
                return {"time": utc._replace(attrs={**utc.attrs, **clock})}
        return labels

    def at_sites(self, part: slice | int) -> Instants:
        """The instants of some of the sites or weather files, or of one."""
        return replace(self, labels={name: label.part(self.dim, part) for name, label in self.labels.items()})

    def part(self, span: slice) -> Instants:
        """Some of the instants."""
        return replace(self, labels={name: label.part("time", span) for name, label in self.labels.items()})

    def thinned(self, count: int) -> Instants:
        """Some `count` of the instants at the most, evenly picked."""
        step = max(1, -(-self.size // count))
        return self.part(slice(None, None, step))

    @property
    def size(self) -> int:
        """Number of instants."""
        return next(iter(self.labels.values())).values.shape[-1]


def instant_count(time: SolarTime | CivilTime | SunDirections | WeatherTime) -> int:
    """Return the number of instants without creating them; changes to daylight-saving time do not count.

    Weather files count as hourly years: `sun.instants_of` reads their number of instants.
    """
    if isinstance(time, SunDirections):
        return 1
    if isinstance(time, WeatherTime):
        return 8760
    if isinstance(time, SolarTime):
        return time.count()
    start, stop, step = time.window_seconds()
    return len(time.date_list()) * window_count((stop - start) / step, time.sampling)


def solar_instants(time: SolarTime) -> Instants:
    """Return each hour of each day on the solar clock, day by day.

    The labels along ``time`` are ``day`` [1] or ``declination`` [deg], and ``solar_hour`` [h], sampled as in the study.
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
    """Return the single instant of a study with given sun directions."""
    return Instants({"instant": Label(("time",), np.zeros(1), {})}, "sun")


def weather_intervals(files: Sequence[WeatherFile], dim: str) -> Instants:
    """Return the intervals of weather files; several files are along the dimension `dim` of the result.

    ``utc``, the middle of each interval, and ``hours``, its length [h], are along ``time`` if all files share them,
    otherwise along (`dim`, ``time``), with NaT at the end of shorter files.
    """
    first = files[0]
    shared = all(file.hours == first.hours and np.array_equal(file.utc, first.utc) for file in files)
    rows = files[:1] if shared else files
    utc = np.full((len(rows), max(map(len, rows))), np.datetime64("NaT", "ns"))
    hours = np.zeros(utc.shape)
    for index, file in enumerate(rows):
        utc[index, : len(file)], hours[index, : len(file)] = file.utc, file.hours
    middle = {"long_name": "universal time", "comment": "middle of the interval of the weather file, of its own year"}
    length = {"long_name": "length of the interval", "units": "h"}
    dims, row = (("time",), 0) if shared else ((dim, "time"), slice(None))
    return Instants({"utc": Label(dims, utc[row], middle), "hours": Label(dims, hours[row], length)}, "weather", dim)


def civil_instants(time: CivilTime, timezones: list[str]) -> Instants:
    """Return each step of each date's window on the civil clock, in universal time, for the time zones of the sites.

    A window starts and stops at clock times and has equal steps of elapsed time, so that a window with a change of the
    clock is an hour shorter or longer. An end in the omitted hour is at the change; in a repeated hour, at its first
    occurrence.

    ``utc`` rises along ``time``, each instant once, if all sites share it; otherwise it is along (``site``, ``time``),
    with NaT at the end of sites with fewer instants.
    """
    rows = [np.unique(np.concatenate(daily_windows(time, zone))) for zone in timezones]
    attrs = {"long_name": "universal time"}
    if all(row.size == rows[0].size and bool(np.all(row == rows[0])) for row in rows):
        return Instants({"utc": Label(("time",), rows[0], attrs)}, "civil")
    table = np.full((len(rows), max(row.size for row in rows)), np.datetime64("NaT", "ns"))
    for index, row in enumerate(rows):
        table[index, : row.size] = row
    return Instants({"utc": Label(("site", "time"), table, attrs)}, "civil")


def civil_intervals(time: CivilTime, timezone: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the hours that each instant of `civil_instants` in a time zone represents, and the month of its date.

    They are one step, half a step at both ends of an inclusive window, and the sum for an instant of two windows.
    """
    pieces, step = daily_windows(time, timezone), time.window.step
    hours = [np.full(piece.size, step) for piece in pieces]
    if time.sampling == "inclusive":
        for each in hours:
            each[[0, -1]] -= step / 2
            each[-1] -= step / 2 if each.size == 1 else 0.0
    dates = np.repeat([date.month for date in time.date_list()], [piece.size for piece in pieces])
    _, first, where = np.unique(np.concatenate(pieces), return_index=True, return_inverse=True)
    return np.bincount(where, np.concatenate(hours)).astype(np.float64), dates[first]


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
    """Return the number of instants of a window of a number of steps, without effects of rounding."""
    if sampling == "left":
        return int(np.ceil(steps - 1e-9))
    return int(np.floor(steps + 1e-9)) + (sampling == "inclusive")


def window_positions(steps: float, sampling: str) -> NDArray[np.float64]:
    """Return the instants of a window of a number of steps, in steps from its start."""
    return np.arange(window_count(steps, sampling), dtype=np.float64) + (0.5 if sampling == "midpoint" else 0.0)

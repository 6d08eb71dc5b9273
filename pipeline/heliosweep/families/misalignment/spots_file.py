"""Measured spots as CSV: one spot a row, with its heliostat, its place on the receiver and its sun or its time."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.faults import did_you_mean, one_of
from heliosweep.config.tables import HEADER, MAX_LISTED, Column, Table, read_table
from heliosweep.config.times import FIRST_YEAR, LAST_YEAR, parse_timezone, wall_to_utc
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.files import read_once
from heliosweep.kernels.arrays import Floats

#: Largest file, and spots in it. [bytes, 1]
MAX_BYTES, MAX_SPOTS = 256 * 2**20, 2_000_000
#: Maximum deviation of the length of a sun vector from 1.
SUN_LENGTH = 1e-3

#: Suns, and commands, that differ by less are the same.
SAME = 1e-9
#: Farthest spot from the aim point, and largest angle. [m, deg]
FARTHEST, LARGEST = 1e6, 720.0

WHOLE = re.compile(r"\s*[0-9]{1,9}\s*")


def _time(text: str, local: bool = False) -> tuple[np.datetime64, bool]:
    """Universal time of a cell, or wall time without an offset if it may be `local`. Raises ValueError."""
    try:
        stamp = dt.datetime.fromisoformat(text)
    except ValueError:
        example = "2024-06-21T09:30:00+02:00"
        raise ValueError(f"must be a time as ISO 8601 has it, such as {example} (got {text[:40]!r})") from None
    if stamp.tzinfo is None and not local:
        remedy = "such as +02:00 or Z, at its end, or set 'calibration.timezone'"
        raise ValueError(f"needs an offset from UTC, {remedy} (got {text[:40]!r})")
    if not FIRST_YEAR <= stamp.year <= LAST_YEAR:
        raise ValueError(f"must be of the years {FIRST_YEAR} to {LAST_YEAR} (got {text[:40]!r})")
    is_wall = stamp.tzinfo is None
    return np.datetime64(stamp if is_wall else stamp.astimezone(dt.UTC).replace(tzinfo=None), "ns"), is_wall


def _place(meaning: str) -> Column:
    return Column(meaning, required=True, least=-FARTHEST, most=FARTHEST, bounds="between -1e6 and 1e6 m")


def _angle(meaning: str) -> Column:
    return Column(meaning, least=-LARGEST, most=LARGEST, bounds=f"between {-LARGEST:g} and {LARGEST:g} deg")


_NO_TIME = np.datetime64("NaT", "ns")
#: Columns of the file and their contents.
COLUMNS = {
    "heliostat": Column("number of the heliostat, from 0, or its name in the layout", required=True),
    "y": _place("spot on the receiver plane, to the right of the aim point for someone in the field, in m"),
    "z": _place("spot on the receiver plane, above the aim point, in m"),
    "time": Column(
        "ISO 8601 with offset, such as 2024-06-21T09:30:00+02:00", read=_time, dtype=object, missing=(_NO_TIME, False)
    ),
    "sun_x": Column("unit vector to the sun, east"),
    "sun_y": Column("unit vector to the sun, north"),
    "sun_z": Column("unit vector to the sun, up"),
    "weight": Column(
        "inverse variance, in any unit; 1 where left out", least=0.0, bounds="at least 0: it is an inverse variance"
    ),
    "azimuth": _angle("commanded angle of the primary axis, in deg; ideal where left out"),
    "elevation": _angle("commanded angle of the secondary axis, in deg; ideal where left out"),
    "target": Column("name of the target on whose plane the spots are", read=str, dtype=object, missing=""),
    "comment": Column("text that is not read"),
}
#: Traces of crossings, in the order of the kernel.
TRACES = ("elevation", "azimuth")


def _trace(text: str) -> int:
    """Number of the trace that a cell names. Raises ValueError."""
    if text not in TRACES:
        raise ValueError(f"must be {one_of(TRACES)}, the trace that crosses there (got {text[:40]!r})")
    return TRACES.index(text)


#: Additional columns of crossings of detectors.
CROSSING = {
    "trace": Column("elevation or azimuth", required=True, read=_trace, dtype=np.int64, missing=0),
    "y": _place("crossing on the receiver plane, to the right of the aim point for someone in the field, in m"),
    "z": _place("crossing on the receiver plane, above the aim point, in m"),
}
_SUN = ("sun_x", "sun_y", "sun_z")


@dataclass(frozen=True, eq=False)
class MeasuredSpots:
    """Spots in the order of their file.

    Parameters
    ----------
    heliostat : ndarray of int64, shape (S,)
        Number of the heliostat, from 0.
    position : ndarray, shape (S, 2)
        Spots y, z on the plane of the receiver. [m]
    sun : ndarray, shape (S, 3)
        Unit vectors to the sun: east, north, up; NaN for spots with a time. [1]
    utc : ndarray of datetime64[ns], shape (S,)
        Universal time; NaT for spots with a sun.
    weight : ndarray, shape (S,)
        Inverse variances in any unit. [1]
    angles : ndarray, shape (S, 2)
        Commanded encoder angles; NaN for an ideal mount. [rad]
    lines : ndarray of int64, shape (S,)
        Line of each spot in the file, counted from 1.
    name : str
        Name of the file, as the user gave it.
    trace : ndarray of int64, shape (S,), optional
        Number of the trace in `TRACES`, of crossings of detectors.
    targets : tuple of str
        Targets on whose planes the spots are, if the file names any.
    unused : tuple of str
        Titles of columns that are not read.
    """

    heliostat: NDArray[np.int64]
    position: Floats
    sun: Floats
    utc: NDArray[np.datetime64]
    weight: Floats
    angles: Floats
    lines: NDArray[np.int64]
    name: str = ""
    trace: NDArray[np.int64] | None = None
    targets: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of spots."""
        return self.heliostat.size

    @property
    def timed(self) -> bool:
        """True where the spots have times, from which the sun is still to be found."""
        return len(self) > 0 and bool(np.isnan(self.sun[0, 0]))

    @property
    def most(self) -> int:
        """Spots of the heliostat with most of them."""
        return int(np.bincount(self.heliostat).max(initial=1))

    def of(self, first: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows of the spots of some heliostats, one list after the other.

        Further results are the heliostat of each row, counted from the first, and its number in the list.
        """
        order = np.argsort(self.heliostat, kind="stable")
        of = self.heliostat[order] - first
        order, of = (array[(of >= 0) & (of < count)] for array in (order, of))
        return order, of, np.arange(of.size) - np.searchsorted(of, np.arange(count))[of]

    def lists(self, numbers: NDArray[np.int64], values: NDArray[Any], missing: Any = np.nan) -> NDArray[Any]:
        """Values of the spots of following heliostats, one list each, shape (H, `most`, ...)."""
        order, of, number = self.of(int(numbers[0]) if numbers.size else 0, numbers.size)
        table = np.full((numbers.size, self.most, *values.shape[1:]), missing, values.dtype)
        table[of, number] = values[order]
        return table

    def moved(self, count: int) -> NDArray[np.bool_]:
        """Heliostats whose spots with a weight are of more than one sun, or command, shape (count,)."""
        used = np.flatnonzero(self.weight > 0)
        of, seen = self.heliostat[used], np.nan_to_num(np.hstack([self.sun, self.angles])[used])
        first = np.zeros(count, np.int64)
        first[of[::-1]] = np.arange(of.size)[::-1]
        other = (np.abs(seen - seen[first[of]]) > SAME).any(axis=1)
        moved: NDArray[np.bool_] = np.bincount(of, other, count) > 0
        return moved

    def under(self, sun: Floats) -> MeasuredSpots:
        """Return the spots with the sun of their times, unit vectors of shape (S, 3).

        Raises StudyError for a spot with the sun at or below the horizon.
        """
        low = np.flatnonzero(~(sun[:, 2] > 0))
        if low.size:
            problems = [
                Problem(_below(sun[row]) + "; are the time, its offset and the site right?", "", self.name, line)
                for row, line in zip(low[:MAX_LISTED], self.lines[low].tolist(), strict=False)
            ]
            raise StudyError(listed(problems, MAX_LISTED, low.size))
        return replace(self, sun=np.array(sun, np.float64))


@read_once(4)
def spots_under_suns(
    path: Path,
    count: int,
    names: tuple[str, ...],
    place: tuple[float, float | None, float],
    crossings: bool = False,
    timezone: str = "",
) -> MeasuredSpots:
    """Read the spots of a file, see `read_spots`, with their suns at a site: latitude, longitude [deg], altitude [m].

    Spots with times need a longitude.
    """
    measured = read_spots(path, count, names, crossings=crossings, timezone=timezone)
    latitude, longitude, altitude = place
    if not measured.timed or longitude is None:
        return measured
    from heliosweep.sun import sun_vectors

    return measured.under(sun_vectors(measured.utc, latitude, longitude, altitude))


def read_spots(
    path: str | Path,
    heliostats: int,
    names: Sequence[str] = (),
    name: str | None = None,
    crossings: bool = False,
    timezone: str = "",
) -> MeasuredSpots:
    """Read measured spots, or crossings of detectors, from a CSV file.

    The first row names the columns, those of `COLUMNS`: ``heliostat``, ``y`` and ``z``; ``time`` or all of ``sun_x``,
    ``sun_y`` and ``sun_z``; ``weight``, ``azimuth`` with ``elevation``, and ``comment`` are optional. Empty lines
    and lines that start with ``#`` are skipped; other columns are not read. Text is UTF-8.

    Parameters
    ----------
    path : str or Path
        File to read.
    heliostats : int
        Number of heliostats.
    names : sequence of str, optional
        Names of the heliostats, if any.
    name : str, optional
        Name of the file in messages; `path` by default.
    crossings : bool
        True if rows are crossings with a column ``trace``.
    timezone : str
        Time zone of times without an offset: an offset or an IANA name; without it, all times need an offset.

    Returns
    -------
    MeasuredSpots

    Raises
    ------
    StudyError
        If the file cannot be read or is no such table; all bad rows at once, with file, line and column.
    """
    known = COLUMNS | (CROSSING if crossings else {}) | {"heliostat": _heliostats(heliostats, names)}
    if timezone:
        known["time"] = replace(COLUMNS["time"], read=partial(_time, local=True))
    table = read_table(
        Path(path),
        str(path) if name is None else name,
        known,
        others=True,
        rows="crossings" if crossings else "spots",
        most_bytes=MAX_BYTES,
        most_rows=MAX_SPOTS,
        needs="a header, such as heliostat,y,z,time, and one row for each",
        also=_check_header,
    )
    count = len(table)
    heliostat = table.column("heliostat")
    place = np.stack([table.column(key) for key in ("y", "z")], axis=1)
    sun = np.full((count, 3), np.nan)
    utc: NDArray[np.datetime64] = np.full(count, _NO_TIME)
    if "time" in table.header:
        utc = _universal(table.column("time"), timezone)
    else:
        sun = _unit_vectors(table)
    weight = table.column("weight") if "weight" in table.header else np.ones(count)
    angles = np.full((count, 2), np.nan)
    if "azimuth" in table.header:
        angles = np.stack([table.column(key) for key in ("azimuth", "elevation")], axis=1)
    trace = table.column("trace") if crossings else None
    targets = tuple(sorted(set(table.column("target")))) if "target" in table.header else ()
    table.finish()
    unused = tuple(key for key in table.header if key not in known)
    return MeasuredSpots(
        heliostat, place, sun, utc, weight, np.radians(angles), table.lines, table.name, trace, targets, unused
    )


def _universal(cells: NDArray[Any], timezone: str) -> NDArray[np.datetime64]:
    """Universal times of cells with times, of which some may be wall times of a time zone."""
    times = np.array([time for time, _ in cells], "datetime64[ns]")
    walls = np.array([is_wall for _, is_wall in cells], bool)
    if walls.any():
        times[walls] = wall_to_utc(times[walls], parse_timezone(timezone))
    return times


def _below(sun: Floats) -> str:
    elevation = np.degrees(np.arcsin(np.clip(sun[2], -1.0, 1.0)))
    return f"the sun is not above the horizon (elevation {elevation:.2f} deg)"


def _heliostats(count: int, names: Sequence[str]) -> Column:
    """The column of heliostats: a name counts before a number."""
    by_name = {text: number for number, text in reversed(list(enumerate(names)))}
    shared = {text for number, text in enumerate(names) if by_name[text] != number}

    def number(given: str) -> int:
        if given in shared:
            raise ValueError(f"{given!r} is the name of several heliostats; give its number, from 0")
        if given in by_name:
            return by_name[given]
        if WHOLE.fullmatch(given) and int(given) < count:
            return int(given)
        numbered = f"; they are numbered from 0 to {count - 1}" + ", or named as in the layout" * bool(by_name)
        raise ValueError(f"is unknown{did_you_mean(given, by_name) or numbered} (got {given[:40]!r})")

    return replace(COLUMNS["heliostat"], read=number, dtype=np.int64, missing=-1)


def _check_header(table: Table) -> None:
    """Check that the columns belong together."""
    header = table.header
    sun = [key for key in _SUN if key in header]
    if "time" in header and sun:
        table.add(f"has both time and {sun[0]}; remove one: they could contradict each other", HEADER)
    elif "time" not in header and len(sun) < 3:
        missing = ", ".join(key for key in _SUN if key not in header)
        which = f"the columns {missing} beside {', '.join(sun)}" if sun else "a column time, or sun_x, sun_y, sun_z"
        table.add(f"needs {which}: the sun that made the spot", HEADER)
    pair = [key for key in ("azimuth", "elevation") if key in header]
    if len(pair) == 1:
        other = "elevation" if pair == ["azimuth"] else "azimuth"
        table.add(f"needs a column {other} beside {pair[0]}, or neither: the angles commanded", HEADER)


def _unit_vectors(table: Table) -> Floats:
    """Return sun vectors of length 1, and note vectors of another length or below the horizon."""
    sun = np.stack([table.column(key) for key in _SUN], axis=1)
    length = np.sqrt(np.sum(sun**2, axis=1))
    for row in np.flatnonzero(np.abs(length - 1.0) > SUN_LENGTH).tolist():
        what = f"the sun vector has the length {length[row]:.6g}"
        table.add(f"{what}, which must be 1 to within {SUN_LENGTH:g}: divide it by its length", row, "sun_x")
    for row in np.flatnonzero((np.abs(length - 1.0) <= SUN_LENGTH) & (sun[:, 2] <= 0)).tolist():
        table.add(_below(sun[row]) + "; sun_z is positive up", row, "sun_z")
    with np.errstate(invalid="ignore", divide="ignore"):
        return sun / length[:, np.newaxis]

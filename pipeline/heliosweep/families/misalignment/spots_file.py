"""Read and check CSV files of measured spots or crossings, and convert positions along detector arrays."""

from __future__ import annotations

import datetime as dt
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import (
    FIRST_YEAR,
    HEADER,
    LAST_YEAR,
    MAX_LISTED,
    Column,
    Table,
    did_you_mean,
    ends,
    few_of,
    one_of,
    parse_timezone,
    read_table,
    wall_to_utc,
)
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.files import read_once
from heliosweep.kernels.compiled import Floats
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

#: Maximum size of a file [bytes], and maximum number of spots in a file.
MAX_BYTES, MAX_SPOTS = 256 * 2**20, 2_000_000
#: Maximum number of moving windows.
MAX_PERIODS = 1000
#: Maximum difference between 1 and the length of a sun vector.
SUN_LENGTH = 1e-3
#: Maximum magnitudes of a spot coordinate [m] and of a commanded angle [deg].
FARTHEST, LARGEST = 1e6, 720.0
#: Limits above which a table is rejected: distance of a spot from the aim point divided by the distance of its
#: heliostat from the aim point [1] (the limit is four times the value for a poor mount), and distance of a crossing
#: from the nearest detector array [m].
FARTHEST_SPOT, FARTHEST_CROSSING = 0.2, 0.1

WHOLE = re.compile(r"\s*[0-9]{1,9}\s*")


def _time(text: str, local: bool = False) -> tuple[np.datetime64, bool]:
    """Return the time in a cell, and True if the time is wall-clock time.

    A time with an offset is converted to universal time. A time without an offset is wall-clock time, which is allowed
    only if `local` is True. Raises ValueError.
    """
    try:
        stamp = dt.datetime.fromisoformat(text)
    except ValueError:
        words = "must be an ISO 8601 time, such as 2024-06-21T09:30:00+02:00"
        raise ValueError(f"{words} (got {text[:40]!r})") from None
    if stamp.tzinfo is None and not local:
        remedy = "such as +02:00 or Z: add the offset, or set 'calibration.timezone'"
        raise ValueError(f"needs an offset from UTC, {remedy} (got {text[:40]!r})")
    if not FIRST_YEAR <= stamp.year <= LAST_YEAR:
        raise ValueError(f"must be in the years {FIRST_YEAR} to {LAST_YEAR} (got {text[:40]!r})")
    universal = stamp if stamp.tzinfo is None else stamp.astimezone(dt.UTC).replace(tzinfo=None)
    return np.datetime64(universal, "ns"), stamp.tzinfo is None


_place = partial(Column, required=True, least=-FARTHEST, most=FARTHEST, bounds="between -1e6 and 1e6 m")
_angle = partial(Column, least=-LARGEST, most=LARGEST, bounds=f"between {-LARGEST:g} and {LARGEST:g} deg")
_NO_TIME = np.datetime64("NaT", "ns")
#: Declarations of the columns in a spot file.
COLUMNS = {
    "heliostat": Column("number of the heliostat, counted from 0, or its name in the layout", required=True),
    "y": _place("spot on the receiver plane, to the right of the aim point for an observer in the field, in m"),
    "z": _place("spot on the receiver plane, above the aim point, in m"),
    "time": Column(
        "ISO 8601 with offset, such as 2024-06-21T09:30:00+02:00", read=_time, dtype=object, missing=(_NO_TIME, False)
    ),
    "sun_x": Column("east component of the unit vector to the sun"),
    "sun_y": Column("north component of the unit vector to the sun"),
    "sun_z": Column("upward component of the unit vector to the sun"),
    "weight": Column(
        "inverse variance, in any unit (default: 1)", least=0.0, bounds="at least 0, because it is an inverse variance"
    ),
    "azimuth": _angle("commanded angle of the primary axis, in deg (default: the ideal angle)"),
    "elevation": _angle("commanded angle of the secondary axis, in deg (default: the ideal angle)"),
    "target": Column("name of the target whose plane contains the spots", read=str, dtype=object, missing=""),
    "spot": Column("name of the spot, for calibration.held_out"),
    "comment": Column("text, which is ignored"),
}
#: Numerical columns that `calibration.columns` can scale.
SCALED = ("y", "z", "weight", "azimuth", "elevation")
#: Names of the traces of a heliostat, in the order of their codes in the kernel.
TRACES = ("elevation", "azimuth")


def _trace(text: str) -> int:
    if text not in TRACES:
        raise ValueError(f"must be {one_of(TRACES)}, the trace of this crossing (got {text[:40]!r})")
    return TRACES.index(text)


#: Columns of a table of detector crossings that differ from the columns of a spot table.
CROSSING = {
    "trace": Column("elevation or azimuth", required=True, read=_trace, dtype=np.int64, missing=0),
    "y": _place("crossing on the receiver plane, to the right of the aim point for an observer in the field, in m"),
    "z": _place("crossing on the receiver plane, above the aim point, in m"),
}
_SUN = ("sun_x", "sun_y", "sun_z")


@dataclass(frozen=True, eq=False)
class MeasuredSpots:
    """Measured spots or detector crossings, in the order of the file.

    Parameters
    ----------
    heliostat : ndarray of int64, shape (S,)
        Heliostat numbers, counted from 0.
    position : ndarray, shape (S, 2)
        Coordinates y, z of the spots on the receiver plane. [m]
    sun : ndarray, shape (S, 3)
        Unit vectors to the sun: east, north, up; NaN for spots with a time. [1]
    utc : ndarray of datetime64[ns], shape (S,)
        Universal time; NaT for spots with a sun vector.
    weight : ndarray, shape (S,)
        Inverse variances in any unit. [1]
    angles : ndarray, shape (S, 2)
        Commanded encoder angles; NaN if the mount received the commands of an ideal mount. [rad]
    lines : ndarray of int64, shape (S,)
        Line number of each spot in the file, counted from 1.
    name : str
        Name of the file as given by the user.
    trace : ndarray of int64, shape (S,), optional
        Index of each crossing's trace in `TRACES`; None for spots.
    targets : tuple of str
        Names of the targets whose planes contain the spots, if the file has a target column.
    unused : tuple of str
        Titles of ignored columns.
    spot : tuple of str
        Name of each spot; empty if the spots have no names.
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
    spot: tuple[str, ...] = ()

    @property
    def timed(self) -> bool:
        """True if sun vectors must be computed from the times of the spots."""
        return bool(np.isnan(self.sun).any())

    @property
    def most(self) -> int:
        """Maximum number of spots per heliostat."""
        return int(np.bincount(self.heliostat).max(initial=1))

    def lists(self, numbers: NDArray[np.int64], values: NDArray[Any], missing: Any = np.nan) -> NDArray[Any]:
        """Return the values of each heliostat's spots in the order of the file, shape (H, `most`, ...).

        `missing` fills the entries after the last spot of a heliostat.
        """
        order = np.argsort(self.heliostat, kind="stable")
        of = self.heliostat[order]
        size = 1 + max(self.heliostat.max(initial=0), numbers.max(initial=0))
        table = np.full((size, self.most, *values.shape[1:]), missing, values.dtype)
        table[of, np.arange(of.size) - np.searchsorted(of, of)] = values[order]
        return table[numbers]

    def held_out(self, given: int | tuple[str, ...] | None) -> NDArray[np.bool_]:
        """Return a mask of the held-out spots, shape (S,).

        `given` contains the names of the held-out spots, or is the number of held-out spots per heliostat. A number
        selects the latest spots, or the last spots in the file if the spots have no times.
        """
        if not isinstance(given, int):
            return np.isin(self.spot, given) if given and self.spot else np.zeros(len(self.lines), bool)
        order = np.lexsort((np.arange(len(self.lines)), self.utc, self.heliostat))
        of, last = self.heliostat[order], np.empty(len(self.lines), np.int64)
        last[order] = np.searchsorted(of, of, "right") - np.arange(of.size)
        return last <= given


@read_once(4)
def read_spots(
    path: Path,
    heliostats: int,
    names: tuple[str, ...] = (),
    place: tuple[float, float | None, float] | None = None,
    crossings: bool = False,
    timezone: str = "",
    columns: tuple[tuple[str, str, float, float], ...] = (),
) -> MeasuredSpots:
    """Read measured spots or detector crossings from a CSV file, and compute sun vectors.

    The first row contains column titles from `COLUMNS`. The columns ``heliostat``, ``y`` and ``z`` are required,
    together with either ``time`` or all of ``sun_x``, ``sun_y`` and ``sun_z``. The other columns of `COLUMNS` are
    optional, but ``azimuth`` and ``elevation`` must occur together. Empty lines, lines that start with ``#``, and
    unknown columns are ignored. The encoding is UTF-8.

    Parameters
    ----------
    path : Path
        File to read.
    heliostats : int
        Number of heliostats.
    names : tuple of str, optional
        Names of the heliostats.
    place : tuple, optional
        Latitude [deg], longitude [deg] and altitude [m] of the site. If the place or the longitude is missing, sun
        vectors are not computed from times.
    crossings : bool
        True if the rows are crossings. The ``trace`` column is then required.
    timezone : str
        Time zone of times without an offset, given as an offset or an IANA name. If omitted, all times need an offset.
    columns : tuple of tuples
        Key, title in the file, scale and offset of each renamed or scaled column.

    Returns
    -------
    MeasuredSpots

    Raises
    ------
    StudyError
        If the file cannot be read or is not a valid table. The message lists the file, line and column of each invalid
        cell.
    """
    known = COLUMNS | (CROSSING if crossings else {}) | {"heliostat": _heliostats(heliostats, names)}
    if timezone:
        known["time"] = replace(COLUMNS["time"], read=partial(_time, local=True))
    for key, title, scale, offset in columns:
        meaning = f"{title!r} in 'calibration.columns'"
        known[key] = replace(known[key], meaning=meaning, required=True, scale=scale, offset=offset)
    table = read_table(
        path,
        str(path),
        known,
        others=True,
        rows="crossings" if crossings else "spots",
        most_bytes=MAX_BYTES,
        most_rows=MAX_SPOTS,
        needs="a header, such as heliostat,y,z,time, and one row for each measurement",
        also=_check_header,
        titles={key: title for key, title, *_ in columns},
    )

    utc = np.full(len(table), _NO_TIME)
    if "time" in table.header:
        times, local = table.column("time").reshape(-1, 2).T
        utc, local = times.astype("datetime64[ns]"), local.astype(bool)
        if local.any():
            utc[local] = wall_to_utc(utc[local], parse_timezone(timezone))

    def values(*keys: str, missing: Any = np.nan) -> NDArray[Any]:
        """Return columns as one array. Columns missing from the table are filled with `missing`."""
        given = [table.column(key) if key in table.header else np.full(len(table), missing) for key in keys]
        return np.stack(given, axis=-1)

    spots = MeasuredSpots(
        values("heliostat")[:, 0],
        values("y", "z"),
        _unit_vectors(table, values(*_SUN)),
        utc,
        values("weight", missing=1.0)[:, 0],
        np.radians(values("azimuth", "elevation")),
        table.lines,
        table.name,
        values("trace")[:, 0] if crossings else None,
        tuple(sorted({*values("target", missing="")[:, 0].tolist()} - {""})),
        tuple(table.unused()),
        tuple(table.texts("spot")) if "spot" in table.header else (),
    )
    table.finish()
    if place is None or place[1] is None or not spots.timed:
        return spots
    from heliosweep.sun import sun_vectors

    sun = sun_vectors(spots.utc, *place)  # type: ignore[arg-type]  # the longitude is known
    for row in np.flatnonzero(~(sun[:, 2] > 0)).tolist():
        table.add(f"{_below(sun[row])}; check the time, its offset and the site", row)
    table.finish()
    return replace(spots, sun=sun)


def _below(sun: Floats) -> str:
    return f"the sun is not above the horizon (elevation {np.degrees(np.arcsin(np.clip(sun[2], -1, 1))):.2f} deg)"


def _heliostats(count: int, names: Sequence[str]) -> Column:
    """Return the declaration of the heliostat column. Cells are compared with names first, then with numbers."""
    rows, numbers = {name: row for row, name in enumerate(names)}, Counter(names)

    def number(given: str) -> int:
        if numbers[given] > 1:
            raise ValueError(
                f"{given!r} is the name of several heliostats: give the number of the heliostat, counted from 0"
            )
        row = rows.get(given, int(given) if WHOLE.fullmatch(given) else count)
        if row >= count:
            hint = f"; heliostats are numbered from 0 to {count - 1}" + ", or named as in the layout" * bool(rows)
            raise ValueError(f"is unknown{did_you_mean(given, rows) or hint} (got {given[:40]!r})")
        return row

    return replace(COLUMNS["heliostat"], read=number, dtype=np.int64, missing=-1)


def _check_header(table: Table) -> None:
    sun = [key for key in _SUN if key in table.header]
    missing = ", ".join(key for key in _SUN if key not in sun)
    words = f"the columns {missing} in addition to {', '.join(sun)}" if sun else "a column time, or sun_x, sun_y, sun_z"
    if "time" in table.header and sun:
        table.add(f"has both time and {sun[0]}: remove one of them, because they may contradict each other", HEADER)
    elif "time" not in table.header and missing:
        table.add(f"needs {words}, to define the direction of the sun", HEADER)
    for key, other in (("azimuth", "elevation"), ("elevation", "azimuth")):
        if key in table.header and other not in table.header:
            table.add(f"needs a column {other} in addition to {key}, or neither of these commanded angles", HEADER)


def _unit_vectors(table: Table, sun: Floats) -> Floats:
    """Normalise the sun vectors. Record a problem if the length is wrong or the sun is below the horizon."""
    length = np.sqrt(np.sum(sun**2, axis=1))
    odd = np.abs(length - 1.0) > SUN_LENGTH
    for row in np.flatnonzero(odd | (sun[:, 2] <= 0)).tolist():
        size = f"the length of the sun vector is {length[row]:.6g}, but must be 1 to within {SUN_LENGTH:g}"
        words = f"{size}: divide it by its length" if odd[row] else f"{_below(sun[row])}; sun_z is positive upwards"
        table.add(words, row, "sun_x" if odd[row] else "sun_z")
    with np.errstate(invalid="ignore", divide="ignore"):
        return sun / length[:, np.newaxis]


class Segments(NamedTuple):
    """S line segments of A detector arrays, in the order of the arrays.

    Positions along an array are measured from its first point. Positions along an infinite line are measured from the
    foot of the perpendicular from the aim point. [m]
    """

    #: Number of the array that contains each segment, shape (S,). Infinite lines come before the arrays.
    array: NDArray[np.int64]
    #: Reference point y, z of each segment, shape (S, 2): first point, or foot of the perpendicular for a line. [m]
    start: Floats
    #: Unit vector along each segment, shape (S, 2). [1]
    along: Floats
    #: Position of the reference point along the array, shape (S,). [m]
    origin: Floats
    #: Start and end of each segment relative to its reference point, shape (S, 2); infinite for lines. [m]
    ends: Floats
    #: Index of the first segment of each array, shape (A,).
    starts: NDArray[np.int64]
    #: Maximum number of crossings between a trace and an array: two per segment.
    most: int

    def by_array(self, places: Floats, angles: Floats) -> tuple[Floats, Floats]:
        """Convert positions on segments, shape (..., S, 2), to ascending positions along arrays, shape (..., A, C).

        The angles are returned in the order of the sorted positions.
        """
        lead, within = places.shape[:-2], np.arange(self.array.size) - self.starts[self.array]
        found = np.full((2, *lead, self.starts.size, self.most // 2, 2), np.nan)
        found[..., self.array, within, :] = places + self.origin[:, np.newaxis], angles
        found = found.reshape(2, *lead, self.starts.size, self.most)
        for _ in range(2):
            found = np.take_along_axis(found, np.argsort(found[:1], axis=-1), -1)
            # Two crossings at the common corner of two segments count as one.
            found[0, ..., 1:][np.diff(found[0], axis=-1) < 1e-9] = np.nan
        return found[0], np.where(np.isnan(found[0]), np.nan, found[1])

    def readings(self, places: Floats, noise: Floats | float, pitch: float) -> Floats:
        """Return the array readings for crossings at `places` with added noise, shape (..., A, C). [m]

        If the pitch is not zero, a reading is the position of the nearest detector.
        """
        read, longest = places + noise, np.maximum.reduceat(self.origin + self.ends[:, 1], self.starts)
        if pitch > 0:
            read = np.round(read / pitch) * pitch
            longest = np.where(np.isfinite(longest), np.floor(longest / pitch * (1 + 1e-12)) * pitch, longest)
        return np.clip(read, self.ends[self.starts, :1], longest[:, np.newaxis])

    def points(self, places: Floats) -> tuple[Floats, Floats]:
        """Convert positions along arrays to points (y, z) and array directions, shape (..., A, C, 2)."""
        own = self.array == np.arange(self.starts.size)[:, np.newaxis, np.newaxis]  # (A, 1, S)
        passed = np.count_nonzero(own & (self.origin + self.ends[:, 0] <= places[..., np.newaxis]), axis=-1)
        which = self.starts[:, np.newaxis] + np.maximum(passed - 1, 0)
        along = self.along[which]
        return self.start[which] + (places - self.origin[which])[..., np.newaxis] * along, along

    def nearest(self, points: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Return the distance of each point from its nearest segment [m], and the segment's index.

        `points` has the shape (M, 2).
        """
        way = points[:, np.newaxis] - self.start
        place = np.clip(np.sum(way * self.along, axis=-1), *self.ends.T)
        distance = np.linalg.norm(way - place[..., np.newaxis] * self.along, axis=-1)
        return distance.min(axis=1), distance.argmin(axis=1)


def segments_of(block: Any) -> Segments:
    """Return the segments of all detector lines and arrays in a `detectors` block."""
    rows: list[tuple[int, Floats, Floats, float, tuple[float, float]]] = []
    for l0, l1, l2 in block.lines or ():
        across = np.array([l0, l1]) / np.hypot(l0, l1)
        along = np.array([-across[1], across[0]])
        along = along if (along[0], along[1]) > (0.0, 0.0) else -along
        rows.append((len(rows), across * l2 / np.hypot(l0, l1), along, 0.0, (-np.inf, np.inf)))
    for number, array in enumerate(block.arrays or (), len(rows)):
        place, points = 0.0, np.array(array.points, np.float64)
        for start, stop in pairwise(points):
            length = float(np.hypot(*(stop - start)))
            rows.append((number, start, (stop - start) / length, place, (0.0, length)))
            place += length
    numbers, *columns = zip(*rows, strict=True)
    starts, most = np.unique(numbers, return_index=True)[1], 2 * int(np.bincount(numbers).max())
    return Segments._make([np.array(numbers), *(np.array(column, np.float64) for column in columns), starts, most])


def examine_table(study: MisalignmentStudy) -> Iterator[Problem | str]:
    """Yield problems and warnings about measured spots or crossings, and about conflicting study keys."""
    if (table := study.table_of_spots()) is None:
        return
    key, what = table[0], "crossings" if table[0] == "detectors.crossings" else "spots"
    for other in ("days_used", "noise") if key == "calibration.spots" else ():
        if getattr(study.calibration, other) not in (None, 0.0):
            yield study.problem(f"calibration.{other}", "is only used for synthetic spots: remove it, or 'spots'")
    if study.mount_errors is not None and key != "measured":
        yield study.problem("mount_errors", f"gives the true errors of synthetic {what}: remove it, or '{key}'")
    if study.sites is not None or any(each.startswith(("site.", "layout.")) for each in study.sweeps()):
        yield study.problem(key, "belong to one site and one layout: do not sweep sites or layouts")
        return
    try:
        campaigns = study.campaigns()
    except StudyError as error:
        yield from (replace(problem, key=problem.key or key) for problem in error.problems)
    else:
        yield from _spare_rows(study, list(campaigns.values()))
        for measured in campaigns.values():
            yield from _examine_rows(study, measured, key, what)


def _examine_rows(study: MisalignmentStudy, measured: MeasuredSpots, key: str, what: str) -> Iterator[Problem | str]:
    if measured.unused:
        yield f"{measured.name}: ignored columns: {few_of(measured.unused)}"
    layout = None if study.layout is None else Layouts(study)[()]
    aimed = set(measured.targets if layout is None else layout.columns.get("target", measured.targets))
    if layout is not None and measured.targets and aimed != set(measured.targets):
        spots, field = ", ".join(measured.targets), ", ".join(map(str, aimed))
        message = f"are on the target {spots}, but {layout.name} is measured from the target {field}"
        yield study.problem(key, f"{message}: convert both files with the same --aim")
        return
    if key == "measured":
        return
    if measured.trace is None:
        pivots = np.array(study.heliostats.positions or (), float).reshape(-1, 3).T
        x, y = pivots[:2] if layout is None else (layout.x, layout.y)
        away = np.hypot(np.hypot(x, y), max(ends(study.receiver.height)))[measured.heliostat]
        distance = np.hypot(*measured.position.T)
        # A mount with commanded angles may have aimed at another point.
        far = (distance > FARTHEST_SPOT * away) & np.isnan(measured.angles).any(axis=1)
        words = "the spot is {:.4g} m and its heliostat {:.4g} m from the aim point: check that the spot is in metres"
    else:
        away = distance = segments_of(study.detectors).nearest(measured.position)[0]
        far = distance > FARTHEST_CROSSING
        words = "the crossing is {:.4g} m from the nearest detector array: check that both are in metres"
    rows = np.flatnonzero(far)
    found = (
        Problem(words.format(distance[row], away[row]), "", measured.name, int(measured.lines[row]))
        for row in rows[:MAX_LISTED]
    )
    yield from listed(found, MAX_LISTED, rows.size) if rows.size else ()
    yield from _few_rows(study, measured, key, what)


def _few_rows(study: MisalignmentStudy, measured: MeasuredSpots, key: str, what: str) -> Iterator[Problem | str]:
    """Yield a problem if there are too few measurements, and a warning if names look like row numbers."""
    block: Any = study.calibration if measured.trace is None else study.detectors
    usable, held = measured.weight > 0, getattr(block, "held_out", None)
    every = np.bincount(measured.heliostat, usable).max(initial=0)
    most = np.bincount(measured.heliostat, usable & ~measured.held_out(held)).max(initial=0)
    errors, each = int(max(ends(block.parameters or 4))), 2 if measured.trace is None else 1
    if every == 0:
        yield study.problem(key, f"no {what[:-1]} has a weight above 0, so no errors can be estimated")
    elif each * most < errors:
        needed = f"{errors} errors need {errors // each} {what} per heliostat"
        if each * every < errors:
            yield study.problem(key.replace(what, "parameters"), f"{needed}, and {measured.name} has at most {every:g}")
        else:
            message = f"leaves at most {most:g} of {every:g} {what} per heliostat in {measured.name}: {needed}"
            yield study.problem("calibration.held_out", message)
    names = study.heliostat_names()[1]
    if other := [row for row, name in enumerate(names) if WHOLE.fullmatch(name) and int(name) != row]:
        yield (
            f"{len(other):,} heliostat names are integers that differ from their row numbers, such as "
            f"{names[other[0]]!r} in row {other[0]}: heliostats in the spot file are read as names"
        )


def _spare_rows(study: MisalignmentStudy, campaigns: Sequence[MeasuredSpots]) -> Iterator[Problem | str]:
    block, files = study.calibration, " and ".join(measured.name for measured in campaigns)
    if block is None:
        return
    named = {name for measured in campaigns for name in measured.spot}
    if isinstance(block.held_out, tuple) and (unknown := sorted({*block.held_out} - named)):
        yield study.problem("calibration.held_out", f"no spot {few_of(unknown)} in the column 'spot' of {files}")
    if block.window is not None:
        times = np.concatenate([measured.utc for measured in campaigns])
        if np.isnat(times).any():
            yield study.problem("calibration.window", f"needs times: {files} has sun vectors")
            return
        days, step = (times.max() - times.min()) / np.timedelta64(1, "D"), block.window_step or block.window
        if (days - block.window) / step > MAX_PERIODS:
            key = "window" if block.window_step is None else "window_step"
            message = f"gives {(days - block.window) / step:,.0f} periods; at most {MAX_PERIODS:,} are possible"
            yield study.problem(f"calibration.{key}", message)
        elif days < block.window:
            yield (
                f"calibration.window: a window of {block.window:g} days contains all spots, which cover {days:.3g} "
                "days: a single period shows no drift"
            )

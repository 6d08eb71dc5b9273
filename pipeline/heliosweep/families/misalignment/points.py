"""Instants, heliostats, mounts and drawn errors at the points of a study, for all modes."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import CivilTime, parse_timezone, to_utc
from heliosweep.families.family import Computation
from heliosweep.families.misalignment.study import MisalignmentStudy
from heliosweep.families.mount_errors import standard_deviates, standard_normals, widths_of
from heliosweep.families.points import Point
from heliosweep.grid import DATE, PLACE, Instants, Parameters, Variable, flags, sun_at, window_positions
from heliosweep.kernels.calibration import Mounts
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.mounts import ERRORS, Setting
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import LayoutAxis
from heliosweep.lazy import xr
from heliosweep.mounts import KINDS, mounts_of

#: Status of padding entries after the last heliostat of a layout that is shorter than the longest layout.
NO_HELIOSTAT = -1
#: Directions of the axes in the receiver's plane.
SIDES = {"y": "to the right of the aim point", "z": "above the aim point"}
#: Random streams for the noise of synthetic spots along y and z. Mount error i of `ERRORS` uses stream i.
NOISE_STREAMS = (100, 101)
#: Maximum number of noise values in one draw, limited by the counter of the random number generator.
MOST_NUMBERS = 2**24
#: Keys with a single value in each group of points computed in one call.
APART = ("sun.azimuth", "sun.elevation", "heliostats.pivot_height")
#: Keys that label a result even if they are not swept.
_LABELS = (
    *("site.latitude", "site.longitude", "sun.azimuth", "sun.elevation"),
    *(f"receiver.{key}" for key in ("azimuth", "tilt", "width", "height_extent", "height")),
    *(f"mount.{key}" for key in ("kind", "axis_azimuth", "mirror_offset", "axis_offset", "pedestal_height")),
    "heliostats.pivot_height",
)


def computation(study: MisalignmentStudy) -> Computation:
    """Return the computation for the mode of a study, with the labels and dimensions common to all modes."""
    module = "spots" if study.mode in ("curves", "mount_errors") else "calibration"
    made: Computation = pkgutil.resolve_name(f"{__package__}.{module}:{study.mode}_work")(study)
    fixed: Any = {"sun_position": "as given"} if study.time is None else {}
    return replace(
        made,
        mode=study.mode,
        labels=(*_LABELS, *made.labels),
        dims={**days_and_hours(study), **made.dims},
        coordinates=lambda: {**_universal_times(study), **(made.coordinates() if made.coordinates else {})},
        attrs=fixed | made.attrs,
        layouts=None if study.layout is not None else Positions,
        split="heliostat",
    )


def instant_sizes(study: MisalignmentStudy) -> dict[str, int]:
    """Return the lengths of the day and hour dimensions."""
    return {dim: one if isinstance(one, int) else len(one[0]) for dim, one in days_and_hours(study).items()}


def days_and_hours(study: MisalignmentStudy) -> dict[str, Any]:
    """Return the day and hour labels, or the length 1 of both dimensions if the sun is fixed."""
    time = study.time
    if time is None:
        return {"day": 1, "hour": 1}
    hour = {"long_name": f"{'solar' if time.clock == 'solar' else 'wall-clock'} time of day", "units": "h"}
    if isinstance(time, CivilTime):
        dates = np.array(time.date_list(), dtype="datetime64[ns]")
        return {"date": (dates, DATE), "hour": (_wall_seconds(time) / 3600, hour)}
    if (declinations := time.declinations()) is not None:
        attrs = {"long_name": "declination of the sun", "units": "degree"}
        return {"declination": (declinations, attrs), "hour": (time.solar_hours(), hour)}
    day = {"long_name": "day of the year", "units": "1"}
    return {"day": (time.day_numbers(), day), "hour": (time.solar_hours(), hour)}


def _universal_times(study: MisalignmentStudy) -> dict[str, Any]:
    """Return the coordinate ``utc`` for civil time, with a dimension ``site`` if the clocks of the sites differ."""
    if not isinstance(study.time, CivilTime):
        return {}
    tables = [wall_clock(study.time, zone) for zone in Parameters(study).timezones()]
    alike = len({table.tobytes() for table in tables}) == 1
    dims = ("site",) * (not alike) + tuple(instant_sizes(study))
    return {"utc": (dims, np.array(tables[0] if alike else tables), {"long_name": "universal time"})}


@lru_cache(maxsize=16)
def wall_clock(time: CivilTime, timezone: str) -> NDArray[np.datetime64]:
    """Return the universal time of each wall-clock hour on each date, shape (dates, hours).

    Hours that a clock change skips are NaT. If an hour occurs twice, its first occurrence is used. Time zones
    are offsets such as ``+08:00`` or IANA names.
    """
    zone, seconds = parse_timezone(timezone), _wall_seconds(time).tolist()
    found = [to_utc(date, second, zone) for date in time.date_list() for second in seconds]
    times = [np.datetime64(utc.replace(tzinfo=None) if is_shown else "NaT", "ns") for utc, is_shown in found]
    return np.reshape(times, (-1, len(seconds)))


def _wall_seconds(time: CivilTime) -> Floats:
    start, stop, step = time.window_seconds()
    return start + step * window_positions((stop - start) / step, time.sampling)


def sun_of(point: Point) -> Floats:
    """Return the unit vectors to the sun at a point, ordered by day and hour, shape (T, 3): east, north, up. [1]"""
    time = point.study.time
    if time is None:
        around, up = np.radians(point["sun.azimuth"]), np.radians(point["sun.elevation"])
        return np.array([[np.cos(up) * np.sin(around), np.cos(up) * np.cos(around), np.sin(up)]])
    return _civil_sun(time, point.timezone, *map(point.__getitem__, PLACE)) if time.clock == "civil" else point.sun


@lru_cache(maxsize=64)
def _civil_sun(time: CivilTime, timezone: str, *place: float | None) -> Floats:
    return sun_at(Instants({"utc": xr.Variable("time", wall_clock(time, timezone).ravel())}, "civil"), place)


class Positions(LayoutAxis):
    """Layout with a pivot at each position in a study: east, north and up, relative to the tower's base [m]."""

    def __init__(self, study: MisalignmentStudy) -> None:
        layout = Layout(*np.array(study.heliostats.positions or (), np.float64).T)
        self.dims, self._shape, self.size, self._layouts = (), (), len(layout), [layout]

    def coordinates(self) -> dict[str, xr.DataArray]:
        """Return the coordinates ``heliostat``, ``x``, ``y`` and ``z``."""
        number = "number of the heliostat in the list of positions, counted from 0"
        columns = {
            "x": "distance of the pivot east of the tower",
            "y": "distance of the pivot north of the tower",
            "z": "height of the pivot above the tower's base",
        }
        return {"heliostat": self.numbers.assign_attrs(long_name=number)} | {
            name: self.column(name).assign_attrs(long_name=meaning, units="m") for name, meaning in columns.items()
        }


def values_of(point: Point, key: str, shape: tuple[int, ...] | None = None, given: Any = None) -> NDArray[Any]:
    """Return the values of a key at the points of a group; 0 if the key has no value.

    `shape` is the number of values to return along each dimension of the group (default: all). A value `given` other
    than None overrides the values of the key.
    """
    values = [value for value in (given, point[key], 0.0) if value is not None]
    return np.broadcast_to(values[0], point.group)[tuple(map(slice, shape or point.group))].ravel()


class Scene(NamedTuple):
    """Receiver, mounts, heliostats and sun for a group of P points."""

    #: Receiver and mounts, shape (P,).
    setting: Setting
    #: Unit vectors to the sun, shape (T, 3).
    sun: Floats
    #: Pivots relative to the tower's base, shape (H, 3). [m]
    pivots: Floats
    #: Indices of the heliostats in the whole result, shape (H,).
    numbers: NDArray[np.int64]

    @classmethod
    def of(cls, point: Point, shape: tuple[int, ...] | None = None) -> Scene:
        """Return the scene for a group of points; `shape` selects points as in `values_of`."""
        layout, part, up = point.layout, point.part("heliostat"), point["heliostats.pivot_height"] or 0.0
        pivots = np.stack([layout.x, layout.y, np.asarray(layout.z) + up], axis=1).astype(float)[part]
        setting = Setting._make(convert(values_of(point, key, shape)) for key, convert in _SETTING.items())
        return cls(setting, sun_of(point), pivots, np.arange(len(layout))[part])

    def mounts(self, point: int = 0) -> Mounts:
        """Return the mounts at one point."""
        return mounts_of(self.setting, self.pivots, point)


def codes_of(names: Sequence[Any] | NDArray[Any], known: Sequence[str]) -> NDArray[np.int64]:
    """Return the codes that the kernels use for names: the positions of the names in `known`."""
    return np.array([known.index(str(name)) for name in names], np.int64)


#: Study key for each field of `Setting`, in order, with a function that converts values to the unit of the field.
_SETTING: dict[str, Callable[[Any], NDArray[Any]]] = {
    "receiver.azimuth": np.radians,
    "receiver.tilt": np.radians,
    "receiver.width": partial(np.multiply, 0.5),
    "receiver.height_extent": partial(np.multiply, 0.5),
    "receiver.height": np.asarray,
    "mount.kind": partial(codes_of, known=KINDS),
    "site.latitude": np.radians,
    "mount.axis_azimuth": np.radians,
    "mount.mirror_offset": np.asarray,
    "mount.axis_offset": np.asarray,
    "mount.pedestal_height": np.asarray,
}


def coded(dims: tuple[str, ...], long_name: str, meanings: Mapping[int, str], comment: str = "") -> Variable:
    """Return a variable of integer codes, with the code -1 for padding entries of shorter layouts."""
    return replace(flags(dims, long_name, {NO_HELIOSTAT: "no_heliostat", **meanings}, comment), missing=NO_HELIOSTAT)


def numbered(count: int, meaning: str) -> tuple[NDArray[np.int64], dict[str, str]]:
    """Return the labels of a dimension (integers from 0) and their attributes."""
    return np.arange(count), {"long_name": meaning, "units": "1"}


def mean_errors(point: Point, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """Return the six mount errors at the points of a group, shape (P, 6). [mrad]

    Drawn errors are replaced by their means. `shape` selects points as in `values_of`.
    """
    means = {name: getattr(getattr(point.study.mount_errors, name, None), "mean", None) for name in ERRORS}
    return np.stack([values_of(point, f"mount_errors.{name}", shape, mean) for name, mean in means.items()], axis=-1)


def draw_count(study: MisalignmentStudy) -> int:
    """Return the number of draws; 0 if no error is drawn, or if spots are measured."""
    return 0 if study.mount_errors is None else study.mount_errors.draws()


def error_keys(study: MisalignmentStudy) -> list[str]:
    """Return the mount error keys that label a result: errors that are not drawn, and the scale of drawn errors."""
    drawn = {} if study.mount_errors is None else study.mount_errors.drawn()
    return [f"mount_errors.{name}" for name in (*ERRORS, *["scale"] * bool(drawn)) if name not in drawn]


def drawn_errors(point: Point, numbers: NDArray[np.int64]) -> Iterator[NDArray[np.float64]]:
    """Yield the six mount errors of each heliostat and draw at each point of a group, shape (H, samples, 6). [mrad]"""
    block = point.study.mount_errors
    deviates = _deviates(block.errors(), tuple(numbers.tolist()), max(1, block.draws()), block.seed or 0)
    scale = values_of(point, "mount_errors.scale")
    for mean, spread in zip(mean_errors(point), np.outer(scale, widths_of(block.errors())), strict=True):
        yield mean + spread * deviates


#: Cached version of `standard_deviates`. Consecutive points use the same deviates.
_deviates = lru_cache(maxsize=2)(standard_deviates)


@lru_cache(maxsize=4)
def noise_of_draws(seed: int, stream: int, heliostats: tuple[int, ...], samples: int, count: int) -> Floats:
    """Return `count` standard normal numbers for each heliostat and draw, shape (H, samples, count)."""
    each = (standard_normals(seed, stream, heliostats, count, sample * MOST_NUMBERS) for sample in range(samples))
    return np.stack([*each], axis=1)

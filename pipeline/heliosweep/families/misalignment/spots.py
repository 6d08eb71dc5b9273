"""Modes `curves` and `mount_errors`, and functions that all modes share.

Mode `curves` computes deviation curves with their tolerances, conics and crossings with detectors. Mode `mount_errors`
computes spots for fixed, swept or drawn errors, and statistics over the draws. Drawn errors are not stored: each call
recomputes them from the seed. The drawn errors of a heliostat are the same at all instants and points.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import NORMAL, CivilTime, parse_timezone, to_utc
from heliosweep.families.family import Computation, Point, by_axis
from heliosweep.families.misalignment.study import MisalignmentStudy
from heliosweep.families.mount_errors import standard_deviates, standard_normals, widths_of
from heliosweep.grid import (
    DATE,
    PLACE,
    Parameters,
    Variable,
    flags,
    pair,
    quantity,
    window_positions,
    with_best,
)
from heliosweep.kernels import traces
from heliosweep.kernels.calibration import Mounts
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.mounts import BEHIND_FACE, BLIND_CONE, ERRORS, NO_SUN, REACHES, TOO_NEAR, Setting
from heliosweep.kernels.spots import (
    AZIMUTH,
    CANTING,
    ELEVATION,
    TILT,
    deviation_curves,
    mount_spots,
    spot_statistics,
)
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import LayoutAxis, longest
from heliosweep.lazy import xr
from heliosweep.mounts import AXES, KINDS, SOURCES, SPOT_STATUS, mounts_of
from heliosweep.sun import direction, sun_vectors

#: Status of the padding entries that follow the last heliostat of a shorter layout.
NO_HELIOSTAT = -1
#: Positive directions of the axes in the receiver plane.
SIDES = {"y": "to the right of the aim point", "z": "above the aim point"}
#: Random streams for the noise of synthetic spots along y and z. Mount error i of `ERRORS` uses stream i.
NOISE_STREAMS = (100, 101)
#: Keys that have a single value in each call. A call computes a group of points.
APART = ("sun.azimuth", "sun.elevation", "heliostats.pivot_height")
#: Keys that label a result even if they are not swept.
_LABELS = (
    *("site.latitude", "site.longitude", "sun.azimuth", "sun.elevation"),
    *(f"receiver.{key}" for key in ("azimuth", "tilt", "width", "height_extent", "height")),
    *(f"mount.{key}" for key in ("kind", "axis_azimuth", "mirror_offset", "axis_offset", "pedestal_height")),
    "heliostats.pivot_height",
)


def computation(study: MisalignmentStudy) -> Computation:
    """Return the computation for the study's mode, with the labels and dimensions common to all modes."""
    module = "spots" if study.mode in ("curves", "mount_errors") else "calibration"
    made: Computation = pkgutil.resolve_name(f"{__package__}.{module}:{study.mode}_work")(study)

    def coordinates() -> dict[str, Any]:
        found = dict(made.coordinates() if made.coordinates else {})
        if isinstance(study.time, CivilTime):
            # The clocks of the sites may differ.
            tables = [wall_clock(study.time, zone) for zone in Parameters(study).timezones()]
            alike = len({table.tobytes() for table in tables}) == 1
            dims = ("site",) * (not alike) + tuple(instant_sizes(study))
            found["utc"] = dims, np.array(tables[0] if alike else tables), {"long_name": "universal time"}
        return found

    fixed: Any = {"sun_position": "as given"} if study.time is None else {}
    return replace(
        made,
        mode=study.mode,
        labels=(*_LABELS, *made.labels),
        dims={**days_and_hours(study), **made.dims},
        coordinates=coordinates,
        attrs=fixed | made.attrs,
        layouts=None if study.layout is not None else Positions,
        split="heliostat",
    )


def instant_sizes(study: MisalignmentStudy) -> dict[str, int]:
    """Return the lengths of the day and hour dimensions."""
    return {dim: one if isinstance(one, int) else len(one[0]) for dim, one in days_and_hours(study).items()}


def days_and_hours(study: MisalignmentStudy) -> dict[str, Any]:
    """Return the labels of the day and hour dimensions. If the sun is fixed, return the length 1 of each."""
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


@lru_cache(maxsize=16)
def wall_clock(time: CivilTime, timezone: str) -> NDArray[np.datetime64]:
    """Return the universal time of each wall-clock hour on each date, shape (dates, hours).

    Hours that a clock change skips are NaT. If an hour occurs twice, its first occurrence is used. `timezone` is an
    offset such as ``+08:00`` or an IANA name.
    """
    zone, seconds = parse_timezone(timezone), _wall_seconds(time).tolist()
    found = [to_utc(date, second, zone) for date in time.date_list() for second in seconds]
    times = [np.datetime64(utc.replace(tzinfo=None) if is_shown else "NaT", "ns") for utc, is_shown in found]
    return np.reshape(times, (-1, len(seconds)))


def _wall_seconds(time: CivilTime) -> Floats:
    start, stop, step = time.window_seconds()
    return start + step * window_positions((stop - start) / step, time.sampling)


def sun_of(point: Point) -> Floats:
    """Return the unit vectors to the sun (east, north, up) for each day and hour, shape (T, 3). [1]"""
    time = point.study.time
    if time is None:
        return direction(point["sun.azimuth"], point["sun.elevation"])[np.newaxis]
    if time.clock != "civil":
        return point.sun
    return _civil_sun(time, point.timezone, *(float(point[key]) for key in PLACE[:3]))


@lru_cache(maxsize=64)
def _civil_sun(time: CivilTime, timezone: str, *place: float) -> Floats:
    return sun_vectors(wall_clock(time, timezone).ravel(), *place)


class Positions(LayoutAxis):
    """Layout whose pivots are the positions listed in a study."""

    def __init__(self, study: MisalignmentStudy) -> None:
        layout = Layout(*np.array(study.heliostats.positions or (), np.float64).T)
        self.dims, self._shape, self.size, self._layouts = (), (), len(layout), [layout]

    def coordinates(self) -> dict[str, xr.DataArray]:
        """Return the coordinates ``heliostat``, ``x``, ``y`` and ``z``."""
        number = "number of the heliostat in the list of positions, counted from 0"
        columns = {
            "x": "eastward distance of the pivot from the tower",
            "y": "northward distance of the pivot from the tower",
            "z": "height of the pivot above the tower's base",
        }
        return {"heliostat": self.numbers.assign_attrs(long_name=number)} | {
            name: self.column(name).assign_attrs(long_name=meaning, units="m") for name, meaning in columns.items()
        }


def values_of(point: Point, key: str, shape: tuple[int, ...] | None = None, given: Any = None) -> NDArray[Any]:
    """Return the values of a key at the points of a group; 0 if the key has no value.

    `shape` is the number of values to return along each dimension of the group (default: all). If `given` is not None,
    it overrides the values of the key.
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
    """Return the kernel code of each name, which is its position in `known`."""
    return np.array([known.index(str(name)) for name in names], np.int64)


#: Study key of each field of `Setting`, in order, with a function that converts its values to the kernel's unit.
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
    """Return a variable of integer codes. Padding entries of shorter layouts have the code -1."""
    return replace(flags(dims, long_name, {NO_HELIOSTAT: "no_heliostat", **meanings}, comment), missing=NO_HELIOSTAT)


def numbered(count: int, meaning: str) -> tuple[NDArray[np.int64], dict[str, str]]:
    """Return the integer labels of a dimension, counted from 0, and their attributes."""
    return np.arange(count), {"long_name": meaning, "units": "1"}


def mean_errors(point: Point, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """Return the six mount errors at the points of a group, shape (P, 6). [mrad]

    Drawn errors are replaced by their means. `shape` selects points as in `values_of`.
    """
    means = {name: getattr(getattr(point.study.mount_errors, name, None), "mean", None) for name in ERRORS}
    return np.stack([values_of(point, f"mount_errors.{name}", shape, mean) for name, mean in means.items()], axis=-1)


def draw_count(study: MisalignmentStudy) -> int:
    """Return the number of draws; 0 if no error is drawn or the spots are measured."""
    return 0 if study.mount_errors is None else study.mount_errors.draws()


def error_keys(study: MisalignmentStudy) -> list[str]:
    """Return the mount error keys that label a result: fixed and swept errors, and the scale of drawn errors."""
    drawn = {} if study.mount_errors is None else study.mount_errors.drawn()
    return [f"mount_errors.{name}" for name in (*ERRORS, *["scale"] * bool(drawn)) if name not in drawn]


def drawn_errors(point: Point, numbers: NDArray[np.int64]) -> Iterator[NDArray[np.float64]]:
    """Yield the drawn mount errors for each point of a group, shape (H, samples, 6). [mrad]"""
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
    # Consecutive draws start 2^24 numbers apart in the stream, so that a draw can use up to 2^24 numbers.
    each = (standard_normals(seed, stream, heliostats, count, sample * 2**24) for sample in range(samples))
    return np.stack([*each], axis=1)


#: Number of points on the outline of a spot.
OUTLINE = 36
_FIRST = (
    "the first instant if the minimum occurs several times; missing if the minimum tolerance is infinite or missing"
)
_SEEN = "for an observer in the field who faces the receiver; missing unless spot_status is 0"
#: Axes in the mirror plane about which the remaining tolerance is computed.
TOLERANCE_AXES = ("elevation", "azimuth")
#: Default percentiles of the remaining tolerance.
PERCENTILES = (5.0, 50.0, 95.0)
#: Variable name for each kernel result.
_MOMENTS = {
    "mean_y": "spot_y_mean",
    "mean_z": "spot_z_mean",
    "variance_y": "spot_y_variance",
    "variance_z": "spot_z_variance",
    "covariance": "spot_yz_covariance",
    "hit_fraction": "hit_fraction",
    "real_fraction": "real_fraction",
    "status": "spot_status",
}
#: Errors that the commands correct, shape (1, 1, 6): all zero, because the errors are unknown to the controller.
_UNKNOWN = np.zeros((1, 1, len(ERRORS)))
_DRAWS = "realization: {} (over the draws of the mount errors)"
_AIMED = {
    REACHES: "mount_aims",
    BEHIND_FACE: "pivot_on_or_behind_the_plane",
    NO_SUN: "sun_below_the_horizon",
    BLIND_CONE: "mount_cannot_point_there",
    TOO_NEAR: "offsets_not_smaller_than_the_distance",
}


def curves_work(study: MisalignmentStudy) -> Computation:
    """Return the computation for mode `curves`.

    Variables that describe a complete curve do not vary with the error size.
    """
    day, hour = instant_sizes(study)
    each, alone = ("heliostat", day, hour), size_dims(study)
    of_curve = partial(quantity, without=alone)
    found = spot_variables(study) | {
        "tracking_tolerance": of_curve(
            each,
            "mrad",
            "minimum error of either sign at which the spot leaves the aperture",
            "infinite if the spot never leaves the aperture; 0 if mount errors already move the spot outside; "
            "missing if the heliostat has no spot without the error",
        ),
        "conic": of_curve(
            (*each, "conic_coefficient"),
            "1",
            "coefficients of the deviation curve A Y2 + B Y Z + C Z2 + D Y + E Z + F = 0",
            "Y = spot_y and Z = spot_z in m; all coefficients are divided by A, or by the coefficient of maximum "
            "magnitude if A is zero; missing if the curve is not a conic, because the error moves the mirror centre "
            "or is a rotation about the encoder axis",
        ),
        "eccentricity": of_curve(
            each, "1", "eccentricity of the deviation curve", "below 1 for an ellipse, above 1 for a hyperbola"
        ),
        **{
            f"focus_{side}": of_curve(
                each, "m", f"focus inside the branch of the deviation curve that real rays trace, {where}"
            )
            for side, where in SIDES.items()
        },
    }
    if study.beam is not None:
        comment = "for a beam whose central ray starts at the mirror's centre"
        found |= pair("outline_%", SIDES, (*each, "outline"), "m", "outline of the beam's spot, %", comment)
        found |= pair("edge_%", SIDES, (*each, "edge"), "m", "edge of the beam's trace as the error varies, %")
    meaning = "minimum tolerance over all days and hours"
    found["minimum_tolerance"] = of_curve(
        each[:1], "mrad", meaning, "infinite if the spot never leaves the aperture; missing if there is no spot"
    )
    date = {"long_name": "local date of the minimum tolerance", "comment": _FIRST}
    instants = {
        "day": of_curve(each[:1], "1", "day of the year of the minimum tolerance", _FIRST),
        "declination": of_curve(each[:1], "degree", "declination of the sun at the minimum tolerance", _FIRST),
        "date": Variable(each[:1], date, np.dtype("datetime64[ns]"), without=alone),
        "hour": of_curve(each[:1], "h", "hour of the minimum tolerance", _FIRST),
    }
    found |= {f"{dim}_of_minimum_tolerance": instants[dim] for dim in (day, hour) if study.time is not None}
    if study.detectors is not None:
        meaning = "crossing of the deviation curve with a detector line"
        found |= {
            f"crossing_{side}": of_curve(
                (*each, "detector"),
                "m",
                f"{meaning}, {where}",
                "if there are several, the crossing with the minimum error; missing if there is none",
            )
            for side, where in SIDES.items()
        } | {
            "crossing_error": of_curve(
                (*each, "detector"),
                "mrad",
                "error at which the spot lies on a detector line",
                "error of minimum magnitude; missing if there is no crossing",
            )
        }
    variables = with_best(found, ("tracking_tolerance", "minimum_tolerance"))
    name = {"long_name": "coefficient of the deviation curve"}
    dims: dict[str, Any] = {"conic_coefficient": (np.array(("A", "B", "C", "D", "E", "F"), dtype=object), name)}
    if len(lines := _lines(study)):
        dims["detector"] = numbered(len(lines), "number of the detector line, counted from 0")
    if study.beam is not None:
        turn = {"long_name": "position on the outline of a spot, as an angle about the central ray", "units": "degree"}
        side = {
            "long_name": (
                "edge of a trace, formed by rays from the point of the sun nearest to or farthest from the error axis"
            )
        }
        dims["outline"] = 360.0 * np.arange(OUTLINE) / OUTLINE, turn
        dims["edge"] = np.array(["near", "far"], dtype=object), side
    return Computation(
        curves,
        variables,
        (
            "error.source",
            "error.axis",
            "error.size",
            "beam.divergence",
            "beam.width",
            *(f"mount_errors.{name}" for name in ERRORS),
        ),
        dims,
        coordinates=lambda: _coordinates(study),
        arrays=APART,
        unit="spots",
    )


def _lines(study: MisalignmentStudy) -> Floats:
    return np.array(() if study.detectors is None else study.detectors.lines or (), np.float64).reshape(-1, 3)


def _coordinates(study: MisalignmentStudy) -> dict[str, Any]:
    added: dict[str, Any] = {
        key: ("detector", column, {"long_name": f"{key} of the detector line l0 Y + l1 Z = l2", "units": unit})
        for column, (key, unit) in zip(_lines(study).T, {"l0": "1", "l1": "1", "l2": "m"}.items(), strict=True)
        if column.size
    }
    for spots in study.campaigns().values():
        count = longest(study) if study.layout is not None else Positions(study).size
        table = spots.lists(np.arange(count), spots.position)
        for i, (side, where) in enumerate(SIDES.items()):
            attrs = {"long_name": f"measured spot, {where}", "units": "m"}
            added[f"measured_{side}"] = ("heliostat", "spot"), table[..., i], attrs
    return added


def size_dims(study: MisalignmentStudy) -> tuple[str, ...]:
    """Return a tuple with the dimension along which only the error size varies; empty if there is none."""
    return tuple(dim.name for dim in study.dimensions() if set(dim.sweeps) == {"error.size"})


def spot_variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Return the variables for fixed errors: spots, flags, and the hit fraction on each day."""
    dims = ("heliostat", *instant_sizes(study))
    found = {
        "spot_y": quantity(dims, "m", f"spot on the receiver's plane, {SIDES['y']}", f"to the right {_SEEN}"),
        "spot_z": quantity(dims, "m", f"spot on the receiver's plane, {SIDES['z']}", f"up along the face {_SEEN}"),
        "spot_status": coded(dims, "reason for a missing spot", SPOT_STATUS),
        "is_real": flags(dims, "flag for reflected rays that reach the receiver's plane", {0: "no_spot", 1: "spot"}),
        "inside": flags(dims, "flag for spots in the aperture", {0: "outside_or_no_spot", 1: "inside"}),
        "hit_fraction": quantity(
            dims[:-1],
            "1",
            "fraction of the hours with sun in which the spot lies in the aperture",
            "missing on days without sun and for padding entries",
            cell_methods="time: mean (over the hours with sun)",
            valid_range=[0.0, 1.0],
        ),
    }
    return with_best(found, ("hit_fraction",))


def spot_values(point: Point, y: Floats, z: Floats, status: Floats) -> dict[str, NDArray[Any]]:
    """Compute the values of `spot_variables` from the spots [m] and their status.

    The spots have the shape (*group, heliostats, days, hours).
    """
    width, height = (
        0.5 * np.broadcast_to(point[f"receiver.{key}"], point.group)[..., np.newaxis, np.newaxis, np.newaxis]
        for key in ("width", "height_extent")
    )
    inside = (np.abs(y) <= width) & (np.abs(z) <= height)
    hits, counted = (np.count_nonzero(here, axis=-1) for here in (inside, status != NO_SUN))
    fraction = np.divide(hits, counted, out=np.full(hits.shape, np.nan), where=counted > 0)
    flags = {"spot_status": status, "is_real": status == REACHES, "inside": inside}
    return {"spot_y": y, "spot_z": z, "hit_fraction": fraction} | flags


def curves(point: Point) -> dict[str, NDArray[Any]]:
    """Compute the spots, tolerances, conics and detector crossings at a group of points."""
    study, group, instants = point.study, point.group, tuple(instant_sizes(point.study).values())
    sized = [axis for axis, dim in enumerate(point.points.sizes) if dim in size_dims(study)]
    rest = [axis for axis in range(len(group)) if axis not in sized]
    shape = tuple(1 if axis in sized else length for axis, length in enumerate(group))
    scene = Scene.of(point, shape)
    source, axis = (
        codes_of(values_of(point, f"error.{key}", shape), known) for key, known in (("source", SOURCES), ("axis", AXES))
    )
    sizes = 1e-3 * np.broadcast_to(point["error.size"], group).transpose(*rest, *sized).reshape(source.size, -1)
    errors = 1e-3 * mean_errors(point, shape)
    found = deviation_curves(
        scene.setting, source, axis, scene.sun[None], scene.pivots[None], _lines(study), sizes, errors
    )

    def grouped(values: Floats) -> Floats:
        """Reshape values for C curves and E error sizes, shape (C, H, T, E, ...), to the group."""
        values = np.moveaxis(values, 3, 1)
        outer = [group[axis] for axis in (*rest, *sized)]
        values = values.reshape(*outer, values.shape[2], *instants, *values.shape[4:])
        return np.moveaxis(values, [len(group) - 1] * len(sized), sized)

    made = spot_values(point, *map(grouped, found.spots))
    if study.beam is not None:
        widths = [values_of(point, f"beam.{key}", shape) for key in ("divergence", "width")]
        outlines = beams(scene, source, axis, sizes, errors, *widths)
        outlines[np.isnan(found.spots[0])] = np.nan
        made |= by_axis("outline_%", grouped(outlines[..., :OUTLINE, :]), -1, "yz")
        made |= by_axis("edge_%", grouped(outlines[..., OUTLINE:, :]), -1, "yz")
    values = {
        "tracking_tolerance": 1e3 * found.tolerance,
        "conic": np.moveaxis(found.conic[:6], 0, -1),
        **dict(zip(("eccentricity", "focus_y", "focus_z"), found.conic[6:], strict=True)),
        **by_axis("crossing_%", found.crossing[:2], 0, "yz"),
        "crossing_error": 1e3 * found.crossing[2],
    }
    for name, array in values.items():
        made[name] = array.reshape(*shape, array.shape[1], *instants, *array.shape[3:])
    minimum = _minimum(study, values["tracking_tolerance"])
    return made | {name: array.reshape(*shape, array.shape[1]) for name, array in minimum.items()}


def _minimum(study: MisalignmentStudy, tolerance: Floats) -> dict[str, NDArray[Any]]:
    """Return the minimum tolerance over all instants and its first day and hour, shape (C, H)."""
    least = np.where(np.isnan(tolerance), np.inf, tolerance).min(axis=-1)
    first = (tolerance <= least[..., np.newaxis] * (1 + 1e-12)).argmax(axis=-1)  # despite rounding
    made: dict[str, NDArray[Any]] = {"minimum_tolerance": np.where(np.isnan(tolerance).all(axis=-1), np.nan, least)}
    labels, places = days_and_hours(study), np.unravel_index(first, tuple(instant_sizes(study).values()))
    for (dim, label), index in zip(labels.items() if study.time else (), places, strict=False):
        at = label[0][index]
        missing = np.datetime64("NaT", "ns") if at.dtype.kind == "M" else np.nan
        made[f"{dim}_of_minimum_tolerance"] = np.where(np.isfinite(made["minimum_tolerance"]), at, missing)
    return made


def beams(
    scene: Scene, source: NDArray[np.int64], axis: NDArray[np.int64], sizes: Floats, errors: Floats,
    divergence: Floats, width: Floats,
) -> Floats:  # fmt: skip
    """Return the spot outlines and trace edges of conical beams, shape (C, H, T, E, OUTLINE + 2, 2). [m]

    The edges are traced by rays from the two points of the sun that are nearest to and farthest from the error axis.
    While the mirror rotates about an axis in its plane, each edge ray traces a conic. The beam covers the area between
    the two conics. A beam whose width [m] is not zero starts from a disc at the mirror, and its outer rays start from
    the rim of the disc.
    """
    sun, found = scene.sun, []
    for point, known in enumerate(errors):
        half, radius = 0.5e-3 * float(divergence[point]), 0.5 * float(width[point])
        mounts, turn = scene.mounts(point), sizes[point].reshape(-1, 1, 1, 1)
        mirror = mounts.stand(mounts.aim(sun), known)
        about = {ELEVATION: mirror.right, AZIMUTH: -mirror.up}.get(int(axis[point]), -mirror.primary)
        arm = {CANTING: 0.0 * mirror.arm, TILT: mirror.pole + mirror.arm}.get(int(source[point]), mirror.arm)
        side = about - traces.dot(about, sun)[..., np.newaxis] * sun
        with np.errstate(divide="ignore", invalid="ignore"):
            side = side / np.sqrt(traces.dot(side, side))[..., np.newaxis]
        normal = traces.turned(about, mirror.normal, turn)
        centre = mirror.centre - arm + traces.turned(about, arm, turn)
        outline = traces.beam_outline(centre, traces.reflected(normal, sun), mounts.face, half, OUTLINE, radius)
        rim = radius * traces.reflected(normal, side)
        edges = [
            traces.spots(
                centre + sign * rim,
                traces.reflected(normal, np.cos(half) * sun + sign * np.sin(half) * side),
                mounts.face,
            )
            for sign in (1.0, -1.0)
        ]
        found.append(np.concatenate([outline, np.stack(edges, axis=-2)], axis=-2))
    return np.moveaxis(np.stack(found), 1, 3)


def mount_errors_work(study: MisalignmentStudy) -> Computation:
    """Return the computation for mode `mount_errors`."""
    block: Any = study.mount_errors
    common: dict[str, Any] = {"labels": tuple(error_keys(study)), "arrays": APART, "unit": "spots"}
    if not block.draws():
        return Computation(fixed_errors, spot_variables(study), **common)
    each, mean = ("heliostat", *instant_sizes(study)), _DRAWS.format("mean")
    moments = {
        "spot_y_mean": (
            "m",
            "mean position of the spot to the right of the aim point, for an observer in the field who faces the "
            "receiver",
            "mean",
        ),
        "spot_z_mean": ("m", "mean position of the spot above the aim point, along the receiver's face", "mean"),
        "spot_y_variance": ("m2", "variance of the spot's coordinate to the right (n - 1)", "variance"),
        "spot_z_variance": ("m2", "variance of the spot's upward coordinate (n - 1)", "variance"),
        "spot_yz_covariance": ("m2", "covariance of the spot's coordinates to the right and upwards (n - 1)", "mean"),
    }  # fmt: skip
    real = "over the draws whose ray reaches the receiver's plane; missing if there are no such draws or no sun"
    found = {
        name: quantity(each, units, words, real, cell_methods=_DRAWS.format(method))
        for name, (units, words, method) in moments.items()
    } | {
        "hit_fraction": quantity(
            each,
            "1",
            "fraction of the draws whose spot lies in the aperture",
            "relative to all draws, including draws without a spot; missing without sun",
            cell_methods=mean,
        ),
        "real_fraction": quantity(
            each,
            "1",
            "fraction of the draws whose ray reaches the receiver's plane",
            "missing without sun",
            cell_methods=mean,
        ),
        "spot_status": coded(
            each,
            "reason for missing spots",
            _AIMED,
            "status of the mount without errors; if it is not 0, no draw has a spot",
        ),
        "remaining_tolerance": quantity(
            (*each, "percentile", "tolerance_axis"),
            "mrad",
            "angle by which the mirror can rotate about its centre before its spot leaves the aperture",
            "percentile over the draws of the minimum angle about an axis in the mirror plane; 0 for a draw whose "
            "spot is outside or does not exist, infinite if no angle moves the spot outside",
        ),
        "day_hit_fraction": quantity(
            each[:-1],
            "1",
            "fraction of the draws, over the hours with sun, in which the spot lies in the aperture",
            cell_methods=f"{mean} time: mean (over the hours with the sun above the horizon)",
        ),
        "field_hit_fraction": quantity(
            each[1:],
            "1",
            "fraction of the draws and heliostats whose spot lies in the aperture",
            "mean over the heliostats with equal weights; missing without sun",
            finished=True,
            cell_methods=mean,
        ),
    }
    largest = ("hit_fraction", "real_fraction", "remaining_tolerance", "day_hit_fraction", "field_hit_fraction")
    variables = with_best(found, largest, ("spot_y_variance", "spot_z_variance"))
    errors = []
    for name, error in block.drawn().items():
        words = "mean {:g}, standard deviation {:g}" if error.kind == NORMAL else "{:g} to {:g}"
        seed = "" if error.seed is None else f", seed {error.seed}"
        errors.append(f"{name} {error.kind} ({words.format(*error.parts)} mrad{seed})")
    errors.append(f"{block.draws()} draws from Philox 4x64, seed {block.seed or 0}, keyed by error and heliostat")
    percentile = {"long_name": "percentile over the draws", "units": "1"}
    axis = {"long_name": "axis in the mirror plane about which the mirror rotates"}
    percentiles = np.array(PERCENTILES if study.statistics is None else study.statistics.percentiles.values(), float)
    return Computation(
        partial(drawn, percentiles),
        variables,
        dims={"percentile": (percentiles, percentile), "tolerance_axis": (np.array(TOLERANCE_AXES, object), axis)},
        attrs={"mount_errors": "; ".join(errors)},
        finish=lambda points, computed: {
            "field_hit_fraction": _mean(computed["hit_fraction"].transpose(..., "heliostat").to_numpy())
        },
        **common,
    )


def fixed_errors(point: Point) -> dict[str, NDArray[Any]]:
    """Compute the spots at a group of points with fixed or swept errors."""
    scene, actual = Scene.of(point), mean_errors(point)[:, np.newaxis] * 1e-3
    spots = mount_spots(scene.setting, actual, _UNKNOWN, scene.sun[np.newaxis], scene.pivots[np.newaxis])
    shape = *point.group, len(scene.numbers), *instant_sizes(point.study).values()
    return spot_values(point, *(each.reshape(shape) for each in spots))


def drawn(percentiles: NDArray[np.float64], point: Point) -> dict[str, NDArray[Any]]:
    """Compute statistics over the draws at a group of points, and the mean hit fraction on each day."""
    scene = Scene.of(point)
    sky, made = (scene.sun[np.newaxis], scene.pivots[np.newaxis]), []
    for number, errors in enumerate(drawn_errors(point, scene.numbers)):
        one = Setting._make(values[number : number + 1] for values in scene.setting)
        made.append(spot_statistics(one, 1e-3 * errors[np.newaxis], _UNKNOWN, *sky, percentiles))
    shape = *point.group, len(scene.numbers), *instant_sizes(point.study).values()
    arrays = {name: np.concatenate([each[name] for each in made]) for name in made[0]}
    values = {ours: arrays[name].reshape(shape) for name, ours in _MOMENTS.items()}
    values["remaining_tolerance"] = 1e3 * arrays["tolerance"].reshape(*shape, percentiles.size, len(TOLERANCE_AXES))
    return values | {"day_hit_fraction": _mean(values["hit_fraction"])}


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean along the last dimension, ignoring NaN; NaN if there are no values."""
    count = np.count_nonzero(~np.isnan(values), axis=-1)
    # Values are added in order, so that padding at the end does not change the rounding of the sum.
    return np.where(count > 0, np.cumsum(np.nan_to_num(values), axis=-1)[..., -1] / np.maximum(count, 1), np.nan)

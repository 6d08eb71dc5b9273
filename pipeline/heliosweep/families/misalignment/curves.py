"""Mode `curves`: deviation curves of single misalignments, their tolerances, conics and crossings with detectors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.families.family import Computation
from heliosweep.families.misalignment.blocks import AXES, ERRORS, SOURCES
from heliosweep.families.misalignment.draws import mean_errors
from heliosweep.families.misalignment.points import (
    APART,
    SIDES,
    Positions,
    Scene,
    codes_of,
    days_and_hours,
    instant_sizes,
    values_of,
)
from heliosweep.families.misalignment.spots import spot_values, spot_variables
from heliosweep.grid.layout_axis import longest
from heliosweep.grid.regions import Variable, pair, quantity, with_best
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.mounts.aiming import stand
from heliosweep.kernels.spots import traces
from heliosweep.kernels.spots.curves import AZIMUTH, CANTING, ELEVATION, TILT, deviation_curves
from heliosweep.mounts import commands

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.spots_file import MeasuredSpots
    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.families.points import Point

#: Coefficients of a deviation curve.
COEFFICIENTS = ("A", "B", "C", "D", "E", "F")
#: Points of the outline of a spot.
OUTLINE = 36
#: Relative difference of tolerances that are equal.
_SAME = 1e-12
_INFINITE = "infinite if the spot never leaves the aperture; missing if there is no spot"
_FIRST = "the first of several; missing if the minimum tolerance is infinite or missing"
_CROSSED = "of several, the one of the smallest error; missing if there is none"


def computation(study: MisalignmentStudy) -> Computation:
    """Return the variables of a study and the function that computes them."""
    name = {"long_name": "coefficient of the deviation curve"}
    dims: dict[str, Any] = {"conic_coefficient": (np.array(COEFFICIENTS, dtype=object), name)}
    labels = ["error.source", "error.axis", "error.size"]
    lines = _lines(study)
    if len(lines):
        dims["detector"] = np.arange(len(lines)), {"long_name": "number of the line of detectors, from 0", "units": "1"}
    if study.beam is not None:
        labels.append("beam.divergence")
        turn = {"long_name": "position on the outline of a spot, as the angle about the ray", "units": "degree"}
        dims["outline"] = 360.0 * np.arange(OUTLINE) / OUTLINE, turn
        side = {"long_name": "edge of a trace: of rays from the point of the sun nearest to the axis, or farthest"}
        dims["edge"] = np.array(["near", "far"], dtype=object), side
    if study.mount_errors is not None:
        labels += [f"mount_errors.{name}" for name in ERRORS]
    return Computation(
        curves,
        variables(study),
        tuple(labels),
        dims,
        coordinates=lambda: _coordinates(study),
        arrays=APART,
        unit="spots",
    )


def _lines(study: MisalignmentStudy) -> Floats:
    """Lines of detectors, shape (L, 3)."""
    lines = () if study.detectors is None else study.detectors.lines or ()
    return np.array(lines, np.float64).reshape(-1, 3)


def _coordinates(study: MisalignmentStudy) -> dict[str, Any]:
    """Lines of detectors, and measured spots in the order of the file."""
    added: dict[str, Any] = {}
    for column, key, unit in zip(_lines(study).T, ("l0", "l1", "l2"), ("1", "1", "m"), strict=True):
        if column.size:
            attrs = {"long_name": f"{key} of the line of detectors l0 Y + l1 Z = l2", "units": unit}
            added[key] = "detector", column, attrs
    spots: MeasuredSpots | None = study.measured_spots() if study.measured is not None else None
    if spots is not None:
        count = longest(study) if study.layout is not None else Positions(study).size
        table = spots.lists(np.arange(count), spots.position)
        for i, (side, where) in enumerate(SIDES.items()):
            attrs = {"long_name": f"measured spot, {where}", "units": "m"}
            added[f"measured_{side}"] = ("heliostat", "spot"), table[..., i], attrs
    return added


def size_dims(study: MisalignmentStudy) -> tuple[str, ...]:
    """The swept dimension along which only the size of the error varies; empty if there is none."""
    return tuple(dim.name for dim in study.dimensions() if set(dim.sweeps) == {"error.size"})


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Variables of a study's result; variables of a whole curve do not vary with the size of the error."""
    day, hour = instant_sizes(study)
    dims, found = ("heliostat", day, hour), spot_variables(study)
    alone: dict[str, Any] = {"without": size_dims(study)}
    tolerance = "smallest error, of either sign, with which the spot leaves the aperture"
    comment = (
        "infinite if it never does; 0 if errors of the mount have it outside without; missing if the heliostat has no "
        "spot without the error"
    )
    found["tracking_tolerance"] = quantity(dims, "mrad", tolerance, comment, **alone)
    comment = (
        "Y = spot_y and Z = spot_z in m, divided by A, or by the coefficient of the largest magnitude if A is zero; "
        "missing if the curve is no conic: with offsets that the error swings, and about the axis of the encoder"
    )
    conic = "coefficients of the deviation curve A Y2 + B Y Z + C Z2 + D Y + E Z + F = 0"
    found["conic"] = quantity((*dims, "conic_coefficient"), "1", conic, comment, **alone)
    comment = "below 1 an ellipse, above 1 a hyperbola"
    found["eccentricity"] = quantity(dims, "1", "eccentricity of the deviation curve", comment, **alone)
    for side, where in SIDES.items():
        meaning = f"focus of the deviation curve within its real branch, {where}"
        found[f"focus_{side}"] = quantity(dims, "m", meaning, **alone)
    if study.beam is not None:
        comment = "of a beam from the mirror's centre"
        found |= pair("outline_%", SIDES, (*dims, "outline"), "m", "outline of the spot of the beam, %", comment)
        found |= pair("edge_%", SIDES, (*dims, "edge"), "m", "edge of the trace of the beam over the error, %")
    meaning = "minimum tolerance over all days and hours"
    found["minimum_tolerance"] = quantity(dims[:1], "mrad", meaning, _INFINITE, **alone)
    if study.time is not None:
        units = {"day": ("1", "day of the year"), "declination": ("degree", "declination of the sun")}
        for dim in (day, hour):
            unit, words = units.get(dim, ("h", "hour"))
            found[f"{dim}_of_minimum_tolerance"] = (
                Variable(
                    dims[:1],
                    {"long_name": "local date of the minimum tolerance", "comment": _FIRST},
                    np.dtype("datetime64[ns]"),
                    **alone,
                )
                if dim == "date"
                else quantity(dims[:1], unit, f"{words} of the minimum tolerance", _FIRST, **alone)
            )
    if study.detectors is not None:
        lines = (*dims, "detector")
        for side, where in SIDES.items():
            meaning = f"crossing of the deviation curve and a line of detectors, {where}"
            found[f"crossing_{side}"] = quantity(lines, "m", meaning, _CROSSED, **alone)
        comment = "the smallest, of either sign; missing if there is none"
        meaning = "error with which the spot lies on a line of detectors"
        found["crossing_error"] = quantity(lines, "mrad", meaning, comment, **alone)
    return with_best(found, ("tracking_tolerance", "minimum_tolerance"))


def curves(point: Point) -> dict[str, NDArray[Any]]:
    """Compute the spots of a group of points, and the tolerances, conics and crossings of its curves."""
    study, group, instants = point.study, point.group, tuple(instant_sizes(point.study).values())
    sized = [axis for axis, dim in enumerate(point.points.sizes) if dim in size_dims(study)]
    shape = tuple(1 if axis in sized else length for axis, length in enumerate(group))
    scene = Scene.of(point, shape)
    source, axis = (
        codes_of(values_of(point, f"error.{key}", shape), known) for key, known in (("source", SOURCES), ("axis", AXES))
    )
    sizes = 1e-3 * np.broadcast_to(point["error.size"], group)
    sizes = np.moveaxis(sizes, sized, [-1] * len(sized)).reshape(source.size, -1)
    errors = 1e-3 * mean_errors(point, shape)
    found = deviation_curves(
        scene.setting, source, axis, scene.sun[None], scene.pivots[None], _lines(study), sizes, errors
    )

    def grouped(values: Floats) -> Floats:
        """Bring values of curves and sizes, shape (C, H, T, E, ...), into the shape of the group."""
        values = np.moveaxis(values, 3, 1)
        outer = [length for each, length in enumerate(group) if each not in sized] + [group[each] for each in sized]
        values = values.reshape(*outer, values.shape[2], *instants, *values.shape[4:])
        return np.moveaxis(values, [len(group) - 1] * len(sized), sized)

    made = spot_values(point, *map(grouped, found.spots))
    if study.beam is not None:
        divergence = values_of(point, "beam.divergence", shape)
        outlines = beams(scene, source, axis, sizes, errors, divergence)
        outlines[np.isnan(found.spots[0])] = np.nan
        for i, side in enumerate("yz"):
            made[f"outline_{side}"] = grouped(outlines[..., :OUTLINE, i])
            made[f"edge_{side}"] = grouped(outlines[..., OUTLINE:, i])
    *coefficients, eccentricity, focus_y, focus_z = found.conic
    tolerance = 1e3 * found.tolerance
    values = {
        "tracking_tolerance": tolerance,
        "conic": np.stack(coefficients, axis=-1),
        "eccentricity": eccentricity,
        "focus_y": focus_y,
        "focus_z": focus_z,
        "crossing_y": found.crossing[0],
        "crossing_z": found.crossing[1],
        "crossing_error": 1e3 * found.crossing[2],
    }
    for name, array in values.items():
        made[name] = array.reshape(*shape, array.shape[1], *instants, *array.shape[3:])
    minimum = _minimum(study, tolerance)
    return made | {name: array.reshape(*shape, array.shape[1]) for name, array in minimum.items()}


def _minimum(study: MisalignmentStudy, tolerance: Floats) -> dict[str, NDArray[Any]]:
    """Minimum tolerance over all instants, shape (C, H), and its day and hour: the first of several."""
    least = np.where(np.isnan(tolerance), np.inf, tolerance).min(axis=-1)
    first = (tolerance <= least[..., np.newaxis] * (1 + _SAME)).argmax(axis=-1)
    made: dict[str, NDArray[Any]] = {"minimum_tolerance": np.where(np.isnan(tolerance).all(axis=-1), np.nan, least)}
    labels, sizes = days_and_hours(study), instant_sizes(study)
    for dim, index in zip(sizes, np.unravel_index(first, tuple(sizes.values())), strict=True):
        if not isinstance(labels[dim], int):
            label = labels[dim][0][index]
            missing = np.datetime64("NaT", "ns") if label.dtype.kind == "M" else np.nan
            made[f"{dim}_of_minimum_tolerance"] = np.where(np.isfinite(made["minimum_tolerance"]), label, missing)
    return made


def beams(
    scene: Scene, source: NDArray[np.int64], axis: NDArray[np.int64], sizes: Floats, errors: Floats, divergence: Floats
) -> Floats:
    """Outlines of spots and edges of traces of beams that open as cones, shape (C, H, T, E, OUTLINE + 2, 2). [m]

    The edges are those of the rays from the points of the sun nearest to and farthest from the axis of the error: while
    the mirror rotates about an axis in it, each draws a conic, and the beam the area between.
    """
    sun, found = scene.sun, []
    for point, known in enumerate(errors):
        half, mounts = 0.5e-3 * float(divergence[point]), scene.mounts(point)
        frames, to_target, offsets = mounts.frames[:, None], mounts.to_target[:, None], tuple(mounts.offsets)
        aligned = commands(mounts, sun, np.zeros((len(frames), 1, len(ERRORS))))
        mirror = stand(frames, aligned, known, to_target, offsets)
        about = {ELEVATION: mirror.right, AZIMUTH: -mirror.up}.get(int(axis[point]), -mirror.primary)
        arm = {CANTING: 0.0 * mirror.arm, TILT: mirror.pole + mirror.arm}.get(int(source[point]), mirror.arm)
        side = about - traces.dot(about, sun)[..., np.newaxis] * sun
        with np.errstate(divide="ignore", invalid="ignore"):
            side = side / np.sqrt(traces.dot(side, side))[..., np.newaxis]
        for size in sizes[point]:
            normal, centre = (
                traces.turned(about, mirror.normal, size), mirror.centre - arm + traces.turned(about, arm, size)
            )  # fmt: skip
            outline = traces.beam_outline(centre, traces.reflected(normal, sun), mounts.face, half, OUTLINE)
            suns = (np.cos(half) * sun + sign * np.sin(half) * side for sign in (1.0, -1.0))
            edges = [traces.spots(centre, traces.reflected(normal, each), mounts.face) for each in suns]
            found.append(np.concatenate([outline, np.stack(edges, axis=-2)], axis=-2))
    made = np.stack(found)
    return np.moveaxis(made.reshape(*sizes.shape, *made.shape[1:]), 1, 3)

"""Deviation curves over a region: spots for every size of the error, and once for all what belongs to a whole curve."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.families.misalignment.blocks import AXES, ERRORS, SOURCES
from heliosweep.families.misalignment.calibration.fits import Mounts
from heliosweep.families.misalignment.curves.variables import COEFFICIENTS, size_dims, variables
from heliosweep.families.misalignment.draws import mean_errors
from heliosweep.families.misalignment.points import (
    Points,
    codes_of,
    coordinates_of,
    heliostat_count,
    instant_sizes,
    place_bytes,
    places_of,
)
from heliosweep.families.misalignment.spots import SIDES, spot_values, status_remarks
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.spots import traces
from heliosweep.kernels.spots.curves import deviation_curves
from heliosweep.kernels.spots.deviation import AZIMUTH, CANTING, ELEVATION, TILT, deviation_spots
from heliosweep.kernels.warm import warm_curves

if TYPE_CHECKING:
    from heliosweep.families.misalignment.spots_file import MeasuredSpots
    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.layout_axis import LayoutAxis
    from heliosweep.grid.regions import Region


#: Points of the outline of a spot.
OUTLINE = 36

_LABELS = ("error.source", "error.axis", "error.size")
_DETECTOR = {"long_name": "number of the line of detectors, from 0", "units": "1"}


def workload(study: MisalignmentStudy) -> Workload:
    """Sizes and cost, for the plan."""
    parameters = Parameters(study)
    heliostats, instants = heliostat_count(study), instant_sizes(study)
    lines = len(_lines(study))
    number = math.prod(instants.values())
    sizes = math.prod(parameters.sizes[dim] for dim in size_dims(study))

    def working_bytes(points: int, length: int) -> int:
        # Spots with their status as the kernel makes them, and as flags are made of them; curves, with a copy.
        curves = math.ceil(points / sizes)
        beside = 240 * (study.mount_errors is not None) + 100 * 2 * OUTLINE * (study.beam is not None)
        return length * number * (points * (2 * 3 * 8 + 3 + beside) + curves * 2 * 8 * (10 + 3 * lines)) + 24 * number

    inner = {"heliostat": heliostats, **instants, "conic_coefficient": len(COEFFICIENTS)}
    inner |= {"outline": OUTLINE, "edge": 2} if study.beam is not None else {}
    return Workload(
        parameters=parameters.sizes,
        inner=inner | ({"detector": lines} if lines else {}),
        evaluations=heliostats * number,
        unit="spots",
        splittable="heliostat",
        working_bytes=working_bytes,
        coordinate_bytes=place_bytes(study) + 8 * (2 * number + sum(instants.values())),
    )


def coordinates(study: MisalignmentStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    name = {"long_name": "coefficient of the deviation curve"}
    added: dict[str, Any] = {"conic_coefficient": ("conic_coefficient", np.array(COEFFICIENTS, dtype=object), name)}
    lines = _lines(study)
    if len(lines):
        added["detector"] = "detector", np.arange(len(lines)), _DETECTOR
        for column, key, unit in zip(lines.T, ("l0", "l1", "l2"), ("1", "1", "m"), strict=True):
            attrs = {"long_name": f"{key} of the line of detectors l0 Y + l1 Z = l2", "units": unit}
            added[key] = "detector", column, attrs
    labels = list(_LABELS)
    if study.beam is not None:
        labels.append("beam.divergence")
        turn = {"long_name": "place on the outline of a spot, as the angle about the ray", "units": "degree"}
        added["outline"] = "outline", 360.0 * np.arange(OUTLINE) / OUTLINE, turn
        side = {"long_name": "edge of a trace: of rays from the point of the sun nearest to the axis, or farthest"}
        added["edge"] = "edge", np.array(["near", "far"], dtype=object), side
    if study.mount_errors is not None:
        labels += [f"mount_errors.{name}" for name in ERRORS]
    if study.measured is not None and (spots := study.measured_spots()) is not None:
        added |= _measured(spots, heliostat_count(study))
    return coordinates_of(study, labels).assign_coords(added)


def _measured(spots: MeasuredSpots, count: int) -> dict[str, Any]:
    """Measured spots as coordinates, those of each heliostat in the order of the file."""
    order, of, number = spots.of(0, count)
    table = np.full((count, spots.most, 2), np.nan)
    table[of, number] = spots.position[order]
    dims, attrs = ("heliostat", "spot"), {side: f"measured spot, {where}" for side, where in SIDES.items()}
    return {
        f"measured_{side}": (dims, table[..., i], {"long_name": words, "units": "m"})
        for i, (side, words) in enumerate(attrs.items())
    }


def _lines(study: MisalignmentStudy) -> Floats:
    """Lines of detectors, shape (L, 3)."""
    lines = () if study.detectors is None else study.detectors.lines or ()
    return np.array(lines, np.float64).reshape(-1, 3)


def prepare(study: MisalignmentStudy) -> tuple[float, bool]:
    """Load or compile the kernels; seconds it took, and whether something was compiled."""
    return warm_curves()


inputs = places_of
remarks = status_remarks


def compute(study: MisalignmentStudy, places: LayoutAxis, region: Region) -> xr.Dataset:
    """Spots of a region along the swept dimensions and ``heliostat``, tolerances, conics and crossings of its curves.

    NaN, and flags that say so, where a shorter layout is padded.
    """
    points, stated = Points.of(study, places, region), variables(study)
    source, axis = codes_of(points.values("error.source"), SOURCES), codes_of(points.values("error.axis"), AXES)
    sizes = 1e-3 * points.values("error.size")
    lengths, alone = points.parameters.sizes, size_dims(study)
    one_size = tuple(slice(0, 1) if dim in alone else slice(None) for dim in lengths)
    numbers = np.arange(sizes.size).reshape(tuple(lengths.values()))
    first = numbers[one_size].ravel()
    stood: list[traces.Stand] = []
    stands = None
    if study.mount_errors is not None or study.beam is not None:
        each = np.broadcast_to(np.arange(first.size).reshape(numbers[one_size].shape), numbers.shape).ravel()
        once = mirrors(study, points, first)
        stood = [once[number] for number in each]
        if study.mount_errors is not None:
            stands = np.stack([mirror.rows() for mirror in stood])
    spots = deviation_spots(points.setting, source, axis, sizes, points.sun, points.pivots, stands)
    values = spot_values(points, spots)
    if study.beam is not None:
        values |= beams(points, stood, (source, axis, sizes), np.asarray(values["is_real"]))
    made = points.labelled(stated, values, outline=OUTLINE, edge=2)
    lines = _lines(study)
    curves = _of_curves(
        points.only(first), source[first], axis[first], lines, None if stands is None else stands[first]
    )
    inner = {"conic_coefficient": len(COEFFICIENTS), "detector": len(lines)}
    return xr.Dataset(made | points.labelled(stated, curves, **inner))


def _of_curves(
    points: Points, source: NDArray[np.int64], axis: NDArray[np.int64], lines: Floats, stands: Floats | None
) -> dict[str, NDArray[Any]]:
    """Variables of whole curves, shape (P, H, T, ...), from codes of the error, lines of detectors and `mirrors`."""
    curves = deviation_curves(points.setting, source, axis, points.sun, points.pivots, lines, stands)
    tolerance = 1e3 * curves.tolerance
    *coefficients, eccentricity, focus_y, focus_z = curves.conic
    made = {
        "tracking_tolerance": tolerance,
        "conic": np.stack(coefficients, axis=-1),
        "eccentricity": eccentricity,
        "focus_y": focus_y,
        "focus_z": focus_z,
        **_least(points, tolerance),
    }
    if len(lines):
        y, z, crossed = curves.crossing
        made |= {"crossing_y": y, "crossing_z": z, "crossing_error": 1e3 * crossed}
    return made


def _least(points: Points, tolerance: Floats) -> dict[str, NDArray[Any]]:
    """Least tolerance of all instants, and its day and hour: the first of several."""
    first = np.where(np.isnan(tolerance), np.inf, tolerance).argmin(axis=-1)
    least = np.take_along_axis(tolerance, first[..., np.newaxis], axis=-1)[..., 0]
    made = {"least_tolerance": np.where(np.isnan(tolerance).all(axis=-1), np.nan, least)}
    sizes, labels = points.instants.sizes, points.instants.labels
    for dim, index in zip(sizes, np.unravel_index(first, tuple(sizes.values())), strict=True):
        if dim in labels:
            label = labels[dim].to_numpy()[index]
            missing = np.datetime64("NaT", "ns") if label.dtype.kind == "M" else np.nan
            made[f"{dim}_of_least_tolerance"] = np.where(np.isfinite(made["least_tolerance"]), label, missing)
    return made


def mirrors(study: MisalignmentStudy, points: Points, some: NDArray[np.int64]) -> list[traces.Stand]:
    """How the mirrors of some points stand, of shape (H, T), at the commands of mounts without errors."""
    errors = np.zeros((len(points.setting.kind), len(ERRORS)))
    if study.mount_errors is not None:
        errors = mean_errors(points, study.mount_errors) * 1e-3
    found = []
    for point in some.tolist():
        actual = errors[point]
        mounts = Mounts.of(points, point)
        frames, towards = mounts.frames[:, np.newaxis], mounts.towards[:, np.newaxis]
        found.append(traces.stand(frames, mounts.ideal(), actual, towards, mounts.offsets))
    return found


def beams(
    points: Points,
    stands: list[traces.Stand],
    errors: tuple[NDArray[np.int64], NDArray[np.int64], Floats],
    real: NDArray[np.bool_],
) -> dict[str, NDArray[Any]]:
    """Outlines of the spots and edges of the traces of beams that open as cones, shape (P, H, T, ...).

    Of the mirrors of each point, codes of source and axis of the error and its sizes [rad], and where there is a spot.

    The edges are those of the rays that come from the points of the sun nearest to and farthest from the axis of the
    error: while the mirror turns about an axis in it each draws a conic, and the beam all that lies between.
    """
    divergence, made = points.values("beam.divergence"), np.full((*real.shape, OUTLINE + 2, 2), np.nan)
    for point, (stand, source, axis, size) in enumerate(zip(stands, *errors, strict=True)):
        half, mounts = 0.5e-3 * float(divergence[point]), Mounts.of(points, point)
        about = {ELEVATION: stand.right, AZIMUTH: -stand.up}.get(int(axis), -stand.primary)
        arm = {CANTING: 0.0 * stand.arm, TILT: stand.pole + stand.arm}.get(int(source), stand.arm)
        normal, centre = _turned(about, stand.normal, size), stand.centre - arm + _turned(about, arm, size)
        ray = traces.reflected(normal, mounts.sun)
        outline = traces.beam_outline(centre, ray, mounts.face, half, OUTLINE)
        side = about - traces.dot(about, mounts.sun)[..., np.newaxis] * mounts.sun
        with np.errstate(divide="ignore", invalid="ignore"):
            side = side / np.sqrt(traces.dot(side, side))[..., np.newaxis]
        suns = (np.cos(half) * mounts.sun + sign * np.sin(half) * side for sign in (1.0, -1.0))
        edges = [traces.spots(centre, traces.reflected(normal, sun), mounts.face) for sun in suns]
        made[point] = np.concatenate([outline, np.stack(edges, axis=-2)], axis=-2)
    made[~real] = np.nan
    names = {"outline": made[..., :OUTLINE, :], "edge": made[..., OUTLINE:, :]}
    return {f"{name}_{side}": array[..., i] for name, array in names.items() for i, side in enumerate("yz")}


def _turned(axis: Floats, vector: Floats, angle: float) -> Floats:
    """Vectors turned about unit axes. [rad]"""
    still = traces.dot(axis, vector)[..., np.newaxis] * axis
    turned: Floats = still + np.cos(angle) * (vector - still) + np.sin(angle) * np.cross(axis, vector)
    return turned

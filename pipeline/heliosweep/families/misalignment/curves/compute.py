"""Deviation curves over a region: spots for every size of the error, and once for all what belongs to a whole curve."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import AXES, SOURCES
from heliosweep.families.misalignment.curves.variables import COEFFICIENTS, size_dims, variables
from heliosweep.families.misalignment.points import (
    Points,
    codes_of,
    coordinates_of,
    heliostat_count,
    instant_sizes,
    place_bytes,
    places_of,
)
from heliosweep.families.misalignment.spots import spot_values, status_remarks
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.kernels.spots.curves import deviation_curves
from heliosweep.kernels.spots.deviation import deviation_spots
from heliosweep.kernels.warm import warm_curves

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.layout_axis import LayoutAxis
    from heliosweep.grid.regions import Region

#: Time of a spot, and of what belongs to a whole curve at one instant, on one core. [s]
SECONDS_PER_SPOT, SECONDS_PER_CURVE, SECONDS_PER_CROSSING = 40e-9, 700e-9, 500e-9
#: Overhead of a parameter point. [s]
SECONDS_PER_POINT = 20e-6

_LABELS = ("error.source", "error.axis", "error.size")
_DETECTOR = {"long_name": "number of the line of detectors, from 0", "units": "1"}


def workload(study: MisalignmentStudy) -> Workload:
    """Sizes and cost, for the plan."""
    parameters = Parameters(study)
    heliostats, instants = heliostat_count(study), instant_sizes(study)
    lines = 0 if study.detectors is None else len(study.detectors.lines)
    number = math.prod(instants.values())
    sizes = math.prod(parameters.sizes[dim] for dim in size_dims(study))
    per_curve = SECONDS_PER_CURVE + lines * SECONDS_PER_CROSSING

    def working_bytes(points: int, length: int) -> int:
        # Spots with their status as the kernel makes them, and as flags are made of them; curves, with a copy.
        curves = math.ceil(points / sizes)
        return length * number * (points * (2 * 3 * 8 + 3) + curves * 2 * 8 * (10 + 3 * lines)) + 24 * number

    inner = {"heliostat": heliostats, **instants, "conic_coefficient": len(COEFFICIENTS)}
    return Workload(
        parameters=parameters.sizes,
        inner=inner | ({"detector": lines} if lines else {}),
        evaluations=heliostats * number,
        unit="spots",
        seconds=SECONDS_PER_SPOT + per_curve / sizes,
        splittable="heliostat",
        working_bytes=working_bytes,
        seconds_per_point=SECONDS_PER_POINT,
        coordinate_bytes=place_bytes(study) + 8 * (2 * number + sum(instants.values())),
    )


def coordinates(study: MisalignmentStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    name = {"long_name": "coefficient of the deviation curve"}
    added: dict[str, Any] = {"conic_coefficient": ("conic_coefficient", np.array(COEFFICIENTS, dtype=object), name)}
    if study.detectors is not None:
        lines = np.array(study.detectors.lines, np.float64)
        added["detector"] = "detector", np.arange(len(lines)), _DETECTOR
        for column, key, unit in zip(lines.T, ("l0", "l1", "l2"), ("1", "1", "m"), strict=True):
            attrs = {"long_name": f"{key} of the line of detectors l0 Y + l1 Z = l2", "units": unit}
            added[key] = "detector", column, attrs
    return coordinates_of(study, _LABELS).assign_coords(added)


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
    spots = deviation_spots(points.setting, source, axis, sizes, points.sun, points.pivots)
    made = points.labelled(stated, spot_values(points, spots))
    lengths, alone = points.parameters.sizes, size_dims(study)
    one_size = tuple(slice(0, 1) if dim in alone else slice(None) for dim in lengths)
    first = np.arange(sizes.size).reshape(tuple(lengths.values()))[one_size].ravel()
    lines = np.empty((0, 3)) if study.detectors is None else np.array(study.detectors.lines, np.float64)
    curves = _of_curves(points.only(first), source[first], axis[first], lines)
    inner = {"conic_coefficient": len(COEFFICIENTS), "detector": len(lines)}
    return xr.Dataset(made | points.labelled(stated, curves, **inner))


def _of_curves(
    points: Points, source: NDArray[np.int64], axis: NDArray[np.int64], lines: NDArray[np.float64]
) -> dict[str, NDArray[Any]]:
    """Variables of whole curves, shape (P, H, T, ...), from codes of the error and lines of detectors."""
    curves = deviation_curves(points.setting, source, axis, points.sun, points.pivots, lines)
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


def _least(points: Points, tolerance: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
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

"""Spots of mounts with errors over a region, and statistics over draws of the errors.

Draws are never stored: those of a few heliostats are made at a time, shared among all instants and parameters, and only
what the kernel sums up is kept.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.config.distribution import NORMAL, Distribution
from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.draws import drawn_errors, mean_errors
from heliosweep.families.misalignment.mount_errors.variables import TOLERANCE_AXES, errors_block, is_drawn, variables
from heliosweep.families.misalignment.points import (
    Points,
    coordinates_of,
    heliostat_count,
    instant_sizes,
    place_bytes,
    places_of,
)
from heliosweep.families.misalignment.spots import NO_HELIOSTAT, spot_values, status_remarks
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.kernels.spots.mount_spots import mount_spots
from heliosweep.kernels.spots.statistics import spot_statistics
from heliosweep.kernels.warm import warm_mount_errors

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.blocks import MountErrors
    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.layout_axis import LayoutAxis
    from heliosweep.grid.regions import Region

#: Draws that are held at a time, and what the kernel holds of one draw of one heliostat. [bytes]
DRAWS_BYTES, KERNEL_BYTES = 8 * 2**20, 640
#: Percentiles of the remaining tolerance where the study names none.
PERCENTILES = (5.0, 50.0, 95.0)

#: Variables that the kernel makes, by their names there.
_MOMENTS = {
    "mean_y": "spot_y_mean",
    "mean_z": "spot_z_mean",
    "variance_y": "spot_y_variance",
    "variance_z": "spot_z_variance",
    "covariance": "spot_yz_covariance",
    "hit_fraction": "hit_fraction",
    "real_fraction": "real_fraction",
}
#: What the tracking knows of the errors, shape (1, 1, 6): nothing.
_UNKNOWN = np.zeros((1, 1, len(ERRORS)))


def workload(study: MisalignmentStudy) -> Workload:
    """Sizes and cost, for the plan."""
    parameters, block = Parameters(study), errors_block(study)
    samples, instants = block.draws(), instant_sizes(study)
    count, heliostats = math.prod(instants.values()), heliostat_count(study)
    inner = {"heliostat": heliostats, **instants}
    if samples:
        inner |= {"percentile": len(_percentiles(study)), "tolerance_axis": len(TOLERANCE_AXES)}
    stored = 8 * (len(_MOMENTS) + 2 + len(TOLERANCE_AXES) * inner["percentile"] if samples else 6)

    def working_bytes(points: int, length: int) -> int:
        held = min(length, _at_a_time(samples)) if samples else 0
        # Deviates, scaled ones, errors and the kernel's copy of them; the results are copied once.
        return held * samples * 8 * 4 * len(ERRORS) + samples * KERNEL_BYTES + 2 * points * length * count * stored

    return Workload(
        parameters=parameters.sizes,
        inner=inner,
        evaluations=heliostats * count * max(samples, 1),
        unit="spots",
        splittable="heliostat",
        working_bytes=working_bytes,
        coordinate_bytes=place_bytes(study) + 16 * count,
        axes={"samples": samples} if samples else {},
    )


def coordinates(study: MisalignmentStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory; of drawn errors the distributions in words, as an attribute."""
    block = errors_block(study)
    fixed = [name for name, error in zip(ERRORS, block.errors(), strict=True) if not isinstance(error, Distribution)]
    drawn = is_drawn(study)
    labels = coordinates_of(study, [f"mount_errors.{name}" for name in (*fixed, *(["scale"] if drawn else []))])
    if not drawn:
        return labels
    percentile = {"long_name": "percentile over the draws", "units": "1"}
    axis = {"long_name": "in-mirror axis about which the mirror turns"}
    return labels.assign_coords(
        percentile=("percentile", _percentiles(study), percentile),
        tolerance_axis=("tolerance_axis", np.array(TOLERANCE_AXES, dtype=object), axis),
    ).assign_attrs(mount_errors=_described(block))


def prepare(study: MisalignmentStudy) -> tuple[float, bool]:
    """Load or compile the kernels; seconds it took, and whether something was compiled."""
    return warm_mount_errors(is_drawn(study))


inputs = places_of


def compute(study: MisalignmentStudy, places: LayoutAxis, region: Region) -> xr.Dataset:
    """Spots of a region along the swept dimensions and ``heliostat`` or, where an error is drawn, their statistics.

    NaN, and a status that says so, where a shorter layout is padded.
    """
    points, block = Points.of(study, places, region), errors_block(study)
    if is_drawn(study):
        percentiles = _percentiles(study)
        made = _statistics(points, block, percentiles)
        inner = {"percentile": percentiles.size, "tolerance_axis": len(TOLERANCE_AXES)}
        return xr.Dataset(points.labelled(variables(study), made, **inner))
    actual = mean_errors(points, block)[:, np.newaxis] * 1e-3
    spots = mount_spots(points.setting, actual, _UNKNOWN, points.sun, points.pivots)
    return xr.Dataset(points.labelled(variables(study), spot_values(points, spots)))


def finish(study: MisalignmentStudy, places: LayoutAxis, region: Region, computed: xr.Dataset) -> xr.Dataset:
    """Mean of the hit fractions of drawn errors over the heliostats."""
    hits = computed["hit_fraction"]
    over = [dim for dim in hits.dims if dim != "heliostat"]
    return xr.Dataset({"field_hit_fraction": (over, _mean(hits.transpose(*over, "heliostat").to_numpy()))})


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Remarks on a finished result: numbers of spots and statistics that are missing, and why."""
    yield from status_remarks(result)
    if "real_fraction" in result:
        real = result["real_fraction"].to_numpy()
        some, none = int(np.count_nonzero((real > 0) & (real < 1))), int(np.count_nonzero(real == 0))
        if some:
            yield f"{some:,} of {real.size:,} statistics leave out draws whose ray does not reach the receiver's plane"
        if none:
            yield f"{none:,} of {real.size:,} statistics are missing: no draw's ray reaches the receiver's plane"


def _statistics(points: Points, block: MountErrors, percentiles: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
    """Statistics over the draws, shape (P, H, T, ...), and the mean hit fraction of each day."""
    samples = block.draws()
    shape = (*points.absent.shape, points.instants.count)
    made = {name: np.full(shape, np.nan) for name in _MOMENTS.values()}
    made["spot_status"] = np.full(shape, NO_HELIOSTAT, np.int8)
    made["remaining_tolerance"] = np.full((*shape, percentiles.size, len(TOLERANCE_AXES)), np.nan)
    step = _at_a_time(samples)
    for start in range(0, points.numbers.size, step):
        part = slice(start, start + step)
        for point, drawn in enumerate(drawn_errors(points, block, samples, part)):
            actual = drawn * 1e-3
            here = points.only(np.array([point]))
            found = spot_statistics(
                here.setting, actual[np.newaxis], _UNKNOWN, here.sun, here.pivots[:, part], percentiles
            )
            there = ~points.absent[point, part]
            for name, target in _MOMENTS.items():
                made[target][point, part][there] = found[name][0][there]
            made["spot_status"][point, part][there] = found["status"][0][there]
            made["remaining_tolerance"][point, part][there] = found["tolerance"][0][there] * 1e3
    _, hours = points.instants.sizes.values()
    return made | {"day_hit_fraction": _mean(made["hit_fraction"].reshape(*shape[:2], -1, hours))}


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of the values that are there along the last dimension; NaN of none."""
    known = ~np.isnan(values)
    count = np.count_nonzero(known, axis=-1)
    # Added one after the other: padding at the end must not change the order of the sum.
    total = np.cumsum(np.where(known, values, 0.0), axis=-1)[..., -1]
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _at_a_time(samples: int) -> int:
    """Heliostats whose draws are held at a time."""
    return max(1, DRAWS_BYTES // (samples * 8 * len(ERRORS)))


def _percentiles(study: MisalignmentStudy) -> NDArray[np.float64]:
    return np.array(PERCENTILES if study.statistics is None else study.statistics.percentiles.values(), np.float64)


def _described(block: MountErrors) -> str:
    """The distributions in words."""
    parts = []
    for name, error in block.drawn().items():
        first, second = error.parts
        values = (
            f"mean {first:g}, standard deviation {second:g}" if error.kind == NORMAL else f"{first:g} to {second:g}"
        )
        seed = "" if error.seed is None else f", seed {error.seed}"
        parts.append(f"{name} {error.kind} ({values} mrad{seed})")
    drawn = f"{block.draws()} draws of Philox 4x64, seed {block.seed or 0}, keyed by error and heliostat"
    return f"{'; '.join(parts)}; {drawn}"

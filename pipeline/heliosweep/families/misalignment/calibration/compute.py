"""Errors of the mounts from spots over a region, with the commands that correct them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.families.misalignment import estimates
from heliosweep.families.misalignment.blocks import CONDITION_LIMITS, LOSSES
from heliosweep.families.misalignment.calibration import fits
from heliosweep.families.misalignment.calibration.variables import (
    DISAGREE,
    DOUBTFUL,
    DOUBTFUL_APERTURES,
    DOUBTFUL_ERROR,
    EARLIER,
    KNOWN,
    LARGEST_DEVIATION,
    LATER,
    MIRRORED,
    READINGS,
    calibration_block,
    draw_count,
    variables,
)
from heliosweep.families.misalignment.draws import NOISE_STREAMS, drawn_errors, noise_of_draws
from heliosweep.families.misalignment.estimates import Inputs, inputs, prepare
from heliosweep.families.misalignment.points import Points, codes_of, coordinates_of, instant_sizes

if TYPE_CHECKING:
    from heliosweep.families.misalignment.spots_file import MeasuredSpots
    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.plan import Workload
    from heliosweep.grid.regions import Region

#: Working memory of a spot. [bytes]
BYTES_PER_SPOT = 200

__all__ = ["inputs", "prepare"]


def workload(study: MisalignmentStudy) -> Workload:
    """Sizes and cost, for the plan."""
    draws, measured, stated = draw_count(study), study.measured_spots(), variables(study)
    spots = math.prod(instant_sizes(study).values()) + (0 if measured is None else measured.most)
    inner, each = estimates.sizes_of(measured, draws), max(1, draws) * spots
    return estimates.workload_of(study, stated, inner, each, "spots", BYTES_PER_SPOT)


def coordinates(study: MisalignmentStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    keys, measured = [f"calibration.{key}" for key in ("parameters", "loss", "loss_scale")], study.measured_spots()
    if measured is None:
        keys += ["calibration.noise", "calibration.days_used", *estimates.error_keys(study)]
    found = coordinates_of(study, keys).assign_coords(estimates.labels_of(measured, draw_count(study), "spot"))
    return found.assign_attrs(spots="synthetic" if measured is None else "measured")


def compute(study: MisalignmentStudy, inputs: Inputs, region: Region) -> xr.Dataset:
    """Estimated errors and commands of a region along the swept dimensions and ``heliostat``.

    NaN, and a status that says so, where a shorter layout is padded.
    """
    points, measured = Points.of(study, inputs.places, region), inputs.measured
    found = _synthetic(study, points) if measured is None else _measured(study, points, measured)
    return estimates.gathered(points, variables(study), found, estimates.sizes_of(measured, draw_count(study)))


def _synthetic(study: MisalignmentStudy, points: Points) -> Iterator[tuple[fits.Mounts, fits.Found]]:
    """Calibration from synthetic spots at each point."""
    block, samples = study.mount_errors, max(1, draw_count(study))
    assert block is not None
    noise, (days, hours) = points.values("calibration.noise"), points.instants.sizes.values()
    used = hours * np.full(len(noise), days)
    if points.parameters.has("calibration.days_used"):
        used = hours * points.values("calibration.days_used").astype(int)
    noises, numbers, count = None, points.numbers, points.instants.count
    if np.any(noise > 0):
        sides = (noise_of_draws(block.seed or 0, stream, numbers, samples, count) for stream in NOISE_STREAMS)
        noises = np.stack(list(sides), axis=-1)
    drawn = drawn_errors(points, block, samples)
    for point, (options, errors) in enumerate(zip(_options(study, points), drawn, strict=True)):
        mounts = fits.Mounts.of(points, point)
        added = 0.0 if noises is None else noise[point] * noises[:, :, : used[point]]
        yield mounts, fits.from_synthetic(mounts, errors, added, int(used[point]), **options)


def _measured(
    study: MisalignmentStudy, points: Points, measured: MeasuredSpots
) -> Iterator[tuple[fits.Mounts, fits.Found]]:
    """Calibration from measured spots at each point."""
    for point, options in enumerate(_options(study, points)):
        mounts = fits.Mounts.of(points, point)
        yield mounts, fits.from_measured(mounts, points.numbers, measured, **options)


def _options(study: MisalignmentStudy, points: Points) -> Iterator[dict[str, Any]]:
    """Options of the kernel at each point."""
    limit = calibration_block(study).condition_limit
    losses = codes_of(points.values("calibration.loss"), LOSSES)
    scales, counts = points.values("calibration.loss_scale"), points.values("calibration.parameters")
    for count, loss, scale in zip(counts, losses, scales, strict=True):
        yield {
            "parameters": int(count),
            "loss": int(loss),
            "loss_scale": float(scale),
            "condition_limit": CONDITION_LIMITS[int(count)] if limit is None else limit,
        }


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Remarks on a finished result: numbers of calibrations that the spots do not allow, and of missing commands."""
    yield from estimates.estimate_remarks(result, "spots")
    status = result["calibration_status"].to_numpy()
    if np.any(status == DOUBTFUL):
        doubted = (status == DOUBTFUL).any(axis=tuple(range(status.ndim - 1)))
        names = next(result[key].to_numpy() for key in ("name", "id", "heliostat") if key in result.coords)
        listed = ", ".join(map(str, names[doubted][:6])) + ", ..." * int(names[doubted].size > 6)
        yield (
            f"heliostat {listed}: the calibration is doubtful. An error is beyond {DOUBTFUL_ERROR:g} mrad, or a spot "
            f"lies more than {DOUBTFUL_APERTURES:g} apertures from where a mount without errors sends it: are the "
            f"spots in metres, are suns, commanded angles and heliostats right? (calibration_status {DOUBTFUL})"
        )
    yield from _spot_remarks(result)
    if count := int(result["instants_without_command"].sum()):
        instants = result["nominal_azimuth"].size // math.prod(result["nominal_azimuth"].shape[:-2])
        all_instants = int(np.isin(status, KNOWN).sum()) * instants
        yield (
            f"at {count:,} of {all_instants:,} instants of calibrated heliostats no command brings the beam to the aim "
            "point, though the sun is up: they are in the mount's blind cone, or the offsets of the mirror are not "
            "smaller than the distance (instants_without_command)"
        )


def _spot_remarks(result: xr.Dataset) -> Iterator[str]:
    """Remarks on measured spots: readings of the table that fit much better, and spots that disagree."""
    if "better_reading" not in result:
        return
    dims = [dim for dim in result["better_reading"].dims if dim != "heliostat"]
    point = result.isel(dict.fromkeys(dims, 0))
    reading, known = point["better_reading"].to_numpy(), np.isin(point["calibration_status"], KNOWN)
    for code in _ADVICE:
        if (count := np.count_nonzero(reading == code)) > known.sum() / 2:
            words = READINGS[code].replace("_", " ")
            fitted = f"the spots of {count:,} of {known.sum():,} heliostats"
            yield f"{fitted} fit much better {words}: {_ADVICE[code]} (better_reading)"
    names = next(point[key].to_numpy() for key in ("name", "id", "heliostat") if key in point.coords)
    deviation, time = point["spot_deviation"].to_numpy(), point["spot_time"].to_numpy()
    residual = np.hypot(point["residual_y"].to_numpy(), point["residual_z"].to_numpy())
    rows, spots = np.nonzero(deviation > LARGEST_DEVIATION)
    if not rows.size:
        return
    worst = np.argsort(-deviation[rows, spots], kind="stable")[:_LISTED]
    listed = [
        f"{names[row]} {f'spot {spot}' if np.isnat(time[row, spot]) else f'{time[row, spot]:.16}Z'} "
        f"({residual[row, spot]:.2g} m)".replace("T", " ")
        for row, spot in zip(rows[worst], spots[worst], strict=True)
    ]
    yield (
        f"{rows.size:,} spots of {len(set(rows.tolist())):,} heliostats are more than {LARGEST_DEVIATION:g} robust "
        f"standard deviations from the others' prediction: {', '.join(listed)}{', ...' * (rows.size > _LISTED)}. Check "
        f"them, give them the weight 0 or set 'calibration.loss: huber' (spot_deviation, calibration_status {DISAGREE})"
    )


#: Number of spots that a remark lists.
_LISTED = 6
#: Remedy if the spots fit much better in another reading.
_ADVICE = {
    MIRRORED: "y is positive to the right for someone in the field who looks at the receiver, z upwards",
    EARLIER: "check the offset from universal time, and summer time",
    LATER: "check the offset from universal time, and summer time",
}

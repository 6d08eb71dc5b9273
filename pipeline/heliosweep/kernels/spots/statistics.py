"""Statistics of spots over samples of mount errors, without the spots ever being stored.

For every heliostat and instant: mean, variances and covariance of the spots that reach the plane of the receiver, the
parts of the samples that do and that lie in the aperture, and percentiles of the tolerance that remains: how far the
mirror may still turn about its elevation or its azimuth axis, the mirror centre at rest, before the spot leaves the
aperture. Sums are taken in two passes and in an order that depends on the number of samples alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.aiming import AIM_ROWS, KNOWN, STATE_ROWS, WORK_ROWS, aim_lanes, aim_rows
from heliosweep.kernels.spots.curves import canting_cotangent
from heliosweep.kernels.spots.mount_spots import (
    FRAMES,
    ROOM_ROWS,
    SAMPLE,
    SPOT_ROWS,
    actual_lanes,
    checked,
    known_lanes,
    spot_lanes,
    sun_rows,
)
from heliosweep.kernels.spots.receiver import (
    BEHIND_FACE,
    NO_SUN,
    REACHES,
    Face,
    Setting,
    compiled_setting,
    face_vectors,
)
from heliosweep.kernels.vectors import PACKET, Vector, cross, dot, whole


def ranks_of(percentiles: ArrayLike, count: int) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Places of percentiles, 0 to 100, among `count` values in rising order.

    Returns the rank of the value below each percentile, how far each lies from it towards the next, and all ranks that
    are needed, rising. Raises ValueError if a percentile is none.
    """
    wanted = np.array(percentiles, np.float64).ravel()
    if not np.all((wanted >= 0.0) & (wanted <= 100.0)):
        raise ValueError("percentiles lie between 0 and 100")
    place = wanted / 100.0 * (count - 1)
    lower = np.floor(place).astype(np.int64)
    return lower, place - lower, np.unique(np.concatenate((lower, np.minimum(lower + 1, count - 1))))


@kernel
def percentiles_of(
    keys: Floats,
    lower: NDArray[np.int64],
    part: Floats,
    ranks: NDArray[np.int64],
    bounds: NDArray[np.int64],
    angles: Floats,
) -> None:
    """Write percentiles of angles, interpolated as `numpy.percentile` does; infinite ones are values like all others.

    `keys`, shape (K,), is -cot of each angle, infinity for an infinite one, -infinity for zero, and is put into another
    order; `lower`, `part` and `ranks` are from `ranks_of`; `bounds`, shape (64, 4), is room; `angles` [rad] is written.
    """
    last = len(keys) - 1
    # Put the middle rank into its place, then those below it and those above it, each between what stands already.
    depth = 1
    bounds[0, 0], bounds[0, 1], bounds[0, 2], bounds[0, 3] = 0, len(ranks), 0, len(keys)
    while depth > 0:
        depth -= 1
        low, high, first, stop = bounds[depth, 0], bounds[depth, 1], bounds[depth, 2], bounds[depth, 3]
        if low >= high:
            continue
        middle = (low + high) // 2
        _select(keys, first, stop, ranks[middle])
        bounds[depth, 0], bounds[depth, 1], bounds[depth, 2], bounds[depth, 3] = low, middle, first, ranks[middle]
        depth += 1
        after = ranks[middle] + 1
        bounds[depth, 0], bounds[depth, 1], bounds[depth, 2], bounds[depth, 3] = middle + 1, high, after, stop
        depth += 1
    for q in range(len(lower)):
        one, two = _angle(keys[lower[q]]), _angle(keys[min(lower[q] + 1, last)])
        # As numpy.percentile does, but for infinities.
        step = two - one
        if part[q] == 0.0 or one == two:
            angles[q] = one
        elif part[q] < 0.5:
            angles[q] = one + step * part[q]
        else:
            angles[q] = two - step * (1.0 - part[q])


@inline
def _angle(key):
    """Angle whose cotangent is -key."""
    return math.atan2(1.0, -key) if key < math.inf else math.inf


@kernel
def _select(values: Floats, first: int, stop: int, rank: int) -> None:
    """Put the value of a rank into its place, nothing greater before it and nothing less behind it."""
    while stop - first > 1:
        one, two, three = values[first], values[(first + stop) // 2], values[stop - 1]
        pivot = max(min(one, two), min(max(one, two), three))
        # No branch hangs on a value: what is less moves to the front, then what is equal.
        front = first
        for k in range(first, stop):
            value = values[k]
            values[k], values[front] = values[front], value
            front += 1 if value < pivot else 0
        if rank < front:
            stop = front
            continue
        first = front
        for k in range(first, stop):
            value = values[k]
            values[k], values[front] = values[front], value
            front += 1 if value <= pivot else 0
        if rank < front:
            return
        first = front


MOMENTS = ("mean_y", "mean_z", "variance_y", "variance_z", "covariance", "real_fraction", "hit_fraction", "status")

_ALONG = 1e-12
"""Sine of the angle between normal and primary axis below which there is no elevation axis."""


def spot_statistics(
    setting: Setting,
    actual: ArrayLike,
    known: ArrayLike,
    sun: ArrayLike,
    pivots: ArrayLike,
    percentiles: ArrayLike = (5.0, 50.0, 95.0),
) -> dict[str, Floats]:
    """Statistics of the spots that `mount_spots` makes, over samples of the errors.

    Parameters
    ----------
    setting, known, sun, pivots
        As in `mount_spots.mount_spots`.
    actual : array_like, shape (P or 1, H or 1, K, 6)
        K samples of the errors, at least one. [rad]
    percentiles : array_like, shape (Q,)
        Percentiles of the remaining tolerance, 0 to 100. [%]

    Returns
    -------
    dict of ndarray, shape (P, H, T)
        ``mean_y``, ``mean_z`` [m], ``variance_y``, ``variance_z``, ``covariance`` [m^2] of the spots that reach the
        plane, with n - 1 in the denominator; NaN for too few of them.
        ``real_fraction``, ``hit_fraction``: parts of the samples whose spot reaches the plane, and lies in the aperture
        (edges included); NaN with the sun at or below the horizon. [1]
        ``status``: of the aiming, `receiver.REACHES`, `NO_SUN`, `BLIND_CONE` or `TOO_NEAR`; `BEHIND_FACE` where the
        pivot is on the plane of the receiver or behind it.
        ``tolerance``, shape (P, H, T, Q, 2): percentiles over all samples of the tolerance that remains about the
        elevation axis, unit(n x z), and about the azimuth axis of the mirror, as `numpy.percentile` interpolates them:
        0 where the spot is not in the aperture, infinity where it does not leave it, NaN with the sun at or below the
        horizon. [rad]

    Raises
    ------
    ValueError
        If shapes do not agree, there is no sample, or a percentile is none.
    """
    samples, corrected, suns, places = checked(len(setting.kind), actual, known, sun, pivots)
    count = samples.shape[2]
    if count == 0:
        raise ValueError("statistics of no sample")
    ranks = ranks_of(percentiles, count)
    shape = (len(setting.kind), places.shape[1], suns.shape[2])
    moments, tolerance = np.empty((len(MOMENTS), *shape)), np.empty((*shape, len(ranks[0]), 2))
    if moments.size:
        fill_statistics(compiled_setting(setting), samples, corrected, suns, places, *ranks, moments, tolerance)
    return dict(zip(MOMENTS, moments, strict=True)) | {"tolerance": tolerance}


@kernel
def fill_statistics(
    setting: Setting,
    actual: Floats,
    known: Floats,
    sun: Floats,
    pivots: Floats,
    lower: NDArray[np.int64],
    part: Floats,
    ranks: NDArray[np.int64],
    moments: Floats,
    tolerance: Floats,
) -> None:
    """Statistics of all parameter combinations; percentiles by `ranks_of`."""
    heliostats, instants, samples = moments.shape[2], moments.shape[3], actual.shape[2]
    blocks = whole(samples, PACKET) // PACKET
    room, mount, table = np.empty(ROOM_ROWS * PACKET), np.empty(KNOWN * PACKET), np.empty((blocks, SAMPLE * PACKET))
    rows, state, work = np.empty(AIM_ROWS * PACKET), np.empty(STATE_ROWS * PACKET), np.empty(WORK_ROWS * PACKET)
    suns, one_sun, one_state = np.empty(3 * PACKET), np.empty(3 * PACKET), np.empty(STATE_ROWS * PACKET)
    out, spots, keys = np.empty(SPOT_ROWS * PACKET), np.empty((blocks, 2 * PACKET)), np.empty((2, blocks * PACKET))
    sums, bounds = np.empty(4 * PACKET), np.empty((64, 4), np.int64)
    for p in range(moments.shape[1]):
        errors, corrections = actual[min(p, len(actual) - 1)].reshape(-1), known[min(p, len(known) - 1)].reshape(-1)
        light, places = sun[min(p, len(sun) - 1)], pivots[min(p, len(pivots) - 1)]
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        offset, axis_offset, pedestal = setting.mirror_offset[p], setting.axis_offset[p], setting.pedestal_height[p]
        width, height = setting.half_width[p], setting.half_height[p]
        for h in range(heliostats):
            # All lanes are of one heliostat, and samples of its errors.
            apart = 6 if known.shape[1] > 1 else 0
            known_lanes(setting, p, places, h, 1, PACKET, corrections, apart, room, mount)
            first = min(h, actual.shape[1] - 1) * samples * 6
            for b in range(blocks):
                lanes = min(PACKET, samples - b * PACKET)
                actual_lanes(errors, first + b * PACKET * 6, 6, lanes, face, pedestal, room, table[b])
            level = room[FRAMES], room[FRAMES + PACKET], room[FRAMES + 2 * PACKET]
            primary = room[FRAMES + 6 * PACKET], room[FRAMES + 7 * PACKET], room[FRAMES + 8 * PACKET]
            for start in range(0, instants, PACKET):
                count = min(PACKET, instants - start)
                sun_rows(light, start, count, suns)
                full = whole(count)
                aim_rows(mount, suns, 0, full, rows, 0, PACKET)
                aim_lanes(rows, state, work, offset, axis_offset, full)
                for k in range(count):
                    t = start + k
                    status = state[4 * PACKET + k]
                    status = BEHIND_FACE if (status == REACHES and not table[0, 20 * PACKET] > 0.0) else status
                    if status != REACHES:
                        _nothing(moments[:, p, h, t], tolerance[p, h, t], status)
                        continue
                    for m in range(STATE_ROWS):
                        one_state[m * PACKET : (m + 1) * PACKET] = state[m * PACKET + k]
                    for m in range(3):
                        one_sun[m * PACKET : (m + 1) * PACKET] = suns[m * PACKET + k]
                    for b in range(blocks):
                        lanes = min(PACKET, samples - b * PACKET)
                        full = whole(lanes)
                        spot_lanes(table[b], one_state, one_sun, face, offset, axis_offset, out, full)
                        spots[b] = out[: 2 * PACKET]
                        for m in range(2):
                            spots[b, m * PACKET + lanes : (m + 1) * PACKET] = math.nan
                        if len(lower) > 0:
                            turns = keys[0, b * PACKET :], keys[1, b * PACKET :]
                            _turns(out, one_sun, level, primary, face, width, height, *turns, full)
                    _moments(spots, samples, width, height, sums, moments[:, p, h, t])
                    moments[7, p, h, t] = status
                    for axis in range(2):
                        percentiles_of(keys[axis, :samples], lower, part, ranks, bounds, tolerance[p, h, t, :, axis])


@kernel
def _nothing(moments: Floats, tolerance: Floats, status: float) -> None:
    """Statistics of a mount that cannot aim, or stands behind the plane."""
    moments[:] = math.nan
    moments[5] = moments[6] = math.nan if status == NO_SUN else 0.0
    moments[7] = status
    tolerance[:] = math.nan if status == NO_SUN else 0.0


@kernel
def _turns(
    out: Floats,
    sun: Floats,
    level: Vector,
    primary: Vector,
    face: Face,
    width: float,
    height: float,
    elevation: Floats,
    azimuth: Floats,
    lanes: int,
) -> None:
    """Write -cot of the remaining tolerance about the elevation and the azimuth axis, which rises with it.

    Infinity where the spot does not leave the aperture, -infinity where it is not in it. `level` and `primary` are the
    axes x and z of the mount's frame.
    """
    for k in range(lanes):
        s = (sun[k], sun[PACKET + k], sun[2 * PACKET + k])
        p = (out[3 * PACKET + k], out[4 * PACKET + k], out[5 * PACKET + k])
        n = (out[6 * PACKET + k], out[7 * PACKET + k], out[8 * PACKET + k])
        e = cross(n, primary)
        sine = np.sqrt(dot(e, e))
        defined = sine > _ALONG
        scale = 1.0 / sine if defined else 0.0
        e = (
            e[0] * scale if defined else level[0],
            e[1] * scale if defined else level[1],
            e[2] * scale if defined else level[2],
        )
        inside = abs(out[k]) <= width and abs(out[PACKET + k]) <= height
        cotangent = canting_cotangent(s, n, e, p, face, width, height)
        elevation[k] = -cotangent if inside else -math.inf
        cotangent = canting_cotangent(s, n, cross(e, n), p, face, width, height)
        azimuth[k] = -cotangent if inside else -math.inf


@kernel
def _moments(spots: Floats, samples: int, width: float, height: float, sums: Floats, moments: Floats) -> None:
    """Mean, variance and covariance of the spots that are not NaN, and fractions; in the order of `MOMENTS`."""
    sums[:] = 0.0
    for b in range(len(spots)):
        for k in range(PACKET):
            y, z = spots[b, k], spots[b, PACKET + k]
            real = y == y
            sums[k] += 1.0 if real else 0.0
            sums[PACKET + k] += 1.0 if abs(y) <= width and abs(z) <= height else 0.0
            sums[2 * PACKET + k] += y if real else 0.0
            sums[3 * PACKET + k] += z if real else 0.0
    count = _sum(sums, 0)
    mean_y = _sum(sums, 2) / count if count > 0.0 else math.nan
    mean_z = _sum(sums, 3) / count if count > 0.0 else math.nan
    moments[0], moments[1] = mean_y, mean_z
    moments[5], moments[6] = count / samples, _sum(sums, 1) / samples
    sums[:] = 0.0
    for b in range(len(spots)):
        for k in range(PACKET):
            y, z = spots[b, k] - mean_y, spots[b, PACKET + k] - mean_z
            real = y == y
            sums[k] += y * y if real else 0.0
            sums[PACKET + k] += z * z if real else 0.0
            sums[2 * PACKET + k] += y * z if real else 0.0
    for m in range(3):
        moments[2 + m] = _sum(sums, m) / (count - 1.0) if count > 1.0 else math.nan


@inline
def _sum(sums, row):
    """Sum of a row of lanes, in their order."""
    total = 0.0
    for k in range(row * PACKET, (row + 1) * PACKET):
        total += sums[k]
    return total

"""Pointing error of a dish on tilted axes: means, maxima and clipped means over windows of time.

Vectors are x west, y south, z up. The mount leans by `tilt` about the horizontal unit vector u = (cos direction,
-sin direction, 0): the foot of its azimuth axis moves towards `direction`.

Two models: `RIGID`, where the whole mount leans and the controller does not know; `UNTILTED_HOME_AXES`, where the
azimuth axis leans alone while the home positions of the elevation axis and the focal axis do not (Liu, Peng and Yan
2022 [1]_). Both have closed forms, used where the lean is the only error; else the chain of axes itself is computed:
the focal axis is turned about the elevation axis by the elevation of the sun, then about the azimuth axis by psi.

Windows are packed side by side, so that many are summed at once. Every number has the same bits whatever else is
computed with it: a window is a lane, lanes never meet, each is summed in the order of time, and every choice of a
method depends on the one parameter combination alone.

References
----------
.. [1] Y. Liu, Y. Peng and J. Yan, "Effect of the azimuth axis tilt error on the tracking performance of a solar dish
   concentrator system", Energies 15 (2022) 3261, doi 10.3390/en15093261
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel

LANES = 64
"""Windows side by side at most; no number depends on it."""
STRIDE = 4
"""Instants in a step: they are added to each other before a running sum is touched."""
ROWS = 6
"""Numbers kept of an instant: the unit vector to the sun, the cosine and the sine of psi, and the weight.

psi is the turn of a mount that follows the sun, from due east through south; 0 for a sun in the zenith.
"""
WEST, SOUTH, UP, COSINE, SINE, WEIGHT = range(ROWS)

RIGID = 0
"""The whole mount leans."""
UNTILTED_HOME_AXES = 1
"""The azimuth axis leans; the home positions of the other axes do not."""

SMALL = 0.12
"""Largest sine for the series of the arcsine: cut after x^15, it is short by 2e-17."""


class Windows(NamedTuple):
    """Sun vectors of all windows, packed once for any number of parameters by `pack_windows`.

    Window w is lane w % lanes of group w // lanes. Windows with fewer instants than others of their group repeat their
    last one with weight zero.
    """

    rows: Floats
    """Rows of `pack_windows`, shape (steps, ROWS, STRIDE, lanes)."""
    first: NDArray[np.int64]
    """First step of each group and the end of the last one, shape (groups + 1,)."""
    total: Floats
    """Sum of the weights of each window, NaN where nothing counts, shape (groups, lanes)."""
    number: int
    """Number of windows; the lanes of the last group beyond it hold nothing."""


def pack_windows(sun: ArrayLike, starts: ArrayLike, weights: ArrayLike | None = None) -> Windows:
    """Pack the instants of all windows for `window_errors`.

    `sun` are unit vectors to the sun: east, north, up, shape (T, 3). [1] Window w holds the instants starts[w] to
    starts[w + 1] - 1. `weights`, shape (T,), are 1 by default [1]; instants of weight zero do not count, whatever their
    vectors. Raises ValueError where the windows are no part of the instants, or a weight is negative or not finite.
    """
    vectors = np.ascontiguousarray(sun, np.float64)
    bounds = np.ascontiguousarray(starts, np.int64)
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise ValueError(f"sun vectors of shape {vectors.shape}, expected (T, 3)")
    instants = len(vectors)
    factors = np.ones(instants) if weights is None else np.ascontiguousarray(weights, np.float64)
    if factors.shape != (instants,) or not np.all((factors >= 0.0) & (factors < np.inf)):
        raise ValueError("weights must be finite, not negative, and one for each instant")
    if bounds.ndim != 1 or len(bounds) == 0 or bounds[0] < 0 or bounds[-1] > instants or np.any(np.diff(bounds) < 0):
        raise ValueError(f"windows must be rising positions among {instants} instants")
    number = len(bounds) - 1
    # whole vectors of eight, but for two or three windows, where most of the vector would be empty
    lanes = max(1, number) if number < 4 else min(LANES, -(-number // 8) * 8)
    groups = -(-number // lanes)
    counted = np.concatenate(([0], np.cumsum(factors > 0.0)))[bounds]
    lengths = np.zeros(groups * lanes, np.int64)
    lengths[:number] = np.diff(counted)
    steps = -(-lengths.reshape(groups, lanes).max(axis=1, initial=0) // STRIDE)
    first = np.concatenate(([0], np.cumsum(steps)))
    rows = np.empty((first[-1], ROWS, STRIDE, lanes))
    total = np.zeros((groups, lanes))
    pack(vectors, bounds, factors, first, rows, total)
    total[total == 0.0] = np.nan
    return Windows(rows, first, total, number)


@kernel
def pack(
    sun: Floats, starts: NDArray[np.int64], weights: Floats, first: NDArray[np.int64], rows: Floats, total: Floats
) -> None:
    """Write the instants that count, window by window, and sum their weights."""
    lanes = total.shape[1]
    for w in range(total.size):
        group, lane = w // lanes, w % lanes
        step, part = first[group], 0
        t, end = (starts[w], starts[w + 1]) if w + 1 < len(starts) else (0, 0)
        x, y, z, cosine, sine = 0.0, 0.0, 1.0, 1.0, 0.0
        while step < first[group + 1]:
            weight = 0.0
            while weight == 0.0 and t < end:
                weight = weights[t]
                if weight > 0.0:
                    x, y, z = -sun[t, 0], -sun[t, 1], sun[t, 2]
                    level = math.sqrt(x * x + y * y)
                    # psi turns from east through south; a sun in the zenith leaves the mount at home, in the east
                    cosine, sine = (-x / level, y / level) if level > 0.0 else (1.0, 0.0)
                t += 1
            total[group, lane] += weight
            row = rows[step]
            row[WEST, part, lane], row[SOUTH, part, lane], row[UP, part, lane] = x, y, z
            row[COSINE, part, lane], row[SINE, part, lane], row[WEIGHT, part, lane] = cosine, sine, weight
            part += 1
            if part == STRIDE:
                step, part = step + 1, 0


@inline
def arcsine(x: float) -> float:
    """Arcsine of 0 <= x <= `SMALL`."""
    q = x * x
    series = 35.0 / 1152.0 + q * (63.0 / 2816.0 + q * (231.0 / 13312.0 + q * (143.0 / 10240.0)))
    return x + x * q * (1.0 / 6.0 + q * (3.0 / 40.0 + q * (5.0 / 112.0 + q * series)))


@inline
def wide_arcsine(x: float) -> float:
    """Arcsine of 0 <= x <= 1 to 2e-16, without a branch: vector code, unlike the library's.

    The rational form of fdlibm up to a half, beyond as asin(x) = pi / 2 - 2 asin(sqrt((1 - x) / 2)).
    """
    beyond = x > 0.5
    q = 0.5 * (1.0 - x) if beyond else x * x
    root = math.sqrt(q)
    p = 7.91534994289814532176e-04 + q * 3.47933107596021167570e-05
    p = 2.01212532134862925881e-01 + q * (-4.00555345006794114027e-02 + q * p)
    p = q * (1.66666666666666657415e-01 + q * (-3.25565818622400915405e-01 + q * p))
    s = 2.02094576023350569471e00 + q * (-6.88283971605453293030e-01 + q * 7.70381505559019352791e-02)
    s = p / (1.0 + q * (-2.40339491173441421878e00 + q * s))
    return 0.5 * math.pi - 2.0 * (root + root * s) if beyond else x + x * s


@kernel
def fill_errors(rows: Floats, model: int, mount: Floats, errors: Floats) -> None:
    """Errors of one mount at all instants of a group."""
    direction, tilt = mount[4], mount[5]
    columns = rows.reshape(len(rows), ROWS, errors.shape[1])
    if np.any(mount[:4] != 0.0):
        _chain(columns, model, mount, errors)
    elif model == RIGID:
        _rigid(columns, direction, tilt, errors)
    else:
        _untilted(columns, direction, tilt, errors)
    largest = (
        (tilt if model == RIGID else 2.0 * tilt) + abs(mount[0]) + abs(mount[1]) + abs(mount[2]) + 2 * abs(mount[3])
    )
    if largest <= 2.0 * SMALL:
        for step in range(len(errors)):
            for k in range(errors.shape[1]):
                errors[step, k] = 2.0 * arcsine(errors[step, k])
    else:
        for step in range(len(errors)):
            for k in range(errors.shape[1]):
                errors[step, k] = 2.0 * wide_arcsine(min(errors[step, k], 1.0))


@kernel
def _rigid(rows: Floats, direction: float, tilt: float, sines: Floats) -> None:
    """Sines of half the errors of a mount that leans as a whole: sin(tilt / 2) |u x s|."""
    half_sine = math.sin(0.5 * tilt)
    west, south = math.sin(direction), math.cos(direction)
    for step in range(len(rows)):
        for k in range(rows.shape[2]):
            along = west * rows[step, WEST, k] + south * rows[step, SOUTH, k]
            sines[step, k] = half_sine * math.sqrt(along * along + rows[step, UP, k] * rows[step, UP, k])


@kernel
def _untilted(rows: Floats, direction: float, tilt: float, sines: Floats) -> None:
    """Sines of half the errors of a mount whose azimuth axis leans alone: |v x s|.

    v = sin h cos h (u - Qu) - sin^2 h (u x Qu), where h = tilt / 2 and Q turns by psi about the vertical. With
    u = (ux, uy, 0), u - Qu = (ux (1 - cos psi) - uy sin psi, uy (1 - cos psi) + ux sin psi, 0) and
    u x Qu = (0, 0, -sin psi).
    """
    level, rise = math.sin(0.5 * tilt) * math.cos(0.5 * tilt), math.sin(0.5 * tilt) ** 2
    ux, uy = level * math.cos(direction), -level * math.sin(direction)
    for step in range(len(rows)):
        for k in range(rows.shape[2]):
            x, y, z = rows[step, WEST, k], rows[step, SOUTH, k], rows[step, UP, k]
            versine, sine = 1.0 - rows[step, COSINE, k], rows[step, SINE, k]
            vx, vy, vz = ux * versine - uy * sine, uy * versine + ux * sine, rise * sine
            cx, cy, cz = vy * z - vz * y, vz * x - vx * z, vx * y - vy * x
            sines[step, k] = math.sqrt(cx * cx + cy * cy + cz * cz)


@kernel
def _chain(rows: Floats, model: int, mount: Floats, sines: Floats) -> None:
    """Sines of half the errors by turning the focal axis about the elevation axis, then about the azimuth axis."""
    home_azimuth, home_elevation, reference, askew, direction, tilt = mount
    azimuth_axis = 0.0, 0.0, -1.0
    level, dip = math.cos(askew), math.sin(askew)
    elevation_axis = 0.0, level, -dip
    aside, raised = math.sin(home_azimuth), math.cos(home_azimuth) * math.sin(home_elevation)
    focal_axis = (
        -math.cos(home_azimuth) * math.cos(home_elevation),
        -aside * level + raised * dip,
        aside * dip + raised * level,
    )
    u = math.cos(direction), -math.sin(direction), 0.0
    cosine, sine = math.cos(tilt), math.sin(tilt)
    ahead, beside = math.cos(reference), math.sin(reference)
    azimuth_axis = _turned(azimuth_axis, u, cosine, sine)
    if model == RIGID:
        elevation_axis = _turned(elevation_axis, u, cosine, sine)
        focal_axis = _turned(focal_axis, u, cosine, sine)
    for step in range(len(rows)):
        for k in range(rows.shape[2]):
            x, y, z = rows[step, WEST, k], rows[step, SOUTH, k], rows[step, UP, k]
            lifted = _turned(focal_axis, elevation_axis, math.sqrt(x * x + y * y), z)
            cosine, sine = rows[step, COSINE, k], rows[step, SINE, k]
            cosine, sine = cosine * ahead - sine * beside, sine * ahead + cosine * beside
            fx, fy, fz = _turned(lifted, azimuth_axis, cosine, sine)
            sines[step, k] = 0.5 * math.sqrt((fx - x) ** 2 + (fy - y) ** 2 + (fz - z) ** 2)


@inline
def _turned(
    vector: tuple[float, float, float], axis: tuple[float, float, float], cosine: float, sine: float
) -> tuple[float, float, float]:
    """`vector` turned about the unit vector `axis`, right-handed, by Rodrigues' formula."""
    x, y, z = vector
    ax, ay, az = axis
    along = (ax * x + ay * y + az * z) * (1.0 - cosine)
    return (
        x * cosine + (ay * z - az * y) * sine + ax * along,
        y * cosine + (az * x - ax * z) * sine + ay * along,
        z * cosine + (ax * y - ay * x) * sine + az * along,
    )


POWERS = 8
"""Odd powers of |u x s| that are summed for the rigid model, as many as the series of the arcsine has terms."""


class WindowErrors(NamedTuple):
    """Pointing errors per parameter combination and window, arrays of shape (*parameters, W)."""

    mean: Floats
    """Weighted mean of the error e. [rad]"""
    largest: Floats
    """Largest error at an instant of positive weight. [rad]"""
    clipped: Floats
    """Weighted mean of min(e, tolerance). [rad]"""


def window_errors(
    model: int,
    windows: Windows,
    tilt: ArrayLike,
    direction: ArrayLike,
    home_azimuth: ArrayLike = 0.0,
    home_elevation: ArrayLike = 0.0,
    tolerance: ArrayLike | None = None,
    *,
    azimuth_reference: ArrayLike = 0.0,
    non_orthogonality: ArrayLike = 0.0,
    collimation: ArrayLike = 0.0,
) -> WindowErrors:
    """Mean, largest and clipped mean pointing error of every window, for every parameter combination.

    The parameters broadcast against each other, so that a sweep costs no more than its distinct values: whatever
    combinations share is computed once.

    Parameters
    ----------
    model : int
        `RIGID` or `UNTILTED_HOME_AXES`.
    windows : Windows
        From `pack_windows`.
    tilt : array_like
        Tilt of the azimuth axis, 0 to pi / 2. [rad]
    direction : array_like
        Where the foot of the axis leans: 0 south, positive to the west. [rad]
    home_azimuth, home_elevation : array_like
        Offsets gamma1 and gamma2 of the home position of the focal axis from due east: its home vector is
        (-cos gamma1 cos gamma2, -sin gamma1, cos gamma1 sin gamma2). [rad]
    tolerance : array_like, optional
        Largest error that counts in the clipped mean; none by default, when the clipped mean is the mean. [rad]
    azimuth_reference, non_orthogonality, collimation : array_like
        By how much the mount is turned too far about its azimuth axis, clockwise seen from above; the angle by which
        the right-hand end of the elevation axis, seen along the home focal axis, lies below the plane normal to the
        azimuth axis; the angle of the focal axis from the plane normal to the elevation axis, towards that end. [rad]

    Returns
    -------
    WindowErrors
        NaN where a window has no instant of positive weight.

    Raises
    ------
    ValueError
        If the model is unknown, a tilt outside its range, or a tolerance not positive.
    """
    if model not in (RIGID, UNTILTED_HOME_AXES):
        raise ValueError(f"unknown model {model}")
    limits = np.inf if tolerance is None else tolerance
    # In this chain the focal axis alone carries the offset in azimuth, towards the other end than its collimation.
    across = np.asarray(home_azimuth) - np.asarray(collimation)
    mount = (across, home_elevation, azimuth_reference, non_orthogonality, direction, tilt)
    parameters = np.broadcast_arrays(*mount, limits)
    shape = parameters[0].shape
    table = np.stack([np.asarray(values, np.float64).ravel() for values in parameters], axis=1)
    if not np.all((table[:, 5] >= 0.0) & (table[:, 5] <= np.pi / 2)):
        raise ValueError("tilts must lie between 0 and pi / 2")
    if not np.all(table[:, 6] > 0.0):
        raise ValueError("tolerances must be positive")
    order = np.lexsort(table[:, 5::-1].T)
    rows = table[order, :6]
    first = np.any(rows != np.roll(rows, 1, axis=0), axis=1)
    first[:1] = True
    starts, mounts = np.append(np.flatnonzero(first), len(rows)), rows[first]
    mean, largest = np.empty((2, len(table), *windows.total.shape))
    clipped = mean if tolerance is None else np.empty_like(mean)
    sweep(model, windows, mounts, starts, order, table[:, 6].copy(), mean, largest, clipped)
    return WindowErrors(
        *(
            values.reshape(len(table), windows.total.size)[:, : windows.number].reshape(*shape, windows.number)
            for values in (mean, largest, clipped)
        )
    )


@kernel
def sweep(
    model: int,
    windows: Windows,
    mounts: Floats,
    starts: NDArray[np.int64],
    order: NDArray[np.int64],
    tolerance: Floats,
    mean: Floats,
    largest: Floats,
    clipped: Floats,
) -> None:
    """Fill `mean`, `largest` and `clipped`, shape (combinations, groups, lanes).

    Mount m is a row home_azimuth, home_elevation, azimuth_reference, non_orthogonality, direction, tilt, and serves the
    combinations order[starts[m]] .. order[starts[m + 1] - 1], which differ in their tolerances. Mounts that share what
    can be shared follow each other.
    `clipped` may be `mean` itself where no tolerance is finite.
    """
    groups, lanes = windows.total.shape
    longest = 0
    for group in range(groups):
        longest = max(longest, windows.first[group + 1] - windows.first[group])
    errors_of_group = np.empty((longest, STRIDE * lanes))
    powers = np.empty((POWERS + 1) * LANES)
    for group in range(groups):
        rows = windows.rows[windows.first[group] : windows.first[group + 1]]
        total = windows.total[group]
        errors = errors_of_group[: len(rows)]
        direction_of_powers = np.nan
        for m in range(len(mounts)):
            direction, tilt = mounts[m, 4], mounts[m, 5]
            c = order[starts[m]]
            by_powers = model == RIGID and not np.any(mounts[m, :4] != 0.0) and math.sin(0.5 * tilt) <= SMALL
            if by_powers:
                if direction != direction_of_powers:
                    _sum_powers(rows, direction, powers)
                    direction_of_powers = direction
                _from_powers(powers, math.sin(0.5 * tilt), total, mean[c, group], largest[c, group])
            else:
                fill_errors(rows, model, mounts[m], errors)
                _mean_and_largest(rows, errors, total, mean[c, group], largest[c, group])
            filled = not by_powers
            for position in range(starts[m], starts[m + 1]):
                d = order[position]
                clips = False
                for k in range(lanes):
                    mean[d, group, k], largest[d, group, k] = mean[c, group, k], largest[c, group, k]
                    clips |= largest[c, group, k] > tolerance[d]
                if clips and not filled:
                    fill_errors(rows, model, mounts[m], errors)
                    filled = True
                if clips:
                    _clipped_mean(rows, errors, total, tolerance[d], clipped[d, group])
                for k in range(lanes):
                    if not largest[c, group, k] > tolerance[d]:
                        clipped[d, group, k] = mean[c, group, k]


@kernel
def _sum_powers(rows: Floats, direction: float, powers: Floats) -> None:
    """Sum |u x s|, its third, fifth ... power in each lane, and find its maximum: all that the tilts share."""
    west, south = math.sin(direction), math.cos(direction)
    powers[:] = 0.0
    for step in range(len(rows)):
        for k in range(min(rows.shape[3], LANES)):
            a = rows[step, WEST, 0, k] * west + rows[step, SOUTH, 0, k] * south
            b = rows[step, WEST, 1, k] * west + rows[step, SOUTH, 1, k] * south
            c = rows[step, WEST, 2, k] * west + rows[step, SOUTH, 2, k] * south
            d = rows[step, WEST, 3, k] * west + rows[step, SOUTH, 3, k] * south
            aa = a * a + rows[step, UP, 0, k] * rows[step, UP, 0, k]
            bb = b * b + rows[step, UP, 1, k] * rows[step, UP, 1, k]
            cc = c * c + rows[step, UP, 2, k] * rows[step, UP, 2, k]
            dd = d * d + rows[step, UP, 3, k] * rows[step, UP, 3, k]
            a, b, c, d = math.sqrt(aa), math.sqrt(bb), math.sqrt(cc), math.sqrt(dd)
            top = max(max(a, b), max(c, d))
            powers[POWERS * LANES + k] = max(powers[POWERS * LANES + k], top)
            a, b = a * rows[step, WEIGHT, 0, k], b * rows[step, WEIGHT, 1, k]
            c, d = c * rows[step, WEIGHT, 2, k], d * rows[step, WEIGHT, 3, k]
            for j in range(POWERS):
                powers[j * LANES + k] += (a + b) + (c + d)
                a, b, c, d = a * aa, b * bb, c * cc, d * dd


@kernel
def _from_powers(powers: Floats, half_sine: float, total: Floats, mean: Floats, largest: Floats) -> None:
    """Mean and largest error of a rigid mount with sin(tilt / 2) = half_sine, from the sums of `_sum_powers`."""
    q = half_sine * half_sine
    for k in range(min(len(mean), LANES)):
        series = powers[7 * LANES + k] * (143.0 / 10240.0)
        series = powers[6 * LANES + k] * (231.0 / 13312.0) + q * series
        series = powers[5 * LANES + k] * (63.0 / 2816.0) + q * series
        series = powers[4 * LANES + k] * (35.0 / 1152.0) + q * series
        series = powers[3 * LANES + k] * (5.0 / 112.0) + q * series
        series = powers[2 * LANES + k] * (3.0 / 40.0) + q * series
        series = powers[LANES + k] * (1.0 / 6.0) + q * series
        mean[k] = 2.0 * half_sine * (powers[k] + q * series) / total[k]
        top = 2.0 * arcsine(half_sine * powers[POWERS * LANES + k])
        largest[k] = top if mean[k] == mean[k] else np.nan


@kernel
def _mean_and_largest(rows: Floats, errors: Floats, total: Floats, mean: Floats, largest: Floats) -> None:
    """Weighted mean and largest of the errors in each lane."""
    mean[:], largest[:] = 0.0, 0.0
    parts = errors.reshape(len(rows), STRIDE, len(mean))
    for step in range(len(rows)):
        for k in range(len(mean)):
            a, b, c, d = parts[step, 0, k], parts[step, 1, k], parts[step, 2, k], parts[step, 3, k]
            largest[k] = max(largest[k], max(max(a, b), max(c, d)))
            a, b = a * rows[step, WEIGHT, 0, k], b * rows[step, WEIGHT, 1, k]
            c, d = c * rows[step, WEIGHT, 2, k], d * rows[step, WEIGHT, 3, k]
            mean[k] += (a + b) + (c + d)
    for k in range(len(mean)):
        mean[k] /= total[k]
        largest[k] = largest[k] if mean[k] == mean[k] else np.nan


@kernel
def _clipped_mean(rows: Floats, errors: Floats, total: Floats, tolerance: float, mean: Floats) -> None:
    """Weighted mean of min(error, tolerance) in each lane."""
    mean[:] = 0.0
    parts = errors.reshape(len(rows), STRIDE, len(mean))
    for step in range(len(rows)):
        for k in range(len(mean)):
            a, b = min(parts[step, 0, k], tolerance), min(parts[step, 1, k], tolerance)
            c, d = min(parts[step, 2, k], tolerance), min(parts[step, 3, k], tolerance)
            a, b = a * rows[step, WEIGHT, 0, k], b * rows[step, WEIGHT, 1, k]
            c, d = c * rows[step, WEIGHT, 2, k], d * rows[step, WEIGHT, 3, k]
            mean[k] += (a + b) + (c + d)
    for k in range(len(mean)):
        mean[k] /= total[k]

"""Pointing error of a dish on tilted axes: means, maxima and clipped means over windows of time.

The mount leans by `tilt`: the foot of its azimuth axis moves towards `direction` and the mount turns about the
horizontal vector u at right angles to it. Two models: `RIGID`, where everything leans and the controller does not know;
`UNTILTED_HOME_AXES`, where the azimuth axis leans alone while the home positions of the elevation axis and the focal
axis do not (Liu, Peng and Yan 2022). Both have closed forms; with home offsets the chain of axes itself is computed.

Vectors are x west, y south, z up inside this module, the frame of the paper. Windows lie side by side as lanes: a
window is summed instant by instant in the order of time, so its bits depend on no other window and no other parameter.

References: Z. Liu, H. Peng and J. Yan, "Effect of the azimuth axis tilt error on the tracking performance of a solar
dish concentrator system", Energies 15 (2022) 3261, doi 10.3390/en15093261.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel

__all__ = [
    "RIGID",
    "UNTILTED_HOME_AXES",
    "WindowErrors",
    "Windows",
    "effective_tracking_factor",
    "pack_windows",
    "pointing_errors",
    "window_errors",
]

RIGID = 0
"""The whole mount leans."""
UNTILTED_HOME_AXES = 1
"""The azimuth axis leans; the home positions of the other axes do not."""

LANES = 64
"""Windows side by side at most; no number depends on it."""
_STRIDE = 4
"""Instants added before the running sums are touched."""
_MOMENTS = 8
"""Odd powers of |u x s| that are summed for the rigid model."""
_SMALL = 0.12
"""Largest sine of half an error for the series of the arcsine: cut after x^15, it is short by 2e-17."""

Floats = NDArray[np.float64]


class Windows(NamedTuple):
    """Sun vectors of all windows, packed once for any number of parameters by `pack_windows`.

    Instant i of lane k of group g is element first[g] + i * lanes + k. Windows with fewer instants than their group
    repeat their last one with weight zero.
    """

    x: Floats
    """Unit vectors to the sun: west, south, up. [1]"""
    y: Floats
    z: Floats
    weight: Floats
    first: NDArray[np.int64]
    """Start of each group and the end of the last one, shape (groups + 1,)."""
    total: Floats
    """Sum of the weights of each lane, shape (groups * lanes,)."""
    number: int
    """Number of windows."""
    lanes: int
    """Windows in a group."""


class WindowErrors(NamedTuple):
    """Pointing errors per parameter combination and window, arrays of shape (*parameters, W)."""

    mean: Floats
    """Weighted mean of the error e. [rad]"""
    largest: Floats
    """Largest error at an instant of positive weight. [rad]"""
    clipped: Floats
    """Weighted mean of min(e, tolerance). [rad]"""


def effective_tracking_factor(mean_error: ArrayLike, tolerance: ArrayLike) -> Any:
    """Effective tracking factor, 1 - mean_error / tolerance; arguments broadcast.

    Parameters
    ----------
    mean_error : array_like
        Mean, or clipped mean, of the pointing error. [rad]
    tolerance : array_like
        Error at which nothing is collected any more. [rad]

    Returns
    -------
    ndarray
        1 for perfect tracking; negative where an unclipped mean is larger than the tolerance. [1]
    """
    return 1.0 - np.asarray(mean_error) / np.asarray(tolerance)


def pointing_errors(
    model: int,
    sun: ArrayLike,
    tilt: ArrayLike,
    direction: ArrayLike,
    home_azimuth: ArrayLike = 0.0,
    home_elevation: ArrayLike = 0.0,
) -> Floats:
    """Pointing error of every instant; parameters as in `window_errors`.

    Parameters
    ----------
    sun : array_like, shape (T, 3)
        Unit vectors to the sun: east, north, up. [1]

    Returns
    -------
    ndarray, shape (*parameters, T)
        Angle between the sun and the focal axis. [rad]
    """
    vectors = np.asarray(sun, np.float64)
    instants = pack_windows(vectors, np.arange(len(vectors) + 1))
    return window_errors(model, instants, tilt, direction, home_azimuth, home_elevation).mean


def pack_windows(sun: ArrayLike, starts: ArrayLike, weights: ArrayLike | None = None) -> Windows:
    """Pack the instants of all windows for `window_errors`.

    Parameters
    ----------
    sun : array_like, shape (T, 3)
        Unit vectors to the sun: east, north, up. [1]
    starts : array_like of int, shape (W + 1,)
        Window w holds the instants starts[w] .. starts[w + 1] - 1.
    weights : array_like, shape (T,), optional
        Weight of each instant, 1 by default; instants of weight zero do not count, whatever their vectors. [1]

    Returns
    -------
    Windows
        The vectors of the instants that count.

    Raises
    ------
    ValueError
        If the windows are no part of the instants or a weight is negative or not finite.
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
    count = len(bounds) - 1
    lanes = min(LANES, -(-count // 8) * 8)
    groups = -(-count // lanes) if count else 0
    counted = np.concatenate(([0], np.cumsum(factors > 0.0)))[bounds]
    lengths = np.zeros(groups * lanes, np.int64)
    lengths[:count] = np.diff(counted)
    rows = -(-lengths.reshape(groups, lanes).max(axis=1, initial=0) // _STRIDE) * _STRIDE
    first = np.concatenate(([0], np.cumsum(rows * lanes)))
    packed = np.empty((4, first[-1]))
    total = np.zeros(groups * lanes)
    _pack(vectors, bounds, factors, first, lanes, packed, total)
    return Windows(packed[0], packed[1], packed[2], packed[3], first, total, count, lanes)


@kernel
def _pack(
    sun: Floats,
    starts: NDArray[np.int64],
    weights: Floats,
    first: NDArray[np.int64],
    lanes: int,
    packed: Floats,
    total: Floats,
) -> None:
    """Write the instants that count, turned to west, south, up, and sum their weights."""
    for w in range(len(total)):
        group, lane = w // lanes, w % lanes
        place, end = first[group] + lane, first[group + 1]
        x, y, z, sum_of_weights = 0.0, 0.0, 1.0, 0.0
        if w < len(starts) - 1:
            for t in range(starts[w], starts[w + 1]):
                if weights[t] > 0.0:
                    x, y, z = -sun[t, 0], -sun[t, 1], sun[t, 2]
                    packed[0, place], packed[1, place], packed[2, place] = x, y, z
                    packed[3, place] = weights[t]
                    sum_of_weights += weights[t]
                    place += lanes
        total[w] = sum_of_weights
        while place < end:
            packed[0, place], packed[1, place], packed[2, place], packed[3, place] = x, y, z, 0.0
            place += lanes


def window_errors(
    model: int,
    windows: Windows,
    tilt: ArrayLike,
    direction: ArrayLike,
    home_azimuth: ArrayLike = 0.0,
    home_elevation: ArrayLike = 0.0,
    tolerance: ArrayLike | None = None,
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
    parameters = np.broadcast_arrays(home_azimuth, home_elevation, direction, tilt, limits)
    shape = parameters[0].shape
    table = np.stack([np.asarray(values, np.float64).ravel() for values in parameters], axis=1)
    if not np.all((table[:, 3] >= 0.0) & (table[:, 3] <= np.pi / 2)):
        raise ValueError("tilts must lie between 0 and pi / 2")
    if not np.all(table[:, 4] > 0.0):
        raise ValueError("tolerances must be positive")
    mounts, mount_of = np.unique(table[:, :4], axis=0, return_inverse=True)
    order = np.argsort(mount_of, kind="stable")
    starts = np.searchsorted(mount_of[order], np.arange(len(mounts) + 1))
    values = np.empty((3, len(table), len(windows.total)))
    _sweep(model, windows, mounts, starts, order, np.ascontiguousarray(table[:, 4]), values)
    mean, largest, clipped = values[:, :, : windows.number].reshape(3, *shape, windows.number)
    return WindowErrors(mean, largest, mean if tolerance is None else clipped)


@kernel
def _sweep(
    model: int,
    windows: Windows,
    mounts: Floats,
    starts: NDArray[np.int64],
    order: NDArray[np.int64],
    tolerance: Floats,
    values: Floats,
) -> None:
    """Fill `values` (mean, largest, clipped; parameter combinations; lanes), group by group.

    Combinations order[starts[m]] .. order[starts[m + 1] - 1] differ only in their tolerances and share mount m, whose
    row is home_azimuth, home_elevation, direction, tilt.
    """
    lanes = windows.lanes
    longest = 0
    for group in range(len(windows.first) - 1):
        longest = max(longest, windows.first[group + 1] - windows.first[group])
    errors = np.empty(longest)
    moments = np.empty((_MOMENTS + 1) * LANES)
    mean, largest, clipped = np.empty(lanes), np.empty(lanes), np.empty(lanes)
    for group in range(len(windows.first) - 1):
        moments_of = np.nan
        for m in range(len(mounts)):
            home_azimuth, home_elevation, direction, tilt = mounts[m]
            at_home = home_azimuth == 0.0 and home_elevation == 0.0
            half_sine = math.sin(0.5 * tilt)
            by_moments = at_home and model == RIGID and half_sine <= _SMALL
            if by_moments:
                if direction != moments_of:
                    _sum_powers(windows, group, direction, moments)
                    moments_of = direction
                _from_powers(windows, group, half_sine, moments, mean, largest)
            else:
                _fill_errors(windows, group, model, at_home, mounts[m], errors)
                _average(windows, group, errors, np.inf, mean)
                _maximum(windows, group, errors, largest)
            filled = not by_moments
            top = 0.0
            for k in range(lanes):
                top = max(top, largest[k])
            for position in range(starts[m], starts[m + 1]):
                c = order[position]
                if top > tolerance[c]:
                    if not filled:
                        _fill_errors(windows, group, model, at_home, mounts[m], errors)
                        filled = True
                    _average(windows, group, errors, tolerance[c], clipped)
                for k in range(lanes):
                    w = group * lanes + k
                    values[0, c, w] = mean[k]
                    values[1, c, w] = largest[k] if mean[k] == mean[k] else np.nan
                    values[2, c, w] = clipped[k] if largest[k] > tolerance[c] else mean[k]


@inline
def _arcsine(x: float) -> float:
    """Arcsine of 0 <= x <= `_SMALL`."""
    q = x * x
    series = 35.0 / 1152.0 + q * (63.0 / 2816.0 + q * (231.0 / 13312.0 + q * (143.0 / 10240.0)))
    return x + x * q * (1.0 / 6.0 + q * (3.0 / 40.0 + q * (5.0 / 112.0 + q * series)))


@kernel
def _sum_powers(windows: Windows, group: int, direction: float, moments: Floats) -> None:
    """Sum |u x s|, its third, fifth ... power in each lane, and find its maximum: all that the tilts share."""
    east, south = math.sin(direction), math.cos(direction)
    lanes = windows.lanes
    x, y, z, weight = windows.x, windows.y, windows.z, windows.weight
    moments[:] = 0.0
    for i in range(windows.first[group], windows.first[group + 1], _STRIDE * lanes):
        for k in range(lanes):
            a = i + k
            b = a + lanes
            c = b + lanes
            d = c + lanes
            along_a, along_b = east * x[a] + south * y[a], east * x[b] + south * y[b]
            along_c, along_d = east * x[c] + south * y[c], east * x[d] + south * y[d]
            square_a, square_b = z[a] * z[a] + along_a * along_a, z[b] * z[b] + along_b * along_b
            square_c, square_d = z[c] * z[c] + along_c * along_c, z[d] * z[d] + along_d * along_d
            sine_a, sine_b, sine_c, sine_d = (
                math.sqrt(square_a),
                math.sqrt(square_b),
                math.sqrt(square_c),
                math.sqrt(square_d),
            )
            moments[_MOMENTS * LANES + k] = max(
                moments[_MOMENTS * LANES + k], max(max(sine_a, sine_b), max(sine_c, sine_d))
            )
            sine_a, sine_b = sine_a * weight[a], sine_b * weight[b]
            sine_c, sine_d = sine_c * weight[c], sine_d * weight[d]
            for j in range(_MOMENTS):
                moments[j * LANES + k] += (sine_a + sine_b) + (sine_c + sine_d)
                sine_a, sine_b = sine_a * square_a, sine_b * square_b
                sine_c, sine_d = sine_c * square_c, sine_d * square_d


@kernel
def _from_powers(
    windows: Windows, group: int, half_sine: float, moments: Floats, mean: Floats, largest: Floats
) -> None:
    """Mean and largest error of a rigid mount with sin(tilt / 2) = half_sine, from the sums of `_sum_powers`."""
    q = half_sine * half_sine
    for k in range(windows.lanes):
        series = moments[4 * LANES + k] * (35.0 / 1152.0) + q * (
            moments[5 * LANES + k] * (63.0 / 2816.0)
            + q * (moments[6 * LANES + k] * (231.0 / 13312.0) + q * (moments[7 * LANES + k] * (143.0 / 10240.0)))
        )
        series = moments[k] + q * (
            moments[LANES + k] * (1.0 / 6.0)
            + q * (moments[2 * LANES + k] * (3.0 / 40.0) + q * (moments[3 * LANES + k] * (5.0 / 112.0) + q * series))
        )
        mean[k] = 2.0 * half_sine * series / windows.total[group * windows.lanes + k]
        largest[k] = 2.0 * _arcsine(half_sine * moments[_MOMENTS * LANES + k])


@kernel
def _average(windows: Windows, group: int, errors: Floats, tolerance: float, mean: Floats) -> None:
    """Weighted mean of min(error, tolerance) in each lane."""
    lanes, first = windows.lanes, windows.first[group]
    weight = windows.weight
    mean[:] = 0.0
    for i in range(0, windows.first[group + 1] - first, lanes):
        for k in range(lanes):
            error = errors[i + k]
            mean[k] += weight[first + i + k] * (tolerance if error > tolerance else error)
    for k in range(lanes):
        mean[k] /= windows.total[group * lanes + k]


@kernel
def _maximum(windows: Windows, group: int, errors: Floats, largest: Floats) -> None:
    """Largest error in each lane."""
    lanes = windows.lanes
    largest[:] = 0.0
    for i in range(0, windows.first[group + 1] - windows.first[group], lanes):
        for k in range(lanes):
            largest[k] = max(largest[k], errors[i + k])


@kernel
def _fill_errors(windows: Windows, group: int, model: int, at_home: bool, mount: Floats, errors: Floats) -> None:
    """Errors of one mount at all instants of a group."""
    home_azimuth, home_elevation, direction, tilt = mount
    bound = tilt if model == RIGID else 2.0 * tilt
    if not at_home:
        bound += abs(home_azimuth) + abs(home_elevation)
    if not at_home:
        _chain(windows, group, model, mount, errors)
    elif model == RIGID:
        _rigid(windows, group, direction, tilt, errors)
    else:
        _untilted(windows, group, direction, tilt, errors)
    count = windows.first[group + 1] - windows.first[group]
    if bound <= 2.0 * _SMALL:
        for i in range(count):
            errors[i] = 2.0 * _arcsine(errors[i])
    else:
        for i in range(count):
            errors[i] = 2.0 * math.asin(min(errors[i], 1.0))


@kernel
def _rigid(windows: Windows, group: int, direction: float, tilt: float, sines: Floats) -> None:
    """Sines of half the errors of a mount that leans as a whole: sin(tilt / 2) |u x s|."""
    half_sine = math.sin(0.5 * tilt)
    east, south = math.sin(direction), math.cos(direction)
    x, y, z = windows.x, windows.y, windows.z
    first = windows.first[group]
    for i in range(windows.first[group + 1] - first):
        along = east * x[first + i] + south * y[first + i]
        sines[i] = half_sine * math.sqrt(z[first + i] * z[first + i] + along * along)


@kernel
def _untilted(windows: Windows, group: int, direction: float, tilt: float, sines: Floats) -> None:
    """Sines of half the errors of a mount whose azimuth axis leans alone: |v x s|.

    v = sin h cos h (u - Qu) - sin^2 h (u x Qu), where h = tilt / 2 and Q turns by psi about the vertical. With
    u = (ux, uy, 0), u - Qu = (ux (1 - cos psi) - uy sin psi, uy (1 - cos psi) + ux sin psi, 0) and
    u x Qu = (0, 0, -sin psi).
    """
    ux, uy = math.cos(direction), -math.sin(direction)
    level, rise = math.sin(0.5 * tilt) * math.cos(0.5 * tilt), math.sin(0.5 * tilt) ** 2
    x, y, z = windows.x, windows.y, windows.z
    first = windows.first[group]
    for i in range(windows.first[group + 1] - first):
        sx, sy, sz = x[first + i], y[first + i], z[first + i]
        cosine, sine = _azimuth(sx, sy)
        versine = 1.0 - cosine
        vx, vy, vz = level * (ux * versine - uy * sine), level * (uy * versine + ux * sine), rise * sine
        cx, cy, cz = vy * sz - vz * sy, vz * sx - vx * sz, vx * sy - vy * sx
        sines[i] = math.sqrt(cx * cx + cy * cy + cz * cz)


@kernel
def _chain(windows: Windows, group: int, model: int, mount: Floats, sines: Floats) -> None:
    """Sines of half the errors by turning the focal axis about the elevation axis, then about the azimuth axis."""
    home_azimuth, home_elevation, direction, tilt = mount
    azimuth_axis = 0.0, 0.0, -1.0
    elevation_axis = 0.0, 1.0, 0.0
    focal_axis = (
        -math.cos(home_azimuth) * math.cos(home_elevation),
        -math.sin(home_azimuth),
        math.cos(home_azimuth) * math.sin(home_elevation),
    )
    u = math.cos(direction), -math.sin(direction), 0.0
    cosine, sine = math.cos(tilt), math.sin(tilt)
    azimuth_axis = _turned(azimuth_axis, u, cosine, sine)
    if model == RIGID:
        elevation_axis = _turned(elevation_axis, u, cosine, sine)
        focal_axis = _turned(focal_axis, u, cosine, sine)
    x, y, z = windows.x, windows.y, windows.z
    first = windows.first[group]
    for i in range(windows.first[group + 1] - first):
        sx, sy, sz = x[first + i], y[first + i], z[first + i]
        cosine, sine = _azimuth(sx, sy)
        raised = _turned(focal_axis, elevation_axis, math.sqrt(sx * sx + sy * sy), sz)
        fx, fy, fz = _turned(raised, azimuth_axis, cosine, sine)
        sines[i] = 0.5 * math.sqrt((fx - sx) ** 2 + (fy - sy) ** 2 + (fz - sz) ** 2)


@inline
def _azimuth(x: float, y: float) -> tuple[float, float]:
    """Cosine and sine of psi, the turn of the mount from due east through south; east for a sun in the zenith."""
    level = math.sqrt(x * x + y * y)
    inverse = 1.0 / level if level > 0.0 else 0.0
    return (-x * inverse if level > 0.0 else 1.0), y * inverse


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

"""Pointing error of a dish on tilted axes: means, maxima and clipped means over windows of time.

Vectors are x west, y south, z up. The mount leans by `tilt` about the horizontal unit vector u = (cos direction,
-sin direction, 0): the foot of its azimuth axis moves towards `direction`.

Two models: `RIGID`, where the whole mount leans and the controller does not know; `UNTILTED_HOME_AXES`, where the
azimuth axis leans alone while the home positions of the elevation axis and the focal axis do not (Liu, Peng and Yan
2022 [1]_). Both have closed forms, used where the lean is the only error; else the chain of axes itself is computed:
the focal axis is turned about the elevation axis by the elevation of the sun, then about the azimuth axis by psi.

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
from heliosweep.kernels.vectors import cross, dot, mixed, turned

RIGID = 0
"""The whole mount leans."""
UNTILTED_HOME_AXES = 1
"""The azimuth axis leans; the home positions of the other axes do not."""

SMALL = 0.12
"""Maximum sine for the series of the arcsine: its terms after x^15 are below 2e-17."""


POWERS = (1.0, 1.0 / 6.0, 3.0 / 40.0, 5.0 / 112.0, 35.0 / 1152.0, 63.0 / 2816.0, 231.0 / 13312.0, 143.0 / 10240.0)
"""Coefficients of the odd powers of the arcsine."""


class Windows(NamedTuple):
    """Sun vectors of the instants that count in all windows; made by `pack_windows`."""

    rows: Floats
    """Unit vector to the sun (west, south, up), and cosine and sine of psi, shape (5, T). psi is the rotation of a
    mount that follows the sun, from due east through south; 0 for a sun in the zenith. [1]"""
    weights: Floats
    """Weight of each instant, shape (T,). [1]"""
    starts: NDArray[np.int64]
    """First instant of each window, and the end of the last one, shape (W + 1,)."""


def pack_windows(sun: ArrayLike, starts: ArrayLike, weights: ArrayLike | None = None) -> Windows:
    """Pack the instants of all windows for `window_errors`.

    Parameters
    ----------
    sun : array_like, shape (T, 3)
        Unit vectors to the sun: east, north, up. [1]
    starts : array_like of int, shape (W + 1,)
        Window w contains the instants starts[w] to starts[w + 1] - 1.
    weights : array_like, shape (T,), optional
        Weight of each instant, 1 by default; instants of weight zero do not count. [1]

    Returns
    -------
    Windows

    Raises
    ------
    ValueError
        If the windows are not within the instants, or a weight is negative or not finite.
    """
    vectors, bounds = np.asarray(sun, np.float64), np.asarray(starts, np.int64)
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise ValueError(f"sun vectors of shape {vectors.shape}, expected (T, 3)")
    instants = len(vectors)
    factors = np.ones(instants) if weights is None else np.asarray(weights, np.float64)
    if factors.shape != (instants,) or not np.all((factors >= 0.0) & (factors < np.inf)):
        raise ValueError("weights must be finite, not negative, and one for each instant")
    if bounds.ndim != 1 or len(bounds) == 0 or bounds[0] < 0 or bounds[-1] > instants or np.any(np.diff(bounds) < 0):
        raise ValueError(f"windows must be rising positions among {instants} instants")
    counts = factors > 0.0
    x, y, z = -vectors[counts, 0], -vectors[counts, 1], vectors[counts, 2]
    level = np.sqrt(x * x + y * y)
    zenith = level == 0.0
    length = np.where(zenith, 1.0, level)
    return Windows(
        np.stack((x, y, z, np.where(zenith, 1.0, -x / length), y / length)),
        factors[counts],
        np.concatenate(([0], np.cumsum(counts)))[bounds],
    )


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


@inline
def _rigid(rows, direction, tilt, sines):
    """Sines of half the errors of a mount that leans as a whole: sin(tilt / 2) |u x s|."""
    half_sine, west, south = math.sin(0.5 * tilt), math.sin(direction), math.cos(direction)
    for t in range(sines.size):
        along = west * rows[0, t] + south * rows[1, t]
        sines[t] = half_sine * math.sqrt(along * along + rows[2, t] * rows[2, t])


@inline
def _untilted(rows, direction, tilt, sines):
    """Sines of half the errors of a mount whose azimuth axis leans alone: |v x s|.

    v = sin h cos h (u - Qu) - sin^2 h (u x Qu), where h = tilt / 2 and Q rotates by psi about the vertical. With
    u = (ux, uy, 0), u - Qu = (ux (1 - cos psi) - uy sin psi, uy (1 - cos psi) + ux sin psi, 0) and
    u x Qu = (0, 0, -sin psi).
    """
    level, rise = math.sin(0.5 * tilt) * math.cos(0.5 * tilt), math.sin(0.5 * tilt) ** 2
    ux, uy = level * math.cos(direction), -level * math.sin(direction)
    for t in range(sines.size):
        versine, sine = 1.0 - rows[3, t], rows[4, t]
        v = ux * versine - uy * sine, uy * versine + ux * sine, rise * sine
        x = cross(v, (rows[0, t], rows[1, t], rows[2, t]))
        sines[t] = math.sqrt(dot(x, x))


@inline
def _chain(rows, model, mount, sines):
    """Sines of half the errors by rotating the focal axis about the elevation axis, then about the azimuth axis."""
    home_azimuth, home_elevation, reference, askew, direction, tilt = (
        mount[0], mount[1], mount[2], mount[3], mount[4], mount[5]
    )  # fmt: skip
    level, dip = math.cos(askew), math.sin(askew)
    aside, raised = math.sin(home_azimuth), math.cos(home_azimuth) * math.sin(home_elevation)
    elevation_axis = 0.0, level, -dip
    focal_axis = (
        -math.cos(home_azimuth) * math.cos(home_elevation),
        -aside * level + raised * dip,
        aside * dip + raised * level,
    )
    u = math.cos(direction), -math.sin(direction), 0.0
    azimuth_axis = turned((0.0, 0.0, -1.0), u, math.cos(tilt), math.sin(tilt))
    if model == RIGID:
        elevation_axis = turned(elevation_axis, u, math.cos(tilt), math.sin(tilt))
        focal_axis = turned(focal_axis, u, math.cos(tilt), math.sin(tilt))
    ahead, behind = math.cos(reference), math.sin(reference)
    for t in range(sines.size):
        x, y, z = rows[0, t], rows[1, t], rows[2, t]
        lifted = turned(focal_axis, elevation_axis, math.sqrt(x * x + y * y), z)
        cosine, sine = rows[3, t] * ahead - rows[4, t] * behind, rows[4, t] * ahead + rows[3, t] * behind
        off = mixed(1.0, turned(lifted, azimuth_axis, cosine, sine), -1.0, (x, y, z))
        sines[t] = 0.5 * math.sqrt(dot(off, off))


@inline
def _fill_errors(rows, model, mount, leans_only, errors):
    """Store the errors of one mount at all instants. [rad]"""
    if not leans_only:
        _chain(rows, model, mount, errors)
    elif model == RIGID:
        _rigid(rows, mount[4], mount[5], errors)
    else:
        _untilted(rows, mount[4], mount[5], errors)
    for t in range(errors.size):
        errors[t] = 2.0 * wide_arcsine(min(errors[t], 1.0))


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
    order = np.lexsort(table[:, ::-1].T)
    found = np.empty((3, len(table), len(windows.starts) - 1))
    sweep(model, windows.rows, windows.weights, windows.starts, table[order], *found)
    found[:, order] = found.copy()
    mean, largest, clipped = found.reshape(3, *shape, found.shape[2])
    return WindowErrors(mean, largest, clipped)


@kernel
def sweep(
    model: int,
    rows: Floats,
    weights: Floats,
    starts: NDArray[np.int64],
    table: Floats,
    mean: Floats,
    largest: Floats,
    clipped: Floats,
) -> None:
    """Fill `mean`, `largest` and `clipped`, shape (combinations, windows), for the rows of a sorted table.

    A row is home_azimuth, home_elevation, azimuth_reference, non_orthogonality, direction, tilt, tolerance. Rigid
    mounts without other errors share the sums of powers of |u x s| of their direction.
    """
    windows = len(starts) - 1
    errors, total = np.empty(len(weights)), np.zeros(windows)
    for w in range(windows):
        for t in range(starts[w], starts[w + 1]):
            total[w] += weights[t]
        total[w] = total[w] if total[w] > 0.0 else math.nan
    sums, top, direction = np.zeros((windows, len(POWERS))), np.zeros(windows), math.nan
    filled = False
    for c in range(len(table)):
        half_sine, leans_only = math.sin(0.5 * table[c, 5]), not np.any(table[c, :4] != 0.0)
        if c > 0 and np.all(table[c, :6] == table[c - 1, :6]):
            mean[c], largest[c] = mean[c - 1], largest[c - 1]
        elif model == RIGID and leans_only and half_sine <= SMALL:
            filled = False
            if table[c, 4] != direction:
                direction = table[c, 4]
                _rigid(rows, direction, math.pi, errors)
                _sum_powers(errors, weights, starts, sums, top)
            for w in range(windows):
                series = 0.0
                for j in range(len(POWERS) - 1, -1, -1):
                    series = sums[w, j] * POWERS[j] + half_sine * half_sine * series
                mean[c, w] = 2.0 * half_sine * series / total[w]
                largest[c, w] = 2.0 * wide_arcsine(half_sine * top[w]) if mean[c, w] == mean[c, w] else math.nan
        else:
            filled = True
            _fill_errors(rows, model, table[c], leans_only, errors)
            for w in range(windows):
                whole = highest = 0.0
                for t in range(starts[w], starts[w + 1]):
                    whole += weights[t] * errors[t]
                    highest = max(highest, errors[t])
                mean[c, w] = whole / total[w]
                largest[c, w] = highest if mean[c, w] == mean[c, w] else math.nan
        clipped[c] = mean[c]
        for w in range(windows):
            if largest[c, w] > table[c, 6]:
                if not filled:
                    _fill_errors(rows, model, table[c], leans_only, errors)
                    filled = True
                whole = 0.0
                for t in range(starts[w], starts[w + 1]):
                    whole += weights[t] * min(errors[t], table[c, 6])
                clipped[c, w] = min(whole / total[w], table[c, 6])  # not above it by rounding


@inline
def _sum_powers(lengths, weights, starts, sums, top):
    """Sum the odd powers of |u x s| over each window and find the maximum."""
    sums[:] = 0.0
    for w in range(len(top)):
        top[w] = 0.0
        for t in range(starts[w], starts[w + 1]):
            top[w] = max(top[w], lengths[t])
            square, power = lengths[t] * lengths[t], lengths[t] * weights[t]
            for j in range(len(POWERS)):
                sums[w, j] += power
                power *= square

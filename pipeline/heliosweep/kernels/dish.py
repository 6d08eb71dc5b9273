"""Pointing error of a dish on tilted axes: means, maxima and clipped means over time windows.

Vectors have the components x west, y south, z up. The mount leans by `tilt` about the horizontal unit vector u = (cos
direction, -sin direction, 0), so that the foot of its azimuth axis moves towards `direction`. The focal axis is rotated
about the elevation axis by the elevation h of the sun, then about the azimuth axis by the angle psi, measured from due
east through south.

There are two models. In `RIGID`, the whole mount leans and the controller does not correct the tilt. In
`UNTILTED_HOME_AXES`, only the azimuth axis leans, and the home positions of the elevation axis and the focal axis do
not lean (Liu, Peng and Yan 2022 [1]_). Both rotations are linear in (1, cos, sin) of their angles. The focal axis minus
the direction of the sun is therefore the sum over p and q of D[p, q] (1, cos psi, sin psi)[p] (1, cos h, sin h)[q]. D
is zero for a mount without errors.

References
----------
.. [1] Y. Liu, Y. Peng and J. Yan, "Effect of the azimuth axis tilt error on the tracking performance of a solar dish
   concentrator system", Energies 15 (2022) 3261, doi 10.3390/en15093261
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.compiled import Floats, Integers, inline, kernel
from heliosweep.kernels.vectors import at_angle, turning

#: Models of a tilt. `RIGID`: The whole mount leans.
#: `UNTILTED_HOME_AXES`: Only the azimuth axis leans; the home positions of the other axes do not lean.
RIGID, UNTILTED_HOME_AXES = 0, 1
#: Maximum chord for which the arc is computed from a vectorised series.
#: The terms of the series after chord^15 are below 2e-17.
SMALL = 0.24
#: Coefficients of the odd powers of a chord in the series of its arc, 2 asin(chord / 2).
ARC = (1.0, 1 / 24, 3 / 640, 5 / 7168, 35 / 294912, 63 / 2883584, 231 / 54525952, 143 / 167772160)


class Windows(NamedTuple):
    """Sun positions at all instants with positive weight, grouped by window; created by `pack_windows`.

    Attributes
    ----------
    rows : ndarray, shape (4, T)
        cos psi, sin psi, cos h and sin h; psi is 0 if the sun is at the zenith. [1]
    weights : ndarray, shape (T,)
        Weight of each instant. [1]
    starts : ndarray of int, shape (W + 1,)
        Index of the first instant of each window, and the end of the last window.
    """

    rows: Floats
    weights: Floats
    starts: Integers


def pack_windows(sun: ArrayLike, starts: ArrayLike, weights: ArrayLike | None = None) -> Windows:
    """Pack the instants of all windows for `window_errors`.

    Parameters
    ----------
    sun : array_like, shape (T, 3)
        Unit vectors to the sun: east, north, up. [1]
    starts : array_like of int, shape (W + 1,)
        Window w contains the instants starts[w] to starts[w + 1] - 1.
    weights : array_like, shape (T,), optional
        Weight of each instant, 1 by default; instants with zero weight are omitted. [1]

    Returns
    -------
    Windows
    """
    east, north, up = np.asarray(sun, np.float64).T
    factors = np.ones(up.size) if weights is None else np.asarray(weights, np.float64)
    counts = factors > 0.0
    level = np.sqrt(east * east + north * north)
    zenith = level == 0.0
    length = np.where(zenith, 1.0, level)
    rows = np.stack((np.where(zenith, 1.0, east / length), -north / length, level, up))
    return Windows(
        np.ascontiguousarray(rows[:, counts]),
        factors[counts],
        np.concatenate(([0], np.cumsum(counts)))[np.asarray(starts)],
    )


def window_errors(
    model: int,
    windows: Windows,
    tilt: ArrayLike,
    direction: ArrayLike,
    home_azimuth: ArrayLike = 0.0,
    home_elevation: ArrayLike = 0.0,
    tolerance: ArrayLike = math.inf,
    *,
    azimuth_reference: ArrayLike = 0.0,
    non_orthogonality: ArrayLike = 0.0,
    collimation: ArrayLike = 0.0,
) -> tuple[Floats, Floats, Floats]:
    """Return the mean, maximum and clipped mean pointing error of each window, for each parameter combination.

    Parameters
    ----------
    model : int
        `RIGID` or `UNTILTED_HOME_AXES`.
    windows : Windows
        Sun positions, from `pack_windows`.
    tilt, direction : array_like
        Tilt of the azimuth axis, and direction towards which the foot of the axis moves: 0 for south, positive to the
        west. [rad]
    home_azimuth, home_elevation : array_like
        Offsets gamma1 and gamma2 of the focal axis' home position from due east. The home vector of the focal axis is
        (-cos gamma1 cos gamma2, -sin gamma1, cos gamma1 sin gamma2). [rad]
    tolerance : array_like
        Upper limit of the error in the clipped mean. [rad]
    azimuth_reference, non_orthogonality, collimation : array_like
        Three mount errors. [rad] The azimuth reference is an excess rotation about the azimuth axis, clockwise seen
        from above. The non-orthogonality is the angle by which the right-hand end of the elevation axis, seen along the
        home focal axis, is below the plane normal to the azimuth axis. The collimation is the angle between the
        focal axis and the plane normal to the elevation axis, positive towards the right-hand end of this axis.

    Returns
    -------
    mean, largest, clipped : ndarray, shape (*parameters, W)
        Weighted mean of the error e, its maximum, and the weighted mean of min(e, tolerance). Values are NaN if a
        window has no instant with positive weight. The parameters broadcast against each other. [rad]
    """
    # In the chain of rotations, the azimuth offset applies only to the focal axis.
    # The sign of the offset is opposite to the sign of the collimation.
    across = np.asarray(home_azimuth) - np.asarray(collimation)
    mount = (tilt, direction, across, home_elevation, azimuth_reference, non_orthogonality, tolerance)
    *parameters, limits = np.broadcast_arrays(*np.atleast_1d(*mount))
    parameters = [np.asarray(values, np.float64).ravel() for values in parameters]
    chain = _chain(model, *parameters) - _chain(RIGID, *np.zeros((6, 1)))  # minus the chain of a mount without errors
    only_leans = (model == RIGID) & ~np.any(parameters[2:], axis=0)
    scale = np.where(only_leans, 2.0 * np.sin(0.5 * parameters[0]), 0.0)
    leans = np.stack((scale, np.sin(parameters[1]), np.cos(parameters[1])), axis=1)
    shape = np.broadcast_shapes(*map(np.shape, mount))
    errors = np.empty((3, limits.size, len(windows.starts) - 1))
    order, found = np.argsort(parameters[1], kind="stable"), np.empty_like(errors)
    table = chain.reshape(len(chain), 3, 9), leans, limits.ravel().astype(np.float64)
    _window_errors(*windows, *(values[order] for values in table), found)
    errors[:, order] = found
    mean, largest, clipped = errors.reshape(3, *shape, errors.shape[2])
    return mean, largest, clipped


def _chain(
    model: int, tilt: Floats, direction: Floats, across: Floats, lift: Floats, reference: Floats, askew: Floats
) -> Floats:
    """Return the coefficients of the focal axis as a function of psi and h, shape (C, 3, 3, 3).

    The last three axes of the array correspond to x, y, z; to 1, cos psi, sin psi; and to 1, cos h, sin h.
    """
    none = np.zeros_like(tilt)
    level, dip, raised = np.cos(askew), np.sin(askew), np.cos(across) * np.sin(lift)
    elevation_axis = np.stack((none, level, -dip))
    focal_axis = np.stack(
        (
            -np.cos(across) * np.cos(lift),
            -np.sin(across) * level + raised * dip,
            np.sin(across) * dip + raised * level,
        )
    )
    u = np.stack((np.cos(direction), -np.sin(direction), none))

    def lean(v: Floats) -> Floats:
        return np.stack(at_angle(turning(u, v), np.cos(tilt), np.sin(tilt)))

    azimuth_axis = lean(np.stack((none, none, none - 1.0)))
    if model == RIGID:
        elevation_axis, focal_axis = lean(elevation_axis), lean(focal_axis)
    still, along, across = np.stack([turning(azimuth_axis, part) for part in turning(elevation_axis, focal_axis)], 1)
    cosine, sine = np.cos(reference), np.sin(reference)
    turns = np.stack((still, along * cosine + across * sine, across * cosine - along * sine))
    return np.ascontiguousarray(turns.transpose(3, 2, 0, 1))


@kernel
def _window_errors(
    rows: Floats, weights: Floats, starts: Integers, chains: Floats, leans: Floats, limits: Floats, errors: Floats
) -> None:
    """Write `errors`, shape (3, C, W), for `chains` of shape (C, 3, 9) and `limits` of shape (C,).

    `leans`, shape (C, 3), contains a scale, and the sine and cosine of the direction. If tilt is the only error of a
    rigid mount, the chord is scale |u x s|, where s is the direction to the sun. The scale of all other mounts is 0.
    Mounts with small tilts in the same direction share the sums of the powers of |u x s|.
    """
    windows, arc, total = len(starts) - 1, np.empty(weights.size), np.full(len(starts) - 1, math.nan)
    for w in range(windows):
        if starts[w] < starts[w + 1]:
            total[w] = np.sum(weights[starts[w] : starts[w + 1]])
    sums, top = np.zeros((windows, len(ARC))), np.zeros(windows)
    last_west = last_south = math.nan
    for c in range(len(chains)):
        scale, west, south = leans[c, 0], leans[c, 1], leans[c, 2]
        if 0.0 < scale < SMALL and limits[c] == math.inf:
            if west != last_west or south != last_south:
                last_west, last_south = west, south
                _sum_powers(rows, weights, starts, west, south, arc, sums, top)
            for w in range(windows):
                series = 0.0
                for j in range(len(ARC) - 1, -1, -1):
                    series = ARC[j] * sums[w, j] + scale * scale * series
                errors[0, c, w] = errors[2, c, w] = scale * series / total[w]
                largest = 2.0 * math.asin(0.5 * scale * top[w])
                errors[1, c, w] = largest if errors[0, c, w] == errors[0, c, w] else math.nan
            continue
        x0, x1, x2, x3, x4, x5, x6, x7, x8 = _nine(chains[c, 0])
        y0, y1, y2, y3, y4, y5, y6, y7, y8 = _nine(chains[c, 1])
        z0, z1, z2, z3, z4, z5, z6, z7, z8 = _nine(chains[c, 2])
        small = np.sum(np.abs(chains[c])) < SMALL  # every chord is then small as well
        for t in range(arc.size):
            a, b, h, v = rows[0, t], rows[1, t], rows[2, t], rows[3, t]
            x = x0 + x1 * h + x2 * v + a * (x3 + x4 * h + x5 * v) + b * (x6 + x7 * h + x8 * v)
            y = y0 + y1 * h + y2 * v + a * (y3 + y4 * h + y5 * v) + b * (y6 + y7 * h + y8 * v)
            z = z0 + z1 * h + z2 * v + a * (z3 + z4 * h + z5 * v) + b * (z6 + z7 * h + z8 * v)
            arc[t] = x * x + y * y + z * z
        if small:
            for t in range(arc.size):
                q = arc[t]  # square of a chord
                tail = q * (ARC[4] + q * (ARC[5] + q * (ARC[6] + q * ARC[7])))
                arc[t] = math.sqrt(q) * (1.0 + q * (ARC[1] + q * (ARC[2] + q * (ARC[3] + tail))))
        else:
            for t in range(arc.size):
                arc[t] = 2.0 * math.asin(min(0.5 * math.sqrt(arc[t]), 1.0))
        for w in range(windows):
            mean = largest = clipped = 0.0
            for t in range(starts[w], starts[w + 1]):
                mean, largest = mean + weights[t] * arc[t], max(largest, arc[t])
            if largest > limits[c]:
                for t in range(starts[w], starts[w + 1]):
                    clipped += weights[t] * min(arc[t], limits[c])
            else:
                clipped = mean
            errors[0, c, w], errors[2, c, w] = mean / total[w], min(clipped / total[w], limits[c])
            errors[1, c, w] = largest if mean / total[w] == mean / total[w] else math.nan


@inline
def _nine(row):
    """Return the nine numbers of a row as scalars, so that loops do not load them at each instant."""
    return row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8]


@inline
def _sum_powers(rows, weights, starts, west, south, length, sums, top):
    """Sum the odd powers of |u x s| over each window, and find the maximum of |u x s|."""
    for t in range(length.size):
        along = rows[2, t] * (south * rows[1, t] - west * rows[0, t])
        length[t] = math.sqrt(along * along + rows[3, t] * rows[3, t])
    for w in range(len(top)):
        sums[w], top[w] = 0.0, 0.0
        for t in range(starts[w], starts[w + 1]):
            top[w] = max(top[w], length[t])
            power = length[t] * weights[t]
            for j in range(len(ARC)):
                sums[w, j] += power
                power *= length[t] * length[t]

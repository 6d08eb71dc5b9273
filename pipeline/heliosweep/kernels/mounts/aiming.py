"""Aiming of two-axis mounts with six angular errors, exact, and the mirror at given angles.

The mount's frame has the rows Q (x, y zero bore, z primary axis) in the world frame (x east, y north, z up). With the
encoder angles g (azimuth about the primary axis, clockwise seen from its end) and a (elevation), and the errors
g0, a0 (encoder references), te, tn (tilt of the primary axis, a rotation vector about the frame's x and y), eta
(non-orthogonality of the axes) and mu (collimation: the normal is askew to the bore), in the order of `ERRORS`,

    n = Q^T Rtilt(te, tn) Rz(-(g + g0)) Ry(eta) Rx(a + a0) (sin mu, cos mu, 0)
    P = C + Q^T [Rtilt (h u + Rz(-(g + g0)) ((0, q, 0) + Ry(eta) Rx(a + a0) (0, r, 0))) - h u]

with the mirror offset r along the bore, the axis offset q and the height h of the pivot above the base that tilts:
straight below it, u = Q (0, 0, 1), for any direction of the primary axis.

In the frame of the tilted primary axis, with the sun s, the aim point at d from the pivot's base point and the mirror
centre at c, the normal is n = unit(s + unit(d - c)); it gives the angles, and the angles give the centre c' = F(c).
Newton's method on c = F(c): a change of c moves the two angles by G dc, and they move the centre by C, so that

    c* = F(c) + C v,   (1 - G C) v = G (F(c) - c)

with a system of two by two. Two steps are the rule, more if the offsets are not small compared with the distance.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.kinematics import back, bore, mount_frame, point, tilt_matrix, times, turn
from heliosweep.kernels.spots.receiver import BLIND_CONE, NO_SUN, REACHES, TOO_NEAR
from heliosweep.kernels.vectors import dot, minus, mixed, scaled

_STEPS = 40
_LAST_TURN = 1e-14
"""Squared step of the angles after which the error, of the order of its square, is below rounding. [rad^2]"""
_LAST_MOVE = 1e-12
"""Squared distance of F(c) from c, over the squared distance of the aim point, above which no step is the last."""
_LEVEL = 1e-12
"""Cosine of an elevation below which the mirror is as good as along its primary axis."""


@inline
def known_mount(errors, frame, to_target, pedestal):
    """Return Rtilt^T Q, the aim point d [m], and cosine and sine of eta and mu of a mount with known errors.

    `errors` are six numbers [rad], `frame` the rows of Q, `to_target` the vector from the pivot to the aim point, and
    `pedestal` the offset h [m]. The tilt rotates about the base; the centre is counted from the tilted pivot.
    """
    tilt = tilt_matrix(errors[2], errors[3])
    first, second, third = (
        back(tilt, (frame[0][0], frame[1][0], frame[2][0])),
        back(tilt, (frame[0][1], frame[1][1], frame[2][1])),
        back(tilt, (frame[0][2], frame[1][2], frame[2][2])),
    )
    matrix = (
        (first[0], second[0], third[0]), (first[1], second[1], third[1]), (first[2], second[2], third[2])
    )  # fmt: skip
    up = frame[0][2] * pedestal, frame[1][2] * pedestal, frame[2][2] * pedestal
    d = mixed(1.0, back(tilt, mixed(1.0, times(frame, to_target), 1.0, up)), -1.0, up)
    return matrix, d, (math.cos(errors[4]), math.sin(errors[4]), math.cos(errors[5]), math.sin(errors[5]))


@inline
def aimed(mount, sun, offset, axis_offset):
    """Aim a mount from `known_mount` at a sun in the world frame.

    Returns cosine and sine of g + g0 and of a + a0, and the status: `REACHES`, `NO_SUN`, `TOO_NEAR` (offsets not
    smaller than the distance) or `BLIND_CONE` (the mount cannot point there). The angles are undefined but for the
    first. `offset` and `axis_offset` are r and q. [m]
    """
    matrix, d, (ce, se, cm, sm) = mount
    s, far, reach = times(matrix, sun), dot(d, d), abs(offset) + abs(axis_offset)
    n, t, inverse = _half_way(s, d, (0.0, 0.0, 0.0))
    cg, sg, ca, sa, margin = point(n, ce, se, cm, sm)
    status = REACHES
    if not (sun[2] > 0.0 and sun[0] + sun[1] == sun[0] + sun[1]):
        status = NO_SUN
    elif not reach * reach < far:
        status = TOO_NEAR
    elif reach > 0.0:
        c, last, steps = (0.0, 0.0, 0.0), False, 0
        while not last and steps < _STEPS:
            c, last = _newton(c, n, t, inverse, (cg, sg, ca, sa), margin, (ce, se, cm, sm), offset, axis_offset, far)
            n, t, inverse = _half_way(s, d, c)
            cg, sg, ca, sa, margin = point(n, ce, se, cm, sm)
            steps += 1
        status = status if last else BLIND_CONE
    if status == REACHES and not margin >= 0.0:
        status = BLIND_CONE
    return (cg, sg, ca, sa), status


@inline
def _half_way(s, d, c):
    """Return the normal that reflects s along d - c, the unit vector t along it, and 1 / (|d - c| |s + t|)."""
    way = minus(d, c)
    distance = math.sqrt(dot(way, way))
    middle = mixed(distance, s, 1.0, way)
    length = math.sqrt(dot(middle, middle))
    return scaled(1.0 / length, middle), scaled(1.0 / distance, way), 1.0 / length


@inline
def _newton(c, n, t, inverse, angles, margin, askew, offset, axis_offset, far):
    """Return Newton's next centre, and True if it is the last."""
    (cg, sg, ca, sa), (ce, se, cm, sm) = angles, askew
    # centre F(c), and the columns of C: by a, (x, y, z), and by g, (fy, -fx, 0)
    fx, fy, fz = bore(ca, sa, ce, se, 0.0, offset)
    fx, fy = turn(cg, sg, fx, fy + axis_offset)
    x, y, z = bore(-sa, ca, ce, se, 0.0, offset)
    x, y = turn(cg, sg, x, y)
    by_a, by_g, move = (x, y, z), (fy, -fx, 0.0), minus((fx, fy, fz), c)
    # rows of G: t moves by -(1 - t t) dc / distance, n by (1 - n n) dt / length
    level = max(n[0] * n[0] + n[1] * n[1], _LEVEL * _LEVEL)
    by, bx = cm * ca, ce * sm + se * (cm * sa)
    slope = max(ce * by, _LEVEL)
    rise = (-n[0] * n[2], -n[1] * n[2], n[0] * n[0] + n[1] * n[1])
    per_slope, per_level = inverse / slope, 1.0 / level
    a_row = mixed(-per_slope, rise, per_slope * dot(rise, t), t)
    swing = (n[1], -n[0], 0.0)
    lean = cm * (ca * se * by + bx * sa) * per_level
    g_row = minus(scaled(inverse * per_level, mixed(-1.0, swing, dot(swing, t), t)), scaled(lean, a_row))
    aa, ag, ga, gg = 1.0 - dot(a_row, by_a), -dot(a_row, by_g), -dot(g_row, by_a), 1.0 - dot(g_row, by_g)
    fa, fg, inverse = dot(a_row, move), dot(g_row, move), 1.0 / (aa * gg - ag * ga)
    va, vg = inverse * (gg * fa - ag * fg), inverse * (aa * fg - ga * fa)
    # far from the solution, or if the mount cannot point there yet: a step of the fixed point alone
    if not (margin >= 0.0 and va * va + vg * vg < 1.0):
        va, vg = 0.0, 0.0
    last = va * va + vg * vg <= _LAST_TURN and dot(move, move) <= _LAST_MOVE * far
    moved = mixed(va, by_a, vg, by_g)
    return (fx + moved[0], fy + moved[1], fz + moved[2]), last


def mount_frames(kind: int, latitude: float, axis_azimuth: float, to_target: ArrayLike) -> Floats:
    """Axes of mounts.

    Parameters
    ----------
    kind : int
        `AZIMUTH_ELEVATION`, `TARGET_ALIGNED`, `POLAR` or `TILT_ROLL` of `kinematics`.
    latitude : float
        Geographic latitude, of polar mounts. [rad]
    axis_azimuth : float
        Azimuth of the primary axis of tilt-roll mounts, from north, clockwise. [rad]
    to_target : array_like, shape (..., 3)
        From the pivots to the aim point. [m]

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rows Q: x, y (zero bore) and z (primary axis) in the world frame. [1]
    """
    vectors = np.asarray(to_target, np.float64)
    frames = [
        mount_frame(int(kind), float(latitude), float(axis_azimuth), tuple(each))
        for each in vectors.reshape(-1, 3).tolist()
    ]
    return np.reshape(frames, (*vectors.shape, 3))


def aim(
    frame: ArrayLike,
    sun: ArrayLike,
    to_target: ArrayLike,
    errors: ArrayLike,
    offsets: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Floats:
    """Encoder angles at which mounts with known errors send the beam from the mirror centre to the aim point.

    Parameters
    ----------
    frame : array_like, shape (..., 3, 3)
        Rows Q, from `mount_frames`; arguments broadcast. [1]
    sun : array_like, shape (..., 3)
        Unit vectors to the sun. [1]
    to_target : array_like, shape (..., 3)
        From the pivots to the aim point. [m]
    errors : array_like, shape (..., 6)
        Errors in the order of `ERRORS`. [rad]
    offsets : tuple of float
        Mirror offset r along the bore, axis offset q, height h of the pivot above the base that tilts. [m]

    Returns
    -------
    ndarray, shape (..., 2)
        Encoder angles g and a, from -pi to pi; NaN if the sun is at or below the horizon, in the blind cone, and if the
        offsets are not smaller than the distance. [rad]
    """
    frames = np.asarray(frame, np.float64)
    arrays = [
        frames.reshape(*frames.shape[:-2], 9),
        *(np.asarray(each, np.float64) for each in (sun, to_target, errors)),
    ]
    shape = np.broadcast_shapes(*(each.shape[:-1] for each in arrays))
    wide = [np.broadcast_to(each, (*shape, each.shape[-1])).reshape(-1, each.shape[-1]) for each in arrays]
    return _aim(np.concatenate(wide, axis=1), np.array(offsets, np.float64)).reshape(*shape, 2)


@kernel
def _aim(rows: Floats, offsets: Floats) -> Floats:
    """Aim the mounts of rows of frame, sun, target and errors, shape (N, 21)."""
    angles = np.full((len(rows), 2), math.nan)
    for i in range(len(rows)):
        row = rows[i]
        frame = (row[0], row[1], row[2]), (row[3], row[4], row[5]), (row[6], row[7], row[8])
        errors = row[15], row[16], row[17], row[18], row[19], row[20]
        mount = known_mount(errors, frame, (row[12], row[13], row[14]), offsets[2])
        (cg, sg, ca, sa), status = aimed(mount, (row[9], row[10], row[11]), offsets[0], offsets[1])
        if status == REACHES:
            c, s = math.cos(errors[0]), math.sin(errors[0])
            angles[i, 0] = math.atan2(sg * c - cg * s, cg * c + sg * s)
            c, s = math.cos(errors[1]), math.sin(errors[1])
            angles[i, 1] = math.atan2(sa * c - ca * s, ca * c + sa * s)
    return angles

"""Aiming of two-axis mounts with six angular errors: exact, for a packet of lanes at once.

The mount's frame has the rows Q (x, y zero bore, z primary axis) in the world frame (x east, y north, z up). With the
encoder angles g (azimuth about the primary axis, clockwise seen from its end) and a (elevation), and the errors
g0, a0 (encoder references), te, tn (tilt of the primary axis, a rotation vector about the frame's x and y), eta
(non-orthogonality of the axes) and mu (collimation: the normal stands askew to the bore), in the order of `ERRORS`,

    n = Q^T Rtilt(te, tn) Rz(-(g + g0)) Ry(eta) Rx(a + a0) (sin mu, cos mu, 0)
    P = C + Q^T [Rtilt (h u + Rz(-(g + g0)) ((0, q, 0) + Ry(eta) Rx(a + a0) (0, r, 0))) - h u]

with the mirror offset r along the bore, the axis offset q and the height h of the pivot above the base that tilts:
straight below it, u = Q (0, 0, 1), whichever way the primary axis points.

In the frame of the tilted primary axis, with the sun s, the aim point at d from the pivot's base point and the mirror
centre at c, the normal wanted is n = unit(s + unit(d - c)); it gives the angles, and the angles give the centre c' =
F(c). Newton's method on c = F(c): a change of c moves the two angles by G dc, and they move the centre by C, so that

    c* = F(c) + C v,   (1 - G C) v = G (F(c) - c)

with a system of two by two. Two steps are the rule, more where the offsets are not small against the distance. Each
lane stops for itself, so that its bits do not depend on the lanes beside it.

Rows of a block have room for `PACKET` lanes each, at fixed offsets of one flat array, because such loops turn into
vector code. Angles are pairs of cosine and sine: there is no trigonometric function for a spot.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.kinematics import TERMS, back, bore, error_terms, mount_frame, point, times, turn
from heliosweep.kernels.spots.receiver import BLIND_CONE, NO_SUN, REACHES, TOO_NEAR
from heliosweep.kernels.vectors import PACKET

AIM_ROWS = 11
"""Rows of what to aim: sun s (0 to 2), unit, and aim point d (3 to 5) in the frame of the tilted primary axis; cosine
and sine of eta and of mu (6 to 9); whether the sun is up (10), 1 or 0."""
KNOWN = 16
"""Numbers that `known_record` makes of a mount."""
STATE_ROWS = 5
"""Rows of where the mount stands: cosine and sine of g + g0 and of a + a0 (0 to 3), NaN without; status (4)."""
WORK_ROWS = 11
"""Rows of the iteration: centre c (0 to 2), whether the lane still moves (3), 1 or 0, and from the last centre the
normal n (4 to 6), the unit vector t (7 to 9) and 1 / (|d - c| |s + t|) (10)."""

_STEPS = 40
_LAST_TURN = 1e-14
"""Squared step of the angles after which the error, of the order of its square, is below rounding. [rad^2]"""
_LAST_MOVE = 1e-12
"""Squared distance of F(c) from c, over the squared distance of the aim point, above which no step is the last."""
_LEVEL = 1e-12
"""Cosine of an elevation below which the mirror is as good as along its primary axis."""


@kernel
def aim_lanes(rows: Floats, state: Floats, work: Floats, offset: float, axis_offset: float, lanes: int) -> int:
    """Aim each lane of a packet; returns the most steps that a lane took.

    `rows` has the `AIM_ROWS`, `state` gets the `STATE_ROWS` of angles and status: `REACHES`, `NO_SUN`, `TOO_NEAR`
    (offsets not smaller than the distance) or `BLIND_CONE` (no way to point there); `work` is room for `WORK_ROWS`;
    `offset` and `axis_offset` are r and q. [m]
    """
    reach = abs(offset) + abs(axis_offset)
    for k in range(lanes):
        dx, dy, dz = rows[3 * PACKET + k], rows[4 * PACKET + k], rows[5 * PACKET + k]
        far = reach * reach < dx * dx + dy * dy + dz * dz
        work[k], work[PACKET + k], work[2 * PACKET + k] = 0.0, 0.0, 0.0
        work[3 * PACKET + k] = rows[10 * PACKET + k] if far else 0.0
    steps, pending = 0, 1
    while pending > 0 and steps < _STEPS:
        _normals(rows, work, lanes)
        _points(rows, work, state, lanes)
        _steps(rows, work, state, offset, axis_offset, lanes)
        pending = 0
        for k in range(lanes):
            pending += 1 if work[3 * PACKET + k] > 0.0 else 0
        steps += 1
    _normals(rows, work, lanes)
    _points(rows, work, state, lanes)
    for k in range(lanes):
        dx, dy, dz = rows[3 * PACKET + k], rows[4 * PACKET + k], rows[5 * PACKET + k]
        far = reach * reach < dx * dx + dy * dy + dz * dz
        found = work[3 * PACKET + k] == 0.0
        status = REACHES if (found and state[4 * PACKET + k] >= 0.0) else BLIND_CONE
        status = status if far else TOO_NEAR
        status = status if rows[10 * PACKET + k] > 0.0 else NO_SUN
        good = status == REACHES
        for m in range(4):
            state[m * PACKET + k] = state[m * PACKET + k] if good else math.nan
        state[4 * PACKET + k] = status
    return steps


@inline
def _normals(rows, work, lanes):
    """Normals that reflect s along d - c, unit vectors t along it, and 1 / (|d - c| |s + t|).

    Of s |d - c| + d - c, so that one division serves both lengths.
    """
    for k in range(lanes):
        sx, sy, sz = rows[k], rows[PACKET + k], rows[2 * PACKET + k]
        dx, dy = rows[3 * PACKET + k] - work[k], rows[4 * PACKET + k] - work[PACKET + k]
        dz = rows[5 * PACKET + k] - work[2 * PACKET + k]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        nx, ny, nz = sx * distance + dx, sy * distance + dy, sz * distance + dz
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        both = 1.0 / (distance * length)
        scale, inverse = length * both, distance * both
        work[4 * PACKET + k], work[5 * PACKET + k], work[6 * PACKET + k] = nx * inverse, ny * inverse, nz * inverse
        work[7 * PACKET + k], work[8 * PACKET + k], work[9 * PACKET + k] = dx * scale, dy * scale, dz * scale
        work[10 * PACKET + k] = inverse


@inline
def _points(rows, work, state, lanes):
    """Angles that give the normals, and in the last row of the state the room that is left, see `point`."""
    for k in range(lanes):
        nx, ny, nz = work[4 * PACKET + k], work[5 * PACKET + k], work[6 * PACKET + k]
        ce, se, cm, sm = rows[6 * PACKET + k], rows[7 * PACKET + k], rows[8 * PACKET + k], rows[9 * PACKET + k]
        cg, sg, ca, sa, room = point(nx, ny, nz, ce, se, cm, sm)
        state[k], state[PACKET + k], state[2 * PACKET + k], state[3 * PACKET + k] = cg, sg, ca, sa
        state[4 * PACKET + k] = room


@inline
def _steps(rows, work, state, offset, axis_offset, lanes):
    """Newton's next centres, and whether they are the last; of open lanes alone."""
    for k in range(lanes):
        cx, cy, cz, open_lane = work[k], work[PACKET + k], work[2 * PACKET + k], work[3 * PACKET + k]
        nx, ny, nz = work[4 * PACKET + k], work[5 * PACKET + k], work[6 * PACKET + k]
        tx, ty, tz, inverse = work[7 * PACKET + k], work[8 * PACKET + k], work[9 * PACKET + k], work[10 * PACKET + k]
        cg, sg, ca, sa = state[k], state[PACKET + k], state[2 * PACKET + k], state[3 * PACKET + k]
        room = state[4 * PACKET + k]
        dx, dy, dz = rows[3 * PACKET + k], rows[4 * PACKET + k], rows[5 * PACKET + k]
        ce, se, cm, sm = rows[6 * PACKET + k], rows[7 * PACKET + k], rows[8 * PACKET + k], rows[9 * PACKET + k]
        # Centre F(c), and columns of C: by a (x, y, z) and by g (fy, -fx, 0).
        fx, fy, fz = bore(ca, sa, ce, se, 0.0, offset)
        fx, fy = turn(cg, sg, fx, fy + axis_offset)
        x, y, z = bore(-sa, ca, ce, se, 0.0, offset)
        x, y = turn(cg, sg, x, y)
        rx, ry, rz = fx - cx, fy - cy, fz - cz
        # Rows of G: t turns by -(1 - t t) dc / distance, n by (1 - n n) dt / length.
        level = max(nx * nx + ny * ny, _LEVEL * _LEVEL)
        by, bx = cm * ca, ce * sm + se * (cm * sa)
        slope = max(ce * by, _LEVEL)
        both = 1.0 / (slope * level)
        rise = -inverse * (both * level)
        along = tz - nz * (nx * tx + ny * ty + nz * tz)
        ax = rise * (-nx * nz - along * tx)
        ay = rise * (-ny * nz - along * ty)
        az = rise * (nx * nx + ny * ny - along * tz)
        swing = -inverse * (both * slope)
        along = ny * tx - nx * ty
        lean = cm * (ca * se * by + bx * sa) * (both * slope)
        gx = swing * (ny - along * tx) - lean * ax
        gy = swing * (-nx - along * ty) - lean * ay
        gz = swing * (-along * tz) - lean * az
        aa, ag = 1.0 - (ax * x + ay * y + az * z), -(ax * fy - ay * fx)
        ga, gg = -(gx * x + gy * y + gz * z), 1.0 - (gx * fy - gy * fx)
        fa, fg = ax * rx + ay * ry + az * rz, gx * rx + gy * ry + gz * rz
        inverse = 1.0 / (aa * gg - ag * ga)
        va, vg = inverse * (gg * fa - ag * fg), inverse * (aa * fg - ga * fa)
        # Far from the solution, or where the mount cannot point yet: a step of the fixed point alone.
        sure = room >= 0.0 and va * va + vg * vg < 1.0
        va, vg = va if sure else 0.0, vg if sure else 0.0
        last = va * va + vg * vg <= _LAST_TURN and (
            rx * rx + ry * ry + rz * rz <= _LAST_MOVE * (dx * dx + dy * dy + dz * dz)
        )
        x, y, z = fx + x * va + fy * vg, fy + y * va - fx * vg, fz + z * va
        work[k] = x if open_lane > 0.0 else cx
        work[PACKET + k] = y if open_lane > 0.0 else cy
        work[2 * PACKET + k] = z if open_lane > 0.0 else cz
        work[3 * PACKET + k] = 0.0 if last else open_lane


@inline
def known_record(
    dx: float,
    dy: float,
    dz: float,
    frame: Floats,
    terms: Floats,
    pedestal: float,
    record: Floats,
    to: int = 0,
    apart: int = 1,
    f: int = 0,
    t: int = 0,
) -> None:
    """Write what all lanes of one mount share: `KNOWN` numbers.

    They are Rtilt^T Q by rows (0 to 8), the aim point d (9 to 11), cosine and sine of eta and mu (12 to 15). Of the way
    from the pivot to the aim point [m], the frame of `kinematics.mount_frame` from place `f` on, the terms of the known
    errors of `error_terms` from `t` on and the offset h [m], to the record from place `to` on. Arrays have one number
    after the other, or so many `apart`: a lane of rows.
    """
    for m in range(3):
        g = f + m * apart
        x, y, z = back(terms, t + 8 * apart, frame[g], frame[g + 3 * apart], frame[g + 6 * apart], apart)
        r = to + m * apart
        record[r], record[r + 3 * apart], record[r + 6 * apart] = x, y, z
    # The tilt turns about the base, below the pivot; the centre is counted from the pivot as it then stands.
    x, y, z = times(frame, f, dx, dy, dz, apart)
    ux, uy, uz = pedestal * frame[f + 2 * apart], pedestal * frame[f + 5 * apart], pedestal * frame[f + 8 * apart]
    x, y, z = back(terms, t + 8 * apart, x + ux, y + uy, z + uz, apart)
    record[to + 9 * apart], record[to + 10 * apart], record[to + 11 * apart] = x - ux, y - uy, z - uz
    for m in range(4):
        record[to + (12 + m) * apart] = terms[t + (4 + m) * apart]


@inline
def aim_rows(record: Floats, sun: Floats, first: int, last: int, rows: Floats, at: int = 0, apart: int = 1) -> None:
    """Write lanes first..last of the rows of `aim_lanes`, all of one mount: its record begins in place `at`.

    `sun` has rows x, y, z of the unit vectors to the sun in the world frame, `PACKET` apart; the numbers of the record
    of `known_record` are so many `apart`.
    """
    xx, xy, xz = record[at], record[at + apart], record[at + 2 * apart]
    yx, yy, yz = record[at + 3 * apart], record[at + 4 * apart], record[at + 5 * apart]
    zx, zy, zz = record[at + 6 * apart], record[at + 7 * apart], record[at + 8 * apart]
    dx, dy, dz = record[at + 9 * apart], record[at + 10 * apart], record[at + 11 * apart]
    ce, se, cm, sm = record[at + 12 * apart], record[at + 13 * apart], record[at + 14 * apart], record[at + 15 * apart]
    for k in range(first, last):
        _aim_row(xx, xy, xz, yx, yy, yz, zx, zy, zz, dx, dy, dz, ce, se, cm, sm, sun, k, rows)


@inline
def aim_each(record: Floats, sun: Floats, lanes: int, rows: Floats) -> None:
    """The same where each lane is of another mount: rows of `known_record`, `PACKET` numbers apart."""
    for k in range(lanes):
        xx, xy, xz = record[k], record[PACKET + k], record[2 * PACKET + k]
        yx, yy, yz = record[3 * PACKET + k], record[4 * PACKET + k], record[5 * PACKET + k]
        zx, zy, zz = record[6 * PACKET + k], record[7 * PACKET + k], record[8 * PACKET + k]
        dx, dy, dz = record[9 * PACKET + k], record[10 * PACKET + k], record[11 * PACKET + k]
        ce, se = record[12 * PACKET + k], record[13 * PACKET + k]
        cm, sm = record[14 * PACKET + k], record[15 * PACKET + k]
        _aim_row(xx, xy, xz, yx, yy, yz, zx, zy, zz, dx, dy, dz, ce, se, cm, sm, sun, k, rows)


@inline
def _aim_row(xx, xy, xz, yx, yy, yz, zx, zy, zz, dx, dy, dz, ce, se, cm, sm, sun, k, rows):
    """Write a lane of the rows."""
    sx, sy, sz = sun[k], sun[PACKET + k], sun[2 * PACKET + k]
    rows[k] = xx * sx + xy * sy + xz * sz
    rows[PACKET + k] = yx * sx + yy * sy + yz * sz
    rows[2 * PACKET + k] = zx * sx + zy * sy + zz * sz
    rows[3 * PACKET + k], rows[4 * PACKET + k], rows[5 * PACKET + k] = dx, dy, dz
    rows[6 * PACKET + k], rows[7 * PACKET + k] = ce, se
    rows[8 * PACKET + k], rows[9 * PACKET + k] = cm, sm
    rows[10 * PACKET + k] = 1.0 if (sz > 0.0 and sx + sy == sx + sy) else 0.0


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
    frames = np.empty((*vectors.shape[:-1], 3, 3))
    for frame, (dx, dy, dz) in zip(frames.reshape(-1, 9), vectors.reshape(-1, 3).tolist(), strict=True):
        mount_frame(int(kind), float(latitude), float(axis_azimuth), dx, dy, dz, frame)
    return frames


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
        Encoder angles g and a, from -pi to pi; NaN with the sun at or below the horizon, in the blind cone, and where
        the offsets are not smaller than the distance. [rad]
    """
    shape, (frames, suns, targets, six) = _flat((frame, 2), (sun, 1), (to_target, 1), (errors, 1))
    angles = np.empty((len(six), 2))
    _aim(frames, suns, targets, six, np.array(offsets, np.float64), angles)
    return angles.reshape(*shape, 2)


def _flat(*arguments: tuple[ArrayLike, int]) -> tuple[tuple[int, ...], list[Floats]]:
    """Common shape of arguments without their last axes (given by number), and each as (N, all of those)."""
    arrays = [np.asarray(value, np.float64) for value, _ in arguments]
    kept = [array.shape[array.ndim - axes :] for array, (_, axes) in zip(arrays, arguments, strict=True)]
    shape = np.broadcast_shapes(*(a.shape[: a.ndim - len(k)] for a, k in zip(arrays, kept, strict=True)))
    wide = (np.broadcast_to(a, (*shape, *k)) for a, k in zip(arrays, kept, strict=True))
    return shape, [np.array(a, order="C").reshape(math.prod(shape), -1) for a in wide]


@kernel
def _aim(frames: Floats, sun: Floats, to_target: Floats, errors: Floats, offsets: Floats, angles: Floats) -> None:
    terms, record, suns = np.empty((PACKET, TERMS)), np.empty(KNOWN), np.empty(3 * PACKET)
    rows, state, work = np.empty(AIM_ROWS * PACKET), np.empty(STATE_ROWS * PACKET), np.empty(WORK_ROWS * PACKET)
    for first in range(0, len(errors), PACKET):
        lanes = min(PACKET, len(errors) - first)
        for k in range(lanes):
            i = first + k
            error_terms(errors[i], terms[k])
            dx, dy, dz = to_target[i, 0], to_target[i, 1], to_target[i, 2]
            known_record(dx, dy, dz, frames[i], terms[k], offsets[2], record)
            for c in range(3):
                suns[c * PACKET + k] = sun[i, c]
            aim_rows(record, suns, k, k + 1, rows)
        aim_lanes(rows, state, work, offsets[0], offsets[1], lanes)
        for k in range(lanes):
            cg, sg, ca, sa = state[k], state[PACKET + k], state[2 * PACKET + k], state[3 * PACKET + k]
            angles[first + k, 0] = math.atan2(*turn(terms[k, 0], -terms[k, 1], sg, cg))
            angles[first + k, 1] = math.atan2(*turn(terms[k, 2], -terms[k, 3], sa, ca))

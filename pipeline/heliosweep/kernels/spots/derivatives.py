"""Spots of mounts at given encoder angles, their derivatives by the six errors, and the losses of robust fits.

With the pieces of `aiming`, all in the frame of the mount: f = Rz(-(g + g0)) b is the bore askew, k = Rz(-(g + g0)) o
the arm to the mirror centre, n = Q^T Rtilt f the normal, P = C + Q^T (Rtilt (k + h u) - h u) the centre with the height
h of the pivot above the base, u = Q (0, 0, 1). The ray R = 2 (s.n) n - s from P meets the plane of the face at y = Y.p
and z = Z.p, p = P + l R, and

    dy = u.dP + v.dn,   u = Y - (Y.R / X.R) X,   v = 2 l ((u.n) s + (s.n) u),   z alike:

the ray moves with the centre and turns with the normal; what leads off the plane is undone along the ray. An error
turns f and k about an axis: u and v are brought to the frame where this is a coordinate axis, and the derivative is
the component of f x v + k x u along it. Of the tilts it is v.(dRtilt f) + u.(dRtilt (k + h u)).

Lanes are spots of one mount. Rows have room for `PACKET` lanes each, at fixed offsets of one flat array. Blocks hold
the derivatives of y and of z of each spot by the errors and predicted minus measured; `counted` is the weight of each
lane, 0 for those that are not used. Robust least squares makes weights, slope, variance and residuals of them.
"""

import math

import numpy as np

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.kinematics import back, bore, times, turn
from heliosweep.kernels.spots.least_squares import BLOCK, COLUMNS, total
from heliosweep.kernels.spots.receiver import REACHES, rows_of, trace
from heliosweep.kernels.vectors import PACKET, whole

SEEN_ROWS = 9
"""Rows of what is known of spots: unit vector to the sun (0 to 2), cosine and sine of the encoder angles g and a,
without g0 and a0 (3 to 6), measured y and z (7, 8)."""
PARAMETERS = 6
"""Errors of a mount; the first columns of a block of predictions are derivatives by them."""
RESIDUAL = 6
"""Column of the predicted minus the measured spots."""
STATUS = 7
"""Row of the status, a code of `receiver`."""


@kernel
def derivative_lanes(
    seen: Floats, first: int, terms: Floats, frame: Floats, face: Floats, lengths: Floats, out: Floats, lanes: int
) -> None:
    """Write the block of spots and derivatives of a packet.

    `seen` has the rows of what is known of the spots of all packets, `first` is the first spot of this one, a multiple
    of `PACKET`; `terms` are the errors, from `kinematics.error_terms`; `frame` and `face`, shape (9,), the rows of Q
    and of `receiver.face_axes`; `lengths`, shape (6,), the offsets r, q and h, and x, y, z from the pivot to the aim
    point [m]. `out` gets, in places `first // PACKET * BLOCK` on, rows of derivatives of y and of predicted minus
    measured y, NaN where there is no spot; the status; the same of z. [m/rad, m]
    """
    offset, axis_offset, pedestal, dx, dy, dz = lengths[0], lengths[1], lengths[2], lengths[3], lengths[4], lengths[5]
    ce, se, cm, sm = terms[4], terms[5], terms[6], terms[7]
    axes = rows_of(face)
    # Known not to be negative, or loads become gathers.
    at, to = max(first * SEEN_ROWS, 0), max(first // PACKET * BLOCK, 0)
    for k in range(lanes):
        s = seen[at + k], seen[at + PACKET + k], seen[at + 2 * PACKET + k]
        cg, sg = seen[at + 3 * PACKET + k], seen[at + 4 * PACKET + k]
        ca, sa = seen[at + 5 * PACKET + k], seen[at + 6 * PACKET + k]
        cg, sg = cg * terms[0] - sg * terms[1], sg * terms[0] + cg * terms[1]
        ca, sa = ca * terms[2] - sa * terms[3], sa * terms[2] + ca * terms[3]
        bx, by, bz = bore(ca, sa, ce, se, sm, cm)
        ox, oy, oz = bore(ca, sa, ce, se, 0.0, offset)
        fx, fy = turn(cg, sg, bx, by)
        kx, ky = turn(cg, sg, ox, oy + axis_offset)
        ux, uy, uz = pedestal * frame[2], pedestal * frame[5], pedestal * frame[8]
        f, arm = (fx, fy, bz), (kx + ux, ky + uy, oz + uz)
        n = back(frame, 0, *times(terms, 8, *f))
        px, py, pz = times(terms, 8, *arm)
        px, py, pz = back(frame, 0, px - ux, py - uy, pz - uz)
        p = px - dx, py - dy, pz - dz
        y, z, status = trace(p, n, s, axes)
        out[to + RESIDUAL * PACKET + k] = y - seen[at + 7 * PACKET + k]
        out[to + STATUS * PACKET + k] = status
        out[to + (COLUMNS + RESIDUAL) * PACKET + k] = z - seen[at + 8 * PACKET + k]

        lit = s[0] * n[0] + s[1] * n[1] + s[2] * n[2]
        ray = 2.0 * lit * n[0] - s[0], 2.0 * lit * n[1] - s[1], 2.0 * lit * n[2] - s[2]
        ax, ay, az = times(face, 0, *ray)
        length = -(face[0] * p[0] + face[1] * p[1] + face[2] * p[2]) / ax
        by_a = bore(-sa, ca, ce, se, 0.0, 1.0)
        by_mu = bore(ca, sa, ce, se, cm, -sm)
        real = status == REACHES
        tilted = times(terms, 17, *f), times(terms, 17, *arm), times(terms, 26, *f), times(terms, 26, *arm)
        stand = (cg, sg, cm, offset, length, lit, s, n, f, (kx, ky), (bx, bz), (ox, oz), by_a, by_mu, tilted)
        _slopes(real, ay / ax, face, 3, frame, terms, stand, out, to + k)
        _slopes(real, az / ax, face, 6, frame, terms, stand, out, to + COLUMNS * PACKET + k)


@inline
def _slopes(real, along, face, row, frame, terms, stand, out, to):
    """Write the derivatives of a coordinate of the spot, `along` = Y.R / X.R with the row Y (or Z) of the face."""
    cg, sg, cm, offset, length, lit, s, n, f, arm, (bx, bz), (ox, oz), by_a, by_mu, tilted = stand
    ux, uy, uz = face[row] - along * face[0], face[row + 1] - along * face[1], face[row + 2] - along * face[2]
    askew = ux * n[0] + uy * n[1] + uz * n[2]
    vx, vy, vz = askew * s[0] + lit * ux, askew * s[1] + lit * uy, askew * s[2] + lit * uz
    ux, uy, uz = times(frame, 0, ux, uy, uz)
    vx, vy, vz = times(frame, 0, 2.0 * length * vx, 2.0 * length * vy, 2.0 * length * vz)
    (x, y, z), (a, b, c), _, _ = tilted
    east = vx * x + vy * y + vz * z + ux * a + uy * b + uz * c
    _, _, (x, y, z), (a, b, c) = tilted
    north = vx * x + vy * y + vz * z + ux * a + uy * b + uz * c
    ux, uy, uz = back(terms, 8, ux, uy, uz)
    vx, vy, vz = back(terms, 8, vx, vy, vz)
    azimuth = vx * f[1] - vy * f[0] + ux * arm[1] - uy * arm[0]
    ux, uy = turn(cg, -sg, ux, uy)
    vx, vy = turn(cg, -sg, vx, vy)
    x, y, z = cm * vx + offset * ux, cm * vy + offset * uy, cm * vz + offset * uz
    elevation = x * by_a[0] + y * by_a[1] + z * by_a[2]
    across = vx * bz - vz * bx + ux * oz - uz * ox
    askew = vx * by_mu[0] + vy * by_mu[1] + vz * by_mu[2]
    out[to] = azimuth if real else math.nan
    out[to + PACKET] = elevation if real else math.nan
    out[to + 2 * PACKET] = east if real else math.nan
    out[to + 3 * PACKET] = north if real else math.nan
    out[to + 4 * PACKET] = across if real else math.nan
    out[to + 5 * PACKET] = askew if real else math.nan


@kernel
def seen_rows(sun: Floats, turns: Floats, position: Floats, seen: Floats) -> None:
    """Bring the spots of a mount into packets, see `SEEN_ROWS`; the last one is filled up with copies of its last lane.

    Of unit vectors to the sun (S, 3), cosine and sine of g, then of a (S, 4), and measured spots (S, 2) [m].
    """
    for first in range(0, len(sun), PACKET):
        lanes = min(PACKET, len(sun) - first)
        for k in range(whole(lanes)):
            i, to = first + min(k, lanes - 1), first * SEEN_ROWS + k
            for m in range(3):
                seen[to + m * PACKET] = sun[i, m]
            for m in range(4):
                seen[to + (3 + m) * PACKET] = turns[i, m]
            for m in range(2):
                seen[to + (7 + m) * PACKET] = position[i, m]


SQUARED, HUBER, CAUCHY = 0, 1, 2
"""Losses."""

ROOM = 3 * PACKET
"""Numbers of room for sums, and for losses and slopes of a packet."""

_SECOND = COLUMNS * PACKET
"""From a column of y to that of z."""
_OFF = RESIDUAL * PACKET


@kernel
def bend(square: float, loss: int) -> tuple[float, float, float]:
    """rho, its derivative rho' and rho' + 2 u rho'' at u = `square`: loss, weight and stiffness along a residual."""
    if loss == SQUARED or (loss == HUBER and square <= 1.0):
        return square, 1.0, 1.0
    if loss == HUBER:
        root = math.sqrt(square)
        return 2.0 * root - 1.0, 1.0 / root, 0.0
    return math.log1p(square), 1.0 / (1.0 + square), (1.0 - square) / (1.0 + square) ** 2


@inline
def _bends(rows, block, here, counted, loss, loss_scale, room):
    """Write rho (0 where a lane is not used) and rho' of the lanes of a block to rows 1 and 2 of the room."""
    at, first = max(block * BLOCK, 0), max(block * PACKET, 0)
    for k in range(here):
        y, z, weight = rows[at + _OFF + k], rows[at + _SECOND + _OFF + k], counted[first + k]
        room[PACKET + k] = weight * (y * y + z * z) / loss_scale**2 if weight > 0.0 else 0.0
    if loss == HUBER:
        for k in range(here):
            square = room[PACKET + k]
            root, far = np.sqrt(square), not square <= 1.0
            room[2 * PACKET + k] = 1.0 / root if far else 1.0
            room[PACKET + k] = 2.0 * root - 1.0 if far else square
    elif loss == CAUCHY:
        for k in range(here):
            room[2 * PACKET + k] = 1.0 / (1.0 + room[PACKET + k])
        for k in range(here):
            room[PACKET + k] = math.log1p(room[PACKET + k])
    else:
        for k in range(here):
            room[2 * PACKET + k] = 1.0


@kernel
def weigh(
    rows: Floats,
    lanes: int,
    parameters: int,
    counted: Floats,
    loss: int,
    loss_scale: float,
    weighted: Floats,
    room: Floats,
) -> float:
    """Fill the weighted blocks of the next step; returns the cost, infinite where a spot misses the receiver."""
    room[:PACKET] = 0.0
    for block in range((lanes + PACKET - 1) // PACKET):
        at, first, here = max(block * BLOCK, 0), max(block * PACKET, 0), min(PACKET, lanes - block * PACKET)
        _bends(rows, block, here, counted, loss, loss_scale, room)
        for k in range(here):
            room[k] += room[PACKET + k]
            room[2 * PACKET + k] = np.sqrt(counted[first + k] * room[2 * PACKET + k])
        for m in range(parameters + 1):
            column = at + (RESIDUAL if m == parameters else m) * PACKET
            to = at + m * PACKET
            for k in range(here):
                root = room[2 * PACKET + k]
                weighted[to + k] = root * rows[column + k] if root > 0.0 else 0.0
                weighted[to + _SECOND + k] = root * rows[column + _SECOND + k] if root > 0.0 else 0.0
    cost = 0.5 * loss_scale**2 * total(room)
    return cost if math.isfinite(cost) else np.inf


@kernel
def gradient(
    rows: Floats,
    lanes: int,
    parameters: int,
    counted: Floats,
    loss: int,
    loss_scale: float,
    slope: Floats,
    room: Floats,
) -> None:
    """Derivative of the cost by the errors."""
    slope[:] = 0.0
    for block in range((lanes + PACKET - 1) // PACKET):
        at, first, here = max(block * BLOCK, 0), max(block * PACKET, 0), min(PACKET, lanes - block * PACKET)
        _bends(rows, block, here, counted, loss, loss_scale, room)
        for m in range(parameters):
            column = at + m * PACKET
            room[:PACKET] = 0.0
            for k in range(here):
                y, z, weight = rows[at + _OFF + k], rows[at + _SECOND + _OFF + k], counted[first + k]
                along = rows[column + k] * y + rows[column + _SECOND + k] * z
                room[k] = weight * room[2 * PACKET + k] * along if weight > 0.0 else 0.0
            slope[m] += total(room)


@inline
def _place(i, m, column):
    """Place of the derivative of y (m = 0) or z (m = 1) of spot i by an error."""
    return i // PACKET * BLOCK + (m * COLUMNS + column) * PACKET + i % PACKET


@kernel
def variance_factor(
    rows: Floats, spots: int, parameters: int, used: int, counted: Floats, loss: int, loss_scale: float
) -> float:
    """Factor of (J^T W J)^-1 in the covariance, W without the weights of the loss; NaN without a degree of freedom."""
    equations = 2.0 * used
    influence, stiffness, stiffness_square = 0.0, 0.0, 0.0
    for i in range(spots):
        if counted[i] == 0.0:
            continue
        square = counted[i] * (rows[_place(i, 0, RESIDUAL)] ** 2 + rows[_place(i, 1, RESIDUAL)] ** 2)
        _, across, along = bend(square / loss_scale**2, loss)
        influence += across * across * square
        stiffness += across + along
        stiffness_square += across * across + along * along
    mean = stiffness / equations
    spread = stiffness_square / equations - mean * mean
    if equations <= parameters or mean <= 0.0:
        return np.nan
    correction = 1.0 + parameters / equations * spread / (mean * mean)
    return correction * correction * influence / (equations - parameters) / (mean * mean)


@kernel
def residuals(
    rows: Floats, parameters: int, counted: Floats, loss: int, loss_scale: float, values: Floats,
    right: Floats, residual: Floats, left_out: Floats,
) -> None:  # fmt: skip
    """Residuals (measured - predicted), and those where each prediction leaves its spot out, by one Newton step.

    With A = J H^-1 J^T, H the second derivative of the cost from its roots `values` and vectors `right`, and D the
    spot's own derivative of the influence, w rho' across its residual r and w (rho' + 2 u rho'') along it, it is
    r + A (I - D A)^-1 w rho' r: for the squared loss (I - w A)^-1 r.
    """
    half = np.empty((2, COLUMNS))
    for i in range(len(residual)):
        y, z = -rows[_place(i, 0, RESIDUAL)], -rows[_place(i, 1, RESIDUAL)]
        residual[i, 0], residual[i, 1] = y, z
        square = y * y + z * z
        _, slope, stiff = bend(counted[i] * square / loss_scale**2, loss)
        for m in range(2):
            for k in range(parameters):
                product = 0.0
                for j in range(parameters):
                    product += rows[_place(i, m, j)] * right[j, k]
                half[m, k] = product / values[k]
        a, b, c = 0.0, 0.0, 0.0
        for k in range(parameters):
            a += half[0, k] * half[0, k]
            b += half[0, k] * half[1, k]
            c += half[1, k] * half[1, k]
        share = counted[i] * slope
        turn = counted[i] * (stiff - slope) / square if square > 0.0 else 0.0
        d, e, f = share + turn * y * y, turn * y * z, share + turn * z * z
        p, q, r, s = 1.0 - d * a - e * b, -d * b - e * c, -e * a - f * b, 1.0 - e * b - f * c
        determinant = p * s - q * r
        larger = max(p, s)
        known = larger > 1e-9 and determinant > 1e-9 * larger  # else the spot alone determines a direction
        g, h = share * (s * y - q * z) / determinant, share * (p * z - r * y) / determinant
        left_out[i, 0] = y + a * g + b * h if known else np.nan
        left_out[i, 1] = z + b * g + c * h if known else np.nan

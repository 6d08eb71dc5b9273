"""Losses of spots, and what robust least squares makes of them: weights, slope, variance, residuals.

Blocks of `spot_derivatives.derivative_lanes` hold the derivatives of y and of z of each spot by the errors and
predicted minus measured; `counted` is the weight of each lane, 0 for those that are not used.
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.least_squares import BLOCK, COLUMNS, total
from heliosweep.kernels.packets import PACKET
from heliosweep.kernels.spot_derivatives import RESIDUAL

__all__ = ["CAUCHY", "HUBER", "ROOM", "SQUARED", "bend", "gradient", "residuals", "variance_factor", "weigh"]

SQUARED, HUBER, CAUCHY = 0, 1, 2
"""Losses."""

ROOM = 3 * PACKET
"""Numbers of room for sums, and for losses and slopes of a packet."""

_SECOND = COLUMNS * PACKET
"""From a column of y to that of z."""
_OFF = RESIDUAL * PACKET

Floats = NDArray[np.float64]


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
    """Where the derivative of y (m = 0) or z (m = 1) of spot i by an error stands."""
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

"""Losses of spots, and what robust least squares makes of them: weights, slope, variance, residuals.

Rows of shape (n, 2, LANES) hold the derivatives of y and of z of each spot by the errors and, behind them, predicted
minus measured; `counted` is the weight of each spot, 0 for those that are not used.
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.least_squares import LANES

__all__ = ["CAUCHY", "HUBER", "SQUARED", "bend", "gradient", "residuals", "variance_factor", "weigh"]

SQUARED, HUBER, CAUCHY = 0, 1, 2
"""Losses."""

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


@kernel
def weigh(rows: Floats, parameters: int, counted: Floats, loss: int, loss_scale: float, weighted: Floats) -> float:
    """Fill the weighted rows of the next step; returns the cost, infinite where a spot misses the receiver."""
    cost = 0.0
    for i in range(len(rows)):
        y, z = rows[i, 0, parameters], rows[i, 1, parameters]
        if counted[i] == 0.0:
            for k in range(LANES):
                weighted[2 * i, k], weighted[2 * i + 1, k] = 0.0, 0.0
            continue
        if not math.isfinite(y):
            return np.inf
        value, slope, _ = bend(counted[i] * (y * y + z * z) / loss_scale**2, loss)
        cost += 0.5 * loss_scale**2 * value
        root = math.sqrt(counted[i] * slope)
        for k in range(LANES):
            weighted[2 * i, k], weighted[2 * i + 1, k] = root * rows[i, 0, k], root * rows[i, 1, k]
    return cost


@kernel
def gradient(rows: Floats, parameters: int, counted: Floats, loss: int, loss_scale: float, slope: Floats) -> None:
    """Derivative of the cost by the errors."""
    slope[:] = 0.0
    for i in range(len(rows)):
        if counted[i] == 0.0:
            continue
        y, z = rows[i, 0, parameters], rows[i, 1, parameters]
        _, share, _ = bend(counted[i] * (y * y + z * z) / loss_scale**2, loss)
        for k in range(parameters):
            slope[k] += counted[i] * share * (rows[i, 0, k] * y + rows[i, 1, k] * z)


@kernel
def variance_factor(rows: Floats, parameters: int, used: int, counted: Floats, loss: int, loss_scale: float) -> float:
    """Factor of (J^T W J)^-1 in the covariance, W without the weights of the loss; NaN without a degree of freedom."""
    equations = 2.0 * used
    influence, stiffness, stiffness_square = 0.0, 0.0, 0.0
    for i in range(len(rows)):
        if counted[i] == 0.0:
            continue
        square = counted[i] * (rows[i, 0, parameters] ** 2 + rows[i, 1, parameters] ** 2)
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
    half = np.empty((2, LANES))
    for i in range(len(rows)):
        y, z = -rows[i, 0, parameters], -rows[i, 1, parameters]
        residual[i, 0], residual[i, 1] = y, z
        square = y * y + z * z
        _, slope, stiff = bend(counted[i] * square / loss_scale**2, loss)
        for m in range(2):
            for k in range(parameters):
                total = 0.0
                for j in range(parameters):
                    total += rows[i, m, j] * right[j, k]
                half[m, k] = total / values[k]
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

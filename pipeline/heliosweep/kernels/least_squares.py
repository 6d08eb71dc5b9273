"""Small dense least squares: orthogonalisation of tall matrices, singular values of small ones.

Rows have `LANES` numbers, so that a compiler can hold one in its registers: up to six columns of a matrix, and behind
them a right-hand side. The factors are those of modified Gram-Schmidt with the right-hand side as a further column,
which is as stable as Householder's method for least squares [1]_; singular values come from one-sided Jacobi rotations,
to full relative precision for a matrix as small as this [2]_. No normal equations: their condition is the square.

References
----------
.. [1] A. Bjorck, "Numerical Methods for Least Squares Problems", SIAM (1996), section 2.4
.. [2] J. Demmel and K. Veselic, "Jacobi's method is more accurate than QR", SIAM J. Matrix Anal. Appl. 13 (1992) 1204
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel

__all__ = ["LANES", "orthogonalise", "singular_values"]

LANES = 8
"""Numbers in a row."""

SWEEPS = 30
"""Sweeps of Jacobi rotations at the most; a matrix of six columns needs about six."""

Floats = NDArray[np.float64]


@kernel
def orthogonalise(rows: Floats, columns: int, upper: Floats) -> None:
    """Factor the first columns of a matrix and project what stands behind them.

    Parameters
    ----------
    rows : ndarray, shape (M, LANES)
        Matrix, then the right-hand side; replaced by orthogonal columns and the part of the right-hand side that is
        orthogonal to them all.
    columns : int
        Columns of the matrix.
    upper : ndarray, shape (LANES, LANES)
        Gets the triangular factor, and in column `columns` the right-hand side in terms of the orthonormal columns.
        Row j is zero where column j depends on those before it.
    """
    upper[:] = 0.0
    factors = np.empty(LANES)
    for j in range(columns):
        # Written out, so that sums and factors stay in registers; loops over an array go through memory.
        a, b, c, d, e, f, g, h = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(len(rows)):
            own = rows[i, j]
            a += own * rows[i, 0]
            b += own * rows[i, 1]
            c += own * rows[i, 2]
            d += own * rows[i, 3]
            e += own * rows[i, 4]
            f += own * rows[i, 5]
            g += own * rows[i, 6]
            h += own * rows[i, 7]
        factors[0], factors[1], factors[2], factors[3] = a, b, c, d
        factors[4], factors[5], factors[6], factors[7] = e, f, g, h
        square = factors[j]
        length = math.sqrt(square)
        for k in range(LANES):
            done = k < j or square <= 0.0
            upper[j, k] = 0.0 if done else factors[k] / length
            factors[k] = 0.0 if done or k == j else factors[k] / square
        a, b, c, d = factors[0], factors[1], factors[2], factors[3]
        e, f, g, h = factors[4], factors[5], factors[6], factors[7]
        for i in range(len(rows)):
            own = rows[i, j]
            rows[i, 0] -= own * a
            rows[i, 1] -= own * b
            rows[i, 2] -= own * c
            rows[i, 3] -= own * d
            rows[i, 4] -= own * e
            rows[i, 5] -= own * f
            rows[i, 6] -= own * g
            rows[i, 7] -= own * h


@kernel
def singular_values(upper: Floats, columns: int, values: Floats, right: Floats, projected: Floats) -> None:
    """Singular value decomposition of the triangular factor of `orthogonalise`.

    Parameters
    ----------
    upper : ndarray, shape (LANES, LANES)
        From `orthogonalise`; overwritten.
    columns : int
        Columns of the matrix.
    values : ndarray, shape (LANES,)
        Gets the singular values, falling.
    right : ndarray, shape (LANES, LANES)
        Gets the right singular vectors as columns; the largest element of each is positive.
    projected : ndarray, shape (LANES,)
        Gets the right-hand side in terms of the left singular vectors; 0 for a singular value of 0.
    """
    for a in range(columns):
        for b in range(columns):
            right[a, b] = 1.0 if a == b else 0.0
    for _ in range(SWEEPS):
        rotated = False
        for a in range(columns - 1):
            for b in range(a + 1, columns):
                alpha, beta, gamma = 0.0, 0.0, 0.0
                for k in range(columns):
                    alpha += upper[k, a] * upper[k, a]
                    beta += upper[k, b] * upper[k, b]
                    gamma += upper[k, a] * upper[k, b]
                if abs(gamma) <= 1e-15 * math.sqrt(alpha * beta):
                    continue
                rotated = True
                zeta = (beta - alpha) / (2.0 * gamma)
                tangent = math.copysign(1.0, zeta) / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
                cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
                sine = cosine * tangent
                for k in range(columns):
                    p, q = upper[k, a], upper[k, b]
                    upper[k, a], upper[k, b] = cosine * p - sine * q, sine * p + cosine * q
                    p, q = right[k, a], right[k, b]
                    right[k, a], right[k, b] = cosine * p - sine * q, sine * p + cosine * q
        if not rotated:
            break
    for a in range(columns):
        square, product = 0.0, 0.0
        for k in range(columns):
            square += upper[k, a] * upper[k, a]
            product += upper[k, a] * upper[k, columns]
        values[a] = math.sqrt(square)
        projected[a] = product / values[a] if square > 0.0 else 0.0
    _sort(columns, values, right, projected)


@kernel
def _sort(columns: int, values: Floats, right: Floats, projected: Floats) -> None:
    """Bring singular values into falling order, and make the largest element of each vector positive."""
    for a in range(columns):
        best = a
        for b in range(a + 1, columns):
            if values[b] > values[best]:
                best = b
        values[a], values[best] = values[best], values[a]
        projected[a], projected[best] = projected[best], projected[a]
        largest = 0
        for k in range(columns):
            right[k, a], right[k, best] = right[k, best], right[k, a]
            if abs(right[k, a]) > abs(right[largest, a]):
                largest = k
        if right[largest, a] < 0.0:
            projected[a] = -projected[a]
            for k in range(columns):
                right[k, a] = -right[k, a]

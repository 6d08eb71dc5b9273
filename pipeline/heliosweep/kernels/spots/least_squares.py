"""Small dense least squares: orthogonalisation of tall matrices, singular values of small ones.

A matrix with a right-hand side stands in blocks, one for each packet of lanes: of its first kind of equations the
columns, `PACKET` lanes each, then those of its second kind. Sums go over lanes, and then over the lanes' sums in a
fixed order. The factors are those of modified Gram-Schmidt with the right-hand side as a further column, which is as
stable as Householder's method for least squares [1]_; singular values come from one-sided Jacobi rotations, to full
relative precision for a matrix as small as this [2]_. No normal equations: their condition is the square.

References
----------
.. [1] A. Bjorck, "Numerical Methods for Least Squares Problems", SIAM (1996), section 2.4
.. [2] J. Demmel and K. Veselic, "Jacobi's method is more accurate than QR", SIAM J. Matrix Anal. Appl. 13 (1992) 1204
"""

import math

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.vectors import PACKET

COLUMNS = 8
"""Columns of a block: up to six of a matrix, and behind them a right-hand side."""
SIDES = 2
"""Kinds of equations: for each lane one of each, such as those of y and of z."""
BLOCK = SIDES * COLUMNS * PACKET
"""Numbers of a block."""

SWEEPS = 30
"""Sweeps of Jacobi rotations at the most; a matrix of six columns needs about six."""


@kernel
def orthogonalise(rows: Floats, lanes: int, columns: int, upper: Floats, sums: Floats) -> None:
    """Factor the first columns of a matrix and project what stands behind them.

    `rows` has the blocks of the matrix of so many lanes in all, with the right-hand side in column `columns`; they are
    replaced by orthogonal columns and the part of the right-hand side that is orthogonal to them all. `upper`, shape
    (COLUMNS, COLUMNS), gets the triangular factor, and in column `columns` the right-hand side in terms of the
    orthonormal columns; row j is zero where column j depends on those before it. `sums` is room for `PACKET` sums.
    """
    upper[:] = 0.0
    products = upper[columns]  # the row below the factor: of column j with those from j on
    for m in range(columns + 1):
        products[m] = _without(rows, lanes, 0, m, 0.0, 0, sums)
    for j in range(columns):
        square = products[j]
        length = math.sqrt(square)
        for m in range(j, columns + 1):
            upper[j, m] = products[m] / length if square > 0.0 else 0.0
        for m in range(j + 1, columns + 1):
            factor = products[m] / square if square > 0.0 else 0.0
            products[m] = _without(rows, lanes, j, m, factor, j + 1, sums)
    products[:] = 0.0


@inline
def _without(rows, lanes, j, m, factor, n, sums):
    """Subtract a multiple of column j from column m (if they are not the same); returns its product with column n."""
    sums[:PACKET] = 0.0
    for block in range((lanes + PACKET - 1) // PACKET):
        here = min(PACKET, lanes - block * PACKET)
        # Known not to be negative, or loads become gathers.
        a = max(block * BLOCK + j * PACKET, 0)
        b = max(block * BLOCK + m * PACKET, 0)
        c = max(block * BLOCK + n * PACKET, 0)
        second = COLUMNS * PACKET
        if j == m:
            for k in range(here):
                sums[k] += rows[b + k] * rows[b + k] + rows[b + second + k] * rows[b + second + k]
        elif j == n:
            for k in range(here):
                sums[k] += rows[b + k] * rows[c + k] + rows[b + second + k] * rows[c + second + k]
        elif m == n:
            for k in range(here):
                y = rows[b + k] - factor * rows[a + k]
                z = rows[b + second + k] - factor * rows[a + second + k]
                rows[b + k], rows[b + second + k] = y, z
                sums[k] += y * y + z * z
        else:
            for k in range(here):
                y = rows[b + k] - factor * rows[a + k]
                z = rows[b + second + k] - factor * rows[a + second + k]
                rows[b + k], rows[b + second + k] = y, z
                sums[k] += y * rows[c + k] + z * rows[c + second + k]
    return total(sums)


@inline
def total(sums: Floats) -> float:
    """Sum of `PACKET` sums, halves added to halves."""
    for k in range(32):
        sums[k] += sums[k + 32]
    for k in range(16):
        sums[k] += sums[k + 16]
    a, b, c, d = sums[0] + sums[8], sums[1] + sums[9], sums[2] + sums[10], sums[3] + sums[11]
    e, f, g, h = sums[4] + sums[12], sums[5] + sums[13], sums[6] + sums[14], sums[7] + sums[15]
    return ((a + e) + (c + g)) + ((b + f) + (d + h))


@kernel
def inverted(upper: Floats, columns: int, inverse: Floats) -> float:
    """Invert the triangular factor of `orthogonalise`; returns a bound of its condition number, NaN if it has none."""
    here, there = 0.0, 0.0
    for k in range(columns):
        inverse[k, k] = 1.0 / upper[k, k]
        there += inverse[k, k] * inverse[k, k]
        for j in range(k + 1):
            here += upper[j, k] * upper[j, k]
        for j in range(k - 1, -1, -1):
            product = 0.0
            for i in range(j + 1, k + 1):
                product += upper[j, i] * inverse[i, k]
            inverse[j, k] = -product * inverse[j, j]
            there += inverse[j, k] * inverse[j, k]
    return math.sqrt(here * there)


@kernel
def singular_values(upper: Floats, columns: int, values: Floats, right: Floats, projected: Floats) -> None:
    """Singular value decomposition of the triangular factor of `orthogonalise`, which is overwritten.

    Gives the singular values, falling; the right singular vectors as columns, the largest element of each positive; and
    the right-hand side in terms of the left singular vectors, 0 for a singular value of 0.
    """
    for a in range(columns):
        for b in range(columns):
            right[a, b] = 1.0 if a == b else 0.0
    # Rounds of a tournament: the pairs of a round share no column, so that the processor turns them at once.
    players = columns + columns % 2
    for _ in range(SWEEPS):
        rotated = False
        for turn in range(players - 1):
            for table in range(players // 2):
                a, b = (turn + table) % (players - 1), (turn - table) % (players - 1)
                b = players - 1 if table == 0 else b
                a, b = min(a, b), max(a, b)
                if b < columns and _turned(upper, right, a, b, columns):
                    rotated = True
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


@inline
def _turned(upper, right, a, b, columns):
    """Make columns a and b orthogonal; returns whether they were not."""
    alpha, beta, gamma = 0.0, 0.0, 0.0
    for k in range(columns):
        alpha += upper[k, a] * upper[k, a]
        beta += upper[k, b] * upper[k, b]
        gamma += upper[k, a] * upper[k, b]
    if abs(gamma) <= 1e-15 * math.sqrt(alpha * beta):
        return False
    zeta = (beta - alpha) / (2.0 * gamma)
    tangent = math.copysign(1.0, zeta) / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    sine = cosine * tangent
    for k in range(columns):
        p, q = upper[k, a], upper[k, b]
        upper[k, a], upper[k, b] = cosine * p - sine * q, sine * p + cosine * q
        p, q = right[k, a], right[k, b]
        right[k, a], right[k, b] = cosine * p - sine * q, sine * p + cosine * q
    return True


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

"""Exact areas of convex polygons and of their unions within the square [-1, 1] x [-1, 1].

A test mirror, scaled by its half sides, is that square, so sizes and aspect ratios drop out. Polygons are rows (x, y)
of an array with a separate count of corners, counter-clockwise. Every routine depends continuously on the corners:
coincident and nearly coincident edges cost rounding, never a wrong branch.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel

__all__ = ["SQUARE", "area", "cut", "edge_term", "gaps", "slope", "slopes", "square_area", "unit"]

SQUARE = 4.0
"""Area of the square."""

_NOTHING = 1e-17
"""Area of a piece not worth following: cutting along coincident edges leaves such slivers."""


@inline
def slope(rise: float, run: float) -> float:
    """Quotient that is 0 for an edge without run, where its factor vanishes but infinity times nothing would not."""
    return rise / run if abs(run) > 1e-200 else 0.0


@inline
def slopes(x: float, y: float) -> tuple[float, float]:
    """Slopes dy/dx and dx/dy of the direction (x, y), by one division; both 0 along an axis, where neither counts."""
    square = x * y
    inverse = 1.0 / square if abs(square) > 1e-200 else 0.0
    return y * y * inverse, x * x * inverse


@inline
def unit(value: float) -> float:
    """Clamp to [-1, 1], in the form that becomes two vector instructions."""
    low = -1.0 if value < -1.0 else value
    return 1.0 if low > 1.0 else low


@inline
def edge_term(px: float, py: float, qx: float, qy: float, rise: float, run: float) -> float:
    """Integral of clamp(y) dx along the part of the edge p-q with x in [-1, 1].

    Summed around a polygon it is, up to sign, the area within the square (Green's theorem; each vertical line sees
    the clamped top minus the clamped bottom). By parts it is [x y] minus the integral of x dy, and the latter needs x
    only where the edge crosses y = -1 and y = 1. These crossings are computed outright, not by dividing a difference
    of integrals, so nearly horizontal and nearly vertical edges lose nothing.

    Parameters
    ----------
    px, py, qx, qy : float
        Ends of the edge.
    rise, run : float
        Its slopes dy/dx and dx/dy, from `slope` or `slopes`.
    """
    x0, x1 = unit(px), unit(qx)
    y0, y1 = py + (x0 - px) * rise, qy + (x1 - qx) * rise
    c0, c1 = unit(y0), unit(y1)
    crossings = unit(x0 + (c0 - y0) * run) + unit(x1 + (c1 - y1) * run)
    return c1 * x1 - c0 * x0 - 0.5 * (c1 - c0) * crossings


@kernel
def square_area(polygon: NDArray[np.float64], corners: int) -> float:
    """Area of a polygon of either sense within the square."""
    total = 0.0
    px, py = polygon[corners - 1, 0], polygon[corners - 1, 1]
    for k in range(corners):
        qx, qy = polygon[k, 0], polygon[k, 1]
        total += edge_term(px, py, qx, qy, slope(qy - py, qx - px), slope(qx - px, qy - py))
        px, py = qx, qy
    return abs(total)


@kernel
def area(polygon: NDArray[np.float64], corners: int) -> float:
    """Area of a polygon, positive counter-clockwise."""
    total = 0.0
    for k in range(2, corners):
        px, py = polygon[k - 1, 0] - polygon[0, 0], polygon[k - 1, 1] - polygon[0, 1]
        qx, qy = polygon[k, 0] - polygon[0, 0], polygon[k, 1] - polygon[0, 1]
        total += px * qy - py * qx
    return 0.5 * total


@kernel
def cut(polygon, corners, ox, oy, ex, ey, inside, outside):
    """Cut a convex polygon by the line through o along e: what lies left of it, and what lies right.

    Returns
    -------
    tuple of int
        Corners written to `inside` (left) and to `outside` (right). A part without interior may have corners on the
        line; its area is nothing.
    """
    left = right = 0
    qx, qy = polygon[corners - 1, 0], polygon[corners - 1, 1]
    q = ex * (qy - oy) - ey * (qx - ox)
    for k in range(corners):
        px, py = polygon[k, 0], polygon[k, 1]
        p = ex * (py - oy) - ey * (px - ox)
        if (p > 0.0 and q < 0.0) or (p < 0.0 and q > 0.0):
            share = q / (q - p)
            inside[left, 0] = outside[right, 0] = qx + share * (px - qx)
            inside[left, 1] = outside[right, 1] = qy + share * (py - qy)
            left += 1
            right += 1
        if p >= 0.0:
            inside[left, 0], inside[left, 1] = px, py
            left += 1
        if p <= 0.0:
            outside[right, 0], outside[right, 1] = px, py
            right += 1
        qx, qy, q = px, py, p
    return left, right


@kernel
def gaps(polygons: NDArray[np.float64], corners: NDArray[np.int64], middle: int):
    """Area of the square that the union of convex polygons leaves open.

    Polygons are subtracted one after the other, depth first over convex pieces: the square is the first piece, each
    edge of a polygon splits off the part outside it, and what stays inside all edges is gone. Pieces never overlap,
    so no inclusion-exclusion is needed, and a covered square ends the search at once. The work grows with the pieces
    that remain, a small multiple of the number of polygons in a row of mirrors.

    Parameters
    ----------
    polygons : ndarray, shape (m, c, 2)
        Corners, counter-clockwise. Large polygons first save work.
    corners : ndarray of int64, shape (m,)
        Number of corners of each.
    middle : int
        Number of polygons to take for the first result.

    Returns
    -------
    tuple of float
        Area left open by the first `middle` polygons, and by all of them.
    """
    last, room = corners.shape[0], 32
    block = np.empty((8 * room, 2))  # one allocation: they cost more than a cut
    piece, inner = block[:room], block[room : 2 * room]
    spare, outer = block[2 * room : 3 * room], block[3 * room : 4 * room]
    stack = block[4 * room :]
    pieces = np.empty((room, 2), np.int64)  # of each piece in the stack: its corners, the polygon to subtract next
    stack[0, 0], stack[0, 1], stack[1, 0], stack[1, 1] = -1.0, -1.0, 1.0, -1.0
    stack[2, 0], stack[2, 1], stack[3, 0], stack[3, 1] = 1.0, 1.0, -1.0, 1.0
    pieces[0, 0], pieces[0, 1] = 4, 0
    top, depth = 4, 1
    before = after = 0.0
    while depth > 0:
        depth -= 1
        size, k = pieces[depth, 0], pieces[depth, 1]
        top -= size
        _copy(stack[top:], piece, size)
        while True:
            if k == middle:
                before += area(piece, size)
            if k == last:
                after += area(piece, size)
                break
            if _misses(piece, size, polygons[k], corners[k]):
                k += 1
                continue
            top_before, depth_before = top, depth
            inside = size
            _copy(piece, inner, size)
            px, py = polygons[k, corners[k] - 1, 0], polygons[k, corners[k] - 1, 1]
            for e in range(corners[k]):
                qx, qy = polygons[k, e, 0], polygons[k, e, 1]
                if 2 * inside + 2 > room:  # no cut can more than double the corners
                    room *= 2
                    piece, inner, spare, outer = _longer(piece), _longer(inner), _longer(spare), _longer(outer)
                inside, outside = cut(inner, inside, px, py, qx - px, qy - py, spare, outer)
                inner, spare = spare, inner
                if inside < 3:
                    break
                if outside > 2 and area(outer, outside) > _NOTHING:
                    while top + outside > stack.shape[0]:
                        stack = _longer(stack)
                    if depth == pieces.shape[0]:
                        longer = np.empty((2 * depth, 2), np.int64)
                        _copy(pieces, longer, depth)
                        pieces = longer
                    _copy(outer, stack[top:], outside)
                    pieces[depth, 0], pieces[depth, 1] = outside, k + 1
                    top += outside
                    depth += 1
                px, py = qx, qy
            k += 1
            if inside > 2 and area(inner, inside) > _NOTHING:
                break
            top, depth = top_before, depth_before  # the polygon misses this piece: keep it whole
    return before, after


@kernel
def _misses(one, size, other, corners):
    """Whether the bounding boxes of two polygons are apart: most pieces miss most polygons."""
    for c in range(2):
        low, high = one[0, c], one[0, c]
        for k in range(1, size):
            low, high = min(low, one[k, c]), max(high, one[k, c])
        below, above = True, True
        for k in range(corners):
            below = below and other[k, c] <= low
            above = above and other[k, c] >= high
        if below or above:
            return True
    return False


@kernel
def _copy(source, target, corners):
    for k in range(corners):
        target[k, 0], target[k, 1] = source[k, 0], source[k, 1]


@kernel
def _longer(polygon):
    """Copy of a polygon array with room for twice as many corners."""
    longer = np.empty((2 * polygon.shape[0], 2))
    _copy(polygon, longer, polygon.shape[0])
    return longer

"""Areas that the square shares with two images.

The boundary of the first image within the square has eight parts: what the square leaves of its four edges, and what it
leaves of the square's. The same crossings bound both, so that the parts close up. In coordinates of the second image,
which make that the square, `edge_term` gives the area that this leaves, by Green's theorem. Where an edge of the first
runs along a side of the square and next to it, their crossing is ill defined: such lanes are left to another way. Edges
of the two images may tie: each step is a clamp there, continuous in the corners.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.field.polygons import edge_term, larger, slope, slopes, smaller, unit
from heliosweep.kernels.vectors import ROW

Floats = NDArray[np.float64]

_LEAST = 1e-140
"""Component of an edge along an axis: the edge is taken as turned by next to nothing, so that nothing is infinite."""
_ALONG, _NEXT, _THIN = 1e-3, 2e-3, 1e-6
"""Components of edges across a side of the square, distances from it, and areas, below which lanes are left out."""


@inner
def shared_by_two(images: Floats, one: int, other: int, shared: Floats, lanes: int) -> np.int64:
    """Write the areas of the square and two images together; returns the lanes where they may be wrong.

    The images begin at `one` and `other` in `images`.
    """
    one, other, tied = max(one, 0), max(other, 0), np.int64(0)
    for k in range(lanes):
        cx, cy = images[one + k], images[one + ROW + k]
        ax, ay = _turned(images[one + 2 * ROW + k]), _turned(images[one + 3 * ROW + k])
        bx, by = _turned(images[one + 4 * ROW + k]), _turned(images[one + 5 * ROW + k])
        gx, gy = images[other + k], images[other + ROW + k]
        px, py = images[other + 2 * ROW + k], images[other + 3 * ROW + k]
        qx, qy = images[other + 4 * ROW + k], images[other + 5 * ROW + k]
        # Coordinates of the second image: (x e + y f + g, x h + y i + j).
        turn = px * qy - py * qx
        scale = slope(1.0, turn)
        e, f, h, i = qy * scale, -qx * scale, -py * scale, px * scale
        g, j = -(gx * e + gy * f), -(gx * h + gy * i)
        ux, uy, vx, vy = ax * e + ay * f, ax * h + ay * i, bx * e + by * f, bx * h + by * i
        mx, my = cx * e + (cy * f + g), cx * h + (cy * i + j)
        (u_rise, u_run), (v_rise, v_run) = slopes(ux, uy), slopes(vx, vy)
        (x_rise, x_run), (y_rise, y_run) = slopes(e, h), slopes(f, i)
        inverse_a, inverse_b = 1.0 / (ax * ay), 1.0 / (bx * by)
        rx, ry, sx, sy = ay * inverse_a, ax * inverse_a, by * inverse_b, bx * inverse_b
        low, high, e0, w0, n0, s0 = _within(cx - bx, cy - by, ax, ay, rx, ry)
        total = _part(mx - vx, my - vy, ux, uy, low, high, u_rise, u_run)
        low, high, e1, w1, n1, s1 = _within(cx + bx, cy + by, ax, ay, rx, ry)
        total -= _part(mx + vx, my + vy, ux, uy, low, high, u_rise, u_run)
        low, high, e2, w2, n2, s2 = _within(cx + ax, cy + ay, bx, by, sx, sy)
        total += _part(mx + ux, my + uy, vx, vy, low, high, v_rise, v_run)
        low, high, e3, w3, n3, s3 = _within(cx - ax, cy - ay, bx, by, sx, sy)
        total -= _part(mx - ux, my - uy, vx, vy, low, high, v_rise, v_run)
        area = ax * by - ay * bx
        total = total if area > 0.0 else -total
        low, high = _between(e0, e1, e2, e3)
        total += _part(g + e, j + h, f, i, low, high, y_rise, y_run)
        low, high = _between(w0, w1, w2, w3)
        total -= _part(g - e, j - h, f, i, low, high, y_rise, y_run)
        low, high = _between(n0, n1, n2, n3)
        total -= _part(g + f, j + i, e, h, low, high, x_rise, x_run)
        low, high = _between(s0, s1, s2, s3)
        total += _part(g - f, j - i, e, h, low, high, x_rise, x_run)
        shared[k] = abs(total * turn)
        near = _tied(cx, bx, ax) | _tied(cy, by, ay) | _tied(cx, ax, bx) | _tied(cy, ay, by) | (abs(area) < _THIN)
        tied |= np.int64(near) << k
    return tied


@inline
def _turned(value):
    """A component of an edge, never nothing."""
    return value if abs(value) > _LEAST else _LEAST


@inline
def _within(px, py, dx, dy, r, s):
    """Part of the edge p + t d within the square; y where it crosses x = 1 and x = -1, x where it crosses y = 1, -1."""
    east, west, north, south = (1.0 - px) * r, (-1.0 - px) * r, (1.0 - py) * s, (-1.0 - py) * s
    low = unit(larger(smaller(east, west), smaller(north, south)))
    high = larger(smaller(smaller(larger(east, west), larger(north, south)), 1.0), low)
    return low, high, py + east * dy, py + west * dy, px + north * dx, px + south * dx


@inline
def _between(a, b, c, d):
    """Part of a side of the square between two crossings and between two others."""
    low = unit(larger(smaller(a, b), smaller(c, d)))
    return low, larger(smaller(smaller(larger(a, b), larger(c, d)), 1.0), low)


@inline
def _part(px, py, dx, dy, low, high, rise, run):
    """Green's term of a part of the line p + t d."""
    return edge_term(px + low * dx, py + low * dy, px + high * dx, py + high * dy, rise, run)


@inline
def _tied(middle, half, along):
    """Whether one of two edges runs nearly along a side of the square and next to it."""
    return (abs(along) < _ALONG) & ((abs(abs(middle + half) - 1.0) < _NEXT) | (abs(abs(middle - half) - 1.0) < _NEXT))

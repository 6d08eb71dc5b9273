"""Areas that the square shares with two images.

The boundary of the first image within the square has eight parts: what the square leaves of its four edges, and what it
leaves of the square's. The same crossings bound both, so that the parts close up. In coordinates of the second image,
which make that the square, `edge_term` gives the area that this leaves, by Green's theorem. Where an edge of the first
runs along a side of the square and next to it, their crossing is ill defined: such lanes are left to another way. Edges
of the two images may tie: each step is a clamp there, continuous in the corners.
"""

import numpy as np

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.field.polygons import along, edge_terms, larger, slope, slopes, smaller, unit
from heliosweep.kernels.vectors import ROW

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
        px, py = (cx - bx, cx + bx, cx + ax, cx - ax), (cy - by, cy + by, cy + ay, cy - ay)
        low, high, east, west, north, south = _within(
            px, py, (ax, ax, bx, bx), (ay, ay, by, by), (rx, rx, sx, sx), (ry, ry, sy, sy)
        )
        first, second, third, fourth = _parts(
            (mx - vx, mx + vx, mx + ux, mx - ux),
            (my - vy, my + vy, my + uy, my - uy),
            (ux, ux, vx, vx),
            (uy, uy, vy, vy),
            low,
            high,
            (u_rise, u_rise, v_rise, v_rise),
            (u_run, u_run, v_run, v_run),
        )
        total = first - second + third - fourth
        area = ax * by - ay * bx
        total = total if area > 0.0 else -total
        low, high = _sides(east, west, north, south)
        first, second, third, fourth = _parts(
            (g + e, g - e, g + f, g - f),
            (j + h, j - h, j + i, j - i),
            (f, f, e, e),
            (i, i, h, h),
            low,
            high,
            (y_rise, y_rise, x_rise, x_rise),
            (y_run, y_run, x_run, x_run),
        )
        total = total + first - second - third + fourth
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
    """Parts of four edges p + t d within the square; y where each crosses x = 1, -1, x where it crosses y = 1, -1."""
    east, west = _crossings(1.0, px, r), _crossings(-1.0, px, r)
    north, south = _crossings(1.0, py, s), _crossings(-1.0, py, s)
    low, high = _between(east, west, north, south)
    return low, high, along(py, east, dy), along(py, west, dy), along(px, north, dx), along(px, south, dx)


@inline
def _crossings(side, p, r):
    """Where four edges cross a side, by the inverse of d."""
    return (side - p[0]) * r[0], (side - p[1]) * r[1], (side - p[2]) * r[2], (side - p[3]) * r[3]


@inline
def _between(a, b, c, d):
    """Parts, from -1 to 1, of four lines between two crossings, a and b, and between two others, c and d."""
    (low0, high0), (low1, high1) = _ends(a[0], b[0], c[0], d[0]), _ends(a[1], b[1], c[1], d[1])
    (low2, high2), (low3, high3) = _ends(a[2], b[2], c[2], d[2]), _ends(a[3], b[3], c[3], d[3])
    return (low0, low1, low2, low3), (high0, high1, high2, high3)


@inline
def _ends(a, b, c, d):
    """The same of one."""
    low = unit(larger(smaller(a, b), smaller(c, d)))
    return low, larger(smaller(smaller(larger(a, b), larger(c, d)), 1.0), low)


@inline
def _sides(east, west, north, south):
    """Parts of the square's sides between what the four edges of an image cross."""
    a, b = (east[0], west[0], north[0], south[0]), (east[1], west[1], north[1], south[1])
    c, d = (east[2], west[2], north[2], south[2]), (east[3], west[3], north[3], south[3])
    return _between(a, b, c, d)


@inline
def _parts(px, py, dx, dy, low, high, rise, run):
    """Green's terms of parts of four lines p + t d."""
    return edge_terms(along(px, low, dx), along(py, low, dy), along(px, high, dx), along(py, high, dy), rise, run)


@inline
def _tied(middle, half, along):
    """Whether one of two edges runs nearly along a side of the square and next to it."""
    return (abs(along) < _ALONG) & ((abs(abs(middle + half) - 1.0) < _NEXT) | (abs(abs(middle - half) - 1.0) < _NEXT))

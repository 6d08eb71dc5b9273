"""Areas that the square shares with two images.

The boundary of the first image within the square has eight parts: the parts of its four edges within the square, and
the parts of the square's edges within the image. The same crossings bound both, so that the parts close up. In
coordinates of the second image, which make that the square, `edge_terms` gives the area, by Green's theorem. If an edge
of the first runs along a side of the square and next to it, their crossing is ill defined: such lanes are left to
another way. Edges of the two images may tie: each step is a clamp there, continuous in the corners.
"""

import numpy as np

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.field.images import IMAGE
from heliosweep.kernels.field.polygons import along, edge_terms, larger, slopes, smaller, unit
from heliosweep.kernels.vectors import ROW, load2, next_run, put

#: Shared area that is left out.
_NOTHING = 1e-15
#: Component of an edge along an axis: the edge is taken as turned by next to nothing, so that nothing is infinite.
_LEAST = 1e-140
#: Components of edges across a side of the square, distances from it, and areas, below which lanes are left out.
_ALONG, _NEXT, _THIN = 1e-3, 2e-3, 1e-6


@inner
def shared_by_two(images: Floats, m: int, n: int, some: int, shared: Floats, lanes: int) -> tuple[np.int64, np.int64]:
    """Write the areas of the square and images m and n together; returns lanes: maybe wrong, and not 0."""
    one, other, tied, found = m * IMAGE, n * IMAGE, np.int64(0), np.int64(0)
    start, stop = next_run(0, some, lanes)
    while start < stop:
        for k in range(start, stop):
            (cx, cy), (ax, ay) = load2(images, one, k), load2(images, one + 2 * ROW, k)
            (bx, by), (gx, gy) = load2(images, one + 4 * ROW, k), load2(images, other, k)
            (px, py), (qx, qy) = load2(images, other + 2 * ROW, k), load2(images, other + 4 * ROW, k)
            ax, ay, bx, by = _turned(ax), _turned(ay), _turned(bx), _turned(by)
            # Coordinates of the second image: (x e + y f + g, x h + y i + j).
            turn = px * qy - py * qx
            scale = 1.0 / turn if abs(turn) > 1e-200 else 0.0
            e, f, h, i = qy * scale, -qx * scale, -py * scale, px * scale
            g, j = -(gx * e + gy * f), -(gx * h + gy * i)
            ux, uy, vx, vy = ax * e + ay * f, ax * h + ay * i, bx * e + by * f, bx * h + by * i
            mx, my = cx * e + (cy * f + g), cx * h + (cy * i + j)
            (u_rise, u_run), (v_rise, v_run) = slopes(ux, uy), slopes(vx, vy)
            (x_rise, x_run), (y_rise, y_run) = slopes(e, h), slopes(f, i)
            inverse_a, inverse_b = 1.0 / (ax * ay), 1.0 / (bx * by)
            rx, ry, sx, sy = ay * inverse_a, ax * inverse_a, by * inverse_b, bx * inverse_b
            px, py = (cx - bx, cx + bx, cx + ax, cx - ax), (cy - by, cy + by, cy + ay, cy - ay)
            east, west = _crossings(1.0, px, (rx, rx, sx, sx)), _crossings(-1.0, px, (rx, rx, sx, sx))
            north, south = _crossings(1.0, py, (ry, ry, sy, sy)), _crossings(-1.0, py, (ry, ry, sy, sy))
            low, high = _between(east, west, north, south)
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
            total, area = first - second + third - fourth, ax * by - ay * bx
            total = total if area > 0.0 else -total
            # y where the edges cross x = 1 and x = -1, x where they cross y = 1 and y = -1: ends on the square's sides.
            dx, dy = (ax, ax, bx, bx), (ay, ay, by, by)
            a, b, c, d = along(py, east, dy), along(py, west, dy), along(px, north, dx), along(px, south, dx)
            low, high = _between(
                (a[0], b[0], c[0], d[0]), (a[1], b[1], c[1], d[1]), (a[2], b[2], c[2], d[2]), (a[3], b[3], c[3], d[3])
            )
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
            total = abs((total + first - second - third + fourth) * turn)
            put(shared, 0, k, total)
            found |= np.int64(total > _NOTHING) << k
            near = _tied(cx, bx, ax) | _tied(cy, by, ay) | _tied(cx, ax, bx) | _tied(cy, ay, by) | (abs(area) < _THIN)
            tied |= np.int64(near) << k
        start, stop = next_run(stop, some, lanes)
    return tied & some, found & some


@inline
def _turned(value):
    """Component of an edge, never 0."""
    return value if abs(value) > _LEAST else _LEAST


@inline
def _crossings(side, p, r):
    """Crossings of four edges with a side, by the inverse of their component."""
    return (side - p[0]) * r[0], (side - p[1]) * r[1], (side - p[2]) * r[2], (side - p[3]) * r[3]


@inline
def _between(a, b, c, d):
    """Parts, from -1 to 1, of four lines between two crossings, a and b, and between two others, c and d."""
    (low0, high0), (low1, high1) = _ends(a[0], b[0], c[0], d[0]), _ends(a[1], b[1], c[1], d[1])
    (low2, high2), (low3, high3) = _ends(a[2], b[2], c[2], d[2]), _ends(a[3], b[3], c[3], d[3])
    return (low0, low1, low2, low3), (high0, high1, high2, high3)


@inline
def _ends(a, b, c, d):
    """Part, from -1 to 1, of one line between two crossings, a and b, and between two others, c and d."""
    low = unit(larger(smaller(a, b), smaller(c, d)))
    return low, larger(smaller(smaller(larger(a, b), larger(c, d)), 1.0), low)


@inline
def _parts(px, py, dx, dy, low, high, rise, run):
    """Green's terms of parts of four lines p + t d."""
    return edge_terms(along(px, low, dx), along(py, low, dy), along(px, high, dx), along(py, high, dy), rise, run)


@inline
def _tied(middle, half, component):
    """Test whether one of two edges runs nearly along a side of the square and next to it."""
    return (abs(component) < _ALONG) & (
        (abs(abs(middle + half) - 1.0) < _NEXT) | (abs(abs(middle - half) - 1.0) < _NEXT)
    )

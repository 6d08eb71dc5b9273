"""Areas that the square shares with two images, for packed lanes.

Areas come without branches and without ties. An image is followed as a closed chain of segments. To clip it by the
square, each segment is cut at x = -1 and x = 1 and what is beyond is pushed onto these lines; then the same at y = -1
and y = 1. A segment becomes one along x, the part inside, one along x, and one along y to the start of the next. The
chain may run to and fro along a side; that cancels. In the coordinates of the other image, which make that the square,
`edge_term` gives the area that this leaves, by Green's theorem. Each step is a clamp, continuous in the corners: there
are no ties to break. Directions of segments are known and carried along, never taken from differences of corners.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.field.polygons import edge_term, slope, slopes, unit
from heliosweep.kernels.vectors import GROUP, ROW

Floats = NDArray[np.float64]

_IMAGE = 6 * ROW
"""Rows of a packed image: centre and half edges, as in `images`."""
SHARED = 2 * _IMAGE
"""Start of the row of areas."""
OVERLAP_ROWS = SHARED // ROW + 1
"""Rows of room that is needed."""


@inner
def pack(images: Floats, image: int, names: NDArray[np.int64], active: int, room: Floats, place: int) -> int:
    """Copy the first `active` lanes `names` of an image next to each other, to `room`, as image 0 or 1 (`place`).

    The image begins at `image` in `images`. Returns the number of lanes, filled up to whole groups by the last one; the
    names, shape (PACKET,), are filled up too.
    """
    filled = -(-active // GROUP) * GROUP
    for k in range(active, filled):
        names[k] = names[active - 1]
    for row in range(0, 6 * ROW, ROW):
        for k in range(filled):
            room[place * _IMAGE + row + k] = images[image + row + names[k]]
    return filled


@inner
def shared_by_two(room: Floats, lanes: int) -> None:
    """Write the areas of the square and two packed images together."""
    for k in range(lanes):
        sides = _sides(room, 0, k)
        to, turn = _coordinates(room, _IMAGE, k)
        e, f, _, h, i, _ = to
        x, y = slopes(e, h), slopes(f, i)
        a, b = slopes(*_turned(to, *_edge(room, 0, 2, k))), slopes(*_turned(to, *_edge(room, 0, 4, k)))
        area = (_green(sides[0], sides[1], a, x, y, to) + _green(sides[1], sides[2], b, x, y, to)) + (
            _green(sides[2], sides[3], a, x, y, to) + _green(sides[3], sides[0], b, x, y, to)
        )
        room[SHARED + k] = abs(area * turn)


@inline
def _edge(room, image, row, k):
    """A half edge of a packed image, or its centre."""
    return room[image + row * ROW + k], room[image + (row + 1) * ROW + k]


@inline
def _coordinates(room, image, k):
    """Map of points to coordinates of an image, (x e + y f + g, x h + y i + j), and the area of its unit."""
    cx, cy = _edge(room, image, 0, k)
    px, py = _edge(room, image, 2, k)
    qx, qy = _edge(room, image, 4, k)
    turn = px * qy - py * qx
    scale = slope(1.0, turn)
    e, f, h, i = qy * scale, -qx * scale, -py * scale, px * scale
    return (e, f, -(cx * e + cy * f), h, i, -(cx * h + cy * i)), turn


@inline
def _turned(to, x, y):
    """A direction in coordinates of an image."""
    return x * to[0] + y * to[1], x * to[3] + y * to[4]


@inline
def _moved(to, x, y):
    """A point in coordinates of an image."""
    return x * to[0] + (y * to[1] + to[2]), x * to[3] + (y * to[4] + to[5])


@inline
def _sides(room, image, k):
    """The four edges of an image clipped by the square."""
    cx, cy = _edge(room, image, 0, k)
    ax, ay = _edge(room, image, 2, k)
    bx, by = _edge(room, image, 4, k)
    a, b = slopes(ax, ay), slopes(bx, by)
    x0, y0, x1, y1 = cx - ax - bx, cy - ay - by, cx + ax - bx, cy + ay - by
    x2, y2, x3, y3 = cx + ax + bx, cy + ay + by, cx - ax + bx, cy - ay + by
    return (
        _clipped(x0, y0, x1, y1, a),
        _clipped(x1, y1, x2, y2, b),
        _clipped(x2, y2, x3, y3, a),
        _clipped(x3, y3, x0, y0, b),
    )


@inline
def _clipped(px, py, qx, qy, along):
    """Clip an edge: from (x0, c0) along x to (xa, c0), along the edge to (xb, c1), along x to (x1, c1)."""
    rise, run = along
    x0, x1 = unit(px), unit(qx)
    y0, y1 = py + (x0 - px) * rise, qy + (x1 - qx) * rise
    c0, c1 = unit(y0), unit(y1)
    return x0, c0, unit(x0 + (c0 - y0) * run), unit(x1 + (c1 - y1) * run), c1, x1


@inline
def _green(side, following, along, x, y, to):
    """Green's terms of one clipped edge, with the segment along y to the start of the following one."""
    x0, c0, xa, xb, c1, x1 = side
    p, q = _moved(to, x0, c0)
    pa, qa = _moved(to, xa, c0)
    pb, qb = _moved(to, xb, c1)
    pc, qc = _moved(to, x1, c1)
    pd, qd = _moved(to, following[0], following[1])
    return (
        edge_term(p, q, pa, qa, x[0], x[1])
        + edge_term(pa, qa, pb, qb, along[0], along[1])
        + edge_term(pb, qb, pc, qc, x[0], x[1])
        + edge_term(pc, qc, pd, qd, y[0], y[1])
    )

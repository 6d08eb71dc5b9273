"""Areas that the square shares with two images, or with three, for packed lanes; and images that another one hides.

Areas come without branches and without ties. A polygon is followed as a closed chain of segments. To clip it by the
square, each segment is cut at x = -1 and x = 1 and what is beyond is pushed onto these lines; then the same at y = -1
and y = 1. A segment becomes one along x, the part inside, one along x, and one along y to the start of the next. The
chain may run to and fro along a side; that cancels. In the coordinates of an image, which make it the square, it can be
clipped again; and by Green's theorem `edge_term` gives the area of what the last image leaves. Each step is a clamp,
continuous in the corners: there are no ties to break. Directions of segments are known and carried along, never taken
from differences of corners.

With a low sun most images are hidden by another one, and without them the union is the same. An image is hidden by
another of its kind that contains the box around what it covers on the test mirror. Candidates come by rows and cells of
the grid from the test heliostat outward (`neighbours.search`), so that images of the nearest hide most of the others
before the areas of these are computed.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.field.images import AREA, IMAGE_ROWS, Images, larger
from heliosweep.kernels.field.polygons import edge_term, slope, slopes, unit
from heliosweep.kernels.vectors import GROUP, ROW

Floats = NDArray[np.float64]

_IMAGE = 6 * ROW
"""Rows of a packed image: centre and half edges, as in `images`."""
SHARED = 3 * _IMAGE
"""Start of the row of areas."""
_SCALE = SHARED + ROW
"""Row of factors of areas in coordinates of the last image."""
_CHAIN = _SCALE + ROW
"""Start of the 16 corners of a chain: x, and 16 rows later y."""
_SLOPES = _CHAIN + 32 * ROW
"""Slopes dy/dx and dx/dy of x, a, y, b in coordinates of the second image; then of these and p, q in those of the
third; then how the former coordinates are made the latter."""
_THIRD, _TO = _SLOPES + 8 * ROW, _SLOPES + 20 * ROW
OVERLAP_ROWS = _TO // ROW + 6
"""Rows of room that is needed."""


@inner
def pack(images: Floats, image: int, names: NDArray[np.int64], active: int, room: Floats, place: int) -> int:
    """Copy the first `active` lanes `names` of an image next to each other, to `room`, as image 0, 1 or 2 (`place`).

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


@inner
def shared_by_three(room: Floats, lanes: int) -> None:
    """Write the areas of the square and three packed images together."""
    _smallest_last(room, lanes)
    _chain_of_first(room, lanes)
    for k in range(lanes):
        room[SHARED + k] = 0.0
    for s in range(16):
        # The segments of the chain run along x, a, x, y, x, b, x, y, and so again.
        own, following = _direction(s), _direction(s + 1)
        start, stop = _CHAIN + s * ROW, _CHAIN + (s + 1) % 16 * ROW
        for k in range(lanes):
            along = room[own + k], room[own + ROW + k]
            qx, qy = room[stop + k], room[stop + 16 * ROW + k]
            side = _clipped(room[start + k], room[start + 16 * ROW + k], qx, qy, along)
            x = side[5]
            then = x, unit(qy + (x - qx) * room[following + k])
            to = (
                room[_TO + k],
                room[_TO + ROW + k],
                room[_TO + 2 * ROW + k],
                room[_TO + 3 * ROW + k],
                room[_TO + 4 * ROW + k],
                room[_TO + 5 * ROW + k],
            )
            third = own + (_THIRD - _SLOPES) + k
            p = room[_THIRD + 8 * ROW + k], room[_THIRD + 9 * ROW + k]
            q = room[_THIRD + 10 * ROW + k], room[_THIRD + 11 * ROW + k]
            room[SHARED + k] += _green(side, then, (room[third], room[third + ROW]), p, q, to)
    for k in range(lanes):
        room[SHARED + k] = abs(room[SHARED + k] * room[_SCALE + k])


@inline
def _direction(s):
    """Start of the slopes of the direction of a segment: of x, a, y or b."""
    kind = 0 if s % 2 == 0 else (2 if s % 4 == 3 else (1 if s % 8 == 1 else 3))
    return _SLOPES + 2 * kind * ROW


@inner
def _smallest_last(room, lanes):
    """Swap the second and the third image where the third is larger.

    What the coordinates of an image nearly without area lose, is made good where its area is a factor.
    """
    for k in range(lanes):
        px, py = _edge(room, _IMAGE, 2, k)
        qx, qy = _edge(room, _IMAGE, 4, k)
        ex, ey = _edge(room, 2 * _IMAGE, 2, k)
        fx, fy = _edge(room, 2 * _IMAGE, 4, k)
        room[_SCALE + k] = 1.0 if abs(px * qy - py * qx) < abs(ex * fy - ey * fx) else 0.0
    for row in range(_IMAGE, 2 * _IMAGE, ROW):
        for k in range(lanes):
            one, other = room[row + k], room[row + _IMAGE + k]
            swapped = room[_SCALE + k] > 0.0
            room[row + k], room[row + _IMAGE + k] = (other, one) if swapped else (one, other)


@inner
def _chain_of_first(room, lanes):
    """Write the chain of the first image clipped by the square in coordinates of the second, and all slopes."""
    for k in range(lanes):
        side0, side1, side2, side3 = _sides(room, 0, k)
        second, _ = _coordinates(room, _IMAGE, k)
        _write_corners(room, _CHAIN + k, second, side0)
        _write_corners(room, _CHAIN + 4 * ROW + k, second, side1)
        _write_corners(room, _CHAIN + 8 * ROW + k, second, side2)
        _write_corners(room, _CHAIN + 12 * ROW + k, second, side3)
    for k in range(lanes):
        _write_slopes_of_chain(room, _SLOPES, _IMAGE, k)
    for k in range(lanes):
        _write_slopes_of_chain(room, _THIRD, 2 * _IMAGE, k)
    for k in range(lanes):
        to, turn = _coordinates(room, 2 * _IMAGE, k)
        (px, py), (qx, qy) = _edge(room, _IMAGE, 2, k), _edge(room, _IMAGE, 4, k)
        cx, cy = _edge(room, _IMAGE, 0, k)
        room[_SCALE + k] = turn
        _write_slopes(room, _THIRD + 8 * ROW + k, to, px, py)
        _write_slopes(room, _THIRD + 10 * ROW + k, to, qx, qy)
        room[_TO + k], room[_TO + 3 * ROW + k] = _turned(to, px, py)
        room[_TO + ROW + k], room[_TO + 4 * ROW + k] = _turned(to, qx, qy)
        room[_TO + 2 * ROW + k], room[_TO + 5 * ROW + k] = _moved(to, cx, cy)


@inline
def _write_corners(room, at, to, side):
    """Write the corners before, within and after a clipped edge, x and 16 rows later y."""
    x0, c0, xa, xb, c1, x1 = side
    room[at], room[at + 16 * ROW] = _moved(to, x0, c0)
    room[at + ROW], room[at + 17 * ROW] = _moved(to, xa, c0)
    room[at + 2 * ROW], room[at + 18 * ROW] = _moved(to, xb, c1)
    room[at + 3 * ROW], room[at + 19 * ROW] = _moved(to, x1, c1)


@inline
def _write_slopes_of_chain(room, at, image, k):
    """Write the slopes of the directions of a chain, x, a, y and b, in coordinates of an image."""
    to, _ = _coordinates(room, image, k)
    (ax, ay), (bx, by) = _edge(room, 0, 2, k), _edge(room, 0, 4, k)
    _write_slopes(room, at + k, to, 1.0, 0.0)
    _write_slopes(room, at + 2 * ROW + k, to, ax, ay)
    _write_slopes(room, at + 4 * ROW + k, to, 0.0, 1.0)
    _write_slopes(room, at + 6 * ROW + k, to, bx, by)


@inline
def _write_slopes(room, at, to, x, y):
    """Write the slopes of a direction."""
    dx, dy = _turned(to, x, y)
    room[at], room[at + ROW] = slopes(dx, dy)


@inner
def take_out_hidden(images: Images, first: int, m: int, some: np.int64, lanes: int) -> np.int64:
    """Take an image out where an earlier one of its kind hides it, and the earlier ones that it hides itself.

    `first` is the first image of the kind, and `m` the one that `images.project` has made; `some` are the lanes in
    which it may cover something and in which that is wanted. Where an image is hidden its area becomes 0, and an
    earlier one is no longer present. Mirrors that may straddle the plane of the test mirror hide none. Of equals the
    first stays. Returns the lanes where the image is hidden.
    """
    hidden = np.int64(0)
    for n in range(first, m):
        both = images.present[n] & some & ~hidden
        if both != 0 and images.apart[n]:
            hidden |= both & _contains(images.rows, n, m, lanes)
    _take_out(images.rows, m, hidden, lanes)
    for n in range(first, m if images.apart[m] else first):
        both = images.present[n] & some & ~hidden
        if both != 0:
            both &= _contains(images.rows, m, n, lanes)
            _take_out(images.rows, n, both, lanes)
            images.present[n] &= ~both
    return hidden


@inner
def _contains(images, n, m, lanes):
    """Lanes where image n contains the box around what image m covers on the square.

    No corner P of the box lies beyond the edges of n: |(P - C) x b| <= |a x b|, and so for a.
    """
    n, m = max(n, 0), max(m, 0)  # an index that may be negative would keep the loop from becoming vector code
    one, other = n * IMAGE_ROWS * ROW, m * IMAGE_ROWS * ROW
    found = np.int64(0)
    for k in range(lanes):
        cx, cy = images[other + k], images[other + ROW + k]
        reach_x = abs(images[other + 2 * ROW + k]) + abs(images[other + 4 * ROW + k])
        reach_y = abs(images[other + 3 * ROW + k]) + abs(images[other + 5 * ROW + k])
        west, east = unit(cx - reach_x), unit(cx + reach_x)
        south, north = unit(cy - reach_y), unit(cy + reach_y)
        x, y = 0.5 * (west + east) - images[one + k], 0.5 * (south + north) - images[one + ROW + k]
        width, height = 0.5 * (east - west), 0.5 * (north - south)
        ax, ay = images[one + 2 * ROW + k], images[one + 3 * ROW + k]
        bx, by = images[one + 4 * ROW + k], images[one + 5 * ROW + k]
        beyond_a = abs(x * by - y * bx) + width * abs(by) + height * abs(bx)
        beyond_b = abs(x * ay - y * ax) + width * abs(ay) + height * abs(ax)
        found |= np.int64(larger(beyond_a, beyond_b) <= abs(ax * by - ay * bx)) << k
    return found


@inline
def _take_out(images, m, some, lanes):
    """Leave an image no area in some lanes."""
    if some != 0:
        area = max(m, 0) * IMAGE_ROWS * ROW + AREA
        for k in range(lanes):
            images[area + k] = 0.0 if some >> k & 1 else images[area + k]

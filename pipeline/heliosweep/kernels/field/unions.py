"""Exact areas of unions of images, for all lanes of a packet.

If no four images of a lane overlap one another, the union is the sum of their areas minus the areas that pairs of them
share, plus the areas that three of them share. In the other lanes, and where edges tie or a mirror straddles the plane
of the test mirror, the images are subtracted from the square one by one.

Sets of lanes are integers with a bit for each lane. A lane's way depends on its own images only, and they keep the
order of the search: the bits of a lane do not depend on its packet.

The area that the square shares with two images follows from the boundary of the first image within the square. It has
eight parts: the parts of its four edges within the square, and the parts of the square's edges within the image. The
same crossings bound both, so that the parts close up. In coordinates of the second image, which make that the square,
`edge_terms` gives the area, by Green's theorem. If an edge of the first runs along a side of the square and next to
it, their crossing is ill defined: such lanes are left to another way. Edges of the two images may tie: each step is a
clamp there, continuous in the corners.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.images import AREA, IMAGE, Images, outline
from heliosweep.kernels.field.polygons import (
    CORNERS,
    SQUARE,
    along,
    area,
    edge_terms,
    larger,
    leave_open,
    slopes,
    smaller,
    unit,
    within,
    write_square,
)
from heliosweep.kernels.vectors import ROW, get, load2, next_run, put, rows

#: Area of an image that is left out of unions: no wider than rounding, its corners may be in disorder.
_NOTHING = 1e-14
#: Gap between images, times a half edge, below which they are taken to overlap: edges of theirs that touch may tie.
_TOUCHING = 1e-3
#: Rows of the totals, after that of shade.
_BLOCK, _BOTH = ROW, 2 * ROW


class Room(NamedTuple):
    """Scratch for the unions of a number of images."""

    #: Lanes in which two images overlap, shape (count, count).
    met: Integers
    #: Areas that two images share, a row.
    shared: Floats
    #: Images of one lane, their numbers of corners, and the corners.
    names: Integers
    corners: Integers
    polygons: Floats
    #: Pieces of the square that the images of one lane leave open. Each image may add 5 corners to a piece; only the
    #: pages in use take memory.
    pieces: Floats
    open: Floats


@kernel
def room_for(count: int) -> Room:
    """Scratch for `count` images."""
    pieces = (count + 1) * 6 * (4 + CORNERS * (count + 2)) + 64
    names, corners, polygons = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count * 2 * CORNERS)
    return Room(np.empty((count, count), np.int64), rows(1), names, corners, polygons, np.empty(pieces), np.empty(2))


@inner
def unions(images: Images, shading: int, count: int, total: Floats, room: Room, lanes: int) -> None:
    """Exact areas of the unions of images, for every lane, on the square of area 4.

    Of `count` images the first ones, `shading` of them, shade. Written to the rows of `total`, shape (3 * ROW,), are
    the areas shaded, blocked, and shaded or blocked. `room` is scratch for at least `count` images, and `lanes` a
    multiple of `vectors.GROUP`.

    Rounding is some 1e-14, and grows with images a thousand times as large as the mirror, as the last thousandth of a
    radian before grazing incidence makes them: to 2e-12.
    """
    one = two = four = general = np.int64(0)
    for k in range(lanes):
        put(total, 0, k, 0.0)
        put(total, _BLOCK, k, 0.0)
    for m in range(count):
        carry, general = images.present[m], general | images.behind[m]
        one, carry = one ^ carry, one & carry
        two, carry = two ^ carry, two & carry
        four, general = four ^ carry, general | four & carry
        _add(total, 0 if m < shading else _BLOCK, images.rows, m * IMAGE + AREA, 1.0, np.int64(-1), lanes)
    for k in range(lanes):
        put(total, _BOTH, k, get(total, 0, k) + get(total, _BLOCK, k))
    general |= four & two & one
    if (two | four) & ~general != 0:
        general |= _add_overlaps(images, (two | four) & ~general, shading, count, total, room, lanes)
    for k in range(lanes if general != 0 else 0):
        if general >> k & 1:
            _subtract(images, shading, count, k, total, room)


@inner
def _add(total, row, areas, at, factor, some, lanes):
    """Add areas, times a factor, to a row of the totals in some lanes."""
    for k in range(lanes):
        put(total, row, k, get(total, row, k) + (factor * get(areas, at, k) if some >> k & 1 else 0.0))


@inner
def _overlapping(images, n, m, some, lanes):
    """Lanes in which the parallelograms n and m overlap, by the separating axes, and neither has next to no area."""
    found, one, other = np.int64(0), n * IMAGE, m * IMAGE
    start, stop = next_run(0, some, lanes)
    while start < stop:
        for k in range(start, stop):
            (gx, gy), (ax, ay), (bx, by) = (
                load2(images, one, k),
                load2(images, one + 2 * ROW, k),
                load2(images, one + 4 * ROW, k),
            )
            (hx, hy), (px, py), (qx, qy) = (
                load2(images, other, k),
                load2(images, other + 2 * ROW, k),
                load2(images, other + 4 * ROW, k),
            )
            cx, cy = hx - gx, hy - gy
            ab, pq = abs(ax * by - ay * bx), abs(px * qy - py * qx)
            ap, aq = abs(ax * py - ay * px), abs(ax * qy - ay * qx)
            bp, bq = abs(bx * py - by * px), abs(bx * qy - by * qx)
            gap = larger(abs(cx * ay - cy * ax) - ab - ap - aq, abs(cx * by - cy * bx) - ab - bp - bq)
            gap = larger(gap, abs(cx * py - cy * px) - pq - ap - bp)
            gap = larger(gap, abs(cx * qy - cy * qx) - pq - aq - bq)
            least = smaller(get(images, one + AREA, k), get(images, other + AREA, k))
            found |= np.int64((gap < _TOUCHING) & (least > _NOTHING)) << k
        start, stop = next_run(stop, some, lanes)
    return found


@inner
def _add_overlaps(images, some, shading, count, total, room, lanes):
    """Subtract the common areas of two images and add the areas of three; return lanes with ties or four."""
    met, left = room.met, np.int64(0)
    for m in range(count):
        met[m, m] = 0
        for n in range(m):
            both = images.present[m] & images.present[n] & some
            if both != 0:
                both &= _overlapping(images.rows, n, m, both, lanes)
            if both != 0:
                tied, both = shared_by_two(images.rows, n, m, both, room.shared, lanes)
                left |= tied
                _add(total, _BOTH, room.shared, 0, -1.0, both, lanes)
                if m < shading or n >= shading:
                    _add(total, 0 if m < shading else _BLOCK, room.shared, 0, -1.0, both, lanes)
            met[m, n] = met[n, m] = both
    for m in range(count):
        for n in range(m):
            if met[m, n] & ~left != 0:
                left = _add_triples(images, m, n, left, shading, count, total, room, lanes)
    return left


@inner
def _add_triples(images, m, n, left, shading, count, total, room, lanes):
    """Add the common areas of two images and a third one before them; return lanes with ties or four."""
    met = room.met
    for i in range(n):
        three = met[m, n] & met[m, i] & met[n, i] & ~left
        for h in range(count if three != 0 else 0):
            left |= three & met[m, h] & met[n, h] & met[i, h]
        for k in range(lanes if three & ~left != 0 else 0):
            if (three & ~left) >> k & 1:
                shared = _shared_by_three(images, (m, n, i), k, room)
                total[_BOTH + k] += shared
                if m < shading or i >= shading:
                    total[(0 if m < shading else _BLOCK) + k] += shared
    return left


@inner
def _shared_by_three(images, names, k, room):
    """Area of the square and three images together in one lane."""
    piece, corners = 0, 4
    write_square(room.pieces, 0)
    for m in names:
        edges = outline(images, m, k, room.polygons, 0)
        piece, corners = within(room.pieces, piece, corners, room.polygons, 0, edges)
    return area(room.pieces, piece, corners)


@inner
def _subtract(images, shading, count, k, total, room):
    """Write the unions of one lane by subtracting the images from the square."""
    names, some, shades = room.names, 0, 0
    for m in range(count):
        size = get(images.rows, m * IMAGE + AREA, k)
        if size > _NOTHING:  # large ones first
            n = some
            while n > (shades if m >= shading else 0) and size > get(images.rows, names[n - 1] * IMAGE + AREA, k):
                names[n] = names[n - 1]
                n -= 1
            names[n], some = m, some + 1
            shades = some if m < shading else shades
    for n in range(some):
        room.corners[n] = outline(images, names[n], k, room.polygons, 2 * CORNERS * n)
    for first in (0, shades):
        write_square(room.pieces, 0)
        room.open[0] = room.open[1] = 0.0
        leave_open(room.polygons, room.corners, first, shades, some, room.pieces, 0, 4, 8, room.open)
        if first == 0:
            total[k], total[_BOTH + k] = SQUARE - room.open[0], SQUARE - room.open[1]
    total[_BLOCK + k] = SQUARE - room.open[1]


#: Shared area that is left out.
_NO_SHARE = 1e-15
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
            found |= np.int64(total > _NO_SHARE) << k
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

"""Exact areas of unions of images, for all lanes of a packet.

If no four images of a lane overlap one another, the union is the sum of their areas minus the areas that pairs of them
share, plus the areas that three of them share. In the other lanes, and where edges tie or a mirror straddles the plane
of the test mirror, the images are subtracted from the square one by one.

Sets of lanes are integers with a bit for each lane. A lane's way depends on its own images only, and they keep the
order of the search: the bits of a lane do not depend on its packet.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inner, kernel
from heliosweep.kernels.field.images import AREA, IMAGE, Images, outline
from heliosweep.kernels.field.overlaps import shared_by_two
from heliosweep.kernels.field.polygons import CORNERS, SQUARE, area, larger, leave_open, smaller, within, write_square
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
            for i in range(n if met[m, n] & ~left != 0 else 0):
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

"""Exact areas of unions of images, for all lanes of a packet.

By inclusion and exclusion while no four images of a lane overlap one another: the sum of the areas, less the overlaps
of pairs, plus the overlaps of triples. Shade, block and both together share all terms. The other lanes, few, subtract
their images from the square one by one.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.images import AREA, IMAGE_ROWS, larger, outline, straddles
from heliosweep.kernels.overlaps import OVERLAP_ROWS, SHARED, pack, shared_by_three, shared_by_two
from heliosweep.kernels.packets import PACKET
from heliosweep.kernels.polygons import SQUARE, gaps

__all__ = ["LANE_ROWS", "ROOM_ROWS", "unions"]

_PAIRWISE = 12
"""Images in one lane up to which pairs are tried before the general union."""

LANE_ROWS = 2
"""Rows of integers for each image, and as many before them. Of an image: its bit in the lane (0: no image), and the
bits of the images that it overlaps. Before: how many images a lane has, and whether it takes the general way."""
_GENERAL, _PARTNERS = PACKET, PACKET

ROOM_ROWS = OVERLAP_ROWS + 2
"""Rows of room that the overlaps need, then what a pair shares, and what a triple shares."""
_PAIR, _TRIPLE = OVERLAP_ROWS * PACKET, (OVERLAP_ROWS + 1) * PACKET

_BLOCK, _BOTH = PACKET, 2 * PACKET
"""Rows of the totals, after that of shade."""


@kernel
def unions(
    images: NDArray[np.float64],
    apart: NDArray[np.bool_],
    shading: int,
    count: int,
    total: NDArray[np.float64],
    lane: NDArray[np.int64],
    room: NDArray[np.float64],
    lanes: int,
) -> None:
    """Exact areas of the unions of images, for every lane, on the square of area 4.

    Which way a lane goes depends on its own images only, and they keep the order of the grid: the bits of a lane do
    not depend on its packet.

    Parameters
    ----------
    images : ndarray, shape (at least count * IMAGE_ROWS * PACKET,)
        Shading images, then blocking images.
    apart : ndarray of bool, shape (at least count,)
        Whether each was made with disjoint bounding spheres.
    shading, count : int
        Number of shading images, and of all images.
    total : ndarray, shape (3 * PACKET,)
        Receives the rows: area shaded, area blocked, area shaded or blocked.
    lane : ndarray of int64, shape (at least LANE_ROWS * (count + 1) * PACKET,)
        Scratch.
    room : ndarray, shape (ROOM_ROWS * PACKET,)
        Scratch.
    lanes : int
        Lanes of the packet, a multiple of `packets.GROUP`.
    """
    if count < 2:
        row = _BLOCK if shading == 0 else 0
        for k in range(lanes):
            area = images[AREA + k] if count == 1 else 0.0
            total[k] = total[_BLOCK + k] = 0.0
            total[row + k] = total[_BOTH + k] = area
        return
    if _sums(images, shading, count, total, lane, lanes) == 0:
        return
    for m in range(count):
        if not apart[m]:
            for k in range(lanes):
                image = m * IMAGE_ROWS * PACKET + k
                if images[image + AREA] > 0.0 and straddles(images, image):
                    lane[_GENERAL + k] = 1
    # At grazing sun a packet has hundreds of images, but few share a lane where pairs could be enough: `where` has a
    # bit for each such lane of an image.
    where = np.zeros(count, np.int64)
    for m in range(count):
        bit = LANE_ROWS * (m + 1) * PACKET
        for k in range(lanes):
            where[m] |= ((lane[bit + k] != 0) & (lane[k] > 1) & (lane[_GENERAL + k] == 0)) << k
    names = np.empty(PACKET, np.int64)
    for m in range(1, count):
        for n in range(m):
            if where[m] & where[n] == 0 or not _may_overlap(images, n, m, lane, room, lanes):
                continue
            _pair(images, n, m, room, names, lanes)
            if m < shading or n >= shading:
                row = _BLOCK if n >= shading else 0
                for k in range(lanes):
                    total[row + k] -= room[_PAIR + k]
            for k in range(lanes):
                total[_BOTH + k] -= room[_PAIR + k]
            thirds = _meet(n, m, room, lane, lanes)
            for o in range(n):
                if thirds != 0 and _triple(images, o, n, m, thirds, room, lane, names, lanes):
                    row = _BLOCK if o >= shading else 0
                    for k in range(lanes):
                        total[_BOTH + k] += room[_TRIPLE + k]
                        total[row + k] += room[_TRIPLE + k] if m < shading or o >= shading else 0.0
    for k in range(lanes):
        if lane[_GENERAL + k] > 0 and lane[k] > 1:
            total[k], total[_BLOCK + k], total[_BOTH + k] = _general(images, apart, shading, count, k)


@kernel
def _sums(images, shading, count, total, lane, lanes):
    """Sums of the areas, and who is in which lane; returns in how many lanes images may overlap."""
    for k in range(lanes):
        total[k] = total[_BLOCK + k] = total[_BOTH + k] = 0.0
        lane[k] = lane[_GENERAL + k] = 0
    for m in range(count):
        area, bit = m * IMAGE_ROWS * PACKET + AREA, LANE_ROWS * (m + 1) * PACKET
        row = _BLOCK if m >= shading else 0
        for k in range(lanes):
            here = images[area + k] > 0.0
            lane[bit + k] = (1 << (lane[k] & 31)) if here else 0
            lane[bit + _PARTNERS + k] = 0
            lane[k] += here
            total[row + k] += images[area + k]
    several = 0
    for k in range(lanes):
        total[_BOTH + k] = total[k] + total[_BLOCK + k]
        lane[_GENERAL + k] = lane[k] > _PAIRWISE
        several += lane[k] > 1
    return several


@kernel
def _may_overlap(images, n, m, lane, room, lanes):
    """Mark the lanes where images n and m are both, and overlap by the separating axes; False if there is none."""
    n, m = max(n, 0), max(m, 0)  # an index that may be negative would keep the loop from becoming vector code
    one, other = n * IMAGE_ROWS * PACKET, m * IMAGE_ROWS * PACKET
    p, q = LANE_ROWS * (n + 1) * PACKET, LANE_ROWS * (m + 1) * PACKET
    some = 0
    for k in range(lanes):
        cx, cy = images[other + k] - images[one + k], images[other + PACKET + k] - images[one + PACKET + k]
        ax, ay = images[one + 2 * PACKET + k], images[one + 3 * PACKET + k]
        bx, by = images[one + 4 * PACKET + k], images[one + 5 * PACKET + k]
        px, py = images[other + 2 * PACKET + k], images[other + 3 * PACKET + k]
        qx, qy = images[other + 4 * PACKET + k], images[other + 5 * PACKET + k]
        ab, pq = abs(ax * by - ay * bx), abs(px * qy - py * qx)
        ap, aq = abs(ax * py - ay * px), abs(ax * qy - ay * qx)
        bp, bq = abs(bx * py - by * px), abs(bx * qy - by * qx)
        gap = larger(abs(cx * ay - cy * ax) - ab - ap - aq, abs(cx * by - cy * bx) - ab - bp - bq)
        gap = larger(gap, abs(cx * py - cy * px) - pq - ap - bp)
        gap = larger(gap, abs(cx * qy - cy * qx) - pq - aq - bq)
        hit = (lane[p + k] != 0) & (lane[q + k] != 0) & (lane[_GENERAL + k] == 0) & (gap < 0.0) & (pq > 0.0)
        room[_PAIR + k] = 1.0 if hit else 0.0
        some += hit
    return some > 0


@kernel
def _pair(images, n, m, room, names, lanes):
    """Write the areas of square and images n and m together, in the lanes marked."""
    active = np.int64(0)
    for k in range(lanes):
        if room[_PAIR + k] > 0.0:
            names[active] = k
            active += 1
            room[_PAIR + k] = 0.0
    filled = pack(images, n * IMAGE_ROWS * PACKET, names, active, room, np.int64(0))
    pack(images, m * IMAGE_ROWS * PACKET, names, active, room, np.int64(1))
    shared_by_two(room, filled)
    for k in range(active):
        room[_PAIR + names[k]] = room[SHARED + k]


@kernel
def _meet(n, m, room, lane, lanes):
    """Note that n and m overlap wherever they share area; the bits of images that overlap both, of all lanes."""
    p, q = max(LANE_ROWS * (n + 1) * PACKET, 0), max(LANE_ROWS * (m + 1) * PACKET, 0)
    thirds = 0
    for k in range(lanes):
        here = room[_PAIR + k] > 0.0
        thirds |= (lane[p + _PARTNERS + k] & lane[q + _PARTNERS + k]) if here else 0
        lane[p + _PARTNERS + k] |= lane[q + k] if here else 0
        lane[q + _PARTNERS + k] |= lane[p + k] if here else 0
    return thirds


@kernel
def _triple(images, o, n, m, thirds, room, lane, names, lanes):
    """Write the areas that an earlier image o shares with n and m, where all three overlap; False if nowhere.

    A triple comes up once, with the last of its pairs. Where a fourth image may meet it, a lane takes the general way.
    """
    p, q, r = LANE_ROWS * (n + 1) * PACKET, LANE_ROWS * (m + 1) * PACKET, LANE_ROWS * (o + 1) * PACKET
    active = np.int64(0)
    for k in range(lanes):
        if lane[r + k] & thirds == 0 or room[_PAIR + k] == 0.0 or lane[_GENERAL + k] != 0:
            continue
        common = lane[p + _PARTNERS + k] & lane[q + _PARTNERS + k]
        if lane[r + k] & common != 0:
            if lane[r + _PARTNERS + k] & common != 0:
                lane[_GENERAL + k] = 1
            else:
                names[active] = k
                active += 1
    if active == 0:
        return False
    filled = np.int64(0)
    for place, image in enumerate((o, n, m)):
        filled = pack(images, image * IMAGE_ROWS * PACKET, names, active, room, place)
    shared_by_three(room, filled)
    for k in range(lanes):
        room[_TRIPLE + k] = 0.0
    for k in range(active):
        room[_TRIPLE + names[k]] = room[SHARED + k]
    return True


@kernel
def _general(images, apart, shading, count, k):
    """Unions in one lane, by subtracting the images from the square, large ones first."""
    order, areas = np.empty(count, np.int64), np.empty(count)
    some = shades = np.int64(0)  # a literal would compile the callees twice
    for m in range(count):
        if m == shading:
            shades = some
        here = images[m * IMAGE_ROWS * PACKET + AREA + k]
        if here > 0.0:
            n = some
            while n > (shades if m >= shading else 0) and here > areas[n - 1]:
                order[n], areas[n] = order[n - 1], areas[n - 1]
                n -= 1
            order[n], areas[n] = m, here
            some += 1
    if shading == count:
        shades = some
    polygons, corners = np.empty((some, 5, 2)), np.empty(some, np.int64)
    for m in range(some):
        corners[m] = outline(images, order[m] * IMAGE_ROWS * PACKET + k, apart[order[m]], polygons[m])
    unshaded, uncovered = gaps(polygons, corners, shades)
    if some - shades > 1:
        unblocked, _ = gaps(polygons[shades:], corners[shades:], some - shades)
    else:
        unblocked = SQUARE - (areas[shades] if some > shades else 0.0)
    return SQUARE - unshaded, SQUARE - unblocked, SQUARE - uncovered

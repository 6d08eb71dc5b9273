"""Exact areas of unions of images, for all lanes of a packet.

By inclusion and exclusion while no four images of a lane overlap one another: the sum of the areas, less the overlaps
of pairs, plus the overlaps of triples. Shade, block and both together share all terms. The other lanes, few, subtract
their images from the square one by one.

Sets of lanes are integers with a bit for each lane.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.images import AREA, IMAGE_ROWS, larger, outline, straddles
from heliosweep.kernels.overlaps import OVERLAP_ROWS, SHARED, pack, shared_by_three, shared_by_two
from heliosweep.kernels.packets import PACKET
from heliosweep.kernels.polygons import SQUARE, gaps

__all__ = ["PAIRS", "ROOM_ROWS", "unions"]

_PAIRWISE = 12
"""Images in one lane up to which pairs are tried before the general union."""
PAIRS = PACKET * _PAIRWISE * (_PAIRWISE - 1) // 2
"""Most pairs that overlap in some lane that has so few images."""

ROOM_ROWS = OVERLAP_ROWS + 1
"""Rows of room that the overlaps need, and one for what a pair or a triple shares."""
_SPREAD = OVERLAP_ROWS * PACKET

_NOTHING = 1e-14
"""Area of an image that the general way leaves out: no wider than rounding, its corners may be in disorder."""

_BLOCK, _BOTH = PACKET, 2 * PACKET
"""Rows of the totals, after that of shade."""

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@kernel
def unions(
    images: Floats,
    apart: NDArray[np.bool_],
    present: Integers,
    shading: int,
    count: int,
    total: Floats,
    room: Floats,
    partner: Integers,
    meeting: Integers,
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
    present : ndarray of int64, shape (at least count,)
        Lanes in which each is, as `images.image` gives them.
    shading, count : int
        Number of shading images, and of all images.
    total : ndarray, shape (3 * PACKET,)
        Receives the rows: area shaded, area blocked, area shaded or blocked.
    room : ndarray, shape (ROOM_ROWS * PACKET,)
        Scratch.
    partner, meeting : ndarray of int64, shape (PAIRS,)
        Scratch: of each pair that overlaps its earlier image, and the lanes where it does.
    lanes : int
        Lanes of the packet, a multiple of `packets.GROUP`.
    """
    several = _sums(images, present, shading, count, total, lanes)
    if several == 0:
        return
    general = _crowded(present, count) | _straddling(images, apart, present, count, several, lanes)
    names, first = np.empty(PACKET, np.int64), np.zeros(count + 1, np.int64)
    pairs = np.int64(0)  # those of image m are partner[first[m] : first[m + 1]], in rising order
    for m in range(count):
        for n in range(m):
            both = present[n] & present[m] & several & ~general
            if both != 0:
                both &= _overlapping(images, n, m, lanes)
            if both == 0:
                continue
            both = _shared(images, np.int64(-1), n, m, both, names, room, lanes)
            _add(-1.0, room, total, m < shading, n >= shading, lanes)
            partner[pairs], meeting[pairs] = n, both
            pairs += 1
            for e in range(first[n], first[n + 1]):
                o = partner[e]
                three = both & meeting[e] & _meeting_of(o, partner, meeting, first[m], pairs) & ~general
                # Where a fourth image meets the three, the inclusions would go on: such lanes take the general way.
                for earlier in range(first[n], e):
                    fourth = _meeting_of(partner[earlier], partner, meeting, first[m], pairs) & meeting[earlier]
                    general |= three & fourth & _meeting_of(partner[earlier], partner, meeting, first[o], first[o + 1])
                three &= ~general
                if three != 0:
                    _shared(images, o, n, m, three, names, room, lanes)
                    _add(1.0, room, total, m < shading, o >= shading, lanes)
        first[m + 1] = pairs
    general &= several
    for k in range(lanes):
        if general >> k & 1:
            total[k], total[_BLOCK + k], total[_BOTH + k] = _general(images, apart, shading, count, k)


@kernel
def _sums(images, present, shading, count, total, lanes):
    """Write the sums of the areas; returns the lanes that have several images."""
    for k in range(lanes):
        total[k] = total[_BLOCK + k] = 0.0
    once = several = np.int64(0)
    for m in range(count):
        area, row = m * IMAGE_ROWS * PACKET + AREA, _BLOCK if m >= shading else 0
        for k in range(lanes):
            total[row + k] += images[area + k]
        several |= once & present[m]
        once |= present[m]
    for k in range(lanes):
        total[_BOTH + k] = total[k] + total[_BLOCK + k]
    return several


@kernel
def _crowded(present, count):
    """Lanes that have more than `_PAIRWISE` images, 12 = 1100: counted in four binary digits, and full at 16."""
    one = two = four = eight = full = np.int64(0)
    for m in range(count if count > _PAIRWISE else 0):
        carry, one = one & present[m], one ^ present[m]
        carry, two = two & carry, two ^ carry
        carry, four = four & carry, four ^ carry
        carry, eight = eight & carry, eight ^ carry
        full |= carry
    return full | (eight & four & (two | one))


@kernel
def _straddling(images, apart, present, count, several, lanes):
    """Lanes with an image of a mirror that straddles the plane of the test mirror."""
    found = np.int64(0)
    for m in range(count):
        if not apart[m] and present[m] & several != 0:
            for k in range(lanes):
                if present[m] >> k & 1 and straddles(images, m * IMAGE_ROWS * PACKET + k):
                    found |= np.int64(1) << k
    return found


@kernel
def _overlapping(images, n, m, lanes):
    """Lanes where the parallelograms n and m overlap, by the separating axes."""
    n, m = max(n, 0), max(m, 0)  # an index that may be negative would keep the loop from becoming vector code
    one, other = n * IMAGE_ROWS * PACKET, m * IMAGE_ROWS * PACKET
    found = np.int64(0)
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
        found |= np.int64((gap < 0.0) & (pq > 0.0)) << k  # m is to have coordinates; n need not
    return found


@kernel
def _shared(images, o, n, m, some, names, room, lanes):
    """Write the areas that n, m and, unless it is negative, o share in some lanes, and 0 in the others.

    Returns the lanes that have any.
    """
    active = np.int64(0)
    for k in range(lanes):
        names[active] = k
        active += some >> k & 1
    filled = pack(images, n * IMAGE_ROWS * PACKET, names, active, room, np.int64(0))
    pack(images, m * IMAGE_ROWS * PACKET, names, active, room, np.int64(1))
    if o < 0:
        shared_by_two(room, filled)
    else:
        pack(images, o * IMAGE_ROWS * PACKET, names, active, room, np.int64(2))
        shared_by_three(room, filled)
    found = np.int64(0)
    for k in range(lanes):
        room[_SPREAD + k] = 0.0
    for k in range(active):
        room[_SPREAD + names[k]] = room[SHARED + k]
        found |= np.int64(room[SHARED + k] > 0.0) << names[k]
    return found


@inline
def _add(sign, room, total, shade, block, lanes):
    """Add what images share: to all, and to shade or block where all of them are of that kind."""
    row = _BLOCK if block else 0
    if shade or block:
        for k in range(lanes):
            total[row + k] += sign * room[_SPREAD + k]
    for k in range(lanes):
        total[_BOTH + k] += sign * room[_SPREAD + k]


@kernel
def _meeting_of(image, partner, meeting, start, stop):
    """Lanes where an image overlaps that whose pairs stand from `start` to `stop`."""
    for e in range(start, stop):
        if partner[e] == image:
            return meeting[e]
    return np.int64(0)


@kernel
def _general(images, apart, shading, count, k):
    """Unions in one lane, by subtracting the images from the square, large ones first."""
    order, areas = np.empty(count, np.int64), np.empty(count)
    some = shades = np.int64(0)  # a literal would compile the callees twice
    for m in range(count):
        if m == shading:
            shades = some
        here = images[m * IMAGE_ROWS * PACKET + AREA + k]
        if here > _NOTHING:
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

"""Exact areas of unions of images, for all lanes of a packet.

Images are added up by inclusion and exclusion while no four of a lane overlap one another: the sum of the areas, less
the overlaps of pairs, plus the overlaps of triples. Shade, block and both together share all terms. The other lanes,
few, subtract their images from the square one by one.

Sets of lanes are integers with a bit for each lane. Which way a lane goes depends on its own images only, and they keep
the order of the search, outward from the test mirror: the bits of a lane do not depend on its packet.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.images import AREA, IMAGE_ROWS, Images, larger, outline, straddles
from heliosweep.kernels.field.overlaps import OVERLAP_ROWS, SHARED, pack, shared_by_three, shared_by_two
from heliosweep.kernels.field.polygons import CORNERS, SQUARE, gaps
from heliosweep.kernels.vectors import PACKET, ROW, rows

_FEW = 5
"""Images in one lane up to which pairs are tried before the general way."""
_PAIRS = PACKET * _FEW * (_FEW - 1) // 2
"""Most pairs that overlap in some lane that has so few images."""

_SPREAD = OVERLAP_ROWS * ROW
"""Row of room, behind what the overlaps need, for what a pair or a triple shares in the lanes of the packet."""

_NOTHING = 1e-14
"""Area of an image that the general way leaves out: no wider than rounding, its corners may be in disorder."""

_BLOCK, _BOTH = ROW, 2 * ROW
"""Rows of the totals, after that of shade."""

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Room(NamedTuple):
    """Scratch for the unions of so many images."""

    overlaps: Floats
    """Rows of lanes."""
    lanes: Integers
    """Names of lanes that are packed."""
    first: Integers
    """Place of the first pair of each image, whose earlier image is `partner`, in rising order."""
    partner: Integers
    meeting: Integers
    """Lanes in which the two images of each pair overlap."""
    areas: Floats
    """Of one lane, image by image: areas, names, numbers of corners, and corners."""
    names: Integers
    corners: Integers
    polygons: Floats
    stack: Floats
    """Pieces of the square that the images of one lane leave open, as `polygons.gaps` keeps them."""
    pieces: Integers


@kernel
def room_for(count: int) -> Room:
    """Scratch for so many images."""
    return Room(
        rows(OVERLAP_ROWS + 1),
        np.empty(PACKET, np.int64),
        np.zeros(count + 1, np.int64),
        np.empty(_PAIRS, np.int64),
        np.empty(_PAIRS, np.int64),
        np.empty(count),
        np.empty(count, np.int64),
        np.empty(count, np.int64),
        np.empty(count * 2 * CORNERS),
        np.empty(2048),
        np.empty(256, np.int64),
    )


@inner
def unions(images: Images, shading: int, count: int, total: Floats, room: Room, lanes: int) -> None:
    """Exact areas of the unions of images, for every lane, on the square of area 4.

    Of `count` images the first ones, `shading` of them, shade. Written to the rows of `total`, shape (3 * ROW,), are
    the areas shaded, blocked, and shaded or blocked. `room` is scratch for at least so many images, and `lanes` a
    multiple of `packets.GROUP`.

    Rounding is some 1e-14, and grows with images a thousand times as large as the mirror, as the last thousandth of a
    radian before grazing incidence makes them: to 2e-12.
    """
    several, crowded = _counted(images.present, count)
    general = np.int64(0)
    if several != 0:
        general = _straddling(images, count, several, lanes)
        general |= crowded
    _add_areas(images.rows, shading, count, total, lanes)
    if several & ~general != 0:
        _meetings(images, several & ~general, count, room, lanes)
        general |= _cliques(count, room)
        _subtract_overlaps(images.rows, shading, count, ~general, total, room, lanes)
    if general != 0:
        for k in range(lanes):
            if general >> k & 1 and not _general(images, shading, count, k, total, room, room.stack, room.pieces):
                _general_with_more_room(images, shading, count, k, total, room)


@inner
def _counted(present, count):
    """Lanes that have several images, and those that have more than `_FEW`, 5 = 101 in binary digits."""
    one = two = four = several = crowded = np.int64(0)
    for m in range(count):
        carry, one = one & present[m], one ^ present[m]
        several |= carry
        carry, two = two & carry, two ^ carry
        carry, four = four & carry, four ^ carry
        crowded |= carry
    return several, crowded | (four & two)


@inner
def _straddling(images, count, several, lanes):
    """Lanes with several images and one of a mirror that straddles the plane of the test mirror."""
    found = np.int64(0)
    for m in range(count):
        some = images.present[m] & several
        if some != 0 and not images.apart[m]:
            for k in range(lanes):
                if some >> k & 1 and straddles(images.rows, m * IMAGE_ROWS * ROW + k):
                    found |= np.int64(1) << k
    return found


@inner
def _add_areas(images, shading, count, total, lanes):
    """Write the sums of the areas."""
    for k in range(lanes):
        total[k] = total[_BLOCK + k] = 0.0
    for m in range(count):
        area, row = m * IMAGE_ROWS * ROW + AREA, _BLOCK if m >= shading else 0
        for k in range(lanes):
            total[row + k] += images[area + k]
    for k in range(lanes):
        total[_BOTH + k] = total[k] + total[_BLOCK + k]


@inner
def _meetings(images, some, count, room, lanes):
    """List the pairs of images that overlap, and in which of the lanes."""
    pairs = np.int64(0)
    for m in range(count):
        here = images.present[m] & some
        for n in range(m if here != 0 else 0):
            both = images.present[n] & here
            if both != 0:
                both &= _overlapping(images.rows, n, m, lanes)
            if both != 0:
                room.partner[pairs], room.meeting[pairs] = n, both
                pairs += 1
        room.first[m + 1] = pairs


@inner
def _overlapping(images, n, m, lanes):
    """Lanes where the parallelograms n and m overlap, by the separating axes."""
    n, m = max(n, 0), max(m, 0)  # an index that may be negative would keep the loop from becoming vector code
    one, other = n * IMAGE_ROWS * ROW, m * IMAGE_ROWS * ROW
    found = np.int64(0)
    for k in range(lanes):
        cx, cy = images[other + k] - images[one + k], images[other + ROW + k] - images[one + ROW + k]
        ax, ay = images[one + 2 * ROW + k], images[one + 3 * ROW + k]
        bx, by = images[one + 4 * ROW + k], images[one + 5 * ROW + k]
        px, py = images[other + 2 * ROW + k], images[other + 3 * ROW + k]
        qx, qy = images[other + 4 * ROW + k], images[other + 5 * ROW + k]
        ab, pq = abs(ax * by - ay * bx), abs(px * qy - py * qx)
        ap, aq = abs(ax * py - ay * px), abs(ax * qy - ay * qx)
        bp, bq = abs(bx * py - by * px), abs(bx * qy - by * qx)
        gap = larger(abs(cx * ay - cy * ax) - ab - ap - aq, abs(cx * by - cy * bx) - ab - bp - bq)
        gap = larger(gap, abs(cx * py - cy * px) - pq - ap - bp)
        gap = larger(gap, abs(cx * qy - cy * qx) - pq - aq - bq)
        found |= np.int64((gap < 0.0) & (pq > 0.0)) << k  # m is to have coordinates; n need not
    return found


@inner
def _cliques(count, room):
    """Lanes where four images overlap one another: there the inclusions would go on."""
    first, partner, meeting = room.first, room.partner, room.meeting
    found = np.int64(0)
    for m in range(count):
        for d in range(first[m], first[m + 1]):
            for e in range(first[m], d):
                three = meeting[d] & meeting[e] & _meeting_of(room, partner[e], partner[d])
                for f in range(first[m], e if three & ~found != 0 else first[m]):
                    fourth = three & meeting[f] & _meeting_of(room, partner[f], partner[d])
                    found |= fourth & _meeting_of(room, partner[f], partner[e])
    return found


@inline
def _meeting_of(room, n, m):
    """Lanes where the images n < m overlap."""
    found = np.int64(0)
    for e in range(room.first[m], room.first[m + 1]):
        if room.partner[e] == n:
            found = room.meeting[e]
    return found


@inner
def _subtract_overlaps(images, shading, count, some, total, room, lanes):
    """Subtract what pairs of images share in some lanes, and add what triples share."""
    first, partner, meeting = room.first, room.partner, room.meeting
    for m in range(count):
        for d in range(first[m], first[m + 1]):
            n = partner[d]
            both = meeting[d] & some
            if both != 0:
                both = _shared(images, np.int64(-1), n, m, both, room, lanes)
                _add(-1.0, room.overlaps, total, m < shading, n >= shading, lanes)
            meeting[d] = both
            for e in range(first[m], d if both != 0 else first[m]):
                three = both & meeting[e] & _meeting_of(room, partner[e], n)
                if three != 0:
                    _shared(images, partner[e], n, m, three, room, lanes)
                    _add(1.0, room.overlaps, total, m < shading, partner[e] >= shading, lanes)


@inner
def _shared(images, o, n, m, some, room, lanes):
    """Write the areas that n, m and, unless it is negative, o share in some lanes, and 0 in the others.

    Returns the lanes that have any.
    """
    active = np.int64(0)
    for k in range(lanes):
        room.lanes[active] = k
        active += some >> k & 1
    filled = pack(images, n * IMAGE_ROWS * ROW, room.lanes, active, room.overlaps, np.int64(0))
    pack(images, m * IMAGE_ROWS * ROW, room.lanes, active, room.overlaps, np.int64(1))
    if o < 0:
        shared_by_two(room.overlaps, filled)
    else:
        pack(images, o * IMAGE_ROWS * ROW, room.lanes, active, room.overlaps, np.int64(2))
        shared_by_three(room.overlaps, filled)
    return _spread(room.overlaps, room.lanes, active, lanes)


@inner
def _spread(overlaps, names, active, lanes):
    """Put what the packed lanes share where these lanes are, and 0 elsewhere; returns the lanes that have any."""
    found = np.int64(0)
    for k in range(lanes):
        overlaps[_SPREAD + k] = 0.0
    for k in range(active):
        overlaps[_SPREAD + names[k]] = overlaps[SHARED + k]
        found |= np.int64(overlaps[SHARED + k] > 0.0) << names[k]
    return found


@inline
def _add(sign, overlaps, total, shade, block, lanes):
    """Add what images share: to all, and to shade or block where all of them are of that kind."""
    row = _BLOCK if block else 0
    if shade or block:
        for k in range(lanes):
            total[row + k] += sign * overlaps[_SPREAD + k]
    for k in range(lanes):
        total[_BOTH + k] += sign * overlaps[_SPREAD + k]


@inner
def _general(images, shading, count, k, total, room, stack, pieces):
    """Write the unions of one lane by subtracting the images from the square; returns whether the room sufficed."""
    shades = _largest_first(images.rows, np.int64(0), shading, k, room, np.int64(0))
    some = _largest_first(images.rows, shading, count, k, room, shades)
    for m in range(some):
        name = room.names[m]
        lane = name * IMAGE_ROWS * ROW + k
        room.corners[m] = outline(images.rows, lane, images.apart[name], room.polygons, 2 * CORNERS * m)
    unshaded, uncovered, fits = gaps(room.polygons, room.corners, np.int64(0), some, shades, stack, pieces)
    unblocked = SQUARE - (room.areas[shades] if some > shades else 0.0)
    if fits and some - shades > 1:
        unblocked, _, fits = gaps(room.polygons, room.corners, shades, some, some, stack, pieces)
    total[k], total[_BLOCK + k], total[_BOTH + k] = SQUARE - unshaded, SQUARE - unblocked, SQUARE - uncovered
    return fits


@inner
def _largest_first(images, start, stop, k, room, some):
    """List the images start..stop of a lane after `some` others, large ones first; returns the length of the list."""
    names, areas = room.names, room.areas
    begin = some
    for m in range(start, stop):
        area = images[m * IMAGE_ROWS * ROW + AREA + k]
        if area > _NOTHING:
            n = some
            while n > begin and area > areas[n - 1]:
                names[n], areas[n] = names[n - 1], areas[n - 1]
                n -= 1
            names[n], areas[n] = m, area
            some += 1
    return some


@kernel
def _general_with_more_room(images, shading, count, k, total, room):
    """`_general` with larger and larger scratch: hundreds of thin images may leave thousands of pieces."""
    size = 2 * room.stack.shape[0]
    while not _general(images, shading, count, k, total, room, np.empty(size), np.empty(size, np.int64)):
        size *= 2

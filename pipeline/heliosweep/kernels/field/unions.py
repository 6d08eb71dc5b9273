"""Exact areas of unions of images, for all lanes of a packet.

Where no three images of a lane overlap one another, the union is the sum of their areas, less what pairs of them share.
In other lanes images are put together by `boundaries`, group by group of lanes. Few lanes, those where edges tie, a
mirror straddles the plane of the test mirror or looks turned by half a right angle, or a crowd overlaps, subtract their
images from the square one by one.

Sets of lanes are integers with a bit for each lane. Which way a lane goes depends on its own images only, and they keep
the order of the search, outward from the test mirror: the bits of a lane do not depend on its packet.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.boundaries import (
    SLOT,
    SLOTS,
    WIDTH,
    Group,
    group_of_lanes,
    pair_of,
    prepare,
    union_areas,
)
from heliosweep.kernels.field.images import AREA, IMAGE_ROWS, Images, next_run, outline, straddles
from heliosweep.kernels.field.overlaps import shared_by_two
from heliosweep.kernels.field.polygons import CORNERS, SQUARE, gaps, larger, smaller
from heliosweep.kernels.vectors import GROUP, LANES, ROW, rows

_NOTHING = 1e-14
"""Area of an image that is not put together with others: no wider than rounding, its corners may be in disorder."""

_TOUCHING = 1e-3
"""Gap between images, times a half edge, below which they are taken to overlap: edges of theirs that touch may tie."""
_FEW = 8
"""Images up to which two groups of lanes are put together at once: of more, each has many that the other has not."""
_MOST = 24
"""Images of a lane that overlap others up to which they are put together."""
_KEPT = 64
"""Images of which it is kept in which lanes each two overlap."""
_BLOCK, _BOTH = ROW, 2 * ROW
"""Rows of the totals, after that of shade."""


class Room(NamedTuple):
    """Scratch for the unions of so many images."""

    meeting: Integers
    """Lanes in which each image overlaps another, and in which it overlaps several."""
    several: Integers
    met: Integers
    """Lanes in which two images overlap, of all pairs of the first `_KEPT`."""
    shared: Floats
    """Areas that two images share, a row."""
    group: Group
    """Of a group of lanes."""
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
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.empty(_KEPT * (_KEPT - 1) // 2, np.int64),
        rows(1),
        group_of_lanes(),
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
    multiple of `vectors.GROUP`.

    Rounding is some 1e-14, and grows with images a thousand times as large as the mirror, as the last thousandth of a
    radian before grazing incidence makes them: to 2e-12.
    """
    several, general, many = _several(images.present, count), np.int64(0), np.int64(0)
    pairs = np.int64(0)
    if several != 0:
        general = _straddling(images, count, several, lanes)
        meeting = _meetings(images, several & ~general, count, room, lanes)
        if meeting != 0:
            many = _more_than_two(room.several, count)  # in others, no three overlap one another
            pairs, crowded = meeting & ~many, _crowded(room.meeting, count, lanes)
            general, many = general | crowded, many & ~crowded
    _add_areas(images.rows, shading, count, many, total, room.meeting, lanes)
    if pairs != 0:
        general |= _subtract_overlaps(images, pairs, shading, count, total, room, lanes)
    if many != 0:
        general |= _put_together(images.rows, many, shading, count, total, room, lanes)
    for k in range(lanes if general != 0 else 0):
        if general >> k & 1 and not _general(images, shading, count, k, total, room, room.stack, room.pieces):
            _general_with_more_room(images, shading, count, k, total, room)


@inner
def _several(present, count):
    """Lanes that have several images."""
    one = several = np.int64(0)
    for m in range(count):
        several |= one & present[m]
        one |= present[m]
    return several


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
def _add_areas(images, shading, count, some, total, meeting, lanes):
    """Write the sums of the areas of images that overlap none."""
    for k in range(lanes):
        total[k] = total[_BLOCK + k] = 0.0
    for m in range(count):
        area, row = m * IMAGE_ROWS * ROW + AREA, _BLOCK if m >= shading else 0
        here = meeting[m] & some
        if here == 0:
            for k in range(lanes):
                total[row + k] += images[area + k]
        else:
            for k in range(lanes):
                total[row + k] += 0.0 if here >> k & 1 else images[area + k]
    for k in range(lanes):
        total[_BOTH + k] = total[k] + total[_BLOCK + k]


@inner
def _meetings(images, some, count, room, lanes):
    """List in which of some lanes each image overlaps others, and several; returns the lanes where any do."""
    meeting, several, found = room.meeting, room.several, np.int64(0)
    for m in range(count):
        meeting[m] = several[m] = 0
        here = images.present[m] & some
        for n in range(m if here != 0 else 0):
            both = images.present[n] & here
            if both != 0:
                both = _overlapping(images.rows, n, m, both, lanes)
            if m < _KEPT:
                room.met[m * (m - 1) // 2 + n] = both
            if both != 0:
                several[n] |= meeting[n] & both
                several[m] |= meeting[m] & both
                meeting[n] |= both
                meeting[m] |= both
                found |= both
    return found


@inline
def _met(images, n, m, some, room, lanes):
    """Those of some lanes where an image m overlaps an earlier one n, if it overlaps any there."""
    if m < _KEPT:
        return room.met[m * (m - 1) // 2 + n] & some
    return _overlapping(images, n, m, room.meeting[n] & room.meeting[m] & some, lanes)


@inner
def _overlapping(images, n, m, some, lanes):
    """Those of some lanes where the parallelograms n and m overlap, and neither has next to no area."""
    found = np.int64(0)
    start, stop = next_run(0, some, lanes)
    while start < stop:
        found |= _overlaps(images, n * IMAGE_ROWS * ROW + start, m * IMAGE_ROWS * ROW + start, stop - start) << start
        start, stop = next_run(stop, some, lanes)
    return found & some


@inner
def _overlaps(images, one, other, lanes):
    """Lanes where the parallelograms that begin at `one` and `other` overlap, by the separating axes."""
    one, other, found = max(one, 0), max(other, 0), np.int64(0)
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
        area = smaller(images[one + AREA + k], images[other + AREA + k])
        found |= np.int64((gap < _TOUCHING) & (area > _NOTHING)) << k
    return found


@inner
def _more_than_two(lanes_of, count):
    """Lanes that more than two images have, by the lanes of each."""
    one = two = many = np.int64(0)
    for m in range(count):
        many |= two & lanes_of[m]
        two |= one & lanes_of[m]
        one |= lanes_of[m]
    return many


@inner
def _subtract_overlaps(images, some, shading, count, total, room, lanes):
    """Subtract what pairs of images share in lanes where no three overlap; returns the lanes where edges tie."""
    tied = np.int64(0)
    for m in range(count):
        for n in range(m if room.meeting[m] & some != 0 else 0):
            both = _met(images.rows, n, m, some, room, lanes)
            start, stop = next_run(0, both, lanes)
            while start < stop:
                one, other = n * IMAGE_ROWS * ROW + start, m * IMAGE_ROWS * ROW + start
                tied |= (shared_by_two(images.rows, one, other, room.shared, stop - start) << start) & both
                _subtract(room.shared, both >> start, total, _BOTH + start, stop - start)
                if m < shading or n >= shading:
                    kind = _BLOCK if n >= shading else np.int64(0)
                    _subtract(room.shared, both >> start, total, kind + start, stop - start)
                start, stop = next_run(stop, both, lanes)
    return tied


@inner
def _subtract(shared, some, total, row, lanes):
    """Subtract what is shared in some lanes."""
    row = max(row, 0)
    for k in range(lanes):
        total[row + k] -= shared[k] if some >> k & 1 else 0.0


@inner
def _crowded(meeting, count, lanes):
    """Lanes in which more than `_MOST` images overlap others."""
    crowded = np.int64(0)
    for k in range(lanes if count > _MOST else 0):
        found = np.int64(0)
        for m in range(count):
            found += meeting[m] >> k & 1
        crowded |= np.int64(found > _MOST) << k
    return crowded


@inner
def _put_together(images, some, shading, count, total, room, lanes):
    """Add what images that overlap cover together, in some lanes; returns the lanes where edges tie."""
    tied, start = np.int64(0), np.int64(0)
    while start < lanes:
        filled = GROUP
        if some >> start & LANES != 0:
            while filled < WIDTH and start + filled < lanes and some >> start + filled & LANES != 0:
                filled += GROUP
            if _images(room.meeting, some & _lanes(start, filled), count) > _FEW:
                filled = GROUP
            here = some & _lanes(start, filled)
            if _images(room.meeting, here, count) <= SLOTS:
                tied |= _put_group_together(images, here, shading, count, total, room, start, filled)
            else:
                for k in range(start, start + filled):
                    lane = here & np.int64(1) << k
                    tied |= _put_group_together(images, lane, shading, count, total, room, start, filled)
        start += filled
    return tied


@inline
def _lanes(start, count):
    """Some lanes, a bit for each."""
    return (np.int64(1) << count) - 1 << start


@inner
def _images(meeting, here, count):
    """Number of images that overlap others in some lanes."""
    found = np.int64(0)
    for m in range(count):
        found += np.int64(meeting[m] & here != 0)
    return found


@inner
def _put_group_together(images, here, shading, count, total, room, start, lanes):
    """The same in some of the lanes of one group."""
    shades = slots = np.int64(0)
    for m in range(count):
        if room.meeting[m] & here != 0:
            image, mask = m * IMAGE_ROWS * ROW + start, (room.meeting[m] & here) >> start
            room.group.edges[slots] = prepare(images, image, mask, room.group.slots, slots * SLOT, lanes)
            room.group.names[slots] = m
            for i in range(slots):
                both = _met(images, room.group.names[i], m, here, room, start + lanes)
                room.group.met[pair_of(i, slots)] = both >> start
            slots += 1
            shades += np.int64(m < shading)
    tied = np.int64(0)
    if shades > 0:
        tied |= union_areas(room.group, np.int64(0), np.int64(0), shades, lanes)
        _add_ends(room.group.ends, total, start, lanes)
    if slots > shades:
        tied |= union_areas(room.group, shades, shades, slots, lanes)
        _add_ends(room.group.ends, total, _BLOCK + start, lanes)
    if 0 < shades < slots:
        tied |= union_areas(room.group, np.int64(0), shades, slots, lanes)
    if slots > 0:
        _add_ends(room.group.ends, total, _BOTH + start, lanes)
    return tied << start


@inner
def _add_ends(ends, total, row, lanes):
    """Add the areas of a group."""
    row = max(row, 0)
    for k in range(lanes):
        total[row + k] += ends[k]


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

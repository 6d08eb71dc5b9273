"""Areas of unions of images that overlap, by what is visible of their edges.

The boundary of a union is what is left of the edges of each image outside all others. Along an edge c + t d, t from -1
to 1, another image covers an interval: between its two pairs of sides, each of which the edge's line crosses. Intervals
are put together, and by Green's theorem the integral of (y + 1) dx along what they leave is the area, where y is
clamped to the square and x too.

Where two edges nearly coincide, their crossing is ill defined, and the two must not both be taken as hidden, or both
as visible. So each crossing is computed once, on the line of one edge, and put on the other as the nearest point: it
may be misplaced along the edges, where they are as good as one. Three such edges could still be seen to hide one
another in turn: lanes where two edges coincide within some 1e-8 are left to another way.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.polygons import edge_term, larger, slopes, smaller, unit
from heliosweep.kernels.vectors import GROUP, ROW, aligned

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SLOTS = 32
"""Most images of a group of lanes, each a bit of an integer."""

WIDTH = 2 * GROUP
"""Most lanes that are done together: of one group alone every step would wait for the one before."""

_A, _B, _SLOPES, _TURN, _COUNTS = 2 * WIDTH, 4 * WIDTH, 6 * WIDTH, 10 * WIDTH, 11 * WIDTH
SLOT = 19 * WIDTH
"""Numbers of an image in a group of lanes: centre, half edges a and b (x, y of each); the slopes of a and b; their
vector product; and for each edge, at -b and b along a, at -a and a along b, from where to where it counts."""
_PAIR = 8 * WIDTH
"""Numbers of an ordered pair of images: from where to where the other covers each edge of the one."""
_OPEN, _INTERVALS = WIDTH, WIDTH + _PAIR
"""Rows of ends, behind the areas: what is open of each edge of an image; what is covered between the ends of one."""

_NOWHERE = 1e15
"""Place of an image without area, so far away that edges of the largest images do not reach it."""
_PARALLEL = 1e-8
"""Sine of an angle below which edges are as good as parallel, and the crossings of their lines no points of theirs."""
_BEYOND = 4.0
"""Crossings of such lines further from the middle of an edge, in half edges, are no tie."""


class Group(NamedTuple):
    """Images of a group of lanes."""

    slots: Floats
    """`SLOT` numbers of each image."""
    masks: Integers
    """Lanes in which each is, a bit for each lane."""
    inside: Integers
    """Images that cover something between the ends of edges of each, a bit for each."""
    pairs: Floats
    ends: Floats
    """Areas, and ends of what is open of edges."""


@kernel
def group_of_lanes() -> Group:
    """Room for a group of lanes."""
    return Group(
        aligned(SLOTS * SLOT),
        np.empty(SLOTS, np.int64),
        np.zeros(SLOTS, np.int64),
        aligned(SLOTS * (SLOTS - 1) * _PAIR),
        aligned(_INTERVALS + 2 * SLOTS * WIDTH),
    )


@inner
def prepare(images: Floats, image: int, some: int, slots: Floats, o: int, lanes: int) -> None:
    """Write an image in some lanes to a slot that begins at `o`, and an image that is nowhere to the others.

    The image begins at `image` in `images`.
    """
    image, o = max(image, 0), max(o, 0)
    for k in range(lanes):
        here = some >> k & 1 == 1
        cx, cy = images[image + k] if here else _NOWHERE, images[image + ROW + k] if here else _NOWHERE
        ax, ay = images[image + 2 * ROW + k] if here else 1.0, images[image + 3 * ROW + k] if here else 0.0
        bx, by = images[image + 4 * ROW + k] if here else 1.0, images[image + 5 * ROW + k] if here else 0.0
        slots[o + k], slots[o + WIDTH + k] = cx, cy
        slots[o + _A + k], slots[o + _A + WIDTH + k] = ax, ay
        slots[o + _B + k], slots[o + _B + WIDTH + k] = bx, by
        slots[o + _SLOPES + k], slots[o + _SLOPES + WIDTH + k] = slopes(ax, ay)
        slots[o + _SLOPES + 2 * WIDTH + k], slots[o + _SLOPES + 3 * WIDTH + k] = slopes(bx, by)
        slots[o + _TURN + k] = ax * by - ay * bx
        rx, ry, sx, sy = _inverse(ax), _inverse(ay), _inverse(bx), _inverse(by)
        w = o + _COUNTS + k
        slots[w], slots[w + WIDTH] = _counting(cx - bx, cy - by, rx, ry)
        slots[w + 2 * WIDTH], slots[w + 3 * WIDTH] = _counting(cx + bx, cy + by, rx, ry)
        slots[w + 4 * WIDTH], slots[w + 5 * WIDTH] = _counting(cx - ax, cy - ay, sx, sy)
        slots[w + 6 * WIDTH], slots[w + 7 * WIDTH] = _counting(cx + ax, cy + ay, sx, sy)


@inline
def _inverse(value):
    """Reciprocal of a component of an edge, never infinite: an edge along an axis is taken as turned a little."""
    return 1.0 / (value if abs(value) > 1e-290 else 1e-290)


@inline
def _counting(mx, my, rx, ry):
    """Where the edge m + t d counts, for the reciprocals of d: with x in the square, and y above its lower side."""
    one, other, level = (-1.0 - mx) * rx, (1.0 - mx) * rx, (-1.0 - my) * ry
    low, high = larger(smaller(one, other), -1.0), smaller(larger(one, other), 1.0)
    low = larger(low, level) if ry > 0.0 else low
    high = high if ry > 0.0 else smaller(high, level)
    return low, larger(high, low)


@inner
def union_areas(group: Group, first: int, middle: int, last: int, lanes: int) -> np.int64:
    """Write the areas that images first..last of a group cover of the square together to the first row of its ends.

    Where `middle` is not `first`, this has been called for the images up to there, and for those from there on. Returns
    the lanes in which two edges tie.
    """
    slots, pairs, ends, masks = group.slots, group.pairs, group.ends, group.masks
    tied = np.int64(0)
    for k in range(lanes):
        ends[k] = 0.0
    for i in range(first, last):
        o, inside = i * SLOT, np.int64(0) if middle == first else group.inside[i]
        _copy(slots, o + _COUNTS, ends, _OPEN, lanes)
        for j in range(first if i >= middle else i, i if middle == first else min(i, middle)):
            if masks[i] & masks[j] != 0:
                inside |= np.int64(_shorten(pairs, _block(i, j), ends, lanes) != 0) << j
        for j in range(max(i + 1, middle), last if middle == first or i < middle else i):
            if masks[i] & masks[j] != 0:
                near, between = _cover(slots, o, j * SLOT, pairs, _block(i, j), ends, lanes)
                tied |= near & masks[i] & masks[j]
                inside |= np.int64(between != 0) << j
        group.inside[i] = inside
        _copy(ends, _OPEN, slots, o + _COUNTS, lanes)
        _add_open(slots, o, ends, lanes)
        for e in range(4 if inside != 0 else 0):
            _take_out_inside(slots, pairs, i, e, first, last, ends, inside, lanes)
    return tied


@inline
def _block(i, j):
    """Start of what image j covers of image i: of both together, for they are found together."""
    low, high = min(i, j), max(i, j)
    return (high * (high - 1) + 2 * low) * _PAIR + (0 if i < j else _PAIR)


@inner
def _copy(one, at, other, to, lanes):
    """Copy what is open of the four edges of an image."""
    at, to = max(at, 0), max(to, 0)
    for k in range(lanes):
        other[to + k], other[to + WIDTH + k] = one[at + k], one[at + WIDTH + k]
        other[to + 2 * WIDTH + k], other[to + 3 * WIDTH + k] = one[at + 2 * WIDTH + k], one[at + 3 * WIDTH + k]
        other[to + 4 * WIDTH + k], other[to + 5 * WIDTH + k] = one[at + 4 * WIDTH + k], one[at + 5 * WIDTH + k]
        other[to + 6 * WIDTH + k], other[to + 7 * WIDTH + k] = one[at + 6 * WIDTH + k], one[at + 7 * WIDTH + k]


@inner
def _cover(slots, i, j, pairs, ij, ends, lanes):
    """Write the intervals of two images, and shorten what is open of the edges of the one.

    Returns the lanes in which edges of theirs tie, and those in which the other covers something between the ends.

    With c from the first centre to the second, the line s g + t e meets c + s' h + t' f, s and s' -1 or 1, at

        t = (c x f + s' h x f - s g x f) / (e x f),

    and t' is that of the nearest point of the second. Here e and g are a and b of the one, f and h are p and q of the
    other, and the reverse.
    """
    i, j, ij = max(i, 0), max(j, 0), max(ij, 0)
    ji = ij + _PAIR
    tied = between = np.int64(0)
    for k in range(lanes):
        cx, cy = slots[j + k] - slots[i + k], slots[j + WIDTH + k] - slots[i + WIDTH + k]
        ax, ay, bx, by = slots[i + _A + k], slots[i + _A + WIDTH + k], slots[i + _B + k], slots[i + _B + WIDTH + k]
        px, py, qx, qy = slots[j + _A + k], slots[j + _A + WIDTH + k], slots[j + _B + k], slots[j + _B + WIDTH + k]
        turn = slots[j + _TURN + k]
        ap, aq, bp, bq = ax * py - ay * px, ax * qy - ay * qx, bx * py - by * px, bx * qy - by * qx
        cp, cq = cx * py - cy * px, cx * qy - cy * qx
        a, b = abs(ax) + abs(ay), abs(bx) + abs(by)
        p, q = abs(px) + abs(py), abs(qx) + abs(qy)
        # Of the edges at g and at -g, with those of the other at h and at -h.
        ap_pp, ap_pm, ap_mp, ap_mm, tie_ap = _crossings(cp, -turn, bp, ap, a * p)
        bp_pp, bp_pm, bp_mp, bp_mm, tie_bp = _crossings(cp, -turn, ap, bp, b * p)
        aq_pp, aq_pm, aq_mp, aq_mm, tie_aq = _crossings(cq, turn, bq, aq, a * q)
        bq_pp, bq_pm, bq_mp, bq_mm, tie_bq = _crossings(cq, turn, aq, bq, b * q)
        one = _put(pairs, ij + k, ap_mm, ap_mp, aq_mm, aq_mp, ends, 0, k)
        two = _put(pairs, ij + 2 * WIDTH + k, ap_pm, ap_pp, aq_pm, aq_pp, ends, 2, k)
        three = _put(pairs, ij + 4 * WIDTH + k, bp_mm, bp_mp, bq_mm, bq_mp, ends, 4, k)
        four = _put(pairs, ij + 6 * WIDTH + k, bp_pm, bp_pp, bq_pm, bq_pp, ends, 6, k)
        # The same points along the edges of the other, from their middles.
        scale = 1.0 / (px * px + py * py)
        e, f, g = (ax * px + ay * py) * scale, (bx * px + by * py) * scale, (qx * px + qy * py) * scale
        middle = (cx * px + cy * py) * scale
        m = g - middle
        _write(pairs, ji + k, m - f + ap_mm * e, m + f + ap_pm * e, m - e + bp_mm * f, m + e + bp_pm * f)
        m = -g - middle
        _write(pairs, ji + 2 * WIDTH + k, m - f + ap_mp * e, m + f + ap_pp * e, m - e + bp_mp * f, m + e + bp_pp * f)
        scale = 1.0 / (qx * qx + qy * qy)
        e, f, g = (ax * qx + ay * qy) * scale, (bx * qx + by * qy) * scale, (qx * px + qy * py) * scale
        middle = (cx * qx + cy * qy) * scale
        m = g - middle
        _write(pairs, ji + 4 * WIDTH + k, m - f + aq_mm * e, m + f + aq_pm * e, m - e + bq_mm * f, m + e + bq_pm * f)
        m = -g - middle
        _write(pairs, ji + 6 * WIDTH + k, m - f + aq_mp * e, m + f + aq_pp * e, m - e + bq_mp * f, m + e + bq_pp * f)
        tied |= np.int64(tie_ap | tie_aq | tie_bp | tie_bq) << k
        between |= np.int64(one | two | three | four) << k
    return tied, between


@inline
def _crossings(cf, hf, gf, ef, size):
    """Crossings t for (s, s') = (1, 1), (1, -1), (-1, 1), (-1, -1), from c x f, h x f, g x f, e x f; and any tie.

    `size` is a bound of |e| |f|.
    """
    least = _PARALLEL * size
    parallel = abs(ef) < least
    inverse = 1.0 / (least if parallel else ef)
    middle, above, aside = cf * inverse, hf * inverse, gf * inverse
    one, other = middle - aside, middle + aside
    near = smaller(abs(abs(one) - abs(above)), abs(abs(other) - abs(above)))
    return one + above, one - above, other + above, other - above, parallel & (near < _BEYOND)


@inline
def _write(pairs, at, one, other, third, fourth):
    """Write the interval between two crossings and between two others."""
    low = larger(smaller(one, other), smaller(third, fourth))
    high = smaller(larger(one, other), larger(third, fourth))
    pairs[at], pairs[at + WIDTH] = low, high
    return low, high


@inline
def _put(pairs, at, one, other, third, fourth, ends, row, k):
    """The same, and shorten what is open of the edge."""
    low, high = _write(pairs, at, one, other, third, fourth)
    return _shorten_one(low, high, ends, row, k)


@inline
def _shorten_one(low, high, ends, row, k):
    """Take an interval from what is open of an edge if it holds an end; returns whether it is between the ends."""
    begin, end = ends[_OPEN + row * WIDTH + k], ends[_OPEN + (row + 1) * WIDTH + k]
    first, last = low <= begin, high >= end
    ends[_OPEN + row * WIDTH + k] = larger(high, begin) if first else begin
    ends[_OPEN + (row + 1) * WIDTH + k] = smaller(low, end) if last else end
    return (low < high) & ~(first | last)


@inner
def _shorten(pairs, ij, ends, lanes):
    """Take what another image covers from the ends of edges; returns the lanes where it is between the ends."""
    ij, between = max(ij, 0), np.int64(0)
    for k in range(lanes):
        one = _shorten_one(pairs[ij + k], pairs[ij + WIDTH + k], ends, 0, k)
        two = _shorten_one(pairs[ij + 2 * WIDTH + k], pairs[ij + 3 * WIDTH + k], ends, 2, k)
        three = _shorten_one(pairs[ij + 4 * WIDTH + k], pairs[ij + 5 * WIDTH + k], ends, 4, k)
        four = _shorten_one(pairs[ij + 6 * WIDTH + k], pairs[ij + 7 * WIDTH + k], ends, 6, k)
        between |= np.int64(one | two | three | four) << k
    return between


@inner
def _add_open(slots, i, ends, lanes):
    """Add the area under what is open of the edges of an image, as if nothing were covered between the ends."""
    i = max(i, 0)
    for k in range(lanes):
        ax, ay, bx, by = slots[i + _A + k], slots[i + _A + WIDTH + k], slots[i + _B + k], slots[i + _B + WIDTH + k]
        cx, cy = slots[i + k], slots[i + WIDTH + k]
        a_rise, a_run = slots[i + _SLOPES + k], slots[i + _SLOPES + WIDTH + k]
        b_rise, b_run = slots[i + _SLOPES + 2 * WIDTH + k], slots[i + _SLOPES + 3 * WIDTH + k]
        total = (
            _under(cx + bx, cy + by, ax, ay, a_rise, a_run, ends[_OPEN + 2 * WIDTH + k], ends[_OPEN + 3 * WIDTH + k])
            - _under(cx - bx, cy - by, ax, ay, a_rise, a_run, ends[_OPEN + k], ends[_OPEN + WIDTH + k])
        ) + (
            _under(cx - ax, cy - ay, bx, by, b_rise, b_run, ends[_OPEN + 4 * WIDTH + k], ends[_OPEN + 5 * WIDTH + k])
            - _under(cx + ax, cy + ay, bx, by, b_rise, b_run, ends[_OPEN + 6 * WIDTH + k], ends[_OPEN + 7 * WIDTH + k])
        )
        ends[k] += total if slots[i + _TURN + k] > 0.0 else -total


@inline
def _under(mx, my, dx, dy, rise, run, low, high):
    """Integral of (y + 1) dx along the edge m + t d from one t to another, nothing if the other comes first."""
    high = larger(high, low)
    px, py, qx, qy = mx + low * dx, my + low * dy, mx + high * dx, my + high * dy
    return edge_term(px, py, qx, qy, rise, run) + (unit(qx) - unit(px))


@inner
def _take_out_inside(slots, pairs, i, e, first, last, ends, inside, lanes):
    """Take out what images of a set cover between the ends of one edge: intervals in rising order, each once."""
    count, at = np.int64(0), _OPEN + 2 * e * WIDTH
    for j in range(first, last):
        interval = _INTERVALS + 2 * count * WIDTH
        if inside >> j & 1 and _put_between(pairs, _block(i, j) + 2 * e * WIDTH, ends, at, interval, lanes):
            for m in range(count, 0, -1):
                _in_order(ends, _INTERVALS + 2 * m * WIDTH, lanes)
            count += 1
    image, half, side = i * SLOT, _A if e < 2 else _B, -1.0 if e % 2 == 0 else 1.0
    other, slope_row, sign = _A + _B - half, _SLOPES + (0 if e < 2 else 2 * WIDTH), 1.0 if e == 0 or e == 3 else -1.0
    for m in range(count):
        _take_out(slots, image, half, other, slope_row, side, sign, ends, at, _INTERVALS + 2 * m * WIDTH, lanes)


@inner
def _put_between(pairs, ij, ends, at, to, lanes):
    """Write the part of an interval between the ends of an edge; at its begin nothing where there is none."""
    ij, at, to, found = max(ij, 0), max(at, 0), max(to, 0), np.int64(0)
    for k in range(lanes):
        begin = ends[at + k]
        low, high = larger(pairs[ij + k], begin), smaller(pairs[ij + WIDTH + k], ends[at + WIDTH + k])
        some = low < high
        ends[to + k], ends[to + WIDTH + k] = (low, high) if some else (begin, begin)
        found |= np.int64(some) << k
    return found != 0


@inner
def _in_order(ends, at, lanes):
    """Swap an interval with the one before it where it begins earlier."""
    at = max(at, 2 * WIDTH)
    for k in range(lanes):
        low, high = ends[at - 2 * WIDTH + k], ends[at - WIDTH + k]
        then, there = ends[at + k], ends[at + WIDTH + k]
        swap = then < low
        ends[at - 2 * WIDTH + k], ends[at - WIDTH + k] = (then, there) if swap else (low, high)
        ends[at + k], ends[at + WIDTH + k] = (low, high) if swap else (then, there)


@inner
def _take_out(slots, i, half, other, slope_row, side, sign, ends, at, interval, lanes):
    """Take out one interval of an edge; what is left of the edge begins behind it."""
    i, half, other, slope_row = max(i, 0), max(i + half, 0), max(i + other, 0), max(i + slope_row, 0)
    at, interval = max(at, 0), max(interval, 0)
    for k in range(lanes):
        dx, dy = slots[half + k], slots[half + WIDTH + k]
        mx, my = slots[i + k] + side * slots[other + k], slots[i + WIDTH + k] + side * slots[other + WIDTH + k]
        low = larger(ends[at + k], ends[interval + k])
        high = larger(low, ends[interval + WIDTH + k])
        area = sign * _under(mx, my, dx, dy, slots[slope_row + k], slots[slope_row + WIDTH + k], low, high)
        ends[k] += area if slots[i + _TURN + k] > 0.0 else -area
        ends[at + k] = high

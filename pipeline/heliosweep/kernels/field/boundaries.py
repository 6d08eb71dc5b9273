"""Areas of unions of images that overlap, by what is visible of their edges.

The boundary of a union is what is left of the edges of each image outside all others. The lower and the upper edge of
an image, those that are more level, are lines y = Y + s x, and the left and the right one x = X + r y. Along an edge,
by x or by y, another image covers an interval: between its lower and upper edge, and between its left and right one.
Intervals are put together, and by Green's theorem the integral of (y + 1) dx along what they leave is the area, where y
is clamped to the square and x too.

An image meets the square. So an edge of it that does not reach between the sides of the square, above its lower side,
bounds nothing there: it counts nothing, and stands nowhere. With a low sun that is every second one, most of the lower
edges among them.

Where two edges nearly coincide, their crossing is ill defined, and the two must not both be taken as hidden, or both
as visible: it is one number for both, x of two level edges, y of two upright ones. Three such edges could still be seen
to hide one another in turn: lanes where two edges coincide within some 1e-8 are left to another way. So are those where
a level edge may be parallel to an upright one: elsewhere their crossings are well conditioned.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.polygons import larger, smaller, unit
from heliosweep.kernels.vectors import GROUP, ROW, aligned

SLOTS = 32
"""Most images of a group of lanes, each a bit of an integer."""

WIDTH = 2 * GROUP
"""Most lanes that are done together: of one group alone every step would wait for the one before."""

_R, _RUN = WIDTH, 2 * WIDTH
_LINES, _COUNTS = 3 * WIDTH, 7 * WIDTH
SLOT = 15 * WIDTH
"""Numbers of an image in a group of lanes: s, r, and the reciprocal of s; Y of the lower and upper edge, X of the left
and right; and for each edge in that order from where to where it counts."""
_PAIR = 8 * WIDTH
"""Numbers of an ordered pair of images: from where to where the other covers each edge of the one."""
_OPEN, _INTERVALS = WIDTH, WIDTH + _PAIR
"""Rows of ends, behind the areas: what is open of each edge of an image; what is covered between the ends of one."""

_NOWHERE = 1e15
"""Place of an image without area, and of an edge that bounds nothing: edges of the largest images do not reach it."""
_FAR = 1e300
"""Further than any end of an edge that counts; of infinity the compiler would see that it changes nothing."""
_PARALLEL = 1e-8
"""Difference of s, or of r, below which edges are as good as parallel, and the crossings of their lines no points."""
_BEYOND = 4.0
"""Crossings of such lines further from an axis are no tie."""
_APART, _STEEP = 0.1, 30.0
"""1 - s r from which on the crossing of a level and an upright edge is well conditioned, for |s| and |r| up to this."""


class Group(NamedTuple):
    """Images of a group of lanes."""

    slots: Floats
    """`SLOT` numbers of each image."""
    names: Integers
    """Numbers of the images, which rise."""
    met: Integers
    """Lanes in which two overlap, a bit for each lane, of the pairs as `pair_of` has them."""
    edges: Integers
    """Lanes in which the edges of each count, `WIDTH` bits for each edge."""
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
        np.empty(SLOTS * (SLOTS - 1) // 2, np.int64),
        np.empty(SLOTS, np.int64),
        np.zeros(SLOTS, np.int64),
        aligned(SLOTS * (SLOTS - 1) * _PAIR),
        aligned(_INTERVALS + 2 * SLOTS * WIDTH),
    )


@inner
def prepare(images: Floats, image: int, some: int, slots: Floats, o: int, lanes: int) -> np.int64:
    """Write an image in some lanes to a slot that begins at `o`, and an image that is nowhere to the others.

    The image begins at `image` in `images`. Returns the lanes in which its edges count, `WIDTH` bits for each edge.
    """
    image, o, counting = max(image, 0), max(o, 0), np.int64(0)
    below = -_NOWHERE - o  # no two lower edges in one place: whether they tie would depend on other lanes
    for k in range(lanes):
        here = some >> k & 1 == 1
        cx, cy = images[image + k] if here else 0.0, images[image + ROW + k] if here else -_NOWHERE
        ax, ay = images[image + 2 * ROW + k] if here else 1.0, images[image + 3 * ROW + k] if here else 0.0
        bx, by = images[image + 4 * ROW + k] if here else 0.0, images[image + 5 * ROW + k] if here else 1.0
        swap = abs(ay * bx) > abs(ax * by)
        ax, bx, ay, by = (bx if swap else ax), (ax if swap else bx), (by if swap else ay), (ay if swap else by)
        ay, bx = ay if ax > 0.0 else -ay, bx if by > 0.0 else -bx
        ax, by = abs(ax), abs(by)  # a points to the right, b upwards
        inverse = 1.0 / (ax * by)
        s, r = ay * by * inverse, bx * ax * inverse
        run, rise = _inverse(s), _inverse(r)
        middle, height = cy - s * cx, by - s * bx
        centre, width = cx - r * cy, ax - r * ay
        slots[o + k] = s if larger(abs(s), abs(r)) < _STEEP else np.nan
        slots[o + _R + k], slots[o + _RUN + k] = r, run
        w, lines = o + _COUNTS + k, o + _LINES + k
        low, high = _level_counts(cx - bx - ax, cx - bx + ax, middle - height, run)
        lower = high > low
        slots[w], slots[w + WIDTH] = low, larger(high, low)
        slots[lines] = middle - height if lower else below
        low, high = _level_counts(cx + bx - ax, cx + bx + ax, middle + height, run)
        upper = high > low
        slots[w + 2 * WIDTH], slots[w + 3 * WIDTH] = low, larger(high, low)
        slots[lines + WIDTH] = _NOWHERE if here & (high <= low) else middle + height
        low, high = _upright_counts(cy - ay - by, cy - ay + by, centre - width, rise)
        left = high > low
        slots[w + 4 * WIDTH], slots[w + 5 * WIDTH] = low, larger(high, low)
        slots[lines + 2 * WIDTH] = centre - width if left else -_NOWHERE
        low, high = _upright_counts(cy + ay - by, cy + ay + by, centre + width, rise)
        right = high > low
        slots[w + 6 * WIDTH], slots[w + 7 * WIDTH] = low, larger(high, low)
        slots[lines + 3 * WIDTH] = centre + width if right else _NOWHERE
        counting |= np.int64(lower) << k | np.int64(upper) << WIDTH + k
        counting |= np.int64(left) << 2 * WIDTH + k | np.int64(right) << 3 * WIDTH + k
    return counting


@inline
def _inverse(value):
    """Reciprocal of a slope, never infinite: an edge along an axis is taken as turned a little."""
    return 1.0 / (value if abs(value) > 1e-290 else 1e-290)


@inline
def _level_counts(low, high, y, run):
    """From which x to which an edge counts that has y at x = 0: within the sides of the square, above its lower one."""
    low, high, floor = larger(low, -1.0), smaller(high, 1.0), (-1.0 - y) * run
    return larger(low, floor) if run > 0.0 else low, high if run > 0.0 else smaller(high, floor)


@inline
def _upright_counts(low, high, x, rise):
    """From which y to which an edge counts that has x at y = 0."""
    one, other = (-1.0 - x) * rise, (1.0 - x) * rise
    return larger(larger(low, -1.0), smaller(one, other)), smaller(high, larger(one, other))


@inner
def union_areas(group: Group, first: int, middle: int, last: int, lanes: int) -> np.int64:
    """Write the areas that images first..last of a group cover of the square together to the first row of its ends.

    Where `middle` is not `first`, this has been called for the images up to there, and for those from there on. Returns
    the lanes that are left to another way.
    """
    slots, pairs, ends, met, edges = group.slots, group.pairs, group.ends, group.met, group.edges
    tied = np.int64(0)
    for k in range(lanes):
        ends[k] = 0.0
    for i in range(first, last):
        o, inside = i * SLOT, np.int64(0) if middle == first else group.inside[i]
        _copy(slots, o + _COUNTS, ends, _OPEN, lanes)
        for j in range(first if i >= middle else i, i if middle == first else min(i, middle)):
            if met[pair_of(i, j)] != 0:
                inside |= np.int64(_shorten(pairs, _block(i, j), ends, _counts(edges[i], 0), lanes) != 0) << j
        for j in range(max(i + 1, middle), last if middle == first or i < middle else i):
            both = met[pair_of(i, j)]
            if both != 0:
                lower = _counts(edges[i] | edges[j], 0)
                near, between = _cover(slots, o, j * SLOT, pairs, _block(i, j), both, ends, lower, lanes)
                tied |= near & both
                inside |= np.int64(between != 0) << j
        group.inside[i] = inside
        _copy(ends, _OPEN, slots, o + _COUNTS, lanes)
        _add_open(slots, o, ends, _counts(edges[i], 0), lanes)
        for e in range(4 if inside != 0 else 0):
            if _counts(edges[i], e):
                _take_out_inside(slots, pairs, i, e, first, last, ends, inside, lanes)
    return tied


@inline
def _counts(edges, e):
    """Whether an edge counts in any lane."""
    return edges >> e * WIDTH & (1 << WIDTH) - 1 != 0


@inline
def pair_of(i: int, j: int) -> int:
    """Number of the pair of two images of a group."""
    low, high = min(i, j), max(i, j)
    return high * (high - 1) // 2 + low


@inline
def _block(i, j):
    """Start of what image j covers of image i: of both together, for they are found together."""
    return 2 * pair_of(i, j) * _PAIR + (0 if i < j else _PAIR)


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
def _cover(slots, i, j, pairs, ij, some, ends, lower, lanes):
    """Write the intervals of two images, none but in some lanes, and shorten what is open of the edges of the one.

    Returns the lanes that are left to another way, and those in which the other covers something between the ends.
    `lower` tells whether lower edges of theirs count.
    """
    if lower:
        return _cover_edges(slots, i, j, pairs, ij, some, ends, True, lanes)
    return _cover_edges(slots, i, j, pairs, ij, some, ends, False, lanes)


@inline
def _cover_edges(slots, i, j, pairs, ij, some, ends, lower, lanes):
    """The same: compiled once with lower edges, and once without."""
    i, j, ij = max(i, 0), max(j, 0), max(ij, 0)
    ji = ij + _PAIR
    tied = between = np.int64(0)
    for k in range(lanes):
        here = some >> k & 1 == 1
        s, r, t, u = slots[i + k], slots[i + _R + k], slots[j + k], slots[j + _R + k]
        m, n = i + _LINES + k, j + _LINES + k
        b, y, x, z = slots[m], slots[m + WIDTH], slots[m + 2 * WIDTH], slots[m + 3 * WIDTH]
        c, v, w, q = slots[n], slots[n + WIDTH], slots[n + 2 * WIDTH], slots[n + 3 * WIDTH]
        st, ru, su, rt = s - t, r - u, 1.0 - s * u, 1.0 - r * t
        level, upright = abs(st) < _PARALLEL, abs(ru) < _PARALLEL
        # Of two level edges x, of two upright ones y, for the lower, upper, left, right of the one and of the other.
        inverse = 1.0 / (_PARALLEL if level else st)
        by, yc, yv = (v - b) * inverse, (c - y) * inverse, (v - y) * inverse
        near = abs(yv)
        one = False
        if lower:
            bc = (c - b) * inverse
            near = smaller(smaller(near, abs(bc)), smaller(abs(by), abs(yc)))
        tie = level & (near < _BEYOND) | ~((su >= _APART) & (rt >= _APART))  # so it is where s is no number
        inverse = 1.0 / (_PARALLEL if upright else ru)
        xw, xq, zw, zq = (w - x) * inverse, (q - x) * inverse, (w - z) * inverse, (q - z) * inverse
        near = smaller(smaller(abs(xw), abs(xq)), smaller(abs(zw), abs(zq)))
        tie = tie | upright & (near < _BEYOND)
        su, rt = 1.0 / larger(su, _APART), 1.0 / larger(rt, _APART)
        if lower:
            one = _put(pairs, here, ij + k, bc, by, (w + u * b) * su, (q + u * b) * su, ends, 0, k)
            _write(pairs, here, ji + k, bc, yc, (x + r * c) * rt, (z + r * c) * rt)
        two = _put(pairs, here, ij + 2 * WIDTH + k, yc, yv, (w + u * y) * su, (q + u * y) * su, ends, 2, k)
        _write(pairs, here, ji + 2 * WIDTH + k, by, yv, (x + r * v) * rt, (z + r * v) * rt)
        three = _put(pairs, here, ij + 4 * WIDTH + k, xw, xq, (c + t * x) * rt, (v + t * x) * rt, ends, 4, k)
        four = _put(pairs, here, ij + 6 * WIDTH + k, zw, zq, (c + t * z) * rt, (v + t * z) * rt, ends, 6, k)
        _write(pairs, here, ji + 4 * WIDTH + k, xw, zw, (b + s * w) * su, (y + s * w) * su)
        _write(pairs, here, ji + 6 * WIDTH + k, xq, zq, (b + s * q) * su, (y + s * q) * su)
        tied |= np.int64(tie) << k
        between |= np.int64(one | two | three | four) << k
    return tied, between


@inline
def _write(pairs, here, at, one, other, low, high):
    """Write the interval between two crossings, and from one to another; an empty one where the images do not meet."""
    low, high = larger(smaller(one, other), low), smaller(larger(one, other), high) if here else -_NOWHERE
    pairs[at], pairs[at + WIDTH] = low, high
    return low, high


@inline
def _put(pairs, here, at, one, other, low, high, ends, row, k):
    """The same, and shorten what is open of the edge."""
    low, high = _write(pairs, here, at, one, other, low, high)
    return _shorten_one(low, high, ends, row, k)


@inline
def _shorten_one(low, high, ends, row, k):
    """Take an interval from what is open of an edge if it holds an end; returns whether it is between the ends."""
    begin, end = ends[_OPEN + row * WIDTH + k], ends[_OPEN + (row + 1) * WIDTH + k]
    first, last = low <= begin, high >= end
    # Of a choice between a new end and the one there the compiler makes a masked store: a dozen cycles on many
    # processors, and the next to read it waits. Here the one there is clamped first, to what changes nothing.
    ends[_OPEN + row * WIDTH + k] = larger(high if first else -_FAR, larger(begin, -_FAR))
    ends[_OPEN + (row + 1) * WIDTH + k] = smaller(low if last else _FAR, smaller(end, _FAR))
    return (low < high) & ~(first | last)


@inner
def _shorten(pairs, ij, ends, lower, lanes):
    """Take what another image covers from the ends of edges; returns the lanes where it is between the ends."""
    if lower:
        return _shorten_edges(pairs, ij, ends, True, lanes)
    return _shorten_edges(pairs, ij, ends, False, lanes)


@inline
def _shorten_edges(pairs, ij, ends, lower, lanes):
    """The same: compiled once with lower edges, and once without."""
    ij, between = max(ij, 0), np.int64(0)
    for k in range(lanes):
        one = _shorten_one(pairs[ij + k], pairs[ij + WIDTH + k], ends, 0, k) if lower else False
        two = _shorten_one(pairs[ij + 2 * WIDTH + k], pairs[ij + 3 * WIDTH + k], ends, 2, k)
        three = _shorten_one(pairs[ij + 4 * WIDTH + k], pairs[ij + 5 * WIDTH + k], ends, 4, k)
        four = _shorten_one(pairs[ij + 6 * WIDTH + k], pairs[ij + 7 * WIDTH + k], ends, 6, k)
        between |= np.int64(one | two | three | four) << k
    return between


@inner
def _add_open(slots, i, ends, lower, lanes):
    """Add the area under what is open of the edges of an image, as if nothing were covered between the ends."""
    i = max(i, 0)
    for k in range(lanes):
        s, r, run, lines = slots[i + k], slots[i + _R + k], slots[i + _RUN + k], i + _LINES + k
        upper = _under_level(slots[lines + WIDTH], s, run, ends[_OPEN + 2 * WIDTH + k], ends[_OPEN + 3 * WIDTH + k])
        left = _under_upright(ends[_OPEN + 4 * WIDTH + k], ends[_OPEN + 5 * WIDTH + k])
        right = _under_upright(ends[_OPEN + 6 * WIDTH + k], ends[_OPEN + 7 * WIDTH + k])
        ends[k] += upper + r * (left - right)
    if lower:
        for k in range(lanes):
            s, run = slots[i + k], slots[i + _RUN + k]
            ends[k] -= _under_level(slots[i + _LINES + k], s, run, ends[_OPEN + k], ends[_OPEN + WIDTH + k])


@inline
def _under_level(y, s, run, low, high):
    """Integral of (y + 1) dx along a level edge from one x to another, nothing if the other comes first."""
    high = larger(high, low)
    one, other = y + s * low, y + s * high
    begin, end = unit(one), unit(other)
    middle = unit(0.5 * ((low + (begin - one) * run) + (high + (end - other) * run)))
    return end * (high - middle) - begin * (low - middle) + (high - low)


@inline
def _under_upright(low, high):
    """Integral of (y + 1) dy from one y to another, above the square of 2 dy; nothing if the other comes first."""
    high = larger(high, low)
    one, other = smaller(low, 1.0), smaller(high, 1.0)
    return (other - one) * (0.5 * (other + one) - 1.0) + 2.0 * (high - low)


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
    for m in range(count):
        if e < 2:
            sign = 1.0 if e == 0 else -1.0
            _take_out_level(slots, i * SLOT, e * WIDTH, sign, ends, at, _INTERVALS + 2 * m * WIDTH, lanes)
        else:
            _take_out_upright(slots, i * SLOT, 1.0 if e > 2 else -1.0, ends, at, _INTERVALS + 2 * m * WIDTH, lanes)


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
def _take_out_level(slots, i, line, sign, ends, at, interval, lanes):
    """Take out one interval of a level edge; what is left of the edge begins behind it."""
    i, line, at, interval = max(i, 0), max(i + _LINES + line, 0), max(at, 0), max(interval, 0)
    for k in range(lanes):
        low = larger(ends[at + k], ends[interval + k])
        high = larger(low, ends[interval + WIDTH + k])
        ends[k] += sign * _under_level(slots[line + k], slots[i + k], slots[i + _RUN + k], low, high)
        ends[at + k] = high


@inner
def _take_out_upright(slots, i, sign, ends, at, interval, lanes):
    """Take out one interval of an upright edge; what is left of the edge begins behind it."""
    i, at, interval = max(i, 0), max(at, 0), max(interval, 0)
    for k in range(lanes):
        low = larger(ends[at + k], ends[interval + k])
        high = larger(low, ends[interval + WIDTH + k])
        ends[k] += sign * slots[i + _R + k] * _under_upright(low, high)
        ends[at + k] = high

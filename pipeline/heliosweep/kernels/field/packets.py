"""Packets of instants with nearly the same sun direction, 64 at most, and the frames of mirrors in them.

What a packet can cull, and which branches it takes, is decided for all of its lanes at once, so lanes that behave
alike are worth the sort. How packets are cut is part of the order of summation, hence of the last bits of every sum.

A mirror at C with the target at unit vector r has the normal n = unit(r + s) and the frame (u, v, n), v = n x u, with
its width along u and its height along v. Vectors are kept for all lanes (instants) of a packet: a block of rows,
`ROW` numbers apart in one flat array, because loops over rows at fixed offsets of one array turn into vector code.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inner, kernel
from heliosweep.kernels.vectors import GROUP, PACKET, ROW

_LIMIT = 480.0
"""Largest product of the lanes and the width of a packet, over the sine of its lowest elevation.

By measurement, and flat: with half or twice of it low suns cost some hundredths more. Smaller packets repeat the search
too often, wider ones have too many candidates. Thousands of instants fill theirs within it, but for the lowest suns.
"""


@kernel
def packet_order(sun: Floats) -> tuple[Integers, Integers]:
    """Permutation that puts similar sun directions next to each other, and the packets that it is cut into.

    A k-d tree: cut at the median of the component with the largest range until a packet is left. A packet has 64 lanes
    at most, and fewer where they would spread over much of the sky: every lane pays for the candidates of all, whose
    number grows with the spread over the sine of the elevation. Equal values are ordered by index, so the result
    depends on nothing but the vectors.

    `sun` are the vectors, shape (T, 3). [1] Returned are their indices in packet order, within a packet cut further
    into groups of 8 similar ones in rising index, and where packets begin, shape (P + 1,): packet p, never empty, is
    ``order[first[p] : first[p + 1]]``.
    """
    count = sun.shape[0]
    order = np.arange(count)
    value = np.empty(count)
    edges, packets = np.zeros(count + 1, np.int64), 0
    firsts = np.empty(128, np.int64)
    lasts = np.empty(128, np.int64)
    within = np.zeros(128, np.bool_)  # parts of packets
    depth = 1 if count > 0 else 0
    firsts[0], lasts[0] = 0, count
    while depth > 0:
        depth -= 1
        first, last, done = firsts[depth], lasts[depth], within[depth]
        lanes = last - first
        axis, widest, lowest = 0, -1.0, np.inf
        for k in range(3):
            low, high = np.inf, -np.inf
            for m in range(first, last):
                low, high = min(low, sun[order[m], k]), max(high, sun[order[m], k])
            if high - low > widest:
                axis, widest = k, high - low
            lowest = low  # after the last component: of z
        if not done and (lanes == 1 or (lanes <= PACKET and lanes * widest <= _LIMIT * lowest)):
            packets += 1
            edges[packets] = last
            done = True
        if done and lanes <= GROUP:
            _sort(order, first, last)
            continue
        for m in range(first, last):
            value[m] = sun[order[m], axis]
        unit = GROUP if done else (PACKET if lanes > PACKET else 1)  # full packets while there are several
        middle = first + ((lanes + unit - 1) // unit + 1) // 2 * unit
        _select(value, order, first, last - 1, middle)
        firsts[depth], lasts[depth] = middle, last
        firsts[depth + 1], lasts[depth + 1] = first, middle  # first in order, next to be cut
        within[depth] = within[depth + 1] = done
        depth += 2
    return order, edges[: packets + 1]


@kernel
def _select(value, order, first, last, middle):
    """Quickselect on (value, index): everything before `middle` ends up below everything from `middle` on."""
    while first < last:
        centre = (first + last) // 2
        pivot, name = value[centre], order[centre]
        m, n = first, last
        while m <= n:
            while value[m] < pivot or (value[m] == pivot and order[m] < name):
                m += 1
            while value[n] > pivot or (value[n] == pivot and order[n] > name):
                n -= 1
            if m <= n:
                value[m], value[n] = value[n], value[m]
                order[m], order[n] = order[n], order[m]
                m += 1
                n -= 1
        if middle <= n:
            last = n
        elif middle >= m:
            first = m
        else:
            return


@kernel
def _sort(order, first, last):
    """Insertion sort of one group."""
    for m in range(first + 1, last):
        name, n = order[m], m
        while n > first and order[n - 1] > name:
            order[n] = order[n - 1]
            n -= 1
        order[n] = name


SPINNING_ELEVATION = 0
"""Target-aligned mount: first axis along r, the width axis u = unit(r x s) normal to the plane of incidence."""
AZIMUTH_ELEVATION = 1
"""Vertical first axis: the width axis u = unit(z x n) stays horizontal."""
FRAME_ROWS = 7
"""Rows of a frame: the half sides (w/2) u and (h/2) v, components x, y, z of each; the cosine of incidence."""
COSINE = 6 * ROW
"""Start of the row of the cosine of the angle of incidence, n.s = n.r = |r + s| / 2."""

_PARALLEL = 1e-30
"""Squared sine below which two directions are parallel: the cross product is rounding noise."""


class Mirrors(NamedTuple):
    """The heliostats of a field, one number (or vector) each."""

    x: Floats
    """Mirror centres: east, north, up. [m]"""
    y: Floats
    z: Floats
    half_width: Floats
    """Half sides along u and along v. [m]"""
    half_height: Floats
    radius: Floats
    """Radius of the bounding sphere. [m]"""
    aim: Floats
    """Unit vectors r from the centres to the target, shape (N, 3). [1]"""
    throw: Floats
    """Distances to the target. [m]"""


@inner
def half_sides(
    frames: Floats,
    f: int,
    sun: Floats,
    at: int,
    mirrors: Mirrors,
    i: int,
    tracking: int,
    lanes: int,
) -> None:
    """Write the frame of mirror i, rows from `f` on, for so many lanes of a packet, lane number `at` and on. [m]

    Degenerate cases: s parallel to r (spinning-elevation) takes u = unit(-r_y, r_x, 0); a vertical normal
    (azimuth-elevation), or r vertical as well, takes u = east. A sun exactly opposite to r has no normal: sides and
    cosine are nothing.

    `sun` are rows x, y, z of the unit vectors to the sun, shape (3 * ROW,) [1]; `tracking` is `SPINNING_ELEVATION` or
    `AZIMUTH_ELEVATION`. What rows hold beyond the lanes of the packet means nothing.
    """
    f, at = max(f, 0), max(at, 0)
    rx, ry, rz = mirrors.aim[i, 0], mirrors.aim[i, 1], mirrors.aim[i, 2]
    half_width, half_height = mirrors.half_width[i], mirrors.half_height[i]
    # A fallback for every lane whose u is undefined, so that the lane loops need no branch.
    level = np.sqrt(rx * rx + ry * ry)
    ex, ey = 1.0, 0.0
    if tracking == SPINNING_ELEVATION and level * level > _PARALLEL:
        ex, ey = -ry / level, rx / level
    for k in range(lanes):
        sx, sy, sz = sun[at + k], sun[at + ROW + k], sun[at + 2 * ROW + k]
        nx, ny, nz = rx + sx, ry + sy, rz + sz
        if tracking == SPINNING_ELEVATION:
            ux, uy, uz = ry * sz - rz * sy, rz * sx - rx * sz, rx * sy - ry * sx
        else:
            ux, uy, uz = -ny, nx, 0.0
        along, across = nx * nx + ny * ny + nz * nz, ux * ux + uy * uy + uz * uz
        undefined = across < _PARALLEL
        ux, uy, uz = ex if undefined else ux, ey if undefined else uy, 0.0 if undefined else uz
        length, width = np.sqrt(along), np.sqrt(1.0 if undefined else across)
        inverse = 1.0 / (length * width) if length > 0.0 else 0.0
        scale_u, scale_v = half_width * (inverse * length), half_height * inverse
        frames[f + COSINE + k] = min(1.0, 0.5 * length)
        frames[f + k] = scale_u * ux
        frames[f + ROW + k] = scale_u * uy
        frames[f + 2 * ROW + k] = scale_u * uz
        frames[f + 3 * ROW + k] = scale_v * (ny * uz - nz * uy)
        frames[f + 4 * ROW + k] = scale_v * (nz * ux - nx * uz)
        frames[f + 5 * ROW + k] = scale_v * (nx * uy - ny * ux)

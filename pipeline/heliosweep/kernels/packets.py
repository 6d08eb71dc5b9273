"""Packets: instants sorted so that neighbours, 64 at most, share nearly the same sun direction.

What a packet can cull, and which branches it takes, is decided for all of its lanes at once, so lanes that behave
alike are worth the sort. How packets are cut is part of the order of summation, hence of the last bits of every sum.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel

__all__ = ["GROUP", "PACKET", "ROW", "packet_order", "rows"]

PACKET = 64
"""Most instants (lanes) in a packet."""

GROUP = 8
"""Packets are filled up to a multiple of so many lanes, the vector of the widest processors: no loop leaves a rest."""

ROW = PACKET + GROUP
"""Numbers from the start of a row of lanes to that of the next. With as many as a packet has lanes, a power of two, the
rows of short packets, as a low sun makes them, would crowd into an eighth of the places of the processor's cache."""

_LIMIT = 60.0
"""Largest product of the lanes and the width of a packet, over the sine of its lowest elevation.

By measurement, and flat: from 40 to 80 costs are much the same. Smaller packets repeat the search too often, wider ones
have too many candidates. Thousands of instants fill their packets within it, but for the lowest suns.
"""


@kernel
def rows(count: int) -> NDArray[np.float64]:
    """Room for rows of lanes, one after the other, from the start of a cache line: a load across two costs double."""
    room = np.empty(count * ROW + 8)
    skip = -(room.ctypes.data >> 3) & 7
    return room[skip : skip + count * ROW]


@kernel
def packet_order(sun: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Permutation that puts similar sun directions next to each other, and the packets that it is cut into.

    A k-d tree: cut at the median of the component with the largest range until a packet is left. A packet has 64 lanes
    at most, and fewer where they would spread over much of the sky: every lane pays for the candidates of all, whose
    number grows with the spread over the sine of the elevation. Equal values are ordered by index, so the result
    depends on nothing but the vectors.

    Parameters
    ----------
    sun : ndarray, shape (T, 3)
        Sun vectors. [1]

    Returns
    -------
    order : ndarray of int64, shape (T,)
        Indices into `sun`, in rising index within a packet.
    first : ndarray of int64, shape (P + 1,)
        Packet p, never empty, is `order[first[p] : first[p + 1]]`.
    """
    count = sun.shape[0]
    order = np.arange(count)
    value = np.empty(count)
    edges, packets = np.zeros(count + 1, np.int64), 0
    firsts = np.empty(64, np.int64)
    lasts = np.empty(64, np.int64)
    depth = 1 if count > 0 else 0
    firsts[0], lasts[0] = 0, count
    while depth > 0:
        depth -= 1
        first, last = firsts[depth], lasts[depth]
        lanes = last - first
        axis, widest, lowest = 0, -1.0, np.inf
        for k in range(3):
            low, high = np.inf, -np.inf
            for m in range(first, last):
                low, high = min(low, sun[order[m], k]), max(high, sun[order[m], k])
            if high - low > widest:
                axis, widest = k, high - low
            lowest = low  # after the last component: of z
        if lanes == 1 or (lanes <= PACKET and lanes * widest <= _LIMIT * lowest):
            _sort(order, first, last)
            packets += 1
            edges[packets] = last
            continue
        for m in range(first, last):
            value[m] = sun[order[m], axis]
        unit = PACKET if lanes > PACKET else 1  # full packets while there are several
        middle = first + ((lanes + unit - 1) // unit + 1) // 2 * unit
        _select(value, order, first, last - 1, middle)
        firsts[depth], lasts[depth] = middle, last
        firsts[depth + 1], lasts[depth + 1] = first, middle  # first in order, next to be cut
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
    """Insertion sort of one packet."""
    for m in range(first + 1, last):
        name, n = order[m], m
        while n > first and order[n - 1] > name:
            order[n] = order[n - 1]
            n -= 1
        order[n] = name

"""Packets: instants sorted so that 64 neighbours share nearly the same sun direction.

What a packet can cull, and which branches it takes, is decided for all of its lanes at once, so lanes that behave
alike are worth the sort. The packet size is part of the order of summation, hence of the last bits of every sum.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel

__all__ = ["PACKET", "packet_order"]

PACKET = 64
"""Instants (lanes) in a packet."""


@kernel
def packet_order(sun: NDArray[np.float64]) -> NDArray[np.int64]:
    """Permutation that puts similar sun directions next to each other.

    A k-d tree: cut at the median of the component with the largest range until one packet is left. Equal values are
    ordered by index, so the result depends on nothing but the vectors.

    Parameters
    ----------
    sun : ndarray, shape (T, 3)
        Sun vectors. [1]

    Returns
    -------
    ndarray of int64, shape (T,)
        Indices into `sun`; lanes 64 k to 64 k + 63 of it are packet k, in rising index within the packet.
    """
    count = sun.shape[0]
    order = np.arange(count)
    value = np.empty(count)
    firsts = np.empty(64, np.int64)
    lasts = np.empty(64, np.int64)
    depth = 1
    firsts[0], lasts[0] = 0, count
    while depth > 0:
        depth -= 1
        first, last = firsts[depth], lasts[depth]
        if last - first <= PACKET:
            _sort(order, first, last)
            continue
        axis, widest = 0, -1.0
        for k in range(3):
            low, high = np.inf, -np.inf
            for m in range(first, last):
                low, high = min(low, sun[order[m], k]), max(high, sun[order[m], k])
            if high - low > widest:
                axis, widest = k, high - low
        for m in range(first, last):
            value[m] = sun[order[m], axis]
        middle = first + ((last - first + PACKET - 1) // PACKET + 1) // 2 * PACKET
        _select(value, order, first, last - 1, middle)
        firsts[depth], lasts[depth] = first, middle
        firsts[depth + 1], lasts[depth + 1] = middle, last
        depth += 2
    return order


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

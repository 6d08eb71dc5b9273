"""Frames of mirrors at the instants of a packet, made where an image first asks for them.

Those of the last packets and heliostats are forgotten in turn, so that what is kept stays in the cache.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.images import next_run
from heliosweep.kernels.field.packets import FRAME_ROWS, half_sides
from heliosweep.kernels.vectors import ROW, aligned, rows

_KEPT = 1000
"""Frames of full packets after which others take their places, some made again: more would leave the cache."""


class Halo(NamedTuple):
    """Frames of a packet: of the test heliostats, and of those of the field that may stand in the way."""

    frames: Floats
    place: Integers
    """For each heliostat of the field where its frame begins; nothing where it has none."""
    made: Integers
    """Lanes for which each heliostat of the field has its frame, a bit for each."""
    names: Integers
    """Heliostats that have frames, in the order of these."""


@kernel
def no_frames(heliostats: int) -> Halo:
    """No frames of a field of so many heliostats."""
    names, place, made = np.empty(heliostats, np.int64), np.empty(heliostats, np.int64), np.zeros(heliostats, np.int64)
    return Halo(rows(0), place, made, names)


@kernel
def with_room(halo, count, lanes):
    """The same with room for so many frames, or as many as there are heliostats."""
    needed = _place(min(count, halo.names.shape[0]), lanes) + FRAME_ROWS * ROW
    return halo if needed <= halo.frames.shape[0] else Halo(aligned(2 * needed), halo.place, halo.made, halo.names)


@inline
def kept(lanes):
    """Frames after which others take their places."""
    return _KEPT * (ROW // lanes)


@inline
def _place(count, lanes):
    """Start of frame number `count`: those of a short packet stand side by side, and more of them in the cache."""
    beside = ROW // lanes
    return count // beside * FRAME_ROWS * ROW + count % beside * lanes


@inner
def have_frame(j, some, halo, count, to_sun, mirrors, tracking, lanes):
    """Have the frame of heliostat j ready for some lanes, those of whole groups; returns the number of frames."""
    if halo.made[j] == 0:
        halo.place[j], halo.names[count] = _place(count, lanes), j
        count += 1
    missing = some & ~halo.made[j]
    start, stop = (np.int64(0), lanes) if missing == -1 else next_run(0, missing, lanes)
    while start < stop:
        half_sides(halo.frames, halo.place[j] + start, to_sun, start, mirrors, j, tracking, stop - start)
        halo.made[j] |= (np.int64(-1) if stop == lanes else (np.int64(1) << stop) - 1) & np.int64(-1) << start
        start, stop = next_run(stop, missing, lanes)
    return count


@inner
def forget(halo, count):
    """Have no frames where there were so many."""
    for m in range(count):
        halo.made[halo.names[m]] = 0

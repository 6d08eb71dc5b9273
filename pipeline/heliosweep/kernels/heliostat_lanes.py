"""What mounts and samples of their errors come to for all instants, for a packet of heliostats at once.

The numbers of `mount_aiming.known_record` and `spot_lanes.sample_record`, each a row with a lane for every heliostat.
Angles are small, as errors are, so that series take the place of trigonometric functions; a packet in which one is not
goes lane by lane.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mount_aiming import known_record
from heliosweep.kernels.mount_terms import TERMS, are_small, mount_frame, small_terms, stand_terms
from heliosweep.kernels.packets import PACKET
from heliosweep.kernels.receiver import TARGET_ALIGNED
from heliosweep.kernels.spot_lanes import SAMPLE, VECTOR, sample_record, whole

__all__ = ["HELIOSTAT_ROWS", "heliostat_lanes"]

Floats = NDArray[np.float64]

HELIOSTAT_ROWS = 18 + 2 * TERMS
"""Rows of room: from the pivots to the aim point (0 to 2), frames (3 to 11), errors (12 to 17), terms of known and of
actual errors."""
_FRAMES, _ERRORS, _KNOWN, _ACTUAL = 3 * PACKET, 12 * PACKET, 18 * PACKET, (18 + TERMS) * PACKET


@kernel
def heliostat_lanes(
    base: tuple[int, float, float, float, float],
    pivots: Floats,
    first: int,
    here: int,
    face: Floats,
    known: Floats,
    known_apart: int,
    actual: Floats,
    actual_apart: int,
    samples: int,
    room: Floats,
    mounts: Floats,
    record: Floats,
) -> None:
    """Write the records of heliostats first..first + here; lanes beyond are copies of the last one.

    Parameters
    ----------
    base : tuple
        What all mounts share, from `spot_lanes.base_of`.
    pivots : ndarray, shape (H, 3)
        The pivots. [m]
    first, here : int
        The first heliostat, and how many.
    face : ndarray, shape (9,)
        Rows of `receiver.face_axes`. [1]
    known, actual : ndarray
        Known errors; K samples of the actual ones. [rad]
    known_apart, actual_apart : int
        From the errors of one heliostat to those of the next, 0 where all have the same.
    samples : int
        K.
    room : ndarray, shape (HELIOSTAT_ROWS * PACKET,)
        Scratch.
    mounts : ndarray, shape (KNOWN * PACKET,)
        Receives the rows of `known_record`.
    record : ndarray, shape (K * SAMPLE * PACKET,)
        Receives the rows of `sample_record`, sample after sample.
    """
    pedestal, lanes = base[4], whole(here, VECTOR)
    _stand(base, pivots, first, here, lanes, room)
    _terms(known, first * known_apart, known_apart, here, lanes, room, _KNOWN)
    for k in range(lanes):
        dx, dy, dz = room[k], room[PACKET + k], room[2 * PACKET + k]
        known_record(dx, dy, dz, room, room, pedestal, mounts, k, PACKET, _FRAMES + k, _KNOWN + k)
    for s in range(samples):
        _terms(actual, first * actual_apart + 6 * s, actual_apart, here, lanes, room, _ACTUAL)
        to = max(s * SAMPLE * PACKET, 0)
        for k in range(lanes):
            dx, dy, dz = room[k], room[PACKET + k], room[2 * PACKET + k]
            sample_record(
                dx, dy, dz, face, room, room, _ACTUAL + k, room, pedestal,
                record, to + k, PACKET, _FRAMES + k, _KNOWN + k,
            )  # fmt: skip


@kernel
def _stand(base, pivots, first, here, lanes, room):
    """Write rows of the way to the aim point and of the frames: one frame for all but target-aligned mounts."""
    kind, latitude, axis_azimuth, target_height, _ = base
    for k in range(lanes):
        h = first + min(k, here - 1)
        room[k], room[PACKET + k] = -pivots[h, 0], -pivots[h, 1]
        room[2 * PACKET + k] = target_height - pivots[h, 2]
    frame = np.empty(9)
    for k in range(lanes):
        if k == 0 or kind == TARGET_ALIGNED:
            mount_frame(kind, latitude, axis_azimuth, room[k], room[PACKET + k], room[2 * PACKET + k], frame)
        for m in range(9):
            room[_FRAMES + m * PACKET + k] = frame[m]


@inline
def _terms(errors, at, apart, here, lanes, room, to):
    """Write the rows of `stand_terms` of errors[at:], those of the next heliostat `apart` numbers further."""
    small = True
    for k in range(lanes):
        own = at + min(k, here - 1) * apart
        for m in range(6):
            room[_ERRORS + m * PACKET + k] = errors[own + m]
        small &= are_small(errors, own)
    if small:
        for k in range(lanes):
            small_terms(room, _ERRORS + k, room, to + k, PACKET)
    else:
        for k in range(lanes):
            stand_terms(errors, at + min(k, here - 1) * apart, room, to + k, PACKET)

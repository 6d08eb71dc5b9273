"""Spots of a packet of lanes, from records of mounts and of samples of their errors; no trigonometric call for a spot.

A record holds what all instants of a mount share: one number after the other, or each a row with a lane for every
heliostat. Rows of a block have room for `PACKET` lanes each, at fixed offsets of one flat array. Packets are filled up
to whole vectors with copies of their last lane. Errors are small angles, so that series take the place of trigonometric
functions; a packet in which one is not goes lane by lane.
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.aiming import KNOWN, STATE_ROWS, known_record
from heliosweep.kernels.mounts.kinematics import (
    TARGET_ALIGNED,
    TERMS,
    are_small,
    back,
    bore,
    mount_frame,
    small_terms,
    stand_terms,
    turn,
)
from heliosweep.kernels.spots.receiver import BEHIND_FACE, REACHES, Setting, rows_of, trace
from heliosweep.kernels.vectors import PACKET

Floats = NDArray[np.float64]

SAMPLE = 21
"""Numbers that `sample_record` makes of a mount and one sample of its errors."""
SPOT_ROWS = 9
"""Rows of spots: y, z, status, mirror centre relative to the aim point (3 to 5), normal (6 to 8)."""
VECTOR = 8
"""Lanes that packets are filled up to a multiple of."""


@inline
def sample_record(
    dx: float,
    dy: float,
    dz: float,
    face: Floats,
    frame: Floats,
    terms: Floats,
    at: int,
    known: Floats,
    pedestal: float,
    record: Floats,
    to: int,
    apart: int = 1,
    f: int = 0,
    n: int = 0,
) -> None:
    """Write what all instants of a mount with one sample of its errors share.

    Arrays one number after the other, or so many `apart`: a lane of rows. Frame and known terms begin in places `f` and
    `n`.

    Parameters
    ----------
    dx, dy, dz : float
        From the pivot to the aim point. [m]
    face : ndarray, shape (9,)
        Rows of `receiver.face_axes`. [1]
    frame : ndarray, shape (9,)
        Rows of Q. [1]
    terms, known : ndarray
        Of the actual errors, in places `at` on, and of the known ones, from `kinematics.stand_terms`.
    pedestal : float
        Offset h. [m]
    record : ndarray
        Receives, from place `to` on, the matrix Q^T Rtilt by rows (0 to 8), the point relative to the aim point that
        the centre is counted from (9 to 11), cosine and sine of the differences actual - known of a0 and g0 (12 to 15),
        of eta and mu (16 to 19), distance of the pivot before the plane of the receiver (20).
    """
    for m in range(3):
        a = at + (8 + m) * apart
        x, y, z = back(frame, f, terms[a], terms[a + 3 * apart], terms[a + 6 * apart], apart)
        r = to + m * apart
        record[r], record[r + 3 * apart], record[r + 6 * apart] = x, y, z
    record[to + 9 * apart] = (record[to + 2 * apart] - frame[f + 6 * apart]) * pedestal - dx
    record[to + 10 * apart] = (record[to + 5 * apart] - frame[f + 7 * apart]) * pedestal - dy
    record[to + 11 * apart] = (record[to + 8 * apart] - frame[f + 8 * apart]) * pedestal - dz
    for m in range(2):
        a, b, r = at + (2 - 2 * m) * apart, n + (2 - 2 * m) * apart, to + (12 + 2 * m) * apart
        record[r] = terms[a] * known[b] + terms[a + apart] * known[b + apart]
        record[r + apart] = terms[a + apart] * known[b] - terms[a] * known[b + apart]
    for m in range(4):
        record[to + (16 + m) * apart] = terms[at + (4 + m) * apart]
    record[to + 20 * apart] = -(face[0] * dx + face[1] * dy + face[2] * dz)


@kernel
def spot_lanes(
    sample: Floats,
    state: Floats,
    sun: Floats,
    face: Floats,
    offset: float,
    axis_offset: float,
    out: Floats,
    lanes: int,
) -> None:
    """Spots of a packet.

    Parameters
    ----------
    sample : ndarray, shape (SAMPLE * PACKET,)
        Rows of what `sample_record` made.
    state : ndarray, shape (STATE_ROWS * PACKET,)
        Rows of where the mounts were sent, from `aim_lanes`.
    sun : ndarray, shape (3 * PACKET,)
        Rows of the unit vectors to the sun. [1]
    face : ndarray, shape (9,)
        Rows of `receiver.face_axes`. [1]
    offset, axis_offset : float
        Offsets r and q. [m]
    out : ndarray, shape (SPOT_ROWS * PACKET,)
        Receives the rows of spots. [m, 1]
    lanes : int
        Lanes of the packet.
    """
    axes = rows_of(face)
    for k in range(lanes):
        cg, sg, ca, sa = state[k], state[PACKET + k], state[2 * PACKET + k], state[3 * PACKET + k]
        cosine, sine = sample[12 * PACKET + k], sample[13 * PACKET + k]
        ca, sa = ca * cosine - sa * sine, sa * cosine + ca * sine
        cosine, sine = sample[14 * PACKET + k], sample[15 * PACKET + k]
        cg, sg = cg * cosine - sg * sine, sg * cosine + cg * sine
        ce, se = sample[16 * PACKET + k], sample[17 * PACKET + k]
        bx, by, bz = bore(ca, sa, ce, se, sample[19 * PACKET + k], sample[18 * PACKET + k])
        ox, oy, oz = bore(ca, sa, ce, se, 0.0, offset)
        bx, by = turn(cg, sg, bx, by)
        ox, oy = turn(cg, sg, ox, oy + axis_offset)
        mx, my, mz = sample[k], sample[PACKET + k], sample[2 * PACKET + k]
        nx = mx * bx + my * by + mz * bz
        px = mx * ox + my * oy + mz * oz + sample[9 * PACKET + k]
        mx, my, mz = sample[3 * PACKET + k], sample[4 * PACKET + k], sample[5 * PACKET + k]
        ny = mx * bx + my * by + mz * bz
        py = mx * ox + my * oy + mz * oz + sample[10 * PACKET + k]
        mx, my, mz = sample[6 * PACKET + k], sample[7 * PACKET + k], sample[8 * PACKET + k]
        nz = mx * bx + my * by + mz * bz
        pz = mx * ox + my * oy + mz * oz + sample[11 * PACKET + k]
        s = sun[k], sun[PACKET + k], sun[2 * PACKET + k]
        y, z, status = trace((px, py, pz), (nx, ny, nz), s, axes)
        aimed = state[4 * PACKET + k]
        before = sample[20 * PACKET + k] > 0.0
        status = status if before else BEHIND_FACE
        out[k], out[PACKET + k] = y if before else math.nan, z if before else math.nan
        out[2 * PACKET + k] = status if aimed == REACHES else aimed
        out[3 * PACKET + k], out[4 * PACKET + k], out[5 * PACKET + k] = px, py, pz
        out[6 * PACKET + k], out[7 * PACKET + k], out[8 * PACKET + k] = nx, ny, nz


@kernel
def sun_rows(sun: Floats, first: int, count: int, rows: Floats) -> None:
    """Write instants first..first + count of sun vectors (3, T) to the lanes of a packet, again and again.

    Lanes beyond the last whole run that there is room for, up to a multiple of `VECTOR`, are copies of the last one.
    """
    lanes = PACKET // count * count
    for c in range(3):
        for start in range(c * PACKET, c * PACKET + lanes, count):
            for k in range(count):
                rows[start + k] = sun[c, first + k]
        for k in range(c * PACKET + lanes, c * PACKET + whole(lanes, VECTOR)):
            rows[k] = rows[c * PACKET + lanes - 1]


@inline
def base_of(setting: Setting, p: int) -> tuple[int, float, float, float, float]:
    """Kind, latitude, azimuth of the axis, height of the aim point and of the pedestal of a parameter combination."""
    height, pedestal = setting.target_height[p], setting.pedestal_height[p]
    return setting.kind[p], setting.latitude[p], setting.axis_azimuth[p], height, pedestal


@inline
def mount_records(
    base: tuple[int, float, float, float, float],
    pivots: Floats,
    h: int,
    face: Floats,
    known: Floats,
    terms: Floats,
    samples: int,
    frame: Floats,
    mounts: Floats,
    record: Floats,
    i: int,
) -> None:
    """Write what all instants of one heliostat share.

    Numbers, flat arrays and places in them: slices and settings would cost more than the arithmetic.

    Parameters
    ----------
    base : tuple
        What all mounts share, from `base_of`.
    pivots : ndarray, shape (H, 3)
        The pivots. [m]
    h : int
        The heliostat.
    face : ndarray, shape (9,)
        Rows of `receiver.face_axes`. [1]
    known : ndarray, shape (TERMS,)
        Terms of the known errors.
    terms : ndarray, shape (K * TERMS,)
        Terms of each sample of the actual errors.
    samples : int
        K.
    frame : ndarray, shape (9,)
        Receives the frame of the mount. [1]
    mounts, record : ndarray
        Receive, as number i, what aiming needs (see `aiming.known_record`), and what the spots of the K samples
        need (see `sample_record`).
    i : int
        Number of the heliostat among those that are aimed together.
    """
    kind, latitude, axis_azimuth, target_height, pedestal = base
    dx, dy, dz = -pivots[h, 0], -pivots[h, 1], target_height - pivots[h, 2]
    mount_frame(kind, latitude, axis_azimuth, dx, dy, dz, frame)
    known_record(dx, dy, dz, frame, known, pedestal, mounts, i * KNOWN)
    for k in range(samples):
        to = (i * samples + k) * SAMPLE
        sample_record(dx, dy, dz, face, frame, terms, k * TERMS, known, pedestal, record, to)


@inline
def sample_terms(errors: Floats, h: int, samples: int, terms: Floats) -> None:
    """Terms (K * TERMS) of the K errors of heliostat h, of errors (H * K * 6), see `kinematics.stand_terms`."""
    for k in range(samples):
        stand_terms(errors, 6 * (h * samples + k), terms, k * TERMS)


@kernel
def whole(count: int, unit: int) -> int:
    """Smallest multiple of the unit that is not below a count."""
    return (count + unit - 1) // unit * unit


@kernel
def transposed(record: Floats, samples: int, table: Floats) -> None:
    """Write the records of all samples as rows of packets, filled up with copies of the last sample."""
    for b in range(len(table)):
        lanes = min(PACKET, samples - b * PACKET)
        for k in range(whole(lanes, VECTOR)):
            for m in range(SAMPLE):
                table[b, m * PACKET + k] = record[min(b * PACKET + k, samples - 1) * SAMPLE + m]


@kernel
def spread(state: Floats, sun: Floats, lane: int, all_state: Floats, all_sun: Floats) -> None:
    """Copy one lane of where mounts stand and of the sun to all lanes."""
    for m in range(STATE_ROWS):
        all_state[m * PACKET : (m + 1) * PACKET] = state[m * PACKET + lane]
    for m in range(3):
        all_sun[m * PACKET : (m + 1) * PACKET] = sun[m * PACKET + lane]


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
        What all mounts share, from `records.base_of`.
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

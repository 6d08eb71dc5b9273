"""Spots of a packet of lanes, from where the mounts were sent and from samples of their errors; no trigonometric call.

Rows of a block have room for `PACKET` lanes each, at fixed offsets of one flat array. Packets are filled up to whole
vectors with copies of their last lane.
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mount_aiming import KNOWN, STATE_ROWS, known_record
from heliosweep.kernels.mount_terms import TERMS, back, bore, mount_frame, stand_terms, turn
from heliosweep.kernels.packets import PACKET
from heliosweep.kernels.receiver import BEHIND_FACE, REACHES, Setting, trace

__all__ = [
    "SAMPLE",
    "SPOT_ROWS",
    "VECTOR",
    "base_of",
    "mount_records",
    "sample_terms",
    "spot_lanes",
    "spread",
    "sun_rows",
    "transposed",
    "whole",
]

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
        Of the actual errors, in places `at` on, and of the known ones, from `mount_terms.stand_terms`.
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
    xx, xy, xz, yx, yy, yz, zx, zy, zz = face[0], face[1], face[2], face[3], face[4], face[5], face[6], face[7], face[8]
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
        sx, sy, sz = sun[k], sun[PACKET + k], sun[2 * PACKET + k]
        y, z, status = trace(px, py, pz, nx, ny, nz, sx, sy, sz, xx, xy, xz, yx, yy, yz, zx, zy, zz)
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
        Receive, as number i, what aiming needs (see `mount_aiming.known_record`), and what the spots of the K samples
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
    """Terms (K * TERMS) of the K errors of heliostat h, of errors (H * K * 6), see `mount_terms.stand_terms`."""
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

"""Spots of mounts with errors: mounts aim with the errors that are known, and stand as the actual ones make them.

Work goes in packets of lanes. A record holds what all instants of a mount and one sample of its errors share, so that a
spot takes no trigonometric call: a row of lanes for each number. Rows of a block have room for `PACKET` lanes each, at
fixed offsets of one flat array. Packets are filled up to whole vectors with copies of their last lane. Errors are small
angles, so that series take the place of trigonometric functions; a packet in which one is not goes lane by lane. No bit
of a spot depends on how spots are packed.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.aiming import (
    AIM_ROWS,
    KNOWN,
    STATE_ROWS,
    WORK_ROWS,
    aim_each,
    aim_lanes,
    aim_rows,
    known_record,
)
from heliosweep.kernels.mounts.kinematics import (
    TARGET_ALIGNED,
    are_small,
    back,
    bore,
    mount_frame,
    small_terms,
    stand_terms,
    turn,
)
from heliosweep.kernels.spots.receiver import BEHIND_FACE, REACHES, Face, Setting, compiled_setting, face_vectors, trace
from heliosweep.kernels.vectors import PACKET, whole

SAMPLE = 21
"""Rows of a mount and one sample of its errors: the matrix Q^T Rtilt by rows (0 to 8), the point relative to the aim
point that the centre is counted from (9 to 11), cosine and sine of the differences actual - known of a0 and g0 (12 to
15), of eta and mu (16 to 19), distance of the pivot before the plane of the receiver (20)."""
SPOT_ROWS = 9
"""Rows of spots: y, z, status, mirror centre relative to the aim point (3 to 5), normal (6 to 8)."""
_STAND = 17
"""Terms of errors without derivatives, see `kinematics.error_terms`."""
ROOM_ROWS = 18 + 2 * _STAND
"""Rows of room: from the pivots to the aim point (0 to 2), frames (3 to 11), errors (12 to 17), terms of known and of
actual errors."""
FRAMES, _ERRORS, _KNOWN, _ACTUAL = 3 * PACKET, 12 * PACKET, 18 * PACKET, (18 + _STAND) * PACKET


def mount_spots(setting: Setting, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike) -> Floats:
    """Spots of heliostats whose mounts have errors, aimed exactly by what is known of the errors.

    Parameters
    ----------
    setting : Setting
        Receiver and mount of P parameter combinations.
    actual : array_like, shape (P or 1, H or 1, 6)
        Errors, in the order of `kinematics.ERRORS`. [rad]
    known : array_like, shape (P or 1, H or 1, 6)
        Errors that the tracking corrects. [rad]
    sun : array_like, shape (P or 1, T, 3)
        Unit vectors to the sun: east, north, up. [1]
    pivots : array_like, shape (P or 1, H, 3)
        Pivots relative to the base of the tower: east, north, up. [m]

    Returns
    -------
    ndarray, shape (3, P, H, T)
        Spots y and z on the plane of the receiver, NaN where there is none [m], and the status of each, a code of
        `receiver`.

    Raises
    ------
    ValueError
        If shapes do not agree.
    """
    errors, corrected, suns, places = checked(len(setting.kind), np.asarray(actual)[:, :, None], known, sun, pivots)
    spots = np.empty((3, len(setting.kind), places.shape[1], suns.shape[2]))
    if spots.size:
        fill_spots(compiled_setting(setting), errors[:, :, 0], corrected, suns, places, spots)
    return spots


def checked(count: int, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike) -> tuple[Floats, ...]:
    """Arguments of `statistics.spot_statistics` as kernels take them, sun vectors as (P or 1, 3, T).

    Raises
    ------
    ValueError
        If shapes do not agree with `count` parameter combinations.
    """
    samples, corrected, suns, places = (
        np.require(value, np.float64, ["C", "W"]) for value in (actual, known, sun, pivots)
    )
    heliostats = places.shape[1] if places.ndim == 3 else -1
    wanted = (
        (samples, (count, heliostats, None, 6)),
        (corrected, (count, heliostats, 6)),
        (suns, (count, None, 3)),
        (places, (count, heliostats, 3)),
    )
    for array, shape in wanted:
        fits = array.ndim == len(shape) and all(
            size is None or length in ((size, 1) if axis < len(shape) - 1 else (size,))
            for axis, (length, size) in enumerate(zip(array.shape, shape, strict=True))
        )
        if not fits:
            raise ValueError(f"an array of shape {array.shape} where {shape} is wanted")
    return samples, corrected, np.ascontiguousarray(np.swapaxes(suns, 1, 2)), places


@kernel
def fill_spots(setting: Setting, actual: Floats, known: Floats, sun: Floats, pivots: Floats, spots: Floats) -> None:
    """Spots of all parameter combinations, see `mount_spots`."""
    heliostats, instants = spots.shape[2], spots.shape[3]
    group = max(1, PACKET // instants)
    block = PACKET // group * group  # heliostats that are set up at once
    room, mounts, record = np.empty(ROOM_ROWS * PACKET), np.empty(KNOWN * PACKET), np.empty(SAMPLE * PACKET)
    rows, state, work = np.empty(AIM_ROWS * PACKET), np.empty(STATE_ROWS * PACKET), np.empty(WORK_ROWS * PACKET)
    suns, sample, out = np.empty(3 * PACKET), np.empty(SAMPLE * PACKET), np.empty(SPOT_ROWS * PACKET)
    for p in range(spots.shape[1]):
        errors, corrections = actual[min(p, len(actual) - 1)].reshape(-1), known[min(p, len(known) - 1)].reshape(-1)
        light, places = sun[min(p, len(sun) - 1)], pivots[min(p, len(pivots) - 1)]
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        offset, axis_offset, pedestal = setting.mirror_offset[p], setting.axis_offset[p], setting.pedestal_height[p]
        for first in range(0, heliostats, group):
            here, own = min(group, heliostats - first), first % block
            if own == 0:
                count, apart = min(block, heliostats - first), 6 if known.shape[1] > 1 else 0
                known_lanes(setting, p, places, first, count, whole(count), corrections, apart, room, mounts)
                apart = 6 if actual.shape[1] > 1 else 0
                actual_lanes(errors, first * apart, apart, count, face, pedestal, room, record)
            for start in range(0, instants, PACKET):
                count = min(PACKET, instants - start)
                if first == 0 or instants > PACKET:
                    sun_rows(light, start, count, suns)
                full = whole(here * count)
                if instants == 1:
                    aim_each(mounts, suns, full, rows)
                else:
                    for i in range(here):
                        end = full if i == here - 1 else (i + 1) * count
                        aim_rows(mounts, suns, i * count, end, rows, own + i, PACKET)
                aim_lanes(rows, state, work, offset, axis_offset, full)
                if instants > 1:
                    _spread_mounts(record, own, here, count, full, sample)
                    spot_lanes(sample, state, suns, face, offset, axis_offset, out, full)
                else:
                    spot_lanes(record, state, suns, face, offset, axis_offset, out, full)
                for m in range(3):
                    for i in range(here):
                        for t in range(count):
                            spots[m, p, first + i, start + t] = out[m * PACKET + i * count + t]


@inline
def _spread_mounts(record, own, here, count, full, sample):
    """Copy heliostats from lane `own` of a record on to the lanes of each; the last one has those left over."""
    for i in range(here):
        end = full if i == here - 1 else (i + 1) * count
        for m in range(SAMPLE):
            value = record[m * PACKET + own + i]
            for lane in range(m * PACKET + i * count, m * PACKET + end):
                sample[lane] = value


@kernel
def known_lanes(
    setting: Setting,
    p: int,
    pivots: Floats,
    first: int,
    here: int,
    lanes: int,
    known: Floats,
    apart: int,
    room: Floats,
    mounts: Floats,
) -> None:
    """Write the rows of `known_record` of heliostats first..first + here; lanes beyond are copies of the last one.

    Of pivots (H, 3) [m], and known errors [rad], those of the next heliostat `apart` numbers further. `room` keeps what
    `actual_lanes` needs of the mounts.
    """
    kind, pedestal = setting.kind[p], setting.pedestal_height[p]
    for k in range(lanes):
        h = first + min(k, here - 1)
        room[k], room[PACKET + k] = -pivots[h, 0], -pivots[h, 1]
        room[2 * PACKET + k] = setting.target_height[p] - pivots[h, 2]
    frame = np.empty(9)
    for k in range(lanes):
        if k == 0 or kind == TARGET_ALIGNED:
            dx, dy, dz = room[k], room[PACKET + k], room[2 * PACKET + k]
            mount_frame(kind, setting.latitude[p], setting.axis_azimuth[p], dx, dy, dz, frame)
        for m in range(9):
            room[FRAMES + m * PACKET + k] = frame[m]
    _terms(known, first * apart, apart, here, lanes, room, _KNOWN)
    for k in range(lanes):
        dx, dy, dz = room[k], room[PACKET + k], room[2 * PACKET + k]
        known_record(dx, dy, dz, room, room, pedestal, mounts, k, PACKET, FRAMES + k, _KNOWN + k)


@kernel
def actual_lanes(
    errors: Floats, at: int, apart: int, here: int, face: Face, pedestal: float, room: Floats, record: Floats
) -> None:
    """Write the `SAMPLE` rows of mounts with actual errors, those of each lane `apart` numbers from `at` on."""
    _terms(errors, at, apart, here, whole(here), room, _ACTUAL)
    (xx, xy, xz), _, _ = face
    for k in range(whole(here)):
        dx, dy, dz = room[k], room[PACKET + k], room[2 * PACKET + k]
        f, a, n = FRAMES + k, _ACTUAL + k, _KNOWN + k
        for m in range(3):
            t = a + (8 + m) * PACKET
            x, y, z = back(room, f, room[t], room[t + 3 * PACKET], room[t + 6 * PACKET], PACKET)
            r = k + m * PACKET
            record[r], record[r + 3 * PACKET], record[r + 6 * PACKET] = x, y, z
        # The base stands straight below the pivot.
        ux, uy, uz = room[f + 2 * PACKET], room[f + 5 * PACKET], room[f + 8 * PACKET]
        for m in range(3):
            r = k + 3 * m * PACKET
            way, up = room[m * PACKET + k], 1.0 if m == 2 else 0.0
            leaned = record[r] * ux + record[r + PACKET] * uy + record[r + 2 * PACKET] * uz
            record[(9 + m) * PACKET + k] = (leaned - up) * pedestal - way
        for m in range(2):
            t, u, r = a + (2 - 2 * m) * PACKET, n + (2 - 2 * m) * PACKET, k + (12 + 2 * m) * PACKET
            record[r] = room[t] * room[u] + room[t + PACKET] * room[u + PACKET]
            record[r + PACKET] = room[t + PACKET] * room[u] - room[t] * room[u + PACKET]
        for m in range(4):
            record[(16 + m) * PACKET + k] = room[a + (4 + m) * PACKET]
        record[20 * PACKET + k] = -(xx * dx + xy * dy + xz * dz)


@inline
def _terms(errors, at, apart, here, lanes, room, to):
    """Write the rows of `stand_terms` of errors[at:], those of the next lane `apart` numbers further."""
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


@kernel
def spot_lanes(
    sample: Floats, state: Floats, sun: Floats, face: Face, offset: float, axis_offset: float, out: Floats, lanes: int
) -> None:
    """Write the rows of spots of a packet of lanes.

    `sample` has the `SAMPLE` rows of `actual_lanes`, `state` the rows of where the mounts were sent from `aim_lanes`,
    `sun` rows of unit vectors to the sun; `offset` and `axis_offset` are r and q [m], `out` gets `SPOT_ROWS` rows.
    """
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
        y, z, status = trace((px, py, pz), (nx, ny, nz), s, face)
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

    Lanes beyond the last whole run that there is room for, up to a multiple of `GROUP`, are copies of the last one.
    """
    lanes = PACKET // count * count
    for c in range(3):
        for start in range(c * PACKET, c * PACKET + lanes, count):
            for k in range(count):
                rows[start + k] = sun[c, first + k]
        for k in range(c * PACKET + lanes, c * PACKET + whole(lanes)):
            rows[k] = rows[c * PACKET + lanes - 1]

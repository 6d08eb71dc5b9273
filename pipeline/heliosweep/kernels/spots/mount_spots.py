"""Spots of mounts with errors: mounts aim with the known errors, and the actual errors move the mirror.

A sample holds the numbers of a mount and its errors that all instants share, so that a spot needs no trigonometric
function.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.aiming import aimed, known_mount
from heliosweep.kernels.mounts.kinematics import back, bore, mount_frame, tilt_matrix, times, turn
from heliosweep.kernels.spots.receiver import BEHIND_FACE, REACHES, Setting, compiled_setting, face_vectors, trace
from heliosweep.kernels.vectors import dot, mixed

SAMPLE = 20
"""Numbers of a sample: Q^T Rtilt by rows (0 to 8), the aim point less the point that the centre is counted from (9 to
11) [m], cosine and sine of the differences actual - known of g0 and a0 (12 to 15), of eta and mu (16 to 19)."""


def mount_spots(setting: Setting, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike) -> Floats:
    """Spots of heliostats whose mounts have errors, aimed exactly by the known errors.

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
    spots = np.empty((3, len(setting.kind), places.shape[1], suns.shape[1]))
    if spots.size:
        fill_spots(compiled_setting(setting), errors[:, :, 0], corrected, suns, places, spots)
    return spots


def checked(count: int, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike) -> tuple[Floats, ...]:
    """Return the arguments of `statistics.spot_statistics` as contiguous arrays.

    Raises
    ------
    ValueError
        If shapes do not agree with `count` parameter combinations.
    """
    arrays = [np.require(value, np.float64, ["C", "W"]) for value in (actual, known, sun, pivots)]
    heliostats = arrays[3].shape[1] if arrays[3].ndim == 3 else -1
    wanted = ((count, heliostats, None, 6), (count, heliostats, 6), (count, None, 3), (count, heliostats, 3))
    for array, shape in zip(arrays, wanted, strict=True):
        fits = array.ndim == len(shape) and all(
            size is None or length == size or (length == 1 and axis < len(shape) - 1)
            for axis, (length, size) in enumerate(zip(array.shape, shape, strict=True))
        )
        if not fits:
            raise ValueError(f"an array of shape {array.shape} where {shape} is wanted")
    return tuple(arrays)


@kernel
def fill_spots(setting: Setting, actual: Floats, known: Floats, sun: Floats, pivots: Floats, spots: Floats) -> None:
    """Spots of all parameter combinations, see `mount_spots`."""
    sample = np.empty(SAMPLE)
    for p in range(spots.shape[1]):
        errors, corrections = actual[min(p, len(actual) - 1)], known[min(p, len(known) - 1)]
        light, places = sun[min(p, len(sun) - 1)], pivots[min(p, len(pivots) - 1)]
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        offset, axis_offset, pedestal = setting.mirror_offset[p], setting.axis_offset[p], setting.pedestal_height[p]
        for h in range(spots.shape[2]):
            corrected = six(corrections, min(h, len(corrections) - 1))
            to_target, frame = stand_of(setting, p, places, h)
            mount = known_mount(corrected, frame, to_target, pedestal)
            store_sample(
                six(errors, min(h, len(errors) - 1)), corrected, frame, to_target, setting.pedestal_height[p], sample
            )
            before = -dot(face[0], to_target) > 0.0
            for t in range(spots.shape[3]):
                s = light[t, 0], light[t, 1], light[t, 2]
                angles, status = aimed(mount, s, offset, axis_offset)
                y, z = math.nan, math.nan
                if status == REACHES:
                    status = BEHIND_FACE
                    if before:
                        y, z, status = trace(*mirror_at(sample, angles, offset, axis_offset), s, face)
                spots[0, p, h, t], spots[1, p, h, t], spots[2, p, h, t] = y, z, status


@inline
def six(errors, h):
    """Errors of a heliostat as numbers."""
    return errors[h, 0], errors[h, 1], errors[h, 2], errors[h, 3], errors[h, 4], errors[h, 5]


@inline
def stand_of(setting, p, pivots, h):
    """Return the vector from a pivot to the aim point [m] and the mount's frame."""
    to_target = -pivots[h, 0], -pivots[h, 1], setting.target_height[p] - pivots[h, 2]
    return to_target, mount_frame(setting.kind[p], setting.latitude[p], setting.axis_azimuth[p], to_target)


@inline
def store_sample(actual, known, frame, to_target, pedestal, sample):
    """Store the `SAMPLE` numbers of a mount with actual and known errors. [rad]"""
    tilt = tilt_matrix(actual[2], actual[3])
    up = frame[0][2] * pedestal, frame[1][2] * pedestal, frame[2][2] * pedestal
    for m in range(3):
        column = frame[0][m], frame[1][m], frame[2][m]
        row = back(tilt, column)
        sample[3 * m], sample[3 * m + 1], sample[3 * m + 2] = row
        # the base is straight below the pivot
        sample[9 + m] = dot(row, up) - (pedestal if m == 2 else 0.0) - to_target[m]
    for m in range(2):
        sample[12 + 2 * m], sample[13 + 2 * m] = math.cos(actual[m] - known[m]), math.sin(actual[m] - known[m])
        sample[16 + 2 * m], sample[17 + 2 * m] = math.cos(actual[4 + m]), math.sin(actual[4 + m])


@inline
def mirror_at(sample, angles, offset, axis_offset):
    """Return the mirror centre relative to the aim point [m] and the normal, at the angles from `aiming.aimed`."""
    cg, sg, ca, sa = angles
    cg, sg = cg * sample[12] - sg * sample[13], sg * sample[12] + cg * sample[13]
    ca, sa = ca * sample[14] - sa * sample[15], sa * sample[14] + ca * sample[15]
    bx, by, bz = bore(ca, sa, sample[16], sample[17], sample[19], sample[18])
    ox, oy, oz = bore(ca, sa, sample[16], sample[17], 0.0, offset)
    bx, by = turn(cg, sg, bx, by)
    ox, oy = turn(cg, sg, ox, oy + axis_offset)
    matrix = (
        (sample[0], sample[1], sample[2]), (sample[3], sample[4], sample[5]), (sample[6], sample[7], sample[8])
    )  # fmt: skip
    centre = mixed(1.0, times(matrix, (ox, oy, oz)), 1.0, (sample[9], sample[10], sample[11]))
    return centre, times(matrix, (bx, by, bz))

"""Two-axis mounts with six angular errors: where the normal and the mirror centre stand, and the way back.

The mount's frame has the rows Q (x, y zero bore, z primary axis) in the world frame (x east, y north, z up). With the
encoder angles g (azimuth about the primary axis, clockwise seen from its end) and a (elevation), and the errors
g0, a0 (encoder references), te, tn (tilt of the primary axis, a rotation vector about the frame's x and y), eta
(non-orthogonality of the axes) and mu (collimation: the normal stands askew to the bore), in the order of `ERRORS`,

    n = Q^T Rtilt(te, tn) Rz(-(g + g0)) Ry(eta) Rx(a + a0) (sin mu, cos mu, 0)
    P = C + Q^T [Rtilt ((0, 0, h) + Rz(-(g + g0)) ((0, q, 0) + Ry(eta) Rx(a + a0) (0, r, 0))) - (0, 0, h)]

with the mirror offset r along the bore, the axis offset q and the height h of the pivot above the base that tilts.
Angles are kept as pairs of cosine and sine: nothing here calls a trigonometric function for a spot.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.mount_aiming import AIM_ROWS, KNOWN, STATE_ROWS, WORK_ROWS, aim_lanes, aim_rows, known_record
from heliosweep.kernels.mount_terms import ERRORS, TERMS, back, bore, error_terms, mount_frame, point, times, turn
from heliosweep.kernels.packets import PACKET

__all__ = [
    "ERRORS",
    "TERMS",
    "aim",
    "encoder_angles",
    "error_terms",
    "mount_frame",
    "mount_frames",
    "normal_and_centre",
]

Floats = NDArray[np.float64]


def mount_frames(kind: int, latitude: float, axis_azimuth: float, to_target: ArrayLike) -> Floats:
    """Axes of mounts.

    Parameters
    ----------
    kind : int
        `AZIMUTH_ELEVATION`, `TARGET_ALIGNED`, `POLAR` or `TILT_ROLL` of `receiver`.
    latitude : float
        Geographic latitude, of polar mounts. [rad]
    axis_azimuth : float
        Azimuth of the primary axis of tilt-roll mounts, from north, clockwise. [rad]
    to_target : array_like, shape (..., 3)
        From the pivots to the aim point. [m]

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rows Q: x, y (zero bore) and z (primary axis) in the world frame. [1]
    """
    vectors = np.asarray(to_target, np.float64)
    frames = np.empty((*vectors.shape[:-1], 3, 3))
    for frame, (dx, dy, dz) in zip(frames.reshape(-1, 9), vectors.reshape(-1, 3).tolist(), strict=True):
        mount_frame(int(kind), float(latitude), float(axis_azimuth), dx, dy, dz, frame)
    return frames


def normal_and_centre(
    frame: ArrayLike, angles: ArrayLike, errors: ArrayLike, offsets: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Floats, Floats]:
    """Normal and mirror centre of mounts at given encoder angles; arguments broadcast.

    Parameters
    ----------
    frame : array_like, shape (..., 3, 3)
        Rows Q, from `mount_frames`. [1]
    angles : array_like, shape (..., 2)
        Encoder angles g and a. [rad]
    errors : array_like, shape (..., 6)
        Errors in the order of `ERRORS`. [rad]
    offsets : tuple of float
        Mirror offset r along the bore, axis offset q, height h of the pivot above the base that tilts. [m]

    Returns
    -------
    normal : ndarray, shape (..., 3)
        Unit normals: east, north, up. [1]
    centre : ndarray, shape (..., 3)
        Mirror centres relative to the pivot. [m]
    """
    shape, (frames, pairs, six) = _flat((frame, 2), (angles, 1), (errors, 1))
    normal, centre = np.empty((len(six), 3)), np.empty((len(six), 3))
    _stand(frames, pairs, six, np.array(offsets, np.float64), normal, centre)
    return normal.reshape(*shape, 3), centre.reshape(*shape, 3)


def encoder_angles(frame: ArrayLike, normal: ArrayLike, errors: ArrayLike, branch: int = 0) -> Floats:
    """Encoder angles at which mounts with known errors point along a normal: the exact inverse of `normal_and_centre`.

    Parameters
    ----------
    frame, errors : array_like
        As in `normal_and_centre`; arguments broadcast.
    normal : array_like, shape (..., 3)
        Unit normals. [1]
    branch : int
        0 for the elevation a + a0 below a quarter turn, 1 for the branch beyond it.

    Returns
    -------
    ndarray, shape (..., 2)
        Encoder angles g and a, from -pi to pi; NaN in the blind cone about the primary axis, where mounts whose axes
        are not perpendicular cannot point. A normal along the primary axis takes g + g0 = 0. [rad]
    """
    shape, (frames, normals, six) = _flat((frame, 2), (normal, 1), (errors, 1))
    angles = np.empty((len(six), 2))
    _invert(frames, normals, six, -1.0 if branch else 1.0, angles)
    return angles.reshape(*shape, 2)


def aim(
    frame: ArrayLike,
    sun: ArrayLike,
    to_target: ArrayLike,
    errors: ArrayLike,
    offsets: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Floats:
    """Encoder angles at which mounts with known errors send the beam from the mirror centre to the aim point.

    Parameters
    ----------
    frame, errors, offsets
        As in `normal_and_centre`; arguments broadcast.
    sun : array_like, shape (..., 3)
        Unit vectors to the sun. [1]
    to_target : array_like, shape (..., 3)
        From the pivots to the aim point. [m]

    Returns
    -------
    ndarray, shape (..., 2)
        Encoder angles g and a, from -pi to pi; NaN with the sun at or below the horizon, in the blind cone, and where
        the offsets are not smaller than the distance. [rad]
    """
    shape, (frames, suns, targets, six) = _flat((frame, 2), (sun, 1), (to_target, 1), (errors, 1))
    angles = np.empty((len(six), 2))
    _aim(frames, suns, targets, six, np.array(offsets, np.float64), angles)
    return angles.reshape(*shape, 2)


def _flat(*arguments: tuple[ArrayLike, int]) -> tuple[tuple[int, ...], list[Floats]]:
    """Common shape of arguments without their last axes (given by number), and each as (N, all of those)."""
    arrays = [np.asarray(value, np.float64) for value, _ in arguments]
    kept = [array.shape[array.ndim - axes :] for array, (_, axes) in zip(arrays, arguments, strict=True)]
    shape = np.broadcast_shapes(*(a.shape[: a.ndim - len(k)] for a, k in zip(arrays, kept, strict=True)))
    wide = (np.broadcast_to(a, (*shape, *k)) for a, k in zip(arrays, kept, strict=True))
    return shape, [np.array(a, order="C").reshape(math.prod(shape), -1) for a in wide]


@kernel
def _stand(frames: Floats, angles: Floats, errors: Floats, offsets: Floats, normal: Floats, centre: Floats) -> None:
    terms = np.empty(TERMS)
    for i in range(len(errors)):
        frame = frames[i]
        error_terms(errors[i], terms)
        g, a = angles[i, 0] + errors[i, 0], angles[i, 1] + errors[i, 1]
        cg, sg, ca, sa = math.cos(g), math.sin(g), math.cos(a), math.sin(a)
        x, y, z = bore(ca, sa, terms[4], terms[5], terms[7], terms[6])
        x, y = turn(cg, sg, x, y)
        x, y, z = times(terms, 8, x, y, z)
        normal[i, 0], normal[i, 1], normal[i, 2] = back(frame, 0, x, y, z)
        x, y, z = bore(ca, sa, terms[4], terms[5], 0.0, offsets[0])
        x, y = turn(cg, sg, x, y + offsets[1])
        x, y, z = times(terms, 8, x, y, z + offsets[2])
        centre[i, 0], centre[i, 1], centre[i, 2] = back(frame, 0, x, y, z - offsets[2])


@kernel
def _invert(frames: Floats, normals: Floats, errors: Floats, side: float, angles: Floats) -> None:
    terms = np.empty(TERMS)
    for i in range(len(errors)):
        error_terms(errors[i], terms)
        x, y, z = times(frames[i], 0, normals[i, 0], normals[i, 1], normals[i, 2])
        x, y, z = back(terms, 8, x, y, z)
        cg, sg, ca, sa, room = point(x, y, z, terms[4], terms[5], terms[6], terms[7], side)
        angles[i, 0] = math.atan2(*turn(terms[0], -terms[1], sg, cg)) if room >= 0.0 else math.nan
        angles[i, 1] = math.atan2(*turn(terms[2], -terms[3], sa, ca)) if room >= 0.0 else math.nan


@kernel
def _aim(frames: Floats, sun: Floats, to_target: Floats, errors: Floats, offsets: Floats, angles: Floats) -> None:
    terms, record, suns = np.empty((PACKET, TERMS)), np.empty(KNOWN), np.empty(3 * PACKET)
    rows, state, work = np.empty(AIM_ROWS * PACKET), np.empty(STATE_ROWS * PACKET), np.empty(WORK_ROWS * PACKET)
    for first in range(0, len(errors), PACKET):
        lanes = min(PACKET, len(errors) - first)
        for k in range(lanes):
            i = first + k
            error_terms(errors[i], terms[k])
            dx, dy, dz = to_target[i, 0], to_target[i, 1], to_target[i, 2]
            known_record(dx, dy, dz, frames[i], terms[k], offsets[2], record)
            for c in range(3):
                suns[c * PACKET + k] = sun[i, c]
            aim_rows(record, suns, k, k + 1, rows)
        aim_lanes(rows, state, work, offsets[0], offsets[1], lanes)
        for k in range(lanes):
            cg, sg, ca, sa = state[k], state[PACKET + k], state[2 * PACKET + k], state[3 * PACKET + k]
            angles[first + k, 0] = math.atan2(*turn(terms[k, 0], -terms[k, 1], sg, cg))
            angles[first + k, 1] = math.atan2(*turn(terms[k, 2], -terms[k, 3], sa, ca))

"""Spots of mounts with errors: mounts aim with the known errors, and the actual errors move the mirror."""

import math

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.aiming import aimed, mirror_at, mount_of
from heliosweep.kernels.mounts.kinematics import back, mount_frame
from heliosweep.kernels.spots.curves import canting_cotangent
from heliosweep.kernels.spots.receiver import (
    BEHIND_FACE,
    NO_SUN,
    REACHES,
    Setting,
    compiled_setting,
    face_vectors,
    trace,
)
from heliosweep.kernels.vectors import cross, dot, minus, scaled

#: Sine of the angle between normal and primary axis below which there is no elevation axis.
_ALONG = 1e-12


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
    arrays = checked(len(setting.kind), np.asarray(actual)[:, :, None], known, sun, pivots)
    values, _ = sampled(setting, *arrays, tolerances=False)
    return values[..., 0]


def checked(
    count: int, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the arguments of `sampled` as contiguous arrays, of the whole shapes (P, H, K, 6), (P, H, 6).

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
    return arrays[0], arrays[1], arrays[2], arrays[3]


def sampled(
    setting: Setting, actual: Floats, known: Floats, sun: Floats, pivots: Floats, tolerances: bool
) -> tuple[Floats, Floats]:
    """Spots y, z [m], status and remaining tolerances [rad] of samples of errors, shape (3 or 5, P, H, T, K).

    Also the status of aiming, shape (P, H, T). Arguments as from `checked`.
    """
    shape = len(setting.kind), pivots.shape[1], sun.shape[1], actual.shape[2]
    values, aiming = np.empty((5 if tolerances else 3, *shape)), np.empty(shape[:3])
    if values.size:
        fill_samples(compiled_setting(setting), actual, known, sun, pivots, values, aiming)
    return values, aiming


@kernel
def fill_samples(
    setting: Setting, actual: Floats, known: Floats, sun: Floats, pivots: Floats, values: Floats, aiming: Floats
) -> None:
    """Fill the arrays of `sampled`."""
    commands = np.empty((values.shape[3], 4))
    for p in range(values.shape[1]):
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        offsets = setting.mirror_offset[p], setting.axis_offset[p], setting.pedestal_height[p]
        width, height = setting.half_width[p], setting.half_height[p]
        errors, corrections = actual[min(p, len(actual) - 1)], known[min(p, len(known) - 1)]
        light, places = sun[min(p, len(sun) - 1)], pivots[min(p, len(pivots) - 1)]
        for h in range(values.shape[2]):
            to_target = -places[h, 0], -places[h, 1], setting.target_height[p] - places[h, 2]
            frame = mount_frame(setting.kind[p], setting.latitude[p], setting.axis_azimuth[p], to_target)
            mount = mount_of(six(corrections[min(h, len(corrections) - 1)]), frame, to_target, offsets)
            for t in range(values.shape[3]):
                g, a, status = aimed(mount, (light[t, 0], light[t, 1], light[t, 2]))
                if status == REACHES and not -dot(face[0], to_target) > 0.0:
                    status = BEHIND_FACE
                aiming[p, h, t] = status
                commands[t, 0], commands[t, 1], commands[t, 2], commands[t, 3] = g[0], g[1], a[0], a[1]
            for k in range(values.shape[4]):
                mount = mount_of(six(errors[min(h, len(errors) - 1), k]), frame, to_target, offsets)
                for t in range(values.shape[3]):
                    status = int(aiming[p, h, t])
                    y, z, left, right = math.nan, math.nan, 0.0, 0.0
                    if status == REACHES:
                        s, c = (light[t, 0], light[t, 1], light[t, 2]), commands[t]
                        mirror = mirror_at(mount, (c[0], c[1]), (c[2], c[3]))
                        centre = back(mount.matrix, minus(mirror.arm, mount.target))
                        normal = back(mount.matrix, mirror.normal)
                        y, z, status = trace(centre, normal, s, face)
                        if len(values) > 3 and abs(y) <= width and abs(z) <= height:
                            e = cross(normal, frame[2])
                            sine = math.sqrt(dot(e, e))
                            e = scaled(1.0 / sine, e) if sine > _ALONG else frame[0]
                            left = _tolerance(canting_cotangent(s, normal, e, centre, face, width, height))
                            right = _tolerance(
                                canting_cotangent(s, normal, cross(e, normal), centre, face, width, height)
                            )
                    values[0, p, h, t, k], values[1, p, h, t, k], values[2, p, h, t, k] = y, z, status
                    if len(values) > 3:
                        dark = math.nan if status == NO_SUN else 0.0
                        values[3, p, h, t, k], values[4, p, h, t, k] = left + dark, right + dark


@inline
def six(errors):
    """Six errors as numbers."""
    return errors[0], errors[1], errors[2], errors[3], errors[4], errors[5]


@inline
def _tolerance(cotangent: float) -> float:
    return math.atan2(1.0, cotangent) if cotangent > -math.inf else math.inf

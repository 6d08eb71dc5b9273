"""Spots of mounts with errors: mounts aim with the known errors, and the actual errors move the mirror.

Also statistics of spots over samples of the errors, without storing the spots: mean, variances and covariance of the
spots that reach the plane of the receiver, the fractions of the samples that do and that lie in the aperture, and
percentiles of the remaining tolerance: how far the mirror may still turn about its elevation or its azimuth axis, the
mirror centre at rest, before the spot leaves the aperture.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.aiming import aimed, mirror_at, mount_of
from heliosweep.kernels.mounts.kinematics import back, mount_frame
from heliosweep.kernels.spots.curves import angle_of, canting_cotangent
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

MOMENTS = ("mean_y", "mean_z", "variance_y", "variance_z", "covariance", "real_fraction", "hit_fraction", "status")
#: Maximum number of spots that are kept at a time, and number in place of infinite angles in percentiles. [1, rad]
_MOST, _ENDLESS = 100_000, 1e300
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
    """
    values, _ = sampled(setting, np.asarray(actual)[:, :, None], known, sun, pivots, tolerances=False)
    return values[..., 0]


def sampled(
    setting: Setting, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike, tolerances: bool
) -> tuple[Floats, Floats]:
    """Spots y, z [m], status and remaining tolerances [rad] of K samples of errors, shape (3 or 5, P, H, T, K).

    Also the status of aiming, shape (P, H, T). Arguments as of `mount_spots`, errors of shape (P, H, K, 6).
    """
    arrays = [np.require(value, np.float64, ["C", "W"]) for value in (actual, known, sun, pivots)]
    shape = len(setting.kind), arrays[3].shape[1], arrays[2].shape[1], arrays[0].shape[2]
    values, aiming = np.empty((5 if tolerances else 3, *shape)), np.empty(shape[:3])
    if values.size:
        fill_samples(compiled_setting(setting), *arrays, values, aiming)
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
                            left = angle_of(canting_cotangent(s, normal, e, centre, face, width, height))
                            right = angle_of(
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


def spot_statistics(
    setting: Setting,
    actual: ArrayLike,
    known: ArrayLike,
    sun: ArrayLike,
    pivots: ArrayLike,
    percentiles: ArrayLike = (5.0, 50.0, 95.0),
) -> dict[str, Floats]:
    """Statistics of the spots that `mount_spots` makes, over samples of the errors.

    Parameters
    ----------
    setting, known, sun, pivots
        As of `mount_spots`.
    actual : array_like, shape (P or 1, H or 1, K, 6)
        K samples of the errors, at least one. [rad]
    percentiles : array_like, shape (Q,)
        Percentiles of the remaining tolerance, 0 to 100. [%]

    Returns
    -------
    dict of ndarray, shape (P, H, T)
        ``mean_y``, ``mean_z`` [m], ``variance_y``, ``variance_z``, ``covariance`` [m^2] of the spots that reach the
        plane, with n - 1 in the denominator; NaN for too few of them.
        ``real_fraction``, ``hit_fraction``: fractions of the samples whose spot reaches the plane, and lies in the
        aperture (edges included); NaN with the sun at or below the horizon. [1]
        ``status``: of the aiming, `receiver.REACHES`, `NO_SUN`, `BLIND_CONE` or `TOO_NEAR`; `BEHIND_FACE` if the
        pivot is on the plane of the receiver or behind it.
        ``tolerance``, shape (P, H, T, Q, 2): percentiles over all samples of the tolerance that remains about the
        elevation axis, unit(n x z), and about the azimuth axis of the mirror, interpolated as in `numpy.percentile`:
        0 if the spot is not in the aperture, infinity if it does not leave it, NaN with the sun at or below the
        horizon. [rad]
    """
    samples, corrected, suns, places = (np.asarray(each, np.float64) for each in (actual, known, sun, pivots))
    wanted, shape = np.array(percentiles, np.float64), (len(setting.kind), places.shape[1], suns.shape[1])
    moments, tolerance = np.full((len(MOMENTS), *shape), np.nan), np.full((*shape, len(wanted), 2), np.nan)
    step = max(1, _MOST // samples.shape[2])
    for p, h in np.ndindex(*shape[:2]):
        point, (ours, theirs, here) = slice(p, p + 1), (_at(each, p, h) for each in (samples, corrected, places))
        one = Setting(*(values[point] for values in setting))  # type: ignore[arg-type]
        for first in range(0, shape[2], step):
            part = slice(first, first + step)
            light = suns[min(p, len(suns) - 1), part][np.newaxis]
            values, aiming = sampled(one, ours, theirs, light, here, tolerances=len(wanted) > 0)
            (y, z, _, *angles), status = values[:, 0, 0], aiming[0, 0]
            size = float(one.half_width[0]), float(one.half_height[0])
            moments[:, p, h, part] = *_moments(y, z, status, *size), status
            for axis, angle in enumerate(angles):
                tolerance[p, h, part, :, axis] = angle_percentiles(angle, wanted).T
    return dict(zip(MOMENTS, moments, strict=True)) | {"tolerance": tolerance}


def _at(array: Floats, p: int, h: int) -> Floats:
    """Return the row of a point and a heliostat, of an array that may have one row for all."""
    p, h = min(p, len(array) - 1), min(h, array.shape[1] - 1)
    return array[p : p + 1, h : h + 1]


def _moments(y: Floats, z: Floats, status: Floats, width: float, height: float) -> list[Floats]:
    """Mean, variances and covariance of the spots that are not NaN, and fractions, in the order of `MOMENTS`."""
    real = ~np.isnan(y)
    count = np.count_nonzero(real, axis=-1)
    hits = np.count_nonzero((np.abs(y) <= width) & (np.abs(z) <= height), axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_y, mean_z = (np.sum(np.where(real, each, 0.0), axis=-1) / count for each in (y, z))
        off_y, off_z = (np.where(real, each - mean[:, None], 0.0) for each, mean in ((y, mean_y), (z, mean_z)))
        products = [np.sum(a * b, axis=-1) for a, b in ((off_y, off_y), (off_z, off_z), (off_y, off_z))]
        seconds = [np.where(count > 1, product / (count - 1), np.nan) for product in products]
    dark = np.where(status == NO_SUN, np.nan, 0.0)
    return [mean_y, mean_z, *seconds, count / y.shape[-1] + dark, hits / y.shape[-1] + dark]


def angle_percentiles(angles: Floats, percentiles: Floats) -> Floats:
    """Percentiles of angles along the last axis, percentiles first; infinite angles are larger than all others."""
    found = np.percentile(np.minimum(angles, _ENDLESS), percentiles, axis=-1)
    return np.where(found > 10.0, np.inf, found)

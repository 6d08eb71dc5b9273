"""Statistics of spots over samples of mount errors, without the spots ever being stored.

For every heliostat and instant: mean, variances and covariance of the spots that reach the plane of the receiver, the
parts of the samples that do and that lie in the aperture, and percentiles of the tolerance that remains: how far the
mirror may still turn about its elevation or its azimuth axis, the mirror centre at rest, before the spot leaves the
aperture.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.mounts.aiming import aimed, known_mount
from heliosweep.kernels.spots.curves import canting_cotangent
from heliosweep.kernels.spots.mount_spots import SAMPLE, checked, mirror_at, six, stand_of, store_sample
from heliosweep.kernels.spots.receiver import (
    BEHIND_FACE,
    NO_SUN,
    REACHES,
    Setting,
    compiled_setting,
    face_vectors,
    trace,
)
from heliosweep.kernels.vectors import cross, dot, scaled

MOMENTS = ("mean_y", "mean_z", "variance_y", "variance_z", "covariance", "real_fraction", "hit_fraction", "status")

_MOST = 100_000
"""Maximum number of spots that are kept at a time."""
_ALONG = 1e-12
"""Sine of the angle between normal and primary axis below which there is no elevation axis."""


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
        As in `mount_spots.mount_spots`.
    actual : array_like, shape (P or 1, H or 1, K, 6)
        K samples of the errors, at least one. [rad]
    percentiles : array_like, shape (Q,)
        Percentiles of the remaining tolerance, 0 to 100. [%]

    Returns
    -------
    dict of ndarray, shape (P, H, T)
        ``mean_y``, ``mean_z`` [m], ``variance_y``, ``variance_z``, ``covariance`` [m^2] of the spots that reach the
        plane, with n - 1 in the denominator; NaN for too few of them.
        ``real_fraction``, ``hit_fraction``: parts of the samples whose spot reaches the plane, and lies in the aperture
        (edges included); NaN with the sun at or below the horizon. [1]
        ``status``: of the aiming, `receiver.REACHES`, `NO_SUN`, `BLIND_CONE` or `TOO_NEAR`; `BEHIND_FACE` where the
        pivot is on the plane of the receiver or behind it.
        ``tolerance``, shape (P, H, T, Q, 2): percentiles over all samples of the tolerance that remains about the
        elevation axis, unit(n x z), and about the azimuth axis of the mirror, as `numpy.percentile` interpolates them:
        0 where the spot is not in the aperture, infinity where it does not leave it, NaN with the sun at or below the
        horizon. [rad]

    Raises
    ------
    ValueError
        If shapes do not agree, there is no sample, or a percentile is none.
    """
    samples, corrected, suns, places = checked(len(setting.kind), actual, known, sun, pivots)
    wanted, count = np.array(percentiles, np.float64).ravel(), samples.shape[2]
    if count == 0:
        raise ValueError("statistics of no sample")
    if not np.all((wanted >= 0.0) & (wanted <= 100.0)):
        raise ValueError("percentiles lie between 0 and 100")
    shape = (len(setting.kind), places.shape[1], suns.shape[1])
    moments, tolerance = np.full((len(MOMENTS), *shape), math.nan), np.full((*shape, len(wanted), 2), math.nan)
    compiled, step = compiled_setting(setting), max(1, _MOST // count)
    for p, h in np.ndindex(*shape[:2]):
        for first in range(0, shape[2], step):
            part = slice(first, first + step)
            values = np.empty((4, len(range(shape[2])[part]), count))
            status = np.empty(values.shape[1])
            fill_samples(compiled, p, h, first, samples, corrected, suns, places, len(wanted) > 0, status, values)
            width, height = float(compiled.half_width[p]), float(compiled.half_height[p])
            moments[:, p, h, part] = *_moments(values[0], values[1], status, width, height), status
            tolerance[p, h, part] = np.moveaxis(angle_percentiles(values[2:], wanted), (0, 1, 2), (1, 2, 0))
    return dict(zip(MOMENTS, moments, strict=True)) | {"tolerance": tolerance}


def _moments(y: Floats, z: Floats, status: Floats, width: float, height: float) -> list[Floats]:
    """Mean, variances and covariance of the spots that are not NaN, and fractions, in the order of `MOMENTS`."""
    real = ~np.isnan(y)
    count = np.count_nonzero(real, axis=-1)
    hits = np.count_nonzero((np.abs(y) <= width) & (np.abs(z) <= height), axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_y, mean_z = (np.sum(np.where(real, each, 0.0), axis=-1) / count for each in (y, z))
        off_y, off_z = (np.where(real, each - mean[:, None], 0.0) for each, mean in ((y, mean_y), (z, mean_z)))
        products = [np.sum(a * b, axis=-1) for a, b in ((off_y, off_y), (off_z, off_z), (off_y, off_z))]
        seconds = [np.where(count > 1, product / (count - 1), math.nan) for product in products]
    dark = np.where(status == NO_SUN, math.nan, 0.0)
    return [mean_y, mean_z, *seconds, count / y.shape[-1] + dark, hits / y.shape[-1] + dark]


def angle_percentiles(keys: Floats, percentiles: Floats) -> Floats:
    """Percentiles of angles along the last axis as `numpy.percentile` interpolates them, percentiles first. [rad]

    `keys` are -cot of each angle, infinity for an infinite angle, -infinity for zero, and are sorted in part. Infinite
    angles are values like all others.
    """
    place = percentiles / 100.0 * (keys.shape[-1] - 1)
    lower = np.floor(place).astype(np.int64)
    upper = np.minimum(lower + 1, keys.shape[-1] - 1)
    if len(percentiles):
        keys.partition(np.unique((lower, upper)), axis=-1)
    out = np.empty((len(percentiles), *keys.shape[:-1]))
    for q, (one, two) in enumerate(zip(lower, upper, strict=True)):
        share, ends = place[q] - one, keys[..., [one, two]]
        with np.errstate(invalid="ignore"):
            low, high = np.moveaxis(np.where(ends < math.inf, np.arctan2(1.0, -ends), math.inf + ends), -1, 0)
            between = low + (high - low) * share if share < 0.5 else high - (high - low) * (1.0 - share)
        out[q] = np.where((low == high) | (share == 0.0), low, between)
    return out


@kernel
def fill_samples(
    setting: Setting,
    p: int,
    h: int,
    first: int,
    actual: Floats,
    known: Floats,
    sun: Floats,
    pivots: Floats,
    tolerances: bool,
    statuses: Floats,
    values: Floats,
) -> None:
    """Store spots y, z and -cot of the remaining tolerances of a heliostat, shape (4, T, K), instants from `first` on.

    -cot rises with the tolerance: infinity if the spot does not leave the aperture, -infinity if it is not in it; NaN
    without sun.
    """
    errors, corrections = actual[min(p, len(actual) - 1)], known[min(p, len(known) - 1)]
    light, places = sun[min(p, len(sun) - 1)], pivots[min(p, len(pivots) - 1)]
    face, errors = face_vectors(setting.face_azimuth[p], setting.face_tilt[p]), errors[min(h, len(errors) - 1)]
    offset, axis_offset, pedestal = setting.mirror_offset[p], setting.axis_offset[p], setting.pedestal_height[p]
    width, height = setting.half_width[p], setting.half_height[p]
    to_target, frame = stand_of(setting, p, places, h)
    corrected = six(corrections, min(h, len(corrections) - 1))
    mount, samples = known_mount(corrected, frame, to_target, pedestal), np.empty((len(errors), SAMPLE))
    for k in range(len(errors)):
        store_sample(six(errors, k), corrected, frame, to_target, pedestal, samples[k])
    for t in range(values.shape[1]):
        s = light[first + t, 0], light[first + t, 1], light[first + t, 2]
        angles, status = aimed(mount, s, offset, axis_offset)
        if status == REACHES and not -dot(face[0], to_target) > 0.0:
            status = BEHIND_FACE
        statuses[t] = status
        if status != REACHES:
            values[:2, t] = math.nan
            values[2:, t] = math.nan if status == NO_SUN else -math.inf
            continue
        for k in range(len(errors)):
            centre, n = mirror_at(samples[k], angles, offset, axis_offset)
            y, z, _ = trace(centre, n, s, face)
            values[0, t, k], values[1, t, k], values[2, t, k], values[3, t, k] = y, z, -math.inf, -math.inf
            if tolerances and abs(y) <= width and abs(z) <= height:
                e = cross(n, frame[2])
                sine = math.sqrt(dot(e, e))
                e = scaled(1.0 / sine, e) if sine > _ALONG else frame[0]
                values[2, t, k] = -canting_cotangent(s, n, e, centre, face, width, height)
                values[3, t, k] = -canting_cotangent(s, n, cross(e, n), centre, face, width, height)

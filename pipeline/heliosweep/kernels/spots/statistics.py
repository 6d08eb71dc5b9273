"""Statistics of spots over samples of mount errors, without the spots ever being stored.

For every heliostat and instant: mean, variances and covariance of the spots that reach the plane of the receiver, the
fractions of the samples that do and that lie in the aperture, and percentiles of the remaining tolerance: how far the
mirror may still turn about its elevation or its azimuth axis, the mirror centre at rest, before the spot leaves the
aperture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.spots.mount_spots import checked, sampled
from heliosweep.kernels.spots.receiver import NO_SUN, Setting

MOMENTS = ("mean_y", "mean_z", "variance_y", "variance_z", "covariance", "real_fraction", "hit_fraction", "status")

#: Maximum number of spots that are kept at a time.
_MOST = 100_000
#: Number in place of infinite angles while percentiles are interpolated. [rad]
_ENDLESS = 1e300


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
        ``real_fraction``, ``hit_fraction``: fractions of the samples whose spot reaches the plane, and lies in the
        aperture (edges included); NaN with the sun at or below the horizon. [1]
        ``status``: of the aiming, `receiver.REACHES`, `NO_SUN`, `BLIND_CONE` or `TOO_NEAR`; `BEHIND_FACE` if the
        pivot is on the plane of the receiver or behind it.
        ``tolerance``, shape (P, H, T, Q, 2): percentiles over all samples of the tolerance that remains about the
        elevation axis, unit(n x z), and about the azimuth axis of the mirror, interpolated as in `numpy.percentile`:
        0 if the spot is not in the aperture, infinity if it does not leave it, NaN with the sun at or below the
        horizon. [rad]

    Raises
    ------
    ValueError
        If shapes do not agree, there is no sample, or a percentile is not between 0 and 100.
    """
    samples, corrected, suns, places = checked(len(setting.kind), actual, known, sun, pivots)
    wanted, count = np.array(percentiles, np.float64).ravel(), samples.shape[2]
    if count == 0:
        raise ValueError("statistics of no sample")
    if not np.all((wanted >= 0.0) & (wanted <= 100.0)):
        raise ValueError("percentiles lie between 0 and 100")
    shape = (len(setting.kind), places.shape[1], suns.shape[1])
    moments, tolerance = np.full((len(MOMENTS), *shape), np.nan), np.full((*shape, len(wanted), 2), np.nan)
    step = max(1, _MOST // count)
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

"""Method A: wavefront slopes from the angles that the brightness tells, by linear least squares; the bound on noise.

The camera at m_i sees the disc at the angle eps_i from its centre, and eps_i^2 = |m_i - w|^2 up to the aberrations of
the mirror. The difference from the ideal mirror at the same pixel, which the same cameras would see at eps0_i, is
linear in the departure d = w - w_ideal of the wavefront slopes:

    eps_i^2 - eps0_i^2 = -2 m_i.d + c

Mirror slopes are p = T d, with T of `geometry.transfers`. Only lit cameras count, and 3 are needed.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.gazing.geometry import Scene
from heliosweep.kernels.gazing.rays import ideal_mirror, mirror_offsets, row_of, unit
from heliosweep.kernels.gazing.slopes import least_deviations
from heliosweep.kernels.sun.profiles import Profile, inverse_squares
from heliosweep.kernels.sun.tables import smooth_fit

_NEEDED = 3
"""Minimum number of lit cameras."""


@kernel
def ideal_squares(layout: Scene, y: Floats, z: Floats) -> Floats:
    """Squares of the angles eps0_i at which K cameras see the ideal mirror at N pixels [m], shape (K, N). [rad^2]"""
    cameras, pixels = layout.eyes.shape[0], y.size
    out, focal_length = np.empty((cameras, pixels)), layout.focal_length
    sun_y, sun_z = row_of(layout.sun_y), row_of(layout.sun_z)
    for i in range(cameras):
        row, (ex, ey, ez) = out[i], row_of(layout.eyes[i])
        for k in range(pixels):
            x, a, b = ideal_mirror(focal_length, y[k], z[k])
            rx, ry, rz = unit(ex - x, ey - y[k], ez - z[k])
            v, w, _, _, _, _ = mirror_offsets(a, b, rx, ry, rz, sun_y, sun_z)
            row[k] = v * v + w * w
    return out


def solutions(gaze: Floats) -> Floats:
    """Return the least-squares solutions for every set of lit cameras, K from 3 to 8, at m_i = `gaze`, (K, 2) [rad].

    Row s of the result, shape (2^K, 2, K) [1/rad], belongs to the set with bit i of s for camera i: d = row . (eps0_i^2
    - eps_i^2), for any constant c. It is 0 for dark cameras and NaN if the set does not determine d.
    """
    cameras = len(gaze)
    if not _NEEDED <= cameras <= 8:
        raise ValueError("3 to 8 cameras are possible")
    out = np.full((1 << cameras, 2, cameras), math.nan)
    whole = np.sum((gaze - gaze.mean(axis=0)) ** 2)
    for mask in range(len(out)):
        lit = np.array([mask >> i & 1 for i in range(cameras)], bool)
        if np.count_nonzero(lit) >= _NEEDED:
            spread = gaze[lit] - gaze[lit].mean(axis=0)
            matrix = spread.T @ spread
            if np.linalg.det(matrix) > 1e-12 * whole**2:
                out[mask] = 0.0
                out[mask][:, lit] = 0.5 * np.linalg.solve(matrix, spread.T)
    return out


def ideal_wavefront(layout: Scene, ideal: Floats) -> Floats:
    """Wavefront slopes w_ideal, shape (2, N) [rad], of the ideal mirror as method A finds them with all cameras.

    From `ideal_squares` (K, N) [rad^2]: the aberrations of a mirror that the sun meets at an angle; w of a defect is
    this and its departure.
    """
    row = solutions(layout.gaze)[-1]
    seen = np.sum(layout.gaze**2, axis=1)[:, np.newaxis] - ideal
    return np.stack([np.sum(row[axis][:, np.newaxis] * seen, axis=0) for axis in (0, 1)])


def wavefront_departures(
    images: Floats, ideal: Floats, rows: Floats, profile: Profile, threshold: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Return departures d of the wavefront slopes from the ideal mirror, shape (2, N) [rad], and the lit cameras.

    `images` (K, N) are brightnesses relative to the disc centre [1], NaN for pixels not to use. `ideal` and `rows` come
    from `ideal_squares` and `solutions`; `threshold` is the minimum brightness of a lit camera. NaN if fewer than 3
    cameras are lit or these are in one line. Bit i of a pixel's number is set if camera i is lit.
    """
    lit = images >= threshold  # False for NaN
    masks = np.sum(lit * (1 << np.arange(len(images)))[:, np.newaxis], axis=0)
    change = np.where(lit, ideal - inverse_squares(profile, images), 0.0)
    return np.sum([rows[masks, :, i].T * each for i, each in enumerate(change)], axis=0), masks


def transferred(departures: Floats, matrices: Floats) -> Floats:
    """Return mirror slopes p = T d, shape (T, 2, N) [rad], for departures (2, N) [rad] and matrices (T, 2, 2)."""
    left, right = matrices[:, :, :1], matrices[:, :, 1:]
    return left * departures[0] + right * departures[1]


def slope_bound(
    layout: Scene,
    profile: Profile,
    y: Floats,
    z: Floats,
    slopes: Floats,
    noise: ArrayLike,
    fit_gain: bool = False,
    lit: NDArray[np.int64] | None = None,
) -> Floats:
    """Cramer-Rao bound: the least standard deviation that camera noise leaves to any unbiased slopes.

    Parameters
    ----------
    layout : Scene
        K cameras.
    profile : Profile
        As the reconstruction knows it. For a table the bound is that of its smooth fit, as `lm.fit_slopes` tells
        it, not that of a search on the rough table: the steepness between noisy nodes is not that of the sun.
    y, z : ndarray, shape (N,)
        Pixels. [m]
    slopes : ndarray, shape (2, N)
        p at which the bound is wanted. [rad]
    noise : array_like, shape (), (N,) or (K, N)
        Standard deviation of normal noise in each image, relative to the disc centre as the cameras see it: where their
        gain is g, that of the images by g. Cameras where it is NaN do not count. [1]
    fit_gain : bool
        Whether a gain of all cameras is found at each pixel too.
    lit : ndarray of int, shape (N,), optional
        Bit i is set where camera i counts, from `wavefront_departures`; all do where left out.

    Returns
    -------
    ndarray, shape (2, N)
        From the inverse of the information of the cameras that count and see the disc; NaN where it has none. [rad]
    """
    known = smooth_fit(profile) if profile.table.size > 3 else profile
    level = np.array(np.broadcast_to(np.asarray(noise, np.float64), (len(layout.eyes), len(y))))
    if lit is not None:
        level[~(np.asarray(lit) >> np.arange(len(level))[:, np.newaxis] & 1).astype(bool)] = math.nan
    return least_deviations(layout, known, np.array([y, z]), np.array(slopes, np.float64), level, fit_gain)

"""Method A: wavefront slopes from the angles that the brightness implies, by linear least squares; bound on noise.

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
from heliosweep.kernels.gazing.geometry import Scene
from heliosweep.kernels.gazing.slopes import look_back
from heliosweep.kernels.sun.profiles import Profile, inverse_squares
from heliosweep.kernels.sun.tables import smooth_fit

#: Minimum number of lit cameras.
_NEEDED = 3


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
    """Return the wavefront slopes w_ideal, shape (2, N) [rad], of the ideal mirror by method A with all cameras.

    `ideal` are squares of angles (K, N) by `slopes.look_back` [rad^2]. w_ideal is due to the aberrations of a mirror
    under oblique sun; w of a defect is w_ideal and its departure.
    """
    row = solutions(layout.gaze)[-1]
    seen = np.sum(layout.gaze**2, axis=1)[:, np.newaxis] - ideal
    return np.stack([np.sum(row[axis][:, np.newaxis] * seen, axis=0) for axis in (0, 1)])


def wavefront_departures(
    images: Floats, ideal: Floats, rows: Floats, profile: Profile, threshold: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Return departures d of the wavefront slopes from the ideal mirror, shape (2, N) [rad], and the lit cameras.

    `images` (K, N) are brightnesses relative to the disc centre [1], NaN for pixels not to use. `ideal` and `rows` come
    from `slopes.look_back` and `solutions`; `threshold` is the minimum brightness of a lit camera. NaN if fewer than 3
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
    pixels: Floats,
    slopes: Floats,
    noise: ArrayLike,
    fit_gain: bool = False,
    lit: NDArray[np.int64] | None = None,
) -> Floats:
    """Cramer-Rao bound: the minimum standard deviation of any unbiased slopes under camera noise.

    Parameters
    ----------
    layout : Scene
        K cameras.
    profile : Profile
        Sun profile of the reconstruction. The bound of a table is computed with its smooth fit, as in `fit_slopes`: the
        steepness between noisy nodes differs from the steepness of the sun's disc.
    pixels : ndarray, shape (2, N)
        y and z. [m]
    slopes : ndarray, shape (2, N)
        p. [rad]
    noise : array_like, shape (), (N,) or (K, N)
        Standard deviation of normal noise in each image, relative to the disc centre as the cameras see it: divided by
        the gain of the cameras. Cameras with NaN do not count. [1]
    fit_gain : bool
        If True, a gain of all cameras is fitted at each pixel too.
    lit : ndarray of int, shape (N,), optional
        Bit i is set if camera i counts, from `wavefront_departures` (default: all).

    Returns
    -------
    ndarray, shape (2, N)
        From the inverse of the information of the cameras that count and see the disc; NaN if it has none. [rad]
    """
    known = smooth_fit(profile) if profile.table.size > 3 else profile
    square, value, by_a, by_b = look_back(layout, known, np.array(pixels), np.array(slopes, np.float64))
    level = np.broadcast_to(np.asarray(noise, np.float64), square.shape)
    counts = (square <= known.radius**2) & (level > 0.0)
    if lit is not None:
        counts &= (lit >> np.arange(len(level))[:, np.newaxis] & 1) == 1
    with np.errstate(divide="ignore", invalid="ignore"):
        value, by_a, by_b = (np.where(counts, each / level, 0.0) for each in (value, by_a, by_b))
        aa, ab, bb = (np.sum(each, axis=0) for each in (by_a * by_a, by_a * by_b, by_b * by_b))
        ga, gb, gg = (np.sum(each, axis=0) for each in (value * by_a, value * by_b, value * value))
        trace = aa + bb
        if fit_gain:
            gg = np.where(gg > 0.0, gg, np.inf)
            aa, ab, bb = aa - ga * ga / gg, ab - ga * gb / gg, bb - gb * gb / gg
        determinant = aa * bb - ab * ab
        inverse = np.where(determinant > 1e-12 * trace * trace, 1.0 / determinant, np.nan)  # less is rounding
        return np.sqrt(np.stack((bb * inverse, aa * inverse)))

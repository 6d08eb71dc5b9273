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

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.gazing.geometry import Scene
from heliosweep.kernels.gazing.rays import camera_ray, ideal_mirror, mirror_offsets
from heliosweep.kernels.sun.profiles import Profile, brightness, inverse_square
from heliosweep.kernels.sun.tables import smooth_fit

Floats = NDArray[np.float64]
_NEEDED = 3
"""Lit cameras that two slopes and the constant need."""


@kernel
def ideal_squares(layout: Scene, y: Floats, z: Floats) -> Floats:
    """Squares of the angles eps0_i at which K cameras see the ideal mirror at N pixels [m], shape (K, N). [rad^2]"""
    cameras, pixels = layout.eyes.shape[0], y.size
    out = np.empty((cameras, pixels))
    eyes, sun_y, sun_z = layout.eyes, layout.sun_y, layout.sun_z
    for i in range(cameras):
        for k in range(pixels):
            x, a, b = ideal_mirror(layout.focal_length, y[k], z[k])
            rx, ry, rz = camera_ray(eyes, i, x, y[k], z[k])
            v, w, _, _, _, _ = mirror_offsets(a, b, rx, ry, rz, sun_y, sun_z)
            out[i, k] = v * v + w * w
    return out


def solutions(gaze: Floats) -> Floats:
    """Least-squares solutions for every set of lit cameras, K from 3 to 8, at m_i = `gaze` of the scene (K, 2) [rad].

    Row s of the result, shape (2^K, 2, K) [1/rad], with bit i of s set where camera i is lit: d = row . (eps0_i^2 -
    eps_i^2), whatever the constant c; 0 for dark cameras, NaN where the set does not determine d.
    """
    cameras = len(gaze)
    if not _NEEDED <= cameras <= 8:
        raise ValueError("3 to 8 cameras are possible")
    out = np.full((1 << cameras, 2, cameras), math.nan)
    whole = float(np.sum((gaze - gaze.mean(axis=0)) ** 2))
    for lit in range(1 << cameras):
        chosen = np.array([i for i in range(cameras) if lit >> i & 1], np.int64)
        if len(chosen) < _NEEDED:
            continue
        spread = gaze[chosen] - gaze[chosen].mean(axis=0)
        yy, yz, zz = np.sum(spread[:, 0] ** 2), np.sum(spread[:, 0] * spread[:, 1]), np.sum(spread[:, 1] ** 2)
        determinant = yy * zz - yz * yz
        if not determinant > 1e-12 * whole * whole:
            continue
        out[lit] = 0.0
        out[lit][0, chosen] = 0.5 * (zz * spread[:, 0] - yz * spread[:, 1]) / determinant
        out[lit][1, chosen] = 0.5 * (yy * spread[:, 1] - yz * spread[:, 0]) / determinant
    return out


def ideal_wavefront(layout: Scene, ideal: Floats) -> Floats:
    """Wavefront slopes w_ideal, shape (2, N) [rad], of the ideal mirror as method A finds them with all cameras.

    From `ideal_squares` (K, N) [rad^2]: the aberrations of a mirror that the sun meets at an angle; w of a defect is
    this and its departure.
    """
    row = solutions(layout.gaze)[-1]
    seen = np.sum(layout.gaze**2, axis=1)[:, np.newaxis] - ideal
    return np.stack([np.sum(row[axis][:, np.newaxis] * seen, axis=0) for axis in (0, 1)])


@kernel
def wavefront_departures(
    images: Floats, ideal: Floats, rows: Floats, profile: Profile, threshold: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Departures d of the wavefront slopes from those of the ideal mirror, shape (2, N) [rad], and the lit cameras.

    Of the brightness relative to the disc centre in K images (K, N) [1], NaN where a camera's pixel cannot be used,
    with `ideal_squares`, `solutions` and the least brightness of a lit camera. NaN where fewer than 3 cameras are lit
    or those are in one line; bit i of a pixel's number is set where camera i is lit.
    """
    cameras, pixels = images.shape
    out, masks = np.empty((2, pixels)), np.empty(pixels, np.int64)
    for k in range(pixels):
        lit = 0
        for i in range(cameras):
            if images[i, k] >= threshold:
                lit |= 1 << i
        dy, dz = 0.0, 0.0
        for i in range(cameras):
            if lit >> i & 1:
                change = ideal[i, k] - inverse_square(profile, images[i, k])
                dy += rows[lit, 0, i] * change
                dz += rows[lit, 1, i] * change
        enough = not math.isnan(rows[lit, 0, 0])
        out[0, k], out[1, k] = dy if enough else math.nan, dz if enough else math.nan
        masks[k] = lit
    return out, masks


@kernel
def transferred(departures: Floats, matrices: Floats) -> Floats:
    """Mirror slopes p = T d, shape (T, 2, N) [rad], of departures (2, N) [rad] by matrices (T, 2, 2)."""
    count, pixels = matrices.shape[0], departures.shape[1]
    out = np.empty((count, 2, pixels))
    for t in range(count):
        for row in range(2):
            left, right = matrices[t, row, 0], matrices[t, row, 1]
            for k in range(pixels):
                out[t, row, k] = left * departures[0, k] + right * departures[1, k]
    return out


def lit_counts(lit: NDArray[np.int64], cameras: int = 4) -> NDArray[np.int64]:
    """Number of lit cameras at each pixel from the bits of `wavefront_departures`."""
    return np.sum((lit[..., np.newaxis] >> np.arange(cameras)) & 1, axis=-1)


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
    cameras, pixels = len(layout.eyes), len(y)
    known = smooth_fit(profile) if profile.table.size > 3 else profile
    counted = np.full(pixels, (1 << cameras) - 1, np.int64) if lit is None else np.array(lit, np.int64)
    level = np.array(np.broadcast_to(np.asarray(noise, np.float64), (cameras, pixels)))
    own = np.array(y, np.float64), np.array(z, np.float64), np.array(slopes, np.float64)
    return least_deviations(layout, known, *own, level, fit_gain, counted)


@kernel
def least_deviations(
    layout: Scene,
    profile: Profile,
    y: Floats,
    z: Floats,
    slopes: Floats,
    noise: Floats,
    fit_gain: bool,
    lit: NDArray[np.int64],
) -> Floats:
    """`slope_bound` of noise (K, N) and a profile that is not noisy itself."""
    cameras, pixels = layout.eyes.shape[0], y.size
    out = np.empty((2, pixels))
    eyes, sun_y, sun_z = layout.eyes, layout.sun_y, layout.sun_z
    for k in range(pixels):
        x, a, b = ideal_mirror(layout.focal_length, y[k], z[k])
        a, b = a + slopes[0, k], b + slopes[1, k]
        yy, yz, zz, gy, gz, gg = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(cameras):
            if not (lit[k] >> i & 1 and noise[i, k] > 0.0):
                continue
            rx, ry, rz = camera_ray(eyes, i, x, y[k], z[k])
            v, w, v_y, v_z, w_y, w_z = mirror_offsets(a, b, rx, ry, rz, sun_y, sun_z)
            square = v * v + w * w
            if not square <= profile.radius * profile.radius:
                continue
            value, steepness = brightness(profile, square)
            value, steepness = value / noise[i, k], steepness / noise[i, k]
            i_y, i_z = steepness * (v * v_y + w * w_y), steepness * (v * v_z + w * w_z)
            yy, yz, zz = yy + i_y * i_y, yz + i_y * i_z, zz + i_z * i_z
            gy, gz, gg = gy + value * i_y, gz + value * i_z, gg + value * value
        if fit_gain and gg > 0.0:
            yy, yz, zz = yy - gy * gy / gg, yz - gy * gz / gg, zz - gz * gz / gg
        determinant = yy * zz - yz * yz
        if determinant > 1e-12 * (yy + zz) * (yy + zz):
            out[0, k], out[1, k] = math.sqrt(zz / determinant), math.sqrt(yy / determinant)
        else:
            out[0, k], out[1, k] = math.nan, math.nan
    return out

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
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import Scene
from heliosweep.kernels.gazing.lanes import (
    BY_A,
    BY_B,
    CAMERA_ROWS,
    FIRST_CAMERA,
    IDEAL_A,
    IDEAL_B,
    IMAGE,
    LANES,
    LIT,
    OWN,
    SQUARE,
    VALUE,
    A,
    B,
    at,
    block_size,
    brighten,
    place,
    rays_size,
    reflect,
    trace_back,
)
from heliosweep.kernels.gazing.rays import ideal_mirror, mirror_offsets, row_of, unit
from heliosweep.kernels.sun.profiles import Profile, inverse_squares
from heliosweep.kernels.sun.tables import smooth_fit

_NEEDED = 3
"""Lit cameras that two slopes and the constant need."""
_LEAST = 5e-324
"""Least noise of a camera that counts. [1]"""
_YY, _YZ, _ZZ, _GY, _GZ, _GG, _BY_Y, _BY_Z = range(OWN, OWN + 8)
"""Rows of lanes: sums of products of derivatives along y and z and of the brightness, g; the least deviations."""


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
    """Least-squares solutions for every set of lit cameras, K from 3 to 8, at m_i = `gaze` of the scene (K, 2) [rad].

    Row s of the result, shape (2^K, 2, K) [1/rad], with bit i of s set where camera i is lit: d = row . (eps0_i^2 -
    eps_i^2), whatever the constant c; 0 for dark cameras, NaN where the set does not determine d.
    """
    if not _NEEDED <= len(gaze) <= 8:
        raise ValueError("3 to 8 cameras are possible")
    out = np.full((1 << len(gaze), 2, len(gaze)), math.nan)
    _solve(np.ascontiguousarray(gaze, np.float64), out)
    return out


@kernel
def _solve(gaze: Floats, out: Floats) -> None:
    """Fill `solutions`, from the last set, of all cameras, on: their spread is what the others' are compared with."""
    cameras, whole = len(gaze), 0.0
    for lit in range(len(out) - 1, -1, -1):
        count, mean_y, mean_z = 0, 0.0, 0.0
        for i in range(cameras):
            if lit >> i & 1:
                count, mean_y, mean_z = count + 1, mean_y + gaze[i, 0], mean_z + gaze[i, 1]
        if count < _NEEDED:
            continue
        mean_y, mean_z = mean_y / count, mean_z / count
        yy, yz, zz = 0.0, 0.0, 0.0
        for i in range(cameras):
            if lit >> i & 1:
                y, z = gaze[i, 0] - mean_y, gaze[i, 1] - mean_z
                yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
        whole = yy + zz if count == cameras else whole
        determinant = yy * zz - yz * yz
        if not determinant > 1e-12 * whole * whole:
            continue
        for i in range(cameras):
            y, z = gaze[i, 0] - mean_y, gaze[i, 1] - mean_z
            out[lit, 0, i] = 0.5 * (zz * y - yz * z) / determinant if lit >> i & 1 else 0.0
            out[lit, 1, i] = 0.5 * (yy * z - yz * y) / determinant if lit >> i & 1 else 0.0


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
    out, masks, squares = np.zeros((2, pixels)), np.zeros(pixels, np.int64), np.empty(pixels)
    table = rows.reshape(-1)
    for i in range(cameras):
        image = images[i]
        for k in range(pixels):
            masks[k] |= np.int64(image[k] >= threshold) << i  # False for NaN
    across, up = out[0], out[1]
    for i in range(cameras):
        image, seen = images[i], ideal[i]
        inverse_squares(profile, image, squares)
        for k in range(pixels):
            place = 2 * cameras * masks[k] + i
            change = seen[k] - squares[k] if image[k] >= threshold else 0.0
            across[k] += table[place] * change
            up[k] += table[place + cameras] * change
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
    cameras, pixels, area = layout.eyes.shape[0], y.size, profile.radius * profile.radius
    out, places = np.empty((2, pixels)), np.empty((2, pixels))
    places[0], places[1] = y, z
    lanes, rays, level = np.zeros(block_size(cameras)), np.empty(rays_size(cameras)), np.empty_like(noise)
    for i in range(cameras):
        for k in range(pixels):
            level[i, k] = noise[i, k] if lit[k] >> i & 1 else math.nan
    following, first, end = 0, 0, 0
    while following < pixels:
        if following >= end:
            first, end = following, trace_back(rays, cameras, layout, places, following)
        count = min(LANES, end - following)
        for k in range(count):
            pixel = following + k
            place(lanes, k, False, layout.gaze, rays, pixel - first, level, pixel, _LEAST)
            lanes[A * LANES + k] = lanes[IDEAL_A * LANES + k] + slopes[0, pixel]
            lanes[B * LANES + k] = lanes[IDEAL_B * LANES + k] + slopes[1, pixel]
        reflect(lanes, cameras, layout, True)
        brighten(lanes, cameras, profile, True)
        _bound(lanes, cameras, area, fit_gain)
        for k in range(count):
            out[0, following + k], out[1, following + k] = lanes[_BY_Y * LANES + k], lanes[_BY_Z * LANES + k]
        following += count
    return out


@inline
def _bound(lanes, cameras, area, fit_gain):
    """Least deviations of all lanes, from brightnesses and derivatives there and with noise in place of images.

    Of the cameras that are lit and see the disc, whose squares of angles are not above `area`.
    """
    for row in range(_YY, _GG + 1):
        for k in range(LANES):
            lanes[row * LANES + k] = 0.0
    for camera in range(cameras):
        n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
        for k in range(LANES):
            counts = (lanes[at(n, LIT, k)] > 0.0) & (lanes[at(n, SQUARE, k)] <= area)
            weight = 1.0 / lanes[at(n, IMAGE, k)] if counts else 0.0
            value, by_y, by_z = lanes[at(n, VALUE, k)], lanes[at(n, BY_A, k)], lanes[at(n, BY_B, k)]
            value, by_y, by_z = weight * value, weight * by_y, weight * by_z
            lanes[_YY * LANES + k] += by_y * by_y
            lanes[_YZ * LANES + k] += by_y * by_z
            lanes[_ZZ * LANES + k] += by_z * by_z
            lanes[_GY * LANES + k] += value * by_y
            lanes[_GZ * LANES + k] += value * by_z
            lanes[_GG * LANES + k] += value * value
    for k in range(LANES):
        yy, yz, zz = lanes[_YY * LANES + k], lanes[_YZ * LANES + k], lanes[_ZZ * LANES + k]
        gy, gz, gg = lanes[_GY * LANES + k], lanes[_GZ * LANES + k], lanes[_GG * LANES + k]
        each, whole = 1.0 / gg if fit_gain & (gg > 0.0) else 0.0, yy + zz
        yy, yz, zz = yy - gy * gy * each, yz - gy * gz * each, zz - gz * gz * each
        determinant = yy * zz - yz * yz
        inverse = 1.0 / determinant if determinant > 1e-12 * whole * whole else math.nan  # less is rounding
        lanes[_BY_Y * LANES + k], lanes[_BY_Z * LANES + k] = math.sqrt(zz * inverse), math.sqrt(yy * inverse)

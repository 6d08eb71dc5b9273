"""Methods O1 and O2: slopes by Nelder-Mead's simplex method, pixel by pixel [1]_.

O1 looks for the wavefront slope w that makes the sum over the lit cameras of (B(|m_i - w|) - I_i)^2 least; O2 for the
mirror slope p, with rays traced back, sum of (B(eps_i(p)) - I_i)^2. Both start at method A's result. The simplex and
the tolerances are fixed: the defaults of SciPy would stop after five evaluations at these magnitudes.

References
----------
.. [1] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing_geometry import Scene
from heliosweep.kernels.gazing_lanes import (
    CHUNK,
    GAIN,
    LANES,
    MERIT,
    OWN,
    A,
    B,
    block_size,
    brighten,
    place_pixel,
    place_wavefront,
    project,
    rays_size,
    reflect,
    trace_back,
    weigh,
)
from heliosweep.kernels.nelder_mead import COUNTS, EVALUATIONS, ITERATIONS, POINT, STATE, VALUE, advance, corner_simplex
from heliosweep.kernels.sun_profiles import Profile

__all__ = [
    "FATOL",
    "LIMIT",
    "SIMPLEX",
    "XATOL",
    "SlopeSearch",
    "merits",
    "search",
    "search_slopes",
    "search_wavefronts",
]

Floats = NDArray[np.float64]

SIMPLEX = 0.5e-3
"""Side of the first simplex. [rad]"""
XATOL = 1e-7
"""Size of the last simplex. [rad]"""
FATOL = 1e-10
"""Range of the merit in the last simplex. [1]"""
LIMIT = 400
"""Most iterations, and most evaluations: SciPy's limits for two unknowns."""

_FROM_A, _FROM_B = OWN, OWN + 1
"""Rows of the slopes from which those of the search are counted: of the ideal mirror, or 0."""


class SlopeSearch(NamedTuple):
    """Slopes of N pixels found by the simplex method; NaN where fewer than 3 cameras are lit."""

    slopes: Floats
    """w of O1 or p of O2, horizontal and vertical, shape (2, N). [rad]"""
    merit: Floats
    """Sum of squares left. [1]"""
    gain: Floats
    """Gain, 1 where it is not fitted. [1]"""
    evaluations: NDArray[np.int64]
    """How often the merit was evaluated; 0 where there was no search."""
    converged: NDArray[np.bool_]
    """False where a limit was reached or there was no search."""


def search_slopes(
    layout: Scene,
    profile: Profile,
    images: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    start: ArrayLike,
    *,
    threshold: float = 0.3,
    fit_gain: bool = False,
) -> SlopeSearch:
    """Method O2.

    Parameters
    ----------
    layout : Scene
        K cameras.
    profile : Profile
        Of the sun.
    images : array_like, shape (K, N)
        Brightness relative to the disc centre. [1]
    y, z : array_like, shape (N,)
        Pixels, from the mirror centre. [m]
    start : array_like, shape (2, N)
        First guess of p, from method A; 0 where it is not finite. [rad]
    threshold : float
        Least brightness of a lit camera; darker ones, and NaN, do not count. [1]
    fit_gain : bool
        Whether the merit is that of the best gain of the pixel, common to its cameras.

    Returns
    -------
    SlopeSearch
    """
    return _searched(False, layout, profile, images, [y, z], start, threshold, fit_gain)


def search_wavefronts(
    layout: Scene,
    profile: Profile,
    images: ArrayLike,
    start: ArrayLike,
    *,
    threshold: float = 0.3,
    fit_gain: bool = False,
) -> SlopeSearch:
    """Method O1; parameters as in `search_slopes`, with the wavefront slopes w of method A as `start` [rad].

    Mirror slopes are T (w - w_ideal) with T of `gazing_geometry.transfers` and w_ideal of
    `gazing_linear.ideal_wavefront`.
    """
    return _searched(True, layout, profile, images, np.zeros_like(start), start, threshold, fit_gain)


def _searched(wavefront, layout, profile, images, place, start, threshold, fit_gain):
    seen, where = np.array(images, np.float64), np.array(place, np.float64)
    found, counts = np.empty((4, seen.shape[1])), np.zeros((2, seen.shape[1]), np.int64)
    found[:2] = np.where(np.isfinite(start), start, 0.0)
    search(wavefront, layout, profile, seen, where, threshold, fit_gain, found, counts)
    converged = (counts[1] > 0) & (counts[0] < LIMIT) & (counts[1] < LIMIT)
    return SlopeSearch(found[:2], found[2], found[3], counts[1], converged)


@kernel
def merits(
    wavefront: bool,
    layout: Scene,
    profile: Profile,
    images: Floats,
    place: Floats,
    threshold: float,
    fit_gain: bool,
    slopes: Floats,
) -> Floats:
    """Sums of squares, shape (N,), of the slopes w of a wavefront, or p, shape (2, N) [rad]; else as `search`."""
    cameras, pixels = images.shape[0], images.shape[1]
    lanes, rays, out = np.zeros(block_size(cameras)), np.empty(rays_size(cameras)), np.empty(pixels)
    following, first, end = 0, 0, 0
    while following < pixels:
        if following >= end:
            first, end = following, trace_back(rays, cameras, layout, place, following)
        count = min(LANES, end - following)
        for k in range(count):
            pixel = following + k
            _place(lanes, k, wavefront, layout.gaze, rays, pixel - first, images, pixel, threshold)
            lanes[A * LANES + k] = lanes[_FROM_A * LANES + k] + slopes[0, pixel]
            lanes[B * LANES + k] = lanes[_FROM_B * LANES + k] + slopes[1, pixel]
        _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain)
        for k in range(count):
            out[following + k] = lanes[MERIT * LANES + k]
        following += count
    return out


@kernel
def search(
    wavefront: bool,
    layout: Scene,
    profile: Profile,
    images: Floats,
    place: Floats,
    threshold: float,
    fit_gain: bool,
    found: Floats,
    numbers: NDArray[np.int64],
) -> None:
    """O1 (`wavefront`) or O2.

    Parameters
    ----------
    wavefront : bool
        Whether the unknowns are the slopes w of a wavefront, or p of the mirror.
    layout, profile, images, threshold, fit_gain
        As in `search_slopes`.
    place : ndarray, shape (2, N)
        Pixels (y, z); not used for a wavefront. [m]
    found : ndarray, shape (4, N)
        On entry the first guess in rows 0 and 1; on return slopes [rad], merit and gain.
    numbers : ndarray of int64, shape (2, N)
        0 on entry; filled with iterations and evaluations.
    """
    cameras, pixels = images.shape[0], images.shape[1]
    lanes, pixel_of = np.zeros(block_size(cameras)), np.full(LANES, -1)
    state, counts = np.zeros((LANES, STATE)), np.zeros((LANES, COUNTS), np.int64)
    rays, gaze = np.empty(rays_size(cameras)), layout.gaze
    following, first, end, busy = 0, 0, 0, 0
    while busy > 0 or following < pixels:
        if end < pixels and following + LANES > end:
            first, end = following, trace_back(rays, cameras, layout, place, following)
        for k in range(LANES):
            while pixel_of[k] < 0 and following < end:
                pixel = following
                following += 1
                if _place(lanes, k, wavefront, gaze, rays, pixel - first, images, pixel, threshold) >= 3:
                    corner_simplex(state, counts, k, found[0, pixel], found[1, pixel], SIMPLEX)
                    pixel_of[k] = pixel
                    busy += 1
                    continue
                found[0, pixel], found[1, pixel], found[2, pixel], found[3, pixel] = np.nan, np.nan, np.nan, np.nan
            lanes[A * LANES + k] = lanes[_FROM_A * LANES + k] + state[k, POINT]
            lanes[B * LANES + k] = lanes[_FROM_B * LANES + k] + state[k, POINT + 1]
        _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain)
        for k in range(LANES):
            if pixel_of[k] < 0 or advance(state, counts, k, lanes[MERIT * LANES + k], XATOL, FATOL, LIMIT, LIMIT):
                continue
            pixel = pixel_of[k]
            found[0, pixel], found[1, pixel], found[2, pixel] = state[k, 0], state[k, 1], state[k, VALUE]
            found[3, pixel] = lanes[GAIN * LANES + k]  # of the last simplex, which is as small as its tolerances
            numbers[0, pixel], numbers[1, pixel] = counts[k, ITERATIONS], counts[k, EVALUATIONS]
            pixel_of[k] = -1
            busy -= 1


@inline
def _place(lanes, k, wavefront, gaze, rays, n, images, pixel, threshold):
    """Put a pixel, the nth of its chunk, into a lane; returns the number of lit cameras."""
    if wavefront:
        return place_wavefront(lanes, k, gaze, images, pixel, threshold)
    lanes[_FROM_A * LANES + k], lanes[_FROM_B * LANES + k] = rays[n], rays[CHUNK + n]
    return place_pixel(lanes, k, rays, n, images, pixel, threshold)


@inline
def _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain):
    """Merits at the trial slopes of all lanes."""
    if wavefront:
        project(lanes, cameras)
    else:
        reflect(lanes, cameras, layout)
    brighten(lanes, cameras, profile)
    weigh(lanes, cameras, fit_gain)

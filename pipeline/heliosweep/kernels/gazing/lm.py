"""Mirror slopes by Levenberg-Marquardt: all pixels at once, with analytic derivatives.

The merit is that of method O2 in `search`: the sum over the lit cameras of (g B(eps_i(p)) - I_i)^2. The gain g of a
pixel is 1, or the one that makes the sum least; then the derivatives are those from which its direction is removed
(variable projection [1]_), so that it is no third unknown.

A noisy table has a dip in the merit at every kink of its own. So the search goes from smooth to rough: first the
analytic curve nearest to the table, then the table smoothed less and less, then the table.

References
----------
.. [1] L. Kaufman, "A variable projection method for solving separable nonlinear least squares problems", BIT 15 (1975)
   49-57
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import Scene
from heliosweep.kernels.gazing.lanes import (
    BY_A,
    BY_B,
    CAMERA_ROWS,
    FIRST_CAMERA,
    GAIN,
    IDEAL_A,
    IDEAL_B,
    LANES,
    LIT,
    MERIT,
    NOT_CONVERGED,
    OUTSIDE,
    OWN,
    REST,
    SQUARE,
    VALUE,
    A,
    B,
    Flags,
    SlopeFit,
    at,
    begun,
    block_size,
    brighten,
    next_lit,
    rays_size,
    reflect,
    trace_back,
    weigh,
)
from heliosweep.kernels.sun.profiles import Profile
from heliosweep.kernels.sun.tables import smooth_fit, smoothed

GRADUATION = (6.0, 3.0, 1.5, 0.7)
"""Smoothing of a table before it is used itself, in nodes."""

_SMOOTH_STEP, _TABLE_STEP, _PASSING_STEP = 1e-11, 1e-8, 1e-5
"""A search ends at a step as short as this: for an analytic profile, for a table, and where another stage follows.
[rad]"""
_FARTHEST = 1e-3
"""Longest step. [rad]"""
_BEST_A, _BEST_B, _BEST_MERIT, _BEST_GAIN, _AA, _AB, _BB, _DOWN_A, _DOWN_B = range(OWN, OWN + 9)
_DAMPING, _STEP, _COUNT, _VALUES, _VA, _VB = range(OWN + 9, OWN + 15)
_TRIAL_AA = OWN + 15
"""First of five rows: J^T J and J^T r at the trial slopes, in the order of `_AA` to `_DOWN_B`."""


def graduated(profile: Profile) -> list[Profile]:
    """A profile as a series from smooth to rough; the last one is the profile itself.

    An analytic profile alone; before a table its smooth fit and its smoothed copies (`GRADUATION`).
    """
    if profile.table.size == 0:
        return [profile]
    first = [smooth_fit(profile)] if profile.table.size > 3 else []
    return [*first, *(smoothed(profile, nodes) for nodes in GRADUATION), profile]


def fit_slopes(
    layout: Scene,
    profile: Profile | Sequence[Profile],
    images: ArrayLike,
    start: ArrayLike,
    pixels: ArrayLike,
    *,
    threshold: float = 0.3,
    fit_gain: bool = False,
    limit: int = 50,
) -> SlopeFit:
    """Slopes of all pixels.

    Parameters
    ----------
    layout : Scene
        K cameras.
    profile : Profile or sequence of Profile
        The profile, which is graduated if it is a table; or the stages, from smooth to rough, from `graduated`.
    images : array_like, shape (K, N)
        Brightness relative to the disc centre. [1]
    start : array_like, shape (2, N)
        First guess of p, from method A; 0 where it is not finite. [rad]
    pixels : array_like, shape (2, N)
        Places y and z of the pixels, from the mirror centre. [m]
    threshold : float
        Least brightness of a lit camera; darker ones, and NaN, do not count. [1]
    fit_gain : bool
        Whether every pixel has a gain of its own, common to its cameras: the one that makes the merit least.
    limit : int
        Most evaluations in a stage.
    """
    stages = graduated(profile) if isinstance(profile, Profile) else list(profile)
    seen, found, evaluations, flags = begun(images, start)
    places, deviation = np.array(pixels, np.float64, order="C"), found[2:4]
    for n, stage in enumerate(stages):
        enough = _PASSING_STEP if n + 1 < len(stages) else _TABLE_STEP if stage.table.size > 0 else _SMOOTH_STEP
        levenberg_marquardt(layout, stage, seen, places, threshold, fit_gain, enough, limit, found, evaluations, flags)
        if n == 0:  # the steepness of a noisy table says little about that of the sun's disc
            deviation = found[2:4].copy()
    return SlopeFit(found[:2], deviation, found[4], found[5], evaluations, flags)


@kernel
def levenberg_marquardt(
    layout: Scene,
    profile: Profile,
    images: Floats,
    pixels: Floats,
    threshold: float,
    fit_gain: bool,
    enough: float,
    limit: int,
    found: Floats,
    evaluations: Integers,
    flags: Flags,
) -> None:
    """Improve the slopes of all pixels (y, z), shape (2, N) [m], for one profile; fills what `begun` makes.

    A step as short as `enough` [rad] ends a search; the step itself is still taken.
    """
    cameras, number = images.shape[0], images.shape[1]
    lanes, pixel_of = np.zeros(block_size(cameras)), np.full(LANES, -1)
    rays, gaze = np.empty(rays_size(cameras)), layout.gaze
    radius_squared = profile.radius * profile.radius
    following, first, end, busy = 0, 0, 0, 0
    while busy > 0 or following < number:
        if end < number and following + LANES > end:
            first, end = following, trace_back(rays, cameras, layout, pixels, following)
        for k in range(LANES):
            if pixel_of[k] < 0:
                following, pixel = next_lit(
                    lanes, k, False, gaze, rays, first, images, threshold, following, end, found, flags
                )
                if pixel >= 0:
                    lanes[A * LANES + k] = lanes[IDEAL_A * LANES + k] + found[0, pixel]
                    lanes[B * LANES + k] = lanes[IDEAL_B * LANES + k] + found[1, pixel]
                    lanes[_BEST_MERIT * LANES + k] = np.inf
                    lanes[_DAMPING * LANES + k], lanes[_COUNT * LANES + k] = 0.0, 0.0
                    pixel_of[k] = pixel
                    busy += 1
        reflect(lanes, cameras, layout, True)
        brighten(lanes, cameras, profile, True)
        weigh(lanes, cameras, fit_gain)
        _step(lanes, cameras, fit_gain)
        for k in range(LANES):
            if pixel_of[k] >= 0 and not (lanes[_STEP * LANES + k] > enough and lanes[_COUNT * LANES + k] < limit):
                _store(lanes, k, cameras, radius_squared, enough, pixel_of[k], found, flags)
                evaluations[pixel_of[k]] += int(lanes[_COUNT * LANES + k])
                pixel_of[k] = -1
                busy -= 1


@inline
def _step(lanes, cameras, fit_gain):
    """Keep the trial slopes where they are the best so far, and make new ones.

    The normal matrix is damped by a share of its mean diagonal; by none as long as every step succeeds.
    """
    _normal_matrix(lanes, cameras, fit_gain)
    for k in range(LANES):
        better = lanes[MERIT * LANES + k] <= lanes[_BEST_MERIT * LANES + k]
        _keep(lanes, k, better, MERIT, _BEST_MERIT)
        _keep(lanes, k, better, GAIN, _BEST_GAIN)
        _keep(lanes, k, better, A, _BEST_A)
        _keep(lanes, k, better, B, _BEST_B)
        for row in range(5):
            _keep(lanes, k, better, _TRIAL_AA + row, _AA + row)
        damping = lanes[_DAMPING * LANES + k]
        eased = 0.1 * damping if damping > 1e-6 else 0.0
        damping = eased if better else max(10.0 * damping, 1e-3)
        lanes[_DAMPING * LANES + k] = damping
        aa, ab, bb = lanes[_AA * LANES + k], lanes[_AB * LANES + k], lanes[_BB * LANES + k]
        more = 0.5 * damping * (aa + bb)
        aa, bb = aa + more, bb + more
        down_a, down_b = lanes[_DOWN_A * LANES + k], lanes[_DOWN_B * LANES + k]
        scale = 1.0 / (aa * bb - ab * ab)
        step_a, step_b = (ab * down_b - bb * down_a) * scale, (ab * down_a - aa * down_b) * scale
        length = abs(step_a) + abs(step_b)  # NaN if either is
        shorter = _FARTHEST / max(length, _FARTHEST)
        lanes[A * LANES + k] = lanes[_BEST_A * LANES + k] + step_a * shorter
        lanes[B * LANES + k] = lanes[_BEST_B * LANES + k] + step_b * shorter
        lanes[_STEP * LANES + k] = length
        lanes[_COUNT * LANES + k] += 1.0


@inline
def _keep(lanes, k, better, new, old):
    """Copy one row to another where `better`."""
    lanes[old * LANES + k] = lanes[new * LANES + k] if better else lanes[old * LANES + k]


@inline
def _normal_matrix(lanes, cameras, fit_gain):
    """J^T J and J^T r at the trial slopes; with a gain, of the derivatives at right angles to it."""
    for k in range(LANES):
        for row in range(5):
            lanes[(_TRIAL_AA + row) * LANES + k] = 0.0
    if fit_gain:
        for k in range(LANES):
            lanes[_VALUES * LANES + k], lanes[_VA * LANES + k], lanes[_VB * LANES + k] = 1e-60, 0.0, 0.0
        for camera in range(cameras):
            n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
            for k in range(LANES):
                value = lanes[at(n, VALUE, k)] * lanes[at(n, LIT, k)]
                lanes[_VALUES * LANES + k] += value * value
                lanes[_VA * LANES + k] += value * lanes[at(n, BY_A, k)]
                lanes[_VB * LANES + k] += value * lanes[at(n, BY_B, k)]
        for k in range(LANES):
            lanes[_VA * LANES + k] /= lanes[_VALUES * LANES + k]
            lanes[_VB * LANES + k] /= lanes[_VALUES * LANES + k]
        for camera in range(cameras):
            n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
            for k in range(LANES):
                value = lanes[at(n, VALUE, k)]
                lanes[at(n, BY_A, k)] -= value * lanes[_VA * LANES + k]
                lanes[at(n, BY_B, k)] -= value * lanes[_VB * LANES + k]
    for camera in range(cameras):
        n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
        for k in range(LANES):
            weight = lanes[GAIN * LANES + k] * lanes[at(n, LIT, k)]
            by_a, by_b = lanes[at(n, BY_A, k)] * weight, lanes[at(n, BY_B, k)] * weight
            rest = lanes[at(n, REST, k)]
            lanes[_TRIAL_AA * LANES + k] += by_a * by_a
            lanes[(_TRIAL_AA + 1) * LANES + k] += by_a * by_b
            lanes[(_TRIAL_AA + 2) * LANES + k] += by_b * by_b
            lanes[(_TRIAL_AA + 3) * LANES + k] += by_a * rest
            lanes[(_TRIAL_AA + 4) * LANES + k] += by_b * rest


@inline
def _store(lanes, k, cameras, radius_squared, enough, pixel, found, flags):
    """Put what a lane has found where it belongs, with the last step if that was short enough."""
    step, flag = lanes[_STEP * LANES + k], 0
    row_a, row_b = (A, B) if step <= enough else (_BEST_A, _BEST_B)
    found[0, pixel] = lanes[row_a * LANES + k] - lanes[IDEAL_A * LANES + k]
    found[1, pixel] = lanes[row_b * LANES + k] - lanes[IDEAL_B * LANES + k]
    aa, ab, bb = lanes[_AA * LANES + k], lanes[_AB * LANES + k], lanes[_BB * LANES + k]
    determinant = aa * bb - ab * ab
    found[2, pixel], found[3, pixel] = math.sqrt(bb / determinant), math.sqrt(aa / determinant)
    found[4, pixel], found[5, pixel] = lanes[_BEST_GAIN * LANES + k], lanes[_BEST_MERIT * LANES + k]
    if not step <= enough:
        flag += NOT_CONVERGED
    for camera in range(cameras):
        n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
        if lanes[at(n, LIT, k)] > 0.0 and lanes[at(n, SQUARE, k)] > radius_squared:
            flag |= OUTSIDE
    flags[pixel] = flag

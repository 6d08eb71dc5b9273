"""Mirror slopes from images: linear least squares (A), Nelder-Mead (O1, O2) and Levenberg-Marquardt (LM) [1]_.

A: the camera at m_i sees the disc at the angle eps_i from its centre, and eps_i^2 = |m_i - w|^2 up to the aberrations
of the mirror. The difference from the ideal mirror at the same pixel, which the same cameras would see at eps0_i, is
linear in the departure d = w - w_ideal of the wavefront slopes: eps_i^2 - eps0_i^2 = -2 m_i.d + c. Mirror slopes are
p = T d, with T of `geometry.transfers`. Only lit cameras count, and 3 are needed.

O1 minimises the sum over the lit cameras of (g B(|m_i - w|) - I_i)^2 over the wavefront slope w. O2 and LM trace the
rays back and minimise the sum of (g B(eps_i(p)) - I_i)^2 over the mirror slope p. All start at the result of method A.
The gain g of a pixel is 1, or the value that minimises the sum. LM then removes the direction of g from the
derivatives (variable projection [2]_).

The simplex takes the steps of ``scipy.optimize.minimize(method="Nelder-Mead")``: reflection 1, expansion 2, contraction
and shrinkage 1/2. Of equal values the older vertex comes first.

A noisy table has a dip in the merit at each kink. LM therefore starts with the analytic curve nearest to the table,
then uses the table smoothed less and less, then the table.

References
----------
.. [1] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270
.. [2] L. Kaufman, "A variable projection method for solving separable nonlinear least squares problems", BIT 15 (1975)
   49-57
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.gazing.geometry import Scene, ideal_mirror, mirror_offsets, offsets, row_of, unit
from heliosweep.kernels.profiles import Profile, brightness, inverse_squares, smooth_fit, smoothed

Flags = NDArray[np.uint8]

#: Flags of a pixel: the search ended at its limit; fewer than 3 cameras are lit; at the slopes of LM a lit camera looks
#: outside the disc, where the profile is its tangent.
NOT_CONVERGED, UNLIT, OUTSIDE = 1, 2, 4
#: Side of the first simplex, size of the last simplex [rad], range of its merit [1], and maximum number of evaluations.
SIMPLEX, XATOL, FATOL, LIMIT = 0.5e-3, 1e-7, 1e-10, 400
#: Smoothing of a table in the stages of LM before the last one, in nodes.
GRADUATION = (6.0, 3.0, 1.5, 0.7)
#: Length of the last step of LM: for an analytic profile, for a table, and before another stage. [rad]
_SMOOTH_STEP, _TABLE_STEP, _PASSING_STEP = 1e-11, 1e-8, 1e-5
#: Maximum step of LM. [rad]
_FARTHEST = 1e-3
_TINY = 1e-60


class SlopeFit(NamedTuple):
    """Slopes of N pixels; NaN if fewer than 3 cameras are lit.

    Attributes
    ----------
    slopes : ndarray, shape (2, N)
        p relative to the ideal mirror, or w of O1, horizontal and vertical. [rad]
    deviation : ndarray, shape (2, N)
        Standard deviation of the slopes of LM for camera noise of standard deviation 1: the Cramer-Rao bound, for a
        table the bound of its smooth fit. NaN for O1 and O2. [rad]
    gain, merit : ndarray, shape (N,)
        g, 1 if it is not fitted, and the minimum sum of squares. [1]
    evaluations : ndarray of int, shape (N,)
        Evaluations of the merit, over all stages.
    flags : ndarray of uint8, shape (N,)
        Sum of `NOT_CONVERGED`, `UNLIT` and `OUTSIDE`.
    """

    slopes: Floats
    deviation: Floats
    gain: Floats
    merit: Floats
    evaluations: Integers
    flags: Flags


def graduated(profile: Profile) -> list[Profile]:
    """Return the stages of LM, from smooth to rough; the last one is the profile."""
    first = [smooth_fit(profile)] if profile.table.size > 3 else []
    return [*first, *(smoothed(profile, nodes) for nodes in GRADUATION if profile.table.size > 0), profile]


def fit_slopes(
    method: str,
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
    """Fit the slopes of all pixels.

    Parameters
    ----------
    method : {'O1', 'O2', 'LM'}
        O1 has slopes w of the wavefront, at the start and in the result. Mirror slopes are T (w - w_ideal) with T of
        `geometry.transfers` and w_ideal of `ideal_wavefront`.
    layout : Scene
        K cameras.
    profile : Profile or sequence of Profile
        Sun profile, or the stages of LM from `graduated`.
    images : array_like, shape (K, N)
        Brightness relative to the disc centre. [1]
    start : array_like, shape (2, N)
        First guess of p, from method A; 0 is used if it is not finite. [rad]
    pixels : array_like, shape (2, N)
        y and z of the pixels, from the mirror centre. [m]
    threshold : float
        Minimum brightness of a lit camera; NaN is not lit. [1]
    fit_gain : bool
        If True, each pixel has its own gain, common to the cameras.
    limit : int
        Maximum number of evaluations in a stage of LM.

    Returns
    -------
    SlopeFit
    """
    brightnesses, places = np.array(images, np.float64, order="C"), np.array(pixels, np.float64, order="C")
    fit = np.full((6, brightnesses.shape[1]), np.nan)
    fit[:2] = np.where(np.isfinite(start), start, 0.0)
    evaluations, flags = np.zeros(fit.shape[1], np.int64), np.zeros(fit.shape[1], np.uint8)
    stages, deviation = [profile] if isinstance(profile, Profile) else list(profile), fit[2:4]
    if method == "LM" and isinstance(profile, Profile):
        stages = graduated(profile)
    for n, stage in enumerate(stages):
        enough = _PASSING_STEP if n + 1 < len(stages) else _TABLE_STEP if stage.table.size > 0 else _SMOOTH_STEP
        kind = method == "O1", method == "LM"
        _fit(*kind, layout, stage, brightnesses, places, threshold, fit_gain, enough, limit, fit, evaluations, flags)
        if n == 0:  # the steepness of a noisy table differs from the steepness of the sun's disc
            deviation = fit[2:4].copy()
    return SlopeFit(fit[:2], deviation, fit[4], fit[5], evaluations, flags)


def look_back(layout: Scene, profile: Profile, pixels: Floats, slopes: Floats) -> Floats:
    """Trace rays from K cameras over mirror slopes p, shape (2, N) [rad], at pixels (y, z), shape (2, N) [m].

    Returns the square of the angle from the disc centre [rad^2], the brightness [1] and its derivatives by p [1/rad],
    shape (4, K, N).
    """
    x, a, b = ideal_mirror(layout.focal_length, *pixels)
    v, w, va, vb, wa, wb = offsets(layout, np.stack((x, *pixels)), a + slopes[0], b + slopes[1])
    square = v * v + w * w
    value, steepness = _brightness_of(profile, square.ravel()).reshape(2, *square.shape)
    return np.stack((square, value, steepness * (v * va + w * wa), steepness * (v * vb + w * wb)))


@kernel
def _brightness_of(profile: Profile, squares: Floats) -> Floats:
    """Return `brightness` and its slope at squares of angles (n,), shape (2, n)."""
    out = np.empty((2, squares.size))
    for k in range(squares.size):
        out[0, k], out[1, k] = brightness(profile, squares[k])
    return out


def residual_squares(seen: Floats, images: Floats, threshold: float, fit_gain: bool) -> Floats:
    """Return the sums of squared residuals over the lit cameras, shape (N,), for brightnesses and images (K, N)."""
    lit = images >= threshold  # False for NaN
    values, bright = np.where(lit, seen, 0.0), np.where(lit, images, 0.0)
    gain = np.sum(values * bright, axis=0) / (_TINY + np.sum(values**2, axis=0)) if fit_gain else 1.0
    return np.asarray(np.sum((gain * values - bright) ** 2, axis=0), np.float64)


@inner
def _equations(task, a, b):
    """Return the sum of squares and gain at slopes (a, b), True if a camera looks outside the disc, J^T J and J^T r."""
    wavefront, sun_y, sun_z, profile, fit_gain, rays, bright, rows, count = task
    gain, along_a, along_b, product, square, outside = 1.0, 0.0, 0.0, 0.0, _TINY, False
    for i in range(count):
        v, w, va, vb, wa, wb = a - rays[i, 0], b - rays[i, 1], 1.0, 0.0, 0.0, 1.0
        if not wavefront:
            v, w, va, vb, wa, wb = mirror_offsets(a, b, rays[i, 0], rays[i, 1], rays[i, 2], sun_y, sun_z)
        outside |= v * v + w * w > profile.radius * profile.radius
        value, steepness = brightness(profile, v * v + w * w)
        by_a, by_b = steepness * (v * va + w * wa), steepness * (v * vb + w * wb)
        rows[i, 0], rows[i, 1], rows[i, 2] = value, by_a, by_b
        product, square = product + value * bright[i], square + value * value
        along_a, along_b = along_a + value * by_a, along_b + value * by_b
    if fit_gain:
        gain, along_a, along_b = product / square, along_a / square, along_b / square
    else:
        along_a = along_b = 0.0
    merit = aa = ab = bb = down_a = down_b = 0.0
    for i in range(count):
        rest = gain * rows[i, 0] - bright[i]
        by_a, by_b = gain * (rows[i, 1] - along_a * rows[i, 0]), gain * (rows[i, 2] - along_b * rows[i, 0])
        merit += rest * rest
        aa, ab, bb = aa + by_a * by_a, ab + by_a * by_b, bb + by_b * by_b
        down_a, down_b = down_a + by_a * rest, down_b + by_b * rest
    return merit, gain, outside, (aa, ab, bb, down_a, down_b)


@kernel
def _fit(
    wavefront: bool, levenberg: bool, layout: Scene, profile: Profile, images: Floats, pixels: Floats, threshold: float,
    fit_gain: bool, enough: float, limit: int, fit: Floats, evaluations: Integers, flags: Flags,
) -> None:  # fmt: skip
    """Fit all pixels (y, z), shape (2, N) [m], for one profile by O1 (`wavefront`), LM (`levenberg`) or else O2.

    `fit` has rows of slopes, deviations, gain and merit; slopes are the start. [rad]
    """
    cameras = images.shape[0]
    rays, bright, rows, simplex = np.empty((cameras, 3)), np.empty(cameras), np.empty((cameras, 3)), np.empty((5, 3))
    sun_y, sun_z = row_of(layout.sun_y), row_of(layout.sun_z)
    for n in range(images.shape[1]):
        y, z, count = pixels[0, n], pixels[1, n], 0
        x, a, b = (0.0, 0.0, 0.0) if wavefront else ideal_mirror(layout.focal_length, y, z)
        for i in range(cameras):
            if images[i, n] >= threshold:  # False for NaN
                rx, ry, rz = layout.gaze[i, 0], layout.gaze[i, 1], 0.0
                if not wavefront:
                    rx, ry, rz = unit(layout.eyes[i, 0] - x, layout.eyes[i, 1] - y, layout.eyes[i, 2] - z)
                rays[count, 0], rays[count, 1], rays[count, 2] = rx, ry, rz
                bright[count] = images[i, n]
                count += 1
        if count < 3:
            fit[:, n], flags[n] = math.nan, UNLIT
            continue
        task = wavefront, sun_y, sun_z, profile, fit_gain, rays, bright, rows, count
        if levenberg:
            tries, flags[n] = _levenberg_marquardt(task, a, b, n, enough, limit, fit)
            evaluations[n] += tries
            continue
        for j in range(3):
            simplex[j, 0] = fit[0, n] + (SIMPLEX if j == 1 else 0.0)
            simplex[j, 1] = fit[1, n] + (SIMPLEX if j == 2 else 0.0)
        evaluations[n], fit[4, n] = nelder_mead(_equations, task, a, b, simplex, XATOL, FATOL, LIMIT)
        fit[0, n], fit[1, n], fit[5, n] = simplex[0, 0], simplex[0, 1], simplex[0, 2]
        flags[n] = NOT_CONVERGED if evaluations[n] >= LIMIT else 0


@inline
def nelder_mead(function, task, a, b, simplex, xatol, fatol, limit):
    """Minimise a function of two unknowns, added to (a, b), from three vertices (x, y, value) in five rows.

    Returns the number of evaluations and the second result of the last one. The search ends if no vertex is further
    than `xatol` from the best in either coordinate and no value further than `fatol`, or at the limit of evaluations.
    The first vertex is the minimum.
    """
    count, last = 3, 0.0
    for j in range(3):
        simplex[j, 2], last = function(task, a + simplex[j, 0], b + simplex[j, 1])[:2]
    while True:
        _sort_vertices(simplex)
        size = max(
            max(abs(simplex[1, 0] - simplex[0, 0]), abs(simplex[1, 1] - simplex[0, 1])),
            max(abs(simplex[2, 0] - simplex[0, 0]), abs(simplex[2, 1] - simplex[0, 1])),
        )
        fall = max(abs(simplex[0, 2] - simplex[1, 2]), abs(simplex[0, 2] - simplex[2, 2]))
        if count >= limit or (size <= xatol and fall <= fatol):
            return count, last
        simplex[3, 0], simplex[3, 1] = _beyond(simplex, 2.0)
        simplex[3, 2], last = function(task, a + simplex[3, 0], b + simplex[3, 1])[:2]
        count, row = count + 1, 3 if simplex[0, 2] <= simplex[3, 2] < simplex[1, 2] else 2
        if row == 2 and count < limit:
            row, last = _second_trial(function, task, a, b, simplex)
            count += 1
            for j in range(1, 3 if row == 2 else 1):  # shrinkage
                simplex[j, 0] = simplex[0, 0] + 0.5 * (simplex[j, 0] - simplex[0, 0])
                simplex[j, 1] = simplex[0, 1] + 0.5 * (simplex[j, 1] - simplex[0, 1])
                if count >= limit:
                    break
                simplex[j, 2], last = function(task, a + simplex[j, 0], b + simplex[j, 1])[:2]
                count += 1
        for column in range(3):
            simplex[2, column] = simplex[row, column]


@inline
def _beyond(simplex, far):
    """Return the point on the line from the worst vertex over the middle of the others, at `far` times that way."""
    cx, cy = (simplex[0, 0] + simplex[1, 0]) / 2.0, (simplex[0, 1] + simplex[1, 1]) / 2.0
    return far * cx + (1.0 - far) * simplex[2, 0], far * cy + (1.0 - far) * simplex[2, 1]


@inline
def _second_trial(function, task, a, b, simplex):
    """Try an expansion, outside or inside contraction after the reflection in row 3.

    Returns the row to take for the worst vertex, 2 to shrink, and the second result of the function.
    """
    value, worst = simplex[3, 2], simplex[2, 2]
    far = 3.0 if value < simplex[0, 2] else 1.5 if value < worst else 0.5
    simplex[4, 0], simplex[4, 1] = _beyond(simplex, far)
    simplex[4, 2], last = function(task, a + simplex[4, 0], b + simplex[4, 1])[:2]
    if simplex[4, 2] < (value if far > 1.0 else worst) or (far == 1.5 and simplex[4, 2] == value):
        return 4, last
    return (3 if far == 3.0 else 2), last


@inline
def _sort_vertices(simplex):
    """Sort vertices by value, NaN last; equal values keep their order."""
    for j in range(1, 3):
        while j > 0 and (simplex[j, 2] < simplex[j - 1, 2] or math.isnan(simplex[j - 1, 2])):
            for column in range(3):
                simplex[j, column], simplex[j - 1, column] = simplex[j - 1, column], simplex[j, column]
            j -= 1


@inline
def _levenberg_marquardt(task, ideal_a, ideal_b, n, enough, limit, fit):
    """Improve the slopes of pixel n for one profile; returns the number of evaluations and the flags.

    The normal matrix is damped by a share of its mean diagonal, and by zero while every step succeeds. The search ends
    with a step of at most `enough` [rad], which is still taken.
    """
    a, b, damping, step, tries, outside = ideal_a + fit[0, n], ideal_b + fit[1, n], 0.0, math.inf, 0, False
    best, best_a, best_b, best_gain, normal = math.inf, a, b, 1.0, (0.0, 0.0, 0.0, 0.0, 0.0)
    while tries == 0 or (step > enough and tries < limit):
        merit, gain, outside, trial = _equations(task, a, b)
        if merit <= best:
            best, best_a, best_b, best_gain, normal = merit, a, b, gain, trial
            damping = 0.1 * damping if damping > 1e-6 else 0.0
        else:
            damping = max(10.0 * damping, 1e-3)
        aa, ab, bb, down_a, down_b = normal
        more = 0.5 * damping * (aa + bb)
        aa, bb = aa + more, bb + more
        scale = 1.0 / (aa * bb - ab * ab)
        step_a, step_b = (ab * down_b - bb * down_a) * scale, (ab * down_a - aa * down_b) * scale
        step = abs(step_a) + abs(step_b)  # NaN if either is
        shorter = _FARTHEST / max(step, _FARTHEST)
        a, b, tries = best_a + step_a * shorter, best_b + step_b * shorter, tries + 1
    if not step <= enough:
        a, b = best_a, best_b
    aa, ab, bb, _, _ = normal
    determinant = aa * bb - ab * ab
    fit[0, n], fit[1, n], fit[4, n], fit[5, n] = a - ideal_a, b - ideal_b, best_gain, best
    fit[2, n], fit[3, n] = math.sqrt(bb / determinant), math.sqrt(aa / determinant)
    return tries, (0 if step <= enough else NOT_CONVERGED) + (OUTSIDE if outside else 0)


def solutions(gaze: Floats) -> Floats:
    """Return the least-squares solutions for every set of lit cameras, K from 3 to 8, at m_i = `gaze`, (K, 2) [rad].

    Row s of the result, shape (2^K, 2, K) [1/rad], belongs to the set with bit i of s for camera i: d = row . (eps0_i^2
    - eps_i^2), for any constant c. It is 0 for dark cameras and NaN if the set does not determine d.
    """
    cameras = len(gaze)
    if not 3 <= cameras <= 8:
        raise ValueError("3 to 8 cameras are possible")
    out = np.full((1 << cameras, 2, cameras), math.nan)
    whole = np.sum((gaze - gaze.mean(axis=0)) ** 2)
    for mask in range(len(out)):
        lit = np.array([mask >> i & 1 for i in range(cameras)], bool)
        if np.count_nonzero(lit) >= 3:
            spread = gaze[lit] - gaze[lit].mean(axis=0)
            matrix = spread.T @ spread
            if np.linalg.det(matrix) > 1e-12 * whole**2:
                out[mask] = 0.0
                out[mask][:, lit] = 0.5 * np.linalg.solve(matrix, spread.T)
    return out


def ideal_wavefront(layout: Scene, ideal: Floats) -> Floats:
    """Return the wavefront slopes w_ideal, shape (2, N) [rad], of the ideal mirror by method A with all cameras.

    `ideal` are squares of angles (K, N) by `look_back` [rad^2]. w_ideal is due to the aberrations of a mirror
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
    from `look_back` and `solutions`; `threshold` is the minimum brightness of a lit camera. NaN if fewer than 3
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

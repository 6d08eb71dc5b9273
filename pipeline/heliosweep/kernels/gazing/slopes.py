"""Mirror slopes from images: methods O1 and O2 (Nelder-Mead) and LM (Levenberg-Marquardt), pixel by pixel [1]_.

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
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import Scene
from heliosweep.kernels.gazing.rays import ideal_mirror, mirror_offsets, row_of, unit
from heliosweep.kernels.sun.profiles import Profile, brightness
from heliosweep.kernels.sun.tables import smooth_fit, smoothed

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
    if profile.table.size == 0:
        return [profile]
    first = [smooth_fit(profile)] if profile.table.size > 3 else []
    return [*first, *(smoothed(profile, nodes) for nodes in GRADUATION), profile]


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
        `geometry.transfers` and w_ideal of `linear.ideal_wavefront`.
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
    if method != "LM":
        _search(method == "O1", layout, profile, brightnesses, places, threshold, fit_gain, fit, evaluations, flags)
        return SlopeFit(fit[:2], fit[2:4], fit[4], fit[5], evaluations, flags)
    stages, deviation = graduated(profile) if isinstance(profile, Profile) else list(profile), fit[2:4]
    for n, stage in enumerate(stages):
        enough = _PASSING_STEP if n + 1 < len(stages) else _TABLE_STEP if stage.table.size > 0 else _SMOOTH_STEP
        _levenberg_marquardt(
            layout, stage, brightnesses, places, threshold, fit_gain, enough, limit, fit, evaluations, flags
        )
        if n == 0:  # the steepness of a noisy table differs from the steepness of the sun's disc
            deviation = fit[2:4].copy()
    return SlopeFit(fit[:2], deviation, fit[4], fit[5], evaluations, flags)


@kernel
def look_back(layout: Scene, profile: Profile, pixels: Floats, slopes: Floats) -> Floats:
    """Trace rays from K cameras over mirror slopes p, shape (2, N) [rad], at pixels (y, z), shape (2, N) [m].

    Returns the square of the angle from the disc centre [rad^2], the brightness [1] and its derivatives by p [1/rad],
    shape (4, K, N).
    """
    cameras, number = layout.eyes.shape[0], pixels.shape[1]
    out, sun_y, sun_z = np.empty((4, cameras, number)), row_of(layout.sun_y), row_of(layout.sun_z)
    for n in range(number):
        y, z = pixels[0, n], pixels[1, n]
        x, a, b = ideal_mirror(layout.focal_length, y, z)
        for i in range(cameras):
            rx, ry, rz = unit(layout.eyes[i, 0] - x, layout.eyes[i, 1] - y, layout.eyes[i, 2] - z)
            v, w, va, vb, wa, wb = mirror_offsets(a + slopes[0, n], b + slopes[1, n], rx, ry, rz, sun_y, sun_z)
            out[0, i, n] = v * v + w * w
            out[1, i, n], steepness = brightness(profile, out[0, i, n])
            out[2, i, n], out[3, i, n] = steepness * (v * va + w * wa), steepness * (v * vb + w * wb)
    return out


def residual_squares(seen: Floats, images: Floats, threshold: float, fit_gain: bool) -> Floats:
    """Return the sums of squared residuals over the lit cameras, shape (N,), for brightnesses and images (K, N)."""
    lit = images >= threshold  # False for NaN
    values, bright = np.where(lit, seen, 0.0), np.where(lit, images, 0.0)
    gain = np.sum(values * bright, axis=0) / (_TINY + np.sum(values**2, axis=0)) if fit_gain else 1.0
    return np.asarray(np.sum((gain * values - bright) ** 2, axis=0), np.float64)


@inline
def _lit_cameras(wavefront, layout, images, n, y, z, threshold, rays, bright):
    """Store the rays and images of the lit cameras; returns their number and the slopes of the ideal mirror."""
    x, a, b = (0.0, 0.0, 0.0) if wavefront else ideal_mirror(layout.focal_length, y, z)
    count = 0
    for i in range(images.shape[0]):
        if images[i, n] >= threshold:  # False for NaN
            if wavefront:
                rays[count, 0], rays[count, 1] = layout.gaze[i, 0], layout.gaze[i, 1]
            else:
                rx, ry, rz = unit(layout.eyes[i, 0] - x, layout.eyes[i, 1] - y, layout.eyes[i, 2] - z)
                rays[count, 0], rays[count, 1], rays[count, 2] = rx, ry, rz
            bright[count] = images[i, n]
            count += 1
    return count, a, b


@inline
def _merit(task, a, b):
    """Return the sum of squares at the slopes (a, b) of a wavefront or mirror, and the gain."""
    wavefront, sun_y, sun_z, profile, fit_gain, rays, bright, values, count = task
    product, square = 0.0, _TINY
    for i in range(count):
        if wavefront:
            v, w = a - rays[i, 0], b - rays[i, 1]
        else:
            v, w, _, _, _, _ = mirror_offsets(a, b, rays[i, 0], rays[i, 1], rays[i, 2], sun_y, sun_z)
        values[i] = v * v + w * w
    for i in range(count):
        values[i], _ = brightness(profile, values[i])
        product += values[i] * bright[i]
        square += values[i] * values[i]
    gain, total = product / square if fit_gain else 1.0, 0.0
    for i in range(count):
        rest = gain * values[i] - bright[i]
        total += rest * rest
    return total, gain


@kernel
def _search(
    wavefront: bool,
    layout: Scene,
    profile: Profile,
    images: Floats,
    pixels: Floats,
    threshold: float,
    fit_gain: bool,
    fit: Floats,
    evaluations: Integers,
    flags: Flags,
) -> None:
    """O1 (`wavefront`) or O2 at the pixels (y, z), shape (2, N) [m]; fills the arrays of `_begin`."""
    cameras = images.shape[0]
    rays, bright, values, simplex = np.empty((cameras, 3)), np.empty(cameras), np.empty(cameras), np.empty((3, 3))
    sun_y, sun_z = row_of(layout.sun_y), row_of(layout.sun_z)
    for n in range(images.shape[1]):
        count, a, b = _lit_cameras(wavefront, layout, images, n, pixels[0, n], pixels[1, n], threshold, rays, bright)
        if count < 3:
            fit[:, n], flags[n] = math.nan, UNLIT
            continue
        task = wavefront, sun_y, sun_z, profile, fit_gain, rays, bright, values, count
        for j in range(3):
            simplex[j, 0] = fit[0, n] + (SIMPLEX if j == 1 else 0.0)
            simplex[j, 1] = fit[1, n] + (SIMPLEX if j == 2 else 0.0)
        evaluations[n], fit[4, n] = nelder_mead(_merit, task, a, b, simplex, XATOL, FATOL, LIMIT)
        fit[0, n], fit[1, n], fit[5, n] = simplex[0, 0], simplex[0, 1], simplex[0, 2]
        if evaluations[n] >= LIMIT:
            flags[n] = NOT_CONVERGED


@inline
def nelder_mead(function, task, a, b, simplex, xatol, fatol, limit):
    """Minimise a function of two unknowns, added to (a, b), from three vertices (x, y, value).

    Returns the number of evaluations and the second result of the last one. The search ends if no vertex is further
    than `xatol` from the best in either coordinate and no value further than `fatol`, or at the limit of evaluations.
    The first vertex is the minimum.
    """
    last = 0.0
    for j in range(3):
        simplex[j, 2], last = function(task, a + simplex[j, 0], b + simplex[j, 1])
    count = 3
    _sort_vertices(simplex)
    while count < limit:
        size = max(
            max(abs(simplex[1, 0] - simplex[0, 0]), abs(simplex[1, 1] - simplex[0, 1])),
            max(abs(simplex[2, 0] - simplex[0, 0]), abs(simplex[2, 1] - simplex[0, 1])),
        )
        if size <= xatol and max(abs(simplex[0, 2] - simplex[1, 2]), abs(simplex[0, 2] - simplex[2, 2])) <= fatol:
            break
        cx, cy = (simplex[0, 0] + simplex[1, 0]) / 2.0, (simplex[0, 1] + simplex[1, 1]) / 2.0
        wx, wy, worst = simplex[2, 0], simplex[2, 1], simplex[2, 2]
        x, y = 2.0 * cx - wx, 2.0 * cy - wy
        value, last = function(task, a + x, b + y)
        count += 1
        replaces = simplex[0, 2] <= value < simplex[1, 2]
        if not replaces and count < limit:
            # expansion, outside contraction or inside contraction
            far = 3.0 if value < simplex[0, 2] else 1.5 if value < worst else 0.5
            px, py = far * cx + (1.0 - far) * wx, far * cy + (1.0 - far) * wy
            trial, last = function(task, a + px, b + py)
            count += 1
            replaces = far == 3.0
            if trial < value if far == 3.0 else trial <= value if far == 1.5 else trial < worst:
                x, y, value, replaces = px, py, trial, True
            if not replaces:
                for j in range(1, 3):
                    simplex[j, 0] = simplex[0, 0] + 0.5 * (simplex[j, 0] - simplex[0, 0])
                    simplex[j, 1] = simplex[0, 1] + 0.5 * (simplex[j, 1] - simplex[0, 1])
                    if count >= limit:
                        break
                    simplex[j, 2], last = function(task, a + simplex[j, 0], b + simplex[j, 1])
                    count += 1
        if replaces:
            simplex[2, 0], simplex[2, 1], simplex[2, 2] = x, y, value
        _sort_vertices(simplex)
    return count, last


@inline
def _sort_vertices(simplex):
    """Sort vertices by value, NaN last; equal values keep their order."""
    for j in range(1, 3):
        while j > 0 and (simplex[j, 2] < simplex[j - 1, 2] or math.isnan(simplex[j - 1, 2])):
            for column in range(3):
                simplex[j, column], simplex[j - 1, column] = simplex[j - 1, column], simplex[j, column]
            j -= 1


@kernel
def _levenberg_marquardt(
    layout: Scene,
    profile: Profile,
    images: Floats,
    pixels: Floats,
    threshold: float,
    fit_gain: bool,
    enough: float,
    limit: int,
    fit: Floats,
    evaluations: Integers,
    flags: Flags,
) -> None:
    """Improve the slopes of all pixels (y, z), shape (2, N) [m], for one profile; fills the arrays of `_begin`.

    The normal matrix is damped by a share of its mean diagonal, and by zero while every step succeeds. The search ends
    with a step of at most `enough` [rad], which is still taken.
    """
    cameras = images.shape[0]
    rays, bright, rows = np.empty((cameras, 3)), np.empty(cameras), np.empty((cameras, 3))
    sun_y, sun_z = row_of(layout.sun_y), row_of(layout.sun_z)
    for n in range(images.shape[1]):
        count, ideal_a, ideal_b = _lit_cameras(
            False, layout, images, n, pixels[0, n], pixels[1, n], threshold, rays, bright
        )
        if count < 3:
            fit[:, n], flags[n] = math.nan, UNLIT
            continue
        a, b, damping, step, tries, outside = ideal_a + fit[0, n], ideal_b + fit[1, n], 0.0, math.inf, 0, False
        best, best_a, best_b, best_gain = math.inf, a, b, 1.0
        normal = 0.0, 0.0, 0.0, 0.0, 0.0
        while tries == 0 or (step > enough and tries < limit):
            outside = _trial(a, b, rays, count, sun_y, sun_z, profile, rows)
            merit, gain, trial = _normal_equations(rows, bright, count, fit_gain)
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
        fit[0, n], fit[1, n] = a - ideal_a, b - ideal_b
        fit[2, n], fit[3, n] = math.sqrt(bb / determinant), math.sqrt(aa / determinant)
        fit[4, n], fit[5, n] = best_gain, best
        evaluations[n] += tries
        flags[n] = (0 if step <= enough else NOT_CONVERGED) + (OUTSIDE if outside else 0)


@inline
def _trial(a, b, rays, count, sun_y, sun_z, profile, rows):
    """Store brightness and its derivatives by a and b for each ray; returns True if one is outside the disc."""
    outside = False
    for i in range(count):
        v, w, va, vb, wa, wb = mirror_offsets(a, b, rays[i, 0], rays[i, 1], rays[i, 2], sun_y, sun_z)
        rows[i, 0], rows[i, 1], rows[i, 2] = v * v + w * w, v * va + w * wa, v * vb + w * wb
    for i in range(count):
        outside |= rows[i, 0] > profile.radius * profile.radius
        rows[i, 0], steepness = brightness(profile, rows[i, 0])
        rows[i, 1], rows[i, 2] = steepness * rows[i, 1], steepness * rows[i, 2]
    return outside


@inline
def _normal_equations(rows, bright, count, fit_gain):
    """Return the sum of squares, the gain, and J^T J and J^T r of rows (brightness, derivatives)."""
    gain, along_a, along_b = 1.0, 0.0, 0.0
    if fit_gain:
        product, square = 0.0, _TINY
        for i in range(count):
            product += rows[i, 0] * bright[i]
            square += rows[i, 0] * rows[i, 0]
            along_a += rows[i, 0] * rows[i, 1]
            along_b += rows[i, 0] * rows[i, 2]
        gain, along_a, along_b = product / square, along_a / square, along_b / square
    merit = aa = ab = bb = down_a = down_b = 0.0
    for i in range(count):
        rest = gain * rows[i, 0] - bright[i]
        by_a, by_b = gain * (rows[i, 1] - along_a * rows[i, 0]), gain * (rows[i, 2] - along_b * rows[i, 0])
        merit += rest * rest
        aa, ab, bb = aa + by_a * by_a, ab + by_a * by_b, bb + by_b * by_b
        down_a, down_b = down_a + by_a * rest, down_b + by_b * rest
    return merit, gain, (aa, ab, bb, down_a, down_b)

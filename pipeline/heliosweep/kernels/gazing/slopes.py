"""Mirror slopes from camera images, estimated with methods A, O1, O2 and LM [1]_.

Method A solves a linear least-squares problem. Methods O1 and O2 use the Nelder-Mead simplex search, and method LM uses
the Levenberg-Marquardt algorithm.

In method A, the camera at the angular position m_i sees a point at the angle eps_i from the centre of the sun's disc.
Without mirror aberrations, eps_i^2 = |m_i - w|^2, where w is the wavefront slope. For the ideal mirror, the angle at
this pixel would be eps0_i. The difference between the squared angles is linear in the deviation d = w - w_ideal of the
wavefront slopes: eps_i^2 - eps0_i^2 = -2 m_i.d + c, where c is the same for all cameras. The mirror slopes are p = T d,
with T from `geometry.transfers`. At least 3 lit cameras are required.

Method O1 varies the wavefront slope w to minimise the sum of (g B(|m_i - w|) - I_i)^2 over the lit cameras, where B is
the brightness profile of the sun and I_i is the measured brightness. Methods O2 and LM trace the rays back and vary the
mirror slope p to minimise the sum of (g B(eps_i(p)) - I_i)^2. All three methods start from the result of method A. The
gain g of a pixel is either 1 or fitted together with the slopes. If g is fitted, LM eliminates g by variable projection
[2]_.

The simplex search uses the coefficients of ``scipy.optimize.minimize(method="Nelder-Mead")``: 1 for reflection, 2 for
expansion, and 1/2 for contraction and shrinkage. If two vertices have equal values, the older vertex comes first.

If the profile is a noisy table, the merit function has local minima at the kinks of the table. LM therefore starts with
the analytic curve that fits the table best, then uses the table with decreasing smoothing, and finally the table
itself.

The canting, pointing and focal length of the modules are estimated from the slope maps. A plane, p = c + k (position -
module centre), is fitted to the slopes of each module. The value c at the module's centre is the slope that the
adjustment screws would have to correct. The common gradient k = dp_y/dy = dp_z/dz of all modules gives their focal
length f: k = 1 / 2 f0 - 1 / 2 f, where f0 is the focal length of the ideal mirror. The pointing of the heliostat is the
median of c - k (module centre) over the modules. The estimated pointing is therefore insensitive to a focal length
error and to a few bad modules. The canting of a module, relative to the ideal heliostat, is c minus the pointing.
Modules on a sphere with a different focal length therefore have non-zero canting. A single module is not sufficient to
separate canting from pointing.

The gradients of the two slopes of a module give its symmetric curvature matrix C = I / 2 f0 - K. The diagonal of K
contains dp_y/dy and dp_z/dz. Both off-diagonal elements are the mean of dp_y/dz and dp_z/dy, which are equal on any
smooth surface. The eigenvalues of C are 1 / 2 f for the two principal focal lengths f, and the eigenvectors are the
corresponding directions. On a sphere, the two focal lengths are equal.

References
----------
.. [1] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270
.. [2] L. Kaufman, "A variable projection method for solving separable nonlinear least squares problems", BIT 15 (1975)
   49-57
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import Floats, Integers, inline, inner, kernel
from heliosweep.kernels.gazing.geometry import (
    MirrorGrid,
    Modules,
    Scene,
    ideal_mirror,
    mirror_offsets,
    offsets,
    unit,
)
from heliosweep.kernels.profiles import Profile, brightness, inverse_squares, smooth_fit, smoothed
from heliosweep.kernels.vectors import three

Flags = NDArray[np.uint8]
#: Flags of a pixel. `NOT_CONVERGED`: The search ended before convergence. `UNLIT`: Fewer than 3 cameras are lit.
#: `OUTSIDE`: For the slopes estimated by LM, a lit camera sees a point outside the sun's disc, where the sun profile is
#: extrapolated linearly.
NOT_CONVERGED, UNLIT, OUTSIDE = 1, 2, 4
#: Nelder-Mead settings: side length of the initial simplex [rad], maximum size of the final simplex [rad], maximum
#: range of the merit in the final simplex [1], and maximum number of evaluations.
SIMPLEX, XATOL, FATOL, LIMIT = 0.5e-3, 1e-7, 1e-10, 400
#: Maximum length of an LM step. [rad]
_FARTHEST = 1e-3
_TINY = 1e-60


class SlopeFit(NamedTuple):
    """Slopes at N pixels; NaN if fewer than 3 cameras are lit.

    Attributes
    ----------
    slopes : ndarray, shape (2, N)
        Horizontal and vertical slopes: p relative to the ideal mirror, or wavefront slopes w for O1. [rad]
    deviation : ndarray, shape (2, N)
        Cramer-Rao bound: the standard deviation of the LM slopes for camera noise with a standard deviation of 1. For a
        tabulated profile, the bound is computed from the smooth fit to the table. NaN for O1 and O2. [rad]
    gain, merit : ndarray, shape (N,)
        Gain g, which is 1 unless it is fitted, and minimum sum of squares. [1]
    evaluations : ndarray of int, shape (N,)
        Number of merit function evaluations in all stages.
    flags : ndarray of uint8, shape (N,)
        Sum of the flags that apply: `NOT_CONVERGED`, `UNLIT` and `OUTSIDE`.
    """

    slopes: Floats
    deviation: Floats
    gain: Floats
    merit: Floats
    evaluations: Integers
    flags: Flags


def graduated(profile: Profile) -> list[Profile]:
    """Return the profiles for the LM stages, from smoothest to roughest, ending with `profile`."""
    first = [smooth_fit(profile)] if profile.table.size > 3 else []
    return [*first, *(smoothed(profile, nodes) for nodes in (6.0, 3.0, 1.5, 0.7) if profile.table.size > 0), profile]


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
    """Fit the slopes at all pixels.

    Parameters
    ----------
    method : {'O1', 'O2', 'LM'}
        For O1, the initial and the fitted slopes are wavefront slopes w. The mirror slopes are then T (w - w_ideal),
        with T from `geometry.transfers` and w_ideal from `ideal_wavefront`.
    layout : Scene
        Scene with K cameras.
    profile : Profile or sequence of Profile
        Sun profile, or the profiles for the LM stages from `graduated`.
    images : array_like, shape (K, N)
        Brightness relative to the disc centre. [1]
    start : array_like, shape (2, N)
        Initial slopes, from method A; values that are not finite are replaced by 0. [rad]
    pixels : array_like, shape (2, N)
        Coordinates y and z of the pixels, relative to the mirror centre. [m]
    threshold : float
        Minimum brightness of a lit camera; a camera with NaN brightness is not lit. [1]
    fit_gain : bool
        If True, fit a gain for each pixel, common to all cameras.
    limit : int
        Maximum number of evaluations in each LM stage.

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
        # maximum length of the last step [rad]
        enough = 1e-5 if n + 1 < len(stages) else 1e-8 if stage.table.size > 0 else 1e-11
        kind = method == "O1", method == "LM"
        _fit(*kind, layout, stage, brightnesses, places, threshold, fit_gain, enough, limit, fit, evaluations, flags)
        if n == 0:  # the bound is that of the smooth fit, because noise in a table distorts its gradient
            deviation = fit[2:4].copy()
    return SlopeFit(fit[:2], deviation, fit[4], fit[5], evaluations, flags)


def look_back(layout: Scene, profile: Profile, pixels: Floats, slopes: Floats) -> Floats:
    """Trace rays from K cameras back to the sun.

    `pixels` contains the positions (y, z) of the pixels [m], and `slopes` contains the slopes p [rad], both with shape
    (2, N). The result, shape (4, K, N), contains the squared angle from the disc centre [rad^2], the brightness [1],
    and the derivatives of the brightness with respect to p_y and p_z [1/rad].
    """
    x, a, b = ideal_mirror(layout.focal_length, *pixels)
    v, w, va, vb, wa, wb = offsets(layout, np.stack((x, *pixels)), a + slopes[0], b + slopes[1])
    square = v * v + w * w
    value, steepness = _brightness_of(profile, square.ravel()).reshape(2, *square.shape)
    return np.stack((square, value, steepness * (v * va + w * wa), steepness * (v * vb + w * wb)))


@kernel
def _brightness_of(profile: Profile, squares: Floats) -> Floats:
    """Return the two results of `brightness` at n squared angles, shape (2, n)."""
    out = np.empty((2, squares.size))
    for k in range(squares.size):
        out[0, k], out[1, k] = brightness(profile, squares[k])
    return out


def residual_squares(seen: Floats, images: Floats, threshold: float, fit_gain: bool) -> Floats:
    """Return the sum of squared residuals over the lit cameras at each pixel; `seen` and `images` have shape (K, N)."""
    lit = images >= threshold  # False for NaN
    values, bright = np.where(lit, seen, 0.0), np.where(lit, images, 0.0)
    gain = np.sum(values * bright, axis=0) / (_TINY + np.sum(values**2, axis=0)) if fit_gain else 1.0
    return np.asarray(np.sum((gain * values - bright) ** 2, axis=0), np.float64)


@inner
def _equations(task, a, b):
    """Return the merit, the gain, a flag, J^T J and J^T r at the slopes (a, b).

    The merit is the sum of the squared residuals r, and J is the derivative of r with respect to the slopes. The flag
    is True if a camera looks outside the disc.
    """
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
    """Fit the slopes at all pixels (y, z), shape (2, N) [m], with one profile.

    The method is O1 if `wavefront` is True, LM if `levenberg` is True, and otherwise O2. The rows of `fit` contain two
    slopes [rad], two deviations [rad], the gain and the merit. On entry, `fit` contains the initial slopes.
    """
    cameras = images.shape[0]
    rays, bright, rows, simplex = np.empty((cameras, 3)), np.empty(cameras), np.empty((cameras, 3)), np.empty((5, 3))
    sun_y, sun_z = three(layout.sun_y), three(layout.sun_z)
    for n in range(images.shape[1]):
        y, z, count = pixels[0, n], pixels[1, n], np.int64(0)  # a literal 0 would compile callees twice
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
    """Minimise a function of (a + x, b + y) over x and y, starting from three vertices (x, y, value).

    `simplex` has five rows: three vertices and two trial points. Returns the number of evaluations, and the second
    return value of the last call of `function`. The search ends if all vertices are within `xatol` of the best vertex
    in both coordinates and within `fatol` in value, or if the number of evaluations reaches `limit`. On return, the
    first vertex is the minimum.
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
    """Return the worst vertex moved towards the midpoint of the other two, by `far` times the distance to it."""
    cx, cy = (simplex[0, 0] + simplex[1, 0]) / 2.0, (simplex[0, 1] + simplex[1, 1]) / 2.0
    return far * cx + (1.0 - far) * simplex[2, 0], far * cy + (1.0 - far) * simplex[2, 1]


@inline
def _second_trial(function, task, a, b, simplex):
    """Try an expansion or a contraction (outside or inside) after the reflection in row 3.

    Returns the row that replaces the worst vertex, or 2 for shrinkage, and the second return value of the function.
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
    """Sort vertices by value, with NaN last; equal values keep their order."""
    for j in range(1, 3):
        while j > 0 and (simplex[j, 2] < simplex[j - 1, 2] or math.isnan(simplex[j - 1, 2])):
            for column in range(3):
                simplex[j, column], simplex[j - 1, column] = simplex[j - 1, column], simplex[j, column]
            j -= 1


@inline
def _levenberg_marquardt(task, ideal_a, ideal_b, n, enough, limit, fit):
    """Improve the slopes of pixel n for one profile; return the number of evaluations and the flags.

    The normal matrix is damped by a fraction of its mean diagonal. The damping remains zero as long as no step
    increases the merit. The search ends after a step of at most `enough` [rad].
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
        step = abs(step_a) + abs(step_b)  # NaN if either component is NaN
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
    """Return the least-squares solution of method A for each set of lit cameras.

    `gaze` contains the angular positions m_i of 3 to 8 cameras, shape (K, 2) [rad]. Row s of the result, shape (2^K, 2,
    K) [1/rad], is the solution if camera i is lit for each bit i of s that is set. The deviation is d = row.(eps0_i^2 -
    eps_i^2). The elements of each row sum to 0, so the unknown constant c in the differences between the squared angles
    does not affect d. Elements for dark cameras are 0. A row is NaN if its cameras do not determine d.
    """
    cameras = len(gaze)
    if not 3 <= cameras <= 8:
        raise ValueError("the number of cameras must be between 3 and 8")
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
    """Return the wavefront slopes w_ideal of the ideal mirror, shape (2, N). [rad]

    The slopes are estimated by method A with all cameras. `ideal` contains squared angles from `look_back`, shape
    (K, N) [rad^2]. w_ideal is caused by aberrations at oblique incidence. The wavefront slopes w of a mirror with
    defects are w_ideal plus the deviation d.
    """
    row = solutions(layout.gaze)[-1]
    seen = np.sum(layout.gaze**2, axis=1)[:, np.newaxis] - ideal
    return np.stack([np.sum(row[axis][:, np.newaxis] * seen, axis=0) for axis in (0, 1)])


def wavefront_departures(
    images: Floats, ideal: Floats, rows: Floats, profile: Profile, threshold: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the deviations d of the wavefront slopes, shape (2, N) [rad], and the lit cameras.

    `images`, shape (K, N), contains brightness relative to the disc centre [1], with NaN for excluded pixels. `ideal`
    contains squared angles from `look_back` [rad^2], and `rows` contains the least-squares solutions from `solutions`.
    `threshold` is the minimum brightness of a lit camera. Deviations are NaN if fewer than 3 cameras are lit or the lit
    cameras are collinear. The lit cameras of each pixel are encoded as an integer: bit i is set if camera i is lit.
    """
    lit = images >= threshold  # False for NaN
    masks = np.sum(lit * (1 << np.arange(len(images)))[:, np.newaxis], axis=0)
    change = np.where(lit, ideal - inverse_squares(profile, images), 0.0)
    return np.sum([rows[masks, :, i].T * each for i, each in enumerate(change)], axis=0), masks


def transferred(departures: Floats, matrices: Floats) -> Floats:
    """Return the mirror slopes p = T d, shape (T, 2, N). [rad]

    `departures` contains the deviations d, shape (2, N) [rad]. `matrices` contains the matrices T, shape (T, 2, 2) [1].
    """
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
    """Return the Cramer-Rao bound of the slopes.

    The bound is the minimum standard deviation of unbiased slope estimates from images with camera noise.

    Parameters
    ----------
    layout : Scene
        Scene with K cameras.
    profile : Profile
        Sun profile used in the reconstruction. For a table, the bound is computed from the smooth fit to the table, as
        in `fit_slopes`, because noise in the table distorts the gradient between the nodes.
    pixels : ndarray, shape (2, N)
        Coordinates y and z of the pixels. [m]
    slopes : ndarray, shape (2, N)
        Slopes p relative to the ideal mirror. [rad]
    noise : array_like, shape (), (N,) or (K, N)
        Standard deviation of the normally distributed noise in each image, relative to the disc centre in the image.
        For cameras with a gain, `noise` is the camera noise divided by the gain. Cameras with NaN noise are excluded.
        [1]
    fit_gain : bool
        If True, the slopes are fitted together with a gain for each pixel, common to all cameras.
    lit : ndarray of int, shape (N,), optional
        Lit cameras from `wavefront_departures`; bit i is set if camera i is included (default: all).

    Returns
    -------
    ndarray, shape (2, N)
        Bound from the inverse information matrix of all included cameras that see the disc; NaN if the matrix is
        singular. [rad]
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
        # smaller determinants are rounding errors
        inverse = np.where(determinant > 1e-12 * trace * trace, 1.0 / determinant, np.nan)
        return np.sqrt(np.stack((bb * inverse, aa * inverse)))


#: Number of blocks along each side of a module, used if the errors of neighbouring pixels are correlated.
_BLOCKS = 4
#: Number of random draws for the standard errors of pointing and canting.
#: The standard errors then have a relative random error of 1.6 %.
_DRAWS = 2000


@lru_cache(maxsize=8)
def _draws(modules: int) -> Floats:
    """Return the same standard normal numbers in each call, shape (draws, 2, 2, modules).

    The second axis distinguishes the slope at the module's centre from the curvature, and the third axis distinguishes
    the two directions.
    """
    count = max(_DRAWS * 50 // max(modules, 50), 100)
    half = np.random.Generator(np.random.Philox(0)).standard_normal((count // 2, 2, 2, modules))
    return np.concatenate((half, -half))


def median_errors(away: Floats, variance: Floats, weight: Floats, lever: Floats) -> tuple[Floats, Floats]:
    """Return the standard errors of the pointing, shape (2,), and of the canting, shape (2, M), by random draws.

    `away`, shape (2, M), contains the slopes of the modules minus the slopes of the heliostat's own sphere and minus
    the pointing [rad]. `variance`, shape (2, M, 3), contains the variances and the covariance of the slope at the
    centre and the curvature of each module. `weight` is the weight of each module in the curvature of the heliostat.
    `lever`, shape (2, M), contains the modules' centres [m].
    """
    draws = _draws(away.shape[1])
    spread = np.sqrt(variance[:, :, 0])
    with np.errstate(all="ignore"):
        slant = np.where(spread > 0.0, variance[:, :, 2] / spread, 0.0)
        rest = np.sqrt(np.maximum(variance[:, :, 1] - slant**2, 0.0))
        level = spread * draws[:, 0]
        bend = np.sum(weight * (slant * draws[:, 0] + rest * draws[:, 1]), axis=(1, 2))
        moved = level - bend[:, np.newaxis, np.newaxis] * lever
        # The values in `away` already contain module errors.
        # The part that these errors can explain is removed before new errors are added. Modules within 1.3 standard
        # errors of the pointing are moved to the pointing. The standard errors are then accurate to 10 % for 8 modules.
        share = 1.0 - 1.3**2 * np.mean(moved**2, axis=0) / away**2
    pointing = np.median(away * np.where(share > 0.0, share, 0.0) + moved, axis=2)
    off = pointing - pointing.mean(axis=0)
    return np.sqrt(np.mean(off**2, axis=0)), np.sqrt(np.mean((level - off[:, :, np.newaxis]) ** 2, axis=0))


def module_statistics(
    values: Floats, module: Integers, use: NDArray[np.bool_], count: int
) -> tuple[Floats, Floats, Integers]:
    """Return the mean, the root mean square and the number of usable pixels for each module, all of shape (..., M).

    `values`, shape (..., N), is NaN at pixels without a value. `module` contains the row of each pixel's module, `use`
    is False for excluded pixels, and `count` is the number M of modules. Results are NaN for a module without usable
    pixels.
    """
    rows = values.reshape(-1, values.shape[-1])
    used = [use & ~np.isnan(row) for row in rows]
    number, total, square = (
        np.array([np.bincount(module[keep], row[keep] ** power, count) for row, keep in zip(rows, used, strict=True)])
        for power in (0, 1, 2)
    )
    shape = (*values.shape[:-1], count)
    with np.errstate(all="ignore"):
        mean, rms = total / number, np.sqrt(square / number)
    return mean.reshape(shape), rms.reshape(shape), number.reshape(shape).astype(np.int64)


def module_estimates(
    slopes: Floats,
    grid: MirrorGrid,
    modules: Modules,
    use: NDArray[np.bool_],
    focal_length: float,
    deviation: Floats | None = None,
) -> dict[str, Any]:
    """Estimate the canting, pointing and focal length of a heliostat from its slopes.

    `slopes` contains the slopes p relative to the ideal mirror, shape (2, N) [rad], with NaN at pixels without a value.
    `use`, from `eroded`, is True for the usable pixels of M modules. `focal_length` is the focal length f0 of the ideal
    mirror [m]. `deviation` is the standard deviation of the slope noise, shape (2, N) [rad]. If `deviation` is
    specified, the noise is subtracted from the waviness.

    The standard errors are computed from the scatter of the slopes of each module about the fitted plane. If the
    scatter of neighbouring pixels is correlated, as on a wavy mirror, blocks of one sixteenth of a module are treated
    as independent samples. The pointing is a median over the modules, and its error is also part of the canting error.
    If the slopes of the modules near the median differ strongly, only one or two modules determine this error. Errors
    common to a whole module or heliostat, such as an error in the sun profile, are not included.

    The function returns a dictionary with the following values, which are NaN if too few pixels are usable. An axis of
    length 2 contains the horizontal and the vertical component.

    - `canting`, (2, M): slopes of each module at its centre, minus the pointing. [rad]
    - `pointing`, (2,): median over the modules of the slopes at their centres, relative to the heliostat's own sphere.
      [rad]
    - `focal_length`: focal length f of the modules. [m]
    - `waviness`, (2, M): root mean square of the slopes after subtraction of the fitted plane and the known noise.
      [rad]
    - `principal`, (2, M): principal focal lengths of each module, ordered by increasing curvature; negative if convex.
      [m]
    - `axis`, (M,): direction of the first principal focal length, between -pi/2 and pi/2, measured upwards from
      horizontal (to the right as seen from the target). [rad]
    - `canting_error`, `pointing_error`, `focal_length_error`, `principal_error` and `axis_error`: standard errors. The
      error of the axis is large for a sphere, which has no distinct axis.
    """
    noise = np.zeros_like(slopes) if deviation is None else deviation
    usable, planes = use & ~np.isnan(slopes).any(axis=0), []
    for row, (centre, size) in enumerate(zip(modules.centre, modules.size, strict=True)):
        here = np.flatnonzero(usable & (grid.pixel_module == row))
        planes.append(_plane(slopes[:, here], noise[:, here], grid.pixels[:, here] - centre[:, np.newaxis], size))
    level, along, across, level_variance, variance, covariance, across_variance, waviness, shared = np.moveaxis(
        np.array(planes), 0, -1
    )
    seen = np.isfinite(shared[0])
    # The ratio of the block variance to the variance expected for independent pixels is set to 1 unless it is
    # significantly larger than 1. A fitted plane reduces the degrees of freedom of the blocks by three.
    ratio = np.mean(shared[:, seen], axis=1) if seen.any() else np.ones(2)
    chance = math.sqrt(2.0 / (max(int(np.count_nonzero(seen)), 1) * (_BLOCKS * _BLOCKS - 3.0)))
    inflation = np.where(ratio > 1.0 + 2.0 * chance, ratio, 1.0)[:, np.newaxis]
    level_variance, variance, covariance, across_variance = (
        inflation * each for each in (level_variance, variance, covariance, across_variance)
    )
    good = np.isfinite(along) & np.isfinite(variance)
    certain = not np.all(variance[good] > 0.0)
    with np.errstate(all="ignore"):
        weight = np.where(good, 1.0 if certain else 1.0 / variance, 0.0)  # of the modules in the common gradient
        total = float(np.sum(weight)) or math.nan
        weight = weight / total
    bend = float(np.sum(weight[good] * along[good])) if good.any() else math.nan
    bend_error = 0.0 if certain else 1.0 / math.sqrt(total)
    length = 1.0 / (1.0 / focal_length - 2.0 * bend) if math.isfinite(bend) else math.nan
    pointing, pointing_error = np.full(2, math.nan), np.full(2, math.nan)
    canting_error, known = np.full_like(level, math.nan), np.isfinite(level[0])
    if np.any(known):
        lever = modules.centre.T[:, known]
        own = level[:, known] - bend * lever
        pointing = np.median(own, axis=1)
        pointing_error, canting_error[:, known] = median_errors(
            own - pointing[:, np.newaxis], np.stack((level_variance, variance, covariance), axis=-1)[:, known],
            weight[:, known], lever,
        )  # fmt: skip
    return {
        "canting": level - pointing[:, np.newaxis],
        "canting_error": canting_error,
        "pointing": pointing,
        "pointing_error": pointing_error,
        "focal_length": length,
        "focal_length_error": 2.0 * length * length * bend_error,
        "waviness": waviness,
        **_principal(along, variance, across, across_variance, focal_length),
    }


def _principal(
    along: Floats, along_variance: Floats, across: Floats, across_variance: Floats, focal_length: float
) -> dict[str, Floats]:
    """Return the principal focal lengths and axes of M modules, with standard errors.

    `along` contains dp_y/dy and dp_z/dz, and `across` contains dp_y/dz and dp_z/dy, both with shape (2, M). [1/m]
    """
    yy, zz = 0.5 / focal_length - along
    yz, shear = -0.5 * across.sum(axis=0), 0.25 * across_variance.sum(axis=0)
    mean, half = 0.5 * (yy + zz), np.hypot(0.5 * (yy - zz), yz)
    steep = 0.5 * np.arctan2(yz, 0.5 * (yy - zz))  # direction of maximum curvature
    c, s = np.cos(steep) ** 2, np.sin(steep) ** 2
    with np.errstate(all="ignore"):
        principal = 0.5 / np.stack((mean - half, mean + half))
        errors = [
            u * u * along_variance[0] + v * v * along_variance[1] + 4.0 * u * v * shear for u, v in ((s, c), (c, s))
        ]
        axis = np.where(steep > 0.0, steep - 0.5 * math.pi, steep + 0.5 * math.pi)
        turn = (c * s * along_variance.sum(axis=0) + (c - s) ** 2 * shear) / (4.0 * half**2)
        error = 2.0 * principal**2 * np.sqrt(errors)
    return {"principal": principal, "principal_error": error, "axis": axis, "axis_error": np.sqrt(turn)}


def _plane(slopes: Floats, noise: Floats, offset: Floats, size: Floats) -> Floats:
    """Fit a plane to the horizontal and to the vertical slopes of a module.

    The slopes, their noise and the offsets of the pixels from the module's centre have shape (2, n). Returns nine
    quantities for each slope direction, shape (9, 2), or NaN if there are too few pixels. The first three are the value
    at the centre, and the gradients along and across the slope direction. The next four, computed from the residuals,
    are the variances of the value and of the gradient along, their covariance, and the variance of the gradient across.
    The last two are the root mean square residual after subtraction of known noise, and the squared sums of the
    residuals over blocks, relative to the value expected for independent pixels.
    """
    n = offset.shape[1]
    mean = offset.sum(axis=1) / max(n, 1)
    spread = offset - mean[:, np.newaxis]
    matrix = spread @ spread.T
    if n < 2 * _BLOCKS or not np.linalg.det(matrix) > 1e-9 * np.trace(matrix) ** 2:
        return np.full((9, 2), math.nan)
    gradients = np.linalg.solve(matrix, spread)  # weights of the pixels in the two gradients
    level = 1.0 / n - mean @ gradients  # weights of the pixels in the value at the centre
    value, plane = slopes @ level, slopes @ gradients.T
    rest = slopes - value[:, np.newaxis] - plane @ offset
    square, scatter = rest**2, (rest**2).sum(axis=1)
    products = level**2, gradients**2, gradients * level, gradients[::-1] ** 2
    variances = [n / (n - 3.0) * np.sum(square * each, axis=1) for each in products]
    column, row = np.clip((offset / size[:, np.newaxis] + 0.5) * _BLOCKS, 0, _BLOCKS - 1).astype(int)
    member = row * _BLOCKS + column == np.arange(_BLOCKS**2)[:, np.newaxis]
    inside, moment = member.sum(axis=1), member @ spread.T
    alone = n - np.sum(inside**2) / n - np.sum(moment.T * np.linalg.solve(matrix, moment.T))
    unit, blocks = alone * scatter / (n - 3.0), np.sum((rest @ member.T) ** 2, axis=1)
    shared = np.where(unit > 0.0, blocks / np.where(unit > 0.0, unit, 1.0), 1.0)
    waviness = np.sqrt(np.maximum(scatter / (n - 3) - np.sum(noise**2, axis=1) / n, 0.0))
    return np.array([value, np.diag(plane), plane[(0, 1), (1, 0)], *variances, waviness, shared])

"""Canting, pointing and focal length of the modules from maps of slopes, with standard errors; statistics of maps.

Over each module the slopes are fitted by a plane, p = c + k (position - module centre). Its value at the module's
centre is what its screws would have to undo. The curvature k = dp/dy = dp/dz of all modules together gives their own
focal length: k = 1 / 2 f0 - 1 / 2 f. The pointing of the heliostat is the median over the modules of c - k (module
centre), which is against the heliostat's own sphere: a focal length that is not the ideal one does not move it, nor do
a few bad modules. Canting is c less the pointing, against the ideal heliostat: modules on a sphere of another focal
length are canted too. A single slope cannot separate canting and pointing.

The gradients of both slopes of a module are its own curvature: the symmetric matrix C = I / 2 f0 - K with K of dp_y/dy
and dp_z/dz, and with the mean of dp_y/dz and dp_z/dy, which are equal on any surface, off the diagonal. Its eigenvalues
are 1 / 2 f of the two principal focal lengths, its eigenvectors their directions; they are the same on a sphere.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.gazing.geometry import MirrorGrid, Modules

#: Blocks along each side of a module for errors that neighbouring pixels share.
_BLOCKS = 4
#: Pixels of a module below which nothing is fitted.
_FEW = 2 * _BLOCKS
#: Draws behind the standard errors of pointing and canting; they leave 1.6 % of them to chance.
_DRAWS = 2000
#: Modules nearer to the pointing than this many standard errors are taken to be at it. Stated errors are those found
#: where the modules are at one place or far apart; if their true slopes lie one or two errors apart, they are right
#: within a tenth for eight modules, a third for three.
_NEAR = 1.3


@lru_cache(maxsize=8)
def _draws(modules: int) -> Floats:
    """Normal numbers, the same at every call, shape (draws, 2 for level and curvature, 2 directions, modules)."""
    count = max(_DRAWS * 50 // max(modules, 50), 100)
    half = np.random.Generator(np.random.Philox(0)).standard_normal((count // 2, 2, 2, modules))
    return np.concatenate((half, -half))


def median_errors(away: Floats, variance: Floats, weight: Floats, lever: Floats) -> tuple[Floats, Floats]:
    """Standard errors of pointing (2,) and canting (2, M), by drawing the errors of the modules.

    Parameters are the slopes of the modules minus the slopes of the heliostat's own sphere and the pointing [rad],
    variances of level and curvature and their covariance (2, M, 3), the weight of each curvature in the curvature of
    the heliostat, and the modules' centres (2, M) [m].
    """
    draws = _draws(away.shape[1])
    spread = np.sqrt(variance[:, :, 0])
    with np.errstate(all="ignore"):
        slant = np.where(spread > 0.0, variance[:, :, 2] / spread, 0.0)
        rest = np.sqrt(np.maximum(variance[:, :, 1] - slant**2, 0.0))
        level = spread * draws[:, 0]
        bend = np.sum(weight * (slant * draws[:, 0] + rest * draws[:, 1]), axis=(1, 2))
        moved = level - bend[:, np.newaxis, np.newaxis] * lever
        # The distances scatter already: distances explained by errors alone are removed before the draws.
        share = 1.0 - _NEAR**2 * np.mean(moved**2, axis=0) / away**2
    pointing = np.median(away * np.where(share > 0.0, share, 0.0) + moved, axis=2)
    off = pointing - pointing.mean(axis=0)
    return np.sqrt(np.mean(off**2, axis=0)), np.sqrt(np.mean((level - off[:, :, np.newaxis]) ** 2, axis=0))


def module_statistics(
    values: Floats, module: Integers, use: NDArray[np.bool_], count: int
) -> tuple[Floats, Floats, Integers]:
    """Return the mean, the root mean square and the number of usable pixels over the modules, shape (..., M) each.

    `values` (..., N) are NaN if unknown, `module` is the row of each pixel's module, `use` is False for pixels not to
    use, M = `count`. NaN for a module without usable pixels.
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
    """Canting, pointing and focal length from slopes p relative to the ideal mirror (2, N), NaN if unknown. [rad]

    `use` marks the pixels of M modules, from `eroded`; f0 belongs to the ideal mirror [m]. The standard deviation of
    the noise of each slope (2, N) [rad], if known, is subtracted from the waviness.

    Standard errors follow from the scatter of each module about its plane. If neighbouring pixels share their scatter,
    as on a wavy mirror, blocks of a sixteenth of a module are counted. Errors of pointing and canting are the errors of
    the median: if the modules that decide it are far apart, it has the errors of one or two of them. An error common to
    a whole module or heliostat, such as an error of the sun profile, is not included.

    Returns, NaN if too few pixels are usable, and horizontal and vertical with an axis of 2:

    - `canting`, (2, M): slopes of each module at its centre, less the pointing. [rad]
    - `pointing`, (2,): median of the modules' slopes at their centres relative to the heliostat's own sphere. [rad]
    - `focal_length`: f of the modules. [m]
    - `waviness`, (2, M): root mean square of the slopes less the plane, less known noise. [rad]
    - `principal`, (2, M): principal focal lengths of each module, of the minimum curvature first, negative if convex.
      [m]
    - `axis`, (M,): direction of the first, from horizontal, right as seen from the target, towards up; -pi/2 to pi/2.
      [rad]
    - `canting_error`, `pointing_error`, `focal_length_error`, `principal_error` and `axis_error`: standard errors. The
      error of the axis is large for a sphere, which has no axis.
    """
    noise = np.zeros_like(slopes) if deviation is None else deviation
    usable, planes = use & ~np.isnan(slopes).any(axis=0), []
    for row, (centre, size) in enumerate(zip(modules.centre, modules.size, strict=True)):
        here = np.flatnonzero(usable & (grid.pixel_module == row))
        planes.append(_plane(slopes[:, here], noise[:, here], grid.pixels[:, here] - centre[:, np.newaxis], size))
    level, along, across, level_variance, variance, covariance, across_variance, waviness, shared = np.moveaxis(
        np.array(planes), 0, -1
    )
    inflation = _inflation(shared)[:, np.newaxis]
    level_variance, variance, covariance, across_variance = (
        inflation * each for each in (level_variance, variance, covariance, across_variance)
    )
    weight, bend, bend_error = _pooled(along, variance)
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
    """Principal focal lengths of modules and their axes, with standard errors, from gradients (2, M) of both slopes.

    Along their own direction, dp_y/dy and dp_z/dz, and across it, dp_y/dz and dp_z/dy. [1/m]
    """
    yy, zz = 0.5 / focal_length - along
    yz, shear = -0.5 * across.sum(axis=0), 0.25 * across_variance.sum(axis=0)
    mean, half = 0.5 * (yy + zz), np.hypot(0.5 * (yy - zz), yz)
    steep = 0.5 * np.arctan2(yz, 0.5 * (yy - zz))  # direction of the greatest curvature
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


def _inflation(shared: Floats) -> Floats:
    """Return the variance of blocks relative to independent pixels, by direction; 1 unless beyond chance."""
    seen = np.isfinite(shared[0])
    if not np.any(seen):
        return np.ones(2)
    ratio = np.mean(shared[:, seen], axis=1)
    # A plane fitted to the blocks leaves three fewer parts of their variance.
    chance = math.sqrt(2.0 / (np.count_nonzero(seen) * (_BLOCKS * _BLOCKS - 3.0)))
    return np.where(ratio > 1.0 + 2.0 * chance, ratio, 1.0)


def _pooled(values: Floats, variances: Floats) -> tuple[Floats, float, float]:
    """Weights by variances of independent values, their mean, its standard error; equal if one variance is 0."""
    weight = np.zeros_like(values)
    good = np.isfinite(values) & np.isfinite(variances)
    if not np.any(good):
        return weight, math.nan, math.nan
    certain = not np.all(variances[good] > 0.0)
    weight[good] = 1.0 if certain else 1.0 / variances[good]
    total = float(np.sum(weight))
    weight /= total
    return weight, float(np.sum(weight[good] * values[good])), 0.0 if certain else 1.0 / math.sqrt(total)


def _plane(slopes: Floats, noise: Floats, offset: Floats, size: Floats) -> Floats:
    """Fit planes to the slopes of a module, with known noise, at offsets from its centre, all (2, n).

    Returns by quantity and direction, shape (9, 2), NaN for too few pixels: value at the centre, gradients along and
    across the own direction; variances of value and gradient along, their covariance and the variance across, from the
    residuals; root mean square of the residuals minus known noise; squared sums of the residuals of blocks relative to
    independent pixels.
    """
    n = offset.shape[1]
    mean = offset.sum(axis=1) / max(n, 1)
    spread = offset - mean[:, np.newaxis]
    matrix = spread @ spread.T
    if n < _FEW or not np.linalg.det(matrix) > 1e-9 * np.trace(matrix) ** 2:
        return np.full((9, 2), math.nan)
    gradients = np.linalg.solve(matrix, spread)  # weight of each pixel in the two gradients
    level = 1.0 / n - mean @ gradients  # and in the value at the centre
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

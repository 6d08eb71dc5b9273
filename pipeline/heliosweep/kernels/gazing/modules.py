"""Canting, pointing and focal length of the modules from maps of slopes, with standard errors; statistics of maps.

Over each module the slopes are fitted by a plane, p = c + k (position - module centre). Its value at the module's
centre is what its screws would have to undo. The curvature k = dp/dy = dp/dz of all modules together gives their own
focal length: k = 1 / 2 f0 - 1 / 2 f. The pointing of the heliostat is the median over the modules of c - k (module
centre), which is against the heliostat's own sphere: a focal length that is not the ideal one does not move it, nor do
a few bad modules. Canting is c less the pointing, against the ideal heliostat: modules on a sphere of another focal
length are canted too. One slope alone cannot tell canting and pointing apart.

The gradients of both slopes of a module are its own curvature: the symmetric matrix C = I / 2 f0 - K with K of dp_y/dy
and dp_z/dz, and the mean of dp_y/dz and dp_z/dy beside the diagonal, which are equal on any surface. Its eigenvalues
are 1 / 2 f of the two principal focal lengths, its eigenvectors their directions; they are the same on a sphere.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.gazing.geometry import MirrorGrid, Modules

_BLOCKS = 4
"""Blocks along each side of a module for what neighbouring pixels share."""
_FEW = 2 * _BLOCKS
"""Pixels of a module below which nothing is fitted."""
_DRAWS = 2000
"""Draws behind the standard errors of pointing and canting; they leave 1.6 % of them to chance."""
_NEAR = 1.3
"""Modules nearer to the pointing than this many standard errors are taken to be at it. Stated errors are those found
where the modules are at one place or far apart; if their true slopes lie one or two errors apart, they are right within
a tenth for eight modules, a third for three."""


@lru_cache(maxsize=8)
def _draws(modules: int) -> Floats:
    """Normal numbers, the same at every call, shape (draws, 2 for level and curvature, 2 directions, modules)."""
    count = max(_DRAWS * 50 // max(modules, 50), 100)
    half = np.random.Generator(np.random.Philox(0)).standard_normal((count // 2, 2, 2, modules))
    return np.concatenate((half, -half))


def median_errors(away: Floats, variance: Floats, weight: Floats, lever: Floats) -> tuple[Floats, Floats]:
    """Standard errors of pointing (2,) and canting (2, M), by drawing the errors of the modules.

    From the slopes of the modules less those of their own sphere and the pointing [rad], variances of level and
    curvature and their covariance (2, M, 3), the weight of each curvature in that of the heliostat, and the modules'
    centres (2, M) [m].
    """
    draws = _draws(away.shape[1])
    spread = np.sqrt(variance[:, :, 0])
    with np.errstate(all="ignore"):
        slant = np.where(spread > 0.0, variance[:, :, 2] / spread, 0.0)
        rest = np.sqrt(np.maximum(variance[:, :, 1] - slant**2, 0.0))
        level = spread * draws[:, 0]
        bend = np.sum(weight * (slant * draws[:, 0] + rest * draws[:, 1]), axis=(1, 2))
        moved = level - bend[:, np.newaxis, np.newaxis] * lever
        # The found distances are scattered once: those that errors alone explain are removed before the draws.
        share = 1.0 - _NEAR**2 * np.mean(moved**2, axis=0) / away**2
    pointing = np.median(away * np.where(share > 0.0, share, 0.0) + moved, axis=2)
    off = pointing - pointing.mean(axis=0)
    return np.sqrt(np.mean(off**2, axis=0)), np.sqrt(np.mean((level - off[:, :, np.newaxis]) ** 2, axis=0))


class ModuleEstimates(NamedTuple):
    """Estimates from a slope map, NaN where too few pixels are usable; directions are horizontal, vertical."""

    canting: Floats
    """Slopes of each module at its centre, less the pointing, shape (2, M). [rad]"""
    canting_error: Floats
    """Their standard errors, shape (2, M). [rad]"""
    pointing: Floats
    """Median of the modules' slopes at their centres, less those of the heliostat's own sphere, shape (2,). [rad]"""
    pointing_error: Floats
    """Their standard errors, shape (2,). [rad]"""
    focal_length: float
    """f of the modules. [m]"""
    focal_length_error: float
    """Its standard error. [m]"""
    waviness: Floats
    """Root mean square of what the plane leaves of the slopes, less known noise, shape (2, M). [rad]"""
    pixels: NDArray[np.int64]
    """Usable pixels of each module, shape (M,)."""
    principal: Floats
    """Principal focal lengths of each module, that of the least curvature first, negative where it is convex, (2, M).
    [m]"""
    principal_error: Floats
    """Their standard errors, shape (2, M). [m]"""
    axis: Floats
    """Direction of the first, from horizontal, right as seen from the target, towards up; -pi/2 to pi/2, (M,). [rad]"""
    axis_error: Floats
    """Its standard error, without meaning where it is large: a sphere has no axis, shape (M,). [rad]"""


def module_statistics(
    values: Floats, module: NDArray[np.int64], use: NDArray[np.bool_], count: int
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return the mean, the root mean square and the number of usable pixels over the modules, shape (C, M) each.

    `values` (C, N) are NaN if unknown, `module` is the row of each pixel's module, `use` is False for pixels not to
    use, M = `count`. NaN for a module without usable pixels.
    """
    used = [use & ~np.isnan(row) for row in values]
    number = np.array([np.bincount(module[keep], minlength=count) for keep in used])
    pairs = list(zip(values, used, strict=True))
    total = np.array([np.bincount(module[keep], row[keep], count) for row, keep in pairs])
    square = np.array([np.bincount(module[keep], row[keep] ** 2, count) for row, keep in pairs])
    with np.errstate(all="ignore"):
        return total / number, np.sqrt(square / number), number


def module_estimates(
    slopes: Floats,
    grid: MirrorGrid,
    modules: Modules,
    use: NDArray[np.bool_],
    focal_length: float,
    deviation: Floats | None = None,
) -> ModuleEstimates:
    """Canting, pointing and focal length from slopes p relative to the ideal mirror (2, N), NaN where unknown. [rad]

    Of N pixels on M modules, those that `use` marks, from `eroded`; f0 of the ideal mirror [m]; and where it is known
    the standard deviation of the noise of each slope (2, N) [rad], which is taken out of the waviness.

    Standard errors are those of each module's scatter about its plane. Where neighbouring pixels share their scatter,
    as those of a wavy mirror do, it counts by blocks of a sixteenth of a module. Those of pointing and canting are what
    the median makes of the modules' errors: if the modules that decide it are far apart, it has the errors of one or
    two of them. An error common to a whole module or heliostat, of the sun profile for instance, does not show in them.
    """
    noise = np.zeros_like(slopes) if deviation is None else deviation
    fit, variance, across, scatter, known, shared, number = _fitted(
        slopes, noise, np.array([grid.pixel_y, grid.pixel_z]), grid.pixel_module, use, modules
    )
    seen = number >= _FEW
    with np.errstate(all="ignore"):
        inflation = _inflation(shared, seen)
        variance *= inflation[:, np.newaxis, np.newaxis]
        left = np.where(seen, scatter / np.maximum(number - 3, 1) - known / np.maximum(number, 1), math.nan)
    weight, bend, bend_error = _pooled(fit[:, :, 1], variance[:, :, 1])
    length = 1.0 / (1.0 / focal_length - 2.0 * bend) if math.isfinite(bend) else math.nan
    level, usable = fit[:, :, 0], np.isfinite(fit[0, :, 0])
    pointing, pointing_error = np.full(2, math.nan), np.full(2, math.nan)
    canting_error = np.full_like(level, math.nan)
    if np.any(usable):
        own, lever = level - bend * modules.centre.T, modules.centre.T[:, usable]
        pointing = np.median(own[:, usable], axis=1)
        away = own[:, usable] - pointing[:, np.newaxis]
        pointing_error, canting_error[:, usable] = median_errors(away, variance[:, usable], weight[:, usable], lever)
    return ModuleEstimates(
        level - pointing[:, np.newaxis],
        canting_error,
        pointing,
        pointing_error,
        length,
        2.0 * length * length * bend_error,
        np.sqrt(np.maximum(left, 0.0)),
        number,
        *_principal(
            fit[:, :, 1], variance[:, :, 1], across[:, :, 0], across[:, :, 1] * inflation[:, np.newaxis], focal_length
        ),
    )


def _principal(
    along: Floats, along_variance: Floats, across: Floats, across_variance: Floats, focal_length: float
) -> tuple[Floats, Floats, Floats, Floats]:
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
    return principal, 2.0 * principal**2 * np.sqrt(errors), axis, np.sqrt(turn)


def _inflation(shared: Floats, seen: NDArray[np.bool_]) -> Floats:
    """By how much blocks scatter more than their pixels, by direction, shape (2,); 1 unless it is more than chance."""
    modules = int(np.count_nonzero(seen))
    if modules == 0:
        return np.ones(2)
    ratio = np.mean(np.where(np.isfinite(shared[:, seen]), shared[:, seen], 1.0), axis=1)
    # A plane fitted to the blocks leaves three fewer parts of their variance.
    chance = math.sqrt(2.0 / (modules * (_BLOCKS * _BLOCKS - 3.0)))
    return np.where(ratio > 1.0 + 2.0 * chance, ratio, 1.0)


def _pooled(values: Floats, variances: Floats) -> tuple[Floats, float, float]:
    """Weights by their variances of independent values, their mean, its standard error; equal where one is certain."""
    weight = np.zeros_like(values)
    good = np.isfinite(values) & np.isfinite(variances)
    if not np.any(good):
        return weight, math.nan, math.nan
    certain = not np.all(variances[good] > 0.0)
    weight[good] = 1.0 if certain else 1.0 / variances[good]
    total = float(np.sum(weight))
    weight /= total
    return weight, float(np.sum(weight[good] * values[good])), 0.0 if certain else 1.0 / math.sqrt(total)


def _fitted(
    slopes: Floats,
    noise: Floats,
    position: Floats,
    module: NDArray[np.int64],
    use: NDArray[np.bool_],
    modules: Modules,
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats, NDArray[np.int64]]:
    """Fit planes to the slopes of each module.

    Returns, by direction and module: (value at the centre, curvature along the own direction), (their variances and
    covariance, from the residuals), (gradient across the own direction, its variance), the squared residuals, the
    squared noise, the squared sums of the residuals of each block relative to those of independent pixels; and the
    number of pixels of each module.
    """
    count = len(modules.centre)
    fit, variance, across = (np.full((2, count, columns), math.nan) for columns in (2, 3, 2))
    scatter, known, shared = np.full((2, count), math.nan), np.zeros((2, count)), np.zeros((2, count))
    number = np.zeros(count, np.int64)
    usable = use & ~np.isnan(slopes).any(axis=0)
    for m in range(count):
        pixels = np.flatnonzero(usable & (module == m))
        number[m] = n = len(pixels)
        known[:, m] = np.sum(noise[:, pixels] ** 2, axis=1)
        if n < _FEW:
            continue
        offset = position[:, pixels] - modules.centre[m][:, np.newaxis]
        mean = offset.mean(axis=1)
        spread = offset - mean[:, np.newaxis]
        matrix = spread @ spread.T
        if not np.linalg.det(matrix) > 1e-9 * np.trace(matrix) ** 2:
            continue
        gradients = np.linalg.solve(matrix, spread)  # weight of each pixel in the two gradients
        level = 1.0 / n - mean @ gradients  # and in the value at the centre
        value, plane = slopes[:, pixels] @ level, slopes[:, pixels] @ gradients.T
        rest = slopes[:, pixels] - value[:, np.newaxis] - plane @ offset
        square, factor = rest**2, n / (n - 3.0)
        fit[:, m, 0], fit[:, m, 1] = value, np.diag(plane)
        variance[:, m, 0] = factor * square @ level**2
        variance[:, m, 1] = factor * np.sum(square * gradients**2, axis=1)
        variance[:, m, 2] = factor * np.sum(square * gradients * level, axis=1)
        across[:, m, 0], across[:, m, 1] = plane[(0, 1), (1, 0)], factor * np.sum(square * gradients[::-1] ** 2, axis=1)
        scatter[:, m] = square.sum(axis=1)
        column, row = np.clip((offset / modules.size[m][:, np.newaxis] + 0.5) * _BLOCKS, 0, _BLOCKS - 1).astype(int)
        member = row * _BLOCKS + column == np.arange(_BLOCKS**2)[:, np.newaxis]
        inside, moment = member.sum(axis=1), member @ spread.T
        alone = n - np.sum(inside**2) / n - np.sum(moment.T * np.linalg.solve(matrix, moment.T))
        unit = alone * scatter[:, m] / (n - 3.0)
        shared[:, m] = np.where(
            unit > 0.0, np.sum((rest @ member.T) ** 2, axis=1) / np.where(unit > 0.0, unit, 1.0), 1.0
        )
    return fit, variance, across, scatter, known, shared, number

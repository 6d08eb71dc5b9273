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
from heliosweep.kernels.compiled import kernel
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
    return _median_errors(draws, spread, slant, rest, away, weight, np.ascontiguousarray(lever))


@kernel
def _median_errors(draws, spread, slant, rest, away, weight, lever):
    """The same from standard deviations of levels and of curvatures, what they share and what is their own."""
    count, modules = draws.shape[0], draws.shape[3]
    moved, kept = np.empty((count, 2, modules)), np.zeros((2, modules))
    for d in range(count):
        bend = 0.0
        for i in range(2):
            for m in range(modules):
                bend += weight[i, m] * (slant[i, m] * draws[d, 0, i, m] + rest[i, m] * draws[d, 1, i, m])
        for i in range(2):
            for m in range(modules):
                moved[d, i, m] = spread[i, m] * draws[d, 0, i, m] - bend * lever[i, m]
                kept[i, m] += moved[d, i, m] * moved[d, i, m]
    # What is found is scattered once already: distances that errors alone make are taken out before they are drawn.
    for i in range(2):
        for m in range(modules):
            share = 1.0 - _NEAR * _NEAR * (kept[i, m] / count) / (away[i, m] * away[i, m])
            kept[i, m] = share if share > 0.0 else 0.0
    pointing, mean, row = np.empty((count, 2)), np.zeros(2), np.empty(modules)
    for d in range(count):
        for i in range(2):
            total = 0.0
            for m in range(modules):  # put in order as they come: they are few
                value, place = away[i, m] * kept[i, m] + moved[d, i, m], m
                total += value
                while place > 0 and row[place - 1] > value:
                    row[place] = row[place - 1]
                    place -= 1
                row[place] = value
            middle = 0.5 * (row[(modules - 1) // 2] + row[modules // 2])
            pointing[d, i] = math.nan if math.isnan(total) else middle
            mean[i] += pointing[d, i]
    errors, canting = np.zeros(2), np.zeros((2, modules))
    for d in range(count):
        for i in range(2):
            off = pointing[d, i] - mean[i] / count
            errors[i] += off * off
            for m in range(modules):
                canting[i, m] += (spread[i, m] * draws[d, 0, i, m] - off) ** 2
    return np.sqrt(errors / count), np.sqrt(canting / count)


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


@kernel
def module_statistics(
    values: Floats, module: NDArray[np.int64], use: NDArray[np.bool_], count: int
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Mean and root mean square over the modules, each summed in the order of its pixels, and the number of these.

    Of values (C, N), NaN where there is none; with the row of each pixel's module and whether it counts (erosion leaves
    it), shape (N,). Results have the shape (C, M) of C values and M = `count` modules; NaN for a module without any.
    """
    rows, pixels = values.shape
    total, square, number = np.zeros((rows, count)), np.zeros((rows, count)), np.zeros((rows, count), np.int64)
    for c in range(rows):
        for k in range(pixels):
            if use[k] and not math.isnan(values[c, k]):
                total[c, module[k]] += values[c, k]
                square[c, module[k]] += values[c, k] * values[c, k]
                number[c, module[k]] += 1
    for c in range(rows):
        for m in range(count):
            n = number[c, m]
            total[c, m] = total[c, m] / n if n > 0 else math.nan
            square[c, m] = math.sqrt(square[c, m] / n) if n > 0 else math.nan
    return total, square, number


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
    slopes = np.ascontiguousarray(slopes)
    noise = np.zeros_like(slopes) if deviation is None else np.ascontiguousarray(deviation)
    fit, variance, across, scatter, known, shared, number = _fitted(
        slopes, noise, grid.pixel_y, grid.pixel_z, grid.pixel_module, use, modules.centre, modules.size
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


@kernel
def _fitted(
    slopes: Floats,
    noise: Floats,
    y: Floats,
    z: Floats,
    module: NDArray[np.int64],
    use: NDArray[np.bool_],
    centre: Floats,
    size: Floats,
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats, NDArray[np.int64]]:
    """Planes through the slopes of each module.

    Returns, by direction and module: (value at the centre, curvature along the own direction), (their variances and
    covariance, from the residuals), (gradient across the own direction, its variance), the squared residuals, the
    squared noise, the squared sums of the residuals of each block relative to what pixels without anything in common
    would give; and the pixels of each module.
    """
    modules, pixels = len(centre), y.size
    fit, variance = np.full((2, modules, 2), math.nan), np.full((2, modules, 3), math.nan)
    across = np.full((2, modules, 2), math.nan)
    number = np.zeros(modules, np.int64)
    scatter, known, shared = np.zeros((2, modules)), np.zeros((2, modules)), np.zeros((2, modules))
    sums = np.zeros((modules, 5))
    right = np.zeros((2, modules, 3))
    plane = np.zeros((2, modules, 3))
    shape = np.full((modules, 5), math.nan)
    for k in range(pixels):
        if not use[k] or math.isnan(slopes[0, k]) or math.isnan(slopes[1, k]):
            continue
        m = module[k]
        dy, dz = y[k] - centre[m, 0], z[k] - centre[m, 1]
        number[m] += 1
        sums[m, 0] += dy
        sums[m, 1] += dz
        sums[m, 2] += dy * dy
        sums[m, 3] += dy * dz
        sums[m, 4] += dz * dz
        for d in range(2):
            right[d, m, 0] += slopes[d, k]
            right[d, m, 1] += slopes[d, k] * dy
            right[d, m, 2] += slopes[d, k] * dz
            known[d, m] += noise[d, k] * noise[d, k]
    for m in range(modules):
        n = number[m]
        if n < _FEW:
            continue
        my, mz = sums[m, 0] / n, sums[m, 1] / n
        yy, yz, zz = sums[m, 2] - n * my * my, sums[m, 3] - n * my * mz, sums[m, 4] - n * mz * mz
        determinant = yy * zz - yz * yz
        if not determinant > 1e-9 * (yy + zz) * (yy + zz):
            continue
        shape[m, 0], shape[m, 1] = my, mz
        shape[m, 2], shape[m, 3], shape[m, 4] = zz / determinant, yz / determinant, yy / determinant
        variance[:, m] = 0.0
        for d in range(2):
            mean = right[d, m, 0] / n
            py, pz = right[d, m, 1] - n * my * mean, right[d, m, 2] - n * mz * mean
            ky, kz = (zz * py - yz * pz) / determinant, (yy * pz - yz * py) / determinant
            plane[d, m, 0], plane[d, m, 1], plane[d, m, 2] = mean - ky * my - kz * mz, ky, kz
            fit[d, m, 0], fit[d, m, 1] = plane[d, m, 0], plane[d, m, 1 + d]
            across[d, m, 0], across[d, m, 1] = plane[d, m, 2 - d], 0.0
    blocks, held = np.zeros((2, modules, _BLOCKS, _BLOCKS)), np.zeros((modules, _BLOCKS, _BLOCKS, 3))
    for k in range(pixels):
        m = module[k]
        if not use[k] or math.isnan(slopes[0, k]) or math.isnan(slopes[1, k]) or math.isnan(shape[m, 0]):
            continue
        dy, dz = y[k] - centre[m, 0], z[k] - centre[m, 1]
        column = min(max(int((dy / size[m, 0] + 0.5) * _BLOCKS), 0), _BLOCKS - 1)
        row = min(max(int((dz / size[m, 1] + 0.5) * _BLOCKS), 0), _BLOCKS - 1)
        ay, az = dy - shape[m, 0], dz - shape[m, 1]
        held[m, row, column, 0] += 1.0
        held[m, row, column, 1] += ay
        held[m, row, column, 2] += az
        # What this pixel's slope weighs in the two curvatures and in the value at the centre.
        wy, wz = shape[m, 2] * ay - shape[m, 3] * az, shape[m, 4] * az - shape[m, 3] * ay
        level = 1.0 / number[m] - shape[m, 0] * wy - shape[m, 1] * wz
        for d in range(2):
            rest = slopes[d, k] - plane[d, m, 0] - plane[d, m, 1] * dy - plane[d, m, 2] * dz
            square, along, aside = rest * rest, wy if d == 0 else wz, wz if d == 0 else wy
            scatter[d, m] += square
            blocks[d, m, row, column] += rest
            variance[d, m, 0] += level * level * square
            variance[d, m, 1] += along * along * square
            variance[d, m, 2] += level * along * square
            across[d, m, 1] += aside * aside * square
    for m in range(modules):
        n = number[m]
        alone = 0.0
        for row in range(_BLOCKS):
            for column in range(_BLOCKS):
                count, ay, az = held[m, row, column]
                alone += count - count * count / max(n, 1)
                alone -= shape[m, 2] * ay * ay - 2.0 * shape[m, 3] * ay * az + shape[m, 4] * az * az
        for d in range(2):
            if math.isnan(shape[m, 0]):
                scatter[d, m] = math.nan
                continue
            variance[d, m] *= n / (n - 3.0)
            across[d, m, 1] *= n / (n - 3.0)
            for row in range(_BLOCKS):
                for column in range(_BLOCKS):
                    shared[d, m] += blocks[d, m, row, column] ** 2
            unit = alone * scatter[d, m] / (n - 3.0)
            shared[d, m] = shared[d, m] / unit if unit > 0.0 else 1.0
    return fit, variance, across, scatter, known, shared, number

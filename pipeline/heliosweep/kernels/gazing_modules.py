"""What slope maps say about the modules: statistics, canting, pointing and focal length with their standard errors.

Over each module the slopes are fitted by a plane, p = c + k (position - module centre). Its value at the module's
centre is what its screws would have to undo. The median of these over the modules is the pointing of the heliostat, the
rest of each is its canting: one slope alone cannot tell the two apart, and the median is not moved by a few bad
modules. Canting is against the ideal heliostat: modules on a sphere of another focal length are canted too. The
curvature k = dp/dy = dp/dz of all modules together gives their own focal length: k = 1 / 2 f0 - 1 / 2 f.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.gazing_grid import MirrorGrid, Modules

__all__ = ["ModuleEstimates", "module_estimates", "module_statistics"]

Floats = NDArray[np.float64]
_BLOCKS = 4
"""Blocks along each side of a module for what neighbouring pixels share."""
_FEW = 2 * _BLOCKS
"""Pixels of a module below which nothing is fitted."""


class ModuleEstimates(NamedTuple):
    """Estimates from a slope map, NaN where too few pixels are usable; directions are horizontal, vertical."""

    canting: Floats
    """Slopes of each module at its centre, less the pointing, shape (2, M). [rad]"""
    canting_error: Floats
    """Their standard errors, shape (2, M). [rad]"""
    pointing: Floats
    """Median of the modules' slopes, shape (2,). [rad]"""
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


@kernel
def module_statistics(
    values: Floats, module: NDArray[np.int64], use: NDArray[np.bool_], count: int
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Mean and root mean square over the modules, each summed in the order of its pixels.

    Parameters
    ----------
    values : ndarray, shape (C, N)
        NaN where there is none.
    module : ndarray of int, shape (N,)
        Row of each pixel's module, from 0.
    use : ndarray of bool, shape (N,)
        Pixels that count: those that erosion leaves.
    count : int
        M, the number of modules.

    Returns
    -------
    mean, rms : ndarray, shape (C, M)
        NaN for a module without a value.
    pixels : ndarray of int, shape (C, M)
        Values of each module that counted.
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
    reference: Floats | None = None,
    deviation: Floats | None = None,
) -> ModuleEstimates:
    """Canting, pointing and focal length from slopes.

    Parameters
    ----------
    slopes : ndarray, shape (2, N)
        p relative to the ideal mirror, NaN where unknown. [rad]
    grid : MirrorGrid
    modules : Modules
    use : ndarray of bool, shape (N,)
        Pixels that count, from `eroded`.
    focal_length : float
        f0 of the ideal mirror. [m]
    reference : ndarray, shape (2, N), optional
        Slopes that the same method finds on the ideal heliostat, to be subtracted. [rad]
    deviation : ndarray, shape (2, N), optional
        Known standard deviation of the noise of each slope, to be taken out of the waviness. [rad]

    Returns
    -------
    ModuleEstimates
        Standard errors are those of the scatter about the planes. Where neighbouring pixels share their scatter, as
        those of a wavy mirror do, it counts by blocks of a sixteenth of a module. An error common to a whole module
        or heliostat, of the sun profile for instance, does not show in them.
    """
    net = np.array(slopes if reference is None else slopes - reference, np.float64)
    noise = np.zeros_like(net) if deviation is None else np.ascontiguousarray(deviation)
    fit, scatter, known, shared, number = _fitted(
        net, noise, grid.pixel_y, grid.pixel_z, grid.pixel_module, use, modules.centre, modules.size
    )
    seen = number >= _FEW
    # Scatter of all modules together, by direction; a plane fitted to 16 blocks leaves 13 parts of their variance.
    freedom = np.sum(number[seen] - 3)
    with np.errstate(all="ignore"):
        variance = np.sum(scatter[:, seen], axis=1) / freedom
        blocks = _BLOCKS * _BLOCKS
        inflation = np.sum(shared[:, seen], axis=1) / np.sum(scatter[:, seen], axis=1) * blocks / (blocks - 3.0)
    variance = variance * np.fmax(inflation, 1.0)
    own = np.sqrt(variance[:, np.newaxis] * fit[:, :, 2])
    level = fit[:, :, 0]
    pointing, pointing_error = np.full(2, math.nan), np.full(2, math.nan)
    usable = np.isfinite(level[0])
    if np.any(usable):
        pointing = np.median(level[:, usable], axis=1)
        heads = int(np.sum(usable))
        spread = math.sqrt(0.5 * math.pi) if heads > 2 else 1.0  # of a median against that of a mean
        pointing_error = spread * np.sqrt(np.sum(own[:, usable] ** 2, axis=1)) / heads
    bend, bend_error = _pooled(fit[:, :, 1], variance[:, np.newaxis] * fit[:, :, 3])
    with np.errstate(all="ignore"):
        length = 1.0 / (1.0 / focal_length - 2.0 * bend) if math.isfinite(bend) else math.nan
        left = np.where(seen, scatter / np.maximum(number - 3, 1) - known / np.maximum(number, 1), math.nan)
    return ModuleEstimates(
        level - pointing[:, np.newaxis],
        np.sqrt(own**2 + pointing_error[:, np.newaxis] ** 2),
        pointing,
        pointing_error,
        length,
        2.0 * length * length * bend_error,
        np.sqrt(np.maximum(left, 0.0)),
        number,
    )


def _pooled(values: Floats, variances: Floats) -> tuple[float, float]:
    """Mean of independent values weighted by their variances, and its standard error; equal where none varies."""
    good = np.isfinite(values) & np.isfinite(variances)
    if not np.any(good):
        return math.nan, math.nan
    value, variance = values[good], variances[good]
    if not np.all(variance > 0.0):
        return float(np.mean(value)), 0.0
    weight = 1.0 / variance
    return float(np.sum(weight * value) / np.sum(weight)), float(1.0 / math.sqrt(np.sum(weight)))


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
) -> tuple[Floats, Floats, Floats, Floats, NDArray[np.int64]]:
    """Planes through the slopes of each module.

    Returns, by direction and module: (value at the centre, curvature along the own direction, and their variances for
    unit scatter), the squared residuals, the squared noise, the squared sums of the residuals of each block; and the
    pixels of each module.
    """
    modules, pixels = len(centre), y.size
    fit, number = np.full((2, modules, 4), math.nan), np.zeros(modules, np.int64)
    scatter, known, shared = np.zeros((2, modules)), np.zeros((2, modules)), np.zeros((2, modules))
    sums = np.zeros((modules, 5))
    right = np.zeros((2, modules, 3))
    plane = np.zeros((2, modules, 3))
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
        lever = (my * my * zz - 2.0 * my * mz * yz + mz * mz * yy) / determinant
        for d in range(2):
            mean = right[d, m, 0] / n
            py, pz = right[d, m, 1] - n * my * mean, right[d, m, 2] - n * mz * mean
            ky, kz = (zz * py - yz * pz) / determinant, (yy * pz - yz * py) / determinant
            plane[d, m, 0], plane[d, m, 1], plane[d, m, 2] = mean - ky * my - kz * mz, ky, kz
            fit[d, m, 0], fit[d, m, 2] = plane[d, m, 0], 1.0 / n + lever
            fit[d, m, 1] = ky if d == 0 else kz
            fit[d, m, 3] = zz / determinant if d == 0 else yy / determinant
    blocks = np.zeros((2, modules, _BLOCKS, _BLOCKS))
    for k in range(pixels):
        if not use[k] or math.isnan(slopes[0, k]) or math.isnan(slopes[1, k]):
            continue
        m = module[k]
        dy, dz = y[k] - centre[m, 0], z[k] - centre[m, 1]
        column = min(max(int((dy / size[m, 0] + 0.5) * _BLOCKS), 0), _BLOCKS - 1)
        row = min(max(int((dz / size[m, 1] + 0.5) * _BLOCKS), 0), _BLOCKS - 1)
        for d in range(2):
            rest = slopes[d, k] - plane[d, m, 0] - plane[d, m, 1] * dy - plane[d, m, 2] * dz
            scatter[d, m] += rest * rest
            blocks[d, m, row, column] += rest
    for d in range(2):
        for m in range(modules):
            for row in range(_BLOCKS):
                for column in range(_BLOCKS):
                    shared[d, m] += blocks[d, m, row, column] ** 2
    return fit, scatter, known, shared, number

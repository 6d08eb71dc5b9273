"""Standard errors of a median over modules, and of what each module is away from it."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["median_errors"]

Floats = NDArray[np.float64]
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

    Parameters
    ----------
    away : ndarray, shape (2, M)
        Slopes of the modules, less those of their own sphere, less the pointing. [rad]
    variance : ndarray, shape (2, M, 3)
        Variances of level and curvature and their covariance.
    weight : ndarray, shape (2, M)
        Of each curvature in that of the heliostat.
    lever : ndarray, shape (2, M)
        Centres of the modules. [m]
    """
    draws = _draws(away.shape[1])
    spread = np.sqrt(variance[:, :, 0])
    with np.errstate(all="ignore"):
        slant = np.where(spread > 0.0, variance[:, :, 2] / spread, 0.0)
    level = spread * draws[:, 0]
    curvature = slant * draws[:, 0] + np.sqrt(np.maximum(variance[:, :, 1] - slant**2, 0.0)) * draws[:, 1]
    bend = np.sum(weight * curvature, axis=(1, 2))
    moved = level - bend[:, np.newaxis, np.newaxis] * lever
    # What is found is scattered once already: distances that errors alone make are taken out before they are drawn.
    with np.errstate(all="ignore"):
        kept = np.fmax(1.0 - _NEAR**2 * np.mean(moved**2, axis=0) / away**2, 0.0)
    pointing = np.median(away * kept + moved, axis=2)
    pointing -= np.mean(pointing, axis=0)
    canting = level - pointing[:, :, np.newaxis]
    return np.sqrt(np.mean(pointing**2, axis=0)), np.sqrt(np.mean(canting**2, axis=0))

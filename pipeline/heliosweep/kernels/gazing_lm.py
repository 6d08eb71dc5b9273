"""Mirror slopes by Levenberg-Marquardt: all pixels at once, with analytic derivatives.

The merit is that of `gazing_search`'s O2: the sum over the lit cameras of (g B(eps_i(p)) - I_i)^2. The gain g of a
pixel is 1, or the one that makes the sum least.

A noisy table has a dip in the merit at every kink of its own. So the search goes from smooth to rough: first the
analytic curve nearest to the table, then the table smoothed less and less, then the table.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.gazing_descent import NOT_CONVERGED, OUTSIDE, UNLIT, levenberg_marquardt
from heliosweep.kernels.gazing_geometry import Scene
from heliosweep.kernels.sun_profiles import Profile
from heliosweep.kernels.sun_tables import smooth_fit, smoothed

__all__ = [
    "GRADUATION",
    "NOT_CONVERGED",
    "OUTSIDE",
    "UNLIT",
    "SlopeFit",
    "fit_slopes",
    "graduated",
    "levenberg_marquardt",
]

Floats = NDArray[np.float64]

GRADUATION = (6.0, 3.0, 1.5, 0.7)
"""Smoothing of a table before it is used itself, in nodes."""

_SMOOTH_STEP, _TABLE_STEP, _PASSING_STEP = 1e-11, 1e-8, 1e-5
"""A search ends at a step as short as this: for an analytic profile, for a table, and where another stage follows.
[rad]"""


class SlopeFit(NamedTuple):
    """Slopes of N pixels and what is known about them; NaN where fewer than 3 cameras are lit."""

    slopes: Floats
    """p relative to the ideal mirror, horizontal and vertical, shape (2, N). [rad]"""
    deviation: Floats
    """Standard deviation of the slopes for camera noise of standard deviation 1, shape (2, N): the Cramer-Rao bound at
    the slopes found, for a table at those that its smooth fit finds. [rad]"""
    gain: Floats
    """g, 1 where it is not fitted. [1]"""
    merit: Floats
    """Sum of squares left. [1]"""
    evaluations: NDArray[np.int64]
    """How often the rays were traced, over all stages."""
    flags: NDArray[np.uint8]
    """Sum of `NOT_CONVERGED`, `UNLIT` and `OUTSIDE`."""


def graduated(profile: Profile) -> list[Profile]:
    """A profile as a series from smooth to rough; the last one is the profile itself.

    Parameters
    ----------
    profile : Profile

    Returns
    -------
    list of Profile
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
    y: ArrayLike,
    z: ArrayLike,
    start: ArrayLike,
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
    y, z : array_like, shape (N,)
        Pixels, from the mirror centre. [m]
    start : array_like, shape (2, N)
        First guess of p, from method A; 0 where it is not finite. [rad]
    threshold : float
        Least brightness of a lit camera; darker ones, and NaN, do not count. [1]
    fit_gain : bool
        Whether every pixel has a gain of its own, common to its cameras.
    limit : int
        Most evaluations in a stage.

    Returns
    -------
    SlopeFit
    """
    stages = graduated(profile) if isinstance(profile, Profile) else list(profile)
    seen, place = np.array(images, np.float64), np.array([y, z], np.float64)
    number = seen.shape[1]
    found, flags = np.zeros((7, number)), np.zeros(number, np.uint8)
    found[:2] = np.where(np.isfinite(start), start, 0.0)
    deviation = np.empty((2, number))
    for n, stage in enumerate(stages):
        enough = _PASSING_STEP if n + 1 < len(stages) else _TABLE_STEP if stage.table.size > 0 else _SMOOTH_STEP
        levenberg_marquardt(layout, stage, seen, place, threshold, fit_gain, enough, limit, found, flags)
        if n == 0:  # the steepness of a noisy table says little about that of the sun's disc
            deviation[:] = found[2:4]
    return SlopeFit(found[:2], deviation, found[4], found[5], found[6].astype(np.int64), flags)

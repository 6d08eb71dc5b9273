"""Slopes by all methods from one set of images: simulated or measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.backward_gazing.variables import NOT_CONVERGED, UNLIT
from heliosweep.kernels.gazing_geometry import EXACT, Scene, transfers
from heliosweep.kernels.gazing_linear import (
    ideal_squares,
    ideal_wavefront,
    solutions,
    transferred,
    wavefront_departures,
)
from heliosweep.kernels.gazing_lm import SlopeFit, fit_slopes, graduated
from heliosweep.kernels.gazing_search import SlopeSearch, search_slopes, search_wavefronts
from heliosweep.kernels.sun_profiles import Profile
from heliosweep.kernels.sun_tables import smooth_fit

Floats = NDArray[np.float64]

__all__ = ["Found", "reconstruct"]


class Found(NamedTuple):
    """Slopes by M methods and T referentials."""

    slopes: Floats
    """p relative to the ideal mirror, shape (M, T, 2, N); NaN where fewer than 3 cameras are lit. [rad]"""
    lit: NDArray[np.int64]
    """Bit i is set where camera i is lit, shape (N,)."""
    quality: NDArray[np.int64]
    """Bits of `variables`: NOT_CONVERGED, UNLIT, OUTSIDE; shape (M, N)."""
    fit: SlopeFit | None
    """What LM found, of which the slopes are; None where it is not among the methods."""


def reconstruct(
    layout: Scene,
    profile: Profile,
    images: Floats,
    place: tuple[Floats, Floats],
    methods: Sequence[str],
    referentials: Sequence[int],
    threshold: float,
    fit_gain: bool,
    smooth: bool = False,
) -> Found:
    """Find slopes.

    Parameters
    ----------
    layout : Scene
        K cameras.
    profile : Profile
        Of the sun.
    images : ndarray, shape (K, N)
        Brightness relative to the disc centre; NaN where a camera's pixel cannot be used. [1]
    place : tuple of ndarray, each of shape (N,)
        y and z of the pixels. [m]
    methods : sequence of str, length M
        Of `blocks.METHODS`.
    referentials : sequence of int, length T
        Rows of `gazing_geometry.transfers`; O2 and LM have the same slopes in each.
    threshold : float
        Least brightness of a lit camera. [1]
    fit_gain : bool
        Whether O1, O2 and LM find a gain for each pixel.
    smooth : bool
        Whether LM ends at the smooth fit of a tabulated profile instead of the table: better where the images are of
        the sun and the table has noise of its own.

    Returns
    -------
    Found
    """
    y, z = place
    every = transfers(layout)
    matrices = np.ascontiguousarray(every[list(referentials)])
    ideal = ideal_squares(layout, y, z)
    departures, lit = wavefront_departures(images, ideal, solutions(layout.gaze), profile, threshold)
    start = transferred(departures, every[EXACT:])[0]
    unlit = ~np.isfinite(departures[0])
    slopes = np.empty((len(methods), len(matrices), 2, y.size))
    quality = np.zeros((len(methods), y.size), np.int64)
    fit = None
    for row, method in enumerate(methods):
        if method == "A":
            slopes[row] = transferred(departures, matrices)
            quality[row] = UNLIT * unlit
        elif method == "O1":
            wavefront = ideal_wavefront(layout, ideal)
            search = search_wavefronts(
                layout, profile, images, wavefront + departures, threshold=threshold, fit_gain=fit_gain
            )
            slopes[row] = transferred(search.slopes - wavefront, matrices)
            quality[row] = _of_search(search)
        elif method == "O2":
            search = search_slopes(layout, profile, images, y, z, start, threshold=threshold, fit_gain=fit_gain)
            slopes[row] = search.slopes
            quality[row] = _of_search(search)
        else:
            stages = [smooth_fit(profile)] if smooth and profile.table.size > 3 else graduated(profile)
            fit = fit_slopes(layout, stages, images, y, z, start, threshold=threshold, fit_gain=fit_gain)
            slopes[row] = fit.slopes
            quality[row] = fit.flags
    return Found(slopes, lit, quality, fit)


def _of_search(search: SlopeSearch) -> NDArray[np.int64]:
    """Bits of what a simplex search says of its pixels."""
    tried = search.evaluations > 0
    bits: NDArray[np.int64] = UNLIT * ~tried + NOT_CONVERGED * (tried & ~search.converged)
    return bits

"""Cosine, shading, blocking and optical efficiency of heliostats in a field: annual sums, or every instant.

Every value of a heliostat and an instant has the same bits however heliostats and instants are split over calls; sums
also depend on the order of packets, which depends on the sun vectors alone.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.mounts import AZIMUTH_ELEVATION, SPINNING_ELEVATION, Mirrors
from heliosweep.kernels.packets import packet_order
from heliosweep.kernels.sweep import sweep

__all__ = ["aimed", "field_series", "field_sums"]

Floats = NDArray[np.float64]


def field_sums(
    x: Floats,
    y: Floats,
    z: Floats,
    half_width: Floats,
    half_height: Floats,
    target_height: float,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
) -> tuple[Floats, int]:
    """Sums of the efficiencies over all instants with the sun above the horizon.

    Parameters
    ----------
    x, y, z : ndarray, shape (N,)
        Mirror centres: east, north, up. [m]
    half_width, half_height : ndarray, shape (N,)
        Half sides of the mirrors along u (width) and v (height). [m]
    target_height : float
        Height of the target point, which stands at x = y = 0. [m]
    tracking : int
        `mounts.SPINNING_ELEVATION` or `mounts.AZIMUTH_ELEVATION`.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up. Instants with z <= 0, or
        NaN where there is none, contribute nothing and are not counted. [1]
    start, stop : int
        Test heliostats start..stop; all N may shade and block them.

    Returns
    -------
    sums : ndarray, shape (stop - start, 4)
        Sums of the cosine efficiency, the shading efficiency (1 - shaded fraction), the blocking efficiency
        (1 - blocked fraction) and the optical efficiency, cosine * (1 - fraction shaded or blocked). [1]
    instants : int
        Number of instants summed.

    Raises
    ------
    ValueError
        If start..stop is no part of the field, the method unknown, or mirrors or sun vectors are not finite.
    """
    mirrors = aimed(x, y, z, half_width, half_height, target_height)
    _check(mirrors, sun, tracking, start, stop)
    sun, order, first = _sorted(sun)
    sums, nothing = np.zeros((stop - start, 4)), np.empty((4, 0, 0))
    if start < stop and len(order) > 0:
        sweep(mirrors, tracking, sun, order, first, start, stop, sums, nothing)
    return sums, len(order)


def field_series(
    x: Floats,
    y: Floats,
    z: Floats,
    half_width: Floats,
    half_height: Floats,
    target_height: float,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
) -> Floats:
    """Efficiencies of every instant, in the given order; parameters as in `field_sums`.

    Returns
    -------
    ndarray, shape (4, T, stop - start)
        Cosine, shading, blocking and optical efficiency; NaN with the sun at or below the horizon. [1]
    """
    mirrors = aimed(x, y, z, half_width, half_height, target_height)
    _check(mirrors, sun, tracking, start, stop)
    sun, order, first = _sorted(sun)
    nothing, series = np.empty((0, 4)), np.full((4, len(sun), stop - start), np.nan)
    if start < stop and len(order) > 0:
        sweep(mirrors, tracking, sun, order, first, start, stop, nothing, series)
    return series


def aimed(x: Floats, y: Floats, z: Floats, half_width: Floats, half_height: Floats, target_height: float) -> Mirrors:
    """Mirrors aimed at the target point (0, 0, target_height); parameters as in `field_sums`."""
    centres = np.stack((x, y, z)).astype(np.float64)
    sides = np.stack((half_width, half_height)).astype(np.float64)
    to_target = np.array([0.0, 0.0, target_height]) - centres.T
    throw = np.sqrt(to_target[:, 0] ** 2 + to_target[:, 1] ** 2 + to_target[:, 2] ** 2)
    radius = np.sqrt(sides[0] ** 2 + sides[1] ** 2)
    with np.errstate(invalid="ignore"):  # at the target: refused by `_check`
        aim = np.ascontiguousarray(to_target / throw[:, None])  # one layout, also for one heliostat: one signature
    return Mirrors(centres[0], centres[1], centres[2], sides[0], sides[1], radius, aim, throw)


def _check(mirrors: Mirrors, sun: Floats, tracking: int, start: int, stop: int) -> None:
    """Refuse what compiled code would read past the end of an array for, or make numbers of that mean nothing."""
    count = len(mirrors.x)
    if not all(len(each) == count and np.isfinite(each).all() for each in mirrors):
        raise ValueError("centres and half sides must be as many finite numbers each, and no mirror at the target")
    if np.ndim(sun) != 2 or np.shape(sun)[1] != 3 or not np.isfinite(sun[sun[:, 2] > 0.0]).all():
        raise ValueError("sun vectors above the horizon must be finite, of shape (T, 3)")
    if not 0 <= start <= stop <= count:
        raise ValueError(f"heliostats {start}..{stop} are no part of a field of {count}")
    if tracking not in (SPINNING_ELEVATION, AZIMUTH_ELEVATION):
        raise ValueError(f"unknown tracking method {tracking}")


def _sorted(sun: Floats) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Sun vectors as the kernels want them, the instants with the sun up in packet order, and where packets begin."""
    sun = np.array(sun, np.float64, order="C")  # a copy: a read-only array would be compiled for anew
    up = np.flatnonzero(sun[:, 2] > 0.0)
    order, first = packet_order(sun[up])
    return sun, up[order], first

"""Cosine, shading, blocking and optical efficiency of heliostats in a field: annual sums, or every instant.

Instants are sorted into packets of similar sun directions, which `sweep` goes through.

Every value of a heliostat and an instant has the same bits for any split of heliostats and instants over calls; sums
also depend on the order of packets, which depends on the sun vectors alone.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.field.neighbours import (
    Cells,
    by_cells,
)
from heliosweep.kernels.field.packets import (
    AZIMUTH_ELEVATION,
    SPINNING_ELEVATION,
    Mirrors,
    packet_order,
)
from heliosweep.kernels.field.sweep import Weights, sweep


class SortedField(NamedTuple):
    """The mirrors of a field, sorted by the cells of a grid."""

    mirrors: Mirrors
    grid: Cells


def sorted_field(
    x: Floats,
    y: Floats,
    z: Floats,
    half_width: Floats,
    half_height: Floats,
    target_height: float | Floats,
) -> SortedField:
    """Mirrors of a field as `field_sums` and others take them, made once for all blocks of its heliostats.

    Parameters
    ----------
    x, y, z : ndarray, shape (N,)
        Mirror centres: east, north, up. [m]
    half_width, half_height : ndarray, shape (N,)
        Half sides of the mirrors along u (width) and v (height). [m]
    target_height : float or ndarray, shape (N, 3)
        Height of the target point, which stands at x = y = 0, or the point that each mirror aims at. [m]

    Raises
    ------
    ValueError
        If there are no mirrors, or they are not finite.
    """
    mirrors = aimed(x, y, z, half_width, half_height, target_height)
    count = len(mirrors.x)
    if not count or not all(len(each) == count and np.isfinite(each).all() for each in mirrors):
        raise ValueError("centres and half sides must be as many finite numbers each, and no mirror at the target")
    return SortedField(*by_cells(mirrors))


def field_sums(
    field: SortedField,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
    part: Floats | None = None,
) -> tuple[Floats, int]:
    """Sums of the efficiencies over all instants with the sun above the horizon.

    Parameters
    ----------
    field : SortedField
        All N mirrors of the field, from `sorted_field`.
    tracking : int
        `mounts.SPINNING_ELEVATION` or `mounts.AZIMUTH_ELEVATION`.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up. Instants with z <= 0, or
        NaN where there is none, contribute nothing and are not counted. [1]
    start, stop : int
        Test heliostats start..stop; all N may shade and block them.
    part : ndarray, shape (stop - start, T), optional
        Part of the light of each test heliostat and instant that counts: what follows on the optical efficiency. [1]

    Returns
    -------
    sums : ndarray, shape (stop - start, 4), or 5 with `part`
        Sums of the cosine efficiency, the shading efficiency (1 - shaded fraction), the blocking efficiency
        (1 - blocked fraction) and the optical efficiency, cosine * (1 - fraction shaded or blocked); of the optical
        efficiency times `part`. [1]
    instants : int
        Number of instants summed.

    Raises
    ------
    ValueError
        If start..stop is no part of the field, the method unknown, or sun vectors are not finite.
    """
    instants = len(sun)
    sums = field_energies(
        field, tracking, sun, start, stop, np.ones((2, instants)), np.zeros(instants, np.int64), 1, part
    )[:, 0]
    columns = [0, 1, 2, 3] if part is None else [0, 1, 2, 3, 6]
    return sums[:, columns], int(np.count_nonzero(sun[:, 2] > 0.0))


def field_energies(
    field: SortedField,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
    weight: Floats,
    period: Integers,
    periods: int,
    part: Floats | None = None,
) -> Floats:
    """Weighted sums of the efficiencies over the instants of each period, as energies are; parameters as `field_sums`.

    Parameters
    ----------
    weight : ndarray, shape (2, T)
        Weight of each instant, as the irradiation of its interval; the same times what the mirrors reflect.
    period : ndarray, shape (T,)
        Number of the period of each instant, as the month, from 0.
    periods : int
        Number of periods.

    Returns
    -------
    ndarray, shape (stop - start, periods, 7)
        Sums over each period of the cosine, shading, blocking and optical efficiency, of cosine times shading
        efficiency, all times the weight; of the optical efficiency times what is reflected, and of this times `part`.
        In the unit of the weights.

    Raises
    ------
    ValueError
        As `field_sums`; if weights or periods are not as many as the instants, or a period is not 0 to periods - 1.
    """
    weight, period = np.array(weight, np.float64, order="C"), np.array(period, np.int64)
    if weight.shape != (2, len(sun)) or period.shape != (len(sun),) or not np.all((period >= 0) & (period < periods)):
        raise ValueError(f"weights must be of shape (2, {len(sun)}), and as many periods from 0 to {periods - 1}")
    sun, order, first = _sorted(field, sun, tracking, start, stop)
    sums = np.zeros((stop - start, periods, 7))
    if start < stop and len(order) > 0:
        part = np.empty((0, 0)) if part is None else np.array(part, np.float64, order="C")
        weighted = Weights(weight, period, part, sums)
        sweep(*field, tracking, sun, order, first, start, stop, np.empty((4, 0, 0)), weighted)
    return sums


def field_series(
    field: SortedField,
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
    sun, order, first = _sorted(field, sun, tracking, start, stop)
    series, none = np.full((4, len(sun), stop - start), np.nan), np.empty((0, 0))
    weighted = Weights(none, np.empty(0, np.int64), none, np.empty((0, 0, 7)))
    if start < stop and len(order) > 0:
        sweep(*field, tracking, sun, order, first, start, stop, series, weighted)
    return series


def aimed(
    x: Floats,
    y: Floats,
    z: Floats,
    half_width: Floats,
    half_height: Floats,
    target_height: float | Floats,
) -> Mirrors:
    """Mirrors aimed at (0, 0, target_height), or each at its point; parameters as in `sorted_field`."""
    centres = np.stack((x, y, z)).astype(np.float64)
    sides = np.stack((half_width, half_height)).astype(np.float64)
    to_target = (target_height if np.ndim(target_height) else np.array([0.0, 0.0, target_height])) - centres.T
    throw = np.sqrt(to_target[:, 0] ** 2 + to_target[:, 1] ** 2 + to_target[:, 2] ** 2)
    radius = np.sqrt(sides[0] ** 2 + sides[1] ** 2)
    with np.errstate(invalid="ignore"):  # at the target: refused by `sorted_field`
        aim = np.ascontiguousarray(to_target / throw[:, None])  # one layout, also for one heliostat: one signature
    return Mirrors(centres[0], centres[1], centres[2], sides[0], sides[1], radius, aim, throw)


def _sorted(field: SortedField, sun: Floats, tracking: int, start: int, stop: int) -> tuple[Floats, Integers, Integers]:
    """Sun vectors as the kernels want them, the instants with the sun up in packet order, and where packets begin.

    Refused is what compiled code would read past the end of an array for, or make numbers of that mean nothing.
    """
    count = len(field.grid.names)
    if np.ndim(sun) != 2 or np.shape(sun)[1] != 3 or not np.isfinite(sun[sun[:, 2] > 0.0]).all():
        raise ValueError("sun vectors above the horizon must be finite, of shape (T, 3)")
    if not 0 <= start <= stop <= count:
        raise ValueError(f"heliostats {start}..{stop} are no part of a field of {count}")
    if tracking not in (SPINNING_ELEVATION, AZIMUTH_ELEVATION):
        raise ValueError(f"unknown tracking method {tracking}")
    sun = np.array(sun, np.float64, order="C")  # a copy: a read-only array would be compiled for anew
    up = np.flatnonzero(sun[:, 2] > 0.0)
    order, first = packet_order(sun[up])
    return sun, up[order], first

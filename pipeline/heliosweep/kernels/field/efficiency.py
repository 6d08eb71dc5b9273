"""Cosine, shading, blocking and optical efficiency of heliostats in a field: annual sums, or every instant.

Instants are sorted into packets of similar sun directions, which `sweep` goes through.

Every value of a heliostat and an instant has the same bits for any split of heliostats and instants over calls; sums
also depend on the order of packets, which depends on the sun vectors alone.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.field.neighbours import Cells, by_cells
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION, Mirrors, packet_order
from heliosweep.kernels.field.sweep import sweep


class SortedField(NamedTuple):
    """The mirrors of a field, sorted by the cells of a grid."""

    mirrors: Mirrors
    cells: Cells
    #: Number of each heliostat before it was sorted.
    names: Integers


def aimed(
    x: Floats, y: Floats, z: Floats, half_width: Floats, half_height: Floats, target_height: float | Floats
) -> Mirrors:
    """Mirrors aimed at (0, 0, target_height), or each at its point; parameters as in `sorted_field`."""
    centre, half = np.stack((x, y, z), axis=1).astype(float), np.stack((half_width, half_height), axis=1).astype(float)
    to_target = (target_height if np.ndim(target_height) else np.array([0.0, 0.0, target_height])) - centre
    throw = np.sqrt(to_target[:, 0] ** 2 + to_target[:, 1] ** 2 + to_target[:, 2] ** 2)
    radius = np.sqrt(half[:, 0] ** 2 + half[:, 1] ** 2)
    with np.errstate(invalid="ignore"):  # at the target: refused by `sorted_field`
        return Mirrors(centre, half, radius, to_target / throw[:, np.newaxis], throw)


def sorted_field(
    x: Floats, y: Floats, z: Floats, half_width: Floats, half_height: Floats, target_height: float | Floats
) -> SortedField:
    """Mirrors of a field for `field_energies` and others, made once for all blocks of its heliostats.

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
    if not len(x) or len({len(each) for each in (x, y, z, half_width, half_height)}) > 1:
        raise ValueError("centres and half sides must be as many finite numbers each")
    mirrors = aimed(x, y, z, half_width, half_height, target_height)
    if not all(np.isfinite(each).all() for each in mirrors):
        raise ValueError("centres and half sides must be finite, and no mirror at the target")
    return SortedField(*by_cells(mirrors))


def field_sums(field: SortedField, tracking: int, sun: Floats, start: int, stop: int) -> tuple[Floats, int]:
    """Sums of the efficiencies over all instants with the sun above the horizon.

    Parameters
    ----------
    field : SortedField
        All N mirrors of the field, from `sorted_field`.
    tracking : int
        `packets.SPINNING_ELEVATION` or `packets.AZIMUTH_ELEVATION`.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up. Instants with z <= 0, or NaN, contribute nothing and are not
        counted. [1]
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
        If start..stop is no part of the field, the method unknown, or sun vectors are not finite.
    """
    sums = field_energies(field, tracking, sun, start, stop, np.ones(len(sun)), np.zeros(len(sun), np.int64), 1)
    return sums[:, 0, :4], int(np.count_nonzero(sun[:, 2] > 0.0))


def field_energies(
    field: SortedField,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
    weight: Floats,
    period: Integers,
    periods: int,
) -> Floats:
    """Weighted sums of the efficiencies over the instants of each period, as energies are; parameters as `field_sums`.

    Parameters
    ----------
    weight : ndarray, shape (T,)
        Weight of each instant, as the irradiation of its interval.
    period : ndarray, shape (T,)
        Number of the period of each instant, as the month, from 0.
    periods : int
        Number of periods.

    Returns
    -------
    ndarray, shape (stop - start, periods, 5)
        Sums over each period of the cosine, shading, blocking and optical efficiency, and of cosine times shading
        efficiency, all times the weight, in the unit of the weights.

    Raises
    ------
    ValueError
        As `field_sums`; if weights or periods are not as many as the instants, or a period is not 0 to periods - 1.
    """
    weight, period = np.array(weight, np.float64), np.array(period, np.int64)
    if weight.shape != (len(sun),) or period.shape != (len(sun),) or not np.all((period >= 0) & (period < periods)):
        raise ValueError(f"weights must be of shape ({len(sun)},), and as many periods from 0 to {periods - 1}")
    sums = np.zeros((stop - start if stop > start else 0, periods, 5))
    _sweep(field, tracking, sun, start, stop, np.empty((4, 0, 0)), weight, period, sums)
    return sums


def field_series(field: SortedField, tracking: int, sun: Floats, start: int, stop: int) -> Floats:
    """Efficiencies of every instant, in the given order; parameters as in `field_sums`.

    Returns
    -------
    ndarray, shape (4, T, stop - start)
        Cosine, shading, blocking and optical efficiency; NaN with the sun at or below the horizon. [1]
    """
    series = np.full((4, len(sun), stop - start if stop > start else 0), np.nan)
    _sweep(field, tracking, sun, start, stop, series, np.empty(0), np.empty(0, np.int64), np.empty((0, 0, 5)))
    return series


def _sweep(
    field: SortedField,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
    series: Floats,
    weight: Floats,
    period: Integers,
    sums: Floats,
) -> None:
    """Call `sweep`. Input for which compiled code would read past the end of an array is refused."""
    count = len(field.names)
    if np.ndim(sun) != 2 or np.shape(sun)[1] != 3 or not np.isfinite(sun[sun[:, 2] > 0.0]).all():
        raise ValueError("sun vectors above the horizon must be finite, of shape (T, 3)")
    if not 0 <= start <= stop <= count:
        raise ValueError(f"heliostats {start}..{stop} are no part of a field of {count}")
    if tracking not in (SPINNING_ELEVATION, AZIMUTH_ELEVATION):
        raise ValueError(f"unknown tracking method {tracking}")
    sun = np.array(sun, np.float64, order="C")  # a copy: a read-only array would be compiled for anew
    up = np.flatnonzero(sun[:, 2] > 0.0)
    order, first = packet_order(sun[up])
    tests = np.flatnonzero((field.names >= start) & (field.names < stop))
    if len(tests) and len(up):
        rows = field.names[tests] - start
        sweep(field.mirrors, field.cells, tracking, sun, up[order], first, tests, rows, series, weight, period, sums)

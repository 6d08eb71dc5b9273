"""Light about a ray, of one heliostat at an instant: made from the tables of the sun, and looked up in lanes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.intercept.tables import BLOCK
from heliosweep.kernels.vectors import GROUP

LOOKED = 512
"""Most places that are looked up at a time."""
X, Y, PART, RESULT = (k * (LOOKED + GROUP) for k in range(4))
"""Rows of `Light.places`: coordinates, the weight that a place counts with, and the weighted light there."""
_PLACE, _WAVE, _COSINE, _NOW, _OLDER, _AHEAD, _SECOND = (k * (LOOKED + GROUP) for k in range(4, 11))
ROWS = 11 * (LOOKED + GROUP)
"""Size of `Light.places`."""


class Light(NamedTuple):
    """Light of one pair of variances, in stretched coordinates."""

    series: Floats
    """Series of the F_m / r^2, shape (harmonics, terms). [1/rad^2]"""
    far: Floats
    """F_m of all light. [1]"""
    blocks: NDArray[np.int64]
    """Blocks of each series by bands, and the band; see `Tables`."""
    band: int
    harmonics: int
    """Number that makes a difference."""
    radius: float
    """Radius and b of the series; see `Tables`. [rad, rad^2]"""
    bend: float
    reach: float
    """Radius beyond which there is no light. [rad]"""
    smooth: float
    """Length over which the light changes. [rad]"""
    places: Floats
    """Rows in which places are looked up."""


@inline
def light_of(room, tables, band, harmonics, reach, smooth):
    """Light with so many harmonics, of the series that stand in a room."""
    return Light(
        room.series, room.far, tables.blocks, band, harmonics, tables.radius[band], tables.bend[band], reach, smooth,
        room.places,
    )  # fmt: skip


@inner
def weigh(tables, small, large, weights):
    """Write the weights of the nodes for a pair of variances, and return their band.

    Variances outside the span of the tables are brought to its end.
    """
    bands, width = tables.reach.shape[0], tables.logs[1] - tables.logs[0]
    log = min(max(np.log(small), tables.logs[0]), tables.logs[bands])
    band, span = min(int((log - tables.logs[0]) / width), bands - 1), tables.spans[1] - tables.spans[0]
    across, along = 2.0 * (log - tables.logs[band]) / width - 1.0, 0.0
    if span > 0.0:
        along = 2.0 * (min(max(np.log(large), tables.spans[0]), tables.spans[1]) - tables.spans[0]) / span - 1.0
    inner = tables.large.shape[1]
    for v in range(weights.shape[0]):
        weights[v] = _weight(tables.small, v // inner, across) * _weight(tables.large, v % inner, along)
    return band


@inline
def _weight(rule, node, place):
    """Polynomial of Lagrange that is 1 at one node and 0 at the others."""
    weight = rule[1, node]
    for other in range(rule.shape[1]):
        if other != node:
            weight *= place - rule[0, other]
    return weight


@inner
def extent(tables, band, weights, least):
    """Reach of the light of one pair of variances [rad], and the number of harmonics that are at least `least`."""
    reach = 0.0
    for v in range(weights.shape[0]):
        reach += weights[v] * tables.reach[band, v]
    reach = min(reach, tables.radius[band])
    for m in range(1, tables.size.shape[2]):
        size = 0.0
        for v in range(weights.shape[0]):
            size += weights[v] * tables.size[band, v, m]
        if abs(size) < least:
            return reach, m
    return reach, tables.size.shape[2]


@inner
def collapse(tables, band, weights, harmonics, series, far):
    """Write the series of one pair of variances, and the F_m of all its light."""
    for m in range(harmonics):
        far[m], count = 0.0, BLOCK * tables.blocks[band, m]
        for n in range(count):
            series[m, n] = weights[0] * tables.light[band, 0, m, n]
        for v in range(weights.shape[0]):
            far[m] += weights[v] * tables.far[band, v, m]
            if v > 0:
                for n in range(count):
                    series[m, n] += weights[v] * tables.light[band, v, m, n]


@inner
def look_up(light, count):
    """Write the weighted sum of F_m / r^2 cos(2 m phi) at places, a multiple of `GROUP`. [1/rad^2]

    Beyond the radius, F_m is what it is there: that of all light.
    """
    room, square, bend = light.places, light.radius * light.radius, light.bend
    scale = 2.0 * (square + bend) / square
    for i in range(count):
        x, y = room[X + i], room[Y + i]
        xx, yy = x * x, y * y
        whole = xx + yy + 1e-300
        inverse = 1.0 / whole
        near = min(whole, square)
        z = scale * near / (near + bend) - 1.0
        room[_PLACE + i], room[PART + i] = z, room[PART + i] * near * inverse
        z = 2.0 * z * z - 1.0
        z = 2.0 * z * z - 1.0
        room[_WAVE + i] = 2.0 * z * z - 1.0
        room[_COSINE + i] = room[_OLDER + i] = (xx - yy) * inverse
        room[_NOW + i], room[RESULT + i] = 1.0, 0.0
    for m in range(light.harmonics):
        blocks = light.blocks[light.band, m]
        if blocks > 2:
            _add_blocks(light, m, blocks, count)
        a0, a1, a2, a3, a4, a5, a6, a7 = _block(light.series, m, 0)
        b0, b1, b2, b3, b4, b5, b6, b7 = _block(light.series, m, 1)
        for i in range(count):
            z, wave, now = room[_PLACE + i], room[_WAVE + i], room[_NOW + i]
            ahead, second = (room[_AHEAD + i], room[_SECOND + i]) if blocks > 2 else (0.0, 0.0)
            ahead, second = _powers(z, b0, b1, b2, b3, b4, b5, b6, b7) + (2.0 * wave * ahead - second), ahead
            value = _powers(z, a0, a1, a2, a3, a4, a5, a6, a7) + (wave * ahead - second)
            room[RESULT + i] += now * value
            room[_NOW + i], room[_OLDER + i] = 2.0 * room[_COSINE + i] * now - room[_OLDER + i], now
    for i in range(count):
        room[RESULT + i] *= room[PART + i]


@inner
def _add_blocks(light, m, blocks, count):
    """Sum the blocks of a series from the last to the third, as Clenshaw does."""
    room = light.places
    for j in range(blocks - 1, 1, -1):
        c0, c1, c2, c3, c4, c5, c6, c7 = _block(light.series, m, j)
        for i in range(count):
            ahead, second = (room[_AHEAD + i], room[_SECOND + i]) if j < blocks - 1 else (0.0, 0.0)
            q = _powers(room[_PLACE + i], c0, c1, c2, c3, c4, c5, c6, c7)
            room[_AHEAD + i], room[_SECOND + i] = q + (2.0 * room[_WAVE + i] * ahead - second), ahead


@inline
def _block(series, m, j):
    """Coefficients of a block of harmonic m."""
    n = BLOCK * j
    return (
        series[m, n], series[m, n + 1], series[m, n + 2], series[m, n + 3], series[m, n + 4], series[m, n + 5],
        series[m, n + 6], series[m, n + 7],
    )  # fmt: skip


@inline
def _powers(z, c0, c1, c2, c3, c4, c5, c6, c7):
    """Sum of powers, from the constant on."""
    return c0 + z * (c1 + z * (c2 + z * (c3 + z * (c4 + z * (c5 + z * (c6 + z * c7))))))


@inner
def folded(room, row, count):
    """Sum of a row of places, a multiple of `GROUP`, which it writes over."""
    for first in range(GROUP, count, GROUP):
        for i in range(GROUP):
            room[row + i] += room[row + first + i]
    total = 0.0
    for i in range(min(count, GROUP)):
        total += room[row + i]
    return total

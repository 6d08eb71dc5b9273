"""Fields that are cut out of an endless pattern: the phyllotaxis spiral, and straight or staggered rows.

References
----------
.. [1] Noone, C. J., Torrilhon, M. and Mitsos, A. (2012). Heliostat field optimization: A new computationally efficient
   model and biomimetic layout. Solar Energy 86, 792-803. doi:10.1016/j.solener.2011.12.007
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.errors import Problem, StudyError
from heliosweep.layouts.ground import Region
from heliosweep.layouts.layout import MAX_HELIOSTATS, Layout

GOLDEN = (1 + math.sqrt(5)) / 2

#: Places of a pattern that are looked at, for as many heliostats as a layout may have.
MOST_PLACES = 4 * MAX_HELIOSTATS


def spiral(
    a: float, b: float, inner_radius: float, heliostats: int | None = None, region: Region | None = None
) -> Layout:
    """Generate a phyllotaxis spiral [1]_: heliostat k at the azimuth 360 k / phi^2 deg and the radius a k^b.

    k counts from 1, and phi is the golden ratio.

    Parameters
    ----------
    a : float
        Radius of heliostat 1. [m]
    b : float
        Exponent of the radius.
    inner_radius : float
        Nearer heliostats are left out. [m]
    heliostats : int, optional
        Number of heliostats, the first ones; with a region of finite reach it may be left out.
    region : Region, optional
        Ground for heliostats.

    Returns
    -------
    Layout
        From the tower outwards, with z = 0 and the column ``turn``, the number k. Azimuths are from north, clockwise.

    Raises
    ------
    StudyError
        With the key of what cannot be met.
    """

    def places(radius: float) -> tuple[NDArray[Any], ...]:
        # Logarithms, since too many places are refused before they are counted.
        count = 0.0 if radius < a else _counted(math.exp(min(math.log(radius / a) / b, 50.0)), "b")
        k = np.arange(1, int(count) + 1)
        turn = k / GOLDEN**2
        azimuth = 2 * math.pi * (turn - np.floor(turn))
        distance = a * k.astype(float) ** b
        return distance * np.sin(azimuth), distance * np.cos(azimuth), k, k

    first = (inner_radius / a) ** (1 / b) if inner_radius > a else 0.0
    reach = a * (first + (heliostats or 1) + 2) ** b
    return _cut("spiral", "turn", places, reach, inner_radius, heliostats, region)


def rows(
    spacing: float,
    distance: float,
    inner_radius: float,
    azimuth: float = 0.0,
    pattern: str = "staggered",
    heliostats: int | None = None,
    region: Region | None = None,
) -> Layout:
    """Generate parallel rows, of which row 0 passes through the tower.

    Parameters
    ----------
    spacing : float
        Distance between neighbours of a row. [m]
    distance : float
        Distance between rows. [m]
    inner_radius : float
        Nearer heliostats are left out. [m]
    azimuth : float
        In which rows follow each other, from north, clockwise. [deg]
    pattern : {"staggered", "straight"}
        Whether odd rows are moved by half a spacing to the right, looking along `azimuth`.
    heliostats : int, optional
        Number of heliostats, those nearest to the tower; of equally near ones, within rounding, the first
        row and the leftmost. Optional with a region of finite reach.
    region : Region, optional
        Ground for heliostats.

    Returns
    -------
    Layout
        Row by row along `azimuth`, each from the left, with z = 0 and the column ``row``.

    Raises
    ------
    StudyError
        With the key of what cannot be met.
    """
    turn = math.radians(azimuth)

    def places(radius: float) -> tuple[NDArray[Any], ...]:
        _counted(math.pi * (radius / spacing + 1) * (radius / distance + 1), "spacing")
        most, deep = math.ceil(radius / spacing) + 1, math.ceil(radius / distance)
        row, number = np.meshgrid(np.arange(-deep, deep + 1), np.arange(-most, most + 1), indexing="ij")
        right = ((number + (row % 2) * 0.5 * (pattern == "staggered")) * spacing).ravel()
        ahead = (row * distance).ravel().astype(float)
        near = np.hypot(right, ahead)
        x = right * math.cos(turn) + ahead * math.sin(turn)
        y = ahead * math.cos(turn) - right * math.sin(turn)
        # To the nanometre: places that mirror each other are equally far, whatever their last bit.
        return tuple(each[near <= radius] for each in (x, y, np.round(near, 9), row.ravel()))

    wanted = (heliostats or 1) * spacing * distance / math.pi
    reach = math.sqrt(inner_radius**2 + wanted) + spacing + distance
    return _cut("rows", "row", places, reach, inner_radius, heliostats, region)


def _counted(count: float, key: str) -> float:
    if count > MOST_PLACES:
        message = f"the field would have more than {MOST_PLACES:,} places to look at; let it take less ground"
        raise StudyError(Problem(message, key))
    return count


def _cut(
    name: str,
    column: str,
    places: Callable[[float], tuple[NDArray[Any], ...]],
    reach: float,
    inner_radius: float,
    heliostats: int | None,
    region: Region | None,
) -> Layout:
    """Cut a field out of a pattern.

    `places` gives, within a radius, x and y [m], an order in which heliostats are taken, and the values of a column;
    `reach` is a radius within which there could be enough. [m]
    """
    region = region or Region()
    if heliostats is not None and heliostats > MAX_HELIOSTATS:
        message = f"must be at most {MAX_HELIOSTATS:,} (got {heliostats})"
        raise StudyError(Problem(message, "heliostats"))
    most = region.reach
    radius = most if heliostats is None else min(reach, most)
    while True:
        x, y, order, numbers = places(radius)
        there = np.flatnonzero((np.hypot(x, y) >= inner_radius) & region.inside(x, y))
        if heliostats is None or there.size >= heliostats or radius >= most:
            break
        radius = min(1.4 * radius, most)
    if heliostats is not None and there.size > heliostats:
        there = np.sort(there[np.argsort(order[there], kind="stable")[:heliostats]])
    check_count(there.size, heliostats, region)
    return Layout(x[there], y[there], np.zeros(there.size), {column: numbers[there]}, name)


def check_count(there: int, heliostats: int | None, region: Region) -> None:
    """Raise StudyError where too few, no or too many heliostats fit."""
    if not there:
        raise region.no_room()
    if heliostats is not None and there < heliostats:
        message = f"only {there:,} fit (got {heliostats:,}); use fewer, or a larger area"
        raise StudyError(Problem(message, "heliostats"))
    if heliostats is None and there > MAX_HELIOSTATS:
        raise StudyError(Problem(f"the field would have more than {MAX_HELIOSTATS:,} heliostats", region.key))

"""The sun's profile from an image of its disc: medians over rings about the centroid.

The disc is what is brighter than half its limb; its centroid is the centre and its area tells the radius, both finer
than a pixel. A median over each ring leaves out dust and hot pixels. Rings that the limb crosses hold pixels of disc
and sky, so the profile is continued there linearly in c = sqrt(1 - u^xi), in which the formula of Jose is linear.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.sun_profiles import POWER

__all__ = ["SunDisc", "disc_profile"]

Floats = NDArray[np.float64]

_MOST_NODES = 120
_LEAST_RADIUS = 12.0
"""Smallest radius of a disc from which a profile is taken. [pixels]"""
_LIMB = 1.5
"""Width of the limb that pixels blur. [pixels]"""


class SunDisc(NamedTuple):
    """A profile and what it was taken from."""

    brightness: Floats
    """Relative to the centre, at equal steps from the centre to the edge. [1]"""
    radius: float
    """[pixels]"""
    centre: tuple[float, float]
    """Column and row. [pixels]"""
    level: float
    """Level of the disc centre, in the scale of the image."""


def disc_profile(image: ArrayLike, power: float = POWER) -> SunDisc:
    """Profile of a sun's disc.

    Parameters
    ----------
    image : array_like, shape (rows, columns)
        Levels above the dark; NaN where a pixel cannot be used.
    power : float
        xi of the continuation at the limb. [1]

    Returns
    -------
    SunDisc

    Raises
    ------
    ValueError
        If there is no disc, it is too small, is cut by the frame or is not round.
    """
    levels = np.asarray(image, np.float64)
    seen = levels[np.isfinite(levels)]
    if seen.size == 0 or not np.max(seen) > 0.0:
        raise ValueError("shows no disc: no pixel is brighter than the dark level")
    top = float(np.median(seen[seen >= 0.5 * np.percentile(seen, 99.9)]))
    disc = _disc(levels, 0.4 * top)
    ring = (disc.distance > 0.93 * disc.radius) & (disc.distance < 0.97 * disc.radius) & np.isfinite(levels)
    if np.any(ring):
        disc = _disc(levels, 0.5 * float(np.median(levels[ring])))
    radius, distance = disc.radius, disc.distance
    if radius < _LEAST_RADIUS:
        raise ValueError(f"shows a disc of radius {radius:.1f} pixels; {_LEAST_RADIUS:.0f} are needed")
    rows, columns = levels.shape
    room = min(disc.u, disc.v, columns - 1 - disc.u, rows - 1 - disc.v)
    if room < radius + 0.5:
        raise ValueError("shows a disc that the frame cuts")
    if abs(disc.roundness - 1.0) > 0.05:
        raise ValueError("shows no single round disc: clouds, stray light or a second disc?")
    nodes = int(np.clip(round(radius) + 1, 4, _MOST_NODES))
    step = radius / (nodes - 1)
    use = np.isfinite(levels) & (distance < radius - _LIMB)
    number = np.rint(distance[use] / step).astype(np.int64)
    inner = levels[use]
    order = np.argsort(number, kind="stable")
    cuts = np.searchsorted(number[order], np.arange(nodes + 1))
    table = np.full(nodes, math.nan)
    for node in range(nodes):
        values = inner[order[cuts[node] : cuts[node + 1]]]
        if values.size >= 5 and (node + 0.5) * step < radius - _LIMB:
            table[node] = np.median(values)
    u = np.linspace(0.0, 1.0, nodes)
    c = np.sqrt(1.0 - u**power)
    good = np.isfinite(table)
    if np.count_nonzero(good) < 8:
        raise ValueError("shows too few usable pixels of the disc")
    curve = np.linalg.lstsq(np.stack((np.ones_like(c), c, c**2), axis=1)[good], table[good], rcond=None)[0]
    outer = good & (u > 0.75)
    edge = np.linalg.lstsq(np.stack((np.ones_like(c), c), axis=1)[outer], table[outer], rcond=None)[0]
    inside = u < 0.5
    table = np.where(good, table, np.where(inside, curve[0] + c * (curve[1] + c * curve[2]), edge[0] + c * edge[1]))
    level = float(np.sum(curve))
    return SunDisc(table / level, radius, (disc.u, disc.v), level)


class _Disc(NamedTuple):
    u: float
    v: float
    radius: float
    distance: Floats
    roundness: float


def _disc(levels: Floats, limit: float) -> _Disc:
    """Centroid, radius and distances of what is brighter than a limit; its mean square radius over that of a disc."""
    bright = levels > limit  # False for NaN
    rows, columns = np.nonzero(bright)
    if rows.size < 4:
        raise ValueError("shows no disc")
    u, v = float(columns.mean()), float(rows.mean())
    row, column = np.indices(levels.shape)
    distance = np.hypot(column - u, row - v)
    radius = math.sqrt(rows.size / math.pi)
    return _Disc(u, v, radius, distance, 2.0 * float(np.mean(distance[bright] ** 2)) / radius**2)

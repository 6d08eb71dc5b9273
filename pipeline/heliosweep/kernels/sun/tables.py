"""Tabulated sun profiles: from images of the disc, with noise and errors, smoothed; the nearest analytic curve.

The disc in an image is the region brighter than half its limb; its centroid is the centre, and its area gives the
radius, both finer than a pixel. A profile consists of medians over rings about the centroid, which suppress dust and
hot pixels. Rings at the limb contain pixels of disc and sky, so the profile is continued there linearly in
c = sqrt(1 - u^xi), in which the formula of Jose is linear.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Philox
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.sun.profiles import POWER, Profile, analytic, falling_envelope, render, table_profile


def noisy(profile: Profile, noise: float, nodes: int = 120, seed: int = 0) -> Profile:
    """A profile tabulated at uniform nodes, both ends included, with normal noise on each.

    `noise` is the standard deviation relative to the disc centre [1]; of `nodes` 3 are needed. `seed` is the key of the
    counter-based generator: node k of a seed has the same noise whatever their number. Negative values, which noise may
    cause, are 0.
    """
    if nodes < 3:
        raise ValueError("a table needs 3 nodes at least")
    clean = render(profile, np.linspace(0.0, profile.radius, nodes))
    table = np.maximum(clean + noise * normal_draws(seed, 1, nodes), 0.0)
    return table_profile(table, profile.radius)._replace(power=profile.power)


def scaled(profile: Profile, error: float) -> Profile:
    """The same profile, narrower or wider by a relative error of its angular radius; for planted profile errors."""
    if not error > -1.0:
        raise ValueError("the radius must remain positive")
    factor = 1.0 + error
    return profile._replace(
        radius=profile.radius * factor,
        edge=profile.edge * factor,
        edge_slope=profile.edge_slope / factor,
        step=profile.step * factor,
    )


def smoothed(profile: Profile, nodes: float) -> Profile:
    """Smooth a table by a Gaussian with a standard deviation in nodes.

    It is reflected at the disc centre and continued by its tangent beyond the edge.
    """
    table = profile.table
    if table.size == 0:
        raise ValueError("only a table can be smoothed")
    if nodes <= 0.0:
        return profile
    reach = math.ceil(5.0 * nodes)
    offsets = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (offsets / nodes) ** 2)
    weights /= weights.sum()
    place = np.abs(np.arange(table.size)[:, np.newaxis] + offsets)
    beyond = np.maximum(place - (table.size - 1), 0)
    wide = table[np.minimum(place, table.size - 1)] + beyond * (profile.edge_slope * profile.step)
    return table_profile(np.sum(wide * weights, axis=1), profile.radius)._replace(power=profile.power)


def smooth_fit(profile: Profile) -> Profile:
    """The cubic in sqrt(1 - u^xi) nearest to a table in the sense of least squares over its nodes; xi is its power."""
    table, power = profile.table, profile.power
    if table.size < 4:
        raise ValueError("the fit needs a table of 4 nodes at least")
    c = _limb_cosine(np.linspace(0.0, 1.0, table.size), power)
    fit, *_ = np.linalg.lstsq(np.stack((np.ones_like(c), c, c**2, c**3), axis=1), table, rcond=None)
    c0, c1, c2, c3 = map(float, fit)
    c = _limb_cosine(np.linspace(0.0, 1.0, 1025), power)
    curve = c0 + c * (c1 + c * (c2 + c * c3))
    return analytic((c0, c1, c2, c3), profile.radius, power, falling_envelope(curve))


def normal_draws(seed: int, stream: int, count: int) -> Floats:
    """Standard normal numbers from a counter-based generator, Philox 4x64: number k depends only on its key and k.

    The key is `seed` and `stream`, not negative; each purpose has its stream. The result has the shape (count,), in
    pairs from the transform of Box and Muller.
    """
    pairs = (count + 1) // 2
    raw = Philox(key=np.array([seed, stream], np.uint64)).random_raw(2 * pairs)
    uniform = ((raw >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52  # exact: neither 0 nor 1
    length, turn = np.sqrt(-2.0 * np.log(uniform[0::2])), 2.0 * np.pi * uniform[1::2]
    return np.stack((length * np.cos(turn), length * np.sin(turn)), axis=1).ravel()[:count]


def _limb_cosine(u: Floats, power: float) -> Floats:
    return np.sqrt(1.0 - u**power)


_MOST_NODES = 120
#: Smallest radius of a disc from which a profile is taken. [pixels]
_LEAST_RADIUS = 12.0
#: Width of the limb that pixels blur. [pixels]
_LIMB = 1.5


class SunDisc(NamedTuple):
    """Profile and the geometry of its disc."""

    #: Relative to the centre, at equal steps from the centre to the edge. [1]
    brightness: Floats
    #: [pixels]
    radius: float
    #: Column and row. [pixels]
    centre: tuple[float, float]
    #: Level of the disc centre, in the scale of the image.
    level: float


def disc_profile(image: ArrayLike) -> SunDisc:
    """Return the profile of a sun's disc in an image.

    `image` has levels above the dark level, shape (rows, columns), NaN for unusable pixels. Raises ValueError if there
    is no disc, or it is too small, cut by the frame or not round.
    """
    levels = np.asarray(image, np.float64)
    seen = levels[np.isfinite(levels)]
    if seen.size == 0 or not np.max(seen) > 0.0:
        raise ValueError("shows no disc: no pixel is brighter than the dark level")
    top = float(np.median(seen[seen >= 0.5 * np.percentile(seen, 99.9)]))
    column, row, radius, distance, roundness = _disc(levels, 0.4 * top)
    ring = (distance > 0.93 * radius) & (distance < 0.97 * radius) & np.isfinite(levels)
    if np.any(ring):
        column, row, radius, distance, roundness = _disc(levels, 0.5 * float(np.median(levels[ring])))
    rows, columns = levels.shape
    room = min(column, row, columns - 1 - column, rows - 1 - row)
    for wrong, fault in (
        (radius < _LEAST_RADIUS, f"a disc of radius {radius:.1f} pixels; {_LEAST_RADIUS:.0f} are needed"),
        (room < radius + 0.5, "a disc that the frame cuts"),
        (abs(roundness - 1.0) > 0.05, "no single round disc: clouds, stray light or a second disc?"),
    ):
        if wrong:
            raise ValueError(f"shows {fault}")
    nodes = int(np.clip(round(radius) + 1, 4, _MOST_NODES))
    step = radius / (nodes - 1)
    use = np.isfinite(levels) & (distance < radius - _LIMB)
    number, inner = np.rint(distance[use] / step).astype(np.int64), levels[use]
    table = np.full(nodes, math.nan)
    for node in np.flatnonzero((np.arange(nodes) + 0.5) * step < radius - _LIMB):
        values = inner[number == node]
        table[node] = np.median(values) if values.size >= 5 else math.nan
    u = np.linspace(0.0, 1.0, nodes)
    c = _limb_cosine(u, POWER)
    good = np.isfinite(table)
    if np.count_nonzero(good) < 8:
        raise ValueError("shows too few usable pixels of the disc")
    curve = np.linalg.lstsq(np.stack((np.ones_like(c), c, c**2), axis=1)[good], table[good], rcond=None)[0]
    outer = good & (u > 0.75)
    edge = np.linalg.lstsq(np.stack((np.ones_like(c), c), axis=1)[outer], table[outer], rcond=None)[0]
    continued = np.where(u < 0.5, curve[0] + c * (curve[1] + c * curve[2]), edge[0] + c * edge[1])
    level = float(np.sum(curve))
    return SunDisc(np.where(good, table, continued) / level, radius, (column, row), level)


def _disc(levels: Floats, limit: float) -> tuple[float, float, float, Floats, float]:
    """Return the centroid of the region above a limit, its radius, distances from the centroid, and its roundness.

    The roundness is the mean square radius relative to a disc. All lengths are in pixels, columns first.
    """
    bright = levels > limit  # False for NaN
    rows, columns = np.nonzero(bright)
    if rows.size < 4:
        raise ValueError("shows no disc")
    u, v = float(columns.mean()), float(rows.mean())
    row, column = np.indices(levels.shape)
    distance = np.hypot(column - u, row - v)
    radius = math.sqrt(rows.size / math.pi)
    return u, v, radius, distance, 2.0 * float(np.mean(distance[bright] ** 2)) / radius**2

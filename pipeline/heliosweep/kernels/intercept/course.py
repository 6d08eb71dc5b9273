"""Intercept over many instants of one place, interpolated in the direction of the sun and checked.

The intercept is smooth in the direction of the sun, as shading is not. It is computed at Chebyshev nodes in the sine of
the declination and in the hour angle over that of sunset, and interpolated. Each mirror is checked at some instants;
one that misses is computed at every instant: with a vertical first axis, where the normal comes near the zenith and the
mirror turns fast.
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.intercept.efficiency import Scene, intercepts

Floats = NDArray[np.float64]

NODES = (8, 24)
"""Nodes in the sine of the declination and in the hour angle."""
CHECKS = 12
"""Instants at which each mirror is checked; the first half are those with its normal nearest to the zenith."""
TOLERANCE = 1e-4
"""Largest error at a check that is taken. [1]"""
COMPUTED = NODES[0] * NODES[1] + CHECKS
"""Directions of the sun at which each mirror is computed; twice as many instants are interpolated."""


def course(scene: Scene, sun: Floats, latitude: float | None, start: int = 0, stop: int | None = None) -> Floats:
    """Intercept of mirrors start..stop at instants, shape (stop - start, T); see `intercepts`.

    `latitude` of the place [rad], None for directions of the sun that belong to no place: all are then computed. So are
    instants that are few.
    """
    stop = len(scene.centre) if stop is None else stop
    up = np.flatnonzero(sun[:, 2] > 0.0)
    if latitude is None or len(up) < 2 * COMPUTED:
        return intercepts(scene, sun, start, stop)
    out, there = np.full((stop - start, len(sun)), np.nan), sun[up]
    sine, share = _place(there, latitude)
    (nodes_s, weights_s), (nodes_h, weights_h) = _nodes(sine, NODES[0]), _nodes(share, NODES[1])
    grid_s, grid_h = (each.ravel() for each in np.meshgrid(nodes_s, nodes_h, indexing="ij"))
    at_nodes = intercepts(scene, _vectors(grid_s, grid_h, latitude), start, stop)
    values = np.empty((stop - start, len(up)))
    _interpolate(at_nodes, weights_s, weights_h, values)
    for i in range(start, stop):
        rows = values[i - start]
        picked = _checked(scene, i, there)
        exact = intercepts(scene, there[picked], i, i + 1)[0]
        if not np.abs(rows[picked] - exact).max() <= TOLERANCE:
            rows[:] = intercepts(scene, there, i, i + 1)[0]
    out[:, up] = np.clip(values, 0.0, 1.0)
    return out


def _place(sun: Floats, latitude: float) -> tuple[Floats, Floats]:
    """Sine of the declination, and hour angle over that of sunset."""
    sine = sun[:, 1] * math.cos(latitude) + sun[:, 2] * math.sin(latitude)
    hour = np.arctan2(-sun[:, 0], sun[:, 2] * math.cos(latitude) - sun[:, 1] * math.sin(latitude))
    return sine, hour / _sunset(sine, latitude)


def _sunset(sine: Floats, latitude: float) -> Floats:
    """Hour angle of sunset, half a turn where there is none. [rad]"""
    cosine = -math.sin(latitude) * sine / np.maximum(math.cos(latitude) * np.sqrt(1.0 - sine**2), 1e-12)
    return np.maximum(np.arccos(np.clip(cosine, -1.0, 1.0)), 1e-3)


def _vectors(sine: Floats, share: Floats, latitude: float) -> Floats:
    """Unit vectors to the sun; those that rounding brings below the horizon are brought back."""
    cosine, hour = np.sqrt(1.0 - sine**2), share * _sunset(sine, latitude)
    meridian = cosine * np.cos(hour)
    north = math.cos(latitude) * sine - math.sin(latitude) * meridian
    upward = np.maximum(math.sin(latitude) * sine + math.cos(latitude) * meridian, 1e-9)
    return np.stack((-cosine * np.sin(hour), north, upward), axis=1)


def _nodes(values: Floats, count: int) -> tuple[Floats, Floats]:
    """Chebyshev nodes between the least and the largest value, and the weight of each node at each value."""
    middle, half = (values.max() + values.min()) / 2, max((values.max() - values.min()) / 2, 1e-9)
    angle = math.pi * (np.arange(count) + 0.5) / count
    order = np.arange(count)
    along = np.arccos(np.clip((values - middle) / half, -1.0, 1.0))
    factor = np.where(order, 2.0, 1.0) / count
    weights = np.zeros((len(values), count))
    for n in range(count):
        weights += factor[n] * np.cos(n * along)[:, np.newaxis] * np.cos(n * angle)
    return middle + half * np.cos(angle), weights


@kernel
def _interpolate(at_nodes, weights_s, weights_h, values):
    """Write the values of each mirror at each instant from those at the nodes."""
    for i in range(values.shape[0]):
        for t in range(values.shape[1]):
            total = 0.0
            for s in range(weights_s.shape[1]):
                part = 0.0
                for h in range(weights_h.shape[1]):
                    part += weights_h[t, h] * at_nodes[i, s * weights_h.shape[1] + h]
                total += weights_s[t, s] * part
            values[i, t] = total


def _checked(scene: Scene, mirror: int, sun: Floats) -> NDArray[np.int64]:
    """Instants at which a mirror is checked."""
    to_target = scene.target[mirror] - scene.centre[mirror]
    to_target /= np.sqrt(np.sum(to_target**2))
    normal = sun + to_target
    steep = np.argsort(-normal[:, 2] / np.sqrt(np.sum(normal**2, axis=1)), kind="stable")[: CHECKS // 2]
    others = np.linspace(0, len(sun) - 1, CHECKS // 2).astype(np.int64)
    return np.concatenate((steep, others))

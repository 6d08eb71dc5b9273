"""Expansions in Chebyshev polynomials and Fourier series, and the turn of a mirror that the intercept has some in."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline
from heliosweep.kernels.intercept.efficiency import Scene


def aims_of(scene: Scene) -> Floats:
    """Directions from the mirrors to their targets, shape (N, 3)."""
    aims = scene.target - scene.centre
    return aims / np.sqrt(np.sum(aims**2, axis=1))[:, np.newaxis]


def multiples_of(scene: Scene) -> NDArray[np.int64]:
    """Least multiple of its turn about its normal that the intercept of each mirror depends on, shape (N,).

    A mirror looks the same after a turn by half, a square one by a quarter; none with a fixed pointing error or a map.
    """
    errors, facets = scene.errors, scene.facets
    even = facets.columns == facets.rows and errors.slope_u == errors.slope_v
    fixed = np.any(scene.turn, axis=1) | (scene.slopes.size > 0)
    return np.where(fixed, 1, np.where(even & (scene.sides[:, 0] == scene.sides[:, 1]), 4, 2))


def fourier(count: int, multiple: int) -> tuple[Floats, Floats]:
    """Angles to compute at [rad], and the terms of Fourier from the values there, shape (terms, angles)."""
    angles = 2.0 * math.pi * np.arange(count) / (count * max(multiple, 1))
    terms = np.ones((count, count)) / count
    for k in range(1, count):
        phase = multiple * ((k + 1) // 2) * angles
        terms[k] = 2.0 / count * (np.cos(phase) if k % 2 else np.sin(phase))
    return angles, terms


def chebyshev(values: Floats, count: int, ends: Sequence[float] | None = None) -> tuple[Floats, Floats]:
    """Chebyshev nodes between two ends, and the weight of each at each value, shape (count, T).

    Without `ends`, from the least to the largest value.
    """
    first, last = (values.min(), values.max()) if ends is None else ends
    middle, half = (last + first) / 2, max((last - first) / 2, 1e-9)
    order, edge = np.arange(count), np.where(np.arange(count) % (count - 1), 1.0, 0.5)
    angle = math.pi * order / (count - 1)
    terms = edge[:, np.newaxis] * np.cos(order[:, np.newaxis] * angle) * edge * 2.0 / (count - 1)
    along = np.clip((values - middle) / half, -1.0, 1.0)
    weights, now, older = np.zeros((count, len(values))), np.ones(len(values)), along
    for n in range(count):
        weights += terms[n][:, np.newaxis] * now
        now, older = 2.0 * along * now - older if n else along, now
    return middle + half * np.cos(angle), weights


def chebyshev_terms(count: int) -> Floats:
    """Chebyshev terms from values at the inner nodes, shape (terms, nodes)."""
    order = np.arange(count)
    terms = 2.0 / count * np.cos(np.outer(order, math.pi * (order + 0.5) / count))
    terms[0] /= 2.0
    return terms


def chebyshev_suns(counts: Sequence[int], latitude: float, sun: Floats) -> tuple[Floats, Floats, Floats]:
    """Directions of the sun at the nodes; weights of both kinds of nodes at each instant, shapes (nodes, T)."""
    sine, share = _place(sun, latitude)
    (nodes_s, weights_s), (nodes_h, weights_h) = chebyshev(sine, counts[0]), chebyshev(share, counts[1])
    grid_s, grid_h = (each.ravel() for each in np.meshgrid(nodes_s, nodes_h, indexing="ij"))
    return _vectors(grid_s, grid_h, latitude), weights_s, weights_h


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


@inline
def turn_of(aim, sun, start, lanes, cosine, sine):
    """Write cosine and sine of the turn of a mirror with a vertical first axis, from the axes of `ROLLED`.

    These are the directions of aim x sun and of aim - sun; their lengths are half and all of |aim - sun| times
    |aim + sun| and 1.
    """
    for k in range(lanes):
        x, y, z = sun[0, start + k], sun[1, start + k], sun[2, start + k]
        a, b, c = aim[0] - x, aim[1] - y, aim[2] - z
        east, north, up = aim[0] + x, aim[1] + y, aim[2] + z
        level, along = math.sqrt(east * east + north * north), math.sqrt(east * east + north * north + up * up)
        steep, apart = level < 1e-15, math.sqrt(a * a + b * b + c * c)
        u, v = 1.0 if steep else -north / level, 0.0 if steep else east / level
        same = apart < 1e-15
        cosine[k] = (
            1.0 if same else 2.0 * (u * (aim[1] * z - aim[2] * y) + v * (aim[2] * x - aim[0] * z)) / (apart * along)
        )
        sine[k] = 0.0 if same else (u * a + v * b) / apart

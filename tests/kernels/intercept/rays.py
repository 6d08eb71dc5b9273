"""Rays traced one by one, from a Sobol sequence: the intercept without tangent planes, tables or outlines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from heliosweep.kernels.field.packets import SPINNING_ELEVATION
from heliosweep.kernels.intercept.efficiency import Scene
from heliosweep.kernels.intercept.receivers import RECTANGLE
from heliosweep.kernels.sunshapes import DISC

Floats = NDArray[np.float64]


def _unit(v: Floats) -> Floats:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def traced(scene: Scene, mirror: int, sun: Floats, power: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Places of 2^power rays of a mirror on the receiver, shape (2, rays), and which meet it.

    The sun is a pillbox; errors turn normals, the sun's disc turns rays. Places are across, of a cylinder the azimuth
    clockwise from north, and the height from the middle. [m, rad]
    """
    q = qmc.Sobol(9, seed=1).random(2**power)
    centre, aim, facets = scene.centre[mirror], scene.target[mirror], scene.facets
    t = _unit(aim - centre)
    n = _unit(sun + t)
    u = _unit(np.cross(t, sun) if scene.tracking == SPINNING_ELEVATION else np.array([-n[1], n[0], 0.0]))
    v = np.cross(n, u)
    number = np.minimum((q[:, 8] * facets.columns * facets.rows).astype(int), facets.columns * facets.rows - 1)
    across, upward = number % facets.columns, number // facets.columns
    width, height = (scene.sides[mirror] + facets.gap) / (facets.columns, facets.rows) - facets.gap
    a0 = (across - (facets.columns - 1) / 2) * (width + facets.gap)
    b0 = (upward - (facets.rows - 1) / 2) * (height + facets.gap)
    a, b, curve, cant = width * (q[:, 0] - 0.5), height * (q[:, 1] - 0.5), scene.curve[mirror], scene.cant[mirror]
    slope_u = cant * a0 + curve * a - scene.turn[mirror, 0] - scene.errors.slope_u * ndtri(q[:, 2])
    slope_v = cant * b0 + curve * b - scene.turn[mirror, 1] - scene.errors.slope_v * ndtri(q[:, 3])
    normal = _unit(n - slope_u[:, None] * u - slope_v[:, None] * v)
    ray = 2.0 * (normal @ sun)[:, None] * normal - sun
    e1 = _unit(np.cross(ray, (0.0, 0.0, 1.0)))
    e2, r, psi = np.cross(ray, e1), DISC * np.sqrt(q[:, 4]), 2 * np.pi * q[:, 5]
    x = r * np.cos(psi) + scene.errors.specularity * ndtri(q[:, 6])
    y = r * np.sin(psi) + scene.errors.specularity * ndtri(q[:, 7])
    ray = ray + x[:, None] * e1 + y[:, None] * e2
    rise = cant * (a0 * a + b0 * b) + 0.5 * curve * (a**2 + b**2)
    d = centre - scene.receiver.centre + (a0 + a)[:, None] * u + (b0 + b)[:, None] * v + rise[:, None] * n
    half_width, half_height = scene.receiver.half_width, scene.receiver.half_height
    if scene.receiver.kind == RECTANGLE:
        width_axis, height_axis = np.array(scene.receiver.across), np.array(scene.receiver.upward)
        face = np.cross(width_axis, height_axis)
        hit = d - (d @ face / (ray @ face))[:, None] * ray
        places = np.stack((hit @ width_axis, hit @ height_axis))
        from_front = (d @ face > 0) & (ray @ face < 0)
        return places, from_front & np.all(abs(places) < [[half_width], [half_height]], axis=0)
    p, s, c = np.sum(ray[:, :2] ** 2, 1), np.sum(ray[:, :2] * d[:, :2], 1), np.sum(d[:, :2] ** 2, 1) - half_width**2
    root = s * s - p * c
    hit = d + ((-s - np.sqrt(np.maximum(root, 0.0))) / p)[:, None] * ray
    places = np.stack((np.arctan2(hit[:, 0], hit[:, 1]) % (2 * np.pi), hit[:, 2]))
    return places, (root > 0) & (abs(hit[:, 2]) < half_height)

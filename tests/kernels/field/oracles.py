"""The specification of the field kernels in a few obvious lines: every pair, shapely, no culling."""

import numpy as np
import shapely
from shapely.geometry import Polygon

from heliosweep.kernels.field.packets import SPINNING_ELEVATION

SQUARE = shapely.box(-1.0, -1.0, 1.0, 1.0)


def unit(vector):
    return vector / np.linalg.norm(vector)


def frame(r, s, tracking):
    """Frame (u, v, n) of a mirror that sends the sun s to the target r."""
    n = unit(r + s)
    if tracking == SPINNING_ELEVATION:
        u = np.cross(r, s)
        if np.linalg.norm(u) < 1e-15:
            u = np.array([-r[1], r[0], 0.0])
    else:
        u = np.array([-n[1], n[0], 0.0])
    u = unit(u) if np.linalg.norm(u) > 1e-15 else np.array([1.0, 0.0, 0.0])
    return u, np.cross(n, u), n


def image(i, j, d, centres, frames, sides):
    """Part of mirror j in front of the plane of mirror i, projected along d on the square of mirror i."""
    uj, vj, _ = frames[j]
    offset = centres[j] - centres[i]
    corners = [offset + a * sides[j, 0] * uj + b * sides[j, 1] * vj for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return projected(corners, d, frames[i], sides[i])


def projected(corners, d, frame, sides):
    """Part of a polygon in front of the plane of a mirror, projected along d on the square of the mirror."""
    u, v, n = frame
    front = []
    for p, q in zip(corners, corners[1:] + corners[:1], strict=True):
        if p @ n >= 0.0:
            front.append(p)
        if (p @ n > 0.0) != (q @ n > 0.0):
            front.append(p + (q - p) * (p @ n) / (p @ n - q @ n))
    if len(front) < 3:
        return Polygon()
    big_u, big_v = u - d @ u / (d @ n) * n, v - d @ v / (d @ n) * n
    return Polygon([(p @ big_u / sides[0], p @ big_v / sides[1]) for p in front])


def tower_image(i, s, tower, centres, frames, sides):
    """Shadow of a tower on mirror i: a strip as wide as the tower, cut straight where the round top has its mean."""
    ahead = unit(s * (1.0, 1.0, 0.0))
    across = tower[0] * np.array([ahead[1], -ahead[0], 0.0])
    foot = -np.pi / 4 * tower[0] * ahead - centres[i] * (1.0, 1.0, 0.0)
    high, low = (np.array([0.0, 0.0, z]) for z in (tower[1] - centres[i, 2], -20.0))
    if tower[1] < centres[i, 2] - 20.0:
        return Polygon()
    corners = [foot - across + low, foot + across + low, foot + across + high, foot - across + high]
    return projected(corners, s, frames[i], sides[i])


def lost(images):
    """Fraction of the square that a union of images covers."""
    images = [p for p in images if p.area > 0.0]
    return shapely.union_all(images).intersection(SQUARE).area / SQUARE.area if images else 0.0


def instant(i, mirrors, tracking, s, tower=None):
    """Cosine, shading, blocking and optical efficiency of heliostat i at one instant, by trying every pair."""
    centres, sides = mirrors.spheres[:, :3], mirrors.mounts[:, :2]
    frames = [frame(r, s, tracking) for r in mirrors.aim]
    r = mirrors.aim[i]
    others = [j for j in range(len(centres)) if j != i]
    shade = [image(i, j, s, centres, frames, sides) for j in others]
    shade += [] if tower is None else [tower_image(i, s, tower, centres, frames, sides)]
    near = [j for j in others if (centres[j] - centres[i]) @ r < mirrors.mounts[i, 5]]
    block = [image(i, j, r, centres, frames, sides) for j in near]
    cosine = np.sqrt((1.0 + r @ s) / 2.0)
    return np.array([cosine, 1.0 - lost(shade), 1.0 - lost(block), cosine * (1.0 - lost(shade + block))])

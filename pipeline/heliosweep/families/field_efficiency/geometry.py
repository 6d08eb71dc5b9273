"""Size of a field: mirrors, land, and how much of the land the mirrors would cover; Chong and Tan (2012), Table 1."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.field_efficiency.optics import FacetGrid

Floats = NDArray[np.float64]


def mirror_area(width: Floats, height: Floats, facets: FacetGrid | None) -> Floats:
    """Area of mirrors of some width and height, without the gaps between their facets. [m2]"""
    if facets is None:
        return width * height
    return (width - (facets.columns - 1) * facets.gap) * (height - (facets.rows - 1) * facets.gap)


def facet_side(side: float, count: int, gap: float) -> float:
    """Width or height of a facet, of so many along a side of the mirror. [m]"""
    return (side + gap) / count - gap


def land_area(x: Floats, y: Floats, radius: float) -> float:
    """Area within the line that runs `radius` [m] outside the convex hull of the centres, at x and y [m]. [m2]"""
    corners = _hull(sorted(set(zip(x.tolist(), y.tolist(), strict=True))))
    sides = list(zip(corners, corners[1:] + corners[:1], strict=True))
    area = sum(px * qy - qx * py for (px, py), (qx, qy) in sides) / 2
    return area + radius * sum(math.dist(p, q) for p, q in sides) + math.pi * radius**2


def _hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Corners of the convex hull of sorted points, counter-clockwise (Andrew's monotone chain)."""
    hull: list[tuple[float, float]] = []
    for side in (points, points[::-1]):
        chain: list[tuple[float, float]] = []
        for x, y in side:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                    break
                chain.pop()
            chain.append((x, y))
        hull += chain[:-1]
    return hull or points

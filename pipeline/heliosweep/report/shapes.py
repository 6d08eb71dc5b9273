"""Positions and sizes that images and interactive plots of a field share."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from heliosweep.layouts.ground import AREAS
from heliosweep.report.context import Point, at

#: Side of a mirror of unknown size over the root of the land of each; smallest side over the side of the map.
PACKING, SMALLEST = 0.55, 1 / 250
_NAMES = {"boundary": "boundary", "exclude": "no heliostats"}


def mirrors(here: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return positions and sides of the mirrors of a field, large enough to be seen. [m]"""
    x, y = (here[name].to_numpy().astype(float) for name in "xy")
    spans = [float(np.ptp(side[np.isfinite(side)])) if np.isfinite(side).any() else 1.0 for side in (x, y)]
    count = max(int(np.isfinite(x).sum()), 1)
    usual = max(PACKING * math.sqrt(spans[0] * spans[1] / count), max(spans) / 60, 1.0)
    width, height = (
        np.maximum(
            np.broadcast_to(np.asarray(here[name] if name in here.coords else usual, float), x.shape),
            SMALLEST * max(spans),
        )
        for name in ("heliostat_width", "heliostat_height")
    )
    return x, y, width, height


def areas(result: xr.Dataset) -> dict[str, list[np.ndarray]]:
    """Return the edges of the areas of a field by name, each of shape (corners, 2). [m]"""
    texts = {_NAMES[key]: result.attrs[attribute] for key, attribute in AREAS.items() if attribute in result.attrs}
    if not texts:
        return {}
    import shapely

    found = {}
    for name, text in texts.items():
        lines = shapely.get_parts(shapely.boundary(shapely.get_parts(shapely.from_wkt(str(text)))))
        found[name] = [shapely.get_coordinates(line) for line in lines]
    return found


def aperture(result: xr.Dataset, point: Point) -> tuple[float, float] | None:
    """Return width and height of the receiver's aperture at a point, or None. [m]"""
    sides = []
    for name in ("receiver_width", "receiver_height_extent"):
        side = at(result[name], point) if name in result.coords else None
        if side is None or side.ndim or side.dtype.kind not in "fiu" or not 0 < side < np.inf:
            return None
        sides.append(float(side))
    return sides[0], sides[1]

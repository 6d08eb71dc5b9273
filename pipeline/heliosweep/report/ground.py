"""The ground of a field as its result tells it: the boundary, and where no heliostat may stand."""

from __future__ import annotations

import numpy as np
import xarray as xr

from heliosweep.layouts.ground import AREAS

#: What maps call the areas, by the key of the study.
NAMES = {"boundary": "boundary", "exclude": "no heliostats"}

#: Rise over a field below which the ground counts as level. [m]
LEAST_RISE = 1.0


def rises(heights: np.ndarray) -> bool:
    """Whether the ground at these heights is not level. [m]"""
    known = heights[np.isfinite(heights)]
    return bool(known.size and np.ptp(known) >= LEAST_RISE)


def rings(result: xr.Dataset) -> dict[str, list[np.ndarray]]:
    """Edges of the areas of a result by what maps call them, each of shape (corners, 2); holes among them. [m]"""
    told = {NAMES[key]: result.attrs[attribute] for key, attribute in AREAS.items() if attribute in result.attrs}
    if not told:
        return {}
    import shapely

    found = {}
    for name, text in told.items():
        lines = shapely.get_parts(shapely.boundary(shapely.get_parts(shapely.from_wkt(str(text)))))
        found[name] = [shapely.get_coordinates(line) for line in lines]
    return found

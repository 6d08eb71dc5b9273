"""From a study to its lazy result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.sun import instants_of, site_of, sun_attributes, sun_vectors
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import evaluate
from heliosweep.grid.instants import instant_count
from heliosweep.grid.plan import Workload
from heliosweep_fixed_panel.config import FixedPanelStudy

#: Time of one panel and instant on one core, measured. [s]
SECONDS = 30e-9
#: Keys that label a result also where they are not swept.
LABELS = ("site.latitude", "panel.tilt", "panel.azimuth")

_OVER_TIME = "time: mean (over the instants with the sun above the horizon)"
VARIABLES: dict[str, dict[str, Any]] = {
    "mean_cosine": {
        "units": "1",
        "long_name": "mean cosine of the incidence on the panel",
        "comment": "0 while the sun is behind the panel",
        "cell_methods": _OVER_TIME,
    },
    "lit_fraction": {
        "units": "1",
        "long_name": "fraction of the daylight in which the sun is before the panel",
        "cell_methods": _OVER_TIME,
    },
}


def workload(study: FixedPanelStudy) -> Workload:
    """Sizes and cost, for the plan."""
    grid = Grid(study)
    instants = instant_count(study.time)
    return Workload(
        parameters=grid.sizes,
        inner={},
        evaluations=instants,
        unit="panel-instants",
        seconds=SECONDS,
        splittable="",
        variables=dict.fromkeys(VARIABLES, tuple(grid.sizes)),
        block_bytes=lambda points, _: 8 * 8 * points * instants,
        axes={"instants": instants},
    )


def coordinates(study: FixedPanelStudy, select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid."""
    return xr.Dataset(coords=Grid(study, select).coordinates(LABELS), attrs=sun_attributes(study.time))


def build(study: FixedPanelStudy, chunks: Mapping[str, int], select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Lazy result over a part of the parameter grid."""
    grid = Grid(study, select)
    sun = sun_vectors(site_of(grid), instants_of(grid), chunks)
    made = evaluate(
        cosines,
        [grid.parameter("panel.tilt"), grid.parameter("panel.azimuth"), sun],
        dims=tuple(grid.sizes),
        core=[(), (), ("time", "xyz")],
        sizes=grid.sizes,
        chunks=chunks,
        outputs=VARIABLES,
        name="cosines",
    )
    return xr.Dataset(made).assign_coords(coordinates(study, select).coords)


def cosines(tilt: np.ndarray, azimuth: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Mean cosine of the incidence, and fraction of the daylight before the panel.

    Parameters
    ----------
    tilt, azimuth : ndarray
        Of the panel, over the swept dimensions; azimuth from north, clockwise. [deg]
    sun : ndarray, shape (..., time, 3)
        Unit vectors to the sun: east, north, up. [1]

    Returns
    -------
    ndarray, shape (2, ...)
        Missing where the sun is never up. [1]
    """
    tilt, azimuth = np.radians(tilt), np.radians(azimuth)
    normal = np.sin(tilt) * np.sin(azimuth), np.sin(tilt) * np.cos(azimuth), np.cos(tilt) + 0 * azimuth
    cosine = sum(part[..., np.newaxis] * sun[..., axis] for axis, part in enumerate(normal))
    day = np.broadcast_to(sun[..., 2] > 0, np.shape(cosine))
    count = np.where(day.any(-1), day.sum(-1), np.nan)
    return np.stack((np.where(day, np.maximum(cosine, 0), 0).sum(-1) / count, ((cosine > 0) & day).sum(-1) / count))

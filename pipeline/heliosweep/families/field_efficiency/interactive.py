"""What a reader may turn and switch in a result of the family."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from heliosweep.families.field_efficiency import variables
from heliosweep.report.views import HELIOSTAT, View, is_ordered

#: The most told of first.
_ORDER = ("optical_efficiency", "cosine_efficiency", "shading_efficiency", "blocking_efficiency")


def views(result: xr.Dataset) -> Iterator[View]:
    """Map of every heliostat, means of the field over what is swept, and the course of single instants."""
    yield View(
        "field",
        "Efficiency of every heliostat",
        _ORDER,
        (HELIOSTAT,),
        less="tracking",
        start={"latitude": 0.0},
        caption="Mean over the period. Each square is a mirror laid flat with a side towards the tower (triangle).",
    )
    fields = [f"field_{name}" for name in _ORDER]
    others = [variables.FACTORED]
    dims = [str(dim) for dim in result.sizes if dim not in (HELIOSTAT, "time") and is_ordered(result, str(dim))]
    yield View(
        "curves",
        "Mean efficiency of the field",
        (*fields, *others),
        sorted(dims, key=lambda dim: dim not in ("latitude", "hour")),
        ("tracking",),
        caption="Mean over the period and over the field, weighted by the area of the mirrors.",
    )
    yield View(
        "field",
        "Efficiency of every heliostat at single instants",
        [f"instantaneous_{name}" for name in _ORDER],
        (HELIOSTAT,),
        less="tracking",
        start={"latitude": 0.0},
        caption="Grey: the sun is below the horizon.",
    )
    yield View(
        "field",
        "How far and how fast the axes of every heliostat turn",
        [f"{axis}_angle{what}" for what in ("_range", "_rate", "") for axis in ("primary", "secondary")],
        (HELIOSTAT,),
        less="tracking",
        start={"latitude": 0.0},
        caption="Over the period; primary: the axis that is vertical or along the line to the receiver.",
    )

"""What a reader may turn and switch in a result of the family."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from heliosweep.families.backward_gazing.shown import HOUR, METHOD, METHOD_COLOURS, MODULE, canting
from heliosweep.report.views import HELIOSTAT, PIXELS, View, is_ordered, shown

_TYPICAL: dict[str, float | str] = {METHOD: "LM", "referential": "exact", HOUR: 12.0}

_PICTURES = (
    *(f"{name}_{end}" for name in ("slope", "true_slope", "slope_uncertainty") for end in "xy"),
    "residual_rms",
)
#: What most readers look for, first.
_FIRST = ("relative_error_x_median", "slope_rms_x", "slope_rms_y", "canting_x", "canting_y")


def views(result: xr.Dataset) -> Iterator[View]:
    """Slopes and images on the mirror, a map of the heliostats, and errors over what is swept."""
    names = sorted(shown(result), key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))
    numbers = [str(dim) for dim in result.sizes if dim not in (*PIXELS, HELIOSTAT, MODULE)]
    numbers = [dim for dim in numbers if is_ordered(result, dim)]
    swept = sorted(numbers, key=lambda dim: dim.endswith("seed"))
    flat = [name for name in names if not set(PIXELS) <= set(result[name].dims)]
    yield View("raster", "Slopes of the mirror", _PICTURES, PIXELS, less=METHOD, start=_TYPICAL)
    yield View("raster", "Images of the cameras", ("image",), PIXELS, less="sun_profile", start=_TYPICAL)
    yield View("field", "Map of the field", names, (HELIOSTAT,), less=METHOD, start=_TYPICAL)
    canted = next((number for number, pair in canting(result).items() if any(pair)), 1)
    start = {**_TYPICAL, MODULE: float(canted)}
    lines = (METHOD, "referential")
    yield View("curves", "", flat, (*swept, HOUR), lines, start=start, colours=METHOD_COLOURS)
    yield View("curves", "", flat, (MODULE,), lines, start=start, colours=METHOD_COLOURS)

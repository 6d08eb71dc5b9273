"""What a reader may turn and switch in a result of the family."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from heliosweep.families.misalignment.figures import AXES, DAYS, HOUR, NOT_SWEPT, aperture
from heliosweep.report.views import HELIOSTAT, View, is_ordered, shown

#: Spots of one kind: to the right of the aim point, above it.
_SPOTS = (
    ("spot_y", "spot_z"),
    ("spot_y_mean", "spot_z_mean"),
    ("spot_y_before", "spot_z_before"),
    ("spot_y_after", "spot_z_after"),
    ("residual_y", "residual_z"),
    ("crossing_y", "crossing_z"),
)

_TYPICAL: dict[str, float | str] = {HOUR: 12.0, "error_scale": 1.0, "axis": "elevation"}

#: As in the figures.
_COLOURS = {name: look["color"] for name, look in AXES.items()}

#: What most readers look for, first.
_FIRST = (
    "least_tolerance",
    "tracking_tolerance",
    "hit_fraction",
    "day_hit_fraction",
    "field_hit_fraction",
    "residual_rms",
)


def views(result: xr.Dataset) -> Iterator[View]:
    """Map of the heliostats, spots on the receiver's plane, and curves over errors and hours."""
    names = sorted(shown(result), key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))
    ordered = [str(dim) for dim in result.sizes if is_ordered(result, str(dim))]
    swept = [dim for dim in ordered if dim not in NOT_SWEPT]
    instants = [dim for dim in (HOUR, *DAYS) if dim in result.sizes]
    words = [str(dim) for dim in result.sizes if dim not in ordered and dim not in NOT_SWEPT]
    yield View("field", "Map of the field", names, (HELIOSTAT,), less=next(iter(words), ""), start=_TYPICAL)
    along = sorted([*swept, *instants], key=lambda dim: (dim != "error_size", dim != HOUR))
    across = {z: y for y, z in _SPOTS}
    yield View(
        "plane",
        "Spots on the receiver's plane",
        list(across),
        along,
        ("axis", HELIOSTAT, *words),
        start=_TYPICAL,
        against=across,
        colours=_COLOURS,
        outline=aperture(result),
        caption="As someone in the field sees the receiver. Dashed: the aperture. At first the view shows the "
        "surroundings of the aperture; points farther off come with the tool that moves the plane.",
    )
    lines = ("axis", *words, HELIOSTAT)
    yield View("curves", "", names, (*along, "spot"), lines, start=_TYPICAL, colours=_COLOURS)
    yield View(
        "curves",
        "Errors of the mount",
        [name for name in names if "parameter" in result[name].dims and "parameter_2" not in result[name].dims],
        ("parameter", *swept, "sample"),
        ("parameters", HELIOSTAT),
        start=_TYPICAL,
    )

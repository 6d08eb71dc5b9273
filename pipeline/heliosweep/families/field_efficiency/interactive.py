"""What a reader may turn and switch in a result of the family."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from heliosweep.families.field_efficiency import variables
from heliosweep.families.field_efficiency.flux import DIMS
from heliosweep.report.views import HELIOSTAT, View, is_ordered

#: The most told of first.
_ORDER = ("optical_efficiency", "cosine_efficiency", "shading_efficiency", "blocking_efficiency")
_LIGHT = ("total_efficiency", *_ORDER, "attenuation_efficiency", "intercept_efficiency", "reflection_efficiency")
_ENERGY = ("energy_per_mirror_area", "receiver_energy", "rank")


def views(result: xr.Dataset) -> Iterator[View]:
    """Map of every heliostat, means of the field over what is swept, and the course of single instants."""
    energy = _ENERGY[0] in result
    said = "Energies are sums, efficiencies means over the period" if energy else "Mean over the period"
    yield View(
        "field",
        "Energy and efficiency of every heliostat" if energy else "Efficiency of every heliostat",
        (*_ENERGY[:1], *_LIGHT, *_ENERGY[1:], *(f"design_point_{name}" for name in _LIGHT)),
        (HELIOSTAT,),
        less="tracking",
        start={"latitude": 0.0},
        caption=f"{said}. Each square is a mirror laid flat with a side towards the tower (triangle)"
        f"{', grey where it is left out' if 'kept' in result else ''}.",
    )
    fields = [f"field_{name}" for name in (*_ENERGY[:1], *_LIGHT, *_ENERGY[1:2])]
    others = [variables.FACTORED, "design_point_power", "hours_used"]
    inner = (HELIOSTAT, "time", "month", *DIMS)
    dims = [str(dim) for dim in result.sizes if dim not in inner and is_ordered(result, str(dim))]
    yield View(
        "curves",
        "Energy and mean efficiency of the field" if energy else "Mean efficiency of the field",
        (*fields, *others),
        sorted(dims, key=lambda dim: dim not in ("latitude", "hour")),
        ("tracking",),
        caption=f"{said} and over the field, weighted by the area of the mirrors.",
    )
    yield View(
        "curves",
        "Energy of the field by month",
        ("monthly_receiver_energy", "monthly_incident_energy"),
        ("month",),
        ("tracking",),
        caption="Incident: direct sunlight on all mirrors with the sun above the horizon.",
    )
    course = ("field_power", "dni", *(f"field_instantaneous_{name}" for name in _LIGHT), "sun_elevation", "sun_azimuth")
    yield View(
        "curves",
        "Power of the field",
        course if "time" in result.coords else (),  # else the instants are in no order
        ("time",),
        ("tracking",),
        caption="At each instant of the study, in universal time.",
    )
    yield View(
        "field",
        "Efficiency of every heliostat at single instants",
        ["instantaneous_power", *(f"instantaneous_{name}" for name in _LIGHT)],
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
    yield View(
        "raster",
        "Flux on the receiver",
        ("flux_map", "energy_flux_map"),
        DIMS,
        less="tracking",
        caption="Mean over each cell. A cylinder is unrolled by the azimuth of its surface, clockwise from north.",
    )
    names = ("peak_flux", "mean_flux", "power_above_limit")
    yield View("curves", "Flux on the receiver over what is swept", names, dims, ("tracking",))

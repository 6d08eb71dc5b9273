"""Efficiencies of a heliostat field over a region of a study's grid, by the exact kernel of shading and blocking."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.families.field_efficiency.variables import EFFICIENCIES, FACTORED, FIELD_MEANS, SERIES
from heliosweep.grid.clock import instant_count
from heliosweep.grid.layout_axis import LayoutAxis, longest, mirror_size, weighted_mean
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.sun import PLACE, Suns, instants_of, sun_attributes
from heliosweep.kernels.field import efficiency, packets
from heliosweep.kernels.warm import warm_field

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.grid.regions import Region

#: Time of one heliostat and instant on one core: with the sun in the zenith, more with the number of mirrors that
#: stand in the way, which grows with 1 / sin^2 of its elevation, up to all of them. Measured on radial staggers. [s]
SECONDS_AT_ZENITH, SECONDS_MORE, MOST_TIMES = 35e-9, 35e-9, 70.0
#: Overhead of a parameter point. [s]
SECONDS_PER_POINT = 100e-6
#: Mirrors around a part that may stand in its way, with a low sun; and what is known of each of the field. [1, bytes]
HALO, BYTES_PER_MIRROR = 5000, 200
#: Points and instants from which the plan estimates the elevation of the sun.
SAMPLED_POINTS, SAMPLED_INSTANTS = 9, 500
#: More instants than this are planned for, but not made, before the plan has agreed.
MAX_INSTANTS = 10**7

_TRACKING = {"spinning_elevation": packets.SPINNING_ELEVATION, "azimuth_elevation": packets.AZIMUTH_ELEVATION}
_SIZES = ("heliostat.width", "heliostat.height")
#: Keys that label a result also where they are not swept.
_LABELS = (
    *("site.latitude", "site.longitude", "time.azimuth", "time.elevation", "tracking"),
    *(*_SIZES, "heliostat.pivot_height", "receiver.height"),
)


def workload(study: FieldEfficiencyStudy) -> Workload:
    """Sizes and cost, for the plan."""
    parameters = Parameters(study)
    heliostats, instants = longest(study), instant_count(study.time)
    inner = {"heliostat": heliostats}
    if study.output.time_series:
        instants = instants_of(parameters).size if instants <= MAX_INSTANTS else instants
        inner = {"time": instants, "heliostat": heliostats}
    layouts = math.prod(len(dim) for dim in study.dimensions() if any(key.startswith("layout.") for key in dim.sweeps))

    def working_bytes(points: int, length: int) -> int:
        # Frames of the heliostats and of those around them that may stand in the way, and who these are.
        frames = min(heliostats, length + HALO) * packets.PACKET * 10 * 8
        return frames + length * 200 * 16 + heliostats * BYTES_PER_MIRROR + 4 * instants * 24

    return Workload(
        parameters=parameters.sizes,
        inner=inner,
        evaluations=heliostats * instants,
        unit="heliostat-instants",
        seconds=_seconds(parameters) * (2 if study.output.time_series else 1),
        splittable="heliostat",
        working_bytes=working_bytes,
        seconds_per_point=SECONDS_PER_POINT,
        coordinate_bytes=8 * (6 * layouts * heliostats + (instants if study.output.time_series else 0)),
        axes={} if study.output.time_series else {"instants": instants},
    )


def _seconds(parameters: Parameters) -> float:
    """Estimate of the time of one heliostat and instant, from the sun at a few points and instants. [s]"""
    if instant_count(parameters.study.time) > MAX_INSTANTS:  # type: ignore[attr-defined]
        return SECONDS_AT_ZENITH + SECONDS_MORE
    places = set(parameters.site_dims)
    step = {dim: max(1, size // SAMPLED_POINTS) if dim in places else size for dim, size in parameters.sizes.items()}
    sampled = Parameters(parameters.study, {dim: slice(None, None, length) for dim, length in step.items()})
    suns = Suns(sampled, SAMPLED_INSTANTS)
    sine = np.concatenate([suns.at(index, place)[:, 2] for index, place in sampled.points(*PLACE)])
    sine = sine[sine > 0]
    if not sine.size:
        return SECONDS_AT_ZENITH
    return float(np.mean(SECONDS_AT_ZENITH + SECONDS_MORE * np.minimum(sine**-2.0 - 1.0, MOST_TIMES)))


def coordinates(study: FieldEfficiencyStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    import xarray as xr

    parameters = Parameters(study)
    labels: dict[str, Any] = {**parameters.coordinates(_LABELS), **LayoutAxis(study).coordinates()}
    if study.output.time_series:
        labels |= instants_of(parameters).coordinates()
    return xr.Dataset(coords=labels, attrs=sun_attributes(study.time))


def prepare(study: FieldEfficiencyStudy) -> tuple[float, bool]:
    """Load or compile the kernels; seconds it took, and whether something was compiled."""
    return warm_field()


def inputs(study: FieldEfficiencyStudy) -> LayoutAxis:
    """Layouts of the study."""
    return LayoutAxis(study)


def compute(study: FieldEfficiencyStudy, layouts: LayoutAxis, region: Region) -> xr.Dataset:
    """Efficiencies of every heliostat of a region: means over the instants, or at each where it has ``time``.

    NaN where a shorter layout is padded, and where the sun is down: at that instant, or always.
    """
    import xarray as xr

    parameters = Parameters(study, region)
    suns, series = Suns(parameters), "time" in region
    span = range(layouts.size)[region.get("heliostat", slice(None))]
    instants = (suns.size,) if series else ()
    result = np.full((len(EFFICIENCIES), *parameters.sizes.values(), *instants, len(span)), np.nan)
    keys = (*_SIZES, "heliostat.pivot_height", "receiver.height", "tracking", *PLACE)
    for index, (width, height, pivot, target, tracking, *place) in parameters.points(*keys):
        layout = layouts.at(parameters.position(index))
        stop = min(span.stop, len(layout))
        if span.start >= stop:
            continue
        half_width, half_height = mirror_size(layout, "width", width) / 2, mirror_size(layout, "height", height) / 2
        mirrors = (layout.x, layout.y, layout.z + pivot, half_width, half_height, target, _TRACKING[tracking])
        sun = suns.at(index, place)
        if series:
            values = efficiency.field_series(*mirrors, sun, span.start, stop)
        else:
            sums, count = efficiency.field_sums(*mirrors, sun, span.start, stop)
            values = (sums / count if count else np.full_like(sums, np.nan)).T
        point: tuple[Any, ...] = (slice(None), *index)
        result[point][..., : stop - span.start] = values
    names, inner = (SERIES, ("time", "heliostat")) if series else (EFFICIENCIES, ("heliostat",))
    return xr.Dataset({name: ((*parameters.sizes, *inner), each) for name, each in zip(names, result, strict=True)})


def finish(study: FieldEfficiencyStudy, layouts: LayoutAxis, region: Region, computed: xr.Dataset) -> xr.Dataset:
    """Means over the heliostats, weighted by mirror area, and the product of three of them."""
    import xarray as xr

    parameters = Parameters(study, region)
    area = np.zeros((*parameters.sizes.values(), layouts.size))
    for index, sizes in parameters.points(*_SIZES):
        layout = layouts.at(parameters.position(index))
        width, height = (mirror_size(layout, *one) for one in zip(("width", "height"), sizes, strict=True))
        area[index][: len(layout)] = width * height
    means = {
        field_name: ((*parameters.sizes,), weighted_mean(computed[name].to_numpy(), area))
        for field_name, name in FIELD_MEANS.items()
    }
    made = xr.Dataset(means)
    factors = (made[f"field_{name}_efficiency"] for name in ("cosine", "shading", "blocking"))
    return made.assign({FACTORED: math.prod(factors)})

"""Efficiencies of a heliostat field over a region of a study's grid, by the exact kernel of shading and blocking."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.sweep import Sweep
from heliosweep.config.times import SunDirections
from heliosweep.families.field_efficiency import energy
from heliosweep.families.field_efficiency.aim import aims
from heliosweep.families.field_efficiency.angles import angles_of, hours_of
from heliosweep.families.field_efficiency.chain import Inputs, Way, months_of, values_of
from heliosweep.families.field_efficiency.flux import cell_seconds, flux_labels, flux_sizes
from heliosweep.families.field_efficiency.flux_sums import FluxSums
from heliosweep.families.field_efficiency.geometry import land_area, mirror_area
from heliosweep.families.field_efficiency.optics import KEYS, label_keys
from heliosweep.families.field_efficiency.values import Field, FieldSums, at_instants
from heliosweep.families.field_efficiency.variables import (
    ANGLE_SERIES,
    ANGLES,
    DESIGN,
    EFFICIENCIES,
    FACTORED,
    FIELD_MEANS,
    MONTHS,
    MOTION,
    OUTLINES,
    PLACES,
    STAGES,
    variables,
)
from heliosweep.grid.clock import instant_count
from heliosweep.grid.layout_axis import LayoutAxis, longest, mirror_size, weighted_mean
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.regions import of_kind, shape_of
from heliosweep.grid.sun import PLACE, Suns, instants_of, sun_attributes
from heliosweep.grid.weather import CAUSES
from heliosweep.kernels import outlines
from heliosweep.kernels.field import efficiency, packets
from heliosweep.kernels.intercept import course
from heliosweep.kernels.warm import warm_field, warm_intercept
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.grid.regions import Region

#: Time of one heliostat and instant on one core: with the sun in the zenith, and more by a power of 1 / sine of its
#: elevation, for more mirrors stand in the way, up to all of them, a time that grows with the root of their number; and
#: likewise with the elevation of the target. Measured on radial staggers of 317 to 100,000 heliostats. [s, 1]
SECONDS_SHADED, SECONDS_BLOCKED, POWER, MOST_SECONDS = 15e-9, 9e-9, 1.5, 45e-9
#: Time of the intercept of one heliostat and direction of the sun, by kind of receiver, of its interpolation to an
#: instant, and of HFLCAL's [s]; part of the instants that are computed because interpolation misses them. [1]
SECONDS_INTERCEPT = {"rectangle": 30e-6, "cavity": 30e-6, "cylinder": 150e-6}
SECONDS_INTERPOLATED, SECONDS_GAUSSIAN, MISSED = 0.3e-6, 40e-9, 0.2
#: Of one value at each instant, what is held of the heliostats of a block; and their least number. [bytes]
BLOCK_BYTES, LEAST_BLOCK = 4 * 2**20, 32
#: Overhead of a parameter point. [s]
SECONDS_PER_POINT = 100e-6
#: Time of the angles of one heliostat at one instant, and of one heliostat whatever the instants. [s]
SECONDS_OF_ANGLES, SECONDS_OF_MOUNT = 200e-9, 100e-6
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


#: Labels of the dimensions beside those of heliostats and instants, and what they are.
_NAMED = {
    "effect": (("shading", "blocking"), "what takes light from the mirror"),
    "stage": (STAGES, "step on the way of the light, in its order, that takes energy"),
    "cause": (CAUSES, "limit beyond which the field does not work"),
}
_NUMBERED = {
    "image": (0, "number of an outline on the mirror, from the largest, from 0"),
    "corner": (0, "number of a corner of an outline, counter-clockwise, from 0"),
    "month": (1, "month of the year"),
}


def workload(study: FieldEfficiencyStudy) -> Workload:
    """Sizes and cost, for the plan."""
    parameters = Parameters(study)
    heliostats, instants = longest(study), instant_count(study.time)
    if instants <= MAX_INSTANTS and (_series(study) or study.weather is not None):
        instants = instants_of(parameters).size
    inner = ({"time": instants} if _series(study) else {}) | {"heliostat": heliostats, **_inner_sizes(study)}
    angles = study.output.tracking_angles
    seconds, lit = _seconds(parameters)
    seconds += angles * (SECONDS_OF_ANGLES + SECONDS_OF_MOUNT / instants)
    layouts = math.prod(len(dim) for dim in study.dimensions() if any(key.startswith("layout.") for key in dim.sweeps))
    method = None if study.optics is None else study.optics.method
    methods = method.values() if isinstance(method, Sweep) else (method,)
    if "accurate" in methods:
        few = isinstance(study.time, SunDirections) or instants * lit < 2 * course.COMPUTED
        share = lit if few else course.COMPUTED / instants + MISSED * lit
        seconds += SECONDS_INTERPOLATED * lit + SECONDS_INTERCEPT[str(study.receiver.kind)] * share
    elif method is not None:
        seconds += SECONDS_GAUSSIAN * lit
    seconds += cell_seconds(study, instants) / instants
    split = "" if study.output.flux_map is not None else "heliostat"  # maps are sums over the field

    def working_bytes(points: int, length: int) -> int:
        length = length if split else heliostats
        # Frames of the heliostats and of those around them that may stand in the way, and who these are.
        frames = min(heliostats, length + HALO) * packets.PACKET * 10 * 8
        held = 8 if _series(study) else 4 * _complete(study)
        block = held * min(BLOCK_BYTES, 8 * instants * heliostats)
        each = 4 * (24 + 40 * angles) + 200 * (study.weather is not None)
        return frames + length * 200 * 16 + heliostats * BYTES_PER_MIRROR + each * instants + block

    return Workload(
        parameters=parameters.sizes,
        inner=inner,
        evaluations=heliostats * instants,
        unit="heliostat-instants",
        seconds=seconds * (2 if _series(study) else 1),
        splittable=split,
        working_bytes=working_bytes,
        seconds_per_point=SECONDS_PER_POINT,
        coordinate_bytes=8 * (6 * layouts * heliostats + _series(study) * instants),
        axes={} if _series(study) else {"instants": instants},
    )


def _seconds(parameters: Parameters) -> tuple[float, float]:
    """Estimate of the time of one heliostat and instant [s], and share of the instants with the sun up.

    From the sun, and with weather from the instants at which the field works, at a few points and instants.
    """
    study: Any = parameters.study
    most, blocked = MOST_SECONDS * math.sqrt(longest(study)), _seconds_blocked(parameters)
    if instant_count(study.time) > MAX_INSTANTS:
        return 2 * SECONDS_SHADED + blocked, 1.0
    places = set(parameters.site_dims)
    step = {dim: max(1, size // SAMPLED_POINTS) if dim in places else size for dim, size in parameters.sizes.items()}
    sampled = Parameters(study, {dim: slice(None, None, length) for dim, length in step.items()})
    if study.weather is None:
        suns = Suns(sampled, SAMPLED_INSTANTS)
        sine = np.concatenate([suns.at(index, place)[:, 2] for index, place in sampled.points(*PLACE)])
    else:
        days = energy.Days(sampled, Suns(sampled))
        sine = np.concatenate([days.at(*point).sun[:, 2] for point in energy.points(sampled)])
    lit = sine[sine > 0]
    if not lit.size:
        return SECONDS_SHADED, 1.0
    each = np.minimum(SECONDS_SHADED * lit**-POWER, max(most, SECONDS_SHADED)) + blocked
    return float(each.sum() / sine.size), lit.size / sine.size


def _seconds_blocked(parameters: Parameters) -> float:
    """Estimate of the part of the time of one heliostat and instant that blocking takes [s].

    From the elevation of the target seen from some heliostats, of the layout in the middle where several are swept.
    """
    layouts = Layouts(parameters.study)
    layout = layouts[tuple(len(dim) // 2 for dim in layouts.dimensions)]
    some = slice(None, None, 1 + len(layout) // SAMPLED_INSTANTS)
    heights, pivots = (parameters.values(key) for key in ("receiver.height", "heliostat.pivot_height"))
    assert heights is not None
    assert pivots is not None
    rise = np.unique(heights - pivots)[:, np.newaxis] - layout.z[some]
    sine = np.maximum(rise, 0.0) / np.hypot(np.hypot(layout.x[some], layout.y[some]), rise)
    most = MOST_SECONDS * math.sqrt(len(layout))
    with np.errstate(divide="ignore"):
        return float(np.minimum(SECONDS_BLOCKED * (sine**-POWER - 1.0), most).mean())


def coordinates(study: FieldEfficiencyStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    import xarray as xr

    parameters = Parameters(study)
    labels: dict[str, Any] = {
        **parameters.coordinates((*_LABELS, *label_keys(study))),
        **LayoutAxis(study).coordinates(),
    }
    for dim, size in _inner_sizes(study).items():
        if dim in _NAMED:
            values, words = _NAMED[dim]
            labels[dim] = (dim, np.array(values, object), {"long_name": words})
        elif dim in _NUMBERED:
            first, words = _NUMBERED[dim]
            labels[dim] = (dim, np.arange(first, first + size), {"long_name": words, "units": "1"})
    if _series(study):
        labels |= instants_of(parameters).coordinates()
    labels |= flux_labels(study)
    return xr.Dataset(coords=labels, attrs=sun_attributes(study.time))


def _series(study: FieldEfficiencyStudy) -> bool:
    """Whether the result has values at each instant."""
    return study.output.time_series or study.output.field_series


def _inner_sizes(study: FieldEfficiencyStudy) -> dict[str, int]:
    """Lengths of the dimensions beside those of heliostats and instants, where a result has them."""
    sizes: dict[str, int] = {}
    if study.output.outlines:
        sizes |= {"effect": 2, "image": study.output.outlines, "corner": outlines.CORNERS}
    if study.weather is not None:
        sizes |= {"month": MONTHS, "stage": len(STAGES), "cause": len(CAUSES)}
    return sizes | flux_sizes(study)


def prepare(study: FieldEfficiencyStudy) -> tuple[float, bool]:
    """Load or compile the kernels; seconds it took, and whether something was compiled."""
    seconds, fresh = warm_field(bool(study.output.outlines))
    if study.optics is None:
        return seconds, fresh
    more, also = warm_intercept(study.output.flux_map is not None)
    return seconds + more, fresh or also


def inputs(study: FieldEfficiencyStudy) -> Inputs:
    """Layouts of the study, and the contents of its other files."""
    return Inputs(study)


def compute(study: FieldEfficiencyStudy, layouts: Inputs, region: Region) -> xr.Dataset:
    """Efficiencies and energies of every heliostat of a region, or values at each instant where it has ``time``.

    NaN where a shorter layout is padded, and where the sun is down: at that instant, or always. With them, where the
    study asks for them, angles of the mounts and outlines of shadows.
    """
    import xarray as xr

    parameters, series = Parameters(study, region), "time" in region
    around = {dim: part for dim, part in region.items() if dim != "time"}
    complete = _complete(study)
    suns = Suns(Parameters(study, around) if complete else parameters)
    part = parameters.part("time") if complete else slice(None)
    days = None if study.weather is None else energy.Days(Parameters(study, around), suns)
    span = range(layouts.size)[region.get("heliostat", slice(None))]
    wanted = of_kind(variables(study), "series" if series else "points")
    instants = len(range(suns.size)[part])
    sizes = {**Parameters(study).sizes, "time": instants, "heliostat": layouts.size, **_inner_sizes(study)}
    made = {name: np.full(shape_of(one, around, sizes), np.nan) for name, one in wanted.items()}
    mount = ("heliostat.pivot_height", "receiver.height", "aim.levels", "tracking")
    keys = (*_SIZES, *mount, *PLACE, *energy.LIMITS, *KEYS)
    for index, (width, height, pivot, target, levels, tracking, *rest) in parameters.points(*keys):
        place, limits, optics = rest[: len(PLACE)], rest[len(PLACE) : -len(KEYS)], rest[-len(KEYS) :]
        layout = layouts.at(parameters.position(index))
        stop = min(span.stop, len(layout))
        if span.start >= stop:
            continue
        sides = mirror_size(layout, "width", width), mirror_size(layout, "height", height)
        mirrors = (layout.x, layout.y, layout.z + pivot, sides[0] / 2, sides[1] / 2, target, _TRACKING[tracking])
        way = None
        if study.optics is not None:
            way = Way(study, layouts, layout, values_of(optics))
            mirrors = (*mirrors[:5], aims(way, mirrors, levels), mirrors[6])
        there, sums = suns.at(index, place), FieldSums()
        hours = None if days is None else days.at(index, place, limits)
        months = None
        if study.optics is not None and study.optics.cleanliness_by_month is not None:
            months = months_of(parameters, index, place[1]) if hours is None else hours.month
        area = mirror_area(*sides, study.heliostat.facets)
        field = Field(study, mirrors, area, place, months, way)
        sun, now = there if hours is None else hours.sun, there[part]
        flux = FluxSums(field, sun if hours is None else hours)
        for start, end in _blocks(study, len(sun), span.start, stop):
            if series:
                values = field.series(sun, part, hours, start, end)
                if study.output.field_series or hours is not None:
                    sums.add(values, field.area[start:end])
            else:
                lit = None if hours is None else field.light(sun, start, end, months)
                values = field.means(sun, start, end) if hours is None else field.energies(hours, lit, start, end)
                values |= {} if study.design_point is None else field.design(start, end)
                flux.add(values, lit, start, end)
            _put(made, values, index, slice(start - span.start, end - span.start))
        _put(made, sums.means() | (at_instants(now, hours, part) if series else flux.values()), index)
        if study.output.tracking_angles:
            directions = isinstance(study.time, SunDirections)
            over_time: tuple[str, ...] = ANGLES if directions else MOTION
            towards = efficiency.aimed(*mirrors[:6]).aim[span.start : stop]
            over = None if series or directions else hours_of(parameters, index)
            angles = angles_of(towards, now, mirrors[6], over, series)
            named = dict(zip(ANGLE_SERIES if series else over_time, angles, strict=True))
            _put(made, named, index, slice(0, stop - span.start))
        if study.output.outlines and not series:
            found = outlines.mirror_outlines(*mirrors, now[0], span.start, stop, study.output.outlines)
            for name, values in zip(OUTLINES, (*np.moveaxis(found.corners, -1, 0), *found[1:]), strict=True):
                made[name][index][: stop - span.start] = values
    return xr.Dataset({name: (wanted[name].dims, each) for name, each in made.items()})


def _put(made: dict[str, np.ndarray], values: Mapping[str, np.ndarray], index: Any, *part: slice) -> None:
    """Write those of the values that are wanted, at a point and part of the heliostats, the last dimension."""
    for name in values.keys() & made.keys():
        made[name][(*index, ..., *part)] = values[name]


def _complete(study: FieldEfficiencyStudy) -> bool:
    """True where all instants are looked at together, in blocks of heliostats: interpolated, weighted or summed."""
    return study.optics is not None or study.weather is not None or study.output.field_series


def _blocks(study: FieldEfficiencyStudy, instants: int, start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Heliostats that are computed at a time: all, or so many that their values at all instants are not too much."""
    length = max(LEAST_BLOCK, BLOCK_BYTES // (8 * max(instants, 1))) if _complete(study) else stop - start
    return ((first, min(first + length, stop)) for first in range(start, stop, length))


def finish(study: FieldEfficiencyStudy, layouts: LayoutAxis, region: Region, computed: xr.Dataset) -> xr.Dataset:
    """Means and sums over the heliostats, weighted by mirror area; the size of the field."""
    import xarray as xr

    parameters = Parameters(study, region)
    area = np.zeros((*parameters.sizes.values(), layouts.size))
    places = np.full((len(PLACES), *area.shape), np.nan)
    land, lands = np.zeros(area.shape[:-1]), dict[tuple[int, float], float]()
    for index, (width, height, pivot, target) in parameters.points(
        *_SIZES, "heliostat.pivot_height", "receiver.height"
    ):
        layout = layouts.at(parameters.position(index))
        sides = mirror_size(layout, "width", width), mirror_size(layout, "height", height)
        area[index][: len(layout)] = mirror_area(*sides, study.heliostat.facets)
        if study.output.field_geometry:
            distance = np.hypot(layout.x, layout.y)
            elevation = np.degrees(np.arctan2(target - layout.z - pivot, distance))
            places[0][index][: len(layout)], places[1][index][: len(layout)] = distance, elevation
            key = id(layout), float(np.hypot(*sides).max() / 2)
            if key not in lands:
                lands[key] = land_area(layout.x, layout.y, key[1])
            land[index] = lands[key]
    later = {name: one.dims for name, one in variables(study).items() if one.finished}
    made = {name: weighted_mean(computed[of].to_numpy(), area) for name, of in FIELD_MEANS.items() if name in later}
    cosine, shading, blocking = (made[f"field_{name}"] for name in EFFICIENCIES[:3])
    made[FACTORED] = cosine * shading * blocking
    mirrors = area.sum(axis=-1)
    made |= {"field_heliostats": (area > 0).sum(axis=-1).astype(float), "field_mirror_area": mirrors}
    if study.output.field_geometry:
        made |= {"field_land_area": land, "field_packing_factor": mirrors / land}
        made |= {"field_mean_radius": weighted_mean(places[0], area), **dict(zip(PLACES, places, strict=True))}
    if study.weather is not None:
        made |= energy.of_field(parameters, computed, area)
    if study.design_point is not None:
        total = made[f"field_{DESIGN[-1] if study.optics is not None else DESIGN[len(EFFICIENCIES) - 1]}"]
        made["design_point_power"] = total * mirrors * study.design_point.dni * 1e-6
    return xr.Dataset({name: (dims, made[name]) for name, dims in later.items()})

"""Efficiencies of a heliostat field over a region of a study's grid, by the exact kernel of shading and blocking."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.times import CivilTime, SunDirections
from heliosweep.families.field_efficiency.angles import courses, motion, tracking_angles
from heliosweep.families.field_efficiency.chain import light
from heliosweep.families.field_efficiency.geometry import land_area
from heliosweep.families.field_efficiency.optics import KEYS
from heliosweep.families.field_efficiency.variables import (
    ANGLE_SERIES,
    ANGLES,
    EFFICIENCIES,
    FACTORED,
    FIELD_MEANS,
    LIGHT,
    LIGHT_MEANS,
    LIGHT_SERIES,
    MOTION,
    OUTLINES,
    PLACES,
    SERIES,
    SIZES,
)
from heliosweep.grid.clock import instant_count
from heliosweep.grid.layout_axis import LayoutAxis, longest, mirror_size, weighted_mean
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.sun import PLACE, Suns, instants_of, sun_attributes
from heliosweep.kernels import outlines
from heliosweep.kernels.field import efficiency, packets
from heliosweep.kernels.intercept import course
from heliosweep.kernels.warm import warm_field, warm_intercept

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.grid.regions import Region

#: Time of one heliostat and instant on one core: with the sun in the zenith, more with the number of mirrors that
#: stand in the way, which grows with 1 / sin^2 of its elevation, up to all of them. Measured on radial staggers. [s]
SECONDS_AT_ZENITH, SECONDS_MORE, MOST_TIMES = 35e-9, 35e-9, 70.0
#: Time of the intercept of one heliostat and direction of the sun, and of its interpolation to an instant. [s]
SECONDS_INTERCEPT, SECONDS_INTERPOLATED = 60e-6, 0.3e-6
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


#: Labels of the dimensions of outlines.
EFFECTS = ("shading", "blocking")
_NUMBERED = {
    "image": "number of an outline on the mirror, from the largest, from 0",
    "corner": "number of a corner of an outline, counter-clockwise, from 0",
}


def workload(study: FieldEfficiencyStudy) -> Workload:
    """Sizes and cost, for the plan."""
    parameters = Parameters(study)
    heliostats, instants = longest(study), instant_count(study.time)
    inner = {"heliostat": heliostats}
    if study.output.time_series:
        instants = instants_of(parameters).size if instants <= MAX_INSTANTS else instants
        inner = {"time": instants, "heliostat": heliostats}
    inner |= _outline_sizes(study)
    angles = study.output.tracking_angles
    seconds = _seconds(parameters) + angles * (SECONDS_OF_ANGLES + SECONDS_OF_MOUNT / instants)
    layouts = math.prod(len(dim) for dim in study.dimensions() if any(key.startswith("layout.") for key in dim.sweeps))

    seconds, lit = _seconds(parameters), study.optics is not None
    if lit:
        computed = 1.0 if isinstance(study.time, SunDirections) else min(1.0, course.COMPUTED / max(instants, 1))
        seconds += SECONDS_INTERPOLATED + SECONDS_INTERCEPT * computed

    def working_bytes(points: int, length: int) -> int:
        # Frames of the heliostats and of those around them that may stand in the way, and who these are.
        frames = min(heliostats, length + HALO) * packets.PACKET * 10 * 8
        return frames + length * 200 * 16 + heliostats * BYTES_PER_MIRROR + 4 * instants * (24 + 40 * angles)

    return Workload(
        parameters=parameters.sizes,
        inner=inner,
        evaluations=heliostats * instants,
        unit="heliostat-instants",
        seconds=seconds * (2 if study.output.time_series else 1),
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
    for dim, size in _outline_sizes(study).items():
        values, words = (
            (EFFECTS, "what takes light from the mirror") if dim == "effect" else (range(size), _NUMBERED[dim])
        )
        units = {} if dim == "effect" else {"units": "1"}
        labels[dim] = (dim, np.array(values, object if dim == "effect" else np.int64), {"long_name": words, **units})
    if study.output.time_series:
        labels |= instants_of(parameters).coordinates()
    return xr.Dataset(coords=labels, attrs=sun_attributes(study.time))


def _outline_sizes(study: FieldEfficiencyStudy) -> dict[str, int]:
    """Lengths of the dimensions of outlines, where they are asked for."""
    if not study.output.outlines:
        return {}
    return {"effect": len(EFFECTS), "image": study.output.outlines, "corner": outlines.CORNERS}


def prepare(study: FieldEfficiencyStudy) -> tuple[float, bool]:
    """Load or compile the kernels; seconds it took, and whether something was compiled."""
    seconds, fresh = warm_field(bool(study.output.outlines))
    if study.optics is None:
        return seconds, fresh
    more, also = warm_intercept()
    return seconds + more, fresh or also


def inputs(study: FieldEfficiencyStudy) -> LayoutAxis:
    """Layouts of the study."""
    return LayoutAxis(study)


def compute(study: FieldEfficiencyStudy, layouts: LayoutAxis, region: Region) -> xr.Dataset:
    """Efficiencies of every heliostat of a region: means over the instants, or at each where it has ``time``.

    NaN where a shorter layout is padded, and where the sun is down: at that instant, or always. With them, where the
    study asks for them, angles of the mounts and outlines of shadows.
    """
    import xarray as xr

    parameters = Parameters(study, region)
    suns, series = Suns(parameters), "time" in region
    span = range(layouts.size)[region.get("heliostat", slice(None))]
    names, angles = (SERIES, ANGLE_SERIES) if series else (EFFICIENCIES, _angle_names(study))
    if study.optics is not None:
        names += LIGHT_SERIES if series else LIGHT
        all_suns = Suns(Parameters(study, {dim: part for dim, part in region.items() if dim != "time"}))
    if not study.output.tracking_angles:
        angles = ()
    outlined = {} if series else _outline_sizes(study)
    dims = ("time", "heliostat") if series else ("heliostat",)
    instants = (suns.size,) if series else ()
    result = np.full((len(names) + len(angles), *parameters.sizes.values(), *instants, len(span)), np.nan)
    shapes = {name: tuple(outlined[dim] for dim in ("effect", *OUTLINES[name][0])) for name in OUTLINES if outlined}
    drawn = {name: np.full((*parameters.sizes.values(), len(span), *shape), np.nan) for name, shape in shapes.items()}
    keys = (*_SIZES, "heliostat.pivot_height", "receiver.height", "receiver.radius", "tracking", *PLACE, *KEYS)
    for index, (width, height, pivot, target, radius, tracking, *rest) in parameters.points(*keys):
        place, radius = rest[: len(PLACE)], radius or 0.0
        layout = layouts.at(parameters.position(index))
        stop = min(span.stop, len(layout))
        if span.start >= stop:
            continue
        half_width, half_height = mirror_size(layout, "width", width) / 2, mirror_size(layout, "height", height) / 2
        mirrors = (layout.x, layout.y, layout.z + pivot, half_width, half_height, target, _TRACKING[tracking])
        sun = suns.at(index, place)
        kept = lit = None
        if study.optics is not None:
            lit = light(
                study, mirrors, radius, all_suns.at(index, place), place[0], rest[len(PLACE) :], span.start, stop
            )
            lit = lit._replace(intercept=lit.intercept[:, parameters.part("time")] if series else lit.intercept)
            kept = lit.intercept * (lit.transmitted * lit.reflected)[:, np.newaxis]
        if series:
            values = efficiency.field_series(*mirrors, sun, span.start, stop, radius)
            if lit is not None and kept is not None:
                values = np.concatenate((values, [lit.intercept.T, values[3] * kept.T]))
        else:
            sums, count = efficiency.field_sums(*mirrors, sun, span.start, stop, radius, kept)
            values = (sums / count if count else np.full_like(sums, np.nan)).T
            if lit is not None:
                mean = np.nansum(lit.intercept, axis=1) / (count or np.nan)
                values = np.stack((*values[:4], mean, lit.transmitted, lit.reflected, values[4]))
        point: tuple[Any, ...] = (slice(None), *index)
        result[point][: len(names), ..., : stop - span.start] = values
        if angles:
            aims = efficiency.aimed(*mirrors[:6], radius).aim[span.start : stop]
            hours = None if series or angles == ANGLES else _hours(parameters, index)
            result[point][len(names) :, ..., : stop - span.start] = _angles(aims, sun, mirrors[6], hours, series)
        if outlined:
            found = outlines.mirror_outlines(*mirrors, sun[0], span.start, stop, outlined["image"])
            for name, values in zip(OUTLINES, (*np.moveaxis(found.corners, -1, 0), *found[1:]), strict=True):
                drawn[name][index][: stop - span.start] = values
    made = {name: ((*parameters.sizes, *dims), each) for name, each in zip((*names, *angles), result, strict=True)}
    for name, each in drawn.items():
        made[name] = ((*parameters.sizes, "heliostat", "effect", *OUTLINES[name][0]), each)
    return xr.Dataset(made)


def _angle_names(study: FieldEfficiencyStudy) -> tuple[str, ...]:
    return ANGLES if isinstance(study.time, SunDirections) else MOTION


def _hours(parameters: Parameters, index: tuple[int, ...]) -> tuple[np.ndarray, float]:
    """Times of all instants at a point [h], and the longest step between two that follow each other in a day. [h]"""
    time, instants = parameters.study.time, instants_of(parameters)  # type: ignore[attr-defined]
    if not isinstance(time, CivilTime):
        return instants.labels["solar_hour"].values, np.inf
    sites = list(parameters.sizes)
    here = instants.at_sites(index[sites.index("site")]) if "site" in sites else instants
    stamps = here.labels["utc"].values
    return (stamps - stamps[0]) / np.timedelta64(1, "h"), time.window_seconds()[2] / 3600


def _angles(
    aims: np.ndarray, sun: np.ndarray, tracking: int, hours: tuple[np.ndarray, float] | None, series: bool
) -> np.ndarray:
    """Angles of mounts, the last axis: at each instant, over the period where `hours` are given, or at the only one."""
    course = None if hours is None else courses(*hours, sun)
    found = []
    for aim in aims:
        both = tracking_angles(aim, sun, tracking)
        if course is not None:
            found.append(np.concatenate([motion(angle, course) for angle in both]))
        else:
            found.append(both if series else both[:, 0])
    return np.stack(found, axis=-1)


def finish(study: FieldEfficiencyStudy, layouts: LayoutAxis, region: Region, computed: xr.Dataset) -> xr.Dataset:
    """Means over the heliostats, weighted by mirror area, and the product of three of them; the size of the field."""
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
        area[index][: len(layout)] = sides[0] * sides[1]
        if study.output.field_geometry:
            distance = np.hypot(layout.x, layout.y)
            elevation = np.degrees(np.arctan2(target - layout.z - pivot, distance))
            places[0][index][: len(layout)], places[1][index][: len(layout)] = distance, elevation
            key = id(layout), float(np.hypot(*sides).max() / 2)
            if key not in lands:
                lands[key] = land_area(layout.x, layout.y, key[1])
            land[index] = lands[key]
    means = {
        field_name: ((*parameters.sizes,), weighted_mean(computed[name].to_numpy(), area))
        for field_name, name in {**FIELD_MEANS, **(LIGHT_MEANS if study.optics is not None else {})}.items()
    }
    made = xr.Dataset(means)
    factors = (made[f"field_{name}_efficiency"] for name in ("cosine", "shading", "blocking"))
    made = made.assign({FACTORED: math.prod(factors)})
    if not study.output.field_geometry:
        return made
    mirrors = area.sum(axis=-1)
    sizes = ((area > 0).sum(axis=-1).astype(float), mirrors, land, mirrors / land, weighted_mean(places[0], area))
    made = made.assign(
        {name: ((*parameters.sizes, "heliostat"), each) for name, each in zip(PLACES, places, strict=True)}
    )
    return made.assign({name: ((*parameters.sizes,), each) for name, each in zip(SIZES, sizes, strict=True)})

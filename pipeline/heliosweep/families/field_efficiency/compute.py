"""Efficiencies of a heliostat field over a region of a study's grid, by the exact kernel of shading and blocking."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.sweep import ends
from heliosweep.config.times import SunDirections
from heliosweep.families.field_efficiency import energy, known
from heliosweep.families.field_efficiency.aim import aims
from heliosweep.families.field_efficiency.angles import angles_of, hours_of
from heliosweep.families.field_efficiency.chain import FIELDS, Inputs, Way, months_of, values_of
from heliosweep.families.field_efficiency.flux import flux_labels, flux_sizes
from heliosweep.families.field_efficiency.flux_sums import FluxSums
from heliosweep.families.field_efficiency.optics import KEYS, label_keys
from heliosweep.families.field_efficiency.selection import Kept, select
from heliosweep.families.field_efficiency.values import Field, FieldSums, at_instants, land_area, mirror_area
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
from heliosweep.grid.clock import MAX_INSTANTS, instant_count
from heliosweep.grid.layout_axis import LayoutAxis, longest, mirror_size, weighted_mean
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.regions import of_kind, shape_of
from heliosweep.grid.sun import PLACE, Suns, instants_of, sun_attributes
from heliosweep.grid.weather import CAUSES, LIMITS
from heliosweep.kernels import outlines
from heliosweep.kernels.field import efficiency, packets
from heliosweep.kernels.warm import warm_field, warm_intercept
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.grid.regions import Region
    from heliosweep.layouts.layout import Layout

#: Of one value at each instant, what is held of the heliostats of a block; and their least number. [bytes]
BLOCK_BYTES, LEAST_BLOCK = 4 * 2**20, 32
#: Mirrors around a part that may stand in its way, with a low sun; and what is known of each of the field. [1, bytes]
HALO, BYTES_PER_MIRROR = 5000, 200
#: What is kept of each mirror of each of the fields whose tables are kept. [bytes]
BYTES_OF_TABLE = 8 * 8
_TRACKING = {"spinning_elevation": packets.SPINNING_ELEVATION, "azimuth_elevation": packets.AZIMUTH_ELEVATION}
_SIZES = ("heliostat.width", "heliostat.height")
_KEEP = ("keep.heliostats", "keep.field_power", "keep.by")
#: Keys that label a result also where they are not swept.
_LABELS = (
    *("site.latitude", "site.longitude", "time.azimuth", "time.elevation", "tracking"),
    *(*_SIZES, "heliostat.pivot_height", "receiver.height", *_KEEP),
)


#: Keys that move neither mirrors nor the sun.
_FIXED_FIELD = ("optics.", "weather.", "limits.")

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
    layouts, kept_bytes = len(Layouts(study)), 0
    angles, held_bytes = study.output.tracking_angles, _shared_bytes(study, heliostats)
    if study.optics is not None and "accurate" in ends(study.optics.method):
        kept_bytes = min(FIELDS, math.prod(parameters.sizes.values())) * heliostats * BYTES_OF_TABLE
    # Maps are sums over the field, and which heliostats are kept follows from all.
    split = "heliostat" if study.output.flux_map is None and study.keep is None else ""

    def working_bytes(points: int, length: int) -> int:
        length = length if split else heliostats
        # Frames of the heliostats and of those around them that may stand in the way, and who these are.
        frames = min(heliostats, length + HALO) * packets.PACKET * 10 * 8
        held = 8 if _series(study) else 4 * _complete(study)
        block = held * min(BLOCK_BYTES, 8 * instants * heliostats)
        each = 4 * (24 + 40 * angles) + 200 * (study.weather is not None)
        return frames + length * 200 * 16 + heliostats * BYTES_PER_MIRROR + each * instants + block + held_bytes

    return Workload(
        parameters=parameters.sizes,
        inner=inner,
        evaluations=heliostats * instants,
        unit="heliostat-instants",
        splittable=split,
        working_bytes=working_bytes,
        coordinate_bytes=8 * (6 * layouts * heliostats + _series(study) * instants),
        axes={} if _series(study) else {"instants": instants},
        fixed_bytes=kept_bytes,
    )


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
    return xr.Dataset(coords=labels, attrs={**sun_attributes(study.time), **Layouts(study).areas()})


def _shared_bytes(study: FieldEfficiencyStudy, heliostats: int) -> int:
    """Memory for what points with the same mirrors and sun share; 0 where they do not follow each other. [bytes]

    They do where the last dimension moves neither, or where each draw differs from the one before in few keys.
    """
    moving = _moving(study)
    if all(moving) or study.weather is None or study.keep is not None:
        return 0
    if any(moving) and (study.sample is None or study.sample.sensitivity is None):
        return 0
    each = known.BYTES * heliostats * instant_count(study.time)
    return each if each <= known.MOST_BYTES else 0


def _moving(study: FieldEfficiencyStudy) -> list[bool]:
    """Which keys of the last dimension move mirrors or the sun; none where nothing is swept."""
    keys = [key for dim in study.dimensions()[-1:] for key in dim.sweeps]
    return [not key.startswith(_FIXED_FIELD) or key == "weather.file" for key in keys]


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
    flux_map, shared = study.output.flux_map is not None, _shared_bytes(study, longest(study)) > 0
    meanwhile = [] if study.optics is None else [f"warm_intercept({flux_map})"]
    seconds, fresh = warm_field(bool(study.output.outlines), shared, meanwhile)
    if study.optics is None:
        return seconds, fresh
    more, also = warm_intercept(flux_map)
    return seconds + more, fresh or also


inputs = Inputs


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
    shared = _shared_bytes(study, layouts.size) > 0
    mount = ("heliostat.pivot_height", "receiver.height", "aim.levels", "tracking", *_KEEP)
    keys = (*_SIZES, *mount, *PLACE, *LIMITS, *KEYS)
    for index, (width, height, pivot, target, levels, tracking, number, power, by, *rest) in parameters.points(*keys):
        place, limits, optics = rest[: len(PLACE)], rest[len(PLACE) : -len(KEYS)], rest[-len(KEYS) :]
        layout = layouts.at(parameters.position(index))
        if span.start >= len(layout):
            continue
        there, sums = suns.at(index, place), FieldSums()
        hours = None if days is None else days.at(index, place, limits)
        months = None
        if study.optics is not None and study.optics.cleanliness_by_month is not None:
            months = months_of(parameters, index, place[1]) if hours is None else hours.month
        sun, now = there if hours is None else hours.sun, there[part]

        field_of = partial(
            _field, study, layouts, sizes=(width, height), at=(pivot, target, levels, tracking), optics=optics,
            place=place, months=months,
        )  # fmt: skip
        kept: Kept | None = None
        if study.keep is not None:
            blocks = _blocks(study, len(sun), 0, len(layout))
            choose = partial(select, (number, power, by), layout, field_of, sun, hours, months, blocks)
            kept = layouts.last("kept", tuple(parameters.position(index).values()), choose)
            told = {"kept": np.isin(np.arange(len(layout)), kept.rows), "selection_rank": kept.rank}
            _put(made, told, index, slice(len(layout)))
            layout = layout.part(kept.rows)
        field = field_of(layout)
        if shared:
            field = field._replace(shared=layouts.shared_field(layout, field.mirrors))
        stop, mirrors = min(span.stop, len(layout)), field.mirrors
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
            _put(made, values, index, kept.rows[start:end] if kept else slice(start - span.start, end - span.start))
        _put(made, sums.means() | (at_instants(now, hours, part) if series else flux.values()), index)
        if study.output.tracking_angles:
            directions = isinstance(study.time, SunDirections)
            over_time: tuple[str, ...] = ANGLES if directions else MOTION
            towards = efficiency.aimed(*mirrors[:6]).aim[span.start : stop]
            over = None if series or directions else hours_of(parameters, index)
            angles = angles_of(towards, now, mirrors[6], over, series)
            named = dict(zip(ANGLE_SERIES if series else over_time, angles, strict=True))
            _put(made, named, index, kept.rows if kept else slice(0, stop - span.start))
        if study.output.outlines and not series:
            found = outlines.mirror_outlines(*mirrors, now[0], span.start, stop, study.output.outlines)
            for name, values in zip(OUTLINES, (*np.moveaxis(found.corners, -1, 0), *found[1:]), strict=True):
                made[name][index][: stop - span.start] = values
    return xr.Dataset({name: (wanted[name].dims, each) for name, each in made.items()})


def _field(
    study: FieldEfficiencyStudy,
    inputs: Inputs,
    layout: Layout,
    sizes: Any,
    at: Any,
    optics: Any,
    place: Any,
    months: Any,
) -> Field:
    """The field of a layout at a point of the result.

    `sizes` are width and height of the mirrors, `at` the values of pivot height, receiver height, levels of aim and
    tracking, `optics` those of `optics.KEYS`.
    """
    pivot, target, levels, tracking = at
    sides = mirror_size(layout, "width", sizes[0]), mirror_size(layout, "height", sizes[1])
    mirrors = (layout.x, layout.y, layout.z + pivot, sides[0] / 2, sides[1] / 2, target, _TRACKING[tracking])
    way = None
    if study.optics is not None:
        way = Way(study, inputs, layout, values_of(optics))
        mirrors = (*mirrors[:5], aims(way, mirrors, levels), mirrors[6])
    made, area = (efficiency.sorted_field(*mirrors[:6]), mirrors[6]), mirror_area(*sides, study.heliostat.facets)
    return Field(study, mirrors, made, area, place, months, way)


def _put(made: dict[str, np.ndarray], values: Mapping[str, np.ndarray], index: Any, part: Any = None) -> None:
    """Write those of the values that are wanted, at a point and part of the heliostats, the last dimension."""
    for name in values.keys() & made.keys():
        if part is None:
            made[name][(*index, ...)] = values[name]
        else:
            made[name][index][..., part] = values[name]


def _complete(study: FieldEfficiencyStudy) -> bool:
    """True where all instants are looked at together, in blocks of heliostats: interpolated, weighted or summed."""
    output, kept = study.output, study.keep is not None
    return study.optics is not None or study.weather is not None or output.field_series or kept


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
    land, lands = np.zeros(area.shape[:-1]), dict[tuple[tuple[int, ...], float], float]()
    for index, (width, height, pivot, target) in parameters.points(
        *_SIZES, "heliostat.pivot_height", "receiver.height"
    ):
        layout = layouts.at(parameters.position(index))
        sides = mirror_size(layout, "width", width), mirror_size(layout, "height", height)
        area[index][: len(layout)] = mirror_area(*sides, study.heliostat.facets)
        rows: Any = slice(len(layout))
        if study.keep is not None:
            area[index] *= computed["kept"].to_numpy()[index] == 1
            rows = np.flatnonzero(area[index])
            layout = layout.part(rows)
        if study.output.field_geometry:
            distance = np.hypot(layout.x, layout.y)
            elevation = np.degrees(np.arctan2(target - layout.z - pivot, distance))
            places[0][index][rows], places[1][index][rows] = distance, elevation
            key = (index if study.keep else (id(layout),)), float(np.hypot(*sides).max() / 2)
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


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Remarks on a finished result: fields that have not the power for which heliostats were to be kept."""
    if "kept_power" in result.coords:
        short = (result["design_point_power"] < result["kept_power"]).to_numpy()
        if short.any():
            most = float(result["design_point_power"].where(short).max())
            yield (
                f"{int(short.sum()):,} of {short.size:,} fields have less than keep.field_power, {most:.4g} MW at the "
                "most, though all heliostats are kept: generate more"
            )

"""Efficiencies of a heliostat field over a region of a study's grid: by rays with optics, else by exact polygons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.times import SunDirections
from heliosweep.families.field_efficiency import energy
from heliosweep.families.field_efficiency.aim import aims
from heliosweep.families.field_efficiency.angles import angles_of, hours_of
from heliosweep.families.field_efficiency.chain import Geometry, Inputs, Way, months_of, values_of
from heliosweep.families.field_efficiency.flux import flux_labels, flux_sizes
from heliosweep.families.field_efficiency.optics import KEYS, label_keys
from heliosweep.families.field_efficiency.selection import Kept, select
from heliosweep.families.field_efficiency.traced import FluxSums, TracedField, usual_rays
from heliosweep.families.field_efficiency.values import Field, FieldSums, at_instants, land_area, mirror_area
from heliosweep.families.field_efficiency.variables import (
    ANGLE_SERIES,
    ANGLES,
    DESIGN,
    DESIGN_NOISY,
    EFFICIENCIES,
    FACTORED,
    FIELD_MEANS,
    MONTHS,
    MOTION,
    NOISY,
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
from heliosweep.kernels.warm import warm_field, warm_rays
from heliosweep.layouts.resolve import Layouts
from heliosweep.processors import processors

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.grid.regions import Region
    from heliosweep.layouts.layout import Layout

#: Of one value at each instant, size for the heliostats of a block; and their minimum number. [bytes]
BLOCK_BYTES, LEAST_BLOCK = 4 * 2**20, 32
#: Heliostats of a block whose rays are traced.
TRACED_BLOCK = 4096
#: Mirrors around a part that may be in its way with a low sun; and size of one mirror. [1, bytes]
HALO, BYTES_PER_MIRROR = 5000, 200

_TRACKING = {"spinning_elevation": packets.SPINNING_ELEVATION, "azimuth_elevation": packets.AZIMUTH_ELEVATION}
_SIZES = ("heliostat.width", "heliostat.height")
_KEEP = ("keep.heliostats", "keep.field_power", "keep.by")
#: Keys that label a result also where they are not swept.
_LABELS = (
    *("site.latitude", "site.longitude", "time.azimuth", "time.elevation", "tracking"),
    *(*_SIZES, "heliostat.pivot_height", "receiver.height", *_KEEP),
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
    angles, layouts, pairs = study.output.tracking_angles, len(Layouts(study)), heliostats * instants
    # Maps are sums over the field, and the kept heliostats follow from all.
    split = "heliostat" if study.output.flux_map is None and study.keep is None else ""

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
        evaluations=math.ceil(pairs if study.optics is None else pairs * usual_rays(study, heliostats, instants)),
        unit="heliostat-instants" if study.optics is None else "rays",
        splittable=split,
        working_bytes=working_bytes,
        coordinate_bytes=8 * (6 * layouts * heliostats + _series(study) * instants),
        axes={} if _series(study) else {"instants": instants},
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
    if study.optics is None or study.output.outlines:
        return warm_field(bool(study.output.outlines))
    return warm_rays()


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
    mount = ("heliostat.pivot_height", "receiver.height", "aim.levels", "tracking", *_KEEP)
    keys = (*_SIZES, *mount, *PLACE, *LIMITS, *KEYS)
    threads = _threads(study) if "heliostat" not in region and math.prod(parameters.sizes.values()) == 1 else 1
    for index, (width, height, pivot, target, levels, tracking, number, power, by, *rest) in parameters.points(*keys):
        place, limits, optics = rest[: len(PLACE)], rest[len(PLACE) : -len(KEYS)], rest[-len(KEYS) :]
        position = parameters.position(index)
        layout = layouts.at(position)
        if span.start >= len(layout):
            continue
        there, sums = suns.at(index, place), FieldSums()
        hours = None if days is None else days.at(index, place, limits)
        months = None
        if study.optics is not None and study.optics.cleanliness_by_month is not None and hours is None:
            months = months_of(parameters, index, place[1])
        sun, now = there if hours is None else hours.sun, there[part]

        field_of = partial(
            _field, study, layouts, sizes=(width, height), at=(pivot, target, levels, tracking),
            optics=values_of(optics), place=place, months=months, key=tuple(position.values()), threads=threads,
        )  # fmt: skip
        kept: Kept | None = None
        if study.keep is not None:
            blocks = _blocks(study, len(sun), 0, len(layout))
            choose = partial(select, (number, power, by), layout, field_of, sun, hours, blocks)
            kept = layouts.last("kept", tuple(position.values()), choose)
            told = {"kept": np.isin(np.arange(len(layout)), kept.rows), "selection_rank": kept.rank}
            _put(made, told, index, slice(len(layout)))
            layout = layout.part(kept.rows)
        field = field_of(layout)
        mirrors = field.mirrors
        stop = min(span.stop, len(layout))
        flux = FluxSums(study, field.way) if isinstance(field, TracedField) else None
        mapped = {} if flux is None else {"flux": flux}
        for start, end in _blocks(study, len(sun), span.start, stop):
            if series:
                values = field.series(sun, part, hours, start, end)
                if study.output.field_series or hours is not None:
                    sums.add(values, field.area[start:end])
            else:
                if hours is None:
                    values = field.means(sun, start, end, **mapped)
                else:
                    values = field.energies(hours, start, end, **mapped)
                values |= {} if study.design_point is None else field.design(start, end, **mapped)
            _put(made, values, index, kept.rows[start:end] if kept else slice(start - span.start, end - span.start))
        if series:
            _put(made, sums.means() | at_instants(now, hours, part), index)
        elif flux is not None:
            _put(made, flux.values(), index)
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


def _threads(study: FieldEfficiencyStudy) -> int:
    """Number of threads that trace a single field whose heliostats are not split."""
    one = study.execution.scheduler not in ("threads", "processes")
    return 1 if one else study.execution.workers or processors()


def _field(
    study: FieldEfficiencyStudy,
    inputs: Inputs,
    layout: Layout,
    sizes: Any,
    at: Any,
    optics: Mapping[str, Any],
    place: Any,
    months: Any,
    key: tuple[int, ...],
    threads: int,
) -> Field | TracedField:
    """The field of a layout at a point of the result.

    `sizes` are width and height of the mirrors, `at` the values of pivot height, receiver height, levels of aim and
    tracking, `optics` those of `optics.KEYS`.
    """
    pivot, target, levels, tracking = at
    sides = mirror_size(layout, "width", sizes[0]), mirror_size(layout, "height", sizes[1])
    mirrors: Geometry = (
        layout.x,
        layout.y,
        layout.z + layout.values("pivot_height", pivot),
        sides[0] / 2,
        sides[1] / 2,
        target,
        _TRACKING[tracking],
    )
    area = mirror_area(*sides, study.heliostat.facets)
    if study.optics is None:
        return Field(study, mirrors, (efficiency.sorted_field(*mirrors[:6]), mirrors[6]), area, place)
    way = Way(study, inputs, layout, optics)
    mirrors = (*mirrors[:5], aims(way, mirrors, levels), mirrors[6])
    passed, mirror = way.transmitted(mirrors, place), way.reflection()
    return TracedField(study, mirrors, way, way.scene(mirrors), area, passed, mirror, place, months, key, threads)


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
    length = TRACED_BLOCK if study.optics is not None else length
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
            elevation = np.degrees(np.arctan2(target - layout.z - layout.values("pivot_height", pivot), distance))
            places[0][index][rows], places[1][index][rows] = distance, elevation
            key = (index if study.keep else (id(layout),)), float(np.hypot(*sides).max() / 2)
            if key not in lands:
                lands[key] = land_area(layout.x, layout.y, key[1])
            land[index] = lands[key]
    later = {name: one.dims for name, one in variables(study).items() if one.finished}
    made = {
        name: weighted_mean(computed[of].to_numpy(), _weights(of, computed, area))
        for name, of in FIELD_MEANS.items()
        if name in later
    }
    made |= {
        f"field_{name}": _field_error(name, computed, area) for name in (*NOISY, *DESIGN_NOISY) if name in computed
    }
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
        scale = mirrors * study.design_point.dni * 1e-6
        made["design_point_power"] = total * scale
        if study.optics is not None:
            made["design_point_power_error"] = made[f"field_{DESIGN_NOISY[-1]}"] * scale
    if "receiver_energy_error" in computed:
        squares = np.nan_to_num(computed["receiver_energy_error"].to_numpy()) ** 2
        made["field_receiver_energy_error"] = np.sqrt(energy.totals(squares, area))
    return xr.Dataset({name: (dims, made[name]) for name, dims in later.items()})


def _weights(name: str, computed: xr.Dataset, area: np.ndarray) -> np.ndarray:
    """Weights of the heliostats in a mean over the field: mirror area; for an intercept, the light that leaves them."""
    if not name.endswith("intercept_efficiency"):
        return area
    return area * np.nan_to_num(computed[name.replace("intercept", "optical")].to_numpy())


def _field_error(name: str, computed: xr.Dataset, area: np.ndarray) -> np.ndarray:
    """Standard error of a mean over the field, whose heliostats have independent rays."""
    errors = computed[name].to_numpy()
    weight = _weights(name.removesuffix("_error"), computed, area) * np.isfinite(errors)
    total = energy.totals(np.nan_to_num(weight * errors) ** 2, area)
    with np.errstate(invalid="ignore"):
        error: np.ndarray = np.sqrt(total) / energy.totals(weight, area)
    return error


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

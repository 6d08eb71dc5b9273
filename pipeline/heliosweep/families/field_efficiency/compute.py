"""Compute field efficiencies over a region of the grid, by ray tracing with `optics`, otherwise by exact polygons."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.aiming import VARIABLES, choose_aims
from heliosweep.config import SunDirections
from heliosweep.economics import ITEMS
from heliosweep.families.family import Computation
from heliosweep.families.field_efficiency.chain import KEPT, Geometry, Inputs, Way, months_of, values_of
from heliosweep.families.field_efficiency.flux import aims, flux_labels, images, is_limited, limited, varies, with_aims
from heliosweep.families.field_efficiency.heat import HEAT_STAGES, costs_of, has_heat, heat_of_year, heat_power
from heliosweep.families.field_efficiency.light_checks import mapped
from heliosweep.families.field_efficiency.losses import (
    Available,
    budget_cases,
    budget_labels,
    budget_values,
    causes,
    hidden,
    horizon_of,
    over_years,
    stages,
    tower_of,
    years_of,
)
from heliosweep.families.field_efficiency.optics import KEYS, label_keys
from heliosweep.families.field_efficiency.traced import (
    LightSums,
    TracedField,
    is_series_traced,
    usual_rays,
)
from heliosweep.families.field_efficiency.values import (
    DOWN,
    Days,
    Field,
    Hours,
    angles_of,
    at_instants,
    energies_of_field,
    hours_of,
    land_area,
    means_of_field,
    totals,
)
from heliosweep.families.field_efficiency.variables import (
    ANGLES,
    DESIGN,
    EFFICIENCIES,
    FACTORED,
    LIGHT,
    MONTHS,
    MOTION,
    NOISY,
    OUTLINES,
    variables,
)
from heliosweep.families.points import Point
from heliosweep.files import processors
from heliosweep.grid import LIMITS, MAX_INSTANTS, PLACE, Parameters, Suns, instant_count, instants_of
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.field import efficiency, packets
from heliosweep.kernels.rays import warm_rays
from heliosweep.layouts.resolve import Layouts, longest, weighted_mean
from heliosweep.lazy import scipy, xr
from heliosweep.light import TRACKING, mirror_area

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.families.points import Points
    from heliosweep.layouts.layout import Layout


#: Maximum size of an array with values for all instants and one heliostat block. [bytes]
BLOCK_BYTES = 4 * 2**20
#: Number of rays that take as long to compute as one heliostat at one instant without optics.
BUNDLE = 64

#: Memory for the frames of one mirror at all sun directions in a packet. [bytes]
FRAME_BYTES = packets.PACKET * 10 * 8

_SIZES = ("heliostat.width", "heliostat.height")
_KEEP = ("keep.heliostats", "keep.field_power", "keep.by", "keep.heat_power")
#: Keys that label a result even if they are not swept.
_LABELS = (
    *("site.latitude", "site.longitude", "time.azimuth", "time.elevation", "tracking"),
    *(*_SIZES, "heliostat.pivot_height", "receiver.height", *_KEEP),
)

#: Labels of the outline dimensions, and attributes of these labels.
_OUTLINES: dict[str, tuple[np.ndarray, dict[str, str]]] = {
    "effect": (np.array(["shading", "blocking"], object), {"long_name": "cause of the loss: shading or blocking"}),
    "image": (np.arange(0),
              {"long_name": (
                  "number of an outline on the mirror, counted from 0, in descending order of area"
              ), "units": "1"}),
    "corner": (np.arange(efficiency.OUTLINE_CORNERS),
               {"long_name": "number of a corner of an outline, counter-clockwise, counted from 0", "units": "1"}),
}  # fmt: skip


def computation(study: FieldEfficiencyStudy) -> Computation:
    """Return the variables of a study with the functions that compute them."""
    shapes = study.output.outlines
    outlined = _OUTLINES | {"image": (np.arange(shapes), _OUTLINES["image"][1])} if shapes else {}
    traced_series = is_series_traced(study)
    return Computation(
        function=compute_point,
        variables=variables(study),
        labels=(*_LABELS, *label_keys(study)),
        dims={**outlined, **_energy_labels(study), **flux_labels(study), **budget_labels(study)},
        attrs=partial(_attributes, study),
        inputs=partial(Inputs, study),
        finish=finish,
        prepare=partial(_prepare, study),
        # Flux maps, field series and budgets are sums over the field, and `keep` compares all heliostats.
        split=""
        if study.output.flux_map or study.keep or study.budget or traced_series or has_heat(study) or is_limited(study)
        else "heliostat",
        uncut=("time",) if traced_series or varies(study) else (),
        whole=() if (years := years_of(study)) is None else (years,),
        evaluations=partial(_evaluations, study),
        unit="heliostat-instants" if study.optics is None else f"x {BUNDLE} rays",
        memory=lambda: longest(study) * (FRAME_BYTES + 200 * 16),
        fixed_memory=partial(_fixed_memory, study),
    )


def _prepare(study: FieldEfficiencyStudy) -> None:
    if study.optics is None or study.output.outlines:
        efficiency.warm_field(bool(study.output.outlines))
    if study.optics is not None:
        warm_rays()
    if is_limited(study):
        choose_aims(np.ones((1, 1)), scipy.sparse.csr_matrix(np.ones((1, 1), np.float32)), np.ones(1))


def _energy_labels(study: FieldEfficiencyStudy) -> dict[str, tuple[np.ndarray, dict[str, str]]]:
    found: dict[str, tuple[np.ndarray, dict[str, str]]] = {}
    if study.weather is not None:
        all_stages = np.array((*stages(study), *(HEAT_STAGES if has_heat(study) else ())), object)
        words = {"long_name": "stage of the optical path at which energy is lost, in order along the light path"}
        found["month"] = np.arange(1, MONTHS + 1), {"long_name": "month of the year", "units": "1"}
        found["stage"] = all_stages, words
        found["cause"] = (
            np.array(causes(study), object),
            {"long_name": "limit outside which the field does not operate"},
        )
    if study.economics is not None:
        found["item"] = np.array(ITEMS, object), {"long_name": "item of the capital cost"}
    return found


def _instants(study: FieldEfficiencyStudy) -> int:
    count = instant_count(study.time)
    exact = count <= MAX_INSTANTS and (_series(study) or study.weather is not None)
    return instants_of(Parameters(study)).size if exact else count


def _evaluations(study: FieldEfficiencyStudy) -> int:
    heliostats, instants = longest(study), _instants(study)
    each = 1.0 if study.optics is None else usual_rays(study, heliostats, instants) / BUNDLE
    aimed = images(study, heliostats, instants)[0] / BUNDLE
    return math.ceil(heliostats * (instants * each * (1 + budget_cases(study)) + aimed))


def _fixed_memory(study: FieldEfficiencyStudy) -> int:
    """Return the memory needed for neighbouring mirrors, values at all instants, and one heliostat block. [bytes]"""
    heliostats, instants = longest(study), _instants(study)
    each = 4 * (24 + 40 * study.output.tracking_angles) + 200 * (study.weather is not None)
    # The sums over the heliostats at an instant have 640 bytes.
    each += 2 * 640 * (KEPT * is_series_traced(study) or has_heat(study))
    block = (8 if _series(study) else 4 * _complete(study)) * min(BLOCK_BYTES, 8 * heliostats * instants)
    block += images(study, heliostats, instants)[1]
    # If the sun is low, at most 5000 neighbouring mirrors shade a part of the field. A mirror has 200 bytes.
    return min(heliostats, 5000) * FRAME_BYTES + heliostats * 200 + each * instants + block


def _series(study: FieldEfficiencyStudy) -> bool:
    """Return True if the result has values at each instant."""
    return study.output.time_series or study.output.field_series


def compute_point(point: Point) -> dict[str, np.ndarray]:
    """Compute efficiencies and energies over the period, or their time series.

    Values are missing (NaN) at instants with the sun below the horizon, and means are missing if the sun is never up.
    Rays are traced once for both the means and the time series of a field.
    """
    key, inputs = tuple(point.position.values()), point.inputs
    if not is_series_traced(point.study):
        return _values(point, key)
    if "time" in point.points.region:
        return _values(point, key, inputs.series_of(key))
    with inputs.series_from(key) as future:
        return _values(point, key, future=future)


def _values(
    point: Point, key: tuple[int, ...], whole: np.ndarray | None = None, future: Future[Any] | None = None
) -> dict[str, np.ndarray]:
    """Return the values at a point of the result.

    `whole` contains the ray sums of the field at each instant. If `whole` is None, rays are traced. `future` receives
    the ray sums that are computed together with the means.
    """
    study, layout, output, span = point.study, point.layout, point.study.output, point.part("heliostat")
    first, stop = span.start or 0, len(layout) if span.stop is None else min(span.stop, len(layout))
    if first >= len(layout):
        return {}
    series, (there, hours, months) = "time" in point.points.region, _light_of(point)
    part = point.part("time") if _complete(study) else slice(None)
    sun, now = there if hours is None else hours.sun, there[part]
    field_of = partial(_field, point, months=months)
    aimed = partial(limited, point, sun=sun, hours=hours)
    made: dict[str, np.ndarray] = {}
    if study.keep is not None:
        blocks = _blocks(study, len(sun), 0, len(layout))
        choose = partial(select, [point[key] for key in _KEEP], layout, field_of, aimed, sun, hours, blocks)
        rows, rank = point.inputs.last("kept", key, choose)
        made |= {"kept": np.isin(np.arange(len(layout)), rows) * 1.0, "selection_rank": rank * 1.0}
        layout, stop = layout.part(rows), len(rows)
    field: Field | TracedField = aimed(field_of(layout))
    if series:
        found, of_field = _series_of(field, sun, part, hours, first, stop, whole)
        made |= at_instants(now, hours, part)
    else:
        found, of_field = _sums_of(field, sun, hours, first, stop, future)
    if study.budget is not None and hours is not None and not series:
        made |= _budget(point, layout, field, hours, months, float(found["receiver_energy"].sum()))
    if output.tracking_angles:
        found |= _angles(point, field, now, first, stop)
    if isinstance(field, TracedField) and series == varies(study):
        for name, values in field.aims.items():
            (found if "heliostat" in VARIABLES[name][0] else made)[name] = values[part] if series else values[0]
    if study.keep is not None:
        found = {name: _spread(values, made["kept"] > 0) for name, values in found.items()}
    if output.outlines and not series:
        shapes = efficiency.mirror_outlines(*field.mirrors, now[0], first, stop, output.outlines)
        made |= zip(OUTLINES, (*np.moveaxis(shapes.corners, -1, 0), *shapes[1:]), strict=True)
    return made | found | of_field


def _spread(values: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Expand values of the kept heliostats to all heliostats (last dimension), with NaN for the omitted heliostats."""
    whole = np.full((*values.shape[:-1], kept.size), np.nan)
    whole[..., kept] = values
    return whole


def _light_of(point: Point) -> tuple[np.ndarray, Hours | None, np.ndarray | None]:
    """Return the sun directions at a point, irradiation (None without weather), and months (None if not needed)."""
    study, points, place = point.study, point.points, [point[key] for key in PLACE]
    around = points.once("around", lambda: Parameters(study, {k: v for k, v in points.region.items() if k != "time"}))
    suns = points.once("suns", lambda: Suns(around if _complete(study) else points.parameters))
    hours = months = None
    if study.weather is not None:
        hours = points.once("days", lambda: Days(around, suns)).at(point.index, place, [point[key] for key in LIMITS])
    elif study.optics is not None and study.optics.cleanliness_by_month is not None:
        months = months_of(point.all_instants, place[1])
    sun = suns.at(point.index, place)
    return np.where(hidden(sun, horizon_of(study))[:, np.newaxis], DOWN, sun), hours, months


def _sums_of(
    field: Field | TracedField, sun: np.ndarray, hours: Hours | None, first: int, stop: int, future: Future[Any] | None
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return means, energies and design-point values of heliostats `first` to `stop` - 1, and sums over the field."""
    light = LightSums(field.way) if isinstance(field, TracedField) else None
    given, pieces = {} if light is None else {"light": light}, []
    for start, end in _blocks(field.study, len(sun), first, stop):
        values = field.means(sun, start, end, **given) if hours is None else field.energies(hours, start, end, **given)
        pieces.append(values | ({} if field.study.design_point is None else field.design(start, end, **given)))
    if future is not None and light is not None and np.ndim(light.series):
        future.set_result(light.series)
    found, of_field = _joined(pieces), {} if light is None else light.values()
    if light is not None and hours is not None and isinstance(field, TracedField) and has_heat(field.study):
        of_field |= heat_of_year(light.received(hours), field.way.values, field.way.inputs.losses, hours, found)
    return found, of_field


def _series_of(
    field: Field | TracedField, sun: np.ndarray, part: slice, hours: Hours | None, first: int, stop: int,
    whole: np.ndarray | None,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:  # fmt: skip
    """Return the values of the heliostats `first` to `stop` - 1 and of the field at the instants of `part`."""
    if isinstance(field, TracedField):
        found = field.series(sun, part, hours, first, stop, whole)
        if hours is not None and has_heat(field.study):
            found["field_heat_power"] = heat_power(found["field_power"], field.way.values, field.way.inputs.losses)
        return found, {name: found.pop(name) for name in list(found) if name.startswith("field_")}
    blocks = list(_blocks(field.study, len(sun), first, stop))
    pieces = [field.series(sun, part, hours, start, end) for start, end in blocks]
    return _joined(pieces), means_of_field(pieces, [field.area[start:end] for start, end in blocks])


class Altered(Point):
    """Result point at which `values` override the values of some keys."""

    def __init__(self, point: Point, values: Mapping[str, Any]) -> None:
        vars(self).update(vars(point))
        self._values = values

    def __getitem__(self, key: str) -> Any:
        return self._values[key] if key in self._values else super().__getitem__(key)


def _budget(
    point: Point, layout: Layout, field: Field | TracedField, hours: Hours, months: np.ndarray | None, actual: float
) -> dict[str, np.ndarray]:
    """Return the error budget of a field. `actual` is the energy on the receiver with all causes. [MWh]

    All cases use the same rays and, unless a cause changes the receiver, the same aim points.
    """
    number = field.number_of_rays(hours) if isinstance(field, TracedField) else 0

    def energies(values: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        moved = not isinstance(field, TracedField) or any(key.startswith("receiver.") for key in values)
        case = _field(Altered(point, values), layout, months=months, aim=None if moved else field.mirrors[5])
        if isinstance(case, TracedField):
            case = with_aims(case._replace(number=number), field.aims if isinstance(field, TracedField) else {})
        blocks = _blocks(point.study, len(hours.sun), 0, len(layout))
        found = _joined([case.energies(hours, start, end) for start, end in blocks])
        return found["receiver_energy"].sum(), found["heliostat_loss"].sum(axis=-1)

    return budget_values(point.study, energies, actual)


def _joined(pieces: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Join the values of several heliostat blocks along the last dimension."""
    return {name: np.concatenate([piece[name] for piece in pieces], axis=-1) for name in (pieces[0] if pieces else ())}


def _angles(point: Point, field: Field | TracedField, sun: np.ndarray, first: int, stop: int) -> dict[str, np.ndarray]:
    """Return the mount angles at each instant or for one sun direction, or the motion of the mounts over the period."""
    series, directions = "time" in point.points.region, isinstance(point.study.time, SunDirections)
    names = [f"instantaneous_{name}" for name in ANGLES] if series else ANGLES if directions else MOTION
    over = None if series or directions else hours_of(point.all_instants, point.study.time)
    towards = efficiency.aimed(*field.mirrors[:6]).aim[first:stop]
    return dict(zip(names, angles_of(towards, sun, field.mirrors[6], over, series), strict=True))


def _field(
    point: Point, layout: Layout, *, months: np.ndarray | None, aim: np.ndarray | None = None
) -> Field | TracedField:
    """Return the heliostat field of a layout for the key values at a point; `aim` overrides the study's aim points."""
    study, place = point.study, [point[key] for key in PLACE]
    sides = _sides(point, layout)
    mirrors: Geometry = (
        layout.x,
        layout.y,
        layout.z + layout.values("pivot_height", point["heliostat.pivot_height"]),
        sides[0] / 2,
        sides[1] / 2,
        point["receiver.height"],
        TRACKING[point["tracking"]],
    )
    area, tower = mirror_area(*sides, study.heliostat.facets), tower_of(point, study)
    works = Available.at(point, layout)
    if study.optics is None:
        return Field(study, mirrors, (efficiency.sorted_field(*mirrors[:6], tower), mirrors[6]), area, place, works)
    way = Way(study, point.inputs, layout, values_of([point[key] for key in KEYS]))
    aim = aims(way, mirrors, point["aim.levels"]) if aim is None else aim
    mirrors = (*mirrors[:5], aim, mirrors[6])
    passed, mirror, key = way.transmitted(mirrors, place), way.reflection(), tuple(point.position.values())
    single = "heliostat" not in point.points.region and math.prod(point.points.sizes.values()) == 1
    if not single or study.execution.scheduler not in ("threads", "processes"):
        threads = 1
    else:  # threads are used only for a single field that is not split by heliostats
        threads = study.execution.workers or processors()
    scene = way.scene(mirrors)._replace(tower=tower)
    return TracedField(
        study, mirrors, way, scene, area, passed, mirror, place, months, key, threads, available=works
    )  # fmt: skip


def _complete(study: FieldEfficiencyStudy) -> bool:
    """Return True if the computation needs all instants together for interpolation, weights or sums."""
    output, kept = study.output, study.keep is not None
    return study.optics is not None or study.weather is not None or output.field_series or kept


def _blocks(study: FieldEfficiencyStudy, instants: int, start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Yield ranges of heliostats to compute together. Memory for values at all instants limits the range length."""
    length = max(32, BLOCK_BYTES // (8 * max(instants, 1))) if _complete(study) else stop - start
    length = 4096 if study.optics is not None else length  # number of mirrors that are traced together
    return ((first, min(first + length, stop)) for first in range(start, stop, length))


def _geometry(points: Points, computed: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the mirror areas [m2] and positions [m, deg] of the heliostats, and the land area of the field [m2]."""
    study, lands = points.study, dict[tuple[tuple[int, ...], float], float]()
    area = np.zeros((*points.sizes.values(), points.inputs.layouts.size))
    distance, elevation, land = np.full(area.shape, np.nan), np.full(area.shape, np.nan), np.zeros(area.shape[:-1])
    tall = np.zeros(land.shape)
    for point in points:
        index, layout, sides = point.index, point.layout, _sides(point, point.layout)
        area[index][: len(layout)] = mirror_area(*sides, study.heliostat.facets)
        tall[index] = np.mean(sides[1])
        rows: Any = slice(len(layout))
        if study.keep is not None:
            area[index] *= computed["kept"].to_numpy()[index] == 1
            rows = np.flatnonzero(area[index])
            layout = layout.part(rows)
        if study.output.field_geometry or study.economics is not None:
            pivots = layout.z + layout.values("pivot_height", point["heliostat.pivot_height"])
            distance[index][rows] = away = np.hypot(layout.x, layout.y)
            elevation[index][rows] = np.degrees(np.arctan2(point["receiver.height"] - pivots, away))
            key = (index if study.keep else (id(layout),)), float(np.hypot(*sides).max() / 2)
            if key not in lands:
                lands[key] = land_area(layout.x, layout.y, key[1])
            land[index] = lands[key]
    return {
        "area": area,
        "tower_distance": distance,
        "target_elevation": elevation,
        "field_land_area": land,
        "mirror_height": tall,
    }


def finish(points: Points, computed: xr.Dataset) -> dict[str, np.ndarray]:
    """Compute area-weighted means and sums over the heliostats, and the size of the field."""
    study, made = points.study, _geometry(points, computed)
    area = made.pop("area")
    means = [name for name in (*EFFICIENCIES, *LIGHT, *DESIGN) if name in computed]
    made |= {
        f"field_{name}": weighted_mean(computed[name].to_numpy(), _weights(name, computed, area)) for name in means
    }
    made |= {f"field_{name}_error": _field_error(name, computed, area) for name in NOISY if f"{name}_error" in computed}
    mirrors = area.sum(axis=-1)
    cosine, shading, blocking = (made[f"field_{name}"] for name in EFFICIENCIES[:3])
    made[FACTORED] = cosine * shading * blocking
    made |= {"field_heliostats": (area > 0).sum(axis=-1).astype(float), "field_mirror_area": mirrors}
    if study.output.field_geometry:
        made["field_packing_factor"] = mirrors / made["field_land_area"]
        made["field_mean_radius"] = weighted_mean(made["tower_distance"], area)
    if study.weather is not None:
        made |= energies_of_field(points.parameters, computed, area)
    if study.design_point is not None:
        scale = mirrors * study.design_point.dni * 1e-6
        for label in ("", "_error"):
            if (name := f"field_{_design_name(study)}{label}") in made:
                made[f"design_point_power{label}"] = made[name] * scale
        if has_heat(study):
            made["design_point_heat"] = _design_heat(points, made["design_point_power"])
    if study.economics is not None:
        made |= costs_of(points, made, np.asarray(computed.get("field_heat", made.get("field_receiver_energy"))))
    for name, of in (
        ("field_receiver_energy", "receiver_energy"), ("loss", "heliostat_loss"),
        ("monthly_receiver_energy", "heliostat_monthly_receiver_energy"),
    ):  # fmt: skip
        if f"{of}_error" in computed:
            made[f"{name}_error"] = np.sqrt(totals(np.nan_to_num(computed[f"{of}_error"].to_numpy()) ** 2, area))
    energies = {name: computed[name] for name in ("field_heat",) if name in computed}
    return made | over_years(study, [*points.sizes], made | energies)


def _design_heat(points: Points, power: np.ndarray) -> np.ndarray:
    heat = np.empty(power.shape)
    for point in points:
        values = values_of([point[key] for key in KEYS])
        heat[point.index] = heat_power(power[point.index], values, points.inputs.files.losses)
    return heat


def _sides(point: Point, layout: Layout) -> tuple[Any, Any]:
    width, height = (layout.values(key.rpartition(".")[2], point[key]) for key in _SIZES)
    return width, height


def _design_name(study: FieldEfficiencyStudy) -> str:
    """Return the name of the design-point efficiency that determines the power of a field."""
    return DESIGN[-1] if study.optics is not None else DESIGN[len(EFFICIENCIES) - 1]


def _weights(name: str, computed: xr.Dataset, area: np.ndarray) -> np.ndarray:
    """Return each heliostat's weight in a field mean: mirror area, or reflected light for the intercept efficiency."""
    if not name.endswith("intercept_efficiency"):
        return area
    return area * np.nan_to_num(computed[name.replace("intercept", "optical")].to_numpy())


def _field_error(name: str, computed: xr.Dataset, area: np.ndarray) -> np.ndarray:
    """Return the standard error of a field mean. The rays of different heliostats are independent."""
    errors = computed[f"{name}_error"].to_numpy()
    weight = _weights(name, computed, area) * np.isfinite(errors)
    total = totals(np.nan_to_num(weight * errors) ** 2, area)
    with np.errstate(invalid="ignore"):
        error: np.ndarray = np.sqrt(total) / totals(weight, area)
    return error


def _attributes(study: FieldEfficiencyStudy) -> dict[str, str]:
    """Return the result attributes: ground polygons, and the numbers of heliostats with and without slope maps."""
    layouts = Layouts(study)
    maps = "" if study.optics is None else "; ".join(map(str, mapped(study, next(iter(layouts.some()))[0])))
    return layouts.areas() | ({"slope_maps": maps} if maps else {})


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield remarks about slope maps, and about fields with less power or heat than `keep` requires."""
    if "slope_maps" in result.attrs:
        yield result.attrs["slope_maps"]
    for kept, key, name in (("kept_power", "field_power", "power"), ("kept_heat", "heat_power", "heat")):
        if kept not in result.coords:
            continue
        power = result[f"design_point_{name}"]
        if (short := (power < result[kept]).to_numpy()).any():
            most = float(power.where(short).max())
            yield (
                f"{int(short.sum()):,} of {short.size:,} fields have less than keep.{key}, {most:.4g} MW although "
                "all heliostats are kept: generate more"
            )


def best(
    values: Floats, number: float | None, power: float | None, power_of: Callable[[NDArray[np.int64]], float]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Select the highest-ranked heliostats of a field.

    Parameters
    ----------
    values : ndarray, shape (heliostat,)
        Values by which heliostats are ranked, highest first. Heliostats with equal values keep their order; NaN
        ranks last.
    number, power : float, optional
        Number of heliostats to keep, or required power in the unit of `power_of`.
    power_of : callable
        Function that takes heliostat rows and returns the power of a field that contains only these heliostats.

    Returns
    -------
    rows : ndarray of int
        Rows of the selected heliostats in ascending order. If a power is given, bisection finds the minimum number
        of best heliostats that reach this power. If the full field has less power, all heliostats are selected.
    rank : ndarray of int, shape (heliostat,)
        Rank of each heliostat, counted from 1.
    """
    order = np.argsort(-values, kind="stable")
    rank = np.empty(order.size, np.int64)
    rank[order] = np.arange(1, order.size + 1)
    low, high = 0, order.size if power is not None else min(int(number or 0), order.size)
    while power is not None and high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power_of(np.sort(order[:middle])) >= power else (middle, high)
    return np.sort(order[:high]), rank


def select(
    wanted: Sequence[Any], layout: Layout, field_of: Callable[[Layout], Field | TracedField],
    aimed: Callable[[Field | TracedField], Field | TracedField], sun: Floats, hours: Hours | None,
    blocks: Iterable[tuple[int, int]],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:  # fmt: skip
    """Return the layout rows of the kept heliostats at a point of the result, and the ranks of all heliostats.

    `wanted` contains the values of `keep.heliostats`, `keep.field_power`, `keep.by` and `keep.heat_power`. `field_of`
    returns the field of a layout. If the study has a flux limit, `aimed` returns a field with the aim points that the
    limit requires. Heliostats are ranked in the full field without a flux limit, with fewer rays than in the result.
    `blocks` contains the ranges of heliostats that are computed together for the ranking.
    """
    number, power, by, heat = wanted
    whole, pieces = field_of(layout), []
    if isinstance(whole, TracedField):
        whole = whole._replace(coarse=8.0)
    for start, stop in blocks:
        if by in DESIGN:
            pieces.append(whole.design(start, stop))
        else:
            pieces.append(whole.means(sun, start, stop) if hours is None else whole.energies(hours, start, stop))
    ranks = _joined(pieces)
    if by == "energy_per_mirror_area":
        ranks[by] = ranks["receiver_energy"] / whole.area

    def power_of(rows: NDArray[np.int64]) -> float:
        field = aimed(field_of(layout.part(rows)))
        values = field.design(0, field.area.size)[_design_name(field.study)]
        found = float(np.sum(values * field.area)) * field.study.design_point.dni * 1e-6
        if heat is None or not isinstance(field, TracedField):
            return found
        return float(heat_power(found, field.way.values, field.way.inputs.losses))

    return best(ranks[by], number, power if heat is None else heat, power_of)

"""Compute field efficiencies over a region of the result grid.

Studies with `optics` are computed by ray tracing, other studies with exact polygons.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from heliosweep.aiming import VARIABLES, choose_aims
from heliosweep.config import CivilTime, SunDirections
from heliosweep.economics import ITEMS
from heliosweep.families.family import Computation, Point, Points
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
from heliosweep.families.field_efficiency.optics import flux_labels, images, is_limited, label_keys, varies
from heliosweep.families.field_efficiency.traced import (
    KEPT,
    Geometry,
    Inputs,
    TracedField,
    Way,
    is_series_traced,
    months_of,
    usual_rays,
)
from heliosweep.families.field_efficiency.values import (
    DOWN,
    Field,
    Hours,
    angles_of,
    land_area,
)
from heliosweep.families.field_efficiency.variables import (
    ANGLES,
    DESIGN,
    EFFICIENCIES,
    FACTORED,
    LIGHT,
    MONTHS,
    MOTION,
    OUTLINES,
    variables,
)
from heliosweep.files import processors
from heliosweep.grid import LIMITS, MAX_INSTANTS, PLACE, Parameters, Suns, Weathers, instant_count, instants_of
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.field import efficiency, packets
from heliosweep.kernels.rays import RECEIVED, warm_rays
from heliosweep.layouts.resolve import Layouts, longest
from heliosweep.lazy import scipy, xr
from heliosweep.light import TRACKING, mirror_area

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.layouts.layout import Layout


#: Maximum size of an array with values for all instants and one heliostat block. [bytes]
BLOCK_BYTES = 4 * 2**20
#: Number of rays that take as long to trace as one heliostat-instant without optics takes to compute.
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

#: Labels of the outline dimensions, with their attributes.
_OUTLINES: dict[str, tuple[np.ndarray, dict[str, str]]] = {
    "effect": (np.array(["shading", "blocking"], object), {"long_name": "cause of the loss: shading or blocking"}),
    "image": (np.arange(0),
              {"long_name": (
                  "outline number on the mirror, counted from 0 in descending order of area"
              ), "units": "1"}),
    "corner": (np.arange(efficiency.OUTLINE_CORNERS),
               {"long_name": "corner number of the outline, counted counter-clockwise from 0", "units": "1"}),
}  # fmt: skip


def computation(study: FieldEfficiencyStudy) -> Computation:
    """Return the variables of a study and the functions that compute their values."""
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
    if study.weather is None:
        return {}
    words = "stage at which energy is lost, in order along the light path"
    all_stages = (*stages(study), *(HEAT_STAGES if has_heat(study) else ()))
    items = {"item": (np.array(ITEMS, object), {"long_name": "capital cost item"})}
    return {
        "month": (np.arange(1, MONTHS + 1), {"long_name": "month of the year", "units": "1"}),
        "stage": (np.array(all_stages, object), {"long_name": words}),
        "cause": (
            np.array(causes(study), object), {"long_name": "limit that prevents the field from operating"},
        ),
        **(items if study.economics is not None else {}),
    }  # fmt: skip


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
    # The sums over the heliostats need 640 bytes per instant.
    each += 2 * 640 * (KEPT * is_series_traced(study) or has_heat(study))
    block = (8 if _series(study) else 4 * _complete(study)) * min(BLOCK_BYTES, 8 * heliostats * instants)
    block += images(study, heliostats, instants)[1]
    # When the sun is low, up to 5000 neighbouring mirrors shade part of the field. Each mirror needs 200 bytes.
    return min(heliostats, 5000) * FRAME_BYTES + heliostats * 200 + each * instants + block


def _series(study: FieldEfficiencyStudy) -> bool:
    return study.output.time_series or study.output.field_series


def compute_point(point: Point) -> dict[str, np.ndarray]:
    """Compute efficiencies and energies over the period, or their time series.

    Values at instants with the sun below the horizon are NaN. Means are NaN if the sun is never up. The means and the
    field series are computed from the same rays.
    """
    series, inputs, key = "time" in point.points.region, point.inputs, tuple(point.position.values())
    if not is_series_traced(point.study):
        return _values(point, series)
    with inputs.locks[key]:
        means: dict[str, np.ndarray] = inputs.last("means", key, partial(_values, point, False), KEPT)
    return _values(point, True, means["sums"]) if series else means


def _values(point: Point, series: bool, sums: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Return the values at a result point, and the ray sums at each instant if time series or heat need these sums.

    If `series` is True, the values are time series. If `sums` is given, the values are computed without tracing rays.
    """
    study, layout = point.study, point.layout
    first, stop, _ = point.part("heliostat").indices(len(layout))
    if first >= len(layout):
        return {}
    sun, hours, months = light_of(point)
    part, made = point.part("time") if series and _complete(study) else slice(None), dict[str, np.ndarray]()
    field_of = partial(_field, point, months=months)

    def aimed(layout: Layout) -> Field | TracedField:
        field = field_of(layout)
        return field.limited(point, sun, hours) if isinstance(field, TracedField) else field

    if study.keep is not None:
        key, choose = tuple(point.position.values()), partial(select, point, field_of, aimed, sun, hours)
        rows, rank = point.inputs.last("kept", key, choose)
        made |= {"kept": np.isin(np.arange(len(layout)), rows) * 1.0, "selection_rank": rank * 1.0}
        layout, stop = layout.part(rows), len(rows)
    field = aimed(layout)
    if series:
        found, of_field = _series_of(point, field, sun, part, hours, first, stop, sums)
    else:
        found, of_field = _sums_of(point, field, sun, hours, first, stop)
    if study.budget is not None and hours is not None and not series:
        made |= _budget(point, layout, field, hours, months, float(found["receiver_energy"].sum()))
    if study.output.tracking_angles:
        found |= _angles(point, field, sun[part], first, stop, series)
    if series == varies(study):
        for name, values in field.aims.items():
            (found if "heliostat" in VARIABLES[name][0] else made)[name] = values[part if series else 0]
    if study.keep is not None:
        found = {name: _spread(values, made["kept"] > 0) for name, values in found.items()}
    return made | found | of_field


def _spread(values: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Expand values of the kept heliostats to all heliostats (last axis). Values of omitted heliostats are NaN."""
    whole = np.full((*values.shape[:-1], kept.size), np.nan)
    whole[..., kept] = values
    return whole


def _sums_of(
    point: Point, field: Field | TracedField, sun: np.ndarray, hours: Hours | None, first: int, stop: int
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return means, energies and design-point values of heliostats `first` to `stop` - 1, and sums over the field."""
    study, heat, of_field = point.study, has_heat(point.study) and hours is not None, dict[str, Any]()
    if isinstance(field, TracedField):
        of_field = {"sums": 0.0} if heat or is_series_traced(study) else {}
        field = field._replace(light=of_field)
    found = blocks_of(field, sun, hours, first, stop)
    found |= {} if study.design_point is None else _design(field, first, stop)
    if isinstance(field, TracedField):
        of_field |= field.maps()
        if heat and hours is not None:
            light = of_field["sums"][..., RECEIVED].mean(axis=0) * field.way.reflected(hours.month, len(sun))
            of_field |= heat_of_year(light, field.way.values, point.inputs.losses, hours, found)
    if study.output.outlines:
        shapes = efficiency.mirror_outlines(*field.mirrors, sun[0], first, stop, study.output.outlines)
        of_field |= zip(OUTLINES, (*np.moveaxis(shapes.corners, -1, 0), *shapes[1:]), strict=True)
    return found, of_field


def _series_of(
    point: Point, field: Field | TracedField, sun: np.ndarray, part: slice, hours: Hours | None, first: int, stop: int,
    sums: np.ndarray | None,
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:  # fmt: skip
    """Return time series of heliostats `first` to `stop` - 1, the field and the sun for the instants in `part`."""
    x, y, z = np.where(sun[part, 2:] > 0, sun[part], np.nan).T
    of_field = {"sun_azimuth": np.degrees(np.arctan2(x, y)) % 360.0,
                "sun_elevation": np.degrees(np.arctan2(z, np.hypot(x, y)))}  # fmt: skip
    if hours is not None:
        sun, of_field["dni"] = hours.sun, hours.dni[part]
    if isinstance(field, TracedField):
        found = field.series(sun, part, hours, first, stop, sums)
        if hours is not None and has_heat(point.study):
            found["field_heat_power"] = heat_power(found["field_power"], field.way.values, point.inputs.losses)
        return found, of_field | {name: found.pop(name) for name in list(found) if name.startswith("field_")}
    blocks, area = _blocks(point.study, len(sun), first, stop), field.area[first:stop]
    found = _joined([field.series(sun, part, hours, start, end) for start, end in blocks])
    of_field |= {f"field_{name}": (values * area).sum(axis=-1) / area.sum() for name, values in found.items()}
    if hours is not None:
        of_field["field_power"] = 1e-3 * found["instantaneous_power"].sum(axis=-1)
    return found, of_field


def _angles(
    point: Point, field: Field | TracedField, sun: np.ndarray, first: int, stop: int, series: bool
) -> dict[str, np.ndarray]:
    """Return mount angles for time series or sun directions, otherwise the motion of the mounts over the period."""
    directions = isinstance(point.study.time, SunDirections)
    names = [f"instantaneous_{name}" for name in ANGLES] if series else ANGLES if directions else MOTION
    over = None if series or directions else point.all_instants
    towards = efficiency.aimed(*field.mirrors[:6]).aim[first:stop]
    angles = angles_of(towards, sun, field.mirrors[6], over, series, point.study.time)
    return dict(zip(names, angles, strict=True))


def light_of(point: Point) -> tuple[np.ndarray, Hours | None, np.ndarray | None]:
    """Return the sun directions, the irradiation and the months at a result point.

    The irradiation is None without weather. The months are None unless monthly cleanliness is used without weather.
    """
    study, points, place = point.study, point.points, [point[key] for key in PLACE]
    around = points.once("around", lambda: Parameters(study, {k: v for k, v in points.region.items() if k != "time"}))
    suns = points.once("suns", lambda: Suns(around if _complete(study) else points.parameters))
    sun, horizon, hours, months = suns.at(point.index, place), horizon_of(study), None, None
    below = hidden(sun, horizon)
    if study.weather is not None:
        air = points.once("air", lambda: Weathers(around)).at(point.index, place)
        hours = Hours.of(sun, air, [point[key] for key in LIMITS], None if horizon is None else below)
    elif study.optics is not None and study.optics.cleanliness_by_month is not None:
        months = months_of(point.all_instants, place[1])
    return np.where(below[:, np.newaxis], DOWN, sun), hours, months


def blocks_of(
    field: Field | TracedField, sun: Floats, hours: Hours | None, first: int, stop: int
) -> dict[str, np.ndarray]:
    """Return the energies of heliostats `first` to `stop` - 1, or their mean efficiencies if `hours` is None."""
    blocks = _blocks(field.study, len(sun), first, stop)
    if hours is None:
        return _joined([field.means(sun, start, end) for start, end in blocks])
    return _joined([field.energies(hours, start, end) for start, end in blocks])


def _design(field: Field | TracedField, start: int, end: int) -> dict[str, np.ndarray]:
    point = field.study.design_point
    values = field.means(point.sun(field.place[0]), start, end, point)
    return {f"design_point_{name}": each for name, each in values.items()}


class Altered(Point):
    """Result point whose key values are overridden by `values`."""

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
        if isinstance(case, TracedField) and isinstance(field, TracedField):
            case = case._replace(number=number).with_aims(field.aims)
        found = blocks_of(case, hours.sun, hours, 0, len(layout))
        return found["receiver_energy"].sum(), found["heliostat_loss"].sum(axis=-1)

    return budget_values(point.study, energies, actual)


def _joined(pieces: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {name: np.concatenate([piece[name] for piece in pieces], axis=-1) for name in (pieces[0] if pieces else ())}


def _field(
    point: Point, layout: Layout, *, months: np.ndarray | None, aim: np.ndarray | None = None
) -> Field | TracedField:
    """Return the heliostat field of a layout at a result point. If given, `aim` overrides the study's aim points."""
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
    way = Way.at(study, point.inputs, layout, point.__getitem__)
    mirrors = (*mirrors[:5], way.aims(mirrors, point["aim.levels"]) if aim is None else aim, mirrors[6])
    clear, clean = (layout.values(name, way.values[name], 1.0) for name in ("reflectivity", "cleanliness"))
    single = "heliostat" not in point.points.region and math.prod(point.points.sizes.values()) == 1
    # Threads are used only for a single field that is not split by heliostats.
    alone = single and study.execution.scheduler in ("threads", "processes")
    return TracedField(
        study, mirrors, way, way.scene(mirrors, tower), area, way.transmitted(mirrors, place), clear * clean, place,
        months, tuple(point.position.values()), (study.execution.workers or processors()) if alone else 1,
        available=works,
    )  # fmt: skip


def _complete(study: FieldEfficiencyStudy) -> bool:
    """Return True if interpolation, weights or sums need all instants at once."""
    output, kept = study.output, study.keep is not None
    return study.optics is not None or study.weather is not None or output.field_series or kept


def _blocks(study: FieldEfficiencyStudy, instants: int, start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Return ranges of heliostats that are computed together. Without optics, `BLOCK_BYTES` limits the range length."""
    length = max(32, BLOCK_BYTES // (8 * max(instants, 1))) if _complete(study) else stop - start
    length = 4096 if study.optics is not None else length  # number of mirrors traced together
    return ((first, min(first + length, stop)) for first in range(start, stop, length))


def finish(points: Points, computed: xr.Dataset) -> dict[str, np.ndarray]:
    """Compute field sums, area-weighted field means and field sizes."""
    arrays, study = {str(name): array.to_numpy() for name, array in computed.items()}, points.study
    each = [_finished(point, {name: array[point.index] for name, array in arrays.items()}) for point in points]
    made = {name: np.reshape([one[name] for one in each], (*points.sizes.values(), *np.shape(value)))
            for name, value in each[0].items()}  # fmt: skip
    if study.economics is not None:
        made |= costs_of(points, made, arrays.get("field_heat", made["field_receiver_energy"]))
    return made | over_years(study, [*points.sizes], arrays | made)


def _finished(point: Point, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return means, sums and sizes of the field at one point. Padding of the layout does not affect rounding."""
    study, layout, sides = point.study, point.layout, _sides(point, point.layout)
    area, rows = np.zeros(point.points.inputs.layouts.size), np.arange(len(layout))
    area[rows] = mirror_area(*sides, study.heliostat.facets)
    if study.keep is not None:
        area *= values["kept"] == 1
        rows = np.flatnonzero(area)
        layout = layout.part(rows)
    used, mirrors = area > 0, area.sum()
    made: dict[str, Any] = {"field_heliostats": float(used.sum()), "field_mirror_area": mirrors}

    def total(of: Floats) -> Any:
        return np.ascontiguousarray(of[..., used]).sum(axis=-1)

    for name in (*EFFICIENCIES, *LIGHT, *DESIGN):
        if name in values:
            # The weight is the mirror area or, for the intercept efficiency, the light that leaves the mirrors.
            sent = np.nan_to_num(values[name.replace("intercept", "optical")]) if "intercept" in name else 1.0
            weight = area * sent
            made[f"field_{name}"] = _mean(values[name], weight)
            if (errors := values.get(f"{name}_error")) is not None:  # the rays of different heliostats are independent
                weight = weight * np.isfinite(errors)
                square = total(np.nan_to_num(weight * errors) ** 2)
                made[f"field_{name}_error"] = np.sqrt(square) / (total(weight) or np.nan)
    made[FACTORED] = math.prod(made[f"field_{name}"] for name in EFFICIENCIES[:3])
    if study.output.field_geometry or study.economics is not None:
        made |= _sizes(point, layout, area, rows) | {"mirror_height": np.mean(sides[1])}
    if study.weather is not None:
        made |= _energies(point, values, area, total)
    if study.design_point is not None:
        for label in ("", "_error"):
            if (name := f"field_{_design_name(study)}{label}") in made:
                made[f"design_point_power{label}"] = made[name] * (mirrors * study.design_point.dni * 1e-6)
        if has_heat(study):
            way = Way.at(study, point.inputs, layout, point.__getitem__)
            made["design_point_heat"] = heat_power(made["design_point_power"], way.values, point.inputs.losses)
    return made


def _mean(values: Floats, weight: Floats) -> Any:
    lit = weight > 0  # omit zero weights so that padding does not change the summation order
    return np.sum(values[lit] * weight[lit]) / (np.sum(weight[lit]) or np.nan)


def _sizes(point: Point, layout: Layout, area: Floats, rows: NDArray[np.int64]) -> dict[str, Any]:
    """Return positions of the heliostats in `rows` [m, deg], field sizes [m, m2] and the number of days."""
    study, pivots = point.study, layout.z + layout.values("pivot_height", point["heliostat.pivot_height"])
    distance, elevation = np.full(area.shape, np.nan), np.full(area.shape, np.nan)
    distance[rows] = away = np.hypot(layout.x, layout.y)
    elevation[rows] = np.degrees(np.arctan2(point["receiver.height"] - pivots, away))
    radius = float(np.hypot(*_sides(point, point.layout)).max() / 2)
    key = f"land {point.index if study.keep else id(layout)} {radius}"
    land = point.points.once(key, partial(land_area, layout.x, layout.y, radius))
    dates = len(set(study.time.date_list())) if isinstance(study.time, CivilTime) else 0
    hours = point.all_instants.labels["hours"].values if study.weather is not None and not dates else np.full(1, np.nan)
    return {
        "tower_distance": distance, "target_elevation": elevation, "field_land_area": land,
        "field_packing_factor": area.sum() / land, "days": dates or hours.sum() / 24.0,
        "field_mean_radius": _mean(distance, area),
    }  # fmt: skip


def _energies(point: Point, values: Mapping[str, Any], area: Floats, total: Callable[[Floats], Any]) -> dict[str, Any]:
    """Return the energies, hours and heliostat ranks of a field. The function `total` sums over the heliostats."""
    hours, rank, made = cast(Hours, light_of(point)[1]), np.full(area.shape, np.nan), dict[str, Any]()
    for name, of in (
        ("field_receiver_energy", "receiver_energy"), ("field_incident_energy", "incident_energy"),
        ("loss", "heliostat_loss"), ("monthly_receiver_energy", "heliostat_monthly_receiver_energy"),
    ):  # fmt: skip
        made[name] = total(values[of])
        if (errors := values.get(f"{of}_error")) is not None:
            made[f"{name}_error"] = np.sqrt(total(np.nan_to_num(errors) ** 2))
    each, received = values["receiver_energy"] / np.where(area > 0, area, np.nan), made["field_receiver_energy"]
    ranked = np.flatnonzero((area > 0) & bool(received > 0))
    rank[ranked[np.argsort(-each[ranked], kind="stable")]] = np.arange(1, len(ranked) + 1)
    return made | {
        "energy_per_mirror_area": each, "rank": rank, "hours_used": hours.used, "hours_lost": hours.lost,
        "field_energy_per_mirror_area": received / (area.sum() or np.nan),
        "monthly_incident_energy": area.sum() * hours.incident,
    }  # fmt: skip


def _sides(point: Point, layout: Layout) -> tuple[Any, Any]:
    width, height = (layout.values(key.rpartition(".")[2], point[key]) for key in _SIZES)
    return width, height


def _design_name(study: FieldEfficiencyStudy) -> str:
    """Return the name of the design-point efficiency that determines the power of a field."""
    return DESIGN[-1] if study.optics is not None else DESIGN[len(EFFICIENCIES) - 1]


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
                f"{int(short.sum()):,} of {short.size:,} fields do not reach keep.{key} even with all heliostats (at "
                f"most {most:.4g} MW): generate more heliostats"
            )


def best(
    values: Floats, number: float | None, power: float | None, power_of: Callable[[NDArray[np.int64]], float]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Select the highest-ranked heliostats of a field.

    Parameters
    ----------
    values : ndarray, shape (heliostat,)
        Values by which heliostats are ranked, highest first. Heliostats with equal values keep their order. NaN is
        ranked last.
    number, power : float, optional
        Number of heliostats to keep, or required power in the unit of `power_of`.
    power_of : callable
        Function that returns the power of a field containing only the given heliostat rows.

    Returns
    -------
    rows : ndarray of int
        Rows of the selected heliostats in ascending order. If a power is given, bisection finds the minimum number
        of highest-ranked heliostats that reach this power. If the full field does not reach this power, all
        heliostats are selected.
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
    point: Point, field_of: Callable[[Layout], Field | TracedField], aimed: Callable[[Layout], Field | TracedField],
    sun: Floats, hours: Hours | None,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:  # fmt: skip
    """Return the layout rows of the kept heliostats and the ranks of all heliostats.

    `field_of` returns the field of a layout. `aimed` returns the field with aim points that respect the flux limit.
    Heliostats are ranked in the full field, without a flux limit and with fewer rays than in the final computation.
    """
    number, power, by, heat = (point[key] for key in _KEEP)
    whole, study, layout = field_of(point.layout), point.study, point.layout
    if isinstance(whole, TracedField):
        whole = whole._replace(coarse=8.0)
    ranks = _design(whole, 0, len(layout)) if by in DESIGN else blocks_of(whole, sun, hours, 0, len(layout))
    if by == "energy_per_mirror_area":
        ranks[by] = ranks["receiver_energy"] / whole.area

    def power_of(rows: NDArray[np.int64]) -> float:
        field = aimed(layout.part(rows))
        values = _design(field, 0, field.area.size)[_design_name(study)]
        found = float(np.sum(values * field.area)) * study.design_point.dni * 1e-6
        if heat is None or not isinstance(field, TracedField):
            return found
        return float(heat_power(found, field.way.values, point.inputs.losses))

    return best(ranks[by], number, power if heat is None else heat, power_of)

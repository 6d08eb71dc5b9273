"""Receiver flux maps, and aim points on levels, from the layout or under a flux limit."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.aiming import (
    RAYS,
    SLACK,
    VARIABLES,
    aim_grid,
    image_bytes,
    limited_aims,
    off_receiver,
    targets,
)
from heliosweep.config import Block, Choice, Fault, ListOfNumbers, Quantity, SunDirections, Sweep
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.families.field_efficiency.chain import Geometry, Inputs, Way, values_of
from heliosweep.families.field_efficiency.optics import KEYS
from heliosweep.grid.sun import instant_count
from heliosweep.kernels import rays
from heliosweep.kernels.compiled import Floats
from heliosweep.layouts.layout import MAX_LISTED
from heliosweep.layouts.resolve import SIZE_COLUMNS

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.families.field_efficiency.traced import TracedField
    from heliosweep.families.field_efficiency.values import Hours
    from heliosweep.families.points import Point
    from heliosweep.layouts.layout import Layout

#: Default direct normal irradiance. [W/m2]
IRRADIANCE = 1000.0
DIMS = ("flux_row", "flux_column")


class FluxMap(Block):
    """Flux map on a grid of receiver cells. The flux is averaged over each cell."""

    columns: Annotated[
        int,
        Quantity("Number of cells along the width of a rectangle or around a cylinder", "1", ge=1, le=360, integer=True,
                 sweep=False),
    ]  # fmt: skip
    rows: Annotated[int, Quantity("Number of cells along the height", "1", ge=1, le=360, integer=True, sweep=False)]
    limit: Annotated[
        float | None,
        Quantity(
            "Flux limit; the fraction of the power on cells above this limit is stored", "kW/m2", gt=0, sweep=False
        ),
    ] = None


def flux_cells(study: FieldEfficiencyStudy) -> tuple[int, int] | None:
    """Return the numbers of rows and columns of the flux map; None if the study has no flux map."""
    wanted = study.output.flux_map
    return None if wanted is None else (wanted.rows, wanted.columns)


def cells_of(study: FieldEfficiencyStudy) -> tuple[int, int] | None:
    """Return the numbers of rows and columns of receiver cells; None without flux limit and flux map."""
    if study.aim is not None and is_limited(study):
        return study.aim.flux_rows, study.aim.flux_columns
    return flux_cells(study)


def is_limited(study: FieldEfficiencyStudy) -> bool:
    """Return True if the aim points are chosen under a flux limit."""
    return study.aim is not None and study.aim.strategy == "flux_limit"


def varies(study: FieldEfficiencyStudy) -> bool:
    """Return True if the aim points are chosen separately for each instant."""
    return study.aim is not None and study.aim.at == "instants"


def has_instant(study: FieldEfficiencyStudy) -> bool:
    """Return True if the study has one instant for flux maps: a design point, or a single instant."""
    return study.design_point is not None or instant_count(study.time) == 1


def flux_labels(study: FieldEfficiencyStudy) -> dict[str, Any]:
    """Return the centres of the receiver cells and their attributes.

    Centres are in metres, or in degrees around a cylinder. If the size of the receiver is swept, the centres are
    fractions of this size. The result is empty without flux maps.
    """
    cells, receiver = cells_of(study), study.receiver
    if cells is None:
        return {}
    places = [(np.arange(count) + 0.5) / count for count in cells]
    middle = "from the middle of the receiver"
    row = _label(places[0] - 0.5, receiver.height_extent, "height on the receiver", f"{middle}, along its height")
    if receiver.kind == "cylinder":
        words = {"long_name": "azimuth on the receiver", "comment": "of its surface, clockwise from north"}
        column = 360.0 * places[1], {"units": "degree", **words}
    else:
        right = f"{middle}, to the right as seen from the mirrors"
        column = _label(places[1] - 0.5, receiver.width, "position across the receiver", right)
    return dict(zip(DIMS, (row, column), strict=True))


def _label(part: Floats, size: Any, long_name: str, comment: str) -> tuple[Floats, dict[str, str]]:
    if isinstance(size, Sweep):
        return part, {"units": "1", "long_name": f"{long_name}, relative to its size", "comment": comment}
    return part * float(size), {"units": "m", "long_name": long_name, "comment": comment}


#: Layout columns that contain the aim point of each heliostat.
COLUMNS = ("aim_x", "aim_y", "aim_z")


def _count(description: str, most: int) -> Quantity:
    return Quantity(description, "1", ge=1, le=most, integer=True, sweep=False)


class Aim(Block):
    """Aim points of the heliostats."""

    strategy: Annotated[
        str,
        Choice(
            "Aiming strategy",
            {
                "centre": "all at the centre of the receiver; on a cylinder, at the point at mid-height that faces "
                "the heliostat",
                "spread": "at several levels of the receiver, assigned cyclically around the tower",
                "layout": "at the points aim_x, aim_y, aim_z of the layout [m]",
                "flux_limit": "on a grid of points, or stowed, to maximise the power under a flux limit",
            },
            sweep=False,
        ),
    ] = "centre"
    levels: Annotated[
        int | Sweep | None,
        Quantity("Number of levels for spread; 1 is the centre", "1", ge=1, le=99, integer=True, dimension="aim_levels",
                 title="number of aim levels"),
    ] = None  # fmt: skip
    limit: Annotated[
        float | Sweep | None,
        Quantity("Maximum flux on each receiver cell, for flux_limit", "kW/m2", gt=0, dimension="flux_limit",
                 title="flux limit"),
    ] = None  # fmt: skip
    limits: Annotated[
        tuple[tuple[float, ...], ...] | None,
        ListOfNumbers("Cell rows with individual limits, counted from 0 at the bottom, and these limits in kW/m2",
                      ("1", "kW/m2"), ("row", "limit"), ge=0),
    ] = None  # fmt: skip
    safety: Annotated[float, Quantity("Maximum flux as a fraction of the limit", "1", gt=0, le=1, sweep=False)] = 1.0
    rows: Annotated[int, _count("Number of rows of aim points", 99)] = 7
    columns: Annotated[int, _count("Number of columns of aim points", 99)] = 3
    azimuth_span: Annotated[
        float,
        Quantity((
            "Azimuth range of the columns on a cylinder, centred on the point nearest to the heliostat"
        ), "deg", ge=0, le=170,
                 sweep=False),
    ] = 40.0  # fmt: skip
    flux_rows: Annotated[int, _count("Number of cell rows to which the limit applies", 360)] = 20
    flux_columns: Annotated[int, _count("Number of cell columns to which the limit applies", 360)] = 36
    at: Annotated[
        str,
        Choice(
            "Instants for which aim points are chosen",
            {
                "design_point": "one set of aim points, for the design point or the only instant",
                "instants": "one set for each instant",
            },
            sweep=False,
        ),
    ] = "design_point"

    def rules(self) -> Iterator[Fault]:
        """Check that each key belongs to the strategy, and that the limits refer to existing rows of receiver cells."""
        for key in self.model_fields_set - {"strategy"}:
            strategy = "spread" if key == "levels" else "flux_limit"
            default = type(self).model_fields[key].default  # resolved studies contain default values
            if self.strategy != strategy and getattr(self, key) != default:
                yield Fault(f"is only for the strategy {strategy}; remove it", (key,))
        if self.strategy == "flux_limit" and self.limit is None:
            yield Fault("'limit' is missing: the strategy flux_limit requires it, in kW/m2", show_value=False)
        for k, (row, limit) in enumerate(self.limits or ()):
            if row % 1 or row >= self.flux_rows or limit <= 0.0:
                yield Fault(f"must be a row from 0 to {self.flux_rows - 1}, and a limit above 0", ("limits", k))
            elif row in [other for other, _ in (self.limits or ())[:k]]:
                yield Fault(f"has a second limit for row {row:g}; remove one", ("limits", k))


def aims(way: Way, mirrors: Geometry, levels: int | None) -> Floats:
    """Return the aim points of the mirrors.

    Without `aim`, with `centre`, and before `flux_limit` selects aim points, heliostats aim at the centre of the
    receiver. If the receiver is a cylinder, heliostats aim at the nearest surface point at mid-height.

    With `spread`, the levels are evenly spaced over the height of the receiver. This height is reduced at each end by
    the radius of the heliostat's spot (two standard deviations of its on-axis HFLCAL image). Heliostats are ordered by
    azimuth, clockwise from north, then by distance from the tower. Levels are assigned cyclically in this order,
    starting at the lowest level. A heliostat with a spot larger than the receiver aims at the centre.

    Parameters
    ----------
    way : Way
        Optical path at a point of the result.
    mirrors : tuple
        Mirror centres (x, y, z), half widths and half heights, in the argument order of `sorted_field`. [m]
    levels : int or None
        Number of levels for `spread`.

    Returns
    -------
    ndarray, shape (N, 3)
        Coordinates of the aim points: east, north and up from the base of the tower. [m]
    """
    values = way.values
    strategy = way.study.aim.strategy if way.study.aim is not None else "centre"
    if strategy == "layout":
        return np.stack([way.layout.columns[key].astype(float) for key in COLUMNS], axis=1)
    centre = np.stack(mirrors[:3], axis=1)
    middle = np.zeros_like(centre)
    if values["radius"]:
        middle[:, :2] = (values["radius"] / np.sqrt(centre[:, 0] ** 2 + centre[:, 1] ** 2))[:, np.newaxis] * centre[
            :, :2
        ]
    middle[:, 2] = values["height"]
    if strategy == "spread" and (count := 3 if levels is None else int(levels)) > 1:
        sides = 2.0 * np.stack(mirrors[3:5], axis=1)
        height = np.maximum(0.0, room(way, centre, sides, middle))
        level = 2.0 * (turns(centre) % count) / (count - 1) - 1.0
        middle += (level * height)[:, np.newaxis] * way.receiver.upward
    return middle


def turns(centre: Floats) -> NDArray[np.int64]:
    """Return the rank of each heliostat, counted from 0, sorted by azimuth and then by distance from the tower."""
    azimuth = np.round(np.arctan2(centre[:, 0], centre[:, 1]) % (2.0 * np.pi), 9) % np.round(2.0 * np.pi, 9)
    order = np.lexsort((np.hypot(centre[:, 0], centre[:, 1]), azimuth))
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return place


def room(way: Way, centre: Floats, sides: Floats, middle: Floats) -> Floats:
    """Return each aim point's maximum height above the receiver's centre; negative if the spot is too large. [m]"""
    away, receiver = middle - centre, way.receiver
    slant = np.sqrt(np.sum(away**2, axis=1))
    along, aside = away @ receiver.upward / slant, away @ receiver.across / slant
    if receiver.kind == rays.CYLINDER:
        aside = np.zeros_like(along)
    square = np.maximum(1.0 - along**2 - aside**2, 1e-9)  # squared cosine of the angle of incidence on the receiver
    return 0.5 * float(way.values["height_extent"]) - 2.0 * way.spot(slant, sides) * np.sqrt((1.0 - aside**2) / square)


def aim_problems(
    study: FieldEfficiencyStudy, points: Iterable[tuple[Layout, Mapping[str, Any]]]
) -> Iterator[Problem | str]:
    """Yield the problems and warnings about aim points, from the first result point that has any."""
    inputs = Inputs(study)
    for layout, given in points:
        way = Way(study, inputs, layout, values_of([given.get(key) for key in KEYS]))
        if found := list(_problems(way, given)):
            yield from found
            return


def _problems(way: Way, given: Mapping[str, Any]) -> Iterator[Problem | str]:
    study, layout = way.study, way.layout
    centre = np.stack((layout.x, layout.y, layout.z + given["heliostat.pivot_height"]), axis=1)
    if study.aim.strategy == "layout":
        missing = [key for key in COLUMNS if key not in layout.columns or layout.columns[key].dtype.kind not in "if"]
        if missing:
            message = f"needs columns {', '.join(COLUMNS)} of numbers in the layout {layout.name}, in m"
            yield study.problem("aim.strategy", message)
        else:
            yield from _off(way, centre)
        return
    if study.aim.strategy == "flux_limit":
        receiver = way.receiver
        points = aim_grid(receiver, centre, study.aim.rows, study.aim.columns, np.radians(study.aim.azimuth_span))
        if (unseen := np.flatnonzero((off_receiver(receiver, centre, points) > SLACK).any(axis=0))).size:
            message = f"{layout.where(unseen[0])} of {layout.name} does not see the outer aim points"
            if study.receiver.kind == "cylinder":
                yield study.problem("aim.azimuth_span", f"{message}; reduce it")
            else:
                yield f"heliostats behind the receiver's face are stowed: {unseen.size:,} of {len(layout):,}"
        return
    sides = np.stack([np.broadcast_to(given[f"heliostat.{side}"], len(layout)) for side in SIZE_COLUMNS], axis=1)
    middle = aims(way, (*centre.T, *sides.T / 2), 1)
    without = int(np.sum(room(way, centre, sides, middle) <= 0))
    if without == len(layout) and study.aim.levels != 1:
        message = "leaves no space for levels: the spots of all heliostats are at least as high as the receiver"
        yield study.problem("aim.levels" if study.aim.levels is not None else "aim", message)
    elif without:
        spots = f"the spots of {without:,} of {len(layout):,} heliostats"
        yield f"{spots} are at least as high as the receiver: these heliostats aim at its middle"


def _off(way: Way, centre: Floats) -> Iterator[Problem]:
    """Yield a problem for each aim point that is off the receiver, or on a side that faces away from the heliostat."""
    layout, receiver = way.layout, way.receiver
    points = np.stack([layout.columns[key].astype(float) for key in COLUMNS], axis=1)
    away = off_receiver(receiver, centre, points)
    bad = np.flatnonzero(~(away <= SLACK))

    def problem(row: int) -> Problem:
        far = "nowhere" if np.isnan(away[row]) else f"{away[row]:.4g} m off the receiver"
        what = "on a side of the receiver that faces away from it" if np.isinf(away[row]) else far
        place = ", ".join(f"{key} {value:.6g}" for key, value in zip(COLUMNS, points[row], strict=True))
        line = None if layout.lines is None else int(layout.lines[row])
        return Problem(f"heliostat {row} aims {what}: {place}", file=layout.name, line=line)

    yield from listed(map(problem, bad.tolist()), MAX_LISTED, len(bad), "more problems of this kind")


#: Maximum number of instants for which aim points can be chosen separately.
MOST_INSTANTS = 100


def limit_rules(study: FieldEfficiencyStudy) -> tuple[tuple[object, str, str], ...]:
    """Return the rules for a flux limit. Each rule lists the condition for a fault, the key and the message."""
    instants, shown = instant_count(study.time), study.output.flux_map
    some = isinstance(study.time, SunDirections) or study.design_point or instants > MOST_INSTANTS
    return (
        (is_limited(study) and not varies(study) and not has_instant(study), "aim",
         "requires an instant at which the flux is limited: add 'design_point', or set 'at: instants'"),
        (varies(study) and some, "aim.at",
         f"is for times at a site without 'design_point', at most {MOST_INSTANTS} (got {instants:,}): remove it"),
        (is_limited(study) and shown and flux_cells(study) != cells_of(study), "output.flux_map",
         f"must have the same cells as the flux limit, {' x '.join(map(str, cells_of(study) or ()))}: set "
         "'aim.flux_rows' and 'aim.flux_columns' to the rows and columns of the map"),
    )  # fmt: skip


def images(study: FieldEfficiencyStudy, heliostats: int, instants: int) -> tuple[float, int]:
    """Return the number of rays per heliostat for images at all instants, and the memory for the images. [1, bytes]"""
    if study.aim is None or not is_limited(study):
        return 0.0, 0
    aims, kind = study.aim.rows * study.aim.columns, rays.CYLINDER if study.receiver.kind == "cylinder" else 0
    size = image_bytes(kind, heliostats, aims, (study.aim.flux_rows, study.aim.flux_columns), RAYS)
    return float(aims * RAYS * (instants if varies(study) else 1)), size


def limited(point: Point, field: Any, sun: Floats, hours: Hours | None) -> Any:
    """Return the field with the aim points that a flux limit requires.

    Aim points are chosen for the design point, or separately for each instant. Without a flux limit, the field is
    returned unchanged.

    Raises
    ------
    StudyError
        If the flux of a single heliostat exceeds the limit.
    """
    study, aim, design = point.study, point.study.aim, point.study.design_point
    if not is_limited(study):
        return field
    dni, months = np.full(len(sun), IRRADIANCE), field.months
    if design is not None and field.place[0] is not None:
        sun, dni, months = design.sun(field.place[0]), np.array([design.dni]), np.array([design.month()])
    elif hours is not None:
        dni, months = hours.dni, hours.month
    share = np.multiply.outer(1e-3 * dni * field.way.reflected(months, len(sun)), field.share)
    limit = np.full((aim.flux_rows, aim.flux_columns), point["aim.limit"])
    for row, value in aim.limits or ():
        limit[int(row)] = value
    scene, span = field.scene, np.radians(aim.azimuth_span)
    points = aim_grid(scene.receiver, scene.centre, aim.rows, aim.columns, span)

    def chosen() -> dict[str, Floats]:
        found = dict[str, Any]()
        sizes = {"heliostat": len(scene.centre), "flux_row": aim.flux_rows, "flux_column": aim.flux_columns}
        for k in np.flatnonzero((sun[:, 2] > 0.0) & (dni > 0.0)):
            try:
                values = limited_aims(
                    scene,
                    sun[k : k + 1],
                    points,
                    aim.safety * limit,
                    share[k],
                    seed=study.optics.seed,
                    threads=field.threads,
                )
            except ValueError as error:
                raise StudyError(study.problem("aim.limit", f"{error}; increase it")) from None
            for name, (dims, *_) in VARIABLES.items():
                found.setdefault(name, np.full((len(sun), *(sizes[dim] for dim in dims)), np.nan))[k] = values[name]
        return found

    key = pickle.dumps((scene, sun, share, limit))
    return with_aims(field, field.way.inputs.last("aims", key, chosen))


def with_aims(field: TracedField, aims: Mapping[str, Floats]) -> TracedField:
    """Return the field with new aim points. `aims` contains the values of `VARIABLES` at one or all instants."""
    if not aims:
        return field
    field = field._replace(aims=aims)
    target = targets(field.scene, np.stack([aims[f"aim_{axis}"] for axis in "xyz"], axis=-1))
    if varies(field.study):
        return field._replace(targets=target)
    mirrors = (*field.mirrors[:5], target[0], field.mirrors[6])
    return field._replace(mirrors=mirrors, scene=field.scene._replace(target=target[0]))

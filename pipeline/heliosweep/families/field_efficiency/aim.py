"""Aim points of the heliostats: receiver centre, levels, points from the layout, or points under a flux limit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.aiming import SLACK, aim_grid, off_receiver
from heliosweep.config import Block, Choice, Fault, ListOfNumbers, Quantity, Sweep
from heliosweep.errors import Problem, listed
from heliosweep.families.field_efficiency.optics import KEYS
from heliosweep.kernels.compiled import Floats
from heliosweep.layouts.layout import MAX_LISTED
from heliosweep.layouts.resolve import SIZE_COLUMNS

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.chain import Geometry, Way
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.layouts.layout import Layout


STRATEGIES = {
    "centre": "all at the middle of the receiver; of a cylinder, at the point of this height that faces the heliostat",
    "spread": "at levels over the receiver's height, cyclically around the tower",
    "layout": "at the points aim_x, aim_y, aim_z of the layout [m]",
    "flux_limit": "on a grid of points, or stowed, for the maximum power under a flux limit",
}
#: Layout columns that contain the aim point of each heliostat.
COLUMNS = ("aim_x", "aim_y", "aim_z")
#: Spot radius that `spread` keeps within the receiver, in standard deviations of the spot.
SPOT = 2.0
#: Allowed values of `aim.at`: the instants for which aim points are chosen under a flux limit.
AT = {
    "design_point": "one set of aim points, for the design point or the only instant",
    "instants": "one set for each instant",
}


def _count(description: str, most: int) -> Quantity:
    return Quantity(description, "1", ge=1, le=most, integer=True, sweep=False)


class Aim(Block):
    """Aim points of the heliostats."""

    strategy: Annotated[str, Choice("Strategy of the aim points", STRATEGIES, sweep=False)] = "centre"
    levels: Annotated[
        int | Sweep | None,
        Quantity("Number of levels of spread; 1 is the middle", "1", ge=1, le=99, integer=True, dimension="aim_levels",
                 title="levels of aim"),
    ] = None  # fmt: skip
    limit: Annotated[
        float | Sweep | None,
        Quantity("Maximum flux of each cell of the receiver, for flux_limit", "kW/m2", gt=0, dimension="flux_limit",
                 title="limit of the flux"),
    ] = None  # fmt: skip
    limits: Annotated[
        tuple[tuple[float, ...], ...] | None,
        ListOfNumbers("Rows of cells with another limit, from 0 at the bottom, and their limits in kW/m2",
                      ("1", "kW/m2"), ("row", "limit"), ge=0),
    ] = None  # fmt: skip
    safety: Annotated[float, Quantity("Maximum flux as a fraction of the limit", "1", gt=0, le=1, sweep=False)] = 1.0
    rows: Annotated[int, _count("Rows of aim points", 99)] = 7
    columns: Annotated[int, _count("Columns of aim points", 99)] = 3
    azimuth_span: Annotated[
        float,
        Quantity("Range of the columns on a cylinder, around the point nearest to the heliostat", "deg", ge=0, le=170,
                 sweep=False),
    ] = 40.0  # fmt: skip
    flux_rows: Annotated[int, _count("Rows of cells with the limit", 360)] = 20
    flux_columns: Annotated[int, _count("Columns of cells with the limit", 360)] = 36
    at: Annotated[str, Choice("Instants of the aims", AT, sweep=False)] = "design_point"

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


#: Default levels of `spread`.
LEVELS = 3


def aims(way: Way, mirrors: Geometry, levels: int | None) -> Floats:
    """Return the aim points of the mirrors.

    Without `aim`, with `centre`, and before `flux_limit` selects aim points, heliostats aim at the centre of the
    receiver. If the receiver is a cylinder, they aim at the nearest surface point at the height of its centre.

    With `spread`, the levels are evenly spaced over the height of the receiver. This height is reduced at each end by
    the radius of the heliostat's spot (two standard deviations of its on-axis HFLCAL image). Heliostats are ordered by
    azimuth, clockwise from north, then by distance from the tower. Levels are assigned cyclically in this order, from
    the lowest upwards. A heliostat with a spot larger than the receiver aims at the centre.

    Parameters
    ----------
    way : Way
        Optical path at a point of the result.
    mirrors : tuple
        Centres x, y, z, half widths and half heights of all mirrors, as in the first arguments of `sorted_field`. [m]
    levels : int or None
        Number of levels for `spread`.

    Returns
    -------
    ndarray, shape (N, 3)
        Aim points east, north and up from the base of the tower. [m]
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
    if strategy == "spread" and (count := LEVELS if levels is None else int(levels)) > 1:
        sides = 2.0 * np.stack(mirrors[3:5], axis=1)
        height = np.maximum(0.0, room(way, centre, sides, middle))
        level = 2.0 * (turns(centre) % count) / (count - 1) - 1.0
        middle += (level * height)[:, np.newaxis] * axes(way)[1]
    return middle


def turns(centre: Floats) -> NDArray[np.int64]:
    """Return the rank of each heliostat, counted from 0, sorted by azimuth and then by distance from the tower."""
    azimuth = np.round(np.arctan2(centre[:, 0], centre[:, 1]) % (2.0 * np.pi), 9) % np.round(2.0 * np.pi, 9)
    order = np.lexsort((np.hypot(centre[:, 0], centre[:, 1]), azimuth))
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return place


def axes(way: Way) -> tuple[Floats, Floats]:
    """Return unit vectors along the width and the height of the receiver; a cylinder has only its vertical axis."""
    from heliosweep.families.field_efficiency.chain import receiver_of

    receiver = receiver_of(str(way.study.receiver.kind), way.values)
    return np.array(receiver.across), np.array(receiver.upward)


def room(way: Way, centre: Floats, sides: Floats, middle: Floats) -> Floats:
    """Return each aim point's maximum height above the receiver's centre; negative if the spot is too large. [m]"""
    away = middle - centre
    slant = np.sqrt(np.sum(away**2, axis=1))
    across, upward = axes(way)
    along, aside = away @ upward / slant, away @ across / slant
    if way.study.receiver.kind == "cylinder":
        aside = np.zeros_like(along)
    square = np.maximum(1.0 - along**2 - aside**2, 1e-9)  # cosine of incidence on the receiver
    return 0.5 * float(way.values["height_extent"]) - SPOT * way.spot(slant, sides) * np.sqrt((1.0 - aside**2) / square)


def aim_problems(
    study: FieldEfficiencyStudy, points: Iterable[tuple[Layout, Mapping[str, Any]]]
) -> Iterator[Problem | str]:
    """Yield the problems and warnings about aim points at the first point of the result that has any."""
    from heliosweep.families.field_efficiency.chain import Inputs, Way, values_of

    inputs = Inputs(study)
    for layout, given in points:
        way = Way(study, inputs, layout, values_of([given.get(key) for key in KEYS]))
        if found := list(_problems(way, given)):
            yield from found
            return


def _problems(way: Way, given: Mapping[str, Any]) -> Iterator[Problem | str]:
    """Yield problems and warnings about aim points at one point of the result."""
    from heliosweep.families.field_efficiency.chain import receiver_of

    study, layout = way.study, way.layout
    centre = np.stack((layout.x, layout.y, layout.z + given["heliostat.pivot_height"]), axis=1)
    assert study.aim is not None
    if study.aim.strategy == "layout":
        missing = [key for key in COLUMNS if key not in layout.columns or layout.columns[key].dtype.kind not in "if"]
        if missing:
            message = f"needs columns {', '.join(COLUMNS)} of numbers in the layout {layout.name}, in m"
            yield study.problem("aim.strategy", message)
        else:
            yield from _off(way, centre)
        return
    if study.aim.strategy == "flux_limit":
        receiver = receiver_of(str(study.receiver.kind), way.values)
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
    from heliosweep.families.field_efficiency.chain import receiver_of

    layout, receiver = way.layout, receiver_of(str(way.study.receiver.kind), way.values)
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

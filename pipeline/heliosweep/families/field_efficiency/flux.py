"""Receiver flux maps, and aim points on levels, from the layout or under a flux limit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from heliosweep.aiming import RAYS, image_bytes
from heliosweep.config import Block, Choice, Fault, ListOfNumbers, Quantity, SunDirections, Sweep
from heliosweep.grid.sun import instant_count
from heliosweep.kernels import rays
from heliosweep.kernels.compiled import Floats

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

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

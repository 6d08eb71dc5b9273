"""Flux maps of a study: receiver cells, and the variables and coordinates in the result."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from heliosweep.config import Block, Quantity, Sweep
from heliosweep.grid.sun import instant_count
from heliosweep.kernels.compiled import Floats

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy


#: Default direct normal irradiance. [W/m2]
IRRADIANCE = 1000.0
DIMS = ("flux_row", "flux_column")


class FluxMap(Block):
    """Numbers of receiver cells along each side; the flux is averaged over each cell."""

    columns: Annotated[
        int,
        Quantity("Cells along the width of a rectangle, or around a cylinder", "1", ge=1, le=360, integer=True,
                 sweep=False),
    ]  # fmt: skip
    rows: Annotated[int, Quantity("Cells along the height", "1", ge=1, le=360, integer=True, sweep=False)]
    limit: Annotated[
        float | None,
        Quantity("Flux limit: the share of the power above this flux is stored", "kW/m2", gt=0, sweep=False),
    ] = None


def flux_cells(study: FieldEfficiencyStudy) -> tuple[int, int] | None:
    """Return the rows and columns of receiver cells for flux maps; None without flux maps."""
    wanted = study.output.flux_map
    return None if wanted is None else (wanted.rows, wanted.columns)


def cells_of(study: FieldEfficiencyStudy) -> tuple[int, int] | None:
    """Return the rows and columns of receiver cells for a flux limit or flux maps; None if the study has neither."""
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

    Centres are in metres, or in degrees around a cylinder. If the size of the receiver is swept, they are fractions of
    this size. The result is empty without flux maps.
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

"""Flux maps of a study: receiver cells, and the variables and coordinates in the result."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from heliosweep.aiming import VARIABLES
from heliosweep.config import Block, Quantity, Sweep
from heliosweep.grid.regions import Variable, quantity
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


_DESCRIBED: dict[str, tuple[str, str, str]] = {
    "flux_map": ("kW m-2", "flux on the receiver", "mean over each cell of the flux from all heliostats, {}"),
    "peak_flux": (
        "kW m-2",
        "largest flux of a cell of the receiver",
        "corrected for the bias that noise of the rays causes, {}",
    ),
    "mean_flux": ("kW m-2", "mean flux on the receiver", "power on the receiver over its whole surface, {}"),
    "power_above_limit": ("1", "share of the power on cells with a flux above the limit", "limit: {:g} kW/m2"),
    "energy_flux_map": ("MWh m-2", "energy on the receiver over the period", "mean over each cell"),
}
#: Names of the variables with a standard error, and names of all variables and dimensions.
NOISY = ("flux_map", "peak_flux", "mean_flux", "energy_flux_map")
NAMES = (*_DESCRIBED, *(f"{name}_error" for name in NOISY), *DIMS)


def flux_sizes(study: FieldEfficiencyStudy) -> dict[str, int]:
    """Return the length of each dimension of the study's flux maps (rows, columns); empty without flux maps."""
    wanted = study.output.flux_map
    return {} if wanted is None else dict(zip(DIMS, (wanted.rows, wanted.columns), strict=True))


def cells_of(study: FieldEfficiencyStudy) -> tuple[int, int] | None:
    """Return the rows and columns of receiver cells for a flux limit or flux maps; None if the study has neither."""
    aim, wanted = study.aim, study.output.flux_map
    if aim is not None and is_limited(study):
        return aim.flux_rows, aim.flux_columns
    return None if wanted is None else (wanted.rows, wanted.columns)


def is_limited(study: FieldEfficiencyStudy) -> bool:
    """Return True if the aim points are chosen under a flux limit."""
    return study.aim is not None and study.aim.strategy == "flux_limit"


def varies(study: FieldEfficiencyStudy) -> bool:
    """Return True if the aim points are chosen separately for each instant."""
    return study.aim is not None and study.aim.at == "instants"


def has_instant(study: FieldEfficiencyStudy) -> bool:
    """Return True if the study has one instant for flux maps: a design point, or a single instant."""
    return study.design_point is not None or instant_count(study.time) == 1


def flux_variables(study: FieldEfficiencyStudy) -> dict[str, Variable]:
    """Return the flux-map variables of a study; empty without flux maps."""
    wanted, found = study.output.flux_map, dict[str, Variable]()
    if wanted is None:
        return found
    point = study.design_point
    words = f"direct normal irradiance {IRRADIANCE:g} W/m2" if point is None else "at the design point"
    for name, (units, long_name, comment) in _DESCRIBED.items():
        if study.weather is None if name == "energy_flux_map" else not has_instant(study):
            continue
        if name == "power_above_limit" and wanted.limit is None:
            continue
        dims = DIMS if name.endswith("map") else ()
        more: dict[str, Any] = {"valid_range": [0.0, 1.0]} if units == "1" else {}
        comment = comment.format(wanted.limit if name == "power_above_limit" else words)
        found[name] = quantity(dims, units, long_name, comment, **more)
        if name in NOISY:
            long_name = f"standard error of the {long_name}"
            found[f"{name}_error"] = quantity(dims, units, long_name, "by independent sets of rays")
    return found


def limit_variables(study: FieldEfficiencyStudy) -> dict[str, Variable]:
    """Return the variables of aim points under a flux limit; empty without a flux limit."""
    time, limited = ("time",) if varies(study) else (), is_limited(study)
    words = f"direct normal irradiance {IRRADIANCE:g} W/m2" if study.weather is None else "at each instant"
    comment = words if study.design_point is None else "at the design point"
    part: dict[str, Any] = {"valid_range": [0.0, 1.0]}
    return {
        name: quantity((*time, *dims), units, words, comment, **(part if name in ("limit_loss", "aim_gap") else {}))
        for name, (dims, units, words) in VARIABLES.items() if limited
    }  # fmt: skip


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

"""The pivots of the heliostats, from positions or from layouts, along ``heliostat``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from heliosweep.families.layout_axis import LayoutAxis, longest
from heliosweep.grid.axes import Grid
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.misalignment.config import MisalignmentStudy

_POSITIONS = {
    "x": "distance of the pivot east of the tower",
    "y": "distance of the pivot north of the tower",
    "z": "height of the pivot above the tower's base",
}


class Places:
    """Heliostats over a slab of the grid; shorter layouts are padded with NaN at their end.

    Parameters
    ----------
    grid : Grid
        Slab of a study.

    Attributes
    ----------
    size : int
        Heliostats of the longest layout of the whole study.
    x, y, z : xarray.DataArray
        Position of each heliostat, east, north and up of the tower's base, over (swept layout parameters,
        ``heliostat``): of its pivot, or of its base where there is a layout. [m]
    inputs : list of xarray.DataArray or Made
        `x`, `y` and `z` as `evaluate` takes them.
    pivot_height : xarray.DataArray
        Height of the pivots above these positions. [m]
    numbers : xarray.DataArray
        0, 1, ... along ``heliostat``.
    coordinates : dict of str to xarray.DataArray
        ``heliostat``, ``x``, ``y``, ``z``, and what else the layouts tell.
    """

    def __init__(self, grid: Grid) -> None:
        study: MisalignmentStudy = grid.study  # type: ignore[assignment]
        if study.layout is not None:
            layouts = LayoutAxis(grid)
            self.size, self.numbers = layouts.size, layouts.numbers
            self.x, self.y, self.z = layouts.x, layouts.y, layouts.z
            self.inputs = layouts.inputs
            self.coordinates = layouts.coordinates()
        else:
            positions = np.array(study.heliostats.positions, np.float64)
            self.size = len(positions)
            self.numbers = xr.DataArray(
                np.arange(self.size),
                dims="heliostat",
                attrs={"long_name": "number of the heliostat: its place among the positions, from 0", "units": "1"},
            )
            self.x, self.y, self.z = (
                xr.DataArray(column, dims="heliostat", attrs={"long_name": name, "units": "m"})
                for column, name in zip(positions.T, _POSITIONS.values(), strict=True)
            )
            self.inputs = [self.x, self.y, self.z]
            self.coordinates = {"heliostat": self.numbers, "x": self.x, "y": self.y, "z": self.z}
        key = "heliostats.pivot_height"
        self.pivot_height = grid.parameter(key) if grid.has(key) else xr.DataArray(0.0)


def heliostat_count(grid: Grid) -> int:
    """Heliostats of the longest layout of a study, without making more layouts than that takes."""
    study: MisalignmentStudy = grid.study  # type: ignore[assignment]
    return longest(grid) if study.layout is not None else len(study.heliostats.positions or ())


def place_bytes(grid: Grid) -> int:
    """Size of the coordinates of the heliostats. [bytes]."""
    study: MisalignmentStudy = grid.study  # type: ignore[assignment]
    if study.layout is None:
        return 4 * 8 * heliostat_count(grid)
    return 6 * 8 * len(Layouts(study)) * heliostat_count(grid)

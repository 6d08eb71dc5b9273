"""The layouts of a study along the dimension ``heliostat``, whatever is swept in its ``layout`` block."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.errors import PlanError
from heliosweep.layouts.layout import NAMED_BY_HELIOSTAT, PROPERTIES, Layout
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    import xarray as xr

_POSITIONS = {
    "x": ("distance of the heliostat east of the tower", "projection_x_coordinate"),
    "y": ("distance of the heliostat north of the tower", "projection_y_coordinate"),
    "z": ("height of the heliostat's base above the tower's base", ""),
}
_COLUMNS = {
    "ring": {"long_name": "ring of the layout, from the tower outwards", "units": "1"},
    "azimuth": {"long_name": "azimuth of the heliostat seen from the tower, clockwise from north", "units": "degree"},
    "width": {"long_name": "mirror width", "units": "m"},
    "height": {"long_name": "mirror height", "units": "m"},
}
#: Maximum number of layouts of a sweep, and of layouts that the plan generates to count their heliostats.
MAX_LAYOUTS, MAX_MADE = 100_000, 6_000


class LayoutAxis:
    """All layouts of a study, which the block with this key names; shorter ones are padded at their end.

    `dims` are the swept dimensions that choose a layout, `size` the heliostats of the longest.
    """

    def __init__(self, study: Study, key: str = "layout") -> None:
        layouts = _counted(study, key)
        self.dims = tuple(dim.name for dim in layouts.dimensions)
        self._shape = tuple(len(dim) for dim in layouts.dimensions)
        self._layouts = list(layouts)
        self.size = max(map(len, self._layouts))

    def at(self, position: Mapping[str, int]) -> Layout:
        """Layout of a point of the result, from its position along each dimension."""
        place = tuple(position[dim] for dim in self.dims)
        return self._layouts[int(np.ravel_multi_index(place, self._shape)) if place else 0]

    def column(self, name: str, padding: object = np.nan) -> xr.DataArray:
        """One column of all layouts over (swept dimensions that choose a layout, ``heliostat``)."""
        import xarray as xr

        columns = [getattr(one, name) if name in _POSITIONS else one.columns[name] for one in self._layouts]
        is_text = any(column.dtype.kind == "U" for column in columns)
        table = np.array(columns[:1], object if is_text else None)
        if len(columns) > 1:
            table = np.full((len(columns), self.size), padding, object if is_text else float)
            for row, column in zip(table, columns, strict=True):
                row[: len(column)] = column
        return xr.DataArray(table.reshape(*self._shape, self.size), dims=(*self.dims, "heliostat"))

    @cached_property
    def numbers(self) -> xr.DataArray:
        """0, 1, ... along ``heliostat``."""
        import xarray as xr

        attrs = {"long_name": "number of the heliostat: its row in the layout, from 0", "units": "1"}
        return xr.DataArray(np.arange(self.size), dims="heliostat", attrs=attrs)

    def coordinates(self) -> dict[str, xr.DataArray]:
        """``heliostat``, ``x``, ``y``, ``z`` and the further columns that all layouts have."""
        coordinates = {"heliostat": self.numbers}
        for name, (long_name, standard_name) in _POSITIONS.items():
            known = {"standard_name": standard_name} if standard_name else {}
            coordinates[name] = self.column(name).assign_attrs(units="m", long_name=long_name, **known)
        for name in self._layouts[0].columns:
            columns = [layout.columns.get(name) for layout in self._layouts]
            kinds = {None if column is None else column.dtype.kind == "U" for column in columns}
            if len(kinds) == 1 and None not in kinds:
                known = (
                    {"long_name": f"{name.replace('_', ' ')} of the heliostat", "units": PROPERTIES[name].unit}
                    if name in PROPERTIES
                    else {"long_name": f"column {name} of the layout"}
                )
                label = self.column(name, "" if True in kinds else np.nan).assign_attrs(_COLUMNS.get(name, known))
                coordinates[f"heliostat_{name}" if name in NAMED_BY_HELIOSTAT else name] = label
        return coordinates


def mirror_size(layout: Layout, side: str, given: float | None) -> np.ndarray:
    """Width or height of every mirror of a layout [m]: the study's value, or else the layout's column of that name."""
    return layout.columns[side].astype(float) if given is None else np.full(len(layout), float(given))


def longest(study: Study, key: str = "layout") -> int:
    """Heliostats of the longest layout of a study, of the block with this key.

    Raises PlanError where the study sweeps over too many layouts; names the longest of their axes.
    """
    layouts = _counted(study, key)
    heliostats = layouts.heliostats
    if heliostats is not None:
        return int(max(heliostats.values()) if isinstance(heliostats, Sweep) else heliostats)
    found: dict[str, int] = study.__dict__.setdefault("_longest", {})  # copies forget it, as all that is found
    most = found.get(key) or max(map(len, layouts))
    if not layouts.of_files:
        found[key] = most
    return most


def _counted(study: Study, key: str) -> Layouts:
    """Layouts that are not too many. Raises PlanError."""
    layouts = Layouts(study, key)
    most = MAX_MADE if layouts.heliostats is None else MAX_LAYOUTS
    number = math.prod(map(len, layouts.dimensions))  # more than `len` may return
    if number > most:
        axis = max(layouts.dimensions, key=len)
        remedy = " or give the layout's 'heliostats'" if most == MAX_MADE else ""
        raise PlanError(f"refused: {number:,} layouts are more than {most:,}; shrink '{axis.name}' first{remedy}")
    return layouts


def weighted_mean(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Mean over the last dimension; its bits do not depend on chunks.

    Values of weight zero are omitted, NaN included. The mean is NaN if all weights are zero.
    """
    means = np.full(values.shape[:-1], np.nan)
    for index in np.ndindex(means.shape):
        used = weights[index] > 0  # taken out, so that padding does not change the order of the sum
        if used.any():
            means[index] = np.sum(values[index][used] * weights[index][used]) / np.sum(weights[index][used])
    return means

"""The layouts of a study as labelled arrays over the swept layout parameters and ``heliostat``."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from heliosweep.config.sweep import Sweep
from heliosweep.errors import PlanError
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import Made
from heliosweep.layouts.resolve import SIZE_COLUMNS, Layouts, Recipe, generated

_POSITIONS = {
    "x": ("distance of the heliostat east of the tower", "projection_x_coordinate"),
    "y": ("distance of the heliostat north of the tower", "projection_y_coordinate"),
    "z": ("height of the heliostat's base above the tower's base", ""),
}


class LayoutAxis:
    """Heliostats over a slab of the grid; shorter layouts are padded at their end.

    Parameters
    ----------
    grid : Grid
        Slab of a study with a ``layout`` block.

    Attributes
    ----------
    size : int
        Heliostats of the longest layout of the whole study.
    x, y, z : xarray.DataArray
        Base of each heliostat, east, north and up of the tower's base, over (swept layout parameters,
        ``heliostat``); NaN where a layout is padded. [m]
    inputs : list of xarray.DataArray or Made
        `x`, `y` and `z` as `evaluate` takes them: generated layouts need not travel with a graph.
    numbers : xarray.DataArray
        0, 1, ... along ``heliostat``.
    """

    def __init__(self, grid: Grid) -> None:
        layouts = Layouts(grid.study)
        self.size = longest(grid)
        self._dims = [dim.name for dim in layouts.dimensions]
        spans = [range(len(dim))[grid.part(dim.name)] for dim in layouts.dimensions]
        self._shape = tuple(len(span) for span in spans)
        self._layouts = [layouts[index] for index in itertools.product(*spans)]
        self.x, self.y, self.z = (self._positions(name) for name in _POSITIONS)
        recipes = tuple(layouts.recipe(index) for index in itertools.product(*spans))
        self.inputs: list[xr.DataArray | Made] = [self.x, self.y, self.z]
        if None not in recipes:
            self.inputs = [
                Made(array, _generated_table, (recipes, self._shape, self.size, name))
                for array, name in zip((self.x, self.y, self.z), _POSITIONS, strict=True)
            ]
        self.numbers = xr.DataArray(
            np.arange(self.size),
            dims="heliostat",
            attrs={"long_name": "number of the heliostat: its row in the layout, from 0", "units": "1"},
        )

    def _labelled(self, columns: list[np.ndarray], padding: object) -> xr.DataArray:
        return xr.DataArray(_table(columns, padding, self._shape, self.size), dims=(*self._dims, "heliostat"))

    def _positions(self, name: str) -> xr.DataArray:
        long_name, standard_name = _POSITIONS[name]
        array = self._labelled([getattr(layout, name) for layout in self._layouts], np.nan)
        return array.assign_attrs(
            units="m", long_name=long_name, **({"standard_name": standard_name} if standard_name else {})
        )

    def mirror_size(self, grid: Grid, side: str) -> xr.DataArray:
        """Width or height of every mirror [m], from the study or from the layout's column of that name.

        Parameters
        ----------
        grid : Grid
            The slab.
        side : {"width", "height"}

        Returns
        -------
        xarray.DataArray
            Over the swept sizes and ``heliostat``, or over the layouts and ``heliostat``.
        """
        if grid.has(f"heliostat.{side}"):
            return grid.parameter(f"heliostat.{side}").expand_dims(heliostat=self.size, axis=-1)
        return self._labelled([layout.columns[side] for layout in self._layouts], np.nan).astype(float)

    def coordinates(self) -> dict[str, xr.DataArray]:
        """``heliostat``, ``x``, ``y``, ``z`` and the further columns that all layouts have."""
        coordinates = {"heliostat": self.numbers, "x": self.x, "y": self.y, "z": self.z}
        for name in self._layouts[0].columns:
            columns = [layout.columns.get(name) for layout in self._layouts]
            kinds = {
                "none" if column is None else "text" if column.dtype.kind == "U" else "number" for column in columns
            }
            if len(kinds) > 1 or "none" in kinds:
                continue
            present = [column for column in columns if column is not None]
            label = self._labelled(present, "" if "text" in kinds else np.nan)
            coordinates[f"heliostat_{name}" if name in SIZE_COLUMNS else name] = label.assign_attrs(
                _column_attributes(name, "text" in kinds)
            )
        return coordinates


def _table(columns: Sequence[np.ndarray], padding: object, shape: tuple[int, ...], size: int) -> np.ndarray:
    """Columns of layouts over (swept layout parameters, heliostat), the shorter ones padded."""
    kinds = {column.dtype.kind for column in columns}
    whole = len(columns) == 1 and size == len(columns[0])
    dtype = object if "U" in kinds else columns[0].dtype if whole else np.dtype(float)
    table = np.full((len(columns), size), padding, dtype=dtype) if not whole else np.array(columns, dtype)
    if not whole:
        for row, column in zip(table, columns, strict=True):
            row[: len(column)] = column
    return table.reshape(*shape, size)


def _generated_table(recipes: tuple[Recipe, ...], shape: tuple[int, ...], size: int, name: str) -> np.ndarray:
    """One coordinate of generated layouts, as `LayoutAxis` has it."""
    return _table([getattr(generated(recipe), name) for recipe in recipes], np.nan, shape, size)


def _column_attributes(name: str, text: bool) -> dict[str, str]:
    known = {
        "ring": {"long_name": "ring of the layout, from the tower outwards", "units": "1"},
        "azimuth": {
            "long_name": "azimuth of the heliostat seen from the tower, clockwise from north",
            "units": "degree",
        },
        "width": {"long_name": "mirror width", "units": "m"},
        "height": {"long_name": "mirror height", "units": "m"},
    }
    return known.get(name, {"long_name": f"column {name} of the layout"})


#: Layouts of a sweep at the most, and of those that have to be made to know how long they are.
MAX_LAYOUTS, MAX_MADE = 100_000, 5_000


def longest(grid: Grid) -> int:
    """Heliostats of the longest layout of the whole study, whatever the slab.

    Raises
    ------
    PlanError
        Where the study sweeps over too many layouts; names the longest of their axes.
    """
    generator = grid.study.layout.radial_stagger  # type: ignore[attr-defined]
    heliostats = None if generator is None else generator.heliostats
    layouts = Layouts(grid.study)
    most = MAX_MADE if heliostats is None else MAX_LAYOUTS
    number = math.prod(len(dim) for dim in layouts.dimensions)
    if number > most:
        axis = max(layouts.dimensions, key=len)
        raise PlanError(f"refused: {number:,} layouts are more than {most:,}; shrink '{axis.name}' first")
    if heliostats is not None:
        return int(max(heliostats.values()) if isinstance(heliostats, Sweep) else heliostats)
    if not layouts.dimensions:
        return len(layouts[()])
    key = grid.study.study_id
    if key not in _LONGEST:
        _LONGEST[key] = max(len(layout) for layout in layouts)
    return _LONGEST[key]


_LONGEST: dict[str, int] = {}

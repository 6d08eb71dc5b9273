"""What a figure shows of a result: one axis, a few lines and panels; all else stands at one value, said in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import xarray as xr

from heliosweep.report.labels import DEGREE, axis_label, coordinate_text, is_latitude, title_of, value_text
from heliosweep.report.selection import evenly

DIRECTION = "axis_tilt_direction"
DIRECTION_TITLE = "direction of the tilt"
OFFSETS = ("home_azimuth_offset", "home_elevation_offset")

#: Lines of one panel, panels of one figure.
MOST_LINES, MOST_PANELS = 7, 6

#: Directions of which lines are drawn, or the nearest there are. [deg]
LINE_DIRECTIONS = (0.0, 45.0, 90.0, 135.0)

#: Axes of a result that are not swept.
_SAMPLED = ("date", "month")

_COMPASS = ("south", "south-west", "west", "north-west", "north", "north-east", "east", "south-east")

Point = dict[str, int]


def swept(result: xr.Dataset, quantity: str) -> tuple[str, ...]:
    """Swept dimensions of a quantity, those of the mount before those of the place."""
    dims = [str(dim) for dim in result[quantity].dims if dim not in _SAMPLED]
    return tuple(sorted(dims, key=lambda dim: is_place(result, dim)))


def is_place(result: xr.Dataset, dim: str) -> bool:
    """Whether the place changes along a dimension."""
    return any(name in result.coords and dim in result[name].dims for name in ("latitude", "longitude", "site"))


def is_number(result: xr.Dataset, dim: str) -> bool:
    """Whether curves can be drawn along a dimension."""
    return dim in result.coords and result[dim].dtype.kind in "fiu" and result.sizes[dim] > 1


def nearest(directions: np.ndarray, wanted: Iterable[float]) -> list[int]:
    """Positions of the directions [deg] nearest to those wanted, around the circle, each once."""
    away = [np.abs((directions - one + 180.0) % 360.0 - 180.0) for one in wanted]
    return sorted({int(np.argmin(distances)) for distances in away})


class View:
    """The part of a quantity that a figure shows.

    Parameters
    ----------
    result : xarray.Dataset
        The result.
    quantity : str
        One of its variables, whose dimensions count.
    *whole : str
        Dimensions that are shown in full, the one along the horizontal axis first.
    lines, panels : str, optional
        Dimensions from line to line and from panel to panel.
    most_lines, most_panels : int
        How many of them at most.

    Attributes
    ----------
    line_points, panel_points : list of dict
        Position of each line and panel; a single empty one where there is no such dimension.
    fixed : dict
        Position along every other swept dimension: angles next to zero, the middle of other sweeps.
    """

    def __init__(
        self,
        result: xr.Dataset,
        quantity: str,
        *whole: str,
        lines: str | None = None,
        panels: str | None = None,
        most_lines: int = MOST_LINES,
        most_panels: int = MOST_PANELS,
    ) -> None:
        self.result, self.whole, self.lines, self.panels = result, whole, lines, panels
        self.line_points, self.panel_points = self._points(lines, most_lines), self._points(panels, most_panels)
        shown = (*whole, lines, panels)
        self.fixed = {dim: self._typical(dim) for dim in swept(result, quantity) if dim not in shown}

    def at(self, quantity: str, *points: Point) -> xr.DataArray:
        """One of the quantities at a line and panel, not yet read."""
        everything = {dim: index for point in (self.fixed, *points) for dim, index in point.items()}
        array = self.result[quantity]
        return array.isel({dim: index for dim, index in everything.items() if dim in array.dims})

    def line_text(self, point: Point) -> str:
        """Name of a line, without what `legend` says."""
        return self._text(self.lines, point, _short)

    def panel_text(self, point: Point) -> str:
        """Name of a panel; sites with their latitude."""
        text = self._text(self.panels, point, _full)
        if self.panels == "site" and "latitude" in self.result.coords:
            text += f" ({value_text(self.result['latitude'].isel(point))})"
        return text

    @property
    def legend(self) -> str:
        """What distinguishes the lines; empty for a single one and for names, which speak for themselves."""
        return short_title(self.result, self.lines) if self.lines and is_number(self.result, self.lines) else ""

    @property
    def ordered(self) -> bool:
        """Whether lines follow a swept number."""
        return self.lines != DIRECTION and bool(self.legend)

    def note(self, *unsaid: str) -> str:
        """Sentences for a caption: which of many values are shown, and where all else stands but `unsaid`."""
        chosen = [
            f"{len(points)} of {self.result.sizes[dim]} values of {short_title(self.result, dim)}"
            for dim, points in ((self.lines, self.line_points), (self.panels, self.panel_points))
            if dim and len(points) < self.result.sizes[dim]
        ]
        said = [f"Shown are {' and '.join(chosen)}."] if chosen else []
        constant = [
            _full(array)
            for name, array in self.result.coords.items()
            if not array.ndim and name not in unsaid and not (name in OFFSETS and not array.item())
        ]
        constant += [
            f"{self._text(dim, {dim: index}, _full)} (one of {self.result.sizes[dim]})"
            for dim, index in self.fixed.items()
        ]
        said += [f"Fixed: {', '.join(constant)}."] if constant else []
        return "".join(f" {sentence}" for sentence in said)

    def _points(self, dim: str | None, most: int) -> list[Point]:
        if dim is None:
            return [{}]
        if dim == DIRECTION:
            return [{dim: index} for index in nearest(self.result[dim].to_numpy(), LINE_DIRECTIONS)]
        size = self.result.sizes[dim]
        # An odd number keeps the middle of a sweep about zero.
        odd = most - (dim in OFFSETS and size > most and most % 2 == 0)
        return [{dim: index} for index in evenly(size, odd)]

    def _typical(self, dim: str) -> int:
        if dim == DIRECTION or dim in OFFSETS:
            return int(np.argmin(np.abs(self.result[dim].to_numpy())))
        return self.result.sizes[dim] // 2

    def _text(self, dim: str | None, point: Point, words: Callable[[xr.DataArray], str]) -> str:
        if dim is None:
            return ""
        if dim not in self.result.coords:
            return f"{dim} {point[dim] + 1}"
        return words(self.result[dim].isel(point))


def _short(value: xr.DataArray) -> str:
    """One coordinate value; directions with their name where they have one."""
    if value.name != DIRECTION:
        return value_text(value)
    eighth = float(value) % 360.0 / 45.0
    return value_text(value) + (f" {_COMPASS[int(eighth)]}" if eighth == int(eighth) else "")


def _full(value: xr.DataArray) -> str:
    """One coordinate value with what it is; sites speak for themselves."""
    if value.name == DIRECTION:
        return f"{DIRECTION_TITLE} {_short(value)}"
    return f"{value.name} {_short(value)}" if value.name == "model" else coordinate_text(value)


def short_title(result: xr.Dataset, dim: str) -> str:
    """What a dimension is called in a figure."""
    if dim == DIRECTION:
        return DIRECTION_TITLE
    return title_of(result[dim]).removeprefix("name of the ") if dim in result.coords else dim.replace("_", " ")


def x_label(result: xr.Dataset, dim: str) -> str:
    """Label of the horizontal axis, with the unit."""
    if dim == DIRECTION or is_latitude(result[dim]):
        return f"{short_title(result, dim)} ({DEGREE})"
    if dim == "date":
        return "date (month)"
    if result[dim].dtype.kind not in "fiu":
        return short_title(result, dim)
    label = axis_label(result[dim])
    return label if label.endswith(")") else f"{label} (1)"


def tick_step(values: np.ndarray, most: int = 8) -> float:
    """Distance of ticks along directions, both in degrees, for about so many ticks."""
    return next((step for step in (5.0, 15.0, 45.0) if np.ptp(values) <= most * step), 90.0)


def period(dates: xr.DataArray) -> str:
    """The dates in words: one, or how many from when to when."""
    days = dates.to_numpy().astype("datetime64[D]")
    return str(days[0]) if days.size == 1 else f"{days.size} dates from {days.min()} to {days.max()}"

"""What the figures of the family share: which points of a result are shown."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.registry import NamedFigure
from heliosweep.report import maps
from heliosweep.report.selection import evenly
from heliosweep.report.shapes import Look

#: Dimensions of the instants; one of the first three, and the hour.
DAYS = ("day", "declination", "date")
HOUR = "hour"
HELIOSTAT = "heliostat"

#: All of them.
INSTANTS = (*DAYS, HOUR)

#: Dimensions that are neither swept nor instants.
NOT_SWEPT = {*DAYS, HOUR, HELIOSTAT, "parameter", "parameter_2", "spot", "percentile", "tolerance_axis", "detector"}
NOT_SWEPT |= {"conic_coefficient", "sample"}

#: The errors, in the order of the family.
MOUNT_ERRORS = (
    "azimuth_reference",
    "elevation_reference",
    "tilt_about_east",
    "tilt_about_north",
    "non_orthogonality",
    "collimation",
)

#: Where some dimensions stand that are not shown, or the nearest to it there is.
TYPICAL = {**dict.fromkeys(MOUNT_ERRORS, 0.0), HOUR: 12.0, "error_scale": 1.0}

#: Panels of one figure, lines of one panel, maps of one figure.
MOST_PANELS, MOST_LINES, MOST_MAPS = 6, 6, 6

#: Side of the squares on maps over the root of the land that each heliostat has.
PACKING = 0.55

#: From so many heliostats on they are a field, of which there are maps.
FIELD = 7

#: Colours of the error axes, red and blue as in Figure 4 of the paper, of Okabe and Ito.
AXES = {
    "elevation": Look("#D55E00"),
    "azimuth": Look("#0072B2"),
    "encoder-azimuth": Look("#009E73", (0, (4, 1.4))),
}

Point = dict[str, int]
Draw = Callable[[xr.Dataset], Iterable[NamedFigure]]


def needs(*names: str) -> Callable[[Draw], Draw]:
    """Give a figure up where the result lacks a variable, or where a dimension of the first one is empty."""

    def decorate(draw: Draw) -> Draw:
        @wraps(draw)
        def wrapper(result: xr.Dataset) -> Iterable[NamedFigure]:
            if all(name in result for name in names) and all(result.sizes[dim] for dim in result[names[0]].dims):
                yield from draw(result)

        return wrapper

    return decorate


def swept(result: xr.Dataset, quantity: str, *but: str | None) -> list[str]:
    """Swept dimensions of a quantity that have more than one value, without some."""
    dims = [str(dim) for dim in result[quantity].dims if dim not in NOT_SWEPT and dim not in but]
    return [dim for dim in dims if result.sizes[dim] > 1]


def numbers(result: xr.Dataset, dims: Iterable[str]) -> list[str]:
    """Those of the dimensions along which there are numbers."""
    return [dim for dim in dims if dim in result.coords and result[dim].dtype.kind in "fiu"]


def day_of(result: xr.Dataset) -> str:
    """Dimension of the days."""
    return next((dim for dim in DAYS if dim in result.sizes), DAYS[0])


def several(result: xr.Dataset, dim: str | None) -> bool:
    """Whether a dimension has more than one value."""
    return dim is not None and result.sizes.get(dim, 1) > 1


def typical(result: xr.Dataset, dim: str) -> int:
    """Where a dimension stands that is not shown: the middle of numbers but for `TYPICAL`, the first of words."""
    if dim not in result.coords or result[dim].dtype.kind not in "fiuM" or result[dim].ndim != 1:
        return 0
    values = result[dim].to_numpy()
    if dim in TYPICAL:
        return int(np.argmin(np.abs(values.astype(float) - TYPICAL[dim])))
    return int(np.argsort(values, kind="stable")[(values.size - 1) // 2])


def fixed(result: xr.Dataset, quantity: str, *shown: str | None) -> Point:
    """Where everything stands that a figure does not show."""
    return {str(dim): typical(result, str(dim)) for dim in result[quantity].dims if dim not in shown}


def chosen(result: xr.Dataset, dim: str | None, most: int, known: xr.DataArray | None = None) -> list[Point]:
    """At most so many positions along a dimension, in the order of its values; one empty point without it.

    With `known`, only positions are chosen where it has a value.
    """
    if dim is None or dim not in result.sizes:
        return [{}]
    order = np.arange(result.sizes[dim])
    if dim in result.coords and result[dim].dtype.kind in "fiuM":
        order = np.argsort(result[dim].to_numpy(), kind="stable")
    if known is not None and dim in known.dims:
        order = order[known.notnull().any([other for other in known.dims if other != dim]).to_numpy()[order]]
    return [{dim: int(order[index])} for index in evenly(order.size, most)] if order.size else []


def ordered(result: xr.Dataset, dim: str) -> np.ndarray:
    """Positions along a dimension in the order of its numbers."""
    return np.argsort(result[dim].to_numpy(), kind="stable") if dim in result.coords else np.arange(result.sizes[dim])


def at(array: xr.DataArray, *points: Point) -> xr.DataArray:
    """Part of an array, not yet read."""
    everything = {dim: index for point in points for dim, index in point.items()}
    return array.isel({dim: index for dim, index in everything.items() if dim in array.dims})


def heliostats(result: xr.Dataset, quantity: str, stands: Point, most: int = MOST_PANELS) -> list[Point]:
    """Heliostats that are shown: of those with values all of a few, of a field some from the tower outwards."""
    array = at(result[quantity], {dim: index for dim, index in stands.items() if dim not in INSTANTS})
    others = [dim for dim in array.dims if dim != HELIOSTAT]
    order = np.flatnonzero(array.notnull().any(others).to_numpy())
    if order.size > most:
        place = places(result, stands)
        if place is not None:
            order = order[np.argsort(np.hypot(place[0], place[1])[order], kind="stable")]
    return [{HELIOSTAT: int(order[index])} for index in evenly(order.size, most)] if order.size else []


def places(result: xr.Dataset, point: Point) -> tuple[np.ndarray, np.ndarray] | None:
    """Pivots east and north of the tower at one point of the sweep; none where the result does not tell. [m]"""
    if not {"x", "y"} <= set(result.coords):
        return None
    x, y = (at(result[name], point) for name in "xy")
    if x.dims != (HELIOSTAT,) or y.dims != (HELIOSTAT,):
        return None
    return x.to_numpy().astype(float), y.to_numpy().astype(float)


def aperture(result: xr.Dataset, *points: Point) -> tuple[float, float] | None:
    """Width and height of the receiver's aperture at one point of the sweep. [m]"""
    sides = []
    for name, key in (("receiver_width", "width"), ("receiver_height_extent", "height_extent")):
        value: Any = None
        if name in result.coords:
            array = at(result[name], *points)
            value = None if array.ndim else array.item()
        else:
            value = study(result).get("receiver", {}).get(key)
        if not isinstance(value, int | float) or not np.isfinite(value) or value <= 0:
            return None
        sides.append(float(value))
    return sides[0], sides[1]


def study(result: xr.Dataset) -> dict[str, Any]:
    """The study file of a result, where it is told."""
    found = json.loads(result.attrs.get("study", "{}"))
    return found if isinstance(found, dict) else {}


def field_map(result: xr.Dataset, values: np.ndarray, point: Point, title: str) -> maps.FieldMap | None:
    """Map of one number of each heliostat; none where the result does not tell the places."""
    place = places(result, point)
    if place is None:
        return None
    known = [axis[np.isfinite(axis)] for axis in place]
    spans = [float(np.ptp(axis)) if axis.size else 1.0 for axis in known]
    # Their sides are not part of the study: large enough to see the colour, apart from each other.
    side = max(PACKING * np.sqrt(spans[0] * spans[1] / max(known[0].size, 1)), max(spans) / 60, 1.0)
    sides = np.full(values.size, side)
    return maps.FieldMap(title, *place, sides, sides, values)


def rows_of(drawn: Sequence[maps.FieldMap]) -> list[list[maps.FieldMap]]:
    """Maps in rows of nearly the same length."""
    wide = -(-len(drawn) // -(-len(drawn) // maps.COLUMNS))
    return [list(drawn[start : start + wide]) for start in range(0, len(drawn), wide)]

"""What the figures of the family share: which points of a result are shown, and how they are called."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.registry import NamedFigure
from heliosweep.report import maps
from heliosweep.report.labels import axis_label, coordinate_text, title_of, value_text
from heliosweep.report.selection import evenly
from heliosweep.report.shapes import Look

#: Dimensions of the instants; one of the first three, and the hour.
DAYS = ("day", "declination", "date")
HOUR = "hour"
HELIOSTAT = "heliostat"

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
    "encoder_azimuth": Look("#009E73", (0, (4, 1.4))),
}

#: What the hour is called on an axis.
HOURS = {"day": "solar time (h)", "declination": "solar time (h)", "date": "time of day (h)"}

Point = dict[str, int]
Draw = Callable[[xr.Dataset], Iterable[NamedFigure]]


def needs(*names: str) -> Callable[[Draw], Draw]:
    """Give a figure up where the result lacks a variable, or where no value of the first one is finite."""

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
    """Where a dimension stands that is not shown: noon, no error, drawn ones as they are, the middle of other numbers, the first word."""
    if dim not in result.coords or result[dim].dtype.kind not in "fiuM" or result[dim].ndim != 1:
        return 0
    values = result[dim].to_numpy()
    if dim in TYPICAL:
        return int(np.argmin(np.abs(values.astype(float) - TYPICAL[dim])))
    return int(np.argsort(values, kind="stable")[(values.size - 1) // 2])


def fixed(result: xr.Dataset, quantity: str, *shown: str | None) -> Point:
    """Where everything stands that a figure does not show."""
    return {str(dim): typical(result, str(dim)) for dim in result[quantity].dims if dim not in shown}


def chosen(result: xr.Dataset, dim: str | None, most: int) -> list[Point]:
    """At most so many positions along a dimension, in the order of its values; one empty point without it."""
    if dim is None or dim not in result.sizes:
        return [{}]
    size = result.sizes[dim]
    order = np.arange(size)
    if dim in result.coords and result[dim].dtype.kind in "fiuM":
        order = np.argsort(result[dim].to_numpy(), kind="stable")
    return [{dim: int(order[index])} for index in evenly(size, most)]


def ordered(result: xr.Dataset, dim: str) -> np.ndarray:
    """Positions along a dimension in the order of its numbers."""
    return np.argsort(result[dim].to_numpy(), kind="stable") if dim in result.coords else np.arange(result.sizes[dim])


def at(array: xr.DataArray, *points: Point) -> xr.DataArray:
    """Part of an array, not yet read."""
    everything = {dim: index for point in points for dim, index in point.items()}
    return array.isel({dim: index for dim, index in everything.items() if dim in array.dims})


def heliostats(result: xr.Dataset, point: Point, most: int = MOST_PANELS) -> list[Point]:
    """Heliostats that are shown: all of a few, of a field some from the tower outwards."""
    size = result.sizes.get(HELIOSTAT, 1)
    if HELIOSTAT not in result.sizes:
        return [{}]
    order = np.arange(size)
    if size > most:
        place = places(result, point)
        if place is not None:
            far = np.hypot(place[0], place[1])
            order = np.argsort(far, kind="stable")[: max(1, int(np.isfinite(far).sum()))]
    return [{HELIOSTAT: int(order[index])} for index in evenly(order.size, most)]


def places(result: xr.Dataset, point: Point) -> tuple[np.ndarray, np.ndarray] | None:
    """Pivots east and north of the tower at one point of the sweep; none where the result does not tell. [m]"""
    if not {"x", "y"} <= set(result.coords):
        return None
    x, y = (at(result[name], point) for name in "xy")
    if x.dims != (HELIOSTAT,) or y.dims != (HELIOSTAT,):
        return None
    return x.to_numpy().astype(float), y.to_numpy().astype(float)


def heliostat_text(result: xr.Dataset, point: Point) -> str:
    """A heliostat by its name and place."""
    if HELIOSTAT not in point:
        return ""
    index = point[HELIOSTAT]
    label = result[HELIOSTAT].to_numpy()[index] if HELIOSTAT in result.coords else index
    name = str(label) if isinstance(label, str) else f"heliostat {label}"
    parts = [at(result[axis], point) for axis in "xyz" if axis in result.coords]
    if len(parts) == 3 and not any(part.ndim for part in parts):
        where = ", ".join(f"{round(float(part), 1) + 0.0:g}" for part in parts).replace("-", "\N{MINUS SIGN}")
        return f"{name}: ({where}) m"
    return name


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


def short(result: xr.Dataset, dim: str, index: int) -> str:
    """One value with its unit."""
    if dim not in result.coords:
        return f"{dim.replace('_', ' ')} {index + 1}"
    value = result[dim].isel({dim: index})
    if value.dtype.kind == "M":
        return str(value.to_numpy().astype("datetime64[D]"))
    return value_text(value).replace("_", " ")


def full(result: xr.Dataset, dim: str, index: int) -> str:
    """One value with what it is."""
    if dim == HELIOSTAT:
        return heliostat_text(result, {dim: index})
    if dim not in result.coords or result[dim].dtype.kind == "M":
        return short(result, dim, index)
    if result[dim].dtype.kind in "OU":
        return f"{title_of(result[dim])} {short(result, dim, index)}"
    return coordinate_text(result[dim].isel({dim: index}))


def note(result: xr.Dataset, stands: Point, *shown: tuple[str | None, Sequence[Point]]) -> str:
    """Sentences for a caption: which of many values are shown, and where the rest stands."""
    parts = [
        f"{len(points)} of {result.sizes[dim]} {plural(result, dim)}"
        for dim, points in shown
        if dim and dim in result.sizes and len(points) < result.sizes[dim]
    ]
    said = [f"Shown are {' and '.join(parts)}."] if parts else []
    held = [
        full(result, dim, index) + (f" (one of {result.sizes[dim]})" if result.sizes[dim] > 1 else "")
        for dim, index in stands.items()
    ]
    for name in ("latitude", "mount_kind", "kind", "receiver_width"):
        if name in result.coords and not result[name].ndim:
            held.append(coordinate_text(result[name]).replace("_", " "))
    said += [f"Fixed: {', '.join(held)}."] if held else []
    return "".join(f" {sentence}" for sentence in said)


def plural(result: xr.Dataset, dim: str) -> str:
    """What several values of a dimension are called."""
    if dim in (HELIOSTAT, HOUR, *DAYS):
        return f"{dim}s"
    return f"values of {title_of(result[dim]) if dim in result.coords else dim.replace('_', ' ')}"


def label(result: xr.Dataset, dim: str) -> str:
    """Label of an axis, always with a unit."""
    if dim == HOUR:
        return HOURS[day_of(result)]
    words = axis_label(result[dim])
    return words if words.endswith(")") else f"{words} (1)"


def hour_step(result: xr.Dataset) -> float | None:
    """Distance of ticks along the hours. [h]"""
    span = float(np.ptp(result[HOUR].to_numpy()))
    return next((step for step in (0.25, 0.5, 1.0, 2.0, 3.0) if span <= 8 * step), 4.0) if span else None


def heading(result: xr.Dataset, dim: str | None) -> str:
    """What distinguishes lines, above a legend; empty for words."""
    if dim is None or dim not in result.coords or result[dim].dtype.kind not in "fiu":
        return ""
    return "solar hour" if dim == HOUR and day_of(result) != "date" else title_of(result[dim])


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

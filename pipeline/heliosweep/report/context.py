"""Selection and formatting of the values that figures and tables show."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.layouts.ground import AREAS
from heliosweep.lazy import shapely

DEGREE, MINUS, NO_BREAK_SPACE, NOTHING = "\N{DEGREE SIGN}", "\N{MINUS SIGN}", "\N{NO-BREAK SPACE}", "\N{EN DASH}"

#: Printed form of each unit in CF spelling.
_UNITS = {
    "1": "",
    "degree": DEGREE,
    "degrees": DEGREE,
    "degrees_north": f"{DEGREE}{NO_BREAK_SPACE}N",
    "degrees_east": f"{DEGREE}{NO_BREAK_SPACE}E",
    "percent": "%",
    "MWh-1": "per MWh",
    "m2": "m\N{SUPERSCRIPT TWO}",
    **{f"{unit} m-2": f"{unit}/m\N{SUPERSCRIPT TWO}" for unit in ("W", "kW", "MWh")},
}


#: Maximum number of letters in a line of a label.
LETTERS = 38


def unit_of(array: xr.DataArray) -> str:
    """Return the printed unit of an array. Fractions are printed in percent."""
    if is_fraction(array):
        return "%"
    unit = str(array.attrs.get("units", ""))
    return _UNITS.get(unit, unit)


def is_fraction(array: xr.DataArray) -> bool:
    """Return True if the values of an array are fractions, which are printed in percent."""
    valid = array.attrs.get("valid_range")
    return array.attrs.get("units") == "1" and valid is not None and [float(end) for end in valid] == [0.0, 1.0]


def is_signed(low: float, high: float) -> bool:
    """Return True if a range includes values of both signs, so that colours must diverge from zero."""
    return min(-low, high) > 0.02 * max(-low, high)


def is_flag(array: xr.DataArray | xr.Variable) -> bool:
    """Return True if the values of an array are codes for categories."""
    return "flag_values" in array.attrs and "flag_meanings" in array.attrs


def is_quantity(array: xr.DataArray | xr.Variable) -> bool:
    """Return True if the values of an array are numbers, not text, dates or flags."""
    return array.dtype.kind in "fiu" and not is_flag(array)


def quantities(result: xr.Dataset) -> list[str]:
    """Return the names of the variables that are quantities, without standard errors ``NAME_error``."""
    names = [str(name) for name in result.data_vars if is_quantity(result.variables[name])]
    return [name for name in names if name.removesuffix("_error") == name or name.removesuffix("_error") not in names]


def is_latitude(array: xr.DataArray) -> bool:
    """Return True if the values of an array are latitudes, which are printed with their hemisphere."""
    return array.name == "latitude" or array.attrs.get("units") == "degrees_north"


def printed(array: xr.DataArray, of: xr.DataArray | None = None) -> Any:
    """Return the values of an array in its printed unit, or standard errors in the printed unit of the array `of`."""
    values = array.to_numpy()
    return values * 100 if is_fraction(array if of is None else of) else values


def title_of(array: xr.DataArray) -> str:
    """Return the name of an array for use in a sentence."""
    return str(array.attrs.get("long_name") or str(array.name).replace("_", " ")).removeprefix("name of the ")


def capital(text: str) -> str:
    """Return a string with a capital first letter."""
    return text[:1].upper() + text[1:]


def head_of(array: xr.DataArray) -> str:
    """Return the name of an array up to the first comma or colon, without "number of the"."""
    return re.split("[:,]", title_of(array))[0].removeprefix("number of the ")


def axis_label(array: xr.DataArray) -> str:
    """Return the label of an axis with the name and unit of an array."""
    unit = unit_of(array)
    return f"{title_of(array)} ({unit})" if unit else title_of(array)


def latitude_text(value: float, ends: str = "NS") -> str:
    """Format a latitude with its hemisphere, or a longitude if `ends` is ``EW``."""
    return f"{abs(value):g}{DEGREE}{'' if value == 0 else f' {ends[int(value < 0)]}'}"


def value_texts(coordinate: xr.DataArray) -> list[str]:
    """Format the values of a coordinate with their unit."""
    values, name, kind = np.atleast_1d(coordinate.to_numpy()), coordinate.name, coordinate.dtype.kind
    if kind in "mM":
        dates = values.astype("datetime64[D]" if name == "date" else "datetime64[m]").astype(str)
        return [text.removesuffix("T00:00") for text in dates.tolist()]
    if kind in "OU":
        if name in ("site", "layout", "heliostat", "name", "id"):  # names and numbers of objects need no unit
            return [re.sub(r"^(?:.*/)?(.*)\.csv$", r"\1", str(text)) for text in values]
        hyphened = name in ("tracking", "model", "mount_kind", "source", "axis", "loss")
        return [str(text).replace("_", "-" if hyphened else " ") for text in values]
    if ends := "NS" if is_latitude(coordinate) else {"degrees_east": "EW"}.get(str(coordinate.attrs.get("units"))):
        return [latitude_text(float(value), ends) for value in values]
    unit = f" {unit_of(coordinate)}".replace(f" {DEGREE}", DEGREE)
    return [f"{value:g}{unit}".rstrip().replace("-", MINUS) for value in values.astype(float)]


def number_text(value: float, decimals: int = 2, signed: bool = False) -> str:
    """Format a number with a typographic minus sign. A missing value is shown as a dash."""
    if math.isinf(value):
        return "\N{INFINITY}" if value > 0 else MINUS + "\N{INFINITY}"
    if math.isnan(value):
        return NOTHING
    text = f"{value:+,.{decimals}f}" if signed else f"{value:,.{decimals}f}"
    if not text.strip("+-0."):
        text = text.lstrip("+-")
    return text.replace("-", MINUS)


def fold(text: str, most: int = LETTERS) -> str:
    """Break a label into lines of at most `most` letters."""
    return "\n".join(part for line in text.split("\n") for part in textwrap.wrap(line, most))


#: Position along each of several dimensions, by the name of the dimension.
Point = Mapping[str, int]


def evenly(length: int, most: int) -> list[int]:
    """Return at most `most` of `length` positions, evenly spaced from the first to the last position."""
    return sorted({round(place) for place in np.linspace(0, length - 1, min(length, most))})


def is_geometric(values: np.ndarray) -> bool:
    """Return True if positive numbers cover at least a decade with a constant ratio between neighbours."""
    if values.size < 3 or values.dtype.kind not in "fiu" or values.min() <= 0 or values.max() < 10 * values.min():
        return False
    ratios = np.diff(np.log(values))
    return bool(np.allclose(ratios, ratios[0], rtol=1e-4))


def at(array: xr.DataArray, *points: Point) -> xr.DataArray:
    """Select positions along the dimensions of an array without reading its values. Ignores unknown dimensions."""
    return array.isel({dim: index for point in points for dim, index in point.items() if dim in array.dims})


class Context:
    """Result with the selected values of the dimensions that a figure does not show.

    Parameters
    ----------
    result : Dataset
        Result to show.
    held : mapping of str to object
        Selected values of dimensions, as in `Figure.at`.
    """

    def __init__(self, result: xr.Dataset, held: Mapping[str, Any] | None = None) -> None:
        self.result, self.held = result, held or {}
        self._words: dict[str, list[str]] = {}

    def coordinate(self, dim: str) -> xr.DataArray:
        """Return the values along a dimension, or 1, 2, ... if it has no coordinate."""
        if dim in self.result.coords and self.result[dim].ndim == 1:
            return self.result[dim]
        return xr.DataArray(np.arange(1, self.result.sizes[dim] + 1), dims=dim, name=dim)

    def order(self, dim: str) -> np.ndarray:
        """Return the positions along a dimension in ascending order of the numbers or dates at these positions."""
        values = self.coordinate(dim).to_numpy()
        return np.argsort(values, kind="stable") if values.dtype.kind in "fiuM" else np.arange(values.size)

    def along(self, dim: str) -> tuple[np.ndarray, list[str]]:
        """Return the positions of sorted values of a dimension on an axis, and the labels of categories."""
        order = self.order(dim)
        if dim in self.result.coords and (values := self.coordinate(dim).to_numpy()).dtype.kind in "fiuM":
            return values[order], []
        return np.arange(order.size), [self.value(dim, int(i)) for i in order]

    def position(self, dim: str) -> int:
        """Return the selected position along a dimension that a figure does not show."""
        values, usual = self.coordinate(dim).to_numpy(), self.held.get(dim)
        if isinstance(usual, int | float) and values.dtype.kind in "fiu":
            return int(np.argmin(np.abs(values.astype(float) - usual)))
        if isinstance(usual, Sequence):
            return next((list(values).index(word) for word in usual if word in values), 0)
        return int(self.order(dim)[(values.size - 1) // 2]) if values.dtype.kind in "fiuM" else 0

    def fixed(self, array: xr.DataArray, *shown: str | None) -> dict[str, int]:
        """Return the selected positions along those dimensions of an array that a figure does not show."""
        return {str(dim): self.position(str(dim)) for dim in array.dims if dim not in shown}

    def chosen(
        self, dim: str | None, most: int, known: xr.DataArray | None = None, worst: xr.DataArray | None = None
    ) -> list[dict[str, int]]:
        """Return at most `most` positions along a dimension, or a single empty mapping if `dim` is None.

        Positions without a value in `known` are excluded. If `worst` is given, the positions of the highest values of
        `worst` are chosen.
        """
        if dim is None or dim not in self.result.sizes:
            return [{}]
        order = self.order(dim)
        if worst is not None:
            return [{dim: int(i)} for i in np.argsort(-worst.fillna(-np.inf).to_numpy(), kind="stable")[:most]]
        if known is not None and dim in known.dims:
            order = order[known.notnull().any([other for other in known.dims if other != dim]).to_numpy()[order]]
        values = self.coordinate(dim)
        if values.attrs.get("units") == "degree" and order.size > most and np.ptp(values.to_numpy()) > 180:
            order = order[:: -(-order.size // most)]  # the two ends of a circle are neighbours
        return [{dim: int(order[index])} for index in evenly(order.size, most)] if order.size else []

    def title(self, dim: str) -> str:
        """Return the name of a dimension for use in a sentence."""
        title = head_of(self.result[dim]) if dim in self.result.coords else dim
        return (title if len(title) <= 40 else dim).replace("_", " ")

    def label(self, dim: str) -> str:
        """Return the label of an axis along a dimension."""
        coordinate = self.coordinate(dim)
        text = axis_label(coordinate).split(":")[0] if dim in self.result.coords else dim.replace("_", " ")
        return text.removesuffix(f" ({unit_of(coordinate)})") if is_latitude(coordinate) else text

    def value(self, dim: str, index: int) -> str:
        """Return one value along a dimension with its unit, or the name of a heliostat or module."""
        if dim not in self._words:
            coords = self.result.coords
            named = [coords[key] for key in ("name", "id") if key in coords and coords[key].dims == (dim,)]
            if named and (named[0].name == "name" or named[0].dtype.kind in "OU"):
                self._words[dim] = list(map(str, named[0].to_numpy()))
            elif dim in coords and coords[dim].ndim == 1:
                self._words[dim] = value_texts(coords[dim])
            else:
                along = [value_texts(one) for one in coords.values() if one.dims == (dim,)]
                numbers = [[f"{dim.replace('_', ' ')} {i + 1}" for i in range(self.result.sizes[dim])]]
                self._words[dim] = [", ".join(parts) for parts in zip(*(along[:2] or numbers), strict=True)]
        return self._words[dim][index]

    def full(self, dim: str, index: int) -> str:
        """Return the name of a dimension and one of its values."""
        value = self.value(dim, index)
        speaks = dim not in self.result.coords or self.result[dim].dtype.kind in "MOU"
        return value if (speaks and not value[:1].isdigit()) or dim == "date" else f"{self.title(dim)} {value}"

    def values(self, point: Point) -> str:
        """Return the values of the dimensions at a point as text, for example for the name of a line."""
        return ", ".join(self.value(dim, index) for dim, index in point.items())

    def fulls(self, point: Point) -> str:
        """Return the names and values of the dimensions at a point as text, for example for the title of a panel."""
        return ", ".join(self.full(dim, index) for dim, index in point.items())

    def note(self, fixed: Point, *shown: Sequence[Point]) -> str:
        """Return the sentences of a caption that state the selected values.

        Each element of `shown` lists the points along one dimension that the figure shows.
        """
        sizes, thinned = self.result.sizes, [(dim, len(points)) for points in shown for dim in next(iter(points), ())]
        parts = [f"{few} of {sizes[dim]} values of {self.title(dim)}" for dim, few in thinned if few < sizes[dim]]
        held = [f"{self.full(dim, index)} (one of {sizes[dim]})" for dim, index in fixed.items() if sizes[dim] > 1]
        return " ".join(f"{word}: {', '.join(texts)}." for word, texts in (("Shown", parts), ("Fixed", held)) if texts)


#: Side of a mirror of unknown size relative to the square root of its land area [1].
#: Minimum side of a mirror relative to the size of the map [1].
PACKING, SMALLEST = 0.55, 1 / 250


def mirrors(here: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y, width and height of the mirrors of a field, with small mirrors enlarged to be visible. [m]"""
    x, y = (here[name].to_numpy().astype(float) for name in "xy")
    spans = [float(np.ptp(side[np.isfinite(side)])) if np.isfinite(side).any() else 1.0 for side in (x, y)]
    usual = max(PACKING * math.sqrt(spans[0] * spans[1] / max(int(np.isfinite(x).sum()), 1)), max(spans) / 60, 1.0)
    sides = (here.coords.get(name, usual) for name in ("heliostat_width", "heliostat_height"))
    width, height = (np.maximum(np.broadcast_to(side, x.shape), SMALLEST * max(spans)) for side in sides)
    return x, y, width, height


def areas(result: xr.Dataset) -> dict[str, list[np.ndarray]]:
    """Return the corners of each named area of a field, as arrays of shape (corners, 2). [m]"""
    found, names = {}, {"boundary": "boundary", "exclude": "no heliostats"}
    for key, attribute in AREAS.items():
        if attribute in result.attrs:
            parts = shapely.get_parts(shapely.from_wkt(str(result.attrs[attribute])))
            lines = shapely.get_parts(shapely.boundary(parts))
            found[names[key]] = [shapely.get_coordinates(line) for line in lines]
    return found


def aperture(result: xr.Dataset, point: Point) -> tuple[float, float] | None:
    """Return the width and height of the receiver's aperture at a point, or None if there is no aperture. [m]"""
    names = ("receiver_width", "receiver_height_extent")
    sides = [at(result[name], point) for name in names if name in result.coords]
    known = [float(side) for side in sides if not side.ndim and side.dtype.kind in "fiu" and 0 < side < np.inf]
    return (known[0], known[1]) if len(known) == 2 else None

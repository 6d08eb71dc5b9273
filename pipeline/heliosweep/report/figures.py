"""Declarations of figures. Each declaration specifies the form, the variables and the dimensions of a figure.

A family lists declarations in its module ``figures``. `heliosweep.report.draw` draws the figures as images, and
`heliosweep.report.interactive` as interactive plots. Variables that are missing from a result are skipped.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.layouts.ground import AREAS
from heliosweep.lazy import shapely

DEGREE, MINUS, NO_BREAK_SPACE, NOTHING = "\N{DEGREE SIGN}", "\N{MINUS SIGN}", "\N{NO-BREAK SPACE}", "\N{EN DASH}"

#: Printed form of each CF unit.
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


#: Maximum number of characters in a line of a label.
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
    """Return True if a range has values of both signs, each above 2 % of the maximum magnitude."""
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
    """Return the values of an array in its printed unit.

    If the array contains standard errors, `of` is the array of the values and determines the unit.
    """
    values = array.to_numpy()
    return values * 100 if is_fraction(array if of is None else of) else values


def title_of(array: xr.DataArray) -> str:
    """Return the name of an array for use in a sentence."""
    return str(array.attrs.get("long_name") or str(array.name).replace("_", " ")).removeprefix("name of the ")


def capital(text: str) -> str:
    """Capitalise the first letter of a string."""
    return text[:1].upper() + text[1:]


def head_of(array: xr.DataArray) -> str:
    """Return the name of an array up to the first comma or colon, without "number of the"."""
    return re.split("[:,]", title_of(array))[0].removeprefix("number of the ")


def axis_label(array: xr.DataArray) -> str:
    """Return an axis label with the name and unit of an array."""
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
    """Break a label into lines of at most `most` characters."""
    return "\n".join(part for line in text.split("\n") for part in textwrap.wrap(line, most))


#: Index along each dimension, keyed by the name of the dimension.
Point = Mapping[str, int]


def evenly(length: int, most: int) -> list[int]:
    """Return at most `most` evenly spaced indices from 0 to ``length - 1``."""
    return sorted({round(place) for place in np.linspace(0, length - 1, min(length, most))})


def is_geometric(values: np.ndarray) -> bool:
    """Return True if the values are a geometric sequence over at least one decade."""
    if values.size < 3 or values.dtype.kind not in "fiu" or values.min() <= 0 or values.max() < 10 * values.min():
        return False
    ratios = np.diff(np.log(values))
    return bool(np.allclose(ratios, ratios[0], rtol=1e-4))


def at(array: xr.DataArray, *points: Point) -> xr.DataArray:
    """Index an array by points without reading its values. Unknown dimensions are ignored."""
    return array.isel({dim: index for point in points for dim, index in point.items() if dim in array.dims})


class Context:
    """Result with selected values along the dimensions that a figure does not show.

    Parameters
    ----------
    result : Dataset
        Result to show.
    held : mapping of str to object
        Selected value of each dimension, as in `Figure.at`.
    """

    def __init__(self, result: xr.Dataset, held: Mapping[str, Any] | None = None) -> None:
        self.result, self.held = result, held or {}
        self._words: dict[str, list[str]] = {}

    def coordinate(self, dim: str) -> xr.DataArray:
        """Return the coordinate of a dimension, or numbers from 1 if it has none."""
        if dim in self.result.coords and self.result[dim].ndim == 1:
            return self.result[dim]
        return xr.DataArray(np.arange(1, self.result.sizes[dim] + 1), dims=dim, name=dim)

    def order(self, dim: str) -> np.ndarray:
        """Return the indices that sort a dimension of numbers or dates. Text labels are not sorted."""
        values = self.coordinate(dim).to_numpy()
        return np.argsort(values, kind="stable") if values.dtype.kind in "fiuM" else np.arange(values.size)

    def along(self, dim: str) -> tuple[np.ndarray, list[str]]:
        """Return the sorted axis positions along a dimension, and the labels of categories."""
        order = self.order(dim)
        if dim in self.result.coords and (values := self.coordinate(dim).to_numpy()).dtype.kind in "fiuM":
            return values[order], []
        return np.arange(order.size), [self.value(dim, int(i)) for i in order]

    def position(self, dim: str) -> int:
        """Return the index of the selected value along a dimension that a figure does not show."""
        values, usual = self.coordinate(dim).to_numpy(), self.held.get(dim)
        if isinstance(usual, int | float) and values.dtype.kind in "fiu":
            return int(np.argmin(np.abs(values.astype(float) - usual)))
        if isinstance(usual, Sequence):
            return next((list(values).index(word) for word in usual if word in values), 0)
        return int(self.order(dim)[(values.size - 1) // 2]) if values.dtype.kind in "fiuM" else 0

    def fixed(self, array: xr.DataArray, *shown: str | None) -> dict[str, int]:
        """Return the selected index along each array dimension that a figure does not show."""
        return {str(dim): self.position(str(dim)) for dim in array.dims if dim not in shown}

    def chosen(
        self, dim: str | None, most: int, known: xr.DataArray | None = None, worst: xr.DataArray | None = None
    ) -> list[dict[str, int]]:
        """Return at most `most` points along a dimension, or one empty point without a dimension.

        Points without a value in `known` are excluded. If `worst` is given, the points with the highest values of
        `worst` are returned.
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
        """Return the axis label of a dimension."""
        coordinate = self.coordinate(dim)
        text = axis_label(coordinate).split(":")[0] if dim in self.result.coords else dim.replace("_", " ")
        return text.removesuffix(f" ({unit_of(coordinate)})") if is_latitude(coordinate) else text

    def value(self, dim: str, index: int) -> str:
        """Format one value along a dimension: number with unit, or name of a heliostat or module."""
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
        """Return the coordinate values of a point as text, for example to label a line."""
        return ", ".join(self.value(dim, index) for dim, index in point.items())

    def fulls(self, point: Point) -> str:
        """Return the dimension names and values of a point as text, for example for a panel title."""
        return ", ".join(self.full(dim, index) for dim, index in point.items())

    def note(self, fixed: Point, *shown: Sequence[Point]) -> str:
        """Return caption sentences that list the shown and the fixed values.

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
    """Return x, y, width and height of each mirror [m]. Small mirrors are enlarged to be visible."""
    x, y = (here[name].to_numpy().astype(float) for name in "xy")
    spans = [float(np.ptp(side[np.isfinite(side)])) if np.isfinite(side).any() else 1.0 for side in (x, y)]
    usual = max(PACKING * math.sqrt(spans[0] * spans[1] / max(int(np.isfinite(x).sum()), 1)), max(spans) / 60, 1.0)
    sides = (here.coords.get(name, usual) for name in ("heliostat_width", "heliostat_height"))
    width, height = (np.maximum(np.broadcast_to(side, x.shape), SMALLEST * max(spans)) for side in sides)
    return x, y, width, height


def areas(result: xr.Dataset) -> dict[str, list[np.ndarray]]:
    """Return the boundary lines of each named area of a field, each of shape (corners, 2). [m]"""
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


HELIOSTAT = "heliostat"
#: Pixel dimensions: rows, then columns.
PIXELS = ("z", "y")
#: Minimum number of heliostats for a field map.
FIELD = 7
#: Dimensions whose numbers are only labels. Lines do not join values along these dimensions.
NAMES = (HELIOSTAT, "module", "camera", "sample", "spot", "parameter", "trace", "detector", "evaluation")
#: Maximum number of figures for a result.
MOST_FIGURES = 12
#: Quantile over the field for each line of the statistic ``field``, keyed by line name.
STATISTICS = {"minimum": 0.0, "5 %": 0.05, "median": 0.5, "maximum": 1.0}


@dataclass(frozen=True)
class Figure:
    """Base class of figure declarations.

    Parameters
    ----------
    name : str
        Short name, also used as the file name.
    title : str
        Heading of the interactive plot and beginning of the caption.
    variables : sequence of str
        Variables in descending order of importance. Images show the variables that fit; interactive plots offer all
        variables.
    over : sequence of str
        Dimensions of the axes in order of preference (default: chosen according to the variables).
    lines, panels : sequence of str
        Dimensions of the lines and of the panels, each in order of preference.
    at : mapping of str to object
        Values of dimensions that the figure does not show (default: the middle number or the first text label). A
        number selects the nearest value, and a sequence of strings selects the first label that exists.
    reduce : mapping of str to str
        Statistic over each dimension: "mean", "median", "rms", "min", "max", or "field" for minimum, 5 % quantile,
        median and maximum.
    notes : str
        Additional sentences for the caption.
    looks : mapping of str to mapping
        Matplotlib properties of each line, such as colour and dashes, keyed by line name.
    derive : callable, optional
        Function that returns the given data set with additional variables.
    interactive, image : bool
        If True, the page contains an interactive plot (`interactive`) or an image (`image`).
    """

    name: str
    title: str
    variables: Sequence[str] = ()
    over: Sequence[str] = ()
    lines: Sequence[str] = ()
    panels: Sequence[str] = ()
    at: Mapping[str, Any] = field(default_factory=dict)
    reduce: Mapping[str, str] = field(default_factory=dict)
    notes: str = ""
    looks: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    derive: Callable[[xr.Dataset], xr.Dataset] | None = None
    interactive: bool = True
    image: bool = True


@dataclass(frozen=True)
class Curves(Figure):
    """Curves over numbers or dates, or points over text labels, with a panel for each variable.

    Parameters
    ----------
    bands : mapping of str to sequence of str
        For each variable with a band, names of the variables with its lower and upper limits, or name of the variable
        with its half-width. Standard errors ``NAME_error`` need no entry.
    logarithmic : bool
        If True, the value axis is logarithmic.
    most : int
        Maximum number of panels.
    styled : bool
        If True, `looks` defines all lines and markers, for example unconnected dots over a numeric axis. The key ``""``
        of `looks` applies to every line.
    """

    bands: Mapping[str, Sequence[str]] = field(default_factory=dict)
    logarithmic: bool = False
    most: int = 6
    styled: bool = False


@dataclass(frozen=True)
class Coloured(Figure):
    """Base class of maps, pictures and heat maps, whose colours represent values.

    Parameters
    ----------
    each : bool
        If True, each variable has a panel with its own colour scale; otherwise, each point of the sweep has a panel.
    palette : str
        Name of the colour map (default: chosen from the values).
    kinds : mapping of int to (str, str)
        Meaning and colour of each code if the values are codes for categories.
    """

    each: bool = False
    palette: str = ""
    kinds: Mapping[int, tuple[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Maps(Coloured):
    """Maps of a heliostat field in which each mirror is coloured by its value.

    Parameters
    ----------
    less : str
        Dimension with text labels. A second figure shows the first value along this dimension minus each other value.
    """

    less: str = ""


@dataclass(frozen=True)
class Rasters(Coloured):
    """Pictures over the two pixel dimensions `over`. Pictures of mirrors show the outlines of the modules."""

    over: Sequence[str] = PIXELS


@dataclass(frozen=True)
class Grids(Coloured):
    """Heat maps over two swept dimensions, with a panel for each variable."""

    each: bool = True


@dataclass(frozen=True)
class Planes(Figure):
    """Points in a plane with equal axis scales, such as spots on the receiver.

    Parameters
    ----------
    variables : sequence of str
        Vertical coordinates.
    against : mapping of str to str
        Horizontal coordinate of each variable.
    colour : str
        Dimension whose values determine the colours of the points.
    dots : bool
        If True, points are not joined by lines.
    worst : str
        Variable with a value for each heliostat. The first panels show the heliostats with the largest values.
    extra : callable
        Function that draws additional elements after the axis limits of a panel are set. Its arguments are the axes,
        the data set and the point.
    """

    against: Mapping[str, str] = field(default_factory=dict)
    colour: str = ""
    dots: bool = False
    worst: str = ""
    extra: Callable[..., Any] = lambda *_: None


@dataclass(frozen=True)
class Special(Figure):
    """Figure drawn by its own function.

    Parameters
    ----------
    draw : callable
        Function that takes the data set and returns a matplotlib figure or None. The function may also return
        additional sentences for the caption. `variables` lists all variables that the function needs.
    """

    draw: Callable[[xr.Dataset], Any] = lambda _: None
    interactive: bool = False


def default_figures(result: xr.Dataset) -> Iterator[Figure]:
    """Yield figures for any result: a map of the field, pictures, and curves over each dimension."""
    names = quantities(result)
    flat = [name for name in names if not set(PIXELS) <= set(result[name].dims)]
    whole = [name for name in flat if HELIOSTAT not in result[name].dims or result.sizes[HELIOSTAT] < FIELD]
    yield Maps("map", "Map of the field", names)
    yield Rasters("pictures", "Pictures", names)
    for dim in result.sizes:
        if str(dim) not in (*PIXELS, *NAMES) and is_ordered(result, str(dim)) and result.sizes[dim] > 1:
            title = head_of(result[dim]) if dim in result.coords else str(dim).replace("_", " ")
            yield Curves(f"over_{dim}", f"Results against {title}", whole or flat, over=[str(dim)])


def with_heat_map(result: xr.Dataset, figures: Iterable[Figure], names: Iterable[str]) -> list[Figure]:
    """Return the figures with a heat map first if two dimensions are swept.

    The heat map is the first declared heat map, or a new heat map of the headline numbers if none is declared.
    """
    declared, numbers = list(figures), quantities(result)
    if grids := [one for one in declared if isinstance(one, Grids) and prepared(result, one)[1]]:
        return [grids[0], *(one for one in declared if one is not grids[0])]
    known = [name for name in names if name in numbers and HELIOSTAT not in result[name].dims]
    sizes = result[known[0]].sizes if known else {}
    long = [str(dim) for dim, size in sizes.items() if size > 2 and dim not in NAMES][:2]
    if len(long) < 2 or set(long) & {"date", "hour", "time", "day"}:
        return declared
    same = [name for name in known if set(long) <= set(result[name].dims)]
    same = [name for name in same if float(result[name].max()) > float(result[name].min())][:3]
    title = f"{capital(title_of(result[known[0]]))} against {' and '.join(head_of(result[dim]) for dim in long)}"
    return [Grids("heat_map", title, same, over=long), *declared]


def preferred(result: xr.Dataset, dims: Sequence[str], wanted: Sequence[str]) -> str | None:
    """Return the first wanted dimension, or else the first with text labels, or else the first of all."""
    dims = [dim for dim in dims if dim != HELIOSTAT or dim in wanted or result.sizes[dim] < FIELD]
    words = [dim for dim in dims if not is_ordered(result, dim)]
    return next((dim for dim in (*wanted, "statistic", *words, *dims) if dim in dims), None)


def is_ordered(result: xr.Dataset, dim: str) -> bool:
    """Return True if the values along a dimension are numbers, dates or months."""
    return dim == "month" or (dim in result.coords and result[dim].ndim == 1 and result[dim].dtype.kind in "fiuM")


def is_joined(result: xr.Dataset, dim: str) -> bool:
    """Return True if a line may join the values along a dimension."""
    return is_ordered(result, dim) and dim not in NAMES and not dim.endswith("seed")


def prepared(result: xr.Dataset, figure: Figure) -> tuple[xr.Dataset, Figure | None]:
    """Return the data set and the declaration from which a figure is drawn.

    The data set contains the derived variables and the statistics over dimensions. The declaration contains only the
    variables that can be drawn, and is None if no variable can be drawn.
    """
    result = figure.derive(result) if figure.derive else result
    if figure.reduce:
        others = {end for pair in getattr(figure, "bands", {}).values() for end in pair}
        every = {name: result[name] for name in {*figure.variables, *others} if name in result.data_vars}
        result = result.assign({name: _statistic(array, figure.reduce) for name, array in every.items()})
    if isinstance(figure, Special):
        there = all(name in result.variables and result[name].size for name in figure.variables)
        return result, figure if there else None
    names = [
        name for name in figure.variables if name in result.data_vars and axes_of(result, figure, name) is not None
    ]
    return result, replace(figure, variables=names) if names else None


def axes_of(result: xr.Dataset, figure: Figure, name: str) -> list[str] | None:
    """Return the dimensions along which a figure draws a variable, or None if the variable cannot be drawn."""
    array = result[name]
    sizes = {str(dim): size for dim, size in array.sizes.items() if dim not in figure.reduce}
    long = [dim for dim in figure.over if sizes.get(dim, 0) > 1]
    dims, drawn = long[:1], len(long) > 0
    if isinstance(figure, Maps):
        placed = all(axis in result.coords and HELIOSTAT in result.variables[axis].dims for axis in "xy")
        dims, drawn = [HELIOSTAT], placed and sizes.get(HELIOSTAT, 0) >= FIELD
    elif isinstance(figure, Rasters):
        dims, drawn = list(figure.over), set(figure.over) <= set(sizes)
    elif isinstance(figure, Grids):
        dims, drawn = sorted(long[:2], key=lambda dim: sizes[dim]), len(long) > 1
    elif isinstance(figure, Planes):
        dims, drawn = long[: None if figure.dots else 1], figure.against.get(name) in result.data_vars
    elif not figure.over:
        dims = [dim for dim, size in sizes.items() if size > 1 and is_joined(result, dim)][:1]
        drawn = bool(dims)
    return dims if drawn and array.dtype.kind in "fiuM" and array.size else None


def _statistic(array: xr.DataArray, statistics: Mapping[str, str]) -> xr.DataArray:
    attrs = array.attrs
    for dim, kind in ((dim, kind) for dim, kind in statistics.items() if dim in array.dims):
        array = array.where(np.isfinite(array))
        if kind == "rms":
            array = (array**2).mean(dim) ** 0.5
        elif kind == "field" and array.sizes[dim] >= FIELD:
            known = array.notnull().any(dim)
            filled = array.where(known, 0.0).quantile(list(STATISTICS.values()), dim)
            array = filled.assign_coords(quantile=list(STATISTICS)).rename(quantile="statistic").where(known)
        elif kind != "field":
            array = getattr(array, kind)(dim)
    return array.assign_attrs(attrs)


#: Line colours of Okabe and Ito (2008): blue, vermilion, green, pink, sky blue, orange and black.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
DASHES = ("-", (0, (4, 1.6)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)), (0, (8, 2)), (0, (2, 1.2)), (0, (4, 1, 1, 1, 1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

#: Matplotlib colour maps for values and for differences, which diverge from zero.
VALUES, DIFFERENCES = "viridis", "RdBu_r"

#: Colour of missing values.
NO_VALUE = "#c8c8c8"

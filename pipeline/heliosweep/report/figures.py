"""Declarations of figures. Each declaration specifies the form, the variables and the dimensions of a figure.

A family lists declarations in its module ``figures``. `heliosweep.report.draw` draws the figures as
images, and `heliosweep.report.interactive` as interactive plots. Variables that a result does not have are skipped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.context import capital, head_of, quantities, title_of

HELIOSTAT = "heliostat"
#: Dimensions of pixels, with the rows first.
PIXELS = ("z", "y")
#: Minimum number of heliostats for a map of the field.
FIELD = 7
#: Dimensions whose numbers are only labels. Lines do not join values along these dimensions.
NAMES = (HELIOSTAT, "module", "camera", "sample", "spot", "parameter", "trace", "detector", "evaluation")
#: Maximum number of figures of a result.
MOST_FIGURES = 12
#: Quantile over the field for each line of the statistic ``field``, by the name of the line.
STATISTICS = {"minimum": 0.0, "5 %": 0.05, "median": 0.5, "maximum": 1.0}


@dataclass(frozen=True)
class Figure:
    """Base class of the declarations of figures.

    Parameters
    ----------
    name : str
        Short name, also used as the name of the file.
    title : str
        Heading of the interactive plot and first words of the caption.
    variables : sequence of str
        Variables in descending order of importance. Images show the variables that fit; interactive plots offer all
        variables.
    over : sequence of str
        Dimensions of the axes in order of preference (default: chosen from the variables).
    lines, panels : sequence of str
        Dimensions of the lines and dimensions of the panels in order of preference.
    at : mapping of str to object
        Values of dimensions that the figure does not show (default: the middle number or the first text label). A
        number selects the nearest value, and a sequence of strings selects the first label that exists.
    reduce : mapping of str to str
        Statistic over each dimension: "mean", "median", "rms", "min", "max", or "field" for minimum, 5 % quantile,
        median and maximum.
    notes : str
        Additional sentences for the caption.
    looks : mapping of str to mapping
        Matplotlib properties of each line, such as colour and dashes, by the name of the line.
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
        Names of the variables that contain the lower and upper end of each variable's band, or half of the width of the
        band. Standard errors ``NAME_error`` need no entry.
    logarithmic : bool
        If True, the axis of the values is logarithmic.
    most : int
        Maximum number of panels.
    styled : bool
        If True, `looks` defines all lines and markers, so that dots may be drawn over numbers. The key ``""`` of
        `looks` applies to every line.
    """

    bands: Mapping[str, Sequence[str]] = field(default_factory=dict)
    logarithmic: bool = False
    most: int = 6
    styled: bool = False


@dataclass(frozen=True)
class Coloured(Figure):
    """Panels in which colours represent values, as a base class of maps, pictures and heat maps.

    Parameters
    ----------
    each : bool
        If True, each variable has a panel with its own colour scale; otherwise, each point of the sweep has a panel.
    palette : str
        Name of the colour map (default: chosen from the values).
    kinds : mapping of int to (str, str)
        Meaning and colour of each value, if the values are codes for categories.
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
        Dimension with text labels. A second figure shows the differences between its first value and each other value.
    """

    less: str = ""


@dataclass(frozen=True)
class Rasters(Coloured):
    """Pictures over the two dimensions `over` of pixels. Pictures of mirrors show the outlines of the modules."""

    over: Sequence[str] = PIXELS


@dataclass(frozen=True)
class Grids(Coloured):
    """Heat maps over two swept dimensions, with a panel for each variable."""

    each: bool = True


@dataclass(frozen=True)
class Planes(Figure):
    """Points in a plane with equal axes, such as spots on the receiver.

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
        Function that takes the axes, the data set and the point, and adds elements to a panel with fixed limits.
    """

    against: Mapping[str, str] = field(default_factory=dict)
    colour: str = ""
    dots: bool = False
    worst: str = ""
    extra: Callable[..., Any] = lambda *_: None


@dataclass(frozen=True)
class Special(Figure):
    """Figure that is drawn by a special function.

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
            yield Curves(f"over_{dim}", f"Results over {title}", whole or flat, over=[str(dim)])


def with_heat_map(result: xr.Dataset, figures: Iterable[Figure], names: Iterable[str]) -> list[Figure]:
    """Return figures in an order that starts with a heat map if two dimensions are swept.

    The heat map is the first declared heat map, or a new heat map of the headline numbers if none is declared.
    """
    declared = list(figures)
    grids = [one for one in declared if isinstance(one, Grids) and prepared(result, one)[1]]
    return [*(grids[:1] or _heat_map(result, names)), *(one for one in declared if one not in grids[:1])]


def _heat_map(result: xr.Dataset, names: Iterable[str]) -> Iterator[Grids]:
    numbers = quantities(result)
    known = [name for name in names if name in numbers and HELIOSTAT not in result[name].dims]
    sizes = result[known[0]].sizes if known else {}
    long = [str(dim) for dim, size in sizes.items() if size > 2 and dim not in NAMES]
    if len(long) >= 2 and not set(long[:2]) & {"date", "hour", "time", "day"}:
        same = [name for name in known if set(long[:2]) <= set(result[name].dims)]
        same = [name for name in same if float(result[name].max()) > float(result[name].min())][:3]
        title = f"{capital(title_of(result[known[0]]))} over {' and '.join(head_of(result[dim]) for dim in long[:2])}"
        yield Grids("heat_map", title, same, over=long[:2])


def preferred(result: xr.Dataset, dims: Sequence[str], wanted: Sequence[str]) -> str | None:
    """Return the first wanted dimension, otherwise the first one with text labels, otherwise the first dimension."""
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


#: Colours of lines in order: blue, vermilion, green, pink, sky blue, orange and black of Okabe and Ito (2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
DASHES = ("-", (0, (4, 1.6)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)), (0, (8, 2)), (0, (2, 1.2)), (0, (4, 1, 1, 1, 1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

#: Names of matplotlib's colour maps for values, and for differences that diverge from zero.
VALUES, DIFFERENCES = "viridis", "RdBu_r"

#: Colour of missing values.
NO_VALUE = "#c8c8c8"

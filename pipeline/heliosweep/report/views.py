"""What a reader may turn and switch in a result: views, declared by the families or found from the dimensions.

A view names quantities; everything else follows from their dimensions and coordinates. What a view does not draw along
becomes a switch on the page.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import xarray as xr

from heliosweep.report.labels import is_quantity

HELIOSTAT = "heliostat"

#: Dimensions of pixels, rows first.
PIXELS = ("z", "y")

#: From so many heliostats on they are a field, of which there are maps.
FIELD = 7

#: From so many values on a dimension is worth a curve.
LEAST_CURVE = 3

#: Dimensions whose values are words in an order.
_ORDERED_WORDS = ("month",)

#: Dimensions whose numbers are names: their order says nothing, and no line joins their values.
_NUMBERED = (HELIOSTAT, "module", "camera", "sample")

Kind = Literal["field", "raster", "curves", "plane"]


@dataclass(frozen=True)
class View:
    """An interactive plot.

    Parameters
    ----------
    kind : {"field", "raster", "curves", "plane"}
        A map of heliostats at their coordinates ``x`` and ``y``; a picture over the last two of `along`; curves over
        one of the dimensions in `along`; or points in a plane, of which the second coordinate is in `against`.
    title : str
        What it shows, in few words; of curves it may be left empty: the quantity and the dimension are named then.
    quantities : sequence of str
        Variables to choose from, the first is shown first; those that the result lacks, or that have nothing to draw
        along, are left out.
    along : sequence of str
        Dimensions that are drawn along: for curves and planes those to choose from.
    lines : sequence of str
        Dimensions of which a curve is drawn for each value, the preferred first; any other may be chosen too.
    less : str
        Dimension of words of which one value may be taken off another, for instance ``tracking``.
    start : mapping of str to float or str
        Where switches stand at first, or the nearest to it; the first value of the others.
    against : mapping of str to str
        For planes: variable on the horizontal axis for each of `quantities`.
    outline : tuple of float, optional
        For planes: width and height of a rectangle about the origin, for instance of the aperture.
    colours : mapping of str to str
        Colours of lines by the words that they stand for, as in the figures beside the plot.
    caption : str
        Sentences below it.
    """

    kind: Kind
    title: str
    quantities: Sequence[str]
    along: Sequence[str] = ()
    lines: Sequence[str] = ()
    less: str = ""
    start: Mapping[str, float | str] = field(default_factory=dict)
    against: Mapping[str, str] = field(default_factory=dict)
    outline: tuple[float, float] | None = None
    colours: Mapping[str, str] = field(default_factory=dict)
    caption: str = ""


def default_views(result: xr.Dataset) -> Iterator[View]:
    """Views of any result: a map of the field, pictures and curves, as its dimensions allow; reads coordinates only."""
    names = shown(result)
    yield View("field", "Map of the field", names, (HELIOSTAT,), less=words(result))
    yield View("raster", "Pictures", names, PIXELS, less=words(result))
    numbers = [str(dim) for dim in result.sizes if dim not in PIXELS and is_ordered(result, str(dim))]
    dims = [dim for dim in numbers if dim not in (HELIOSTAT, "sample") and result.sizes[dim] >= LEAST_CURVE]
    flat = [name for name in names if not set(PIXELS) <= set(result[name].dims)]
    few = [name for name in flat if HELIOSTAT not in result[name].dims or result.sizes[HELIOSTAT] < FIELD]
    yield View("curves", "", few or flat, dims, lines=[words(result)])


def usable(result: xr.Dataset, views: Iterable[View]) -> list[View]:
    """The views that a result has something for, each with the quantities it has."""
    found = []
    for view in views:
        names = [name for name in view.quantities if name in result.data_vars and _drawable(result, view, name)]
        if names:
            along = [dim for dim in view.along if any(dim in result[name].dims for name in names)]
            found.append(View(**{**vars(view), "quantities": tuple(names), "along": tuple(along)}))
    return found


def _drawable(result: xr.Dataset, view: View, name: str) -> bool:
    array = result[name]
    if not is_quantity(array) or not array.size:
        return False
    if view.kind == "field":
        return HELIOSTAT in array.dims and array.sizes[HELIOSTAT] >= FIELD and _placed(result, array)
    if view.kind == "raster":
        return set(view.along) <= set(array.dims)
    if view.kind == "plane":
        other = view.against.get(name)
        if other not in result.data_vars or result[other].dims != array.dims:
            return False
    return any(array.sizes.get(dim, 0) > 1 for dim in view.along)


def _placed(result: xr.Dataset, array: xr.DataArray) -> bool:
    """Whether it is told where heliostats stand, for all the points of a quantity."""
    return all(
        name in result.coords and HELIOSTAT in result[name].dims and set(result[name].dims) <= set(array.dims)
        for name in "xy"
    )


def shown(result: xr.Dataset) -> list[str]:
    """Numbers of a result: no flags, no dates."""
    return [str(name) for name, array in result.data_vars.items() if is_quantity(array)]


def words(result: xr.Dataset) -> str:
    """First swept dimension of words; empty where there is none."""
    dims = (str(dim) for dim in result.sizes if dim in result.coords and result[dim].dtype.kind in "OU")
    return next((dim for dim in dims if dim not in _ORDERED_WORDS and result.sizes[dim] > 1), "")


def is_ordered(result: xr.Dataset, dim: str) -> bool:
    """Whether the values along a dimension are numbers, dates or words in an order."""
    return dim in _ORDERED_WORDS or (dim in result.coords and result[dim].dtype.kind in "fiuM")


def is_joined(result: xr.Dataset, dim: str) -> bool:
    """Whether a line along a dimension says anything: its values have an order that is more than one of numbering."""
    return is_ordered(result, dim) and dim not in _NUMBERED and not dim.endswith("seed")


def position(result: xr.Dataset, dim: str, value: float | str) -> int:
    """Where along a dimension a value stands, or the nearest to it; the first where there is none."""
    if dim not in result.coords or result[dim].ndim != 1:
        return 0
    values = result[dim].to_numpy()
    if isinstance(value, str) or values.dtype.kind not in "fiu":
        same = np.flatnonzero(values.astype(str) == str(value))
        return int(same[0]) if same.size else 0
    return int(np.argmin(np.abs(values.astype(float) - value)))

"""What the figures of the family share: which points of a result are shown."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import wraps
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.registry import NamedFigure
from heliosweep.report.images import Ground, Outline
from heliosweep.report.labels import value_text
from heliosweep.report.selection import evenly
from heliosweep.report.style import COLOURS, DASHES, MARKERS

METHOD, REFERENTIAL, MODULE, PROFILE, HOUR = "method", "referential", "module", "sun_profile", "hour"
HELIOSTAT, CAMERA = "heliostat", "camera"

#: Directions, as the ends of variables and as words.
DIRECTIONS = {"x": "horizontal", "y": "vertical"}

#: Dimensions that are drawn from, not swept.
SEEDS = ("profile_seed", "camera_seed", "defect_seed")

#: Dimensions that are no numbers of a sweep.
_NOT_SWEPT = {METHOD, REFERENTIAL, MODULE, HELIOSTAT, HOUR, CAMERA, "y", "z", *SEEDS}

#: Methods from the best to the first; those that need no referential; and referentials in the order of the paper.
BEST = ("LM", "O2", "O1", "A")
DIRECT = ("O2", "LM")
EXACT = ("exact", "roll", "none")

#: Where some dimensions stand that are not shown, or the nearest to it there is.
_TYPICAL = {
    "sun_azimuth": 30.0,
    "sun_elevation": 60.0,
    "camera_radius": 0.24,
    "canting_scale": 1.0,
    "profile_error": 0.0,
    "gain_error": 0.0,
    HOUR: 12.0,
}

#: Profiles of one figure, modules of one figure, modules of a table.
MOST_SORTS, MOST_MODULES = 2, 4

METHOD_COLOURS = {"A": COLOURS[0], "O1": COLOURS[1], "O2": COLOURS[2], "LM": COLOURS[3]}
_MARKS = dict(zip(METHOD_COLOURS, MARKERS, strict=False))
_DASHES = {"none": DASHES[0], "roll": DASHES[1], "exact": DASHES[2], "": DASHES[0]}

Point = dict[str, int]
Draw = Callable[[xr.Dataset], Iterable[NamedFigure]]


@dataclass(frozen=True)
class Way:
    """A method with a referential, which only A and O1 need.

    Parameters
    ----------
    method, referential : str
        Names; the referential is empty where none is needed.
    point : dict
        Where it stands in the result.
    """

    method: str
    referential: str
    point: Point

    @property
    def name(self) -> str:
        """Both in words."""
        return f"{self.method}, {self.referential}" if self.referential else self.method

    @property
    def look(self) -> dict[str, Any]:
        """Colour and marker of the method, dashes of the referential."""
        return {
            "color": METHOD_COLOURS.get(self.method, "#000000"),
            "marker": _MARKS.get(self.method, "X"),
            "linestyle": _DASHES.get(self.referential, "-"),
        }


def needs(*names: str) -> Callable[[Draw], Draw]:
    """Give a figure up where the result lacks a variable or has nothing along one of its dimensions."""

    def decorate(draw: Draw) -> Draw:
        @wraps(draw)
        def wrapper(result: xr.Dataset) -> Iterable[NamedFigure]:
            if all(name in result and all(result[name].shape) for name in names):
                yield from draw(result)

        return wrapper

    return decorate


def at(array: xr.DataArray, *points: Point) -> xr.DataArray:
    """Part of an array, not yet read."""
    everything = {dim: index for point in points for dim, index in point.items()}
    return array.isel({dim: index for dim, index in everything.items() if dim in array.dims})


def swept(result: xr.Dataset, quantity: str) -> list[str]:
    """Swept dimensions of a quantity along which there are several numbers."""
    dims = (str(dim) for dim in result[quantity].dims if dim not in _NOT_SWEPT)
    return [dim for dim in dims if result.sizes[dim] > 1 and _has_numbers(result, dim)]


def typical(result: xr.Dataset, dim: str) -> int:
    """Where a dimension stands that is not shown: middle of numbers, best method, exact referential, else the first."""
    if dim not in result.coords or result[dim].ndim != 1:
        return 0
    values = result[dim].to_numpy()
    for name, order in ((METHOD, BEST), (REFERENTIAL, EXACT)):
        if dim == name:
            return next((list(values).index(word) for word in order if word in values), 0)
    if dim in SEEDS or not _has_numbers(result, dim):
        return 0
    if dim in _TYPICAL:
        return int(np.argmin(np.abs(values.astype(float) - _TYPICAL[dim])))
    return int(np.argsort(values, kind="stable")[(values.size - 1) // 2])


def fixed(result: xr.Dataset, quantity: str, *shown: str | None) -> Point:
    """Where everything stands that a figure does not show."""
    return {str(dim): typical(result, str(dim)) for dim in result[quantity].dims if dim not in shown}


def chosen(result: xr.Dataset, dim: str, most: int) -> list[Point]:
    """At most so many positions along a dimension, in the order of its numbers; one empty point without it."""
    if dim not in result.sizes:
        return [{}]
    order = ordered(result, dim)
    return [{dim: int(order[index])} for index in evenly(order.size, most)]


def ordered(result: xr.Dataset, dim: str) -> np.ndarray:
    """Positions along a dimension in the order of its numbers."""
    return (
        np.argsort(result[dim].to_numpy(), kind="stable") if _has_numbers(result, dim) else np.arange(result.sizes[dim])
    )


def ways(result: xr.Dataset, quantity: str, every: bool = True) -> list[Way]:
    """Methods with each of their referentials, or with the first alone."""
    array = result[quantity]
    found = []
    for i in range(result.sizes[METHOD]) if METHOD in array.dims else [-1]:
        method = _word(result, METHOD, i)
        for j in range(result.sizes[REFERENTIAL]) if REFERENTIAL in array.dims else [-1]:
            if j > 0 and (method in DIRECT or not every):
                break
            point = {dim: index for dim, index in ((METHOD, i), (REFERENTIAL, j)) if index >= 0}
            found.append(Way(method, "" if method in DIRECT or j < 0 else _word(result, REFERENTIAL, j), point))
    return found


def best_ways(result: xr.Dataset, quantity: str) -> list[Way]:
    """Each method once, with the best referential there is."""
    found: dict[str, Way] = {}
    for way in ways(result, quantity):
        known = found.get(way.method)
        if known is None or _rank(way) < _rank(known):
            found[way.method] = way
    return list(found.values())


def _rank(way: Way) -> int:
    return EXACT.index(way.referential) if way.referential in EXACT else len(EXACT)


def sort_of(result: xr.Dataset, quantity: str) -> str:
    """Dimension of words that figures compare: the sun's profile, else another swept one, such as the arrangement."""
    dims = [str(dim) for dim in result[quantity].dims]
    words = [dim for dim in dims if dim not in _NOT_SWEPT and dim in result.coords and result[dim].dtype.kind in "OU"]
    return PROFILE if PROFILE in dims or not words else words[0]


def sorts(result: xr.Dataset, quantity: str) -> list[tuple[str, Point]]:
    """Values along `sort_of` by name; one empty where there is none."""
    dim = sort_of(result, quantity)
    if dim not in result[quantity].dims:
        return [("", {})]
    return [(short(result, dim, point[dim]), point) for point in chosen(result, dim, MOST_SORTS)]


def modules(result: xr.Dataset, quantity: str, most: int = MOST_MODULES) -> list[tuple[str, Point]]:
    """Modules that are shown: those with entered canting, else some of those that there are."""
    if MODULE not in result[quantity].dims:
        return [("", {})]
    numbers = [int(number) for number in result[MODULE].to_numpy()] if MODULE in result.coords else []
    numbers = numbers or list(range(1, result.sizes[MODULE] + 1))
    canted = [i for i, number in enumerate(numbers) if any(canting(result).get(number, ()))]
    order = canted or list(range(len(numbers)))
    return [(f"module {numbers[order[i]]}", {MODULE: order[i]}) for i in evenly(len(order), most)]


def canting(result: xr.Dataset) -> dict[int, tuple[float, float]]:
    """Canting that was entered, horizontal and vertical by the module's number, without its factor. [mrad]"""
    given = study(result).get("defects", {}).get("canting", {})
    return {int(key): (float(pair[0]), float(pair[1])) for key, pair in given.items()}


def study(result: xr.Dataset) -> dict[str, Any]:
    """The study file of a result, where it is told."""
    found = json.loads(result.attrs.get("study", "{}"))
    return found if isinstance(found, dict) else {}


def ground(result: xr.Dataset, quantity: str) -> Ground | None:
    """Mirror on which maps are drawn, with its modules; none where the result does not tell."""
    if not {"y", "z"} <= set(result[quantity].dims) or not {"y", "z"} <= set(result.coords):
        return None
    outlines = []
    sides = [f"module_{name}" for name in ("y", "z", "width", "height")]
    if set(sides) <= set(result.coords) and all(result[side].dims == (MODULE,) for side in sides):
        rows = np.stack([result[side].to_numpy() for side in sides], axis=-1)
        names = [text.removeprefix("module ") for text, _ in all_modules(result)]
        outlines = [
            Outline(float(y), float(z), float(wide), float(high), text)
            for (y, z, wide, high), text in zip(rows, names, strict=True)
        ]
    y, z = (result[side].to_numpy().astype(float) for side in "yz")
    return Ground(y, z, "to the right (m)", "up (m)", outlines)


def all_modules(result: xr.Dataset) -> list[tuple[str, Point]]:
    """Every module by name."""
    count = result.sizes[MODULE]
    numbers = result[MODULE].to_numpy() if MODULE in result.coords else np.arange(1, count + 1)
    return [(f"module {int(number)}", {MODULE: i}) for i, number in enumerate(numbers)]


def short(result: xr.Dataset, dim: str, index: int) -> str:
    """One value with its unit."""
    if dim not in result.coords:
        return f"{dim.replace('_', ' ')} {index + 1}"
    return value_text(result[dim].isel({dim: index})).replace("_", " ")


def _has_numbers(result: xr.Dataset, dim: str) -> bool:
    return dim in result.coords and result[dim].ndim == 1 and result[dim].dtype.kind in "fiu"


def _word(result: xr.Dataset, dim: str, index: int) -> str:
    """Name along a dimension, also where it has but one that is a coordinate without it."""
    if dim not in result.coords:
        return f"{dim} {index + 1}" if index >= 0 else ""
    values = np.atleast_1d(result[dim].to_numpy())
    return str(values[max(index, 0)]) if index >= 0 or values.size == 1 else ""

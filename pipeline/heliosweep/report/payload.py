"""The numbers of a view and the words for them, thinned to what a page can hold."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.ground import rings, rises
from heliosweep.report.labels import (
    axis_label,
    coordinate_text,
    is_fraction,
    is_signed,
    steps_of,
    title_of,
    unit_of,
    value_text,
)
from heliosweep.report.selection import evenly, is_geometric
from heliosweep.report.views import HELIOSTAT, View, is_joined, is_ordered, position

#: Numbers on one page at the most, of four bytes each.
PAGE_VALUES = 480_000

#: Values of a dimension that thinning leaves at the least: at first, and where that is not enough.
LEAST = (12, 3)

#: Dimensions of at most so many values are thinned only where nothing else is left: of directions all are wanted.
SHORT = 24

#: Part of the values that each step of thinning leaves.
STEP = 0.75

#: Arrays up to so many numbers are read whole: reading scattered ones takes longer.
WHOLE = 8_000_000

#: Mirrors without known sides: part of the land that each has; and least part of the field that is seen.
PACKING, SEEN = 0.55, 1 / 250

#: Lines of a label, their length on narrow screens, and on wide ones upwards and to the right, and the size of letters.
#: [letters, CSS pixel]
MOST_FOLDS, ROOMS, SIZE = 4, (28, 40, 60), 13

#: Points up to which a line has marks, and the size of these. [CSS pixel]
MOST_MARKS, MARK = 80, 6

Kept = dict[str, np.ndarray]


def view_payload(result: xr.Dataset, view: View, budget: int = PAGE_VALUES) -> dict[str, Any]:
    """What a view that is `usable` can show in so many numbers at the most, and words for them.

    Returns
    -------
    dict
        ``quantities``: numbers over named dimensions, with name and unit, and for each value of ``view.less``
        (``shown[0]``: none) label, unit and range; ``dims``: title, words and place on the axis of each value;
        ``start``: where switches stand; ``title``; ``thinned``: what was left out, in words; ``places`` of mirrors,
        ``areas`` of the field.
    """
    kept, names = thinned(result, view, _names(view), budget)
    arrays = {name: _array(result[name], kept) for name in names}
    told = [name for name in names if np.isfinite(arrays[name]["values"]).any()] or names
    dims = {dim: _dimension(result, dim, index) for dim, index in kept.items()}
    quantities: list[dict[str, Any]] = []
    for name in view.quantities:
        across = view.against.get(name)
        if name in told and (across or name) in told:
            quantities.append({"name": name, **arrays[name], **_words(result[name], arrays[name], dims, view.less)})
            if across:
                quantities[-1]["across"] = arrays[across] | _label(axis_label(result[across]))
    first = next((dims[dim]["title"] for dim in view.along if dim in quantities[0]["dims"]), "what is swept")
    return {
        "quantities": quantities,
        "dims": dims,
        "title": view.title or f"{quantities[0]['heading']} over {first}",
        "start": {
            dim: int(np.argmin(np.abs(kept[dim] - position(result, dim, value))))
            for dim, value in view.start.items()
            if dim in kept
        },
        "thinned": _said(result, kept),
        "places": _places(result, kept) if view.kind == "field" else {},
        "areas": rings(result) if view.kind == "field" else {},
    }


def _names(view: View) -> list[str]:
    return list(dict.fromkeys([*view.quantities, *(view.against[name] for name in view.quantities if view.against)]))


def wanted(result: xr.Dataset, view: View) -> int:
    """Numbers of all that a view could show."""
    return sum(result[name].size for name in _names(view))


def shares(wishes: Sequence[int], budget: int) -> list[int]:
    """What each of several may take of a budget: small wishes are granted, large ones share what is left evenly."""
    order = sorted(range(len(wishes)), key=wishes.__getitem__)
    granted = [0] * len(wishes)
    for done, i in enumerate(order):
        granted[i] = min(wishes[i], budget // (len(wishes) - done))
        budget -= granted[i]
    return granted


def thinned(result: xr.Dataset, view: View, names: Sequence[str], budget: int) -> tuple[Kept, list[str]]:
    """Which values of each dimension are kept, in increasing order, and of which quantities.

    The longest dimension of numbers gives way first, that of heliostats last; where nothing else is left, the last
    quantities are dropped.
    """
    names = list(names)
    sizes = {str(dim): result.sizes[dim] for name in names for dim in result[name].dims}
    counts = dict(sizes)

    def total() -> int:
        return sum(math.prod(counts[str(dim)] for dim in result[name].dims) for name in names)

    while total() > budget:
        numbers = [dim for dim in counts if dim != HELIOSTAT and (dim not in result.coords or is_ordered(result, dim))]
        long = [dim for dim in numbers if sizes[dim] > SHORT and counts[dim] > LEAST[0]]
        longest = max(long or [dim for dim in numbers if counts[dim] > LEAST[1]], key=counts.__getitem__, default="")
        if longest:
            if view.kind == "raster" and longest in view.along:
                stride = math.ceil(sizes[longest] / counts[longest]) + 1
                counts |= {dim: math.ceil(sizes[dim] / stride) for dim in view.along}
            else:
                counts[longest] = max(LEAST[0] if long else LEAST[1], math.floor(counts[longest] * STEP))
        elif len(names) > 1 and not view.against:
            names.pop()
        else:
            longest = max(counts, key=counts.__getitem__)
            counts[longest] = max(1, counts[longest] // 2)
            if counts[longest] == 1:
                break
    used = {str(dim) for name in names for dim in result[name].dims}
    kept = {dim: _kept(size, counts[dim], view.kind == "raster" and dim in view.along) for dim, size in sizes.items()}
    return {dim: _increasing(result, dim, index) for dim, index in kept.items() if dim in used}, names


def _kept(size: int, count: int, even: bool) -> np.ndarray:
    """Positions that are kept; at the same distance for pixels."""
    if even:
        return np.arange(0, size, math.ceil(size / count))
    return np.arange(size) if count >= size else np.array(evenly(size, count))


def _increasing(result: xr.Dataset, dim: str, index: np.ndarray) -> np.ndarray:
    """The same positions in the order of the numbers or dates there."""
    if dim not in result.coords or result[dim].dtype.kind not in "fiuM":
        return index
    return index[np.argsort(result[dim].to_numpy()[index], kind="stable")]


def _array(array: xr.DataArray, kept: Kept) -> dict[str, Any]:
    """Dimensions, lengths and numbers of one quantity, without dimensions of length one."""
    chosen = {str(dim): kept[str(dim)] for dim in array.dims if str(dim) in kept}
    part = _read(array, {dim: at for dim, at in chosen.items() if not np.array_equal(at, range(array.sizes[dim]))})
    part = part.squeeze([dim for dim in part.dims if part.sizes[dim] == 1 and dim != HELIOSTAT], drop=True)
    values = part.to_numpy().astype(float)
    return _numbers(part.dims, values * 100 if is_fraction(array) else values)


def _read(array: xr.DataArray, chosen: Kept) -> xr.DataArray:
    """Chosen part of an array: in one go, or one after the other along the first dimensions where it is large.

    Scattered values of several dimensions at once would each be a reading of its own.
    """
    first = next((str(dim) for dim in array.dims if array.sizes[dim] > 1), "")
    if array.size <= WHOLE or not first:
        return array.compute().isel(chosen)
    rest = {dim: index for dim, index in chosen.items() if dim != first}
    places = chosen.get(first, np.arange(array.sizes[first]))
    return xr.concat([_read(array.isel({first: [int(i)]}), rest) for i in places], first)


def _numbers(dims: Sequence[Any], values: np.ndarray) -> dict[str, Any]:
    data = np.array(values, dtype="<f4", order="C")
    with np.errstate(invalid="ignore"):
        data[~np.isfinite(data)] = np.nan  # one pattern of bits, whatever made them
    strides = {str(dim): math.prod(data.shape[i + 1 :]) for i, dim in enumerate(dims)}
    return {"dims": list(strides), "shape": list(data.shape), "strides": strides, "values": data.ravel()}


def _words(array: xr.DataArray, numbers: Mapping[str, Any], dims: Mapping[str, Any], less: str) -> dict[str, Any]:
    """Names of a quantity, and label, unit and range of its values and of their differences from others."""
    title, unit = title_of(array), unit_of(array)
    values = numbers["values"].reshape(numbers["shape"])
    shown = [{**_label(axis_label(array)), "unit": unit, **_range(values)}]
    if less in numbers["dims"]:
        unit = "percentage points" if unit == "%" else unit  # a difference of percentages is in points
        axis = numbers["dims"].index(less)
        for i, name in enumerate(dims[less]["texts"]):
            label = f"{title}, less that of {name}{f' ({unit})' if unit else ''}"
            difference = _range(values - values.take([i], axis))
            end = max(-difference["low"], difference["high"])
            shown.append({**_label(label), "unit": unit, "low": -end, "high": end, "signed": True})
    return {"title": title, "heading": title[:1].upper() + title[1:], "shown": shown}


def _range(values: np.ndarray) -> dict[str, float | bool]:
    told = values[np.isfinite(values)]
    low, high = (float(told.min()), float(told.max())) if told.size else (0.0, 1.0)
    return {"low": low, "high": high, "signed": is_signed(low, high)}


def _dimension(result: xr.Dataset, dim: str, kept: np.ndarray) -> dict[str, Any]:
    """Title, label and kind of one dimension, the words for its values, and their places along an axis."""
    kind, joined, steps = "word", False, tuple[float, ...]()
    if dim not in result.coords:
        title, texts = _title(result, dim), _labels(result, dim, kept)
        label, at = title, np.arange(kept.size, dtype=float)
    else:
        coordinate = result[dim].isel({dim: kept})
        title, label = _title(result, dim), axis_label(coordinate).split(":")[0]
        texts, joined = _texts(result, coordinate, kept), is_joined(result, dim)
        kind, at = _axis(coordinate.to_numpy(), joined)
        steps = steps_of(coordinate) if kind == "number" else ()
    return {
        "title": title,
        "prefix": "" if kind == "word" else f"{title} ",
        **_label(label),
        "kind": kind,
        "joined": joined,
        "at": at,
        "steps": list(steps),
        "texts": texts,
        "size": MARK if kept.size <= MOST_MARKS or not joined else 0,
    }


def _title(result: xr.Dataset, dim: str) -> str:
    return re.split("[:,]", title_of(result[dim]))[0] if dim in result.coords else dim.replace("_", " ")


def _texts(result: xr.Dataset, coordinate: xr.DataArray, kept: np.ndarray) -> list[str]:
    """Words for the values of a dimension: the names along it, if there are any."""
    names = result.coords.get("name")
    if names is not None and names.dims == coordinate.dims:
        return [str(value) for value in names.to_numpy()[kept]]
    alone = coordinate.reset_coords(drop=True).drop_vars(str(coordinate.name))  # one of what stands alone comes quickly
    return [_word(alone[i]) for i in range(kept.size)]


def _axis(values: np.ndarray, joined: bool) -> tuple[str, np.ndarray]:
    """What the values along an axis are, and their places: powers stand at their logarithms, words one by one."""
    if values.dtype.kind == "M":
        return "date", (values.astype("datetime64[s]").astype(np.int64) * 1000).astype(float)
    if values.dtype.kind not in "fiu":
        return "word", np.arange(values.size, dtype=float)
    at = values.astype(float)
    return ("power", np.log10(at)) if joined and is_geometric(at) else ("number", at)


def _labels(result: xr.Dataset, dim: str, kept: np.ndarray) -> list[str]:
    """Words for a dimension without coordinate: those that run along it, as day and hour do, else numbers."""
    along = [coordinate for coordinate in result.coords.values() if coordinate.dims == (dim,)]
    if not along:
        return [str(index + 1) for index in kept]
    return [", ".join(coordinate_text(one.isel({dim: int(i)})) for one in along) for i in kept]


def _word(value: xr.DataArray) -> str:
    return value_text(value).removesuffix("T00:00") if value.dtype.kind == "M" else value_text(value)


def _places(result: xr.Dataset, kept: Kept) -> dict[str, dict[str, Any]]:
    """Where mirrors stand, how large they are drawn, and their angles: each with a side towards the tower."""
    x, y = (result[name].to_numpy().astype(float) for name in "xy")
    spans = [np.nanmax(axis) - np.nanmin(axis) if np.isfinite(axis).any() else 0.0 for axis in (x, y)]
    number = max(1, int(np.isfinite(x).sum() / max(1, x.size // x.shape[-1])))
    packed = max(PACKING * math.sqrt(spans[0] * spans[1] / number), 1.0)
    sides = "xyz" if "z" in result.coords and rises(result["z"].to_numpy()) else "xy"
    places = {name: _array(result[name], kept) for name in sides}
    for side in ("width", "height"):
        name = f"heliostat_{side}"
        known = name in result.coords and set(map(str, result[name].dims)) <= set(kept)
        places[side] = _array(result[name], kept) if known else _numbers((), np.array(packed))
        places[side]["values"] = np.maximum(places[side]["values"], np.float32(SEEN * max(spans)))
    angles = np.where((x != 0) | (y != 0), np.arctan2(-x, y), 0.0) if x.shape == y.shape else np.zeros(x.shape)
    return places | {"angle": _array(result["x"].copy(data=angles), kept)}


def _said(result: xr.Dataset, kept: Mapping[str, np.ndarray]) -> str:
    """What was thinned, in a sentence."""
    parts = []
    for dim, index in kept.items():
        if index.size < result.sizes[dim]:
            parts.append(f"{index.size} of {result.sizes[dim]:,} values of {_title(result, dim)}")
    return f"Thinned for this page: {', '.join(parts)}; all are in the data set." if parts else ""


def _label(label: str) -> dict[str, Any]:
    """A label, and folded for each of the rooms that it may have."""
    return {"label": label, "folded": [fold(label, room) for room in ROOMS]}


def fold(label: str, room: int) -> str:
    """A label on several lines where it is longer than its axis, cut off where these are too many."""
    whole = re.sub(r" (\(\S{1,6}\))$", "\N{NO-BREAK SPACE}\\1", label)  # a short unit stays beside its word
    return "\n".join(textwrap.wrap(whole, room, max_lines=MOST_FOLDS, placeholder="\N{HORIZONTAL ELLIPSIS}"))

"""Numbers of a view for the page: those that the plot needs, thinned to what a page can hold, as base64."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.labels import axis_label, coordinate_text, is_fraction, title_of, unit_of, value_text
from heliosweep.report.selection import evenly
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

#: Dimensions whose words a user wrote: they stay as they are.
_NAMED = ("site", "layout", HELIOSTAT)

Kept = dict[str, np.ndarray]


def view_payload(result: xr.Dataset, view: View, budget: int = PAGE_VALUES) -> dict[str, Any]:
    """What the script draws a view from.

    Parameters
    ----------
    result : xarray.Dataset
        The result, of which the parts that are shown are read.
    view : View
        From `heliosweep.report.views.usable`.
    budget : int
        Numbers at the most.

    Returns
    -------
    dict
        Of what JSON knows.
    """
    kept, names = thinned(result, view, _names(view), budget)
    arrays = {name: _array(result[name], kept) for name in names}
    names = [name for name in names if arrays[name]["told"]] or names
    arrays = {name: arrays[name] for name in names}
    quantities = [
        {
            "name": name,
            "title": title_of(result[name]),
            "label": axis_label(result[name]),
            "unit": unit_of(result[name]),
            "against": view.against.get(name),
        }
        for name in view.quantities
        if name in names and view.against.get(name, name) in names
    ]
    dims = {dim: _dimension(result, dim, index) for dim, index in kept.items()}
    payload = {
        "kind": view.kind,
        "title": view.title or _title(title_of(result[names[0]]), view.along, dims, arrays[names[0]]["dims"]),
        "named": not view.title,
        "quantities": quantities,
        "along": list(view.along),
        "lines": [dim for dim in view.lines if dim],
        "less": view.less,
        "start": {dim: _start(result, dim, value, kept[dim]) for dim, value in view.start.items() if dim in kept},
        "colours": dict(view.colours),
        "outline": list(view.outline) if view.outline else None,
        "dims": dims,
        "arrays": arrays,
        "thinned": _said(result, kept),
        "labels": {name: axis_label(result[name]) for name in view.against.values() if name in names},
    }
    if view.kind == "field":
        payload["places"] = _places(result, kept, arrays)
    return payload


def _title(quantity: str, along: Sequence[str], dims: Mapping[str, Any], own: Sequence[str]) -> str:
    """What is drawn first, over what."""
    title = f"{quantity} over {next((dims[dim]['title'] for dim in along if dim in own), 'what is swept')}"
    return title[:1].upper() + title[1:]


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
    """Which values of each dimension are kept, and of which quantities.

    The longest dimension of numbers gives way first, that of heliostats last; where nothing else is left, the last
    quantities are dropped.

    Returns
    -------
    tuple of dict, list of str
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
    return {dim: index for dim, index in kept.items() if dim in used}, names


def _kept(size: int, count: int, even: bool) -> np.ndarray:
    """Positions that are kept; at the same distance for pixels."""
    if even:
        return np.arange(0, size, math.ceil(size / count))
    return np.arange(size) if count >= size else np.array(evenly(size, count))


def _array(array: xr.DataArray, kept: Kept) -> dict[str, Any]:
    """Dimensions, lengths and numbers of one quantity, without dimensions of length one."""
    chosen = {str(dim): kept[str(dim)] for dim in array.dims if str(dim) in kept}
    part = _read(array, {dim: index for dim, index in chosen.items() if index.size < array.sizes[dim]})
    part = part.squeeze([dim for dim in part.dims if part.sizes[dim] == 1 and dim != HELIOSTAT], drop=True)
    values = part.to_numpy().astype(float)
    return _encoded(part.dims, values * 100 if is_fraction(array) else values)


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


def _encoded(dims: Sequence[Any], values: np.ndarray) -> dict[str, Any]:
    data = np.array(values, dtype="<f4", order="C")
    with np.errstate(invalid="ignore"):
        data[~np.isfinite(data)] = np.nan  # one pattern of bits, whatever made them
    return {
        "dims": list(map(str, dims)),
        "shape": list(data.shape),
        "told": bool(np.isfinite(data).any()),
        "data": base64.b64encode(data.tobytes()).decode("ascii"),
    }


def _dimension(result: xr.Dataset, dim: str, kept: np.ndarray) -> dict[str, Any]:
    """Name, values and words of one dimension."""
    if dim not in result.coords:
        title, texts = dim.replace("_", " "), _labels(result, dim, kept)
        return {"title": title, "label": title, "kind": "word", "joined": False, "values": None, "texts": texts}
    coordinate = result[dim].isel({dim: kept})
    values = coordinate.to_numpy()
    kind = "date" if values.dtype.kind == "M" else "number" if values.dtype.kind in "fiu" else "word"
    numbers: list[float] | None = None
    if kind == "date":
        numbers = (values.astype("datetime64[s]").astype(np.int64) * 1000).tolist()
    elif kind == "number":
        numbers = [float(value) for value in values]
    names = result.coords.get("name")
    if names is not None and names.dims == (dim,):
        texts = [str(value) for value in names.to_numpy()[kept]]
    else:
        alone = coordinate.reset_coords(drop=True).drop_vars(dim)  # to take one of what stands alone is much faster
        texts = [_word(alone[i]) for i in range(kept.size)]
    return {
        "title": re.split("[:,]", title_of(coordinate))[0],
        "label": axis_label(coordinate).split(":")[0],
        "kind": kind,
        "joined": is_joined(result, dim),
        "values": numbers,
        "texts": texts,
    }


def _labels(result: xr.Dataset, dim: str, kept: np.ndarray) -> list[str]:
    """Words for a dimension without coordinate: those that run along it, as day and hour do, else numbers."""
    along = [coordinate for coordinate in result.coords.values() if coordinate.dims == (dim,)]
    if not along:
        return [str(index + 1) for index in kept]
    return [", ".join(coordinate_text(one.isel({dim: int(i)})) for one in along) for i in kept]


def _word(value: xr.DataArray) -> str:
    text = value_text(value)
    if value.dtype.kind in "OU" and value.name not in _NAMED:
        return text.replace("_", " ")
    return text.removesuffix("T00:00") if value.dtype.kind == "M" else text


def _start(result: xr.Dataset, dim: str, value: float | str, kept: np.ndarray) -> int:
    return int(np.argmin(np.abs(kept - position(result, dim, value))))


def _places(result: xr.Dataset, kept: Kept, arrays: dict[str, Any]) -> dict[str, str]:
    """Add where mirrors stand and how large they are drawn to the arrays; the name of each."""
    x, y = (result[name].to_numpy().astype(float) for name in "xy")
    spans = [np.nanmax(axis) - np.nanmin(axis) if np.isfinite(axis).any() else 0.0 for axis in (x, y)]
    number = max(1, int(np.isfinite(x).sum() / max(1, x.size // x.shape[-1])))
    packed = max(PACKING * math.sqrt(spans[0] * spans[1] / number), 1.0)
    places = {}
    for key, name in {"x": "x", "y": "y", "width": "heliostat_width", "height": "heliostat_height"}.items():
        if name in result.coords and set(map(str, result[name].dims)) <= set(kept):
            array = _array(result[name], kept)
        else:
            array = _encoded((), np.array(packed))
        if key in ("width", "height"):
            array["least"] = SEEN * max(spans)
        arrays[f"place_{key}"] = array
        places[key] = f"place_{key}"
    return places


def _said(result: xr.Dataset, kept: Mapping[str, np.ndarray]) -> str:
    """What was thinned, in a sentence."""
    parts = []
    for dim, index in kept.items():
        if index.size < result.sizes[dim]:
            title = re.split("[:,]", title_of(result[dim]))[0] if dim in result.coords else dim.replace("_", " ")
            parts.append(f"{index.size} of {result.sizes[dim]:,} values of {title}")
    return f"Thinned for this page: {', '.join(parts)}; all are in the data set." if parts else ""

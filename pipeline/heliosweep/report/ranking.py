"""Ranking of the points of a sweep: the best and the worst by each result, what a step away costs, and all points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.grid.regions import BEST_VALUE, SMALLEST
from heliosweep.report.contents import Table
from heliosweep.report.labels import (
    MINUS,
    SPEAKING,
    flag_text,
    head_of,
    is_flag,
    is_quantity,
    labels_along,
    number_text,
    printed,
    unit_of,
    value_text,
)
from heliosweep.report.sections import decimals_of, number_texts
from heliosweep.report.views import HELIOSTAT

#: Points that are ranked, cells of the table of all points, and results of which best and worst are told.
MOST_POINTS, MOST_CELLS, MOST_RESULTS = 200_000, 10_000, 12


@dataclass(frozen=True)
class Ranking:
    """Points of a sweep, ranked.

    Parameters
    ----------
    ends, steps : Table
        Best and worst point by each result; of the first result, what each step away from the best point costs.
    points : Table
        All points, or the first of them, the best by the first result first.
    numbers : sequence of sequences
        The same cells as numbers in full, or words, for sorting and for a file.
    count : int
        Number of all points.
    """

    ends: Table
    steps: Table | None
    points: Table
    numbers: Sequence[Sequence[Any]]
    count: int


def ranked(result: xr.Dataset, first: Sequence[str] = ()) -> Ranking | None:
    """Rank the points of a result by each variable that has one number for each of them and says which is best.

    Parameters
    ----------
    result : xarray.Dataset
        The result.
    first : sequence of str
        Variables of which the first that the result has says what the points are, and ranks them; without any it is
        the first variable with the fewest dimensions.

    Returns
    -------
    Ranking or None
        None where there is only one point, nothing to rank, or too many points for a page.
    """
    arrays = {str(name): one for name, one in result.data_vars.items() if is_quantity(one)}
    known = [name for name in first if name in arrays]
    leading = next(iter(known), min(arrays, key=lambda name: arrays[name].ndim, default=""))
    if not leading or not 1 < arrays[leading].size <= MOST_POINTS:
        return None
    dims = [str(dim) for dim in arrays[leading].dims if arrays[leading].sizes[dim] > 1]
    shape = tuple(result.sizes[dim] for dim in dims)
    ranks = [leading, *(name for name in arrays if name != leading and {*arrays[name].dims} == {*arrays[leading].dims})]
    values = {name: np.asarray(printed(_over(arrays[name], dims)), dtype=float) for name in ranks}
    if not np.isfinite(values[leading]).any():
        return None
    labels = {str(dim): labels_along(result, dim) for dim in dims}
    along = {
        str(name): one
        for name, one in result.coords.items()
        if name not in dims and len(one.dims) == 1 and one.dims[0] in dims and one.dtype.kind in "fiuOU"
    }
    told = [name for name in ranks if BEST_VALUE in arrays[name].attrs][:MOST_RESULTS]
    told = [] if "evaluation" in dims else told  # a search tells its best where it keeps its bounds
    ends = [row for name in told if (row := _ends(result, name, values[name], dims, along)) is not None]
    header = ["result", "best", "at", "worst", "at"]
    flags = {
        str(name): one
        for name, one in result.data_vars.items()
        if is_flag(one) and {*one.dims} == {*arrays[leading].dims}
    }
    points, numbers = _points(
        result, labels, along, values, {name: _flags(_over(one, dims)) for name, one in flags.items()}
    )
    return Ranking(
        Table("Best and worst points", header, ends, [0, 2, 4]),
        _steps(result, leading, values[leading], dims) if leading in told else None,
        points,
        numbers,
        math.prod(shape),
    )


def _smallest(array: xr.DataArray) -> bool:
    """Whether the smallest value comes first: of variables that say so."""
    return array.attrs.get(BEST_VALUE) == SMALLEST


def _over(array: xr.DataArray, dims: Sequence[str]) -> xr.DataArray:
    """An array over the dimensions of the points."""
    return array.squeeze([dim for dim in array.dims if dim not in dims]).transpose(*dims)


def _flags(array: xr.DataArray) -> np.ndarray:
    """Words that flags stand for."""
    part = array.to_numpy()
    words = {value: flag_text(array, value) for value in np.unique(part).tolist()}
    return np.array([words[value] for value in part.ravel().tolist()], dtype=object).reshape(part.shape)


def _at(array: xr.DataArray, place: int) -> str:
    return value_text(array.reset_coords(drop=True)[place])


def _place(result: xr.Dataset, index: Sequence[int], dims: Sequence[str], along: dict[str, xr.DataArray]) -> str:
    """A point in words: the value along each dimension, or what stands along a mere number."""
    words = []
    for dim, place in zip(dims, index, strict=True):
        if dim == HELIOSTAT:
            where = [number_text(float(along[axis][place]), 1) for axis in "xy" if axis in along]
            words.append(
                f"heliostat {_at(labels_along(result, dim), place)}" + f" at ({', '.join(where)}) m" * bool(where)
            )
            continue
        tied = [one for one in along.values() if one.dims == (dim,) and dim != "site"]
        shown = [labels_along(result, dim), *tied]
        for one in shown:
            title = "" if one.name in SPEAKING else head_of(one)
            words.append(f"{title} {_at(one, place)}".strip())
    return ", ".join(words)


def _ends(
    result: xr.Dataset, name: str, values: np.ndarray, dims: Sequence[str], along: dict[str, xr.DataArray]
) -> list[str] | None:
    """Best and worst value of a result, and where they are; None where all are alike or missing."""
    if not np.isfinite(values).any() or np.nanmin(values) == np.nanmax(values):
        return None
    low, high = (np.unravel_index(find(values), values.shape) for find in (np.nanargmin, np.nanargmax))
    best, worst = (low, high) if _smallest(result[name]) else (high, low)
    texts = number_texts(np.array([values[best], values[worst]]), 4)
    unit = unit_of(result[name])
    shown = [f"{text} {unit}".rstrip() for text in texts]
    places = [_place(result, list(map(int, index)), dims, along) for index in (best, worst)]
    return [name.replace("_", " "), shown[0], places[0], shown[1], places[1]]


def _steps(result: xr.Dataset, name: str, values: np.ndarray, dims: Sequence[str]) -> Table:
    """What a step along each dimension away from the best point costs."""
    find = np.nanargmin if _smallest(result[name]) else np.nanargmax
    best = tuple(map(int, np.unravel_index(find(values), values.shape)))
    rows, costs = [], []
    for axis, dim in enumerate(dims):
        for step in (-1, 1) if dim != HELIOSTAT else ():
            place = best[axis] + step
            if 0 <= place < values.shape[axis]:
                index = (*best[:axis], place, *best[axis + 1 :])
                label = labels_along(result, dim)
                rows.append([head_of(label), _at(label, best[axis]), _at(label, place)])
                costs.append(values[index] - values[best])
    unit = unit_of(result[name])
    unit = "percentage points" if unit == "%" else unit
    texts = [number_text(cost, decimals_of(costs), signed=True) for cost in costs]
    cells = [[*row, text] for row, text in zip(rows, texts, strict=True)]
    header = ["step of", "from", "to", f"change of {name.replace('_', ' ')}"]
    note = f"From the best point, {_place(result, best, dims, {})}; all other values stay."
    return Table("A step away from the best point", header, cells, [0, 1, 2], [note], ["", "", "", unit])


def _points(
    result: xr.Dataset,
    labels: dict[str, xr.DataArray],
    along: dict[str, xr.DataArray],
    values: dict[str, np.ndarray],
    flags: dict[str, np.ndarray],
) -> tuple[Table, list[list[Any]]]:
    """Table of the points, the best first, and the same cells as numbers."""
    leading = next(iter(values))
    shape, total = values[leading].shape, values[leading].size
    columns = {**{str(one.name): one for one in labels.values()}, **along}
    most = max(1, MOST_CELLS // (len(columns) + len(values) + len(flags)))
    flat = values[leading].ravel()
    least = _smallest(result[leading])
    order = np.argsort(flat if least else -flat, kind="stable")[:most]
    places = np.unravel_index(order, shape)
    position = dict(zip(labels, places, strict=True))
    cells: list[list[str]] = []
    numbers: list[list[Any]] = []
    for one in columns.values():
        chosen, raw = position[str(one.dims[0])], one.to_numpy()
        named = raw.dtype.kind not in "fiu"
        if not named:  # what rounding leaves of 0
            raw = np.where(np.abs(raw) < 1e-12 * np.nanmax(np.abs(raw), initial=0), 0, raw)
        texts = {
            place: _at(one, place) if named else f"{raw[place]:.9g}".replace("-", MINUS) for place in {*chosen.tolist()}
        }
        cells.append([texts[place] for place in chosen])
        numbers.append([texts[place] if named else raw[place].item() for place in chosen])
    for array in values.values():
        picked = array.ravel()[order]
        cells.append(number_texts(picked, 4))
        numbers.append([value if math.isfinite(value) else "" for value in picked.tolist()])
    for array in flags.values():
        cells.append(array.ravel()[order].tolist())
        numbers.append(cells[-1])
    header = [head_of(one) for one in columns.values()]
    header += [name.replace("_", " ") for name in (*values, *flags)]
    units = ["" if one.dtype.kind not in "fiu" else unit_of(one) for one in columns.values()]
    units += [*(unit_of(result[name]) for name in values), *("" for _ in flags)]
    words = [i for i, one in enumerate(columns.values()) if one.dtype.kind not in "fiu"]
    words += range(len(columns) + len(values), len(header))
    end = "smallest" if least else "largest"
    by = leading.replace("_", " ")
    notes = [f"The {len(order):,} of {total:,} points with the {end} {by}; all are in the data set."]
    return (
        Table("All points", header, list(zip(*cells, strict=True)), words, notes * (total > len(order)), units),
        [list(row) for row in zip(*numbers, strict=True)],
    )

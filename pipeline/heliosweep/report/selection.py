"""What a figure shows of a result, and the words for it: nobody looks at ten thousand maps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import xarray as xr

from heliosweep.report.labels import (
    DEGREE,
    NO_BREAK_SPACE,
    SPEAKING,
    axis_label,
    is_latitude,
    shortened,
    title_of,
    value_text,
)

#: Position along some dimensions.
Point = Mapping[str, int]

#: Dimensions that are counted by their own name, not as values of something.
_COUNTED = ("heliostat", "module", "day", "hour", "declination", "date", "camera")


def evenly(length: int, most: int) -> list[int]:
    """At most `most` of `length` positions: the first, the last and evenly chosen ones between."""
    return sorted({round(place) for place in np.linspace(0, length - 1, min(length, most))})


def is_geometric(values: np.ndarray) -> bool:
    """Whether values have the same ratio over at least a decade: they are drawn by their logarithms."""
    if values.size < 3 or values.min() <= 0 or values.max() < 10 * values.min():
        return False
    ratios = np.diff(np.log(values))
    return bool(np.allclose(ratios, ratios[0], rtol=1e-4))


def at(array: xr.DataArray, *points: Point) -> xr.DataArray:
    """Part of an array at positions along those dimensions that it has, not yet read."""
    everything = {dim: index for point in points for dim, index in point.items()}
    return array.isel({dim: index for dim, index in everything.items() if dim in array.dims})


class Shown:
    """A result of which figures show parts; a family says with the attributes what is usual for its results.

    Parameters
    ----------
    result : xarray.Dataset
        The result; values are read as they are drawn.

    Attributes
    ----------
    titles : mapping of str to str
        Dimensions and coordinates in few words.
    labels : mapping of str to str
        Of axes, where name and unit do not do.
    typical : mapping of str to float or sequence
        Where a dimension stands that is not shown: the nearest number, or the first of some words that there is.
        Otherwise it is the middle of numbers, and the first of all else.
    not_swept : collection of str
        Dimensions that are no sweep.
    told : mapping of str to object
        Single coordinates that captions tell, and the value at which they are not worth it.
    longest : int
        Letters of a name that captions and titles use; longer ones are told by the key of the study.
    """

    titles: ClassVar[Mapping[str, str]] = {}
    labels: ClassVar[Mapping[str, str]] = {}
    typical: ClassVar[Mapping[str, Any]] = {}
    not_swept: ClassVar[frozenset[str]] = frozenset()
    told: ClassVar[Mapping[str, Any]] = {}
    longest: ClassVar[int] = 99

    def __init__(self, result: xr.Dataset) -> None:
        self.result = result

    def has(self, *names: str) -> bool:
        """Whether there are variables with something along each of their dimensions."""
        return all(name in self.result and all(self.result[name].shape) for name in names)

    def coordinate(self, dim: str) -> xr.DataArray:
        """Values along a dimension; the numbers 1, 2, ... where they are not told."""
        if dim in self.result.coords:
            return self.result[dim]
        return xr.DataArray(np.arange(1, self.result.sizes[dim] + 1), dims=dim, name=dim)

    def several(self, dim: str | None) -> bool:
        """Whether a dimension has more than one value."""
        return dim is not None and self.result.sizes.get(dim, 1) > 1

    def is_number(self, dim: str) -> bool:
        """Whether there are numbers along a dimension."""
        return dim in self.result.coords and self.result[dim].ndim == 1 and self.result[dim].dtype.kind in "fiu"

    def swept(self, quantity: str, *but: str | None) -> list[str]:
        """Swept dimensions of a variable that have more than one value, without some."""
        dims = [str(dim) for dim in self.result[quantity].dims if dim not in self.not_swept and dim not in but]
        return [dim for dim in dims if self.several(dim)]

    def numbers(self, quantity: str, *but: str | None) -> list[str]:
        """Those of the swept dimensions along which there are numbers."""
        return [dim for dim in self.swept(quantity, *but) if self.is_number(dim)]

    def order(self, dim: str) -> np.ndarray:
        """Positions along a dimension in the order of its numbers or dates."""
        coordinate = self.coordinate(dim)
        sortable = coordinate.ndim == 1 and coordinate.dtype.kind in "fiuM"
        return np.argsort(coordinate.to_numpy(), kind="stable") if sortable else np.arange(self.result.sizes[dim])

    def stand(self, dim: str) -> int:
        """Position of a dimension that is not shown."""
        if dim not in self.result.coords or self.result[dim].ndim != 1:
            return 0
        values, usual = self.result[dim].to_numpy(), self.typical.get(dim)
        if isinstance(usual, int | float) and self.is_number(dim):
            return int(np.argmin(np.abs(values.astype(float) - usual)))
        if isinstance(usual, Sequence):
            return next((list(values).index(word) for word in usual if word in values), 0)
        order = self.order(dim)
        return int(order[(order.size - 1) // 2]) if values.dtype.kind in "fiuM" else 0

    def fixed(self, quantity: str, *shown: str | None) -> dict[str, int]:
        """Positions of all dimensions of a variable that a figure does not show."""
        return {str(dim): self.stand(str(dim)) for dim in self.result[quantity].dims if dim not in shown}

    def chosen(self, dim: str | None, most: int, known: xr.DataArray | None = None) -> list[dict[str, int]]:
        """At most so many positions along a dimension, in the order of its values; one empty point without it.

        With `known`, only positions are chosen where that has a value.
        """
        if dim is None or dim not in self.result.sizes:
            return [{}]
        order = self.order(dim)
        if known is not None and dim in known.dims:
            order = order[known.notnull().any([other for other in known.dims if other != dim]).to_numpy()[order]]
        return [{dim: int(order[index])} for index in evenly(order.size, most)] if order.size else []

    def title(self, name: str) -> str:
        """Name of a dimension or coordinate in running text."""
        if name in self.titles:
            return self.titles[name]
        words = title_of(self.result[name]) if name in self.result.coords else ""
        return words if words and len(words) <= self.longest else name.replace("_", " ")

    def label(self, dim: str) -> str:
        """Label of an axis, always with a unit."""
        if dim in self.labels:
            return self.labels[dim]
        coordinate = self.coordinate(dim)
        if is_latitude(coordinate):
            return f"{self.title(dim)} ({DEGREE})"
        if coordinate.dtype.kind in "OU":
            return self.title(dim)
        words = axis_label(coordinate)
        return words if words.endswith(")") else f"{words} (1)"

    def value(self, dim: str, index: int) -> str:
        """One value with its unit."""
        if dim not in self.result.coords:
            return f"{dim.replace('_', ' ')} {index + 1}"
        value = self.result[dim].isel({dim: index} if self.result[dim].ndim else {})
        if value.dtype.kind == "M":
            return str(value.to_numpy().astype("datetime64[D]"))
        return shortened(value_text(value).replace("_", " "), index + 1)

    def full(self, dim: str, index: int) -> str:
        """One value with what it is."""
        value = self.value(dim, index)
        speaks = dim not in self.result.coords or self.result[dim].dtype.kind == "M" or dim in SPEAKING
        return value if speaks else f"{self.title(dim)} {value}"

    def values(self, point: Point) -> str:
        """Values at a point, such as the name of a line; empty for an empty point."""
        return ", ".join(self.value(dim, index) for dim, index in point.items())

    def fulls(self, point: Point) -> str:
        """Values at a point with what they are, such as the title of a panel; sites with their latitude."""
        words = ", ".join(self.full(dim, index) for dim, index in point.items())
        if "site" in point and "latitude" in self.result.coords:
            latitude = value_text(at(self.result["latitude"], point))
            words += f" ({latitude.replace(' ', NO_BREAK_SPACE)})"
        return words

    def heading(self, dim: str | None) -> str:
        """What distinguishes lines, above a legend; empty for words, which speak for themselves."""
        return self.title(dim) if dim and self.is_number(dim) else ""

    def note(self, stands: Point, *shown: Iterable[Point], unsaid: str = "") -> str:
        """Sentences for a caption: which of many values are shown, and at which values all else stands.

        Each of `shown` holds the points along one dimension; `unsaid` is a coordinate that does not matter.
        """
        parts = []
        for points in map(list, shown):
            for dim in points[0] if points else ():
                total = self.result.sizes[dim]
                counted = f"{dim}s" if dim in _COUNTED else f"values of {self.title(dim)}"
                parts += [f"{len(points)} of {total} {counted}"] if len(points) < total else []
        said = [f"Shown are {' and '.join(parts)}."] if parts else []
        held = [
            self.full(dim, index) + (f" (one of {self.result.sizes[dim]})" if self.several(dim) else "")
            for dim, index in stands.items()
            if self.several(dim) or dim in self.result.coords
        ]
        for name, plain in self.told.items():
            single = name in self.result.coords and not self.result[name].ndim
            if single and name != unsaid and self.result[name].item() != plain:
                held.append(self.full(name, 0))
        said += [f"Fixed: {', '.join(held)}."] if held else []
        return "".join(f" {sentence}" for sentence in said)

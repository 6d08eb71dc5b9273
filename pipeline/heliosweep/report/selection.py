"""Which points of a sweep are shown, and the words for it: nobody looks at ten thousand maps."""

from __future__ import annotations

import numpy as np
import xarray as xr

from heliosweep.report.labels import coordinate_text, title_of, value_text


def evenly(length: int, most: int) -> list[int]:
    """At most `most` of `length` positions: the first, the last and evenly chosen ones between."""
    return sorted({round(place) for place in np.linspace(0, length - 1, min(length, most))})


class Selection:
    """The parameter points of a result, and those that are shown.

    Parameters
    ----------
    result : xarray.Dataset
        The result.
    dims : tuple of str
        Its swept dimensions.
    rows : str
        Dimension that is compared within each figure, for instance ``tracking``; need not be swept.
    preferred : tuple of str
        Dimensions that figures rather run along than others.

    Attributes
    ----------
    column : str or None
        Dimension that figures run along: one of the preferred, else the first but `rows`.
    """

    def __init__(self, result: xr.Dataset, dims: tuple[str, ...], rows: str, preferred: tuple[str, ...]) -> None:
        self.result, self.dims, self.rows = result, dims, rows
        others = [dim for dim in dims if dim != rows]
        self.column = next((dim for dim in (*preferred, *others) if dim in others), None)

    def fixed(self, *shown: str | None) -> dict[str, int]:
        """First value of every dimension but `shown`."""
        return {dim: 0 for dim in self.dims if dim not in shown}

    def row_points(self) -> list[dict[str, int]]:
        """One point for each value of `rows`; a single empty one where it is not swept."""
        return [{self.rows: index} for index in range(self.result.sizes[self.rows])] if self.rows in self.dims else [{}]

    def columns(self, most: int) -> list[dict[str, int]]:
        """Points that figures run along, at most so many, with the first value of what else is swept."""
        fixed = self.fixed(self.rows, self.column)
        if self.column is None:
            return [fixed]
        return [{**fixed, self.column: index} for index in evenly(self.result.sizes[self.column], most)]

    def row_text(self, point: dict[str, int]) -> str:
        """Name of a row, also where it is the only one; empty where the result does not tell."""
        return self._text(self.rows, point)

    def column_text(self, point: dict[str, int]) -> str:
        """Name of a column; where nothing but `rows` is swept, the latitude that all share."""
        text = self._text(self.column or "latitude", point)
        if self.column != "site" or "latitude" not in self.result.coords:
            return text
        latitude = self._text("latitude", point).removeprefix("latitude ")
        return f"{text} ({latitude})" if latitude else text

    def note(self, *shown: str | None, most: int = 0) -> str:
        """Sentences for a caption: what was left out of the dimensions `shown`, at which values the others stand."""
        said = []
        total = self.result.sizes[self.column] if self.column else 0
        if self.column is not None and self.column in shown and most and total > most:
            said.append(f"Shown are {most} of {total} values of {title_of(self._coordinate(self.column))}.")
        fixed = self.fixed(*shown)
        if fixed:
            values = ", ".join(self._text(dim, fixed) for dim in fixed)
            said.append(f"Of what else is swept, the first value is shown: {values}.")
        return "".join(f" {sentence}" for sentence in said)

    def _coordinate(self, dim: str) -> xr.DataArray:
        """Coordinate of a dimension, or the numbers 1, 2, ... where it has none."""
        if dim in self.result.coords:
            return self.result[dim]
        return xr.DataArray(np.arange(1, self.result.sizes[dim] + 1), dims=dim, name=dim)

    def _text(self, name: str, point: dict[str, int]) -> str:
        if name not in self.result.coords and name not in self.result.sizes:
            return ""
        coordinate = self._coordinate(name)
        value = coordinate.isel({dim: index for dim, index in point.items() if dim in coordinate.dims})
        if value.ndim:
            return ""
        return value_text(value) if name == self.rows else coordinate_text(value)

"""Many small arrays of different shapes as one row of numbers: what a block of the grid hands back at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.backward_gazing.variables import DTYPES, Entry
from heliosweep.grid.evaluate import Output


class Row:
    """Places of the variables in a row.

    Parameters
    ----------
    entries : mapping of str to Entry
        Variables with their dimensions after the swept ones.
    sizes : mapping of str to int
        Lengths of these dimensions.
    """

    def __init__(self, entries: Mapping[str, Entry], sizes: Mapping[str, int]) -> None:
        self.entries, self._sizes = dict(entries), dict(sizes)
        self._places: dict[str, slice] = {}
        self.length = 0
        for name, (dims, _) in self.entries.items():
            count = math.prod(sizes[dim] for dim in dims)
            self._places[name] = slice(self.length, self.length + count)
            self.length += count

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a variable after the swept dimensions."""
        return tuple(self._sizes[dim] for dim in self.entries[name][0])

    def packed(self, values: Mapping[str, Any]) -> NDArray[np.float64]:
        """The row of some values, NaN for those that are missing; integers that are missing are 0."""
        row = np.full(self.length, np.nan)
        for name, place in self._places.items():
            if name in values:
                row[place] = np.broadcast_to(values[name], self.shape(name)).ravel()
            elif name in DTYPES:
                row[place] = 0.0
        return row

    def outputs(self) -> dict[str, Output]:
        """How `evaluate` cuts the variables out of rows, which stand along the last dimension of a block."""
        return {
            name: Output(
                attrs,
                partial(_cut, place=self._places[name], shape=self.shape(name), dtype=DTYPES.get(name, np.float64)),
                {dim: self._sizes[dim] for dim in dims},
                DTYPES.get(name, np.float64),
            )
            for name, (dims, attrs) in self.entries.items()
        }


def _cut(rows: NDArray[np.float64], place: slice, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    return rows[..., place].reshape((*rows.shape[:-1], *shape)).astype(dtype, copy=False)

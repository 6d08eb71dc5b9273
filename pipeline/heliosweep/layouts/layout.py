"""The positions of the heliostats of a field, in a fixed order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

MAX_HELIOSTATS = 1_000_000
"""Largest layout that is read or generated: ten times the largest field imaginable, still small in memory."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the heliostats of a field stand.

    The order is the order of the dimension ``heliostat`` in the result. All arrays are read-only copies.

    Parameters
    ----------
    x, y, z : array_like, shape (heliostat,)
        Base of each heliostat, towards east, north and up, from the base of the tower. [m]
    columns : mapping of str to array, optional
        What else is known of each heliostat (its ring, its name): float64, int64 or str arrays that become
        coordinates of the result.
    name : str, optional
        Name of the file, as the user gave it, or of the generator.
    lines : array_like of int, shape (heliostat,), optional
        Line of each heliostat in the file, counted from 1; None for a generated layout.

    Raises
    ------
    ValueError
        If the arrays differ in length or are not one-dimensional.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]
    columns: Mapping[str, NDArray] = field(default_factory=dict)
    name: str = ""
    lines: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        """Take read-only copies."""

        def frozen(key: str, values: object, dtype: type | None = None) -> NDArray:
            array = np.array(values, dtype)
            if array.shape != shape:
                raise ValueError(f"{key} has shape {array.shape}, not {shape} as x")
            array.flags.writeable = False
            return array

        shape = (np.size(self.x),)
        for axis in ("x", "y", "z"):
            object.__setattr__(self, axis, frozen(axis, getattr(self, axis), np.float64))
        columns = {key: frozen(key, values) for key, values in self.columns.items()}
        object.__setattr__(self, "columns", columns)
        if self.lines is not None:
            object.__setattr__(self, "lines", frozen("lines", self.lines, np.int64))

    def __len__(self) -> int:
        """Return the number of heliostats."""
        return self.x.size

    def where(self, row: int) -> str:
        """Return the name of a heliostat in messages: its index, counted from 0, and its line if known."""
        return f"heliostat {row}" if self.lines is None else f"heliostat {row} (line {self.lines[row]})"

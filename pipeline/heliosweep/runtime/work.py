"""What an engine takes and what it gives back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from heliosweep.grid.slabs import Part

if TYPE_CHECKING:
    import xarray as xr

#: How often a part is tried before it counts as failed.
TRIES = 3


@dataclass(frozen=True)
class Work:
    """A part to compute.

    Parameters
    ----------
    part : Part
        Which one.
    lazy : xarray.Dataset
        Its variables, lazy, without coordinates.
    """

    part: Part
    lazy: xr.Dataset


@dataclass(frozen=True)
class Outcome:
    """What became of a part.

    Parameters
    ----------
    part : Part
        Which one.
    values : dict of str to numpy.ndarray, optional
        Values of its variables; None where it failed.
    error : Exception, optional
        Why it failed, after three tries.
    """

    part: Part
    values: dict[str, np.ndarray] | None
    error: Exception | None = None


class Engine(Protocol):
    """Computes parts."""

    def run(self, works: Iterator[Work]) -> Iterator[Outcome]:
        """Compute all `works`, pulled as there is room; outcomes come in any order."""

"""Values to sweep over: a list, an even range or a geometric range, never expanded before someone asks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:  # it takes longer to import than reading a study
    from numpy.typing import NDArray

_EXACT = 2**53  # integers up to here are exact in a float64


class Sweep:
    """An ordered set of different values for one parameter.

    ``len(sweep)``, ``sweep[i]``, ``sweep[i:j]``, ``sweep.first`` and ``sweep.last`` never expand the whole,
    so a range may have any number of points.
    """

    def __len__(self) -> int:
        """Return the number of values."""
        raise NotImplementedError

    def at(self, index: NDArray[np.int64]) -> NDArray[Any]:
        """Return the values at the given positions (0 to ``len(self) - 1``), as an array of the same shape."""
        raise NotImplementedError

    def spec(self) -> list[float | str] | dict[str, Any]:
        """Return the compact form, as plain data that a study file may hold."""
        raise NotImplementedError

    def __getitem__(self, index: int | slice) -> Any:
        """Return one value (float or str), or an array of values for a slice."""
        if isinstance(index, slice):
            return self.at(np.arange(*index.indices(len(self))))
        if not -len(self) <= index < len(self):
            raise IndexError(f"position {index} of a sweep of {len(self)}")
        return self.at(np.array([index % len(self)]))[0].item()

    @property
    def first(self) -> Any:
        """The first value."""
        return self[0]

    @property
    def last(self) -> Any:
        """The last value."""
        return self[-1]

    def values(self) -> Any:
        """Return all values: an array of float64, or a tuple of str. Expands the sweep."""
        return self[:]


@dataclass(frozen=True)
class Listed(Sweep):
    """Values written out one by one: numbers, or names."""

    items: tuple[float, ...] | tuple[str, ...]

    def __len__(self) -> int:
        """Return the number of values."""
        return len(self.items)

    def at(self, index: NDArray[np.int64]) -> NDArray[Any]:
        """Return the values at the given positions, as an array of the same shape."""
        return np.array(self.items, dtype=object if self.holds_names else float)[index]

    def __getitem__(self, index: int | slice) -> Any:
        """Return one value; for a slice an array of numbers or a tuple of names."""
        if isinstance(index, slice) and not self.holds_names:
            return np.array(self.items[index], dtype=float)
        return self.items[index]

    def spec(self) -> list[float | str]:
        """Return the values as a list."""
        return list(self.items)

    @property
    def holds_names(self) -> bool:
        """True where the values are text and not numbers."""
        return isinstance(self.items[0], str)


def ends(value: Any) -> tuple[Any, ...]:
    """A value, all of a list, or both ends of a range, which is monotonic."""
    if not isinstance(value, Sweep):
        return (value,)
    return tuple(value[:]) if isinstance(value, Listed) else (value.first, value.last)


@dataclass(frozen=True)
class Range(Sweep):
    """`num` evenly spaced values from `start` to `stop`, both included.

    The values are those of exact decimal arithmetic, rounded once: 8 to 16 in 41 points has 8.6, not
    8.600000000000001.

    Parameters
    ----------
    start, stop : float
        First and last value.
    num : int
        Number of values.
    limit : float, optional
        The stop as written, where no step leads there; None elsewhere. Not part of the range's identity.
    """

    start: float
    stop: float
    num: int
    limit: float | None = field(default=None, compare=False, repr=False)

    def __len__(self) -> int:
        """Return the number of values."""
        return self.num

    @property
    def step(self) -> float:
        """Distance between neighbours; 0 for a single value."""
        return float(_fraction(self.stop) - _fraction(self.start)) / max(self.num - 1, 1)

    def midpoints(self) -> Range:
        """Return the middles of the steps, one value fewer."""
        half = (_fraction(self.stop) - _fraction(self.start)) / (self.num - 1) / 2
        return Range(float(_fraction(self.start) + half), float(_fraction(self.stop) - half), self.num - 1)

    @cached_property
    def _grid(self) -> tuple[int, int, int] | None:
        """Integers a, b, q with value i = (a + i b) / q, if they fit into floats without rounding."""
        start, stop = _fraction(self.start), _fraction(self.stop)
        step = (stop - start) / max(self.num - 1, 1)
        q = math.lcm(start.denominator, step.denominator)
        a, b = int(start * q), int(step * q)
        fits = max(q, abs(a), abs(a + b * (self.num - 1)), abs(b) * self.num) < _EXACT
        return (a, b, q) if fits else None

    def at(self, index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the values at the given positions, as an array of the same shape."""
        if self._grid is not None:
            a, b, q = self._grid
            return (a + index * b) / q
        values = self.start + index * self.step
        return np.where(index == self.num - 1, self.stop, values)

    def spec(self) -> dict[str, Any]:
        """Return the range as ``{start, stop, num}``, whichever way it was written."""
        return {"start": self.start, "stop": self.stop, "num": self.num}


@dataclass(frozen=True)
class Geometric(Sweep):
    """`num` values from `start` to `stop`, both included, each in the same ratio to the one before."""

    start: float
    stop: float
    num: int

    def __len__(self) -> int:
        """Return the number of values."""
        return self.num

    def at(self, index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the values at the given positions, as an array of the same shape."""
        low, high = math.log10(abs(self.start)), math.log10(abs(self.stop))
        exponents = low + index * ((high - low) / max(self.num - 1, 1))
        values = math.copysign(1.0, self.start) * 10.0**exponents
        values = np.where(index == 0, self.start, values)
        return np.where(index == self.num - 1, self.stop, values)

    def spec(self) -> dict[str, Any]:
        """Return the range as ``{logspace: {start, stop, num}}``."""
        return {"logspace": {"start": self.start, "stop": self.stop, "num": self.num}}


def _fraction(number: float) -> Fraction:
    """Return the shortest decimal that stands for a float, exactly: 0.1 is 1/10."""
    return Fraction(repr(number))

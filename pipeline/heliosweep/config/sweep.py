"""Values to sweep over: a list, an even range or a geometric range, never expanded before someone asks.

They are written as a list ``[0, 15, 30]``, a range ``{start, stop, step}`` or ``{start, stop, num}``, or a geometric
range ``{logspace: {start, stop, num}}``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from heliosweep.config.faults import MAX_FAULTS, Fault, Faults, Invalid, did_you_mean, each, nearest

if TYPE_CHECKING:  # it takes longer to import than reading a study
    from numpy.typing import NDArray

MAX_POINTS = 10**15
_FORMS = "a range is {start, stop, step}, {start, stop, num} or {logspace: {start, stop, num}}"
_TOO_FINE = "the steps are finer than the precision of numbers"
_PRECISION = 2.0**-52
_ON_STEP = Decimal("1e-9")  # a stop this near to the last step, in steps, falls on it
_EXACT = 2**53  # integers up to here are exact in a float64

ReadNumber = Callable[[Any], float]

Number: TypeAlias = float | str
"""A number in the canonical unit of its key, or text with a unit such as ``"1.2 mrad"``."""

Swept: TypeAlias = "dict[str, Number | dict[str, Number]]"
"""Swept values as plain data, as in a study file; a list is one as it is."""


class Sweep:
    """An ordered set of different values for one parameter.

    ``len(sweep)``, ``sweep[i]``, ``sweep[i:j]``, ``sweep.first`` and ``sweep.last`` never expand the whole,
    so a range may have any number of points.
    """

    def __len__(self) -> int:
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

    def ends(self) -> tuple[Any, ...]:
        """Return values between which all others are."""
        return self.first, self.last


@dataclass(frozen=True)
class Listed(Sweep):
    """Values written out one by one: numbers, or names."""

    items: tuple[float, ...] | tuple[str, ...]

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, index: int | slice) -> Any:
        """Return one value; for a slice an array of numbers or a tuple of names."""
        if isinstance(index, slice) and not self.holds_names:
            return np.array(self.items[index], dtype=float)
        return self.items[index]

    def ends(self) -> tuple[Any, ...]:
        """Return all values."""
        return tuple(self[:])

    def spec(self) -> list[float | str]:
        """Return the values as a list."""
        return list(self.items)

    @property
    def holds_names(self) -> bool:
        """True where the values are text and not numbers."""
        return isinstance(self.items[0], str)


def ends(value: Any) -> tuple[Any, ...]:
    """A value, all of a list, both ends of a range, which is monotonic, or of a distribution."""
    return value.ends() if isinstance(value, Sweep) else (value,)


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


def read_sweep(raw: Sequence[Any] | Mapping[str, Any], number: ReadNumber, repeats: bool = False) -> Sweep:
    """Read swept numbers from any of their forms; `number` reads one. Raises Invalid with each fault at its key."""
    if not isinstance(raw, Mapping):
        return Listed(read_items(raw, number, repeats))
    if "logspace" not in raw:
        return _read_range(raw, number)
    if len(raw) > 1:
        raise Invalid(Fault("'logspace' cannot be mixed with other keys", show_value=False))
    return read_parts(raw, {"logspace": lambda inner: _read_logspace(inner, number)}, Faults())["logspace"]


#: Message for a list with equal values.
TWICE = "the same value stands in the list twice"


def read_items(raw: Sequence[Any], read: Callable[[Any], Any], repeats: bool = False) -> tuple[Any, ...]:
    """Read the entries of a list that is not empty; without `repeats`, no value may be there twice. Raises Invalid."""
    if not raw:
        raise Invalid(Fault("the list is empty: give at least one value", show_value=False))
    known = set()

    def another(entry: Any) -> Any:
        value = read(entry)
        if value in known and not repeats:
            raise Invalid(TWICE)
        known.add(value)
        return value

    return tuple(each(raw, another))


def _read_range(raw: Mapping[str, Any], number: ReadNumber) -> Range:
    faults = key_faults(raw, ("start", "stop", "step", "num"), ("start", "stop"), _FORMS)
    if "step" in raw and "num" in raw:
        faults.append(Fault("give 'step' or 'num', not both", ("num",), show_value=False))
    elif not faults and "step" not in raw and "num" not in raw:
        faults.append(Fault("a range needs 'step' or 'num' beside 'start' and 'stop'", show_value=False))
    values = read_parts(raw, {"start": number, "stop": number, "step": number, "num": _count}, faults)
    start, stop = values["start"], values["stop"]
    if "num" in values:
        num, limit, part = values["num"], None, "num"
        if num == 1 and start != stop:
            raise Invalid(Fault("must be at least 2 where start and stop differ", ("num",)))
    else:
        num, stop, limit = _stepped(start, stop, values["step"])
        part = "step"
    if num > 1 and start == stop:
        raise Invalid(Fault("must differ from start where there is more than one value", ("stop",)))
    if num > 1 and abs(stop - start) / (num - 1) < math.ulp(max(abs(start), abs(stop))):
        raise Invalid(Fault(_TOO_FINE, (part,)))
    return Range(start, stop, num, limit)


def _stepped(start: float, stop: float, step: float) -> tuple[int, float, float | None]:
    """Return the number of values, the last one, and the stop as written where it is not the last one."""
    if step == 0:
        raise Invalid(Fault("must not be zero", ("step",)))
    exact_start, exact_step = Decimal(repr(start)), Decimal(repr(step))
    steps = (Decimal(repr(stop)) - exact_start) / exact_step
    if steps < 0:
        sign = "positive" if stop > start else "negative"
        raise Invalid(Fault(f"has the wrong sign: from {start:.12g} to {stop:.12g} it must be {sign}", ("step",)))
    if steps >= MAX_POINTS:
        raise Invalid(Fault(f"gives more than {MAX_POINTS:.0e} values; is the step too small?", ("step",)))
    whole = int(steps + _ON_STEP)
    if abs(steps - whole) <= _ON_STEP:
        return whole + 1, stop, None
    return whole + 1, float(exact_start + whole * exact_step), stop


def _read_logspace(raw: Any, number: ReadNumber) -> Geometric:
    if not isinstance(raw, Mapping):
        raise Invalid("must be a mapping {start, stop, num}")
    readers = {"start": number, "stop": number, "num": _count}
    values = read_parts(raw, readers, key_faults(raw, tuple(readers), tuple(readers), "it is {start, stop, num}"))
    start, stop, num = values["start"], values["stop"], values["num"]
    faults = Faults(Fault("must not be zero", (key,)) for key in ("start", "stop") if values[key] == 0)
    if not faults and (start < 0) != (stop < 0):
        faults.append(Fault("must have the sign of start", ("stop",)))
    if (num == 1) != (start == stop):
        needed = "at least 2 where start and stop differ" if num == 1 else "1 where they are equal"
        faults.append(Fault(f"must be {needed}", ("num",)))
    if not faults and num > 1 and abs(math.log(stop / start)) / (num - 1) < 2 * _PRECISION:
        faults.append(Fault(_TOO_FINE, ("num",)))
    faults.check()
    return Geometric(start, stop, num)


def key_faults(raw: Mapping[str, Any], known: Sequence[str], required: Sequence[str], form: str) -> Faults:
    """Return what is wrong with the keys of a mapping: unknown ones, and required ones that are missing.

    `form` tells how the mapping is written, for the message.
    """
    unknown = [str(key) for key in raw if key not in known][:MAX_FAULTS]
    faults = Faults(Fault(f"unknown key{did_you_mean(key, known)}", (key,), show_value=False) for key in unknown)
    meant = [nearest(key, known) for key in unknown]
    missing = [f"'{key}'" for key in required if key not in raw and key not in meant]
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        faults.append(Fault(f"{' and '.join(missing)} {verb} missing: {form}", show_value=False))
    return faults


def read_parts(raw: Mapping[str, Any], readers: Mapping[str, Callable[[Any], Any]], faults: Faults) -> dict[str, Any]:
    """Read the parts of a mapping that are there; raise Invalid with `faults` and all that are found on the way."""
    values: dict[str, Any] = {}
    for key in (key for key in readers if key in raw):
        with faults.under(key):
            values[key] = readers[key](raw[key])
    faults.check()
    return values


def read_whole(raw: Any, least: int, most: int) -> int:
    """Read a whole number. Raises Invalid."""
    if isinstance(raw, bool) or not isinstance(raw, int | float) or raw % 1 != 0:
        raise Invalid("must be a whole number")
    if not least <= raw <= most:
        raise Invalid(f"must be between {least} and {most}")
    return int(raw)


def _count(raw: Any) -> int:
    return read_whole(raw, 1, MAX_POINTS)


def sweep(start: Number, stop: Number, *, step: Number | None = None, num: int | None = None) -> Swept:
    """Evenly spaced values of a swept key, both ends included where they fall on the step.

    Parameters
    ----------
    start, stop : float or str
        First and last value, in the unit of the key, or with a unit (``"38 ft"``).
    step : float or str, optional
        Distance between values.
    num : int, optional
        Number of values, instead of `step`.

    Returns
    -------
    dict
        ``{start, stop, step}`` or ``{start, stop, num}``, which `study` checks where it stands.

    Examples
    --------
    >>> sweep(0, 60, step=15)
    {'start': 0, 'stop': 60, 'step': 15}
    """
    parts = {"start": start, "stop": stop, "step": step, "num": num}
    return {key: value for key, value in parts.items() if value is not None}


def logspace(start: Number, stop: Number, num: int) -> Swept:
    """Values of a swept key, each in the same ratio to the one before, both ends included.

    Parameters
    ----------
    start, stop : float or str
        First and last value, of one sign, in the unit of the key or with a unit; not exponents: as numpy.geomspace.
    num : int
        Number of values.

    Returns
    -------
    dict
        ``{logspace: {start, stop, num}}``, which `study` checks where it stands.
    """
    return {"logspace": {"start": start, "stop": stop, "num": num}}

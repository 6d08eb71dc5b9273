"""Read, check and describe the values in a study file, including units and sweeps.

Swept values are written as a list ``[0, 15, 30]``, a range ``{start, stop, step}`` or ``{start, stop, num}``, a
geometric range ``{logspace: {start, stop, num}}``, or a distribution ``{normal: [11, 0.02]}``.

The annotation of a field declares the kind of its value::

    latitude: Annotated[float | Sweep, Quantity("Latitude, positive north", "deg", ge=-90, le=90)]
    tracking: Annotated[str | Sweep, Choice("Mount of the mirrors", ("spinning_elevation", ...))]
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, cast

import numpy as np
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from heliosweep.config.faults import (
    COUNTS,
    MAX_FAULTS,
    SYNONYMS,
    Fault,
    Invalid,
    collect,
    did_you_mean,
    each,
    nearest,
    one_of,
    require,
    to_pydantic,
)
from heliosweep.lazy import scipy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.config.sample import Design


#: Maximum number of values in a sweep.
MAX_POINTS = 10**6
_FORMS = "a range is {start, stop, step}, {start, stop, num} or {logspace: {start, stop, num}}"
_ON_STEP = Fraction("1e-9")  # maximum distance from the last step to `stop` that is treated as rounding error [steps]
#: Message for a list with duplicate values.
TWICE = "the list contains the same value twice"
ReadNumber = Callable[[Any], float]
#: A number in the canonical unit of the key, or a string with a unit such as ``"1.2 mrad"``.
Number: TypeAlias = float | str
#: Range of swept values, as plain data for a study file.
Swept: TypeAlias = "dict[str, Number | dict[str, Number]]"


class Sweep:
    """Ordered values of a swept key: an array of numbers, or a tuple of names.

    Parameters
    ----------
    values : sequence of float or of str
        Values of the key.
    form : dict, optional
        Compact form of a range, ``{start, stop, num}`` or ``{logspace: {start, stop, num}}``; None for a list.
    reaches : bool
        False if the last value is not the `stop` specified by the user.
    """

    def __init__(self, values: Any, form: dict[str, Any] | None = None, *, reaches: bool = True) -> None:
        named = len(values) > 0 and isinstance(values[0], str)
        self._values: Any = tuple(values) if named else np.asarray(values, dtype=float)
        self.form, self.reaches = form, reaches

    def __len__(self) -> int:
        return len(self._values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sweep) and self.spec() == other.spec()

    def __hash__(self) -> int:
        return hash(str(self.spec()))

    def __getitem__(self, index: int | slice) -> Any:
        """Return a float or str for an index, and an array of numbers or a tuple of names for a slice."""
        found = self.values()[index]
        return found if isinstance(index, slice) or isinstance(found, str) else float(found)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.spec()})"

    def values(self) -> Any:
        """Return all values: an array of float64, shape (n,), or a tuple of str."""
        return self._values

    def items(self) -> tuple[Any, ...]:
        """Return all values as a tuple of float or of str."""
        values = self.values()
        return values if isinstance(values, tuple) else tuple(values.tolist())

    def ends(self) -> tuple[Any, ...]:
        """Return all values of a list, or both ends of a (monotonic) range."""
        return self.items() if self.form is None else (self[0], self[-1])

    def spec(self) -> list[Any] | dict[str, Any]:
        """Return the sweep as plain data for a study file, in the compact form for a range."""
        return list(self.items()) if self.form is None else self.form


def ends(value: Any) -> tuple[Any, ...]:
    """Return a single value, all values of a list, or both ends of a range or a distribution."""
    return value.ends() if isinstance(value, Sweep) else (value,)


def even_range(start: float, stop: float, num: int, *, reaches: bool = True) -> Sweep:
    """Return `num` evenly spaced values from `start` to `stop`, including both.

    Values are computed exactly and rounded once, unless they have too many digits for exact float64 arithmetic. For
    example, 41 values from 8 to 16 include 8.6, not 8.600000000000001.
    """
    first, last = _fraction(start), _fraction(stop)
    step = (last - first) / max(num - 1, 1)
    divisor = math.lcm(first.denominator, step.denominator)
    a, b = int(first * divisor), int(step * divisor)
    index = np.arange(num)
    if max(divisor, abs(a), abs(a + b * (num - 1)), abs(b) * num) < 2**53:  # exact in float64 arithmetic
        values: Any = (a + index * b) / divisor
    else:
        values = start + index * (float(last - first) / max(num - 1, 1))
        values[-1] = stop
    return Sweep(values, {"start": start, "stop": stop, "num": num}, reaches=reaches)


def midpoints(sweep: Sweep) -> Sweep:
    """Return the midpoints of the steps of an evenly spaced range."""
    steps = len(sweep) - 1
    half = (_fraction(sweep[-1]) - _fraction(sweep[0])) / steps / 2
    return even_range(float(_fraction(sweep[0]) + half), float(_fraction(sweep[-1]) - half), steps)


def as_range(sweep: Sweep) -> Sweep:
    """Convert a list of evenly spaced numbers to the equivalent range. Other sweeps are not changed."""
    if sweep.form is not None or isinstance(sweep[0], str):
        return sweep
    same = even_range(sweep[0], sweep[-1], len(sweep))
    return same if np.array_equal(same.values(), sweep.values()) else sweep


def _fraction(number: float) -> Fraction:
    """Convert the shortest decimal representation of a float to an exact fraction: 0.1 becomes 1/10."""
    return Fraction(repr(number))


def read_items(raw: Sequence[Any], read: Callable[[Any], Any], repeats: bool = False) -> tuple[Any, ...]:
    """Read the entries of a non-empty list. The entries must be different unless `repeats` is True. Raises Invalid."""
    require(raw, "the list is empty: give at least one value", show_value=False)
    values, first = tuple(each(raw, read)), dict[Any, int]()
    if again := [at for at, value in enumerate(values) if first.setdefault(value, at) != at and not repeats]:
        raise Invalid(Fault(TWICE, (at,)) for at in again[: MAX_FAULTS + 1])
    return values


def read_range(raw: Any, number: ReadNumber, geometric: bool = False) -> Sweep:
    """Read a range. `number` converts a single number. Raises Invalid, with one fault for each invalid key."""
    if not geometric and "logspace" in raw:
        inner = {"logspace": partial(read_range, number=number, geometric=True)}
        return cast("Sweep", read_mapping(raw, inner, ("logspace",), _FORMS)["logspace"])
    counts: dict[str, Callable[[Any], Any]] = {"step": number} if not geometric else {}
    counts["num"] = Quantity("", "1", ge=1, le=MAX_POINTS, integer=True, sweep=False).read
    readers = {"start": number, "stop": number, **counts}
    values = read_mapping(raw, readers, ("start", "stop"), _FORMS, exactly=tuple(counts))
    start, stop, num, reaches = values["start"], values["stop"], values.get("num"), True
    if geometric and 0 in (start, stop):
        raise Invalid([Fault("must not be zero", (key,)) for key in ("start", "stop") if values[key] == 0])
    require(not geometric or (start < 0) == (stop < 0), "must have the same sign as start", "stop")
    if num is None:
        require(values["step"] != 0, "must not be zero", "step")
        begin, step = _fraction(start), _fraction(values["step"])
        steps, sign = (_fraction(stop) - begin) / step, "positive" if stop > start else "negative"
        require(steps >= 0, f"has the wrong sign: from {start:.12g} to {stop:.12g} it must be {sign}", "step")
        many = f"results in more than {MAX_POINTS:,} values: check that the step is not too small"
        require(steps < MAX_POINTS, many, "step")
        num = int(steps + _ON_STEP) + 1
        reaches = abs(steps - (num - 1)) <= _ON_STEP
        stop = stop if reaches else float(begin + (num - 1) * step)
    else:
        require(num > 1 or start == stop, "must be at least 2 if start and stop differ", "num")
    if num > 1:
        require(start != stop, "must differ from start if there is more than one value", "stop")
        fine = abs(stop - start) / (num - 1) < math.ulp(max(abs(start), abs(stop)))
        require(not fine, "the steps are smaller than the floating-point precision", *(counts.keys() & raw.keys()))
    if not geometric:
        return even_range(start, stop, num, reaches=reaches)
    low, high = math.log10(abs(start)), math.log10(abs(stop))
    series = math.copysign(1.0, start) * 10.0 ** (low + np.arange(num) * ((high - low) / max(num - 1, 1)))
    series[-1], series[0] = stop, start
    return Sweep(series, {"logspace": {"start": start, "stop": stop, "num": num}})


def read_mapping(
    raw: Any,
    readers: Mapping[str, Callable[[Any], Any]],
    required: Sequence[str],
    form: str,
    *,
    exactly: Sequence[str] = (),
) -> dict[str, Any]:
    """Read a mapping that may contain only known keys.

    Parameters
    ----------
    raw : mapping
        Mapping in the study file.
    readers : mapping of str to callable
        Function for each known key that returns its value or raises Invalid.
    required, exactly : sequence of str
        Required keys, and mutually exclusive keys, exactly one of which is required.
    form : str
        Description of the mapping in messages.

    Raises
    ------
    Invalid
        If a key is unknown or missing, or if a value is invalid. Each fault is located at its key.
    """
    require(isinstance(raw, Mapping), f"must be a mapping: {form}")
    faults, meant = list[Fault](), set[str | None]()
    for key in [str(key) for key in raw if key not in readers][:MAX_FAULTS]:
        meant.add(nearest(key, readers))
        faults.append(Fault(f"unknown key{did_you_mean(key, readers) or f'; {form}'}", (key,), show_value=False))
    missing, given = [key for key in required if key not in {*raw, *meant}], [key for key in exactly if key in raw]
    if missing:
        words = " and ".join(f"'{key}'" for key in missing) + (" is" if len(missing) == 1 else " are")
        faults.append(Fault(f"{words} missing: {form}", show_value=False))
    faults += (Fault(f"give only one of {', '.join(exactly)}", (key,), show_value=False) for key in given[1:])
    if exactly and not given and not faults:
        faults.append(Fault(f"{one_of(exactly)} is missing: {form}", show_value=False))
    known = [key for key in readers if key in raw]
    return dict(zip(known, collect((((key,), partial(readers[key], raw[key])) for key in known), faults), strict=True))


def sweep(start: Number, stop: Number, *, step: Number | None = None, num: int | None = None) -> Swept:
    """Return evenly spaced values for a swept key.

    The value `stop` is included if it falls on a step.

    Parameters
    ----------
    start, stop : float or str
        First and last values: numbers in the unit of the key, or strings with a unit (``"38 ft"``).
    step : float or str, optional
        Distance between successive values.
    num : int, optional
        Number of values, instead of `step`.

    Returns
    -------
    dict
        Range ``{start, stop, step}`` or ``{start, stop, num}``, which `study` checks.

    Examples
    --------
    >>> sweep(0, 60, step=15)
    {'start': 0, 'stop': 60, 'step': 15}
    """
    parts = {"start": start, "stop": stop, "step": step, "num": num}
    return {key: value for key, value in parts.items() if value is not None}


def logspace(start: Number, stop: Number, num: int) -> Swept:
    """Return values of a geometric series for a swept key, including both ends.

    Parameters
    ----------
    start, stop : float or str
        First and last values with the same sign: numbers in the unit of the key, or strings with a unit. Both are
        values, not exponents, as in numpy.geomspace.
    num : int
        Number of values.

    Returns
    -------
    dict
        Geometric range ``{logspace: {start, stop, num}}``, which `study` checks.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.logspace(1, 100, 3)
    {'logspace': {'start': 1, 'stop': 100, 'num': 3}}
    """
    return {"logspace": {"start": start, "stop": stop, "num": num}}


NORMAL, TRUNCATED, UNIFORM = "normal", "truncated_normal", "uniform"
TRIANGULAR, LOGNORMAL, DISCRETE = "triangular", "lognormal", "discrete"
#: Names of the parameters of each distribution.
PARTS = {
    NORMAL: ("mean", "standard deviation"),
    TRUNCATED: ("mean", "standard deviation", "least", "largest"),
    UNIFORM: ("least", "largest"),
    TRIANGULAR: ("least", "most likely", "largest"),
    LOGNORMAL: ("median", "standard deviation of the natural logarithm"),
}
KINDS = (*PARTS, DISCRETE)
RANGE_KEYS = ("start", "stop", "step", "num", "logspace")
#: Minimum distance of the probability of a draw from 0 and 1: half a step of the 30-bit sequences. [1]
LEAST = 2.0**-31
#: Maximum probability outside the bounds of a key for which a normal distribution is truncated to the bounds. [1]
CUT = 1e-6


class Drawn(Sweep):
    """Values of a drawn key along the ``sample`` dimension.

    Until a design is assigned, `values` returns only the minimum and the maximum of the draws, or all names.

    Parameters
    ----------
    kind : str
        One of the distributions in `PARTS`, or ``discrete``.
    parts : tuple of float
        Distribution parameters in the order of `PARTS` and in the canonical unit of the key. For ``discrete``, the
        numbers or names to draw from.
    weights : tuple of float
        Probability of each value, for ``discrete`` only.
    cut : float
        Probability outside the bounds of the key before truncation of a normal distribution.
    """

    def __init__(self, kind: str, parts: tuple[Any, ...], weights: tuple[float, ...] = (), cut: float = 0.0) -> None:
        super().__init__(parts)
        self.kind, self.parts, self.weights, self.cut = kind, parts, weights, cut
        self.design: Design | None = None
        self.column, self._are_draws = 0, False
        self.form = self.spec()

    def __len__(self) -> int:
        return len(self.ends()) if self.design is None else len(self.design)

    def values(self) -> Any:
        """Return the values of all draws: an array of float64, or a tuple of str."""
        if self.design is None:
            return Sweep(self.ends()).values()
        if not self._are_draws:
            values = self.quantile(self.design.points()[:, self.column])
            self._values, self._are_draws = (tuple(values) if values.dtype == object else values), True
        return self._values

    def ends(self) -> tuple[Any, ...]:
        """Return the minimum and maximum of the draws, or all names."""
        if self.kind == DISCRETE and isinstance(self.parts[0], str):
            return self.parts
        if self.kind not in (NORMAL, LOGNORMAL):
            own = self.parts[2:] if self.kind == TRUNCATED else self.parts
            return min(own), max(own)
        # `LEAST` limits a draw to 6.121 standard deviations from the mean
        first, reach = self.parts[0], self.parts[1] * 6.121
        return (
            (first - reach, first + reach)
            if self.kind == NORMAL
            else (first * math.exp(-reach), first * math.exp(reach))
        )

    def outside(self, low: float, high: float) -> float:
        """Return the probability that a (log)normal value is below `low` or above `high`; 0 for other distributions."""
        if self.kind not in (NORMAL, LOGNORMAL):
            return 0.0
        mean, deviation = self.parts
        if self.kind == LOGNORMAL:
            mean, low, high = (math.log(value) if value > 0 else -math.inf for value in (mean, low, high))
        tails = (0.5 * math.erfc(sign * (mean - bound) / deviation / math.sqrt(2))
                 for sign, bound in ((1, low), (-1, high)))  # fmt: skip
        return sum(mass for mass in tails if mass > LEAST)

    def quantile(self, probability: NDArray[np.float64]) -> NDArray[Any]:
        """Return the quantiles at the given probabilities. Names are ordered as in the study file."""
        if self.kind == DISCRETE:
            values = np.array(self.parts, object if isinstance(self.parts[0], str) else float)
            return values[np.searchsorted(np.cumsum(self.weights)[:-1], probability, side="right")]
        stats, (a, b, *limits) = scipy.stats, self.parts
        distributions: dict[str, Callable[[], Any]] = {
            NORMAL: lambda: stats.norm(a, b),
            TRUNCATED: lambda: stats.truncnorm(*((limit - a) / b for limit in limits), a, b),
            UNIFORM: lambda: stats.uniform(a, b - a),
            TRIANGULAR: lambda: stats.triang((b - a) / (limits[0] - a), a, limits[0] - a),
            LOGNORMAL: lambda: stats.lognorm(b, scale=a),
        }
        return np.clip(distributions[self.kind]().ppf(probability), *self.ends())

    def spec(self) -> dict[str, Any]:
        """Return the distribution as plain data for a study file."""
        if self.kind == DISCRETE:
            return {DISCRETE: {"values": list(self.parts), "weights": list(self.weights)}}
        return {self.kind: list(self.parts)}

    def words(self) -> str:
        """Return the distribution as text: ``normal: mean 11, standard deviation 0.02``."""
        if self.kind == DISCRETE:
            names = [value.replace("_", " ") if isinstance(value, str) else f"{value:g}" for value in self.parts]
            shares = (f"{name} ({weight:.3g})" for name, weight in zip(names, self.weights, strict=True))
            return f"{DISCRETE}: {', '.join(shares)}"
        named = (f"{name} {value:g}" for name, value in zip(PARTS[self.kind], self.parts, strict=True))
        return f"{self.kind.replace('_', ' ')}: {', '.join(named)}"


#: Checks of distribution parameters: the distributions, the condition, the index of the invalid parameter, the message.
_CHECKS: tuple[tuple[tuple[str, ...], Callable[[Sequence[float]], bool], int, str], ...] = (
    ((LOGNORMAL,), lambda v: v[0] > 0, 0, "the median must be greater than 0"),
    ((LOGNORMAL,), lambda v: v[1] <= 10, 1, "the standard deviation of the natural logarithm must be at most 10"),
    ((UNIFORM, TRIANGULAR), lambda v: v[0] < v[-1], 0, "the minimum must be less than the maximum"),
    ((TRUNCATED,), lambda v: v[2] < v[3], 2, "the minimum must be less than the maximum"),
    (
        (TRIANGULAR,),
        lambda v: v[0] <= v[1] <= v[2],
        1,
        "the most likely value must be between the minimum and the maximum",
    ),
    (
        (TRUNCATED,),
        lambda v: max(v[2] - v[0], v[0] - v[3]) <= 6 * v[1],
        2,
        "both limits are on the same side of the mean, more than six standard deviations away",
    ),
)


def is_distribution(raw: Any) -> bool:
    """Return True if a value in a study file is a distribution, even if the name of the distribution is misspelt."""
    keys = raw if isinstance(raw, Mapping) and not {*RANGE_KEYS} & {*raw} else ()
    return any(nearest(str(key), (*KINDS, *RANGE_KEYS)) in KINDS for key in keys)


def _discrete(raw: Any, read: Callable[[Any], Any]) -> Drawn:
    def listed(entry: Callable[[Any], Any], entries: Any) -> tuple[Any, ...]:
        require(isinstance(entries, list | tuple) and entries, "must be a list with at least one entry")
        return tuple(each(entries, entry))

    readers = {"values": partial(listed, read), "weights": partial(listed, Quantity("", "1", ge=0, sweep=False).read)}
    found = read_mapping(raw, readers, ("values",), "it is {values: [...], weights: [...]}")
    values = found["values"]
    weights = found.get("weights", (1 / len(values),) * len(values))
    twice = len(set(values)) < len(values)
    require(not twice, "contains a value twice: combine its weights", "values", show_value=False)
    require(len(weights) == len(values), f"must be as long as the list of values, {len(values)}", "weights")
    require(abs(sum(weights) - 1) <= 1e-9, f"must sum to 1, not to {sum(weights):.10g}", "weights")
    return Drawn(DISCRETE, values, weights)


_DEG_PER_RAD = Decimal("57.295779513082320876798154814105170332405")
# Factors that convert each unit to the first unit of its kind. In decimal arithmetic, "38 ft" is exactly 11.5824 m.
_KINDS: dict[str, dict[str, Any]] = {
    "a length": {"m": 1, "mm": "0.001", "cm": "0.01", "km": 1000, "in": "0.0254", "ft": "0.3048"},
    "an angle": {
        **{"deg": 1, "rad": _DEG_PER_RAD, "mrad": _DEG_PER_RAD / 1000, "urad": _DEG_PER_RAD / 1_000_000},
        **{"arcmin": Decimal(1) / 60, "arcsec": Decimal(1) / 3600, "\u00b0": 1},
    },
    "a duration": {"s": 1, "min": 60, "h": 3600, "d": 86400, "days": 86400},
    "an amount of memory": {
        **{"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12},
        **{"KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40},
    },
    "a pressure": {"Pa": 1, "hPa": 100, "kPa": 1000, "mbar": 100},
    "a temperature": {"degC": 1},
    "a speed": {"m/s": 1, "km/h": Decimal(1) / Decimal("3.6")},
    "a power": {"MW": 1, "kW": "0.001", "GW": 1000},
    "an irradiance": {"W/m2": 1, "kW/m2": 1000, "MW/m2": 10**6},
    "a vapour density": {"g/m3": 1, "kg/m3": 1000},
    "a plain number": {"1": 1, "%": "0.01"},
}
#: Kind of each unit, such as ``an angle``.
UNITS = {unit: kind for kind, units in _KINDS.items() for unit in units}


def parse(text: str, unit: str) -> float:
    """Convert a number with its unit, such as ``"1.2 mrad"``, to a number in `unit`. Raises Invalid."""
    number_form = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
    match = re.fullmatch(rf"\s*({number_form})\s*([^0-9\W_].*?|%|\u00b0|)\s*", text)
    if match is None:
        clock = re.fullmatch(r"\s*([0-9]{1,2}):([0-9]{2})\s*", text)
        hints = {
            "; use a decimal point, not a comma": re.fullmatch(r"\s*[-+]?[0-9]+,[0-9]+\s*\D*", text),
            f"; '{text.strip()}' is {int(clock[1]) + int(clock[2]) / 60 if clock else 0:g} h": clock and unit == "h",
            "; a range is {start, stop, step} or {start, stop, num}": (
                not clock and re.search(r"[0-9]\s*:\s*[-+0-9]|range|linspace", text)
            ),
        }
        hint = next((words for words, applies in hints.items() if applies), "")
        raise Invalid(f"must be {expected(unit)}{hint}")
    number, given, kind = float(match[1]), match[2], UNITS[unit]
    require(given, "must be a number without quotes, or a number with its unit")
    require(given in UNITS, f"unknown unit '{given[:20]}'; use {one_of(_KINDS[kind])}")
    require(UNITS[given] == kind, f"must be {expected(unit)}; '{given}' is the unit of {UNITS[given]}")
    return float(Decimal(repr(number)) * Decimal(_KINDS[kind][given]) / Decimal(_KINDS[kind][unit]))


def expected(unit: str) -> str:
    """Describe the expected input for a quantity: ``an angle in deg, a number or text such as '30 deg'``."""
    if unit == "1":
        return "a number"
    examples = {"m": "1.5 m", "deg": "30 deg", "h": "1.5 h", "B": "2 GB", "mrad": "1.2 mrad"}
    return f"{UNITS[unit]} in {unit}, a number or text such as '{examples.get(unit, f'1 {unit}')}'"


def factor(given: str, wanted: str) -> float:
    """Return the conversion factor between two units. Raises ValueError if the units are of different kinds."""
    if given not in UNITS or UNITS[given] != UNITS.get(wanted):
        raise ValueError(f"'{given}' cannot be converted to '{wanted}'")
    return float(Decimal(_KINDS[UNITS[given]][given]) / Decimal(_KINDS[UNITS[given]][wanted]))


#: Maximum seed, and maximum number of draws. Larger seeds cannot be represented exactly as floats, so different seeds
#: could become equal.
MAX_SEED, MAX_SAMPLES = 2**53 - 1, 10**9
Schema = dict[str, Any]


@dataclass(frozen=True)
class Parameter:
    """Declaration of a value in a study file, with the properties common to all kinds of values.

    Parameters
    ----------
    description : str
        Meaning of the value, with its zero point and sign convention.
    sweep : bool
        True if the value may be swept by a list or, for numbers, also by a range or a distribution. A swept parameter
        is a dimension of the result.
    dimension : str
        Name of the dimension of a swept value; empty to use the name of the key.
    title, standard_name : str
        Long name and CF standard name (if defined) of the coordinate.
    """

    description: str
    sweep: bool = field(default=False, kw_only=True)
    dimension: str = field(default="", kw_only=True)
    title: str = field(default="", kw_only=True)
    standard_name: str = field(default="", kw_only=True)

    @property
    def purpose(self) -> str:
        """Description of the value, with its unit if there is one."""
        return self.description

    #: Types of swept values.
    _SWEPT: ClassVar[Any] = list | tuple

    def read(self, raw: Any) -> Any:
        """Convert data from the study file to a value, a sweep or a distribution. Raises Invalid."""
        if is_distribution(raw):
            require(self.sweep, "must be a single value and cannot be drawn from a distribution")
            return self._drawn(raw)
        if not isinstance(raw, self._SWEPT):
            return self._one(raw)
        require(self.sweep, "must be a single value and cannot be swept")
        return self._swept(raw)

    def _one(self, raw: Any) -> Any:
        raise NotImplementedError

    def _swept(self, raw: Any) -> Sweep:
        return Sweep(read_items(raw, self._one))

    def _drawn(self, raw: Any) -> Any:
        form = "names are drawn from {discrete: {values: [...], weights: [...]}}"
        readers = {DISCRETE: partial(_discrete, read=self._one)}
        return read_mapping(raw, readers, (), form, exactly=(DISCRETE,))[DISCRETE]

    def json_schema(self) -> Schema:
        """Return the JSON Schema of the value, with a simplified schema of its sweeps."""
        one = self._one_schema()
        if not self.sweep:
            return one
        swept = (
            list_schema(one),
            {"type": "object", "minProperties": 1, "description": "Swept: a range or distribution"},
        )
        return {"anyOf": [*one.get("anyOf", [one]), *swept]}

    def _one_schema(self) -> Schema:
        return {"type": "string", "minLength": 1}

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Make pydantic call only :meth:`read`, regardless of the annotated type."""

        def read(raw: Any) -> Any:
            try:
                return self.read(raw)
            except Invalid as error:
                raise to_pydantic(error.faults) from None

        return core_schema.no_info_plain_validator_function(read)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> Schema:
        return ({"title": self.title} if self.title else {}) | {"description": self.purpose} | self.json_schema()


def list_schema(one: Mapping[str, Any]) -> Schema:
    """Return the JSON Schema of a non-empty list of values."""
    return {"type": "array", "items": one, "minItems": 1, "description": "Swept: a list"}


def object_schema(description: str, required: Mapping[str, Any], optional: Mapping[str, Any] | None = None) -> Schema:
    """Return the JSON Schema of a mapping that does not allow unknown keys."""
    properties = {"properties": {**required, **(optional or {})}, "required": list(required)}
    return {"type": "object", "description": description, "additionalProperties": False, **properties}


def free_text(raw: Any) -> str:
    """Return a non-empty string. Raises Invalid."""
    quotes = ": write it in quotes" if isinstance(raw, int | float) else ""
    require(isinstance(raw, str), f"must be text{quotes}")
    require(raw.strip(), "must not be empty")
    return str(raw)


@dataclass(frozen=True)
class Text(Parameter):
    """Text, optionally in a required form.

    Parameters
    ----------
    form : callable
        Function that converts data from the study file to a string or raises Invalid.
    """

    form: Callable[[Any], str] = field(default=free_text, kw_only=True)

    def _one(self, raw: Any) -> str:
        return self.form(raw)


@dataclass(frozen=True)
class Flag(Parameter):
    """A boolean, written as ``true`` or ``false``."""

    def _one(self, raw: Any) -> Any:
        require(isinstance(raw, bool), "must be true or false")
        return raw

    def _one_schema(self) -> Schema:
        return {"type": "boolean"}


@dataclass(frozen=True)
class FileName(Parameter):
    """Name of a file, relative to the study file."""

    sweep: bool = field(default=True, kw_only=True)

    def _drawn(self, raw: Any) -> Any:
        raise Invalid("files cannot be drawn: sweep them as a list")

    def _one(self, raw: Any) -> Any:
        require(isinstance(raw, str) and raw.strip(), "must be the name of a file, relative to the study file")
        return raw


@dataclass(frozen=True)
class Choice(Parameter):
    """One of several names.

    Parameters
    ----------
    options : mapping of str to str, or sequence of str
        Allowed names, optionally with their meanings.
    """

    options: Mapping[str, str] | Sequence[str] = field(hash=False)
    sweep: bool = field(default=True, kw_only=True)

    @property
    def purpose(self) -> str:
        """Description of the choice, including the meaning of each name."""
        if not isinstance(self.options, Mapping):
            return self.description
        return f"{self.description} ({'; '.join(f'{name}: {meaning}' for name, meaning in self.options.items())})"

    def _one(self, raw: Any) -> str:
        require(isinstance(raw, str), f"must be {one_of(self.options)}")
        if raw not in self.options:
            hint = f"; {SYNONYMS[raw.casefold()]}" if raw.casefold() in SYNONYMS else did_you_mean(raw, self.options)
            raise Invalid(f"unknown choice{hint or f'; use {one_of(self.options)}'}")
        return str(raw)

    def _one_schema(self) -> Schema:
        return {"enum": list(self.options)}


@dataclass(frozen=True)
class Quantity(Parameter):
    """A physical quantity with a canonical unit and bounds.

    Parameters
    ----------
    unit : str
        Canonical unit, one of `UNITS`; ``"1"`` for pure numbers.
    ge, gt, le, lt : float, optional
        Bounds, in `unit`.
    integer : bool
        True if the number must be an integer. The value is then an int.
    only : tuple of int, optional
        Allowed numbers, if only a few are allowed.
    repeats : bool
        True if a list may contain the same value twice when `zip` ties it to another key.
    """

    unit: str
    sweep: bool = field(default=True, kw_only=True)
    ge: float | None = field(default=None, kw_only=True)
    gt: float | None = field(default=None, kw_only=True)
    le: float | None = field(default=None, kw_only=True)
    lt: float | None = field(default=None, kw_only=True)
    integer: bool = field(default=False, kw_only=True)
    only: tuple[int, ...] = field(default=(), kw_only=True)
    repeats: bool = field(default=False, kw_only=True)

    @property
    def purpose(self) -> str:
        """Description and unit."""
        return self.description if self.unit == "1" else f"{self.description} [{self.unit}]"

    _SWEPT: ClassVar[Any] = Mapping | list | tuple

    def _one(self, raw: Any) -> float:
        value = self._number(raw)
        above = (self.ge is None or value >= self.ge) and (self.gt is None or value > self.gt)
        below = (self.le is None or value <= self.le) and (self.lt is None or value < self.lt)
        require(above and below and value in (self.only or (value,)), f"must be {self.bounds()}")
        require(not self.integer or value.is_integer(), "must be a whole number")
        return int(value) if self.integer else value

    def _swept(self, raw: Any) -> Sweep:
        if not isinstance(raw, Mapping):
            return Sweep(read_items(raw, self._one, self.repeats))
        sweep = read_range(raw, self._number)
        # it is sufficient to check the bounds at both ends, because a range is monotonic
        outer = ("logspace",) if "logspace" in raw else ()
        ends = zip(("start", "stop"), sweep.ends(), strict=True)
        collect((((*outer, key), partial(self._one, value)) for key, value in ends), [])
        whole = not self.integer or not (sweep.values() % 1).any()
        require(whole, "the values of the range must be whole numbers", show_value=False)
        allowed = not self.only or {*sweep.values().tolist()} <= {*self.only}
        require(allowed, f"the values of the range must be {self.bounds()}", show_value=False)
        return sweep

    def _drawn(self, raw: Any) -> Any:
        readers: dict[str, Any] = {DISCRETE: partial(_discrete, read=lambda entry: float(self._one(entry)))}
        form = "whole numbers are drawn from {discrete: {values: [...], weights: [...]}}"
        if not self.integer:
            readers |= {kind: partial(self._shape, kind) for kind in PARTS}
            form = f"a distribution is one of {', '.join(KINDS)}"
        ((kind, found),) = read_mapping(raw, readers, (), form, exactly=tuple(readers)).items()
        drawn = found if kind == DISCRETE else Drawn(kind, found)
        low = max(bound for bound in (self.ge, self.gt, -math.inf) if bound is not None)
        high = min(bound for bound in (self.le, self.lt, math.inf) if bound is not None)
        mass = drawn.outside(low, high)
        if kind == NORMAL and 0 < mass < CUT:  # move an exclusive bound to the nearest allowed number
            low = math.nextafter(low, math.inf) if low == self.gt else low
            high = math.nextafter(high, -math.inf) if high == self.lt else high
            limits = float(max(low, drawn.ends()[0])), float(min(high, drawn.ends()[1]))
            return Drawn(TRUNCATED, (*drawn.parts, *limits), cut=mass)
        share = f"{100 * mass:.3g} %" if mass >= CUT else f"a fraction of {mass:.2g}"
        remedy = "use truncated_normal: [mean, standard deviation, minimum, maximum], or another distribution"
        require(mass == 0, f"must be {self.bounds()}, and {share} of the draws would be outside; {remedy}", kind)
        return drawn

    def _shape(self, kind: str, raw: Any, fixed: bool = False) -> tuple[float, ...]:
        """Read the parameters of a distribution (see `PARTS`). The width may be zero if `fixed` is True."""
        names = PARTS[kind]
        count = f"must be {COUNTS[len(names)]} numbers, [{', '.join(names)}]"
        require(isinstance(raw, list | tuple) and len(raw) == len(names), count)

        def part(item: tuple[str, Any]) -> float:
            name, entry = item
            single = not isinstance(entry, Mapping | list | tuple)
            require(single, "must be a single number; distributions cannot be swept")
            if name in ("least", "most likely", "largest") or (fixed and name == "mean"):
                return self._one(entry)
            value = Quantity("", "1").read(entry) if "logarithm" in name else self._number(entry)
            limit = "greater than 0; if the key does not vary, write a number instead of a distribution"
            limit = f"the {name} must {'not be negative' if fixed else f'be {limit}'}"
            require("deviation" not in name or value > 0 or (fixed and value == 0), limit)
            return float(value)

        values = tuple(each(zip(names, raw, strict=True), part))
        for kinds, holds, position, message in _CHECKS:
            # the parameters of a fixed distribution may be equal
            require(kind not in kinds or holds(values) or len({*values}) <= fixed, message, position)
        largest = max(abs(bound) for bound in (self.ge, self.le, 0.0) if bound is not None)
        wide = fixed and kind == NORMAL and 0 < largest < values[1]
        require(not wide, f"the standard deviation must be at most {largest:g} {self.unit}", 1)
        return values

    def bounds(self) -> str:
        """Return the bounds as text, such as ``between -90 and 90 deg``; empty if unbounded."""
        ending, form = "" if self.unit == "1" else f" {self.unit}", ".0f" if self.integer else "g"
        if self.only:
            return one_of(map(str, self.only)).replace("'", "")
        if self.ge is not None and self.le is not None:
            return f"between {self.ge:{form}} and {self.le:{form}}{ending}"
        words = {"at least": self.ge, "greater than": self.gt, "at most": self.le, "less than": self.lt}
        parts = [f"{word} {bound:{form}}" for word, bound in words.items() if bound is not None]
        return f"{' and '.join(parts)}{ending}" if parts else ""

    def _one_schema(self) -> Schema:
        if self.only:
            return {"enum": list(self.only)}
        limits = {"minimum": self.ge, "exclusiveMinimum": self.gt, "maximum": self.le, "exclusiveMaximum": self.lt}
        number: Schema = {"type": "integer" if self.integer else "number"}
        number |= {key: bound for key, bound in limits.items() if bound is not None}
        pattern = r"^\s*[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\s*[^0-9\s].*$"
        return number if self.unit == "1" else {"anyOf": [number, {"type": "string", "pattern": pattern}]}

    def _number(self, raw: Any) -> float:
        """Return a finite number in the canonical unit. Bounds are not checked."""
        is_count = self.integer and self.unit == "1"
        if isinstance(raw, str):
            raw = parse(raw, self.unit)
            require(not is_count, "must be a whole number")  # a count has no unit, not even %
        wanted = "must be a whole number" if is_count else f"must be {expected(self.unit)}"
        require(isinstance(raw, int | float) and not isinstance(raw, bool), wanted)
        require(abs(raw) < 1e300, "must be a finite number")  # differences of larger numbers could overflow
        return float(raw) + 0.0  # avoids negative zero


@dataclass(frozen=True)
class Samples(Quantity):
    """Sampling instants, written as a sweep or a single value and always read as a sweep.

    Results are averaged over the samples, or have the ``time`` dimension. Samples are not a dimension of the parameter
    grid.
    """

    def read(self, raw: Any) -> Sweep:
        """Return the samples; a single value becomes a sweep with one value. Raises Invalid."""
        value = super().read(raw)
        return value if isinstance(value, Sweep) else Sweep((value,))

    def _drawn(self, raw: Any) -> Drawn:
        raise Invalid("instants cannot be drawn from a distribution")


@dataclass(frozen=True)
class Numbers(Parameter):
    """A list of numbers with a fixed length, such as ``[0, -1]``.

    Parameters
    ----------
    units : str or tuple of str
        Canonical unit of all numbers, or of each number.
    names : tuple of str
        Names of the numbers.
    gt, ge, le : float, optional
        Bounds of all numbers.
    """

    units: str | tuple[str, ...]
    names: tuple[str, ...]
    gt: float | None = field(default=None, kw_only=True)
    ge: float | None = field(default=None, kw_only=True)
    le: float | None = field(default=None, kw_only=True)

    @property
    def purpose(self) -> str:
        """Description, names and unit of the numbers."""
        return f"{self.description}, {self.form}"

    @property
    def form(self) -> str:
        """Notation of the numbers in a study file."""
        unit = f" in {self.units}" if isinstance(self.units, str) and self.units != "1" else ""
        return f"[{', '.join(self.names)}]{unit}"

    def read(self, raw: Any) -> Any:
        """Return the numbers as a tuple. Raises Invalid."""
        parts = self._parts()
        count = f"must be {dict(enumerate(COUNTS)).get(len(parts), len(parts))} numbers {self.form}"
        require(isinstance(raw, list | tuple) and len(raw) == len(parts), count)
        return tuple(each(zip(parts, raw, strict=True), lambda pair: pair[0].read(pair[1])))

    def _one_schema(self) -> Schema:
        one = self._parts()[0].json_schema() if isinstance(self.units, str) else {"type": ["number", "string"]}
        return {"type": "array", "items": one, "minItems": len(self.names), "maxItems": len(self.names)}

    def _parts(self) -> list[Quantity]:
        parts = [self.units] * len(self.names) if isinstance(self.units, str) else self.units
        return [Quantity("", unit, gt=self.gt, ge=self.ge, le=self.le, sweep=False) for unit in parts]


@dataclass(frozen=True)
class ListOfNumbers(Numbers):
    """A list of distinct entries, each with a fixed number of values, such as ``[[-16, 150, 0], [-60, 300, 0]]``.

    Parameters
    ----------
    entries : int, optional
        Required number of entries (default: one or more).
    """

    entries: int | None = field(default=None, kw_only=True)

    def read(self, raw: Any) -> tuple[tuple[float, ...], ...]:
        """Return the entries. Raises Invalid."""
        count = "" if self.entries is None else f"{self.entries} "
        whole = isinstance(raw, list | tuple) and self.entries in (None, len(raw))
        require(whole, f"must be a list of {count}entries {self.form}")
        require(raw, f"the list is empty: give at least one entry {self.form}", show_value=False)
        first: dict[tuple[float, ...], int] = {}

        def another(item: tuple[int, Any]) -> tuple[float, ...]:
            entry = Numbers.read(self, item[1])
            before = first.setdefault(entry, item[0])
            require(before == item[0], f"is the same as entry {before} (counted from 0): remove one of them")
            return entry

        return tuple(each(enumerate(raw), another))

    def _one_schema(self) -> Schema:
        count = {"minItems": self.entries or 1} | ({} if self.entries is None else {"maxItems": self.entries})
        return {"type": "array", "items": super()._one_schema(), "uniqueItems": True, **count}


_SHAPES = (NORMAL, UNIFORM)


@dataclass(frozen=True)
class Distribution:
    """Distribution of a number that is drawn for each mount.

    Parameters
    ----------
    kind : {"normal", "uniform"}
        Shape of the distribution.
    parts : tuple of float
        Mean and standard deviation, or minimum and maximum, in the canonical unit of the parameter.
    samples, seed : int, optional
        Number and seed of the draws; None to use the values of the block.
    """

    kind: str
    parts: tuple[float, float]
    samples: int | None = None
    seed: int | None = None

    @property
    def mean(self) -> float:
        """Mean of the distribution."""
        return self.parts[0] if self.kind == NORMAL else 0.5 * self.parts[0] + 0.5 * self.parts[1]

    @property
    def width(self) -> float:
        """Factor applied to standard deviates: the standard deviation, or half the range of a uniform distribution.

        Draws are ``mean + width * deviate`` with standard normal deviates, or uniform deviates between -1 and 1.
        """
        return self.parts[1] if self.kind == NORMAL else 0.5 * self.parts[1] - 0.5 * self.parts[0]

    def spec(self) -> dict[str, Any]:
        """Return the distribution as plain data for a study file."""
        drawn = {"samples": self.samples, "seed": self.seed}
        return {self.kind: list(self.parts)} | {key: value for key, value in drawn.items() if value is not None}


@dataclass(frozen=True)
class Uncertain(Quantity):
    """A physical quantity that is fixed, swept, or drawn from a distribution for each mount.

    Bounds apply to numbers and sweeps, to the mean of a normal distribution, and to both ends of a uniform
    distribution. The standard deviation must not exceed the larger absolute value of the bounds.
    """

    def read(self, raw: Any) -> Any:
        """Return a number in the canonical unit, a Sweep of such numbers, or a Distribution. Raises Invalid."""
        keys = [*raw] if isinstance(raw, Mapping) else []
        meant = {nearest(str(key), (*_SHAPES, "samples", "seed", *RANGE_KEYS)) for key in keys}
        is_drawn = {*_SHAPES} & {*keys} or (meant and not meant & {*RANGE_KEYS})
        return self._drawn(raw) if is_drawn else super().read(raw)

    def _number(self, raw: Any) -> float:
        require(not isinstance(raw, Mapping), "distributions cannot be swept")
        return super()._number(raw)

    def _drawn(self, raw: Any) -> Any:
        readers: dict[str, Any] = {kind: partial(self._shape, kind, fixed=True) for kind in _SHAPES}
        for key, least, most in (("samples", 1, MAX_SAMPLES), ("seed", 0, MAX_SEED)):
            readers[key] = Quantity("", "1", ge=least, le=most, integer=True, sweep=False).read
        form = "a distribution is {normal: [mean, standard deviation]} or {uniform: [minimum, maximum]}"
        values = read_mapping(raw, readers, (), form, exactly=_SHAPES)
        kind = next(kind for kind in _SHAPES if kind in values)
        return Distribution(kind, values[kind], values.get("samples"), values.get("seed"))

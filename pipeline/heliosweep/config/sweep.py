"""Values of swept keys, in order: a list, an even range, a geometric range or draws from a distribution.

They are written as a list ``[0, 15, 30]``, a range ``{start, stop, step}`` or ``{start, stop, num}``, a geometric range
``{logspace: {start, stop, num}}``, or a distribution ``{normal: [11, 0.02]}``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from heliosweep.config.faults import COUNTS, MAX_FAULTS, Fault, Faults, Invalid, did_you_mean, each, nearest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.config.sample import Design


#: Maximum number of values of a sweep.
MAX_POINTS = 10**6
_FORMS = "a range is {start, stop, step}, {start, stop, num} or {logspace: {start, stop, num}}"
_ON_STEP = Decimal("1e-9")  # a stop this near to the last step, in steps, falls on it
#: Message for a list with equal values.
TWICE = "the list contains the same value twice"
ReadNumber = Callable[[Any], float]
#: A number in the canonical unit of its key, or text with a unit such as ``"1.2 mrad"``.
Number: TypeAlias = float | str
#: Swept values as plain data, as in a study file; a list is one as it is.
Swept: TypeAlias = "dict[str, Number | dict[str, Number]]"


class Sweep:
    """Values of a swept key, in order: an array of numbers, or a tuple of names.

    Parameters
    ----------
    values : sequence of float or of str
        The values.
    form : dict, optional
        Compact form of a range, ``{start, stop, num}`` or ``{logspace: {start, stop, num}}``; None for a list.
    reaches : bool
        False if the last step ends before the stop that the user specified.
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
        """Return one value (float or str); for a slice an array of numbers or a tuple of names."""
        found = self.values()[index]
        return found if isinstance(index, slice) or isinstance(found, str) else float(found)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.spec()})"

    @property
    def holds_names(self) -> bool:
        """True if the values are text."""
        return isinstance(self._values, tuple)

    def values(self) -> Any:
        """Return all values: an array of float64, shape (n,), or a tuple of str."""
        return self._values

    def items(self) -> tuple[Any, ...]:
        """Return all values as a tuple of float or of str."""
        return tuple(self.values() if self.holds_names else self.values().tolist())

    def ends(self) -> tuple[Any, ...]:
        """Return all values of a list; both ends of a range, which is monotonic."""
        return self.items() if self.form is None else (self[0], self[-1])

    def spec(self) -> list[Any] | dict[str, Any]:
        """Return the compact form as plain data that a study file may contain."""
        return list(self.items()) if self.form is None else self.form


def ends(value: Any) -> tuple[Any, ...]:
    """Return a single value, all values of a list, or both ends of a range or a distribution."""
    return value.ends() if isinstance(value, Sweep) else (value,)


def even_range(start: float, stop: float, num: int, *, reaches: bool = True) -> Sweep:
    """Return `num` evenly spaced values from `start` to `stop`, both included.

    The values follow exact decimal arithmetic, rounded once: 8 to 16 in 41 points contains 8.6, not
    8.600000000000001.
    """
    first, last = _fraction(start), _fraction(stop)
    step = (last - first) / max(num - 1, 1)
    divisor = math.lcm(first.denominator, step.denominator)
    a, b = int(first * divisor), int(step * divisor)
    index = np.arange(num)
    if max(divisor, abs(a), abs(a + b * (num - 1)), abs(b) * num) < 2**53:  # exact in a float64
        values: Any = (a + index * b) / divisor
    else:
        values = start + index * (float(last - first) / max(num - 1, 1))
        values[-1] = stop
    return Sweep(values, {"start": start, "stop": stop, "num": num}, reaches=reaches)


def midpoints(sweep: Sweep) -> Sweep:
    """Return the middles of the steps of an even range."""
    steps = len(sweep) - 1
    half = (_fraction(sweep[-1]) - _fraction(sweep[0])) / steps / 2
    return even_range(float(_fraction(sweep[0]) + half), float(_fraction(sweep[-1]) - half), steps)


def geometric_range(start: float, stop: float, num: int) -> Sweep:
    """Return `num` values from `start` to `stop`, both included, each in the same ratio to the one before."""
    low, high = math.log10(abs(start)), math.log10(abs(stop))
    values = math.copysign(1.0, start) * 10.0 ** (low + np.arange(num) * ((high - low) / max(num - 1, 1)))
    values[-1], values[0] = stop, start
    return Sweep(values, {"logspace": {"start": start, "stop": stop, "num": num}})


def as_range(sweep: Sweep) -> Sweep:
    """Return a list of evenly spaced numbers as the equal range; any other sweep unchanged."""
    if sweep.form is not None or sweep.holds_names:
        return sweep
    same = even_range(sweep[0], sweep[-1], len(sweep))
    return same if np.array_equal(same.values(), sweep.values()) else sweep


def _fraction(number: float) -> Fraction:
    """Return the shortest decimal that rounds to a float, exactly: 0.1 is 1/10."""
    return Fraction(repr(number))


def read_sweep(raw: Sequence[Any] | Mapping[str, Any], number: ReadNumber, repeats: bool = False) -> Sweep:
    """Read swept numbers from any of their forms; `number` reads one. Raises Invalid with each fault at its key."""
    if not isinstance(raw, Mapping):
        return Sweep(read_items(raw, number, repeats))
    if "logspace" not in raw:
        return _read_range(raw, number)
    geometric = {"logspace": partial(_read_range, number=number, geometric=True)}
    found: Sweep = read_mapping(raw, geometric, ("logspace",), _FORMS)["logspace"]
    return found


def read_items(raw: Sequence[Any], read: Callable[[Any], Any], repeats: bool = False) -> tuple[Any, ...]:
    """Read the entries of a list that is not empty, different unless `repeats`. Raises Invalid."""
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


def _read_range(raw: Any, number: ReadNumber, geometric: bool = False) -> Sweep:
    counts: dict[str, Callable[[Any], Any]] = {"step": number} if not geometric else {}
    counts["num"] = partial(read_whole, least=1, most=MAX_POINTS)
    readers = {"start": number, "stop": number, **counts}
    values = read_mapping(raw, readers, ("start", "stop"), _FORMS, exactly=tuple(counts))
    start, stop, num, reaches = values["start"], values["stop"], values.get("num"), True
    if geometric and 0 in (start, stop):
        raise Invalid([Fault("must not be zero", (key,)) for key in ("start", "stop") if values[key] == 0])
    if geometric and (start < 0) != (stop < 0):
        raise Invalid(Fault("must have the sign of start", ("stop",)))
    if num is None:
        num, stop, reaches = _stepped(start, stop, values["step"])
    elif num == 1 and start != stop:
        raise Invalid(Fault("must be at least 2 if start and stop differ", ("num",)))
    if num > 1 and start == stop:
        raise Invalid(Fault("must differ from start if there is more than one value", ("stop",)))
    if num > 1 and abs(stop - start) / (num - 1) < math.ulp(max(abs(start), abs(stop))):
        raise Invalid(Fault("the steps are finer than the precision of numbers", (*(counts.keys() & raw.keys()),)))
    return geometric_range(start, stop, num) if geometric else even_range(start, stop, num, reaches=reaches)


def _stepped(start: float, stop: float, step: float) -> tuple[int, float, bool]:
    """Return the number of values, the last value, and True if that is the stop."""
    if step == 0:
        raise Invalid(Fault("must not be zero", ("step",)))
    exact_start, exact_step = Decimal(repr(start)), Decimal(repr(step))
    steps = (Decimal(repr(stop)) - exact_start) / exact_step
    if steps < 0:
        sign = "positive" if stop > start else "negative"
        raise Invalid(Fault(f"has the wrong sign: from {start:.12g} to {stop:.12g} it must be {sign}", ("step",)))
    if steps >= MAX_POINTS:
        raise Invalid(Fault(f"gives more than {MAX_POINTS:,} values; is the step too small?", ("step",)))
    whole = int(steps + _ON_STEP)
    reaches = abs(steps - whole) <= _ON_STEP
    return whole + 1, stop if reaches else float(exact_start + whole * exact_step), reaches


def read_mapping(
    raw: Any,
    readers: Mapping[str, Callable[[Any], Any]],
    required: Sequence[str],
    form: str,
    *,
    exactly: Sequence[str] = (),
) -> dict[str, Any]:
    """Read a mapping of known keys.

    Parameters
    ----------
    raw : mapping
        The mapping in the study file.
    readers : mapping of str to callable
        Returns the value of each known key, or raises Invalid.
    required, exactly : sequence of str
        Keys that must be given, and keys of which exactly one must be given.
    form : str
        Description of the mapping in messages.

    Raises
    ------
    Invalid
        With each fault at its key.
    """
    if not isinstance(raw, Mapping):
        raise Invalid(f"must be a mapping: {form}")
    faults = _key_faults(raw, tuple(readers), required, form)
    given = [key for key in exactly if key in raw]
    faults += (Fault(f"give only one of {', '.join(exactly)}", (key,), show_value=False) for key in given[1:])
    if exactly and not given and not faults:
        words = " or ".join(f"'{key}'" for key in exactly)
        faults.append(Fault(f"{words} is missing: {form}", show_value=False))
    values: dict[str, Any] = {}
    for key in (key for key in readers if key in raw):
        with faults.under(key):
            values[key] = readers[key](raw[key])
    faults.check()
    return values


def _key_faults(raw: Mapping[str, Any], known: Sequence[str], required: Sequence[str], form: str) -> Faults:
    """Return the faults of unknown and missing keys."""
    unknown = [str(key) for key in raw if key not in known][:MAX_FAULTS]
    faults = Faults(
        Fault(f"unknown key{did_you_mean(key, known) or f'; {form}'}", (key,), show_value=False) for key in unknown
    )
    meant = [nearest(key, known) for key in unknown]
    if missing := [f"'{key}'" for key in required if key not in raw and key not in meant]:
        verb = "is" if len(missing) == 1 else "are"
        faults.append(Fault(f"{' and '.join(missing)} {verb} missing: {form}", show_value=False))
    return faults


def read_whole(raw: Any, least: int, most: int) -> int:
    """Read a whole number. Raises Invalid."""
    if isinstance(raw, bool) or not isinstance(raw, int | float) or raw % 1 != 0:
        raise Invalid("must be a whole number")
    if not least <= raw <= most:
        raise Invalid(f"must be between {least} and {most}")
    return int(raw)


def sweep(start: Number, stop: Number, *, step: Number | None = None, num: int | None = None) -> Swept:
    """Evenly spaced values of a swept key.

    Both ends are included if they fall on the step.

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
        ``{start, stop, step}`` or ``{start, stop, num}``, checked by `study`.

    Examples
    --------
    >>> sweep(0, 60, step=15)
    {'start': 0, 'stop': 60, 'step': 15}
    """
    parts = {"start": start, "stop": stop, "step": step, "num": num}
    return {key: value for key, value in parts.items() if value is not None}


def logspace(start: Number, stop: Number, num: int) -> Swept:
    """Values of a swept key in a geometric series, both ends included.

    Parameters
    ----------
    start, stop : float or str
        First and last value, of one sign, in the unit of the key or with a unit; no exponents: as numpy.geomspace.
    num : int
        Number of values.

    Returns
    -------
    dict
        ``{logspace: {start, stop, num}}``, checked by `study`.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.logspace(1, 100, 3)
    {'logspace': {'start': 1, 'stop': 100, 'num': 3}}
    """
    return {"logspace": {"start": start, "stop": stop, "num": num}}


NORMAL, TRUNCATED, UNIFORM = "normal", "truncated_normal", "uniform"
TRIANGULAR, LOGNORMAL, DISCRETE = "triangular", "lognormal", "discrete"
#: Numbers of each distribution.
PARTS = {
    NORMAL: ("mean", "standard deviation"),
    TRUNCATED: ("mean", "standard deviation", "least", "largest"),
    UNIFORM: ("least", "largest"),
    TRIANGULAR: ("least", "most likely", "largest"),
    LOGNORMAL: ("median", "standard deviation of the natural logarithm"),
}
KINDS = (*PARTS, DISCRETE)
RANGE_KEYS = ("start", "stop", "step", "num", "logspace")
#: Minimum probability of a draw on either side: half a step of the sequences, of 30 bits. [1]
LEAST = 2.0**-31
#: Probability beyond the bounds of a key up to which a normal distribution is truncated at them.
CUT = 1e-6


class Drawn(Sweep):
    """A drawn key of a study: its values along the dimension ``sample``.

    Until the design is known, its minimum and its maximum replace its values.

    Parameters
    ----------
    kind : str
        One of the distributions of `PARTS`, or ``discrete``.
    parts : tuple of float
        The numbers of `PARTS`, in the canonical unit of the key; for ``discrete`` its values, which may be names.
    weights : tuple of float
        Probability of each value of ``discrete``.
    cut : float
        Probability that a normal distribution had beyond the bounds of the key, before it was truncated there.
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
            self._values, self._are_draws = (tuple(values) if self.holds_names else values), True
        return self._values

    def ends(self) -> tuple[Any, ...]:
        """Return the minimum and the maximum of the draws; all names."""
        if self.holds_names:
            return self.parts
        if self.kind not in (NORMAL, LOGNORMAL):
            own = self.parts[2:] if self.kind == TRUNCATED else self.parts
            return min(own), max(own)
        first, reach = self.parts[0], self.parts[1] * 6.121  # the most standard deviations of a draw, from `LEAST`
        return (
            (first - reach, first + reach)
            if self.kind == NORMAL
            else (first * math.exp(-reach), first * math.exp(reach))
        )

    def outside(self, low: float, high: float) -> float:
        """Return the probability of values of a (log)normal distribution below `low` or above `high`."""
        mean, deviation = self.parts
        if self.kind == LOGNORMAL:
            mean, low, high = (math.log(value) if value > 0 else -math.inf for value in (mean, low, high))
        tails = (0.5 * math.erfc(sign * (mean - bound) / deviation / math.sqrt(2))
                 for sign, bound in ((1, low), (-1, high)))  # fmt: skip
        return sum(mass for mass in tails if mass > LEAST)

    def quantile(self, probability: NDArray[np.float64]) -> NDArray[Any]:
        """Return the quantiles of the distribution; names count in their order."""
        from scipy.special import ndtr, ndtri

        first = self.parts[0]
        if self.kind == NORMAL:
            return first + self.parts[1] * ndtri(probability)
        if self.kind == LOGNORMAL:
            return first * np.exp(self.parts[1] * ndtri(probability))
        if self.kind == DISCRETE:
            steps = np.cumsum(self.weights)[:-1]
            values = np.array(self.parts, object if self.holds_names else float)
            return values[np.searchsorted(steps, probability, side="right")]
        if self.kind == TRUNCATED:
            mean, deviation, low, high = self.parts
            below, above = (low - mean) / deviation, (high - mean) / deviation
            sign = -1.0 if below > 0 else 1.0  # in the tail whose probabilities are small and exact
            mass = ndtr(sign * below) * (1 - probability) + ndtr(sign * above) * probability
            return np.clip(mean + deviation * sign * ndtri(mass), low, high)
        width = self.parts[-1] - first
        if self.kind == UNIFORM:
            return first + width * probability
        peak = (self.parts[1] - first) / width
        rising = np.sqrt(probability * peak)
        return first + width * np.where(probability < peak, rising, 1 - np.sqrt((1 - probability) * (1 - peak)))

    def spec(self) -> dict[str, Any]:
        """Return the distribution as plain data that a study file may contain."""
        if self.kind == DISCRETE:
            return {DISCRETE: {"values": list(self.parts), "weights": list(self.weights)}}
        return {self.kind: list(self.parts)}

    def words(self) -> str:
        """Return the distribution in words: ``normal: mean 11, standard deviation 0.02``."""
        if self.kind == DISCRETE:
            names = [value.replace("_", " ") if self.holds_names else f"{value:g}" for value in self.parts]
            shares = (f"{name} ({weight:.3g})" for name, weight in zip(names, self.weights, strict=True))
            return f"{DISCRETE}: {', '.join(shares)}"
        named = (f"{name} {value:g}" for name, value in zip(PARTS[self.kind], self.parts, strict=True))
        return f"{self.kind.replace('_', ' ')}: {', '.join(named)}"


#: Checks of the numbers of distributions, with the position of the number that is wrong.
_CHECKS: tuple[tuple[tuple[str, ...], Callable[[Sequence[float]], bool], int, str], ...] = (
    ((LOGNORMAL,), lambda v: v[0] > 0, 0, "the median must be greater than 0"),
    ((UNIFORM, TRIANGULAR), lambda v: v[0] < v[-1], 0, "the least value must be below the largest"),
    ((TRUNCATED,), lambda v: v[2] < v[3], 2, "the least value must be below the largest"),
    (
        (TRIANGULAR,),
        lambda v: v[0] <= v[1] <= v[2],
        1,
        "the most likely value must be between the least and the largest",
    ),
    (
        (TRUNCATED,),
        lambda v: max(v[2] - v[0], v[0] - v[3]) <= 6 * v[1],
        2,
        "the limits are more than six standard deviations from the mean",
    ),
)


def is_distribution(raw: Any) -> bool:
    """Return True for a distribution, or a misspelt one, in a study file."""
    if not isinstance(raw, Mapping) or any(key in RANGE_KEYS for key in raw):
        return isinstance(raw, Drawn)
    return any(nearest(str(key), (*KINDS, *RANGE_KEYS)) in KINDS for key in raw)


def read_drawn(
    raw: Mapping[str, Any] | Drawn,
    number: Callable[[Any], Any],
    check: Callable[[Any], None] = lambda value: None,
    low: float = -math.inf,
    high: float = math.inf,
    form: str = "",
) -> Drawn:
    """Read a distribution.

    Parameters
    ----------
    raw : mapping or Drawn
        The distribution in the study file.
    number, check : callable
        Reads a number in the unit of the key, or a name; raises Invalid for a number out of the bounds of the key.
    low, high : float
        Bounds of the key.
    form : str
        Description of the distribution if only ``discrete`` is possible, for names and whole numbers.

    Raises
    ------
    Invalid
        With each fault at its key.
    """
    raw = raw.spec() if isinstance(raw, Drawn) else raw

    def checked(entry: Any) -> Any:
        value = number(entry)
        check(value)
        return value

    readers: dict[str, Callable[[Any], Any]] = {DISCRETE: partial(_discrete, read=checked)}
    if not form:
        readers |= {kind: partial(read_shape, kind, number=number, checked=checked) for kind in PARTS}
    form = form or f"a distribution is one of {', '.join(KINDS)}"
    ((kind, found),) = read_mapping(raw, readers, (), form, exactly=tuple(readers)).items()
    drawn = found if kind == DISCRETE else Drawn(kind, found)
    mass = drawn.outside(low, high) if drawn.kind in (NORMAL, LOGNORMAL) else 0.0
    if drawn.kind == NORMAL and 0 < mass < CUT:
        return _cut(drawn, check, low, high)
    if mass > 0:
        try:
            for value in drawn.ends():
                check(value)
        except Invalid as error:
            share = f"{100 * mass:.3g} %" if mass >= CUT else f"a part of {mass:.2g}"
            message = f"{error.faults[0].message}, and {share} of the draws would not be; use truncated_normal: [mean, "
            message += "standard deviation, least, largest], or another distribution"
            raise Invalid(Fault(message, (drawn.kind,))) from None
    return drawn


def _cut(drawn: Drawn, check: Callable[[float], None], low: float, high: float) -> Drawn:
    """Return a normal distribution without its draws beyond the bounds of a key."""
    limits = []
    for bound, end, inner in zip((low, high), drawn.ends(), (math.inf, -math.inf), strict=True):
        limit = max(bound, end) if inner > 0 else min(bound, end)
        try:
            check(limit)
        except Invalid:  # the key excludes the bound itself
            limit = math.nextafter(limit, inner)
        limits.append(float(limit))
    return Drawn(TRUNCATED, (*drawn.parts, *limits), cut=drawn.outside(low, high))


def read_shape(
    kind: str, raw: Any, number: ReadNumber, checked: ReadNumber, *, fixed: bool = False
) -> tuple[float, ...]:
    """Read the numbers of a distribution, `PARTS`, which may have no width if `fixed`. Raises Invalid."""
    names = PARTS[kind]
    if not isinstance(raw, list | tuple) or len(raw) != len(names):
        raise Invalid(f"must be {COUNTS[len(names)]} numbers, [{', '.join(names)}]")

    def part(item: tuple[str, Any]) -> float:
        name, entry = item
        if isinstance(entry, Sweep | Mapping | list | tuple):
            raise Invalid("must be a single number; distributions cannot be swept")
        if name in ("least", "most likely", "largest") or (fixed and name == "mean"):
            return checked(entry)
        value = _plain_number(entry) if "logarithm" in name else number(entry)
        if "deviation" in name and (value < 0 if fixed else value <= 0):
            remedy = "greater than 0; write a number that does not vary without a distribution"
            raise Invalid(f"the {name} must {'not be negative' if fixed else f'be {remedy}'}")
        return value

    values = tuple(each(zip(names, raw, strict=True), part))
    for kinds, holds, position, message in _CHECKS:
        if kind in kinds and not holds(values) and len({*values}) > fixed:  # fixed numbers may be equal
            raise Invalid(Fault(message, (position,)))
    return values


def _discrete(raw: Any, read: Callable[[Any], Any]) -> Drawn:
    def listed(entry: Callable[[Any], Any], entries: Any) -> tuple[Any, ...]:
        if not isinstance(entries, list | tuple) or not entries:
            raise Invalid("must be a list of at least one")
        return tuple(each(entries, entry))

    readers = {"values": partial(listed, read), "weights": partial(listed, partial(_plain_number, least=0.0))}
    found = read_mapping(raw, readers, ("values",), "it is {values: [...], weights: [...]}")
    values = found["values"]
    weights = found.get("weights", (1 / len(values),) * len(values))
    if len(set(values)) < len(values):
        raise Invalid(Fault("contains a value twice; add their weights", ("values",), show_value=False))
    if len(weights) != len(values):
        raise Invalid(Fault(f"must be as many as the values, {len(values)}", ("weights",)))
    if abs(sum(weights) - 1) > 1e-9:
        raise Invalid(Fault(f"must sum to 1, not to {sum(weights):.10g}", ("weights",)))
    return Drawn(DISCRETE, values, weights)


def _plain_number(raw: Any, least: float = -math.inf) -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float) or not math.isfinite(raw):
        raise Invalid("must be a number without a unit")
    if raw < least:
        raise Invalid("must not be negative")
    return float(raw)

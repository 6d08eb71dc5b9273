"""Numbers and names that are drawn, once for the whole of a draw: ``{normal: [11, 0.02]}``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.design import LEAST, Design
from heliosweep.config.faults import COUNTS, Fault, Invalid, each, nearest
from heliosweep.config.sweep import Sweep, key_faults, read_parts

if TYPE_CHECKING:  # it takes longer to import than reading a study
    from numpy.typing import NDArray

    from heliosweep.config.sweep import ReadNumber

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
_DISCRETE_FORM = "it is {values: [...], weights: [...]}"
#: Maximum distance of a draw from the mean of a normal distribution, from `LEAST`. [standard deviations]
_REACH = 6.121
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
        self.form = self.spec()
        self.column = 0

    def __len__(self) -> int:
        return len(self.ends()) if self.design is None else len(self.design)

    def __getitem__(self, index: int | slice) -> Any:
        """Return one value (float or str); for a slice an array of numbers or a tuple of names."""
        if self.design is None:
            return Sweep(self.ends())[index]
        one = np.atleast_1d(np.arange(len(self))[index])
        values = self.quantile(self.design.at(one)[:, self.column])
        found = tuple(values) if self.holds_names else values
        return found if isinstance(index, slice) else found[0] if self.holds_names else float(found[0])

    def values(self) -> Any:
        """Return the values of all draws: an array of float64, or a tuple of str."""
        return self[:]

    def ends(self) -> tuple[Any, ...]:
        """Return the minimum and the maximum of the draws; all names."""
        if self.holds_names:
            return self.parts
        if self.kind not in (NORMAL, LOGNORMAL):
            own = self.parts[2:] if self.kind == TRUNCATED else self.parts
            return min(own), max(own)
        first, reach = self.parts[0], self.parts[1] * _REACH
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


def is_distribution(raw: Any) -> bool:
    """Return True for a distribution, or a misspelt one, in a study file."""
    if not isinstance(raw, Mapping) or any(key in RANGE_KEYS for key in raw):
        return isinstance(raw, Drawn)
    return any(nearest(str(key), (*KINDS, *RANGE_KEYS)) in KINDS for key in raw)


def read_drawn(
    raw: Mapping[str, Any] | Drawn, number: ReadNumber, check: Callable[[float], None], low: float, high: float
) -> Drawn:
    """Read a distribution of numbers.

    Parameters
    ----------
    raw : mapping or Drawn
        The distribution in the study file.
    number, check : callable
        Reads a number in the unit of the key; raises Invalid for a number out of the bounds of the key.
    low, high : float
        Bounds of the key.

    Raises
    ------
    Invalid
        With each fault at its key.
    """
    raw = raw.spec() if isinstance(raw, Drawn) else raw
    faults = key_faults(raw, KINDS, (), f"a distribution is one of {', '.join(KINDS)}")
    known = [key for key in raw if key in KINDS]
    faults += [Fault("give one distribution, not several", (key,), show_value=False) for key in known[1:]]

    def checked(entry: Any) -> float:
        value = number(entry)
        check(value)
        return value

    readers: dict[str, Callable[[Any], Drawn]] = {
        kind: partial(_continuous, kind, number=number, checked=checked) for kind in PARTS
    }
    drawn = read_parts(raw, readers | {DISCRETE: partial(_discrete, read=checked)}, faults)[known[0]]
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


def read_names(raw: Mapping[str, Any] | Drawn, name: Callable[[Any], str]) -> Drawn:
    """Read drawn names; `name` reads one. Raises Invalid with each fault at its key."""
    raw = raw.spec() if isinstance(raw, Drawn) else raw
    form = "names are drawn by {discrete: {values: [...], weights: [...]}}"
    faults = key_faults(raw, (DISCRETE,), (DISCRETE,), form)
    found: Drawn = read_parts(raw, {DISCRETE: partial(_discrete, read=name)}, faults)[DISCRETE]
    return found


def _continuous(kind: str, raw: Any, number: ReadNumber, checked: ReadNumber) -> Drawn:
    def part(name: str, entry: Any) -> float:
        if name in ("least", "most likely", "largest"):
            return checked(entry)
        value = _plain_number(entry) if "logarithm" in name else number(entry)
        if "deviation" in name and not value > 0:
            raise Invalid(
                f"the {name} must be greater than 0; write a number that does not vary without a distribution"
            )
        return value

    values = read_numbers(raw, PARTS[kind], part)
    if kind == LOGNORMAL and values[0] <= 0:
        raise Invalid(Fault("the median must be greater than 0", (0,)))
    if kind not in (NORMAL, LOGNORMAL):
        first = 2 if kind == TRUNCATED else 0
        if values[first] >= values[-1]:
            raise Invalid(Fault("the least value must be below the largest", (first,)))
        if kind == TRIANGULAR and not values[0] <= values[1] <= values[2]:
            raise Invalid(Fault("the most likely value must be between the least and the largest", (1,)))
        mean, deviation = values[:2]
        if kind == TRUNCATED and max(values[2] - mean, mean - values[3]) > 6 * deviation:
            raise Invalid(Fault("the limits are more than six standard deviations from the mean", (2,)))
    return Drawn(kind, values)


def read_numbers(raw: Any, names: tuple[str, ...], read: Callable[[str, Any], float]) -> tuple[float, ...]:
    """Read the numbers of a distribution, each by its name. Raises Invalid with each fault at its position."""
    if not isinstance(raw, list | tuple) or len(raw) != len(names):
        raise Invalid(f"must be {COUNTS[len(names)]} numbers, [{', '.join(names)}]")

    def one(part: tuple[str, Any]) -> float:
        if isinstance(part[1], Sweep | Mapping | list | tuple):
            raise Invalid("must be a single number; distributions cannot be swept")
        return read(*part)

    return tuple(each(zip(names, raw, strict=True), one))


def _discrete(raw: Any, read: Callable[[Any], Any]) -> Drawn:
    if not isinstance(raw, Mapping):
        raise Invalid(f"must be a mapping: {_DISCRETE_FORM}")

    def listed(entry: Callable[[Any], Any], entries: Any) -> tuple[Any, ...]:
        if not isinstance(entries, list | tuple) or not entries:
            raise Invalid("must be a list of at least one")
        return tuple(each(entries, entry))

    readers = {"values": partial(listed, read), "weights": partial(listed, partial(_plain_number, least=0.0))}
    found = read_parts(raw, readers, key_faults(raw, ("values", "weights"), ("values",), _DISCRETE_FORM))
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

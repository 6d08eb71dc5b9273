"""Numbers and names that are drawn, once for the whole of a draw: ``{normal: [11, 0.02]}``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from statistics import NormalDist
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
#: What the numbers of each distribution are.
PARTS = {
    NORMAL: ("mean", "standard deviation"),
    TRUNCATED: ("mean", "standard deviation", "least", "largest"),
    UNIFORM: ("least", "largest"),
    TRIANGULAR: ("least", "most likely", "largest"),
    LOGNORMAL: ("median", "standard deviation of the natural logarithm"),
}
_KINDS = (*PARTS, DISCRETE)
RANGE_KEYS = ("start", "stop", "step", "num", "logspace")
_DISCRETE_FORM = "it is {values: [...], weights: [...]}"
_OF_NAMES = "names are drawn by {discrete: {values: [...], weights: [...]}}"
#: Standard deviations from the mean of a normal distribution beyond which no draw is: those of `LEAST`, and some more.
_REACH = 6.121
#: Probability beyond the bounds of a key up to which a normal distribution is truncated at them.
CUT = 1e-6


@dataclass(frozen=True)
class Drawn(Sweep):
    """A key of a study that is drawn: its values along the dimension ``sample``.

    Before the study is whole, and the design known, its least and its largest value stand for it.

    Parameters
    ----------
    kind : str
        One of the distributions of `PARTS`, or ``discrete``.
    parts : tuple of float
        What `PARTS` lists, in the canonical unit of the key; of ``discrete`` its values, which may be names.
    weights : tuple of float
        Probability of each value of ``discrete``.
    design, column
        Draws of the study, and which of their columns is that of the key.
    cut : float
        Probability that a normal distribution had beyond the bounds of the key, before it was truncated there.
    """

    kind: str
    parts: tuple[Any, ...]
    weights: tuple[float, ...] = ()
    design: Design | None = field(default=None, compare=False, repr=False)
    column: int = field(default=0, compare=False, repr=False)
    cut: float = field(default=0.0, compare=False, repr=False)

    def bind(self, design: Design, column: int) -> None:
        """Tell of which draws it is."""
        object.__setattr__(self, "design", design)
        object.__setattr__(self, "column", column)

    @property
    def holds_names(self) -> bool:
        """True where the values are text and not numbers."""
        return isinstance(self.parts[0], str)

    def __len__(self) -> int:
        return len(self.ends()) if self.design is None else len(self.design)

    def __getitem__(self, index: int | slice) -> Any:
        """Return one value; for a slice an array of numbers or a tuple of names."""
        if not self.holds_names:
            return super().__getitem__(index)
        places = range(len(self))[index]
        found = self.at(np.atleast_1d(places))
        return found[0] if isinstance(places, int) else tuple(found)

    def at(self, index: NDArray[np.int64]) -> NDArray[Any]:
        """Return the values of the given draws, as an array of the same shape."""
        if self.design is None:
            return np.array(self.ends(), object if self.holds_names else float)[index]
        return self.quantile(self.design.at(index.ravel())[:, self.column]).reshape(index.shape)

    def ends(self) -> tuple[Any, ...]:
        """Return the least and the largest value that can be drawn; all names."""
        if self.kind in (NORMAL, LOGNORMAL):
            first, width = self.parts
            reach = width * _REACH
            if self.kind == NORMAL:
                return first - reach, first + reach
            return first * math.exp(-reach), first * math.exp(reach)
        if self.holds_names:
            return self.parts
        if self.kind == DISCRETE:
            return min(self.parts), max(self.parts)
        return (self.parts[2], self.parts[3]) if self.kind == TRUNCATED else (self.parts[0], self.parts[-1])

    def outside(self, low: float, high: float) -> float:
        """Return the probability of values below `low` or above `high`, where they can be drawn; else 0."""
        below, above = self._probability(low), self._probability(high, above=True)
        return sum(mass for mass in (below, above) if mass > LEAST)

    def _probability(self, bound: float, above: bool = False) -> float:
        """Probability of values below, or above, a bound."""
        if math.isinf(bound):
            return 0.0
        first, second = self.parts[0], self.parts[1]
        if self.kind in (NORMAL, LOGNORMAL):
            if self.kind == LOGNORMAL:
                if bound <= 0:
                    return 1.0 if above else 0.0
                first, bound = math.log(first), math.log(bound)
            return 0.5 * math.erfc((bound - first) / second * (1 if above else -1) / math.sqrt(2))
        share = min(1.0, max(0.0, (bound - first) / (self.parts[-1] - first)))
        if self.kind == TRIANGULAR:
            peak = (second - first) / (self.parts[2] - first)
            share = share**2 / peak if share < peak else 1 - (1 - share) ** 2 / (1 - peak) if peak < 1 else share**2
        return 1 - share if above else share

    def quantile(self, probability: NDArray[np.float64]) -> NDArray[Any]:
        """Return the values below which a draw is with the given probabilities; names are in their order."""
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
            from_, to = (low - mean) / deviation, (high - mean) / deviation
            # In the tail where small probabilities are exact.
            sign = -1.0 if from_ > 0 else 1.0
            mass = ndtr(sign * from_) * (1 - probability) + ndtr(sign * to) * probability
            return np.clip(mean + deviation * sign * ndtri(mass), low, high)
        width = self.parts[-1] - first
        if self.kind == UNIFORM:
            return first + width * probability
        peak = (self.parts[1] - first) / width
        rising = np.sqrt(probability * peak)
        return first + width * np.where(probability < peak, rising, 1 - np.sqrt((1 - probability) * (1 - peak)))

    def spec(self) -> dict[str, Any]:
        """Return the distribution as plain data that a study file may hold."""
        if self.kind == DISCRETE:
            return {DISCRETE: {"values": list(self.parts), "weights": list(self.weights)}}
        return {self.kind: list(self.parts)}

    def words(self) -> str:
        """Return the distribution in words: ``normal: mean 11, standard deviation 0.02``."""
        if self.kind == DISCRETE:
            told = [value.replace("_", " ") if self.holds_names else f"{value:g}" for value in self.parts]
            return f"{DISCRETE}: " + ", ".join(
                f"{value} ({weight:.3g})" for value, weight in zip(told, self.weights, strict=True)
            )
        named = (f"{name} {value:g}" for name, value in zip(PARTS[self.kind], self.parts, strict=True))
        return f"{self.kind.replace('_', ' ')}: {', '.join(named)}"


def is_distribution(raw: Any) -> bool:
    """Whether what stands in a study file is a distribution, or a misspelt one."""
    if isinstance(raw, Drawn):
        return True
    if not isinstance(raw, Mapping) or any(key in RANGE_KEYS for key in raw):
        return False
    return any(nearest(str(key), (*_KINDS, *RANGE_KEYS)) in _KINDS for key in raw)


def read_drawn(
    raw: Mapping[str, Any] | Drawn, number: ReadNumber, check: Callable[[float], None], low: float, high: float
) -> Drawn:
    """Read a distribution.

    `number` reads a number in the unit of the key, `check` raises Invalid for one that the key cannot have, `low` and
    `high` are its bounds. Raises Invalid with each fault at its key.
    """
    if isinstance(raw, Drawn):
        raw = raw.spec()
    form = f"a distribution is one of {', '.join(_KINDS)}"
    faults = key_faults(raw, _KINDS, (), form)
    known = [key for key in raw if key in _KINDS]
    faults += [Fault("give one distribution, not several", (key,), show_value=False) for key in known[1:]]
    readers: dict[str, Callable[[Any], Drawn]] = {
        kind: partial(_continuous, kind, number=number, check=check) for kind in PARTS
    }

    def checked(entry: Any) -> float:
        value = number(entry)
        check(value)
        return value

    readers[DISCRETE] = lambda inner: _discrete(inner, checked)
    drawn = read_parts(raw, readers, faults)[known[0]]
    mass = drawn.outside(low, high) if drawn.kind not in (TRUNCATED, DISCRETE) else 0.0
    if drawn.kind == NORMAL and 0 < mass < CUT:
        return _cut(drawn, check, low, high)
    if mass > 0:
        remedy = "truncated_normal: [mean, standard deviation, least, largest]"
        found = f"{100 * mass:.3g} % of the draws" if mass >= CUT else f"a part of {mass:.2g} of the draws"
        try:
            for value in drawn.ends():
                check(value)
        except Invalid as error:
            bounds = error.faults[0].message
            message = f"{bounds}, and {found} would not be; take {remedy}, or another distribution"
            raise Invalid(Fault(message, (drawn.kind,))) from None
    return drawn


def _cut(drawn: Drawn, check: Callable[[float], None], low: float, high: float) -> Drawn:
    """Return a normal distribution without its draws beyond the bounds of a key, which exclude none or both ends."""
    ends = []
    for bound, end, inner in zip((low, high), drawn.ends(), (math.inf, -math.inf), strict=True):
        limit = max(bound, end) if inner > 0 else min(bound, end)
        try:
            check(limit)
        except Invalid:
            limit = math.nextafter(limit, inner)
        ends.append(float(limit))
    return Drawn(TRUNCATED, (*drawn.parts, *ends), cut=drawn.outside(low, high))


def read_names(raw: Mapping[str, Any] | Drawn, name: Callable[[Any], str]) -> Drawn:
    """Read names that are drawn; `name` reads one. Raises Invalid with each fault at its key."""
    if isinstance(raw, Drawn):
        raw = raw.spec()
    faults = key_faults(raw, (DISCRETE,), (DISCRETE,), _OF_NAMES)
    found: Drawn = read_parts(raw, {DISCRETE: lambda inner: _discrete(inner, name)}, faults)[DISCRETE]
    return found


def _continuous(kind: str, raw: Any, number: ReadNumber, check: Callable[[float], None]) -> Drawn:

    def part(name: str, entry: Any) -> float:
        value = _plain_number(entry) if "logarithm" in name else number(entry)
        if "deviation" in name and not value > 0:
            raise Invalid(f"the {name} must be greater than 0; a number that does not vary stands by itself")
        if kind == TRUNCATED and name in ("least", "largest"):
            check(value)
        return value

    values = read_numbers(raw, PARTS[kind], part)
    if kind == LOGNORMAL and values[0] <= 0:
        raise Invalid(Fault("the median must be greater than 0", (0,)))
    if kind not in (NORMAL, LOGNORMAL):
        least, largest = (2, 3) if kind == TRUNCATED else (0, len(values) - 1)
        if values[least] >= values[largest]:
            raise Invalid(Fault("the least value must be below the largest", (least,)))
        if kind == TRIANGULAR and not values[0] <= values[1] <= values[2]:
            raise Invalid(Fault("the most likely value must be between the least and the largest", (1,)))
    drawn = Drawn(kind, values)
    if kind == TRUNCATED:
        mean, deviation, low, high = values
        towards = NormalDist(mean, deviation)
        if towards.cdf(high) - towards.cdf(low) < LEAST and min(abs(low - mean), abs(high - mean)) > 6 * deviation:
            raise Invalid(Fault("the limits are more than six standard deviations from the mean", (2,)))
    return drawn


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

    def weight(entry: Any) -> float:
        value = _plain_number(entry)
        if value < 0:
            raise Invalid("must not be negative")
        return value

    readers = {"values": lambda each: _listed(each, read), "weights": lambda each: _listed(each, weight)}
    found = read_parts(raw, readers, key_faults(raw, ("values", "weights"), ("values",), _DISCRETE_FORM))
    values = found["values"]
    weights = found.get("weights", (1 / len(values),) * len(values))
    if len(set(values)) < len(values):
        raise Invalid(Fault("holds a value twice; add their weights", ("values",), show_value=False))
    if len(weights) != len(values):
        raise Invalid(Fault(f"must be as many as the values, {len(values)}", ("weights",)))
    if abs(sum(weights) - 1) > 1e-9:
        raise Invalid(Fault(f"must sum to 1, not to {sum(weights):.10g}", ("weights",)))
    return Drawn(DISCRETE, values, weights)


def _listed(raw: Any, read: Callable[[Any], Any]) -> tuple[Any, ...]:
    if not isinstance(raw, list | tuple) or not raw:
        raise Invalid("must be a list of at least one")
    return tuple(each(raw, read))


def _plain_number(raw: Any) -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float) or not math.isfinite(raw):
        raise Invalid("must be a number without a unit")
    return float(raw)


def json_schema(names: Sequence[str] = ()) -> dict[str, Any]:
    """Return the JSON Schema of a distribution of numbers, or of some `names`."""
    one = {"enum": list(names)} if names else {"type": ["number", "string"]}
    forms: dict[str, Any] = {
        kind: {
            "type": "array",
            "items": one,
            "minItems": len(parts),
            "maxItems": len(parts),
            "description": f"[{', '.join(parts)}]",
        }
        for kind, parts in ({} if names else PARTS).items()
    }
    weights = {"type": "array", "items": {"type": "number", "minimum": 0}, "minItems": 1}
    forms[DISCRETE] = {
        "type": "object",
        "description": "Some values, each with its probability",
        "properties": {"values": {"type": "array", "items": one, "minItems": 1}, "weights": weights},
        "required": ["values"],
        "additionalProperties": False,
    }
    return {
        "type": "object",
        "description": "Swept: drawn from a distribution, see 'sample'",
        "properties": forms,
        "minProperties": 1,
        "maxProperties": 1,
        "additionalProperties": False,
    }

"""Numbers that are fixed, swept or drawn at random: ``{normal: [0, 1.5], samples: 1000, seed: 7}``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from heliosweep.config import units
from heliosweep.config.drawn import NORMAL, RANGE_KEYS, UNIFORM, read_numbers
from heliosweep.config.faults import MAX_FAULTS, Fault, Invalid, nearest
from heliosweep.config.sweep import key_faults, read_parts, read_whole
from heliosweep.config.values import MAX_SEED, Quantity, object_schema

MAX_SAMPLES = 10**9
_PARTS = {NORMAL: ("mean", "standard deviation"), UNIFORM: ("low", "high")}
_KEYS = (*_PARTS, "samples", "seed")
_FORM = "a distribution is {normal: [mean, standard deviation]} or {uniform: [low, high]}"


@dataclass(frozen=True)
class Distribution:
    """Distribution that a number is drawn from.

    Parameters
    ----------
    kind : {"normal", "uniform"}
        Shape of the distribution.
    parts : tuple of float
        Mean and standard deviation, or least and largest value, in the canonical unit of the parameter.
    samples, seed : int, optional
        Number of draws, and what they follow from; None where the study says them elsewhere.
    """

    kind: str
    parts: tuple[float, float]
    samples: int | None = None
    seed: int | None = None

    @property
    def mean(self) -> float:
        """Mean of the distribution."""
        first, second = self.parts
        return first if self.kind == NORMAL else 0.5 * first + 0.5 * second

    @property
    def width(self) -> float:
        """Factor on standard deviates: the standard deviation, or half the span of a uniform distribution.

        Draws are ``mean + width * deviate`` with standard normal deviates, or uniform ones between -1 and 1.
        """
        first, second = self.parts
        return second if self.kind == NORMAL else 0.5 * second - 0.5 * first

    def spec(self) -> dict[str, Any]:
        """Return the distribution as plain data that a study file may hold."""
        drawn = {"samples": self.samples, "seed": self.seed}
        return {self.kind: list(self.parts)} | {key: value for key, value in drawn.items() if value is not None}


@dataclass(frozen=True)
class Uncertain(Quantity):
    """A physical number that is fixed, swept, or drawn from a distribution.

    Bounds hold for numbers and sweeps, for the mean of a normal and for both ends of a uniform distribution; the
    standard deviation is not larger than the larger of the two.
    """

    def read(self, raw: Any) -> Any:
        """Return a number in the canonical unit, a Sweep of them, or a Distribution. Raises Invalid."""
        if isinstance(raw, Distribution):
            raw = raw.spec()
        if isinstance(raw, Mapping) and _means_distribution(raw):
            return self._distribution(raw)
        if isinstance(raw, list | tuple):
            drawn = [position for position, entry in enumerate(raw) if isinstance(entry, Mapping | Distribution)]
            if drawn:
                raise Invalid(Fault("distributions cannot be swept", (position,)) for position in drawn)
        return super().read(raw)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the number: bare, with a unit, swept, or a distribution."""
        fixed = super().json_schema()
        one = {"type": ["number", "string"]}
        most = self._largest()
        width = {"type": "number", "minimum": 0} | ({} if most is None else {"maximum": most})
        drawn = {
            "samples": {"type": "integer", "minimum": 1, "maximum": MAX_SAMPLES, "description": "Number of draws"},
            "seed": {"type": "integer", "minimum": 0, "maximum": MAX_SEED, "description": "What the draws follow from"},
        }
        forms = []
        for kind, second, text in (
            (NORMAL, {"anyOf": [width, {"type": "string"}]}, "Mean and standard deviation"),
            (UNIFORM, one, "Least and largest value"),
        ):
            pair = {"type": "array", "prefixItems": [one, second], "description": text, "minItems": 2, "maxItems": 2}
            forms.append(object_schema(f"Drawn from a {kind} distribution", {kind: pair}, drawn))
        return {"anyOf": [*fixed.get("anyOf", [fixed]), *forms]}

    def _drawn_schemas(self) -> list[dict[str, Any]]:
        return []  # drawn for each mount, not for the study

    def _distribution(self, raw: Mapping[str, Any]) -> Distribution:
        others = [str(key) for key in raw if _names_another(str(key), raw)]
        faults = key_faults({key: value for key, value in raw.items() if key not in others}, _KEYS, (), _FORM)
        faults += [Fault(f"unknown distribution; {_FORM}", (key,), show_value=False) for key in others[:MAX_FAULTS]]
        if NORMAL in raw and UNIFORM in raw:
            faults.append(Fault("give 'normal' or 'uniform', not both", (UNIFORM,), show_value=False))
        elif not faults and not {NORMAL, UNIFORM} & set(raw):
            faults.append(Fault(f"'normal' or 'uniform' is missing: {_FORM}", show_value=False))
        readers: dict[str, Callable[[Any], Any]] = {
            **{kind: partial(self._pair, kind) for kind in _PARTS},
            "samples": lambda value: read_whole(value, 1, MAX_SAMPLES),
            "seed": lambda value: read_whole(value, 0, MAX_SEED),
        }
        values = read_parts(raw, readers, faults)
        kind = NORMAL if NORMAL in values else UNIFORM
        return Distribution(kind, values[kind], values.get("samples"), values.get("seed"))

    def _pair(self, kind: str, raw: Any) -> tuple[float, ...]:
        most = self._largest()

        def part(name: str, entry: Any) -> float:
            value = self._number(entry)
            if name != "standard deviation":
                self._check(value)
            elif value < 0:
                raise Invalid("the standard deviation must not be negative")
            elif most is not None and value > most:
                raise Invalid(f"the standard deviation must be at most {most:g}{units.suffix(self.unit)}")
            return value

        first, second = read_numbers(raw, _PARTS[kind], part)
        if kind == UNIFORM and first > second:
            raise Invalid(Fault("the first number must not be larger than the second", (0,)))
        return first, second

    def _largest(self) -> float | None:
        """The largest magnitude within the bounds, which no standard deviation may exceed; None without bounds."""
        return None if self.ge is None or self.le is None else max(abs(self.ge), abs(self.le))


def _names_another(key: str, raw: Mapping[str, Any]) -> bool:
    """True for a key that names a distribution that there is not, and is no misspelling of one."""
    if key in _KEYS or not isinstance(raw.get(key), list | tuple):
        return False
    meant = nearest(key, _KEYS)
    return meant is None or abs(len(meant) - len(key)) > 2


def _means_distribution(raw: Mapping[str, Any]) -> bool:
    """True for a mapping that is a distribution, or a misspelt one, and no range."""
    if NORMAL in raw or UNIFORM in raw:
        return True
    meant = {nearest(str(key), (*_KEYS, *RANGE_KEYS)) for key in raw}
    return bool(raw) and not meant & set(RANGE_KEYS)

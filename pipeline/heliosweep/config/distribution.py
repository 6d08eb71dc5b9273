"""Numbers that are fixed, swept or drawn at random: ``{normal: [0, 1.5], samples: 1000, seed: 7}``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from heliosweep.config import units
from heliosweep.config.drawn import NORMAL, RANGE_KEYS, UNIFORM, read_numbers
from heliosweep.config.faults import Fault, Invalid, nearest
from heliosweep.config.sweep import key_faults, read_parts, read_whole
from heliosweep.config.values import MAX_SEED, Quantity

MAX_SAMPLES = 10**9
_PARTS = {NORMAL: ("mean", "standard deviation"), UNIFORM: ("low", "high")}
_KEYS = (*_PARTS, "samples", "seed")
_FORM = "a distribution is {normal: [mean, standard deviation]} or {uniform: [low, high]}"


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
        Number of draws and their seed; None if the block specifies them.
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
        """Return the distribution as plain data that a study file may contain."""
        drawn = {"samples": self.samples, "seed": self.seed}
        return {self.kind: list(self.parts)} | {key: value for key, value in drawn.items() if value is not None}


@dataclass(frozen=True)
class Uncertain(Quantity):
    """A physical number that is fixed, swept, or drawn from a distribution for each mount.

    Bounds hold for numbers and sweeps, for the mean of a normal and for both ends of a uniform distribution; the
    standard deviation is at most the larger bound.
    """

    def read(self, raw: Any) -> Any:
        """Return a number in the canonical unit, a Sweep of them, or a Distribution. Raises Invalid."""
        raw = raw.spec() if isinstance(raw, Distribution) else raw
        if isinstance(raw, Mapping) and raw:
            meant = {nearest(str(key), (*_KEYS, *RANGE_KEYS)) for key in raw}
            if {*_PARTS} & {*raw} or not meant & {*RANGE_KEYS}:
                return self._distribution(raw)
        for position, entry in enumerate(raw if isinstance(raw, list | tuple) else ()):
            if isinstance(entry, Mapping | Distribution):
                raise Invalid(Fault("distributions cannot be swept", (position,)))
        return super().read(raw)

    def _distribution(self, raw: Mapping[str, Any]) -> Distribution:
        faults = key_faults(raw, _KEYS, (), _FORM)
        if NORMAL in raw and UNIFORM in raw:
            faults.append(Fault("give 'normal' or 'uniform', not both", (UNIFORM,), show_value=False))
        elif not faults and not {NORMAL, UNIFORM} & set(raw):
            faults.append(Fault(f"'normal' or 'uniform' is missing: {_FORM}", show_value=False))
        readers: dict[str, Any] = {kind: partial(self._pair, kind) for kind in _PARTS}
        readers |= {key: partial(read_whole, least=low, most=high)
                    for key, low, high in (("samples", 1, MAX_SAMPLES), ("seed", 0, MAX_SEED))}  # fmt: skip
        values = read_parts(raw, readers, faults)
        kind = NORMAL if NORMAL in values else UNIFORM
        return Distribution(kind, values[kind], values.get("samples"), values.get("seed"))

    def _pair(self, kind: str, raw: Any) -> tuple[float, ...]:
        largest = max(abs(bound) for bound in (self.ge, self.le, 0.0) if bound is not None)

        def part(name: str, entry: Any) -> float:
            value = self._number(entry)
            if name != "standard deviation":
                self._check(value)
            elif value < 0:
                raise Invalid("the standard deviation must not be negative")
            elif largest and value > largest:
                raise Invalid(f"the standard deviation must be at most {largest:g}{units.suffix(self.unit)}")
            return value

        first, second = read_numbers(raw, _PARTS[kind], part)
        if kind == UNIFORM and first > second:
            raise Invalid(Fault("the first number must not be larger than the second", (0,)))
        return first, second

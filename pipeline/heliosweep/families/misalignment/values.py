"""Kinds of values that only this family has: places of heliostats, lines on the receiver, one of a few numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from heliosweep.config.faults import Fault, Invalid
from heliosweep.config.fields import Parameter
from heliosweep.config.forms import MAX_FAULTS
from heliosweep.config.quantity import Quantity
from heliosweep.config.sweep import Sweep

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Triples(Parameter):
    """A list of different entries of three numbers each, such as ``[[-16, 150, 0], [-60, 300, 0]]``.

    Parameters
    ----------
    names : tuple of str
        What the three numbers of an entry are.
    units : tuple of str
        Their canonical units.
    """

    sweep: bool = field(default=False, kw_only=True)
    names: tuple[str, str, str] = field(kw_only=True)
    units: tuple[str, str, str] = field(kw_only=True)

    @property
    def form(self) -> str:
        """How an entry is written, in words."""
        unit = f", in {self.units[0]}" if len(set(self.units)) == 1 else ""
        return f"[{', '.join(self.names)}]{unit}"

    def read(self, raw: Any) -> tuple[Triple, ...]:
        """Return the entries. Raises Invalid."""
        if not isinstance(raw, list | tuple):
            raise Invalid(f"must be a list of entries {self.form}")
        if not raw:
            raise Invalid(Fault(f"the list is empty: give at least one entry {self.form}", show_value=False))
        entries: dict[Triple, int] = {}
        faults: list[Fault] = []
        for position, item in enumerate(raw):
            if len(faults) > MAX_FAULTS:
                break
            try:
                entry = self._entry(item)
            except Invalid as error:
                faults += error.under(position)
                continue
            if (first := entries.setdefault(entry, position)) != position:
                faults.append(Fault(f"is the same as entry {first} (counted from 0); leave one out", (position,)))
            faults += (Fault(fault.message, (position, *fault.path)) for fault in self.entry_faults(entry))
        if faults:
            raise Invalid(faults)
        return tuple(entries)

    def entry_faults(self, entry: Triple) -> Iterator[Fault]:
        """Yield what is wrong with an entry of three good numbers."""
        yield from ()

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the list."""
        entry = {"type": "array", "items": {"type": ["number", "string"]}, "minItems": 3, "maxItems": 3}
        return {"type": "array", "items": entry | {"description": self.form}, "minItems": 1, "uniqueItems": True}

    def _entry(self, raw: Any) -> Triple:
        if not isinstance(raw, list | tuple) or len(raw) != 3:
            raise Invalid(f"must be three numbers {self.form}")
        numbers: list[float] = []
        faults: list[Fault] = []
        for position, (unit, item) in enumerate(zip(self.units, raw, strict=True)):
            try:
                number = Quantity("", unit, sweep=False).read(item)
                assert not isinstance(number, Sweep)
                numbers.append(number)
            except Invalid as error:
                faults += error.under(position)
        if faults:
            raise Invalid(faults)
        return numbers[0], numbers[1], numbers[2]


@dataclass(frozen=True)
class Lines(Triples):
    """Lines ``l0 Y + l1 Z = l2`` on the receiver's plane."""

    def entry_faults(self, entry: Triple) -> Iterator[Fault]:
        """The first two numbers are the direction across the line: not both may be zero."""
        if entry[0] == 0.0 and entry[1] == 0.0:
            yield Fault("is no line: its first two numbers must not both be zero")


@dataclass(frozen=True)
class OneOf(Quantity):
    """One of a few numbers.

    Parameters
    ----------
    options : tuple of int
        The numbers.
    """

    options: tuple[int, ...] = field(default=(), kw_only=True)

    def bounds(self) -> str:
        """Return the numbers in words."""
        *most, last = map(str, self.options)
        return f"{', '.join(most)} or {last}"

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the number, or of a list of them."""
        one = {"enum": list(self.options)}
        listed = {"type": "array", "items": one, "minItems": 1, "uniqueItems": True, "description": "Swept: a list"}
        return {"anyOf": [one, listed]} if self.sweep else one

    def _check(self, value: float) -> None:
        if value not in self.options:
            raise Invalid(f"must be {self.bounds()}")

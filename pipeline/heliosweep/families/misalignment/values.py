"""Kinds of values that only this family has: lines on the receiver, one of a few numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from heliosweep.config.faults import Fault, Invalid
from heliosweep.config.values import ListOfNumbers, Quantity

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Lines(ListOfNumbers):
    """Lines ``l0 Y + l1 Z = l2`` on the receiver's plane."""

    def entry_faults(self, entry: tuple[float, ...]) -> Iterator[Fault]:
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

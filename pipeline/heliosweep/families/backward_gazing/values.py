"""Kinds of values that only this family has: pairs of numbers, lists of pairs, lists of names that are no sweep."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from heliosweep.config.faults import Fault, Invalid
from heliosweep.config.fields import Parameter
from heliosweep.config.forms import MAX_FAULTS, read_items
from heliosweep.config.names import Choice
from heliosweep.config.quantity import Quantity
from heliosweep.config.sweep import Listed, Sweep

Two = tuple[float, float]


@dataclass(frozen=True)
class Pair(Parameter):
    """Two numbers of one unit, such as ``[0, -1]``.

    Parameters
    ----------
    unit : str
        Canonical unit of both.
    names : tuple of str
        What they are.
    gt, ge, le : float, optional
        Bounds of both, in `unit`.
    """

    unit: str
    names: tuple[str, str]
    sweep: bool = field(default=False, kw_only=True)
    gt: float | None = field(default=None, kw_only=True)
    ge: float | None = field(default=None, kw_only=True)
    le: float | None = field(default=None, kw_only=True)

    @property
    def purpose(self) -> str:
        """The description, the two names and the unit."""
        return f"{self.description}, {self.form}"

    @property
    def form(self) -> str:
        """How a pair is written, in words."""
        return f"[{', '.join(self.names)}]" + ("" if self.unit == "1" else f" in {self.unit}")

    def read(self, raw: Any) -> Any:
        """Return the pair. Raises Invalid."""
        return self._pair(raw)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the pair."""
        one = self._number.json_schema()
        return {"type": "array", "items": one, "minItems": 2, "maxItems": 2}

    @property
    def _number(self) -> Quantity:
        return Quantity("", self.unit, gt=self.gt, ge=self.ge, le=self.le, sweep=False)

    def _pair(self, raw: Any) -> Two:
        if not isinstance(raw, list | tuple) or len(raw) != 2:
            raise Invalid(f"must be two numbers {self.form}")
        numbers: list[float] = []
        faults: list[Fault] = []
        for position, item in enumerate(raw):
            try:
                number = self._number.read(item)
                assert not isinstance(number, Sweep)
                numbers.append(number)
            except Invalid as error:
                faults += error.under(position)
        if faults:
            raise Invalid(faults)
        return numbers[0], numbers[1]


@dataclass(frozen=True)
class Pairs(Pair):
    """A list of so many different pairs, such as ``[[-0.1, 0.1], [0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]]``.

    Parameters
    ----------
    number : int
        How many.
    """

    number: int = field(default=4, kw_only=True)

    def read(self, raw: Any) -> tuple[Two, ...]:
        """Return the pairs. Raises Invalid."""
        if not isinstance(raw, list | tuple) or len(raw) != self.number:
            raise Invalid(f"must be a list of {self.number} entries {self.form}")
        entries: dict[Two, int] = {}
        faults: list[Fault] = []
        for position, item in enumerate(raw):
            try:
                entry = self._pair(item)
            except Invalid as error:
                faults += error.under(position)
                continue
            if (first := entries.setdefault(entry, position)) != position:
                faults.append(Fault(f"is the same as entry {first} (counted from 0)", (position,)))
        if faults:
            raise Invalid(faults[:MAX_FAULTS])
        return tuple(entries)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the list."""
        pair = super().json_schema() | {"description": self.form}
        return {"type": "array", "items": pair, "minItems": self.number, "maxItems": self.number}


@dataclass(frozen=True)
class Names(Choice):
    """One or several of some names, in the order in which they are written; a dimension in any case, never a sweep."""

    sweep: bool = field(default=False, kw_only=True)

    def read(self, raw: Any) -> Any:
        """Return the names as a tuple. Raises Invalid."""
        if isinstance(raw, Listed):
            raw = raw.items
        return read_items(raw if isinstance(raw, list | tuple) else [raw], self._one)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a name or a list of them."""
        one = {"enum": list(self.options)}
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1, "uniqueItems": True}]}


def module_number(key: str) -> int | None:
    """Number that a key of ``defects.canting`` stands for; None where it is none."""
    return int(key) if key.isascii() and key.isdigit() and len(key) < 6 and key[0] != "0" else None


def with_file(raw: Any) -> Any:
    """An image that is written as the name of its file alone, in full: ``a.npy`` is ``{file: a.npy}``."""
    return {"file": raw} if isinstance(raw, str) and not isinstance(raw, Mapping) else raw

"""Values of several numbers that belong together: ``[0, -1]``, and lists of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from heliosweep.config.faults import Fault, Invalid
from heliosweep.config.forms import MAX_FAULTS
from heliosweep.config.values import Parameter, Quantity

_COUNTS = ("no", "one", "two", "three", "four")


@dataclass(frozen=True)
class Numbers(Parameter):
    """As many numbers as there are names, such as ``[0, -1]``.

    Parameters
    ----------
    units : str or tuple of str
        Canonical unit of all, or of each.
    names : tuple of str
        What they are.
    gt, ge, le : float, optional
        Bounds of all.
    """

    units: str | tuple[str, ...]
    names: tuple[str, ...]
    sweep: bool = field(default=False, kw_only=True)
    gt: float | None = field(default=None, kw_only=True)
    ge: float | None = field(default=None, kw_only=True)
    le: float | None = field(default=None, kw_only=True)

    @property
    def purpose(self) -> str:
        """The description, the names and the unit."""
        return f"{self.description}, {self.form}"

    @property
    def form(self) -> str:
        """The written form of the numbers, in words."""
        unit = f" in {self.units}" if isinstance(self.units, str) and self.units != "1" else ""
        return f"[{', '.join(self.names)}]{unit}"

    def read(self, raw: Any) -> Any:
        """Return the numbers as a tuple. Raises Invalid."""
        return self._numbers(raw)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the numbers."""
        parts = [part.json_schema() for part in self._parts()]
        one = parts[0] if isinstance(self.units, str) else {"type": ["number", "string"]}
        return {"type": "array", "items": one, "minItems": len(parts), "maxItems": len(parts)}

    def _parts(self) -> list[Quantity]:
        units = [self.units] * len(self.names) if isinstance(self.units, str) else self.units
        return [Quantity("", unit, gt=self.gt, ge=self.ge, le=self.le, sweep=False) for unit in units]

    def _numbers(self, raw: Any) -> tuple[float, ...]:
        parts = self._parts()
        if not isinstance(raw, list | tuple) or len(raw) != len(parts):
            raise Invalid(f"must be {_COUNTS[len(parts)]} numbers {self.form}")
        numbers: list[Any] = []
        faults: list[Fault] = []
        for position, (part, item) in enumerate(zip(parts, raw, strict=True)):
            try:
                numbers.append(part.read(item))
            except Invalid as error:
                faults += error.under(position)
        if faults:
            raise Invalid(faults)
        return tuple(numbers)


@dataclass(frozen=True)
class ListOfNumbers(Numbers):
    """A list of different entries of several numbers, such as ``[[-16, 150, 0], [-60, 300, 0]]``.

    Parameters
    ----------
    entries : int, optional
        How many; any number but none where left out.
    """

    entries: int | None = field(default=None, kw_only=True)

    def read(self, raw: Any) -> tuple[tuple[float, ...], ...]:
        """Return the entries. Raises Invalid."""
        count = "" if self.entries is None else f"{self.entries} "
        if not isinstance(raw, list | tuple) or (self.entries is not None and len(raw) != self.entries):
            raise Invalid(f"must be a list of {count}entries {self.form}")
        if not raw:
            raise Invalid(Fault(f"the list is empty: give at least one entry {self.form}", show_value=False))
        found: dict[tuple[float, ...], int] = {}
        faults: list[Fault] = []
        for position, item in enumerate(raw):
            if len(faults) > MAX_FAULTS:
                break
            try:
                entry = self._numbers(item)
            except Invalid as error:
                faults += error.under(position)
                continue
            if (first := found.setdefault(entry, position)) != position:
                faults.append(Fault(f"is the same as entry {first} (counted from 0); leave one out", (position,)))
            faults += (Fault(fault.message, (position, *fault.path)) for fault in self.entry_faults(entry))
        if faults:
            raise Invalid(faults)
        return tuple(found)

    def entry_faults(self, entry: tuple[float, ...]) -> Iterator[Fault]:
        """Yield what is wrong with an entry of good numbers."""
        yield from ()

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the list."""
        least = {"minItems": self.entries or 1} | ({} if self.entries is None else {"maxItems": self.entries})
        return {
            "type": "array",
            "items": super().json_schema() | {"description": self.form},
            "uniqueItems": True,
        } | least

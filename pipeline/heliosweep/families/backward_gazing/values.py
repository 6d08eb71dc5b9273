"""Kinds of values that only this family has: lists of names that are no sweep, numbers of modules, names of images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from heliosweep.config.sweep import Listed, read_items
from heliosweep.config.values import Choice

Two = tuple[float, float]


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

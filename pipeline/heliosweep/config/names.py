"""Values that are words: names to choose from, files, text, and true or false."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from heliosweep.config.faults import Invalid, did_you_mean, one_of
from heliosweep.config.fields import Parameter, list_schema
from heliosweep.config.forms import read_items
from heliosweep.config.sweep import Listed, Sweep


@dataclass(frozen=True)
class Choice(Parameter):
    """One of several names.

    Parameters
    ----------
    options : mapping of str to str, or sequence of str
        The names, and what each means.
    """

    options: Mapping[str, str] | Sequence[str] = field(hash=False)

    @property
    def purpose(self) -> str:
        """The description and what each name means."""
        if not isinstance(self.options, Mapping):
            return self.description
        meanings = "; ".join(f"{name}: {meaning}" for name, meaning in self.options.items())
        return f"{self.description} ({meanings})"

    def read(self, raw: Any) -> str | Sweep:
        """Return the name, or a sweep of names. Raises Invalid."""
        return _name_or_names(raw, self._one, self.sweep)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the name, or of a list of names."""
        one = {"enum": list(self.options)}
        return {"anyOf": [one, list_schema(one)]} if self.sweep else one

    def _one(self, raw: Any) -> str:
        if not isinstance(raw, str):
            raise Invalid(f"must be {one_of(self.options)}")
        if raw not in self.options:
            hint = did_you_mean(raw, self.options) or f"; use {one_of(self.options)}"
            raise Invalid(f"unknown choice{hint}")
        return raw


@dataclass(frozen=True)
class FileName(Parameter):
    """Name of a table, relative to the study file: text in which empty lines and those with ``#`` say nothing."""

    def read(self, raw: Any) -> str | Sweep:
        """Return the name as given, or a sweep of names. Raises Invalid."""
        return _name_or_names(raw, self._one, self.sweep)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the name, or of a list of names."""
        one = {"type": "string", "minLength": 1}
        return {"anyOf": [one, list_schema(one)]} if self.sweep else one

    def _one(self, raw: Any) -> str:
        if not isinstance(raw, str) or not raw.strip():
            raise Invalid("must be the name of a file, relative to the study file")
        return raw


@dataclass(frozen=True)
class Text(Parameter):
    """Free text on one or more lines."""

    def read(self, raw: Any) -> str:
        """Return the text. Raises Invalid."""
        if not isinstance(raw, str):
            hint = "; write it in quotes" if isinstance(raw, int | float) else ""
            raise Invalid(f"must be text{hint}")
        if not raw.strip():
            raise Invalid("must not be empty")
        return raw

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of text."""
        return {"type": "string", "minLength": 1}


@dataclass(frozen=True)
class Flag(Parameter):
    """Yes or no, written ``true`` or ``false``."""

    def read(self, raw: Any) -> bool:
        """Return the flag. Raises Invalid."""
        if not isinstance(raw, bool):
            raise Invalid("must be true or false")
        return raw

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a flag."""
        return {"type": "boolean"}


def _name_or_names(raw: Any, read: Callable[[Any], str], sweep: bool) -> str | Sweep:
    if not isinstance(raw, Listed | list | tuple):
        return read(raw)
    if not sweep:
        raise Invalid("must be a single value; it cannot be swept")
    return Listed(read_items(raw.items if isinstance(raw, Listed) else raw, read))

"""The base of every block of a study file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Self, get_args

from pydantic import BaseModel, ConfigDict, model_validator

from heliosweep.config.faults import Fault, to_pydantic
from heliosweep.config.fields import Parameter


class Block(BaseModel):
    """A mapping of a study file: frozen, with known keys only.

    A subclass declares its keys as annotated fields and may state in :meth:`rules` what must hold between
    them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    def rules(self) -> Iterable[Fault]:
        """Yield what is wrong between the keys of this block; runs when each of them is right by itself."""
        return ()

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to change a key, in words: a study is what it was when it was checked."""
        if name in type(self).model_fields:
            raise AttributeError(f"{name}: a study does not change; make another one, with heliosweep.study or load")
        super().__setattr__(name, value)

    @model_validator(mode="after")
    def _keep_rules(self) -> Self:
        if faults := list(self.rules()):
            raise to_pydantic(faults)
        return self

    @classmethod
    def parameter(cls, key: str) -> Parameter | None:
        """Return what the field `key` was declared with, a Quantity for instance; None for blocks and lists."""
        return next((item for item in cls.model_fields[key].metadata if isinstance(item, Parameter)), None)

    @classmethod
    def literals(cls, key: str) -> tuple[str, ...]:
        """Return the values that the field `key` allows if it is a Literal, as ``clock: solar``; none otherwise."""
        return get_args(cls.model_fields[key].annotation) if key in cls.model_fields else ()


def blocks_at(block: type[Block], location: Iterable[int | str]) -> list[type[Block]]:
    """Return the classes that the block at a place within another may have.

    Parameters
    ----------
    block : type of Block
        Where to start.
    location : iterable of int or str
        Keys, list positions and, as pydantic reports them, tags of unions (``solar`` for instance).
    """
    candidates = [block]
    for part in location:
        if isinstance(part, int):
            continue
        fields = [candidate.model_fields[part] for candidate in candidates if part in candidate.model_fields]
        if fields:
            candidates = [inner for field in fields for inner in _blocks_in(field.annotation)]
        else:
            tagged = [one for one in candidates if any(part in one.literals(key) for key in one.model_fields)]
            candidates = tagged or candidates
    return candidates


def _blocks_in(annotation: Any) -> Iterator[type[Block]]:
    if isinstance(annotation, type) and issubclass(annotation, Block):
        yield annotation
    for argument in get_args(annotation):
        yield from _blocks_in(argument)

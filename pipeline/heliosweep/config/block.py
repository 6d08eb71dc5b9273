"""The base of every block of a study file, and pydantic's errors as located problems."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Literal, Self, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails

from heliosweep.config.faults import SYNONYMS, Fault, Path, in_short, nearest, one_of, shown, to_pydantic
from heliosweep.config.source import Source
from heliosweep.config.values import Parameter
from heliosweep.errors import Problem

UNKNOWN_KEY = "unknown key"
#: Value of a path that the file does not have.
_ABSENT = object()
_MAPPING = "must be a mapping of keys to values"
_MESSAGES = {
    "model_type": _MAPPING,
    "model_attributes_type": _MAPPING,
    "dict_type": _MAPPING,
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "too_short": "must not be empty",
    "invalid_key": "keys must be text",
    "string_type": "must be text",
    "bool_type": "must be true or false",
    "int_type": "must be a whole number",
    "float_type": "must be a number",
}


class Block(BaseModel):
    """A mapping of a study file: frozen, with known keys only.

    A subclass declares its keys as annotated fields and may state in :meth:`rules` what must hold between
    them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    def rules(self) -> Iterable[Fault]:
        """Yield the faults between the keys of this block; runs when each key is valid."""
        return ()

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to change a key: a study is immutable after its checks."""
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
        """Return the declaration of the field `key`, such as a Quantity; None for blocks and lists."""
        return next((item for item in cls.model_fields[key].metadata if isinstance(item, Parameter)), None)

    @classmethod
    def literals(cls, key: str) -> tuple[str, ...]:
        """Return the values that the field `key` allows if it is a Literal, as ``clock: solar``; none otherwise."""
        annotation = cls.model_fields[key].annotation if key in cls.model_fields else None
        return get_args(annotation) if get_origin(annotation) is Literal else ()


def blocks_at(block: type[Block], location: Iterable[int | str]) -> list[type[Block]]:
    """Return the classes that the block at a place within another may have.

    The place has keys, list positions and, as pydantic reports them, tags of unions (``solar`` for instance).
    """
    candidates = [block]
    for part in location:
        if isinstance(part, int):
            continue
        fields = [candidate.model_fields[part] for candidate in candidates if part in candidate.model_fields]
        if fields:
            candidates = [inner for field in fields for inner in blocks_in(field.annotation)]
        else:
            tagged = [one for one in candidates if any(part in one.literals(key) for key in one.model_fields)]
            candidates = tagged or candidates
    return candidates


def declares(block: type[Block], key: str) -> bool:
    """Return whether a block, or a block within it, has a field of a dotted key."""
    name, _, rest = key.partition(".")
    field = block.model_fields.get(name)
    return field is not None and (not rest or any(declares(inner, rest) for inner in blocks_in(field.annotation)))


def blocks_in(annotation: Any) -> Iterator[type[Block]]:
    """Yield the classes of blocks that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, Block):
        yield annotation
    for argument in get_args(annotation):
        yield from blocks_in(argument)


def translate(error: ValidationError, block: type[Block], source: Source) -> Iterator[Problem]:
    """Yield a problem for each error of validating `source.data` as a block; none for consequences of another."""
    errors = [(details, *_located(details, source.data)) for details in error.errors(include_url=False)]
    meant: set[Path] = set()  # keys with a typo in the file: not reported as missing too
    for details, path, _ in errors:
        if details["type"] == "extra_forbidden":
            known = [key for inner in blocks_at(block, details["loc"][:-1]) for key in inner.model_fields]
            key, hint = _meant(str(path[-1]), known)
            meant.add((*path[:-1], key))
            yield source.problem(path, f"{UNKNOWN_KEY}{hint}", at_key=True)
    for details, path, value in errors:
        kind = details["type"]
        if kind == "extra_forbidden" or path in meant:
            continue
        message = _message(details, block)
        if kind.startswith("union_tag"):
            tag = details["ctx"]["discriminator"].strip("'")
            path, value = (*path, tag), value.get(tag, _ABSENT) if isinstance(value, dict) else _ABSENT
        if kind in ("missing", "rule") or value is _ABSENT:
            if not (kind == "rule" and isinstance(value, dict) and None in value.values()):
                yield source.problem(path, message)
        elif value is not None and not (kind == "too_short" and value):  # empty keys and wrong entries are reported
            yield source.problem(path, f"{message} (got {shown(value)})")


def _message(details: ErrorDetails, block: type[Block]) -> str:
    """Return the message for an error of pydantic."""
    kind, context = details["type"], details.get("ctx", {})
    if kind in ("fault", "rule"):
        return details["msg"]
    if kind == "missing":
        return f"is missing{_purpose(block, details)}"
    if kind == "literal_error":
        return f"must be {context['expected']}"
    if not kind.startswith("union_tag"):
        return _MESSAGES.get(kind, "is not valid here")
    tag = context["discriminator"].strip("'")
    names = [name for inner in blocks_at(block, details["loc"]) for name in inner.literals(tag)]
    return f"{'is missing:' if kind == 'union_tag_not_found' else 'must be'} {one_of(names)}"


def _located(details: ErrorDetails, data: Any) -> tuple[Path, Any]:
    """Return the path in the file, and the value; the location of pydantic also names the chosen members of unions."""
    location, path = details["loc"], list[str | int]()
    for position, part in enumerate(location):
        if isinstance(part, int) if isinstance(data, list | tuple) else isinstance(data, dict) and part in data:
            data = data[part]
            path.append(part)
        elif position == len(location) - 1 and details["type"] in ("missing", "extra_forbidden"):
            path.append(part)
    return tuple(path), data


def _meant(word: str, known: Sequence[str]) -> tuple[str, str]:
    """Return the known key that was probably meant, or no text, and the hint for the user."""
    glued = re.match(r"(\w+)[\s:=]+(\S.*)", word)
    if glued and glued[1] in known:
        return glued[1], f"; write '{glued[1]}: {in_short(glued[2])}', with a colon and a space"
    if re.fullmatch(r"[-+.\d]+", word):
        return "", "; write several values in brackets, as [1, 2.5], and decimals with a point"
    if remedy := SYNONYMS.get(word.casefold()):
        return "", f"; {remedy}"
    key = nearest(word, known)
    return key or "", f"; did you mean '{key}'?" if key else ""


def _purpose(block: type[Block], details: ErrorDetails) -> str:
    """Return a colon and the purpose of a missing key."""
    key = str(details["loc"][-1])
    for inner in blocks_at(block, details["loc"][:-1]):
        if key in inner.model_fields:
            parameter, description = inner.parameter(key), inner.model_fields[key].description
            return f": {parameter.purpose if parameter else description or one_of(inner.literals(key))}"
    return ""

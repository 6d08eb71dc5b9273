"""The base of every block of a study file, and what pydantic finds wrong with one in the words of this project."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Self, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails

from heliosweep.config.faults import SYNONYMS, Fault, Path, in_short, nearest, one_of, shown, to_pydantic
from heliosweep.config.source import Source
from heliosweep.config.values import Parameter
from heliosweep.errors import Problem

UNKNOWN_KEY = "unknown key"
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
    """Yield a problem for each error of validating `source.data` as a block; none for what follows from another."""
    errors = error.errors(include_url=False)
    meant: set[Path] = set()  # keys that stand in the file with a typo: not reported as missing too
    for details in errors:
        if details["type"] == "extra_forbidden":
            path = _path(details, source.data)
            key, hint = _meant(str(path[-1]), _known_keys(block, details))
            meant.add((*path[:-1], key))
            yield source.problem(path, f"{UNKNOWN_KEY}{hint}", at_key=True)
    for details in errors:
        kind, path = details["type"], _path(details, source.data)
        if kind == "extra_forbidden" or path in meant:
            continue
        if kind == "missing":
            yield source.problem(path, f"is missing{_purpose(block, details)}")
        elif kind == "rule":
            if not _holds_null(source.value(path)):
                yield source.problem(path, details["msg"])
        elif kind == "union_tag_not_found":
            key = details["ctx"]["discriminator"].strip("'")
            names = (name for inner in blocks_at(block, details["loc"]) for name in inner.literals(key))
            yield source.problem((*path, key), f"is missing: {one_of(names)}")
        else:
            yield from _wrong_value(details, path, source)


def _wrong_value(details: ErrorDetails, path: Path, source: Source) -> Iterator[Problem]:
    kind, context = details["type"], details.get("ctx", {})
    if kind == "union_tag_invalid":
        path = (*path, context["discriminator"].strip("'"))
        tags = [tag.strip(" '") for tag in context["expected_tags"].split(",")]
        message = f"must be {one_of(tags)}"
    elif kind == "fault":
        message = details["msg"]
    elif kind == "literal_error":
        message = f"must be {context['expected']}"
    else:
        message = _MESSAGES.get(kind, "is not valid here")
    try:
        value = source.value(path)
    except (KeyError, IndexError, TypeError):
        yield source.problem(path, message)
        return
    follows = kind == "too_short" and value  # the list holds entries, but wrong ones
    if value is not None and not follows:  # that nothing is given is reported elsewhere
        yield source.problem(path, f"{message} (got {shown(value)})")


def _path(details: ErrorDetails, data: Any) -> Path:
    """Return the path in the file; the location of pydantic also names the chosen members of unions."""
    location = details["loc"]
    ends_with_key = details["type"] in ("missing", "extra_forbidden")
    path: list[str | int] = []
    for position, part in enumerate(location):
        in_list = isinstance(data, list | tuple) and isinstance(part, int)
        if in_list or (isinstance(data, dict) and part in data):
            data = data[part]
            path.append(part)
        elif ends_with_key and position == len(location) - 1:
            path.append(part)
    return tuple(path)


def _holds_null(data: Any) -> bool:
    return isinstance(data, dict) and None in data.values()


def _known_keys(block: type[Block], details: ErrorDetails) -> list[str]:
    return [key for inner in blocks_at(block, details["loc"][:-1]) for key in inner.model_fields]


def _meant(word: str, known: Sequence[str]) -> tuple[str, str]:
    """Return the known key that was probably meant, or nothing, and the hint for the user."""
    glued = re.match(r"(\w+)[\s:=]+(\S.*)", word)
    if glued and glued[1] in known:
        return glued[1], f"; write '{glued[1]}: {in_short(glued[2])}', with a colon and a space"
    if re.fullmatch(r"[-+.\d]+", word):
        return "", "; several values stand in brackets, as [1, 2.5], and decimals follow a point"
    if remedy := SYNONYMS.get(word.casefold()):
        return "", f"; {remedy}"
    key = nearest(word, known)
    return key or "", f"; did you mean '{key}'?" if key else ""


def _purpose(block: type[Block], details: ErrorDetails) -> str:
    """Return ``: what the missing key is for``."""
    *outer, key = details["loc"]
    for inner in blocks_at(block, outer):
        if key in inner.model_fields:
            parameter = inner.parameter(str(key))
            purpose = parameter.purpose if parameter else inner.model_fields[str(key)].description
            return f": {purpose or one_of(inner.literals(str(key)))}"
    return ""

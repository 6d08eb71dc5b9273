"""What a run writes of itself as JSON, read as anybody may have left it: of the right shape, or a `ValueError`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

#: Nesting that no record has, and that functions which walk through one cannot bear. [levels]
_DEEP = 100

#: Of what stands there instead, so much is told. [characters]
_LONG = 200

Count = Annotated[int, Field(ge=1, le=2**63)]
#: Identifiers and dates: printed as they are.
Word = Annotated[str, Field(pattern="^[ -~]{0,64}$")]
Cut = dict[Literal["points", "series", "storage"], dict[str, Count]]


class Record(BaseModel):
    """Keys that are relied on; others are let through."""

    model_config = ConfigDict(strict=True, extra="allow")


class Identity(Record):
    """What a result belongs to, as `store.identity.identity_of` says it."""

    study_id: Word = ""
    study: dict[str, Any] = {}
    code: dict[str, Any] = {}
    output: dict[str, Any] = {}
    attributes: dict[str, Any] = {}


class Store(Identity):
    """A working store, as its ``study.json`` says it."""

    format: int
    variables: Annotated[list[str], Field(min_length=1)]
    metadata: str
    cut: Cut
    parts: Count | None = None
    forced: bool = False


class Result(Record):
    """The result that a manifest is of."""

    file: Literal["result.nc", "result.zarr"]
    sha256: str
    bytes: Annotated[int, Field(ge=0, le=2**63)] = 0
    content_digest: str = ""


class Parts(Record):
    """Its parts."""

    cut: Cut
    digests: dict[str, str]
    variables: list[str] = []


class Manifest(Record):
    """A ``manifest.json``."""

    result: Result
    study_id: Word = ""
    identity: Identity | None = None
    parts: Parts | None = None
    finished: Word = ""


def read_json(path: Path) -> Any:
    """Content of a file.

    Raises
    ------
    OSError
        It cannot be read.
    ValueError
        It is no JSON, or nested deeper than anything that a run writes.
    """
    if path.is_fifo():  # would be waited for
        raise ValueError("it is a pipe and no file")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    level = [content]
    for _ in range(_DEEP):
        level = [entry for item in level for entry in _entries(item)]
        if not level:
            return content
    raise ValueError("it is nested too deeply")


def check(content: Any, shape: type[Record]) -> dict[str, Any]:
    """Return what was read if it has a shape.

    Raises
    ------
    ValueError
        It has not; says what is wrong first.
    """
    try:
        shape.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        said = first["msg"][:1].lower() + first["msg"][1:]
        place = ".".join(map(str, first["loc"]))[:_LONG]
        raise ValueError(f"{place}: {said[:_LONG]}" if place else said[:_LONG]) from None
    return dict(content)


def _entries(item: Any) -> Any:
    return item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()

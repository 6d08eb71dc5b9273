"""The JSON Schema of study files for editors, in which a search stands for the keys that it varies."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Iterator
from typing import Any

from heliosweep.config.search import searchable
from heliosweep.config.study import Study, json_schema

Schema = dict[str, Any]

_REFERENCE = re.compile(r'"#/\$defs/([^"]+)"')


def editor_schema(study_class: type[Study]) -> Schema:
    """Return the JSON Schema of the study files of a family; keys that a search varies may be missing."""
    schema = json_schema(study_class)
    defs, keys = schema.pop("$defs"), searchable(study_class)
    schema["allOf"] = [
        {"if": _searched(varied), "else": _required(path)} for path, varied in _waived(schema, defs, keys)
    ]
    schema["$defs"] = {}
    while missing := set(_REFERENCE.findall(json.dumps(schema))) - schema["$defs"].keys():
        schema["$defs"] |= {name: defs[name] for name in sorted(missing)}
    return schema


def _waived(
    block: Schema, defs: Schema, keys: Any, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Take away what a block needs but a search may vary; yield its place, and the keys that must be varied for it."""
    for name, inner in block["properties"].items():
        if "$ref" in inner:
            block["properties"][name] = copy.deepcopy(defs[inner["$ref"].rpartition("/")[2]]) | inner
            del block["properties"][name]["$ref"]
    for name in list(block.get("required", ())):
        varied = _needed(block["properties"][name], defs, keys, (*path, name))
        if varied:
            block["required"].remove(name)
            yield (*path, name), varied
    for name, inner in block["properties"].items():
        if "properties" in inner:
            yield from _waived(inner, defs, keys, (*path, name))


def _needed(entry: Schema, defs: Schema, keys: Any, path: tuple[str, ...]) -> list[str]:
    """Keys that must be varied if an entry is missing: itself, or all that a block needs; none where nothing helps."""
    if ".".join(path) in keys:
        return [".".join(path)]
    block = defs[entry["$ref"].rpartition("/")[2]] if "$ref" in entry else entry
    inner = [_needed(block["properties"][name], defs, keys, (*path, name)) for name in block.get("required", ())
             if "properties" in block]  # fmt: skip
    return [key for each in inner for key in each] if all(inner) and "anyOf" not in block else []


def _searched(keys: list[str]) -> Schema:
    """Condition that a search varies these keys."""
    return {
        "required": ["search"],
        "properties": {"search": {"required": ["over"], "properties": {"over": {"required": keys}}}},
    }


def _required(path: tuple[str, ...]) -> Schema:
    """Condition that an entry is there, if its block is."""
    *outer, name = path
    schema: Schema = {"required": [name]}
    for block in reversed(outer):
        schema = {"properties": {block: schema}}
    return schema

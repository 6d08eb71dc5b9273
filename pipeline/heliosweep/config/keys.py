"""The keys of a family's study files with what may stand there, from its JSON Schema."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from heliosweep.config.block import Block, blocks_at
from heliosweep.config.values import Samples

Schema = dict[str, Any]

_UNIT = re.compile(r"\s*\[([^\[\],]+)\]$")
_OPTIONS = re.compile(r"\s*\((\w[\w-]*: .*)\)$", re.DOTALL)


class Key:
    """One key of a study file.

    Parameters
    ----------
    name : str
        Dotted; ``[]`` stands for any item of a list, ``<name>`` for a name of one's own.
    schema : dict
        Its part of the JSON Schema, references followed.
    required : bool
        Whether its block needs it.

    Attributes
    ----------
    meaning, unit : str
        What it is, and in what a bare number is.
    options : list of tuple of str
        Names that may stand there, and what each means.
    only : str
        The kind of block that has it, where others at the same place have not.
    """

    def __init__(self, name: str, schema: Schema, required: bool) -> None:
        self.name, self.schema, self.required = name, schema, required
        self.only = ""
        text = str(schema.get("description", ""))
        unit = _UNIT.search(text)
        self.unit = unit.group(1) if unit else ""
        text = _UNIT.sub("", text)
        options = _OPTIONS.search(text)
        self.meaning = text[: options.start()] if options else text
        self.options: list[tuple[str, str]] = []
        for option in re.split(r"; (?=[\w-]+: )", options.group(1)) if options else ():
            name, _, meaning = option.partition(": ")
            self.options.append((name, meaning))

    @property
    def swept(self) -> bool:
        """Whether a sweep may stand in place of a value."""
        return any(str(form.get("description", "")).startswith("Swept") for form in _forms(self.schema))

    @property
    def default(self) -> str:
        """The default as YAML; empty where there is none."""
        if "default" not in self.schema:
            return ""
        value = self.schema["default"]
        if isinstance(value, dict):
            return ""
        if isinstance(value, bool):
            return f"`{str(value).lower()}`"
        if isinstance(value, int | float):
            return f"`{_number(value, self.unit)}`"
        return f"`{value}`" if value not in ([], "") else ""

    @property
    def value(self) -> str:
        """What may stand there."""
        forms = (form for form in _forms(self.schema) if not _sweeps(form))
        texts = [text for form in forms if (text := _form_text(form, self.unit))]
        return "; ".join(dict.fromkeys(texts))


def _sweeps(form: Schema) -> bool:
    return str(form.get("description", "")).startswith("Swept")


def _forms(schema: Schema) -> list[Schema]:
    parts = [*schema.get("anyOf", ()), *schema.get("oneOf", ())]
    forms = [inner for part in parts if "required" not in part or len(part) > 1 for inner in _forms(part)]
    return forms or [schema]


def _number(value: float, unit: str = "") -> str:
    for factor, name in ((2**40, "TiB"), (2**30, "GiB"), (2**20, "MiB")):
        if unit == "B" and value % factor == 0 and value:
            return f"{value // factor:,g} {name}"
    return f"{value:,.16g}"


def _form_text(form: Schema, unit: str = "") -> str:
    if "const" in form:
        return f"`{form['const']}`"
    if "enum" in form:
        return ", ".join(f"`{name}`" for name in form["enum"])
    kind = form.get("type")
    if kind == "string":
        if "0-9]*)?)([eE]" in form.get("pattern", ""):
            return ""  # a number with its unit
        return "date" if form.get("format") == "date" else "text"
    if kind == "array":
        items = _form_text(form["items"]) if isinstance(form.get("items"), dict) else ""
        return f"list of {items}" if items else "list"
    if kind == "boolean":
        return "`true`, `false`"
    if kind == "object":
        keys = form.get("properties")
        return f"{{{', '.join(keys)}}}" if keys else "mapping"
    if kind in ("number", "integer"):
        low = form.get("minimum"), form.get("exclusiveMinimum")
        high = form.get("maximum"), form.get("exclusiveMaximum")
        words = {"number": "number", "integer": "whole number"}[kind]
        if low[0] is not None and high[0] is not None:
            return f"{words}, {_number(low[0], unit)} to {_number(high[0], unit)}"
        bounds = [("at least", low[0]), ("above", low[1]), ("at most", high[0]), ("below", high[1])]
        return ", ".join([words, *(f"{word} {_number(bound, unit)}" for word, bound in bounds if bound is not None)])
    return ""


def keys_of(schema: Schema) -> Iterator[Key]:
    """Yield every key of study files with this schema, blocks before what stands in them."""
    defs = schema.get("$defs", {})

    def resolved(node: Schema) -> Schema:
        while "$ref" in node:
            node = defs[node["$ref"].rpartition("/")[2]] | {key: text for key, text in node.items() if key != "$ref"}
        inner: Schema = {key: [resolved(part) for part in node[key]] for key in ("anyOf", "oneOf") if key in node}
        if isinstance(node.get("items"), dict):
            inner["items"] = resolved(node["items"])
        return node | inner

    def walk(prefix: str, node: Schema) -> Iterator[Key]:
        for name, part in node.get("properties", {}).items():
            whole = resolved(part)
            key = Key(f"{prefix}{name}", whole, name in node.get("required", ()))
            yield key
            blocks = [found for form in _forms(whole) if not _sweeps(form) for found in _blocks(form)]
            tagged = [f"{name}: {part['const']}" for _, block in blocks for name, part in _constants(block)]
            known: dict[str, Key] = {}
            for position, (suffix, block) in enumerate(blocks):
                for inner in walk(f"{key.name}{suffix}.", block):
                    first = known.setdefault(inner.name, inner)
                    if first is not inner and "const" in inner.schema:
                        first.schema = {"enum": [*first.schema.get("enum", [first.schema.get("const")])]}
                        first.schema["enum"].append(inner.schema["const"])
                        first.only = "each"
                    elif first.only != "each" and len(tagged) == len(blocks) > 1:
                        first.only = ", ".join(filter(None, (first.only, f"`{tagged[position]}`")))
            for inner in known.values():
                if inner.only == "each" or inner.only.count("`") == 2 * len(blocks):
                    inner.only = ""
            yield from known.values()

    def _blocks(form: Schema) -> Iterator[tuple[str, Schema]]:
        if "properties" in form:
            yield "", form
        if isinstance(form.get("items"), dict):
            yield from (("[]", item) for item in _forms(form["items"]) if "properties" in item)

    yield from walk("", schema)


def _constants(block: Schema) -> list[tuple[str, Schema]]:
    return [(name, part) for name, part in block["properties"].items() if "const" in part]


def is_sampled(study: type[Block], key: Key) -> bool:
    """Whether the values are instants to average over instead of a dimension of the result."""
    *outer, last = key.name.replace("[]", "").split(".")
    found = (block.parameter(last) for block in blocks_at(study, outer) if last in block.model_fields)
    return any(isinstance(parameter, Samples) for parameter in found)

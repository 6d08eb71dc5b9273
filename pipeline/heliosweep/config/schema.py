"""Describe the keys of a family's study files as JSON Schema, or in words for the documentation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, get_origin

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from heliosweep.config.blocks import Block, blocks_in
from heliosweep.config.study import Study, plain
from heliosweep.config.values import Numbers, Parameter, Samples, Schema


def json_schema(study_class: type[Study]) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a family's study files, with units and descriptions, for text editors.

    The schema requires no key, because searches and included files may supply keys. `load` reports missing keys.
    """
    schema = study_class.model_json_schema(schema_generator=_StudySchema)
    for block in (schema, *schema["$defs"].values()):
        block.pop("required", None)
    title = f"heliosweep study of the family {study_class.family_name()}"
    return {"$schema": GenerateJsonSchema.schema_dialect} | schema | {"title": title}


class _StudySchema(GenerateJsonSchema):
    """Schema generator that omits null and missing defaults, because study files do not contain such values."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        inner = self.generate_inner(schema["schema"])
        default = plain(schema.get("default"))
        return inner if default is None else inner | {"default": default}


@dataclass(frozen=True)
class Key:
    """One key of a study file.

    Parameters
    ----------
    name : str
        Dotted key, with ``[]`` instead of the index of a list entry.
    meaning, unit : str
        Description of the key, and the unit of numbers written without a unit.
    options : tuple of (str, str)
        Allowed names with their meanings.
    value, default : str
        Description of the allowed values, and the default in YAML (empty if there is no default).
    required : bool
        True if the key is required in its block.
    swept : bool
        True if the value can be swept.
    sampled : bool
        True if the values are instants over which results are averaged.
    only : str
        Kinds of the block that have this key; empty if every kind of the block has it.
    """

    name: str
    meaning: str
    unit: str
    options: tuple[tuple[str, str], ...]
    value: str
    default: str
    required: bool
    swept: bool
    sampled: bool
    only: str = ""


def keys_of(block: type[Block], prefix: str = "") -> Iterator[Key]:
    """Yield each key of a block, followed by the keys of its nested blocks."""
    for name, field in block.model_fields.items():
        blocks = [pair for pair in dict.fromkeys(blocks_in(field.annotation)) if pair[0] != "{}"]
        parameter, default = block.parameter(name), None if field.default_factory else field.get_default()
        options, unit = getattr(parameter, "options", ()), getattr(parameter, "unit", "1").removeprefix("1")
        meaning = getattr(parameter, "purpose" if isinstance(parameter, Numbers) else "description", "")
        yield Key(
            f"{prefix}{name}",
            meaning or field.description or "",
            unit,
            tuple(options.items()) if isinstance(options, Mapping) else (),
            _value(block, name, parameter, blocks, unit),
            "" if field.is_required() else _default(default, unit),
            field.is_required(),
            bool(parameter and parameter.sweep),
            isinstance(parameter, Samples),
        )
        found: dict[str, list[tuple[str, Key]]] = {}
        for suffix, inner in blocks:
            tags = [f"`{key}: {one}`" for key in inner.model_fields for one in inner.literals(key)]
            for key in keys_of(inner, f"{prefix}{name}{suffix}."):
                found.setdefault(key.name, []).append(("".join(tags[:1]), key))
        for same in found.values():
            yield _merged([tag for tag, _ in same], [key for _, key in same], len(blocks))


def _merged(tags: list[str], keys: list[Key], blocks: int) -> Key:
    key = keys[0]
    # the key selects the kind of the block
    if blocks > 1 and all(one.value[:1] == "`" and not one.options for one in keys):
        key = replace(key, value=", ".join(dict.fromkeys(one.value for one in keys)))
    some = len(keys) < blocks and all(tags)
    return replace(key, only=", ".join(dict.fromkeys(tags))) if some else key


def _value(block: type[Block], name: str, parameter: Parameter | None, blocks: list[Any], unit: str) -> str:
    if parameter is not None:
        return "; ".join(
            dict.fromkeys(filter(None, (_form_text(form, unit) for form in _forms(parameter.json_schema()))))
        )
    annotation = block.model_fields[name].annotation
    parts = [annotation, *get_args(annotation)]
    words = [", ".join(f"`{word}`" for word in get_args(part)) for part in parts if get_origin(part) is Literal]
    words += [f"{'list of ' * bool(suffix)}{{{', '.join(inner.model_fields)}}}" for suffix, inner in blocks]
    return "; ".join(words) or ("list" if get_origin(annotation) is tuple else "mapping")


def _forms(schema: Schema) -> Iterator[Schema]:
    for form in schema.get("anyOf", ()):
        yield from _forms(form)
    if "anyOf" not in schema and not str(schema.get("description")).startswith("Swept"):
        yield schema


def _default(default: Any, unit: str) -> str:
    value = plain(default)
    if value is None or isinstance(value, dict) or value in ([], ""):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{_number(value, unit) if isinstance(value, int | float) else value}`"


def _number(value: float, unit: str = "") -> str:
    for factor, name in ((2**40, "TiB"), (2**30, "GiB"), (2**20, "MiB")):
        if unit == "B" and value % factor == 0 and value:
            return f"{value // factor:,g} {name}"
    return f"{value:,.{15 if isinstance(value, float) else 16}g}"


def _form_text(form: Schema, unit: str = "") -> str:
    """Describe part of a JSON Schema in words. Returns an empty string for a number with a unit."""
    kind = form.get("type")
    if names := form.get("enum", [form["const"]] if "const" in form else []):
        return ", ".join(f"`{name}`" for name in names)
    if kind == "string":
        return "" if "[eE]" in form.get("pattern", "") else "date" if form.get("format") == "date" else "text"
    if kind == "array":
        items = _form_text(form.get("items", {}))
        return f"list of {items}" if items else "list"
    if kind == "object":
        return f"{{{', '.join(form['properties'])}}}" if "properties" in form else "mapping"
    words = {"boolean": "`true`, `false`", "number": "number", "integer": "whole number"}.get(str(kind), "")
    if kind not in ("number", "integer"):
        return words
    if "minimum" in form and "maximum" in form:
        return f"{words}, {_number(form['minimum'], unit)} to {_number(form['maximum'], unit)}"
    bounds = {"at least": "minimum", "above": "exclusiveMinimum", "at most": "maximum", "below": "exclusiveMaximum"}
    return ", ".join([words, *(f"{word} {_number(form[key], unit)}" for word, key in bounds.items() if key in form)])

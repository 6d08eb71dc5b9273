"""JSON Schema of a study family, by which editors complete and check study files."""

from __future__ import annotations

from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from heliosweep.config.identity import plain
from heliosweep.config.study import Study


def json_schema(study_class: type[Study]) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the study files of a family, units and descriptions included."""
    schema = study_class.model_json_schema(schema_generator=_StudySchema)
    title = f"heliosweep study of the family {study_class.family_name()}"
    return {"$schema": GenerateJsonSchema.schema_dialect} | schema | {"title": title}


class _StudySchema(GenerateJsonSchema):
    """Leaves out what does not exist in study files: null, and defaults that are none."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        inner = self.generate_inner(schema["schema"])
        default = plain(schema.get("default"))
        return inner if default is None else inner | {"default": default}

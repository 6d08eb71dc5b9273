"""What every kind of value in a study file has in common: it reads, checks and describes a field.

A kind of value stands in the annotation of the field::

    latitude: Annotated[float | Sweep, Quantity("Latitude, positive north", "deg", ge=-90, le=90)]
    tracking: Annotated[str | Sweep, Choice("How mirrors follow the sun", ("spinning_elevation", ...))]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from heliosweep.config.faults import Invalid, to_pydantic


@dataclass(frozen=True)
class Parameter:
    """What every kind of value has in common.

    Parameters
    ----------
    description : str
        What the value is, with its zero and sign convention.
    sweep : bool
        Whether a list (for numbers, also a range) may stand in place of one value; the parameter then
        becomes a dimension of the result.
    dimension : str
        Name of that dimension; empty for the name of the key.
    title, standard_name : str
        Long name and, where there is one, CF standard name of the coordinate.
    """

    description: str
    sweep: bool = field(default=True, kw_only=True)
    dimension: str = field(default="", kw_only=True)
    title: str = field(default="", kw_only=True)
    standard_name: str = field(default="", kw_only=True)

    @property
    def purpose(self) -> str:
        """The description, with the unit where there is one."""
        return self.description

    def read(self, raw: Any) -> Any:
        """Return the value for what stands in the study file. Raises Invalid."""
        raise NotImplementedError

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of what may stand in the study file."""
        raise NotImplementedError

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Let :meth:`read` alone decide, whatever the type in the annotation says."""

        def read(raw: Any) -> Any:
            try:
                return self.read(raw)
            except Invalid as error:
                raise to_pydantic(error.faults) from None

        return core_schema.no_info_plain_validator_function(read)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Describe the field to editors."""
        title = {"title": self.title} if self.title else {}
        return title | {"description": self.purpose} | self.json_schema()


def list_schema(one: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON Schema of a list of different values."""
    return {"type": "array", "items": one, "minItems": 1, "uniqueItems": True, "description": "Swept: a list"}

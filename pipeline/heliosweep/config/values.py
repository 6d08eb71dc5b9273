"""Kinds of values in a study file: each reads, checks and describes what stands in a field.

A kind of value stands in the annotation of the field::

    latitude: Annotated[float | Sweep, Quantity("Latitude, positive north", "deg", ge=-90, le=90)]
    tracking: Annotated[str | Sweep, Choice("How mirrors follow the sun", ("spinning_elevation", ...))]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from heliosweep.config import units
from heliosweep.config.faults import Fault, Invalid, Path, did_you_mean, one_of, to_pydantic
from heliosweep.config.forms import read_items, read_sweep
from heliosweep.config.sweep import Geometric, Listed, Range, Sweep

_INFINITE = 1e300  # beyond it differences overflow
_QUANTITY_PATTERN = r"^\s*[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\s*[^0-9\s].*$"


@dataclass(frozen=True)
class Parameter:
    """A kind of value: the properties that all kinds have.

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


@dataclass(frozen=True)
class Quantity(Parameter):
    """A physical number: canonical unit, bounds, and whether it may be swept.

    Parameters
    ----------
    unit : str
        Canonical unit, one of the table in :mod:`heliosweep.config.units`; ``"1"`` for pure numbers.
    ge, gt, le, lt : float, optional
        Bounds, in `unit`.
    integer : bool
        Whether the number must be whole; it is then read as int.
    """

    unit: str
    ge: float | None = field(default=None, kw_only=True)
    gt: float | None = field(default=None, kw_only=True)
    le: float | None = field(default=None, kw_only=True)
    lt: float | None = field(default=None, kw_only=True)
    integer: bool = field(default=False, kw_only=True)

    @property
    def purpose(self) -> str:
        """The description and the unit."""
        return self.description if self.unit == "1" else f"{self.description} [{self.unit}]"

    def read(self, raw: Any) -> float | Sweep:
        """Return a number in the canonical unit, or a sweep of them. Raises Invalid."""
        if not isinstance(raw, Sweep | Mapping | list | tuple):
            return self._one(raw)
        if not self.sweep:
            raise Invalid("must be a single value; it cannot be swept")
        sweep = raw if isinstance(raw, Sweep) else read_sweep(raw, self._number)
        self._check_sweep(sweep)
        return sweep

    def bounds(self) -> str:
        """Return the bounds in words, such as ``between -90 and 90 deg``; empty if there are none."""
        suffix = units.suffix(self.unit)
        if self.ge is not None and self.le is not None:
            return f"between {self.ge:g} and {self.le:g}{suffix}"
        lower = "at least" if self.ge is not None else "greater than"
        upper = "at most" if self.le is not None else "less than"
        least, most = (self.gt if self.ge is None else self.ge), (self.lt if self.le is None else self.le)
        parts = [f"{word} {bound:g}" for word, bound in ((lower, least), (upper, most)) if bound is not None]
        return f"{' and '.join(parts)}{suffix}" if parts else ""

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the number: bare, with a unit, and swept where that is allowed."""
        limits = {
            "minimum": self.ge,
            "exclusiveMinimum": self.gt,
            "maximum": self.le,
            "exclusiveMaximum": self.lt,
        }
        forms: list[dict[str, Any]] = [
            {"type": "integer" if self.integer else "number"}
            | {key: bound for key, bound in limits.items() if bound is not None}
        ]
        if self.unit != "1":
            forms.append({"type": "string", "pattern": _QUANTITY_PATTERN})
        one = forms[0] if len(forms) == 1 else {"anyOf": forms}
        return {"anyOf": [*forms, *_swept_schemas(one)]} if self.sweep else one

    def _number(self, raw: Any) -> float:
        """Return one finite number in the canonical unit, bounds not yet checked."""
        if isinstance(raw, str):
            value: float = units.parse(raw, self.unit)
        elif isinstance(raw, bool) or not isinstance(raw, int | float):
            raise Invalid(f"must be {units.expected(self.unit)}")
        else:
            value = raw
        if not abs(value) < _INFINITE:
            raise Invalid("must be a finite number")
        return float(value) + 0.0  # no negative zero

    def _one(self, raw: Any) -> float:
        value = self._number(raw)
        self._check(value)
        return int(value) if self.integer else value

    def _check(self, value: float) -> None:
        within = (
            (self.ge is None or value >= self.ge)
            and (self.gt is None or value > self.gt)
            and (self.le is None or value <= self.le)
            and (self.lt is None or value < self.lt)
        )
        if not within:
            raise Invalid(f"must be {self.bounds()}")
        if self.integer and not value.is_integer():
            raise Invalid("must be a whole number")

    def _check_sweep(self, sweep: Sweep) -> None:
        """Check every value of a sweep; of a range, which is monotonic, the first and the last."""
        places: list[tuple[Path, Any]]
        if isinstance(sweep, Listed):
            places = [((position,), value) for position, value in enumerate(sweep.items)]
        else:
            inner = ("logspace",) if isinstance(sweep, Geometric) else ()
            places = [((*inner, "start"), sweep.first), ((*inner, "stop"), sweep.last)]
        faults: list[Fault] = []
        for place, value in places:
            try:
                self._check(value)
            except Invalid as error:
                faults.append(Fault(error.faults[0].message, place))
        if not faults and self.integer and not (isinstance(sweep, Listed) or _is_whole(sweep)):
            faults.append(Fault("the values of the range must be whole numbers", show_value=False))
        if faults:
            raise Invalid(faults)


@dataclass(frozen=True)
class Samples(Quantity):
    """Instants to sample at: the forms of a sweep or one value, always read as a sweep.

    Samples are averaged over or become ``time``; they are no dimension of the parameter grid.
    """

    def read(self, raw: Any) -> Sweep:
        """Return the samples; a single value counts as a list of one. Raises Invalid."""
        value = super().read(raw)
        return value if isinstance(value, Sweep) else Listed((value,))


def _is_whole(sweep: Sweep) -> bool:
    return isinstance(sweep, Range) and sweep.step.is_integer()


def _swept_schemas(one: Mapping[str, Any]) -> list[dict[str, Any]]:
    number = {"type": ["number", "string"]}
    num = {"type": "integer", "minimum": 1, "description": "Number of values, both ends included"}

    def mapping(description: str, **properties: Mapping[str, Any]) -> dict[str, Any]:
        return {
            "type": "object",
            "description": description,
            "properties": properties,
            "required": list(properties),
            "additionalProperties": False,
        }

    return [
        list_schema(one),
        mapping("Swept: a range by its step", start=one, stop=one, step=number),
        mapping("Swept: a range by its number of values", start=one, stop=one, num=num),
        mapping(
            "Swept: a geometric range",
            logspace=mapping("From start to stop in equal ratios", start=one, stop=one, num=num),
        ),
    ]

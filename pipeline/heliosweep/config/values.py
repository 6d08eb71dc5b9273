"""Kinds of values in a study file: each reads, checks and describes the value of a field; and units.

The annotation of a field names its kind of value::

    latitude: Annotated[float | Sweep, Quantity("Latitude, positive north", "deg", ge=-90, le=90)]
    tracking: Annotated[str | Sweep, Choice("Mount of the mirrors", ("spinning_elevation", ...))]
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from functools import partial
from typing import Any, ClassVar

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from heliosweep.config.faults import (
    COUNTS,
    SYNONYMS,
    Fault,
    Faults,
    Invalid,
    Path,
    did_you_mean,
    each,
    nearest,
    one_of,
    to_pydantic,
)
from heliosweep.config.sweep import (
    NORMAL,
    RANGE_KEYS,
    UNIFORM,
    Drawn,
    Sweep,
    is_distribution,
    read_drawn,
    read_items,
    read_mapping,
    read_shape,
    read_sweep,
    read_whole,
)

_DEG_PER_RAD = Decimal("57.295779513082320876798154814105170332405")
# Factor to the first unit of each kind. Decimal, so that "38 ft" is 11.5824 m and not a neighbour of it.
_FACTORS: dict[str, dict[str, Decimal | int | str]] = {
    "a length": {"m": 1, "mm": "0.001", "cm": "0.01", "km": 1000, "in": "0.0254", "ft": "0.3048"},
    "an angle": {
        **{"deg": 1, "rad": _DEG_PER_RAD, "mrad": _DEG_PER_RAD / 1000, "urad": _DEG_PER_RAD / 1_000_000},
        **{"arcmin": Decimal(1) / 60, "arcsec": Decimal(1) / 3600, "\u00b0": 1},
    },
    "a duration": {"s": 1, "min": 60, "h": 3600, "d": 86400},
    "an amount of memory": {
        **{"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12},
        **{"KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40},
    },
    "a pressure": {"Pa": 1, "hPa": 100, "kPa": 1000, "mbar": 100},
    "a temperature": {"degC": 1},
    "a speed": {"m/s": 1, "km/h": Decimal(1) / Decimal("3.6")},
    "a power": {"MW": 1, "kW": "0.001", "GW": 1000},
    "an irradiance": {"W/m2": 1, "kW/m2": 1000, "MW/m2": 10**6},
    "a vapour density": {"g/m3": 1, "kg/m3": 1000},
    "a plain number": {"1": 1, "%": "0.01"},
}
_KINDS = {kind: {unit: Decimal(factor) for unit, factor in units.items()} for kind, units in _FACTORS.items()}
_KIND_OF = {unit: kind for kind, units in _KINDS.items() for unit in units}


def parse(text: str, unit: str) -> float:
    """Read a number with its unit, such as ``"1.2 mrad"``, as a number in `unit`. Raises Invalid."""
    number_form = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
    match = re.fullmatch(rf"\s*({number_form})\s*([^0-9\W_].*?|%|\u00b0|)\s*", text)
    if match is None:
        raise Invalid(f"must be {expected(unit)}{_hint(text, unit)}")
    number, given = float(match[1]), match[2]
    if not given:
        raise Invalid("must be a number without quotes, or a number with its unit")
    kind = _KIND_OF[unit]
    if given not in _KIND_OF:
        raise Invalid(f"unknown unit '{given[:20]}'; use {one_of(_KINDS[kind])}")
    if _KIND_OF[given] != kind:
        raise Invalid(f"must be {expected(unit)}; '{given}' is the unit of {_KIND_OF[given]}")
    if number in (float("inf"), float("-inf")):
        return number
    factors = _KINDS[kind]
    return float(Decimal(repr(number)) * factors[given] / factors[unit])


def _hint(text: str, unit: str) -> str:
    """Return a hint for text that is not a number."""
    if re.fullmatch(r"\s*[-+]?[0-9]+,[0-9]+\s*\D*", text):
        return "; decimals follow a point, not a comma"
    if clock := re.fullmatch(r"\s*([0-9]{1,2}):([0-9]{2})\s*", text):
        return f"; '{text.strip()}' is {int(clock[1]) + int(clock[2]) / 60:g} h" if unit == "h" else ""
    if re.search(r"[0-9]\s*:\s*[-+0-9]|range|linspace", text):
        return "; a range is {start, stop, step} or {start, stop, num}"
    return ""


def expected(unit: str) -> str:
    """Return what to write for a quantity: ``an angle in deg, a number or text such as '30 deg'``."""
    if unit == "1":
        return "a number"
    examples = {"m": "1.5 m", "deg": "30 deg", "h": "1.5 h", "B": "2 GB", "mrad": "1.2 mrad"}
    return f"{_KIND_OF[unit]} in {unit}, a number or text such as '{examples.get(unit, f'1 {unit}')}'"


def suffix(unit: str) -> str:
    """Return the unit as it follows a number in text: `` deg``; nothing for pure numbers."""
    return "" if unit == "1" else f" {unit}"


def is_unit(text: str) -> bool:
    """Return True if a text is the name of a unit."""
    return text in _KIND_OF


def factor(given: str, wanted: str) -> float:
    """Return the factor from one unit to another. Raises ValueError."""
    if given not in _KIND_OF or _KIND_OF[given] != _KIND_OF.get(wanted):
        raise ValueError(f"'{given}' is no multiple of '{wanted}'")
    factors = _KINDS[_KIND_OF[given]]
    return float(factors[given] / factors[wanted])


#: Largest seed: above it, several seeds would be read as the same float.
MAX_SEED = 2**53 - 1
Schema = dict[str, Any]


@dataclass(frozen=True)
class Parameter:
    """A kind of value: the properties that all kinds have.

    Parameters
    ----------
    description : str
        Meaning of the value, with its zero and sign convention.
    sweep : bool
        True if a list (for numbers, also a range or a distribution) can replace one value; the parameter then
        becomes a dimension of the result.
    dimension : str
        Name of that dimension; empty for the name of the key.
    title, standard_name : str
        Long name and, if there is one, CF standard name of the coordinate.
    """

    description: str
    sweep: bool = field(default=False, kw_only=True)
    dimension: str = field(default="", kw_only=True)
    title: str = field(default="", kw_only=True)
    standard_name: str = field(default="", kw_only=True)

    @property
    def purpose(self) -> str:
        """The description, with the unit if there is one."""
        return self.description

    #: Forms of swept values.
    _SWEPT: ClassVar[Any] = Sweep | list | tuple

    def read(self, raw: Any) -> Any:
        """Return the value for the data of the study file, a sweep of values or a distribution. Raises Invalid."""
        if is_distribution(raw):
            if not self.sweep:
                raise Invalid("must be a single value; it cannot be drawn from a distribution")
            return self._drawn(raw)
        if not isinstance(raw, self._SWEPT):
            return self._one(raw)
        if not self.sweep:
            raise Invalid("must be a single value; it cannot be swept")
        return self._swept(raw)

    def _one(self, raw: Any) -> Any:
        raise NotImplementedError

    def _swept(self, raw: Any) -> Sweep:
        return Sweep(read_items(raw[:], self._one))

    def _drawn(self, raw: Any) -> Drawn:
        return read_drawn(raw, self._one, form="names are drawn by {discrete: {values: [...], weights: [...]}}")

    def json_schema(self) -> Schema:
        """Return the JSON Schema of the value, and of its sweeps in outline."""
        one = self._one_schema()
        if not self.sweep:
            return one
        swept = (
            list_schema(one),
            {"type": "object", "minProperties": 1, "description": "Swept: a range or distribution"},
        )
        return {"anyOf": [*one.get("anyOf", [one]), *swept]}

    def _one_schema(self) -> Schema:
        """Return the JSON Schema of a single value."""
        return {"type": "string", "minLength": 1}

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Let :meth:`read` alone decide, independent of the type in the annotation."""

        def read(raw: Any) -> Any:
            try:
                return self.read(raw)
            except Invalid as error:
                raise to_pydantic(error.faults) from None

        return core_schema.no_info_plain_validator_function(read)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> Schema:
        """Describe the field to editors."""
        title = {"title": self.title} if self.title else {}
        return title | {"description": self.purpose} | self.json_schema()


def list_schema(one: Mapping[str, Any]) -> Schema:
    """Return the JSON Schema of a list of different values."""
    return {"type": "array", "items": one, "minItems": 1, "description": "Swept: a list"}


def object_schema(description: str, required: Mapping[str, Any], optional: Mapping[str, Any] | None = None) -> Schema:
    """Return the JSON Schema of a mapping that has some keys and no unknown ones."""
    properties = {"properties": {**required, **(optional or {})}, "required": list(required)}
    return {"type": "object", "description": description, "additionalProperties": False, **properties}


def free_text(raw: Any) -> str:
    """Return text that is not empty. Raises Invalid."""
    if not isinstance(raw, str):
        raise Invalid(f"must be text{'; write it in quotes' if isinstance(raw, int | float) else ''}")
    if not raw.strip():
        raise Invalid("must not be empty")
    return raw


@dataclass(frozen=True)
class Text(Parameter):
    """Text on one or more lines, or of a certain form.

    Parameters
    ----------
    form : callable
        Returns the text for the data of the study file, or raises Invalid.
    """

    form: Callable[[Any], str] = field(default=free_text, kw_only=True)

    def _one(self, raw: Any) -> str:
        return self.form(raw)


@dataclass(frozen=True)
class Flag(Parameter):
    """Yes or no, written ``true`` or ``false``."""

    def _one(self, raw: Any) -> bool:
        if not isinstance(raw, bool):
            raise Invalid("must be true or false")
        return raw

    def _one_schema(self) -> Schema:
        return {"type": "boolean"}


@dataclass(frozen=True)
class FileName(Parameter):
    """Name of a table, relative to the study file: text without its empty lines and comments (``#``)."""

    sweep: bool = field(default=True, kw_only=True)

    def _drawn(self, raw: Any) -> Drawn:
        raise Invalid("files cannot be drawn; sweep them as a list")

    def _one(self, raw: Any) -> str:
        if not isinstance(raw, str) or not raw.strip():
            raise Invalid("must be the name of a file, relative to the study file")
        return raw


@dataclass(frozen=True)
class Choice(Parameter):
    """One of several names.

    Parameters
    ----------
    options : mapping of str to str, or sequence of str
        The names, and their meanings.
    """

    options: Mapping[str, str] | Sequence[str] = field(hash=False)
    sweep: bool = field(default=True, kw_only=True)

    @property
    def purpose(self) -> str:
        """The description and the meaning of each name."""
        if not isinstance(self.options, Mapping):
            return self.description
        return f"{self.description} ({'; '.join(f'{name}: {meaning}' for name, meaning in self.options.items())})"

    def _one(self, raw: Any) -> str:
        if not isinstance(raw, str):
            raise Invalid(f"must be {one_of(self.options)}")
        if raw not in self.options:
            hint = f"; {SYNONYMS[raw.casefold()]}" if raw.casefold() in SYNONYMS else did_you_mean(raw, self.options)
            raise Invalid(f"unknown choice{hint or f'; use {one_of(self.options)}'}")
        return raw

    def _one_schema(self) -> Schema:
        return {"enum": list(self.options)}


@dataclass(frozen=True)
class Quantity(Parameter):
    """A physical number: canonical unit, bounds, and whether it may be swept.

    Parameters
    ----------
    unit : str
        Canonical unit, one of the table in :mod:`heliosweep.config.values`; ``"1"`` for pure numbers.
    ge, gt, le, lt : float, optional
        Bounds, in `unit`.
    integer : bool
        True if the number must be whole; it is then read as int.
    repeats : bool
        True if a list may contain a value twice, if `zip` ties it to another key.
    """

    unit: str
    sweep: bool = field(default=True, kw_only=True)
    ge: float | None = field(default=None, kw_only=True)
    gt: float | None = field(default=None, kw_only=True)
    le: float | None = field(default=None, kw_only=True)
    lt: float | None = field(default=None, kw_only=True)
    integer: bool = field(default=False, kw_only=True)
    repeats: bool = field(default=False, kw_only=True)

    @property
    def purpose(self) -> str:
        """The description and the unit."""
        return self.description if self.unit == "1" else f"{self.description} [{self.unit}]"

    _SWEPT: ClassVar[Any] = Sweep | Mapping | list | tuple

    def _one(self, raw: Any) -> float:
        value = self._number(raw)
        self._check(value)
        return int(value) if self.integer else value

    def _swept(self, raw: Any) -> Sweep:
        sweep = raw if isinstance(raw, Sweep) else read_sweep(raw, self._number, self.repeats)
        self._check_sweep(sweep)
        return sweep

    def _drawn(self, raw: Any) -> Drawn:
        low = max((bound for bound in (self.ge, self.gt) if bound is not None), default=-math.inf)
        high = min((bound for bound in (self.le, self.lt) if bound is not None), default=math.inf)
        form = "whole numbers are drawn by {discrete: {values: [...], weights: [...]}}" if self.integer else ""
        return read_drawn(raw, self._number, self._check, low, high, form)

    def bounds(self) -> str:
        """Return the bounds in words, such as ``between -90 and 90 deg``; empty if there are none."""
        ending, form = suffix(self.unit), ".0f" if self.integer else "g"
        if self.ge is not None and self.le is not None:
            return f"between {self.ge:{form}} and {self.le:{form}}{ending}"
        words = {"at least": self.ge, "greater than": self.gt, "at most": self.le, "less than": self.lt}
        parts = [f"{word} {bound:{form}}" for word, bound in words.items() if bound is not None]
        return f"{' and '.join(parts)}{ending}" if parts else ""

    def _one_schema(self) -> Schema:
        limits = {"minimum": self.ge, "exclusiveMinimum": self.gt, "maximum": self.le, "exclusiveMaximum": self.lt}
        number: Schema = {"type": "integer" if self.integer else "number"}
        number |= {key: bound for key, bound in limits.items() if bound is not None}
        pattern = r"^\s*[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\s*[^0-9\s].*$"
        return number if self.unit == "1" else {"anyOf": [number, {"type": "string", "pattern": pattern}]}

    def _number(self, raw: Any) -> float:
        """Return one finite number in the canonical unit, bounds not yet checked."""
        if isinstance(raw, str):
            raw = parse(raw, self.unit)
        elif isinstance(raw, bool) or not isinstance(raw, int | float):
            raise Invalid(f"must be {expected(self.unit)}")
        if not abs(raw) < 1e300:  # beyond it differences overflow
            raise Invalid("must be a finite number")
        return float(raw) + 0.0  # no negative zero

    def _check(self, value: float) -> None:
        above = (self.ge is None or value >= self.ge) and (self.gt is None or value > self.gt)
        below = (self.le is None or value <= self.le) and (self.lt is None or value < self.lt)
        if not (above and below):
            raise Invalid(f"must be {self.bounds()}")
        if self.integer and not value.is_integer():
            raise Invalid("must be a whole number")

    def _check_sweep(self, sweep: Sweep) -> None:
        """Check every value of a list; of a range, which is monotonic, the first and the last."""
        places: Iterable[Path] = ((position,) for position in range(len(sweep)))
        if sweep.form is not None:
            inner = ("logspace",) if "logspace" in sweep.form else ()
            places = ((*inner, "start"), (*inner, "stop"))
        faults = Faults()
        for place, value in zip(places, sweep.ends(), strict=True):
            with faults.under(*place):
                self._check(value)
        if not faults and self.integer and sweep.form is not None and (sweep.values() % 1).any():
            faults.append(Fault("the values of the range must be whole numbers", show_value=False))
        faults.check()


@dataclass(frozen=True)
class Samples(Quantity):
    """Instants to sample at: the forms of a sweep or one value, always read as a sweep.

    Samples are averaged over or become ``time``; they are no dimension of the parameter grid.
    """

    def read(self, raw: Any) -> Sweep:
        """Return the samples; a single value counts as a list of one. Raises Invalid."""
        value = super().read(raw)
        return value if isinstance(value, Sweep) else Sweep((value,))

    def _drawn(self, raw: Any) -> Drawn:
        raise Invalid("instants cannot be drawn from a distribution")


@dataclass(frozen=True)
class Numbers(Parameter):
    """A fixed number of numbers, such as ``[0, -1]``.

    Parameters
    ----------
    units : str or tuple of str
        Canonical unit of all, or of each.
    names : tuple of str
        Names of the numbers.
    gt, ge, le : float, optional
        Bounds of all.
    """

    units: str | tuple[str, ...]
    names: tuple[str, ...]
    gt: float | None = field(default=None, kw_only=True)
    ge: float | None = field(default=None, kw_only=True)
    le: float | None = field(default=None, kw_only=True)

    @property
    def purpose(self) -> str:
        """The description, the names and the unit."""
        return f"{self.description}, {self.form}"

    @property
    def form(self) -> str:
        """The written form of the numbers, in words."""
        unit = f" in {self.units}" if isinstance(self.units, str) and self.units != "1" else ""
        return f"[{', '.join(self.names)}]{unit}"

    def read(self, raw: Any) -> Any:
        """Return the numbers as a tuple. Raises Invalid."""
        parts = self._parts()
        if not isinstance(raw, list | tuple) or len(raw) != len(parts):
            raise Invalid(f"must be {dict(enumerate(COUNTS)).get(len(parts), len(parts))} numbers {self.form}")
        return tuple(each(zip(parts, raw, strict=True), lambda pair: pair[0].read(pair[1])))

    def _one_schema(self) -> Schema:
        one = self._parts()[0].json_schema() if isinstance(self.units, str) else {"type": ["number", "string"]}
        return {"type": "array", "items": one, "minItems": len(self.names), "maxItems": len(self.names)}

    def _parts(self) -> list[Quantity]:
        parts = [self.units] * len(self.names) if isinstance(self.units, str) else self.units
        return [Quantity("", unit, gt=self.gt, ge=self.ge, le=self.le, sweep=False) for unit in parts]


@dataclass(frozen=True)
class ListOfNumbers(Numbers):
    """A list of different entries of several numbers, such as ``[[-16, 150, 0], [-60, 300, 0]]``.

    Parameters
    ----------
    entries : int, optional
        Number of entries (default: any number but none).
    """

    entries: int | None = field(default=None, kw_only=True)

    def read(self, raw: Any) -> tuple[tuple[float, ...], ...]:
        """Return the entries. Raises Invalid."""
        count = "" if self.entries is None else f"{self.entries} "
        if not isinstance(raw, list | tuple) or (self.entries is not None and len(raw) != self.entries):
            raise Invalid(f"must be a list of {count}entries {self.form}")
        if not raw:
            raise Invalid(Fault(f"the list is empty: give at least one entry {self.form}", show_value=False))
        first: dict[tuple[float, ...], int] = {}

        def another(item: tuple[int, Any]) -> tuple[float, ...]:
            position, entry = item[0], Numbers.read(self, item[1])
            wrong = list(self.entry_faults(entry))
            if first.setdefault(entry, position) != position:
                wrong.insert(0, Fault(f"is the same as entry {first[entry]} (counted from 0); remove one"))
            if wrong:
                raise Invalid(wrong)
            return entry

        return tuple(each(enumerate(raw), another))

    def entry_faults(self, entry: tuple[float, ...]) -> Iterator[Fault]:
        """Yield the faults of an entry of valid numbers."""
        yield from ()

    def _one_schema(self) -> Schema:
        count = {"minItems": self.entries or 1} | ({} if self.entries is None else {"maxItems": self.entries})
        return {"type": "array", "items": super()._one_schema(), "uniqueItems": True, **count}


MAX_SAMPLES = 10**9
_SHAPES = (NORMAL, UNIFORM)
_FORM = "a distribution is {normal: [mean, standard deviation]} or {uniform: [least, largest]}"


@dataclass(frozen=True)
class Distribution:
    """Distribution of a number that is drawn for each mount.

    Parameters
    ----------
    kind : {"normal", "uniform"}
        Shape of the distribution.
    parts : tuple of float
        Mean and standard deviation, or minimum and maximum, in the canonical unit of the parameter.
    samples, seed : int, optional
        Number of draws and their seed; None if the block specifies them.
    """

    kind: str
    parts: tuple[float, float]
    samples: int | None = None
    seed: int | None = None

    @property
    def mean(self) -> float:
        """Mean of the distribution."""
        first, second = self.parts
        return first if self.kind == NORMAL else 0.5 * first + 0.5 * second

    @property
    def width(self) -> float:
        """Factor on standard deviates: the standard deviation, or half the span of a uniform distribution.

        Draws are ``mean + width * deviate`` with standard normal deviates, or uniform ones between -1 and 1.
        """
        first, second = self.parts
        return second if self.kind == NORMAL else 0.5 * second - 0.5 * first

    def spec(self) -> dict[str, Any]:
        """Return the distribution as plain data that a study file may contain."""
        drawn = {"samples": self.samples, "seed": self.seed}
        return {self.kind: list(self.parts)} | {key: value for key, value in drawn.items() if value is not None}


@dataclass(frozen=True)
class Uncertain(Quantity):
    """A physical number that is fixed, swept, or drawn from a distribution for each mount.

    Bounds hold for numbers and sweeps, for the mean of a normal and for both ends of a uniform distribution; the
    standard deviation is at most the larger bound.
    """

    def read(self, raw: Any) -> Any:
        """Return a number in the canonical unit, a Sweep of them, or a Distribution. Raises Invalid."""
        raw = raw.spec() if isinstance(raw, Distribution) else raw
        if isinstance(raw, Mapping) and raw:
            meant = {nearest(str(key), (*_SHAPES, "samples", "seed", *RANGE_KEYS)) for key in raw}
            if {*_SHAPES} & {*raw} or not meant & {*RANGE_KEYS}:
                return self._distribution(raw)
        for position, entry in enumerate(raw if isinstance(raw, list | tuple) else ()):
            if isinstance(entry, Mapping | Distribution):
                raise Invalid(Fault("distributions cannot be swept", (position,)))
        return super().read(raw)

    def _distribution(self, raw: Mapping[str, Any]) -> Distribution:
        def checked(entry: Any) -> float:
            value = self._number(entry)
            self._check(value)
            return value

        def shape(kind: str, entry: Any) -> tuple[float, ...]:
            parts = read_shape(kind, entry, self._number, checked, fixed=True)
            largest = max(abs(bound) for bound in (self.ge, self.le, 0.0) if bound is not None)
            if kind == NORMAL and largest and parts[1] > largest:
                raise Invalid(Fault(f"the standard deviation must be at most {largest:g}{suffix(self.unit)}", (1,)))
            return parts

        readers: dict[str, Any] = {kind: partial(shape, kind) for kind in _SHAPES}
        readers["samples"] = partial(read_whole, least=1, most=MAX_SAMPLES)
        readers["seed"] = partial(read_whole, least=0, most=MAX_SEED)
        values = read_mapping(raw, readers, (), _FORM, exactly=_SHAPES)
        kind = next(kind for kind in _SHAPES if kind in values)
        return Distribution(kind, values[kind], values.get("samples"), values.get("seed"))

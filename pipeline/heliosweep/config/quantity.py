"""Physical numbers: canonical unit, bounds, sweeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from heliosweep.config import units
from heliosweep.config.faults import Fault, Invalid, Path
from heliosweep.config.fields import Parameter, list_schema
from heliosweep.config.forms import read_sweep
from heliosweep.config.sweep import Geometric, Listed, Range, Sweep

_INFINITE = 1e300  # beyond it differences overflow
_QUANTITY_PATTERN = r"^\s*[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\s*[^0-9\s].*$"


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

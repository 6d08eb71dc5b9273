"""The block `search` of a study file: what is best, over which keys, and within how many evaluations."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from heliosweep.config.block import Block, blocks_in
from heliosweep.config.drawn import Drawn
from heliosweep.config.faults import Fault, Faults, Invalid, did_you_mean, each, one_of
from heliosweep.config.source import Source
from heliosweep.config.sweep import Sweep, key_faults, read_items
from heliosweep.config.values import MAX_SEED, Choice, Parameter, Quantity, Samples, Schema, list_schema
from heliosweep.errors import Problem

if TYPE_CHECKING:
    from heliosweep.config.study import Study

MAX_KEYS, MAX_BUDGET = 20, 100_000
#: Bounds that are nearer to each other, in parts of the larger one, leave no room for a search.
NARROW, HUGE = 1e-9, 1e250
_FORM = "write [low, high], or {choice: [...]}"


@dataclass(frozen=True)
class Results(Parameter):
    """Name of a result, or a list of names."""

    def read(self, raw: Any) -> tuple[str, ...]:
        """Return the names. Raises Invalid."""
        names = raw if isinstance(raw, list | tuple) else (raw,)
        if not all(isinstance(name, str) and name.strip() for name in names):
            raise Invalid("must be the name of a result, or a list of two")
        return read_items(names, str) if len(names) > 1 else tuple(names)

    def json_schema(self) -> Schema:
        """Return the JSON Schema of one or two names."""
        one = {"type": "string", "minLength": 1}
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1, "maxItems": 2, "uniqueItems": True}]}


@dataclass(frozen=True)
class Extent(Parameter):
    """Values of a searched key: ``[low, high]``, or ``{choice: [...]}``; in its unit only once its key is known."""

    def read(self, raw: Any) -> Any:
        """Return bounds as a tuple, and choices as a mapping. Raises Invalid."""
        if isinstance(raw, Mapping):
            key_faults(raw, ("choice",), ("choice",), _FORM).check()
            if not isinstance(raw["choice"], list | tuple) or len(raw["choice"]) < 2:
                raise Invalid(Fault("must be a list of at least two values", ("choice",)))
            return {"choice": tuple(raw["choice"])}
        if not isinstance(raw, list | tuple) or len(raw) != 2:
            raise Invalid(f"must be the least and the largest value: {_FORM}")
        return tuple(raw)

    def json_schema(self) -> Schema:
        """Return the JSON Schema of both forms."""
        one = {"type": ["number", "string"]}
        bounds = {"type": "array", "items": one, "minItems": 2, "maxItems": 2, "description": "Least and largest value"}
        choice = {
            "type": "object",
            "properties": {"choice": list_schema(one) | {"minItems": 2, "description": "Values to choose from"}},
            "required": ["choice"],
            "additionalProperties": False,
        }
        return {"anyOf": [bounds, choice]}


class Limit(Block):
    """Bounds of a result, in its unit."""

    at_least: Annotated[float | None, Quantity("Least value of the result, in its unit", "1", sweep=False)] = None
    at_most: Annotated[float | None, Quantity("Largest value of the result, in its unit", "1", sweep=False)] = None

    def rules(self) -> Iterator[Fault]:
        """Check that there is a bound, and room between two."""
        if self.at_least is None and self.at_most is None:
            yield Fault("give 'at_least', 'at_most' or both", show_value=False)
        elif self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            yield Fault("must not be larger than 'at_most'", ("at_least",))


class Search(Block):
    """The best point of a study: each evaluation is the study with other values of the searched keys."""

    maximise: Annotated[tuple[str, ...], Results("Result of which the largest value is the best; or two")] = ()
    minimise: Annotated[tuple[str, ...], Results("Result of which the smallest value is the best; or two")] = ()
    over: Annotated[
        dict[str, Annotated[Any, Extent("Least and largest value of the key, or a choice of values")]],
        Field(description="Searched keys, as receiver.height, each with its bounds", min_length=1, max_length=MAX_KEYS),
    ]
    budget: Annotated[
        int, Quantity("Evaluations at the most", "1", ge=1, le=MAX_BUDGET, integer=True, sweep=False)
    ]  # fmt: skip
    seed: Annotated[
        int,
        Quantity("Whole number that the course of the search follows from", "1", ge=0, le=MAX_SEED, integer=True,
                 sweep=False),
    ] = 0  # fmt: skip
    subject_to: Annotated[
        dict[str, Limit], Field(description="Results that must stay within bounds, each with 'at_least' or 'at_most'")
    ] = Field(default_factory=dict)

    def rules(self) -> Iterator[Fault]:
        """Check that there are one or two goals, and evaluations for a generation."""
        goals = len(self.goals())
        if not 1 <= len(self.maximise) + len(self.minimise) <= 2:
            yield Fault("give one result to 'maximise' or 'minimise', or two for a front of best compromises",
                        show_value=False)  # fmt: skip
        elif goals < len(self.maximise) + len(self.minimise):
            yield Fault("is maximised too; leave one out", ("minimise",))
        elif self.budget < (needed := population(len(self.over), goals)):
            yield Fault(
                f"must be at least {needed}, one generation of a search over {len(self.over)} keys", ("budget",)
            )

    def goals(self) -> dict[str, float]:
        """Return the results that are sought: 1 where the smallest is the best, -1 where the largest is."""
        return dict.fromkeys(self.maximise, -1.0) | dict.fromkeys(self.minimise, 1.0)

    def searched(self) -> tuple[str, ...]:
        """Return the searched keys, in an order that does not depend on how they were written."""
        return tuple(sorted(self.over))


def population(keys: int, goals: int) -> int:
    """Return the number of evaluations of one generation."""
    return max(10, 5 * keys) if goals < 2 else 4 * (4 + 2 * keys)


def searchable(block: type[Block], prefix: str = "") -> dict[str, Parameter]:
    """Return the declarations of the keys of a block that a search may vary, by dotted key."""
    found: dict[str, Parameter] = {}
    for name, field in block.model_fields.items():
        declared = block.parameter(name)
        if declared is None:
            for inner in blocks_in(field.annotation):
                found |= {key: one for key, one in searchable(inner, f"{prefix}{name}.").items() if key not in found}
        elif declared.sweep and isinstance(declared, Quantity | Choice) and not isinstance(declared, Samples):
            found[f"{prefix}{name}"] = declared
    return found


def with_search(source: Source, study_class: type[Study], problems: list[Problem]) -> Source:
    """Return a study with the bounds of its search in the units of their keys, and a value for each of these.

    Where a searched key has no value in the study, the middle of its bounds, or the first choice, is put there: the
    search begins at these values. What is wrong with a key is added to `problems`.
    """
    try:
        over = source.data["search"]["over"]
        extents = {str(key): Extent("").read(raw) for key, raw in over.items()}
    except (KeyError, TypeError, AttributeError, Invalid):  # which validation tells
        return source
    data, known = copy.deepcopy(source.data), searchable(study_class)
    for key, extent in extents.items():
        place, faults = ("search", "over", key), Faults()
        if key not in known:
            hint = did_you_mean(key, known) or "; only keys that may be swept can be searched"
            problems.append(source.problem(place, f"is no key to search{hint}", at_key=True))
            continue
        with faults.under(*place):
            read = _read(known[key], extent)
            data["search"]["over"][key] = read
            _put(data, key, middle(read, known[key]))
        problems += (source.problem(fault.path, fault.message) for fault in faults)
    return replace(source, data=data)


def _read(declared: Parameter, extent: Any) -> Any:
    """Bounds or choices in the unit of their key. Raises Invalid."""
    one = replace(declared, sweep=False)
    if isinstance(extent, dict):
        try:
            return {"choice": list(read_items(extent["choice"], one.read))}
        except Invalid as error:
            raise Invalid(error.under("choice")) from None
    if not isinstance(declared, Quantity):
        raise Invalid("is a name: write {choice: [...]}")
    ends = each(extent, one.read)
    if ends[0] >= ends[1]:
        raise Invalid("the first number must be smaller than the second")
    if ends[1] - ends[0] < max(NARROW * max(map(abs, ends)), 1 / HUGE):
        raise Invalid("the numbers are too near to each other to search between them")
    return ends


def middle(extent: Any, declared: Parameter) -> Any:
    """Return the value that a search begins with: the first choice, or the middle of the bounds."""
    if isinstance(extent, dict):
        return extent["choice"][0]
    value = extent[0] + (extent[1] - extent[0]) / 2
    return int(value) if isinstance(declared, Quantity) and declared.integer else value


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    """Write a value where the study has none; not where something else than a block stands in the way."""
    *outer, name = key.split(".")
    for part in outer:
        if not isinstance(data := data.setdefault(part, {}), dict):
            return
    data.setdefault(name, value)


def search_problems(study: Study) -> Iterator[Problem]:
    """Yield what is wrong between a search and the rest of its study."""
    search: Search | None = study.search
    if search is None:
        return
    given = {key: (declared, value) for key, declared, value in study.parameters()}
    for key, sweep in study.sweeps().items():
        if isinstance(sweep, Drawn):
            yield study.problem(key, "is drawn from a distribution, which cannot stand beside a search: give one value")
            continue
        message = f"has {len(sweep)} values, and a search has one result for each evaluation: give one value, or search"
        yield study.problem(key, f"{message} over it as {{choice: [...]}}")
    for key, extent in search.over.items():
        value = given[key][1] if key in given else None
        if value is None:
            yield study.source.problem(("search", "over", key), "is not used by this study")
        elif isinstance(value, Sweep):
            continue
        elif not isinstance(value, int | float | str):
            yield study.problem(key, "is drawn from a distribution, and searched: give one value, or none")
        elif isinstance(extent, dict):
            if value not in extent["choice"]:
                yield study.problem(key, f"is where the search begins: must be {one_of(map(str, extent['choice']))}")
        elif not extent[0] <= value <= extent[1]:
            message = f"is where the search begins: must be between {extent[0]:g} and {extent[1]:g}, its bounds"
            yield study.problem(key, message)
    if study.report.published is not None:
        yield study.problem("report.published", "is for the grid of a sweep; leave it out of a search")
    if getattr(study, "sample", None) is not None:
        yield study.problem("sample", "cannot stand beside a search; leave one out")

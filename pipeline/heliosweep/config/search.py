"""The `search` block of a study file: objectives, searched keys and number of evaluations."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from heliosweep.config.blocks import Block, blocks_in
from heliosweep.config.faults import Fault, Faults, did_you_mean, each, one_of, require, shown, when
from heliosweep.config.source import Source
from heliosweep.config.values import (
    MAX_SEED,
    Choice,
    Drawn,
    Parameter,
    Quantity,
    Samples,
    Schema,
    Sweep,
    object_schema,
    read_items,
    read_mapping,
)
from heliosweep.errors import Problem

if TYPE_CHECKING:
    from heliosweep.config.study import Study

#: Dimension of the result of a search.
EVALUATION = "evaluation"
_FORM = "write [low, high], or {choice: [...]}"


@dataclass(frozen=True)
class Results(Parameter):
    """Name of a result, or a list of names."""

    def read(self, raw: Any) -> tuple[str, ...]:
        """Return the names. Raises Invalid."""
        names = raw if isinstance(raw, list | tuple) else (raw,)
        named = all(isinstance(name, str) and name.strip() for name in names)
        require(named, "must be the name of a result, or a list of two")
        return read_items(names, str) if names else ()

    def _one_schema(self) -> Schema:
        one = super()._one_schema()
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1, "maxItems": 2}]}


@dataclass(frozen=True)
class Extent(Parameter):
    """Values of a searched key before conversion to the unit of the key: ``[low, high]`` or ``{choice: [...]}``."""

    def read(self, raw: Any) -> Any:
        """Return bounds as a tuple, or choices as a mapping. `with_search` has checked and converted both."""
        return tuple(raw) if isinstance(raw, list) else raw

    def _one_schema(self) -> Schema:
        return {"anyOf": [{"type": "array", "minItems": 2, "maxItems": 2}, object_schema("", {"choice": {}})]}


class Limit(Block):
    """Bounds of a result, in the unit of the result."""

    at_least: Annotated[float | None, Quantity("Minimum of the result, in its unit", "1", sweep=False)] = None
    at_most: Annotated[float | None, Quantity("Maximum of the result, in its unit", "1", sweep=False)] = None

    def rules(self) -> Iterator[Fault]:
        """Check that there is at least one bound, and that the minimum does not exceed the maximum."""
        low, high = self.at_least, self.at_most
        return when(
            (low is high is None, Fault("give 'at_least', 'at_most' or both", show_value=False)),
            (low is not None and high is not None and low > high, Fault("must not exceed 'at_most'", ("at_least",))),
        )


class Search(Block):
    """Search for the best point of a study. Each evaluation uses different values of the searched keys."""

    maximise: Annotated[tuple[str, ...], Results("One or two results to maximise")] = ()
    minimise: Annotated[tuple[str, ...], Results("One or two results to minimise")] = ()
    over: Annotated[
        dict[str, Annotated[Any, Extent("Minimum and maximum of the key, or a choice of values")]],
        Field(description="Searched keys, such as receiver.height, with their bounds", min_length=1, max_length=20),
    ]
    budget: Annotated[
        int, Quantity("Maximum number of evaluations", "1", ge=1, le=100_000, integer=True, sweep=False)
    ]  # fmt: skip
    seed: Annotated[
        int,
        Quantity("Seed of the search", "1", ge=0, le=MAX_SEED, integer=True,
                 sweep=False),
    ] = 0  # fmt: skip
    subject_to: Annotated[
        dict[str, Limit],
        Field(description="Bounds on results: 'at_least', 'at_most' or both for each result"),
    ] = Field(default_factory=dict)

    def rules(self) -> Iterator[Fault]:
        """Check that there are one or two objectives, and enough evaluations for a generation."""
        goals, named = len(self.goals()), len(self.maximise) + len(self.minimise)
        needed = population(len(self.over), goals)
        message = f"must be at least {needed}, one generation of a search over {len(self.over)} keys"
        front = "give one result to 'maximise' or 'minimise', or two results for a front of best compromises"
        return when(
            (not 1 <= named <= 2, Fault(front, show_value=False)),
            (goals < named == 2, Fault("is also maximised: remove one of them", ("minimise",))),
            (1 <= goals == named <= 2 and self.budget < needed, Fault(message, ("budget",))),
        )

    def goals(self) -> dict[str, float]:
        """Return the sign of each objective: 1 to minimise, -1 to maximise."""
        return dict.fromkeys(self.maximise, -1.0) | dict.fromkeys(self.minimise, 1.0)

    def searched(self) -> tuple[str, ...]:
        """Return the searched keys in an order that does not depend on their order in the file."""
        return tuple(sorted(self.over))


def population(keys: int, goals: int) -> int:
    """Return the number of evaluations in one generation."""
    return max(10, 5 * keys) if goals < 2 else 4 * (4 + 2 * keys)


def searchable(block: type[Block], prefix: str = "") -> dict[str, Parameter]:
    """Return the declarations of all keys in a block that can be searched, by dotted key."""
    found: dict[str, Parameter] = {}
    for name, field in block.model_fields.items():
        declared = block.parameter(name)
        if declared is None:
            for inner in blocks_in(field.annotation):
                found = searchable(inner, f"{prefix}{name}.") | found
        elif declared.sweep and isinstance(declared, Quantity | Choice) and not isinstance(declared, Samples):
            found[f"{prefix}{name}"] = declared
    return found


def with_search(source: Source, study_class: type[Study], problems: list[Problem]) -> Source:
    """Return a study in which each searched key has a start value, and bounds in the unit of the key.

    If a searched key has no value, the search starts at the middle of its bounds, or at the first choice. Problems with
    searched keys are added to `problems`.
    """
    search = source.data.get("search")
    over = search.get("over") if isinstance(search, dict) else None
    data, known, faults = copy.deepcopy(source.data), searchable(study_class), Faults()
    for key, extent in over.items() if isinstance(over, dict) else ():
        if key not in known:
            hint = did_you_mean(key, known) or ": only keys that can be swept can be searched"
            message = f"is not a key that can be searched{hint}"
            problems.append(source.problem(("search", "over", key), message, at_key=True))
            continue
        with faults.under("search", "over", key):
            data["search"]["over"][key], first = _read(known[key], extent)
            block, (*outer, name) = data, key.split(".")
            for part in outer:
                block = block.setdefault(part, {}) if isinstance(block, dict) else {}
            if isinstance(block, dict):
                block.setdefault(name, first)
    problems += (source.problem(fault.path, fault.message) for fault in faults)
    return replace(source, data=data)


def _read(declared: Parameter, extent: Any) -> tuple[Any, Any]:
    """Return the bounds or choices in the unit of the key, and the start value of the search. Raises Invalid."""
    one = replace(declared, sweep=False)

    def choices(values: Any) -> list[Any]:
        several = isinstance(values, list) and len(values) > 1
        require(several, f"must be a list of at least two values (got {shown(values)})")
        return list(read_items(values, one.read))

    if isinstance(extent, dict):
        read = read_mapping(extent, {"choice": choices}, ("choice",), _FORM)
        return read, read["choice"][0]
    pair = isinstance(extent, list) and len(extent) == 2
    require(pair, f"must be the minimum and the maximum: {_FORM} (got {shown(extent)})")
    require(isinstance(declared, Quantity), "is a name: write {choice: [...]}")
    low, high = each(extent, one.read)
    require(low < high, "the first number must be smaller than the second")
    close = high - low < max(1e-9 * max(abs(low), abs(high)), 1e-250)
    require(not close, "the numbers are too close to search between them")
    middle = low + (high - low) / 2
    return [low, high], int(middle) if getattr(declared, "integer", False) else middle


def search_problems(study: Study) -> Iterator[Problem]:
    """Yield a problem for each conflict between a search and the rest of its study."""
    search: Search | None = study.search
    if search is None:
        return
    given = {key: value for key, _, value in study.parameters()}
    for key, sweep in study.sweeps().items():
        message = f"has {len(sweep)} values, but a search has one result for each evaluation: give one value, or search"
        message = f"{message} over it as {{choice: [...]}}"
        if isinstance(sweep, Drawn):
            message = "is drawn from a distribution, which a search does not support: give one value"
        yield study.problem(key, message)
    for key, extent in search.over.items():
        value, message = given.get(key), "is the starting value of the search and must be"
        if value is None:
            yield study.source.problem(("search", "over", key), "is not used by this study")
        elif not isinstance(value, int | float | str | Sweep):
            yield study.problem(key, "is both drawn from a distribution and searched: give one value, or remove it")
        elif isinstance(extent, dict) and not isinstance(value, Sweep) and value not in extent["choice"]:
            yield study.problem(key, f"{message} {one_of(map(str, extent['choice']))}")
        elif isinstance(extent, tuple) and not isinstance(value, Sweep) and not extent[0] <= value <= extent[1]:
            yield study.problem(key, f"{message} between {extent[0]:g} and {extent[1]:g}, its bounds")
    if study.report.published is not None:
        yield study.problem("report.published", "is for sweeps: remove it from a search")
    if study.sample is not None:
        yield study.problem("sample", "cannot be combined with a search: remove one of them")

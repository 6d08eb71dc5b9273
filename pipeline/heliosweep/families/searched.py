"""The search for the best point of a study of any family: a family whose result has the dimension ``evaluation``."""

from __future__ import annotations

import itertools
import math
import pkgutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.faults import did_you_mean, few_of, in_short
from heliosweep.config.search import population
from heliosweep.config.study import Study, replaced
from heliosweep.config.sweep import Sweep
from heliosweep.config.values import Quantity
from heliosweep.errors import Problem, StudyError
from heliosweep.families.family import Family
from heliosweep.grid.plan import EMPTY_FILE, Plan, Workload
from heliosweep.grid.regions import BEST_VALUE, LARGEST, SMALLEST, Cut, Variable, bytes_of
from heliosweep.search.course import EVALUATION

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.search.course import Space

#: Values for each instant, which a search omits.
_SERIES = ("time_series", "field_series")

Point = Mapping[str, Any]
"""Values of the searched keys."""


class Searched(Family):
    """Search for the best point of a study of another family.

    Every evaluation is the study with other values of the searched keys. `single` is one of them, `generation` several
    as a sweep; both are studies of the `family`.
    """

    def __init__(self, family: Family) -> None:
        self.family = family
        self.name, self.title = family.name, f"Search for the best point: {family.title[:1].lower()}{family.title[1:]}"
        self.references, self.keywords, self.headlines = family.references, family.keywords, family.headlines
        self._figures = "heliosweep.search.figures:figures"
        self._tables, self._remarks, self._answers = (
            f"heliosweep.search.result:{name}" for name in ("tables", "remarks", "answers")
        )

    def study_class(self) -> type[Study]:
        """Pydantic model of the study file."""
        return self.family.study_class()

    def prepare(self, study: Any) -> tuple[float, bool]:
        """Load or compile the kernels of the evaluations."""
        return self.family.prepare(self.single(study, {}))

    def single(self, study: Study, point: Point) -> Study:
        """The study at a point, as it runs by itself; keys that the point lacks keep their values."""
        return _with(study, point, {})

    def generation(self, study: Study, points: Sequence[Point]) -> Study:
        """The study at several points, one after the other along one dimension."""
        keys = study.search.searched() if study.search else ()
        columns = {key: Sweep(tuple(point[key] for point in points)) for key in keys}
        return _with(study, columns, {"zip": (keys,) if len(keys) > 1 else ()})

    def space(self, study: Study) -> Space:
        """Bounds of the searched keys; a choice is counted from 0."""
        from heliosweep.search.course import Space

        extents = [_search(study).over[key] for key in _search(study).searched()]
        declared = {key: one for key, one, _ in study.parameters()}
        chosen = [isinstance(extent, dict) for extent in extents]
        ends = [(0, len(one["choice"]) - 1) if isinstance(one, dict) else one for one in extents]
        integer = [getattr(declared[key], "integer", False) for key in _search(study).searched()]
        low, high = np.array(ends, dtype=float).T
        return Space(low, high, np.array(chosen) | np.array(integer))

    def point(self, study: Study, numbers: Iterable[float]) -> dict[str, Any]:
        """Values of the searched keys at a point of the `space`."""
        search, declared = _search(study), {key: one for key, one, _ in study.parameters()}
        values: dict[str, Any] = {}
        for key, number in zip(search.searched(), numbers, strict=True):
            extent, one = search.over[key], declared[key]
            whole = isinstance(one, Quantity) and one.integer
            values[key] = (
                extent["choice"][int(number)] if isinstance(extent, dict) else int(number) if whole else number
            )
        return values

    def start(self, study: Study) -> np.ndarray:
        """Start of the search in the `space`: the values in the study."""
        given, over = {key: value for key, _, value in study.parameters()}, _search(study).over
        return np.array([
            over[key]["choice"].index(given[key]) if isinstance(over[key], dict) else given[key]
            for key in _search(study).searched()
        ], dtype=float)  # fmt: skip

    def wrong(self, study: Study, point: Point) -> Problem | None:
        """Return a problem of the plant at a point, such as mirrors that collide; None if it can be built."""
        try:
            return next(iter(self.single(study, point).check()), None)
        except StudyError as error:
            return error.problems[0]

    def results(self, study: Study) -> dict[str, Variable]:
        """Results with one number for each point, which may be sought and bounded."""
        given = {key: value for key, _, value in study.parameters()}
        one = self.generation(study, [{key: given[key] for key in _search(study).searched()}])
        (swept,), sizes = one.dimensions(), self.family.workload(one).sizes
        return {
            name: each
            for name, each in self.family.variables(one).items()
            if each.dtype.kind in "fiu" and swept.name in each.dims and math.prod(sizes[dim] for dim in each.dims) == 1
        }

    def check(self, study: Study) -> Iterator[Problem]:
        """Yield problems of the results named by a search."""
        search, known = _search(study), self.results(study)
        others = self.family.variables(self.single(study, {}))
        named = [(("search", way), name) for way in ("maximise", "minimise") for name in getattr(search, way)]
        seen: dict[tuple[bool, str], str] = {}
        for place, name in (*named, *((("search", "subject_to", name), name) for name in search.subject_to)):
            if (result := result_name(name, known)) in known:
                if (other := seen.setdefault((len(place) > 2, result), name)) != name:
                    yield study.source.problem(place, f"{name} is the same result as {other}; name it once")
                continue
            if name in others:
                along = " and ".join(others[name].dims)
                why = f"{name} has a value for each {along}" if along else f"{name} does not depend on what is searched"
            else:
                alike = [one for one in known if name in one]
                hint = f"; with '{name}' in their names are {few_of(alike)}" if alike else did_you_mean(name, known)
                if (key := self.family.optional.get(result_name(name, self.family.optional))) is not None:
                    hint = f"; with '{key}' it is"
                why = f"{in_short(name)} is no result of this study{hint}"
            there = (
                f"results of one number are {', '.join(known)}" if known else "no result is one number at each point"
            )
            yield study.source.problem(place, f"{why}; {there}")

    def variables(self, study: Study) -> dict[str, Variable]:
        """Return the variables of each evaluation: values of the searched keys, by dotted key, and its `results`."""
        keys = {key: Variable((EVALUATION,), {}) for key in _search(study).searched()}
        found, ways = self.results(study), (("maximise", LARGEST), ("minimise", SMALLEST))
        best = {
            result_name(name, found): {BEST_VALUE: end} for way, end in ways for name in getattr(_search(study), way)
        }
        return keys | {
            name: Variable((EVALUATION,), {**one.attrs, **best.get(name, {})}) for name, one in found.items()
        }

    def coordinates(self, study: Study) -> xr.Dataset:
        """Labels that all evaluations share."""
        labels = self.family.coordinates(self.single(study, {}))
        varied = {*self.generation(study, [self.point(study, self.start(study))]).dimension_names().values()}
        return labels.drop_vars([name for name, one in labels.coords.items() if one.ndim or str(name) in varied])

    def first(self, study: Study) -> Study:
        """Return a generation of the size of the search, at the ends of its bounds, for the plan."""
        search, space = _search(study), self.space(study)
        ends = [self.point(study, numbers) for numbers in (self.start(study), space.low, space.high)]
        built = [ends[0], *(point for point in ends[1:] if self.wrong(study, point) is None)]
        count = population(len(space), len(search.goals()))
        return self.generation(study, list(itertools.islice(itertools.cycle(built), count)))

    def workload(self, study: Study) -> Workload:
        """Sizes and cost of all evaluations that the budget allows; a generation is held in memory, see `plan`."""
        of_one = self.family.workload(self.first(study))
        return Workload(
            {EVALUATION: _search(study).budget},
            {},
            of_one.evaluations,
            of_one.unit,
            lambda points, length: 0,
            axes=of_one.axes,
        )

    def plan(self, study: Study, generation: Plan) -> Plan:
        """Return the plan of a search from the plan of a `first` generation: each evaluation is a chunk."""
        work, variables = self.workload(study), self.variables(study)
        sizes = work.sizes
        return Plan(
            work,
            variables,
            {"points": Cut(sizes, sizes, {EVALUATION: 1})},
            generation.workers,
            generation.peak_memory,
            bytes_of(variables, sizes) + EMPTY_FILE,
        )


@cache
def searched(family: Family) -> Searched:
    """The search of a family."""
    return Searched(family)


def found_by(family: Family, result: xr.Dataset) -> Searched:
    """Return the search of a family that found a result, with the goals as headlines."""
    made = Searched(family)
    goals: Iterable[str] = pkgutil.resolve_name("heliosweep.search.result:goals_of")(result)
    made.headlines = tuple(goals)
    return made


def result_name(name: str, known: Iterable[str]) -> str:
    """Return the name of a stored result; ``field_`` can be omitted for results of a field."""
    return name if name in known or f"field_{name}" not in known else f"field_{name}"


def _search(study: Study) -> Any:
    assert study.search is not None
    return study.search


def _with(study: Study, values: Mapping[str, Any], changes: Mapping[str, Any]) -> Study:
    """The study without its search, with other values, and with all results of one number and none over time."""
    output = study.output
    wanted = dict.fromkeys(type(output).OF_POINTS, True)
    wanted |= {name: False for name in _SERIES if name in type(output).model_fields}
    made = study.model_copy(update={"search": None, "output": output.model_copy(update=wanted), **changes})
    for key, value in values.items():
        made = replaced(made, key, value)
    return made

"""One run of a search: the optimiser asks for generations, each is a small grid, and every evaluation is kept.

The working store holds an evaluation in each part. A run that goes on lets the optimiser ask anew and answers from the
store as long as it can, so that the course and the result are those of a run that was never stopped.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from heliosweep.config.search import population
from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError, reason_of
from heliosweep.families.searched import Searched, result_name
from heliosweep.files import write_whole
from heliosweep.grid.lazy import Work
from heliosweep.grid.parameters import coordinate_attributes, coordinate_name
from heliosweep.grid.plan import Plan
from heliosweep.grid.regions import Cut, Part, part_name, parts_by_slab
from heliosweep.runs.executors import TRIES, Pool, compute_parts, safe_path
from heliosweep.runs.run import Run, pool_of
from heliosweep.runs.signals import TidyStack, raise_if_interrupted
from heliosweep.runs.status import show_progress
from heliosweep.search.course import EVALUATION
from heliosweep.sources import version_of
from heliosweep.store.folder import BEST
from heliosweep.store.manifest import identity_of
from heliosweep.store.parts import PartStore
from heliosweep.store.read import open_result

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.search.course import Course


log = logging.getLogger("heliosweep")


class _Task(NamedTuple):
    """A part of a generation, with what computes it."""

    part: Part
    work: Work


class _Generations:
    """What a pool computes: parts of one generation after the other."""

    def __init__(self, module: str) -> None:
        self.module = module

    def compute(self, task: _Task) -> dict[str, np.ndarray]:
        """Values of a part."""
        return task.work.compute(task.part)


class SearchRun(Run):
    """One run of a search in a result folder that it has claimed; `plan_of` plans a generation."""

    family: Searched

    def __init__(
        self,
        family: Searched,
        study: Study,
        folder: Path,
        planned: Callable[[], Plan],
        plan_of: Callable[[Study], Plan],
    ) -> None:
        super().__init__(family, study, folder, planned)
        self._plan_of = plan_of
        assert study.search is not None
        self._search = study.search
        self._arrays: dict[str, np.ndarray] = {}

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Identity of the result, with the version of the optimiser."""
        modules = self.family.numbers_from(self.study), "heliosweep.search.optimise"
        found = identity_of(self.study, self._words, *modules)
        found["code"] = {**found["code"], "pymoo": version_of("pymoo") or "missing"}
        return found

    @cached_property
    def _results(self) -> list[str]:
        """Results that are kept of each evaluation."""
        return list(self.family.results(self.study))

    def _is_taken(self, kind: str) -> bool:
        """False: an earlier result is not taken as it is, but its evaluations are, see `_compute`."""
        return False

    def _missing(self, store: PartStore) -> Iterator[Part]:
        """Only the optimiser knows what is missing: all parts."""
        return self.plan.parts()

    def _compute(self, store: PartStore, show: bool) -> None:
        """Search, and compute what was not before; then the plan and the coordinates are those of the result."""
        from heliosweep.search.optimise import optimise

        study, search, family = self.study, self._search, self.family
        results, known = self._results, self._known()
        limits = {result_name(name, results): limit for name, limit in search.subject_to.items()}
        signs = {result_name(name, results): sign for name, sign in search.goals().items()}
        rows: list[np.ndarray] = []
        with TidyStack() as stack:
            display = show_progress(study.title or study.family, search.budget) if show else nullcontext(lambda: None)
            advance = stack.enter_context(display)
            pools: list[Pool] = []

            def pool() -> Pool:
                """Workers, from when something has to be computed."""
                if not pools:
                    place = TemporaryDirectory(dir=store.folder, ignore_cleanup_errors=True)
                    scratch = Path(stack.enter_context(place))
                    stack.enter_context(safe_path())
                    work: Any = _Generations(family.numbers_from(study))
                    pools.append(stack.enter_context(pool_of(study.execution, work, self.plan.workers, scratch)))
                return pools[0]

            def evaluate(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                first = len(rows)
                found = [self._stored(store, known, first + i, point) for i, point in enumerate(points)]
                missing = [i for i, row in enumerate(found) if row is None]
                if missing:
                    computed = self._evaluated(points[missing], pool, first)
                    for i, row in zip(missing, computed, strict=True):
                        found[i] = row
                        said = zip(self._names(), (*points[i], *row), strict=True)
                        store.commit(_part(first + i), {name: np.array([value]) for name, value in said})
                for each in found:
                    assert each is not None
                    rows.append(each)
                    advance()
                values = dict(zip(results, np.array(rows[first:]).T, strict=True))
                return _rated(values, signs, limits)

            course = optimise(
                evaluate,
                family.space(study),
                len(signs),
                search.budget,
                search.seed,
                population(len(search.over), len(signs)),
                family.start(study),
            )
            store.sync()
        self._describe(course, dict(zip(results, np.array(rows).T, strict=True)), signs, limits)

    def _names(self) -> list[str]:
        """What is kept of each evaluation, in the order of the store."""
        return [*self._search.searched(), *self._results]

    def _known(self) -> dict[str, np.ndarray]:
        """Evaluations of an earlier result of the same search, where it has all that is wanted now."""
        from heliosweep.search.result import keys_of

        if self._taken is None:
            return {}
        with open_result(self._taken.path) as data:
            if not {*self._results} <= {*map(str, data.data_vars)}:
                return {}
            found = {str(name): one.to_numpy() for name, one in data.data_vars.items()}
            names = {key: data[name].to_numpy() for key, name in keys_of(data).items()}
        over = self._search.over
        for key, values in names.items():
            extent = over[key]
            found[key] = np.array([extent["choice"].index(v) for v in values.tolist()] if isinstance(extent, dict)
                                  else values, dtype=float)  # fmt: skip
        return found

    def _stored(
        self, store: PartStore, known: Mapping[str, np.ndarray], number: int, point: np.ndarray
    ) -> np.ndarray | None:
        """Results of an evaluation that an earlier run has computed; None where there is none."""
        names, part = self._names(), _part(number)
        if part.name in store.done:
            values = [float(value) for each in store.read(part).values() for value in each]
        elif known and number < len(known[names[0]]):
            values = [float(known[name][number]) for name in names]
        else:
            return None
        if values[: len(point)] != point.tolist():
            raise HeliosweepError(
                f"{self.folder}: evaluation {number + 1} is of another course of the search, computed by other "
                "versions; --force (force=True in Python) begins it anew"
            )
        return np.array(values[len(point) :])

    def _evaluated(self, points: np.ndarray, pool: Callable[[], Pool], first: int) -> list[np.ndarray]:
        """Results at points, in their order; NaN where no plant can be built."""
        study, family = self.study, self.family
        plants = [family.point(study, map(float, point)) for point in points]
        built = [i for i, plant in enumerate(plants) if family.wrong(study, plant) is None]
        rows = [np.full(len(self._results), np.nan) for _ in points]
        if not built:
            return rows
        generation = family.generation(study, [plants[i] for i in built])
        plan = self._plan_of(generation)
        work = Work(family.family, generation, plan.variables, plan.workload.sizes)
        (swept,) = generation.dimensions()
        for slab, pieces in parts_by_slab({"points": plan.cuts["points"]}):
            parts: list[tuple[Part, dict[str, np.ndarray]]] = []
            tasks: Iterator[Any] = (_Task(part, work) for part in pieces)
            for outcome in compute_parts(pool(), tasks):
                raise_if_interrupted()
                if outcome.values is None:
                    which = f"evaluations {first + 1} to {first + len(points)} failed {TRIES} times"
                    again = "run the same command again when the cause is mended"
                    raise HeliosweepError(f"{which} ({reason_of(outcome.error)}); {again}")
                task: Any = outcome.part
                parts.append((task.part, outcome.values))
            finished = work.finish(slab, partial(iter, parts))
            span = slab.region.get(swept.name, slice(0, len(built)))
            count = span.stop - span.start
            if wide := [name for name in self._results if finished[name].size != count]:
                raise HeliosweepError(f"{wide[0]} has several values at one of the evaluations from {first + 1} on")
            columns = [finished[name].to_numpy().astype(float).reshape(count) for name in self._results]
            for i, row in zip(range(span.start, span.stop), np.array(columns).T, strict=True):
                rows[built[i]] = row
        return rows

    def _describe(
        self, course: Course, values: dict[str, np.ndarray], signs: Mapping[str, float], limits: Mapping[str, Any]
    ) -> None:
        """Make plan, coordinates and arrays those of the result: as many evaluations as there are."""
        from heliosweep.search.result import described

        goals, missed = _rated(values, signs, limits)
        known = self.family.results(self.study)
        variables = {name: replace(one, dims=(EVALUATION,), finished=False, dtype=np.dtype(float))
                     for name, one in known.items()}  # fmt: skip
        variables, self._arrays = described(values, variables, goals, missed, course.generations)
        sizes = {EVALUATION: len(course.points)}
        workload = replace(self.plan.workload, parameters=sizes)
        cuts = {"points": Cut(sizes, sizes, sizes)}
        self.plan = replace(self.plan, workload=workload, variables=variables, cuts=cuts)
        self.coordinates = self._labelled(course)

    def _labelled(self, course: Course) -> xr.Dataset:
        """Coordinates of the result: numbers of the evaluations, and the searched keys along them."""
        study, labels = self.study, self.coordinates
        attrs = {"long_name": "number of the evaluation, in the order of the search", "units": "1"}
        labels = labels.assign_coords({EVALUATION: (EVALUATION, np.arange(1, len(course.points) + 1), attrs)})
        plants = [self.family.point(study, map(float, point)) for point in course.points]
        declared = {key: one for key, one, _ in study.parameters()}
        for key in self._search.searched():
            column = [plant[key] for plant in plants]
            array = np.array(column, dtype=object if isinstance(column[0], str) else float)
            attrs = {**coordinate_attributes(declared[key], key), "key": key}
            labels = labels.assign_coords({coordinate_name(declared[key], key): (EVALUATION, array, attrs)})
        return labels

    def _slabs(self, store: PartStore) -> Iterator[tuple[Part, Mapping[str, Any]]]:
        """The only slab: all evaluations."""
        yield Part(part_name("points", 0), "points", {EVALUATION: slice(0, self.plan.workload.points)}), self._arrays

    def _record(self, path: Path, digests: dict[str, str]) -> None:
        """Write the best point as a study that runs by itself, the manifest and the resolved study."""
        from heliosweep.search.result import best_of, goals_of, keys_of, point_text

        with open_result(path) as data:
            place = best_of(data)
            if place is not None:
                point = {key: data[name][place].item() for key, name in keys_of(data).items()}
                best = self.family.single(self.study, _whole(self.study, point))
                title = f"{self.study.title or self.family.family.title}: the best point"
                best = best.model_copy(update={"title": title})
                found = ", ".join(f"{name} {data[name][place].item():.6g}" for name in goals_of(data))
                log.info("best: evaluation %d at %s: %s", place + 1, point_text(data, place), found)
                head = f"# Evaluation {place + 1} of the search {self.study_id}: {point_text(data, place)}\n"
                write_whole(self.folder / BEST, head + best.to_yaml(self.folder))
        super()._record(path, digests)


def _whole(study: Study, point: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a point with whole numbers where the study wants them."""
    declared = {key: one for key, one, _ in study.parameters()}
    return {key: int(value) if getattr(declared[key], "integer", False) else value for key, value in point.items()}


def _part(number: int) -> Part:
    """The part of one evaluation in the working store."""
    return Part(part_name("points", number), "points", {EVALUATION: slice(number, number + 1)})


def _rated(
    values: Mapping[str, np.ndarray], signs: Mapping[str, float], limits: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Goals to be minimised, shape (evaluations, goals), and by how much bounds are missed; infinite without value."""
    from heliosweep.search.result import missed_by

    goals = np.stack([sign * values[name] for name, sign in signs.items()], axis=-1)
    missed = missed_by({**values}, limits)
    missed = np.where(np.isnan(goals).any(axis=-1), np.inf, missed)
    return np.where(np.isnan(goals), np.inf, goals), missed

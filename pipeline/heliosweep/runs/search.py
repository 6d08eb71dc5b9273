"""Run of a search: each generation of the optimiser is a small grid, and each evaluation is stored.

A resumed run repeats the search with the stored evaluations, so that course and result equal an uninterrupted run.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.search import population
from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError
from heliosweep.families.searched import Searched, result_name
from heliosweep.files import write_whole
from heliosweep.grid.lazy import Work
from heliosweep.grid.parameters import coordinate_attributes, coordinate_name
from heliosweep.grid.plan import Plan
from heliosweep.grid.regions import Cut, Piece, chunks_by_block, in_result, piece_name
from heliosweep.runs.executors import Workers, explain_failure
from heliosweep.runs.run import Run, plan_study, prepare_kernels, show_progress
from heliosweep.search.course import EVALUATION
from heliosweep.sources import source_digest, version_of
from heliosweep.store.folder import BEST
from heliosweep.store.manifest import attributes_of
from heliosweep.store.read import open_result

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.search.course import Course
    from heliosweep.store.writer import Template


log = logging.getLogger("heliosweep")


class SearchRun(Run):
    """One run of a search in a result folder."""

    family: Searched

    def __init__(self, family: Searched, study: Study, folder: Path) -> None:
        super().__init__(family, study, folder)
        assert study.search is not None
        self._search = study.search
        self._arrays: dict[str, np.ndarray] = {}

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Everything that the bytes of the result depend on, the optimiser too."""
        from heliosweep.search import optimise

        found = super().identity
        code = {**found["code"], "search": source_digest(Path(optimise.__file__))[:16]}
        return {**found, "code": {**code, "pymoo": version_of("pymoo") or "missing"}}

    @cached_property
    def _results(self) -> list[str]:
        """Results that are stored of each evaluation."""
        return list(self.family.results(self.study))

    def compute(self, plan: Plan, progress: bool) -> tuple[Template, Iterator[tuple[Piece, Any]]]:
        """Search, and return the template of the result and its only block."""
        from heliosweep.store.writer import Template

        self.store.create(plan.cuts, identity=self.identity, study_id=self.study_id)
        with self.timed("prepare"):
            prepare_kernels(self.family, self.study)
        with self.timed("compute"):
            self._optimise(progress)
        plan = self.plan
        attributes = attributes_of(self._words, self.coordinates)
        template = Template(plan.workload.sizes, self.coordinates, in_result(plan.variables), attributes, plan.cuts)
        block = Piece(piece_name("points", 0), "points", {EVALUATION: slice(0, plan.workload.points)})
        return template, iter([(block, self._arrays)])

    def _optimise(self, progress: bool) -> None:
        """Evaluate points of the optimiser until its budget is spent."""
        from heliosweep.search.optimise import optimise

        study, search, family, results = self.study, self._search, self.family, self._results
        limits = {result_name(name, results): limit for name, limit in search.subject_to.items()}
        signs = {result_name(name, results): sign for name, sign in search.goals().items()}
        rows: list[np.ndarray] = []
        display = show_progress(study.title or study.family, search.budget, shown=progress)
        with display as advance, Workers(study.execution, self.plan.workers) as workers:

            def evaluate(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                first = len(rows)
                found = [self._stored(first + i, point) for i, point in enumerate(points)]
                missing = [i for i, row in enumerate(found) if row is None]
                for i, computed in zip(missing, self._evaluated(points[missing], workers, first), strict=True):
                    found[i] = computed
                    values = zip(self._names(), (*points[i], *computed), strict=True)
                    self.store.save(piece_name("points", first + i), {key: np.array([value]) for key, value in values})
                for row in found:
                    assert row is not None
                    rows.append(row)
                    advance()
                return _rated(dict(zip(results, np.array(rows[first:]).T, strict=True)), signs, limits)

            course = optimise(
                evaluate,
                family.space(study),
                len(signs),
                search.budget,
                search.seed,
                population(len(search.over), len(signs)),
                family.start(study),
            )
        self._describe(course, dict(zip(results, np.array(rows).T, strict=True)), signs, limits)

    def _names(self) -> list[str]:
        """Names of the stored values of each evaluation, in their order."""
        return [*self._search.searched(), *self._results]

    def _stored(self, number: int, point: np.ndarray) -> np.ndarray | None:
        """Results of a stored evaluation, or None. Raises HeliosweepError for another course of the search."""
        stored = self.store.load(piece_name("points", number))
        if stored is None:
            return None
        values = [float(stored[name][0]) for name in self._names()]
        if values[: len(point)] != point.tolist():
            raise HeliosweepError(
                f"{self.folder}: evaluation {number + 1} belongs to another course of the search, computed by other "
                "versions; --force (force=True in Python) starts the search again"
            )
        return np.array(values[len(point) :])

    def _evaluated(self, points: np.ndarray, workers: Workers, first: int) -> list[np.ndarray]:
        """Results at points, in their order; NaN if no plant can be built."""
        study, family = self.study, self.family
        plants = [family.point(study, map(float, point)) for point in points]
        built = [i for i, plant in enumerate(plants) if family.wrong(study, plant) is None]
        rows = [np.full(len(self._results), np.nan) for _ in points]
        if not built:
            return rows
        generation = family.generation(study, [plants[i] for i in built])
        plan = plan_study(generation, self.folder)
        work = Work(family.family, generation, plan.variables, plan.workload.sizes)
        (swept,) = generation.dimensions()
        for block, pieces in chunks_by_block({"points": plan.cuts["points"]}):
            chunks: list[tuple[Piece, dict[str, np.ndarray]]] = []
            for chunk, outcome in workers.compute(work, pieces):
                if isinstance(outcome, Exception):
                    evaluations = f"evaluations {first + 1} to {first + len(points)} failed"
                    again = "correct the cause and run the same command again"
                    raise HeliosweepError(f"{evaluations} ({explain_failure(outcome)}); {again}") from outcome
                chunks.append((chunk, outcome))
            finished = work.finish(block, partial(iter, chunks))
            span = block.region.get(swept.name, slice(0, len(built)))
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
        """Adapt plan, coordinates and arrays to the number of evaluations."""
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

    def _record(self, path: Path) -> None:
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
        super()._record(path)


def _whole(study: Study, point: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a point with whole numbers where the study wants them."""
    declared = {key: one for key, one, _ in study.parameters()}
    return {key: int(value) if getattr(declared[key], "integer", False) else value for key, value in point.items()}


def _rated(
    values: Mapping[str, np.ndarray], signs: Mapping[str, float], limits: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Goals to be minimised, shape (evaluations, goals), and by how much bounds are missed; infinite without value."""
    from heliosweep.search.result import missed_by

    goals = np.stack([sign * values[name] for name, sign in signs.items()], axis=-1)
    missed = missed_by({**values}, limits)
    missed = np.where(np.isnan(goals).any(axis=-1), np.inf, missed)
    return np.where(np.isnan(goals), np.inf, goals), missed

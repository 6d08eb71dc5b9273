"""Runs of searches. Each generation of the optimiser is computed as a grid, and each evaluation is stored.

A resumed run repeats the search from its start and reads the stored evaluations. The steps and the result are
therefore identical to those in an uninterrupted run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from heliosweep.config import EVALUATION, Study, population
from heliosweep.errors import HeliosweepError, log
from heliosweep.families.lookup import Searched, result_name
from heliosweep.files import write_whole
from heliosweep.grid import Cut, Piece, Work, chunks_by_block, coordinate_attributes, coordinate_name, piece_name
from heliosweep.lazy import xr
from heliosweep.runs.run import Run, Workers, explain_failure, plan_study, prepare_kernels, show_progress
from heliosweep.sources import source_digest, version_of
from heliosweep.store.folder import BEST, open_result

if TYPE_CHECKING:
    from heliosweep.search.optimise import Course


class SearchRun(Run):
    """Run of a study with a search, stored in a result folder."""

    family: Searched

    def __init__(self, family: Searched, study: Study, folder: Path) -> None:
        super().__init__(family, study, folder)
        assert study.search is not None
        self._search = study.search

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Inputs, including the optimiser, that determine the bytes of the result file."""
        from heliosweep.search import optimise

        found = super().identity
        code = {**found["code"], "search": source_digest(Path(optimise.__file__))[:16]}
        return {**found, "code": {**code, "pymoo": version_of("pymoo") or "missing"}}

    def compute(self, progress: bool) -> Iterator[tuple[Piece, Mapping[Any, Any]]]:
        """Run the search and return an iterator over the single block of the result."""
        self.store.create(self.plan.cuts, identity=self.identity, study_id=self.study_id)
        with self.timed("prepare"):
            prepare_kernels(self.family, self.study)
        with self.timed("compute"):
            arrays = self._optimise(progress)
        region = {EVALUATION: slice(0, self.plan.workload.points)}
        return iter([(Piece(piece_name("points", 0), "points", region), arrays)])

    def _optimise(self, progress: bool) -> dict[str, np.ndarray]:
        from heliosweep.search import result
        from heliosweep.search.optimise import optimise

        study, search, family, known = self.study, self._search, self.family, self.family.results(self.study)
        limits = {result_name(name, known): limit for name, limit in search.subject_to.items()}
        signs = {result_name(name, known): sign for name, sign in search.goals().items()}
        names = [*search.searched(), *known]
        rows: list[np.ndarray] = []
        display = show_progress(study.title or study.family, search.budget, shown=progress)

        def rated(first: int) -> tuple[np.ndarray, np.ndarray]:
            """Return the objectives to minimise, shape (evaluations, objectives), and the constraint violations."""
            values = dict(zip(known, np.array(rows[first:]).T, strict=True))
            goals = np.stack([sign * values[name] for name, sign in signs.items()], axis=-1)
            missed = np.where(np.isnan(goals).any(axis=-1), np.inf, result.missed_by(values, limits))
            return np.where(np.isnan(goals), np.inf, goals), missed

        with display as advance, Workers(study.execution, self.plan.workers) as workers:

            def evaluate(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                first = len(rows)
                stored = [self._stored(first + i, point, names) for i, point in enumerate(points)]
                missing = [i for i, row in enumerate(stored) if row is None]
                found = dict(zip(missing, self._evaluated(points[missing], list(known), workers, first), strict=True))
                for i, row in found.items():
                    values = zip(names, (*points[i], *row), strict=True)
                    self.store.save(piece_name("points", first + i), {key: np.array([value]) for key, value in values})
                for i, known_row in enumerate(stored):
                    rows.append(found[i] if known_row is None else known_row)
                    advance()
                return rated(first)

            size, space = population(len(search.over), len(signs)), family.space(study)
            course = optimise(evaluate, space, len(signs), search.budget, search.seed, size, family.start(study))
        variables = {name: replace(one, dims=(EVALUATION,), finished=False, dtype=np.dtype(float))
                     for name, one in known.items()}  # fmt: skip
        values = dict(zip(known, np.array(rows).T, strict=True))
        variables, arrays = result.described(values, variables, *rated(0), course.generations)
        sizes = {EVALUATION: len(course.points)}
        workload = replace(self.plan.workload, parameters=sizes)
        self.plan = replace(
            self.plan, workload=workload, variables=variables, cuts={"points": Cut(sizes, sizes, sizes)}
        )
        self.coordinates = self._labelled(course)
        return arrays

    def _stored(self, number: int, point: np.ndarray, names: list[str]) -> np.ndarray | None:
        """Return the results of a stored evaluation, or None if the evaluation is not stored.

        Raises HeliosweepError if the stored evaluation belongs to a different point.
        """
        stored = self.store.load(piece_name("points", number))
        if stored is None:
            return None
        values = np.array([float(stored[name][0]) for name in names])
        if values[: len(point)].tolist() != point.tolist():
            raise HeliosweepError(
                f"{self.folder}: evaluation {number + 1} belongs to a different course of the search, computed by "
                "other versions; --force (force=True in Python) starts the search again"
            )
        return values[len(point) :]

    def _evaluated(self, points: np.ndarray, results: list[str], workers: Workers, first: int) -> list[np.ndarray]:
        """Return the results at the given points, in the same order. Results of infeasible points are NaN."""
        study, family = self.study, self.family
        plants = [family.point(study, map(float, point)) for point in points]
        built = [i for i, plant in enumerate(plants) if family.wrong(study, plant) is None]
        rows = [np.full(len(results), np.nan) for _ in points]
        if not built:
            return rows
        generation = family.generation(study, [plants[i] for i in built])
        plan = plan_study(generation, self.folder)
        work = Work(family.inner, generation, plan.variables, plan.workload.sizes)
        (swept,) = generation.dimensions()
        for block, pieces in chunks_by_block({"points": plan.cuts["points"]}):
            chunks = list(workers.compute(work, pieces))
            for _, outcome in chunks:
                if isinstance(outcome, Exception):
                    why = f"evaluations {first + 1} to {first + len(points)} failed ({explain_failure(outcome)})"
                    raise HeliosweepError(f"{why}: correct the cause and run the same command again") from outcome
            finished = work.finish(block, partial(lambda done, _: done, cast("Any", chunks)))
            span = block.region.get(swept.name, slice(0, len(built)))
            if wide := [name for name in results if finished[name].size != span.stop - span.start]:
                raise HeliosweepError(f"{wide[0]} has several values at one of the evaluations from {first + 1} on")
            columns = [finished[name].values.astype(float).ravel() for name in results]
            for i, row in zip(built[span], np.array(columns).T, strict=True):
                rows[i] = row
        return rows

    def _labelled(self, course: Course) -> xr.Dataset:
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
        from heliosweep.search.result import best_of, goals_of, keys_of, point_text

        with open_result(path) as data:
            place = best_of(data)
            if place is not None:
                whole = {key for key, declared, _ in self.study.parameters() if getattr(declared, "integer", False)}
                values = {key: data[name][place].item() for key, name in keys_of(data).items()}
                point = {key: int(value) if key in whole else value for key, value in values.items()}
                best = self.family.single(self.study, point)
                title = f"{self.study.title or self.family.inner.title}: the best point"
                best = best.model_copy(update={"title": title})
                found = ", ".join(f"{name} {data[name][place].item():.6g}" for name in goals_of(data))
                log.info("best: evaluation %d at %s: %s", place + 1, point_text(data, place), found)
                head = f"# Evaluation {place + 1} of the search {self.study_id}: {point_text(data, place)}\n"
                write_whole(self.folder / BEST, head + best.to_yaml(self.folder))
        super()._record(path)

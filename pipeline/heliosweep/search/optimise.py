"""Optimisers for searches, from `pymoo` (extra `search`) and SciPy.

A single objective is optimised by particle swarm optimisation (Kennedy and Eberhart 1995,
doi:10.1109/ICNN.1995.488968). COBYQA then refines the best point (Ragonneau and Zhang 2025,
doi:10.1007/s10107-025-02241-6). Two objectives are optimised by NSGA-II (Deb, Pratap, Agarwal and Meyarivan 2002,
doi:10.1109/4235.996017). Points that satisfy all bounds are ranked first.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.errors import load_extra
from heliosweep.kernels.compiled import Floats
from heliosweep.lazy import scipy

#: Finite replacement for infinity.
HUGE = 1e100
#: Number of consecutive generations without improvement after which an optimiser stops. For two objectives, an
#: improvement is any new point.
PATIENCE = 10


class BudgetSpent(Exception):
    """Exception raised when a search has used all evaluations in its budget."""


@dataclass(frozen=True)
class Space:
    """Bounds of the searched keys.

    Parameters
    ----------
    low, high : ndarray, shape (keys,)
        Lower and upper bound of each searched key.
    whole : ndarray of bool, shape (keys,)
        True for keys with integer values.
    """

    low: Floats
    high: Floats
    whole: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.low)

    @property
    def decimals(self) -> list[int]:
        """Number of decimals that resolve 1e-6 of the range of each key."""
        span = (self.high - self.low) * 1e-6
        return [0 if whole else -int(np.floor(np.log10(step))) for step, whole in zip(span, self.whole, strict=True)]

    def points(self, shares: Floats) -> Floats:
        """Convert fractions (0 to 1) of the key ranges to rounded points, shape (points, keys)."""
        raw = self.low + np.clip(shares, 0.0, 1.0) * (self.high - self.low)
        rounded = [[round(float(x), digits) for x, digits in zip(row, self.decimals, strict=True)] for row in raw]
        return np.clip(np.array(rounded, dtype=float).reshape(raw.shape), self.low, self.high)

    def shares(self, points: Floats) -> Floats:
        """Convert points to fractions of the key ranges."""
        return (points - self.low) / (self.high - self.low)


#: Function that evaluates points, shape (n, keys). It returns the objectives to minimise, shape (n, objectives), and
#: the violations of the bounds, shape (n,). If a point has no value, its objectives and violation are infinite.
Evaluate = Callable[[Floats], tuple[Floats, Floats]]


@dataclass
class Course:
    """All evaluations of a search. No point is evaluated twice, and at most `budget` points are evaluated.

    Each generation extends the lists `points`, `goals` and `missed`. The list `generations` contains the generation
    number of each point, counted from 0.
    """

    evaluate: Evaluate
    space: Space
    budget: int
    points: list[Floats] = field(default_factory=list)
    goals: list[Floats] = field(default_factory=list)
    missed: list[float] = field(default_factory=list)
    generations: list[int] = field(default_factory=list)
    _known: dict[bytes, int] = field(default_factory=dict)

    def ask(self, shares: Floats) -> list[int]:
        """Evaluate points given as fractions of the ranges and return their indices.

        Raises
        ------
        BudgetSpent
            If the budget is spent before all points are evaluated.
        """
        asked = self.space.points(np.atleast_2d(shares))
        names = [point.tobytes() for point in asked]
        new = {name: point for name, point in zip(names, asked, strict=True) if name not in self._known}
        taken = list(new.items())[: self.budget - len(self.points)]
        if taken:
            goals, missed = self.evaluate(np.array([point for _, point in taken]))
            generation = self.generations[-1] + 1 if self.generations else 0
            for (name, point), goal, miss in zip(taken, goals, missed, strict=True):
                self._known[name] = len(self.points)
                self.points.append(point)
                self.goals.append(goal)
                self.missed.append(float(miss))
                self.generations.append(generation)
        if len(taken) < len(new):
            raise BudgetSpent
        return [self._known[name] for name in names]

    def order(self, number: int) -> tuple[float, float]:
        """Return the sort key of an evaluation: bound violation, then first objective."""
        return self.missed[number], float(self.goals[number][0])

    def best(self, since: int = 0) -> int:
        """Return the index of the best evaluation for a single objective, from index `since` on."""
        return min(range(since, len(self.points)), key=self.order)


def front(goals: Floats, missed: Floats) -> NDArray[np.bool_]:
    """Return a mask that selects the Pareto front of the evaluations that satisfy all bounds."""
    fits = np.flatnonzero((missed == 0.0) & np.isfinite(goals).all(axis=1))
    order = fits[np.lexsort((goals[fits, -1], goals[fits, 0]))]
    least = np.minimum.accumulate(goals[order, -1])
    best = np.zeros(len(goals), dtype=bool)
    best[order[goals[order, -1] < np.concatenate([[np.inf], least])[:-1]]] = True
    return best


def optimise(evaluate: Evaluate, space: Space, goals: int, budget: int, seed: int, size: int, start: Floats) -> Course:
    """Search for the minimum of an objective, or for the Pareto front of two objectives.

    Parameters
    ----------
    evaluate : callable
        Function that evaluates several points at once (see `Evaluate`).
    space : Space
        Bounds of the searched keys.
    goals : int
        Number of objectives, 1 or 2.
    budget : int
        Maximum number of evaluations.
    seed : int
        Random seed. Equal seeds give equal results.
    size : int
        Number of points in a generation.
    start : ndarray, shape (keys,)
        First point to evaluate.

    Returns
    -------
    Course
        All evaluations of the search.

    Raises
    ------
    HeliosweepError
        If the package `pymoo` is not installed.
    """
    nsga2 = load_extra("pymoo.algorithms.moo.nsga2", "pymoo", "search")
    pso = load_extra("pymoo.algorithms.soo.nonconvex.pso", "pymoo", "search")
    course = Course(evaluate, space, budget)
    points = scipy.stats.qmc.LatinHypercube(len(space), rng=np.random.default_rng(seed))
    first = points.random(size)
    first[0] = np.clip(space.shares(start), 0.0, 1.0)
    with suppress(BudgetSpent):
        if goals > 1:
            _advance(nsga2.NSGA2(pop_size=size, sampling=first), course, goals, seed, budget)
            return course
        while True:
            before = len(course.points)
            _advance(pso.PSO(pop_size=size, sampling=first), course, 1, seed, before + (budget - before) // 2)
            if len(course.points) == before:  # all possible points are already evaluated
                break
            _refine(course, before)
            first, seed = points.random(size), seed + 1
    return course


def _advance(algorithm: Any, course: Course, goals: int, seed: int, until: int) -> None:
    from pymoo.core.problem import Problem
    from pymoo.core.termination import NoTermination

    problem = Problem(n_var=len(course.space), n_obj=goals, xl=0.0, xu=1.0)
    algorithm.setup(problem, termination=NoTermination(), seed=seed)
    stale: int = 0
    best: int | None = None
    while stale < PATIENCE and len(course.points) < until:
        before = len(course.points) if goals > 1 else best
        population = algorithm.ask()
        numbers = course.ask(population.get("X"))
        missed = np.array([[course.missed[number]] for number in numbers])
        values = np.array([course.goals[number] for number in numbers])
        population.set("F", np.minimum(np.where(missed > 0.0, 1e50 * (1.0 + missed), values), HUGE))
        algorithm.tell(infills=population)
        best = min(numbers if best is None else (best, *numbers), key=course.order)
        stale = stale + 1 if (len(course.points) if goals > 1 else best) == before else 0


def _refine(course: Course, since: int) -> None:
    """Refine the best point evaluated from index `since` on. Integer keys are held fixed."""
    space = course.space
    best = space.shares(course.points[course.best(since)])
    free = np.flatnonzero(~space.whole)
    if not free.size:
        return

    def number(x: Floats) -> int:
        best[free] = np.clip(x, 0.0, 1.0)
        return course.ask(best)[0]

    kept = scipy.optimize.NonlinearConstraint(lambda x: min(course.missed[number(x)], 1.0), -np.inf, 0.0)
    scipy.optimize.minimize(
        lambda x: min(float(course.goals[number(x)][0]), HUGE),
        best[free],
        method="COBYQA",
        bounds=[(0.0, 1.0)] * free.size,
        constraints=[kept] if max(course.missed) > 0.0 else [],
        # trust region radii relative to the ranges of the keys
        options={"initial_tr_radius": 0.05, "final_tr_radius": 1e-7, "maxfev": 60 * free.size},
    )

"""Optimisers of a search, from `pymoo` (extra `search`) and SciPy.

For one goal particle swarm optimisation (Kennedy and Eberhart 1995, doi:10.1109/ICNN.1995.488968), then COBYQA from its
best point (Ragonneau and Zhang 2025, doi:10.1007/s10107-025-02241-6); for two goals NSGA-II (Deb, Pratap, Agarwal and
Meyarivan 2002, doi:10.1109/4235.996017). Points that keep all bounds rank first.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from heliosweep.errors import load_extra
from heliosweep.kernels.arrays import Floats
from heliosweep.search.course import BudgetSpent, Course, Evaluate, Space

#: Value of a goal at points that miss a bound, and replacement of infinity.
MISSED, HUGE = 1e50, 1e100
#: An optimiser ends after this number of generations without a new best point, or on a front without a new point.
PATIENCE = 10
#: Part of the remaining evaluations that the swarm takes; evaluations of the local search for each searched key.
SHARE, EACH = 0.5, 60
#: First and last step of the local search, in parts of the range.
FIRST_STEP, LAST_STEP = 0.05, 1e-7


def optimise(evaluate: Evaluate, space: Space, goals: int, budget: int, seed: int, size: int, start: Floats) -> Course:
    """Search for the smallest goal, or for the Pareto front of two goals.

    Parameters
    ----------
    evaluate : callable
        Evaluates many points at once, see `course.Evaluate`.
    space : Space
        Bounds.
    goals : int
        1 or 2.
    budget : int
        Maximum number of evaluations.
    seed : int
        Seed; the same seed gives the same course.
    size : int
        Points of a generation.
    start : ndarray, shape (keys,)
        The first point.

    Returns
    -------
    Course
        All evaluations.

    Raises
    ------
    HeliosweepError
        If the package `pymoo` is not installed.
    """
    nsga2 = load_extra("pymoo.algorithms.moo.nsga2", "pymoo", "search")
    pso = load_extra("pymoo.algorithms.soo.nonconvex.pso", "pymoo", "search")
    from scipy.stats import qmc

    course = Course(evaluate, space, budget)
    points = qmc.LatinHypercube(len(space), rng=np.random.default_rng(seed))
    first = points.random(size)
    first[0] = np.clip(space.shares(start), 0.0, 1.0)
    with suppress(BudgetSpent):
        if goals > 1:
            _advance(nsga2.NSGA2(pop_size=size, sampling=first), course, goals, seed, budget)
            return course
        while True:
            before = len(course.points)
            swarm = pso.PSO(pop_size=size, sampling=first)
            _advance(swarm, course, 1, seed, before + int(SHARE * (budget - before)))
            if len(course.points) == before:  # all choices are known
                break
            _refine(course, before)
            first, seed = points.random(size), seed + 1
    return course


def _advance(algorithm: Any, course: Course, goals: int, seed: int, until: int) -> None:
    """Evaluate generations of an optimiser until it converges or `until` evaluations are done."""
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
        population.set("F", np.minimum(np.where(missed > 0.0, MISSED * (1.0 + missed), values), HUGE))
        algorithm.tell(infills=population)
        best = min(numbers if best is None else (best, *numbers), key=course.order)
        stale = stale + 1 if (len(course.points) if goals > 1 else best) == before else 0


def _refine(course: Course, since: int) -> None:
    """Search around the best point from evaluation `since` on, over the numbers that need not be whole."""
    from scipy.optimize import NonlinearConstraint, minimize

    space = course.space
    best = space.shares(course.points[course.best(since)])
    free = np.flatnonzero(~space.whole)
    if not free.size:
        return

    def number(x: Floats) -> int:
        best[free] = np.clip(x, 0.0, 1.0)
        return course.ask(best)[0]

    kept = NonlinearConstraint(lambda x: min(course.missed[number(x)], 1.0), -np.inf, 0.0)
    minimize(
        lambda x: min(float(course.goals[number(x)][0]), HUGE),
        best[free],
        method="COBYQA",
        bounds=[(0.0, 1.0)] * free.size,
        constraints=[kept] if max(course.missed) > 0.0 else [],
        options={"initial_tr_radius": FIRST_STEP, "final_tr_radius": LAST_STEP, "maxfev": EACH * free.size},
    )

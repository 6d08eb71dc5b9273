"""The optimisers of a search: differential evolution and a local search for one goal, NSGA-II for two.

Each asks for all points of a generation at once and follows from the seed alone. Differential evolution is SciPy's
(Storn and Price 1997, doi:10.1023/A:1008202821328; constraints by Lampinen 2002), NSGA-II that of DEAP (Deb, Pratap,
Agarwal and Meyarivan 2002, doi:10.1109/4235.996017).
"""

from __future__ import annotations

import random
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import combinations
from typing import Any
from unittest import mock

import numpy as np

from heliosweep.kernels.arrays import Floats
from heliosweep.search.course import BudgetSpent, Course, Evaluate, Space

#: What the local search may take: a part of the budget, and no more evaluations for each searched key.
REFINED, EACH = 0.3, 60
#: Where fewer generations than this are left, the search ends; else it begins anew elsewhere.
WORTH = 4
#: Steps of the local search: largest and smallest at its beginning, and where it ends. [parts of the range]
STEPS, LAST_STEP = (1e-3, 0.1), 1e-5
#: Tried along the way to the vertex of the fitted parabola, in parts of it; no farther than so many steps.
ALONG, REACH = (0.25, 0.5, 1.0, 2.0), 6.0
#: What stands for infinity where differences are taken.
HUGE = 1e300
#: How far children lie from their parents in NSGA-II, larger for nearer, as Deb and others set it.
NEARNESS = 20.0


def optimise(evaluate: Evaluate, space: Space, goals: int, budget: int, seed: int, size: int, start: Floats) -> Course:
    """Search for the smallest goal, or for the front of two goals.

    Parameters
    ----------
    evaluate : callable
        Evaluates many points at once, see `course.Evaluate`.
    space : Space
        Bounds.
    goals : int
        1 or 2.
    budget : int
        Evaluations at the most.
    seed : int
        What the course follows from.
    size : int
        Points of a generation.
    start : ndarray, shape (keys,)
        The first point.

    Returns
    -------
    Course
        All evaluations.
    """
    course = Course(evaluate, space, budget)
    draw = np.random.default_rng(seed)
    first = _generation(space, size, draw)
    first[0] = np.clip(space.shares(start), 0.0, 1.0)
    with suppress(BudgetSpent):
        if goals > 1:
            _spread(course, first, seed)
            return course
        while True:
            before = len(course.points)
            _evolve(course, first, draw)
            if len(course.points) == before:  # of a few choices all are known
                break
            _refine(course, before)
            if budget - len(course.points) < WORTH * size:
                break
            first = _generation(space, size, draw)
    return course


def _generation(space: Space, size: int, draw: np.random.Generator) -> Floats:
    """Shares of the ranges: a Latin hypercube."""
    rows = np.array([draw.permutation(size) for _ in range(len(space))]).T
    shares: Floats = (rows + draw.random(rows.shape)) / size
    return shares


def _evolve(course: Course, first: Floats, draw: np.random.Generator) -> None:
    """Differential evolution, as long as its part of the budget lasts and its generation is not all alike."""
    from scipy.optimize import NonlinearConstraint, differential_evolution

    space, left = course.space, course.budget - len(course.points)
    generations = int(left - min(REFINED * left, EACH * len(space))) // len(first)
    course.ask(first)  # of itself SciPy asks for one point alone before
    if generations < 1:
        return

    def goal(points: Floats) -> Floats:
        return np.array([min(course.goals[number][0], HUGE) for number in course.ask(space.shares(points.T))])

    def missed(points: Floats) -> Floats:
        return np.array([[min(course.missed[number], HUGE) for number in course.ask(space.shares(points.T))]])

    differential_evolution(
        goal,
        list(zip(space.low, space.high, strict=True)),
        init=space.points(first),
        integrality=space.whole,
        constraints=NonlinearConstraint(missed, -np.inf, 0.0),
        vectorized=True,
        updating="deferred",
        polish=False,
        maxiter=generations - 1,
        tol=1e-9,
        rng=draw,
    )


def _refine(course: Course, since: int) -> None:
    """Search about the best point: along each axis, between two, and towards the vertex of the parabola that fits.

    The best point is that of the evaluations from the number `since` on. Each step asks for all its points at once;
    where nothing is better, the next ones are nearer to the best one.
    """
    space = course.space
    unit = np.where(space.whole, 1.0 / (space.high - space.low), LAST_STEP)
    step = np.maximum(_width(course, since), unit)
    while True:
        best = course.best(since)
        centre = space.shares(course.points[best])
        step = np.where(space.whole, np.maximum(np.round(step / unit), 1.0) * unit, step)
        values = _pattern(course, centre, step)
        vertex = _vertex(values, len(space))
        if vertex.any():
            length = min(1.0, REACH / np.abs(vertex).max())
            course.ask(centre + np.outer(ALONG, vertex * length * step))
        if course.best(since) == best:
            if (step <= unit).all():
                return
            step = np.maximum(step / 4, unit)
        else:
            moved = np.abs(space.shares(course.points[course.best(since)]) - centre)
            step = np.maximum(step if (moved >= step).any() else step / 2, unit)


def _width(course: Course, since: int) -> Floats:
    """First steps of the local search: the spread of the best evaluations, within bounds."""
    space = course.space
    best = sorted(range(since, len(course.points)), key=course.order)[: max(4, 2 * len(space))]
    return np.clip(space.shares(np.array([course.points[number] for number in best])).std(axis=0), *STEPS)


def _pattern(course: Course, centre: Floats, step: Floats) -> dict[tuple[float, ...], float]:
    """Goals about a point, by the steps to them; only those of points that keep all bounds."""
    count = len(centre)
    ways = [np.zeros(count)]
    for i in range(count):
        ways += [sign * np.eye(count)[i] for sign in (1.0, -1.0)]
    ways += [np.eye(count)[i] + np.eye(count)[j] for i, j in combinations(range(count), 2)]
    within = [way for way in ways if np.all(np.abs(centre + way * step - 0.5) <= 0.5)]
    outside = [way for way in ways if np.any(np.abs(centre + way * step - 0.5) > 0.5)]
    numbers = course.ask(np.array([centre + way * step for way in (*within, *outside)]))
    return {
        tuple(way): float(course.goals[number][0])
        for way, number in zip(within, numbers, strict=False)
        if course.missed[number] == 0.0 and np.isfinite(course.goals[number][0])
    }


def _vertex(values: dict[tuple[float, ...], float], count: int) -> Floats:
    """Steps to the vertex of the parabola through values about a point; zero along axes where it has none."""
    axes, here = np.eye(count), values.get((0.0,) * count)
    free = [i for i in range(count) if {tuple(axes[i]), tuple(-axes[i])} <= values.keys()]
    vertex = np.zeros(count)
    if here is None:
        return vertex
    slope = np.array([(values[tuple(axes[i])] - values[tuple(-axes[i])]) / 2 for i in free])
    curve = np.diag([values[tuple(axes[i])] + values[tuple(-axes[i])] - 2 * here for i in free])
    for a, b in combinations(range(len(free)), 2):
        across = values.get(tuple(axes[free[a]] + axes[free[b]]))
        if across is not None:
            known = values[tuple(axes[free[a]])] + values[tuple(axes[free[b]])] - here
            curve[a, b] = curve[b, a] = across - known
    if free and (np.linalg.eigvalsh(curve) > 0).all():
        vertex[free] = -np.linalg.solve(curve, slope)
    return vertex


_patching = threading.Lock()


@contextmanager
def _drawing_from(own: random.Random) -> Iterator[None]:
    """Let the operators of DEAP draw from `own`: of themselves they take the numbers that all of Python shares."""
    from deap.tools import crossover, emo, mutation

    with _patching, ExitStack() as stack:
        for module in (crossover, mutation, emo):
            stack.enter_context(mock.patch.object(module, "random", own))
        yield


def _spread(course: Course, first: Floats, seed: int) -> None:
    """NSGA-II, until the budget is spent or nothing new comes up."""
    from deap import base, tools

    class Fitness(base.Fitness):
        weights = (-1.0, -1.0)

    class Plant(list[float]):
        """Shares of the ranges, and how good they are."""

        def __init__(self, shares: Any) -> None:
            super().__init__(map(float, shares))
            self.fitness = Fitness()

    def rated(shares: list[Plant]) -> list[Plant]:
        for one, number in zip(shares, course.ask(np.array(shares)), strict=True):
            missed = course.missed[number]
            # All that keep the bounds are better than all others, and of these those that miss them by less.
            values = course.goals[number] if missed == 0.0 else np.full(2, HUGE * (1.0 - 0.5 / (1.0 + missed)))
            one.fitness.values = tuple(float(min(value, HUGE)) for value in values)
        return shares

    own, size, keys = random.Random(seed), len(first), len(course.space)
    parents = tools.selNSGA2(rated([Plant(row) for row in first]), size)
    for _ in range(course.budget // size):
        with _drawing_from(own):
            chosen = [Plant(one) for one in tools.selTournamentDCD(parents, size)]
            for one, other in zip(chosen[::2], chosen[1::2], strict=True):
                tools.cxSimulatedBinaryBounded(one, other, NEARNESS, 0.0, 1.0)
                for each in (one, other):
                    tools.mutPolynomialBounded(each, NEARNESS, 0.0, 1.0, 1.0 / keys)
        parents = tools.selNSGA2(parents + rated(chosen), size)

"""Course of a search: evaluated points in their order, with goals and missed bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats

#: Dimension of the result of a search.
EVALUATION = "evaluation"
#: Resolution of a searched number, in parts of its range.
RESOLUTION = 1e-6


class BudgetSpent(Exception):
    """The evaluation budget of a search is spent."""


@dataclass(frozen=True)
class Space:
    """Bounds of the searched keys.

    Parameters
    ----------
    low, high : ndarray, shape (keys,)
        Bounds of each searched number.
    whole : ndarray of bool, shape (keys,)
        True for keys with whole numbers.
    """

    low: Floats
    high: Floats
    whole: NDArray[np.bool_]

    def __len__(self) -> int:
        """Return the number of searched keys."""
        return len(self.low)

    @property
    def decimals(self) -> list[int]:
        """Decimals of each number, by the resolution."""
        span = (self.high - self.low) * RESOLUTION
        return [0 if whole else -int(np.floor(np.log10(step))) for step, whole in zip(span, self.whole, strict=True)]

    def points(self, shares: Floats) -> Floats:
        """Points of shares of the ranges (0 to 1), rounded to the resolution, shape (points, keys)."""
        raw = self.low + np.clip(shares, 0.0, 1.0) * (self.high - self.low)
        rounded = [[round(float(x), digits) for x, digits in zip(row, self.decimals, strict=True)] for row in raw]
        return np.clip(np.array(rounded, dtype=float).reshape(raw.shape), self.low, self.high)

    def shares(self, points: Floats) -> Floats:
        """Shares of the ranges at points."""
        return (points - self.low) / (self.high - self.low)


#: Function of points, shape (n, keys), that returns goals to minimise, shape (n, goals), and the amount by which bounds
#: are missed, shape (n,); both are infinite for a point without a value.
Evaluate = Callable[[Floats], tuple[Floats, Floats]]


@dataclass
class Course:
    """All evaluations of a search. No point is evaluated twice, and at most `budget` points are evaluated.

    `points`, `goals` and `missed` grow with each generation, which `generations` counts for each point from 0.
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
        """Evaluate points, given by shares of the ranges; return their numbers in the course.

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
        """Return the sort key of an evaluation for a single goal: missed bounds first, then the goal."""
        return self.missed[number], float(self.goals[number][0])

    def best(self, since: int = 0) -> int:
        """Return the number of the best evaluation for a single goal, starting at number `since`."""
        return min(range(since, len(self.points)), key=self.order)


def front(goals: Floats, missed: Floats) -> NDArray[np.bool_]:
    """Return a mask of the Pareto front among the evaluations that keep all bounds."""
    fits = np.flatnonzero((missed == 0.0) & np.isfinite(goals).all(axis=1))
    order = fits[np.lexsort((goals[fits, -1], goals[fits, 0]))]
    least = np.minimum.accumulate(goals[order, -1])
    best = np.zeros(len(goals), dtype=bool)
    best[order[goals[order, -1] < np.concatenate([[np.inf], least])[:-1]]] = True
    return best

"""Optimisers: known optima within the budget, over seeds; the same course from the same seed; no point twice."""

import random

import numpy as np
import pytest

from heliosweep.config.sample import population
from heliosweep.search.optimise import Course, Space, front, optimise

SEEDS = range(3)


def quadratic(p):
    return (p[:, 0] - 0.3137) ** 2 + 3 * (p[:, 1] + 0.2) ** 2 + (p[:, 0] - 0.3137) * (p[:, 1] + 0.2)


def rosenbrock(p):
    """Rosenbrock (1960): a curved valley, 0 at (1, 1, ...)."""
    return sum(100 * (p[:, i + 1] - p[:, i] ** 2) ** 2 + (1 - p[:, i]) ** 2 for i in range(p.shape[1] - 1))


def rastrigin(p):
    """Rastrigin (1974): a hundred valleys, 0 in the deepest, here at (0.7, 0.7)."""
    return (10 + (p - 0.7) ** 2 - 10 * np.cos(2 * np.pi * (p - 0.7))).sum(axis=1)


def kink(p):
    return np.abs(p[:, 0] - 0.3141) + np.abs(p[:, 1] - 0.7)


def never_missed(p):
    return np.zeros(len(p))


def search(goal, low, high, budget, seed=0, goals=1, whole=None, missed=never_missed) -> Course:
    low, high = np.array(low, float), np.array(high, float)
    space = Space(low, high, np.zeros(len(low), bool) if whole is None else np.array(whole))

    def evaluate(points):
        assert np.all((points >= low) & (points <= high))
        return goal(points).reshape(len(points), -1), missed(points)

    return optimise(evaluate, space, goals, budget, seed, population(len(low), goals), (low + high) / 2)


@pytest.mark.parametrize(
    ("goal", "low", "high", "budget", "within"),
    [
        (quadratic, [-1, -1], [1, 1], 150, 1e-10),
        (rosenbrock, [-2, -2], [2, 2], 800, 1e-9),
        (rastrigin, [-5.12] * 2, [5.12] * 2, 2000, 1e-6),
        (kink, [0, 0], [1, 1], 300, 1e-5),
    ],
    ids=["quadratic", "Rosenbrock", "Rastrigin", "kink"],
)
def test_known_optima_are_found_within_the_budget(goal, low, high, budget, within):
    for seed in SEEDS:
        course = search(goal, low, high, budget, seed)
        assert 0.0 <= course.goals[course.best()][0] <= within, seed
        assert len(course.points) <= budget


def test_bounds_on_results_are_kept():
    """X + y is least at (1/2, 1/2) where x y must be at least 1/4; by Lagrange."""

    def missed(p):
        return np.maximum(0.25 - p[:, 0] * p[:, 1], 0)

    for seed in SEEDS:
        course = search(lambda p: p.sum(axis=1), [0, 0], [1, 0.9], 600, seed, missed=missed)
        best = course.best()
        assert course.missed[best] == 0.0
        assert course.goals[best][0] == pytest.approx(1.0, abs=2e-3)


def test_whole_numbers_stay_whole_and_a_small_choice_is_seen_whole():
    for seed in SEEDS:
        course = search(
            lambda p: (p[:, 0] - 3.2) ** 2 + (p[:, 1] - 0.2) ** 2, [0, 0], [10, 1], 150, seed, 1, [True, False]
        )
        assert course.points[course.best()] == pytest.approx([3.0, 0.2], abs=1e-3)
        assert np.all(np.array(course.points)[:, 0] % 1 == 0)
    alone = search(lambda p: (p[:, 0] - 3.2) ** 2, [0], [10], 100, whole=[True])
    assert alone.points[alone.best()] == [3.0]
    assert len(alone.points) <= 11


def test_no_point_is_asked_for_twice_and_none_is_finer_than_the_resolution():
    course = search(rosenbrock, [-2, -2], [2, 2], 500, 4)
    names = {point.tobytes() for point in course.points}
    assert len(names) == len(course.points) <= 500
    assert np.array_equal(np.round(course.points, 6), course.points)
    assert course.generations == sorted(course.generations)


@pytest.mark.parametrize("goals", [1, 2])
def test_the_course_follows_from_the_seed_alone(goals):
    def goal(p):
        random.random()  # what others draw meanwhile
        return np.column_stack([rosenbrock(p), p.sum(axis=1)])[:, :goals]

    before = random.getstate()
    first = search(goal, [-2, -2], [2, 2], 130, 3, goals)
    random.seed(12345)
    again, other = (search(goal, [-2, -2], [2, 2], 130, seed, goals) for seed in (3, 4))
    random.setstate(before)
    assert np.array_equal(first.points, again.points)
    assert not np.array_equal(first.points, other.points)


def test_the_front_of_two_goals():
    """Between two parabolas: x² and (x - 2)², whose front is 0 <= x <= 2, where sqrt(f1) + sqrt(f2) = 2 (Schaffer)."""
    for seed in range(5):
        course = search(
            lambda p: np.column_stack([p[:, 0] ** 2 + p[:, 1] ** 2, (p[:, 0] - 2) ** 2 + p[:, 1] ** 2]),
            [-4, -2], [4, 2], 600, seed, 2,
        )  # fmt: skip
        goals = np.array(course.goals)
        best = front(goals, np.array(course.missed))
        assert best.sum() >= 30
        assert np.sqrt(goals[best]).sum(axis=1) == pytest.approx(2.0, abs=0.15)
        assert np.sqrt(goals[best]).sum(axis=1).min() >= 2.0 - 1e-12
        assert np.diff(np.sort(np.sqrt(goals[best, 0]))).max() < 0.35  # all along

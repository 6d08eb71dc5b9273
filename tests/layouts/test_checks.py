"""Distances between heliostats, against all pairs, and the messages about them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from heliosweep.layouts import Layout, check_layout, too_close


def at(*places: tuple[float, ...], lines: list[int] | None = None) -> Layout:
    """Return a layout of a few heliostats."""
    x, y, z = np.array([(*place, 0.0)[:3] for place in places]).T
    return Layout(x, y, z, name="field.csv", lines=None if lines is None else np.array(lines))


def messages(layout: Layout, width: ArrayLike = 10, height: ArrayLike = 10) -> tuple[list[str], list[str]]:
    problems, warnings = check_layout(layout, width, height)
    return [str(problem) for problem in problems], [str(warning) for warning in warnings]


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.one_of(st.integers(2, 400), st.integers(500, 600)),
    size=st.sampled_from([1, 10, 100, 1e6]),
    limit=st.floats(1e-3, 20),
    flat=st.booleans(),
)
def test_pairs_against_a_tree(seed, count, size, limit, flat):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-size, size, (count, 3)) * [1, 1, 0 if flat else 1]
    pairs = too_close(points[:, 0], points[:, 1], points[:, 2], limit)

    apart = np.sqrt(((points[:, None] - points) ** 2).sum(axis=-1))
    low, high = np.nonzero(np.triu(apart < limit, 1))
    assert [gap for *_, gap in pairs] == sorted(gap for *_, gap in pairs)
    for first, second, gap in pairs:
        assert first < second
        assert gap == pytest.approx(math.dist(points[first], points[second]), rel=1e-12)
    np.fill_diagonal(apart, np.inf)
    assert {row for pair in pairs for row in pair[:2]} == set(np.flatnonzero((apart < limit).any(axis=1)))
    if (apart < limit).sum(axis=1).max() < 8:
        assert {pair[:2] for pair in pairs} == set(zip(low.tolist(), high.tolist(), strict=True))


def test_duplicates_name_the_rows():
    problems, warnings = messages(at((0, 50), (20, 50), (0, 50), (0, 50), lines=[2, 3, 4, 7]))
    assert problems == [
        "field.csv:4: heliostat 2 has the position of heliostat 0 (line 2)",
        "field.csv:7: heliostat 3 has the position of heliostat 0 (line 2)",
    ]
    assert warnings == []
    assert messages(at((0, 50), (0, 50, 12)))[0] == []


def test_colliding_mirrors_name_the_rows():
    problems, warnings = messages(at((0, 50), (9, 50), (40, 50), lines=[2, 3, 5]), width=12, height=10)
    assert problems == [
        "field.csv:3: heliostat 1 is 9 m from heliostat 0 (line 2), less than the shorter side of the "
        "mirrors, 10 m: they collide"
    ]
    assert warnings == []


def test_mirrors_of_unequal_size():
    layout, sides = at((0, 50), (9, 50), (9, 57)), np.array([12, 4, 4])
    problems, (warning,) = messages(layout, sides, sides)
    assert problems == []
    assert warning.endswith("heliostat 0 and heliostat 1, 9 m apart, with a diagonal of 11.3137 m")
    sides = np.array([12, 8, 2])
    (problem,), _ = messages(layout, sides, sides)
    assert problem == (
        "field.csv: heliostat 1 is 9 m from heliostat 0, less than the shorter side of the mirrors, 10 m: they collide"
    )


def test_below_the_diagonal_is_one_warning():
    problems, (warning,) = messages(at((0, 50), (12, 50), (40, 50), (40, 63), lines=[2, 3, 4, 5]))
    assert problems == []
    assert warning.startswith("field.csv: 2 pairs of neighbours are closer than the diagonal of the mirrors")
    assert warning.endswith("heliostat 0 (line 2) and heliostat 1 (line 3), 12 m apart, with a diagonal of 14.1421 m")
    assert messages(at((0, 50), (10, 50)))[0] == []  # one shorter side apart: a warning, not an error


def test_a_heliostat_at_the_foot_of_the_tower_is_no_error():
    assert messages(at((0, 0), (30, 0))) == ([], [])


@pytest.mark.parametrize("value", [math.nan, math.inf, -4.1e6])
def test_coordinates_off_any_field(value):
    problems, _ = messages(at((0, 50), (20, value)))
    assert len(problems) == 1
    assert problems[0].startswith("field.csv: heliostat 1 is beyond any field: x, y and z must be metres")

"""The simplex method for two unknowns takes the very steps of SciPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from heliosweep.kernels.gazing import slopes

FUNCTIONS = {
    "rosenbrock": lambda x, y: (1.0 - x) ** 2 + 100.0 * (y - x * x) ** 2,
    "himmelblau": lambda x, y: (x * x + y - 11.0) ** 2 + (x + y * y - 7.0) ** 2,
    "narrow": lambda x, y: 1e6 * (x + 0.3 * y - 1.0) ** 2 + 1e-3 * (y - x) ** 2,
    "beale": lambda x, y: (1.5 - x + x * y) ** 2 + (2.25 - x + x * y**2) ** 2 + (2.625 - x + x * y**3) ** 2,
    "kinked": lambda x, y: abs(x - 0.31) + 2.7 * abs(y + 0.77 * x),
    "wavy": lambda x, y: x * x + 1.3 * y * y + 3.0 * np.sin(5.1 * x) * np.cos(3.3 * y - 0.2),
    "tilted": lambda x, y: x + 2.0 * y + 0.1 * np.hypot(x - 0.1, y),
    "undefined": lambda x, y: (x - 1.0) ** 2 + (y - 0.9) ** 4 if x < 3.0 else np.nan,
    "square_root": lambda x, y: np.sqrt(abs(x * y - 1.0)) + 0.1 * x * x + 0.07 * y * y,
    "mccormick": lambda x, y: np.sin(x + y) + (x - y) ** 2 - 1.5 * x + 2.5 * y + 1.0,
}


def search(function, simplex, xatol, fatol, evaluations=400):
    """Points of the evaluations, the sorted simplex, and the number of evaluations."""
    points, vertices = [], np.zeros((5, 3))
    vertices[:3, :2] = simplex

    def recorded(task, x, y):
        points.append((float(x), float(y)))
        return function(*points[-1]), 0.0

    nelder_mead = getattr(slopes.nelder_mead, "py_func", slopes.nelder_mead)
    count, _ = nelder_mead(recorded, None, 0.0, 0.0, vertices, xatol, fatol, evaluations)
    return points, vertices[:3], count


def by_scipy(function, simplex, xatol, fatol, evaluations=400):
    """Points asked for, and the result."""
    asked = []

    def recorded(point):
        asked.append((float(point[0]), float(point[1])))
        return function(*asked[-1])

    options = {"xatol": xatol, "fatol": fatol, "maxiter": evaluations, "maxfev": evaluations}
    found = minimize(recorded, simplex[0], method="Nelder-Mead", options={**options, "initial_simplex": simplex})
    return asked, found


def same(function, simplex, *limits):
    asked, vertices, count = search(function, simplex, *limits)
    expected, found = by_scipy(function, simplex, *limits)
    assert asked == expected
    assert tuple(vertices[0, :2]) == tuple(found.x)
    assert vertices[0, 2] == found.fun or (np.isnan(vertices[0, 2]) and np.isnan(found.fun))
    assert count == found.nfev
    return found


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("size", [1.0, -0.3, 1e-3])
def test_points_bit_for_bit(name, size):
    for seed in range(4):
        x, y = np.random.default_rng(seed).uniform(-2.0, 2.0, 2)
        found = same(FUNCTIONS[name], [[x, y], [x + size, y], [x, y + size]], 1e-7, 1e-10)
        assert found.nfev > 30


@given(st.integers(0, 10**6), st.integers(0, 9), st.floats(-8.0, 0.0), st.floats(-12.0, 0.0))
@settings(max_examples=40, deadline=None)
def test_points_at_random(seed, number, xatol, fatol):
    simplex = np.random.default_rng(seed).uniform(-3.0, 3.0, (3, 2)).tolist()
    same(list(FUNCTIONS.values())[number], simplex, 10.0**xatol, 10.0**fatol)


@pytest.mark.parametrize("name", ["rosenbrock", "kinked", "square_root"])
def test_evaluations_run_out_at_any_step(name):
    function, simplex = FUNCTIONS[name], [[-1.2, 1.0], [-0.9, 1.1], [-1.1, 0.7]]
    for evaluations in range(3, 60):
        asked, vertices, count = search(function, simplex, 1e-9, 1e-9, evaluations)
        expected, found = by_scipy(function, simplex, 1e-9, 1e-9, evaluations)
        assert asked == expected
        assert count == found.nfev == evaluations
        np.testing.assert_array_equal(vertices[:, :2], found.final_simplex[0])
        np.testing.assert_array_equal(vertices[:, 2], found.final_simplex[1])


def test_equal_values_keep_the_older_vertex_first():
    _, vertices, _ = search(lambda x, y: 1.0, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], 1e-3, 1e-3)
    assert tuple(vertices[0]) == (0.0, 0.0, 1.0)

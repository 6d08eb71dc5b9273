"""Factors and singular values of small least-squares problems against LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from heliosweep.kernels.spots.calibration import orthogonalise, singular_values


def decomposed(matrix, target):
    """Singular values, right vectors, target in terms of the left ones, what remains of it."""
    columns = matrix.shape[1]
    rows = np.zeros((7, len(matrix)))
    rows[:columns], rows[columns] = matrix.T, target
    upper, right, values, projected = np.empty((7, 7)), np.empty((6, 6)), np.empty(6), np.empty(6)
    orthogonalise(rows, columns, upper)
    singular_values(upper, columns, values, right, projected)
    return values[:columns], right[:columns, :columns], projected[:columns], rows[columns]


@pytest.mark.parametrize("columns", range(1, 7))
@pytest.mark.parametrize("decades", [0, 3, 6])
@pytest.mark.parametrize("equations", [40, 158])
def test_against_lapack(columns, decades, equations):
    rng = np.random.default_rng(columns)
    matrix = rng.normal(size=(equations, columns)) * np.logspace(0, -decades, columns)
    matrix = matrix @ np.linalg.qr(rng.normal(size=(columns, columns)))[0]
    target = rng.normal(size=equations)
    values, right, projected, rest = decomposed(matrix, target)
    left, exact, _ = np.linalg.svd(matrix, full_matrices=False)
    np.testing.assert_allclose(values, exact, rtol=0, atol=1e-14 * exact[0])
    np.testing.assert_allclose(right.T @ right, np.eye(columns), rtol=0, atol=1e-14)
    turned = matrix @ right
    np.testing.assert_allclose(turned.T @ turned, np.diag(values**2), rtol=0, atol=1e-13 * exact[0] ** 2)
    solution = right @ (projected / values)
    theirs = np.linalg.lstsq(matrix, target, rcond=None)[0]
    np.testing.assert_allclose(solution, theirs, rtol=0, atol=1e-14 * exact[0] / exact[-1] * np.abs(theirs).max())
    # Gram-Schmidt leaves a part of the columns in the rest, as large as their dependence makes it.
    np.testing.assert_allclose(rest, target - left @ (left.T @ target), rtol=0, atol=1e-14 * exact[0] / exact[-1])


def test_columns_that_depend_on_others_have_no_singular_value():
    rng = np.random.default_rng(1)
    matrix = rng.normal(size=(20, 4))
    matrix[:, 2] = matrix[:, 0] - 2 * matrix[:, 3]
    values, *_ = decomposed(matrix, np.ones(20))
    assert values[-1] < 1e-15 * values[0]
    matrix[:, 1] = 0.0
    values, _, projected, *_ = decomposed(matrix, np.ones(20))
    assert values[-1] == 0.0
    assert np.isfinite(projected).all()


def test_vectors_point_the_way_of_their_largest_element():
    _, right, *_ = decomposed(np.random.default_rng(2).normal(size=(30, 5)), np.zeros(30))
    assert (np.take_along_axis(right, np.abs(right).argmax(axis=0)[np.newaxis], axis=0) > 0).all()

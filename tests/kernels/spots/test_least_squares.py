"""Factors and singular values of small least-squares problems against LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from heliosweep.kernels.spots.least_squares import COLUMNS, SIDES, inverted, orthogonalise, singular_values
from heliosweep.kernels.vectors import PACKET


def blocks_of(matrix, target):
    """Blocks of a matrix and its right-hand side, equations of the first kind before those of the second, and lanes."""
    lanes = len(matrix) // SIDES
    packets = -(-lanes // PACKET)
    table = np.zeros((SIDES, packets * PACKET, COLUMNS))
    table[:, :lanes, : matrix.shape[1]] = matrix.reshape(SIDES, lanes, -1)
    table[:, :lanes, matrix.shape[1]] = target.reshape(SIDES, lanes)
    return table.reshape(SIDES, packets, PACKET, COLUMNS).transpose(1, 0, 3, 2).ravel(), lanes


def decomposed(matrix, target):
    """Singular values, right vectors, target in terms of the left ones, what remains of it, bound of the condition."""
    columns = matrix.shape[1]
    rows, lanes = blocks_of(matrix, target)
    upper, right = np.empty((COLUMNS, COLUMNS)), np.empty((COLUMNS, COLUMNS))
    values, projected = np.empty(COLUMNS), np.empty(COLUMNS)
    orthogonalise(rows, lanes, columns, upper, np.empty(PACKET))
    bound = inverted(upper, columns, right)
    singular_values(upper, columns, values, right, projected)
    rest = rows.reshape(-1, SIDES, COLUMNS, PACKET)[:, :, columns].transpose(1, 0, 2).reshape(SIDES, -1)[:, :lanes]
    return values[:columns], right[:columns, :columns], projected[:columns], rest.ravel(), bound


@pytest.mark.parametrize("columns", range(1, 7))
@pytest.mark.parametrize("decades", [0, 3, 6])
@pytest.mark.parametrize("equations", [40, 2 * PACKET + 30])
def test_against_lapack(columns, decades, equations):
    rng = np.random.default_rng(columns)
    matrix = rng.normal(size=(equations, columns)) * np.logspace(0, -decades, columns)
    matrix = matrix @ np.linalg.qr(rng.normal(size=(columns, columns)))[0]
    target = rng.normal(size=equations)
    values, right, projected, rest, bound = decomposed(matrix, target)
    assert np.linalg.cond(matrix) <= bound * (1.0 + 1e-9) <= columns * np.linalg.cond(matrix) * 1.01
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

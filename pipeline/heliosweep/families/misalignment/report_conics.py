"""Conics from their coefficients, as they are drawn."""

from __future__ import annotations

import numpy as np

#: Points of each branch, and how far hyperbolas are followed, as the exponent of their distance.
POINTS, REACH = 400, 8.0


def principal(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre, eigenvalues and eigenvectors of ``A y2 + B y z + C z2 + D y + E z + F``, eigenvalues over minus the rest.

    Parameters
    ----------
    coefficients : ndarray, shape (6,)
        A to F.

    Returns
    -------
    centre : ndarray, shape (2,)
        NaN for a parabola.
    inverse : ndarray, shape (2,)
        In the frame of the eigenvectors ``inverse[0] u2 + inverse[1] v2 = 1``.
    vectors : ndarray, shape (2, 2)
        Eigenvectors in columns.
    """
    a, b, c, d, e, f = coefficients
    matrix = np.array([[a, b / 2], [b / 2, c]])
    values, vectors = np.linalg.eigh(matrix)
    if np.abs(values).min() <= 1e-12 * np.abs(values).max():
        return np.full(2, np.nan), np.full(2, np.nan), vectors
    centre = -0.5 * np.linalg.solve(matrix, np.array([d, e]))
    rest = f + 0.5 * float(np.array([d, e]) @ centre)
    return centre, values / -rest if rest else np.full(2, np.nan), vectors


def conic_curve(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of a conic, its branches apart from each other by a missing point; none for a parabola or a pair of lines.

    Parameters
    ----------
    coefficients : ndarray, shape (6,)
        A to F.

    Returns
    -------
    tuple of ndarray
        Both coordinates.
    """
    centre, inverse, vectors = principal(coefficients)
    nothing = np.full((1, 2), np.nan)
    if not np.isfinite(inverse).all() or (inverse <= 0).all():
        return nothing[:, 0], nothing[:, 1]
    sides = 1 / np.sqrt(np.abs(inverse))
    if (inverse > 0).all():
        turn = np.linspace(-np.pi, np.pi, POINTS)
        points = np.stack([np.cos(turn), np.sin(turn)], axis=-1) * sides
    else:
        way = np.linspace(-REACH, REACH, POINTS)
        first = int(np.argmax(inverse))
        branch = np.empty((POINTS, 2))
        branch[:, first], branch[:, 1 - first] = np.cosh(way), np.sinh(way)
        points = np.concatenate([branch * sides, nothing, -branch * sides])
    curve = centre + points @ vectors.T
    return curve[:, 0], curve[:, 1]


def other_focus(coefficients: np.ndarray, focus: np.ndarray) -> np.ndarray:
    """Focus on the other side of the centre, shape (2,)."""
    return 2 * principal(coefficients)[0] - focus

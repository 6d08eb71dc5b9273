"""Frames about points, which single far points do not blow up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

#: Points farther from the origin than so many times the median, the 90 % point, and the aperture's half diagonal are
#: not framed.
FAR, FAR_90 = 8.0, 3.0

#: Empty rim, as a part of the side.
RIM = 0.07

#: Least side. [m]
LEAST = 1e-6

#: Ends of both axes. [m]
Ends = tuple[tuple[float, float], tuple[float, float]]


def span(points: np.ndarray, aperture: tuple[float, float] | None = None, square: bool = True) -> Ends:
    """Frame with a rim about points and a rectangle at the origin.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Finite. [m]
    aperture : tuple of float, optional
        Width and height of the rectangle. [m]
    square : bool
        Whether both sides have the same length.

    Returns
    -------
    tuple of (low, high)
        Ends along x and y. [m]
    """
    corner = np.array(aperture or (0.0, 0.0)) / 2
    far = np.hypot(points[:, 0], points[:, 1])
    middle, most = np.quantile(far, [0.5, 0.9]) if far.size else (0.0, 0.0)
    near = points[far <= max(FAR * float(np.hypot(*corner)), FAR * float(middle), FAR_90 * float(most))]
    kept = np.concatenate([near, [-corner, corner]]) if aperture else near
    if not kept.size:
        kept = np.array([[-1.0, -1.0], [1.0, 1.0]])
    return _frame(kept.min(axis=0), kept.max(axis=0), RIM, square)


def common(ends: Sequence[Ends]) -> Ends:
    """Square about squares."""
    low = np.min([[x[0], y[0]] for x, y in ends], axis=0)
    high = np.max([[x[1], y[1]] for x, y in ends], axis=0)
    return _frame(low, high, 0.0, True)


def _frame(low: np.ndarray, high: np.ndarray, rim: float, square: bool) -> Ends:
    middle = (low + high) / 2
    least = np.maximum(LEAST, 1e-3 * (np.abs(middle).max() if square else np.abs(middle)))
    sides = np.maximum(high - low, least)
    half = (np.full(2, sides.max()) if square else sides) / 2 * (1 + 2 * rim)
    (left, bottom), (right, top) = middle - half, middle + half
    return (float(left), float(right)), (float(bottom), float(top))


def beyond(points: np.ndarray, ends: Ends) -> int:
    """How many points lie outside."""
    (left, right), (bottom, top) = ends
    x, y = points[:, 0], points[:, 1]
    return int(((x < left) | (x > right) | (y < bottom) | (y > top)).sum())

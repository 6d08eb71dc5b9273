"""Weighted means whose bits do not depend on how the data are cut."""

from __future__ import annotations

import numpy as np


def weighted_mean(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Mean over the last dimension.

    Parameters
    ----------
    values, weights : ndarray, shape (..., n)
        Values of weight zero are left out, also where they are NaN.

    Returns
    -------
    ndarray, shape (...)
        NaN where all weights are zero.
    """
    means = np.full(values.shape[:-1], np.nan)
    for index in np.ndindex(means.shape):
        used = weights[index] > 0  # taken out, so that padding does not change the order of the sum
        if used.any():
            means[index] = np.sum(values[index][used] * weights[index][used]) / np.sum(weights[index][used])
    return means

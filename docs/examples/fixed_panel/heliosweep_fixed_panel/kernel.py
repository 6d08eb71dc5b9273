"""The kernel: cosines of a panel and the sun."""

import numpy as np


def mean_cosine(tilt: float, azimuth: float, sun: np.ndarray) -> tuple[float, float]:
    """Mean cosine of the incidence over the daylight, and fraction of it with the sun before the panel.

    Parameters
    ----------
    tilt, azimuth : float
        Of the panel; azimuth from north, clockwise. [deg]
    sun : ndarray, shape (time, 3)
        Unit vectors to the sun: east, north, up. [1]

    Returns
    -------
    mean_cosine, lit_fraction : float
        Missing (NaN) where the sun is never up. [1]
    """
    across, up = np.sin(np.radians(tilt)), np.cos(np.radians(tilt))
    east, north = across * np.sin(np.radians(azimuth)), across * np.cos(np.radians(azimuth))
    day = sun[sun[:, 2] > 0]
    if not len(day):
        return np.nan, np.nan
    cosine = np.maximum(east * day[:, 0] + north * day[:, 1] + up * day[:, 2], 0)
    return float(np.mean(cosine)), float(np.mean(cosine > 0))

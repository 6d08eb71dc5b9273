"""Fields and suns for the kernel tests."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heliosweep.layouts import read_csv

DATA = Path(__file__).parents[2] / "data"
FIELD = Path(__file__).parents[3] / "studies/layouts/chong2012.csv"
TARGET = 95.0

Floats = NDArray[np.float64]
Field = tuple[Floats, Floats, Floats, Floats, Floats, float]
"""Arguments x, y, z, half width, half height, target height of the field kernels."""


def chong2012(side: float = 11.0) -> Field:
    """The field of Chong and Tan 2012."""
    layout = read_csv(FIELD)
    half = np.full(len(layout), side / 2.0)
    return layout.x.copy(), layout.y.copy(), layout.z + 7.0, half, half, TARGET


def scattered(rng: np.random.Generator, count: int, spacing: float, uneven: bool = True) -> Field:
    """Mirrors of all sizes and heights, at least `spacing` apart, around and beside the tower."""
    places = np.empty((0, 2))
    extent = spacing * np.sqrt(count) * 1.2 + 12.0
    while len(places) < count:
        p = rng.uniform(-extent, extent, 2)
        if np.hypot(*p) > 12.0 and (len(places) == 0 or np.hypot(*(places - p).T).min() > spacing):
            places = np.vstack((places, p))
    z = 5.0 + rng.uniform(-4.0, 4.0, count) * uneven
    width, height = rng.uniform(2.0, 5.5, (2, count)) if uneven else np.full((2, count), 5.0)
    return places[:, 0].copy(), places[:, 1].copy(), z, width, height, 60.0


def directions(azimuth, elevation):
    """Unit vectors from azimuth (from north, clockwise) and elevation in degrees."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.stack(np.broadcast_arrays(np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)), axis=-1)


def suns(rng, count, low=3.0, high=85.0):
    """Random sun vectors between two elevations in degrees."""
    return directions(rng.uniform(0.0, 360.0, count), rng.uniform(low, high, count))

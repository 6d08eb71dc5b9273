"""Speed of the deviation kernels on one core: `python -m tests.bench deviation`.

Spots of misaligned mirrors beside the same formulas in plain NumPy; tolerances, detector crossings and conics.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.spots.curves import deviation_curves
from heliosweep.kernels.spots.deviation import CANTING, ELEVATION, ENCODER, ENCODER_AZIMUTH, deviation_spots
from heliosweep.kernels.sun.clock import solar_clock
from tests.bench.table import Row, best, measured
from tests.kernels.spots.deviations import LATITUDE, setting, unit

Floats = NDArray[np.float64]

SIZES: Floats = np.arange(-12.0, 13.0) * 1e-3
LINES = np.array([[1.0, 0.0, 6.0], [0.0, 1.0, -6.0]])
HEIGHT = 143.0


def plain_spots(sizes: NDArray, sun: Floats, pivots: Floats, offset: float) -> Floats:
    """Spots of elevation encoder errors on a face to the north: the paper's iteration and its formulas in NumPy."""
    s, pivot = sun[0][np.newaxis], pivots[0][:, np.newaxis] - [0.0, 0.0, HEIGHT]
    n = unit(s - unit(pivot))
    for _ in range(5 if offset else 0):
        n = unit(s - unit(pivot + offset * n))
    e = unit(np.cross(n, [0.0, 0.0, 1.0]))
    up = np.cross(e, n)
    spots = np.empty((2, len(sizes), *n.shape[:2]))
    for p, size in enumerate(sizes):
        normal = np.cos(size) * n + np.sin(size) * up
        centre = pivot + offset * normal
        ray = 2.0 * np.sum(s * normal, axis=-1, keepdims=True) * normal - s
        place = centre - centre[..., 1:2] / ray[..., 1:2] * ray
        spots[:, p] = np.where(ray[..., 1] < 0.0, [-place[..., 0], place[..., 2]], np.nan)
    return spots


def rows() -> Iterator[Row]:
    """Spots of several sizes of the error, and what is solved from curves."""
    rng = np.random.default_rng(0)
    pivots = np.column_stack([rng.uniform(-300, 300, 317), rng.uniform(50, 500, 317), np.full(317, 7.0)])[np.newaxis]
    sun = solar_clock(LATITUDE, 0.2, np.linspace(7.0, 17.0, 41))[np.newaxis]
    places = pivots.shape[1] * sun.shape[1]
    for name, offset in (("", 0.0), (", mirror offset", 0.5)):
        for sizes in (SIZES, SIZES[:1]):
            many = np.full(len(sizes), ENCODER), np.full(len(sizes), ELEVATION), sizes, sun, pivots
            settings = setting(len(sizes), mirror_offset=offset)
            plain = plain_spots(sizes, sun, pivots, offset)
            assert np.nanmax(np.abs(deviation_spots(settings, *many)[:2] - plain)) < 1e-9
            yield measured(
                f"misalignment, {len(sizes)} size{'s' if len(sizes) > 1 else ''}{name}",
                "spot",
                partial(deviation_spots, settings, *many),
                plain[0].size,
                beside={"NumPy": best(partial(plain_spots, sizes, sun, pivots, offset), 3) / plain[0].size},
            )
    for name, source, axis, offset in (
        ("closed form", CANTING, ELEVATION, 0.5),
        ("march", ENCODER, ELEVATION, 0.5),
        ("march, primary axis", CANTING, ENCODER_AZIMUTH, 0.5),
    ):
        case = setting(mirror_offset=offset), [source], [axis]
        for what, lines in (("tolerance", ()), (f"tolerance and {len(LINES)} crossings", LINES)):
            whole = partial(deviation_curves, *case, sun, pivots, lines)
            yield measured(f"{what}, {name}", "mirror-instant", whole, places)


GROUPS = (rows,)

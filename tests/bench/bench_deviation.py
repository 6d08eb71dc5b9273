"""Speed of the deviation kernels on one core. Run it: `python -m tests.bench.bench_deviation`.

Prints nanoseconds for each spot of a misaligned mirror beside the same formulas in plain NumPy, and for each tolerance,
detector crossing and conic. Nothing is asserted: times depend on the machine and on its other work; each is the best of
a few runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.conics import conics
from heliosweep.kernels.detectors import crossings
from heliosweep.kernels.deviation import CANTING, ELEVATION, ENCODER, ENCODER_AZIMUTH, deviation_spots
from heliosweep.kernels.sun import solar_clock
from heliosweep.kernels.tolerances import tolerances
from tests.kernels.deviations import LATITUDE, setting, unit

Floats = NDArray[np.float64]

SIZES: Floats = np.arange(-12.0, 13.0) * 1e-3
LINES = np.array([[1.0, 0.0, 6.0], [0.0, 1.0, -6.0]])
HEIGHT = 143.0


def best(work: Callable[[], object], times: int = 5) -> float:
    """Shortest time of a few runs after a first one, in seconds."""
    seconds = []
    work()
    for _ in range(times):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


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


def main() -> None:
    """Measure and print."""
    rng = np.random.default_rng(0)
    pivots = np.column_stack([rng.uniform(-300, 300, 317), rng.uniform(50, 500, 317), np.full(317, 7.0)])[np.newaxis]
    sun = solar_clock(LATITUDE, 0.2, np.linspace(7.0, 17.0, 41))[np.newaxis]
    places = pivots.shape[1] * sun.shape[1]
    print("317 heliostats, 41 instants; ns each")
    for name, offset in (("no offset", 0.0), ("mirror offset", 0.5)):
        for sizes in (SIZES, SIZES[:1]):
            many = np.full(len(sizes), ENCODER), np.full(len(sizes), ELEVATION), sizes, sun, pivots
            settings = setting(len(sizes), mirror_offset=offset)
            plain = plain_spots(sizes, sun, pivots, offset)
            assert np.nanmax(np.abs(deviation_spots(settings, *many)[:2] - plain)) < 1e-9
            kernel = best(partial(deviation_spots, settings, *many)) / plain[0].size
            numpy = best(partial(plain_spots, sizes, sun, pivots, offset)) / plain[0].size
            print(f"spot, {len(sizes):2} sizes, {name:14}{1e9 * kernel:7.1f}   NumPy {1e9 * numpy:6.0f}", end="   ")
            print(f"x {numpy / kernel:.1f}")
    for name, source, axis, offset in (
        ("closed form", CANTING, ELEVATION, 0.5),
        ("march", ENCODER, ELEVATION, 0.5),
        ("march, primary axis", CANTING, ENCODER_AZIMUTH, 0.5),
    ):
        case = setting(mirror_offset=offset), [source], [axis]
        tolerance = best(partial(tolerances, *case, sun, pivots)) / places
        crossing = best(partial(crossings, *case, LINES, sun, pivots)) / places / len(LINES)
        print(f"{name:20} tolerance {1e9 * tolerance:6.0f}   crossing of a line {1e9 * crossing:6.0f}")
    conic = best(partial(conics, setting(), [CANTING], [ELEVATION], sun, pivots)) / places
    print(f"conic {1e9 * conic:6.0f}")


if __name__ == "__main__":
    main()

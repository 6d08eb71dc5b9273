"""Speed of the dish kernels and of the fast sun on one core. Run it: `python -m tests.bench.bench_dish`.

Prints nanoseconds for each pointing error (site, instant, tilt, direction; the sun in memory) beside the closed form in
plain NumPy, and nanoseconds for each sun position beside pvlib's SPA. Nothing is asserted: times depend on the machine
and on its other work; each is the best of a few runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from heliosweep.families import fast_sun
from heliosweep.kernels.tracking import RIGID, UNTILTED_HOME_AXES, pack_windows, window_errors

Floats = NDArray[np.float64]

#: Every 10 min from 7 to 21 h, UTC+8, each day of 2021.
WINDOW = 84
UTC = np.concatenate(
    [
        day.astype("datetime64[ns]") + np.timedelta64(10, "m") * np.arange(-6, WINDOW - 6)
        for day in np.arange("2021-01-01", "2022-01-01", dtype="datetime64[D]")
    ]
)
TILTS = np.radians(np.arange(1, 7) * 0.05)
DIRECTIONS = np.radians(np.arange(0, 360, 15.0))


def best(work: Callable[[], object], times: int = 5) -> float:
    """Shortest time of a few runs after a first one, in seconds."""
    seconds = []
    work()
    for _ in range(times):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def plain_rigid(sun: Floats, tilt: float, direction: float) -> tuple[Floats, Floats]:
    """Daily mean and largest error of one rigid mount, closed form in NumPy."""
    along = np.sin(direction) * sun[:, 0] + np.cos(direction) * sun[:, 1]
    error = 2.0 * np.arcsin(np.sin(0.5 * tilt) * np.sqrt(sun[:, 2] ** 2 + along**2)).reshape(-1, WINDOW)
    return error.mean(axis=1), error.max(axis=1)


def plain_untilted(sun: Floats, tilt: float, direction: float) -> tuple[Floats, Floats]:
    """Daily mean and largest error of one mount with untilted home axes, closed form in NumPy."""
    x, y, z = -sun[:, 0], -sun[:, 1], sun[:, 2]
    level = np.hypot(x, y)
    versine, sine = 1.0 + x / level, y / level
    ux, uy, half = np.cos(direction), -np.sin(direction), 0.5 * tilt
    flat, rise = np.sin(half) * np.cos(half), np.sin(half) ** 2 * sine
    vx, vy = flat * (ux * versine - uy * sine), flat * (uy * versine + ux * sine)
    square = (vy * z - rise * y) ** 2 + (rise * x - vx * z) ** 2 + (vx * y - vy * x) ** 2
    error = 2.0 * np.arcsin(np.sqrt(square)).reshape(-1, WINDOW)
    return error.mean(axis=1), error.max(axis=1)


def each_mount(plain: Callable[..., object], sun: Floats, mounts: list[tuple[float, float]]) -> None:
    """Run a plain form for mount after mount."""
    for mount in mounts:
        plain(sun, *mount)


def row(name: str, seconds: float, work: int, baseline: float | None = None) -> None:
    """Print one line of the table; `baseline` is seconds for each of the same."""
    each = seconds / work
    ratio = "" if baseline is None else f"{baseline / each:>10.1f}"
    print(f"{name:<58} {each * 1e9:>10.3f} {1e-6 / each:>10.1f} {ratio}")


def dishes() -> None:
    """Pointing errors: daily means and maxima over a year."""
    sun = fast_sun.sun_vectors(UTC, 40.13, 94.67, 0.0, 69.0)
    starts = np.arange(0, len(sun) + 1, WINDOW)
    windows = pack_windows(sun, starts)
    sample = [(tilt, direction) for tilt in TILTS[::3] for direction in DIRECTIONS[::6]]
    work = len(sun) * len(TILTS) * len(DIRECTIONS)
    print(f"{'pointing errors, sun in memory':<58} {'ns each':>10} {'million/s':>10} {'ratio':>10}")
    row("packing the windows (each instant, once per site)", best(lambda: pack_windows(sun, starts)), len(sun))
    tilt, direction = TILTS[:, np.newaxis], DIRECTIONS
    cases: list[tuple[str, int, Callable[..., object], dict[str, float]]] = [
        ("rigid", RIGID, plain_rigid, {}),
        ("rigid, clipped", RIGID, plain_rigid, {"tolerance": 2e-3}),
        ("untilted_home_axes", UNTILTED_HOME_AXES, plain_untilted, {}),
        ("untilted_home_axes, clipped", UNTILTED_HOME_AXES, plain_untilted, {"tolerance": 2e-3}),
        ("rigid, home offsets (chain of axes)", RIGID, plain_rigid, {"home_azimuth": 1e-3}),
        ("untilted, home offsets (chain of axes)", UNTILTED_HOME_AXES, plain_untilted, {"home_azimuth": 1e-3}),
    ]
    for name, model, plain, more in cases:
        slow = best(partial(each_mount, plain, sun, sample), 3) / (len(sample) * len(sun))
        fast = best(partial(window_errors, model, windows, tilt, direction, **more))
        row(f"{name}, {len(TILTS)} tilts x {len(DIRECTIONS)} directions", fast, work, slow)
    one = best(lambda: window_errors(RIGID, windows, TILTS[1], direction))
    row(f"rigid, 1 tilt x {len(DIRECTIONS)} directions", one, len(sun) * len(DIRECTIONS))
    many = np.linspace(TILTS[0], TILTS[-1], 60)[:, np.newaxis]
    row("rigid, 60 tilts x 24 directions", best(lambda: window_errors(RIGID, windows, many, direction)), 10 * work)
    print("ratio: to the closed form in NumPy, one mount at a time\n")


def suns() -> None:
    """Sun positions of a year."""
    from pvlib import spa

    unix = UTC.astype(np.int64) / 1e9
    slow = best(lambda: spa.solar_position_numpy(unix, 40.13, 94.67, 0.0, 1013.25, 12.0, 69.0, 0.5667, 1), 2)
    each = slow / len(UTC)
    print(f"{'sun positions':<58} {'ns each':>10} {'million/s':>10} {'ratio':>10}")
    row("pvlib's SPA (NumPy)", slow, len(UTC))
    row("fast sun, 1 site", best(lambda: fast_sun.sun_vectors(UTC, 40.13, 94.67, 0.0, 69.0)), len(UTC), each)
    row("fast sun, 1 site, delta T by month", best(lambda: fast_sun.sun_vectors(UTC, 40.13, 94.67)), len(UTC), each)
    sites = np.arange(-60.0, 60.1, 2.5)
    many = best(lambda: fast_sun.sun_vectors(UTC, sites, 94.67, 0.0, 69.0))
    row(f"fast sun, {len(sites)} sites", many, len(UTC) * len(sites), each)

    def first_call() -> None:
        fast_sun._splines.cache_clear()
        fast_sun.sun_vectors(UTC, 40.13, 94.67, 0.0, 69.0)

    row("fast sun, 1 site, with the nodes of the year", best(first_call), len(UTC), each)


if __name__ == "__main__":
    dishes()
    suns()

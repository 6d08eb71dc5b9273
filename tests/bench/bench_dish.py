"""Speed of the dish kernels and of the fast sun on one core: `python -m tests.bench dish`.

Pointing errors (site, instant, tilt, direction; the sun in memory), as daily means and maxima over a year, beside the
closed form in plain NumPy, one mount at a time; sun positions beside pvlib's SPA.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from heliosweep.grid import sun as fast_sun
from heliosweep.kernels.dish import RIGID, UNTILTED_HOME_AXES, pack_windows, window_errors
from tests.bench.table import Row, best, measured

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


def dishes() -> Iterator[Row]:
    """Pointing errors: daily means and maxima over a year."""
    unit = "tracker-instant"
    sun = fast_sun.sun_vectors(UTC, 40.13, 94.67, 0.0, 69.0)
    windows = pack_windows(sun, np.arange(0, len(sun) + 1, WINDOW))
    sample = [(tilt, direction) for tilt in TILTS[::3] for direction in DIRECTIONS[::6]]
    plain = {
        model: best(partial(each_mount, form, sun, sample), 3) / (len(sample) * len(sun))
        for model, form in ((RIGID, plain_rigid), (UNTILTED_HOME_AXES, plain_untilted))
    }
    tilt, clipped, homes = TILTS[:, np.newaxis], {"tolerance": 2e-3}, {"home_azimuth": 1e-3}
    cases: list[tuple[str, int, Floats, dict[str, float]]] = [
        ("dish, rigid, 6 x 24 tilts, directions", RIGID, tilt, {}),
        ("dish, rigid, 60 x 24", RIGID, np.linspace(TILTS[0], TILTS[-1], 60)[:, np.newaxis], {}),
        ("dish, rigid, 1 x 24", RIGID, TILTS[1:2, np.newaxis], {}),
        ("dish, rigid, 6 x 24, clipped", RIGID, tilt, clipped),
        ("dish, untilted home axes, 6 x 24", UNTILTED_HOME_AXES, tilt, {}),
        ("dish, untilted, 6 x 24, clipped", UNTILTED_HOME_AXES, tilt, clipped),
        ("dish, rigid, chain of axes, 6 x 24", RIGID, tilt, homes),
        ("dish, untilted, chain of axes, 6 x 24", UNTILTED_HOME_AXES, tilt, homes),
    ]
    for name, model, tilts, more in cases:
        work = partial(window_errors, model, windows, tilts, DIRECTIONS, **more)
        units = len(sun) * tilts.size * len(DIRECTIONS)
        yield measured(name, unit, work, units, beside={"NumPy": plain[model]})


def suns() -> Iterator[Row]:
    """Sun positions of a year."""
    from pvlib import spa

    unix = UTC.astype(np.int64) / 1e9
    spas = partial(spa.solar_position_numpy, unix, 40.13, 94.67, 0.0, 1013.25, 12.0, 69.0, 0.5667, 1)
    beside = {"pvlib's SPA (NumPy)": best(spas, 2) / len(UTC)}

    def row(name: str, work: Callable[[], object], sites: int = 1) -> Row:
        return measured(name, "sun position", work, len(UTC) * sites, beside=beside)

    def first_call() -> None:
        fast_sun._splines.cache_clear()
        fast_sun.sun_vectors(UTC, 40.13, 94.67, 0.0, 69.0)

    sites = np.arange(-60.0, 60.1, 2.5)
    yield row("sun, 1 site", lambda: fast_sun.sun_vectors(UTC, 40.13, 94.67, 0.0, 69.0))
    yield row("sun, 1 site, delta T by month", lambda: fast_sun.sun_vectors(UTC, 40.13, 94.67))
    yield row(f"sun, {len(sites)} sites", lambda: fast_sun.sun_vectors(UTC, sites, 94.67, 0.0, 69.0), len(sites))
    yield Row("sun, 1 site, with the nodes of the year", "sun position", best(first_call) / len(UTC), beside)


GROUPS = (dishes, suns)

"""Speed of the intercept on one core: `python -m tests.bench intercept`.

Each evaluation beside rays traced in NumPy, as many as make its error some 1e-3, and beside HFLCAL's Gaussian; a year
of hours of a whole field beside exact shading and blocking, and beside interpolation of each mirror by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels import sunshapes
from heliosweep.kernels.field.efficiency import field_sums, sorted_field
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.intercept import hflcal
from heliosweep.kernels.intercept.course import course, table_of
from heliosweep.kernels.intercept.efficiency import Scene, intercepts, sun_tables
from heliosweep.kernels.intercept.mirror import Errors, Facets
from heliosweep.kernels.intercept.receivers import CYLINDER, Receiver, cylinder, rectangle
from heliosweep.kernels.sun.clock import declination_cooper, solar_clock
from tests.bench.bench_field import UNIT, staggered
from tests.bench.table import Row, best
from tests.kernels.intercept.rays import traced

Floats = NDArray[np.float64]

RAYS = 14
"""Power of two of the rays that are traced."""
#: Heliostats of a field, evenly spread, that are interpolated by themselves; and the first so many, shaded and blocked.
SOME = 60
SUN = sunshapes.pillbox()


def scene(x: Floats, y: Floats, receiver: Receiver, slope: float, tracking: int) -> Scene:
    """Mirrors of 11 m, focused on the receiver, with the slope error of both axes. [mrad]"""
    found, errors = sun_tables(SUN, Errors(1e-3 * slope, 1e-3 * slope, 0.0))
    centre, many = np.stack((x, y, np.full(len(x), 6.0)), axis=1), len(x)
    target = np.tile(np.array(receiver.centre), (many, 1))
    if receiver.kind == CYLINDER:
        target[:, :2] = receiver.half_width * centre[:, :2] / np.hypot(x, y)[:, np.newaxis]
    curve = 0.5 / np.sqrt(np.sum((target - centre) ** 2, axis=1))
    return Scene(
        centre, target, np.full((many, 2), 11.0), curve, np.zeros(many), np.zeros((many, 2)), Facets(1, 1, 0.0),
        tracking, errors, receiver, found,
    )  # fmt: skip


def direct() -> Iterator[Row]:
    """Single evaluations, mirrors 80 to 700 m away."""
    rng = np.random.default_rng(0)
    far, turn, slopes = rng.uniform(80, 700, 40), rng.uniform(-1, 1, 40), (1.0, 2.0)
    rise, azimuth = np.radians(rng.uniform(10, 80, 10)), np.radians(rng.uniform(60, 300, 10))
    sun = np.stack((np.sin(azimuth) * np.cos(rise), np.cos(azimuth) * np.cos(rise), np.sin(rise)), axis=1)
    aim = (0.0, 0.0, 120.0)
    for receiver in (rectangle(aim, 0.0, -0.26, 12.0, 12.0), cylinder(aim, 7.0, 16.0)):
        for slope in slopes:
            made = scene(far * np.sin(turn), far * np.cos(turn), receiver, slope, SPINNING_ELEVATION)
            count = len(far) * len(sun)
            seconds = best(partial(intercepts, made, sun), 3) / count
            beside = {
                f"2^{RAYS} rays in NumPy": best(partial(traced, made, 0, sun[0], RAYS), 1),
                "HFLCAL": best(partial(hflcal.intercepts, made, SUN.spread, sun), 3) / count,
            }
            name = "cylinder" if receiver.kind == CYLINDER else "rectangle"
            yield Row(f"{name}, slope {slope:.0f} mrad, {1e6 * seconds:.1f} us", UNIT, seconds, beside)


def years() -> Iterator[Row]:
    """A year of hours."""
    day, hour = np.meshgrid(np.arange(1, 366), np.arange(0.5, 24.0), indexing="ij")
    sun, latitude = solar_clock(np.radians(35.0), declination_cooper(day.ravel()), hour.ravel()), np.radians(35.0)
    up = np.ascontiguousarray(sun[sun[:, 2] > 0])
    for count in (317, 2_650):
        field = staggered(count)
        receiver = cylinder((0.0, 0.0, field[5]), 7.0, 16.0)
        some = np.linspace(0, count - 1, SOME).astype(int)
        for name, tracking in (("spinning", SPINNING_ELEVATION), ("azimuth", AZIMUTH_ELEVATION)):
            made = scene(field[0], field[1], receiver, 1.5, tracking)
            seconds = best(partial(shared, made, up, float(latitude)), 1) / (count * len(up))
            alone = best(partial(course, made.some(some), up, float(latitude)), 1)
            shaded = best(partial(field_sums, sorted_field(*field), tracking, up, 0, SOME), 1)
            beside = {
                "shading and blocking": shaded / (SOME * len(up)),
                "each mirror by itself": alone / (SOME * len(up)),
            }
            yield Row(f"year of {count:,}, {name}, {1e6 * seconds:.2f} us", UNIT, seconds, beside)


def shared(made: Scene, sun: Floats, latitude: float) -> None:
    """All mirrors of a field, with the table that they share."""
    course(made, sun, latitude, table=table_of(made, sun, latitude))


GROUPS = (direct, years)

"""The field kernels against polygons of shapely in fields made to be hard."""

from collections.abc import Callable

import numpy as np
import pytest

from heliosweep.kernels.field.efficiency import aimed, field_series, sorted_field
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.sun import solar_clock
from tests.kernels.field.fields import Field, Floats, directions, scattered, suns
from tests.kernels.field.oracles import instant

METHODS = pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])


def sides(rng: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """Half sides, all equal or all different, or a few sizes."""
    kind = rng.integers(3)
    if kind == 0:
        half = np.full(count, 5.0)
        return half, half
    if kind == 1:
        width, height = rng.uniform(0.5, 9.0, (2, count))
        return width, height
    return rng.choice([2.0, 4.0, 8.0], count), rng.choice([2.0, 4.0, 8.0], count)


def straddling(rng: np.random.Generator) -> tuple[Field, Floats]:
    """So dense that mirrors stand across each other's planes, and through each other."""
    x, y, z, _, _, target = scattered(rng, 40, rng.uniform(3.0, 8.0))
    return (x, y, z, *sides(rng, 40), target), np.concatenate((suns(rng, 20, 0.5, 20.0), suns(rng, 20)))


def hills(rng: np.random.Generator) -> tuple[Field, Floats]:
    """Heights and sizes that differ much, some mirrors above the target, and the sun low."""
    x, y, _, _, _, target = scattered(rng, 60, rng.uniform(6.0, 14.0))
    z = rng.uniform(0.0, 80.0, 60) if rng.random() < 0.5 else 5.0 + 0.2 * x + rng.uniform(-5.0, 5.0, 60)
    return (x, y, z, *sides(rng, 60), target), np.concatenate((suns(rng, 20, 0.1, 15.0), suns(rng, 20)))


def spokes(rng: np.random.Generator) -> tuple[Field, Floats]:
    """Heliostats on a few spokes with the sun in their planes: edges coincide; some mirrors are of the same size."""
    ways = directions(rng.choice([0.0, 90.0, 180.0, 270.0, 45.0, rng.uniform(0.0, 360.0)], 3, replace=False), 0.0)
    distances = 30.0 + np.arange(12) * rng.choice([6.0, 11.0, 15.5, 20.0])
    x, y = (ways[:, None, :2] * distances[:, None]).reshape(-1, 2).T
    z = np.full(36, 5.0) + rng.choice([0.0, 1.0]) * np.tile(0.1 * distances, 3)
    azimuth = np.degrees(np.arctan2(x[::12], y[::12]))
    in_planes = directions(rng.choice(np.concatenate((azimuth, azimuth + 180.0)), 36), rng.uniform(1.0, 88.0, 36))
    zenith = np.array([[0.0, 0.0, 1.0]])
    return (x.copy(), y.copy(), z, *sides(rng, 36), 60.0), np.concatenate((in_planes, zenith, suns(rng, 4)))


def parallel(rng: np.random.Generator) -> tuple[Field, Floats]:
    """A lattice under a target as good as infinitely far: all mirrors parallel, images with common edges and corners.

    The sun stands in planes of the lattice.
    """
    pitch = rng.choice([8.0, 10.0, 11.0, 16.0])
    x, y = (axis.ravel() for axis in np.meshgrid(pitch * np.arange(-3.0, 4.0), pitch * np.arange(-3.0, 4.0)))
    far = rng.choice([0.0, 2.0**23])  # metres, exact with the lattice
    up = rng.choice([2.0**20, 2.0**22]) if far else 2.0**30
    half = np.full(49, rng.choice([4.0, 5.0, 5.5]))
    planes = np.degrees(np.arctan2([0, 1, 0, -1, 1, -1, 1, 2, -1], [1, 0, -1, 0, 1, 1, -1, 1, 2]))
    sun = directions(rng.choice(planes, 40), rng.choice([0.5, 3.0, 10.0, 30.0, 45.0, 60.0, rng.uniform(1.0, 80.0)], 40))
    return (x, y - far, np.full(49, 5.0), half, half, up), sun


def southern(rng: np.random.Generator) -> tuple[Field, Floats]:
    """Around and south of a tower in the southern hemisphere, from sunrise to sunset."""
    x, y, z, width, height, target = scattered(rng, 60, rng.uniform(7.0, 12.0))
    y = y - rng.choice([0.0, 80.0])
    sun = solar_clock(np.radians(rng.uniform(-65.0, -5.0)), rng.uniform(-0.4, 0.4), np.linspace(4.0, 20.0, 50))
    return (x, y, z, width, height, target), sun


HARD = pytest.mark.parametrize("made", [straddling, hills, spokes, parallel, southern])
Made = Callable[[np.random.Generator], tuple[Field, Floats]]


def check(made: Made, tracking: int, seed: int, some: int) -> None:
    """Assert that efficiencies of some heliostats agree to 1e-12 at some instants."""
    rng = np.random.default_rng(seed)
    field, sun = made(rng)
    tests, sun = rng.choice(len(field[0]), some, replace=False), sun[rng.choice(len(sun), some, replace=False)]
    found = field_series(sorted_field(*field), tracking, sun, 0, len(field[0]))[:, :, tests]
    expected = np.full((some, some, 4), np.nan)
    for k in np.flatnonzero(sun[:, 2] > 0.0):
        expected[k] = [instant(i, aimed(*field), tracking, sun[k]) for i in tests]
    np.testing.assert_allclose(found, np.moveaxis(expected, 2, 0), atol=1e-12, rtol=0)


@METHODS
@HARD
def test_hard_fields(made: Made, tracking):
    check(made, tracking, 0, 6)


@pytest.mark.long
@METHODS
@HARD
def test_many_hard_fields(made: Made, tracking):
    for seed in range(1, 40):
        check(made, tracking, seed, 12)

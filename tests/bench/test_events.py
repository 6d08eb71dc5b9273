"""Events of the field kernel, recounted."""

import numpy as np

from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION
from tests.bench.bench_field import year
from tests.bench.events import EVENTS, events


def row_of(count):
    """Mirrors of 10 m one behind the other, 12 m apart, north of a tower; none but the next is in the way."""
    y, side = 100.0 + 12.0 * np.arange(count), np.full(count, 5.0)
    return np.zeros(count), y, np.full(count, 6.0), side, side, 60.0


def test_a_mirror_alone_has_nothing_in_its_way():
    assert events(row_of(1), AZIMUTH_ELEVATION, year(30.0, every=40)) == dict.fromkeys(EVENTS, 0.0)


def test_mirrors_in_a_row():
    found = events(row_of(30), AZIMUTH_ELEVATION, year(30.0, every=40))
    assert found["candidates"] >= found["images"] > 1.0  # the one before blocks, and shades in the morning
    assert found["tests of pairs"] >= found["pairs"] > found["triples"]

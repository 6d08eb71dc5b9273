"""A block of a large field costs what the block and its halo cost, whatever the field."""

import numpy as np
import pytest

from heliosweep.kernels.field.efficiency import field_series, sorted_field
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.vectors import PACKET
from heliosweep.layouts import radial_stagger
from tests.kernels.field.fields import Field, directions

SIDE, TOWER = 11.0, 150.0
BLOCK = range(900, 905)


def staggered(count: int) -> Field:
    """The same field but for its size."""
    layout = radial_stagger(16.0, 61.3, heliostats=count)
    half = np.full(count, SIDE / 2.0)
    return layout.x, layout.y, np.full(count, 7.0), half, half, TOWER


def packet(rng):
    """Sun directions that fit in one packet."""
    return directions(rng.uniform(119.0, 121.0, 8), rng.uniform(14.0, 15.0, 8))


@pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])
def test_same_bits_whatever_stands_beyond_the_halo(tracking):
    x, y, z, width, height, target = staggered(4_000)
    sun = packet(np.random.default_rng(2))
    whole = field_series(sorted_field(x, y, z, width, height, target), tracking, sun, BLOCK.start, BLOCK.stop)
    assert (whole[1:3] < 0.999).any()
    # All beyond 250 m go elsewhere, out of reach; the outline of the field, and with it the grid, stays.
    far = np.hypot(x - x[BLOCK[2]], y - y[BLOCK[2]]) > 250.0
    outline = (x == x.min()) | (x == x.max()) | (y == y.min()) | (y == y.max())
    moved = far & ~outline
    assert moved.sum() > 3_000
    corner = np.argmax(np.hypot(x - x[BLOCK[2]], y - y[BLOCK[2]]))
    x, y = np.where(moved, 0.99 * x[corner], x), np.where(moved, 0.99 * y[corner], y)
    part = field_series(sorted_field(x, y, z, width, height, target), tracking, sun, BLOCK.start, BLOCK.stop)
    np.testing.assert_array_equal(part, whole)


@pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])
def test_same_bits_where_frames_take_the_places_of_others(tracking):
    rng = np.random.default_rng(3)
    sun = directions(rng.uniform(119.0, 121.0, PACKET), rng.uniform(14.0, 15.0, PACKET))
    field, count = staggered(2_500), 2_500
    whole = field_series(sorted_field(*field), tracking, sun, 0, count)
    parts = [field_series(sorted_field(*field), tracking, sun, start, start + 500) for start in range(0, count, 500)]
    np.testing.assert_array_equal(np.concatenate(parts, axis=2), whole)

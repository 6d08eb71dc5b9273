"""Images are taken out where another one hides them, and nowhere else."""

import numpy as np
import pytest
import shapely

from heliosweep.kernels.vectors import PACKET, ROW
from tests.kernels.field.parallelograms import SQUARE, corners, images_for, shapely_areas, union_areas

LANE = 3
"""The lane that is looked at."""


def left(shapes, shading=None):
    """Which of parallelograms, shape (m, 6), stay in one lane; the others lose their area there, and there alone."""
    everywhere = np.repeat(np.asarray(shapes, float)[:, np.newaxis], PACKET, axis=1)
    before, images = images_for(everywhere), images_for(everywhere, shading, 1 << LANE)
    stays = images.present >> LANE & 1 == 1
    np.testing.assert_array_equal(images.present | 1 << LANE, before.present | 1 << LANE)
    areas, expected = (each.rows.reshape(len(shapes), -1, ROW)[:, 6, :PACKET].copy() for each in (images, before))
    expected[~stays, LANE] = 0.0
    np.testing.assert_array_equal(areas, expected)
    return stays.tolist()


def rectangle(west, east, south, north):
    return (west + east) / 2, (south + north) / 2, (east - west) / 2, 0.0, 0.0, (north - south) / 2


def test_a_larger_one_hides():
    assert left([rectangle(-0.5, 0.5, -0.5, 0.5), rectangle(-0.9, 0.9, -0.9, 0.9)]) == [False, True]
    assert left([rectangle(-0.9, 0.9, -0.9, 0.9), rectangle(-0.5, 0.95, -0.5, 0.5)]) == [True, True]


def test_what_lies_beyond_the_square_does_not_count():
    low, high = rectangle(-0.8, 0.8, -3.0, 0.2), rectangle(-0.8, 0.8, -1.2, 0.5)
    assert left([low, high]) == [False, True]


def test_of_equals_the_first_stays():
    one = rectangle(-0.7, 0.3, -0.6, 0.8)
    assert left([one] * 5) == [True] + [False] * 4


def test_kinds_do_not_hide_one_another():
    small, large = rectangle(-0.2, 0.2, -0.2, 0.2), rectangle(-1.0, 1.0, -1.0, 1.0)
    assert left([small, large], 1) == [True, True]
    assert left([large, small], 1) == [True, True]
    assert left([small, large, small, large], 2) == [False, True, False, True]


def crowd(rng, count):
    """Images as a low sun makes them: nearly parallel, most of them beyond the lower edge; some equal, some turned."""
    centre = np.stack((rng.uniform(-2.0, 2.0, (count, PACKET)), rng.uniform(-2.5, 0.5, (count, PACKET))), -1)
    edges = np.array([1.0, 0.0, 0.0, 1.2]) + rng.choice([0.0, 0.02, 0.3]) * rng.normal(size=(count, PACKET, 4))
    shapes = np.concatenate((centre, edges), axis=-1)
    again = rng.integers(0, count, count // 4)
    shapes[rng.integers(0, count, count // 4)] = shapes[again]
    return shapes


@pytest.mark.parametrize("seed", range(6))
def test_nothing_is_lost_that_could_be_seen(seed):
    shapes = crowd(np.random.default_rng(seed), 40)[:, 0]
    parts = shapely.intersection(shapely.polygons(corners(shapes)), SQUARE)
    stays = np.array(left(shapes))
    there = shapely.area(parts) > 0.0
    assert 0 < stays.sum() < there.sum()
    seen = shapely.union_all(parts[stays])
    assert shapely.area(shapely.difference(parts[there & ~stays], seen)).max() < 1e-12


@pytest.mark.parametrize("hiding", [0, -1], ids=["all", "without those hidden"])
@pytest.mark.parametrize(("shading", "count"), [(7, 7), (12, 14), (40, 45), (0, 20)])
def test_unions_of_crowds_against_shapely(shading, count, hiding):
    shapes = crowd(np.random.default_rng(count), count)
    np.testing.assert_allclose(union_areas(shapes, shading, hiding), shapely_areas(shapes, shading), atol=1e-12, rtol=0)

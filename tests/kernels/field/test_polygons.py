"""Unions of images against shapely: random sets, sets made of ties, crowds in which images hide others."""

import numpy as np
import pytest

from heliosweep.kernels.vectors import PACKET
from tests.kernels.field.parallelograms import shapely_areas, union_areas


def random_shapes(rng, count):
    centre = rng.uniform(-1.6, 1.6, (count, PACKET, 2))
    edges = rng.normal(0.0, 0.7, (count, PACKET, 4))
    return np.concatenate((centre, edges), axis=2)


def leaning(rng, count):
    """Images about as large as the mirror, each turned and sheared by up to half a right angle."""
    edges = np.array([1.0, 0.0, 0.0, 1.0]) + rng.uniform(-0.4, 0.4, (count, PACKET, 4))
    return np.concatenate((rng.uniform(-1.0, 1.0, (count, PACKET, 2)), edges), axis=-1)


def tied_shapes(rng, count):
    """Rectangles on a coarse lattice, turned together, then disturbed by next to nothing."""
    low = rng.integers(-4, 4, (count, PACKET, 2))
    size = rng.integers(1, 5, (count, PACKET, 2))
    turn = rng.choice([0.0, 0.0, 0.3, np.pi / 4], (1, PACKET))
    e, f = np.stack((np.cos(turn), np.sin(turn)), -1), np.stack((-np.sin(turn), np.cos(turn)), -1)
    centre = (low + size / 2) / 2
    shapes = np.concatenate(
        (centre[..., :1] * e + centre[..., 1:] * f, size[..., :1] / 4 * e, size[..., 1:] / 4 * f), axis=2
    )
    return shapes + rng.choice([-1, 0, 1], shapes.shape) * 10.0 ** rng.uniform(-17, -12, shapes.shape)


@pytest.mark.parametrize("make", [random_shapes, leaning, tied_shapes])
@pytest.mark.parametrize(
    ("shading", "count"), [(0, 1), (1, 1), (2, 2), (1, 2), (2, 3), (3, 3), (2, 5), (5, 8), (30, 40)]
)
def test_unions_against_shapely(make, shading, count):
    rng = np.random.default_rng(count)
    for _ in range(2 if count < 10 else 1):
        shapes = make(rng, count)
        np.testing.assert_allclose(union_areas(shapes, shading), shapely_areas(shapes, shading), atol=1e-12, rtol=0)


def crowd(rng, count):
    """Images as a low sun makes them: nearly parallel, most of them beyond the lower edge; some equal, some turned."""
    centre = np.stack((rng.uniform(-2.0, 2.0, (count, PACKET)), rng.uniform(-2.5, 0.5, (count, PACKET))), -1)
    edges = np.array([1.0, 0.0, 0.0, 1.2]) + rng.choice([0.0, 0.02, 0.3]) * rng.normal(size=(count, PACKET, 4))
    shapes = np.concatenate((centre, edges), axis=-1)
    again = rng.integers(0, count, count // 4)
    shapes[rng.integers(0, count, count // 4)] = shapes[again]
    return shapes


@pytest.mark.parametrize(("shading", "count"), [(7, 7), (12, 14), (40, 45), (0, 20)])
def test_unions_of_crowds_against_shapely(shading, count):
    shapes = crowd(np.random.default_rng(count), count)
    np.testing.assert_allclose(union_areas(shapes, shading), shapely_areas(shapes, shading), atol=1e-12, rtol=0)


def stripes(count):
    """Thin stripes in two directions, first one then the other."""
    places, width = (np.arange(count) + 0.5) / count * 2.0 - 1.0, 0.3 / count
    return [(p, 0.0, width, 0.0, 0.0, 2.0) for p in places] + [(0.0, p, 2.0, 0.0, 0.0, width) for p in places]


def test_stripes_that_leave_a_hundred_pieces():
    count = 10
    shapes = np.repeat(np.array(stripes(count))[:, np.newaxis], PACKET, axis=1)
    shaded, blocked, both = union_areas(shapes, count)
    np.testing.assert_allclose([shaded[3], blocked[3], both[3]], [4.0 * 0.3, 4.0 * 0.3, 4.0 * 0.51], atol=1e-11)


@pytest.mark.parametrize("tiny", [0.0, 5e-324, 1e-300, 1e-17, 1e-16, 1e-13])
def test_nearly_level_edges_lose_nothing(tiny):
    for shape, expected in (
        ((0.0, 0.0, 0.5, tiny, tiny, 0.5), 1.0),
        ((1.0, 1.0, 1.0, tiny, tiny, 1.0), 1.0),
        ((0.0, 0.0, 1.0, tiny, -tiny, 1.0), 4.0),
        ((0.0, 0.0, tiny, 3.0, 2.0, tiny), 4.0),
    ):
        shapes = np.tile(np.array(shape), (2, PACKET, 1))
        assert abs(union_areas(shapes, 1) - expected).max() < 1e-12

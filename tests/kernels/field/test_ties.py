"""Unions of two, three and four images full of ties, against exact areas."""

from fractions import Fraction

import numpy as np
import pytest

from heliosweep.kernels.vectors import PACKET
from tests.kernels.field.exact_areas import exact_areas
from tests.kernels.field.parallelograms import shapely_areas, union_areas
from tests.kernels.field.ties import tied_shapes

BATCH = 8 * PACKET
COUNTS = pytest.mark.parametrize("count", [2, 3, 4])


def check(count, batch):
    """Assert that the kernel's areas of one batch of sets are exact within 1e-12.

    shapely is no oracle here: one set in some thousands is off by as much as 0.1.
    """
    shapes = tied_shapes(np.random.default_rng([count, batch]), count, BATCH)
    for packet, lanes in enumerate(np.split(np.arange(BATCH), BATCH // PACKET)):
        shading = (batch + packet) % (count + 1)
        areas = union_areas(shapes[:, lanes], shading)
        for k in lanes:
            found, expected = areas[:, k - lanes[0]], exact_areas(shapes[:, k], shading)
            error = max(abs(float(Fraction(float(f)) - e)) for f, e in zip(found, expected, strict=True))
            assert error < 1e-12, (error, shading, [[v.hex() for v in s] for s in shapes[:, k].tolist()])


@COUNTS
def test_ties(count):
    check(count, 0)


@pytest.mark.long
@COUNTS
def test_256_000_ties(count):
    for batch in range(256_000 // BATCH):
        check(count, batch)


@pytest.mark.parametrize("shading", range(5))
def test_exact_areas_against_shapely(shading):
    rng = np.random.default_rng(shading)
    shapes = np.concatenate((rng.uniform(-1.6, 1.6, (4, 100, 2)), rng.normal(0.0, 0.7, (4, 100, 4))), axis=2)
    areas = [[float(area) for area in exact_areas(shapes[:, k], shading)] for k in range(100)]
    np.testing.assert_allclose(np.transpose(areas), shapely_areas(shapes, shading), atol=1e-12, rtol=0)

"""Modules and pixels of a mirror."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import minimum_filter

from heliosweep.kernels.gazing.geometry import eroded, mirror_grid, themis_8


@settings(max_examples=40)
@given(st.floats(0.05, 0.6), st.integers(0, 4))
def test_erosion_is_that_of_a_square_neighbourhood(pixel, cells):
    grid = mirror_grid(themis_8(), pixel)
    size = 2 * cells + 1
    expected = np.zeros(grid.module.shape, bool)
    for number in range(1, 9):
        expected |= minimum_filter((grid.module == number).astype(int), size, mode="constant") > 0
    np.testing.assert_array_equal(eroded(grid, cells), expected.ravel()[grid.place])

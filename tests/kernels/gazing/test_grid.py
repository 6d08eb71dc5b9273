"""Modules and pixels of a mirror."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import minimum_filter

from heliosweep.kernels.gazing.geometry import eroded, maps, mirror_grid, themis_8


def test_heliostat_of_themis():
    modules = themis_8()
    assert modules.size.prod(axis=1).sum() == pytest.approx(51.84)  # more than 50 square metres, says the paper
    left, right = modules.centre[:4], modules.centre[4:]
    np.testing.assert_allclose(left[:, 0], -1.825)
    np.testing.assert_allclose(right[:, 0], 1.825)
    assert np.all(np.diff(left[:, 1]) < 0.0)
    np.testing.assert_allclose(modules.centre.mean(axis=0), 0.0, atol=1e-15)


def test_pixels_of_themis():
    grid = mirror_grid(themis_8(), 0.05)
    assert grid.module.shape == (147, 145)
    assert np.all(np.bincount(grid.pixel_module) == 72 * 36)
    assert np.all(np.diff(grid.z) > 0.0)
    assert grid.module[-1, 0] == 1
    assert grid.module[0, 0] == 4
    assert grid.module[-1, -1] == 5
    assert np.bincount(grid.pixel_module[eroded(grid, 2)]).tolist() == [68 * 32] * 8


@settings(max_examples=40)
@given(st.floats(0.05, 0.6), st.integers(0, 4))
def test_erosion_is_that_of_a_square_neighbourhood(pixel, cells):
    grid = mirror_grid(themis_8(), pixel)
    size = 2 * cells + 1
    expected = np.zeros(grid.module.shape, bool)
    for number in range(1, 9):
        expected |= minimum_filter((grid.module == number).astype(int), size, mode="constant") > 0
    np.testing.assert_array_equal(eroded(grid, cells), expected.ravel()[grid.place])


def test_values_go_back_to_the_grid():
    grid = mirror_grid(themis_8(), 0.3)
    full = maps(grid, np.stack([grid.pixels[0], grid.pixels[1], grid.pixel_module + 1.0]))
    assert full.shape == (3, *grid.module.shape)
    there = grid.module > 0
    np.testing.assert_array_equal(full[0][there], np.broadcast_to(grid.y, grid.module.shape)[there])
    np.testing.assert_array_equal(full[1][there], np.broadcast_to(grid.z[:, None], grid.module.shape)[there])
    np.testing.assert_array_equal(full[2][there], grid.module[there])
    assert np.all(np.isnan(full[:, ~there]))

"""Images of the true surface: exact spheres, turned modules, waviness, and what cameras do to them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heliosweep.kernels.gazing.geometry import (
    Modules,
    expose,
    image_set,
    mirror_grid,
    module_spheres,
    themis_8,
    waviness,
)
from heliosweep.kernels.profiles import jose
from tests.kernels.gazing import twin

SMALL = st.floats(-3e-3, 3e-3)


@settings(max_examples=40)
@given(SMALL, SMALL, SMALL, SMALL, st.floats(60.0, 300.0))
def test_images_are_those_of_vectors_in_space(c_y, c_z, p_y, p_z, focal_length):
    layout, modules, grid = twin.paper_scene(), themis_8(), twin.paper_grid(0.4)
    canting = np.tile([c_y, c_z], (8, 1)) * np.linspace(-1.0, 1.0, 8)[:, np.newaxis]
    spheres = module_spheres(modules, focal_length, canting, (p_y, p_z))
    images, slopes = image_set(layout, grid, jose(), spheres)
    for row in range(8):
        here = grid.pixel_module == row
        y, z = grid.pixels[0][here], grid.pixels[1][here]
        points, normals = twin.surface(y, z, modules.centre[row], focal_length, canting[row], (p_y, p_z))
        expected = twin.images(layout, points, normals)
        # Near the limb the brightness falls without end: rounding of an angle shows there as its square root.
        np.testing.assert_allclose(images[:, here], expected, atol=2e-5)
        assert np.mean(np.abs(images[:, here] - expected) < 1e-11) > 0.98
        _, ideal = twin.series(y, z, 120.0)
        true = normals[:, 1:] / normals[:, :1] - ideal[:, 1:] / ideal[:, :1]
        np.testing.assert_allclose(slopes[:, here], true.T, atol=1e-14)


def test_waviness_has_its_wavelength():
    whole = Modules(np.zeros((1, 2)), np.full((1, 2), 16.0))
    grid = mirror_grid(whole, 0.1)
    slopes = waviness(grid, 3e-4, 1.0, 2).reshape(2, *grid.module.shape)
    power = np.sum(np.abs(np.fft.fft2(slopes)) ** 2, axis=0)
    k = np.fft.fftfreq(160, 0.1)
    wave = np.hypot(k[:, np.newaxis], k)
    assert np.sqrt(np.sum(power * wave) / np.sum(power)) == pytest.approx(1.0, rel=0.25)


def test_noise_gain_and_levels():
    clean = np.full((4, 20_000), 0.9)
    np.testing.assert_array_equal(expose(clean), clean)
    noise = expose(clean, noise=0.01, seed=3) - clean
    assert noise.std() == pytest.approx(0.01, rel=0.01)
    assert abs(noise.mean()) < 2e-4
    assert np.abs(np.corrcoef(noise) - np.eye(4)).max() < 0.03
    np.testing.assert_array_equal(noise, expose(clean, noise=0.01, seed=3) - clean)
    assert np.all(expose(clean, noise=0.01, seed=4) - clean != noise)
    levels = expose(np.linspace(-0.1, 1.5, 999)[np.newaxis], bits=8)
    assert len(np.unique(levels)) == 256
    assert levels.min() == 0.0
    assert levels.max() == pytest.approx(1.25)
    inside = np.linspace(0.0, 1.25, 999)[np.newaxis]
    assert np.abs(expose(inside, bits=12) - inside).max() <= 0.5 * 1.25 / 4095 * (1 + 1e-9)

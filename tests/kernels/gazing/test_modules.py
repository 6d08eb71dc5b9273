"""Canting, pointing and focal length from slope maps, and whether their standard errors are true."""

import numpy as np
import pytest

from heliosweep.kernels.gazing.geometry import Modules, eroded, image_set, mirror_grid, module_spheres, themis_8
from heliosweep.kernels.gazing.slopes import module_estimates
from heliosweep.kernels.profiles import jose
from tests.kernels.gazing import twin

FLAT = np.zeros((8, 2))
MRAD = 1e-3
POINTING = (0.2 * MRAD, -0.1 * MRAD)


def true_slopes(grid, focal_length=120.0, canting=FLAT, pointing=(0.0, 0.0), wavy=None):
    spheres = module_spheres(themis_8(), focal_length, canting, pointing)
    return image_set(twin.paper_scene(), grid, jose(), spheres, wavy)[1]


def estimates(slopes, grid, use=None, **more):
    return module_estimates(slopes, grid, themis_8(), eroded(grid, 2) if use is None else use, 120.0, **more)


def test_what_is_planted_is_found():
    grid = twin.paper_grid()
    found = estimates(true_slopes(grid, canting=0.5 * twin.paper_canting(), pointing=POINTING), grid)
    np.testing.assert_allclose(found["canting"].T, 0.5 * twin.paper_canting(), atol=2e-4 * MRAD)
    np.testing.assert_allclose(found["pointing"], POINTING, atol=1e-4 * MRAD)
    assert found["focal_length"] == pytest.approx(120.0, abs=2e-3)


def some_modules(number):
    """Two columns, centred."""
    centre = np.array([[1.1 * (k % 2), 0.8 * (k // 2)] for k in range(number)])
    return Modules(centre - centre.mean(axis=0), np.tile([1.0, 0.7], (number, 1)))


TRIALS = 400


@pytest.mark.parametrize(("kind", "number"), [("together", 1), ("together", 8), ("apart", 2), ("unequal", 8)])
def test_stated_errors_are_those_found(kind, number):
    """Modules at one place or far apart, with noise that is the same or up to three times as large: found standard
    deviations have a statistical error of 3.5 %."""
    modules = some_modules(number)
    grid = mirror_grid(modules, 0.05)
    use, rng = eroded(grid, 0), np.random.default_rng(number)
    noise = 0.1 * MRAD * (1.0 + np.arange(number) % 3 if kind == "unequal" else np.ones(number))
    canting = np.array([rng.permutation(number), rng.permutation(number)]) * (kind != "together") * 0.3 * MRAD
    made = []
    for _ in range(TRIALS):
        pixels = rng.standard_normal((2, grid.pixels[0].size)) * noise[grid.pixel_module]
        made.append(module_estimates(canting[:, grid.pixel_module] + pixels, grid, modules, use, 120.0))
    found = [np.std([[*one["pointing"], *one["canting"].ravel()] for one in made], axis=0)]
    told = [[*one["pointing_error"], *one["canting_error"].ravel()] for one in made]
    stated = np.sqrt(np.mean(np.square(told), axis=0))
    if number == 1:  # its pointing is all that is seen of it
        found, stated = [found[0][:2]], stated[:2]
    ratio = stated / np.array(found)
    np.testing.assert_allclose(ratio, 1.0, atol=0.15)  # four times the statistical error
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.15 if number < 3 else 0.08)

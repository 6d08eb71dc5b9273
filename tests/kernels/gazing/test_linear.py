"""Method A against its twin, its limits and the published figures; the bound on noise against trials."""

import numpy as np

from heliosweep.kernels.gazing.geometry import (
    EXACT,
    NONE,
    ROLL,
    eroded,
    image_set,
    module_spheres,
    themis_8,
    transfers,
)
from heliosweep.kernels.profiles import jose
from tests.kernels.gazing import twin

FLAT = np.zeros((8, 2))
MRAD = 1e-3


def reconstructed(layout, grid, images, profile=None):
    profile = profile or jose()
    return twin.by_kernels(images, layout, profile, grid.pixels, transfers(layout))


def table_errors(layout, grid, profile):
    """Mean slopes with the canting less those without, less the canting, in percent of 1 mrad: (T, module, axis)."""
    canting, keep = twin.paper_canting(), eroded(grid, 2)
    images = (image_set(layout, grid, profile, module_spheres(themis_8(), 120.0, c))[0] for c in (canting, FLAT))
    net = np.subtract(*(reconstructed(layout, grid, image, profile)[0] for image in images))
    rows = [np.nanmean(net[..., keep & (grid.pixel_module == row)], axis=-1) - canting[row] for row in (1, 2)]
    return 1e5 * np.stack(rows, axis=1)


def test_method_a_of_the_paper():
    """Clean 14.5/1.8 and 14.8/2.0 % without field rotation, as a trial found; the paper has 15.5/0.7 and 14.7/0.9."""
    errors = table_errors(twin.paper_scene(), twin.paper_grid(), jose())
    np.testing.assert_allclose(np.abs(errors[NONE]), [[14.5, 1.8], [14.8, 2.0]], atol=0.05)
    assert np.all(np.abs(errors[ROLL]) < 2.6)
    assert np.all(np.abs(errors[EXACT]) < 0.45)  # what its own approximation leaves

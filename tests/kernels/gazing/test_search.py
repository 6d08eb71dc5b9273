"""O1 and O2 take the steps of SciPy's simplex method, and have the errors that the paper's table tells."""

import numpy as np
import pytest
from scipy.optimize import minimize

from heliosweep.kernels.gazing.geometry import expose, image_set, module_spheres, themis_8
from heliosweep.kernels.gazing.slopes import (
    FATOL,
    NOT_CONVERGED,
    SIMPLEX,
    XATOL,
    fit_slopes,
    look_back,
    residual_squares,
)
from heliosweep.kernels.profiles import jose, noisy
from tests.kernels.gazing import twin

LAYOUT = twin.paper_scene()
PROFILES = {"jose": jose(), "noisy": noisy(jose(), 0.012)}


def pictures(grid, profile, canting=None):
    spheres = module_spheres(themis_8(), 120.0, twin.paper_canting() if canting is None else canting)
    return image_set(LAYOUT, grid, profile, spheres)


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("fit_gain", [False, True])
def test_steps_of_scipy(name, fit_gain):
    grid, profile = twin.paper_grid(0.2), PROFILES[name]
    images = expose(pictures(grid, profile)[0], noise=0.003, seed=3)
    some = np.arange(3, len(grid.pixels[0]), 97)
    images, place = images[:, some], np.array(grid.pixels)[:, some]
    start = np.full((2, len(some)), 1e-4)
    found = fit_slopes("O2", LAYOUT, profile, images, start, place, fit_gain=fit_gain)
    for k in range(len(some)):
        one, where = images[:, k : k + 1].copy(), place[:, k : k + 1].copy()

        def merit(p, one=one, where=where):
            return residual_squares(look_back(LAYOUT, profile, where, p.reshape(2, 1))[1], one, 0.3, fit_gain)[0]

        x, y = start[:, k]
        simplex = [[x, y], [x + SIMPLEX, y], [x, y + SIMPLEX]]
        options = {"initial_simplex": simplex, "xatol": XATOL, "fatol": FATOL}
        expected = minimize(merit, simplex[0], method="Nelder-Mead", options=options)
        assert tuple(found.slopes[:, k]) == tuple(expected.x)
        assert found.merit[k] == expected.fun
        assert found.evaluations[k] == expected.nfev > 30
        assert found.flags[k] == (0 if expected.success else NOT_CONVERGED)

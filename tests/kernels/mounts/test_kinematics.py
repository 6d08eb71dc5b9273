"""Normal of an aimed mirror off its pivot."""

import numpy as np
import pytest

from tests.kernels.mounts.normals import aim_normals
from tests.kernels.spots.deviations import iterated_normals, unit


@pytest.mark.parametrize("offset", [0.0, 0.5, 30.0, -30.0])
def test_iteration_of_the_paper(offset):
    """Its steps contract by r / (2 |P - T|) in the plane of incidence, but across it by r / (2 |P - T| cos theta)."""
    rng = np.random.default_rng(1)
    sun, d = unit(rng.normal(size=(2000, 3))), rng.normal(size=(2000, 3)) * 300.0
    sun[:, 2] = np.abs(sun[:, 2]) + 1e-3
    sun, d = unit(sun), d + 100.0 * unit(d)
    n = aim_normals(sun, d, offset)
    assert np.nanmax(np.abs(np.linalg.norm(n, axis=1) - 1.0)) < 1e-15
    cosine = np.sum(sun * n, axis=1)
    contracts = abs(offset) < 1.6 * cosine * np.linalg.norm(d - offset * n, axis=1)
    contracts &= (cosine > 0.05) & np.isfinite(cosine)
    assert contracts.sum() > 1000
    np.testing.assert_allclose(n[contracts], iterated_normals(sun[contracts], d[contracts], offset), atol=1e-12)

"""Ideal normal of a mirror off its pivot."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kernels.mounts.normals import aim_normals
from tests.kernels.spots.deviations import iterated_normals, unit


def directions(count, seed):
    """Sun and target directions of any angle to each other."""
    rng = np.random.default_rng(seed)
    return unit(rng.normal(size=(count, 3))), rng.normal(size=(count, 3)) * 300.0


@pytest.mark.parametrize("rho", [0.0, 1e-6, 1e-3, 0.1, 0.5, -0.3, -0.5])
def test_iteration_of_the_paper(rho):
    """Its steps contract by r / (2 |P - T|) in the plane of incidence, but across it by r / (2 |P - T| cos theta)."""
    sun, d = directions(2000, 1)
    offset = rho * np.linalg.norm(d, axis=1, keepdims=True)
    n = aim_normals(sun, d, offset[:, 0])
    assert np.max(np.abs(np.linalg.norm(n, axis=1) - 1.0)) < 4e-16
    cosine = np.sum(sun * n, axis=1)
    contracts = np.abs(offset[:, 0]) < 1.6 * cosine * np.linalg.norm(d - offset * n, axis=1)
    assert contracts.sum() > 1000
    expected = iterated_normals(sun[contracts], d[contracts], offset[contracts])
    np.testing.assert_allclose(n[contracts], expected, rtol=0, atol=3e-15 / cosine[contracts].min())


@given(st.floats(-0.999, 0.999), st.floats(0.0, 3.1))
def test_reflected_ray_passes_the_aim_point(rho, psi):
    sun, d = np.array([0.0, 0.0, 1.0]), np.array([np.sin(psi), 0.0, np.cos(psi)])
    n = aim_normals(sun, d, rho)
    to_target = d - rho * n
    ray = 2.0 * np.sum(sun * n) * n - sun
    assert np.linalg.norm(np.cross(ray, to_target)) < 1e-14
    assert np.sum(ray * to_target) > 0.0
    assert abs(n[1]) < 1e-15


def test_where_there_is_no_normal_or_it_is_plain():
    up, d = np.array([0.0, 0.0, 1.0]), np.array([0.0, 3.0, 4.0])
    np.testing.assert_allclose(aim_normals(up, up * 7.0, 2.0), up, rtol=0, atol=1e-16)
    np.testing.assert_allclose(aim_normals(up, d), unit(up + d / 5.0), rtol=0, atol=2e-16)
    assert np.isnan(aim_normals(up, d, [5.0, -5.0, 6.0, np.nan])).all()
    assert np.isnan(aim_normals(up, -up)).all()
    assert np.isnan(aim_normals(up, 0.0 * up)).all()
    assert np.isnan(aim_normals([np.nan, 0.0, 1.0], d)).all()
    assert np.isfinite(aim_normals(up, d, 4.999)).all()

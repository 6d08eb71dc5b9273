"""Mirror frames of the two tracking methods."""

import numpy as np
import pytest

from heliosweep.kernels.field.efficiency import aimed
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, FRAME_ROWS, SPINNING_ELEVATION, half_sides
from heliosweep.kernels.vectors import ROW
from tests.kernels.field.fields import scattered, suns
from tests.kernels.field.oracles import frame


def sides(mirrors, i, sun, tracking):
    """Half sides (a, b) for up to PACKET sun vectors."""
    rows, out = np.full((3, ROW), np.nan), np.full(FRAME_ROWS * ROW, np.nan)
    rows[:, : len(sun)] = sun.T
    half_sides(out, 0, rows.ravel(), mirrors, i, tracking, len(sun))
    rows = out[: 6 * ROW].reshape(2, 3, ROW)[:, :, : len(sun)]
    return np.swapaxes(rows[0], 0, 1), np.swapaxes(rows[1], 0, 1)


@pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])
def test_frames_reflect_the_sun_to_the_target(tracking):
    rng = np.random.default_rng(0)
    mirrors, sun = aimed(*scattered(rng, 10, 9.0)), suns(rng, 40)
    for i in range(10):
        a, b = sides(mirrors, i, sun, tracking)
        for k, s in enumerate(sun):
            u, v, n = frame(mirrors.aim[i], s, tracking)
            np.testing.assert_allclose(a[k], mirrors.half_width[i] * u, atol=1e-13)
            np.testing.assert_allclose(b[k], mirrors.half_height[i] * v, atol=1e-13)
            np.testing.assert_allclose(2.0 * (s @ n) * n - s, mirrors.aim[i], atol=1e-14)


def test_angles_of_chong_and_tan():
    """Azimuth-elevation: elevation and azimuth of the normal by equations of the paper, doi 10.1155/2012/908364."""
    rng = np.random.default_rng(1)
    mirrors, sun = aimed(*scattered(rng, 5, 9.0)), suns(rng, 10)
    for r, (i, s) in zip(np.repeat(mirrors.aim, 10, axis=0), [(i, s) for i in range(5) for s in sun], strict=True):
        a, b = sides(mirrors, i, s[None], AZIMUTH_ELEVATION)
        n = np.cross(a[0], b[0]) / np.linalg.norm(np.cross(a[0], b[0]))
        elevation, azimuth = np.arcsin(s[2]), np.arctan2(s[0], s[1])
        target_elevation, target_azimuth = np.arcsin(r[2]), np.arctan2(r[0], r[1])
        cosine = np.sqrt((1.0 + r @ s) / 2.0)
        assert abs(n[2] - (np.sin(elevation) + np.sin(target_elevation)) / (2.0 * cosine)) < 1e-13
        east = np.cos(elevation) * np.sin(azimuth) + np.cos(target_elevation) * np.sin(target_azimuth)
        north = np.cos(elevation) * np.cos(azimuth) + np.cos(target_elevation) * np.cos(target_azimuth)
        assert abs(np.arctan2(n[0], n[1]) - np.arctan2(east, north)) < 1e-12
        assert abs(a[0][2]) == 0.0


def test_degenerate_directions_have_a_fixed_frame():
    x, y, z, side = np.array([0.0, 30.0]), np.array([0.0, 40.0]), np.full(2, 5.0), np.full(2, 2.0)
    mirrors = aimed(x, y, z, side, side, 55.0)
    zenith = np.array([[0.0, 0.0, 1.0]])
    for tracking in (SPINNING_ELEVATION, AZIMUTH_ELEVATION):
        a, b = sides(mirrors, 0, zenith, tracking)
        np.testing.assert_allclose((a[0], b[0]), ((2.0, 0.0, 0.0), (0.0, 2.0, 0.0)), atol=1e-15)
    r = mirrors.aim[1]
    a, _ = sides(mirrors, 1, r[None], SPINNING_ELEVATION)
    np.testing.assert_allclose(a[0], 2.0 * np.array([-r[1], r[0], 0.0]) / np.hypot(r[0], r[1]), atol=1e-14)
    a, b = sides(mirrors, 1, -r[None], SPINNING_ELEVATION)
    assert not a.any()
    assert not b.any()

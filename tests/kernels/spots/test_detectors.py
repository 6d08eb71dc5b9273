"""Detector lines: crossings of deviation curves, and the mirror from them."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from heliosweep.kernels.spots.curves import deviation_curves
from heliosweep.kernels.spots.deviation import AZIMUTH, CANTING, ELEVATION, ENCODER
from heliosweep.kernels.spots.receiver import REACHES, face_axes
from heliosweep.kernels.sun.clock import solar_clock
from tests.kernels.mounts.normals import aim_normals
from tests.kernels.spots.deviations import LATITUDE, setting, turned, unit
from tests.kernels.spots.test_deviation import ALL, MORNING, PIVOT, field
from tests.kernels.spots.test_tolerances import spots_at

LINES = np.array([[1.0, 0.0, 6.0], [0.0, 1.0, -6.0], [0.6, -0.8, 3.0], [-2.0, 1.0, 15.0], [0.0, 1.0, 150.0], [1, 1, 0]])


def crossings(settings, source, axis, lines, sun, pivots):
    return deviation_curves(settings, source, axis, sun, pivots, lines).crossing


def detector_inversion(sun, centre, face, elevation_point, azimuth_point):
    """Azimuth and elevation of a mirror (vertical primary axis, centre fixed) from a point of each of its two curves.

    With the vectors v from the mirror centre to the points, k = S + v / |v| is along the normal that sent the ray
    there. About the elevation axis this normal keeps the mirror's azimuth; about the azimuth axis its angle to
    h = (sin az, cos az, 0) and z keeps the ratio of the mirror's own.
    """

    def bisector(point):
        v = point[..., :1] * face[1] + point[..., 1:] * face[2] - centre
        return sun + v / np.linalg.norm(v, axis=-1, keepdims=True)

    east, north, _ = np.moveaxis(bisector(np.asarray(elevation_point)), -1, 0)
    azimuth = np.arctan2(east, north)
    east, north, up = np.moveaxis(bisector(np.asarray(azimuth_point)), -1, 0)
    return azimuth, np.arctan2(up, east * np.sin(azimuth) + north * np.cos(azimuth))


@pytest.mark.parametrize(("source", "axis", "kind"), ALL)
def test_crossings_lie_on_line_and_curve_and_are_the_first(source, axis, kind):
    pivots, sun = field(np.random.default_rng(kind + 1), 2)
    for offset, pedestal in ((0.0, 0.0), (0.5, 6.0)):
        settings = setting(kind=kind, mirror_offset=offset, pedestal_height=pedestal, face_tilt=-0.2)
        y, z, error = crossings(settings, [source], [axis], LINES, sun, pivots)[:, 0]
        assert np.isfinite(error).any()
        for h, t, i in np.ndindex(error.shape):
            place = sun[:, t : t + 1], pivots[:, h : h + 1]
            first = np.pi if np.isnan(error[h, t, i]) else abs(error[h, t, i])
            if first < np.pi:
                spot = spots_at(settings, source, axis, error[h, t, i : i + 1], *place)[:, 0]
                np.testing.assert_array_equal(spot[:2], [y[h, t, i], z[h, t, i]])
                far = 1.0 + (np.hypot(*spot[:2]) / 100.0) ** 2
                assert abs(LINES[i] @ [spot[0], spot[1], -1.0]) < 1e-10 * far
            for side in (1.0, -1.0):
                scanned = spots_at(settings, source, axis, side * np.linspace(0.0, 0.9999 * first, 2001), *place)
                real = scanned[2] == REACHES
                beyond = LINES[i] @ np.stack([scanned[0], scanned[1], -np.ones(2001)])
                steps = real[1:] & real[:-1] & (np.abs(beyond[1:]) < 1e3) & (np.abs(beyond[:-1]) < 1e3)
                assert not np.any(steps & (beyond[1:] * beyond[:-1] < 0.0))
            if LINES[i, 2] == 0.0:
                assert error[h, t, i] == 0.0


def test_line_that_is_never_crossed():
    far = crossings(setting(), [CANTING], [ELEVATION], [[0.0, 1.0, -1e9]], MORNING, PIVOT)
    assert abs(far[2, 0, 0, 0, 0]) > 0.1  # only all but along the plane
    assert abs(far[1, 0, 0, 0, 0] / -1e9 - 1.0) < 1e-3
    west = crossings(setting(), [CANTING], [ELEVATION], [[1.0, 0.0, 1.0]], [[[0.0, -0.6, 0.8]]], [[[0.0, 99.0, 0.0]]])
    assert np.isnan(west).all()  # the curve stays in the meridian
    shadow = crossings(setting(), [CANTING], [ELEVATION], LINES, -MORNING, PIVOT)
    assert np.isnan(shadow).all()


def test_lines_must_have_a_direction():
    for lines in ([[0.0, 0.0, 1.0]], [1.0, 0.0, 1.0], [[1.0, 0.0]]):
        with pytest.raises(ValueError, match="lines"):
            crossings(setting(), [0], [0], lines, MORNING, PIVOT)


def misaligned(sun, pivot, errors, sizes, face=(0.0, 0.0)):
    """A mirror with these errors of azimuth and elevation, and a point of each of its curves: word by word."""
    target = np.array([0.0, 0.0, 143.0])
    n = aim_normals(sun, target - pivot)
    azimuth = np.arctan2(n[0], n[1]) + errors[0]
    elevation = np.arctan2(n[2], np.hypot(n[0], n[1])) + errors[1]
    h = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    n = np.cos(elevation) * h + np.sin(elevation) * np.array([0.0, 0.0, 1.0])
    e = unit(np.cross(n, [0.0, 0.0, 1.0]))
    axes, points = face_axes(*face), []
    for axis, size in zip((e, np.cross(n, e)), sizes, strict=True):
        normal = turned(n, size * axis)
        ray = 2.0 * np.sum(sun * normal) * normal - sun
        place = pivot - target
        length = -np.sum(place * axes[0]) / np.sum(ray * axes[0])
        place = place + (length if length > 0.0 < np.sum(sun * normal) else np.nan) * ray
        points.append([np.sum(axes[1] * place), np.sum(axes[2] * place)])
    return axes, points, azimuth, elevation


@pytest.mark.parametrize("hour", [8.0, 10.0, 12.0, 15.0])
@pytest.mark.parametrize("east", [-16.0, 60.0, -120.0])
def test_inversion_recovers_planted_errors(hour, east):
    """To 1e-12 mrad: the rounding of an angle of one radian, a few times."""
    sun, pivot = solar_clock(LATITUDE, np.radians(23.45), np.array([hour]))[0], np.array([east, 150.0, 0.0])
    for planted in ((0.0, 0.0), (12e-3, -5e-3), (-0.1, 0.03), (1e-4, 0.2)):
        axes, points, azimuth, elevation = misaligned(sun, pivot, planted, (0.02, -0.03))
        found = detector_inversion(sun, pivot - [0.0, 0.0, 143.0], axes, *points)
        assert 1e3 * abs(found[0] - azimuth) < 1e-12
        assert 1e3 * abs(found[1] - elevation) < 1e-12


@given(
    st.tuples(st.floats(-300, 300), st.floats(60, 400), st.floats(0, 9)),
    st.tuples(st.floats(-2.5, 2.5), st.floats(0.1, 1.4)),
    st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
    st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
)
def test_inversion_anywhere(place, above, planted, along):
    s = np.array([np.cos(above[1]) * np.sin(np.pi + above[0]), np.cos(above[1]) * np.cos(np.pi + above[0]), 0.0])
    s[2] = np.sin(above[1])
    pivot = np.array(place)
    axes, points, azimuth, elevation = misaligned(s, pivot, planted, along, face=(0.1, -0.2))
    assume(np.max(np.abs(points)) < 1e3 and 0.2 < elevation < 1.4)  # else a ray that misses, or far out
    found = detector_inversion(s, pivot - [0.0, 0.0, 143.0], axes, *points)
    assert abs(np.angle(np.exp(1j * (found[0] - azimuth)))) < 1e-13
    assert abs(found[1] - elevation) < 1e-13


def test_inversion_of_crossings():
    """The crossings that the kernel finds for an aligned mirror say that it is aligned."""
    pivots, sun = field(np.random.default_rng(9), 6)
    settings = setting()
    target = np.array([0.0, 0.0, 143.0])
    both = [crossings(settings, [CANTING], [axis], LINES[:4], sun, pivots)[:2, 0] for axis in (ELEVATION, AZIMUTH)]
    n = aim_normals(sun[0], target - pivots[0][:, np.newaxis])
    for i, j in np.ndindex(4, 4):
        points = np.moveaxis(both[0][..., i], 0, -1), np.moveaxis(both[1][..., j], 0, -1)
        azimuth, elevation = detector_inversion(sun[0], pivots[0][:, np.newaxis] - target, face_axes(0.0, 0.0), *points)
        found = np.isfinite(azimuth) & np.isfinite(elevation)
        back = np.stack([np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)])
        normal_errors = np.abs(np.moveaxis(back, 0, -1) - n).max(axis=-1)
        near = found & (np.abs(points[0]).max(axis=-1) < 500.0) & (np.abs(points[1]).max(axis=-1) < 500.0)
        assert near.sum() > 10
        assert np.max(normal_errors[near]) < 1e-12


def test_encoder_without_offset_draws_the_same_curve():
    pivots, sun = field(np.random.default_rng(10), 5)
    one, other = (crossings(setting(), [source], [1], LINES, sun, pivots) for source in (CANTING, ENCODER))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("axis", [ELEVATION, AZIMUTH])
def test_march_and_closed_form_agree(axis):
    """Far lines too, which virtual rays cross before real ones do, and crossings beyond a quarter turn."""
    rng = np.random.default_rng(12)
    pivots, sun = field(rng, 12)
    angles, far = rng.uniform(-np.pi, np.pi, 60), 10.0 ** rng.uniform(0.0, 3.5, 60)
    lines = np.stack([np.cos(angles), np.sin(angles), far], axis=1)
    closed = crossings(setting(), [ENCODER], [axis], lines, sun, pivots)
    marched = crossings(setting(mirror_offset=1e-16), [ENCODER], [axis], lines, sun, pivots)
    known = np.isfinite(closed[2])
    np.testing.assert_array_equal(np.isfinite(marched[2]), known)
    assert np.max(np.abs(marched[2] - closed[2])[known]) < 1e-12
    assert 0.7 < known.mean() < 0.95
    assert np.abs(closed[2][known]).max() > 0.51 * np.pi

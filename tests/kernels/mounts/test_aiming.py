"""Two-axis mounts: frames, forward, inverse, aiming and the Jacobian of the spot."""

import numpy as np
import pytest

from heliosweep.kernels.calibration import predict
from heliosweep.kernels.mounts import (
    AZIMUTH_ELEVATION,
    POLAR,
    TARGET_ALIGNED,
    TILT_ROLL,
    aim,
    face_axes,
    mount_frames,
)
from tests.kernels.mounts.normals import aim_normals, normal_and_centre

KINDS = [AZIMUTH_ELEVATION, TARGET_ALIGNED, POLAR, TILT_ROLL]
OFFSETS = [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.2, 4.0), (-0.3, -0.4, 6.0)]


def scene(kind, count, seed=0, spread=5e-3):
    """Frames, sun vectors, vectors to the target and errors of a field in the north."""
    rng = np.random.default_rng(seed)
    to_target = np.stack((rng.uniform(-200, 200, count), -rng.uniform(60, 400, count), rng.uniform(60, 150, count)), 1)
    sun = rng.normal(size=(count, 3)) + np.array([0.0, -1.0, 0.0])
    sun[:, 2] = np.abs(sun[:, 2]) + 0.1
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    return mount_frames(kind, 0.65, 0.3, to_target), sun, to_target, rng.normal(0.0, spread, (count, 6))


def miss(sun, to_target, normal, centre):
    """Distance at which rays from the mirror centre pass the aim point. [m]"""
    ray = 2.0 * np.sum(sun * normal, axis=-1, keepdims=True) * normal - sun
    return np.linalg.norm(np.cross(to_target - centre, ray), axis=-1)


def angles_to(frames, normals, errors):
    """Encoder angles at which mounts point along normals: those that send the sun back where it comes from."""
    return aim(frames, normals, 100.0 * normals, errors)


@pytest.mark.parametrize("kind", KINDS)
def test_inverse_of_forward(kind):
    frames, _, _, errors = scene(kind, 800)
    angles = np.random.default_rng(1).uniform([-np.pi, -1.2], [np.pi, 1.2], (800, 2))
    normal, _ = normal_and_centre(frames, angles, errors)
    up = normal[:, 2] > 1e-3  # the sun must stand above the horizon
    turns = (angles_to(frames, normal, errors) - angles + np.pi) % (2.0 * np.pi) - np.pi
    assert up.sum() > 200
    np.testing.assert_allclose(turns[up], 0.0, atol=1e-14)


@pytest.mark.parametrize("offsets", OFFSETS)
@pytest.mark.parametrize("kind", KINDS)
def test_aiming_brings_the_beam_to_the_aim_point(kind, offsets):
    frames, sun, to_target, errors = scene(kind, 500)
    angles = aim(frames, sun, to_target, errors, offsets)
    assert np.isfinite(angles).all()
    assert np.all(np.cos(angles[:, 1] + errors[:, 1]) >= 0.0)
    normal, centre = normal_and_centre(frames, angles, errors, offsets)
    assert np.max(miss(sun, to_target, normal, centre)) < 2e-12
    if offsets[1:] == (0.0, 0.0):
        perfect, _ = normal_and_centre(frames, aim(frames, sun, to_target, np.zeros(6), offsets), np.zeros(6))
        np.testing.assert_allclose(perfect, aim_normals(sun, to_target, offsets[0]), atol=1e-14)


def evaluated(frame, angles, errors, offsets, sun, to_target, face):
    """Spots of one mount: y and z, shape (2, S), and derivatives (2, 6, S)."""
    seen = np.column_stack((sun, np.cos(angles), np.sin(angles), np.zeros((len(angles), 2))))
    rows = np.empty((1, len(angles), 2, 7))
    predict(frame[None], to_target[None], face, offsets, errors[None], seen[None], rows, np.empty((1, len(angles))))
    return rows[0, :, :, 6].T, np.moveaxis(rows[0, :, :, :6], 0, -1)


def complex_spot(frame, angles, errors, offsets, sun, to_target, face):
    """Spot for complex errors."""

    def about(axis, angle):
        cosine, sine = np.cos(angle), np.sin(angle)
        across = np.cross(np.eye(3), axis)
        return np.eye(3) + sine * across + (1.0 - cosine) * (across @ across)

    g0, a0, east, north, eta, mu = errors
    r, q, h = offsets
    length = np.sqrt(east**2 + north**2)
    axis = np.array([east, north, 0.0 * east]) / length
    k = np.array([[0, 0, axis[1]], [0, 0, -axis[0]], [-axis[1], axis[0], 0]])
    tilt = np.eye(3) + np.sin(length) * k + (1.0 - np.cos(length)) * (k @ k)
    primary = about([0.0, 0.0, -1.0], angles[0] + g0)
    secondary = about([0.0, 1.0, 0.0], eta) @ about([1.0, 0.0, 0.0], angles[1] + a0)
    normal = frame.T @ tilt @ primary @ secondary @ np.array([np.sin(mu), np.cos(mu), 0.0 * mu])
    arm = primary @ (np.array([0.0, q, 0.0]) + secondary @ np.array([0.0, r, 0.0]))
    base = h * frame[:, 2]  # straight down, in the frame of the mount
    centre = frame.T @ (tilt @ (base + arm) - base) - to_target
    ray = 2.0 * (sun @ normal) * normal - sun
    point = centre - (face[0] @ centre) / (face[0] @ ray) * ray
    return face[1:] @ point


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_against_complex_steps(kind):
    frames, sun, to_target, errors = scene(kind, 60)
    offsets, face = np.array([0.5, 0.3, 4.0]), face_axes(0.2, -0.3)
    angles, seen = aim(frames, sun, to_target, np.zeros(6), (0.5, 0.3, 4.0)), 0
    for i in range(60):
        here = (frames[i], angles[i], errors[i], offsets, sun[i], to_target[i])
        spots, jacobian = evaluated(
            frames[i], angles[i : i + 1], errors[i], offsets, sun[i : i + 1], to_target[i], face
        )
        y, z = spots[:, 0]
        if np.isnan(y):
            continue
        seen += 1
        steps = errors[i] + 1e-30j * np.eye(6)
        spots = np.array([complex_spot(*here[:2], step, *here[3:], face) for step in steps])
        np.testing.assert_allclose((y, z), spots[0].real, atol=1e-11)
        exact = spots.imag.T / 1e-30
        np.testing.assert_allclose(jacobian[:, :, 0], exact, atol=1e-12 * np.max(np.abs(exact)), rtol=0)
    assert seen > 40

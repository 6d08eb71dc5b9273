"""Fixed errors of mounts by whole rotation matrices, with rays that are traced one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ndtri
from scipy.stats import qmc

from heliosweep.kernels import sunshapes
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.intercept.efficiency import Scene, intercepts
from heliosweep.kernels.intercept.mirror import Facets
from heliosweep.kernels.intercept.receivers import rectangle
from tests.kernels.intercept.test_intercept import direction, scene

CENTRE, AIM = np.array([120.0, 260.0, 4.0]), np.array([0.0, 0.0, 110.0])
RECEIVER, SUN, CURVE = rectangle((0.0, 0.0, 110.0), 0.4, -0.2, 3.5, 4.0), direction(230.0, 35.0)[0], 0.5 / 310.0
SPECULARITY = 0.4e-3


def axes(tracking: int) -> np.ndarray:
    """Rows u, v and n of the ideal mirror."""
    t = (AIM - CENTRE) / np.linalg.norm(AIM - CENTRE)
    n = (SUN + t) / np.linalg.norm(SUN + t)
    u = np.cross(t, SUN) if tracking == SPINNING_ELEVATION else np.array([-n[1], n[0], 0.0])
    u /= np.linalg.norm(u)
    return np.stack((u, np.cross(n, u), n))


def stood(tracking: int, errors: Any) -> np.ndarray:
    """Rows u, v and n of the mirror of a mount with errors, at the angles of one without, by misalignment's README."""
    u, v, n = axes(tracking)
    z = np.array([0.0, 0.0, 1.0])
    if tracking == SPINNING_ELEVATION:
        z = (AIM - CENTRE) / np.linalg.norm(AIM - CENTRE)
    x = np.array([1.0, 0.0, 0.0]) if tracking == AZIMUTH_ELEVATION else np.cross((0.0, 0.0, 1.0), z)
    frame = np.stack((x / np.linalg.norm(x), np.cross(z, x) / np.linalg.norm(x), z))
    level = frame @ n
    g, a = np.arctan2(level[0], level[1]), np.arcsin(level[2])

    def posture(g0=0.0, a0=0.0, te=0.0, tn=0.0, eta=0.0, mu=0.0):
        angles = ("z", -(g + g0)), ("y", eta), ("x", a + a0), ("z", -mu)
        turns = [Rotation.from_rotvec([te, tn, 0.0]), *(Rotation.from_euler(*each) for each in angles)]
        return np.linalg.multi_dot([frame.T, *(turn.as_matrix() for turn in turns)])

    body = posture().T @ np.stack((u, v, n)).T  # of the mirror in the last frame: its normal is y
    np.testing.assert_allclose(body[:, 2], [0.0, 1.0, 0.0], atol=1e-12)
    return (posture(*errors) @ body).T


def traced(tracking: int, frame: np.ndarray, lean: Any, curve: float = CURVE) -> float:
    """Part of rays from a Sobol sequence that meets the receiver, of a mirror with these axes and leaning normals."""
    u = qmc.Sobol(6, seed=1).random(2**18)
    a, b = 10.0 * (u[:, 0] - 0.5), 8.0 * (u[:, 1] - 0.5)
    more = lean(a, b)
    normal = frame[2] - np.outer(curve * a - more[0], frame[0]) - np.outer(curve * b - more[1], frame[1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    ray = 2.0 * (normal @ SUN)[:, None] * normal - SUN
    e1 = np.cross(ray, (0.0, 0.0, 1.0))
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    r, psi = 4.65e-3 * np.sqrt(u[:, 2]), 2 * np.pi * u[:, 3]
    x, y = r * np.cos(psi) + SPECULARITY * ndtri(u[:, 4]), r * np.sin(psi) + SPECULARITY * ndtri(u[:, 5])
    ray = ray + x[:, None] * e1 + y[:, None] * np.cross(ray, e1)
    start = CENTRE + np.outer(a, frame[0]) + np.outer(b, frame[1]) + np.outer(0.5 * curve * (a**2 + b**2), frame[2])
    across, upward = np.array(RECEIVER.across), np.array(RECEIVER.upward)
    face, d = np.cross(across, upward), start - RECEIVER.centre
    hit = d - (d @ face / (ray @ face))[:, None] * ray
    return float(np.mean((np.abs(hit @ across) < 1.75) & (np.abs(hit @ upward) < 2.0)))


def made(tracking: int, **more: Any) -> Scene:
    base = scene(
        RECEIVER, sunshapes.pillbox(), CENTRE, AIM, (0.0, 0.0, SPECULARITY), curve=more.pop("curve", CURVE),
        facets=more.pop("facets", Facets(1, 1, 0.0)), tracking=tracking,
    )  # fmt: skip
    return base._replace(**more)


@pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])
@pytest.mark.parametrize(
    "errors", [(3e-3, 0, 0, 0, 0, 0), (0, 2e-3, 0, 0, 0, 0), (1e-3, -2e-3, 2e-3, -3e-3, 2e-3, 2e-3)]
)
def test_errors_of_the_mount(tracking, errors):
    wanted = traced(tracking, stood(tracking, errors), lambda a, b: (0 * a, 0 * b))
    found = intercepts(made(tracking, mounts=np.array([errors])), SUN[None])[0, 0]
    ideal = intercepts(made(tracking), SUN[None])[0, 0]
    assert abs(ideal - wanted) > 3e-3
    assert found == pytest.approx(wanted, abs=6e-4)
    n, frame = stood(tracking, errors)[2], axes(tracking)
    turn = frame[:2] @ n / (frame[2] @ n)
    assert found == pytest.approx(intercepts(made(tracking, turn=turn[None]), SUN[None])[0, 0], abs=1e-9)

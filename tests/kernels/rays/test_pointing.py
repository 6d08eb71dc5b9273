"""Fixed errors of mounts by whole rotation matrices."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heliosweep.kernels import rays
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.mounts import pointing_turns
from tests.kernels.rays.scenes import direction, scene

CENTRE, AIM, SUN = np.array([120.0, 260.0, 4.0]), np.array([0.0, 0.0, 110.0]), direction(230.0, 35.0)[0]


def axes(tracking: int) -> np.ndarray:
    """Rows u, v and n of the ideal mirror."""
    t = (AIM - CENTRE) / np.linalg.norm(AIM - CENTRE)
    n = (SUN + t) / np.linalg.norm(SUN + t)
    u = np.cross(t, SUN) if tracking == SPINNING_ELEVATION else np.array([-n[1], n[0], 0.0])
    u /= np.linalg.norm(u)
    return np.stack((u, np.cross(n, u), n))


def normal(tracking: int, errors: Any) -> np.ndarray:
    """Normal of the mirror of a mount with errors, at the angles of one without, by misalignment's README."""
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
    return (posture(*errors) @ body).T[2]


@pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])
@pytest.mark.parametrize(
    "errors", [(3e-3, 0, 0, 0, 0, 0), (0, 2e-3, 0, 0, 0, 0), (1e-3, -2e-3, 2e-3, -3e-3, 2e-3, 2e-3)]
)
def test_errors_of_the_mount(tracking, errors):
    n, frame = normal(tracking, errors), axes(tracking)
    wanted = frame[:2] @ n / (frame[2] @ n)
    mounts = np.array([errors, errors])
    suns = np.stack((SUN, [0.0, 1.0, -0.1], SUN))
    found = pointing_turns(np.stack((CENTRE, CENTRE)), np.stack((AIM, AIM)), mounts, tracking, suns, 0, 1)
    assert found[1, 0] == pytest.approx(wanted, abs=1e-13)
    assert not found[1, 1].any()
    part = pointing_turns(np.stack((CENTRE, CENTRE)), np.stack((AIM, AIM)), mounts, tracking, suns, 3, 2)
    np.testing.assert_array_equal(part[1, [0, 2]], found[1, [0, 2]])  # mirror 1 at instants 3 and 5
    assert not pointing_turns(CENTRE[np.newaxis], AIM[np.newaxis], mounts[:1], tracking, suns[:1], 1, 2).any()
    made = scene(
        rays.rectangle(tuple(AIM), 0.4, -0.2, 3.5, 4.0), place=CENTRE, curve=0.5 / 310.0, tracking=tracking,
        mounts=mounts[:1],
    )  # fmt: skip
    turned = made._replace(mounts=np.empty((0, 6)), turn=wanted[np.newaxis])
    a, b = (rays.trace(each, suns, first=2, rays=1024).sums[..., rays.HIT] for each in (made, turned))
    assert a == pytest.approx(b, abs=1.01 / 128)
    ideal = rays.trace(turned._replace(turn=np.zeros((1, 2))), suns, first=2, rays=1024).sums[..., rays.HIT]
    assert abs(ideal.mean() - a.mean()) > 0.01

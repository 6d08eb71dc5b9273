"""Traces of a mirror's cylinders on detectors: against rays turned one by one, and back to the errors."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from heliosweep.kernels import traces
from heliosweep.kernels.mounts import Mounts, face_vectors, mount_frames
from heliosweep.kernels.sun import solar_clock

KINDS = range(4)
FACE = np.array(face_vectors(0.1, -0.2))
SUN = solar_clock(np.radians(37.4), np.radians(10.0), np.linspace(8.0, 16.0, 9))
#: Corners of a line of three pieces about the aim point, y and z. [m]
CORNERS = np.array([[-9.0, -8.0], [9.0, -9.0], [8.0, 9.0], [-9.0, 8.5]])
OFFSETS = [(0.0, 0.0, 0.0), (0.5, 0.3, 4.0)]


def pieces():
    corners = CORNERS[:, :1] * FACE[1] + CORNERS[:, 1:] * FACE[2]
    ways = np.diff(corners, axis=0)
    lengths = np.linalg.norm(ways, axis=1)
    return corners[:-1], ways / lengths[:, None], np.stack([np.zeros(3), lengths], axis=1)


def scene(kind, offsets, count=12, spread=2e-3, seed=0):
    """Frames, ways to the aim point, errors, and angles for mounts that know of none, shape (H, T, 2)."""
    rng = np.random.default_rng(seed)
    pivots = np.stack((rng.uniform(-200, 200, count), rng.uniform(80, 400, count), rng.uniform(3, 8, count)), axis=1)
    to_target = np.array([0.0, 0.0, 143.0]) - pivots
    frames = mount_frames(kind, 0.65, 0.3, to_target)
    angles = Mounts(frames, to_target, FACE, np.array(offsets)).aim(SUN)
    return frames, to_target, rng.normal(0.0, spread, (count, 6)), angles


def stood(frames, to_target, errors, angles, offsets):
    return Mounts(frames, to_target, FACE, np.array(offsets)).stand(angles, errors[:, None])


def rays_one_by_one(normal, centre, axis, sun, start, along, length):
    """Places where rays cross a piece, and angles of the mirror: scanned over half a turn, then by root finding."""

    def spot(angle):
        n = Rotation.from_rotvec(np.multiply.outer(np.atleast_1d(angle), axis)).apply(normal)
        ray = Rotation.from_rotvec(np.pi * n).apply(sun)  # half a turn about the normal
        towards = -(ray @ FACE[0])
        length = np.where((n @ sun > 0) & (towards > 1e-3), (centre @ FACE[0]) / towards, np.nan)
        return centre + length[:, None] * ray - start

    across = np.cross(FACE[0], along)
    angles = np.linspace(-0.4999 * np.pi, 0.4999 * np.pi, 4001)
    off = spot(angles) @ across
    found = []
    for i in np.flatnonzero(off[1:] * off[:-1] < 0):
        root = brentq(lambda angle: (spot(angle) @ across)[0], angles[i], angles[i + 1], xtol=1e-15, rtol=1e-15)
        place = float((spot(root) @ along)[0])
        if 0 <= place <= length:
            found.append((place, root))
    return sorted(found)


@pytest.mark.parametrize("offsets", OFFSETS)
@pytest.mark.parametrize("kind", KINDS)
def test_all_crossings_are_those_of_rays_one_by_one(kind, offsets):
    frames, to_target, errors, angles = scene(kind, offsets, 4, spread=5e-3)
    mirror = stood(frames, to_target, errors, angles, offsets)
    starts, along, ends = pieces()
    place, turned = traces.crossings(mirror, SUN, starts, along, ends)
    seen = 0
    for h, t, trace, piece in np.ndindex(place.shape[:-1]):
        n, centre, right = mirror.normal[h, t], mirror.centre[h, t], mirror.right[h, t]
        # Elevation turns about e = right; azimuth about -b, clockwise from above.
        axis = (right, -np.cross(right, n))[trace]
        expected = rays_one_by_one(n, centre, axis, SUN[t], starts[piece], along[piece], ends[piece, 1])
        known = np.isfinite(place[h, t, trace, piece])
        assert known.sum() == len(expected)
        if expected:
            np.testing.assert_allclose(place[h, t, trace, piece][known], [e[0] for e in expected], atol=1e-11, rtol=0)
            np.testing.assert_allclose(turned[h, t, trace, piece][known], [e[1] for e in expected], atol=1e-13, rtol=0)
            seen += len(expected)
    assert seen > 60

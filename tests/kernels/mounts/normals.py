"""Normals of mirrors: ideal ones by the kernel, and those of mounts with errors by SciPy's rotations."""

import numpy as np
from scipy.spatial.transform import Rotation


def normal_and_centre(frame, angles, errors, offsets=(0.0, 0.0, 0.0)):
    """Normal and mirror centre of mounts at encoder angles, by the chain of rotations; arguments broadcast."""
    frame, angles, errors = np.asarray(frame, float), np.asarray(angles, float), np.asarray(errors, float)
    shape = np.broadcast_shapes(frame.shape[:-2], angles.shape[:-1], errors.shape[:-1])
    frames = np.broadcast_to(frame, (*shape, 3, 3)).reshape(-1, 3, 3)
    g, a = np.broadcast_to(angles, (*shape, 2)).reshape(-1, 2).T
    g0, a0, east, north, eta, mu = np.broadcast_to(errors, (*shape, 6)).reshape(-1, 6).T
    known, none, (r, q, h) = np.isfinite(g + a), np.zeros(len(g)), offsets

    def about(*vector):
        return Rotation.from_rotvec(np.stack(np.broadcast_arrays(*vector), axis=1))

    tilt, primary = about(east, north, none), about(none, none, np.where(known, -(g + g0), 0.0))
    secondary = about(none, eta, none) * about(np.where(known, a + a0, 0.0), none, none)
    normal = (tilt * primary * secondary).apply(np.stack((np.sin(mu), np.cos(mu), none), axis=1))
    arm = primary.apply(np.array([0.0, q, 0.0]) + secondary.apply([0.0, r, 0.0]))
    base = h * frames[:, :, 2]  # straight down, in the frame of the mount
    centre = tilt.apply(base + arm) - base
    world = (np.where(known[:, np.newaxis], np.einsum("nij,ni->nj", frames, v), np.nan) for v in (normal, centre))
    return tuple(v.reshape(*shape, 3) for v in world)

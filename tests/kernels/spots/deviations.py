"""The specification of the deviation kernels, written another way: SciPy's rotations, fixed points, linear systems."""

import numpy as np
from scipy.spatial.transform import Rotation

from heliosweep.kernels.mounts.kinematics import AZIMUTH_ELEVATION, POLAR, TARGET_ALIGNED
from heliosweep.kernels.spots.curves import AZIMUTH, CANTING, ELEVATION, TILT, deviation_curves
from heliosweep.kernels.spots.receiver import BEHIND_FACE, MISSES, NO_SUN, REACHES, TOO_NEAR, Setting

LATITUDE = np.radians(37.4)


def setting(points=1, **values):
    """A setting after Figure 4 of the paper, with what is given in place of it."""
    usual = {"half_width": 4.5, "half_height": 4.5, "target_height": 143.0, "latitude": LATITUDE}
    return Setting(
        *(
            np.full(points, values.get(name, usual.get(name, 0)), np.int64 if name == "kind" else np.float64)
            for name in Setting._fields
        )
    )


def deviation_spots(settings, source, axis, size, sun, pivots):
    """Spots (3, P, H, T) of one error at each point."""
    sizes = np.reshape(size, (-1, 1))
    return deviation_curves(settings, source, axis, sun, pivots, sizes=sizes).spots[..., 0]


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def iterated_normals(sun, to_target, offset):
    """Eqs. 16 and 17 of the paper, to the end."""
    n = unit(sun + unit(to_target))
    for _ in range(200):
        n = unit(sun + unit(to_target - offset * n))
    return n


def turned(vectors, rotation_vectors):
    both = [array.copy() for array in np.broadcast_arrays(vectors, rotation_vectors)]
    rotation = Rotation.from_rotvec(both[1].reshape(-1, 3))
    return rotation.apply(both[0].reshape(-1, 3)).reshape(both[0].shape)


def primary_axes(kind, latitude, axis_azimuth, to_target):
    if kind == AZIMUTH_ELEVATION:
        return np.broadcast_to([0.0, 0.0, 1.0], to_target.shape)
    if kind == TARGET_ALIGNED:
        return unit(to_target)
    if kind == POLAR:
        north_pole = Rotation.from_euler("x", latitude).apply([0.0, 1.0, 0.0])
        return np.broadcast_to(north_pole, to_target.shape)
    return np.broadcast_to(Rotation.from_euler("z", -axis_azimuth).apply([0.0, 1.0, 0.0]), to_target.shape)


def axes_and_mirror(values, axis, sun, to_target):
    """Ideal normal and the axis of the error; `values` one row of a setting."""
    n = iterated_normals(sun, to_target, values.mirror_offset)
    z = primary_axes(values.kind, values.latitude, values.axis_azimuth, to_target)
    e = unit(np.cross(n, z))
    return n, {ELEVATION: e, AZIMUTH: -np.cross(e, n)}.get(axis, -z)


def world_face(azimuth, tilt):
    """Rows X, Y, Z of a face, from those of one that looks north."""
    turn = Rotation.from_euler("z", -azimuth) * Rotation.from_euler("x", tilt)
    return turn.apply([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def twin_spots(settings, source, axis, size, sun, pivots):
    """`deviation_spots`, arguments likewise."""
    spots = np.empty((3, len(size), pivots.shape[1], sun.shape[1]))
    for p in range(len(size)):
        values = Setting(*(column[p] for column in settings))
        s = sun[p % len(sun)][np.newaxis, :, :]
        pivot = pivots[p % len(pivots)][:, np.newaxis, :]
        target = np.array([0.0, 0.0, values.target_height])
        s, pivot = np.broadcast_arrays(s, pivot)
        n, a = axes_and_mirror(values, axis[p], s, target - pivot)
        turned_n = turned(n, a * size[p])
        if source[p] == CANTING:
            centre = pivot + values.mirror_offset * n
        else:
            centre = pivot + values.mirror_offset * turned_n
        if source[p] == TILT:
            base = np.array([0.0, 0.0, values.pedestal_height])
            centre = centre + turned(base, a * size[p]) - base
        ray = turned(s, turned_n * np.pi)  # half a turn about the normal
        face = world_face(values.face_azimuth, values.face_tilt)
        # centre + l ray = target + y Y + z Z
        system = np.stack([-ray, np.broadcast_to(face[1], ray.shape), np.broadcast_to(face[2], ray.shape)], axis=-1)
        length, y, z = np.moveaxis(np.linalg.solve(system, (centre - target)[..., np.newaxis])[..., 0], -1, 0)
        status = np.where((length > 0.0) & (np.sum(s * turned_n, axis=-1) > 0.0), REACHES, MISSES)
        behind = ((centre - target) @ face[0] <= 0.0) | ((pivot - target) @ face[0] <= 0.0)
        status = np.where(behind, BEHIND_FACE, status)
        status = np.where(np.linalg.norm(target - pivot, axis=-1) <= abs(values.mirror_offset), TOO_NEAR, status)
        status = np.where(s[..., 2] <= 0.0, NO_SUN, status)
        spots[:, p] = np.where(status == REACHES, y, np.nan), np.where(status == REACHES, z, np.nan), status
    return spots

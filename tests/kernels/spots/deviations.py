"""The specification of the deviation kernels, written another way: SciPy's rotations, fixed points, linear systems."""

import numpy as np
from scipy.spatial.transform import Rotation

from heliosweep.kernels.mounts import Setting
from heliosweep.kernels.spots import deviation_curves

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

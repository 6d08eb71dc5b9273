"""The specification of the deviation kernels, written another way: SciPy's rotations, fixed points, linear systems."""

import numpy as np

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

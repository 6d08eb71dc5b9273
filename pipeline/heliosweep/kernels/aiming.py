"""Ideal normal of a mirror whose centre lies off the pivot.

The mirror centre P = C + r n swings about the pivot C with the normal n, which must halve the angle between the sun S
and the direction from P to the aim point T. With d = T - C, D = |d| and rho = r / D the normal lies in the plane of S
and d. Let psi be the angle between them, h = unit(S + d / D) half way between them and k = unit(d / D - S):

    n = cos(x) h + sin(x) k,   f(x) = sin 2x - rho sin(psi / 2 + x) = 0

(Alhazen's problem with a source at infinity; the fixed point n = unit(S + unit(d - r n)) of Eqs. 16 and 17 of
the paper [1]_). For |rho| < 1 there is one root with |x| < pi / 4, and Newton's steps from x = 0 reach it.
Sine and cosine of psi / 2 are half the lengths of d / D - S and S + d / D, so that no angle is needed.

References
----------
.. [1] "Evaluation and measurement of heliostat misalignment in solar power plant using vector model", Optics Express
   27 (8), A257, 2019
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel

__all__ = ["aim_normals", "offset_normal"]

_STEPS = 30
_LAST_STEP = 1e-9
"""Newton's step after which the error, of the order of its square, is below rounding. [rad]"""

Floats = NDArray[np.float64]


@inline
def offset_normal(
    sx: float, sy: float, sz: float, dx: float, dy: float, dz: float, r: float
) -> tuple[float, float, float]:
    """Normal that reflects the sun to the aim point.

    Parameters
    ----------
    sx, sy, sz : float
        Unit vector to the sun. [1]
    dx, dy, dz : float
        From the pivot to the aim point. [m]
    r : float
        Mirror offset: distance of the mirror centre from the pivot along the normal. [m]

    Returns
    -------
    nx, ny, nz : float
        Unit normal; NaN where |r| is not smaller than the distance, or the sun stands opposite to the aim point. [1]
    """
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    near = 1.0 / distance if distance > 0.0 else math.nan
    wx, wy, wz = near * dx, near * dy, near * dz
    hx, hy, hz = wx + sx, wy + sy, wz + sz
    kx, ky, kz = wx - sx, wy - sy, wz - sz
    sum_length = math.sqrt(hx * hx + hy * hy + hz * hz)
    difference = math.sqrt(kx * kx + ky * ky + kz * kz)
    rho = r * near
    across, along = 0.5 * rho * difference, 0.5 * rho * sum_length  # rho sin(psi / 2), rho cos(psi / 2)
    c, s = 1.0, 0.0
    for _ in range(_STEPS if rho != 0.0 else 0):
        f = 2.0 * s * c - (across * c + along * s)
        step = f / ((along * c - across * s) - 2.0 * (c * c - s * s))
        c, s = c - step * s, s + step * c
        scale = 1.0 / math.sqrt(c * c + s * s)
        c, s = scale * c, scale * s
        if not abs(step) > _LAST_STEP:
            break
    c = c / sum_length if abs(rho) < 1.0 else math.nan
    s = s / difference if difference > 0.0 else 0.0
    nx, ny, nz = c * hx + s * kx, c * hy + s * ky, c * hz + s * kz
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return scale * nx, scale * ny, scale * nz


def aim_normals(sun: ArrayLike, to_target: ArrayLike, mirror_offset: ArrayLike = 0.0) -> Floats:
    """Normals that reflect the sun to the aim point; arguments broadcast.

    Parameters
    ----------
    sun : array_like, shape (..., 3)
        Unit vectors to the sun: east, north, up. [1]
    to_target : array_like, shape (..., 3)
        From the pivot to the aim point. [m]
    mirror_offset : array_like, shape (...)
        Distance of the mirror centre from the pivot along the normal. [m]

    Returns
    -------
    ndarray, shape (..., 3)
        Unit normals, NaN where there is none. [1]
    """
    offset = np.asarray(mirror_offset, np.float64)[..., np.newaxis]
    vectors, targets, offsets = np.broadcast_arrays(np.asarray(sun, np.float64), to_target, offset)
    normals = np.empty(vectors.shape)
    _normals(
        np.array(vectors, order="C").reshape(-1, 3),
        np.array(targets, np.float64, order="C").reshape(-1, 3),
        np.array(offsets[..., 0]).ravel(),
        normals.reshape(-1, 3),
    )
    return normals


@kernel
def _normals(sun: Floats, to_target: Floats, mirror_offset: Floats, normals: Floats) -> None:
    for i in range(len(normals)):
        normals[i, 0], normals[i, 1], normals[i, 2] = offset_normal(
            sun[i, 0], sun[i, 1], sun[i, 2], to_target[i, 0], to_target[i, 1], to_target[i, 2], mirror_offset[i]
        )

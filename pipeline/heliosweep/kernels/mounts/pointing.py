"""Fixed pointing errors of mirrors: rotation of their normals by the errors of their mounts."""

import math

import numpy as np

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.mounts.kinematics import (
    AZIMUTH_ELEVATION,
    TARGET_ALIGNED,
    bore,
    point,
    primary_axis,
    tilt_matrix,
    times,
)
from heliosweep.kernels.mounts.kinematics import turn as turned
from heliosweep.kernels.vectors import cross, dot, mixed, unit


def pointing_turns(
    centre: Floats, target: Floats, mounts: Floats, tracking: int, sun: Floats, start: int, stop: int
) -> Floats:
    """Return the rotation of the normals of mirrors start..stop towards u and v, shape (stop - start, T, 2). [rad]

    The encoders have the angles that would bring the ideal normal; errors and angles give the normal as in
    `mounts.aiming`. The rotation of a mirror about its normal is omitted.

    Parameters
    ----------
    centre, target : ndarray, shape (N, 3)
        Centres of the mirrors and their aim points: east, north, up. [m]
    mounts : ndarray, shape (N, 6)
        Errors of the mounts, in the order of `kinematics.ERRORS`. [rad]
    tracking : int
        `kinematics.TARGET_ALIGNED` or `kinematics.AZIMUTH_ELEVATION`.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    """
    out = np.zeros((stop - start, len(sun), 2))
    arrays = (
        np.array(each, np.float64, order="C") for each in (centre[start:stop], target[start:stop], mounts[start:stop])
    )
    _turns(*arrays, tracking == TARGET_ALIGNED, np.array(sun, np.float64, order="C"), out)
    return out


@kernel
def _turns(centre, target, mounts, spinning, suns, out):
    """Write the rotations; zero with the sun down."""
    for i in range(out.shape[0]):
        e, tilt = mounts[i], tilt_matrix(mounts[i, 2], mounts[i, 3])
        (cg0, sg0), (ca0, sa0) = (math.cos(e[0]), math.sin(e[0])), (math.cos(e[1]), math.sin(e[1]))
        (ce, se), (cm, sm) = (math.cos(e[4]), math.sin(e[4])), (math.cos(e[5]), math.sin(e[5]))
        to_target = unit((target[i, 0] - centre[i, 0], target[i, 1] - centre[i, 1], target[i, 2] - centre[i, 2]))
        z, x = primary_axis(TARGET_ALIGNED if spinning else AZIMUTH_ELEVATION, 0.0, 0.0, to_target)
        y = cross(z, x)
        for t in range(out.shape[1]):
            sun = (suns[t, 0], suns[t, 1], suns[t, 2])
            if not sun[2] > 0.0:
                continue
            n = unit(mixed(1.0, sun, 1.0, to_target))
            u = cross(to_target, sun) if spinning else (-n[1], n[0], 0.0)
            u = unit(u) if dot(u, u) > 1e-30 else (1.0, 0.0, 0.0)
            cg, sg, ca, sa, _ = point((dot(x, n), dot(y, n), dot(z, n)), 1.0, 0.0, 1.0, 0.0)
            cg, sg = cg * cg0 - sg * sg0, sg * cg0 + cg * sg0
            ca, sa = ca * ca0 - sa * sa0, sa * ca0 + ca * sa0
            east, north, up = bore(ca, sa, ce, se, sm, cm)
            east, north = turned(cg, sg, east, north)
            east, north, up = times(tilt, (east, north, up))
            moved = mixed(1.0, mixed(east, x, north, y), up, z)
            along = dot(moved, n)
            out[i, t, 0], out[i, t, 1] = dot(moved, u) / along, dot(moved, cross(n, u)) / along

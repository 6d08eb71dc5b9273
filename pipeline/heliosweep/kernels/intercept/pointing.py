"""Fixed pointing errors of a mirror: the turn of its normal by the errors of its mount."""

from heliosweep.kernels.compiled import inner
from heliosweep.kernels.field.packets import SPINNING_ELEVATION
from heliosweep.kernels.intercept.mirror import frame_of
from heliosweep.kernels.mounts.kinematics import AZIMUTH_ELEVATION, TARGET_ALIGNED, bore, point, primary_axis, times
from heliosweep.kernels.mounts.kinematics import turn as turned
from heliosweep.kernels.vectors import cross, dot, mixed

TERMS = 17
"""Numbers of a mount's errors that `mount_turn` takes, of `kinematics.stand_terms`."""


@inner
def mount_turn(sun, target, tracking, terms):
    """Turn of the normal, towards u and v, by the errors of a mount whose controller knows of none. [rad]

    The encoders have the angles that would bring the ideal normal; errors and angles give the normal as in
    `mounts.aiming`. What the mirror turns about its normal is left out.
    """
    frame = frame_of(sun, target, tracking, 0.0)
    z, x = primary_axis(TARGET_ALIGNED if tracking == SPINNING_ELEVATION else AZIMUTH_ELEVATION, 0.0, 0.0, target)
    y = cross(z, x)
    cg, sg, ca, sa, _ = point(dot(x, frame.n), dot(y, frame.n), dot(z, frame.n), 1.0, 0.0, 1.0, 0.0)
    cg, sg = cg * terms[0] - sg * terms[1], sg * terms[0] + cg * terms[1]
    ca, sa = ca * terms[2] - sa * terms[3], sa * terms[2] + ca * terms[3]
    east, north, up = bore(ca, sa, terms[4], terms[5], terms[7], terms[6])
    east, north = turned(cg, sg, east, north)
    east, north, up = times(terms, 8, east, north, up)
    n = mixed(1.0, mixed(east, x, north, y), up, z)
    along = dot(n, frame.n)
    return dot(n, frame.u) / along, dot(n, frame.v) / along

"""Two-axis mounts number by number, for kernels: frames, errors, the inverse of the chain of rotations, ideal normals.

The model is that of `aiming`; angles are pairs of cosine and sine, matrices are tuples of rows.

A mirror centre off the pivot, P = C + r n, moves about the pivot C with the normal n, which must halve the angle
between the sun S and the direction from P to the aim point T. With d = T - C, D = |d| and rho = r / D the normal lies
in the plane of S and d. Let psi be the angle between them, h = unit(S + d / D) half way between them and
k = unit(d / D - S):

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

from heliosweep.kernels.compiled import inline
from heliosweep.kernels.vectors import Vector, cross, dot, mixed, unit

Matrix = tuple[Vector, Vector, Vector]

AZIMUTH_ELEVATION = 0
"""Mount with a vertical primary axis."""
TARGET_ALIGNED = 1
"""Mount with its primary axis along the line from the pivot to the aim point."""
POLAR = 2
"""Mount with its primary axis along the axis of the Earth."""
TILT_ROLL = 3
"""Mount with a horizontal primary axis."""

ERRORS = (
    "azimuth_reference",
    "elevation_reference",
    "tilt_about_east",
    "tilt_about_north",
    "non_orthogonality",
    "collimation",
)
"""The six errors of a mount, in the order of every array of them. [rad]"""

_NO_LEVEL = 1e-300
"""Squared sine of the angle to the primary axis up to which a normal is along it."""
_LEVEL = 1e-12
"""Sine of the angle to the vertical below which the line to the aim point is vertical."""
_STEPS = 30
_LAST_STEP = 1e-9
"""Newton's step after which the error, of the order of its square, is below rounding. [rad]"""


@inline
def primary_axis(kind: int, latitude: float, axis_azimuth: float, to_target: Vector) -> tuple[Vector, Vector]:
    """Primary axis z of a mount and the axis x of its frame; its y is the zero of the primary angle.

    Frames: azimuth-elevation, x east and z up; target-aligned, z to the aim point and y up as far as it is
    perpendicular (north, where z is vertical); polar, x east and z to the celestial north pole; tilt-roll, z level
    towards `axis_azimuth` and y up.
    """
    if kind == AZIMUTH_ELEVATION:
        return (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    if kind == TARGET_ALIGNED:
        z = unit(to_target)
        level = math.sqrt(z[0] * z[0] + z[1] * z[1])
        if level >= _LEVEL:
            return z, (-z[1] / level, z[0] / level, 0.0)
        sign = math.copysign(1.0, z[2])
        return (0.0, 0.0, sign), (sign, 0.0, 0.0)
    if kind == POLAR:
        return (0.0, math.cos(latitude), math.sin(latitude)), (1.0, 0.0, 0.0)
    sine, cosine = math.sin(axis_azimuth), math.cos(axis_azimuth)
    return (sine, cosine, 0.0), (-cosine, sine, 0.0)


@inline
def mount_frame(kind: int, latitude: float, axis_azimuth: float, to_target: Vector) -> Matrix:
    """Return the axes x, y, z of a mount, see `primary_axis`. [1]

    `latitude` is used by polar mounts, `axis_azimuth` by tilt-roll mounts [rad], the vector from the pivot to the aim
    point by target-aligned mounts [m].
    """
    z, x = primary_axis(kind, latitude, axis_azimuth, to_target)
    return x, cross(z, x), z


@inline
def times(m: Matrix, v: Vector) -> Vector:
    """Product of a matrix and a vector."""
    return dot(m[0], v), dot(m[1], v), dot(m[2], v)


@inline
def back(m: Matrix, v: Vector) -> Vector:
    """Product of the transpose of a matrix and a vector."""
    return mixed(1.0, mixed(v[0], m[0], v[1], m[1]), v[2], m[2])


@inline
def tilt_matrix(east: float, north: float) -> Matrix:
    """Rotation Rtilt by the vector (east, north, 0) [rad], accurate for any length."""
    square = east * east + north * north
    half = 0.5 * math.sqrt(square)
    u = math.sin(2.0 * half) / (2.0 * half) if half > 0.0 else 1.0
    v = 0.5 * (math.sin(half) / half) ** 2 if half > 0.0 else 0.5
    xy = v * east * north
    return (
        (1.0 - v * north * north, xy, u * north),
        (xy, 1.0 - v * east * east, -u * east),
        (-u * north, u * east, 1.0 - v * square),
    )


@inline
def bore(ca, sa, ce, se, x, y):
    """Ry(eta) Rx(a) (x, y, 0) for the cosines and sines of a and eta."""
    up = sa * y
    return ce * x + se * up, ca * y, ce * up - se * x


@inline
def turn(cg, sg, x, y):
    """Horizontal components of Rz(-g) (x, y, .) for the cosine and sine of g: clockwise from above."""
    return cg * x + sg * y, cg * y - sg * x


@inline
def point(n, ce, se, cm, sm):
    """Angles at which a mount has a normal, in the frame of its tilted primary axis.

    Of the normal n' = Rtilt^T Q n, and the cosines and sines of eta and mu. Returns cosine and sine of g + g0 and of
    a + a0 (a normal along the primary axis has g + g0 = 0), and a number that is negative in the blind cone, where the
    angles are undefined.
    """
    nx, ny, nz = n
    level = nx * nx + ny * ny
    defined = level > _NO_LEVEL
    level = level if defined else 0.0
    each = 1.0 / ce
    x, up = (sm + nz * se) * each, (nz + se * sm) * each
    margin = level - x * x
    y = math.sqrt(max(margin, 0.0))
    inverse, each = 1.0 / level if defined else 0.0, 1.0 / cm
    cg = (x * nx + y * ny) * inverse if defined else 1.0
    return cg, (y * nx - x * ny) * inverse, y * each, up * each, margin


@inline
def ideal_normal(s: Vector, d: Vector, r: float) -> Vector:
    """Unit normal that reflects the sun to the aim point.

    Of the unit vector to the sun, the vector d from the pivot to the aim point, and the distance r of the mirror centre
    from the pivot along the normal [m]. NaN if |r| is not smaller than |d|, or the sun is opposite to the aim point.
    """
    distance = math.sqrt(dot(d, d))
    near = 1.0 / distance if distance > 0.0 else math.nan
    rho = r * near
    h, k = mixed(near, d, 1.0, s), mixed(near, d, -1.0, s)
    along, across = math.sqrt(dot(h, h)), math.sqrt(dot(k, k))
    cosine, sine = 1.0, 0.0
    for _ in range(_STEPS if r != 0.0 else 0):
        f = 2.0 * sine * cosine - 0.5 * rho * (across * cosine + along * sine)
        step = f / (0.5 * rho * (along * cosine - across * sine) - 2.0 * (cosine * cosine - sine * sine))
        cosine, sine = cosine - step * sine, sine + step * cosine
        scale = 1.0 / math.sqrt(cosine * cosine + sine * sine)
        cosine, sine = scale * cosine, scale * sine
        if not abs(step) > _LAST_STEP:
            break
    return unit(mixed(cosine / along if abs(rho) < 1.0 else math.nan, h, sine / across if across > 0.0 else 0.0, k))

"""Two-axis mounts, number by number: kinds, errors, frames, rotations, and the inverse of the chain of rotations.

Angles are pairs of cosine and sine, matrices are tuples of rows. `aiming` has the model.
"""

import math

from heliosweep.kernels.compiled import inline
from heliosweep.kernels.vectors import Vector, cross, dot, mixed, unit

Matrix = tuple[Vector, Vector, Vector]

#: Kinds of mounts. `AZIMUTH_ELEVATION`: Mount with a vertical primary axis. `TARGET_ALIGNED`: Mount with its primary
#: axis along the line from the pivot to the aim point. `POLAR`: Mount with its primary axis along the axis of the
#: Earth. `TILT_ROLL`: Mount with a horizontal primary axis.
AZIMUTH_ELEVATION, TARGET_ALIGNED, POLAR, TILT_ROLL = range(4)

#: The six errors of a mount, in the order of every array of them. [rad]
ERRORS = (
    "azimuth_reference",
    "elevation_reference",
    "tilt_about_east",
    "tilt_about_north",
    "non_orthogonality",
    "collimation",
)

#: Squared sine of the angle to the primary axis up to which a normal is along it.
_NO_LEVEL = 1e-300
#: Sine of the angle to the vertical below which the line to the aim point is vertical.
_LEVEL = 1e-12


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
def tilt_axes(east: float, north: float) -> tuple[Vector, Vector]:
    """Axes in the frame of the tilted primary axis about which a change of the tilt's components rotates the mount."""
    square = east * east + north * north
    if square < 1e-4:
        v = 0.5 + square * (-1 / 24 + square * (1 / 720 - square / 40320))
        third = 1 / 6 + square * (-1 / 120 + square * (1 / 5040 - square / 362880))
    else:
        angle = math.sqrt(square)
        v, third = (1.0 - math.cos(angle)) / square, (1.0 - math.sin(angle) / angle) / square
    across = third * east * north
    return (1.0 - third * north * north, across, v * north), (across, 1.0 - third * east * east, -v * east)


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

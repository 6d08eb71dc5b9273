"""Rays traced back from a camera over the ideal mirror to the sun: what kernels compute at every pixel."""

import math

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline

Row = Floats | tuple[float, float, float]


@inline
def ideal_mirror(focal_length: float, y: float, z: float) -> tuple[float, float, float]:
    """Height x [m] of the ideal mirror of focal length f at a pixel (y, z) [m], and its slopes a, b (Eqs. 1 and 2).

    x = r^2 / 4 f + r^4 / 64 f^3 along the normal; a = -y (1 + r^2 / 8 f^2) / 2 f and likewise b [rad]: N ~ (1, a, b).
    """
    curved = (y * y + z * z) / (8.0 * focal_length * focal_length)
    bend = -(1.0 + curved) / (2.0 * focal_length)
    return 2.0 * focal_length * curved * (1.0 + 0.5 * curved), bend * y, bend * z


@inline
def unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector over its length."""
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


@inline
def row_of(vector: Floats) -> tuple[float, float, float]:
    """A row of a scene as numbers: loops that load it at each pixel do not become vector code."""
    return vector[0], vector[1], vector[2]


@inline
def mirror_offsets(
    a: float, b: float, rx: float, ry: float, rz: float, sun_y: Row, sun_z: Row
) -> tuple[float, float, float, float, float, float]:
    """Point of the disc that the ray to a camera comes from, for a mirror with the normal N ~ (1, a, b).

    Of a and b, the slopes of the ideal mirror and p together [rad], the unit vector R to a camera in the mirror frame,
    and the rows of the scene: v and w, the 2nd and 3rd components of B_S S [1], and dv/da, dv/db, dw/da, dw/db, their
    derivatives by p_y and p_z [1/rad].
    """
    scale = 2.0 / (1.0 + a * a + b * b)
    along = rx + a * ry + b * rz
    ny = sun_y[0] + a * sun_y[1] + b * sun_y[2]
    nz = sun_z[0] + a * sun_z[1] + b * sun_z[2]
    v, w = scale * along * ny, scale * along * nz
    return (
        v - (rx * sun_y[0] + ry * sun_y[1] + rz * sun_y[2]),
        w - (rx * sun_z[0] + ry * sun_z[1] + rz * sun_z[2]),
        scale * (ry * ny + along * sun_y[1] - a * v),
        scale * (rz * ny + along * sun_y[2] - b * v),
        scale * (ry * nz + along * sun_z[1] - a * w),
        scale * (rz * nz + along * sun_z[2] - b * w),
    )

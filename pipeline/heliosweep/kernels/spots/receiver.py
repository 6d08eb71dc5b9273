"""Receiver plane: where a reflected ray meets it, and why one does not.

World frame: x east, y north, z up. The receiver is a rectangle about the aim point T. Rows of its face axes:

    X = (cos b sin g, cos b cos g, sin b),  Y = (-cos g, sin g, 0),  Z = X x Y

with the azimuth g (from north, clockwise) and the tilt b (up) of the outward normal X. The spot at the point p of the
plane has the coordinates y = Y.(p - T), positive to the right for someone in the field who looks at the receiver, and
z = Z.(p - T), positive upwards.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline
from heliosweep.kernels.vectors import Vector

#: Axes X, Y, Z of a face. [1]
Face = tuple[Vector, Vector, Vector]

#: Statuses of spots. `REACHES`: The ray reaches the plane of the receiver; with every other status the spot is NaN.
#: `MISSES`: The ray goes away from the plane or along it, or the sun lights the back of the mirror. `BEHIND_FACE`: The
#: pivot or the mirror centre lies on the plane of the receiver or behind it. `NO_SUN`: The sun is not above the
#: horizon, or NaN. `BLIND_CONE`: The mount cannot point where it should, although the aim point is far enough.
#: `TOO_NEAR`: The offsets of the mirror are not smaller than the distance to the aim point.
REACHES, MISSES, BEHIND_FACE, NO_SUN, BLIND_CONE, TOO_NEAR = range(6)


class Setting(NamedTuple):
    """Receiver and mount, which do not change with the instant: one number for each of P parameter combinations."""

    #: Azimuth of the face's outward normal, from north, clockwise. [rad]
    face_azimuth: NDArray[np.float64]
    #: Tilt of the outward normal above the horizontal. [rad]
    face_tilt: NDArray[np.float64]
    #: Half side of the aperture along Y. [m]
    half_width: NDArray[np.float64]
    #: Half side of the aperture along Z. [m]
    half_height: NDArray[np.float64]
    #: Height of the aim point above the base of the tower. [m]
    target_height: NDArray[np.float64]
    #: Mount: `AZIMUTH_ELEVATION`, `TARGET_ALIGNED`, `POLAR` or `TILT_ROLL`.
    kind: NDArray[np.int64]
    #: Geographic latitude, north positive. [rad]
    latitude: NDArray[np.float64]
    #: Azimuth of the horizontal axis of a tilt-roll mount, from north, clockwise. [rad]
    axis_azimuth: NDArray[np.float64]
    #: Distance of the mirror centre from the pivot along the bore (the normal). [m]
    mirror_offset: NDArray[np.float64]
    #: Distance of the second axis from the primary axis. [m]
    axis_offset: NDArray[np.float64]
    #: Height of the pivot above the base about which the pedestal tilts, straight below it for every mount. [m]
    pedestal_height: NDArray[np.float64]


def compiled_setting(setting: Setting) -> Setting:
    """The same as kernels take it: contiguous, writable arrays of one type."""
    dtypes = (np.int64 if name == "kind" else np.float64 for name in Setting._fields)
    return Setting(*(np.require(each, dtype, ["C", "W", "O"]) for each, dtype in zip(setting, dtypes, strict=True)))


@inline
def face_vectors(azimuth: float, tilt: float) -> Face:
    """Face axes X, Y, Z for azimuth (clockwise from north) and tilt (up) of the outward normal. [rad, 1]"""
    sine, cosine, up, out = math.sin(azimuth), math.cos(azimuth), math.sin(tilt), math.cos(tilt)
    return (out * sine, out * cosine, up), (-cosine, sine, 0.0), (-up * sine, -up * cosine, out)


def face_axes(azimuth: float, tilt: float) -> NDArray[np.float64]:
    """The same as the rows of an array, shape (3, 3)."""
    return np.array(face_vectors(float(azimuth), float(tilt)))


@inline
def trace(p: Vector, n: Vector, s: Vector, face: Face) -> tuple[float, float, int]:
    """Spot of the ray from the sun s that a mirror with the unit normal n at p reflects: p + l R, R = 2 (s.n) n - s.

    The mirror centre p is relative to the aim point [m]. Returns y and z on the plane of the receiver, NaN where there
    is no spot [m], and the status: `REACHES`, `MISSES`, `BEHIND_FACE` or `NO_SUN`.
    """
    (px, py, pz), (nx, ny, nz), (sx, sy, sz) = p, n, s
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = face
    lit = sx * nx + sy * ny + sz * nz
    rx, ry, rz = 2.0 * lit * nx - sx, 2.0 * lit * ny - sy, 2.0 * lit * nz - sz
    before = xx * px + xy * py + xz * pz
    towards = -(xx * rx + xy * ry + xz * rz)
    length = before / towards
    y = yx * (px + length * rx) + yy * (py + length * ry) + yz * (pz + length * rz)
    z = zx * (px + length * rx) + zy * (py + length * ry) + zz * (pz + length * rz)
    status = REACHES if (towards > 0.0 and lit > 0.0) else MISSES
    status = status if before > 0.0 else BEHIND_FACE
    status = status if sz > 0.0 and sx == sx and sy == sy else NO_SUN
    y = y if status == REACHES else math.nan
    z = z if status == REACHES else math.nan
    return y, z, status

"""Bricks of two-axis mounts: frames, what spots share of the errors, rotations, the inverse.

The model of `two_axis`, number by number, for kernels; angles are pairs of cosine and sine.
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.deviation import primary_axis
from heliosweep.kernels.vectors import cross

__all__ = ["ERRORS", "TERMS", "back", "bore", "error_terms", "mount_frame", "point", "stand_terms", "times", "turn"]

Floats = NDArray[np.float64]

ERRORS = (
    "azimuth_reference",
    "elevation_reference",
    "tilt_about_east",
    "tilt_about_north",
    "non_orthogonality",
    "collimation",
)
"""The six errors of a mount, in the order of every array of them. [rad]"""

TERMS = 35
"""Numbers that `error_terms` makes of six errors: cosine and sine of g0, a0, eta and mu (0 to 7), Rtilt by rows (8 to
16) and its derivatives by te (17 to 25) and by tn (26 to 34)."""

_SMALL = 0.04
"""Square of an angle below which series take the place of trigonometric functions. [rad^2]"""
_NO_LEVEL = 1e-300
"""Squared sine of the angle to the primary axis up to which a normal is along it."""


@inline
def mount_frame(
    kind: int, latitude: float, axis_azimuth: float, dx: float, dy: float, dz: float, frame: Floats
) -> None:
    """Write the axes of a mount.

    Parameters
    ----------
    kind : int
        `AZIMUTH_ELEVATION` (rows east, north, up), `TARGET_ALIGNED` (z to the aim point, y the upward perpendicular, or
        north where z is vertical), `POLAR` (z to the celestial north pole, x east) or `TILT_ROLL` (z horizontal, y up).
    latitude : float
        Geographic latitude, of polar mounts. [rad]
    axis_azimuth : float
        Azimuth of the primary axis, of tilt-roll mounts. [rad]
    dx, dy, dz : float
        From the pivot to the aim point, of target-aligned mounts. [m]
    frame : ndarray, shape (9,)
        Receives the rows x, y, z, one after the other. [1]
    """
    z, x = primary_axis(kind, latitude, axis_azimuth, (dx, dy, dz))
    y = cross(z, x)
    for m in range(3):
        frame[m], frame[3 + m], frame[6 + m] = x[m], y[m], z[m]


@kernel
def error_terms(errors: Floats, terms: Floats) -> None:
    """Write what every spot of a mount shares of its errors.

    Parameters
    ----------
    errors : ndarray, shape (6,)
        The errors, in the order of `ERRORS`. [rad]
    terms : ndarray, shape (TERMS,)
        Receives the terms. [1]
    """
    stand_terms(errors, 0, terms, 0)
    e, n = errors[2], errors[3]
    square = e * e + n * n
    u, v = _factors(square)
    # Their derivatives by w^2.
    if square < _SMALL:
        t = square
        du = -1 / 6 + t * (1 / 60 + t * (-1 / 1680 + t * (1 / 90720 + t * (-1 / 7983360 + t / 1037836800))))
        dv = -1 / 24 + t * (1 / 360 + t * (-1 / 13440 + t * (1 / 907200 - t / 95800320)))
    else:
        du, dv = 0.5 * (math.cos(math.sqrt(square)) - u) / square, 0.5 * (u - 2.0 * v) / square
    ue, ve, un, vn = 2.0 * e * du, 2.0 * e * dv, 2.0 * n * du, 2.0 * n * dv
    _rotation(
        terms,
        17,
        -ve * n * n,
        ve * e * n + v * n,
        -ve * e * e - 2.0 * v * e,
        ue * n,
        ue * e + u,
        -ve * square - 2.0 * v * e,
    )
    _rotation(
        terms,
        26,
        -vn * n * n - 2.0 * v * n,
        vn * e * n + v * e,
        -vn * e * e,
        un * n + u,
        un * e,
        -vn * square - 2.0 * v * n,
    )


@inline
def stand_terms(errors: Floats, at: int, terms: Floats, to: int) -> None:
    """Write the terms of errors[at:] that have no derivatives in them, 0 to 16, to terms[to:], see `error_terms`."""
    for m, error in ((0, errors[at]), (2, errors[at + 1]), (4, errors[at + 4]), (6, errors[at + 5])):
        terms[to + m], terms[to + m + 1] = _cosine_sine(error)
    e, n = errors[at + 2], errors[at + 3]
    square = e * e + n * n
    u, v = _factors(square)
    _rotation(terms, to + 8, 1.0 - v * n * n, v * e * n, 1.0 - v * e * e, u * n, u * e, 1.0 - v * square)


@inline
def _cosine_sine(angle):
    """Cosine and sine, of small angles by their series."""
    t = angle * angle
    if t < _SMALL:
        cosine = 1 + t * (-1 / 2 + t * (1 / 24 + t * (-1 / 720 + t * (1 / 40320 + t * (-1 / 3628800 + t / 479001600)))))
        sine = 1 + t * (-1 / 6 + t * (1 / 120 + t * (-1 / 5040 + t * (1 / 362880 - t / 39916800))))
        return cosine, angle * sine
    return math.cos(angle), math.sin(angle)


@inline
def _factors(square):
    """Factors u = sin(w) / w and v = (1 - cos(w)) / w^2 of Rtilt = 1 + u K + v K^2, of the squared length of w."""
    if square < _SMALL:
        t = square
        u = 1 + t * (-1 / 6 + t * (1 / 120 + t * (-1 / 5040 + t * (1 / 362880 - t / 39916800 + t * t / 6227020800))))
        v = 1 / 2 + t * (-1 / 24 + t * (1 / 720 + t * (-1 / 40320 + t * (1 / 3628800 - t / 479001600))))
        return u, v
    w = math.sqrt(square)
    return math.sin(w) / w, 2.0 * math.sin(0.5 * w) ** 2 / square


@inline
def _rotation(out, first, xx, xy, yy, xz, zy, zz):
    """Write the matrix (xx, xy, xz; xy, yy, -zy; -xz, zy, zz) by rows."""
    out[first], out[first + 1], out[first + 2] = xx, xy, xz
    out[first + 3], out[first + 4], out[first + 5] = xy, yy, -zy
    out[first + 6], out[first + 7], out[first + 8] = -xz, zy, zz


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
def point(nx, ny, nz, ce, se, cm, sm, side):
    """Where a mount has to turn to, in the frame of its tilted primary axis.

    Parameters
    ----------
    nx, ny, nz : float
        Normal wanted, n' = Rtilt^T Q n. [1]
    ce, se, cm, sm : float
        Cosines and sines of eta and mu. [1]
    side : float
        1 for the elevation below a quarter turn, -1 for the branch beyond it.

    Returns
    -------
    cg, sg, ca, sa : float
        Cosine and sine of g + g0 and of a + a0. A normal along the primary axis takes g + g0 = 0. [1]
    room : float
        Negative in the blind cone, where the angles mean nothing.
    """
    level = nx * nx + ny * ny
    defined = level > _NO_LEVEL
    level = level if defined else 0.0
    along = level if defined else 1.0
    # One division for the three of 1 / ce, 1 / cm and 1 / along.
    each = 1.0 / (ce * cm * along)
    inverse_ce, inverse_cm, inverse = cm * along * each, ce * along * each, ce * cm * each
    x = (sm + nz * se) * inverse_ce
    up = (nz + se * sm) * inverse_ce
    room = level - x * x
    y = side * np.sqrt(max(room, 0.0))
    cg = (x * nx + y * ny) * inverse if defined else 1.0
    sg = (y * nx - x * ny) * inverse if defined else 0.0
    return cg, sg, y * inverse_cm, up * inverse_cm, room


@inline
def times(m, first, x, y, z):
    """Product of a matrix, rows from m[first] on, and a vector."""
    return (
        m[first] * x + m[first + 1] * y + m[first + 2] * z,
        m[first + 3] * x + m[first + 4] * y + m[first + 5] * z,
        m[first + 6] * x + m[first + 7] * y + m[first + 8] * z,
    )


@inline
def back(m, first, x, y, z):
    """Product of the transpose of a matrix, rows from m[first] on, and a vector."""
    return (
        m[first] * x + m[first + 3] * y + m[first + 6] * z,
        m[first + 1] * x + m[first + 4] * y + m[first + 7] * z,
        m[first + 2] * x + m[first + 5] * y + m[first + 8] * z,
    )

"""Bricks of two-axis mounts: frames, what spots share of the errors, rotations, the inverse.

The model of `two_axis`, number by number, for kernels; angles are pairs of cosine and sine.
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.deviation import primary_axis
from heliosweep.kernels.vectors import cross

__all__ = [
    "ERRORS",
    "TERMS",
    "are_small",
    "back",
    "bore",
    "error_terms",
    "mount_frame",
    "point",
    "small_terms",
    "stand_terms",
    "times",
    "turn",
]

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
def stand_terms(errors: Floats, at: int, terms: Floats, to: int, apart: int = 1) -> None:
    """Write the terms of errors[at:] that have no derivatives in them, 0 to 16, to terms[to:], see `error_terms`.

    So many numbers `apart`: one after the other, or as a lane of rows.
    """
    for m, error in ((0, errors[at]), (2, errors[at + 1]), (4, errors[at + 4]), (6, errors[at + 5])):
        terms[to + m * apart], terms[to + (m + 1) * apart] = _cosine_sine(error)
    e, n = errors[at + 2], errors[at + 3]
    square = e * e + n * n
    _tilt(terms, to, apart, e, n, square, _factors(square))


@inline
def small_terms(errors: Floats, at: int, terms: Floats, to: int, apart: int) -> None:
    """The same for errors that are small, so many numbers `apart` as well, without a branch."""
    g, a, e, n = errors[at], errors[at + apart], errors[at + 2 * apart], errors[at + 3 * apart]
    eta, mu = errors[at + 4 * apart], errors[at + 5 * apart]
    terms[to], terms[to + apart] = _small_cosine_sine(g)
    terms[to + 2 * apart], terms[to + 3 * apart] = _small_cosine_sine(a)
    terms[to + 4 * apart], terms[to + 5 * apart] = _small_cosine_sine(eta)
    terms[to + 6 * apart], terms[to + 7 * apart] = _small_cosine_sine(mu)
    square = e * e + n * n
    _tilt(terms, to, apart, e, n, square, _small_factors(square))


@inline
def are_small(errors: Floats, at: int) -> bool:
    """Whether `small_terms` may take the place of `stand_terms`."""
    g, a, e, n, eta, mu = errors[at], errors[at + 1], errors[at + 2], errors[at + 3], errors[at + 4], errors[at + 5]
    return max(max(max(g * g, a * a), max(eta * eta, mu * mu)), e * e + n * n) < _SMALL


@inline
def _tilt(terms, to, apart, e, n, square, factors):
    """Write Rtilt = 1 + u K + v K^2."""
    u, v = factors
    xx, xy, yy, xz = 1.0 - v * n * n, v * e * n, 1.0 - v * e * e, u * n
    zy, zz = u * e, 1.0 - v * square
    _rotation(terms, to + 8 * apart, xx, xy, yy, xz, zy, zz, apart)


@inline
def _cosine_sine(angle):
    """Cosine and sine, of small angles by their series."""
    if angle * angle < _SMALL:
        return _small_cosine_sine(angle)
    return math.cos(angle), math.sin(angle)


@inline
def _small_cosine_sine(angle):
    """Cosine and sine by their series."""
    t = angle * angle
    cosine = 1 + t * (-1 / 2 + t * (1 / 24 + t * (-1 / 720 + t * (1 / 40320 + t * (-1 / 3628800 + t / 479001600)))))
    sine = 1 + t * (-1 / 6 + t * (1 / 120 + t * (-1 / 5040 + t * (1 / 362880 - t / 39916800))))
    return cosine, angle * sine


@inline
def _factors(square):
    """Factors u = sin(w) / w and v = (1 - cos(w)) / w^2 of Rtilt = 1 + u K + v K^2, of the squared length of w."""
    if square < _SMALL:
        return _small_factors(square)
    w = math.sqrt(square)
    return math.sin(w) / w, 2.0 * math.sin(0.5 * w) ** 2 / square


@inline
def _small_factors(t):
    """The same by their series."""
    u = 1 + t * (-1 / 6 + t * (1 / 120 + t * (-1 / 5040 + t * (1 / 362880 - t / 39916800 + t * t / 6227020800))))
    v = 1 / 2 + t * (-1 / 24 + t * (1 / 720 + t * (-1 / 40320 + t * (1 / 3628800 - t / 479001600))))
    return u, v


@inline
def _rotation(out, first, xx, xy, yy, xz, zy, zz, apart=1):
    """Write the matrix (xx, xy, xz; xy, yy, -zy; -xz, zy, zz) by rows."""
    out[first], out[first + apart], out[first + 2 * apart] = xx, xy, xz
    out[first + 3 * apart], out[first + 4 * apart], out[first + 5 * apart] = xy, yy, -zy
    out[first + 6 * apart], out[first + 7 * apart], out[first + 8 * apart] = -xz, zy, zz


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
def times(m, first, x, y, z, apart=1):
    """Product of a matrix, rows from m[first] on, so many numbers apart, and a vector."""
    return (
        m[first] * x + m[first + apart] * y + m[first + 2 * apart] * z,
        m[first + 3 * apart] * x + m[first + 4 * apart] * y + m[first + 5 * apart] * z,
        m[first + 6 * apart] * x + m[first + 7 * apart] * y + m[first + 8 * apart] * z,
    )


@inline
def back(m, first, x, y, z, apart=1):
    """Product of the transpose of a matrix, rows from m[first] on, so many numbers apart, and a vector."""
    return (
        m[first] * x + m[first + 3 * apart] * y + m[first + 6 * apart] * z,
        m[first + apart] * x + m[first + 4 * apart] * y + m[first + 7 * apart] * z,
        m[first + 2 * apart] * x + m[first + 5 * apart] * y + m[first + 8 * apart] * z,
    )

"""Two-axis mounts number by number, for kernels: frames, ideal normals, what spots share of the errors, the inverse.

The model is that of `aiming`; angles are pairs of cosine and sine.

A mirror centre off the pivot, P = C + r n, swings about the pivot C with the normal n, which must halve the angle
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

import numpy as np

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.vectors import PACKET, Vector, cross, unit

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

TERMS = 35
"""Numbers that `error_terms` makes of six errors: cosine and sine of g0, a0, eta and mu (0 to 7), Rtilt by rows (8 to
16) and its derivatives by te (17 to 25) and by tn (26 to 34)."""

_SMALL = 0.04
"""Square of an angle below which series take the place of trigonometric functions. [rad^2]"""
_NO_LEVEL = 1e-300
"""Squared sine of the angle to the primary axis up to which a normal is along it."""
_LEVEL = 1e-12
"""Sine of the angle to the vertical below which the line to the aim point is taken for vertical."""
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
def mount_frame(
    kind: int, latitude: float, axis_azimuth: float, dx: float, dy: float, dz: float, frame: Floats
) -> None:
    """Write the axes x, y, z of a mount one after the other, shape (9,), see `primary_axis`. [1]

    Of its kind, the latitude of polar mounts and the azimuth of the primary axis of tilt-roll mounts [rad], and the way
    from the pivot to the aim point of target-aligned mounts [m].
    """
    z, x = primary_axis(kind, latitude, axis_azimuth, (dx, dy, dz))
    y = cross(z, x)
    for m in range(3):
        frame[m], frame[3 + m], frame[6 + m] = x[m], y[m], z[m]


@kernel
def error_terms(errors: Floats, terms: Floats) -> None:
    """Write the `TERMS` numbers that all spots of a mount share of its errors, shape (6,), in the order of `ERRORS`."""
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
    xx, xy, yy, zz = -ve * n * n, ve * e * n + v * n, -ve * e * e - 2.0 * v * e, -ve * square - 2.0 * v * e
    _rotation(terms, 17, xx, xy, yy, ue * n, ue * e + u, zz)
    xx, xy, yy, zz = -vn * n * n - 2.0 * v * n, vn * e * n + v * e, -vn * e * e, -vn * square - 2.0 * v * n
    _rotation(terms, 26, xx, xy, yy, un * n + u, un * e, zz)


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
    """Test whether `small_terms` may take the place of `stand_terms`."""
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
def point(nx, ny, nz, ce, se, cm, sm):
    """Angles that a mount has to turn to, in the frame of its tilted primary axis.

    Of the normal wanted, n' = Rtilt^T Q n, and the cosines and sines of eta and mu. Returns cosine and sine of g + g0
    and of a + a0 (a normal along the primary axis takes g + g0 = 0), and what is negative in the blind cone, where the
    angles mean nothing.
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
    y = np.sqrt(max(room, 0.0))
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


@inline
def normal_lanes(rows: Floats, sun: int, to_target: int, r: float, normal: int, work: int, lanes: int) -> None:
    """Write the unit normals that reflect the sun to the aim point to the three rows that begin at `normal`.

    Unit vectors to the sun and the ways d from the pivots to the aim point are the rows that begin at `sun` and
    `to_target`; r is the distance of the mirror centres from the pivots along the normal [m]. Five rows from `work` on
    are used. NaN where |r| is not smaller than |d|, or the sun stands opposite to the aim point.
    """
    for k in range(lanes):
        s, d = of_lane(rows, sun, k), of_lane(rows, to_target, k)
        _, _, _, _, (across, along) = _half_way(s[0], s[1], s[2], d[0], d[1], d[2], r)
        rows[(work + 2) * PACKET + k], rows[(work + 3) * PACKET + k] = across, along
        rows[work * PACKET + k], rows[(work + 1) * PACKET + k], rows[(work + 4) * PACKET + k] = 1.0, 0.0, 1.0
    for _ in range(_STEPS if r != 0.0 else 0):
        for k in range(lanes):
            c, s, open_lane = rows[work * PACKET + k], rows[(work + 1) * PACKET + k], rows[(work + 4) * PACKET + k]
            c_new, s_new, step = _newton(c, s, rows[(work + 2) * PACKET + k], rows[(work + 3) * PACKET + k])
            rows[work * PACKET + k] = c_new if open_lane > 0.0 else c
            rows[(work + 1) * PACKET + k] = s_new if open_lane > 0.0 else s
            rows[(work + 4) * PACKET + k] = open_lane if abs(step) > _LAST_STEP else 0.0
        pending = 0.0
        for k in range(lanes):
            pending += rows[(work + 4) * PACKET + k]
        if pending == 0.0:
            break
    for k in range(lanes):
        s, d = of_lane(rows, sun, k), of_lane(rows, to_target, k)
        h, half, lengths, rho, _ = _half_way(s[0], s[1], s[2], d[0], d[1], d[2], r)
        n = _bisector(h, half, lengths, rho, rows[work * PACKET + k], rows[(work + 1) * PACKET + k])
        rows[normal * PACKET + k], rows[(normal + 1) * PACKET + k], rows[(normal + 2) * PACKET + k] = n


@inline
def of_lane(rows: Floats, row: int, k: int) -> Vector:
    """Vector of a lane, from three rows."""
    return rows[row * PACKET + k], rows[(row + 1) * PACKET + k], rows[(row + 2) * PACKET + k]


@inline
def _half_way(sx, sy, sz, dx, dy, dz, r):
    """S + d / D and d / D - S, their lengths, rho, and rho sin(psi / 2) and rho cos(psi / 2)."""
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    near = 1.0 / distance if distance > 0.0 else math.nan
    wx, wy, wz = near * dx, near * dy, near * dz
    hx, hy, hz = wx + sx, wy + sy, wz + sz
    kx, ky, kz = wx - sx, wy - sy, wz - sz
    sum_length = math.sqrt(hx * hx + hy * hy + hz * hz)
    difference = math.sqrt(kx * kx + ky * ky + kz * kz)
    rho = r * near
    angles = 0.5 * rho * difference, 0.5 * rho * sum_length
    return (hx, hy, hz), (kx, ky, kz), (sum_length, difference), rho, angles


@inline
def _newton(c, s, across, along):
    """A step for the cosine and sine of x; and the step. [rad]"""
    f = 2.0 * s * c - (across * c + along * s)
    step = f / ((along * c - across * s) - 2.0 * (c * c - s * s))
    c, s = c - step * s, s + step * c
    scale = 1.0 / math.sqrt(c * c + s * s)
    return scale * c, scale * s, step


@inline
def _bisector(h, k, lengths, rho, c, s):
    """Unit normal at the angle x from half way."""
    c = c / lengths[0] if abs(rho) < 1.0 else math.nan
    s = s / lengths[1] if lengths[1] > 0.0 else 0.0
    nx, ny, nz = c * h[0] + s * k[0], c * h[1] + s * k[1], c * h[2] + s * k[2]
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return scale * nx, scale * ny, scale * nz

"""Smallest error at which the spot of a mirror leaves the aperture.

Homogeneous coordinates of the spot: with the mirror centre p relative to the aim point and the reflected ray R,

    U = Z.(p x R),  V = -Y.(p x R),  W = -X.R,   spot (y, z) = (U, V) / W,   real where W > 0

The spot lies on the line l0 y + l1 z = l2 where g = l2 W - l0 U - l1 V = 0; the four edges of the aperture are the
lines (1, 0, w), (-1, 0, w), (0, 1, h), (0, -1, h), and their four g are positive as long as the spot is inside: the sum
of the first two is 2 w W, so that W > 0 is said with them. The first exit is therefore the root of smallest magnitude
of the four g, on either side of no error, and nothing has to be scanned. The mirror must be lit there, S.n > 0.

Mirror centre fixed, axis a in the mirror. R(eps) = Rot(a, 2 eps) R(0), and g is linear in R: g = c0 + c1 cos 2 eps +
c2 sin 2 eps, with the roots

    cot eps = (-c2 +- sqrt(c2^2 - (c0 - c1) (c0 + c1))) / (c0 + c1)

R has the period pi, and of the angles eps + j pi the mirror is lit at one. On it, cot |eps| = cot eps times the sign
of (S.n) cot eps + S.(a x n); the tolerance has the largest of these cotangents over the edges and roots.

Mirror centre or primary axis that move. g is a trigonometric polynomial of degree 2 or 3. A march from no error takes
steps h that are the closed form of the distance at which a root can be at the earliest, g + g' h - M h^2 / 2 = 0 with
a bound M of |g''|: no root can be passed over, and close to one the steps are those of Newton's method, with his
convergence.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.spots.deviation import Curve, curve_of, draws_conic, face_vectors, prepared, spot_at
from heliosweep.kernels.spots.receiver import REACHES, Face, Setting
from heliosweep.kernels.vectors import Vector, at_angle, cross, dot, mixed, slope_at_angle, turning

Floats = NDArray[np.float64]
Line = Vector
"""Coefficients l0, l1 [1] and l2 [m] of the line l0 y + l1 z = l2."""

_STEPS = 10_000
"""More than any march was seen to take."""
_LAST_STEP = 1e-9
"""Step after which the error, of the order of its square, is below rounding. [rad]"""
_PARALLEL = 1e-12
"""Sine of the angle to the plane below which a ray runs along it: what it would hit is rounding. [1]"""
_EDGE_ON = 1e-12
"""Cosine of incidence at which a mirror counts as turned away from the sun."""


def tolerances(setting: Setting, source: ArrayLike, axis: ArrayLike, sun: ArrayLike, pivots: ArrayLike) -> Floats:
    """Smallest |error| at which the spot leaves the aperture; parameters as in `deviation.deviation_spots`.

    Returns
    -------
    ndarray, shape (P, H, T)
        Tolerances [rad]; infinity where the spot never crosses an edge, or the mirror turns its back to the sun before
        it does; NaN where the spot of no error does not reach the plane.
    """
    settings, sources, axes, suns, places = prepared(setting, source, axis, sun, pivots)
    out = np.full((len(sources), places.shape[1], suns.shape[1]), np.nan)
    fill_tolerances(settings, sources, axes, suns, places, out)
    return out


@kernel
def fill_tolerances(
    setting: Setting,
    source: NDArray[np.int64],
    axis: NDArray[np.int64],
    sun: Floats,
    pivots: Floats,
    out: Floats,
) -> None:
    """Fill `out`, shape (P, H, T), see `tolerances`."""
    for p in range(len(source)):
        closed = draws_conic(source[p], axis[p], setting.mirror_offset[p], setting.pedestal_height[p])
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        w, h = setting.half_width[p], setting.half_height[p]
        for i in range(pivots.shape[1]):
            for t in range(sun.shape[1]):
                curve = curve_of(setting, p, face, source[p], axis[p], sun, pivots, i, t)
                _, _, status = spot_at(curve, face, 1.0, 0.0)
                if curve.status != REACHES or status != REACHES:
                    continue
                if closed:
                    n = at_angle(curve.normal, 1.0, 0.0)
                    cotangent = canting_cotangent(curve.sun, n, curve.axis, curve.centre[0], face, w, h)
                    out[p, i, t] = math.atan2(1.0, cotangent) if cotangent > -math.inf else math.inf
                else:
                    edges = ((1.0, 0.0, w), (-1.0, 0.0, w), (0.0, 1.0, h), (0.0, -1.0, h))
                    up = first_crossing(curve, face, edges, 1.0, math.pi)
                    down = first_crossing(curve, face, edges, -1.0, min(up, math.pi))
                    out[p, i, t] = min(up, down) if up == up and down == down else math.nan


@inline
def canting_cotangent(
    sun: Vector, normal: Vector, axis: Vector, centre: Vector, face: Face, half_width: float, half_height: float
) -> float:
    """Cotangent of the tolerance to an error about an axis in the mirror that leaves the mirror centre where it is.

    Parameters
    ----------
    sun, normal, axis : Vector
        Unit vectors to the sun, of the mirror and of the axis, perpendicular to the normal. [1]
    centre : Vector
        Mirror centre relative to the aim point. [m]
    face : Face
        Axes X, Y, Z of the face. [1]
    half_width, half_height : float
        Half sides of the aperture along Y and Z. [m]

    Returns
    -------
    float
        The tolerance is atan2(1, cotangent), or infinity where this is -infinity. The spot of no error must be real
        and inside the aperture. [1]
    """
    # One by one: written as a loop, this is not vectorised.
    one, _ = crossing_cotangent(sun, normal, axis, centre, face, (1.0, 0.0, half_width))
    two, _ = crossing_cotangent(sun, normal, axis, centre, face, (-1.0, 0.0, half_width))
    three, _ = crossing_cotangent(sun, normal, axis, centre, face, (0.0, 1.0, half_height))
    four, _ = crossing_cotangent(sun, normal, axis, centre, face, (0.0, -1.0, half_height))
    return max(max(one, two), max(three, four))


@inline
def crossing_cotangent(
    sun: Vector, normal: Vector, axis: Vector, centre: Vector, face: Face, line: Line
) -> tuple[float, float]:
    """First crossing of a line by the curve of an error about an axis in the mirror, with the mirror centre at rest.

    Parameters as in `canting_cotangent`.

    Returns
    -------
    cotangent : float
        Of the smallest |error| at which the spot is real and on the line; -infinity where there is none. [1]
    sign : float
        1 or -1, the sign of this error.
    """
    lit = dot(sun, normal)
    lit_side = dot(sun, cross(axis, normal))
    still, first, second = turning(axis, mixed(2.0 * lit, normal, -1.0, sun))
    u0, v0, w0 = _homogeneous(centre, still, face)
    u1, v1, w1 = _homogeneous(centre, first, face)
    u2, v2, w2 = _homogeneous(centre, second, face)
    c0 = line[2] * w0 - line[0] * u0 - line[1] * v0
    c1 = line[2] * w1 - line[0] * u1 - line[1] * v1
    c2 = line[2] * w2 - line[0] * u2 - line[1] * v2
    discriminant = c2 * c2 - (c0 - c1) * (c0 + c1)
    larger = -(c2 + math.copysign(math.sqrt(max(discriminant, 0.0)), c2))
    best, side = -math.inf, 1.0
    for cotangent in (larger / (c0 + c1), (c0 - c1) / larger):
        towards = 1.0 if lit * cotangent + lit_side > 0.0 else -1.0
        square = cotangent * cotangent
        real = w0 * (square + 1.0) + w1 * (square - 1.0) + 2.0 * w2 * cotangent
        if discriminant >= 0.0 and real > _PARALLEL * (square + 1.0) and towards * cotangent > best:
            best, side = towards * cotangent, towards
    return best, side


@inline
def _homogeneous(p: Vector, r: Vector, face: Face) -> Vector:
    """Homogeneous coordinates U, V [m] and W [1] of the spot of a ray r from p."""
    moment = cross(p, r)
    return dot(face[2], moment), -dot(face[1], moment), -dot(face[0], r)


@inline
def first_crossing(curve: Curve, face: Face, lines: tuple[Line, ...], side: float, limit: float) -> float:
    """Smallest |error| of one sign at which the spot is real and on one of the lines.

    Parameters
    ----------
    curve : Curve
        The curve.
    face : Face
        Axes X, Y, Z of the face. [1]
    lines : tuple of Line
        One line; or several with the spot of no error on the side of all of them where g > 0, and no virtual crossing
        before the first real one (edges of an aperture).
    side : float
        1 or -1, the sign of the error.
    limit : float
        Where to give up. [rad]

    Returns
    -------
    float
        Infinity where there is none up to `limit`, or the mirror turns away from the sun before; NaN where the march
        would not end. [rad]
    """
    arm = math.sqrt(dot(curve.centre[2], curve.centre[2]))
    start = at_angle(curve.centre, 1.0, 0.0)
    reach = math.sqrt(dot(start, start)) + 2.0 * arm
    error, sign = 0.0, 0.0
    for _ in range(_STEPS):
        cosine, sine = math.cos(error), side * math.sin(error)
        n, n_slope = at_angle(curve.normal, cosine, sine), slope_at_angle(curve.normal, cosine, sine)
        p, p_slope = at_angle(curve.centre, cosine, sine), slope_at_angle(curve.centre, cosine, sine)
        lit, lit_slope = dot(curve.sun, n), dot(curve.sun, n_slope)
        r = mixed(2.0 * lit, n, -1.0, curve.sun)
        r_slope = mixed(2.0 * lit_slope, n, 2.0 * lit, n_slope)
        u, v, w = _homogeneous(p, r, face)
        a, b, w_slope = _homogeneous(p, r_slope, face)
        c, d, _ = _homogeneous(p_slope, r, face)
        to_root, past_root = math.inf, 0.0
        for line in lines:
            g = line[2] * w - line[0] * u - line[1] * v
            slope = line[2] * w_slope - line[0] * (a + c) - line[1] * (b + d)
            # |R'| <= 2, |R''| <= 8, |p'| and |p''| <= arm
            size = math.sqrt(line[0] * line[0] + line[1] * line[1])
            bound = size * (5.0 * arm + 8.0 * reach) + 8.0 * abs(line[2])
            if sign == 0.0:
                sign = 1.0 if g >= 0.0 else -1.0
            earliest = _earliest_root(sign * g, sign * side * slope, bound)
            if earliest < to_root:
                to_root, past_root = earliest, abs(slope) / bound
        if to_root < _LAST_STEP:
            if w > _PARALLEL:
                return error + to_root if error + to_root <= limit else math.inf
            # a crossing of the virtual branch: no other lies within 2 |g'| / M beyond it; the sign there is not always
            # the opposite, the curve may have touched the line
            sign = 0.0
            to_root = max(past_root, _LAST_STEP)
        if not lit > _EDGE_ON:
            return math.inf
        error += min(to_root, _earliest_root(lit, side * lit_slope, 1.0))
        if not error <= limit:
            return math.inf
    return math.nan


@inline
def _earliest_root(value: float, slope: float, bound: float) -> float:
    """Least distance over which a function of this value, slope and bound of |second derivative| stays positive."""
    if not value > 0.0:
        return 0.0
    root = math.sqrt(slope * slope + 2.0 * bound * value)
    return 2.0 * value / (root - slope) if slope < 0.0 else (slope + root) / bound

"""What belongs to a whole deviation curve: its tolerance, the conic section it is part of, its detectors' crossings.

**Tolerance**: smallest error at which the spot of a mirror leaves the aperture. Homogeneous coordinates of the spot:
with the mirror centre p relative to the aim point and the reflected ray R,

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

Mirror centre or primary axis that move. g is a trigonometric polynomial of degree 2 or 3, whose coefficients are
products of those of R and p. A march from no error takes steps h that are the closed form of the distance at which a
root can be at the earliest, g + g' h - M h^2 / 2 = 0 with a bound M of |g''|, the sum of its amplitudes by the squares
of their degrees: no root can be passed over, and close to one the steps are those of Newton's method, with his
convergence.

**Conic**: about an axis a in the mirror the reflected rays satisfy a.R = -a.S = k: they form a cone with its apex p in
the mirror centre, and on the plane of the receiver the points x = y Y + z Z (relative to the aim point) of the trace
satisfy

    (x - p)^T m (x - p) = 0,  m = a a^T - k^2 I:   A y^2 + B y z + C z^2 + D y + E z + F = 0

    A = m_yy,  B = 2 m_yz,  C = m_zz,  D = -2 (m p)_y,  E = -2 (m p)_z,  F = p^T m p

with B^2 - 4 A C = 4 k^2 (1 - a_x^2 - k^2) and the eccentricity sqrt(1 - a_x^2) / |k|. Rays run along that half of the
cone where a.(x - p) has the sign of k. The sphere inside this half that touches the cone and, from the side of the
apex, the plane (Dandelin's) touches the plane in a focus: inside the branch that rays trace. Its centre is
p + s sign(k) a with s = X.p / (sqrt(1 - k^2) - sign(k) a_x).

**Crossings**: a heliostat whose facets carry reflecting cylinders, or that sweeps through an error, draws a whole
deviation curve; detectors along lines l0 y + l1 z = l2 see where it crosses them (Optics Express 27 (8), A257 (2019),
Sect. 4.3).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.spots.deviation import Curve, curve_of, draws_conic, prepared, spot_at
from heliosweep.kernels.spots.receiver import REACHES, Face, Setting, face_vectors
from heliosweep.kernels.vectors import Vector, at_angle, cross, dot, mixed, turning

Line = Vector
"""Coefficients l0, l1 [1] and l2 [m] of the line l0 y + l1 z = l2."""
Series = tuple[float, float, float, float, float, float, float]
"""A trigonometric polynomial: coefficients of 1, cos, sin, cos 2, sin 2, cos 3 and sin 3 of the error."""

_STEPS = 10_000
"""More than any march was seen to take."""
_LAST_STEP = 1e-9
"""Step after which the error, of the order of its square, is below rounding. [rad]"""
_PARALLEL = 1e-12
"""Sine of the angle to the plane below which a ray runs along it: what it would hit is rounding. [1]"""
_EDGE_ON = 1e-12
"""Cosine of incidence at which a mirror counts as turned away from the sun."""
_STRAIGHT = 1e-14
"""Cosine |k| of the half angle of a cone that is taken for a plane: smaller ones are rounding. [1]"""
_ROUNDING = 1e-12
"""Ratio of A to the larger of B and C up to which A is rounding. [1]"""


class Curves(NamedTuple):
    """What belongs to the curves of P parameter points, H heliostats and T instants.

    All is NaN where the spot of no error does not reach the plane.
    """

    tolerance: Floats
    """Smallest |error| at which the spot leaves the aperture, shape (P, H, T); 0 where it is outside without, by errors
    that the mount has already; infinity where it never crosses an edge, or the mirror turns its back to the sun before
    it does. [rad]"""
    conic: Floats
    """Shape (9, P, H, T): coefficients A [1], B [1], C [1], D [m], E [m], F [m^2], divided by A (by the one of largest
    magnitude where A is 0 to rounding, beside B and C); eccentricity [1]; focus y and z [m] inside the branch that real
    rays trace, the one nearer to the mirror of the two in an ellipse. A cone that is a plane (the sun perpendicular to
    the axis) gives a straight line: eccentricity infinity, no focus. NaN where the curve is no conic: errors of the
    encoder or the pedestal with a mirror centre that moves, and of the primary axis."""
    crossing: Floats
    """Shape (3, P, H, T, L): y and z [m] of the first crossing of each line and the error [rad] with its sign: of all
    crossings by real rays the one of smallest |error|; NaN where there is none."""


def deviation_curves(
    setting: Setting,
    source: ArrayLike,
    axis: ArrayLike,
    sun: ArrayLike,
    pivots: ArrayLike,
    lines: Sequence[Sequence[float]] | NDArray[np.float64] = (),
    stands: ArrayLike | None = None,
) -> Curves:
    """Tolerances, conics and crossings of deviation curves; other parameters as in `deviation.deviation_spots`.

    Parameters
    ----------
    lines : array_like, shape (L, 3)
        Coefficients l0, l1 [1] and l2 [m] of lines of detectors l0 y + l1 z = l2; l0 and l1 not both 0.

    Raises
    ------
    ValueError
        As `deviation.prepared`, and for lines of another shape or without a direction.
    """
    settings, sources, axes, sky = prepared(setting, source, axis, sun, pivots, stands)
    detectors = np.require(lines, np.float64, ["C", "W", "O"]) if len(lines) else np.empty((0, 3))
    if detectors.ndim != 2 or detectors.shape[1] != 3 or not np.all(np.any(detectors[:, :2] != 0.0, axis=1)):
        raise ValueError("lines must have the shape (number, 3), with l0 and l1 not both 0")
    shape = len(sources), sky[1].shape[1], sky[0].shape[1]
    found = Curves(*(np.full(whole, np.nan) for whole in (shape, (9, *shape), (3, *shape, len(detectors)))))
    fill_curves(settings, sources, axes, detectors, sky, *found)
    return found


@kernel
def fill_curves(
    setting: Setting,
    source: NDArray[np.int64],
    axis: NDArray[np.int64],
    lines: Floats,
    sky: tuple[Floats, Floats, Floats],
    tolerance: Floats,
    conic: Floats,
    crossing: Floats,
) -> None:
    """Fill the arrays of `Curves`."""
    for p in range(len(source)):
        closed = draws_conic(source[p], axis[p], setting.mirror_offset[p], setting.pedestal_height[p])
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        w, h = setting.half_width[p], setting.half_height[p]
        aligned = len(sky[2]) == 0
        for i in range(tolerance.shape[1]):
            for t in range(tolerance.shape[2]):
                curve = curve_of(setting, p, face, source[p], axis[p], sky, i, t)
                y, z, status = spot_at(curve, face, 1.0, 0.0)
                if curve.status != REACHES or status != REACHES:
                    continue
                n, series = at_angle(curve.normal, 1.0, 0.0), spot_series(curve, face)
                if closed:
                    cotangent = canting_cotangent(curve.sun, n, curve.axis, curve.centre[0], face, w, h)
                    tolerance[p, i, t] = math.atan2(1.0, cotangent) if cotangent > -math.inf else math.inf
                    numbers = _conic(curve, face)
                    for m in range(9):
                        conic[m, p, i, t] = numbers[m]
                else:
                    edges = (
                        line_series(series, (1.0, 0.0, w)),
                        line_series(series, (-1.0, 0.0, w)),
                        line_series(series, (0.0, 1.0, h)),
                        line_series(series, (0.0, -1.0, h)),
                    )
                    up = first_crossing(series, edges, 1.0, math.pi)
                    down = first_crossing(series, edges, -1.0, min(up, math.pi))
                    tolerance[p, i, t] = min(up, down) if up == up and down == down else math.nan
                if not aligned and not (abs(y) <= w and abs(z) <= h):
                    tolerance[p, i, t] = 0.0
                for m in range(len(lines)):
                    line = (lines[m, 0], lines[m, 1], lines[m, 2])
                    if aligned and line[2] == 0.0:
                        # through the aim point: crossed by the spot of no error
                        error = 0.0
                    elif closed:
                        cotangent, side = crossing_cotangent(curve.sun, n, curve.axis, curve.centre[0], face, line)
                        error = side * math.atan2(1.0, cotangent) if cotangent > -math.inf else math.nan
                    else:
                        one = (line_series(series, line),)
                        up = first_crossing(series, one, 1.0, math.pi)
                        down = first_crossing(series, one, -1.0, min(up, math.pi))
                        error = -down if down < up else up
                    if not abs(error) < math.inf:
                        continue
                    y, z, status = spot_at(curve, face, math.cos(error), math.sin(error))
                    if status == REACHES:
                        crossing[0, p, i, t, m], crossing[1, p, i, t, m], crossing[2, p, i, t, m] = y, z, error


@inline
def _conic(curve: Curve, face: Face) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Coefficients, eccentricity and focus."""
    a, p = curve.axis, curve.centre[0]
    k = -dot(a, curve.sun)
    ax, ay, az = dot(face[0], a), dot(face[1], a), dot(face[2], a)
    px, py, pz = dot(face[0], p), dot(face[1], p), dot(face[2], p)
    along = dot(a, p)
    first, second, third = ay * ay - k * k, 2.0 * ay * az, az * az - k * k
    fourth, fifth = -2.0 * (ay * along - k * k * py), -2.0 * (az * along - k * k * pz)
    sixth = along * along - k * k * dot(p, p)
    scale = first
    if abs(first) <= _ROUNDING * max(abs(second), abs(third)):
        for other in (second, third, fourth, fifth, sixth):
            scale = other if abs(other) > abs(scale) else scale
    eccentricity, focus_y, focus_z = math.inf, math.nan, math.nan
    if abs(k) > _STRAIGHT:
        eccentricity = math.sqrt(max(ay * ay + az * az, 0.0)) / abs(k)
        sign = math.copysign(1.0, k)
        s = sign * px / (math.sqrt(max(1.0 - k * k, 0.0)) - sign * ax)
        focus_y, focus_z = py + s * ay, pz + s * az
    return (
        first / scale,
        second / scale,
        third / scale,
        fourth / scale,
        fifth / scale,
        sixth / scale,
        eccentricity,
        focus_y,
        focus_z,
    )


@inline
def canting_cotangent(
    sun: Vector, normal: Vector, axis: Vector, centre: Vector, face: Face, half_width: float, half_height: float
) -> float:
    """Cotangent of the tolerance to an error about an axis in the mirror that leaves the mirror centre where it is.

    Of unit vectors to the sun, of the mirror and of the axis, perpendicular to the normal [1], the mirror centre
    relative to the aim point [m] and the half sides of the aperture along Y and Z [m]. The tolerance is
    atan2(1, cotangent), or infinity where this is -infinity. The spot of no error must be real and inside the aperture.
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

    Parameters as in `canting_cotangent`. Returns the cotangent of the smallest |error| at which the spot is real and on
    the line, -infinity where there is none, and the sign of this error.
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
def spot_series(curve: Curve, face: Face) -> tuple[Series, Series, Series, Series]:
    """Trigonometric polynomials of the error: S.n, and U, V and W of the spot."""
    sun, (n0, n1, n2) = curve.sun, curve.normal
    l0, l1, l2 = dot(sun, n0), dot(sun, n1), dot(sun, n2)
    once, twice = mixed(l1, n1, l2, n2), mixed(l1, n1, -l2, n2)
    rays = (
        mixed(1.0, mixed(2.0 * l0, n0, 1.0, once), -1.0, sun),
        mixed(2.0 * l0, n1, 2.0 * l1, n0),
        mixed(2.0 * l0, n2, 2.0 * l2, n0),
        twice,
        mixed(l1, n2, l2, n1),
    )
    out = face[0]
    ahead = (-dot(out, rays[0]), -dot(out, rays[1]), -dot(out, rays[2]), -dot(out, rays[3]), -dot(out, rays[4]))
    lit = (l0, l1, l2, 0.0, 0.0, 0.0, 0.0)
    return lit, _moment(curve, face[2], 1.0, rays), _moment(curve, face[1], -1.0, rays), (*ahead, 0.0, 0.0)


@inline
def _moment(curve, axis, sign, rays):
    """Series of sign * axis . (p x R) = R . (sign * axis x p)."""
    q0, q1, q2 = cross(axis, curve.centre[0]), cross(axis, curve.centre[1]), cross(axis, curve.centre[2])
    r0, r1, r2, r3, r4 = rays
    half = 0.5 * sign
    return (
        sign * dot(r0, q0) + half * (dot(r1, q1) + dot(r2, q2)),
        sign * (dot(r0, q1) + dot(r1, q0)) + half * (dot(r3, q1) + dot(r4, q2)),
        sign * (dot(r0, q2) + dot(r2, q0)) + half * (dot(r4, q1) - dot(r3, q2)),
        sign * dot(r3, q0) + half * (dot(r1, q1) - dot(r2, q2)),
        sign * dot(r4, q0) + half * (dot(r1, q2) + dot(r2, q1)),
        half * (dot(r3, q1) - dot(r4, q2)),
        half * (dot(r4, q1) + dot(r3, q2)),
    )


@inline
def line_series(series: tuple[Series, Series, Series, Series], line: Line) -> tuple[Series, float]:
    """Trigonometric polynomial g of a line, and a bound of the magnitude of its second derivative."""
    _, u, v, w = series
    l0, l1, l2 = line
    g0, g1, h1 = l2 * w[0] - l0 * u[0] - l1 * v[0], l2 * w[1] - l0 * u[1] - l1 * v[1], l2 * w[2] - l0 * u[2] - l1 * v[2]
    g2, h2 = l2 * w[3] - l0 * u[3] - l1 * v[3], l2 * w[4] - l0 * u[4] - l1 * v[4]
    g3, h3 = -l0 * u[5] - l1 * v[5], -l0 * u[6] - l1 * v[6]
    bound = math.sqrt(g1 * g1 + h1 * h1) + 4.0 * math.sqrt(g2 * g2 + h2 * h2) + 9.0 * math.sqrt(g3 * g3 + h3 * h3)
    return (g0, g1, h1, g2, h2, g3, h3), bound


@inline
def _value_and_slope(series, c, s):
    """A trigonometric polynomial and its derivative at the angle of cosine c and sine s."""
    c2, s2 = c * c - s * s, 2.0 * c * s
    c3, s3 = c * c2 - s * s2, s * c2 + c * s2
    g0, g1, h1, g2, h2, g3, h3 = series
    value = g0 + (g1 * c + h1 * s) + (g2 * c2 + h2 * s2) + (g3 * c3 + h3 * s3)
    return value, (h1 * c - g1 * s) + 2.0 * (h2 * c2 - g2 * s2) + 3.0 * (h3 * c3 - g3 * s3)


@inline
def first_crossing(series, lines, side: float, limit: float) -> float:
    """Smallest |error| of the sign `side` at which the spot is real and on one of the lines. [rad]

    Of the `spot_series` and the `line_series` of one line; or several with the spot of no error on the side of all of
    them where g > 0, and no virtual crossing before the first real one (edges of an aperture). Infinity where there is
    none up to `limit` [rad], or the mirror turns away from the sun before; NaN where the march would not end.
    """
    error, sign, cosine, sine, bright = 0.0, 0.0, 1.0, 0.0, 0.0
    for _ in range(_STEPS):
        to_root, past_root = math.inf, 0.0
        for line, bound in lines:
            g, slope = _value_and_slope(line, cosine, sine)
            if sign == 0.0:
                sign = 1.0 if g >= 0.0 else -1.0
            earliest = _earliest_root(sign * g, sign * side * slope, bound)
            if earliest < to_root:
                to_root, past_root = earliest, abs(slope) / bound
        if to_root < _LAST_STEP:
            ahead, _ = _value_and_slope(series[3], cosine, sine)
            if ahead > _PARALLEL:
                return error + to_root if error + to_root <= limit else math.inf
            # a crossing of the virtual branch: no other lies within 2 |g'| / M beyond it; the sign there is not always
            # the opposite, the curve may have touched the line
            sign = 0.0
            to_root = max(past_root, _LAST_STEP)
        if error + to_root > bright:  # up to which the mirror is known to be lit
            lit, slope = _value_and_slope(series[0], cosine, sine)
            if not lit > _EDGE_ON:
                return math.inf
            bright = error + _earliest_root(lit, side * slope, 1.0)
            to_root = min(to_root, bright - error)
        error += to_root
        if not error <= limit:
            return math.inf
        cosine, sine = math.cos(error), side * math.sin(error)
    return math.nan


@inline
def _earliest_root(value: float, slope: float, bound: float) -> float:
    """Least distance over which a function of this value, slope and bound of |second derivative| stays positive."""
    if not value > 0.0:
        return 0.0
    root = math.sqrt(slope * slope + 2.0 * bound * value)
    return 2.0 * value / (root - slope) if slope < 0.0 else (slope + root) / bound

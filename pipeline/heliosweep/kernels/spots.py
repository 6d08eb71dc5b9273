"""Spots of misaligned mirrors: deviation curves of single errors, and spots of mounts with all errors.

**Curve**. A mount without known errors aims; its mirror has the centre P and the normal n that its actual errors give.
Its axes: e, the elevation axis in the mirror, level for a vertical primary axis z without errors, and b = e x n up the
slope. An error of the angle eps rotates the normal about the axis a:

    n(eps) = Rot(a, eps) n,   a = e (elevation: + raises n), -b (azimuth), -z (encoder azimuth): + rotates n
                              clockwise seen from the end of the primary axis

and moves the mirror centre or not:

    canting: P is fixed;   encoder: P(eps) = C + Rot(a, eps) (P - C);   tilt: P(eps) = B + Rot(a, eps) (P - B)

with the pivot C and the base B of the pedestal. Every vector that rotates about a is v0 + v1 cos eps + v2 sin eps with
v0 = a (a.v), v1 = v - v0, v2 = a x v. The reflected ray is R = 2 (S.n) n - S; about an axis in the mirror, R(eps) =
Rot(a, 2 eps) R(0). After Optics Express 27 (8), A257 (2019), Sect. 3, in a right-handed frame.

**Tolerance**: smallest error at which the spot of a mirror leaves the aperture. Homogeneous coordinates of the spot:
with the mirror centre p relative to the aim point and the reflected ray R,

    U = Z.(p x R),  V = -Y.(p x R),  W = -X.R,   spot (y, z) = (U, V) / W,   real where W > 0

The spot lies on the line l0 y + l1 z = l2 if g = l2 W - l0 U - l1 V = 0; the four edges of the aperture are the
lines (1, 0, w), (-1, 0, w), (0, 1, h), (0, -1, h), and their four g are positive as long as the spot is inside: the sum
of the first two is 2 w W, so that W > 0 follows. The first exit is therefore the root of smallest magnitude
of the four g, on either side of no error, and nothing has to be scanned. The mirror must be lit there, S.n > 0.

Mirror centre fixed, axis a in the mirror. R(eps) = Rot(a, 2 eps) R(0), and g is linear in R: g = c0 + c1 cos 2 eps +
c2 sin 2 eps, with the roots

    cot eps = (-c2 +- sqrt(c2^2 - (c0 - c1) (c0 + c1))) / (c0 + c1)

R has the period pi, and of the angles eps + j pi the mirror is lit at one. On it, cot |eps| = cot eps times the sign
of (S.n) cot eps + S.(a x n); the tolerance has the largest of these cotangents over the edges and roots.

Mirror centre or primary axis that move. g is a trigonometric polynomial of degree 2 or 3, whose coefficients are
products of the coefficients of R and p. A march from no error takes steps h that are the closed form of the distance at
which a root can be at the earliest, g + g' h - M h^2 / 2 = 0 with a bound M of |g''|, the sum of its amplitudes by the
squares of their degrees: no root can be passed over, and close to one the steps are those of Newton's method, with his
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

**Mounts**: mounts aim with the known errors, and the actual errors move the mirror.

Also statistics of spots over samples of the errors, without storing the spots: mean, variances and covariance of the
spots that reach the plane of the receiver, the fractions of the samples that do and that lie in the aperture, and
percentiles of the remaining tolerance: how far the mirror may still turn about its elevation or its azimuth axis, the
mirror centre at rest, before the spot leaves the aperture.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import Floats, inline, kernel
from heliosweep.kernels.mounts import (
    BEHIND_FACE,
    BLIND_CONE,
    MISSES,
    NO_SUN,
    REACHES,
    Face,
    Setting,
    aimed,
    back,
    compiled_setting,
    face_vectors,
    mirror_at,
    mount_frame,
    mount_of,
    six,
    trace,
)
from heliosweep.kernels.vectors import Vector, at_angle, cross, dot, minus, mixed, scaled, turning

#: Sources of an error. `CANTING`: Source of the error: the facet is canted, its centre is fixed. `ENCODER`: The mirror
#: rotates about its pivot. `TILT`: The pedestal rotates about its base.
CANTING, ENCODER, TILT = range(3)

#: Axes of an error. `ELEVATION`: Axis of the error: e, level in the mirror. `AZIMUTH`: -b, down the slope of the
#: mirror. `ENCODER_AZIMUTH`: Minus the primary axis.
ELEVATION, AZIMUTH, ENCODER_AZIMUTH = range(3)

#: Coefficients l0, l1 [1] and l2 [m] of the line l0 y + l1 z = l2.
Line = Vector
#: A trigonometric polynomial: coefficients of 1, cos, sin, cos 2, sin 2, cos 3 and sin 3 of the error.
Series = tuple[float, float, float, float, float, float, float]

#: More than any march was seen to take.
_STEPS = 10_000
#: Step after which the error, of the order of its square, is below rounding. [rad]
_LAST_STEP = 1e-9
#: Minimum sine of the angle between a ray and the plane; below it the hit is rounding. [1]
_PARALLEL = 1e-12
#: Cosine of incidence at which a mirror counts as turned away from the sun.
_EDGE_ON = 1e-12
#: Cosine |k| of the half angle of a cone that is taken for a plane: smaller ones are rounding. [1]
_STRAIGHT = 1e-14
#: Ratio of A to the larger of B and C up to which A is rounding. [1]
_ROUNDING = 1e-12
MOMENTS = ("mean_y", "mean_z", "variance_y", "variance_z", "covariance", "real_fraction", "hit_fraction", "status")
#: Maximum number of spots that are kept at a time, and number in place of infinite angles in percentiles. [1, rad]
_MOST, _ENDLESS = 100_000, 1e300
#: Sine of the angle between normal and primary axis below which there is no elevation axis.
_ALONG = 1e-12


Parts = tuple[Vector, Vector, Vector]


class Curve(NamedTuple):
    """Rotating normal and centre of one mirror at one instant, under an error of one axis and source."""

    #: A code of `receiver`; with all but `REACHES`, the rest is undefined.
    status: int
    #: Unit vector to the sun. [1]
    sun: Vector
    #: Unit vector a, about which the error rotates. [1]
    axis: Vector
    #: Rotating unit normal. [1]
    normal: Parts
    #: Rotating mirror centre relative to the aim point. [m]
    centre: Parts


class Curves(NamedTuple):
    """Spots and numbers of the curves of C parameter points, H heliostats and T instants.

    All but the spots is NaN if the spot of no error does not reach the plane.
    """

    #: Shape (3, C, H, T, E): y and z [m], NaN unless the status is `REACHES`, and the status.
    spots: Floats
    #: Smallest |error| at which the spot leaves the aperture, shape (C, H, T); 0 if errors of the mount have it outside
    #: without; infinity if it never crosses an edge, or the mirror turns its back to the sun before it does. [rad]
    tolerance: Floats
    #: Shape (9, C, H, T): coefficients A [1], B [1], C [1], D [m], E [m], F [m^2], divided by A (by the one of largest
    #: magnitude if A is 0 to rounding, compared with B and C); eccentricity [1]; focus y and z [m] inside the branch
    #: that real rays trace, the one nearer to the mirror of the two in an ellipse. A cone that is a plane (the sun
    #: perpendicular to the axis) gives a straight line: eccentricity infinity, no focus. NaN if the curve is no conic:
    #: errors of the encoder or the pedestal with a mirror centre that moves, and of the primary axis.
    conic: Floats
    #: Shape (3, C, H, T, L): y and z [m] of the first crossing of each line and the error [rad] with its sign: of all
    #: crossings by real rays the one of smallest |error|; NaN without any.
    crossing: Floats


def deviation_curves(
    setting: Setting,
    source: ArrayLike,
    axis: ArrayLike,
    sun: ArrayLike,
    pivots: ArrayLike,
    lines: ArrayLike = (),
    sizes: ArrayLike | None = None,
    errors: ArrayLike | None = None,
) -> Curves:
    """Spots, tolerances, conics and crossings of deviation curves.

    Parameters
    ----------
    setting : Setting
        Receiver and mount of C parameter points.
    source, axis : array_like of int, shape (C,)
        `CANTING`, `ENCODER` or `TILT`; `ELEVATION`, `AZIMUTH` or `ENCODER_AZIMUTH`.
    sun : array_like, shape (C or 1, T, 3)
        Unit vectors to the sun: east, north, up. [1]
    pivots : array_like, shape (C or 1, H, 3)
        Pivots relative to the base of the tower: east, north, up. [m]
    lines : array_like, shape (L, 3)
        Coefficients l0, l1 [1] and l2 [m] of lines of detectors l0 y + l1 z = l2; l0 and l1 not both 0.
    sizes : array_like, shape (C, E), optional
        Errors eps at which spots are computed. [rad]
    errors : array_like, shape (C, 6), optional
        Errors that the mounts have already, in the order of `kinematics.ERRORS`. [rad]
    """
    points = len(setting.kind)
    sizes = np.empty((points, 0)) if sizes is None else sizes
    errors = np.zeros((points, 6)) if errors is None else errors
    sources, axes = (np.require(codes, np.int64, ["C", "W", "O"]) for codes in (source, axis))
    suns, places, angles, stood = (np.array(each, np.float64, order="C") for each in (sun, pivots, sizes, errors))
    detectors = np.array(lines, np.float64, order="C").reshape(-1, 3)
    shape = points, places.shape[1], suns.shape[1]
    shapes = (3, *shape, angles.shape[1]), shape, (9, *shape), (3, *shape, len(detectors))
    found = Curves(*(np.full(whole, np.nan) for whole in shapes))
    fill_curves(compiled_setting(setting), sources, axes, detectors, (suns, places, angles, stood), found)
    return found


@inline
def curve_of(setting, p, face, source, axis, sky, h, t):
    """Curve of parameter point p, its face, and the error, for a heliostat and an instant of `sky`."""
    sun, pivots, _, stood = sky
    i, j, e = min(p, len(sun) - 1), min(p, len(pivots) - 1), stood[p]
    s = (sun[i, t, 0], sun[i, t, 1], sun[i, t, 2])
    to_target = -pivots[j, h, 0], -pivots[j, h, 1], setting.target_height[p] - pivots[j, h, 2]
    frame = mount_frame(setting.kind[p], setting.latitude[p], setting.axis_azimuth[p], to_target)
    offsets = setting.mirror_offset[p], 0.0, setting.pedestal_height[p]
    g, a, status = aimed(mount_of((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), frame, to_target, offsets), s)
    mount = mount_of(six(e), frame, to_target, offsets)
    mirror = mirror_at(mount, g, a)
    status = MISSES if status == BLIND_CONE else status
    if not dot(face[0], to_target) < 0.0 and status in (REACHES, MISSES):
        status = BEHIND_FACE
    still, arm, about = scaled(-1.0, mount.target), mirror.arm, mirror.right
    if axis == AZIMUTH:
        about = cross(mirror.normal, mirror.right)
    elif axis == ENCODER_AZIMUTH:
        about = (0.0, 0.0, -1.0)
    if source == CANTING:
        still, arm = mixed(1.0, still, 1.0, arm), (0.0, 0.0, 0.0)
    elif source == TILT:
        still, arm = minus(still, mount.pole), mixed(1.0, arm, 1.0, mount.pole)
    about, arm = back(mount.matrix, about), back(mount.matrix, arm)
    fixed, first, second = turning(about, arm)
    centre = mixed(1.0, back(mount.matrix, still), 1.0, fixed), first, second
    return Curve(status, s, about, turning(about, back(mount.matrix, mirror.normal)), centre)


@inline
def spot_at(curve: Curve, face: Face, cosine: float, sine: float) -> tuple[float, float, int]:
    """Spot y, z [m] and status at the error of a given cosine and sine."""
    if curve.status != REACHES:
        return math.nan, math.nan, curve.status
    return trace(at_angle(curve.centre, cosine, sine), at_angle(curve.normal, cosine, sine), curve.sun, face)


@kernel
def fill_curves(
    setting: Setting,
    source: NDArray[np.int64],
    axis: NDArray[np.int64],
    lines: Floats,
    sky: tuple[Floats, Floats, Floats, Floats],
    found: Curves,
) -> None:
    """Fill the arrays of `Curves`."""
    spots, tolerance, conic, crossing = found
    for p in range(len(source)):
        # The reflected rays form a cone with its apex in a mirror centre that stays.
        stays = setting.mirror_offset[p] == 0.0 and (source[p] == ENCODER or setting.pedestal_height[p] == 0.0)
        closed = (source[p] == CANTING or stays) and axis[p] != ENCODER_AZIMUTH
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        w, h = setting.half_width[p], setting.half_height[p]
        cosine, sine, aligned = np.cos(sky[2][p]), np.sin(sky[2][p]), not np.any(sky[3][p] != 0.0)
        for i in range(tolerance.shape[1]):
            for t in range(tolerance.shape[2]):
                curve = curve_of(setting, p, face, source[p], axis[p], sky, i, t)
                for e in range(len(sine)):
                    y, z, status = spot_at(curve, face, cosine[e], sine[e])
                    spots[0, p, i, t, e], spots[1, p, i, t, e], spots[2, p, i, t, e] = y, z, status
                y, z, status = spot_at(curve, face, 1.0, 0.0)
                if status != REACHES:
                    continue
                series = spot_series(curve, face)
                if aligned or (abs(y) <= w and abs(z) <= h):
                    tolerance[p, i, t] = _tolerance(curve, series, closed, face, w, h)
                else:
                    tolerance[p, i, t] = 0.0
                if closed:
                    numbers = _conic(curve, face)
                    for m in range(9):
                        conic[m, p, i, t] = numbers[m]
                for m in range(len(lines)):
                    line = (lines[m, 0], lines[m, 1], lines[m, 2])
                    error = _crossing(curve, series, closed, aligned, face, line)
                    y, z, status = spot_at(curve, face, math.cos(error), math.sin(error))
                    if abs(error) < math.inf and status == REACHES:
                        crossing[0, p, i, t, m], crossing[1, p, i, t, m], crossing[2, p, i, t, m] = y, z, error


@inline
def _tolerance(curve: Curve, series, closed: bool, face: Face, w: float, h: float) -> float:
    """Smallest |error| at which the spot leaves the aperture. [rad]"""
    if closed:
        n = at_angle(curve.normal, 1.0, 0.0)
        return angle_of(canting_cotangent(curve.sun, n, curve.axis, curve.centre[0], face, w, h))
    edges = (
        line_series(series, (1.0, 0.0, w)),
        line_series(series, (-1.0, 0.0, w)),
        line_series(series, (0.0, 1.0, h)),
        line_series(series, (0.0, -1.0, h)),
    )
    return abs(_nearest(series, edges))


@inline
def _crossing(curve: Curve, series, closed: bool, aligned: bool, face: Face, line: Line) -> float:
    """Error of smallest magnitude at which the spot is on a line; not finite without any. [rad]"""
    if aligned and line[2] == 0.0:  # through the aim point: crossed by the spot of no error
        return 0.0
    if not closed:
        return _nearest(series, (line_series(series, line),))
    n = at_angle(curve.normal, 1.0, 0.0)
    cotangent, side = crossing_cotangent(curve.sun, n, curve.axis, curve.centre[0], face, line)
    return side * angle_of(cotangent)


@inline
def angle_of(cotangent: float) -> float:
    """Angle of a cotangent, infinite if that is -infinity. [rad]"""
    return math.atan2(1.0, cotangent) if cotangent > -math.inf else math.inf


@inline
def _nearest(series, lines) -> float:
    """Error of smallest magnitude at which the spot is real and on one of the lines, see `first_crossing`. [rad]"""
    up = first_crossing(series, lines, 1.0, math.pi)
    down = first_crossing(series, lines, -1.0, min(up, math.pi))
    if not (up == up and down == down):
        return math.nan
    return -down if down < up else up


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


def mount_spots(setting: Setting, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike) -> Floats:
    """Spots of heliostats whose mounts have errors, aimed exactly by the known errors.

    Parameters
    ----------
    setting : Setting
        Receiver and mount of P parameter combinations.
    actual : array_like, shape (P or 1, H or 1, 6)
        Errors, in the order of `kinematics.ERRORS`. [rad]
    known : array_like, shape (P or 1, H or 1, 6)
        Errors that the tracking corrects. [rad]
    sun : array_like, shape (P or 1, T, 3)
        Unit vectors to the sun: east, north, up. [1]
    pivots : array_like, shape (P or 1, H, 3)
        Pivots relative to the base of the tower: east, north, up. [m]

    Returns
    -------
    ndarray, shape (3, P, H, T)
        Spots y and z on the plane of the receiver, NaN where there is none [m], and the status of each, a code of
        `receiver`.
    """
    values, _ = sampled(setting, np.asarray(actual)[:, :, None], known, sun, pivots, tolerances=False)
    return values[..., 0]


def sampled(
    setting: Setting, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike, tolerances: bool
) -> tuple[Floats, Floats]:
    """Spots y, z [m], status and remaining tolerances [rad] of K samples of errors, shape (3 or 5, P, H, T, K).

    Also the status of aiming, shape (P, H, T). Arguments as of `mount_spots`, errors of shape (P, H, K, 6).
    """
    arrays = [np.require(value, np.float64, ["C", "W"]) for value in (actual, known, sun, pivots)]
    shape = len(setting.kind), arrays[3].shape[1], arrays[2].shape[1], arrays[0].shape[2]
    values, aiming = np.empty((5 if tolerances else 3, *shape)), np.empty(shape[:3])
    if values.size:
        fill_samples(compiled_setting(setting), *arrays, values, aiming)
    return values, aiming


@kernel
def fill_samples(
    setting: Setting, actual: Floats, known: Floats, sun: Floats, pivots: Floats, values: Floats, aiming: Floats
) -> None:
    """Fill the arrays of `sampled`."""
    commands = np.empty((values.shape[3], 4))
    for p in range(values.shape[1]):
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        offsets = setting.mirror_offset[p], setting.axis_offset[p], setting.pedestal_height[p]
        width, height = setting.half_width[p], setting.half_height[p]
        errors, corrections = actual[min(p, len(actual) - 1)], known[min(p, len(known) - 1)]
        light, places = sun[min(p, len(sun) - 1)], pivots[min(p, len(pivots) - 1)]
        for h in range(values.shape[2]):
            to_target = -places[h, 0], -places[h, 1], setting.target_height[p] - places[h, 2]
            frame = mount_frame(setting.kind[p], setting.latitude[p], setting.axis_azimuth[p], to_target)
            mount = mount_of(six(corrections[min(h, len(corrections) - 1)]), frame, to_target, offsets)
            for t in range(values.shape[3]):
                g, a, status = aimed(mount, (light[t, 0], light[t, 1], light[t, 2]))
                if status == REACHES and not -dot(face[0], to_target) > 0.0:
                    status = BEHIND_FACE
                aiming[p, h, t] = status
                commands[t, 0], commands[t, 1], commands[t, 2], commands[t, 3] = g[0], g[1], a[0], a[1]
            for k in range(values.shape[4]):
                mount = mount_of(six(errors[min(h, len(errors) - 1), k]), frame, to_target, offsets)
                for t in range(values.shape[3]):
                    status = int(aiming[p, h, t])
                    y, z, left, right = math.nan, math.nan, 0.0, 0.0
                    if status == REACHES:
                        s, c = (light[t, 0], light[t, 1], light[t, 2]), commands[t]
                        mirror = mirror_at(mount, (c[0], c[1]), (c[2], c[3]))
                        centre = back(mount.matrix, minus(mirror.arm, mount.target))
                        normal = back(mount.matrix, mirror.normal)
                        y, z, status = trace(centre, normal, s, face)
                        if len(values) > 3 and abs(y) <= width and abs(z) <= height:
                            e = cross(normal, frame[2])
                            sine = math.sqrt(dot(e, e))
                            e = scaled(1.0 / sine, e) if sine > _ALONG else frame[0]
                            left = angle_of(canting_cotangent(s, normal, e, centre, face, width, height))
                            right = angle_of(
                                canting_cotangent(s, normal, cross(e, normal), centre, face, width, height)
                            )
                    values[0, p, h, t, k], values[1, p, h, t, k], values[2, p, h, t, k] = y, z, status
                    if len(values) > 3:
                        dark = math.nan if status == NO_SUN else 0.0
                        values[3, p, h, t, k], values[4, p, h, t, k] = left + dark, right + dark


def spot_statistics(
    setting: Setting,
    actual: ArrayLike,
    known: ArrayLike,
    sun: ArrayLike,
    pivots: ArrayLike,
    percentiles: ArrayLike = (5.0, 50.0, 95.0),
) -> dict[str, Floats]:
    """Statistics of the spots that `mount_spots` makes, over samples of the errors.

    Parameters
    ----------
    setting, known, sun, pivots
        As of `mount_spots`.
    actual : array_like, shape (P or 1, H or 1, K, 6)
        K samples of the errors, at least one. [rad]
    percentiles : array_like, shape (Q,)
        Percentiles of the remaining tolerance, 0 to 100. [%]

    Returns
    -------
    dict of ndarray, shape (P, H, T)
        ``mean_y``, ``mean_z`` [m], ``variance_y``, ``variance_z``, ``covariance`` [m^2] of the spots that reach the
        plane, with n - 1 in the denominator; NaN for too few of them.
        ``real_fraction``, ``hit_fraction``: fractions of the samples whose spot reaches the plane, and lies in the
        aperture (edges included); NaN with the sun at or below the horizon. [1]
        ``status``: of the aiming, `receiver.REACHES`, `NO_SUN`, `BLIND_CONE` or `TOO_NEAR`; `BEHIND_FACE` if the
        pivot is on the plane of the receiver or behind it.
        ``tolerance``, shape (P, H, T, Q, 2): percentiles over all samples of the tolerance that remains about the
        elevation axis, unit(n x z), and about the azimuth axis of the mirror, interpolated as in `numpy.percentile`:
        0 if the spot is not in the aperture, infinity if it does not leave it, NaN with the sun at or below the
        horizon. [rad]
    """
    count = len(setting.kind), np.shape(pivots)[1]
    samples, corrected, places = (
        np.broadcast_to(each, (*count, *np.shape(each)[2:])) for each in (actual, known, pivots)
    )
    suns = np.broadcast_to(sun, (count[0], *np.shape(sun)[1:]))
    wanted, shape = np.array(percentiles, np.float64), (*count, suns.shape[1])
    moments, tolerance = np.full((len(MOMENTS), *shape), np.nan), np.full((*shape, len(wanted), 2), np.nan)
    step = max(1, _MOST // samples.shape[2])
    for p, h in np.ndindex(*shape[:2]):
        ours, theirs, here = (each[p : p + 1, h : h + 1] for each in (samples, corrected, places))
        one = Setting._make(values[p : p + 1] for values in setting)
        for first in range(0, shape[2], step):
            part = slice(first, first + step)
            values, aiming = sampled(one, ours, theirs, suns[p : p + 1, part], here, tolerances=len(wanted) > 0)
            (y, z, _, *angles), status = values[:, 0, 0], aiming[0, 0]
            size = float(one.half_width[0]), float(one.half_height[0])
            moments[:, p, h, part] = *_moments(y, z, status, *size), status
            for axis, angle in enumerate(angles):
                tolerance[p, h, part, :, axis] = angle_percentiles(angle, wanted).T
    return dict(zip(MOMENTS, moments, strict=True)) | {"tolerance": tolerance}


def _moments(y: Floats, z: Floats, status: Floats, width: float, height: float) -> list[Floats]:
    """Mean, variances and covariance of the spots that are not NaN, and fractions, in the order of `MOMENTS`."""
    real = ~np.isnan(y)
    count = np.count_nonzero(real, axis=-1)
    hits = np.count_nonzero((np.abs(y) <= width) & (np.abs(z) <= height), axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_y, mean_z = (np.sum(np.where(real, each, 0.0), axis=-1) / count for each in (y, z))
        off_y, off_z = (np.where(real, each - mean[:, None], 0.0) for each, mean in ((y, mean_y), (z, mean_z)))
        products = [np.sum(a * b, axis=-1) for a, b in ((off_y, off_y), (off_z, off_z), (off_y, off_z))]
        seconds = [np.where(count > 1, product / (count - 1), np.nan) for product in products]
    dark = np.where(status == NO_SUN, np.nan, 0.0)
    return [mean_y, mean_z, *seconds, count / y.shape[-1] + dark, hits / y.shape[-1] + dark]


def angle_percentiles(angles: Floats, percentiles: Floats) -> Floats:
    """Percentiles of angles along the last axis, percentiles first; infinite angles are larger than all others."""
    found = np.percentile(np.minimum(angles, _ENDLESS), percentiles, axis=-1)
    return np.where(found > 10.0, np.inf, found)

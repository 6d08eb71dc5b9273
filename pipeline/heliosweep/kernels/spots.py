"""Spots of misaligned mirrors: deviation curves of single errors, and spots of mounts with all errors.

**Curve**. A mount aims as if it had no errors. The actual errors of the mount determine the mirror centre P and the
normal n. The mirror has two axes: the elevation axis e, which is horizontal if the primary axis z is vertical and has
no errors, and the axis b = e x n up the slope. An error eps rotates the normal about the axis a:

    n(eps) = Rot(a, eps) n

where a is e for elevation errors, -b for azimuth errors and -z for encoder azimuth errors. A positive elevation error
raises the normal. A positive azimuth or encoder azimuth error rotates the normal clockwise, seen from the end of the
primary axis.

The mirror centre is fixed or moves, depending on the source of the error:

    canting: P is fixed
    encoder: P(eps) = C + Rot(a, eps) (P - C)
    tilt:    P(eps) = B + Rot(a, eps) (P - B)

where C is the pivot and B the base of the pedestal. A vector v that rotates about a becomes v0 + v1 cos eps + v2 sin
eps with v0 = a (a.v), v1 = v - v0, v2 = a x v. The reflected ray is R = 2 (S.n) n - S; for an axis a in the mirror,
R(eps) = Rot(a, 2 eps) R(0). The equations follow Optics Express 27 (8), A257 (2019), Sect. 3, in a right-handed frame.

**Tolerance**: the tolerance is the minimum error at which the spot of a mirror leaves the aperture. With the mirror
centre p relative to the aim point and the reflected ray R, the homogeneous coordinates of the spot are

    U = Z.(p x R),  V = -Y.(p x R),  W = -X.R,   spot (y, z) = (U, V) / W,   real where W > 0

The spot lies on the line l0 y + l1 z = l2 if g = l2 W - l0 U - l1 V = 0; the four edges of the aperture are the lines
(1, 0, w), (-1, 0, w), (0, 1, h), (0, -1, h). The values of g for the four edges are positive as long as the spot is
inside the aperture. The sum of g for the first two edges is 2 w W, which implies W > 0. The tolerance is therefore the
minimum magnitude of all positive and negative roots of the four functions g, and no scan of errors is needed. Only
roots at which the mirror is lit (S.n > 0) are considered.

If the mirror centre is fixed and the axis a is in the mirror, R(eps) = Rot(a, 2 eps) R(0). Because g is linear in R,
g = c0 + c1 cos 2 eps + c2 sin 2 eps. The roots of g are

    cot eps = (-c2 +- sqrt(c2^2 - (c0 - c1) (c0 + c1))) / (c0 + c1)

R has the period pi, and the mirror is lit at only one of the angles eps + j pi. At this angle, cot |eps| equals cot eps
times the sign of (S.n) cot eps + S.(a x n). The cotangent of the tolerance is the maximum of these cotangents over the
edges and roots.

If the mirror centre moves, or if a is the primary axis, g is a trigonometric polynomial of degree 2 or 3, whose
coefficients are products of the coefficients of R and p. The search for a root starts at zero error and proceeds in
steps along the error. The step h is a lower bound on the distance to the next root, given by g + g' h - M h^2 / 2 = 0.
The bound M on |g''| is the sum of the amplitudes, each multiplied by the square of its degree. The search therefore
cannot miss a root. Close to a root, the search converges as fast as Newton's method.

**Conic**: for an axis a in the mirror, the reflected rays satisfy a.R = -a.S = k. The rays form a cone whose apex p is
the mirror centre. On the receiver plane, the points x = y Y + z Z of the trace, relative to the aim point, satisfy

    (x - p)^T m (x - p) = 0,  m = a a^T - k^2 I:   A y^2 + B y z + C z^2 + D y + E z + F = 0

    A = m_yy,  B = 2 m_yz,  C = m_zz,  D = -2 (m p)_y,  E = -2 (m p)_z,  F = p^T m p

The discriminant is B^2 - 4 A C = 4 k^2 (1 - a_x^2 - k^2), and the eccentricity is sqrt(1 - a_x^2) / |k|. Rays run along
the half of the cone on which a.(x - p) has the sign of k. The Dandelin sphere inside this half, between the apex and
the plane, touches the plane at a focus inside the branch that the rays trace. The centre of this sphere is p + s
sign(k) a with s = X.p / (sqrt(1 - k^2) - sign(k) a_x).

**Crossings**: a heliostat that has reflecting cylinders on its facets, or that sweeps through a range of errors, traces
a whole deviation curve. Detectors along lines l0 y + l1 z = l2 measure where the deviation curve crosses the lines
(Optics Express 27 (8), A257 (2019), Sect. 4.3).

**Mounts**: a mount corrects the known errors when it aims. The actual errors rotate the mirror and move its centre.

This module also computes statistics of spots over samples of the errors, without storing the spots. The statistics are
the mean, the variances and the covariance of the spots on the receiver plane. Further statistics are percentiles of the
remaining tolerance, the fraction of samples whose spot reaches the plane, and the fraction of samples whose spot lies
in the aperture. The remaining tolerance is the angle by which the mirror can rotate about its elevation or azimuth
axis, with a fixed centre, before the spot leaves the aperture.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import Floats, inline, inner, kernel
from heliosweep.kernels.mounts import (
    BEHIND_FACE,
    BLIND_CONE,
    MISSES,
    NO_SUN,
    REACHES,
    Matrix,
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
from heliosweep.kernels.vectors import Vector, at_angle, cross, dot, minus, mixed, scaled, three, turning

#: Error sources. `CANTING`: The facet is rotated about its fixed centre.
#: `ENCODER`: The mirror rotates about its pivot. `TILT`: The pedestal rotates about its base.
CANTING, ENCODER, TILT = range(3)

#: Error axes. `ELEVATION`: The elevation axis e in the mirror.
#: `AZIMUTH`: The axis -b, down the slope of the mirror. `ENCODER_AZIMUTH`: The reversed primary axis, -z.
ELEVATION, AZIMUTH, ENCODER_AZIMUTH = range(3)

#: Coefficients of a trigonometric polynomial of the error: 1, cos, sin, cos 2, sin 2, cos 3 and sin 3.
Series = tuple[float, float, float, float, float, float, float]

#: Lines along the right, left, top and bottom edges of an aperture, without the distances of the edges.
_EDGES = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))
#: Maximum number of steps in a search along the error. All searches in the tests need fewer steps.
_STEPS = 10_000
#: Maximum length of the last step. The remaining error is of second order and smaller than rounding errors. [rad]
_LAST_STEP = 1e-9
#: Minimum sine of the angle between a ray and the plane. Below this value, rounding errors determine the spot. [1]
_PARALLEL = 1e-12
MOMENTS = ("mean_y", "mean_z", "variance_y", "variance_z", "covariance", "real_fraction", "hit_fraction", "status")


class Curve(NamedTuple):
    """Normal and centre of a mirror at an instant, as functions of an error with a given axis and source."""

    #: A status code from `mounts`. The other fields are undefined unless the status is `REACHES`.
    status: int
    #: Unit vector to the sun. [1]
    sun: Vector
    #: Unit vector a, the axis of rotation of the error. [1]
    axis: Vector
    #: Unit normal as a function of the error: coefficients v0, v1 and v2. [1]
    normal: Matrix
    #: Mirror centre relative to the aim point, as a function of the error: coefficients v0, v1 and v2. [m]
    centre: Matrix


class Curves(NamedTuple):
    """Deviation curves for C parameter points, H heliostats and T instants.

    All fields except the spots are NaN if the error-free spot does not reach the plane.
    """

    #: Coordinates y and z of spots [m], NaN unless the status is `REACHES`, and the status, shape (3, C, H, T, E).
    spots: Floats
    #: Minimum |error| at which the spot leaves the aperture, shape (C, H, T). [rad]
    #: The tolerance is 0 if the errors of the mount already move the spot out of the aperture.
    #: The tolerance is infinite if the spot never crosses an edge.
    #: The tolerance is also infinite if the mirror turns away from the sun before the spot crosses an edge.
    tolerance: Floats
    #: Conic of the curve, shape (9, C, H, T): coefficients, eccentricity [1], and focus y and z [m].
    #: The coefficients are A [1], B [1], C [1], D [m], E [m] and F [m^2].
    #: The coefficients are divided by A, unless A is negligible compared with B and C.
    #: If A is negligible, the coefficients are divided by the coefficient of maximum magnitude.
    #: The focus lies inside the branch that real rays trace. For an ellipse, the focus nearer to the mirror is given.
    #: If the sun is perpendicular to the axis, the cone is a plane, and the curve is a straight line.
    #: A straight line has infinite eccentricity and no focus. All values are NaN if the curve is not a conic.
    #: The curve is not a conic for errors about the primary axis, or for errors that move the mirror centre.
    conic: Floats
    #: First crossing of each line, shape (3, C, H, T, L): y and z [m], and the error with its sign [rad].
    #: The first crossing is the crossing by real rays with the minimum |error|; NaN if there is no crossing.
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
    """Compute spots, tolerances, conics and crossings of deviation curves.

    Parameters
    ----------
    setting : Setting
        Receiver and mount for each of C parameter points.
    source, axis : array_like of int, shape (C,)
        Source of the error (`CANTING`, `ENCODER` or `TILT`) and axis of the error (`ELEVATION`, `AZIMUTH` or
        `ENCODER_AZIMUTH`).
    sun : array_like, shape (C or 1, T, 3)
        Unit vectors to the sun: east, north, up. [1]
    pivots : array_like, shape (C or 1, H, 3)
        Pivots relative to the base of the tower: east, north, up. [m]
    lines : array_like, shape (L, 3)
        Coefficients l0, l1 [1] and l2 [m] of the detector lines l0 y + l1 z = l2. l0 and l1 must not both be 0.
    sizes : array_like, shape (C, E), optional
        Errors eps at which spots are computed. [rad]
    errors : array_like, shape (C, 6), optional
        Existing mount errors, in the order of `mounts.ERRORS`. [rad]
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
    # If the mirror centre is fixed, the reflected rays form a cone whose apex is this centre.
    stays = (setting.mirror_offset == 0.0) & ((sources == ENCODER) | (setting.pedestal_height == 0.0))
    closed = ((sources == CANTING) | stays) & (axes != ENCODER_AZIMUTH)
    fill_curves(compiled_setting(setting), sources, axes, closed, detectors, (suns, places, angles, stood), found)
    return found


@inline
def curve_of(setting, p, face, source, axis, sky, h, t):
    """Return the deviation curve of parameter point p, heliostat h and instant t.

    `sky` contains the sun vectors, the pivots, the error sizes, and the existing mount errors.
    """
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
def spot_at(curve: Curve, face: Matrix, cosine: float, sine: float) -> tuple[float, float, int]:
    """Return the coordinates y, z [m] and the status of the spot, for the cosine and sine of an error."""
    if curve.status != REACHES:
        return math.nan, math.nan, curve.status
    return trace(at_angle(curve.centre, cosine, sine), at_angle(curve.normal, cosine, sine), curve.sun, face)


@kernel
def fill_curves(
    setting: Setting,
    source: NDArray[np.int64],
    axis: NDArray[np.int64],
    closed: NDArray[np.bool_],
    lines: Floats,
    sky: tuple[Floats, Floats, Floats, Floats],
    found: Curves,
) -> None:
    """Write the arrays of `Curves`."""
    spots, tolerance, conic, crossing = found
    edges, work = np.array(_EDGES), np.empty((4, 8))
    for p in range(len(source)):
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        w, h = setting.half_width[p], setting.half_height[p]
        edges[:2, 2], edges[2:, 2] = w, h
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
                series, tolerance[p, i, t] = spot_series(curve, face), 0.0
                if aligned or (abs(y) <= w and abs(z) <= h):
                    tolerance[p, i, t] = abs(nearest(curve, series, closed[p], face, edges, work))
                if closed[p]:
                    write_conic(curve, face, conic[:, p, i, t])
                for m in range(len(lines)):
                    error = 0.0
                    if not aligned or lines[m, 2] != 0.0:  # otherwise the line passes through the spot without error
                        error = nearest(curve, series, closed[p], face, lines[m : m + 1], work)
                    y, z, status = spot_at(curve, face, math.cos(error), math.sin(error))
                    if abs(error) < math.inf and status == REACHES:
                        crossing[0, p, i, t, m], crossing[1, p, i, t, m], crossing[2, p, i, t, m] = y, z, error


@inline
def angle_of(cotangent: float) -> float:
    """Return the angle with a given cotangent, infinite if the cotangent is -infinity. [rad]"""
    return math.atan2(1.0, cotangent) if cotangent > -math.inf else math.inf


@inline
def write_conic(curve: Curve, face: Matrix, out: Floats) -> None:
    """Write the coefficients, eccentricity and focus of the conic of a curve."""
    a, p = curve.axis, curve.centre[0]
    k = -dot(a, curve.sun)
    ax, ay, az = dot(face[0], a), dot(face[1], a), dot(face[2], a)
    px, py, pz = dot(face[0], p), dot(face[1], p), dot(face[2], p)
    along = dot(a, p)
    first, second, third = ay * ay - k * k, 2.0 * ay * az, az * az - k * k
    fourth, fifth = -2.0 * (ay * along - k * k * py), -2.0 * (az * along - k * k * pz)
    sixth = along * along - k * k * dot(p, p)
    scale = first
    if abs(first) <= 1e-12 * max(abs(second), abs(third)):
        for other in (second, third, fourth, fifth, sixth):
            scale = other if abs(other) > abs(scale) else scale
    out[0], out[1], out[2], out[3] = first / scale, second / scale, third / scale, fourth / scale
    out[4], out[5], out[6] = fifth / scale, sixth / scale, math.inf
    if abs(k) > 1e-14:  # if k is 0, the cone is a plane
        sign = math.copysign(1.0, k)
        s = sign * px / (math.sqrt(max(1.0 - k * k, 0.0)) - sign * ax)
        out[6] = math.sqrt(max(ay * ay + az * az, 0.0)) / abs(k)
        out[7], out[8] = py + s * ay, pz + s * az


@inner
def canting_cotangent(
    sun: Vector, normal: Vector, axis: Vector, centre: Vector, face: Matrix, half_width: float, half_height: float
) -> float:
    """Return the cotangent of the tolerance to errors about an axis in the mirror, for a fixed mirror centre.

    `sun`, `normal` and `axis` are unit vectors to the sun, along the mirror normal, and along an axis perpendicular to
    the normal [1]. `centre` is the mirror centre relative to the aim point [m]. `half_width` and `half_height` are half
    the sides of the aperture along Y and Z [m]. The tolerance is atan2(1, cotangent), or infinite if the cotangent is
    -infinity. The error-free spot must be real and inside the aperture.
    """
    # Four separate calls are used, because a loop would not be vectorised.
    right, _ = crossing_cotangent(sun, normal, axis, centre, face, (1.0, 0.0, half_width))
    left, _ = crossing_cotangent(sun, normal, axis, centre, face, (-1.0, 0.0, half_width))
    top, _ = crossing_cotangent(sun, normal, axis, centre, face, (0.0, 1.0, half_height))
    bottom, _ = crossing_cotangent(sun, normal, axis, centre, face, (0.0, -1.0, half_height))
    return max(max(right, left), max(top, bottom))


@inline
def crossing_cotangent(
    sun: Vector, normal: Vector, axis: Vector, centre: Vector, face: Matrix, line: Vector
) -> tuple[float, float]:
    """Return the cotangent and sign of the minimum error at which the spot is on a line, for a fixed mirror centre.

    The parameters are as in `canting_cotangent`. The result contains the cotangent of the minimum |error| at which the
    spot is real and on the line, and the sign of this error. The cotangent is -infinity if there is no such error.
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
def _homogeneous(p: Vector, r: Vector, face: Matrix) -> Vector:
    """Return the homogeneous coordinates U, V [m] and W [1] of the spot of a ray r from p."""
    moment = cross(p, r)
    return dot(face[2], moment), -dot(face[1], moment), -dot(face[0], r)


@inline
def spot_series(curve: Curve, face: Matrix) -> tuple[Series, Series, Series, Series]:
    """Return S.n and the spot coordinates U, V and W as trigonometric polynomials of the error."""
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
    """Return the series of sign * axis.(p x R) = R.(sign * axis x p)."""
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
def value_and_slope(series, c, s):
    """Return a trigonometric polynomial and its derivative at the angle with cosine c and sine s."""
    c2, s2 = c * c - s * s, 2.0 * c * s
    c3, s3 = c * c2 - s * s2, s * c2 + c * s2
    value = series[0] + (series[1] * c + series[2] * s) + (series[3] * c2 + series[4] * s2)
    slope = (series[2] * c - series[1] * s) + 2.0 * (series[4] * c2 - series[3] * s2)
    return value + (series[5] * c3 + series[6] * s3), slope + 3.0 * (series[6] * c3 - series[5] * s3)


@inner
def nearest(curve: Curve, series, closed: bool, face: Matrix, lines: Floats, polynomials: Floats) -> float:
    """Return the error of minimum magnitude at which the spot is real and on one of at most four lines. [rad]

    `series` is the `spot_series` of the curve, `lines` contains coefficients of lines, and `polynomials` is a work
    array of shape (4, 8). `closed` is True if the reflected rays form a cone. The result is infinite if there is no
    such error, and NaN if a search does not converge.
    """
    best, side = -math.inf, 1.0
    if closed:
        n = at_angle(curve.normal, 1.0, 0.0)
        for m in range(len(lines)):
            found, sign = crossing_cotangent(curve.sun, n, curve.axis, curve.centre[0], face, three(lines[m]))
            if found > best:
                best, side = found, sign
        return side * angle_of(best)
    _, u, v, w = series
    for m in range(len(lines)):  # the polynomials g of the lines, and bounds on their second derivatives
        g = polynomials[m]
        for k in range(7):
            g[k] = lines[m, 2] * w[k] - lines[m, 0] * u[k] - lines[m, 1] * v[k]
        g[7] = math.sqrt(g[1] * g[1] + g[2] * g[2]) + 4.0 * math.sqrt(g[3] * g[3] + g[4] * g[4])
        g[7] += 9.0 * math.sqrt(g[5] * g[5] + g[6] * g[6])
    best = math.inf
    for side in (1.0, -1.0):
        error = side * first_crossing(series, polynomials[: len(lines)], side, min(abs(best), math.pi))
        best = error if abs(error) < abs(best) or error != error else best  # NaN has precedence
    return best


@inline
def first_crossing(series, lines, side: float, limit: float) -> float:
    """Return the minimum |error| of sign `side` at which the spot is real and on one of the lines. [rad]

    `lines` contains the polynomials and bounds of `nearest`. If there is more than one line (edges of an aperture), g
    of the error-free spot must be positive for all lines. In this case, no virtual crossing can precede the first real
    crossing. The result is infinite if there is no crossing up to `limit` [rad], or if the mirror turns away from the
    sun before the crossing. The result is NaN if the search along the error does not converge within `_STEPS` steps.
    """
    error, sign, cosine, sine, bright = 0.0, 0.0, 1.0, 0.0, 0.0
    for _ in range(_STEPS):
        to_root, past_root = math.inf, 0.0
        for m in range(len(lines)):
            g, slope = value_and_slope(lines[m], cosine, sine)
            if sign == 0.0:
                sign = 1.0 if g >= 0.0 else -1.0
            earliest = _earliest_root(sign * g, sign * side * slope, lines[m, 7])
            if earliest < to_root:
                to_root, past_root = earliest, abs(slope) / lines[m, 7]
        if to_root < _LAST_STEP:
            ahead, _ = value_and_slope(series[3], cosine, sine)
            if ahead > _PARALLEL:
                return error + to_root if error + to_root <= limit else math.inf
            # The curve crosses the line on the virtual branch; the next crossing is at least 2 |g'| / M away.
            # The sign of g is computed again beyond the crossing, because the curve may only touch the line.
            sign = 0.0
            to_root = max(past_root, _LAST_STEP)
        if error + to_root > bright:  # the mirror is lit for all errors up to `bright`
            lit, slope = value_and_slope(series[0], cosine, sine)
            if not lit > 1e-12:  # the mirror faces away from the sun
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
    """Return a lower bound on the distance to a root of a function with a bounded second derivative."""
    if not value > 0.0:
        return 0.0
    root = math.sqrt(slope * slope + 2.0 * bound * value)
    return 2.0 * value / (root - slope) if slope < 0.0 else (slope + root) / bound


def mount_spots(setting: Setting, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike) -> Floats:
    """Compute the spots of heliostats with mount errors; the tracking corrects the known errors exactly.

    Parameters
    ----------
    setting : Setting
        Receiver and mount for each of P parameter combinations.
    actual : array_like, shape (P or 1, H or 1, 6)
        Actual mount errors, in the order of `mounts.ERRORS`. [rad]
    known : array_like, shape (P or 1, H or 1, 6)
        Errors that the tracking corrects. [rad]
    sun : array_like, shape (P or 1, T, 3)
        Unit vectors to the sun: east, north, up. [1]
    pivots : array_like, shape (P or 1, H, 3)
        Pivots relative to the base of the tower: east, north, up. [m]

    Returns
    -------
    ndarray, shape (3, P, H, T)
        Spot coordinates y and z on the receiver plane [m], NaN if there is no spot, and a status code from `mounts`.
    """
    values, _ = sampled(setting, np.asarray(actual)[:, :, None], known, sun, pivots, tolerances=False)
    return values[..., 0]


def sampled(
    setting: Setting, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike, tolerances: bool
) -> tuple[Floats, Floats]:
    """Return spots y, z [m], status and remaining tolerances [rad] for K error samples, shape (3 or 5, P, H, T, K).

    Also returns the aiming status, shape (P, H, T). The arguments are as in `mount_spots`, but `actual` has shape (P,
    H, K, 6).
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
    """Write the arrays of `sampled`."""
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
                            e = scaled(1.0 / sine, e) if sine > 1e-12 else frame[0]
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
    """Compute statistics of the spots of `mount_spots` over samples of the errors.

    Parameters
    ----------
    setting, known, sun, pivots
        As in `mount_spots`.
    actual : array_like, shape (P or 1, H or 1, K, 6)
        K samples of the actual errors, with K at least 1. [rad]
    percentiles : array_like, shape (Q,)
        Percentiles of the remaining tolerance, 0 to 100. [%]

    Returns
    -------
    dict of ndarray, shape (P, H, T)
        The dictionary contains these arrays:

        - ``mean_y``, ``mean_z``: mean coordinates of the spots that reach the plane; NaN without such spots. [m]
        - ``variance_y``, ``variance_z``, ``covariance``: variances and covariance of these coordinates, with n - 1 in
          the denominator; NaN if fewer than two spots reach the plane. [m^2]
        - ``real_fraction``: fraction of the samples whose spot reaches the plane. [1]
        - ``hit_fraction``: fraction of the samples whose spot lies in the aperture, including its edges. [1]
        - ``status``: aiming status, `mounts.REACHES`, `NO_SUN`, `BLIND_CONE` or `TOO_NEAR`; `BEHIND_FACE` if the pivot
          is on the receiver plane or behind it.
        - ``tolerance``, shape (P, H, T, Q, 2): percentiles of the remaining tolerance about the elevation axis,
          unit(n x z), and about the azimuth axis of the mirror, interpolated as in `numpy.percentile`. The tolerance of
          a sample is 0 if its spot is not in the aperture, and infinite if its spot never leaves the aperture. [rad]

        Fractions and tolerances are NaN if the sun is at or below the horizon.
    """
    sizes = len(setting.kind), np.shape(pivots)[1]
    samples, corrected, places = (
        np.broadcast_to(each, (*sizes, *np.shape(each)[2:])) for each in (actual, known, pivots)
    )
    suns = np.broadcast_to(sun, (sizes[0], *np.shape(sun)[1:]))
    wanted, shape = np.array(percentiles, np.float64), (*sizes, suns.shape[1])
    moments, tolerance = np.full((len(MOMENTS), *shape), np.nan), np.full((*shape, len(wanted), 2), np.nan)
    step = max(1, 100_000 // samples.shape[2])  # number of instants per batch, to limit memory use
    for p, h in np.ndindex(*shape[:2]):
        ours, theirs, here = (each[p : p + 1, h : h + 1] for each in (samples, corrected, places))
        one = Setting._make(values[p : p + 1] for values in setting)
        for first in range(0, shape[2], step):
            part = slice(first, first + step)
            values, aiming = sampled(one, ours, theirs, suns[p : p + 1, part], here, tolerances=len(wanted) > 0)
            (y, z, _, *angles), status = values[:, 0, 0], aiming[0, 0]
            real, dark = ~np.isnan(y), np.where(status == NO_SUN, np.nan, 0.0)
            count = np.count_nonzero(real, axis=-1)
            inside = (np.abs(y) <= one.half_width[0]) & (np.abs(z) <= one.half_height[0])
            with np.errstate(divide="ignore", invalid="ignore"):
                means = [np.sum(np.where(real, each, 0.0), axis=-1) / count for each in (y, z)]
                off_y, off_z = (
                    np.where(real, each - mean[:, None], 0.0) for each, mean in zip((y, z), means, strict=True)
                )
                products = [np.sum(a * b, axis=-1) for a, b in ((off_y, off_y), (off_z, off_z), (off_y, off_z))]
                seconds = [np.where(count > 1, product / (count - 1), np.nan) for product in products]
            shares = [number / y.shape[-1] + dark for number in (count, np.count_nonzero(inside, axis=-1))]
            moments[:, p, h, part] = *means, *seconds, *shares, status
            for axis, angle in enumerate(angles):
                # Infinite angles rank above all finite angles.
                ranked = np.percentile(np.minimum(angle, 1e300), wanted, axis=-1).T
                tolerance[p, h, part, :, axis] = np.where(ranked > 10.0, np.inf, ranked)
    return dict(zip(MOMENTS, moments, strict=True)) | {"tolerance": tolerance}

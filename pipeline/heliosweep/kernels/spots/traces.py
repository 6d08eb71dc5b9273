"""Traces of the reflecting cylinders of a heliostat on the receiver's plane, and where detectors see them.

Two small cylinders (or rotating prisms) stand in the middle of the mirror, one along its elevation axis e, one along
the line b up its slope. One with the axis a reflects the sun's rays as a mirror at every angle about a does: with the
mirror centre p and the direction S to the sun, to all points x of the plane with

    F(x) = a.(S + v / |v|) = 0,   v = x - p

Detectors stand along straight pieces x = q + s d of the plane. With c = q - p and k = -a.S the trace crosses at

    ((a.d)^2 - k^2) s^2 + 2 ((a.c)(a.d) - k^2 c.d) s + (a.c)^2 - k^2 |c|^2 = 0,   a.v of the sign of k,

whose discriminant is k^2 (|(a.d) c - (a.c) d|^2 - k^2 |c - (c.d) d|^2): k is 0 where the sun and the mirror's way to
the aim lie in a plane across the axis, as at noon due north of the tower, and both roots are then one.
and the cylinder's normal there is along S + v / |v|. After Optics Express 27 (8), A257 (2019), Sect. 2 and 4.3.

How a mount with errors stands follows from the chain of rotations of `heliosweep.kernels.mounts.aiming`; e and b are
those of the mirror as it stands, and turn with every error. Errors turn a mirror about axes w: a changes by w x a, the
centre by w x (its way from the axis). From these derivatives `fit` estimates errors by least squares; its residuals
F / F' are distances along the detectors, to first order.

Everything is NumPy; arguments broadcast, with three numbers of each vector last.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.spots.calibration import DEPENDENT, ESTIMATED, INDISTINCT, NOT_CONVERGED, TOO_FEW

ELEVATION, AZIMUTH = 0, 1
"""Traces: of the cylinder along the elevation axis, which errors about it move along itself, and of the other."""

GRAZING = 0.05
"""Sine of the angle between a trace and an array, as seen from the mirror, below which their crossing tells nothing."""
_SAME = 1e-9
"""Sines below this are rounding, and crossings that are no farther apart, as seen from the mirror, are one."""
_ENDS = 1e-12
"""Rounding of a crossing, as seen from the mirror, by which it may lie beyond the end of a piece."""
_NEWTON = 2
"""Newton's steps that take a closed-form crossing to rounding."""
_STEPS = 40
_LAST_STEP = 1e-13
"""Step of least squares after which the next is below rounding. [rad]"""
_RANK = 1e-9
"""Ratio of the singular values below which errors cannot be told apart."""


class Stand(NamedTuple):
    """How mirrors stand: unit vectors [1] and ways [m], shape (..., 3)."""

    normal: Floats
    right: Floats
    """Elevation axis e in the mirror."""
    up: Floats
    """Up the slope of the mirror, b = e x n."""
    primary: Floats
    secondary: Floats
    """Axes of the mount."""
    askew: Floats
    """Axis about which non-orthogonality turns."""
    east: Floats
    north: Floats
    """Axes about which the tilts turn at the tilt that is there."""
    bore: Floats
    """From the second axis to the mirror centre."""
    arm: Floats
    """From the pivot to the mirror centre."""
    pole: Floats
    """From the base to the pivot."""
    centre: Floats
    """Mirror centre relative to the aim point."""

    @property
    def axes(self) -> Floats:
        """Axes of the cylinders, shape (..., 2, 3), in the order of `ELEVATION`, `AZIMUTH`."""
        return np.stack([self.right, self.up], axis=-2)

    def rows(self) -> Floats:
        """The same as kernels of curves take it, shape (..., 15), see `deviation.STAND`."""
        vectors = np.broadcast_arrays(self.normal, self.right, self.primary, self.arm, self.pole)
        return np.concatenate(vectors, axis=-1)


def dot(a: Floats, b: Floats) -> Floats:
    """Scalar products of the last axis."""
    product: Floats = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return product


def _unit(vectors: Floats) -> Floats:
    length: Floats = np.sqrt(dot(vectors, vectors))[..., np.newaxis]
    return vectors / length


def _mixed(*terms: tuple[Floats, Floats]) -> Floats:
    """Sum of scalars times vectors."""
    first, *others = (factor[..., np.newaxis] * vector for factor, vector in terms)
    for other in others:
        first = first + other
    return first


def stand(
    frame: Floats, angles: Floats, errors: Floats, to_target: Floats, offsets: tuple[float, float, float]
) -> Stand:
    """Mirrors of mounts with errors at commanded angles.

    Parameters
    ----------
    frame : ndarray, shape (..., 3, 3)
        Rows of the frames of the mounts, from `heliosweep.kernels.mounts.aiming.mount_frames`. [1]
    angles : ndarray, shape (..., 2)
        Commanded angles of the primary axis, clockwise, and of the secondary, up. [rad]
    errors : ndarray, shape (..., 6)
        Errors in the order of `heliosweep.kernels.mounts.kinematics.ERRORS`. [rad]
    to_target : ndarray, shape (..., 3)
        From the pivots to the aim point. [m]
    offsets : tuple of float
        Mirror offset along the bore, axis offset, height of the pivot above the base. [m]
    """
    r, q, h = offsets
    g, a = angles[..., 0] + errors[..., 0], angles[..., 1] + errors[..., 1]
    e, n, eta, mu = (errors[..., index] for index in range(2, 6))
    square = e * e + n * n
    small = square < 1e-4
    safe = np.where(small, 1.0, square)
    root = np.sqrt(safe)
    u = np.where(small, 1 + square * (-1 / 6 + square * (1 / 120 - square / 5040)), np.sin(root) / root)
    v = np.where(small, 0.5 + square * (-1 / 24 + square * (1 / 720 - square / 40320)), (1 - np.cos(root)) / safe)
    third = np.where(small, 1 / 6 + square * (-1 / 120 + square / 5040), (1 - u) / safe)

    def world(x: Floats, y: Floats, z: Floats) -> Floats:
        return _mixed((x, frame[..., 0, :]), (y, frame[..., 1, :]), (z, frame[..., 2, :]))

    def leaned(x: Floats, y: Floats, z: Floats, u: Floats = u, v: Floats = v) -> Floats:
        """(1 + u K + v K^2) of a vector in the frame of the mount, with K the product with (e, n, 0) from the left."""
        across = n * z, -e * z, e * y - n * x
        along = e * x + n * y
        rest = e * along - square * x, n * along - square * y, -square * z
        return world(*(c + u * k + v * kk for c, k, kk in zip((x, y, z), across, rest, strict=True)))

    one, none = np.ones_like(g), np.zeros_like(g)
    x, y, primary = leaned(np.cos(g), -np.sin(g), none), leaned(np.sin(g), np.cos(g), none), leaned(none, none, one)
    secondary = _mixed((np.cos(eta), x), (-np.sin(eta), primary))
    top = _mixed((np.sin(eta), x), (np.cos(eta), primary))
    bore = _mixed((np.cos(a), y), (np.sin(a), top))
    up = _mixed((-np.sin(a), y), (np.cos(a), top))
    pole = h * leaned(*(frame[..., row, 2] for row in range(3)))
    arm = q * y + r * bore
    base = -to_target - np.array([0.0, 0.0, h])
    return Stand(
        normal=_mixed((np.sin(mu), secondary), (np.cos(mu), bore)),
        right=_mixed((np.cos(mu), secondary), (-np.sin(mu), bore)),
        up=up,
        primary=primary,
        secondary=secondary,
        askew=y,
        east=leaned(one, none, none, v, third),
        north=leaned(none, one, none, v, third),
        bore=r * bore,
        arm=arm,
        pole=pole,
        centre=base + pole + arm,
    )


def reflected(normal: Floats, sun: Floats) -> Floats:
    """Rays of the sun that mirrors reflect. [1]"""
    rays: Floats = 2.0 * dot(normal, sun)[..., np.newaxis] * normal - sun
    return rays


def spots(centre: Floats, rays: Floats, face: Floats) -> Floats:
    """Points y, z where rays meet the plane of the face (rows X, Y, Z), shape (..., 2); NaN where one does not. [m]"""
    before, towards = dot(centre, face[0]), -dot(rays, face[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        length = np.where((before > 0) & (towards > 0), before / towards, np.nan)
    points = centre + length[..., np.newaxis] * rays
    return np.stack([dot(points, face[1]), dot(points, face[2])], axis=-1)


def beam_outline(centre: Floats, ray: Floats, face: Floats, half_angle: float, count: int) -> Floats:
    """Outline of the spot of a beam that opens as a cone about its ray, shape (..., count, 2). [m]

    The half angle is in rad. NaN where one of its rays does not meet the plane.
    """
    side = _unit(np.cross(ray, face[2]))
    turn = 2.0 * np.pi * np.arange(count) / count
    around = np.cos(turn)[:, np.newaxis] * side[..., np.newaxis, :]
    around = around + np.sin(turn)[:, np.newaxis] * np.cross(ray, side)[..., np.newaxis, :]
    rays = np.cos(half_angle) * ray[..., np.newaxis, :] + np.sin(half_angle) * around
    return spots(centre[..., np.newaxis, :], rays, face)


def _cosine_error(axis: Floats, sun: Floats, v: Floats) -> Floats:
    """F: sine of the angle by which the bisector of sun and v leans towards the axis, times its length."""
    return dot(axis, sun + _unit(v))


def _slope(axis: Floats, v: Floats, along: Floats) -> Floats:
    """Derivative of F along the plane's direction `along`. [1/m]"""
    square = dot(v, v)
    return (dot(axis, along) - dot(axis, v) * dot(v, along) / square) / np.sqrt(square)


def crossings(mirror: Stand, sun: Floats, start: Floats, along: Floats, ends: Floats) -> tuple[Floats, Floats]:
    """All crossings of both traces and straight pieces of detectors.

    Parameters
    ----------
    mirror : Stand
        Of any shape (...).
    sun : ndarray, shape (..., 3)
        Unit vectors to the sun. [1]
    start, along : ndarray, shape (S, 3)
        A point of each piece relative to the aim point [m], and its direction [1].
    ends : ndarray, shape (S, 2)
        First and last place of each piece, counted from its point. [m]

    Returns
    -------
    place : ndarray, shape (..., 2, S, 2)
        Places on the pieces, of each trace, rising; NaN where there is none. [m]
    angle : ndarray
        Angle of the cylinder's normal from that of the mirror: positive raises it, or turns it clockwise from above.
        [rad]
    """
    axis, s = mirror.axes[..., np.newaxis, :], sun[..., np.newaxis, np.newaxis, :]
    c = (start - mirror.centre[..., np.newaxis, :])[..., np.newaxis, :, :]
    k, ad, ac, cd = -dot(axis, s), dot(axis, along), dot(axis, c), dot(c, along)
    first, half, last = ad * ad - k * k, ac * ad - k * k * cd, ac * ac - k * k * dot(c, c)
    with np.errstate(divide="ignore", invalid="ignore"):
        free, across = ad[..., np.newaxis] * c - ac[..., np.newaxis] * along, c - cd[..., np.newaxis] * along
        t = -(half + np.copysign(np.abs(k) * np.sqrt(dot(free, free) - k * k * dot(across, across)), half))
        place = np.stack([t / first, last / t], axis=-1)
        axis, s, k, n = axis[..., np.newaxis, :], s[..., np.newaxis, :], k[..., np.newaxis], mirror.normal
        c, along = c[..., np.newaxis, :], along[:, np.newaxis, :]
        n = n[..., np.newaxis, np.newaxis, np.newaxis, :]
        v = c + place[..., np.newaxis] * along
        lean = dot(axis, _unit(v))
        # The other half of the cone is not lit.
        place = np.where(np.abs(lean - k) <= np.abs(lean + k) + _SAME, place, np.nan)
        for _ in range(_NEWTON):
            v = c + place[..., np.newaxis] * along
            step = _cosine_error(axis, s, v) / _slope(axis, v, along)
            place = np.where(np.abs(step) < 1e-3 * np.sqrt(dot(v, v)), place - step, place)
        v = c + place[..., np.newaxis] * along
        middle = s + _unit(v)
        sine = np.stack([mirror.up, mirror.right], axis=-2)[..., np.newaxis, np.newaxis, :]
        angle = np.arctan2(dot(middle, sine), dot(middle, n))
        real = (np.abs(dot(axis, middle)) < _SAME) & (dot(middle, n) > 0) & (dot(s, n) > 0)
        distance = np.sqrt(dot(v, v))
        within = np.clip(place, ends[:, :1], ends[:, 1:])
        place = np.where(real & (np.abs(place - within) <= _ENDS * distance), within, np.nan)
    twice = np.abs(place[..., 1] - place[..., 0]) < _SAME * distance[..., 0]
    place[..., 1] = np.where(twice, np.nan, place[..., 1])
    order = np.argsort(place, axis=-1)
    angle = np.where(np.isnan(place), np.nan, angle)
    return np.take_along_axis(place, order, -1), np.take_along_axis(angle, order, -1)


def mirror_angles(frame: Floats, sun: Floats, to_elevation: Floats, to_azimuth: Floats) -> Floats:
    """Angles of a mount from a point of each trace: exact where only its encoders' references are off, without offsets.

    The bisector k of the sun and the way to a point of the elevation trace keeps the primary angle of the mirror; that
    of a point of the azimuth trace keeps the ratio of k along the primary axis to k along the horizontal of that angle.

    Parameters
    ----------
    frame, sun
        As in `stand` and `crossings`.
    to_elevation, to_azimuth : ndarray, shape (..., 3)
        Ways from the pivot to the points. [m]

    Returns
    -------
    ndarray, shape (..., 2)
        Angles g + g0 and a + a0. [rad]
    """
    x, y, z = frame[..., 0, :], frame[..., 1, :], frame[..., 2, :]
    middle = sun + _unit(to_elevation)
    azimuth = np.arctan2(dot(middle, x), dot(middle, y))
    middle = sun + _unit(to_azimuth)
    level = np.sin(azimuth) * dot(middle, x) + np.cos(azimuth) * dot(middle, y)
    return np.stack([azimuth, np.arctan2(dot(middle, z), level)], axis=-1)


class Seen(NamedTuple):
    """Crossings of N mounts, M of each."""

    sun: Floats
    """Unit vectors to the sun, shape (N, M, 3). [1]"""
    angles: Floats
    """Commanded angles, shape (N, M, 2). [rad]"""
    trace: NDArray[np.int64]
    """`ELEVATION` or `AZIMUTH`, shape (N, M)."""
    point: Floats
    """Points relative to the aim point, shape (N, M, 3). [m]"""
    along: Floats
    """Directions of the arrays there, shape (N, M, 3). [1]"""
    weight: Floats
    """Inverse variances in any unit, shape (N, M); 0 for what is not used. [1]"""

    def of(self, mounts: NDArray[np.int64]) -> Seen:
        """Those of some mounts."""
        arrays: list[NDArray[Any]] = [array[mounts] for array in self]
        return Seen(*arrays)

    def of_each(self, mounts: int) -> Seen:
        """The same where lists one after the other, as many for each, are of one mount."""
        arrays: list[NDArray[Any]] = [array.reshape(mounts, -1, *array.shape[2:]) for array in self]
        return Seen(*arrays)


class Fit(NamedTuple):
    """Errors of N mounts from their crossings."""

    estimate: Floats
    """Shape (N, 6), NaN for those not sought and where nothing is estimated. [rad]"""
    inverse: Floats
    """(J^T W J)^-1 with the weights divided by their mean, shape (N, 6, 6): times the variance of a crossing of mean
    weight it is the covariance. [rad2/m2]"""
    condition: Floats
    """Condition number of the weighted Jacobian, shape (N,). [1]"""
    residual: Floats
    """Measured minus predicted place along the array, shape (N, M). [m]"""
    used: NDArray[np.int64]
    """Crossings used, shape (N,)."""
    status: NDArray[np.int64]
    """Shape (N,)."""
    least_known: NDArray[np.int64]
    """Error with the largest part in the least known direction, shape (N,); -1 where there are too few crossings."""


def _rows(
    frame: Floats, to_target: Floats, offsets: tuple[float, float, float], seen: Seen, errors: Floats, count: int
) -> tuple[Floats, Floats, Floats]:
    """Residuals [m], their derivatives by the first errors, [m/rad], and sines of the angle of trace and array."""
    mirror = stand(frame[:, np.newaxis], seen.angles, errors[:, np.newaxis], to_target[:, np.newaxis], offsets)
    chosen = (seen.trace == ELEVATION)[..., np.newaxis]
    axis, v = np.where(chosen, mirror.right, mirror.up), seen.point - mirror.centre
    slope = _slope(axis, v, seen.along)
    distance = np.sqrt(dot(v, v))
    middle = seen.sun + _unit(v)
    across = axis - (dot(axis, v) / distance**2)[..., np.newaxis] * v
    turns = (
        (-mirror.primary, mirror.arm),
        (mirror.secondary, mirror.bore),
        (mirror.east, mirror.pole + mirror.arm),
        (mirror.north, mirror.pole + mirror.arm),
        (mirror.askew, mirror.bore),
        (-mirror.up, None),
    )
    columns = []
    for turn, arm in turns[:count]:
        change = dot(np.cross(turn, axis), middle)
        if arm is not None:
            change = change - dot(across, np.cross(turn, arm)) / distance
        columns.append(change / slope)
    residual = _cosine_error(axis, seen.sun, v) / slope
    return residual, np.stack(columns, axis=-1), slope * distance


def fit(
    frame: Floats,
    to_target: Floats,
    offsets: tuple[float, float, float],
    seen: Seen,
    parameters: int,
    start: Floats | None = None,
    condition_limit: float = np.inf,
) -> Fit:
    """Estimate the first errors of mounts from crossings: Gauss and Newton's steps, from singular values.

    Of frames (N, 3, 3), ways from the pivots to the aim point (N, 3) [m] and offsets as in `stand`; from no errors or
    from `start`, shape (N, 6) [rad]. Crossings at which trace and array nearly run along each other are left out, see
    `GRAZING`. No estimate depends on the mounts beside it.
    """
    number = len(frame)
    errors = np.zeros((number, 6)) if start is None else np.where(np.isfinite(start), start, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        residual, rows, grazing = _rows(frame, to_target, offsets, seen, errors, parameters)
        known = np.isfinite(residual) & np.isfinite(rows).all(axis=-1) & (np.abs(grazing) > GRAZING) & (seen.weight > 0)
    used = np.count_nonzero(known, axis=1)
    total = np.sum(np.where(known, seen.weight, 0.0), axis=1)
    root = np.sqrt(np.where(known, seen.weight, 0.0) * (used / np.where(total > 0, total, 1.0))[:, np.newaxis])
    enough = used >= parameters
    moving, scale = enough.copy(), np.ones(number)
    best, cost, tried = errors.copy(), np.full(number, np.inf), errors.copy()
    right = np.zeros((number, parameters, parameters))
    values, steps = np.full((number, parameters), np.nan), np.zeros((number, parameters))
    for _ in range(_STEPS):
        here = np.flatnonzero(moving)
        if not here.size:
            break
        part = seen.of(here)
        with np.errstate(divide="ignore", invalid="ignore"):
            r, j, _ = _rows(frame[here], to_target[here], offsets, part, tried[here], parameters)
        weight = root[here]
        r, j = np.where(weight > 0, weight * r, 0.0), np.where(weight[..., None] > 0, weight[..., None] * j, 0.0)
        new = np.sum(r * r, axis=1)
        # Near the solution nothing but rounding changes the cost.
        fine = np.isfinite(new) & (new <= cost[here] * (1 + 1e-9) + 1e-24 * used[here])
        good = here[fine]
        best[good], cost[good] = tried[good], new[fine]
        if good.size:
            u, s, vt = np.linalg.svd(j[fine], full_matrices=False)
            values[good], right[good] = s, vt
            inverse = np.where(s > _RANK * s[:, :1], 1.0 / np.where(s > 0, s, 1.0), 0.0)
            steps[good] = -np.sum(vt * (inverse * np.einsum("nmp,nm->np", u, r[fine]))[..., None], axis=1)
            scale[good] = 1.0
        scale[here[~fine]] *= 0.5
        tried[here, :parameters] = best[here, :parameters] + scale[here, np.newaxis] * steps[here]
        rounding = _LAST_STEP * np.maximum(1.0, values[here, 0] / np.maximum(values[here, -1], _RANK * values[here, 0]))
        small = np.max(np.abs(steps[here]), axis=1) < rounding
        best[here[small]] = tried[here[small]]
        moving[here[small]] = False
    with np.errstate(divide="ignore", invalid="ignore"):
        residual, _, _ = _rows(frame, to_target, offsets, seen, best, parameters)
        condition = np.where(enough, values[:, 0] / values[:, -1], np.nan)
        shares = right / values[..., np.newaxis]
    dependent = enough & ~(values[:, -1] > _RANK * values[:, 0])
    status = np.where(condition > condition_limit, INDISTINCT, ESTIMATED)
    status = np.where(moving, NOT_CONVERGED, status)
    status = np.where(dependent, DEPENDENT, np.where(enough, status, TOO_FEW))
    estimated = (enough & ~dependent)[:, np.newaxis]
    found, inverses = np.full((number, 6), np.nan), np.full((number, 6, 6), np.nan)
    found[:, :parameters] = np.where(estimated, best[:, :parameters], np.nan)
    product = np.einsum("nki,nkj->nij", shares, shares)
    inverses[:, :parameters, :parameters] = np.where(estimated[..., np.newaxis], product, np.nan)
    weak = np.argmax(np.abs(right[:, -1]), axis=-1)
    return Fit(
        estimate=found,
        inverse=inverses,
        condition=np.where(dependent, np.inf, condition),
        residual=np.where(known & estimated, residual, np.nan),
        used=used,
        status=status,
        least_known=np.where(enough, weak, -1),
    )

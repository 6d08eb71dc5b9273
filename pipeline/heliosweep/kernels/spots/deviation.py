"""Curve that the spot of a misaligned mirror draws on the receiver plane.

At no error the mirror centre is P = C + r n with the ideal normal n of `aiming`. Its axes: e = unit(n x z), level for
a vertical primary axis z, and b = e x n up the slope. An error of the angle eps turns the normal about the axis a:

    n(eps) = Rot(a, eps) n,   a = e (elevation: + raises n), -b (azimuth), -z (encoder azimuth): + turns n
                              clockwise seen from the end of the primary axis

and takes the mirror centre along or not:

    canting: P stays;   encoder: P(eps) = C + r n(eps);   tilt: P(eps) = B + Rot(a, eps) (C - B) + r n(eps)

with B the base of the pedestal, straight below the pivot. Every vector that turns about a is v0 + v1 cos eps +
v2 sin eps with v0 = a (a.v), v1 = v - v0, v2 = a x v. The reflected ray is R = 2 (S.n) n - S; about an axis in the
mirror, R(eps) = Rot(a, 2 eps) R(0). After Optics Express 27 (8), A257 (2019), Sect. 3, in a right-handed frame.

A normal along the primary axis has no elevation axis of its own: e is then the frame's x, the level axis that a bore
near the frame's y (north for a vertical primary axis) would have.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.kinematics import offset_normal, primary_axis
from heliosweep.kernels.spots.receiver import (
    BEHIND_FACE,
    MISSES,
    NO_SUN,
    REACHES,
    TOO_NEAR,
    Face,
    Setting,
    compiled_setting,
    face_vectors,
    trace,
)
from heliosweep.kernels.vectors import PACKET, Vector, at_angle, cross, dot, mixed, turning

CANTING = 0
"""Source of the error: the facet is canted, its centre stays."""
ENCODER = 1
"""The mirror turns about its pivot."""
TILT = 2
"""The pedestal turns about its base."""

ELEVATION = 0
"""Axis of the error: e, level in the mirror."""
AZIMUTH = 1
"""-b, down the slope of the mirror."""
ENCODER_AZIMUTH = 2
"""Minus the primary axis."""

_ALONG = 1e-15
"""Sine of the angle below which normal and primary axis are taken for parallel."""
_CURVE_ROWS = 22
"""Rows of a packet of curves, see `_as_lane`."""

Floats = NDArray[np.float64]
Parts = tuple[Vector, Vector, Vector]


class Curve(NamedTuple):
    """Turning normal and centre of one mirror at one instant, under an error of one axis and source."""

    status: int
    """`REACHES`, `NO_SUN`, `TOO_NEAR`, `BEHIND_FACE` (the pivot) or `MISSES` (no normal); with all but the
    first, the rest means nothing."""
    sun: Vector
    """Unit vector to the sun. [1]"""
    axis: Vector
    """Unit vector a, about which the error turns. [1]"""
    normal: Parts
    """Turning unit normal. [1]"""
    centre: Parts
    """Turning mirror centre relative to the aim point. [m]"""


@inline
def deviation_curve(
    source: int, axis: int, sun: Vector, to_target: Vector, z: Vector, x: Vector, offset: float, pedestal: float
) -> Curve:
    """Curve of one mirror at one instant.

    Of source and axis of the error, the unit vector to the sun, the way from the pivot to the aim point [m], z and x
    from `primary_axis`, the distance of the mirror centre from the pivot along the normal and the height of the pivot
    above the base [m].
    """
    sx, sy, sz = sun
    dx, dy, dz = to_target
    n = offset_normal(sx, sy, sz, dx, dy, dz, offset)
    level = cross(n, z)
    sine = math.sqrt(dot(level, level))
    e = mixed(1.0 / sine, level, 0.0, level) if sine > _ALONG else x
    b = cross(e, n)
    a = e
    if axis == AZIMUTH:
        a = (-b[0], -b[1], -b[2])
    elif axis == ENCODER_AZIMUTH:
        a = (-z[0], -z[1], -z[2])
    still = (-dx, -dy, -dz)
    arm = (offset * n[0], offset * n[1], offset * n[2])
    if source == CANTING:
        still = mixed(1.0, still, 1.0, arm)
        arm = (0.0, 0.0, 0.0)
    elif source == TILT:
        still = (still[0], still[1], still[2] - pedestal)
        arm = (arm[0], arm[1], arm[2] + pedestal)
    fixed, first, second = turning(a, arm)
    status = REACHES if n[0] == n[0] else MISSES
    status = status if abs(offset) < math.sqrt(dot(to_target, to_target)) else TOO_NEAR
    status = status if sz > 0.0 and sx == sx and sy == sy else NO_SUN
    return Curve(status, sun, a, turning(a, n), (mixed(1.0, still, 1.0, fixed), first, second))


@inline
def draws_conic(source: int, axis: int, offset: float, pedestal: float) -> bool:
    """Test whether the reflected rays form a cone, with its apex in a mirror centre that stays where it is."""
    stays = source == CANTING or (offset == 0.0 and (source == ENCODER or pedestal == 0.0))
    return stays and axis != ENCODER_AZIMUTH


@inline
def spot_at(curve: Curve, face: Face, cosine: float, sine: float) -> tuple[float, float, int]:
    """Spot y, z [m] and status at the error whose cosine and sine are given."""
    return trace(at_angle(curve.centre, cosine, sine), at_angle(curve.normal, cosine, sine), curve.sun, face)


@inline
def curve_of(
    setting: Setting, p: int, face: Face, source: int, axis: int, sun: Floats, pivots: Floats, h: int, t: int
) -> Curve:
    """Curve of heliostat h at instant t for parameter point p and its face; arrays as in `deviation_spots`."""
    i, j = p if len(sun) > 1 else 0, p if len(pivots) > 1 else 0
    to_target = (-pivots[j, h, 0], -pivots[j, h, 1], setting.target_height[p] - pivots[j, h, 2])
    z, x = primary_axis(setting.kind[p], setting.latitude[p], setting.axis_azimuth[p], to_target)
    to_sun = (sun[i, t, 0], sun[i, t, 1], sun[i, t, 2])
    r, pedestal = setting.mirror_offset[p], setting.pedestal_height[p]
    curve = deviation_curve(source, axis, to_sun, to_target, z, x, r, pedestal)
    behind = not dot(face[0], to_target) < 0.0 and (curve.status == REACHES or curve.status == MISSES)
    status = BEHIND_FACE if behind else curve.status
    return Curve(status, curve.sun, curve.axis, curve.normal, curve.centre)


def prepared(
    setting: Setting, source: ArrayLike, axis: ArrayLike, sun: ArrayLike, pivots: ArrayLike
) -> tuple[Setting, NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
    """Arguments as the kernels take them: contiguous, writable, of one type.

    Raises
    ------
    ValueError
        If the numbers of parameter points do not agree, or an axis offset is not zero.
    """
    points, settings = len(setting.kind), compiled_setting(setting)
    if any(values.shape != (points,) for values in settings):
        raise ValueError("every entry of the setting needs one number for each parameter point")
    if np.any(settings.axis_offset != 0.0):
        raise ValueError("curves of a single error know no axis offset")
    sources, axes = (np.require(codes, np.int64, ["C", "W", "O"]) for codes in (source, axis))
    suns, places = (np.require(vectors, np.float64, ["C", "W", "O"]) for vectors in (sun, pivots))
    if sources.shape != (points,) or axes.shape != (points,):
        raise ValueError("source and axis need one number for each parameter point")
    for name, values in (("sun", suns), ("pivots", places)):
        if values.ndim != 3 or values.shape[0] not in (1, points) or values.shape[2] != 3:
            raise ValueError(f"{name} must have the shape (1 or {points}, number, 3), not {values.shape}")
    return settings, sources, axes, suns, places


def deviation_spots(
    setting: Setting, source: ArrayLike, axis: ArrayLike, size: ArrayLike, sun: ArrayLike, pivots: ArrayLike
) -> Floats:
    """Spots of misaligned mirrors.

    Parameters
    ----------
    setting : Setting
        Receiver and mount of P parameter points.
    source, axis : array_like of int, shape (P,)
        `CANTING`, `ENCODER` or `TILT`; `ELEVATION`, `AZIMUTH` or `ENCODER_AZIMUTH`.
    size : array_like, shape (P,)
        Error eps. [rad]
    sun : array_like, shape (P or 1, T, 3)
        Unit vectors to the sun: east, north, up. [1]
    pivots : array_like, shape (P or 1, H, 3)
        Pivots relative to the base of the tower: east, north, up. [m]

    Returns
    -------
    ndarray, shape (3, P, H, T)
        y and z [m], NaN where the status is not `REACHES`, and the status.

    Raises
    ------
    ValueError
        As `prepared`.
    """
    settings, sources, axes, suns, places = prepared(setting, source, axis, sun, pivots)
    sizes = np.require(size, np.float64, ["C", "W", "O"])
    if sizes.shape != sources.shape:
        raise ValueError("size needs one number for each parameter point")
    spots = np.empty((3, len(sizes), places.shape[1], suns.shape[1]))
    fill_spots(
        settings, sources, axes, sizes, _like_the_last(settings, sources, axes, suns, places), suns, places, spots
    )
    return spots


def _like_the_last(
    setting: Setting, source: NDArray[np.int64], axis: NDArray[np.int64], sun: Floats, pivots: Floats
) -> NDArray[np.bool_]:
    """Which points differ from the point before in nothing but the size of the error, so that they share its curves."""
    like = np.ones(len(source), np.bool_)
    like[:1] = False
    for values in (*setting, source, axis):
        like[1:] &= values[1:] == values[:-1]
    for array in (sun, pivots):
        if len(array) > 1:
            like[1:] &= np.all(array[1:] == array[:-1], axis=(1, 2))
    return like


@kernel
def fill_spots(
    setting: Setting,
    source: NDArray[np.int64],
    axis: NDArray[np.int64],
    size: Floats,
    like_the_last: NDArray[np.bool_],
    sun: Floats,
    pivots: Floats,
    spots: Floats,
) -> None:
    """Fill `spots`, shape (3, P, H, T)."""
    points, instants = len(size), sun.shape[1]
    mirrors = pivots.shape[1] * instants
    sine, cosine = np.sin(size), np.cos(size)
    rows, out = np.empty(_CURVE_ROWS * PACKET), spots.reshape(-1)
    for first in range(0, mirrors, PACKET):
        lanes = min(PACKET, mirrors - first)
        for p in range(points):
            face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
            if not like_the_last[p]:
                for k in range(lanes):
                    h, t = (first + k) // instants, (first + k) % instants
                    curve = curve_of(setting, p, face, source[p], axis[p], sun, pivots, h, t)
                    _as_lane(curve, rows, k)
            _spot_lanes(rows, face, cosine[p], sine[p], out, p * mirrors + first, points * mirrors, lanes)


@inline
def _as_lane(curve, rows, k):
    """Write a curve to lane k: sun, the parts of normal and centre, status."""
    for c in range(3):
        rows[c * PACKET + k] = curve.sun[c]
        for part in range(3):
            rows[(3 + 3 * part + c) * PACKET + k] = curve.normal[part][c]
            rows[(12 + 3 * part + c) * PACKET + k] = curve.centre[part][c]
    rows[21 * PACKET + k] = curve.status


@inline
def _of_lane(rows, row, k):
    """Three rows of a lane."""
    return rows[row * PACKET + k], rows[(row + 1) * PACKET + k], rows[(row + 2) * PACKET + k]


@kernel
def _spot_lanes(
    rows: Floats, face: Face, cosine: float, sine: float, out: Floats, first: int, apart: int, lanes: int
) -> None:
    """Spots of a packet of curves at one size of the error: y, z and status to out[first:], so far `apart`."""
    # Known not to be negative, or stores become scattered.
    y_at, z_at, status_at = max(first, 0), max(first + apart, 0), max(first + 2 * apart, 0)
    for k in range(lanes):
        normal = _of_lane(rows, 3, k), _of_lane(rows, 6, k), _of_lane(rows, 9, k)
        centre = _of_lane(rows, 12, k), _of_lane(rows, 15, k), _of_lane(rows, 18, k)
        there = rows[21 * PACKET + k]
        turned = at_angle(centre, cosine, sine), at_angle(normal, cosine, sine)
        y, z, status = trace(*turned, _of_lane(rows, 0, k), face)
        out[y_at + k] = y if there == REACHES else math.nan
        out[z_at + k] = z if there == REACHES else math.nan
        out[status_at + k] = status if there == REACHES else there

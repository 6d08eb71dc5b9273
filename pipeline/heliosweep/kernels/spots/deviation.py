"""Curve that the spot of a misaligned mirror draws on the receiver plane.

At no error the mirror centre is P = C + r n with the ideal normal n of `aiming`. Its axes: e = unit(n x z), level for
a vertical primary axis z, and b = e x n up the slope. An error of the angle eps turns the normal about the axis a:

    n(eps) = Rot(a, eps) n,   a = e (elevation: + raises n), -b (azimuth), -z (encoder azimuth): + turns n
                              clockwise seen from the end of the primary axis

and takes the mirror centre along or not:

    canting: P stays;   encoder: P(eps) = C + r n(eps);   tilt: P(eps) = B + Rot(a, eps) (C - B) + r n(eps)

with B the base of the pedestal, straight below the pivot. A mount may have errors already (`traces.stand`): the mirror
then stands where they put it, and the error turns it from there. Every vector that turns about a is v0 + v1 cos eps +
v2 sin eps with v0 = a (a.v), v1 = v - v0, v2 = a x v. The reflected ray is R = 2 (S.n) n - S; about an axis in the
mirror, R(eps) = Rot(a, 2 eps) R(0). After Optics Express 27 (8), A257 (2019), Sect. 3, in a right-handed frame.

A normal along the primary axis has no elevation axis of its own: e is then the frame's x, the level axis that a bore
near the frame's y (north for a vertical primary axis) would have.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.kinematics import TARGET_ALIGNED, normal_lanes, of_lane, primary_axis
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
STAND = 15
"""Numbers of a mirror that stands with errors, see `traces.stand`: unit vectors of its normal n (0 to 2), its elevation
axis e (3 to 5) and the primary axis z (6 to 8), ways from the pivot to the mirror centre (9 to 11) and from the base to
the pivot (12 to 14) [m]."""

_AXIS, _TO_TARGET, _Z, _X, _NORMAL, _WORK = 22, 25, 28, 31, 34, 37
CURVE_ROWS = 42
"""Rows of a packet of curves: those of `_as_lane` come first, then the ways to the aim point, the axes z and x of the
mounts, the normals, and what these need."""

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
def _aligned_curve(source, axis, sun, to_target, z, x, n, offset, pedestal):
    """Curve of a mirror without errors.

    Of source and axis of the error, the unit vector to the sun, the way from the pivot to the aim point [m], z and x
    from `primary_axis`, the normal n, the distance of the mirror centre from the pivot along it and the height of the
    pivot above the base [m].
    """
    dx, dy, dz = to_target
    level = cross(n, z)
    sine = math.sqrt(dot(level, level))
    e = mixed(1.0 / sine, level, 0.0, level) if sine > _ALONG else x
    pivot = (-dx, -dy, -dz)
    base = (-dx, -dy, -dz - pedestal)
    arm = (offset * n[0], offset * n[1], offset * n[2])
    return _turning_curve(source, axis, sun, (n, e, z), (pivot, base, arm, (0.0, 0.0, pedestal)), offset)


@inline
def _standing_curve(source, axis, sun, to_target, stand, offset, pedestal):
    """Curve of a mirror that stands as the errors of its mount make it."""
    axes = (stand[0], stand[1], stand[2]), (stand[3], stand[4], stand[5]), (stand[6], stand[7], stand[8])
    arm, pole = (stand[9], stand[10], stand[11]), (stand[12], stand[13], stand[14])
    base = (-to_target[0], -to_target[1], -to_target[2] - pedestal)
    places = mixed(1.0, base, 1.0, pole), base, arm, pole
    return _turning_curve(source, axis, (sun[0], sun[1], sun[2]), axes, places, offset)


@inline
def _turning_curve(source, axis, sun, axes, places, offset):
    """Curve of a mirror with the normal n and the axes e and z, with the ways to pivot and base, arm and pole."""
    n, e, z = axes
    pivot, base, arm, pole = places
    b = cross(e, n)
    a = e
    if axis == AZIMUTH:
        a = (-b[0], -b[1], -b[2])
    elif axis == ENCODER_AZIMUTH:
        a = (-z[0], -z[1], -z[2])
    still = pivot
    if source == CANTING:
        still = mixed(1.0, still, 1.0, arm)
        arm = (0.0, 0.0, 0.0)
    elif source == TILT:
        still = base
        arm = (arm[0] + pole[0], arm[1] + pole[1], arm[2] + pole[2])
    fixed, first, second = turning(a, arm)
    status = REACHES if n[0] == n[0] else MISSES
    status = status if abs(offset) < math.sqrt(dot(pivot, pivot)) else TOO_NEAR
    status = status if (sun[2] > 0.0) & (sun[0] == sun[0]) & (sun[1] == sun[1]) else NO_SUN
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
def _before(curve, face, to_target):
    """A curve with the status of a pivot that is behind the face, where it is."""
    behind = (not dot(face[0], to_target) < 0.0) & ((curve.status == REACHES) | (curve.status == MISSES))
    status = BEHIND_FACE if behind else curve.status
    return Curve(status, curve.sun, curve.axis, curve.normal, curve.centre)


def prepared(
    setting: Setting,
    source: ArrayLike,
    axis: ArrayLike,
    sun: ArrayLike,
    pivots: ArrayLike,
    stands: ArrayLike | None,
) -> tuple[Setting, NDArray[np.int64], NDArray[np.int64], tuple[Floats, Floats, Floats]]:
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
    stood = np.empty((0, 0, 0, STAND)) if stands is None else np.require(stands, np.float64, ["C", "W", "O"])
    if stands is not None and stood.shape != (points, places.shape[1], suns.shape[1], STAND):
        raise ValueError(f"stands must have a row of {STAND} numbers for each point, heliostat and instant")
    return settings, sources, axes, (suns, places, stood)


def deviation_spots(
    setting: Setting,
    source: ArrayLike,
    axis: ArrayLike,
    size: ArrayLike,
    sun: ArrayLike,
    pivots: ArrayLike,
    stands: ArrayLike | None = None,
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
    stands : array_like, shape (P, H, T, `STAND`), optional
        How mirrors stand whose mounts have errors already, from `traces.stand`; without, mirrors are aligned.

    Returns
    -------
    ndarray, shape (3, P, H, T)
        y and z [m], NaN where the status is not `REACHES`, and the status.

    Raises
    ------
    ValueError
        As `prepared`.
    """
    settings, sources, axes, sky = prepared(setting, source, axis, sun, pivots, stands)
    sizes = np.require(size, np.float64, ["C", "W", "O"])
    if sizes.shape != sources.shape:
        raise ValueError("size needs one number for each parameter point")
    spots = np.empty((3, len(sizes), sky[1].shape[1], sky[0].shape[1]))
    fill_spots(settings, sources, axes, sizes, _like_the_last(settings, sources, axes, *sky), sky, spots)
    return spots


def _like_the_last(
    setting: Setting, source: NDArray[np.int64], axis: NDArray[np.int64], *sky: Floats
) -> NDArray[np.bool_]:
    """Which points differ from the point before in nothing but the size of the error, so that they share its curves."""
    like = np.ones(len(source), np.bool_)
    like[:1] = False
    for values in (*setting, source, axis):
        like[1:] &= values[1:] == values[:-1]
    for array in sky:
        if len(array) > 1:
            like[1:] &= np.all(array[1:] == array[:-1], axis=tuple(range(1, array.ndim)))
    return like


@kernel
def fill_spots(
    setting: Setting,
    source: NDArray[np.int64],
    axis: NDArray[np.int64],
    size: Floats,
    like_the_last: NDArray[np.bool_],
    sky: tuple[Floats, Floats, Floats],
    spots: Floats,
) -> None:
    """Fill `spots`, shape (3, P, H, T)."""
    points, instants = len(size), spots.shape[3]
    mirrors = spots.shape[2] * instants
    sine, cosine = np.sin(size), np.cos(size)
    rows, out = np.empty(CURVE_ROWS * PACKET), spots.reshape(-1)
    for first in range(0, mirrors, PACKET):
        lanes = min(PACKET, mirrors - first)
        for p in range(points):
            face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
            if not like_the_last[p]:
                curve_lanes(setting, p, face, source[p], axis[p], sky, first, lanes, rows)
            _spot_lanes(rows, face, cosine[p], sine[p], out, p * mirrors + first, points * mirrors, lanes)


@kernel
def curve_lanes(
    setting: Setting,
    p: int,
    face: Face,
    source: int,
    axis: int,
    sky: tuple[Floats, Floats, Floats],
    first: int,
    lanes: int,
    rows: Floats,
) -> None:
    """Write curves for parameter point p and its face to the `CURVE_ROWS` rows; `sky`: sun, pivots and stands.

    Of the heliostats and instants from `first` on; all instants of a heliostat follow each other.
    """
    sun, pivots, stands = sky
    i, j, instants = p if len(sun) > 1 else 0, p if len(pivots) > 1 else 0, sun.shape[1]
    h, t = first // instants, first % instants
    r, pedestal = setting.mirror_offset[p], setting.pedestal_height[p]
    kind, height, none = setting.kind[p], setting.target_height[p], (0.0, 0.0, 0.0)
    if len(stands) > 0:
        for k in range(lanes):
            to_target = (-pivots[j, h, 0], -pivots[j, h, 1], height - pivots[j, h, 2])
            curve = _standing_curve(source, axis, sun[i, t], to_target, stands[p, h, t], r, pedestal)
            _as_lane(_before(curve, face, to_target), rows, k)
            h, t = (h, t + 1) if t + 1 < instants else (h + 1, 0)
        return
    z, x = primary_axis(kind, setting.latitude[p], setting.axis_azimuth[p], none)
    for k in range(lanes):
        to_target = (-pivots[j, h, 0], -pivots[j, h, 1], height - pivots[j, h, 2])
        if kind == TARGET_ALIGNED:
            z, x = primary_axis(kind, 0.0, 0.0, to_target)
        for c in range(3):
            rows[c * PACKET + k], rows[(_TO_TARGET + c) * PACKET + k] = sun[i, t, c], to_target[c]
            rows[(_Z + c) * PACKET + k], rows[(_X + c) * PACKET + k] = z[c], x[c]
        h, t = (h, t + 1) if t + 1 < instants else (h + 1, 0)
    normal_lanes(rows, 0, _TO_TARGET, r, _NORMAL, _WORK, lanes)
    for k in range(lanes):
        to_sun, to_target = of_lane(rows, 0, k), of_lane(rows, _TO_TARGET, k)
        z, x, n = of_lane(rows, _Z, k), of_lane(rows, _X, k), of_lane(rows, _NORMAL, k)
        curve = _aligned_curve(source, axis, to_sun, to_target, z, x, n, r, pedestal)
        _as_lane(_before(curve, face, to_target), rows, k)


@inline
def _as_lane(curve, rows, k):
    """Write a curve to lane k: sun, the parts of normal and centre, status, axis."""
    for c in range(3):
        rows[c * PACKET + k] = curve.sun[c]
        for part in range(3):
            rows[(3 + 3 * part + c) * PACKET + k] = curve.normal[part][c]
            rows[(12 + 3 * part + c) * PACKET + k] = curve.centre[part][c]
    rows[21 * PACKET + k] = curve.status
    rows[_AXIS * PACKET + k], rows[(_AXIS + 1) * PACKET + k], rows[(_AXIS + 2) * PACKET + k] = curve.axis


@inline
def curve_at(rows: Floats, k: int) -> Curve:
    """Curve in lane k."""
    normal = of_lane(rows, 3, k), of_lane(rows, 6, k), of_lane(rows, 9, k)
    centre = of_lane(rows, 12, k), of_lane(rows, 15, k), of_lane(rows, 18, k)
    return Curve(int(rows[21 * PACKET + k]), of_lane(rows, 0, k), of_lane(rows, _AXIS, k), normal, centre)


@kernel
def _spot_lanes(
    rows: Floats, face: Face, cosine: float, sine: float, out: Floats, first: int, apart: int, lanes: int
) -> None:
    """Spots of a packet of curves at one size of the error: y, z and status to out[first:], so far `apart`."""
    # Known not to be negative, or stores become scattered.
    y_at, z_at, status_at = max(first, 0), max(first + apart, 0), max(first + 2 * apart, 0)
    for k in range(lanes):
        there = rows[21 * PACKET + k]
        y, z, status = spot_at(curve_at(rows, k), face, cosine, sine)
        out[y_at + k] = y if there == REACHES else math.nan
        out[z_at + k] = z if there == REACHES else math.nan
        out[status_at + k] = status if there == REACHES else there

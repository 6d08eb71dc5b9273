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
from heliosweep.kernels.mounts.kinematics import ideal_normal, primary_axis
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
from heliosweep.kernels.vectors import Vector, at_angle, cross, dot, mixed, scaled, turning

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
def curve_of(setting, p, face, source, axis, sky, h, t):
    """Curve of parameter point p, its face, and the error, for a heliostat and an instant of `sky`.

    `sky` holds sun, pivots and mirrors with errors, see `prepared`.
    """
    sun, pivots, stands = sky
    i, j = p if len(sun) > 1 else 0, p if len(pivots) > 1 else 0
    s, offset = (sun[i, t, 0], sun[i, t, 1], sun[i, t, 2]), setting.mirror_offset[p]
    to_target = -pivots[j, h, 0], -pivots[j, h, 1], setting.target_height[p] - pivots[j, h, 2]
    base = -to_target[0], -to_target[1], -to_target[2] - setting.pedestal_height[p]
    if len(stands) > 0:
        stand = stands[p, h, t]
        n, e, z = (stand[0], stand[1], stand[2]), (stand[3], stand[4], stand[5]), (stand[6], stand[7], stand[8])
        arm, pole = (stand[9], stand[10], stand[11]), (stand[12], stand[13], stand[14])
    else:
        z, x = primary_axis(setting.kind[p], setting.latitude[p], setting.axis_azimuth[p], to_target)
        n = ideal_normal(s, to_target, offset)
        level = cross(n, z)
        sine = math.sqrt(dot(level, level))
        e = scaled(1.0 / sine, level) if sine > _ALONG else x
        arm, pole = scaled(offset, n), (0.0, 0.0, setting.pedestal_height[p])
    pivot = mixed(1.0, base, 1.0, pole)
    a = e
    if axis == AZIMUTH:
        a = cross(n, e)
    elif axis == ENCODER_AZIMUTH:
        a = scaled(-1.0, z)
    status = REACHES if n[0] == n[0] else MISSES
    status = status if abs(offset) < math.sqrt(dot(pivot, pivot)) else TOO_NEAR
    status = status if (s[2] > 0.0) & (s[0] == s[0]) & (s[1] == s[1]) else NO_SUN
    if not dot(face[0], to_target) < 0.0 and (status in (REACHES, MISSES)):
        status = BEHIND_FACE
    still = pivot
    if source == CANTING:
        still, arm = mixed(1.0, pivot, 1.0, arm), (0.0, 0.0, 0.0)
    elif source == TILT:
        still, arm = base, mixed(1.0, arm, 1.0, pole)
    fixed, first, second = turning(a, arm)
    return Curve(status, s, a, turning(a, n), (mixed(1.0, still, 1.0, fixed), first, second))


@inline
def draws_conic(source: int, axis: int, offset: float, pedestal: float) -> bool:
    """Test whether the reflected rays form a cone, with its apex in a mirror centre that stays where it is."""
    stays = source == CANTING or (offset == 0.0 and (source == ENCODER or pedestal == 0.0))
    return stays and axis != ENCODER_AZIMUTH


@inline
def spot_at(curve: Curve, face: Face, cosine: float, sine: float) -> tuple[float, float, int]:
    """Spot y, z [m] and status at the error whose cosine and sine are given."""
    return trace(at_angle(curve.centre, cosine, sine), at_angle(curve.normal, cosine, sine), curve.sun, face)


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
    sine, cosine = np.sin(size), np.cos(size)
    for h in range(spots.shape[2]):
        for t in range(spots.shape[3]):
            for p in range(len(size)):
                face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
                if not like_the_last[p]:
                    curve = curve_of(setting, p, face, source[p], axis[p], sky, h, t)
                y, z, status = math.nan, math.nan, curve.status
                if status == REACHES:
                    y, z, status = spot_at(curve, face, cosine[p], sine[p])
                spots[0, p, h, t], spots[1, p, h, t], spots[2, p, h, t] = y, z, status

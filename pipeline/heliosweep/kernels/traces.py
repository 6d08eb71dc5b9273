"""Traces of a heliostat's reflecting cylinders on the receiver plane, and their crossings with detectors.

Two small cylinders (or rotating prisms) are at the centre of the mirror. One cylinder lies along the elevation axis e
of the mirror, the other along the line b up the slope of the mirror. A cylinder with the axis a reflects the sun's rays
like a set of mirrors at all angles of rotation about a. With the mirror centre p and the direction S to the sun,
the rays reach all points x of the plane for which

    F(x) = a.(S + v / |v|) = 0,   v = x - p

Detectors lie along straight segments x = q + s d in the plane. With c = q - p and k = -a.S, the trace crosses a segment
at

    ((a.d)^2 - k^2) s^2 + 2 ((a.c)(a.d) - k^2 c.d) s + (a.c)^2 - k^2 |c|^2 = 0

if a.v has the sign of k. The discriminant is k^2 (|(a.d) c - (a.c) d|^2 - k^2 |c - (c.d) d|^2). If the directions to
the sun and to the aim point lie in a plane perpendicular to the axis, as at noon due north of the tower, k is 0 and
both roots are equal. The cylinder's normal at the crossing is along S + v / |v|. Source: Optics Express 27 (8), A257
(2019), Sect. 2 and 4.3.

The axes e and b belong to the mirror on its mount (`mounts.stand`), and rotate with every error.

All functions use NumPy and broadcast their arguments. The last axis contains the three components of a vector.
"""

from __future__ import annotations

import numpy as np

from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.mounts import Stand

#: Sines below this value are rounding errors. Two crossings are treated as one if their angular distance, seen from the
#: mirror, is below this value.
_SAME = 1e-9


def dot(a: Floats, b: Floats) -> Floats:
    """Return scalar products over the last axis."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def _unit(vectors: Floats) -> Floats:
    length: Floats = np.sqrt(dot(vectors, vectors))[..., np.newaxis]
    return vectors / length


def reflected(normal: Floats, sun: Floats) -> Floats:
    """Return the directions of the reflected sun rays. [1]"""
    return 2.0 * dot(normal, sun)[..., np.newaxis] * normal - sun


def turned(axis: Floats, vector: Floats, angle: float) -> Floats:
    """Return vectors rotated about unit axes by an angle [rad]."""
    still = dot(axis, vector)[..., np.newaxis] * axis
    return still + np.cos(angle) * (vector - still) + np.sin(angle) * np.cross(axis, vector)


def spots(centre: Floats, rays: Floats, face: Floats) -> Floats:
    """Return the points (y, z) at which rays meet the plane of a face, shape (..., 2); NaN for rays that miss. [m]

    The rows of `face` are the axes X, Y, Z of the face.
    """
    before, towards = dot(centre, face[0]), -dot(rays, face[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        length = np.where((before > 0) & (towards > 0), before / towards, np.nan)
    points = centre + length[..., np.newaxis] * rays
    return np.stack([dot(points, face[1]), dot(points, face[2])], axis=-1)


def beam_outline(
    centre: Floats, ray: Floats, face: Floats, half_angle: float, count: int, radius: float = 0.0
) -> Floats:
    """Return the outline of the spot of a conical beam about a central ray, shape (..., count, 2). [m]

    `half_angle` is the half-angle of the beam [rad], and `radius` is its radius at the mirror [m]. Points of the
    outline are NaN for rays that miss the plane.
    """
    side = _unit(np.cross(ray, face[2]))
    turn = 2.0 * np.pi * np.arange(count) / count
    around = np.cos(turn)[:, np.newaxis] * side[..., np.newaxis, :]
    around = around + np.sin(turn)[:, np.newaxis] * np.cross(ray, side)[..., np.newaxis, :]
    rays = np.cos(half_angle) * ray[..., np.newaxis, :] + np.sin(half_angle) * around
    return spots(centre[..., np.newaxis, :] + radius * around, rays, face)


def crossings(mirror: Stand, sun: Floats, start: Floats, along: Floats, ends: Floats) -> tuple[Floats, Floats]:
    """Return all crossings of both traces with straight detector segments.

    Parameters
    ----------
    mirror : Stand
        Mirrors, with arrays of shape (..., 3).
    sun : ndarray, shape (..., 3)
        Unit vectors to the sun. [1]
    start, along : ndarray, shape (S, 3)
        A reference point of each segment relative to the aim point [m], and the direction of the segment [1].
    ends : ndarray, shape (S, 2)
        First and last position of each segment, measured from the reference point. [m]

    Returns
    -------
    place : ndarray, shape (..., 2, S, 2)
        Positions along the segments at which each trace crosses, in ascending order; NaN if there is no crossing. [m]
    angle : ndarray
        Angle from the normal of the mirror to the normal of the cylinder, positive upwards (elevation trace) or
        clockwise from above (azimuth trace). [rad]
    """
    axis, s = np.stack([mirror.right, mirror.up], axis=-2)[..., np.newaxis, :], sun[..., np.newaxis, np.newaxis, :]
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
        # the other half of the cone has no real rays
        place = np.where(np.abs(lean - k) <= np.abs(lean + k) + _SAME, place, np.nan)
        for _ in range(2):  # two Newton steps converge to rounding error
            v = c + place[..., np.newaxis] * along
            square = dot(v, v)
            slope = (dot(axis, along) - dot(axis, v) * dot(v, along) / square) / np.sqrt(square)
            step = dot(axis, s + _unit(v)) / slope
            place = np.where(np.abs(step) < 1e-3 * np.sqrt(square), place - step, place)
        v = c + place[..., np.newaxis] * along
        middle = s + _unit(v)
        sine = np.stack([mirror.up, mirror.right], axis=-2)[..., np.newaxis, np.newaxis, :]
        angle = np.arctan2(dot(middle, sine), dot(middle, n))
        real = (np.abs(dot(axis, middle)) < _SAME) & (dot(middle, n) > 0) & (dot(s, n) > 0)
        distance = np.sqrt(dot(v, v))
        within = np.clip(place, ends[:, :1], ends[:, 1:])
        place = np.where(real & (np.abs(place - within) <= 1e-12 * distance), within, np.nan)
    twice = np.abs(place[..., 1] - place[..., 0]) < _SAME * distance[..., 0]
    place[..., 1] = np.where(twice, np.nan, place[..., 1])
    order = np.argsort(place, axis=-1)
    angle = np.where(np.isnan(place), np.nan, angle)
    return np.take_along_axis(place, order, -1), np.take_along_axis(angle, order, -1)


def mirror_angles(frame: Floats, sun: Floats, to_elevation: Floats, to_azimuth: Floats) -> Floats:
    """Estimate the angles of a mount from one point on each trace.

    The estimate is exact if the only errors are encoder references and all offsets are zero. Let k be the bisector of
    the directions to the sun and to a point on a trace. For all points on the elevation trace, the primary angle of k
    equals the primary angle of the mirror. For all points on the azimuth trace, k has a constant ratio of two
    components: the component along the primary axis, and the component in the perpendicular plane in the direction of
    the primary angle of the mirror.

    Parameters
    ----------
    frame, sun
        Frames of the mounts, as in `stand`, and unit vectors to the sun, as in `crossings`.
    to_elevation, to_azimuth : ndarray, shape (..., 3)
        Vectors from the pivot to one point on the elevation trace and one point on the azimuth trace. [m]

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

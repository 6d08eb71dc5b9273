"""A mirror that reflects the sun: its frame, its surface in facets, and how errors spread its light."""

import math
from typing import NamedTuple

from heliosweep.kernels.compiled import inline
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION
from heliosweep.kernels.vectors import Vector, cross, dot, mixed, unit

ROLLED = 2
"""Code of a mirror that is turned about its normal by a given angle, beside those of the tracking methods."""


class Errors(NamedTuple):
    """Standard deviations per axis of random errors. [rad]"""

    slope_u: float
    """Of the mirror's normal, turned towards the axis u along the width; with the random errors of tracking."""
    slope_v: float
    """Of the normal, turned towards v, along the height."""
    specularity: float
    """Of the reflected ray, with a Gaussian sun."""


class Facets(NamedTuple):
    """Facets of every mirror of a field; one for a mirror in one piece."""

    columns: int
    """Number along the width."""
    rows: int
    """Number along the height."""
    gap: float
    """Between facets. [m]"""


class Frame(NamedTuple):
    """A mirror at an instant."""

    n: Vector
    """Normal of its centre."""
    u: Vector
    """Axes along the width and the height."""
    v: Vector
    r: Vector
    """Direction of the ray that is reflected at the centre; e1, e2 and r are a right-handed frame."""
    e1: Vector
    e2: Vector


@inline
def frame_of(sun, target, tracking, roll):
    """Frame of a mirror that reflects the sun to the target, both given as directions.

    With `ROLLED` it is that of spinning-elevation, turned by `roll` about the normal. [rad]
    """
    n = unit(mixed(1.0, sun, 1.0, target))
    e1 = unit(cross((0.0, 0.0, 1.0) if abs(target[2]) < 0.9 else (1.0, 0.0, 0.0), target))
    u = (-n[1], n[0], 0.0) if tracking == AZIMUTH_ELEVATION else cross(target, sun)
    if dot(u, u) < 1e-30:
        u = (1.0, 0.0, 0.0) if tracking == AZIMUTH_ELEVATION else (-target[1], target[0], 0.0)
        if dot(u, u) < 1e-30:
            u = (1.0, 0.0, 0.0)
    u = unit(u)
    if tracking == ROLLED:
        u = mixed(math.cos(roll), u, math.sin(roll), cross(n, u))
    return Frame(n, u, cross(n, u), target, e1, cross(target, e1))


@inline
def spread_of(frame, sun, errors):
    """Covariance of the reflected ray about the centre's: along e1, e2, and of both. [rad^2]

    A turn d of the normal turns the ray by 2 ((s.d) n + (s.n) d), twice d in the plane of incidence and 2 cos d across.
    """
    across = 2.0 * dot(sun, frame.n)
    a = mixed(2.0 * dot(sun, frame.u) * errors.slope_u, frame.n, across * errors.slope_u, frame.u)
    b = mixed(2.0 * dot(sun, frame.v) * errors.slope_v, frame.n, across * errors.slope_v, frame.v)
    a1, a2, b1, b2 = dot(a, frame.e1), dot(a, frame.e2), dot(b, frame.e1), dot(b, frame.e2)
    even = errors.specularity * errors.specularity
    return a1 * a1 + b1 * b1 + even, a2 * a2 + b2 * b2 + even, a1 * a2 + b1 * b2


@inline
def axes_of(xx, yy, xy):
    """Smaller and larger variance of a covariance, and the axis (x, y) of the larger."""
    half, turn = 0.5 * (xx - yy), 0.5 * math.atan2(2.0 * xy, xx - yy)
    root = math.sqrt(half * half + xy * xy)
    middle = 0.5 * (xx + yy)
    return middle - root, middle + root, math.cos(turn), math.sin(turn)


@inline
def facet_sides(sides, facets):
    """Width and height of each facet. [m]"""
    return (
        (sides[0] + facets.gap) / facets.columns - facets.gap,
        (sides[1] + facets.gap) / facets.rows - facets.gap,
    )


@inline
def ray_from(frame, sun, turn, a0, b0, a, b, cant, curve):
    """Ray from a point (a, b) of the facet centred at (a0, b0): its place from the mirror's centre, r, e1 and e2.

    Facets have their centres in one plane. They are tilted by `cant` times these, towards the centre, and curved by
    `curve`, one over twice the focal length. [1/m] All normals are turned by `turn`, a fixed pointing error. [rad]
    """
    tilt_u, tilt_v = cant * a0 + curve * a - turn[0], cant * b0 + curve * b - turn[1]
    rise = cant * (a0 * a + b0 * b) + 0.5 * curve * (a * a + b * b)
    place = mixed(1.0, mixed(a0 + a, frame.u, b0 + b, frame.v), rise, frame.n)
    n = mixed(1.0, frame.n, -1.0, mixed(tilt_u, frame.u, tilt_v, frame.v))
    r = mixed(2.0 * dot(sun, n) / dot(n, n), n, -1.0, sun)
    e2 = cross(r, frame.e1)
    scale = 1.0 / math.sqrt(dot(e2, e2))
    e2 = (scale * e2[0], scale * e2[1], scale * e2[2])
    return place, r, cross(e2, r), e2

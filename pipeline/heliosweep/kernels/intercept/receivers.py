"""Receivers, and their outlines as mirrors and points of them see these."""

import math
from typing import NamedTuple

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.intercept.outline import MOST, PANELS, SIGHT, STRAIGHT
from heliosweep.kernels.vectors import ROW, cross, dot, mixed

RECTANGLE, CYLINDER = 0, 1
"""A flat rectangle, seen from one side; the outside of an upright cylinder, without its ends."""

LEAST_ERROR = 0.1e-3
"""Least blur that is computed with. [rad] A sharper image is blurred by so much, which moves no edge."""
SECTORS, PANEL = 4, 7.0
"""Least panels of an arc, and their length in that over which light changes, `Light.smooth`."""


class Receiver(NamedTuple):
    """Where light is wanted."""

    kind: int
    """`RECTANGLE` or `CYLINDER`."""
    centre: tuple[float, float, float]
    """Centre of the rectangle or of the cylinder: east, north, up. [m]"""
    across: tuple[float, float, float]
    """Unit vectors along the width and the height of a rectangle; its face is on the side of their product."""
    upward: tuple[float, float, float]
    half_width: float
    """Half the width of a rectangle, or the radius of a cylinder. [m]"""
    half_height: float
    """Half the height. [m]"""


def rectangle(centre: tuple[float, float, float], azimuth: float, tilt: float, width: float, height: float) -> Receiver:
    """A rectangle with its centre, the direction it faces, and its sides. [m, rad]

    `azimuth` is from north, clockwise, `tilt` up from the horizon: negative for a face that looks down.
    """
    sine, cosine = math.sin(azimuth), math.cos(azimuth)
    upward = (-sine * math.sin(tilt), -cosine * math.sin(tilt), math.cos(tilt))
    return Receiver(RECTANGLE, centre, (-cosine, sine, 0.0), upward, width / 2, height / 2)


def cylinder(centre: tuple[float, float, float], radius: float, height: float) -> Receiver:
    """An upright cylinder with its centre. [m]"""
    return Receiver(CYLINDER, centre, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), radius, height / 2)


@inline
def order_of(wanted):
    """Order of a rule, at most the highest there is."""
    return min(MOST, math.ceil(wanted))


@inline
def distance(place, receiver):
    """Distance of the receiver. [m]"""
    d = mixed(1.0, receiver.centre, -1.0, place)
    return math.sqrt(dot(d, d))


@inner
def window_of(place, r, receiver):
    """Part of the receiver that is not far from the ray of the centre: first and last place along width and height.

    Light ends long before; without this, an edge could be behind the mirror.
    """
    d = mixed(1.0, receiver.centre, -1.0, place)
    if receiver.kind == RECTANGLE:
        face = cross(receiver.across, receiver.upward)
        down, away = dot(r, face), dot(d, face)
        if not (down < 0.0 and away < 0.0):
            return 0.0, 0.0, 0.0, 0.0
        far = away / down
        hit = mixed(far, r, -1.0, d)
        x, y, far = dot(hit, receiver.across), dot(hit, receiver.upward), 0.5 * far
        return (
            max(-receiver.half_width, x - far), min(receiver.half_width, x + far),
            max(-receiver.half_height, y - far), min(receiver.half_height, y + far),
        )  # fmt: skip
    far = math.sqrt(d[0] * d[0] + d[1] * d[1])
    level = math.sqrt(r[0] * r[0] + r[1] * r[1])
    if far <= receiver.half_width or level < 1e-9:
        return 0.0, 0.0, 0.0, 0.0
    y = (far - receiver.half_width) * r[2] / level - d[2]
    return -1.0, 1.0, max(-receiver.half_height, y - far), min(receiver.half_height, y + far)


@inline
def behind(point, receiver):
    """True for a part of a mirror that is behind the face of a rectangle."""
    if receiver.kind != RECTANGLE:
        return False
    return not dot(mixed(1.0, point, -1.0, receiver.centre), cross(receiver.across, receiver.upward)) > 0.0


@inner
def outline_of(place, receiver, window, rules, smooth, outline):
    """Write the outline of a receiver as a mirror at a place faces it; returns its corners, and the order of an arc.

    Of a cylinder it goes along the upper rim, and back along the lower one. The nodes of their arcs are those of the
    tangent of half the angle.
    """
    if receiver.kind == RECTANGLE:
        for k in range(4):
            x, y = window[1 if k >= 2 else 0], window[3 if k == 1 or k == 2 else 2]
            outline.corners[0, k], outline.corners[1, k], outline.corners[2, k] = x, 0.0, y
            outline.panel[k] = STRAIGHT
        return 4, 0
    px, py = place[0] - receiver.centre[0], place[1] - receiver.centre[1]
    part = receiver.half_width / math.sqrt(px * px + py * py)
    widest = math.sqrt((1.0 - part) / (1.0 + part))
    length = 2.0 * part / SECTORS / smooth
    parts = max(1, math.ceil(length / PANEL))
    panels = min(PANELS, SECTORS * parts)
    order = order_of(rules.fine * (2.5 + length / parts))
    for p in range(panels):
        for k in range(order):
            turn = widest * (2.0 * (p + rules.line[order, 0, k]) / panels - 1.0)
            c, s = _at_half(turn, receiver.half_width)
            outline.nodes[0, p * order + k], outline.nodes[1, p * order + k] = c, s
            outline.nodes[2, p * order + k] = 4.0 * widest / panels * rules.line[order, 1, k] / (1.0 + turn * turn)
    for p in range(panels + 1):
        c, s = _at_half(widest * (2.0 * p / panels - 1.0), receiver.half_width)
        for k, z in ((p, window[3]), (2 * panels + 1 - p, window[2])):
            outline.corners[0, k], outline.corners[1, k], outline.corners[2, k] = c, s, z
        outline.panel[p] = p - 1 if p > 0 else STRAIGHT
        outline.panel[panels + 1 + p] = panels - p if p > 0 else STRAIGHT
    return 2 * (panels + 1), order


@inline
def _at_half(turn, radius):
    """Cosine and sine of an angle, times a radius, by the tangent of its half."""
    scale = radius / (1.0 + turn * turn)
    return scale * (1.0 - turn * turn), 2.0 * scale * turn


@inline
def face(lanes, i, point, r, x, y, receiver):
    """Write the vectors with which lane i, a point, sees the receiver: along a ray, and coordinates along x and y.

    They are those of the outline's c, s and z, and of the receiver's centre; see `outline.Outline`.
    """
    d, east, north = mixed(1.0, receiver.centre, -1.0, point), receiver.across, (0.0, 0.0, 0.0)
    if receiver.kind != RECTANGLE:
        scale = -1.0 / math.sqrt(d[0] * d[0] + d[1] * d[1])
        east = (scale * d[0], scale * d[1], 0.0)
        north = (-east[1], east[0], 0.0)
    _along(lanes, SIGHT + i, east, r, x, y)
    _along(lanes, SIGHT + 3 * ROW + i, north, r, x, y)
    _along(lanes, SIGHT + 6 * ROW + i, receiver.upward, r, x, y)
    _along(lanes, SIGHT + 9 * ROW + i, d, r, x, y)


@inline
def _along(lanes, row, v, r, x, y):
    """Write the parts of a vector along three others."""
    lanes[row], lanes[row + ROW], lanes[row + 2 * ROW] = dot(v, r), dot(v, x), dot(v, y)


@inline
def apart_of(ax, ay, bx, by):
    """Distance of the line from a to b, positive with the ray to its left. [rad]"""
    return (ax * by - ay * bx) / math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)

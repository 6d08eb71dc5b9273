"""Receivers, and the part of the light of one point of a mirror that meets them."""

import math
from typing import NamedTuple

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.intercept.outline import BENT, along_edge, crosses, far_from, gap, over_cut, turned
from heliosweep.kernels.intercept.tables import look_up
from heliosweep.kernels.vectors import cross, dot, mixed

RECTANGLE, CYLINDER = 0, 1
"""A flat rectangle, seen from one side; the outside of an upright cylinder, without its ends."""

LEAST_ERROR = 0.1e-3
"""Least blur that is computed with. [rad] A sharper image is blurred by so much, which moves no edge."""
SECTORS, PANEL = 4, 7.0
"""Least panels of an arc, and their length in that over which light changes, `Light.smooth`."""
MOST, PANELS = 32, 64
"""Most nodes of a rule, and most panels of an arc."""


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
def _vertex(k, receiver, window):
    """Corner of a rectangle, in the order in which it turns left about a ray that meets its face. [m]"""
    x, y = window[1 if k >= 2 else 0], window[3 if k == 1 or k == 2 else 2]
    return mixed(1.0, receiver.centre, 1.0, mixed(x, receiver.across, y, receiver.upward))


@inline
def behind(point, receiver):
    """True for a part of a mirror that is behind the face of a rectangle."""
    if receiver.kind != RECTANGLE:
        return False
    return not dot(mixed(1.0, point, -1.0, receiver.centre), cross(receiver.across, receiver.upward)) > 0.0


@inner
def corners_of(place, receiver, window, rules, smooth, room):
    """Write the corners of a receiver's outline as a mirror at a place faces it; returns panels and order of an arc.

    Of a rectangle they are places in space. Of a cylinder they are cosine and sine, times the radius, of the angle from
    the direction of the mirror: of the ends of the panels of its near half, and of nodes, with their weights; the first
    end of a panel stands before its nodes. Nodes are those of the tangent of half the angle.
    """
    if receiver.kind == RECTANGLE:
        for k in range(4):
            corner = _vertex(k, receiver, window)
            room.rim[0, k], room.rim[1, k], room.rim[2, k] = corner
        return 0, 0
    px, py = place[0] - receiver.centre[0], place[1] - receiver.centre[1]
    part = receiver.half_width / math.sqrt(px * px + py * py)
    widest = math.sqrt((1.0 - part) / (1.0 + part))
    length = 2.0 * part / SECTORS / smooth
    parts = max(1, math.ceil(length / PANEL))
    panels = min(PANELS, SECTORS * parts)
    order = order_of(rules.fine * (2.5 + length / parts))
    for m in range(panels * (order + 1) + 1):
        p, k = m // (order + 1), m % (order + 1)
        turn = widest * (2.0 * (p + (rules.line[order, 0, k - 1] if k > 0 else 0.0)) / panels - 1.0)
        scale = 1.0 / (1.0 + turn * turn)
        room.rim[0, m] = receiver.half_width * scale * (1.0 - turn * turn)
        room.rim[1, m] = 2.0 * receiver.half_width * scale * turn
        room.rim[2, m] = 4.0 * widest / panels * scale * (rules.line[order, 1, k - 1] if k > 0 else 0.0)
    return panels, order


@inline
def outline_of(point, r, x, y, receiver, panels, order, window, room):
    """Write the corners of the outline that a point sees, in coordinates along x and y; returns their number, rims.

    They turn left about a ray inside. Of a cylinder they go along the upper rim, and back along the lower one; of each
    rim three vectors make its coordinates: those of the axis's point at its height, of the cosine and of the sine.
    """
    if receiver.kind == RECTANGLE:
        for k in range(4):
            d = mixed(1.0, (room.rim[0, k], room.rim[1, k], room.rim[2, k]), -1.0, point)
            scale = 1.0 / dot(d, r)
            room.seen[0, k], room.seen[1, k] = scale * dot(d, x), scale * dot(d, y)
        return 4
    px, py = point[0] - receiver.centre[0], point[1] - receiver.centre[1]
    far = math.sqrt(px * px + py * py)
    px, py = px / far, py / far
    room.turn[0], room.turn[1], room.turn[2] = px * r[0] + py * r[1], px * x[0] + py * x[1], px * y[0] + py * y[1]
    room.turn[3], room.turn[4], room.turn[5] = px * r[1] - py * r[0], px * x[1] - py * x[0], px * y[1] - py * y[0]
    for side in range(2):
        z = receiver.centre[2] + window[3 - side] - point[2]
        for axis, a in enumerate((r, x, y)):
            room.turn[6 + 3 * side + axis] = z * a[2] - far * room.turn[axis]
        for p in range(panels + 1):
            m = (panels - p if side else p) * (order + 1)
            sx, sy, _, _ = _on_rim(room, side, m)
            room.seen[0, p + side * (panels + 1)], room.seen[1, p + side * (panels + 1)] = sx, sy
    return 2 * (panels + 1)


@inline
def _on_rim(room, side, m):
    """Coordinates of a node of a rim, and how they move with the angle."""
    c, s, t = room.rim[0, m], room.rim[1, m], room.turn
    along = 1.0 / (c * t[0] + s * t[3] + t[6 + 3 * side])
    x, y = along * (c * t[1] + s * t[4] + t[7 + 3 * side]), along * (c * t[2] + s * t[5] + t[8 + 3 * side])
    slope = c * t[3] - s * t[0]
    return x, y, along * (c * t[4] - s * t[1] - x * slope), along * (c * t[5] - s * t[2] - y * slope)


@inline
def _bent(k, panels):
    """True for a piece of an outline, from its corner k to the next, that is an arc."""
    return panels > 0 and k != panels and k != 2 * panels + 1


@inner
def nearest(count, panels, room):
    """Distance of an outline from the ray, at most; and whether the ray is inside. [rad]"""
    least, inside = math.inf, False
    for k in range(count):
        n = k + 1 if k + 1 < count else 0
        ax, ay, bx, by = room.seen[0, k], room.seen[1, k], room.seen[0, n], room.seen[1, n]
        apart = gap(ax, ay, bx, by)
        if _bent(k, panels):
            apart -= BENT * math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
        least, inside = min(least, apart), inside != crosses(ax, ay, bx, by)
    return least, inside


@inline
def within(count, panels, order, room, light, rules):
    """Part of the light of one point that is within the outline."""
    total, first, before = 0.0, False, False  # whether the first piece begins, and the last one ends, within the reach
    for k in range(count):
        n = k + 1 if k + 1 < count else 0
        ax, ay, bx, by = room.seen[0, k], room.seen[1, k], room.seen[0, n], room.seen[1, n]
        if not _bent(k, panels):
            part, start, stop = along_edge(ax, ay, bx, by, light, rules)
        elif far_from(ax, ay, bx, by, light.reach + BENT * math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)):
            part, start, stop = 0.0, 0.0, 0.0
        else:
            part, start, stop = _along_arc(k, panels, order, room, light), 0.0, 1.0
        total += part
        begins = start == 0.0 and stop > 0.0
        if k == 0:
            first = begins
        elif begins != before:
            total += turned(ax, ay, light) if begins else -turned(ax, ay, light)
        before = stop == 1.0
        if start > 0.0 or stop < 1.0:
            total += over_cut(ax, ay, bx, by)
            if start < stop:
                px, py = ax + start * (bx - ax), ay + start * (by - ay)
                qx, qy = ax + stop * (bx - ax), ay + stop * (by - ay)
                total -= over_cut(px, py, qx, qy)
                if start > 0.0:
                    total += turned(px, py, light)
                if stop < 1.0:
                    total -= turned(qx, qy, light)
    if first != before:
        ends = turned(room.seen[0, 0], room.seen[1, 0], light)
        total += ends if first else -ends
    return total / (2.0 * math.pi)


@inline
def _along_arc(k, panels, order, room, light):
    """Integral of F dphi along the panel of a rim that begins at corner k. [rad]"""
    side = 1 if k > panels else 0
    p = 2 * panels - k if side else k
    part = 0.0
    for m in range(p * (order + 1) + 1, (p + 1) * (order + 1)):
        x, y, dx, dy = _on_rim(room, side, m)
        part += room.rim[2, m] * (x * dy - y * dx) * look_up(light, x, y)
    return part if side == 0 else -part


@inline
def apart_of(ax, ay, bx, by):
    """Distance of the line from a to b, positive with the ray to its left. [rad]"""
    return (ax * by - ay * bx) / math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)

"""Receivers, and the part of the light of one point of a mirror that meets them."""

import math
from typing import NamedTuple

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.intercept.outline import PANEL, SECTORS, along_arc, along_segment, beyond_corner
from heliosweep.kernels.intercept.tables import TAIL, beyond, collapse
from heliosweep.kernels.vectors import cross, dot, mixed

RECTANGLE, CYLINDER = 0, 1
"""A flat rectangle, seen from one side; the outside of an upright cylinder, without its ends."""

LEAST_ERROR = 0.1e-3
"""Least blur that is computed with. [rad] A sharper image is blurred by so much, which moves no edge."""
LITTLE = 1e-6
"""Light beyond an edge or corner that makes no difference. [1]"""
LEAST_EFFORT = 0.6
"""Least part of the usual numbers of nodes, for light that is nearly all within a receiver, or beyond it."""
MOST, MOST_SHIFTS, PANELS = 32, 64, 16 * SECTORS
"""Most nodes of a rule, most shifts of light, and most panels of an arc."""


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
def _shifts(effort, view, rules):
    """Number of shifts of light, at most the most there are."""
    return min(MOST_SHIFTS, math.ceil(1.0 + rules.fine * effort * view.wanted))


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
def _seen(vertex, point, r, e1, e2):
    """Gnomonic coordinates of a vertex seen from a point. [rad]"""
    d = mixed(1.0, vertex, -1.0, point)
    scale = 1.0 / dot(d, r)
    return scale * dot(d, e1), scale * dot(d, e2)


@inline
def _corners(point, r, e1, e2, receiver, window):
    """Gnomonic coordinates x, y of the corners of a rectangle seen from a point. [rad]"""
    x0, y0 = _seen(_vertex(0, receiver, window), point, r, e1, e2)
    x1, y1 = _seen(_vertex(1, receiver, window), point, r, e1, e2)
    x2, y2 = _seen(_vertex(2, receiver, window), point, r, e1, e2)
    x3, y3 = _seen(_vertex(3, receiver, window), point, r, e1, e2)
    return (x0, x1, x2, x3), (y0, y1, y2, y3)


@inner
def edge_tables(place, r, e1, e2, spread, moved, receiver, window, tables, room):
    """Make the table of each edge that light comes near, with the variance across it as the mirror's centre sees it.

    Returns the light that is lost beyond the other edges, and the most that any point of the mirror may lose at an edge
    with a table.
    """
    xs, ys = _corners(place, r, e1, e2, receiver, window)
    lost, most = 0.0, 0.0
    for k in range(4):
        apart, variance = _edge(k, xs, ys, spread)
        room.known[k, 1] = 0.0
        if apart - moved < tables.edge + TAIL * math.sqrt(variance):
            step, reach, _ = collapse(tables.beyond, tables, variance, room.edges[k])
            highest = beyond(room.edges[k], step, reach, apart - moved)
            most = max(most, highest)
            if highest < LITTLE:
                lost += beyond(room.edges[k], step, reach, apart)
            else:
                room.known[k, 0], room.known[k, 1], room.known[k, 2] = step, reach, variance
            if beyond(room.edges[k], step, reach, apart + moved) > 1.0 - LITTLE:
                return 1.0, 0.0
    return lost, most


@inline
def _edge(k, xs, ys, spread):
    """Distance of an edge, positive with the ray to its left [rad], and the variance across it, at least the least."""
    n = (k + 1) % 4
    tx, ty = xs[n] - xs[k], ys[n] - ys[k]
    scale = 1.0 / (tx * tx + ty * ty)
    variance = scale * (ty * ty * spread[0] + tx * tx * spread[1] - 2.0 * tx * ty * spread[2])
    return (xs[k] * ty - ys[k] * tx) * math.sqrt(scale), max(variance, LEAST_ERROR * LEAST_ERROR)


@inline
def on_rectangle(point, r, e1, e2, receiver, window, spread, edges, known, view, level, rules):
    """Part of the light of one point that meets a rectangle: with round corners, or what is exact beyond these."""
    if not dot(mixed(1.0, point, -1.0, receiver.centre), cross(receiver.across, receiver.upward)) > 0.0:
        return 0.0  # a part of the mirror that is behind the face
    xs, ys = _corners(point, r, e1, e2, receiver, window)
    a, b, c = view.stretch
    us = (a * xs[0] + b * ys[0], a * xs[1] + b * ys[1], a * xs[2] + b * ys[2], a * xs[3] + b * ys[3])
    vs = (b * xs[0] + c * ys[0], b * xs[1] + c * ys[1], b * xs[2] + c * ys[2], b * xs[3] + c * ys[3])
    total, lost = 1.0 - level, (1.0, 1.0, 1.0, 1.0)
    if level == 0:
        lost = (
            _beyond_edge(0, xs, ys, spread, edges, known), _beyond_edge(1, xs, ys, spread, edges, known),
            _beyond_edge(2, xs, ys, spread, edges, known), _beyond_edge(3, xs, ys, spread, edges, known),
        )  # fmt: skip
        total = 1.0 - lost[0] - lost[1] - lost[2] - lost[3]
    for k in range(4):
        before = (k + 3) % 4
        if not (known[k, 1] > 0.0 and known[before, 1] > 0.0 and min(lost[k], lost[before]) > LITTLE):
            continue
        about = _beyond_corner(k, us, vs, 0.0, 0.0, view.round, rules)
        if level == 0:
            total += about
        elif about > LITTLE:
            total -= about
            count = _shifts(1.0 if about > 1e-3 else 0.8, view, rules)
            for h in range(count):
                shift = view.excess * rules.spread[count, 0, h]
                part = _beyond_corner(k, xs, ys, shift * view.axis[0], shift * view.axis[1], view.small, rules)
                total += rules.spread[count, 1, h] * part
    return total


@inline
def _beyond_edge(k, xs, ys, spread, edges, known):
    """Light beyond an edge, 0 for one without a table."""
    if known[k, 1] == 0.0:
        return 0.0
    apart, variance = _edge(k, xs, ys, spread)
    return beyond(edges[k], known[k, 0], known[k, 1], apart, variance - known[k, 2])


@inner
def _beyond_corner(k, xs, ys, shift_x, shift_y, light, rules):
    """Light beyond both edges at a corner; it is centred at the shift."""
    before, n = (k + 3) % 4, (k + 1) % 4
    ix, iy, ox, oy = xs[k] - xs[before], ys[k] - ys[before], xs[n] - xs[k], ys[n] - ys[k]
    first, second = 1.0 / math.sqrt(ix * ix + iy * iy), 1.0 / math.sqrt(ox * ox + oy * oy)
    return beyond_corner(
        xs[k] - shift_x, ys[k] - shift_y, first * ix, first * iy, second * ox, second * oy, light, rules
    )


@inner
def well_inside(point, away, r, e1, e2, receiver, window):
    """True where a cylinder, seen from below, has all light: its outline is farther than `away` from the ray. [rad]

    Bounds within the outline are both edges, the chord of the upper rim, and the tangent of the lower rim in front.
    """
    px, py = point[0] - receiver.centre[0], point[1] - receiver.centre[1]
    far = math.sqrt(px * px + py * py)
    low, high = receiver.centre[2] + window[2], receiver.centre[2] + window[3]
    if point[2] >= low:
        return False
    px, py = px / far, py / far
    cosine = receiver.half_width * receiver.half_width / far
    sine = receiver.half_width * math.sqrt(1.0 - (receiver.half_width / far) ** 2)
    x, y = receiver.centre[0] + cosine * px, receiver.centre[1] + cosine * py
    front = receiver.half_width - cosine
    aside_x, aside_y = -sine * py, sine * px
    ax, ay = _seen((x + front * px - aside_x, y + front * py - aside_y, low), point, r, e1, e2)
    bx, by = _seen((x + front * px + aside_x, y + front * py + aside_y, low), point, r, e1, e2)
    if not apart_of(ax, ay, bx, by) < -away:
        return False
    ax, ay = _seen((x - aside_x, y - aside_y, low), point, r, e1, e2)
    bx, by = _seen((x + aside_x, y + aside_y, low), point, r, e1, e2)
    cx, cy = _seen((x + aside_x, y + aside_y, high), point, r, e1, e2)
    dx, dy = _seen((x - aside_x, y - aside_y, high), point, r, e1, e2)
    return apart_of(bx, by, cx, cy) < -away and apart_of(cx, cy, dx, dy) < -away and apart_of(dx, dy, ax, ay) < -away


@inline
def apart_of(ax, ay, bx, by):
    """Distance of the line from a to b, positive with the ray to its left. [rad]"""
    return (ax * by - ay * bx) / math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)


@inner
def along_rim(place, receiver, sigma, rules, rim):
    """Write nodes along the near arc of a rim: cosine and sine times the radius, weight; returns panels and order.

    The angle is from the direction of the mirror. Nodes are those of the tangent of its half.
    """
    px, py = place[0] - receiver.centre[0], place[1] - receiver.centre[1]
    part = receiver.half_width / math.sqrt(px * px + py * py)
    widest = math.sqrt((1.0 - part) / (1.0 + part))
    length = 2.0 * part / SECTORS / sigma
    parts = max(1, math.ceil(length / PANEL))
    panels = min(PANELS, SECTORS * parts)
    order = order_of(rules.fine * (2.5 + length / parts))
    for m in range(panels * (order + 1) + order + 1):
        p, k = m // (order + 1), m % (order + 1)
        turn = widest * (2.0 * (p + (rules.line[order, 0, k] if k < order else 0.0)) / panels - 1.0)
        scale = 1.0 / (1.0 + turn * turn)
        rim[0, m] = receiver.half_width * scale * (1.0 - turn * turn)
        rim[1, m] = 2.0 * receiver.half_width * scale * turn
        rim[2, m] = 4.0 * widest / panels * scale * (rules.line[order, 1, k] if k < order else 0.0)
    return panels, order


@inner
def on_cylinder(point, r, e1, e2, receiver, window, arcs, panels, order, view, level, effort, rules):
    """Part of the light of one point that meets the outside of a cylinder: round light, or what is exact beyond it."""
    a, b, c = view.stretch
    _see_rims(point, r, mixed(a, e1, b, e2), mixed(b, e1, c, e2), receiver, window, arcs, panels, order)
    total = _in_outline(arcs, panels, order, 0.0, 0.0, view.round, rules)
    if level == 0:
        return total
    total = -total
    count = _shifts(max(effort, min(1.0, view.wanted / 6.0)), view, rules)
    _see_rims(point, r, e1, e2, receiver, window, arcs, panels, order)
    for h in range(count):
        shift = view.excess * rules.spread[count, 0, h]
        x, y = shift * view.axis[0], shift * view.axis[1]
        total += rules.spread[count, 1, h] * _in_outline(arcs, panels, order, x, y, view.small, rules)
    return total


@inner
def _see_rims(point, r, e1, e2, receiver, window, arcs, panels, order):
    """Write nodes along the near arcs of the lower and of the upper rim as a point sees them, with slopes. [rad]"""
    px, py = point[0] - receiver.centre[0], point[1] - receiver.centre[1]
    far = math.sqrt(px * px + py * py)
    px, py = px / far, py / far
    pr, p1, p2 = px * r[0] + py * r[1], px * e1[0] + py * e1[1], px * e2[0] + py * e2[1]
    qr, q1, q2 = px * r[1] - py * r[0], px * e1[1] - py * e1[0], px * e2[1] - py * e2[0]
    for side in range(1, 3):
        z = receiver.centre[2] + window[1 + side] - point[2]
        zr, z1, z2 = z * r[2] - far * pr, z * e1[2] - far * p1, z * e2[2] - far * p2
        for m in range(panels * (order + 1) + order + 1):
            c, s = arcs[0, 0, m], arcs[0, 1, m]
            along = 1.0 / (c * pr + s * qr + zr)
            x, y, weight = along * (c * p1 + s * q1 + z1), along * (c * p2 + s * q2 + z2), along * arcs[0, 2, m]
            slope = c * qr - s * pr
            arcs[side, 0, m], arcs[side, 1, m] = x, y
            arcs[side, 2, m] = weight * (c * q1 - s * p1 - x * slope)
            arcs[side, 3, m] = weight * (c * q2 - s * p2 - y * slope)


@inner
def _in_outline(arcs, panels, order, x, y, light, rules):
    """Light, centred at (x, y), within the near arcs of both rims and the two lines between their ends."""
    low, high, last = arcs[1], arcs[2], panels * (order + 1) + order
    total = along_arc(high, panels, order, x, y, light) - along_arc(low, panels, order, x, y, light)
    for m, sign in ((order, 1.0), (last, -1.0)):
        total += sign * along_segment(low[0, m] - x, low[1, m] - y, high[0, m] - x, high[1, m] - y, light, rules)
    return total / (2.0 * math.pi)

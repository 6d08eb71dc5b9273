"""Intercept: the part of the light of a heliostat that meets the receiver, of all that leaves the mirror towards it.

About the reflected ray of each point of a mirror the sun shape B and errors N(0, S) spread light, as the density
B * N(0, S) over gnomonic coordinates. The receiver's outline in them bounds what is counted; the intercept is the mean
over Gauss nodes of the mirror, every part of which counts the same. S is that of the mirror's centre.

Rectangle: 1, less the light beyond each edge, plus the light beyond both edges at each corner. Beyond an edge the
problem has one dimension, with the variance m'Sm for its normal m as the centre sees it; at a corner, and for a
cylinder, an outline is integrated (`outline`) with the smaller variance of S, and the excess of the larger is a sum of
Gauss and Hermite of shifts along its axis.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inner, kernel
from heliosweep.kernels.intercept.mirror import Errors, Facets, axes_of, frame_of, ray_from, spread_of
from heliosweep.kernels.intercept.outline import PANEL, along_arc, along_segment, beyond_corner, rules
from heliosweep.kernels.intercept.sunshapes import SunShape
from heliosweep.kernels.intercept.tables import Tables, beyond, collapse, tables
from heliosweep.kernels.vectors import cross, dot, mixed, unit

Floats = NDArray[np.float64]

RECTANGLE, CYLINDER = 0, 1
"""A flat rectangle, seen from one side; the outside of an upright cylinder, without its ends."""

LEAST_ERROR = 0.1e-3
"""Least blur that is computed with. [rad] A sharper image is blurred by so much, which moves no edge."""
LEAST_COSINE = 0.2
"""Cosine of incidence down to which errors are spread exactly; at grazing incidence by what they are here."""
_LITTLE = 1e-7
"""Light beyond an edge below which its corners are left out. [1]"""
_MOST, _PANELS = 32, 64
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


class Scene(NamedTuple):
    """Mirrors, a receiver, and what spreads the light between them."""

    centre: Floats
    """Centres of the mirrors: east, north, up, shape (N, 3). [m]"""
    target: Floats
    """Points that they aim at, shape (N, 3). [m]"""
    sides: Floats
    """Width and height of the mirrors, shape (N, 2). [m]"""
    curve: Floats
    """One over twice the focal length of a mirror or facet, 0 for a flat one, shape (N,). [1/m]"""
    cant: Floats
    """One over twice the distance that facets are canted for, 0 for facets in one plane, shape (N,). [1/m]"""
    turn: Floats
    """Fixed pointing errors, shape (N, 2): the normal is n + turn_u u + turn_v v. [rad]"""
    facets: Facets
    """Facets of each mirror."""
    tracking: int
    """`packets.SPINNING_ELEVATION` or `packets.AZIMUTH_ELEVATION`."""
    errors: Errors
    """Random errors, with the Gaussian part of the sun, from `sun_tables`."""
    receiver: Receiver
    """From `rectangle` or `cylinder`."""
    tables: Tables
    """From `sun_tables`."""


class Rules(NamedTuple):
    """Nodes and weights of Gauss, by order."""

    mirror: Floats
    """Legendre on -1 to 1, weights with the sum 1, shape (orders, 2, orders)."""
    spread: Floats
    """Hermite, of a standard normal, shape (orders, 2, orders)."""
    outline: Floats
    """Legendre on 0 to 1, shape (2, order)."""
    fine: float
    """Factor on the numbers of nodes."""


class Room(NamedTuple):
    """Room of one heliostat and instant: tables of the light beyond each edge and in a circle, nodes along two rims."""

    edges: Floats
    circle: Floats
    arcs: Floats


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


@functools.lru_cache(8)
def gauss_rules(fine: float) -> Rules:
    """Rules for a factor on the numbers of nodes."""
    mirror, spread = np.zeros((_MOST + 1, 2, _MOST)), np.zeros((_MOST + 1, 2, _MOST))
    for order in range(1, _MOST + 1):
        place, weight = np.polynomial.legendre.leggauss(order)
        mirror[order, :, :order] = place, weight / 2
        place, weight = np.polynomial.hermite_e.hermegauss(order)
        spread[order, :, :order] = place, weight / math.sqrt(2.0 * math.pi)
    return Rules(mirror, spread, rules(round(6 * fine)), fine)


def sun_tables(sun: SunShape, errors: Errors) -> tuple[Tables, Errors]:
    """Tables of a sun for any heliostat with these errors, and the errors with the Gaussian part of the sun."""
    even = math.sqrt(errors.specularity**2 + sun.variance)
    least = even**2 + (2.0 * LEAST_COSINE * min(errors.slope_u, errors.slope_v)) ** 2
    most = even**2 + (2.0 * max(errors.slope_u, errors.slope_v)) ** 2
    least = max(least, LEAST_ERROR**2)
    return tables(sun, 0.999 * least, 1.001 * max(most, least)), errors._replace(specularity=even)


@kernel
def _sweep(scene: Scene, rules: Rules, sun: Floats, start: int, stop: int, out: Floats) -> None:
    """Write the intercept of mirrors start..stop at every instant in `out`; NaN with the sun down."""
    reach = scene.tables.beyond.shape[2]
    room = Room(np.zeros((4, 2, reach)), np.zeros((2, reach)), np.zeros((2, 4, _PANELS * (rules.outline.shape[1] + 2))))
    for i in range(start, stop):
        place = (scene.centre[i, 0], scene.centre[i, 1], scene.centre[i, 2])
        aim = (scene.target[i, 0], scene.target[i, 1], scene.target[i, 2])
        for t in range(sun.shape[0]):
            if sun[t, 2] > 0.0:
                out[i - start, t] = _intercept(
                    place, unit(mixed(1.0, aim, -1.0, place)), (scene.sides[i, 0], scene.sides[i, 1]), scene.curve[i],
                    scene.cant[i], (scene.turn[i, 0], scene.turn[i, 1]), scene.facets,
                    (sun[t, 0], sun[t, 1], sun[t, 2]), scene.tracking, scene.errors, scene.receiver, scene.tables,
                    rules, room,
                )  # fmt: skip


@inner
def _intercept(place, target, sides, curve, cant, turn, facets, sun, tracking, errors, receiver, tables, rules, room):
    """Intercept of one heliostat and instant."""
    if not dot(sun, target) > -1.0 + 1e-12:
        return 0.0
    frame = frame_of(sun, target, tracking)
    xx, yy, xy = spread_of(frame, sun, errors)
    small, large, axis_x, axis_y = axes_of(xx, yy, xy)
    small = max(small, LEAST_ERROR * LEAST_ERROR)
    excess = math.sqrt(max(0.0, large - small))
    window = _window(place, frame.r, receiver)
    if window[0] >= window[1] or window[2] >= window[3]:
        return 0.0
    reach = collapse(tables.within, tables.logs, tables.step, tables.edge, small, room.circle)
    sigma = math.sqrt(small)
    count = _order(1.0 + rules.fine * (2.0 + 3.0 * excess / sigma))
    reaches = (0.0, 0.0, 0.0, 0.0)
    if receiver.kind == RECTANGLE:
        _, r, e1, e2 = ray_from(frame, sun, turn, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        reaches = _edge_tables(place, r, e1, e2, xx, yy, xy, receiver, window, tables, room)
    width = (sides[0] + facets.gap) / facets.columns - facets.gap
    height = (sides[1] + facets.gap) / facets.rows - facets.gap
    far = _distance(place, receiver)
    nodes_u = _nodes(frame, sun, 0.5 * width, 0.0, curve, far, sigma, rules.fine)
    nodes_v = _nodes(frame, sun, 0.0, 0.5 * height, curve, far, sigma, rules.fine)
    total = 0.0
    for facet in range(facets.columns * facets.rows):
        a0 = (facet % facets.columns - 0.5 * (facets.columns - 1)) * (width + facets.gap)
        b0 = (facet // facets.columns - 0.5 * (facets.rows - 1)) * (height + facets.gap)
        for j in range(nodes_u):
            for k in range(nodes_v):
                a, b = 0.5 * width * rules.mirror[nodes_u, 0, j], 0.5 * height * rules.mirror[nodes_v, 0, k]
                offset, r, e1, e2 = ray_from(frame, sun, turn, a0, b0, a, b, cant, curve)
                point = mixed(1.0, place, 1.0, offset)
                if receiver.kind == RECTANGLE:
                    part = _on_rectangle(
                        point, r, e1, e2, receiver, window, tables, room, reaches, reach, sigma, excess, axis_x, axis_y,
                        count, rules,
                    )  # fmt: skip
                else:
                    part = _on_cylinder(
                        point, r, e1, e2, receiver, window, tables, room, reach, sigma, excess, axis_x, axis_y, count,
                        rules,
                    )  # fmt: skip
                total += rules.mirror[nodes_u, 1, j] * rules.mirror[nodes_v, 1, k] * part
    return min(1.0, max(0.0, total / (facets.columns * facets.rows)))


@inner
def _order(wanted):
    """Order of a rule, at most the highest there is."""
    return min(_MOST, math.ceil(wanted))


@inner
def _distance(place, receiver):
    """Distance of the receiver. [m]"""
    d = mixed(1.0, receiver.centre, -1.0, place)
    return math.sqrt(dot(d, d))


@inner
def _nodes(frame, sun, a, b, curve, far, sigma, fine):
    """Nodes along half a side of a facet: more, the farther its image moves, in standard deviations of the blur."""
    offset, r, _, _ = ray_from(frame, sun, (0.0, 0.0), 0.0, 0.0, a, b, 0.0, curve)
    d = mixed(1.0, offset, far, mixed(1.0, r, -1.0, frame.r))
    along = dot(d, frame.r)
    moved = math.sqrt(max(0.0, dot(d, d) - along * along)) / far
    return _order(fine * (2.5 + 1.3 * moved / sigma))


@inner
def _window(place, r, receiver):
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


@inner
def _vertex(k, receiver, window):
    """Corner of a rectangle, in the order in which it turns left about a ray that meets its face. [m]"""
    x, y = window[1 if k >= 2 else 0], window[3 if k == 1 or k == 2 else 2]
    return mixed(1.0, receiver.centre, 1.0, mixed(x, receiver.across, y, receiver.upward))


@inner
def _seen(vertex, point, r, e1, e2):
    """Gnomonic coordinates of a vertex seen from a point. [rad]"""
    d = mixed(1.0, vertex, -1.0, point)
    along = dot(d, r)
    return dot(d, e1) / along, dot(d, e2) / along


@inner
def _edge_tables(place, r, e1, e2, xx, yy, xy, receiver, window, tables, room):
    """Make the table of each edge, with the variance across it as the mirror's centre sees it; returns the reaches."""
    found = (0.0, 0.0, 0.0, 0.0)
    for k in range(4):
        x, y = _seen(_vertex(k, receiver, window), place, r, e1, e2)
        x1, y1 = _seen(_vertex((k + 1) % 4, receiver, window), place, r, e1, e2)
        tx, ty = x1 - x, y1 - y
        variance = (ty * ty * xx + tx * tx * yy - 2.0 * tx * ty * xy) / (tx * tx + ty * ty)
        variance = max(variance, LEAST_ERROR * LEAST_ERROR)
        reach = collapse(tables.beyond, tables.logs, tables.step, tables.edge, variance, room.edges[k])
        found = (found[1], found[2], found[3], reach)
    return found


@inner
def _on_rectangle(
    point, r, e1, e2, receiver, window, tables, room, reaches, reach, sigma, excess, axis_x, axis_y, count, rules
):
    """Part of the light of one point that meets a rectangle."""
    x0, y0 = _seen(_vertex(0, receiver, window), point, r, e1, e2)
    x1, y1 = _seen(_vertex(1, receiver, window), point, r, e1, e2)
    x2, y2 = _seen(_vertex(2, receiver, window), point, r, e1, e2)
    x3, y3 = _seen(_vertex(3, receiver, window), point, r, e1, e2)
    xs, ys = (x0, x1, x2, x3), (y0, y1, y2, y3)
    total, before, before_x, before_y, first, first_x, first_y = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(5):
        if k < 4:
            n = (k + 1) % 4
            tx, ty = xs[n] - xs[k], ys[n] - ys[k]
            length = math.sqrt(tx * tx + ty * ty)
            tx, ty = tx / length, ty / length
            lost = beyond(room.edges[k], tables.step, reaches[k], xs[k] * ty - ys[k] * tx)
            total -= lost
        else:
            lost, tx, ty = first, first_x, first_y
        if k == 0:
            first, first_x, first_y = lost, tx, ty
        elif min(lost, before) > _LITTLE:
            x, y = xs[k % 4], ys[k % 4]
            for h in range(count):
                shift = excess * rules.spread[count, 0, h]
                total += rules.spread[count, 1, h] * beyond_corner(
                    x - shift * axis_x, y - shift * axis_y, before_x, before_y, tx, ty, room.circle, tables.step, reach,
                    sigma, rules.outline,
                )  # fmt: skip
        before, before_x, before_y = lost, tx, ty
    return total


@inner
def _well_inside(point, px, py, far, widest, r, e1, e2, receiver, window, away):
    """True where a cylinder, seen from below, has all light: its outline is farther than `away` from the ray. [rad]

    Bounds within the outline are both edges, the chord of the upper rim, and the tangent of the lower rim in front.
    """
    low, high = receiver.centre[2] + window[2], receiver.centre[2] + window[3]
    if point[2] >= low:
        return False
    cosine, sine = receiver.half_width * math.cos(widest), receiver.half_width * math.sin(widest)
    x, y = receiver.centre[0] + cosine * px, receiver.centre[1] + cosine * py
    front = receiver.half_width - cosine
    aside_x, aside_y = -sine * py, sine * px
    ax, ay = _seen((x + front * px - aside_x, y + front * py - aside_y, low), point, r, e1, e2)
    bx, by = _seen((x + front * px + aside_x, y + front * py + aside_y, low), point, r, e1, e2)
    if not _apart(ax, ay, bx, by) < -away:
        return False
    ax, ay = _seen((x - aside_x, y - aside_y, low), point, r, e1, e2)
    bx, by = _seen((x + aside_x, y + aside_y, low), point, r, e1, e2)
    cx, cy = _seen((x + aside_x, y + aside_y, high), point, r, e1, e2)
    dx, dy = _seen((x - aside_x, y - aside_y, high), point, r, e1, e2)
    return _apart(bx, by, cx, cy) < -away and _apart(cx, cy, dx, dy) < -away and _apart(dx, dy, ax, ay) < -away


@inner
def _apart(ax, ay, bx, by):
    """Distance of the line from a to b, positive with the ray to its left. [rad]"""
    return (ax * by - ay * bx) / math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)


@inner
def _on_cylinder(point, r, e1, e2, receiver, window, tables, room, reach, sigma, excess, axis_x, axis_y, count, rules):
    """Part of the light of one point that meets the outside of a cylinder."""
    px, py = point[0] - receiver.centre[0], point[1] - receiver.centre[1]
    far = math.sqrt(px * px + py * py)
    if far <= receiver.half_width:
        return 0.0
    px, py = px / far, py / far
    widest, nodes = math.acos(receiver.half_width / far), rules.outline.shape[1]
    away = reach + excess * abs(rules.spread[count, 0, 0])
    if _well_inside(point, px, py, far, widest, r, e1, e2, receiver, window, away):
        return 1.0
    length = 2.0 * receiver.half_width * widest / far
    panels = int(min(_PANELS, max(2.0, math.ceil(rules.fine * length / (PANEL * sigma)))))
    used = panels * (nodes + 2)
    for side in range(2):
        z, near = receiver.centre[2] + window[2 + side] - point[2], True
        for m in range(used - 1, -1, -1):  # of each panel the ends first
            p, k = m // (nodes + 2), m % (nodes + 2)
            if k < nodes and not near:
                continue
            part = rules.outline[0, k] if k < nodes else 1.0 * (k - nodes)
            psi = widest * (2.0 * (p + part) / panels - 1.0)
            cosine, sine = receiver.half_width * math.cos(psi), receiver.half_width * math.sin(psi)
            d = ((cosine - far) * px - sine * py, (cosine - far) * py + sine * px, z)
            onward = (-sine * px - cosine * py, cosine * px - sine * py, 0.0)
            along = dot(d, r)
            x, y, slope = dot(d, e1) / along, dot(d, e2) / along, dot(onward, r) / along
            weight = 2.0 * widest / panels * (rules.outline[1, k] if k < nodes else 0.0)
            room.arcs[side, 0, m], room.arcs[side, 1, m] = x, y
            near = x * x + y * y <= (away + 2.0 * length / panels) ** 2 if k >= nodes else near
            room.arcs[side, 2, m] = weight * (dot(onward, e1) / along - x * slope)
            room.arcs[side, 3, m] = weight * (dot(onward, e2) / along - y * slope)
    total, last = 0.0, used - 1
    low, high = room.arcs[0], room.arcs[1]
    for h in range(count):
        shift = excess * rules.spread[count, 0, h]
        x, y = shift * axis_x, shift * axis_y
        part = along_arc(high, used, nodes, x, y, room.circle, tables.step, reach, length / panels)
        part -= along_arc(low, used, nodes, x, y, room.circle, tables.step, reach, length / panels)
        for m, sign in ((nodes, 1.0), (last, -1.0)):
            part += sign * along_segment(
                low[0, m] - x, low[1, m] - y, high[0, m] - x, high[1, m] - y, room.circle, tables.step, reach, sigma,
                rules.outline,
            )  # fmt: skip
        total += rules.spread[count, 1, h] * part
    return total / (2.0 * math.pi)


def intercepts(scene: Scene, sun: Floats, start: int = 0, stop: int | None = None, fine: float = 1.0) -> Floats:
    """Intercept of mirrors start..stop at instants, each computed.

    Parameters
    ----------
    scene : Scene
        Mirrors and receiver.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up. [1]
    start, stop : int
        First mirror, and the one after the last.
    fine : float
        Factor on the numbers of nodes, up to 3. [1]

    Returns
    -------
    ndarray, shape (stop - start, T)
        Part of the reflected light that meets the receiver, 0 to 1; 0 for a receiver that is seen from behind, NaN with
        the sun at or below the horizon. [1]
    """
    stop = len(scene.centre) if stop is None else stop
    out, sun = np.full((stop - start, len(sun)), np.nan), np.array(sun, np.float64, order="C")
    _sweep(scene, gauss_rules(fine), sun, start, stop, out)
    return out

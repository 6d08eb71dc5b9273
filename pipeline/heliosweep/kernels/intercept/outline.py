"""Light within an outline: the integral of F dphi / 2 pi along it, F the light within a radius, phi the direction.

Directions are gnomonic coordinates about a reflected ray, in which straight edges are straight, stretched as the light
is. F is the sum of F_m(r) cos(2 m phi). Beyond the reach F depends on phi alone: were it what it is there everywhere,
the integral around an outline would be 2 pi with the ray inside, else 0. So each edge counts with what F is less than
that, on the part of it that is within the reach: no edge needs to know of the others.

Edges are those that the points of a mirror see: a point is a lane, and the outline is gone around corner by corner.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.intercept.light import LOOKED, PART, RESULT, X, Y, folded, look_up
from heliosweep.kernels.sunshapes import DISC
from heliosweep.kernels.vectors import GROUP, ROW, whole

PANEL = 15.0
"""Length of a panel of an edge in that over which light changes, `Light.smooth`; beyond the disc that grows."""
NEAR = 3.0 * DISC
"""Distance from the ray within which light may change as fast as at the disc's edge. [rad]"""
BENT = 0.3
"""Part of its length that an arc may be beside its chord."""
PIECES, PANELS, MOST = 14, 64, 32
"""Most panels of an edge and of an arc, and most nodes of a rule."""
STRAIGHT = -1
"""Panel of an edge that is none of an arc."""

WEIGHT, SIGHT = 0, ROW
"""Rows of lanes: what a point counts with; the vectors that make coordinates of the receiver, see `receivers`."""
PLACE = 13 * ROW
"""First of the rows of what is known of a point of a mirror: see `efficiency`."""
_AX, _AY, _BX, _BY, _APART, _TX, _TY, _START, _STOP, _TURN = (k * ROW for k in range(19, 29))
_COSINE, _NOW, _OLDER = (k * ROW for k in range(29, 35, 2))
ROWS = 35 * ROW
"""Size of the lanes' room. An edge goes from a to b; then its distance from the ray and direction, first and last place
within the reach, from the foot of the ray; the integral of F dphi along the outline, were all light within."""

_HALF_PI, _QUARTER_PI, _EIGHTH = 0.5 * math.pi, 0.25 * math.pi, math.sqrt(2.0) - 1.0
_A3, _A5, _A7, _A9, _A11, _A13, _A15, _A17, _A19, _A21, _A23, _A25, _A27 = (
    (-1.0) ** k / (2 * k + 1) for k in range(1, 14)
)


class Outline(NamedTuple):
    """Outline of a receiver as a mirror faces it: corner by corner, it turns left about a ray that is inside.

    A place on it is c E + s N + z U from the receiver's centre: along its width and height for a rectangle; for a
    cylinder c and s are cosine and sine, times the radius, of the angle from the direction of the point that sees it.
    """

    corners: Floats
    """c, s and z, shape (3, corners). [m]"""
    panel: NDArray[np.int64]
    """Panel of the arc that ends at a corner; `STRAIGHT` for an edge."""
    nodes: Floats
    """c, s and weight of the nodes of an arc, panel by panel, shape (3, nodes)."""
    breaks: Floats
    """First and last place of the panels of an edge, and the length over which light changes there. [rad]"""
    lanes: Floats
    """Rows of lanes."""


@kernel
def empty_outline():
    """Room for an outline."""
    corners = 2 * PANELS + 2
    nodes, breaks = np.zeros((3, PANELS * MOST + GROUP)), np.zeros((3, PIECES))
    return Outline(np.zeros((3, corners)), np.zeros(corners, np.int64), nodes, breaks, np.zeros(ROWS))


@inline
def _seen(lanes, i, c, s, z):
    """Place on the outline as lane i sees it: along the ray, and in coordinates times that."""
    k = SIGHT + i
    return (
        c * lanes[k] + s * lanes[3 * ROW + k] + z * lanes[6 * ROW + k] + lanes[9 * ROW + k],
        c * lanes[ROW + k] + s * lanes[4 * ROW + k] + z * lanes[7 * ROW + k] + lanes[10 * ROW + k],
        c * lanes[2 * ROW + k] + s * lanes[5 * ROW + k] + z * lanes[8 * ROW + k] + lanes[11 * ROW + k],
    )


@inner
def _to_corner(lanes, width, c, s, z):
    """Go to the next corner."""
    for i in range(width):
        along, x, y = _seen(lanes, i, c, s, z)
        along = 1.0 / along
        lanes[_AX + i], lanes[_AY + i] = lanes[_BX + i], lanes[_BY + i]
        lanes[_BX + i], lanes[_BY + i] = along * x, along * y


@inline
def _line(ax, ay, bx, by):
    """Direction and length of an edge from a to b, its distance from the ray and start from the foot of the ray.

    The distance is positive, and never 0, with the ray to the left: as if it were a little above the axis x > 0. Then
    the angle that the edge counts for being over that axis.
    """
    tx, ty, cross = bx - ax, by - ay, ax * by - ay * bx
    length = math.sqrt(tx * tx + ty * ty + 1e-300)
    inverse = 1.0 / length
    tx, ty = inverse * tx, inverse * ty
    left = (cross > 0.0) | ((cross == 0.0) & (bx > ax))
    over = ((ay > 0.0) != (by > 0.0)) & (left == (by > ay))
    apart, turn = max(abs(inverse * cross), 1e-300), 2.0 * math.pi if over else 0.0
    return tx, ty, length, apart if left else -apart, ax * tx + ay * ty, turn if left else -turn


@inline
def _distance(length, apart, first):
    """Distance of an edge from the ray, from end to end. [rad]"""
    foot = min(max(0.0, first), first + length)
    return math.sqrt(apart * apart + foot * foot)


@inner
def _edge(lanes, width, reach, arc):
    """Write the part of the edge that is within the reach, and count whether the ray is inside.

    Of a panel of an arc, which may be `BENT` of its length beside its chord, the whole or nothing is within.
    """
    if arc:
        for i in range(width):
            tx, ty, length, apart, first, turn = _line(lanes[_AX + i], lanes[_AY + i], lanes[_BX + i], lanes[_BY + i])
            near = _distance(length, apart, first) < reach + BENT * length
            lanes[_START + i], lanes[_STOP + i] = first, first + length if near else first
            lanes[_APART + i], lanes[_TX + i], lanes[_TY + i] = apart, tx, ty
            lanes[_TURN + i] += turn
    else:
        for i in range(width):
            tx, ty, length, apart, first, turn = _line(lanes[_AX + i], lanes[_AY + i], lanes[_BX + i], lanes[_BY + i])
            half = math.sqrt(max(0.0, reach * reach - apart * apart))
            start = max(first, -half)
            lanes[_START + i], lanes[_STOP + i] = start, max(start, min(first + length, half))
            lanes[_APART + i], lanes[_TX + i], lanes[_TY + i] = apart, tx, ty
            lanes[_TURN + i] += turn


@inner
def nearest(outline, corners, room):
    """Distance of the outline from the ray of the first lane, at most; and whether the ray is inside. [rad]"""
    for k in range(corners):
        along, x, y = _seen(outline.lanes, 0, outline.corners[0, k], outline.corners[1, k], outline.corners[2, k])
        along = 1.0 / along
        room[X + k + 1], room[Y + k + 1] = along * x, along * y
    room[X], room[Y] = room[X + corners], room[Y + corners]
    for k in range(corners):
        _, _, length, apart, first, turn = _line(room[X + k], room[Y + k], room[X + k + 1], room[Y + k + 1])
        beside = BENT * length if outline.panel[k] != STRAIGHT else 0.0
        room[PART + k], room[RESULT + k] = _distance(length, apart, first) - beside, turn
    least, turn = math.inf, 0.0
    for k in range(corners):
        least, turn = min(least, room[PART + k]), turn + room[RESULT + k]
    return least, turn > 0.0


@inner
def _take_far(lanes, width, light):
    """Take off the integral of F dphi along the part of the edge, were all light within."""
    for i in range(width):
        apart, start, stop = lanes[_APART + i], lanes[_START + i], lanes[_STOP + i]
        angle = _angle(apart * apart + start * stop, abs(apart) * (stop - start))
        lanes[_TURN + i] -= math.copysign(angle, apart)
    if light.harmonics > 1:
        for end in range(2):
            place, sign, shift = (_STOP, 1.0, ROW) if end else (_START, -1.0, 0)
            for i in range(width):
                apart, t, tx, ty = lanes[_APART + i], lanes[place + i], lanes[_TX + i], lanes[_TY + i]
                x, y = apart * ty + t * tx, t * ty - apart * tx
                scale = 1.0 / (x * x + y * y + 1e-300)
                lanes[_COSINE + shift + i] = scale * (x * x - y * y)
                lanes[_NOW + shift + i], lanes[_OLDER + shift + i] = sign * scale * 2.0 * x * y, 0.0
        for m in range(1, light.harmonics):
            part = light.far[m] / (2.0 * m)
            for i in range(width):
                now, then = lanes[_NOW + i], lanes[_NOW + ROW + i]
                lanes[_TURN + i] -= part * (now + then)
                lanes[_NOW + i] = 2.0 * lanes[_COSINE + i] * now - lanes[_OLDER + i]
                lanes[_NOW + ROW + i] = 2.0 * lanes[_COSINE + ROW + i] * then - lanes[_OLDER + ROW + i]
                lanes[_OLDER + i], lanes[_OLDER + ROW + i] = now, then


@inline
def _angle(x, y):
    """Angle of a place from the axis x > 0, for y >= 0, within 1e-12. [rad]"""
    low, high = min(abs(x), y), max(abs(x), y)
    steep = low > _EIGHTH * high
    t = (low - high if steep else low) / (low + high if steep else high + 1e-300)
    q = t * t
    t += t * q * (_A3 + q * (_A5 + q * (_A7 + q * (_A9 + q * (_A11 + q * (_A13 + q * (_A15 + q * (_A17 + q * (
        _A19 + q * (_A21 + q * (_A23 + q * (_A25 + q * _A27))))))))))))  # fmt: skip
    t += _QUARTER_PI if steep else 0.0
    t = _HALF_PI - t if y > abs(x) else t
    return math.pi - t if x < 0.0 else t


@inner
def panels_of(light, breaks):
    """Write the panels of edges in `Outline.breaks`, and return their number."""
    inside = min(light.reach, max(NEAR, 0.5 * PANEL * light.smooth))
    count = min(math.ceil(2.0 * inside / (PANEL * light.smooth)), PIECES - 4)
    for k in range(count):
        breaks[0, k] = inside * (2.0 * k / count - 1.0)
        breaks[1, k], breaks[2, k] = inside * (2.0 * (k + 1) / count - 1.0), light.smooth
    while inside < light.reach:
        scale = max(light.smooth, 0.15 * (inside - DISC))
        outside = inside + PANEL * scale
        if light.reach - outside < 0.4 * PANEL * scale or count == PIECES - 2:
            outside = light.reach
        breaks[0, count], breaks[1, count], breaks[2, count] = inside, outside, scale
        breaks[0, count + 1], breaks[1, count + 1], breaks[2, count + 1] = -outside, -inside, scale
        inside, count = outside, count + 2
    return count


@inline
def _along_edge(lanes, i, panels, breaks, light, rules, count):
    """Write nodes on the edge that lane i sees after so many that wait to be looked up; returns the new number."""
    room, apart, tx, ty = light.places, lanes[_APART + i], lanes[_TX + i], lanes[_TY + i]
    for p in range(panels):
        start, stop = max(lanes[_START + i], breaks[0, p]), min(lanes[_STOP + i], breaks[1, p])
        if start < stop:
            long = stop - start
            order = min(MOST, math.ceil(rules.fine * (1.5 + 0.75 * long / breaks[2, p])))
            count, order = max(count, 0), max(order, 0)  # said, as no vector code is made of indices below 0
            part, footx, footy = long * apart * lanes[WEIGHT + i], apart * ty, -apart * tx
            for k in range(whole(order)):
                t = start + long * rules.line[order, 0, k]
                room[X + count + k], room[Y + count + k] = footx + t * tx, footy + t * ty
                room[PART + count + k] = part * rules.line[order, 1, k]
            count += order
    return count


@inline
def _along_arc(outline, i, z, panel, order, sign, light, count):
    """Write nodes on a panel of an arc that lane i sees; returns the new number of those that wait."""
    room, lanes, first, k = light.places, outline.lanes, max(panel * order, 0), SIGHT + i
    count = max(count, 0)
    er, ex, ey, nr, nx, ny = (
        lanes[k], lanes[ROW + k], lanes[2 * ROW + k], lanes[3 * ROW + k], lanes[4 * ROW + k], lanes[5 * ROW + k],
    )  # fmt: skip
    ar, ax, ay = _seen(lanes, i, 0.0, 0.0, z)
    part = sign * lanes[WEIGHT + i]
    for n in range(whole(order)):
        c, s = outline.nodes[0, first + n], outline.nodes[1, first + n]
        along = 1.0 / (c * er + s * nr + ar)
        x, y = along * (c * ex + s * nx + ax), along * (c * ey + s * ny + ay)
        room[X + count + n], room[Y + count + n] = x, y
        turn = along * (x * (c * ny - s * ey) - y * (c * nx - s * ex))
        room[PART + count + n] = part * outline.nodes[2, first + n] * turn
    return count + order


@inner
def within(outline, corners, order, panels, width, light, rules):
    """Light within the outline, the sum over the points in lanes."""
    lanes, total, count = outline.lanes, 0.0, 0
    for i in range(width):
        lanes[_TURN + i] = 0.0
    c, s, z = outline.corners[0, corners - 1], outline.corners[1, corners - 1], outline.corners[2, corners - 1]
    _to_corner(lanes, width, c, s, z)
    for k in range(corners):
        panel, z = outline.panel[k], outline.corners[2, k]
        _to_corner(lanes, width, outline.corners[0, k], outline.corners[1, k], z)
        _edge(lanes, width, light.reach, panel != STRAIGHT)
        near = False
        for i in range(width):
            if lanes[_START + i] < lanes[_STOP + i]:
                near = True
                if count + MOST * max(panels, 1) > LOOKED:
                    total, count = total + _looked_up(light, count), 0
                if panel == STRAIGHT:
                    count = _along_edge(lanes, i, panels, outline.breaks, light, rules, count)
                else:
                    count = _along_arc(outline, i, z, panel, order, 1.0 if 2 * k < corners else -1.0, light, count)
        if near:
            _take_far(lanes, width, light)
    total += _looked_up(light, count)
    for i in range(width):
        lanes[_TURN + i] *= lanes[WEIGHT + i]
    return (total + folded(lanes, _TURN, width)) / (2.0 * math.pi)


@inner
def _looked_up(light, count):
    """Sum of the weighted light at so many places."""
    room = light.places
    for i in range(count, whole(count)):
        room[X + i] = room[Y + i] = room[PART + i] = 0.0
    look_up(light, whole(count))
    return folded(room, RESULT, whole(count))

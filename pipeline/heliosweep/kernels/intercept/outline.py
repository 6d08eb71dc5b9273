"""Light within an outline: the integral of F dphi / 2 pi along it, F the light within a radius, phi the direction.

Directions are gnomonic coordinates about a reflected ray: x along e1, y along e2, both over the part along the ray. In
them straight edges are straight. Within the reach of the light F dphi = H(r) (x dy - y dx) is summed by Gauss and
Legendre; beyond it F is 1 and the angle is known.
"""

import math

import numpy as np

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.intercept.sunshapes import DISC
from heliosweep.kernels.intercept.tables import look_up

FAR = 1e9
"""End of a ray that has no end. [rad]"""
PANEL = 2.5
"""Length of a panel of the integration in standard deviations of the blur; beyond the disc it grows with the angle."""


@inner
def along_line(apart, first, last, room, step, reach, sigma, rule):
    """Integral of F dphi along a straight line: `apart` from the centre, positive with it to the left. [rad]

    `first` and `last` are places along the line from the foot of the centre. [rad]
    """
    if abs(apart) >= reach or first >= last:
        return angle(apart, first, last)
    half = math.sqrt(reach * reach - apart * apart)
    start, stop = min(max(first, -half), last), max(min(last, half), first)
    if start >= stop:
        return angle(apart, first, last)
    total, a = angle(apart, first, start) + angle(apart, stop, last), start
    while a < stop:
        length = min(max(PANEL * sigma, 0.5 * (abs(a) - DISC)), stop - a)
        if stop - a - length < 0.3 * length:
            length = stop - a
        part = 0.0
        for k in range(rule.shape[1]):
            t = a + length * rule[0, k]
            part += rule[1, k] * look_up(room, math.sqrt(apart * apart + t * t) / step)
        total += apart * length * part
        a += length
    return total


@inline
def angle(apart, first, last):
    """Angle of a part of a line, seen from the centre, signed as its distance. [rad]"""
    return math.atan2(apart * (last - first), apart * apart + first * last)


@inner
def along_segment(ax, ay, bx, by, room, step, reach, sigma, rule):
    """Integral of F dphi along the segment from a to b. [rad]"""
    tx, ty = bx - ax, by - ay
    length = math.sqrt(tx * tx + ty * ty)
    if length == 0.0:
        return 0.0
    tx, ty = tx / length, ty / length
    first = ax * tx + ay * ty
    return along_line(ax * ty - ay * tx, first, first + length, room, step, reach, sigma, rule)


@inner
def beyond_corner(x, y, in_x, in_y, out_x, out_y, room, step, reach, sigma, rule):
    """Light beyond both edges that meet at a corner (x, y) of an outline that turns left: 'in' ends and 'out' begins.

    Each is the unit vector along its edge. [1]
    """
    turn = math.atan2(out_y * in_x - out_x * in_y, -(in_x * out_x + in_y * out_y))
    along = along_line(x * in_y - y * in_x, x * in_x + y * in_y, FAR, room, step, reach, sigma, rule)
    back = along_line(y * out_x - x * out_y, -(x * out_x + y * out_y), FAR, room, step, reach, sigma, rule)
    return (turn + back - along) / (2.0 * math.pi)


@inner
def along_arc(arc, used, nodes, shift_x, shift_y, room, step, reach, length):
    """Integral of F dphi along an arc in panels of `nodes` nodes: rows x, y, and slopes dx, dy times weights. [rad]

    Each panel has its two ends after its nodes. Light is centred at the shift; panels that are farther from it than its
    reach and their `length` are seen under a known angle.
    """
    total = 0.0
    for k in range(0, used, nodes + 2):
        ax, ay = arc[0, k + nodes] - shift_x, arc[1, k + nodes] - shift_y
        if ax * ax + ay * ay > (reach + length) * (reach + length):
            bx, by = arc[0, k + nodes + 1] - shift_x, arc[1, k + nodes + 1] - shift_y
            total += math.atan2(ax * by - ay * bx, ax * bx + ay * by)
            continue
        for m in range(k, k + nodes):
            x, y = arc[0, m] - shift_x, arc[1, m] - shift_y
            r = math.sqrt(x * x + y * y)
            total += (x * arc[3, m] - y * arc[2, m]) * (look_up(room, r / step) if r < reach else 1.0 / (r * r))
    return total


def rules(order: int) -> np.ndarray:
    """Nodes and weights of Gauss and Legendre on 0 to 1, shape (2, order)."""
    place, weight = np.polynomial.legendre.leggauss(order)
    return np.stack(((1.0 + place) / 2, weight / 2))

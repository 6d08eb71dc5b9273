"""Light within an outline: the integral of F dphi / 2 pi along it, F the light within a radius, phi the direction.

Directions are gnomonic coordinates about a reflected ray, in which straight edges are straight. Within the reach of the
light F dphi = H(r) (x dy - y dx) is summed by Gauss and Legendre; beyond it F is 1 and the angle is known.
"""

import math

from heliosweep.kernels.compiled import inline
from heliosweep.kernels.intercept.sunshapes import DISC
from heliosweep.kernels.intercept.tables import look_up

PANEL = 7.0
"""Length of a panel of the integration in standard deviations of the blur; beyond the disc it grows with the angle."""
SECTORS = 4
"""Parts of an arc; light that is far from a part cannot be between it and its chord."""


@inline
def along_line(apart, first, last, light, rules):
    """Integral of F dphi along a straight line within the reach: `apart` from the centre, with it to the left. [rad]

    `first` and `last` are places along the line from the foot of the centre. [rad]
    """
    total, a = 0.0, first
    while a < last:
        scale = max(light.sigma, 0.15 * (abs(a) - DISC))
        length = min(PANEL * scale, last - a)
        if last - a - length < 0.4 * length:
            length = last - a
        order = min(rules.line.shape[0] - 1, math.ceil(rules.fine * (1.5 + 0.75 * length / scale)))
        part = 0.0
        for k in range(order):
            t = a + length * rules.line[order, 0, k]
            part += rules.line[order, 1, k] * look_up(light.room, math.sqrt(apart * apart + t * t) / light.step)
        total += length * part
        a += length
    return apart * total


@inline
def angle(ax, ay, bx, by):
    """Angle from a to b, seen from the centre: positive to the left. [rad]"""
    return math.atan2(ax * by - ay * bx, ax * bx + ay * by)


@inline
def along_segment(ax, ay, bx, by, light, rules):
    """Integral of F dphi along the segment from a to b. [rad]"""
    tx, ty = bx - ax, by - ay
    length = math.sqrt(tx * tx + ty * ty)
    if length == 0.0:
        return 0.0
    tx, ty = tx / length, ty / length
    first, apart, reach = ax * tx + ay * ty, ax * ty - ay * tx, light.reach
    last = first + length
    half = math.sqrt(max(0.0, reach * reach - apart * apart))
    start, stop = max(first, -half), min(last, half)
    if abs(apart) >= reach or start >= stop:
        return angle(ax, ay, bx, by)
    total = along_line(apart, start, stop, light, rules)
    if start > first:
        total += math.atan2(apart * (start - first), apart * apart + first * start)
    if stop < last:
        total += math.atan2(apart * (last - stop), apart * apart + stop * last)
    return total


@inline
def beyond_corner(x, y, in_x, in_y, out_x, out_y, light, rules):
    """Light beyond both edges that meet at a corner (x, y) of an outline that turns left: 'in' ends and 'out' begins.

    Each is the unit vector along its edge. Two rays bound the light, from the corner onward along 'in', and back along
    'out'; beyond the reach a circle does. [1]
    """
    reach = light.reach
    apart_in, apart_out = x * in_y - y * in_x, x * out_y - y * out_x
    if apart_in >= reach or apart_out >= reach:
        return 0.0
    first_in, first_out = x * in_x + y * in_y, -(x * out_x + y * out_y)
    far = x * x + y * y >= reach * reach
    if far and apart_in >= 0.0 and apart_out >= 0.0 and first_in >= 0.0 and first_out >= 0.0:
        return 0.0
    half_in = math.sqrt(max(0.0, reach * reach - apart_in * apart_in))
    half_out = math.sqrt(max(0.0, reach * reach - apart_out * apart_out))
    start_in, start_out = max(first_in, -half_in), max(first_out, -half_out)
    total = along_line(-apart_out, start_out, half_out, light, rules)
    total -= along_line(apart_in, start_in, half_in, light, rules)
    if far:
        total += 2.0 * math.pi * (apart_in < 0.0 and apart_out < 0.0)
        if start_in < half_in:
            total += math.atan2(apart_in * (half_in - start_in), apart_in * apart_in + start_in * half_in)
        if start_out < half_out:
            total += math.atan2(apart_out * (half_out - start_out), apart_out * apart_out + start_out * half_out)
    else:
        turn = angle(
            apart_out * out_y - half_out * out_x, -apart_out * out_x - half_out * out_y,
            apart_in * in_y + half_in * in_x, -apart_in * in_x + half_in * in_y,
        )  # fmt: skip
        total += turn if turn > -1e-9 else turn + 2.0 * math.pi
    return total / (2.0 * math.pi)


@inline
def along_arc(arc, panels, order, shift_x, shift_y, light):
    """Integral of F dphi along an arc in panels of `order` nodes: rows x, y, and slopes dx, dy times weights. [rad]

    Each panel has its first end after its nodes, and the next its last. Light is centred at the shift; panels that are
    farther from it than its reach are seen under a known angle, those of one sector under one.
    """
    total, part = 0.0, panels // SECTORS
    ax, ay = arc[0, order] - shift_x, arc[1, order] - shift_y
    far_x, far_y, waiting = ax, ay, False
    for p in range(panels):
        k = p * (order + 1)
        bx, by = arc[0, k + 2 * order + 1] - shift_x, arc[1, k + 2 * order + 1] - shift_y
        away = light.reach + math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
        far = ax * ax + ay * ay > away * away
        if waiting and (not far or p % part == 0):
            total += angle(far_x, far_y, ax, ay)
            waiting = False
        if far and not waiting:
            far_x, far_y, waiting = ax, ay, True
        if not far:
            for m in range(k, k + order):
                x, y = arc[0, m] - shift_x, arc[1, m] - shift_y
                r = math.sqrt(x * x + y * y)
                inner = look_up(light.room, r / light.step) if r < light.reach else 1.0 / (r * r)
                total += (x * arc[3, m] - y * arc[2, m]) * inner
        ax, ay = bx, by
    return total + angle(far_x, far_y, ax, ay) if waiting else total

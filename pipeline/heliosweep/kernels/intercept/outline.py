"""Light within an outline: the integral of F dphi / 2 pi along it, F the light within a radius, phi the direction.

Directions are gnomonic coordinates about a reflected ray, in which straight edges are straight, stretched as the tables
of light are. F is the sum of F_m(r) cos(2 m phi). Only pieces within the reach are integrated. Beyond it F depends on
phi alone, and so does its integral on any way: `turned` at the end of the way less `turned` at its start, and a full
turn where the way goes over the axis x < 0. Only where an outline leaves the reach or enters it is that computed.
"""

import math

from heliosweep.kernels.compiled import inline
from heliosweep.kernels.intercept.sunshapes import DISC
from heliosweep.kernels.intercept.tables import look_up

PANEL = 15.0
"""Length of a panel of an edge in that over which light changes, `Light.smooth`; beyond the disc that grows."""
NEAR = 3.0 * DISC
"""Distance from the ray within which light may change as fast as at the disc's edge. [rad]"""
BENT = 0.3
"""Part of its length that an arc may be beside its chord."""


@inline
def gap(ax, ay, bx, by):
    """Distance of the line from a to b, from end to end. [rad]"""
    tx, ty = bx - ax, by - ay
    square = tx * tx + ty * ty
    along = min(max(-(ax * tx + ay * ty) / square, 0.0), 1.0) if square > 0.0 else 0.0
    x, y = ax + along * tx, ay + along * ty
    return math.sqrt(x * x + y * y)


@inline
def crosses(ax, ay, bx, by):
    """True where the line from a to b crosses the axis x > 0: an odd number of times for an outline about the ray."""
    return (ay > 0.0) != (by > 0.0) and ((ax * by - ay * bx > 0.0) == (by > ay))


@inline
def turned(x, y, light):
    """Integral of F dphi from the axis x > 0 to a place, were all light within: it is the same on every way. [rad]"""
    total = math.atan2(y + 0.0, x)  # of -0.0, which `over_cut` takes for 0, it would be on the other side
    if light.harmonics > 1:
        scale = 1.0 / (x * x + y * y + 1e-300)
        cosine, sine = scale * (x * x - y * y), scale * 2.0 * x * y
        along, across = cosine, sine
        for m in range(1, light.harmonics):
            total += light.far[m] * across / (2.0 * m)
            along, across = along * cosine - across * sine, along * sine + across * cosine
    return total


@inline
def over_cut(ax, ay, bx, by):
    """Full turns that `turned` lacks from a to b, as it jumps at the axis x < 0. [rad]"""
    if (ay >= 0.0) == (by >= 0.0) or (ax * by - ay * bx > 0.0) == (by > ay):
        return 0.0
    return 2.0 * math.pi if by < ay else -2.0 * math.pi


@inline
def far_from(ax, ay, bx, by, away):
    """True where the line from a to b is farther from the ray than `away` everywhere, from end to end. [rad]"""
    tx, ty = bx - ax, by - ay
    square, along, limit = tx * tx + ty * ty, -(ax * tx + ay * ty), away * away
    if along <= 0.0:
        return ax * ax + ay * ay > limit
    if along >= square:
        return bx * bx + by * by > limit
    cross = ax * by - ay * bx
    return cross * cross > limit * square


@inline
def along_edge(ax, ay, bx, by, light, rules):
    """Integral of F dphi along the part of a line from a to b that is within the reach [rad]; its first and last place.

    Places as parts of the line: 0 and 1 where all of it is within, the same twice where nothing is.
    """
    if far_from(ax, ay, bx, by, light.reach):
        return 0.0, 0.0, 0.0
    tx, ty = bx - ax, by - ay
    length = math.sqrt(tx * tx + ty * ty)
    if length == 0.0:
        return 0.0, 0.0, 0.0
    tx, ty = tx / length, ty / length
    first, apart, reach = ax * tx + ay * ty, ax * ty - ay * tx, light.reach
    half = math.sqrt(max(0.0, reach * reach - apart * apart))
    start, stop = max(first, -half), min(first + length, half)
    if start >= stop:
        return 0.0, 0.0, 0.0
    footx, footy = apart * ty, -apart * tx
    total, a = 0.0, start
    while a < stop:
        near = a + max(0.0, -0.5 * (a + NEAR))  # an aureole is smooth where it is far: panels halve the way to the disc
        scale = max(light.smooth, 0.15 * (abs(near) - DISC))
        long = min(PANEL * scale, stop - a)
        if a < -NEAR:
            long = min(long, near - a + 0.1 * NEAR)
        elif stop - a - long < 0.4 * long:
            long = stop - a
        order = min(rules.line.shape[0] - 1, math.ceil(rules.fine * (1.5 + 0.75 * long / scale)))
        part = 0.0
        for k in range(order):
            t = a + long * rules.line[order, 0, k]
            part += rules.line[order, 1, k] * look_up(light, footx + t * tx, footy + t * ty)
        total += long * part
        a += long
    return apart * total, (start - first) / length, 1.0 if stop == first + length else (stop - first) / length

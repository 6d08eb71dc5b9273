"""Light within an outline: the integral of F dphi / 2 pi along it, F the light within a radius, phi the direction.

Directions are gnomonic coordinates about a reflected ray, in which straight edges are straight, stretched as the tables
of light are. F is the sum of F_m(r) cos(2 m phi). Along the whole outline the integral with F beyond the reach is 2 pi
where the ray is inside, else 0: only pieces within the reach are integrated, of the difference that they make.
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
def beyond(ax, ay, bx, by, light):
    """Integral of F dphi from a to b, seen from the ray, were all light within them. [rad]"""
    total = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    if light.harmonics > 1:
        first, last = 1.0 / (ax * ax + ay * ay + 1e-300), 1.0 / (bx * bx + by * by + 1e-300)
        ca, sa = first * (ax * ax - ay * ay), first * 2.0 * ax * ay
        cb, sb = last * (bx * bx - by * by), last * 2.0 * bx * by
        pa, qa, pb, qb = ca, sa, cb, sb
        for m in range(1, light.harmonics):
            total += light.far[m] * (qb - qa) / (2.0 * m)
            pa, qa, pb, qb = pa * ca - qa * sa, pa * sa + qa * ca, pb * cb - qb * sb, pb * sb + qb * cb
    return total


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
    """Integral of F dphi along a straight line from a to b, less what it were beyond the reach. [rad]"""
    if far_from(ax, ay, bx, by, light.reach):
        return 0.0
    tx, ty = bx - ax, by - ay
    length = math.sqrt(tx * tx + ty * ty)
    if length == 0.0:
        return 0.0
    tx, ty = tx / length, ty / length
    first, apart, reach = ax * tx + ay * ty, ax * ty - ay * tx, light.reach
    half = math.sqrt(max(0.0, reach * reach - apart * apart))
    start, stop = max(first, -half), min(first + length, half)
    if start >= stop:
        return 0.0
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
    ax, ay, bx, by = footx + start * tx, footy + start * ty, footx + stop * tx, footy + stop * ty
    return apart * total - beyond(ax, ay, bx, by, light)

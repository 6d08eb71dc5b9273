"""Tables of a blurred sun: the light beyond a line, and the light within a circle.

The sun shape, blurred by a Gaussian of variance q per axis, has the light T(d; q) beyond a line that passes its centre
at the distance d, and F(r; q) within the radius r. Kept are T and H = F / r^2 over distances in equal steps, with
their slopes for cubic Hermite interpolation, at Chebyshev nodes of log q. A heliostat at an instant has its own
variances: `collapse` makes the table of one, in which `beyond` and `within` look.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.intercept.sunshapes import SunShape

Floats = NDArray[np.float64]

TAIL = 5.5
"""Standard deviations of the blur beyond the outermost ring at which there is no light left."""
_FINE = 8.0
"""Nodes of the tables in the smallest standard deviation of the blur."""


class Tables(NamedTuple):
    """Tables of one sun shape over a span of variances, made by `tables`."""

    step: float
    """Distance between nodes. [rad]"""
    edge: float
    """Angle of the outermost ring. [rad]"""
    logs: Floats
    """Nodes in the logarithm of the variance, rising, shape (variances,)."""
    beyond: Floats
    """T and its slope times the step, shape (2, variances, nodes). [1]"""
    within: Floats
    """H and its slope times the step, shape (2, variances, nodes). [1/rad^2]"""


def tables(sun: SunShape, low: float, high: float) -> Tables:
    """Tables of a sun shape for blurs with variances from `low` to `high`, which is greater. [rad^2]"""
    edge, variances = float(sun.radius.max()), math.ceil(4.0 + 2.6 * math.log(high / low))
    nodes = np.cos(np.pi * (np.arange(variances) + 0.5) / variances)[::-1]
    logs = (math.log(low) + math.log(high) + nodes * (math.log(high) - math.log(low))) / 2
    step = math.sqrt(low) / _FINE
    count = math.ceil((edge + TAIL * math.sqrt(high)) / step) + 2
    return Tables(
        step, edge, logs, _beyond(sun.radius, sun.share, logs, step, count),
        _within(sun.radius, sun.share, logs, step, count),
    )  # fmt: skip


@kernel
def _beyond(radius, share, logs, step, count):
    """Light beyond a line: each ring projected on the line's normal is blurred, at angles that resolve the blur."""
    out = np.zeros((2, logs.shape[0], count))
    for v in range(logs.shape[0]):
        sigma = math.exp(0.5 * logs[v])
        scale = step / (sigma * math.sqrt(2.0 * math.pi))
        for k in range(radius.shape[0]):
            turns = math.ceil(0.5 * math.pi * radius[k] / sigma) + 8
            weight = share[k] / turns
            for m in range(turns):
                place = radius[k] * math.cos(0.5 * math.pi * (m + 0.5) / turns)
                for n in range(count):
                    for side in (place, -place):
                        apart = (n * step - side) / sigma
                        if apart < -7.0:
                            out[0, v, n] += 0.5 * weight
                        elif apart < 7.0:
                            out[0, v, n] += 0.25 * weight * math.erfc(apart * math.sqrt(0.5))
                            out[1, v, n] -= 0.5 * weight * scale * math.exp(-0.5 * apart * apart)
    return out


@kernel
def _within(radius, share, logs, step, count):
    """Light within a circle over its radius squared, from the density K: H(0) = pi K(0), H' = 2 (pi K - H) / r."""
    out = np.zeros((2, logs.shape[0], count))
    places = np.array([0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15)])
    weights = np.array([5.0, 8.0, 5.0]) / 18.0
    for v in range(logs.shape[0]):
        variance, total = math.exp(logs[v]), 0.0
        out[0, v, 0] = math.pi * _density(0.0, radius, share, variance)
        for n in range(1, count):
            for m in range(3):
                r = (n - 1 + places[m]) * step
                total += 2.0 * math.pi * r * step * weights[m] * _density(r, radius, share, variance)
            r = n * step
            out[0, v, n] = total / (r * r)
            out[1, v, n] = 2.0 * (math.pi * _density(r, radius, share, variance) - out[0, v, n]) / n
    return out


@kernel
def _density(r, radius, share, variance):
    """Density of the blurred light at a radius. [1/rad^2]"""
    total = 0.0
    for k in range(radius.shape[0]):
        apart = (r - radius[k]) * (r - radius[k]) / (2.0 * variance)
        if apart < 45.0:
            total += share[k] * math.exp(-apart) * _bessel(r * radius[k] / variance)
    return total / (2.0 * math.pi * variance)


@kernel
def _bessel(x):
    """Modified Bessel function of order 0 times exp(-x): its power series, or its asymptotic one."""
    term = total = 1.0
    if x < 18.0:
        for k in range(1, 80):
            term *= 0.25 * x * x / (k * k)
            total += term
            if term < 1e-17 * total:
                break
        return total * math.exp(-x)
    for k in range(1, 20):
        term *= (2 * k - 1) ** 2 / (8.0 * k * x)
        total += term
    return total / math.sqrt(2.0 * math.pi * x)


@inner
def collapse(table, logs, step, edge, variance, room):
    """Write the table of one variance in `room`; returns the radius beyond which it has no light. [rad]

    A variance outside the span of the tables is brought to its end.
    """
    nodes = logs.shape[0]
    middle, half = 0.5 * (logs[0] + logs[nodes - 1]), 0.5 * (logs[nodes - 1] - logs[0])
    half /= math.cos(0.5 * math.pi / nodes)
    place = min(max((math.log(variance) - middle) / half, -1.0), 1.0)
    reach = edge + TAIL * math.exp(0.5 * (middle + half * place))
    count = min(int(reach / step) + 3, table.shape[2])
    for n in range(count):
        room[0, n] = room[1, n] = 0.0
    for v in range(nodes):
        factor = 1.0
        for w in range(nodes):
            if w != v:
                factor *= (middle + half * place - logs[w]) / (logs[v] - logs[w])
        for n in range(count):
            room[0, n] += factor * table[0, v, n]
        for n in range(count):
            room[1, n] += factor * table[1, v, n]
    return reach


@inline
def look_up(room, place):
    """Cubic Hermite interpolation in a table of one variance; `place` is the distance in steps."""
    n = int(place)
    f = place - n
    g = 1.0 - f
    value = g * g * (1.0 + 2.0 * f) * room[0, n] + f * f * (3.0 - 2.0 * f) * room[0, n + 1]
    return value + f * g * (g * room[1, n] - f * room[1, n + 1])


@inline
def beyond(room, step, reach, distance):
    """Light beyond a line, which is at a signed distance from the centre of the light. [1]"""
    if abs(distance) >= reach:
        return 0.0 if distance > 0.0 else 1.0
    part = look_up(room, abs(distance) / step)
    return part if distance >= 0.0 else 1.0 - part

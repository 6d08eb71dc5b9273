"""Tables of a blurred sun: the light beyond a line, and the light within a circle.

The sun shape, blurred by a Gaussian of variance q per axis, has the light T(d; q) beyond a line that passes its centre
at the distance d, and F(r; q) within the radius r. Kept are T and H = F / r^2 as a cubic in each of equal steps of the
distance, at Chebyshev nodes of log q. Variances stand in bands, within which the largest is at most four times the
smallest, each with steps of its own. A heliostat at an instant has its own variances: `collapse` makes the table of
one, in which `look_up` looks.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.intercept.sunshapes import DISC, SunShape

Floats = NDArray[np.float64]

TAIL = 5.0
"""Standard deviations of the blur beyond the outermost ring at which there is no light left: a part of 4e-6 at most."""
_FINE = 6.0
"""Steps of the tables in the smallest standard deviation of a band."""
_NODES = 7
"""Variances of a band."""


class Tables(NamedTuple):
    """Tables of one sun shape over a span of variances, made by `tables`."""

    edge: float
    """Angle of the outermost ring. [rad]"""
    core: float
    """Variance per axis of the light of the disc. [rad^2]"""
    logs: Floats
    """Logarithm of the smallest variance of each band, and of the largest of the last; equally far apart."""
    steps: Floats
    """Distance between nodes, of each band. [rad]"""
    beyond: Floats
    """Coefficients of T in each step, from the constant on, shape (bands, variances, 4 * steps). [1]"""
    within: Floats
    """The same of H. [1/rad^2]"""
    lagrange: Floats
    """Nodes on -1 to 1, and one over the product of their distances from the others, shape (2, variances)."""


class Light(NamedTuple):
    """Light of one variance, with the table of H."""

    room: Floats
    """Coefficients of H in each step."""
    step: float
    """Distance between nodes. [rad]"""
    reach: float
    """Radius beyond which there is no light. [rad]"""
    sigma: float
    """Standard deviation of the blur. [rad]"""


def tables(sun: SunShape, low: float, high: float) -> Tables:
    """Tables of a sun shape for blurs with variances from `low` to `high`, which is greater. [rad^2]"""
    edge, bands = float(sun.radius.max()), max(1, math.ceil(math.log(high / low) / math.log(4.0)))
    logs = np.linspace(math.log(low), math.log(high), bands + 1)
    place = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    apart = place[:, np.newaxis] - place + np.eye(_NODES)
    steps = np.exp(0.5 * logs[:-1]) / _FINE
    count = int(np.max(np.ceil((edge + TAIL * np.exp(0.5 * logs[1:])) / steps))) + 3
    made = np.zeros((2, bands, _NODES, 4 * (count - 1)))
    for band in range(bands):
        middle, half = (logs[band] + logs[band + 1]) / 2, (logs[1] - logs[0]) / 2
        for kind, function in enumerate((_beyond, _within)):
            value, slope = function(sun.radius, sun.share, middle + half * place, steps[band], count)
            rise, first, last = np.diff(value), slope[:, :-1], slope[:, 1:]
            cubic = (value[:, :-1], first, 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise)
            made[kind, band] = np.stack(cubic, axis=2).reshape(_NODES, -1)
    disc = sun.radius <= 1.001 * DISC
    core = float(np.sum((sun.share * sun.radius**2)[disc]) / np.sum(sun.share[disc])) / 2
    return Tables(edge, core, logs, steps, made[0], made[1], np.stack((place, 1.0 / np.prod(apart, axis=1))))


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
def collapse(table, tables, variance, room):
    """Write the table of one variance in `room`; returns its step, its reach and the standard deviation. [rad]

    A variance outside the span of the tables is brought to its end.
    """
    bands, nodes = table.shape[0], table.shape[1]
    width = tables.logs[1] - tables.logs[0]
    log = min(max(math.log(variance), tables.logs[0]), tables.logs[bands])
    band = min(int((log - tables.logs[0]) / width), bands - 1)
    place = 2.0 * (log - tables.logs[band]) / width - 1.0
    sigma, step = math.exp(0.5 * log), tables.steps[band]
    reach = tables.edge + TAIL * sigma
    count = min(4 * int(reach / step) + 4, table.shape[2])
    for v in range(nodes):
        factor = tables.lagrange[1, v]
        for w in range(nodes):
            if w != v:
                factor *= place - tables.lagrange[0, w]
        if v == 0:
            for n in range(count):
                room[n] = factor * table[band, v, n]
        else:
            for n in range(count):
                room[n] += factor * table[band, v, n]
    return step, reach, sigma


@inline
def look_up(room, place):
    """Value in a table of one variance; `place` is the distance in steps."""
    n = int(place)
    f, n = place - n, 4 * n
    return room[n] + f * (room[n + 1] + f * (room[n + 2] + f * room[n + 3]))


@inline
def beyond(room, step, reach, distance, wider=0.0):
    """Light beyond a line, which is at a signed distance from the centre of the light. [1]

    Its variance is that of the table and a little, `wider` [rad^2], as half as much of the second derivative gives it.
    """
    if abs(distance) >= reach:
        return 0.0 if distance > 0.0 else 1.0
    place = abs(distance) / step
    n = int(place)
    f, n = place - n, 4 * n
    part = room[n] + f * (room[n + 1] + f * (room[n + 2] + f * room[n + 3]))
    part += wider / (step * step) * (room[n + 2] + 3.0 * f * room[n + 3])
    return part if distance >= 0.0 else 1.0 - part

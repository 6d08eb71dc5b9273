"""Tables of a blurred sun: the light within a circle, by the direction in which it lies.

The sun shape, blurred by a Gaussian with the variances `large` and `small` along two axes, is stretched along these so
that its covariance is round. Its density there is a sum of harmonics, K = sum of K_m(r) cos(2 m phi), as the sun's own
roundness is lost. With F_m(r) = 2 pi times the integral of K_m r dr, the light within an outline about the centre is

    1 / (2 pi) * closed integral of the sum of F_m(r) cos(2 m phi) dphi

F_0 tends to 1, the others to the harmonics of all light. Kept are F_m / r^2 as a cubic in each of equal steps of r, at
Chebyshev nodes of log `small` and log `large`: these stand in bands, within which the largest `small` is at most four
times the smallest, each with steps of its own. A heliostat at an instant has its own variances: `collapse` makes the
table of one. The F_m are integrals of the light's Fourier transform over spatial frequencies.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.intercept.sunshapes import DISC, SunShape

Floats = NDArray[np.float64]

TAIL = 4e-6
"""Light beyond the reach of a table. [1]"""
HARMONICS = 24
"""Most harmonics."""
LEAST_HARMONIC = 1e-4
"""Size of F_m below which a harmonic makes no difference: light within an outline would change by a twentieth of it."""
_FINE = 6.0
"""Steps of the tables in the smallest standard deviation of a band."""
_NODES = 7
"""Nodes of `small` in a band."""
_PANEL = 16
"""Nodes of Gauss in a panel of the integrals, two periods of the fastest wave."""
_ANGLES = 32
"""Directions in a quadrant, from which the harmonics are taken."""


class Tables(NamedTuple):
    """Tables of one sun shape over spans of both variances, made by `tables`."""

    core: float
    """Variance per axis of the light of the disc. [rad^2]"""
    logs: Floats
    """Logarithm of the least `small` of each band, and of the largest of the last; equally far apart."""
    spans: Floats
    """Logarithms of the least and of the largest `large`."""
    steps: Floats
    """Distance between places, of each band. [rad]"""
    light: Floats
    """Coefficients of F_m / r^2 in each step, from the constant on: (bands, nodes, harmonics, 4 * steps). [1/rad^2]"""
    far: Floats
    """F_m beyond the reach, shape (bands, nodes, harmonics). [1]"""
    size: Floats
    """Largest F_m, shape (bands, nodes, harmonics). [1]"""
    reach: Floats
    """Radius beyond which there is no light, shape (bands, nodes). [rad]"""
    small: Floats
    """Chebyshev nodes on -1 to 1, and one over the product of their distances from the others, shape (2, nodes)."""
    large: Floats
    """The same of `large`, whose nodes are the inner ones."""


class Light(NamedTuple):
    """Light of one pair of variances, in stretched coordinates."""

    room: Floats
    """Coefficients of F_m / r^2, shape (harmonics, 4 * steps). [1/rad^2]"""
    far: Floats
    """F_m beyond the reach. [1]"""
    harmonics: int
    """Number that makes a difference."""
    inverse: float
    """One over the distance between places. [1/rad]"""
    reach: float
    """Radius beyond which there is no light. [rad]"""
    smooth: float
    """Length over which the light changes. [rad]"""


def tables(sun: SunShape, small: tuple[float, float], large: tuple[float, float]) -> Tables:
    """Tables of a sun shape for blurs with variances from the least to the largest, which is greater. [rad^2]"""
    bands = max(1, math.ceil(math.log(small[1] / small[0]) / math.log(4.0)))
    logs, spans = np.linspace(math.log(small[0]), math.log(small[1]), bands + 1), np.log(large)
    rules = _chebyshev(_NODES), _chebyshev(1 if spans[1] == spans[0] else 2 + math.ceil(4.0 * (spans[1] - spans[0])))
    disc = sun.radius <= 1.001 * DISC
    core = float(np.sum((sun.share * sun.radius**2)[disc]) / np.sum(sun.share[disc])) / 2
    made, steps = [], np.empty(bands)
    for band in range(bands):
        across = np.exp((logs[band] + logs[band + 1] + (logs[1] - logs[0]) * rules[0][0]) / 2)
        along = np.exp((spans[0] + spans[1] + (spans[1] - spans[0]) * rules[1][0]) / 2)
        pairs = np.stack([each.ravel() for each in np.meshgrid(across, along, indexing="ij")])
        steps[band] = stretched(math.exp(logs[band]), math.exp(spans[0]), core)[3] / _FINE
        made.append(_band(sun, core, pairs[0], pairs[1], float(steps[band])))
    count, most = (max(each[0].shape[axis] for each in made) for axis in (2, 1))
    light = np.zeros((bands, len(pairs[0]), most, 4 * count))
    ends, reach = np.zeros((2, bands, len(pairs[0]), most)), np.zeros((bands, len(pairs[0])))
    for band, (cubics, end, reach[band]) in enumerate(made):
        light[band, :, : cubics.shape[1], : cubics.shape[2] * 4] = cubics.reshape(*cubics.shape[:2], -1)
        ends[:, band, :, : end.shape[2]] = end
    return Tables(core, logs, spans, steps, light, ends[0], ends[1], reach, *rules)


def _chebyshev(count: int) -> Floats:
    """Nodes on -1 to 1, and one over the product of their distances from the others, shape (2, count)."""
    place = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    return np.stack((place, 1.0 / np.prod(place[:, np.newaxis] - place + np.eye(count), axis=1)))


def _interpolated(sun: SunShape, most: float, count: int) -> Callable[[Floats], Floats]:
    """`_transform` from 0 to `most` by cubics between so many places, with slopes from four neighbours."""
    step = most / count
    values = _transform(sun, step * np.arange(count + 3.0))
    slopes = _slopes(values)

    def at(wave: Floats) -> Floats:
        place = np.minimum((wave / step).astype(np.int64), count - 1)
        t = wave / step - place
        near, far = (1.0 + 2.0 * t) * values[place] + t * slopes[place], (3.0 - 2.0 * t) * values[place + 1]
        return (1.0 - t) ** 2 * near + t**2 * (far + (t - 1.0) * slopes[place + 1])

    return at


def _slopes(values: Floats) -> Floats:
    """Slopes per step, along the last axis, of an even function that is known at 0, 1, 2, ... steps.

    From four neighbours; at the last two places from two and three.
    """
    even = np.concatenate((values[..., 2:0:-1], values), axis=-1)
    inner = (even[..., :-4] - even[..., 4:] + 8.0 * (even[..., 3:-1] - even[..., 1:-3])) / 12.0
    a, b, c = values[..., -3], values[..., -2], values[..., -1]
    return np.concatenate((inner, np.stack(((c - a) / 2.0, (a - 4.0 * b + 3.0 * c) / 2.0), axis=-1)), axis=-1)


def _band(sun: SunShape, core: float, small: Floats, large: Floats, step: float) -> tuple[Floats, Floats, Floats]:
    """Coefficients (nodes, harmonics, steps, 4), F_m at the end and its size (2, nodes, harmonics), and reaches."""
    factors = np.array([stretched(*pair, core) for pair in zip(small, large, strict=True)]).T
    widest, blur = np.maximum(factors[0], factors[1]), np.sqrt(np.maximum(large, small))
    outermost = float(np.max(widest * sun.radius.max() + 6.0 * np.minimum(widest * blur, np.sqrt(factors[2]))))
    place: Floats = step * np.arange(math.ceil(outermost / step) + 2, dtype=np.float64)
    wave, part = _panels(6.5 / float(factors[3].min()), 2.0 * np.pi / outermost)
    turn = np.pi / 2 * (np.arange(_ANGLES) + 0.5) / _ANGLES
    most = float(wave[-1] * widest.max())
    transform = _interpolated(sun, most, 8 * math.ceil(most * sun.radius.max()) + 8)
    signs = (-1.0) ** np.arange(HARMONICS)[:, np.newaxis]
    harmonics = signs * np.cos(2.0 * np.arange(HARMONICS)[:, np.newaxis] * turn) * (2.0 / _ANGLES)
    terms = np.empty((len(wave), HARMONICS, len(small)))
    for node, (along, across, _, _) in enumerate(factors.T):
        x, y = along * np.outer(wave, np.cos(turn)), across * np.outer(wave, np.sin(turn))
        spectrum = transform(np.sqrt(x * x + y * y)) * np.exp(-0.5 * (large[node] * x * x + small[node] * y * y))
        terms[:, :, node] = np.einsum("ka,ma->km", spectrum, harmonics)
    terms[:, 0] /= 2.0
    terms *= (wave * part)[:, np.newaxis, np.newaxis]
    sizes = np.abs(_at(terms, wave, place[1 :: max(1, len(place) // 60)])).max(axis=(0, 2))
    count = 1 + int(np.flatnonzero(sizes >= 0.03 * LEAST_HARMONIC).max())
    within = _at(np.ascontiguousarray(terms[:, :count]), wave, place[1:])
    ends = within[:, :, -1]
    left = np.abs(within - ends[:, :, np.newaxis]).sum(axis=1) > TAIL
    reach = place[1:][within.shape[2] - 1 - np.argmax(left[:, ::-1], axis=1)] + step
    values = np.zeros((*within.shape[:2], len(place)))
    values[:, :, 1:] = within / place[1:] ** 2
    values[:, 0, 0] = 0.5 * np.sum(terms[:, 0], axis=0)
    slopes, rise = _slopes(values), np.diff(values)
    near, far = slopes[:, :, :-1], slopes[:, :, 1:]
    cubics = np.stack((values[:, :, :-1], near, 3.0 * rise - 2.0 * near - far, near + far - 2.0 * rise), axis=-1)
    return cubics, np.stack((ends, np.abs(within).max(axis=2))), reach


def _panels(last: float, period: float) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss from 0 to `last`, in panels of two periods."""
    node, part = np.polynomial.legendre.leggauss(_PANEL)
    panels = math.ceil(last / (2.0 * period))
    first = np.arange(panels)[:, np.newaxis] + (1.0 + node) / 2
    return (last / panels * first).ravel(), np.tile(last / panels / 2 * part, panels)


def _transform(sun: SunShape, wave: Floats) -> Floats:
    """Fourier transform of the sun shape, which is round, at spatial frequencies [1/rad]."""
    from scipy.special import j0

    out = np.zeros(len(wave))
    for radius, share in zip(sun.radius, sun.share, strict=True):
        out += share * j0(radius * wave)
    return out


def _at(terms: Floats, wave: Floats, place: Floats) -> Floats:
    """F_m at places, shape (nodes, harmonics, places), from terms of each wave, shape (waves, harmonics, nodes)."""
    from scipy.special import j0, j1

    out = np.zeros((len(place), *terms.shape[1:]))
    for k, radius in enumerate(place):
        _add_waves(terms, wave, radius, j0(wave * radius), j1(wave * radius), out[k])
    return out.transpose(2, 1, 0)


@kernel
def _add_waves(terms, wave, radius, zero, one, out):
    """Add terms times the integral of r J_2m(wave r) dr up to a radius, with J_0 and J_1 there.

    Bessel functions come from J_n+1 = 2 n / x J_n - J_n-1: upwards where x is greater than n, else downwards from where
    they are nothing.
    """
    orders = 2 * out.shape[0]
    bessel = np.zeros(orders + 64)
    for k in range(wave.shape[0]):
        x = wave[k] * radius
        if x > orders:
            bessel[0], bessel[1] = zero[k], one[k]
            for n in range(1, orders):
                bessel[n + 1] = 2.0 * n / x * bessel[n] - bessel[n - 1]
        else:
            last, total = orders + 62, 0.0
            bessel[last + 1], bessel[last] = 0.0, 1e-300
            for n in range(last, 0, -1):
                bessel[n - 1] = 2.0 * n / x * bessel[n] - bessel[n + 1]
                if abs(bessel[n - 1]) > 1e250:
                    for m in range(n - 1, last + 1):
                        bessel[m] *= 1e-300
            for n in range(2, last, 2):
                total += 2.0 * bessel[n]
            total += bessel[0]
            for n in range(orders + 1):
                bessel[n] /= total
        integral, rest = radius * bessel[1] / wave[k], 1.0 - bessel[0]
        for m in range(out.shape[0]):
            for v in range(out.shape[1]):
                out[m, v] += terms[k, m, v] * integral
            # J_2m = 2 (2 m - 1) / x J_2m-1 - J_2m-2, and the integral of J_2m-1 is 1 - J_0 - 2 J_2 - ... - 2 J_2m-2
            integral = 2.0 * (2 * m + 1) * rest / (wave[k] * wave[k]) - integral
            rest -= 2.0 * bessel[2 * m + 2]


@inline
def stretched(small, large, core):
    """Factors that make coordinates round, along and across; variance per axis there; smaller deviation of the blur.

    The variances of the light are those of the blur and of the sun's disc, `core`.
    """
    first, second = large + core, small + core
    even = math.sqrt(first * second)
    along, across = math.sqrt(even / first), math.sqrt(even / second)
    return along, across, even, min(math.sqrt(large) * along, math.sqrt(small) * across)


@inner
def weigh(tables, small, large, weights):
    """Write the weights of the nodes for a pair of variances, and return their band.

    Variances outside the span of the tables are brought to its end.
    """
    bands, width = tables.reach.shape[0], tables.logs[1] - tables.logs[0]
    log = min(max(math.log(small), tables.logs[0]), tables.logs[bands])
    band, span = min(int((log - tables.logs[0]) / width), bands - 1), tables.spans[1] - tables.spans[0]
    across, along = 2.0 * (log - tables.logs[band]) / width - 1.0, 0.0
    if span > 0.0:
        along = 2.0 * (min(max(math.log(large), tables.spans[0]), tables.spans[1]) - tables.spans[0]) / span - 1.0
    inner = tables.large.shape[1]
    for v in range(weights.shape[0]):
        weights[v] = _weight(tables.small, v // inner, across) * _weight(tables.large, v % inner, along)
    return band


@inline
def _weight(rule, node, place):
    """Polynomial of Lagrange that is 1 at one node and 0 at the others."""
    weight = rule[1, node]
    for other in range(rule.shape[1]):
        if other != node:
            weight *= place - rule[0, other]
    return weight


@inner
def extent(tables, band, weights, least):
    """Reach of the light of one pair of variances [rad], and the number of harmonics that are at least `least`."""
    reach = 0.0
    for v in range(weights.shape[0]):
        reach += weights[v] * tables.reach[band, v]
    for m in range(1, tables.size.shape[2]):
        size = 0.0
        for v in range(weights.shape[0]):
            size += weights[v] * tables.size[band, v, m]
        if abs(size) < least:
            return reach, m
    return reach, tables.size.shape[2]


@inner
def collapse(tables, band, weights, reach, harmonics, room, far):
    """Write the table of one pair of variances in `room`, and what is beyond it in `far`; returns its step. [rad]"""
    count = min(4 * int(reach / tables.steps[band]) + 8, room.shape[1])
    for m in range(harmonics):
        far[m] = 0.0
        for n in range(count):
            room[m, n] = weights[0] * tables.light[band, 0, m, n]
        for v in range(weights.shape[0]):
            far[m] += weights[v] * tables.far[band, v, m]
            if v > 0:
                for n in range(count):
                    room[m, n] += weights[v] * tables.light[band, v, m, n]
    return tables.steps[band]


@inline
def look_up(light, x, y):
    """Sum of F_m / r^2 cos(2 m phi) at a place. [1/rad^2]"""
    square = x * x + y * y
    inside = square < light.reach * light.reach
    n, f, inverse, total = 0, 0.0, 0.0, 0.0
    if inside:
        place = math.sqrt(square) * light.inverse
        n = int(place)
        f = place - n
        n *= 4
        total = _cubic(light.room, 0, n, f)
    else:
        inverse = 1.0 / square
        total = inverse
    if light.harmonics > 1:
        cosine = (x * x - y * y) / (square + 1e-300)
        now, older = cosine, 1.0
        for m in range(1, light.harmonics):
            total += now * (_cubic(light.room, m, n, f) if inside else light.far[m] * inverse)
            now, older = 2.0 * cosine * now - older, now
    return total


@inline
def _cubic(room, m, n, f):
    return (room[m, n] + f * room[m, n + 1]) + f * f * (room[m, n + 2] + f * room[m, n + 3])

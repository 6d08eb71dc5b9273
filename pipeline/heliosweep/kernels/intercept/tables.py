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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.intercept.sunshapes import DISC, SunShape

Floats = NDArray[np.float64]

TAIL = 4e-6
"""Light beyond the reach of a table. [1]"""
HARMONICS = 16
"""Most harmonics."""
LEAST_HARMONIC = 2e-5
"""Size of F_m below which a harmonic makes no difference: light within an outline would change by a tenth of it."""
_FINE = 6.0
"""Steps of the tables in the smallest standard deviation of a band."""
_NODES = 7
"""Nodes of `small` in a band."""
_PANEL = 16
"""Nodes of Gauss in a panel of the integrals, which is two periods of the fastest wave."""
_ANGLES = 32
"""Directions in a quadrant, from which the harmonics are taken."""
_BLOCK = 1_000_000
"""Waves and places whose integrals are held at once."""


class Tables(NamedTuple):
    """Tables of one sun shape over spans of both variances, made by `tables`."""

    edge: float
    """Angle of the outermost ring. [rad]"""
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
    step: float
    """Distance between places. [rad]"""
    reach: float
    """Radius beyond which there is no light. [rad]"""
    sigma: float
    """Smaller standard deviation of the blur. [rad]"""


def tables(sun: SunShape, small: tuple[float, float], large: tuple[float, float]) -> Tables:
    """Tables of a sun shape for blurs with variances from the least to the largest, which is greater. [rad^2]"""
    bands = max(1, math.ceil(math.log(small[1] / small[0]) / math.log(4.0)))
    logs, spans = np.linspace(math.log(small[0]), math.log(small[1]), bands + 1), np.log(large)
    rules = _chebyshev(_NODES), _chebyshev(1 if spans[1] == spans[0] else 2 + math.ceil(4.0 * (spans[1] - spans[0])))
    edge, disc = float(sun.radius.max()), sun.radius <= 1.001 * DISC
    core = float(np.sum((sun.share * sun.radius**2)[disc]) / np.sum(sun.share[disc])) / 2
    made, steps = [], np.empty(bands)
    for band in range(bands):
        across = np.exp((logs[band] + logs[band + 1] + (logs[1] - logs[0]) * rules[0][0]) / 2)
        along = np.exp((spans[0] + spans[1] + (spans[1] - spans[0]) * rules[1][0]) / 2)
        pairs = np.stack([each.ravel() for each in np.meshgrid(across, along, indexing="ij")])
        steps[band] = stretched(math.exp(logs[band]), math.exp(spans[0]), core)[3] / _FINE
        made.append(_band(sun, core, *pairs, float(steps[band])))
    count, most = (max(each[0].shape[axis] for each in made) for axis in (2, 1))
    light = np.zeros((bands, len(pairs[0]), most, 4 * count))
    far, size, reach = np.zeros((2, bands, len(pairs[0]), most)), None, np.zeros((bands, len(pairs[0])))
    for band, (values, ends, reaches) in enumerate(made):
        nodes, harmonics = values.shape[:2]
        light[band, :nodes, :harmonics, : values.shape[2] * 4] = values.reshape(nodes, harmonics, -1)
        far[:, band, :, :harmonics], reach[band] = ends, reaches
    return Tables(edge, core, logs, spans, steps, light, far[0], far[1], reach, *rules)


def _chebyshev(count: int) -> Floats:
    """Nodes on -1 to 1, and one over the product of their distances from the others, shape (2, count)."""
    place = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    return np.stack((place, 1.0 / np.prod(place[:, np.newaxis] - place + np.eye(count), axis=1)))


def _band(sun: SunShape, core: float, small: Floats, large: Floats, step: float) -> tuple[Floats, Floats, Floats]:
    """Coefficients (nodes, harmonics, steps, 4), F_m at the end and its size (2, nodes, harmonics), and reaches."""
    from scipy.interpolate import CubicSpline

    factors = np.array([stretched(*pair, core) for pair in zip(small, large, strict=True)]).T
    widest, blur = np.maximum(factors[0], factors[1]), np.sqrt(np.maximum(large, small))
    outermost = float(np.max(widest * sun.radius.max() + 6.0 * np.minimum(widest * blur, np.sqrt(factors[2]))))
    place = step * np.arange(math.ceil(outermost / step) + 2)
    wave, part = _panels(6.5 / float(factors[3].min()), 2.0 * np.pi / outermost)
    turn = np.pi / 2 * (np.arange(_ANGLES) + 0.5) / _ANGLES
    most = float(wave[-1] * widest.max())
    even = np.linspace(0.0, most, 8 * math.ceil(most * sun.radius.max()) + 9)
    transform = CubicSpline(even, _transform(sun, even))
    terms = np.empty((len(small), HARMONICS, len(wave)))
    for node, (along, across, _, _) in enumerate(factors.T):
        x, y = along * np.outer(wave, np.cos(turn)), across * np.outer(wave, np.sin(turn))
        spectrum = transform(np.sqrt(x * x + y * y)) * np.exp(-0.5 * (large[node] * x * x + small[node] * y * y))
        for m in range(HARMONICS):
            terms[node, m] = (-1.0) ** m * (2.0 - (m == 0)) * np.mean(spectrum * np.cos(2 * m * turn), axis=1)
    terms *= wave * part
    sizes = np.abs(_within(terms, wave, place[1 :: max(1, len(place) // 60)])).max(axis=(0, 2))
    count = 1 + int(np.flatnonzero(sizes >= 0.2 * LEAST_HARMONIC).max())
    blocks = np.array_split(place[1:], math.ceil(len(place) * len(wave) / _BLOCK))
    within = np.concatenate([_within(terms[:, :count], wave, block) for block in blocks], axis=2)
    ends = within[:, :, -1]
    left = np.abs(within - ends[:, :, np.newaxis]).sum(axis=1) > TAIL
    reach = place[1:][within.shape[2] - 1 - np.argmax(left[:, ::-1], axis=1)] + step
    values = np.zeros((*within.shape[:2], len(place)))
    values[:, :, 1:] = within / place[1:] ** 2
    values[:, 0, 0] = 0.5 * np.sum(terms[:, 0], axis=1)
    cubic = CubicSpline(place, values, axis=2, bc_type=("clamped", "not-a-knot")).c[::-1]
    scaled = cubic * (step ** np.arange(4))[:, np.newaxis, np.newaxis, np.newaxis]  # shape (4, steps, nodes, harmonics)
    return np.moveaxis(scaled, (0, 1), (3, 2)), np.stack((ends, np.abs(within).max(axis=2))), reach


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


def _within(terms: Floats, wave: Floats, place: Floats) -> Floats:
    """F_m at places, shape (nodes, harmonics, places): sums over waves of the integral of r J_2m(wave r) dr."""
    from scipy.special import j0, j1, jv

    x = np.outer(place, wave)
    even, odd = j0(x), j1(x)
    integral, rest, out = place[:, np.newaxis] * odd / wave, 1.0 - even, np.empty((*terms.shape[:2], len(place)))
    for m in range(terms.shape[1]):
        out[:, m] = np.einsum("vk,rk->vr", terms[:, m], integral)  # no BLAS: the same bits for any number of threads
        order = 2 * m + 1
        integral = 2.0 * order * rest / wave**2 - integral  # of J_n+1 = 2 n / x J_n - J_n-1, upwards for n < x alone
        even, below = 2.0 * order / x * odd - even, x < order + 1
        even[below] = jv(order + 1, x[below])
        odd = 2.0 * (order + 1) / x * even - odd
        odd[below] = jv(order + 2, x[below])
        rest -= 2.0 * even
    return out


@inline
def stretched(small, large, core):
    """Factors that make the coordinates round, along and across; variance per axis there; smaller deviation of the blur.

    The variances of the light are those of the blur and of the sun's disc, `core`.
    """
    first, second = large + core, small + core
    even = math.sqrt(first * second)
    along, across = math.sqrt(even / first), math.sqrt(even / second)
    return along, across, even, min(math.sqrt(large) * along, math.sqrt(small) * across)


@inner
def collapse(tables, small, large, least, room, far):
    """Write the table of one pair of variances in `room`, and what is beyond it in `far`.

    Returns the number of harmonics that are at least `least`, the step and the reach. [rad] Variances outside the span of the tables are brought to its end.
    """
    bands, nodes, inner = tables.reach.shape[0], tables.small.shape[1], tables.large.shape[1]
    width, span = tables.logs[1] - tables.logs[0], tables.spans[1] - tables.spans[0]
    log = min(max(math.log(small), tables.logs[0]), tables.logs[bands])
    band = min(int((log - tables.logs[0]) / width), bands - 1)
    place, place_large = 2.0 * (log - tables.logs[band]) / width - 1.0, 0.0
    if inner > 1:
        log_large = min(max(math.log(large), tables.spans[0]), tables.spans[1])
        place_large = 2.0 * (log_large - tables.spans[0]) / span - 1.0
    step, reach, harmonics = tables.steps[band], 0.0, 1
    far[:] = 0.0
    for level in range(2):
        count = min(4 * int(reach / step) + 4, room.shape[1])
        for v in range(nodes * inner):
            factor = _factor(tables.small, v // inner, place) * _factor(tables.large, v % inner, place_large)
            if level == 0:
                reach += factor * tables.reach[band, v]
                for m in range(far.shape[0]):
                    far[m] += factor * tables.size[band, v, m]
                continue
            for m in range(harmonics):
                if v == 0:
                    far[m] = factor * tables.far[band, v, m]
                    for n in range(count):
                        room[m, n] = factor * tables.light[band, v, m, n]
                else:
                    far[m] += factor * tables.far[band, v, m]
                    for n in range(count):
                        room[m, n] += factor * tables.light[band, v, m, n]
        if level == 0:
            for m in range(1, far.shape[0]):
                if abs(far[m]) > least:
                    harmonics = m + 1
    return harmonics, step, reach


@inline
def _factor(rule, node, place):
    """Polynomial of Lagrange that is 1 at one node and 0 at the others."""
    factor = rule[1, node]
    for other in range(rule.shape[1]):
        if other != node:
            factor *= place - rule[0, other]
    return factor


@inline
def look_up(light, x, y):
    """Sum of F_m / r^2 cos(2 m phi) at a place. [1/rad^2]"""
    square = x * x + y * y
    radius = math.sqrt(square)
    cosine = (x * x - y * y) / (square + 1e-300)
    now, older, place = cosine, 1.0, radius / light.step
    n = int(place)
    f, n, inside = place - n, 4 * n, radius < light.reach
    total = 0.0
    if inside:
        total = light.room[0, n] + f * (light.room[0, n + 1] + f * (light.room[0, n + 2] + f * light.room[0, n + 3]))
    else:
        total = 1.0 / square
    for m in range(1, light.harmonics):
        if inside:
            part = light.room[m, n] + f * (
                light.room[m, n + 1] + f * (light.room[m, n + 2] + f * light.room[m, n + 3])
            )
        else:
            part = light.far[m] / square
        total += now * part
        now, older = 2.0 * cosine * now - older, now
    return total

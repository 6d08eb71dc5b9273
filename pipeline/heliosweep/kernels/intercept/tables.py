"""Tables of a blurred sun: the light within a circle, by the direction in which it lies.

The sun shape, blurred by a Gaussian with the variances `large` and `small` along two axes, is stretched along these so
that its covariance is round. Its density there is a sum of harmonics, K = sum of K_m(r) cos(2 m phi), as the sun's own
roundness is lost. With F_m(r) = 2 pi times the integral of K_m r dr, the light within an outline about the centre is

    1 / (2 pi) * closed integral of the sum of F_m(r) cos(2 m phi) dphi

F_0 tends to 1, the others to the harmonics of all light. F_m / r^2 is smooth in r^2. Kept are its Chebyshev series in
r^2 / (r^2 + b), at Chebyshev nodes of log `small` and log `large`: these stand in bands, within which the largest
`small` is at most four times the smallest. Each has a radius up to which its series go, and a b with which these are
fine where the disc is. The F_m are integrals of the light's Fourier transform over spatial frequencies.

`light` makes of a table the light of one heliostat at an instant, and looks it up.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.sunshapes import DISC, SunShape

TAIL = 4e-6
"""Light beyond the reach of a table. [1]"""
HARMONICS = 24
"""Most harmonics."""
LEAST_HARMONIC = 1e-4
"""Size of F_m below which a harmonic makes no difference: light within an outline would change by a twentieth of it."""
ACCURACY = 1e-6
"""Largest error of a series, as light. [1]"""
BLOCK = 8
"""Terms of a series that stand together; see `_blocks`."""
_FIRST = 64
"""Places at which it is first seen how far the light of a band reaches, and with how many harmonics."""
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
    radius: Floats
    """Radius up to which the light of each band is known. [rad]"""
    bend: Floats
    """b of each band. [rad^2]"""
    blocks: NDArray[np.int64]
    """Blocks of each series, two or more, shape (bands, harmonics)."""
    light: Floats
    """Series of F_m / r^2, see `_blocks`, shape (bands, nodes, harmonics, BLOCK * most blocks). [1/rad^2]"""
    far: Floats
    """F_m of all light, shape (bands, nodes, harmonics). [1]"""
    size: Floats
    """Largest F_m, shape (bands, nodes, harmonics). [1]"""
    reach: Floats
    """Radius beyond which there is no light, shape (bands, nodes). [rad]"""
    small: Floats
    """Chebyshev nodes on -1 to 1, and one over the product of their distances from the others, shape (2, nodes)."""
    large: Floats
    """The same of `large`, whose nodes are the inner ones."""


def tables(sun: SunShape, small: tuple[float, float], large: tuple[float, float]) -> Tables:
    """Tables of a sun shape for blurs with variances from the least to the largest, which is greater. [rad^2]"""
    bands = max(1, math.ceil(math.log(small[1] / small[0]) / math.log(4.0)))
    logs, spans = np.linspace(math.log(small[0]), math.log(small[1]), bands + 1), np.log(large)
    rules = _chebyshev(_NODES), _chebyshev(1 if spans[1] == spans[0] else 2 + math.ceil(4.0 * (spans[1] - spans[0])))
    disc = sun.radius <= 1.001 * DISC
    core = float(np.sum((sun.share * sun.radius**2)[disc]) / np.sum(sun.share[disc])) / 2
    made = []
    for band in range(bands):
        across = np.exp((logs[band] + logs[band + 1] + (logs[1] - logs[0]) * rules[0][0]) / 2)
        along = np.exp((spans[0] + spans[1] + (spans[1] - spans[0]) * rules[1][0]) / 2)
        made.append(_band(sun, core, *(each.ravel() for each in np.meshgrid(across, along, indexing="ij"))))
    nodes, harmonics, terms = (max(each.light.shape[axis] for each in made) for axis in range(3))
    light, blocks = np.zeros((bands, nodes, harmonics, terms)), np.zeros((bands, harmonics), np.int64)
    far, size = np.zeros((2, bands, nodes, harmonics))
    for band, each in enumerate(made):
        count = each.light.shape[1]
        light[band, :, :count, : each.light.shape[2]], blocks[band, :count] = each.light, each.blocks
        far[band, :, :count], size[band, :, :count] = each.far, each.size
    radius, bend = np.array([(each.radius, each.bend) for each in made]).T.copy()
    return Tables(core, logs, spans, radius, bend, blocks, light, far, size, np.array([x.reach for x in made]), *rules)


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


class _Band(NamedTuple):
    """Part of `Tables` that is one band's."""

    radius: float
    bend: float
    blocks: NDArray[np.int64]
    light: Floats
    far: Floats
    size: Floats
    reach: Floats


def _band(sun: SunShape, core: float, small: Floats, large: Floats) -> _Band:
    """Table of one band, at pairs of variances."""
    factors = np.array([stretched(*pair, core) for pair in zip(small, large, strict=True)]).T
    widest, blur = np.maximum(factors[0], factors[1]), np.sqrt(np.maximum(large, small))
    blurred, least = float(np.max(np.minimum(widest * blur, np.sqrt(factors[2])))), float(factors[3].min())
    outermost = float(np.max(widest) * sun.radius.max() + 6.0 * blurred)
    wave, part = _panels(6.5 / least, 2.0 * np.pi / outermost)
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
    place = outermost / _FIRST * np.arange(1.0, _FIRST + 1)
    within = _at(terms, wave, place)
    size, far = np.abs(within).max(axis=2), within[:, :, -1]
    count = 1 + int(np.flatnonzero(size.max(axis=0) >= 0.03 * LEAST_HARMONIC).max())
    size, far = size[:, :count], far[:, :count]
    beyond = np.abs(within[:, :count] - far[:, :, np.newaxis]).sum(axis=1).max(axis=0) > 0.02 * TAIL
    radius = float(place[int(np.flatnonzero(beyond).max()) + 1])
    bend = 0.5 * radius * min(radius, float(np.max(widest)) * DISC + 4.5 * blurred)
    nodes = BLOCK * (2 + math.ceil(1.7 * radius / least / BLOCK))
    angle = np.pi * (np.arange(nodes) + 0.5) / nodes
    square = _square(np.cos(angle), radius, bend)
    values = _at(np.ascontiguousarray(terms[:, :count]), wave, np.sqrt(square)) / square
    series = 2.0 / nodes * values @ np.cos(np.outer(angle, np.arange(nodes)))
    series[:, :, 0] /= 2.0
    blocks = _lengths(series, square, angle)
    place = np.linspace(0.0, radius, 20 * nodes)
    angle = np.arccos(np.clip(_stretch(place**2, radius, bend), -1.0, 1.0))
    left = np.zeros((len(small), len(place)))
    for m in range(count):
        waves = np.cos(np.outer(np.arange(BLOCK * blocks[m]), angle))
        left += np.abs(series[:, m, : len(waves)] @ waves * place**2 - far[:, m, np.newaxis])
    reach = place[np.minimum(len(place) - np.argmax(left[:, ::-1] > TAIL, axis=1), len(place) - 1)]
    series = np.where(np.arange(nodes) < BLOCK * blocks[:, np.newaxis], series, 0.0)
    return _Band(radius, bend, blocks, _blocks(series[:, :, : BLOCK * int(blocks.max())]), far, size, reach)


def _square(place: Floats, radius: float, bend: float) -> Floats:
    """r^2 of places from -1 to 1, where the series stand."""
    part = (1.0 + place) / 2 * radius**2 / (radius**2 + bend)
    return bend * part / (1.0 - part)


def _stretch(square: Floats, radius: float, bend: float) -> Floats:
    """Places from -1 to 1 of r^2 up to the square of a radius."""
    return 2.0 * (radius**2 + bend) / radius**2 * square / (square + bend) - 1.0


def _lengths(series: Floats, square: Floats, angle: Floats) -> NDArray[np.int64]:
    """Blocks of each harmonic's series that are needed for `ACCURACY`."""
    left, blocks = np.zeros((*series.shape[:2], len(square))), np.full(series.shape[1], 2)
    for first in range(series.shape[2] - BLOCK, 0, -BLOCK):
        waves = np.cos(np.outer(np.arange(first, first + BLOCK), angle))
        left += series[:, :, first : first + BLOCK] @ waves
        needed = np.abs(left * square).max(axis=(0, 2)) > ACCURACY
        blocks = np.maximum(blocks, np.where(needed, first // BLOCK + 1, 2))
    return blocks


def _blocks(series: Floats) -> Floats:
    """Chebyshev series, along the last axis, in blocks: the sum of q_j(z) T_8j(z), q_j by powers of z up to the 7th.

    Blocks cost half of the sum of single terms, and are as exact. From 2 T_i T_8j = T_8j+i + T_8j-i.
    """
    made = series.copy()
    for j in range(made.shape[-1] - BLOCK, 0, -BLOCK):
        made[..., j - BLOCK + 1 : j] -= made[..., j + BLOCK - 1 : j : -1]
        made[..., j + 1 : j + BLOCK] *= 2.0
    powers = np.zeros((BLOCK, BLOCK))
    for term in range(BLOCK):
        powers[term, : term + 1] = np.polynomial.chebyshev.cheb2poly(np.eye(BLOCK)[term])[: term + 1]
    return (made.reshape(*made.shape[:-1], -1, BLOCK) @ powers).reshape(made.shape)


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

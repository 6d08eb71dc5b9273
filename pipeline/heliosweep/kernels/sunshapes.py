"""Radial brightness of the sun and its aureole, represented by rings that each contain a share of the light.

A sun shape is the brightness B(r) as a function of the angle r from the sun's centre. A sun shape is stored as rings at
Gauss-Legendre nodes. A ring of radius r contains the fraction 2 pi r B(r) dr of the light. The Buie sun shape [1]_ is
a disc with a tail of scattered light, the aureole.

References
----------
.. [1] D. Buie, A. G. Monger and C. J. Dey, "Sunshape distributions for terrestrial solar simulations", Solar Energy 74
   (2003) 113-122, doi 10.1016/S0038-092X(03)00125-7
"""

import math
from collections.abc import Callable
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.profiles import jose as jose_profile
from heliosweep.kernels.profiles import render

#: Angular radius of the sun's disc. [rad]
DISC = 4.65e-3
#: Standard deviation per axis of the Gaussian sun. [rad]
GAUSSIAN = 2.73e-3
#: Limb darkening: relative reduction of the brightness at the limb. [1]
LIMB = 0.56
#: Minimum and maximum circumsolar ratio of the Buie sun shape.
CSR = (0.001, 0.8)

_NODES = 96


class SunShape(NamedTuple):
    """Angular brightness of the sun; created by `pillbox`, `gaussian`, `limb_darkened`, `jose`, `buie` or `table`."""

    #: Angular radii of the rings. [rad]
    radius: Floats
    #: Share of the light in each ring; the sum is 1. [1]
    share: Floats
    #: Variance per axis of an additional Gaussian blur of all rings. [rad^2]
    variance: float

    @property
    def spread(self) -> float:
        """Variance of the light per axis. [rad^2]"""
        return self.variance + float(np.sum(self.share * self.radius**2)) / 2


@cache
def pillbox() -> SunShape:
    """Return a disc of uniform brightness with an angular radius of 4.65 mrad."""
    return _rings((0.0, DISC), np.ones_like)


@cache
def gaussian() -> SunShape:
    """Return a Gaussian sun with a standard deviation of 2.73 mrad per axis."""
    return SunShape(np.zeros(1), np.ones(1), GAUSSIAN**2)


@cache
def limb_darkened() -> SunShape:
    """Return a disc with limb darkening: 1 - 0.56 (1 - sqrt(1 - (r / 4.65 mrad)^2))."""
    return _rings((0.0, DISC), lambda r: 1.0 - LIMB * (1.0 - np.sqrt(np.maximum(0.0, 1.0 - (r / DISC) ** 2))))


@cache
def jose() -> SunShape:
    """Return the disc with Jose's profile, as used in backward gazing (`heliosweep.kernels.profiles.jose`)."""
    profile = jose_profile()
    return _rings((0.0, profile.radius), lambda r: render(profile, r))


@lru_cache(16)
def buie(circumsolar_ratio: float) -> SunShape:
    """Return the disc and aureole of Buie et al. (2003); the aureole has the fraction `circumsolar_ratio` of the light.

    The published formula calls its parameter the circumsolar ratio, but the resulting ratio differs from the parameter
    by 0.1 percentage points or more. This function therefore finds the parameter for the requested ratio by bisection.
    Raises ValueError if the ratio is outside the range given by `CSR`.
    """
    if not CSR[0] <= circumsolar_ratio <= CSR[1]:
        raise ValueError(f"the circumsolar ratio must be from {CSR[0]} to {CSR[1]}")
    low, high = 1e-5, 0.999
    for _ in range(60):
        middle = (low + high) / 2
        shape = buie_formula(middle)
        below = float(np.sum(shape.share[shape.radius > DISC])) < circumsolar_ratio
        low, high = (middle, high) if below else (low, middle)
    return buie_formula((low + high) / 2)


def buie_formula(parameter: float) -> SunShape:
    """Return the disc and aureole of Buie et al. (2003) for the parameter chi of the published formula. [1]"""
    k = 0.9 * math.log(13.5 * parameter) * parameter**-0.3
    gamma = 2.2 * math.log(0.52 * parameter) * parameter**0.43 - 0.1

    def brightness(r: Floats) -> Floats:
        mrad = 1e3 * r
        return np.where(r > DISC, math.exp(k) * mrad**gamma, np.cos(0.326 * mrad) / np.cos(0.308 * mrad))

    return _rings((0.0, DISC, *np.linspace(DISC, 43.6e-3, 6)[1:]), brightness)


def table(angle: Floats, brightness: Floats) -> SunShape:
    """Return a sun shape interpolated linearly between brightnesses at ascending angles from the sun's centre [rad]."""
    nodes = max(3, math.ceil(2 * _NODES / (len(angle) - 1)))
    return _rings(tuple(angle), lambda r: np.interp(r, angle, brightness), nodes)


def quantile(shape: SunShape, part: Floats) -> Floats:
    """Return the angular radius about the sun's centre that contains a given fraction of the light. [rad]"""
    if shape.variance > 0.0:
        return math.sqrt(shape.variance) * np.sqrt(-2.0 * np.log1p(-part))
    within = np.concatenate(([0.0], np.cumsum(shape.share) - 0.5 * shape.share, [1.0]))
    return np.sqrt(np.interp(part, within, np.concatenate(([0.0], shape.radius**2, shape.radius[-1:] ** 2))))


def _rings(edges: tuple[float, ...], brightness: Callable[[Floats], Floats], nodes: int = _NODES) -> SunShape:
    """Return a sun shape with rings between `edges`, the angles at which the brightness may be discontinuous.

    The nodes are denser at each outer edge, where the brightness may decrease like a square root.
    """
    place, weight = np.polynomial.legendre.leggauss(nodes)
    place, weight = (1.0 + place) / 2, weight / 2
    inner, outer = np.array(edges[:-1])[:, np.newaxis], np.array(edges[1:])[:, np.newaxis]
    radius = outer - (outer - inner) * place**2
    share = 2.0 * (outer - inner) * place * weight * radius * brightness(radius)
    return SunShape(radius.ravel(), share.ravel() / share.sum(), 0.0)

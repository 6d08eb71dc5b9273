"""Intercept by one round Gaussian for each heliostat, as HFLCAL takes it [1]_: quick, and some percent off.

The image has the variance of sun, slopes and specularity over the slant range D, and of astigmatism, for a mirror of
the size d, the root of its area, and the focal length f at the angle of incidence i: Ht = d |D / f - cos i| and
Ws = d |D cos i / f - 1|, each a 32nd of its square. It is widened by the cosine of incidence on the receiver.

References
----------
.. [1] P. Schwarzboezl, R. Pitz-Paal and M. Schmitz, "Visual HFLCAL - a software tool for layout and optimisation of
   heliostat fields", SolarPACES 2009
"""

import math

import numpy as np

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.intercept.efficiency import Scene
from heliosweep.kernels.intercept.receivers import CYLINDER
from heliosweep.kernels.vectors import cross, dot, mixed, unit


def intercepts(scene: Scene, spread: float, sun: Floats) -> Floats:
    """Intercept of mirrors at instants, shape (N, T), NaN with the sun down. [1]

    `spread` is the variance of the sun per axis [rad^2]. A cylinder counts as the rectangle of its width that faces the
    heliostat.
    """
    out = np.full((len(scene.centre), len(sun)), np.nan)
    _run(scene, spread, sun, np.zeros((0, 0)), out, np.zeros((0, 0)))
    return out


def cells(scene: Scene, spread: float, sun: Floats, sent: Floats, intercept: Floats, columns: int, rows: int) -> Floats:
    """Light on each cell of a receiver, the sum over mirrors and instants, as `flux.cells` gives it.

    The cells of each mirror and instant add up to `sent` times `intercept`; of a cylinder they are those of the
    rectangle that faces the heliostat, seen along its normal.
    """
    made, out = np.zeros((rows, columns)), np.array(intercept, np.float64, order="C")
    _run(scene, spread, sun, np.array(sent, np.float64, order="C"), out, made)
    return made


def _run(scene: Scene, spread: float, sun: Floats, sent: Floats, out: Floats, made: Floats) -> None:
    """Call the kernel with arrays of one kind."""
    errors = scene.errors
    slope = 0.5 * (errors.slope_u**2 + errors.slope_v**2)
    *mirrors, sun = (np.array(each, np.float64, order="C") for each in (*scene[:4], sun))
    _intercepts(*mirrors, spread + errors.specularity**2, slope, scene.receiver, sun, out, sent, made)


@kernel
def _intercepts(centre, target, sides, curve, even, slope, receiver, sun, out, sent, made):
    """Write the intercepts; `even` and `slope` are variances of the ray and of the normal. [rad^2]

    Where light is `sent`, add the light on cells to `made` instead.
    """
    for i in range(out.shape[0]):
        place = (centre[i, 0], centre[i, 1], centre[i, 2])
        d = mixed(1.0, (target[i, 0], target[i, 1], target[i, 2]), -1.0, place)
        slant = math.sqrt(dot(d, d))
        r = unit(d)
        face = cross(receiver.across, receiver.upward)
        if receiver.kind == CYLINDER:
            face = unit((-d[0], -d[1], 0.0))
        cosine = -dot(r, face)
        relative = 2.0 * slant * curve[i]
        aim = mixed(1.0, (target[i, 0], target[i, 1], target[i, 2]), -1.0, receiver.centre)
        x, y = dot(aim, receiver.across), dot(aim, receiver.upward)
        if receiver.kind == CYLINDER:
            x = 0.0
        for t in range(sun.shape[0]):
            if not sun[t, 2] > 0.0:
                continue
            if cosine <= 0.0:
                if sent.shape[0] == 0:
                    out[i, t] = 0.0
                continue
            incidence = math.sqrt(max(0.0, 0.5 + 0.5 * dot(r, (sun[t, 0], sun[t, 1], sun[t, 2]))))
            tangential, sagittal = relative - incidence, relative * incidence - 1.0
            variance = slant * slant * (even + 2.0 * (1.0 + incidence * incidence) * slope)
            variance += sides[i, 0] * sides[i, 1] * (tangential * tangential + sagittal * sagittal) / 32.0
            scale = 1.0 / math.sqrt(2.0 * variance / cosine)
            if sent.shape[0] == 0:
                out[i, t] = _within(receiver.half_width, x, scale) * _within(receiver.half_height, y, scale)
            elif sent[i, t] != 0.0:
                _cells(receiver, face, x, y, scale, sent[i, t] * out[i, t], made)


@inline
def _within(half, place, scale):
    """Part of a Gaussian, centred at a place, within a half length about 0."""
    if place == 0.0:
        return math.erf(half * scale)
    return 0.5 * (math.erf((half + place) * scale) + math.erf((half - place) * scale))


@inner
def _cells(receiver, face, x, y, scale, light, made):
    """Add the light of one Gaussian to the cells, shared as it falls on them."""
    rows, columns = made.shape
    total = _within(receiver.half_width, x, scale) * _within(receiver.half_height, y, scale)
    cell, middle = 2.0 * math.pi / columns, math.atan2(face[0], face[1])
    for k in range(columns):
        if receiver.kind == CYLINDER:
            wide = 0.0
            for turn in (-1.0, 0.0, 1.0):
                first = k * cell - middle + turn * 2.0 * math.pi
                wide += _share(_aside(first), _aside(first + cell), receiver.half_width * scale)
        else:
            place = x / receiver.half_width
            wide = _share(
                2.0 * k / columns - 1.0 - place, 2.0 * (k + 1) / columns - 1.0 - place, receiver.half_width * scale
            )
        place = y / receiver.half_height
        for j in range(rows):
            high = _share(
                2.0 * j / rows - 1.0 - place, 2.0 * (j + 1) / rows - 1.0 - place, receiver.half_height * scale
            )
            made[j, k] += light / total * wide * high


@inline
def _share(first, last, scale):
    """Part of a Gaussian between two places."""
    return 0.5 * (math.erf(last * scale) - math.erf(first * scale))


@inline
def _aside(turn):
    """Place of an azimuth across a cylinder that is seen from azimuth 0, over its radius."""
    return math.sin(min(max(turn, -0.5 * math.pi), 0.5 * math.pi))

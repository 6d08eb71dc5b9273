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
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.intercept.efficiency import CYLINDER, Receiver
from heliosweep.kernels.intercept.mirror import Errors
from heliosweep.kernels.vectors import cross, dot, mixed, unit

Floats = NDArray[np.float64]


def intercepts(
    centre: Floats,
    target: Floats,
    sides: Floats,
    curve: Floats,
    spread: float,
    errors: Errors,
    receiver: Receiver,
    sun: Floats,
) -> Floats:
    """Intercept of mirrors at instants, shape (N, T), NaN with the sun down. [1]

    `spread` is the variance of the sun per axis [rad^2]; all else is of `efficiency.Scene`. A cylinder counts as the
    rectangle of its width that faces the heliostat.
    """
    out, sun = np.full((len(centre), len(sun)), np.nan), np.array(sun, np.float64, order="C")
    slope = 0.5 * (errors.slope_u**2 + errors.slope_v**2)
    arrays = (np.array(each, np.float64, order="C") for each in (centre, target, sides, curve))
    _intercepts(*arrays, spread + errors.specularity**2, slope, receiver, sun, out)
    return out


@kernel
def _intercepts(centre, target, sides, curve, even, slope, receiver, sun, out):
    """Write the intercepts; `even` and `slope` are variances of the ray and of the normal. [rad^2]"""
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
        for t in range(sun.shape[0]):
            if not sun[t, 2] > 0.0:
                continue
            if cosine <= 0.0:
                out[i, t] = 0.0
                continue
            incidence = math.sqrt(max(0.0, 0.5 + 0.5 * dot(r, (sun[t, 0], sun[t, 1], sun[t, 2]))))
            tangential, sagittal = relative - incidence, relative * incidence - 1.0
            variance = slant * slant * (even + 2.0 * (1.0 + incidence * incidence) * slope)
            variance += sides[i, 0] * sides[i, 1] * (tangential * tangential + sagittal * sagittal) / 32.0
            scale = 1.0 / math.sqrt(2.0 * variance / cosine)
            out[i, t] = math.erf(receiver.half_width * scale) * math.erf(receiver.half_height * scale)

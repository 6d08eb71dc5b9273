"""Sun profiles at many angles: their brightness one by one, for those of `gazing.lanes`, and the kernels' inverse."""

import math

import numpy as np

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.sun.profiles import inverse_square

_LEAST = 1e-60


@inline
def brightness(profile, square):
    """Brightness B [1], continued beyond 0.9995 eps_max by the tangent, and its slope (dB/deps) / eps [1/rad^2].

    `square` is the square of the angle eps from the disc centre [rad^2]. With eps^2 = v^2 + w^2, the slope gives dI/dp
    = slope (v dv/dp + w dw/dp).
    """
    square = max(square, _LEAST)
    if square >= profile.edge * profile.edge:
        angle = math.sqrt(square)
        return profile.edge_value + profile.edge_slope * (angle - profile.edge), profile.edge_slope / angle
    if profile.table.size > 0:
        angle = math.sqrt(square)
        place = angle / profile.step
        cell = min(int(place), profile.table.size - 2)
        rise = profile.table[cell + 1] - profile.table[cell]
        return profile.table[cell] + (place - cell) * rise, rise / (profile.step * angle)
    drop = (square / (profile.radius * profile.radius)) ** (0.5 * profile.power)
    c = math.sqrt(1.0 - drop)
    value = profile.c0 + c * (profile.c1 + c * (profile.c2 + c * profile.c3))
    along = profile.c1 + c * (2.0 * profile.c2 + c * (3.0 * profile.c3))
    return value, -along * profile.power * drop / (2.0 * c * square)


def evaluate(profile, angle):
    """Brightness with its tangent, and dB/deps [1/rad], at angles from the disc centre [rad]; any shape."""
    angles = np.array(angle, np.float64)
    value, slope = _evaluate(profile, angles.ravel())
    return value.reshape(angles.shape), slope.reshape(angles.shape)


def invert(profile, value):
    """Angle from the disc centre at which a profile has a brightness [rad]; any shape."""
    values = np.array(value, np.float64)
    return _invert(profile, values.ravel()).reshape(values.shape)


@kernel
def _evaluate(profile, angles):
    value, slope = np.empty_like(angles), np.empty_like(angles)
    for k in range(angles.size):
        value[k], steepness = brightness(profile, angles[k] * angles[k])
        slope[k] = steepness * abs(angles[k])
    return value, slope


@kernel
def _invert(profile, values):
    out = np.empty_like(values)
    for k in range(values.size):
        out[k] = math.sqrt(inverse_square(profile, values[k]))
    return out

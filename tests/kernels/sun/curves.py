"""Sun profiles at many angles by the kernels."""

import math

import numpy as np

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.sun.profiles import brightness, inverse_square


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

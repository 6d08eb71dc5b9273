"""Sun profiles at many angles: brightness by the kernel and by NumPy, and the inverse."""

import numpy as np

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.profiles import brightness, inverse_squares


def evaluate(profile, angle):
    """Brightness with its tangent, and dB/deps [1/rad], at angles from the disc centre [rad]; any shape."""
    angles = np.array(angle, np.float64)
    value, slope = _evaluate(profile, angles.ravel())
    return value.reshape(angles.shape), slope.reshape(angles.shape)


@kernel
def _evaluate(profile, angles):
    value, slope = np.empty_like(angles), np.empty_like(angles)
    for k in range(angles.size):
        value[k], steepness = brightness(profile, angles[k] * angles[k])
        slope[k] = steepness * abs(angles[k])
    return value, slope


def plain(profile, angle):
    """Brightness with its tangent in NumPy."""
    if profile.table.size:
        inside = np.interp(angle, np.linspace(0.0, profile.radius, profile.table.size), profile.table)
    else:
        c = np.sqrt(1.0 - np.minimum(angle / profile.radius, 1.0) ** profile.power)
        inside = np.polyval([profile.c3, profile.c2, profile.c1, profile.c0], c)
    return np.where(angle >= profile.edge, profile.edge_value + profile.edge_slope * (angle - profile.edge), inside)


def invert(profile, value):
    """Angle from the disc centre at which a profile has a brightness [rad]; any shape."""
    return np.sqrt(inverse_squares(profile, np.array(value, np.float64)))

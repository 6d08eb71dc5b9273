"""Pointing errors of a mount at every instant of a group of windows, by the closed forms and by the chain of axes.

Vectors are x west, y south, z up. The mount leans by `tilt` about the horizontal unit vector u = (cos direction,
-sin direction, 0): the foot of its azimuth axis moves towards `direction`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.windows import COSINE, ROWS, SINE, SOUTH, UP, WEST

__all__ = ["RIGID", "SMALL", "UNTILTED_HOME_AXES", "arcsine", "fill_errors"]

RIGID = 0
"""The whole mount leans."""
UNTILTED_HOME_AXES = 1
"""The azimuth axis leans; the home positions of the other axes do not."""

SMALL = 0.12
"""Largest sine for the series of the arcsine: cut after x^15, it is short by 2e-17."""

Floats = NDArray[np.float64]


@inline
def arcsine(x: float) -> float:
    """Arcsine of 0 <= x <= `SMALL`."""
    q = x * x
    series = 35.0 / 1152.0 + q * (63.0 / 2816.0 + q * (231.0 / 13312.0 + q * (143.0 / 10240.0)))
    return x + x * q * (1.0 / 6.0 + q * (3.0 / 40.0 + q * (5.0 / 112.0 + q * series)))


@kernel
def fill_errors(rows: Floats, model: int, mount: Floats, errors: Floats) -> None:
    """Errors of one mount at all instants of a group."""
    home_azimuth, home_elevation, direction, tilt = mount
    columns = rows.reshape(len(rows), ROWS, errors.shape[1])
    if home_azimuth != 0.0 or home_elevation != 0.0:
        _chain(columns, model, mount, errors)
    elif model == RIGID:
        _rigid(columns, direction, tilt, errors)
    else:
        _untilted(columns, direction, tilt, errors)
    largest = (tilt if model == RIGID else 2.0 * tilt) + abs(home_azimuth) + abs(home_elevation)
    if largest <= 2.0 * SMALL:
        for step in range(len(errors)):
            for k in range(errors.shape[1]):
                errors[step, k] = 2.0 * arcsine(errors[step, k])
    else:
        for step in range(len(errors)):
            for k in range(errors.shape[1]):
                errors[step, k] = 2.0 * math.asin(min(errors[step, k], 1.0))


@kernel
def _rigid(rows: Floats, direction: float, tilt: float, sines: Floats) -> None:
    """Sines of half the errors of a mount that leans as a whole: sin(tilt / 2) |u x s|."""
    half_sine = math.sin(0.5 * tilt)
    west, south = math.sin(direction), math.cos(direction)
    for step in range(len(rows)):
        for k in range(rows.shape[2]):
            along = west * rows[step, WEST, k] + south * rows[step, SOUTH, k]
            sines[step, k] = half_sine * math.sqrt(along * along + rows[step, UP, k] * rows[step, UP, k])


@kernel
def _untilted(rows: Floats, direction: float, tilt: float, sines: Floats) -> None:
    """Sines of half the errors of a mount whose azimuth axis leans alone: |v x s|.

    v = sin h cos h (u - Qu) - sin^2 h (u x Qu), where h = tilt / 2 and Q turns by psi about the vertical. With
    u = (ux, uy, 0), u - Qu = (ux (1 - cos psi) - uy sin psi, uy (1 - cos psi) + ux sin psi, 0) and
    u x Qu = (0, 0, -sin psi).
    """
    level, rise = math.sin(0.5 * tilt) * math.cos(0.5 * tilt), math.sin(0.5 * tilt) ** 2
    ux, uy = level * math.cos(direction), -level * math.sin(direction)
    for step in range(len(rows)):
        for k in range(rows.shape[2]):
            x, y, z = rows[step, WEST, k], rows[step, SOUTH, k], rows[step, UP, k]
            versine, sine = 1.0 - rows[step, COSINE, k], rows[step, SINE, k]
            vx, vy, vz = ux * versine - uy * sine, uy * versine + ux * sine, rise * sine
            cx, cy, cz = vy * z - vz * y, vz * x - vx * z, vx * y - vy * x
            sines[step, k] = math.sqrt(cx * cx + cy * cy + cz * cz)


@kernel
def _chain(rows: Floats, model: int, mount: Floats, sines: Floats) -> None:
    """Sines of half the errors by turning the focal axis about the elevation axis, then about the azimuth axis."""
    home_azimuth, home_elevation, direction, tilt = mount
    azimuth_axis = 0.0, 0.0, -1.0
    elevation_axis = 0.0, 1.0, 0.0
    focal_axis = (
        -math.cos(home_azimuth) * math.cos(home_elevation),
        -math.sin(home_azimuth),
        math.cos(home_azimuth) * math.sin(home_elevation),
    )
    u = math.cos(direction), -math.sin(direction), 0.0
    cosine, sine = math.cos(tilt), math.sin(tilt)
    azimuth_axis = _turned(azimuth_axis, u, cosine, sine)
    if model == RIGID:
        elevation_axis = _turned(elevation_axis, u, cosine, sine)
        focal_axis = _turned(focal_axis, u, cosine, sine)
    for step in range(len(rows)):
        for k in range(rows.shape[2]):
            x, y, z = rows[step, WEST, k], rows[step, SOUTH, k], rows[step, UP, k]
            raised = _turned(focal_axis, elevation_axis, math.sqrt(x * x + y * y), z)
            fx, fy, fz = _turned(raised, azimuth_axis, rows[step, COSINE, k], rows[step, SINE, k])
            sines[step, k] = 0.5 * math.sqrt((fx - x) ** 2 + (fy - y) ** 2 + (fz - z) ** 2)


@inline
def _turned(
    vector: tuple[float, float, float], axis: tuple[float, float, float], cosine: float, sine: float
) -> tuple[float, float, float]:
    """`vector` turned about the unit vector `axis`, right-handed, by Rodrigues' formula."""
    x, y, z = vector
    ax, ay, az = axis
    along = (ax * x + ay * y + az * z) * (1.0 - cosine)
    return (
        x * cosine + (ay * z - az * y) * sine + ax * along,
        y * cosine + (az * x - ax * z) * sine + ay * along,
        z * cosine + (ax * y - ay * x) * sine + az * along,
    )

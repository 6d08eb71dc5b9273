"""Brightness of the sun's disc against the angle from its centre, analytic or tabulated, and its inverse.

The generalised formula of Jose [1]_, [2]_ is B = A + (1 - A) sqrt(1 - u^xi) with u = eps / eps_max. Every analytic
profile here is a cubic in c = sqrt(1 - u^xi), of which that formula is the linear case.
A table is linear between nodes uniform in eps. Renderers use the profile as it is, exactly 0 outside the disc
(`rendered`); reconstructions need a slope everywhere and continue it by its tangent at 0.9995 eps_max.

References
----------
.. [1] P. Jose, "The flux through the focal spot of a solar furnace", Solar Energy 1 (1957) 19-22
.. [2] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270, Eq. 7
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline

#: Brightness A at the limb relative to the centre [2]_. [1]
LIMB = 0.679
#: Angular radius of the disc [2]_. [rad]
EPS_MAX = 4.360e-3
#: Exponent xi [2]_. [1]
POWER = 2.222
#: Angle at which the tangent takes over, relative to eps_max: at 1 the analytic slope is infinite. [1]
EDGE = 0.9995
#: Minimum square of an angle, for the slope at the centre. [rad^2]
_TINY = 1e-60


class Profile(NamedTuple):
    """A sun profile as kernels take it; made by `jose`, `tabulated` or the functions of `sun.tables`.

    Brightness is relative to the disc centre, angles are from the disc centre. One type for all kinds, so that a
    kernel is compiled once.
    """

    #: Angular radius eps_max. [rad]
    radius: float
    #: Exponent xi of the analytic profile.
    power: float
    #: Coefficients of the cubic in sqrt(1 - u^xi): 1,
    c0: float
    #: c,
    c1: float
    #: c^2
    c2: float
    #: and c^3.
    c3: float
    #: Angle at which the tangent takes over. [rad]
    edge: float
    #: Brightness there.
    edge_value: float
    #: dB/deps of the tangent, negative. [1/rad]
    edge_slope: float
    #: Angle between the nodes of the table. [rad]
    step: float
    #: Brightness at the nodes k step, the last one at eps_max, shape (nodes,); empty for an analytic profile.
    table: Floats
    #: Falling brightness at equal steps from 0 to eps_max, for the inverse; empty where that has a closed form.
    envelope: Floats


@inline
def brightness(profile, square):
    """Return the brightness, continued by the tangent beyond 0.9995 eps_max, and its slope (dB/deps) / eps [1/rad^2].

    `square` is the square of the angle eps from the disc centre [rad^2]. With eps^2 = v^2 + w^2, the slope gives dB/dp
    = slope (v dv/dp + w dw/dp).
    """
    square = max(square, _TINY)
    if square >= profile.edge * profile.edge:
        angle = math.sqrt(square)
        return profile.edge_value + profile.edge_slope * (angle - profile.edge), profile.edge_slope / angle
    if profile.table.size > 0:
        angle, each = math.sqrt(square), 1.0 / profile.step
        place = angle * each
        cell = min(int(place), profile.table.size - 2)
        below, rise = profile.table[cell], profile.table[cell + 1] - profile.table[cell]
        return below + (place - cell) * rise, rise * each / angle
    drop = math.exp(0.5 * profile.power * math.log(square / (profile.radius * profile.radius)))
    c = math.sqrt(1.0 - drop)
    value = profile.c0 + c * (profile.c1 + c * (profile.c2 + c * profile.c3))
    along = profile.c1 + c * (2.0 * profile.c2 + c * (3.0 * profile.c3))
    return value, -along * profile.power * drop / (2.0 * c * square)


@inline
def rendered(profile, square):
    """Brightness of the disc itself, exactly 0 outside, at the square of an angle from its centre [rad^2]. [1]"""
    if square > profile.radius * profile.radius:
        return 0.0
    if profile.table.size > 0:
        place = math.sqrt(square) / profile.step
        cell = min(int(place), profile.table.size - 2)
        return profile.table[cell] + (place - cell) * (profile.table[cell + 1] - profile.table[cell])
    # the exponential of the logarithm takes half the time of the power
    drop = math.exp(0.5 * profile.power * math.log(square / (profile.radius * profile.radius)))
    c = math.sqrt(max(1.0 - drop, 0.0))
    return profile.c0 + c * (profile.c1 + c * (profile.c2 + c * profile.c3))


def inverse_squares(profile: Profile, values: Floats) -> Floats:
    """Return the squares of the angles at which a profile, tangent included, has some brightnesses. [rad^2]

    0 for values above the brightest; same shape as `values`. A table is inverted through its monotone envelope.
    """
    envelope = profile.envelope
    with np.errstate(invalid="ignore"):
        if envelope.size == 0:
            tangent = profile.edge + (values - profile.edge_value) / profile.edge_slope
            c = (values - profile.c0) / profile.c1
            inside = profile.radius**2 * np.maximum(1.0 - c**2, 0.0) ** (2.0 / profile.power)
            return np.where(values <= profile.edge_value, tangent**2, inside)
        above = np.clip(np.searchsorted(-envelope, -values), 1, envelope.size - 1)  # envelope[above] <= value
        fall = envelope[above - 1] - envelope[above]
        share = (envelope[above - 1] - values) / np.where(fall > 0.0, fall, 1.0)
        inside = profile.radius * (above - 1 + share) / (envelope.size - 1)
        tangent = profile.radius + (values - envelope[-1]) / profile.edge_slope
        return np.where(values >= envelope[0], 0.0, np.where(values <= envelope[-1], tangent, inside) ** 2)


def jose(limb: float = LIMB, radius: float = EPS_MAX, power: float = POWER) -> Profile:
    """The generalised formula of Jose, A + (1 - A) sqrt(1 - (eps / eps_max)^xi).

    `limb` is A [1], from 0 to less than 1, `radius` eps_max [rad] and `power` xi [1]; ValueError for one out of range.
    """
    if not (0.0 <= limb < 1.0 and radius > 0.0 and power > 0.0):
        raise ValueError("a Jose profile needs 0 <= limb < 1, radius > 0 and power > 0")
    return analytic((limb, 1.0 - limb, 0.0, 0.0), radius, power, np.empty(0))


def tabulated(brightness: ArrayLike, angle: ArrayLike | None = None) -> Profile:
    """A profile from a table of brightness, linear between its nodes.

    `brightness`, shape (n,), is relative to the disc centre, not negative, and taken as it is. The table ends at
    eps_max, unless the `angle` of each value is given, rising from 0 [rad]; where these are not uniform, the table is
    interpolated at as many uniform nodes as its smallest step asks for, 4096 at most.

    The tangent at the edge has the slope of the last cell or, where that is smaller, of the last twentieth of the
    nodes: noise may make the last cell rise, and a rising tangent has no inverse. Raises ValueError for fewer than 3
    nodes, numbers that are negative or not finite, and an edge that is no darker than the disc.
    """
    values, radius = np.ascontiguousarray(brightness, np.float64), EPS_MAX
    if angle is not None:
        angles = np.asarray(angle, np.float64)
        if angles.shape != values.shape or angles.ndim != 1 or len(angles) < 3:
            raise ValueError("a sun profile needs as many angles as brightnesses, 3 at least")
        steps, radius = np.diff(angles), float(angles[-1])
        if not (np.all(np.isfinite(angles)) and abs(angles[0]) <= 1e-9 * radius and np.all(steps > 0.0)):
            raise ValueError("the angles of a sun profile must rise from 0")
        if np.ptp(steps) > 1e-6 * steps.mean():
            cells = min(math.ceil(float(radius / steps.min())), 4095)
            values = np.interp(np.linspace(0.0, radius, cells + 1), angles, values)
    if values.ndim != 1 or len(values) < 3 or not np.all(np.isfinite(values)) or not radius > 0.0:
        raise ValueError("a sun profile needs 3 finite numbers at least, and a positive radius")
    if np.any(values < 0.0):
        raise ValueError("a sun profile must not be negative")
    return table_profile(values, radius)


def render(profile: Profile, angle: ArrayLike) -> Floats:
    """Brightness at angles from the disc centre [rad], exactly 0 outside the disc; any shape."""
    angles = np.abs(np.asarray(angle, np.float64))
    if profile.table.size > 0:
        value = np.interp(angles, profile.step * np.arange(profile.table.size), profile.table)
    else:
        c = np.sqrt(1.0 - np.minimum(angles / profile.radius, 1.0) ** profile.power)
        value = profile.c0 + c * (profile.c1 + c * (profile.c2 + c * profile.c3))
    return np.where(angles > profile.radius, 0.0, value)


def analytic(cubic: tuple[float, float, float, float], radius: float, power: float, envelope: Floats) -> Profile:
    """A cubic in c = sqrt(1 - u^xi) with its tangent at the edge."""
    c0, c1, c2, c3 = (float(f) for f in cubic)
    drop = EDGE**power
    c = math.sqrt(1.0 - drop)
    value = c0 + c * (c1 + c * (c2 + c * c3))
    slope = -(c1 + c * (2.0 * c2 + c * 3.0 * c3)) * power * drop / (2.0 * c * EDGE * radius)
    return Profile(float(radius), float(power), c0, c1, c2, c3, EDGE * radius, value, slope, 1.0, np.empty(0), envelope)


def table_profile(values: Floats, radius: float) -> Profile:
    """A table with its tangent at the edge and its envelope."""
    cells = len(values) - 1
    few = max(2, cells // 20)
    rise = min(values[-1] - values[-2], (values[-1] - values[-1 - few]) / few)
    if rise >= 0.0:
        rise = (values[-1] - values[0]) / cells
    if rise >= 0.0:
        raise ValueError("a sun profile must be darker at its edge than at its centre")
    step = radius / cells
    value = values[-1] - (1.0 - EDGE) * cells * rise
    return Profile(
        float(radius), POWER, 0.0, 0.0, 0.0, 0.0, EDGE * radius, float(value), float(rise / step), step,
        np.ascontiguousarray(values), falling_envelope(values),
    )  # fmt: skip


def falling_envelope(values: Floats) -> Floats:
    """The smallest falling curve that is nowhere below a table.

    Method A inverts noisy tables through it. Of the envelopes tried it comes nearest to the published errors of method
    A (medians of 14 / 11 % at 1.2 % noise), which is why it was chosen; the curve midway to the greatest falling one
    below the table is more accurate (15 / 3 %).
    """
    return np.ascontiguousarray(np.maximum.accumulate(values[::-1])[::-1])

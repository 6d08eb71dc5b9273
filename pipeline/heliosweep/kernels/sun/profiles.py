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
from heliosweep.kernels.compiled import inline, kernel

LIMB = 0.679
"""Brightness A at the limb relative to the centre [2]_. [1]"""
EPS_MAX = 4.360e-3
"""Angular radius of the disc [2]_. [rad]"""
POWER = 2.222
"""Exponent xi [2]_. [1]"""
EDGE = 0.9995
"""Angle at which the tangent takes over, relative to eps_max: at 1 the analytic slope is infinite. [1]"""
_TINY = 1e-60
"""Least square of an angle: keeps 0 / 0 out of the slope at the centre, and 0 from `power`. [rad^2]"""
_LEAST_POWER = -1000.0
"""Power of 2 that counts as 0: `power` makes no smaller number than 2^-1022."""

_BITS, _BIAS, _ROOT_HALF = np.int64(52), np.int64(1023), np.int64(0x3FE6A09E667F3BCD)
_L0, _L1, _L2, _L3, _L4, _L5, _L6, _L7, _L8, _L9, _L10 = (2.0 / ((2 * k + 1) * math.log(2.0)) for k in range(11))
_E1, _E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12, _E13 = (
    math.log(2.0) ** k / math.factorial(k) for k in range(1, 14)
)


class Profile(NamedTuple):
    """A sun profile as kernels take it; made by `jose`, `tabulated` or the functions of `sun_tables`.

    Brightness is relative to the disc centre, angles are from the disc centre. One type for all kinds, so that a
    kernel is compiled once.
    """

    radius: float
    """Angular radius eps_max. [rad]"""
    power: float
    """Exponent xi of the analytic profile."""
    c0: float
    """Coefficients of the cubic in sqrt(1 - u^xi): 1,"""
    c1: float
    """c,"""
    c2: float
    """c^2"""
    c3: float
    """and c^3."""
    edge: float
    """Angle at which the tangent takes over. [rad]"""
    edge_value: float
    """Brightness there."""
    edge_slope: float
    """dB/deps of the tangent, negative. [1/rad]"""
    step: float
    """Angle between the nodes of the table. [rad]"""
    table: Floats
    """Brightness at the nodes k step, the last one at eps_max, shape (nodes,); empty for an analytic profile."""
    envelope: Floats
    """Falling brightness at equal steps from 0 to eps_max, for the inverse; empty where that has a closed form."""


@inline
def power(base, exponent):
    """Base to an exponent, for a normal positive base, to a few units of the last digit: vector code.

    The logarithm is a series in (m - 1) / (m + 1) of the mantissa m, the exponential a Taylor polynomial. The error is
    4e-16 of the result for each doubling from 1 to it, which must be a normal number too: see `least_base`.
    """
    bits = np.float64(base).view(np.int64)
    octave = np.int64((bits - _ROOT_HALF) >> _BITS)
    mantissa = np.int64(bits - (octave << _BITS)).view(np.float64)
    z = (mantissa - 1.0) / (mantissa + 1.0)
    w = z * z
    s = _L7 + w * (_L8 + w * (_L9 + w * _L10))
    s = _L3 + w * (_L4 + w * (_L5 + w * (_L6 + w * s)))
    x = exponent * (octave + z * (_L0 + w * (_L1 + w * (_L2 + w * s))))
    whole = math.floor(x + 0.5)
    f = x - whole
    e = _E9 + f * (_E10 + f * (_E11 + f * (_E12 + f * _E13)))
    e = _E4 + f * (_E5 + f * (_E6 + f * (_E7 + f * (_E8 + f * e))))
    e = 1.0 + f * (_E1 + f * (_E2 + f * (_E3 + f * e)))
    return e * np.int64((np.int64(whole) + _BIAS) << _BITS).view(np.float64)


@inline
def least_base(exponent):
    """Least base that `power` may be given."""
    return max(_TINY, 2.0 ** (_LEAST_POWER / exponent))


@inline
def rendered(profile, square):
    """Brightness of the disc itself, exactly 0 outside, at the square of an angle from its centre [rad^2]. [1]"""
    if square > profile.radius * profile.radius:
        return 0.0
    if profile.table.size > 0:
        place = math.sqrt(square) / profile.step
        cell = min(int(place), profile.table.size - 2)
        return profile.table[cell] + (place - cell) * (profile.table[cell + 1] - profile.table[cell])
    c = math.sqrt(1.0 - (square / (profile.radius * profile.radius)) ** (0.5 * profile.power))
    return profile.c0 + c * (profile.c1 + c * (profile.c2 + c * profile.c3))


@kernel
def render_squares(profile: Profile, squares: Floats) -> None:
    """Put the brightness, as `rendered`, in the place of many squares; NaN stays."""
    if profile.table.size > 0:
        for k in range(squares.size):
            squares[k] = rendered(profile, squares[k])
        return
    limit, half = profile.radius * profile.radius, 0.5 * profile.power
    area, c0, c1, c2, c3 = 1.0 / limit, profile.c0, profile.c1, profile.c2, profile.c3
    least = least_base(half) * limit
    for k in range(squares.size):
        drop = power(min(max(squares[k], least), limit) * area, half)
        c = math.sqrt(max(1.0 - drop, 0.0))
        inside = c0 + c * (c1 + c * (c2 + c * c3))  # a number also where there is none
        squares[k] = inside if squares[k] <= limit else 0.0 if squares[k] > limit else math.nan


@kernel
def inverse_squares(profile: Profile, values: Floats, squares: Floats) -> None:
    """Write the squares of the angles of many brightnesses, as `inverse_square`."""
    if profile.envelope.size > 0:
        for k in range(values.size):
            squares[k] = inverse_square(profile, values[k])
        return
    area, each, inverse = profile.radius * profile.radius, 2.0 / profile.power, 1.0 / profile.c1
    edge, edge_value, slope, c0 = profile.edge, profile.edge_value, 1.0 / profile.edge_slope, profile.c0
    least = least_base(each)
    for k in range(values.size):
        c = (values[k] - c0) * inverse
        angle = edge + (values[k] - edge_value) * slope
        rest = max(1.0 - c * c, 0.0)
        inside = area * power(max(rest, least), each) if rest > 0.0 else 0.0
        squares[k] = angle * angle if values[k] <= edge_value else inside


@inline
def inverse_square(profile, value):
    """Square of the angle at which a profile, tangent included, has a brightness, 0 above the brightest. [rad^2]

    A table is inverted through its monotone envelope.
    """
    nodes = profile.envelope.size
    if nodes == 0:
        if value <= profile.edge_value:
            angle = profile.edge + (value - profile.edge_value) / profile.edge_slope
            return angle * angle
        c = (value - profile.c0) / profile.c1
        return profile.radius * profile.radius * max(1.0 - c * c, 0.0) ** (2.0 / profile.power)
    if value >= profile.envelope[0]:
        return 0.0
    last = profile.envelope[nodes - 1]
    if value <= last:
        angle = profile.radius + (value - last) / profile.edge_slope
        return angle * angle
    below, above = 0, nodes - 1  # envelope[below] > value >= envelope[above]
    while above - below > 1:
        middle = (below + above) >> 1
        if profile.envelope[middle] > value:
            below = middle
        else:
            above = middle
    share = (profile.envelope[below] - value) / (profile.envelope[below] - profile.envelope[above])
    angle = profile.radius * (below + share) / (nodes - 1)
    return angle * angle


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
        values, radius = _uniform(np.asarray(angle, np.float64), values)
    if values.ndim != 1 or len(values) < 3 or not np.all(np.isfinite(values)) or not radius > 0.0:
        raise ValueError("a sun profile needs 3 finite numbers at least, and a positive radius")
    if np.any(values < 0.0):
        raise ValueError("a sun profile must not be negative")
    return table_profile(values, radius)


def render(profile: Profile, angle: ArrayLike) -> Floats:
    """Brightness at angles from the disc centre [rad], exactly 0 outside the disc; any shape."""
    angles = np.asarray(angle, np.float64)
    return _render(profile, np.array(angles, np.float64).ravel()).reshape(angles.shape)


@kernel
def _render(profile, angles):
    out = np.empty_like(angles)
    for k in range(angles.size):
        out[k] = rendered(profile, angles[k] * angles[k])
    return out


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
    """The least falling curve that lies nowhere below a table.

    Method A inverts noisy tables through it. Of the envelopes tried it comes nearest to the published errors of method
    A (medians of 14 / 11 % at 1.2 % noise), which is why it was chosen; the curve midway to the greatest falling one
    below the table is more accurate (15 / 3 %).
    """
    return np.ascontiguousarray(np.maximum.accumulate(values[::-1])[::-1])


def _uniform(angle: Floats, values: Floats) -> tuple[Floats, float]:
    """A table at uniform nodes from 0 to its last angle."""
    if angle.shape != values.shape or angle.ndim != 1 or len(angle) < 3:
        raise ValueError("a sun profile needs as many angles as brightnesses, 3 at least")
    steps = np.diff(angle)
    if not (np.all(np.isfinite(angle)) and abs(angle[0]) <= 1e-9 * angle[-1] and np.all(steps > 0.0)):
        raise ValueError("the angles of a sun profile must rise from 0")
    if np.ptp(steps) <= 1e-6 * steps.mean():
        return values, float(angle[-1])
    cells = min(math.ceil(float(angle[-1] / steps.min())), 4095)
    return np.interp(np.linspace(0.0, angle[-1], cells + 1), angle, values), float(angle[-1])

"""Brightness profile of the sun's disc (analytic, tabulated or from images) and its inverse.

Jose's generalised formula [1]_, [2]_ is B = A + (1 - A) sqrt(1 - u^xi) with u = eps / eps_max. Every analytic profile
here is a cubic in c = sqrt(1 - u^xi), and Jose's formula is the linear case. A tabulated profile has nodes at equal
steps of eps and is linear between its nodes. Renderers use the profile itself, which is exactly 0 outside the disc
(`render`). Reconstructions need a slope everywhere, so they extend the profile along its tangent at 0.9995 eps_max.

References
----------
.. [1] P. Jose, "The flux through the focal spot of a solar furnace", Solar Energy 1 (1957) 19-22
.. [2] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270, Eq. 7

The disc in an image is the region that is brighter than half the brightness of the limb. The centroid and the area of
this region give the centre and the radius of the disc, with errors below one pixel. The profile consists of medians
over rings about the centroid. Medians suppress dust and hot pixels. Rings at the limb contain both disc and sky pixels.
In these rings, the profile is therefore extrapolated linearly in c = sqrt(1 - u^xi), because Jose's formula is linear
in c.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Philox
from numpy.typing import ArrayLike

from heliosweep.kernels.compiled import Floats, inline

#: Brightness A at the limb relative to the centre [2]_. [1]
LIMB = 0.679
#: Angular radius of the disc [2]_. [rad]
EPS_MAX = 4.360e-3
#: Exponent xi [2]_. [1]
POWER = 2.222
#: Angle beyond which the tangent replaces the profile, relative to eps_max. At 1, the analytic slope is infinite. [1]
EDGE = 0.9995
#: Lower limit of the squared angle, to avoid a division by zero at the centre. [rad^2]
_TINY = 1e-60


class Profile(NamedTuple):
    """Sun profile in the form that the kernels need; created by `jose` or `tabulated`.

    Brightness is relative to the disc centre, and angles are measured from the disc centre. All profiles have the same
    type, so that kernels are compiled only once.
    """

    #: Angular radius eps_max. [rad]
    radius: float
    #: Exponent xi of the analytic profile.
    power: float
    #: Constant term of the cubic in c = sqrt(1 - u^xi).
    c0: float
    #: Coefficient of c.
    c1: float
    #: Coefficient of c^2.
    c2: float
    #: Coefficient of c^3.
    c3: float
    #: Angle beyond which the tangent replaces the profile. [rad]
    edge: float
    #: Brightness at the angle `edge`.
    edge_value: float
    #: Slope dB/deps of the tangent, negative. [1/rad]
    edge_slope: float
    #: Angle between the nodes of the table. [rad]
    step: float
    #: Brightness at the angles k * step up to eps_max, shape (nodes,); empty for an analytic profile.
    table: Floats
    #: Decreasing brightness at equal steps from 0 to eps_max, for the inverse; empty if the inverse has a closed form.
    envelope: Floats


@inline
def brightness(profile, square):
    """Return the brightness B and the slope (dB/deps) / eps [1/rad^2].

    Beyond 0.9995 eps_max, the brightness follows the tangent. `square` is the squared angle eps^2 from the disc centre
    [rad^2]. If eps^2 = v^2 + w^2, the derivative with respect to a parameter p is dB/dp = slope (v dv/dp + w dw/dp).
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
    """Return the brightness [1] at a squared angle from the disc centre [rad^2], exactly 0 outside the disc."""
    if square > profile.radius * profile.radius:
        return 0.0
    if profile.table.size > 0:
        place = math.sqrt(square) / profile.step
        cell = min(int(place), profile.table.size - 2)
        return profile.table[cell] + (place - cell) * (profile.table[cell + 1] - profile.table[cell])
    # exp(log) takes half the time of a power
    drop = math.exp(0.5 * profile.power * math.log(square / (profile.radius * profile.radius)))
    c = math.sqrt(max(1.0 - drop, 0.0))
    return profile.c0 + c * (profile.c1 + c * (profile.c2 + c * profile.c3))


def inverse_squares(profile: Profile, values: Floats) -> Floats:
    """Return the squared angles at which the brightness of a profile, including its tangent, equals `values`. [rad^2]

    The result has the same shape as `values` and is 0 for values above the maximum brightness. A tabulated profile is
    inverted through its monotone envelope.
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
    """Return the profile given by Jose's generalised formula, A + (1 - A) sqrt(1 - (eps / eps_max)^xi).

    `limb` is the brightness A at the limb, at least 0 and less than 1 [1]. `radius` is the angular radius eps_max
    [rad], and `power` is the exponent xi [1].
    """
    return analytic((limb, 1.0 - limb, 0.0, 0.0), radius, power, np.empty(0))


def tabulated(brightness: ArrayLike, angle: ArrayLike | None = None) -> Profile:
    """Return a profile that is linear between the nodes of a brightness table.

    `brightness`, shape (n,), is relative to the disc centre, must not be negative, and is not scaled. The table ends at
    eps_max unless `angle` contains the angle of each value, ascending from 0 [rad]. If the angles are not uniform, the
    table is interpolated at uniform nodes. The spacing of these nodes is the smallest step of the angles, but there are
    at most 4096 nodes.

    The slope of the tangent at the edge is the steeper of two mean slopes, over the last cell and over the last
    twentieth of the nodes. Noise may make the brightness increase over the last cell, and an increasing tangent would
    have no inverse.
    Raises ValueError if there are fewer than 3 nodes, if a number is negative or not finite, or if the edge is not
    darker than the disc.
    """
    values, radius = np.ascontiguousarray(brightness, np.float64), EPS_MAX
    if angle is not None:
        angles = np.asarray(angle, np.float64)
        if angles.shape != values.shape or angles.ndim != 1 or len(angles) < 3:
            raise ValueError("a sun profile needs equal numbers of angles and brightnesses, at least 3")
        steps, radius = np.diff(angles), float(angles[-1])
        if not (np.all(np.isfinite(angles)) and abs(angles[0]) <= 1e-9 * radius and np.all(steps > 0.0)):
            raise ValueError("the angles of a sun profile must increase from 0")
        if np.ptp(steps) > 1e-6 * steps.mean():
            cells = min(math.ceil(float(radius / steps.min())), 4095)
            values = np.interp(np.linspace(0.0, radius, cells + 1), angles, values)
    if values.ndim != 1 or len(values) < 3 or not np.all(np.isfinite(values)) or not radius > 0.0:
        raise ValueError("a sun profile needs at least 3 finite numbers, and a positive radius")
    if np.any(values < 0.0):
        raise ValueError("a sun profile must not be negative")
    return table_profile(values, radius)


def render(profile: Profile, angle: ArrayLike) -> Floats:
    """Return the brightness at angles from the disc centre [rad] of any shape, exactly 0 outside the disc."""
    angles = np.abs(np.asarray(angle, np.float64))
    if profile.table.size > 0:
        value = np.interp(angles, profile.step * np.arange(profile.table.size), profile.table)
    else:
        c = np.sqrt(1.0 - np.minimum(angles / profile.radius, 1.0) ** profile.power)
        value = profile.c0 + c * (profile.c1 + c * (profile.c2 + c * profile.c3))
    return np.where(angles > profile.radius, 0.0, value)


def analytic(cubic: tuple[float, float, float, float], radius: float, power: float, envelope: Floats) -> Profile:
    """Return the profile of a cubic in c = sqrt(1 - u^xi), with its tangent at the edge."""
    c0, c1, c2, c3 = (float(f) for f in cubic)
    drop = EDGE**power
    c = math.sqrt(1.0 - drop)
    value = c0 + c * (c1 + c * (c2 + c * c3))
    slope = -(c1 + c * (2.0 * c2 + c * 3.0 * c3)) * power * drop / (2.0 * c * EDGE * radius)
    return Profile(float(radius), float(power), c0, c1, c2, c3, EDGE * radius, value, slope, 1.0, np.empty(0), envelope)


def table_profile(values: Floats, radius: float) -> Profile:
    """Return the profile of a table, with its tangent at the edge and its envelope."""
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
    """Return the lowest decreasing curve that is nowhere below a table.

    Method A inverts noisy tables through this curve. Among the envelopes tested, this curve best reproduces the
    published errors of method A. At 1.2 % noise, the median errors are 14 % for horizontal and 11 % for vertical
    slopes. The mean of this curve and the highest decreasing curve below the table is more accurate (15 % and 3 %).
    """
    return np.ascontiguousarray(np.maximum.accumulate(values[::-1])[::-1])


def noisy(profile: Profile, noise: float, nodes: int = 120, seed: int = 0) -> Profile:
    """Return a profile tabulated at uniform nodes, including both ends, with Gaussian noise at each node.

    `noise` is the standard deviation relative to the brightness of the disc centre [1]. The number of nodes, `nodes`,
    must be at least 3. `seed` is the key of the counter-based generator, so the noise of node k does not depend on the
    number of nodes. Values that become negative due to noise are set to 0.
    """
    clean = render(profile, np.linspace(0.0, profile.radius, nodes))
    table = np.maximum(clean + noise * normal_draws(seed, 1, nodes), 0.0)
    return table_profile(table, profile.radius)._replace(power=profile.power)


def scaled(profile: Profile, error: float) -> Profile:
    """Return the profile with its angular radius multiplied by 1 + error, to simulate an erroneous profile."""
    factor = 1.0 + error
    return profile._replace(
        radius=profile.radius * factor,
        edge=profile.edge * factor,
        edge_slope=profile.edge_slope / factor,
        step=profile.step * factor,
    )


def smoothed(profile: Profile, nodes: float) -> Profile:
    """Smooth a tabulated profile with a Gaussian whose standard deviation is `nodes` table steps.

    For the convolution, the table is mirrored at the disc centre and extended along its tangent beyond the edge.
    """
    table = profile.table
    reach = math.ceil(5.0 * nodes)
    offsets = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (offsets / nodes) ** 2)
    weights /= weights.sum()
    place = np.abs(np.arange(table.size)[:, np.newaxis] + offsets)
    beyond = np.maximum(place - (table.size - 1), 0)
    wide = table[np.minimum(place, table.size - 1)] + beyond * (profile.edge_slope * profile.step)
    return table_profile(np.sum(wide * weights, axis=1), profile.radius)._replace(power=profile.power)


def smooth_fit(profile: Profile) -> Profile:
    """Fit a cubic in sqrt(1 - u^xi) to the nodes of a table by least squares; xi is the `power` of the profile."""
    table, power = profile.table, profile.power
    c = np.sqrt(1.0 - np.linspace(0.0, 1.0, table.size) ** power)
    fit, *_ = np.linalg.lstsq(np.stack((np.ones_like(c), c, c**2, c**3), axis=1), table, rcond=None)
    c0, c1, c2, c3 = map(float, fit)
    c = np.sqrt(1.0 - np.linspace(0.0, 1.0, 1025) ** power)
    curve = c0 + c * (c1 + c * (c2 + c * c3))
    return analytic((c0, c1, c2, c3), profile.radius, power, falling_envelope(curve))


def normal_draws(seed: int, stream: int, count: int) -> Floats:
    """Return standard normal numbers from the counter-based generator Philox 4x64.

    The number at index k depends only on k and on the key. The key consists of `seed` and `stream`, which must not be
    negative. Each use of the generator has a separate stream. The result has shape (count,). Pairs of numbers are
    computed by the Box-Muller transform.
    """
    pairs = (count + 1) // 2
    raw = Philox(key=np.array([seed, stream], np.uint64)).random_raw(2 * pairs)
    uniform = ((raw >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52  # exact, and never 0 or 1
    length, turn = np.sqrt(-2.0 * np.log(uniform[0::2])), 2.0 * np.pi * uniform[1::2]
    return np.stack((length * np.cos(turn), length * np.sin(turn)), axis=1).ravel()[:count]


#: Width of the zone at the limb in which pixels contain both disc and sky. [pixels]
_LIMB = 1.5


class SunDisc(NamedTuple):
    """Brightness profile of the sun's disc in an image, and geometry of the disc."""

    #: Brightness relative to the centre, at equal steps from the centre to the edge. [1]
    brightness: Floats
    #: Radius of the disc. [pixels]
    radius: float
    #: Column and row of the centre. [pixels]
    centre: tuple[float, float]
    #: Brightness of the disc centre, in the scale of the image.
    level: float


def disc_profile(image: ArrayLike) -> SunDisc:
    """Return the profile of the sun's disc in an image.

    `image` contains levels above the dark level, shape (rows, columns), with NaN for unusable pixels. Raises ValueError
    if there is no disc, or if the disc is too small, cut off by the edge of the image, or not round.
    """
    levels = np.asarray(image, np.float64)
    seen = levels[np.isfinite(levels)]
    if seen.size == 0 or not np.max(seen) > 0.0:
        raise ValueError("shows no disc: no pixel is brighter than the dark level")
    top = float(np.median(seen[seen >= 0.5 * np.percentile(seen, 99.9)]))
    column, row, radius, distance, roundness = _disc(levels, 0.4 * top)
    ring = (distance > 0.93 * radius) & (distance < 0.97 * radius) & np.isfinite(levels)
    if np.any(ring):
        column, row, radius, distance, roundness = _disc(levels, 0.5 * float(np.median(levels[ring])))
    rows, columns = levels.shape
    room = min(column, row, columns - 1 - column, rows - 1 - row)
    for wrong, fault in (
        (radius < 12.0, f"a disc of radius {radius:.1f} pixels; 12 are needed"),
        (room < radius + 0.5, "a disc cut off by the frame"),
        (abs(roundness - 1.0) > 0.05, "no single round disc: clouds, stray light or a second disc?"),
    ):
        if wrong:
            raise ValueError(f"shows {fault}")
    nodes = int(np.clip(round(radius) + 1, 4, 120))
    step = radius / (nodes - 1)
    use = np.isfinite(levels) & (distance < radius - _LIMB)
    number, inner = np.rint(distance[use] / step).astype(np.int64), levels[use]
    table = np.full(nodes, math.nan)
    for node in np.flatnonzero((np.arange(nodes) + 0.5) * step < radius - _LIMB):
        values = inner[number == node]
        table[node] = np.median(values) if values.size >= 5 else math.nan
    u = np.linspace(0.0, 1.0, nodes)
    c = np.sqrt(1.0 - u**POWER)
    good = np.isfinite(table)
    if np.count_nonzero(good) < 8:
        raise ValueError("shows too few usable pixels of the disc")
    curve = np.linalg.lstsq(np.stack((np.ones_like(c), c, c**2), axis=1)[good], table[good], rcond=None)[0]
    outer = good & (u > 0.75)
    edge = np.linalg.lstsq(np.stack((np.ones_like(c), c), axis=1)[outer], table[outer], rcond=None)[0]
    continued = np.where(u < 0.5, curve[0] + c * (curve[1] + c * curve[2]), edge[0] + c * edge[1])
    level = float(np.sum(curve))
    return SunDisc(np.where(good, table, continued) / level, radius, (column, row), level)


def _disc(levels: Floats, limit: float) -> tuple[float, float, float, Floats, float]:
    """Return the geometry of the image region that is brighter than a limit.

    Returns the column and row of the centroid, the radius, the distance of each pixel from the centroid, and the
    roundness. The roundness is the mean square radius divided by its value for a disc. All lengths are in pixels.
    """
    bright = levels > limit  # False for NaN
    rows, columns = np.nonzero(bright)
    if rows.size < 4:
        raise ValueError("shows no disc")
    u, v = float(columns.mean()), float(rows.mean())
    row, column = np.indices(levels.shape)
    distance = np.hypot(column - u, row - v)
    radius = math.sqrt(rows.size / math.pi)
    return u, v, radius, distance, 2.0 * float(np.mean(distance[bright] ** 2)) / radius**2

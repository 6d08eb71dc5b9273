"""Intercept over many instants of one place, interpolated in the direction of the sun and checked.

The intercept is smooth in the direction of the sun, as shading is not. It is computed at Chebyshev nodes, their ends
among them, in the sine of the declination and in the hour angle over that of sunset, and interpolated. Each mirror is
checked at some instants; one that misses gets more nodes, and one that still misses is computed at every instant.

With a vertical first axis a mirror turns fast about its normal where that comes near the zenith. The intercept of a
mirror that is turned from the axes of spinning-elevation by a given angle is smooth there too, and periodic in that
angle: it is computed at some, and its terms of Fourier are interpolated.
"""

import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION
from heliosweep.kernels.intercept.efficiency import Scene, intercepts
from heliosweep.kernels.intercept.mirror import ROLLED
from heliosweep.kernels.vectors import PACKET

Floats = NDArray[np.float64]
Nodes = tuple[Floats, Floats, Floats]

NODES = ((3, 7), (5, 13), (9, 13), (17, 25))
"""Nodes in the sine of the declination and in the hour angle, of one try after the other; each has those before."""
MORE_TURNS = 2
"""Try that is repeated with nearly twice as many turns where a mirror turns fast; those after it take them too."""
FIRST = 0.25
"""Part of the largest error that is taken of the first try, whose nodes are few beside the checks. [1]"""
PARTS = 4
"""Parts of the instants, in their order. In each a mirror is checked where it is most oblique, where its normal is
nearest to the zenith, at the lowest suns in the east and in the west, and at one more."""
CHECKS = 5 * PARTS
"""Instants at which each mirror is checked."""
TOLERANCE = 1e-4
"""Largest error at a check that is taken. [1]"""
HOPELESS = 1e-2
"""Error at a check after which no more nodes are tried. [1]"""
STEEP = 0.3
"""Horizontal part of a normal below which a mirror with a vertical first axis turns fast. [1]"""
COMPUTED = NODES[1][0] * NODES[1][1] + CHECKS
"""Directions of the sun at which most mirrors are computed at most; twice as many instants are interpolated."""
_BLOCK = 64
"""Mirrors that are interpolated at once."""


def course(
    scene: Scene, sun: Floats, latitude: float | None, start: int = 0, stop: int | None = None
) -> tuple[Floats, Floats]:
    """Intercept of mirrors start..stop at instants; see `intercepts`.

    Parameters
    ----------
    scene, sun, start, stop
        As of `intercepts`.
    latitude : float or None
        Of the place [rad]; None for directions of the sun that belong to no place: all are then computed. So are
        instants that are few.

    Returns
    -------
    values : ndarray, shape (stop - start, T)
        Intercept, NaN with the sun down. [1]
    error : ndarray, shape (stop - start,)
        Largest error of interpolation at the checks of each mirror, at most `TOLERANCE`, no bound for other instants;
        0 where nothing was interpolated. [1]
    """
    stop = len(scene.centre) if stop is None else stop
    up = np.flatnonzero(sun[:, 2] > 0.0)
    if latitude is None or len(up) < 2 * COMPUTED:
        return intercepts(scene, sun, start, stop), np.zeros(stop - start)
    there = np.ascontiguousarray(sun[up], np.float64)
    tries = [functools.cache(functools.partial(_nodes, counts, latitude, there)) for counts in NODES]
    out, error = np.full((stop - start, len(sun)), np.nan), np.empty(stop - start)
    for first in range(start, stop, _BLOCK):
        block = np.arange(first, min(first + _BLOCK, stop))
        checks, turns = _checked(scene, block, there)
        for turning in (False, True):
            which = np.flatnonzero(turns == turning)
            if len(which):
                values, error[block[which] - start] = _interpolated(
                    scene.some(block[which]), there, tries, checks[which], turning
                )
                out[(block[which] - start)[:, np.newaxis], up] = np.clip(values, 0.0, 1.0)
    return out, error


def _interpolated(
    scene: Scene, sun: Floats, tries: Sequence[Callable[[], Nodes]], checks: NDArray[np.int64], turning: bool
) -> tuple[Floats, Floats]:
    """Values of all mirrors of a scene and the errors that were found; for mirrors that turn fast, or do not."""
    left, rows = np.arange(len(checks)), np.arange(len(checks))[:, np.newaxis]
    known: Floats = np.empty((0, 0, 0, 0))
    values, error = np.empty((len(left), len(sun))), np.zeros(len(left))
    wanted, computed = np.zeros(values.shape, np.bool_), np.empty(0, np.int64)
    wanted[rows, checks] = True
    exact = intercepts(scene, sun, wanted=wanted, out=values)[rows, checks]
    multiple, count = _harmonics(scene) if turning else (1, 1)
    steps = [(nodes, count) for nodes in tries]
    if turning:
        steps[MORE_TURNS + 1 :] = [(nodes, 2 * count - 1) for nodes in tries[MORE_TURNS:]]
    for attempt, (nodes, count) in enumerate(steps):
        turns, terms = _fourier(count, multiple)
        where, weights_s, weights_h = nodes()
        some, shape = scene.some(left), (len(left), len(weights_s), len(weights_h))
        at: Floats = np.zeros((count, *shape))
        new: NDArray[np.bool_] = np.ones(shape, np.bool_)
        if len(known) == count:
            every = [(shape[n] - 1) // (known.shape[n + 1] - 1) for n in (1, 2)]
            at[:, :, :: every[0], :: every[1]] = known
            new[:, :: every[0], :: every[1]] = False
        new = new.reshape(len(left), -1)
        for k in range(count):
            held = some._replace(tracking=ROLLED) if turning else some
            intercepts(held, where, wanted=new, out=at[k].reshape(len(left), -1), roll=float(turns[k]))
        made, aims, found = _transformed(terms, at), _aims(some), np.empty((len(left), CHECKS))
        for i, one in enumerate(checks[left]):
            each = np.take(weights_s, one, axis=1), np.take(weights_h, one, axis=1)
            _interpolate(made[i : i + 1], *each, aims[i : i + 1], sun[one], multiple, found[i : i + 1])
        off = np.abs(found - exact[left]).max(axis=1)
        taken = off <= TOLERANCE * (1.0 if attempt else FIRST)
        found = np.empty((np.count_nonzero(taken), len(sun)))
        _interpolate(made[taken], weights_s, weights_h, aims[taken], sun, multiple, found)
        values[left[taken]], error[left[taken]] = found, off[taken]
        hopeless = ~(off <= HOPELESS) if attempt else np.zeros(len(left), np.bool_)
        computed = np.append(computed, left[hopeless])
        missed = ~taken & ~hopeless
        left, known = left[missed], at[:, missed]
        if not len(left):
            break
    computed = np.append(computed, left)
    if len(computed):
        values[computed] = intercepts(scene.some(computed), sun)
    return values, error


def _harmonics(scene: Scene) -> tuple[int, int]:
    """Least multiple of a turn that the intercept depends on, and the number of turns to compute at.

    A mirror looks the same after a turn by half, a square one by a quarter; none with a fixed pointing error or a map.
    """
    if np.any(scene.turn) or scene.slopes.size:
        return 1, 9
    errors, facets = scene.errors, scene.facets
    square = np.all(scene.sides[:, 0] == scene.sides[:, 1]) and facets.columns == facets.rows
    return (4, 3) if square and errors.slope_u == errors.slope_v else (2, 5)


def _fourier(count: int, multiple: int) -> tuple[Floats, Floats]:
    """Turns to compute at [rad], and the terms of Fourier from the values there, shape (terms, turns)."""
    turns = 2.0 * math.pi * np.arange(count) / (count * multiple)
    terms = np.ones((count, count)) / count
    for k in range(1, count):
        phase = multiple * ((k + 1) // 2) * turns
        terms[k] = 2.0 / count * (np.cos(phase) if k % 2 else np.sin(phase))
    return turns, terms


def _transformed(terms: Floats, at: Floats) -> Floats:
    """Terms of Fourier at the nodes, shape (mirrors, terms, nodes): summed in one order, of any number of mirrors."""
    return np.ascontiguousarray(np.einsum("kt,tmsh->mksh", terms, at)).reshape(at.shape[1], len(terms), -1)


def _aims(scene: Scene) -> Floats:
    """Directions from the mirrors to their targets, shape (N, 3)."""
    aims = scene.target - scene.centre
    return aims / np.sqrt(np.sum(aims**2, axis=1))[:, np.newaxis]


def _nodes(counts: Sequence[int], latitude: float, sun: Floats) -> Nodes:
    """Directions of the sun at the nodes; weights of both kinds of nodes at each instant, shapes (nodes, T)."""
    sine, share = _place(sun, latitude)
    (nodes_s, weights_s), (nodes_h, weights_h) = _chebyshev(sine, counts[0]), _chebyshev(share, counts[1])
    grid_s, grid_h = (each.ravel() for each in np.meshgrid(nodes_s, nodes_h, indexing="ij"))
    return _vectors(grid_s, grid_h, latitude), weights_s, weights_h


def _checked(scene: Scene, block: NDArray[np.int64], sun: Floats) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Instants at which each mirror is checked, and the mirrors that turn fast."""
    may_turn = scene.tracking == AZIMUTH_ELEVATION and not len(scene.mounts)  # their errors turn normals by the frame
    checks, turns = np.empty((len(block), 3, PARTS), np.int64), np.zeros(len(block), np.bool_)
    _check(_aims(scene.some(block)), sun, STEEP**2 if may_turn else -1.0, checks, turns)
    lowest = np.broadcast_to(_lowest(sun), (len(block), 2 * PARTS))
    return np.concatenate((checks.reshape(len(block), -1), lowest), axis=1), turns


def _lowest(sun: Floats) -> NDArray[np.int64]:
    """Instants of the lowest sun in the east and in the west, in each part: there most errors are largest."""
    found = []
    for part in np.array_split(np.arange(len(sun)), PARTS):
        for side in (sun[part, 0] > 0.0, sun[part, 0] <= 0.0):
            some = part[side] if np.any(side) else part
            found.append(some[np.argmin(sun[some, 2])])
    return np.array(found, np.int64)


@kernel
def _check(aims, sun, steep, checks, turns):
    """Write the instants of the checks of each mirror, and whether its normal comes as near the zenith as `steep`."""
    count = sun.shape[0]
    for i in range(aims.shape[0]):
        for part in range(PARTS):
            first, last = part * count // PARTS, (part + 1) * count // PARTS
            oblique, steepest, least, lowest = first, first, math.inf, math.inf
            for t in range(first, last):
                x, y, z = sun[t, 0] + aims[i, 0], sun[t, 1] + aims[i, 1], sun[t, 2] + aims[i, 2]
                square, level = x * x + y * y + z * z, x * x + y * y
                if square < least:
                    least, oblique = square, t
                if level < lowest * square:
                    lowest, steepest = level / square, t
            checks[i, 0, part], checks[i, 1, part], checks[i, 2, part] = oblique, steepest, (first + last) // 2
            turns[i] = turns[i] or lowest < steep


def _place(sun: Floats, latitude: float) -> tuple[Floats, Floats]:
    """Sine of the declination, and hour angle over that of sunset."""
    sine = sun[:, 1] * math.cos(latitude) + sun[:, 2] * math.sin(latitude)
    hour = np.arctan2(-sun[:, 0], sun[:, 2] * math.cos(latitude) - sun[:, 1] * math.sin(latitude))
    return sine, hour / _sunset(sine, latitude)


def _sunset(sine: Floats, latitude: float) -> Floats:
    """Hour angle of sunset, half a turn where there is none. [rad]"""
    cosine = -math.sin(latitude) * sine / np.maximum(math.cos(latitude) * np.sqrt(1.0 - sine**2), 1e-12)
    return np.maximum(np.arccos(np.clip(cosine, -1.0, 1.0)), 1e-3)


def _vectors(sine: Floats, share: Floats, latitude: float) -> Floats:
    """Unit vectors to the sun; those that rounding brings below the horizon are brought back."""
    cosine, hour = np.sqrt(1.0 - sine**2), share * _sunset(sine, latitude)
    meridian = cosine * np.cos(hour)
    north = math.cos(latitude) * sine - math.sin(latitude) * meridian
    upward = np.maximum(math.sin(latitude) * sine + math.cos(latitude) * meridian, 1e-9)
    return np.stack((-cosine * np.sin(hour), north, upward), axis=1)


def _chebyshev(values: Floats, count: int) -> tuple[Floats, Floats]:
    """Chebyshev nodes from the least to the largest value, and the weight of each at each value, shape (count, T)."""
    middle, half = (values.max() + values.min()) / 2, max((values.max() - values.min()) / 2, 1e-9)
    order, ends = np.arange(count), np.where(np.arange(count) % (count - 1), 1.0, 0.5)
    angle = math.pi * order / (count - 1)
    terms = ends[:, np.newaxis] * np.cos(order[:, np.newaxis] * angle) * ends * 2.0 / (count - 1)
    along = np.clip((values - middle) / half, -1.0, 1.0)
    weights, now, older = np.zeros((count, len(values))), np.ones(len(values)), along
    for n in range(count):
        weights += terms[n][:, np.newaxis] * now
        now, older = 2.0 * along * now - older if n else along, now
    return middle + half * np.cos(angle), weights


@kernel
def _interpolate(at_nodes, weights_s, weights_h, aims, sun, multiple, values):
    """Write the values of each mirror at each instant from terms of Fourier at the nodes, in lanes of instants."""
    terms, hours = at_nodes.shape[1], weights_h.shape[0]
    part, total, basis = np.zeros(PACKET), np.zeros(PACKET), np.ones((terms, PACKET))
    cosine, sine = np.zeros(PACKET), np.zeros(PACKET)
    for i in range(values.shape[0]):
        aim = (aims[i, 0], aims[i, 1], aims[i, 2])
        for start in range(0, values.shape[1], PACKET):
            lanes = min(PACKET, values.shape[1] - start)
            for k in range(lanes):
                total[k] = 0.0
            if terms > 1:
                _turn(aim, sun, start, lanes, cosine, sine)
                for _ in range(multiple // 2):  # 1, 2 or 4
                    for k in range(lanes):
                        east, north = cosine[k], sine[k]
                        cosine[k], sine[k] = east * east - north * north, 2.0 * east * north
                for n in range(1, terms, 2):
                    for k in range(lanes):
                        east, north = (basis[n - 2, k], basis[n - 1, k]) if n > 1 else (1.0, 0.0)
                        basis[n, k] = east * cosine[k] - north * sine[k]
                        basis[n + 1, k] = east * sine[k] + north * cosine[k]
            for n in range(terms):
                for s in range(weights_s.shape[0]):
                    for k in range(lanes):
                        part[k] = 0.0
                    for h in range(hours):
                        value = at_nodes[i, n, s * hours + h]
                        for k in range(lanes):
                            part[k] += weights_h[h, start + k] * value
                    for k in range(lanes):
                        total[k] += basis[n, k] * weights_s[s, start + k] * part[k]
            for k in range(lanes):
                values[i, start + k] = total[k]


@inline
def _turn(aim, sun, start, lanes, cosine, sine):
    """Write cosine and sine of the turn of a mirror with a vertical first axis, from the axes of `ROLLED`.

    These are the directions of aim x sun and of aim - sun; their lengths are half and all of |aim - sun| times
    |aim + sun| and 1.
    """
    for k in range(lanes):
        x, y, z = sun[start + k, 0], sun[start + k, 1], sun[start + k, 2]
        a, b, c = aim[0] - x, aim[1] - y, aim[2] - z
        east, north, up = aim[0] + x, aim[1] + y, aim[2] + z
        level, along = math.sqrt(east * east + north * north), math.sqrt(east * east + north * north + up * up)
        steep, apart = level < 1e-15, math.sqrt(a * a + b * b + c * c)
        u, v = 1.0 if steep else -north / level, 0.0 if steep else east / level
        same = apart < 1e-15
        cosine[k] = (
            1.0 if same else 2.0 * (u * (aim[1] * z - aim[2] * y) + v * (aim[2] * x - aim[0] * z)) / (apart * along)
        )
        sine[k] = 0.0 if same else (u * a + v * b) / apart

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

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION
from heliosweep.kernels.intercept.efficiency import Scene, intercepts
from heliosweep.kernels.intercept.expansion import aims_of, chebyshev_suns, fourier, multiples_of, turn_of
from heliosweep.kernels.intercept.field_table import FieldTable, field_tables, from_table
from heliosweep.kernels.intercept.mirror import ROLLED
from heliosweep.kernels.vectors import PACKET

Nodes = tuple[Floats, Floats, Floats]

NODES = ((3, 7), (5, 13), (9, 13), (17, 25))
"""Nodes in the sine of the declination and in the hour angle, of one try after the other; each has those before."""
TURNS = {1: 9, 2: 5, 4: 3}
"""Turns at which a mirror that turns fast is computed, by `expansion.multiples_of`."""
MORE_TURNS = 2
"""Try that is repeated with nearly twice as many turns where a mirror turns fast; those after it take them too."""
FIRST, TAKEN = 0.25, 0.75
"""Parts of the largest error that are taken of the first try, whose nodes are few beside the checks, and of a field's
table. [1]"""
PARTS = 4
"""Parts of the instants, in their order. In each a mirror is checked where it is most oblique, where its normal is
nearest to the zenith, at the lowest suns in the east and in the west, and at one more."""
CHECKS = 5 * PARTS
"""Instants at which each mirror is checked."""
TOLERANCE = 1e-4
"""Largest error at a check that is taken. [1]"""
HOPELESS = 1e-2
"""Error at a check after which no more nodes are tried. [1]"""
SAMPLE, FEW = 32, 0.1
"""Mirrors that a table is tried on, evenly spread over the field, and the part of them that may miss it. [1]"""
ALONE = 4
"""Mirrors that tell what the others take without a table."""
SAMPLED, STRIDE = 0.05, 97
"""Intercepts that are computed for that beside the checks, as a part of those for the table [1]; and by how many
instants those of one mirror are after those of the one before."""
STEEP = 0.3
"""Horizontal part of a normal below which a mirror with a vertical first axis turns fast. [1]"""
COMPUTED = NODES[1][0] * NODES[1][1] + CHECKS
"""Directions of the sun at which most mirrors are computed at most; twice as many instants are interpolated."""
_BLOCK = 64
"""Mirrors that are interpolated at once."""


def course(scene: Scene, sun: Floats, latitude: float | None, table: FieldTable | None = None) -> tuple[Floats, Floats]:
    """Intercept of all mirrors at instants; see `intercepts`.

    Parameters
    ----------
    scene, sun
        As of `intercepts`.
    latitude : float or None
        Of the place [rad]; None for directions of the sun that belong to no place: all are then computed. So are
        instants that are few.
    table : FieldTable, optional
        Of the field that the mirrors are of, and for these instants. It replaces what is said above but for mirrors
        that it misses.

    Returns
    -------
    values : ndarray, shape (N, T)
        Intercept, NaN with the sun down. [1]
    error : ndarray, shape (N,)
        Largest error of interpolation at the checks of each mirror, at most `TOLERANCE`, no bound for other instants;
        0 where nothing was interpolated. [1]
    """
    count = len(scene.centre)
    up = np.flatnonzero(sun[:, 2] > 0.0)
    place = None if len(up) < 2 * COMPUTED else latitude
    if place is None and (table is None or not len(up)):
        return intercepts(scene, sun), np.zeros(count)
    there = np.ascontiguousarray(sun[up], np.float64)
    tries = []
    if place is not None:
        tries = [functools.cache(functools.partial(chebyshev_suns, counts, place, there)) for counts in NODES]
    out, error = np.full((count, len(sun)), np.nan), np.zeros(count)
    for first in range(0, count, _BLOCK):
        left = np.arange(first, min(first + _BLOCK, count))
        if table is not None:
            values, error[left], missed = _looked_up(table, scene.some(left), there)
            out[left[:, np.newaxis], up] = values
            left = left[missed]
        if place is None:
            out[left] = intercepts(scene.some(left), sun)
            continue
        checks, turns = _checked(scene, left, there, PARTS)
        multiples = np.where(turns, multiples_of(scene.some(left)), 0)
        for multiple in np.unique(multiples):  # what turns to compute at must not depend on the mirrors beside
            which = left[multiples == multiple]
            values, error[which] = _interpolated(
                scene.some(which), there, tries, checks[multiples == multiple], int(multiple)
            )
            out[which[:, np.newaxis], up] = np.clip(values, 0.0, 1.0)
    return out, error


def table_of(scene: Scene, sun: Floats, latitude: float | None) -> FieldTable | None:
    """Table for all mirrors of a field at instants, the first that is right; None where none is, or none pays.

    Some mirrors tell. Few of them may miss it by their checks, and none that does not may miss it at other instants of
    a low sun, the more of these the larger a table is. Tables must take less than the mirrors do on their own: where
    the first fails, that may be much, and some mirrors tell it too.
    """
    there = np.ascontiguousarray(sun[sun[:, 2] > 0.0], np.float64)
    alone, spent = min(len(there), COMPUTED), 0
    some = _spread(scene, SAMPLE)
    low = np.argsort(there[:, 2], kind="stable")[: 1 + len(there) // 4]
    for work, made in field_tables(scene, there) if len(there) else ():
        if spent:
            found = course(_spread(scene, ALONE), sun, latitude)[1] > 0.0
            alone = int(np.where(found, COMPUTED, len(there)).mean())
        spent += work
        if spent > len(scene.centre) * (alone - CHECKS // PARTS):
            return None
        table = made()
        values, _, missed = _looked_up(table, some, there)
        each = np.arange(math.ceil(SAMPLED * work / SAMPLE))
        at = low[(each * len(low) // len(each) + STRIDE * np.arange(len(missed))[:, np.newaxis]) % len(low)]
        off = np.abs(np.take_along_axis(values, at, axis=1) - _exact(some, there, at)).max(axis=1)
        if np.count_nonzero(missed) <= FEW * len(missed) and np.all(missed | (off <= TOLERANCE)):
            return table
    return None


def _spread(scene: Scene, count: int) -> Scene:
    """So many of the mirrors, evenly spread over a field."""
    return scene.some(np.unique(np.linspace(0, len(scene.centre) - 1, count).astype(np.int64)))


def _looked_up(table: FieldTable, scene: Scene, sun: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Values of all mirrors of a scene from the table of their field, the errors that were found, and who misses.

    One part of the instants has checks enough: the mirrors of a field check its table together.
    """
    values, checks = from_table(table, scene, sun), _checked(scene, np.arange(len(scene.centre)), sun, 1)[0]
    off = np.abs(np.take_along_axis(values, checks, axis=1) - _exact(scene, sun, checks)).max(axis=1)
    missed = ~(off <= TAKEN * TOLERANCE)
    return values, np.where(missed, 0.0, off), missed


def _exact(scene: Scene, sun: Floats, at: NDArray[np.int64]) -> Floats:
    """Intercept of all mirrors of a scene, each computed at its own instants, shape (N, instants)."""
    wanted, out = np.zeros((len(at), len(sun)), np.bool_), np.empty((len(at), len(sun)))
    np.put_along_axis(wanted, at, True, axis=1)
    return np.take_along_axis(intercepts(scene, sun, wanted=wanted, out=out), at, axis=1)


def _interpolated(
    scene: Scene, sun: Floats, tries: Sequence[Callable[[], Nodes]], checks: NDArray[np.int64], turning: int
) -> tuple[Floats, Floats]:
    """Values of all mirrors of a scene and the errors that were found.

    `turning` is the least multiple of a turn that the intercept of mirrors that turn fast depends on; of others 0.
    """
    left, computed, exact = np.arange(len(checks)), np.empty(0, np.int64), _exact(scene, sun, checks)
    known: Floats = np.empty((0, 0, 0, 0))
    values, error = np.empty((len(left), len(sun))), np.zeros(len(left))
    multiple = turning or 1
    count = TURNS[multiple] if turning else 1
    steps = [(nodes, count) for nodes in tries]
    if turning:
        steps[MORE_TURNS + 1 :] = [(nodes, 2 * count - 1) for nodes in tries[MORE_TURNS:]]
    for attempt, (nodes, count) in enumerate(steps):
        where, weights_s, weights_h = nodes()
        if count * len(where) > len(sun):  # no fewer to compute
            break
        turns, terms = fourier(count, multiple)
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
        made, aims, found = _transformed(terms, at), aims_of(some), np.empty((len(left), CHECKS))
        for i, one in enumerate(checks[left]):
            each = np.take(weights_s, one, axis=1), np.take(weights_h, one, axis=1)
            _interpolate(made[i : i + 1], *each, aims[i : i + 1], sun[one].T, multiple, found[i : i + 1])
        off = np.abs(found - exact[left]).max(axis=1)
        taken = off <= TOLERANCE * (1.0 if attempt else FIRST)
        found = np.empty((np.count_nonzero(taken), len(sun)))
        _interpolate(made[taken], weights_s, weights_h, aims[taken], sun.T, multiple, found)
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


def _transformed(terms: Floats, at: Floats) -> Floats:
    """Terms of Fourier at the nodes, shape (mirrors, terms, nodes): summed in one order, of any number of mirrors."""
    return np.ascontiguousarray(np.einsum("kt,tmsh->mksh", terms, at)).reshape(at.shape[1], len(terms), -1)


def _checked(
    scene: Scene, block: NDArray[np.int64], sun: Floats, parts: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Instants at which each mirror is checked, and the mirrors that turn fast."""
    may_turn = scene.tracking == AZIMUTH_ELEVATION and not len(scene.mounts)  # their errors turn normals by the frame
    checks, turns = np.empty((len(block), 3, parts), np.int64), np.zeros(len(block), np.bool_)
    _check(aims_of(scene.some(block)), sun, STEEP**2 if may_turn else -1.0, checks, turns)
    lowest = np.broadcast_to(_lowest(sun, parts), (len(block), 2 * parts))
    return np.concatenate((checks.reshape(len(block), 3 * parts), lowest), axis=1), turns


def _lowest(sun: Floats, parts: int) -> NDArray[np.int64]:
    """Instants of the lowest sun in the east and in the west, in each part: there most errors are largest."""
    found = []
    for part in np.array_split(np.arange(len(sun)), parts):
        for side in (sun[part, 0] > 0.0, sun[part, 0] <= 0.0):
            some = part[side] if np.any(side) else part
            found.append(some[np.argmin(sun[some, 2])])
    return np.array(found, np.int64)


@kernel
def _check(aims, sun, steep, checks, turns):
    """Write the instants of the checks of each mirror, and whether its normal comes as near the zenith as `steep`."""
    count, parts = sun.shape[0], checks.shape[2]
    for i in range(aims.shape[0]):
        for part in range(parts):
            first, last = part * count // parts, (part + 1) * count // parts
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
                turn_of(aim, sun, start, lanes, cosine, sine)
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

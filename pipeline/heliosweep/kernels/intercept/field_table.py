"""Intercept of all mirrors of a field from one table, where they differ only in where they stand.

The intercept of equal mirrors is one smooth function of their place, of the direction of the sun about that of the
target, and of the turn of their axes from those of spinning-elevation; on an upright cylinder the azimuth of the place
is none of it. The table has it at Chebyshev nodes of the place, as Chebyshev terms of tan(theta / 4), theta the angle
between sun and target, and as terms of Fourier of the sun's angle phi about the target and of the turn. In the map of
the sky by tan(theta / 4) and phi, the stereographic one of the normal, it is smooth at the target too. A mirror adds
its nodes once, and then at every instant the few hundred terms that make a difference.
"""

import functools
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION
from heliosweep.kernels.intercept.efficiency import Scene, intercepts
from heliosweep.kernels.intercept.expansion import aims_of, chebyshev, chebyshev_terms, fourier, multiples_of, turn_of
from heliosweep.kernels.intercept.mirror import ROLLED
from heliosweep.kernels.intercept.receivers import CYLINDER
from heliosweep.kernels.vectors import PACKET, aligned

Free = tuple[int, int, float, float]


class Size(NamedTuple):
    """Size of a table."""

    near: int
    """Nodes in tan(theta / 4)."""
    around: int
    """Multiples of phi, the least of them 0."""
    turns: int
    """Multiples of four turns of the mirror, beside 0."""
    places: float
    """Nodes of places, beside four, in what changes the intercept much: a distance e times as far, a place as much
    higher as the nearest mirror is far away, an aim by half the receiver."""


TOGETHER = 4
"""Terms that are added at a time; rows have a multiple of them, and so has `Size.near`."""
SIZES = (Size(12, 16, 2, 4.0), Size(16, 20, 3, 6.0), Size(20, 28, 5, 8.0))
"""Sizes of tables, of one try after the other."""
LEFT_OUT = 5e-6
"""Root of the sum of squares of the terms that are left out. [1]"""
SAME = 1e-9
"""Part of their size by which numbers may differ that count as the same. [1]"""


class FieldTable(NamedTuple):
    """Intercept of the mirrors of a field."""

    terms: Floats
    """Terms at each node of the places, shape (nodes, terms): row after row, in each those of tan(theta / 4)."""
    rows: Integers
    """Term of the turn, term of phi, and number of the first term, of each row; and of one more, the end."""
    free: tuple[Free, ...]
    """Column of `_places` in which mirrors differ, number of nodes, and least and largest value, of each such."""
    size: tuple[int, int, int]
    """Terms of tan(theta / 4), phi and the turn."""
    lowest: float
    """Elevation below which there is no sun. [rad]"""
    multiple: int
    """Least multiple of a turn that the intercept depends on."""


def field_tables(scene: Scene, sun: Floats) -> Iterator[tuple[int, Callable[[], FieldTable]]]:
    """Tables of the mirrors of a field at instants with the sun up, one more exact than the other.

    Parameters
    ----------
    scene : Scene
        All mirrors of the field: the tables of some of them are others.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up. [1]

    Yields
    ------
    int, callable
        Intercepts to compute for a table, and what makes it. None where mirrors differ in more than their place.
    """
    places = _places(scene)
    if places is None:
        return
    least, last = places.min(axis=0), places.max(axis=0)
    columns = np.flatnonzero(last - least > SAME * np.maximum(np.abs(least), np.abs(last))).tolist()
    units = 1.0, math.exp(least[0]), scene.receiver.half_width, scene.receiver.half_height
    multiple = int(multiples_of(scene).min()) if scene.tracking == AZIMUTH_ELEVATION else 0
    for each in SIZES:
        free = tuple(
            (n, 4 + math.ceil(each.places * (last[n] - least[n]) / units[n]), float(least[n]), float(last[n]))
            for n in columns
        )
        nodes = places[:1]
        for column, count, *ends in free:
            nodes = np.tile(nodes, (count, 1))
            nodes[:, column] = np.repeat(chebyshev(np.empty(0), count, ends)[0], len(nodes) // count)
        size, moved = _terms(each, multiple), _moved(scene, nodes)
        rise = math.asin(aims_of(moved)[:, 2].min())
        work = len(nodes) * size[0] * (size[1] + 1) * size[2] // 2
        if not rise > 0.0:  # `_reach` needs targets above the mirrors
            return
        lowest = min(math.asin(sun[:, 2].min()), rise / 2)
        yield work, functools.partial(_made, moved, free, size, lowest, multiple)


def _made(scene: Scene, free: tuple[Free, ...], size: tuple[int, int, int], lowest: float, multiple: int) -> FieldTable:
    """Table from mirrors at the nodes of the places."""
    values = _computed(scene, size, lowest, multiple)
    found = np.einsum("kx,dnax->dnak", chebyshev_terms(size[0]), values)  # one sum of all takes 100 times as long
    found = np.einsum("pa,dnak->dnpk", fourier(size[1], 1)[1], found)
    found = np.einsum("tn,dnpk->dtpk", fourier(size[2], multiple)[1], found)
    return FieldTable(*_pruned(found), free, size, lowest, multiple)


def _terms(size: Size, multiple: int) -> tuple[int, int, int]:
    """Numbers of terms."""
    return size.near, 2 * size.around - 1, 1 + 8 // multiple * size.turns if multiple else 1


def _places(scene: Scene) -> Floats | None:
    """Where mirrors stand and aim, as the intercept depends on it; None where they differ in more than that.

    Shape (N, 4): logarithm of the horizontal distance, height, and the aim's distance towards the mirror and its
    height, from the centre of the receiver.
    """
    receiver = scene.receiver
    about, aim = scene.centre - np.array(receiver.centre), scene.target - np.array(receiver.centre)
    far = np.hypot(about[:, 0], about[:, 1])
    fixed = np.any(scene.turn) or len(scene.mounts) or scene.slopes.size
    if (
        receiver.kind != CYLINDER
        or fixed
        or not (far.min() > 0.0 and _same(scene.sides[:, 0]) and _same(scene.sides[:, 1]))
    ):
        return None
    slant = np.sqrt(np.sum((scene.target - scene.centre) ** 2, axis=1))
    if not all(_same(bent) or _same(bent * slant) for bent in (scene.curve, scene.cant)):
        return None
    ahead = (aim[:, 0] * about[:, 0] + aim[:, 1] * about[:, 1]) / far
    aside = (aim[:, 0] * about[:, 1] - aim[:, 1] * about[:, 0]) / far
    if np.abs(aside).max() > SAME * far.max():
        return None
    return np.stack((np.log(far), about[:, 2], ahead, aim[:, 2]), axis=1)


def _same(values: Floats) -> bool:
    return bool(np.ptp(values) <= SAME * np.abs(values).max())


def _moved(scene: Scene, places: Floats) -> Scene:
    """Mirrors as those of a scene at other places, east of the receiver."""
    far, height, ahead, aim = places.T
    still = np.zeros(len(places))
    centre = np.stack((np.exp(far), still, height), axis=1) + np.array(scene.receiver.centre)
    target = np.stack((ahead, still, aim), axis=1) + np.array(scene.receiver.centre)
    first = np.sqrt(np.sum((scene.target[0] - scene.centre[0]) ** 2))
    slant = np.sqrt(np.sum((target - centre) ** 2, axis=1))
    curve, cant = (bent[0] + still if _same(bent) else bent[0] * first / slant for bent in (scene.curve, scene.cant))
    sides, turn = np.repeat(scene.sides[:1], len(places), axis=0), np.zeros((len(places), 2))
    return scene._replace(centre=centre, target=target, sides=sides, curve=curve, cant=cant, turn=turn, tracking=ROLLED)


def _computed(scene: Scene, size: tuple[int, int, int], lowest: float, multiple: int) -> Floats:
    """Intercept at the nodes, shape (places, turns, phi, theta).

    Mirrors are symmetric in the vertical plane of the target: half of the angles tell of all.
    """
    aims, (near, around, turns) = aims_of(scene), size
    phi, rolls = fourier(around, 1)[0], fourier(turns, multiple)[0]
    node = (1.0 + np.cos(math.pi * (np.arange(near) + 0.5) / near)) / 2
    out = np.empty((len(aims), turns, around, near))
    for i, (aim, (middle, more)) in enumerate(zip(aims, _reach(aims, lowest), strict=True)):
        theta = 4.0 * np.arctan(np.outer(middle + more * np.cos(phi), node))[:, :, np.newaxis]
        e1 = np.array([-aim[1], aim[0], 0.0]) / math.hypot(aim[0], aim[1])
        about = np.outer(np.sin(phi), e1) + np.outer(np.cos(phi), np.cross(aim, e1))
        suns = np.cos(theta) * aim + np.sin(theta) * about[:, np.newaxis]
        for turn in range(turns // 2 + 1):
            half = around if turn else around // 2 + 1
            there, wanted = suns[:half].reshape(-1, 3), np.ones((1, half * near), np.bool_)
            found = intercepts(scene, there, i, i + 1, wanted=wanted, roll=float(rolls[turn])).reshape(half, near)
            out[i, turn, :half] = out[i, -turn, -np.arange(half)] = found
    return out


def _reach(aims: Floats, lowest: float) -> Floats:
    """Largest tan(theta / 4) of nodes in the direction phi, a + b cos(phi): a and b of each target, shape (N, 2).

    No sun is farther: beyond the nodes, terms grow without bounds. Over the target the sun can be as far. Below it
    there is more room, since b would bend the map, and the horizon beside a low target is as far as over it: more than
    either of both, for the larger of them would be no smooth function of the place.
    """
    rise = np.arcsin(aims[:, 2])
    over, under = np.tan((math.pi - rise - lowest) / 4), np.tan((rise - lowest) / 4)
    under = np.hypot(np.sqrt(over * under), over * np.exp(-rise - lowest))
    return np.stack((over + under, over - under), axis=1) / 2


def _pruned(found: Floats) -> tuple[Floats, Integers]:
    """Terms that make a difference, and their rows, of all: shape (places, turns, phi, theta)."""
    size = np.abs(found).max(axis=0)
    ordered = np.sort(size, axis=None)
    least = ordered[min(int(np.searchsorted(np.cumsum(ordered**2), LEFT_OUT**2)), ordered.size - 1)]
    count = np.where(size >= least, np.arange(1, size.shape[-1] + 1), 0).max(axis=-1)
    rows, terms, first = [], [], 0
    for turn, phi in zip(*np.nonzero(count), strict=True):
        last = -(-int(count[turn, phi]) // TOGETHER) * TOGETHER
        rows.append((turn, phi, first))
        terms.append(found[:, turn, phi, :last])
        first += last
    return np.ascontiguousarray(np.concatenate(terms, axis=1)), np.array([*rows, (0, 0, first)], np.int64)


def from_table(table: FieldTable, scene: Scene, sun: Floats) -> Floats:
    """Intercept of some mirrors of the table's field at instants with the sun up, shape (N, T)."""
    places, aims = _places(scene), aims_of(scene)
    assert places is not None
    weights = np.ones((len(places), 1))
    for column, count, *ends in table.free:
        more = chebyshev(places[:, column], count, ends)[1].T
        weights = (more[:, :, np.newaxis] * weights[:, np.newaxis]).reshape(len(places), -1)
    lanes = np.repeat(sun[:1].T, -(-len(sun) // PACKET) * PACKET, axis=1)
    lanes[:, : len(sun)] = sun.T
    out = np.empty((len(places), len(sun)))
    reach = _reach(aims, table.lowest)
    _evaluate(weights, table.terms, table.rows, table.multiple, *table.size, aims, reach, lanes, out)
    return out


@kernel
def _evaluate(weights, terms, rows, multiple, count, angles, rolls, aims, reach, sun, out):
    """Write the values of each mirror, in lanes of instants."""
    mine = np.empty(terms.shape[1])
    near, around, turns = _basis(count), _basis(angles), _basis(rolls)
    part, total, cosine, sine = aligned(PACKET), aligned(PACKET), aligned(PACKET), aligned(PACKET)
    for i in range(aims.shape[0]):
        mine[:] = 0.0
        for d in range(terms.shape[0]):
            weight = weights[i, d]
            for n in range(terms.shape[1]):
                mine[n] += weight * terms[d, n]
        aim = (aims[i, 0], aims[i, 1], aims[i, 2])
        for start in range(0, sun.shape[1], PACKET):
            _about(aim, reach[i, 0], reach[i, 1], sun, start, near, cosine, sine)
            _multiples(cosine, sine, around)
            if rolls > 1:
                turn_of(aim, sun, start, PACKET, cosine, sine)
                for _ in range(multiple // 2):  # 2 or 4
                    for k in range(PACKET):
                        c, s = cosine[k], sine[k]
                        cosine[k], sine[k] = c * c - s * s, 2.0 * c * s
                _multiples(cosine, sine, turns)
            for k in range(PACKET):
                total[k] = 0.0
            for row in range(rows.shape[0] - 1):
                turn, phi, first = rows[row, 0], rows[row, 1], rows[row, 2]
                for k in range(PACKET):
                    part[k] = 0.0
                for n in range(first, rows[row + 1, 2], TOGETHER):
                    m = n - first
                    a, b, c, d = mine[n], mine[n + 1], mine[n + 2], mine[n + 3]
                    for k in range(PACKET):
                        part[k] += (a * near[m, k] + b * near[m + 1, k]) + (c * near[m + 2, k] + d * near[m + 3, k])
                for k in range(PACKET):
                    total[k] += turns[turn, k] * around[phi, k] * part[k]
            for k in range(min(PACKET, out.shape[1] - start)):
                out[i, start + k] = min(1.0, max(0.0, total[k]))


@kernel
def _basis(count):
    """Room for terms of a packet, each 1."""
    room = aligned(count * PACKET).reshape(count, PACKET)
    room[:] = 1.0
    return room


@inline
def _about(aim, middle, more, sun, start, near, cosine, sine):
    """Write the terms of tan(theta / 4), and cosine and sine of phi."""
    level = math.sqrt(aim[0] * aim[0] + aim[1] * aim[1])
    x1, y1 = -aim[1] / level, aim[0] / level
    x2, y2, z2 = -aim[2] * y1, aim[2] * x1, aim[0] * y1 - aim[1] * x1
    for k in range(PACKET):
        x, y, z = sun[0, start + k], sun[1, start + k], sun[2, start + k]
        a, b, c = x - aim[0], y - aim[1], z - aim[2]
        apart = math.sqrt(a * a + b * b + c * c)
        a2, b2, c2 = x + aim[0], y + aim[1], z + aim[2]
        along = math.sqrt(a2 * a2 + b2 * b2 + c2 * c2)
        s, t = a * x1 + b * y1, a * x2 + b * y2 + c * z2
        scale = 1.0 / max(math.sqrt(s * s + t * t), 1e-300)
        cosine[k], sine[k] = t * scale, s * scale
        near[1, k] = 2.0 * apart / ((2.0 + along) * (middle + more * t * scale)) - 1.0
    for n in range(2, near.shape[0]):
        for k in range(PACKET):
            near[n, k] = 2.0 * near[1, k] * near[n - 1, k] - near[n - 2, k]


@inline
def _multiples(cosine, sine, terms):
    """Write cosine and sine of the multiples of an angle, after the 1 of the first row."""
    for k in range(PACKET):
        terms[1, k], terms[2, k] = cosine[k], sine[k]
    for n in range(3, terms.shape[0], 2):
        for k in range(PACKET):
            terms[n, k] = terms[n - 2, k] * cosine[k] - terms[n - 1, k] * sine[k]
            terms[n + 1, k] = terms[n - 2, k] * sine[k] + terms[n - 1, k] * cosine[k]

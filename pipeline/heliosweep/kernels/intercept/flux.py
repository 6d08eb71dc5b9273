"""Flux maps: how much of the light of mirrors meets each cell of a receiver.

Cells lie in columns and rows: over the width and the height of a rectangle, over azimuth and height of a cylinder. As
the node of a mirror sees them, the light in a cell is an integral along its edges: F dphi / 2 pi, as in `outline`. An
edge of two cells is integrated once and counts for both, with opposite signs, so that the cells add up to the integral
along the outline of the receiver. The intercept takes other nodes along that outline; the cells of each mirror are
scaled to it, by a factor that differs from 1 by some 1e-6.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.intercept.efficiency import Rules, Scene, gauss_rules, image_shift, turn_at
from heliosweep.kernels.intercept.expansion import chebyshev_suns
from heliosweep.kernels.intercept.light import LOOKED, PART, RESULT, X, Y, collapse, extent, light_of, look_up, weigh
from heliosweep.kernels.intercept.light import ROWS as PLACES
from heliosweep.kernels.intercept.mirror import axes_of, facet_sides, frame_of, ray_from, spread_of
from heliosweep.kernels.intercept.pointing import TERMS, mount_turn
from heliosweep.kernels.intercept.receivers import LEAST_ERROR, RECTANGLE, apart_of, distance, order_of, window_of
from heliosweep.kernels.intercept.tables import LEAST_HARMONIC, stretched
from heliosweep.kernels.mounts.kinematics import stand_terms
from heliosweep.kernels.vectors import GROUP, dot, mixed, unit, whole

PANEL = 3
"""Nodes in each panel of an edge; a panel is at most as long as the standard deviation of the blur."""


class Room(NamedTuple):
    """Room of one mirror and instant."""

    weights: Floats
    """Weights of the nodes of the tables; see `light.weigh`."""
    series: Floats
    """See `light.Light`."""
    far: Floats
    places: Floats
    cells: Floats
    """Light in each cell, shape (rows, columns)."""
    column: NDArray[np.int64]
    """Column of each strip between two upright lines that a node sees, and the lines about it."""
    lines: Floats
    heights: Floats
    """Heights of the level lines. [m]"""
    ends: Floats
    """Points of the upright lines at no height, along r, e1 and e2. [m]"""
    between: Floats
    """The same of nodes between them, strip by strip, and their movement along e1 and e2 times the weight: rows."""
    steps: Floats
    """Heights of nodes of the upright lines, from level to level, and their weights: rows. [m]"""
    parts: Floats
    """Integrals along the pieces of a line."""


@kernel
def _sweep(
    scene: Scene, rules: Rules, sun: Floats, sent: Floats, intercept: Floats, scaled: bool, nodes: int, out: Floats
) -> None:
    """Add the light on each cell to `out`, shape (rows, columns)."""
    rows, columns = out.shape
    room = Room(
        np.zeros(scene.tables.reach.shape[1]), np.zeros(scene.tables.light.shape[2:]),
        np.zeros(scene.tables.far.shape[2]), np.zeros(PLACES), np.zeros((rows, columns)),
        np.zeros(columns + 2, np.int64), np.zeros(columns + 3), np.zeros(rows + 1), np.zeros((columns + 3, 3)),
        np.ones((5, (columns + 2) * nodes + GROUP)), np.zeros((2, rows * nodes + GROUP)),
        np.zeros(max(columns + 2, rows)),
    )  # fmt: skip
    terms, has_errors = np.empty(TERMS), scene.mounts.shape[0] > 0
    for i in range(sent.shape[0]):
        place = (scene.centre[i, 0], scene.centre[i, 1], scene.centre[i, 2])
        target = unit(mixed(1.0, (scene.target[i, 0], scene.target[i, 1], scene.target[i, 2]), -1.0, place))
        if has_errors:
            stand_terms(scene.mounts[i], 0, terms, 0)
        for t in range(sun.shape[0]):
            if sun[t, 2] > 0.0 and sent[i, t] != 0.0 and intercept[i, t] > 0.0:
                room.cells[:] = 0.0
                to_sun, turn = (sun[t, 0], sun[t, 1], sun[t, 2]), (scene.turn[i, 0], scene.turn[i, 1])
                if has_errors:
                    more = mount_turn(to_sun, target, scene.tracking, terms)
                    turn = (turn[0] + more[0], turn[1] + more[1])
                _mirror(
                    place, target, (scene.sides[i, 0], scene.sides[i, 1]), scene.curve[i], scene.cant[i], turn, to_sun,
                    scene, rules, room,
                )  # fmt: skip
                total = 0.0
                for j in range(rows):
                    for k in range(columns):
                        room.cells[j, k] = max(0.0, room.cells[j, k])
                        total += room.cells[j, k]
                if total > 0.0:
                    factor = sent[i, t] * (intercept[i, t] / total if scaled else 1.0)
                    for j in range(rows):
                        for k in range(columns):
                            out[j, k] += factor * room.cells[j, k]


@inner
def _mirror(place, target, sides, curve, cant, turn, sun, scene, rules, room):
    """Write the light of one mirror and instant to the cells."""
    receiver, tables, facets = scene.receiver, scene.tables, scene.facets
    if not dot(sun, target) > -1.0 + 1e-12:
        return
    frame = frame_of(sun, target, scene.tracking, 0.0)
    window = window_of(place, frame.r, receiver)
    if window[0] >= window[1] or window[2] >= window[3]:
        return
    xx, yy, xy = spread_of(frame, sun, scene.errors)
    small, large, axis_x, axis_y = axes_of(xx, yy, xy)
    small = max(small, LEAST_ERROR * LEAST_ERROR)
    large = max(large, small)
    band = weigh(tables, small, large, room.weights)
    reach, harmonics = extent(tables, band, room.weights, LEAST_HARMONIC / rules.fine**2)
    collapse(tables, band, room.weights, harmonics, room.series, room.far)
    sigma, far = math.sqrt(small), distance(place, receiver)
    light = light_of(room, tables, band, harmonics, reach, sigma)
    along, across, _, _ = stretched(small, large, tables.core)
    axes = (along * axis_x, along * axis_y, -across * axis_y, across * axis_x)
    rows, columns = room.cells.shape
    finest = rules.fine / (far * max(sigma, math.exp(0.5 * tables.logs[0])))
    around = 2.0 * receiver.half_width if receiver.kind == RECTANGLE else 2.0 * math.pi * receiver.half_width
    panels = (math.ceil(finest * around / columns), math.ceil(finest * 2.0 * receiver.half_height / rows))
    for j in range(rows + 1):
        z = receiver.half_height * (2.0 * j / rows - 1.0)
        room.heights[j] = min(max(z, window[2]), window[3])
    nodes = PANEL * panels[1]
    for n in range(rows * nodes):
        j, k = n // nodes, n % nodes
        step = (room.heights[j + 1] - room.heights[j]) / panels[1]
        room.steps[0, n] = room.heights[j] + step * (k // PANEL + 0.5 + 0.5 * rules.mirror[PANEL, 0, k % PANEL])
        room.steps[1, n] = step * rules.mirror[PANEL, 1, k % PANEL]
    width, height = facet_sides(sides, facets)
    # More nodes along half a side, the farther its image moves, in standard deviations of the blur.
    side_u = image_shift(frame, sun, 0.0, 0.0, 0.5 * width, 0.0, 0.0, curve, far) / sigma
    side_v = image_shift(frame, sun, 0.0, 0.0, 0.0, 0.5 * height, 0.0, curve, far) / sigma
    nodes_u, nodes_v = order_of(rules.fine * (2.5 + 1.3 * side_u)), order_of(rules.fine * (2.5 + 1.3 * side_v))
    if scene.slopes.shape[0] > 0:
        nodes_u, nodes_v = scene.slopes.shape[1] // facets.columns, scene.slopes.shape[0] // facets.rows
    for facet in range(facets.columns * facets.rows):
        a0 = (facet % facets.columns - 0.5 * (facets.columns - 1)) * (width + facets.gap)
        b0 = (facet // facets.columns - 0.5 * (facets.rows - 1)) * (height + facets.gap)
        for j in range(nodes_u):
            for k in range(nodes_v):
                a, b = 0.5 * width * rules.mirror[nodes_u, 0, j], 0.5 * height * rules.mirror[nodes_v, 0, k]
                lean = turn_at(turn, scene.slopes, facets, facet, nodes_u, nodes_v, j, k)
                offset, r, e1, e2 = ray_from(frame, sun, lean, a0, b0, a, b, cant, curve)
                weight = rules.mirror[nodes_u, 1, j] * rules.mirror[nodes_v, 1, k] / (facets.columns * facets.rows)
                _point(
                    mixed(1.0, place, 1.0, offset), r, mixed(axes[0], e1, axes[1], e2), mixed(axes[2], e1, axes[3], e2),
                    receiver, window, panels, light, rules, room, weight / (2.0 * math.pi),
                )  # fmt: skip


@inner
def _strips(point, receiver, window, room):
    """Write the upright lines that a point sees, from its left to its right; returns the number of strips between."""
    columns = room.cells.shape[1]
    if receiver.kind == RECTANGLE:
        for k in range(columns + 1):
            x = receiver.half_width * (2.0 * k / columns - 1.0)
            room.lines[k] = min(max(x, window[0]), window[1])
            room.column[k] = k
        return columns
    px, py = point[0] - receiver.centre[0], point[1] - receiver.centre[1]
    far = math.sqrt(px * px + py * py)
    if far <= receiver.half_width:
        return 0
    middle, widest = math.atan2(px, py), math.acos(receiver.half_width / far)
    cell = 2.0 * math.pi / columns
    # Azimuths fall from left to right, seen from outside.
    line, k, strips = middle + widest, math.ceil((middle + widest) / cell) - 1, 0
    room.lines[0] = line
    while True:
        room.column[strips] = k % columns
        strips += 1
        if k * cell <= middle - widest:
            room.lines[strips] = middle - widest
            return strips
        room.lines[strips] = k * cell
        k -= 1


@inner
def _at(line, receiver, point):
    """Place from the point at one of the upright lines, at no height, and movement to the right, each a vector."""
    d = mixed(1.0, receiver.centre, -1.0, point)
    if receiver.kind == RECTANGLE:
        return mixed(1.0, d, line, receiver.across), receiver.across
    sine, cosine = math.sin(line), math.cos(line)
    out = (receiver.half_width * sine, receiver.half_width * cosine, 0.0)
    return mixed(1.0, d, 1.0, out), (receiver.half_width * cosine, -receiver.half_width * sine, 0.0)


@inline
def _view(a, z, b):
    """Gnomonic coordinates of a place from its parts along r, e1, e2 and those of the axis of height. [rad]"""
    along = a[0] + z * b[0]
    return (a[1] + z * b[1]) / along, (a[2] + z * b[2]) / along


@inner
def _point(point, r, e1, e2, receiver, window, panels, light, rules, room, weight):
    """Add the light of one node of a mirror to the cells."""
    strips = _strips(point, receiver, window, room)
    if strips == 0:
        return
    up = (dot(receiver.upward, r), dot(receiver.upward, e1), dot(receiver.upward, e2))
    for i in range(strips + 1):
        d, _ = _at(room.lines[i], receiver, point)
        room.ends[i, 0], room.ends[i, 1], room.ends[i, 2] = dot(d, r), dot(d, e1), dot(d, e2)
    away = light.reach
    left, right = _lit_strips(strips, room, up, away)
    low, high = _lit_rows(left, right, room, up, away, receiver.kind != RECTANGLE)
    nodes = PANEL * panels[0]
    for i in range(left, right):
        step = (room.lines[i + 1] - room.lines[i]) / panels[0]
        for k in range(nodes):
            line = room.lines[i] + step * (k // PANEL + 0.5 + 0.5 * rules.mirror[PANEL, 0, k % PANEL])
            d, onward = _at(line, receiver, point)
            part, n = step * rules.mirror[PANEL, 1, k % PANEL], i * nodes + k
            room.between[0, n], room.between[1, n], room.between[2, n] = dot(d, r), dot(d, e1), dot(d, e2)
            room.between[3, n], room.between[4, n] = part * dot(onward, e1), part * dot(onward, e2)
    for j in range(low, high + 1):
        for first in range(left * nodes, right * nodes, LOOKED):
            count = min(LOOKED, right * nodes - first)
            _on_level(room, first, count, room.heights[j], up)
            _add(room, light, first, count, nodes)
        for i in range(left, right):
            turned, room.parts[i] = weight * room.parts[i], 0.0
            if j > low:
                room.cells[j - 1, room.column[i]] += turned
            if j < high:
                room.cells[j, room.column[i]] -= turned
    nodes = PANEL * panels[1]
    for i in range(left, right + 1):
        for first in range(low * nodes, high * nodes, LOOKED):
            count = min(LOOKED, high * nodes - first)
            _upright(room, first, count, room.ends[i], up)
            _add(room, light, first, count, nodes)
        for j in range(low, high):
            turned, room.parts[j] = weight * room.parts[j], 0.0
            if i > left:
                room.cells[j, room.column[i - 1]] -= turned
            if i < right:
                room.cells[j, room.column[i]] += turned


@inner
def _lit_strips(strips, room, up, away):
    """First strip with light, and the one after the last: beyond, all light is on one side of a line."""
    bottom, top = room.heights[0], room.heights[room.heights.shape[0] - 1]
    left, right = 0, strips
    for i in range(strips + 1):
        ax, ay = _view(room.ends[i], bottom, up)
        bx, by = _view(room.ends[i], top, up)
        apart = apart_of(ax, ay, bx, by)  # positive with the light at its right on the receiver
        if apart > away:
            left = i
        if apart < -away and i < right:
            right = i
    return min(left, right), right


@inner
def _lit_rows(left, right, room, up, away, bent):
    """First row with light, and the one after the last; where level lines are `bent`, with as much room as a chord."""
    rows = room.heights.shape[0] - 1
    low, high = 0, rows
    for j in range(rows + 1):
        above, below = True, True
        for i in range(left, right):
            ax, ay = _view(room.ends[i], room.heights[j], up)
            bx, by = _view(room.ends[i + 1], room.heights[j], up)
            if ax == bx and ay == by:
                continue
            apart = apart_of(ax, ay, bx, by)  # positive with the light below
            free = away + (math.sqrt((bx - ax) ** 2 + (by - ay) ** 2) if bent else 0.0)
            above, below = above and apart < -free, below and apart > free
        if above:
            low = j
        if below and j < high:
            high = j
    return min(low, high), high


@inner
def _on_level(room, first, count, z, up):
    """Write nodes of a level line, to the right, as places that are looked up."""
    places, nodes, first = room.places, room.between, max(first, 0)
    for n in range(whole(count)):
        k = first + n
        along = 1.0 / (nodes[0, k] + z * up[0])
        x, y = along * (nodes[1, k] + z * up[1]), along * (nodes[2, k] + z * up[2])
        places[X + n], places[Y + n], places[PART + n] = x, y, along * (x * nodes[4, k] - y * nodes[3, k])


@inner
def _upright(room, first, count, end, up):
    """Write nodes of an upright line, upwards, as places that are looked up."""
    places, first = room.places, max(first, 0)
    for n in range(whole(count)):
        z = room.steps[0, first + n]
        along = 1.0 / (end[0] + z * up[0])
        x, y = along * (end[1] + z * up[1]), along * (end[2] + z * up[2])
        places[X + n], places[Y + n] = x, y
        places[PART + n] = along * room.steps[1, first + n] * (x * up[2] - y * up[1])


@inner
def _add(room, light, first, count, nodes):
    """Add the integrals of F dphi to those of the pieces of a line, each of so many nodes. [rad]"""
    look_up(light, whole(count))
    for piece in range(first // nodes, (first + count - 1) // nodes + 1):
        start = piece * nodes - first
        for n in range(max(0, start), min(count, start + nodes)):
            room.parts[piece] += room.places[RESULT + n]


def cells(
    scene: Scene, sun: Floats, sent: Floats, intercept: Floats | None, columns: int, rows: int, fine: float = 1.0
) -> Floats:
    """Light on each cell of a receiver, the sum over mirrors and instants.

    Parameters
    ----------
    scene : Scene
        Mirrors and receiver.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up; those at or below the horizon send nothing. [1]
    sent : ndarray, shape (N, T)
        Light that each mirror sends towards the receiver, as a power or an energy.
    intercept : ndarray, shape (N, T), or None
        Part of it that meets the receiver, from `efficiency.intercepts`: the cells of each mirror and instant add up to
        it. None leaves them as they are integrated. [1]
    columns, rows : int
        Cells along the width and the height.
    fine : float
        Factor on the numbers of nodes, up to 3. [1]

    Returns
    -------
    ndarray, shape (rows, columns)
        In the unit of `sent`. Rows from the lowest; columns from left to right as a mirror sees a rectangle, and of a
        cylinder by the azimuth of its surface, clockwise from north.
    """
    rules, receiver = gauss_rules(fine), scene.receiver
    around = 2.0 * math.pi if receiver.kind != RECTANGLE else 2.0
    longest = max(around * receiver.half_width / columns, 2.0 * receiver.half_height / rows)
    near = np.sqrt(np.sum((scene.centre - receiver.centre) ** 2, axis=1)).min(initial=np.inf)
    nodes = PANEL * (math.ceil(fine * longest / (near * math.exp(0.5 * scene.tables.logs[0]))) + 1)
    out, sun = np.zeros((rows, columns)), np.array(sun, np.float64, order="C")
    sent = np.array(sent, np.float64, order="C")
    known = np.ones_like(sent) if intercept is None else np.array(intercept, np.float64, order="C")
    _sweep(scene, rules, sun, sent, known, intercept is not None, nodes, out)
    return out


def sun_nodes(sun: Floats, latitude: float | None, counts: tuple[int, int]) -> tuple[Floats, Floats] | None:
    """Directions of the sun between which those of many instants are interpolated, and the weight of each.

    Parameters
    ----------
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up. [1]
    latitude : float or None
        Of the place [rad]; None for directions that belong to no place.
    counts : (int, int)
        Chebyshev nodes in the sine of the declination and in the hour angle over that of sunset.

    Returns
    -------
    directions, weights : ndarray, shape (K, 3) and (T, K)
        Weights of an instant add up to 1; they are 0 with the sun down. None instead, where instants are so few that
        it is better to take them all.
    """
    up = np.flatnonzero(sun[:, 2] > 0.0)
    if latitude is None or len(up) < 2 * math.prod(counts):
        return None
    directions, first, second = chebyshev_suns(counts, latitude, sun[up])
    weights = np.zeros((len(sun), math.prod(counts)))
    weights[up] = (first.T[:, :, np.newaxis] * second.T[:, np.newaxis]).reshape(len(up), -1)
    return directions, weights

"""Intercept: the part of the light of a heliostat that meets the receiver, of all that leaves the mirror towards it.

About the reflected ray of each point of a mirror the sun shape B and errors N(0, S) spread light, as the density
B * N(0, S) over gnomonic coordinates. The receiver's outline in them bounds what is counted; the intercept is the mean
over Gauss nodes of the mirror, every part of which counts the same. S is that of the mirror's centre. Coordinates are
stretched along its axes, so that the light is nearly round; what it is not, the harmonics of `tables` tell.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.intercept.light import PART, RESULT, X, Y, collapse, extent, light_of, look_up, weigh
from heliosweep.kernels.intercept.light import ROWS as PLACES
from heliosweep.kernels.intercept.mirror import Errors, Facets, axes_of, facet_sides, frame_of, ray_from, spread_of
from heliosweep.kernels.intercept.outline import (
    MOST,
    PLACE,
    WEIGHT,
    Outline,
    empty_outline,
    nearest,
    panels_of,
    within,
)
from heliosweep.kernels.intercept.pointing import TERMS, mount_turn
from heliosweep.kernels.intercept.receivers import (
    LEAST_ERROR,
    Receiver,
    behind,
    distance,
    face,
    order_of,
    outline_of,
    window_of,
)
from heliosweep.kernels.intercept.tables import LEAST_HARMONIC, Tables, stretched, tables
from heliosweep.kernels.mounts.kinematics import stand_terms
from heliosweep.kernels.sunshapes import SunShape
from heliosweep.kernels.vectors import GROUP, PACKET, ROW, dot, mixed, unit, whole

LEAST_COSINE = 0.2
"""Cosine of incidence down to which errors are spread exactly; at grazing incidence by what they are here."""
ERROR = 1e-4
"""Largest error of a computed intercept, of the usual numbers of nodes; most are below 1e-5. [1] On a cylinder it can
be three times as much with slope errors whose axes differ by more than a factor of five."""


_A0, _B0, _A, _B, _TURN_U, _TURN_V = (PLACE + k * ROW for k in range(6))
"""Rows of points of a mirror: centre of the facet, place from there, and turn of the normal."""


class Scene(NamedTuple):
    """Mirrors, a receiver, and what spreads the light between them."""

    centre: Floats
    """Centres of the mirrors: east, north, up, shape (N, 3). [m]"""
    target: Floats
    """Points that they aim at, shape (N, 3). [m]"""
    sides: Floats
    """Width and height of the mirrors, shape (N, 2). [m]"""
    curve: Floats
    """One over twice the focal length of a mirror or facet, 0 for a flat one, shape (N,). [1/m]"""
    cant: Floats
    """One over twice the distance that facets are canted for, 0 for facets in one plane, shape (N,). [1/m]"""
    turn: Floats
    """Fixed pointing errors, shape (N, 2): the normal is n + turn_u u + turn_v v. [rad]"""
    facets: Facets
    """Facets of each mirror."""
    tracking: int
    """`packets.SPINNING_ELEVATION`, `packets.AZIMUTH_ELEVATION`, or `mirror.ROLLED`."""
    errors: Errors
    """Random errors, with the Gaussian part of the sun, from `sun_tables`."""
    receiver: Receiver
    """From `rectangle` or `cylinder`."""
    tables: Tables
    """From `sun_tables`."""
    mounts: Floats = np.empty((0, 6))
    """Errors of the mounts, shape (N, 6), in the order of `kinematics.ERRORS`; (0, 6) without. [rad]"""
    slopes: Floats = np.empty((0, 0, 2))
    """Turns of the normal towards u and v at the Gauss nodes of every mirror, shape (rows, columns, 2), from facet to
    facet; (0, 0, 2) for mirrors without, whose nodes are then as many as they need. [rad]"""

    def some(self, which: NDArray[np.int64]) -> Scene:
        """Scene with some of the mirrors."""
        mounts = self.mounts[which] if len(self.mounts) else self.mounts
        return self._replace(
            centre=self.centre[which], target=self.target[which], sides=self.sides[which], curve=self.curve[which],
            cant=self.cant[which], turn=self.turn[which], mounts=mounts,
        )  # fmt: skip


class Rules(NamedTuple):
    """Nodes and weights of Gauss, by order."""

    mirror: Floats
    """Legendre on -1 to 1, weights with the sum 1, shape (orders, 2, orders)."""
    line: Floats
    """Legendre on 0 to 1, shape (orders, 2, orders)."""
    fine: float
    """Factor on the numbers of nodes."""


class Room(NamedTuple):
    """Room of one heliostat and instant."""

    weights: Floats
    """Weights of the nodes of the tables; see `light.weigh`."""
    series: Floats
    """See `light.Light`."""
    far: Floats
    places: Floats
    outline: Outline


@functools.lru_cache(8)
def gauss_rules(fine: float) -> Rules:
    """Rules for a factor on the numbers of nodes."""
    mirror, line = np.zeros((2, MOST + 1, 2, MOST))
    for order in range(1, MOST + 1):
        place, weight = np.polynomial.legendre.leggauss(order)
        mirror[order, :, :order] = place, weight / 2
        line[order, :, :order] = (1.0 + place) / 2, weight / 2
    return Rules(mirror, line, fine)


def sun_tables(sun: SunShape, errors: Errors) -> tuple[Tables, Errors]:
    """Tables of a sun for any heliostat with these errors, and the errors with the Gaussian part of the sun."""
    even = math.sqrt(errors.specularity**2 + sun.variance)
    slopes = sorted((errors.slope_u, errors.slope_v))
    least, low, high = (
        max(even**2 + (2.0 * slope) ** 2, LEAST_ERROR**2) for slope in (LEAST_COSINE * slopes[0], *slopes)
    )
    return tables(sun, (0.999 * least, 1.001 * high), (low, high)), errors._replace(specularity=even)


@kernel
def _sweep(scene, rules, sun, start, stop, roll, wanted, out):
    """Write the intercept of mirrors start..stop at all instants that are wanted in `out`."""
    tables = scene.tables
    room = Room(
        np.zeros(tables.reach.shape[1]), np.zeros(tables.light.shape[2:]), np.zeros(tables.far.shape[2]),
        np.zeros(PLACES), empty_outline(),
    )  # fmt: skip
    terms, has_errors, lean = np.empty(TERMS), scene.mounts.shape[0] > 0, 0.0
    for row in range(scene.slopes.shape[0]):
        for column in range(scene.slopes.shape[1]):
            lean = max(lean, math.hypot(scene.slopes[row, column, 0], scene.slopes[row, column, 1]))
    for i in range(start, stop):
        if has_errors:
            stand_terms(scene.mounts[i], 0, terms, 0)
        place = (scene.centre[i, 0], scene.centre[i, 1], scene.centre[i, 2])
        aim = (scene.target[i, 0], scene.target[i, 1], scene.target[i, 2])
        for t in range(sun.shape[0]):
            if wanted[i - start, t]:
                to_sun, target = (sun[t, 0], sun[t, 1], sun[t, 2]), unit(mixed(1.0, aim, -1.0, place))
                turn = (scene.turn[i, 0], scene.turn[i, 1])
                if has_errors:
                    more = mount_turn(to_sun, target, scene.tracking, terms)
                    turn = (turn[0] + more[0], turn[1] + more[1])
                out[i - start, t] = _intercept(
                    place, target, (scene.sides[i, 0], scene.sides[i, 1]), scene.curve[i], scene.cant[i], turn,
                    scene.slopes, lean, scene.facets, to_sun, scene.tracking, roll, scene.errors, scene.receiver,
                    scene.tables, rules, room,
                )  # fmt: skip


@inner
def _intercept(
    place, target, sides, curve, cant, turn, slopes, lean, facets, sun, tracking, roll, errors, receiver, tables, rules,
    room,
):  # fmt: skip
    """Intercept of one heliostat and instant."""
    if not dot(sun, target) > -1.0 + 1e-12:
        return 0.0
    frame = frame_of(sun, target, tracking, roll)
    xx, yy, xy = spread_of(frame, sun, errors)
    small, large, axis_x, axis_y = axes_of(xx, yy, xy)
    small = max(small, LEAST_ERROR * LEAST_ERROR)
    large = max(large, small)
    window = window_of(place, frame.r, receiver)
    if window[0] >= window[1] or window[2] >= window[3]:
        return 0.0
    width, height = facet_sides(sides, facets)
    far, outline = distance(place, receiver), room.outline
    last_u, last_v = 0.5 * (sides[0] - width), 0.5 * (sides[1] - height)
    moved = image_shift(frame, sun, last_u, 0.0, 0.5 * width, 0.0, cant, curve, far)
    moved = 1.1 * (moved + image_shift(frame, sun, 0.0, last_v, 0.0, 0.5 * height, cant, curve, far)) + 2.2 * lean
    along, across, _, sigma = stretched(small, large, tables.core)
    axes = (along * axis_x, along * axis_y, -across * axis_y, across * axis_x)
    corners, order = outline_of(place, receiver, window, rules, smooth(small, 0.5 * tables.core, 1.7), outline)
    _fill(outline.lanes, 0, turn)
    _face(outline.lanes, GROUP, frame, sun, place, cant, curve, axes, receiver)
    apart, inside = nearest(outline, corners, room.places)
    apart -= moved * max(along, across)
    band = weigh(tables, small, large, room.weights)
    reach, harmonics = extent(tables, band, room.weights, LEAST_HARMONIC / rules.fine**2)
    if apart > reach:
        return 1.0 if inside else 0.0
    collapse(tables, band, room.weights, harmonics, room.series, room.far)
    changing, most = smooth(sigma * sigma, 0.5 * tables.core, 1.7), 1.0
    if apart > 0.0:
        for k in range(GROUP):
            room.places[X + k], room.places[Y + k], room.places[PART + k] = apart, 0.0, apart * apart
        look_up(light_of(room, tables, band, 1, reach, changing), GROUP)
        most = min(1.0, max(1e-6, 1.0 - room.places[RESULT]))
    light = light_of(room, tables, band, harmonics, reach, changing)
    scale = min(1.0, 1.15 * most**0.08) / smooth(small, tables.core, 2.5)
    side_u = scale * image_shift(frame, sun, 0.0, 0.0, 0.5 * width, 0.0, 0.0, curve, far)
    side_v = scale * image_shift(frame, sun, 0.0, 0.0, 0.0, 0.5 * height, 0.0, curve, far)
    nodes_u, nodes_v = order_of(rules.fine * (1.5 + 1.8 * side_u)), order_of(rules.fine * (1.5 + 1.8 * side_v))
    if slopes.shape[0] > 0:
        nodes_u, nodes_v = slopes.shape[1] // facets.columns, slopes.shape[0] // facets.rows
    panels, lanes, total, count = panels_of(light, outline.breaks), outline.lanes, 0.0, 0
    pieces = facets.columns * facets.rows
    for facet in range(pieces):
        a0 = (facet % facets.columns - 0.5 * (facets.columns - 1)) * (width + facets.gap)
        b0 = (facet // facets.columns - 0.5 * (facets.rows - 1)) * (height + facets.gap)
        for j in range(nodes_u):
            for k in range(nodes_v):
                lanes[_A0 + count], lanes[_B0 + count] = a0, b0
                lanes[_A + count] = 0.5 * width * rules.mirror[nodes_u, 0, j]
                lanes[_B + count] = 0.5 * height * rules.mirror[nodes_v, 0, k]
                here = turn_at(turn, slopes, facets, facet, nodes_u, nodes_v, j, k)
                lanes[_TURN_U + count], lanes[_TURN_V + count] = here
                lanes[WEIGHT + count] = rules.mirror[nodes_u, 1, j] * rules.mirror[nodes_v, 1, k]
                count += 1
                if count == PACKET or (facet == pieces - 1 and j == nodes_u - 1 and k == nodes_v - 1):
                    _fill(lanes, count, turn)
                    _face(lanes, whole(count), frame, sun, place, cant, curve, axes, receiver)
                    total, count = total + within(outline, corners, order, panels, whole(count), light, rules), 0
    return min(1.0, max(0.0, total / pieces))


@inner
def _fill(lanes, count, turn):
    """Fill the last group of lanes with the centre of the mirror, which counts nothing."""
    for i in range(count, max(GROUP, whole(count))):
        lanes[_A0 + i] = lanes[_B0 + i] = lanes[_A + i] = lanes[_B + i] = lanes[WEIGHT + i] = 0.0
        lanes[_TURN_U + i], lanes[_TURN_V + i] = turn


@inner
def _face(lanes, width, frame, sun, place, cant, curve, axes, receiver):
    """Write how points of the mirror see the receiver. Where that is from behind they count nothing."""
    for i in range(width):
        turn = (lanes[_TURN_U + i], lanes[_TURN_V + i])
        offset, r, e1, e2 = ray_from(
            frame, sun, turn, lanes[_A0 + i], lanes[_B0 + i], lanes[_A + i], lanes[_B + i], cant, curve
        )
        point = mixed(1.0, place, 1.0, offset)
        hidden = behind(point, receiver)
        lanes[WEIGHT + i] = 0.0 if hidden else lanes[WEIGHT + i]
        point = (
            place[0] if hidden else point[0], place[1] if hidden else point[1], place[2] if hidden else point[2],
        )  # fmt: skip
        face(lanes, i, point, r, mixed(axes[0], e1, axes[1], e2), mixed(axes[2], e1, axes[3], e2), receiver)


@inline
def smooth(blur, core, most):
    """Length over which light changes, from the variances of blur and disc; at most so many deviations of the blur."""
    return min(math.sqrt(blur + core), most * math.sqrt(blur))


@inner
def turn_at(turn, slopes, facets, facet, nodes_u, nodes_v, j, k):
    """Turn of the normal at node (j, k) of a facet: that of the mirror, and the slopes of a map where there is one."""
    if slopes.shape[0] == 0:
        return turn
    row, column = facet // facets.columns * nodes_v + k, facet % facets.columns * nodes_u + j
    return turn[0] + slopes[row, column, 0], turn[1] + slopes[row, column, 1]


@inner
def image_shift(frame, sun, a0, b0, a, b, cant, curve, far):
    """How far the image of a point of the mirror is from that of its centre, seen from there. [rad]"""
    offset, r, _, _ = ray_from(frame, sun, (0.0, 0.0), a0, b0, a, b, cant, curve)
    d = mixed(1.0, offset, far, mixed(1.0, r, -1.0, frame.r))
    along = dot(d, frame.r)
    return math.sqrt(max(0.0, dot(d, d) - along * along)) / far


def intercepts(
    scene: Scene,
    sun: Floats,
    start: int = 0,
    stop: int | None = None,
    fine: float = 1.0,
    wanted: NDArray[np.bool_] | None = None,
    out: Floats | None = None,
    roll: float = 0.0,
) -> Floats:
    """Intercept of mirrors start..stop at instants, each computed.

    Parameters
    ----------
    scene : Scene
        Mirrors and receiver.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up. [1]
    start, stop : int
        First mirror, and the one after the last.
    fine : float
        Factor on the numbers of nodes, up to 3.
    wanted : ndarray of bool, shape (stop - start, T), optional
        What to compute; without, all with the sun up.
    out : ndarray, shape (stop - start, T), optional
        Where to write; what is not computed stays as it is.
    roll : float
        Turn of every mirror about its normal, of a scene with `mirror.ROLLED` as its tracking. [rad]

    Returns
    -------
    ndarray, shape (stop - start, T)
        Part of the reflected light that meets the receiver, 0 to 1, within `ERROR`; 0 for a receiver that is seen from
        behind, NaN with the sun at or below the horizon. [1]
    """
    stop = len(scene.centre) if stop is None else stop
    sun = np.array(sun, np.float64, order="C")
    if wanted is None:
        wanted = np.repeat((sun[:, 2] > 0.0)[np.newaxis], stop - start, axis=0)
    if out is None:
        out = np.full((stop - start, len(sun)), np.nan)
    _sweep(scene, gauss_rules(fine), sun, start, stop, roll, wanted, out)
    return out

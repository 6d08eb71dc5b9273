"""The sweep over packets of instants and the heliostats of a block.

For each packet and heliostat: find the candidates, make their images and measure the unions. The frame of a mirror is
made when an image first needs it.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.images import images_of, project, write_axes
from heliosweep.kernels.field.neighbours import Cells, beam, offset, search
from heliosweep.kernels.field.packets import COSINE, FRAME, Mirrors, write_frame
from heliosweep.kernels.field.polygons import SQUARE
from heliosweep.kernels.field.unions import room_for, unions
from heliosweep.kernels.vectors import GROUP, ROW, dot, get, put, rows

#: Frames of full packets after which all are dropped: more would leave the processor's cache.
_KEPT = 1000


class Lines(NamedTuple):
    """Rows of lanes of one packet and test heliostat, and frames of mirrors."""

    #: Directions to the sun, and to the target of the test heliostat. [1]
    to_sun: Floats
    to_target: Floats
    #: Axes of projection along one or the other. [1/m]
    views: Floats
    #: Areas of the unions of its images: shaded, blocked, and shaded or blocked.
    total: Floats
    #: Cosine, shading, blocking and optical efficiency, and cosine times shading efficiency. [1]
    result: Floats
    #: Frames of mirrors, see `packets.write_frame`. [m]
    frames: Floats
    #: Start of the frame of each heliostat of the field, -1 without one.
    place: Integers


@kernel
def sweep(
    mirrors: Mirrors,
    cells: Cells,
    tracking: int,
    sun: Floats,
    order: Integers,
    first: Integers,
    tests: Integers,
    names: Integers,
    series: Floats,
    weight: Floats,
    period: Integers,
    sums: Floats,
) -> None:
    """Write the efficiencies of some heliostats to `series` and add them, weighted, to `sums`.

    Parameters
    ----------
    mirrors, cells : Mirrors, Cells
        The field, from `neighbours.by_cells`.
    tracking : int
        Code of the tracking method.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    order, first : ndarray
        Packets, from `packets.packet_order`.
    tests, names : ndarray, shape (n,)
        Heliostats, and their rows in the results.
    series : ndarray, shape (4, T, n), or (4, 0, 0) if no series is written
        Cosine, shading, blocking and optical efficiency. [1]
    weight, period : ndarray, shape (T,)
        Weight of each instant, and the number of its period.
    sums : ndarray, shape (n, P, 5), or (n, 0, 5) if nothing is summed
        Weighted sums over each period of the series, and of cosine times shading efficiency.
    """
    count = mirrors.throw.shape[0]
    found, place = np.empty(2 * count, np.int64), np.full(count, -1)
    lines = Lines(rows(3), rows(3), rows(6), rows(3), rows(5), np.empty(64 * FRAME), place)
    images, room = images_of(16), room_for(16)
    blockers, begins = np.empty(0, np.int64), np.zeros(tests.shape[0] + 1, np.int64)
    for fill in range(2):  # counted first, then written
        for t in range(tests.shape[0]):
            for c in range(3):
                lines.to_target[c * ROW] = mirrors.aim[tests[t], c]
            names_of = blockers[begins[t] :] if fill else found
            count = search(tests[t], beam(lines.to_target, 1), mirrors.throw[tests[t]], mirrors, cells, names_of)
            begins[t + 1] = begins[t] + count
        blockers = np.empty(begins[tests.shape[0]] + 1, np.int64) if fill == 0 else blockers
    for p in range(first.shape[0] - 1):
        packet = order[first[p] : first[p + 1]]
        lanes = -(-packet.shape[0] // GROUP) * GROUP
        for k in range(lanes):  # filled up to whole groups by the last
            for c in range(3):
                lines.to_sun[c * ROW + k] = sun[packet[min(k, packet.shape[0] - 1)], c]
        bundle, used = beam(lines.to_sun, packet.shape[0]), np.int64(0)
        lines.place[:] = -1
        for t in range(tests.shape[0]):
            i = tests[t]
            for c in range(3):
                lines.to_target[c * ROW : c * ROW + lanes] = mirrors.aim[i, c]
            shaders = search(i, bundle, np.inf, mirrors, cells, found)
            most = shaders + begins[t + 1] - begins[t]
            if most > images.present.shape[0]:
                images, room = images_of(2 * most), room_for(2 * most)
            if used > _KEPT * (ROW // lanes) or _frame(used + most + 1, lanes) + FRAME > lines.frames.shape[0]:
                lines.place[:] = -1
                used = np.int64(0)
                if _frame(_KEPT * (ROW // lanes) + most + 1, lanes) + FRAME > lines.frames.shape[0]:
                    frames = rows(2 * (_KEPT + most + 1) * 7)
                    lines = Lines(lines.to_sun, lines.to_target, lines.views, lines.total, lines.result, frames, place)
            used = _sweep_one(
                i,
                mirrors,
                tracking,
                found[:shaders],
                blockers[begins[t] : begins[t + 1]],
                lines,
                images,
                room,
                used,
                lanes,
            )
            _write(lines.result, packet, names[t], series, weight, period, sums)


@inline
def _frame(count, lanes):
    """Start of frame number `count`: frames of a short packet share rows, and more of them fit in the cache."""
    side = ROW // lanes
    return count // side * FRAME + count % side * lanes


@inner
def _sweep_one(i, mirrors, tracking, shaders, blockers, lines, images, room, used, lanes):
    """Write the efficiencies of test heliostat i at the instants of a packet; returns the number of frames."""
    used = _have_frame(i, mirrors, tracking, lines, used, lanes)
    shading, used = _make_images(i, shaders, mirrors, tracking, lines, lines.to_sun, images, np.int64(0), used, lanes)
    made, used = _make_images(i, blockers, mirrors, tracking, lines, lines.to_target, images, shading, used, lanes)
    unions(images, shading, made, lines.total, room, lanes)
    for k in range(lanes):
        cosine, shading_efficiency = get(lines.frames, lines.place[i] + COSINE, k), _left(get(lines.total, 0, k))
        put(lines.result, 0, k, cosine)
        put(lines.result, ROW, k, shading_efficiency)
        put(lines.result, 2 * ROW, k, _left(get(lines.total, ROW, k)))
        put(lines.result, 3 * ROW, k, cosine * _left(get(lines.total, 2 * ROW, k)))
        put(lines.result, 4 * ROW, k, cosine * shading_efficiency)
    return used


@inner
def _have_frame(j, mirrors, tracking, lines, used, lanes):
    """Make the frame of heliostat j if there is none; returns the number of frames."""
    if lines.place[j] >= 0:
        return used
    lines.place[j] = _frame(used, lanes)
    write_frame(lines.frames, lines.place[j], lines.to_sun, mirrors, j, tracking, lanes)
    return used + 1


@inner
def _make_images(i, candidates, mirrors, tracking, lines, directions, images, made, used, lanes):
    """Make images of the candidates of heliostat i from number `made` on; returns the numbers of images and frames."""
    if candidates.shape[0] > 0:
        write_axes(lines.views, lines.frames, lines.place[i], directions, lanes)
    for m in range(candidates.shape[0]):
        j = candidates[m]
        way, reach = offset(mirrors, i, j), mirrors.radius[i] + mirrors.radius[j]
        apart = dot(way, way) > reach * reach * (1.0 + 1e-12)
        used = _have_frame(j, mirrors, tracking, lines, used, lanes)
        frame, test = lines.place[j], lines.place[i]
        made += project(images, made, lines.views, lines.frames, frame, test, directions, way, apart, lanes)
    return made, used


@inline
def _left(covered):
    """Fraction of the mirror outside a union, without the rounding that would lead out of 0 to 1."""
    return min(1.0, max(0.0, 1.0 - covered / SQUARE))


@inner
def _write(result, packet, t, series, weight, period, sums):
    """Write the results of one heliostat and packet to `series`, and add them to the sums over each period."""
    for c in range(4 if series.shape[2] > 0 else 0):
        for k in range(packet.shape[0]):
            series[c, packet[k], t] = result[c * ROW + k]
    for k in range(packet.shape[0] if sums.shape[1] > 0 else 0):
        when, one = period[packet[k]], weight[packet[k]]
        for c in range(5):
            sums[t, when, c] += one * get(result, c * ROW, k)

"""The sweep over packets of instants and the heliostats of a block.

For each packet: find the candidates of every test heliostat, then make the images and their unions heliostat by
heliostat. The frame of a mirror is made when an image first needs it.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.images import AXES_ROWS, axes, images_of, measure, project
from heliosweep.kernels.field.neighbours import Candidates, Cells, beam, no_candidates, places, search, search_all
from heliosweep.kernels.field.packets import COSINE, FRAME_ROWS, Mirrors, half_sides
from heliosweep.kernels.field.polygons import SQUARE
from heliosweep.kernels.field.unions import room_for, unions
from heliosweep.kernels.vectors import GROUP, ROW, dot, rows

_KEPT = 1000
"""Frames of full packets after which all are dropped: more would leave the processor's cache."""


class Weights(NamedTuple):
    """Weights of instants, and the sums over periods; without periods nothing is summed."""

    weight: Floats
    """Weight of each instant, and the same times the reflectance, shape (2, T)."""
    period: Integers
    """Number of the period of each instant, from 0, shape (T,)."""
    part: Floats
    """Part of the light of each test heliostat and instant that counts, shape (tests, T), or (0, 0) for all."""
    sums: Floats
    """Sums for each test heliostat and period, see `efficiency.field_energies`, shape (tests, P, 7)."""


class Lines(NamedTuple):
    """Rows of lanes of one packet and test heliostat, and frames of mirrors."""

    to_sun: Floats
    """Directions to the sun, and to the target of the test heliostat. [1]"""
    to_target: Floats
    views: Floats
    """Axes of projection along one or the other. [1/m]"""
    total: Floats
    """Areas of the unions of its images: shaded, blocked, and shaded or blocked."""
    result: Floats
    """Cosine, shading, blocking and optical efficiency. [1]"""
    frames: Floats
    """Frames of mirrors, one after the other, see `packets.half_sides`. [m]"""
    place: Integers
    """Start of the frame of each heliostat of the field, -1 without one."""


@kernel
def sweep(
    mirrors: Mirrors,
    grid: Cells,
    tracking: int,
    sun: Floats,
    order: Integers,
    first: Integers,
    start: int,
    stop: int,
    series: Floats,
    weighted: Weights,
) -> None:
    """Sweep instants packet by packet; write to `series` and add to the sums of `weighted`, if they have room.

    `mirrors` and `grid` are a `SortedField`, of which heliostats start..stop are tested; `tracking`, and `sun`, shape
    (T, 3), are as for `field_sums`. `order` contains the instants to sweep, with the sun up in each; packet p is
    ``order[first[p] : first[p + 1]]``. `series` has shape (4, T, stop - start) or (4, 0, 0), see `field_series`.
    """
    tests = places(grid, start, stop)
    blockers, shaders = blockers_of(tests, mirrors, grid), no_candidates(tests.shape[0])
    lines = Lines(
        rows(3), rows(3), rows(AXES_ROWS), rows(3), rows(4), rows(0), np.full(grid.names.shape[0], -1)
    )  # fmt: skip
    images, room = images_of(0), room_for(0)
    for p in range(first.shape[0] - 1):
        packet = order[first[p] : first[p + 1]]
        lanes = _directions(sun, packet, lines.to_sun)
        shaders = search_all(tests, beam(lines.to_sun, ROW, packet.shape[0]), mirrors, grid, shaders)
        most = np.int64(0)
        for t in range(tests.shape[0]):
            here = shaders.first[t + 1] - shaders.first[t] + blockers.first[t + 1] - blockers.first[t]
            most = max(most, here)
        count = min(_kept(lanes) + most + 1, grid.names.shape[0])
        if _frame(count, lanes) + FRAME_ROWS * ROW > lines.frames.shape[0]:
            more = rows(2 * (count + 1) * FRAME_ROWS)
            lines = Lines(
                lines.to_sun, lines.to_target, lines.views, lines.total, lines.result, more, lines.place
            )  # fmt: skip
        if most > images.apart.shape[0]:
            images, room = images_of(2 * most), room_for(2 * most)
        count = np.int64(0)
        lines.place[:] = -1
        for t in range(tests.shape[0]):
            i = tests[t]
            if count > _kept(lanes):
                lines.place[:] = -1
                count = np.int64(0)
            count = _sweep_one(i, t, mirrors, tracking, blockers, shaders, lines, images, room, count, lanes)
            _write(lines.result, packet, grid.names[i] - start, series, weighted)


@inline
def _kept(lanes):
    """Number of frames after which all are dropped."""
    return _KEPT * (ROW // lanes)


@inline
def _frame(count, lanes):
    """Start of frame number `count`: those of a short packet are side by side, and more of them in the cache."""
    side = ROW // lanes
    return count // side * FRAME_ROWS * ROW + count % side * lanes


@kernel
def blockers_of(tests: Integers, mirrors: Mirrors, grid: Cells) -> Candidates:
    """Heliostats that may block each of the block, for any sun."""
    names, first = no_candidates(tests.shape[0])
    for t in range(tests.shape[0]):
        i = tests[t]
        bundle = beam(mirrors.aim[i], np.int64(1), np.int64(1))
        names, first[t + 1] = search(i, bundle, mirrors.throw[i], mirrors, grid, names, first[t])
    return Candidates(names, first)


@inner
def _directions(sun, packet, to_sun):
    """Write the sun vectors of a packet in rows, filled up to whole groups by the last; returns the lanes."""
    lanes = -(-packet.shape[0] // GROUP) * GROUP
    for k in range(lanes):
        when = packet[min(k, packet.shape[0] - 1)]
        for c in range(3):
            to_sun[c * ROW + k] = sun[when, c]
    return lanes


@inner
def _sweep_one(i, t, mirrors, tracking, blockers, shaders, lines, images, room, count, lanes):
    """Efficiencies of test heliostat i at the instants of a packet; returns the number of frames."""
    count = _have_frame(i, mirrors, tracking, lines, count, lanes)
    shading, test = np.int64(0), lines.place[i]
    if shaders.first[t + 1] > shaders.first[t]:
        axes(lines.views, lines.frames, test, lines.to_sun, lanes)
        shading, count = _make_images(
            i, t, shaders, mirrors, tracking, lines, lines.to_sun, images, shading, count, lanes
        )
    made = shading
    if blockers.first[t + 1] > blockers.first[t]:
        for c in range(3):
            lines.to_target[c * ROW : c * ROW + lanes] = mirrors.aim[i, c]
        axes(lines.views, lines.frames, test, lines.to_target, lanes)
        made, count = _make_images(
            i, t, blockers, mirrors, tracking, lines, lines.to_target, images, made, count, lanes
        )
    unions(images, shading, made, lines.total, room, lanes)
    cosine, result, total = max(test + COSINE, 0), lines.result, lines.total
    for k in range(lanes):
        result[k] = lines.frames[cosine + k]
        result[ROW + k], result[2 * ROW + k] = _left(total[k]), _left(total[ROW + k])
        result[3 * ROW + k] = lines.frames[cosine + k] * _left(total[2 * ROW + k])
    return count


@inner
def _have_frame(j, mirrors, tracking, lines, count, lanes):
    """Make the frame of heliostat j if there is none; returns the number of frames."""
    if lines.place[j] >= 0:
        return count
    lines.place[j] = _frame(count, lanes)
    half_sides(lines.frames, lines.place[j], lines.to_sun, mirrors, j, tracking, lanes)
    return count + 1


@inner
def _make_images(i, t, candidates, mirrors, tracking, lines, directions, images, made, count, lanes):
    """Make images of the candidates of heliostat i from number `made` on; returns the numbers of images and frames."""
    test = lines.place[i]
    for m in range(candidates.first[t], candidates.first[t + 1]):
        j = candidates.names[m]
        offset = mirrors.x[j] - mirrors.x[i], mirrors.y[j] - mirrors.y[i], mirrors.z[j] - mirrors.z[i]
        reach = mirrors.radius[i] + mirrors.radius[j]
        apart = dot(offset, offset) > reach * reach * (1.0 + 1e-12)
        count = _have_frame(j, mirrors, tracking, lines, count, lanes)
        other = lines.place[j]
        if project(images, made, lines.views, lines.frames, other, directions, offset, apart, lanes) != 0:
            made += np.int64(measure(images, made, lines.frames, other, test, offset, lanes) != 0)
    return made, count


@inline
def _left(covered):
    """Fraction of the mirror outside a union, without the rounding that would lead out of 0 to 1."""
    return min(1.0, max(0.0, 1.0 - covered / SQUARE))


@inner
def _write(result, packet, t, series, weighted):
    """Write the results of one heliostat and packet to `series`, and add them to the sums over each period."""
    for c in range(4 if series.shape[2] > 0 else 0):
        for k in range(packet.shape[0]):
            series[c, packet[k], t] = result[c * ROW + k]
    sums = weighted.sums
    for k in range(packet.shape[0] if sums.shape[1] > 0 else 0):
        when = packet[k]
        m, weight = weighted.period[when], weighted.weight[0, when]
        cosine, shading, optical = result[k], result[ROW + k], result[3 * ROW + k]
        reflected = weighted.weight[1, when] * optical
        sums[t, m, 0] += weight * cosine
        sums[t, m, 1] += weight * shading
        sums[t, m, 2] += weight * result[2 * ROW + k]
        sums[t, m, 3] += weight * optical
        sums[t, m, 4] += weight * (cosine * shading)
        sums[t, m, 5] += reflected
        sums[t, m, 6] += reflected * weighted.part[t, when] if weighted.part.shape[0] > 0 else reflected

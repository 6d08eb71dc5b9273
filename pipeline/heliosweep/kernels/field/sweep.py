"""The sweep over packets of instants and the heliostats of a block.

For each packet: find the candidates of every test heliostat, then make the images and their unions heliostat by
heliostat. The frame of a mirror is made where an image first asks for it: with a low sun most candidates are hidden, or
in the way of a few instants only.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.cover import COVER_ROWS, FLOOR, cover_by, in_view, take_out_hidden, uncover
from heliosweep.kernels.field.frames import forget, have_frame, kept, no_frames, with_room
from heliosweep.kernels.field.images import AXES_ROWS, LOW_RISE, axes, images_of, measure, project, turn_upright
from heliosweep.kernels.field.neighbours import (
    Candidates,
    Cells,
    beam,
    expected,
    no_candidates,
    offsets_of,
    places,
    search,
    search_all,
    sift_all,
)
from heliosweep.kernels.field.packets import (
    COSINE,
    Mirrors,
)
from heliosweep.kernels.field.polygons import SQUARE
from heliosweep.kernels.field.unions import room_for, unions
from heliosweep.kernels.vectors import GROUP, PACKET, ROW, rows

_TOGETHER, _FEW = 16, 96.0
"""Packets whose candidates are searched for together, and candidates up to which that pays: each packet sifts them."""
_MANY = 12
"""Candidates from which on it pays to look first whether the bounding sphere of each is in the way in any lane."""


class Lines(NamedTuple):
    """Rows of lanes of one packet and test heliostat."""

    to_sun: Floats
    """Directions to the sun, and to the target of the test heliostat. [1]"""
    to_target: Floats
    views: Floats
    """Axes of projection along one or the other. [1/m]"""
    cover: Floats
    """What is covered of the test mirror along one or the other."""
    total: Floats
    """Areas of the unions of its images: shaded, blocked, and shaded or blocked."""
    result: Floats
    """Cosine, shading, blocking and optical efficiency, and room for a part of the last. [1]"""


class Weights(NamedTuple):
    """Weights of instants, and the periods that they are summed over; without periods nothing is."""

    weight: Floats
    """Weight of each instant, and what mirrors reflect of it, shape (2, T)."""
    period: Integers
    """Number of the period that each instant is in, from 0, shape (T,)."""
    sums: Floats
    """Sums for each test heliostat and period, as `field_energies` returns them, shape (stop - start, P, 7)."""


UNWEIGHTED = Weights(np.empty((2, 0)), np.empty(0, np.int64), np.empty((0, 0, 7)))
"""No weights: nothing is summed over periods."""


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
    sums: Floats,
    series: Floats,
    part: Floats,
    weighted: Weights,
) -> None:
    """Sweep instants packet by packet; add to `sums` and write to `series`, whichever has room for heliostats.

    `mirrors` and `grid` are a `SortedField`, of which heliostats start..stop are tested; `tracking`, and `sun`, shape
    (T, 3), are as for `field_sums`. `order` has the instants to sweep, in packet order, with the sun up in each;
    `first` tells where each packet begins in it, and its length. `sums` has shape (stop - start, 4) or (0, 4), as
    returned by `field_sums`; `series` has shape (4, T, stop - start) or (4, 0, 0), as returned by `field_series`. Where
    `part`, as for `field_sums`, has a row for each test heliostat, `sums` has a fifth column. `weighted` is added to
    where it has periods.
    """
    tests = places(grid, start, stop)
    blockers = blockers_of(tests, mirrors, grid)
    wide, shaders = no_candidates(tests.shape[0]), no_candidates(tests.shape[0])
    offsets = np.empty(0)
    halo = no_frames(grid.names.shape[0])
    lines = Lines(rows(3), rows(3), rows(AXES_ROWS), rows(COVER_ROWS), rows(3), rows(5))
    images, room = images_of(0), room_for(0)
    last, together = 0, False
    for p in range(first.shape[0] - 1):
        if p == last:  # the next packets: their candidates are among `wide` if there are several
            last, bundle = _together(p, sun, order, first, grid)
            together = last > p + 1
            if together:
                wide = search_all(tests, bundle, mirrors, grid, wide)
                offsets = offsets_of(tests, mirrors, wide, offsets)
        packet = order[first[p] : first[p + 1]]
        lanes = _directions(sun, packet, lines.to_sun)
        bundle = beam(lines.to_sun, ROW, packet.shape[0])
        if together:
            shaders = sift_all(bundle, wide, offsets, shaders)
        else:
            shaders = search_all(tests, bundle, mirrors, grid, shaders)
        most = _most(blockers, shaders)
        halo = with_room(halo, kept(lanes) + most + 1, lanes)
        if most > images.apart.shape[0]:
            images, room = images_of(2 * most), room_for(2 * most)
        _sweep_block(
            tests, start, mirrors, grid, tracking, halo, blockers, shaders, lines, images, room, packet, lanes,
            bundle.low, sums, series, part, weighted,
        )  # fmt: skip


@kernel
def blockers_of(tests: Integers, mirrors: Mirrors, grid: Cells) -> Candidates:
    """Heliostats that may block each of the block, whatever the sun."""
    names, first = no_candidates(tests.shape[0])
    for t in range(tests.shape[0]):
        i = tests[t]
        bundle = beam(mirrors.aim[i], np.int64(1), np.int64(1))
        names, first[t + 1] = search(i, bundle, mirrors.throw[i], mirrors, grid, names, first[t])
    return Candidates(names, first)


@kernel
def _together(p, sun, order, first, grid):
    """End of the packets from p on that are searched for together, where they find few candidates; and their bundle."""
    last = min(p + _TOGETHER, first.shape[0] - 1)
    while True:
        count = first[last] - first[p]
        directions = np.empty(3 * count)
        for k in range(count):
            for c in range(3):
                directions[c * count + k] = sun[order[first[p] + k], c]
        bundle = beam(directions, count, count)
        if last == p + 1 or expected(bundle, grid) <= _FEW:
            return last, bundle
        last = p + (last - p) // 2


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
def _most(blockers, shaders):
    """Most candidates of one test heliostat."""
    most = np.int64(0)
    for t in range(blockers.first.shape[0] - 1):
        pairs = shaders.first[t + 1] - shaders.first[t] + blockers.first[t + 1] - blockers.first[t]
        most = max(most, pairs)
    return most


@inner
def _sweep_block(
    tests,
    start,
    mirrors,
    grid,
    tracking,
    halo,
    blockers,
    shaders,
    lines,
    images,
    room,
    packet,
    lanes,
    lowest,
    sums,
    series,
    part,
    weighted,
):
    """Efficiencies of all test heliostats at the instants of one packet, the lowest sun at such a sine of elevation."""
    frames, count = halo.frames, np.int64(0)
    for t in range(tests.shape[0]):
        i, shading = tests[t], np.int64(0)
        low = min(lowest, mirrors.aim[i, 2]) < LOW_RISE
        if count > kept(lanes):
            forget(halo, count)
            count = np.int64(0)
        count = have_frame(i, np.int64(-1), halo, count, lines.to_sun, mirrors, tracking, lanes)
        test = halo.place[i]
        if shaders.first[t + 1] > shaders.first[t]:
            axes(lines.views, frames, test, lines.to_sun, lanes)
            if low:
                turn_upright(lines.views, frames, test, lines.to_sun, mirrors.aim[i, 2], lanes)
            shading, count = _make_images(
                i, t, shaders, mirrors, tracking, halo, count, lines, lines.to_sun, images, shading, lanes
            )
        made = shading
        if blockers.first[t + 1] > blockers.first[t]:
            _aim(lines.to_target, mirrors, i, lanes)
            axes(lines.views, frames, test, lines.to_target, lanes)
            if low:
                turn_upright(lines.views, frames, test, lines.to_sun, mirrors.aim[i, 2], lanes)
            made, count = _make_images(
                i, t, blockers, mirrors, tracking, halo, count, lines, lines.to_target, images, made, lanes
            )
        unions(images, shading, made, lines.total, room, lanes)
        _efficiencies(frames, test + COSINE, lines.total, lines.result, lanes)
        _write(lines.result, packet, grid.names[i] - start, sums, series, part)
        _weigh(lines.result, packet, grid.names[i] - start, part, weighted)
    forget(halo, count)


@inner
def _make_images(i, t, candidates, mirrors, tracking, halo, count, lines, directions, images, made, lanes):
    """Make images of the candidates of heliostat i, those numbered `made` and on; returns the number of images.

    Hidden ones are taken out in lanes that have had two: with fewer, as mostly, that costs more than it saves. What is
    done in a lane depends on its own images only. Returned is too the number of frames, of which there were `count`.
    """
    test, first, frames = halo.place[i], made, halo.frames
    views, cover = lines.views, lines.cover
    once, twice, covering = np.int64(0), np.int64(0), first
    near, many = np.int64(-1), candidates.first[t + 1] - candidates.first[t] > _MANY
    floor = cover[FLOOR:] if many else cover[:0]
    if many:
        uncover(cover, views, lanes)
    for m in range(candidates.first[t], candidates.first[t + 1]):
        j = candidates.names[m]
        dx, dy, dz = mirrors.x[j] - mirrors.x[i], mirrors.y[j] - mirrors.y[i], mirrors.z[j] - mirrors.z[i]
        if many:
            near = in_view(cover, views, dx, dy, dz, mirrors.radius[j], lanes)
            if near == 0:
                continue
        reach = mirrors.radius[i] + mirrors.radius[j]
        apart = dx * dx + dy * dy + dz * dz > reach * reach * (1.0 + 1e-12)
        if near & ~halo.made[j] != 0:
            count = have_frame(j, near, halo, count, lines.to_sun, mirrors, tracking, lanes)
        other = halo.place[j]
        hits = project(images, made, views, frames, other, directions, dx, dy, dz, apart, near, floor, lanes)
        if hits & twice != 0:
            if covering == first and not many:
                uncover(cover, views, lanes)
            while covering < made:
                cover_by(images, covering, cover, twice, lanes)
                covering += 1
            hits &= ~take_out_hidden(images, made, cover, hits & twice, lanes)
        if hits != 0:
            hits = measure(images, made, frames, other, test, dx, dy, dz, lanes)
            once, twice = once | hits, twice | once & hits
            made += np.int64(hits != 0)
    return made, count


@inline
def _aim(to_target, mirrors, i, lanes):
    """Write the direction to the target in rows."""
    x, y, z = mirrors.aim[i, 0], mirrors.aim[i, 1], mirrors.aim[i, 2]
    for k in range(lanes):
        to_target[k], to_target[ROW + k], to_target[2 * ROW + k] = x, y, z


@inner
def _efficiencies(frames, cosine, total, result, lanes):
    """Write the rows of results: cosine, shading, blocking and optical efficiency."""
    cosine = max(cosine, 0)
    for k in range(lanes):
        result[k] = frames[cosine + k]
        result[ROW + k], result[2 * ROW + k] = _left(total[k]), _left(total[ROW + k])
        result[3 * ROW + k] = frames[cosine + k] * _left(total[2 * ROW + k])


@inline
def _left(covered):
    """Fraction of the mirror outside a union, without the rounding that would lead out of 0 to 1."""
    return min(1.0, max(0.0, 1.0 - covered / SQUARE))


@inner
def _write(result, packet, t, sums, series, part):
    """Add the results of one heliostat and packet to `sums`, and write them to `series`, where there is room."""
    count = packet.shape[0]
    if part.shape[0] > 0:
        for k in range(count):
            result[4 * ROW + k] = result[3 * ROW + k] * part[t, packet[k]]
    if sums.shape[0] > 0:
        _add(result, count, t, sums)
    for c in range(4 if series.shape[2] > 0 else 0):
        for k in range(count):
            series[c, packet[k], t] = result[c * ROW + k]


@inner
def _weigh(result, packet, t, part, weighted):
    """Add the results of one heliostat and packet, times the weights, to the sums over each period."""
    if weighted.sums.shape[1] > 0:
        for k in range(packet.shape[0]):
            when = packet[k]
            m, weight = weighted.period[when], weighted.weight[0, when]
            cosine, shading, optical = result[k], result[ROW + k], result[3 * ROW + k]
            reflected = weighted.weight[1, when] * optical
            weighted.sums[t, m, 0] += weight * cosine
            weighted.sums[t, m, 1] += weight * shading
            weighted.sums[t, m, 2] += weight * result[2 * ROW + k]
            weighted.sums[t, m, 3] += weight * optical
            weighted.sums[t, m, 4] += weight * (cosine * shading)
            weighted.sums[t, m, 5] += reflected
            weighted.sums[t, m, 6] += reflected * part[t, when] if part.shape[0] > 0 else reflected


@inner
def _add(result, count, t, sums):
    """Add the sums of rows, in a fixed order: eight sums side by side, in the lanes behind the packet, and the rest."""
    if count == PACKET:  # in the form that becomes vector code
        for k in range(GROUP):
            result[PACKET + k] = _side(result, k)
            result[ROW + PACKET + k] = _side(result, ROW + k)
            result[2 * ROW + PACKET + k] = _side(result, 2 * ROW + k)
            result[3 * ROW + PACKET + k] = _side(result, 3 * ROW + k)
            result[4 * ROW + PACKET + k] = _side(result, 4 * ROW + k)
    whole = count // GROUP * GROUP
    for c in range(sums.shape[1]):
        row = c * ROW
        if count < PACKET:
            for k in range(GROUP):
                result[row + PACKET + k] = 0.0
            for k in range(whole):
                result[row + PACKET + k % GROUP] += result[row + k]
        m = row + PACKET
        total = ((result[m] + result[m + 1]) + (result[m + 2] + result[m + 3])) + (
            (result[m + 4] + result[m + 5]) + (result[m + 6] + result[m + 7])
        )
        for k in range(row + whole, row + count):
            total += result[k]
        sums[t, c] += total


@inline
def _side(row, m):
    """One of the eight sums of a full row."""
    half = ((row[m] + row[m + 8]) + row[m + 16]) + row[m + 24]
    return (((half + row[m + 32]) + row[m + 40]) + row[m + 48]) + row[m + 56]

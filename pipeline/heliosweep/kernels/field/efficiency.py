"""Cosine, shading, blocking and optical efficiency of heliostats in a field, as sums over periods or at each instant.

Instants are sorted into packets with similar sun directions. For each packet and heliostat, `sweep` finds the
heliostats that may shade or block it, projects them onto the mirror, and computes the area of the union of their
images. A mirror's frame is computed only when an image first needs it.

The values of a heliostat at an instant are bitwise identical, no matter how heliostats and instants are divided among
calls. Rounding errors of sums depend on the order of the packets, which follows from the sun vectors alone.

Outlines of shadows and blocked parts are images of other mirrors, clipped at the edges of the test mirror.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.compiled import Floats, Integers, inline, inner, kernel
from heliosweep.kernels.field.packets import (
    AZIMUTH_ELEVATION,
    COSINE,
    FRAME,
    SPINNING_ELEVATION,
    Cells,
    Mirrors,
    beam,
    by_cells,
    occludes,
    offset,
    packet_order,
    search,
    write_frame,
)
from heliosweep.kernels.field.unions import (
    SQUARE,
    area,
    images_of,
    outline,
    project,
    project_tower,
    room_for,
    unions,
    within,
    write_axes,
    write_square,
)
from heliosweep.kernels.vectors import GROUP, ROW, dot, get, put, rows, store


class SortedField(NamedTuple):
    """The mirrors of a field, sorted by grid cell."""

    mirrors: Mirrors
    cells: Cells
    #: Index of each heliostat before sorting.
    names: Integers
    #: Radius and top height of a tower at x = y = 0 that shades the mirrors; 0 if there is no tower. [m]
    tower: Floats


def aimed(
    x: Floats, y: Floats, z: Floats, half_width: Floats, half_height: Floats, target_height: float | Floats
) -> Mirrors:
    """Return mirrors that aim at (0, 0, target_height) or at individual points; parameters as in `sorted_field`."""
    centre, half = np.stack((x, y, z), axis=1).astype(float), np.stack((half_width, half_height), axis=1).astype(float)
    to_target = (target_height if np.ndim(target_height) else np.array([0.0, 0.0, target_height])) - centre
    throw = np.sqrt(to_target[:, 0] ** 2 + to_target[:, 1] ** 2 + to_target[:, 2] ** 2)
    radius = np.sqrt(half[:, 0] ** 2 + half[:, 1] ** 2)
    with np.errstate(invalid="ignore"):  # zero distance to the target: rejected by `sorted_field`
        return Mirrors(centre, half, radius, to_target / throw[:, np.newaxis], throw)


def sorted_field(
    x: Floats, y: Floats, z: Floats, half_width: Floats, half_height: Floats, target_height: float | Floats,
    tower: tuple[float, float] | None = None,
) -> SortedField:  # fmt: skip
    """Sort the mirrors of a field by grid cell.

    Several calls of `field_energies` and similar functions can use one sorted field.

    Parameters
    ----------
    x, y, z : ndarray, shape (N,)
        Mirror centres: east, north, up. [m]
    half_width, half_height : ndarray, shape (N,)
        Half the width (along u) and half the height (along v) of each mirror. [m]
    target_height : float or ndarray, shape (N, 3)
        Height of the target point at x = y = 0, or the aim point of each mirror. [m]
    tower : (float, float), optional
        Radius and top height of an upright cylinder at x = y = 0 that shades the mirrors. [m]

    Raises
    ------
    ValueError
        If there are no mirrors, if the arrays have different lengths, if a value is not finite, or if a mirror is at
        its target point.
    """
    if not len(x) or len({len(each) for each in (x, y, z, half_width, half_height)}) > 1:
        raise ValueError("centres and half sides must have equal numbers of finite values")
    mirrors = aimed(x, y, z, half_width, half_height, target_height)
    if not all(np.isfinite(each).all() for each in mirrors):
        raise ValueError("centres and half sides must be finite, and no mirror may be at the target")
    return SortedField(*by_cells(mirrors), np.array(tower or (0.0, 0.0), np.float64))


def field_sums(field: SortedField, tracking: int, sun: Floats, start: int, stop: int) -> tuple[Floats, int]:
    """Return sums of the efficiencies over all instants with the sun above the horizon.

    Parameters
    ----------
    field : SortedField
        All N mirrors of the field, from `sorted_field`.
    tracking : int
        `packets.SPINNING_ELEVATION` or `packets.AZIMUTH_ELEVATION`.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up. Instants with z <= 0 or NaN are ignored. [1]
    start, stop : int
        Range of heliostats to compute. All N heliostats may shade and block a heliostat in this range.

    Returns
    -------
    sums : ndarray, shape (stop - start, 5)
        Sums of five quantities: the cosine efficiency; the shading efficiency (1 - shaded fraction); the blocking
        efficiency (1 - blocked fraction); the optical efficiency, cosine * (1 - fraction shaded or blocked); and the
        product of the cosine, shading and blocking efficiencies. [1]
    instants : int
        Number of instants with the sun above the horizon.

    Raises
    ------
    ValueError
        If start..stop is not within the field, if the tracking method is unknown, or if a sun vector above the horizon
        is not finite.
    """
    sums = field_energies(field, tracking, sun, start, stop, np.ones(len(sun)), np.zeros(len(sun), np.int64), 1)
    return sums[:, 0, [0, 1, 2, 3, 5]], int(np.count_nonzero(sun[:, 2] > 0.0))


def field_energies(
    field: SortedField,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
    weight: Floats,
    period: Integers,
    periods: int,
) -> Floats:
    """Return weighted sums (energies) of the efficiencies over each period; parameters as in `field_sums`.

    Parameters
    ----------
    weight : ndarray, shape (T,)
        Weight of each instant, for example the irradiation of its interval.
    period : ndarray, shape (T,)
        Index of the period of each instant, from 0. Periods are, for example, months.
    periods : int
        Number of periods.

    Returns
    -------
    ndarray, shape (stop - start, periods, 7)
        Weighted sums over each period, in the unit of the weights, of seven quantities: the cosine, shading, blocking
        and optical efficiency; cosine times shading; cosine times shading times blocking; and cosine times the fraction
        that the tower does not shade.

    Raises
    ------
    ValueError
        As in `field_sums`, or if `weight` or `period` does not have one value for each instant, or if a period is not
        from 0 to periods - 1.
    """
    weight, period = np.array(weight, np.float64), np.array(period, np.int64)
    if weight.shape != (len(sun),) or period.shape != (len(sun),) or not np.all((period >= 0) & (period < periods)):
        raise ValueError(
            f"weights and periods must have shape ({len(sun)},), and periods must be from 0 to {periods - 1}"
        )
    sums = np.zeros((stop - start if stop > start else 0, periods, _QUANTITIES))
    _sweep(field, tracking, sun, start, stop, np.empty((4, 0, 0)), weight, period, sums)
    return sums


def field_series(field: SortedField, tracking: int, sun: Floats, start: int, stop: int) -> Floats:
    """Return the efficiencies at each instant, in the order of `sun`; parameters as in `field_sums`.

    Returns
    -------
    ndarray, shape (4, T, stop - start)
        Cosine, shading, blocking and optical efficiency; NaN if the sun is at or below the horizon. [1]
    """
    series = np.full((4, len(sun), stop - start if stop > start else 0), np.nan)
    weight, period = np.ones(len(sun)), np.zeros(len(sun), np.int64)
    _sweep(field, tracking, sun, start, stop, series, weight, period, np.empty((0, 0, 0)))
    return series


def _sweep(
    field: SortedField,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
    series: Floats,
    weight: Floats,
    period: Integers,
    sums: Floats,
) -> None:
    """Check the arguments, because compiled code does not check array bounds, and call `sweep`."""
    count = len(field.names)
    if np.ndim(sun) != 2 or np.shape(sun)[1] != 3 or not np.isfinite(sun[sun[:, 2] > 0.0]).all():
        raise ValueError("sun vectors above the horizon must be finite, with shape (T, 3)")
    if not 0 <= start <= stop <= count:
        raise ValueError(f"heliostats {start}..{stop} are not within a field of {count}")
    if tracking not in (SPINNING_ELEVATION, AZIMUTH_ELEVATION):
        raise ValueError(f"unknown tracking method {tracking}")
    sun = np.array(sun, np.float64, order="C")  # a copy, because a read-only array would need another compilation
    up = np.flatnonzero(sun[:, 2] > 0.0)
    order, first = packet_order(sun[up])
    tests = np.flatnonzero((field.names >= start) & (field.names < stop))
    if len(tests) and len(up):
        rows = field.names[tests] - start
        order = up[order]
        turn = np.lexsort((period[order], np.repeat(np.arange(len(first) - 1), np.diff(first))))
        sweep(
            field.mirrors, field.cells, field.tower, tracking, sun, order, first, turn, tests, rows, series, weight,
            period, sums,
        )  # fmt: skip


#: Number of sums for each heliostat and period.
_QUANTITIES = 7
#: `_TOGETHER`: Maximum number of packets whose candidates are searched together. Each packet tests these candidates.
#: `_WIDEST`: Maximum sine of the half-angle of the directions in these packets.
#: The sine `_WIDEST` is relative to the sine of the lowest elevation.
_TOGETHER, _WIDEST = 8, 8.0
#: Number of frames of full packets after which all frames are discarded, because more would not fit in the cache.
_KEPT = 1000


class Lines(NamedTuple):
    """Values for one packet and one test heliostat, in rows with one element per lane, and mirror frames."""

    #: Unit vectors to the sun and to the target of the test heliostat. [1]
    to_sun: Floats
    to_target: Floats
    #: Projection axes U and V for the direction to the sun or to the target. [1/m]
    views: Floats
    #: Shaded area, blocked area, and area that is shaded or blocked, on the square of area 4.
    total: Floats
    #: Weight of each lane.
    weight: Floats
    #: Weighted cosine, shading, blocking and optical efficiency; cosine times shading; cosine times shading times
    #: blocking; and cosine times the fraction that the tower does not shade.
    result: Floats
    #: Frames of mirrors, see `packets.write_frame`. [m]
    frames: Floats
    #: Offset of each heliostat's frame in `frames`, -1 if the frame has not been computed.
    place: Integers


@kernel
def sweep(
    mirrors: Mirrors,
    cells: Cells,
    tower: Floats,
    tracking: int,
    sun: Floats,
    order: Integers,
    first: Integers,
    turn: Integers,
    tests: Integers,
    names: Integers,
    series: Floats,
    weight: Floats,
    period: Integers,
    sums: Floats,
) -> None:
    """Write the weighted efficiencies of the test heliostats to `series`, and add them to `sums`.

    Parameters
    ----------
    mirrors, cells : Mirrors, Cells
        Sorted mirrors and grid cells, from `packets.by_cells`.
    tower : ndarray, shape (2,)
        Radius and top height of the tower; 0 if there is no tower. [m]
    tracking : int
        Code of the tracking method.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    order, first : ndarray
        Packets, from `packets.packet_order`.
    turn : ndarray
        Sequence in which instants are summed: indices of `order`, packet by packet, sorted by period.
    tests, names : ndarray, shape (n,)
        Indices of the test heliostats in the sorted field, and their rows in the results.
    series : ndarray, shape (4, T, n), or (4, 0, 0) if no series is written
        Cosine, shading, blocking and optical efficiency, times the weight. [1]
    weight, period : ndarray, shape (T,)
        Weight and period of each instant.
    sums : ndarray, shape (n, P, 7), or (n, 0, 7) if nothing is summed
        Weighted sums over each period of the seven quantities that `field_energies` returns.
    """
    count = mirrors.throw.shape[0]
    # The arrays hold 16 images. Unused rows of `frames` do not occupy memory.
    found, place, frames = np.empty(count + 1, np.int64), np.empty(count, np.int64), rows((_KEPT + 18) * 7)
    lines, images, room = (
        Lines(rows(3), rows(3), rows(6), rows(3), rows(1), rows(_QUANTITIES), frames, place),
        images_of(16),
        room_for(16),
    )
    begins, ends = np.zeros(tests.shape[0] + 1, np.int64), np.zeros(tests.shape[0] + 1, np.int64)
    bundle, last, shaders = beam(sun, order[:1]), 0, np.empty(2 * count, np.int64)
    blockers = _candidates(tests, bundle, True, mirrors, cells, np.empty(2 * count, np.int64), begins)
    for p in range(first.shape[0] - 1):
        packet = order[first[p] : first[p + 1]]
        lanes = -(-packet.shape[0] // GROUP) * GROUP
        for k in range(lanes):  # the last instant is repeated until its group is full
            when = packet[min(k, packet.shape[0] - 1)]
            lines.weight[k] = weight[when]
            for c in range(3):
                lines.to_sun[c * ROW + k] = sun[when, c]
        t, bundle = 0, beam(sun, packet)
        if p == last:  # list the candidates of several packets together
            whole, last = bundle, p + 1
            while last < min(p + _TOGETHER, first.shape[0] - 1):
                wider = beam(sun, order[first[p] : first[last + 1]])
                if not wider.narrow or wider.sine > _WIDEST * wider.low:
                    break
                whole, last = wider, last + 1
            shaders = _candidates(tests, whole, False, mirrors, cells, shaders, ends)
        while t < tests.shape[0]:
            t, most = _sweep_packet(
                t, tests, bundle, mirrors, tower, tracking, found, shaders, ends, blockers, begins, lines, images, room,
                order, first[p], first[p + 1], turn, names, series, period, sums,
            )  # fmt: skip
            if most > images.present.shape[0]:
                images, room, frames = images_of(2 * most), room_for(2 * most), rows((_KEPT + 2 * most + 2) * 7)
                lines = Lines(
                    lines.to_sun, lines.to_target, lines.views, lines.total, lines.weight, lines.result, frames, place
                )


@kernel
def _candidates(tests, bundle, blocking, mirrors, cells, names, begins):
    """List the heliostats that may shade each test heliostat for a bundle of sun directions, or that may block it.

    Returns the list in `names`, or in a longer array if `names` is too short. The part of the list for test heliostat t
    begins at ``begins[t]``.
    """
    t, limit = 0, np.inf
    while t < tests.shape[0]:
        if begins[t] + mirrors.throw.shape[0] > names.shape[0]:
            names, t = np.empty(2 * names.shape[0], np.int64), 0
        if blocking:
            bundle, limit = beam(mirrors.aim, tests[t : t + 1]), mirrors.throw[tests[t]]
        begins[t + 1] = begins[t] + search(tests[t], bundle, limit, mirrors, cells, names[begins[t] :])
        t += 1
    return names


@inner
def _sweep_packet(
    t, tests, bundle, mirrors, tower, tracking, found, shaders, ends, blockers, begins, lines, images, room, order,
    start, stop, turn, names, series, period, sums,
):  # fmt: skip
    """Compute a packet for the test heliostats from index t on.

    The function stops at a heliostat that needs larger scratch arrays, and returns its index and number of images.
    After the last heliostat, it returns the number of test heliostats and 0.
    """
    lanes, used = -(-(stop - start) // GROUP) * GROUP, np.int64(0)
    for m in range(lines.place.shape[0]):
        lines.place[m] = -1
    while t < tests.shape[0]:
        i = tests[t]
        count = np.int64(0)
        for m in range(ends[t], ends[t + 1]):
            found[count] = shaders[m]
            count += occludes(i, shaders[m], bundle, np.inf, mirrors)
        most = count + begins[t + 1] - begins[t] + 1
        if most > images.present.shape[0]:  # the scratch arrays are too small
            return t, most
        if used > _KEPT * (ROW // lanes):
            for m in range(lines.place.shape[0]):
                lines.place[m] = -1
            used = np.int64(0)
        for k in range(lanes):
            store(lines.to_target, 0, k, (mirrors.aim[i, 0], mirrors.aim[i, 1], mirrors.aim[i, 2]))
        used = _have_frame(i, mirrors, tracking, lines, used, lanes)
        shading = _shade_by_tower(i, mirrors, tower, lines, images, room, lanes)
        some = found[:count]
        shading, used = _make_images(i, some, mirrors, tracking, lines, lines.to_sun, images, shading, used, lanes)
        some = blockers[begins[t] : begins[t + 1]]
        made, used = _make_images(i, some, mirrors, tracking, lines, lines.to_target, images, shading, used, lanes)
        unions(images, shading, made, lines.total, room, lanes)
        row = lines.place[i] + COSINE  # read here, because the loop is vectorised only without this load
        for k in range(lanes):
            cosine, shading_efficiency = get(lines.frames, row, k), _left(get(lines.total, 0, k))
            blocking_efficiency, one = _left(get(lines.total, ROW, k)), get(lines.weight, 0, k)
            put(lines.result, 0, k, one * cosine)
            put(lines.result, ROW, k, one * shading_efficiency)
            put(lines.result, 2 * ROW, k, one * blocking_efficiency)
            put(lines.result, 3 * ROW, k, one * (cosine * _left(get(lines.total, 2 * ROW, k))))
            put(lines.result, 4 * ROW, k, one * (cosine * shading_efficiency))
            put(lines.result, 5 * ROW, k, one * (cosine * shading_efficiency * blocking_efficiency))
            put(lines.result, 6 * ROW, k, one * (cosine * get(lines.result, 6 * ROW, k)))
        for c in range(4 if series.shape[2] > 0 else 0):
            for k in range(stop - start):
                series[c, order[start + k], names[t]] = lines.result[c * ROW + k]
        if sums.shape[1] > 0:
            _add_to_sums(lines.result, order, start, stop, turn, period, sums[names[t]])
        t += 1
    return t, 0


@inline
def _frame(count, lanes):
    """Return the offset of frame number `count` in the array of frames.

    Frames of short packets share rows, so that more frames fit in the cache.
    """
    side = ROW // lanes
    return count // side * FRAME + count % side * lanes


@inner
def _shade_by_tower(i, mirrors, tower, lines, images, room, lanes):
    """Write the fraction of heliostat i that the tower does not shade; return the number of tower images (0 or 1)."""
    made = np.int64(0)
    if tower[0] > 0.0:
        base = -mirrors.centre[i, 0], -mirrors.centre[i, 1], -mirrors.centre[i, 2]
        write_axes(lines.views, lines.frames, lines.place[i], lines.to_sun, lanes)
        made += project_tower(
            images, 0, lines.views, lines.frames, lines.place[i], lines.to_sun, base, mirrors.radius[i], tower, lanes
        )
        unions(images, made, made, lines.total, room, lanes)
    for k in range(lanes):
        put(lines.result, 6 * ROW, k, _left(get(lines.total, 0, k)) if tower[0] > 0.0 else 1.0)
    return made


@inner
def _have_frame(j, mirrors, tracking, lines, used, lanes):
    """Compute the frame of heliostat j if it is missing; return the number of computed frames."""
    if lines.place[j] >= 0:
        return used
    lines.place[j] = _frame(used, lanes)
    write_frame(lines.frames, lines.place[j], lines.to_sun, mirrors, j, tracking, lanes)
    return used + 1


@inner
def _make_images(i, candidates, mirrors, tracking, lines, directions, images, made, used, lanes):
    """Project candidates onto heliostat i, from image `made` on; return the numbers of images and frames."""
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
    """Return the fraction of the mirror outside a union, clamped to the range 0 to 1 because of rounding."""
    return min(1.0, max(0.0, 1.0 - covered / SQUARE))


@inner
def _add_to_sums(result, order, start, stop, turn, period, sums):
    """Add the results of one heliostat in one packet to the heliostat's sums over each period."""
    n = start
    while n < stop:
        when = period[order[turn[n]]]
        a, b, c, d, e, f, g = (sums[when, 0], sums[when, 1], sums[when, 2], sums[when, 3], sums[when, 4], sums[when, 5],
                               sums[when, 6])  # fmt: skip
        while n < stop and period[order[turn[n]]] == when:
            k = turn[n] - start
            a, b, c, d = (
                a + get(result, 0, k),
                b + get(result, ROW, k),
                c + get(result, 2 * ROW, k),
                d + get(result, 3 * ROW, k),
            )
            e, f, g = e + get(result, 4 * ROW, k), f + get(result, 5 * ROW, k), g + get(result, 6 * ROW, k)
            n += 1
        sums[when, 0], sums[when, 1], sums[when, 2], sums[when, 3] = a, b, c, d
        sums[when, 4], sums[when, 5], sums[when, 6] = e, f, g


#: Maximum number of corners of an outline: 4, plus 1 from the plane of the mirror and 1 from each of its 4 edges.
OUTLINE_CORNERS = 9


@kernel
def _outlines(
    mirrors: Mirrors,
    cells: Cells,
    tracking: int,
    sun: Floats,
    tests: Integers,
    places: Integers,
    names: Integers,
    corners: Floats,
    whole: Floats,
) -> None:
    """Write the corners of each image to `corners`, and its area and heliostat to `whole`.

    The last row of `whole` contains the number of images. `corners` has the shape of `Outlines.corners`, `sun` has
    shape (1, 3), and `whole` has shape (tests, 2, images + 1, 2).
    """
    to_sun = rows(3)
    frames, views, to_target, images, only = rows(14), rows(6), rows(3), images_of(1), np.zeros(1, np.int64)
    square, pieces, found = np.empty(8), np.empty(6 * (OUTLINE_CORNERS + 4)), np.empty(names.shape[0] + 1, np.int64)
    write_square(square, 0)
    for c in range(3):
        to_sun[c * ROW] = sun[0, c]
    for t in range(tests.shape[0]):
        i = tests[t]
        write_frame(frames, 0, to_sun, mirrors, i, tracking, 1)
        for c in range(3):
            to_target[c * ROW] = mirrors.aim[i, c]
        for e in range(2):
            direction, limit = (to_sun, np.inf) if e == 0 else (to_target, mirrors.throw[i])
            bundle = beam(sun, only) if e == 0 else beam(mirrors.aim, tests[t : t + 1])
            write_axes(views, frames, 0, direction, 1)
            for m in range(search(i, bundle, limit, mirrors, cells, found)):
                j = found[m]
                way, reach = offset(mirrors, i, j), mirrors.radius[i] + mirrors.radius[j]
                apart = dot(way, way) > reach * reach * (1.0 + 1e-12)
                write_frame(frames, FRAME, to_sun, mirrors, j, tracking, 1)
                if project(images, 0, views, frames, FRAME, 0, direction, way, apart, 1):
                    piece, count = within(pieces, 0, outline(images, 0, 0, pieces, 0), square, 0, 4)
                    half = mirrors.half[i, 0], mirrors.half[i, 1]
                    _insert(pieces, piece, count, names[j], half, corners[places[t], e], whole[places[t], e])


@kernel
def _insert(pieces, piece, count, j, half, corners, whole):
    """Insert an image into the kept images of a mirror, in descending order of area."""
    size, last = area(pieces, piece, count) / SQUARE * 4.0 * half[0] * half[1], whole.shape[0] - 1
    if size <= 0.0:
        return
    place = min(int(whole[last, 0]), last)
    whole[last, 0] += 1.0
    while place > 0 and whole[place - 1, 0] < size:
        place -= 1
    if place < last:
        for m in range(last - 1, place, -1):
            corners[m], whole[m] = corners[m - 1], whole[m - 1]
        corners[place] = np.nan
        whole[place, 0], whole[place, 1] = size, j
        for k in range(count):
            for c in range(2):
                corners[place, k, c] = pieces[piece + 2 * k + c] * half[c]


class Outlines(NamedTuple):
    """Shadows (index 0) and blocked parts (index 1) on mirrors, largest areas first; NaN if there are fewer images."""

    #: Corners along width and height, from the mirror's centre, shape (tests, 2, images, OUTLINE_CORNERS, 2). [m]
    corners: Floats
    #: Area of each image, shape (tests, 2, images). [m2]
    area: Floats
    #: Number of the heliostat that shades or blocks, shape (tests, 2, images).
    heliostat: Floats
    #: Total number of images, including images that are not kept, shape (tests, 2).
    total: Floats


def mirror_outlines(
    x: Floats,
    y: Floats,
    z: Floats,
    half_width: Floats,
    half_height: Floats,
    target_height: float | Floats,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
    images: int,
) -> Outlines:
    """Return outlines of shadows and blocked parts on mirrors start..stop for one sun direction.

    Parameters
    ----------
    x, y, z, half_width, half_height, target_height, tracking, start, stop
        As in `sorted_field` and `field_sums`.
    sun : ndarray, shape (3,)
        Unit vector to the sun: east, north, up. All results are NaN if the sun is at or below the horizon. [1]
    images : int
        Maximum number of shadows, and of blocked parts, on each mirror. Images with the smallest areas are omitted.
    """
    (mirrors, cells, names), count = by_cells(aimed(x, y, z, half_width, half_height, target_height)), stop - start
    corners, whole = np.full((count, 2, images, OUTLINE_CORNERS, 2), np.nan), np.full((count, 2, images + 1, 2), np.nan)
    if count and sun[2] > 0:
        whole[:, :, -1] = 0.0
        tests = np.flatnonzero((names >= start) & (names < stop))
        _outlines(
            mirrors,
            cells,
            tracking,
            np.array(sun, np.float64, ndmin=2),
            tests,
            names[tests] - start,
            names,
            corners,
            whole,
        )
    return Outlines(corners, whole[:, :, :-1, 0], whole[:, :, :-1, 1], whole[:, :, -1, 0])


def warm_field(outlines: bool = False) -> None:
    """Compile the field kernels or load them from the cache, optionally including the shadow outline kernel."""
    place, side = np.array([10.0, 30.0]), np.ones(2)
    sun = np.array([[0.0, 0.0, 1.0]])
    field_sums(sorted_field(place, place, side, side, side, 50.0), 0, sun, 0, 2)
    if outlines:
        mirror_outlines(place, place, side, side, side, 50.0, 0, sun[0], 0, 2, 1)

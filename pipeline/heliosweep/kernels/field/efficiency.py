"""Cosine, shading, blocking and optical efficiencies of heliostats, summed over periods or at each instant.

Instants with similar sun directions are grouped into packets. For each packet and heliostat, `_sweep` finds the
heliostats that may shade or block it, projects them onto the mirror, and computes the area of the union of their
images. The frame of a mirror is computed only when it is first needed.

The results for a heliostat at an instant are bitwise identical, no matter how heliostats and instants are divided among
calls. Rounding errors in sums depend on the order of the packets, which is determined by the sun vectors alone.

Outlines of shadows and blocked parts are images of other mirrors, clipped to the test mirror.
"""

import itertools
from typing import NamedTuple

import numpy as np

from heliosweep.kernels.compiled import Floats, Integers, inline, inner, kernel
from heliosweep.kernels.field.packets import (
    AZIMUTH_ELEVATION,
    COSINE,
    FRAME,
    SPINNING_ELEVATION,
    Beam,
    Cells,
    Mirrors,
    beams,
    by_cells,
    cone,
    occludes,
    packet_order,
    search,
    write_frame,
)
from heliosweep.kernels.field.unions import (
    CORNERS,
    IMAGES,
    RESULT,
    SQUARE,
    TO_TARGET,
    TOTAL,
    WEIGHT,
    area,
    outline,
    project,
    project_tower,
    unions,
    within,
    write_axes,
    write_square,
)
from heliosweep.kernels.vectors import GROUP, ROW, get, larger, put, rows, smaller, store


class SortedField(NamedTuple):
    """The mirrors of a field, sorted by grid cell."""

    mirrors: Mirrors
    cells: Cells
    #: Original index of each sorted heliostat.
    names: Integers
    #: Radius and top height of the tower at x = y = 0 that shades the mirrors; both 0 without a tower. [m]
    tower: Floats


def aimed(
    x: Floats, y: Floats, z: Floats, half_width: Floats, half_height: Floats, target_height: float | Floats
) -> Mirrors:
    """Return mirrors that aim at (0, 0, target_height) or at individual points; parameters as in `sorted_field`."""
    centre, half = np.stack((x, y, z), axis=1).astype(float), np.stack((half_width, half_height), axis=1).astype(float)
    to_target = (target_height if np.ndim(target_height) else np.array([0.0, 0.0, target_height])) - centre
    throw = np.sqrt(to_target[:, 0] ** 2 + to_target[:, 1] ** 2 + to_target[:, 2] ** 2)
    radius = np.sqrt(half[:, 0] ** 2 + half[:, 1] ** 2)
    with np.errstate(invalid="ignore"):  # `sorted_field` rejects mirrors at their target
        aim = to_target / throw[:, np.newaxis]
    return Mirrors(np.column_stack((centre, radius)), np.column_stack((half, aim, throw)))


def sorted_field(
    x: Floats, y: Floats, z: Floats, half_width: Floats, half_height: Floats, target_height: float | Floats,
    tower: tuple[float, float] | None = None,
) -> SortedField:  # fmt: skip
    """Sort the mirrors of a field by grid cell.

    One sorted field can be used in several calls of `field_sums`, `field_energies` and `field_series`.

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
    cells, names = by_cells(mirrors.spheres)
    tower_size = np.array(tower or (0.0, 0.0), np.float64)
    return SortedField(Mirrors(*(each[names] for each in mirrors)), cells, names, tower_size)


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
        Range of heliostats to compute. Heliostats outside this range also shade and block.

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
        If the range from `start` to `stop` is not within the field, if the tracking method is unknown, or if a sun
        vector above the horizon is not finite.
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
        Index of the period (for example, the month) of each instant, from 0.
    periods : int
        Number of periods.

    Returns
    -------
    ndarray, shape (stop - start, periods, 7)
        Weighted sums of seven quantities over each period, in the unit of the weights: the cosine, shading, blocking
        and optical efficiencies; cosine times shading; cosine times shading times blocking; and cosine times the
        fraction that the tower does not shade.

    Raises
    ------
    ValueError
        As in `field_sums`, if `weight` or `period` does not have one value for each instant, or if a period index is
        outside the range 0 to periods - 1.
    """
    weight, period = np.array(weight, np.float64), np.array(period, np.int64)
    if weight.shape != (len(sun),) or period.shape != (len(sun),) or not np.all((period >= 0) & (period < periods)):
        raise ValueError(
            f"weights and periods must have shape ({len(sun)},), and periods must be from 0 to {periods - 1}"
        )
    return _sweep(field, tracking, sun, start, stop, weight, period, (periods, 7))


def field_series(field: SortedField, tracking: int, sun: Floats, start: int, stop: int) -> Floats:
    """Return the efficiencies at each instant, in the order of `sun`; parameters as in `field_sums`.

    Returns
    -------
    ndarray, shape (4, T, stop - start)
        Cosine, shading, blocking and optical efficiencies; NaN if the sun is at or below the horizon. [1]
    """
    series = _sweep(field, tracking, sun, start, stop, np.ones(len(sun)), np.arange(len(sun)), (len(sun), 4))
    series[:, ~(sun[:, 2] > 0.0)] = np.nan
    return np.moveaxis(series, 2, 0).swapaxes(1, 2)


#: `_TOGETHER`: Maximum number of packets that share one search for candidates.
#: `_WIDEST`: Maximum ratio sin(half-angle) / sin(minimum elevation) of the sun directions in these packets.
_TOGETHER, _WIDEST = 8, 8.0
#: Number of frames of full packets that fit in the cache. All frames are discarded when this number is exceeded.
_KEPT = 1000


def _sweep(
    field: SortedField,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
    weight: Floats,
    period: Integers,
    shape: tuple[int, int],
) -> Floats:
    """Return weighted sums of four or seven quantities for each heliostat and period.

    `shape` contains the number of periods and the number of quantities. The arguments are checked here because compiled
    code does not check array bounds.
    """
    count = len(field.names)
    if np.ndim(sun) != 2 or np.shape(sun)[1] != 3 or not np.isfinite(sun[sun[:, 2] > 0.0]).all():
        raise ValueError("sun vectors above the horizon must be finite, with shape (T, 3)")
    if not 0 <= start <= stop <= count:
        raise ValueError(f"heliostats {start}..{stop} are not within a field of {count}")
    if tracking not in (SPINNING_ELEVATION, AZIMUTH_ELEVATION):
        raise ValueError(f"unknown tracking method {tracking}")
    sums = np.zeros((stop - start, *shape))
    flat = sums.reshape(-1)
    up = np.flatnonzero(sun[:, 2] > 0.0)
    tests = np.flatnonzero((field.names >= start) & (field.names < stop))
    if not (len(tests) and len(up)):
        return sums
    order, first = packet_order(sun[up])
    sun, weight, period = sun[up[order]], weight[up[order]], period[up[order]]
    packet = np.repeat(np.arange(len(first) - 1), np.diff(first))
    turn = np.lexsort((period, packet))  # sum packet by packet, and by period within a packet
    when, lane, width = period[turn] * shape[1], turn - first[packet], shape[1]
    begins, ends = np.zeros(len(tests) + 1, np.int64), np.zeros(len(tests) + 1, np.int64)
    bundles = {size: beams(sun, np.append(first[:-1:size], first[-1])) for size in (1, _TOGETHER)}
    blockers = _candidates(field, tests, bundles[1][0], True, np.empty(2 * count, np.int64), begins)
    shaders, place, room, last = np.empty(2 * count, np.int64), np.empty(count, np.int64), 0, 0
    images = 32  # maximum number of images on a mirror; doubled if necessary
    rank = (field.names[tests] - start) * (shape[0] * shape[1])
    for p, (begin, end) in enumerate(itertools.pairwise(first)):
        if p == last:  # list the candidates of several packets together
            bundle, last = bundles[_TOGETHER][p // _TOGETHER], p + _TOGETHER
            if p % _TOGETHER or not bundle.narrow or bundle.sine > _WIDEST * bundle.low:
                bundle, last = bundles[1][p], p + 1
            shaders = _candidates(field, tests, bundle, False, shaders, ends)
            most = int((np.diff(begins) + np.diff(ends)).max()) + 1  # plus the image of the tower
            if most > room:
                room = 2 * most
                lines, frames = rows(IMAGES // ROW + 10 * room), rows((_KEPT + room + 2) * 7)
                marks, polygons, pieces = _room_for(images, room)
        here = np.arange(begin, end + (begin - end) % GROUP).clip(max=end - 1)  # the last instant is repeated
        lines[: 3 * ROW].reshape(3, ROW)[:, : len(here)] = sun[here].T
        lines[WEIGHT : WEIGHT + len(here)] = weight[here]
        done = 0
        while done < len(tests):
            done = _sweep_packet(
                done, bundles[1][p], len(here), field.mirrors.spheres, field.mirrors.mounts, field.tower, tracking,
                tests, rank, shaders, ends, blockers, begins, lines, frames, place, marks, polygons, pieces,
                lane[begin:end], when[begin:end], flat, width,
            )  # fmt: skip
            if done < len(tests):
                images *= 2
                marks, polygons, pieces = _room_for(images, room)
    return sums


def _room_for(images: int, candidates: int) -> tuple[Integers, Floats, Floats]:
    """Return the scratch arrays `marks`, `polygons` and `pieces` of `unions` for up to `images` images."""
    # each image may add up to 5 corners to a piece
    pieces = np.empty((images + 1) * 6 * (4 + CORNERS * (images + 2)) + 64)
    return np.empty((images + 4, candidates), np.int64), np.empty(images * 2 * CORNERS), pieces


def _candidates(
    field: SortedField, tests: Integers, bundle: Beam, blocking: bool, names: Integers, begins: Integers
) -> Integers:
    """List the heliostats that may block each test heliostat, or shade it in a bundle of sun directions.

    Returns the list in `names`, or in a longer array if `names` is too short. The candidates for test heliostat t start
    at ``begins[t]``.
    """
    while not _list_candidates(*field.mirrors, field.cells, tests, bundle, blocking, names, begins):
        names = np.empty(2 * len(names), np.int64)
    return names


@kernel
def _list_candidates(spheres, mounts, cells, tests, bundle, blocking, names, begins):
    """Write the list of `_candidates`; return False if `names` is too short."""
    limit = np.inf
    for t in range(tests.shape[0]):
        i = tests[t]
        if begins[t] + spheres.shape[0] > names.shape[0]:
            return False
        if blocking:
            bundle, limit = cone(mounts[i, 2], mounts[i, 3], mounts[i, 4], 0.0), mounts[i, 5]
        begins[t + 1] = search(i, bundle, limit, spheres, cells, names, begins[t])
    return True


@kernel
def _sweep_packet(
    done, bundle, lanes, spheres, mounts, tower, tracking, tests, rank, shaders, ends, blockers, begins, lines, frames,
    place, marks, polygons, pieces, lane, when, sums, width,
):  # fmt: skip
    """Add the weighted efficiencies of the test heliostats at the instants of a packet to `sums`.

    Returns the number of finished test heliostats. This number is less than n if the images of the next test heliostat
    do not fit in `marks` and `pieces`.

    Parameters
    ----------
    done
        Number of test heliostats that earlier calls finished for this packet.
    bundle, lanes
        Sun directions of the packet, and number of lanes.
    spheres, mounts, tower, tracking
        Fields of `Mirrors` and `SortedField`, and the code of the tracking method.
    tests, rank : ndarray, shape (n,)
        Index of each test heliostat in the sorted field, and index of its first element in `sums`.
    shaders, ends, blockers, begins
        Candidates for shading (shared by several packets) and for blocking, from `_candidates`.
    lines, marks, polygons, pieces
        Scratch arrays; see `unions`. `lines` contains the sun directions and the weights.
    frames : ndarray
        Mirror frames; see `packets.write_frame`. [m]
    place : ndarray, shape (N,)
        Offset of the frame of each heliostat in `frames`, -1 if the frame has not been computed.
    lane, when : ndarray
        Lane of each instant, and offset of its period in the sums of a heliostat, in summation order.
    sums : ndarray
        Weighted sums of the first `width` (4 or 7) quantities that `field_energies` returns.
    """
    used = _KEPT * ROW  # discard the frames of the previous packet
    for t in range(done, tests.shape[0]):
        i = tests[t]
        if used > _KEPT * (ROW // lanes):
            for j in range(place.shape[0]):
                place[j] = -1
            used = 0
        for k in range(lanes):
            store(lines, TO_TARGET, k, (mounts[i, 2], mounts[i, 3], mounts[i, 4]))
        used = _have_frame(i, mounts, tracking, lines, frames, place, used, lanes)
        write_axes(lines, frames, place[i], 0, lanes)
        made = _shade_by_tower(i, spheres, tower, lines, frames, place, marks, polygons, pieces, lanes)
        for m in range(ends[t], ends[t + 1]):
            j = shaders[m]
            if occludes(i, j, bundle, np.inf, spheres):
                used = _have_frame(j, mounts, tracking, lines, frames, place, used, lanes)
                made += project(lines, marks, made, frames, place[j], place[i], 0, spheres, i, j, lanes)
        shading = made
        write_axes(lines, frames, place[i], TO_TARGET, lanes)
        for m in range(begins[t], begins[t + 1]):
            j = blockers[m]
            used = _have_frame(j, mounts, tracking, lines, frames, place, used, lanes)
            made += project(lines, marks, made, frames, place[j], place[i], TO_TARGET, spheres, i, j, lanes)
        if made + 4 > marks.shape[0]:
            return t
        unions(lines, marks, polygons, pieces, shading, made, lanes)
        row = place[i] + COSINE  # read outside the loop, because this load would prevent vectorisation
        for k in range(lanes):
            cosine, shading_efficiency = get(frames, row, k), _left(get(lines, TOTAL, k))
            blocking_efficiency, one = _left(get(lines, TOTAL + ROW, k)), get(lines, WEIGHT, k)
            put(lines, RESULT, k, one * cosine)
            put(lines, RESULT + ROW, k, one * shading_efficiency)
            put(lines, RESULT + 2 * ROW, k, one * blocking_efficiency)
            put(lines, RESULT + 3 * ROW, k, one * (cosine * _left(get(lines, TOTAL + 2 * ROW, k))))
            put(lines, RESULT + 4 * ROW, k, one * (cosine * shading_efficiency))
            put(lines, RESULT + 5 * ROW, k, one * (cosine * shading_efficiency * blocking_efficiency))
            put(lines, RESULT + 6 * ROW, k, one * (cosine * get(lines, RESULT + 6 * ROW, k)))
        _add_to_sums(lines, lane, when, sums, rank[t], width)
    return tests.shape[0]


@inline
def _frame(count, lanes):
    """Return the offset of frame number `count` in the array of frames.

    Frames of short packets share rows, so more frames fit in the cache.
    """
    side = ROW // lanes
    return count // side * FRAME + count % side * lanes


@inner
def _shade_by_tower(i, spheres, tower, lines, frames, place, marks, polygons, pieces, lanes):
    """Write the fraction of heliostat i that the tower does not shade; return the number of tower images (0 or 1)."""
    made = np.int64(0)
    if tower[0] > 0.0:
        base = -spheres[i, 0], -spheres[i, 1], -spheres[i, 2]
        made += project_tower(lines, marks, frames, place[i], base, spheres[i, 3], tower, lanes)
        unions(lines, marks, polygons, pieces, made, made, lanes)
    for k in range(lanes):
        put(lines, RESULT + 6 * ROW, k, _left(get(lines, TOTAL, k)) if tower[0] > 0.0 else 1.0)
    return made


@inner
def _have_frame(j, mounts, tracking, lines, frames, place, used, lanes):
    """Compute the frame of heliostat j if it is missing; return the updated number of frames."""
    if place[j] >= 0:
        return used
    place[j] = _frame(used, lanes)
    write_frame(frames, place[j], lines, mounts, j, tracking, lanes)
    return used + 1


@inline
def _left(covered):
    """Return the fraction of the mirror outside a union, clamped to [0, 1] because of rounding errors."""
    return smaller(larger(1.0 - covered / SQUARE, 0.0), 1.0)


@inner
def _add_to_sums(lines, lane, when, sums, row, width):
    """Add a heliostat's results in a packet to its sums over each period, which start at index `row`."""
    n = 0
    while n < lane.shape[0]:
        period, e, f, g = when[n], 0.0, 0.0, 0.0
        o = row + period
        a, b, c, d = get(sums, o, 0), get(sums, o, 1), get(sums, o, 2), get(sums, o, 3)
        if width > 4:
            e, f, g = get(sums, o, 4), get(sums, o, 5), get(sums, o, 6)
        while n < lane.shape[0] and when[n] == period:
            k = lane[n]
            a, b = a + get(lines, RESULT, k), b + get(lines, RESULT + ROW, k)
            c, d = c + get(lines, RESULT + 2 * ROW, k), d + get(lines, RESULT + 3 * ROW, k)
            e, f = e + get(lines, RESULT + 4 * ROW, k), f + get(lines, RESULT + 5 * ROW, k)
            g += get(lines, RESULT + 6 * ROW, k)
            n += 1
        put(sums, o, 0, a)
        put(sums, o, 1, b)
        put(sums, o, 2, c)
        put(sums, o, 3, d)
        if width > 4:
            put(sums, o, 4, e)
            put(sums, o, 5, f)
            put(sums, o, 6, g)


#: Maximum number of corners of an outline: 4, plus 1 for the plane of the test mirror, plus 1 for each of its 4 edges.
OUTLINE_CORNERS = 9


@kernel
def _outlines(
    spheres, mounts, tracking, direction, tests, places, names, candidates, begins, lines, frames, marks, square,
    pieces, corners, whole,
):  # fmt: skip
    """Write the corners of shadows or blocked parts to `corners`, and their areas and heliostats to `whole`.

    The last row of `whole` contains the number of images. `direction` is 0 for shadows and `TO_TARGET` for blocked
    parts.
    """
    write_square(square, 0)
    for t in range(tests.shape[0]):
        i = tests[t]
        write_frame(frames, 0, lines, mounts, i, tracking, 1)
        store(lines, TO_TARGET, 0, (mounts[i, 2], mounts[i, 3], mounts[i, 4]))
        write_axes(lines, frames, 0, direction, 1)
        for m in range(begins[t], begins[t + 1]):
            j = candidates[m]
            write_frame(frames, FRAME, lines, mounts, j, tracking, 1)
            if project(lines, marks, 0, frames, FRAME, 0, direction, spheres, i, j, 1):
                piece, count = within(pieces, 0, outline(lines, marks, 0, 0, pieces, 0), square, 0, 4)
                half = mounts[i, 0], mounts[i, 1]
                _insert(pieces, piece, count, names[j], half, corners[places[t]], whole[places[t]])


@kernel
def _insert(pieces, piece, count, j, half, corners, whole):
    """Insert an image into the stored images of a mirror, which are sorted by descending area."""
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
    """Outlines of shadows and blocked parts on mirrors, sorted by descending area.

    The second dimension selects shadows (0) or blocked parts (1). Unused elements are NaN.
    """

    #: Coordinates of corners along the width and height, relative to the mirror's centre [m],
    #: shape (tests, 2, images, OUTLINE_CORNERS, 2).
    corners: Floats
    #: Area of each image, shape (tests, 2, images). [m2]
    area: Floats
    #: Index of the shading or blocking heliostat, shape (tests, 2, images).
    heliostat: Floats
    #: Total number of images, including omitted images, shape (tests, 2).
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
        Maximum number of shadows and maximum number of blocked parts stored for each mirror. The smallest images are
        omitted.
    """
    field, count = sorted_field(x, y, z, half_width, half_height, target_height), stop - start
    corners, whole = np.full((2, count, images, OUTLINE_CORNERS, 2), np.nan), np.full((2, count, images + 1, 2), np.nan)
    if count and sun[2] > 0:
        whole[:, :, -1] = 0.0
        tests, lines = np.flatnonzero((field.names >= start) & (field.names < stop)), rows(IMAGES // ROW + 10)
        lines[: 3 * ROW : ROW] = sun
        (bundle,), begins = beams(np.array(sun, ndmin=2), np.arange(2)), np.zeros(len(tests) + 1, np.int64)
        for blocking in (False, True):
            candidates = _candidates(field, tests, bundle, blocking, np.empty(2 * len(field.names), np.int64), begins)
            _outlines(
                *field.mirrors, tracking, TO_TARGET if blocking else 0, tests, field.names[tests] - start, field.names,
                candidates, begins, lines, rows(14), np.empty((5, 1), np.int64), np.empty(8),
                np.empty(6 * (OUTLINE_CORNERS + 4)), corners[int(blocking)], whole[int(blocking)],
            )  # fmt: skip
    corners, whole = corners.swapaxes(0, 1), whole.swapaxes(0, 1)
    return Outlines(corners, whole[:, :, :-1, 0], whole[:, :, :-1, 1], whole[:, :, -1, 0])


def warm_field(outlines: bool = False) -> None:
    """Compile the field kernels or load them from the cache.

    The outline kernel is included if `outlines` is True.
    """
    place, side = np.array([10.0, 30.0]), np.ones(2)
    sun = np.array([[0.0, 0.0, 1.0]])
    field_sums(sorted_field(place, place, side, side, side, 50.0), 0, sun, 0, 2)
    if outlines:
        mirror_outlines(place, place, side, side, side, 50.0, 0, sun[0], 0, 2, 1)

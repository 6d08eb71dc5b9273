"""Cosine, shading, blocking and optical efficiency of heliostats in a field: annual sums, or every instant.

Instants are sorted into packets of similar sun directions. For each packet: find the candidates of every test
heliostat, compute the mirror frames of the heliostats named (block and halo, nothing else), then make the images and
their unions heliostat by heliostat. Every value of a heliostat and an instant has the same bits however heliostats and
instants are split over calls; sums also depend on the order of packets, which depends on the sun vectors alone.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.images import AXES_ROWS, IMAGE_ROWS, axes, image
from heliosweep.kernels.mounts import AZIMUTH_ELEVATION, COSINE, FRAME_ROWS, SPINNING_ELEVATION, Mirrors, half_sides
from heliosweep.kernels.neighbours import beam, bin_field, candidates, search, sift
from heliosweep.kernels.packets import GROUP, PACKET, packet_order, rows
from heliosweep.kernels.polygons import SQUARE
from heliosweep.kernels.unions import PAIRS, ROOM_ROWS, unions

__all__ = ["aimed", "field_series", "field_sums", "sweep"]

Floats = NDArray[np.float64]

_TOGETHER, _FEW = 8, 64.0
"""Packets whose candidates are searched for together, and candidates up to which that pays: each packet sifts them."""


def field_sums(
    x: Floats,
    y: Floats,
    z: Floats,
    half_width: Floats,
    half_height: Floats,
    target_height: float,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
) -> tuple[Floats, int]:
    """Sums of the efficiencies over all instants with the sun above the horizon.

    Parameters
    ----------
    x, y, z : ndarray, shape (N,)
        Mirror centres: east, north, up. [m]
    half_width, half_height : ndarray, shape (N,)
        Half sides of the mirrors along u (width) and v (height). [m]
    target_height : float
        Height of the target point, which stands at x = y = 0. [m]
    tracking : int
        `mounts.SPINNING_ELEVATION` or `mounts.AZIMUTH_ELEVATION`.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun: east, north, up. Instants with z <= 0, or
        NaN where there is none, contribute nothing and are not counted. [1]
    start, stop : int
        Test heliostats start..stop; all N may shade and block them.

    Returns
    -------
    sums : ndarray, shape (stop - start, 4)
        Sums of the cosine efficiency, the shading efficiency (1 - shaded fraction), the blocking efficiency
        (1 - blocked fraction) and the optical efficiency, cosine * (1 - fraction shaded or blocked). [1]
    instants : int
        Number of instants summed.

    Raises
    ------
    ValueError
        If start..stop is no part of the field, the method unknown, or mirrors or sun vectors are not finite.
    """
    mirrors = aimed(x, y, z, half_width, half_height, target_height)
    _check(mirrors, sun, tracking, start, stop)
    sun, order, first = _sorted(sun)
    sums, nothing = np.zeros((stop - start, 4)), np.empty((4, 0, 0))
    if start < stop and len(order) > 0:
        sweep(mirrors, tracking, sun, order, first, start, stop, sums, nothing)
    return sums, len(order)


def field_series(
    x: Floats,
    y: Floats,
    z: Floats,
    half_width: Floats,
    half_height: Floats,
    target_height: float,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
) -> Floats:
    """Efficiencies of every instant, in the given order; parameters as in `field_sums`.

    Returns
    -------
    ndarray, shape (4, T, stop - start)
        Cosine, shading, blocking and optical efficiency; NaN with the sun at or below the horizon. [1]
    """
    mirrors = aimed(x, y, z, half_width, half_height, target_height)
    _check(mirrors, sun, tracking, start, stop)
    sun, order, first = _sorted(sun)
    nothing, series = np.empty((0, 4)), np.full((4, len(sun), stop - start), np.nan)
    if start < stop and len(order) > 0:
        sweep(mirrors, tracking, sun, order, first, start, stop, nothing, series)
    return series


def aimed(x: Floats, y: Floats, z: Floats, half_width: Floats, half_height: Floats, target_height: float) -> Mirrors:
    """Mirrors aimed at the target point (0, 0, target_height); parameters as in `field_sums`."""
    centres = np.stack((x, y, z)).astype(np.float64)
    sides = np.stack((half_width, half_height)).astype(np.float64)
    to_target = np.array([0.0, 0.0, target_height]) - centres.T
    throw = np.sqrt(to_target[:, 0] ** 2 + to_target[:, 1] ** 2 + to_target[:, 2] ** 2)
    radius = np.sqrt(sides[0] ** 2 + sides[1] ** 2)
    with np.errstate(invalid="ignore"):  # at the target: refused by `_check`
        aim = np.ascontiguousarray(to_target / throw[:, None])  # one layout, also for one heliostat: one signature
    return Mirrors(centres[0], centres[1], centres[2], sides[0], sides[1], radius, aim, throw)


def _check(mirrors: Mirrors, sun: Floats, tracking: int, start: int, stop: int) -> None:
    """Refuse what compiled code would read past the end of an array for, or make numbers of that mean nothing."""
    count = len(mirrors.x)
    if not all(len(each) == count and np.isfinite(each).all() for each in mirrors):
        raise ValueError("centres and half sides must be as many finite numbers each, and no mirror at the target")
    if np.ndim(sun) != 2 or np.shape(sun)[1] != 3 or not np.isfinite(sun[sun[:, 2] > 0.0]).all():
        raise ValueError("sun vectors above the horizon must be finite, of shape (T, 3)")
    if not 0 <= start <= stop <= count:
        raise ValueError(f"heliostats {start}..{stop} are no part of a field of {count}")
    if tracking not in (SPINNING_ELEVATION, AZIMUTH_ELEVATION):
        raise ValueError(f"unknown tracking method {tracking}")


def _sorted(sun: Floats) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Sun vectors as the kernels want them, the instants with the sun up in packet order, and where packets begin."""
    sun = np.array(sun, np.float64, order="C")  # a copy: a read-only array would be compiled for anew
    up = np.flatnonzero(sun[:, 2] > 0.0)
    order, first = packet_order(sun[up])
    return sun, up[order], first


@kernel
def sweep(
    mirrors: Mirrors,
    tracking: int,
    sun: Floats,
    order: NDArray[np.int64],
    first: NDArray[np.int64],
    start: int,
    stop: int,
    sums: Floats,
    series: Floats,
) -> None:
    """Sweep instants packet by packet; add to `sums` and write to `series`, whichever has room for heliostats.

    Parameters
    ----------
    mirrors : Mirrors
        All heliostats of the field.
    tracking : int
        `mounts.SPINNING_ELEVATION` or `mounts.AZIMUTH_ELEVATION`.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    order : ndarray of int64
        Instants to sweep, in packet order; the sun is up in each.
    first : ndarray of int64
        Where each packet begins in `order`, and the length of `order`.
    start, stop : int
        Test heliostats start..stop.
    sums : ndarray, shape (stop - start, 4) or (0, 4)
        As returned by `field_sums`.
    series : ndarray, shape (4, T, stop - start) or (4, 0, 0)
        As returned by `field_series`.
    """
    tests = stop - start
    grid = bin_field(mirrors)
    blockers, first_blocker = _blockers(mirrors, grid, start, stop)
    wide, first_wide = np.empty(16 * tests, np.int64), np.zeros(tests + 1, np.int64)
    shaders, first_shader = np.empty(16 * tests, np.int64), np.zeros(tests + 1, np.int64)
    named, place = np.empty(mirrors.x.shape[0], np.int64), np.full(mirrors.x.shape[0], -1)
    frames, to_sun, to_target = rows(0), rows(3), rows(3)
    sun_axes, target_axes, total, result = rows(AXES_ROWS), rows(AXES_ROWS), rows(3), rows(4)
    images, apart, present = rows(0), np.empty(0, np.bool_), np.empty(0, np.int64)
    room, partner, meeting = rows(ROOM_ROWS), np.empty(PAIRS, np.int64), np.empty(PAIRS, np.int64)
    last, together = 0, False
    for p in range(first.shape[0] - 1):
        if p == last:  # the next packets: their candidates are among `wide` if there are several
            last, bundle = _together(p, sun, order, first, grid)
            together = last > p + 1
            for t in range(tests if together else 0):
                wide, first_wide[t + 1] = search(start + t, bundle, np.inf, mirrors, grid, wide, first_wide[t])
        packet = order[first[p] : first[p + 1]]
        lanes = _directions(sun, packet, to_sun)
        bundle = beam(to_sun, PACKET, packet.shape[0])
        for t in range(tests):
            i, found = start + t, first_shader[t]
            if together:
                a, b = first_wide[t], first_wide[t + 1]
                shaders, first_shader[t + 1] = sift(i, bundle, mirrors, wide, a, b, shaders, found)
            else:
                shaders, first_shader[t + 1] = search(i, bundle, np.inf, mirrors, grid, shaders, found)
        count = _named(start, stop, blockers, first_blocker[tests], shaders, first_shader[tests], named, place)
        if count * FRAME_ROWS * PACKET > frames.shape[0]:
            frames = rows((count + count // 4) * FRAME_ROWS)
        for m in range(count):
            half_sides(frames, m * FRAME_ROWS * PACKET, to_sun, mirrors, named[m], tracking, lanes)

        for t in range(tests):
            i, test = start + t, place[start + t] * FRAME_ROWS * PACKET
            pairs = first_shader[t + 1] - first_shader[t] + first_blocker[t + 1] - first_blocker[t]
            if pairs > apart.shape[0]:
                images, apart = rows(2 * pairs * IMAGE_ROWS), np.empty(2 * pairs, np.bool_)
                present = np.empty(2 * pairs, np.int64)
            axes(sun_axes, frames, test, to_sun, lanes)
            made = np.int64(0)
            for m in range(first_shader[t], first_shader[t + 1]):
                j = shaders[m]
                made += _image(i, j, mirrors, frames, place, sun_axes, to_sun, images, apart, present, made, lanes)
            shading = made
            _aim(to_target, mirrors, i, lanes)
            axes(target_axes, frames, test, to_target, lanes)
            for m in range(first_blocker[t], first_blocker[t + 1]):
                j = blockers[m]
                made += _image(
                    i, j, mirrors, frames, place, target_axes, to_target, images, apart, present, made, lanes
                )
            unions(images, apart, present, shading, made, total, room, partner, meeting, lanes)
            _efficiencies(frames, test + COSINE, total, result, lanes)
            _write(result, packet, t, sums, series)
        for m in range(count):
            place[named[m]] = -1


@kernel
def _blockers(mirrors, grid, start, stop):
    """Heliostats that may block each of the block, whatever the sun; and where those of each begin."""
    found, first = np.empty(4 * (stop - start), np.int64), np.zeros(stop - start + 1, np.int64)
    for i in range(start, stop):
        t = i - start
        bundle = beam(mirrors.aim[i], np.int64(1), np.int64(1))
        found, first[t + 1] = search(i, bundle, mirrors.throw[i], mirrors, grid, found, first[t])
    return found, first


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
        if last == p + 1 or candidates(bundle, grid) <= _FEW:
            return last, bundle
        last = p + (last - p) // 2


@kernel
def _directions(sun, packet, to_sun):
    """Write the sun vectors of a packet in rows, filled up to whole groups by the last; returns the lanes."""
    lanes = -(-packet.shape[0] // GROUP) * GROUP
    for k in range(lanes):
        when = packet[min(k, packet.shape[0] - 1)]
        for c in range(3):
            to_sun[c * PACKET + k] = sun[when, c]
    return lanes


@kernel
def _named(start, stop, blockers, blocking, shaders, shading, named, place):
    """Give a place to each heliostat that needs a frame: to the block and the halo that its candidates name."""
    count = np.int64(0)
    for i in range(start, stop):
        count = _name(i, named, place, count)
    for m in range(blocking):
        count = _name(blockers[m], named, place, count)
    for m in range(shading):
        count = _name(shaders[m], named, place, count)
    return count


@inline
def _name(j, named, place, count):
    """Give heliostat j a place among the frames of the packet, once; returns the number of places."""
    if place[j] < 0:
        place[j] = count
        named[count] = j
        count += 1
    return count


@inline
def _aim(to_target, mirrors, i, lanes):
    """Write the direction to the target in rows."""
    x, y, z = mirrors.aim[i, 0], mirrors.aim[i, 1], mirrors.aim[i, 2]
    for k in range(lanes):
        to_target[k], to_target[PACKET + k], to_target[2 * PACKET + k] = x, y, z


@inline
def _image(i, j, mirrors, frames, place, views, directions, images, apart, present, made, lanes):
    """Make the image of mirror j on mirror i the one numbered `made`; returns 1 if some lane has it, else 0."""
    dx, dy, dz = mirrors.x[j] - mirrors.x[i], mirrors.y[j] - mirrors.y[i], mirrors.z[j] - mirrors.z[i]
    reach = mirrors.radius[i] + mirrors.radius[j]
    apart[made] = dx * dx + dy * dy + dz * dz > reach * reach * (1.0 + 1e-12)
    test, other = place[i] * FRAME_ROWS * PACKET, place[j] * FRAME_ROWS * PACKET
    o = made * IMAGE_ROWS * PACKET
    present[made] = image(images, o, views, frames, other, test, directions, dx, dy, dz, apart[made], lanes)
    return np.int64(present[made] != 0)


@inline
def _efficiencies(frames, cosine, total, result, lanes):
    """Write the rows of results: cosine, shading, blocking and optical efficiency."""
    cosine = max(cosine, 0)
    for k in range(lanes):
        result[k] = frames[cosine + k]
        result[PACKET + k], result[2 * PACKET + k] = _left(total[k]), _left(total[PACKET + k])
        result[3 * PACKET + k] = frames[cosine + k] * _left(total[2 * PACKET + k])


@inline
def _left(covered):
    """Fraction of the mirror outside a union, without the rounding that would lead out of 0 to 1."""
    return min(1.0, max(0.0, 1.0 - covered / SQUARE))


@kernel
def _write(result, packet, t, sums, series):
    """Add the results of one heliostat and packet to `sums`, and write them to `series`, where there is room."""
    count = packet.shape[0]
    for c in range(4):
        if sums.shape[0] > 0:
            sums[t, c] += _sum(result, c * PACKET, count)
        if series.shape[2] > 0:
            for k in range(count):
                series[c, packet[k], t] = result[c * PACKET + k]


@kernel
def _sum(row, start, count):
    """Sum of a row, in a fixed order, of eight sums that a processor can make side by side."""
    a = b = c = d = e = f = g = h = 0.0
    whole = count // 8 * 8
    for k in range(start, start + whole, 8):
        a, b, c, d = a + row[k], b + row[k + 1], c + row[k + 2], d + row[k + 3]
        e, f, g, h = e + row[k + 4], f + row[k + 5], g + row[k + 6], h + row[k + 7]
    total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for k in range(start + whole, start + count):
        total += row[k]
    return total

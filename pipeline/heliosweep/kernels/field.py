"""Cosine, shading, blocking and optical efficiency of heliostats in a field: annual sums, or every instant.

Instants are sorted into packets of similar sun directions. For each packet: find the candidates of every test
heliostat, compute the mirror frames of the heliostats named (block and halo, nothing else), then make the images and
their unions heliostat by heliostat. Every value of a heliostat and an instant has the same bits however heliostats and
instants are split over calls; sums also depend on the order of packets, which depends on the sun vectors alone.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.images import IMAGE_ROWS, axes, cosines, image
from heliosweep.kernels.mounts import AZIMUTH_ELEVATION, FRAME_ROWS, SPINNING_ELEVATION, Mirrors, half_sides
from heliosweep.kernels.neighbours import beam, bin_field, search
from heliosweep.kernels.packets import PACKET, packet_order
from heliosweep.kernels.polygons import SQUARE
from heliosweep.kernels.unions import unions

__all__ = ["aimed", "field_series", "field_sums", "sweep"]

Floats = NDArray[np.float64]


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
        Unit vectors to the sun: east, north, up. Instants with z <= 0 contribute nothing and are not counted. [1]
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
        If start..stop is no part of the field, or the method unknown.
    """
    _check(len(x), tracking, start, stop)
    mirrors = aimed(x, y, z, half_width, half_height, target_height)
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
    _check(len(x), tracking, start, stop)
    mirrors = aimed(x, y, z, half_width, half_height, target_height)
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
    aim = np.ascontiguousarray(to_target / throw[:, None])  # one layout, also for one heliostat: one signature
    return Mirrors(centres[0], centres[1], centres[2], sides[0], sides[1], radius, aim, throw)


def _check(count: int, tracking: int, start: int, stop: int) -> None:
    """Refuse what compiled code would read past the end of an array."""
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
    blockers, first_blocker = np.empty(4 * tests, np.int64), np.zeros(tests + 1, np.int64)
    for t in range(tests):
        i = start + t
        blockers, first_blocker[t + 1] = search(
            i, beam(mirrors.aim[i], np.int64(1)), mirrors.throw[i], mirrors, grid, blockers, first_blocker[t]
        )

    shaders, first_shader = np.empty(16 * tests, np.int64), np.zeros(tests + 1, np.int64)
    named, place = np.empty(mirrors.x.shape[0], np.int64), np.full(mirrors.x.shape[0], -1)
    frames = np.empty((2 * tests, FRAME_ROWS * PACKET))
    images, apart = np.empty((8, IMAGE_ROWS * PACKET)), np.empty(8, np.bool_)
    lane, spare = np.empty(18 * PACKET, np.int64), np.empty(PACKET)
    rows, target = np.empty(3 * PACKET), np.empty(3 * PACKET)
    sun_axes, target_axes = np.empty(FRAME_ROWS * PACKET), np.empty(FRAME_ROWS * PACKET)
    cosine, total = np.empty(PACKET), np.empty(3 * PACKET)

    for p in range(first.shape[0] - 1):
        packet = order[first[p] : first[p + 1]]
        lanes = packet.shape[0]
        for k in range(lanes):
            for c in range(3):
                rows[c * PACKET + k] = sun[packet[k], c]
        bundle = beam(rows, lanes)
        for t in range(tests):
            shaders, first_shader[t + 1] = search(start + t, bundle, np.inf, mirrors, grid, shaders, first_shader[t])

        # Frames for the block and for the halo that its candidates name, nothing else.
        count = np.int64(0)
        for t in range(tests):
            count = _name(start + t, named, place, count)
        for m in range(first_blocker[tests]):
            count = _name(blockers[m], named, place, count)
        for m in range(first_shader[tests]):
            count = _name(shaders[m], named, place, count)
        if count > frames.shape[0]:
            frames = np.empty((count + count // 4, FRAME_ROWS * PACKET))
        for m in range(count):
            half_sides(frames[m], rows, mirrors, named[m], tracking, lanes)

        for t in range(tests):
            i = start + t
            test = frames[place[i]]
            for k in range(lanes):
                target[k] = mirrors.aim[i, 0]
                target[PACKET + k] = mirrors.aim[i, 1]
                target[2 * PACKET + k] = mirrors.aim[i, 2]
            cosines(cosine, rows, target, lanes)
            axes(sun_axes, test, cosine, rows, mirrors.half_width[i] * mirrors.half_height[i], lanes)
            axes(target_axes, test, cosine, target, mirrors.half_width[i] * mirrors.half_height[i], lanes)

            shade, block = (
                shaders[first_shader[t] : first_shader[t + 1]],
                blockers[first_blocker[t] : first_blocker[t + 1]],
            )
            if shade.shape[0] + block.shape[0] > images.shape[0]:
                room = 2 * (shade.shape[0] + block.shape[0])
                images, apart = np.empty((room, IMAGE_ROWS * PACKET)), np.empty(room, np.bool_)
                lane = np.empty((2 * room + 2) * PACKET, np.int64)
            shading = _images(i, shade, mirrors, frames, place, sun_axes, rows, images, apart, np.int64(0), lanes)
            made = _images(i, block, mirrors, frames, place, target_axes, target, images, apart, shading, lanes)
            unions(images, apart, shading, made, total, lane, spare, lanes)

            cosine_sum = shading_sum = blocking_sum = optical_sum = 0.0
            for k in range(lanes):
                unshaded, unblocked = _left(total[k]), _left(total[PACKET + k])
                optical = cosine[k] * _left(total[2 * PACKET + k])
                cosine_sum += cosine[k]
                shading_sum += unshaded
                blocking_sum += unblocked
                optical_sum += optical
                if series.shape[2] > 0:
                    when = packet[k]
                    series[0, when, t], series[1, when, t] = cosine[k], unshaded
                    series[2, when, t], series[3, when, t] = unblocked, optical
            if sums.shape[0] > 0:
                sums[t, 0] += cosine_sum
                sums[t, 1] += shading_sum
                sums[t, 2] += blocking_sum
                sums[t, 3] += optical_sum
        for m in range(count):
            place[named[m]] = -1


@inline
def _left(covered):
    """Fraction of the mirror outside a union, without the rounding that would lead out of 0 to 1."""
    return min(1.0, max(0.0, 1.0 - covered / SQUARE))


@kernel
def _name(j, named, place, count):
    """Give heliostat j a place among the frames of the packet, once; returns the number of places."""
    if place[j] < 0:
        place[j] = count
        named[count] = j
        count += 1
    return count


@kernel
def _images(i, candidates, mirrors, frames, place, views, directions, images, apart, made, lanes):
    """Append the images on mirror i that some lane has; returns their number."""
    test = frames[place[i]]
    for m in range(candidates.shape[0]):
        j = candidates[m]
        dx, dy, dz = mirrors.x[j] - mirrors.x[i], mirrors.y[j] - mirrors.y[i], mirrors.z[j] - mirrors.z[i]
        reach = mirrors.radius[i] + mirrors.radius[j]
        apart[made] = dx * dx + dy * dy + dz * dz > reach * reach * (1.0 + 1e-12)
        if image(images[made], views, frames[place[j]], directions, dx, dy, dz, apart[made], test, lanes):
            made += 1
    return made

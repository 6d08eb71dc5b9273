"""Cosine, shading, blocking and optical efficiency of heliostats in a field: annual sums, or every instant.

Instants are sorted into packets of similar sun directions. For each packet: find the candidates of every test
heliostat, compute the mirror frames of the heliostats named (block and halo, nothing else), then make the images and
their unions heliostat by heliostat. Every value of a heliostat and an instant has the same bits however heliostats and
instants are split over calls; sums also depend on the order of packets, which depends on the sun vectors alone.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.mounts import FRAME_ROWS, half_sides
from heliosweep.kernels.neighbours import beam, bin_field, search
from heliosweep.kernels.occlusion import IMAGE_ROWS, axes, cosines, image, unions
from heliosweep.kernels.packets import PACKET, packet_order
from heliosweep.kernels.polygons import SQUARE

__all__ = ["field_series", "field_sums"]

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
    """
    up = np.flatnonzero(sun[:, 2] > 0.0)
    order = up[packet_order(sun[up])]
    sums = np.zeros((stop - start, 4))
    nothing = np.empty((4, 0, 0))
    _run(x, y, z, half_width, half_height, target_height, tracking, sun, order, start, stop, sums, nothing)
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
    up = np.flatnonzero(sun[:, 2] > 0.0)
    order = up[packet_order(sun[up])]
    series = np.full((4, len(sun), stop - start), np.nan)
    nothing = np.empty((0, 4))
    _run(x, y, z, half_width, half_height, target_height, tracking, sun, order, start, stop, nothing, series)
    return series


def _run(x, y, z, half_width, half_height, target_height, tracking, sun, order, start, stop, sums, series) -> None:
    """Aim the mirrors at the target and sweep."""
    if stop <= start or len(order) == 0:
        return
    arrays = [np.ascontiguousarray(a, np.float64) for a in (x, y, z, half_width, half_height, sun)]
    x, y, z, half_width, half_height, sun = arrays
    throw = np.sqrt(x * x + y * y + (target_height - z) ** 2)
    aim = np.stack((-x / throw, -y / throw, (target_height - z) / throw), axis=1)
    sweep(x, y, z, half_width, half_height, aim, throw, tracking, sun, order, start, stop, sums, series)


@kernel
def sweep(x, y, z, half_width, half_height, aim, throw, tracking, sun, order, start, stop, sums, series):
    """Sweep the instants `order` of `sun`; add to `sums` and write to `series`, whichever has heliostats.

    Parameters are those of `field_sums`, with the unit vectors `aim` (N, 3) and the distances `throw` (N,) from the
    mirrors to their targets.
    """
    count, tests = x.shape[0], stop - start
    radius = np.sqrt(half_width * half_width + half_height * half_height)
    grid = bin_field(x, y, z, radius)

    blockers, first_blocker = np.empty(4 * tests, np.int64), np.zeros(tests + 1, np.int64)
    found = 0
    for t in range(tests):
        i = start + t
        blockers, found = search(i, beam(aim[i], 1, 1), throw[i], x, y, z, radius, grid, blockers, found)
        first_blocker[t + 1] = found

    shaders, first_shader = np.empty(16 * tests, np.int64), np.zeros(tests + 1, np.int64)
    halo, place = np.empty(count, np.int64), np.full(count, -1, np.int64)
    frames = np.empty((tests, FRAME_ROWS * PACKET))
    images, apart = np.empty((8, IMAGE_ROWS * PACKET)), np.empty(8, np.bool_)
    lane = np.empty(18 * PACKET, np.int64)
    rows, target = np.empty(3 * PACKET), np.empty(3 * PACKET)
    sun_view, target_view = np.empty(FRAME_ROWS * PACKET), np.empty(FRAME_ROWS * PACKET)
    cosine, total, spare = np.empty(PACKET), np.empty(3 * PACKET), np.empty(PACKET)
    scratch = np.empty((5, 2))

    for first in range(0, order.shape[0], PACKET):
        lanes = min(PACKET, order.shape[0] - first)
        for k in range(PACKET):  # idle lanes repeat the last instant
            for c in range(3):
                rows[c * PACKET + k] = sun[order[first + min(k, lanes - 1)], c]
        bundle = beam(rows, PACKET, lanes)

        found = 0
        for t in range(tests):
            shaders, found = search(start + t, bundle, np.inf, x, y, z, radius, grid, shaders, found)
            first_shader[t + 1] = found

        named = 0
        for t in range(tests):
            named = _name(start + t, halo, place, named)
        for m in range(first_blocker[tests]):
            named = _name(blockers[m], halo, place, named)
        for m in range(first_shader[tests]):
            named = _name(shaders[m], halo, place, named)
        if named > frames.shape[0]:
            frames = np.empty((named + named // 4, FRAME_ROWS * PACKET))
        for m in range(named):
            j = halo[m]
            half_sides(
                frames[m], rows, aim[j, 0], aim[j, 1], aim[j, 2], half_width[j], half_height[j], tracking
            )

        for t in range(tests):
            i = start + t
            test = frames[place[i]]
            for k in range(PACKET):
                target[k], target[PACKET + k], target[2 * PACKET + k] = aim[i, 0], aim[i, 1], aim[i, 2]
            cosines(cosine, rows, aim[i, 0], aim[i, 1], aim[i, 2])
            square = half_width[i] * half_height[i]
            axes(sun_view, test, cosine, rows, square)
            axes(target_view, test, cosine, target, square)

            candidates = first_shader[t + 1] - first_shader[t] + first_blocker[t + 1] - first_blocker[t]
            if candidates > images.shape[0]:
                images, apart = np.empty((2 * candidates, IMAGE_ROWS * PACKET)), np.empty(2 * candidates, np.bool_)
                lane = np.empty((4 * candidates + 2) * PACKET, np.int64)
            made = 0
            for m in range(first_shader[t], first_shader[t + 1]):
                j = shaders[m]
                dx, dy, dz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
                clear = dx * dx + dy * dy + dz * dz > (radius[i] + radius[j]) ** 2 * (1.0 + 1e-12)
                if image(
                    images[made], sun_view, frames[place[j]], rows, dx, dy, dz, clear, test, scratch
                ):
                    apart[made] = clear
                    made += 1
            shading = made
            for m in range(first_blocker[t], first_blocker[t + 1]):
                j = blockers[m]
                dx, dy, dz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
                clear = dx * dx + dy * dy + dz * dz > (radius[i] + radius[j]) ** 2 * (1.0 + 1e-12)
                if image(
                    images[made], target_view, frames[place[j]], target, dx, dy, dz, clear, test, scratch
                ):
                    apart[made] = clear
                    made += 1

            unions(images, apart, shading, made, total, lane, spare)
            cosine_sum = shading_sum = blocking_sum = optical_sum = 0.0
            for k in range(lanes):
                unshaded = max(0.0, 1.0 - total[k] / SQUARE)
                unblocked = max(0.0, 1.0 - total[PACKET + k] / SQUARE)
                optical = cosine[k] * max(0.0, 1.0 - total[2 * PACKET + k] / SQUARE)
                cosine_sum += cosine[k]
                shading_sum += unshaded
                blocking_sum += unblocked
                optical_sum += optical
                if series.shape[2] > 0:
                    when = order[first + k]
                    series[0, when, t], series[1, when, t] = cosine[k], unshaded
                    series[2, when, t], series[3, when, t] = unblocked, optical
            if sums.shape[0] > 0:
                sums[t, 0] += cosine_sum
                sums[t, 1] += shading_sum
                sums[t, 2] += blocking_sum
                sums[t, 3] += optical_sum
        for m in range(named):
            place[halo[m]] = -1


@kernel
def _name(j, halo, place, named):
    """Give heliostat j a place among the frames of the packet, once."""
    if place[j] < 0:
        place[j] = named
        halo[named] = j
        named += 1
    return named


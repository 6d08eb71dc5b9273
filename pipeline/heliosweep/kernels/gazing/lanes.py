"""Pixels of backward gazing side by side: the lanes in which the searches for slopes evaluate rays and brightnesses.

A block of lanes is one flat array of rows; lane k of row r is `lanes[r * LANES + k]`. A pixel sits in its lane until
its search is over, then the next pixel takes the lane. No lane reads another, so a pixel's numbers are the same bits
whatever its neighbours are.

Rows of the trial point come first, then rows that belong to the caller, then `CAMERA_ROWS` for each camera. The trial
point of a mirror search is (a, b), slopes of the normal N ~ (1, a, b): the ideal mirror's and p together.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.rays import ideal_mirror, unit
from heliosweep.kernels.sun.profiles import least_base, power

Flags = NDArray[np.uint8]

NOT_CONVERGED, UNLIT, OUTSIDE = 1, 2, 4
"""Flags of a pixel: the search ended at its limit or without a direction; fewer than 3 lit cameras, so there was none;
a lit camera looks beside the disc at the slopes that LM found, where only the tangent of the profile continues it."""


class SlopeFit(NamedTuple):
    """Slopes of N pixels and what is known about them; NaN where fewer than 3 cameras are lit."""

    slopes: Floats
    """p relative to the ideal mirror, or w of O1, horizontal and vertical, shape (2, N). [rad]"""
    deviation: Floats
    """Standard deviation of the slopes for camera noise of standard deviation 1, shape (2, N), NaN but for LM: the
    Cramer-Rao bound at the slopes found, for a table at those that its smooth fit finds. [rad]"""
    gain: Floats
    """g, 1 where it is not fitted. [1]"""
    merit: Floats
    """Sum of squares left. [1]"""
    evaluations: Integers
    """Evaluations of the merit, over all stages; 0 where there was no search."""
    flags: Flags
    """Sum of `NOT_CONVERGED`, `UNLIT` and `OUTSIDE`."""


def begun(images: ArrayLike, start: ArrayLike) -> tuple[Floats, Floats, Integers, Flags]:
    """Images as kernels take them, and what they fill: rows of `SlopeFit` with the start, evaluations and flags."""
    seen = np.array(images, np.float64, order="C")
    found = np.full((6, seen.shape[1]), np.nan)
    found[:2] = np.where(np.isfinite(start), start, 0.0)
    return seen, found, np.zeros(seen.shape[1], np.int64), np.zeros(seen.shape[1], np.uint8)


LANES = 32
"""Pixels in a block: the rows of four cameras fit into the nearest cache."""

CHUNK = 1000
"""Pixels whose rays are traced at a time. (Rows a power of 2 apart would share the same few places of a cache.)"""

A, B, GAIN, MERIT = range(4)
"""Rows of the trial point [rad], the gain there, and the sum of squares."""
_GY, _GZ, _GYA, _GYB, _GZA, _GZB, _BI, _BB = range(4, 12)
IDEAL_A, IDEAL_B = 12, 13
"""Rows of the slopes of the ideal mirror at the pixel; 0 for a wavefront. [rad]"""
OWN = 14
"""First of the caller's rows."""
FIRST_CAMERA = OWN + 20
"""First row of the first camera."""

_RX, _RY, _RZ, _RV, _RW, IMAGE, LIT, SQUARE, VALUE, REST, BY_A, BY_B = range(12)
CAMERA_ROWS = 12
"""Rows of a camera: R and its part in v and w (of a wavefront: m in the first two), brightness seen, 1 or 0 for lit;
then, at the trial point, eps^2 [rad^2], the brightness of the disc there, what gain and image leave of it, and its
derivatives [1/rad]."""

_TINY = 1e-60


@kernel
def block_size(cameras: int) -> int:
    """Numbers in a block of lanes."""
    return (FIRST_CAMERA + CAMERA_ROWS * cameras) * LANES


@inline
def at(first, row, k):
    """Place of lane k in a row after the place `first`; unsigned, or a test for negative places hinders vector code."""
    return np.uint64(first + row * LANES + k)


@kernel
def rays_size(cameras: int) -> int:
    """Numbers that the rays of a chunk take."""
    return (2 + 5 * cameras) * CHUNK


@kernel
def trace_back(rays, cameras, layout, pixels, first):
    """Trace the rays from all cameras to the chunk of pixels that begins with `first`; returns where it ends.

    Row r of pixel n is `rays[r * CHUNK + n - first]`: slopes of the ideal mirror [rad], then for each camera R in the
    mirror frame, and R.e for the 2nd and 3rd rows e of B_S [1]; none of it changes with the trial slopes.
    """
    count, focal_length = min(CHUNK, pixels.shape[1] - first), layout.focal_length
    sy0, sy1, sy2 = layout.sun_y[0], layout.sun_y[1], layout.sun_y[2]
    sz0, sz1, sz2 = layout.sun_z[0], layout.sun_z[1], layout.sun_z[2]
    y, z = pixels[0, first : first + count], pixels[1, first : first + count]
    for n in range(count):
        _, rays[n], rays[CHUNK + n] = ideal_mirror(focal_length, y[n], z[n])
    for camera in range(cameras):
        row = (2 + 5 * camera) * CHUNK
        ex, ey, ez = layout.eyes[camera, 0], layout.eyes[camera, 1], layout.eyes[camera, 2]
        for n in range(count):
            x, _, _ = ideal_mirror(focal_length, y[n], z[n])
            rx, ry, rz = unit(ex - x, ey - y[n], ez - z[n])
            rays[np.uint64(row + n)] = rx
            rays[np.uint64(row + CHUNK + n)] = ry
            rays[np.uint64(row + 2 * CHUNK + n)] = rz
            rays[np.uint64(row + 3 * CHUNK + n)] = rx * sy0 + ry * sy1 + rz * sy2
            rays[np.uint64(row + 4 * CHUNK + n)] = rx * sz0 + ry * sz1 + rz * sz2
    return first + count


@inline
def next_lit(lanes, k, wavefront, gaze, rays, first, images, threshold, following, end, found, flags):
    """Put the next pixel with 3 lit cameras into lane k; returns what comes after it, and the pixel or -1.

    Those before it are NaN in `found`, and UNLIT.
    """
    while following < end:
        pixel = following
        following += 1
        if place(lanes, k, wavefront, gaze, rays, pixel - first, images, pixel, threshold) >= 3:
            return following, pixel
        flags[pixel] = UNLIT
        for row in range(6):
            found[row, pixel] = np.nan
    return following, -1


@inline
def place(lanes, k, wavefront, gaze, rays, n, images, pixel, threshold):
    """Put a pixel, the nth of the chunk in `rays`, into lane k; returns its number of lit cameras.

    For a search among the slopes w of a wavefront `gaze` of the scene takes the place of rays. Cameras that are not lit
    count in no merit. (Whatever is called for every pixel takes no scene: a tuple of arrays costs reference counting.)
    """
    if not wavefront:
        lanes[IDEAL_A * LANES + k], lanes[IDEAL_B * LANES + k] = rays[n], rays[CHUNK + n]
    lit = 0
    for camera in range(images.shape[0]):
        to = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES + k
        if wavefront:
            lanes[to], lanes[to + LANES] = gaze[camera, 0], gaze[camera, 1]
        else:
            for row in range(5):
                lanes[to + row * LANES] = rays[(2 + 5 * camera + row) * CHUNK + n]
        seen = images[camera, pixel] >= threshold  # False for NaN
        lanes[to + IMAGE * LANES] = images[camera, pixel] if seen else 0.0
        lanes[to + LIT * LANES] = 1.0 if seen else 0.0
        lit += 1 if seen else 0
    return lit


@inline
def reflect(lanes, cameras, layout, derivatives):
    """Trace the rays of all cameras back at the trial slopes (a, b): eps^2 and, if wanted, half its derivatives.

    With g = 2 (N.e) / (N.N), e the 2nd or 3rd row of B_S, v = (N.R) g - R.e: all but N.R is the same for all cameras.
    """
    sy0, sy1, sy2 = layout.sun_y[0], layout.sun_y[1], layout.sun_y[2]
    sz0, sz1, sz2 = layout.sun_z[0], layout.sun_z[1], layout.sun_z[2]
    for k in range(LANES):
        a, b = lanes[A * LANES + k], lanes[B * LANES + k]
        scale = 2.0 / (1.0 + a * a + b * b)
        gy, gz = scale * (sy0 + a * sy1 + b * sy2), scale * (sz0 + a * sz1 + b * sz2)
        lanes[_GY * LANES + k], lanes[_GZ * LANES + k] = gy, gz
        if derivatives:
            lanes[_GYA * LANES + k], lanes[_GYB * LANES + k] = scale * (sy1 - a * gy), scale * (sy2 - b * gy)
            lanes[_GZA * LANES + k], lanes[_GZB * LANES + k] = scale * (sz1 - a * gz), scale * (sz2 - b * gz)
    for camera in range(cameras):
        n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
        for k in range(LANES):
            rx, ry, rz = lanes[at(n, _RX, k)], lanes[at(n, _RY, k)], lanes[at(n, _RZ, k)]
            gy, gz = lanes[_GY * LANES + k], lanes[_GZ * LANES + k]
            along = rx + lanes[A * LANES + k] * ry + lanes[B * LANES + k] * rz
            v, w = along * gy - lanes[at(n, _RV, k)], along * gz - lanes[at(n, _RW, k)]
            lanes[at(n, SQUARE, k)] = v * v + w * w
            if derivatives:
                va, vb = ry * gy + along * lanes[_GYA * LANES + k], rz * gy + along * lanes[_GYB * LANES + k]
                wa, wb = ry * gz + along * lanes[_GZA * LANES + k], rz * gz + along * lanes[_GZB * LANES + k]
                lanes[at(n, BY_A, k)], lanes[at(n, BY_B, k)] = v * va + w * wa, v * vb + w * wb


@inline
def project(lanes, cameras):
    """The same for trial slopes w of a wavefront, eps = |m - w|, without derivatives."""
    for camera in range(cameras):
        n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
        for k in range(LANES):
            v, w = lanes[A * LANES + k] - lanes[at(n, _RX, k)], lanes[B * LANES + k] - lanes[at(n, _RY, k)]
            lanes[at(n, SQUARE, k)] = v * v + w * w


@inline
def brighten(lanes, cameras, profile, derivatives):
    """Brightness of the disc at eps^2, as `profiles.brightness`, and its derivatives by the trial point if wanted."""
    if profile.table.size > 0:
        _brighten_table(lanes, cameras, profile, derivatives)
    else:
        _brighten_analytic(lanes, cameras, profile, derivatives)


@inline
def _brighten_analytic(lanes, cameras, profile, derivatives):
    c0, c1, c2, c3 = profile.c0, profile.c1, profile.c2, profile.c3
    edge, edge_value, edge_slope = profile.edge, profile.edge_value, profile.edge_slope
    area, half, whole = 1.0 / (profile.radius * profile.radius), 0.5 * profile.power, profile.power
    least = least_base(half) / area
    for camera in range(cameras):
        n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
        for k in range(LANES):
            square = max(lanes[at(n, SQUARE, k)], least)
            inside = min(square, edge * edge)
            drop = power(inside * area, half)
            c, angle = math.sqrt(1.0 - drop), math.sqrt(square)
            value = c0 + c * (c1 + c * (c2 + c * c3))
            beyond = square >= edge * edge
            lanes[at(n, VALUE, k)] = edge_value + edge_slope * (angle - edge) if beyond else value
            if derivatives:
                along = -whole * drop * (c1 + c * (2.0 * c2 + c * (3.0 * c3)))
                steepness = (edge_slope if beyond else along) / (angle if beyond else 2.0 * c * inside)
                lanes[at(n, BY_A, k)] *= steepness
                lanes[at(n, BY_B, k)] *= steepness


@inline
def _brighten_table(lanes, cameras, profile, derivatives):
    table, last, each = profile.table, profile.table.size - 2, 1.0 / profile.step
    edge, edge_value, edge_slope = profile.edge, profile.edge_value, profile.edge_slope
    for camera in range(cameras):
        n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
        for k in range(LANES):
            square = lanes[at(n, SQUARE, k)]
            square = square if square > _TINY else _TINY  # for NaN too: a cell beyond the table would be read
            angle = math.sqrt(square)
            place = min(angle, edge) * each
            cell = min(np.int64(place), last)
            below = table[cell]
            rise = table[cell + 1] - below
            beyond = square >= edge * edge
            value = edge_value + edge_slope * (angle - edge) if beyond else below + (place - cell) * rise
            lanes[at(n, VALUE, k)] = value
            if derivatives:
                steepness = (edge_slope if beyond else rise * each) / angle
                lanes[at(n, BY_A, k)] *= steepness
                lanes[at(n, BY_B, k)] *= steepness


@inline
def weigh(lanes, cameras, fit_gain):
    """Sum of (g B - I)^2 over the lit cameras, and the gain g: 1, or the one that makes the sum least."""
    for k in range(LANES):
        lanes[GAIN * LANES + k], lanes[MERIT * LANES + k] = 1.0, 0.0
    if fit_gain:
        for k in range(LANES):
            lanes[_BI * LANES + k], lanes[_BB * LANES + k] = 0.0, _TINY
        for camera in range(cameras):
            n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
            for k in range(LANES):
                value = lanes[at(n, VALUE, k)] * lanes[at(n, LIT, k)]
                lanes[_BI * LANES + k] += value * lanes[at(n, IMAGE, k)]
                lanes[_BB * LANES + k] += value * value
        for k in range(LANES):
            lanes[GAIN * LANES + k] = lanes[_BI * LANES + k] / lanes[_BB * LANES + k]
    for camera in range(cameras):
        n = (FIRST_CAMERA + CAMERA_ROWS * camera) * LANES
        for k in range(LANES):
            rest = lanes[GAIN * LANES + k] * lanes[at(n, VALUE, k)] - lanes[at(n, IMAGE, k)]
            rest *= lanes[at(n, LIT, k)]
            lanes[at(n, REST, k)] = rest
            lanes[MERIT * LANES + k] += rest * rest

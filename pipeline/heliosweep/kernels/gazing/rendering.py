"""Images of a heliostat in cameras: on the grid of its mirror, and in the pixels of pinhole cameras.

The true surface differs from the model of the reconstruction: each module is a part of an exact sphere, rotated rigidly
about its centre by its canting; the whole heliostat is rotated about its centre by its pointing; slopes of waviness are
added. A ray goes back from each camera to each pixel of the mirror and on to the sun's disc; its brightness is the
image.

In a pinhole camera the brightness is averaged over n x n points of a pixel. The ray through a point hits the first
module on its way; the rectangle of a module is the rectangle of `geometry.Modules` before the rotations.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import MirrorGrid, Modules, Scene
from heliosweep.kernels.gazing.rays import ideal_mirror, mirror_offsets, row_of, unit
from heliosweep.kernels.gazing.rectification import Pinholes
from heliosweep.kernels.sun.profiles import Profile, rendered
from heliosweep.kernels.sun.tables import normal_draws
from heliosweep.kernels.vectors import cross, dot, minus, mixed

#: Brightness of the highest level of a camera, relative to the disc centre.
FULL_SCALE = 1.25
#: Plane waves that make up a waviness.
WAVES = 48
#: Streams of random numbers; the first belongs to `sun.tables.noisy`, the last to the first pinhole camera.
_PROFILE_STREAM, _WAVE_STREAM, _CAMERA_STREAM, _PINHOLE_STREAM = 1, 2, 3, 8


class Heliostat(NamedTuple):
    """The true surface of M modules; made by `heliostat`.

    Attributes
    ----------
    spheres : ndarray, shape (M, 4)
        Centre (x, y, z) in the mirror frame, and radius. [m]
    turns : ndarray, shape (M, 3, 3)
        Rotation of each module: columns are its own x, y and z in the mirror frame. [1]
    pivots : ndarray, shape (M, 2, 3)
        Centre of each module, before and after the rotation of the heliostat. [m]
    half : ndarray, shape (M, 2)
        Half its width along y and height along z. [m]
    wavy : ndarray, shape (2, nz, ny)
        Slopes of waviness on a grid; of size 0 if there is none. [rad]
    corner : ndarray, shape (3,)
        y and z of the first pixel of the grid, and its pixel. [m]
    span : ndarray of int, shape (M, 4)
        First and last row, first and last column of each module in the grid.
    """

    spheres: Floats
    turns: Floats
    pivots: Floats
    half: Floats
    wavy: Floats
    corner: Floats
    span: Integers


def module_spheres(
    modules: Modules, focal_length: float, canting: ArrayLike, pointing: ArrayLike = (0.0, 0.0)
) -> Floats:
    """Return the spheres of which M modules are parts.

    Parameters
    ----------
    modules : Modules
        M modules.
    focal_length : float
        Half the radius. [m]
    canting : array_like, shape (M, 2)
        Slopes (horizontal, vertical) by which each module's normal departs: a normal along x is rotated to
        (1, c_y, c_z). [rad]
    pointing : array_like, shape (2,)
        The same for the whole heliostat. [rad]

    Returns
    -------
    ndarray, shape (M, 4)
        Centre (x, y, z) in the mirror frame, and radius. [m]
    """
    radius, spheres = 2.0 * focal_length, []
    for (y, z), turn in zip(modules.centre, np.asarray(canting, np.float64), strict=True):
        square = y**2 + z**2
        rim = math.sqrt(radius**2 - square)
        place = np.array([square / (radius + rim), y, z])  # the module's centre on the ideal sphere
        centre = turned(place + turned(np.array([rim, -y, -z]), turn), np.asarray(pointing, np.float64))
        spheres.append([*centre, radius])
    return np.array(spheres)


def waviness(grid: MirrorGrid, rms: float, length: float, seed: int) -> Floats:
    """Return slopes (horizontal, vertical) of a random wavy surface at the pixels of a grid, shape (2, N). [rad]

    The gradient of a sum of plane waves, less its mean over each module, which would be canting. `rms` is the root mean
    square of the slopes, over both directions and all pixels [rad]; the wavelengths are spread by a third about
    `length` [m]; a seed gives the same waves for all pixels.
    """
    slopes, way = np.zeros(grid.pixels.shape), math.pi * (np.arange(WAVES) + 0.5) / WAVES
    draws = normal_draws(seed, _WAVE_STREAM, 3 * WAVES).reshape(WAVES, 3)
    for (size, phase, spread), angle in zip(draws, way, strict=True):
        wave = 2.0 * math.pi / (length * math.exp(spread / 3.0))
        c, s = math.cos(angle), math.sin(angle)
        # Equal slopes from all wavelengths; a normal phase of many turns is as good as uniform.
        slope = size * np.cos(wave * c * grid.pixels[0] + wave * s * grid.pixels[1] + 100.0 * phase)
        slopes += np.stack((c * slope, s * slope))
    for row in range(int(grid.pixel_module.max()) + 1):
        here = grid.pixel_module == row
        slopes[:, here] -= slopes[:, here].mean(axis=1, keepdims=True)
    return slopes * (rms / math.sqrt(float(np.mean(slopes**2))))


def image_set(
    layout: Scene, grid: MirrorGrid, profile: Profile, spheres: Floats, wavy: Floats | None = None
) -> tuple[Floats, Floats]:
    """Render a heliostat in K cameras on the N pixels of a grid.

    The heights of the waviness are neglected: for 0.3 mrad at a wavelength of 1 m they would move a ray by up to 1e-4
    mrad.

    Parameters
    ----------
    layout, grid, profile
        Scene, pixels and profile of the sun.
    spheres : ndarray, shape (M, 4)
        From `module_spheres`.
    wavy : ndarray, shape (2, N), optional
        Slopes from `waviness`, which are added. [rad]

    Returns
    -------
    images : ndarray, shape (K, N)
        Brightness relative to the disc centre, 0 outside the disc. [1]
    slopes : ndarray, shape (2, N)
        True slopes p relative to the ideal mirror of the scene. [rad]
    """
    extra = np.zeros(grid.pixels.shape) if wavy is None else wavy
    return trace(layout, profile, spheres, grid.pixels, grid.pixel_module, extra)


@inline
def sphere_point(spheres: Floats, module: int, y: float, z: float) -> tuple[float, float, float]:
    """Height x of a module's sphere at (y, z) [m], and the slopes a, b of its normal N ~ (1, a, b) there."""
    dy, dz, radius = spheres[module, 1] - y, spheres[module, 2] - z, spheres[module, 3]
    depth = math.sqrt(radius * radius - dy * dy - dz * dz)
    return spheres[module, 0] - depth, dy / depth, dz / depth


@kernel
def trace(
    layout: Scene, profile: Profile, spheres: Floats, points: Floats, module: Integers, wavy: Floats
) -> tuple[Floats, Floats]:
    """Compute `image_set` at any points (y, z) [m], with the rows of their modules and added slopes."""
    cameras, pixels = layout.eyes.shape[0], points.shape[1]
    images, slopes = np.empty((cameras, pixels)), np.empty((2, pixels))
    sun_y, sun_z = row_of(layout.sun_y), row_of(layout.sun_z)
    for k in range(pixels):
        y, z = points[0, k], points[1, k]
        height, a, b = sphere_point(spheres, module[k], y, z)
        _, ideal_a, ideal_b = ideal_mirror(layout.focal_length, y, z)
        a, b = a + wavy[0, k], b + wavy[1, k]
        for i in range(cameras):
            rx, ry, rz = unit(layout.eyes[i, 0] - height, layout.eyes[i, 1] - y, layout.eyes[i, 2] - z)
            v, w, _, _, _, _ = mirror_offsets(a, b, rx, ry, rz, sun_y, sun_z)
            images[i, k] = rendered(profile, v * v + w * w)
        slopes[0, k], slopes[1, k] = a - ideal_a, b - ideal_b
    return images, slopes


def expose(images: Floats, noise: float = 0.0, bits: int = 0, seed: int = 0, *, pinhole: bool = False) -> Floats:
    """Add noise to images as cameras deliver them, then round to levels.

    Parameters
    ----------
    images : ndarray, shape (K, N) or (K, rows, columns)
        Brightness relative to the disc centre. [1]
    noise : float
        Standard deviation of normal noise, relative to the disc centre. Images without levels may become negative. [1]
    bits : int
        Levels are 2^bits, from 0 to `FULL_SCALE`; 0 for none.
    seed : int
        Seed of the noise.
    pinhole : bool
        If True, each camera has its own stream: pixel k of camera i has the same noise for any number of cameras.

    Returns
    -------
    ndarray
        Of the shape of `images`. [1]
    """
    out = images
    if noise > 0.0:
        first, parts = (_PINHOLE_STREAM, len(images)) if pinhole else (_CAMERA_STREAM, 1)
        draws = [normal_draws(seed, first + part, images.size // parts) for part in range(parts)]
        out = out + noise * np.reshape(draws, images.shape)
    if bits > 0:
        top = 2.0**bits - 1.0
        out = np.rint(np.clip(out / FULL_SCALE, 0.0, 1.0) * top) * (FULL_SCALE / top)
    return out


def heliostat(
    modules: Modules,
    focal_length: float,
    canting: ArrayLike,
    pointing: ArrayLike = (0.0, 0.0),
    wavy: tuple[MirrorGrid, Floats] | None = None,
) -> Heliostat:
    """Return the true surface; parameters as in `module_spheres`.

    Slopes of waviness [rad] come from `waviness`, with the grid of their pixels over the same modules. They are linear
    between the pixels, so the grid should be fine compared with the waves.
    """
    cants, whole = np.asarray(canting, np.float64), np.asarray(pointing, np.float64)
    rim = 2.0 * focal_length - np.sqrt(4.0 * focal_length**2 - np.sum(modules.centre**2, axis=1))
    before = np.column_stack((rim, modules.centre))
    pivots = np.stack((before, [turned(place, whole) for place in before]), axis=1)
    turns = np.array([[turned(turned(axis, cant), whole) for axis in np.eye(3)] for cant in cants]).swapaxes(1, 2)
    field, corner, span = np.empty((2, 0, 0)), np.ones(3), np.zeros((len(cants), 4), np.int64)
    if wavy is not None:
        grid, slopes = wavy
        field = np.zeros((2, grid.module.size))
        field[:, grid.place] = slopes
        field = field.reshape(2, *grid.module.shape)
        longest = max(grid.y, grid.z, key=len)
        corner = np.array([grid.y[0], grid.z[0], longest[1] - longest[0] if len(longest) > 1 else 1.0])
        places = [np.nonzero(grid.module == row + 1) for row in range(len(cants))]
        span = np.array([[end(each) for each in place for end in (np.min, np.max)] for place in places])
    spheres = module_spheres(modules, focal_length, canting, pointing)
    return Heliostat(spheres, turns, pivots, 0.5 * modules.size, field, corner, span)


@kernel
def camera_set(
    layout: Scene, cameras: Pinholes, shape: tuple[int, int], profile: Profile, mirror: Heliostat, supersampling: int
) -> Floats:
    """Brightness relative to the disc centre in K pinhole cameras, averaged over each pixel, shape (K, rows, columns).

    It is 0 outside the disc and outside the modules [1]. The positions are the cameras of the scene; each side of a
    pixel has `supersampling` points.
    """
    count, (rows, columns), points = cameras.eyes.shape[0], shape, supersampling
    images = np.zeros((count, rows, columns))
    share = 1.0 / (points * points)
    for i in range(count):
        for row in range(rows):
            for column in range(columns):
                total = 0.0
                for n in range(points * points):
                    u = column + (n % points + 0.5) / points - 0.5
                    v = row + (n // points + 0.5) / points - 0.5
                    total += seen_at(layout, cameras, i, profile, mirror, u, v)
                images[i, row, column] = share * total
    return images


@inline
def seen_at(layout, cameras, i, profile, mirror, u, v):
    """Return the brightness that camera i sees at the point (u, v) of its image. [1]"""
    right, below = (u - cameras.centre[i, 0]) / cameras.focal[i], (v - cameras.centre[i, 1]) / cameras.focal[i]
    eye, axes = row_of(cameras.eyes[i]), cameras.axes[i]
    way = mixed(right, row_of(axes[0]), below, row_of(axes[1]))
    dx, dy, dz = unit(axes[2, 0] + way[0], axes[2, 1] + way[1], axes[2, 2] + way[2])
    ray, nearest, hit, hit_y, hit_z = (dx, dy, dz), math.inf, -1, 0.0, 0.0
    for m in range(mirror.half.shape[0]):
        # The ray passes the module's centre within half its diagonal, with a margin for its sag.
        pivot = minus(row_of(mirror.pivots[m, 1]), eye)
        along = dot(pivot, ray)
        square = mirror.half[m, 0] * mirror.half[m, 0] + mirror.half[m, 1] * mirror.half[m, 1]
        if along <= 0.0 or dot(pivot, pivot) - along * along > 1.5 * square:
            continue
        # The far side of the sphere is the concave one, which looks at the camera.
        ball = minus(eye, row_of(mirror.spheres[m]))
        half = dot(ball, ray)
        inside = half * half - dot(ball, ball) + mirror.spheres[m, 3] * mirror.spheres[m, 3]
        path = math.sqrt(inside) - half if inside >= 0.0 else math.inf
        if path >= nearest:
            continue
        place, turn = mixed(path, ray, -1.0, pivot), mirror.turns[m]
        own_y = turn[0, 1] * place[0] + turn[1, 1] * place[1] + turn[2, 1] * place[2]
        own_z = turn[0, 2] * place[0] + turn[1, 2] * place[1] + turn[2, 2] * place[2]
        if abs(own_y) <= mirror.half[m, 0] and abs(own_z) <= mirror.half[m, 1]:
            nearest, hit = path, m
            hit_y, hit_z = own_y + mirror.pivots[m, 0, 1], own_z + mirror.pivots[m, 0, 2]
    if hit < 0:
        return 0.0
    nx, ny, nz = mixed(1.0, minus(row_of(mirror.spheres[hit]), eye), -nearest, ray)
    a, b = ny / nx, nz / nx
    if mirror.wavy.size > 0:
        wave_a, wave_b = _waviness_at(mirror, hit, hit_y, hit_z)
        a, b = a + wave_a, b + wave_b
    v, w, _, _, _, _ = mirror_offsets(a, b, -dx, -dy, -dz, row_of(layout.sun_y), row_of(layout.sun_z))
    return rendered(profile, v * v + w * w)


@inline
def _waviness_at(mirror, module, y, z):
    """Slopes of waviness at a point of a module, linear between pixels, as at the nearest pixel along its edges."""
    top, bottom = mirror.span[module, 0], mirror.span[module, 1]
    left, right = mirror.span[module, 2], mirror.span[module, 3]
    across = min(max((y - mirror.corner[0]) / mirror.corner[2], float(left)), float(right))
    down = min(max((z - mirror.corner[1]) / mirror.corner[2], float(top)), float(bottom))
    column, row = min(int(across), max(right - 1, left)), min(int(down), max(bottom - 1, top))
    after, below = min(column + 1, right), min(row + 1, bottom)
    s, t = across - column, down - row
    w00, w01, w10, w11 = (1.0 - t) * (1.0 - s), (1.0 - t) * s, t * (1.0 - s), t * s
    a, b = mirror.wavy[0], mirror.wavy[1]
    return (
        w00 * a[row, column] + w01 * a[row, after] + w10 * a[below, column] + w11 * a[below, after],
        w00 * b[row, column] + w01 * b[row, after] + w10 * b[below, column] + w11 * b[below, after],
    )


def turned(vector: Floats, slopes: Floats) -> Floats:
    """Rotate a vector as the x axis is rotated to (1, c_y, c_z) by the shortest way."""
    length = math.hypot(slopes[0], slopes[1])
    if length == 0.0:
        return vector
    angle = math.atan(length)
    axis = np.array([0.0, -slopes[1], slopes[0]]) / length
    along, side = float(np.sum(axis * vector)), np.array(cross(axis, vector))
    return vector + math.sin(angle) * side + 2.0 * math.sin(0.5 * angle) ** 2 * (along * axis - vector)

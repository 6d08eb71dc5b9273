"""Images that cameras see in a heliostat: on the grid of its mirror, and in the pixels of pinhole cameras.

The true surface is not that of the reconstruction: every module is a part of an exact sphere, turned rigidly about its
centre by its canting, the whole heliostat about its centre by its pointing, with slopes of waviness on top. A ray goes
back from each camera to each pixel of the mirror and on to the sun's disc, whose brightness there is the image.

Of a pinhole camera it goes through each of n x n points of a pixel, over which the brightness is averaged, to the first
module that it meets, whose rectangle is that of `geometry.Modules` before the turns.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import MirrorGrid, Modules, Scene, product
from heliosweep.kernels.gazing.rays import ideal_mirror, mirror_offsets, row_of, unit
from heliosweep.kernels.gazing.rectification import Pinholes
from heliosweep.kernels.sun.profiles import Profile, rendered
from heliosweep.kernels.sun.tables import normal_draws

FULL_SCALE = 1.25
"""Brightness of the highest level of a camera, relative to the disc centre."""
WAVES = 48
"""Plane waves that make up a waviness."""
_PROFILE_STREAM, _WAVE_STREAM, _CAMERA_STREAM, _PINHOLE_STREAM = 1, 2, 3, 8
"""Streams of random numbers; the first is that of `sun.tables.noisy`, the last of the first of the pinhole cameras."""


class Heliostat(NamedTuple):
    """The true surface of M modules; made by `heliostat`."""

    spheres: Floats
    """Centre (x, y, z) in the mirror frame, and radius, shape (M, 4). [m]"""
    turns: Floats
    """Rotation of each module, whole turn and canting, shape (M, 3, 3): rows are the mirror frame's. [1]"""
    pivots: Floats
    """Centre of each module, before and after the whole turn, shape (M, 2, 3). [m]"""
    half: Floats
    """Half its width along y and height along z, shape (M, 2). [m]"""
    wavy: Floats
    """Slopes of waviness on a grid, shape (2, nz, ny); of size 0 where there is none. [rad]"""
    corner: Floats
    """y and z of the grid's first pixel, and its pixel, shape (3,). [m]"""
    span: NDArray[np.int64]
    """First and last row, first and last column of each module in the grid, shape (M, 4)."""


def module_spheres(
    modules: Modules, focal_length: ArrayLike, canting: ArrayLike, pointing: ArrayLike = (0.0, 0.0)
) -> Floats:
    """Spheres of which M modules are parts: centre (x, y, z) in the mirror frame, and radius, shape (M, 4). [m]

    Half the radius is the focal length f, shape () or (M,) [m]. Canting (M, 2) are slopes (horizontal, vertical) by
    which each module's normal departs: a module whose normal lies along x is turned until it lies along (1, c_y, c_z)
    [rad]; pointing (2,) is the same for the whole heliostat. Raises ValueError for other shapes and too small radii.
    """
    turns, whole = np.asarray(canting, np.float64), np.asarray(pointing, np.float64)
    count = len(modules.centre)
    radius = 2.0 * np.broadcast_to(np.asarray(focal_length, np.float64), (count,))
    y, z = modules.centre[:, 0], modules.centre[:, 1]
    if not (turns.shape == (count, 2) and np.all(radius > np.hypot(y, z))):
        raise ValueError("one canting is needed for each module, and radii larger than the heliostat")
    spheres = np.empty((count, 4))
    for row in range(count):
        square = y[row] ** 2 + z[row] ** 2
        rim = math.sqrt(radius[row] ** 2 - square)
        place = np.array([square / (radius[row] + rim), y[row], z[row]])  # the module's centre on the ideal sphere
        to_centre = np.array([rim, -y[row], -z[row]])
        spheres[row, :3] = _turned(place + _turned(to_centre, turns[row]), whole)
        spheres[row, 3] = radius[row]
    return spheres


def waviness(grid: MirrorGrid, rms: float, length: float, seed: int) -> Floats:
    """Slopes (horizontal, vertical) of a random wavy surface at the pixels of a grid, shape (2, N). [rad]

    The gradient of a sum of plane waves, less its mean over each module, which would be canting. `rms` is the root mean
    square of the slopes, over both directions and all pixels [rad]; the wavelengths are spread by a third about
    `length` [m]; a seed gives the same waves whatever the pixels.
    """
    slopes = np.zeros((2, len(grid.pixel_y)))
    if rms == 0.0:
        return slopes
    if not (rms > 0.0 and length > 0.0):
        raise ValueError("waviness needs a positive wavelength and no negative size")
    draws = normal_draws(seed, _WAVE_STREAM, 3 * WAVES).reshape(WAVES, 3)
    for number, (size, phase, spread) in enumerate(draws):
        way = math.pi * (number + 0.5) / WAVES
        wave = 2.0 * math.pi / (length * math.exp(spread / 3.0))
        ky, kz = wave * math.cos(way), wave * math.sin(way)
        # Equal slopes from all wavelengths; a normal phase of many turns is as good as uniform.
        slope = size * np.cos(ky * grid.pixel_y + kz * grid.pixel_z + 100.0 * phase)
        slopes[0] += math.cos(way) * slope
        slopes[1] += math.sin(way) * slope
    for row in range(int(grid.pixel_module.max()) + 1):
        here = grid.pixel_module == row
        slopes[:, here] -= slopes[:, here].mean(axis=1, keepdims=True)
    return slopes * (rms / math.sqrt(float(np.mean(slopes**2))))


def image_set(
    layout: Scene, grid: MirrorGrid, profile: Profile, spheres: Floats, wavy: Floats | None = None
) -> tuple[Floats, Floats]:
    """Images of a heliostat in K cameras, and its true slopes, at the N pixels of a grid.

    Of the modules' spheres, from `module_spheres`, and slopes of `waviness` (2, N), which are added; their heights are
    not: those of 0.3 mrad at a wavelength of 1 m would move a ray by up to 1e-4 mrad. Images are brightness relative to
    the disc centre, 0 beside the disc, shape (K, N) [1]; slopes are p relative to the ideal mirror of the scene, to be
    found by a reconstruction, shape (2, N) [rad].
    """
    extra = np.zeros((2, len(grid.pixel_y))) if wavy is None else wavy
    return trace(layout, profile, spheres, grid.pixel_y, grid.pixel_z, grid.pixel_module, extra)


@inline
def sphere_point(spheres: Floats, module: int, y: float, z: float) -> tuple[float, float, float]:
    """Height x of a module's sphere at (y, z) [m], and the slopes a, b of its normal N ~ (1, a, b) there."""
    dy, dz, radius = spheres[module, 1] - y, spheres[module, 2] - z, spheres[module, 3]
    depth = math.sqrt(radius * radius - dy * dy - dz * dz)
    return spheres[module, 0] - depth, dy / depth, dz / depth


@kernel
def trace(
    layout: Scene,
    profile: Profile,
    spheres: Floats,
    y: Floats,
    z: Floats,
    module: NDArray[np.int64],
    wavy: Floats,
) -> tuple[Floats, Floats]:
    """`image_set` at any pixels: positions y and z [m], rows of their modules, and added slopes."""
    cameras, pixels = layout.eyes.shape[0], y.size
    images, slopes = np.empty((cameras, pixels)), np.empty((2, pixels))
    sun_y, sun_z = row_of(layout.sun_y), row_of(layout.sun_z)
    for k in range(pixels):
        height, a, b = sphere_point(spheres, module[k], y[k], z[k])
        _, ideal_a, ideal_b = ideal_mirror(layout.focal_length, y[k], z[k])
        a, b = a + wavy[0, k], b + wavy[1, k]
        for i in range(cameras):
            rx, ry, rz = unit(layout.eyes[i, 0] - height, layout.eyes[i, 1] - y[k], layout.eyes[i, 2] - z[k])
            v, w, _, _, _, _ = mirror_offsets(a, b, rx, ry, rz, sun_y, sun_z)
            images[i, k] = rendered(profile, v * v + w * w)
        slopes[0, k], slopes[1, k] = a - ideal_a, b - ideal_b
    return images, slopes


def expose(images: Floats, noise: float = 0.0, bits: int = 0, seed: int = 0) -> Floats:
    """Images on the grid of the mirror, shape (K, N), as cameras deliver them: with noise, then in levels. [1]

    `noise` is the standard deviation of normal noise, relative to the disc centre, by a seed; it may make images
    without levels negative. Levels are 2^bits, from 0 to `FULL_SCALE`; 0 bits for none.
    """
    out = images
    if noise > 0.0:
        out = out + noise * normal_draws(seed, _CAMERA_STREAM, out.size).reshape(out.shape)
    if bits > 0:
        top = 2.0**bits - 1.0
        out = np.rint(np.clip(out / FULL_SCALE, 0.0, 1.0) * top) * (FULL_SCALE / top)
    return out


def heliostat(
    modules: Modules,
    focal_length: ArrayLike,
    canting: ArrayLike,
    pointing: ArrayLike = (0.0, 0.0),
    wavy: tuple[MirrorGrid, Floats] | None = None,
) -> Heliostat:
    """The true surface; parameters as in `module_spheres`.

    Slopes of waviness [rad] come from `waviness`, with the grid over the same modules at whose pixels they are; they
    are linear between these, so the grid should be fine against the waves.
    """
    spheres = module_spheres(modules, focal_length, canting, pointing)
    flat = np.zeros_like(modules.centre)
    still = module_spheres(modules, focal_length, flat)
    count = len(flat)
    turns, pivots = np.empty((count, 3, 3)), np.empty((count, 2, 3))
    whole = _turn(np.asarray(pointing, np.float64))
    for row, (canted, centre) in enumerate(zip(np.asarray(canting, np.float64), modules.centre, strict=True)):
        rim = still[row, 3] - math.sqrt(still[row, 3] ** 2 - float(np.sum(centre**2)))
        pivots[row, 0] = rim, centre[0], centre[1]
        pivots[row, 1] = product(whole, pivots[row, 0])
        turns[row] = np.stack([product(whole, column) for column in _turn(canted).T], axis=1)
    field, corner = np.empty((2, 0, 0)), np.ones(3)
    span = np.zeros((count, 4), np.int64)
    if wavy is not None:
        grid, slopes = wavy
        field = np.zeros((2, grid.module.size))
        field[:, grid.place] = slopes
        field = field.reshape(2, *grid.module.shape)
        corner = np.array([grid.y[0], grid.z[0], _step(grid)])
        for row in range(count):
            rows, columns = np.nonzero(grid.module == row + 1)
            span[row] = rows.min(), rows.max(), columns.min(), columns.max()
    return Heliostat(spheres, turns, pivots, 0.5 * modules.size, field, corner, span)


@kernel
def camera_set(
    layout: Scene, cameras: Pinholes, shape: tuple[int, int], profile: Profile, mirror: Heliostat, supersampling: int
) -> Floats:
    """Brightness relative to the disc centre in K pinhole cameras, averaged over each pixel, shape (K, rows, columns).

    0 beside the disc and beside the modules [1]. The cameras are those of the scene, `supersampling` points are along
    each side of a pixel.
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
    """Brightness that camera i sees at the point (u, v) of its image. [1]"""
    right, below = (u - cameras.centre[i, 0]) / cameras.focal[i], (v - cameras.centre[i, 1]) / cameras.focal[i]
    dx = cameras.axes[i, 2, 0] + right * cameras.axes[i, 0, 0] + below * cameras.axes[i, 1, 0]
    dy = cameras.axes[i, 2, 1] + right * cameras.axes[i, 0, 1] + below * cameras.axes[i, 1, 1]
    dz = cameras.axes[i, 2, 2] + right * cameras.axes[i, 0, 2] + below * cameras.axes[i, 1, 2]
    scale = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = scale * dx, scale * dy, scale * dz
    ex, ey, ez = cameras.eyes[i, 0], cameras.eyes[i, 1], cameras.eyes[i, 2]
    nearest, hit, hit_y, hit_z = math.inf, -1, 0.0, 0.0
    for m in range(mirror.half.shape[0]):
        # How far the ray passes from the module's centre, against its half diagonal with room for its sag.
        px, py, pz = mirror.pivots[m, 1, 0] - ex, mirror.pivots[m, 1, 1] - ey, mirror.pivots[m, 1, 2] - ez
        along = px * dx + py * dy + pz * dz
        square = mirror.half[m, 0] * mirror.half[m, 0] + mirror.half[m, 1] * mirror.half[m, 1]
        if along <= 0.0 or px * px + py * py + pz * pz - along * along > 1.5 * square:
            continue
        # The far side of the sphere is the concave one, which looks at the camera.
        ox, oy, oz = ex - mirror.spheres[m, 0], ey - mirror.spheres[m, 1], ez - mirror.spheres[m, 2]
        half = ox * dx + oy * dy + oz * dz
        inside = half * half - (ox * ox + oy * oy + oz * oz) + mirror.spheres[m, 3] * mirror.spheres[m, 3]
        if inside < 0.0:
            continue
        path = math.sqrt(inside) - half
        if path >= nearest:
            continue
        qx, qy, qz = path * dx - px, path * dy - py, path * dz - pz
        own_y = mirror.turns[m, 0, 1] * qx + mirror.turns[m, 1, 1] * qy + mirror.turns[m, 2, 1] * qz
        own_z = mirror.turns[m, 0, 2] * qx + mirror.turns[m, 1, 2] * qy + mirror.turns[m, 2, 2] * qz
        if abs(own_y) <= mirror.half[m, 0] and abs(own_z) <= mirror.half[m, 1]:
            nearest, hit = path, m
            hit_y, hit_z = own_y + mirror.pivots[m, 0, 1], own_z + mirror.pivots[m, 0, 2]
    if hit < 0:
        return 0.0
    nx = mirror.spheres[hit, 0] - ex - nearest * dx
    a = (mirror.spheres[hit, 1] - ey - nearest * dy) / nx
    b = (mirror.spheres[hit, 2] - ez - nearest * dz) / nx
    if mirror.wavy.size > 0:
        wave_a, wave_b = _waviness_at(mirror, hit, hit_y, hit_z)
        a, b = a + wave_a, b + wave_b
    v, w, _, _, _, _ = mirror_offsets(a, b, -dx, -dy, -dz, layout.sun_y, layout.sun_z)
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
    a = (1.0 - t) * ((1.0 - s) * mirror.wavy[0, row, column] + s * mirror.wavy[0, row, after])
    a += t * ((1.0 - s) * mirror.wavy[0, below, column] + s * mirror.wavy[0, below, after])
    b = (1.0 - t) * ((1.0 - s) * mirror.wavy[1, row, column] + s * mirror.wavy[1, row, after])
    b += t * ((1.0 - s) * mirror.wavy[1, below, column] + s * mirror.wavy[1, below, after])
    return a, b


def levels(
    images: Floats,
    white: float,
    *,
    black: float = 0.0,
    noise: float = 0.0,
    gain_error: ArrayLike = 0.0,
    bits: int = 0,
    seed: int = 0,
) -> Floats:
    """Images (K, rows, columns) of pinhole cameras, brightness relative to the disc centre [1], in levels of a sensor.

    `white` is the level of the disc centre above `black`: the exposure. `noise` is the standard deviation of the read
    noise relative to the disc centre, `gain_error` the relative error of each camera's gain, shape () or (K,). Levels
    are whole numbers from 0 to 2^bits - 1, at which they saturate; 0 bits for neither. By a seed pixel k of camera i
    has the same noise whatever the number of cameras.
    """
    gain = white * (1.0 + np.broadcast_to(np.asarray(gain_error, np.float64), (len(images),)))
    out = black + images * gain[:, np.newaxis, np.newaxis]
    if noise > 0.0:
        for i, image in enumerate(out):
            image += white * noise * normal_draws(seed, _PINHOLE_STREAM + i, image.size).reshape(image.shape)
    return np.rint(np.clip(out, 0.0, 2.0**bits - 1.0)) if bits > 0 else out


def _turned(vector: Floats, slopes: Floats) -> Floats:
    """A vector after the turn that takes the x axis to (1, c_y, c_z) by the shortest way."""
    length = math.hypot(slopes[0], slopes[1])
    if length == 0.0:
        return vector
    angle = math.atan(length)
    axis = np.array([0.0, -slopes[1], slopes[0]]) / length
    along = float(np.sum(axis * vector))
    side = np.array(
        [axis[1] * vector[2] - axis[2] * vector[1], axis[2] * vector[0], -axis[1] * vector[0]]
    )  # axis x vector, the axis having no x
    rest = 2.0 * math.sin(0.5 * angle) ** 2
    return vector + math.sin(angle) * side + rest * (along * axis - vector)


def _turn(slopes: Floats) -> Floats:
    """Rotation that takes the x axis to (1, c_y, c_z) by the shortest way."""
    y, z = float(slopes[0]), float(slopes[1])
    c = 1.0 / math.sqrt(1.0 + y * y + z * z)
    s, k = c, c * c / (1.0 + c)
    return np.array([[c, -s * y, -s * z], [s * y, 1.0 - k * y * y, -k * y * z], [s * z, -k * y * z, 1.0 - k * z * z]])


def _step(grid: MirrorGrid) -> float:
    """Side of the grid's pixels. [m]"""
    longest = grid.y if len(grid.y) > 1 else grid.z
    return float(longest[1] - longest[0]) if len(longest) > 1 else 1.0

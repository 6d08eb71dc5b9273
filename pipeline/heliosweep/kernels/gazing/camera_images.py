"""Images that pinhole cameras take of a heliostat: modules with edges and gaps, in pixels, in levels of a sensor.

A ray goes from the camera through each point of a pixel to the first module it meets. A module is a part of an exact
sphere, turned rigidly about its centre and with the whole heliostat; its rectangle is that of `gazing_grid` before the
turns. The sun's disc as the module shows it there is averaged over n x n points of the pixel.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import Scene, mirror_offsets
from heliosweep.kernels.gazing.mirror import MirrorGrid, Modules
from heliosweep.kernels.gazing.rectification import Pinholes
from heliosweep.kernels.gazing.rendering import module_spheres
from heliosweep.kernels.sun.profiles import Profile, rendered
from heliosweep.kernels.sun.tables import normal_draws

Floats = NDArray[np.float64]

_STREAM = 8
"""First stream of random numbers of these cameras, one for each."""


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


def heliostat(
    modules: Modules,
    focal_length: ArrayLike,
    canting: ArrayLike,
    pointing: ArrayLike = (0.0, 0.0),
    wavy: tuple[MirrorGrid, Floats] | None = None,
) -> Heliostat:
    """The true surface.

    Parameters
    ----------
    modules, focal_length, canting, pointing
        As in `gazing_images.module_spheres`.
    wavy : tuple of MirrorGrid and ndarray of shape (2, N), optional
        Slopes of waviness at the pixels of a grid over the same modules, from `gazing_images.waviness`; linear between
        pixels, so the grid should be fine against the waves. [rad]

    Returns
    -------
    Heliostat
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
        pivots[row, 1] = _times(whole, pivots[row, 0])
        turns[row] = np.stack([_times(whole, column) for column in _turn(canted).T], axis=1)
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


def camera_set(
    layout: Scene,
    cameras: Pinholes,
    shape: tuple[int, int],
    profile: Profile,
    mirror: Heliostat,
    supersampling: int = 3,
) -> Floats:
    """Images of all cameras.

    Parameters
    ----------
    layout : Scene
        K cameras.
    cameras : Pinholes
        The same K cameras.
    shape : tuple of int
        Rows and columns of an image.
    profile : Profile
        Of the sun.
    mirror : Heliostat
    supersampling : int
        Points along each side of a pixel.

    Returns
    -------
    ndarray, shape (K, rows, columns)
        Brightness relative to the disc centre, averaged over the pixel; 0 beside the disc and beside the modules. [1]
    """
    if supersampling < 1 or min(shape) < 1:
        raise ValueError("images need pixels, and pixels a point at least")
    return render_cameras(layout, cameras, int(shape[0]), int(shape[1]), profile, mirror, int(supersampling))


@kernel
def render_cameras(
    layout: Scene, cameras: Pinholes, rows: int, columns: int, profile: Profile, mirror: Heliostat, points: int
) -> Floats:
    """`camera_set` as the compiler takes it."""
    count = cameras.eyes.shape[0]
    images = np.zeros((count, rows, columns))
    share = 1.0 / (points * points)
    for i in range(count):
        for row in range(rows):
            for column in range(columns):
                total = 0.0
                for n in range(points * points):
                    u = column + (n % points + 0.5) / points - 0.5
                    v = row + (n // points + 0.5) / points - 0.5
                    value, _ = seen_at(layout, cameras, i, profile, mirror, u, v)
                    total += value
                images[i, row, column] = share * total
    return images


@inline
def seen_at(layout, cameras, i, profile, mirror, u, v):
    """Brightness [1] that camera i sees at the point (u, v) of its image, and the row of the module; -1 for none."""
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
        return 0.0, hit
    nx = mirror.spheres[hit, 0] - ex - nearest * dx
    a = (mirror.spheres[hit, 1] - ey - nearest * dy) / nx
    b = (mirror.spheres[hit, 2] - ez - nearest * dz) / nx
    if mirror.wavy.size > 0:
        wave_a, wave_b = _waviness_at(mirror, hit, hit_y, hit_z)
        a, b = a + wave_a, b + wave_b
    v, w, _, _, _, _ = mirror_offsets(a, b, -dx, -dy, -dz, layout.sun_y, layout.sun_z)
    return rendered(profile, v * v + w * w), hit


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
    """Images in the levels of a sensor.

    Parameters
    ----------
    images : ndarray, shape (K, rows, columns)
        Brightness relative to the disc centre. [1]
    white : float
        Level of the disc centre above `black`: the exposure. [levels]
    black : float
        Level of the dark. [levels]
    noise : float
        Standard deviation of the read noise, relative to the disc centre. [1]
    gain_error : array_like, shape () or (K,)
        Relative error of each camera's gain. [1]
    bits : int
        Levels are whole numbers from 0 to 2^bits - 1, at which they saturate; 0 for neither.
    seed : int
        Key of the noise: pixel k of camera i has the same whatever the number of cameras.

    Returns
    -------
    ndarray, shape (K, rows, columns)
        [levels]
    """
    gain = white * (1.0 + np.broadcast_to(np.asarray(gain_error, np.float64), (len(images),)))
    out = black + images * gain[:, np.newaxis, np.newaxis]
    if noise > 0.0:
        for i, image in enumerate(out):
            image += white * noise * normal_draws(seed, _STREAM + i, image.size).reshape(image.shape)
    return np.rint(np.clip(out, 0.0, 2.0**bits - 1.0)) if bits > 0 else out


def _times(matrix: Floats, vector: Floats) -> Floats:
    """Product of a matrix and a vector, summed in one order on every machine."""
    return np.sum(matrix * vector, axis=1)


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

"""Images that cameras see in a heliostat, on the grid of its mirror.

The true surface is not that of the reconstruction: every module is a part of an exact sphere, turned rigidly about its
centre by its canting, the whole heliostat about its centre by its pointing, with slopes of waviness on top. A ray goes
back from each camera to each pixel and on to the sun's disc, whose brightness there is the image.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import Scene, camera_ray, ideal_mirror, mirror_offsets
from heliosweep.kernels.gazing.mirror import MirrorGrid, Modules
from heliosweep.kernels.sun.profiles import Profile, rendered
from heliosweep.kernels.sun.tables import normal_draws

Floats = NDArray[np.float64]

WAVES = 48
"""Plane waves that make up a waviness."""
_PROFILE_STREAM, _WAVE_STREAM, _CAMERA_STREAM = 1, 2, 3
"""Streams of random numbers; the first is that of `sun_tables.noisy`."""


def module_spheres(
    modules: Modules, focal_length: ArrayLike, canting: ArrayLike, pointing: ArrayLike = (0.0, 0.0)
) -> Floats:
    """Spheres of which the modules are parts.

    Parameters
    ----------
    modules : Modules
    focal_length : array_like, shape () or (M,)
        f: half the radius of the sphere. [m]
    canting : array_like, shape (M, 2)
        Slopes (horizontal, vertical) by which each module's normal departs: a module whose normal lies along x is
        turned until it lies along (1, c_y, c_z). [rad]
    pointing : array_like, shape (2,)
        The same for the whole heliostat. [rad]

    Returns
    -------
    ndarray, shape (M, 4)
        Centre (x, y, z) in the mirror frame, and radius. [m]
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
    """Slopes of a random wavy surface.

    Parameters
    ----------
    grid : MirrorGrid
    rms : float
        Root mean square of the slopes, over both directions and all pixels. [rad]
    length : float
        Wavelength; those of the waves are spread by a third about it. [m]
    seed : int
        Key of the random numbers; the same waves whatever the pixels.

    Returns
    -------
    ndarray, shape (2, N)
        Slopes (horizontal, vertical): the gradient of a sum of plane waves, less its mean over each module, which
        would be canting. [rad]
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
    """Images and true slopes of a heliostat.

    Parameters
    ----------
    layout : Scene
        K cameras.
    grid : MirrorGrid
        N pixels on modules.
    profile : Profile
        Of the sun.
    spheres : ndarray, shape (M, 4)
        From `module_spheres`.
    wavy : ndarray, shape (2, N), optional
        Slopes that are added, from `waviness`; their heights are not: those of 0.3 mrad at a wavelength of 1 m would
        move a ray by up to 1e-4 mrad. [rad]

    Returns
    -------
    images : ndarray, shape (K, N)
        Brightness relative to the disc centre, 0 beside the disc. [1]
    slopes : ndarray, shape (2, N)
        True slopes p relative to the ideal mirror of the scene, to be found by a reconstruction. [rad]
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
    eyes, sun_y, sun_z = layout.eyes, layout.sun_y, layout.sun_z
    for k in range(pixels):
        x, a, b = sphere_point(spheres, module[k], y[k], z[k])
        a, b = a + wavy[0, k], b + wavy[1, k]
        _, ideal_a, ideal_b = ideal_mirror(layout.focal_length, y[k], z[k])
        slopes[0, k], slopes[1, k] = a - ideal_a, b - ideal_b
        for i in range(cameras):
            rx, ry, rz = camera_ray(eyes, i, x, y[k], z[k])
            v, w, _, _, _, _ = mirror_offsets(a, b, rx, ry, rz, sun_y, sun_z)
            images[i, k] = rendered(profile, v * v + w * w)
    return images, slopes


def expose(
    images: Floats,
    noise: float = 0.0,
    gain_error: float = 0.0,
    bits: int = 0,
    seed: int = 0,
    full_scale: float = 1.25,
) -> Floats:
    """Images as cameras deliver them: gain, then noise, then levels.

    Parameters
    ----------
    images : ndarray, shape (K, N)
        Brightness relative to the disc centre. [1]
    noise : float
        Standard deviation of normal noise, relative to the disc centre. [1]
    gain_error : float
        Relative error common to all cameras: of a reflectivity, an exposure, the air between. [1]
    bits : int
        Levels are 2^bits, from 0 to `full_scale`; 0 for none.
    seed : int
        Key of the noise.
    full_scale : float
        Brightness of the highest level. [1]

    Returns
    -------
    ndarray, shape (K, N)
        In the scale of the images; noise may make it negative where there are no levels. [1]
    """
    out = images * (1.0 + gain_error)
    if noise > 0.0:
        out = out + noise * normal_draws(seed, _CAMERA_STREAM, out.size).reshape(out.shape)
    if bits > 0:
        top = 2.0**bits - 1.0
        out = np.rint(np.clip(out / full_scale, 0.0, 1.0) * top) * (full_scale / top)
    return out


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

"""Images of pinhole cameras instead of brightness on the grid of the mirror: rendered, exposed, and put back on it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.camera_images import camera_set, heliostat, levels
from heliosweep.kernels.gazing_geometry import Scene
from heliosweep.kernels.gazing_grid import MirrorGrid, Modules
from heliosweep.kernels.pinholes import pinholes
from heliosweep.kernels.rectification import rectify
from heliosweep.kernels.sun_profiles import Profile

Floats = NDArray[np.float64]

#: Pixels around the picture of the heliostat.
_ROOM = 4


def camera_views(
    layout: Scene,
    profile: Profile,
    modules: Modules,
    mirror: MirrorGrid,
    surface: tuple[float, Floats, tuple[float, float], Floats | None],
    *,
    pixel: float,
    supersampling: int,
    noise: float,
    gain_error: ArrayLike,
    bits: int,
    seed: int,
    full_scale: float,
) -> tuple[Floats, Floats]:
    """What the reconstruction gets of pinhole cameras whose pixels are as large as those of the mirror.

    Parameters
    ----------
    layout : Scene
        Four cameras.
    profile : Profile
        Of the sun.
    modules : Modules
    mirror : MirrorGrid
        N pixels.
    surface : tuple
        Focal length [m], canting of each module [rad], pointing [rad], and slopes of waviness at the pixels or None
        [rad].
    pixel : float
        Side of a camera's pixel at the heliostat's centre. [m]
    supersampling : int
        Rays along each side of a camera's pixel.
    noise, gain_error, bits, seed, full_scale
        As for `gazing_images.expose`, but the gain of each camera may have its own error.

    Returns
    -------
    images : ndarray, shape (4, N)
        NaN within two pixels of a module's edge. [1]
    share : ndarray, shape (4, N)
        Standard deviation of a value for camera pixels of standard deviation 1. [1]
    """
    focal_length, canting, pointing, wavy = surface
    half = 0.5 * modules.size
    reach = np.abs(modules.centre) + half
    columns, rows = (2 * math.ceil(float(side) / pixel) + 2 * _ROOM for side in reach.max(axis=0))
    # A tilted mirror is seen foreshortened, and turned: its larger side fits in any direction.
    shape = (max(rows, columns), max(rows, columns))
    cameras = pinholes(layout, shape, layout.distance / pixel)
    truth = heliostat(modules, focal_length, canting, pointing, None if wavy is None else (mirror, wavy))
    pictures = camera_set(layout, cameras, shape, profile, truth, supersampling)
    white = (2.0**bits - 1.0) / full_scale if bits else 1.0
    taken = levels(pictures, white, noise=noise, gain_error=gain_error, bits=bits, seed=seed) / white
    images, _, share = rectify(taken, cameras, layout.focal_length, modules, mirror)
    return images, share

"""Modules of a heliostat and the grid of pixels on its mirror.

Positions are (y, z) in the mirror frame, from the heliostat's centre: y to the right for someone at the target who
looks at the mirror, z up. Kernels work on the pixels that lie on a module, one row after another; `maps` puts their
values back on the grid.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
_SLACK = 1e-9
"""Rounding that a pixel centre on a module's edge is allowed, in pixels."""
_MOST = 50_000_000
"""Pixels of a grid at most."""


class Modules(NamedTuple):
    """Rectangular modules of a heliostat; module number n of a study is row n - 1."""

    centre: Floats
    """(y, z), shape (M, 2). [m]"""
    size: Floats
    """Width along y and height along z, shape (M, 2). [m]"""


class MirrorGrid(NamedTuple):
    """Square pixels over the modules; made by `mirror_grid`."""

    y: Floats
    """Pixel centres along y, rising, shape (ny,). [m]"""
    z: Floats
    """Pixel centres along z, rising, shape (nz,). [m]"""
    module: NDArray[np.int64]
    """Number of the module at each pixel, from 1; 0 where there is none; shape (nz, ny)."""
    place: NDArray[np.int64]
    """Place of the N pixels on modules in the flattened grid, rising, shape (N,)."""
    pixel_y: Floats
    """Their y, shape (N,). [m]"""
    pixel_z: Floats
    """Their z, shape (N,). [m]"""
    pixel_module: NDArray[np.int64]
    """Row of their module, from 0, shape (N,)."""


def themis_8(width: float = 3.6, height: float = 1.8, gap: float = 0.05) -> Modules:
    """Modules of a heliostat like those of THEMIS: 2 columns of 4.

    Numbers 1 to 4 are the left column from the top, 5 to 8 the right one, left as the cameras at the target see it
    (y < 0). The positions are an assumption: none are published.

    Parameters
    ----------
    width, height : float
        Of a module. [m]
    gap : float
        Between modules. [m]

    Returns
    -------
    Modules
    """
    across, down = width + gap, height + gap
    centre = [(side * 0.5 * across, (1.5 - row) * down) for side in (-1, 1) for row in range(4)]
    return Modules(np.array(centre), np.tile([width, height], (8, 1)))


def mirror_grid(modules: Modules, pixel: float) -> MirrorGrid:
    """Pixels over the smallest rectangle that holds all modules, centred on it.

    Parameters
    ----------
    modules : Modules
    pixel : float
        Side of a pixel. [m]

    Returns
    -------
    MirrorGrid
        A pixel belongs to the module that holds its centre.

    Raises
    ------
    ValueError
        If a size is not positive, modules overlap, no pixel centre lies on some module, or the grid would be huge.
    """
    half = 0.5 * modules.size
    low, high = (modules.centre - half).min(axis=0), (modules.centre + half).max(axis=0)
    if not (pixel > 0.0 and np.all(modules.size > 0.0) and np.all(np.isfinite(high - low))):
        raise ValueError("modules and pixels need positive sizes")
    count = np.maximum(np.ceil((high - low) / pixel - 1e-6), 1.0)
    if count.prod() > _MOST:
        raise ValueError(f"{count.prod():.3g} pixels are too many")
    y, z = (
        0.5 * (low[axis] + high[axis]) + pixel * (np.arange(int(count[axis])) - 0.5 * (count[axis] - 1.0))
        for axis in (0, 1)
    )
    module = on_modules(modules, y, z[:, np.newaxis], _SLACK * pixel)
    present = np.bincount(module.ravel(), minlength=len(modules.size) + 1)[1:]
    if not np.all(present > 0):
        raise ValueError(f"no pixel lies on module {int(np.argmin(present)) + 1}")
    place = np.flatnonzero(module)
    rows, columns = np.divmod(place, len(y))
    return MirrorGrid(y, z, module, place, y[columns], z[rows], module.ravel()[place] - 1)


def on_modules(modules: Modules, y: ArrayLike, z: ArrayLike, slack: float = 0.0) -> NDArray[np.int64]:
    """Number of the module, from 1, that holds each of some points (y, z) [m]; 0 where none does.

    Raises
    ------
    ValueError
        If two modules hold a point.
    """
    ys, zs = np.broadcast_arrays(np.asarray(y, np.float64), np.asarray(z, np.float64))
    number = np.zeros(ys.shape, np.int64)
    for row, (centre, size) in enumerate(zip(modules.centre, modules.size, strict=True)):
        inside = (np.abs(ys - centre[0]) <= 0.5 * size[0] + slack) & (np.abs(zs - centre[1]) <= 0.5 * size[1] + slack)
        if np.any(number[inside]):
            other = int(number[inside].max())
            if _overlap(modules, other - 1, row) > 4.0 * slack:
                raise ValueError(f"modules {other} and {row + 1} overlap")
            inside &= number == 0
        number[inside] = row + 1
    return number


def eroded(grid: MirrorGrid, cells: int) -> NDArray[np.bool_]:
    """Pixels that keep their distance from the edges of their module.

    Parameters
    ----------
    grid : MirrorGrid
    cells : int
        Pixels removed along each edge.

    Returns
    -------
    ndarray of bool, shape (N,)
        True where all pixels within `cells` rows and columns belong to the same module.
    """
    padded = np.pad(grid.module, cells)
    keep = padded > 0
    # The square neighbourhood is a row of pixels after a column of pixels: all equal in both steps, all equal.
    for axis in (0, 1):
        inside = keep.copy()
        for shift in range(1, cells + 1):
            for turn in (shift, -shift):
                inside &= np.roll(keep, turn, axis) & (np.roll(padded, turn, axis) == padded)
        keep = inside
    rows, columns = grid.module.shape
    return keep[cells : cells + rows, cells : cells + columns].ravel()[grid.place]


def maps(grid: MirrorGrid, values: ArrayLike) -> Floats:
    """Values of the N pixels on modules, shape (..., N), on the grid: shape (..., nz, ny), NaN between modules."""
    packed = np.asarray(values, np.float64)
    full = np.full((*packed.shape[:-1], grid.module.size), math.nan)
    full[..., grid.place] = packed
    return full.reshape(*packed.shape[:-1], *grid.module.shape)


def _overlap(modules: Modules, one: int, other: int) -> float:
    """Smaller side of the rectangle that two modules share. [m]"""
    reach = 0.5 * (modules.size[one] + modules.size[other]) - np.abs(modules.centre[one] - modules.centre[other])
    return float(reach.min())

"""Mirror frames of the two tracking methods.

A mirror at C with the target at unit vector r has the normal n = unit(r + s) and the frame (u, v, n), v = n x u, with
its width along u and its height along v. Vectors are kept for all lanes (instants) of a packet: a block of rows,
`ROW` numbers apart in one flat array, because loops over rows at fixed offsets of one array turn into vector code.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inner
from heliosweep.kernels.packets import ROW

__all__ = ["AZIMUTH_ELEVATION", "COSINE", "FRAME_ROWS", "SPINNING_ELEVATION", "Mirrors", "half_sides"]

SPINNING_ELEVATION = 0
"""Target-aligned mount: first axis along r, the width axis u = unit(r x s) normal to the plane of incidence."""
AZIMUTH_ELEVATION = 1
"""Vertical first axis: the width axis u = unit(z x n) stays horizontal."""
FRAME_ROWS = 7
"""Rows of a frame: the half sides (w/2) u and (h/2) v, components x, y, z of each; the cosine of incidence."""
COSINE = 6 * ROW
"""Where the row of the cosine of the angle of incidence, n.s = n.r = |r + s| / 2, begins."""

_PARALLEL = 1e-30
"""Squared sine below which two directions are parallel: the cross product is rounding noise."""


class Mirrors(NamedTuple):
    """The heliostats of a field, one number (or vector) each."""

    x: NDArray[np.float64]
    """Mirror centres: east, north, up. [m]"""
    y: NDArray[np.float64]
    z: NDArray[np.float64]
    half_width: NDArray[np.float64]
    """Half sides along u and along v. [m]"""
    half_height: NDArray[np.float64]
    radius: NDArray[np.float64]
    """Radius of the bounding sphere. [m]"""
    aim: NDArray[np.float64]
    """Unit vectors r from the centres to the target, shape (N, 3). [1]"""
    throw: NDArray[np.float64]
    """Distances to the target. [m]"""


@inner
def half_sides(
    frames: NDArray[np.float64], f: int, sun: NDArray[np.float64], mirrors: Mirrors, i: int, tracking: int, lanes: int
) -> None:
    """Write the frame of one mirror for every lane of a packet.

    Degenerate cases: s parallel to r (spinning-elevation) takes u = unit(-r_y, r_x, 0); a vertical normal
    (azimuth-elevation), or r vertical as well, takes u = east. A sun exactly opposite to r has no normal: sides and
    cosine are nothing.

    Parameters
    ----------
    frames : ndarray, shape (at least f + FRAME_ROWS * ROW,)
        Receives the rows. [m]
    f : int
        Where they begin in `frames`.
    sun : ndarray, shape (3 * ROW,)
        Rows x, y, z of the unit vectors to the sun. [1]
    mirrors : Mirrors
        The field.
    i : int
        The mirror.
    tracking : int
        `SPINNING_ELEVATION` or `AZIMUTH_ELEVATION`.
    lanes : int
        Lanes of the packet; what rows hold beyond them means nothing.
    """
    f = max(f, 0)
    rx, ry, rz = mirrors.aim[i, 0], mirrors.aim[i, 1], mirrors.aim[i, 2]
    half_width, half_height = mirrors.half_width[i], mirrors.half_height[i]
    # A fallback for every lane whose u is undefined, so that the lane loops need no branch.
    level = np.sqrt(rx * rx + ry * ry)
    ex, ey = 1.0, 0.0
    if tracking == SPINNING_ELEVATION and level * level > _PARALLEL:
        ex, ey = -ry / level, rx / level
    for k in range(lanes):
        sx, sy, sz = sun[k], sun[ROW + k], sun[2 * ROW + k]
        nx, ny, nz = rx + sx, ry + sy, rz + sz
        if tracking == SPINNING_ELEVATION:
            ux, uy, uz = ry * sz - rz * sy, rz * sx - rx * sz, rx * sy - ry * sx
        else:
            ux, uy, uz = -ny, nx, 0.0
        along, across = nx * nx + ny * ny + nz * nz, ux * ux + uy * uy + uz * uz
        undefined = across < _PARALLEL
        length, width = np.sqrt(along), np.sqrt(1.0 if undefined else across)
        inverse = 1.0 / (length * width) if length > 0.0 else 0.0
        scale, inverse = inverse * length, inverse * width
        nx, ny, nz = nx * inverse, ny * inverse, nz * inverse
        ux = ex if undefined else ux * scale
        uy = ey if undefined else uy * scale
        uz = 0.0 if undefined else uz * scale
        present = half_width if length > 0.0 else 0.0
        frames[f + COSINE + k] = min(1.0, 0.5 * length)
        frames[f + k] = present * ux
        frames[f + ROW + k] = present * uy
        frames[f + 2 * ROW + k] = present * uz
        frames[f + 3 * ROW + k] = half_height * (ny * uz - nz * uy)
        frames[f + 4 * ROW + k] = half_height * (nz * ux - nx * uz)
        frames[f + 5 * ROW + k] = half_height * (nx * uy - ny * ux)

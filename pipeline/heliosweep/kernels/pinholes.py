"""Pinhole cameras that look at a heliostat.

Each camera stands at its M_i, looks at the heliostat's centre and is upright, unless it is rolled. Its pixels are
square; column u counts to the right and row v down, and the centre of the first pixel is at (0, 0).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline
from heliosweep.kernels.gazing_geometry import Scene

__all__ = ["Pinholes", "pinholes", "seen_from"]

Floats = NDArray[np.float64]


class Pinholes(NamedTuple):
    """K pinhole cameras; made by `pinholes`."""

    eyes: Floats
    """Where they are, in the mirror frame, shape (K, 3). [m]"""
    axes: Floats
    """Rows right, down and forward in the mirror frame, shape (K, 3, 3). [1]"""
    focal: Floats
    """Focal length in pixels, shape (K,)."""
    centre: Floats
    """Principal point (u, v), shape (K, 2). [pixels]"""


def pinholes(
    layout: Scene,
    shape: tuple[int, int],
    focal: ArrayLike,
    centre: ArrayLike | None = None,
    roll: ArrayLike = 0.0,
) -> Pinholes:
    """Cameras of a scene, all of which look at the heliostat's centre.

    Parameters
    ----------
    layout : Scene
        K cameras.
    shape : tuple of int
        Rows and columns of an image.
    focal : array_like, shape () or (K,)
        Focal length over the side of a pixel. [1]
    centre : array_like, shape (2,) or (K, 2), optional
        Principal point (u, v), where the heliostat's centre is seen; the middle of the image where left out. [pixels]
    roll : array_like, shape () or (K,)
        Turn about the line of sight, clockwise for someone behind the camera: the picture turns the other way. [rad]

    Returns
    -------
    Pinholes

    Raises
    ------
    ValueError
        If a focal length is not positive, or a camera looks straight up or down.
    """
    count = len(layout.eyes)
    length = np.array(np.broadcast_to(np.asarray(focal, np.float64), (count,)))
    if not (np.all(length > 0.0) and np.all(np.isfinite(length))):
        raise ValueError("focal lengths must be positive")
    middle = (0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1)) if centre is None else centre
    turn = np.broadcast_to(np.asarray(roll, np.float64), (count,))
    axes = np.empty((count, 3, 3))
    for i, eye in enumerate(layout.eyes):
        forward = -eye / math.sqrt(float(np.sum(eye**2)))
        right = _cross(forward, layout.mirror_axes[:, 2])  # the vertical of R_F in the mirror frame
        length_right = math.sqrt(float(np.sum(right**2)))
        if length_right < 1e-9:
            raise ValueError("a camera that looks straight up or down has no upright picture")
        right = right / length_right
        down = _cross(forward, right)
        c, s = math.cos(turn[i]), math.sin(turn[i])
        axes[i] = c * right + s * down, c * down - s * right, forward
    return Pinholes(
        np.array(layout.eyes),
        axes,
        length,
        np.array(np.broadcast_to(np.asarray(middle, np.float64), (count, 2))),
    )


@inline
def seen_from(cameras, i, x, y, z):
    """Where in the image of camera i a point of the mirror frame [m] is seen: (u, v). [pixels]"""
    px, py, pz = x - cameras.eyes[i, 0], y - cameras.eyes[i, 1], z - cameras.eyes[i, 2]
    right = px * cameras.axes[i, 0, 0] + py * cameras.axes[i, 0, 1] + pz * cameras.axes[i, 0, 2]
    below = px * cameras.axes[i, 1, 0] + py * cameras.axes[i, 1, 1] + pz * cameras.axes[i, 1, 2]
    depth = px * cameras.axes[i, 2, 0] + py * cameras.axes[i, 2, 1] + pz * cameras.axes[i, 2, 2]
    return (
        cameras.centre[i, 0] + cameras.focal[i] * right / depth,
        cameras.centre[i, 1] + cameras.focal[i] * below / depth,
    )


def _cross(a: Floats, b: Floats) -> Floats:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])

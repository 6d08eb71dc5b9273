"""Images of pinhole cameras that look at a heliostat, taken to the grid of pixels on its mirror.

Each camera is at its M_i, looks at the heliostat's centre and is upright, unless it is rolled. Its pixels are
square; column u counts to the right and row v down, and the centre of the first pixel is at (0, 0).

The pinhole geometry gives the position (u, v) in an image of each pixel of the mirror, a point of the ideal surface. If
corners of the heliostat are marked in the image, a homography takes the predicted corners to the marked ones: it
corrects the pointing, roll and focal length of the camera, and the geometry the mirror's sag, which a homography of a
plane does not. The level there is interpolated by the cubic of Keys [1]_ over 4 x 4 pixels.

A mirror's pixel is used if all 16 pixels lie within the picture and on the same module, none is saturated or not a
number, and all are lit or all are dark: the sun's limb or dirt does not cross them. Interpolation reduces noise
between pixels: by the root of the sum of squared weights, from 1 to 0.41.

References
----------
.. [1] R. Keys, "Cubic convolution interpolation for digital image processing", IEEE Trans. ASSP 29 (1981) 1153-1160
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.gazing.geometry import MirrorGrid, Modules, Scene, outline
from heliosweep.kernels.gazing.rays import ideal_mirror


class Pinholes(NamedTuple):
    """K pinhole cameras; made by `pinholes`.

    Attributes
    ----------
    eyes : ndarray, shape (K, 3)
        Positions in the mirror frame. [m]
    axes : ndarray, shape (K, 3, 3)
        Rows right, down and forward in the mirror frame. [1]
    focal : ndarray, shape (K,)
        Focal length. [pixels]
    centre : ndarray, shape (K, 2)
        Principal point (u, v). [pixels]
    """

    eyes: Floats
    axes: Floats
    focal: Floats
    centre: Floats


def pinholes(
    layout: Scene,
    shape: tuple[int, int],
    focal: ArrayLike,
    centre: ArrayLike | None = None,
    roll: ArrayLike = 0.0,
) -> Pinholes:
    """Return the cameras of a scene as pinholes that look at the heliostat's centre.

    Parameters
    ----------
    layout : Scene
        K cameras.
    shape : (int, int)
        Rows and columns of an image.
    focal : array_like, shape () or (K,)
        Focal lengths over the side of a pixel. [1]
    centre : array_like, shape (2,) or (K, 2), optional
        Principal points (u, v), where the heliostat's centre is seen (default: the middle). [pixels]
    roll : array_like, shape () or (K,)
        Rotation about the line of sight, clockwise for an observer behind the camera; pictures rotate the other way.
        [rad]

    Raises
    ------
    ValueError
        If a camera looks straight up or down.
    """
    count = len(layout.eyes)
    turn = np.broadcast_to(np.asarray(roll, np.float64), (count,))[:, np.newaxis]
    forward = -layout.eyes / np.sqrt(np.sum(layout.eyes**2, axis=1, keepdims=True))
    right = np.cross(forward, layout.mirror_axes[:, 2])  # the vertical of R_F in the mirror frame
    length = np.sqrt(np.sum(right**2, axis=1, keepdims=True))
    if np.any(length < 1e-9):
        raise ValueError("a camera that looks straight up or down has no upright picture")
    right = right / length
    down, c, s = np.cross(forward, right), np.cos(turn), np.sin(turn)
    middle = (0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1)) if centre is None else centre
    return Pinholes(
        layout.eyes,
        np.stack((c * right + s * down, c * down - s * right, forward), axis=1),
        np.array(np.broadcast_to(np.asarray(focal, np.float64), (count,))),
        np.array(np.broadcast_to(np.asarray(middle, np.float64), (count, 2))),
    )


#: Distance of the pixels used from the edge of a module, for residual errors of registration. [pixels]
MARGIN = 0.1
#: Reasons that exclude a camera's value at a pixel of the mirror, as bits.
OUT_OF_FRAME, AT_EDGE, SATURATED, NOT_A_NUMBER, AT_LIMB = 1, 2, 4, 8, 16


def places_of(cameras: Pinholes, focal_length: float, pixels: Floats) -> Floats:
    """Return the positions (u, v) in the images of points (y, z), shape (2, N) [m], of the ideal mirror, (K, 2, N)."""
    x, _, _ = ideal_mirror(focal_length, *pixels)
    way = np.stack((x, *pixels)) - cameras.eyes[:, :, np.newaxis]
    right, below, depth = np.moveaxis(np.sum(cameras.axes[..., np.newaxis] * way[:, np.newaxis], axis=2), 1, 0)
    focal = cameras.focal[:, np.newaxis]
    return cameras.centre[:, :, np.newaxis] + np.stack((focal * right / depth, focal * below / depth), axis=1)


def homography(here: Floats, there: Floats) -> Floats:
    """Return the projective map H of a plane, shape (3, 3), that takes four points to others: `there` ~ H (here, 1).

    Raises ValueError if three of the points, shape (4, 2), are in one line, or the map turns the picture inside out.
    """
    (x, y), (u, v), one, none = here.T, there.T, np.ones(4), np.zeros(4)
    rows = np.concatenate(
        (
            np.stack((x, y, one, none, none, none, -u * x, -u * y), axis=1),
            np.stack((none, none, none, x, y, one, -v * x, -v * y), axis=1),
        )
    )
    if not np.linalg.cond(rows / np.abs(rows).max(axis=0)) < 1e8:
        raise ValueError("points in one line do not determine a homography")
    found = np.append(np.linalg.solve(rows, np.concatenate((u, v))), 1.0).reshape(3, 3)
    depth = found[2, 0] * x + found[2, 1] * y + 1.0
    if np.any(depth * depth[0] <= 0.0) or np.linalg.det(found) <= 0.0:
        raise ValueError("the points do not follow each other in the same direction")
    return found


def moved(matrix: Floats, points: Floats) -> Floats:
    """Return points (2, N) after a homography."""
    x, y, depth = matrix @ np.stack((*points, np.ones_like(points[0])))
    return np.stack((x / depth, y / depth))


def rectify(
    images: Floats,
    cameras: Pinholes,
    focal_length: float,
    modules: Modules,
    grid: MirrorGrid,
    *,
    corners: ArrayLike | None = None,
    saturation: ArrayLike = math.inf,
    threshold: float = -math.inf,
) -> tuple[Floats, Integers, Floats]:
    """Interpolate images on the pixels of a mirror.

    Parameters
    ----------
    images : ndarray, shape (K, rows, columns)
        In any scale.
    cameras : Pinholes
        K cameras.
    focal_length : float
        Of the ideal mirror. [m]
    modules : Modules
    grid : MirrorGrid
        N pixels on modules.
    corners : array_like, shape (K, 4, 2), optional
        Positions of the corners of `outline` in each image, in its order; NaN if the geometry of the image is known.
        [pixels]
    saturation : array_like, shape () or (K,)
        Value from which a pixel is saturated.
    threshold : float
        Minimum value of a lit pixel.

    Returns
    -------
    values : ndarray, shape (K, N)
        Interpolated; NaN if `flags` is not 0.
    flags : ndarray of int, shape (K, N)
        Sums of `OUT_OF_FRAME`, `AT_EDGE`, `SATURATED`, `NOT_A_NUMBER` and `AT_LIMB`.
    noise : ndarray, shape (K, N)
        Root of the sum of squared weights: standard deviation of the value for pixels of standard deviation 1.

    Raises
    ------
    ValueError
        If corners do not determine a homography.
    """
    count, rows, columns = images.shape
    signs = np.array([[-1.0, 1.0, 1.0, -1.0], [1.0, 1.0, -1.0, -1.0]])
    edges = modules.centre.T[:, :, np.newaxis] + 0.5 * modules.size.T[:, :, np.newaxis] * signs[:, np.newaxis]
    limits = np.broadcast_to(np.asarray(saturation, np.float64), (count,))
    values, noise = np.empty((2, count, grid.place.size))
    flags = np.zeros(values.shape, np.int64)
    every = (
        places_of(cameras, focal_length, points) for points in (grid.pixels, edges.reshape(2, -1), outline(modules).T)
    )
    for i, (places, quads, ends) in enumerate(zip(*every, strict=True)):
        if corners is not None and not np.any(np.isnan(marked := np.asarray(corners, np.float64)[i])):
            found = homography(ends.T, marked)
            places, quads = moved(found, places), moved(found, quads)
        u, v = places
        inside = (u >= 1.0) & (u < columns - 2.0) & (v >= 1.0) & (v < rows - 2.0)  # False for NaN
        column, row = (np.where(inside, at, 1.0).astype(np.int64) for at in (u, v))
        # The block of 4 x 4 pixels is convex, and so is the module: its corners decide.
        ahead = np.roll(quads.reshape(2, -1, 4), -1, axis=-1) - quads.reshape(2, -1, 4)
        n_u, n_v = np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead)  # inwards, clockwise on the screen
        shift = -(n_u * quads[0].reshape(-1, 4) + n_v * quads[1].reshape(-1, 4))
        n_u, n_v, shift = (each[grid.pixel_module].T for each in (n_u, n_v, shift))
        far = n_u * (column + 0.5) + n_v * (row + 0.5) + shift - 2.0 * (np.abs(n_u) + np.abs(n_v))
        total, square, dark = np.zeros((3, u.size))
        for n in range(16):
            here_u, here_v = column - 1 + n % 4, row - 1 + n // 4
            weight, value = _weight(u - here_u) * _weight(v - here_v), images[i, here_v, here_u]
            flags[i] |= NOT_A_NUMBER * np.isnan(value) | SATURATED * (value >= limits[i])
            total, square, dark = total + weight * value, square + weight * weight, dark + (value < threshold)
        flags[i] |= AT_EDGE * ~np.all(far >= MARGIN, axis=0) | AT_LIMB * ((dark > 0) & (dark < 16))
        flags[i] = np.where(inside, flags[i], OUT_OF_FRAME)
        values[i], noise[i] = np.where(flags[i] == 0, (total, np.sqrt(square)), np.nan)
    return values, flags, noise


def _weight(distance: Floats) -> Floats:
    """Return the weights of the cubic of Keys with a = -1/2 for pixels at a distance below 2. [pixels]"""
    d = np.abs(distance)
    return np.where(d <= 1.0, 1.0 + d * d * (1.5 * d - 2.5), 2.0 + d * (-4.0 + d * (2.5 - 0.5 * d)))

"""Images of pinhole cameras that look at a heliostat, taken to the grid of pixels on its mirror.

Each camera stands at its M_i, looks at the heliostat's centre and is upright, unless it is rolled. Its pixels are
square; column u counts to the right and row v down, and the centre of the first pixel is at (0, 0).

Each pixel of the mirror, a point of the ideal surface, is seen at a place (u, v) of an image that the pinhole geometry
tells. Where corners of the heliostat are marked in the image, a homography takes the corners that the geometry predicts
to those marked: it takes up how the camera was really pointed, rolled and focused, and the geometry the mirror's
sag, which no homography of a plane would. The level there is interpolated by the cubic of Keys [1]_ over 4 x 4 pixels.

A mirror's pixel is used if all these 16 lie within the picture and on the same module, and none is saturated or not a
number; nor may some be lit and others dark, where the sun's limb crosses them or dirt lies. Interpolation reduces noise
between pixels: by the root of the sum of squared weights, from 1 to 0.41.

References
----------
.. [1] R. Keys, "Cubic convolution interpolation for digital image processing", IEEE Trans. ASSP 29 (1981) 1153-1160
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import MirrorGrid, Modules, Scene, outline
from heliosweep.kernels.gazing.rays import ideal_mirror


class Pinholes(NamedTuple):
    """K pinhole cameras; made by `pinholes`."""

    eyes: Floats
    """Positions in the mirror frame, shape (K, 3). [m]"""
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
    """K cameras of a scene, all of which look at the heliostat's centre.

    Of the shape (rows, columns) of an image, focal lengths over the side of a pixel, shape () or (K,), principal points
    (u, v) where the heliostat's centre is seen, shape (2,) or (K, 2) [pixels], in the middle where left out, and turns
    about the line of sight, clockwise for someone behind the camera, shape () or (K,) [rad]: pictures turn the other
    way. Raises ValueError if a focal length is not positive, or a camera looks straight up or down.
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
        right = np.cross(forward, layout.mirror_axes[:, 2])  # the vertical of R_F in the mirror frame
        length_right = math.sqrt(float(np.sum(right**2)))
        if length_right < 1e-9:
            raise ValueError("a camera that looks straight up or down has no upright picture")
        right = right / length_right
        down = np.cross(forward, right)
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
    """Place (u, v) in the image of camera i of a point of the mirror frame [m]. [pixels]"""
    px, py, pz = x - cameras.eyes[i, 0], y - cameras.eyes[i, 1], z - cameras.eyes[i, 2]
    right = px * cameras.axes[i, 0, 0] + py * cameras.axes[i, 0, 1] + pz * cameras.axes[i, 0, 2]
    below = px * cameras.axes[i, 1, 0] + py * cameras.axes[i, 1, 1] + pz * cameras.axes[i, 1, 2]
    depth = px * cameras.axes[i, 2, 0] + py * cameras.axes[i, 2, 1] + pz * cameras.axes[i, 2, 2]
    return (
        cameras.centre[i, 0] + cameras.focal[i] * right / depth,
        cameras.centre[i, 1] + cameras.focal[i] * below / depth,
    )


_MARGIN = 0.1
"""Room between the pixels used and the edge of a module, for what registration leaves. [pixels]"""
OUT_OF_FRAME, AT_EDGE, SATURATED, NOT_A_NUMBER, AT_LIMB = 1, 2, 4, 8, 16
"""Why a camera's value is not used at a pixel of the mirror; the sum where there are several reasons."""


def places_of(cameras: Pinholes, focal_length: float, y: ArrayLike, z: ArrayLike) -> Floats:
    """Places (u, v) in the images of points (y, z) [m] of the ideal mirror, shape (K, 2, N). [pixels]"""
    return _places(cameras, float(focal_length), np.array(y, np.float64), np.array(z, np.float64))


def homography(here: ArrayLike, there: ArrayLike) -> Floats:
    """The projective map H of a plane, shape (3, 3), that takes points (n, 2) nearest to others: `there` ~ H (here, 1).

    Exact for 4 points, of least squares in scaled coordinates for more. Raises ValueError if the points do not
    determine the map, as where three of four are in one line, or the map turns the picture inside out.
    """
    a, b = np.asarray(here, np.float64), np.asarray(there, np.float64)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 2 or len(a) < 4:
        raise ValueError("a homography needs 4 pairs of points at least")
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        raise ValueError("the points of a homography must be finite")
    p, q = _scaling(a), _scaling(b)
    x, y = moved(p, a).T
    u, v = moved(q, b).T
    one, none = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        (
            np.stack((x, y, one, none, none, none, -u * x, -u * y, -u), axis=1),
            np.stack((none, none, none, x, y, one, -v * x, -v * y, -v), axis=1),
        )
    )
    _, sizes, solutions = np.linalg.svd(rows)
    if not sizes[7] > 1e-6 * sizes[0]:
        raise ValueError("points in one line do not determine a homography")
    core = solutions[-1].reshape(3, 3)
    found = np.linalg.solve(q, core @ p)
    depth = np.sum(found[2] * np.column_stack((a, np.ones(len(a)))), axis=1)
    found = found / (depth[0] if depth[0] != 0.0 else 1.0)
    if np.any(depth * depth[0] <= 0.0) or np.linalg.det(found) <= 0.0:
        raise ValueError("the points do not follow each other the same way round")
    return found


def moved(matrix: Floats, points: Floats) -> Floats:
    """Points (..., 2) after a homography."""
    x, y = points[..., 0], points[..., 1]
    depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
    return np.stack([(matrix[row, 0] * x + matrix[row, 1] * y + matrix[row, 2]) / depth for row in (0, 1)], axis=-1)


def rectify(
    images: ArrayLike,
    cameras: Pinholes,
    focal_length: float,
    modules: Modules,
    grid: MirrorGrid,
    *,
    corners: ArrayLike | None = None,
    saturation: ArrayLike = math.inf,
    threshold: float = -math.inf,
) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Images on the pixels of a mirror.

    Parameters
    ----------
    images : array_like, shape (K, rows, columns)
        In any scale.
    cameras : Pinholes
        K cameras.
    focal_length : float
        Of the ideal mirror. [m]
    modules : Modules
    grid : MirrorGrid
        N pixels on modules.
    corners : array_like, shape (K, 4, 2), optional
        Where each image shows the corners of `outline`, in its order; NaN for an image in which the geometry alone
        counts. [pixels]
    saturation : array_like, shape () or (K,)
        Value from which on a pixel is saturated.
    threshold : float
        Least value of a lit pixel.

    Returns
    -------
    values : ndarray, shape (K, N)
        Interpolated; NaN where `flags` is not 0.
    flags : ndarray of int64, shape (K, N)
        Sums of `OUT_OF_FRAME`, `AT_EDGE`, `SATURATED`, `NOT_A_NUMBER` and `AT_LIMB`.
    noise : ndarray, shape (K, N)
        Root of the sum of squared weights: standard deviation of the value for pixels of standard deviation 1.

    Raises
    ------
    ValueError
        If corners determine no homography; the message begins with the number of the image, from 1.
    """
    pictures = np.array(images, np.float64, order="C")
    count = len(cameras.eyes)
    if pictures.ndim != 3 or len(pictures) != count:
        raise ValueError("one image is needed for each camera")
    places = places_of(cameras, focal_length, grid.pixel_y, grid.pixel_z)
    edges = _module_corners(modules)
    quads = places_of(cameras, focal_length, edges[:, :, 0].ravel(), edges[:, :, 1].ravel())
    if corners is not None:
        ends = outline(modules)
        predicted = places_of(cameras, focal_length, ends[:, 0], ends[:, 1])
        for i, marked in enumerate(np.asarray(corners, np.float64)):
            if np.all(np.isnan(marked)):
                continue
            try:
                found = homography(predicted[i].T, marked)
            except ValueError as error:
                raise ValueError(f"image {i + 1}: {error}") from None
            places[i], quads[i] = moved(found, places[i].T).T, moved(found, quads[i].T).T
    limits = np.array(np.broadcast_to(np.asarray(saturation, np.float64), (count,)))
    sides = _sides(quads.reshape(count, 2, len(edges), 4))
    return _rectified(pictures, places, sides, grid.pixel_module, limits, float(threshold))


def _module_corners(modules: Modules) -> Floats:
    """Corners (y, z) of each module in the order of `outline`, shape (M, 4, 2). [m]"""
    signs = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
    return modules.centre[:, np.newaxis] + 0.5 * modules.size[:, np.newaxis] * signs


def _sides(quads: Floats) -> Floats:
    """Sides of the modules in the images as (n_u, n_v, c): n.(u, v) + c is the distance inwards, (K, M, 4, 3)."""
    ahead = np.roll(quads, -1, axis=-1) - quads
    length = np.hypot(ahead[:, 0], ahead[:, 1])
    with np.errstate(all="ignore"):
        n_u, n_v = -ahead[:, 1] / length, ahead[:, 0] / length  # clockwise on the screen, whose v axis points down
    return np.stack((n_u, n_v, -(n_u * quads[:, 0] + n_v * quads[:, 1])), axis=-1)


def _scaling(points: Floats) -> Floats:
    """Similarity that brings points to a mean of 0 and a mean distance of root 2."""
    middle = points.mean(axis=0)
    spread = float(np.mean(np.hypot(points[:, 0] - middle[0], points[:, 1] - middle[1])))
    if not spread > 0.0:
        raise ValueError("points in one place do not determine a homography")
    k = math.sqrt(2.0) / spread
    return np.array([[k, 0.0, -k * middle[0]], [0.0, k, -k * middle[1]], [0.0, 0.0, 1.0]])


@kernel
def _places(cameras: Pinholes, focal_length: float, y: Floats, z: Floats) -> Floats:
    count, pixels = cameras.eyes.shape[0], y.size
    out = np.empty((count, 2, pixels))
    for k in range(pixels):
        x, _, _ = ideal_mirror(focal_length, y[k], z[k])
        for i in range(count):
            out[i, 0, k], out[i, 1, k] = seen_from(cameras, i, x, y[k], z[k])
    return out


@inline
def _weight(distance: float) -> float:
    """Weight of the cubic of Keys with a = -1/2 for a pixel at a distance below 2. [pixels]"""
    d = abs(distance)
    return 1.0 + d * d * (1.5 * d - 2.5) if d <= 1.0 else 2.0 + d * (-4.0 + d * (2.5 - 0.5 * d))


@kernel
def _rectified(
    images: Floats,
    places: Floats,
    sides: Floats,
    module: NDArray[np.int64],
    limits: Floats,
    threshold: float,
) -> tuple[Floats, NDArray[np.int64], Floats]:
    """`rectify` with places and sides known."""
    count, rows, columns = images.shape
    pixels = module.size
    values, noise = np.full((count, pixels), math.nan), np.full((count, pixels), math.nan)
    flags = np.zeros((count, pixels), np.int64)
    for i in range(count):
        for k in range(pixels):
            u, v = places[i, 0, k], places[i, 1, k]
            # Comparisons are False for NaN, and nothing else may become an index.
            if not (1.0 <= u < columns - 2.0 and 1.0 <= v < rows - 2.0):
                flags[i, k] = OUT_OF_FRAME
                continue
            column, row = int(u), int(v)
            # The block of 4 x 4 pixels is convex, and so is the module: its corners decide.
            for side in range(4):
                n_u, n_v = sides[i, module[k], side, 0], sides[i, module[k], side, 1]
                far = n_u * (column + 0.5) + n_v * (row + 0.5) + sides[i, module[k], side, 2]
                if not far - 2.0 * (abs(n_u) + abs(n_v)) >= _MARGIN:
                    flags[i, k] |= AT_EDGE
            total, square, dark = 0.0, 0.0, 0
            for n in range(16):
                here_u, here_v = column - 1 + n % 4, row - 1 + n // 4
                weight = _weight(u - here_u) * _weight(v - here_v)
                value = images[i, here_v, here_u]
                if math.isnan(value):
                    flags[i, k] |= NOT_A_NUMBER
                elif value >= limits[i]:
                    flags[i, k] |= SATURATED
                elif value < threshold:
                    dark += 1
                total += weight * value
                square += weight * weight
            if 0 < dark < 16:
                flags[i, k] |= AT_LIMB
            if flags[i, k] == 0:
                values[i, k], noise[i, k] = total, math.sqrt(square)
    return values, flags, noise

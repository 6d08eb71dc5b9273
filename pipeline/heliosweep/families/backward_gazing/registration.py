"""Automatic registration of photographs: the corners of the heliostat in an image, found by scikit-image.

Rotation, scale and shift come from the phase correlation of the lit pixels with the silhouette of the modules as an
upright camera sees it. Then each side of the heliostat is located within a fraction of a pixel: the light across it
gives its offset at many positions, and a line is fitted to the offsets by RANSAC. Adjacent sides intersect in a corner.

The layout of the modules looks the same upside down: a camera may be rotated by up to 40 deg.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates, uniform_filter

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.gazing.geometry import Modules, outline

#: Side of the images that are correlated [pixels], rotations [rad], and scales relative to the root of the lit area,
#: which dark modules make too small.
COARSE, TURNS, SCALES = 96, np.radians(np.arange(-40.0, 41.0, 4.0)), np.exp(np.arange(-0.16, 0.53, 0.06))
#: Maximum distance of a side from its expected position in each round; half the width of its blur, and width of the
#: bands on both sides that give the levels. [pixels]
REACH, BLUR, LEVEL = (6.0, 4.0, 1.0, 1.0, 1.0, 1.0), 1.75, 2.0
#: Distance between positions along a side and across it, and of offsets from their line. [pixels]
ALONG, ACROSS, NEAR = 0.8, 0.25, 0.15
#: Minimum brightness of a lit pixel, and maximum part of the outermost pixels brighter than half of the sun. [1]
LIT, MOST_CUT = 0.3, 0.05
#: Minimum number of offsets on a side, maximum root mean square of their residuals, and maximum ratio of the scales
#: along two axes: 1.002 for a right result, 1.056 if THEMIS is rotated by 90 deg. [1, pixels, 1]
LEAST, MOST_RESIDUAL, MOST_STRETCH = 12, 0.5, 1.02


def register(
    image: Floats, upright: Callable[[Floats], Floats], modules: Modules
) -> tuple[Floats, float, float, Floats, float]:
    """Find a heliostat in an image.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Brightness relative to the sun's centre; NaN counts as dark. [1]
    upright : callable
        Function of points (y, z) of the mirror, shape (2, n) [m], that returns their positions in the image of an
        upright camera of any focal length, shape (2, n). [pixels]
    modules : Modules
        Modules of the heliostat.

    Returns
    -------
    corners : ndarray, shape (4, 2)
        Upper left, upper right, lower right, lower left (column, row). [pixels]
    turn, scale : float
        Rotation, clockwise [rad], and scale relative to the upright picture.
    centre : ndarray, shape (2,)
        Column and row of the heliostat's centre. [pixels]
    residual : float
        Root mean square of the offsets from the sides. [pixels]

    Raises
    ------
    ValueError
        If nothing like the heliostat is in the image, or scikit-image is missing.
    """
    try:
        from skimage.transform import ProjectiveTransform
    except ImportError:
        raise ValueError("registration needs scikit-image: pip install 'heliosweep[images]'") from None
    seen = np.nan_to_num(image, posinf=0.0, neginf=0.0)
    if np.mean(np.concatenate((seen[0], seen[-1], seen[1:-1, 0], seen[1:-1, -1])) > 0.5) > MOST_CUT:
        raise ValueError("it is lit up to the edge of the frame, which seems to cut the heliostat")
    ends = outline(modules).T
    predicted = upright(ends).T
    whole: Any = _coarse(seen, upright, modules)
    for reach in REACH:
        corners, residual = _corners(seen, upright, whole, ends, reach)
        whole = ProjectiveTransform.from_estimate(predicted, corners)
        if not whole or not residual <= MOST_RESIDUAL:
            raise ValueError(f"the edges of the modules do not fit: they are {residual:.2g} pixels off")
    middle = predicted.mean(axis=0)
    across, down = whole(middle + np.eye(2)) - whole(middle)
    long, short = np.linalg.svd(np.stack((across, down)), compute_uv=False)
    if long > MOST_STRETCH * short:
        raise ValueError(f"its picture is stretched by {100 * (long / short - 1):.0f} %, as if rotated by over 40 deg")
    centre = whole(upright(np.zeros((2, 1))).T)[0]
    return corners, math.atan2(across[1], across[0]), float(np.hypot(*across)), centre, residual


def _coarse(seen: Floats, upright: Callable[[Floats], Floats], modules: Modules) -> Any:
    """Return the rotation, scale and shift of the silhouette that matches the lit pixels best."""
    from skimage.draw import polygon
    from skimage.registration import phase_cross_correlation
    from skimage.transform import SimilarityTransform

    step = max(max(seen.shape) / COARSE, 1.0)
    size = np.array(seen.shape) // step
    places = [(np.arange(side) + 0.5) * step - 0.5 for side in size]
    lit = uniform_filter(np.clip(seen / LIT, 0.0, 1.0), max(round(step), 1))
    small = map_coordinates(lit, np.meshgrid(*places, indexing="ij"), order=1)
    if not small.sum() > 0.0:
        raise ValueError("no pixel of it is lit")
    signs = np.array([[-0.5, 0.5, 0.5, -0.5], [0.5, 0.5, -0.5, -0.5]])
    corners = modules.centre.T[:, :, np.newaxis] + modules.size.T[:, :, np.newaxis] * signs[:, np.newaxis]
    quads, ends = upright(corners.reshape(2, -1)).T, upright(outline(modules).T)
    area = abs(np.linalg.det(np.diff(ends[:, :3], axis=1)))
    about, best = math.sqrt(small.sum() * step**2 / area), (-1.0, None)
    for scale in about * SCALES:
        for turn in TURNS:
            map_ = SimilarityTransform(translation=-ends.mean(axis=1)) + SimilarityTransform(scale=scale, rotation=turn)
            mask = np.zeros(small.shape)
            for quad in (map_(quads) / step + 0.5 * size[::-1]).reshape(-1, 4, 2):
                mask[polygon(quad[:, 1], quad[:, 0], mask.shape)] = 1.0
            shift, _, _ = phase_cross_correlation(small, mask, normalization=None)
            overlap = float(np.sum(np.roll(mask, shift.astype(int), axis=(0, 1)) * small))
            score = overlap / (small.sum() + 0.3 * (mask.sum() - overlap))
            if score > best[0]:
                place = SimilarityTransform(translation=step * (0.5 * size + shift + 0.5)[::-1] - 0.5)
                best = score, map_ + place
    return best[1]


def _corners(
    seen: Floats, upright: Callable[[Floats], Floats], whole: Any, ends: Floats, reach: float
) -> tuple[Floats, float]:
    """Return the corners in the image, shape (4, 2), and the residual, from sides at most `reach` away."""
    from skimage.measure import LineModelND, ransac

    lines, squares = [], []
    t = np.arange(-BLUR - LEVEL - reach, BLUR + LEVEL + reach + 1e-9, ACROSS)
    inside, outside = t <= -BLUR - reach + 1e-9, t >= BLUR + reach - 1e-9
    between = slice(np.count_nonzero(inside) - 1, 1 - np.count_nonzero(outside))
    for first, last in zip(ends.T, np.roll(ends, -1, axis=1).T, strict=True):
        chord = np.diff(whole(upright(np.stack((first, last), axis=1)).T), axis=0)
        count = max(int(np.hypot(*chord[0]) / ALONG), 2)
        share = np.linspace(0.0, 1.0, count)
        points = whole(upright(first[:, np.newaxis] * (1.0 - share) + last[:, np.newaxis] * share).T)
        along = np.gradient(points, axis=0)
        normal = np.stack((along[:, 1], -along[:, 0]), axis=1) / np.hypot(*along.T)[:, np.newaxis]  # outwards
        u, v = (points[:, np.newaxis] + t[:, np.newaxis] * normal[:, np.newaxis]).transpose(2, 0, 1)
        values = map_coordinates(seen, [v, u], order=1, cval=0.0)
        level, slope = np.polynomial.polynomial.polyfit(t[inside], values[:, inside].T, 1)
        base = values[:, outside].mean(axis=1, keepdims=True)
        with np.errstate(all="ignore"):
            part = (values - base) / (level[:, np.newaxis] + slope[:, np.newaxis] * t - base)
        offset = np.trapezoid(part[:, between], dx=ACROSS, axis=1) - BLUR - reach
        good = (values[:, inside].min(axis=1) > LIT) & (base[:, 0] < 0.5 * level) & (np.abs(offset) <= reach)
        if np.count_nonzero(good) < LEAST:
            raise ValueError("too few edges of its modules are seen in it")
        data = np.stack((ALONG * np.arange(count), offset), axis=1)[good]
        _, kept = ransac(data, LineModelND, min_samples=2, residual_threshold=NEAR, max_trials=200, rng=0)
        fit = np.polyfit(data[kept, 0], data[kept, 1], 1)
        squares.append((data[kept, 1] - np.polyval(fit, data[kept, 0])) ** 2)
        moved = points[[0, -1]] + np.polyval(fit, [[0.0], [ALONG * (count - 1)]]) * normal[[0, -1]]
        lines.append(np.cross(*np.column_stack((moved, np.ones(2)))))
    corners = np.cross(np.roll(lines, 1, axis=0), lines)
    return corners[:, :2] / corners[:, 2:], math.sqrt(np.mean(np.concatenate(squares)))

"""Where photographs show the heliostat, found from the photographs themselves.

Shift, turn and scale of each image against the heliostat are searched for in two steps. First the silhouette of the
modules, as the camera of the scene would see it, is correlated with the lit part of the image by Fourier transforms,
for a series of turns and scales. Then the places where the image falls to half of its level along the outer edges of
the modules are found to a part of a pixel, and a map of the plane (a homography) is fitted to them: of least squares,
edges that lie farther off than most left out. What is found are the four corners that a user could have marked.

The layout of the modules looks the same upside down: a camera may be turned by up to 40 deg.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, rfft2
from scipy.ndimage import map_coordinates, uniform_filter

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.gazing.geometry import Modules, outline
from heliosweep.kernels.gazing.rectification import homography, moved

#: Side of the images that are correlated, largest turn and its steps, and steps of the scale. [pixels], [rad], [1]
COARSE, MOST_TURN, STEP, SCALE_STEP = 96, math.radians(40.0), math.radians(4.0), 0.06
#: Scales that are tried against the root of the lit area, which dark modules make too small.
SCALES = 0.85, 1.7
#: What a dark place on a module counts against a lit one beside the modules.
DARK = 0.3
#: How far from where it is expected an edge is looked for, round after round; in the last ones a homography is free.
REACH, FREE = (6.0, 4.0, 1.0, 1.0, 1.0, 1.0), 3
#: Distance between places along an edge, and across it. [pixels]
ALONG, ACROSS = 0.8, 0.25
#: Pixels beside an edge that blur it, and beyond these those that tell the levels on both sides.
BLUR, LEVEL = 1.75, 2.0
#: Least brightness of a lit pixel. [1]
LIT = 0.3
#: Fewest places of all edges, and of each side of the heliostat for a homography instead of turn, scale and shift.
LEAST, LEAST_OF_SIDE = 24, 12
#: Residual of the edges above which nothing was found. [pixels]
MOST_RESIDUAL = 0.5
#: By how much a picture may be stretched one way against what an upright camera sees: by 1.002 where all is right, by
#: 1.056 where the heliostat of THEMIS is turned by 90 deg and taken for upright. [1]
MOST_STRETCH = 1.02
#: Share of the frame's outermost pixels that may be brighter than half of the sun. [1]
MOST_CUT = 0.05


Predict = Callable[[Floats], Floats]


class Registered(NamedTuple):
    """Place of a heliostat in an image."""

    corners: Floats
    """Upper left, upper right, lower right, lower left (column, row), shape (4, 2). [pixels]"""
    turn: float
    """Of the picture against what an upright camera sees, clockwise. [rad]"""
    scale: float
    """Against the picture of `predicted`. [1]"""
    centre: tuple[float, float]
    """Column and row of the heliostat's centre. [pixels]"""
    residual: float
    """Root mean square distance of the edges from where they should be. [pixels]"""
    edges: int
    """Places of edges that were used."""


def register(image: Floats, upright: Predict, modules: Modules) -> Registered:
    """Find a heliostat in an image.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Brightness relative to the sun's centre; NaN counts as dark. [1]
    upright : callable
        Where an upright camera of any focal length would see points (y, z) [m] of the mirror: of shape (n, 2) in both
        cases. [pixels]
    modules : Modules

    Raises
    ------
    ValueError
        Nothing like the heliostat is in the image; says what to do.
    """
    seen = np.nan_to_num(np.asarray(image, np.float64), posinf=0.0, neginf=0.0)
    border = np.concatenate((seen[0], seen[-1], seen[1:-1, 0], seen[1:-1, -1]))
    if np.mean(border > 0.5) > MOST_CUT:
        raise ValueError("it is lit up to the edge of the frame, which seems to cut the heliostat")
    predicted = upright(outline(modules))
    plane, middle = homography(outline(modules) * [1.0, -1.0], predicted), predicted.mean(axis=0)
    whole = _coarse(np.clip(seen / LIT, 0.0, 1.0), np.asarray(np.linalg.inv(plane), np.float64), modules, predicted)
    area = [
        abs(np.linalg.det((corners[1:3] - corners[0]).T)) for corners in (outline(modules), moved(whole, predicted))
    ]
    edges = _outer_edges(modules, math.sqrt(area[0] / area[1]))
    seen_edges = [upright(edges[:, columns] * [1.0, -1.0]) for columns in ((0, 1), (2, 3))]
    residual, count = math.inf, 0
    for number, reach in enumerate(REACH):
        place, before = (moved(whole, one) for one in seen_edges)
        away = before - place
        normal = away / np.hypot(*away.T)[:, np.newaxis]
        offset = _offsets(seen, place, normal, reach)
        kept = np.isfinite(offset)
        for _ in range(3):  # of what is left, edges that lie farther off than most are left out
            if np.count_nonzero(kept) < LEAST:
                raise ValueError("too few edges of its modules are seen in it")
            sides = np.bincount(edges[kept, 4].astype(int), minlength=4)
            free = number >= len(REACH) - FREE and sides.min() >= LEAST_OF_SIDE
            step, rest = _step(place - middle, normal, offset, kept, free)
            kept &= np.abs(rest) <= max(4.0 * float(np.median(np.abs(rest[kept]))), 0.02)
        back = np.array([[1.0, 0.0, middle[0]], [0.0, 1.0, middle[1]], [0.0, 0.0, 1.0]])
        whole = back @ step @ np.linalg.inv(back) @ whole
        residual, count = float(np.sqrt(np.mean(rest[kept] ** 2))), int(np.count_nonzero(kept))
    if not residual <= MOST_RESIDUAL:
        raise ValueError(f"the edges of the modules do not fit: they are {residual:.2g} pixels off")
    centre, *corners = moved(whole, np.concatenate((upright(np.zeros((1, 2))), predicted)))
    across, down = moved(whole, middle + np.eye(2)) - moved(whole, middle)
    long, short = np.linalg.svd(np.stack((across, down)), compute_uv=False)
    if long > MOST_STRETCH * short:
        share = 100.0 * (long / short - 1.0)
        raise ValueError(f"its picture is stretched by {share:.0f} %, as if turned by more than 40 deg")
    return Registered(
        np.array(corners), math.atan2(across[1], across[0]), float(np.hypot(*across)),
        (float(centre[0]), float(centre[1])), residual, count,
    )  # fmt: skip


def _coarse(lit: Floats, to_plane: Floats, modules: Modules, predicted: Floats) -> Floats:
    """Turn, scale and shift of the silhouette that covers most of the lit pixels, as a matrix of shape (3, 3)."""
    step = max(max(lit.shape) / COARSE, 1.0)
    rows, columns = (int(side / step) for side in lit.shape)
    v, u = np.meshgrid((np.arange(rows) + 0.5) * step - 0.5, (np.arange(columns) + 0.5) * step - 0.5, indexing="ij")
    small = map_coordinates(uniform_filter(lit, max(round(step), 1)), [v, u], order=1)
    spectrum, total, shape = rfft2(small, (2 * rows, 2 * columns)), float(small.sum()), (2 * rows, 2 * columns)
    middle, own = predicted.mean(axis=0), abs(np.linalg.det((predicted[1:3] - predicted[0]).T))
    if not total > 0.0:
        raise ValueError("no pixel of it is lit")
    about = math.sqrt(total * step**2 / own)
    centre = np.array([u.mean(), v.mean()])
    best, found = -1.0, np.eye(3)
    for scale in about * np.exp(np.arange(math.log(SCALES[0]), math.log(SCALES[1]), SCALE_STEP)):
        for turn in np.arange(-MOST_TURN, MOST_TURN + 1e-9, STEP):
            a, b = scale * math.cos(turn), scale * math.sin(turn)
            x, y = u - centre[0], v - centre[1]
            back = np.stack(((a * x + b * y) / scale**2, (a * y - b * x) / scale**2), axis=-1) + middle
            across = moved(to_plane, back)
            mask = np.zeros(small.shape)
            for at, size in zip(modules.centre * [1.0, -1.0], modules.size, strict=True):
                mask[np.all(np.abs(across - at) <= 0.5 * size, axis=-1)] = 1.0
            overlap = irfft2(spectrum * np.conj(rfft2(mask, shape)), shape)
            peak = int(np.argmax(overlap))
            most = float(overlap.ravel()[peak])
            score = most / (most + (total - most) + DARK * (float(mask.sum()) - most))
            if score > best:
                down, right = ((k + n // 2) % n - n // 2 for k, n in zip(divmod(peak, shape[1]), shape, strict=True))
                place = centre + step * np.array([right, down])
                best = score
                found = np.array([[a, -b, place[0]], [b, a, place[1]], [0.0, 0.0, 1.0]])
                found[:2, 2] -= found[:2, :2] @ middle
    return found


def _outer_edges(modules: Modules, pixel: float) -> Floats:
    """Places along the edges of modules that have no other module before them, and places before these.

    In the plane of the mirror, y to the right and z down [m], and number of the side: shape (n, 5). `pixel` is the side
    of a pixel there. [m]
    """
    half, found = 0.5 * modules.size, []
    for row, at in enumerate(modules.centre * [1.0, -1.0]):
        for side, way in enumerate(np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])):
            along = np.array([-way[1], way[0]])
            reach = float(np.abs(along) @ half[row]) - 2.0 * pixel
            steps = np.arange(-reach, reach, ALONG * pixel)[:, np.newaxis] if reach > 0.0 else np.empty((0, 1))
            place = at + way * half[row] + steps * along
            before = place + way * pixel * (BLUR + LEVEL + 1.0)
            near = np.abs(before[:, np.newaxis] - modules.centre * [1.0, -1.0]) <= half + pixel
            alone = ~np.any(np.all(near, axis=-1), axis=-1)
            found.append(np.column_stack((place, before, np.full(len(place), side)))[alone])
    return np.concatenate(found)


def _offsets(image: Floats, place: Floats, normal: Floats, reach: float) -> Floats:
    """How far outwards of its place each edge is; NaN where there is no edge from lit to dark. [pixels]

    Where it may be far, by the outermost place at half of the level inside; else by the light in the blurred edge.
    """
    t = np.arange(-BLUR - LEVEL - reach, BLUR + LEVEL + reach + 1e-9, ACROSS)
    points = place[:, np.newaxis] + t[:, np.newaxis] * normal[:, np.newaxis]
    values = map_coordinates(image, [points[..., 1], points[..., 0]], order=1, cval=math.nan)
    inside, outside = t <= -BLUR - reach + 1e-9, t >= BLUR + reach - 1e-9
    if reach > 1.0:
        high = values[:, inside].mean(axis=1)
        over = values > 0.5 * high[:, np.newaxis]
        offset = t[t.size - 1 - np.argmax(over[:, ::-1], axis=1)] + 0.5 * ACROSS
        sharp = values[:, outside].max(axis=1) < 0.5 * high
        return np.where((high > LIT) & sharp, offset, math.nan)
    line = np.stack((np.ones(np.count_nonzero(inside)), t[inside]), axis=1)
    level, slope = np.linalg.lstsq(line, np.nan_to_num(values[:, inside]).T, rcond=None)[0]
    base = values[:, outside].mean(axis=1)
    full = level[:, np.newaxis] + slope[:, np.newaxis] * t
    with np.errstate(all="ignore"):
        part = (values - base[:, np.newaxis]) / (full - base[:, np.newaxis])
    between = ~inside & ~outside
    offset = (
        -BLUR
        - reach
        + ACROSS * (part[:, between].sum(axis=1) + 0.5 * (part[:, inside][:, -1] + part[:, outside][:, 0]))
    )
    good = (values[:, inside].min(axis=1) > LIT) & (base < 0.5 * level) & (np.abs(offset) <= reach)
    return np.where(good, offset, math.nan)


def _step(place: Floats, normal: Floats, offset: Floats, kept: NDArray[np.bool_], free: bool) -> tuple[Floats, Floats]:
    """Map that takes edges nearest to where they were seen, shape (3, 3), and what it leaves of the offsets. [pixels]

    A turn, scale and shift, or a homography where it is `free`.
    """
    (x, y), (n, m), one = place.T, normal.T, np.ones(len(place))
    columns = [n * x + m * y, m * x - n * y, n * one, m * one]
    if free:
        along = n * x + m * y
        columns = [n * x, n * y, n * one, m * x, m * y, m * one, -along * x, -along * y]
    size = np.array([max(float(np.abs(column).max()), 1e-12) for column in columns])
    rows = np.stack(columns, axis=1) / size
    found = np.linalg.lstsq(rows[kept], offset[kept], rcond=None)[0]
    rest = offset - rows @ found
    found = found / size
    if free:
        return np.eye(3) + np.append(found, 0.0).reshape(3, 3), rest
    a, b, u, v = found
    return np.array([[1.0 + a, -b, u], [b, 1.0 + a, v], [0.0, 0.0, 1.0]]), rest

"""Outlines of the shadows and of the blocked parts on mirrors, with the sun in one direction.

The images are those whose unions `heliosweep.kernels.field` measures, cut off at the edges of the mirror.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inner, kernel
from heliosweep.kernels.field.efficiency import aimed
from heliosweep.kernels.field.images import AXES_ROWS, axes, images_of, measure, outline, project
from heliosweep.kernels.field.neighbours import beam, by_cells, no_candidates, places, search_all
from heliosweep.kernels.field.packets import FRAME_ROWS, Mirrors, half_sides
from heliosweep.kernels.field.polygons import SQUARE, cut, square_area
from heliosweep.kernels.field.sweep import blockers_of
from heliosweep.kernels.vectors import ROW, dot, rows

CORNERS = 9
"""Most corners of an outline: four, one more from the plane of the mirror, and one from each of its edges."""
_ROOM = 2 * (CORNERS + 4)


@kernel
def _outlines(
    mirrors: Mirrors, tracking: int, to_sun: Floats, start: int, stop: int, corners: Floats, whole: Floats
) -> None:
    """Write `corners` and, of each image, `whole`: area and heliostat; counts are the last row of `whole`.

    `to_sun` are rows of one lane; shapes are those of `mirror_outlines`, but for `whole`, (tests, 2, images + 1, 2).
    """
    mirrors, grid = by_cells(mirrors)
    tests = places(grid, start, stop)
    blockers, bundle = blockers_of(tests, mirrors, grid), beam(to_sun, np.int64(ROW), np.int64(1))
    shaders = search_all(tests, bundle, mirrors, grid, no_candidates(tests.shape[0]))
    frames, views, to_target, images = rows(2 * FRAME_ROWS), rows(AXES_ROWS), rows(3), images_of(1)
    polygons = np.empty(3 * _ROOM)
    for t in range(tests.shape[0]):
        i = tests[t]
        row = grid.names[i] - start
        half_sides(frames, 0, to_sun, mirrors, i, tracking, 1)
        for c in range(3):
            to_target[c * ROW] = mirrors.aim[i, c]
        for e in range(2):
            direction, candidates = (to_sun, shaders) if e == 0 else (to_target, blockers)
            axes(views, frames, 0, direction, 1)
            for m in range(candidates.first[t], candidates.first[t + 1]):
                j = candidates.names[m]
                offset = mirrors.x[j] - mirrors.x[i], mirrors.y[j] - mirrors.y[i], mirrors.z[j] - mirrors.z[i]
                reach = mirrors.radius[i] + mirrors.radius[j]
                apart = dot(offset, offset) > reach * reach * (1.0 + 1e-12)
                half_sides(frames, FRAME_ROWS * ROW, to_sun, mirrors, j, tracking, 1)
                if project(images, 0, views, frames, FRAME_ROWS * ROW, direction, offset, apart, 1) == 0:
                    continue
                if measure(images, 0, frames, FRAME_ROWS * ROW, 0, offset, 1) == 0:
                    continue
                count = outline(images.rows, 0, apart, polygons, 0)
                count = _within(polygons, count)
                _insert(
                    polygons, count, grid.names[j], mirrors.half_width[i], mirrors.half_height[i], corners[row, e],
                    whole[row, e],
                )  # fmt: skip


@inner
def _within(polygons, count):
    """Cut a polygon off at the edges of the square; it stays where it began, returns its corners."""
    for k in range(4):
        ex, ey = 1.0 - k if k % 2 == 0 else 0.0, 2.0 - k if k % 2 == 1 else 0.0
        # The edges counter-clockwise: along +x at y = -1, along +y at x = 1, and back.
        count, _ = cut(polygons, 0, count, ey, -ex, ex, ey, _ROOM, 2 * _ROOM)
        if count < 3:
            return 0
        for m in range(2 * count):
            polygons[m] = polygons[_ROOM + m]
    return count


@kernel
def _insert(polygons, count, j, half_width, half_height, corners, whole):
    """Put an image among those that are kept, the largest first."""
    area, last = 0.0, whole.shape[0] - 1
    if count > 2:
        area = square_area(polygons, 0, count) / SQUARE * 4.0 * half_width * half_height
    if area <= 0.0:
        return
    place = min(int(whole[last, 0]), last)
    whole[last, 0] += 1.0
    while place > 0 and whole[place - 1, 0] < area:
        place -= 1
    if place == last:
        return
    for m in range(last - 1, place, -1):
        corners[m], whole[m] = corners[m - 1], whole[m - 1]
    corners[place] = np.nan
    whole[place, 0], whole[place, 1] = area, j
    for k in range(min(count, CORNERS)):
        corners[place, k, 0], corners[place, k, 1] = polygons[2 * k] * half_width, polygons[2 * k + 1] * half_height


class Outlines(NamedTuple):
    """Shadows (first) and blocked parts (second) on some mirrors, the largest first; NaN where there is none."""

    corners: Floats
    """Along the width and the height from the mirror's centre, shape (tests, 2, images, CORNERS, 2). [m]"""
    area: Floats
    """Shape (tests, 2, images). [m2]"""
    heliostat: Floats
    """Number of the heliostat that shades or blocks, of the same shape."""
    total: Floats
    """Images in all, also those beyond the room, shape (tests, 2)."""


def mirror_outlines(
    x: Floats,
    y: Floats,
    z: Floats,
    half_width: Floats,
    half_height: Floats,
    target_height: float | Floats,
    tracking: int,
    sun: Floats,
    start: int,
    stop: int,
    images: int,
) -> Outlines:
    """Outlines of the shadows and of the blocked parts on mirrors start..stop, with the sun along one unit vector.

    Parameters
    ----------
    x, y, z, half_width, half_height, target_height, tracking, start, stop
        As for `sorted_field` and `field_sums` of `heliosweep.kernels.field.efficiency`.
    sun : ndarray, shape (3,)
        Unit vector to the sun: east, north, up; with the sun at or below the horizon all is NaN. [1]
    images : int
        Outlines that are kept of each mirror and effect; those with the smallest area are left out.
    """
    mirrors, tests = aimed(x, y, z, half_width, half_height, target_height), stop - start
    corners, whole = np.full((tests, 2, images, CORNERS, 2), np.nan), np.full((tests, 2, images + 1, 2), np.nan)
    if tests and sun[2] > 0:
        whole[:, :, -1] = 0.0
        to_sun = np.zeros(3 * ROW)
        to_sun[::ROW] = sun
        _outlines(mirrors, tracking, to_sun, start, stop, corners, whole)
    return Outlines(corners, whole[:, :, :-1, 0], whole[:, :, :-1, 1], whole[:, :, -1, 0])

"""Outlines of the shadows and of the blocked parts on mirrors, with the sun in one direction.

The images are those whose unions `heliosweep.kernels.field` measures, cut off at the edges of the mirror.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.field.efficiency import aimed, field_sums, sorted_field
from heliosweep.kernels.field.packets import FRAME, Cells, Mirrors, beam, by_cells, offset, search, write_frame
from heliosweep.kernels.field.unions import SQUARE, area, images_of, outline, project, within, write_axes, write_square
from heliosweep.kernels.vectors import ROW, dot, rows

#: Most corners of an outline: four, one more from the plane of the mirror, and one from each of its edges.
CORNERS = 9


@kernel
def _outlines(
    mirrors: Mirrors,
    cells: Cells,
    tracking: int,
    to_sun: Floats,
    tests: Integers,
    places: Integers,
    names: Integers,
    corners: Floats,
    whole: Floats,
) -> None:
    """Write `corners` and, of each image, `whole`: area and heliostat; counts are the last row of `whole`.

    `to_sun` are rows of one lane; shapes are those of `mirror_outlines`, but for `whole`, (tests, 2, images + 1, 2).
    """
    frames, views, to_target, images = rows(14), rows(6), rows(3), images_of(1)
    square, pieces, found = np.empty(8), np.empty(6 * (CORNERS + 4)), np.empty(names.shape[0] + 1, np.int64)
    write_square(square, 0)
    for t in range(tests.shape[0]):
        i = tests[t]
        write_frame(frames, 0, to_sun, mirrors, i, tracking, 1)
        for c in range(3):
            to_target[c * ROW] = mirrors.aim[i, c]
        for e in range(2):
            direction, limit = (to_sun, np.inf) if e == 0 else (to_target, mirrors.throw[i])
            write_axes(views, frames, 0, direction, 1)
            for m in range(search(i, beam(direction, 1), limit, mirrors, cells, found)):
                j = found[m]
                way, reach = offset(mirrors, i, j), mirrors.radius[i] + mirrors.radius[j]
                apart = dot(way, way) > reach * reach * (1.0 + 1e-12)
                write_frame(frames, FRAME, to_sun, mirrors, j, tracking, 1)
                if project(images, 0, views, frames, FRAME, 0, direction, way, apart, 1):
                    piece, count = within(pieces, 0, outline(images, 0, 0, pieces, 0), square, 0, 4)
                    half = mirrors.half[i, 0], mirrors.half[i, 1]
                    _insert(pieces, piece, count, names[j], half, corners[places[t], e], whole[places[t], e])


@kernel
def _insert(pieces, piece, count, j, half, corners, whole):
    """Insert an image into the kept images, in descending order of area."""
    size, last = area(pieces, piece, count) / SQUARE * 4.0 * half[0] * half[1], whole.shape[0] - 1
    if size <= 0.0:
        return
    place = min(int(whole[last, 0]), last)
    whole[last, 0] += 1.0
    while place > 0 and whole[place - 1, 0] < size:
        place -= 1
    if place < last:
        for m in range(last - 1, place, -1):
            corners[m], whole[m] = corners[m - 1], whole[m - 1]
        corners[place] = np.nan
        whole[place, 0], whole[place, 1] = size, j
        for k in range(count):
            for c in range(2):
                corners[place, k, c] = pieces[piece + 2 * k + c] * half[c]


class Outlines(NamedTuple):
    """Shadows (first) and blocked parts (second) on some mirrors, in descending order; NaN without an image."""

    #: Along the width and the height from the mirror's centre, shape (tests, 2, images, CORNERS, 2). [m]
    corners: Floats
    #: Shape (tests, 2, images). [m2]
    area: Floats
    #: Number of the heliostat that shades or blocks, of the same shape.
    heliostat: Floats
    #: Images in all, also those beyond the room, shape (tests, 2).
    total: Floats


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
    (mirrors, cells, names), count = by_cells(aimed(x, y, z, half_width, half_height, target_height)), stop - start
    corners, whole = np.full((count, 2, images, CORNERS, 2), np.nan), np.full((count, 2, images + 1, 2), np.nan)
    if count and sun[2] > 0:
        whole[:, :, -1] = 0.0
        to_sun = np.zeros(3 * ROW)
        to_sun[::ROW] = sun
        tests = np.flatnonzero((names >= start) & (names < stop))
        _outlines(mirrors, cells, tracking, to_sun, tests, names[tests] - start, names, corners, whole)
    return Outlines(corners, whole[:, :, :-1, 0], whole[:, :, :-1, 1], whole[:, :, -1, 0])


def warm_field(outlines: bool = False) -> None:
    """Make the kernels of heliostat fields ready, and optionally of outlines of shadows."""
    place, side = np.array([10.0, 30.0]), np.ones(2)
    sun = np.array([[0.0, 0.0, 1.0]])
    field_sums(sorted_field(place, place, side, side, side, 50.0), 0, sun, 0, 2)
    if outlines:
        mirror_outlines(place, place, side, side, side, 50.0, 0, sun[0], 0, 2, 1)

"""Parallelograms as images on a test mirror: areas of their unions by the kernel and by shapely."""

import numpy as np
import shapely

from heliosweep.kernels.field.cover import COVER_ROWS, FLOOR, cover_by, take_out_hidden, uncover
from heliosweep.kernels.field.images import images_of, measure, project
from heliosweep.kernels.field.unions import room_for, unions
from heliosweep.kernels.vectors import PACKET, ROW, rows

SQUARE = shapely.box(-1.0, -1.0, 1.0, 1.0)


def images_for(shapes, shading=None, hiding=0):
    """Images that are the given parallelograms, shape (m, PACKET, 6): centre and half edges.

    The first `shading` are shades, or all; in the lanes `hiding` those are taken out that others of their kind hide.
    """
    shading = len(shapes) if shading is None else shading
    images, cover = images_of(len(shapes)), rows(COVER_ROWS)
    images.rows[:] = np.nan  # room holds anything, and lanes that do not see an image go on holding it
    up, one, none = np.repeat([0.0, 0.0, 1.0], ROW), np.ones(PACKET), np.zeros(PACKET)
    for m, (cx, cy, ax, ay, bx, by) in enumerate(np.swapaxes(shapes, 1, 2)):
        # With D = z and these axes the image is the given one, and D.d = 1 puts it in front.
        views, frame = rows_of(one, none, cx, none, one, cy), rows_of(ax, ay, none, bx, by, none, one)
        if m in (0, shading):
            uncover(cover, views, PACKET)
        floor = cover[FLOOR:] if hiding else cover[:0]
        hits = project(images, m, views, frame, 0, up, 0.0, 0.0, 1.0, True, -1, floor, PACKET)
        take_out_hidden(images, m, cover, hits & hiding, PACKET)
        measure(images, m, frame, 0, 0, 0.0, 0.0, 1.0, PACKET)
        cover_by(images, m, cover, hiding, PACKET)
    return images


def rows_of(*lanes):
    """Rows as kernels want them."""
    return np.pad(lanes, ((0, 0), (0, ROW - PACKET))).ravel()


def union_areas(shapes, shading, hiding=0):
    """Union areas of parallelograms, shape (3, PACKET), by the kernel; arguments as of `images_for`."""
    count, total = len(shapes), np.empty(3 * ROW)
    unions(images_for(shapes, shading, hiding), shading, count, total, room_for(count), PACKET)
    return total.reshape(3, ROW)[:, :PACKET]


def corners(shapes):
    """Corners of parallelograms, shape (..., 6), in turn: shape (..., 4, 2)."""
    c, a, b = shapes[..., :2], shapes[..., 2:4], shapes[..., 4:]
    return np.stack((c - a - b, c + a - b, c + a + b, c - a + b), axis=-2)


def shapely_areas(shapes, shading):
    """The same areas by shapely, for any number of lanes."""
    parts = shapely.intersection(shapely.polygons(corners(shapes)), SQUARE)
    parts = np.where(shapely.area(parts) > 0.0, parts, shapely.Polygon())
    return np.array([shapely.area(shapely.union_all(p, axis=0)) for p in (parts[:shading], parts[shading:], parts)])

"""Parallelograms as images on a test mirror: areas of their unions by the kernel and by shapely."""

import numpy as np
import shapely

from heliosweep.kernels.field.unions import images_of, project, room_for, unions
from heliosweep.kernels.vectors import PACKET, ROW

SQUARE = shapely.box(-1.0, -1.0, 1.0, 1.0)


def images_for(shapes):
    """Images that are the given parallelograms, shape (m, PACKET, 6): centre and half edges."""
    images = images_of(len(shapes))
    images.rows[:] = np.nan  # rows contain anything before they are written
    up, one, none = np.repeat([0.0, 0.0, 1.0], ROW), np.ones(PACKET), np.zeros(PACKET)
    for m, (cx, cy, ax, ay, bx, by) in enumerate(np.swapaxes(shapes, 1, 2)):
        # With D = z and these axes the image is the given one, and D.d = 1 puts it in front.
        views, frame = rows_of(one, none, cx, none, one, cy), rows_of(ax, ay, none, bx, by, none, one)
        project(images, m, views, frame, 0, 0, up, (0.0, 0.0, 1.0), True, PACKET)
    return images


def rows_of(*lanes):
    """Rows as kernels want them."""
    return np.pad(lanes, ((0, 0), (0, ROW - PACKET))).ravel()


def union_areas(shapes, shading):
    """Union areas of parallelograms, shape (3, PACKET), by the kernel; the first `shading` images shade."""
    count, total = len(shapes), np.empty(3 * ROW)
    unions(images_for(shapes), shading, count, total, room_for(count), PACKET)
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

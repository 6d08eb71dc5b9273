"""Images that a larger one hides: with a low sun most of them, and without them the union is the same.

An image is hidden by another of its kind that contains the box around what it covers on the test mirror. Of the images
of one lane the largest is held against all others, then the largest that is left, until each has been tried or is
hidden: as many rounds as images stay, each over vectors of images.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.images import AREA, IMAGE_ROWS, Images, larger
from heliosweep.kernels.packets import PACKET

__all__ = ["BOX_ROWS", "take_out_hidden"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BOX_ROWS = 4
"""Of each image in a lane: centre x, y and half sides x, y of the box around what it covers on the square."""

_TRIED, _HIDDEN = np.int64(-1), np.int64(-2)
"""What stands for the size of an image that has been held against the others, and of one that is hidden."""
_NAME_BITS = 20
_LAST_NAME = (1 << _NAME_BITS) - 1
_UNIT = float(1 << 40)
"""Sizes are integers, areas in units of 2^-40 and below them the place in the list, so that the largest is found by
vectors; so many places that no field has more candidates."""


@inner
def take_out_hidden(
    images: Images, start: int, stop: int, k: int, boxes: Floats, names: Integers, sizes: Integers
) -> None:
    """Take the images out of one lane that lie, on the square, within a larger one; of equals the first stays.

    Parameters
    ----------
    images : Images
        The area of a hidden one becomes 0, and it is no longer present in the lane.
    start, stop : int
        Images of one kind, shading or blocking. None of them straddles the plane of the test mirror in this lane.
    k : int
        The lane.
    boxes : ndarray, shape (BOX_ROWS * R,)
        Scratch; R at least the number of images.
    names, sizes : ndarray of int64, shape (R,)
        Scratch.
    """
    bit, count = np.int64(1) << k, np.int64(0)
    largest = np.int64(0)
    for m in range(start, stop):
        if images.present[m] & bit != 0:
            names[count] = m
            sizes[count] = _write_box(images.rows, m * IMAGE_ROWS * PACKET + k, boxes, count, names.shape[0])
            largest = max(largest, sizes[count])
            count += 1
    while largest > 0:
        place = _LAST_NAME - (largest & _LAST_NAME)
        sizes[place] = _TRIED
        largest = _hide(images.rows, names[place] * IMAGE_ROWS * PACKET + k, boxes, sizes, count)
    for e in range(count):
        if sizes[e] == _HIDDEN:
            images.present[names[e]] &= ~bit
            images.rows[names[e] * IMAGE_ROWS * PACKET + AREA + k] = 0.0


@inline
def _write_box(images, o, boxes, e, room):
    """Write the box around what an image covers on the square; returns its size."""
    o, e = max(o, 0), max(e, 0)
    cx, cy = images[o], images[o + PACKET]
    width = abs(images[o + 2 * PACKET]) + abs(images[o + 4 * PACKET])
    height = abs(images[o + 3 * PACKET]) + abs(images[o + 5 * PACKET])
    west, east = max(-1.0, cx - width), min(1.0, cx + width)
    south, north = max(-1.0, cy - height), min(1.0, cy + height)
    boxes[e], boxes[room + e] = 0.5 * (west + east), 0.5 * (south + north)
    boxes[2 * room + e], boxes[3 * room + e] = 0.5 * (east - west), 0.5 * (north - south)
    return np.int64(images[o + AREA] * _UNIT) << _NAME_BITS | (_LAST_NAME - e)


@inner
def _hide(images, o, boxes, sizes, count):
    """Mark the boxes within an image: no corner lies beyond its edges, |(P - C) x b| <= |a x b| and so for a.

    Returns the size of the largest image that is neither tried nor hidden.
    """
    o, room, largest = max(o, 0), sizes.shape[0], np.int64(0)
    cx, cy = images[o], images[o + PACKET]
    ax, ay, bx, by = images[o + 2 * PACKET], images[o + 3 * PACKET], images[o + 4 * PACKET], images[o + 5 * PACKET]
    turn = abs(ax * by - ay * bx)
    for e in range(count):
        x, y, width, height = boxes[e] - cx, boxes[room + e] - cy, boxes[2 * room + e], boxes[3 * room + e]
        beyond_a = abs(x * by - y * bx) + width * abs(by) + height * abs(bx)
        beyond_b = abs(x * ay - y * ax) + width * abs(ay) + height * abs(ax)
        size = sizes[e]
        size = _HIDDEN if (larger(beyond_a, beyond_b) <= turn) & (size > 0) else size
        sizes[e] = size
        largest = size if size > largest else largest
    return largest

"""Images that another one hides.

With a low sun most images are hidden by another one, and without them the union is the same. An image is hidden by
another of its kind that contains the box around what it covers on the test mirror. Candidates come by rows and cells of
the grid from the test heliostat outward (`neighbours.search`), so that images of the nearest hide most of the others
before the areas of these are computed.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.field.images import AREA, IMAGE_ROWS, Images
from heliosweep.kernels.field.polygons import larger, unit
from heliosweep.kernels.vectors import ROW

Floats = NDArray[np.float64]


@inner
def take_out_hidden(images: Images, first: int, m: int, some: np.int64, lanes: int) -> np.int64:
    """Take an image out where an earlier one of its kind hides it, and the earlier ones that it hides itself.

    `first` is the first image of the kind, and `m` the one that `images.project` has made; `some` are the lanes in
    which it may cover something and in which that is wanted. Where an image is hidden its area becomes 0, and an
    earlier one is no longer present. Mirrors that may straddle the plane of the test mirror hide none. Of equals the
    first stays. Returns the lanes where the image is hidden.
    """
    hidden = np.int64(0)
    for n in range(first, m):
        both = images.present[n] & some & ~hidden
        if both != 0 and images.apart[n]:
            hidden |= both & _contains(images.rows, n, m, lanes)
    _take_out(images.rows, m, hidden, lanes)
    images.present[m] &= ~hidden
    for n in range(first, m if images.apart[m] else first):
        both = images.present[n] & some & ~hidden
        if both != 0:
            both &= _contains(images.rows, m, n, lanes)
            _take_out(images.rows, n, both, lanes)
            images.present[n] &= ~both
    return hidden


@inner
def _contains(images, n, m, lanes):
    """Lanes where image n contains the box around what image m covers on the square.

    No corner P of the box lies beyond the edges of n: |(P - C) x b| <= |a x b|, and so for a.
    """
    n, m = max(n, 0), max(m, 0)  # an index that may be negative would keep the loop from becoming vector code
    one, other = n * IMAGE_ROWS * ROW, m * IMAGE_ROWS * ROW
    found = np.int64(0)
    for k in range(lanes):
        cx, cy = images[other + k], images[other + ROW + k]
        reach_x = abs(images[other + 2 * ROW + k]) + abs(images[other + 4 * ROW + k])
        reach_y = abs(images[other + 3 * ROW + k]) + abs(images[other + 5 * ROW + k])
        west, east = unit(cx - reach_x), unit(cx + reach_x)
        south, north = unit(cy - reach_y), unit(cy + reach_y)
        x, y = 0.5 * (west + east) - images[one + k], 0.5 * (south + north) - images[one + ROW + k]
        width, height = 0.5 * (east - west), 0.5 * (north - south)
        ax, ay = images[one + 2 * ROW + k], images[one + 3 * ROW + k]
        bx, by = images[one + 4 * ROW + k], images[one + 5 * ROW + k]
        beyond_a = abs(x * by - y * bx) + width * abs(by) + height * abs(bx)
        beyond_b = abs(x * ay - y * ax) + width * abs(ay) + height * abs(ax)
        found |= np.int64(larger(beyond_a, beyond_b) <= abs(ax * by - ay * bx)) << k
    return found


@inline
def _take_out(images, m, some, lanes):
    """Leave an image no area in some lanes."""
    if some != 0:
        area = max(m, 0) * IMAGE_ROWS * ROW + AREA
        for k in range(lanes):
            images[area + k] = 0.0 if some >> k & 1 else images[area + k]

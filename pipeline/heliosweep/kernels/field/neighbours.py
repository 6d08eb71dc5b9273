"""Which heliostats can shade or block which: a uniform grid, a wedge, a cone. Never more than the exact test drops.

Let D = C_j - C_i, R the sum of the bounding radii of mirrors i and j, and d a direction (sun or target). Mirror j
projects onto mirror i along d only if the line distance |D - (D.d) d| is below R, and, when the bounding spheres
are disjoint (|D| > R), only if it is in front, D.d > 0: a point C_j + q in front of C_i + p along d means
t d = D + e, |e| = |q - p| <= R, with t > 0; if D.d <= 0 then e.d >= t - D.d >= |D.d| and, across d, |e| equals the
line distance, so |e| >= |D|: a contradiction. Both conditions say: the angle between D and d is below asin(R / |D|).
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.packets import Mirrors
from heliosweep.kernels.vectors import GROUP, PACKET, whole

_SLACK = 1e-9
"""Relative slack of every cull: far above rounding, far below what would cost time."""


class Cells(NamedTuple):
    """Uniform grid in plan over the field: heliostats of one cell, and of one row of cells, are contiguous."""

    first: Integers
    """The first heliostat of each cell; cells run from west to east, then from south to north."""
    names: Integers
    """What number each heliostat had before, rising within a cell."""
    west: float
    south: float
    cell: float
    columns: int
    rows: int
    bottom: float
    """Lowest centre. [m]"""
    top: float
    """Highest centre. [m]"""
    radius: float
    """Largest bounding radius. [m]"""


class Beam(NamedTuple):
    """A bundle of directions: every direction lies within an angle of the axis."""

    x: float
    y: float
    z: float
    cosine: float
    """Cosine of the half-angle."""
    sine: float
    low: float
    """Smallest |sine of the elevation| of a direction."""
    left_x: float
    """The leftmost and the rightmost direction in plan, unit vectors, for a narrow beam."""
    left_y: float
    right_x: float
    right_y: float
    narrow: bool
    """True if the azimuths span less than a half circle."""


class Candidates(NamedTuple):
    """Heliostats that may occlude each of some test heliostats."""

    names: Integers
    first: Integers
    """Place in `names` of the first of each test heliostat, and the end of the last ones."""


@kernel
def by_cells(mirrors: Mirrors) -> tuple[Mirrors, Cells]:
    """Mirrors sorted by cells, a few for each heliostat at most: those that stand together are close in memory too."""
    x, y = mirrors.x, mirrors.y
    count = x.shape[0]
    (west, east), (south, north), (bottom, top) = _range(x), _range(y), _range(mirrors.z)
    largest = _range(mirrors.radius)[1]
    # Cells of one bounding diameter, but larger where the field is sparse.
    cell = max(2.0 * largest, np.sqrt((east - west) * (north - south) / (2.0 * count)))
    cell = max(cell, max(east - west, north - south) / (2.0 * count), 1e-9)
    columns, rows = int((east - west) / cell) + 1, int((north - south) / cell) + 1
    home = np.empty(count, np.int64)
    first = np.zeros(columns * rows + 1, np.int64)
    for j in range(count):
        home[j] = _cell(y[j], south, cell, rows) * columns + _cell(x[j], west, cell, columns)
        first[home[j] + 1] += 1
    for k in range(columns * rows):
        first[k + 1] += first[k]
    names = np.empty(count, np.int64)
    fill = first.copy()
    for j in range(count):
        names[fill[home[j]]] = j
        fill[home[j]] += 1
    cells = Cells(first, names, west, south, cell, columns, rows, bottom, top, largest)
    return _reordered(mirrors, names), cells


@kernel
def _reordered(mirrors, names):
    """Mirrors in another order, and room behind the last for what `_occluding` reads of a whole group."""
    count = names.shape[0]
    x, y, z, radius = np.zeros(count + GROUP), np.zeros(count + GROUP), np.zeros(count + GROUP), np.zeros(count + GROUP)
    half_width, half_height, aim, throw = np.empty(count), np.empty(count), np.empty((count, 3)), np.empty(count)
    for i in range(count):
        j = names[i]
        x[i], y[i], z[i], throw[i] = mirrors.x[j], mirrors.y[j], mirrors.z[j], mirrors.throw[j]
        half_width[i], half_height[i], radius[i] = mirrors.half_width[j], mirrors.half_height[j], mirrors.radius[j]
        for c in range(3):
            aim[i, c] = mirrors.aim[j, c]
    return Mirrors(x, y, z, half_width, half_height, radius, aim, throw)


@kernel
def places(grid: Cells, start: int, stop: int) -> Integers:
    """Where heliostats start..stop are among the sorted ones, rising."""
    found, count = np.empty(stop - start, np.int64), 0
    for i in range(grid.names.shape[0]):
        if start <= grid.names[i] < stop:
            found[count] = i
            count += 1
    return found


@inline
def _cell(value, low, cell, count):
    """Row or column of the grid in which a coordinate lies, of so many that begin at the lowest."""
    return min(int((value - low) / cell), count - 1)


@inner
def _range(values):
    """Smallest and largest of some numbers: as methods of arrays they take a second to compile."""
    low = high = values[0]
    for k in range(1, values.shape[0]):
        low, high = min(low, values[k]), max(high, values[k])
    return low, high


@inner
def beam(directions: Floats, stride: int, count: int) -> Beam:
    """Bundle of the first `count` of the unit vectors whose x, then y, then z stand `stride` apart in a flat array."""
    x = y = z = 0.0
    for k in range(count):
        x, y, z = x + directions[k], y + directions[stride + k], z + directions[2 * stride + k]
    length = max(np.sqrt(x * x + y * y + z * z), 1e-300)
    x, y, z = x / length, y / length, z / length
    level = max(np.sqrt(x * x + y * y), 1e-300)
    gx, gy = x / level, y / level
    cosine, plan, low = 1.0, 1.0, 1.0
    for k in range(count):
        dx, dy, dz = directions[k], directions[stride + k], directions[2 * stride + k]
        cosine, low = min(cosine, x * dx + y * dy + z * dz), min(low, abs(dz))
        level = np.sqrt(dx * dx + dy * dy)
        plan = min(plan, (gx * dx + gy * dy) / level) if level > 1e-12 else -1.0
    # Slack first, then the sines from it: an angle is never smaller than the true one.
    cosine, plan = cosine - 1e-14, plan - 1e-14
    sine = np.sqrt(max(0.0, 1.0 - cosine * cosine))
    swing = np.sqrt(max(0.0, 1.0 - plan * plan))
    return Beam(
        x,
        y,
        z,
        cosine,
        sine,
        low,
        plan * gx - swing * gy,
        plan * gy + swing * gx,
        plan * gx + swing * gy,
        plan * gy - swing * gx,
        plan > 0.0,
    )


@kernel
def search(
    i: int,
    bundle: Beam,
    limit: float,
    mirrors: Mirrors,
    grid: Cells,
    found: Integers,
    count: int,
) -> tuple[Integers, int]:
    """Append to `found` every heliostat that may occlude heliostat i along some direction of the bundle.

    In plan, h ahead of i along the azimuth of d: the line distance has the components h sin a - dz cos a (a the
    elevation of d) and the offset across, so the offset is below R and h < (R + |dz| cos a) / sin a. In front (D.d > 0,
    or |D| <= R) moreover h >= -R: for dz >= 0 both h > -dz tan a and h > dz cot a - R / sin a hold, whose larger is
    least, -R sin a, where they meet; for dz < 0, h > 0. (A direction below the horizon is the same upside down.) So D
    lies in a strip of half-width R from h = -R on, swung over the azimuths of the bundle; left and right of the swing,
    and behind, three straight lines at sqrt(2) R from i contain it (a swing below a half circle). The cells between
    these lines are visited, rows and in each row from heliostat i outward: what is near hides what is far, and the
    order of any two does not depend on the bundle. Each heliostat in them is kept if the angle between D and the axis
    is below asin(R / |D|) + half-angle, by the triangle inequality on the sphere, or if |D| <= R.

    `limit` is the largest D.d, infinity for the sun [m], and `count` the length of the list `found`. Returned are the
    list, which is another array where there was no room for all, and its new length.
    """
    stop = _search(i, bundle, limit, mirrors, grid, found, count)
    while stop < 0:
        found = _longer(found)
        stop = _search(i, bundle, limit, mirrors, grid, found, count)
    return found, stop


@inner
def _search(i, bundle, limit, mirrors, grid, found, count):
    """`search` while there is room; returns the new length, or -1 where there is none."""
    x, y, z, radius = mirrors.x, mirrors.y, mirrors.z, mirrors.radius
    wide = (radius[i] + grid.radius) * (1.0 + _SLACK)
    rise = max(grid.top - z[i], z[i] - grid.bottom)
    level = np.sqrt(max(0.0, 1.0 - bundle.low * bundle.low))
    reach = min((wide + rise * level) / max(bundle.low, 1e-300), limit) * (1.0 + _SLACK) + wide
    bound = 1.4142135623730951 * wide
    south, north = y[i] - grid.south - reach, y[i] - grid.south + reach
    if north < 0.0:
        return count
    first_row, last_row = int(max(south / grid.cell, 0.0)), int(min(north / grid.cell, grid.rows - 1.0))
    home_row = _cell(y[i], grid.south, grid.cell, grid.rows)
    home_column = _cell(x[i], grid.west, grid.cell, grid.columns)
    for s in range(last_row + 1 - first_row):
        row = _outward(s, home_row, last_row + 1)
        near, far = -reach, reach
        if bundle.narrow:
            y0 = grid.south + (row - 1e-6) * grid.cell - y[i]
            y1 = y0 + (1.0 + 2e-6) * grid.cell
            near, far = _beside(-bundle.left_y, bundle.left_x, bound, y0, y1, near, far)
            near, far = _beside(bundle.right_y, -bundle.right_x, bound, y0, y1, near, far)
            near, far = _beside(-bundle.x, -bundle.y, bound, y0, y1, near, far)
            if near > far:
                continue
        west, east = (x[i] + near - grid.west) / grid.cell - 1e-6, (x[i] + far - grid.west) / grid.cell + 1e-6
        if east < 0.0 or west > grid.columns:
            continue
        start, stop = int(min(max(west, 0.0), grid.columns - 1.0)), int(min(max(east, 0.0), grid.columns - 1.0)) + 1
        home, cells = min(max(home_column, start), stop), row * grid.columns
        begin, middle, end = grid.first[cells + start], grid.first[cells + home], grid.first[cells + stop]
        if count + end - begin > found.shape[0]:
            return -1
        if end - begin <= GROUP:  # too few for vectors
            for c in range(end - begin):
                j = _outward(c, middle, end)
                found[count] = j
                count += _may_occlude(i, j, bundle, limit, mirrors)
            continue
        for j in range(middle, end, PACKET):
            length = min(end - j, PACKET)
            some = _occluding(i, j, length, bundle, limit, mirrors)
            for k in range(length if some != 0 else 0):
                found[count] = j + k
                count += some >> k & 1
        for j in range(middle, begin, -PACKET):
            length = min(j - begin, PACKET)
            some = _occluding(i, j - length, length, bundle, limit, mirrors)
            for k in range(1, length + 1 if some != 0 else 0):
                found[count] = j - k
                count += some >> (length - k) & 1
    return count


@inner
def _occluding(i, start, length, bundle, limit, mirrors):
    """Those of so many mirrors from a start on that may occlude mirror i, a bit for each."""
    start, some = max(start, 0), np.int64(0)
    for k in range(whole(length)):
        some |= np.int64(_may_occlude(i, start + k, bundle, limit, mirrors)) << k
    return some & (np.int64(-1) if length == PACKET else (np.int64(1) << length) - 1)


@inline
def _outward(s, middle, stop):
    """Number s of a range that ends before `stop`: from its middle on, and then from there back."""
    return middle + s if middle + s < stop else stop - 1 - s


@kernel
def no_candidates(tests: int) -> Candidates:
    """Empty lists for so many test heliostats, with some room for names."""
    return Candidates(np.empty(16 * tests, np.int64), np.zeros(tests + 1, np.int64))


@kernel
def search_all(tests: Integers, bundle: Beam, mirrors: Mirrors, grid: Cells, found: Candidates) -> Candidates:
    """Replace the lists of the test heliostats by what `search` finds along a bundle to the sun."""
    names, first = found
    for t in range(tests.shape[0]):
        stop = _search(tests[t], bundle, np.inf, mirrors, grid, names, first[t])
        if stop < 0:
            names, stop = search(tests[t], bundle, np.inf, mirrors, grid, names, first[t])
        first[t + 1] = stop
    return Candidates(names, first)


@inline
def _may_occlude(i, j, bundle, limit, mirrors):
    """Test whether j may occlude i along some direction of the bundle."""
    dx, dy, dz = mirrors.x[j] - mirrors.x[i], mirrors.y[j] - mirrors.y[i], mirrors.z[j] - mirrors.z[i]
    return _occludes(dx, dy, dz, mirrors.radius[i] + mirrors.radius[j], bundle, limit) & (j != i)


@inline
def _occludes(dx, dy, dz, radii, bundle, limit):
    """Test whether another mirror may occlude one from an offset D, by the angle between D and the bundle's axis.

    Without a root or a branch, which is what this costs: the roots are on one side of the comparison, and squared.
    """
    square = dx * dx + dy * dy + dz * dz
    reach = radii * (1.0 + _SLACK)
    ahead = dx * bundle.x + dy * bundle.y + dz * bundle.z
    near = (square <= reach * reach) | (bundle.cosine <= 0.0)
    side = ahead + reach * bundle.sine + _SLACK * (abs(dx) + abs(dy) + abs(dz))
    edge = (square - reach * reach) * (bundle.cosine * bundle.cosine)
    return (near | ((side >= 0.0) & (side * side >= edge))) & (ahead < limit)


@kernel
def _longer(found):
    """Copy of a list with room for twice as many."""
    copy = np.empty(2 * found.shape[0], np.int64)
    for m in range(found.shape[0]):
        copy[m] = found[m]
    return copy


@inline
def _beside(mx, my, bound, y0, y1, near, far):
    """Narrow the interval of x to mx x + my y <= bound for some y between y0 and y1."""
    room = bound - min(my * y0, my * y1)
    if mx > 0.0:
        return near, min(far, room / mx)
    if mx < 0.0:
        return max(near, room / mx), far
    return near, far if room >= 0.0 else -np.inf

"""Heliostats that may shade or block others: a uniform grid, a wedge, a cone. No heliostat that does is lost.

Let D = C_j - C_i, R the sum of the bounding radii of mirrors i and j, and d a direction (sun or target). Mirror j
projects onto mirror i along d only if the line distance |D - (D.d) d| is below R, and, when the bounding spheres
are disjoint (|D| > R), only if it is in front, D.d > 0: a point C_j + q in front of C_i + p along d means
t d = D + e, |e| = |q - p| <= R, with t > 0; if D.d <= 0 then e.d >= t - D.d >= |D.d| and, across d, |e| equals the
line distance, so |e| >= |D|: a contradiction. Both conditions give: the angle between D and d is below asin(R / |D|).
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.field.packets import Mirrors
from heliosweep.kernels.vectors import Vector, dot, load

#: Factor of every bound: far above rounding, far below what would cost time.
_SLACK = 1.0 + 1e-9


class Cells(NamedTuple):
    """Uniform grid in plan over the field: heliostats of one cell, and of one row of cells, are contiguous."""

    #: The first heliostat of each cell, from west to east, then from south to north; and the end.
    first: Integers
    west: float
    south: float
    cell: float
    columns: int
    rows: int
    #: Largest difference in height of two centres. [m]
    rise: float
    #: Largest bounding radius. [m]
    radius: float


class Beam(NamedTuple):
    """A bundle of directions: every direction lies within an angle of the axis."""

    axis: Vector
    #: Cosine of the half-angle.
    cosine: float
    sine: float
    #: Smallest |sine of the elevation| of a direction.
    low: float
    #: The leftmost and the rightmost direction in plan, unit vectors, for a narrow beam.
    left: tuple[float, float]
    right: tuple[float, float]
    #: True if the azimuths span less than a half circle.
    narrow: bool


def by_cells(mirrors: Mirrors) -> tuple[Mirrors, Cells, Integers]:
    """Sort mirrors by the cells of a grid: close mirrors are close in memory. Returns also their numbers before."""
    low, spread = mirrors.centre.min(axis=0), np.ptp(mirrors.centre, axis=0)
    count, largest = len(mirrors.radius), mirrors.radius.max()
    # Cells of one bounding diameter, but larger if the field is sparse.
    cell = max(2.0 * largest, np.sqrt(spread[0] * spread[1] / (2 * count)), spread[:2].max() / (2 * count), 1e-9)
    columns, rows = (spread[:2] / cell).astype(np.int64) + 1
    column, row = ((mirrors.centre[:, :2] - low[:2]) / cell).astype(np.int64).T
    home = row * columns + column
    names = np.argsort(home, kind="stable")
    first = np.searchsorted(home[names], np.arange(columns * rows + 1))
    west, south, rise = float(low[0]), float(low[1]), float(spread[2])
    cells = Cells(first, west, south, float(cell), int(columns), int(rows), rise, float(largest))
    return Mirrors(*(np.ascontiguousarray(each[names]) for each in mirrors)), cells, names


@inner
def beam(directions: Floats, count: int) -> Beam:
    """Bundle of the first `count` lanes of rows of unit vectors."""
    x = y = z = 0.0
    for k in range(count):
        d = load(directions, 0, k)
        x, y, z = x + d[0], y + d[1], z + d[2]
    length, level = max(np.sqrt(x * x + y * y + z * z), 1e-300), max(np.sqrt(x * x + y * y), 1e-300)
    axis, gx, gy = (x / length, y / length, z / length), x / level, y / level
    cosine = plan = low = 1.0
    for k in range(count):
        d = load(directions, 0, k)
        cosine, low = min(cosine, dot(axis, d)), min(low, abs(d[2]))
        level = np.sqrt(d[0] * d[0] + d[1] * d[1])
        plan = min(plan, (gx * d[0] + gy * d[1]) / level) if level > 1e-12 else -1.0
    # Slack first, then the sines from it: an angle is never smaller than the true one.
    cosine, plan = cosine - 1e-14, plan - 1e-14
    sine, swing = np.sqrt(max(0.0, 1.0 - cosine * cosine)), np.sqrt(max(0.0, 1.0 - plan * plan))
    left, right = (plan * gx - swing * gy, plan * gy + swing * gx), (plan * gx + swing * gy, plan * gy - swing * gx)
    return Beam(axis, cosine, sine, low, left, right, plan > 0.0)


@inner
def search(i: int, bundle: Beam, limit: float, mirrors: Mirrors, cells: Cells, found: Integers) -> int:
    """Write every heliostat that may occlude heliostat i along some direction of the bundle; returns their number.

    In plan, h ahead of i along the azimuth of d: the line distance has the components h sin a - dz cos a (a the
    elevation of d) and the offset across, so the offset is below R and h < (R + |dz| cos a) / sin a. In front (D.d > 0,
    or |D| <= R) moreover h >= -R: for dz >= 0 both h > -dz tan a and h > dz cot a - R / sin a hold, whose larger is
    least, -R sin a, where they meet; for dz < 0, h > 0. (A direction below the horizon is the same upside down.) So D
    lies in a strip of half-width R from h = -R on, swung over the azimuths of the bundle; left and right of the swing,
    and behind, three straight lines at sqrt(2) R from i contain it (a swing below a half circle). The cells between
    these lines are visited, always in one order. Each heliostat in them is kept if the angle between D and the axis
    is below asin(R / |D|) + half-angle, by the triangle inequality on the sphere, or if |D| <= R.

    `limit` is the largest D.d, infinity for the sun [m]; `found` has room for all heliostats.
    """
    x, y, count = mirrors.centre[i, 0] - cells.west, mirrors.centre[i, 1] - cells.south, 0
    wide = (mirrors.radius[i] + cells.radius) * _SLACK
    level = np.sqrt(max(0.0, 1.0 - bundle.low * bundle.low))
    reach = min((wide + cells.rise * level) / max(bundle.low, 1e-300), limit) * _SLACK + wide
    bound = 1.4142135623730951 * wide
    for row in range(int(max((y - reach) / cells.cell, 0.0)), int(min((y + reach) / cells.cell, cells.rows - 1.0)) + 1):
        near, far = -reach, reach
        if bundle.narrow:
            y0, y1 = (row - 1e-6) * cells.cell - y, (row + 1.0 + 1e-6) * cells.cell - y
            near, far = _beside(-bundle.left[1], bundle.left[0], bound, y0, y1, near, far)
            near, far = _beside(bundle.right[1], -bundle.right[0], bound, y0, y1, near, far)
            near, far = _beside(-bundle.axis[0], -bundle.axis[1], bound, y0, y1, near, far)
        west, east = (x + near) / cells.cell - 1e-6, (x + far) / cells.cell + 1e-6
        if near <= far and east >= 0.0 and west <= cells.columns:
            start, last = int(min(max(west, 0.0), cells.columns - 1.0)), int(min(east, cells.columns - 1.0))
            for j in range(cells.first[row * cells.columns + start], cells.first[row * cells.columns + last + 1]):
                found[count] = j
                count += _occludes(i, j, bundle, limit, mirrors)
    return count


@inline
def offset(mirrors: Mirrors, i: int, j: int) -> Vector:
    """Vector D from mirror i to mirror j. [m]"""
    centre = mirrors.centre
    return centre[j, 0] - centre[i, 0], centre[j, 1] - centre[i, 1], centre[j, 2] - centre[i, 2]


@inline
def _occludes(i, j, bundle, limit, mirrors):
    """Test the angle between D and the bundle's axis without a root: both sides of the comparison are squared."""
    d, reach = offset(mirrors, i, j), (mirrors.radius[i] + mirrors.radius[j]) * _SLACK
    square, ahead = dot(d, d), dot(d, bundle.axis)
    near = (square <= reach * reach) | (bundle.cosine <= 0.0)
    side = ahead + reach * bundle.sine + 1e-9 * (abs(d[0]) + abs(d[1]) + abs(d[2]))
    edge = (square - reach * reach) * (bundle.cosine * bundle.cosine)
    return (near | ((side >= 0.0) & (side * side >= edge))) & (ahead < limit) & (i != j)


@inline
def _beside(mx, my, bound, y0, y1, near, far):
    """Narrow the interval of x to mx x + my y <= bound for some y between y0 and y1."""
    room = bound - min(my * y0, my * y1)
    if mx > 0.0:
        return near, min(far, room / mx)
    if mx < 0.0:
        return max(near, room / mx), far
    return near, far if room >= 0.0 else -np.inf

"""Packets of at most 64 instants with similar sun directions, and mirror frames at these instants.

All lanes (instants) of a packet share one candidate list and take the same branches. Packets of similar instants are
therefore faster to compute.

Let r and s be the unit vectors from a mirror to the target and to the sun. The normal of the mirror is
n = unit(r + s), and its frame is (u, v, n) with v = n x u. The width of the mirror is along u, and the height is along
v. Vectors are stored for all lanes of a packet; see `vectors.load`.

Heliostats that may shade or block a mirror are selected in two steps: those in the grid cells that overlap a wedge in
plan view, and of these, those inside a cone. The selection never misses a heliostat that shades or blocks.

Let D = C_j - C_i be the vector from mirror i to mirror j, R the sum of their bounding radii, and d a direction to the
sun or the target. Mirror j projects onto mirror i along d only if the line distance |D - (D.d) d| is below R. If the
bounding spheres are disjoint (|D| > R), mirror j must also be in front, D.d > 0. Proof: if a point C_j + q is in front
of a point C_i + p along d, then t d = D + e with t > 0 and |e| = |q - p| <= R. If D.d <= 0, then e.d = t - D.d > |D.d|,
and the component of e perpendicular to d is as long as the line distance. Hence |e| > |D| > R, a contradiction.
Together, the two conditions imply that the angle between D and d is below asin(R / |D|).
"""

import math
from typing import NamedTuple

import numpy as np

from heliosweep.kernels.compiled import Floats, Integers, inline, inner
from heliosweep.kernels.mounts import AZIMUTH_ELEVATION as AZIMUTH_ELEVATION
from heliosweep.kernels.mounts import TARGET_ALIGNED
from heliosweep.kernels.vectors import (
    GROUP,
    PACKET,
    ROW,
    Vector,
    cross,
    dot,
    larger,
    load,
    mixed,
    put,
    scaled,
    smaller,
    store,
)

#: Upper limit of lanes * range / sin(elevation) for each packet. `range` is the largest range of a sun vector
#: component, and `elevation` the minimum sun elevation. Smaller packets repeat the search too often, and wider packets
#: have too many candidates. The limit was found by timing and is not critical: half or twice the limit costs a few per
#: cent more time at low sun. If instants are numerous, only packets at the lowest sun elevations reach the limit.
_LIMIT = 480.0


def packet_order(sun: Floats) -> tuple[Integers, Integers]:
    """Divide instants into packets with similar sun directions.

    A k-d tree splits the instants at the median of the component with the largest range until each part fits into a
    packet. A packet has at most 64 lanes, and fewer if the sun directions are widely spread. Each lane tests the
    candidates of all lanes, and the number of candidates grows with the spread divided by the sine of the elevation.
    Instants with equal components keep their order.

    Parameters
    ----------
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun, all above the horizon. [1]

    Returns
    -------
    order : ndarray, shape (T,)
        Indices of the instants, packet by packet. Each packet is split into groups of 8 similar instants with
        ascending indices.
    first : ndarray, shape (P + 1,)
        Start of each packet in `order`, and end of the last packet. No packet is empty.
    """
    packets, waiting, columns = [], [np.arange(len(sun))] if len(sun) else [], np.ascontiguousarray(sun.T)
    while waiting:
        some = waiting.pop()
        here, count = columns[:, some], len(some)
        low = here.min(axis=1)
        spread = here.max(axis=1) - low
        if count == 1 or (count <= PACKET and count * spread.max() <= _LIMIT * low[2]):
            packets.append(some)
            continue
        rising = some[np.argsort(here[spread.argmax()], kind="stable")]
        unit = PACKET if count > PACKET else 1  # split at a multiple of the packet size
        middle = (-(-count // unit) + 1) // 2 * unit
        waiting += [rising[middle:], rising[:middle]]
    sizes = np.array([len(each) for each in packets], np.int64)
    first = np.concatenate(([0], np.cumsum(sizes)))
    order = np.concatenate([np.empty(0, np.int64), *packets])
    for size in np.unique(sizes):  # process packets of equal size together
        places = first[:-1][sizes == size][:, np.newaxis] + np.arange(size)
        order[places] = _groups(columns, order[places])
    return order, first


def _groups(columns: Floats, packets: Integers) -> Integers:
    """Sort the instants of packets of equal size, shape (P, size), into groups of similar instants.

    `columns` contains the components of the sun vectors, shape (3, T).
    """
    size = packets.shape[1]
    if size <= GROUP:
        return np.sort(packets, axis=1)
    here, middle = columns[:, packets], (-(-size // GROUP) + 1) // 2 * GROUP
    key = here[np.ptp(here, axis=2).argmax(axis=0), np.arange(len(packets))]
    rising = np.take_along_axis(packets, np.argsort(key, axis=1, kind="stable"), axis=1)
    return np.concatenate((_groups(columns, rising[:, :middle]), _groups(columns, rising[:, middle:])), axis=1)


#: Code of target-aligned mounts, whose first axis is along r.
#: The width axis u = unit(r x s) is normal to the plane of incidence.
SPINNING_ELEVATION = TARGET_ALIGNED
#: Number of floats in a frame: 3 rows each for the half sides (w/2) u and (h/2) v, and 1 for the cosine of incidence.
FRAME = 7 * ROW
#: Offset of the row with the cosine of incidence, n.s = n.r = |r + s| / 2.
COSINE = 6 * ROW
#: Squared sine below which two directions are treated as parallel, because their cross product is rounding noise.
_PARALLEL = 1e-30


class Mirrors(NamedTuple):
    """The heliostats of a field."""

    #: Centres (east, north, up) and radii of the bounding spheres, shape (N, 4). [m]
    spheres: Floats
    #: Half the width (along u) and half the height (along v) [m], unit vector r from the centre to the target [1], and
    #: distance to the target [m], shape (N, 6).
    mounts: Floats

    @property
    def aim(self) -> Floats:
        """Unit vectors r from the centres to the target, shape (N, 3). [1]"""
        return self.mounts[:, 2:5]


@inner
def write_frame(frames: Floats, f: int, sun: Floats, mounts: Floats, i: int, tracking: int, lanes: int) -> None:
    """Write the frame of mirror i for all lanes of a packet to `frames`, starting at offset `f`. [m]

    The axis u is undefined if s is parallel to r (spinning-elevation), or if the normal is vertical
    (azimuth-elevation). For spinning-elevation, an undefined u is set to unit(-r_y, r_x, 0), or to east if r is
    vertical. For azimuth-elevation, an undefined u is set to east. If the sun is exactly opposite to r, the
    normal is undefined, and the half sides and the cosine are set to 0.

    `sun` contains rows with the x, y and z components of the unit vectors to the sun [1]. `mounts` is described in
    `Mirrors`. `tracking` is `SPINNING_ELEVATION` or `AZIMUTH_ELEVATION`.
    """
    half_width, half_height = mounts[i, 0], mounts[i, 1]
    r = mounts[i, 2], mounts[i, 3], mounts[i, 4]
    # u for lanes in which it is undefined, computed here so that the loop needs no branch
    level = np.sqrt(r[0] * r[0] + r[1] * r[1])
    east, north = 1.0, 0.0
    if tracking == SPINNING_ELEVATION and level * level > _PARALLEL:
        east, north = -r[1] / level, r[0] / level
    for k in range(lanes):
        s = load(sun, 0, k)
        n = mixed(1.0, r, 1.0, s)
        u = cross(r, s) if tracking == SPINNING_ELEVATION else (-n[1], n[0], 0.0)
        across = dot(u, u)
        undefined = across < _PARALLEL
        u = east if undefined else u[0], north if undefined else u[1], 0.0 if undefined else u[2]
        length, width = np.sqrt(dot(n, n)), np.sqrt(1.0 if undefined else across)
        inverse = 1.0 / (length * width) if length > 0.0 else 0.0
        put(frames, f + COSINE, k, smaller(0.5 * length, 1.0))
        store(frames, f, k, scaled(half_width * (inverse * length), u))
        store(frames, f + 3 * ROW, k, scaled(half_height * inverse, cross(n, u)))


#: Safety factor for all bounds: far larger than rounding errors, but too small to add candidates.
_SLACK = 1.0 + 1e-9


class Cells(NamedTuple):
    """Uniform horizontal grid over the field.

    The heliostats in a cell, and in a row of cells, are contiguous in memory.
    """

    #: Index of the first heliostat in each cell, and end of the last cell. Cells are ordered from west to east, then
    #: from south to north.
    first: Integers
    west: float
    south: float
    cell: float
    columns: int
    rows: int
    #: Maximum height difference between two centres. [m]
    rise: float
    #: Maximum bounding radius. [m]
    radius: float


class Beam(NamedTuple):
    """Bundle of directions within a given angle of an axis."""

    axis: Vector
    #: Cosine of the half-angle.
    cosine: float
    sine: float
    #: Minimum of |sin(elevation)| over all directions in the bundle.
    low: float
    #: Horizontal unit vectors along the left and right edges of a narrow bundle.
    left: tuple[float, float]
    right: tuple[float, float]
    #: True if the azimuths span less than half a circle.
    narrow: bool


def by_cells(spheres: Floats) -> tuple[Cells, Integers]:
    """Sort mirrors by grid cell, so that neighbouring mirrors are close in memory.

    Returns the cells and the original index of each sorted mirror. `spheres` is described in `Mirrors`.
    """
    low, spread, count = spheres.min(axis=0), np.ptp(spheres, axis=0), len(spheres)
    largest = spheres[:, 3].max()
    # The cell size is one bounding diameter, or more if the field is sparse.
    cell = max(2.0 * largest, np.sqrt(spread[0] * spread[1] / (2 * count)), spread[:2].max() / (2 * count), 1e-9)
    columns, rows = (spread[:2] / cell).astype(np.int64) + 1
    column, row = ((spheres[:, :2] - low[:2]) / cell).astype(np.int64).T
    home = row * columns + column
    names = np.argsort(home, kind="stable")
    first = np.searchsorted(home[names], np.arange(columns * rows + 1))
    west, south, rise = float(low[0]), float(low[1]), float(spread[2])
    return Cells(first, west, south, float(cell), int(columns), int(rows), rise, float(largest)), names


def beams(directions: Floats, first: Integers) -> list[Beam]:
    """Return the bundle of directions of each packet.

    `directions` contains unit vectors, shape (T, 3), and `first` the start of each packet, as in `packet_order`.
    """
    columns, starts, each = (
        np.ascontiguousarray(directions.T),
        first[:-1],
        np.repeat(np.arange(len(first) - 1), np.diff(first)),
    )
    x, y, z = np.add.reduceat(columns, starts, axis=1)
    length, level = np.maximum(np.sqrt(x * x + y * y + z * z), 1e-300), np.maximum(np.hypot(x, y), 1e-300)
    axis, gx, gy = np.stack((x, y, z)) / length, x / level, y / level
    across = np.sqrt(columns[0] ** 2 + columns[1] ** 2)
    plan = (gx[each] * columns[0] + gy[each] * columns[1]) / np.maximum(across, 1e-12)
    plan[across <= 1e-12] = -1.0
    least = np.stack(((axis[:, each] * columns).sum(axis=0), plan, abs(columns[2])))
    cosine, plan, low = np.minimum.reduceat(least, starts, axis=1)
    # Cosines are reduced by a tolerance before the sines are computed, so that no angle is too small.
    cosine, plan = np.minimum(cosine, 1.0) - 1e-14, np.minimum(plan, 1.0) - 1e-14
    sine, swing = np.sqrt(np.maximum(0.0, 1.0 - cosine**2)), np.sqrt(np.maximum(0.0, 1.0 - plan**2))
    left, right = (plan * gx - swing * gy, plan * gy + swing * gx), (plan * gx + swing * gy, plan * gy - swing * gx)
    parts = (axis.T, cosine, sine, low, np.transpose(left), np.transpose(right), plan > 0.0)
    rows = zip(*(part.tolist() for part in parts), strict=True)
    return [Beam(tuple(d), c, s, e, tuple(west), tuple(east), flag) for d, c, s, e, west, east, flag in rows]


@inner
def cone(x: float, y: float, z: float, spread: float) -> Beam:
    """Return the bundle of directions within an angle arctan(`spread`) of the unit vector (x, y, z)."""
    cosine, level = 1.0 / math.sqrt(1.0 + spread * spread) - 1e-14, larger(math.sqrt(x * x + y * y), 1e-300)
    sine, gx, gy = math.sqrt(larger(0.0, 1.0 - cosine * cosine)), x / level, y / level
    swing = smaller(sine / level, 1.0) + 1e-14
    plan, low = math.sqrt(larger(0.0, 1.0 - swing * swing)), larger(0.0, abs(z) * cosine - level * sine)
    left, right = (plan * gx - swing * gy, plan * gy + swing * gx), (plan * gx + swing * gy, plan * gy - swing * gx)
    return Beam((x, y, z), cosine, sine, low, left, right, plan > 0.0)


@inner
def search(i: int, bundle: Beam, limit: float, spheres: Floats, cells: Cells, found: Integers, count: int) -> int:
    """Append all heliostats that may occlude heliostat i along a direction of the bundle to the list `found`.

    `count` is the number of heliostats in the list before the call. Returns the number after the call.

    Let a be the elevation of d, h the component of D along the azimuth of d, and dz the vertical component of D. The
    line distance is below R. Its two components are h sin a - dz cos a and the lateral offset. Therefore the lateral
    offset is below R, and h < (R + |dz| cos a) / sin a. A mirror in front (D.d > 0, or |D| <= R) also has h >= -R: for
    dz >= 0, h > -dz tan a and h > dz cot a - R / sin a, and the larger of these bounds is at least -R sin a. For dz <
    0, h > 0. Directions below the horizon are the mirror image of this case. D therefore lies in the area that a strip
    of half-width R, starting at h = -R, covers when it is rotated over the azimuths of the bundle. If the azimuths span
    less than half a circle, three straight lines at a distance of sqrt(2) R from i bound this area on the left, right
    and rear sides. The function visits the cells between these lines in a fixed order. A heliostat is listed if |D| <=
    R or, by the triangle inequality on the sphere, if the angle between D and the axis of the bundle is below asin(R /
    |D|) plus the half-angle of the bundle.

    `limit` is the maximum component of D along the axis of the bundle [m], infinite for the sun. `found` must have room
    for `count` elements and one more for each heliostat.
    """
    x, y = spheres[i, 0] - cells.west, spheres[i, 1] - cells.south
    wide = (spheres[i, 3] + cells.radius) * _SLACK
    level = math.sqrt(larger(0.0, 1.0 - bundle.low * bundle.low))
    reach = smaller((wide + cells.rise * level) / larger(bundle.low, 1e-300), limit) * _SLACK + wide
    bound = 1.4142135623730951 * wide
    for row in range(
        np.int64(larger((y - reach) / cells.cell, 0.0)),
        np.int64(smaller((y + reach) / cells.cell, cells.rows - 1.0)) + 1,
    ):
        near, far = -reach, reach
        if bundle.narrow:
            y0, y1 = (row - 1e-6) * cells.cell - y, (row + 1.0 + 1e-6) * cells.cell - y
            near, far = _beside(-bundle.left[1], bundle.left[0], bound, y0, y1, near, far)
            near, far = _beside(bundle.right[1], -bundle.right[0], bound, y0, y1, near, far)
            near, far = _beside(-bundle.axis[0], -bundle.axis[1], bound, y0, y1, near, far)
        west, east = (x + near) / cells.cell - 1e-6, (x + far) / cells.cell + 1e-6
        if near <= far and east >= 0.0 and west <= cells.columns:
            start, last = (
                np.int64(smaller(larger(west, 0.0), cells.columns - 1.0)),
                np.int64(smaller(east, cells.columns - 1.0)),
            )
            for j in range(cells.first[row * cells.columns + start], cells.first[row * cells.columns + last + 1]):
                found[count] = j
                count += occludes(i, j, bundle, limit, spheres)
    return count


@inline
def offset(spheres: Floats, i: int, j: int) -> Vector:
    """Return the vector D from mirror i to mirror j. [m]"""
    return spheres[j, 0] - spheres[i, 0], spheres[j, 1] - spheres[i, 1], spheres[j, 2] - spheres[i, 2]


@inline
def occludes(i: int, j: int, bundle: Beam, limit: float, spheres: Floats) -> bool:
    """Test whether heliostat j may occlude heliostat i along a direction of the bundle.

    The test of the angle between D and the axis compares squares to avoid a square root.
    """
    d, reach = offset(spheres, i, j), (spheres[i, 3] + spheres[j, 3]) * _SLACK
    square, ahead = dot(d, d), dot(d, bundle.axis)
    near = (square <= reach * reach) | (bundle.cosine <= 0.0)
    side = ahead + reach * bundle.sine + 1e-9 * (abs(d[0]) + abs(d[1]) + abs(d[2]))
    edge = (square - reach * reach) * (bundle.cosine * bundle.cosine)
    return (near | ((side >= 0.0) & (side * side >= edge))) & (ahead < limit) & (i != j)


@inline
def _beside(mx, my, bound, y0, y1, near, far):
    """Narrow the interval (near, far) to the x values with mx x + my y <= bound for some y between y0 and y1."""
    room = bound - smaller(my * y0, my * y1)
    if mx > 0.0:
        return near, smaller(far, room / mx)
    if mx < 0.0:
        return larger(near, room / mx), far
    return near, far if room >= 0.0 else -np.inf

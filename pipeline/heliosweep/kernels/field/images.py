"""Images of mirrors on a test mirror, for all lanes of a packet.

For the test mirror (u, v, n) and the direction d (sun, or the mirror's own target), a point P = C + q of the scene
projects along d to ((q.U), (q.V)) on the plane of the mirror. With u and v the half sides, U = (v x d) / (u.(v x d))
and V = (d x u) / (u.(v x d)), so that u.U = v.V = 1: the test mirror is the square [-1, 1] x [-1, 1], and the image
of another mirror a parallelogram given by its centre and two half edges.

Rows of lanes stand in flat arrays, each block of them at an offset from the start.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner, kernel
from heliosweep.kernels.field.polygons import CORNERS, edge_terms, larger, slopes, square_area
from heliosweep.kernels.vectors import GROUP, LANES, ROW, rows

AXES_ROWS = 6
"""Rows of the axes of projection: U and V, components x, y, z of each."""
IMAGE_ROWS = 10
"""Rows of an image: centre x, y; half edges a and b (x, y of each); area on the test mirror (0: none); and, only for
mirrors that may straddle the plane of the test mirror, the heights over it: of the centre, and along a and b."""
AREA = 6 * ROW
"""Start of the row of areas."""
_HEIGHT = 7 * ROW


class Images(NamedTuple):
    """Images on one test mirror: shading images, then blocking images."""

    rows: Floats
    """`IMAGE_ROWS` rows of lanes for each."""
    apart: NDArray[np.bool_]
    """True if the bounding spheres of the mirror and of the test mirror are disjoint."""
    present: Integers
    """Lanes in which each covers something of the test mirror, a bit for each lane."""


@kernel
def images_of(count: int) -> Images:
    """Room for so many images."""
    return Images(rows(count * IMAGE_ROWS), np.empty(count, np.bool_), np.empty(count, np.int64))


@inner
def axes(out: Floats, frames: Floats, f: int, directions: Floats, lanes: int) -> None:
    """Write the rows U and V (x, y, z of each) of a test mirror for every lane, to `out`. [1/m]

    Its frame begins at `f` in `frames` [m], and `directions` are the rows of d [1], shape (3 * ROW,). Where there is no
    frame, U and V are nothing. Their denominator is taken from the vectors, and not from the cosine: at grazing
    incidence rounding would show.
    """
    f = max(f, 0)  # an index that may be negative would keep the loop from becoming vector code
    for k in range(lanes):
        ux, uy, uz = frames[f + k], frames[f + ROW + k], frames[f + 2 * ROW + k]
        vx, vy, vz = frames[f + 3 * ROW + k], frames[f + 4 * ROW + k], frames[f + 5 * ROW + k]
        dx, dy, dz = directions[k], directions[ROW + k], directions[2 * ROW + k]
        ax, ay, az = vy * dz - vz * dy, vz * dx - vx * dz, vx * dy - vy * dx
        facing = ux * ax + uy * ay + uz * az
        scale = 1.0 / facing if facing > 0.0 else 0.0
        out[k], out[ROW + k], out[2 * ROW + k] = scale * ax, scale * ay, scale * az
        out[3 * ROW + k] = scale * (dy * uz - dz * uy)
        out[4 * ROW + k] = scale * (dz * ux - dx * uz)
        out[5 * ROW + k] = scale * (dx * uy - dy * ux)


@inner
def project(
    images: Images,
    m: int,
    views: Floats,
    frames: Floats,
    f: int,
    directions: Floats,
    offset: tuple[float, float, float],
    apart: bool,
    lanes: int,
) -> np.int64:
    """Project a mirror to the plane of the test mirror; returns the lanes in which it may cover something of that.

    Separating axes decide: the normals of the square's edges and of the image's. Image number `m` is written, but for
    its area.

    `views` are U and V of the test mirror, from `axes`; `directions` the rows of d, shape (3 * ROW,). The frame of the
    mirror begins at `f` in `frames` [m], and `offset` leads from the centre of the test mirror to its own [m]. `apart`
    is True if the bounding spheres are disjoint: then D.d > 0 decides exactly which mirror is in front.
    """
    dx, dy, dz = offset
    o, behind, found = m * IMAGE_ROWS * ROW, 0.0 if apart else -np.inf, np.int64(0)
    level = _project_along_v(images.rows, o, views, frames, f, dx, dy, dz, lanes)
    start, stop = next_run(0, level, lanes)
    while start < stop:
        o_run, f_run, filled = o + start, f + start, stop - start
        hits = _project_along_u(images.rows, o_run, views, start, frames, f_run, directions, dx, dy, dz, behind, filled)
        found |= (hits & level >> start) << start
        start, stop = next_run(stop, level, lanes)
    images.apart[m], images.present[m] = apart, found
    return found


@inner
def _project_along_v(out, o, views, frames, f, dx, dy, dz, lanes):
    """Write the y of an image; returns the lanes in which it is neither above nor below the square."""
    o, f, found = max(o, 0), max(f, 0), np.int64(0)
    for k in range(lanes):
        vx, vy, vz = views[3 * ROW + k], views[4 * ROW + k], views[5 * ROW + k]
        cy = dx * vx + dy * vy + dz * vz
        ay = frames[f + k] * vx + frames[f + ROW + k] * vy + frames[f + 2 * ROW + k] * vz
        by = frames[f + 3 * ROW + k] * vx + frames[f + 4 * ROW + k] * vy + frames[f + 5 * ROW + k] * vz
        out[o + ROW + k], out[o + 3 * ROW + k], out[o + 5 * ROW + k] = cy, ay, by
        found |= np.int64(abs(cy) - (abs(ay) + abs(by)) < 1.0) << k
    return found


@inner
def _project_along_u(out, o, views, v, frames, f, directions, dx, dy, dz, behind, lanes):
    """Write the x of an image in a run of lanes; returns those in which it covers something unless above or below."""
    o, v, f, found = max(o, 0), max(v, 0), max(f, 0), np.int64(0)
    for k in range(lanes):
        ux, uy, uz = views[v + k], views[v + ROW + k], views[v + 2 * ROW + k]
        cx, cy = dx * ux + dy * uy + dz * uz, out[o + ROW + k]
        ax = frames[f + k] * ux + frames[f + ROW + k] * uy + frames[f + 2 * ROW + k] * uz
        bx = frames[f + 3 * ROW + k] * ux + frames[f + 4 * ROW + k] * uy + frames[f + 5 * ROW + k] * uz
        ay, by = out[o + 3 * ROW + k], out[o + 5 * ROW + k]
        ahead = dx * directions[v + k] + dy * directions[v + ROW + k] + dz * directions[v + 2 * ROW + k]
        out[o + k], out[o + 2 * ROW + k], out[o + 4 * ROW + k] = cx, ax, bx
        turn = abs(ax * by - ay * bx)
        gap = larger(abs(cx) - abs(ax) - abs(bx) - 1.0, abs(cx * ay - cy * ax) - turn - abs(ax) - abs(ay))
        gap = larger(gap, abs(cx * by - cy * bx) - turn - abs(bx) - abs(by))
        found |= np.int64((gap < 0.0) & (ahead > behind)) << k
    return found


@inner
def measure(
    images: Images, m: int, frames: Floats, f: int, test: int, offset: tuple[float, float, float], lanes: int
) -> np.int64:
    """Write the area on the test mirror of an image that `project` has left; returns the lanes in which there is any.

    Arguments are those of `project`; `test` is where the frame of the test mirror begins.
    """
    o, some, found = m * IMAGE_ROWS * ROW, images.present[m], np.int64(0)
    _clear(images.rows, o + AREA, lanes)
    start, stop = next_run(0, some, lanes)
    while start < stop:
        found |= _areas(images.rows, o + start, some >> start, stop - start) << start
        start, stop = next_run(stop, some, lanes)
    if not images.apart[m]:
        found = _cut_by_plane(images.rows, o, frames, f, test, offset, lanes)
    images.present[m] = found
    return found


@inner
def _clear(images, row, lanes):
    """Write nothing to a row."""
    row = max(row, 0)
    for k in range(lanes):
        images[row + k] = 0.0


@inner
def next_run(start: int, some: int, lanes: int) -> tuple[int, int]:
    """Begin and end of the next run of groups of lanes that have some lanes, from a group on; equal where none is."""
    while start < lanes and some >> start & LANES == 0:
        start += GROUP
    stop = start
    while stop < lanes and some >> stop & LANES != 0:
        stop += GROUP
    return start, stop


@inner
def _areas(images, o, some, lanes):
    """Write the area on the square in some lanes of a run, by Green's theorem; returns those that have any."""
    o, found = max(o, 0), np.int64(0)
    for k in range(lanes):
        cx, cy = images[o + k], images[o + ROW + k]
        ax, ay = images[o + 2 * ROW + k], images[o + 3 * ROW + k]
        bx, by = images[o + 4 * ROW + k], images[o + 5 * ROW + k]
        (a_rise, a_run), (b_rise, b_run) = slopes(ax, ay), slopes(bx, by)
        px = cx - ax - bx, cx + ax - bx, cx + ax + bx, cx - ax + bx
        py = cy - ay - by, cy + ay - by, cy + ay + by, cy - ay + by
        qx, qy = (px[1], px[2], px[3], px[0]), (py[1], py[2], py[3], py[0])
        rise, run = (a_rise, b_rise, a_rise, b_rise), (a_run, b_run, a_run, b_run)
        first, second, third, fourth = edge_terms(px, py, qx, qy, rise, run)
        total = (first + third) + (second + fourth)
        area = abs(total) if some >> k & 1 == 1 else 0.0
        images[o + AREA + k] = area
        found |= np.int64(area > 0.0) << k
    return found


@inner
def _cut_by_plane(images, o, frames, f, test, offset, lanes):
    """Heights of a near mirror over the plane of the test mirror, and the area of the part in front of it.

    Returns the lanes where there is any.
    """
    (dx, dy, dz), found = offset, np.int64(0)
    o, f, test = max(o, 0), max(f, 0), max(test, 0)
    height = o + _HEIGHT
    for k in range(lanes):
        ux, uy, uz = frames[test + k], frames[test + ROW + k], frames[test + 2 * ROW + k]
        vx, vy, vz = frames[test + 3 * ROW + k], frames[test + 4 * ROW + k], frames[test + 5 * ROW + k]
        px, py, pz = frames[f + k], frames[f + ROW + k], frames[f + 2 * ROW + k]
        qx, qy, qz = frames[f + 3 * ROW + k], frames[f + 4 * ROW + k], frames[f + 5 * ROW + k]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        images[height + k] = dx * nx + dy * ny + dz * nz
        images[height + ROW + k] = px * nx + py * ny + pz * nz
        images[height + 2 * ROW + k] = qx * nx + qy * ny + qz * nz
    for k in range(lanes):
        if images[o + AREA + k] > 0.0 and straddles(images, o + k):
            images[o + AREA + k] = _area_in_front(images, o + k)
        found |= np.int64(images[o + AREA + k] > 0.0) << k
    return found


@kernel
def _area_in_front(images, lane):
    """Area on the square of the part of an image in front of the plane; rare, so it may make an array."""
    polygon = np.empty(2 * CORNERS)
    corners = outline(images, lane, False, polygon, np.int64(0))
    return square_area(polygon, np.int64(0), corners) if corners > 2 else 0.0


@inline
def straddles(images, lane):
    """Test whether some corner of a near mirror lies behind the plane of the test mirror; `lane` as in `outline`."""
    height = lane + _HEIGHT
    return images[height] < abs(images[height + ROW]) + abs(images[height + 2 * ROW])


@inner
def outline(images: Floats, lane: int, apart: bool, polygons: Floats, at: int) -> int:
    """Corners of an image, counter-clockwise, cut by the plane of the test mirror; returns their number.

    `lane` is where the image begins in `images`, plus the lane. With `apart` it was made with disjoint bounding
    spheres: nothing is cut then. Written to `polygons` from `at` on are `polygons.CORNERS` corners at most.
    """
    cx, cy = images[lane], images[lane + ROW]
    ax, ay, bx, by = (
        images[lane + 2 * ROW],
        images[lane + 3 * ROW],
        images[lane + 4 * ROW],
        images[lane + 5 * ROW],
    )
    height, along_a, along_b = 1.0, 0.0, 0.0
    if not apart:
        height, along_a = images[lane + _HEIGHT], images[lane + _HEIGHT + ROW]
        along_b = images[lane + _HEIGHT + 2 * ROW]
    if ax * by - ay * bx < 0.0:
        ax, ay, along_a, bx, by, along_b = bx, by, along_b, ax, ay, along_a
    corners = 0
    qx, qy, q = cx - ax + bx, cy - ay + by, height - along_a + along_b
    for e in range(4):
        f = 1.0 if e == 1 or e == 2 else -1.0
        g = 1.0 if e > 1 else -1.0
        px, py, p = cx + f * ax + g * bx, cy + f * ay + g * by, height + f * along_a + g * along_b
        if (p > 0.0 and q < 0.0) or (p < 0.0 and q > 0.0):
            share = q / (q - p)
            polygons[at + 2 * corners] = qx + share * (px - qx)
            polygons[at + 2 * corners + 1] = qy + share * (py - qy)
            corners += 1
        if p >= 0.0:
            polygons[at + 2 * corners], polygons[at + 2 * corners + 1] = px, py
            corners += 1
        qx, qy, q = px, py, p
    return corners

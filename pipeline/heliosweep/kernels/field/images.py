"""Images of mirrors on a test mirror, for all lanes of a packet.

For the test mirror (u, v, n) and the direction d (sun, or the mirror's own target), a point P = C + q of the scene
projects along d to ((q.U), (q.V)) on the plane of the mirror. With u and v the half sides, U = (v x d) / (u.(v x d))
and V = (d x u) / (u.(v x d)), so that u.U = v.V = 1: the test mirror is the square [-1, 1] x [-1, 1], and the image
of another mirror a parallelogram given by its centre and two half edges.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inner, kernel
from heliosweep.kernels.field.polygons import edge_terms, larger, slopes
from heliosweep.kernels.vectors import ROW, Vector, cross, dot, get, load, load2, next_run, put, rows, scaled, store

#: Numbers of an image: rows of its centre x, y; half edges a and b (x, y of each); area on the test mirror (0: none);
#: and the heights over the plane of the test mirror: of the centre, and along a and b.
IMAGE = 10 * ROW
#: Start of the row of areas, and of heights: valid only in lanes of `Images.behind`.
AREA, _HEIGHT = 6 * ROW, 7 * ROW


class Images(NamedTuple):
    """Images on one test mirror: shading images, then blocking images."""

    #: `IMAGE` numbers of each.
    rows: Floats
    #: Lanes in which each covers something of the test mirror, a bit for each lane.
    present: Integers
    #: Lanes in which a part of its mirror lies behind the plane of the test mirror: it is cut off.
    behind: Integers


@kernel
def images_of(count: int) -> Images:
    """Allocate storage for `count` images."""
    return Images(rows(count * 10), np.empty(count, np.int64), np.empty(count, np.int64))


@inner
def write_axes(views: Floats, frames: Floats, f: int, directions: Floats, lanes: int) -> None:
    """Write the rows U and V (x, y, z of each) of the test mirror with the frame at `f` in `frames`. [1/m]

    Without a frame, U and V are 0. Their denominator is taken from the vectors, and not from the cosine: at grazing
    incidence rounding would show.
    """
    for k in range(lanes):
        u, v, d = load(frames, f, k), load(frames, f + 3 * ROW, k), load(directions, 0, k)
        across = cross(v, d)
        facing = dot(u, across)
        scale = 1.0 / facing if facing > 0.0 else 0.0
        store(views, 0, k, scaled(scale, across))
        store(views, 3 * ROW, k, scaled(scale, cross(d, u)))


@inner
def project(
    images: Images,
    m: int,
    views: Floats,
    frames: Floats,
    f: int,
    test: int,
    directions: Floats,
    way: Vector,
    apart: bool,
    lanes: int,
) -> bool:
    """Write image number m of a mirror; returns whether it covers something of the test mirror.

    Separating axes decide: the normals of the square's edges and of the image's.

    `views` are U and V of the test mirror, from `write_axes`; `directions` the rows of d. The frame of the mirror
    begins at `f` in `frames`, the frame of the test mirror at `test` [m], and `way` leads from the centre of the test
    mirror to the mirror's [m]. `apart` is True if the bounding spheres are disjoint: then D.d > 0 decides exactly
    which mirror is in front.
    """
    o, level, hits = m * IMAGE, np.int64(0), np.int64(0)
    for k in range(lanes):
        v = load(views, 3 * ROW, k)
        c, a, b = dot(way, v), dot(load(frames, f, k), v), dot(load(frames, f + 3 * ROW, k), v)
        put(images.rows, o + ROW, k, c)
        put(images.rows, o + 3 * ROW, k, a)
        put(images.rows, o + 5 * ROW, k, b)
        level |= np.int64(abs(c) - (abs(a) + abs(b)) < 1.0) << k
    start, stop = next_run(0, level, lanes)
    while start < stop:
        hits |= _project_along_u(images.rows, o, views, frames, f, directions, way, apart, start, stop)
        start, stop = next_run(stop, level, lanes)
    images.present[m] = images.behind[m] = hits & level
    if images.present[m] != 0:
        images.present[m] = _measure(images.rows, o, images.present[m], lanes)
        images.behind[m] = 0 if apart else _heights(images.rows, o, frames, f, test, way, images.present[m], lanes)
    return images.present[m] != 0


@inner
def _project_along_u(images, o, views, frames, f, directions, way, apart, start, stop):
    """Write the x of an image in a run of lanes; returns those in which it covers something unless above or below."""
    hits, nearest = np.int64(0), 0.0 if apart else -np.inf
    for k in range(start, stop):
        u = load(views, 0, k)
        cx, ax, bx = dot(way, u), dot(load(frames, f, k), u), dot(load(frames, f + 3 * ROW, k), u)
        cy, ay, by = get(images, o + ROW, k), get(images, o + 3 * ROW, k), get(images, o + 5 * ROW, k)
        put(images, o, k, cx)
        put(images, o + 2 * ROW, k, ax)
        put(images, o + 4 * ROW, k, bx)
        turn = abs(ax * by - ay * bx)
        gap = larger(abs(cx) - abs(ax) - abs(bx) - 1.0, abs(cx * ay - cy * ax) - turn - abs(ax) - abs(ay))
        gap = larger(gap, abs(cx * by - cy * bx) - turn - abs(bx) - abs(by))
        hits |= np.int64((gap < 0.0) & (dot(way, load(directions, 0, k)) > nearest)) << k
    return hits


@inner
def _measure(images, o, some, lanes):
    """Write the areas of an image on the square in some lanes, 0 in others; returns the lanes that have any."""
    found = np.int64(0)
    for k in range(lanes):
        put(images, o + AREA, k, 0.0)
    start, stop = next_run(0, some, lanes)
    while start < stop:
        for k in range(start, stop):
            (cx, cy), (ax, ay), (bx, by) = (
                load2(images, o, k),
                load2(images, o + 2 * ROW, k),
                load2(images, o + 4 * ROW, k),
            )
            (a_rise, a_run), (b_rise, b_run) = slopes(ax, ay), slopes(bx, by)
            px = cx - ax - bx, cx + ax - bx, cx + ax + bx, cx - ax + bx
            py = cy - ay - by, cy + ay - by, cy + ay + by, cy - ay + by
            qx, qy = (px[1], px[2], px[3], px[0]), (py[1], py[2], py[3], py[0])
            rise, run = (a_rise, b_rise, a_rise, b_rise), (a_run, b_run, a_run, b_run)
            first, second, third, fourth = edge_terms(px, py, qx, qy, rise, run)
            area = abs((first + third) + (second + fourth)) if some >> k & 1 == 1 else 0.0
            put(images, o + AREA, k, area)
            found |= np.int64(area > 0.0) << k
        start, stop = next_run(stop, some, lanes)
    return found


@inner
def _heights(images, o, frames, f, test, way, some, lanes):
    """Write the heights of a near mirror above the test plane; return the heights in lanes that it cuts."""
    behind = np.int64(0)
    for k in range(lanes):
        normal = cross(load(frames, test, k), load(frames, test + 3 * ROW, k))
        height = dot(way, normal), dot(load(frames, f, k), normal), dot(load(frames, f + 3 * ROW, k), normal)
        store(images, o + _HEIGHT, k, height)
        behind |= np.int64(height[0] < abs(height[1]) + abs(height[2])) << k
    return behind & some


@inner
def outline(images: Images, m: int, k: int, polygons: Floats, at: int) -> int:
    """Write the corners of image m in lane k, counter-clockwise; return their number, at most `polygons.CORNERS`.

    The plane of the test mirror clips the part behind it.
    """
    (cx, cy), (ax, ay) = load2(images.rows, m * IMAGE, k), load2(images.rows, m * IMAGE + 2 * ROW, k)
    (bx, by), (height, a, b) = load2(images.rows, m * IMAGE + 4 * ROW, k), (1.0, 0.0, 0.0)
    if images.behind[m] >> k & 1:
        height, a, b = load(images.rows, m * IMAGE + _HEIGHT, k)
    if ax * by - ay * bx < 0.0:
        ax, ay, a, bx, by, b = bx, by, b, ax, ay, a
    corners = 0
    qx, qy, q = cx - ax + bx, cy - ay + by, height - a + b
    for e in range(4):
        f, g = 1.0 if e == 1 or e == 2 else -1.0, 1.0 if e > 1 else -1.0
        px, py, p = cx + f * ax + g * bx, cy + f * ay + g * by, height + f * a + g * b
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

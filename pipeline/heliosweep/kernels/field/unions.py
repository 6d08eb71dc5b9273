"""Exact area of the union of images on a test mirror, for all lanes of a packet.

The test mirror, scaled by its half sides, is the square [-1, 1] x [-1, 1]. A polygon is a counter-clockwise list of
corners x, y, x, y, ... in a flat array; the start and the number of corners of each polygon are stored separately. All
functions are continuous in the corner coordinates, so coincident or nearly coincident edges cause only rounding errors.

Let C be the centre of the test mirror, u and v its half sides, and d the direction to the sun or the target. A point C
+ q is projected along d to (q.U, q.V) on the plane of the test mirror, where U = (v x d) / (u.(v x d)) and V = (d x u)
/ (u.(v x d)). Because u.U = v.V = 1, the edges of the test mirror are at -1 and 1. The image of another mirror is a
parallelogram, stored as its centre and two half edges.

If no four images in a lane overlap, the area of the union is the sum of the areas, minus the common areas of pairs,
plus the common areas of triples. If four images overlap, if edges coincide (a tie), or if a mirror crosses the plane of
the test mirror, the images in the lane are subtracted from the square one by one.

Sets of lanes are stored as integers with one bit per lane. The method for a lane depends only on the images in this
lane, in the order of the search. Results for a lane are therefore independent of the rest of its packet.

The common area of the square and two images is computed from the boundary of the first image clipped to the square.
This boundary has eight parts: the four edges of the image, clipped to the square, and the four edges of the square,
clipped to the image. All eight parts are computed from the same crossings, so the boundary is closed. The parts are
transformed to coordinates in which the second image is the square, and `edge_terms` computes the area by Green's
theorem. If an edge of the first image nearly coincides with a side of the square, their crossing is ill-defined, and
the images in this lane are subtracted one by one. Coincident edges of the two images need no special treatment, because
clamping is continuous in the corner coordinates.
"""

import math

import numpy as np

from heliosweep.kernels.compiled import Floats, Integers, inline, inner
from heliosweep.kernels.field.packets import offset
from heliosweep.kernels.vectors import (
    ROW,
    Vector,
    cross,
    dot,
    get,
    larger,
    load,
    load2,
    next_run,
    put,
    scaled,
    smaller,
    store,
)

#: Area of the square.
SQUARE = 4.0
#: Maximum number of corners of an image: four, plus one if the plane of the test mirror cuts off a corner.
CORNERS = 5
#: One value for each of the four edges of an image.
Four = tuple[float, float, float, float]


@inline
def slopes(x: float, y: float) -> tuple[float, float]:
    """Return the slopes dy/dx and dx/dy of the direction (x, y), using a single division.

    For directions along an axis, both slopes are set to 0 and are not used.
    """
    square = x * y
    inverse = 1.0 / square if abs(square) > 1e-200 else 0.0
    return y * y * inverse, x * x * inverse


@inline
def unit(value: float) -> float:
    """Clamp a number to [-1, 1], in a form that compiles to two vector instructions."""
    return larger(smaller(value, 1.0), -1.0)


@inline
def units(values: Four) -> Four:
    """Clamp each of four numbers to [-1, 1]."""
    return unit(values[0]), unit(values[1]), unit(values[2]), unit(values[3])


@inline
def along(p: Four, t: Four, d: Four) -> Four:
    """Return p + t d for four lines."""
    return p[0] + t[0] * d[0], p[1] + t[1] * d[1], p[2] + t[2] * d[2], p[3] + t[3] * d[3]


@inline
def less(a: Four, b: Four) -> Four:
    """Return a - b for four pairs of numbers."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]


@inline
def edge_terms(px: Four, py: Four, qx: Four, qy: Four, rise: Four, run: Four) -> Four:
    """Return the integrals of clamp(y) dx along four edges from p to q, each over the part with x in [-1, 1].

    By Green's theorem, the sum of these integrals around a polygon is the area within the square, up to its sign. On
    each vertical line, the polygon contributes the clamped top minus the clamped bottom. Integration by parts gives [x
    y] minus the integral of x dy, which requires only the values of x at which the edge crosses y = -1 and y = 1. These
    crossings are computed directly, not from a ratio of integrals, so nearly horizontal and nearly vertical edges lose
    no accuracy. Crossings outside the square do not contribute. The mean of two crossings is clamped because of
    rounding errors. `rise` and `run` are the slopes dy/dx and dx/dy of the edges, from `slopes`. The four edges are
    processed together so that their instructions can run in parallel.
    """
    x0, x1 = units(px), units(qx)
    y0, y1 = along(py, less(x0, px), rise), along(qy, less(x1, qx), rise)
    c0, c1 = units(y0), units(y1)
    start, stop = along(x0, less(c0, y0), run), along(x1, less(c1, y1), run)
    middle = units(along((0.0,) * 4, (0.5,) * 4, along(start, (1.0,) * 4, stop)))
    m, n = less(x1, middle), less(x0, middle)
    return less(along((0.0,) * 4, c1, m), along((0.0,) * 4, c0, n))


@inner
def write_square(polygons: Floats, at: int) -> None:
    """Write the corners of the square [-1, 1] x [-1, 1], starting at index `at`."""
    for k in range(4):
        polygons[at + 2 * k], polygons[at + 2 * k + 1] = 1.0 if k == 1 or k == 2 else -1.0, 1.0 if k > 1 else -1.0


@inner
def area(polygons: Floats, at: int, corners: int) -> float:
    """Return the area of a polygon, positive if counter-clockwise."""
    total, ox, oy = 0.0, polygons[at], polygons[at + 1]
    for k in range(at + 2, at + 2 * corners - 2, 2):
        px, py, qx, qy = polygons[k] - ox, polygons[k + 1] - oy, polygons[k + 2] - ox, polygons[k + 3] - oy
        total += px * qy - py * qx
    return 0.5 * total


@inner
def cut(
    polygons: Floats, at: int, corners: int, ox: float, oy: float, ex: float, ey: float, inside: int, outside: int
) -> tuple[int, int]:
    """Cut a convex polygon into a left and a right part along the line through o in direction e.

    The polygon begins at `at` in `polygons` and has `corners` corners. The left part is written at `inside` and the
    right part at `outside`. Neither part may overlap the polygon in the array. Returns the number of corners of each
    part. A degenerate part may have corners on the line; its area is 0.
    """
    left = right = 0
    qx, qy = polygons[at + 2 * corners - 2], polygons[at + 2 * corners - 1]
    q = ex * (qy - oy) - ey * (qx - ox)
    for k in range(corners):
        px, py = polygons[at + 2 * k], polygons[at + 2 * k + 1]
        p = ex * (py - oy) - ey * (px - ox)
        if (p > 0.0 and q < 0.0) or (p < 0.0 and q > 0.0):
            share = q / (q - p)
            x, y = qx + share * (px - qx), qy + share * (py - qy)
            polygons[inside + 2 * left], polygons[inside + 2 * left + 1] = x, y
            polygons[outside + 2 * right], polygons[outside + 2 * right + 1] = x, y
            left, right = left + 1, right + 1
        if p >= 0.0:
            polygons[inside + 2 * left], polygons[inside + 2 * left + 1] = px, py
            left += 1
        if p <= 0.0:
            polygons[outside + 2 * right], polygons[outside + 2 * right + 1] = px, py
            right += 1
        qx, qy, q = px, py, p
    return left, right


@inner
def crossing(polygons: Floats, at: int, corners: int, pieces: Floats, piece: int, size: int) -> int:
    """Return a bit mask of the polygon edges that cut a piece, or -1 if an edge excludes the whole piece."""
    found = 0 if corners > 2 else -1
    px, py = polygons[at + 2 * corners - 2], polygons[at + 2 * corners - 1]
    for e in range(corners):
        qx, qy = polygons[at + 2 * e], polygons[at + 2 * e + 1]
        beyond, inside = False, False
        for c in range(piece, piece + 2 * size, 2):
            side = (qx - px) * (pieces[c + 1] - py) - (qy - py) * (pieces[c] - px)
            beyond |= side < 0.0
            inside |= side > 0.0
        if beyond and not inside:
            return -1
        found |= beyond << e
        px, py = qx, qy
    return found


@inner
def within(pieces: Floats, piece: int, size: int, polygons: Floats, at: int, corners: int) -> tuple[int, int]:
    """Clip a piece to a polygon; return the start and number of corners of the result.

    The number of corners is 0 if the result is empty. The piece must begin at 0 or at one third of `pieces`. The other
    elements are scratch space.
    """
    crossed, third = crossing(polygons, at, corners, pieces, piece, size), len(pieces) // 3
    px, py = polygons[at + 2 * corners - 2], polygons[at + 2 * corners - 1]
    for e in range(corners if crossed > 0 and size > 2 else 0):
        qx, qy = polygons[at + 2 * e], polygons[at + 2 * e + 1]
        if crossed >> e & 1 and size > 2:
            size, _ = cut(pieces, piece, size, px, py, qx - px, qy - py, third - piece, 2 * third)
            piece = third - piece
        px, py = qx, qy
    return piece, size if crossed >= 0 and size > 2 else 0


@inner
def leave_open(
    polygons: Floats, marks: Integers, k: int, middle: int, last: int, pieces: Floats, piece: int, size: int, top: int
) -> None:  # fmt: skip
    """Add the areas of a convex piece outside two ranges of polygons to ``pieces[0]`` and ``pieces[1]``.

    The ranges are k to middle - 1 and k to last - 1. The polygons are convex and are subtracted one by one, by
    depth-first recursion over convex pieces. Each edge of a polygon splits off the part outside the edge, and the part
    inside all edges is discarded. Pieces never overlap, so no
    inclusion-exclusion is needed.

    `polygons` holds up to `CORNERS` corners per polygon, and row `_SIZES` of `marks` contains the number of corners of
    each polygon. The piece of `size` corners begins at `piece` in `pieces`, and scratch space begins at `top`.
    """
    crossed = -1
    while crossed < 0:  # skip polygons that do not overlap the piece
        if k == middle:
            pieces[0] += area(pieces, piece, size)
        if k == last:
            pieces[1] += area(pieces, piece, size)
            return
        at, edges = 2 * CORNERS * k, marks[_SIZES, k]
        crossed = crossing(polygons, at, edges, pieces, piece, size)
        k += 1
    room = 2 * (size + CORNERS)
    px, py = polygons[at + 2 * edges - 2], polygons[at + 2 * edges - 1]
    for e in range(edges):
        qx, qy = polygons[at + 2 * e], polygons[at + 2 * e + 1]
        if crossed >> e & 1 and size > 2:
            inside = top if piece != top else top + room
            size, outside = cut(pieces, piece, size, px, py, qx - px, qy - py, inside, top + 2 * room)
            piece = inside
            if outside > 2 and area(pieces, top + 2 * room, outside) > 1e-17:  # not a sliver
                leave_open(polygons, marks, k, middle, last, pieces, top + 2 * room, outside, top + 3 * room)
        px, py = qx, qy


#: Offsets of rows in the array `lines`, which has one element per lane and belongs to one test heliostat.
#: Rows 0 to 2 contain the unit vectors to the sun.
#: `TO_TARGET`: Unit vectors to the target.
#: `VIEWS`: Projection axes U and V for the direction to the sun or to the target. [1/m]
#: `TOTAL`: Shaded area, blocked area, and area that is shaded or blocked, on the square of area 4.
#: `_SHARED`: Common area of two images.
#: `WEIGHT`, `RESULT`, `IMAGES`: Weights of the instants, seven results, and images.
TO_TARGET, VIEWS, TOTAL, _SHARED, WEIGHT, RESULT, IMAGES = (row * ROW for row in (3, 6, 12, 15, 16, 17, 24))
#: Number of floats in an image.
#: The rows are the centre (x, y), the half edges a and b (x, y each), and the area on the test mirror (0 if outside).
#: Three more rows contain the height of the centre above the plane of the test mirror, and its changes along a and b.
IMAGE = 10 * ROW
#: Offsets of the rows of areas and heights. Heights are valid only in lanes of `BEHIND`.
AREA, _HEIGHT = 6 * ROW, 7 * ROW
#: Rows of the array `marks`, which has one column for each image. Lanes are stored with one bit per lane.
#: `PRESENT`: Lanes in which the image covers part of the test mirror.
#: `BEHIND`: Lanes in which part of the projected mirror lies behind the plane of the test mirror and is cut off.
#: `_NAMES`, `_SIZES`: Indices of the images in one lane, and the number of corners of each image.
#: `_MET` and following rows: lanes in which each pair of images overlaps.
PRESENT, BEHIND, _NAMES, _SIZES, _MET = range(5)


@inner
def write_axes(lines: Floats, frames: Floats, f: int, direction: int, lanes: int) -> None:
    """Write the projection axes U and V of a test mirror, 3 rows each. [1/m]

    The frame of the mirror begins at `f` in `frames`. `direction` is 0 (to the sun) or `TO_TARGET`.

    U and V are 0 if the sides of the mirror are 0. The denominator of U and V is computed from the vectors, because the
    cosine would have large rounding errors at grazing incidence.
    """
    for k in range(lanes):
        u, v, d = load(frames, f, k), load(frames, f + 3 * ROW, k), load(lines, direction, k)
        across = cross(v, d)
        facing = dot(u, across)
        scale = 1.0 / facing if facing > 0.0 else 0.0
        store(lines, VIEWS, k, scaled(scale, across))
        store(lines, VIEWS + 3 * ROW, k, scaled(scale, cross(d, u)))


@inner
def project(
    lines: Floats, marks: Integers, m: int, frames: Floats, f: int, test: int, direction: int, spheres: Floats, i: int,
    j: int, lanes: int,
) -> bool:  # fmt: skip
    """Write the projection of mirror j as image m; return True if the image covers part of the test mirror i.

    Overlap is tested with separating axes, namely the edge normals of the square and of the image.

    `lines` contains U and V of the test mirror, from `write_axes`, and the direction d at `direction`. The frame of
    mirror j begins at `f` in `frames`, and the frame of the test mirror at `test` [m]. `spheres` contains the bounding
    spheres of all mirrors. If the bounding spheres of the two mirrors are disjoint, mirror j is in front if and only if
    D.d > 0.
    """
    way, reach = offset(spheres, i, j), spheres[i, 3] + spheres[j, 3]
    apart = dot(way, way) > reach * reach * (1.0 + 1e-12)
    o, level, hits = IMAGES + m * IMAGE, np.int64(0), np.int64(0)
    for k in range(lanes):
        v = load(lines, VIEWS + 3 * ROW, k)
        c, a, b = dot(way, v), dot(load(frames, f, k), v), dot(load(frames, f + 3 * ROW, k), v)
        put(lines, o + ROW, k, c)
        put(lines, o + 3 * ROW, k, a)
        put(lines, o + 5 * ROW, k, b)
        level |= np.int64(abs(c) - (abs(a) + abs(b)) < 1.0) << k
    start, stop = next_run(0, level, lanes)
    while start < stop:
        hits |= _project_along_u(lines, o, frames, f, direction, way, apart, start, stop)
        start, stop = next_run(stop, level, lanes)
    hits &= level
    marks[BEHIND, m] = 0
    if hits != 0:
        hits = _measure(lines, o, hits, lanes)
        if not apart:
            marks[BEHIND, m] = _heights(lines, o, frames, f, test, way, hits, lanes)
    marks[PRESENT, m] = hits
    return hits != 0


@inner
def project_tower(
    lines: Floats, marks: Integers, frames: Floats, test: int, base: Vector, low: float, tower: Floats, lanes: int
) -> bool:
    """Write the projection of a tower as image 0; return True if the image covers part of the test mirror.

    The tower is an upright cylinder. It is replaced by an upright rectangle that faces the sun, is one tower diameter
    wide, and is pi/4 radii in front of the tower axis. The shadow of this rectangle has a straight end, and its area
    equals the area of the cylinder's shadow. The tower is treated as if it had no lower end.

    `base` is the vector from the centre of the test mirror to the foot of the tower [m]. The lower edge of the
    rectangle is `low` below the centre of the test mirror [m]. `tower` contains the radius of the tower and the height
    of its top [m]. The other parameters are as in `project`.
    """
    found, behind = np.int64(0), np.int64(0)
    half, front = 0.5 * (base[2] + tower[1] + low), 0.25 * math.pi * tower[0]
    for k in range(lanes):
        d = load(lines, 0, k)
        level = math.sqrt(d[0] * d[0] + d[1] * d[1])
        scale = 1.0 / level if level > 0.0 else 0.0  # no shadow if the sun is at the zenith
        east, north = scale * d[0], scale * d[1]
        c = base[0] - front * east, base[1] - front * north, half - low
        a, b = (tower[0] * north, -tower[0] * east, 0.0), (0.0, 0.0, half)
        u, v = load(lines, VIEWS, k), load(lines, VIEWS + 3 * ROW, k)
        normal = cross(load(frames, test, k), load(frames, test + 3 * ROW, k))
        for row, edge in ((0, c), (2, a), (4, b)):
            put(lines, IMAGES + row * ROW, k, dot(edge, u))
            put(lines, IMAGES + (row + 1) * ROW, k, dot(edge, v))
        height, rise = dot(c, normal), abs(dot(a, normal)) + abs(dot(b, normal))
        store(lines, IMAGES + _HEIGHT, k, (height, dot(a, normal), dot(b, normal)))
        found |= np.int64((half > 0.0) & (scale > 0.0) & (height > -rise)) << k
        behind |= np.int64(height < rise) << k
    found = _measure(lines, IMAGES, found, lanes)
    marks[PRESENT, 0], marks[BEHIND, 0] = found, behind & found
    return found != 0


@inner
def _project_along_u(lines, o, frames, f, direction, way, apart, start, stop):
    """Write the x coordinates of an image in a run of lanes; return the lanes in which it overlaps the square."""
    hits, nearest = np.int64(0), 0.0 if apart else -np.inf
    for k in range(start, stop):
        u = load(lines, VIEWS, k)
        cx, ax, bx = dot(way, u), dot(load(frames, f, k), u), dot(load(frames, f + 3 * ROW, k), u)
        cy, ay, by = get(lines, o + ROW, k), get(lines, o + 3 * ROW, k), get(lines, o + 5 * ROW, k)
        put(lines, o, k, cx)
        put(lines, o + 2 * ROW, k, ax)
        put(lines, o + 4 * ROW, k, bx)
        turn = abs(ax * by - ay * bx)
        gap = larger(abs(cx) - abs(ax) - abs(bx) - 1.0, abs(cx * ay - cy * ax) - turn - abs(ax) - abs(ay))
        gap = larger(gap, abs(cx * by - cy * bx) - turn - abs(bx) - abs(by))
        hits |= np.int64((gap < 0.0) & (dot(way, load(lines, direction, k)) > nearest)) << k
    return hits


@inner
def _measure(lines, o, some, lanes):
    """Write the area of an image within the square for the lanes `some`, and 0 for all other lanes.

    Returns the lanes with a positive area.
    """
    found = np.int64(0)
    for k in range(lanes):
        put(lines, o + AREA, k, 0.0)
    start, stop = next_run(0, some, lanes)
    while start < stop:
        for k in range(start, stop):
            (cx, cy), (ax, ay), (bx, by) = (
                load2(lines, o, k),
                load2(lines, o + 2 * ROW, k),
                load2(lines, o + 4 * ROW, k),
            )
            (a_rise, a_run), (b_rise, b_run) = slopes(ax, ay), slopes(bx, by)
            px = cx - ax - bx, cx + ax - bx, cx + ax + bx, cx - ax + bx
            py = cy - ay - by, cy + ay - by, cy + ay + by, cy - ay + by
            qx, qy = (px[1], px[2], px[3], px[0]), (py[1], py[2], py[3], py[0])
            rise, run = (a_rise, b_rise, a_rise, b_rise), (a_run, b_run, a_run, b_run)
            first, second, third, fourth = edge_terms(px, py, qx, qy, rise, run)
            area = abs((first + third) + (second + fourth)) if some >> k & 1 == 1 else 0.0
            put(lines, o + AREA, k, area)
            found |= np.int64(area > 0.0) << k
        start, stop = next_run(stop, some, lanes)
    return found


@inner
def _heights(lines, o, frames, f, test, way, some, lanes):
    """Write the heights of a nearby mirror above the plane of the test mirror.

    Returns the lanes in which the plane cuts the nearby mirror.
    """
    behind = np.int64(0)
    for k in range(lanes):
        normal = cross(load(frames, test, k), load(frames, test + 3 * ROW, k))
        height = dot(way, normal), dot(load(frames, f, k), normal), dot(load(frames, f + 3 * ROW, k), normal)
        store(lines, o + _HEIGHT, k, height)
        behind |= np.int64(height[0] < abs(height[1]) + abs(height[2])) << k
    return behind & some


@inner
def outline(lines: Floats, marks: Integers, m: int, k: int, polygons: Floats, at: int) -> int:
    """Write the counter-clockwise corners of image m in lane k; return their number, at most `CORNERS`.

    The part behind the plane of the test mirror is cut off.
    """
    o = IMAGES + m * IMAGE
    (cx, cy), (ax, ay), (bx, by) = load2(lines, o, k), load2(lines, o + 2 * ROW, k), load2(lines, o + 4 * ROW, k)
    height, a, b = 1.0, 0.0, 0.0
    if marks[BEHIND, m] >> k & 1:
        height, a, b = load(lines, o + _HEIGHT, k)
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


#: Area below which an image is omitted from unions.
#: Such an image is no wider than rounding errors, and its corners may be out of order.
_NOTHING = 1e-14


@inner
def unions(
    lines: Floats, marks: Integers, polygons: Floats, pieces: Floats, shading: int, count: int, lanes: int
) -> None:
    """Compute the exact area of the union of images in each lane, on the square of area 4.

    The first `shading` of `count` images are shadows; the others are blocked parts. The shaded area, the blocked area,
    and the area that is shaded or blocked are written to the rows `TOTAL` of `lines`. `lanes` is a multiple of
    `vectors.GROUP`. `polygons` is scratch space for up to `CORNERS` corners of each image, and `pieces` for the pieces
    of the square outside the images.

    Rounding errors are about 1e-14. Within 1 mrad of grazing incidence, rounding errors increase to 2e-12 if images are
    1000 times as large as the mirror.
    """
    one = two = four = general = np.int64(0)
    for k in range(lanes):
        put(lines, TOTAL, k, 0.0)
        put(lines, TOTAL + ROW, k, 0.0)
    for m in range(count):
        carry, general = marks[PRESENT, m], general | marks[BEHIND, m]
        one, carry = one ^ carry, one & carry
        two, carry = two ^ carry, two & carry
        four, general = four ^ carry, general | four & carry
        _add(lines, TOTAL if m < shading else TOTAL + ROW, IMAGES + m * IMAGE + AREA, 1.0, np.int64(-1), lanes)
    for k in range(lanes):
        put(lines, TOTAL + 2 * ROW, k, get(lines, TOTAL, k) + get(lines, TOTAL + ROW, k))
    general |= four & two & one
    if (two | four) & ~general != 0:
        general |= _add_overlaps(lines, marks, (two | four) & ~general, shading, count, polygons, pieces, lanes)
    for k in range(lanes if general != 0 else 0):
        if general >> k & 1:
            _subtract(lines, marks, shading, count, k, polygons, pieces)


@inner
def _add(lines, row, areas, factor, some, lanes):
    """Add areas, multiplied by `factor`, to a row of totals in the lanes `some`."""
    for k in range(lanes):
        put(lines, row, k, get(lines, row, k) + (factor * get(lines, areas, k) if some >> k & 1 else 0.0))


@inner
def _overlapping(lines, one, other, some, lanes):
    """Return the lanes in which two images overlap (by separating axes) and both areas exceed rounding errors."""
    found = np.int64(0)
    start, stop = next_run(0, some, lanes)
    while start < stop:
        for k in range(start, stop):
            (gx, gy), (ax, ay), (bx, by) = (
                load2(lines, one, k),
                load2(lines, one + 2 * ROW, k),
                load2(lines, one + 4 * ROW, k),
            )
            (hx, hy), (px, py), (qx, qy) = (
                load2(lines, other, k),
                load2(lines, other + 2 * ROW, k),
                load2(lines, other + 4 * ROW, k),
            )
            cx, cy = hx - gx, hy - gy
            ab, pq = abs(ax * by - ay * bx), abs(px * qy - py * qx)
            ap, aq = abs(ax * py - ay * px), abs(ax * qy - ay * qx)
            bp, bq = abs(bx * py - by * px), abs(bx * qy - by * qx)
            gap = larger(abs(cx * ay - cy * ax) - ab - ap - aq, abs(cx * by - cy * bx) - ab - bp - bq)
            gap = larger(gap, abs(cx * py - cy * px) - pq - ap - bp)
            gap = larger(gap, abs(cx * qy - cy * qx) - pq - aq - bq)
            # treat images closer than 1e-3 as overlapping, because their edges may coincide
            least = smaller(get(lines, one + AREA, k), get(lines, other + AREA, k))
            found |= np.int64((gap < 1e-3) & (least > _NOTHING)) << k
        start, stop = next_run(stop, some, lanes)
    return found


@inner
def _add_overlaps(lines, marks, some, shading, count, polygons, pieces, lanes):
    """Subtract overlaps of pairs, add overlaps of triples; return lanes with ties or four overlapping images."""
    left = np.int64(0)
    for m in range(count):
        marks[_MET + m, m] = 0
        for n in range(m):
            both, one, other = marks[PRESENT, m] & marks[PRESENT, n] & some, IMAGES + n * IMAGE, IMAGES + m * IMAGE
            if both != 0:
                both &= _overlapping(lines, one, other, both, lanes)
            if both != 0:
                tied, both = shared_by_two(lines, one, other, both, lanes)
                left |= tied
                _add(lines, TOTAL + 2 * ROW, _SHARED, -1.0, both, lanes)
                if m < shading or n >= shading:
                    _add(lines, TOTAL if m < shading else TOTAL + ROW, _SHARED, -1.0, both, lanes)
            marks[_MET + m, n] = marks[_MET + n, m] = both
    for m in range(count):
        for n in range(m):
            if marks[_MET + m, n] & ~left != 0:
                left = _add_triples(lines, marks, m, n, left, shading, count, polygons, pieces, lanes)
    return left


@inner
def _add_triples(lines, marks, m, n, left, shading, count, polygons, pieces, lanes):
    """Add common areas of m, n and each image before n; return lanes with ties or four overlapping images."""
    for i in range(n):
        three = marks[_MET + m, n] & marks[_MET + m, i] & marks[_MET + n, i] & ~left
        for h in range(count if three != 0 else 0):
            left |= three & marks[_MET + m, h] & marks[_MET + n, h] & marks[_MET + i, h]
        for k in range(lanes if three & ~left != 0 else 0):
            if (three & ~left) >> k & 1:
                piece, corners = 0, 4
                write_square(pieces, 0)
                for j in (m, n, i):
                    edges = outline(lines, marks, j, k, polygons, 0)
                    piece, corners = within(pieces, piece, corners, polygons, 0, edges)
                shared = area(pieces, piece, corners)
                lines[TOTAL + 2 * ROW + k] += shared
                if m < shading or i >= shading:
                    lines[(TOTAL if m < shading else TOTAL + ROW) + k] += shared
    return left


@inner
def _subtract(lines, marks, shading, count, k, polygons, pieces):
    """Compute the unions of one lane by subtracting the images from the square."""
    some, shades = 0, 0
    for m in range(count):
        size = get(lines, IMAGES + m * IMAGE + AREA, k)
        if size > _NOTHING:  # sort by descending size
            n = some
            while n > (shades if m >= shading else 0):
                before = marks[_NAMES, n - 1]
                if size <= get(lines, IMAGES + before * IMAGE + AREA, k):
                    break
                marks[_NAMES, n] = before
                n -= 1
            marks[_NAMES, n], some = m, some + 1
            shades = some if m < shading else shades
    for n in range(some):
        marks[_SIZES, n] = outline(lines, marks, marks[_NAMES, n], k, polygons, 2 * CORNERS * n)
    for first in (0, shades):
        write_square(pieces, 2)
        pieces[0] = pieces[1] = 0.0
        leave_open(polygons, marks, first, shades, some, pieces, 2, 4, 10)
        if first == 0:
            lines[TOTAL + k], lines[TOTAL + 2 * ROW + k] = SQUARE - pieces[0], SQUARE - pieces[1]
    lines[TOTAL + ROW + k] = SQUARE - pieces[1]


#: Limits for ties. In a lane with a tie, images are subtracted from the square one by one.
#: `_ALONG`, `_NEXT`: An edge nearly coincides with a side of the square if its component perpendicular to the side is
#: below `_ALONG` and the distance of one of its ends from the side is below `_NEXT`.
#: `_THIN`: Minimum cross product of the half edges of an image.
_ALONG, _NEXT, _THIN = 1e-3, 2e-3, 1e-6


@inner
def shared_by_two(lines: Floats, one: int, other: int, some: int, lanes: int) -> tuple[np.int64, np.int64]:
    """Write the common area of the square and the images at offsets `one` and `other` in the lanes `some`.

    Returns the lanes in which the area may be wrong because edges nearly coincide, and the lanes with a positive area.
    """
    tied, found = np.int64(0), np.int64(0)
    start, stop = next_run(0, some, lanes)
    while start < stop:
        for k in range(start, stop):
            (cx, cy), (ax, ay) = load2(lines, one, k), load2(lines, one + 2 * ROW, k)
            (bx, by), (gx, gy) = load2(lines, one + 4 * ROW, k), load2(lines, other, k)
            (px, py), (qx, qy) = load2(lines, other + 2 * ROW, k), load2(lines, other + 4 * ROW, k)
            ax, ay, bx, by = _turned(ax), _turned(ay), _turned(bx), _turned(by)
            # Coordinates in the frame of the second image: (x e + y f + g, x h + y i + j).
            turn = px * qy - py * qx
            scale = 1.0 / turn if abs(turn) > 1e-200 else 0.0
            e, f, h, i = qy * scale, -qx * scale, -py * scale, px * scale
            g, j = -(gx * e + gy * f), -(gx * h + gy * i)
            ux, uy, vx, vy = ax * e + ay * f, ax * h + ay * i, bx * e + by * f, bx * h + by * i
            mx, my = cx * e + (cy * f + g), cx * h + (cy * i + j)
            (u_rise, u_run), (v_rise, v_run) = slopes(ux, uy), slopes(vx, vy)
            (x_rise, x_run), (y_rise, y_run) = slopes(e, h), slopes(f, i)
            inverse_a, inverse_b = 1.0 / (ax * ay), 1.0 / (bx * by)
            rx, ry, sx, sy = ay * inverse_a, ax * inverse_a, by * inverse_b, bx * inverse_b
            px, py = (cx - bx, cx + bx, cx + ax, cx - ax), (cy - by, cy + by, cy + ay, cy - ay)
            east, west = _crossings(1.0, px, (rx, rx, sx, sx)), _crossings(-1.0, px, (rx, rx, sx, sx))
            north, south = _crossings(1.0, py, (ry, ry, sy, sy)), _crossings(-1.0, py, (ry, ry, sy, sy))
            low, high = _between(east, west, north, south)
            first, second, third, fourth = _parts(
                (mx - vx, mx + vx, mx + ux, mx - ux),
                (my - vy, my + vy, my + uy, my - uy),
                (ux, ux, vx, vx),
                (uy, uy, vy, vy),
                low,
                high,
                (u_rise, u_rise, v_rise, v_rise),
                (u_run, u_run, v_run, v_run),
            )
            total, area = first - second + third - fourth, ax * by - ay * bx
            total = total if area > 0.0 else -total
            # y of the crossings of edges with x = 1 and x = -1, and x of the crossings with y = 1 and y = -1.
            dx, dy = (ax, ax, bx, bx), (ay, ay, by, by)
            a, b, c, d = along(py, east, dy), along(py, west, dy), along(px, north, dx), along(px, south, dx)
            low, high = _between(
                (a[0], b[0], c[0], d[0]), (a[1], b[1], c[1], d[1]), (a[2], b[2], c[2], d[2]), (a[3], b[3], c[3], d[3])
            )
            first, second, third, fourth = _parts(
                (g + e, g - e, g + f, g - f),
                (j + h, j - h, j + i, j - i),
                (f, f, e, e),
                (i, i, h, h),
                low,
                high,
                (y_rise, y_rise, x_rise, x_rise),
                (y_run, y_run, x_run, x_run),
            )
            total = abs((total + first - second - third + fourth) * turn)
            put(lines, _SHARED, k, total)
            found |= np.int64(total > 1e-15) << k
            near = _tied(cx, bx, ax) | _tied(cy, by, ay) | _tied(cx, ax, bx) | _tied(cy, ay, by) | (abs(area) < _THIN)
            tied |= np.int64(near) << k
        start, stop = next_run(stop, some, lanes)
    return tied & some, found & some


@inline
def _turned(value):
    """Return an edge component, or 1e-140 if its magnitude is smaller."""
    return value if abs(value) > 1e-140 else 1e-140


@inline
def _crossings(side, p, r):
    """Return the parameters at which four edges cross a side; `r` contains the inverse edge components."""
    return (side - p[0]) * r[0], (side - p[1]) * r[1], (side - p[2]) * r[2], (side - p[3]) * r[3]


@inline
def _between(a, b, c, d):
    """Return the ends of the parts of four lines that `_ends` returns for one line."""
    (low0, high0), (low1, high1) = _ends(a[0], b[0], c[0], d[0]), _ends(a[1], b[1], c[1], d[1])
    (low2, high2), (low3, high3) = _ends(a[2], b[2], c[2], d[2]), _ends(a[3], b[3], c[3], d[3])
    return (low0, low1, low2, low3), (high0, high1, high2, high3)


@inline
def _ends(a, b, c, d):
    """Return the ends of the part of a line within [-1, 1], between crossings a and b and between c and d."""
    low = unit(larger(smaller(a, b), smaller(c, d)))
    return low, larger(smaller(smaller(larger(a, b), larger(c, d)), 1.0), low)


@inline
def _parts(px, py, dx, dy, low, high, rise, run):
    """Return the `edge_terms` of four lines p + t d from t = low to t = high."""
    return edge_terms(along(px, low, dx), along(py, low, dy), along(px, high, dx), along(py, high, dy), rise, run)


@inline
def _tied(middle, half, component):
    """Return True if one of two parallel edges nearly coincides with a side of the square."""
    return (abs(component) < _ALONG) & (
        (abs(abs(middle + half) - 1.0) < _NEXT) | (abs(abs(middle - half) - 1.0) < _NEXT)
    )

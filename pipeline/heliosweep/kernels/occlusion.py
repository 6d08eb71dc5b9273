"""Images of mirrors on a test mirror, for all lanes of a packet, and the exact area of their union.

For the test mirror (u, v, n) and the direction d (sun, or the mirror's own target), a point P = C + q of the scene
projects along d to ((q.U), (q.V)) on the plane of the mirror, with U = (v x d) / (n.d) and V = (d x u) / (n.d). Here U
and V are divided by the half sides as well: the test mirror is the square [-1, 1] x [-1, 1], and the image of another
mirror a parallelogram given by its centre and two half edges. n.d is the cosine of the angle of incidence for both
directions, |r + s| / 2.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts import FRAME_ROWS
from heliosweep.kernels.packets import PACKET
from heliosweep.kernels.polygons import SQUARE, clip_to_square, edge_term, gaps, slope, square_area

__all__ = ["IMAGE_ROWS", "cosines", "image", "union", "view"]

IMAGE_ROWS = 10
"""Rows of an image: centre x, y; half edges a and b (x, y of each); area on the test mirror (0: none); and, only for
mirrors that may straddle the plane of the test mirror, the heights over it: of the centre, and along a and b."""
_AREA = 6 * PACKET
_HEIGHT = 7 * PACKET
_PAIRWISE = 12
"""Images in one lane up to which pairs are tried before the general union."""


@kernel
def cosines(out: NDArray[np.float64], sun: NDArray[np.float64], rx: float, ry: float, rz: float) -> None:
    """Cosine of the angle of incidence, |r + s| / 2 = sqrt((1 + r.s) / 2), for every lane."""
    for k in range(PACKET):
        nx, ny, nz = rx + sun[k], ry + sun[PACKET + k], rz + sun[2 * PACKET + k]
        out[k] = 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)


@kernel
def view(
    out: NDArray[np.float64],
    frame: NDArray[np.float64],
    cosine: NDArray[np.float64],
    directions: NDArray[np.float64],
    area: float,
) -> None:
    """Write the rows U and V (x, y, z of each) of a test mirror for every lane.

    Parameters
    ----------
    out : ndarray, shape (FRAME_ROWS * PACKET,)
        Receives U and V. [1/m]
    frame : ndarray, shape (FRAME_ROWS * PACKET,)
        Half sides of the test mirror. [m]
    cosine : ndarray, shape (PACKET,)
        Cosine of the angle of incidence. [1]
    directions : ndarray, shape (3 * PACKET,)
        Rows of the direction d. [1]
    area : float
        Product of the half sides. [m2]
    """
    for k in range(PACKET):
        ux, uy, uz = frame[k], frame[PACKET + k], frame[2 * PACKET + k]
        vx, vy, vz = frame[3 * PACKET + k], frame[4 * PACKET + k], frame[5 * PACKET + k]
        dx, dy, dz = directions[k], directions[PACKET + k], directions[2 * PACKET + k]
        scale = 1.0 / (area * cosine[k]) if cosine[k] > 0.0 else 0.0
        out[k] = scale * (vy * dz - vz * dy)
        out[PACKET + k] = scale * (vz * dx - vx * dz)
        out[2 * PACKET + k] = scale * (vx * dy - vy * dx)
        out[3 * PACKET + k] = scale * (dy * uz - dz * uy)
        out[4 * PACKET + k] = scale * (dz * ux - dx * uz)
        out[5 * PACKET + k] = scale * (dx * uy - dy * ux)


@kernel
def image(
    out: NDArray[np.float64],
    views: NDArray[np.float64],
    frame: NDArray[np.float64],
    directions: NDArray[np.float64],
    dx: float,
    dy: float,
    dz: float,
    apart: bool,
    test: NDArray[np.float64],
    scratch: NDArray[np.float64],
) -> bool:
    """Write the image of one mirror on the test mirror for every lane; False if no lane has one.

    Parameters
    ----------
    out : ndarray, shape (IMAGE_ROWS * PACKET,)
        Receives the image.
    views : ndarray, shape (FRAME_ROWS * PACKET,)
        U and V of the test mirror. [1/m]
    frame : ndarray, shape (FRAME_ROWS * PACKET,)
        Half sides of the other mirror. [m]
    directions : ndarray, shape (3 * PACKET,)
        Rows of the direction d. [1]
    dx, dy, dz : float
        D, from the centre of the test mirror to that of the other. [m]
    apart : bool
        Whether the bounding spheres are disjoint: then D.d > 0 tells exactly which mirror is in front.
    test : ndarray, shape (FRAME_ROWS * PACKET,)
        Half sides of the test mirror. [m]
    scratch : ndarray, shape (2, 5, 2)
        Scratch.
    """
    behind = 0.0 if apart else -np.inf
    hits = 0
    for k in range(PACKET):
        ux, uy, uz = views[k], views[PACKET + k], views[2 * PACKET + k]
        vx, vy, vz = views[3 * PACKET + k], views[4 * PACKET + k], views[5 * PACKET + k]
        px, py, pz = frame[k], frame[PACKET + k], frame[2 * PACKET + k]
        qx, qy, qz = frame[3 * PACKET + k], frame[4 * PACKET + k], frame[5 * PACKET + k]
        cx, cy = dx * ux + dy * uy + dz * uz, dx * vx + dy * vy + dz * vz
        ax, ay = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
        bx, by = qx * ux + qy * uy + qz * uz, qx * vx + qy * vy + qz * vz
        ahead = dx * directions[k] + dy * directions[PACKET + k] + dz * directions[2 * PACKET + k]
        out[k], out[PACKET + k] = cx, cy
        out[2 * PACKET + k], out[3 * PACKET + k] = ax, ay
        out[4 * PACKET + k], out[5 * PACKET + k] = bx, by
        # Separating axes: the normals of the square's edges and of the image's.
        turn = abs(ax * by - ay * bx)
        gap = _larger(abs(cx) - abs(ax) - abs(bx), abs(cy) - abs(ay) - abs(by)) - 1.0
        gap = _larger(gap, abs(cx * ay - cy * ax) - turn - abs(ax) - abs(ay))
        gap = _larger(gap, abs(cx * by - cy * bx) - turn - abs(bx) - abs(by))
        hit = (gap < 0.0) & (ahead > behind)
        out[_AREA + k] = 1.0 if hit else 0.0
        hits += hit
    if hits == 0:
        return False
    for k in range(PACKET):
        cx, cy = out[k], out[PACKET + k]
        ax, ay, bx, by = out[2 * PACKET + k], out[3 * PACKET + k], out[4 * PACKET + k], out[5 * PACKET + k]
        a_rise, a_run, b_rise, b_run = slope(ay, ax), slope(ax, ay), slope(by, bx), slope(bx, by)
        x0, y0, x1, y1 = cx - ax - bx, cy - ay - by, cx + ax - bx, cy + ay - by
        x2, y2, x3, y3 = cx + ax + bx, cy + ay + by, cx - ax + bx, cy - ay + by
        total = (edge_term(x0, y0, x1, y1, a_rise, a_run) + edge_term(x2, y2, x3, y3, a_rise, a_run)) + (
            edge_term(x1, y1, x2, y2, b_rise, b_run) + edge_term(x3, y3, x0, y0, b_rise, b_run)
        )
        out[_AREA + k] *= abs(total)
    if not apart:
        _cut_by_plane(out, frame, dx, dy, dz, test, scratch)
    return True


@inline
def _larger(a: float, b: float) -> float:
    return a if a > b else b


@kernel
def _cut_by_plane(out, frame, dx, dy, dz, test, scratch):
    """Heights of a near mirror over the plane of the test mirror, and the area of the part in front of it."""
    for k in range(PACKET):
        ux, uy, uz = test[k], test[PACKET + k], test[2 * PACKET + k]
        vx, vy, vz = test[3 * PACKET + k], test[4 * PACKET + k], test[5 * PACKET + k]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        out[_HEIGHT + k] = dx * nx + dy * ny + dz * nz
        out[_HEIGHT + PACKET + k] = frame[k] * nx + frame[PACKET + k] * ny + frame[2 * PACKET + k] * nz
        out[_HEIGHT + 2 * PACKET + k] = (
            frame[3 * PACKET + k] * nx + frame[4 * PACKET + k] * ny + frame[5 * PACKET + k] * nz
        )
    for k in range(PACKET):
        if out[_AREA + k] > 0.0 and _straddles(out, k):
            corners = _polygon(out, k, False, scratch[0])
            out[_AREA + k] = square_area(scratch[0], corners) if corners > 2 else 0.0


@inline
def _straddles(out, k):
    """Whether some corner lies behind the plane of the test mirror."""
    return out[_HEIGHT + k] < abs(out[_HEIGHT + PACKET + k]) + abs(out[_HEIGHT + 2 * PACKET + k])


@kernel
def _polygon(out, k, apart, polygon):
    """Corners of an image in lane k, counter-clockwise, cut by the plane of the test mirror; returns their number."""
    cx, cy = out[k], out[PACKET + k]
    ax, ay, bx, by = out[2 * PACKET + k], out[3 * PACKET + k], out[4 * PACKET + k], out[5 * PACKET + k]
    along_a, along_b = (0.0, 0.0) if apart else (out[_HEIGHT + PACKET + k], out[_HEIGHT + 2 * PACKET + k])
    height = 1.0 if apart else out[_HEIGHT + k]
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
            polygon[corners, 0], polygon[corners, 1] = qx + share * (px - qx), qy + share * (py - qy)
            corners += 1
        if p >= 0.0:
            polygon[corners, 0], polygon[corners, 1] = px, py
            corners += 1
        qx, qy, q = px, py, p
    return corners


@kernel
def union(
    images: NDArray[np.float64],
    apart: NDArray[np.bool_],
    names: NDArray[np.int64],
    shading: int,
    count: int,
    k: int,
    scratch: NDArray[np.float64],
):
    """Exact area of the unions of the images in one lane, on the square of area 4.

    While no three images overlap one another, the union is the sum of the areas less the overlaps of pairs: no point
    is counted more than twice. Otherwise the images are subtracted from the square one by one. The order of the images
    is by area, then by name, so it does not depend on how the candidates were found.

    Parameters
    ----------
    images : ndarray, shape (count, IMAGE_ROWS * PACKET)
        Shading images first.
    apart : ndarray of bool, shape (count,)
        Whether each was made with disjoint bounding spheres.
    names : ndarray of int64, shape (count,)
        Heliostat of each image.
    shading, count : int
        Number of shading images, and of all images.
    k : int
        Lane.
    scratch : ndarray, shape (_PAIRWISE + 2, 32, 2)
        Scratch.

    Returns
    -------
    tuple of float
        Area shaded, area blocked, area shaded or blocked.
    """
    order = np.empty(count, np.int64)
    some, shades = 0, 0
    whole = True
    for m in range(count):
        if m == shading:
            shades = some
        if images[m, _AREA + k] > 0.0:
            n = some
            base = shades if m >= shading else 0
            while n > base and _before(images, names, m, order[n - 1], k):
                order[n] = order[n - 1]
                n -= 1
            order[n] = m
            some += 1
            whole = whole and (apart[m] or not _straddles(images[m], k))
    if shading == count:
        shades = some
    if whole and some <= _PAIRWISE:
        simple, shaded, blocked, either = _pairwise(images, order, shades, some, k, scratch)
        if simple:
            return shaded, blocked, either
    polygons, corners = np.empty((some, 5, 2)), np.empty(some, np.int64)
    for m in range(some):
        corners[m] = _polygon(images[order[m]], k, apart[order[m]], polygons[m])
    unshaded, uncovered = gaps(polygons, corners, 0, shades, some)
    unblocked, _ = gaps(polygons, corners, shades, some, some)
    return SQUARE - unshaded, SQUARE - unblocked, SQUARE - uncovered


@inline
def _before(images, names, m, n, k):
    p, q = images[m, _AREA + k], images[n, _AREA + k]
    return p > q or (p == q and names[m] < names[n])


@kernel
def _pairwise(images, order, shades, some, k, scratch):
    """Unions by areas and overlaps of pairs; the first result is False if three images overlap one another."""
    friends, corners = np.zeros(some, np.int64), np.full(some, -1)
    shaded = blocked = crossed = 0.0
    for m in range(some):
        one = images[order[m]]
        if m < shades:
            shaded += one[_AREA + k]
        else:
            blocked += one[_AREA + k]
        for n in range(m):
            other = images[order[n]]
            if _separated(one, other, k):
                continue
            if corners[n] < 0:
                corners[n] = _polygon(other, k, True, scratch[n])
                corners[n] = clip_to_square(scratch[n], corners[n], scratch[_PAIRWISE], scratch[_PAIRWISE + 1])
            overlap = _overlap(scratch[n], corners[n], one, k)
            if overlap > 0.0:
                if friends[m] & friends[n]:
                    return False, 0.0, 0.0, 0.0
                friends[m] |= 1 << n
                friends[n] |= 1 << m
                if m < shades:
                    shaded -= overlap
                elif n >= shades:
                    blocked -= overlap
                else:
                    crossed += overlap
    return True, shaded, blocked, shaded + blocked - crossed


@kernel
def _separated(one, other, k):
    """Whether a line along an edge of either image, or along an axis of the square, separates two images."""
    cx, cy = one[k] - other[k], one[PACKET + k] - other[PACKET + k]
    ax, ay = one[2 * PACKET + k], one[3 * PACKET + k]
    bx, by = one[4 * PACKET + k], one[5 * PACKET + k]
    px, py = other[2 * PACKET + k], other[3 * PACKET + k]
    qx, qy = other[4 * PACKET + k], other[5 * PACKET + k]
    if abs(cx) >= abs(ax) + abs(bx) + abs(px) + abs(qx) or abs(cy) >= abs(ay) + abs(by) + abs(py) + abs(qy):
        return True
    ab, pq = abs(ax * by - ay * bx), abs(px * qy - py * qx)
    ap, aq = abs(ax * py - ay * px), abs(ax * qy - ay * qx)
    bp, bq = abs(bx * py - by * px), abs(bx * qy - by * qx)
    return (
        abs(cx * ay - cy * ax) >= ab + ap + aq
        or abs(cx * by - cy * bx) >= ab + bp + bq
        or abs(cx * py - cy * px) >= pq + ap + bp
        or abs(cx * qy - cy * qx) >= pq + aq + bq
    )


@kernel
def _overlap(polygon, corners, one, k):
    """Area common to a polygon and an image: in the coordinates of the image, that is its part in the square."""
    ax, ay = one[2 * PACKET + k], one[3 * PACKET + k]
    bx, by = one[4 * PACKET + k], one[5 * PACKET + k]
    turn = ax * by - ay * bx
    if turn == 0.0 or corners < 3:
        return 0.0
    total = 0.0
    px, py = _within(polygon, corners - 1, one, turn, k)
    for e in range(corners):
        qx, qy = _within(polygon, e, one, turn, k)
        total += edge_term(px, py, qx, qy, slope(qy - py, qx - px), slope(qx - px, qy - py))
        px, py = qx, qy
    return abs(total * turn)


@inline
def _within(polygon, e, one, turn, k):
    """Corner of a polygon in the coordinates of an image, whose corners are (+-1, +-1)."""
    x, y = polygon[e, 0] - one[k], polygon[e, 1] - one[PACKET + k]
    ax, ay = one[2 * PACKET + k], one[3 * PACKET + k]
    bx, by = one[4 * PACKET + k], one[5 * PACKET + k]
    return (x * by - y * bx) / turn, (ax * y - ay * x) / turn

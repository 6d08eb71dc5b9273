"""Exact areas of unions of images, for all lanes of a packet: by pairs where that is exact, else piece by piece."""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.images import AREA, larger, outline, straddles
from heliosweep.kernels.packets import PACKET
from heliosweep.kernels.polygons import SQUARE, edge_term, gaps, slope, unit

__all__ = ["unions"]

_PAIRWISE = 12
"""Images in one lane up to which pairs are tried before the general union."""


@kernel
def unions(
    images: NDArray[np.float64],
    apart: NDArray[np.bool_],
    shading: int,
    count: int,
    total: NDArray[np.float64],
    lane: NDArray[np.int64],
    spare: NDArray[np.float64],
    lanes: int,
) -> None:
    """Exact areas of the unions of images, for every lane, on the square of area 4.

    While no three images of a lane overlap one another, a union is the sum of the areas less the overlaps of pairs: no
    point is counted more than twice. The other lanes, few, subtract their images from the square one by one. Which
    way a lane goes depends on its own images only, and they keep the order of the grid: the bits of a lane do not
    depend on its packet.

    Parameters
    ----------
    images : ndarray, shape (at least count, IMAGE_ROWS * PACKET)
        Shading images, then blocking images.
    apart : ndarray of bool, shape (at least count,)
        Whether each was made with disjoint bounding spheres.
    shading, count : int
        Number of shading images, and of all images.
    total : ndarray, shape (3 * PACKET,)
        Receives the rows: area shaded, area blocked, area shaded or blocked.
    lane : ndarray of int64, shape (2 * (count + 1) * PACKET,)
        Scratch.
    spare : ndarray, shape (PACKET,)
        Scratch.
    lanes : int
        Lanes of the packet.
    """
    # Row 0 counts the images of a lane, row 1 tells where pairs are not enough; then, for each image, one row with
    # its bit in the lane (0: no image) and one with the bits of the images that it overlaps.
    for k in range(lanes):
        total[k] = total[PACKET + k] = total[2 * PACKET + k] = 0.0
        lane[k] = lane[PACKET + k] = 0
    for m in range(count):
        one, bit, row = images[m], lane[2 * (m + 1) * PACKET :], total[PACKET if m >= shading else 0 :]
        for k in range(lanes):
            here = one[AREA + k] > 0.0
            bit[k] = (1 << (lane[k] & 31)) if here else 0
            bit[PACKET + k] = 0
            lane[k] += here
            row[k] += one[AREA + k]
    several = 0
    for k in range(lanes):
        total[2 * PACKET + k] = total[k] + total[PACKET + k]
        lane[PACKET + k] = lane[k] > _PAIRWISE
        several += lane[k] > 1
    if several == 0:
        return
    for m in range(count):
        if not apart[m]:
            for k in range(lanes):
                if images[m, AREA + k] > 0.0 and straddles(images[m], k):
                    lane[PACKET + k] = 1
    # At grazing sun a packet has hundreds of images, but few share a lane where pairs could be enough: `where` has a
    # bit for each such lane of an image.
    where = np.zeros(count, np.int64)
    for m in range(count):
        bit = lane[2 * (m + 1) * PACKET :]
        for k in range(lanes):
            where[m] |= ((bit[k] != 0) & (lane[k] > 1) & (lane[PACKET + k] == 0)) << k
    for m in range(1, count):
        for n in range(m):
            if where[m] & where[n] == 0:
                continue
            if _overlap(images[n], images[m], lane, 2 * (n + 1) * PACKET, 2 * (m + 1) * PACKET, spare, lanes):
                if m < shading or n >= shading:
                    row = total[PACKET if n >= shading else 0 :]
                    for k in range(lanes):
                        row[k] -= spare[k]
                for k in range(lanes):
                    total[2 * PACKET + k] -= spare[k]
    for k in range(lanes):
        if lane[PACKET + k] > 0 and lane[k] > 1:
            total[k], total[PACKET + k], total[2 * PACKET + k] = _general(images, apart, shading, count, k)


@kernel
def _overlap(one, other, lane, p, q, out, lanes):
    """Write the area of square, `one` and `other` together for every lane; False if no lane has any.

    The part of `one` in the square is followed as a closed chain of 16 segments: each edge of `one` clipped by the
    square, continued along the sides of the square wherever the edge is outside. A chain may run to and fro along a
    side; that cancels. In the coordinates of `other`, which make it the square, Green's theorem gives the area. Each
    step is a clamp, continuous in the corners: there are no ties to break.
    """
    some = 0
    for k in range(lanes):
        cx, cy = other[k] - one[k], other[PACKET + k] - one[PACKET + k]
        ax, ay, bx, by = one[2 * PACKET + k], one[3 * PACKET + k], one[4 * PACKET + k], one[5 * PACKET + k]
        px, py, qx, qy = other[2 * PACKET + k], other[3 * PACKET + k], other[4 * PACKET + k], other[5 * PACKET + k]
        ab, pq = abs(ax * by - ay * bx), abs(px * qy - py * qx)
        ap, aq = abs(ax * py - ay * px), abs(ax * qy - ay * qx)
        bp, bq = abs(bx * py - by * px), abs(bx * qy - by * qx)
        gap = larger(abs(cx * ay - cy * ax) - ab - ap - aq, abs(cx * by - cy * bx) - ab - bp - bq)
        gap = larger(gap, abs(cx * py - cy * px) - pq - ap - bp)
        gap = larger(gap, abs(cx * qy - cy * qx) - pq - aq - bq)
        hit = (lane[p + k] != 0) & (lane[q + k] != 0) & (lane[PACKET + k] == 0) & (gap < 0.0) & (pq > 0.0)
        out[k] = 1.0 if hit else 0.0
        some += hit
    if some == 0:
        return False
    for k in range(lanes):
        ax, ay, bx, by = one[2 * PACKET + k], one[3 * PACKET + k], one[4 * PACKET + k], one[5 * PACKET + k]
        cx, cy = one[k], one[PACKET + k]
        a_rise, a_run, b_rise, b_run = slope(ay, ax), slope(ax, ay), slope(by, bx), slope(bx, by)
        # Coordinates of `other`: (x e + y f + g, x h + y i + j).
        px, py, qx, qy = other[2 * PACKET + k], other[3 * PACKET + k], other[4 * PACKET + k], other[5 * PACKET + k]
        turn = px * qy - py * qx
        scale = slope(1.0, turn)
        e, f, h, i = qy * scale, -qx * scale, -py * scale, px * scale
        g, j = -(other[k] * e + other[PACKET + k] * f), -(other[k] * h + other[PACKET + k] * i)
        slopes = (
            (slope(h, e), slope(e, h)),  # along x
            (slope(i, f), slope(f, i)),  # along y
            (slope(ax * h + ay * i, ax * e + ay * f), slope(ax * e + ay * f, ax * h + ay * i)),
            (slope(bx * h + by * i, bx * e + by * f), slope(bx * e + by * f, bx * h + by * i)),
        )
        to = (e, f, g, h, i, j)
        x0, y0, x1, y1 = cx - ax - bx, cy - ay - by, cx + ax - bx, cy + ay - by
        x2, y2, x3, y3 = cx + ax + bx, cy + ay + by, cx - ax + bx, cy - ay + by
        side0 = _clipped(x0, y0, x1, y1, a_rise, a_run)
        side1 = _clipped(x1, y1, x2, y2, b_rise, b_run)
        side2 = _clipped(x2, y2, x3, y3, a_rise, a_run)
        side3 = _clipped(x3, y3, x0, y0, b_rise, b_run)
        total = (_chain(side0, side1, slopes[2], slopes, to) + _chain(side1, side2, slopes[3], slopes, to)) + (
            _chain(side2, side3, slopes[2], slopes, to) + _chain(side3, side0, slopes[3], slopes, to)
        )
        out[k] *= abs(total * turn)
    for k in range(lanes):
        here = out[k] > 0.0
        lane[PACKET + k] |= here & ((lane[p + PACKET + k] & lane[q + PACKET + k]) != 0)
        lane[p + PACKET + k] |= lane[q + k] if here else 0
        lane[q + PACKET + k] |= lane[p + k] if here else 0
    return True


@inline
def _clipped(px, py, qx, qy, rise, run):
    """Clip an edge: from (x0, c0) along x to (xa, c0), along the edge to (xb, c1), along x to (x1, c1)."""
    x0, x1 = unit(px), unit(qx)
    y0, y1 = py + (x0 - px) * rise, qy + (x1 - qx) * rise
    c0, c1 = unit(y0), unit(y1)
    return x0, c0, unit(x0 + (c0 - y0) * run), unit(x1 + (c1 - y1) * run), c1, x1


@inline
def _chain(side, following, along, slopes, to):
    """Green's terms of one clipped edge, with the segment along y to the start of the following one."""
    x0, c0, xa, xb, c1, x1 = side
    e, f, g, h, i, j = to
    p, q = x0 * e + (c0 * f + g), x0 * h + (c0 * i + j)
    pa, qa = xa * e + (c0 * f + g), xa * h + (c0 * i + j)
    pb, qb = xb * e + (c1 * f + g), xb * h + (c1 * i + j)
    pc, qc = x1 * e + (c1 * f + g), x1 * h + (c1 * i + j)
    pd, qd = following[0] * e + (following[1] * f + g), following[0] * h + (following[1] * i + j)
    return (
        edge_term(p, q, pa, qa, slopes[0][0], slopes[0][1])
        + edge_term(pa, qa, pb, qb, along[0], along[1])
        + edge_term(pb, qb, pc, qc, slopes[0][0], slopes[0][1])
        + edge_term(pc, qc, pd, qd, slopes[1][0], slopes[1][1])
    )


@kernel
def _general(images, apart, shading, count, k):
    """Unions in one lane, by subtracting the images from the square, large ones first."""
    order, areas = np.empty(count, np.int64), np.empty(count)
    some = shades = np.int64(0)  # a literal would compile the callees twice
    for m in range(count):
        if m == shading:
            shades = some
        here = images[m, AREA + k]
        if here > 0.0:
            n = some
            while n > (shades if m >= shading else 0) and here > areas[n - 1]:
                order[n], areas[n] = order[n - 1], areas[n - 1]
                n -= 1
            order[n], areas[n] = m, here
            some += 1
    if shading == count:
        shades = some
    polygons, corners = np.empty((some, 5, 2)), np.empty(some, np.int64)
    for m in range(some):
        corners[m] = outline(images[order[m]], k, apart[order[m]], polygons[m])
    unshaded, uncovered = gaps(polygons, corners, shades)
    if some - shades > 1:
        unblocked, _ = gaps(polygons[shades:], corners[shades:], some - shades)
    else:
        unblocked = SQUARE - (areas[shades] if some > shades else 0.0)
    return SQUARE - unshaded, SQUARE - unblocked, SQUARE - uncovered

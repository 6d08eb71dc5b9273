"""Exact areas of convex polygons and of their unions within the square [-1, 1] x [-1, 1].

A test mirror, scaled by its half sides, is that square, so sizes and aspect ratios drop out. Polygons are corners
x, y, x, y, ... from some place of a flat array on, counter-clockwise, and counted apart. Every routine depends
continuously on the corners: coincident and nearly coincident edges cost rounding, never a wrong branch.
"""

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner

SQUARE = 4.0
"""Area of the square."""

CORNERS = 5
"""Most corners of a polygon to be subtracted: four, and one more where a plane cuts a corner off."""
_NOTHING = 1e-17
"""Area of a piece not worth following: cutting along coincident edges leaves such slivers."""

Four = tuple[float, float, float, float]
"""One number of each of four edges."""


@inline
def slope(rise: float, run: float) -> float:
    """Quotient that is 0 for an edge without run, where its factor vanishes but infinity times nothing would not."""
    return rise / run if abs(run) > 1e-200 else 0.0


@inline
def slopes(x: float, y: float) -> tuple[float, float]:
    """Slopes dy/dx and dx/dy of the direction (x, y), by one division; both 0 along an axis, where neither counts."""
    square = x * y
    inverse = 1.0 / square if abs(square) > 1e-200 else 0.0
    return y * y * inverse, x * x * inverse


@inline
def larger(a: float, b: float) -> float:
    """Larger of two numbers, in the form that becomes one vector instruction."""
    return a if a > b else b


@inline
def smaller(a: float, b: float) -> float:
    """Smaller of two numbers, in the form that becomes one vector instruction."""
    return a if a < b else b


@inline
def unit(value: float) -> float:
    """Clamp to [-1, 1], in the form that becomes two vector instructions: other forms become three or four."""
    return larger(smaller(value, 1.0), -1.0)


@inline
def edge_term(px: float, py: float, qx: float, qy: float, rise: float, run: float) -> float:
    """Integral of clamp(y) dx along the part of the edge p-q with x in [-1, 1].

    Summed around a polygon it is, up to sign, the area within the square (Green's theorem; each vertical line sees the
    clamped top minus the clamped bottom). By parts it is [x y] minus the integral of x dy, and the latter needs x only
    where the edge crosses y = -1 and y = 1. These crossings are computed outright, not by dividing a difference of
    integrals, so nearly horizontal and nearly vertical edges lose nothing. Beyond the square they do not count; their
    mean is clamped because of rounding. `rise` and `run` are the slopes dy/dx and dx/dy of the edge, from `slope` or
    `slopes`.
    """
    x0, x1 = unit(px), unit(qx)
    y0, y1 = py + (x0 - px) * rise, qy + (x1 - qx) * rise
    c0, c1 = unit(y0), unit(y1)
    middle = unit(0.5 * ((x0 + (c0 - y0) * run) + (x1 + (c1 - y1) * run)))
    return c1 * (x1 - middle) - c0 * (x0 - middle)


@inline
def edge_terms(px: Four, py: Four, qx: Four, qy: Four, rise: Four, run: Four) -> Four:
    """`edge_term` of four edges, step by step: one after the other, their instructions would wait for each other."""
    x0, x1 = units(px), units(qx)
    y0, y1 = along(py, less(x0, px), rise), along(qy, less(x1, qx), rise)
    c0, c1 = units(y0), units(y1)
    start, stop = along(x0, less(c0, y0), run), along(x1, less(c1, y1), run)
    middle = units(
        (
            0.5 * (start[0] + stop[0]),
            0.5 * (start[1] + stop[1]),
            0.5 * (start[2] + stop[2]),
            0.5 * (start[3] + stop[3]),
        )
    )
    return (
        c1[0] * (x1[0] - middle[0]) - c0[0] * (x0[0] - middle[0]),
        c1[1] * (x1[1] - middle[1]) - c0[1] * (x0[1] - middle[1]),
        c1[2] * (x1[2] - middle[2]) - c0[2] * (x0[2] - middle[2]),
        c1[3] * (x1[3] - middle[3]) - c0[3] * (x0[3] - middle[3]),
    )


@inline
def units(values: Four) -> Four:
    """Clamp four numbers to [-1, 1]."""
    return unit(values[0]), unit(values[1]), unit(values[2]), unit(values[3])


@inline
def along(p: Four, t: Four, d: Four) -> Four:
    """Coordinates at t of four lines p + t d."""
    return p[0] + t[0] * d[0], p[1] + t[1] * d[1], p[2] + t[2] * d[2], p[3] + t[3] * d[3]


@inline
def less(a: Four, b: Four) -> Four:
    """Differences a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]


@inner
def square_area(polygons: Floats, at: int, corners: int) -> float:
    """Area of a polygon of either sense within the square."""
    total = 0.0
    px, py = polygons[at + 2 * corners - 2], polygons[at + 2 * corners - 1]
    for k in range(corners):
        qx, qy = polygons[at + 2 * k], polygons[at + 2 * k + 1]
        total += edge_term(px, py, qx, qy, slope(qy - py, qx - px), slope(qx - px, qy - py))
        px, py = qx, qy
    return abs(total)


@inner
def area(polygons: Floats, at: int, corners: int) -> float:
    """Area of a polygon, positive counter-clockwise."""
    total = 0.0
    ox, oy = polygons[at], polygons[at + 1]
    px, py = polygons[at + 2] - ox, polygons[at + 3] - oy
    for k in range(2, corners):
        qx, qy = polygons[at + 2 * k] - ox, polygons[at + 2 * k + 1] - oy
        total += px * qy - py * qx
        px, py = qx, qy
    return 0.5 * total


@inner
def cut(
    polygons: Floats, at: int, corners: int, ox: float, oy: float, ex: float, ey: float, inside: int, outside: int
) -> tuple[int, int]:
    """Cut a convex polygon by the line through o along e: what lies left of it, and what lies right.

    The polygon begins at `at` in `polygons` and has so many `corners`; its parts are written to `inside`, left of the
    line, and to `outside`, right of it, and do not overlap it. Returns the corners written to each. A part without
    interior may have corners on the line; its area is nothing.
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
            left += 1
            right += 1
        if p >= 0.0:
            polygons[inside + 2 * left], polygons[inside + 2 * left + 1] = px, py
            left += 1
        if p <= 0.0:
            polygons[outside + 2 * right], polygons[outside + 2 * right + 1] = px, py
            right += 1
        qx, qy, q = px, py, p
    return left, right


@inner
def gaps(
    polygons: Floats, corners: Integers, first: int, last: int, middle: int, stack: Floats, pieces: Integers
) -> tuple[float, float, bool]:
    """Areas of the square that the unions of convex polygons first..middle, and first..last, leave open.

    Polygons are subtracted one after the other, depth first over convex pieces: the square is the first piece, each
    edge of a polygon splits off the part outside it, and what stays inside all edges is gone. Pieces never overlap, so
    no inclusion-exclusion is needed, and a covered square ends the search at once. The work grows with the pieces that
    remain, a small multiple of the number of polygons in a row of mirrors; large polygons first save some of it.

    `polygons` has room for `CORNERS` corners of each, and `corners` their numbers. Scratch is `stack`, three working
    copies of a piece, an eighth of it each, and the pieces to come; and `pieces`, of each of these where it stands, its
    corners, and the polygon to subtract next. The last value returned tells whether the scratch was large enough;
    otherwise the areas mean nothing.
    """
    room = stack.shape[0] // 8
    stack[3 * room], stack[3 * room + 1], stack[3 * room + 2], stack[3 * room + 3] = -1.0, -1.0, 1.0, -1.0
    stack[3 * room + 4], stack[3 * room + 5], stack[3 * room + 6], stack[3 * room + 7] = 1.0, 1.0, -1.0, 1.0
    pieces[0], pieces[1], pieces[2] = 3 * room, 4, first
    depth = 1
    before = after = 0.0
    while depth > 0:
        depth -= 1
        top, size, k = pieces[3 * depth], pieces[3 * depth + 1], pieces[3 * depth + 2]
        # Every cut may add a corner, or two to what rounding has left not quite convex.
        most = size + 2 * CORNERS
        if 2 * most > room or top + 2 * CORNERS * most > stack.shape[0] or 3 * (depth + CORNERS) > pieces.shape[0]:
            return before, after, False
        for m in range(2 * size):
            stack[m] = stack[top + m]
        while True:
            if k == middle:
                before += area(stack, 0, size)
            if k == last:
                after += area(stack, 0, size)
                break
            crossing = _crossing(polygons, 2 * CORNERS * k, corners[k], stack, size)
            if crossing == 0:
                break  # within the polygon
            if crossing > 0:
                more = _subtract(
                    polygons, 2 * CORNERS * k, corners[k], crossing, size, stack, pieces, depth, top, k + 1
                )
                if more >= 0:
                    depth += more
                    break
            k += 1
    return before, after, True


@inner
def _crossing(polygons, at, corners, stack, size):
    """Edges of a polygon beyond which the first piece has corners, a bit for each; -1 where all lie beyond one."""
    found = 0
    px, py = polygons[at + 2 * corners - 2], polygons[at + 2 * corners - 1]
    for e in range(corners):
        qx, qy = polygons[at + 2 * e], polygons[at + 2 * e + 1]
        beyond, within = False, False
        for c in range(size):
            side = (qx - px) * (stack[2 * c + 1] - py) - (qy - py) * (stack[2 * c] - px)
            beyond |= side < 0.0
            within |= side > 0.0
        if beyond and not within:
            return -1
        found |= beyond << e
        px, py = qx, qy
    return found


@inner
def _subtract(polygons, at, corners, crossing, size, stack, pieces, depth, top, following):
    """Cut the first piece of the stack by the edges of a polygon and put what lies outside on the stack.

    Returns the number of new pieces; -1 if the polygon misses the piece.
    """
    room = stack.shape[0] // 8
    piece, target, spare = 0, room, 2 * room
    more = 0
    px, py = polygons[at + 2 * corners - 2], polygons[at + 2 * corners - 1]
    for e in range(corners):
        qx, qy = polygons[at + 2 * e], polygons[at + 2 * e + 1]
        if crossing >> e & 1:
            size, outside = cut(stack, piece, size, px, py, qx - px, qy - py, target, top)
            if size < 3:
                return -1
            piece, target, spare = target, spare, target
            if outside > 2 and area(stack, top, outside) > _NOTHING:
                new = 3 * (depth + more)
                pieces[new], pieces[new + 1], pieces[new + 2] = top, outside, following
                top += 2 * outside
                more += 1
        px, py = qx, qy
    return more if area(stack, piece, size) > _NOTHING else -1

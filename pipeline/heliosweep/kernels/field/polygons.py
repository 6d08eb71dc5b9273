"""Exact areas within the square [-1, 1] x [-1, 1], the test mirror scaled by its half sides: convex polygons.

Polygons are corners x, y, x, y, ... from some place of a flat array on, counter-clockwise, and counted apart. Every
routine depends continuously on the corners: coincident and nearly coincident edges cost rounding, never a wrong branch.
"""

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, inner

#: Area of the square.
SQUARE = 4.0

#: Most corners of an image: four, and one more if a plane cuts a corner off.
CORNERS = 5
#: Area of a piece not worth following: cutting along coincident edges leaves such slivers.
_NOTHING = 1e-17

#: One number of each of four edges.
Four = tuple[float, float, float, float]


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


@inline
def edge_terms(px: Four, py: Four, qx: Four, qy: Four, rise: Four, run: Four) -> Four:
    """Integrals of clamp(y) dx along the parts of four edges p-q with x in [-1, 1].

    Summed around a polygon they are, up to sign, the area within the square (Green's theorem; each vertical line adds
    the clamped top minus the clamped bottom). By parts each is [x y] minus the integral of x dy, and the latter needs x
    only where the edge crosses y = -1 and y = 1. These crossings are computed outright, not by dividing a difference of
    integrals, so nearly horizontal and nearly vertical edges lose nothing. Beyond the square they do not count; their
    mean is clamped because of rounding. `rise` and `run` are the slopes dy/dx and dx/dy of the edges, from `slopes`.
    Four edges step by step: one after the other, their instructions would wait for each other.
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
    """Write the corners of the square."""
    for k in range(4):
        polygons[at + 2 * k], polygons[at + 2 * k + 1] = 1.0 if k == 1 or k == 2 else -1.0, 1.0 if k > 1 else -1.0


@inner
def area(polygons: Floats, at: int, corners: int) -> float:
    """Area of a polygon, positive counter-clockwise."""
    total, ox, oy = 0.0, polygons[at], polygons[at + 1]
    for k in range(at + 2, at + 2 * corners - 2, 2):
        px, py, qx, qy = polygons[k] - ox, polygons[k + 1] - oy, polygons[k + 2] - ox, polygons[k + 3] - oy
        total += px * qy - py * qx
    return 0.5 * total


@inner
def cut(
    polygons: Floats, at: int, corners: int, ox: float, oy: float, ex: float, ey: float, inside: int, outside: int
) -> tuple[int, int]:
    """Cut a convex polygon by the line through o along e into a left and a right part.

    The polygon begins at `at` in `polygons` and has `corners` corners; its parts are written to `inside`, left of the
    line, and to `outside`, right of it, and do not overlap it. Returns the corners written to each. A part without
    interior may have corners on the line; its area is 0.
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
    """Edges of a polygon beyond which a piece has corners, a bit for each; -1 if all lie beyond one."""
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
    """Clip a piece at the edges of a polygon; return begin and corners of the remainder, 0 corners if it is empty.

    The piece begins at 0 or at a third of `pieces`; the rest is scratch.
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
    polygons: Floats, corners: Integers, k: int, middle: int, last: int, pieces: Floats, piece: int, size: int,
    top: int, totals: Floats,
) -> None:  # fmt: skip
    """Add the areas of a convex piece that convex polygons k..middle, and k..last, leave open, to two totals.

    Polygons are subtracted one after the other, depth first over convex pieces: each edge of a polygon splits off the
    part outside it, and what stays inside all edges is gone. Pieces never overlap, so no inclusion-exclusion is needed.

    `polygons` has room for `CORNERS` corners of each, and `corners` their numbers. The piece of `size` corners begins
    at `piece` in `pieces`, and scratch at `top`.
    """
    crossed = -1
    while crossed < 0:  # polygons that miss the piece
        if k == middle:
            totals[0] += area(pieces, piece, size)
        if k == last:
            totals[1] += area(pieces, piece, size)
            return
        at, edges = 2 * CORNERS * k, corners[k]
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
            if outside > 2 and area(pieces, top + 2 * room, outside) > _NOTHING:
                leave_open(polygons, corners, k, middle, last, pieces, top + 2 * room, outside, top + 3 * room, totals)
        px, py = qx, qy

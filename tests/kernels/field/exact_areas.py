"""Areas of unions of parallelograms within the square [-1, 1] x [-1, 1], in integers: no rounding, no ties to break."""

from fractions import Fraction
from itertools import pairwise
from math import gcd, lcm


def exact_areas(shapes, shading):
    """Union areas of m parallelograms, shape (m, 6), centre and half edges: of the first `shading`, the others, all.

    Points and lines are homogeneous integers on a grid that holds every coordinate, so that each sign is exact, and
    with it each clip of a convex polygon. Unions are by inclusion and exclusion.
    """
    shapes = [[Fraction(float(value)) for value in shape] for shape in shapes]
    scale = lcm(*(value.denominator for shape in shapes for value in shape))
    edges = [_edges(*(int(value * scale) for value in shape)) for shape in shapes]
    total = [Fraction(0)] * 3

    def add(polygon, members, sign):
        for m in range(members[-1] + 1 if members else 0, len(edges)):
            common = polygon if edges[m] else []
            for edge in edges[m]:
                common = common and _left_of(edge, common)
            if common and (size := _area(common)) > 0:
                first = members[0] if members else m
                if m < shading:
                    total[0] += sign * size
                elif first >= shading:
                    total[1] += sign * size
                total[2] += sign * size
                add(common, [*members, m], -sign)

    add([(x * scale, y * scale, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], [], 1)
    return [value / scale**2 for value in total]


def _edges(cx, cy, ax, ay, bx, by):
    """Lines (e, f, g) of a parallelogram's edges: within it e x + f y + g >= 0. None, if it has no area."""
    turn = ax * by - ay * bx
    if turn == 0:
        return []
    if turn < 0:
        ax, ay, bx, by = bx, by, ax, ay
    return [
        (-ey, ex, ey * (cx + ox) - ex * (cy + oy))
        for ex, ey, ox, oy in ((ax, ay, -bx, -by), (bx, by, ax, ay), (-ax, -ay, bx, by), (-bx, -by, -ax, -ay))
    ]


def _left_of(line, polygon):
    """Part of a convex polygon, corners (x, y, w) at (x / w, y / w), left of a line."""
    e, f, g = line
    heights = [e * x + f * y + g * w for x, y, w in polygon]
    if min(heights) >= 0:
        return polygon
    if max(heights) <= 0:
        return []
    out = []
    for k, (corner, height) in enumerate(zip(polygon, heights, strict=True)):
        before = heights[k - 1]
        if height * before < 0:
            p, q = abs(height), abs(before)
            x, y, w = (p * s + q * t for s, t in zip(polygon[k - 1], corner, strict=True))
            divisor = gcd(x, y, w)
            out.append((x // divisor, y // divisor, w // divisor))
        if height >= 0:
            out.append(corner)
    return out


def _area(polygon):
    """Area of a polygon of corners (x, y, w), counter-clockwise: a fan of triangles from the first corner."""
    ox, oy, ow = polygon[0]
    size, over = 0, 1
    for (px, py, pw), (qx, qy, qw) in pairwise(polygon[1:]):
        turn = ox * (py * qw - pw * qy) - oy * (px * qw - pw * qx) + ow * (px * qy - py * qx)
        size, over = size * pw * qw + turn * over, over * pw * qw
    return Fraction(size, 2 * ow * over)

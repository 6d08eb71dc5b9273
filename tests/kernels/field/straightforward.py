"""Cosine, shading, blocking and optical efficiency, straightforward: the field kernels' oracle and their baseline.

One heliostat and one instant after the other, in scalars. Each neighbour's centre and half edges are moved along the
direction (sun or target) into the plane of the mirror; its image is what lies in front of up to five lines, the four
edges and, where it straddles the plane of the mirror, where it meets it. Lines cut convex polygons as Sutherland and
Hodgman do. Of a union the kernel keeps what is left open, convex pieces of the mirror that each image splits in turn.
Nothing is taken from the field kernels but the name of a tracking method.
"""

import numba
import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.field.packets import SPINNING_ELEVATION

Floats = NDArray[np.float64]

compiled = numba.njit(nogil=True, cache=True, error_model="numpy")
inline = numba.njit(nogil=True, cache=True, error_model="numpy", forceinline=True)

SLACK = 1.0 + 1e-9
"""Bounds are as much too wide: rounding drops no neighbour."""
CORNERS, PIECES = 32, 4096
"""Room for corners of a piece and pieces of a mirror: more make NaN."""
FIRST, SECOND = 2, 2 + PIECES
"""Where pieces begin among all polygons: those before an image is subtracted, and those after it, or the reverse."""
NOTHING = 1e-18
"""Area of a piece not worth following, on a mirror of area 4: lines that coincide leave such slivers."""


def straightforward_series(x, y, z, half_width, half_height, target_height, tracking, sun, start, stop, lowest=None):
    """Efficiencies of every instant, parameters as of `sorted_field`, and these and result of `field_series`.

    `lowest` is the sine of the lowest sun elevation that neighbours are sought for, by default that of `sun`.
    """
    centres, sides = np.stack((x, y, z), axis=1), np.stack((half_width, half_height), axis=1)
    radius = np.sqrt(half_width**2 + half_height**2)
    to_target = np.array([0.0, 0.0, target_height]) - centres
    throw = np.sqrt(to_target[:, 0] ** 2 + to_target[:, 1] ** 2 + to_target[:, 2] ** 2)
    out = np.full((4, len(sun), stop - start), np.nan)
    up = sun[:, 2] > 0.0
    if up.any():
        lowest = sun[up, 2].min() if lowest is None else lowest
        aim = to_target / throw[:, None]
        shaders, limits, blockers = neighbours(centres, radius, aim, throw, lowest, start, stop)
        sun = np.ascontiguousarray(sun)
        series(centres, sides, radius, aim, tracking, sun, start, stop, shaders, limits, blockers, out)
    return out


def neighbours(centres, radius, aim, throw, lowest, start, stop):
    """Who may shade and who may block heliostats start..stop: rows of their number and their names.

    A shading image needs a plan distance below (R + |dz| cos a) / sin a, R the sum of the bounding radii, a the sun's
    elevation, so that sin a is limited: those with the highest limit come first. A blocking one needs a bounding
    sphere that meets the beam to the target.
    """
    count = len(centres)
    limits = np.zeros((stop - start, count))
    shaders, blockers = np.zeros((stop - start, count), np.int64), np.zeros((stop - start, count), np.int64)
    for t, i in enumerate(range(start, stop)):
        offset, reach = centres - centres[i], (radius + radius[i]) * SLACK
        with np.errstate(divide="ignore"):
            limit = (reach + np.abs(offset[:, 2])) / np.hypot(offset[:, 0], offset[:, 1]) * SLACK
        limit[i] = 0.0
        names = np.argsort(-limit, kind="stable")[: np.count_nonzero(limit > lowest)]
        shaders[t, 0], shaders[t, 1 : len(names) + 1], limits[t, 1 : len(names) + 1] = len(names), names, limit[names]
        ahead = offset @ aim[i]
        met = (ahead > -reach) & (ahead < throw[i]) & (np.sum(offset**2, axis=1) - ahead**2 < reach**2)
        met[i] = False
        blockers[t, 0], blockers[t, 1 : met.sum() + 1] = met.sum(), np.flatnonzero(met)
    return shaders, limits, blockers


@inline
def apart(i, j, centres, radius):
    """From centre i to centre j, and the sum of the bounding radii."""
    dx, dy, dz = centres[j, 0] - centres[i, 0], centres[j, 1] - centres[i, 1], centres[j, 2] - centres[i, 2]
    return dx, dy, dz, (radius[i] + radius[j]) * SLACK


@inline
def meets(dx, dy, dz, reach, x, y, z):
    """Whether a sphere about D meets the ray from nothing along a direction, or holds its start."""
    ahead = dx * x + dy * y + dz * z
    return ahead > -reach and dx * dx + dy * dy + dz * dz - ahead * ahead < reach * reach


@inline
def frame(rx, ry, rz, sx, sy, sz, tracking, out, j):
    """Write the frame u, v, n of mirror j, which sends the sun s to the target along r."""
    nx, ny, nz = rx + sx, ry + sy, rz + sz
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    if tracking == SPINNING_ELEVATION:
        ux, uy, uz = ry * sz - rz * sy, rz * sx - rx * sz, rx * sy - ry * sx
    else:
        ux, uy, uz = -ny, nx, 0.0
    length = np.sqrt(ux * ux + uy * uy + uz * uz)
    if length < 1e-15:
        ux, uy, uz = 1.0, 0.0, 0.0
        length = np.sqrt(rx * rx + ry * ry)
        if tracking == SPINNING_ELEVATION and length > 1e-15:
            ux, uy = -ry, rx
        else:
            length = 1.0
    ux, uy, uz = ux / length, uy / length, uz / length
    out[j, 0, 0], out[j, 0, 1], out[j, 0, 2] = ux, uy, uz
    out[j, 1, 0], out[j, 1, 1], out[j, 1, 2] = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    out[j, 2, 0], out[j, 2, 1], out[j, 2, 2] = nx, ny, nz


@compiled
def series(centres, sides, radius, aim, tracking, sun, start, stop, shaders, limits, blockers, out):
    """Write the efficiencies of heliostats start..stop at all instants with the sun up."""
    count = len(centres)
    frames = np.empty((count, 3, 3))
    lines, edges, areas = np.empty((2 * count, 5, 3)), np.empty(2 * count, np.int64), np.empty(2 * count)
    polygons, sizes = np.empty((2 + 2 * PIECES, CORNERS, 2)), np.empty(2 + 2 * PIECES, np.int64)
    for k in range(len(sun)):
        sx, sy, sz = sun[k, 0], sun[k, 1], sun[k, 2]
        if sz <= 0.0:
            continue
        for j in range(count):
            frame(aim[j, 0], aim[j, 1], aim[j, 2], sx, sy, sz, tracking, frames, j)
        for t in range(stop - start):
            i = start + t
            some = 0
            while some < shaders[t, 0] and limits[t, some + 1] > sz:
                some += 1
            shading = images(
                i, t, shaders, some, sx, sy, sz, centres, sides, radius, frames, lines, edges, areas, polygons, 0
            )
            rx, ry, rz, some = aim[i, 0], aim[i, 1], aim[i, 2], blockers[t, 0]
            both = images(
                i, t, blockers, some, rx, ry, rz, centres, sides, radius, frames, lines, edges, areas, polygons, shading
            )
            shaded = covered = union(0, shading, lines, edges, areas, polygons, sizes)
            blocked = union(shading, both, lines, edges, areas, polygons, sizes)
            if 0 < shading < both:
                covered = union(0, both, lines, edges, areas, polygons, sizes)
            elif shading == 0:
                covered = blocked
            cosine = frames[i, 2, 0] * sx + frames[i, 2, 1] * sy + frames[i, 2, 2] * sz
            out[0, k, t], out[1, k, t], out[2, k, t] = cosine, 1.0 - shaded / 4.0, 1.0 - blocked / 4.0
            out[3, k, t] = cosine * (1.0 - covered / 4.0)


@inline
def images(i, t, others, some, x, y, z, centres, sides, radius, frames, lines, edges, areas, polygons, made):
    """Append the images along (x, y, z) that meet mirror i, as lines that they are in front of; returns their number.

    On the plane of mirror i, in half sides, an image is c + p a + q b with p and q from -1 to 1. In front of the line
    (e, f, g) is what has e x + f y + g >= 0.
    """
    slant = frames[i, 2, 0] * x + frames[i, 2, 1] * y + frames[i, 2, 2] * z
    for m in range(1, some + 1):
        j = others[t, m]
        dx, dy, dz, reach = apart(i, j, centres, radius)
        if not meets(dx, dy, dz, reach, x, y, z):
            continue
        w, h = sides[j, 0], sides[j, 1]
        px, py, pz = w * frames[j, 0, 0], w * frames[j, 0, 1], w * frames[j, 0, 2]
        qx, qy, qz = h * frames[j, 1, 0], h * frames[j, 1, 1], h * frames[j, 1, 2]
        cx, cy, height = moved(dx, dy, dz, x, y, z, frames, sides, i, slant)
        ax, ay, along_a = moved(px, py, pz, x, y, z, frames, sides, i, slant)
        bx, by, along_b = moved(qx, qy, qz, x, y, z, frames, sides, i, slant)
        rise = abs(along_a) + abs(along_b)
        wide, high = abs(ax) + abs(bx), abs(ay) + abs(by)
        if height <= -rise or abs(cx) >= 1.0 + wide or abs(cy) >= 1.0 + high:
            continue
        # The coordinates p and q of a point, times a x b, are b x (c - point) and a x (point - c).
        turn = ax * by - ay * bx
        if turn < 0.0:
            ax, ay, turn, along_a = -ax, -ay, -turn, -along_a
        of_a, of_b = by * cx - bx * cy, ax * cy - ay * cx
        put(lines, made, 0, by, -bx, turn - of_a)
        put(lines, made, 1, -by, bx, turn + of_a)
        put(lines, made, 2, -ay, ax, turn - of_b)
        put(lines, made, 3, ay, -ax, turn + of_b)
        edges[made] = 4
        if height < rise:
            e, f = along_a * by - along_b * ay, along_b * ax - along_a * bx
            put(lines, made, 4, e, f, height * turn - along_a * of_a - along_b * of_b)
            edges[made] = 5
        corners, inside, spare = whole(polygons, 0), 0, 1
        for e in range(edges[made]):
            if beside(lines, made, e):
                continue
            corners = front(polygons, inside, corners, lines, made, e, 1.0, spare)
            inside, spare = spare, inside
            if corners < 3:
                break
        areas[made] = area(polygons, inside, corners)
        made += areas[made] > NOTHING
    return made


@inline
def moved(px, py, pz, x, y, z, frames, sides, i, slant):
    """Move a vector along (x, y, z) into the plane of mirror i: its parts in half sides, and what its height was."""
    height = px * frames[i, 2, 0] + py * frames[i, 2, 1] + pz * frames[i, 2, 2]
    t = height / slant
    px, py, pz = px - t * x, py - t * y, pz - t * z
    along_u = px * frames[i, 0, 0] + py * frames[i, 0, 1] + pz * frames[i, 0, 2]
    along_v = px * frames[i, 1, 0] + py * frames[i, 1, 1] + pz * frames[i, 1, 2]
    return along_u / sides[i, 0], along_v / sides[i, 1], height


@inline
def put(rows, m, place, e, f, g):
    rows[m, place, 0], rows[m, place, 1], rows[m, place, 2] = e, f, g


@inline
def whole(polygons, polygon):
    """Write the whole mirror; returns its corners."""
    for k in range(4):
        polygons[polygon, k, 0] = 1.0 if k == 1 or k == 2 else -1.0
        polygons[polygon, k, 1] = 1.0 if k > 1 else -1.0
    return 4


@inline
def union(start, stop, lines, edges, areas, polygons, sizes):
    """Area of images start..stop together: what they take from the mirror, of which pieces stay.

    Each image splits each piece that it meets: what is outside of one line, and inside of all before, is one piece.
    """
    if stop - start < 2:
        return areas[start] if stop > start else 0.0
    now, some = FIRST, 1
    sizes[now] = whole(polygons, now)
    for m in range(start, stop):
        then, kept = (SECOND if now == FIRST else FIRST), 0
        for piece in range(now, now + some):
            size, began, inside, spare = sizes[piece], kept, piece, 0
            for e in range(edges[m]):
                if kept == PIECES or size > CORNERS - 2:
                    return np.nan
                if beside(lines, m, e):
                    continue
                sizes[then + kept] = front(polygons, inside, size, lines, m, e, -1.0, then + kept)
                kept += area(polygons, then + kept, sizes[then + kept]) > NOTHING
                size = front(polygons, inside, size, lines, m, e, 1.0, spare)
                inside, spare = spare, 1 - spare
                if size < 3:
                    break
            if area(polygons, inside, size) <= NOTHING:  # they do not meet: the piece stays whole
                kept = began + 1
                sizes[then + began] = sizes[piece]
                for k in range(sizes[piece]):
                    for c in range(2):
                        polygons[then + began, k, c] = polygons[piece, k, c]
        now, some = then, kept
    left = 0.0
    for piece in range(now, now + some):
        left += area(polygons, piece, sizes[piece])
    return 4.0 - left


@inline
def beside(lines, m, line):
    """Whether the whole mirror is in front of a line."""
    return lines[m, line, 2] >= abs(lines[m, line, 0]) + abs(lines[m, line, 1])


@inline
def front(polygons, polygon, corners, lines, m, line, side, out):
    """Write the part of a convex polygon in front of a line, or behind it (Sutherland and Hodgman); its corners."""
    e, f, g = side * lines[m, line, 0], side * lines[m, line, 1], side * lines[m, line, 2]
    count = 0
    px, py = polygons[polygon, corners - 1, 0], polygons[polygon, corners - 1, 1]
    p = e * px + f * py + g
    for k in range(corners):
        qx, qy = polygons[polygon, k, 0], polygons[polygon, k, 1]
        q = e * qx + f * qy + g
        if (p < 0.0) != (q < 0.0):
            share = p / (p - q)
            polygons[out, count, 0], polygons[out, count, 1] = px + share * (qx - px), py + share * (qy - py)
            count += 1
        if q >= 0.0:
            polygons[out, count, 0], polygons[out, count, 1] = qx, qy
            count += 1
        px, py, p = qx, qy, q
    return count


@inline
def area(polygons, polygon, corners):
    """Area of a convex polygon, counter-clockwise, as triangles about its first corner."""
    twice = 0.0
    ox, oy = polygons[polygon, 0, 0], polygons[polygon, 0, 1]
    for k in range(2, corners):
        px, py = polygons[polygon, k - 1, 0] - ox, polygons[polygon, k - 1, 1] - oy
        qx, qy = polygons[polygon, k, 0] - ox, polygons[polygon, k, 1] - oy
        twice += px * qy - py * qx
    return 0.5 * twice
